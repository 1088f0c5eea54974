"""Sweeps of appearance: colours and contrast ratios of many panels, with all that other sweeps guarantee."""

import copy
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.appearance.colours import find_colour
from vrte.appearance.geometries import MULTI_ANGLE
from vrte.appearance.gloss import find_gloss
from vrte.appearance.hiding import Conditions, find_hiding
from vrte.appearance.panel import make_panel
from vrte.basics.errors import SceneError
from vrte.calls.brdfs import Share, run_side_by_side, share_cores
from vrte.formats import particle_sources
from vrte.sweep import store
from vrte.sweep.interpolation import held_out
from vrte.sweep.run import SweepWarning
from vrte.sweep.template import read_sweep

from .helpers import assert_close, close_to
from .test_sweep import RAYLEIGH, powder

GREY = {"kind": "lambertian", "albedo": 0.4}
AT = {"start": 0.43, "stop": 0.67, "count": 7}
GOLD = {
    "nodes": 4,
    "particles": {"gold": {"index": "gold", "radius_um": 0.03}},
    "layer": [{"particles": "gold", "thickness": 1.0}],
    "appearance": {"wavelengths_um": AT, "quantities": ["contrast_ratio", "L", "h"]},
    "axes": {
        "radius": {"key": "particles.gold.radius_um", "values": [0.03, 0.05]},
        "depth": {"key": "layer[1].thickness", "values": [0.5, 2.0]},
    },
}


def make_films(quantities: list[str], axes: dict[str, Any]) -> dict[str, Any]:
    """A sweep of Rayleigh layers over a grey floor, some milliseconds a scene."""
    asked = {"wavelengths_um": AT, "quantities": quantities}
    return {"nodes": 3, "layer": [RAYLEIGH], "base": GREY, "appearance": asked, "axes": axes}


def change(content: dict[str, Any], **appearance: Any) -> dict[str, Any]:
    """The same with other keys in its table [appearance]."""
    return {**content, "appearance": content["appearance"] | appearance}


DEPTHS = {"depth": {"key": "layer[1].thickness", "values": [0.2, 1.0, 3.0]}}


def test_each_panel_is_that_of_brdfs_by_hand() -> None:
    names = ["contrast_ratio", "X", "Y", "L", "C", "h", "reflectance", "reflectance_over_white"]
    table = vrte.sweep(change(GOLD, quantities=names, black=0.1, white=0.7) | {"base": GREY}, workers=1)
    assert dict(table.sizes) == {"radius": 2, "depth": 2, "wavelength_um": 7}
    assert not (table.error != "").any()
    at = np.linspace(0.43, 0.67, 7)
    for radius, depth in ((0.03, 2.0), (0.05, 0.5)):
        gold = [vrte.spheres("gold", radius_um=radius, wavelength_um=one) for one in at]
        found = {}
        for albedo in (0.1, 0.4, 0.7):
            scenes = [vrte.Scene([vrte.Layer.of(one, depth)], vrte.Lambertian(albedo)) for one in gold]
            light = [vrte.brdf(scene, np.sqrt(0.5), 1.0, nodes=4).mueller[0, 0, 0, 0, 0] for scene in scenes]
            found[albedo] = np.pi * np.array(light)
        here = table.sel(radius=radius, depth=depth)
        assert_close(here.reflectance, found[0.4], rtol=1e-12, atol=0.0)
        assert_close(here.reflectance_over_white, found[0.7], rtol=1e-12, atol=0.0)
        dark, own, bright = (find_colour(at, found[albedo]) for albedo in (0.1, 0.4, 0.7))
        assert here.contrast_ratio.item() == close_to(dark.Y / bright.Y, rtol=1e-12, atol=0.0)
        for name in ("X", "Y", "L", "C", "h"):
            assert here[name].item() == close_to(getattr(own, name), rtol=1e-10, atol=0.0), name


def test_a_table_says_what_it_holds(tmp_path: Path) -> None:
    table = vrte.sweep(make_films(["contrast_ratio", "L", "h", "reflectance"], DEPTHS), tmp_path / "table.nc").load()
    assert set(table.data_vars) == {"contrast_ratio", "L", "h", "reflectance", "error"}
    assert table.reflectance.dims == ("depth", "wavelength_um")
    assert "ISO 6504-3" in table.contrast_ratio.attrs["long_name"]
    assert (table.h.attrs["units"], table.wavelength_um.attrs["units"]) == ("degree", "um")
    assert table.attrs["title"] == "Appearance of particulate layers"
    assert "illuminant D65, observer 10 degrees" in table.attrs["comment"]


@pytest.mark.parametrize(("content", "kinds"), [(GOLD, 2 * 7), (powder(nodes=4), 2 * 2)])
def test_particles_are_worked_out_once_for_all_scenes(
    content: dict[str, Any], kinds: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: Counter[tuple[float, float]] = Counter()

    def count(source: str, given: dict[str, Any]) -> vrte.Particles:
        made[given["radius_um"], round(given["wavelength_um"], 6)] += 1
        return particle_sources.make_particles(source, given)

    monkeypatch.setattr(store, "make_particles", count)
    vrte.sweep(content, tmp_path / "table.zarr", workers=2, chunk=1).close()
    assert (set(made.values()), len(made)) == ({1}, kinds)


def test_a_panel_that_fails_is_recorded_and_the_rest_goes_on() -> None:
    content = copy.deepcopy(GOLD)
    content["axes"]["radius"]["values"] = [0.03, 0.0]
    with pytest.warns(SweepWarning, match="2 of 4 scenes failed; the first said: at 0.43 um: particles.gold.radius_um"):
        table = vrte.sweep(content, workers=1)
    assert (table.error != "").values.tolist() == [[False, False], [True, True]]
    assert np.isfinite(table.L.values[0]).all()
    assert np.isnan(table.L.values[1]).all()
    with pytest.warns(SweepWarning, match="how thick a film hides is asked for in um, and it is given opt"):
        vrte.sweep(make_films(["hiding_thickness_um"], DEPTHS))


def test_between_the_panels_hues_go_the_shorter_way_around() -> None:
    axes = {"depth": {"key": "layer[1].thickness", "start": 0.5, "stop": 2.0, "count": 4}}
    table = vrte.sweep(make_films(["L", "h", "reflectance"], axes))
    exact = vrte.sweep(make_films(["L", "reflectance"], {"depth": {"key": "layer[1].thickness", "values": [1.1]}}))
    between = vrte.interpolate(table, {"depth": 1.1})
    assert between.L.item() == close_to(exact.L.item(), rtol=0.0, atol=0.02)
    assert_close(between.reflectance, exact.reflectance[0], rtol=2e-3, atol=0.0)
    at_green = vrte.interpolate(table, {"depth": 1.1, "wavelength_um": 0.56})
    assert at_green.reflectance.item() == close_to(float(between.reflectance.mean()), rtol=1e-2, atol=0.0)
    table.h.values[:] = [350.0, 358.0, 6.0, 14.0]  # through red, 8 degrees a step
    assert vrte.interpolate(table, {"depth": 1.25}).h.item() == close_to(2.0, rtol=0.0, atol=1e-9)
    with pytest.raises(SceneError, match="held_out measures BRDFs, and this is a table of appearances"):
        held_out(table)


def test_what_is_refused() -> None:
    rows: list[tuple[dict[str, Any], dict[str, Any], str]] = [
        ({"quantities": ["contrast"]}, {}, "\"contrast\" is none; did you mean 'contrast_ratio'?"),
        ({"quantities": []}, {}, "appearance.quantities = []: must be a list of some of X, Y, Z, L"),
        ({"quantities": ["L", "L"]}, {}, '"L" is there twice'),
        ({"white": 0.7}, {}, "appearance.white = 0.7: none of the quantities depends on it: L, h"),
        ({"layer": 1}, {}, "appearance.layer = 1: none of the quantities depends on it: L, h"),
        ({"illuminant": "D66"}, {}, "illuminant must be one of"),
        ({"wavelengths_um": [0.5, 0.6]}, {}, "must cover the visible"),
        ({"wavelengths_um": [0.6, 0.5]}, {}, "must be positive and ascending"),
        ({"colour": "D65"}, {}, 'appearance.colour = "D65": unknown key'),
        ({}, {"wavelength_um": 0.5}, "wavelength_um = 0.5: an appearance is of several"),
        ({}, {"wavelength_um": [0.5, 0.6]}, "leave one of the two out"),
        ({}, {"brdf": {"mu_i": 0.5, "mu_o": 0.5}}, "leave out [brdf] or [appearance]"),
        ({}, {"axes": {"wavelength_um": [0.5]}}, "an appearance is of all wavelengths of appearance.wavelengths_um"),
        ({}, {"axes": {"L": {"key": "base.albedo", "values": [0.5]}}}, "axes.L: this name is taken by the table"),
        ({}, {"axes": {"appearance.white": [0.5]}}, "is the same for all scenes of a table"),
        ({}, {"axes": {"layer[1].albedo": [0.5, 2.0]}}, "axes.layer[1].albedo, value 2: "),
        ({}, {"illuminate": "bottom"}, "illuminate must be 'top'"),
    ]
    for asked, more, words in rows:
        with pytest.raises(SceneError) as caught:
            read_sweep(change(make_films(["L", "h"], DEPTHS), **asked) | more)
        assert words in str(caught.value)


@pytest.mark.slow
def test_what_hides_is_what_find_hiding_finds() -> None:
    names = ["contrast_ratio", "hiding_thickness_um", "spreading_rate", "opacity", "reflectance_over_black"]
    asked = {"wavelengths_um": AT, "quantities": names, "black": 0.1, "target": 0.9}
    grey = {"index": [1.5, 0.002], "radius_um": 0.1}
    layer = {"particles": "grey", "volume_fraction": 0.02, "thickness_um": 60.0}
    axes = {"white": {"key": "base.albedo", "values": [0.0, 1.0]}}  # the cards take the base's place
    content = {"nodes": 6, "host_index": 1.3, "particles": {"grey": grey}, "layer": [layer], "axes": axes}
    table = vrte.sweep(content | {"base": {"kind": "lambertian", "albedo": 0.0}, "appearance": asked})
    assert not (table.error != "").any()
    panel = make_panel({key: value for key, value in content.items() if key != "axes"}, np.linspace(0.43, 0.67, 7))
    found = find_hiding(panel, Conditions(black=0.1, target=0.9))
    for here in (table.isel(white=0), table.isel(white=1)):
        assert here.contrast_ratio.item() == close_to(found.contrast_ratio, rtol=1e-10, atol=0.0)
        assert here.hiding_thickness_um.item() == close_to(found.hiding_length_um, rtol=1e-6, atol=0.0)
        assert here.spreading_rate.item() == close_to(1000.0 / here.hiding_thickness_um.item(), rtol=1e-12, atol=0.0)
        assert here.opacity.item() == close_to(found.opacity, rtol=1e-10, atol=0.0)
        assert_close(here.reflectance_over_black, found.reflectance_over_black, rtol=1e-10, atol=0.0)


def test_glosses_are_those_of_a_glossmeter() -> None:
    layers = [{"interface": {"above": 1.0, "below": 1.567}}, {"phase": "rayleigh", "albedo": 0.0, "thickness": 30.0}]
    axes = {"index": {"key": "layer[1].interface.below", "values": [1.4, 1.567]}}
    content = make_films(["gloss_20", "gloss_60", "contrast_ratio"], axes)
    table = vrte.sweep(content | {"nodes": 4, "layer": layers})  # its base far below a black layer: a black glass
    assert set(table.data_vars) == {"gloss_20", "gloss_60", "contrast_ratio", "error"}
    assert_close([table.gloss_20[1], table.gloss_60[1]], 100.0, rtol=1e-3, atol=0.0)
    clear = {"interface": {"above": 1.0, "below": 1.4}}
    panel = make_panel({"nodes": 4, "layer": [clear, layers[1]]}, table.wavelength_um)
    assert table.gloss_60[0].item() == close_to(find_gloss(panel, 60.0), rtol=1e-6, atol=0.0)


def test_a_flop_index_of_a_sweep_is_that_of_the_appearance() -> None:
    layer = {"phase": {"henyey_greenstein": 0.8}, "albedo": 0.9, "thickness": 2.0}
    axes = {"depth": {"key": "layer[1].thickness", "values": [0.5, 2.0]}}
    table = vrte.sweep(make_films(["flop_index"], axes) | {"layer": [layer], "nodes": 6})
    look = vrte.appearance({"nodes": 6, "layer": [layer], "base": GREY}, table.wavelength_um.values, MULTI_ANGLE)
    assert table.flop_index[1].item() == close_to(look.flop_index(), rtol=1e-9, atol=0.0)


@pytest.mark.parametrize("cores", [1, 2])
def test_a_panel_stops_with_the_sweep_that_it_is_of(cores: int) -> None:
    share, done = Share(cores), []

    def stop() -> None:
        done.append(1)
        share.stop[0] = 1

    with share_cores(share), pytest.raises(KeyboardInterrupt):
        run_side_by_side([stop, *[lambda: time.sleep(0.05)] * cores, lambda: done.append(2)])
    assert done == [1]
