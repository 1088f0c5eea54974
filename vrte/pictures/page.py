"""The frame of every HTML page that vrte writes: one file that opens without a network, in light and dark."""

import base64
import html
import os
from collections.abc import Iterable
from importlib.resources import files

from vrte.basics.errors import SceneError
from vrte.basics.views import Figure
from vrte.formats.atomic import write_text
from vrte.pictures.figures import make_bytes

LONG = 30  # characters of a table's cell; a longer text may be broken into lines


def make_page(title: str, body: str, style: str = "", script: str = "") -> str:
    """A whole page around a ``body`` of HTML, such as `make_body` makes; ``style`` is CSS, ``script`` JavaScript."""
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark"><title>{html.escape(title)}</title>
<style>:root {{ color-scheme: light dark; }} body {{ margin: 0; }}
{style}</style></head><body>
{body}{f"<script>{script}</script>" * bool(script)}</body></html>
"""


def make_body(title: str, made: Iterable[str], *sections: str) -> str:
    """A title, lines on how the page was made, and sections of HTML, in the style of all pages."""
    head = f"<h1>{html.escape(title)}</h1><ul class='made'>{make_items(made)}</ul>"
    style = (files(__package__) / "page.css").read_text("utf-8")
    return f"<style>\n{style}</style><main class='vrte-page'>{head}{''.join(sections)}</main>"


def make_section(heading: str, *parts: str) -> str:
    """A heading above parts of HTML."""
    return f"<h2>{html.escape(heading)}</h2>{''.join(parts)}"


def make_items(lines: Iterable[str]) -> str:
    """The items of a list, escaped."""
    return "".join(f"<li>{html.escape(line)}</li>" for line in lines)


def make_table(head: Iterable[str], rows: Iterable[Iterable[str | float]], digits: str = ".5g") -> str:
    """A table, escaped: numbers by the format ``digits`` and to the right, long texts broken into lines."""

    def make_cell(value: str | float) -> str:
        if not isinstance(value, str):
            return f"<td class='n'>{value:{digits}}</td>"
        return f"<td{' class=' + repr('w') if len(value) > LONG else ''}>{html.escape(value)}</td>"

    lines = ["".join(f"<th>{html.escape(one)}</th>" for one in head), *("".join(map(make_cell, row)) for row in rows)]
    return f"<div class='wide'><table>{''.join(f'<tr>{line}</tr>' for line in lines)}</table></div>"


def make_image(figure: Figure, words: str) -> str:
    """A figure as a drawing within the page; ``words`` say what it shows. The same figure makes the same text."""
    return f'<img src="{make_data_address(make_bytes(figure, ".svg"), "svg+xml")}" alt="{html.escape(words)}">'


def make_data_address(image: bytes, kind: str) -> str:
    """An image as the address that an <img> of the page takes."""
    return f"data:image/{kind};base64,{base64.b64encode(image).decode()}"


def save_page(text: str, path: str | os.PathLike[str], suffix: str = ".html") -> None:
    """Writes a page, or another text, all of it or nothing. Raises SceneError for another suffix, OSError."""
    if not os.fspath(path).lower().endswith(suffix):
        raise SceneError(f"the page {os.fspath(path)} must end in {suffix}")
    write_text(text, path)
