"""The pictures of a paint's page: a drawdown card, spectra, hiding, a polar cut, angles, polarization, K and S.

Each function draws into the axes that it is given; `FIGURES` lists them with what each shows, in words.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from vrte.appearance.appearance import VISUAL
from vrte.appearance.geometries import MULTI_ANGLE, read_geometry
from vrte.appearance.paint import LOBE_DEG, Paint, cut_lobe
from vrte.pictures.figures import FAINT, limit_ticks, make_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INK, BLUE, ORANGE, GREEN, RED = "#222222", "#1f4e79", "#d98200", "#2a8f5b", "#b3262e"
BLACK_CARD, WHITE_CARD = "#1b1b1b", "#e6e6e6"  # Y of a card of 0.8 in sRGB
FINE = 200  # points of a smooth curve
SIZE = 4.6, 3.3  # [inches] of one picture
SHEET = 14.4, 10.4  # and of all of them


class Picture(NamedTuple):
    """What a picture is called, what draws it, and whether its axes are polar."""

    title: str
    draw: Callable[[Any, Paint], None]
    polar: bool = False


def draw_card(axes: Any, paint: Paint) -> None:
    """A drawdown card: the film across black and white, its colours as a screen shows them."""
    from matplotlib.patches import Rectangle

    shown = list(paint.colours.items())[:2]
    for place, (name, colour) in enumerate(shown):
        width = 1.0 / len(shown)
        card = (BLACK_CARD, WHITE_CARD)[place]
        axes.add_patch(Rectangle((place * width, 0.0), width, 1.0, color=card, linewidth=0))
        axes.add_patch(Rectangle((place * width, 0.12), width, 0.76, color=colour.hex, linewidth=0))
        ink = INK if colour.L > 55.0 else "white"
        gap = "" if colour.is_in_gamut else f"\nout of the screen's colours\nby {colour.gamut_gap:.1f} CIEDE2000"
        words = f"{name}\n{colour.hex}\nL* {colour.L:.1f}  a* {colour.a:.1f}  b* {colour.b:.1f}{gap}"
        axes.text((place + 0.5) * width, 0.5, words, color=ink, ha="center", va="center", fontsize=9, linespacing=1.4)
    axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    axes.set_axis_off()


def draw_reflectance(axes: Any, paint: Paint) -> None:
    """Reflectance factors over black, over white and without end, and all light of the panel as it lies."""
    at = paint.look.wavelength_um
    if paint.hiding is not None:
        seen = paint.hiding
        rows = (
            (seen.without_end, "without end", INK, ":"),
            (seen.reflectance_over_white, "over white", ORANGE, "-"),
            (seen.reflectance_over_black, "over black", BLUE, "-"),
        )
        for values, name, colour, dash in rows:
            axes.plot(at, values, dash, color=colour, label=f"{name}, {seen.geometry}")
    else:
        axes.plot(at, paint.look.reflectance(VISUAL), color=BLUE, label=f"as it lies, {VISUAL}")
    axes.plot(at, paint.look.reflectance("8:di"), "--", color=GREEN, linewidth=1.2, label="as it lies, 8:di (SPIN)")
    axes.set(xlabel="wavelength [µm]", ylabel="reflectance factor", ylim=(0.0, None))
    axes.legend(fontsize=7, frameon=False)


def draw_hiding_curve(axes: Any, paint: Paint) -> None:
    """Contrast ratio against thickness, with what counts as hidden."""
    hiding = paint.hiding
    if hiding is None:
        return say_missing(axes, "no hiding curve: see the notes")
    scale, unit = (hiding.length_um, "µm") if hiding.length_um else (1.0, "films")
    fine = np.geomspace(hiding.times[0], hiding.times[-1], FINE).clip(hiding.times[0], hiding.times[-1])
    axes.plot(scale * fine, hiding.interpolate(fine)[0], color=INK)
    axes.plot(scale * hiding.times, hiding.contrast_ratios, "o", color=INK, markersize=3, label="solved")
    axes.axhline(hiding.target, color=RED, linewidth=1, linestyle="--")
    axes.axvline(scale, color=FAINT, linewidth=1.2, label="this film")
    if hiding.hiding_times:
        words = f"{hiding.target:g} at {scale * hiding.hiding_times:.3g} {unit}"
        axes.plot([scale * hiding.hiding_times], [hiding.target], "o", color=RED, label=words)
    axes.set(xscale="log", ylim=(0.0, 1.05), xlabel=f"dry film [{unit}]", ylabel="contrast ratio")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.legend(fontsize=7, frameon=False, loc="lower right")


def draw_polar_cut(axes: Any, paint: Paint) -> None:
    """pi times the BRDF in the plane of incidence: 1 is the perfect white diffuser's half circle of radius."""
    angle, light = cut_lobe(paint.lobe)
    factor = np.pi * np.maximum(light[:, 0], 0.0)
    top = 1.08 * max(factor.max(), 1e-6)
    axes.plot(np.radians(angle), factor, color=BLUE)
    incident = np.radians(LOBE_DEG)
    axes.plot([-incident] * 2, [0.0, top], color=RED, linewidth=1.2, label="incident light")
    if paint.lobe.specular is not None:
        share = 100.0 * float(paint.lobe.specular[0, 0, 0])
        words = f"mirrored beam, {share:.3g} %, not in the curve"
        axes.plot([incident] * 2, [0.0, top], "--", color=GREEN, linewidth=1.2, label=words)
    axes.set_theta_zero_location("N"), axes.set_theta_direction(-1)
    axes.set_thetalim(-np.pi / 2.0, np.pi / 2.0), axes.set_ylim(0.0, top)
    axes.set_thetagrids(range(-90, 91, 30), fontsize=7)
    axes.set_rlabel_position(90.0), axes.tick_params(axis="y", labelsize=7)
    axes.yaxis.set_major_locator(limit_ticks())
    axes.legend(fontsize=7, frameon=False, loc="upper center", bbox_to_anchor=(0.5, 0.1), ncols=1)


def draw_angles(axes: Any, paint: Paint) -> None:
    """Y at the angles of multi-angle instruments, off the mirrored beam of light at 45 degrees."""
    offs = [LOBE_DEG - float(read_geometry(name).angle_o or 0.0) for name in MULTI_ANGLE]
    luminances = [paint.look.colour(name).Y for name in MULTI_ANGLE]
    axes.plot(offs, luminances, "o-", color=BLUE, markersize=4)
    for off, name in zip(offs, MULTI_ANGLE, strict=True):
        axes.annotate(name.partition(":")[2], (off, 0.03), xycoords=("data", "axes fraction"), fontsize=7, ha="center")
    axes.set(xlabel="degrees off the mirrored beam", ylabel="Y (perfect white: 100)")
    axes.set_ylim(0.0, 1.15 * max(luminances))


def draw_polarization(axes: Any, paint: Paint) -> None:
    """Degree of linear polarization in three geometries, of unpolarized light."""
    for name, colour in zip((VISUAL, MULTI_ANGLE[0], MULTI_ANGLE[-1]), (INK, BLUE, ORANGE), strict=True):
        axes.plot(paint.look.wavelength_um, 100.0 * paint.look.polarization(name)[0], color=colour, label=name)
    axes.set(xlabel="wavelength [µm]", ylabel="degree of linear polarization [%]", ylim=(0.0, None))
    axes.legend(fontsize=7, frameon=False)


def draw_coefficients(axes: Any, paint: Paint) -> None:
    """K and S against wavelength."""
    found = paint.two_fluxes
    if found is None:
        return say_missing(axes, "no K and S: see the notes")
    least = 1e-9 * found.S.max()  # what rounding leaves of K
    absorbs = bool((least < found.K).all())
    axes.plot(found.wavelength_um, found.S, color=BLUE, label="S")
    axes.plot(found.wavelength_um, found.K, color=RED, label="K" if absorbs else "K, zero where nothing absorbs")
    unit = "1/µm" if found.unit == "1/um" else found.unit
    axes.set(xlabel="wavelength [µm]", ylabel=f"Kubelka-Munk's K, S [{unit}]")
    axes.set(yscale="log") if absorbs else axes.set_ylim(bottom=0.0)
    axes.legend(fontsize=7, frameon=False)


def say_missing(axes: Any, words: str) -> None:
    """Words in place of a picture."""
    axes.text(0.5, 0.5, words, ha="center", va="center", fontsize=9, color=INK, transform=axes.transAxes)
    axes.set_axis_off()


FIGURES = (
    Picture("Drawdown card", draw_card),
    Picture("Reflectance", draw_reflectance),
    Picture("Hiding power", draw_hiding_curve),
    Picture(f"Light from {LOBE_DEG:g}°: π BRDF in its plane", draw_polar_cut, polar=True),
    Picture(f"Multi-angle, light at {LOBE_DEG:g}°", draw_angles),
    Picture("Polarization", draw_polarization),
    Picture("Kubelka-Munk inside the film", draw_coefficients),
)


def draw_picture(picture: Picture, paint: Paint) -> "Figure":
    """One of the pictures by itself. Raises MissingExtraError without matplotlib."""
    figure = make_figure(*SIZE)
    axes = figure.add_subplot(projection="polar" if picture.polar else None)
    finish_axes(axes, picture, paint)
    figure.tight_layout()
    return figure


def finish_axes(axes: Any, picture: Picture, paint: Paint) -> None:
    """Draws a picture, its title and its grid."""
    picture.draw(axes, paint)
    axes.set_title(picture.title, fontsize=10, color=INK)
    axes.tick_params(which="both", labelsize=8)
    axes.xaxis.label.set_size(8), axes.yaxis.label.set_size(8)
    axes.grid(color=FAINT, linewidth=0.5, alpha=0.7)


def draw_sheet(paint: Paint) -> "Figure":
    """All pictures on one sheet, with the main numbers. Raises MissingExtraError without matplotlib."""
    figure = make_figure(*SHEET)
    for place, picture in enumerate(FIGURES, 1):
        axes = figure.add_subplot(3, 3, place, projection="polar" if picture.polar else None)
        finish_axes(axes, picture, paint)
    numbers = [f"{name}: {value}" for name, value in paint.list_numbers() if not name.startswith("colour")]
    wavelength = f"polar cut at {paint.lobe_um:g} µm, colours {paint.look.illuminant}/{paint.look.observer}°"
    words = "\n".join([*paint.made_of, "", *numbers, "", wavelength])
    axes = figure.add_subplot(3, 3, (8, 9))
    axes.text(0.0, 0.98, words, fontsize=9, va="top", color=INK, linespacing=1.5, wrap=True, transform=axes.transAxes)
    axes.set_axis_off()
    figure.suptitle(paint.title, fontsize=15)
    figure.tight_layout()
    return figure
