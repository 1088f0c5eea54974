"""The form of the viewer: what is typed, what is said to it, and what becomes of the scene."""

import copy
import inspect
import math
import time
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import vrte
from vrte.app.form import checks
from vrte.app.form import content as form
from vrte.app.form.fields import find_field, list_places, parse_field_text, write_field_text
from vrte.app.form.files import MOST_OF_AXIS, adopt_with_notes, begin_with_material, write_content
from vrte.basics.errors import Place
from vrte.formats.bases import BASES
from vrte.formats.keys import Choice, FilePath, Flag
from vrte.formats.layers import LAYER_KEYS
from vrte.formats.materials import list_materials
from vrte.formats.particle_sources import SOURCES, check_particles
from vrte.formats.phases import PHASES
from vrte.formats.scattering import read_scattering
from vrte.formats.scene_file import FILE_KEYS, make_scene_file, read_content
from vrte.formats.sizes import SIZES
from vrte.formats.toml_table import show_place
from vrte.optics.crowding import PACKINGS

EXAMPLES = Path(__file__).parents[1] / "examples"
GALLERY = sorted((Path(vrte.__file__).parent / "app" / "gallery").glob("*.toml"))


def problems(content: form.Content, *about: Any) -> dict[str, str]:
    """By the dotted key that a message is about."""
    return {show_place(place): message for place, message in checks.find_problems(content, *about).items()}


def fresh(**changes: Any) -> form.Content:
    return copy.deepcopy(form.START) | changes


def henyey_greenstein(g: float, **more: int) -> form.Content:
    return {"phase": {"henyey_greenstein": g, **more}, "albedo": 0.5, "thickness": 1.0}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0.64", 0.64),
        (" 12 ", 12),
        ("1e-6", 1e-6),
        ("inf", math.inf),
        ("1.5, 0.01", [1.5, 0.01]),
        ("0.05:1:20", {"start": 0.05, "stop": 1, "count": 20}),
        ("", None),
        *((text, text) for text in ("main/Au/Johnson", "1,,2", "1:2", "1:2:3,4", "0x10", "1_000", "<b>", "9" * 5000)),
        ("9" * 3000, math.inf),
    ],
)
def test_text_becomes_a_value(text: str, value: Any) -> None:
    assert parse_field_text(text) == value


@settings(max_examples=40)
@given(st.one_of(st.floats(allow_nan=False), st.integers(-(10**20), 10**20), st.lists(st.floats(0, 9), min_size=2)))
def test_a_value_becomes_text_and_the_same_value(value: Any) -> None:
    assert parse_field_text(write_field_text(value)) == value


# every field, something that is wrong with it, and words of the library's message
WRONG = [
    (("wavelength_um",), "blue", "must be the wavelength"),
    (("wavelength_um",), "-0.5", "wavelength_um must be a length"),
    (("wavelength_um",), "0.5, 0.4", "ascending"),
    (("wavelength_um",), "0.5, nan", "wavelength_um must be finite"),
    (("wavelength_um",), "0.7:0.4:4", "ascending"),
    (("wavelength_um",), "0.4:0.7:41", "at most 40 wavelengths, not 41"),
    (("wavelength_um",), "", "is missing"),
    (("host_index",), "0", "host_index must be a real refractive index"),
    (("nodes",), "1000000", "must be a whole number from 1 to 4096"),
    (("nodes",), "2.5", "must be a whole number from 1 to 4096"),
    (("accuracy",), "nan", "must be a number between 1e-15 and 0.1"),
    (("particles", "gold", "index"), "unobtainium", "neither a known name"),
    (("particles", "gold", "index"), "../../etc/passwd", "neither a known name"),
    (("particles", "gold", "index"), "1.5, -1", "k must be >= 0"),
    (("particles", "gold", "radius_um"), "-1", "radius_um must be a length"),
    (("layer", 0, "thickness"), "-1", "thickness must be an optical thickness >= 0"),
    (("layer", 0, "thickness"), "nan", "must be a number >= 0"),
    (("base", "kind"), "shiny", 'must be "black" or "lambertian"'),
    (("particles", "gold", "host_index"), "0", "host_index must be a real refractive index"),
    (("brdf", "mu_i"), "0", "mu_i must satisfy 1e-8 <= mu <= 1"),
    (("brdf", "mu_o"), "0.1:1:2.5", "must be a whole number from 1"),
    (("brdf", "mu_o"), "0.1:1:1e999", "must be a whole number from 1"),
    (("brdf", "phi_deg"), "inf", "all finite"),
    (("field", "mu0"), "2", "mu0 must satisfy"),
    (("field", "mu0"), "0.2, 0.4", "the page shows one beam"),
    (("field", "tau"), "1000", "must lie between 0 and the total optical thickness 100"),
    (("field", "stokes"), "1, 2", "must be four numbers"),
    (("field", "mu"), "0", "mu must satisfy"),
]


@pytest.mark.parametrize(("place", "text", "words"), WRONG)
def test_a_wrong_field_gets_the_librarys_message(place: Place, text: str, words: str) -> None:
    content = fresh()
    form.put(content, place, parse_field_text(text))
    found = problems(content)
    assert list(found) == [show_place(place)]
    assert words in found[show_place(place)]


def test_all_wrong_fields_are_told_at_once_in_the_words_of_the_solver() -> None:
    with pytest.raises(vrte.SceneError) as told:
        make_scene_file(fresh(nodes=10**6), "brdf", compute=check_particles)
    assert problems(fresh(nodes=10**6)) == {"nodes": str(told.value)}
    content = fresh(particles={"gold": {"index": "gold", "radius_um": 1e5}})
    assert "size parameter" in problems(content)["particles.gold"]
    assert list(problems(fresh(wavelength_um={"start": 0.4, "stop": "x", "count": 4}))) == ["wavelength_um"]
    content = fresh(nodes=0, accuracy="fine")
    content["layer"][0]["thickness"] = "thick"
    content["particles"]["gold"] = {"index": "gould", "radius_um": math.nan}
    content["brdf"]["mu_i"] = [2.0]
    content["field"]["mu0"] = -1
    expected = "nodes accuracy layer[1].thickness particles.gold.index particles.gold.radius_um brdf.mu_i field.mu0"
    assert set(problems(content)) == set(expected.split())
    content = fresh(nodes=0)  # a field that is right alone but not with others hides no message
    form.set_source(content["particles"]["gold"], "coated-spheres")
    content["particles"]["gold"].pop("core_ratio")
    content["particles"]["gold"]["core_radius_um"] = 7.0
    found = problems(content)
    assert next(iter(found)) == "nodes"
    assert "core" in " ".join(found.values())


BROAD = {"white": {"index": "rutile", "size": {"lognormal": {"median_um": 0.2, "sigma": 1.4}}}}


@pytest.mark.parametrize(
    "content",
    [
        fresh(),
        fresh(
            wavelength_um=[0.45 + 0.01 * k for k in range(35)],
            particles=BROAD,
            layer=[{"particles": "white", "thickness": 1.0}],
        ),
        fresh(layer=[henyey_greenstein(0.999)] * 30),  # 54810 terms, a second each
    ],
)
def test_a_check_takes_milliseconds(content: form.Content) -> None:
    problems(content)
    start = time.process_time()
    assert problems(content) == {}
    assert time.process_time() - start < 0.5  # 10 ms where this was written


@pytest.mark.parametrize(
    "change",
    [
        {"wavelength_um": [0.5 + 1e-4 * k for k in range(1000)]},
        {"layer": [{"phase": "isotropic", "albedo": 0.5, "thickness": 1.0}] * 10_000},
        {"particles": {f"p{k}": {"index": "gold", "radius_um": 0.1} for k in range(1000)}},
        {"brdf": {"mu_i": 0.5, "mu_o": {"start": 0.1, "stop": 1.0, "count": 10**6}, "phi_deg": [0.0] * 1000}},
        {"brdf": {"mu_i": 0.5, "mu_o": {"start": 0.1, "stop": 1.0, "count": 10**300}}},
        {"field": {"mu0": 0.5, "tau": {"start": 0.0, "stop": 1.0, "count": 10**6}}},
        {"field": {"mu0": 0.5, "mu": [0.5] * 10_000, "phi_deg": [0.0] * 10_000}},
        {"layer": [henyey_greenstein(0.9999)] * 30},
        {"layer": [henyey_greenstein(0.9, terms=10**6)]},
        *({"layer": junk} for junk in (5, [], [5])),
        *({"particles": junk} for junk in ([1], {"gold": 3})),
        {"brdf": 1},
        {"base": "black"},
        {"nodes": 10**4000},
    ],
)
def test_huge_and_misshapen_scenes_get_a_message_soon(change: dict[str, Any]) -> None:
    start = time.process_time()
    assert problems(fresh(**change))
    assert time.process_time() - start < 2.0
    with pytest.raises(vrte.SceneError):
        adopt_with_notes(fresh(**change))[0]


def test_no_file_of_the_machine_is_read(tmp_path: Path) -> None:
    table = tmp_path / "rayleigh.csv"
    table.write_text("l,a1,a2,a3,a4,b1,b2\n0,1,0,0,0,0,0\n")
    for name in (str(table), "rayleigh.csv", "../rayleigh.csv"):
        content = fresh(layer=[{"phase": name, "albedo": 0.5, "thickness": 1.0}])
        assert "reads no files" in problems(content, tmp_path)["layer[1].phase"]
    content = fresh(layer=[{"phase": "rayleigh.csv", "albedo": 0.5, "thickness": 1.0}])
    assert problems(content, tmp_path, frozenset({"rayleigh.csv"})) == {}  # the one that vrte view began with


def test_layers_are_added_moved_and_removed() -> None:
    content = fresh(layer=[{"phase": "isotropic", "albedo": 0.5, "thickness": math.inf}])
    form.add_layer(content)
    assert [layer["thickness"] for layer in content["layer"]] == [1.0, 1.0]
    content["layer"][1]["albedo"] = 0.9
    form.move_layer(content, 1, -1), form.move_layer(content, 0, -1), form.move_layer(content, 1, 1)
    assert [layer["albedo"] for layer in content["layer"]] == [0.9, 0.5]
    form.remove_layer(content, 0), form.remove_layer(content, 0)
    assert [layer["albedo"] for layer in content["layer"]] == [0.5]
    while len(content["layer"]) < form.MOST_LAYERS:
        form.add_layer(content)
    with pytest.raises(vrte.SceneError, match="at most 30 layers"):
        form.add_layer(content)


def needs_file(row: Any) -> bool:
    return any(isinstance(key, FilePath) and key.needed for key in row.keys.values())


def test_every_choice_is_right_from_the_start() -> None:
    content = fresh()
    form.add_kind(content)
    layer = content["layer"][0]
    for medium in [*(name for name in form.MEDIA if name != "coefficients"), "particles"]:
        form.set_medium(content, 0, medium)
        expected = {f"layer[1].phase.{medium}"} if medium in PHASES and needs_file(PHASES[medium]) else set()
        assert (form.get_medium(layer), set(problems(content))) == (medium, expected)
    for medium in ("volumes", "particles", "clear", "volumes", "mixture"):
        form.set_geometric(layer, medium != "particles")
        form.set_medium(content, 0, medium)
        assert problems(content) == {}


@pytest.mark.parametrize("source", SOURCES)
def test_every_source_and_size_is_right_from_the_start(source: str) -> None:
    content = fresh()
    kind = content["particles"]["gold"]
    form.set_source(kind, source)
    assert (form.get_source(kind), problems(content)) == (source, {})
    for mode in form.SIZE_MODES if SOURCES[source].sized else ():
        form.set_size_mode(kind, mode)
        places = form.list_size_places(mode)
        wanted = [place for place in places if mode in SIZES and needs_file(SIZES[mode])]
        expected = {show_place(("particles", "gold", *place)) for place in wanted}
        assert (form.get_size_mode(kind), set(problems(content))) == (mode, expected)
        assert all(find_field(("particles", "gold", *place), content).label for place in places)
    form.set_size_mode(kind, "radius")
    form.set_source(kind, "spheres")
    assert kind.keys() == {"index", "radius_um"}
    assert problems(content) == {}


@pytest.mark.parametrize("kind", BASES)
def test_every_base_is_right_from_the_start(kind: str) -> None:
    content = fresh()
    form.set_base(content, kind)
    found = problems(content)
    assert {show_place(("base", key)) for key, one in BASES[kind].keys.items() if isinstance(one, FilePath)} == {*found}
    assert all("needs a file" in message for message in found.values())
    assert tomllib.loads(write_content(content)) == content
    if "index" in BASES[kind].keys:
        content["base"]["index"] = [1.5, -1.0]
        assert list(problems(content)) == ["base.index"]


ROWS = [(name, row.make, row.keys) for rows in (SOURCES, SIZES, PHASES, BASES) for name, row in rows.items()]


@pytest.mark.parametrize(("name", "make", "keys"), ROWS, ids=[name for name, *_ in ROWS])
def test_every_key_has_a_label_and_shows_what_is_taken_where_it_is_empty(name: str, make: Any, keys: Any) -> None:
    """A box that is not ticked, and the first of several choices, are what the library takes without the key."""
    parameters = {**inspect.signature(read_scattering).parameters, **inspect.signature(make).parameters}
    defaults = {one.name: one.default for one in parameters.values()}
    for word, key in keys.items():
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
    for medium in ("particles", "volumes", "mixture"):
        form.set_medium(content, 0, medium)
        form.set_packing(layer, packing)
        assert problems(content) == {}
        for geometric in (True, False):
            form.set_geometric(layer, geometric)
            assert problems(content) == {}
    asked = packing != "independent"
    assert ("packing" in layer, "volume_fraction" in layer) == (asked, asked)
    assert form.is_fraction_asked(content, 0) is asked
    form.set_packing(layer, "independent")
    assert not {"packing", "volume_fraction"} & layer.keys()


def test_a_medium_that_absorbs_is_asked_for_its_fraction_and_depths_wait_for_the_thickness() -> None:
    content = fresh(host_index=[1.5, 0.001])
    assert list(problems(content)) == ["layer[1].volume_fraction"]
    assert form.is_fraction_asked(content, 0)
    content["layer"][0]["volume_fraction"] = "10 %"
    assert problems(content) == {}
    assert not form.is_geometric(content["layer"][0])
    content = fresh()
    content["field"]["tau"] = [50.0]
    form.set_geometric(content["layer"][0], True)
    assert problems(content) == {}  # WRONG has an optical thickness


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
    assert [layer.get("interface") for layer in content["layer"]] == [
        {"above": 1.0, "below": 1.4},
        None,
        {"above": 1.4, "below": 1.0},
    ]
    assert form.name_layers(content["layer"]) == ["interface", "layer 2", "interface"]
    for place in (0, 2):
        surface = content["layer"][place]["interface"]
        form.set_rough(surface, "rough")
        assert surface["roughness"] > 0.0
        surface |= {"distribution": "ggx", "shadowing": True, "conserving": True}
        assert problems(content) == {}
        assert tomllib.loads(write_content(content)) == content
        form.set_rough(surface, "smooth")
        assert surface.keys() == {"above", "below"}
    form.add_layer(content)
    assert content["layer"][3] == content["layer"][1]  # like the last that holds something
    for _ in range(2):
        form.remove_layer(content, 1)
    form.remove_layer(content, 1)
    assert len(content["layer"]) == 1
    assert problems(content) == {}  # an interface by itself
    form.add_layer(content)
    assert problems(content) == {}


def test_a_first_surface_brings_its_binder() -> None:
    content = fresh()
    form.add_interface(content)
    assert content["host_index"] == 1.5
    assert problems(content) == {}
    content["host_index"] = 1.4
    assert problems(content) == {"layer[2]": "layer 2 has the refractive index 1.4, and the interface above it has 1.5"}
    content["particles"]["gold"]["host_index"] = 1.5
    assert problems(content) == {}
    content["layer"] = [{"interface": {"above": 1.0, "below": 1.5}}] * form.MOST_LAYERS
    for add in (form.add_interface, form.add_layer):
        with pytest.raises(vrte.SceneError, match="at most 30 layers"):
            add(content)


@pytest.mark.parametrize(
    ("key", "text", "words"),
    [
        ("above", "0.01", "must be a real refractive index from 0.1 to 10"),
        ("below", "gold", "light goes through media with k"),
        ("above", "", "is missing"),
        ("roughness", "-1", "roughness must be"),
        ("roughness", "0.001", "roughness must be"),
    ],
)
def test_what_is_wrong_with_an_interface_is_said_at_its_field(key: str, text: str, words: str) -> None:
    content = fresh(nodes=0)
    form.add_interface(content)
    form.set_rough(content["layer"][0]["interface"], "rough")
    form.put(content, ("layer", 0, "interface", key), parse_field_text(text))
    found = problems(content)
    assert list(found) == ["nodes", f"layer[1].interface.{key}"]  # and the others all the same
    assert words in found[f"layer[1].interface.{key}"]


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


def test_a_file_fills_the_form_and_comes_out_the_same() -> None:
    given = read_content(EXAMPLES / "gold_powder.toml")
    assert adopt_with_notes(given)[0] == given == tomllib.loads(write_content(given))
    several = fresh(wavelength_um=[0.45, 0.65])
    assert adopt_with_notes(tomllib.loads(write_content(several)))[0] == several


@pytest.mark.parametrize("path", GALLERY, ids=lambda path: path.stem)
def test_every_gallery_scene_opens_and_what_it_lacks_is_told(path: Path) -> None:
    given = read_content(path)
    content, told = adopt_with_notes(given)
    assert problems(content) == {}
    assert len(form.list_page_wavelengths(content)) >= 7
    assert [text.split()[0] for text in told] == ["[brdf]", "wavelength_um"]
    assert {key: content[key] for key in ("particles", "layer")} == {key: given[key] for key in ("particles", "layer")}


def test_sweeps_open_with_the_wavelengths_that_a_page_shows() -> None:
    others = "stay as the template has them; `vrte sweep` computes them all"
    for name, expected in (
        ("gold_table", ["axes.wavelength_um: 10 of its 28 wavelengths are taken", f"axes: radius_um {others}"]),
        ("rutile_spectrum", ["axes.wavelength_um: 10 of its 55 wavelengths are taken"]),
    ):
        content, told = adopt_with_notes(read_content(EXAMPLES / f"{name}.toml"))
        assert ("axes" in content, len(form.list_page_wavelengths(content)), [*told]) == (False, MOST_OF_AXIS, expected)
    content, told = adopt_with_notes(fresh(axes={"wavelength_um": [0.5, 0.6]}))
    assert (content["wavelength_um"], told) == ([0.5, 0.6], ())
    _, told = adopt_with_notes(fresh(axes={"depth": {"key": "layer[1].thickness", "values": [1, 2]}}))
    assert told == (f"axes: depth {others}",)


def test_diameters_degrees_and_volumes_are_set_and_messages_find_them() -> None:
    content = fresh()
    for mode, size in (("diameter", {"diameter_um": 1.2}), ("radius", {"radius_um": 0.6})):
        form.set_size_mode(content["particles"]["gold"], mode)
        assert content["particles"]["gold"] == {"index": "gold", **size}
    form.set_degrees(content, True)
    assert content["brdf"]["angle_i_deg"] == {"start": 78.463, "stop": 0.0, "count": 9}
    assert content["field"]["angle0_deg"] == 53.1301
    assert problems(content) == {}
    content["brdf"]["angle_i_deg"], content["field"]["angle0_deg"] = [90], -1
    form.set_size_mode(content["particles"]["gold"], "diameter")
    content["particles"]["gold"]["diameter_um"] = -1
    form.set_medium(content, 0, "volumes")
    content["layer"][0]["volume_fractions"]["gold"] = "200 %"
    expected = "brdf.angle_i_deg field.angle0_deg particles.gold.diameter_um layer[1].volume_fractions.gold"
    assert set(problems(content)) == set(expected.split())
    content["brdf"]["angle_i_deg"], content["field"]["angle0_deg"] = [60], 60
    form.set_degrees(content, False)
    assert (content["brdf"]["mu_i"], content["field"]["mu0"]) == ([0.5], 0.5)
    assert list(content["brdf"]) == ["mu_i", "mu_o", "phi_deg"]


def test_a_card_is_called_after_its_substance_until_it_is_renamed() -> None:
    content = fresh()
    name = form.add_kind(content)
    for index, called in (("gold", "gold-2"), ("main/Ag/Johnson", "Ag"), ("copper", "flakes")):
        kind = content["particles"][name]
        before, kind["index"] = kind["index"], index
        if called == "flakes":  # by hand
            form.rename_kind(content, name, called)
            name = called
        form.name_after(content, name, before)
        assert list(content["particles"]) == ["gold", called]
        name = called
    content["particles"]["gold"]["index"] = [1.5, 0.0]
    form.name_after(content, "gold", "gold")  # numbers are no name
    assert list(content["particles"]) == ["gold", "flakes"]


@pytest.mark.parametrize("name", list_materials())
def test_ready_materials_fill_the_form_with_all_their_numbers(name: str) -> None:
    content, _ = begin_with_material(list_materials()[name])
    assert problems(content) == {}
    assert "material" not in content["layer"][0]
    fields = [place for place in list_places(content["particles"], "particles") if place[2:3] != ("source",)]
    assert all(find_field(place, content).label for place in fields)


@settings(max_examples=40, deadline=None)
@given(
    st.recursive(
        st.none() | st.floats() | st.text(max_size=3),
        lambda x: st.lists(x) | st.dictionaries(st.sampled_from([*FILE_KEYS, *LAYER_KEYS, "gold"]), x),
        max_leaves=10,
    )
)
def test_whatever_a_scene_is_there_is_an_answer(junk: Any) -> None:
    for key in ("layer", "particles", "brdf", "field", "wavelength_um", "base"):
        problems(fresh(**{key: junk}))
