"""Words: the terms are the field's."""

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
