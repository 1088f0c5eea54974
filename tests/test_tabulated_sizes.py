"""Measured sizes and coated spheres wherever scenes go: spectra, sweeps, kept optics, the form."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.app.form import content as form
from vrte.app.form.checks import check_tables, find_problems
from vrte.basics.errors import SceneError
from vrte.formats.named import find_named_tables, list_substances
from vrte.formats.toml_table import write_toml
from vrte.sweep.optics import make_file_name
from vrte.sweep.template import read_sweep

from .helpers import assert_close, close_to

COATED = {"source": "coated-spheres", "core": "rutile", "shell": "silica", "shell_um": 0.01, "radius_um": 0.12}


def make_scene(**kind: Any) -> dict[str, Any]:
    light = {"wavelength_um": 0.55, "nodes": 4, "brdf": {"mu_i": 0.5, "mu_o": 0.5}}
    return {**light, "particles": {"one": kind}, "layer": [{"particles": "one", "thickness": 1.0}]}


def solve(shell_um: float, wavelength: float) -> Any:
    how: dict[str, Any] = {"shell_um": shell_um, "radius_um": 0.12, "wavelength_um": wavelength, "host_index": 1.33}
    alone = vrte.coated_spheres("rutile", "silica", **how)
    return vrte.brdf(vrte.Scene([vrte.Layer.of(alone, thickness=1.0)]), 0.5, 0.5, nodes=4)


def test_densities_count_by_their_ratios_alone() -> None:
    one, other = (vrte.Tabulated([0.1, 0.2, 0.3], [0, unit, 0]).quadrature(65) for unit in (1.0, 1e12))
    assert one[1] == close_to(other[1], rtol=1e-14, atol=0.0)


def test_spectra_and_sweeps_know_core_and_shell(tmp_path: Path) -> None:
    content = make_scene(**COATED, host_index=1.33)
    assert [name for _, name in list_substances(content)] == ["rutile", "silica"]
    (tmp_path / "paint.toml").write_text(write_toml(content))
    for wavelength, found in zip((0.45, 0.65), vrte.spectrum(tmp_path / "paint.toml", [0.45, 0.65]), strict=True):
        assert_close(found.mueller, solve(0.01, wavelength).mueller, rtol=1e-12, atol=0.0)
    with pytest.raises(SceneError, match=r"0\.43 to 1\.53 um"):
        vrte.spectrum(content, [0.4, 0.65])
    table = vrte.sweep(content | {"axes": {"particles.one.shell_um": [0.02, 0.05]}}, tmp_path / "shells.zarr")
    for index, shell in enumerate((0.02, 0.05)):
        assert_close(table.mueller.values[index].ravel(), solve(shell, 0.55).mueller.ravel(), rtol=1e-12, atol=0.0)
    table.close()


def test_a_sweep_goes_by_what_is_in_the_table_of_sizes(tmp_path: Path) -> None:
    content = make_scene(index=1.56, size={"table": "sizes.csv"}) | {"axes": {"layer[1].thickness": [1.0, 2.0]}}
    rows = "radius_um,density\n0.1,0\n0.2,5\n0.5,0\n"
    prints = []
    for text in (rows, f"{rows}0.6,0\n"):
        (tmp_path / "sizes.csv").write_text(text)
        sweep = read_sweep(content, tmp_path)
        assert list(sweep.tables()) == ["sizes.csv"]
        prints.append(sweep.fingerprint())
    assert prints[0] != prints[1]


def test_kept_optics_distinguish_sizes_and_shells_by_all_digits() -> None:
    radii, density = np.linspace(0.1, 0.9, 5000), np.ones(5000)
    peak = np.where(np.arange(5000) == 2500, 2.0, 1.0)
    sizes = [(radii, density), (np.nextafter(radii, 1.0), density), (radii, peak), (radii.tolist(), density.tolist())]
    shapes = ({"shell_um": 0.05}, {"core_ratio": 0.75}, {"core_radius_um": 0.15}, {"shell_um": np.nextafter(0.05, 1)})
    names = [make_file_name("spheres", {"index": 1.5, "size": vrte.Tabulated(*one)}) for one in sizes]
    assert (len({*names}), names[0]) == (3, names[3])
    given = {"core": 1.0, "shell": 1.59, "radius_um": 0.2}
    assert len({make_file_name("coated-spheres", given | shape) for shape in shapes}) == 4


def test_the_form_turns_spheres_into_coated_ones_and_measured_sizes() -> None:
    content = make_scene(index="gold", radius_um=0.2)
    kind = content["particles"]["one"]
    form.set_source(kind, "coated-spheres")
    assert kind == {key: value for key, value in COATED.items() if key != "shell_um"} | {
        "core_ratio": 0.8, "radius_um": 0.2
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


def test_the_form_shows_the_file_that_is_there() -> None:
    content = make_scene(index="gold", size={"table": "sizes.csv"})
    assert form.get_size_mode(content["particles"]["one"]) == "table"
    assert find_named_tables(content) == {("particles", "one", "size", "table"): "sizes.csv"}
    check_tables(content, frozenset({"sizes.csv"}))
    with pytest.raises(SceneError, match=r'size\.table = "sizes\.csv": a page reads no files'):
        check_tables(content, frozenset())
