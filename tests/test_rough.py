"""Rough interfaces: the published rough sea over water, limits, energy."""

from functools import partial
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.basics.arrays import Array
from vrte.basics.quadrature import make_refracted_nodes
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders import discretise
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.orders.refracting import Refracting
from vrte.discrete_ordinates.orders.rough import FacetOrders
from vrte.discrete_ordinates.orders.routes import make_route
from vrte.discrete_ordinates.orders.single_interface import TOGETHER
from vrte.discrete_ordinates.orders.slab_response import respond
from vrte.optics.facets import RoughSurface

from .helpers import assert_close, close_to

SEA = vrte.Interface(1.0, 1.34, np.sqrt(0.003 + 0.00512 * 7.0), shadowing=False)  # as published; wind of 7 m/s
# Chowdhary et al., JQSRT 242, 106717 (2020), system AOS-II, sun at 30 degrees: scattering, absorption per metre of
# 100 m of water; then phi, zenith angle, I, Q, U of pi L/(mu0 F0) just above the sea, phi and U in our signs
PUBLISHED = {
    (0.0134, 0.0204): [(0, 0, 0.081708, -0.006077, 0.0), (0, 30, 0.236252, -0.095960, 0.0)],
    (0.0010, 0.3400): [(60, 20, 0.040691, -0.001835, -0.008909), (120, 10, 0.012691, 0.000920, 0.000425)],
}


def test_the_rough_sea_over_water_that_is_published() -> None:
    """AOS-II: with 24 nodes or 48, all of its four wavelengths and directions are within 3.3e-6."""
    for (scattering, absorption), rows in PUBLISHED.items():
        thickness = 100.0 * (scattering + absorption)
        water = vrte.Layer(vrte.rayleigh(), scattering / (scattering + absorption), thickness)
        for phi, angle, *expected in rows:
            mu0, mu = np.cos(np.radians([30.0, angle]))
            found = np.pi * vrte.brdf(vrte.Scene([SEA, water]), mu0, mu, phi, nodes=24).mueller[0, 0, 0, :3, 0]
            assert_close(found, expected, rtol=0.0, atol=5e-6)


def test_what_the_last_surface_lets_through_takes_no_orders(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its lobe is narrow, and meets particles of few terms alone: as many orders as that has change nothing."""
    found = []
    for albedo, width in ((0.9, None), (0.9 + 1e-12, 0.1)):
        if width is not None:
            monkeypatch.setattr(discretise, "find_lobe_width", lambda interface, goes_on, width=width: width)
        layers = [vrte.Layer(vrte.rayleigh(), albedo, thickness) for thickness in (0.3, 1.0)]
        stack = [vrte.Interface(1.0, 1.5), layers[0], vrte.Interface(1.5, 1.33, 0.3), layers[1]]
        found.append(vrte.brdf(vrte.Scene(stack), [0.2, 0.9], [0.3, 0.8], [0.0, 70.0], nodes=8))
    few, many = found
    assert (few.diagnostics["orders"], many.diagnostics["orders"]) == (34, 60)
    assert_close(few.mueller, many.mueller, rtol=0.0, atol=1e-9 * many.mueller.max())


HAZE, AIR = vrte.Layer(vrte.henyey_greenstein(0.6, 24), 0.95, 0.7), vrte.Layer(vrte.rayleigh(), 1.0, 0.4)
GOLD = vrte.Layer(vrte.spheres("gold", radius_um=0.1, wavelength_um=0.64).phase_matrix, 0.9, np.inf)


@pytest.mark.parametrize("under", [False, True])
@pytest.mark.parametrize(
    ("layers", "base", "tau"),
    [
        ([vrte.Interface(1.0, 1.5, 0.2), HAZE], None, [0.0]),
        ([vrte.Interface(1.0, 1.5, 0.3, "ggx"), AIR, HAZE, AIR], vrte.Lambertian(0.5), [0.0, 0.2, 0.9]),
        ([vrte.Interface(1.5, 1.0, 0.3), HAZE, AIR], vrte.Lambertian(0.5), [0.0, 0.4, 1.1]),
        ([vrte.Interface(1.3, 1.5, 0.3, conserving=False), GOLD], None, [0.0, 0.4]),
        ([SEA, AIR], vrte.Facets(0.2 + 3.0j, 0.4), [0.0]),
    ],
)
def test_a_boundary_condition_is_what_joins_find(layers: list[Any], base: Any, tau: list[float], under: bool) -> None:
    """Modes under a rough surface, against slabs and interfaces joined by the star product, order by order."""
    directions = np.array([0.3, 0.8]), np.eye(4), np.array([0.2, 0.9, 1.0, -0.5, -0.9]), np.array(tau)
    scene, first = vrte.Scene(layers, base), np.arange(len(tau)) < under
    problem, orders = discretise_scene(scene, *directions, 8, under=first), np.arange(6, dtype=np.int32)
    slabs = partial(respond, "modes", quick=True)
    found = make_route("modes", problem, scene.below, 1 + TOGETHER, 1e-8).solve(orders, Run(1))
    expected = Refracting(slabs, problem, scene.below, 1 + TOGETHER, 1e-8).solve(orders, Run(1))
    assert_close(found.kernels, expected.kernels, rtol=0.0, atol=1e-13 * expected.kernels.max())
    for name in ("flux_up", "flux_down"):  # by integrals of order 0 alone, to their accuracy
        assert_close(getattr(found, name), getattr(expected, name), rtol=0.0, atol=1e-10)
    assert max(float(values.max()) for values in found.residuals.values()) < 1e-13


@pytest.mark.parametrize("indices", [(1.0, 1.5), (1.5, 1.0), (1.33, 1.5)])
def test_the_limit_is_the_smooth_interface(indices: tuple[float, float]) -> None:
    """Scattered light is refracted as Fresnel and Snell say, to some alpha^2, also beside total reflection."""
    mu, layer = [0.15, 0.3, 0.6, 0.8, 0.9, 0.97], vrte.Layer(vrte.rayleigh(), 0.9, 0.5)
    surfaces = [vrte.Interface(*indices, alpha) for alpha in (0.0, 0.01, 0.001)]
    smooth, *rough = (
        vrte.brdf(vrte.Scene([surface, layer], vrte.Lambertian(0.3)), mu, mu, [0.0, 60.0, 180.0], nodes=40)
        for surface in surfaces
    )
    for found, allowed in zip(rough, (2e-3, 1e-4), strict=True):
        assert_close(found.mueller - found.surface, smooth.mueller, rtol=0.0, atol=allowed * smooth.mueller.max())


@pytest.mark.parametrize("distribution", ["beckmann", "ggx"])
def test_a_beam_s_power_into_nodes_is_that_of_all_its_facets(distribution: str) -> None:
    """By another quadrature."""
    surface = vrte.Interface(1.0, 1.5, 0.3, distribution, conserving=False)
    nodes, beam = make_refracted_nodes([1.0, 1.5], 24), np.array([0.6])
    facets = FacetOrders(surface.facets, nodes, 1e-8)
    (mu, weights), (mu_below, weights_below) = nodes.carried(1.0), nodes.carried(1.5)
    power = weights * mu @ facets.sent(False, beam, 1)[0, 0, :, 0, 0]
    power += weights_below * mu_below @ facets.sent(True, beam, 1)[0, 0, :, 0, 0]
    x, weight = np.polynomial.legendre.leggauss(80)
    mu_o = np.concatenate([edge + size * 0.5 * (x + 1.0) for edge, size in ((0.0, 0.4), (0.4, 0.6))])  # 0.6 = 1.5 0.4:
    fraction = np.concatenate([0.2 * weight, 0.3 * weight]) * mu_o  # upright facets
    phi = (np.arange(400) + 0.5) * 360.0 / 400
    surface = RoughSurface(1.0, 1.5, 0.3, distribution, shadowing=True)
    ways = [f(0.6, mu_o[:, None], phi) for f in (surface.reflect, surface.transmit)]
    expected = 2.0 * np.pi * fraction @ sum(way[..., 0, 0].mean(axis=1) for way in ways)
    assert power == close_to(expected, rtol=0.0, atol=2e-6)
    assert 0.9 < power < 1.0


@pytest.mark.parametrize(("index", "roughness", "distribution"), [(1.5, 0.3, "beckmann"), (1.1, 1.0, "ggx")])
def test_single_bounces_lose_energy_that_can_be_given_back(index: float, roughness: float, distribution: Any) -> None:
    once = vrte.Interface(1.0, index, roughness, distribution, conserving=False)
    kept = vrte.Interface(1.0, index, roughness, distribution)
    mu = np.array([0.02, 0.1, 0.5, 1.0])
    for surface in (once, once.turned):
        total = np.sum(surface.share(mu), axis=0)
        assert (total < 1.0).all()
        assert total.min() < 0.96
    for surface in (kept, kept.turned):
        assert_close(np.sum(surface.share(mu), axis=0), 1.0, rtol=0.0, atol=1e-14)
    assert_close(vrte.Interface(1.5, 1.0).share([0.5, 1.0]), [(1.0, 0.04), (0.0, 0.96)], rtol=0.0, atol=1e-15)
    there, back = kept.facets.transmit(0.3, 0.8, 20.0), kept.turned.facets.transmit(0.8, 0.3, 20.0)
    assert there[0, 0] / index**2 == close_to(back[0, 0], rtol=1e-12, atol=0.0)
    nodes, beam = make_refracted_nodes([1.0, index], 24), np.array([0.3])
    powers = [mu * weights for mu, weights in (nodes.carried(1.0), nodes.carried(index))]
    for facets, (here, there) in ((kept.facets, powers), (kept.turned.facets, powers[::-1])):
        ways = FacetOrders(facets, nodes, 1e-8)
        total = ways.sent(False, beam, 1)[0, 0, :, 0, 0] @ here + ways.sent(True, beam, 1)[0, 0, :, 0, 0] @ there
        assert total == close_to(1.0, rtol=0.0, atol=5e-5)


@pytest.mark.parametrize(
    ("roughness", "distribution"),
    [
        (0.05, "beckmann"),
        (1.5, "ggx"),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in ((0.2, "beckmann"), (1.5, "beckmann"), (0.05, "ggx"), (0.2, "ggx"))
        ),
    ],
)
def test_the_limit_of_equal_indices_is_no_surface(roughness: float, distribution: Any) -> None:
    """n - 1 = 1e-5, light scattered below: 1e-3, or what Snell's law makes of it (3.4e-3 at mu = 0.05 in and out)."""
    layer, mu = vrte.Layer(vrte.rayleigh(), 0.9, 0.3), [0.05, 0.1, 0.3, 1.0]

    def scatter(*surface: vrte.Interface) -> Array:
        f = vrte.brdf(vrte.Scene([*surface, layer]), mu, mu, [0.0, 60.0, 180.0], nodes=24)
        mirrored = 0.0 if f.surface is None else f.surface
        return (f.mueller - mirrored)[..., 0, 0]

    rough = vrte.Interface(1.0, 1.00001, roughness, distribution)
    plain = scatter()
    bent = np.abs(scatter(vrte.Interface(1.0, 1.00001)) / plain - 1.0)
    assert (np.abs(scatter(rough) / plain - 1.0) <= np.maximum(1e-3, 1.05 * bent)).all()
    for surface in (rough, rough.turned):
        assert_close(np.sum(surface.share([0.01, *mu]), axis=0), 1.0, rtol=0.0, atol=1e-5)
        assert surface.share(mu)[1].min() > 0.998


def test_narrow_lobes_are_seen_whole_from_straight_above_and_many_directions_come_from_a_table() -> None:
    for index, roughness in ((1.000001, 0.01), (1.00001, 0.05), (1.001, 0.2)):
        surface = vrte.Interface(1.0, index, roughness, conserving=False)
        assert_close(np.sum(surface.share([1.0, 1.0 - 1e-12, 0.999999]), axis=0), 1.0, rtol=0.0, atol=1e-4)
    facets, mu = vrte.Interface(1.0, 1.0 / 1.5, 0.3, "ggx").facets, np.linspace(0.003, 1.0, 600)
    few = facets.reflect(mu[::40], 0.6, 20.0)
    assert_close(facets.reflect(mu, 0.6, 20.0)[::40], few, rtol=0.0, atol=1e-6)


def test_white_stays_white_under_facets_that_conserve() -> None:
    """Rayleigh's light inside is polarized, and loses another share of itself than unpolarized light."""
    base, layer = vrte.Lambertian(1.0), vrte.Layer(vrte.rayleigh(), 1.0, 1.0)
    for conserving, allowed in ((True, 2e-5), (False, 0.4)):
        surface = vrte.Interface(1.0, 1.5, 0.5, conserving=conserving)
        f = vrte.brdf(vrte.Scene([surface, layer], base), mu_i=[0.2, 1.0], mu_o=0.5, phi=0.0, nodes=24)
        assert_close(f.reflectance, 1.0, rtol=0.0, atol=allowed)
    assert f.reflectance.max() < 0.8


@pytest.mark.parametrize("seed", range(6))
def test_orders_left_out_under_facets_are_faint(seed: int) -> None:
    """Random paints under random facets: no order exceeds its bound, and the light it is compared with is there."""
    rng = np.random.default_rng(seed)
    index, alpha = rng.uniform(1.2, 2.2), 10.0 ** rng.uniform(-1.2, 0.0)
    kind: Any = rng.choice(["beckmann", "ggx"])
    media = (1.0, index) if seed % 3 else (index, 1.0)
    surface = vrte.Interface(*media, alpha, kind, conserving=bool(seed % 2))
    phases = [vrte.rayleigh(0.1), vrte.henyey_greenstein(rng.uniform(0.2, 0.8), 24)]
    layers = [vrte.Layer(phase, rng.uniform(0.5, 1.0), 10.0 ** rng.uniform(-2.0, 1.5)) for phase in phases]
    scene = vrte.Scene([surface, *layers], vrte.Lambertian(0.4) if seed % 2 else None)
    mu, asked = [0.1, 0.6, 1.0], {"nodes": 8, "accuracy": 1e-5}
    plan = vrte.plan("brdf", scene, mu, mu, [0.0, 70.0, 180.0], **asked)
    problem, last = plan.problem, plan.problem.coefficients.shape[1]
    found = make_route("modes", problem, scene.below, last, 1e-8).solve(np.arange(last, dtype=np.int32), Run(1))
    largest = np.abs(found.kernels).max(axis=(3, 4, 5))
    np.testing.assert_array_less(largest[1:], plan.bounds[0, 1:] + 1e-9)  # the normal is 1e-8 off
    assert [block.stokes for block in plan.blocks[:2]] == [(0, 1), (2, 3)]
    assert (plan.brightest[0, 0] <= np.abs(found.kernels[0, 0, :, 0, :, 0]).max(axis=1)).all()


def test_lobes_that_no_order_resolves_between_surfaces_are_not_promised() -> None:
    """A single surface sees them in closed form."""
    layer, back = vrte.Layer(vrte.rayleigh(), 1.0, 0.3), vrte.Interface(1.5, 1.0)
    for alpha, under, promised in ((0.05, [back], False), (0.2, [back], True), (0.001, [], True)):
        scene = vrte.Scene([vrte.Interface(1.0, 1.5, alpha), layer, *under])
        notes = vrte.plan("brdf", scene, 0.5, 0.5, nodes=4).notes
        assert any("of which 256 are solved for" in note for note in notes) != promised
