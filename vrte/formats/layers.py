"""Layers and interfaces of a scene file: tables [[layer]], top first, all checked before anything is computed."""

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from vrte.basics.errors import SceneError
from vrte.formats.bases import ALBEDO, INTERFACE
from vrte.formats.keys import Reading, read_keys
from vrte.formats.media import CLEAR, ONE_WAVELENGTH, TABLE, check_material, find_index, read_material
from vrte.formats.particle_sources import Compute, Make, prepare_particles
from vrte.formats.phases import read_phase
from vrte.formats.toml_table import Table, locate_errors, shorten_text, show_key, suggest_nearest
from vrte.optics.crowding import INDEPENDENT, PACKINGS
from vrte.optics.particle_kind import find_host_index
from vrte.optics.particles import Particles, mixture
from vrte.scene.interface import Interface
from vrte.scene.layer import Layer, is_fraction_needed
from vrte.scene.scene import MOST_LAYERS

FILLINGS = ("particles", "volume_fractions", "phase")  # what a layer holds, in one of these ways; or nothing
THICKNESS_KEYS = ("thickness", "thickness_um", "volume_fraction")
LAYER_KEYS = ("material", *FILLINGS, "tolerance", "albedo", *THICKNESS_KEYS, "packing", "host_index", "interface")
INTERFACE_KEYS = ("above", "below", *INTERFACE)
SHARE = "a number fraction >= 0"
PART = 'from 0 to below 1, or per cent in quotes, "5 %"'


def describe_filling(layer: Mapping[str, Any]) -> str:
    """What a layer of a scene file holds.

    >>> say = describe_filling
    >>> say({"particles": {"gold": 1, "rutile": 2}}), say({"phase": {"henyey_greenstein": 0.9}})
    ('gold + rutile', 'henyey_greenstein 0.9')
    """
    held: Any = next((layer[key] for key in FILLINGS if key in layer), "clear")
    if "phase" not in layer:
        return show_key(held) if isinstance(held, str) else " + ".join(map(show_key, held))
    return str(held) if isinstance(held, str) else " ".join(f"{key} {value}" for key, value in held.items())


class Kinds:
    """The particles of a file by name: all are checked at once, each is computed when a layer first asks for it."""

    def __init__(self, compute: Compute, reading: Reading) -> None:
        content = reading.file.content.get("particles", {})
        if not isinstance(content, dict) or not all(isinstance(kind, dict) for kind in content.values()):
            raise reading.file.wrong("particles", "must be tables headed [particles.NAME]")
        self.makers: dict[str, Make] = {
            name: prepare_particles(name, kind, compute, reading) for name, kind in content.items()
        }
        self.computed: dict[str, Particles] = {}
        self.in_hosts: dict[tuple[str, str], Particles] = {}

    def find(self, name: str, layer: Table) -> Particles:
        """Particles of a name in the medium of a layer."""
        place = (name, repr(layer.content.get("host_index")))
        if place not in self.in_hosts:
            self.in_hosts[place] = self.makers[name](layer)
            self.computed.setdefault(name, self.in_hosts[place])
        return self.in_hosts[place]


def read_layer_tables(file: Table) -> list[Table]:
    """The tables [[layer]], their keys checked; there need be none above a base. Raises SceneError."""
    if "layer" not in file and "base" in file:
        return []
    layers = file.required("layer", "at least one table [[layer]], top first")
    if not isinstance(layers, list) or not layers or not all(isinstance(layer, dict) for layer in layers):
        raise file.wrong("layer", "must be tables headed [[layer]], top first")
    if len(layers) > MOST_LAYERS:
        raise SceneError(f"layer: there must be at most {MOST_LAYERS} of them, not {len(layers)}", "layer")
    return [Table(("layer", place), layer, LAYER_KEYS) for place, layer in enumerate(layers)]


def prepare_layer(layer: Table, kinds: Kinds, reading: Reading) -> Callable[[], Layer | Interface]:
    """What makes a layer or an interface, all its keys checked, nothing computed."""
    if "interface" in layer:
        return prepare_interface(layer, reading)
    if "host_index" in layer:
        check_material(layer, "host_index")
        if not any(key in layer for key in FILLINGS):
            return prepare_clear_layer(layer, reading)
    layer.exactly_one(*FILLINGS)
    if "tolerance" in layer and not str(layer.content.get("phase")).endswith(TABLE):
        raise layer.wrong("tolerance", "goes with a phase from a .csv only: how far below zero it may be")
    return prepare_phase(layer, reading) if "phase" in layer else prepare_filling(layer, kinds)


def prepare_clear_layer(layer: Table, reading: Reading) -> Callable[[], Layer]:
    """What makes a layer of its medium alone, clear or tinted."""
    for key in layer.content:
        if key not in ("host_index", "thickness_um"):
            raise layer.wrong(key, f"goes with {', '.join(FILLINGS[:-1])} or {FILLINGS[-1]}; a clear layer has none")
    length = layer.number("thickness_um", "a length in micrometres >= 0")

    def made() -> Layer:
        wavelength = reading.file.number("wavelength_um", ONE_WAVELENGTH)
        host = read_material(layer, "host_index", reading.folder)
        with locate_errors(layer.place, LAYER_KEYS):
            return Layer.clear(length, host, wavelength)

    return made


def prepare_phase(layer: Table, reading: Reading) -> Callable[[], Layer]:
    """What makes a layer of a phase matrix, an albedo and an optical thickness."""
    albedo = layer.share("albedo", ALBEDO)
    for key in (*THICKNESS_KEYS[1:], "packing"):
        if key in layer:
            raise layer.wrong(key, "needs particles; with phase, give the optical thickness")
    thickness = layer.number("thickness", "an optical thickness >= 0 (inf is allowed)")

    def made() -> Layer:
        matrix = read_phase(layer, reading)
        host = None
        if "host_index" in layer:
            host = find_medium(layer, "host_index", reading)
            if host.imag > CLEAR:
                raise layer.wrong("host_index", "absorbs; with phase, count that in albedo and thickness, and give n")
        with locate_errors(layer.place, LAYER_KEYS):
            return Layer(matrix, albedo, thickness, None if host is None else host.real)

    return made


class FillingKeys(NamedTuple):
    """What a layer of particles says of itself: how much of each kind, by number or ``by_volume``; how thick it is and
    how densely filled, as keywords of `Layer.of`; and how it is packed."""

    shares: dict[str, float]
    by_volume: bool
    how: dict[str, Any]
    packing: str


def read_filling(layer: Table, kinds: Mapping[str, Any]) -> FillingKeys:
    """Of a layer with particles or volume_fractions. Raises SceneError."""
    if "albedo" in layer:
        raise layer.wrong("albedo", "goes with phase only; particles bring their own")
    key = "volume_fractions" if "volume_fractions" in layer else "particles"
    shares, how = read_fractions(layer, key, kinds), read_lengths(layer)
    packing = layer.choice("packing", tuple(PACKINGS)) if "packing" in layer else INDEPENDENT
    return FillingKeys(shares, key == "volume_fractions", how, packing)


def prepare_filling(layer: Table, kinds: Kinds) -> Callable[[], Layer]:
    """What makes a layer of particles."""
    shares, by_volume, how, packing = read_filling(layer, kinds.makers)

    def made() -> Layer:
        parts = [(kinds.find(name, layer), share) for name, share in shares.items()]
        if by_volume:  # how many of them make such a part of the volume
            parts = [(kind, share / kind.volume_um3) for kind, share in parts]
        with locate_errors(layer.place, LAYER_KEYS):
            held = mixture(parts) if len(parts) > 1 else parts[0][0]
            if by_volume and ("thickness_um" in how or is_fraction_needed(held, packing)):
                how["volume_fraction"] = math.fsum(shares.values())
            return Layer.of(held, **how, packing=packing)

    return made


def prepare_interface(layer: Table, reading: Reading) -> Callable[[], Interface]:
    """What makes an interface, which stands alone in its table."""
    for key in layer.content:
        if key != "interface":
            raise layer.wrong(key, "an interface has a [[layer]] of its own; what scatters stands in the next")
    table = layer.table("interface", INTERFACE_KEYS)
    for key in INTERFACE_KEYS[:2]:
        check_material(table, key)
    facets = read_keys(INTERFACE, table, reading)

    def made() -> Interface:
        indices = {key: find_medium(table, key, reading) for key in INTERFACE_KEYS[:2]}
        for key, index in indices.items():
            if index.imag > CLEAR and table.content[key] not in list_counted_media(reading.file.content):
                raise table.wrong(key, "absorbs, which no layer counts: give the layer there the same host_index, or n")
        above, below = (index.real for index in indices.values())
        said: dict[str, tuple[str, str | None]] = {f"index_{key}": (key, None) for key in INTERFACE_KEYS[:2]}
        with locate_errors(table.place, INTERFACE_KEYS, said=said):
            return Interface(above, below, **facets)

    return made


def list_counted_media(content: Mapping[str, Any]) -> list[Any]:
    """The media of a file whose absorption its layers count: of particles, and of layers without a phase matrix.

    >>> list_counted_media({"layer": [{"host_index": "water", "thickness_um": 9.0}, {"phase": "rayleigh"}]})
    ['water']
    """
    kinds = content.get("particles", {})
    tables = [*kinds.values(), *(layer for layer in content.get("layer", ()) if "phase" not in layer)]
    tables += [content] if kinds else []
    return [table["host_index"] for table in tables if "host_index" in table]


def find_medium(table: Table, key: str, reading: Reading) -> complex:
    """n + ik of a medium that light goes through, at a key. Raises SceneError where it absorbs too much."""
    index = find_index(reading.file, table, key, reading.folder)
    with locate_errors(table.place, table.allowed, said={"host_index": (key, None)}):
        return find_host_index(index, 1.0).value  # a number, whatever the wavelength


def read_lengths(layer: Table) -> dict[str, Any]:
    """How thick a layer of particles is, and how densely they lie."""
    optical, geometrical, by_volume = "thickness" in layer, "thickness_um" in layer, "volume_fractions" in layer
    if by_volume and "volume_fraction" in layer:
        raise layer.wrong("volume_fraction", "is the sum of volume_fractions; leave it out")
    if optical == geometrical or (geometrical and not by_volume and "volume_fraction" not in layer):
        alone = "" if by_volume else " with volume_fraction"
        raise layer.unfit(f"either thickness (optical) or thickness_um{alone} is needed")
    found: dict[str, Any] = {key: layer.number(key, "a number >= 0") for key in THICKNESS_KEYS[:2] if key in layer}
    return found | {key: layer.share(key, PART) for key in THICKNESS_KEYS[2:] if key in layer}


def read_fractions(layer: Table, key: str, kinds: Mapping[str, Any]) -> dict[str, float]:
    """The kinds of particles in a layer, with their fractions: of the number, or of the layer's volume."""
    by_volume = key == "volume_fractions"
    allowed, word = (PART, "fraction") if by_volume else (SHARE, "number fraction")
    value = layer.content[key]
    if isinstance(value, str) and not by_volume:
        check_known(layer, key, value, kinds)
        return {value: 1.0}
    if not isinstance(value, dict) or not value:
        raise layer.wrong(key, f"must be {'' if by_volume else 'a name, or '}a table {{ name = {word}, ... }}")
    for name in value:
        check_known(layer, key, name, kinds)
    fractions = layer.table(key, tuple(kinds))
    shares = {name: fractions.share(name, allowed) for name in value}
    for name, share in shares.items():
        if not 0.0 <= share < (1.0 if by_volume else math.inf):
            raise fractions.wrong(name, f"must be {allowed}")
    if not any(shares.values()):
        raise layer.wrong(key, f"at least one {word} must be above 0")
    if by_volume and math.fsum(shares.values()) >= 1.0:
        raise layer.wrong(key, "their sum must be below 1, the whole layer")
    return shares


def check_known(layer: Table, key: str, name: str, kinds: Mapping[str, Any]) -> None:
    """Whether a layer holds a kind that is there. Raises SceneError."""
    if name not in kinds:
        defined = shorten_text(", ".join(map(show_key, kinds)) or "none", 200)
        hint = suggest_nearest(name, kinds) or "."
        raise layer.wrong(key, f"no table [particles.{show_key(name)}]{hint} Defined: {defined}")
