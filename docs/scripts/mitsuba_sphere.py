"""The picture of docs/how_to/exports.md: a sphere of gold particles by Mitsuba, in sunlight and a faint even sky.

python -m docs.scripts.mitsuba_sphere -o out
"""

import argparse
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import vrte
import vrte.mitsuba
from vrte.appearance.colours import encode_srgb

GOLD = {
    "particles": {"gold": {"index": "gold", "size": {"lognormal": {"median_um": 0.1, "sigma": 1.5}}}},
    "layer": [{"particles": "gold", "thickness": 3.0}],
    "base": {"kind": "lambertian", "albedo": 0.6},
}
PIXELS, RANGES = 160, (0.15, 0.15, 0.01)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("out"))
    options = parser.parse_args()
    import mitsuba

    mitsuba.set_variant("llvm_ad_spectral_polarized")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "gold.nc")
        vrte.export(GOLD, path, [0.45, 0.5, 0.55, 0.6, 0.65])
        view = mitsuba.ScalarTransform4f().look_at(origin=[0, -5, 0], target=[0, 0, 0], up=[0, 0, 1])
        film = {"type": "hdrfilm", "width": PIXELS, "height": PIXELS, "rfilter": {"type": "box"}}
        scene = {
            "type": "scene",
            "integrator": {"type": "stokes", "nested": {"type": "path", "max_depth": 2}},
            "sensor": {"type": "perspective", "fov": 25, "to_world": view, "film": film},
            "sphere": {"type": "sphere", "bsdf": {"type": "vrte", "filename": str(path)}},
            "sun": {"type": "directional", "direction": [1, 1.2, -1], "irradiance": {"type": "d65", "scale": 3.0}},
            "sky": {"type": "constant", "radiance": {"type": "d65", "scale": 0.15}},
        }
        found = np.array(mitsuba.render(mitsuba.load_dict(scene), spp=1024))
    stokes = found[..., -12:].reshape(PIXELS, PIXELS, 4, 3)
    row, column = np.mgrid[:PIXELS, :PIXELS] - 0.5 * (PIXELS - 1)
    ball = np.hypot(row, column) < 0.5 * PIXELS / np.tan(np.radians(12.5)) / np.sqrt(24.0)
    luminance = stokes @ [0.2126, 0.7152, 0.0722]
    figure, axes = plt.subplots(1, 4, figsize=(9.0, 2.34), layout="constrained")
    axes[0].imshow(np.where(ball[..., None], encode_srgb(np.clip(stokes[:, :, 0], 0.0, 1.0)), 1.0))
    axes[0].set_title("S0")
    for number, (axis, most) in enumerate(zip(axes[1:], RANGES, strict=True), 1):
        ratio = np.where(ball, luminance[..., number] / np.maximum(luminance[..., 0], 1e-9), np.nan)
        shown = axis.imshow(ratio, cmap="RdBu", vmin=-most, vmax=most)
        axis.set_title(f"S{number}/S0")
        figure.colorbar(shown, ax=axis, ticks=[-most, 0.0, most], shrink=0.8)
    for axis in axes:
        axis.set_axis_off()
    options.output.mkdir(parents=True, exist_ok=True)
    figure.savefig(options.output / "mitsuba_sphere.png", dpi=100)


if __name__ == "__main__":
    main()
