"""Words: the terms are the field's, and first lines of docstrings say at once what something is to a physicist."""

import ast
import inspect
import re
from pathlib import Path

import pytest

import vrte

PACKAGE = Path(vrte.__file__).parent
MODULES = sorted(PACKAGE.rglob("*.py"))
ROOT = PACKAGE.parent
# what stands for a term of the field in some dialect: the field's own term is asked for
FORBIDDEN = re.compile(
    r"settles? not|does not settle|put_joint|join_below|gr[ea]y ground|white ground|\bbooked\b|what is told of",
    re.IGNORECASE,
)
TEXTS = sorted(
    path
    for folder, endings in {"vrte": (".py", ".pxi", ".pyx", ".cl", ".h", ".js"), "docs": (".md", ".py")}.items()
    for path in (ROOT / folder).rglob("*")
    if path.suffix in endings
)


def functions(path: Path) -> list[ast.FunctionDef]:
    return [node for node in ast.parse(path.read_text()).body if isinstance(node, ast.FunctionDef)]


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_the_words_are_the_fields(path: Path) -> None:
    lines = enumerate(path.read_text("utf-8").splitlines(), 1)
    assert not [f"{number}: {found[0]}" for number, line in lines if (found := FORBIDDEN.search(line))]


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_first_lines_are_no_riddles(path: Path) -> None:
    """Three words at least, and nothing that only points: what it takes, the same, as above."""
    for function in functions(path):
        if first := (ast.get_docstring(function) or "").partition("\n")[0]:
            assert len(first.split()) >= 3, f"{function.name}: {first}"


@pytest.mark.parametrize("name", [name for name in vrte.__all__ if inspect.isfunction(getattr(vrte, name))])
def test_public_calls_say_what_they_take_return_and_raise(name: str) -> None:
    """Numpydoc sections, every parameter among them, and an example."""
    call = getattr(vrte, name)
    reported = inspect.getdoc(call) or ""
    parameters = inspect.signature(call).parameters
    assert "\nReturns\n-------\n" in reported
    assert ">>> " in reported
    if parameters:
        assert "\nParameters\n----------\n" in reported
        _, _, listed = reported.partition("\nParameters\n----------\n")
        listed = listed.partition("\nReturns\n")[0]
        for parameter in parameters:
            assert any(
                parameter in line.partition(" : ")[0].replace("*", "").split(", ") for line in listed.splitlines()
            )
