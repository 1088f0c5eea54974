"""The documents do not lag behind the code: equations, links, named tests, generated pages, metadata, notebooks."""

import doctest
import json
import os
import re
import runpy
import subprocess
import sys
import tomllib
from contextlib import nullcontext
from pathlib import Path

import pytest
import yaml

import vrte
from docs.scripts.commands import write_page as write_commands_page
from docs.scripts.kinds import write_page
from tests import exact
from vrte import _core
from vrte.basics.llvm import OLDEST, prepare_llvm

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.py"))
CHANGELOG = (ROOT / "CHANGELOG.md").read_text()
EQUATIONS, VALIDATION, SECURITY = (
    (DOCS / "reference" / f"{name}.md").read_text("utf-8") for name in ("equations", "validation", "security")
)
ROWS = re.findall(r"^\| ([^|]+?) \| (vrte/\S+?):(\w+) \|", EQUATIONS, re.MULTILINE)
CODE = re.compile(r"^```.*?^```|`[^`\n]*`", re.M | re.S)
FORMULA = re.compile(r"\$\$(.+?)\$\$|(?<![\w$])\$(?! )([^$\n]+?)(?<! )\$(?![\w$])", re.S)
MADE = {"try/lobes.html"}  # with the site, by docs/hooks.py, whose own check of links knows it


def cited(text: str) -> set[tuple[int, int]]:
    """Paper and number of the equations in a text, (1:6) or (1:6)-(1:8)."""
    found = re.findall(r"\((\d):(\d+)\)(?:-\(\1:(\d+)\))?", text)
    return {(int(paper), n) for paper, first, last in found for n in range(int(first), int(last or first) + 1)}


def function_of(text: str, name: str) -> str:
    """A function, class or list of operations with comments and decorators right above it; "" where there is none."""
    lines = text.splitlines()
    head = re.compile(rf"( *)(?:def|cdef|cpdef|class|VRTE_LIST|VRTE_SHARED)\b[^(\n]*\b{name}[(:[]")
    start = next((index for index, line in enumerate(lines) if head.match(line)), None)
    if start is None:
        return ""
    indent = len(lines[start]) - len(lines[start].lstrip())
    inside = re.compile(rf"\s*$| {{{indent + 1},}}|\s*\)")
    last = next((index for index in range(start + 1, len(lines)) if not inside.match(lines[index])), len(lines))
    while start > 0 and lines[start - 1].lstrip().startswith(("#", "@")):
        start -= 1
    return "\n".join(lines[start:last])


def test_every_equation_has_its_function_which_cites_it_and_what_is_cited_is_in_the_map() -> None:
    assert len(ROWS) >= 40
    mapped = set().union(*(cited(equation) for equation, _, _ in ROWS))
    assert len(mapped) >= 85  # of 66 and 29
    for equation, file, name in ROWS:
        text = function_of((ROOT / file).read_text(), name)
        assert text, f"{equation}: no {name} in {file}"
        assert cited(equation) <= cited(text), f"{equation}: {name} in {file} does not cite it"
    for path in (path for path in (ROOT / "vrte").rglob("*") if path.suffix in (".py", ".pyx", ".pxi", ".cl", ".h")):
        assert cited(path.read_text()) <= mapped, f"{path.name} cites what the map does not have"
    assert len(cited((DOCS / "explanation" / "theory.md").read_text("utf-8")) & mapped) > 45
    assert cited((DOCS / "explanation" / "theory.md").read_text("utf-8")) <= mapped


def test_examples_of_the_compiled_module() -> None:
    runner, finder = doctest.DocTestRunner(), doctest.DocTestFinder(recurse=False)
    for function in (_core.generalized_spherical_functions, _core.phase_matrices):
        for example in finder.find(function, globs=vars(_core).copy()):
            runner.run(example)
    assert runner.tries >= 2
    assert runner.failures == 0


def test_pages_link_to_what_exists_and_have_a_place_in_the_contents() -> None:
    for page in PAGES:
        text = page.read_text("utf-8")
        for target in set(re.findall(r"\]\(([^)#\s:]+)\)", text)) - MADE:
            assert (page.parent / target).exists(), f"{page} links to {target}, which does not exist"
        for folder in re.findall(r"^(?:vrte|make) .* -o (docs/[\w/]+)", text, re.MULTILINE):
            assert (ROOT / folder).is_dir(), f"{page} writes to {folder}, which does not exist"
    for name in set(re.findall(r"\bvrte\.([A-Za-z_]+)\(", (ROOT / "README.md").read_text())):
        assert hasattr(vrte, name), f"README calls vrte.{name}, which does not exist"
    named = set(re.findall(r"[\w/]+\.md", (ROOT / "mkdocs.yml").read_text().split("\nnav:\n")[1]))
    by_hooks = {"index.md", "changelog.md", "contributing.md", "examples.md"}
    notebooks = {f"notebooks/{path.stem}.md" for path in NOTEBOOKS}
    assert named == {str(path.relative_to(DOCS)) for path in PAGES} | notebooks | by_hooks


def test_pages_name_tests_that_exist() -> None:
    """Each statement on security and each row of the page of validation."""
    rows = [line.strip("|").split("|")[-1] for line in VALIDATION.splitlines() if line.startswith("|")][2:]
    statements = SECURITY.split("\n- ")[1:]
    assert len(statements) >= 6
    assert len(rows) >= 18
    for statement in statements + rows:
        tests = re.findall(r"`(tests/\w+\.py)::(\w+)`", statement)
        assert tests, f"no test is named for: {statement}"
        for file, name in tests:
            assert f"def {name}(" in (ROOT / file).read_text("utf-8"), f"{file} has no {name}"


def test_generated_pages_are_what_registries_and_parsers_say() -> None:
    for name, page, command in (
        ("kinds", write_page(), "docs.scripts.kinds"),
        ("commands", write_commands_page(), "docs.scripts.commands"),
    ):
        path = DOCS / "reference" / f"{name}.md"
        assert path.read_text() == page, f"make it anew: python -m {command} > docs/reference/{name}.md"


def test_every_formula_becomes_mathml() -> None:
    converter = pytest.importorskip("latex2mathml.converter", reason="the extra docs is not installed")
    found = {page: FORMULA.findall(CODE.sub("", page.read_text("utf-8"))) for page in PAGES}
    assert len(found[DOCS / "explanation" / "theory.md"]) > 150
    for page, each in found.items():
        for display, inline in each:
            mathml = converter.convert((display or inline).strip())
            assert "\\" not in mathml, f"{page.name}: {display or inline}"  # a command that the converter does not know


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ('<a href="b.html#here">there</a><a href="https://example.org/x">not asked</a>', ""),
        ('<a href="nothing.html">x</a>', "a.html -> nothing.html"),
        ('<a href="b.html#nowhere">x</a>', "a.html -> b.html#nowhere"),
        ('<img src="d.png">', "a.html -> d.png"),
        ('<script src="https://example.org/x.js"></script>', "a.html fetches https://example.org/x.js from elsewhere"),
    ],
)
def test_links_of_the_site_that_lead_nowhere_are_found(line: str, fault: str, tmp_path: Path) -> None:
    pytest.importorskip("mkdocs", reason="the extra docs is not installed")
    hooks = runpy.run_path(str(DOCS / "hooks.py"))
    (tmp_path / "a.html").write_text(f"<html><body>{line}</body></html>")
    (tmp_path / "b.html").write_text('<html><body><h2 id="here">x</h2></body></html>')
    config = type("Config", (), {"site_dir": str(tmp_path)})()
    with pytest.raises(hooks["PluginError"], match=re.escape(fault)) if fault else nullcontext():
        hooks["on_post_build"](config)


def test_metadata_and_changelog_agree() -> None:
    """The version comes from a tag, which no file knows beforehand: the files name the release that is meant."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    project, codemeta = settings["project"], json.loads((ROOT / "codemeta.json").read_text())
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    headings = re.findall(r"^## .*$", CHANGELOG, re.MULTILINE)
    assert headings[0] == "## [Unreleased]"
    dated = [re.fullmatch(r"## \[(\d+\.\d+\.\d+)\] - (\d{4}-\d\d-\d\d)", heading) for heading in headings[1:]]
    version, date = dated[0].groups()  # type: ignore[union-attr]
    assert all(dated)
    assert citation["title"] == codemeta["name"] == project["name"]
    assert citation["abstract"] == codemeta["description"] == project["description"]
    assert citation["keywords"] == codemeta["keywords"] == project["keywords"]
    assert citation["license"] == project["license"] == codemeta["license"].rpartition("/")[2]
    assert citation["version"] == codemeta["version"] == version
    assert citation["date-released"] == codemeta["dateModified"] == date
    assert settings["tool"]["setuptools_scm"]["fallback_version"] == f"{version}.dev0"
    for entry in re.findall(r"^- .*(?:\n  .*)*", CHANGELOG, re.MULTILINE):
        assert len(entry.splitlines()) <= 2, entry
        assert entry.endswith("."), entry


@pytest.mark.slow
def test_both_algorithms_agree_on_gold() -> None:
    gold = vrte.spheres("gold", radius_um=0.6, wavelength_um=0.64)
    scene = vrte.Scene([vrte.Layer.of(gold, thickness=100.0)])
    agreement = exact.radiance(scene, 0.6, nodes=40, verify=True).diagnostics["agreement"]
    assert 0.0 < agreement["radiance"] < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_its_findings_hold(path: Path, tmp_path: Path) -> None:
    """As a script, in an empty home, with every warning of vrte an error; its page lists it with its picture."""
    page = (DOCS / "notebooks" / "index.md").read_text("utf-8")
    assert f"]({path.name})" in page
    assert f"../images/notebooks/{path.stem}.png" in page
    if path.stem == "mitsuba_renderer":
        pytest.importorskip("mitsuba")
        if not prepare_llvm():
            pytest.skip(f"no LLVM of version {OLDEST} or newer")
    environment = {**os.environ, "MPLBACKEND": "Agg", "HOME": str(tmp_path), "MPLCONFIGDIR": str(tmp_path)}
    environment["PYTHONPATH"] = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    start = (
        "import runpy, sys, warnings, vrte\n"
        "for kind in ('vrte', '__main__', '<run_path>'): warnings.filterwarnings('error', module=kind)\n"
        "runpy.run_path(sys.argv[1])\n"
    )
    command = [sys.executable, "-c", start, str(path)]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    assert "Warning" not in done.stderr
    assert done.stdout.strip()
