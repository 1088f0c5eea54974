"""What instruments read off a panel: geometries by name, reflectance factors, colour and polarization."""

import math
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.appearance.apertures import Round
from vrte.appearance.geometries import (
    MULTI_ANGLE,
    find_cosine,
    find_reflectance,
    read_geometry,
    solve_geometry,
)
from vrte.appearance.panel import make_panel
from vrte.appearance.quantities import Conditions

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
    ("name", "angles", "excluded"),
    [
        ("45:0", (45.0, 0.0), False),
        ("45°:0°", (45.0, 0.0), False),
        ("45:as15", (45.0, 30.0), False),
        ("45:as110", (45.0, -65.0), False),
        ("45:as-15", (45.0, 60.0), False),
        ("60:-20", (60.0, -20.0), False),
        ("8:di", (8.0, None), False),
        ("de:8", (8.0, None), True),
        ("di:di", (None, None), False),
    ],
)
def test_geometries_have_the_names_of_cie_15(name: str, angles: tuple[float, float], excluded: bool) -> None:
    found = read_geometry(name)
    assert (found.angle_i, found.angle_o) == angles
    assert found.excluded == excluded
    assert found.definition
    assert found.standard


@pytest.mark.parametrize(
    ("names", "cie"),
    [
        ("d/8 d:8 d/8° D/8 d/8SCI SCI sci SPIN di/8 d/8(SCI)", "di:8"),
        ("d/8SCE SCE spex de/8 d/8,SCE", "de:8"),
        ("8/d 8:d 8°/d 8/dSCI 8/di", "8:di"),
        ("8/dSCE 8:d,SCE 8/de", "8:de"),
        ("d/0SCE", "de:0"),
        ("45/0 45°/0° 45a:0 45x:0 45c:0 45°x:0° 45a/0", "45:0"),
        ("0/45 0:45a 0:45x 0°:45°c", "0:45"),
        ("45/as15 45:as15", "45:as15"),
    ],
)
def test_geometries_have_the_names_of_laboratories(names: str, cie: str) -> None:
    for name in names.split():
        assert read_geometry(name) == read_geometry(cie), name
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
    assert Conditions(geometry=name).words == Conditions(geometry=cie).words.replace(cie, read_geometry(name).name)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("45/5a", "must be a geometry such as '45:0'.*'d/8', '8/d', 'SCI', 'SCE', '45/0', '45a:0', '45x:0'"),
        ("d/0", "must be a geometry"),  # with a gloss trap or without: who means it says SCI or SCE
        ("d", "must be a geometry"),
        ("", "must be a geometry"),
        (45, "must be a geometry such as '45:0'"),
        ("8:8", "looks along the mirrored beam.*ask for gloss"),
        ("45:as0", "looks along the mirrored beam"),
        ("90:0", "has an angle of 90 degrees: must be below 90"),
        ("45:as150", "has an angle of -105 degrees"),
        ("di:de", "must be a geometry"),
    ],
)
def test_other_names_are_refused(name: Any, message: str) -> None:
    with pytest.raises(vrte.SceneError, match=message):
        read_geometry(name)


def test_a_port_takes_a_rough_surfaces_lobe_in_part() -> None:
    """Of a surface over black all that comes back is its lobe: a port as wide as the hemisphere around it takes what
    the brute-force sum over a fine grid of directions does."""
    content = {"layer": [ROUGH]}
    panel = make_panel(content, [0.55])
    total = find_reflectance(solve_geometry(panel, "8:di"), "8:di")[0]
    surface = panel.surface[0]
    assert surface is not None
    assert total == close_to(float(surface.share([find_cosine(8.0)])[0][0]), rtol=1e-4, atol=0.0)
    for port_deg, most in ((5.0, 1.0), (20.0, 0.5), (60.0, 0.01)):
        spectrum = solve_geometry(panel, "8:de")
        kept = find_reflectance(spectrum, "8:de", panel.surface, port_deg)[0]
        seen = math.sin(math.radians(0.5 * port_deg)) ** 2 * find_cosine(8.0)
        taken = total - kept * (1.0 - seen)
        assert taken == close_to(add_up_lobe(surface, Round(port_deg)), rtol=2e-3, atol=0.0)
        assert kept < most * total


def add_up_lobe(surface: vrte.Interface, port: Round) -> float:
    """The share of a beam at 8 degrees that goes into a round port around its mirror image, by rings of directions."""
    t = math.radians(8.0)
    g = math.radians(port.reach_deg) * (np.arange(400) + 0.5) / 400
    turned = 2 * np.pi * (np.arange(360) + 0.5) / 360
    x, y, z = np.sin(g)[:, None] * np.cos(turned), np.sin(g)[:, None] * np.sin(turned), np.cos(g)[:, None] + 0 * turned
    across, along, up = y, x * np.cos(t) + z * np.sin(t), -x * np.sin(t) + z * np.cos(t)
    f = surface.facets.reflect(np.full_like(up, np.cos(t)), up, np.degrees(np.arctan2(across, along)))[..., 0, 0]
    ring = np.sin(g) * (math.radians(port.reach_deg) / 400) * (2 * np.pi / 360)
    return float(((f * up).sum(axis=1) * ring).sum())


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


def test_readings_are_listed_with_what_they_are() -> None:
    look = vrte.appearance({"layer": [NOTHING], "base": over(0.5)}, VISIBLE, ["45:0", "8:di"])
    rows = list(look.list_readings())
    assert len(rows) == 2 * 9 + 2 * 9 + 2 * 8
    assert all(row.definition and row.standard and row.unit for row in rows)
    lightness = [row.value for row in rows if row.quantity == "L"]
    assert lightness == close_to([look.colour().L] * 2, rtol=1e-6, atol=0.0)


def test_an_appearance_has_the_gloss_and_the_hiding_of_its_panel() -> None:
    from vrte.appearance.gloss import find_gloss
    from vrte.appearance.hiding import find_contrast

    look = vrte.appearance({"layer": [SURFACE, CLOUDY]}, VISIBLE, ["45:0"], "A", 2, nodes=6)
    assert look.panel is not None
    assert look.gloss(20.0) == find_gloss(look.panel, 20.0)
    hiding = look.hiding(white=0.7)
    assert (hiding.illuminant, hiding.observer, hiding.white) == ("A", 2, 0.7)
    assert hiding.contrast_ratio == close_to(find_contrast(look.panel, 0.0, 0.7, "45:0", "A", 2), rtol=1e-6, atol=0.0)
