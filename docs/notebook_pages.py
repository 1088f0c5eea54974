"""The notebooks of docs/notebooks as pages of the site: run as it is built, each to be fetched as .ipynb.

They are not left to MkDocs' plugin for notebooks, whose pages fetch MathJax from elsewhere. A notebook that was run
before, with the same text and the same vrte, is not run again: out/notebooks keeps it.

`python docs/notebook_pages.py` writes the small pictures of docs/notebooks/index.md.
"""

import base64
import hashlib
import io
import re
from pathlib import Path
from typing import Any

import jupytext
import nbformat
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

from vrte.formats.atomic import write_atomically

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs" / "notebooks"
KEPT = ROOT / "out" / "notebooks"
SMALL = ROOT / "docs" / "images" / "notebooks"
SHOWN = {"mitsuba_renderer": 1, "polarized_sky": 1, "powder": 1, "sweep": 1}  # which picture stands for a notebook
QUIET = ["--IPKernelApp.log_level=ERROR"]  # without the warning that a port of this machine is not encrypted
LIMIT_S = 300  # for one cell; a notebook takes a few seconds where nothing else is at work


def on_files(files: Files, config: Any) -> Files:
    """Adds a page, its pictures and the notebook itself for each of docs/notebooks."""
    for path in sorted(FOLDER.glob("*.py")):
        text, pictures, notebook = make_page(path)
        name = f"notebooks/{path.stem}"
        files.append(File.generated(config, f"{name}.md", content=text))
        files.append(File.generated(config, f"{name}.ipynb", content=notebook))
        for number, picture in enumerate(pictures, 1):
            files.append(File.generated(config, f"{name}_{number}.png", content=picture))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Links to notebooks, files in a source tree, lead to their pages."""
    return re.sub(r"\]\((\w+)\.py\)", r"](\1.md)", markdown) if page.file.src_uri == "notebooks/index.md" else markdown


def make_page(path: Path) -> tuple[str, list[bytes], str]:
    """A notebook as Markdown, its pictures in order, and the text of an .ipynb file with all that it printed."""
    notebook = run_notebook(path)
    links = f"[{path.stem}.ipynb]({path.stem}.ipynb) or [{path.stem}.py]({path.stem}.py)"
    parts: list[str] = []
    pictures: list[bytes] = []
    heading = path.stem
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            title = next((line.lstrip("# ") for line in cell.source.splitlines() if line.startswith("#")), "")
            heading = title or heading
            parts.append(cell.source)
            continue
        parts.append(f"```python\n{cell.source}\n```")
        for output in cell.outputs:
            if output.get("name") == "stdout":
                parts.append(f"```text\n{output['text'].rstrip()}\n```")
            elif "image/png" in output.get("data", {}):
                pictures.append(base64.b64decode(output["data"]["image/png"]))
                parts.append(f"![{heading}]({path.stem}_{len(pictures)}.png)")
    parts.insert(1, f"*This page was run as the site was built; to run it yourself: {links}.*")
    return "\n\n".join(parts) + "\n", pictures, nbformat.writes(notebook)


def run_notebook(path: Path) -> Any:
    """The notebook after all its cells have run in order. Raises PluginError where one fails."""
    sources = [path, *sorted((ROOT / "vrte").rglob("*.py")), *(ROOT / "vrte").glob("_core*.so")]
    digest = hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()[:16]
    kept = KEPT / f"{path.stem}-{digest}.ipynb"
    if kept.is_file():
        return nbformat.read(kept, as_version=4)
    notebook = jupytext.read(path)
    notebook.metadata["kernelspec"] = {"name": "python3", "display_name": "Python 3", "language": "python"}
    place = {"metadata": {"path": str(FOLDER)}}
    try:
        NotebookClient(notebook, timeout=LIMIT_S, extra_arguments=QUIET, resources=place).execute()
    except CellExecutionError as error:
        raise PluginError(f"{path.relative_to(ROOT)}: {error}") from None
    for cell in notebook.cells:
        if cell.cell_type == "code":  # not what the last line of a cell happens to return
            cell.outputs = [output for output in cell.outputs if output.output_type != "execute_result"]
    KEPT.mkdir(parents=True, exist_ok=True)
    for old in KEPT.glob(f"{path.stem}-*.ipynb"):
        old.unlink()
    with write_atomically(kept) as part:
        nbformat.write(notebook, part)
    return notebook


def write_small_pictures() -> None:
    """A picture of each notebook for the page that lists them, as wide as a card there."""
    from PIL import Image, ImageOps

    SMALL.mkdir(exist_ok=True)
    for path in sorted(FOLDER.glob("*.py")):
        pictures = make_page(path)[1]
        picture = Image.open(io.BytesIO(pictures[SHOWN.get(path.stem, 1) - 1])).convert("RGB")
        picture = ImageOps.pad(picture, (480, 280), Image.Resampling.LANCZOS, color="white")
        with write_atomically(SMALL / f"{path.stem}.png") as part:
            picture.quantize(256).save(part, "PNG", optimize=True)


if __name__ == "__main__":
    write_small_pictures()
