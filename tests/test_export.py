"""Files for renderers: what Mitsuba reads and samples in them, what an own reader of MERL's format does, what each
says of its error, and what is refused."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.basics.arrays import Array
from vrte.exports import export as export_call
from vrte.exports import fitted, measured
from vrte.exports.colour import weigh_channels
from vrte.exports.export import Exported
from vrte.formats.measured_polarized import make_pairs, make_unit_vectors, read_tensors

from .helpers import assert_close, close_to, run

WAVELENGTHS = [0.45, 0.5, 0.55, 0.6, 0.65]
VISIBLE = np.linspace(0.43, 0.67, 9)
GREY: dict[str, Any] = {"layer": [{"phase": "isotropic", "albedo": 0.9, "thickness": 2.0}], "base": {"kind": "black"}}
GLASS = {"interface": {"above": 1.0, "below": 1.5}}
SATIN = {"interface": {"above": 1.0, "below": 1.5, "roughness": 0.1, "distribution": "ggx"}}
PAINT: dict[str, Any] = {
    "host_index": 1.5,
    "particles": {"rutile": {"index": [2.7, 0.0], "size": {"lognormal": {"median_um": 0.11, "sigma": 1.3}}}},
    "layer": [SATIN, {"particles": "rutile", "thickness": 40.0}],
}
POWDER: dict[str, Any] = {
    "particles": {"gold": {"index": "gold", "size": {"lognormal": {"median_um": 0.2, "sigma": 1.4}}}},
    "layer": [{"particles": "gold", "thickness": np.inf}],
}


@pytest.fixture
def few_directions(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer than anybody would ask for."""
    monkeypatch.setattr(export_call, "COSINES", 16)
    monkeypatch.setattr(export_call, "AZIMUTHS", 19)


@pytest.fixture
def mitsuba() -> Any:
    found = pytest.importorskip("mitsuba")
    found.set_variant("scalar_spectral")
    return found


def look_from(mitsuba: Any, direction: Array, nanometres: float) -> Any:
    """A point seen along a direction (3,) away from it."""
    at = mitsuba.SurfaceInteraction3f()
    at.sh_frame = mitsuba.Frame3f(mitsuba.Vector3f(0, 0, 1))
    at.wi, at.wavelengths = mitsuba.Vector3f(*direction), 4 * [nanometres]
    return at


@pytest.mark.parametrize(
    ("content", "median", "most"),
    [pytest.param(PAINT, 3e-3, 0.03, marks=pytest.mark.slow), (POWDER, 3e-3, 0.03)],
    ids=["satin", "powder"],
)
def test_mitsuba_reads_and_samples_what_was_solved(
    content: dict[str, Any], median: float, most: float, mitsuba: Any, tmp_path: Path
) -> None:
    """Against BRDFs solved at other directions; the spread of sampling weights is 0.6 at most by the aim, 0 for a
    density that is that of the light."""
    path = tmp_path / "a.bsdf"
    done = vrte.export(content, path, WAVELENGTHS, accuracy=1e-4)
    assert done.median < median
    assert done.most < most
    assert done.energy < 0.02
    bsdf = mitsuba.load_dict({"type": "measured", "filename": str(path)})
    random = np.random.default_rng(1)
    mu_i, mu_o, phi = random.uniform(0.15, 1.0, 6), random.uniform(0.15, 1.0, 6), random.uniform(0.0, 360.0, 6)
    exact = vrte.spectrum(
        {**content, "brdf": {"mu_i": 1, "mu_o": 1}}, [0.55], mu_i=mu_i, mu_o=mu_o, phi=phi, accuracy=1e-4
    )
    off, context = [], mitsuba.BSDFContext()
    for place in np.ndindex(6, 6, 6):
        i, o, p = place
        light = make_unit_vectors(mu_i[i : i + 1], np.array([0.4]))[0]
        view = make_unit_vectors(mu_o[o : o + 1], np.array([0.4 + np.pi + np.radians(phi[p])]))[0]
        found = np.array(bsdf.eval(context, look_from(mitsuba, light, 550.0), mitsuba.Vector3f(*view)))[0] / mu_o[o]
        off.append(abs(found / exact[0].mueller[*place, 0, 0] - 1.0))
    assert np.median(off) < median
    assert np.quantile(off, 0.95) < most
    mu, angles = np.cos(np.radians([20.0, 45.0, 70.0])), np.array([0.4])
    reflected = vrte.spectrum(
        {**content, "brdf": {"mu_i": 1, "mu_o": 1}}, [0.55], mu_i=mu, mu_o=1.0, accuracy=1e-4
    ).reflectance[0]
    for cosine, share in zip(mu, reflected, strict=True):
        at = look_from(mitsuba, make_unit_vectors(np.array([cosine]), angles)[0], 550.0)
        weights, densities = [], []
        for first, second in random.random((1000, 2)):
            sample, weight = bsdf.sample(context, at, 0.5, mitsuba.Point2f(first, second))
            weights.append(np.array(weight)[0])
            densities.append(bsdf.pdf(context, at, sample.wo) / sample.pdf)
        assert np.std(weights) < 0.3 * np.mean(weights)
        assert abs(np.mean(weights) - share) < 4.0 * np.std(weights) / 1000**0.5 + 5e-3
        assert_close(np.array(densities)[np.array(weights) > 0.0], 1.0, rtol=1e-3, atol=0.0)


def test_the_square_and_half_vectors_are_inverse() -> None:
    density = measured.spread_evenly(np.radians(75.0))
    across, along = np.random.default_rng(0).uniform(0.02, 0.98, (2, 9))
    u, azimuth = measured.map_from_square(density, across, along)
    points = measured.map_to_square(density, u.ravel(), azimuth.ravel())
    assert_close(points[0].reshape(9, 9), np.tile(across, (9, 1)), rtol=0.0, atol=1e-9)
    assert_close(points[1].reshape(9, 9), np.tile(along[:, None], 9), rtol=0.0, atol=1e-9)


def read_merl(path: Path, light: Array, view: Array) -> Array:
    """Red, green and blue (3,) [sr-1] of MERL's file, looked up as its authors' program does: by rotations."""
    content = path.read_bytes()
    counts = np.frombuffer(content, "<i4", 3)
    values = np.frombuffer(content, "<f8", offset=12)
    assert counts.tolist() == [90, 90, 180]
    assert values.size == 3 * counts.prod()
    half = (light + view) / np.linalg.norm(light + view)
    theta, phi = np.arccos(half[2]), np.arctan2(half[1], half[0])
    back = np.array([[np.cos(phi), np.sin(phi), 0.0], [-np.sin(phi), np.cos(phi), 0.0], [0.0, 0.0, 1.0]])
    down = np.array([[np.cos(theta), 0.0, -np.sin(theta)], [0.0, 1.0, 0.0], [np.sin(theta), 0.0, np.cos(theta)]])
    x, y, z = down @ back @ light
    phi_d = np.arctan2(y, x) % np.pi
    index = int(np.sqrt(theta / (0.5 * np.pi)) * 90) * 90 + int(np.arccos(z) / (0.5 * np.pi) * 90)
    index = index * 180 + min(int(phi_d / np.pi * 180), 179)
    return np.array([values[index + plane * 90 * 90 * 180] for plane in range(3)]) * [
        1 / 1500,
        1.15 / 1500,
        1.66 / 1500,
    ]


def test_merl_by_an_independent_reader(tmp_path: Path) -> None:
    content = {**POWDER, "brdf": {"mu_i": [0.3, 0.7, 0.95], "mu_o": [0.35, 0.6, 0.9], "phi_deg": [10, 75, 160, 250]}}
    done = vrte.export(content, tmp_path / "gold.binary", VISIBLE, accuracy=1e-4)
    assert done.paths == (tmp_path / "gold.binary", tmp_path / "gold.txt")
    assert "linear sRGB" in (tmp_path / "gold.txt").read_text()
    exact = vrte.spectrum(content, VISIBLE, accuracy=1e-4)
    wanted = np.einsum("cw,wiop->iopc", weigh_channels(VISIBLE), exact.mueller[..., 0, 0])
    found = np.empty(wanted.shape)
    for i, o, p in np.ndindex(3, 3, 4):
        light = make_unit_vectors(exact.mu_i[i : i + 1], np.array([1.0]))[0]
        view = make_unit_vectors(exact.mu_o[o : o + 1], np.array([1.0 + np.pi + np.radians(exact.phi[p])]))[0]
        found[i, o, p] = read_merl(tmp_path / "gold.binary", light, view)
    off = np.abs(found / wanted - 1.0)
    assert np.median(off) < 0.01
    assert off.max() < 0.05
    assert done.median < 0.01


@pytest.mark.usefixtures("few_directions")
def test_the_command_and_the_call_write_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = tmp_path / "haze.toml"
    scene.write_text('nodes = 4\n[[layer]]\nphase = "rayleigh"\nalbedo = 0.9\nthickness = 1.0\n')
    reported = list[Any]()
    done = vrte.export(scene, tmp_path / "call.pbsdf", step_deg=15.0, progress=lambda *at: reported.append(at))
    assert reported[-1] == (1000, 1000)
    assert done.wavelengths_um == tuple(WAVELENGTHS)
    assert run("export", scene, "-o", tmp_path / "line.pbsdf", "--step-deg", 15) == 0
    assert f"  {done}\n" in capsys.readouterr().out
    call, line = read_tensors(tmp_path / "call.pbsdf"), read_tensors(tmp_path / "line.pbsdf")
    # to rounding: the spectra are the same bits, SciPy 1.14's matrices of splines are not always
    assert_close(call["M"], line["M"], rtol=0.0, atol=1e-15)
    assert call["M"].shape == (13, 7, 7, 5, 4, 4)
    assert call["wvls"].tolist() == [450, 500, 550, 600, 650]
    text = call["description"].tobytes().decode("utf-8")
    assert f"error: {done}" in text
    assert 'phase = "rayleigh"' in text
    assert run("export", scene, "-o", tmp_path / "line.bsdf", "--wavelengths-um", "0.5,0.6") == 0
    fields = read_tensors(tmp_path / "line.bsdf")
    assert fields["wavelengths"].tolist() == [500.0, 600.0]
    assert "times the cosine of exit" in fields["description"].tobytes().decode()


@pytest.mark.usefixtures("few_directions")
def test_mirrored_beams_are_refused_nested_or_left_out(tmp_path: Path) -> None:
    glossy = {**GREY, "nodes": 4, "layer": [GLASS, *GREY["layer"]]}
    with pytest.raises(
        vrte.SceneError, match=r"a \.bsdf cannot hold the beam that is mirrored, 0\.\d+ of .*nested=True"
    ):
        vrte.export(glossy, tmp_path / "a.bsdf", WAVELENGTHS)
    with pytest.raises(vrte.SceneError, match=r"a \.binary cannot hold the beam that is mirrored.*: diffuse=True"):
        vrte.export(glossy, tmp_path / "a.binary", VISIBLE)
    assert not list(tmp_path.iterdir())
    plain = vrte.export(glossy, tmp_path / "plain.pbsdf", WAVELENGTHS, step_deg=15.0, diffuse=True)
    assert "left out is the mirrored beam" in plain.notes[0]
    for suffix, plugin in ((".pbsdf", "measured_polarized"), (".bsdf", "measured")):
        done = vrte.export(glossy, tmp_path / f"nested{suffix}", WAVELENGTHS, nested=True)
        text = (tmp_path / "nested.xml").read_text()
        assert f'type="{plugin}"' in text
        assert f'value="nested{suffix}"' in text
        assert done.paths[1] == tmp_path / "nested.xml"
        assert "Mitsuba's own dielectric" in done.notes[0]
    bare = {**GREY, "nodes": 4}
    done = vrte.export(bare, tmp_path / "bare.pbsdf", WAVELENGTHS, diffuse=True)
    assert done.notes == ("diffuse leaves nothing out: no beam is mirrored",)
    tables = {name: read_tensors(tmp_path / f"{name}.pbsdf")["M"] for name in ("nested", "bare")}
    np.testing.assert_array_equal(tables["nested"], tables["bare"])


@pytest.mark.parametrize(
    ("path", "asked", "words"),
    [
        ("a.gltf", {}, r"path must end in \.nc, \.pbsdf, \.bsdf, \.binary, \.json, \.mtlx"),
        ("a.bsdf", {"step_deg": 5.0}, r"step_deg is of a \.pbsdf alone"),
        ("a.pbsdf", {"step_deg": 0.1}, r"step_deg must be between 0\.5 and 15 degrees"),
        ("a.bsdf", {"mu_i": 0.5}, "mu_i is not asked for here: a file has directions of its own"),
        ("a.bsdf", {"transmission": True}, "transmission has no place in a file of reflected light"),
        ("a.bsdf", {"coherent": True}, "coherent has no place in a file for a renderer"),
        ("a.bsdf", {"nested": True, "diffuse": True}, "diffuse leaves out the beam that nested keeps"),
        ("a.binary", {"nested": True}, r"nested is for what Mitsuba reads \(\.pbsdf, \.bsdf\), not for a \.binary"),
        ("a.binary", {"wavelengths_um": [0.5, 0.6]}, "wavelengths_um must cover the visible"),
        ("a.pbsdf", {"wavelengths_um": [0.5, 0.6]}, "exactly 5 wavelengths, not 2"),
    ],
)
def test_what_a_format_does_not_hold_is_refused(path: str, asked: dict[str, Any], words: str) -> None:
    with pytest.raises(vrte.SceneError, match=words):
        vrte.export(GREY, path, **asked)


def test_errors_are_words() -> None:
    done = Exported((Path("a.bsdf"),), (0.5,), 1e-3, 2e-2, 512, 3e-3, 4e-3)
    assert str(done).startswith("off by 1.0e-03 of I in the median, by less than 2.0e-02 for 95% of 512 pairs")
    assert "reflectance off by 3.0e-03 at most; reciprocal to 4.0e-03 for 95%" in str(done)


NUMBERS = {"principled": [0.6, 0.3, 0.1, 0.4, 1.6, 0.3, 0.25], "openpbr": [0.6, 0.3, 0.1, 0.4, 1.6, 0.3, 0.0, 1.6]}


def draw_pairs(count: int) -> tuple[Array, Array]:
    """Pairs of directions (count, 3) over the hemisphere, some of them close to the mirrored one."""
    random = np.random.default_rng(7)
    mu, azimuth = random.uniform(0.1, 1.0, (2, count)), random.uniform(0.0, 2.0 * np.pi, (2, count))
    mu[1, ::2], azimuth[1, ::2] = np.clip(mu[0, ::2] + 0.02, 0.0, 1.0), azimuth[0, ::2] + np.pi + 0.05
    return make_unit_vectors(mu[0], azimuth[0]), make_unit_vectors(mu[1], azimuth[1])


def test_principled_is_that_of_mitsuba(tmp_path: Path) -> None:
    """The model that is fitted, direction by direction, as Mitsuba evaluates the file that was written."""
    found = pytest.importorskip("mitsuba")
    found.set_variant("scalar_rgb")
    numbers = np.array(NUMBERS["principled"])
    fitted.FittedFile(fitted.PRINCIPLED, numbers, 0.0, 0.0).write(tmp_path / "a.json", "a fit")
    bsdf = found.load_dict(json.loads((tmp_path / "a.json").read_text())["bsdf"])
    into, out = draw_pairs(60)
    ours = fitted.shade_principled(numbers, fitted.Geometry.of(into, out))
    at = found.SurfaceInteraction3f()
    at.sh_frame = found.Frame3f(found.Vector3f(0, 0, 1))
    for light, view, wanted in zip(into, out, ours, strict=True):
        at.wi = found.Vector3f(*view)
        seen = np.array(bsdf.eval(found.BSDFContext(), at, found.Vector3f(*light))) / light[2]
        assert_close(wanted, seen, rtol=1e-5, atol=0.0)


@pytest.mark.parametrize("coat", [0.0, 1.0])
def test_openpbr_sends_back_no_more_than_comes(coat: float) -> None:
    """A white base under facets, or under a coat, in even light: what they let through towards the eye and the base
    sends back, all but what they hide. Of one beam more may come back, since the model is not reciprocal."""

    class Even:
        def evaluate(self, mu_i: Array, mu_o: Array, phi: Array) -> Array:
            """The model's BRDF with light and eye swapped."""
            at = fitted.Geometry.of(*make_pairs(mu_i[:, None], mu_o, phi))
            swapped = replace(at, mu_i=at.mu_o, mu_o=at.mu_i)
            found = fitted.shade_openpbr(np.array([1.0, 1.0, 1.0, 0.3, 1.5, 0.0, coat, 1.5]), swapped)
            return found.reshape(*mu_o.shape, 3, 1, 1)

        def write(self, path: Path, text: str) -> None:
            """Not called."""

    reflected = export_call.integrate_over_hemisphere(Even(), np.array([0.3, 0.6, 1.0]))
    assert_close(reflected, 1.0, rtol=0.0, atol=2e-3)


@pytest.mark.parametrize(
    ("model", "numbers", "smooth"),
    [
        (fitted.PRINCIPLED, NUMBERS["principled"], None),
        (fitted.OPENPBR, NUMBERS["openpbr"], None),
        (fitted.OPENPBR, [0.6, 0.3, 0.1, 0.5, 1.8, 0.7, 1.0, 1.5], 1.5),
    ],
    ids=["principled", "openpbr", "coat"],
)
def test_a_fit_finds_the_numbers_of_its_own_model(
    model: Any, numbers: Any, smooth: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    def shade(*pairs: Array) -> Array:
        at = fitted.Geometry.of(*pairs)
        mirrored = 0.0 if smooth is None else fitted.shade_mirror(smooth, at)[:, None]
        return np.asarray(model.shade(np.array(numbers), at) - mirrored)

    monkeypatch.setattr(fitted, "follow_intensities", lambda *_: shade)
    monkeypatch.setattr(fitted, "weigh_channels", lambda _: np.eye(3))
    spectrum = vrte.spectrum({**GREY, "nodes": 2, "brdf": {"mu_i": 1.0, "mu_o": 1.0}}, [0.5])
    found = fitted.fit_model(model, spectrum, [None], smooth)
    assert_close(found.numbers, numbers, rtol=0.0, atol=5e-3)
    assert found.most < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".json", ".mtlx"])
def test_fits_say_how_far_they_are_off(suffix: str, tmp_path: Path) -> None:
    done = vrte.export(PAINT, tmp_path / f"a{suffix}", VISIBLE, accuracy=1e-4)
    text = (tmp_path / f"a{suffix}").read_text()
    assert "CIEDE2000 in the median" in done.notes[0]
    assert done.notes[0] in text
    roughness, index = (
        float(re.search(rf'"{name}"(?:: | type="float" value=")([\d.]+)', text)[1])  # type: ignore[index]
        for name in (("roughness", "eta") if suffix == ".json" else ("specular_roughness", "specular_ior"))
    )
    assert roughness == close_to(0.1**0.5, rtol=0.0, atol=0.03)
    assert index == close_to(1.5, rtol=0.0, atol=0.1)


def test_materialx_takes_the_surface(tmp_path: Path) -> None:
    materialx = pytest.importorskip("MaterialX")
    numbers = np.array(NUMBERS["openpbr"])
    fitted.FittedFile(fitted.OPENPBR, numbers, 0.0, 0.0).write(tmp_path / "a.mtlx", 'words, "quoted" <&>\nand more')
    library, found = materialx.createDocument(), materialx.createDocument()
    folders = materialx.getDefaultDataLibraryFolders()
    materialx.loadLibraries(folders, materialx.getDefaultDataSearchPath(), library)
    materialx.readFromXmlFile(found, str(tmp_path / "a.mtlx"))
    found.setDataLibrary(library)
    valid, words = found.validate()
    assert valid, words
    surface = found.getNode("surface")
    assert surface.getNodeDef().getName() == "ND_open_pbr_surface_surfaceshader"
    assert surface.getInputValue("specular_ior") == close_to(1.6, rtol=1e-6, atol=0.0)
    assert [one.getName() for one in found.getMaterialNodes()] == ["material"]


def test_a_smooth_surface_is_a_mirrors_lobe_of_a_model(tmp_path: Path) -> None:
    glossy = {**GREY, "nodes": 8, "layer": [GLASS, *GREY["layer"]]}
    done = vrte.export(glossy, tmp_path / "a.json", VISIBLE)
    bsdf = json.loads((tmp_path / "a.json").read_text())["bsdf"]
    assert bsdf["eta"] == close_to(1.5, rtol=0.0, atol=1e-4)
    assert bsdf["roughness"] == close_to(0.001**0.5, rtol=0.0, atol=1e-4)
    assert done.energy < 0.05
    mirror = {**GREY, "nodes": 8, "base": {"kind": "mirror", "index": [0.2, 3.0]}}
    with pytest.raises(vrte.SceneError, match=r"a \.json cannot hold the beam .*: its model has one smooth surface"):
        vrte.export(mirror, tmp_path / "b.json", VISIBLE)
