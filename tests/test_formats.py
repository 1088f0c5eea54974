"""Results as files: every digit comes back from every format, and a file is either complete or not there."""

import errno
import json
import os
import pickle
import re
import stat
import sys
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from tests.helpers import assert_same
from vrte import Brdf, Field, MissingExtraError, SceneError, Spectrum
from vrte.formats import columns, result_file
from vrte.formats.atomic import write_atomically
from vrte.formats.contents import Result, convert_views, to_xarray
from vrte.formats.result_file import FORMATS
from vrte.optics.fresnel import reflect_smooth
from vrte.results.field import Views

AWKWARD = 0.1 + 0.2  # seventeen digits
RANDOM = np.random.default_rng(3)
SHAPE = (2, 3, 4, 4, 4)
NUMBERS = ("base.albedo", "layer[1].albedo")
BARE = Brdf(  # unsorted and repeated directions, odd numbers
    RANDOM.normal(size=SHAPE) * 1e-7,
    [AWKWARD, 5e-324],
    [1.0, 0.6],
    [0.5, AWKWARD, 0.5],
    [0.0, 360.0, -90.0, 0.0],
    {"method": "discrete ordinates", "stages": {"modes": {"wall_seconds": 0.1}}, "accuracy": AWKWARD},
)
GLOSSY = replace(BARE, specular=reflect_smooth(1.5, BARE.mu_i))
FULL = replace(
    GLOSSY,
    transmission=RANDOM.normal(size=SHAPE),
    direct_transmittance=[0.0, 1e-300],
    specular_transmission=RANDOM.normal(size=(2, 4, 4)),
    surface=RANDOM.normal(size=SHAPE),
    **{
        f"{name}jacobian": {number: RANDOM.normal(size=shape) for number in NUMBERS}
        for name, shape in (("", SHAPE), ("transmission_", SHAPE), ("specular_", (2, 4, 4)), ("reflectance_", (2,)))
    },
)
FLUXES = ("flux_up", "flux_down", "direct", "direct_up")
FIELD = Field(
    stokes=np.where(np.arange(48).reshape(2, 3, 2, 4) == 1, -0.0, RANDOM.normal(size=(2, 3, 2, 4))),
    **{name: RANDOM.normal(size=2) for name in FLUXES},
    tau=[1.0, 0.0],
    mu=[-0.5, 1e-8, -0.5],
    phi=[180.0, -720.5],
    mu0=0.6,
    incident_stokes=[np.pi, 0.0, 0.0, -1.0],
    diagnostics={"nodes": 40},
    index=[1.0, 1.0 / 3.0],
)
FIELDS = replace(
    FIELD,
    mu0=[0.5, 1.0],
    stokes=RANDOM.normal(size=(2, 2, 3, 2, 4)),
    **{name: RANDOM.normal(size=(2, 2)) for name in FLUXES},
    jacobian={number: RANDOM.normal(size=(2, 2, 3, 2, 4)) for number in NUMBERS},
    flux_up_jacobian={number: RANDOM.normal(size=(2, 2)) for number in NUMBERS},
)
TEXTS = [replace(GLOSSY, diagnostics={"scene_toml": text}) for text in ("a", "b", 100_000 * "é\n")]
RESULTS: dict[str, Result] = {
    "bare": BARE,
    "full": FULL,
    "long texts": replace(TEXTS[2], diagnostics=TEXTS[2].diagnostics | {"note": 100_000 * "x"}),
    "field": FIELD,
    "fields": FIELDS,
    "bare field": replace(FIELD, index=None, direct_up=None),
    "fluxes alone": replace(FIELD, mu=[], stokes=np.zeros((2, 0, 2, 4))),
    "spectrum": Spectrum([AWKWARD, 0.6], (FULL, replace(FULL, specular=0.5 * FULL.specular[:], diagnostics={"n": 8}))),
    "texts of wavelengths": Spectrum([0.5, 0.6], TEXTS[:2]),
    "one text": Spectrum([0.5, 0.6], [TEXTS[0], TEXTS[0]]),
}


@pytest.mark.parametrize("result", RESULTS.values(), ids=list(RESULTS))
@pytest.mark.parametrize("suffix", FORMATS)
def test_a_file_brings_back_every_bit(suffix: str, result: Result, tmp_path: Path) -> None:
    """And what was read makes the same bytes again."""
    names = [f"result{suffix}", f"AGAIN{suffix.upper()}"][: 1 + (result in (FULL, FIELDS))]
    for name in names:
        result.save(tmp_path / name)
        found = vrte.load(tmp_path / name)
        assert_same(result, found)
        result = found
    assert sorted(file.name for file in tmp_path.iterdir()) == sorted(names)
    if suffix != ".zarr":
        assert len({file.read_bytes() for file in tmp_path.iterdir()}) == 1
    assert_same(result, pickle.loads(pickle.dumps(result)))


def test_labels() -> None:
    """Every array says what it is, and how it is laid out."""
    for result in RESULTS.values():
        dataset = to_xarray(result)
        for name, array in dataset.variables.items():
            assert array.attrs["long_name"], name
            assert array.dtype.kind != "f" or array.attrs["units"], name
        assert {"title", "source", "comment", "diagnostics"} <= {*dataset.attrs}
    dataset[next(iter(dataset.data_vars))][:] = 0.0  # of a copy
    assert result.mueller.any()
    found, field, fields = (to_xarray(RESULTS[name]) for name in ("spectrum", "field", "fields"))
    mueller = ("wavelength_um", "mu_i", "mu_o", "phi_deg", "stokes_out", "stokes_in")
    assert found.mueller.dims == found.surface.dims == mueller
    assert found.specular.dims == ("wavelength_um", "mu_i", "stokes_out", "stokes_in")
    assert found.mueller.sel(stokes_out="Q", stokes_in="I")[0, 0, 1, 2] == FULL.mueller[0, 1, 2, 1, 0]
    assert found.jacobian.sel(parameter=NUMBERS[1])[0, 1, 2, 3, 0, 1] == FULL.jacobian[NUMBERS[1]][1, 2, 3, 0, 1]  # type: ignore[index]
    assert (found.mueller.units, found.phi_deg.units) == ("sr-1", "degree")
    assert found.wavelength_um.standard_name == "radiation_wavelength"
    np.testing.assert_array_equal(found.specular_reflectance[0], reflect_smooth(1.5, FULL.mu_i)[:, 0, 0])
    np.testing.assert_array_equal(found.total_reflectance, found.reflectance + found.specular_reflectance)
    assert {*to_xarray(BARE).data_vars} == {"mueller", "reflectance"}  # no more than there is
    assert not {"index", "direct_up"} & {*to_xarray(RESULTS["bare field"]).variables}
    assert field.stokes.dims == ("tau", "mu", "phi_deg", "stokes_parameter")
    np.testing.assert_array_equal(field.sel(stokes_parameter="Q").stokes, FIELD.stokes[..., 1])
    assert (fields.direct_up.dims, fields["index"].dims, fields.attrs["kind"]) == (("mu0", "tau"), ("tau",), "fields")
    # coordinates out of order are not by CF's conventions
    assert "Conventions" not in field.attrs
    assert to_xarray(replace(FIELD, mu=[-0.5, 0.1, 0.5])).attrs["Conventions"] == "CF-1.11"
    views = Views(np.ones((2, 4)), *np.full((3, 2), 0.5), 1.0, np.ones(4), {}, 1.5)
    assert convert_views(views)["index"].item() == 1.5
    assert "index" not in convert_views(replace(views, index=None)).variables


def test_results_own_their_arrays() -> None:
    mine = np.zeros((1, 1, 1, 4, 4))
    made = Brdf(mine, [0.0], [1.0], [1.0], [0.0], {})
    mine[:] = 1.0
    assert not made.mueller.any()
    with pytest.raises(SceneError, match=r"mueller must have the shape \(1, 2, 1, 4, 4\)"):
        Brdf(mine, [0.0], [1.0], [1.0, 0.5], [0.0], {})


def test_other_programs_read_the_files(tmp_path: Path) -> None:
    import h5py
    import pandas
    import xarray

    spectrum = RESULTS["spectrum"]
    for suffix in FORMATS:
        spectrum.save(tmp_path / f"result{suffix}")
    rows = pandas.read_csv(tmp_path / "result.csv", comment="#", dtype=str).astype(float)  # its own are exact since 3.1
    elements = [f"{out}{into}" for out in range(4) for into in range(4)]
    numbered = [f"d{number}_{letter}{element}" for letter in "ft" for number in (1, 2) for element in elements]
    axes = ["wavelength_um", "mu_i", "mu_o", "phi_deg"]
    assert [*rows] == [*axes, *(letter + element for letter in "fts" for element in elements), *numbered]
    for name, values in (("f00", spectrum.mueller[..., 0, 0]), ("t10", spectrum.transmission[..., 1, 0])):
        np.testing.assert_array_equal(rows[name], values.ravel())
    np.testing.assert_array_equal(rows["d2_f31"], spectrum.jacobian[NUMBERS[1]][..., 3, 1].ravel())
    np.testing.assert_array_equal(rows["phi_deg"].iloc[:5], [0.0, 360.0, -90.0, 0.0, 0.0])
    header = [line for line in (tmp_path / "result.csv").read_text().splitlines() if line.startswith("#")]
    for words in ("[sr-1]: BRDF, Mueller matrix", "columns f00 .. f33", "wavelength_um (2) [um]", "vrte 0"):
        assert any(words in line for line in header), words
    with h5py.File(tmp_path / "result.nc") as file:
        assert not any("_FillValue" in one.attrs for one in file.values())  # no number stands for nothing
        # the same result makes the same bytes whatever the hour
        assert not any(one.id.get_create_plist().get_obj_track_times() for one in file.values())
    with xarray.open_zarr(tmp_path / "result.zarr", consolidated=False) as found, warnings.catch_warnings():
        np.testing.assert_array_equal(found.mueller.values, spectrum.mueller)
        assert found.mueller.units == "sr-1"
        warnings.simplefilter("ignore")  # zarr has no words in its specification yet
        found.to_zarr(tmp_path / "copy.zarr")
    assert_same(spectrum, vrte.load(tmp_path / "copy.zarr"))  # a copy by another program is no damage


def swapped(before: str, after: str) -> Callable[[str], str]:
    return lambda text: text.replace(before, after)


ONE = Brdf(np.ones((2, 2, 2, 4, 4)), [0.1, 0.2], [0.6, 1.0], [0.2, 0.5], [0.0, 90.0], {})
PAIR = Spectrum([0.45, 0.6], [ONE, ONE])
SECOND = "\n0.45,0.6,0.2,90.0,"


@pytest.fixture
def table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """As a program leaves it that knows nothing of the checksum: without the first line; and little is too long."""
    monkeypatch.setattr(columns, "LONGEST_LINE", 9_000)
    monkeypatch.setattr(result_file, "LARGEST_HEADER", 20_000)
    PAIR.save(tmp_path / "pair.csv")
    (tmp_path / "pair.csv").write_text((tmp_path / "pair.csv").read_text().partition("\n")[2])
    assert_same(PAIR, vrte.load(tmp_path / "pair.csv"))
    return tmp_path / "pair.csv"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda text: text[2:], "line 1: not a result that vrte can read back"),
        (swapped("# kind", "# \udcff"), r"line \d+: not a text file in UTF-8"),
        (swapped("# kind = ", "# king = "), "must say its kind, one of brdf, field, fields, spectrum"),
        (swapped('"spectrum"', '"spectrum"\n# derivatives = [1]'), "its derivatives must be a list of different names"),
        (swapped("# mu_o = [", "# mu_o = [["), r"line 16: mu_o cannot be read \(JSONDecodeError"),
        (swapped("# mu_o = [0.2, 0.5]", "# mu_o = 0.2"), "the header has no list for mu_o"),
        (
            swapped("# mu_o = [0.2, 0.5]", "# mu_o = [0.3, 0.5]"),
            r"line 20: the row must be for \[0.45, 0.6, 0.3, 0.0\]",
        ),
        (swapped("# reflectance", "# reflection"), "reflectance"),
        (swapped(",f00,", ",f0,"), "line 19: the columns must be wavelength_um,mu_i"),
        (swapped(SECOND, f"{SECOND[:-1]};"), "line 21: 20 numbers are needed .*from 20 to 19"),
        (swapped(SECOND, SECOND.replace("2", "2x")), "line 21: 20 numbers are needed .*convert string '0.2x'"),
        (lambda text: text[:-1], "there must be 16 rows, one a direction, not 15"),
        (lambda text: text[: text.rindex("\n0.6")] + "\n\n", "there must be 16 rows of 20 numbers, not 15 of 20"),
        (swapped("# diagnostics = [{", "# diagnostics = [{}, {"), "diagnostics for each wavelength"),
        (swapped("# title", f"# {'x' * 10_000}"), r"line \d+: longer than 9000 bytes"),
        (swapped("# title", f"# {'x' * 8_000}\n" * 3 + "# title"), "the header is longer than 20000 bytes"),
    ],
)
def test_a_damaged_table_says_where(change: Callable[[str], str], words: str, table: Path) -> None:
    changed = change(table.read_text())
    assert changed != table.read_text()
    table.write_text(changed, errors="surrogateescape")
    with pytest.raises(SceneError, match=words) as caught:
        vrte.load(table)
    assert str(caught.value).startswith(f"{table}")
    assert str(caught.value).isprintable()


def test_any_damage_to_a_table_ends_in_one_sentence_or_a_result(table: Path) -> None:
    text, reported = table.read_text(), []
    cut = [text[:end] for end in np.linspace(0, len(text) - 1, 60).astype(int)]
    indices, signs = RANDOM.integers(len(text), size=150), RANDOM.choice(list('x9-,\n#"[]{}'), 150)
    spoilt = [text[:index] + sign + text[index + 1 :] for index, sign in zip(indices, signs, strict=True)]
    for number, damaged in enumerate([*cut, *spoilt]):
        table.write_text(damaged)
        try:
            vrte.load(table)
            assert number >= len(cut)  # any cut is noticed
        except SceneError as error:
            reported.append(str(error))
    assert len(reported) > len(cut) + 40
    assert all(words.isprintable() for words in reported)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    BARE.save(tmp_path / "result.zarr")
    return tmp_path / "result.zarr"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda about: about.update(zarr_format=2), "of Zarr format 2: only 3 is read"),
        (lambda about: about.update(shape=[2, 3, 4, 4, 5]), "declares 3840 bytes of numbers, and parts .* not there"),
        (lambda about: about.update(data_type="object"), "must be plain numbers of 8 bytes, not object"),
        (lambda about: about["codecs"].append({"name": "numcodecs.pickle"}), "numcodecs.pickle"),
        (lambda about: about.update(note="x" * 10_000), "its zarr.json is longer than 10000 bytes"),
        (lambda about: about.clear(), "holds no BRDF, field or spectrum written by vrte: KeyError"),
    ],
)
def test_only_plain_numbers_are_read(
    folder: Path, change: Callable[[Any], None], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(result_file, "LARGEST_TEXT", 10_000)
    about = json.loads((folder / "mueller" / "zarr.json").read_text())
    change(about)
    (folder / "mueller" / "zarr.json").write_text(json.dumps(about))
    with pytest.raises(SceneError, match=words) as caught:
        vrte.load(folder)
    assert str(caught.value).startswith(str(folder))


def test_nothing_leads_out_of_the_folder(folder: Path) -> None:
    """No link, no pipe; numbers that were changed, or are gone, are told; no folder of others is replaced."""
    import zarr

    values = zarr.open_group(folder)["reflectance"]
    values[...] = 0.5 * values[...]
    about, elsewhere = folder / "mueller" / "zarr.json", folder.parent / "elsewhere.json"
    for act, words in (
        (lambda: None, r"result\.zarr: it is damaged: .*take its attribute sha256 away"),
        (lambda: about.rename(elsewhere), "holds no BRDF, field or spectrum written by vrte: FileNotFoundError"),
        (lambda: about.symlink_to(elsewhere), "something in it is a link, a pipe or a device"),
        (lambda: (about.unlink(), os.mkfifo(about)), "something in it is a link, a pipe or a device"),
    ):
        act()  # type: ignore[no-untyped-call]
        with pytest.raises(SceneError, match=words):
            vrte.load(folder)
    FIELD.save(folder)
    assert_same(FIELD, vrte.load(folder))
    (folder.parent / "mine.zarr").mkdir()
    with pytest.raises(FileExistsError):
        BARE.save(folder.parent / "mine.zarr")
    assert {file.name for file in folder.parent.iterdir()} == {"mine.zarr", "result.zarr", "elsewhere.json"}


@pytest.mark.parametrize("reason", [KeyboardInterrupt, OSError])
@pytest.mark.parametrize("late", [False, True])
def test_an_interrupted_write_leaves_what_was_there(
    reason: type[BaseException], late: bool, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before the new file is complete, and between its two renames where it is a folder."""
    replace_file = os.replace

    def fail(*names: Path) -> None:
        if ".part" in str(names[0]):
            monkeypatch.undo()
            raise reason
        replace_file(*names)

    def write() -> None:
        with write_atomically(folder, "zarr.json") as part:
            part.mkdir()
            if not late:
                raise reason
            monkeypatch.setattr(os, "replace", fail)

    with pytest.raises(reason):
        write()
    assert_same(BARE, vrte.load(folder))
    assert [*folder.parent.iterdir()] == [folder]


@pytest.mark.parametrize("suffix", FORMATS)
def test_only_files_are_replaced_and_every_error_names_the_file(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = f"result{suffix}"
    os.mkfifo(tmp_path / name)
    (tmp_path / "link").mkdir()
    (tmp_path / "link" / name).symlink_to("/dev/null")
    for target in (tmp_path / name, tmp_path / "link" / name, tmp_path / "none" / name, tmp_path / name / name):
        with pytest.raises(OSError, match=re.escape(str(target))) as caught:
            BARE.save(target)
        assert caught.value.filename == str(target)
    assert stat.S_ISFIFO(os.stat(tmp_path / name).st_mode)
    assert stat.S_ISCHR(os.stat(tmp_path / "link" / name).st_mode)
    assert len(list(tmp_path.rglob("*"))) == 3
    (tmp_path / name).unlink()
    (tmp_path / "link" / name).unlink()
    (tmp_path / "link" / name).symlink_to(tmp_path / name)
    BARE.save(tmp_path / "link" / name)  # through a link, which stays one
    assert (tmp_path / "link" / name).is_symlink()
    before = vrte.load(tmp_path / name)

    def fail(*given: Any, **_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", *given[:1] if isinstance(given[0], Path) else ())

    written = {".nc": "vrte.formats.netcdf.make_seal", ".csv": "vrte.formats.atomic.make_seal"}
    for function in ("os.replace", written.get(suffix, "xarray.Dataset.to_zarr")):
        with monkeypatch.context() as patch:
            patch.setattr(function, fail)
            with pytest.raises(OSError, match="No space left") as caught:
                FIELD.save(tmp_path / name)
        assert caught.value.filename == str(tmp_path / name)
        assert sorted(file.name for file in tmp_path.iterdir()) == ["link", name]
        assert_same(before, vrte.load(tmp_path / name))


def test_what_is_no_result_is_refused(tmp_path: Path) -> None:
    import xarray

    (tmp_path / "text.nc").write_text("not NetCDF")
    xarray.Dataset({"mueller": ("x", [1.0])}).to_netcdf(tmp_path / "other.nc", engine="h5netcdf")
    there = {*tmp_path.iterdir()}
    diagnostics: Any = {"nodes": {1, 2}}
    for act, words in (
        *((lambda name=name: FIELD.save(tmp_path / name), r"in \.nc, \.csv, \.zarr, not ") for name in ("a", "a.nc4")),
        *((lambda name=name: vrte.load(name), "path must be the name of a file, not ") for name in ("a\0b.nc", "")),
        (lambda: to_xarray(3), "a result must be a Brdf, a Field or a Spectrum, not int"),  # type: ignore[arg-type]
        (lambda: replace(BARE, diagnostics=diagnostics).save(tmp_path / "set.csv"), "what JSON can hold: TypeError"),
        (lambda: vrte.load(tmp_path / "text.nc"), r"text\.nc: it is not a NetCDF file"),
        (lambda: vrte.load(tmp_path / "other.nc"), r"other\.nc: it must say its kind"),
    ):
        with pytest.raises(SceneError, match=words):
            act()
    for suffix in FORMATS:
        with pytest.raises(FileNotFoundError, match=rf"absent\{suffix}"):
            vrte.load(tmp_path / f"absent{suffix}")
    assert {*tmp_path.iterdir()} == there


@pytest.mark.parametrize("breaks", [False, True])
def test_a_missing_extra_is_one_sentence(breaks: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that is there and does not load is not said to be missing."""

    def load_library(module: str) -> None:
        raise ImportError(f"/lib/{module}.so: failed to map segment from shared object")

    words = r"needs the extra 'files': pip install 'vrte\[files\]'"
    for name in ("zarr", "h5netcdf"):
        monkeypatch.setitem(sys.modules, name, None)
    if breaks:
        monkeypatch.setattr("vrte.basics.errors.import_module", load_library)
        words = r"the extra 'files', which is installed and cannot be loaded: /lib/.*\(there is too little memory"
    for suffix in (".nc", ".zarr"):
        with pytest.raises(MissingExtraError, match=words) as caught:
            BARE.save(tmp_path / f"result{suffix}")
        assert "\n" not in str(caught.value)
        assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)
    assert not list(tmp_path.iterdir())
