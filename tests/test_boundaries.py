"""What bounds a pile answers for itself: the four that there are, and one of a user's own."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.formats.bases import BASES
from vrte.formats.keys import FilePath
from vrte.methods import find_method
from vrte.request.how import EXACT, METHODS
from vrte.scene.boundary import BLACK, TRANSPARENT, Boundary, Lambertian, MuellerBase, make_azimuth_rule

from .helpers import assert_close
from .samples import spheroids

DIRECTIONS: dict[str, Any] = {"mu_i": [0.3, 0.9], "mu_o": [0.2, 1.0], "phi": [0.0, 70.0]}
PILE = [vrte.Layer(vrte.rayleigh(), 0.9, 0.4)]
FOUR = [BLACK, TRANSPARENT, Lambertian(0.3), MuellerBase(lambda mu_i, mu_o, phi: np.diag([0.1, 0.05, 0.05, 0.02]))]


@dataclass(frozen=True)
class Grey(Boundary):
    """Reflects half of the light evenly, as a third party would write it."""

    orders_reflected = 1

    @property
    def even_albedo(self) -> float:
        return 0.5

    def reflect(self, mu_i: Any, mu_o: Any, phi_deg: Any) -> Any:
        return np.array([[0.5 / np.pi]])

    def reflect_orders(self, mu_i: Any, mu_o: Any, pairs: Any, n_order: int, allowed: Any) -> Any:
        orders = np.zeros((1, mu_i.size, mu_o.size, 4, 4))
        orders[..., 0, 0] = 1.0
        return orders, 0


@pytest.mark.parametrize("boundary", FOUR, ids=lambda one: one.name)
def test_orders_add_up_to_the_reflection_of_a_beam(boundary: Boundary) -> None:
    """R^m, (1:35), summed over azimuth gives back f, and what is not reflected is said to be none."""
    mu_i, mu_o, phi = np.array([0.3, 0.8]), np.array([0.5, 0.9]), np.array([0.0, 40.0, 180.0])
    pairs = np.ones((2, 2), bool)
    orders, _ = boundary.reflect_orders(mu_i, mu_o, pairs, 8, lambda size: 1e-12 * (1.0 + size))
    assert len(orders) <= boundary.orders_reflected
    weight = np.where(np.arange(len(orders)) > 0, 2.0, 1.0)[:, None] / (2.0 * np.pi)
    summed = np.einsum("mp,mioab->iopab", weight * np.cos(np.arange(len(orders))[:, None] * np.radians(phi)), orders)
    f = boundary.reflect(mu_i[:, None, None], mu_o[:, None], phi)
    seen = f.shape[-1]
    assert_close(summed[..., :seen, :seen], np.broadcast_to(f, summed[..., :seen, :seen].shape), rtol=0.0, atol=1e-13)
    assert not summed[..., seen:, :].any()


NAMED = {
    kind: row.make(**{name: key.start for name, key in row.keys.items() if key.needed})
    for kind, row in BASES.items()
    if not any(isinstance(key, FilePath) for key in row.keys.values())
}


@pytest.mark.parametrize("kind", [kind for kind, base in NAMED.items() if base is not None])
def test_orders_of_every_named_base_are_the_integrals_of_its_reflection(kind: str) -> None:
    """R^m, (1:35), by a literal sum over azimuths; half of it is the share of light that comes back, at most 1."""
    base = NAMED[kind]
    assert base is not None
    mu_i, mu_o, n_order = np.array([0.25, 0.8]), np.array([0.4, 0.95]), 4
    pairs = np.ones((2, 2), bool)
    orders, _ = base.reflect_orders(mu_i, mu_o, pairs, n_order, lambda size: 1e-9 * (1.0 + size))
    phi, weight = make_azimuth_rule(np.arange(1, 8192), 8192)
    f = np.zeros((phi.size, 2, 2, 4, 4))
    found = base.reflect(mu_i[:, None], mu_o, np.degrees(phi)[:, None, None])
    seen = found.shape[-1]
    f[..., :seen, :seen] = found
    for m in range(n_order):
        cosine, sine = (np.einsum("p,pioab->ioab", 2.0 * weight * wave(m * phi), f) for wave in (np.cos, np.sin))
        expected = cosine.copy()
        expected[..., 2:, :2], expected[..., :2, 2:] = sine[..., 2:, :2], -sine[..., :2, 2:]
        given = orders[m] if m < len(orders) else np.zeros((2, 2, 4, 4))
        assert_close(given, expected, rtol=0.0, atol=2e-7 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize("algorithm", ["modes", "doubling"])
def test_light_over_a_base_that_mixes_stokes_is_reciprocal(algorithm: str) -> None:
    """f(mu_o, mu_i) = P f(mu_i, mu_o)^T P, P = diag(1, 1, 1, -1), as the base's own: light scattered once."""
    low = vrte.Scene([vrte.Layer(spheroids(), 0.9, 1.0)])

    def reflect(mu_i: Any, mu_o: Any, phi_deg: Any) -> np.ndarray:
        given = (np.unique(axis, return_inverse=True) for axis in np.broadcast_arrays(mu_i, mu_o, phi_deg))
        axes, index = zip(*given, strict=True)
        return vrte.brdf(low, *axes, method="single-scattering").mueller[index]

    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 0.3)], MuellerBase(reflect))
    f = vrte.brdf(scene, [0.3, 0.8], [0.3, 0.8], [0.0, 50.0, 130.0], nodes=6, algorithm=algorithm).mueller
    P = np.diag([1.0, 1.0, 1.0, -1.0])
    assert_close(f, P @ f.transpose(1, 0, 2, 4, 3) @ P, rtol=0.0, atol=1e-12 * f.max())


def test_light_goes_straight_through_what_is_transparent_alone() -> None:
    assert [bool(one.transmit_straight(np.array([0.4])).any()) for one in FOUR] == [False, True, False, False]
    assert vrte.Scene(PILE).above is TRANSPARENT


def test_what_no_light_reaches_is_black() -> None:
    endless = vrte.Layer(vrte.rayleigh(), 0.9, np.inf)
    assert vrte.Scene([endless], Lambertian(0.5)).below is BLACK
    assert vrte.Scene(PILE, Lambertian(0.5)).below == Lambertian(0.5)


def test_a_boundary_of_ones_own() -> None:
    """The same bits as the one of the house that does the same, by every method that takes it."""
    for method in METHODS:
        if method != EXACT and find_method(method).base == "none":
            continue
        how: dict[str, Any] = {"method": method} | ({"nodes": 6} if method not in ("diffusion", "two-stream") else {})
        pile = [vrte.Layer(vrte.henyey_greenstein(0.3, 8), 0.9, 0.4)]
        found, expected = (vrte.brdf(vrte.Scene(pile, base), **DIRECTIONS, **how) for base in (Grey(), Lambertian(0.5)))
        assert np.array_equal(found.mueller, expected.mueller), method


@pytest.mark.parametrize("method", [name for name in METHODS if name != EXACT and find_method(name).base != "any"])
def test_a_method_refuses_the_boundaries_that_it_does_not_take(method: str) -> None:
    base = Lambertian(0.5) if find_method(method).base == "none" else FOUR[3]
    with pytest.raises(vrte.SceneError, match=f"method '{method}' takes no base"):
        vrte.brdf(vrte.Scene([vrte.Layer(vrte.isotropic(), 0.9, 0.4)], base), **DIRECTIONS, method=method)
