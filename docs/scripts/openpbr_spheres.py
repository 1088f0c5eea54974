"""The spheres of docs/how_to/openpbr.md: materials as they are solved, and fitted by OpenPBR, traced by Mitsuba.

python -m docs.scripts.openpbr_spheres -o out/openpbr
"""

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

import vrte
import vrte.mitsuba
from vrte.appearance.colours import encode_srgb
from vrte.appearance.panel import choose_wavelengths, read_source
from vrte.basics.arrays import Array
from vrte.calls.spectrum import prepare_scenes
from vrte.exports.colour import weigh_channels
from vrte.exports.export import find_smooth_surface, integrate_over_hemisphere
from vrte.exports.fitted import OPENPBR, FittedFile, Geometry, fit_model, shade_mirror
from vrte.exports.half_vectors import BEAMS, STEEPEST, HalfVectorTable, make_axes, place_light
from vrte.formats.materials import list_materials, list_paints
from vrte.formats.measured_polarized import make_pairs, normalise
from vrte.mitsuba.bsdf import make_bsdf
from vrte.optics.fresnel import reflect_smooth

PAINTS = "white gloss", "grey satin", "red oxide", "silver metallic", "gold pearl", "white pearl"
MATERIALS: dict[str, Any] = {name: list_paints()[name].content for name in PAINTS}
MATERIALS |= {"gold powder": list_materials()["gold powder"].content, "chalk": list_materials()["chalk"].content}
MATERIALS |= {"wet powder": "vrte/app/gallery/powder_wet.toml", "snow": "examples/still_life/4_knot.toml"}
WAVELENGTHS, COLUMNS = 9, 2
MU = np.linspace(0.1, 1.0, 10)
PIXELS, SAMPLES = 220, 256


def tabulate_fit(fit: FittedFile, smooth: float | None) -> HalfVectorTable:
    """A fitted model in linear sRGB as the BSDF `vrte` takes it: a smooth surface's lobe is a mirrored beam."""
    axes = make_axes()
    light, view, _ = place_light(*(axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")))
    light[:, 2] = np.maximum(light[:, 2], 1e-3)
    half = normalise(light + view)
    at, beam = Geometry(light[:, 2], view[:, 2], (half * view).sum(axis=1), half[:, 2]), None
    values = fit.model.shade(fit.numbers, at)
    if smooth is not None:
        values = values - shade_mirror(smooth, at)[:, None]
        mu = np.cos(STEEPEST * np.sin(0.5 * np.pi * np.linspace(0.0, 1.0, BEAMS)))
        beam = np.repeat(reflect_smooth(smooth, mu)[:, None, :1, :1], 3, axis=1).astype(np.float32)
    values = (at.mu_i + at.mu_o)[:, None] * values
    return HalfVectorTable(np.zeros(0), values.reshape(*map(len, axes), 3, 1, 1).astype(np.float32), beam)


@dataclass
class FromTheEye:
    """A fitted model with light and eye swapped: its reflectance is what an eye sees in even light."""

    fit: FittedFile

    def evaluate(self, mu_i: Array, mu_o: Array, phi: Array) -> Array:
        """The BRDF (k, n, 3, 1, 1) [sr-1] for an eye at mu_i (k,) and light at mu_o, phi (k, n)."""
        eye, light = make_pairs(mu_i[:, None], mu_o, phi)
        return self.fit.model.shade(self.fit.numbers, Geometry.of(light, eye)).reshape(*mu_o.shape, 3, 1, 1)

    def write(self, path: Path, text: str) -> None:
        """Nothing is written."""


def make_room() -> Array:
    """Radiances (height, width, 3) all around: a sky, a darker ground and a window at the upper left."""
    height, azimuth = np.mgrid[:128, :256]
    height, azimuth = 90.0 - (height + 0.5) * 180.0 / 128, (azimuth + 0.5) * 360.0 / 256
    room = np.where(height > 0.0, 0.3 + 0.3 * np.sin(np.radians(np.abs(height))), 0.12)
    room[(np.abs(height - 40.0) < 18.0) & (np.abs(azimuth - 230.0) < 16.0)] = 5.0
    return np.repeat(room[..., None], 3, axis=2).astype(np.float32)


def trace(bsdf: Any) -> Array:
    """A sphere of a BSDF as linear sRGB (PIXELS, PIXELS, 4), the last its coverage."""
    mi = vrte.mitsuba.bsdf.mi
    turned = mi.ScalarTransform4f().rotate([1, 0, 0], 90)
    view = mi.ScalarTransform4f().look_at(origin=[0, -5, 0.8], target=[0, 0, 0], up=[0, 0, 1])
    film = {"type": "hdrfilm", "width": PIXELS, "height": PIXELS, "pixel_format": "rgba"}
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 3, "hide_emitters": True},
        "sensor": {"type": "perspective", "fov": 24, "to_world": view, "film": film},
        "ball": {"type": "sphere", "bsdf": bsdf},
        "room": {"type": "envmap", "bitmap": mi.Bitmap(make_room()), "to_world": turned},
        "lamp": {
            "type": "sphere", "center": [3.5, -4.0, 4.0], "radius": 0.6,
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 30.0}},
        },
    }  # fmt: skip
    return np.array(mi.render(mi.load_dict(scene), spp=SAMPLES))


def compare_spheres(name: str, output: Path) -> tuple[str, Array, FittedFile, float]:
    """Of a material: its name, both spheres in linear sRGB beside each other, the fit, and the largest difference of
    reflectances in even light."""
    scene = MATERIALS[name]
    content, folder = read_source(scene, ".")
    wavelengths = np.linspace(*np.asarray(choose_wavelengths(content, folder))[[0, -1]], WAVELENGTHS)
    file = output / f"{name.replace(' ', '_')}.nc"
    if not file.is_file():
        vrte.export(scene, file, wavelengths, accuracy=1e-4)
    spectrum = vrte.load(file)
    files, _ = prepare_scenes(content | {"brdf": {"mu_i": 1.0, "mu_o": 1.0}}, spectrum.wavelength_um, folder)
    smooth = find_smooth_surface(files, spectrum)
    fit = fit_model(OPENPBR, spectrum, [one.scene.facets_on_top for one in files], smooth)
    reflected = [np.interp(MU, one.mu_i[::-1], one.total_reflectance[::-1]) for one in spectrum]
    wanted = np.transpose(reflected) @ weigh_channels(spectrum.wavelength_um).T
    energy = float(np.abs(integrate_over_hemisphere(FromTheEye(fit), MU) - wanted).max())
    vrte.mitsuba.bsdf.mi.set_variant("llvm_ad_rgb")
    exact, fitted = trace({"type": "vrte", "filename": str(file)}), trace(make_bsdf(tabulate_fit(fit, smooth)))
    return name, np.concatenate([exact, fitted], axis=1), fit, energy


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/openpbr"))
    parser.add_argument("--processes", type=int, default=1)
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    figure, axes = plt.subplots(-(-len(MATERIALS) // COLUMNS), COLUMNS, figsize=(9.6, 15.75), layout="constrained")
    print("| material | CIEDE2000: median, 95 % | energy | base colour | roughness | index | metalness | coat |")
    with ProcessPoolExecutor(options.processes, get_context("spawn")) as pool:
        found = pool.map(partial(compare_spheres, output=options.output), MATERIALS)
        for axis in axes.flat:
            axis.set_axis_off()
        for axis, (name, pair, fit, energy) in zip(axes.flat, found, strict=False):
            cover = np.clip(pair[..., 3:], 0.0, 1.0)
            axis.imshow(encode_srgb(np.clip(pair[..., :3] + 1.0 - cover, 0.0, 1.0)))
            off = f"{fit.median:.1f}, {fit.most:.1f}"
            axis.set_title(f"{name}\nCIEDE2000 {off}; energy {energy:.2f}", fontsize=17, y=-0.22)
            colour, (roughness, index, metalness, coat, coat_index) = fit.numbers[:3], fit.numbers[3:]
            print(
                f"| {name} | {off} | {energy:.3f} | {', '.join(f'{one:.2f}' for one in colour)} | {roughness:.2f} "
                f"| {index:.2f} | {metalness:.2f} | {f'{coat_index:.2f}' if coat else 'none'} |",
                flush=True,
            )
    figure.savefig(options.output / "openpbr_spheres.png", dpi=100, pil_kwargs={"optimize": True})


if __name__ == "__main__":
    main()
