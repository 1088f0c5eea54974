"""Sweeps: files, axes, tables of BRDFs and fields, engines, batches; between the scenes of a table, and memory."""

import copy
import http.client
import json
import logging
import shutil
import sys
import threading
import tomllib
import types
import warnings
from collections.abc import Iterator
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
import xarray

import vrte
from vrte.basics.errors import SceneError, SweepError
from vrte.calls import brdfs
from vrte.request.request import make_brdf_request
from vrte.sweep import chunks, engines, store
from vrte.sweep.interpolation import held_out
from vrte.sweep.run import SweepWarning
from vrte.sweep.store import describe_sweep_results
from vrte.sweep.table import open_table
from vrte.sweep.template import read_sweep

from .helpers import assert_close, printed_by, run

SAME = 1e-12  # of the largest element of a scene
# rtol, and atol of the largest, of BRDFs whose particles are made by hand
WITHIN = {"mueller": (0.0, 1e-13), "reflectance": (1e-12, 0.0), "direct_transmittance": (1e-15, 0.0)}
MU, PHI = [0.2, 0.6, 1.0], [0.0, 70.0, 180.0]
RAYLEIGH: dict[str, Any] = {"phase": "rayleigh", "albedo": 0.9, "thickness": 1.0}
GOLD = {"gold": {"index": "gold", "radius_um": 0.05}}
POWDER = """
nodes = 4
wavelength_um = 0.64
particles.gold = { index = "gold", radius_um = 0.05 }
particles.glass = { index = [1.5, 0.0], radius_um = 0.05 }
layer = [{ particles = { gold = 0.5, glass = 0.5 }, thickness = 1.0 }]
base = { kind = "lambertian", albedo = 0.2 }
brdf = { mu_i = [0.6, 1.0], mu_o = [0.3, 0.8], phi_deg = [0, 90, 180] }
[axes]
"""
AXES = """
wavelength_um = [0.5, 0.64]
radius = { key = "particles.gold.radius_um", start = 0.02, stop = 0.08, count = 2, spacing = "log" }
share = { key = "layer[1].particles.gold", values = [0, 0.25, 1] }
"base.albedo" = { start = 0, stop = 1, count = 2 }
"""
DEPTHS = [0.2, 1.0, 3.0, 9.0]
TOGETHER = {"thickness": [1e-12, 1e-6, 1.0], "albedo": [0.3, 0.6, 1.0]}
BEAMS = {"mu0": [0.6, 1.0], "mu": [-0.5, 0.5, 1.0], "phi_deg": [0, 90], "tau": [0, 0.1], "stokes": [1, 0.5, 0, 0.1]}
FLUXES = {"mu0": 0.6, "mu": [], "tau": [0, 0.1]}


def simple(axes: dict[str, Any], **more: Any) -> dict[str, Any]:
    """A sweep of one Rayleigh layer, a millisecond a scene."""
    return {"nodes": 3, "layer": [dict(RAYLEIGH)], "brdf": {"mu_i": 0.6, "mu_o": [0.5, 1.0]}, "axes": axes} | more


def fields(field: dict[str, Any] = BEAMS, **more: Any) -> dict[str, Any]:
    """Fields of Rayleigh layers of several depths."""
    axes = {"depth": {"key": "layer[1].thickness", "values": DEPTHS}}
    return {"nodes": 4, "layer": [RAYLEIGH], "field": field, "axes": axes} | more


def powder(**more: Any) -> dict[str, Any]:
    """Gold spheres over a floor, thin, thick and semi-infinite, on few nodes and on as many as it takes."""
    axes = {
        "wavelength_um": [0.45, 0.6],
        "depth": {"key": "layer[1].thickness", "values": [0.1, 10, np.inf]},
        "radius": {"key": "particles.gold.radius_um", "values": [0.05, 0.2]},
    }
    layer, base = {"particles": "gold", "thickness": 1.0}, {"kind": "lambertian", "albedo": 0.5}
    brdf = {"mu_i": [0.4, 1.0], "mu_o": [0.2, 0.5, 0.9], "phi_deg": PHI}
    given = {"wavelength_um": 0.5, "particles": GOLD, "layer": [layer], "base": base, "brdf": brdf, "axes": axes}
    return given | more


def stacks(axes: dict[str, Any]) -> dict[str, Any]:
    """Two layers over a floor; no light reaches what lies below a semi-infinite one, and it is solved by itself."""
    layers = [RAYLEIGH, {"phase": "isotropic", "albedo": 0.8, "thickness": 0.8}]
    floor, brdf = {"kind": "lambertian", "albedo": 0.2}, {"mu_i": MU, "mu_o": MU, "phi_deg": PHI}
    return simple(axes, nodes=6, truncation="none", layer=layers, base=floor, brdf=brdf)


def gap(one: Any, other: Any) -> float:
    """The largest difference of two tables, of the largest element of each scene."""
    assert one.error.equals(other.error)
    assert (one.error == "").any()
    scenes, found = set(one.error.dims), []
    for first, second in ((one[name], other[name]) for name in WITHIN):
        rest = [dim for dim in first.dims if dim not in scenes]
        found.append(float((abs(second - first).max(rest) / abs(first).max(rest).clip(1e-290)).max()))
    return max(found)


def check_scenes(table: Any, solve: Any, allowed: float) -> None:
    """Each scene is what ``solve`` makes of its coordinates, to so much of WITHIN; what it does not have is 0."""
    assert not (table.error != "").any()
    for index in np.ndindex(table.error.shape):
        here = table[dict(zip(table.error.dims, index, strict=True))]
        alone = solve(*(here[name].item() for name in json.loads(table.attrs["sweep"])["axes"]))
        for name in {*table.data_vars} - {"error"}:
            right, (rtol, atol) = getattr(alone, name), WITHIN.get(name, (0.0, 0.0))
            right = np.zeros(here[name].shape) if right is None else right
            assert_close(here[name], right, rtol=allowed * rtol, atol=allowed * atol * np.abs(right).max())


def solve_grains(wavelength_um: float, radius_um: float, fraction: float, albedo: float) -> vrte.Brdf:
    gold = vrte.spheres("gold", radius_um=radius_um, wavelength_um=wavelength_um)
    glass = vrte.spheres((1.5, 0.0), radius_um=0.05, wavelength_um=wavelength_um)
    layer = vrte.Layer.of(vrte.mixture([(gold, fraction), (glass, 0.5)]), 1.0)
    return vrte.brdf(vrte.Scene([layer], vrte.Lambertian(albedo)), [0.6, 1.0], [0.3, 0.8], [0, 90, 180], nodes=4)


def solve_slab(thickness: float, albedo: float) -> vrte.Brdf:
    return vrte.brdf(vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo, thickness)]), 0.6, [0.5, 1.0], nodes=3)


SLABS = {name: {"key": f"layer[1].{name}", "values": few} for name, few in TOGETHER.items()}
LISTED = {name: axis | {"along": "sample"} for name, axis in SLABS.items()}  # axes that go together


BRDF = {"mu_i": [0.5, 1.0], "mu_o": [0.5, 1.0]}
THROUGH = {"brdf": BRDF | {"transmission": True}}
SURFACE_FIELD = {"field": {"mu0": [0.6, 1.0], "mu": [-0.5, 0.5], "tau": [0.0, 0.5]}}
LIGHT, PLAIN = {"stokes", "flux_up", "flux_down", "direct"}, {*WITHIN}
SPECULAR = {"specular", "specular_reflectance", "total_reflectance"}
GLOSSY, ROUGH = {"layer[1].interface.below": [1.0, 1.33, 1.5]}, {"layer[1].interface.roughness": [0.1, 0.2]}
DEPTH, MIRROR = {"layer[1].thickness": [0.5, 1.0]}, {"layer": [RAYLEIGH], "base": {"kind": "mirror", "index": 1.5}}
FACETS = {"layer": [RAYLEIGH], "base": {"kind": "facets", "index": 1.34, "roughness": 0.1}}
MEDIA = {
    "particles": {"glass": {"index": 1.7, "radius_um": 0.1}},
    "layer": [{"interface": {"above": 1.0, "below": 1.33}}, {"particles": "glass", "thickness": 1.0}],
    "wavelength_um": 0.55,
    "host_index": 1.33,
}
BINDERS = {key: {"values": [1.33, 1.5], "along": "binder"} for key in ("layer[1].interface.below", "host_index")}


def glossy(axes: dict[str, Any], interface: Any = None, **more: Any) -> dict[str, Any]:
    """A Rayleigh layer under an interface."""
    stack = [{"interface": {"above": 1.0, "below": 1.5} if interface is None else interface}, RAYLEIGH]
    return {"nodes": 8, "layer": stack, **({} if "field" in more else {"brdf": BRDF}), **more, "axes": axes}


def test_fields_under_a_surface_have_media_and_beams_both_ways() -> None:
    below = {"below": {"key": "layer[1].interface.below", "values": [1.0, 1.5]}}
    table = vrte.sweep(glossy(below, **SURFACE_FIELD), workers=1)
    assert table["index"].values.tolist() == [[1.0, 1.0], [1.0, 1.5]]
    assert not table.direct_up[0].any()
    scene = vrte.Scene([vrte.Interface(1.0, 1.5), vrte.Layer(vrte.rayleigh(), 0.9, 1.0)])
    alone = vrte.radiance(scene, [0.6, 1.0], mu=[-0.5, 0.5], tau=[0.0, 0.5], nodes=8)
    for name in ("stokes", "direct", "direct_up", "flux_up", "flux_down"):
        np.testing.assert_array_equal(table[name][1], getattr(alone, name))
    depths = {"depth": {"key": "layer[2].thickness", "values": [1.0, 2.0]}}
    inside = vrte.sweep(glossy(depths, field=SURFACE_FIELD["field"] | {"side": "below"}), workers=1)
    assert inside["index"].values.tolist() == [[1.5, 1.5]] * 2


def solve_glossy(value: float, key: str) -> vrte.Brdf:
    """A Rayleigh layer under a surface of some index or roughness, or over a mirror."""
    layer, mu = vrte.Layer(vrte.rayleigh(), 0.9, 1.0), BRDF["mu_i"]
    scene = {
        "below": lambda: vrte.Scene([vrte.Interface(1.0, value), layer]),
        "roughness": lambda: vrte.Scene([vrte.Interface(1.0, 1.5, value), layer]),
        "mirror": lambda: vrte.Scene([layer], vrte.Mirror(value)),
    }[key]()
    return vrte.brdf(scene, mu, mu, nodes=8, transmission=True)


@pytest.mark.parametrize(
    ("content", "solve", "allowed"),
    [
        (tomllib.loads(POWDER + AXES), solve_grains, 1.0),
        (simple(SLABS), solve_slab, 0.0),  # by the algorithm of a BRDF: modes would lose digits of thin layers' fluxes
        (simple(LISTED), solve_slab, 0.0),
        (glossy(GLOSSY, **THROUGH), partial(solve_glossy, key="below"), 0.0),
        (glossy({"layer[1].interface.roughness": [0.0, 0.4]}, **THROUGH), partial(solve_glossy, key="roughness"), 0.0),
        (glossy({"base.index": [1.33, 1.5]}, **MIRROR, **THROUGH), partial(solve_glossy, key="mirror"), 0.0),
    ],
    ids=["grains", "slabs", "a list", "a surface", "facets", "a mirror"],
)
def test_a_table_holds_the_brdf_of_each_scene(content: Any, solve: Any, allowed: float) -> None:
    check_scenes(vrte.sweep(content, workers=1), solve, allowed)


def test_values_are_put_where_their_keys_lead() -> None:
    keys = "particles.dust.size.lognormal.sigma", "particles.dust.index[2]", "layer[1].phase.henyey_greenstein", "nodes"
    dust = {"index": [1.5, 0.0], "size": {"lognormal": {"median_um": 0.05, "sigma": 1.2}}}
    layer = {"phase": {"henyey_greenstein": 0.1, "terms": 6}, "albedo": 0.9, "thickness": 0.5}
    axes = dict(zip(keys, ([1.2, 1.5], [0.0, 0.1], [0.0, 0.5], [3, 4]), strict=True))
    found = read_sweep(simple(axes, wavelength_um=0.6, particles={"dust": dust}, layer=[layer])).content((1, 1, 1, 1))
    assert found["particles"] == {
        "dust": {"index": [1.5, 0.1], "size": {"lognormal": {"median_um": 0.05, "sigma": 1.5}}}
    }
    assert (found["layer"][0]["phase"], found["nodes"]) == ({"henyey_greenstein": 0.5, "terms": 6}, 4)


def test_an_axis_may_be_one_number_of_several_layers() -> None:
    """Each scene is that of a stack whose layers keep their parts of the total, in the table and between its scenes."""
    content = stacks({"total": {"key": "layer[1:2].thickness", "values": [0.5, 2.0]}})
    tops = [layer["thickness"] for layer in content["layer"]]
    table = vrte.sweep(content, workers=1)
    for total in (0.5, 2.0):
        layers = [layer | {"thickness": layer["thickness"] * total / sum(tops)} for layer in content["layer"]]
        one = vrte.sweep(content | {"layer": layers, "axes": {"nodes": [6]}}, workers=1)
        expected = one.mueller.values[0]
        assert_close(table.mueller.sel(total=total).values, expected, rtol=1e-13, atol=1e-14)
    assert np.isfinite(vrte.interpolate(table, {"total": 1.0}).mueller.values).all()
    assert held_out(table, points=1).errors.size == 1


@pytest.mark.parametrize("kind", ["brdf", "field"])
def test_zarr_netcdf_and_memory_hold_the_same(kind: str, tmp_path: Path) -> None:
    axes = {"depth": {"key": "layer[1].thickness", "values": [0.1, 1, np.inf]}, "layer[1].albedo": [0.5, 1.0]}
    given = simple(axes) if kind == "brdf" else fields()
    memory = vrte.sweep(given)
    for name in ("table.zarr", "table.nc"):
        with vrte.sweep(given, tmp_path / name, chunk=2) as table:
            assert table.load().identical(memory.assign_attrs(table.attrs))
    assert {path.name for path in tmp_path.iterdir()} == {"table.zarr", "table.nc"}
    array = "mueller" if kind == "brdf" else "stokes"
    with xarray.open_dataset(tmp_path / "table.nc", engine="h5netcdf") as plain:  # as anybody opens them
        np.testing.assert_array_equal(plain[array], memory[array])
    plain = xarray.open_zarr(tmp_path / "table.zarr", chunks=None)
    assert plain[array].attrs["units"] == memory[array].attrs["units"] != ""
    if kind == "brdf":
        np.testing.assert_array_equal(plain.mueller.sel(stokes_out="I", stokes_in="Q"), memory.mueller[..., 0, 1])


@pytest.mark.parametrize("side", ["top", "bottom"])
@pytest.mark.parametrize("field", [BEAMS, FLUXES], ids=["Stokes vectors", "fluxes alone"])
def test_each_scene_has_its_field(field: dict[str, Any], side: str) -> None:
    table = vrte.sweep(fields(field, illuminate=side), workers=1)
    for index, depth in enumerate(DEPTHS):
        scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, depth)])
        asked = {name.removesuffix("_deg"): values for name, values in field.items()}
        alone = vrte.radiance(scene, nodes=4, illuminate=side, **asked | {"mu0": np.atleast_1d(field["mu0"])})
        names = ("flux_up", "flux_down", "direct", *(("stokes",) if field["mu"] else ()))
        assert set(table.data_vars) == {*names, "incident_stokes", "error"}
        for name in names:
            np.testing.assert_array_equal(table[name].values[index], getattr(alone, name))
        np.testing.assert_array_equal(table.incident_stokes, alone.incident_stokes)
    if side == "top" and not field["mu"]:
        exact = vrte.radiance(vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 2.0)]), 0.6, mu=[], nodes=4)
        near = vrte.interpolate(table, {"depth": 2.0}).flux_up.values[:, :1]
        assert_close(near.ravel(), np.ravel(exact.flux_up), rtol=0.02, atol=0.0)
        with pytest.raises(SceneError, match="held_out measures BRDFs"):
            held_out(table)


@pytest.mark.parametrize(
    ("content", "names"),
    [
        (glossy(GLOSSY), PLAIN | SPECULAR),
        (glossy(ROUGH), PLAIN | {"surface"}),
        (glossy({"layer[1].interface.roughness": [0.0, 0.1]}), PLAIN | SPECULAR | {"surface"}),
        (
            glossy(GLOSSY, **THROUGH),
            PLAIN | SPECULAR | {"transmission", "specular_transmission"},
        ),
        (glossy(DEPTH, **MIRROR), PLAIN | SPECULAR),
        (glossy({"base.index": [1.4, 1.5]}, **MIRROR), PLAIN | SPECULAR),
        (glossy(DEPTH, layer=[RAYLEIGH]), PLAIN),
        (glossy({"base.roughness": [0.1, 0.2]}, **FACETS), PLAIN),
        (glossy(DEPTH, layer=[RAYLEIGH], **SURFACE_FIELD), LIGHT),
        (glossy(GLOSSY, **SURFACE_FIELD), LIGHT | {"direct_up", "index"}),
        (glossy(BINDERS, **MEDIA), PLAIN | SPECULAR),
    ],
)
def test_a_table_has_what_its_scenes_may_have(content: dict[str, Any], names: set[str]) -> None:
    assert set(describe_sweep_results(read_sweep(content)).variables) == names


ALBEDO = "layer[1].albedo"
REFUSED = [
    (simple({}), "axes is missing"),
    (simple({"layer[2].thickness": [1.0]}), "axes.layer[2].thickness: the scene has no layer[2].thickness"),
    (simple({"layer[1].phase": [1.0]}), 'layer[1].phase is "rayleigh", and only a number can be changed'),
    (simple({"layer[1].thicknes": [1.0]}), "unknown key; did you mean 'thickness'?"),
    (simple({ALBEDO: [0.5, 1.5]}), "axes.layer[1].albedo, value 2: layer[1].albedo must be between 0 and 1"),
    (simple({"brdf.mu_i": [0.5]}), "is the same for all scenes of a table"),
    (simple({"mu_o": {"key": ALBEDO, "values": [0.5]}}), "this name is taken by the table itself"),
    (simple({"a\\b": {"key": ALBEDO, "values": [0.5]}}), "cannot be the name of a coordinate: no /, no \\ and no"),
    (simple({"a": {"key": ALBEDO, "values": [True]}}), "must be a list of numbers"),
    (simple({"a": {"key": ALBEDO}}), "needs either values or start, stop and count"),
    (simple({"a": {"key": ALBEDO, "start": 0, "stop": 1}}), "axes.a.count: is missing"),
    (simple({"a": {"key": ALBEDO, "start": 0, "stop": 1, "count": 2, "spacing": "log"}}), "start and stop above"),
    (simple({"a": {"key": ALBEDO, "vlues": [1]}}), "did you mean 'values'?"),
    (
        simple({"layer[1:2].albedo": [0.5]}),
        'axes.layer[1:2].albedo: "layer[1:2].albedo": a range of layers must ascend, from 1',
    ),
    (simple({ALBEDO: [0.5], "a": {"key": "layer[1:1].albedo", "values": [0.5]}}), "two of them change the same"),
    (simple({ALBEDO: [0.5], "a": {"key": ALBEDO, "values": [0.5]}}), "two of them change the same"),
    (simple(LISTED | {"nodes": {"values": [2], "along": "sample"}}), "must have the same number of values"),
    (simple({ALBEDO: {"start": 0.4, "stop": 0.7, "count": 10**6}, "nodes": [*range(2, 2000)]}), "are too many"),
    (fields({"mu0": 0.6}), "field.mu is missing: all scenes of a table share their directions"),
    ({name: one for name, one in fields().items() if name != "field"}, "brdf is missing"),
    (simple({ALBEDO: [0.5]}, method="two-stream"), "a sweep is made by 'discrete-ordinates' alone"),
    (glossy({"layer[1].interface.below": [1.5, 20.0]}), "value 2: layer[1].interface.below must be"),
    (glossy({"layer[1].interface.roughness": [0.1, 0.0005]}), "layer[1].interface.roughness must be 0"),
    (glossy(GLOSSY, {"above": 1.0, "below": "water"}), 'is "water", and only a number can be changed'),
    (glossy({"base.index": [1.5, -1.0]}, **MIRROR), "value 2: base.index must be"),
    (glossy({"specular": {"key": "layer[2].thickness", "values": [1.0]}}), "is taken by the table itself"),
    (glossy({"layer[1].interface.below": [1.33, 1.5]}, **MEDIA), "index 1.33, and the interface above it has 1.5"),
]


OPTIONS = [
    ({"engine": "magic"}, "engine must be"),
    ({"scheduler": "tcp://x:1"}, "goes with engine 'dask' only"),
    ({"engine": "dask", "scheduler": "tcp://x:1", "workers": 1}, "leave one of the two out"),
    ({"precision": "single"}, "precision goes with engine 'opencl' only"),
    ({"chunk": 3}, "chunk must be a whole number from 1 to 2"),
    ({"workers": 0}, "workers must be a whole number"),
    ({"output": "table.csv"}, "must end in .zarr or .nc"),
    ({"output": "nowhere/table.nc"}, "lies in a folder that does not exist"),
]


def test_bad_sweeps_end_in_a_sentence_before_anything_is_computed() -> None:
    options = ((simple({ALBEDO: [0.5, 1.0]}), how, words) for how, words in OPTIONS)
    for content, how, words in (*((content, {}, words) for content, words in REFUSED), *options):
        with pytest.raises(SceneError) as caught:
            vrte.sweep(content, **how)
        assert words in str(caught.value)


def test_a_sweep_that_does_not_fit_on_the_disk_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _: types.SimpleNamespace(free=10**9))
    asked = {"mu_i": 0.5, "mu_o": {"start": 0.1, "stop": 1, "count": 100}, "phi_deg": list(range(360))}
    with pytest.raises(SceneError, match=r"300 scenes of 4\.61 MB make a table of 1\.38 GB, and .* room for 1 GB"):
        vrte.sweep(simple({ALBEDO: {"start": 0.0, "stop": 1.0, "count": 300}}, brdf=asked), tmp_path / "table.zarr")
    assert not list(tmp_path.iterdir())


def test_a_scene_that_fails_is_recorded_and_the_rest_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    axes = '"particles.gold.radius_um" = [0.05, 0.0]\nwavelength_um = [0.01, 0.6, 0.64]\n'  # gold is known from 0.19 um
    (tmp_path / "s.toml").write_text(POWDER + axes)
    with pytest.warns(SweepWarning, match="4 of 6 scenes failed; the first said: particles.gold"):
        table = vrte.sweep(tmp_path / "s.toml", tmp_path / "t.zarr").load()
    assert (table.error != "").values.tolist() == [[True, False, False], [True, True, True]]
    assert "0.01" in table.error.values[0, 0]
    assert "radius_um" in table.error.values[1, 1]
    for name in ("mueller", "reflectance"):
        assert (np.isnan(table[name].values.reshape(2, 3, -1)).all(axis=-1) == (table.error.values != "")).all()
        assert np.isfinite(table[name].values[0, 1:]).all()
    with pytest.raises(SceneError, match=r"a scene near the point has no result: .*0\.01"):
        vrte.interpolate(table.isel({"particles.gold.radius_um": 0}), {"wavelength_um": 0.62})
    arguments = "sweep", tmp_path / "s.toml", "-o", tmp_path / "t.zarr", "--workers", 1
    assert run(*arguments) == 0
    capsys.readouterr()
    assert run(*arguments, "--strict") == 1
    complaint = capsys.readouterr().err
    assert "4 of 6 scenes failed: particles.gold.radius_um = 0.05, wavelength_um = 0.01: particles.gold" in complaint
    assert (complaint.count("wavelength_um = 0."), complaint.count("\n")) == (3, 1)


def test_warnings_of_scenes_are_told_once_and_shown_as_before_afterwards() -> None:
    layer = {"particles": "gold", "thickness_um": 1.0, "volume_fraction": 0.1}
    axes = {"layer[1].volume_fraction": [0.05, 0.2, 0.3]}
    shown = warnings.showwarning
    with pytest.warns(SweepWarning) as reported:
        vrte.sweep(simple(axes, wavelength_um=0.6, particles=GOLD, layer=[layer]))
    assert len(reported) == 1
    assert "volume_fraction of 0.2" in str(reported[0].message)
    assert "and 1 more like it" in str(reported[0].message)
    assert warnings.showwarning is shown
    assert not [each for each in threading.enumerate() if each.name.startswith("vrte-sweep")]


def test_particles_are_kept_by_every_digit_of_their_sizes() -> None:
    sizes = [vrte.Lognormal(0.1, 1.3), vrte.Lognormal(0.1, np.nextafter(1.3, 2)), vrte.Gamma(0.1, 0.3)]
    given = {"index": "gold", "radius_um": 0.1, "wavelength_um": 0.64}
    assert len({store.make_file_name("spheres", {**given, "size": size}) for size in sizes}) == 3


def test_a_changed_sweep_is_refused(tmp_path: Path) -> None:
    table = "l,a1,a2,a3,a4,b1,b2\n0,1,0,0,0,0,0\n1,{},0,0,0,0,0\n"
    (tmp_path / "phase.csv").write_text(table.format(0.3))
    given, output = simple({ALBEDO: np.linspace(0, 1, 6)}), tmp_path / "table.zarr"
    given["layer"][0]["phase"] = str(tmp_path / "phase.csv")
    changed = copy.deepcopy(given)
    changed["layer"][0]["thickness"] = 2.0

    def stop(done: int, total: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        vrte.sweep(given, output, workers=1, chunk=1, progress=stop)
    with pytest.raises(SceneError, match=r"was begun with another sweep: layer\[1\].thickness changed"):
        vrte.sweep(changed, output)
    with pytest.raises(SceneError, match="chunk must be left as it was"):
        vrte.sweep(given, output, chunk=3)
    for name in (output, tmp_path / "table.nc"):
        vrte.sweep(given, name).close()
        with pytest.raises(SceneError, match=r"was made with another sweep: layer\[1\].thickness changed"):
            vrte.sweep(changed, name)
        vrte.sweep(given, name).close()
    (tmp_path / "phase.csv").write_text(table.format(0.4))
    with pytest.raises(SceneError, match=r"table .*phase\.csv changed"):
        vrte.sweep(given, output)
    (tmp_path / "other.zarr").mkdir()
    with pytest.raises(SceneError, match="is no table of a sweep"):
        vrte.sweep(given, tmp_path / "other.zarr")
    assert {path.name for path in tmp_path.iterdir()} == {"phase.csv", "table.zarr", "table.nc", "other.zarr"}


def test_an_output_has_one_process_and_a_system_with_locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given, output = simple({ALBEDO: [0.1, 1.0]}), tmp_path / "table.zarr"
    with store.lock_output(output), pytest.raises(SweepError, match=r"another process is at work on .*table\.zarr"):
        vrte.sweep(given, output)
    folder = tmp_path / "table.zarr.partial"  # what is left of a sweep that never began is no obstacle
    (folder / "table" / "mueller").mkdir(parents=True)
    (folder / "done").mkdir()
    (folder / "done" / "000000000").write_text("{}")
    assert np.isfinite(vrte.sweep(given, output).reflectance.values).all()
    assert not folder.exists()
    monkeypatch.setitem(sys.modules, "fcntl", None)  # Windows
    with pytest.raises(SweepError, match="sweeps need the file locks of Linux and macOS"):
        vrte.sweep(given, output)


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, output = tmp_path / "sweep.toml", tmp_path / "table.zarr"
    file.write_text(POWDER + AXES)
    assert run("sweep", file, "-o", output, "--workers", 1) == 0
    reported = capsys.readouterr()
    assert reported.err == ""
    assert "24 scenes (2 wavelength_um x 2 radius x 3 share x 2 base.albedo)" in reported.out
    assert f"wrote {output} (" in reported.out
    with open_table(output) as table:
        assert dict(table.error.sizes) == {"wavelength_um": 2, "radius": 2, "share": 3, "base.albedo": 2}
        assert_close(table.radius, [0.02, 0.08], rtol=1e-15, atol=0.0)
        assert table.radius.attrs == {"units": "um", "long_name": "particles.gold.radius_um"}


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """A Dask cluster somewhere else, of two workers with a thread each (here: in this process, to be quick)."""
    from distributed import LocalCluster

    how: dict[str, Any] = {"dashboard_address": ":0", "silence_logs": logging.CRITICAL}
    with warnings.catch_warnings(), LocalCluster(n_workers=2, threads_per_worker=1, processes=False, **how) as found:
        yield found


@pytest.mark.parametrize(
    "nodes", [{"nodes": 6}, pytest.param({"grading": 1}, marks=pytest.mark.slow)], ids=["6 nodes", "nodes by accuracy"]
)
def test_same_numbers_from_each_engine(nodes: dict[str, int], cluster: Any) -> None:
    given = powder(**nodes)
    sequential = vrte.sweep(given, workers=1, chunk=1)
    assert not (sequential.error != "").any()
    assert vrte.sweep(given, workers=2).equals(sequential)
    assert vrte.sweep(given, engine="dask", scheduler=cluster.scheduler_address).equals(sequential)
    assert gap(sequential, vrte.sweep(given, engine="opencl", chunk=4)) < SAME
    assert gap(sequential, vrte.sweep(given, workers=8, chunk=6)) < SAME  # orders and scenes share the cores


def test_clusters_that_are_not_there(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    from distributed import LocalCluster

    monkeypatch.setattr(engines, "WORKERS_PATIENCE", 0.5)
    given, how = powder(nodes=4), {"dashboard_address": ":0", "silence_logs": logging.CRITICAL}
    with pytest.raises(SweepError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9"):
        vrte.sweep(given, tmp_path / "t.zarr", engine="dask", scheduler="tcp://127.0.0.1:9")
    vrte.sweep(given, tmp_path / "t.zarr").close()  # and the output is nobody's
    with (
        LocalCluster(n_workers=0, processes=False, **how) as empty,
        pytest.raises(SweepError, match=r"had no worker for 0\.5 seconds"),
    ):
        vrte.sweep(given, engine="dask", scheduler=empty.scheduler_address)
    with pytest.raises(SweepError, match="the output must lie where all workers can read and write it"):
        engines.perform_there(str(tmp_path / "elsewhere"), "stamp", 0)


def listening() -> set[Any]:
    """Addresses where this process and its children wait for connections."""
    processes = [psutil.Process(), *psutil.Process().children(recursive=True)]
    return {each.laddr for process in processes for each in process.net_connections() if each.status == "LISTEN"}


def ask_plainly(index: Any) -> None:
    with closing(http.client.HTTPConnection(*index, timeout=0.5)) as plain:
        plain.request("GET", "/info/main/workers.html")
        plain.getresponse()


def test_the_cluster_of_a_sweep_is_for_nobody_else(tmp_path: Path) -> None:
    from distributed import Client, Security

    before = listening()  # that of other tests
    with engines.start_own_cluster(types.SimpleNamespace(folder=tmp_path), 1) as client:  # type: ignore[arg-type]
        assert client.submit(abs, -7).result() == 7
        address = client.scheduler.address
        sockets = listening() - before
        assert {index.ip for index in sockets} == {"127.0.0.1"}
        # without encryption, and with a certificate that anybody can make
        for strange, security in ((address.replace("tls:", "tcp:"), Security()), (address, Security.temporary())):
            with pytest.raises(OSError, match=r"reset|Timed out|SSL|certificate"):
                Client(strange, timeout=1.0, security=security)
        for index in sockets:  # and nothing but TLS is spoken
            with pytest.raises((OSError, http.client.HTTPException)):
                ask_plainly(index)
        assert client.submit(abs, -8).result() == 8


@pytest.fixture
def batches(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many scenes were solved together, batch by batch."""
    counts, solve = list[int](), brdfs.solve_batch

    def noted(*given: Any) -> Any:
        found = solve(*given)
        counts.append(len(found))
        return found

    monkeypatch.setattr(brdfs, "solve_batch", noted)
    return counts


def test_together_each_scene_is_as_by_itself(batches: list[int]) -> None:
    depths = {"layer[2].thickness": [0.4, 1.0, 2.0]}
    given = stacks(depths | {ALBEDO: [0.0, 0.7, 1.0], "base.albedo": [0.0, 0.4]})
    alone = vrte.sweep(given, workers=1, chunk=1)
    assert not batches
    together = vrte.sweep(given, workers=1, chunk=7)
    assert sum(batches) == 18
    assert vrte.sweep(given, workers=2, chunk=18).equals(together)
    assert together.equals(alone)
    batches.clear()
    asked = stacks({"nodes": [5, 6], "accuracy": [1e-8, 1e-6], ALBEDO: [0.3, 0.6, 0.9]})
    together = vrte.sweep(asked, workers=1, chunk=12)
    assert batches == [3, 3, 3, 3]
    assert together.equals(vrte.sweep(asked, workers=1, chunk=1))
    batches.clear()
    ends = stacks({ALBEDO: [0.5, 0.9], "layer[2].thickness": [0.5, 1.0, np.inf]})
    ends["brdf"] = ends["brdf"] | {"transmission": True}
    with pytest.warns(SweepWarning, match="2 of 6 scenes failed; the first said: brdf.transmission needs a finite"):
        table = vrte.sweep(ends, workers=1, chunk=6)
    assert batches == [4]
    assert (table.error != "").values.tolist() == [[False, False, True]] * 2


@pytest.mark.parametrize("engine", ["threads", "opencl"])
def test_one_that_fails_spoils_no_other(engine: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A batch, or a chunk on a device, in which a scene fails is solved scene by scene, and each says its own error."""
    depth = {"key": "layer[2].thickness", "values": [0.4, 0.7, 1.0]}
    given = stacks({"depth": depth, ALBEDO: [0.5, 0.9]})
    expected = vrte.sweep(given, workers=1, chunk=1)
    counts: list[int] = []

    def refuse(solve: Any, pick: Any, *given: Any) -> Any:
        requests = pick(*given)
        counts.append(len(requests))
        if any(one.scene.layers[1].thickness == 0.7 for one in requests):
            raise vrte.AccuracyError("not this one")
        return solve(*given)

    for module, name, pick in (
        (brdfs, "solve_batch", lambda requests, places, run: [requests[index] for index in places]),
        (chunks, "solve_request", lambda request, run: [request]),
        (chunks, "solve_together", lambda requests, *rest: requests),
    ):
        monkeypatch.setattr(module, name, partial(refuse, getattr(module, name), pick))
    with pytest.warns(SweepWarning, match="2 of 6 scenes failed; the first said: AccuracyError: not this one"):
        table = vrte.sweep(given, engine=engine, workers=1, chunk=6)
    assert counts == [6, 1, 1, 1, 1, 1, 1]
    assert (table.error.values[1] == "AccuracyError: not this one").all()
    rest = {"depth": [0, 2]}
    assert gap(expected.isel(rest), table.isel(rest)) <= (0.0 if engine == "threads" else SAME)


def test_the_flag_stops_a_batch() -> None:
    first, other = (vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo, 1.0)]) for albedo in (0.5, 0.9))
    request = make_brdf_request(first, MU[:2], MU, PHI, nodes=6, algorithm="direct")
    both = [request, brdfs.make_alike_request(request, other)]
    assert len(chunks.solve_alike_questions(both, np.zeros(1, np.int32))) == 2
    with pytest.raises(KeyboardInterrupt):
        chunks.make_processor_solver(lambda: 1, np.ones(1, np.int32))(both)


def sweep_slabs(depths: int, albedos: int, *more: Any, **how: Any) -> Any:
    """Rayleigh layers of many depths and albedos, over a Lambertian base."""
    axes = {
        "depth": {"key": "layer[1].thickness", "start": 0.05, "stop": 5, "count": depths, "spacing": "log"},
        "albedo": {"key": "layer[1].albedo", "start": 0.5, "stop": 1.0, "count": albedos},
    }
    base = {"kind": "lambertian", "albedo": 0.3}
    brdf = {"mu_i": [0.5, 1.0], "mu_o": [0.2, 0.6, 1.0], "phi_deg": [0, 60, 120, 180]}
    return vrte.sweep(simple(axes, nodes=6, base=base, brdf=brdf), *more, **how)


@pytest.fixture(scope="module")
def table() -> Any:
    return sweep_slabs(9, 5)


def test_at_a_scene_of_the_table_it_is_that_scene(table: Any) -> None:
    found = vrte.interpolate(table, {"depth": float(table.depth[3]), "albedo": float(table.albedo[1])})
    assert found.mueller.dims == ("mu_i", "mu_o", "phi_deg", "stokes_out", "stokes_in")
    assert_close(found.mueller, table.mueller[3, 1], rtol=1e-13, atol=1e-17)
    assert_close(found.reflectance, table.reflectance[3, 1], rtol=1e-13, atol=0.0)
    assert found.depth.item() == table.depth[3].item()
    some = vrte.interpolate(table, {"depth": 0.3, "phi_deg": 90.0})  # axes left out stay, and directions count too
    assert dict(some.mueller.sizes) == {"albedo": 5, "mu_i": 2, "mu_o": 3, "stokes_out": 4, "stokes_in": 4}
    both = vrte.interpolate(vrte.interpolate(table, {"depth": 0.3}), {"phi_deg": 90.0})
    assert_close(some.mueller, both.mueller, rtol=1e-10, atol=1e-16)
    deep = vrte.sweep(simple({"depth": {"key": "layer[1].thickness", "values": [1, 2, 4, 8, np.inf]}}))
    assert np.isfinite(vrte.interpolate(deep, {"depth": 7.0}).mueller.values).all()
    np.testing.assert_array_equal(vrte.interpolate(deep, {"depth": np.inf}).reflectance, deep.reflectance[-1])
    for here, point, words in (
        (deep, {"depth": 9.0}, "must lie between 1"),  # infinite depths are no neighbours
        (vrte.sweep(simple(LISTED)), {"thickness": 0.5}, "'thickness' is one of several along a list, not a grid"),
    ):
        with pytest.raises(SceneError, match=words):
            vrte.interpolate(here, point)


def test_an_error_that_is_measured_is_the_error(table: Any) -> None:
    found = held_out(table, 3, seed=4)
    for index in range(3):
        depth, albedo = found.points["depth"][index], found.points["albedo"][index]
        scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo, depth)], vrte.Lambertian(0.3))
        solved = vrte.brdf(scene, [0.5, 1.0], [0.2, 0.6, 1.0], [0, 60, 120, 180], nodes=6)
        guess = vrte.interpolate(table, {"depth": depth, "albedo": albedo}).mueller.values
        difference = np.abs(guess - solved.mueller).max() / np.abs(solved.mueller).max()
        assert_close(found.errors[index], difference, rtol=1e-6, atol=0.0)
        assert (guess[..., 0, 0] > 0.0).all()


@pytest.mark.slow
def test_only_scenes_nearby_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import zarr

    table, read, get = sweep_slabs(30, 5, tmp_path / "t.zarr", chunk=1), list[str](), zarr.storage.LocalStore.get
    note = lambda self, key, *rest, **more: read.append(key) or get(self, key, *rest, **more)  # noqa: E731
    monkeypatch.setattr(zarr.storage.LocalStore, "get", note)
    vrte.interpolate(table, {"depth": 1.23, "albedo": float(table.albedo[2])})
    assert len([key for key in read if key.startswith("mueller/c/")]) == 4


def test_bad_points_end_in_a_sentence(table: Any) -> None:
    for point, words in (
        ({"depth": 10.0}, "depth must lie between 0.05 and 5"),
        ({"radius": 1.0}, "'radius' is no axis of the table; there are depth, albedo, mu_i, mu_o, phi_deg"),
        ({"depth": "deep"}, "point: depth must be a number"),
        ({"depth": float("nan")}, "point: depth must be a number"),
        ([0.1], "point must be a dictionary"),
    ):
        with pytest.raises(SceneError, match=words):
            vrte.interpolate(table, point)


MEMORY = """
import resource, sys
import vrte
layer = {"phase": "isotropic", "albedo": 0.5, "thickness": 1.0}
cosines, around = {"start": 0.1, "stop": 1, "count": 50}, {"start": 0, "stop": 360, "count": 37}
scene = {"nodes": 2, "layer": [layer], "brdf": {"mu_i": cosines, "mu_o": cosines, "phi_deg": around}}
axes = {"layer[1].albedo": {"start": 0.1, "stop": 0.9, "count": int(sys.argv[1])}}
vrte.sweep({**scene, "axes": axes}, sys.argv[2], workers=1, chunk=2).close()
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""
CHUNK = 2 * 50 * 50 * 37 * 16 * 8 / 1024  # kilobytes


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["zarr", "nc"])
def test_memory_is_bounded_by_the_chunk_not_by_the_sweep(suffix: str, tmp_path: Path) -> None:
    few, many = (float(*printed_by(MEMORY, tmp_path, scenes, f"t{scenes}.{suffix}")) for scenes in (6, 46))
    assert many - few < 5.0 * CHUNK  # of 20 chunks more
