"""What the reports' pictures have in common: small files, and a colour for each step of a solve."""

import os
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vrte.basics.errors import SceneError, import_extra
from vrte.formats.atomic import write_atomically

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUFFIXES: dict[str, Any] = {".png": {}, ".svg": {"Date": None}, ".pdf": {"CreationDate": None}}  # what tells the hour
SHARP_DPI = 160  # of a picture by itself, and of what is made of pixels in a drawing
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
    import_extra("matplotlib.figure", "a picture", "plot")


def make_figure(width: float, height: float) -> "Figure":
    """An empty white figure [inches] that a notebook shows by itself. Raises MissingExtraError without matplotlib."""
    require_pictures()
    from vrte.pictures.shown_figure import ShownFigure

    return ShownFigure(figsize=(width, height), facecolor="white")


def save_figure(figure: "Figure", path: str | os.PathLike[str]) -> None:
    """Writes a PNG, SVG or PDF by the suffix, all of it or nothing; the same figure makes the same bytes.

    Raises SceneError for another suffix, OSError.
    """
    from matplotlib import rc_context

    suffix = plot_suffix(path)
    with write_atomically(path) as part, rc_context({"svg.hashsalt": "vrte"}):
        figure.savefig(part, format=suffix[1:], dpi=SHARP_DPI, metadata=SUFFIXES[suffix])


def plot_suffix(path: str | os.PathLike[str]) -> str:
    """Which of SUFFIXES a picture's name has. Raises SceneError for another.

    >>> plot_suffix("lobe.SVG")
    '.svg'
    """
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise SceneError(f"the picture {path} must end in {' or '.join(SUFFIXES)}")
    return suffix


def save(figure: "Figure", path: str | os.PathLike[str]) -> None:
    """Writes a small PNG, all of it or nothing. Raises OSError."""
    from PIL import Image  # matplotlib needs it too

    drawn = BytesIO()
    figure.savefig(drawn, format="png", dpi=DPI)
    with write_atomically(path) as part, Image.open(drawn) as image:
        # an octree keeps the colours of thin lines; median cut makes them those of others
        few = image.convert("RGB").quantize(COLOURS_KEPT, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
        few.save(part, format="PNG", optimize=True)


def limit_ticks(count: int = 4) -> Any:
    """At most so many ticks and one, at round numbers."""
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(count, steps=[1, 2, 2.5, 5, 10])


def finish(panels: Any, titles: tuple[str, ...], below: str) -> None:
    """Titles, axes and a legend of small panels beside each other."""
    for panel, title in zip(panels, titles, strict=True):
        panel.set_title(title, fontsize=10)
        panel.set_xlabel(below, fontsize=9)
        panel.set_ylim(bottom=0.0)
        panel.tick_params(labelsize=8)
        panel.grid(color=FAINT, linewidth=0.5, alpha=0.7)
    panels[0].legend(fontsize=7, frameon=False)
