"""A sheet of materials: a row each, in colour, how polarized that is, and the lobes on a scale of their own."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.formats.layers import describe_filling
from vrte.formats.toml_table import read_share
from vrte.pictures.figures import limit_ticks, require_pictures
from vrte.pictures.lobes import compute_lobe, draw_lobe, make_lobe_colours
from vrte.render.picture import Sheet, measure_degrees, put_over_grey, round_up, say_light
from vrte.render.rendering import Rendering
from vrte.render.setting import Setting

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LOBE_MU_I = np.array([0.6, 1.0])
LOBE_UM = 0.64
LOBE_MU_O = np.cos(np.radians(np.linspace(0.0, 89.0, 46)))
LOBE_PHI = np.arange(0.0, 181.0, 3.0)
HEADINGS = ("colour", "degree of linear polarization", *(f"lobe, $\\mu_i$ = {mu_i:g}" for mu_i in LOBE_MU_I))


def draw_sheet(
    renderings: Sequence[Rendering], setting: Setting, progress: Callable[[int, int, str], None] | None = None
) -> "Figure":
    """The sheet as a figure; ``progress`` is called with (rows done, rows, title)."""
    require_pictures()
    lobes = f"Lobes: {1e3 * LOBE_UM:.0f} nm, unpolarized light; the bar below is their degree of linear polarization"
    note = f"{lobes}. Pictures: {say_light(setting, renderings)}"
    drawing = Sheet(setting.size_px, len(renderings), len(HEADINGS), foot=0.20, note=note, lines=2)
    degrees = measure_degrees(renderings)
    for row, rendering in enumerate(renderings):
        (material,) = rendering.materials
        drawing.caption(row, material.title, describe_layers(material.content))
        drawing.show(row, 0, put_over_grey(rendering.rgba))
        drawing.show(row, 1, degrees.colour(rendering))
        brdf = material.brdf(LOBE_UM, LOBE_MU_I, LOBE_MU_O, LOBE_PHI)
        both = [compute_lobe(brdf, place) for place in range(LOBE_MU_I.size)]
        circle = round_up(max(float(lobe.radius.max()) for lobe in both))
        colours = make_lobe_colours(max(lobe.most_polarized for lobe in both))
        for column, lobe in enumerate(both, 2):
            lobe = replace(lobe, mirrored=lobe.mirrored.partition(",")[0])  # there is no room for how polarized
            left, top = drawing.corner(row, column)
            axes = drawing.axes(left, top, drawing.size, 0.76 * drawing.size)
            draw_lobe(axes, lobe, 1.0 / circle, colours, drawing.letters)
        left, top = drawing.corner(row, 2)
        drawing.draw_bar(
            left + 0.1 * drawing.size,
            top + 0.80 * drawing.size,
            0.9 * drawing.size,
            colours,
            limit_ticks(4),
        )
        words = f"outer circle: $f_{{00}}$ = {circle:g} sr$^{{-1}}$"
        drawing.text(left + 1.6 * drawing.size, top + 0.84 * drawing.size, words)
        if progress is not None:
            progress(row + 1, len(renderings), material.title)
    for column, heading in enumerate(HEADINGS):
        drawing.heading(column, heading)
    drawing.bar(1, degrees)
    return drawing.figure


def describe_layers(content: Mapping[str, Any]) -> str:
    """What a scene file's layers are made of, in one line, from the top down.

    >>> describe_layers({
    ...     "particles": {"gold": {"index": "gold", "radius_um": 0.6}},
    ...     "layer": [{"particles": "gold", "thickness": float("inf")}],
    ...     "base": {"kind": "black"},
    ... })
    'gold, radius 0.6 µm; infinitely thick'
    """
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
    """Substances and sizes of a layer's particles, with their shares where there are more; "" where they are named
    alone, or there are none."""
    given = layer.get("volume_fractions", layer.get("particles", {}))
    shares = {given: 1.0} if isinstance(given, str) else given
    several = len(shares) > 1
    found = []
    for name, share in shares.items():
        source = content.get("particles", {}).get(name)
        if not isinstance(source, Mapping):
            return ""
        words = source["index"] if isinstance(source.get("index"), str) else str(name)
        sizes = dict(source) | dict(next(iter(source.get("size", {"": {}}).values())))
        key = next((key for key in sizes if key.endswith("_um") and isinstance(sizes[key], int | float)), None)
        if key is not None:
            kind = "diameter " if "diameter" in key else "" if several else "radius "
            words += f"{' ' if several else ', '}{kind}{sizes[key]:g} µm"
        number = read_share(share) if several or "volume_fractions" in layer else None
        found.append(words if number is None else f"{100.0 * number:.3g} % {words}")
    return " + ".join(found) + (" by volume" if found and "volume_fractions" in layer else "")
