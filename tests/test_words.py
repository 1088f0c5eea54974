"""Words: the terms are the field's, and first lines of docstrings say at once what something is to a physicist."""

import ast
import re
from pathlib import Path

import vrte

PACKAGE = Path(vrte.__file__).parent
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


def test_the_words_are_the_fields() -> None:
    for path in TEXTS:
        lines = enumerate(path.read_text("utf-8").splitlines(), 1)
        found = [f"{path}:{number}: {found[0]}" for number, line in lines if (found := FORBIDDEN.search(line))]
        assert not found


def test_first_lines_are_no_riddles() -> None:
    """Three words at least, and nothing that only points: what it takes, the same, as above."""
    for path in sorted(PACKAGE.rglob("*.py")):
        for function in (node for node in ast.parse(path.read_text()).body if isinstance(node, ast.FunctionDef)):
            if first := (ast.get_docstring(function) or "").partition("\n")[0]:
                assert len(first.split()) >= 3, f"{path}: {function.name}: {first}"
