"""Lobes of the ready metallic, pearl and colour-shifting paints in the plane of incidence, at three wavelengths.

``python -m docs.scripts.flake_lobes -o FOLDER`` writes gallery_flake_lobes.csv and gallery_flake_lobes.png there.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bench.study import write_rows
from vrte.basics.arrays import Array
from vrte.calls.brdf import brdf
from vrte.formats.materials import list_paints
from vrte.formats.scene_file import make_scene_file
from vrte.pictures.figures import require_pictures, save

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAINTS = ("silver metallic", "gold pearl", "colour shifter")
COLOURS = {0.45: "#1f4e79", 0.55: "#2c8c4a", 0.65: "#a02c2c"}  # by wavelength [um]
INCIDENCE_DEG = 45.0
ANGLES_DEG = np.arange(-80.0, 81.0, 2.0)  # of the light that leaves; above 0 on the mirror direction's side
ACCURACY = 1e-4
HEADER = ("paint", "wavelength_um", "angle_deg", "radiance_factor", "degree_of_linear_polarization")


class Lobe(NamedTuple):
    """Radiance factor pi f00, and degree of linear polarization for unpolarized incident light, at the given angles."""

    paint: str
    wavelength_um: float
    factor: Array
    degree: Array


def compute_lobe(paint: str, wavelength_um: float, angles_deg: Array) -> Lobe:
    """The lobe without the mirrored beam; angles on the mirror direction's side have azimuth 0, the others 180."""
    mu_i = float(np.cos(np.radians(INCIDENCE_DEG)))
    mu_o, order = np.unique(np.cos(np.radians(np.abs(angles_deg))).round(12), return_inverse=True)
    asked = {"mu_i": mu_i, "mu_o": mu_o.tolist(), "phi_deg": [0.0, 180.0]}
    content = {"wavelength_um": wavelength_um, "brdf": asked, **list_paints()[paint].content}
    found = brdf(make_scene_file(content).scene, mu_i, mu_o, asked["phi_deg"], accuracy=ACCURACY)
    stokes = found.mueller[0, order, np.where(angles_deg >= 0.0, 0, 1), :, 0]
    return Lobe(paint, wavelength_um, np.pi * stokes[:, 0], np.hypot(stokes[:, 1], stokes[:, 2]) / stokes[:, 0])


def draw_figure(lobes: Sequence[Lobe], angles_deg: Array) -> "Figure":
    """A column for each paint: radiance factors above, degrees of linear polarization below."""
    require_pictures()
    from matplotlib.figure import Figure

    drawing = Figure(figsize=(11.0, 5.4), facecolor="white", layout="constrained")
    panels = drawing.subplots(2, len(PAINTS), sharex=True, squeeze=False)
    for lobe in lobes:
        column = PAINTS.index(lobe.paint)
        label = f"{1e3 * lobe.wavelength_um:.0f} nm"
        for panel, values in zip(panels[:, column], (lobe.factor, lobe.degree), strict=True):
            panel.plot(angles_deg, values, color=COLOURS[lobe.wavelength_um], label=label)
    for column, paint in enumerate(PAINTS):
        panels[0, column].set(title=paint, ylim=(0.0, None))
        panels[1, column].set(xlabel="angle of the light that leaves [deg]", ylim=(0.0, 1.0))
    panels[0, 0].set_ylabel("radiance factor")
    panels[1, 0].set_ylabel("degree of linear polarization")
    for panel in panels.flat:
        panel.axvline(INCIDENCE_DEG, color="#8c8c8c", linewidth=0.8, linestyle=":")
        panel.grid(color="#d0d0d0", linewidth=0.5)
    panels[0, 0].legend(fontsize=8, frameon=False, loc="upper left")
    return drawing


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line: ``-o FOLDER``."""
    parser = argparse.ArgumentParser(prog="python -m docs.scripts.flake_lobes", description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/gallery"), help="folder to write to")
    options = parser.parse_args(arguments)
    lobes = [compute_lobe(paint, um, ANGLES_DEG) for paint in PAINTS for um in COLOURS]
    options.output.mkdir(parents=True, exist_ok=True)
    rows = ((lobe, *row) for lobe in lobes for row in zip(ANGLES_DEG, lobe.factor, lobe.degree, strict=True))
    written = ((lobe.paint, lobe.wavelength_um, angle, f"{f:.5g}", f"{p:.4f}") for lobe, angle, f, p in rows)
    write_rows(options.output / "gallery_flake_lobes.csv", HEADER, written)
    save(draw_figure(lobes, ANGLES_DEG), options.output / "gallery_flake_lobes.png")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
