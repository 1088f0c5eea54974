"""The notebooks of docs/: what every one of them has, and that their findings hold."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.py"))
EACH = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


@EACH
def test_a_notebook_is_listed_with_a_small_picture(path: Path) -> None:
    assert len(NOTEBOOKS) == 10
    page = (FOLDER / "index.md").read_text(encoding="utf-8")
    assert f"]({path.name})" in page
    assert f"../images/notebooks/{path.stem}.png" in page
    assert f"notebooks/{path.stem}.md" in (ROOT / "mkdocs.yml").read_text(encoding="utf-8").split("\nnav:\n")[1]
    picture = ROOT / "docs" / "images" / "notebooks" / f"{path.stem}.png"
    assert 2_000 < picture.stat().st_size < 60_000


@pytest.mark.slow
@EACH
def test_a_notebook_runs_and_its_findings_hold(path: Path, tmp_path: Path) -> None:
    """As a script, in an empty home, with every warning of vrte an error."""
    if path.stem == "mitsuba_renderer":
        pytest.importorskip("mitsuba")
    environment = {**os.environ, "MPLBACKEND": "Agg", "HOME": str(tmp_path), "MPLCONFIGDIR": str(tmp_path)}
    environment["PYTHONPATH"] = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    start = (
        "import runpy, sys, warnings, vrte\n"
        "for kind in ('vrte', '__main__', '<run_path>'): warnings.filterwarnings('error', module=kind)\n"
        "runpy.run_path(sys.argv[1])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", start, str(path)],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert "Warning" not in done.stderr
    assert done.stdout.strip()
