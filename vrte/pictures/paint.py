"""A paint's page: one HTML file that opens without a network, one sheet of pictures, one table of all numbers."""

import csv
import html
import io
import os
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from vrte.appearance.appearance import COLOURS, VISUAL, InstrumentReading
from vrte.appearance.geometries import MULTI_ANGLE, read_geometry
from vrte.appearance.paint import LOBE_DEG, OF_FILMS, Paint, cut_lobe
from vrte.basics.errors import SceneError
from vrte.basics.views import Figure
from vrte.pictures.appearance import describe_coefficients, describe_hiding
from vrte.pictures.describe import BLUE, GREEN, INCIDENT, INK, ORANGE, Axis, Curve, Picture, PlotPanel, Swatch, Words
from vrte.pictures.figures import draw_picture, save_figure
from vrte.pictures.page import make_body, make_image, make_items, make_page, make_section, make_table, save_page

CARDS = "#1b1b1b", "#e6e6e6"  # black, and Y of a card of 0.8 in sRGB
WAVELENGTH = Axis("wavelength [µm]")
SUFFIXES = ".html", ".png", ".csv"
MISSING = PlotPanel([Words("none: see the notes")], bare=True)


def describe_card(paint: Paint) -> PlotPanel:
    """A drawdown card: the film across black and white, its colours as a screen shows them."""
    shown = list(paint.colours.items())[:2]
    parts: list[Any] = []
    for index, (name, colour) in enumerate(shown):
        width = 1.0 / len(shown)
        parts += [Swatch(CARDS[index], index * width, 0.0, width, 1.0)]
        parts += [Swatch(colour.hex, index * width, 0.12, width, 0.76)]
        beyond = "" if colour.is_in_gamut else f"\nout of the screen's colours\nby {colour.gamut_gap:.1f} CIEDE2000"
        words = f"{name}\n{colour.hex}\nL* {colour.L:.1f}  a* {colour.a:.1f}  b* {colour.b:.1f}{beyond}"
        parts.append(Words(words, (index + 0.5) * width, colour=INK if colour.L > 55.0 else "white"))
    return PlotPanel(parts, title="Drawdown card", bare=True)


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
    describe_two_fluxes,
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
    if suffix == ".png":
        save_figure(draw_sheet(paint), path)
    elif suffix in SUFFIXES:
        page = suffix == ".html"
        text = make_page(paint.title, make_paint_body(paint)) if page else write_table(paint.list_readings())
        save_page(text, path, suffix)
    else:
        raise SceneError(f"the page {path} must end in {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}")


def write_table(readings: Iterable[InstrumentReading]) -> str:
    """All numbers as CSV, one a row, digits enough to read them back."""
    made = io.StringIO()
    rows = csv.writer(made, lineterminator="\n")
    rows.writerow(InstrumentReading._fields)
    rows.writerows([repr(float(cell)) if isinstance(cell, float) else cell for cell in one] for one in readings)
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
