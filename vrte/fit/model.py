"""What a scene shows in every row of a measurement, and how that changes with its numbers."""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from vrte.appearance.colours import find_colour, find_white, weigh_wavelengths
from vrte.appearance.geometries import (
    NODES,
    PORT_DEG,
    Geometry,
    find_cosine,
    find_own_light,
    read_geometry,
    subtract_port,
)
from vrte.appearance.gloss import LEAST_BEAM, NEEDS_SURFACE, check_evenness, find_own_lobe, list_rims, split_light
from vrte.appearance.panel import choose_wavelengths
from vrte.basics.arrays import Array, put_in_one_line
from vrte.basics.differences import STEP, sample_around
from vrte.basics.errors import SceneError
from vrte.basics.running import run_interruptible
from vrte.calls.brdfs import run_side_by_side, solve_side_by_side
from vrte.calls.derivatives import read_derivatives, solve_with_derivatives
from vrte.calls.spectrum import name_wavelength
from vrte.fit.light import Seen, Sight, Solved, make_scene_jet, read_sight
from vrte.fit.measurement import Measurement
from vrte.fit.quantities import BEAM, DIRECTIONS, GLOSS, QUANTITIES, BeamShares
from vrte.formats.scene_family import SceneFamily
from vrte.formats.scene_file import OPTION_KEYS, REQUESTS, read_content
from vrte.methods import choose_method, make_run
from vrte.request.how import EXACT
from vrte.request.request import Request
from vrte.results.brdf import check_ascending
from vrte.results.result import Solution
from vrte.scene.boundary import Lambertian
from vrte.scene.illumination import hemisphere
from vrte.scene.scene import Scene
from vrte.scene.vary import Variation

ACCURACY = 1e-5  # of a solve, where neither nodes nor an accuracy is asked for
OF_SLOPES = 1e-7  # of ingredients' derivatives by differences: steps of least squares need no more
Spot = tuple[float | None, float | None]  # a wavelength [um] and the albedo of a base; None: the scene's own


@dataclass(frozen=True, eq=False)
class Instrument:
    """An instrument's reflectance factor at one wavelength: its geometry, and places in the sight."""

    geometry: Geometry
    beams: tuple[int, ...]
    triple: int | None

    def read(self, seen: Seen) -> Array:
        """The reflectance factor (1 + n,), as vrte/appearance/geometries.py defines it."""
        geometry, shares = self.geometry, seen.shares
        if geometry.angle_o is not None:
            return np.pi * seen.matrices[:, self.triple, 0, 0]
        beams = list(self.beams)
        total = shares.reflected[:, beams] + shares.mirrored[:, beams]
        if geometry.angle_i is None:
            mu, weights = hemisphere(NODES)
            return 2.0 * total @ (weights * mu)
        if not geometry.excluded:
            return total[:, 0]
        mu_i, there = find_cosine(geometry.angle_i), seen.matrices[:, self.triple, 0, 0]
        own = make_scene_jet(
            lambda scene: find_own_light(scene.interfaces[0], mu_i, PORT_DEG), seen.scene, seen.variations, mu_i
        )
        return subtract_port(shares.reflected[:, beams[0]], there, own, geometry.angle_i, PORT_DEG)


@dataclass(frozen=True)
class Glossmeter:
    """A glossmeter's light at one wavelength, by its angle [degrees]: places in the sight of its beam, and of the
    middle and rims of its receptor, in the plane and across, (3, 2)."""

    angle: float
    beam: int
    triples: Any

    def read(self, seen: Seen) -> Array:
        """Light in the receptor over that of the black glass (1 + n,). Raises SceneError."""
        mu, top = find_cosine(self.angle), seen.scene.interfaces[0]
        mirrored = seen.shares.mirrored[:, self.beam]
        if top is None and mirrored[0] < LEAST_BEAM:
            raise SceneError(NEEDS_SURFACE)
        own = make_scene_jet(
            lambda scene: find_own_lobe(scene.interfaces[0], self.angle), seen.scene, seen.variations, mu
        )
        parts = split_light(mirrored, seen.matrices[:, self.triples, 0, 0], own, self.angle)
        check_evenness([part[0] for part in parts], self.angle)
        found: Array = parts[0] + parts[1]
        return found


class Model:
    """The rows of a measurement as a function of some numbers of a scene: ``source`` as it was given, ``families`` at
    each wavelength and base; the ``nodes`` of all solves, once chosen; how many ``solves``; ``notes`` on them."""

    def __init__(
        self,
        measurement: Measurement,
        families: Mapping[Spot, SceneFamily],
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
        self.sights: dict[Spot, Sight] = {}
        self.direct: dict[tuple[str, Spot], list[tuple[int, int]]] = {}  # rows, and their places in a sight
        self.read_by_instruments: list[
            tuple[int, list[tuple[Spot, Instrument | Glossmeter]]]
        ] = []  # rows; several: colours
        for row in range(len(measurement)):
            self._add_row(row)
        rows = [row for row, _ in self.read_by_instruments if measurement.illuminant[row]]
        for light in dict.fromkeys((measurement.illuminant[row], int(measurement.observer[row])) for row in rows):
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

    def _add_row(self, row: int) -> None:
        """What a row asks for."""
        given = self.measurement
        name, spot = given.quantity[row], find_spot(given, row)
        known = QUANTITIES[name]
        if known.is_over_visible or given.geometry[row]:
            several = [(one, spot[1]) for one in self.colours_um.tolist()] if known.is_over_visible else [spot]
            made = [(one, self._place_instrument(one, name, given.geometry[row])) for one in several]
            self.read_by_instruments.append((row, made))
            return
        sight = self.sights.setdefault(spot, Sight())
        mu_i, theta_o, phi = find_cosine(given.theta_i_deg[row]), given.theta_o_deg[row], given.phi_deg[row]
        if known.needs == BEAM:
            index = sight.add_beam(mu_i, known.through)
        else:
            turned = phi + 180.0 * bool(theta_o < 0.0)
            index = sight.add_triple(known.through, mu_i, find_cosine(theta_o), turned)
        self.direct.setdefault((name, spot), []).append((row, index))

    def _place_instrument(self, spot: Spot, quantity: str, geometry_name: str) -> Instrument | Glossmeter:
        """The directions of an instrument, added to the sight of a wavelength and base."""
        sight = self.sights.setdefault(spot, Sight())
        if QUANTITIES[quantity].needs == GLOSS:
            angle = float(quantity.rpartition("_")[2])
            mu, (rims, azimuths) = find_cosine(angle), list_rims(angle)
            places = [[sight.add_triple(False, mu, float(out), float(phi)) for phi in azimuths] for out in rims]
            return Glossmeter(angle, sight.add_beam(mu, False), np.array(places))
        geometry = read_geometry(geometry_name)
        mu_i, mu_o, phi = geometry.directions
        if geometry.angle_o is not None:
            return Instrument(geometry, (), sight.add_triple(False, float(mu_i[0]), float(mu_o[0]), float(phi[0])))
        beams = tuple(sight.add_beam(float(mu), False) for mu in mu_i)
        triple = sight.add_triple(False, float(mu_i[0]), float(mu_i[0]), 0.0) if geometry.excluded else None
        return Instrument(geometry, beams, triple)

    def predict(self, values: Array) -> Array:
        """What the scene with these numbers shows, (rows,). Raises SceneError."""
        return self._find_jets(values, with_slopes=False)[0]

    def linearize(self, values: Array) -> tuple[Array, Array]:
        """The same, and its derivatives (rows, n). Raises SceneError."""
        if self.jacobian == "exact":
            jets = self._find_jets(values, with_slopes=True)
            return jets[0], jets[1:].T

        def differentiate(index: int) -> Array:
            """The derivative by one number (rows,), from differences of five points."""
            here, step = np.arange(values.size) == index, STEP * (abs(values[index]) or 1.0)
            points = sample_around(lambda value: self.predict(np.where(here, value, values)), values[index], step)
            return np.sum([weight * found for weight, found in points], axis=0)

        return self.predict(values), np.stack([differentiate(index) for index in range(values.size)], axis=1)

    def converge_on_nodes(self, values: Array) -> None:
        """Chooses how many nodes all solves take, by the first, a middle and the last wavelength at these numbers."""
        if self.nodes is None:
            self.nodes = self.find_nodes(values)

    def find_nodes(self, values: Array) -> int | None:
        """The most nodes that the accuracy takes; None for a method that has none."""
        order = sorted(self.sights, key=lambda one: (one[0] or 0.0, one[1] or 0.0))
        looked_at = [*dict.fromkeys((order[0], order[len(order) // 2], order[-1]))]
        options = {key: one for key, one in self.options.items() if key != "nodes"}
        plain = {"grading": 1} if options.get("method", EXACT) == EXACT else {}  # the nodes are kept by their number
        found = self._solve(values, looked_at, {"accuracy": ACCURACY} | options | plain, False)
        most = max(int(one.diagnostics.get("nodes", 0)) for some in found.values() for _, _, one, *_ in some)
        return most or None

    def _find_jets(self, values: Array, with_slopes: bool) -> Array:
        """Jets of all rows (1 + n, rows)."""
        options = {key: one for key, one in self.options.items() if key != "accuracy" or self.nodes is None}
        options |= {"accuracy": ACCURACY, **options} if self.nodes is None else {"nodes": self.nodes}
        return self._read(self._solve(values, [*self.sights], options, with_slopes))

    def _solve(
        self, values: Array, spots: Sequence[Spot], options: dict[str, Any], with_slopes: bool
    ) -> dict[Spot, list[Solved]]:
        """The solves of some wavelengths and bases at these numbers, side by side where there are several."""
        indices = [(one, part) for one in spots for part in self.sights[one].split()]
        alone = len(indices) == 1
        how = options if alone else options | {"threads": 1}

        def make(spots: Sequence[Spot]) -> dict[Spot, tuple[Scene, list[Variation]]]:
            """Scenes at one wavelength, and how they change: they differ in their bases alone."""
            first, *others = sorted(spots, key=lambda one: one[1] is not None)
            family = self.families[first]
            with name_wavelength(first[0]):
                scene = family.at(values)
                slopes = read_derivatives(scene, family.variations(values, OF_SLOPES)) if with_slopes else []
                more = {one: (put_over(scene, one[1]), [move_over(each, one[1]) for each in slopes]) for one in others}
                return {first: (scene, slopes)} | more

        def ask(spot: Spot, sight: Sight) -> Request:
            with name_wavelength(spot[0]):
                return choose_method(sight.ask(scenes[spot][0], how))

        def solve(spot: Spot, request: Request) -> tuple[Solution, list[Solution]]:
            run = make_run(request)
            run.runtime_warned = True

            def work() -> Any:
                return solve_with_derivatives(request, scenes[spot][1], run)

            with name_wavelength(spot[0]):
                _, solution, found = run_interruptible(run, work) if alone else work()
            return solution, [one.solution for one in found]

        self.solves += len(indices)
        groups = {one: [spot for spot in spots if spot[0] == one] for one, _ in spots}
        scenes: dict[Spot, tuple[Scene, list[Variation]]] = {}
        for made_there in run_side_by_side([partial(make, some) for some in groups.values()]):
            scenes |= made_there
        requests = [ask(*one) for one in indices]
        if alone or with_slopes:
            tasks = [partial(solve, spot, request) for (spot, _), request in zip(indices, requests, strict=True)]
            solved = [tasks[0]()] if alone else run_side_by_side(tasks)
        else:
            solved = [(light, []) for light in solve_alike(requests)]
        found: dict[Spot, list[Solved]] = {}
        for (one, sight), request, (light, slopes) in zip(indices, requests, solved, strict=True):
            found.setdefault(one, []).append((sight, request, light, slopes, scenes[one][1]))
        return found

    def _read(self, solved: Mapping[Spot, list[Solved]]) -> Array:
        """Jets of all rows (1 + n, rows)."""
        seen = {one: read_sight(self.sights[one], some) for one, some in solved.items()}
        out = np.zeros((next(iter(seen.values())).matrices.shape[0], len(self.measurement)))
        for (name, spot), pairs in self.direct.items():
            known, light = QUANTITIES[name], seen[spot]
            rows, indices = np.transpose(pairs)
            if known.needs == DIRECTIONS:
                out[:, rows] = known.read(light.matrices[:, indices])
            else:
                out[:, rows] = known.read(BeamShares(*(part[:, indices] for part in light.shares)))
        for row, parts in self.read_by_instruments:
            factors = np.stack([made.read(seen[at]) for at, made in parts], axis=1)
            known, illuminant = QUANTITIES[self.measurement.quantity[row]], self.measurement.illuminant[row]
            if illuminant:
                observer = int(self.measurement.observer[row])
                weights = weigh_wavelengths(self.colours_um, illuminant, observer)
                out[:, row] = known.read(factors @ weights.T, find_white(illuminant, observer))
            elif known.needs == GLOSS:
                out[:, row] = known.read(factors @ weigh_wavelengths(self.colours_um, "C", 2)[1])
            else:
                out[:, row] = known.read(factors[:, 0])
        return out


def solve_alike(requests: Sequence[Request]) -> list[Solution]:
    """Solutions of requests of one thread each: those that look along the same directions at different scenes in one
    call."""
    groups: dict[Any, list[int]] = {}
    for index, one in enumerate(requests):
        along = (one.mu0, one.phi) if one.mu is None else (one.mu0, one.phi, one.mu)
        groups.setdefault((one.kind, one.tau.size, *(each.tobytes() for each in along)), []).append(index)
    found: dict[int, Solution] = {}
    for indices in groups.values():
        alike = [requests[index] for index in indices]
        found |= dict(zip(indices, solve_side_by_side(alike, as_light=True), strict=True))
    return [found[index] for index in range(len(requests))]


def find_spot(given: Measurement, row: int) -> Spot:
    """The wavelength and the albedo of the base of a row."""
    wavelength, base = (None if math.isnan(one) else float(one) for one in (given.wavelength_um[row], given.base[row]))
    return wavelength, base


def put_over(source: Any, albedo: float | None) -> Any:
    """A scene, or the content of a file, over a Lambertian base of that albedo; as it is for None."""
    if albedo is None:
        return source
    if isinstance(source, Scene):
        return replace(source, base=Lambertian(albedo))
    base = {"kind": "lambertian", "albedo": albedo}
    return (
        {**source, "paint": {**source["paint"], "substrate": base}} if "paint" in source else {**source, "base": base}
    )


def move_over(variation: Variation, albedo: float | None) -> Variation:
    """The same change of a scene that is put over a Lambertian base of that albedo."""
    at = variation.scene_at
    return replace(variation, base=(), scene_at=at and (lambda number: put_over(at(number), albedo)))


def make_family(source: Any, names: Sequence[str], folder: str | os.PathLike[str]) -> SceneFamily:
    """The scenes by their free numbers, which all have a value. Raises SceneError that says what is free."""
    try:
        family = SceneFamily(source, names, Path(folder))
        assert family.values.size == len(names)
        return family
    except SceneError as error:
        words = str(error).removeprefix("derivatives: ")
        raise SceneError(words if words.startswith("free") else f"free: {words}", "free", *error.place) from error


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
    looks = [QUANTITIES[name].is_over_visible for name in measurement.quantity.tolist()]
    spots = [find_spot(measurement, row) for row in range(len(measurement))]
    at = dict.fromkeys(spot for spot, look in zip(spots, looks, strict=True) if not look)
    if any(base is not None for _, base in spots):
        for name in names:
            if name.startswith(("base", "paint.substrate")):
                words = "is a number of the base, and rows of the measurement have bases of their own: leave one out"
                raise SceneError(f"free: {put_in_one_line(name)} {words}", "free")
    if wavelengths_um is not None and not any(looks):
        raise SceneError.of("wavelengths_um", "are of colours and gloss, and none was measured")
    given = {"nodes": nodes, "accuracy": accuracy, "threads": threads}
    asked = {name: one for name, one in given.items() if one is not None}
    if isinstance(scene, SceneFamily):
        scene, folder = scene.source, scene.folder or folder
    if isinstance(scene, Scene):
        if any(looks) or any(one for one, _ in at):
            of = "of colours or gloss" if any(looks) else f"at {max(one for one, _ in at if one):g} um"
            words = f"the measurement is {of}, and a vrte.Scene knows no wavelength: give a scene file or its content"
            raise SceneError(words)
        source = make_family(scene, names, folder)
        families = {
            spot: make_family(put_over(scene, spot[1]), names, folder) if spot[1] is not None else source for spot in at
        }
        return Model(measurement, families, asked, np.zeros(0), jacobian, source)
    if isinstance(scene, Mapping):
        content = dict(scene)
    else:
        content, folder = read_content(scene), Path(scene).parent
    content.pop("fit", None)
    colours_um = np.zeros(0)
    if any(looks):
        chosen = choose_wavelengths(content, Path(folder)) if wavelengths_um is None else wavelengths_um
        colours_um = check_ascending(chosen)
        bases = dict.fromkeys(base for (_, base), look in zip(spots, looks, strict=True) if look)
        at |= dict.fromkeys((one, base) for one in colours_um.tolist() for base in bases)
    bare = {key: one for key, one in content.items() if key not in REQUESTS}
    source = make_family(content, names, folder)
    families = {
        (one, base): make_family(put_over(bare if one is None else {**bare, "wavelength_um": one}, base), names, folder)
        for one, base in at
    }
    options = {key: content[key] for key in OPTION_KEYS if key in content} | asked
    if "nodes" in asked:
        options.pop("accuracy", None)
    return Model(measurement, families, options, colours_um, jacobian, source)
