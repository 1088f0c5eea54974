"""What instruments read off a panel: geometries by name, reflectance factors, colour and polarization; and what they
read where the answer is known in closed form: even panels, a base under a surface, conservation.

A base of albedo A under a smooth surface of index n: light goes in by T(mu_i), comes out by T(mu_o)/n^2, and of what
the base sends up the share r_i comes back down, which makes it 1/(1 - A r_i) times as much; r_e and r_i are Walsh's.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.appearance.geometries import (
    MULTI_ANGLE,
    STANDARD_GEOMETRIES,
    find_cosine,
    find_reflectance,
    measure_panel,
    read_geometry,
    solve_geometries,
)
from vrte.appearance.gloss import find_gloss
from vrte.appearance.hiding import Conditions, find_contrast
from vrte.appearance.panel import Panel, make_panel

from .closed_forms import shares, walsh
from .helpers import assert_close, close_to

VISIBLE = np.linspace(0.4, 0.7, 9)
NOTHING = {"phase": "isotropic", "albedo": 0.0, "thickness": 0.0}
SURFACE = {"interface": {"above": 1.0, "below": 1.5}}
ROUGH = {"interface": {"above": 1.0, "below": 1.5, "roughness": 0.1, "shadowing": True}}
CLOUDY = {"phase": "rayleigh", "albedo": 0.98, "thickness": 3.0}
TWO = [0.5, 0.6]


def over(albedo: float) -> dict[str, Any]:
    return {"kind": "lambertian", "albedo": albedo}


@pytest.mark.parametrize(
    ("names", "cie", "reading"),
    [
        ("45/0 45°/0° 45a:0 45x:0 45c:0 45°x:0° 45a/0 45°:0°", "45:0", (45.0, 0.0, False)),
        ("0/45 0:45a 0:45x 0°:45°c", "0:45", (0.0, 45.0, False)),
        ("45/as15", "45:as15", (45.0, 30.0, False)),
        ("45:as110", "45:as110", (45.0, -65.0, False)),
        ("45:as-15", "45:as-15", (45.0, 60.0, False)),
        ("60:-20", "60:-20", (60.0, -20.0, False)),
        ("d/8 d:8 d/8° D/8 d/8SCI SCI sci SPIN di/8 d/8(SCI)", "di:8", (8.0, None, False)),
        ("d/8SCE SCE spex de/8 d/8,SCE", "de:8", (8.0, None, True)),
        ("8/d 8:d 8°/d 8/dSCI 8/di", "8:di", (8.0, None, False)),
        ("8/dSCE 8:d,SCE 8/de", "8:de", (8.0, None, True)),
        ("d/0SCE", "de:0", (0.0, None, True)),
        ("di:di", "di:di", (None, None, False)),
    ],
)
def test_geometries_have_the_names_of_cie_15_and_of_laboratories(names: str, cie: str, reading: tuple) -> None:
    found = read_geometry(cie)
    assert (found.name, found.angle_i, found.angle_o, found.excluded) == (cie, *reading)
    assert found.definition
    assert found.standard
    for name in names.split():
        assert read_geometry(name) == found, name
    assert read_geometry(" d/8 (SCI) ").name == "di:8"
    assert read_geometry("45:as45").reading == read_geometry("0:45").reading
    assert read_geometry("30:60").reading != read_geometry("30:-60").reading


@pytest.mark.parametrize(("name", "cie"), [("d/8 SCI", "8:di"), ("45x:0", "45:0")])
def test_a_laboratorys_name_is_taken_wherever_a_geometry_is_named(name: str, cie: str) -> None:
    grey = {"layer": [CLOUDY], "base": over(0.4), "nodes": 4}
    look = vrte.appearance(grey, VISIBLE, geometries=[name])
    assert look.reflectance(name) is look.reflectance(cie)
    assert look.colour(name).L == look.colour(cie).L
    one, other = (vrte.Measurement("reflectance", 0.5, geometry=given).predict(grey) for given in (name, cie))
    assert one == other
    assert Conditions(geometry=name).geometry == read_geometry(name).name
    rows = list(look.list_readings())
    assert len(rows) == VISIBLE.size * (3 if name == "45x:0" else 1) + 8
    assert all(row.definition and row.standard and row.unit for row in rows)
    assert [row.value for row in rows if row.quantity == "L"] == [look.colour(name).L]


def test_a_port_takes_a_rough_surfaces_lobe_in_part() -> None:
    """Of a surface over black all that comes back is its lobe: a port as wide as the hemisphere around it takes what
    the brute-force sum over a fine grid of directions does."""
    content = {"layer": [ROUGH]}
    panel = make_panel(content, [0.55])
    total = measure_panel(panel, "8:di")[0]
    surface = panel.surface[0]
    assert surface is not None
    assert total == close_to(float(surface.share([find_cosine(8.0)])[0][0]), rtol=1e-4, atol=0.0)
    for port_deg, most in ((5.0, 1.0), (20.0, 0.5), (60.0, 0.01)):
        spectrum = panel.solve(*read_geometry("8:de").directions)
        kept = find_reflectance(spectrum, "8:de", panel.surface, port_deg)[0]
        seen = math.sin(math.radians(0.5 * port_deg)) ** 2 * find_cosine(8.0)
        taken = total - kept * (1.0 - seen)
        mu, azimuth, port = cut_port(8.0, port_deg, 64)
        lobe = surface.facets.reflect(np.full_like(mu, find_cosine(8.0)), mu, azimuth)[:, 0, 0]
        assert taken == close_to(float(port @ lobe), rtol=2e-3, atol=0.0)
        assert kept < most * total


def test_multi_angle_views_are_those_of_the_brdf() -> None:
    """15 degrees off the mirrored beam at 45 is 30 degrees from the normal, on its side."""
    content = {"layer": [SURFACE, CLOUDY], "base": over(0.2)}
    look = vrte.appearance(content, TWO, MULTI_ANGLE, nodes=16)
    scene = make_panel(content, TWO).scenes[0]
    for name, angle, phi in (("45:as15", 30.0, 0.0), ("45:as45", 0.0, 0.0), ("45:as110", 65.0, 180.0)):
        f = vrte.brdf(scene, find_cosine(45.0), find_cosine(angle), phi, nodes=16).mueller[0, 0, 0]
        assert look.reflectance(name)[0] == close_to(np.pi * f[0, 0], rtol=1e-9, atol=0.0)
        degree, angle_deg = look.polarization(name)
        assert degree[0] == close_to(math.hypot(f[1, 0], f[2, 0]) / f[0, 0], rtol=0.0, atol=1e-9)
        assert angle_deg[0] == close_to(0.0 if f[1, 0] > 0 else 90.0, rtol=0.0, atol=1e-6)


def test_a_spectrum_is_read_as_far_as_its_directions_go() -> None:
    content = {"layer": [SURFACE, CLOUDY]}
    look = vrte.appearance(content, TWO, ["45:0", "8:di"], nodes=12)
    spectrum = vrte.spectrum(
        content | {"brdf": {"mu_i": [find_cosine(45.0), find_cosine(8.0)], "mu_o": 1.0}}, TWO, nodes=12
    )
    read = vrte.appearance(spectrum)
    assert set(read.reflectances) == {"8:di", "45:0", "45:as45"}
    for name in read.reflectances:
        assert_close(read.reflectance(name), look.reflectance(name), rtol=1e-12, atol=0.0)
    for ask, message in (
        (lambda: vrte.appearance(spectrum, geometries=["45:as15"]), "'45:as15' needs mu_o = 0.8660254038.*is 1"),
        (lambda: vrte.appearance(spectrum, nodes=4), "nodes is not used: the spectrum is solved already"),
        (lambda: read.kubelka_munk(), "K and S are of a scene, not its spectrum alone"),
        (lambda: read.gloss(), "gloss is read off a scene, not its spectrum alone"),
        (lambda: read.hiding(), "hiding power is of a scene, not its spectrum alone"),
        (lambda: read.reflectance("45:as15"), "was not asked for: there are 8:di, 45:0, 45:as45"),
        (lambda: read.polarization("8:di"), "has no polarization here: there are 45:0, 45:as45"),
    ):
        with pytest.raises(vrte.SceneError, match=message):
            ask()
    elsewhere = vrte.spectrum(content | {"brdf": {"mu_i": 0.3, "mu_o": 0.2}}, TWO, nodes=4)
    with pytest.raises(vrte.SceneError, match="has the directions of none of"):
        vrte.appearance(elsewhere)


def test_an_appearance_has_the_gloss_and_the_hiding_of_its_panel() -> None:
    look = vrte.appearance({"layer": [SURFACE, CLOUDY]}, VISIBLE, ["45:0"], "A", 2, nodes=6)
    assert look.panel is not None
    assert look.gloss(20.0) == find_gloss(look.panel, 20.0)
    hiding = look.hiding(white=0.7)
    seen = Conditions("45:0", "A", 2, white=0.7)
    assert hiding.conditions == seen
    assert hiding.contrast_ratio == close_to(find_contrast(look.panel, seen), rtol=1e-6, atol=0.0)


EVEN = [*STANDARD_GEOMETRIES, "di:8", "de:8", "30:60", "60:di", "20:de"]
INDEX = 1.5
R_E, R_I = walsh(INDEX)


def make_even(albedo: float, index: float = 1.0, wavelengths: object = (0.5,), **surface: object) -> Panel:
    """A Lambertian base, bare or under a surface."""
    layer = {"phase": "isotropic", "albedo": 0.0, "thickness": 0.0, "host_index": index}
    stack = [{"interface": {"above": 1.0, "below": index, **surface}}, layer] if index > 1.0 else [layer]
    return make_panel({"layer": stack, "base": {"kind": "lambertian", "albedo": albedo}}, wavelengths)


def read_panel(panel: Panel, *names: str) -> dict[str, float]:
    """Reflectance factors at the first wavelength."""
    return {name: float(values[0]) for name, values in solve_geometries(panel, names)[0].items()}


def let_through(degrees: float) -> float:
    """Share of unpolarized light that the surface lets through at an angle in air."""
    along, across, _ = shares(INDEX, np.array([math.cos(math.radians(degrees))]))[1][:, 0].real
    return float(along + across) / 2.0


def cut_port(degrees: float, wide_deg: float = 10.0, points: int = 8) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cosines, azimuths [degrees] and projected solid angles [sr] (n,) of a quadrature over a round port around the
    mirrored beam, polar in its own axes: nothing of the tested rule."""
    x, w = np.polynomial.legendre.leggauss(points)
    half, tilt = math.radians(wide_deg) / 2.0, math.radians(degrees)
    off, around = np.meshgrid((x + 1.0) * half / 2.0, (np.arange(2 * points) + 0.5) * np.pi / points, indexing="ij")
    weights = (w * half / 2.0)[:, None] * np.sin(off) * np.pi / points
    a, b, c = np.sin(off) * np.cos(around), np.sin(off) * np.sin(around), np.cos(off)
    mu = math.cos(tilt) * c - math.sin(tilt) * a
    azimuth = np.degrees(np.arctan2(b, math.cos(tilt) * a + math.sin(tilt) * c))
    return mu.ravel(), azimuth.ravel(), (weights * mu).ravel()


@pytest.mark.parametrize("albedo", [0.0, 0.37, 1.0])
def test_an_even_panel_reads_its_albedo_in_every_geometry(albedo: float) -> None:
    assert read_panel(make_even(albedo), *EVEN) == close_to(dict.fromkeys(EVEN, albedo), rtol=0.0, atol=1e-13)


def test_what_absorbs_nothing_over_white_sends_all_back() -> None:
    """And 8:de, which misses the mirrored beam, reads less by about that beam; rough surfaces that conserve energy send
    all back, too, to the accuracy of 1e-4 that chooses the nodes."""
    read = read_panel(make_paint(), "8:di", "60:di", "di:di", "8:de")
    assert [read[name] for name in ("8:di", "60:di", "di:di")] == close_to([1.0] * 3, rtol=0.0, atol=1e-12)
    assert read["8:de"] == close_to(let_through(8.0), rtol=0.0, atol=4e-3)
    surface = {"roughness": 0.3, "shadowing": True, "conserving": True}
    assert read_panel(make_paint(**surface), "8:di")["8:di"] == close_to(1.0, rtol=0.0, atol=5e-5)


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


@pytest.mark.parametrize(
    "surface", [{}, pytest.param({"roughness": 0.2}, marks=pytest.mark.slow)], ids=["smooth", "rough"]
)
def test_illumination_and_collection_may_be_exchanged(surface: dict[str, float]) -> None:
    """The BRDF of rough surfaces is reciprocal by tests/test_rough.py; here to the nodes of two solves, 1e-5 of 0.2."""
    names = ["45:0", "0:45", "30:60", "60:30", "20:-50", "50:-20"]
    read = read_panel(make_panel(make_paint(0.95, 0.3, **surface), accuracy=1e-5), *names)
    for one, other in zip(names[::2], names[1::2], strict=True):
        assert read[one] == close_to(read[other], rtol=0.0, atol=2e-6)


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
    """8:de beside the whole BRDF, integrated over the port, on the same nodes."""
    panel = replace(make_paint(0.95, 0.3, roughness=roughness), asked={"nodes": 32})
    mu, azimuth, port = cut_port(8.0)
    mu_i = math.cos(math.radians(8.0))
    light = vrte.views(panel.scenes[0], np.full_like(mu, mu_i), mu, azimuth, nodes=32)
    leaves = port @ light.stokes[:, 0] / mu_i
    total = vrte.brdf(panel.scenes[0], mu_i, 1.0, nodes=32).reflectance[0]
    expected = (total - leaves) / (1.0 - port.sum() / np.pi)
    assert read_panel(panel, "8:de")["8:de"] == close_to(expected, rtol=0.0, atol=2e-6)
