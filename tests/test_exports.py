"""Spectra, and files that others read: names by CF, headers of CSV, and what becomes of damaged ones."""

import json
import re
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from tests.helpers import assert_same, run
from vrte import SceneError, Spectrum
from vrte.formats import contents
from vrte.formats.contents import to_xarray

from .helpers import assert_close, close_to

PAINT: dict[str, Any] = {
    "nodes": 6,
    "particles": {"gold": {"index": "gold", "radius_um": 0.1}},
    "layer": [{"particles": "gold", "thickness": 1.0}],
    "brdf": {"mu_i": [0.6, 1.0], "mu_o": [0.2, 0.5], "phi_deg": [0.0, 90.0], "transmission": True},
}
WAVELENGTHS = [0.45, 0.6]
TOML = """
nodes = 6
[particles.gold]
index = "gold"
radius_um = 0.1
[[layer]]
particles = "gold"  # ein Anstrich, prêt-à-porter
thickness = 1.0
[brdf]
mu_i = [0.6, 1.0]
mu_o = [0.2, 0.5]
phi_deg = [0, 90]
transmission = true
"""


@pytest.fixture(scope="module")
def paint() -> Spectrum:
    return vrte.spectrum(PAINT, WAVELENGTHS)


@pytest.fixture(scope="module")
def field() -> vrte.Field:
    layer = vrte.Layer(vrte.rayleigh(), 0.9, 1.0)
    return vrte.radiance(vrte.Scene([layer]), 0.6, tau=[0.0, 1.0], mu=[-0.5, 0.5], nodes=4)


@pytest.fixture(params=["brdf", "field", "spectrum"])
def result(request: pytest.FixtureRequest, paint: Spectrum, field: vrte.Field) -> contents.Result:
    return {"brdf": paint[0], "field": field, "spectrum": paint}[request.param]


class TestSpectrum:
    def test_each_wavelength_is_that_of_its_own_particles(self, paint: Spectrum) -> None:
        for wavelength, one in zip(WAVELENGTHS, paint, strict=True):
            gold = vrte.spheres("gold", radius_um=0.1, wavelength_um=wavelength)
            scene = vrte.Scene([vrte.Layer.of(gold, thickness=1.0)])
            alone = vrte.brdf(scene, [0.6, 1.0], [0.2, 0.5], [0, 90], nodes=6, transmission=True)
            np.testing.assert_array_equal(one.mueller, alone.mueller)
        assert paint.mueller.shape == (2, 2, 2, 2, 4, 4)
        assert paint.reflectance[1, 0] > 1.5 * paint.reflectance[0, 0]
        np.testing.assert_array_equal(paint.transmission[1], paint[1].transmission)

    def test_a_file_and_its_text(self, paint: Spectrum, tmp_path: Path) -> None:
        (tmp_path / "paint.toml").write_text(TOML, encoding="utf-8")
        found = vrte.spectrum(tmp_path / "paint.toml", WAVELENGTHS)
        np.testing.assert_array_equal(found.mueller, paint.mueller)
        assert all(one.diagnostics["scene_toml"] == TOML for one in found)
        for name in ("paint.nc", "paint.csv"):
            found.save(tmp_path / name)
            assert_same(found, vrte.load(tmp_path / name))
        assert to_xarray(found).attrs["scene_toml"] == TOML

    def test_keywords_win_over_the_file(self, paint: Spectrum) -> None:
        found = vrte.spectrum(PAINT, [0.5], mu_o=1.0, transmission=False, method="single-scattering")
        assert found.mu_o.tolist() == [1.0]
        assert found.transmission is None
        assert found[0].diagnostics["method"] == "single-scattering"
        with_settings = {**PAINT, "method": "successive-orders", "settings": {"largest_orders": 3}}
        assert vrte.spectrum(with_settings, [0.5], method="single-scattering", transmission=False).mu_o.size == 2

    def test_progress_goes_up_to_the_end(self) -> None:
        told: list[tuple[int, int]] = []
        vrte.spectrum(PAINT, WAVELENGTHS, progress=lambda done, total: told.append((done, total)))
        assert {total for _, total in told} == {400}
        assert [done for done, _ in told] == sorted(done for done, _ in told)
        assert told[-1] == (400, 400)

    def test_a_part_of_it(self, paint: Spectrum) -> None:
        part = paint.at([0.6])
        assert_same(part[0], paint[1])
        with pytest.raises(SceneError, match=r"0\.5 um is none of the spectrum's: the next is at 0\.45 um"):
            paint.at([0.5])

    @pytest.mark.parametrize("wavelengths", [[], [0.5, 0.5], [0.6, 0.5], [-0.5, 0.5], [0.0], [np.nan], "red", [[0.5]]])
    def test_bad_wavelengths(self, wavelengths: Any) -> None:
        with pytest.raises(SceneError, match="wavelength_um must be"):
            vrte.spectrum(PAINT, wavelengths)

    def test_complaints_name_the_wavelength_or_the_key(self) -> None:
        with pytest.raises(SceneError, match=r"^at 99 um: particles\.gold\.index: "):
            vrte.spectrum(PAINT, [0.5, 99.0])
        with pytest.raises(SceneError, match=r"^brdf\.mu_i must satisfy"):
            vrte.spectrum(PAINT, [0.5], mu_i=2.0)

    def test_brdfs_must_fit_together(self, paint: Spectrum) -> None:
        one = paint[0]
        bottom = replace(one, diagnostics={"illuminate": "bottom"})
        for others, words in (
            ((one,), "one a wavelength, 2, not 1"),
            ((one, 3), "must be a vrte.Brdf"),
            ((one, replace(one, phi=[0.0, 91.0])), "phi differs"),
            ((one, replace(one, transmission=None)), "must all have transmission"),
            ((one, bottom), "same side"),
        ):
            with pytest.raises(SceneError, match=words):
                Spectrum(WAVELENGTHS, others)  # type: ignore[arg-type]

    @pytest.mark.slow
    def test_a_device_gets_all_of_them_together(self, paint: Spectrum, opencl: Any) -> None:
        found = vrte.spectrum(PAINT, WAVELENGTHS, backend="opencl")
        assert "device" in found[0].diagnostics
        assert_close(found.mueller, paint.mueller, rtol=0.0, atol=1e-13)


def test_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = (Path(__file__).parents[1] / "docs" / "how_to" / "exports.md").read_text(encoding="utf-8")
    (block, *_) = re.findall(r"^```python\n(import vrte.*?)^```", page, re.MULTILINE | re.DOTALL)
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    exec(compile(block, "exports.md", "exec"), names)
    assert len(vrte.load("gold.nc")) == 3
    names["s"].save("gold.csv")
    shown = re.search(r"^0\.45,0\.6,0\.2,0\.0,([\d.]+)", page, re.MULTILINE)
    assert shown
    assert vrte.load("gold.csv").mueller[0, 0, 0, 0, 0, 0] == close_to(float(shown[1]), rtol=1e-6, atol=0.0)


class TestNetcdf:
    def test_attributes_are_those_of_cf(self, result: contents.Result) -> None:
        dataset = to_xarray(result)
        assert dataset.attrs["Conventions"] == "CF-1.11"
        assert {"title", "source", "comment", "diagnostics"} <= set(dataset.attrs)
        numbers = [array for array in dataset.variables.values() if array.dtype.kind == "f"]
        assert all({"units", "long_name"} <= set(array.attrs) for array in numbers)
        if isinstance(result, Spectrum):
            assert dataset["wavelength_um"].attrs["standard_name"] == "radiation_wavelength"

    def test_coordinates_out_of_order_are_not_by_the_conventions(self, paint: Spectrum) -> None:
        assert "Conventions" not in to_xarray(replace(paint[0], phi=[90.0, 90.0])).attrs

    def test_no_number_stands_for_nothing(self, result: contents.Result, tmp_path: Path) -> None:
        import h5py

        result.save(tmp_path / "result.nc")
        with h5py.File(tmp_path / "result.nc") as file:
            assert not [name for name in file if "_FillValue" in file[name].attrs]

    @pytest.mark.parametrize("name", ["result.nc", "result.csv"])
    def test_the_same_result_makes_the_same_bytes(self, name: str, result: contents.Result, tmp_path: Path) -> None:
        result.save(tmp_path / name)
        before = (tmp_path / name).read_bytes()
        vrte.load(tmp_path / name).save(tmp_path / name)
        assert (tmp_path / name).read_bytes() == before

    def test_the_hour_is_not_in_the_bytes(self, field: vrte.Field, tmp_path: Path) -> None:
        field.save(tmp_path / "field.nc")
        time.sleep(1.0 - time.time() % 1.0)  # HDF5 keeps whole seconds, where it keeps any
        field.save(tmp_path / "later.nc")
        assert (tmp_path / "later.nc").read_bytes() == (tmp_path / "field.nc").read_bytes()

    @pytest.mark.parametrize("name", ["told.nc", "told.csv"])
    def test_texts_long_and_of_each_wavelength(self, name: str, paint: Spectrum, tmp_path: Path) -> None:
        long = replace(paint[0], diagnostics={"scene_toml": 100_000 * "é\n", "note": 100_000 * "x"})
        each = (replace(one, diagnostics={"scene_toml": text}) for one, text in zip(paint, "ab", strict=True))
        for told in (long, Spectrum(WAVELENGTHS, tuple(each))):
            told.save(tmp_path / name)
            assert_same(told, vrte.load(tmp_path / name))

    def test_a_file_that_is_cut_off(self, paint: Spectrum, tmp_path: Path) -> None:
        paint.save(tmp_path / "whole.nc")
        content = (tmp_path / "whole.nc").read_bytes()
        for share in (0.0, 0.3, 0.99):  # each but the first is read by a process of its own
            (tmp_path / "cut.nc").write_bytes(content[: int(share * len(content))])
            with pytest.raises(SceneError, match=r"cut\.nc"):
                vrte.load(tmp_path / "cut.nc")


def swapped(before: str, after: str) -> Callable[[str], str]:
    return lambda text: text.replace(before, after)


class TestCsv:
    @pytest.fixture
    def table(self, paint: Spectrum, tmp_path: Path) -> Path:
        """As a program leaves it that knows nothing of the checksum: without the first line."""
        path = tmp_path / "paint.csv"
        paint.save(path)
        path.write_text(path.read_text().partition("\n")[2])
        return path

    def test_the_header_says_what_the_columns_are(self, table: Path) -> None:
        header = [line for line in table.read_text().splitlines() if line.startswith("#")]
        for words in (
            "[sr-1]: BRDF, Mueller matrix",
            "columns f00 .. f33",
            "wavelength_um (2) [um]",
            "vrte 0",
        ):
            assert any(words in line for line in header), words

    def test_pandas_reads_the_rows(self, table: Path, paint: Spectrum) -> None:
        import pandas

        rows = pandas.read_csv(table, comment="#", dtype=str).astype(float)  # pandas' own numbers are exact since 3.1
        np.testing.assert_array_equal(rows["f00"], paint.mueller[..., 0, 0].ravel())
        np.testing.assert_array_equal(rows["t10"], paint.transmission[..., 1, 0].ravel())
        assert sorted(set(rows["wavelength_um"])) == WAVELENGTHS

    @pytest.mark.parametrize(
        ("change", "words"),
        [
            (lambda text: text[2:], "line 1: not a result that vrte can read back"),
            (swapped("# kind = ", "# king = "), "must say its kind, one of brdf, field, fields, spectrum"),
            (swapped("# mu_o = [", "# mu_o = [["), r"line 18: mu_o cannot be read .JSONDecodeError"),
            (swapped("# mu_o = [0.2, ", '# mu_o = ["0.2x", '), "line 18: mu_o cannot be read .ValueError"),
            (swapped("# mu_o = [0.2, 0.5]", "# mu_o = 0.2"), "the header has no list for mu_o"),
            (swapped("# mu_o = [0.2, 0.5]", "# mu_o = [0.3, 0.5]"), r"line 23: the row must be for"),
            (swapped("# mu_o = [0.2, 0.5]", "# mu_o = [0.2]"), "there must be 8 rows.*not 16"),
            (swapped("# reflectance", "# reflection"), "the header has no line for 'reflectance'|reflectance"),
            (swapped(",f00,", ",f0,"), r"line 22: the columns must be wavelength_um,mu_i"),
            (swapped("\n0.45,0.6,0.2,90.0,", "\n0.45,0.6,0.2,90.0;"), "line 24: 36 numbers are needed, not 35"),
            (swapped("\n0.45,0.6,0.2,90.0,", "\n0.45,0.6,0.2x,90.0,"), r"line 24: '0.45,0.6.*not a number"),
            (swapped("\n0.45,0.6,0.2,90.0,", "\n0.45,0.6,0.2,90.0,1,"), "line 24: 36 numbers are needed, not 37"),
            (lambda text: text[:-1], "there must be 16 rows, one a direction, not 15"),
            (lambda text: text[: text.rindex("\n0.6")] + "\n", "there must be 16 rows, one a direction, not 15"),
            (swapped("# diagnostics = [{", "# diagnostics = [{}, {"), "diagnostics for each wavelength"),
            (swapped("# wavelength_um = [0.45, 0.6]", "# wavelength_um = [1e999, 0.6]"), "line 23: the row"),
        ],
    )
    def test_a_damaged_table_says_where(self, change: Callable[[str], str], words: str, table: Path) -> None:
        path = table.with_name("damaged.csv")
        path.write_text(change(table.read_text()))
        assert path.read_text() != table.read_text()
        with pytest.raises(SceneError, match=words) as caught:
            vrte.load(path)
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)

    def test_any_cut_is_noticed(self, table: Path) -> None:
        text = table.read_text()
        for end in np.linspace(0, len(text) - 1, 150).astype(int):
            table.write_text(text[:end])
            with pytest.raises(SceneError):
                vrte.load(table)

    def test_any_damage_ends_in_one_sentence_or_a_result(self, table: Path) -> None:
        random, text = np.random.default_rng(4), table.read_text()
        places, signs = random.integers(len(text), size=200), random.choice(list('x9-,\n#"[]{}'), 200)
        told = []
        for place, sign in zip(places, signs, strict=True):
            table.write_text(text[:place] + sign + text[place + 1 :])
            try:
                vrte.load(table)
            except SceneError as error:
                told.append(str(error))
        assert len(told) > 50
        assert not any("\n" in message for message in told)

    def test_a_table_of_another_program(self, tmp_path: Path) -> None:
        (tmp_path / "other.csv").write_text("tau,mu\n1,2\n")
        with pytest.raises(SceneError, match=r"other\.csv: line 1: not a result"):
            vrte.load(tmp_path / "other.csv")
        (tmp_path / "bytes.csv").write_bytes(b"# vrte result, format 1\n\xff\xfe\n")
        with pytest.raises(SceneError, match=r"bytes\.csv: line 2: not a text file"):
            vrte.load(tmp_path / "bytes.csv")
        with pytest.raises(FileNotFoundError, match=r"absent\.csv"):
            vrte.load(tmp_path / "absent.csv")

    def test_fluxes_alone(self, tmp_path: Path) -> None:
        layer = vrte.Layer(vrte.rayleigh(), 0.9, 1.0)
        fluxes = vrte.radiance(vrte.Scene([layer]), 0.6, tau=[0.0, 1.0], mu=[], nodes=4)
        fluxes.save(tmp_path / "fluxes.csv")
        assert_same(fluxes, vrte.load(tmp_path / "fluxes.csv"))

    def test_diagnostics_are_json(self, table: Path) -> None:
        (line,) = [line for line in table.read_text().splitlines() if line.startswith("# diagnostics = ")]
        assert json.loads(line.removeprefix("# diagnostics = "))[1]["nodes"] == 6


class TestCommandLine:
    @pytest.fixture
    def scene(self, tmp_path: Path) -> Path:
        (tmp_path / "paint.toml").write_text(TOML, encoding="utf-8")
        return tmp_path / "paint.toml"

    def test_a_spectrum_in_both_formats(self, scene: Path, paint: Spectrum, capsys: pytest.CaptureFixture[str]) -> None:
        out, table = scene.with_name("out.nc"), scene.with_name("out.csv")
        assert run("brdf", scene, "--wavelengths-um", "0.45,0.6", "-o", out, "--csv", table) == 0
        told = capsys.readouterr()
        assert told.err == ""
        assert "Spectrum(2 wavelengths from 0.45 to 0.6 um" in told.out
        assert f"{paint.reflectance[1, 0]:.6f}" in told.out
        loaded = vrte.load(out)
        assert_same(loaded, vrte.load(table))
        np.testing.assert_array_equal(loaded.mueller, paint.mueller)
        assert loaded[0].diagnostics["scene_toml"] == TOML

    def test_wavelengths_that_the_file_lists(self, scene: Path, paint: Spectrum, tmp_path: Path) -> None:
        listed, out = tmp_path / "listed.toml", tmp_path / "out.nc"
        listed.write_text("wavelength_um = [0.45, 0.6]\n" + TOML, encoding="utf-8")
        assert run("brdf", listed, "-o", out) == 0
        np.testing.assert_array_equal(vrte.load(out).mueller, paint.mueller)
        np.testing.assert_array_equal(vrte.spectrum(listed, transmission=True).mueller, paint.mueller)
        with pytest.raises(SceneError, match="wavelengths_um are missing"):
            vrte.spectrum(scene)
        listed.write_text("wavelength_um = [0.6, 0.45]\n" + TOML, encoding="utf-8")
        assert run("brdf", listed, "-o", out) == 2

    @pytest.mark.parametrize(
        ("options", "words"),
        [
            (["--wavelengths-um", "0.6,0.5"], "must be ascending wavelengths such as 0.45,0.55, not '0.6,0.5'"),
            (["--wavelengths-um", "0.5", "--plot", "a.jpg"], "must end in .png or .svg or .pdf"),
            (["--mitsuba", "a.bsdf"], "--mitsuba needs 5 wavelengths, by --wavelengths-um or in the scene file"),
            (["--mitsuba", "a.bsdf", "--wavelengths-um", "0.5,0.6"], "takes exactly 5 wavelengths, not 2"),
            (["--wavelengths-um", "0.5,99"], "paint.toml: at 99 um: particles.gold.index: "),
        ],
    )
    def test_complaints(self, options: list[str], words: str, scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
        assert run("brdf", scene, "-o", scene.with_name("out.nc"), *options) == 2
        told = capsys.readouterr().err
        assert words in told
        assert told.count("\n") == 1
        assert not scene.with_name("out.nc").exists()
