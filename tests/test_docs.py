"""The documents must not lag behind the code."""

import doctest
import re
from pathlib import Path

import pytest

from docs.scripts.kinds import write_page
from vrte.commands.reference import write_page as write_commands_page

ROOT = Path(__file__).parents[1]
EQUATIONS = (ROOT / "docs" / "reference" / "equations.md").read_text()
ROWS = re.findall(r"^\| ([^|]+?) \| (vrte/\S+?):(\w+) \|", EQUATIONS, re.MULTILINE)
SOURCES = {
    str(path.relative_to(ROOT)): path.read_text()
    for path in sorted((ROOT / "vrte").rglob("*"))
    if path.suffix in (".py", ".pyx", ".pxi", ".cl", ".h")
}


def cited(text: str) -> set[tuple[int, int]]:
    """Paper and number of the equations in a text, (1:6) or (1:6)-(1:8)."""
    found = re.findall(r"\((\d):(\d+)\)(?:-\(\1:(\d+)\))?", text)
    return {(int(paper), n) for paper, first, last in found for n in range(int(first), int(last or first) + 1)}


def function_of(text: str, name: str) -> str:
    """A function or class with the comments and decorators right above it; "" where there is none."""
    lines = text.splitlines()
    head = re.compile(rf"( *)(?:def|cdef|cpdef|class)\b[^(\n]*\b{name}[(:]")
    start = next((place for place, line in enumerate(lines) if head.match(line)), None)
    if start is None:
        return ""
    indent = len(lines[start]) - len(lines[start].lstrip())
    inside = re.compile(rf"\s*$| {{{indent + 1},}}|\s*\)")
    last = next((place for place in range(start + 1, len(lines)) if not inside.match(lines[place])), len(lines))
    while start > 0 and lines[start - 1].lstrip().startswith(("#", "@")):
        start -= 1
    return "\n".join(lines[start:last])


def faults_of_the_map(equations: str, sources: dict[str, str]) -> list[str]:
    """Functions that are not there, that do not cite what the map says, and citations that the map does not have."""
    found = []
    rows = re.findall(r"^\| ([^|]+?) \| (vrte/\S+?):(\w+) \|", equations, re.MULTILINE)
    for equation, file, name in rows:
        text = function_of(sources.get(file, ""), name)
        if not text:
            found.append(f"{equation}: no {name} in {file}")
        elif cited(equation) - cited(text):
            found.append(f"{equation}: {name} in {file} does not cite {sorted(cited(equation) - cited(text))}")
    mapped = set().union(*(cited(equation) for equation, _, _ in rows))
    found += [
        f"{file} cites {sorted(extra)}, which the map does not have"
        for file, text in sources.items()
        if (extra := cited(text) - mapped)
    ]
    return found


def test_every_equation_has_its_function_which_cites_it_and_what_is_cited_has_its_place() -> None:
    assert len(ROWS) >= 40
    assert len(set().union(*(cited(equation) for equation, _, _ in ROWS))) >= 85  # of 66 and 29
    assert faults_of_the_map(EQUATIONS, SOURCES) == []


@pytest.mark.parametrize(("equation", "file", "name"), [row for row in ROWS if cited(row[0])])
def test_a_citation_or_a_function_that_goes_is_missed(equation: str, file: str, name: str) -> None:
    """The map against sources spoilt on purpose: the test above can fail, for each of its rows."""
    text = function_of(SOURCES[file], name)
    silent = re.sub(r"\(\d:\d+\)", "", text)
    complaint = f"{equation}: {name} in {file} does not cite"
    assert any(
        complaint in fault for fault in faults_of_the_map(EQUATIONS, {file: SOURCES[file].replace(text, silent)})
    )
    renamed = {file: re.sub(rf"\b{name}\b", f"{name}_", SOURCES[file])}
    assert f"{equation}: no {name} in {file}" in faults_of_the_map(EQUATIONS, renamed)


def test_a_citation_without_a_place_is_told() -> None:
    assert "vrte/new.py cites [(1, 3), (2, 30)], which the map does not have" in faults_of_the_map(
        EQUATIONS, {**SOURCES, "vrte/new.py": '"""As in (1:3), (1:35) and (2:29)-(2:30)."""'}
    )
    fewer = EQUATIONS.replace("| (1:15) |", "| |")
    assert any(
        fault.endswith("cites [(1, 15)], which the map does not have") for fault in faults_of_the_map(fewer, SOURCES)
    )


def test_examples_of_the_compiled_module() -> None:
    from vrte import _core

    runner, finder = doctest.DocTestRunner(), doctest.DocTestFinder(recurse=False)
    for function in (_core.generalized_spherical_functions, _core.phase_matrices):
        for example in finder.find(function, globs=vars(_core).copy()):
            runner.run(example)
    assert runner.tries >= 2
    assert runner.failures == 0


def test_conventions_and_readme_name_what_exists() -> None:
    import vrte

    text = (ROOT / "README.md").read_text()
    for name in set(re.findall(r"\bvrte\.([A-Za-z_]+)\(", text)):
        assert hasattr(vrte, name), f"README calls vrte.{name}, which does not exist"


MADE = {"try/lobes.html"}  # with the site, by docs/hooks.py, whose own check of links knows it


@pytest.mark.parametrize("page", sorted(path.relative_to(ROOT) for path in (ROOT / "docs").rglob("*.md")), ids=str)
def test_pages_link_to_what_exists(page: Path) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    for target in set(re.findall(r"\]\(([^)#\s:]+)\)", text)) - MADE:
        assert ((ROOT / page).parent / target).exists(), f"{page} links to {target}, which does not exist"
    for folder in re.findall(r"^(?:vrte|make) .* -o (docs/[\w/]+)", text, re.MULTILINE):
        assert (ROOT / folder).is_dir(), f"{page} writes to {folder}, which does not exist"


def test_every_statement_on_security_names_a_test_that_exists() -> None:
    statements = (ROOT / "docs" / "reference" / "security.md").read_text().split("\n- ")[1:]
    assert len(statements) >= 6
    for statement in statements:
        tests = re.findall(r"`(tests/\w+\.py)::(\w+)`", statement)
        assert tests, f"no test is named for: {statement}"
        for file, name in tests:
            assert f"def {name}(" in (ROOT / file).read_text(), f"{file} has no {name}"


def test_the_page_of_kinds_is_what_the_registries_say() -> None:
    page = (ROOT / "docs" / "reference" / "kinds.md").read_text()
    assert page == write_page(), "make it anew: python -m docs.scripts.kinds > docs/reference/kinds.md"


def test_the_page_of_commands_is_what_their_parsers_say() -> None:
    page = (ROOT / "docs" / "reference" / "commands.md").read_text()
    assert page == write_commands_page(), "make it anew: python -m vrte.commands.reference > docs/reference/commands.md"
