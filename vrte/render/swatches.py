"""Colour cards of ready materials: each over a black and a white base, as painters draw paint down, and its spectrum.

The reflectance is that of a beam close to the normal, all but what the surface mirrors; by reciprocity it is what is
seen from there under an even sky. A resin has its smooth surface to the air.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.appearance.colours import convert_to_hex, import_colour_science
from vrte.basics.arrays import Array
from vrte.calls.brdf import brdf
from vrte.calls.spectrum import material
from vrte.formats.materials import list_materials
from vrte.formats.scene_file import find_known_wavelengths
from vrte.pictures.describe import INK, Axis, Curve, Picture, PlotPanel, Swatch, Words
from vrte.pictures.figures import draw_picture
from vrte.render.sky import FEWEST, NEEDED, choose_wavelengths, make_film, weigh_wavelengths
from vrte.scene.boundary import Lambertian
from vrte.scene.interface import Interface
from vrte.scene.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MU_I = 0.99  # 8 degrees from the normal, the angle of colorimeters
NODES = 16
WHITE = 0.8  # albedo of a white card
COLUMNS = 5
WIDTH, HEIGHT = 2.6, 1.95  # inches, of one card with its words
DARK = 0.35  # luminance below which words and lines on a card are light


@dataclass(frozen=True, eq=False)
class ColourCard:
    """Over black and over white: reflectances (wavelength,), XYZ (3,) in sunlight, Y = 1 white, sRGB (3,)."""

    name: str
    title: str
    wavelengths_um: Array
    reflectances: tuple[Array, Array]
    xyz: tuple[Array, Array]
    rgb: tuple[Array, Array]


def compute_card(name: str, count: int = FEWEST, progress: Callable[[int, int], None] | None = None) -> ColourCard:
    """The card of a ready material, from ``count`` wavelengths of the visible. Raises SceneError, MissingExtraError."""
    import_colour_science(*NEEDED)
    known = list_materials()[name]
    low, high, _ = find_known_wavelengths(known.content)
    wavelengths, found = choose_wavelengths(count, low, high), np.empty((2, count))
    for index, wavelength in enumerate(wavelengths):
        layer = material(name, float(wavelength))
        host = layer.host_index or 1.0
        stack: list[Any] = [layer] if host == 1.0 else [Interface(1.0, host), layer]
        for row, base in enumerate((None, Lambertian(WHITE))):
            if row == 1 and np.isinf(layer.thickness):
                found[1, index] = found[0, index]
                continue
            found[row, index] = brdf(Scene(stack, base), mu_i=[MU_I], mu_o=[1.0], nodes=NODES).reflectance[0]
        if progress is not None:
            progress(index + 1, count)
    weighed = weigh_wavelengths(wavelengths)
    film = make_film(weighed.sum(axis=1))
    xyz = weighed @ found[0], weighed @ found[1]
    return ColourCard(name, known.title, wavelengths, (found[0], found[1]), xyz, (film(xyz[0]), film(xyz[1])))


def describe_card(card: ColourCard) -> PlotPanel:
    """The left half over black, the right half over white, and both spectra drawn across."""
    ink = "white" if card.xyz[0][1] < DARK else INK
    at = 1e3 * card.wavelengths_um
    halves = [Swatch(convert_to_hex(rgb), 0.5 * index, 0.0, 0.5, 1.0) for index, rgb in enumerate(card.rgb)]
    spectra = [
        Curve(at, values, colour=ink, dash=dash, width=1.2, opacity=0.85)
        for values, dash in zip(card.reflectances, ("-", ":"), strict=True)
    ]
    along, up = Axis("", 400.0, 700.0, ticks=(400, 500, 600, 700)), Axis("", 0.0, 1.03, ticks=(0.0, 0.5, 1.0))
    return PlotPanel([*halves, *spectra], along, up, card.title, grid=False)


def draw_cards(cards: Sequence[ColourCard]) -> "Figure":
    """The cards as one figure, above a line that says what they show."""
    panels: list[PlotPanel | None] = [describe_card(card) for card in cards]
    blank = PlotPanel([], bare=True)
    rows = [panels[first : first + COLUMNS] for first in range(0, len(panels), COLUMNS)]
    rows[-1] += [blank] * (COLUMNS - len(rows[-1]))
    note = (
        f"left over black, right over white (albedo {WHITE:g}), in sunlight; lines: reflectance over the wavelength "
        "[nm], dotted over white, at 8° and without what the surface mirrors"
    )
    picture = Picture(
        [*rows, [PlotPanel([Words(note, size=8.0)], bare=True)]],
        WIDTH * COLUMNS,
        HEIGHT * len(rows) + 0.35,
        heights=[HEIGHT] * len(rows) + [0.25],
    )
    return draw_picture(picture)
