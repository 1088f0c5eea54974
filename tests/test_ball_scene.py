"""The oracle of whole scenes against what else there is, and both algorithms against the oracle."""

import math

import numpy as np
import pytest

import vrte
from tests import exact

from .ball_oracle import brdf_order
from .ball_scene import Answer, Layer, Request, field_order, mueller_lobe_orders, sensitivity
from .oracle import brdf_orders
from .samples import BOTH, spheroids

WIDTH_DEG, AMPLITUDE = 5.0, 3.0
LOBE = np.array([[1.0, 0.3, 0, 0], [0.3, 1.0, 0, 0], [0, 0, 0.8, 0.4], [0, 0, -0.4, 0.8]])
MU = (0.35, 1.0, 1e-3, -0.35, -1.0, -1e-3)
STOKES = (1.0, 0.3, 0.2, 0.1)


def lobe(mu_i: np.ndarray, mu_o: np.ndarray, phi_deg: np.ndarray) -> np.ndarray:
    """The lobe whose Fourier orders `mueller_lobe_orders` knows."""
    sines = np.sqrt((1 - mu_i**2) * (1 - mu_o**2))
    away = 1 - mu_i * mu_o - sines * np.cos(np.radians(phi_deg))
    return AMPLITUDE * np.exp(-away / math.radians(WIDTH_DEG) ** 2)[..., None, None] * LOBE


def request(layers: list[vrte.Layer], base: object, m: int, levels: list[tuple[int, float]], nodes: int) -> Request:
    known = {None: None, "lobe": mueller_lobe_orders(WIDTH_DEG, AMPLITUDE, LOBE)}
    return Request(
        order=m,
        layers=tuple(Layer(layer.phase_matrix.coefficients, layer.albedo, layer.thickness) for layer in layers),
        base=known.get(base, base),
        mu0=0.6,
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
    "two layers over a grey base": ([(spheroids(), 0.9, 0.7), (vrte.rayleigh(), 0.99, 1.5)], 0.3),
    "a lobe as the base": ([(spheroids(), 0.9, 0.7)], "lobe"),
    "endless": ([(vrte.rayleigh(), 0.5, 0.2), (spheroids(), 0.99, math.inf)], None),
    "endless and conservative": ([(spheroids(), 1.0, math.inf)], None),
    "more terms than the nodes carry": ([(vrte.henyey_greenstein(0.6, 40), 0.9, 1.0)], None),
    "thick, conservative, over white": ([(spheroids(), 1.0, 1e4), (vrte.rayleigh(), 1.0, 1e-3)], 1.0),
    "faint light": ([(spheroids(), 0.5, 60.0)], None),
    "a clear layer between": ([(spheroids(), 0.9, 0.5), (vrte.isotropic(), 0.0, 2.0), (spheroids(), 0.9, 0.5)], 0.1),
}


@BOTH
@pytest.mark.parametrize("name", list(SCENES))
def test_both_algorithms_inside_and_out(name: str, algorithm: str) -> None:
    """Up, down, at every depth, and fluxes."""
    numbers, base = SCENES[name]
    layers = [vrte.Layer(*layer) for layer in numbers]
    levels = [(0, 0.0), (0, 0.1), (len(layers) - 1, 0.3 if math.isinf(layers[-1].thickness) else layers[-1].thickness)]
    above = np.cumsum([0.0, *(layer.thickness for layer in layers[:-1])])
    bases = {None: None, "lobe": vrte.MuellerBase(lobe)}
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


def test_the_oracles_agree() -> None:
    """One slab as `ball_oracle` has it; two slabs over a base as the literal program in doubles has them."""
    slab = [vrte.Layer(spheroids(), 0.9, 1.3)]
    up, down = brdf_order(1, spheroids().coefficients, 0.9, 1.3, [0.6], [0.35], 8)
    answer = field_order(request(slab, None, 1, [(0, 0.0), (0, 1.3)], 8))
    beam = np.array([1.0, 0.3, 0.0, 0.0])
    np.testing.assert_allclose(answer.radiance[0, 0, 0], 0.6 * up[0, 0] @ beam, atol=1e-16)
    np.testing.assert_allclose(answer.radiance[0, 1, 3], 0.6 * down[0, 0] @ beam, atol=1e-16)
    pile = [*slab, vrte.Layer(vrte.rayleigh(), 0.99, 0.4)]
    literal = [(layer.phase_matrix.coefficients, layer.albedo, layer.thickness) for layer in pile]
    orders, through = brdf_orders(literal, 0.3, np.array([0.6]), np.array([0.35]), 8, 1)
    answer = field_order(request(pile, 0.3, 0, [(0, 0.0), (1, 0.4)], 8))
    np.testing.assert_allclose(answer.radiance[0, 0, 0], 0.6 * orders[0, 0, 0] @ beam, atol=1e-14)
    np.testing.assert_allclose(answer.radiance[0, 1, 3], 0.6 * through[0, 0, 0] @ beam, atol=1e-14)


def test_a_last_place_of_a_conservative_layer_is_worth_its_thickness() -> None:
    """omega = 1 - 1e-16 instead of 1 takes (thickness k)^2 / 2 of the transmission: 1e-8 of it at thickness 1e4."""

    def c(thickness: float) -> float:
        asked = request([vrte.Layer(vrte.rayleigh(), 1.0, thickness)], None, 0, [(0, 0.0), (0, thickness)], 2)
        answer: Answer = field_order(asked)
        return sensitivity(asked, answer, np.abs(answer.radiance[..., 0]).max(axis=(0, 2)))

    assert 1e-17 < c(1.0) < 1e-15
    assert 1e-9 < c(1e4) < 1e-7
