"""The documents must not lag behind the code."""

import doctest
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ROWS = re.findall(r"^\| ([^|]+?) \| (vrte/\S+?):(\w+) \|", (ROOT / "docs" / "equations.md").read_text(), re.MULTILINE)


def test_the_table_is_read() -> None:
    assert len(ROWS) >= 28


@pytest.mark.parametrize(("equation", "file", "name"), ROWS)
def test_every_equation_has_its_function(equation: str, file: str, name: str) -> None:
    source = (ROOT / file).read_text()
    assert re.search(rf"^(def|cdef|cpdef)\b[^(\n]*\b{name}\(", source, re.MULTILINE), f"{equation}: no {name} in {file}"


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


@pytest.mark.parametrize("page", sorted(path.relative_to(ROOT) for path in (ROOT / "docs").rglob("*.md")), ids=str)
def test_pages_link_to_what_exists(page: Path) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#\s:]+)\)", text):
        assert ((ROOT / page).parent / target).exists(), f"{page} links to {target}, which does not exist"


def test_every_statement_on_security_names_a_test_that_exists() -> None:
    statements = (ROOT / "docs" / "security.md").read_text().split("\n- ")[1:]
    assert len(statements) >= 6
    for statement in statements:
        tests = re.findall(r"`(tests/\w+\.py)::(\w+)`", statement)
        assert tests, f"no test is named for: {statement}"
        for file, name in tests:
            assert f"def {name}(" in (ROOT / file).read_text(), f"{file} has no {name}"
