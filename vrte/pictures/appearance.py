"""What is read off a panel: figures of hiding power and of two fluxes; a paint's page, sheet of pictures and table."""

import csv
import html
import io
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from vrte.appearance.appearance import COLOURS, VISUAL, InstrumentReading
from vrte.appearance.colours import Colour
from vrte.appearance.geometries import METAL_FLAKE, MULTI_ANGLE, read_geometry
from vrte.appearance.hiding import Hiding
from vrte.appearance.paint import LOBE_DEG, OF_FILMS, Paint, cut_lobe
from vrte.appearance.two_flux_fit import BACKGROUNDS, KubelkaMunk, TwoFluxErrors
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress
from vrte.basics.views import Figure
from vrte.pictures.describe import (
    BLUE,
    GREEN,
    INCIDENT,
    INK,
    ORANGE,
    RED,
    Axis,
    Curve,
    Line,
    Picture,
    PlotPanel,
    Swatch,
    Words,
)
from vrte.pictures.figures import draw_picture, save_figure
from vrte.pictures.page import make_body, make_image, make_items, make_page, make_section, make_table, save_page

FINE = 200  # points of a smooth curve
DASHES = "--", "-"  # over black, over white
LEAST_ABSORPTION = 1e-9  # of the largest S: a K below it is rounding
SEEN = 0.5  # CIEDE2000 that is hardly seen side by side


def describe_hiding(hiding: Hiding) -> tuple[PlotPanel, PlotPanel]:
    """Contrast ratio against thickness with its target, and Y over both cards; dots are exact solves."""
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
    unit = f"Kubelka-Munk's K, S [{found.unit.replace('um', 'µm')}]"
    if with_diffusion:
        return PlotPanel(parts, WAVELENGTH, Axis(unit, 1e-6 * most, 3.0 * max(most, float(found.K.max())), log=10.0))
    return PlotPanel(parts, WAVELENGTH, Axis(unit, log=10.0) if absorbs else Axis(unit, low=0.0))


def draw_two_fluxes(found: KubelkaMunk, lengths: Any = None, progress: Progress | None = None) -> Figure:
    """Reflectance, its error and colour difference against thickness [um, or films]; K and S against wavelength."""
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


CARDS = "#1b1b1b", "#e6e6e6"  # black, and Y of a card of 0.8 in sRGB
WAVELENGTH = Axis("wavelength [µm]")
SUFFIXES = ".html", ".png", ".pdf", ".csv"
MISSING = PlotPanel([Words("none: see the notes")], bare=True)


def describe_card(paint: Paint) -> PlotPanel:
    """A drawdown card: the film across black and white, its colours as a screen shows them."""
    return describe_swatches(dict([*paint.colours.items()][:2]), "Drawdown card", CARDS)


def describe_swatches(shown: Mapping[str, Colour], title: str, below: tuple[str, ...] = ()) -> PlotPanel:
    """Colours side by side as a screen shows them, with their numbers; ``below``: of the cards that they lie on."""
    parts: list[Any] = []
    edge = 0.12 if below else 0.0
    for index, (name, colour) in enumerate(shown.items()):
        width = 1.0 / len(shown)
        parts += [Swatch(card, index * width, 0.0, width, 1.0) for card in below[index : index + 1]]
        parts += [Swatch(colour.hex, index * width, edge, width, 1.0 - 2.0 * edge)]
        beyond = "" if colour.is_in_gamut else f"\nout of the screen's colours\nby {colour.gamut_gap:.1f} CIEDE2000"
        words = f"{name}\n{colour.hex}\nL* {colour.L:.1f}  a* {colour.a:.1f}  b* {colour.b:.1f}{beyond}"
        parts.append(Words(words, (index + 0.5) * width, colour=INK if colour.L > 55.0 else "white"))
    return PlotPanel(parts, title=title, bare=True)


def describe_reflectance(paint: Paint) -> PlotPanel:
    """Reflectance factors over black, over white and semi-infinite, and all light of the panel as it lies."""
    at, parts, seen = paint.look.wavelength_um, [], paint.hiding
    if seen is None:
        parts = [Curve(at, paint.look.reflectance(VISUAL), f"as it lies, {VISUAL}", BLUE)]
    else:
        parts = [
            Curve(at, seen.semi_infinite, f"semi-infinite, {seen.conditions.geometry}", INK, ":"),
            Curve(at, seen.reflectance_over_white, f"over white, {seen.conditions.geometry}", ORANGE),
            Curve(at, seen.reflectance_over_black, f"over black, {seen.conditions.geometry}", BLUE),
        ]
    parts.append(Curve(at, paint.look.reflectance("8:di"), "as it lies, 8:di (SPIN)", GREEN, "--", width=1.2))
    return PlotPanel(parts, WAVELENGTH, Axis("reflectance factor", low=0.0), "Reflectance")


def describe_film(paint: Paint) -> PlotPanel:
    """Contrast ratio against thickness, with what counts as hidden."""
    found = MISSING if paint.hiding is None else describe_hiding(paint.hiding)[0]
    return replace(found, title="Hiding power", letters=7.0)


def describe_polar_cut(paint: Paint) -> PlotPanel:
    """pi times the BRDF in the plane of incidence: 1 is the perfect white diffuser's half circle of radius."""
    angle, light = cut_lobe(paint.lobe)
    factor = np.pi * np.maximum(light[:, 0], 0.0)
    top = 1.08 * max(float(factor.max()), 1e-6)
    parts = [Curve(angle, factor, "", BLUE)]
    parts += [Curve([-LOBE_DEG] * 2, [0.0, top], "incident light", INCIDENT, width=1.2)]
    if paint.lobe.specular is not None:
        share = 100.0 * float(paint.lobe.specular[0, 0, 0])
        words = f"mirrored beam, {share:.3g} %, not in the curve"
        parts.append(Curve([LOBE_DEG] * 2, [0.0, top], words, GREEN, "--", width=1.2))
    return PlotPanel(parts, y=Axis("", 0.0, top), title=f"Light from {LOBE_DEG:g}°: π BRDF in its plane", polar="half")


def describe_angles(paint: Paint) -> PlotPanel:
    """Y at the angles of multi-angle instruments, off the mirrored beam of light at 45 degrees."""
    offs = [LOBE_DEG - float(read_geometry(name).angle_o or 0.0) for name in MULTI_ANGLE]
    luminances = [paint.look.colour(name).Y for name in MULTI_ANGLE]
    parts: list[Any] = [Curve(offs, luminances, "", BLUE, "-", "o")]
    parts += [
        Words(name.partition(":")[2], off, 0.05, size=7.0, of_data=True)
        for off, name in zip(offs, MULTI_ANGLE, strict=True)
    ]
    above = Axis("Y (perfect white: 100)", 0.0, 1.15 * max(luminances))
    return PlotPanel(parts, Axis("degrees off the mirrored beam"), above, f"Multi-angle, light at {LOBE_DEG:g}°")


def describe_travel(paint: Paint) -> PlotPanel:
    """a* and b* from near the mirrored beam of light at 45 degrees to far from it, on the side of the light."""
    travel = paint.look.colour_travel()
    reach = 1.2 * max(5.0, *(abs(value) for one in travel.values() for value in (one.a, one.b)))
    parts: list[Any] = [Line(x=0.0), Line(y=0.0)]
    parts.append(Curve([one.a for one in travel.values()], [one.b for one in travel.values()], "", INK, width=1.0))
    for off, colour in travel.items():
        parts.append(Curve([colour.a], [colour.b], "", colour.hex, "", "o", size=7.0))
        if f"45:as{off:g}" in METAL_FLAKE:
            x, y = (0.5 + 0.5 * value / reach for value in (colour.a, colour.b))
            parts.append(Words(f"as{off:g}", x, y + 0.05, size=7.0))
    words = f"Colour travel, light at {LOBE_DEG:g}°"
    return PlotPanel(parts, Axis("a*", -reach, reach), Axis("b*", -reach, reach), words)


def describe_polarization(paint: Paint) -> PlotPanel:
    """Degree of linear polarization in three geometries, of unpolarized light."""
    seen = zip((VISUAL, MULTI_ANGLE[0], MULTI_ANGLE[-1]), (INK, BLUE, ORANGE), strict=True)
    at, look = paint.look.wavelength_um, paint.look
    parts = [Curve(at, 100.0 * look.polarization(name)[0], name, colour) for name, colour in seen]
    return PlotPanel(parts, WAVELENGTH, Axis("degree of linear polarization [%]", low=0.0), "Polarization")


def describe_two_fluxes(paint: Paint) -> PlotPanel:
    """K and S against wavelength."""
    found = MISSING if paint.two_fluxes is None else describe_coefficients(paint.two_fluxes)
    return replace(found, title="Kubelka-Munk inside the film")


PANELS: tuple[Callable[[Paint], PlotPanel], ...] = (
    describe_card, describe_reflectance, describe_film, describe_polar_cut, describe_angles, describe_polarization,
    describe_two_fluxes, describe_travel,
)  # fmt: skip


def draw_sheet(paint: Paint) -> Figure:
    """All pictures on one sheet, with the main numbers. Raises MissingExtraError without matplotlib."""
    numbers = [f"{name}: {value}" for name, value in paint.list_numbers() if not name.startswith("colour")]
    wavelength = f"polar cut at {paint.lobe_um:g} µm, colours {paint.look.illuminant}/{paint.look.observer}°"
    words = "\n".join([*paint.made_of, "", *numbers, "", wavelength])
    panels = [*(describe(paint) for describe in PANELS), PlotPanel([Words(words, 0.0, 0.98, align="left")], bare=True)]
    return draw_picture(Picture([panels[:3], panels[3:6], panels[6:]], 14.4, 10.4, paint.title))


def save_paint(paint: Paint, path: str | os.PathLike[str]) -> None:
    """Writes a page, a sheet of pictures or a table by the suffix, all of it or nothing."""
    suffix = Path(path).suffix.lower()
    if suffix in (".png", ".pdf"):
        save_figure(draw_sheet(paint), path)
    elif suffix in SUFFIXES:
        page = suffix == ".html"
        text = make_page(paint.title, make_paint_body(paint)) if page else write_table(paint.list_readings())
        save_page(text, path, suffix)
    else:
        raise SceneError(f"the page {path} must end in {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}")


def write_table(readings: Iterable[InstrumentReading], with_comma: bool = False) -> str:
    """All numbers as CSV, one a row, digits enough to read them back; with decimal commas between semicolons."""

    def write(cell: Any) -> Any:
        return repr(float(cell)).replace(".", "," if with_comma else ".") if isinstance(cell, float) else cell

    made = io.StringIO()
    rows = csv.writer(made, delimiter=";" if with_comma else ",", lineterminator="\n")
    rows.writerow(InstrumentReading._fields)
    rows.writerows([write(cell) for cell in one] for one in readings)
    return made.getvalue()


def make_paint_body(paint: Paint) -> str:
    """What a browser or a notebook shows of the page."""
    cells, images = [], []
    for name, value in paint.list_numbers():
        colour = paint.colours.get(name.removeprefix("colour "))
        chip = "" if colour is None else f"<i class='chip' style='background:{colour.hex}'></i> "
        beyond = "" if colour is None or colour.is_in_gamut else ", which a screen shows cut off"
        cells.append(f"<div><span>{html.escape(name)}{beyond}</span><b>{chip}{html.escape(value)}</b></div>")
    for describe in PANELS:
        panel = describe(paint)
        words = f"{panel.title}: {' '.join((describe.__doc__ or '').split())}"
        images.append(f"<figure>{make_image(draw_picture(Picture([[panel]], 4.6, 3.3)), words)}</figure>")
    readings = list(paint.list_readings())
    single = [one for one in readings if one.wavelength_um is None and one.quantity.split()[0] not in COLOURS]
    head = ("quantity", "geometry", "value", "unit", "definition", "standard")
    # contrast ratios of films are in a picture
    rows = [(*o[:2], *o[3:]) for o in single if not o.quantity.startswith(OF_FILMS)]
    return make_body(
        paint.title,
        paint.made_of,
        f"<div class='numbers'>{''.join(cells)}</div>",
        make_section("Pictures", f"<div class='figures'>{''.join(images)}</div>"),
        make_section("Colours", make_colours(paint, readings)),
        make_section("Numbers and what they mean", make_table(head, rows)),
        f"<details><summary>Spectra, number by number</summary>{make_spectra(paint, readings)}</details>",
        make_section("What to know of these numbers", f"<ul>{make_items(paint.notes)}</ul>"),
    )


def make_colours(paint: Paint, readings: Iterable[InstrumentReading]) -> str:
    """X, Y, Z, L*, a*, b*, C, h of the panel in every geometry, and of the film over the cards."""
    rows: dict[tuple[str, str], list[float]] = {}
    for one in readings:
        quantity, _, film = one.quantity.partition(" ")
        if quantity in COLOURS:
            rows.setdefault((one.geometry, f"film {film}, " if film else ""), []).append(one.value)
    head = ("geometry", *"XYZ", "L*", "a*", "b*", "C*", "h°", "what is read", "standard")
    table: list[tuple[str | float, ...]] = []
    for (name, film), values in rows.items():
        known = read_geometry(name)
        table.append((name, *values, film + known.definition, known.standard))
    words = "X, Y, Z by ISO/CIE 11664-3, Y of the perfect white is 100; L*, a*, b*, C*, h by ISO/CIE 11664-4; "
    words += f"illuminant {paint.look.illuminant}, {paint.look.observer} degree observer."
    return f"{make_table(head, table, '.2f')}<p>{words}</p>"


def make_spectra(paint: Paint, readings: Iterable[InstrumentReading]) -> str:
    """All readings at every wavelength, a column a wavelength."""
    at = paint.look.wavelength_um.tolist()
    rows: dict[tuple[str, ...], list[float]] = {}
    for one in readings:
        if one.wavelength_um is not None:
            key = one.quantity, one.geometry, one.unit, one.definition, one.standard
            rows.setdefault(key, []).append(one.value)
    head = ("quantity", "geometry", "unit", "definition", "standard", *(f"{one:g} µm" for one in at))
    return make_table(head, ((*key, *values) for key, values in rows.items() if len(values) == len(at)))
