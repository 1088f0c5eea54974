"""The paper cites what its bibliography has, says what the pages say, and is as long as the journal wants."""

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

import vrte

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "paper" / "paper.md").read_text()
BIBLIOGRAPHY = (ROOT / "paper" / "paper.bib").read_text()
BODY = TEXT.partition("# Summary")[2].rpartition("# References")[0]
PAGES = {
    "accuracy": "docs/explanation/accuracy/accuracy.md",
    "algorithms": "docs/explanation/accuracy.md",
    "crowding": "docs/how_to/particles.md",
    "opencl": "docs/how_to/opencl.md",
    "peers": "docs/reference/peers.md",
    "rough": "docs/how_to/rough_surfaces.md",
    "validation": "docs/reference/validation.md",
}
CLAIMS = [  # what the paper says, and where which words say it
    ("none of 136 requests was missed", "accuracy", "136 requests, 0 not kept"),
    ("errors were at\nleast 2.2 times smaller", "accuracy", "requested over achieved: at least 2.2"),
    ("1.05 units of the sixth printed\ndigit", "validation", "1.05 units of the sixth digit"),
    ("to 2.9e-8", "validation", "Rayleigh, omega = 1, three bases, mu >= 0.1 | 2.9e-8"),
    ("to 5e-7 (haze: 5e-6)", "validation", "5e-7 (Mie), 5e-6 (haze L)"),
    ("@Mishchenko1999\nto 5e-7", "validation", "semi-infinite, omega = 1, 4x4 reflection | 5e-7"),
    ("@Chowdhary2020 to 3.3e-6", "rough", "3.3e-6 at most"),
    ("slabs of iadpython to 2e-8", "validation", "the two polarizations kept apart | 2e-8"),
    (
        "agrees to 1e-14 for thicknesses from 1e-6 to 1e6",
        "validation",
        "thickness 1e-6 to 1e6, omega = 1, mu from 1e-3 | 1e-14",
    ),
    ("Some 470 stiff and extreme\nscenes", "validation", "470 stiff and extreme scenes"),
    ("ten scenes under surfaces have ten digits", "validation", "ten scenes under smooth and rough surfaces"),
    ("0.4 of the time on 32 streams", "peers", "32 | nanodisort | 2.04 | 0.40"),
    ("2.2 times on 64", "peers", "64 | nanodisort | 17.69 | 2.20"),
    ("0.96\nand 4.4", "peers", "32 | nanodisort | 2.04 | 0.40 | 1.86 | 0.96"),
    ("0.96\nand 4.4", "peers", "64 | nanodisort | 17.69 | 2.20 | 17.37 | 4.42"),
    ("13 to 71 times as long", "peers", "60 | sasktran2 | 402.46 | 70.85"),
    ("told the number of orders 8 to 50", "peers", "60 | sasktran2, 12 orders | 286.24 | 50.39"),
    ("phase functions that make modes swing must be refused", "algorithms", "modes refuse it"),
    ("timed on processors only", "opencl", "No GPU was at hand"),
    (
        "with the lost energy given back",
        "rough",
        "and what they hide is given back: such a surface neither loses nor makes light",
    ),
    ("one of three models of crowding", "crowding", "coherent-potential"),
]


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


@pytest.mark.parametrize(("said", "page", "words"), CLAIMS, ids=[said.replace("\n", " ")[:40] for said, *_ in CLAIMS])
def test_what_it_says_stands_on_a_page(said: str, page: str, words: str) -> None:
    assert said in TEXT
    assert words in (ROOT / PAGES[page]).read_text()


def test_its_length_is_that_of_the_journal() -> None:
    assert 750 < len(BODY.split()) <= 1000
    sections = re.findall(r"^# (.*)$", TEXT, re.MULTILINE)
    assert sections == [
        *("Summary", "Statement of need", "State of the field", "What is new", "Validation", "Limits"),
        *("Acknowledgements", "References"),
    ]


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
