"""The form of the viewer: what is typed, what is said to it, and what becomes of the scene."""

import copy
import math
import time
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import vrte
from vrte.app import form
from vrte.formats.scene_file import read_content, scene_of
from vrte.optics.spheres import check_spheres


def fresh(**changes: Any) -> form.Content:
    return copy.deepcopy(form.START) | changes


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
        ("main/Au/Johnson", "main/Au/Johnson"),
        ("1,,2", "1,,2"),
        ("1:2", "1:2"),
        ("1:2:3,4", "1:2:3,4"),
        ("0x10", "0x10"),
        ("1_000", "1_000"),
        ("<script>alert(1)</script>", "<script>alert(1)</script>"),
        ("9" * 5000, "9" * 5000),
        ("9" * 3000, math.inf),
    ],
)
def test_text_becomes_a_value(text: str, value: Any) -> None:
    assert form.value_of(text) == value


@settings(max_examples=40)
@given(st.one_of(st.floats(allow_nan=False), st.integers(-(10**20), 10**20), st.lists(st.floats(0, 9), min_size=2)))
def test_a_value_becomes_text_and_the_same_value(value: Any) -> None:
    assert form.value_of(form.text_of(value)) == value


def test_the_start_scene_has_no_problems() -> None:
    assert form.problems(fresh()) == {}


# every field, something that is wrong with it, and words of the library's message
WRONG = [
    (("wavelength_um",), "blue", "must be the wavelength"),
    (("wavelength_um",), "-0.5", "wavelength_um must be a length"),
    (("wavelength_um",), "0.5, 0.4", "ascending"),
    (("wavelength_um",), "0.5, nan", "wavelength_um must be finite"),
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
def test_a_wrong_field_gets_the_librarys_message(place: form.Place, text: str, words: str) -> None:
    content = fresh()
    form.put(content, place, form.value_of(text))
    found = form.problems(content)
    assert list(found) == [form.dotted(place)]
    assert words in found[form.dotted(place)]


def test_what_is_wrong_with_all_of_a_kind_is_told_there() -> None:
    content = fresh()
    content["particles"]["gold"]["radius_um"] = 1e5
    assert "size parameter" in form.problems(content)["particles.gold"]


def test_the_message_is_that_of_the_solver() -> None:
    content = fresh(nodes=10**6)
    with pytest.raises(vrte.SceneError) as told:
        scene_of(content, "brdf", spheres_of=check_spheres)
    assert form.problems(content) == {"nodes": str(told.value)}


def test_all_wrong_fields_are_told_at_once() -> None:
    content = fresh(nodes=0, accuracy="fine")
    content["layer"][0]["thickness"] = "thick"
    content["particles"]["gold"] = {"index": "gould", "radius_um": math.nan}
    content["brdf"]["mu_i"] = [2.0]
    content["field"]["mu0"] = -1
    assert set(form.problems(content)) == {
        "nodes",
        "accuracy",
        "layer[1].thickness",
        "particles.gold.index",
        "particles.gold.radius_um",
        "brdf.mu_i",
        "field.mu0",
    }


def test_a_check_takes_milliseconds() -> None:
    content = fresh(wavelength_um=[0.4 + 0.01 * k for k in range(40)])
    content["particles"]["gold"] = {"index": "rutile", "size": {"lognormal": {"median_um": 0.2, "sigma": 1.4}}}
    content["wavelength_um"] = content["wavelength_um"][5:]
    form.problems(content)
    start = time.process_time()
    assert form.problems(content) == {}
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
        {"layer": [{"phase": {"henyey_greenstein": 0.9999}, "albedo": 0.5, "thickness": 1.0}] * 30},
        {"layer": [{"phase": {"henyey_greenstein": 0.9, "terms": 10**6}, "albedo": 0.5, "thickness": 1.0}]},
        {"layer": 5},
        {"layer": []},
        {"layer": [5]},
        {"particles": [1]},
        {"particles": {"gold": 3}},
        {"brdf": 1},
        {"base": "black"},
        {"nodes": 10**4000},
    ],
)
def test_huge_and_misshapen_scenes_get_a_message_soon(change: dict[str, Any]) -> None:
    start = time.process_time()
    assert form.problems(fresh(**change))
    assert time.process_time() - start < 2.0
    with pytest.raises(vrte.SceneError):
        form.adopted(fresh(**change))


def test_no_file_of_the_machine_is_read(tmp_path: Path) -> None:
    table = tmp_path / "rayleigh.csv"
    table.write_text("l,a1,a2,a3,a4,b1,b2\n0,1,0,0,0,0,0\n")
    for name in (str(table), "rayleigh.csv", "../rayleigh.csv"):
        content = fresh(layer=[{"phase": name, "albedo": 0.5, "thickness": 1.0}])
        assert "reads no files" in form.problems(content, tmp_path)["layer[1].phase"]
    content = fresh(layer=[{"phase": "rayleigh.csv", "albedo": 0.5, "thickness": 1.0}])
    assert form.problems(content, tmp_path, frozenset({"rayleigh.csv"})) == {}  # the one that vrte view began with


def test_thirty_peaked_layers_are_checked_in_milliseconds() -> None:
    layer = {"phase": {"henyey_greenstein": 0.999}, "albedo": 0.5, "thickness": 1.0}  # 54810 terms, a second each
    start = time.process_time()
    assert form.problems(fresh(layer=[layer] * 30)) == {}
    assert time.process_time() - start < 1.0


def test_depths_are_checked_only_where_the_thickness_is_known() -> None:
    content = fresh()
    content["field"]["tau"] = [50.0]
    form.set_geometric(content["layer"][0], True)
    assert form.problems(content) == {}
    form.set_geometric(content["layer"][0], False)
    assert list(form.problems(content)) == ["field.tau"]


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


def test_every_medium_is_right_from_the_start() -> None:
    content = fresh()
    form.add_kind(content)
    for medium in ("mixture", "volumes", "isotropic", "rayleigh", "henyey_greenstein", "particles"):
        form.set_medium(content, 0, medium)
        assert form.medium_of(content["layer"][0]) == medium
        assert form.problems(content) == {}
    for medium in ("volumes", "particles", "volumes", "mixture"):
        form.set_geometric(content["layer"][0], medium != "particles")
        form.set_medium(content, 0, medium)
        assert form.problems(content) == {}
    for mode in form.SIZE_MODES:
        form.set_size_mode(content["particles"]["gold"], mode)
        assert form.size_mode(content["particles"]["gold"]) == mode
        assert form.problems(content) == {}
    form.set_base(content, "lambertian")
    assert form.problems(content) == {}


def test_a_kind_is_renamed_where_it_is_held_and_stays_while_it_is() -> None:
    content = fresh()
    other = form.add_kind(content)
    content["layer"] = [{"particles": {"gold": 1.0, other: 2.0}, "thickness": 1.0}]
    name = "</script><b>../../x"
    form.rename_kind(content, "gold", name)
    assert list(content["layer"][0]["particles"]) == [name, other]
    assert form.problems(content) == {}
    assert tomllib.loads(form.scene_text(content)) == content
    for bad in ("", "x" * 61, other, "\ud800"):
        with pytest.raises(vrte.SceneError):
            form.rename_kind(content, name, bad)
    with pytest.raises(vrte.SceneError, match="layer 1 holds it"):
        form.remove_kind(content, other)


def test_a_file_fills_the_form_and_comes_out_the_same() -> None:
    path = Path(__file__).parents[1] / "examples" / "gold_powder.toml"
    content = form.adopted(read_content(path))
    assert content == read_content(path)
    assert tomllib.loads(form.scene_text(content)) == content


GALLERY = sorted((Path(form.__file__).parent / "gallery").glob("*.toml"))


@pytest.mark.parametrize("path", GALLERY, ids=lambda path: path.stem)
def test_every_gallery_scene_opens_and_what_it_lacks_is_told(path: Path) -> None:
    given = read_content(path)
    content, told = form.adopted_and_told(given)
    assert form.problems(content) == {}
    assert len(form.wavelengths_of(content)) >= 7
    assert [text.split()[0] for text in told] == ["[brdf]", "wavelength_um"]
    assert {key: content[key] for key in ("particles", "layer")} == {key: given[key] for key in ("particles", "layer")}


def test_sweeps_open_with_the_wavelengths_that_a_page_shows() -> None:
    examples = Path(__file__).parents[1] / "examples"
    found = {
        name: form.adopted_and_told(read_content(examples / f"{name}.toml"))
        for name in ("gold_table", "rutile_spectrum")
    }
    for content, _ in found.values():
        assert "axes" not in content
        assert len(form.wavelengths_of(content)) == form.MOST_OF_AXIS
    assert found["gold_table"][1] == (
        "axes.wavelength_um: 10 of its 28 wavelengths are taken",
        "axes: radius_um stay as the template has them; `vrte sweep` computes them all",
    )
    assert found["rutile_spectrum"][1] == ("axes.wavelength_um: 10 of its 55 wavelengths are taken",)
    content, told = form.adopted_and_told(fresh(axes={"wavelength_um": [0.5, 0.6]}))
    assert (content["wavelength_um"], told) == ([0.5, 0.6], ())
    _, told = form.adopted_and_told(fresh(axes={"depth": {"key": "layer[1].thickness", "values": [1, 2]}}))
    assert told == ("axes: depth stay as the template has them; `vrte sweep` computes them all",)


def test_a_range_of_wavelengths_is_taken() -> None:
    content = fresh(wavelength_um={"start": 0.43, "stop": 0.7, "count": 4})
    assert form.problems(content) == {}
    np.testing.assert_allclose(form.wavelengths_of(content), [0.43, 0.52, 0.61, 0.7])
    assert (
        "at most 40 wavelengths, not 41"
        in form.problems(fresh(wavelength_um={"start": 0.4, "stop": 0.7, "count": 41}))["wavelength_um"]
    )
    assert "ascending" in form.problems(fresh(wavelength_um={"start": 0.7, "stop": 0.4, "count": 4}))["wavelength_um"]
    assert list(form.problems(fresh(wavelength_um={"start": 0.4, "stop": "x", "count": 4}))) == ["wavelength_um"]


def test_diameters_degrees_and_volumes_are_set_and_messages_find_them() -> None:
    content = fresh()
    form.set_size_mode(content["particles"]["gold"], "diameter")
    assert content["particles"]["gold"] == {"index": "gold", "diameter_um": 1.2}
    form.set_size_mode(content["particles"]["gold"], "radius")
    assert content["particles"]["gold"] == {"index": "gold", "radius_um": 0.6}
    form.set_degrees(content, True)
    assert form.in_degrees(content)
    assert content["brdf"]["angle_i_deg"] == {"start": 78.463, "stop": 0.0, "count": 9}
    assert content["field"]["angle0_deg"] == 53.1301
    assert form.problems(content) == {}
    content["brdf"]["angle_i_deg"], content["field"]["angle0_deg"] = [90], -1
    form.set_size_mode(content["particles"]["gold"], "diameter")
    content["particles"]["gold"]["diameter_um"] = -1
    form.set_medium(content, 0, "volumes")
    content["layer"][0]["volume_fractions"]["gold"] = "200 %"
    assert set(form.problems(content)) == {
        "brdf.angle_i_deg",
        "field.angle0_deg",
        "particles.gold.diameter_um",
        "layer[1].volume_fractions.gold",
    }
    content["brdf"]["angle_i_deg"], content["field"]["angle0_deg"] = [60], 60
    form.set_degrees(content, False)
    assert (content["brdf"]["mu_i"], content["field"]["mu0"]) == ([0.5], 0.5)
    assert list(content["brdf"]) == ["mu_i", "mu_o", "phi_deg"]


def test_a_card_is_called_after_its_substance_until_it_is_renamed() -> None:
    content = fresh()
    other = form.add_kind(content)
    kind = content["particles"][other]
    kind["index"], before = "gold", kind["index"]
    form.name_after(content, other, before)
    assert list(content["particles"]) == ["gold", "gold-2"]
    kind["index"] = "main/Ag/Johnson"
    form.name_after(content, "gold-2", "gold")
    assert list(content["particles"]) == ["gold", "Ag"]
    form.rename_kind(content, "Ag", "flakes")
    kind["index"] = "copper"
    form.name_after(content, "flakes", "main/Ag/Johnson")
    assert list(content["particles"]) == ["gold", "flakes"]
    content["particles"]["gold"]["index"] = [1.5, 0.0]
    form.name_after(content, "gold", "gold")  # numbers are no name
    assert list(content["particles"]) == ["gold", "flakes"]


def test_several_wavelengths_stay_in_the_file() -> None:
    content = form.adopted(tomllib.loads(form.scene_text(fresh(wavelength_um=[0.45, 0.65]))))
    assert content["wavelength_um"] == [0.45, 0.65]


@settings(max_examples=40, deadline=None)
@given(
    st.recursive(
        st.none() | st.floats() | st.text(max_size=3),
        lambda x: st.lists(x) | st.dictionaries(st.sampled_from([*form.FILE_KEYS, *form.LAYER_KEYS, "gold"]), x),
        max_leaves=10,
    )
)
def test_whatever_a_scene_is_there_is_an_answer(junk: Any) -> None:
    for key in ("layer", "particles", "brdf", "field", "wavelength_um", "base"):
        form.problems(fresh(**{key: junk}))
