"""The hiding curve as a figure: contrast ratio against thickness, and luminance over both cards."""

from typing import TYPE_CHECKING

import numpy as np

from vrte.pictures.figures import COLOURS, FAINT, make_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from vrte.appearance.hiding import Hiding

FINE = 400  # points of a smooth curve
INK, MARK = "#222222", COLOURS["reconstruction"]
SIZE = 9.0, 3.6  # [inches]


def draw_hiding(hiding: "Hiding") -> "Figure":
    """Contrast ratio, with the target and the thickness that reaches it, beside Y over black, over white and without
    end; dots are exact solves, and a line stands where the panel's own film is. Raises MissingExtraError."""
    figure = make_figure(*SIZE)
    from matplotlib.ticker import LogLocator

    left, right = figure.subplots(1, 2)
    scale, unit = (hiding.length_um, " µm") if hiding.length_um else (1.0, " times the film")
    fine = np.geomspace(hiding.times[0], hiding.times[-1], FINE).clip(hiding.times[0], hiding.times[-1])
    contrast, over_white = hiding.interpolate(fine)
    curves = (
        (left, contrast, hiding.contrast_ratios, INK, ""),
        (right, over_white, hiding.over_white, COLOURS["particular"], f"over white, {hiding.white:g}"),
        (right, contrast * over_white, hiding.over_black, COLOURS["homogeneous"], f"over black, {hiding.black:g}"),
    )
    for panel, smooth, exact, colour, words in curves:
        panel.plot(scale * fine, smooth, color=colour, label=words)
        panel.plot(scale * hiding.times, exact, "o", color=colour, markersize=3)
    left.axhline(hiding.target, color=MARK, linewidth=1, linestyle="--")
    if hiding.hiding_times:
        words = f"{hiding.target:g} at {scale * hiding.hiding_times:.3g}{unit}"
        (mark,) = left.plot([scale * hiding.hiding_times], [hiding.target], "o", color=MARK)
        left.legend([mark], [words], loc="lower right", fontsize=9, frameon=False)
    right.axhline(hiding.luminance_without_end, color=INK, linewidth=1, linestyle=":", label="without end")
    right.legend(fontsize=9, frameon=False)
    left.set_ylabel("contrast ratio")
    right.set_ylabel(f"luminance Y, {hiding.geometry}, {hiding.illuminant}, {hiding.observer}°")
    for panel in (left, right):
        panel.axvline(scale, color=FAINT, linewidth=1, zorder=0)
        where = {"xycoords": ("data", "axes fraction"), "xytext": (3, 0), "textcoords": "offset points"}
        panel.annotate("this film", (scale, 0.4), fontsize=8, color=INK, rotation=90, **where)
        panel.set(xscale="log", ylim=(0.0, None), xlabel=f"thickness of the dry film,{unit}")
        panel.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        panel.xaxis.set_major_formatter("{x:g}")
        panel.xaxis.set_minor_formatter("")
        panel.tick_params(labelsize=9)
    figure.tight_layout()
    return figure
