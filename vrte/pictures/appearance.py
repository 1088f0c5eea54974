"""What is read off a panel, as figures: hiding power, Kubelka and Munk's two fluxes."""

from dataclasses import replace
from typing import Any

import numpy as np

from vrte.appearance.hiding import Hiding
from vrte.appearance.two_flux_fit import BACKGROUNDS, KubelkaMunk, TwoFluxErrors
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress
from vrte.basics.views import Figure
from vrte.pictures.describe import BLUE, GREEN, INK, ORANGE, RED, Axis, Curve, Line, Picture, PlotPanel, Words
from vrte.pictures.figures import draw_picture

FINE = 200  # points of a smooth curve
DASHES = "--", "-"  # over black, over white
LEAST_ABSORPTION = 1e-9  # of the largest S: a K below it is rounding
SEEN = 0.5  # CIEDE2000 that is hardly seen side by side


def describe_hiding(hiding: Hiding) -> tuple[PlotPanel, PlotPanel]:
    """The contrast ratio against thickness, with the target and the thickness that reaches it, and Y over black, over
    white and of the semi-infinite film; dots are exact solves, and a line stands where the panel's own film is."""
    scale, unit = (hiding.length_um, "µm") if hiding.length_um else (1.0, "times the film")
    ends, seen = hiding.times[[0, -1]], hiding.conditions
    fine = np.geomspace(ends[0], ends[1], FINE).clip(ends[0], ends[1])
    contrast, over_white = hiding.interpolate(fine)

    def describe_curve(smooth: Any, exact: Any, colour: str, name: str) -> list[Any]:
        return [
            Curve(scale * fine, smooth, name, colour),
            Curve(scale * hiding.times, exact, "", colour, "", "o", size=3.0),
        ]

    left = describe_curve(contrast, hiding.contrast_ratios, INK, "")
    left.append(Line(y=seen.target, colour=RED, dash="--"))
    if hiding.hiding_times:
        at = scale * hiding.hiding_times
        left.append(Curve([at], [seen.target], f"{seen.target:g} at {at:.3g} {unit}", RED, "", "o"))
    right = describe_curve(over_white, hiding.over_white, ORANGE, f"over white, {seen.white:g}")
    right += describe_curve(contrast * over_white, hiding.over_black, BLUE, f"over black, {seen.black:g}")
    right.append(Line(y=hiding.luminance_semi_infinite, name="semi-infinite", colour=INK, dash=":"))
    film: list[Any] = [
        Line(x=scale, width=1.2),
        Words("this film", 1.06 * scale, 0.45, size=8.0, of_data=True, turned=True),
    ]
    along = Axis(f"dry film [{unit}]", log=10.0, fine=True)
    light = f"luminance Y, {seen.geometry}, {seen.illuminant}, {seen.observer}°"
    first = PlotPanel([*left, *film], along, Axis("contrast ratio", 0.0, 1.05), legend="lower right", letters=8.0)
    return first, PlotPanel([*right, *film], along, Axis(light, low=0.0), letters=8.0)


def draw_hiding(hiding: Hiding) -> Figure:
    """The hiding curve, beside Y over both cards. Raises MissingExtraError without matplotlib."""
    return draw_picture(Picture([describe_hiding(hiding)], 9.0, 3.6))


def describe_coefficients(found: KubelkaMunk, with_diffusion: bool = False) -> PlotPanel:
    """K and S against wavelength, and where asked for what diffusion makes of absorption and scattering."""
    most = float(found.S.max()) or 1.0
    absorbs = bool((LEAST_ABSORPTION * most < found.K).all())
    parts = []
    rows = zip("SK", (found.S, found.K), found.diffusion[::-1], (BLUE, RED), strict=True)
    for name, values, diffuse, colour in rows:
        label = name if name == "S" or absorbs else "K, zero where nothing absorbs"
        parts.append(Curve(found.wavelength_um, values, label, colour))
        if with_diffusion:
            positive = np.where(diffuse > 0.0, diffuse, np.nan)
            parts.append(Curve(found.wavelength_um, positive, f"{name} of diffusion", colour, ":"))
    along = Axis("wavelength [µm]")
    unit = f"Kubelka-Munk's K, S [{found.unit.replace('um', 'µm')}]"
    if with_diffusion:
        return PlotPanel(parts, along, Axis(unit, 1e-6 * most, 3.0 * max(most, float(found.K.max())), log=10.0))
    return PlotPanel(parts, along, Axis(unit, log=10.0) if absorbs else Axis(unit, low=0.0))


def draw_two_fluxes(found: KubelkaMunk, lengths: Any = None, progress: Progress | None = None) -> Figure:
    """Four panels: reflectance and its error against thickness [um, or films], by default from an eighth of the film's
    own to eight times, the colour difference, K and S against wavelength."""
    usual = found.length * 2.0 ** np.arange(-3.0, 3.5, 0.5)
    return draw_errors(found, found.compare(usual if lengths is None else lengths, progress))


def draw_errors(found: KubelkaMunk, errors: TwoFluxErrors) -> Figure:
    """The same of films that are solved already. Raises SceneError for fewer than two thicknesses that end."""
    order = np.argsort(errors.lengths)
    order = order[np.isfinite(errors.lengths[order])]
    if order.size < 2:
        raise SceneError("lengths must be two or more that end, for a picture", "lengths")
    lengths, count = errors.lengths[order], errors.wavelength_um.size
    between = np.geomspace(lengths[0], lengths[-1], FINE)
    parts: list[list[Any]] = [[], [], []]  # reflectance, error, colour difference
    for index, shade in zip(sorted({0, count // 2, count - 1}), (BLUE, GREEN, RED), strict=False):
        for over, dash in enumerate(DASHES):
            label = f"{1e3 * errors.wavelength_um[index]:.0f} nm, over {BACKGROUNDS[over]}"
            predicted = [found.predict(length, found.white * over)[index] for length in between]
            parts[0].append(Curve(between, predicted, label, shade, dash, width=1.2))
            parts[0].append(Curve(lengths, errors.exact[over, order, index], "", shade, "", "o", size=3.5))
            parts[1].append(Curve(lengths, errors.error[over, order, index], "", shade, dash, "o", size=3.0))
    try:
        for over, dash in enumerate(DASHES):
            label = f"over {BACKGROUNDS[over]}"
            parts[2].append(Curve(lengths, errors.difference[over, order], label, "black", dash, "o", size=3.0))
        parts[2].append(Line(y=SEEN))
    except SceneError as error:  # of wavelengths that make no colour
        parts[2] = [Words(str(error), size=8.0)]
    ticks = lengths[:: max(1, lengths.size // 7)].tolist()
    unit = errors.unit[2:].replace("um", "µm")
    words = f"thickness of the film [{unit}]; grey: where K and S are from"
    along = Axis(words, log=2.0, ticks=ticks, words=[f"{one:.3g}" for one in ticks])
    titles = "reflectance: exact (points), by K and S (lines)", "by K and S less exact", "colour difference, CIEDE2000"
    above = Axis(low=0.0, high=1.0), Axis(), Axis(low=0.0)
    first, second, third = (
        PlotPanel([*some, Line(x=found.length)], along, y, title)
        for some, y, title in zip(parts, above, titles, strict=True)
    )
    fourth = replace(describe_coefficients(found, with_diffusion=True), title="K and S, and those of diffusion")
    title = f"{found.panel.title or 'Kubelka and Munk'}, read {found.geometry.name}"
    return draw_picture(Picture([[first, third], [second, fourth]], 10.0, 6.4, title, heights=(3.0, 2.0)))
