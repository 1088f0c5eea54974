"""Measured sizes and coated spheres in scene files: tables within and beside them, spectra, sweeps, the form."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.app.form import content as form
from vrte.app.form.checks import check_tables, find_problems
from vrte.basics.errors import SceneError
from vrte.formats.named import find_named_tables, list_substances
from vrte.formats.particle_sources import check_particles
from vrte.formats.scene_file import make_scene_file, parse_toml, read_scene
from vrte.formats.toml_table import write_toml
from vrte.sweep.optics import make_file_name
from vrte.sweep.template import read_sweep

from .helpers import close_to

HOLLOW = {"source": "coated-spheres", "core": [1.0, 0.0], "shell": [1.59, 0.0], "host_index": 1.33}
LIGHT = {"wavelength_um": 0.55, "brdf": {"mu_i": 0.5, "mu_o": 0.5}}
SCENE = """
wavelength_um = 0.55
nodes = 4
[particles.clay]
index = [1.56, 0.0]
host_index = 1.33
size = { table = "sizes.csv" }
[[layer]]
particles = "clay"
thickness = 1.0
[brdf]
mu_i = 0.5
mu_o = 0.5
"""
ROWS = "0.1,0\n0.2,5\n0.4,1\n0.5,0\n"


def make_scene(kind: dict[str, Any]) -> dict[str, Any]:
    return {**LIGHT, "particles": {"one": kind}, "layer": [{"particles": "one", "thickness": 1.0}]}


def read_kind(**kind: Any) -> vrte.Particles:
    return make_scene_file(make_scene(kind)).particles["one"]


def write_files(folder: Path, table: str, scene: str = SCENE) -> Path:
    (folder / "sizes.csv").write_text(table)
    (folder / "scene.toml").write_text(scene)
    return folder / "scene.toml"


def test_a_table_in_a_scene_file_by_radii_or_diameters(tmp_path: Path) -> None:
    """And in a file beside it: the same sizes, which spheres are averaged over."""
    radii, density = [0.05, 0.06, 0.07, 0.08], [0.0, 5.0, 1.0, 0.0]
    for name, factor in (("radius_um", 1.0), ("diameter_um", 2.0)):
        sizes = [factor * radius for radius in radii]
        rows = "".join(f"{size!r},{number}\n" for size, number in zip(sizes, density, strict=True))
        write_files(tmp_path, f"# a sieve\n{name},density\n{rows}")
        for size in ({"tabulated": {name: sizes, "density": density}}, {"table": "sizes.csv"}):
            content = make_scene({"index": 1.56, "size": size})
            (found,) = make_scene_file(content, None, tmp_path, check_particles).particles["one"].balls
            assert np.array_equal([found[0].size.radius_um, found[0].size.density], [radii, density])
    expected = vrte.spheres(1.56, size=vrte.Tabulated(radii, density), wavelength_um=0.55, host_index=1.33)
    assert read_scene(tmp_path / "scene.toml").particles["clay"].extinction_um2 == expected.extinction_um2


def test_densities_count_by_their_ratios_alone() -> None:
    one, other = (vrte.Tabulated([0.1, 0.2, 0.3], [0, unit, 0]).quadrature(65) for unit in (1.0, 1e12))
    assert one[1] == close_to(other[1], rtol=1e-14, atol=0.0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "the first line must be radius_um,density or diameter_um,density"),
        ("radius_nm,density\n" + ROWS, "the first line must be radius_um,density"),
        ("radius_um,number\n" + ROWS, "the first line must be radius_um,density"),
        ("radius_um,density,k\n" + ROWS, "the first line must be radius_um,density"),
        ("radius_um,density\n0.1,1\n", "at least 2 rows below the header, not 1"),
        ("radius_um,density\n0.1,1\n0.2\n", "line 3: 2 values are needed"),
        ("radius_um,density\n0.1,1\n0.2,nan\n", "line 3: density must be a finite number"),
        ("radius_um,density\n0.1,1\n0.2,many\n", "line 3: density must be a number, not 'many'"),
        ("radius_um,density\n0.1,1\n# a gap\n0.1,2\n", "line 4: radius_um must ascend, and 0.1 follows 0.1"),
        ("diameter_um,density\n0,1\n0.1,2\n", "line 2: diameter_um must be above 0, not 0"),
        ("radius_um,density\n0.1,1\n0.2,-1\n", "line 3: density must be >= 0, not -1"),
        ("radius_um,density\n0.1,0\n0.2,0\n", "density must be >= 0 everywhere and not zero everywhere"),
        ("radius_um,density\n0.1,0\n0.2e9,1\n", "tabulated: radius_um must be a length"),
    ],
)
def test_a_wrong_table_is_refused_by_its_line(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(SceneError, match=re.escape(said)):
        vrte.read_sizes(write_files(tmp_path, text).with_name("sizes.csv"))
    with pytest.raises(SceneError, match=r"^particles\.clay\.size\.table = \"sizes\.csv\": .*" + re.escape(said)):
        read_scene(tmp_path / "scene.toml")


def test_a_table_that_is_not_there(tmp_path: Path) -> None:
    path = write_files(tmp_path, "")
    path.with_name("sizes.csv").unlink()
    with pytest.raises(SceneError, match=r"size\.table = \"sizes\.csv\": the file cannot be read: No such file"):
        read_scene(path)


@pytest.mark.parametrize(
    ("size", "said"),
    [
        ({"tabulated": {"radius_um": [0.1, 0.2]}}, r"size\.tabulated\.density: is missing"),
        ({"tabulated": {"radius_um": [0.2, 0.1], "density": [1, 1]}}, r"size\.tabulated\.radius_um must increase"),
        (
            {"tabulated": {"diameter_um": [0.2, 0.1], "density": [1, 1]}},
            r"tabulated\.diameter_um: half of it, .*increase",
        ),
        ({"tabulated": {"radius_um": [0.1, 0.2], "density": [1, -1]}}, r"size\.tabulated\.density must be >= 0"),
        ({"tabulated": {"radius_um": [0.1, 0.2], "density": [1]}}, "equally long, at least 2, not 2 and 1"),
        ({"table": "sizes.txt"}, r"size\.table = \"sizes\.txt\": must be the path of a \.csv file"),
        (
            {"table": "sizes.csv", "gamma": {"r_eff_um": 0.1, "v_eff": 0.1}},
            "exactly one of lognormal, gamma, tabulated",
        ),
    ],
)
def test_sizes_that_are_wrong_are_refused_by_their_key(size: Any, said: str) -> None:
    with pytest.raises(SceneError, match=said):
        read_kind(index=[1.5, 0.0], size=size)


# ---- coated spheres in scene files


def test_every_way_to_say_a_shell_in_a_scene_file() -> None:
    how: dict[str, Any] = {"wavelength_um": 0.55, "host_index": 1.33}
    for shape in ({"shell_um": 0.05}, {"core_ratio": 0.8}, {"core_radius_um": 0.2}):
        expected = vrte.coated_spheres(1.0, 1.59, radius_um=0.25, **shape, **how)
        assert read_kind(**HOLLOW, **shape, radius_um=0.25).extinction_um2 == expected.extinction_um2
        assert read_kind(**HOLLOW, **shape, diameter_um=0.5).extinction_um2 == expected.extinction_um2


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ({"radius_um": 0.2}, "particles.one: coated_spheres: give exactly one of core_radius_um, shell_um and core"),
        ({"radius_um": 0.2, "shell_um": 0.2}, r"particles\.one\.shell_um must be less than the smallest radius"),
        ({"radius_um": 0.2, "shell_um": "thin"}, r"particles\.one\.shell_um = \"thin\": must be"),
        ({"radius_um": 0.2, "core_ratio": 2}, r"particles\.one\.core_ratio must be a ratio"),
        ({"radius_um": 0.2, "core_radius_um": 0.3}, r"particles\.one\.core_radius_um must be above 0 and less than"),
        ({"radius_um": 0.2, "core_ratio": 0.8, "core": "golld"}, r"particles\.one\.core: 'golld' is neither"),
        ({"radius_um": 0.2, "core_ratio": 0.8, "shell": [1.5, -1]}, r"particles\.one\.shell: k must be >= 0"),
        ({"radius_um": 0.2, "core_ratio": 0.8, "index": 1.5}, r"particles\.one\.index = 1.5: unknown key"),
        ({"core_ratio": 0.8}, "exactly one of radius_um, diameter_um and size"),
    ],
)
def test_coats_that_are_wrong_are_refused_by_their_key(kind: dict[str, Any], said: str) -> None:
    with pytest.raises(SceneError, match=said):
        read_kind(**(HOLLOW | kind))


def test_spectra_know_what_core_and_shell_consist_of(tmp_path: Path) -> None:
    kind = {"source": "coated-spheres", "core": "rutile", "shell": "silica", "shell_um": 0.01, "radius_um": 0.12}
    assert dict(list_substances(make_scene(kind))) == {
        ("particles", "one", "core"): "rutile",
        ("particles", "one", "shell"): "silica",
    }
    assert find_named_tables(make_scene(kind | {"core": "clay.csv"})) == {("particles", "one", "core"): "clay.csv"}
    path = tmp_path / "paint.toml"
    path.write_text(
        SCENE.replace('size = { table = "sizes.csv" }', "radius_um = 0.12\nshell_um = 0.01").replace(
            "index = [1.56, 0.0]\n", 'source = "coated-spheres"\ncore = "rutile"\nshell = "silica"\n'
        )
    )
    spectrum = vrte.spectrum(path, [0.45, 0.65])
    for wavelength, found in zip((0.45, 0.65), spectrum, strict=True):
        alone = vrte.coated_spheres(
            "rutile", "silica", shell_um=0.01, radius_um=0.12, wavelength_um=wavelength, host_index=1.33
        )
        expected = vrte.brdf(vrte.Scene([vrte.Layer.of(alone, thickness=1.0)]), 0.5, 0.5, nodes=4)
        assert found.mueller.ravel() == close_to(expected.mueller.ravel(), rtol=1e-12, atol=0.0)
    with pytest.raises(SceneError, match=r"0\.43 to 1\.53 um"):
        vrte.spectrum(path, [0.4, 0.65])


# ---- sweeps


def test_a_sweep_over_the_thickness_of_a_shell(tmp_path: Path) -> None:
    scene = make_scene(HOLLOW | {"radius_um": 0.25, "shell_um": 0.05}) | {"nodes": 4}
    table = vrte.sweep(scene | {"axes": {"particles.one.shell_um": [0.02, 0.05]}}, tmp_path / "shells.zarr")
    for place, shell in enumerate((0.02, 0.05)):
        single = make_scene_file(make_scene(HOLLOW | {"radius_um": 0.25, "shell_um": shell}))
        alone = vrte.brdf(single.scene, 0.5, 0.5, nodes=4)
        assert table.mueller.values[place].ravel() == close_to(alone.mueller.ravel(), rtol=1e-12, atol=0.0)
    table.close()


def test_a_sweep_goes_by_what_is_in_the_table_of_sizes(tmp_path: Path) -> None:
    path = write_files(tmp_path, f"radius_um,density\n{ROWS}", SCENE + '[axes]\n"layer[1].thickness" = [1.0, 2.0]\n')
    sweep = read_sweep(path)
    assert list(sweep.tables()) == ["sizes.csv"]
    before = sweep.fingerprint()
    write_files(tmp_path, f"radius_um,density\n{ROWS}0.6,0\n", path.read_text())
    assert read_sweep(path).fingerprint() != before


def test_kept_optics_tell_long_tables_apart_by_all_digits() -> None:
    radii, density = np.linspace(0.1, 0.9, 5000), np.ones(5000)
    others = [
        (radii, density),
        (np.nextafter(radii, 1.0), density),
        (radii, np.where(np.arange(5000) == 2500, 2.0, 1.0)),
    ]
    names = {
        make_file_name("spheres", {"index": 1.5, "size": vrte.Tabulated(*one), "wavelength_um": 0.5}) for one in others
    }
    assert len(names) == 3
    again = vrte.Tabulated(radii.tolist(), density.tolist())
    assert make_file_name("spheres", {"index": 1.5, "size": again, "wavelength_um": 0.5}) in names


def test_kept_optics_tell_shells_apart() -> None:
    given = {"core": 1.0, "shell": 1.59, "radius_um": 0.2, "wavelength_um": 0.5}
    shapes = ({"shell_um": 0.05}, {"core_ratio": 0.75}, {"core_radius_um": 0.15}, {"shell_um": np.nextafter(0.05, 1)})
    assert len({make_file_name("coated-spheres", given | shape) for shape in shapes}) == 4


# ---- the viewer's form


def test_the_form_turns_spheres_into_coated_ones_and_measured_sizes() -> None:
    content = make_scene({"index": "gold", "radius_um": 0.2})
    kind = content["particles"]["one"]
    form.set_source(kind, "coated-spheres")
    assert kind == {
        "source": "coated-spheres", "core": "rutile", "shell": "silica", "core_ratio": 0.8, "radius_um": 0.2
    }  # fmt: skip
    assert find_problems(content) == {}
    for mode in ("tabulated", "tabulated, diameters"):
        form.set_size_mode(kind, mode)
        assert form.get_size_mode(kind) == mode
        assert find_problems(content) == {}
    form.put(content, ("particles", "one", "shell_um"), 0.05)
    assert "exactly one of core_radius_um, shell_um and core_ratio" in str(find_problems(content))
    content["particles"]["kind-1"] = content["particles"].pop("one")
    content["layer"][0]["particles"] = "kind-1"
    form.name_after(content, "kind-1", None)
    assert list(content["particles"]) == ["rutile"]
    form.set_source(content["particles"]["rutile"], "spheres")
    assert "shell" not in content["particles"]["rutile"]


def test_what_the_form_holds_is_a_scene_file() -> None:
    content = make_scene(
        HOLLOW | {"shell_um": 0.05, "size": {"tabulated": {"radius_um": [0.2, 0.3], "density": [1, 1]}}}
    )
    assert parse_toml(write_toml(content)) == content


def test_the_form_shows_the_file_that_is_there() -> None:
    kind = {"index": "gold", "size": {"table": "sizes.csv"}}
    assert form.get_size_mode(kind) == "table"
    content = make_scene(kind)
    assert find_named_tables(content) == {("particles", "one", "size", "table"): "sizes.csv"}
    check_tables(content, frozenset({"sizes.csv"}))
    with pytest.raises(SceneError, match=r'size\.table = "sizes\.csv": a page reads no files'):
        check_tables(content, frozenset())
