"""The paper's figure, from results of our own: `python paper/figure.py` writes paper/figure.png.

Left, the runs kept in docs/explanation/methods/methods.csv; right, white paint solved here, in the plane of incidence.
"""

import sys
import warnings
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

import vrte

ROOT = Path(__file__).parents[1]
sys.path.append(str(ROOT))  # of bench

from bench.methods import Row  # noqa: E402
from bench.study import Records  # noqa: E402

SCENE = "rutile powder"
CURVES = {  # of the methods' report: words, colour, marker
    "auto": ("vrte, auto", "#c1121f", "o"),
    "discrete-ordinates, doubling": ("impedance doubling", "#e07a1f", "s"),
    "matrix-operator": ("matrix operator", "#2a6f97", "^"),
    "adding-doubling": ("adding-doubling", "#386641", "v"),
    "successive-orders": ("successive orders", "#7b2d8b", "D"),
    "sasktran2 (light up, no V)": ("sasktran2 (I, Q, U)", "#6c757d", "x"),
}
SURFACES = {
    "none": ("no surface", "#6c757d", ":"),
    "rough": ("rough, 0.2", "#e07a1f", "--"),
    "smooth": ("smooth", "#c1121f", "-"),
}
ANGLE_I = 53.13  # degrees, cosine 0.6
SEEN = np.arange(-85.0, 86.0, 2.5)  # degrees from the normal, negative towards the light


def read_runs() -> dict[str, list[Row]]:
    """The measured runs of the scene, by curve and from quick to slow."""
    rows = Records(Row, ROOT / "docs/explanation/methods/methods.csv").read().values()
    runs = [row for row in rows if row.scene == SCENE and row.is_measured]
    return {
        curve: sorted((row for row in runs if row.curve == curve), key=lambda row: row.nodes or row.seconds)
        for curve in CURVES
    }


def find_polarization(surface: str) -> np.ndarray:
    """Degree of linear polarization [%] of unpolarized light that white paint scatters, along SEEN."""
    rutile = vrte.spheres("rutile", radius_um=0.125, wavelength_um=0.55, host_index=1.5)
    layers: list[vrte.Layer | vrte.Interface] = [vrte.Layer.of(rutile, thickness_um=40.0, volume_fraction=0.15)]
    if surface != "none":
        layers.insert(0, vrte.Interface(1.0, 1.5, roughness=0.2 if surface == "rough" else 0.0))
    scene, cosines = vrte.Scene(layers), np.cos(np.radians(SEEN))
    mueller = vrte.brdf(scene, np.cos(np.radians(ANGLE_I)), cosines, phi=[0.0, 180.0], accuracy=1e-4).mueller[0]
    light = np.where(SEEN[:, None] > 0.0, mueller[:, 0, :, 0], mueller[:, 1, :, 0])
    return 100.0 * np.hypot(light[:, 1], light[:, 2]) / light[:, 0]


def draw_runs(axes: Axes) -> None:
    """Error against run time."""
    for curve, runs in read_runs().items():
        words, colour, marker = CURVES[curve]
        axes.loglog(
            [run.seconds for run in runs], [run.worst for run in runs], marker=marker, color=colour, label=words
        )
    axes.set(xlabel="run time [s]", ylabel="largest error / largest $I$", xlim=(1e-4, 5), ylim=(3e-13, 1))
    axes.legend(loc="lower left", fontsize=6.5)


def draw_polarization(axes: Axes) -> None:
    """Polarization against the angle of sight."""
    for surface, (words, colour, line) in SURFACES.items():
        axes.plot(SEEN, find_polarization(surface), line, color=colour, label=words)
    axes.axvline(ANGLE_I, color="0.8", linewidth=0.8, zorder=0)
    axes.set(xlabel="angle of sight [degrees]", ylabel="degree of linear polarization [%]", xticks=range(-90, 91, 30))
    axes.set_ylim(bottom=0.0)
    axes.legend(loc="upper left", title="surface of the paint", fontsize=6.5, title_fontsize=6.5)


def main() -> None:
    """Writes the figure beside this file."""
    warnings.simplefilter("ignore", vrte.IndependentScatteringWarning)  # 15 % is much, and what paints have
    plt.rcParams.update({"font.size": 8, "lines.linewidth": 1.2, "lines.markersize": 3.5, "legend.frameon": False})
    figure, (left, right) = plt.subplots(1, 2, figsize=(6.4, 2.6), layout="constrained")
    draw_runs(left)
    draw_polarization(right)
    for axes, letter in ((left, "a"), (right, "b")):
        axes.set_title(letter, loc="left", fontweight="bold")
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(Path(__file__).with_name("figure.png"), dpi=300, metadata={"Software": None})


if __name__ == "__main__":
    main()
