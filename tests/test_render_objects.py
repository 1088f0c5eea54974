"""Objects on the ground: the renderer of spheres, shadows and skylight in closed form, the sun's image, files."""

import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.basics.arrays import Array
from vrte.basics.errors import MissingExtraError, SceneError
from vrte.optics.fresnel import reflect_smooth
from vrte.render import objects
from vrte.render.geometry import Camera, Lens, compute_normals, place_camera, place_lens
from vrte.render.objects import Stage, draw_background, draw_object
from vrte.render.picture import describe_layers
from vrte.render.rendering import find_facets
from vrte.render.setting import read
from vrte.render.shapes import SHAPES, Body, Rays, find_shape, make_ball, make_body
from vrte.render.sky import Sky, make_sky
from vrte.render.spheres import MARGIN, View
from vrte.render.surfaces import SceneLight
from vrte.render.tables import BrdfTable, Resolution, tabulate_brdf

from .helpers import assert_close, close_to

COARSE = Resolution(angles=20, azimuths=36, around=24, along=12, across=8)
GREY = np.ones((3, 1))
FAR = 1e4
BOX = "\n".join(
    [f"v {x} {y} {z}" for z in (0, 2) for y in (0, 1) for x in (0, 1)]
    + ["f 1 3 4 2", "f 5 6 8 7", "f 1 2 6 5", "f 3 7 8 4", "f 1 5 7 3", "f 2 4 8 6"]
)


def table(scene: vrte.Scene) -> BrdfTable:
    """A BRDF as a picture has it: facets on top are kept by themselves."""
    top = scene.interfaces[0]
    found = vrte.brdf(scene, COARSE.mu, COARSE.mu, COARSE.phi, nodes=12)
    return tabulate_brdf(found, COARSE, find_facets(found, None if top is None or top.is_smooth else top.facets))


def far_lens(camera: Camera, size: int, radius: float = 1.0) -> Lens:
    """That sees what the camera of spheres sees: parallel rays, a ball of this radius about the origin."""
    return Lens(camera, np.zeros(3), FAR, radius / (MARGIN * FAR), size, size)


def draw_ball(here: BrdfTable, sky: Sky, camera: Camera, size: int, rings: int) -> Array:
    """Stokes vectors (pixel, 4) of a ball that floats, over a ground without its shadow."""
    stage = Stage([make_ball(rings)], far_lens(camera, size), sky.beam, standing=False)
    light = SceneLight.of(sky, 0.2, stage.ground)
    _, samples = draw_background(stage, light, GREY)
    return draw_object(stage, samples, [here], light, GREY)[:, [0, 3, 4, 5]]


def compare_to_sphere(scene: vrte.Scene, size: int, rings: int, largest: float, rms: float) -> None:
    """The picture of a ball against the sphere's, but at the rim, whose pixels show what is behind, too."""
    sky, camera, here = make_sky("rayleigh", [0.45], 35.0, 0.2), place_camera(15.0, 130.0), table(scene)
    seen = View(camera, sky, size, COARSE)
    expected = np.zeros((size**2, 4))
    expected[seen.pixels[0]] = seen.stokes([here])[:, 0]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(objects, "SAMPLES", 1)  # the sphere's pixels show their middle
        found = draw_ball(here, sky, camera, size, rings)
    inside, theta, psi = seen.pixels
    normal = compute_normals(camera, theta, psi)
    mirrored = 2.0 * np.cos(theta)[:, None] * normal - camera.toward
    clear = theta < np.arcsin(0.93)
    if here.specular is not None:  # the sun is a point there, and the horizon soft over a pixel
        clear &= (np.abs(mirrored[:, 2]) * seen.radius * np.cos(theta) > 1.2) & (mirrored @ -sky.beam < 0.99)
    assert clear.sum() > 0.5 * theta.size
    clear = inside[clear]
    gap = np.abs(found - expected)[clear] / expected[clear, 0].max()
    assert gap.max() < largest
    assert np.sqrt((gap**2).mean(axis=0)).max() < rms
    assert np.abs(expected[clear, 1:3]).max() > 0.03 * expected[clear, 0].max()


def test_a_ball_is_the_sphere() -> None:
    compare_to_sphere(vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)], None), 16, 32, 8e-3, 2e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("surface", "largest", "rms"), [("bare", 6e-3, 1e-3), ("smooth", 6e-3, 1e-3), ("rough", 8e-3, 1.2e-3)]
)
def test_a_fine_ball_is_the_sphere(surface: str, largest: float, rms: float) -> None:
    layers = [vrte.Layer(vrte.rayleigh(), 0.9, 1.0)]
    tops = {"bare": [], "smooth": [vrte.Interface(1.0, 1.5)], "rough": [vrte.Interface(1.0, 1.5, roughness=0.3)]}
    compare_to_sphere(vrte.Scene([*tops[surface], *layers], None), 60, 96, largest, rms)


@pytest.mark.slow
def test_white_ball_under_an_even_sky_over_black_ground() -> None:
    """What a tilted surface sees of the sky: (1 + cos tilt)/2."""
    sky = make_sky("uniform", [0.5], 30.0, 0.0)
    sky = replace(sky, ground=np.zeros(1))
    white = table(vrte.Scene([vrte.Layer(vrte.isotropic(), 0.5, 0.0)], vrte.Lambertian(1.0)))
    camera, size = place_camera(15.0, 50.0), 16
    seen = View(camera, sky, size, COARSE)
    found = draw_ball(white, sky, camera, size, 24)
    inside, theta, psi = seen.pixels
    expected = np.zeros(size**2)
    expected[inside] = 0.5 * (1.0 + compute_normals(camera, theta, psi)[:, 2])
    clear = inside[theta < 1.0]
    assert_close(found[clear, 0], expected[clear], rtol=0.0, atol=4e-3)


def make_box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Body:
    corners = np.array([[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)])
    sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    triangles = np.array([[side[0], side[k], side[k + 1]] for side in sides for k in (1, 2)])
    return make_body(np.array(low) + corners * (np.array(high) - low), triangles)


@pytest.mark.parametrize("elevation", [25.0, pytest.param(50.0, marks=pytest.mark.slow)])
def test_a_box_throws_a_shadow_as_long_as_the_sun_is_low(elevation: float) -> None:
    """Seen from above; the sun stands at azimuth 0, so that the shadow points to the west."""
    box = make_box((-0.2, -0.2, 0.0), (0.2, 0.2, 0.5))
    size, reach = 120, 1.5
    sky = make_sky("rayleigh", [0.55], elevation, 0.5)
    stage = Stage([box], far_lens(place_camera(89.999, 0.0), size, reach * MARGIN), sky.beam)
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
    wall = make_box((-0.1, -30.0, 0.0), (0.0, 30.0, 1.0))
    sky = make_sky("uniform", [0.5], 40.0, 0.0)
    stage = Stage([wall], far_lens(place_camera(20.0, 0.0), 16), sky.beam)
    light = SceneLight.of(sky, 0.0, stage.ground)
    assert stage.ground is not None
    distance = np.array([0.3, 1.0, 2.5])
    found = (stage.ground.rows(distance, 0.0 * distance) @ light.skylight_shares)[:, 0]
    assert_close(found, 0.5 * (1.0 + distance / np.hypot(distance, 1.0)), rtol=0.0, atol=0.02)


@pytest.mark.slow
def test_the_suns_image_in_a_ball_holds_what_a_sphere_mirrors() -> None:
    """A quarter of the cross section times the share that is mirrored, half way between sun and camera."""
    sky, camera, size = make_sky("sun", [0.5], 40.0, 0.0), place_camera(10.0, 50.0), 60
    beams = reflect_smooth(1.5, COARSE.mu)
    shape = (COARSE.angles, COARSE.angles, COARSE.phi.size, 4, 4)
    share = beams[:, 0, 0]
    dark = vrte.Brdf(
        np.zeros(shape), share, COARSE.mu, COARSE.mu, COARSE.phi, {}, direct_transmittance=share, specular=beams
    )
    found = draw_ball(tabulate_brdf(dark, COARSE), sky, camera, size, 48).sum(axis=0)
    cosine = np.sqrt(0.5 * (1.0 - sky.beam @ camera.toward))
    expected = reflect_smooth(1.5, np.array([cosine]))[0] * 0.25 * (0.5 * MARGIN * size) ** 2
    assert found[0] == close_to(expected[0, 0], rtol=0.03, atol=0.0)
    assert np.hypot(found[1], found[2]) == close_to(abs(expected[1, 0]), rtol=0.03, atol=0.0)


def test_objects_stand_in_their_own_light() -> None:
    """Two boxes: one is in the other's shadow, and not lit."""
    bodies = [make_box((-0.2, -0.2, 0.0), (0.2, 0.2, 1.0)), make_box((-0.8, -0.2, 0.0), (-0.6, 0.2, 0.3))]
    sky = make_sky("sun", [0.5], 40.0, 0.0)
    rays = Rays(bodies)
    start = np.array([[-0.599, 0.0, 0.2], [0.201, 0.0, 0.2]])
    assert rays.find_blocked(start, np.broadcast_to(-sky.beam, (2, 3))).tolist() == [True, False]


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


def test_a_mesh_keeps_its_edges_and_its_smooth_faces(tmp_path: Path) -> None:
    path = tmp_path / "box.obj"
    path.write_text(BOX)
    body = find_shape(str(path)).place()
    assert_close(np.abs(body.normals).max(axis=1), 1.0, rtol=0.0, atol=1e-9)  # each along an axis
    assert_close(np.ptp(body.corners, axis=0), [0.5, 0.5, 1.0], rtol=0.0, atol=1e-9)
    import trimesh

    ball = make_ball(16)
    path = tmp_path / "ball.ply"
    trimesh.Trimesh(ball.corners, ball.triangles).export(path)
    found = find_shape(str(path))
    radial = found.corners / np.linalg.norm(found.corners, axis=1, keepdims=True)
    assert (found.normals * radial).sum(axis=1).min() > 0.99


def test_the_camera_frames_what_stands_there() -> None:
    camera = place_camera(10.0, 40.0)
    bodies = [find_shape("knot").place(0.0, (0.0, float(place))) for place in range(3)]
    for chosen in (bodies[:1], bodies):
        lens = place_lens(camera, chosen, 100)
        ways = np.concatenate([body.corners for body in chosen]) - lens.place
        x, y, depth = (ways @ axis for axis in (camera.right, camera.up, -camera.toward))
        unit = 2.0 * lens.spread / lens.height
        assert np.abs(x / depth / unit).max() < 0.5 * lens.width
        assert np.abs(y / depth / unit).max() < 0.5 * lens.height
        assert np.abs(y / depth / unit).max() > 0.2 * lens.height


PLAIN = '[[layer]]\nphase = "rayleigh"\nalbedo = 1.0\nthickness = 2.0\n'


TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 {}\nf 1 2 3\nf 1 2 4\nf 2 3 4\nf 1 3 4\n"
PLY = """ply
format ascii 1.0
comment TextureFile skin.png
element vertex 4
property float x
property float y
property float z
element face 4
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
0 0 1
3 0 2 1
3 0 1 3
3 1 2 3
3 0 3 {}
"""


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.obj", "no mesh\n", "must be a mesh of 1 to"),
        ("b.ply", "no mesh\n", "not a mesh that can be read"),
        ("c.stl", "no mesh\n", ".*mesh"),
        ("a.obj", TETRAHEDRON.format("nan"), r"corner 4 is at \[0\.0, 0\.0, nan\]: all must be at finite places"),
        ("a.obj", TETRAHEDRON.format("-inf"), r"corner 4 is at \[0\.0, 0\.0, -inf\]"),
        ("a.obj", TETRAHEDRON.format("1e308"), "none of its 4 triangles has an area"),
        (
            "a.obj",
            TETRAHEDRON.format(1) + "f 1/1 0/1 2/1\n",
            "line 9: a face has the corner 0; corners are counted from 1",
        ),
        ("a.obj", TETRAHEDRON.format(1) + "f 1 2 9\n", "not a mesh that can be read"),
        ("a.ply", PLY.format(9), "a triangle has a corner that is none of its 4"),
        ("a.ply", PLY.format(-1), "a triangle has a corner that is none of its 4"),
    ],
)
def test_nothing_of_a_damaged_mesh_is_drawn(name: str, text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(SceneError, match=rf"{name}: {words}"):
        find_shape(str(tmp_path / name))


def test_a_pipe_is_no_mesh(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.obj")  # whoever opens it waits for ever
    with pytest.raises(SceneError, match=r"pipe\.obj: it is no file, but a folder, a pipe or a device"):
        find_shape(str(tmp_path / "pipe.obj"))


def test_triangles_that_are_left_out_are_counted(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(TETRAHEDRON.format(1) + "f 1 1 2\nf 3 4 3\n")
    with pytest.warns(UserWarning, match=r"a\.obj: 2 of its 6 triangles have no area and are left out"):
        found = find_shape(str(tmp_path / "a.obj"))
    (tmp_path / "a.obj").write_text(TETRAHEDRON.format(1))
    np.testing.assert_array_equal(found.corners, find_shape(str(tmp_path / "a.obj")).corners)


@pytest.mark.parametrize("size", [1e-12, 1e150, 1e307])
def test_a_mesh_is_the_same_in_any_unit(size: float, tmp_path: Path) -> None:
    (tmp_path / "one.obj").write_text(BOX)
    lines = (line.split() for line in BOX.splitlines())
    scaled = [[one[0], *(repr(size * float(x)) for x in one[1:])] if one[0] == "v" else one for one in lines]
    (tmp_path / "other.obj").write_text("\n".join(map(" ".join, scaled)))
    expected, found = (find_shape(str(tmp_path / name)) for name in ("one.obj", "other.obj"))
    assert_close(found.corners, expected.corners, rtol=0.0, atol=1e-12)


def test_a_texture_that_a_mesh_names_is_not_looked_for(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.ply").write_text(PLY.format(2))
    assert np.ptp(find_shape(str(tmp_path / "a.ply")).corners, axis=0).max() == close_to(1.0, rtol=1e-6, atol=0.0)
    assert capfd.readouterr() == ("", "")


def test_without_the_ray_tracer_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "embreex.rtcore_scene", None)
    with pytest.raises(MissingExtraError, match=r"vrte\[render\]"):
        Rays([make_ball(8)])


def test_objects_are_read_from_files_and_won_over(tmp_path: Path) -> None:
    (tmp_path / "box.obj").write_text(BOX)
    for name, text in (("a", '[render]\nobject = "box.obj"\nturn_deg = 20\n'), ("b", "")):
        (tmp_path / f"{name}.toml").write_text(PLAIN + text)
    paths = [tmp_path / "a.toml", tmp_path / "b.toml"]
    assert [(one.shape, one.turn_deg) for one in read(paths)[0]] == [(str(tmp_path / "box.obj"), 20.0), ("sphere", 0.0)]
    assert [one.shape for one in read(paths, shapes=["knot"])[0]] == ["knot", "knot"]
    assert [one.shape for one in read(paths, shapes=["knot", "ball"])[0]] == ["knot", "ball"]
    with pytest.raises(SceneError, match="3 objects for 2 scenes: must be one for all, or one for each"):
        read(paths, shapes=["knot"] * 3)


KINDS = {
    "dust": {"index": 1.5, "diameter_um": 0.2},
    "soot": {"index": "carbon", "size": {"lognormal": {"median_um": 0.05, "sigma": 1.5}}},
}
ROUGH = {"interface": {"above": 1.0, "below": 1.5, "roughness": 0.15}}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("gold_coarse", "gold, radius 0.6 µm; infinitely thick"),
        ("mixture_on_white", "80 % hematite 0.08 µm + 20 % alumina 0.4 µm; optical thickness 3; in index 1.5"),
        ("paint_smooth", "smooth surface; 85 % hematite 0.05 µm + 15 % rutile 0.11 µm; optical thickness"),
        (
            {"phase": {"henyey_greenstein": 0.5}, "albedo": 1.0, "thickness": 2.0},
            "surface of roughness 0.15; henyey_greenstein 0.5; optical thickness 2; on albedo 0.8",
        ),
        (
            {"host_index": 1.5, "thickness_um": 10.0},
            "surface of roughness 0.15; clear; 10 µm thick; on albedo 0.8",
        ),
        (
            {"particles": "dust", "volume_fraction": "5 %", "thickness_um": 60},
            "surface of roughness 0.15; dust, diameter 0.2 µm; 60 µm thick; on albedo 0.8",
        ),
        (
            {"volume_fractions": {"dust": "5 %", "soot": 1e-3}, "thickness_um": float("inf")},
            "surface of roughness 0.15; 5 % dust diameter 0.2 µm + 0.1 % carbon 0.05 µm by volume; infinitely thick",
        ),
    ],
)
def test_captions_say_what_a_layer_is_made_of(content: Any, words: str) -> None:
    if isinstance(content, str):
        (material,), _ = read([Path(vrte.__file__).parent / "app" / "gallery" / f"{content}.toml"])
        assert describe_layers(material.content).startswith(words)
    else:
        base = {"kind": "lambertian", "albedo": 0.8}
        assert describe_layers({"particles": KINDS, "layer": [ROUGH, content], "base": base}) == words


def test_a_pixels_samples_take_all_of_the_suns_disc() -> None:
    stage = Stage([make_ball(8)], far_lens(place_camera(10.0, 0.0), 16), make_sky("sun", [0.5], 30.0, 0.0).beam)
    away = np.degrees(np.arccos(np.clip(stage.suns @ -stage.beam, -1.0, 1.0)))
    assert stage.suns.shape == (objects.SAMPLES**2, 3)
    assert 0.2 < away.max() <= 0.2666
