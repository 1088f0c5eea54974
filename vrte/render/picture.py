"""Renderings as a PNG: a row each, in colour, and how polarized their light is; or in colour alone.

A sheet shows beside each picture the lobes of its material, on a scale of their own.
"""

import os
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.polarization import (
    find_angle_of_linear_polarization,
    find_degree_of_circular_polarization,
    find_degree_of_linear_polarization,
)
from vrte.formats.atomic import write_atomically
from vrte.formats.layers import describe_filling
from vrte.formats.toml_table import read_fraction
from vrte.pictures.describe import INK
from vrte.pictures.figures import DPI, limit_ticks, make_figure, require_pictures
from vrte.pictures.lobes import Lobe, compute_lobe, draw_lobe, make_lobe_colours
from vrte.render.rendering import PictureSetting, Rendering

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GAP = 0.05  # of a panel's size; and so
LETTERS = 0.064  # the height of letters: more than 11 pixels where a sheet of four columns is shown 800 pixels wide
ROW_LETTERS = 0.023  # of a row's width
NARROW, LINE = 0.56, 1.35  # of that: the width of a letter, the distance of lines
ENDS = np.array([-1.0, 1.0])
OUTLINE = 0.6  # sRGB grey of the outlines of bodies
PEAKED, DECADES = 0.05, 3  # the median of a lobe over its largest value, below which its radius is logarithmic
BEHIND = 0.42  # sRGB grey behind spheres in colour, about the eye's middle
DEGREE_COLOURS, CIRCULAR_COLOURS, ANGLE_COLOURS = "inferno", "RdBu_r", "hsv"
FAINT_DEGREE = 0.005  # below, the angle of polarization fades to grey
DEGREE_POWER = 0.5  # of degrees in pictures with a sky, which is polarized ten times as much as what stands below
ROUND = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
LINEAR = "degree of linear polarization"
HEADINGS = ("colour", LINEAR, "angle of linear polarization", "degree of circular polarization")
LOBE_MU_I = np.array([0.6, 1.0])
LOBE_UM = 0.64
LOBE_MU_O = np.cos(np.radians(np.linspace(0.0, 89.0, 46)))
LOBE_PHI = np.arange(0.0, 181.0, 3.0)


def save_colours(renderings: Sequence[Rendering], path: str | os.PathLike[str]) -> None:
    """The pictures in colour beside each other, without any text; transparent around them. Raises OSError."""
    require_pictures()
    from PIL import Image

    pixels = np.concatenate([rendering.rgba for rendering in renderings], axis=1)
    with write_atomically(path) as part:
        image = Image.fromarray((255.0 * pixels + 0.5).astype(np.uint8), "RGBA")
        image.save(part, format="PNG", optimize=True)


def save_radiances(rendering: Rendering, path: str | os.PathLike[str]) -> None:
    """An EXR file: R, G, B in linear sRGB as the film has them, and S0 to S3, the Stokes vector weighted by luminance
    in the axes of a `Rendering`. Raises OSError."""
    from vrte.mitsuba.bsdf import mi

    pixels = np.concatenate([rendering.film.linear(rendering.xyz), rendering.stokes], axis=-1)
    names = ["R", "G", "B", "S0", "S1", "S2", "S3"]
    with write_atomically(path) as part:
        image = mi.Bitmap(np.float32(pixels), mi.Bitmap.PixelFormat.MultiChannel, names)
        image.write(str(part), mi.Bitmap.FileFormat.OpenEXR)


def draw_figure(renderings: Sequence[Rendering], setting: PictureSetting) -> "Figure":
    """A row a picture, a column each for colour, degree and angle of linear and degree of circular polarization."""
    captions = [(rendering.title, "") for rendering in renderings]
    sheet = Sheet(setting.size_px, captions, len(HEADINGS), foot=0.56, note=describe_light(setting, renderings))
    degrees = measure_degrees(renderings)
    circular = [find_degree_of_circular_polarization(rendering.stokes) for rendering in renderings]
    most = _find_largest(circular)
    handed = Scale(CIRCULAR_COLOURS, -most, most)
    for row, rendering in enumerate(renderings):
        linear = show_degrees(rendering, degrees)
        angles, hands = colour_angles(rendering.stokes, rendering.cover), handed.colour(circular[row], rendering.cover)
        sheet.show_row(row, put_over_grey(rendering.rgba), linear, angles, hands)
    sheet.head_columns(*HEADINGS)
    sheet.bar(1, degrees)
    sheet.bar(3, handed)
    sheet.wheel(2)
    return sheet.figure


def draw_sheet(
    renderings: Sequence[Rendering], setting: PictureSetting, progress: Callable[[int, int, str], None] | None = None
) -> "Figure":
    """A row a material: picture, degree of polarization, lobes; ``progress``: (rows done, rows, title)."""
    headings = ("colour", LINEAR, *(f"lobe, $\\mu_i$ = {mu_i:g}" for mu_i in LOBE_MU_I))
    lobes = f"Lobes: {1e3 * LOBE_UM:.0f} nm, unpolarized light; the bar below is their {LINEAR}"
    note = f"{lobes}. Pictures: {describe_light(setting, renderings)}"
    captions = [(rendering.title, describe_layers(rendering.materials[0].content)) for rendering in renderings]
    sheet = Sheet(setting.size_px, captions, len(headings), foot=0.20, note=note)
    degrees, size = measure_degrees(renderings), sheet.size
    for row, rendering in enumerate(renderings):
        (material,) = rendering.materials
        sheet.show_row(row, put_over_grey(rendering.rgba), show_degrees(rendering, degrees))
        brdf = material.brdf(LOBE_UM, LOBE_MU_I, LOBE_MU_O, LOBE_PHI)
        both = [compute_lobe(brdf, index) for index in range(LOBE_MU_I.size)]
        colours = make_lobe_colours(both)
        circle, both, scale = scale_lobes(both)
        for column, lobe in enumerate(both, 2):
            lobe = replace(lobe, mirrored=lobe.mirrored.partition(",")[0])  # there is no room for how polarized
            axes = sheet.axes(*sheet.corner(row, column), size, 0.76 * size)
            draw_lobe(axes, lobe, 1.0 / circle, colours, sheet.letters)
        left, top = sheet.corner(row, 2)
        where = (left + 0.1 * size, top + 0.80 * size, 0.9 * size, 0.05 * size)
        sheet.draw_bar(where, colours, limit_ticks(2))
        sheet.text(left + 1.6 * size, top + 0.86 * size, scale, linespacing=1.2)
        if progress is not None:
            progress(row + 1, len(renderings), material.title)
    sheet.head_columns(*headings)
    sheet.bar(1, degrees)
    return sheet.figure


def scale_lobes(lobes: Sequence[Lobe]) -> tuple[float, list[Lobe], str]:
    """The value of the outer circle, the lobes, and their scale in words: logarithmic where most of a lobe would be a
    few pixels beside its peak."""
    radii = np.stack([lobe.radius for lobe in lobes])
    circle = round_up(float(radii.max()))
    words = f"outer circle: $f_{{00}}$ = {circle:g} sr$^{{-1}}$"
    if np.median(radii, axis=(1, 2)).max() > PEAKED * circle:
        return circle, list(lobes), words
    parts = 1.0 + np.log10(np.maximum(radii / circle, 10.0**-DECADES)) / DECADES
    drawn = [replace(lobe, heights=circle * part) for lobe, part in zip(lobes, parts, strict=True)]
    return circle, drawn, f"{words},\nmiddle {circle * 10.0**-DECADES:g}, logarithmic"


def draw_row(rendering: Rendering, setting: PictureSetting) -> "Figure":
    """One wide picture of all that stands beside each other: in colour, and below how much of it is polarized."""
    height, width = rendering.cover.shape
    letter, degrees = ROW_LETTERS * width, measure_degrees([rendering])
    words = f"Below: {LINEAR}. Light: {describe_light(setting, [rendering])}"
    lines = textwrap.wrap(words, int(0.56 * width / (NARROW * letter)))
    titles = [
        textwrap.wrap(material.title, max(4, int(room / (NARROW * letter)) - 1))
        for material, (_, room) in zip(rendering.materials, rendering.places, strict=True)
    ]
    strip, foot = (round((1.3 * count + 0.8) * letter) for count in (max(map(len, titles)), max(len(lines), 2)))
    canvas = Canvas(width, 2 * height + strip + foot, letter)
    canvas.show(0, 0, put_over_grey(rendering.rgba))
    canvas.show(0, height + strip, show_degrees(rendering, degrees))
    below = canvas.height - 0.5 * foot
    for (across, _), title in zip(rendering.places, titles, strict=True):
        canvas.text(across, height + 0.5 * strip, "\n".join(title), linespacing=1.2)
    canvas.draw_bar((0.62 * width, below - 0.8 * letter, 0.34 * width, 0.7 * letter), degrees.mappable, degrees.ticks)
    canvas.text(0.015 * width, below, "\n".join(lines), ha="left", linespacing=1.2)
    return canvas.figure


@dataclass(frozen=True, eq=False)
class Scale:
    """Colours from ``low`` to ``high``, evenly or as a ``power`` of the value."""

    colours: str
    low: float
    high: float
    power: float = 1.0

    @property
    def mappable(self) -> Any:
        """What a legend is made of."""
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import PowerNorm

        return ScalarMappable(PowerNorm(self.power, self.low, self.high), self.colours)

    @property
    def ticks(self) -> list[float]:
        """Round values for a legend, as far apart as its colours are."""
        if self.power == 1.0:
            middle = 0.5 * (self.low + self.high)
            return [self.low, middle, self.high]
        found = [0.0]
        for step in (0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.0):
            apart = (step / self.high) ** self.power - (found[-1] / self.high) ** self.power
            found += [step] if step <= self.high + 1e-9 and apart > 0.2 else []
        return found

    def colour(self, values: Array, cover: Array) -> Array:
        """Values (height, width) in these colours, (height, width, 4), transparent around a sphere."""
        from matplotlib import colormaps

        low, high, values = self.low, self.high, np.nan_to_num(values)
        if self.power != 1.0:  # from 0 on
            high, values = high**self.power, values**self.power
        found = np.asarray(colormaps[self.colours]((values - low) / (high - low)))
        found[..., 3] = cover
        return found


def measure_degrees(renderings: Sequence[Rendering]) -> Scale:
    """The scale of degrees of linear polarization that suits all pictures: their square roots where there is a sky."""
    most = _find_largest([find_degree_of_linear_polarization(rendering.stokes) for rendering in renderings])
    power = DEGREE_POWER if any((rendering.cover == 1.0).all() for rendering in renderings) else 1.0
    return Scale(DEGREE_COLOURS, 0.0, min(most, 1.0), power)


def show_degrees(rendering: Rendering, scale: Scale) -> Array:
    """How polarized a picture is, (height, width, 4), its bodies outlined: ground and body may both be black."""
    found = scale.colour(find_degree_of_linear_polarization(rendering.stokes), rendering.cover)
    body = rendering.body
    if body is not None:
        edge = np.zeros(body.shape, bool)
        edge[1:] |= body[1:] != body[:-1]
        edge[:, 1:] |= body[:, 1:] != body[:, :-1]
        found[edge, :3] = 0.5 * found[edge, :3] + 0.5 * OUTLINE
    return found


def describe_light(setting: PictureSetting, renderings: Sequence[Rendering]) -> str:
    """Under which light a picture was made, and at which wavelengths."""
    sun = f"sun {setting.sun_elevation_deg:g}° high"
    light = (
        renderings[0].light
        or {
            "rayleigh": f"{sun}, Rayleigh sky over ground of albedo {setting.ground_albedo:g}",
            "sun": f"{sun}, black sky",
            "uniform": "unpolarized light, the same from all sides",
        }[setting.sky]
    )
    sets: dict[str, list[str]] = {}  # of wavelengths; in brackets who has others than the first
    for material in (material for rendering in renderings for material in rendering.materials):
        sets.setdefault(describe_wavelengths(material.wavelengths_um.tolist()), []).append(material.title)
    first, *others = sets
    if any(rendering.glare for rendering in renderings):
        light += ", with the glare of an eye"
    return "; ".join([light, first, *(f"{words} ({', '.join(sets[words])})" for words in others)])


def describe_wavelengths(chosen: Sequence[float]) -> str:
    """How many wavelengths, from where to where; one alone by itself."""
    return f"{chosen[0]:g} µm" if len(chosen) == 1 else f"{len(chosen)} wavelengths, {chosen[0]:g} to {chosen[-1]:g} µm"


def put_over_grey(rgba: Array) -> Array:
    """A picture (..., 4) over the grey background, (..., 3)."""
    return rgba[..., 3:] * rgba[..., :3] + (1.0 - rgba[..., 3:]) * BEHIND


def colour_angles(stokes: Array, cover: Array) -> Array:
    """Hues (size, size, 4) of the angle of polarization, grey where hardly anything is polarized."""
    from matplotlib import colormaps

    hues = colormaps[ANGLE_COLOURS](np.nan_to_num(find_angle_of_linear_polarization(stokes)) / 180.0)
    degree = np.nan_to_num(find_degree_of_linear_polarization(stokes))
    weight = np.clip(degree / FAINT_DEGREE, 0.0, 1.0)[..., None]
    hues[..., :3] = weight * hues[..., :3] + (1.0 - weight) * 0.6
    hues[..., 3] = cover
    return np.asarray(hues)


def _find_largest(pictures: Sequence[Array]) -> float:
    """The largest size of all but the outermost few pixels, of all pictures, rounded up."""
    return round_up(max(float(np.nanpercentile(np.abs(picture), 99.0)) for picture in pictures))


def round_up(value: float) -> float:
    """To a step of ROUND times a power of ten; a scale for what is zero."""
    if value <= 1e-6:
        return 0.01
    power = 10.0 ** np.floor(np.log10(value))
    return float(f"{next(step for step in ROUND if step * power >= value) * power:.6g}")


class Canvas:
    """A figure of ``width`` x ``height`` pixels, places from its upper left corner, letters ``letter`` high."""

    def __init__(self, width: int, height: int, letter: float) -> None:
        self.width, self.height = width, height
        self.letters = letter * 72.0 / DPI  # [points]
        # a hair more: matplotlib before 3.11 cuts the 204.99 pixels that rounding leaves of 205
        self.figure = make_figure((width + 1e-6) / DPI, (height + 1e-6) / DPI)

    def axes(self, left: float, top: float, width: float, height: float, **how: Any) -> Any:
        """Axes of this size with their upper left corner at a place."""
        bottom = self.height - top - height
        index = (left / self.width, bottom / self.height, width / self.width, height / self.height)
        return self.figure.add_axes(index, **how)

    def show(self, left: float, top: float, pixels: Array) -> None:
        """A picture (height, width, 3 or 4), pixel for pixel."""
        axes = self.axes(left, top, pixels.shape[1], pixels.shape[0])
        axes.imshow(np.clip(pixels, 0.0, 1.0), interpolation="none")
        axes.set_axis_off()

    def text(self, left: float, top: float, text: str, size: float = 1.0, **how: Any) -> None:
        """Text, its middle at a place."""
        how = {"ha": "center", "va": "center", "color": INK} | how
        self.figure.text(left / self.width, 1.0 - top / self.height, text, fontsize=size * self.letters, **how)

    def draw_bar(self, where: tuple[float, float, float, float], shown: Any, ticks: Any) -> None:
        """A legend of colours: ``where`` are left, top, width and height."""
        bar = self.figure.colorbar(shown, cax=self.axes(*where), orientation="horizontal", ticks=ticks)
        bar.ax.tick_params(labelsize=self.letters, length=0.2 * self.letters, colors=INK)
        bar.ax.xaxis.set_major_formatter(lambda value, _: f"{value:g}")


class Sheet(Canvas):
    """Square panels, pixel by pixel, with room for headings, legends below, and ``captions`` above each row, a title
    and what there is to say of it, and a note at the bottom, in as many lines as they take; ``foot``, room for legends,
    in panels."""

    def __init__(self, size: int, captions: Sequence[tuple[str, str]], columns: int, foot: float, note: str) -> None:
        self.size, self.rows = size, len(captions)
        self.gap = self.left = round(GAP * size)
        width = self.left + columns * (size + self.gap)
        self.letter = LETTERS * size * min(1.0, columns / 4)  # [pixels]
        self.line = LINE * self.letter
        most = max(8, int((width - 2.0 * self.left) / (NARROW * self.letter)))
        texts, words = [textwrap.wrap(text, most) for _, text in captions], textwrap.wrap(note, most)
        self.head, self.strip = round(2.0 * self.line), round((1.3 + max(map(len, texts))) * self.line)
        self.foot = round(foot * size + self.line * (len(words) + 0.5))
        super().__init__(width, self.head + self.rows * (size + self.gap + self.strip) + self.foot, self.letter)
        for row, (title, _) in enumerate(captions):
            top = self.corner(row, 0)[1] - self.strip
            self.text(self.left, top + 0.65 * self.line, title, 1.15, ha="left", weight="bold")
            self.text(self.left, top + 1.25 * self.line, "\n".join(texts[row]), ha="left", va="top", linespacing=1.2)
        below = self.height - 0.6 * self.gap
        self.text(self.left, below, "\n".join(words), ha="left", va="bottom", linespacing=1.2)

    def corner(self, row: int, column: int) -> tuple[int, int]:
        """Left and top of a panel [pixels]."""
        top = self.head + self.strip + row * (self.size + self.gap + self.strip)
        return self.left + column * (self.size + self.gap), top

    def show_row(self, row: int, *pictures: Array) -> None:
        """Pictures (size, size, 3 or 4) in the first columns of a row."""
        for column, pixels in enumerate(pictures):
            self.show(*self.corner(row, column), pixels)

    def head_columns(self, *headings: str) -> None:
        """The words above the columns."""
        for column, heading in enumerate(headings):
            words = textwrap.fill(heading, max(4, int(self.size / (NARROW * self.letter))))
            self.text(self.corner(0, column)[0] + 0.5 * self.size, 0.5 * self.head, words, linespacing=1.1)

    def bar(self, column: int, scale: Scale) -> None:
        """A legend of colours below a column."""
        left, top = self.corner(self.rows, column)
        where = (left + 0.08 * self.size, top - self.strip + 0.02 * self.size, 0.84 * self.size, 0.05 * self.size)
        self.draw_bar(where, scale.mappable, scale.ticks)

    def wheel(self, column: int) -> None:
        """The legend of angles: at each place around, light whose field is along the line from there to the middle."""
        side = round(0.32 * self.size)
        across = (np.arange(side) + 0.5) / side * 2.0 - 1.0
        x, y = across[None, :], -across[:, None]
        distance = np.hypot(x, y)
        swing = 2.0 * np.arctan2(x, y)  # clockwise from the upright
        stokes = np.stack([np.ones_like(swing), np.cos(swing), np.sin(swing), np.zeros_like(swing)], axis=-1)
        ring = np.clip(np.minimum(1.0 - distance, distance - 0.5) * 0.5 * side + 0.5, 0.0, 1.0)
        left, top = self.corner(self.rows, column)
        top += round(0.10 * self.size) - self.strip
        axes = self.axes(left + 0.5 * (self.size - side), top, side, side)
        axes.imshow(colour_angles(stokes, ring), interpolation="none", extent=(-1.0, 1.0, -1.0, 1.0))
        for degrees in range(0, 180, 45):
            sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
            axes.plot(0.42 * sine * ENDS, 0.42 * cosine * ENDS, color=INK, linewidth=0.08 * self.letters)
            right = left + 0.5 * (self.size - side) + (0.5 + 0.54 * sine + 0.08 * np.sign(sine)) * side
            below = top + (0.5 - 0.63 * cosine) * side
            self.text(right, below, f"{degrees}°", ha="left" if degrees else "center")
        axes.set_xlim(-1.0, 1.0), axes.set_ylim(-1.0, 1.0)
        axes.set_axis_off()


def describe_layers(content: Mapping[str, Any]) -> str:
    """What a scene file's layers are made of, in one line, from the top down."""
    words, deep = [], False
    for layer in content.get("layer", ()):
        interface = layer.get("interface")
        if isinstance(interface, Mapping):
            roughness = interface.get("roughness")
            words.append("smooth surface" if roughness is None else f"surface of roughness {roughness:g}")
            continue
        deep = float("inf") in (layer.get("thickness"), layer.get("thickness_um"))
        thick = "infinitely thick" if deep else f"{layer.get('thickness_um', 0.0):g} µm thick"
        words.append(_describe_particles(layer, content) or describe_filling(layer))
        words.append(thick if deep or "thickness" not in layer else f"optical thickness {layer['thickness']:g}")
    host = content.get("host_index")
    if host is not None and host != 1.0:
        words.append(f"in index {host:g}" if isinstance(host, int | float) else f"in {host}")
    base = content.get("base", {})
    if not deep and isinstance(base, Mapping):
        albedo = base.get("albedo")
        kind = base.get("kind", "black")
        words.append(f"on albedo {albedo:g}" if isinstance(albedo, int | float) else f"on {kind}")
    return "; ".join(words)


def _describe_particles(layer: Mapping[str, Any], content: Mapping[str, Any]) -> str:
    """Substances, sizes and fractions of a layer's particles; "" where they are named alone, or none."""
    given = layer.get("volume_fractions", layer.get("particles", {}))
    fractions = {given: 1.0} if isinstance(given, str) else given
    several = len(fractions) > 1
    found = []
    for name, fraction in fractions.items():
        source = content.get("particles", {}).get(name)
        if not isinstance(source, Mapping):
            return ""
        words = source["index"] if isinstance(source.get("index"), str) else str(name)
        sizes = dict(source) | dict(next(iter(source.get("size", {"": {}}).values())))
        key = next((key for key in sizes if key.endswith("_um") and isinstance(sizes[key], int | float)), None)
        if key is not None:
            kind = "diameter " if "diameter" in key else "" if several else "radius "
            words += f"{' ' if several else ', '}{kind}{sizes[key]:g} µm"
        number = read_fraction(fraction) if several or "volume_fractions" in layer else None
        found.append(words if number is None else f"{100.0 * number:.3g} % {words}")
    return " + ".join(found) + (" by volume" if found and "volume_fractions" in layer else "")
