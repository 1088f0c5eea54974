"""What a scene shows in every row of a measurement, and how that changes with its numbers."""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from vrte.appearance.apertures import Round, collect_mirrored, project_solid_angle
from vrte.appearance.geometries import NODES, PORT_DEG, Geometry, read_geometry
from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.basics.running import run_interruptible
from vrte.calls.side_by_side import run_side_by_side
from vrte.fit.families import FileFamily, make_family
from vrte.fit.light import Group, Seen, Sight, join_groups
from vrte.fit.measurement import Measurement
from vrte.fit.quantities import BEAM, DIRECTIONS, INSTRUMENT, LOOK, QUANTITIES, Shares, find_tristimulus
from vrte.methods import choose_method, make_run, solve_request
from vrte.request.request import Request
from vrte.results.solution import Solution
from vrte.results.spectrum import check_ascending
from vrte.scene.illumination import hemisphere
from vrte.scene.scene import Scene

ACCURACY = 1e-5  # of a solve, where neither nodes nor an accuracy is asked for
VISIBLE_UM = np.linspace(0.40, 0.70, 16)  # of colours, where nobody says which
OTHERS = ("brdf", "field", "render", "fit", "appearance", "axes")  # what a scene file asks of others
STEP = 1e-4  # of central differences, relative
Wavelength = float | None


@dataclass(frozen=True, eq=False)
class Reading:
    """Rows of one quantity at one wavelength, and the places of their directions or beams in its sight."""

    quantity: str
    rows: Any
    wavelength: Wavelength
    places: Any


@dataclass(frozen=True, eq=False)
class Instrument:
    """An instrument's reflectance factor at one wavelength: its geometry, and places in the sight."""

    geometry: Geometry
    beams: tuple[int, ...]
    triple: int | None


class Model:
    """A measurement's rows as a function of some numbers of a scene.

    ``source``: the scenes as they were given, ``families`` those at each wavelength; ``nodes``: of all solves, once
    they are chosen; ``solves``: how many there were; ``notes``: what is to be known of them.
    """

    def __init__(
        self,
        measurement: Measurement,
        families: Mapping[Wavelength, Any],
        options: Mapping[str, Any],
        colours_um: Array,
        jacobian: str = "differences",
        source: Any = None,
    ) -> None:
        self.measurement, self.families, self.options = measurement, dict(families), dict(options)
        self.colours_um, self.jacobian, self.solves = colours_um, jacobian, 0
        self.source = next(iter(self.families.values())) if source is None else source
        self.notes: list[str] = []
        self.nodes: int | None = self.options.get("nodes")
        self.sights: dict[Wavelength, Sight] = {}
        self.readings: list[Reading] = []
        self.instruments: list[tuple[Any, Wavelength, Instrument]] = []
        self.colours: list[tuple[str, int, list[tuple[Wavelength, Instrument]], tuple[str, int]]] = []
        for row in range(len(measurement)):
            self._add_row(row)
        self._join_readings()
        self.groups = {one: sight.group() for one, sight in self.sights.items()}

    @property
    def names(self) -> tuple[str, ...]:
        """The numbers that change."""
        return tuple(next(iter(self.families.values())).names)

    @property
    def start(self) -> Array:
        """Their values in the scene as it is given."""
        return np.array(self.source.values, float)

    @property
    def slopes_come_along(self) -> bool:
        """Whether derivatives are found with the values, for not much more."""
        return self.jacobian == "exact"

    def _add_row(self, row: int) -> None:
        """What a row asks for."""
        given = self.measurement
        name = given.quantity[row]
        known, at = QUANTITIES[name], given.wavelength_um[row]
        if known.needs == LOOK:
            geometry = read_geometry(given.geometry[row])
            seen = [(one, self._place_instrument(one, geometry)) for one in self.colours_um.tolist()]
            self.colours.append((name, row, seen, (given.illuminant[row], int(given.observer[row]))))
            return
        wavelength = None if math.isnan(at) else float(at)
        if known.needs == INSTRUMENT:
            made = self._place_instrument(wavelength, read_geometry(given.geometry[row]))
            self.instruments.append((row, wavelength, made))
            return
        sight = self.sights.setdefault(wavelength, Sight())
        mu_i = find_cosine(given.theta_i_deg[row])
        if known.needs == BEAM:
            place = sight.add_beam(mu_i, known.through)
        else:
            theta_o, phi = given.theta_o_deg[row], given.phi_deg[row]
            place = sight.add_triple(known.through, mu_i, find_cosine(theta_o), phi + 180.0 * bool(theta_o < 0.0))
        self.readings.append(Reading(name, row, wavelength, place))

    def _place_instrument(self, wavelength: Wavelength, geometry: Geometry) -> Instrument:
        """The directions of an instrument, added to the sight of a wavelength."""
        sight = self.sights.setdefault(wavelength, Sight())
        mu_i, mu_o, phi = geometry.directions
        if geometry.angle_o is not None:
            return Instrument(geometry, (), sight.add_triple(False, float(mu_i[0]), float(mu_o[0]), float(phi[0])))
        beams = tuple(sight.add_beam(float(mu), False) for mu in mu_i)
        triple = sight.add_triple(False, float(mu_i[0]), float(mu_i[0]), 0.0) if geometry.excluded else None
        return Instrument(geometry, beams, triple)

    def _join_readings(self) -> None:
        """Rows of one quantity at one wavelength are read together."""
        joined: dict[tuple[str, Wavelength], list[Reading]] = {}
        for one in self.readings:
            joined.setdefault((one.quantity, one.wavelength), []).append(one)
        self.readings = [
            Reading(name, np.array([one.rows for one in some]), wavelength, np.array([one.places for one in some]))
            for (name, wavelength), some in joined.items()
        ]

    def predict(self, values: Array) -> Array:
        """What the scene with these numbers shows, (rows,). Raises SceneError."""
        return self._read(self._solve(values, derivatives=False), values)[0]

    def linearize(self, values: Array) -> tuple[Array, Array]:
        """The same, and its derivatives (rows, n). Raises SceneError."""
        found = [self.predict(values)]
        for place in range(values.size):
            found.append(self._differentiate(values, place))
        return found[0], np.array(found[1:]).reshape(values.size, -1).T

    def _differentiate(self, values: Array, place: int) -> Array:
        """Central differences by one number (rows,), of one side where the scene does not have the other."""
        step = STEP * (abs(values[place]) or 1.0)
        sides, heights = [], []
        for sign in (1.0, -1.0):
            there = values.copy()
            there[place] += sign * step
            try:
                heights.append(self.predict(there))
                sides.append(there[place])
            except SceneError:
                continue
        if not sides:
            raise SceneError(f"{self.names[place]} cannot be changed from {values[place]:g} by {step:g} either way")
        if len(sides) == 1:
            heights.append(self.predict(values))
            sides.append(values[place])
        return (heights[0] - heights[1]) / (sides[0] - sides[1])

    def settle_nodes(self, values: Array) -> None:
        """Chooses how many nodes all solves take, by the first, a middle and the last wavelength at these numbers."""
        if self.nodes is not None or not self.sights:
            return
        self.nodes = self.find_nodes(values)

    def find_nodes(self, values: Array) -> int | None:
        """The most nodes that the accuracy takes; None for a method that has none."""
        order = sorted(self.sights, key=lambda one: one or 0.0)
        looked_at = {order[0], order[len(order) // 2], order[-1]}
        found = self._solve(values, False, None, looked_at)
        most = max((int(one.diagnostics.get("nodes", 0)) for _, some in found.items() for _, one, _ in some), default=0)
        return most or None

    def _solve(
        self, values: Array, derivatives: bool, nodes: int | None = -1, only: Any = None
    ) -> dict[Wavelength, list[tuple[Request, Solution, list[Solution]]]]:
        """All solves at these numbers, side by side where there are several."""
        nodes = self.nodes if nodes == -1 else nodes
        options = {"accuracy": ACCURACY} | {key: one for key, one in self.options.items() if key != "nodes"}
        if nodes is not None:
            options = {key: one for key, one in options.items() if key != "accuracy"} | {"nodes": nodes}
        places = [(one, group) for one in self.sights if only is None or one in only for group in self.groups[one]]
        alone = len(places) == 1
        scenes: dict[Wavelength, Scene] = {}

        def make(wavelength: Wavelength) -> None:
            try:
                scenes[wavelength] = self.families[wavelength].at(values)
            except SceneError as error:
                raise error.behind(f"at {wavelength:g} um") if wavelength else error from error

        run_side_by_side([partial(make, one) for one in dict(places)])

        def solve(wavelength: Wavelength, group: Group) -> tuple[Request, Solution, list[Solution]]:
            try:
                request = choose_method(group.ask(scenes[wavelength], options | ({} if alone else {"threads": 1})))
                run = make_run(request)
                run.told = True
                if alone:
                    return request, run_interruptible(run, lambda: solve_request(request, run))[1], []
                return request, solve_request(request, run)[1], []
            except SceneError as error:
                raise error.behind(f"at {wavelength:g} um") if wavelength else error from error

        self.solves += len(places)
        if alone:
            return {places[0][0]: [solve(*places[0])]}
        found: dict[Wavelength, list[Any]] = {}
        for (one, _), made in zip(places, run_side_by_side([partial(solve, *one) for one in places]), strict=True):
            found.setdefault(one, []).append(made)
        return found

    def _read(self, solved: Mapping[Wavelength, Any], values: Array) -> Array:
        """Jets of all rows (1 + n, rows)."""
        seen = {one: self._see(one, some) for one, some in solved.items()}
        scenes = {one: some[0][0].scene for one, some in solved.items()}
        first = next(iter(seen.values())).matrices.shape[0]
        out = np.zeros((first, len(self.measurement)))
        for one in self.readings:
            known, light = QUANTITIES[one.quantity], seen[one.wavelength]
            what = (
                light.matrices[:, one.places]
                if known.needs == DIRECTIONS
                else Shares(*(part[:, one.places] for part in light.shares))
            )
            out[:, one.rows] = known.read(what)
        for row, wavelength, made in self.instruments:
            out[:, row] = read_instrument(made, seen[wavelength], scenes[wavelength])
        for name, row, parts, conditions in self.colours:
            spectrum = np.stack([read_instrument(made, seen[at], scenes[at]) for at, made in parts], axis=1)
            out[:, row] = QUANTITIES[name].read(*find_tristimulus(self.colours_um, spectrum, *conditions))
        return out

    def _see(self, wavelength: Wavelength, solved: Sequence[tuple[Request, Solution, list[Solution]]]) -> Seen:
        """What a wavelength's solves found, as jets."""
        found = []
        for group, (request, value, slopes) in zip(self.groups[wavelength], solved, strict=True):
            parts = [group.read(request, one) for one in (value, *slopes)]
            matrices, up, down = (np.stack([part[k] for part in parts]) for k in range(3))
            mirrored, passed = (part[None] for part in group.follow_beams(request.scene))
            found.append((matrices, Shares(up, down, mirrored, passed)))
        return join_groups(self.sights[wavelength], self.groups[wavelength], found)


def find_cosine(theta_deg: float) -> float:
    """Of an angle from the normal on either side; the same for the same angle, and what `vrte.appearance` takes."""
    return math.cos(math.radians(abs(theta_deg)))


def read_instrument(made: Instrument, seen: Seen, scene: Scene) -> Array:
    """An instrument's reflectance factor (1 + n,), as vrte/appearance/geometries.py defines it."""
    geometry, shares = made.geometry, seen.shares
    if geometry.angle_o is not None:
        return np.pi * seen.matrices[:, made.triple, 0, 0]
    beams = list(made.beams)
    total = shares.reflected[:, beams] + shares.mirrored[:, beams]
    if geometry.angle_i is None:
        mu, weights = hemisphere(NODES)
        return 2.0 * total @ (weights * mu)
    if not geometry.excluded:
        return total[:, 0]
    port, mu_i = Round(PORT_DEG), find_cosine(geometry.angle_i)
    angle = project_solid_angle(port, geometry.angle_i)
    inside = seen.matrices[:, made.triple, 0, 0].copy()
    reflected = shares.reflected[:, beams[0]].copy()
    surface = scene.interfaces[0]
    if surface is not None and not surface.is_smooth:
        inside[0] -= float(surface.facets.reflect(*np.array([[mu_i], [mu_i], [0.0]]))[0, 0, 0])
        reflected[0] -= collect_mirrored(surface, mu_i, port)
    return (reflected - inside * angle) / (1.0 - angle / np.pi)


def make_model(
    measurement: Measurement,
    scene: Any,
    names: Sequence[str],
    nodes: int | None = None,
    accuracy: float | None = None,
    wavelengths_um: Any = None,
    folder: str | os.PathLike[str] = ".",
    threads: int | None = None,
    jacobian: str = "differences",
) -> Model:
    """The model of a measurement by a scene, of which numbers with these names change. Raises SceneError, OSError."""
    if not isinstance(measurement, Measurement):
        raise SceneError.of("measurement", f"must be a vrte.Measurement, not {type(measurement).__name__}")
    at = {None if math.isnan(one) else float(one) for one in measurement.wavelength_um.tolist()}
    coloured = any(QUANTITIES[name].needs == LOOK for name in measurement.names)
    colours_um = check_ascending(VISIBLE_UM if wavelengths_um is None else wavelengths_um)
    if wavelengths_um is not None and not coloured:
        raise SceneError.of("wavelengths_um", "are of colours, and none was measured")
    only_colours = all(QUANTITIES[name].needs == LOOK for name in measurement.names)
    at = ({*colours_um.tolist()} if coloured else set()) | (set() if only_colours else at)
    asked = {name: one for name, one in (("nodes", nodes), ("accuracy", accuracy), ("threads", threads)) if one}
    if isinstance(scene, Scene) and at != {None}:
        wave = next(one for one in at if one is not None)
        raise SceneError(
            f"the measurement is at {wave:g} um, and a vrte.Scene knows no wavelength: give a scene file or its content"
        )
    family = make_family(scene, names, folder)
    if not isinstance(family, FileFamily):
        return Model(measurement, {None: family}, asked, colours_um, jacobian)
    content = {key: one for key, one in family.content.items() if key not in OTHERS}
    content["brdf"] = {"mu_i": 1.0, "mu_o": 1.0}
    families = {
        one: FileFamily(content if one is None else {**content, "wavelength_um": one}, names, family.folder)
        for one in at
    }
    first = families[next(iter(at))]
    options = dict(first.file_at(first.values).options) | asked
    if "nodes" in asked:
        options.pop("accuracy", None)
    return Model(measurement, families, options, colours_um, jacobian, family)
