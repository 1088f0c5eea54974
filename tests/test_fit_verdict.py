"""Fits that do not fit say so: p-values, runs of residuals, guesses at units, and error bars that grow."""

import itertools
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.fit.verdict import UNLIKELY, count_runs, find_p_value

from .helpers import assert_close, close_to

SCENE = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.98, 1.5)], vrte.Lambertian(0.3))
FREE = {"layer[1].thickness": {"start": 1.0, "low": 0.1, "high": 10.0}}
DEGREES = np.linspace(-60.0, 60.0, 13)
ROWS = vrte.Measurement("reflectance_factor", 0.0, 0.002, theta_i_deg=35.0, theta_o_deg=DEGREES)
EXACT = ROWS.predict(SCENE, nodes=4)
MEASURED = ROWS.measure(EXACT + 0.002 * np.random.default_rng(5).standard_normal(13))


def fit(measured: vrte.Measurement, **more: Any) -> vrte.Fit:
    return vrte.fit(measured, SCENE, FREE, nodes=4, **more)


@pytest.mark.parametrize(("up", "down"), [(3, 4), (5, 2), (1, 6), (4, 4)])
def test_the_chance_of_runs_is_that_of_all_orders(up: int, down: int) -> None:
    orders = {*itertools.permutations([1] * up + [-1] * down)}
    runs = np.array([1 + sum(one != next_one for one, next_one in itertools.pairwise(order)) for order in orders])
    for order, count in zip(orders, runs, strict=True):
        assert count_runs(np.array(order)) == (count, close_to(np.mean(runs <= count), rtol=1e-12, atol=0.0))


def test_the_chance_of_runs_of_a_million_rows() -> None:
    assert count_runs(np.repeat([1, -1], 500_000)) == (2, close_to(0.0, rtol=0.0, atol=1e-300))
    assert count_runs(np.tile([1, -1], 500_000)) == (1_000_000, close_to(1.0, rtol=0.0, atol=1e-6))


def test_p_values_of_tables() -> None:
    """Chi-square at 5 and 1 per cent, as tables print them."""
    for freedom, five, one in ((1, 3.841, 6.635), (6, 12.592, 16.812), (30, 43.773, 50.892)):
        assert_close([find_p_value(five, freedom), find_p_value(one, freedom)], [0.05, 0.01], rtol=2e-3, atol=0.0)
    assert np.isnan(find_p_value(1.0, 0))


def test_a_fit_that_fits_is_told_nothing() -> None:
    found = fit(MEASURED)
    assert found.p_value == close_to(find_p_value(found.chi2, 12), rtol=1e-12, atol=0.0)
    assert found.p_value > UNLIKELY
    assert found.error_scale == 1.0
    assert found.notes == ()


@pytest.mark.parametrize(
    ("angles", "words"),
    [
        (lambda degrees: np.cos(np.radians(degrees)), "are 0.5 to 1: these look like cosines, and degrees are needed"),
        (np.radians, "are 0 to 1.0472: these look like radians, and degrees are needed"),
    ],
)
@pytest.mark.parametrize("sigma", [0.002, None])
def test_angles_in_other_units_are_guessed(angles: Any, words: str, sigma: float | None) -> None:
    wrong = replace(MEASURED, theta_i_deg=angles(35.0), theta_o_deg=angles(DEGREES), sigma=sigma)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        found = fit(wrong)
    assert any(words in note for note in found.notes)
    assert any(one.category is vrte.UnitsWarning and words in str(one.message) for one in told)
    assert any(one.category is vrte.MisfitWarning for one in told) or sigma is None


def test_per_cent_are_guessed_or_refused_as_such() -> None:
    with pytest.warns(vrte.UnitsWarning, match="this looks like per cent"), pytest.warns(vrte.MisfitWarning):
        vrte.fit(MEASURED.measure(100.0 * MEASURED.value, 0.2), SCENE, ["base.albedo"], nodes=4)
    with pytest.raises(vrte.SceneError, match=r"52 is above 1, .* by more than 5 sigma; it looks like per cent"):
        vrte.Measurement("total_reflectance", 52.0, 0.5, theta_i_deg=8.0)


def test_errors_grow_by_what_sigma_is_too_small(tmp_path: Path) -> None:
    """Errors, and the profile with them, are those of a sigma that chi2 agrees with; the best stays where it is."""
    honest = fit(MEASURED)
    with pytest.warns(vrte.MisfitWarning, match=r"by chance in .* of fits; errors are \S+ times larger for it"):
        found = fit(MEASURED.measure(MEASURED.value, 0.0002))
    assert found.error_scale == close_to(np.sqrt(found.reduced_chi2), rtol=1e-12, atol=0.0)
    assert found.error_scale == close_to(10.0 * np.sqrt(honest.reduced_chi2), rtol=1e-6, atol=0.0)
    assert_close(found.errors, honest.errors * np.sqrt(honest.reduced_chi2), rtol=1e-5, atol=0.0)
    assert_close(found.values, honest.values, rtol=1e-6, atol=0.0)
    profile = found.profile("layer[1].thickness", points=5)
    assert 0.5 * (profile.high - profile.low) == close_to(found.errors.item(), rtol=0.02, atol=0.0)
    found.save(tmp_path / "fit.json")
    assert str(vrte.Fit.load(tmp_path / "fit.json")) == str(found)


def test_a_wrong_model_is_known_by_its_runs_where_chi2_is_not() -> None:
    """An error of sigmas that bends over all angles, with sigma twice too large: chi2 passes, the order does not."""
    bent = EXACT * (1.0 + 0.02 * np.sin(np.radians(2.0 * DEGREES)))
    sigma = 1.2 * np.std(bent - EXACT)
    with pytest.warns(vrte.MisfitWarning, match=r"may not fit: residuals change sign rarely .* \(\d runs of one sign"):
        found = fit(ROWS.measure(bent, sigma))
    assert found.p_value > UNLIKELY
    assert found.error_scale == 1.0
    shuffled = np.random.default_rng(2).permutation(13)
    with pytest.warns(vrte.MisfitWarning, match="may not fit"):  # rows in any order
        fit(ROWS.measure(bent, sigma).pick(shuffled))
