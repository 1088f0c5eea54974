"""Pictures that Mitsuba traces: beside our own renderer, in furnaces, in an environment, as EXR; what is refused."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import binary_erosion

from vrte.render.geometry import find_shape
from vrte.render.rendering import Rendering, compute_pictures, read
from vrte.render.sky import make_film, weigh_wavelengths
from vrte.render.tables import Resolution
from vrte.render.tracing import Tracing, is_ready, spread_colours

from .helpers import assert_close, close_to, run

WHITE = '[[layer]]\nphase = "isotropic"\nalbedo = 1.0\nthickness = inf\n'
HAZE = '[[layer]]\nphase = "rayleigh"\nalbedo = 0.95\nthickness = 1.0\n[base]\nkind = "lambertian"\nalbedo = 0.3\n'
GLOSS = "host_index = 1.5\n{}[[layer]]\ninterface = {{ above = 1.0, below = 1.5 }}\n" + HAZE
SATIN = GLOSS.replace("below = 1.5 }}", 'below = 1.5, roughness = 0.2, distribution = "ggx" }}')

BLOCK = ["2 4 3 1", "5 7 8 6", "5 6 2 1", "4 8 7 3", "3 7 5 1", "6 8 4 2"]

needs_mitsuba = pytest.mark.skipif(not is_ready(), reason="no Mitsuba, or no LLVM that it works with")


def write(folder: Path, content: str, render: str) -> Path:
    """A scene file with a table [render], at one wavelength unless that says others."""
    path = folder / "scene.toml"
    render = f"[render]\n{render}\n" + ("" if "wavelengths" in render else "wavelengths_um = [0.55]\n")
    path.write_text(content.format(render) if "{}" in content else render + content)
    return path


def draw(
    path: Path, samples: int, size: int = 48, environment: Path | None = None, caustics: bool = False
) -> tuple[Rendering, Any, Any]:
    """The traced picture, its materials and its setting."""
    materials, setting = read([path])
    setting = replace(setting, size_px=size)
    (found,) = compute_pictures(materials, setting, tracing=Tracing(samples, environment, caustics))
    return found, materials, setting


def write_block(path: Path, high: float) -> None:
    """A block of two by two, so high."""
    corners = [(x, y, z) for x in (0, 2) for y in (0, 2) for z in (0, high)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {face}" for face in BLOCK]
    path.write_text("\n".join(lines))


SHAPES = [
    ("ball", HAZE),
    *(pytest.param("ball", one, marks=pytest.mark.slow) for one in (SATIN, GLOSS)),
    *(pytest.param(one, HAZE, marks=pytest.mark.slow) for one in ("cube.obj", "plate.obj")),
]


@needs_mitsuba
@pytest.mark.parametrize(("shape", "content"), SHAPES)
def test_a_convex_body_is_that_of_our_own_renderer(shape: str, content: str, tmp_path: Path) -> None:
    """On black ground, where no light goes from object to object: to 1 % of the mean, in I, Q and U, in nine parts of
    the picture; the sky is seen in the smooth surface, too. The sun's image in it is the same in both."""
    write_block(tmp_path / "cube.obj", 2.0)
    write_block(tmp_path / "plate.obj", 0.02)
    path = write(
        tmp_path, content, f'object = "{shape}"\nturn_deg = 20\nground_albedo = 0.0\ncamera_elevation_deg = 35'
    )
    traced, materials, setting = draw(path, 512)
    (own,) = compute_pictures(materials, setting, resolutions=[Resolution(24, 72, 32)])
    body = binary_erosion(traced.body >= 0)  # without the outline, which may have other samples
    scale = np.median(own.stokes[..., 0][body])
    bright = body & (np.maximum(traced.stokes[..., 0], own.stokes[..., 0]) > 20.0 * scale)
    assert bright.sum() == (1 if content == GLOSS else 0)
    assert_close(traced.stokes[bright], own.stokes[bright], rtol=0.02, atol=0.05 * scale)
    for part in np.array_split(np.flatnonzero(body & ~bright), 9):
        for parameter in range(3):
            first, second = (one.stokes.reshape(-1, 4)[part, parameter].mean() for one in (traced, own))
            assert abs(first - second) < 0.01 * scale + 0.01 * abs(second)
    assert traced.noise is not None
    assert traced.noise < 0.05


@needs_mitsuba
def test_a_white_knot_vanishes_in_a_furnace(tmp_path: Path) -> None:
    """Light that goes from one of its parts to another counts, and from the ground."""
    found, _, _ = draw(write(tmp_path, WHITE, 'object = "knot"\nsky = "uniform"'), 128)
    assert_close(found.stokes[..., 0].mean(), 1.0, rtol=3e-3, atol=0.0)
    assert np.quantile(np.abs(found.stokes[..., 0] - 1.0), 0.9) < 0.05
    assert np.abs(found.stokes[..., 1:].mean(axis=(0, 1))).max() < 2e-3


@needs_mitsuba
def test_light_that_mirrors_send_to_other_things_is_all_that_is_left_out(tmp_path: Path) -> None:
    """Of a matt ball nothing. A black lacquered one sends 1 % of the light of white ground back to it; with that, three
    times the noise is left."""
    mirror = GLOSS.replace("albedo = 0.95", "albedo = 0.0").replace("albedo = 0.3", "albedo = 0.0")
    for content, samples in ((HAZE, 256), (mirror, 2048)):
        path = write(tmp_path, content, 'object = "ball"\nground_albedo = 0.8')
        without, followed = (draw(path, samples, 32, caustics=caustics)[0] for caustics in (False, True))
        mean, with_them = (one.stokes[..., 0][one.body < 0].mean() for one in (without, followed))
        if content is HAZE:
            assert mean == close_to(with_them, rtol=1e-5, atol=0.0)
        else:
            assert 0.0 < (with_them - mean) / mean < 0.03
            assert without.noise is not None
            assert followed.noise is not None
            assert without.noise < 0.5 * followed.noise


def test_colours_of_an_environment_come_back() -> None:
    wavelengths = np.linspace(0.4, 0.7, 9)
    observer = weigh_wavelengths(wavelengths)
    film = make_film(observer.sum(axis=1))
    spectra = spread_colours(film, observer)
    assert_close(film.linear(spectra @ observer.T), np.eye(3), rtol=0.0, atol=1e-9)
    assert_close(spectra.sum(axis=0), 1.0, rtol=0.0, atol=1e-9)


@needs_mitsuba
def test_an_environment(tmp_path: Path) -> None:
    """Of one colour: a white ball has it, too. Of a bright upper half: the ball's top is bright, its lower side not."""
    import mitsuba

    mitsuba.set_variant("scalar_rgb")
    even, half = tmp_path / "even.exr", tmp_path / "half.exr"
    pixels = np.ones((16, 32, 3), np.float32) * np.float32([0.9, 0.6, 0.5])
    mitsuba.Bitmap(pixels).write(str(even))
    pixels[8:] = 0.0
    mitsuba.Bitmap(pixels).write(str(half))
    path = write(tmp_path, WHITE, 'object = "ball"\nwavelengths_um = [0.41, 0.45, 0.49, 0.53, 0.57, 0.61, 0.65, 0.69]')
    found, _, _ = draw(path, 32, 32, even)
    colour = found.film.linear(found.xyz)
    assert_close(colour.mean(axis=(0, 1)), [0.9, 0.6, 0.5], rtol=0.01, atol=0.0)
    found, _, _ = draw(path, 32, 32, half)
    body = found.body >= 0
    rows = [found.xyz[row, body[row], 1].mean() for row in np.flatnonzero(body.any(axis=1))]
    assert rows[1] > 4.0 * rows[-2]
    with pytest.raises(Exception, match="not an image that Mitsuba reads"):
        draw(path, 32, 32, path)


@needs_mitsuba
def test_an_exr_file_and_an_own_mesh_whose_y_axis_points_up(tmp_path: Path) -> None:
    import mitsuba

    mesh = tmp_path / "box.obj"
    write_block(mesh, 0.02)
    assert_close(np.ptp(find_shape(str(mesh), "y").corners, axis=0), [1.0, 0.01, 1.0], rtol=1e-6, atol=0.0)
    path = write(tmp_path, HAZE, "")
    picture = tmp_path / "box.exr"
    assert run("render", path, "--object", mesh, "--up", "y", "--size", 32, "--samples", 4, "-o", picture) == 0
    image = mitsuba.Bitmap(str(picture))
    assert [image.struct_()[index].name for index in range(7)] == ["R", "G", "B", "S0", "S1", "S2", "S3"]
    pixels = np.array(image)
    assert pixels.shape == (32, 32, 7)
    assert (pixels[..., 3] > 0.0).mean() > 0.7  # few samples leave shadows black
    assert np.all(np.hypot(pixels[..., 4], pixels[..., 5]) <= pixels[..., 3] + 1e-5)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--samples 8", "--samples: a sphere by itself is not traced"),
        ("--tracer mitsuba", "--tracer mitsuba: a sphere by itself is not traced"),
        ("--object ball --tracer own --samples 8", "--samples: is for Mitsuba, not with --tracer own"),
        ("--object ball --up y", "--up: is of own meshes, and there is none"),
        ("--object ball --environment none.exr", "--environment: no such file: none.exr"),
        ("--object ball --tracer own --caustics", "--caustics: is for Mitsuba, not with --tracer own"),
        ("--object ball --caustics --environment scene.toml", "--caustics: are of the sun, and --environment has none"),
        (
            "--object ball --glare -o a.exr",
            "-o OUT.exr: holds radiances, neither a --sheet nor --colour-only nor --glare",
        ),
    ],
)
def test_what_is_not_traced_is_refused(
    options: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("mitsuba")
    path = write(tmp_path, HAZE, "")
    monkeypatch.chdir(tmp_path)
    assert run("render", path, *([] if " -o " in options else ["-o", "a.png"]), *options.split()) == 2
    assert words in capsys.readouterr().err
