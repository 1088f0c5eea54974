"""Paints in scene files: what they are expanded to, what is refused and where, ready ones, and every command's view."""

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte import SceneError
from vrte.app.form.checks import adopt_with_notes
from vrte.formats.materials import (
    PIGMENTS,
    REPLACED,
    expand_content,
    expand_paint,
    find_pigment,
    list_materials,
    list_paints,
)
from vrte.formats.particle_sources import check_particles, make_particles
from vrte.formats.scene_file import (
    find_known_wavelengths,
    find_named_tables,
    list_substances,
    make_scene_file,
    read_content,
)
from vrte.render import rendering
from vrte.sweep.template import make_scene_at, read_sweep

from .helpers import close_to

EXAMPLES = Path(__file__).parents[1] / "examples"
WHITE = {"pigment": "rutile", "volume_fraction": 0.15, "binder": "alkyd", "thickness_um": 60.0}
BEAM = {"wavelength_um": 0.55, "brdf": {"mu_i": 0.5, "mu_o": 0.5}}


def of(**changed: Any) -> dict[str, Any]:
    """A scene file of the white paint with some of its keys changed; None leaves one out."""
    return {"paint": {key: value for key, value in {**WHITE, **changed}.items() if value is not None}, **BEAM}


def read(**changed: Any) -> Any:
    """The same, read, but for what computing particles would find."""
    return make_scene_file(of(**changed), compute=check_particles)


# ---- what it is expanded to


def test_a_paint_is_its_particles_layers_and_base_written_out() -> None:
    rutile = list_materials()["rutile in alkyd"].particles["rutile"]
    film = {"volume_fractions": {"rutile": 0.15}, "thickness_um": 60.0, "packing": "coherent-potential"}
    facets = {"roughness": 0.2, "distribution": "ggx"}
    surface, base = {"above": 1.0, "below": "alkyd", **facets}, {"kind": "lambertian", "albedo": 0.8}
    written = {"particles": {"rutile": rutile}, "layer": [{"interface": surface}, {"host_index": "alkyd", **film}]}
    assert expand_paint(of(surface=facets, substrate=base)) == {**written, "base": base, **BEAM}
    for changes, flags in (
        ({}, (True, True)),
        ({"shadowing": False}, (False, False)),
        ({"conserving": False}, (True, False)),
    ):
        interface = read(surface=facets | changes).scene.interfaces[0]
        assert (interface.shadowing, interface.conserving) == flags
    needles = {"rutile": {"source": "spheroids", "index": "rutile", "aspect_ratio": 0.7, "radius_um": 0.1}}
    assert expand_paint(of(particles=needles))["layer"][1]["packing"] == "independent"
    assert expand_paint(of(packing="percus-yevick"))["layer"][1]["packing"] == "percus-yevick"
    scene = read(thickness_um=math.inf, surface="none").scene
    assert (scene.thickness, scene.interfaces[0]) == (math.inf, None)
    assert read().scene.interfaces[0] == vrte.Interface(1.0, 1.52)


def test_a_pigment_is_coarser_where_the_paint_says_so_and_another_substance_needs_its_size() -> None:
    found = expand_paint(of(particles={"rutile": {"diameter_um": 0.3}}))["particles"]["rutile"]
    assert found == {"index": "rutile", "diameter_um": 0.3}
    coat = expand_paint(of(pigment="silica-coated rutile", particles={"silica-coated rutile": {"core_ratio": 0.9}}))
    assert {"shell_um", "core_ratio"} & {*coat["particles"]["silica-coated rutile"]} == {"core_ratio"}
    found = expand_paint(of(pigment="zinc oxide", particles={"zinc oxide": {"radius_um": 0.1}}))["particles"]
    assert found == {"zinc oxide": {"index": "zinc oxide", "radius_um": 0.1}}
    ochre = {"ochre": {"index": "ochre.csv", "radius_um": 0.2}}
    assert find_named_tables(of(pigment="ochre", particles=ochre)) == {("particles", "ochre", "index"): "ochre.csv"}


def test_every_pigment_has_the_grains_of_a_ready_material() -> None:
    for pigment, material in PIGMENTS.items():
        (grains,) = list_materials()[material].particles.values()
        assert find_pigment(pigment) == grains
    assert {name for name in list_materials() if " in " in name} <= {*PIGMENTS.values()}  # none is forgotten
    assert find_pigment("calcite") == find_pigment("chalk")
    assert find_pigment("gypsum") is None
    content = of(pigment={"rutile": 0.1, "hematite": 0.01}, volume_fraction=None)
    assert find_known_wavelengths(content)[:2] == (0.36, 0.83)
    assert {name for _, name in list_substances(content)} == {"rutile", "hematite", "alkyd"}


def test_nothing_jumps_as_pigment_is_added() -> None:
    """Few grains are as if alone: the optical thickness of a volume of them goes over into the independent one's."""

    def find(fraction: float, **how: Any) -> float:
        layer = make_scene_file(of(volume_fraction=fraction, **how)).scene.layers[0]
        return layer.thickness * (1.0 - layer.phase_matrix.asymmetry) / fraction

    alone = find(0.01, packing="independent")
    assert find(1e-4) == close_to(alone, rtol=2e-3, atol=0.0)
    steps = np.diff([find(fraction) for fraction in (0.09, 0.10, 0.11)])
    assert abs(steps).max() < 0.05 * alone
    assert find(0.2) < find(0.1) < alone


# ---- what is wrong

WRONG: list[tuple[dict[str, Any], str]] = [
    ({"pigment": "rutil"}, "paint.pigment = \"rutil\": no pigment 'rutil'; did you mean 'rutile'? Known: rutile,"),
    ({"pigment": "zinc oxide"}, 'any other substance needs its size, as particles."zinc oxide" = { diameter_um'),
    ({"pigment": 3}, "paint.pigment = 3: must be a name, or a table"),
    ({"pigment": None}, "paint.pigment: is missing"),
    ({"volume_fraction": None}, "paint.volume_fraction: is missing; it must be from 0 to below 1"),
    ({"volume_fraction": 1.5}, "paint.volume_fraction = 1.5: must be from 0 to below 1"),
    ({"pigment": {"rutile": 0.1}}, "paint.volume_fraction = 0.15: goes with one pigment by its name"),
    ({"pigment": {"rutile": 0.6, "hematite": 0.4}, "volume_fraction": None}, ": their sum must be below 1, the"),
    ({"pigment": {"rutile": -0.1}, "volume_fraction": None}, "paint.pigment.rutile = -0.1: must be from 0 to below 1"),
    ({"binder": None}, "paint.binder: is missing; it must be a substance"),
    ({"binder": "alkid"}, "alkid"),
    ({"thickness_um": -1.0}, "paint.thickness_um must be a length in micrometres >= 0, "),
    ({"surface": "shiny"}, 'paint.surface = "shiny": must be "smooth", "none" or a table with roughness'),
    ({"surface": {"rough": 0.2}}, "paint.surface.rough = 0.2: unknown key"),
    ({"substrate": {"kind": "lambertian", "albedo": 2}}, "paint.substrate.albedo"),
    ({"packing": "tight"}, 'paint.packing = "tight": must be "independent" or'),
    ({"particles": {"chalk": {}}}, "paint.particles.chalk = {}: is none of the pigments of this paint"),
    ({"particles": {"rutile": {"size": 1}}}, "paint.particles.rutile.size = 1: must be a table"),
    ({"particles": 1}, "paint.particles = 1: must be tables headed [paint.particles.NAME]"),
    ({"colour": "white"}, 'paint.colour = "white": unknown key'),
]
ALONE = [
    *(({**of(), key: {}}, f"paint: a file with a table [paint] has no {key} of its own") for key in REPLACED),
    ({"paint": 3, **BEAM}, "paint = 3: must be a table"),
    ({**of(binder=[1.5, 0.0]), "wavelength_um": 0.35}, "paint.particles.rutile.index: rutile goes from"),
]


@pytest.mark.parametrize(("content", "words"), [*((of(**changed), words) for changed, words in WRONG), *ALONE])
def test_what_is_wrong_is_reported_of_the_paints_own_key(content: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError, match=re.escape(words)) as caught:
        make_scene_file(content, compute=make_particles if content.get("wavelength_um") == 0.41 else check_particles)
    assert caught.value.place[0] == "paint"
    assert str(caught.value).startswith("paint")


# ---- wherever scene files go


def test_a_sweep_changes_numbers_of_the_paint() -> None:
    """Where each stands once the paint is expanded, and the same through a scene."""
    base: dict[str, Any] = {"substrate": {"kind": "lambertian", "albedo": 0.9}, "surface": {"roughness": 0.1}}
    base |= {"particles": {"rutile": {"diameter_um": 0.25}}}
    for key, value, changed in (
        ("paint.thickness_um", 20.0, {"thickness_um": 20.0}),
        ("paint.volume_fraction", 0.05, {"volume_fraction": 0.05}),
        ("paint.surface.roughness", 0.3, {"surface": {"roughness": 0.3}}),
        ("paint.substrate.albedo", 0.3, {"substrate": {"kind": "lambertian", "albedo": 0.3}}),
        ("paint.particles.rutile.diameter_um", 0.3, {"particles": {"rutile": {"diameter_um": 0.3}}}),
        ("layer[2].volume_fractions.rutile", 0.05, {"volume_fraction": 0.05}),
    ):
        there = make_scene_at(read_sweep({**of(**base), "axes": {key: [value]}}), (0,), make_particles).scene
        alone = make_scene_file(of(**{**base, **changed})).scene
        assert (there.interfaces, there.base) == (alone.interfaces, alone.base), key
        assert there.layers[0].thickness == alone.layers[0].thickness, key


def test_a_smooth_paint_has_no_facets_to_change() -> None:
    with pytest.raises(vrte.SceneError, match=r"paint\.surface\.roughness changes facets, and the paint has none"):
        read_sweep({**of(), "axes": {"paint.surface.roughness": [0.1, 0.2]}})
    with pytest.raises(SceneError, match=r"^axes\.paint\.thicknes: the scene has no paint\.thicknes$"):
        read_sweep({**of(), "axes": {"paint.thicknes": [1.0]}})


def test_the_viewer_takes_it_apart() -> None:
    content, notes = adopt_with_notes({key: value for key, value in of().items() if key == "paint"})
    assert "paint" not in content
    assert list(content["particles"]) == ["rutile"]
    assert content["layer"][1]["thickness_um"] == 60.0
    assert any("wavelength_um is missing" in one for one in notes)
    _, notes = adopt_with_notes(of(binder="/etc/own.csv"))  # which nobody reads
    assert any('"/etc/own.csv" is not here' in one for one in notes)


@pytest.mark.parametrize("name", ["white_paint", "red_oxide"])
def test_an_example_is_read_by_every_command(name: str) -> None:
    content = read_content(EXAMPLES / f"{name}.toml")
    assert rendering.read([EXAMPLES / f"{name}.toml"], None)[0][0].coloured
    adopt_with_notes(content)
    asked = [{**one, "wavelength_um": 0.55} for one in (content, expand_content(content))]
    made, written = (make_scene_file(one, "brdf", EXAMPLES).scene.layers[0] for one in asked)
    assert made.thickness == written.thickness > 20.0


# ---- ready paints


@pytest.mark.parametrize("name", sorted(list_paints()))
def test_a_ready_paint_says_what_it_is_and_solves(name: str) -> None:
    paint = list_paints()[name]
    content, whole = paint.content, paint.content
    assert all((paint.title, paint.description.endswith("."), paint.approximations))
    assert any(words.startswith("typical") for words in paint.sources)
    content["paint"]["surface"] = "smooth"  # a rough one takes seconds; the paint itself stays as it is
    assert list_paints()[name].content == whole
    found = vrte.spectrum({**content, "brdf": {"mu_i": 0.7, "mu_o": 1.0}}, [0.6], nodes=6)
    dark = {"black gloss": (0.0, 0.05), "red oxide": (0.01, 0.1), "colour shifter": (0.01, 0.3)}
    low, high = dark.get(name, (0.3, 0.99))
    assert low < np.pi * found[0].mueller[0, 0, 0, 0, 0] < high
