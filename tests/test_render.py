"""Spheres and objects under a sky: closed forms, energy, frames against light worked out in space, mirrors, facets,
shadows, the sun's image, meshes, files."""

import os
import re
import subprocess
import sys
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte import cli
from vrte.appearance.colours import OBSERVERS, import_colour_science
from vrte.basics.arrays import Array
from vrte.basics.errors import MissingExtraError, SceneError
from vrte.optics.facets import RoughSurface
from vrte.optics.fresnel import reflect_smooth
from vrte.pictures.lobes import compute_lobe
from vrte.render import objects, rendering
from vrte.render.geometry import (
    SHAPES,
    Body,
    Camera,
    Lens,
    Rays,
    compute_normals,
    find_shape,
    make_ball,
    make_body,
    place_camera,
    place_lens,
)
from vrte.render.glare import find_spread, spread_glare
from vrte.render.objects import MARGIN, SUN_RADIUS, Stage, View, add_sun, draw_background, draw_object, mirror_sun
from vrte.render.picture import (
    ROUND,
    Scale,
    Sheet,
    colour_angles,
    describe_layers,
    draw_row,
    measure_degrees,
    round_up,
    scale_lobes,
    show_degrees,
)
from vrte.render.rendering import (
    LONGEST_TITLE,
    PictureSetting,
    Rendering,
    compute_pictures,
    find_facets,
    find_fine_table,
    measure_interpolation_error,
    read,
    set_out,
    set_stage,
    split_channels,
)
from vrte.render.sky import (
    Sky,
    choose_wavelengths,
    compute_optical_thickness,
    load_sunlight_spectrum,
    make_film,
    make_sky,
    weigh_wavelengths,
)
from vrte.render.surfaces import SceneLight, compute_irradiance
from vrte.render.tables import BrdfTable, Resolution, tabulate_brdf

from .helpers import assert_close, close_to

COARSE = Resolution(angles=20, azimuths=36, around=24, along=12, across=8)
WHITE = vrte.Scene([vrte.Layer(vrte.isotropic(), 0.5, 0.0)], vrte.Lambertian(1.0))
PLAIN = '[[layer]]\nphase = "rayleigh"\nalbedo = 1.0\nthickness = 2.0\n'
GALLERY = Path(vrte.__file__).parent / "app" / "gallery"


def table(scene: vrte.Scene, resolution: Resolution = COARSE, **how: Any) -> BrdfTable:
    """A BRDF as a picture has it: facets on top are kept by themselves."""
    found = vrte.brdf(scene, resolution.mu, resolution.mu, resolution.phi, **({"nodes": 12} | how))
    top = scene.interfaces[0]
    return tabulate_brdf(found, resolution, find_facets(found, None if top is None or top.is_smooth else top.facets))


def view(sky: Sky, size: int = 40, camera: Camera | None = None, resolution: Resolution = COARSE) -> View:
    return View(camera or place_camera(15.0, 50.0), sky, size, resolution)


def normals_of(seen: View) -> Array:
    return compute_normals(seen.camera, *seen.pixels[1:])


def draw(seen: View, here: BrdfTable) -> Array:
    """Stokes vectors (pixel, 4) of a sphere at the one wavelength of its sky."""
    return seen.stokes([here])[:, 0]


def spread(seen: View, here: BrdfTable) -> Array:
    """The same over the whole square picture (size, size, 4)."""
    flat = np.zeros((seen.size**2, 4))
    flat[seen.pixels[0]] = draw(seen, here)
    return flat.reshape(seen.size, seen.size, 4)


def rayleigh_layer(albedo: float, thickness: float, base: float | None = None) -> vrte.Scene:
    return vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo, thickness)], None if base is None else vrte.Lambertian(base))


def test_a_lambertian_sphere_is_flat_under_a_uniform_sky_and_obeys_lambert_in_the_sun() -> None:
    """Over black ground a tilted surface sees (1 + cos tilt)/2 of an even sky."""
    half = vrte.Scene(WHITE.layers, vrte.Lambertian(0.4))
    found = draw(view(make_sky("uniform", [0.5], 30.0, 0.0)), table(half))
    assert_close(found[:, 0], 0.4, rtol=2e-6, atol=0.0)
    assert np.abs(found[:, 1:]).max() < 1e-15
    seen = view(replace(make_sky("uniform", [0.5], 30.0, 0.0), ground=np.zeros(1)))
    assert_close(draw(seen, table(WHITE))[:, 0], 0.5 * (1.0 + normals_of(seen)[:, 2]), rtol=0.0, atol=2e-5)
    seen = view(make_sky("sun", [0.5], 35.0, 0.0))
    expected = np.maximum(-(normals_of(seen) @ seen.sky.beam), 0.0) / np.pi
    assert_close(draw(seen, table(WHITE))[:, 0], expected, rtol=0.0, atol=1e-6)


def test_irradiance_of_the_rayleigh_sky() -> None:
    """What a Lambertian sphere sends back, against a fine quadrature; on level ground, against that of the field."""
    sky, mu0 = make_sky("rayleigh", [0.45], 35.0, 0.3), np.sin(np.radians(35.0))
    seen = view(sky, resolution=replace(COARSE, along=20, across=14))
    found = draw(seen, table(WHITE, seen.resolution))[:, 0]
    some = np.arange(0, found.size, 97)
    expected = compute_irradiance(sky, normals_of(seen)[some], Resolution(along=60, across=60))[0] / np.pi
    assert_close(found[some], expected, rtol=2e-4, atol=0.0)
    air = vrte.Layer(vrte.rayleigh(0.0279), 1.0, float(compute_optical_thickness(0.45)))
    field = vrte.radiance(vrte.Scene([air], vrte.Lambertian(0.3)), mu0, mu=[], tau=air.thickness)
    below = field.flux_down[0] + field.direct[0]
    level = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    assert_close(compute_irradiance(sky, level)[0], [below, 0.3 * below], rtol=2e-5, atol=0.0)


def test_nothing_absorbs_so_nothing_shows_in_a_furnace() -> None:
    """Light the same from all sides, no absorption: no sphere can be told from its surroundings."""
    white = vrte.Lambertian(1.0)
    scattering = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.5, 24), 1.0, 3.0)], white)
    # what the surface mirrors and what leaves the layer below make up for each other at every angle
    shiny = vrte.Scene([vrte.Interface(1.0, 1.5), vrte.Layer(vrte.rayleigh(), 1.0, 1.0)], white)
    assert table(shiny).specular is not None
    for one in (scattering, shiny, rayleigh_layer(1.0, 0.2, 1.0)):
        found = draw(view(make_sky("uniform", [0.5], 30.0, 0.0)), table(one))
        assert np.abs(found - [1.0, 0.0, 0.0, 0.0]).max() < 2e-3


def dipoles(light: Array, toward: Array) -> Array:
    """Coherency (3, 3) that dipoles scatter along ``toward``, k: (1 - kk) C (1 - kk), mean 1 over the sphere."""
    across = np.eye(3) - np.outer(toward, toward)
    return 1.5 * across @ light @ across


def stokes_of(coherency: Array, camera: Camera) -> Array:
    """On the upright and the right of the picture; V is 2 Im E_r conj(E_l) for l, r = l x k, as the conventions say."""
    up, right = camera.up, camera.right
    uu, rr, ur = up @ coherency @ up, right @ coherency @ right, up @ coherency @ right
    return np.array([uu + rr, uu - rr, 2.0 * ur.real, -2.0 * ur.imag]).real


THIN = 1e-5  # so thin that light is scattered once: dipoles, without depolarization


@pytest.mark.parametrize("azimuth", [0.0, 50.0, 200.0])
def test_frames_of_sunlight_are_those_of_dipoles_in_space(azimuth: float) -> None:
    """Every pixel of a thin layer in the sun shows the same polarization, that of dipoles, without any frame."""
    sky = make_sky("sun", [0.5], 35.0, 0.0)
    seen = view(sky, camera=place_camera(20.0, azimuth))
    found = draw(seen, table(rayleigh_layer(1.0, THIN)))
    unpolarized = 0.5 * (np.eye(3) - np.outer(sky.beam, sky.beam))
    scattered = stokes_of(dipoles(unpolarized, seen.camera.toward), seen.camera)
    normal = normals_of(seen)
    mu_i, mu_o = -(normal @ sky.beam), normal @ seen.camera.toward
    clear = (mu_i > 0.1) & (mu_o > 0.1)
    expected = THIN / (4.0 * np.pi * mu_o[clear, None]) * scattered  # (1/4 pi) F tau/mu_o, times the irradiance 1
    assert clear.sum() > 50
    assert_close(found[clear], expected, rtol=0.0, atol=1e-3 * expected[:, 0].max())


def sky_coherency(sky: Sky, travel: Array) -> Array:
    """Coherency (n, 3, 3) of the sky's light along ``travel`` (n, 3); axes worked out anew from the vertical."""
    right = np.cross(travel, [0.0, 0.0, 1.0])  # r = l x k with l the polar unit vector, up to a common sign
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    along = np.cross(travel, right)
    i, q, u = sky.find(travel)[:, 0].T[..., None, None]
    ll, rr, lr = (a[:, :, None] * b[:, None] for a, b in ((along, along), (right, right), (along, right)))
    return 0.5 * ((i + q) * ll + (i - q) * rr + u * (lr + np.swapaxes(lr, 1, 2)))


def test_frames_of_skylight_are_those_of_dipoles_in_space() -> None:
    """A thin layer under the polarized sky, three pixels, against a sum over the sky of dipoles in space."""
    sky = replace(make_sky("rayleigh", [0.45], 25.0, 0.0), sun=np.zeros(1))
    seen = view(sky, camera=place_camera(20.0, 130.0), resolution=replace(COARSE, around=32, along=20, across=16))
    found, normal = draw(seen, table(rayleigh_layer(1.0, THIN), seen.resolution)), normals_of(seen)
    points, weights = np.polynomial.legendre.leggauss(20)
    theta, around = np.meshgrid(0.25 * np.pi * (points + 1.0), np.arange(72) * (2.0 * np.pi / 72), indexing="ij")
    source = np.stack([np.sin(theta) * np.cos(around), np.sin(theta) * np.sin(around), np.cos(theta)], axis=-1)
    solid_angle = 0.25 * np.pi * weights[:, None] * np.sin(theta) * (2.0 * np.pi / 72)
    light = sky_coherency(sky, -source.reshape(-1, 3)) * solid_angle.reshape(-1, 1, 1)
    for direction in (*np.eye(3)[[2, 0]], seen.camera.toward + 0.5 * seen.camera.right):
        pixel = int(np.argmax(normal @ direction))
        falls_in = light[source.reshape(-1, 3) @ normal[pixel] > 0.0].sum(axis=0)
        mu_o = float(normal[pixel] @ seen.camera.toward)
        scattered = stokes_of(dipoles(falls_in, seen.camera.toward), seen.camera)
        expected = THIN / (4.0 * np.pi * mu_o) * scattered
        assert_close(found[pixel], expected, rtol=0.0, atol=0.02 * expected[0])
        assert np.abs(expected[1:3]).max() > 0.1 * expected[0]  # polarized enough to tell


def test_the_sky_is_polarized_as_molecules_do_it_and_as_thick_as_it_is() -> None:
    """At right angles to the sun, across the plane of scattering."""
    sky = make_sky("rayleigh", [0.55], 20.0, 0.1)
    beyond_the_zenith = np.radians(20.0)  # the sun is 70 degrees on this side
    stokes = sky.find(np.array([[np.sin(beyond_the_zenith), 0.0, -np.cos(beyond_the_zenith)]]))[0, 0]
    assert 0.75 < -stokes[1] / stokes[0] < 0.95
    assert abs(stokes[2]) < 1e-9 * stokes[0]
    for wavelength in (0.4, 0.55, 0.7):
        expected = import_colour_science().phenomena.rayleigh_optical_depth(wavelength * 1e-4, latitude=45.0)
        assert compute_optical_thickness(wavelength) == close_to(float(np.squeeze(expected)), rtol=0.01, atol=0.0)


def test_colours_of_white_are_white() -> None:
    chosen = choose_wavelengths(9)
    weights = weigh_wavelengths(chosen)
    assert weights[1].sum() == close_to(1.0, rtol=1e-6, atol=0.0)
    white = weights.sum(axis=1)
    observer = import_colour_science().MSDS_CMFS[OBSERVERS[2]]
    lit = observer.values * load_sunlight_spectrum(observer.wavelengths * 1e-3)[:, None]
    assert_close(white, lit.sum(axis=0) / lit[:, 1].sum(), rtol=1e-12, atol=0.0)
    film = make_film(white)
    assert_close(film(white), 1.0, rtol=0.0, atol=2e-3)
    assert_close(film.linear(0.5 * white), 0.5, rtol=0.0, atol=1e-3)
    assert_close(make_film(white, -1.0).linear(white), 0.5, rtol=0.0, atol=1e-3)


@pytest.mark.slow
def test_colour_science_leaves_the_way_arrays_are_printed_alone() -> None:
    code = "import numpy; from vrte.render.sky import load_sunlight_spectrum as load; load(numpy.ones(1)); "
    show = [sys.executable, "-c", f"{code} print(repr(numpy.float64(1)))"]
    assert subprocess.run(show, capture_output=True, text=True, check=True).stdout == "np.float64(1.0)\n"


@pytest.mark.slow
def test_what_the_resolution_is_good_for() -> None:
    """Against twice as many of everything, as docs/how_to/render.md says; coarse gold at 0.4 um is a hard case."""
    gold = vrte.spheres("gold", radius_um=0.6, wavelength_um=0.4)
    scene, sky = vrte.Scene([vrte.Layer.of(gold, thickness=np.inf)]), make_sky("rayleigh", [0.4], 40.0, 0.2)
    usual, fine = (
        draw(view(sky, 96, place_camera(10.0, 50.0), chosen), table(scene, chosen, nodes=None, accuracy=1e-4))
        for chosen in (Resolution(), Resolution(56, 180, 96, 40, 28))
    )
    difference = np.abs(usual - fine) / fine[:, 0].max()
    assert difference.max() < 3e-3
    assert np.sqrt((difference**2).mean(axis=0)).max() < 3e-4


SMALL = "[render]\nsize_px = 48\nwavelengths_um = [0.45, 0.55, 0.65]\n"


class Command:
    """`vrte render` with few directions, in a folder of its own."""

    def __init__(self, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.folder, self.capsys, self.picture = folder, capsys, folder / "out.png"

    def scene(self, text: str, name: str = "one") -> Path:
        path = self.folder / f"{name}.toml"
        path.write_text(text)
        return path

    def material(self, text: str, count: int | None = None) -> Any:
        """The material of a scene file."""
        ((found,), _) = read([self.scene(text)], count)
        return found

    def __call__(self, *arguments: str | Path, code: int = 0) -> str:
        """What it says, in one line where it fails; then there is no picture."""
        assert cli.main(["render", *map(str, arguments), "-o", str(self.picture)]) == code
        printed = self.capsys.readouterr()
        assert self.picture.exists() == (code == 0)
        assert printed.err.count("\n") == (1 if code else 0)
        return printed.err if code else printed.out

    @property
    def pixels(self) -> Array:
        from PIL import Image

        with Image.open(self.picture) as image:
            return np.asarray(image)


@pytest.fixture
def render(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Command:
    few = partial(compute_pictures, resolutions=[Resolution(12, 24, 16, 8, 6)])
    monkeypatch.setattr(rendering, "compute_pictures", few)
    return Command(tmp_path, capsys)


def test_render_writes_what_it_says(render: Command) -> None:
    two = render.scene(PLAIN + SMALL, "two")
    printed = render(render.scene(PLAIN), two)
    assert "one: 9 wavelengths, 0.4 to 0.7 µm" in printed
    assert "two: 3 wavelengths, 0.45 to 0.65 µm" in printed
    assert re.search(r"wrote .*out\.png", printed)
    assert render.pixels.shape[1] == Sheet(48, [("one", ""), ("two", "")], 4, 0.56, note="").width
    render(two, two, "--colour-only", "--size", "32")
    pixels = render.pixels
    assert pixels.shape == (32, 64, 4)
    assert (pixels[0, 0, 3], pixels[16, 16, 3]) == (0, 255)
    # a layer that absorbs nothing is no coloured one: lit from the left above, it is nearly as neutral as the light
    assert pixels[10, 10, :3].min() > 100


def test_the_note_below_a_sheet_and_the_captions_of_its_rows_are_not_cut() -> None:
    for words in (3, 40, 120):
        captions = [(("W painted metal " * 4)[:LONGEST_TITLE], " ".join(["hematite"] * words)), ("rutile", "")]
        sheet = Sheet(300, captions, 4, 0.20, note=" ".join(["wavelengths"] * words))
        (note,) = (text for text in sheet.figure.texts if "wavelengths" in text.get_text())
        box = note.get_window_extent()
        assert 0.0 <= box.x0 < box.x1 <= sheet.width
        assert 0.0 <= box.y0 < box.y1 < sheet.foot - 0.17 * 300  # where the legends end
        title, caption = (text for text in sheet.figure.texts if text.get_text()[:1] in ("W", "h"))
        above, below = title.get_window_extent(), caption.get_window_extent()
        assert max(above.x1, below.x1) <= sheet.width
        assert above.y0 >= below.y1
        assert below.y0 >= sheet.height - sheet.corner(0, 0)[1]  # the row's pictures begin below


@pytest.mark.parametrize("power", [0.5, 1.0])
def test_ticks_of_a_legend_do_not_run_together(power: float) -> None:
    for high in np.outer([0.01, 0.1], ROUND).ravel():
        sheet = Sheet(220, [("", "")], 4, 0.20, note="")
        sheet.bar(1, Scale("inferno", 0.0, float(high), power))
        sheet.figure.canvas.draw()
        boxes = [label.get_window_extent() for label in sheet.figure.axes[-1].get_xticklabels()]
        assert len(boxes) >= 2
        for left, right in pairwise(sorted(boxes, key=lambda box: box.x0)):
            assert right.x0 - left.x1 > 0.2 * sheet.letter


def test_nothing_has_a_scale_of_its_own_noise() -> None:
    """Light that is not circularly polarized but for rounding: no panel is scaled to 1e-6."""
    assert [round_up(value) for value in (0.0, 1e-9, 1e-6)] == [0.01] * 3
    assert round_up(0.0123) == 0.015


def test_a_peaked_lobe_is_drawn_logarithmically() -> None:
    """A satin surface's lobe is a hundred times what its paint sends elsewhere, which would be a few pixels."""
    satin, _ = read([Path("examples/satin_paint.toml")])
    brdf = satin[0].brdf(
        0.64, np.array([0.6, 1.0]), np.cos(np.radians(np.linspace(0.0, 89.0, 24))), np.arange(0, 181, 6.0)
    )
    lobes = [compute_lobe(brdf, index, step_deg=2.0) for index in range(2)]
    circle, drawn, words = scale_lobes(lobes)
    assert np.median(lobes[0].radius) < 0.05 * circle
    assert np.median(drawn[0].radius) > 0.2 * circle
    assert f"middle {1e-3 * circle:g}, logarithmic" in words
    largest = float(lobes[0].radius.max())
    assert drawn[0].radius.max() == close_to(circle * (1.0 + np.log10(largest / circle) / 3.0), rtol=1e-12, atol=0.0)
    even = [replace(lobe, heights=1.0 + 0.1 * lobe.theta[:, None] / 90.0 + 0.0 * lobe.phi) for lobe in lobes]
    assert scale_lobes(even)[1:] == (even, "outer circle: $f_{00}$ = 1.5 sr$^{-1}$")


def lay_out(render: Command, *names: str) -> tuple[Rendering, Stage]:
    """A row of objects, grey and unpolarized, at one wavelength, and what stands there."""
    paths = [
        render.scene(PLAIN + "[render]\nsize_px = 48\nwavelengths_um = [0.5]\n", str(k)) for k in range(len(names))
    ]
    materials, setting = read(paths, shapes=list(names))
    stage = set_stage(materials, setting)
    grey = np.full((stage.lens.width * stage.lens.height, 6), 0.3) * [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]
    return set_out(Rendering(materials, *split_channels(grey, stage), make_film(np.ones(3)), [0.0]), stage), stage


def test_halves_of_an_object_are_the_whole(render: Command) -> None:
    """Cut along the middle of the picture, with the whole's surface, normals and shadows; each has its own title."""
    (found, halves), (alone, whole) = (lay_out(render, *names) for names in (("vase:left", "vase:right"), ("vase",)))
    assert_close(halves.lens.place, whole.lens.place, rtol=1e-9, atol=1e-9)
    left, right = (find_area(body) for body in halves.bodies)
    assert_close(left + right, find_area(whole.bodies[0]), rtol=1e-9, atol=0.0)
    assert left == close_to(right, rtol=0.02, atol=0.0)
    side = [body.corners @ halves.lens.camera.right for body in halves.bodies]
    assert side[0].max() == close_to(side[1].min(), rtol=0.0, atol=1e-9)
    for body in halves.bodies:
        assert_close(np.linalg.norm(body.normals, axis=1), 1.0, rtol=0.0, atol=1e-9)
    seen, expected = ((one.body >= 0) for one in (found, alone))
    spare = (expected.shape[1] - seen.shape[1]) // 2  # the picture of one body is square
    assert (seen != expected[:, spare : spare + seen.shape[1]]).mean() < 0.02
    (one, room), (other, _) = found.places
    assert other - one == close_to(room, rtol=1e-9, atol=0.0)
    at = found.body[24, found.body[24] >= 0]
    assert at.tolist() == sorted(at.tolist())
    assert abs((at == 0).sum() - (at == 1).sum()) <= 1


def find_area(body: Body) -> float:
    """The area of all triangles."""
    a, b, c = np.moveaxis(body.corners[body.triangles], 1, 0)
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def test_a_half_without_the_other_is_refused(render: Command) -> None:
    one, two = render.scene(PLAIN, "a"), render.scene(PLAIN, "b")
    for names, options in (
        ("ball:left", ["--together"]),
        ("ball:right,ball:left", ["--together"]),
        ("ball:left,ball:right", []),
    ):
        scenes = [one, two] if "," in names else [one]
        printed = render(*scenes, "--object", names, "--tracer", "own", *options, code=2)
        assert "are of two scenes, one after the other, of one picture (--together)" in printed
    assert 'has no halves: "ball:left"' in render(one, "--object", "sphere:left", code=2)


def test_bodies_are_outlined_where_ground_and_body_are_black(render: Command) -> None:
    """Of a picture of degrees of polarization: nothing is polarized, and the object is seen all the same."""
    found, _ = lay_out(render, "ball")
    shown = show_degrees(found, measure_degrees([found]))[..., :3].max(axis=-1)
    inside = found.body == 0
    edge = shown > 0.2
    assert edge.any()
    assert edge[inside].mean() < 0.2
    assert not edge[inside & np.roll(inside, 1, 0) & np.roll(inside, 1, 1)].any()


def test_a_ball_at_the_side_of_a_row_is_round(render: Command) -> None:
    """A picture is at most 45 degrees wide: what a near camera stretches."""
    found, _ = lay_out(render, "ball", "ball", "ball", "ball", "ball")
    for body in (0, 2, 4):
        rows, columns = np.nonzero(found.body == body)
        assert np.ptp(columns) / np.ptp(rows) == close_to(1.0, rtol=0.0, atol=0.1)


def test_titles_below_a_row_do_not_meet(render: Command) -> None:
    found, _ = lay_out(render, "ball", "ball:left", "ball:right", "ball")
    titles = ["metallic car paint of long name", "dry sand", "wet sand", "white gloss paint"]
    found = replace(
        found, materials=[replace(one, title=title) for one, title in zip(found.materials, titles, strict=True)]
    )
    figure = draw_row(found, PictureSetting(size_px=48))
    boxes = [text.get_window_extent() for text in figure.texts if text.get_text().replace("\n", " ") in titles]
    assert len(boxes) == 4
    for left, right in pairwise(boxes):
        assert right.x0 > left.x1
    assert boxes[0].x0 > 0.0


def test_glare_spreads_what_is_beyond_white_as_an_eye_does() -> None:
    """All light of all directions is 1.03; what a screen shows is left alone, what it does not is kept."""
    angle = np.concatenate([[0.0], np.geomspace(1e-5, 90.0, 20000)])
    total = np.trapezoid(find_spread(angle) * 2.0 * np.pi * np.sin(np.radians(angle)), np.radians(angle))
    assert total == close_to(1.031, rtol=0.0, atol=1e-3)
    grey = np.full((40, 60, 3), 0.3)
    assert_close(spread_glare(grey, grey[..., 1], 0.1), grey, rtol=0.0, atol=1e-12)
    bright = grey.copy()
    bright[20, 30] = 500.0
    found = spread_glare(bright, bright[..., 1], 0.1)
    assert found.sum() == close_to(bright.sum(), rtol=0.02, atol=0.0)
    assert found[20, 30, 0] > 250.0
    beside = found[20, 31:34, 0] - 0.3
    assert_close(beside, 499.0 * find_spread(0.1 * np.arange(1, 4)) * np.radians(0.1) ** 2, rtol=1e-6, atol=0.0)


def test_the_suns_disc_is_in_the_picture_where_it_is_ahead() -> None:
    """A low sun before the camera: its radiance over its solid angle is its irradiance."""
    sky = make_sky("sun", [0.5], 5.0, 0.0)
    lens = place_lens(place_camera(5.0, 180.0), [find_shape("ball").place()], 200)
    lens = replace(lens, distance=1e3, middle=np.array([0.0, 0.0, 500.0]))
    stage, channels = Stage([find_shape("ball").place()], lens, sky.beam), np.zeros((200 * 200, 6))
    add_sun(channels, stage, sky, GREY)
    ways = lens.look(np.tile(np.arange(200) + 0.5, 200), np.repeat(np.arange(200) + 0.5, 200))
    solid_angle = np.radians(lens.pixel_deg) ** 2 * (ways @ -lens.camera.toward) ** 3
    assert channels[:, 1] @ solid_angle == close_to(1.0, rtol=0.02, atol=0.0)
    behind = np.zeros((200 * 200, 6))
    add_sun(
        behind, replace(stage, beam=sky.beam * [-1.0, 1.0, 1.0]), replace(sky, beam=sky.beam * [-1.0, 1.0, 1.0]), GREY
    )
    assert not behind.any()


@pytest.mark.slow
def test_a_sheet_has_a_row_a_scene_and_objects_stand_together_in_one_picture(render: Command) -> None:
    one, two = render.scene(PLAIN + SMALL), render.scene(PLAIN + SMALL, "two")
    render(one, "--sheet")
    sheet = Sheet(48, [("one", "rayleigh")], 4, 0.20, note="")
    assert render.pixels.shape[1] == sheet.width
    assert render.pixels.shape[0] >= sheet.height
    render.picture.unlink()
    assert render(one, two, "--object", "ball", "--together").count("3 wavelengths") == 2
    assert render.pixels.shape[1] > 80


def test_a_brdf_between_its_directions_is_finer_where_needed(render: Command) -> None:
    material = render.material(PLAIN)
    brdf = material.brdf(0.5, COARSE.mu, COARSE.mu, COARSE.phi)
    assert measure_interpolation_error(material, 0.5, tabulate_brdf(brdf, COARSE)) < 1e-3
    peaked = render.material("[[layer]]\nphase = { henyey_greenstein = 0.9 }\nalbedo = 0.9\nthickness = 1.0\n")
    coarse, fine = Resolution(8, 12, 8, 4, 4), Resolution(16, 24, 8, 4, 4)
    errors = [find_fine_table(peaked, some)[1] for some in ([coarse], [coarse, fine])]
    assert errors[1] < errors[0]


VASE = 'object = "vase"\n'


def test_bad_tables_are_named(render: Command) -> None:
    for text, message in (
        ("sky = 'blue'", 'render.sky = "blue": must be "rayleigh" or "uniform" or "sun"'),
        ("sun_elevation_deg = 0", "render.sun_elevation_deg = 0: must be degrees from 1 to 90"),
        ("exposur = 1", "render.exposur = 1: unknown key; did you mean 'exposure'?"),
        ("wavelengths = 3", "render.wavelengths = 3: must be a whole number from 9 to 31"),
        ("wavelengths_um = [0.5, 0.4]", "render.wavelengths_um = [0.5, 0.4]: must be 1 to 31 ascending"),
        ("wavelengths = 9\nwavelengths_um = [0.5]", "at most one of wavelengths and wavelengths_um"),
        ("size_px = 1.5", "render.size_px = 1.5: must be a whole number from 16 to 1024"),
        ("title = 3", "render.title = 3: must be a text"),
        ('object = "cow"', 'render.object = "cow": must be sphere or ball or vase or shell or knot, or a file'),
        ('object = "cow.obj"', 'render.object = "cow.obj": no such file'),
        ("object = 3", "render.object = 3: must be sphere or"),
        ("turn_deg = 30", "render.turn_deg = 30: a sphere looks the same however it is turned"),
        (f"{VASE}camera_elevation_deg = -5", "render.camera_elevation_deg = -5: must be more than 0"),
    ):
        with pytest.raises(SceneError, match=re.escape(message)):
            render.material(f"{PLAIN}[render]\n{text}\n")


SHORT = """[particles.white]
index = "main/TiO2/Devore-o"
radius_um = 0.1
[[layer]]
particles = "white"
thickness = 9.0
"""


def test_what_cannot_be_one_picture_is_named_in_a_line(render: Command) -> None:
    """A wavelength that is asked for is never extrapolated."""
    assert "absent.toml: No such file" in render(render.folder / "absent.toml", code=2)
    scenes = [render.scene(f"{PLAIN}[render]\nexposure = {name}", name) for name in ("1", "2")]
    assert "render.exposure = 2.0: " in render(*scenes, code=2)
    printed = render(render.scene(SHORT + "[render]\nwavelengths_um = [0.4, 0.5]\n"), code=2)
    assert "goes from 0.43 to 1.53 um" in printed
    assert "[render] wavelengths_um can name others" in printed


def test_wavelengths_end_where_the_substance_is_known_no_further(render: Command) -> None:
    """The spectrum is not extrapolated: what the picture takes beyond is said."""
    white, table = render.material(SHORT), render.folder / "own.csv"
    assert_close(white.wavelengths_um, np.linspace(0.43, 0.70, 9), rtol=0.0, atol=1e-6)
    assert white.note == "the table of main/TiO2/Devore-o begins at 0.43 um: beyond, the spectrum stays as it is there"
    table.write_text("wavelength_nm,n\n450,1.5\n650,1.5\n")
    own = SHORT.replace('"main/TiO2/Devore-o"', '"own.csv"')
    clay = render.material(own, 11)
    assert_close(clay.wavelengths_um, np.linspace(0.45, 0.65, 11), rtol=0.0, atol=1e-6)
    assert "own.csv begins at 0.45 um and ends at 0.65 um" in clay.note
    assert render.material("wavelength_um = [0.5, 0.6]\n" + SHORT).wavelengths_um.tolist() == [0.5, 0.6]
    table.write_text("wavelength_um,n\n1,1.5\n2,1.5\n")
    with pytest.raises(SceneError, match=r"own\.csv goes from 1 to 2 um: nothing of 0\.4 to 0\.7 um"):
        render.material(own)


def test_the_setting_has_its_defaults_and_other_commands_leave_it_alone(render: Command) -> None:
    path = render.scene(PLAIN, "white_paint")
    (material,), setting = read([path])
    assert (setting, material.title) == (PictureSetting(), "white paint")
    np.testing.assert_array_equal(material.wavelengths_um, choose_wavelengths(9))
    path.write_text(PLAIN + SMALL + "[brdf]\nmu_i = 0.5\nmu_o = 0.5\n")
    assert vrte.spectrum(path, [0.5])[0].mu_i.size == 1


def test_angles_have_the_colours_of_the_wheel() -> None:
    """Upright light is red, and so is what the legend shows above its middle; unpolarized light is grey."""
    swing = np.radians([0.0, 90.0, 180.0])
    stokes = np.stack([np.ones(3), np.cos(2.0 * swing), np.sin(2.0 * swing), np.zeros(3)], axis=-1)
    red, cyan = [1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 1.0, 1.0]
    assert_close(colour_angles(stokes, np.ones(3)), [red, cyan, red], rtol=0.0, atol=0.05)
    grey = colour_angles(np.array([[1.0, 0.0, 0.0, 0.5]]), np.ones(1))
    assert_close(grey, [[0.6, 0.6, 0.6, 1.0]], rtol=1e-7, atol=0.0)


INDEX = 1.5 + 0.3j


def mirror_table(index: complex) -> BrdfTable:
    """A sphere that only mirrors, as if of glass or metal without end."""
    directions = COARSE.mu, COARSE.mu, COARSE.phi
    dark = np.zeros((*(one.size for one in directions), 4, 4))
    fraction = np.zeros(COARSE.mu.size)
    beams = reflect_smooth(index, COARSE.mu)
    return tabulate_brdf(
        vrte.Brdf(dark, fraction, *directions, {}, direct_transmittance=fraction, specular=beams), COARSE
    )


def rough_table(surface: RoughSurface) -> BrdfTable:
    """A sphere of facets alone."""
    return replace(mirror_table(1.5), specular=None, facets=surface)


def amplitudes(index: complex, cosine: float) -> tuple[complex, complex]:
    """Fresnel's r_p, r_s, as anyone would write them."""
    behind = np.sqrt(1.0 - (1.0 - cosine**2) / index**2 + 0j)
    p = (index * cosine - behind) / (index * cosine + behind)
    return p, (cosine - index * behind) / (cosine + index * behind)


def test_a_mirror_shows_the_sky_as_fields_in_space_are_reflected() -> None:
    sky = replace(make_sky("rayleigh", [0.45], 25.0, 0.3), sun=np.zeros(1))
    seen = view(sky, camera=place_camera(20.0, 130.0), size=60)
    found, normal, toward = draw(seen, mirror_table(INDEX)), normals_of(seen), seen.camera.toward
    cosine = normal @ toward
    travel = toward - 2.0 * cosine[:, None] * normal
    checked = np.arange(0, len(normal), 101)
    checked = checked[(travel[checked, 2] < -0.05) & (cosine[checked] > 0.05)]
    assert checked.size > 10
    light = sky_coherency(sky, travel[checked])
    for pixel, falls_in in zip(checked, light, strict=True):
        s = np.cross(travel[pixel], normal[pixel])
        s /= np.linalg.norm(s)
        r_p, r_s = amplitudes(INDEX, float(cosine[pixel]))
        # p = s x k for both: at grazing incidence they are one, and r_p = r_s = -1 there
        turned = r_s * np.outer(s, s) + r_p * np.outer(np.cross(s, toward), np.cross(s, travel[pixel]))
        expected = stokes_of(turned @ falls_in @ turned.conj().T, seen.camera)
        assert_close(found[pixel], expected, rtol=0.0, atol=2e-4 * expected[0])
    assert np.abs(found[:, 3]).max() > 0.02 * found[:, 0].max()  # a metal makes V of skylight


@pytest.mark.parametrize("size", [16, 60, 600])
def test_the_suns_image_holds_what_a_sphere_mirrors(size: int) -> None:
    """E/4 times the cross section, R of half the angle between sun and camera, where the normal halves it."""
    sky, camera = make_sky("sun", [0.5], 40.0, 0.0), place_camera(10.0, 50.0)
    image = mirror_sun(camera, sky.beam, 0.47 * size, size).reshape(size, size)
    assert image.sum() == close_to(0.25 * (0.47 * size) ** 2, rtol=1e-6, atol=0.0)
    half = camera.toward - sky.beam
    half /= np.linalg.norm(half)
    across = np.arange(size) + 0.5 - 0.5 * size
    middle = image.sum(axis=0) @ across, -image.sum(axis=1) @ across
    expected = 0.47 * size * np.array([half @ camera.right, half @ camera.up])
    assert_close(np.array(middle) / image.sum(), expected, rtol=0.0, atol=0.5)
    # no brighter than the sun, and as bright where its image fills a pixel
    brightest = 1.0 / (np.pi * np.sin(SUN_RADIUS) ** 2)
    assert (0.9 if size == 600 else 0.0) * brightest < image.max() < 1.02 * brightest


@pytest.mark.parametrize("distribution", ["beckmann", pytest.param("ggx", marks=pytest.mark.slow)])
def test_in_a_furnace_facets_show_what_they_reflect(distribution: str) -> None:
    surface = RoughSurface(1.0, 1.5, 0.3, distribution, shadowing=True)
    seen = view(make_sky("uniform", [0.5], 30.0, 0.0))
    found = draw(seen, rough_table(surface))
    points, weights = np.polynomial.legendre.leggauss(200)
    mu_i, phi = 0.5 * (points + 1.0), np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
    cosines = np.cos(seen.pixels[1])
    for wanted in (0.95, 0.6, 0.3):
        pixel = int(np.abs(cosines - wanted).argmin())
        columns = surface.reflect(mu_i[:, None], cosines[pixel], np.degrees(phi))[..., 0]
        intensity, q, *_ = np.einsum("ips,i->s", columns, 0.5 * weights * mu_i) * (2.0 * np.pi / phi.size)
        assert found[pixel, 0] == close_to(intensity, rtol=0.01, atol=0.0)
        assert np.hypot(found[pixel, 1], found[pixel, 2]) == close_to(abs(q), rtol=0.0, atol=0.01 * intensity)


@pytest.mark.slow
def test_hardly_rough_facets_show_what_a_mirror_does() -> None:
    """Frames of Stokes vectors, too: away from the horizon and the sun, which facets see beside the mirrored ray. In
    the sun alone facets spread the glint, and keep its light."""
    sky = make_sky("rayleigh", [0.45], 25.0, 0.3)
    seen = view(sky, camera=place_camera(20.0, 130.0), size=60)
    rough = draw(seen, rough_table(RoughSurface(1.0, 1.5, 0.01, "beckmann", True)))
    smooth, normal = draw(seen, mirror_table(1.5)), normals_of(seen)
    cosine = normal @ seen.camera.toward
    mirrored = 2.0 * cosine[:, None] * normal - seen.camera.toward  # to where each pixel looks
    clear = (np.abs(mirrored[:, 2]) > 0.15) & (cosine > 0.25) & (mirrored @ -sky.beam < 0.99)
    assert clear.sum() > 500
    largest = smooth[clear, 0].max()
    assert_close(rough[clear], smooth[clear], rtol=0.0, atol=0.02 * largest)
    assert np.abs(smooth[clear, 1:3]).max() > 0.2 * largest  # polarized enough to tell
    seen = view(make_sky("sun", [0.5], 25.0, 0.0), camera=place_camera(20.0, 130.0), size=300)
    rough, smooth = (
        draw(seen, one) for one in (rough_table(RoughSurface(1.0, 1.5, 0.05, "beckmann", True)), mirror_table(1.5))
    )
    assert_close(rough.sum(axis=0), smooth.sum(axis=0), rtol=0.02, atol=0.0)
    assert rough[:, 0].max() < 0.03 * smooth[:, 0].max()


def test_a_bare_rough_base_is_seen_facet_by_facet(render: Command) -> None:
    """A table of 32 angles cannot hold its highlight: 20 % off by splines."""
    facets = 'kind = "facets"\nindex = [0.2, 3.4]\nroughness = 0.1\nconserving = false\n'
    metal = f'[[layer]]\nphase = "isotropic"\nalbedo = 0.0\nthickness = 0.0\n\n[base]\n{facets}'
    material = render.material(metal)
    found, error = find_fine_table(material, [COARSE])
    assert found.facets == RoughSurface(1.0, 0.2 + 3.4j, 0.1, shadowing=True, closed=True)
    assert error < 1e-6
    assert np.abs(found.splines).max() < 1e-6
    assert (material.coloured, render.material(metal.replace("[0.2, 3.4]", '"gold"')).coloured) == (False, True)


GREY = np.ones((3, 1))
FAR = 1e4


def far_lens(camera: Camera, size: int, radius: float = 1.0) -> Lens:
    """That sees what the camera of spheres sees: parallel rays, a ball of this radius about the origin."""
    return Lens(camera, np.zeros(3), FAR, radius / (MARGIN * FAR), size, size)


def draw_ball(here: BrdfTable, sky: Sky, camera: Camera, size: int, rings: int) -> Array:
    """Stokes vectors (pixel, 4) of a ball that floats, over a ground without its shadow."""
    stage = Stage([make_ball(rings)], far_lens(camera, size), sky.beam, standing=False)
    light = SceneLight.of(sky, 0.2, stage.ground)
    _, samples = draw_background(stage, light, GREY)
    return draw_object(stage, samples, [here], light, GREY)[:, [0, 3, 4, 5]]


SLAB = vrte.Layer(vrte.rayleigh(), 0.9, 1.0)
FINE = 60, 96  # pixels, rings


@pytest.mark.parametrize(
    ("top", "size", "rings", "largest", "rms"),
    [
        ([], 16, 32, 8e-3, 2e-3),
        pytest.param([], *FINE, 6e-3, 1e-3, marks=pytest.mark.slow),
        pytest.param([vrte.Interface(1.0, 1.5)], *FINE, 6e-3, 1e-3, marks=pytest.mark.slow),
        pytest.param([vrte.Interface(1.0, 1.5, roughness=0.3)], *FINE, 8e-3, 1.2e-3, marks=pytest.mark.slow),
    ],
)
def test_a_ball_is_the_sphere(
    top: list[Any], size: int, rings: int, largest: float, rms: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The picture of a ball against the sphere's, but at the rim, whose pixels show what is behind, too."""
    sky, camera, here = (
        make_sky("rayleigh", [0.45], 35.0, 0.2),
        place_camera(15.0, 130.0),
        table(vrte.Scene([*top, SLAB])),
    )
    seen = View(camera, sky, size, COARSE)
    monkeypatch.setattr(objects, "SAMPLES", 1)  # the sphere's pixels show their middle
    found, expected = draw_ball(here, sky, camera, size, rings), spread(seen, here).reshape(-1, 4)
    inside, theta, _ = seen.pixels
    mirrored = 2.0 * np.cos(theta)[:, None] * normals_of(seen) - camera.toward
    clear = theta < np.arcsin(0.93)
    if here.specular is not None:  # the sun is a point there, and the horizon soft over a pixel
        clear &= (np.abs(mirrored[:, 2]) * seen.radius * np.cos(theta) > 1.2) & (mirrored @ -sky.beam < 0.99)
    assert clear.sum() > 0.5 * theta.size
    clear = inside[clear]
    difference = np.abs(found - expected)[clear] / expected[clear, 0].max()
    assert difference.max() < largest
    assert np.sqrt((difference**2).mean(axis=0)).max() < rms
    assert np.abs(expected[clear, 1:3]).max() > 0.03 * expected[clear, 0].max()


@pytest.mark.parametrize(("ball", "size"), [(False, 120), pytest.param(True, 60, marks=pytest.mark.slow)])
def test_the_suns_glint_is_polarized_as_fresnel_says(ball: bool, size: int) -> None:
    """A quarter of the cross section times the fraction that is mirrored, by a sphere, and by a ball of triangles."""
    brewster = float(np.degrees(np.arctan(1.5)))  # from the vertical: that of the sun, and on its other side the camera
    sky, camera = make_sky("sun", [0.5], 90.0 - brewster, 0.0), place_camera(90.0 - brewster, 180.0)
    here = mirror_table(1.5)
    found = draw_ball(here, sky, camera, size, 48) if ball else draw(view(sky, size, camera), here)
    fraction = ((1.5**2 - 1.0) / (1.5**2 + 1.0)) ** 2 / 2.0  # all of it across the plane of incidence
    expected = fraction * 0.25 * (0.5 * MARGIN * size) ** 2 * np.array([1.0, -1.0, 0.0, 0.0])
    assert_close(found.sum(axis=0), expected, rtol=0.0, atol=(0.03 if ball else 2e-3) * expected[0])


def make_box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Body:
    corners = np.array([[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)])
    sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    triangles = np.array([[side[0], side[k], side[k + 1]] for side in sides for k in (1, 2)])
    return make_body(np.array(low) + corners * (np.array(high) - low), triangles)


@pytest.mark.parametrize("elevation", [25.0, pytest.param(50.0, marks=pytest.mark.slow)])
def test_a_box_throws_a_shadow_as_long_as_the_sun_is_low(elevation: float) -> None:
    """Seen from above; the sun stands at azimuth 0, so that the shadow points to the west."""
    size, reach, sky = 120, 1.5, make_sky("rayleigh", [0.55], elevation, 0.5)
    lens = far_lens(place_camera(89.999, 0.0), size, reach * MARGIN)
    stage = Stage([make_box((-0.2, -0.2, 0.0), (0.2, 0.2, 0.5))], lens, sky.beam)
    light = SceneLight.of(sky, 0.5, stage.ground)
    ground = draw_background(stage, light, GREY)[0][:, 0].reshape(size, size)
    across = (np.arange(size) + 0.5 - 0.5 * size) * (2.0 * reach / size)
    # the camera at azimuth 0 has the east below and the north at its right
    dark = ground[:, size // 2] < light.skylit[0] + 0.5 * light.sunlit[0]
    shadow = across[dark & (across < -0.2)]
    assert -shadow.min() - 0.2 == close_to(0.5 / np.tan(np.radians(elevation)), rtol=0.0, atol=2.0 * 2.0 * reach / size)
    assert not dark[across > 0.25].any()
    assert np.median(ground[dark & (across < -0.2), size // 2]) < light.skylit[0]  # the box takes skylight, too


def test_skylight_on_the_ground_before_a_long_wall() -> None:
    """At the distance d a wall of height h leaves (1 + d/sqrt(d^2 + h^2))/2 of an even sky's light."""
    sky = make_sky("uniform", [0.5], 40.0, 0.0)
    stage = Stage([make_box((-0.1, -30.0, 0.0), (0.0, 30.0, 1.0))], far_lens(place_camera(20.0, 0.0), 16), sky.beam)
    light = SceneLight.of(sky, 0.0, stage.ground)
    distance = np.array([0.3, 1.0, 2.5])
    found = (stage.ground.rows(distance, 0.0 * distance) @ light.skylight_fractions)[:, 0]
    assert_close(found, 0.5 * (1.0 + distance / np.hypot(distance, 1.0)), rtol=0.0, atol=0.02)


def test_objects_stand_in_their_own_light_and_samples_take_all_of_the_suns_disc() -> None:
    """Two boxes: one is in the other's shadow, and not lit."""
    bodies = [make_box((-0.2, -0.2, 0.0), (0.2, 0.2, 1.0)), make_box((-0.8, -0.2, 0.0), (-0.6, 0.2, 0.3))]
    sky = make_sky("sun", [0.5], 40.0, 0.0)
    start = np.array([[-0.599, 0.0, 0.2], [0.201, 0.0, 0.2]])
    assert Rays(bodies).find_blocked(start, np.broadcast_to(-sky.beam, (2, 3))).tolist() == [True, False]
    stage = Stage(bodies, far_lens(place_camera(10.0, 0.0), 16), sky.beam)
    away = np.degrees(np.arccos(np.clip(stage.suns @ -stage.beam, -1.0, 1.0)))
    assert stage.suns.shape == (objects.SAMPLES**2, 3)
    assert 0.2 < away.max() <= 0.2666


@pytest.mark.parametrize("name", SHAPES)
def test_shapes_are_closed_and_stand_on_the_ground(name: str) -> None:
    import trimesh

    body = find_shape(name).place(30.0, (1.0, 2.0))
    mesh = trimesh.Trimesh(body.corners, body.triangles, process=False)
    assert mesh.is_watertight
    assert mesh.volume > 0.0  # normals point outward
    low, high = body.corners.min(axis=0), body.corners.max(axis=0)
    assert low[2] == close_to(0.0, rtol=0.0, atol=1e-12)
    assert (high - low).max() == close_to(1.0, rtol=1e-6, atol=0.0)
    assert_close(0.5 * (low + high)[:2], [1.0, 2.0], rtol=0.0, atol=1e-9)
    assert_close(np.linalg.norm(body.normals, axis=1), 1.0, rtol=0.0, atol=1e-9)


def test_the_camera_frames_what_stands_there() -> None:
    camera = place_camera(10.0, 40.0)
    bodies = [find_shape("knot").place(0.0, (0.0, float(index))) for index in range(3)]
    for chosen in (bodies[:1], bodies):
        lens = place_lens(camera, chosen, 100)
        ways = np.concatenate([body.corners for body in chosen]) - lens.place
        x, y, depth = (ways @ axis for axis in (camera.right, camera.up, -camera.toward))
        unit = 2.0 * lens.spread / lens.height
        assert np.abs(x / depth / unit).max() < 0.5 * lens.width
        assert 0.2 * lens.height < np.abs(y / depth / unit).max() < 0.5 * lens.height


CORNERS = [(x, y, z) for z in (0, 2) for y in (0, 1) for x in (0, 1)]
FACES = "\nf 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6"


def write_box(path: Path, size: float = 1.0) -> Body:
    """The mesh of a box that is twice as high as wide, in a file."""
    path.write_text("\n".join(f"v {size * x!r} {size * y!r} {size * z!r}" for x, y, z in CORNERS) + FACES)
    return find_shape(str(path))


def test_a_mesh_keeps_its_edges_and_its_smooth_faces_in_any_unit(tmp_path: Path) -> None:
    import trimesh

    box = write_box(tmp_path / "box.obj")
    assert_close(np.abs(box.normals).max(axis=1), 1.0, rtol=0.0, atol=1e-9)  # each along an axis
    assert_close(np.ptp(box.place().corners, axis=0), [0.5, 0.5, 1.0], rtol=0.0, atol=1e-9)
    for size in (1e-12, 1e150, 1e307):
        assert_close(write_box(tmp_path / "other.obj", size).corners, box.corners, rtol=0.0, atol=1e-12)
    path = tmp_path / "box.obj"
    path.write_text(re.sub(r"f (.*)", lambda face: "f " + " ".join(face[1].split()[::-1]), path.read_text()))
    inside_out = find_shape(str(path))
    outward = inside_out.corners - 0.5 * (inside_out.corners.min(axis=0) + inside_out.corners.max(axis=0))
    assert ((inside_out.normals * outward).sum(axis=1) > 0.0).all()
    ball, path = make_ball(16), tmp_path / "ball.ply"
    trimesh.Trimesh(ball.corners, ball.triangles).export(path)
    found = find_shape(str(path))
    radial = found.corners / np.linalg.norm(found.corners, axis=1, keepdims=True)
    assert (found.normals * radial).sum(axis=1).min() > 0.99


TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 {}\nf 1 2 3\nf 1 2 4\nf 2 3 4\nf 1 3 4\n"
WHOLE = TETRAHEDRON.format(1)
PLY = (
    "ply\nformat ascii 1.0\ncomment TextureFile skin.png\nelement vertex 4\n"
    "property float x\nproperty float y\nproperty float z\nelement face 4\nproperty list uchar int vertex_indices\n"
    "end_header\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 {}\n"
)


def test_nothing_of_a_damaged_mesh_is_drawn(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.obj")  # whoever opens it waits for ever
    for name, text, words in (
        ("a.obj", "no mesh\n", "must be a mesh of 1 to"),
        ("b.ply", "no mesh\n", "not a mesh that can be read"),
        ("c.stl", "no mesh\n", ".*mesh"),
        ("a.obj", TETRAHEDRON.format("nan"), r"corner 4 is at \[0\.0, 0\.0, nan\]: all must be at finite places"),
        ("a.obj", TETRAHEDRON.format("1e308"), "none of its 4 triangles has an area"),
        ("a.obj", WHOLE + "f 1/1 0/1 2/1\n", "line 9: a face has the corner 0; corners are counted from 1"),
        ("a.obj", WHOLE + "f 1 2 9\n", "not a mesh that can be read"),
        ("a.ply", PLY.format(9), "a triangle has a corner that is none of its 4"),
        ("a.ply", PLY.format(-1), "a triangle has a corner that is none of its 4"),
        ("pipe.obj", "", "it is no file, but a folder, a pipe or a device"),
    ):
        if text:
            (tmp_path / name).write_text(text)
        with pytest.raises(SceneError, match=rf"{name}: {words}"):
            find_shape(str(tmp_path / name))


def test_what_a_mesh_holds_besides_is_left_out(tmp_path: Path, capfd: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Triangles without an area, which are counted; a texture, which is not looked for."""
    path = tmp_path / "a.obj"
    path.write_text(WHOLE + "f 1 1 2\nf 3 4 3\n")
    with pytest.warns(UserWarning, match=r"a\.obj: 2 of its 6 triangles have no area and are left out"):
        found = find_shape(str(path))
    path.write_text(WHOLE)
    np.testing.assert_array_equal(found.corners, find_shape(str(path)).corners)
    path = tmp_path / "a.ply"
    path.write_text(PLY.format(2))
    assert np.ptp(find_shape(str(path)).corners, axis=0).max() == close_to(1.0, rtol=1e-6, atol=0.0)
    assert capfd.readouterr() == ("", "")
    monkeypatch.setitem(sys.modules, "embreex.rtcore_scene", None)
    with pytest.raises(MissingExtraError, match=r"vrte\[render\]"):
        Rays([make_ball(8)])


def test_objects_are_read_from_files_and_won_over(render: Command) -> None:
    box = render.folder / "box.obj"
    write_box(box)
    paths = [render.scene(PLAIN + '[render]\nobject = "box.obj"\nturn_deg = 20\n', "a"), render.scene(PLAIN, "b")]
    assert [(one.shape, one.turn_deg) for one in read(paths)[0]] == [(str(box), 20.0), ("sphere", 0.0)]
    for shapes in (["knot"], ["knot", "ball"]):
        assert [one.shape for one in read(paths, shapes=shapes)[0]] == (shapes * 2)[:2]
    with pytest.raises(SceneError, match="3 objects for 2 scenes: must be one for all, or one for each"):
        read(paths, shapes=["knot"] * 3)


KINDS = {
    "dust": {"index": 1.5, "diameter_um": 0.2},
    "soot": {"index": "carbon", "size": {"lognormal": {"median_um": 0.05, "sigma": 1.5}}},
}
ROUGH = {"interface": {"above": 1.0, "below": 1.5, "roughness": 0.15}}
DENSE = {"volume_fractions": {"dust": "5 %", "soot": 1e-3}, "thickness_um": float("inf")}


HAZE = {"phase": {"henyey_greenstein": 0.5}, "albedo": 1.0, "thickness": 2.0}
FILM = {"particles": "dust", "volume_fraction": "5 %", "thickness_um": 60}
CAPTIONS: list[tuple[Any, str]] = [
    ("gold_coarse", "gold, radius 0.6 µm; infinitely thick"),
    ("mixture_on_white", "80 % hematite 0.08 µm + 20 % alumina 0.4 µm; optical thickness 3; in index 1.5"),
    ("paint_smooth", "smooth surface; 85 % hematite 0.05 µm + 15 % rutile 0.11 µm; optical thickness"),
    (HAZE, "henyey_greenstein 0.5; optical thickness 2; on albedo 0.8"),
    ({"host_index": 1.5, "thickness_um": 10.0}, "clear; 10 µm thick; on albedo 0.8"),
    (FILM, "dust, diameter 0.2 µm; 60 µm thick; on albedo 0.8"),
    (DENSE, "5 % dust diameter 0.2 µm + 0.1 % carbon 0.05 µm by volume; infinitely thick"),
]


@pytest.mark.parametrize(("layer", "words"), CAPTIONS)
def test_captions_say_what_a_layer_is_made_of(layer: Any, words: str) -> None:
    if isinstance(layer, str):
        (material,), _ = read([GALLERY / f"{layer}.toml"])
        assert describe_layers(material.content).startswith(words)
    else:
        content = {"particles": KINDS, "layer": [ROUGH, layer], "base": {"kind": "lambertian", "albedo": 0.8}}
        assert describe_layers(content) == f"surface of roughness 0.15; {words}"
