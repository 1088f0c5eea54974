"""Bases from files: results of vrte and Mitsuba's tensor, in scene files and sweeps, and files that are damaged."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from tests.samples import largest_gap, spheroids
from vrte.exports.polarized import tabulate_polarized
from vrte.formats import bases
from vrte.formats.measured_polarized import directions, read_tensors, write_tensors
from vrte.formats.scene_file import find_named_tables, make_scene_file
from vrte.formats.toml_table import write_toml
from vrte.sweep.template import read_sweep

WAVELENGTHS = [0.45, 0.5, 0.55, 0.6, 0.65]
SCENE = vrte.Scene([vrte.Layer(spheroids(), 0.9, 2.0)], vrte.Lambertian(0.3))
BRIGHTER = vrte.Scene([vrte.Layer(spheroids(), 0.99, 2.0)], vrte.Lambertian(0.3))
MU, PHI = np.array([0.25, 0.5, 0.9]), np.array([5.0, 80.0, 165.0, 250.0])


@pytest.fixture(scope="module")
def spectrum() -> vrte.Spectrum:
    """The third of five wavelengths is another scene."""
    dark, bright = (vrte.brdf(scene, **directions(16, 15), nodes=6) for scene in (SCENE, BRIGHTER))
    return vrte.Spectrum(WAVELENGTHS, [dark, dark, bright, dark, dark])


@pytest.fixture(scope="module")
def exact() -> np.ndarray:
    return vrte.brdf(BRIGHTER, MU, MU, PHI, nodes=6).mueller


@pytest.fixture(scope="module")
def tensor(spectrum: vrte.Spectrum, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("measured") / "spheroids.bsdf"
    tabulate_polarized(spectrum, [None] * 5, step_deg=7.5).write(path, "spheroids")
    return path


@pytest.fixture
def few_directions(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tensor is read at fewer directions than it has for accuracy's sake."""
    monkeypatch.setattr(bases, "directions", partial(directions, 24, 15))


def found_at(base: Any) -> np.ndarray:
    return base.reflect(MU[:, None, None], MU[:, None], PHI)


def test_the_tensor_of_a_result_is_that_result_as_a_base(tensor: Path, exact: np.ndarray) -> None:
    """As far as 7.5 degrees between its angles go; all 16 elements with their signs, to 6 % of each."""
    found = found_at(vrte.read_base(tensor, 0.55))
    assert largest_gap(found, exact) < 0.03
    along = np.einsum("iopab,iopab->ab", found, exact) / np.einsum("iopab,iopab->ab", exact, exact)
    assert np.abs(along - 1.0).max() < 0.06


def content(**base: Any) -> dict[str, Any]:
    layer, brdf = {"phase": "rayleigh", "albedo": 0.9, "thickness": 0.3}, {"mu_i": 0.5, "mu_o": 0.5}
    return {"nodes": 6, "wavelength_um": 0.55, "layer": [layer], "base": {"kind": "table", **base}, "brdf": brdf}


def test_scene_files_name_tables(spectrum: vrte.Spectrum, tmp_path: Path) -> None:
    spectrum.save(tmp_path / "all.nc")
    read = make_scene_file(content(file="all.nc"), folder=tmp_path).scene
    assert read.base is not None
    expected = vrte.read_base(tmp_path / "all.nc", 0.55)
    np.testing.assert_array_equal(found_at(read.base), found_at(expected))
    assert find_named_tables(content(file="all.nc")) == {("base", "file"): "all.nc"}
    assert find_named_tables(content(file="paint.bsdf")) == {("base", "file"): "paint.bsdf"}


def test_what_a_scene_file_says_of_a_table_wrongly(spectrum: vrte.Spectrum, tensor: Path, tmp_path: Path) -> None:
    spectrum.save(tmp_path / "all.nc")
    (tmp_path / "a.bsdf").symlink_to(tensor)
    vrte.radiance(SCENE, 0.5, mu=[0.5], nodes=2).save(tmp_path / "field.nc")
    rows: list[tuple[dict[str, Any], float | None, str]] = [
        ({"file": "all.nc"}, 0.7, r'base\.file = "all\.nc": wavelength_um must be one of .*, not 0\.7'),
        ({"file": "all.nc"}, None, r'base\.file = "all\.nc": wavelength_um is needed: one of'),
        ({"file": "a.bsdf"}, 0.7, r"must be one of the file's wavelengths, 0\.45, 0\.5, 0\.55, 0\.6, 0\.65, not 0\.7"),
        ({"file": "a.bsdf"}, 0.551, r"must be one of the file's wavelengths, .*, not 0\.551"),
        ({"file": "none.nc"}, 0.5, r'base\.file = "none\.nc": the file cannot be read: No such file'),
        ({"file": "all.txt"}, 0.5, r"the path of a \.nc or \.csv or \.bsdf or \.pbsdf file beside the scene file"),
        ({"file": "field.nc"}, 0.5, r"field\.nc.* holds a radiance field, and a base is a BRDF"),
        ({}, 0.5, r"base\.file"),
        ({"file": "all.nc", "albedo": 0.5}, 0.5, r"base\.albedo = 0\.5: goes with kind = "),
        ({"file": "all.nc", "average_mirrored": 1}, 0.5, r"base\.average_mirrored"),
    ]
    for base, wavelength, words in rows:
        given = content(**base) | {"wavelength_um": wavelength}
        with pytest.raises(vrte.SceneError, match=words):
            make_scene_file({key: one for key, one in given.items() if one is not None}, folder=tmp_path)


def test_a_sweep_has_a_table_as_base_and_in_its_fingerprint(spectrum: vrte.Spectrum, tmp_path: Path) -> None:
    prints, given = set(), content(file="one.nc") | {"axes": {"layer[1].thickness": [0.1, 0.3]}}
    for one in (spectrum[0], spectrum[2]):
        one.save(tmp_path / "one.nc")
        prints.add(read_sweep(given, tmp_path).fingerprint())
    assert len(prints) == 2
    (tmp_path / "sweep.toml").write_text(write_toml(given))
    alone = make_scene_file(content(file="one.nc"), folder=tmp_path)
    expected = vrte.brdf(alone.scene, **alone.keywords({}))
    np.testing.assert_array_equal(vrte.sweep(tmp_path / "sweep.toml", workers=2).mueller.values[1], expected.mueller)


def test_a_file_is_read_again_where_it_has_changed(spectrum: vrte.Spectrum, tmp_path: Path) -> None:
    spectrum[0].save(tmp_path / "one.csv")
    first, again = (make_scene_file(content(file="one.csv"), folder=tmp_path).scene.base for _ in range(2))
    assert first is again
    spectrum[2].save(tmp_path / "one.csv")
    now = make_scene_file(content(file="one.csv"), folder=tmp_path).scene.base
    assert now is not first
    np.testing.assert_array_equal(now.mueller, spectrum[2].mueller)  # type: ignore[union-attr]


def leaning(fields: dict[str, Any]) -> None:
    fields["M"] = fields["M"].copy()
    fields["M"][0, ..., 0, 0] *= 1.1


@pytest.mark.usefixtures("few_directions")
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda fields: fields.pop("wvls"), "it has no field wvls: measured_polarized has phi_d, theta_d, theta_h"),
        (lambda fields: fields.update(M=fields["M"][1:]), r"its field M must have the shape \(25, 13, 13, 5, 4, 4\)"),
        (lambda fields: fields.update(phi_d=fields["phi_d"] ** 3 / np.pi**2 + 0.01), "its field phi_d must "),
        (lambda fields: fields.update(M=np.nan * fields["M"]), "its field M must have values, all of them finite"),
        (leaning, r"its mirror image, phi_d turned over, differs from it by .* \(average_mirrored takes the mean\)"),
        (lambda fields: fields.update(theta_h=fields["theta_h"][:, ::-1]), r"theta_h must ascend from 0 to 1\.571 rad"),
        (lambda fields: fields.update(theta_d=0.5 * fields["theta_d"]), r"theta_d must ascend from 0 to 1\.571 rad"),
        (lambda fields: fields.update(wvls=fields["wvls"][:0]), "its field wvls must have values"),
        (lambda fields: fields.update(M=np.negative(fields["M"])), "base: mueller must have f_00 >= 0"),
        (lambda fields: fields.update(M=9 * fields["M"]), "base: it gives back "),
    ],
)
def test_tensors_that_are_no_table_are_refused(change: Any, words: str, tensor: Path, tmp_path: Path) -> None:
    fields: dict[str, Any] = dict(read_tensors(tensor))
    change(fields)
    write_tensors(fields, tmp_path / "changed.bsdf")
    with pytest.raises(vrte.SceneError, match=words) as refused:
        vrte.read_base(tmp_path / "changed.bsdf", 0.55)
    assert str(refused.value).startswith(str(tmp_path / "changed.bsdf"))
