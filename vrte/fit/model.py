"""What a scene shows in every row of a measurement, and how that changes with its numbers."""

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from vrte.appearance.apertures import Round, collect_mirrored, project_solid_angle
from vrte.appearance.colours import find_colour
from vrte.appearance.geometries import NODES, PORT_DEG, Geometry, read_geometry
from vrte.appearance.panel import choose_wavelengths
from vrte.basics.arrays import Array
from vrte.basics.differences import STEP, sample_around
from vrte.basics.errors import SceneError
from vrte.basics.running import run_interruptible
from vrte.calls.derivatives import read_derivatives, solve_with_derivatives
from vrte.calls.side_by_side import run_side_by_side
from vrte.fit.light import Group, Seen, Sight, join_groups, make_scene_jet
from vrte.fit.measurement import Measurement
from vrte.fit.quantities import BEAM, DIRECTIONS, INSTRUMENT, LOOK, QUANTITIES, Shares, find_tristimulus
from vrte.formats.scene_family import SceneFamily
from vrte.formats.scene_file import OPTION_KEYS, REQUESTS, read_content
from vrte.methods import choose_method, make_run
from vrte.request.how import EXACT
from vrte.request.request import Request
from vrte.results.solution import Solution
from vrte.results.spectrum import check_ascending
from vrte.scene.illumination import hemisphere
from vrte.scene.scene import Scene
from vrte.scene.variation import Variation
from vrte.scene.vary import turn_variation

ACCURACY = 1e-5  # of a solve, where neither nodes nor an accuracy is asked for
Wavelength = float | None
Solved = tuple[Request, Solution, list[Solution], list[Variation]]  # with derivatives, one a variation


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
        families: Mapping[Wavelength, SceneFamily],
        options: Mapping[str, Any],
        colours_um: Array,
        jacobian: str = "exact",
        source: SceneFamily | None = None,
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
        for light in dict.fromkeys(conditions for *_, conditions in self.colours):
            words = find_colour(colours_um, np.ones(colours_um.size), *light).extrapolation
            if words:
                self.notes.append(f"colours in {light[0]} take reflectance beyond the known wavelengths: {words}")

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
        """Whether derivatives are found with the values, in one solve."""
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
        return self._find_jets(values, with_slopes=False)[0]

    def linearize(self, values: Array) -> tuple[Array, Array]:
        """The same, and its derivatives (rows, n). Raises SceneError."""
        if self.jacobian == "exact":
            jets = self._find_jets(values, with_slopes=True)
            return jets[0], jets[1:].T
        return self.predict(values), np.stack([self._differentiate(values, k) for k in range(values.size)], axis=1)

    def _differentiate(self, values: Array, place: int) -> Array:
        """Differences of the model by one number (rows,), of five points."""

        def predict_at(value: float) -> Array:
            there = values.copy()
            there[place] = value
            return self.predict(there)

        step = STEP * (abs(values[place]) or 1.0)
        return np.sum([weight * found for weight, found in sample_around(predict_at, values[place], step)], axis=0)

    def converge_on_nodes(self, values: Array) -> None:
        """Chooses how many nodes all solves take, by the first, a middle and the last wavelength at these numbers."""
        if self.nodes is None:
            self.nodes = self.find_nodes(values)

    def find_nodes(self, values: Array) -> int | None:
        """The most nodes that the accuracy takes; None for a method that has none."""
        order = sorted(self.sights, key=lambda one: one or 0.0)
        looked_at = [*dict.fromkeys((order[0], order[len(order) // 2], order[-1]))]
        options = {key: one for key, one in self.options.items() if key != "nodes"}
        plain = {"grading": 1} if options.get("method", EXACT) == EXACT else {}  # the nodes are kept by their number
        found = self._solve(values, looked_at, {"accuracy": ACCURACY} | options | plain, False)
        most = max(int(one.diagnostics.get("nodes", 0)) for some in found.values() for _, one, *_ in some)
        return most or None

    def _find_jets(self, values: Array, with_slopes: bool) -> Array:
        """Jets of all rows (1 + n, rows)."""
        options = {key: one for key, one in self.options.items() if key != "accuracy" or self.nodes is None}
        options |= {"accuracy": ACCURACY, **options} if self.nodes is None else {"nodes": self.nodes}
        return self._read(self._solve(values, [*self.sights], options, with_slopes))

    def _solve(
        self, values: Array, wavelengths: Sequence[Wavelength], options: dict[str, Any], with_slopes: bool
    ) -> dict[Wavelength, list[Solved]]:
        """The solves of some wavelengths at these numbers, side by side where there are several."""
        places = [(one, group) for one in wavelengths for group in self.groups[one]]
        alone = len(places) == 1
        how = options if alone else options | {"threads": 1}

        def make(wavelength: Wavelength) -> tuple[Scene, list[Variation]]:
            family = self.families[wavelength]
            with name_wavelength(wavelength):
                scene = family.at(values)
                return scene, read_derivatives(scene, family.variations(values)) if with_slopes else []

        def solve(wavelength: Wavelength, group: Group) -> Solved:
            scene, variations = scenes[wavelength]
            with name_wavelength(wavelength):
                request = choose_method(group.ask(scene, how))
                run = make_run(request)
                run.runtime_warned = True

                def work() -> Any:
                    return solve_with_derivatives(request, variations, run)

                _, solution, found = run_interruptible(run, work) if alone else work()
            return request, solution, [one.solution for one in found], variations

        self.solves += len(places)
        scenes = dict(zip(wavelengths, run_side_by_side([partial(make, one) for one in wavelengths]), strict=True))
        tasks = [partial(solve, *one) for one in places]
        solved = [tasks[0]()] if alone else run_side_by_side(tasks)
        found: dict[Wavelength, list[Solved]] = {}
        for (one, _), made in zip(places, solved, strict=True):
            found.setdefault(one, []).append(made)
        return found

    def _read(self, solved: Mapping[Wavelength, list[Solved]]) -> Array:
        """Jets of all rows (1 + n, rows)."""
        seen = {one: self._see(one, some) for one, some in solved.items()}
        out = np.zeros((next(iter(seen.values())).matrices.shape[0], len(self.measurement)))
        for one in self.readings:
            known, light = QUANTITIES[one.quantity], seen[one.wavelength]
            if known.needs == DIRECTIONS:
                out[:, one.rows] = known.read(light.matrices[:, one.places])
            else:
                out[:, one.rows] = known.read(Shares(*(part[:, one.places] for part in light.shares)))
        for row, wavelength, made in self.instruments:
            out[:, row] = read_instrument(made, seen[wavelength])
        for name, row, parts, conditions in self.colours:
            spectrum = np.stack([read_instrument(made, seen[at]) for at, made in parts], axis=1)
            out[:, row] = QUANTITIES[name].read(*find_tristimulus(self.colours_um, spectrum, *conditions))
        return out

    def _see(self, wavelength: Wavelength, solved: Sequence[Solved]) -> Seen:
        """What a wavelength's solves found, as jets."""
        found = []
        turn = turn_variation if solved[0][0].illuminate == "bottom" else lambda one: one
        variations = [turn(one) for one in solved[0][3]]
        for group, (request, value, slopes, _) in zip(self.groups[wavelength], solved, strict=True):
            parts = [group.read(request, one) for one in (value, *slopes)]
            matrices, up, down = (np.stack([part[k] for part in parts]) for k in range(3))
            beams = group.make_beam_jets(request.scene, variations)
            found.append((matrices, Shares(up, down, beams[:, 0], beams[:, 1])))
        return join_groups(self.sights[wavelength], self.groups[wavelength], found, solved[0][0].scene, variations)


def find_cosine(theta_deg: float) -> float:
    """Of an angle from the normal on either side; the same for the same angle, and what `vrte.appearance` takes."""
    return math.cos(math.radians(abs(theta_deg)))


def read_instrument(made: Instrument, seen: Seen) -> Array:
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

    def find_surface(scene: Scene) -> Array:
        """What a rough surface sends back itself: there (1/sr), and through the port."""
        surface = scene.interfaces[0]
        if surface is None or surface.is_smooth:
            return np.zeros(2)
        there = surface.facets.reflect(*np.array([[mu_i], [mu_i], [0.0]]))[0, 0, 0]
        return np.array([float(there), collect_mirrored(surface, mu_i, port)])

    own = make_scene_jet(find_surface, seen.scene, seen.variations, mu_i)
    inside = seen.matrices[:, made.triple, 0, 0] - own[:, 0]
    return (shares.reflected[:, beams[0]] - own[:, 1] - inside * angle) / (1.0 - angle / np.pi)


def make_family(source: Any, names: Sequence[str], folder: str | os.PathLike[str]) -> SceneFamily:
    """The scenes by their free numbers, which all have a value. Raises SceneError that says what is free."""
    try:
        family = SceneFamily(source, names, Path(folder))
        assert family.values.size == len(names)
        return family
    except SceneError as error:
        words = str(error).removeprefix("derivatives: ")
        raise SceneError(words if words.startswith("free") else f"free: {words}", "free", *error.place) from error


@contextmanager
def name_wavelength(wavelength: Wavelength) -> Iterator[None]:
    """Puts a wavelength in front of complaints."""
    try:
        yield
    except SceneError as error:
        if wavelength is None:
            raise
        raise error.behind(f"at {wavelength:g} um") from error


def make_model(
    measurement: Measurement,
    scene: Any,
    names: Sequence[str],
    nodes: int | None = None,
    accuracy: float | None = None,
    wavelengths_um: Any = None,
    folder: str | os.PathLike[str] = ".",
    threads: int | None = None,
    jacobian: str = "exact",
) -> Model:
    """The model of a measurement by a scene, of which numbers with these names change. Raises SceneError, OSError."""
    looks = [QUANTITIES[name].needs == LOOK for name in measurement.quantity.tolist()]
    at = {None if math.isnan(one) else float(one) for one in measurement.wavelength_um[np.logical_not(looks)].tolist()}
    if wavelengths_um is not None and not any(looks):
        raise SceneError.of("wavelengths_um", "are of colours, and none was measured")
    given = {"nodes": nodes, "accuracy": accuracy, "threads": threads}
    asked = {name: one for name, one in given.items() if one is not None}
    if isinstance(scene, SceneFamily):
        scene, folder = scene.source, scene.folder or folder
    if isinstance(scene, Scene):
        if any(looks) or at != {None}:
            of = "of colours" if any(looks) else f"at {max(one for one in at if one):g} um"
            words = f"the measurement is {of}, and a vrte.Scene knows no wavelength: give a scene file or its content"
            raise SceneError(words)
        return Model(measurement, {None: make_family(scene, names, folder)}, asked, np.zeros(0), jacobian)
    if isinstance(scene, Mapping):
        content = dict(scene)
    else:
        content, folder = read_content(scene), Path(scene).parent
    content.pop("fit", None)
    colours_um = np.zeros(0)
    if any(looks):
        chosen = choose_wavelengths(content, Path(folder)) if wavelengths_um is None else wavelengths_um
        colours_um = check_ascending(chosen)
        at |= {*colours_um.tolist()}
    bare = {key: one for key, one in content.items() if key not in REQUESTS}
    source = make_family(content, names, folder)
    families = {one: make_family(bare if one is None else {**bare, "wavelength_um": one}, names, folder) for one in at}
    options = {key: content[key] for key in OPTION_KEYS if key in content} | asked
    if "nodes" in asked:
        options.pop("accuracy", None)
    return Model(measurement, families, options, colours_um, jacobian, source)
