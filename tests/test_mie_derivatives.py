"""Derivatives of the optics of spheres in closed form: against ball arithmetic, and against differences of vrte."""

import math
from typing import Any

import numpy as np
import pytest
from flint import acb, arb, ctx

import vrte
from vrte._core import coated_sphere_coefficients, coated_sphere_slopes, sphere_coefficients, sphere_slopes
from vrte.formats import scene_family
from vrte.optics.spheres import SphereNumbers, count_orders, vary_spheres

from .helpers import close_to
from .samples import slow_but
from .sphere_oracle import make_ball, solve_literally

# ---- a_n and b_n as Bohren and Huffman write them, differenced with a step of 2^-120 in 700 bits


def differentiate_literally(n: int, given: tuple[complex, ...]) -> Any:
    """Derivatives of a_n and b_n with each argument, (arguments, 2), with as many bits as it takes."""
    for precision in (700, 4000):
        with ctx.workprec(precision):
            slopes = np.array([difference(n, given, index) for index in range(len(given))])
        if all(slope.rel_accuracy_bits() > 60 for slope in slopes.flat):
            return np.vectorize(complex)(slopes)
    raise AssertionError("not enough bits")


def difference(n: int, given: tuple[complex, ...], index: int) -> list[acb]:
    """That of a_n and b_n with one argument."""
    arguments, step = [make_ball(complex(value)) for value in given], acb(arb(2) ** -120)
    up, down = (
        solve_literally(n, [value + side * step * (k == index) for k, value in enumerate(arguments)])
        for side in (1, -1)
    )
    return [(high - low) / (2 * step) for high, low in zip(up, down, strict=True)]


@pytest.mark.parametrize(
    ("given", "orders", "within"),
    [
        ((1.5 + 1.0j, 1e-3), (1, 2), 1e-15),
        ((1.5, math.pi), (1, 3, 8), 2e-15),
        ((0.2 + 3.4j, 5.9), (1, 5, 9), 2e-14),
        ((2.7, 30.0), (1, 20, 31, 40), 3e-14),
        pytest.param((1.0001, 50.0), (1, 30, 51), 1e-12, marks=pytest.mark.slow),
        pytest.param((10 + 10j, 100.0), (1, 50, 101, 125), 5e-12, marks=pytest.mark.slow),
        pytest.param((1.33, 1000.0), (1, 700, 1001, 1040), 1e-12, marks=pytest.mark.slow),
        ((1.5, 1.33, 2.0, 3.0), (1, 3, 6), 5e-15),
        ((1.0, 1.59 + 0.001j, 1.5, 1.9), (1, 2, 4), 5e-15),
        ((2.7, 1.5 + 0.01j, 20.0, 21.0), (1, 15, 22, 27), 5e-14),
        pytest.param((2 + 1j, 1.33, 46.0, 50.0), (1, 30, 50), 2e-13, marks=pytest.mark.slow),
        pytest.param((1.59 + 0.66j, 1.409 + 0.1747j, 0.5, 20.0), (1, 10, 20), 2e-14, marks=pytest.mark.slow),
    ],
)
def test_the_recursions_against_ball_arithmetic(given: tuple[Any, ...], orders: tuple[int, ...], within: float) -> None:
    """Of each argument, relative to its largest derivative; the values are those of the plain kernels, to all bits."""
    coated = coated_sphere_slopes, coated_sphere_coefficients
    kernels: Any = (sphere_slopes, sphere_coefficients) if len(given) == 2 else coated
    indices, sizes = np.split(np.array(given, complex)[:, None], 2)
    count = count_orders(given[-1])
    found = kernels[0](*given, count)
    (plain,) = kernels[1](*indices, *sizes.real.copy(), np.array([count], np.int32))
    assert (found[0] == plain).all()
    for n in orders:
        error = abs(found[1:, :, n - 1] - differentiate_literally(n, given)).max(axis=1)
        assert (error <= within * abs(found[1:]).max(axis=(1, 2))).all()


@pytest.mark.parametrize(
    ("index", "size", "orders", "within"),
    [(1.5 + 0.01j, 2.0, 14, 1e-13), pytest.param(1.6, 39.3, 68, 1e-11, marks=pytest.mark.slow)],
)
def test_cross_sections_of_a_sphere(index: complex, size: float, orders: int, within: float) -> None:
    """(4.61) and (4.62), and their derivative with n, k and the radius, with which the volume grows, summed up from
    ball arithmetic; of a clear sphere on a resonance, where a difference would need steps of a millionth."""
    given = vrte.spheres(index, radius_um=size, wavelength_um=2.0 * math.pi)
    ((ball, _),) = given.balls
    numbers = SphereNumbers.of(ball, 1, 6)
    sphere = np.array([complex(index)]), np.array([size]), np.array([orders], np.int32)
    a, b = sphere_coefficients(*sphere)[0, :, : orders - 1]
    exact = np.array([differentiate_literally(n, (index, size)) for n in range(1, orders)])
    twice = 2.0 * np.arange(1, orders) + 1.0
    for place, step in ((0, 1.0), (0, 1j), (1, 1.0)) if complex(index).imag else ((1, 1.0),):
        arguments = np.zeros((2, 1), complex)
        arguments[place] = step
        change = SphereNumbers(arguments, np.full(1, float(place)), np.zeros(1), np.zeros(()))
        (found,) = vary_spheres(ball, given, numbers, [change])
        da, db = (exact[:, place] * step).T
        extinction = 2.0 * math.pi * twice @ (da + db).real
        assert found.extinction_um2 == close_to(extinction, rtol=within, atol=0.0)
        if complex(index).imag:
            scattering = 4.0 * math.pi * twice @ (a.conj() * da + b.conj() * db).real
            assert found.scattering_um2 == close_to(scattering, rtol=within, atol=0.0)
        assert found.volume_um3 == close_to(4.0 * math.pi * size**2 * place, rtol=1e-14, atol=0.0)
        assert found.coefficients.shape == given.phase_matrix.coefficients.shape


# ---- through sizes, mixtures and layers, against differences of all ingredients

PARTICLES = {
    "grain": {"index": [1.5, 0.01], "radius_um": 0.3},
    "drop": {"index": 1.6, "size": {"lognormal": {"median_um": 0.06, "sigma": 1.2}}},
    "coat": {"source": "coated-spheres", "core": 2.5, "shell": [1.5, 0.001], "core_ratio": 0.8, "diameter_um": 0.4},
    "shell": {
        "source": "coated-spheres",
        "core": 1.0,
        "shell": 1.59,
        "shell_um": 0.02,
        "size": {"gamma": {"r_eff_um": 0.12, "v_eff": 0.03}},
    },
}
LAYERS = [
    {"particles": {"grain": 0.3, "drop": 0.7}, "thickness_um": 20.0, "volume_fraction": 0.05},
    {"volume_fractions": {"coat": 0.02, "shell": 0.03, "grain": 0.01}, "thickness_um": 30.0},
    {"particles": "shell", "thickness": 3.0, "volume_fraction": 0.02},
]
QUICK = (
    "particles.grain.radius_um",
    "layer[1].particles.grain",
    "particles.coat.core_ratio",
    "layer[1].volume_fraction",
)
SLOW = (
    *("particles.grain.index[2]", "particles.drop.index", "particles.coat.shell[1]", "particles.coat.diameter_um"),
    *("particles.drop.size.lognormal.sigma", "particles.drop.size.lognormal.median_um", "particles.shell.shell_um"),
    *("particles.shell.size.gamma.v_eff", "host_index[1]", "host_index[2]", "wavelength_um"),
    *("layer[2].volume_fractions.coat", "layer[3].volume_fraction"),
)


@pytest.mark.parametrize("name", slow_but((*QUICK, *SLOW), *QUICK))
def test_closed_forms_are_what_differences_come_to(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    content = {"wavelength_um": 0.5, "host_index": [1.33, 1e-4], "particles": PARTICLES, "layer": LAYERS}
    if name in QUICK:
        coat = {"particles": "coat", "thickness": 1.0, "volume_fraction": 0.1}
        content["layer"] = [coat] if "coat" in name else LAYERS[:1]
    (closed,) = vrte.SceneFamily(content, [name]).variations()
    monkeypatch.setattr(scene_family.Neighbourhood, "needs_differences", lambda *_: True)
    (differences,) = vrte.SceneFamily(content, [name]).variations()
    for one, other in ((closed.thickness, differences.thickness), (closed.albedo, differences.albedo)):
        assert one == close_to(other, rtol=2e-9, atol=1e-11 * abs(other).max())
    for table, expected in zip(closed.coefficients, differences.coefficients, strict=True):
        rows = min(len(table), len(expected))
        assert abs(table[:rows] - expected[:rows]).max(initial=0.0) <= 3e-11 * abs(expected).max(initial=0.0)
        assert abs(table[rows:]).max(initial=0.0) <= 3e-11 * abs(expected).max(initial=0.0)


def test_crowded_spheres_and_other_shapes_go_by_differences() -> None:
    """What has no closed form: the derivative is there, right to differences."""
    layer = {"particles": "grain", "thickness_um": 20.0, "volume_fraction": 0.05, "packing": "effective-medium"}
    content = {"wavelength_um": 0.5, "particles": {"grain": {"index": 1.5, "radius_um": 0.05}}, "layer": [layer]}
    (found,) = vrte.SceneFamily(content, ["particles.grain.radius_um"]).variations()
    up, down = (found.scene_at(0.05 + step).layers[0].thickness for step in (1e-5, -1e-5))
    assert found.thickness[0] == close_to((up - down) / 2e-5, rtol=1e-6, atol=0.0)
