"""From measurements back to materials (docs/scripts/inversion.py): error bars that cover, slabs beside iadpython, what
polarization tells of a haze, and the paint that hides at least cost."""

import math
import warnings
from pathlib import Path

import numpy as np
import pytest

from docs.scripts import inversion
from vrte.basics.errors import IndistinguishableWarning
from vrte.fit import fit
from vrte.fit.files import read_fit

from .helpers import assert_close

EXAMPLES = Path(__file__).parents[1] / "examples"


def test_a_slab_between_surfaces_comes_back() -> None:
    right, found = inversion.fit_slab((0.9, 1.0, 0.5, 1.4), nodes=4)
    assert 0.7 < right.sum() < 1.0
    assert_close(found, [0.9, 1.0], rtol=1e-6, atol=0.0)


@pytest.mark.slow
def test_error_bars_of_the_paint_cover_the_truth() -> None:
    """Right errors hold fewer than 8 of 12 runs less than once in 1000 times; the spread of the deviations, in errors,
    sees errors that are half or twice as large as they should be."""
    runs, least = 12, 8
    assert sum(math.comb(runs, k) * 0.95**k * 0.05 ** (runs - k) for k in range(least)) < 1e-3
    found = inversion.count_coverage(runs, lambda told: None)
    assert (found.within >= least).all()
    assert found.within_jointly[1] >= least
    assert 0.55 < np.sqrt((found.deviations**2).mean()) < 1.6


@pytest.mark.slow
def test_polarization_of_a_thin_haze_tells_radius_and_index_but_not_how_much_of_it() -> None:
    two, four = (inversion.fit_haze(inversion.ALL_OF_AEROSOL[:count]) for count in (2, 4))
    assert (abs(two.values - [0.15, 1.45]) < 3.0 * two.errors).all()
    assert (two.errors < [0.002, 0.003]).all()
    assert not two.blind_spots
    assert (four.errors[:2] > 2.0 * two.errors).all()
    assert any("layer[1].thickness" in reported for reported in four.blind_spots)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "true"), [("fit_grey_paint", inversion.PAINT_TRUE.tolist()), ("fit_haze", [0.15, 1.45])]
)
def test_the_examples_find_what_made_their_data(name: str, true: list[float]) -> None:
    given = read_fit(EXAMPLES / f"{name}.toml")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", IndistinguishableWarning)
        found = fit(given.measurement, given.content, folder=given.folder, **given.asked)
    assert (abs(found.values - true) < 3.0 * found.errors).all()
    assert 0.2 < found.reduced_chi2 < 1.6
