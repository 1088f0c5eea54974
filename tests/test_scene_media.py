"""Interfaces, mirrors and media in scene files: read as meant, written back, named where they are wrong."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.basics.errors import Place
from vrte.formats.named import find_known_wavelengths, find_named_tables
from vrte.formats.scene_file import make_scene_file
from vrte.formats.toml_table import show_place, write_toml
from vrte.optics.refractive_index import refractive_index
from vrte.scene.scene import Scene
from vrte.sweep.optics import KeptOptics

from .helpers import assert_close, close_to

GLASS: dict[str, Any] = {"index": [1.7, 0.0], "radius_um": 0.1}
PAINT = {"particles": "glass", "thickness": 2.0}
FACETS = {"roughness": 0.1, "distribution": "ggx", "shadowing": True}


def make_content(*layers: dict[str, Any], base: Any = None, **more: Any) -> dict[str, Any]:
    """A scene of those layers at 0.55 um."""
    content = {"wavelength_um": 0.55, **more, "particles": {"glass": GLASS}, "layer": list(layers)}
    return content | ({} if base is None else {"base": base}) | {"brdf": {"mu_i": 0.5, "mu_o": 1.0}}


def read(*layers: dict[str, Any], base: Any = None, folder: Path = Path(), **more: Any) -> Scene:
    """The scene of such a file, written and read again."""
    text = write_toml(make_content(*layers, base=base, **more))
    return make_scene_file(tomllib.loads(text), folder=folder).scene


def between(above: Any, below: Any, **more: Any) -> dict[str, Any]:
    """A [[layer]] that is an interface."""
    return {"interface": {"above": above, "below": below, **more}}


def test_interfaces_stand_where_the_file_has_them() -> None:
    varnish = {"phase": "rayleigh", "albedo": 0.5, "thickness": 0.1}
    scene = read(between(1.0, 1.4), varnish, between(1.4, 1.5, **FACETS), PAINT, host_index=1.5)
    assert scene.interfaces == (vrte.Interface(1.0, 1.4), vrte.Interface(1.4, 1.5, 0.1, "ggx", True), None)
    assert (scene.index_above, *scene.indices, scene.index_below) == (1.0, 1.4, 1.5, 1.5)
    by_hand = vrte.spheres(1.7, radius_um=0.1, wavelength_um=0.55, host_index=1.5)
    np.testing.assert_array_equal(scene.layers[1].phase_matrix.coefficients, by_hand.phase_matrix.coefficients)


def test_a_plate_is_two_interfaces() -> None:
    scene = read(between(1.0, [1.5, 0]), between(1.5, 1.33))
    assert (scene.index_above, *scene.indices, scene.index_below) == (1.0, 1.5, 1.33)
    assert scene.thickness == 0.0


@pytest.mark.parametrize("wavelength", [0.45, 0.65])
def test_a_medium_by_name_has_the_index_of_the_wavelength(wavelength: float) -> None:
    scene = read(between(1, "silica"), PAINT, wavelength_um=wavelength, host_index="silica")
    assert scene.indices == (refractive_index("silica", wavelength).n,)
    assert scene.layers[0].host_index == scene.indices[0]


def test_water_is_clear_and_a_table_of_ones_own_too(tmp_path: Path) -> None:
    (tmp_path / "oil.csv").write_text("wavelength_um,n\n0.5,1.46\n0.6,1.48\n")
    scene = read(between("water", "oil.csv"), PAINT, host_index="oil.csv", folder=tmp_path)
    assert refractive_index("water", 0.55).k > 0.0
    assert scene.index_above == refractive_index("water", 0.55).n
    assert scene.indices == (close_to(1.47, rtol=0.0, atol=1e-12),)


def test_each_kind_of_particles_may_have_a_medium_of_its_own() -> None:
    kinds = {"glass": GLASS | {"host_index": 1.5}, "haze": GLASS}
    content = make_content(
        {"particles": "haze", "thickness": 0.1}, between(1.0, 1.5), PAINT, base={"kind": "lambertian", "albedo": 0.5}
    )
    scene = make_scene_file(tomllib.loads(write_toml(content | {"particles": kinds}))).scene
    assert [layer.host_index for layer in scene.layers] == [1.0, 1.5]
    of_the_file = make_scene_file(content | {"particles": {"glass": kinds["glass"], "haze": GLASS | {"host_index": 1}}})
    assert of_the_file.scene.indices == scene.indices


@pytest.mark.parametrize(
    ("index", "expected"),
    [(1.5, 1.5), ([0.2, 3.5], 0.2 + 3.5j), ("gold", refractive_index("gold", 0.55).value), ("clay.csv", 1.5 + 0.1j)],
)
def test_a_mirror_takes_what_particles_take(index: Any, expected: complex, tmp_path: Path) -> None:
    (tmp_path / "clay.csv").write_text("wavelength_um,n,k\n0.5,1.4,0.1\n0.6,1.6,0.1\n")
    scene = read(PAINT, base={"kind": "mirror", "index": index}, folder=tmp_path)
    assert isinstance(scene.base, vrte.Mirror)
    assert scene.base.index == close_to(expected, rtol=0.0, atol=1e-12)


def test_a_rough_base_takes_an_index_and_facets() -> None:
    base = {"kind": "facets", "index": "gold", "roughness": 0.3}
    assert read(PAINT, base=base).base == vrte.Facets(refractive_index("gold", 0.55).value, 0.3)
    shadowed = base | {"distribution": "ggx", "shadowing": True}
    assert read(PAINT, base=shadowed | {"index": 1.34}).base == vrte.Facets(1.34, 0.3, "ggx", True)


def test_tables_and_wavelengths_of_media_are_found() -> None:
    content = make_content(between(1.0, "oil.csv"), {"phase": "fog.csv"}, base={"kind": "mirror", "index": "gold.csv"})
    content |= {"host_index": "wax.csv", "particles": {"glass": GLASS | {"host_index": "oil.csv"}}}
    assert {show_place(place): name for place, name in find_named_tables(content).items()} == {
        "layer[1].interface.below": "oil.csv",
        "layer[2].phase": "fog.csv",
        "base.index": "gold.csv",
        "host_index": "wax.csv",
        "particles.glass.host_index": "oil.csv",
    }
    assert find_known_wavelengths(make_content(between(1.0, "rutile"))) == (0.43, 1.53, "rutile")


@pytest.mark.parametrize(
    ("content", "place", "complaint"),
    [
        (make_content(between(1.0, 1.5) | {"thickness": 1.0}), ("layer", 0, "thickness"), "of its own"),
        (make_content({"interface": 1.5}), ("layer", 0, "interface"), "must be a table with the keys above, below"),
        (make_content({"interface": {"above": 1.0}}), ("layer", 0, "interface", "below"), "is missing"),
        (make_content(between(1.0, 0.05)), ("layer", 0, "interface", "below"), "a real refractive index from 0.1"),
        (make_content(between(1.0, True)), ("layer", 0, "interface", "below"), "must be the name of a material"),
        (make_content(between(1.0, "gold")), ("layer", 0, "interface", "below"), "what absorbs more is for bases"),
        (make_content(between(1.0, [1.5, 0.1])), ("layer", 0, "interface", "below"), "1.5 + 0.1i"),
        (make_content(between(1.0, "wter")), ("layer", 0, "interface", "below"), "is neither a known name"),
        (make_content(between(1.0, "lost.csv")), ("layer", 0, "interface", "below"), "cannot be read"),
        (make_content(between("rutile", 1.0), wavelength_um=0.4), ("layer", 0, "interface", "above"), "from 0.43"),
        (make_content(between(1.0, 1.5, ruoghness=1)), ("layer", 0, "interface", "ruoghness"), "'roughness'"),
        (make_content(between(1.0, 1.5, roughness=2.0)), ("layer", 0, "interface", "roughness"), "from 0.01 to 1.5"),
        (make_content(between(1.0, 1.5, shadowing=True)), ("layer", 0, "interface", "shadowing"), "is for facets"),
        (make_content(between(1.0, 1.5, distribution="gxg")), ("layer", 0, "interface", "distribution"), "'ggx'"),
        (make_content(PAINT, base={"kind": "mirror"}), ("base", "index"), "is missing"),
        (make_content(PAINT, base={"kind": "mirror", "index": "gild"}), ("base", "index"), "is neither a known name"),
        (make_content(PAINT, base={"kind": "mirror", "index": [1.5, -1]}), ("base", "index"), "k from 0 to"),
        (make_content(PAINT, base={"kind": "mirror", "index": 1, "albedo": 1}), ("base", "albedo"), '"lambertian"'),
        (make_content(PAINT, base={"kind": "facets", "index": 1.5}), ("base", "roughness"), "is missing"),
        (make_content(PAINT, base={"kind": "facets", "index": 1.5, "roughness": 0}), ("base", "roughness"), "Mirror"),
        (make_content(PAINT, base={"kind": "mirror", "index": 1, "roughness": 1}), ("base", "roughness"), '"facets"'),
        (make_content(PAINT, base={"kind": "black", "index": 1.5}), ("base", "index"), '"mirror"'),
        (make_content(PAINT, host_index="gold"), ("host_index",), "light goes through media with k from 0"),
        (make_content(PAINT, host_index=0), ("host_index",), "must be a real refractive index"),
    ],
)
def test_what_is_wrong_is_named(content: dict[str, Any], place: Place, complaint: str) -> None:
    with pytest.raises(vrte.SceneError) as caught:
        make_scene_file(content)
    assert caught.value.place == place
    assert str(caught.value).startswith((show_place(place), "particles.glass: host_index"))
    assert complaint in str(caught.value)


def test_a_host_of_its_own_is_named_at_its_own_place() -> None:
    content = make_content(PAINT) | {"particles": {"glass": GLASS | {"host_index": 0.0}}}
    with pytest.raises(vrte.SceneError, match="must be a real refractive index") as caught:
        make_scene_file(content)
    assert caught.value.place == ("particles", "glass", "host_index")


def test_media_must_fit_together() -> None:
    varnish = {"phase": "rayleigh", "albedo": 0.5, "thickness": 0.1}
    for layers, number, words in (
        ((between(1.0, 1.5), PAINT), 2, "1.33, and the interface above it has 1.5"),
        ((between(1.0, 1.5), varnish, PAINT), 3, "1.33, and layer 2, without an interface between, has 1.5"),
        ((PAINT, between(1.4, 1.5)), 1, "1.33, and the interface below it has 1.4"),
    ):
        with pytest.raises(vrte.SceneError) as caught:
            read(*layers, host_index=1.33)
        assert str(caught.value) == f"layer {number} has the refractive index {words}"
        assert caught.value.place == ("layer", number - 1)
    with pytest.raises(
        vrte.SceneError, match=r"medium between two interfaces has the refractive index 1\.5, and .* 1\.4"
    ):
        read(between(1.0, 1.5), between(1.4, 1.0))


def test_particles_kept_by_a_sweep_keep_their_medium(tmp_path: Path) -> None:
    optics = KeptOptics(tmp_path)
    given = {"index": 1.7, "radius_um": 0.1, "wavelength_um": 0.55, "host_index": 1.5}
    kept = optics.keep("spheres", given)
    assert kept.host_index == optics("spheres", given).host_index == 1.5
    assert len(list(tmp_path.glob("*.lock"))) == 1


def test_one_kind_lies_in_two_media_and_a_clear_coat_has_none() -> None:
    """A layer's own host wins over the file's; interfaces fit; a tinted coat absorbs 4 pi k/wavelength a micrometre."""
    content = make_content(
        between(1.0, 1.5),
        {"host_index": [1.5, 1e-4], "thickness_um": 100.0},
        {**PAINT, "host_index": [1.5, 0.0]},
        between(1.5, "water"),
        {**PAINT, "host_index": "water"},
    )
    scene = make_scene_file(content).scene
    assert scene.indices[:2] == (1.5, 1.5)
    assert scene.layers[0].thickness == close_to(100.0 * 4e-4 * np.pi / content["wavelength_um"], rtol=1e-6, atol=0.0)
    assert scene.layers[0].albedo == 0.0
    assert scene.layers[1].phase_matrix.asymmetry != scene.layers[2].phase_matrix.asymmetry


@pytest.mark.parametrize(
    ("layer", "key", "complaint"),
    [
        ({"host_index": 1.5, "thickness": 1.0}, "thickness", "a clear layer has none"),
        ({"host_index": 1.5}, "thickness_um", "is missing"),
        ({"host_index": [1.5, 0.1], "thickness_um": 1.0}, "host_index", "k from 0 to 0.01 n"),
        ({**PAINT, "host_index": [1.5, 1e-3]}, "volume_fraction", "the host absorbs"),
        ({**PAINT, "packing": "dense"}, "packing", '"independent"'),
        ({**PAINT, "volume_fraction": 0.1}, "volume_fraction", "is not used"),
    ],
)
def test_what_is_wrong_with_a_layers_medium_is_named(layer: dict[str, Any], key: str, complaint: str) -> None:
    with pytest.raises(vrte.SceneError, match=complaint) as caught:
        make_scene_file(make_content(layer))
    assert caught.value.place == ("layer", 0, key)


def test_a_tinted_medium_must_be_that_of_a_layer_that_counts_it() -> None:
    tint = [1.5, 1e-3]
    coat = {"host_index": tint, "thickness_um": 100.0}
    assert read(between(1.0, tint), coat, between(tint, 1.33)).layers[0].thickness > 2.0
    for layers in ((), ({"phase": "rayleigh", "albedo": 0.5, "thickness": 0.1},)):
        with pytest.raises(vrte.SceneError, match="absorbs, which no layer counts") as caught:
            read(between(1.0, tint), *layers, between(tint, 1.33))
        assert caught.value.place == ("layer", 0, "interface", "below")


def test_a_sweep_finds_particles_in_the_media_of_their_layers() -> None:
    content = make_content({**PAINT, "host_index": 1.5})
    content["axes"] = {"n": {"key": "layer[1].host_index", "values": [1.3, 1.4]}}
    table = vrte.sweep(content)
    one = vrte.brdf(
        make_scene_file(make_content({**PAINT, "host_index": 1.4})).scene,
        **make_scene_file(content := make_content(PAINT)).request,
    )
    assert_close(table.mueller.sel(n=1.4), one.mueller, rtol=1e-5, atol=1e-7)
