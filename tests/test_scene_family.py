"""Scenes by the values of a few of their numbers, and how their ingredients change with each."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.basics.differences import find_slopes
from vrte.formats.scene_family import ChangingFile
from vrte.optics.size_distribution import Held, Lognormal
from vrte.scene.boundary import Lambertian

from .helpers import close_to
from .samples import slow_but

GLASS = {"index": [1.5, 1e-3], "radius_um": 0.12}
FILM = {"particles": {"glass": 1.0, "drop": 0.5}, "thickness_um": 30.0, "volume_fraction": 0.02}
HAZE = {"phase": {"henyey_greenstein": 0.3}, "albedo": 1.0, "thickness": 2.0}


def make_content(**changed: Any) -> dict[str, Any]:
    drop = {"index": 1.33, "size": {"gamma": {"r_eff_um": 0.1, "v_eff": 0.1}}}
    base = {"kind": "lambertian", "albedo": 0.25}
    return {
        "wavelength_um": 0.5,
        "particles": {"glass": GLASS, "drop": drop},
        "layer": [FILM, HAZE],
        "base": base,
    } | changed


def vary(name: str, **changed: Any) -> vrte.Variation:
    (found,) = vrte.SceneFamily(make_content(**changed), [name]).variations()
    return found


def test_values_go_where_their_names_say(tmp_path: Path) -> None:
    path = tmp_path / "film.toml"
    path.write_text('[[layer]]\nphase = "rayleigh"\nalbedo = 0.9\nthickness = 2\n[brdf]\nmu_i = 0.5\nmu_o = 1\n')
    for source in (path, str(path), {"layer": [{"phase": "rayleigh", "albedo": 0.9, "thickness": 2}]}):
        family = vrte.SceneFamily(source, ["layer[1].thickness", "layer[1].albedo"])
        assert family.values.tolist() == [2.0, 0.9]
        assert family.at(family.values).thickness == 2.0
        scene = family.at([3.5, 1.0])
        assert (scene.layers[0].thickness, scene.layers[0].albedo) == (3.5, 1.0)
        assert family.content_at([3.5, 1.0])["layer"][0] == {"phase": "rayleigh", "albedo": 1, "thickness": 3.5}
    assert vrte.SceneFamily(path, "layer[1].albedo").file_at([0.5]).request == {"mu_i": [0.5], "mu_o": [1.0]}


def test_what_is_known_in_closed_form() -> None:
    """Thickness, albedo, g of Henyey and Greenstein, loading and depth of a film, a Lambertian base."""
    depth = vary("layer[2].thickness")
    assert depth.thickness.tolist() == [0.0, 1.0]
    assert not depth.albedo.any()
    assert not depth.is_outside
    assert vary("layer[2].albedo").albedo == close_to([0.0, 1.0], rtol=0.0, atol=1e-12)  # 1 is the end of its range
    degree = np.arange(1, 12)
    slope = vary("layer[2].phase.henyey_greenstein").coefficients[1]
    assert slope[1:12, 0] == close_to((2 * degree + 1) * degree * 0.3 ** (degree - 1), rtol=1e-9, atol=0.0)
    scene = vrte.SceneFamily(make_content(), []).at([])
    for name, value in (("thickness_um", 30.0), ("volume_fraction", 0.02)):
        found = vary(f"layer[1].{name}")
        assert found.thickness[0] == close_to(scene.layers[0].thickness / value, rtol=1e-12, atol=0.0)
        assert found.coefficients[0].size == 0
    ((weight, white),) = vary("base.albedo").base
    assert (weight, white) == (close_to(1.0, rtol=1e-12, atol=0.0), Lambertian(1.0))


QUICK = ("particles.glass.radius_um", "particles.glass.index[2]", "layer[1].particles.drop")
SLOW = ("particles.drop.size.gamma.v_eff", "wavelength_um", "particles.drop.index")


@pytest.mark.parametrize("name", slow_but([*QUICK, *SLOW], *QUICK))
def test_what_particles_change(name: str) -> None:
    """As plain differences have it, which are good to 1e-8."""
    family = vrte.SceneFamily(make_content(), [name])
    (found,) = family.variations()
    value, step, scene_at = found.value, 1e-4 * max(0.1, found.value), found.scene_at
    up, far_up, down, far_down = (scene_at(value + sides * step).layers[0] for sides in (1, 2, -1, -2))

    def differ(read: Any) -> Any:
        return (8 * (read(up) - read(down)) - (read(far_up) - read(far_down))) / (12 * step)

    assert found.thickness[0] == close_to(differ(lambda layer: layer.thickness), rtol=1e-7, atol=0.0)
    assert found.albedo[0] == close_to(differ(lambda layer: layer.albedo), rtol=1e-7, atol=0.0)
    table = differ(lambda layer: layer.phase_matrix.coefficients[:6])
    assert abs(found.coefficients[0][:6] - table).max() < 1e-7 * abs(table).max()
    assert len(found.coefficients[0]) <= family.at(family.values).layers[0].phase_matrix.terms
    assert not found.thickness[1]
    assert not found.coefficients[1].size


def test_sizes_are_averaged_over_as_many_radii_as_at_the_value() -> None:
    settled: list[tuple[int, int]] = []
    sizes = Held(Lognormal(0.1, 1.3), settled)
    first = vrte.spheres(1.5, size=sizes, wavelength_um=0.5)
    assert settled == [(257, 6)]
    assert first.albedo == vrte.spheres(1.5, size=Lognormal(0.1, 1.3), wavelength_um=0.5).albedo
    again = vrte.spheres(1.5, size=Held(Lognormal(0.1, 1.3), [(65, 6)]), wavelength_um=0.5)
    assert "65 radii" in again.description
    assert repr(sizes) == repr(Lognormal(0.1, 1.3))
    flat = vrte.spheroids(1.5, aspect_ratio=1.2, size=Held(Lognormal(0.02, 1.2), [(9, 4)]), wavelength_um=0.5)
    assert "8 radii" in flat.description


def test_what_moves_surfaces_says_so() -> None:
    """The index of a binder changes what its surface reflects; a mirror sends back beams."""
    surface = {"interface": {"above": 1.0, "below": 1.5}}
    layers = [surface, HAZE | {"host_index": 1.5}]
    found = vary("layer[1].interface.above", layer=layers)
    assert found.is_outside
    assert found.scene_at(1.1).index_above == 1.1
    assert not vary("layer[2].thickness", layer=layers).is_outside
    mirror = {"kind": "mirror", "index": [0.2, 3.0]}
    assert vary("base.index[2]", base=mirror).is_outside
    rough = {"kind": "facets", "index": [0.2, 3.0], "roughness": 0.3}
    assert len(vary("base.roughness", base=rough).base) == 6


def test_numbers_of_a_ready_material_and_of_a_paint() -> None:
    """A material's particles have names of their own."""
    content = {"wavelength_um": 0.55, "layer": [{"material": "gold powder"}]}
    kind = 'particles."gold powder: gold"'
    family = vrte.SceneFamily(content, [f"{kind}.size.lognormal.median_um"])
    assert family.values.tolist() == [0.2]
    assert family.content_at([0.1])["particles"]["gold powder: gold"]["size"]["lognormal"]["median_um"] == 0.1
    with pytest.raises(vrte.SceneError, match="the scene has no"):
        vrte.SceneFamily(content, [f"{kind}.radii"])
    paint = {"pigment": "rutile", "volume_fraction": 0.1, "binder": 1.5, "thickness_um": 50.0, "packing": "independent"}
    family = vrte.SceneFamily({"wavelength_um": 0.55, "paint": paint}, "paint.thickness_um")
    (found,) = family.variations()
    assert found.thickness[0] == close_to(family.at([50.0]).thickness / 50.0, rtol=1e-12, atol=0.0)


SOOT, FOG = {**FILM, "particles": "glass"}, {"particles": "drop", "thickness": 0.5}
MURK = HAZE | {"albedo": 0.9}
PROFILE = [SOOT, FOG, MURK, MURK | {"thickness": 1.0}, FOG | {"thickness": 1.5}, SOOT | {"thickness_um": 90.0}]
ACROSS: list[tuple[str, float, dict[int, float]]] = [  # a number, its value, and its part in each layer
    ("layer[drop].thickness", 2.0, {2: 0.25, 5: 0.75}),
    ("layer['glass'].thickness_um", 120.0, {1: 0.25, 6: 0.75}),
    ("layer[3:5].thickness", 4.5, {3: 2.0 / 4.5, 4: 1.0 / 4.5, 5: 1.5 / 4.5}),
    ("layer[glass].volume_fraction", 0.02, {1: 1.0, 6: 1.0}),
    ("layer[3:4].albedo", 0.9, {3: 1.0, 4: 1.0}),
]


@pytest.mark.parametrize(("name", "value", "parts"), ACROSS)
def test_one_number_of_several_layers(name: str, value: float, parts: dict[int, float]) -> None:
    """Its derivative is those of the layers' own numbers by the chain rule, and that of plain differences of solves."""
    content, key = make_content(layer=PROFILE), name.rpartition(".")[2]
    family = vrte.SceneFamily(content, [name])
    assert family.values == close_to([value], rtol=1e-15, atol=0.0)
    layers = family.content_at([0.9 * value])["layer"]
    for number, layer in enumerate(layers, 1):
        own = {key: close_to(0.9 * value * parts[number], rtol=1e-15, atol=0.0)} if number in parts else {}
        assert layer == PROFILE[number - 1] | own

    def solve(scene: vrte.Scene, **how: Any) -> vrte.Brdf:
        return vrte.brdf(scene, [0.4, 0.9], [0.3, 0.8], nodes=4, truncation="none", **how)

    each = vrte.SceneFamily(content, [f"layer[{number}].{key}" for number in parts])
    single = solve(each.at(each.values), derivatives=each.variations()).jacobian
    expected = sum(part * single[f"layer[{number}].{key}"] for number, part in parts.items())
    slope = solve(family.at(family.values), derivatives=family.variations()).jacobian[name]
    assert slope == close_to(expected, rtol=0.0, atol=1e-11 * abs(expected).max())
    near, far = (
        (solve(family.at([value + step])).mueller - solve(family.at([value - step])).mueller) / (2.0 * step)
        for step in (1e-3 * value, 2e-3 * value)
    )
    assert slope == close_to((4.0 * near - far) / 3.0, rtol=0.0, atol=1e-8 * abs(slope).max())


def test_interfaces_are_no_layers_of_a_range() -> None:
    """Of a range an interface is left out, but where the number is one of interfaces; kinds may be a paint's."""
    surface = {"interface": {"above": 1.0, "below": 1.5, "roughness": 0.1}}
    inside = HAZE | {"host_index": 1.5}
    content = make_content(
        layer=[HAZE, surface, inside, {"interface": {"above": 1.5, "below": 1.0, "roughness": 0.1}}, HAZE]
    )
    family = vrte.SceneFamily(content, ["layer[1:5].thickness", "layer[1:5].interface.roughness"])
    assert family.values.tolist() == [6.0, 0.1]
    paint = {"pigment": "rutile", "volume_fraction": 0.1, "binder": 1.5, "thickness_um": 50.0}
    family = vrte.SceneFamily({"wavelength_um": 0.55, "paint": paint}, "layer[rutile].thickness_um")
    assert family.content_at([20.0])["layer"][1]["thickness_um"] == 20
    layers = [{"material": "gold powder", "thickness": thickness} for thickness in (1.0, 3.0)]
    family = vrte.SceneFamily({"wavelength_um": 0.55, "layer": layers}, 'layer["gold powder: gold"].thickness')
    assert [layer["thickness"] for layer in family.content_at([8.0])["layer"]] == [2, 6]


UNEQUAL = [FILM, HAZE, HAZE | {"albedo": 0.5, "thickness": np.inf}]
WRONG_ACROSS = [  # a number of several layers, and why it is none
    ("layer[1:9].thickness", '^"layer.1:9..thickness": a range of layers must ascend, from 1 at least to 3 at most$'),
    ("layer[3:2].thickness", "must ascend, from 1"),
    ("layer[0:2].thickness", "must ascend, from 1"),
    ("layer[sand].thickness", '^"layer.sand..thickness": no layer holds particles "sand"$'),
    ("layer[drop].thickness", 'layer.1. holds other particles too, which have one thickness with "drop"$'),
    ("layer[1:2].thickness", r"^the scene has no layer\[1\]\.thickness$"),
    ("layer[2:3].thickness", "is inf in all, and only a finite sum above 0 can be scaled$"),
    (
        "layer[2:3].albedo",
        r"layer\[2\]\.albedo is 1 and layer\[3\]\.albedo is 0\.5; one number for several layers must",
    ),
    ("layer[1:3].interface.roughness", "there are only layers$"),
    ("layer[2:3]", "is no key of a scene"),
    (["layer[2:2].albedo", "layer[2].albedo"], "two of them are the same number"),
]


@pytest.mark.parametrize(("names", "words"), WRONG_ACROSS)
def test_numbers_of_several_layers_that_are_none(names: Any, words: str) -> None:
    with pytest.raises(vrte.SceneError, match=words):
        vrte.SceneFamily(make_content(layer=UNEQUAL), names)


DEPTH = "layer[2].thickness"
WRONG: list[tuple[str | list[str], Any, str]] = [  # names, values, and why they are none
    ("layer[3].thickness", None, r"^the scene has no layer\[3\]\.thickness$"),
    ("base.kind", None, r'^base.kind is "lambertian", and only a number can be changed$'),
    ("layer..", None, "is no key of a scene"),
    ("brdf.mu_i", None, "is of what is asked for, not of the scene"),
    ("particles.spare.radius_um", None, "^particles.spare.radius_um changes nothing in the scene$"),
    ("layer[2].phase.terms", None, "^layer.2..phase.terms cannot change by a little: .*whole number"),
    ([DEPTH, DEPTH], None, "comes twice"),
    ([DEPTH, "'layer'[2].thickness"], None, "two of them are the same number"),
    (DEPTH, [1.0, 2.0], "must be 1, one for each name, not 2"),
    (DEPTH, [np.inf], "only a finite number has a derivative"),
    (DEPTH, [-1.0], "thickness"),
]


@pytest.mark.parametrize(("names", "values", "words"), WRONG)
def test_bad_names_and_values(names: Any, values: Any, words: str) -> None:
    particles = make_content()["particles"] | {"spare": GLASS}
    layers = [FILM, HAZE | {"phase": {"henyey_greenstein": 0.3, "terms": 20}}]
    content = make_content(particles=particles, layer=layers, brdf={"mu_i": 0.5, "mu_o": 0.5})
    with pytest.raises(vrte.SceneError, match=words):
        vrte.SceneFamily(content, names).variations(values)


def test_slopes_of_one_side_and_of_kinks() -> None:
    """Each array takes the steps that fit it; where a number may not go beyond, one side is enough."""

    def at(x: float) -> list[Any]:
        if x > 1.0:
            raise vrte.SceneError("at most 1")
        return [np.sin([3.0 * x]), np.array([np.inf, 2.0 * x])]

    sine, line = find_slopes(at, 1.0, 0.01)
    assert sine == close_to(3.0 * np.cos(3.0), rtol=1e-10, atol=0.0)
    assert line == close_to([0.0, 2.0], rtol=1e-12, atol=0.0)
    (kinked,) = find_slopes(lambda x: [np.array([abs(x - 0.003) + x**2])], 0.0, 0.01)
    assert kinked == close_to(-1.0, rtol=0.0, atol=1e-10)


def test_a_scene_that_is_no_file_s() -> None:
    """Names of a scene's own numbers; layers are counted as in the list that it was made of, whatever has changed."""
    layer = vrte.Layer(vrte.rayleigh(), 0.9, 0.5, 1.5)
    scene = vrte.Scene([vrte.Interface(1.0, 1.5), layer], vrte.Lambertian(0.3))
    family = vrte.SceneFamily(scene, ["layer[2].thickness", "base.albedo"])
    assert family.values.tolist() == [0.5, 0.3]
    assert (family.at([1.0, 0.4]).thickness, family.at([1.0, 0.4]).base) == (1.0, Lambertian(0.4))
    depth, base = family.variations([1.0, 0.4])
    assert (depth.value, depth.thickness.tolist(), base.value) == (1.0, [1.0], 0.4)
    with pytest.raises(vrte.SceneError, match="is a Scene and no scene file"):
        family.content_at([1.0, 0.4])


def test_a_coarser_accuracy_takes_fewer_scenes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of differences, as crowded particles need them; half of the scenes at most for 1e-7."""
    particles = {"grain": {"index": 1.6, "radius_um": 0.1}}
    layer = {"particles": "grain", "volume_fraction": 0.2, "packing": "effective-medium", "thickness_um": 5.0}
    family = vrte.SceneFamily(
        {"wavelength_um": 0.5, "particles": particles, "layer": [layer]}, ["layer[1].volume_fraction"]
    )
    made: list[int] = []
    make = ChangingFile.make
    monkeypatch.setattr(ChangingFile, "make", lambda self, *given: made.append(1) or make(self, *given))
    (fine,), many = family.variations(), len(made)
    (coarse,), few = family.variations(accuracy=1e-7), len(made) - many
    assert few < 0.8 * many
    off, largest = (
        np.abs(table).max() for table in (coarse.coefficients[0] - fine.coefficients[0], fine.coefficients[0])
    )
    assert 0.0 < off < 1e-7 * largest
    with pytest.raises(vrte.SceneError, match=r"accuracy must be between 2e-13 and 0\.1, not 1"):
        family.variations(accuracy=1.0)
