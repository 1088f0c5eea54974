"""What panels, colours, hiding, gloss, Kubelka and Munk, paints and fits refuse, each in one sentence."""

import math
import re
import sys
from functools import partial
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.appearance import kubelka_munk as km
from vrte.appearance.apertures import Rectangular, Round, collect_mirrored
from vrte.appearance.colours import find_colour
from vrte.appearance.geometries import read_geometry
from vrte.appearance.gloss import find_gloss
from vrte.appearance.hiding import Conditions, find_hiding
from vrte.appearance.panel import Panel, make_panel
from vrte.appearance.two_flux_fit import find_kubelka_munk

TWO, BROAD, VISIBLE = [0.5, 0.6], np.linspace(0.39, 0.73, 35), np.linspace(0.43, 0.66, 7)
FILM: dict[str, Any] = {"phase": "isotropic", "albedo": 0.9, "thickness": 2.0}
CLEAR: dict[str, Any] = {"phase": "isotropic", "albedo": 0.0, "thickness": 0.1}
GLASS, NOTHING = vrte.Interface(1.0, 1.5), vrte.Layer(vrte.isotropic(), albedo=0.0, thickness=0.0)
WHITE, METAL = vrte.Lambertian(0.9), vrte.Facets((0.8, 6.0), roughness=0.02)


def panel(*layers: dict[str, Any], at: Any = TWO, **asked: Any) -> Panel:
    return make_panel({"layer": list(layers)}, at, **asked)


def coat(albedo: float = 0.99, thickness: float = 4.0, at: Any = (0.55,)) -> Panel:
    """A film under a surface."""
    film = {"phase": "isotropic", "albedo": albedo, "thickness": thickness}
    return panel({"interface": {"above": 1.0, "below": 1.5}}, film, at=at, nodes=16)


def shine(*stack: Any, angle: float = 60.0, at: Any = VISIBLE, base: Any = None) -> float:
    """The gloss of an interface, or of none, over a base."""
    scene = vrte.Scene([*stack, NOTHING], base)
    return find_gloss(Panel(at, (scene,) * at.size, (0.0,), {"nodes": 8}), angle)


def colour(wavelengths: Any = BROAD, reflectance: Any = None, **light: Any) -> Any:
    return find_colour(wavelengths, np.full(np.size(wavelengths), 0.5) if reflectance is None else reflectance, **light)


def hide(thickness: float = 2.0, **seen: Any) -> Any:
    return find_hiding(panel(FILM | {"thickness": thickness}, at=VISIBLE, nodes=4, layer=1), Conditions(**seen))


fluxes, slab, pair = find_kubelka_munk, km.find_slab_coefficients, km.find_coefficients
geometry = read_geometry
REFUSED = [
    # geometries; d/0 with a gloss trap or without: who means it says SCI or SCE
    (partial(geometry, "45/5a"), "must be a geometry such as '45:0'.*'d/8', '8/d', 'SCI', 'SCE', '45/0', '45a:0', "),
    *((partial(geometry, name), "must be a geometry such as '45:0'") for name in ("d/0", "d", "", 45, "di:de")),
    (partial(geometry, "8:8"), "looks along the mirrored beam.*ask for gloss"),
    (partial(geometry, "45:as0"), "looks along the mirrored beam"),
    (partial(geometry, "90:0"), "has an angle of 90 degrees: must be below 90"),
    (partial(geometry, "45:as150"), "has an angle of -105 degrees"),
    # panels
    (lambda: panel(FILM, FILM).film, "which layer is the film.*Say layer=1 to 2"),
    (partial(panel, FILM, layer=2), "layer must be"),
    (partial(make_panel, {"layer": [FILM], "illuminate": "bottom"}, TWO), "a panel is looked at from above"),
    (partial(panel, FILM, mu_i=0.5), "mu_i is not asked for here"),
    (partial(panel, FILM | {"thickness": -1.0}), r"at 0.5 um: layer\[1\].thickness"),
    (lambda: make_panel(panel(FILM), TWO), "a panel has its own"),
    (lambda: panel(FILM).make_as_thick(3.0), "is given by its optical thickness: give it a thickness_um"),
    (lambda: panel(FILM | {"thickness": math.inf}).scale_film(2.0), "semi-infinite, and can be made no thicker"),
    # colours; a lamp of ISO 7589 is known to 560 nm
    (partial(colour, np.linspace(0.45, 0.70, 20)), "47 % of Z .* below 0.45 µm, where at most 20 %.* begin at 0.434"),
    (partial(colour, np.linspace(0.40, 0.60, 20)), "32 % of X .* above 0.6 µm, where at most 5 %.* end at 0.642 µm or"),
    (partial(colour, np.linspace(0.40, 0.70, 6)), "at most 0.04 µm apart from 0.4 to 0.7 µm, not 0.06 as between 0.64"),
    (partial(colour, np.linspace(400.0, 700.0, 31)), "100 % of X .* below 400 µm"),
    (partial(colour, [0.55]), "must cover the visible"),
    (partial(colour, np.linspace(0.70, 0.40, 31)), "must rise from each to the next"),
    (partial(colour, [0.4, np.nan]), "must be finite"),
    (partial(colour, illuminant="F11"), "illuminant must be one of A, B, C, D50, .*, not 'F11'; did you mean 'FL11'"),
    (partial(colour, illuminant="ISO 7589 Sensitometric Printer"), "illuminant must be one of"),
    (partial(colour, illuminant=["D65"]), "illuminant must be a name"),
    (partial(colour, observer=5), "observer must be 2 or 10"),
    (partial(colour, observer="two"), "observer must be a whole number"),
    (partial(colour, reflectance=np.full(34, 0.5)), "one number a wavelength, 35, not 34"),
    (partial(colour, reflectance=np.linspace(-0.1, 0.5, 35)), "reflectance must be numbers >= 0, not -0.1"),
    # hiding
    (partial(hide, black=0.8), "black must be darker than the white, not 0.8 beside 0.8"),
    (partial(hide, white=1.1), "white must be an albedo from 0 to 1"),
    (partial(hide, target=1.0), "target must be a contrast ratio above 0 and below 1"),
    (partial(hide, geometry="45:45"), "mirrored beam"),
    (partial(hide, observer=3), "observer"),
    (partial(hide, math.inf), "the film is semi-infinite"),
    (partial(hide, 0.0), "the film is without thickness"),
    # apertures and gloss
    (partial(collect_mirrored, GLASS, math.cos(math.radians(87.0)), Round(10.0)), "reaches 5 degrees from its axis"),
    (partial(collect_mirrored, GLASS, 0.0, Round(10.0)), "mu_i must satisfy 1e-8 <= mu <= 1"),
    (partial(Round, 0.0), r"aperture: diameter_deg must be an angle from 0.001 to 180 degrees, not 0"),
    (partial(Rectangular, 1.0, 180.0), r"aperture: across_deg must be an angle from 0.001 to 170 degrees, not 180"),
    (partial(shine, base=WHITE), "gloss needs a surface"),
    (partial(shine, GLASS, angle=75.0), "must be one of 20, 60, 85 degrees"),
    (partial(shine, vrte.Interface(1.33, 1.5)), "gloss is read in air"),
    (partial(shine, GLASS, base=METAL, angle=20.0), "has a peak in the receptor"),
    (partial(shine, GLASS, at=VISIBLE[:1]), "wavelength"),
    # Kubelka and Munk
    (partial(pair, 0.5, 0.5, 0.8, 1.0), "over_base must be above over_black"),
    (partial(pair, 0.5, [0.6, 0.4], 0.8, 1.0), r"not 0\.4 \(at place 1\)"),
    (partial(pair, 0.1, 0.9, 0.8, 1.0), "keeps no light"),
    (partial(pair, 0.1, 0.2, 0.0, 1.0), "base must be above 0"),
    (partial(pair, -0.1, 0.2, 0.8, 1.0), "over_black must be a share of light"),
    (partial(pair, 0.1, np.nan, 0.8, 1.0), "over_base must be a share of light"),
    (partial(pair, 0.1, 0.2, 0.8, 0.0), "length must be above 0"),
    (partial(slab, 0.6, 0.5, 1.0), "must be 1 together at most, not 1.1"),
    (partial(slab, 0.6, 0.0, 1.0), "K/S alone"),
    (partial(km.reflect_film, -1.0, 1.0, 1.0), "K must be from 0"),
    (partial(km.reflect_film, 1.0, np.inf, 1.0), "S must be from 0"),
    (partial(km.reflect_film, 1.0, 1.0, -1.0), "length must be 0 or above"),
    (partial(km.remove_surface, 0.03, 0.04, 0.6), "measured must not be below k1"),
    (partial(km.add_surface, 0.5, 0.04, 1.0), "k2 must be below 1"),
    (lambda: fluxes(coat(), geometry="45:0"), "must collect all light"),
    (lambda: fluxes(coat(), geometry="8:de"), "must collect all light"),
    (lambda: fluxes(coat(), white=0.0), "white must be an albedo above 0"),
    (lambda: fluxes(coat(), k2=[0.6, 0.6]), "k2 must be one number, or one a wavelength"),
    (lambda: fluxes(coat(), geometry="inside", k2=0.6), "are of a surface, and here is none"),
    (lambda: fluxes(coat(), k1=0.5), "no film of two fluxes reads so: measured must not be below k1"),
    (lambda: fluxes(coat(1.0), geometry="di:di"), "must not be above what a film that keeps"),
    (lambda: fluxes(coat(0.5, 30.0)), r"hides its base at 0\.55 um"),
    (lambda: fluxes(coat(0.5, np.inf)), "one film that ends"),
    (lambda: fluxes(panel(CLEAR, FILM)), "no other layer"),
    (lambda: fluxes(coat()).compare([0.0]), "lengths must be above 0"),
    # measurements
    (
        partial(vrte.Measurement, "total_reflectance", 52.0, 0.5, theta_i_deg=8.0),
        r"52 is above 1, .* by more than 5 sigma; it looks like per cent",
    ),
]  # fmt: skip


@pytest.mark.parametrize(("call", "words"), REFUSED, ids=[words[:40] for _, words in REFUSED])
def test_it_is_refused_in_one_sentence(call: Any, words: str) -> None:
    with pytest.raises(vrte.SceneError, match=words) as caught:
        call()
    assert "\n" not in str(caught.value)


RUTILE = {"paint": {"pigment": "rutile", "volume_fraction": 0.15, "binder": "alkyd", "thickness_um": 40.0}}
PAINTS = [
    ({"scene": RUTILE, "wavelengths_um": [0.5, 0.55, 0.6]}, "wavelengths_um must cover the visible"),
    ({"scene": RUTILE, "wavelengths_um": [0.4, 0.5, 0.6, 0.7]}, "must be at most .* apart"),
    ({"scene": RUTILE, "wavelengths_um": np.linspace(0.43, 0.79, 10)}, "a wavelength of 0.79 um is outside"),
    ({"scene": RUTILE, "white": 2.0}, "white must be an albedo from 0 to 1"),
    ({"scene": RUTILE, "binder": "alkyd"}, "give either a scene file, or pigment, binder"),
    ({}, "give either a scene file"),
]


@pytest.mark.parametrize(("given", "words"), PAINTS)
def test_paints_are_refused_before_particles_are_made(given: Any, words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def work(*_: Any) -> None:
        raise AssertionError("particles were made")

    monkeypatch.setattr(sys.modules[make_panel.__module__], "run_side_by_side", work)
    with pytest.raises(vrte.SceneError, match=words):
        vrte.paint(**given)


def scene(thickness: float = 1.0) -> vrte.Scene:
    return vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.95, thickness)], vrte.Lambertian(0.3))


ROWS = vrte.Measurement("f00", 0.0, theta_i_deg=40.0, theta_o_deg=[-60.0, -30.0, 0.0])
BEAMS, THROUGH = (
    vrte.Measurement(f"{kind}", 0.1, 0.01, theta_i_deg=[0.0, 60.0])
    for kind in ("specular_reflectance", "total_transmittance")
)
AT_WAVELENGTHS = vrte.Measurement("reflectance", 0.1, geometry="8:di", wavelength_um=[0.5, 0.6])
FITS: list[tuple[dict[str, Any], str]] = [
    ({"scene": scene(np.inf)}, "base.albedo"),
    (
        {"scene": scene(np.inf), "rows": THROUGH, "free": ["layer[1].albedo"]},
        "nothing comes out below a semi-infinite ",
    ),
    ({"rows": BEAMS}, "free: base.albedo does nothing to these data"),
    ({"rows": AT_WAVELENGTHS}, "knows no wavelength"),
    ({"free": {"base.albedo": {"start": 0.5, "high": 0.4}}}, "starts at 0.5, outside its bounds 0 and 0.4"),
    ({"free": {"base.albedo": {"low": 0.5, "high": 0.4}}}, "needs low below high"),
    ({"free": {"base.albedo": {"strat": 0.5}}}, "takes a table of start, low, high, spacing"),
    ({"free": {"base.albedo": {"spacing": "even"}}}, "has spacing 'linear' or 'log', not 'even'"),
    ({"free": {"base.albedo": {"start": np.inf}}}, "needs a number as start"),
    ({"free": {"base.albedo": {"low": -1.0, "spacing": "log"}}}, "with spacing 'log' needs a start above 0"),
    ({"free": {"base.albedo": {"low": 0.0}}, "bounds": {"base.albedo": (0.0, 1.0)}}, "has bounds twice"),
    ({"free": ["layer[1].thickness", "layer[1].albedo", "base.albedo"], "rows": ROWS.pick([0, 1])}, "too few"),
    ({"free": []}, "free must be one or more names"),
    ({"free": ["layer[3].thickness"]}, "free: layer[3].thickness: there is no such layer"),
    ({"free": ["layer[1].thickness"], "starts": 3}, "needs finite bounds"),
    ({"bounds": {"base.albedo": 0.5}}, "needs two numbers, low and high"),
    ({"bounds": {"base": (0.3, 0.5)}}, "bounds: base is not free"),
    ({"priors": {"base.albedo": (0.3, 0.0)}}, "a standard deviation above 0"),
    ({"priors": {"base.albedo": 0.3}}, "needs a mean and a standard deviation"),
    ({"priors": {"base": (0.3, 0.1)}}, "priors: base is not free"),
    ({"loss": "huber"}, "loss must be"),
    ({"wavelengths_um": [0.5]}, "wavelengths_um are of colours"),
]


@pytest.mark.parametrize(("given", "words"), FITS, ids=[words[:40] for _, words in FITS])
def test_fits_are_refused_in_one_sentence(given: dict[str, Any], words: str) -> None:
    given = {"rows": ROWS, "scene": scene(), "free": ["base.albedo"], **given}
    with pytest.raises(vrte.SceneError, match=re.escape(words)) as caught:
        vrte.fit(given.pop("rows").measure(0.1, 0.01), given.pop("scene"), nodes=4, **given)
    assert "\n" not in str(caught.value)
