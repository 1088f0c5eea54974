"""Every snippet of the README and of docs/ runs as it stands: Python, scene files, and the options of every command."""

import contextlib
import doctest
import io
import re
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from vrte import cli
from vrte.commands.common import make_parser
from vrte.formats.scene_file import read_content, read_scene
from vrte.render.rendering import read as read_setting
from vrte.sweep.template import read_sweep

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
PREDICTED = r" +[0-9.]+(e[+-][0-9]+\b| MB| times)"  # sizes, which change with every rule of thumb behind them


class Rough(doctest.OutputChecker):
    """Passes where all but predicted sizes is the same."""

    def check_output(self, want: str, got: str, optionflags: int) -> bool:
        want, got = (re.sub(PREDICTED, " #", text) for text in (want, got))
        return super().check_output(want, got, optionflags)


def blocks(page: Path, language: str) -> list[str]:
    """The code of one language, "" for commands and what they print."""
    text = page.read_text(encoding="utf-8")
    return [code for found, code in re.findall(r"^```(\w*)\n(.*?)^```", text, re.M | re.S) if found == language]


def printing_snippets(page: Path) -> list[tuple[str, str]]:
    """The Python of a page, each piece with what the page says it prints, in a block of text right below it."""
    text = page.read_text(encoding="utf-8")
    return re.findall(r"^```python\n(.*?)^```\n(?:\n```text\n(.*?)^```\n)?", text, re.M | re.S)


def commands(page: Path) -> list[str]:
    """The lines that call vrte, but for what a shell makes of them."""
    lines = "\n".join(blocks(page, "")).splitlines()
    inline = re.findall(r"`(vrte [a-z]+ [^`]+)`", page.read_text(encoding="utf-8"))
    return [line.removeprefix("$ ") for line in [*lines, *inline] if re.match(r"(\$ )?vrte ", line)]


def smaller_sweep(folder: Path) -> None:
    """The sweep that docs/how_to/sweeps.md runs has 588 scenes: with fewer, the same lines run."""
    path = folder / "examples" / "gold_table.toml"
    text = path.read_text()
    for given, fewer in (("count = 21", "count = 5"), ("count = 28", "count = 5"), ("nodes = 24", "nodes = 6")):
        assert given in text
        text = text.replace(given, fewer)
    path.write_text(text)


def table_for_mitsuba(folder: Path) -> None:
    """What the commands beside the lines for Mitsuba write, of a scene that is quickly solved."""
    (folder / "paint.toml").write_text(
        '[[layer]]\nphase = "rayleigh"\nalbedo = 0.9\nthickness = 1.0\n[brdf]\nmu_i = 0.5\nmu_o = 0.5\n'
    )
    command = shlex.split("export paint.toml --wavelengths-um 0.45,0.5,0.55,0.6,0.65 --nodes 4")
    for more in ("-o paint.pbsdf --step-deg 15", "-o paint.nc"):
        assert cli.main([*command, *shlex.split(more)]) == 0


# Mitsuba renders, kernels are compiled, a table is made, panels are solved at many wavelengths
SLOW = {"exports.md", "opencl.md", "sweeps.md", "appearance.md", "pigment_to_panel.md"}
PREPARED: dict[str, Callable[[Path], None]] = {"sweeps.md": smaller_sweep, "exports.md": table_for_mitsuba}


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(
            page, id=page.name, marks=pytest.mark.slow if page.name in SLOW or page.parent.name == "tutorials" else ()
        )
        for page in PAGES
        if blocks(page, "python")
    ],
)
def test_the_python_of_a_page_runs(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(ROOT / "examples", "examples")
    PREPARED.get(page.name, lambda folder: None)(tmp_path)
    names: dict[str, Any] = {}
    runner = doctest.DocTestRunner(checker=Rough())
    for index, (code, printed) in enumerate(printing_snippets(page), 1):
        if code.startswith(">>>"):
            test = doctest.DocTestParser().get_doctest(code, names, f"{page.name}, {index}", str(page), 0)
            runner.run(test, clear_globs=False)
            names = test.globs
        else:
            with contextlib.redirect_stdout(io.StringIO()) as reported:
                exec(compile(code, f"{page.name}, {index}", "exec"), names)
            if printed or page.parent.name == "tutorials":
                assert Rough().check_output(printed, reported.getvalue(), 0), f"{index}: {reported.getvalue()}"
    assert runner.failures == 0
    if page.parent.name == "tutorials":
        for picture in re.findall(r"\]\(\.\./images/(\w+\.png)\)", page.read_text(encoding="utf-8")):
            assert (tmp_path / picture).stat().st_size > 10_000, picture


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_scene_files_of_a_page_are_read(page: Path, tmp_path: Path) -> None:
    for code in blocks(page, "toml"):
        path = tmp_path / "scene.toml"
        path.write_text(code)
        content = read_content(path)
        if "axes" in content:
            assert read_sweep(path).count > 1
            continue
        if "render" in content:
            read_setting([path])
        for kind in {"brdf", "field"} & set(content):
            assert read_scene(path, kind).scene.layers


@pytest.mark.parametrize("page", [page for page in PAGES if commands(page)], ids=lambda page: page.name)
def test_the_commands_of_a_page_have_these_options(page: Path) -> None:
    for line in commands(page):
        words = [word for word in shlex.split(line, comments=True)[1:] if word != "..."]
        options = make_parser().parse_args([word.replace("[", "").replace("]", "") for word in words])
        for word in words:
            if word.startswith(("examples/", "vrte/")):
                assert (ROOT / word).is_file(), line
        assert callable(options.run)
