"""Blender's Cycles with the numbers of a fitted OpenPBR file: `pip install bpy` (500 MB, Python 3.11) lets this run."""

import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vrte.exports.export import integrate_over_hemisphere
from vrte.exports.fitted import OPENPBR, FittedFile

from .helpers import assert_close

pytestmark = pytest.mark.slow
MU = np.array([0.3, 0.5, 0.9])
PIXELS, SAMPLES = 8, 256
INPUTS = {"specular_roughness": "Roughness", "specular_ior": "IOR", "base_metalness": "Metallic"}


def render_furnace(values: dict[str, str], mu: float, folder: Path) -> Any:
    """The radiance (3,) that a plate sends back at a cosine, lit by 1 from all sides, with light met once."""
    bpy = pytest.importorskip("bpy", reason="Blender is not installed: pip install bpy")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene, world = bpy.context.scene, bpy.data.worlds.new("white")
    scene.render.engine, scene.world, world.use_nodes = "CYCLES", world, True
    scene.cycles.samples, scene.cycles.max_bounces, scene.cycles.use_adaptive_sampling = SAMPLES, 1, False
    scene.render.resolution_x = scene.render.resolution_y = PIXELS
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    world.node_tree.nodes["Background"].inputs[0].default_value = (1.0, 1.0, 1.0, 1.0)
    bpy.ops.mesh.primitive_plane_add(size=1000.0)
    material = bpy.data.materials.new("material")
    material.use_nodes = True
    inputs = material.node_tree.nodes["Principled BSDF"].inputs
    inputs["Base Color"].default_value = (*map(float, values["base_color"].split(",")), 1.0)
    for name, blender in INPUTS.items():
        inputs[blender].default_value = float(values[name])
    bpy.context.object.data.materials.append(material)
    lens = bpy.data.cameras.new("camera")
    camera = bpy.data.objects.new("camera", lens)
    scene.collection.objects.link(camera)
    scene.camera, lens.type, lens.ortho_scale = camera, "ORTHO", 0.1
    camera.location, camera.rotation_euler = (5.0 * np.sqrt(1.0 - mu * mu), 0.0, 5.0 * mu), (0.0, np.arccos(mu), 0.0)
    scene.render.filepath = str(folder / "furnace.exr")
    bpy.ops.render.render(write_still=True)
    picture = bpy.data.images.load(scene.render.filepath)
    picture.colorspace_settings.name = "Non-Color"
    return np.array(picture.pixels[:]).reshape(PIXELS, PIXELS, 4)[..., :3].mean(axis=(0, 1))


@pytest.mark.parametrize(
    ("numbers", "off"),
    [
        pytest.param([0.24, 0.087, 0.068, 0.32, 1.5, 0.0, 0.0, 1.6], 0.02, id="satin red paint"),
        pytest.param(
            [0.9, 0.6, 0.2, 0.4, 1.5, 1.0, 0.0, 1.6], 0.11, id="rough gold"
        ),  # Blender gives back what facets hide
        pytest.param([0.8, 0.8, 0.8, 0.9, 1.0001, 0.0, 0.0, 1.6], 5e-3, id="white diffuser"),
    ],
)
def test_blender_reflects_as_much_as_the_file_says(numbers: list[float], off: float, tmp_path: Path) -> None:
    file = FittedFile(OPENPBR, np.array(numbers), 0.0, 0.0)
    file.write(tmp_path / "a.mtlx", "")
    surface = ElementTree.parse(tmp_path / "a.mtlx").getroot().find("open_pbr_surface")
    assert surface is not None
    values = {str(one.get("name")): str(one.get("value")) for one in surface}
    found = [render_furnace(values, mu, tmp_path) for mu in MU]
    assert np.all(np.array(found) > 0.05)
    assert_close(found, integrate_over_hemisphere(file, MU).reshape(3, 3), rtol=0.0, atol=off)
