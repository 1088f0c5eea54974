"""The frame of every HTML page that vrte writes: one file that opens without a network, in light and dark."""

import base64
import html
import os
from collections.abc import Iterable
from typing import TYPE_CHECKING

from vrte.basics.errors import SceneError
from vrte.formats.atomic import write_atomically
from vrte.pictures.figures import make_bytes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LONG = 30  # characters of a table's cell; a longer text may be broken into lines
STYLE = """
.vrte-page { font: 15px/1.5 system-ui, sans-serif; max-width: 76rem; margin: 0 auto; padding: 1rem; }
.vrte-page h1 { font-size: 1.6rem; margin: 0 0 .3rem; } .vrte-page h2 { font-size: 1.15rem; margin: 1.6rem 0 .5rem; }
.vrte-page .made { opacity: .8; margin: 0; padding-left: 1.1rem; overflow-wrap: anywhere; }
.vrte-page .numbers, .vrte-page .figures { display: grid; gap: .8rem; }
.vrte-page .numbers { grid-template-columns: repeat(auto-fill, minmax(15rem, 1fr)); margin-top: 1rem; }
.vrte-page .numbers div { border: 1px solid #8886; border-radius: .4rem; padding: .5rem .8rem; }
.vrte-page .numbers b { display: block; font-weight: 600; }
.vrte-page .numbers span { opacity: .75; font-size: .85em; }
.vrte-page .chip { display: inline-block; width: 1em; height: 1em; border: 1px solid #8888; vertical-align: -.12em; }
.vrte-page .figures { grid-template-columns: repeat(auto-fit, minmax(min(22rem, 100%), 1fr)); }
.vrte-page figure { margin: 0; background: #fff; border: 1px solid #8886; border-radius: .4rem; }
.vrte-page img { display: block; width: 100%; height: auto; }
.vrte-page .wide { overflow-x: auto; } .vrte-page table { border-collapse: collapse; font-size: .9em; }
.vrte-page th, .vrte-page td { text-align: left; padding: .2rem .8rem .2rem 0; border-bottom: 1px solid #8884;
  white-space: nowrap; }
.vrte-page td.w { white-space: normal; min-width: 14rem; }
.vrte-page td.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
"""


def make_page(title: str, body: str, style: str = "", script: str = "") -> str:
    """A whole page around a ``body`` of HTML, such as `make_body` makes; ``style`` is CSS, ``script`` JavaScript.

    >>> make_page("a < b", "<p>c</p>").splitlines()[-1]
    '<p>c</p></body></html>'
    """
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
    return f"<style>{STYLE}</style><main class='vrte-page'>{head}{''.join(sections)}</main>"


def make_section(heading: str, *parts: str) -> str:
    """A heading above parts of HTML."""
    return f"<h2>{html.escape(heading)}</h2>{''.join(parts)}"


def make_items(lines: Iterable[str]) -> str:
    """The items of a list, escaped."""
    return "".join(f"<li>{html.escape(line)}</li>" for line in lines)


def make_table(head: Iterable[str], rows: Iterable[Iterable[str | float]], digits: str = ".5g") -> str:
    """A table, escaped: numbers by the format ``digits`` and to the right, long texts broken into lines.

    >>> make_table(["a"], [[0.5]], ".2f")
    "<div class='wide'><table><tr><th>a</th></tr><tr><td class='n'>0.50</td></tr></table></div>"
    """

    def make_cell(value: str | float) -> str:
        if not isinstance(value, str):
            return f"<td class='n'>{value:{digits}}</td>"
        return f"<td{' class=' + repr('w') if len(value) > LONG else ''}>{html.escape(value)}</td>"

    lines = ["".join(f"<th>{html.escape(one)}</th>" for one in head), *("".join(map(make_cell, row)) for row in rows)]
    return f"<div class='wide'><table>{''.join(f'<tr>{line}</tr>' for line in lines)}</table></div>"


def make_image(figure: "Figure", words: str) -> str:
    """A figure as a drawing within the page; ``words`` say what it shows. The same figure makes the same text."""
    return f'<img src="{make_data_address(make_bytes(figure, ".svg"), "svg+xml")}" alt="{html.escape(words)}">'


def make_data_address(image: bytes, kind: str) -> str:
    """An image as the address that an <img> of the page takes."""
    return f"data:image/{kind};base64,{base64.b64encode(image).decode()}"


def save_page(text: str, path: str | os.PathLike[str], suffix: str = ".html") -> None:
    """Writes a page, or another text, all of it or nothing. Raises SceneError for another suffix, OSError."""
    if not os.fspath(path).lower().endswith(suffix):
        raise SceneError(f"the page {os.fspath(path)} must end in {suffix}")
    with write_atomically(path) as part:
        part.write_text(text, encoding="utf-8", newline="")
