"""Spectra and the light of results: several wavelengths from Python and the command line, beams added up."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from tests.helpers import assert_same, run
from vrte import SceneError, Spectrum
from vrte.optics.fresnel import reflect_smooth

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


def test_each_wavelength_is_that_of_its_own_particles(paint: Spectrum) -> None:
    for wavelength, one in zip(WAVELENGTHS, paint, strict=True):
        gold = vrte.spheres("gold", radius_um=0.1, wavelength_um=wavelength)
        scene = vrte.Scene([vrte.Layer.of(gold, thickness=1.0)])
        alone = vrte.brdf(scene, [0.6, 1.0], [0.2, 0.5], [0, 90], nodes=6, transmission=True)
        np.testing.assert_array_equal(one.mueller, alone.mueller)
    assert paint.mueller.shape == (2, 2, 2, 2, 4, 4)
    assert paint.reflectance[1, 0] > 1.5 * paint.reflectance[0, 0]
    np.testing.assert_array_equal(paint.transmission[1], paint[1].transmission)
    assert_same(paint.at([0.6])[0], paint[1])
    with pytest.raises(SceneError, match=r"0\.5 um is none of the spectrum's: the next is at 0\.45 um"):
        paint.at([0.5])


def test_keywords_win_over_the_file() -> None:
    found = vrte.spectrum(PAINT, [0.5], mu_o=1.0, transmission=False, method="single-scattering")
    assert found.mu_o.tolist() == [1.0]
    assert found.transmission is None
    assert found[0].diagnostics["method"] == "single-scattering"
    with_settings = {**PAINT, "method": "successive-orders", "settings": {"largest_orders": 3}}
    assert vrte.spectrum(with_settings, [0.5], method="single-scattering", transmission=False).mu_o.size == 2


def test_progress_goes_up_to_the_end() -> None:
    reported: list[tuple[int, int]] = []
    vrte.spectrum(PAINT, WAVELENGTHS, progress=lambda done, total: reported.append((done, total)))
    assert {total for _, total in reported} == {400}
    assert [done for done, _ in reported] == sorted(done for done, _ in reported)
    assert reported[-1] == (400, 400)


@pytest.mark.parametrize(
    ("wavelengths", "more", "words"),
    [
        *(
            (wrong, {}, "wavelength_um must be")
            for wrong in ([], [0.5, 0.5], [0.6, 0.5], [-0.5, 0.5], [0.0], [np.nan], "red", [[0.5]])
        ),
        ([0.5, 99.0], {}, r"^at 99 um: particles\.gold\.index: "),
        ([0.5], {"mu_i": 2.0}, r"^brdf\.mu_i must satisfy"),
    ],
)
def test_complaints_name_the_wavelength_or_the_key(wavelengths: Any, more: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        vrte.spectrum(PAINT, wavelengths, **more)


def test_brdfs_must_fit_together(paint: Spectrum) -> None:
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
def test_a_device_gets_all_of_them_together(paint: Spectrum, opencl: Any) -> None:
    found = vrte.spectrum(PAINT, WAVELENGTHS, backend="opencl")
    assert "device" in found[0].diagnostics
    assert_close(found.mueller, paint.mueller, rtol=0.0, atol=1e-13)


def test_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = (Path(__file__).parents[1] / "docs" / "how_to" / "exports.md").read_text(encoding="utf-8")
    (block, *_) = re.findall(r"^```python\n(import vrte.*?)^```", page, re.MULTILINE | re.DOTALL)
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    exec(compile(block, "exports.md", "exec"), names)
    shown = re.search(r"^0\.45,0\.6,0\.2,0\.0,([\d.]+)", page, re.MULTILINE)
    assert shown
    assert vrte.load("gold.nc").mueller[0, 0, 0, 0, 0, 0] == close_to(float(shown[1]), rtol=1e-6, atol=0.0)


def test_the_command_solves_the_wavelengths_given_or_listed(
    paint: Spectrum, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, out, table = (tmp_path / name for name in ("paint.toml", "out.nc", "out.csv"))
    scene.write_text(TOML, encoding="utf-8")
    assert run("brdf", scene, "--wavelengths-um", "0.45,0.6", "-o", out, "--csv", table) == 0
    reported = capsys.readouterr()
    assert reported.err == ""
    assert "Spectrum(2 wavelengths from 0.45 to 0.6 um" in reported.out
    assert f"{paint.reflectance[1, 0]:.6f}" in reported.out
    loaded = vrte.load(out)
    assert_same(loaded, vrte.load(table))
    np.testing.assert_array_equal(loaded.mueller, paint.mueller)
    assert all(one.diagnostics["scene_toml"] == TOML for one in (*loaded, *vrte.spectrum(scene, WAVELENGTHS)))
    with pytest.raises(SceneError, match="wavelengths_um are missing"):
        vrte.spectrum(scene)
    scene.write_text("wavelength_um = [0.45, 0.6]\n" + TOML, encoding="utf-8")
    assert run("brdf", scene, "-o", out) == 0
    np.testing.assert_array_equal(vrte.load(out).mueller, paint.mueller)
    np.testing.assert_array_equal(vrte.spectrum(scene, transmission=True).mueller, paint.mueller)
    scene.write_text("wavelength_um = [0.6, 0.45]\n" + TOML, encoding="utf-8")
    assert run("brdf", scene, "-o", out) == 2


MU, WEIGHTS = vrte.hemisphere(8)
GLASS = vrte.Brdf(  # reflects as glass does, and absorbs the rest
    np.zeros((8, 8, 4, 4, 4)), np.zeros(8), MU, MU, [0.0, 90.0, 180.0, 270.0], {}, specular=reflect_smooth(1.5, MU)
)


def test_beams_count_in_the_flux_and_are_added_on_request() -> None:
    # diffuse light falls on glass of index 1.5: 0.0917780 is reflected (Walsh's closed form)
    assert GLASS.bihemispherical_reflectance(WEIGHTS) == close_to(0.0917780, rtol=0.0, atol=2e-6)
    assert GLASS.diffuse_reflectance(WEIGHTS).any() == 0.0
    sky = np.random.default_rng(3).uniform(0.5, 1.0, (8, 4, 4)) * [1.0, 0.2, -0.2, 0.2]
    assert not GLASS.under(sky, WEIGHTS).any()
    expected = reflect_smooth(1.5, MU)[:, None] @ sky[..., None]
    assert_close(GLASS.under(sky, WEIGHTS, mirrored=True), expected[..., 0], rtol=1e-14, atol=0.0)
    with pytest.raises(SceneError, match="each mu_o must be one of mu_i"):
        replace(GLASS, mu_o=np.linspace(0.1, 0.9, 8)).under([1.0, 0.0, 0.0, 0.0], WEIGHTS, mirrored=True)


def test_beams_that_are_gone_at_one_wavelength_are_zero_there() -> None:
    gone = replace(GLASS, specular=None)
    found = Spectrum([0.5, 0.6], (GLASS, gone))
    assert not found.specular[1].any()  # type: ignore[index]
    np.testing.assert_array_equal(found.total_reflectance, [GLASS.total_reflectance, gone.reflectance])
    assert Spectrum([0.5], (gone,)).specular_reflectance is None
    np.testing.assert_array_equal(Spectrum([0.5], (gone,)).total_reflectance, [gone.reflectance])


def test_one_beam_of_several_keeps_its_medium() -> None:
    scene = vrte.Scene([vrte.Interface(1.0, 1.5), vrte.Layer(vrte.rayleigh(), 0.9, 1.0)])
    fields = vrte.radiance(scene, [0.5, 1.0], tau=[0.0, 1.0], mu=[], nodes=4)
    np.testing.assert_array_equal(fields.beam(1).direct_up, fields.direct_up[1])  # type: ignore[index]
    np.testing.assert_array_equal(fields.beam(1).index, fields.index)  # type: ignore[arg-type]
