"""Sweeps: files, axes, tables, and what is computed once."""

import copy
import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
import types
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray

import vrte
from tests.helpers import run, wait_until
from vrte.basics.errors import SceneError, SweepError
from vrte.formats.particle_sources import make_particles
from vrte.sweep import optics, store
from vrte.sweep.engines import Cores
from vrte.sweep.run import SweepWarning
from vrte.sweep.table import Grid, cut_grid
from vrte.sweep.template import read_sweep

from .helpers import assert_close

POWDER = """
nodes = 4
wavelength_um = 0.64
[particles.gold]
index = "gold"
radius_um = 0.05
[particles.glass]
index = [1.5, 0.0]
radius_um = 0.05
[[layer]]
particles = { gold = 0.5, glass = 0.5 }
thickness = 1.0
[base]
kind = "lambertian"
albedo = 0.2
[brdf]
mu_i = [0.6, 1.0]
mu_o = [0.3, 0.8]
phi_deg = [0, 90, 180]
"""
AXES = """
[axes]
wavelength_um = [0.5, 0.64]
radius = { key = "particles.gold.radius_um", start = 0.02, stop = 0.08, count = 2, spacing = "log" }
share = { key = "layer[1].particles.gold", values = [0, 0.25, 1] }
"base.albedo" = { start = 0, stop = 1, count = 2 }
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "sweep.toml"
    path.write_text(POWDER + AXES)
    return path


def simple(axes: dict[str, Any], **more: Any) -> dict[str, Any]:
    """A sweep of one Rayleigh layer, a millisecond a scene."""
    layer = {"phase": "rayleigh", "albedo": 0.9, "thickness": 1.0}
    return {"nodes": 3, "layer": [layer], "brdf": {"mu_i": 0.6, "mu_o": [0.5, 1.0]}, "axes": axes} | more


def test_a_table_holds_the_brdf_of_each_scene(file: Path) -> None:
    table = vrte.sweep(file, workers=1)
    assert dict(table.error.sizes) == {"wavelength_um": 2, "radius": 2, "share": 3, "base.albedo": 2}
    assert_close(table.radius, [0.02, 0.08], rtol=1e-15, atol=0.0)
    assert table.radius.attrs == {"units": "um", "long_name": "particles.gold.radius_um"}
    assert not (table.error != "").any()
    for wavelength, radius, share, albedo in itertools.product((0.5, 0.64), (0.02, 0.08), (0.0, 0.25, 1.0), (0.0, 1.0)):
        gold = vrte.spheres("gold", radius_um=radius, wavelength_um=wavelength)
        glass = vrte.spheres((1.5, 0.0), radius_um=0.05, wavelength_um=wavelength)
        both = vrte.mixture([(gold, share), (glass, 0.5)])
        scene = vrte.Scene([vrte.Layer.of(both, 1.0)], vrte.Lambertian(albedo))
        alone = vrte.brdf(scene, [0.6, 1.0], [0.3, 0.8], [0, 90, 180], nodes=4)
        place = {"wavelength_um": wavelength, "radius": radius, "share": share, "base.albedo": albedo}
        here = table.sel(place, method="nearest")
        assert_close(here.mueller, alone.mueller, rtol=0.0, atol=1e-13 * np.abs(alone.mueller).max())
        assert_close(here.reflectance, alone.reflectance, rtol=1e-12, atol=0.0)
        assert_close(here.direct_transmittance, alone.direct_transmittance, rtol=1e-15, atol=0.0)
    assert json.loads(table.attrs["sweep"])["axes"]["radius"]["key"] == "particles.gold.radius_um"


def test_zarr_netcdf_and_memory_hold_the_same(tmp_path: Path) -> None:
    axes = {"depth": {"key": "layer[1].thickness", "values": [0.1, 1, np.inf]}, "layer[1].albedo": [0.5, 1.0]}
    given = simple(axes)
    memory = vrte.sweep(given)
    for name in ("table.zarr", "table.nc"):
        with vrte.sweep(given, tmp_path / name, chunk=2) as table:
            assert table.load().equals(memory)
    assert {path.name for path in tmp_path.iterdir()} == {"table.zarr", "table.nc"}
    # as anybody opens them
    with xarray.open_dataset(tmp_path / "table.nc", engine="h5netcdf") as plain:
        np.testing.assert_array_equal(plain.mueller, memory.mueller)
        assert plain.mueller.attrs["units"] == "sr-1"
    plain = xarray.open_zarr(tmp_path / "table.zarr", chunks=None)
    np.testing.assert_array_equal(plain.mueller.sel(stokes_out="I", stokes_in="Q"), memory.mueller[..., 0, 1])


def test_axes_that_go_together_make_a_list() -> None:
    axes = {
        "depth": {"key": "layer[1].thickness", "values": [0.1, 1.0, 2.0], "along": "sample"},
        "albedo": {"key": "layer[1].albedo", "values": [0.3, 0.6, 1.0], "along": "sample"},
    }
    table = vrte.sweep(simple(axes))
    assert dict(table.reflectance.sizes) == {"sample": 3, "mu_i": 1}
    assert table.depth.dims == table.albedo.dims == ("sample",)
    grid = vrte.sweep(simple({name: {k: v for k, v in axis.items() if k != "along"} for name, axis in axes.items()}))
    for place in range(3):
        np.testing.assert_array_equal(table.mueller[place], grid.mueller[place, place])


def test_a_sweep_goes_by_the_algorithm_of_a_brdf() -> None:
    # modes lose digits of the fluxes of thin layers: 1e-12 of thickness leaves four
    depths = [1e-12, 1e-8, 1e-6, 1e-4, 1.0]
    table = vrte.sweep(simple({"layer[1].thickness": depths}))
    for place, depth in enumerate(depths):
        alone = vrte.brdf(vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, depth)]), 0.6, [0.5, 1.0], nodes=3)
        np.testing.assert_array_equal(table.mueller.values[place], alone.mueller)
        np.testing.assert_array_equal(table.reflectance.values[place], alone.reflectance)


def test_transmission_and_sizes_and_phases_are_swept(tmp_path: Path) -> None:
    axes = {
        "sigma": {"key": "particles.dust.size.lognormal.sigma", "values": [1.2, 1.5]},
        "absorption": {"key": "particles.dust.index[2]", "values": [0.0, 0.1]},
        "g": {"key": "layer[2].phase.henyey_greenstein", "values": [0.0, 0.5]},
        "nodes": [3, 4],
    }
    dust = {"index": [1.5, 0.0], "size": {"lognormal": {"median_um": 0.05, "sigma": 1.2}}}
    layers = [
        {"particles": "dust", "thickness": 1.0},
        {"phase": {"henyey_greenstein": 0.1, "terms": 6}, "albedo": 0.9, "thickness": 0.5},
    ]
    given = {
        "wavelength_um": 0.6,
        "nodes": 3,
        "particles": {"dust": dust},
        "layer": layers,
        "brdf": {"mu_i": 0.6, "mu_o": [0.5, 1.0], "transmission": True},
    }
    table = vrte.sweep({**given, "axes": axes})
    assert not (table.error != "").any()
    particles = vrte.spheres((1.5, 0.1), size=vrte.Lognormal(0.05, 1.5), wavelength_um=0.6)
    below = vrte.Layer(vrte.henyey_greenstein(0.5, 6), 0.9, 0.5)
    alone = vrte.brdf(vrte.Scene([vrte.Layer.of(particles, 1.0), below]), 0.6, [0.5, 1.0], nodes=4, transmission=True)
    here = table.sel(sigma=1.5, absorption=0.1, g=0.5, nodes=4)
    assert alone.transmission is not None
    assert_close(here.mueller, alone.mueller, rtol=0.0, atol=1e-13)
    assert_close(here.transmission, alone.transmission, rtol=0.0, atol=1e-13)


ALBEDO = "layer[1].albedo"


@pytest.mark.parametrize(
    ("axes", "words"),
    [
        ({}, "axes is missing"),
        ({"layer[2].thickness": [1.0]}, "axes.layer[2].thickness: the scene has no layer[2].thickness"),
        ({"layer[0].thickness": [1.0]}, "is no key of a scene"),
        ({"layer[1].phase": [1.0]}, 'layer[1].phase is "rayleigh", and only a number can be changed'),
        ({"layer[1].thicknes": [1.0]}, "unknown key; did you mean 'thickness'?"),
        ({"layer[1].albedo": [0.5, 1.5]}, "axes.layer[1].albedo, value 2: layer[1].albedo must be between 0 and 1"),
        ({"brdf.mu_i": [0.5]}, "is the same for all scenes of a table"),
        ({"mu_o": {"key": "layer[1].albedo", "values": [0.5]}}, "this name is taken by the table itself"),
        ({"a/b": {"key": "layer[1].albedo", "values": [0.5]}}, "cannot be the name of a coordinate"),
        (
            {"a\\b": {"key": "layer[1].albedo", "values": [0.5]}},
            "cannot be the name of a coordinate: no /, no \\ and no",
        ),
        ({"a": {"key": "layer[1].albedo", "values": []}}, "must be a list of numbers"),
        ({"a": {"key": "layer[1].albedo", "values": [True]}}, "must be a list of numbers"),
        ({"a": {"key": "layer[1].albedo"}}, "needs either values or start, stop and count"),
        ({"a": {"key": "layer[1].albedo", "start": 0, "stop": 1}}, "axes.a.count: is missing"),
        ({"a": {"key": ALBEDO, "start": 0, "stop": 1, "count": 2, "spacing": "log"}}, "start and stop above"),
        ({"a": {"key": "layer[1].albedo", "vlues": [1]}}, "did you mean 'values'?"),
        ({"layer[1].albedo": [0.5], "a": {"key": "layer[1].albedo", "values": [0.5]}}, "two of them change the same"),
        (
            {ALBEDO: {"values": [0.5], "along": "s"}, "layer[1].thickness": {"values": [1, 2], "along": "s"}},
            "must have the same number of values",
        ),
        ({"wavelength_um": {"start": 0.4, "stop": 0.7, "count": 10**6}, "nodes": list(range(2, 2000))}, "are too many"),
    ],
)
def test_bad_axes_end_in_a_sentence(axes: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError) as caught:
        read_sweep(simple(axes))
    assert words in str(caught.value)


def test_options_that_do_not_fit() -> None:
    given = simple({"layer[1].albedo": [0.5, 1.0]})
    for how, words in (
        ({"engine": "magic"}, "engine must be"),
        ({"scheduler": "tcp://x:1"}, "goes with engine 'dask' only"),
        ({"engine": "dask", "scheduler": "tcp://x:1", "workers": 1}, "leave one of the two out"),
        ({"chunk": 3}, "chunk must be a whole number from 1 to 2"),
        ({"workers": 0}, "workers must be a whole number"),
        ({"output": "table.csv"}, "must end in .zarr or .nc"),
    ):
        with pytest.raises(SceneError, match=words):
            vrte.sweep(given, **how)  # type: ignore[arg-type]


def test_the_lit_side_of_the_file_is_kept_and_other_methods_are_refused() -> None:
    layers = [{"phase": "rayleigh", "albedo": albedo, "thickness": 1.0} for albedo in (0.9, 0.5)]
    content = {"nodes": 6, "layer": layers, "brdf": {"mu_i": 0.5, "mu_o": 0.3}, "axes": {"layer[1].thickness": [1.0]}}
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo, 1.0) for albedo in (0.9, 0.5)])
    below = vrte.brdf(scene, 0.5, 0.3, nodes=6, illuminate="bottom")
    table = vrte.sweep({**content, "illuminate": "bottom"})
    np.testing.assert_array_equal(table.mueller.values[0], below.mueller)
    with pytest.raises(SceneError, match="a sweep is made by 'discrete-ordinates' alone"):
        vrte.sweep({**content, "method": "two-stream"})


def test_a_sweep_that_does_not_fit_on_the_disk_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _: types.SimpleNamespace(free=10**9))
    given = simple({"layer[1].albedo": {"start": 0.0, "stop": 1.0, "count": 300}})
    given["brdf"] = {"mu_i": 0.5, "mu_o": {"start": 0.1, "stop": 1, "count": 100}, "phi_deg": list(range(360))}
    with pytest.raises(SceneError, match=r"300 scenes of 4\.61 MB make a table of 1\.38 GB, and .* room for 1 GB"):
        vrte.sweep(given, tmp_path / "table.zarr")
    assert not list(tmp_path.iterdir())


def test_a_scene_that_fails_is_recorded_and_the_rest_goes_on(tmp_path: Path) -> None:
    # 0.01 um is outside the data of gold; radius 0 is no radius
    given = simple(
        {"wavelength_um": [0.01, 0.64], "r": {"key": "particles.gold.radius_um", "values": [0.05, 0.0]}},
        particles={"gold": {"index": "gold", "radius_um": 0.1}},
        layer=[{"particles": "gold", "thickness": 1.0}],
    )
    with pytest.warns(SweepWarning, match="3 of 4 scenes failed; the first said: particles.gold"):
        table = vrte.sweep(given, tmp_path / "table.zarr")
    table.load()
    assert table.error.values[1, 0] == ""
    assert "0.01" in table.error.values[0, 0]
    assert "radius_um" in table.error.values[1, 1]
    assert np.isfinite(table.mueller.values[1, 0]).all()
    assert np.isnan(table.mueller.values[0]).all()
    assert np.isnan(table.reflectance.values[1, 1]).all()


def test_warnings_of_scenes_are_told_once(tmp_path: Path) -> None:
    given = simple(
        {"layer[1].volume_fraction": [0.05, 0.2, 0.3]},
        wavelength_um=0.6,
        particles={"gold": {"index": "gold", "radius_um": 0.05}},
        layer=[{"particles": "gold", "thickness_um": 1.0, "volume_fraction": 0.1}],
    )
    with pytest.warns(SweepWarning) as told:
        vrte.sweep(given)
    assert len(told) == 1
    assert "volume_fraction of 0.2" in str(told[0].message)
    assert "and 1 more like it" in str(told[0].message)


def test_optics_are_computed_once_for_each_particle_and_wavelength(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[Any, ...]] = []

    def counted(source: str, given: dict[str, Any]) -> vrte.Particles:
        asked.append((source, *given.values()))
        return make_particles(source, given)

    monkeypatch.setattr(optics, "make_particles", counted)
    vrte.sweep(file, workers=2, chunk=1)
    # gold: 2 wavelengths x 2 radii, glass: 2 wavelengths; of 24 scenes
    assert len(asked) == len(set(asked)) == 4 + 2


def test_particles_kept_on_disk_are_the_same(tmp_path: Path) -> None:
    known = optics.Optics(tmp_path)
    gold = vrte.spheres("gold", radius_um=0.1, wavelength_um=0.64)
    given = {"index": "gold", "radius_um": 0.1, "wavelength_um": 0.64}
    kept = known.keep("spheres", given)
    again = optics.Optics(tmp_path)("spheres", given)
    for found in (kept, again):
        np.testing.assert_array_equal(found.phase_matrix.coefficients, gold.phase_matrix.coefficients)
        for name in (*optics.NUMBERS, "description"):
            assert getattr(found, name) == getattr(gold, name)
    assert [path.suffix for path in sorted(tmp_path.iterdir())] == ["", ".lock"]
    sizes = [vrte.Lognormal(0.1, 1.3), vrte.Lognormal(0.1, np.nextafter(1.3, 2)), vrte.Gamma(0.1, 0.3)]
    names = {
        optics.make_file_name("spheres", {"index": (1.5, 0.0), "size": size, "wavelength_um": 0.6}) for size in sizes
    }
    assert len(names) == 3


def test_boxes_cover_the_grid_once() -> None:
    for shape in ((7,), (3, 10), (2, 3, 5), (1, 1), (4, 1, 6)):
        for most in (1, 2, 3, 4, 7, 16, 1000):
            grid = cut_grid(shape, most)
            places = [place for chunk in range(grid.chunks) for place in grid.places(chunk)]
            assert sorted(places) == list(np.ndindex(*shape))
            assert max(len(list(grid.places(chunk))) for chunk in range(grid.chunks)) <= most
    assert Grid((2, 5), (1, 3)).extent(1) == (1, 2)


def test_cores_are_shared_and_never_used_twice() -> None:
    cores = Cores(8, 3)
    assert cores.share() == 2
    cores.leave()
    assert cores.share() == 4
    cores.leave()
    assert cores.share() == 8
    assert Cores(2, 2).share() == 1


def test_progress_counts_scenes(tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    vrte.sweep(
        simple({"layer[1].albedo": [0.1, 0.2, 0.3, 0.4, 0.5]}),
        workers=1,
        chunk=2,
        progress=lambda *given: told.append(given),
    )
    assert told == [(0, 5), (2, 5), (4, 5), (5, 5)]


class StoppedError(Exception):
    """What a test interrupts a sweep with."""


def stop_after(scenes: int) -> Any:
    def progress(done: int, total: int) -> None:
        if done >= scenes:
            raise StoppedError

    return progress


def test_what_is_done_is_not_done_again(tmp_path: Path) -> None:
    given, output = simple({"layer[1].albedo": np.linspace(0, 1, 12)}), tmp_path / "table.zarr"
    with pytest.raises(StoppedError):
        vrte.sweep(given, output, workers=1, chunk=2, progress=stop_after(6))
    assert not output.exists()
    folder = tmp_path / "table.zarr.partial"
    os.link(folder / "log.txt", tmp_path / "log")
    before = store.read_work(folder).done()
    assert {0, 1, 2} <= before < set(range(6))
    told: list[int] = []
    table = vrte.sweep(given, output, workers=1, progress=lambda done, _: told.append(done))
    assert told[0] == 2 * len(before)
    begun = [int(line.split()[1]) for line in (tmp_path / "log").read_text().splitlines() if line.startswith("begin")]
    assert not before & set(begun[len(before) + 1 :])
    assert table.load().equals(vrte.sweep(given))
    assert not folder.exists()
    # and once complete, it is only opened
    told.clear()
    assert vrte.sweep(given, output, progress=lambda done, _: told.append(done)).load().equals(table)
    assert told == []
    assert not folder.exists()


def test_a_changed_sweep_is_refused(tmp_path: Path) -> None:
    given, output = simple({"layer[1].albedo": np.linspace(0, 1, 6)}), tmp_path / "table.zarr"
    changed = copy.deepcopy(given)
    changed["layer"][0]["thickness"] = 2.0
    with pytest.raises(StoppedError):
        vrte.sweep(given, output, workers=1, chunk=1, progress=stop_after(2))
    with pytest.raises(SceneError, match=r"was begun with another sweep: layer\[1\].thickness changed"):
        vrte.sweep(changed, output)
    with pytest.raises(SceneError, match="chunk must be left as it was"):
        vrte.sweep(given, output, chunk=3)
    for name in (output, tmp_path / "table.nc"):
        vrte.sweep(given, name).close()
        with pytest.raises(SceneError, match=r"was made with another sweep: layer\[1\].thickness changed"):
            vrte.sweep(changed, name)
        vrte.sweep(given, name).close()
    (tmp_path / "other.zarr").mkdir()
    with pytest.raises(SceneError, match="is no table of a sweep"):
        vrte.sweep(given, tmp_path / "other.zarr")
    assert {path.name for path in tmp_path.iterdir()} == {"table.zarr", "table.nc", "other.zarr"}


def test_a_changed_table_of_coefficients_is_noticed(tmp_path: Path) -> None:
    table = "l,a1,a2,a3,a4,b1,b2\n0,1,0,0,0,0,0\n1,{},0,0,0,0,0\n"
    (tmp_path / "phase.csv").write_text(table.format(0.3))
    given = simple({"layer[1].albedo": [0.1, 1.0]})
    given["layer"][0]["phase"] = "phase.csv"
    layer = "[[layer]]\nphase = 'phase.csv'\nalbedo = 1\nthickness = 1\n"
    (tmp_path / "s.toml").write_text(
        f"nodes = 3\n{layer}[brdf]\nmu_i = 0.5\nmu_o = 0.5\n[axes]\n'layer[1].albedo' = [0.1, 1]"
    )
    vrte.sweep(tmp_path / "s.toml", tmp_path / "t.zarr").close()
    (tmp_path / "phase.csv").write_text(table.format(0.4))
    with pytest.raises(SceneError, match=r"table phase\.csv changed"):
        vrte.sweep(tmp_path / "s.toml", tmp_path / "t.zarr")


def test_a_second_process_at_the_same_output_is_refused(tmp_path: Path) -> None:
    given, output = simple({"layer[1].albedo": [0.1, 1.0]}), tmp_path / "table.zarr"
    with store.lock_output(output), pytest.raises(SweepError, match=r"another process is at work on .*table\.zarr"):
        vrte.sweep(given, output)
    vrte.sweep(given, output).close()


def test_a_system_without_file_locks_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "fcntl", None)  # Windows
    with pytest.raises(SweepError, match="sweeps need the file locks of Linux and macOS"):
        vrte.sweep(simple({"layer[1].albedo": [0.1, 1.0]}), tmp_path / "table.zarr")


def test_what_is_left_of_a_sweep_that_never_began_is_no_obstacle(tmp_path: Path) -> None:
    folder = tmp_path / "table.zarr.partial"
    (folder / "table" / "mueller").mkdir(parents=True)
    (folder / "done").mkdir()
    (folder / "done" / "000000000").write_text("{}")
    given = simple({"layer[1].albedo": [0.1, 1.0]})
    assert np.isfinite(vrte.sweep(given, tmp_path / "table.zarr").reflectance.values).all()
    assert not folder.exists()


def test_the_command(file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "table.zarr"
    assert run("sweep", file, "-o", output, "--workers", 1) == 0
    told = capsys.readouterr()
    assert told.err == ""
    assert "24 scenes (2 wavelength_um x 2 radius x 3 share x 2 base.albedo)" in told.out
    assert f"wrote {output} (" in told.out
    assert run("sweep", file, "-o", output) == 0
    for arguments, code, words in (
        ((file, "-o", tmp_path / "t.csv"), 2, "must end in .zarr or .nc"),
        ((tmp_path / "none.toml", "-o", output), 1, "No such file"),
        ((file, "-o", output, "--engine", "magic"), 2, "invalid choice"),
        ((file, "-o", output, "--scheduler", "tcp://a:1"), 2, "goes with engine 'dask' only"),
    ):
        capsys.readouterr()
        assert run("sweep", *arguments) == code
        complaint = capsys.readouterr().err
        assert words in complaint
        assert complaint.count("\n") == 1


def test_strict_names_the_scenes_that_failed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = POWDER + '[axes]\n"particles.gold.radius_um" = [0.05, 0.0]\nwavelength_um = [0.5, 0.6, 0.64]\n'
    (tmp_path / "s.toml").write_text(lines)
    arguments = "sweep", tmp_path / "s.toml", "-o", tmp_path / "t.zarr", "--workers", 1
    assert run(*arguments) == 0
    capsys.readouterr()
    assert run(*arguments, "--strict") == 1
    complaint = capsys.readouterr().err
    assert (
        "3 of 6 scenes failed: particles.gold.radius_um = 0, wavelength_um = 0.5: particles.gold.radius_um" in complaint
    )
    assert complaint.count("wavelength_um = 0.") == 3
    assert complaint.count("\n") == 1


def test_interrupted_it_ends_at_once_and_leaves_what_is_done(tmp_path: Path) -> None:
    count = 2000
    layer = "[[layer]]\nphase = 'rayleigh'\nalbedo = 1\nthickness = 1\n[brdf]\nmu_i = 0.5\nmu_o = 0.5\n"
    lines = f'nodes = 4\n{layer}[axes]\n"layer[1].albedo" = {{ start = 0, stop = 1, count = {count} }}\n'
    (tmp_path / "s.toml").write_text(lines)
    command = [sys.executable, "-m", "vrte.cli", "sweep", str(tmp_path / "s.toml"), "-o", str(tmp_path / "t.zarr")]
    process = subprocess.Popen(
        [*command, "--chunk", "2"], stderr=subprocess.PIPE, text=True, cwd=Path(__file__).parents[1]
    )
    done = tmp_path / "t.zarr.partial" / "done"
    wait_until(lambda: done.is_dir() and len(list(done.iterdir())) > 3)
    process.send_signal(signal.SIGINT)
    start = time.monotonic()
    _, complaint = process.communicate(timeout=20)
    assert time.monotonic() - start < 5.0
    assert process.returncode == 130
    assert complaint == "vrte: error: interrupted\n"
    assert 3 < len(list(done.iterdir())) < count // 2


def test_warnings_are_as_before_afterwards() -> None:
    shown = warnings.showwarning
    threads = threading.active_count()
    vrte.sweep(simple({"layer[1].albedo": [0.1, 1.0]}))
    assert warnings.showwarning is shown
    wait_until(lambda: threading.active_count() <= threads + 2, 5.0)
