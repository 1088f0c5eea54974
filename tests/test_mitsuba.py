"""The table for Mitsuba 3: its splines, its container, what Mitsuba reads from it; Mitsuba's own dielectric above
such a table: closed forms rendered, and what cannot be nested; its rough surfaces beside ours."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte import SceneError, Spectrum
from vrte.basics.arrays import Array
from vrte.calls.spectrum import prepare_scenes
from vrte.exports.export import FORMATS, GAP, list_beams, take_off_surface, write_nested_scene
from vrte.exports.lobes import follow_mueller
from vrte.exports.polarized import tabulate_polarized
from vrte.formats.measured_polarized import directions, make_unit_vectors, read_tensors, write_tensors
from vrte.formats.scene_file import make_scene_file
from vrte.optics.facets import RoughSurface
from vrte.optics.fresnel import reflect_smooth, transmit_smooth
from vrte.optics.spheres import spheres

from .helpers import assert_close

WAVELENGTHS = [0.45, 0.5, 0.55, 0.6, 0.65]
ALBEDO, INDEX = 0.5, 1.5
GREY: dict[str, Any] = {
    "nodes": 4,
    "layer": [{"phase": "isotropic", "albedo": 1.0, "thickness": 0.0}],
    "base": {"kind": "lambertian", "albedo": ALBEDO},
    "brdf": {"mu_i": 0.5, "mu_o": 0.5},
}
GOLD = GREY | {
    "nodes": 16,
    "particles": {"gold": {"index": "gold", "radius_um": 0.2}},
    "layer": [{"particles": "gold", "thickness": 5.0}],
}


@pytest.fixture(scope="module")
def gold() -> Spectrum:
    """Five wavelengths, the first and the last of them solved, at the directions of a table."""
    first, last = vrte.spectrum(GOLD, [0.45, 0.65], **directions(32, 37))
    return Spectrum(WAVELENGTHS, (first, first, first, last, last))


@pytest.fixture
def mitsuba() -> Any:
    found = pytest.importorskip("mitsuba")
    found.set_variant("scalar_spectral_polarized")
    return found


def random_directions(count: int, seed: int, lowest: float = 0.0) -> Array:
    """Unit vectors (count, 3) of the upper hemisphere, evenly spread over it."""
    random = np.random.default_rng(seed)
    return make_unit_vectors(random.uniform(lowest, 1.0, count), random.uniform(-np.pi, np.pi, count))


def test_what_is_no_table_is_refused(gold: Spectrum, tmp_path: Path) -> None:
    for spectrum, step, words in (
        (gold.at([0.45, 0.5]), 5, "exactly 5 wavelengths, not 2"),
        (Spectrum(np.add(WAVELENGTHS, 0.0005), gold.brdfs), 5, "whole nanometres"),
        (gold, 0, r"step_deg must be between 0\.5 and 15 degrees, not 0"),
    ):
        with pytest.raises(SceneError, match=words):
            tabulate_polarized(spectrum, [None] * len(spectrum), step)
    with pytest.raises(SceneError, match="a must be real numbers of a plain type, not complex128"):
        write_tensors({"a": np.zeros(2, complex)}, tmp_path / "a.bsdf")
    assert not list(tmp_path.iterdir())


FIELDS = {
    "a": np.arange(6, dtype=np.float32).reshape(1, 2, 3),
    "wvls": np.array([450, 650], np.uint16),
    "none": np.zeros((0, 3)),
    "ü": np.array(7, np.int64),
}


def test_tensors_come_back_and_any_damage_is_one_sentence(tmp_path: Path) -> None:
    """Cut anywhere; or with a bit of the head flipped: refused, or read as what it then says."""
    write_tensors(FIELDS, tmp_path / "a.bsdf")
    found = read_tensors(tmp_path / "a.bsdf")
    assert list(found) == list(FIELDS)
    for name, array in FIELDS.items():
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array, strict=True)
    whole, path = (tmp_path / "a.bsdf").read_bytes(), tmp_path / "damaged.bsdf"
    cuts, reported = [whole[:end] for end in range(len(whole))], []
    flips = ((index, 1 << bit) for index in range(130) for bit in (0, 5, 7))
    damaged = (whole[:index] + bytes([whole[index] ^ flip]) + whole[index + 1 :] for index, flip in flips)
    for content in (*cuts, *damaged):
        path.write_bytes(content)
        try:
            read_tensors(path)
            assert len(content) == len(whole)
        except SceneError as error:
            reported.append(str(error))
    assert len(reported) > len(cuts) + 50
    assert all(words.startswith(str(path)) and words.isprintable() for words in reported)
    with pytest.raises(SceneError, match=r"longer than the 1e-07 GB that are read"):
        read_tensors(tmp_path / "a.bsdf", most_bytes=1e2)


def in_stokes_basis(mitsuba: Any, travel: Array) -> Array:
    """The rotation (4, 4) from our meridian plane of a direction of travel to Mitsuba's basis of it. Mitsuba's x axis
    is `stokes_basis`, its y axis k x x, S1 = |Ex|^2 - |Ey|^2, S2 = 2 Re(Ex Ey*); in ours r x l = k: U changes sign."""
    x_axis = np.array(mitsuba.mueller.stokes_basis(mitsuba.Vector3f(*travel)))
    azimuth = np.arctan2(travel[1], travel[0])
    meridian = np.array([travel[2] * np.cos(azimuth), travel[2] * np.sin(azimuth), -np.hypot(travel[0], travel[1])])
    # the angle from l to the x axis, growing from l to r
    double = 2.0 * np.arctan2(x_axis @ np.cross(meridian, travel), x_axis @ meridian)
    turned = np.eye(4)
    turned[1:3, 1:3] = [[np.cos(double), np.sin(double)], [-np.sin(double), np.cos(double)]]
    return np.diag([1.0, 1.0, -1.0, 1.0]) @ turned


def evaluated(mitsuba: Any, bsdf: Any, light: Array, view: Array, nanometres: float | None = None) -> Array:
    """Mitsuba's BSDF (4, 4), (3,) of a variant without polarization, times the cosine of the light's direction."""
    at = mitsuba.SurfaceInteraction3f()
    at.wi, at.sh_frame = mitsuba.Vector3f(*view), mitsuba.Frame3f(mitsuba.Vector3f(0, 0, 1))
    if nanometres is None:
        return np.array(bsdf.eval(mitsuba.BSDFContext(), at, mitsuba.Vector3f(*light)))
    at.wavelengths = 4 * [nanometres]
    return np.array(bsdf.eval(mitsuba.BSDFContext(), at, mitsuba.Vector3f(*light)))[..., 0]


@pytest.mark.parametrize(
    ("place", "nanometres", "step", "median", "most"),
    [
        (0, 450.0, 5.0, 0.013, 0.06),
        pytest.param(4, 650.0, 5.0, 0.006, 0.03, marks=pytest.mark.slow),
        pytest.param(4, 650.0, 2.5, 0.0015, 0.01, marks=pytest.mark.slow),
    ],
)
def test_evaluations_are_ours(
    place: int, nanometres: float, step: float, median: float, most: float, mitsuba: Any, gold: Spectrum,
    tmp_path: Path,
) -> None:  # fmt: skip
    """The bounds are those of linear interpolation: a quarter at half the step. Each element by itself, too, so
    that no small one can have the wrong sign."""
    tabulate_polarized(gold, [None] * 5, step).write(tmp_path / "gold.pbsdf", "gold")
    bsdf = mitsuba.load_dict({"type": "measured_polarized", "filename": str(tmp_path / "gold.pbsdf")})
    light, view = random_directions(500, 1, 0.15), random_directions(500, 2, 0.15)
    matrices = follow_mueller(gold[place], None)(light, view)
    before, after = ([in_stokes_basis(mitsuba, one) for one in some] for some in (-light, view))
    ours = light[:, 2, None, None] * (np.array(after) @ matrices @ np.swapaxes(before, 1, 2))
    off = np.abs([evaluated(mitsuba, bsdf, *pair, nanometres) for pair in zip(light, view, strict=True)] - ours)
    relative = off.max(axis=(1, 2)) / ours[:, 0, 0]
    assert np.median(relative) < median
    assert np.quantile(relative, 0.95) < most
    assert ((off**2).mean(axis=0) < 0.1 * (ours**2).mean(axis=0)).all()


def test_the_sign_of_v(mitsuba: Any) -> None:
    """A sphere that is large and opaque reflects as its surface does, a mirror at half the supplement of the
    scattering angle: our scattering matrix against Mitsuba's of a conductor, in axes perpendicular to the plane."""
    index = 1.5 + 1.0j
    ball = spheres((index.real, index.imag), radius_um=160.0, wavelength_um=0.5)
    axes = np.outer([1.0, -1.0, 1.0, 1.0], [1.0, -1.0, 1.0, 1.0])
    for angle in (60.0, 90.0, 120.0):
        ours = ball.phase_matrix.scattering_matrix(angle)
        cosine = float(np.cos(np.radians(0.5 * (180.0 - angle))))
        mirror = np.array(mitsuba.mueller.specular_reflection(cosine, mitsuba.Complex2f(index)))
        assert_close(axes * ours / ours[0, 0], mirror / mirror[0, 0], rtol=0.0, atol=2e-3)
        assert abs(mirror[3, 2] / mirror[0, 0]) > 0.1


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
    fraction = ALBEDO * (1.0 - inside) / (1.0 - ALBEDO * inside)
    found = (reflect_smooth(INDEX, mu) + fraction * transmit_smooth(INDEX, mu))[:, :, 0]
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
def test_mitsuba_renders_what_vrte_finds(
    mitsuba: Any, content: Any, expected: Callable[[Array], Any], tmp_path: Path
) -> None:
    """A table of what lies below, and Mitsuba's own surface, against a closed form and against vrte's surface."""
    grey = vrte.spectrum(content, WAVELENGTHS, **directions(24, 9))
    tabulate_polarized(grey, [None] * 5, 5.0).write(tmp_path / "grey.pbsdf", "grey")
    write_nested_scene(tmp_path / "grey.xml", tmp_path / "grey.pbsdf", 1.0, INDEX)
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
    index = (2.0 * np.arange(count) + 1.0) / count - 1.0
    across, up = np.meshgrid(index * np.tan(np.radians(12.0)), -index * np.tan(np.radians(12.0)))
    slope = across**2 + up**2
    # a ray from (0, -5, 0) meets the ball where its square has a root; mu is that of the ball's normal
    root = 25.0 - 24.0 * (1.0 + slope)
    ball = (5.0 - np.sqrt(np.maximum(root, 0.0))) / (1.0 + slope)
    return across, up, np.where(root > 0.0, (5.0 - ball * (1.0 + slope)) / np.sqrt(1.0 + slope), 1e-8)


def prepare(*layers: dict[str, Any], **more: Any) -> Any:
    """The scenes at the wavelengths of a table."""
    content = GREY | {"layer": list(layers)} | more
    return prepare_scenes(content, np.array(WAVELENGTHS))[0]


@pytest.mark.parametrize(
    ("layers", "words"),
    [
        ([GREY["layer"][0]], "an interface on top, and here is none"),
        ([{"interface": BINDER["interface"] | {"roughness": 0.1}}, GREY["layer"][0]], "a rough one is in the table"),
        ([{"interface": {"above": 1.0, "below": "silica"}}, GREY["layer"][0]], "a surface of one index, .* not 1/1.4"),
    ],
)
def test_what_cannot_be_nested_is_refused(layers: list[dict[str, Any]], words: str) -> None:
    with pytest.raises(vrte.SceneError, match=words):
        take_off_surface(prepare(*layers))
    grey, kind = vrte.spectrum(GREY, WAVELENGTHS), FORMATS[".pbsdf"]
    assert not list_beams(grey, kind, Path("a.pbsdf"), nested=False, diffuse=False)
    mirrored = vrte.Spectrum(WAVELENGTHS, [replace(one, specular=[0.01 * np.eye(4)]) for one in grey])
    with pytest.raises(vrte.SceneError, match=r"up to 0\.01 of it comes back as a beam from below"):
        list_beams(mirrored, kind, Path("a.pbsdf"), nested=True, diffuse=False)
    with pytest.raises(vrte.SceneError, match="illuminate must be 'top'"):
        vrte.export(GREY, "a.pbsdf", nested=True, illuminate="bottom")


def test_the_gap_is_wider_than_mitsubas_rays_start_off(tmp_path: Path) -> None:
    write_nested_scene(tmp_path / 'odd "&.xml', tmp_path / 'odd "&.bsdf', 1.0, INDEX)
    from xml.etree import ElementTree

    found = ElementTree.parse(tmp_path / 'odd "&.xml')
    strings = [each.get("value") for each in found.iter("string")]
    assert strings == ['odd "&.bsdf']
    assert [float(each.get("value", "")) for each in found.iter("float")] == [1.0, INDEX, 1.0, 1.0 - GAP]


@pytest.mark.slow
@pytest.mark.parametrize("distribution", ["beckmann", "ggx"])
@pytest.mark.parametrize(
    ("into", "through", "below"),
    [(1.5, False, False), (1.5, False, True), (1.5, True, False), (1.5, True, True), (0.2 + 3.0j, False, False)],
)
def test_rough_surfaces(mitsuba: Any, distribution: str, into: complex, through: bool, below: bool) -> None:
    """Intensities of its roughdielectric and roughconductor, direction by direction. Its shadowing of Beckmann's facets
    is a rational fit of Smith's, within 0.4 %; GGX's agrees to single precision."""
    mitsuba.set_variant("scalar_rgb")
    rng = np.random.default_rng(3)
    mu_i, mu_o = rng.uniform(0.1, 1.0, (2, 300))
    phi = rng.uniform(0.0, 60.0, 300)
    turn, spread = np.radians(phi), (np.sqrt(1.0 - mu_i**2), np.sqrt(1.0 - mu_o**2))
    # towards the light: against its travel, which heads for phi = 0
    light = np.stack([-spread[0], 0.0 * mu_i, mu_i], axis=1)
    eye = np.stack([spread[1] * np.cos(turn), spread[1] * np.sin(turn), -mu_o if through else mu_o], axis=1)
    bsdf = {"type": "roughdielectric", "int_ior": 1.5, "ext_ior": 1.0, "alpha": 0.25, "distribution": distribution}
    if into.imag:
        bsdf = {"type": "roughconductor", "eta": 0.2, "k": 3.0, "alpha": 0.25, "distribution": distribution}
    indices = (into, 1.0) if below else (1.0, into)
    surface = RoughSurface(*indices, 0.25, distribution, shadowing=True)
    mirror = np.array([1.0, 1.0, -1.0 if below else 1.0])
    made = mitsuba.load_dict(bsdf)
    pairs = zip(light * mirror, eye * mirror, strict=True)
    expected = np.array([evaluated(mitsuba, made, *pair).ravel()[0] for pair in pairs]) / np.abs(light[:, 2])
    found = (surface.transmit if through else surface.reflect)(mu_i, mu_o, phi)[:, 0, 0]
    seen = found > 1e-3 * found.max()
    assert seen.sum() > 30
    assert_close(found[seen], expected[seen], rtol=1e-4 if distribution == "ggx" else 1e-2, atol=0.0)
