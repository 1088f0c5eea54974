"""What instruments read where the answer is known in closed form: even panels, a base under a surface, conservation.

A base of albedo A under a smooth surface of index n: light goes in by T(mu_i), comes out by T(mu_o)/n^2, and of what
the base sends up the share r_i comes back down, which makes it 1/(1 - A r_i) times as much; r_e and r_i are Walsh's.
"""

import math

import numpy as np
import pytest

import vrte
from vrte.appearance.geometries import STANDARD_GEOMETRIES, solve_geometries
from vrte.appearance.panel import Panel, make_panel

from .closed_forms import shares, walsh
from .helpers import close_to

EVEN = [*STANDARD_GEOMETRIES, "di:8", "de:8", "30:60", "60:di", "20:de"]
INDEX = 1.5
R_E, R_I = walsh(INDEX)


def make_even(albedo: float, index: float = 1.0, wavelengths: object = (0.5,), **surface: object) -> Panel:
    """A Lambertian base, bare or under a surface."""
    layer = {"phase": "isotropic", "albedo": 0.0, "thickness": 0.0, "host_index": index}
    pile = [{"interface": {"above": 1.0, "below": index, **surface}}, layer] if index > 1.0 else [layer]
    return make_panel({"layer": pile, "base": {"kind": "lambertian", "albedo": albedo}}, wavelengths)


def read_panel(panel: Panel, *names: str) -> dict[str, float]:
    """Reflectance factors at the first wavelength."""
    return {name: float(values[0]) for name, values in solve_geometries(panel, names)[0].items()}


def let_through(degrees: float) -> float:
    """Share of unpolarized light that the surface lets through at an angle in air."""
    along, across, _ = shares(INDEX, np.array([math.cos(math.radians(degrees))]))[1][:, 0].real
    return float(along + across) / 2.0


def cut_port(degrees: float, wide_deg: float = 10.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cosines, azimuths [degrees] and projected solid angles [sr] (n,) of a quadrature over a round port around the
    mirrored beam, polar in its own axes: nothing of the tested rule."""
    x, w = np.polynomial.legendre.leggauss(8)
    half, tilt = math.radians(wide_deg) / 2.0, math.radians(degrees)
    off, around = np.meshgrid((x + 1.0) * half / 2.0, (np.arange(16) + 0.5) * np.pi / 8.0, indexing="ij")
    weights = (w * half / 2.0)[:, None] * np.sin(off) * np.pi / 8.0
    a, b, c = np.sin(off) * np.cos(around), np.sin(off) * np.sin(around), np.cos(off)
    mu = math.cos(tilt) * c - math.sin(tilt) * a
    azimuth = np.degrees(np.arctan2(b, math.cos(tilt) * a + math.sin(tilt) * c))
    return mu.ravel(), azimuth.ravel(), (weights * mu).ravel()


@pytest.mark.parametrize("albedo", [0.0, 0.37, 1.0])
def test_an_even_panel_reads_its_albedo_in_every_geometry(albedo: float) -> None:
    assert read_panel(make_even(albedo), *EVEN) == close_to(dict.fromkeys(EVEN, albedo), rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("albedo", [0.2, 0.9, 1.0])
def test_a_base_under_a_smooth_surface(albedo: float) -> None:
    """The diffuse light that comes out is T(mu_i) A/(1 - A r_i) of it, shared out as T(mu_o)/n^2: 1 - r_i in all."""
    sent_up = albedo / (1.0 - albedo * R_I)
    mu, _, port = cut_port(8.0)
    along, across, _ = shares(INDEX, mu)[1].real
    seen, through = float(port @ (along + across) / 2.0), let_through(8.0) * sent_up
    expected = {
        "8:di": 1.0 - let_through(8.0) + through * (1.0 - R_I),
        "8:de": through * (1.0 - R_I - seen / (np.pi * INDEX**2)) / (1.0 - port.sum() / np.pi),
        "di:di": R_E + (1.0 - R_E) * (1.0 - R_I) * sent_up,
        "45:0": let_through(45.0) * let_through(0.0) * sent_up / INDEX**2,
        "45:as15": let_through(45.0) * let_through(30.0) * sent_up / INDEX**2,
        "45:as110": let_through(45.0) * let_through(65.0) * sent_up / INDEX**2,
    }
    assert read_panel(make_even(albedo, INDEX), *expected) == close_to(expected, rtol=0.0, atol=1e-7)


def make_paint(albedo: float = 1.0, base: float = 1.0, **surface: object) -> Panel:
    """A film of optical thickness 3 under a surface, over a Lambertian base."""
    interface = {"interface": {"above": 1.0, "below": INDEX, **surface}}
    film = {"phase": {"henyey_greenstein": 0.5}, "albedo": albedo, "thickness": 3.0, "host_index": INDEX}
    return make_panel({"layer": [interface, film], "base": {"kind": "lambertian", "albedo": base}}, [0.5])


def test_what_absorbs_nothing_over_white_sends_all_back() -> None:
    """And 8:de, which misses the mirrored beam, reads less by about that beam."""
    read = read_panel(make_paint(), "8:di", "60:di", "di:di", "8:de")
    assert [read[name] for name in ("8:di", "60:di", "di:di")] == close_to([1.0] * 3, rtol=0.0, atol=1e-12)
    assert read["8:de"] == close_to(let_through(8.0), rtol=0.0, atol=4e-3)


def test_a_rough_surface_that_conserves_energy_does() -> None:
    surface = {"roughness": 0.3, "shadowing": True, "conserving": True}
    assert read_panel(make_paint(**surface), "8:di")["8:di"] == close_to(1.0, rtol=0.0, atol=5e-5)  # nodes for 1e-4


@pytest.mark.parametrize("surface", [{}, {"roughness": 0.2}], ids=["smooth", "rough"])
def test_illumination_and_collection_may_be_exchanged(surface: dict[str, float]) -> None:
    names = ["45:0", "0:45", "30:60", "60:30", "20:-50", "50:-20"]
    read = read_panel(make_panel(make_paint(0.95, 0.3, **surface), accuracy=1e-5), *names)
    for one, other in zip(names[::2], names[1::2], strict=True):
        assert read[one] == close_to(read[other], rtol=0.0, atol=2e-6)  # nodes of two solves, each to 1e-5 of 0.2


def test_light_from_all_sides_seen_at_8_degrees() -> None:
    """di:8 is read off as 8:di; here by the radiance under an even sky, as an instrument does it."""
    panel, mu = make_paint(0.95, 0.3), math.cos(math.radians(8.0))
    sky, weights = vrte.hemisphere(24)
    found = vrte.brdf(panel.scenes[0], np.append(sky, mu), mu, phi=[0.0, 120.0, 240.0], nodes=24)
    seen = 2.0 * np.pi * (weights * sky) @ found.mueller[:-1, 0, :, 0, 0].mean(1) + found.specular_reflectance[-1]
    assert read_panel(panel, "di:8")["di:8"] == close_to(seen, rtol=0.0, atol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("roughness", [0.03, 0.1, 0.3])
def test_a_port_over_a_rough_surface(roughness: float) -> None:
    """8:de beside the whole BRDF, integrated over the port."""
    panel = make_paint(0.95, 0.3, roughness=roughness)
    mu, azimuth, port = cut_port(8.0)
    mu_i = math.cos(math.radians(8.0))
    light = vrte.views(panel.scenes[0], np.full_like(mu, mu_i), mu, azimuth, accuracy=1e-4)
    leaves = port @ light.stokes[:, 0] / mu_i
    total = vrte.brdf(panel.scenes[0], mu_i, 1.0, accuracy=1e-4).reflectance[0]
    expected = (total - leaves) / (1.0 - port.sum() / np.pi)
    assert read_panel(panel, "8:de")["8:de"] == close_to(expected, rtol=0.0, atol=2e-5)
