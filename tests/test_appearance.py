"""Panels, scenes at several wavelengths, and what instruments read off them: geometries by name, reflectance factors,
colour and polarization; closed forms of even panels and of a base under a surface, conservation.

A base of albedo A under a smooth surface of index n: light goes in by T(mu_i), comes out by T(mu_o)/n^2, and of what
the base sends up the share r_i comes back down, which makes it 1/(1 - A r_i) times as much; r_e and r_i are Walsh's.
"""

import math
import threading
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.appearance.colours import find_flop_index
from vrte.appearance.geometries import (
    MULTI_ANGLE,
    STANDARD_GEOMETRIES,
    TRAVEL,
    find_cosine,
    find_reflectance,
    read_geometry,
    solve_geometries,
)
from vrte.appearance.gloss import find_gloss
from vrte.appearance.hiding import Conditions, find_contrast
from vrte.appearance.panel import Panel, make_panel
from vrte.calls.brdfs import run_side_by_side

from .closed_forms import shares, walsh
from .helpers import HANGS, assert_close, close_to

TWO, VISIBLE = [0.5, 0.6], np.linspace(0.43, 0.66, 7)
INDEX = 1.5
R_E, R_I = walsh(INDEX)
SURFACE = {"interface": {"above": 1.0, "below": INDEX}}
FILM = {"phase": "isotropic", "albedo": 0.9, "thickness": 2.0}
CLOUDY = {"phase": "rayleigh", "albedo": 0.98, "thickness": 3.0}


def over(albedo: float) -> dict[str, Any]:
    return {"kind": "lambertian", "albedo": albedo}


# ---- panels


def test_a_film_is_made_thicker_and_put_over_other_bases() -> None:
    white = {"index": 2.5, "size": {"lognormal": {"median_um": 0.1, "sigma": 1.2}}}
    content = {"host_index": 1.5, "particles": {"white": white}}
    film = {"particles": "white", "thickness_um": 5.0, "volume_fraction": 0.05}
    panel = make_panel({**content, "layer": [film]}, TWO, nodes=6)
    assert (panel.film, panel.length_um) == (0, 5.0)
    other = make_panel({**content, "layer": [film | {"thickness_um": 20.0}], "base": over(0.8)}, TWO, nodes=6)
    moved = panel.make_as_thick(20.0).put_over(vrte.Lambertian(0.8))
    assert moved.length_um == 20.0
    assert_close(moved.solve(0.7).reflectance, other.solve(0.7).reflectance, rtol=0.0, atol=1e-13)
    semi_infinite = panel.make_as_thick(math.inf)
    assert semi_infinite.length_um == math.inf
    assert_close(semi_infinite.solve(0.7).reflectance, 1.0, rtol=0.0, atol=1e-8)  # nothing absorbs
    # the layers below a semi-infinite film go, also their thickness, and which layer is the film stays said
    panel = make_panel({"layer": [FILM, SURFACE, FILM]}, TWO, layer=1, nodes=4).scale_film(math.inf)
    assert panel.lengths_um == (math.inf,)
    alone = make_panel({"layer": [FILM]}, TWO, nodes=4).scale_film(math.inf)
    assert np.array_equal(panel.solve(0.5).reflectance, alone.solve(0.5).reflectance)


def test_wavelengths_are_the_files_or_the_visible_as_far_as_it_is_known() -> None:
    assert make_panel({"layer": [FILM]}).wavelength_um[[0, -1]].tolist() == [0.4, 0.7]
    assert make_panel({"layer": [FILM], "wavelength_um": [0.45, 0.5]}).wavelength_um.tolist() == [0.45, 0.5]
    grains = {"r": {"index": "main/TiO2/Devore-o", "radius_um": 0.01}}
    panel = make_panel({"particles": grains, "layer": [{"particles": "r", "thickness": 1.0}]})
    assert panel.wavelength_um[[0, -1]].tolist() == [0.43, 0.7]
    assert make_panel(panel, nodes=5).asked["nodes"] == 5


def test_calls_side_by_side_keep_their_order_and_end_with_the_first_error() -> None:
    together = threading.Barrier(2, timeout=HANGS)  # passed only where two are in it at once
    assert run_side_by_side([lambda: (together.wait(), 1)[1], lambda: (together.wait(), 2)[1]], workers=2) == [1, 2]
    stop, ticks = np.zeros(1, np.int32), []
    with pytest.raises(ZeroDivisionError):
        run_side_by_side([lambda: 1 // 0, lambda: 1], lambda done, total: ticks.append((done, total)), 2, stop)
    assert stop[0] == 1
    assert all(total == 2 for _, total in ticks)


# ---- geometries


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


def test_colours_travel_and_the_flop_index_is_read_off_three_of_them() -> None:
    """A gloss surface reads little flop of an even white panel, a rough one its own lobe."""
    content = {"layer": [SURFACE, CLOUDY], "base": over(0.2), "nodes": 12}
    look = vrte.appearance(content, VISIBLE, ["8:di", *TRAVEL])
    travel = look.colour_travel()
    assert list(travel) == [10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 45.0, 55.0, 65.0, 75.0, 90.0, 110.0]
    assert travel[110.0] == look.colour("45:as110")
    near, face, far = (travel[off].L for off in (15.0, 45.0, 110.0))
    assert look.flop_index() == close_to(2.69 * max(near - far, 0.0) ** 1.11 / face**0.86, rtol=1e-12, atol=0.0)
    (row,) = (one for one in look.list_readings() if one.quantity == "flop index")
    assert row.value == look.flop_index()
    assert find_flop_index(100.0, 50.0, 20.0) == close_to(12.052, rtol=1e-4, atol=0.0)  # by logarithms
    assert find_flop_index(50.0, 50.0, 51.0) == 0.0
    few = vrte.appearance(content, VISIBLE, ["45:0"])
    with pytest.raises(vrte.SceneError, match="'45:as15' was not asked for: there are 45:0"):
        few.flop_index()
    with pytest.raises(vrte.SceneError, match="have none along which colours travel: ask for 45:as10"):
        few.colour_travel()


def test_a_spectrum_is_read_as_far_as_its_directions_go() -> None:
    content = {"layer": [SURFACE, CLOUDY]}
    look = vrte.appearance(content, TWO, ["45:0", "8:di"], nodes=12)
    asked = {"mu_i": [find_cosine(45.0), find_cosine(8.0)], "mu_o": 1.0}
    spectrum = vrte.spectrum(content | {"brdf": asked}, TWO, nodes=12)
    read = vrte.appearance(spectrum)
    assert set(read.reflectances) == {"8:di", "45:0", "45:as45"}
    for name in read.reflectances:
        assert_close(read.reflectance(name), look.reflectance(name), rtol=1e-12, atol=0.0)
    elsewhere = vrte.spectrum(content | {"brdf": {"mu_i": 0.3, "mu_o": 0.2}}, TWO, nodes=4)
    for ask, message in (
        (lambda: vrte.appearance(spectrum, geometries=["45:as15"]), "'45:as15' needs mu_o = 0.8660254038.*is 1"),
        (lambda: vrte.appearance(spectrum, nodes=4), "nodes is not used: the spectrum is solved already"),
        (lambda: vrte.appearance(elsewhere), "has the directions of none of"),
        (lambda: read.kubelka_munk(), "K and S are of a scene, not its spectrum alone"),
        (lambda: read.gloss(), "gloss is read off a scene, not its spectrum alone"),
        (lambda: read.hiding(), "hiding power is of a scene, not its spectrum alone"),
        (lambda: read.reflectance("45:as15"), "was not asked for: there are 8:di, 45:0, 45:as45"),
        (lambda: read.polarization("8:di"), "has no polarization here: there are 45:0, 45:as45"),
    ):
        with pytest.raises(vrte.SceneError, match=message):
            ask()


def test_an_appearance_has_the_gloss_and_the_hiding_of_its_panel() -> None:
    look = vrte.appearance({"layer": [SURFACE, CLOUDY]}, VISIBLE, ["45:0"], "A", 2, nodes=6)
    assert look.panel is not None
    assert look.gloss(np.array(20.0)) == find_gloss(look.panel, 20.0)  # type: ignore[arg-type]
    hiding, seen = look.hiding(white=0.7), Conditions("45:0", "A", 2, white=0.7)
    assert hiding.conditions == seen
    assert hiding.contrast_ratio == close_to(find_contrast(look.panel, seen), rtol=1e-6, atol=0.0)


# ---- closed forms


def read_panel(panel: Panel, *names: str) -> dict[str, float]:
    """Reflectance factors at the first wavelength."""
    return {name: float(values[0]) for name, values in solve_geometries(panel, names)[0].items()}


def make_even(albedo: float, *surface: Any) -> Panel:
    """A Lambertian base, bare or under a surface."""
    layer = {"phase": "isotropic", "albedo": 0.0, "thickness": 0.0}
    return make_panel({"layer": [*surface, layer], "base": over(albedo)}, [0.5], accuracy=1e-8)


def make_paint(albedo: float = 1.0, base: float = 1.0, accuracy: float = 1e-4, **surface: object) -> Panel:
    """A film of optical thickness 3 under a surface, over a Lambertian base."""
    film = {"phase": {"henyey_greenstein": 0.5}, "albedo": albedo, "thickness": 3.0, "host_index": INDEX}
    interface = {"interface": {**SURFACE["interface"], **surface}}
    return make_panel({"layer": [interface, film], "base": over(base)}, [0.5], accuracy=accuracy)


def let_through(degrees: float) -> float:
    """Share of unpolarized light that the surface lets through at an angle in air."""
    along, across, _ = shares(INDEX, np.array([find_cosine(degrees)]))[1][:, 0].real
    return float(along + across) / 2.0


def cut_port(wide_deg: float = 10.0, points: int = 8) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cosines, azimuths [degrees] and projected solid angles [sr] (n,) of a quadrature over a round port around the
    beam mirrored at 8 degrees, polar in its own axes: nothing of the tested rule."""
    x, w = np.polynomial.legendre.leggauss(points)
    half, tilt = math.radians(wide_deg) / 2.0, math.radians(8.0)
    off, around = np.meshgrid((x + 1.0) * half / 2.0, (np.arange(2 * points) + 0.5) * np.pi / points, indexing="ij")
    weights = (w * half / 2.0)[:, None] * np.sin(off) * np.pi / points
    a, b, c = np.sin(off) * np.cos(around), np.sin(off) * np.sin(around), np.cos(off)
    mu = math.cos(tilt) * c - math.sin(tilt) * a
    azimuth = np.degrees(np.arctan2(b, math.cos(tilt) * a + math.sin(tilt) * c))
    return mu.ravel(), azimuth.ravel(), (weights * mu).ravel()


@pytest.mark.parametrize("albedo", [0.0, 0.37, 1.0])
def test_an_even_panel_reads_its_albedo_in_every_geometry(albedo: float) -> None:
    names = [*STANDARD_GEOMETRIES, "di:8", "de:8", "30:60", "60:di", "20:de"]
    assert read_panel(make_even(albedo), *names) == close_to(dict.fromkeys(names, albedo), rtol=0.0, atol=1e-13)


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
    mu, _, port = cut_port()
    along, across, _ = shares(INDEX, mu)[1].real
    seen, through = float(port @ (along + across) / 2.0), let_through(8.0) * sent_up
    expected = {
        "8:di": 1.0 - let_through(8.0) + through * (1.0 - R_I),
        "8:de": through * (1.0 - R_I - seen / (np.pi * INDEX**2)) / (1.0 - port.sum() / np.pi),
        "di:di": R_E + (1.0 - R_E) * (1.0 - R_I) * sent_up,
    }
    for name, angle in (("45:0", 0.0), ("45:as15", 30.0), ("45:as110", 65.0)):
        expected[name] = let_through(45.0) * let_through(angle) * sent_up / INDEX**2
    assert read_panel(make_even(albedo, SURFACE), *expected) == close_to(expected, rtol=0.0, atol=1e-7)


def test_light_from_all_sides_seen_at_8_degrees() -> None:
    """di:8 is read off as 8:di; here by the radiance under an even sky, as an instrument does it."""
    panel, mu = make_paint(0.95, 0.3), find_cosine(8.0)
    sky, weights = vrte.hemisphere(24)
    found = vrte.brdf(panel.scenes[0], np.append(sky, mu), mu, phi=[0.0, 120.0, 240.0], nodes=24)
    seen = 2.0 * np.pi * (weights * sky) @ found.mueller[:-1, 0, :, 0, 0].mean(1) + found.specular_reflectance[-1]
    assert read_panel(panel, "di:8")["di:8"] == close_to(seen, rtol=0.0, atol=1e-4)


def test_a_port_takes_a_rough_surfaces_lobe_in_part() -> None:
    """Of a surface over black all that comes back is its lobe: a port takes what the sum over a fine grid does."""
    panel, mu_i = make_paint(0.0, 0.0, roughness=0.1, shadowing=True), find_cosine(8.0)
    surface, spectrum = panel.surface[0], panel.solve(*read_geometry("8:de").directions)
    total = spectrum.total_reflectance[0, 0]
    assert total == close_to(float(surface.share([mu_i])[0][0]), rtol=1e-4, atol=0.0)
    for port_deg, most in ((5.0, 1.0), (20.0, 0.5), (60.0, 0.01)):
        kept = find_reflectance(spectrum, "8:de", panel.surface, port_deg)[0]
        taken = total - kept * (1.0 - math.sin(math.radians(0.5 * port_deg)) ** 2 * mu_i)
        mu, azimuth, port = cut_port(port_deg, 32)
        lobe = surface.facets.reflect(np.full_like(mu, mu_i), mu, azimuth)[:, 0, 0]
        assert taken == close_to(float(port @ lobe), rtol=2e-3, atol=0.0)
        assert kept < most * total
