"""The page of validation names a test for each of its rows, and the test is there."""

import re
from pathlib import Path

import pytest

import vrte
from tests import exact

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "reference" / "validation.md").read_text(encoding="utf-8")
ROWS = [line.strip("|").split("|") for line in PAGE.splitlines() if line.startswith("|")][2:]


def test_the_table_is_read() -> None:
    assert len(ROWS) >= 18
    assert {len(row) for row in ROWS} == {5}


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
