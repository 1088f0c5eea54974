"""The paper cites what its bibliography has; the page of validation names tests that are there; formulas can be
typeset, and the equations that they are said to be are in the map."""

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

import vrte
from tests import exact
from tests.test_docs import EQUATIONS, cited

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
TEXT, BIBLIOGRAPHY = ((ROOT / "paper" / name).read_text() for name in ("paper.md", "paper.bib"))
BODY = TEXT.partition("# Summary")[2].rpartition("# References")[0]
THEORY = (DOCS / "explanation" / "theory.md").read_text(encoding="utf-8")
VALIDATION = (DOCS / "reference" / "validation.md").read_text(encoding="utf-8")
ROWS = [line.strip("|").split("|") for line in VALIDATION.splitlines() if line.startswith("|")][2:]
CODE = re.compile(r"^```.*?^```|`[^`\n]*`", re.M | re.S)
FORMULA = re.compile(r"\$\$(.+?)\$\$|(?<![\w$])\$(?! )([^$\n]+?)(?<! )\$(?![\w$])", re.S)


def test_every_citation_is_in_the_bibliography_and_back() -> None:
    cited = set(re.findall(r"@([A-Za-z]+\d{4})", BODY))
    known = re.findall(r"^@\w+\{(\w+),$", BIBLIOGRAPHY, re.MULTILINE)
    assert cited == set(known)
    assert len(known) == len(set(known))


def test_every_reference_says_what_it_is_and_where() -> None:
    for entry in BIBLIOGRAPHY.split("\n@")[1:]:
        fields = dict(re.findall(r"^  (\w+) = \{(.*)\},?$", entry, re.MULTILINE))
        assert {"author", "title", "year"} <= set(fields), entry
        assert {"doi", "url", "note", "pages"} & set(fields), entry
        assert fields["year"] in entry.partition(",")[0]
        assert re.fullmatch(r"10\.\d{4,5}/\S+", fields.get("doi", "10.1000/none"))


def test_the_figure_has_the_runs_that_are_kept() -> None:
    """Its caption speaks of rutile, of one thread and of sasktran2."""
    script = runpy.run_path(str(ROOT / "paper" / "figure.py"))
    runs = script["read_runs"]()
    assert all(len(rows) >= 4 for rows in runs.values()), runs.keys()
    assert min(row.worst for row in runs["auto"]) < 1e-10
    assert (ROOT / "paper" / "figure.png").stat().st_size > 50_000


@pytest.mark.slow
def test_the_surface_decides_about_the_polarization_of_a_paint() -> None:
    script = runpy.run_path(str(ROOT / "paper" / "figure.py"))
    with pytest.warns(vrte.IndependentScatteringWarning):
        bare, rough, smooth = (script["find_polarization"](surface) for surface in ("none", "rough", "smooth"))
    mirrored = np.argmin(abs(script["SEEN"] - script["ANGLE_I"]))
    assert bare.max() < 10.0
    assert smooth.max() > 30.0
    assert rough[mirrored] > 5.0 * smooth[mirrored] > 5.0 * bare[mirrored]


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


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row[0].strip()} {row[1].strip()}"[:40])
def test_every_row_names_tests_that_are_there(row: list[str]) -> None:
    named = re.findall(r"`(tests/\w+\.py)::(\w+)`", row[-1])
    assert named
    for file, name in named:
        assert f"\ndef {name}(" in (ROOT / file).read_text(encoding="utf-8"), f"{file} has no {name}"


@pytest.mark.slow
def test_both_algorithms_agree_on_gold() -> None:
    gold = vrte.spheres("gold", radius_um=0.6, wavelength_um=0.64)
    scene = vrte.Scene([vrte.Layer.of(gold, thickness=100.0)])
    agreement = exact.radiance(scene, 0.6, nodes=40, verify=True).diagnostics["agreement"]
    assert 0.0 < agreement["radiance"] < 1e-12
