"""The GPU paper's figure 10: a row a material, with its lobes for two incident directions and its sphere."""

import os
from collections.abc import Callable, Sequence
from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np

from vrte.formats.atomic import write_atomically
from vrte.pictures.figures import require_pictures
from vrte.pictures.lobes import compute_lobe, draw_lobe, make_lobe_colours
from vrte.render.picture import DPI, Sheet, put_over_grey, say_light
from vrte.render.rendering import Sphere
from vrte.render.setting import Setting

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LOBE_MU_I = np.array([0.6, 1.0])
LOBE_UM = 0.64
LOBE_MU_O = np.cos(np.radians(np.linspace(0.0, 89.0, 46)))
LOBE_PHI = np.arange(0.0, 181.0, 3.0)
CIRCLE = 0.5  # sr-1: what the outer circle below a lobe stands for at scale 1
TALLEST = 4  # rows, before a sheet has two materials beside each other
HEADINGS = (*(f"lobe, {1e3 * LOBE_UM:.0f} nm, $\\mu_i$ = {mu_i:g}" for mu_i in LOBE_MU_I), "sphere under sun and sky")
COLUMNS = len(HEADINGS)
STEPS = (1.0, 2.0, 5.0)


def save(
    spheres: Sequence[Sphere],
    setting: Setting,
    path: str | os.PathLike[str],
    progress: Callable[[int, int, str], None] | None = None,
) -> None:
    """Writes the sheet as a PNG, all of it or nothing. Raises SceneError, MissingExtraError, OSError."""
    from PIL import Image

    drawn = BytesIO()
    draw_sheet(spheres, setting, progress).savefig(drawn, format="png", dpi=DPI)
    with write_atomically(path) as part, Image.open(drawn) as image:
        image.convert("RGB").save(part, format="PNG", optimize=True)


def draw_sheet(
    spheres: Sequence[Sphere], setting: Setting, progress: Callable[[int, int, str], None] | None = None
) -> "Figure":
    """The sheet as a figure; ``progress`` is called with (rows done, rows, title)."""
    require_pictures()
    blocks = 2 if len(spheres) > TALLEST else 1
    circles = f"Lobes: unpolarized light, outer circles $f_{{00}}$ = {CIRCLE:g} sr$^{{-1}}$ at scale 1"
    note = f"{circles}. Spheres: {say_light(setting, spheres)}"
    drawing = Sheet(setting.size_px, -(-len(spheres) // blocks), COLUMNS * blocks, foot=0.30, note=note)
    lobes = [
        [
            compute_lobe(sphere.material.brdf(LOBE_UM, LOBE_MU_I, LOBE_MU_O, LOBE_PHI), place)
            for place in range(LOBE_MU_I.size)
        ]
        for sphere in spheres
    ]
    most = max(lobe.most_polarized for both in lobes for lobe in both)
    colours = make_lobe_colours(most)
    for place, (sphere, both) in enumerate(zip(spheres, lobes, strict=True)):
        row, block = divmod(place, blocks)
        left, top = drawing.corner(row, COLUMNS * block)
        drawing.text(left + 0.03 * drawing.size, top + 0.03 * drawing.size, sphere.material.title, 1.25, ha="left")
        for column, lobe in enumerate(both, COLUMNS * block):
            factor = scale(float(lobe.radius.max()) / CIRCLE)
            left, top = drawing.corner(row, column)
            axes = drawing.axes(left, top - 0.04 * drawing.size, drawing.size, drawing.size)
            draw_lobe(axes, lobe, factor / CIRCLE, colours)
            drawing.text(left + 0.5 * drawing.size, top + 0.94 * drawing.size, f"scale {factor:g}")
        drawing.show(row, COLUMNS * block + LOBE_MU_I.size, put_over_grey(sphere.rgba))
        if progress is not None:
            progress(place + 1, len(spheres), sphere.material.title)
    for block in range(blocks):
        for column, heading in enumerate(HEADINGS):
            drawing.heading(COLUMNS * block + column, heading)
    drawing.bar(0, colours.cmap, 0.0, most, "lobes: degree of linear polarization")
    return drawing.figure


def scale(largest: float) -> float:
    """1, 2 or 5 times a power of ten: the largest by which a lobe still stays within 1.

    >>> scale(0.09), scale(1.0), scale(3.1)
    (10.0, 1.0, 0.2)
    """
    if largest <= 0.0:
        return 1.0
    power = 10.0 ** np.floor(-np.log10(largest))
    return float(f"{max(step for step in STEPS if step * power * largest <= 1.0 + 1e-9) * power:.6g}")
