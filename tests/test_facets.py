"""Facets in closed form, against 3-D Jones vectors, and what they do to light."""

from typing import Any

import numpy as np
import pytest

import vrte
from vrte.basics.arrays import Array
from vrte.basics.quadrature import make_double_gauss, make_refracted_nodes
from vrte.basics.running import Run
from vrte.optics.facet_energy import find_lost, share_bounces
from vrte.optics.facet_integrals import gather_orders
from vrte.optics.facets import RoughSurface, shade_facets
from vrte.scene.boundary import PAULI

from .helpers import assert_close, close_to

D, Q = np.diag([1.0, 1.0, -1.0, -1.0]), np.diag([1.0, 1.0, 1.0, -1.0])
SURFACES = [
    RoughSurface(1.0, 1.5, 0.3),
    RoughSurface(1.34, 1.0, 0.2),
    RoughSurface(1.0, 1.0 / 1.5, 0.7, "ggx", shadowing=True),
    RoughSurface(1.2, 0.2 + 3.0j, 1.0, "ggx"),
]
AIR = vrte.Layer(vrte.rayleigh(), 1.0, 0.4)
SEEN: dict[str, Any] = {"mu_i": [0.5, 0.9], "mu_o": [0.2, 0.6, 0.95], "phi": [0.0, 90.0, 130.0, 180.0]}


def frame(mu: float, phi: float) -> tuple[Array, Array, Array]:
    """Direction of travel of signed cosine mu, l = theta-hat, r = -phi-hat."""
    sine, c, s = np.sqrt(1.0 - mu * mu), np.cos(phi), np.sin(phi)
    return np.array([sine * c, sine * s, mu]), np.array([mu * c, mu * s, -sine]), np.array([s, -c, 0.0])


def jones(surface: RoughSurface, mu_i: float, mu_o: float, phi: float, through: bool) -> Array:
    """Of Jones vectors in space, by Snell's law of the facet that is found from both directions of travel."""
    n = complex(surface.ratio)
    (k_i, *frame_i), (k_o, *frame_o) = frame(-mu_i, 0.0), frame(-mu_o if through else mu_o, phi)
    h = k_i - n.real * k_o if through else k_o - k_i
    h /= np.linalg.norm(h) * (np.sign(h[2]) or 1.0)
    c_i, c_o = -k_i @ h, -k_o @ h if through else k_o @ h
    if c_i <= 0.0 or c_o <= 0.0 or (through and (n.real - 1.0) * (n.real * c_o - c_i) <= 0.0):
        return np.zeros((4, 4))
    tan2, alpha2 = h[2] ** -2 - 1.0, surface.roughness**2
    p = np.exp(-tan2 / alpha2) if surface.distribution == "beckmann" else (1.0 + tan2 / alpha2) ** -2
    density = p / (np.pi * alpha2 * h[2] ** 4)
    if surface.shadowing:
        density *= np.prod([shade_facets(surface.roughness, surface.distribution, mu) for mu in (mu_i, mu_o)])
    inside = np.sqrt(1.0 - (1.0 - c_i**2) / n**2 + 0j)
    if through:
        parallel, across = 2.0 * c_i / (n * c_i + inside), 2.0 * c_i / (c_i + n * inside)
        factor = c_i * c_o * n.real**2 * density / (mu_i * mu_o * (c_i - n.real * c_o) ** 2) * n.real * c_o / c_i
    else:
        parallel, across = (n * c_i - inside) / (n * c_i + inside), (c_i - n * inside) / (c_i + n * inside)
        factor = density / (4.0 * mu_i * mu_o)
    s = np.cross(k_i, k_o)
    s = s / np.linalg.norm(s) if np.linalg.norm(s) > 1e-12 else frame_i[1]
    p_i, p_o = np.cross(s, k_i), np.cross(s, k_o)
    to = [[parallel * (o @ p_o) * (p_i @ i) + across * (o @ s) * (s @ i) for i in frame_i] for o in frame_o]
    return factor * 0.5 * np.einsum("iab,bc,jcd,ad->ij", PAULI, to, PAULI, np.conj(to)).real


def sample(surface: RoughSurface, through: bool, *directions: Array) -> Array:
    return (surface.transmit if through else surface.reflect)(*directions)


@pytest.mark.parametrize("surface", SURFACES, ids=lambda s: f"{s.ratio:.2g}")
def test_closed_forms_are_those_of_jones_vectors_in_space(surface: RoughSurface) -> None:
    rng = np.random.default_rng(1)
    draws = [(*rng.random(2), rng.uniform(-180, 360)) for _ in range(150)]
    draws += [(1.0, 1.0, 37.0), (1.0, 0.6, 50.0), (0.6, 0.6, 180.0), (0.6, 0.6, 0.0), (1.0 - 1e-16, 1.0, 90.0)]
    ways = (False, True) if complex(surface.index).imag == 0.0 else (False,)
    for through in ways:
        lit = 0
        for mu_i, mu_o, phi in draws:
            expected = jones(surface, mu_i, mu_o, np.radians(phi), through)
            found = sample(surface, through, mu_i, mu_o, phi)  # type: ignore[arg-type]
            lit += found[0, 0] > 0.0
            assert_close(found, expected, rtol=1e-9, atol=1e-11 * max(expected[0, 0], 1e-200))
        assert lit > 20


BASES = [
    (vrte.Facets(1.34, 0.197, shadowing=False), 20, 1e-9, 1e-8),
    (vrte.Facets((0.2, 3.0), 0.5, "ggx"), 20, 1e-9, 1e-8),
    (vrte.Facets((0.2, 3.0), 0.5, "ggx", True, True), 16, 1e-8, 1e-6),
]


@pytest.mark.parametrize(("base", "nodes", "accuracy", "allowed"), BASES)
def test_a_function_with_the_same_facets_gives_the_same_light(
    base: vrte.Facets, nodes: int, accuracy: float, allowed: float
) -> None:
    """Azimuths by an adaptive rule for any function there, nodes as sampling points: wide lobes are no harder."""
    scenes = [vrte.Scene([AIR], base), vrte.Scene([AIR], vrte.MuellerBase(base.reflect))]
    facets, function = (vrte.brdf(scene, **SEEN, nodes=nodes, accuracy=accuracy).mueller for scene in scenes)
    assert np.abs(facets - function).max() <= allowed * function.max()


@pytest.mark.parametrize("distribution", ["beckmann", "ggx"])
def test_narrow_lobes_need_no_more_nodes(distribution: Any) -> None:
    scene = vrte.Scene([AIR], vrte.Facets(1.34, 0.03, distribution))
    few, many = (vrte.brdf(scene, **SEEN, nodes=nodes, accuracy=1e-8).mueller for nodes in (16, 40))
    mirrored = np.abs(many) > 0.5 * np.abs(many).max()  # the lobe itself is closed form
    assert np.abs(few - many)[~mirrored].max() <= 1e-5 * np.abs(many[~mirrored]).max()


def test_the_index_of_facets_is_over_that_of_the_medium() -> None:
    inside = vrte.Layer(vrte.rayleigh(), 1.0, 0.4, host_index=1.5)
    binder, air = vrte.Scene([inside], vrte.Facets(2.4, 0.3)), vrte.Scene([AIR], vrte.Facets(2.4 / 1.5, 0.3))
    assert binder.below == binder.base
    found, expected = (vrte.brdf(scene, **SEEN, nodes=8).mueller for scene in (binder, air))
    assert_close(found, expected, rtol=0.0, atol=1e-13 * expected.max())


def test_what_bounces_between_facets_is_given_back() -> None:
    """All of it where facets reflect everything, less of it where each bounce takes its share; f stays reciprocal."""
    mu = [0.1, 0.5, 1.0]
    once, all_ = (vrte.Facets((0.2, 3.0), 0.5, "ggx", True, conserving) for conserving in (False, True))
    assert (once.reflectance(mu) < all_.reflectance(mu)).all()
    assert (all_.reflectance(mu) < 0.95).all()  # 0.92 after one bounce at most
    perfect = vrte.Facets((0.001, 1000.0), 0.5, "ggx")
    assert_close(perfect.reflectance(mu), 1.0, rtol=0.0, atol=1e-6)
    there, back = (all_.reflect(np.array(a), np.array(b), np.array(40.0))[0, 0] for a, b in ((0.2, 0.7), (0.7, 0.2)))
    assert there == close_to(back, rtol=1e-12, atol=0.0)


@pytest.mark.parametrize("distribution", ["beckmann", "ggx"])
@pytest.mark.parametrize("roughness", [0.02, 0.3, 1.5])
@pytest.mark.parametrize("index", [1.5, 1.0 / 1.5, 0.2 + 3.0j])
def test_shares_of_single_bounces_are_integrals_over_all_directions(
    index: complex, roughness: float, distribution: Any
) -> None:
    """By angle of incidence on the facets, against outgoing directions and azimuths: reciprocal, so that evenly lit
    facets send these shares along mu."""
    surface = RoughSurface(1.0, index, roughness, distribution, shadowing=True, conserving=True)
    mu = np.array([0.01, 0.3, 0.7, 0.75, 1.0])
    behind = [] if complex(index).imag else [surface.index.real]
    nodes = make_refracted_nodes([1.0, *behind], 8)
    expected = []
    for side, transmitted in [(surface, False), *((surface.turned, True) for _ in behind)]:
        cosines, weights = nodes.carried(side.index_from)
        sent = np.tensordot(
            weights * cosines, gather_orders(side, transmitted, nodes, mu, 1, 1e-9, Run(1))[0, ..., :2, 0], 1
        )
        expected.append(sent * (surface.ratio.real**2 if transmitted else 1.0))
    found = share_bounces(surface, mu)
    for k, part in enumerate(expected):
        assert_close(found[:, 2 * k : 2 * k + 2], part, rtol=0.0, atol=1e-5)
    assert_close(found[:, ::2].sum(axis=1), 1.0, rtol=0.0, atol=1e-7)


@pytest.mark.parametrize("surface", [SURFACES[2], RoughSurface(1.5, 1.0, 0.03, shadowing=True, conserving=True)])
def test_lost_light_is_known_between_cosines_and_of_light_between_nodes(surface: RoughSurface) -> None:
    """As polynomials in pieces; on few nodes as the integral that polynomials through them want."""
    surface = RoughSurface(**{**vars(surface), "conserving": True})
    lost, mu = find_lost(surface), np.linspace(0.01, 1.0, 97)
    assert_close(mu[:, None] * lost.find(mu), mu[:, None] * share_bounces(surface, mu)[:, 4:], rtol=0.0, atol=1e-5)
    nodes = make_refracted_nodes([surface.index_from, surface.index.real], 6)
    cosines, weights = nodes.carried(surface.index_from)
    x, share = make_double_gauss(4000)
    for power in (0, 2):  # polynomials in the cosine below the lowest index only: of one panel there
        if len({panel.high for _, _, panel in nodes.panels if panel.high <= surface.index_from}) == 1 or power == 0:
            expected = share * x ** (1 + power) @ lost.find(x)
            assert_close((weights * cosines ** (1 + power)) @ lost.spread(nodes), expected, rtol=0.0, atol=1e-7)
