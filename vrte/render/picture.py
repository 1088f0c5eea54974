"""Spheres as a PNG: a row each, in colour, and how polarized their light is; or in colour alone."""

import os
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.polarization import (
    find_angle_of_linear_polarization,
    find_degree_of_circular_polarization,
    find_degree_of_linear_polarization,
)
from vrte.formats.atomic import write_atomically
from vrte.pictures.figures import limit_ticks, make_figure, require_pictures
from vrte.pictures.lobes import INK
from vrte.render.rendering import Sphere
from vrte.render.setting import Setting

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 100
GAP = 0.05  # of a sphere's size; and so
LETTER, LINE = 0.0185, 0.045  # of a note: the width of a letter, the height of a line
ENDS = np.array([-1.0, 1.0])
BEHIND = 0.42  # sRGB grey behind spheres in colour, about the eye's middle
DEGREE_COLOURS, CIRCULAR_COLOURS, ANGLE_COLOURS = "inferno", "RdBu_r", "hsv"
FAINT_DEGREE = 0.005  # below, the angle of polarization fades to grey
ROUND = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
POLARIZATION = ("degree of linear polarization", "angle of linear polarization", "degree of circular polarization")
HEADINGS = ("colour", *POLARIZATION)


def save(spheres: Sequence[Sphere], setting: Setting, path: str | os.PathLike[str]) -> None:
    """Writes the PNG, all of it or nothing. Raises MissingExtraError without matplotlib, OSError."""
    drawn = draw_figure(spheres, setting)
    with write_atomically(path) as part:
        drawn.savefig(part, format="png", dpi=DPI)


def save_colours(spheres: Sequence[Sphere], path: str | os.PathLike[str]) -> None:
    """The spheres in colour beside each other, without any text; transparent around them. Errors as `save`."""
    require_pictures()
    from PIL import Image

    pixels = np.concatenate([sphere.rgba for sphere in spheres], axis=1)
    drawn = Image.fromarray((255.0 * pixels + 0.5).astype(np.uint8), "RGBA")
    with write_atomically(path) as part:
        drawn.save(part, format="PNG", optimize=True)


def draw_figure(spheres: Sequence[Sphere], setting: Setting) -> "Figure":
    """A row a sphere, a column each for colour, degree and angle of linear and degree of circular polarization."""
    require_pictures()
    sheet = Sheet(setting.size_px, len(spheres), len(HEADINGS), foot=0.44, note=say_light(setting, spheres))
    linear = [find_degree_of_linear_polarization(sphere.stokes) for sphere in spheres]
    circular = [find_degree_of_circular_polarization(sphere.stokes) for sphere in spheres]
    most_linear, most_circular = _find_largest(linear), _find_largest(circular)
    for row, sphere in enumerate(spheres):
        sheet.title(row, sphere.material.title)
        sheet.show(row, 0, put_over_grey(sphere.rgba))
        sheet.show(row, 1, colour_values(linear[row], DEGREE_COLOURS, 0.0, most_linear, sphere.cover))
        sheet.show(row, 2, colour_angles(sphere.stokes, sphere.cover))
        sheet.show(row, 3, colour_values(circular[row], CIRCULAR_COLOURS, -most_circular, most_circular, sphere.cover))
    for column, heading in enumerate(HEADINGS):
        sheet.heading(column, heading)
    sheet.bar(1, DEGREE_COLOURS, 0.0, most_linear)
    sheet.bar(3, CIRCULAR_COLOURS, -most_circular, most_circular)
    sheet.wheel(2)
    return sheet.figure


def say_light(setting: Setting, spheres: Sequence[Sphere]) -> str:
    """Under which light a picture was made, and at which wavelengths."""
    sun = f"sun {setting.sun_elevation_deg:g}° high"
    light = {
        "rayleigh": f"{sun}, Rayleigh sky over ground of albedo {setting.ground_albedo:g}",
        "sun": f"{sun}, black sky",
        "uniform": "unpolarized light, the same from all sides",
    }[setting.sky]
    sets: dict[str, list[str]] = {}  # of wavelengths; in brackets who has others than the first
    for sphere in spheres:
        words = say_wavelengths(sphere.material.wavelengths_um.tolist())
        sets.setdefault(words, []).append(sphere.material.title)
    first, *others = sets
    return "; ".join([light, first, *(f"{words} ({', '.join(sets[words])})" for words in others)])


def say_wavelengths(chosen: Sequence[float]) -> str:
    """
    >>> say_wavelengths([0.4, 0.55, 0.7]), say_wavelengths([0.64])
    ('3 wavelengths, 0.4 to 0.7 µm', '0.64 µm')
    """
    return f"{chosen[0]:g} µm" if len(chosen) == 1 else f"{len(chosen)} wavelengths, {chosen[0]:g} to {chosen[-1]:g} µm"


def put_over_grey(rgba: Array) -> Array:
    """A picture (..., 4) over the grey background, (..., 3)."""
    found: Array = rgba[..., 3:] * rgba[..., :3] + (1.0 - rgba[..., 3:]) * BEHIND
    return found


def colour_values(values: Array, colours: str, low: float, high: float, cover: Array) -> Array:
    """Colours (size, size, 4) of values (size, size), transparent around the sphere."""
    from matplotlib import colormaps

    found = colormaps[colours]((np.nan_to_num(values) - low) / (high - low))
    found[..., 3] = cover
    return np.asarray(found)


def colour_angles(stokes: Array, cover: Array) -> Array:
    """Hues (size, size, 4) of the angle of polarization, grey where hardly anything is polarized."""
    from matplotlib import colormaps

    hues = colormaps[ANGLE_COLOURS](np.nan_to_num(find_angle_of_linear_polarization(stokes)) / 180.0)
    degree = np.nan_to_num(find_degree_of_linear_polarization(stokes))
    share = np.clip(degree / FAINT_DEGREE, 0.0, 1.0)[..., None]
    hues[..., :3] = share * hues[..., :3] + (1.0 - share) * 0.6
    hues[..., 3] = cover
    return np.asarray(hues)


def _find_largest(pictures: Sequence[Array]) -> float:
    """The largest size of all but the outermost few pixels, of all spheres, rounded up."""
    return _round_up(max(float(np.nanpercentile(np.abs(picture), 99.0)) for picture in pictures))


def _round_up(value: float) -> float:
    """To a step of ROUND times a power of ten; a scale for what is zero.

    >>> _round_up(0.013), _round_up(0.0)
    (0.015, 1e-06)
    """
    if value <= 1e-6:
        return 1e-6
    power = 10.0 ** np.floor(np.log10(value))
    return float(f"{next(step for step in ROUND if step * power >= value) * power:.6g}")


class Sheet:
    """A figure of square panels, pixel by pixel, with room for headings, titles at the left, legends below, and a note
    at the bottom, in as many lines as it takes."""

    def __init__(self, size: int, rows: int, columns: int, foot: float, note: str) -> None:
        self.size, self.rows, self.columns = size, rows, columns
        self.gap = round(GAP * size)
        self.left, self.head = round(0.10 * size), round(0.12 * size)
        self.width = self.left + columns * (size + self.gap)
        lines = textwrap.wrap(note, int((self.width - 2.0 * self.left) / (LETTER * size)))
        self.foot = round((foot + LINE * (len(lines) - 1)) * size)
        self.height = self.head + rows * (size + self.gap) + self.foot
        # a hair more: matplotlib before 3.11 cuts the 204.99 pixels that rounding leaves of 205
        self.figure = make_figure((self.width + 1e-6) / DPI, (self.height + 1e-6) / DPI)
        self.letters = 0.034 * size * 72.0 / DPI  # [points]
        below = self.height - 0.6 * self.gap
        self.text(self.left, below, "\n".join(lines), 0.95, ha="left", va="bottom", linespacing=1.3)

    def axes(self, left: float, top: float, width: float, height: float, **how: Any) -> Any:
        """Axes at a place in pixels from the upper left corner."""
        bottom = self.height - top - height
        place = (left / self.width, bottom / self.height, width / self.width, height / self.height)
        return self.figure.add_axes(place, **how)

    def corner(self, row: int, column: int) -> tuple[int, int]:
        """Left and top of a panel [pixels]."""
        return self.left + column * (self.size + self.gap), self.head + row * (self.size + self.gap)

    def show(self, row: int, column: int, pixels: Array) -> None:
        """A picture (size, size, 3 or 4), pixel for pixel."""
        axes = self.axes(*self.corner(row, column), self.size, self.size)
        axes.imshow(np.clip(pixels, 0.0, 1.0), interpolation="none")
        axes.set_axis_off()

    def text(self, left: float, top: float, text: str, size: float = 1.0, **how: Any) -> None:
        """Text, its middle at a place in pixels."""
        how = {"ha": "center", "va": "center", "color": INK} | how
        self.figure.text(left / self.width, 1.0 - top / self.height, text, fontsize=size * self.letters, **how)

    def heading(self, column: int, text: str) -> None:
        left, _ = self.corner(0, column)
        self.text(left + 0.5 * self.size, 0.5 * self.head, text, 1.15)

    def title(self, row: int, text: str) -> None:
        _, top = self.corner(row, 0)
        self.text(0.5 * self.left, top + 0.5 * self.size, text, 1.25, rotation=90)

    def bar(self, column: int, colours: Any, low: float, high: float, label: str = "") -> None:
        """A legend of colours below a column."""
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import Normalize

        left, top = self.corner(self.rows, column)
        axes = self.axes(left + 0.1 * self.size, top + 0.02 * self.size, 0.8 * self.size, 0.05 * self.size)
        shown = ScalarMappable(Normalize(low, high), colours)
        bar = self.figure.colorbar(shown, cax=axes, orientation="horizontal")
        bar.ax.tick_params(labelsize=0.95 * self.letters, length=0.2 * self.letters, colors=INK)
        bar.ax.xaxis.set_major_locator(limit_ticks(5))
        bar.set_label(label, size=self.letters, color=INK)

    def wheel(self, column: int) -> None:
        """The legend of angles: at each place around, light that swings along the line from there to the middle."""
        side = round(0.32 * self.size)
        across = (np.arange(side) + 0.5) / side * 2.0 - 1.0
        x, y = across[None, :], -across[:, None]
        distance = np.hypot(x, y)
        swing = 2.0 * np.arctan2(x, y)  # clockwise from the upright
        stokes = np.stack([np.ones_like(swing), np.cos(swing), np.sin(swing), np.zeros_like(swing)], axis=-1)
        ring = np.clip(np.minimum(1.0 - distance, distance - 0.5) * 0.5 * side + 0.5, 0.0, 1.0)
        left, top = self.corner(self.rows, column)
        top += round(0.03 * self.size)
        axes = self.axes(left + 0.5 * (self.size - side), top, side, side)
        axes.imshow(colour_angles(stokes, ring), interpolation="none", extent=(-1.0, 1.0, -1.0, 1.0))
        for degrees in range(0, 180, 45):
            sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
            axes.plot(0.42 * sine * ENDS, 0.42 * cosine * ENDS, color=INK, linewidth=0.08 * self.letters)
            right = left + 0.5 * (self.size - side) + (0.5 + 0.68 * sine) * side
            self.text(right, top + (0.5 - 0.58 * cosine) * side, f"{degrees}°", 0.95)
        axes.set_xlim(-1.0, 1.0), axes.set_ylim(-1.0, 1.0)
        axes.set_axis_off()
