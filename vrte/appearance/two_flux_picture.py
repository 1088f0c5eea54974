"""How good two fluxes are, as a figure: reflectance and colour against thickness, and what K and S are made of."""

from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.appearance.two_flux_fit import BACKGROUNDS, TwoFluxErrors
from vrte.basics.errors import SceneError
from vrte.pictures.figures import FAINT, make_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from vrte.appearance.two_flux_fit import KubelkaMunk

LINES = "--", "-"  # over black, over white
SHADES = "#1f4e79", "#2a8f5b", "#b3262e"  # of a short, a middle and a long wavelength
SEEN = 0.5  # CIEDE2000 that is hardly seen side by side


def draw_two_fluxes(found: "KubelkaMunk", errors: TwoFluxErrors) -> "Figure":
    """Four panels: reflectance and its error against thickness, the colour difference, K and S against wavelength."""
    order = np.argsort(errors.lengths)
    ends = np.isfinite(errors.lengths[order])
    order = order[ends]
    if order.size < 2:
        raise SceneError("lengths must be two or more that end, for a picture", "lengths")
    figure = make_figure(10.0, 6.4)
    (top, right), (bottom, below) = figure.subplots(2, 2, height_ratios=(3, 2))
    lengths, unit = errors.lengths[order], errors.unit[2:].replace("um", "µm")
    between = np.geomspace(lengths[0], lengths[-1], 100)
    count = errors.wavelength_um.size
    for place, shade in zip(sorted({0, count // 2, count - 1}), SHADES, strict=False):
        for over, style in enumerate(LINES):
            label = f"{1e3 * errors.wavelength_um[place]:.0f} nm, over {BACKGROUNDS[over]}"
            said = [found.predict(length, found.white * over)[place] for length in between]
            top.plot(between, said, style, color=shade, linewidth=1.2, label=label)
            top.plot(lengths, errors.exact[over, order, place], "o", color=shade, markersize=3.5)
            bottom.plot(lengths, errors.error[over, order, place], style, color=shade, marker="o", markersize=3)
    top.set_ylim(0.0, 1.0)
    top.legend(fontsize=7, frameon=False)
    draw_differences(right, errors, order)
    draw_coefficients(below, found)
    titles = {
        top: "reflectance: exact (points), by K and S (lines)",
        bottom: "by K and S less exact",
        right: "colour difference, CIEDE2000",
    }
    for panel, title in titles.items():
        panel.set_title(title, fontsize=10)
        panel.set_xscale("log", base=2)
        panel.set_xticks(
            lengths[:: max(1, lengths.size // 7)],
            [f"{one:.3g}" for one in lengths[:: max(1, lengths.size // 7)]],
            fontsize=8,
        )
        panel.axvline(found.length, color=FAINT, linewidth=1.0, zorder=0)
        panel.set_xlabel(f"thickness of the film [{unit}]; grey: where K and S are from", fontsize=8)
        panel.tick_params(labelsize=8)
    figure.suptitle(f"{found.panel.title or 'Kubelka and Munk'}, read {found.geometry.name}", fontsize=11)
    figure.tight_layout()
    return figure


def draw_differences(panel: Any, errors: TwoFluxErrors, order: Any) -> None:
    """Colour differences over both bases, and what is hardly seen; in words why not, where there are no colours."""
    try:
        found = errors.difference
    except SceneError as error:
        panel.text(0.5, 0.5, str(error), ha="center", va="center", wrap=True, fontsize=8, transform=panel.transAxes)
        return
    for over, style in enumerate(LINES):
        label = f"over {BACKGROUNDS[over]}"
        panel.plot(
            errors.lengths[order], found[over, order], style, color="black", marker="o", markersize=3, label=label
        )
    panel.axhline(SEEN, color=FAINT, linewidth=1.0)
    panel.set_ylim(bottom=0.0)
    panel.legend(fontsize=8, frameon=False)


def draw_coefficients(panel: Any, found: "KubelkaMunk") -> None:
    """K and S against wavelength, down to 1e-6 of the largest S, and what diffusion makes of absorption and
    scattering."""
    for name, values, said, shade in zip(
        "KS", (found.K, found.S), found.diffusion, ("#b3262e", "#1f4e79"), strict=True
    ):
        panel.plot(found.wavelength_um, values, "-", color=shade, label=f"{name}")
        panel.plot(
            found.wavelength_um, np.where(said > 0.0, said, np.nan), ":", color=shade, label=f"{name} of diffusion"
        )
    panel.set_yscale("log")
    most = found.S.max() or 1.0
    panel.set_ylim(1e-6 * most, 3.0 * max(most, found.K.max()))
    panel.set_title(f"K and S [{found.unit.replace('um', 'µm')}]", fontsize=10)
    panel.set_xlabel("wavelength [µm]", fontsize=8)
    panel.tick_params(labelsize=8)
    panel.legend(fontsize=7, frameon=False)
