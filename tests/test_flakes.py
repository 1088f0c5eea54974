"""Oriented flakes: extinction, scattering from Jones vectors in three dimensions, and what is refused."""

from itertools import product
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.basics.arrays import Array
from vrte.basics.quadrature import find_gauss_legendre, make_refracted_nodes
from vrte.optics.facet_integrals import find_cosines, interpolate_nodes, list_panels
from vrte.optics.facets import RoughSurface
from vrte.optics.flake_orders import gather_flake_orders, integrate_azimuths, reverse_orders
from vrte.optics.flakes import Flakes

from .helpers import assert_close
from .test_discrete_ordinates import frame, mueller_of

METAL = vrte.flakes(1.2 + 7.0j, tilt_deg=15.0, host_index=1.5)
TABLE = Flakes(0.3 + 3.0j, None, ((0.0, 20.0, 45.0), (1.0, 0.8, 0.0)))
TINTED = vrte.flakes(1.2 + 7.0j, wavelength_um=0.5, host_index=1.5 + 1e-4j)
POWDER = vrte.spheres(1.5, radius_um=0.05, wavelength_um=0.5)
ALL = [METAL, TABLE, vrte.flakes(tilt_deg=8.0), vrte.flakes(1.33, tilt_deg=40.0)]
# handbook: by another program
PROJECTED = {8.0: [0.10997363, 0.20548919, 0.49038395, 0.78460446, 0.98075558],
             15.0: [0.19970175, 0.25193156, 0.47184908, 0.74762691, 0.93449507]}  # fmt: skip


def scatter(flakes: Flakes, mu: float, mu_in: float, phi: float) -> Array:
    """Z from Jones vectors in three dimensions: no rotation angle."""
    (w, *out), (w_in, *into) = frame(mu, phi), frame(mu_in, 0.0)
    normal = (w - w_in) / np.linalg.norm(w - w_in)
    across = np.cross(w_in, normal)
    across /= np.linalg.norm(across)
    r_p, r_s = flakes.reflect(abs(w_in @ normal))
    along, along_in = np.cross(across, w), np.cross(across, w_in)
    jones = r_p * np.outer(out @ along, into @ along_in) + r_s * np.outer(out @ across, into @ across)
    tilt = np.arctan2(np.hypot(*normal[:2]), abs(normal[2]))
    return 0.25 * flakes.find_density(tilt) * mueller_of(jones)


@pytest.mark.parametrize("tilt", PROJECTED)
def test_extinction_agrees_with_another_program(tilt: float) -> None:
    found = vrte.flakes(tilt_deg=tilt).project([0.0, 0.2, 0.5, 0.8, 1.0])
    assert_close(found, PROJECTED[tilt], rtol=0.0, atol=5e-8)  # their sums miss the kink by that


@pytest.mark.parametrize("flakes", ALL)
def test_extinction_is_the_integral_over_normals(flakes: Flakes) -> None:
    """By a plain sum over tilt and azimuth, to what |w.m| with its kink leaves; the density is normalised."""
    x, weights = find_gauss_legendre(4000)
    tilt, weights = 0.25 * np.pi * (x + 1.0), 0.25 * np.pi * weights
    density = weights * np.sin(tilt) * flakes.find_density(tilt)
    assert_close(2.0 * np.pi * density.sum(), 1.0, rtol=0.0, atol=1e-6)
    psi = (np.arange(4000) + 0.5) * (2.0 * np.pi / 4000)
    for mu in (0.0, 0.03, 0.6, -0.9, 1.0):
        facing = np.abs(mu * np.cos(tilt)[:, None] + np.sqrt(1.0 - mu * mu) * np.sin(tilt)[:, None] * np.cos(psi))
        assert_close(flakes.project(mu), 2.0 * np.pi * density @ facing.mean(axis=1), rtol=0.0, atol=2e-6)


@pytest.mark.parametrize("flakes", ALL)
def test_scattering_is_that_of_jones_vectors(flakes: Flakes) -> None:
    for mu, mu_in, phi in product((0.9, 0.4, -0.2, -0.8), (0.7, 0.05, -0.3, -0.95), (0.3, 1.2, -2.0, 3.0)):
        expected = scatter(flakes, mu, mu_in, phi)
        assert_close(flakes.scatter(mu, mu_in, phi), expected, rtol=0.0, atol=1e-13 * max(expected[0, 0], 1e-3))


def test_upward_scattering_is_that_of_facets() -> None:
    """f_r = D M/(4 mu_i mu_o) of a rough surface, D and M by their own code."""
    surface = RoughSurface(1.5, 1.2 + 7.0j, 0.3)
    for mu, mu_in, phi in product((0.9, 0.4, 1.0), (0.7, 0.05, 1.0), (0.0, 50.0, 180.0, 300.0)):
        f = surface.reflect(mu_in, mu, phi)
        found = METAL.scatter(mu, -mu_in, np.radians(phi))
        assert_close(found / found[0, 0], f / f[0, 0], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("flakes", ALL)
def test_scattering_is_reciprocal_and_has_a_mirror_symmetry(flakes: Flakes) -> None:
    back, mirror = np.diag([1.0, 1.0, 1.0, -1.0]), np.diag([1.0, 1.0, -1.0, -1.0])
    for mu, mu_in, phi in product((0.9, 0.4, -0.2), (0.7, -0.05, -1.0), (0.3, 1.2, 3.0)):
        z = flakes.scatter(mu, mu_in, phi)
        # light turned round: from -w to -w', the azimuth between them the other way round
        assert_close(flakes.scatter(-mu_in, -mu, phi), back @ z.T @ back, rtol=0.0, atol=1e-14)
        assert_close(flakes.scatter(mu, mu_in, -phi), mirror @ z @ mirror, rtol=0.0, atol=1e-15)
        assert_close(flakes.scatter(-mu, -mu_in, phi), mirror @ z @ mirror, rtol=0.0, atol=1e-14)


PAIRS = [(0.5, -0.5), (0.45, -0.6), (0.1, 0.2), (0.9, 0.95), (1.0, -0.9), (-0.2, -0.3), (0.05, -0.02), (1.0, -1.0)]


@pytest.mark.parametrize("flakes", ALL)
def test_compiled_orders_are_sums_over_azimuth(flakes: Flakes) -> None:
    """Sums in steps, which miss what they can of the edges of a table."""
    count, rtol = (32000, 1e-6) if flakes is TABLE else (8000, 1e-7)
    phi = (np.arange(count) + 0.5) * (2.0 * np.pi / count)
    for mu, mu_in in PAIRS:
        z = flakes.scatter(mu, mu_in, phi)
        even, odd = flakes.scatter_orders(mu, mu_in, 12)
        for m in (0, 1, 2, 11):
            expected = [np.tensordot(turn(m * phi), z, 1) / count for turn in (np.cos, np.sin)]
            assert_close((even[m], odd[m]), expected, rtol=0.0, atol=rtol * z[:, 0, 0].mean() + 1e-15)


def make_panel_nodes(host: float) -> Any:
    return make_refracted_nodes([1.0, host] if host > 1.0 else [1.0], 10)


@pytest.mark.parametrize("host", [1.0, 1.5])
def test_orders_on_nodes_lose_nothing_and_are_reciprocal(host: float) -> None:
    nodes = make_panel_nodes(host)
    mu, weights = nodes.carried(host)
    for flakes in (vrte.flakes(tilt_deg=6.0, host_index=host), vrte.flakes(1.2 + 7.0j, tilt_deg=25.0, host_index=host)):
        found = gather_flake_orders(flakes, nodes, np.array([0.33]), 3, 1e-8)
        kept = np.einsum("dsj,j->d", found[0, :, :, :, 0, 0], weights)[: mu.size]
        if flakes.is_conserving:
            assert_close(kept, flakes.project(mu), rtol=1e-14, atol=0.0)
        assert (kept < flakes.project(mu) * (1.0 + 1e-14)).all()
        back = reverse_orders(found)[:, : mu.size]
        mirror = np.outer([1, 1, -1, -1], [1, 1, -1, -1])
        # between nodes light that is turned round is in the same table: down to down in a mirror, down to up as it is
        assert_close(back[:, :, 0].swapaxes(1, 2) * mirror, found[:, : mu.size, 0], rtol=0.0, atol=1e-15)
        assert_close(back[:, :, 1].swapaxes(1, 2), found[:, : mu.size, 1], rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("first", [1, 4, 9])
def test_orders_in_blocks_are_those_of_all(first: int) -> None:
    """To the rounding of cos(m phi) by recurrence; an odd first order has the other parity."""
    nodes, directions = make_panel_nodes(1.5), np.array([0.33])
    every = gather_flake_orders(METAL, nodes, directions, first + 3, 1e-8)
    some = gather_flake_orders(METAL, nodes, directions, 3, 1e-8, 1, first)
    assert_close(some, every[first:], rtol=0.0, atol=1e-9 * np.abs(every).max())


@pytest.mark.parametrize("host", [1.0, 1.5])
def test_light_is_scattered_into_the_polynomials_of_nodes(host: float) -> None:
    """A plain integral over the cosine in thousands of steps, 2e-6 off at the kink, of single pairs of directions."""
    flakes, nodes, mu_from = vrte.flakes(1.2 + 7.0j, tilt_deg=12.0, host_index=host), make_panel_nodes(host), 0.33
    found = gather_flake_orders(flakes, nodes, np.array([mu_from]), 2, 1e-8)[:, -1]
    back = reverse_orders(found)
    mu_node, weights = nodes.carried(host)
    for own, panel, x_node in list_panels(nodes, host):
        x = (np.arange(4000) + 0.5) / 4000
        depth, rate = panel.spread(x)
        mu = find_cosines(host, panel, depth)
        basis = interpolate_nodes(x_node, x) * (rate / (4000 * host**2 * mu))[:, None] / weights[own]
        odd = basis * (np.sqrt(1.0 - mu**2)[:, None] / np.sqrt(1.0 - mu_node[own] ** 2))
        for way, sign in ((0, -1.0), (1, 1.0)):
            sent = integrate_azimuths(flakes, sign * mu, np.full(mu.size, -mu_from), 2, 1e-10)
            come = integrate_azimuths(flakes, np.full(mu.size, mu_from), -sign * mu, 2, 1e-10)
            for m, weight in ((0, basis), (1, odd)):
                for made, orders in ((found, sent), (back, come)):
                    expected = np.tensordot(weight, orders[:, m], (0, 0)).reshape(-1, 4, 4)
                    assert_close(made[m, way, own], expected, rtol=0.0, atol=1e-5 * np.abs(orders).max())


def test_layers_are_made_in_the_words_of_paint() -> None:
    layer = vrte.Layer.of(METAL, volume_fraction=0.1, flake_thickness_um=0.3, thickness_um=15.0)
    assert layer.flake_area == layer.extent == 0.1 / 0.3 * 15.0
    assert (layer.thickness, layer.host_index) == (0.0, 1.5)
    layer = vrte.Layer.of(TINTED, flake_area=2.0, thickness_um=20.0)
    assert layer.thickness == 20.0 * TINTED.host_absorption > 0.0
    beside = vrte.Layer.of(POWDER, 1.0, flakes=vrte.flakes(), flake_area=2.0)
    assert (beside.extent, beside.phase_matrix) == (3.0, POWDER.phase_matrix)
    assert vrte.Scene([vrte.Layer.of(METAL, flake_area=np.inf)]).thickness == np.inf


def test_a_layer_scales_with_its_thickness() -> None:
    alone, both = vrte.Layer.of(METAL, flake_area=2.0), vrte.Layer(vrte.isotropic(), 0.5, 1.0, None, METAL, 2.0)
    assert alone.scale(1.5).flake_area == 3.0
    assert alone.scale(np.inf).extent == np.inf
    assert (both.scale(2.0).thickness, both.scale(2.0).flake_area) == (2.0, 4.0)
    assert vrte.Layer(vrte.isotropic(), 0.5, 1.0).scale(np.inf).thickness == np.inf
    with pytest.raises(vrte.SceneError, match="side by side cannot be semi-infinite"):
        both.scale(np.inf)


def test_a_film_of_flakes_hides_and_has_no_k_and_s() -> None:
    film = {"flakes": {"index": [1.0, 6.0]}, "volume_fraction": 0.05, "flake_thickness_um": 0.3, "thickness_um": 6.0}
    content = {"wavelength_um": 0.55, "paint": {**film, "binder": 1.5, "surface": "none"}}
    look = vrte.appearance(content, np.linspace(0.4, 0.72, 9), ["45:0"], nodes=4)
    thin, thick = (look.panel.scale_film(times).scenes[0].layers[0].extent for times in (1.0, 2.5))
    assert thick == 2.5 * thin == 2.5 * 0.05 / 0.3 * 6.0
    found = look.hiding()
    assert 0.5 < found.contrast_ratio < 1.0
    with pytest.raises(vrte.SceneError, match="K and S are of light that is even inside the film, and flakes"):
        look.kubelka_munk()


def test_a_method_without_flakes_refuses_them_by_name() -> None:
    scene = vrte.Scene([vrte.Layer(vrte.isotropic(), 0.5, 1.0, None, METAL, 2.0)])
    assert scene.thickness == 3.0
    with pytest.raises(vrte.SceneError, match="method 'diffusion' takes no oriented flakes: ask for"):
        vrte.brdf(scene, 0.5, 0.5, method="diffusion")
