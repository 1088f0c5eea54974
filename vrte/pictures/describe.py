"""A figure as a description: panels of curves, areas and swatches over axes with units, for either of two drawers.

`vrte.pictures.figures` draws it with matplotlib, `vrte.pictures.interactive` with Plotly. In a polar panel x is the
angle [degrees] clockwise from straight up, y the radius.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

INK, FAINT, ZERO = "#222222", "#b5b5b5", "#888888"
BLUE, ORANGE, GREEN, RED, PURPLE, GREY = "#1f4e79", "#d98200", "#2a8f5b", "#b3262e", "#7a4fa3", "#666666"
PALETTE = (BLUE, GREEN, PURPLE, ORANGE, RED)
INCIDENT, MIRRORED = "#d62728", GREEN  # rays of light


@dataclass(frozen=True)
class Curve:
    """Points x, y (n,), joined by a ``dash``, with a ``marker``, errors ``sigma`` (n,), ``hover`` in Plotly's
    placeholders; ``filled`` polygon with a ``hatch``; ``arrow`` between two; ``bar``: bars so far off from x."""

    x: Any
    y: Any
    name: str = ""
    colour: Any = INK
    dash: str = "-"
    marker: str = ""
    width: float = 1.5
    size: float = 4.0
    opacity: float = 1.0
    sigma: Any = None
    hover: str = ""
    filled: bool = False
    hatch: str = ""
    arrow: bool = False
    bar: float | None = None
    listed: bool = True  # in the legend
    shown: bool = True  # at first; else a click on the legend shows it


@dataclass(frozen=True)
class Line:
    """A straight line through a whole panel: along y at an x, or along x at a y."""

    x: float | None = None
    y: float | None = None
    name: str = ""
    colour: str = FAINT
    dash: str = "-"
    width: float = 1.0


@dataclass(frozen=True)
class Words:
    """A text at x, y in shares of the panel, or with x of the data."""

    text: str
    x: float = 0.5
    y: float = 0.5
    colour: str = INK
    size: float = 9.0
    of_data: bool = False
    align: str = "center"
    turned: bool = False


@dataclass(frozen=True)
class Swatch:
    """A rectangle of colour, its left, lower corner, width and height in shares of the panel."""

    colour: str
    x: float
    y: float
    width: float
    height: float


@dataclass(frozen=True)
class Body:
    """A lobe, its radius times ``factor``, from 0 to 1, in colours of degrees of polarization."""

    lobe: Any
    factor: float
    colours: Any


@dataclass(frozen=True)
class Axis:
    """An axis: its quantity with the unit, its ends, None where the data say them, and its ticks with their words."""

    label: str = ""
    low: float | None = None
    high: float | None = None
    log: float = 0.0  # base of the logarithm, 0 for a linear axis
    ticks: Any = None
    words: Sequence[str] = ()
    whole: bool = False  # ticks at whole numbers alone
    fine: bool = False  # ticks at 1, 2 and 5 of each decade of a logarithmic axis


@dataclass(frozen=True)
class PlotPanel:
    """What lies over one pair of axes; without axes (``bare``) swatches or words alone."""

    parts: Sequence[Curve | Line | Words | Swatch | Body]
    x: Axis = Axis()
    y: Axis = Axis()
    title: str = ""
    polar: str = ""  # "half" or "whole": polar, over the upper half or all around
    legend: str = "best"  # where it stands, "below" the panel too; "" for none
    columns: int = 1  # of the legend
    letters: float = 7.0  # size of the legend's letters
    bare: bool = False
    grid: bool = True


@dataclass(frozen=True)
class Picture:
    """Panels in rows, None where there is none, with sizes [inches] and the ratios of rows and columns."""

    rows: Sequence[Sequence[PlotPanel | None]]
    width: float
    height: float
    title: str = ""
    heights: Sequence[float] | None = None
    widths: Sequence[float] | None = None
    share_y: bool = False  # the panels of a row have one y axis
    bar: str = ""  # what the colours of the first panels' bodies are


def spread(size: int, most: int) -> list[int]:
    """At most so many indices, evenly over all."""
    return sorted({round(i * (size - 1) / max(min(size, most) - 1, 1)) for i in range(min(size, most))})


def colour_scale(count: int) -> list[Any]:
    """Colours of ``count`` curves in an order, such as depths or wavelengths, of matplotlib's plasma."""
    from matplotlib import colormaps

    return [tuple(colormaps["plasma"](0.9 * k / max(count - 1, 1))) for k in range(count)]
