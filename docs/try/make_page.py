"""Writes the page of docs/try.md: the tables of the sweep files beside this script, computed where they are not there
yet, and one page with their lobes. Usage: python docs/try/make_page.py out/try
"""

import hashlib
import sys
from pathlib import Path

import vrte
from vrte.sweep import page
from vrte.sweep.page.writing import save_page
from vrte.sweep.template import read_sweep

HERE = Path(__file__).parent
POWDERS = ["gold", "gold_coarse", "copper", "hematite", "rutile", "alumina"]
FILES = [*POWDERS, "paint", "paint_gloss", "powder_dry", "powder_wet", "cloud", "snow"]  # in the order of the menu


def main(folder: Path) -> None:
    """Everything that is there for the same sweeps, version and page is kept."""
    folder.mkdir(parents=True, exist_ok=True)
    marks = {name: read_sweep(HERE / f"{name}.toml").fingerprint()[:12] for name in FILES}
    parts = [one.read_bytes() for one in sorted(Path(page.__file__).parent.glob("*.*"))] + [Path(__file__).read_bytes()]
    made = hashlib.sha256(b"".join([*parts, repr(marks).encode()])).hexdigest()
    mark = folder / "lobes.sha256"
    if mark.exists() and mark.read_text() == made:
        return
    tables = {}
    for name in FILES:
        title = (HERE / f"{name}.toml").read_text("utf-8").splitlines()[0].lstrip("# ")
        tables[title] = vrte.sweep(HERE / f"{name}.toml", folder / f"{name}-{marks[name]}.zarr")
    for title, errors in save_page(tables, folder / "lobes.html").items():
        print(f"{title}: off by at most {100.0 * errors.max():.2g} % at {errors.size} points")
    mark.write_text(made)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
