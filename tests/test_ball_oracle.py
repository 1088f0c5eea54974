"""The solver against ball arithmetic: where doubles are known to lose digits (omega = 1, thick, thin, grazing), and the
field of whole scenes; and the oracle against what else there is."""

import math

import numpy as np
import pytest

import vrte
from bench.cases import LOBE_AMPLITUDE, LOBE_MATRIX, LOBE_WIDTH_DEG, evaluate_mueller_lobe, find_phase_matrix
from tests import exact

from .ball_oracle import Answer, Layer, Request, field_order, mueller_lobe_orders, sensitivity
from .helpers import assert_close
from .literal import brdf_orders

MU_I, MU_O = [1e-3, 0.5, 1.0], [1e-3, 0.35, 1.0]
NODES = 8
MU = (0.35, 1.0, 1e-3, -0.35, -1.0, -1e-3)
STOKES = (1.0, 0.3, 0.2, 0.1)
SPHEROIDS, RAYLEIGH = find_phase_matrix("spheroids"), find_phase_matrix("rayleigh")
MATRICES = {
    "rayleigh": RAYLEIGH,
    "spheroids": SPHEROIDS,
    "metal": vrte.spheres(0.2 + 3.0j, radius_um=0.1, wavelength_um=0.5).phase_matrix,
}


def brdf_order(m: int, layer: vrte.Layer, mu_i: list[float], mu_o: list[float], nodes: int) -> list[np.ndarray]:
    """f^m and the diffuse BTDF's (in, out, 4, 4) [1/sr], public frame, over a black base."""
    slab = Layer(layer.phase_matrix.coefficients[: 2 * nodes], layer.albedo, layer.thickness)
    mu, levels = (*mu_o, *(-mu for mu in mu_o)), ((0, 0.0), (0, layer.thickness))
    asked = Request(m, (slab,), None, tuple(mu_i), mu, levels, nodes, tuple(map(tuple, np.eye(4).tolist())))
    light = field_order(asked).radiance.reshape(len(mu_i), 4, 2, len(mu), 4) / np.reshape(mu_i, (-1, 1, 1, 1, 1))
    light = np.moveaxis(light, 1, -1)  # (in, level, direction, 4, column)
    return [light[:, 0, : len(mu_o)], light[:, 1, len(mu_o) :]]


def fourier_order_of_brdf(f: np.ndarray, m: int) -> np.ndarray:
    """Order m of f, sampled at equal steps of azimuth: (in, out, 4, 4)."""
    phi = np.arange(f.shape[2]) * (2 * math.pi / f.shape[2])
    cosine, sine = (np.einsum("p,iopab->ioab", w(m * phi) / f.shape[2], f) for w in (np.cos, np.sin))
    cosine[..., 2:, :2] = sine[..., 2:, :2]
    cosine[..., :2, 2:] = -sine[..., :2, 2:]
    return cosine


def largest_error(got: np.ndarray, right: np.ndarray) -> float:
    """Of the largest over all directions out, beam by beam; a beam that gives nothing must give nothing."""
    scale = np.abs(right).max(axis=(1, 2, 3))
    error = np.abs(got - right).max(axis=(1, 2, 3))
    assert (error[scale == 0.0] < 1e-15).all()
    return float((error / np.where(scale == 0.0, 1.0, scale)).max())


# one that mixes U and V in every quick run, the others with the slow tests
@pytest.mark.parametrize(
    "matrix", [name if name == "spheroids" else pytest.param(name, marks=pytest.mark.slow) for name in MATRICES]
)
@pytest.mark.parametrize(
    ("albedo", "thickness", "transmitted"),
    [
        (0.5, 1e-6, 1e-13),
        (1.0, 1.0, 1e-12),
        (1.0, 1e6, 1e-8),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in ((0.5, 1.0, 1e-12), (1.0 - 1e-9, 100.0, 1e-12), (1.0, 1e-6, 1e-13), (1.0, 1e4, 1e-10))
        ),
    ],
)
def test_reflection_and_transmission(matrix: str, albedo: float, thickness: float, transmitted: float) -> None:
    """Measured: reflection to 1e-13, transmission (relative) to 3e-12 at thickness 1e4 and 2e-10 at 1e6."""
    layer = vrte.Layer(MATRICES[matrix], albedo, thickness)
    f = exact.brdf(vrte.Scene([layer]), MU_I, MU_O, np.arange(64) * (360.0 / 64), nodes=NODES, transmission=True)
    assert f.transmission is not None
    for m in (0, 1) if thickness < 10.0 else (0,):
        R, T = brdf_order(m, layer, MU_I, MU_O, NODES)
        assert largest_error(fourier_order_of_brdf(f.mueller, m), R) < 1e-12
        if m == 0:
            assert largest_error(fourier_order_of_brdf(f.transmission, m), T) < transmitted


def request(layers: list[vrte.Layer], base: object, m: int, levels: list[tuple[int, float]], nodes: int) -> Request:
    known = {None: None, "lobe": mueller_lobe_orders(LOBE_WIDTH_DEG, LOBE_AMPLITUDE, LOBE_MATRIX)}
    return Request(
        order=m,
        layers=tuple(Layer(layer.phase_matrix.coefficients, layer.albedo, layer.thickness) for layer in layers),
        base=known.get(base, base),
        mu0=(0.6,),
        mu=MU,
        levels=tuple(levels),
        nodes=nodes,
    )


def fourier_order(field: vrte.Field, m: int) -> np.ndarray:
    """(2, tau, mu, 4): what incident (I, Q) and (U, V) make of order m, told apart by parity."""
    turn = np.radians(m * field.phi)
    even, odd = (np.einsum("p,tkps->tks", wave(turn) / field.phi.size, field.stokes) for wave in (np.cos, np.sin))
    first = np.concatenate([even[..., :2], odd[..., 2:]], axis=-1)
    return np.stack([first, np.concatenate([-odd[..., :2], even[..., 2:]], axis=-1)])


SCENES = {
    "two layers over a grey base": ([(SPHEROIDS, 0.9, 0.7), (RAYLEIGH, 0.99, 1.5)], 0.3),
    "a lobe as the base": ([(SPHEROIDS, 0.9, 0.7)], "lobe"),
    "endless": ([(RAYLEIGH, 0.5, 0.2), (SPHEROIDS, 0.99, math.inf)], None),
    "endless and conservative": ([(SPHEROIDS, 1.0, math.inf)], None),
    "more terms than the nodes carry": ([(vrte.henyey_greenstein(0.6, 40), 0.9, 1.0)], None),
    "thick, conservative, over white": ([(SPHEROIDS, 1.0, 1e4), (RAYLEIGH, 1.0, 1e-3)], 1.0),
    "faint light": ([(SPHEROIDS, 0.5, 60.0)], None),
    "a clear layer between": ([(SPHEROIDS, 0.9, 0.5), (vrte.isotropic(), 0.0, 2.0), (SPHEROIDS, 0.9, 0.5)], 0.1),
}


QUICK = {"a lobe as the base", "endless and conservative", "faint light"}


@pytest.mark.parametrize("algorithm", ["modes", "doubling"])
@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in SCENES]
)
def test_both_algorithms_inside_and_out(name: str, algorithm: str) -> None:
    """Up, down, at every depth, and fluxes."""
    numbers, base = SCENES[name]
    layers = [vrte.Layer(*layer) for layer in numbers]
    levels = [(0, 0.0), (0, 0.1), (len(layers) - 1, 0.3 if math.isinf(layers[-1].thickness) else layers[-1].thickness)]
    above = np.cumsum([0.0, *(layer.thickness for layer in layers[:-1])])
    bases = {None: None, "lobe": vrte.MuellerBase(evaluate_mueller_lobe)}
    scene = vrte.Scene(layers, bases[base] if base in bases else vrte.Lambertian(base))
    field = exact.radiance(
        scene,
        0.6,
        stokes=STOKES,
        mu=MU,
        phi=np.arange(180) * 2.0,
        tau=[above[layer] + depth for layer, depth in levels],
        nodes=4,
        algorithm=algorithm,
    )
    for m in (0, 1):
        right = field_order(request(layers, base, m, levels, 4))
        if m == 0:
            size = np.abs(right.radiance[..., 0]).max(axis=(0, 2))
            fluxes = np.stack([right.flux_up, right.flux_down]).sum(axis=1)
            error = np.abs(np.stack([field.flux_up, field.flux_down]) - fluxes).max(axis=0)
            assert (error / fluxes.max(axis=0)).max() < 1e-11
        gap = np.abs(fourier_order(field, m) - right.radiance).max(axis=(0, 2, 3)) / size
        assert gap.max() < 1e-11


def test_the_oracle_is_the_literal_solver_with_more_digits() -> None:
    """A slab as the program in doubles has it, reflection and transmission; and two slabs over a base."""
    slab = vrte.Layer(SPHEROIDS, 0.9, 1.3)
    literal = [(slab.phase_matrix.coefficients, 0.9, 1.3)]
    doubles = brdf_orders(literal, 0.0, np.array([0.8]), np.array([0.35]), 4, 2)
    for ball, double in zip(brdf_order(1, slab, [0.8], [0.35], 4), doubles, strict=True):
        assert largest_error(double[1], ball) < 1e-13
    pile = [slab, vrte.Layer(RAYLEIGH, 0.99, 0.4)]
    literal.append((RAYLEIGH.coefficients, 0.99, 0.4))
    orders, through = brdf_orders(literal, 0.3, np.array([0.6]), np.array([0.35]), 8, 1)
    answer, beam = field_order(request(pile, 0.3, 0, [(0, 0.0), (1, 0.4)], 8)), np.array([1.0, 0.3, 0.0, 0.0])
    assert_close(answer.radiance[0, 0, 0], 0.6 * orders[0, 0, 0] @ beam, rtol=0.0, atol=1e-14)
    assert_close(answer.radiance[0, 1, 3], 0.6 * through[0, 0, 0] @ beam, rtol=0.0, atol=1e-14)


def test_a_last_place_of_a_conservative_layer_is_worth_its_thickness() -> None:
    """omega = 1 - 1e-16 instead of 1 takes (thickness k)^2 / 2 of the transmission: 1e-8 of it at thickness 1e4."""

    def c(thickness: float) -> float:
        asked = request([vrte.Layer(RAYLEIGH, 1.0, thickness)], None, 0, [(0, 0.0), (0, thickness)], 2)
        answer: Answer = field_order(asked)
        return sensitivity(asked, answer, np.abs(answer.radiance[..., 0]).max(axis=(0, 2)))

    assert 1e-17 < c(1.0) < 1e-15
    assert 1e-9 < c(1e4) < 1e-7
