"""What the package finds for layers over bases, and for their derivatives, beside the oracle in ball arithmetic, which
is what closed forms say and whose table is complete. Scenes of every kind: tests/test_every_way.py."""

import itertools
import math
from collections import Counter

import numpy as np
import pytest

import vrte
from bench import stability, stability_cases
from bench.cases import Slab, find_phase_matrix, make_scene, store_phase_matrices
from tests import exact

from . import oracle, oracle_table
from .closed_forms import airy_sum, bare_base
from .helpers import assert_close
from .samples import slow_but
from .scenes import KNOWN

COMPARED = {"yes": 260, "no stable answer": 1}  # of the cases of the table of stability; its page says how many


def test_it_is_what_closed_forms_say() -> None:
    """A plate of absorbing glass between air and water, a Lambertian base under a surface, and derivatives of light
    through a layer that scatters nothing."""
    mu_i, mu_o, glass = [0.1, 0.6, 1.0], [0.2, 0.9], vrte.Interface(1.0, 1.5)
    absorbing, grey = vrte.Layer(vrte.rayleigh(), 0.0, 0.3), vrte.Lambertian(0.5)
    plate = oracle.brdf(vrte.Scene([glass, absorbing, vrte.Interface(1.5, 1.33)]), mu_i, mu_o, 4, [0])
    for got, right in zip((plate.specular, plate.specular_transmission), airy_sum(mu_i, 1.5, 1.33, 0.3), strict=True):
        assert_close(got, right, rtol=0.0, atol=1e-15)
    found = oracle.brdf(vrte.Scene([glass], grey), mu_i, mu_o, 32, [0]).reflected[0, ..., 0, 0]
    assert_close(found, bare_base(1.5, 0.5, mu_i, mu_o), rtol=1e-13, atol=0.0)
    slant = np.add.outer(1 / np.array(mu_i), 1 / np.array(mu_o))
    beer = np.exp(-0.3 * slant) / np.pi
    for name, right in (("base.albedo", beer), ("layer[1].thickness", -0.5 * slant * beer)):
        found = oracle.brdf(vrte.Scene([absorbing], grey), mu_i, mu_o, 4, [0], name).reflected[0, ..., 0, 0]
        assert_close(found, right, rtol=1e-14, atol=0.0, err_msg=name)


NODES, PHI = 8, np.arange(64) * (360.0 / 64)


def find_largest_error(got: np.ndarray, right: np.ndarray) -> float:
    """Of the largest over all directions out, beam by beam; a beam that gives nothing must give nothing."""
    scale, error = np.abs(right).max(axis=(1, 2, 3)), np.abs(got - right).max(axis=(1, 2, 3))
    assert (error[scale == 0.0] < 1e-15).all()
    return float((error / np.where(scale == 0.0, 1.0, scale)).max())


@pytest.mark.parametrize(
    ("albedo", "thickness", "transmitted"),
    [(0.5, 1e-6, 1e-13), (1.0, 1e6, 1e-8), pytest.param(1.0, 1e4, 1e-10, marks=pytest.mark.slow)],
)
def test_reflection_and_transmission(albedo: float, thickness: float, transmitted: float) -> None:
    """Of spheroids, which mix U and V. Measured: reflection to 1e-13, transmission (relative) to 3e-12 at thickness
    1e4 and 2e-10 at 1e6."""
    scene = vrte.Scene([vrte.Layer(find_phase_matrix("spheroids"), albedo, thickness)])
    orders, mu_i, mu_o = (0, 1) if thickness < 10.0 else (0,), [1e-3, 0.5, 1.0], [1e-3, 0.35, 1.0]
    f = exact.brdf(scene, mu_i, mu_o, PHI, nodes=NODES, transmission=True)
    right = oracle.brdf(scene, mu_i, mu_o, NODES, orders)
    for m in orders:
        assert find_largest_error(oracle.find_order(f.mueller, m), right.reflected[m]) < 1e-12
    assert find_largest_error(oracle.find_order(f.transmission, 0), right.transmitted[0]) < transmitted


def test_a_last_place_of_a_conservative_layer_is_worth_its_thickness() -> None:
    """omega = 1 - 1e-16 instead of 1 takes (thickness k)^2 / 2 of the transmission: 1e-8 of it at thickness 1e4."""

    def c(thickness: float) -> float:
        case = stability_cases.Case("thick", 2, (Slab("rayleigh", 1.0, thickness),), sun=0.6, orders=(0,))
        return float(oracle_table.answer_stability(case)["thick/0/c"])

    assert 1e-17 < c(1.0) < 1e-15
    assert 1e-9 < c(1e4) < 1e-7


# Derivatives.

MU_I, MU_O, AZIMUTHS = (0.1, 0.6), (0.35, 0.9), np.arange(32) * (360.0 / 32)
THICKNESSES, ALBEDOS = (1e-6, 1e-2, 1.0, 1e2, 1e4, math.inf), (0.5, 0.99, 1.0 - 1e-6, 1.0 - 1e-9, 1.0)
PHASES, BASES = ("rayleigh", "spheroids", "metal-x1", "HG 0.5 12", "glass-x1"), (None, 0.3, 1.0)
DIRECTIONS = ("[1].a1", "[2].b1", "[2].a1", "[2].b2", "[1].a4", "[2].a2", "[2].a3")
ROUNDING = 1e-15  # of the largest element: some derivatives are zero, or of light that a thick layer lets through


def list_derivatives() -> dict[str, tuple[vrte.Scene, list[str]]]:
    """Scenes and numbers of theirs: every thickness with every albedo, alone and with another layer."""
    found, other = {}, Slab("rayleigh", 0.9, 1.0)
    for (i, thickness), (j, albedo), pair in itertools.product(enumerate(THICKNESSES), enumerate(ALBEDOS), (0, 1)):
        has_no_end, main = math.isinf(thickness), Slab(PHASES[(i + j + 2 * pair) % 5], albedo, thickness)
        base = None if has_no_end else BASES[(i + 2 * j + pair) % 3]
        slabs = [(main,), (other, main) if has_no_end else (main, other)][pair]
        at = 1 + slabs.index(main)
        names = [] if has_no_end else [f"layer[{at}].thickness"]
        names += [] if has_no_end and albedo == 1.0 else [f"layer[{at}].albedo"]
        names += [f"layer[{at}].coefficients{DIRECTIONS[len(found) % 7]}"]
        names += [] if base is None else ["base.albedo"]
        found[f"{main.phase} {albedo:.10g} {thickness:g}, {pair}"] = make_scene(slabs, base), names
    return found


BETWEEN_INTERFACES = {
    "plate, conservative": ["layer[2].coefficients[2].b2"],
    "glass over white": ["base.albedo"],
    "varnish over paint": ["layer[2].albedo"],
    "three media": ["layer[3].thickness"],
}
DERIVATIVES = list_derivatives() | {name: (KNOWN[name], numbers) for name, numbers in BETWEEN_INTERFACES.items()}
QUICK = (
    "rayleigh 0.5 1e-06, 0",
    "spheroids 1 1e-06, 1",
    "HG 0.5 12 0.999999 10000, 1",
    "rayleigh 0.5 inf, 0",
    "glass over white",
)


@pytest.mark.parametrize("title", slow_but(DERIVATIVES, *QUICK, "glass over white"))
def test_derivatives_are_those_of_ball_arithmetic(title: str) -> None:
    """Thickness 1e-6 to 1e4 and semi-infinite. Measured: 3e-13; with the albedo of a layer of thickness 1e4 that
    absorbs 1e-9 or nothing 1e-10."""
    (scene, names), allowed = DERIVATIVES[title], 1e-10 if title in BETWEEN_INTERFACES else 1e-9
    through = scene.base is None and scene.thickness <= 102.0  # what is transmitted is no number near zero
    found = exact.brdf(scene, MU_I, MU_O, AZIMUTHS, nodes=4, derivatives=names, transmission=through, threads=1)
    for name in names:
        assert found.diagnostics["derivatives"][name] == "algebra"
        right = oracle.brdf(scene, MU_I, MU_O, 4, (0, 1), name)
        values = [(found.jacobian[name], found.mueller, right.reflected)]
        values += [(found.transmission_jacobian[name], found.transmission, right.transmitted)] if through else []
        for value, whole, expected in values:
            difference = np.abs([oracle.find_order(value, m) for m in (0, 1)] - expected).max()
            assert difference < allowed * np.abs(expected).max() + ROUNDING * np.abs(whole).max(), name


DARK = {
    "rayleigh": ([Slab("rayleigh", 0.2, 60.0)], ["layer[1].albedo"]),
    "rayleigh, thicker": ([Slab("rayleigh", 0.2, 90.0)], ["layer[1].albedo", "layer[1].coefficients[2].a1"]),
    "spheroids": ([Slab("spheroids", 0.3, 60.0)], ["layer[1].albedo", "layer[1].coefficients[2].b2"]),
    "two": ([Slab("rayleigh", 0.9, 1.0), Slab("spheroids", 0.3, 60.0)], ["layer[1].albedo", "layer[2].albedo"]),
}


@pytest.mark.parametrize("title", slow_but(DARK, "rayleigh"))
def test_what_a_thick_absorber_lets_through(title: str) -> None:
    """1e-40 of the light at the least, relative to itself; near 1 a cosine on a mode of Rayleigh's, at 0.2."""
    slabs, names = DARK[title]
    scene, orders = make_scene(slabs, None), (0,) if title == "rayleigh" else (0, 1)
    for mu in ((0.1, 0.6), (0.6, 0.9916877394597053)):
        found = exact.brdf(scene, mu, mu, AZIMUTHS, nodes=8, derivatives=names, transmission=True, threads=1)
        for name, m in itertools.product(names, orders):
            right = oracle.brdf(scene, mu, mu, 8, [m], name).transmitted[0]
            got = oracle.find_order(found.transmission_jacobian[name], m)
            assert np.abs(right).max() > 1e-45
            assert np.abs(got - right).max() < 1e-10 * np.abs(right).max(), (name, m)


# The stored table.

STABILITY = stability.read_oracle_table()


def test_the_table_is_what_the_oracle_says() -> None:
    """One entry, worked out again."""
    listed = next(case for case in stability_cases.list_oracle_cases() if case.base == "lobe" and case.nodes == 2)
    answer = oracle_table.answer_stability(stability.restore_case(listed, STABILITY))
    for key, values in answer.items():
        right, *_, kind = STABILITY[key], *key.split("/")
        if kind == "hash":
            assert str(values) == str(right)
        else:  # c is a difference in the last places
            assert_close(values, right, rtol=0.0, atol=(0.5 if kind == "c" else 1e-15) * np.abs(right).max())


def test_the_table_is_complete_and_its_numbers_are_those_of_today() -> None:
    """But for the rounding that differs from one processor to another; of eigenvalues in the ninth digit."""
    listed = stability_cases.list_oracle_cases()
    answers = [stability.find_oracle_answer(case, STABILITY) for case in listed]
    assert Counter(answer if isinstance(answer, str) else "yes" for answer in answers) == COMPARED
    for case in listed:
        assert_close(STABILITY[f"{case.name}/mu"], [case.mu0, *case.mu], rtol=0.0, atol=1e-9)
    for name, computed in store_phase_matrices(slab for case in listed for slab in case.slabs).items():
        assert_close(STABILITY[name], computed, rtol=0.0, atol=1e-12)
