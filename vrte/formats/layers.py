"""Layers and interfaces of a scene file, tables [[layer]], top first, all checked before anything is computed; and
their phase functions by name: a new one is a function and a row in `PHASES`."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.formats.bases import ALBEDO, INTERFACE
from vrte.formats.columns import read_coefficients
from vrte.formats.flakes import FlakeTable, make_flakes
from vrte.formats.keys import (
    TABLE,
    Choice,
    FilePath,
    Flag,
    Fraction,
    Key,
    Medium,
    Number,
    Reading,
    Row,
    Substance,
    Whole,
    find_given_as,
    join_rows,
    read_beside,
    read_keys,
)
from vrte.formats.materials import MATERIAL
from vrte.formats.particle_sources import HOST, Kinds
from vrte.formats.scattering import CSV, NETCDF_SUFFIXES, read_scattering
from vrte.formats.toml_table import Table, locate_errors, shorten_text, show_key, suggest_nearest
from vrte.optics import phase_matrix as optics
from vrte.optics.angle_tables import EXTRAPOLATE
from vrte.optics.conventions import CONVENTIONS
from vrte.optics.crowding import INDEPENDENT, PACKINGS
from vrte.optics.particles import mixture
from vrte.optics.phase_matrix import MOST_TERMS, PhaseMatrix
from vrte.scene.interface import Interface
from vrte.scene.layer import Layer, is_fraction_needed
from vrte.scene.scene import MOST_LAYERS

AngleFile = tuple[Path, float | None, tuple[int, int]]  # the scene's wavelength [um], and when and how it was changed


class AngleTable(FilePath):
    """A file of scattering matrices over angle, and the scene's wavelength where the file is for several."""

    def read(self, table: Table, name: str, reading: Reading) -> AngleFile:
        path: Path = super().read(table, name, reading)
        about = read_beside(table, name, Path.stat, reading.folder)
        wavelength = None if path.suffix.lower() == CSV else reading.wavelength
        return path, wavelength, (about.st_mtime_ns, about.st_size)


def read_angles(table: AngleFile, **options: Any) -> PhaseMatrix:
    """The phase matrix of an `AngleTable`, with the options of `vrte.read_scattering`."""
    found = read_scattering(table[0], wavelength_um=table[1], **options)
    assert isinstance(found, PhaseMatrix)  # no density is given
    return found


# a row is written phase = { name = value, ... }, or phase = "name" where no key is needed
PHASES: dict[str, Row] = {
    "isotropic": Row("isotropic scatterers", optics.isotropic, {}),
    "rayleigh": Row(
        "Rayleigh scatterers",
        lambda rayleigh=0.0: optics.rayleigh(rayleigh),
        {"rayleigh": Number("depolarization", 0.0, needed=False)},
    ),
    "henyey_greenstein": Row(
        "Henyey-Greenstein scatterers",
        lambda henyey_greenstein, terms=None: optics.henyey_greenstein(henyey_greenstein, terms),
        {
            "henyey_greenstein": Number("asymmetry g", 0.8),
            "terms": Whole("terms", needed=False, limits=(1, MOST_TERMS)),
        },
    ),
    "table": Row(
        "a scattering matrix over angle",
        read_angles,
        {
            "table": AngleTable("file", suffixes=(CSV, *NETCDF_SUFFIXES)),
            "convention": Choice(
                "written as",
                names={name: about.words for name, about in CONVENTIONS.items()},
                empty="as the file's kind has it",
                needed=False,
            ),
            "normalise": Flag("divide by its integral", needed=False),
            "spheres": Flag("of spheres", needed=False),
            "ends": Choice("ends that are left out", names={EXTRAPOLATE: "extrapolate"}, empty="refuse", needed=False),
            "accuracy": Number("error of the expansion", empty="5e-5, or rounding", needed=False),
            "tolerance": Number("negative eigenvalues up to", empty="0", needed=False),
            "effective_radius_um": Number("effective radius [µm]", hint="of NetCDF with several", needed=False),
            "humidity_percent": Number("humidity [%]", hint="of NetCDF with several", needed=False),
        },
    ),
}


@lru_cache(maxsize=16)
def make_once(name: str, layer: tuple[str | int, ...], values: tuple[tuple[str, Any], ...]) -> PhaseMatrix:
    """The phase matrix of a row and its values, kept for each ``layer``: a shared one would change the sums."""
    return PHASES[name].make(**dict(values))


class Phase(FilePath):
    """The phase matrix of a layer: a row of `PHASES`, or a table of coefficients."""

    @property
    def inside(self) -> dict[str, Key]:
        return join_rows(PHASES)

    def read(self, table: Table, name: str, reading: Reading) -> PhaseMatrix:
        value = table.content[name]
        if isinstance(value, str) and value.endswith(TABLE):
            tolerance = table.number("tolerance") if "tolerance" in table else 0.0
            return read_beside(table, name, partial(read_coefficients, tolerance=tolerance), reading.folder)
        if "tolerance" in table:
            raise table.wrong("tolerance", "goes with a phase from a .csv only: how far below zero it may be")
        inner = Table((*table.place, name), {}, ())
        bare = [own for own, row in PHASES.items() if not any(key.needed for key in row.keys.values())]
        found = [own for own in bare if own == value]
        if isinstance(value, dict):
            inner = table.table(name, tuple(self.inside))
            found = [own for own in PHASES if own in inner and {*value} <= {*PHASES[own].keys}]
        if len(found) != 1:
            tables = [f"{{ {own} = {row.keys[own].label} }}" for own, row in PHASES.items() if row.keys]
            words = ", ".join([*(f'"{own}"' for own in bare), *tables])
            words += " or the path of a .csv with the columns l, a1, a2, a3, a4, b1, b2"
            raise table.wrong(name, f"must be {words}{suggest_nearest(value, PHASES)}")
        values = read_keys(PHASES[found[0]].keys, inner, reading)
        with locate_errors((*inner.place, found[0])):
            return make_once(found[0], table.place, tuple(values.items()))


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


AREA = Number(allowed="an area of flakes over that of the layer, >= 0 (inf is allowed)", needed=False)
FLAKES: dict[str, Key] = {"flakes": FlakeTable(needed=False), "flake_area": AREA}  # beside what else a layer holds
FILLED: dict[str, Key] = {
    "thickness": Number(allowed="a number >= 0", needed=False),
    "thickness_um": Number(allowed="a number >= 0", needed=False),
    "volume_fraction": Fraction(allowed=PART, needed=False),
    "packing": Choice(names={name: one.words for name, one in PACKINGS.items()}, needed=False),
    **FLAKES,
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
            **FLAKES,
        },
        "needs particles; with phase, give the optical thickness",
    ),
    "flakes": (
        {
            "flakes": FlakeTable(),
            "flake_area": AREA,
            "flake_thickness_um": Number(allowed="a length in micrometres > 0", needed=False),
            "thickness_um": Number(allowed="a number >= 0", needed=False),
            "volume_fraction": Fraction(allowed=PART, needed=False),
            **HOST,
        },
        "is that of particles; flakes alone have flake_area, or volume_fraction, flake_thickness_um and thickness_um",
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
    held: Any = next((layer[key] for key in FILLINGS if key in layer), "flakes" if "flakes" in layer else "clear")
    if "phase" not in layer:
        return show_key(held) if isinstance(held, str) else " + ".join(map(show_key, held))
    return str(held) if isinstance(held, str) else " ".join(f"{key} {value}" for key, value in held.items())


def list_counted_media(content: Mapping[str, Any]) -> list[Any]:
    """The media of a file whose absorption its layers count: of particles, and of layers without a phase matrix."""
    kinds = content.get("particles", {})
    tables = [*kinds.values(), *(layer for layer in content.get("layer", ()) if "phase" not in layer)]
    tables += [content] if kinds or any("flakes" in layer for layer in tables) else []
    return [table["host_index"] for table in tables if "host_index" in table]


def read_layers(reading: Reading) -> list[tuple[Table, str, dict[str, Any]]]:
    """The tables [[layer]], if any: which of `LAYERS` each is, and the values of its keys. Raises SceneError."""
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
    if kind not in ("interface", "flakes", "host_index"):
        layer.exactly_one(*FILLINGS)
        if ("flakes" in layer) != ("flake_area" in layer):
            raise layer.unfit("flakes beside something else need both of flakes and flake_area")
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
    """A layer of particles: place, kinds, ``amounts`` (of each kind, the volume filled, the thickness), packing."""

    place: int
    kinds: list[int]
    amounts: Array
    by_volume: bool
    is_length: bool
    packing: str


def make_layer(
    layer: Table, kind: str, values: dict[str, Any], kinds: Kinds, filled: list[FilledLayer]
) -> Layer | Interface:
    """The layer or interface of a table; one of particles is added to ``filled``. Raises SceneError."""
    if kind == "interface":
        return values["interface"]
    given = values.pop("flakes", None)
    if kind == "flakes":
        host = values.pop("host_index", read_keys(HOST, kinds.reading.file, kinds.reading).get("host_index", 1.0))
        alone = make_flakes(given, host, layer)
        with locate_errors(layer.place, LAYER_KEYS):
            return Layer.of(alone, **values)
    found = fill_layer(layer, kind, values, kinds, filled)
    if given is None:
        return found
    oriented = make_flakes(given, 1.0 if found.host_index is None else found.host_index, layer)
    with locate_errors(layer.place, LAYER_KEYS):
        return replace(found, flakes=oriented, flake_area=values["flake_area"])


def fill_layer(layer: Table, kind: str, values: dict[str, Any], kinds: Kinds, filled: list[FilledLayer]) -> Layer:
    """The layer of a table without its flakes; one of particles is added to ``filled``. Raises SceneError."""
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
