"""Surfaces on the command line, in spectra and in sweeps, solved: what is printed, written and tabulated."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.calls import mitsuba as mitsuba_call
from vrte.formats.measured_polarized import read_tensors
from vrte.optics.fresnel import reflect_smooth
from vrte.optics.refractive_index import refractive_index

from .helpers import assert_close, run

MU = [0.5, 1.0]
BINDER: dict[str, Any] = {"phase": "rayleigh", "albedo": 0.9, "thickness": 1.0}
LAYER = vrte.Layer(vrte.rayleigh(), 0.9, 1.0)
HEAD = "nodes = 4\nwavelength_um = 0.55\n"
GLASS = "[[layer]]\ninterface = { above = 1.0, below = 1.5 }\n"
RAYLEIGH = '[[layer]]\nphase = "rayleigh"\nalbedo = 0.9\nthickness = 1.0\n'
BRDF = "[brdf]\nmu_i = [0.5, 1.0]\nmu_o = 0.5\ntransmission = true\n"
FIELD = "[field]\nmu0 = 0.5\nmu = [-0.5, 0.5]\ntau = [0.0, 1.0]\n"


def written(folder: Path, text: str) -> Path:
    (folder / "scene.toml").write_text(text)
    return folder / "scene.toml"


def make_pile(index: float = 1.5, roughness: float = 0.0) -> list[Any]:
    """The layer under an interface."""
    return [vrte.Interface(1.0, index, roughness), LAYER]


def test_a_brdf_is_described_with_its_surface(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene, out = written(tmp_path, HEAD + GLASS + RAYLEIGH + BRDF), tmp_path / "a.csv"
    assert run("brdf", scene, "-o", out) == 0
    reported = capsys.readouterr().out
    found: Any = vrte.load(out)
    alone = vrte.brdf(vrte.Scene(make_pile()), MU, 0.5, nodes=4, transmission=True)
    for name in ("mueller", "specular", "specular_transmission", "direct_transmittance"):
        np.testing.assert_array_equal(getattr(found, name), getattr(alone, name), strict=True)
    for words in (
        ": BRDF of",
        "interface, index 1 above and 1.5 below",
        "layer 1: optical thickness 1, ",
        "terms, in index 1.5",
        f"mirrored as a beam, and not in it: {found.specular[0, 0, 0]:.4f} at mu_i 0.5",
    ):
        assert words in reported


def test_a_field_lies_on_a_side_of_the_surface(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "a.csv"
    for more, options, indices in (
        ("", ("--side", "above"), [1.0, 1.5]),
        ("", ("--side", "below"), [1.5, 1.5]),
        ('side = "below"\n', (), [1.5, 1.5]),
        ('side = "below"\n', ("--side", "above"), [1.0, 1.5]),
    ):
        assert run("field", written(tmp_path, HEAD + GLASS + RAYLEIGH + FIELD + more), "-o", out, *options) == 0
        assert f"depths in media of index {'1, ' * (indices[0] == 1.0)}1.5" in capsys.readouterr().out
        assert vrte.load(out).index.tolist() == indices  # type: ignore[union-attr]
    assert run("field", written(tmp_path, HEAD + RAYLEIGH + FIELD + 'side = "below"\n'), "-o", out) == 2
    assert "field.side 'below' is for depths tau at an interface" in capsys.readouterr().err


def test_a_spectrum_follows_the_index_of_its_medium(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene, out = written(tmp_path, HEAD + GLASS.replace("1.5", '"silica"') + RAYLEIGH + BRDF), tmp_path / "a.csv"
    assert run("brdf", scene, "-o", out, "--wavelengths-um", "0.4,0.7") == 0
    reported, found = capsys.readouterr().out, vrte.load(out)
    assert isinstance(found, vrte.Spectrum)
    assert found.specular is not None
    for place, wavelength in enumerate((0.4, 0.7)):
        index = refractive_index("silica", wavelength).n
        assert f"1, {index:.6g}, {index:.6g}; 1, 0.900000" in reported
        assert_close(found.specular[place], reflect_smooth(index, np.array(MU)), rtol=0.0, atol=1e-15)


def make_sweep(axes: dict[str, Any], **more: Any) -> Any:
    """A table of Rayleigh layers under an interface, made in memory."""
    stack = [{"interface": {"above": 1.0, "below": 1.5}}, BINDER]
    asked = {} if "field" in more else {"brdf": {"mu_i": MU, "mu_o": MU, "transmission": True}}
    return vrte.sweep({"nodes": 4, "layer": stack, **asked, **more, "axes": axes}, workers=1)


MIRROR = {"layer": [BINDER], "base": {"kind": "mirror", "index": 1.5}}
SWEPT: dict[str, tuple[list[float], dict[str, Any], Callable[[float], vrte.Scene]]] = {  # by the key that is swept
    "layer[1].interface.below": ([1.0, 1.33, 1.5], {}, lambda index: vrte.Scene(make_pile(index))),
    "layer[1].interface.roughness": ([0.0, 0.4], {}, lambda rough: vrte.Scene(make_pile(1.5, rough))),
    "base.index": ([1.33, 1.5], MIRROR, lambda index: vrte.Scene([LAYER], vrte.Mirror(index))),
}


@pytest.mark.parametrize("key", SWEPT)
def test_each_scene_of_a_sweep_is_that_of_a_call(key: str) -> None:
    """Zero where a scene has no surface, or none that mirrors."""
    values, more, make_scene = SWEPT[key]
    table = make_sweep({"axis": {"key": key, "values": values}}, **more)
    assert not (table.error != "").any()
    for index, value in enumerate(values):
        alone: Any = vrte.brdf(make_scene(value), MU, MU, nodes=4, transmission=True)
        surfaces = {"total_reflectance", "specular", "specular_transmission", "surface"} & {*table.data_vars}
        for name in ("mueller", "transmission", "reflectance", "direct_transmittance", *surfaces):
            found = getattr(alone, name)
            np.testing.assert_array_equal(table[name][index], 0.0 if found is None else found)
        if key == "base.index":
            expected = reflect_smooth(value, np.array(MU))[:, 0, 0] * np.exp(-2.0 / np.array(MU))
            assert_close(table.specular_reflectance[index], expected, rtol=1e-13, atol=0.0)
    if key == "layer[1].interface.below":
        between = vrte.interpolate(table.isel(axis=[1, 2]), {"axis": 1.4})
        assert 0.02 < between.specular_reflectance.sel(mu_i=1.0) < 0.04


def test_a_sweep_of_fields_has_media_and_beams_both_ways() -> None:
    field = {"mu0": [0.6, 1.0], "mu": [-0.5, 0.5], "tau": [0.0, 0.5]}
    table = make_sweep({"below": {"key": "layer[1].interface.below", "values": [1.0, 1.5]}}, field=field)
    assert table["index"].values.tolist() == [[1.0, 1.0], [1.0, 1.5]]
    assert not table.direct_up[0].any()
    alone = vrte.radiance(vrte.Scene(make_pile()), [0.6, 1.0], mu=[-0.5, 0.5], tau=[0.0, 0.5], nodes=4)
    for name in ("stokes", "direct", "direct_up", "flux_up", "flux_down"):
        np.testing.assert_array_equal(table[name][1], getattr(alone, name))
    depths = {"depth": {"key": "layer[2].thickness", "values": [1.0, 2.0]}}
    inside = make_sweep(depths, field=field | {"tau": [0.0, 0.5], "side": "below"})
    assert inside["index"].values.tolist() == [[1.5, 1.5]] * 2


@pytest.mark.slow
def test_nested_tables_from_command_line_and_call(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mitsuba_call, "COSINES", 8)  # fewer than anybody would ask for
    monkeypatch.setattr(mitsuba_call, "AZIMUTHS", 9)
    scene = written(tmp_path, HEAD + GLASS + RAYLEIGH + BRDF)
    five, line = "0.45,0.5,0.55,0.6,0.65", ["--mitsuba-step-deg", 15, "-o", tmp_path / "a.nc", "--wavelengths-um"]
    for name, more in (("plain", []), ("nested", ["--mitsuba-nested"])):
        assert run("brdf", scene, *line, five, "--mitsuba", tmp_path / f"{name}.bsdf", *more) == 0
        reported = capsys.readouterr().out
        assert ("left out is the mirrored beam" in reported) == (name == "plain")
    assert "which Mitsuba's own dielectric is" in reported
    assert 'value="nested.bsdf"' in (tmp_path / "nested.xml").read_text()
    assert not (tmp_path / "plain.xml").exists()
    bare = written(tmp_path, HEAD + RAYLEIGH + BRDF)
    vrte.to_mitsuba(bare, [float(one) for one in five.split(",")], tmp_path / "bare.bsdf", step_deg=15)
    tables = {name: read_tensors(tmp_path / f"{name}.bsdf")["M"] for name in ("plain", "nested", "bare")}
    np.testing.assert_array_equal(tables["nested"], tables["bare"])
    assert np.abs(tables["plain"] - tables["bare"]).max() > 0.01
    assert run("brdf", bare, *line, five, "--mitsuba", tmp_path / "a.bsdf", "--mitsuba-nested") == 2
    assert "an interface on top, and here is none" in capsys.readouterr().err
