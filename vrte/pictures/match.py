"""What was wanted of a paint and what was found: a page, or a table of numbers."""

import csv
import io
import os
from collections.abc import Iterator
from pathlib import Path

from vrte.basics.errors import SceneError
from vrte.fit.match import Match
from vrte.pictures.appearance import describe_swatches
from vrte.pictures.describe import Picture
from vrte.pictures.figures import draw_picture
from vrte.pictures.page import make_body, make_image, make_items, make_page, make_section, make_table, save_page

TITLE = "A recipe for a target"
SUFFIXES = ".html", ".csv"


def save_match(match: Match, path: str | os.PathLike[str]) -> None:
    """Writes a page or a table by the suffix, all of it or nothing. Raises SceneError for another, OSError."""
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise SceneError(f"the recipe {path} must end in {' or '.join(SUFFIXES)}")
    text = make_page(TITLE, make_match_body(match)) if suffix == ".html" else write_numbers(match)
    save_page(text, path, suffix)


def make_match_body(match: Match) -> str:
    """What a browser or a notebook shows: both colours side by side, recipe, target, what each number does, notes."""
    parts = [make_section(rows[0][0].capitalize(), make_table(rows[0], rows[1:])) for rows in match.list_tables()]
    if match.colours:
        figure = draw_picture(Picture([[describe_swatches(match.colours, "Colours side by side")]], 4.6, 2.4))
        parts.insert(
            0, f"<figure style='max-width: 30rem'>{make_image(figure, 'wanted and found side by side')}</figure>"
        )
    if match.notes:
        parts.append(make_section("What to know", f"<ul>{make_items(match.notes)}</ul>"))
    return make_body(TITLE, match.describe(), *parts)


def list_numbers(match: Match) -> Iterator[tuple[str, str, str, str]]:
    """Each cell of the tables as a row: table, row, column, value."""
    yield "table", "row", "column", "value"
    for heads, *rows in match.list_tables():
        for name, *cells in rows:
            yield from ((heads[0], name, head, cell) for head, cell in zip(heads[1:], cells, strict=True) if cell)


def write_numbers(match: Match) -> str:
    """The recipe and the numbers of a match as a CSV table."""
    made = io.StringIO()
    csv.writer(made, lineterminator="\n").writerows(list_numbers(match))
    return made.getvalue()
