"""A recipe for a target: the numbers of the form's paint that meet a colour, a contrast ratio and a gloss."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vrte.app.form.content import Content
from vrte.app.solving.appearance import Shade
from vrte.app.solving.tab_session import collect_bytes
from vrte.app.solving.worker import Exchange, Message, Progress
from vrte.appearance.colours import find_colour
from vrte.basics.arguments import check_arguments
from vrte.basics.arrays import Array
from vrte.basics.errors import LongSolveWarning, MissingExtraError, SceneError
from vrte.fit.match import match
from vrte.fit.measurement import Measurement
from vrte.fit.target import CARDS, GLOSSES
from vrte.formats.toml_table import write_toml

LEFT_OUT = ("accuracy", "brdf", "field", "method", "nodes", "render", "settings", "wavelength_um")  # of the form
LIGHTEST_BLACK, DARKEST_WHITE = 0.1, 0.6  # albedos of cards between which a contrast ratio is read


@dataclass(frozen=True, eq=False)
class Matched(Message):
    """What a match found: ``content`` as it began, keys and values (n,), lines on it, tables with their heads, shades
    by what they are, sentences of notes, and files to download by their names."""

    content: Content
    names: tuple[str, ...]
    values: Array
    lines: tuple[str, ...]
    tables: tuple[list[list[str]], ...]
    shades: dict[str, Shade]
    notes: tuple[str, ...]
    files: dict[str, bytes]


def match_scene(exchange: Exchange, content: Content, folder: Path, asked: dict[str, Any]) -> Matched:
    """A match of the form's paint with keywords of `vrte.match`. Raises SceneError, KeyboardInterrupt."""
    begun = {key: value for key, value in content.items() if key not in LEFT_OUT}

    def progress(done: int, total: int) -> None:
        fraction = done / max(total, 1)
        exchange.report(Progress(fraction, f"paints are read, {100.0 * fraction:.0f} %"))

    exchange.report(Progress(0.0, "the paint as it is"))
    found = check_arguments(match)(begun, folder=folder, progress=progress, **asked)
    files = {"target.toml": write_toml({**asked, "paint": begun}).encode()}
    files["recipe.toml"] = write_toml(dict(found.content)).encode()
    for name in ("recipe.csv", "recipe.html"):
        try:
            files[name] = collect_bytes(name, found.save)
        except MissingExtraError:  # matplotlib, of the page
            continue
    shades = {name: Shade.of(colour) for name, colour in found.colours.items()}
    notes = exchange.notes(LongSolveWarning, before=found.notes)
    lines, tables = tuple(found.describe()), tuple(found.list_tables())
    return Matched(content, tuple(found.names), np.array(found.values), lines, tables, shades, notes, files)


def read_target(measured: Measurement) -> dict[str, Any]:
    """Keywords of `vrte.match` that a measurement tells: the colour over its darkest base with geometry and light, the
    contrast ratio between a black and a white one, gloss. Raises SceneError for none."""
    asked: dict[str, Any] = {}
    for name in GLOSSES:
        if name in measured.names:
            asked[name] = float(np.mean(measured.value[measured.quantity == name]))
    rows = np.flatnonzero(np.isin(measured.quantity.astype(str), ("L", "a", "b", "reflectance")))
    labs: dict[float, tuple[float, ...]] = {}
    for base in np.unique(measured.base[rows]).tolist() if rows.size else ():
        own = measured.pick(rows[np.isclose(measured.base[rows], base, equal_nan=True)])
        if lab := read_lab(own):
            labs[base] = lab
            asked["geometry"] = str(own.geometry[0])
            if "L" in own.names:
                asked |= {"illuminant": str(own.illuminant[0]), "observer": int(own.observer[0])}
    if labs:
        darkest, lightest = min(labs), max(labs)
        asked["lab"] = [round(one, 4) for one in labs[darkest]]
        if np.isfinite(darkest):
            asked["over"] = next((name for name, albedo in CARDS.items() if albedo == darkest), darkest)
        if darkest <= LIGHTEST_BLACK and lightest >= DARKEST_WHITE:
            luminance, other = (((labs[base][0] + 16.0) / 116.0) ** 3 for base in (darkest, lightest))
            asked["contrast_ratio"] = round(luminance / other, 5)
    if not asked:
        raise SceneError("the measurement has neither a colour, as L, a, b or a spectrum of reflectance, nor a gloss")
    return asked


def read_lab(measured: Measurement) -> tuple[float, ...]:
    """L*, a*, b* of rows over one base, in D65 for 10 degrees where they are a spectrum; () where they are neither."""
    if {*"Lab"} <= {*measured.names}:
        return tuple(float(np.mean(measured.value[measured.quantity == name])) for name in "Lab")
    own = measured.pick(measured.quantity == "reflectance") if "reflectance" in measured.names else None
    if own is None:
        return ()
    at, where = np.unique(own.wavelength_um, return_inverse=True)
    colour = find_colour(at, np.bincount(where, own.value) / np.bincount(where))
    return colour.L, colour.a, colour.b
