"""A sweep: the content of a scene file, and axes along which some of its numbers change.

    [axes]
    wavelength_um = { start = 0.43, stop = 0.70, count = 55 }              # the name is the key
    radius = { key = "particles.gold.radius_um", values = [0.1, 0.2] }     # or a name of its own
    depth = { key = "layer[1].thickness", start = 0.1, stop = 100, count = 4, spacing = "log" }

Axes span a grid. Axes with the same ``along = "NAME"`` go together, value by value: a list of scenes.
"""

import copy
import hashlib
import json
import math
import os
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from vrte.appearance.panel import make_panel
from vrte.basics.arrays import Array, put_in_one_line
from vrte.basics.errors import Place, SceneError
from vrte.formats.contents import WAVELENGTH
from vrte.formats.materials import expand_paint
from vrte.formats.particle_sources import Compute
from vrte.formats.scene_file import SceneFile, find_named_tables, make_scene_file, read_content
from vrte.formats.scene_numbers import SceneNumber, find_places, find_scene_number, share_places
from vrte.formats.toml_table import RANGE_KEYS, Table, convert_to_plain_content, is_number, show_place, show_toml
from vrte.optics.particles import Particles, find_host_index
from vrte.optics.phase_matrix import isotropic
from vrte.sweep.results import RESERVED, TABLE, AskedAppearance, Results, Sample, describe_results, read_asked

AXIS_KEYS = ("key", "values", *RANGE_KEYS, "spacing", "along")
MOST_AXES = 16
MOST_SCENES = 10**9
CHECKED = 1000  # values of an axis that are looked at before anything is computed
SURFACES = ("mirror",)  # kinds of bases that mirror
FIXED = ("brdf", "field", TABLE, "axes")  # the same for all scenes of a table
VALUES = "a list of numbers, or { start, stop, count }"


@dataclass(frozen=True, eq=False)
class SweepAxis:
    """A ``number`` of the scene along a ``dimension``: ``key`` its dotted path, ``values`` (n,)."""

    name: str
    key: str
    number: SceneNumber
    values: Array
    dimension: str

    @property
    def attributes(self) -> dict[str, str]:
        """Unit and name in the table."""
        if self.key == "wavelength_um":
            return WAVELENGTH.attributes
        return {"units": "um" if self.key.endswith("_um") else "1", "long_name": self.key}


@dataclass(frozen=True, eq=False)
class Sweep:
    """A template, the content of a scene file or with a table [appearance], in ``folder``, and its axes."""

    template: dict[str, Any]
    axes: tuple[SweepAxis, ...]
    folder: Path

    @property
    def kind(self) -> str:
        """What is computed of each scene: "brdf", or "field" or "appearance" where the file has that table."""
        if TABLE in self.template:
            return TABLE
        return "field" if "field" in self.template and "brdf" not in self.template else "brdf"

    @cached_property
    def asked(self) -> AskedAppearance:
        """What is read off each panel of a sweep of appearances. Raises SceneError."""
        return read_asked(self.template, self.folder)

    @property
    def wavelengths(self) -> int:
        """At how many wavelengths each scene is solved."""
        return self.asked.wavelengths_um.size if self.kind == TABLE else 1

    @property
    def dimensions(self) -> dict[str, int]:
        """Names and lengths, in the order of the axes."""
        return {axis.dimension: axis.values.size for axis in self.axes}

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(self.dimensions.values())

    @property
    def count(self) -> int:
        """How many scenes there are."""
        return math.prod(self.shape)

    def content(self, place: tuple[int, ...]) -> dict[str, Any]:
        """The scene file's content at a place of the grid."""
        found = copy.deepcopy(self.template)
        where = dict(zip(self.dimensions, place, strict=True))
        for axis in self.axes:
            axis.number.put(found, axis.values[where[axis.dimension]])
        return found

    def fingerprint(self) -> str:
        """A checksum of all that sets the results: template, axes, tables of coefficients, and the version of vrte."""
        from vrte import __version__

        content = json.dumps([__version__, self.described(), self.tables()], sort_keys=True, default=str)
        return hashlib.sha256(content.encode()).hexdigest()

    def described(self) -> dict[str, Any]:
        """Template and axes as JSON can hold them."""
        axes = {a.name: {"key": a.key, "values": a.values.tolist(), "along": a.dimension} for a in self.axes}
        return {**self.template, "axes": axes}

    def tables(self) -> dict[str, str]:
        """The tables of their own that layers and particles name, and what is in them."""
        names = sorted(set(find_named_tables(self.template).values()))
        return {name: hashlib.sha256((self.folder / name).read_bytes()).hexdigest() for name in names}


def read_sweep(source: str | os.PathLike[str] | Mapping[str, Any], folder: Path | None = None) -> Sweep:
    """A sweep file, or its content, read and checked; nothing is computed. Raises SceneError, OSError."""
    if isinstance(source, Mapping):
        content = convert_to_plain_content(source)
    else:
        content, folder = read_content(source), folder or Path(source).parent
    table = content.pop("axes", None)
    if not isinstance(table, dict) or not table:
        raise SceneError("axes is missing: a sweep needs a table [axes] with at least one axis")
    if len(table) > MOST_AXES:
        raise SceneError(f"axes: there must be at most {MOST_AXES} of them, not {len(table)}")
    template = expand_paint(content)
    axes = tuple(read_axis(content, template, name, value) for name, value in table.items())
    sweep = Sweep(template, axes, (folder or Path()).absolute())
    check(sweep)
    return sweep


def read_axis(content: dict[str, Any], template: dict[str, Any], name: str, value: Any) -> SweepAxis:
    """One entry of [axes], of a paint's number as an axis of what it stands for. Raises SceneError."""
    table = Table(("axes", name), value if isinstance(value, dict) else {"values": value}, AXIS_KEYS)
    key, dimension = table.content.get("key", name), table.content.get("along", name)
    for word, given in (("key", key), ("along", dimension)):
        if not isinstance(given, str) or not given:
            raise table.wrong(word, "must be a name")
    try:
        places = find_places(template, key, content)
        if places[0][0] in FIXED:
            raise SceneError(f"{show_toml(key)} is the same for all scenes of a table")
        key = show_place(places[0], None) if "paint" in content and len(places) == 1 else key
        number = find_scene_number(template, key, places, default=0.0)  # which may be put there
    except SceneError as error:
        raise SceneError(f"axes.{put_in_one_line(name)}: {error}", *table.place) from error
    return SweepAxis(name, key, number, read_values(table), dimension)


def read_values(table: Table) -> Array:
    """The values of an axis: a list, or a range in equal steps or equal ratios."""
    if ("values" in table) == any(key in table for key in RANGE_KEYS):
        raise table.unfit("needs either values or start, stop and count")
    if "values" in table:
        given = table.content["values"]
        if not isinstance(given, list) or not given or not all(is_number(item) and item == item for item in given):
            raise table.wrong("values", f"must be {VALUES}")
        if "spacing" in table:
            raise table.wrong("spacing", "goes with start, stop and count")
        return np.array(given, np.float64)
    steps = {key: table.required(key, "a number") for key in RANGE_KEYS}
    name = str(table.place[-1])
    found = np.array(Table(("axes",), {name: steps}, (name,)).numbers(name))
    if "spacing" not in table or table.choice("spacing", ("linear", "log")) == "linear":
        return found
    if min(found[0], found[-1]) <= 0.0:
        raise table.wrong("spacing", "needs start and stop above 0")
    return np.geomspace(found[0], found[-1], found.size)


def check(sweep: Sweep) -> None:
    """Checks a sweep before anything is computed. Raises SceneError."""
    check_dimensions(sweep)
    for axis in sweep.axes:
        if sweep.kind == TABLE and axis.number.places == (("wavelength_um",),):
            words = f"an appearance is of all wavelengths of {TABLE}.wavelengths_um together"
            raise SceneError(f"axes.{axis.name}: {words}")
    if share_places([axis.number for axis in sweep.axes]):
        raise SceneError("axes: two of them change the same number")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # each scene warns of it
        results = describe_sweep_results(sweep)
        for name in (*results.coordinates, *results.variables):
            if any(name in (axis.name, axis.dimension) for axis in sweep.axes):
                raise SceneError(f"axes.{name}: this name is taken by the table itself")
        for axis in sweep.axes:
            check_values(sweep, axis)


def check_dimensions(sweep: Sweep) -> None:
    """Names that do not clash, lengths that agree, and not too many scenes."""
    for axis in sweep.axes:
        for name in (axis.name, axis.dimension):
            if name in RESERVED:
                raise SceneError(f"axes.{name}: this name is taken by the table itself")
        if {"/", "\\"} & {*axis.name, *axis.dimension} or axis.name.startswith(".") or axis.dimension.startswith("."):
            words = "cannot be the name of a coordinate: no /, no \\ and no leading dot"
            raise SceneError(f"axes: {show_toml(axis.name)} {words}")
        length = sweep.dimensions[axis.dimension]
        if axis.values.size != length:
            raise SceneError(f"axes: those along {show_toml(axis.dimension)} must have the same number of values")
    if sweep.count > MOST_SCENES:
        raise SceneError(f"axes: {sweep.count} scenes are too many, at most {MOST_SCENES} are allowed")


def check_values(sweep: Sweep, axis: SweepAxis) -> None:
    """Whether the values of an axis are allowed in the first scene, as far as its form goes."""
    dimension = list(sweep.dimensions).index(axis.dimension)
    n = axis.values.size
    looked_at = np.unique(np.linspace(0, n - 1, min(n, CHECKED)).astype(int))
    ends = [int(np.argmin(axis.values)), int(np.argmax(axis.values))]
    for value in sorted({*looked_at.tolist(), *ends}):
        place = [0] * len(sweep.shape)
        place[dimension] = value
        try:
            make_scene_at(sweep, tuple(place), make_unseen_particles, at_one=True)
        except SceneError as error:
            raise error.behind(f"axes.{axis.name}, value {value + 1}") from error


def list_roughnesses(sweep: Sweep, with_base: bool = True) -> set[float]:
    """Roughnesses of all refracting or mirroring surfaces of its scenes, with the base or not: 0 is smooth."""
    layers, base = sweep.template["layer"], sweep.template.get("base", {})
    surfaces: dict[Place, Any] = {("layer", k, "interface"): one for k, one in enumerate(layers)}
    tables = {place: one["interface"] for place, one in surfaces.items() if "interface" in one}
    tables |= {("base",): base} if with_base and base.get("kind") in SURFACES else {}
    moved = [(place, axis.values) for axis in sweep.axes for place in axis.number.places]
    changed = {place[:-1]: values for place, values in moved if place[-1] == "roughness"}
    values = [changed.get(place, [table.get("roughness", 0.0)]) for place, table in tables.items()]
    return {float(value) for some in values for value in some}


def make_unseen_particles(source: str, given: dict[str, Any]) -> Particles:
    """What stands for particles while only the form of a file is looked at, and which media fit together."""
    host = find_host_index(given.get("host_index", 1.0), given["wavelength_um"])
    return Particles(isotropic(), 1.0, 0.0, 1.0, 1.0, 1.0, host_index=host.n, stands_in=True)


def make_scene_at(sweep: Sweep, place: tuple[int, ...], compute: Compute, at_one: bool = False) -> SceneFile | Sample:
    """The scene at a place of the grid; an appearance, on request, ``at_one`` wavelength alone. Raises SceneError."""
    content = sweep.content(place)
    if sweep.kind != TABLE:
        return make_scene_file(content, sweep.kind, sweep.folder, compute)
    asked = sweep.asked.at_one if at_one else sweep.asked
    alone = {key: value for key, value in content.items() if key not in (TABLE, "wavelength_um")}
    return Sample(make_panel(alone, asked.wavelengths_um, sweep.folder, layer=asked.layer, compute=compute), asked)


def describe_sweep_results(sweep: Sweep) -> Results:
    """What each of its scenes brings."""
    first = make_scene_at(sweep, (0,) * len(sweep.shape), make_unseen_particles, at_one=True)
    if isinstance(first, Sample):
        return sweep.asked.describe()
    return describe_results(first, list_roughnesses(sweep), any(list_roughnesses(sweep, with_base=False)))


def list_particle_places(sweep: Sweep) -> Iterator[tuple[str, tuple[int, ...], int]]:
    """Each kind of particle that scenes share, at one scene for each different one, and wavelength indices."""
    for name, lengths in list_shared_particles(sweep):
        yield from ((name, place, which) for place in np.ndindex(*lengths) for which in range(sweep.wavelengths))


def list_shared_particles(sweep: Sweep) -> Iterator[tuple[str, tuple[int, ...]]]:
    """Names of particles that several scenes share, and how many different ones there are along each dimension."""
    for name in sweep.template.get("particles", {}):
        moved_by = {
            axis.dimension
            for axis in sweep.axes
            for place in axis.number.places
            if place in (("wavelength_um",), ("host_index",))
            or place[:2] == ("particles", name)
            or (place[0] == "layer" and place[-1] == "host_index")
        }
        lengths = tuple(length if name in moved_by else 1 for name, length in sweep.dimensions.items())
        if math.prod(lengths) < sweep.count:
            yield name, lengths
