"""Layers and interfaces of a scene file: tables [[layer]], top first, all checked before anything is computed."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.formats.bases import ALBEDO, INTERFACE
from vrte.formats.keys import Choice, Fraction, Key, Medium, Number, Reading, Substance, find_given_as, read_keys
from vrte.formats.materials import MATERIAL
from vrte.formats.particle_sources import HOST, Kinds
from vrte.formats.phases import Phase
from vrte.formats.toml_table import Table, locate_errors, shorten_text, show_key, suggest_nearest
from vrte.optics.crowding import INDEPENDENT, PACKINGS
from vrte.optics.particles import mixture
from vrte.scene.interface import Interface
from vrte.scene.layer import Layer, is_fraction_needed
from vrte.scene.scene import MOST_LAYERS

FILLINGS = ("particles", "volume_fractions", "phase")  # what a layer holds, in one of these ways; or nothing
THICKNESS_KEYS = ("thickness", "thickness_um", "volume_fraction")
CLEAR = 1e-6  # k of a medium up to which it counts as clear: what is reflected there notices no more of it
PART = 'from 0 to below 1, or per cent in quotes, "5 %"'
OPTICAL = Number(allowed="an optical thickness >= 0 (inf is allowed)")
LENGTH = Number(allowed="a length in micrometres >= 0")
SIDES: dict[str, Key] = {side: Medium(argument=f"index_{side}", hint="") for side in ("above", "below")}
INTERFACE_KEYS = (*SIDES, *INTERFACE)


@dataclass(frozen=True)
class Fractions(Key):
    """Kinds of particles with their fractions, by name: of their number, or of the layer's volume."""

    by_volume: bool = field(kw_only=True)

    def read(self, table: Table, name: str, reading: Reading) -> dict[str, float]:
        kinds = reading.file.content.get("particles", {})
        value, word = table.content[name], "fraction" if self.by_volume else "number fraction"
        one = isinstance(value, str) and not self.by_volume
        if not one and (not isinstance(value, dict) or not value):
            words = "" if self.by_volume else "a name, or "
            raise table.wrong(name, f"must be {words}a table {{ name = {word}, ... }}")
        for kind in [value] if one else value:
            if kind not in kinds:
                defined = shorten_text(", ".join(map(show_key, kinds)) or "none", 200)
                hint = suggest_nearest(kind, kinds) or "."
                raise table.wrong(name, f"no table [particles.{show_key(kind)}]{hint} Defined: {defined}")
        if one:
            return {value: 1.0}
        below = table.table(name, tuple(kinds))
        fractions = {kind: below.fraction(kind, self.allowed) for kind in value}
        for kind, fraction in fractions.items():
            if not 0.0 <= fraction < (1.0 if self.by_volume else math.inf):
                raise below.wrong(kind, f"must be {self.allowed}")
        if not any(fractions.values()):
            raise table.wrong(name, f"at least one {word} must be above 0")
        if self.by_volume and math.fsum(fractions.values()) >= 1.0:
            raise table.wrong(name, "their sum must be below 1, the whole layer")
        return fractions


class Surface(Key):
    """An interface between two media, which may be rough."""

    inside = SIDES

    def read(self, table: Table, name: str, reading: Reading) -> Interface:
        table = table.table(name, INTERFACE_KEYS)
        values = read_keys(SIDES | INTERFACE, table, reading)
        for side, key in SIDES.items():
            index = values[key.argument]
            if index.imag > CLEAR and table.content[side] not in list_counted_media(reading.file.content):
                words = "absorbs, which no layer counts: give the layer there the same host_index, or n"
                raise table.wrong(side, words)
            values[key.argument] = index.real
        with locate_errors(table.place, INTERFACE_KEYS, given_as=find_given_as(SIDES, table)):
            return Interface(**values)


FILLED: dict[str, Key] = {
    "thickness": Number(allowed="a number >= 0", needed=False),
    "thickness_um": Number(allowed="a number >= 0", needed=False),
    "volume_fraction": Fraction(allowed=PART, needed=False),
    "packing": Choice(names={name: one.words for name, one in PACKINGS.items()}, needed=False),
    **HOST,
}
LAYERS: dict[str, tuple[dict[str, Key], str]] = {  # by a key that says what a layer is: all its keys, why no others
    "interface": (
        {"interface": Surface()},
        "an interface has a [[layer]] of its own; what scatters stands in the next",
    ),
    "particles": (
        {"particles": Fractions(allowed="a number fraction >= 0", by_volume=False), **FILLED},
        "goes with phase only; particles bring their own",
    ),
    "volume_fractions": (
        {"volume_fractions": Fractions(allowed=PART, by_volume=True), **FILLED},
        "goes with phase only; particles bring their own",
    ),
    "phase": (
        {
            "albedo": Fraction(allowed=ALBEDO),
            "thickness": OPTICAL,
            "tolerance": Number(needed=False),
            "host_index": Medium(needed=False),
            "phase": Phase(),
        },
        "needs particles; with phase, give the optical thickness",
    ),
    "host_index": (
        {"host_index": Substance(), "thickness_um": LENGTH},
        f"goes with {', '.join(FILLINGS[:-1])} or {FILLINGS[-1]}; a non-scattering layer has none",
    ),
}
LAYER: dict[str, Key] = MATERIAL | {name: key for keys, _ in LAYERS.values() for name, key in keys.items()}
LAYER_KEYS = tuple(LAYER)


def describe_filling(layer: Mapping[str, Any]) -> str:
    """What a layer of a scene file holds, such as "gold + rutile" or "henyey_greenstein 0.9"."""
    held: Any = next((layer[key] for key in FILLINGS if key in layer), "clear")
    if "phase" not in layer:
        return show_key(held) if isinstance(held, str) else " + ".join(map(show_key, held))
    return str(held) if isinstance(held, str) else " ".join(f"{key} {value}" for key, value in held.items())


def list_counted_media(content: Mapping[str, Any]) -> list[Any]:
    """The media of a file whose absorption its layers count: of particles, and of layers without a phase matrix."""
    kinds = content.get("particles", {})
    tables = [*kinds.values(), *(layer for layer in content.get("layer", ()) if "phase" not in layer)]
    tables += [content] if kinds else []
    return [table["host_index"] for table in tables if "host_index" in table]


def read_layers(reading: Reading) -> list[tuple[Table, str, dict[str, Any]]]:
    """The tables [[layer]] with what they are, by `LAYERS`, and the values of their keys; there need be none above a
    base. Raises SceneError."""
    file = reading.file
    if "layer" not in file and "base" in file:
        return []
    layers = file.required("layer", "at least one table [[layer]], top first")
    if not isinstance(layers, list) or not layers or not all(isinstance(layer, dict) for layer in layers):
        raise file.wrong("layer", "must be tables headed [[layer]], top first")
    if len(layers) > MOST_LAYERS:
        raise SceneError(f"layer: there must be at most {MOST_LAYERS} of them, not {len(layers)}", "layer")
    return [read_layer(Table(("layer", index), layer, LAYER_KEYS), reading) for index, layer in enumerate(layers)]


def read_layer(layer: Table, reading: Reading) -> tuple[Table, str, dict[str, Any]]:
    """The table of a layer, what it is, one of `LAYERS`, and the values of its keys. Raises SceneError."""
    kind = next((one for one in LAYERS if one in layer), "")
    if kind not in ("interface", "host_index"):
        layer.exactly_one(*FILLINGS)
    keys, reason = LAYERS[kind]
    for key in layer.content:
        if key not in keys:
            raise layer.wrong(key, reason)
    by_volume, fraction = kind == "volume_fractions", "volume_fraction" in layer
    if by_volume and fraction:
        raise layer.wrong("volume_fraction", "is the sum of volume_fractions; leave it out")
    if kind in FILLINGS[:2]:
        lengths = [key for key in THICKNESS_KEYS[:2] if key in layer]
        if len(lengths) != 1 or (lengths == ["thickness_um"] and not by_volume and not fraction):
            alone = "" if by_volume else " with volume_fraction"
            raise layer.unfit(f"either thickness (optical) or thickness_um{alone} is needed")
    return layer, kind, read_keys(keys, layer, reading)


class FilledLayer(NamedTuple):
    """A layer of particles: its place in the file; its kinds, in the order they are made; ``amounts``: how much of
    each, by number or ``by_volume``, the part of the volume that they fill (0 where it does not matter), and how thick
    it is, optically or, ``is_length``, in micrometres; and how it is packed."""

    place: int
    kinds: list[int]
    amounts: Array
    by_volume: bool
    is_length: bool
    packing: str


def make_layer(
    layer: Table, kind: str, values: dict[str, Any], kinds: Kinds, filled: list[FilledLayer]
) -> Layer | Interface:
    """The layer or the interface of a table that was read; one of particles is added to those that are ``filled``.
    Raises SceneError."""
    if kind == "interface":
        return values["interface"]
    host: Any = values.get("host_index")
    if kind in FILLINGS[:2]:
        fractions, by_volume = [*values[kind].values()], kind == "volume_fractions"
        how = {key: values[key] for key in THICKNESS_KEYS if key in values}
        packing = values.get("packing", INDEPENDENT)
        numbers, parts = zip(*(kinds.find(name, layer) for name in values[kind]), strict=True)
        filling, is_length = sum(fractions) if by_volume else how.get("volume_fraction", 0.0), "thickness_um" in how
        amounts = np.array([*fractions, filling, how["thickness_um" if is_length else "thickness"]])
        filled.append(FilledLayer(int(layer.place[1]), [*numbers], amounts, by_volume, is_length, packing))
        if by_volume:  # how many of them make such a part of the volume
            fractions = [fraction / part.volume_um3 for part, fraction in zip(parts, fractions, strict=True)]
        with locate_errors(layer.place, LAYER_KEYS):
            held = mixture([*zip(parts, fractions, strict=True)]) if len(parts) > 1 else parts[0]
            if by_volume and (is_length or is_fraction_needed(held, packing)):
                how["volume_fraction"] = math.fsum(values[kind].values())
            return Layer.of(held, **how, packing=packing)
    if kind == "phase" and host is not None and host.imag > CLEAR:
        raise layer.wrong("host_index", "absorbs; with phase, count that in albedo and thickness, and give n")
    wavelength = kinds.reading.wavelength if kind == "host_index" else 0.0
    with locate_errors(layer.place, LAYER_KEYS):
        if kind == "host_index":
            return Layer.clear(values["thickness_um"], host, wavelength)
        return Layer(values["phase"], values["albedo"], values["thickness"], None if host is None else host.real)
