"""Formulas of the pages can all be typeset, and the papers' equations that they are said to be are in the map."""

import re
from pathlib import Path

import pytest

from tests.test_docs import EQUATIONS, cited

DOCS = Path(__file__).parents[1] / "docs"
THEORY = (DOCS / "explanation" / "theory.md").read_text(encoding="utf-8")
CODE = re.compile(r"^```.*?^```|`[^`\n]*`", re.M | re.S)
FORMULA = re.compile(r"\$\$(.+?)\$\$|(?<![\w$])\$(?! )([^$\n]+?)(?<! )\$(?![\w$])", re.S)


def formulas(page: Path) -> list[str]:
    text = CODE.sub("", page.read_text(encoding="utf-8"))
    return [display or inline for display, inline in FORMULA.findall(text)]


def test_every_formula_becomes_mathml() -> None:
    converter = pytest.importorskip("latex2mathml.converter", reason="the extra docs is not installed")
    found = {page: formulas(page) for page in sorted(DOCS.rglob("*.md"))}
    assert len(found[DOCS / "explanation" / "theory.md"]) > 150
    for page, each in found.items():
        for formula in each:
            mathml = converter.convert(formula.strip())
            assert "\\" not in mathml, f"{page.name}: {formula}"  # a command that the converter does not know stays


def test_equations_of_the_theory_are_those_of_the_map() -> None:
    assert len(cited(THEORY)) > 45
    assert cited(THEORY) <= cited(EQUATIONS)
