"""A paint's page: one HTML file that opens without a network, one sheet of pictures, one table of all numbers."""

import csv
import html
import io
import os
from collections.abc import Iterable
from pathlib import Path

from vrte.appearance.appearance import COLOURS, Reading
from vrte.appearance.geometries import read_geometry
from vrte.appearance.paint import OF_FILMS, Paint
from vrte.appearance.paint_figures import FIGURES, Picture, draw_picture, draw_sheet
from vrte.basics.errors import SceneError
from vrte.formats.atomic import write_atomically
from vrte.pictures.figures import save_figure
from vrte.pictures.page import make_body, make_image, make_items, make_page, make_section, make_table

SUFFIXES = ".html", ".png", ".csv"
COLUMNS = "quantity", "geometry", "wavelength_um", "value", "unit", "definition", "standard"


def save_paint(paint: Paint, path: str | os.PathLike[str]) -> None:
    """Writes a page, a sheet of pictures or a table by the suffix, all of it or nothing. Raises SceneError for another
    suffix, MissingExtraError without matplotlib, OSError."""
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise SceneError(f"the page {path} must end in {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}")
    if suffix == ".png":
        save_figure(draw_sheet(paint), path)
        return
    text = write_page(paint) if suffix == ".html" else write_table(paint.list_readings())
    with write_atomically(path) as part:
        part.write_text(text, encoding="utf-8", newline="")


def write_table(readings: Iterable[Reading]) -> str:
    """All numbers as CSV, one a row, digits enough to read them back."""
    made = io.StringIO()
    rows = csv.writer(made, lineterminator="\n")
    rows.writerow(COLUMNS)
    for one in readings:
        at = "" if one.wavelength_um is None else repr(float(one.wavelength_um))
        rows.writerow((one.quantity, one.geometry, at, repr(float(one.value)), one.unit, one.definition, one.standard))
    return made.getvalue()


def write_page(paint: Paint) -> str:
    """The whole page, without anything that is elsewhere."""
    return make_page(paint.title, write_body(paint))


def write_body(paint: Paint) -> str:
    """What a browser or a notebook shows of the page."""
    cells = []
    for name, value in paint.list_numbers():
        colour = paint.colours.get(name.removeprefix("colour "))
        chip = "" if colour is None else f"<i class='chip' style='background:{colour.hex}'></i> "
        gap = "" if colour is None or colour.is_in_gamut else ", which a screen shows cut off"
        cells.append(f"<div><span>{html.escape(name)}{gap}</span><b>{chip}{html.escape(value)}</b></div>")
    images = [f"<figure>{write_image(one, paint)}</figure>" for one in FIGURES]
    readings = list(paint.list_readings())
    told = [one for one in readings if one.wavelength_um is None and one.quantity.split()[0] not in COLOURS]
    numbers = write_readings(one for one in told if not one.quantity.startswith(OF_FILMS))  # those are in a picture
    spectral = write_spectra(paint, [one for one in readings if one.wavelength_um is not None])
    return make_body(
        paint.title,
        paint.made_of,
        f"<div class='numbers'>{''.join(cells)}</div>",
        make_section("Pictures", f"<div class='figures'>{''.join(images)}</div>"),
        make_section("Colours", write_colours(paint)),
        make_section("Numbers and what they mean", numbers),
        f"<details><summary>Spectra, number by number</summary>{spectral}</details>",
        make_section("What to know of these numbers", f"<ul>{make_items(paint.notes)}</ul>"),
    )


def write_image(picture: Picture, paint: Paint) -> str:
    """A picture as a drawing within the page, with what it shows in words."""
    words = " ".join((picture.draw.__doc__ or "").split())
    return make_image(draw_picture(picture, paint), f"{picture.title}: {words}")


def write_colours(paint: Paint) -> str:
    """X, Y, Z, L*, a*, b*, C, h of the panel in every geometry, and of the film over the cards."""
    named = [(name, paint.look.colour(name), "") for name in paint.look.reflectances]
    if paint.hiding is not None:
        named += [(paint.hiding.geometry, one, f"film {name}, ") for name, one in paint.colours.items()]
    head = ("geometry", *"XYZ", "L*", "a*", "b*", "C*", "h°", "what is read", "standard")
    rows = []
    for name, colour, which in named:
        known = read_geometry(name)
        numbers = [getattr(colour, key) for key in COLOURS]
        rows.append((name, *numbers, which + known.definition, known.standard))
    words = "X, Y, Z by ISO/CIE 11664-3, Y of the perfect white is 100; L*, a*, b*, C*, h by ISO/CIE 11664-4; "
    words += f"illuminant {paint.look.illuminant}, {paint.look.observer} degree observer."
    return f"{make_table(head, rows, '.2f')}<p>{words}</p>"


def write_readings(readings: Iterable[Reading]) -> str:
    """Numbers of no wavelength, with definitions and standards."""
    head = ("quantity", "geometry", "value", "unit", "definition", "standard")
    return make_table(head, ((o.quantity, o.geometry, o.value, o.unit, o.definition, o.standard) for o in readings))


def write_spectra(paint: Paint, readings: Iterable[Reading]) -> str:
    """A column a wavelength."""
    at = paint.look.wavelength_um.tolist()
    rows: dict[tuple[str, ...], list[float]] = {}
    for one in readings:
        rows.setdefault((one.quantity, one.geometry, one.unit, one.definition, one.standard), []).append(one.value)
    whole = {key: values for key, values in rows.items() if len(values) == len(at)}
    head = ("quantity", "geometry", "unit", "definition", "standard", *(f"{one:g} µm" for one in at))
    return make_table(head, ((*key, *values) for key, values in whole.items()))
