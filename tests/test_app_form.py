"""The form of the viewer: what is typed, what is said to it, and what becomes of the scene."""

import copy
import inspect
import math
import re
import time
import tomllib
from contextlib import suppress
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import vrte
from vrte.app.form import checks
from vrte.app.form import content as form
from vrte.app.form.checks import MOST_OF_AXIS, adopt_with_notes, begin_with_material, list_films, write_content
from vrte.app.form.fields import (
    find_field,
    get_value,
    list_places,
    parse_field_text,
    parse_typed_text,
    translate_message,
    write_field_text,
)
from vrte.app.form.numbers import list_sliders
from vrte.app.form.units import BY_WEIGHT, UNITS, WET, PaintUnits, list_units
from vrte.appearance.gloss import find_surface_gloss
from vrte.fit.recipe import list_ingredients, read_film
from vrte.formats.bases import BASES
from vrte.formats.keys import Choice, FilePath, Flag
from vrte.formats.layers import LAYER_KEYS, PHASES
from vrte.formats.materials import list_materials, list_paints
from vrte.formats.particle_sources import SIZES, SOURCES
from vrte.formats.scattering import read_scattering
from vrte.formats.scene_file import FILE_KEYS, read_content
from vrte.formats.toml_table import read_fraction, show_place
from vrte.optics.crowding import PACKINGS

from .helpers import close_to

EXAMPLES = Path(__file__).parents[1] / "examples"
GALLERY = sorted((Path(vrte.__file__).parent / "app" / "gallery").glob("*.toml"))
ISOTROPIC = {"phase": "isotropic", "albedo": 0.5, "thickness": 1.0}


def problems(content: form.Content, *about: Any) -> dict[str, str]:
    """By the dotted key that a message is about."""
    return {show_place(index): message for index, message in checks.find_problems(content, *about).items()}


def fresh(**changes: Any) -> form.Content:
    return copy.deepcopy(form.START) | changes


def henyey_greenstein(g: float, **more: int) -> form.Content:
    return ISOTROPIC | {"phase": {"henyey_greenstein": g, **more}}


def find_files(row: Any, *place: Any) -> set[str]:
    """Where a row of a registry needs files, which somebody has to choose."""
    needed = [name for name, key in row.keys.items() if isinstance(key, FilePath) and key.needed] if row else []
    return {show_place((*place, name)) for name in needed}


@settings(max_examples=40)
@given(st.one_of(st.floats(allow_nan=False), st.integers(-(10**20), 10**20), st.lists(st.floats(0, 9), min_size=2)))
def test_text_becomes_a_value_and_the_value_the_same_text(value: Any) -> None:
    assert parse_field_text(write_field_text(value)) == value
    pairs = {"0.64": 0.64, " 12 ": 12, "1e-6": 1e-6, "inf": math.inf, "": None, "9" * 3000: math.inf}
    lists = {"1.5, 0.01": [1.5, 0.01], "0.05:1:20": {"start": 0.05, "stop": 1, "count": 20}}
    words = ("main/Au/Johnson", "1,,2", "1:2", "1:2:3,4", "0x10", "1_000", "<b>", "9" * 5000)
    for text, meant in (pairs | lists | {word: word for word in words}).items():
        assert parse_field_text(text) == meant


def test_messages_have_the_words_of_the_form() -> None:
    content = {"particles": {"fool's gold": {"diameter_um": 0.2}}, "layer": [{"thickness": -1}]}
    for message, words in (
        ("layer[1].thickness = -1: must be above 0", "layer 1: optical thickness must be above 0, not -1"),
        ("nodes must be 1", "nodes a hemisphere must be 1"),
        ('particles."fool\'s gold".diameter_um: half of it, x must', "fool's gold: diameter [µm]: half of it must"),
        ("layer[1].junk and layer[9].thickness", "layer 1: junk and layer 9: optical thickness"),
    ):
        assert translate_message(message, content) == words


MATT = begin_with_material(list_paints()["white matt"])[0]
LOAD, THICKNESS, ROUGHNESS, SIZE = (
    ("layer", 1, "volume_fractions", "rutile"), ("layer", 1, "thickness_um"), ("layer", 0, "interface", "roughness"),
    ("particles", "rutile", "size", "lognormal", "median_diameter_um"),
)  # fmt: skip
UNUSUAL = PaintUnits({kind: names[-1] for kind, names in UNITS.items()}, solids=0.4, densities={"binder": 1.18})


def test_a_field_of_one_number_takes_decimal_commas_and_units() -> None:
    for place, text, meant in (
        (THICKNESS, "12,5", 12.5), (THICKNESS, "60 µm", 60), (THICKNESS, "60 um", 60), (LOAD, "12,5 %", "12.5 %"),
        (SIZE, "250 nm", 0.25), (SIZE, "", ""), (THICKNESS, "", None), (LOAD, "3 nm", "3 nm"), (LOAD, "thick", "thick"),
        (("layer", 1, "host_index"), "1,5", [1, 5]), (("brdf", "mu_i"), "0,5", [0, 5]), (("nodes",), "4,5", [4, 5]),
    ):  # fmt: skip
        assert parse_typed_text(text, place, MATT) == meant


def test_what_is_wrong_with_a_paint_is_told_in_the_words_of_the_form() -> None:
    for place, text, words in (
        (THICKNESS, "", "layer 2: a thickness is needed"),
        (THICKNESS, "x", 'layer 2: thickness [µm] must be a number >= 0, not "x"'),
        (LOAD, "", "layer 2: volume fractions must be a fraction of each kind of particle"),
        (LOAD, "200 %", 'layer 2: rutile: of the volume must be from 0 to below 1, or per cent, 5 %, not "200 %"'),
        (SIZE, "", "rutile: median diameter [µm] must be a number"),
    ):
        content = copy.deepcopy(MATT)
        form.put(content, place, parse_typed_text(text, place, content))
        (message,) = checks.find_problems(content).values()
        assert translate_message(message, content) == words


def test_numbers_come_back_from_every_unit() -> None:
    """Also those of all paints, where their densities are known; the form keeps its own."""
    for film in list_films().values():
        content = begin_with_material(film)[0]
        for slider in list_sliders(content):
            units, value = UNUSUAL, read_fraction(get_value(content, slider.place))
            if units.get(content, slider.place) == BY_WEIGHT:
                parts = read_film(content, slider.place[1], Path()).parts
                units = PaintUnits(units.chosen, 0.4, dict.fromkeys(parts, 2.0) | {next(iter(parts)): 4.0})
            text, message = units.write(content, slider.place, value)
            assert message == ""
            assert units.read(content, slider.place, text) == close_to(value, rtol=3e-3, atol=0.0)


def test_units_are_what_they_say() -> None:
    assert UNUSUAL.read(MATT, THICKNESS, "150,0 µm wet") == 60.0
    assert UNUSUAL.convert_film(60.0) == (150.0, WET)
    assert UNUSUAL.read(MATT, SIZE, "250 nm") == 0.25
    film = read_film(MATT, 1, Path())
    weights = {one.name: one.weight for one in list_ingredients(film, {"rutile": 4.23, "binder": 1.18}, None)}
    assert UNUSUAL.show(MATT, LOAD, 0.12) == close_to(100.0 * weights["rutile"], rtol=1e-12, atol=0.0)
    roughness = UNUSUAL.read(MATT, ROUGHNESS, "30")
    surface = vrte.Interface(1.0, 1.49, roughness=roughness, distribution="ggx")
    assert find_surface_gloss(surface, 60.0) == close_to(30.0, rtol=1e-3, atol=0.0)
    learnt = UNUSUAL.learn_gloss(MATT, 3.4)  # of which the surface has 1.1
    assert learnt.show(MATT, ROUGHNESS, 0.4) == close_to(3.4, rtol=1e-12, atol=0.0)
    deep = copy.deepcopy(MATT)
    deep["layer"].append({"interface": {"above": 1.49, "below": 1.0, "roughness": 0.2}})
    assert list_units(deep, ("layer", 2, "interface", "roughness")) == UNITS["roughness"][:1]
    for place, text, words in (
        (THICKNESS, "thick", "give a number in µm wet, such as 12.5 or 12,5, not 'thick'"),
        (THICKNESS, "60 nm", "give a number in µm wet"),
        (LOAD, "", "give a number in wt %, such as 12.5 or 12,5"),
        (LOAD, "200", "the part of the weight must be from 0 to 100 %, not 200 %"),
        (ROUGHNESS, "99", "the gloss must be from 0.027 to 87.4 GU here, not 99"),
    ):
        with pytest.raises(vrte.SceneError, match=re.escape(words)):
            UNUSUAL.read(MATT, place, text)
    bare = PaintUnits(UNUSUAL.chosen)
    assert bare.write(MATT, THICKNESS, 60.0) == ("", "a wet film needs the volume solids: give them in per cent")
    assert bare.write(MATT, LOAD, 0.1) == ("", "per cent by weight need the density of binder: give it in kg/l")
    with pytest.raises(vrte.SceneError, match="volume fraction must be from 0 to 100 %, not 150 %"):
        PaintUnits().read(MATT, LOAD, "150")


# a field, what is wrong with it, and words of the library's message; one row for each way in which a place is found
WRONG: list[tuple[tuple[Any, ...], str, str]] = [
    (("wavelength_um",), "-0.5", "wavelength_um must be a length"),
    (("wavelength_um",), "0.5, nan", "wavelength_um must be finite"),
    (("wavelength_um",), "0.7:0.4:4", "ascending"),
    (("wavelength_um",), "0.4:0.7:41", "at most 40 wavelengths, not 41"),
    (("wavelength_um",), "", "is missing"),
    (("host_index",), "0", "host_index must be a real refractive index"),
    (("nodes",), "1000000", "must be a whole number from 1 to 4096"),
    (("accuracy",), "nan", "must be a number between 1e-15 and 0.1"),
    (("particles", "gold", "index"), "../../etc/passwd", "neither a known name"),
    (("particles", "gold", "index"), "1.5, -1", "k must be >= 0"),
    (("particles", "gold", "radius_um"), "-1", "radius_um must be a length"),
    (("particles", "gold", "host_index"), "0", "host_index must be a real refractive index"),
    (("layer", 0, "thickness"), "-1", "thickness must be an optical thickness >= 0"),
    (("layer", 0, "interface", "above"), "", "is missing"),
    (("layer", 0, "interface", "below"), "gold", "light goes through media with k"),
    (("layer", 0, "interface", "roughness"), "0.0005", "roughness must be"),
    (("base", "kind"), "shiny", 'must be "black" or "lambertian"'),
    (("brdf", "mu_i"), "0", "mu_i must satisfy 1e-8 <= mu <= 1"),
    (("brdf", "mu_o"), "0.1:1:1e999", "must be a whole number from 1"),
    (("brdf", "phi_deg"), "inf", "all finite"),
    (("field", "mu0"), "0.2, 0.4", "the page shows one beam"),
    (("field", "tau"), "1000", "must lie between 0 and the total optical thickness 100"),
    (("field", "stokes"), "1, 2", "must be four numbers"),
]


@pytest.mark.parametrize(("place", "text", "words"), WRONG)
def test_a_wrong_field_gets_the_librarys_message(place: tuple[Any, ...], text: str, words: str) -> None:
    content = fresh()
    if "interface" in place:
        form.add_interface(content)
        form.set_rough(content["layer"][0]["interface"], "rough")
    form.put(content, place, parse_field_text(text))
    found = problems(content)
    assert list(found) == [show_place(place)]
    assert words in found[show_place(place)]
    assert set(problems(content | {"nodes": 0})) == {"nodes", *found}  # and the others all the same


def test_all_wrong_fields_are_reported_at_once() -> None:
    large = {"gold": {"index": "gold", "radius_um": 1e5}}
    assert "size parameter" in problems(fresh(particles=large))["particles.gold"]
    content = fresh(nodes=0, accuracy="fine")
    content["layer"][0]["thickness"] = "thick"
    content["particles"]["gold"] = {"index": "gould", "radius_um": math.nan}
    content["brdf"]["mu_i"], content["field"]["mu0"] = [2.0], -1
    expected = "nodes accuracy layer[1].thickness particles.gold.index particles.gold.radius_um brdf.mu_i field.mu0"
    assert set(problems(content)) == set(expected.split())
    content = fresh(nodes=0)  # a field that is right alone but not with others hides no message
    kind = content["particles"]["gold"]
    form.set_source(kind, "coated-spheres")
    del kind["core_ratio"]
    kind["core_radius_um"] = 7.0
    found = problems(content)
    assert next(iter(found)) == "nodes"
    assert "core" in " ".join(found.values())


BROAD = {"white": {"index": "rutile", "size": {"lognormal": {"median_um": 0.2, "sigma": 1.4}}}}
WHITE = [{"particles": "white", "thickness": 1.0}]
MANY = {"start": 0.1, "stop": 1.0, "count": 10**6}


@pytest.mark.parametrize(
    ("change", "is_right"),
    [
        ({}, True),
        ({"wavelength_um": [0.45 + 0.01 * k for k in range(35)], "particles": BROAD, "layer": WHITE}, True),
        ({"layer": [henyey_greenstein(0.999)] * 30}, True),  # 54810 terms, a second each
        ({"wavelength_um": [0.5 + 1e-4 * k for k in range(1000)]}, False),
        ({"layer": [ISOTROPIC] * 10_000}, False),
        ({"particles": {f"p{k}": {"index": "gold", "radius_um": 0.1} for k in range(1000)}}, False),
        ({"brdf": {"mu_i": 0.5, "mu_o": MANY, "phi_deg": [0.0] * 1000}}, False),
        ({"brdf": {"mu_i": 0.5, "mu_o": MANY | {"count": 10**300}}}, False),
        ({"field": {"mu0": 0.5, "tau": MANY}}, False),
        ({"field": {"mu0": 0.5, "mu": [0.5] * 10_000, "phi_deg": [0.0] * 10_000}}, False),
        ({"layer": [henyey_greenstein(0.9999)] * 30}, False),
        ({"layer": [henyey_greenstein(0.9, terms=10**6)]}, False),
        ({"layer": []}, False),
        ({"nodes": 10**4000}, False),
    ],
)
def test_large_and_misshapen_scenes_are_checked_soon(change: dict[str, Any], is_right: bool) -> None:
    content = fresh(**change)
    problems(content)
    start = time.process_time()
    assert (problems(content) == {}) == is_right
    assert time.process_time() - start < (0.5 if is_right else 2.0)  # 10 ms where this was written
    if not is_right:
        with pytest.raises(vrte.SceneError):
            adopt_with_notes(content)


def test_no_file_of_the_machine_is_read(tmp_path: Path) -> None:
    table = tmp_path / "rayleigh.csv"
    table.write_text("l,a1,a2,a3,a4,b1,b2\n0,1,0,0,0,0,0\n")
    for name in (str(table), "rayleigh.csv", "../rayleigh.csv"):
        content = fresh(layer=[ISOTROPIC | {"phase": name}])
        assert "reads no files" in problems(content, tmp_path)["layer[1].phase"]
    content = fresh(layer=[ISOTROPIC | {"phase": "rayleigh.csv"}])
    assert problems(content, tmp_path, frozenset({"rayleigh.csv"})) == {}  # the one that vrte view began with


def test_layers_are_added_moved_and_removed() -> None:
    content = fresh(layer=[ISOTROPIC | {"thickness": math.inf}])
    layers = content["layer"]
    form.add_layer(content)
    assert [layer["thickness"] for layer in layers] == [1.0, 1.0]
    layers[1]["albedo"] = 0.9
    for index, by in ((1, -1), (0, -1), (1, 1)):
        form.move_layer(content, index, by)
    assert [layer["albedo"] for layer in layers] == [0.9, 0.5]
    form.remove_layer(content, 0), form.remove_layer(content, 0)
    assert [layer["albedo"] for layer in layers] == [0.5]
    layers[:] = [{"interface": {"above": 1.0, "below": 1.5}}] * form.MOST_LAYERS
    for _ in range(form.MOST_KINDS - 1):
        form.add_kind(content)
    for add, most in ((form.add_interface, "30 layers"), (form.add_layer, "30 layers"), (form.add_kind, "12 kinds")):
        with pytest.raises(vrte.SceneError, match=f"at most {most}"):
            add(content)


def test_every_choice_is_right_from_the_start_but_for_files_to_be_chosen() -> None:
    content = fresh()
    form.add_kind(content)
    layer, kind = content["layer"][0], content["particles"]["gold"]
    for medium in [*(name for name in form.MEDIA if name != "coefficients"), "particles"]:
        form.set_medium(content, 0, medium)
        expected = find_files(PHASES.get(medium), "layer", 0, "phase")
        assert (form.get_medium(layer), {*problems(content)}) == (medium, expected)
    for medium in ("volumes", "particles", "clear", "volumes", "mixture"):
        form.set_geometric(layer, medium != "particles")
        form.set_medium(content, 0, medium)
        assert problems(content) == {}
    for base, row in BASES.items():
        content["base"] = {"kind": "black"}
        form.set_base(content, base)
        assert {*problems(content)} == find_files(row, "base")
        assert tomllib.loads(write_content(content)) == content
        if "index" in row.keys:
            content["base"]["index"] = [1.5, -1.0]
            assert list(problems(content)) == ["base.index"]
    form.set_base(content, "black")
    for source, row in SOURCES.items():
        form.set_source(kind, source)
        assert (form.get_source(kind), problems(content)) == (source, {})
        for mode in form.SIZE_MODES if row.sized else ():
            form.set_size_mode(kind, mode)
            places = [("particles", "gold", *below) for below in form.list_size_places(mode)]
            expected = find_files(SIZES.get(mode), *places[0][:-1])
            assert (form.get_size_mode(kind), {*problems(content)}) == (mode, expected)
            assert all(find_field(place, content).label for place in places)
        form.set_size_mode(kind, "radius")
    form.set_source(kind, "spheres")
    assert (kind.keys(), problems(content)) == ({"index", "radius_um"}, {})


def test_a_layer_of_flakes_has_their_fields() -> None:
    content = fresh()
    layer = content["layer"][0]
    form.set_medium(content, 0, "flakes")
    assert layer == form.FLAKES
    places = [("layer", 0, "flakes", "index"), ("layer", 0, "flakes", "tilt_deg"), ("layer", 0, "flake_area")]
    assert all(find_field(place, content).label for place in places)
    assert all(find_field(("layer", 0, "flakes", key), content).label for key in ("substrate", "transparent"))
    layer["flakes"]["tilt_deg"] = 0.0
    assert list(problems(content)) == ["layer[1].flakes.tilt_deg"]
    form.set_medium(content, 0, "particles")
    assert (layer, problems(content)) == ({"particles": "gold", "thickness": form.OPTICAL}, {})
    paint = begin_with_material(list_films()["Silver metallic basecoat"])[0]
    assert (form.get_medium(paint["layer"][1]), problems(paint)) == ("flakes", {})


def test_every_key_has_a_label_and_shows_what_is_taken_where_it_is_empty() -> None:
    """A box that is not ticked, and the first of several choices, are what the library takes without the key."""
    for row in (row for rows in (SOURCES, SIZES, PHASES, BASES) for row in rows.values()):
        parameters = {**inspect.signature(read_scattering).parameters, **inspect.signature(row.make).parameters}
        defaults = {one.name: one.default for one in parameters.values()}
        for word, key in row.keys.items():
            assert 0 < len(key.label) <= 40, word
            if isinstance(key, Choice) and not key.needed and not key.empty:
                assert defaults[word] == next(iter(key.names))
            if isinstance(key, Flag) and not key.needed and key.start is None:
                usual = defaults[word] if defaults[word] is not None else getattr(vrte.Facets(1.5, 0.1), word)
                assert key.usual({}) is usual


@pytest.mark.parametrize("packing", PACKINGS)
def test_close_particles_get_the_volume_fraction_that_they_need(packing: str) -> None:
    content = fresh(host_index=1.5)
    layer = content["layer"][0]
    for medium, geometric in product(("particles", "volumes", "mixture"), (True, False)):
        form.set_medium(content, 0, medium)
        form.set_packing(layer, packing)
        assert problems(content) == {}
        form.set_geometric(layer, geometric)
        assert problems(content) == {}
    asked = packing != "independent"
    assert ("packing" in layer, "volume_fraction" in layer, form.is_fraction_asked(content, 0)) == (asked,) * 3
    form.set_packing(layer, "independent")
    assert not {"packing", "volume_fraction"} & layer.keys()


def test_media_that_absorb_ask_for_a_volume_fraction() -> None:
    content = fresh(host_index=[1.5, 0.001])
    assert list(problems(content)) == ["layer[1].volume_fraction"]
    assert form.is_fraction_asked(content, 0)
    content["layer"][0]["volume_fraction"] = "10 %"
    assert (problems(content), form.is_geometric(content["layer"][0])) == ({}, False)
    content = fresh()  # depths wait for the optical thickness of a layer in micrometres
    content["field"]["tau"] = [50.0]
    form.set_geometric(content["layer"][0], True)
    assert problems(content) == {}


def test_a_clear_layer_is_of_what_lies_around_it() -> None:
    content = fresh()
    form.add_interface(content)
    content["layer"][0]["interface"]["below"] = "water"
    form.set_medium(content, 1, "clear")
    assert content["layer"][1] == {"thickness_um": 50.0, "host_index": "water"}
    assert problems(content) == {}
    content["layer"][1]["host_index"] = [1.333, "x"]
    assert list(problems(content)) == ["layer[2].host_index"]
    form.set_medium(content, 1, "particles")
    assert "host_index" not in content["layer"][1]


def test_interfaces_are_put_where_they_belong_and_come_out_the_same() -> None:
    content = fresh(host_index=1.4)
    form.add_interface(content), form.add_interface(content)
    sides = [layer.get("interface") for layer in content["layer"]]
    assert sides == [{"above": 1.0, "below": 1.4}, None, {"above": 1.4, "below": 1.0}]
    assert form.name_layers(content["layer"]) == ["interface", "layer 2", "interface"]
    for surface in (sides[0], sides[2]):
        form.set_rough(surface, "rough")
        surface |= {"distribution": "ggx", "shadowing": True, "conserving": True}
        assert problems(content) == {}
        assert tomllib.loads(write_content(content)) == content
        form.set_rough(surface, "smooth")
        assert surface.keys() == {"above", "below"}
    form.add_layer(content)
    assert content["layer"][3] == content["layer"][1]  # like the last that holds something
    for _ in range(3):
        form.remove_layer(content, 1)
    assert (len(content["layer"]), problems(content)) == (1, {})  # an interface by itself
    form.add_layer(content)
    assert problems(content) == {}
    content = fresh()
    form.add_interface(content)
    assert (content["host_index"], problems(content)) == (1.5, {})  # a first surface brings its binder
    content["host_index"] = 1.4
    assert problems(content) == {"layer[2]": "layer 2 has the refractive index 1.4, and the interface above it has 1.5"}
    content["particles"]["gold"]["host_index"] = 1.5
    assert problems(content) == {}


def test_a_kind_is_renamed_where_it_is_held_and_stays_while_it_is() -> None:
    content = fresh()
    other = form.add_kind(content)
    content["layer"] = [{"particles": {"gold": 1.0, other: 2.0}, "thickness": 1.0}]
    name = "</script><b>../../x"
    form.rename_kind(content, "gold", name)
    assert list(content["layer"][0]["particles"]) == [name, other]
    assert problems(content) == {}
    assert tomllib.loads(write_content(content)) == content
    for bad in ("", "x" * 61, other, "\ud800"):
        with pytest.raises(vrte.SceneError):
            form.rename_kind(content, name, bad)
    with pytest.raises(vrte.SceneError, match="layer 1 holds it"):
        form.remove_kind(content, other)


def test_a_kind_is_called_after_its_substance_until_it_is_renamed() -> None:
    content = fresh()
    name = form.add_kind(content)
    for index, by_hand, called in (("gold", "", "gold-2"), ("main/Ag/Johnson", "", "Ag"), ("copper", "x", "x")):
        before, content["particles"][name]["index"] = form.get_substance(content["particles"][name]), index
        form.rename_kind(content, name, by_hand or name)
        form.name_after(content, by_hand or name, before)
        name = called
        assert list(content["particles"]) == ["gold", name]
    content["particles"]["gold"]["index"] = [1.5, 0.0]
    form.name_after(content, "gold", "gold")  # numbers are no name
    form.remove_kind(content, name)
    assert list(content["particles"]) == ["gold"]


def test_files_fill_the_form_and_what_they_lack_is_noted() -> None:
    for scene in (read_content(EXAMPLES / "gold_powder.toml"), fresh(wavelength_um=[0.45, 0.65])):
        assert adopt_with_notes(scene)[0] == scene == tomllib.loads(write_content(scene))
    for path in GALLERY:
        scene = read_content(path)
        content, notes = adopt_with_notes(scene)
        assert problems(content) == {}
        assert len(form.list_page_wavelengths(content)) >= 7
        assert [text.split()[0] for text in notes] == ["[brdf]", "wavelength_um"]
        assert all(content[key] == scene[key] for key in ("particles", "layer"))


def test_axes_of_a_sweep_become_wavelengths_or_a_note() -> None:
    others = "stay as the template has them; `vrte sweep` computes them all"
    depth = {"depth": {"key": "layer[1].thickness", "values": [1, 2]}}
    for scene, count, expected in (
        ("gold_table", MOST_OF_AXIS, ["wavelength_um: 10 of its 28 wavelengths are taken", f"radius_um {others}"]),
        ("rutile_spectrum", MOST_OF_AXIS, ["wavelength_um: 10 of its 55 wavelengths are taken"]),
        (fresh(axes={"wavelength_um": [0.5, 0.6]}), 2, []),
        (fresh(axes=depth), 1, [f"depth {others}"]),
    ):
        given = read_content(EXAMPLES / f"{scene}.toml") if isinstance(scene, str) else scene
        content, notes = adopt_with_notes(given)
        assert ("axes" in content, len(form.list_page_wavelengths(content))) == (False, count)
        assert [text.removeprefix("axes.").removeprefix("axes: ") for text in notes] == expected


def test_diameters_degrees_and_volumes_are_set_and_messages_find_them() -> None:
    content = fresh()
    gold = content["particles"]["gold"]
    for mode, size in (("diameter", {"diameter_um": 1.2}), ("radius", {"radius_um": 0.6})):
        form.set_size_mode(gold, mode)
        assert gold == {"index": "gold", **size}
    form.set_degrees(content, True)
    assert content["brdf"]["angle_i_deg"] == {"start": 78.463, "stop": 0.0, "count": 9}
    assert content["field"]["angle0_deg"] == 53.1301
    assert problems(content) == {}
    content["brdf"]["angle_i_deg"], content["field"]["angle0_deg"] = [90], -1
    form.set_size_mode(gold, "diameter")
    gold["diameter_um"] = -1
    form.set_medium(content, 0, "volumes")
    content["layer"][0]["volume_fractions"]["gold"] = "200 %"
    expected = "brdf.angle_i_deg field.angle0_deg particles.gold.diameter_um layer[1].volume_fractions.gold"
    assert set(problems(content)) == set(expected.split())
    content["brdf"]["angle_i_deg"], content["field"]["angle0_deg"] = [60], 60
    form.set_degrees(content, False)
    assert (content["brdf"]["mu_i"], content["field"]["mu0"]) == ([0.5], 0.5)
    assert list(content["brdf"]) == ["mu_i", "mu_o", "phi_deg"]


def test_ready_materials_fill_the_form_with_all_their_numbers() -> None:
    for material in list_materials().values():
        content, _ = begin_with_material(material)
        assert problems(content) == {}
        assert "material" not in content["layer"][0]
        fields = [index for index in list_places(content["particles"], "particles") if index[2:3] != ("source",)]
        assert all(find_field(index, content).label for index in fields)


@settings(max_examples=15, deadline=None)
@given(
    st.recursive(
        st.none() | st.floats() | st.text(max_size=3),
        lambda x: st.lists(x) | st.dictionaries(st.sampled_from([*FILE_KEYS, *LAYER_KEYS, "gold"]), x),
        max_leaves=10,
    )
)
def test_whatever_a_scene_is_there_is_an_answer(junk: Any) -> None:
    for key in ("layer", "particles", "brdf", "field", "wavelength_um", "base"):
        scene = fresh(**{key: junk})
        problems(scene)
        with suppress(vrte.SceneError):
            adopt_with_notes(scene)
