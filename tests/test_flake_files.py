"""Oriented flakes in scene files, paints, sweeps and families."""

import re
from pathlib import Path
from typing import Any

import pytest

import vrte
from vrte.formats.particle_sources import make_particles
from vrte.formats.scene_file import find_known_wavelengths, find_named_tables, list_substances, make_scene_file
from vrte.sweep.template import make_scene_at, read_sweep

BEAM = {"wavelength_um": 0.55, "brdf": {"mu_i": 0.5, "mu_o": 0.5}}
STACK = [["hematite", 0.03], ["silica", 0.35]]
GOLD: dict[str, Any] = {"flakes": {"index": "aluminium", "tilt_deg": 10, "stack": STACK}, "host_index": 1.5}
FILM: dict[str, Any] = {"volume_fraction": 0.1, "flake_thickness_um": 0.3, "thickness_um": 15.0}
POWDER: dict[str, Any] = {"particles": {"dust": {"index": 1.6, "radius_um": 0.1}}, "host_index": 1.5}
PAINT = {"flakes": {"index": "aluminium"}, "binder": 1.5, **FILM}


def make_layer(table: dict[str, Any], **more: Any) -> vrte.Layer:
    return make_scene_file({**BEAM, "layer": [table], **more}).scene.layers[0]


def test_a_layer_of_flakes_is_that_of_python() -> None:
    layer = make_layer({**GOLD, **FILM})
    stack: Any = [tuple(row) for row in STACK]
    expected = vrte.flakes("aluminium", 10.0, stack, 0.55, 1.5)
    assert layer.flakes == expected
    assert layer.flake_area == 0.1 / 0.3 * 15.0
    assert (layer.thickness, layer.host_index) == (0.0, 1.5)
    mirrors = make_layer({"flakes": {"tilts": {"angle_deg": [0, 10], "density": [1, 0]}}, "flake_area": 2.0})
    assert mirrors.flakes == vrte.flakes(tilts=([0.0, 10.0], [1.0, 0.0]), wavelength_um=0.55)


def test_plates_of_a_file_let_light_through() -> None:
    plates = {"substrate": "mica", "stack": [["anatase", 0.05]]}
    expected = vrte.flakes(None, 12.0, [("anatase", 0.05)], 0.55, 1.5, substrate="mica")
    for more in ({}, {"transparent": True}):
        assert make_layer({"flakes": {**plates, **more}, "host_index": 1.5, **FILM}).flakes == expected
    content = {**BEAM, "layer": [{"flakes": plates, **FILM}]}
    assert [name for _, name in list_substances(content)] == ["mica", "anatase"]


def test_flakes_lie_beside_particles_in_their_medium() -> None:
    for filling in ({"particles": "dust", "thickness": 1.0}, {"phase": "rayleigh", "albedo": 0.5, "thickness": 1.0}):
        layer = make_layer({**filling, "flakes": {"index": [0.3, 3.0]}, "flake_area": 2.0}, **POWDER)
        assert layer.extent == 3.0
        assert layer.flakes.host_index == (1.5 if "particles" in filling else 1.0) == layer.host_index


def test_substances_of_films_are_known_and_may_be_tables(tmp_path: Path) -> None:
    content = {**BEAM, "layer": [{**GOLD, **FILM}]}
    assert [name for _, name in list_substances(content)] == ["aluminium", "hematite", "silica"]
    assert find_known_wavelengths(content)[:2] == (0.21, 6.7)
    (tmp_path / "own.csv").write_text("wavelength_um,n,k\n0.4,1.5,0\n0.7,1.5,0\n")
    content["layer"] = [{**GOLD, **FILM, "flakes": {"index": 1.5, "stack": [["own.csv", 0.1]]}}]
    assert find_named_tables(content) == {("layer", 0, "flakes", "stack", 0, 0): "own.csv"}
    flakes = make_scene_file(content, folder=tmp_path).scene.layers[0].flakes
    assert flakes.films == ((1.5 + 0j, 0.1),)


def test_a_paint_of_flakes_has_a_film_under_a_surface() -> None:
    alone = make_scene_file({**BEAM, "paint": PAINT}).scene
    assert alone.interfaces[0] is not None
    assert alone.layers[0].flake_area == 0.1 / 0.3 * 15.0
    beside = {"pigment": "hematite", "volume_fraction": 0.02, "binder": 1.5, "thickness_um": 15.0}
    both = make_scene_file({**BEAM, "paint": {**beside, "flakes": {"index": "aluminium"}, "flake_area": 2.0}}).scene
    assert both.layers[0].flake_area == 2.0
    assert both.layers[0].thickness > 0.1


def test_sweeps_and_families_change_numbers_of_flakes(tmp_path: Path) -> None:
    axes = {"paint.flakes.tilt_deg": [5.0, 10.0], "paint.volume_fraction": [0.05, 0.1]}
    sweep = read_sweep({**BEAM, "paint": {**PAINT, "flakes": {"tilt_deg": 8.0}}, "axes": axes}, tmp_path)
    layer = make_scene_at(sweep, (1, 0), make_particles).scene.layers[0]
    assert (layer.flakes.tilt_deg, layer.flake_area) == (10.0, 0.05 / 0.3 * 15.0)
    names = ["layer[1].flakes.stack[2][2]", "layer[1].flakes.tilt_deg", "layer[1].thickness_um"]
    family = vrte.SceneFamily({**BEAM, "layer": [{**GOLD, **FILM}]}, names)
    moved = family.at([0.4, 6.0, 30.0]).layers[0]
    assert (moved.flakes.films[1][1], moved.flakes.tilt_deg) == (0.4, 6.0)
    assert moved.flake_area == 0.1 / 0.3 * 30.0
    assert all(one.is_outside for one in family.variations())  # no closed form: by differences of whole solves


@pytest.mark.parametrize(("table", "words"), [
    ({**GOLD}, "layer[1].flake_area of flakes alone is needed, or volume_fraction"),
    ({**GOLD, "flake_area": -1}, "layer[1].flake_area must be an area >= 0"),
    ({**GOLD, "thickness": 1.0}, "layer[1].thickness = 1.0: is that of particles; flakes alone have flake_area"),
    ({"flakes": {"tilt_deg": 0}, "flake_area": 1}, "layer[1].flakes.tilt_deg must be from 0.5 to 60 degrees"),
    ({"flakes": {"tilt": 3}, "flake_area": 1}, "layer[1].flakes.tilt = 3: unknown key"),
    ({"flakes": {"stack": ["silica"]}, "flake_area": 1}, 'layer[1].flakes.stack = ["silica"]: must be a list of films'),
    ({"flakes": {"transparent": True}, "flake_area": 1}, "layer[1].flakes.transparent needs a substrate"),
    ({"flakes": {"substrate": "gold"}, "flake_area": 1}, "layer[1].flakes.substrate must be that of a clear plate"),
    ({"flakes": {"index": "goold"}, "flake_area": 1}, "layer[1].flakes.index: 'goold' is neither"),
    ({"flakes": {}, "phase": "isotropic", "albedo": 1, "thickness": 1}, "need both of flakes and flake_area"),
    ({"flake_area": 1, "phase": "isotropic", "albedo": 1, "thickness": 1}, "need both of flakes and flake_area"),
])  # fmt: skip
def test_what_is_wrong_is_reported_at_its_place(table: dict[str, Any], words: str) -> None:
    with pytest.raises(vrte.SceneError, match=re.escape(words)):
        make_layer(table)


def test_a_paint_of_flakes_alone_has_no_area_of_its_own() -> None:
    with pytest.raises(vrte.SceneError, match=r"^paint.flake_area = 2.0: is of flakes beside pigments"):
        make_scene_file({**BEAM, "paint": {**PAINT, "flake_area": 2.0}})
