"""Mitsuba's own dielectric above a table of what lies below it: closed forms rendered, and what cannot be nested."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.basics.arrays import Array
from vrte.calls.mitsuba import check_below_surface, check_nested, take_off_surface
from vrte.calls.spectrum import prepare_scenes
from vrte.formats import between_directions, measured_polarized
from vrte.formats.mitsuba_scene import GAP, write_nested_scene
from vrte.formats.mitsuba_tensor import read_tensors
from vrte.formats.scene_file import make_scene_file
from vrte.optics.fresnel import reflect_smooth, transmit_smooth

WAVELENGTHS = [0.45, 0.5, 0.55, 0.6, 0.65]
ALBEDO, INDEX = 0.5, 1.5
GREY: dict[str, Any] = {
    "nodes": 4,
    "layer": [{"phase": "isotropic", "albedo": 1.0, "thickness": 0.0}],
    "base": {"kind": "lambertian", "albedo": ALBEDO},
    "brdf": {"mu_i": 0.5, "mu_o": 0.5},
}
HAZE = GREY | {"nodes": 12, "layer": [{"phase": "rayleigh", "albedo": 0.95, "thickness": 1.0}]}
BINDER = {"interface": {"above": 1.0, "below": INDEX}}
EXTRA = """
<integrator type="stokes"><integrator type="path"/></integrator>
<emitter type="constant"><spectrum name="radiance" type="uniform"><float name="value" value="1.0"/></spectrum></emitter>
<sensor type="perspective"><float name="fov" value="24"/>
<transform name="to_world"><lookat origin="0, -5, 0" target="0, 0, 0" up="0, 0, 1"/></transform>
<sampler type="independent"><integer name="sample_count" value="{count}"/></sampler>
<film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="32"/>
<rfilter type="box"/><string name="pixel_format" value="luminance"/></film></sensor>
"""


def under_glass(mu: Array) -> tuple[Array, Array]:
    """I and Q that leave a grey Lambertian thing under a smooth surface, under an even sky of radiance 1: what is
    mirrored, and what gets in, comes back ALBEDO / (1 - ALBEDO r_i) times and gets out (Walsh: r_e of index 1.5)."""
    inside = 1.0 - (1.0 - 0.0917780) / INDEX**2
    share = ALBEDO * (1.0 - inside) / (1.0 - ALBEDO * inside)
    found = (reflect_smooth(INDEX, mu) + share * transmit_smooth(INDEX, mu))[:, :, 0]
    return found[:, 0], found[:, 1]


def under_haze(mu: Array) -> tuple[Array, Array]:
    """The same of HAZE, solved under its surface by vrte itself."""
    scene = make_scene_file(HAZE | {"layer": [BINDER, *HAZE["layer"]]}).scene
    points, weights = vrte.hemisphere(24)
    light = vrte.brdf(scene, points, points, np.arange(0.0, 360.0, 45.0), accuracy=1e-5)
    found = light.under([1.0, 0.0, 0.0, 0.0], weights, mirrored=True)[:, 0]
    return np.interp(mu, points, found[:, 0]), np.interp(mu, points, found[:, 1])


@pytest.mark.slow
@pytest.mark.parametrize(("content", "expected"), [(GREY, under_glass), (HAZE, under_haze)], ids=["grey", "haze"])
def test_mitsuba_renders_what_vrte_finds(content: Any, expected: Callable[[Array], Any], tmp_path: Path) -> None:
    """A table of what lies below, and Mitsuba's own surface, against a closed form and against vrte's surface."""
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("scalar_spectral_polarized")
    grey = vrte.spectrum(content, WAVELENGTHS, **between_directions.directions(24, 9))
    measured_polarized.write_mitsuba(grey, tmp_path / "grey.bsdf", 5.0)
    write_nested_scene(tmp_path / "grey.xml", tmp_path / "grey.bsdf", 1.0, INDEX)
    text = (tmp_path / "grey.xml").read_text().replace("</scene>", EXTRA.format(count=512) + "</scene>")
    (tmp_path / "picture.xml").write_text(text)
    picture = np.array(mitsuba.render(mitsuba.load_file(str(tmp_path / "picture.xml"))))
    picture = picture[:, :, -12:].reshape(32, 32, 4, 3) @ [0.2126, 0.7152, 0.0722]  # luminance, 1 of the sky
    across, up, mu = see_ball(32)
    angle = np.arctan2(up, across)
    radial = picture[..., 1] * np.cos(2.0 * angle) + picture[..., 2] * np.sin(2.0 * angle)
    finer = see_ball(32 * 8)[2]  # a picture's value is a mean over a pixel
    wanted = [part.reshape(32, 8, 32, 8).mean(axis=(1, 3)) for part in expected(finer.ravel())]
    for low, high in ((0.95, 1.0), (0.8, 0.95), (0.6, 0.8), (0.4, 0.6)):
        here = (mu > low) & (mu < high)
        for found, right in zip((picture[..., 0], radial), wanted, strict=True):
            off = (found - right)[here]
            assert abs(off.mean()) < 3.0 * off.std() / np.sqrt(off.size) + 1e-3


def see_ball(count: int) -> tuple[Array, Array, Array]:
    """Slopes of rays through pixels (count, count), across and up, and the cosine at which each sees the ball, 1e-8
    where it does not."""
    place = (2.0 * np.arange(count) + 1.0) / count - 1.0
    across, up = np.meshgrid(place * np.tan(np.radians(12.0)), -place * np.tan(np.radians(12.0)))
    slope = across**2 + up**2
    # a ray from (0, -5, 0) meets the ball where its square has a root; mu is that of the ball's normal
    root = 25.0 - 24.0 * (1.0 + slope)
    ball = (5.0 - np.sqrt(np.maximum(root, 0.0))) / (1.0 + slope)
    return across, up, np.where(root > 0.0, (5.0 - ball * (1.0 + slope)) / np.sqrt(1.0 + slope), 1e-8)


def prepare(*layers: dict[str, Any], **more: Any) -> Any:
    """The scenes at the wavelengths of a table."""
    content = GREY | {"layer": list(layers)} | more
    return prepare_scenes(content, np.array(WAVELENGTHS))[0]


def test_the_surface_is_taken_off() -> None:
    files = prepare(BINDER, {"phase": "rayleigh", "albedo": 0.9, "thickness": 1.0})
    indices, below = take_off_surface(files)
    assert indices == (1.0, INDEX)
    for file in below:
        assert not file.scene.has_interfaces
        assert file.scene.indices == (INDEX,)
        assert (file.scene.base, file.scene.thickness) == (vrte.Lambertian(ALBEDO), 1.0)


@pytest.mark.parametrize(
    ("layers", "words"),
    [
        ([GREY["layer"][0]], "an interface on top, and here is none"),
        ([{"interface": BINDER["interface"] | {"roughness": 0.1}}, GREY["layer"][0]], "knows no polarization"),
        ([{"interface": {"above": 1.0, "below": "silica"}}, GREY["layer"][0]], "a surface of one index, .* not 1/1.4"),
    ],
)
def test_what_cannot_be_nested_is_refused(layers: list[dict[str, Any]], words: str) -> None:
    with pytest.raises(vrte.SceneError, match=words):
        take_off_surface(prepare(*layers))


def test_a_beam_from_below_is_refused() -> None:
    grey = vrte.spectrum(GREY, WAVELENGTHS)
    check_below_surface(grey)
    mirrored = vrte.Spectrum(WAVELENGTHS, [replace(one, specular=[0.01 * np.eye(4)]) for one in grey])
    with pytest.raises(vrte.SceneError, match=r"up to 0\.01 of it comes back as a beam from below"):
        check_below_surface(mirrored)
    for path, asked, words in (("a.xml", {}, "another ending"), ("a.bsdf", {"illuminate": "bottom"}, "on top")):
        with pytest.raises(vrte.SceneError, match=words):
            check_nested(path, asked)


def test_a_table_says_what_it_leaves_out(tmp_path: Path) -> None:
    """And is the same as without."""
    plain = vrte.spectrum(GREY, WAVELENGTHS, **between_directions.directions(8, 8))
    glossy = vrte.Spectrum(WAVELENGTHS, [replace(one, specular=reflect_smooth(INDEX, one.mu_i)) for one in plain])
    for name, result in (("plain", plain), ("glossy", glossy)):
        measured_polarized.write_mitsuba(result, tmp_path / name, 15.0)
    found = {name: read_tensors(tmp_path / name) for name in ("plain", "glossy")}
    np.testing.assert_array_equal(found["plain"]["M"], found["glossy"]["M"])
    words = {name: fields["description"].tobytes().decode() for name, fields in found.items()}
    assert re.search(r"mirrored: left out is the mirrored beam, 0\.04\d* of the light at mu_i 0\.988", words["glossy"])
    assert "mirrored: " not in words["plain"]


def test_the_gap_is_wider_than_mitsubas_rays_start_off(tmp_path: Path) -> None:
    write_nested_scene(tmp_path / 'odd "&.xml', tmp_path / 'odd "&.bsdf', 1.0, INDEX)
    from xml.etree import ElementTree

    found = ElementTree.parse(tmp_path / 'odd "&.xml')
    strings = [each.get("value") for each in found.iter("string")]
    assert strings == ['odd "&.bsdf']
    assert [float(each.get("value", "")) for each in found.iter("float")] == [1.0, INDEX, 1.0, 1.0 - GAP]
