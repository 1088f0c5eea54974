"""Results as files: every digit comes back, and a file is either complete or not there."""

import csv
import errno
import json
import os
import pickle
import re
import stat
import sys
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.helpers import assert_same
from vrte import Brdf, Field, MissingExtraError, SceneError, Spectrum, load
from vrte.formats.atomic import write_atomically
from vrte.formats.contents import Result, to_xarray
from vrte.formats.csv_table import write_csv
from vrte.formats.result_file import FORMATS

AWKWARD = 0.1 + 0.2  # seventeen digits


@pytest.fixture
def brdf() -> Brdf:
    """Unsorted and repeated directions, odd numbers, transmission."""
    random = np.random.default_rng(1)
    shape = (2, 3, 4, 4, 4)
    return Brdf(
        mueller=random.normal(size=shape) * 1e-7,
        reflectance=[AWKWARD, 5e-324],
        mu_i=[1.0, 0.6],
        mu_o=[0.5, AWKWARD, 0.5],
        phi=[0.0, 360.0, -90.0, 0.0],
        diagnostics={"method": "discrete ordinates", "stages": {"modes": {"wall_seconds": 0.1}}},
        transmission=random.normal(size=shape),
        direct_transmittance=[0.0, 1e-300],
    )


@pytest.fixture
def field() -> Field:
    stokes = np.random.default_rng(2).normal(size=(2, 3, 2, 4))
    stokes[0, 0, 0] = [0.0, -0.0, np.nextafter(0.0, 1.0), AWKWARD]
    return Field(
        stokes=stokes,
        flux_up=[1.0, 2.0],
        flux_down=[3.0, AWKWARD],
        direct=[0.6, 0.0],
        tau=[1.0, 0.0],
        mu=[-0.5, 1e-8, -0.5],
        phi=[180.0, -720.5],
        mu0=0.6,
        incident_stokes=[np.pi, 0.0, 0.0, -1.0],
        diagnostics={"nodes": 40},
    )


@pytest.fixture
def spectrum(brdf: Brdf) -> Spectrum:
    """Two wavelengths of seventeen digits, each with diagnostics of its own."""
    other = replace(brdf, mueller=brdf.mueller * np.pi, diagnostics={"nodes": 8, "accuracy": AWKWARD})
    return Spectrum([AWKWARD, AWKWARD + 0.1], (brdf, other))


@pytest.fixture(params=["brdf", "field", "spectrum"])
def result(request: pytest.FixtureRequest) -> Result:
    return request.getfixturevalue(request.param)


@pytest.mark.parametrize("name", [*(f"result{suffix}" for suffix in FORMATS), "RESULT.CSV"])
def test_a_file_brings_back_every_bit(name: str, result: Result, tmp_path: Path) -> None:
    result.save(tmp_path / name)
    assert_same(result, load(tmp_path / name))
    assert [file.name for file in tmp_path.iterdir()] == [name]


class TestZarr:
    """What only a folder can be."""

    @pytest.fixture
    def folder(self, brdf: Brdf, tmp_path: Path) -> Path:
        brdf.save(tmp_path / "result.zarr")
        return tmp_path / "result.zarr"

    def test_any_reader_of_zarr_has_it_labelled(self, folder: Path, brdf: Brdf) -> None:
        import xarray

        with xarray.open_zarr(folder, consolidated=False) as found:
            np.testing.assert_array_equal(found.mueller.values, brdf.mueller)
            assert found.mueller.units == "sr-1"

    def test_a_copy_by_another_program_is_no_damage(self, folder: Path, brdf: Brdf) -> None:
        import xarray
        import zarr

        with xarray.open_zarr(folder, consolidated=False) as found, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # zarr has no words in its specification yet
            found.to_zarr(folder.with_name("copy.zarr"))
        assert_same(brdf, load(folder.with_name("copy.zarr")))
        values = zarr.open_group(folder)["reflectance"]
        values[...] = 0.5 * values[...]
        with pytest.raises(SceneError, match=r"result\.zarr: it is damaged: .*take its attribute sha256 away"):
            load(folder)

    def test_a_pipe_in_it_is_not_read(self, folder: Path) -> None:
        (folder / "mueller" / "zarr.json").unlink()
        os.mkfifo(folder / "mueller" / "zarr.json")  # whoever opens it waits for ever
        with pytest.raises(SceneError, match="something in it is a link, a pipe or a device"):
            load(folder)

    def test_it_takes_the_place_of_another_and_of_nothing_else(self, folder: Path, brdf: Brdf) -> None:
        brdf.save(folder)
        (folder.parent / "mine.zarr").mkdir()
        with pytest.raises(FileExistsError):
            brdf.save(folder.parent / "mine.zarr")
        assert sorted(file.name for file in folder.parent.iterdir()) == ["mine.zarr", "result.zarr"]

    def test_what_fails_leaves_the_folder_as_it_was(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        import xarray

        before = load(folder)
        monkeypatch.setattr(xarray.Dataset, "to_zarr", lambda *_, **__: (_ for _ in ()).throw(OSError(28, "full")))
        with pytest.raises(OSError, match="full"):
            before.save(folder)
        monkeypatch.undo()
        assert_same(before, load(folder))
        assert [file.name for file in folder.parent.iterdir()] == ["result.zarr"]

    @pytest.mark.parametrize(
        ("change", "said"),
        [
            (lambda about: about.update(zarr_format=2), "of Zarr format 2: only 3 is read"),
            (lambda about: about.update(shape=[10**6] * 5), "declares 8e\\+30 bytes of numbers"),
            (lambda about: about.update(data_type="object"), "must be plain numbers of 8 bytes, not object"),
            (lambda about: about["codecs"].append({"name": "numcodecs.pickle"}), "numcodecs.pickle"),
        ],
    )
    def test_only_plain_numbers_are_read(self, folder: Path, change: Callable[[Any], None], said: str) -> None:
        about = json.loads((folder / "mueller" / "zarr.json").read_text())
        change(about)
        (folder / "mueller" / "zarr.json").write_text(json.dumps(about))
        with pytest.raises(SceneError, match=said):
            load(folder)

    def test_nothing_leads_out_of_the_folder(self, folder: Path) -> None:
        (folder / "mueller" / "zarr.json").rename(folder.parent / "elsewhere.json")
        (folder / "mueller" / "zarr.json").symlink_to(folder.parent / "elsewhere.json")
        with pytest.raises(SceneError, match="something in it is a link"):
            load(folder)

    def test_a_part_that_is_gone_is_told(self, folder: Path) -> None:
        chunk = max((folder / "mueller").rglob("*"), key=lambda file: file.stat().st_size if file.is_file() else 0)
        chunk.unlink()
        with pytest.raises(SceneError, match=r"its mueller declares .* and parts of them are not there"):
            load(folder)


@pytest.mark.parametrize("name", ["result", "result.txt", "result.nc4"])
def test_another_ending_is_refused(name: str, result: Result, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"must end in \.nc, \.csv, \.zarr, not "):
        result.save(tmp_path / name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_brdf_without_transmission_comes_back_without(suffix: str, brdf: Brdf, tmp_path: Path) -> None:
    bare = Brdf(brdf.mueller, brdf.reflectance, brdf.mu_i, brdf.mu_o, brdf.phi, {})
    bare.save(tmp_path / f"bare{suffix}")
    assert_same(bare, load(tmp_path / f"bare{suffix}"))


def test_a_format_of_ones_own_is_a_row(brdf: Brdf, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def write(result: Result, path: Any) -> None:
        Path(path).write_bytes(pickle.dumps(result))

    monkeypatch.setitem(FORMATS, ".pickled", (write, lambda path, _: pickle.loads(Path(path).read_bytes())))
    brdf.save(tmp_path / "brdf.pickled")
    assert_same(brdf, load(tmp_path / "brdf.pickled"))


def test_pickle_keeps_arrays_read_only(result: Result) -> None:
    assert_same(result, pickle.loads(pickle.dumps(result)))


def test_results_own_their_arrays(brdf: Brdf) -> None:
    mine = np.zeros((1, 1, 1, 4, 4))
    made = Brdf(mine, [0.0], [1.0], [1.0], [0.0], {})
    mine[:] = 1.0
    assert not made.mueller.any()
    with pytest.raises(ValueError, match="read-only"):
        made.mueller[:] = 2.0
    with pytest.raises(AttributeError):
        made.mu_i = np.ones(1)  # type: ignore[misc]


def test_shapes_must_fit() -> None:
    with pytest.raises(SceneError, match=r"mueller must have the shape \(1, 2, 1, 4, 4\)"):
        Brdf(np.zeros((1, 1, 1, 4, 4)), [0.0], [1.0], [1.0, 0.5], [0.0], {})


def test_labels(brdf: Brdf, field: Field) -> None:
    dataset = to_xarray(brdf)
    assert dataset.mueller.dims == ("mu_i", "mu_o", "phi_deg", "stokes_out", "stokes_in")
    assert dataset.mueller.sel(stokes_out="Q", stokes_in="I")[0, 1, 2] == brdf.mueller[0, 1, 2, 1, 0]
    assert dataset.mueller.attrs["units"] == "sr-1"
    assert dataset.phi_deg.attrs["units"] == "degree"
    assert json.loads(dataset.attrs["diagnostics"]) == brdf.diagnostics
    assert dataset.attrs["source"].startswith("vrte ")
    assert "diffuse radiance out" in dataset.mueller.attrs["long_name"]
    assert "not in mueller" in dataset.attrs["comment"]  # what is mirrored
    labelled = field.to_xarray()
    assert labelled.stokes.dims == ("tau", "mu", "phi_deg", "stokes_parameter")
    assert labelled.incident_stokes.dims == ("stokes_parameter",)
    np.testing.assert_array_equal(labelled.sel(stokes_parameter="Q").stokes, field.stokes[..., 1])
    for array in [*dataset.data_vars.values(), *labelled.data_vars.values()]:
        assert {"units", "long_name"} <= set(array.attrs)


def test_a_data_set_is_a_copy(brdf: Brdf) -> None:
    dataset = brdf.to_xarray()
    dataset.mueller[:] = 0.0
    assert brdf.mueller.any()


def read_csv(path: Path) -> tuple[list[str], np.ndarray]:
    """The names and numbers below the lines that start with #, as any reader of CSV takes them."""
    with open(path, newline="") as file:
        header, *rows = csv.reader(line for line in file if not line.startswith("#"))
    return header, np.array(rows, dtype=float)


def test_csv_of_a_brdf(brdf: Brdf, tmp_path: Path) -> None:
    write_csv(brdf, tmp_path / "brdf.csv")
    header, rows = read_csv(tmp_path / "brdf.csv")
    elements = [f"{out}{into}" for out in range(4) for into in range(4)]
    assert header == ["mu_i", "mu_o", "phi_deg", *(f"f{e}" for e in elements), *(f"t{e}" for e in elements)]
    assert rows.shape == (24, 35)
    place = np.ravel_multi_index((1, 1, 2), (2, 3, 4))
    assert rows[place, :3].tolist() == [0.6, AWKWARD, -90.0]
    assert rows[:, 3:19].reshape(brdf.mueller.shape).tobytes() == brdf.mueller.tobytes()


def test_csv_of_a_field(field: Field, tmp_path: Path) -> None:
    write_csv(field, tmp_path / "field.csv")
    header, rows = read_csv(tmp_path / "field.csv")
    assert header == ["tau", "mu", "phi_deg", "I", "Q", "U", "V"]
    assert rows[:, 3:].reshape(field.stokes.shape).tobytes() == field.stokes.tobytes()
    assert rows[-1, :3].tolist() == [0.0, -0.5, -720.5]


@pytest.mark.parametrize("reason", [KeyboardInterrupt, OSError, SystemExit])
def test_an_interrupted_write_leaves_what_was_there(reason: type[BaseException], tmp_path: Path) -> None:
    target = tmp_path / "result.nc"
    target.write_text("before")

    def interrupted() -> Iterator[None]:
        with write_atomically(target) as part:
            part.write_text("half")
            yield

    writing = interrupted()
    next(writing)
    with pytest.raises(reason):
        writing.throw(reason())
    assert target.read_text() == "before"
    assert list(tmp_path.iterdir()) == [target]


def test_writing_through_a_link_keeps_the_link(field: Field, tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    target, link = tmp_path / "real" / "result.csv", tmp_path / "link.csv"
    link.symlink_to(target)
    write_csv(field, link)
    assert link.is_symlink()
    assert target.read_text().splitlines()[1].startswith("# vrte result")


@pytest.mark.parametrize("name", ["result.csv", "result.nc", "result.zarr"])
def test_only_files_are_replaced(name: str, brdf: Brdf, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / name)
    (tmp_path / "link").mkdir()
    (tmp_path / "link" / name).symlink_to("/dev/null")
    for target in (tmp_path / name, tmp_path / "link" / name):
        with pytest.raises(OSError, match=re.escape(str(target))) as caught:
            brdf.save(target)
        assert caught.value.filename == str(target)
    assert stat.S_ISFIFO(os.stat(tmp_path / name).st_mode)
    assert stat.S_ISCHR(os.stat(tmp_path / "link" / name).st_mode)
    assert len(list(tmp_path.rglob("*"))) == 3


@pytest.mark.parametrize("name", ["result.csv", "result.nc", "result.zarr"])
@pytest.mark.parametrize("fails", ["replace", "write"])
def test_every_error_of_the_disk_names_the_file(
    name: str, fails: str, brdf: Brdf, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*given: Any, **_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", *given[:1] if fails == "replace" else ())

    if fails == "replace":
        monkeypatch.setattr(os, "replace", fail)
    else:
        monkeypatch.setattr("vrte.formats.atomic.make_seal", fail)
        monkeypatch.setattr("vrte.formats.netcdf.make_seal", fail)
        monkeypatch.setattr("xarray.Dataset.to_zarr", fail)
    with pytest.raises(OSError, match="No space left") as caught:
        brdf.save(tmp_path / name)
    assert caught.value.filename == str(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_loading_something_else_says_so(tmp_path: Path) -> None:
    import xarray

    with pytest.raises(FileNotFoundError, match=r"absent\.nc"):
        load(tmp_path / "absent.nc")
    (tmp_path / "text.nc").write_text("not NetCDF")
    with pytest.raises(SceneError, match=r"text\.nc: it is not a NetCDF file"):
        load(tmp_path / "text.nc")
    xarray.Dataset({"mueller": ("x", [1.0])}).to_netcdf(tmp_path / "other.nc", engine="h5netcdf")
    with pytest.raises(SceneError, match=r"other\.nc: it must say its kind"):
        load(tmp_path / "other.nc")


@pytest.mark.parametrize("name", ["result.nc", "result.zarr"])
def test_an_extra_that_does_not_load_is_not_said_to_be_missing(
    name: str, brdf: Brdf, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def load_library(module: str) -> None:
        raise ImportError(f"/lib/{module}.so: failed to map segment from shared object")

    monkeypatch.setattr("vrte.basics.errors.import_module", load_library)
    words = r"the extra 'files', which is installed and cannot be loaded: /lib/.*\(there is too little memory"
    with pytest.raises(MissingExtraError, match=words) as caught:
        brdf.save(tmp_path / name)
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


@pytest.mark.parametrize("module", ["xarray", "h5netcdf"])
def test_a_missing_extra_is_one_sentence(
    module: str, brdf: Brdf, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingExtraError, match=r"needs the extra 'files': pip install 'vrte\[files\]'") as caught:
        brdf.save(tmp_path / "brdf.nc")
    assert "\n" not in str(caught.value)
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)
    assert not list(tmp_path.iterdir())
