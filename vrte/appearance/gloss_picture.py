"""Gloss of a clear surface over black against its roughness: what the lobe alone leaves in a glossmeter's receptor."""

from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.appearance.gloss import RECEPTORS, find_surface_gloss
from vrte.basics.arrays import check_whole
from vrte.pictures.figures import make_figure
from vrte.scene.interface import DISTRIBUTIONS, LEAST_ROUGHNESS, Interface

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = {20.0: "#1f4e79", 60.0: "#2a8f5b", 85.0: "#d98200"}
LINES = {"beckmann": "-", "ggx": "--"}
ROUGHEST = 1.0


def draw_gloss(index: float = 1.5, count: int = 25, shadowing: bool = True) -> "Figure":
    """Gloss units at 20, 60 and 85 degrees of a surface over black, for alpha from 0.01 to 1 and both kinds of facets;
    dots at the left edge are the smooth surface."""
    figure = make_figure(6.4, 4.0)
    axes = figure.subplots()
    alphas = np.geomspace(LEAST_ROUGHNESS, ROUGHEST, check_whole("count", count, 2, 1000))
    smooth = Interface(1.0, index)
    for angle in RECEPTORS:
        style: dict[str, Any] = {"color": COLOURS[angle]}
        for kind in DISTRIBUTIONS:
            rough = [Interface(1.0, index, alpha, kind, shadowing) for alpha in alphas]  # type: ignore[arg-type]
            glosses = [find_surface_gloss(surface, angle) for surface in rough]
            label = f"{angle:g}°, {kind}"
            axes.plot(alphas, glosses, LINES[kind], label=label, **style)
        axes.plot(0.85 * LEAST_ROUGHNESS, find_surface_gloss(smooth, angle), "o", markersize=4, **style)
    axes.set(xscale="log", yscale="log", xlabel="roughness alpha", ylabel="gloss units of the surface alone")
    axes.set_ylim(0.005, 150.0)
    axes.legend(frameon=False, fontsize=8)
    axes.set_title(f"Index {index:g}, over black", fontsize=10)
    figure.tight_layout()
    return figure
