"""Scattering matrices over angle: out and back, what is warned of; conventions of other codes."""

import pickle
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.optics.angle_tables import Expansion
from vrte.optics.convention_card import CARD_DEG, tabulate_card
from vrte.optics.conventions import CONVENTIONS, find_convention
from vrte.optics.phase_matrix import NegativeScatteringWarning, PhaseMatrix

from .helpers import assert_close, close_to
from .samples import slow_but, spheroids


def sphere_of_size(size: float, index: complex = 1.33) -> PhaseMatrix:
    return vrte.spheres(index, radius_um=size / (2.0 * np.pi), wavelength_um=1.0).phase_matrix


@cache
def dust() -> PhaseMatrix:
    """Of many sizes, smooth over angle."""
    return vrte.spheres(1.53 + 0.005j, size=vrte.Lognormal(0.2, 1.5), wavelength_um=0.55).phase_matrix


def pad(first: PhaseMatrix, second: PhaseMatrix) -> list[np.ndarray]:
    """The coefficients of both, the missing ones zero."""
    terms = max(first.terms, second.terms)
    return [np.pad(one.coefficients, ((0, terms - one.terms), (0, 0))) for one in (first, second)]


def back(table: Any, **options: Any) -> PhaseMatrix:
    return PhaseMatrix.from_angles(table.angle_deg, *table.elements, **options)


def report(matrix: PhaseMatrix) -> Expansion:
    assert matrix.expansion is not None
    return matrix.expansion


HG7 = vrte.henyey_greenstein(0.7)
NODES = np.degrees(np.arccos(np.polynomial.legendre.leggauss(60)[0]))[::-1]
EXACT: dict[
    str, Any
] = {  # a phase matrix, over which angles (by default as many as are exact), and how well it returns
    "isotropic": (vrte.isotropic, None, 1e-11),
    "depolarizing": (lambda: vrte.rayleigh(0.3), None, 1e-11),
    **{f"peak {g}": (lambda g=g: vrte.henyey_greenstein(g), None, 1e-11) for g in (-0.5, 0.0, 0.85)},
    "sphere": (lambda: sphere_of_size(5.0, 1.5 + 0.01j), None, 1e-11),
    "spheroids": (spheroids, None, 1e-11),
    "mixture": (lambda: vrte.mix([(dust(), 0.3), (vrte.rayleigh(0.1), 0.5), (HG7, 0.2)]), None, 1e-11),
    "gauss": (lambda: sphere_of_size(8.0), NODES, 1e-11),
    "middles": (lambda: sphere_of_size(8.0), 3.0 * (np.arange(60) + 0.5), 1e-11),
    "peak 0.98": (lambda: vrte.henyey_greenstein(0.98), None, 1e-10),
    "large sphere": (lambda: sphere_of_size(300.0), None, 1e-10),
}


@pytest.mark.parametrize("name", slow_but(EXACT, *(set(EXACT) - {"peak 0.98", "large sphere"})))
def test_phase_matrices_go_out_and_come_back(name: str) -> None:
    make, angles, within = EXACT[name]
    matrix = make()
    again = back(matrix.to_angles(angles))
    assert_close(*pad(matrix, again), rtol=0.0, atol=within)
    assert report(again).way.startswith("exact quadrature")
    assert abs(report(again).integral - 1.0) <= 1e-12


def test_exactness_is_measured_and_not_taken_for_granted() -> None:
    """Just enough even steps are exact; those that a sphere's spectrum exceeds are interpolated like any others."""
    matrix = sphere_of_size(300.0)
    again = back(matrix.to_angles(np.linspace(0.0, 180.0, 901)), accuracy=1e-6)
    assert abs(again.asymmetry - matrix.asymmetry) <= 1e-10
    assert report(again).largest_error <= 1e-6
    assert again.terms < matrix.terms
    enough = sphere_of_size(40.0).to_angles(np.linspace(0.0, 180.0, 141))
    assert report(back(enough)).way.startswith("exact quadrature")


def test_errors_and_terms_are_those_of_the_elements_themselves() -> None:
    matrix = sphere_of_size(6.0)
    table = matrix.to_angles(np.linspace(0.0, 180.0, 61))
    with pytest.warns(NegativeScatteringWarning, match="taken, as its expansion is off by"):
        cut = back(table, accuracy=1e-3)
    off = np.abs(cut.to_angles(table.angle_deg).elements - table.elements).max(axis=0) / np.maximum(table.F11, 1e-3)
    assert_close(report(cut).error, off, rtol=1e-6, atol=1e-13)
    assert 1e-5 < report(cut).largest_error == report(cut).error.max() <= 1e-3
    table = HG7.to_angles()
    terms = [PhaseMatrix.from_angles(table.angle_deg, table.F11, accuracy=1e-2 ** (1 + n)).terms for n in range(3)]
    assert terms[0] < terms[1] < terms[2]


@pytest.mark.parametrize(("step", "within"), [(1.0, 3e-4), (2.0, 3e-4), (5.0, 5e-3)])
def test_uneven_angles_are_interpolated(step: float, within: float) -> None:
    angles = np.unique(np.concatenate([[0.0, 180.0], np.arange(step / 3.0, 180.0, step)]))
    again, fine = back(dust().to_angles(angles)), np.linspace(0.0, 180.0, 721)
    assert report(again).way == f"a spline over {angles.size} angles"
    assert_close(again.to_angles(fine).F11 / dust().to_angles(fine).F11, 1.0, rtol=0.0, atol=within)
    assert abs(again.asymmetry - dust().asymmetry) <= 1e-4


def test_splines_follow_closed_forms_and_stay_physical_between_angles() -> None:
    """Pure matrices, interpolated, would polarize by more than all; an accuracy lets through as much as it says."""
    angles, g = np.unique(np.concatenate([np.geomspace(0.1, 10.0, 60), np.arange(11.0, 181.0, 1.0), [0.0]])), 0.9
    f11 = (1.0 - g**2) / (1.0 + g**2 - 2.0 * g * np.cos(np.radians(angles))) ** 1.5
    again = PhaseMatrix.from_angles(angles, f11)
    assert again.is_scalar
    assert abs(again.asymmetry - g) <= 1e-6
    matrix = sphere_of_size(12.0, 1.5)
    angles = np.unique(np.concatenate([[0.0, 180.0], np.arange(0.25, 180.0, 0.5)]))
    assert abs(back(matrix.to_angles(angles)).asymmetry - matrix.asymmetry) <= 1e-6
    with pytest.warns(NegativeScatteringWarning, match="taken, as its expansion is off by"):
        coarse = back(matrix.to_angles(angles), accuracy=1e-3)
    assert 0.0 < coarse.tolerance < 1e-3
    with pytest.warns(NegativeScatteringWarning, match="taken, as tolerance"):
        vrte.mix([(coarse, 1.0)])


def test_a_peak_that_the_steps_miss_is_refused_with_the_integral_found_or_warned_of() -> None:
    table = sphere_of_size(300.0).to_angles(np.arange(0.0, 181.0))
    with pytest.raises(
        vrte.SceneError, match=r"F11 has a mean over the sphere of 1\.25\d* .*normalise=True"
    ) as refused:
        back(table)
    assert refused.value.place == ("F11",)
    sharp = vrte.henyey_greenstein(0.97).to_angles(np.arange(0.0, 181.0, 6.0))
    with pytest.warns(vrte.AccuracyWarning, match="steps of a table over angle are coarse: without every other angle"):
        again = back(sharp, normalise=True, accuracy=1e-2)
    assert again.a1[0] == 1.0
    assert report(again).integral != close_to(1.0, rtol=0.0, atol=0.01)


def test_normalise_divides_by_what_is_found() -> None:
    table = dust().to_angles()
    again = PhaseMatrix.from_angles(table.angle_deg, *(3.0 * table.elements), normalise=True)
    assert_close(*pad(again, dust()), rtol=0.0, atol=1e-11)
    within = PhaseMatrix.from_angles(table.angle_deg, *(1.04 * table.elements))
    assert_close([report(again).integral, report(within).integral], [3.0, 1.04], rtol=1e-12, atol=0.0)


def test_ends_are_extrapolated_where_that_is_asked_for() -> None:
    again = back(dust().to_angles(np.arange(3.0, 175.0, 1.0)), ends="extrapolate")
    assert report(again).way.endswith("extrapolated short of 3 degrees and beyond of 174 degrees")
    assert again.asymmetry == close_to(dust().asymmetry, rtol=0.0, atol=2e-3)
    assert report(again).table.angle_deg[0] == 3.0
    forward, backward = again.scattering_matrix([0.0, 180.0])
    assert forward[0, 0] == close_to(dust().scattering_matrix(0.0)[0, 0], rtol=0.05, atol=0.0)
    assert_close([forward[1, 1], backward[1, 1]], [forward[2, 2], -backward[2, 2]], rtol=1e-3, atol=0.0)


def test_what_spheres_leave_out_is_filled_in_where_asked_for_and_signs_are_no_matter_of_physics() -> None:
    table = dust().to_angles()
    given = {"F12": table.F12, "F33": table.F33, "F34": table.F34}
    filled = PhaseMatrix.from_angles(table.angle_deg, table.F11, **given, spheres=True)
    assert_close(*pad(filled, dust()), rtol=0.0, atol=1e-11)
    assert PhaseMatrix.from_angles(table.angle_deg, table.F11).is_scalar
    table = vrte.rayleigh().to_angles(np.arange(0.0, 181.0, 5.0))
    flipped = PhaseMatrix.from_angles(table.angle_deg, table.F11, -table.F12, *table.elements[2:])
    assert flipped.b1[2] == close_to(-np.sqrt(1.5), rtol=1e-6, atol=0.0)  # the card is for that


def test_a_little_noise_is_taken_and_told() -> None:
    noisy = vrte.rayleigh().to_angles(np.arange(0.0, 181.0, 5.0))
    columns = noisy.elements * np.array([1.0, 1.002, 1.0, 1.0, 1.0, 1.0])[:, None]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NegativeScatteringWarning)
        again = PhaseMatrix.from_angles(noisy.angle_deg, *columns, tolerance=0.01)
    assert report(again).lowest_eigenvalue == close_to(-0.001, rtol=0.05, atol=0.0)
    assert report(again).lowest_angle_deg == 90.0
    with pytest.raises(vrte.SceneError, match="the table is not physical: at 90 degrees"):
        PhaseMatrix.from_angles(noisy.angle_deg, *columns)


def test_the_report_survives_pickling_and_its_picture_has_the_table_and_the_error_below() -> None:
    again = back(vrte.rayleigh().to_angles())
    copied = pickle.loads(pickle.dumps(again))
    assert copied.coefficients.tobytes() == again.coefficients.tobytes()
    assert (report(copied).way, report(copied).error.tobytes()) == (report(again).way, report(again).error.tobytes())
    assert vrte.mix([(again, 1.0)]).expansion is None
    plain, over = vrte.rayleigh().plot(), again.plot()
    assert [len(figure.axes) for figure in (plain, over)] == [2, 3]
    assert len(over.axes[0].lines) == len(plain.axes[0].lines) + 1
    assert len(over.axes[1].lines) == 2 * len(plain.axes[1].lines)


def test_angles_anywhere_are_those_of_the_scattering_matrix() -> None:
    angles = [170.0, -30.0, 0.0, 400.0, 90.0]
    table, full = dust().to_angles(angles), dust().scattering_matrix(angles)
    assert_close([table.F34, table.F12], [full[:, 2, 3], full[:, 1, 0]], rtol=0.0, atol=1e-13)
    assert_close(table.elements[[0, 2, 3, 5]].T, np.diagonal(full, axis1=1, axis2=2), rtol=1e-11, atol=0.0)


@pytest.mark.parametrize("name", CONVENTIONS)
def test_a_convention_is_recognised_by_four_digits(name: str) -> None:
    """That it reads back: test_scattering_tables.py."""
    card = np.array([[float(f"{value:.4g}") for value in row] for row in tabulate_card(find_convention(name))])
    assert vrte.recognise_convention(CARD_DEG, *card) == (name,)
    spheres_only = (card[0], card[1], card[2] if name == "chandrasekhar" else None, card[3], card[4])
    assert vrte.recognise_convention(CARD_DEG, *spheres_only) == (name,)


def test_what_tells_nothing_apart_is_several_names_and_what_fits_none_says_the_nearest() -> None:
    card = tabulate_card(CONVENTIONS["vrte"])
    names = vrte.recognise_convention(CARD_DEG, card[0])
    assert {"vrte", "granada-synthetic", "ice", "perpendicular"} <= set(names)
    assert "miepython" not in names
    with pytest.raises(vrte.SceneError, match=r'no known convention: "vrte" is nearest, and its F34 is off by 0\.1'):
        vrte.recognise_convention(CARD_DEG, *(card * np.array([1, 1, 1, 1, 0.7, 1])[:, None]))
    with pytest.raises(vrte.SceneError, match="up to a constant factor it is miepython or miev0"):
        vrte.recognise_convention(CARD_DEG, *(7.7 * tabulate_card(CONVENTIONS["miev0"])))


def test_amplitudes_of_miev0_have_the_sign_that_the_card_says(reference: Callable[[str], Path]) -> None:
    """Published S1, S2 of fields exp(+i omega t): by Bohren and Huffman's formulas F34 turns over."""
    table = np.genfromtxt(reference("mie/miev0_S1S2_x1_m1.5-1i.csv"), delimiter=",", names=True)
    s1, s2 = table["ReS1"] + 1j * table["ImS1"], table["ReS2"] + 1j * table["ImS2"]
    f11, f34 = 0.5 * (abs(s1) ** 2 + abs(s2) ** 2), (s2 * s1.conj()).imag
    ours = sphere_of_size(1.0, 1.5 + 1.0j).to_angles(table["theta_deg"])
    assert_close(CONVENTIONS["miev0"].circular * f34 / f11, ours.F34 / ours.F11, rtol=0.0, atol=2e-5)
    assert np.abs(f34 / f11).max() > 0.1
