"""What the reports' pictures have in common: small files, and a colour for each step of a solve."""

import os
from io import BytesIO
from typing import TYPE_CHECKING

from vrte.errors import MissingExtraError
from vrte.formats.atomic import atomic_write

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 100
COLOURS_KEPT = 128  # in a file: less than a third of the bytes, and no difference to the eye
FAINT = "#b5b5b5"
COLOURS = {
    "homogeneous": "#1f4e79",
    "particular": "#d98200",
    "boundary": "#2a8f5b",
    "reconstruction": "#b3262e",
    "assembly": "#7a4fa3",
}


def require_pictures() -> None:
    """Raises MissingExtraError without matplotlib."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError as error:
        raise MissingExtraError("a picture", "plot") from error


def new_figure(width: float, height: float) -> "Figure":
    """An empty white figure [inches] that a notebook shows by itself. Raises MissingExtraError without matplotlib."""
    require_pictures()
    from vrte.report.shown_figure import ShownFigure

    return ShownFigure(figsize=(width, height), facecolor="white")


def save(figure: "Figure", path: str | os.PathLike[str]) -> None:
    """Writes a small PNG, all of it or nothing. Raises OSError."""
    from PIL import Image  # matplotlib needs it too

    drawn = BytesIO()
    figure.savefig(drawn, format="png", dpi=DPI)
    with atomic_write(path) as part, Image.open(drawn) as image:
        # an octree keeps the colours of thin lines; median cut makes them those of others
        few = image.convert("RGB").quantize(COLOURS_KEPT, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
        few.save(part, format="PNG", optimize=True)
