"""The notebooks of docs/: what every one of them has, and that their findings hold."""

import ast
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.py"))
EACH = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def split_cells(path: Path) -> list[tuple[str, str]]:
    """Kind and text of each cell of a script in jupytext's percent format; nothing stands before the first."""
    before, *parts = re.split(r"^# %%", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert not before
    return [("markdown" if part.startswith(" [markdown]\n") else "code", part.split("\n", 1)[1]) for part in parts]


def test_there_are_ten() -> None:
    assert len(NOTEBOOKS) == 10


@EACH
def test_a_notebook_asks_a_question_and_checks_its_answer(path: Path) -> None:
    cells = split_cells(path)
    kind, intro = cells[0]
    title, empty, *rest = intro.splitlines()
    assert kind == "markdown"
    assert re.fullmatch(r"# # [A-Z].+", title)
    assert empty == "#"
    assert "?" in intro
    assert len(" ".join(rest).split()) > 25
    assert all(line.startswith("#") for kind, text in cells if kind == "markdown" for line in text.splitlines() if line)
    code = ast.parse("\n".join(text for kind, text in cells if kind == "code"))
    assert sum(isinstance(node, ast.Assert) for node in ast.walk(code)) >= 2
    assert "figure" in {node.id for node in ast.walk(code) if isinstance(node, ast.Name)}
    assert cells[-1][0] == "markdown"  # it ends with what was found


@EACH
def test_a_notebook_draws_nothing_by_chance(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert "np.random.rand" not in text
    assert text.count("default_rng(") == len(re.findall(r"default_rng\(\d+\)", text))


@EACH
def test_a_notebook_is_listed_with_a_small_picture(path: Path) -> None:
    page = (FOLDER / "index.md").read_text(encoding="utf-8")
    assert f"]({path.name})" in page
    assert f"../images/notebooks/{path.stem}.png" in page
    assert f"notebooks/{path.stem}.md" in (ROOT / "mkdocs.yml").read_text(encoding="utf-8").split("\nnav:\n")[1]
    picture = ROOT / "docs" / "images" / "notebooks" / f"{path.stem}.png"
    assert 2_000 < picture.stat().st_size < 60_000


def test_no_module_that_a_notebook_imports_is_hidden_by_another() -> None:
    imported = {
        (alias.name if isinstance(node, ast.Import) else str(node.module)).partition(".")[0]
        for path in NOTEBOOKS
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Import | ast.ImportFrom)
        for alias in node.names
    }
    assert "mitsuba" in imported
    assert not imported & {path.stem for path in NOTEBOOKS}


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
