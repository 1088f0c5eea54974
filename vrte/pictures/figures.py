"""Pictures drawn by matplotlib from their descriptions, and written as small files."""

import os
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from vrte.basics.errors import SceneError, import_extra
from vrte.basics.views import Figure
from vrte.formats.atomic import write_atomically
from vrte.pictures.describe import FAINT, INK, Axis, Body, Curve, Line, Picture, PlotPanel, Words
from vrte.pictures.lobes import draw_lobe

SUFFIXES: dict[str, Any] = {".png": {}, ".svg": {"Date": None}, ".pdf": {"CreationDate": None}}  # no time of writing
SHARP_DPI, DPI = 160, 100  # of a picture by itself or what is made of pixels in a drawing, and of a small one
COLOURS_KEPT = 128  # in a file: less than a third of the bytes, and no difference to the eye
GRID: dict[str, Any] = {"color": FAINT, "linewidth": 0.5, "alpha": 0.7}
POLAR_PAD = 0.25  # inches beside polar panels, whose angles of 90 degrees the layout overlooks


def require_pictures() -> None:
    """Raises MissingExtraError without matplotlib."""
    import_extra("matplotlib.figure", "a picture", "plot")


def make_figure(width: float, height: float) -> Figure:
    """An empty white figure [inches] that a notebook shows by itself. Raises MissingExtraError without matplotlib."""
    require_pictures()
    from vrte.pictures.shown_figure import ShownFigure

    return ShownFigure(figsize=(width, height), facecolor="white")


def draw_picture(picture: Picture) -> Figure:
    """The figure of a description. Raises MissingExtraError without matplotlib."""
    figure = make_figure(picture.width, picture.height)
    polar = any(panel is not None and panel.polar for row in picture.rows for panel in row)
    figure.set_layout_engine("constrained", w_pad=POLAR_PAD if polar else None)
    ratios = {"height_ratios": picture.heights, "width_ratios": picture.widths}
    grid = figure.add_gridspec(len(picture.rows), max(map(len, picture.rows)), **ratios)
    for row, panels in enumerate(picture.rows):
        drawn: list[Any] = []
        for column, panel in enumerate(panels):
            if panel is None:
                continue
            end = row + 1
            while end < len(picture.rows) and column < len(picture.rows[end]) and picture.rows[end][column] is None:
                end += 1  # a panel fills what is empty below it, and the last of a row the rest of the row
            index = grid[row:end, column:] if column == len(panels) - 1 else grid[row:end, column]
            shared = drawn[0] if drawn and picture.share_y else None
            axes = figure.add_subplot(index, projection="polar" if panel.polar else None, sharey=shared)
            draw_panel(axes, panel)
            drawn.append(axes)
        if picture.share_y and panels[0] is not None:
            drawn[0].autoscale(axis="y")
            drawn[0].set_ylim(panels[0].y.low, panels[0].y.high)
            for axes in drawn[1:]:
                axes.set_ylabel("")
                axes.tick_params(labelleft=False)
        if picture.bar and row == 0 and panels[0] is not None and isinstance(panels[0].parts[0], Body):
            bar = figure.colorbar(panels[0].parts[0].colours, ax=drawn, extend="max", shrink=0.8, ticks=limit_ticks())
            bar.set_label(picture.bar, fontsize=9)
    if picture.title:
        figure.suptitle(picture.title, fontsize=13)
    return figure


def draw_panel(axes: Any, panel: PlotPanel) -> None:
    """A panel into matplotlib's axes."""
    from matplotlib.patches import Rectangle

    for part in panel.parts:
        if isinstance(part, Body):
            draw_lobe(axes, part.lobe, part.factor, part.colours)
            continue
        style: dict[str, Any] = {"color": part.colour}
        if isinstance(part, Curve):
            draw_curve(axes, part, bool(panel.polar))
        elif isinstance(part, Line):
            style |= {"linestyle": part.dash, "linewidth": part.width, "label": part.name or None, "zorder": 0.5}
            axes.axhline(part.y, **style) if part.x is None else axes.axvline(part.x, **style)
        elif isinstance(part, Words):
            where = axes.get_xaxis_transform() if part.of_data else axes.transAxes
            style |= {"fontsize": part.size, "ha": part.align, "rotation": 90.0 * part.turned}
            style |= {"va": "top" if part.align == "left" else "center", "wrap": True, "linespacing": 1.4}
            axes.text(part.x, part.y, part.text, transform=where, **style)
        else:
            corner = part.x, part.y
            axes.add_patch(Rectangle(corner, part.width, part.height, linewidth=0, transform=axes.transAxes, **style))
    if panel.title:
        axes.set_title(panel.title, fontsize=10, color=INK)
    if panel.bare:
        axes.set_axis_off()
        return
    if panel.polar:
        axes.set_theta_zero_location("N"), axes.set_theta_direction(-1)
        axes.set_thetalim(-np.pi / 2.0, np.pi / 2.0)
        axes.set_thetagrids(range(-90, 91, 30))
        axes.set_rlabel_position(90.0)
        axes.yaxis.set_major_locator(limit_ticks())
        axes.set_ylim(panel.y.low, panel.y.high)
        axes.text(0.75, 0.11, panel.y.label, transform=axes.transAxes, fontsize=9, ha="center")
    else:
        set_axis(axes, "x", panel.x)
        set_axis(axes, "y", panel.y)
    axes.set_axisbelow(True)
    axes.tick_params(which="both", labelsize=8)
    axes.grid(**GRID) if panel.grid else None
    handles, names = axes.get_legend_handles_labels()
    if panel.legend and handles:
        spot: dict[str, Any] = {"loc": panel.legend}
        if panel.polar or panel.legend == "below":
            spot = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.1 if panel.polar else -0.15)}
        axes.legend(handles, names, fontsize=panel.letters, frameon=False, ncols=panel.columns, **spot)


def draw_curve(axes: Any, curve: Curve, polar: bool) -> None:
    """A curve, or the area that it bounds, into matplotlib's axes; the angles of a polar one are in degrees."""
    x = np.radians(curve.x) if polar else curve.x
    style: dict[str, Any] = {"alpha": curve.opacity, "label": curve.name if curve.name and curve.listed else None}
    if curve.filled:
        edge = {"edgecolor": FAINT, "hatch": curve.hatch} if curve.hatch else {}
        axes.fill(x, curve.y, facecolor=curve.colour, linewidth=0.0, **edge, **style)
        return
    style |= {"color": curve.colour, "linestyle": curve.dash or "none", "linewidth": curve.width}
    style |= {"marker": curve.marker or None, "markersize": curve.size}
    if curve.sigma is None:
        axes.plot(x, curve.y, **style)
    else:
        axes.errorbar(x, curve.y, curve.sigma, elinewidth=0.8, **style)


def set_axis(axes: Any, which: str, axis: Axis) -> None:
    """The label, ends, scale and ticks of one of matplotlib's axes."""
    if axis.log:
        getattr(axes, f"set_{which}scale")("log", base=axis.log)
    if axis.low is not None or axis.high is not None:
        getattr(axes, f"set_{which}lim")(axis.low, axis.high)
    if axis.label:
        getattr(axes, f"set_{which}label")(axis.label, fontsize=9)
    own = getattr(axes, f"{which}axis")
    if axis.ticks is not None:
        own.set_ticks(list(axis.ticks), list(axis.words) or None)
        own.set_minor_formatter("")
    elif axis.fine:
        own.get_major_locator().set_params(subs=(1.0, 2.0, 5.0))
        own.set_major_formatter("{x:g}")
        own.set_minor_formatter("")
    elif axis.whole:
        own.get_major_locator().set_params(integer=True)


def make_bytes(figure: Figure, suffix: str = ".png", dpi: int = SHARP_DPI) -> bytes:
    """A figure as a PNG, SVG or PDF, by one of SUFFIXES: the same figure makes the same bytes."""
    from matplotlib import rc_context

    drawn = BytesIO()
    with rc_context({"svg.hashsalt": "vrte"}):
        figure.savefig(drawn, format=suffix[1:], dpi=dpi, metadata=SUFFIXES[suffix])
    return drawn.getvalue()


def save_figure(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Writes a PNG, SVG or PDF by the suffix, all of it or nothing. Raises SceneError, OSError."""
    drawn = make_bytes(figure, plot_suffix(path))
    with write_atomically(path) as part:
        part.write_bytes(drawn)


def plot_suffix(path: str | os.PathLike[str]) -> str:
    """Which of SUFFIXES a picture's name has. Raises SceneError for another."""
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise SceneError(f"the picture {path} must end in {' or '.join(SUFFIXES)}")
    return suffix


def save(figure: Figure, path: str | os.PathLike[str], few_colours: bool = True) -> None:
    """Writes a small PNG, all of it or nothing, in few colours or in all. Raises OSError."""
    from PIL import Image  # matplotlib needs it too

    drawn = BytesIO(make_bytes(figure, dpi=DPI))
    with write_atomically(path) as part, Image.open(drawn) as whole:
        image = whole.convert("RGB")
        if few_colours:  # an octree keeps the colours of thin lines; median cut makes them those of others
            image = image.quantize(COLOURS_KEPT, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
        image.save(part, format="PNG", optimize=True)


def limit_ticks(count: int = 4) -> Any:
    """At most so many ticks and one, at round numbers."""
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(count, steps=[1, 2, 2.5, 5, 10])
