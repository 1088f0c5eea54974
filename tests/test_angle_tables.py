"""Scattering matrices over angle: out and back, what is refused, what is told; conventions of other codes."""

import pickle
import re
import warnings
from functools import cache
from typing import Any

import numpy as np
import pytest

import vrte
from bench.cases import SPHEROIDS
from vrte.basics.errors import AccuracyWarning, SceneError
from vrte.optics.convention_card import CARD_DEG, make_reference_sphere, tabulate_card
from vrte.optics.conventions import CONVENTIONS, find_convention
from vrte.optics.phase_matrix import NegativeScatteringWarning, PhaseMatrix
from vrte.optics.table_interpolation import ElementSpline, follow_errors, integrate_exactly

from .helpers import assert_close, close_to


def sphere_of_size(size: float, index: complex = 1.33) -> PhaseMatrix:
    return vrte.spheres(index, radius_um=size / (2.0 * np.pi), wavelength_um=1.0).phase_matrix


@cache
def dust() -> PhaseMatrix:
    """Of many sizes, smooth over angle."""
    return vrte.spheres(1.53 + 0.005j, size=vrte.Lognormal(0.2, 1.5), wavelength_um=0.55).phase_matrix


def differ(first: PhaseMatrix, second: PhaseMatrix) -> float:
    """The largest difference of any coefficient."""
    terms = max(first.terms, second.terms)
    padded = [np.pad(one.coefficients, ((0, terms - one.terms), (0, 0))) for one in (first, second)]
    return float(np.abs(padded[0] - padded[1]).max())


def back(table: Any, **options: Any) -> PhaseMatrix:
    return PhaseMatrix.from_angles(table.angle_deg, *table.elements, **options)


BUILT_IN = {
    "isotropic": vrte.isotropic,
    "rayleigh": vrte.rayleigh,
    "depolarizing": lambda: vrte.rayleigh(0.3),
    **{f"henyey-greenstein {g}": (lambda g=g: vrte.henyey_greenstein(g)) for g in (-0.5, 0.0, 0.3, 0.75, 0.85)},
    "sphere": lambda: sphere_of_size(5.0, 1.5 + 0.01j),
    "sizes": dust,
    "spheroids": lambda: PhaseMatrix(*np.array(SPHEROIDS).T),
    "mixture": lambda: vrte.mix([(dust(), 0.3), (vrte.rayleigh(0.1), 0.5), (vrte.henyey_greenstein(0.7), 0.2)]),
}


@pytest.mark.parametrize("name", BUILT_IN)
def test_every_built_in_phase_matrix_goes_out_and_comes_back(name: str) -> None:
    matrix = BUILT_IN[name]()
    again = back(matrix.to_angles())
    assert differ(matrix, again) <= 1e-11
    assert again.expansion is not None
    assert again.expansion.way.startswith("exact quadrature")
    assert abs(again.expansion.integral - 1.0) <= 1e-12


@pytest.mark.slow
@pytest.mark.parametrize(
    "matrix",
    [lambda: vrte.henyey_greenstein(0.95), lambda: vrte.henyey_greenstein(0.98), lambda: sphere_of_size(300.0)],
)
def test_sharp_peaks_go_out_and_come_back(matrix: Any) -> None:
    assert differ(matrix(), back(matrix().to_angles())) <= 1e-10


def test_a_sphere_of_300_on_just_enough_even_steps_comes_back() -> None:
    matrix = sphere_of_size(300.0)
    again = back(matrix.to_angles(np.linspace(0.0, 180.0, 901)), accuracy=1e-6)
    assert abs(again.asymmetry - matrix.asymmetry) <= 1e-10
    assert again.expansion is not None
    assert again.expansion.largest_error <= 1e-6
    assert again.terms < matrix.terms


@pytest.mark.parametrize("kind", ["gauss", "middles"])
def test_other_quadratures_are_known(kind: str) -> None:
    cosine = np.polynomial.legendre.leggauss(60)[0]
    angles = np.degrees(np.arccos(cosine[::-1])) if kind == "gauss" else 3.0 * (np.arange(60) + 0.5)
    matrix = sphere_of_size(8.0)
    assert differ(matrix, back(matrix.to_angles(angles))) <= 1e-11


def test_exactness_is_measured_and_not_taken_for_granted() -> None:
    """Even steps that a sphere's spectrum exceeds are interpolated like any others."""
    matrix = sphere_of_size(40.0)
    enough, few = (matrix.to_angles(np.linspace(0.0, 180.0, count)) for count in (141, 91))
    assert integrate_exactly(enough.angle_deg, enough.elements) is not None
    assert integrate_exactly(few.angle_deg, few.elements) is None


def test_integrals_are_those_of_a_literal_sum() -> None:
    """On Gauss nodes, with the definitions written out for degrees 0 to 3."""
    matrix = sphere_of_size(1.0, 1.5)
    u, weights = np.polynomial.legendre.leggauss(40)
    angles = np.degrees(np.arccos(u))[::-1]
    table = matrix.to_angles(angles)
    f11, f12, f22, f33, f34, f44 = table.elements[:, ::-1]
    sums = integrate_exactly(angles, table.elements)
    assert sums is not None
    p2, p02 = 1.5 * u**2 - 0.5, -np.sqrt(6.0) / 4.0 * (1.0 - u**2)
    expected = [weights @ (f11 * p2), weights @ (f44 * p2), weights @ (f12 * p02), weights @ (f34 * p02)]
    expected += [weights @ ((f22 + f33) * (1 + u) ** 2 / 4), weights @ ((f22 - f33) * (1 - u) ** 2 / 4)]
    assert_close(sums[2], expected, rtol=0.0, atol=1e-13)


def test_errors_are_those_of_the_elements_themselves() -> None:
    """The errors that are told against elements of the cut expansion, one by one."""
    matrix = sphere_of_size(6.0)
    table = matrix.to_angles(np.linspace(0.0, 180.0, 61))
    with pytest.warns(NegativeScatteringWarning, match="taken, as its expansion is off by"):
        cut = back(table, accuracy=1e-3)
    other = cut.to_angles(table.angle_deg)
    off = np.abs(other.elements - table.elements).max(axis=0) / np.maximum(table.F11, 1e-3)
    assert cut.expansion is not None
    assert_close(cut.expansion.error, off, rtol=1e-6, atol=1e-13)
    assert 1e-5 < cut.expansion.largest_error == cut.expansion.error.max() <= 1e-3


def test_terms_are_as_few_as_the_accuracy_takes() -> None:
    table = vrte.henyey_greenstein(0.7).to_angles()
    exact = 2.0 * np.arange(200) + 1.0
    for accuracy in (1e-2, 1e-4, 1e-6):
        found = PhaseMatrix.from_angles(table.angle_deg, table.F11, accuracy=accuracy)
        coefficients = np.zeros((200, 6))
        coefficients[:, 0] = exact * 0.7 ** np.arange(200)
        worst, _ = follow_errors(coefficients, table.angle_deg, table.elements)
        assert worst[found.terms - 1] <= accuracy < worst[found.terms - 2]


@pytest.mark.parametrize("step", [1.0, 2.0, 5.0])
def test_uneven_angles_are_interpolated(step: float) -> None:
    matrix = dust()
    angles = np.unique(np.concatenate([[0.0, 180.0], np.arange(step / 3.0, 180.0, step)]))
    again = back(matrix.to_angles(angles))
    assert again.expansion is not None
    assert again.expansion.way == f"a spline over {angles.size} angles"
    fine = np.linspace(0.0, 180.0, 721)
    off = np.abs(again.to_angles(fine).F11 / matrix.to_angles(fine).F11 - 1.0).max()
    assert off <= {1.0: 3e-4, 2.0: 3e-4, 5.0: 5e-3}[step]
    assert abs(again.asymmetry - matrix.asymmetry) <= 1e-4


def test_a_spline_follows_henyey_and_greenstein_in_closed_form() -> None:
    angles = np.unique(np.concatenate([np.geomspace(0.1, 10.0, 60), np.arange(11.0, 181.0, 1.0), [0.0]]))
    g = 0.9
    f11 = (1.0 - g**2) / (1.0 + g**2 - 2.0 * g * np.cos(np.radians(angles))) ** 1.5
    again = PhaseMatrix.from_angles(angles, f11)
    assert again.is_scalar
    assert abs(again.asymmetry - g) <= 1e-6


def test_a_peak_that_the_steps_miss_is_refused_with_the_integral_found() -> None:
    table = sphere_of_size(300.0).to_angles(np.arange(0.0, 181.0))
    with pytest.raises(
        SceneError, match=r"F11 has a mean over the sphere of 1\.25\d* times what it should be"
    ) as refused:
        back(table)
    assert refused.value.place == ("F11",)
    assert "normalise=True" in str(refused.value)


def test_steps_that_may_miss_a_peak_are_told_where_the_integral_is_right_by_luck() -> None:
    sharp = vrte.henyey_greenstein(0.97).to_angles(np.arange(0.0, 181.0, 6.0))
    with pytest.warns(AccuracyWarning, match="steps of a table over angle are coarse: without every other angle"):
        again = back(sharp, normalise=True, accuracy=1e-2)
    assert again.expansion is not None
    assert again.a1[0] == 1.0
    assert again.expansion.integral != close_to(1.0, rtol=0.0, atol=0.01)


def test_normalise_divides_by_what_is_found() -> None:
    table = dust().to_angles()
    again = PhaseMatrix.from_angles(table.angle_deg, *(3.0 * table.elements), normalise=True)
    assert differ(again, dust()) <= 1e-11
    assert again.expansion is not None
    assert again.expansion.integral == close_to(3.0, rtol=1e-12, atol=0.0)
    within = PhaseMatrix.from_angles(table.angle_deg, *(1.04 * table.elements))
    assert within.expansion is not None
    assert within.expansion.integral == close_to(1.04, rtol=1e-12, atol=0.0)


def test_ends_are_left_open_or_extrapolated_but_never_in_silence() -> None:
    matrix = dust()
    table = matrix.to_angles(np.arange(3.0, 175.0, 1.0))
    with pytest.raises(SceneError, match=r"from 0 to 180 degrees, not from 3 to 174.*ends=\"extrapolate\""):
        back(table)
    again = back(table, ends="extrapolate")
    assert again.expansion is not None
    assert again.expansion.way.endswith("extrapolated short of 3 degrees and beyond of 174 degrees")
    assert again.asymmetry == close_to(matrix.asymmetry, rtol=0.0, atol=2e-3)
    assert again.expansion.table.angle_deg[0] == 3.0
    forward, backward = again.scattering_matrix([0.0, 180.0])
    assert forward[0, 0] == close_to(matrix.scattering_matrix(0.0)[0, 0], rtol=0.05, atol=0.0)
    assert forward[1, 1] == close_to(forward[2, 2], rtol=1e-3, atol=0.0)
    assert backward[1, 1] == close_to(-backward[2, 2], rtol=1e-3, atol=0.0)
    with pytest.raises(SceneError, match="ends fills what a table leaves out, and this one"):
        back(matrix.to_angles(), ends="extrapolate")


def test_what_spheres_leave_out_is_filled_in_only_when_asked_for() -> None:
    table = dust().to_angles()
    given = {"F12": table.F12, "F33": table.F33, "F34": table.F34}
    with pytest.raises(SceneError, match=r"F22 is missing: all six elements are needed.*spheres=True") as refused:
        PhaseMatrix.from_angles(table.angle_deg, table.F11, **given)
    assert refused.value.place == ("F22",)
    again = PhaseMatrix.from_angles(table.angle_deg, table.F11, **given, spheres=True)
    assert differ(again, dust()) <= 1e-11
    with pytest.raises(SceneError, match="spheres fills columns that are missing, and none is"):
        back(table, spheres=True)
    with pytest.raises(SceneError, match="F12 is missing"):
        PhaseMatrix.from_angles(table.angle_deg, table.F11, spheres=True)
    assert PhaseMatrix.from_angles(table.angle_deg, table.F11).is_scalar


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"angle_deg": [0.0, 90.0, 80.0, 180.0]}, "angle_deg must ascend from 0 to 180 degrees, not be 80 behind"),
        ({"angle_deg": [0.0, 90.0, 90.0, 180.0]}, "not be 90 behind a larger or the same one"),
        ({"angle_deg": [-1.0, 90.0, 100.0, 180.0]}, "not be -1 to 180"),
        ({"angle_deg": [0.0, 90.0, 100.0, 181.0]}, "not be 0 to 181"),
        ({"angle_deg": [0.0]}, "angle_deg must be 2 to 20000 angles, not 1"),
        ({"F11": [1.0, 1.0, 1.0]}, "F11 must have a value for each of 4 angles, not 3"),
        ({"F11": [1.0, np.nan, 1.0, 1.0]}, "F11 must be finite numbers, not nan"),
        ({"F11": [1.0, -0.1, 1.0, 1.0]}, "F11 must be positive, not -0.1 at 90 degrees"),
        ({"F11": [1.0, 0.0, 1.0, 1.0]}, "F11 must be above 0: it is 0 at 90 degrees"),
        ({"convention": "mine"}, "convention must be one of vrte, bohren-huffman"),
        ({"ends": "guess"}, "ends must be \"extrapolate\" or left out, not 'guess'"),
        ({"accuracy": 0.0}, "accuracy must be from 1e-12 to 0.1"),
        ({"normalise": 1}, "normalise must be True or False, not 1"),
        ({"spheres": "yes"}, "spheres must be True or False, not 'yes'"),
        ({"tolerance": 2.0}, "tolerance must be between 0 and 1"),
        (
            {"convention": "granada"},
            'normalise must be True for the convention "granada", which leaves the mean of F11',
        ),
        ({"convention": "chandrasekhar"}, "F12 is missing: in the convention F11 alone is not the intensity"),
    ],
)
def test_bad_input_ends_in_one_sentence(change: dict[str, Any], said: str) -> None:
    given = {"angle_deg": [0.0, 90.0, 100.0, 180.0], "F11": [1.0, 1.0, 1.0, 1.0]} | change
    with pytest.raises(SceneError, match=re.escape(said)):
        PhaseMatrix.from_angles(**given)


def test_a_table_that_no_particles_have_is_refused_by_its_angle() -> None:
    table = vrte.rayleigh().to_angles(np.arange(0.0, 181.0, 5.0))
    wrong = np.where(table.angle_deg == 60.0, 0.9, table.F12)
    columns = (table.F11, wrong, *table.elements[2:])
    with pytest.raises(SceneError, match="the table is not physical: at 60 degrees its coherency matrix has"):
        PhaseMatrix.from_angles(table.angle_deg, *columns)
    flipped = PhaseMatrix.from_angles(table.angle_deg, table.F11, -table.F12, *table.elements[2:])
    assert flipped.b1[2] == close_to(
        -np.sqrt(1.5), rtol=1e-6, atol=0.0
    )  # a sign is no matter of physics: the card is for that


def test_a_little_noise_is_taken_and_told() -> None:
    table = vrte.rayleigh().to_angles(np.arange(0.0, 181.0, 5.0))
    noisy = table.elements.copy()
    noisy[1] *= 1.002
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NegativeScatteringWarning)
        again = PhaseMatrix.from_angles(table.angle_deg, *noisy, tolerance=0.01)
    assert again.expansion is not None
    assert again.expansion.lowest_eigenvalue == close_to(-0.001, rtol=0.05, atol=0.0)
    assert again.expansion.lowest_angle_deg == 90.0
    with pytest.raises(SceneError, match="the table is not physical: at 90 degrees"):
        PhaseMatrix.from_angles(table.angle_deg, *noisy)


def test_a_spline_of_spheres_stays_physical_between_angles() -> None:
    """Pure matrices, interpolated, would polarize by more than all; an accuracy lets through as much as it says."""
    matrix = sphere_of_size(12.0, 1.5)
    angles = np.unique(np.concatenate([[0.0, 180.0], np.arange(0.25, 180.0, 0.5)]))
    again = back(matrix.to_angles(angles))
    assert abs(again.asymmetry - matrix.asymmetry) <= 1e-6
    with pytest.warns(NegativeScatteringWarning, match="taken, as its expansion is off by"):
        coarse = back(matrix.to_angles(angles), accuracy=1e-3)
    assert 0.0 < coarse.tolerance < 1e-3
    with pytest.warns(NegativeScatteringWarning, match="taken, as tolerance"):
        vrte.mix([(coarse, 1.0)])


def test_the_report_survives_pickling_and_no_equality_asks_for_it() -> None:
    again = back(dust().to_angles())
    copied = pickle.loads(pickle.dumps(again))
    assert copied.coefficients.tobytes() == again.coefficients.tobytes()
    assert copied.expansion.way == again.expansion.way
    assert copied.expansion.error.tobytes() == again.expansion.error.tobytes()
    assert vrte.mix([(again, 1.0)]).expansion is None
    assert vrte.rayleigh().expansion is None


def test_the_picture_has_the_table_and_the_error_below() -> None:
    plain, over = vrte.rayleigh().plot(), back(vrte.rayleigh().to_angles()).plot()
    assert len(plain.axes) == 2
    assert len(over.axes) == 3
    assert len(over.axes[0].lines) == len(plain.axes[0].lines) + 1
    assert len(over.axes[1].lines) == 2 * len(plain.axes[1].lines)
    assert over.axes[2].get_ylabel() == "error/F11"


def test_angles_anywhere_are_those_of_the_scattering_matrix() -> None:
    matrix = dust()
    angles = [170.0, -30.0, 0.0, 400.0, 90.0]
    table, full = matrix.to_angles(angles), matrix.scattering_matrix(angles)
    assert_close(table.F34, full[:, 2, 3], rtol=0.0, atol=1e-13)
    assert_close(table.F12, full[:, 1, 0], rtol=0.0, atol=1e-13)
    assert_close(table.elements[[0, 2, 3, 5]].T, np.diagonal(full, axis1=1, axis2=2), rtol=1e-11, atol=0.0)


@pytest.mark.parametrize("name", CONVENTIONS)
def test_a_convention_is_recognised_by_four_digits_and_reads_back(name: str) -> None:
    about, sphere = find_convention(name), make_reference_sphere()
    card = np.array([[float(f"{value:.4g}") for value in row] for row in tabulate_card(about)])
    assert vrte.recognise_convention(CARD_DEG, *card) == (name,)
    spheres_only = (card[0], card[1], card[2] if name == "chandrasekhar" else None, card[3], card[4])
    assert vrte.recognise_convention(CARD_DEG, *spheres_only) == (name,)
    angles = sphere.phase_matrix.to_angles().angle_deg
    again = PhaseMatrix.from_angles(
        angles, *tabulate_card(about, angles), convention=name, normalise=about.mean is None
    )
    assert differ(again, sphere.phase_matrix) <= 1e-10


def test_what_tells_nothing_apart_is_several_names() -> None:
    card = tabulate_card(CONVENTIONS["vrte"])
    names = vrte.recognise_convention(CARD_DEG, card[0])
    assert {"vrte", "granada-synthetic", "ice", "perpendicular"} <= set(names)
    assert "miepython" not in names


def test_what_fits_no_convention_says_the_nearest() -> None:
    card = tabulate_card(CONVENTIONS["vrte"])
    with pytest.raises(SceneError, match=r'no known convention: "vrte" is nearest, and its F34 is off by 0\.1'):
        vrte.recognise_convention(CARD_DEG, card[0], card[1], card[2], card[3], 0.7 * card[4], card[5])
    with pytest.raises(SceneError, match="up to a constant factor it is miepython or miev0"):
        vrte.recognise_convention(CARD_DEG, *(7.7 * tabulate_card(CONVENTIONS["miev0"])))


def test_amplitudes_of_miev0_have_the_sign_that_the_card_says(reference: Any) -> None:
    """Published S1, S2 of fields exp(+i omega t): by Bohren and Huffman's formulas F34 turns over."""
    table = np.genfromtxt(reference("mie/miev0_S1S2_x1_m1.5-1i.csv"), delimiter=",", names=True)
    s1, s2 = table["ReS1"] + 1j * table["ImS1"], table["ReS2"] + 1j * table["ImS2"]
    f11, f34 = 0.5 * (abs(s1) ** 2 + abs(s2) ** 2), (s2 * s1.conj()).imag
    ours = sphere_of_size(1.0, 1.5 + 1.0j).to_angles(table["theta_deg"])
    assert_close(CONVENTIONS["miev0"].circular * f34 / f11, ours.F34 / ours.F11, rtol=0.0, atol=2e-5)
    assert np.abs(f34 / f11).max() > 0.1


def test_a_spline_without_the_ends_of_ratios_keeps_f11_positive() -> None:
    matrix = vrte.henyey_greenstein(0.6)
    table = matrix.to_angles(np.linspace(0.0, 180.0, 19))
    spline = ElementSpline(table.angle_deg, table.elements)
    assert spline.compare(np.array([5.0, 175.0]), matrix.to_angles([5.0, 175.0]).F11) < 0.01
