"""A paint's page: one HTML file that opens without a network, one sheet of pictures, one table of all numbers."""

import base64
import csv
import html
import io
import os
from collections.abc import Iterable
from pathlib import Path

from vrte.appearance.appearance import COLOURS, Reading
from vrte.appearance.geometries import read_geometry
from vrte.appearance.paint import Paint
from vrte.appearance.paint_figures import FIGURES, Picture, draw_picture, draw_sheet
from vrte.appearance.paint_words import OF_FILMS
from vrte.basics.errors import SceneError
from vrte.formats.atomic import write_atomically
from vrte.pictures.figures import save_figure

LONG = 30  # signs of a sentence
SUFFIXES = ".html", ".png", ".csv"
COLUMNS = "quantity", "geometry", "wavelength_um", "value", "unit", "definition", "standard"
STYLE = """
.vrte-paint { font: 15px/1.5 system-ui, sans-serif; max-width: 76rem; margin: 0 auto; padding: 1rem; }
.vrte-paint h1 { font-size: 1.6rem; margin: 0 0 .3rem; } .vrte-paint h2 { font-size: 1.15rem; margin: 1.6rem 0 .5rem; }
.vrte-paint .made { opacity: .8; margin: 0; padding-left: 1.1rem; overflow-wrap: anywhere; }
.vrte-paint .numbers, .vrte-paint .figures { display: grid; gap: .8rem; }
.vrte-paint .numbers { grid-template-columns: repeat(auto-fill, minmax(15rem, 1fr)); margin-top: 1rem; }
.vrte-paint .numbers div { border: 1px solid #8886; border-radius: .4rem; padding: .5rem .8rem; }
.vrte-paint .numbers b { display: block; font-weight: 600; }
.vrte-paint .numbers span { opacity: .75; font-size: .85em; }
.vrte-paint .chip { display: inline-block; width: 1em; height: 1em; border: 1px solid #8888; vertical-align: -.12em; }
.vrte-paint .figures { grid-template-columns: repeat(auto-fit, minmax(min(22rem, 100%), 1fr)); }
.vrte-paint figure { margin: 0; background: #fff; border: 1px solid #8886; border-radius: .4rem; }
.vrte-paint img { display: block; width: 100%; height: auto; }
.vrte-paint .wide { overflow-x: auto; } .vrte-paint table { border-collapse: collapse; font-size: .9em; }
.vrte-paint th, .vrte-paint td { text-align: left; padding: .2rem .8rem .2rem 0; border-bottom: 1px solid #8884;
  white-space: nowrap; }
.vrte-paint td.w { white-space: normal; min-width: 14rem; }
.vrte-paint td.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
"""
HEAD = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark"><title>{title}</title>
<style>:root {{ color-scheme: light dark; }} body {{ margin: 0; }}</style></head><body>
"""


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
    return f"{HEAD.format(title=html.escape(paint.title))}{write_body(paint)}</body></html>\n"


def write_body(paint: Paint) -> str:
    """What a browser or a notebook shows of the page."""
    parts = [f"<style>{STYLE}</style><main class='vrte-paint'><h1>{html.escape(paint.title)}</h1>"]
    parts.append(f"<ul class='made'>{write_items(paint.made_of)}</ul><div class='numbers'>")
    for name, value in paint.list_numbers():
        colour = paint.colours.get(name.removeprefix("colour "))
        chip = "" if colour is None else f"<i class='chip' style='background:{colour.hex}'></i> "
        gap = "" if colour is None or colour.is_in_gamut else ", which a screen shows cut off"
        parts.append(f"<div><span>{html.escape(name)}{gap}</span><b>{chip}{html.escape(value)}</b></div>")
    parts.append("</div><h2>Pictures</h2><div class='figures'>")
    parts += [f"<figure>{write_image(one, paint)}</figure>" for one in FIGURES]
    parts.append(f"</div><h2>Colours</h2>{write_colours(paint)}<h2>Numbers and what they mean</h2>")
    readings = list(paint.list_readings())
    told = [one for one in readings if one.wavelength_um is None and one.quantity.split()[0] not in COLOURS]
    parts.append(write_readings(one for one in told if not one.quantity.startswith(OF_FILMS)))  # those are in a picture
    spectral = write_spectra(paint, [one for one in readings if one.wavelength_um is not None])
    parts.append(f"<details><summary>Spectra, number by number</summary>{spectral}</details>")
    parts.append(f"<h2>What to know of these numbers</h2><ul>{write_items(paint.notes)}</ul>")
    return "".join([*parts, "</main>"])


def write_items(lines: Iterable[str]) -> str:
    """Lines of a list."""
    return "".join(f"<li>{html.escape(line)}</li>" for line in lines)


def write_image(picture: Picture, paint: Paint) -> str:
    """A picture as a drawing within the page, with what it shows in words."""
    from matplotlib import rc_context

    drawn = io.BytesIO()
    with rc_context({"svg.hashsalt": "vrte"}):
        draw_picture(picture, paint).savefig(drawn, format="svg", metadata={"Date": None})
    data = base64.b64encode(drawn.getvalue()).decode()
    words = " ".join((picture.draw.__doc__ or "").split())
    return f'<img src="data:image/svg+xml;base64,{data}" alt="{html.escape(f"{picture.title}: {words}")}">'


def write_cell(value: str | float, digits: str) -> str:
    """A number, which stands right, a few words, or a sentence, which may be broken.

    >>> write_cell(0.5, ".2f")
    "<td class='n'>0.50</td>"
    """
    if not isinstance(value, str):
        return f"<td class='n'>{value:{digits}}</td>"
    return f"<td{' class=' + repr('w') if len(value) > LONG else ''}>{html.escape(value)}</td>"


def write_rows(head: Iterable[str], rows: Iterable[Iterable[str | float]], digits: str = ".5g") -> str:
    """A table; numbers stand right."""
    lines = [f"<tr>{''.join(f'<th>{html.escape(one)}</th>' for one in head)}</tr>"]
    for row in rows:
        cells = (write_cell(one, digits) for one in row)
        lines.append(f"<tr>{''.join(cells)}</tr>")
    return f"<div class='wide'><table>{''.join(lines)}</table></div>"


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
    return f"{write_rows(head, rows, '.2f')}<p>{words}</p>"


def write_readings(readings: Iterable[Reading]) -> str:
    """Numbers of no wavelength, with definitions and standards."""
    head = ("quantity", "geometry", "value", "unit", "definition", "standard")
    return write_rows(head, ((o.quantity, o.geometry, o.value, o.unit, o.definition, o.standard) for o in readings))


def write_spectra(paint: Paint, readings: Iterable[Reading]) -> str:
    """A column a wavelength."""
    at = paint.look.wavelength_um.tolist()
    rows: dict[tuple[str, ...], list[float]] = {}
    for one in readings:
        rows.setdefault((one.quantity, one.geometry, one.unit, one.definition, one.standard), []).append(one.value)
    whole = {key: values for key, values in rows.items() if len(values) == len(at)}
    head = ("quantity", "geometry", "unit", "definition", "standard", *(f"{one:g} µm" for one in at))
    return write_rows(head, ((*key, *values) for key, values in whole.items()))
