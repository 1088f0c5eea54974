"""Surfaces on the command line, in spectra and in sweeps, solved: what is printed, written and tabulated."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from tests.helpers import run
from vrte.calls import mitsuba as mitsuba_call
from vrte.formats.mitsuba_tensor import read_tensors
from vrte.optics.fresnel import reflect_smooth
from vrte.optics.refractive_index import refractive_index

from .helpers import assert_close, close_to

MU = [0.5, 1.0]
BINDER: dict[str, Any] = {"phase": "rayleigh", "albedo": 0.9, "thickness": 1.0}
HEAD = "nodes = 4\nwavelength_um = 0.55\n"
GLASS = "[[layer]]\ninterface = { above = 1.0, below = 1.5 }\n"
RAYLEIGH = '[[layer]]\nphase = "rayleigh"\nalbedo = 0.9\nthickness = 1.0\n'
BRDF = "[brdf]\nmu_i = [0.5, 1.0]\nmu_o = 0.5\ntransmission = true\n"
FIELD = "[field]\nmu0 = 0.5\nmu = [-0.5, 0.5]\ntau = [0.0, 1.0]\n"


def written(folder: Path, text: str) -> Path:
    (folder / "scene.toml").write_text(text)
    return folder / "scene.toml"


def test_a_brdf_is_told_with_its_surface(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene, out = written(tmp_path, HEAD + GLASS + RAYLEIGH + BRDF), tmp_path / "a.csv"
    assert run("brdf", scene, "-o", out) == 0
    told = capsys.readouterr().out
    assert ": BRDF of" in told
    assert "interface, index 1 above and 1.5 below" in told
    assert "layer 1: optical thickness 1, " in told
    assert "terms, in index 1.5" in told
    found = vrte.load(out)
    layer = vrte.Layer(vrte.rayleigh(), 0.9, 1.0)
    alone = vrte.brdf(vrte.Scene([vrte.Interface(1.0, 1.5), layer]), MU, 0.5, nodes=4, transmission=True)
    assert isinstance(found, vrte.Brdf)
    for name in ("mueller", "specular", "specular_transmission", "direct_transmittance"):
        np.testing.assert_array_equal(getattr(found, name), getattr(alone, name), strict=True)
    share = f"mirrored as a beam, and not in it: {found.specular[0, 0, 0]:.4f} at mu_i 0.5"  # type: ignore[index]
    assert share in told


def test_a_field_lies_on_a_side_of_the_surface(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene, out = written(tmp_path, HEAD + GLASS + RAYLEIGH + FIELD), tmp_path / "a.csv"
    indices = []
    for side in ("above", "below"):
        assert run("field", scene, "-o", out, "--side", side) == 0
        assert f"depths in media of index {'1, ' * (side == 'above')}1.5" in capsys.readouterr().out
        found = vrte.load(out)
        assert isinstance(found, vrte.Field)
        assert found.index is not None
        indices.append(found.index.tolist())
    assert indices == [[1.0, 1.5], [1.5, 1.5]]
    scene = written(tmp_path, HEAD + GLASS + RAYLEIGH + FIELD + 'side = "below"\n')
    assert run("field", scene, "-o", out) == 0
    assert vrte.load(out).index.tolist() == [1.5, 1.5]  # type: ignore[union-attr]
    assert run("field", scene, "-o", out, "--side", "above") == 0
    assert vrte.load(out).index.tolist() == [1.0, 1.5]  # type: ignore[union-attr]
    capsys.readouterr()
    assert run("field", written(tmp_path, HEAD + RAYLEIGH + FIELD + 'side = "below"\n'), "-o", out) == 2
    assert "field.side 'below' is for depths tau at an interface" in capsys.readouterr().err


def test_a_spectrum_follows_the_index_of_its_medium(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    glass = GLASS.replace("1.5", '"silica"')
    scene, out = written(tmp_path, HEAD + glass + RAYLEIGH + BRDF), tmp_path / "a.csv"
    assert run("brdf", scene, "-o", out, "--wavelengths-um", "0.4,0.7") == 0
    told = capsys.readouterr().out
    found = vrte.load(out)
    assert isinstance(found, vrte.Spectrum)
    assert found.specular is not None
    for place, wavelength in enumerate((0.4, 0.7)):
        index = refractive_index("silica", wavelength).n
        assert f"1, {index:.6g}, {index:.6g}; 1, 0.900000" in told
        assert_close(found.specular[place], reflect_smooth(index, np.array(MU)), rtol=0.0, atol=1e-15)


def make_sweep(axes: dict[str, Any], **more: Any) -> Any:
    """A table of Rayleigh layers under an interface, made in memory."""
    pile = [{"interface": {"above": 1.0, "below": 1.5}}, BINDER]
    asked = {} if "field" in more else {"brdf": {"mu_i": MU, "mu_o": MU, "transmission": True}}
    return vrte.sweep({"nodes": 4, "layer": pile, **asked, **more, "axes": axes}, workers=1)


def test_a_sweep_over_the_index_of_the_binder() -> None:
    table = make_sweep({"index": {"key": "layer[1].interface.below", "values": [1.0, 1.33, 1.5]}})
    assert not (table.error != "").any()
    for place, index in enumerate((1.0, 1.33, 1.5)):
        scene = vrte.Scene([vrte.Interface(1.0, index), vrte.Layer(vrte.rayleigh(), 0.9, 1.0)])
        alone = vrte.brdf(scene, MU, MU, nodes=4, transmission=True)
        for name in ("mueller", "transmission", "reflectance", "total_reflectance", "direct_transmittance"):
            np.testing.assert_array_equal(table[name][place], getattr(alone, name))
        if index == 1.0:  # there is no surface then
            assert alone.specular is None
            assert not table.specular[place].any()
        else:
            np.testing.assert_array_equal(table.specular[place], alone.specular)
            np.testing.assert_array_equal(table.specular_transmission[place], alone.specular_transmission)
    between = vrte.interpolate(table.isel(index=[1, 2]), {"index": 1.4})
    assert 0.02 < between.specular_reflectance.sel(mu_i=1.0) < 0.04


def test_a_sweep_over_mirrors() -> None:
    table = make_sweep({"base.index": [1.33, 1.5]}, layer=[BINDER], base={"kind": "mirror", "index": 1.5})
    for place, index in enumerate((1.33, 1.5)):
        expected = reflect_smooth(index, np.array(MU))[:, 0, 0] * np.exp(-2.0 / np.array(MU))
        assert_close(table.specular_reflectance[place], expected, rtol=1e-13, atol=0.0)


def test_a_sweep_over_rough_bases() -> None:
    base = {"kind": "facets", "index": 1.34, "roughness": 0.2}
    table = make_sweep({"base.roughness": [0.2, 0.4]}, layer=[BINDER], base=base)
    layer = vrte.Layer(vrte.rayleigh(), 0.9, 1.0)
    for place, roughness in enumerate((0.2, 0.4)):
        alone = vrte.brdf(vrte.Scene([layer], vrte.Facets(1.34, roughness)), MU, MU, nodes=4)
        np.testing.assert_array_equal(table.mueller[place], alone.mueller)


def test_a_sweep_from_smooth_to_rough() -> None:
    table = make_sweep({"layer[1].interface.roughness": [0.0, 0.4]}, brdf={"mu_i": MU, "mu_o": MU})
    for place, roughness in enumerate((0.0, 0.4)):
        pile: list[Any] = [vrte.Interface(1.0, 1.5, roughness), vrte.Layer(vrte.rayleigh(), 0.9, 1.0)]
        alone = vrte.brdf(vrte.Scene(pile), MU, MU, nodes=4)
        np.testing.assert_array_equal(table.mueller[place], alone.mueller)
        np.testing.assert_array_equal(table.total_reflectance[place], alone.total_reflectance)
        np.testing.assert_array_equal(table.surface[place], 0.0 if alone.surface is None else alone.surface)
    assert (table.specular_reflectance[0] > 0.0).all()
    assert not table.specular_reflectance[1].any()


def test_a_sweep_of_fields_has_media_and_beams_both_ways() -> None:
    field = {"mu0": [0.6, 1.0], "mu": [-0.5, 0.5], "tau": [0.0, 0.5]}
    table = make_sweep({"below": {"key": "layer[1].interface.below", "values": [1.0, 1.5]}}, field=field)
    assert table["index"].values.tolist() == [[1.0, 1.0], [1.0, 1.5]]
    assert not table.direct_up[0].any()
    scene = vrte.Scene([vrte.Interface(1.0, 1.5), vrte.Layer(vrte.rayleigh(), 0.9, 1.0)])
    alone = vrte.radiance(scene, [0.6, 1.0], mu=[-0.5, 0.5], tau=[0.0, 0.5], nodes=4)
    for name in ("stokes", "direct", "direct_up", "flux_up", "flux_down"):
        np.testing.assert_array_equal(table[name][1], getattr(alone, name))
    inside = make_sweep(
        {"depth": {"key": "layer[2].thickness", "values": [1.0, 2.0]}},
        field=field | {"tau": [0.0, 0.5], "side": "below"},
    )
    assert inside["index"].values.tolist() == [[1.5, 1.5]] * 2


def test_all_that_falls_on_a_white_glossy_thing_comes_back() -> None:
    white = vrte.Scene([vrte.Interface(1.0, 1.5), vrte.Layer(vrte.rayleigh(), 1.0, 1.0)], vrte.Lambertian(1.0))
    mu, weights = vrte.hemisphere(8)
    found = vrte.brdf(white, mu, mu, np.arange(0.0, 360.0, 45.0), nodes=12)
    assert found.bihemispherical_reflectance(weights) == close_to(1.0, rtol=0.0, atol=1e-12)
    assert found.under([1.0, 0.0, 0.0, 0.0], weights, mirrored=True)[..., 0].mean() == close_to(
        1.0, rtol=0.0, atol=1e-3
    )
    assert found.under([1.0, 0.0, 0.0, 0.0], weights)[..., 0].mean() < 0.9


def test_the_sweep_command_names_what_is_in_the_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = written(tmp_path, HEAD + GLASS + RAYLEIGH + BRDF + '[axes]\n"layer[2].thickness" = [0.5, 1.0]\n')
    assert run("sweep", scene, "-o", tmp_path / "a.nc") == 0
    told = capsys.readouterr().out
    assert all(name in told for name in ("specular_reflectance", "total_reflectance", "specular_transmission"))


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
        told = capsys.readouterr().out
        assert ("left out is the mirrored beam" in told) == (name == "plain")
    assert "which Mitsuba's own dielectric is" in told
    assert 'value="nested.bsdf"' in (tmp_path / "nested.xml").read_text()
    assert not (tmp_path / "plain.xml").exists()
    bare = written(tmp_path, HEAD + RAYLEIGH + BRDF)
    vrte.to_mitsuba(bare, [float(one) for one in five.split(",")], tmp_path / "bare.bsdf", step_deg=15)
    tables = {name: read_tensors(tmp_path / f"{name}.bsdf")["M"] for name in ("plain", "nested", "bare")}
    np.testing.assert_array_equal(tables["nested"], tables["bare"])
    assert np.abs(tables["plain"] - tables["bare"]).max() > 0.01
    assert run("brdf", bare, *line, five, "--mitsuba", tmp_path / "a.bsdf", "--mitsuba-nested") == 2
    assert "an interface on top, and here is none" in capsys.readouterr().err
    assert run("brdf", bare, "-o", tmp_path / "a.nc", "--mitsuba-nested") == 2
    assert "--mitsuba-nested goes with --mitsuba" in capsys.readouterr().err
