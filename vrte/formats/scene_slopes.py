"""How the scene of a scene file changes with a few of its numbers: in closed form where spheres scatter independently.

Whatever a number changes of what layers are made of is found by differences, with stand-ins for the particles, which
cost nothing; the optics of spheres follow from these by the chain rule.
"""

import copy
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.differences import find_slopes
from vrte.basics.errors import SceneError
from vrte.formats.bases import read_base
from vrte.formats.keys import Reading
from vrte.formats.layers import FilledLayer
from vrte.formats.materials import expand_materials
from vrte.formats.paints import expand_paint, find_expanded_place
from vrte.formats.particle_sources import Compute, check_particles, describe_particles, make_particles
from vrte.formats.scene_file import FILE_KEYS, REQUESTS, SceneFile, make_scene_file
from vrte.formats.toml_table import Table, convert_to_plain_number, find_number, put, split_key
from vrte.optics.crowding import INDEPENDENT
from vrte.optics.particles import Particles
from vrte.optics.size_distribution import Held, SizeDistribution
from vrte.optics.spheres import Ball
from vrte.optics.vary_spheres import ParticleSlopes, SphereNumbers, vary_spheres
from vrte.scene.boundary import Boundary
from vrte.scene.layer import is_fraction_needed
from vrte.scene.scene import Scene
from vrte.scene.variation import Filling, Variation, vary_filling
from vrte.scene.vary import BASE_STEP, LEAST_SCALE, vary_base

MOST_KINDS = 512  # of particles that are remembered, some 10 kB each
LARGEST_STEP = 1.0 / 64.0  # of a number: what differences begin with
SMALLEST_STEP = 1.0 / 4096.0  # of what is no length: fractions, indices and albedos near 0
ANYTHING = {"field": {"mu0": 1.0}}  # a request where a file has none: its scene is asked for alone
ONE_SIZE = (1, 6)
UNCHANGED = ParticleSlopes(0.0, 0.0, 0.0, np.zeros((0, 6)))
SPHERES = tuple(one.name for one in fields(SphereNumbers))
Averaging = list[tuple[int, int]]  # over how many radii sizes are averaged, and up to which moment
Arrays = dict[tuple[str | int, ...], Any]  # what a scene is made of, by what and where


class ChangingFile:
    """The content of a scene file in a folder with the ``names`` of some of its numbers, as sweeps have them, and their
    ``places``; a paint, and where a number is of one a ready material, are expanded. Raises SceneError."""

    def __init__(self, content: dict[str, Any], names: Sequence[str], folder: Path) -> None:
        self.names, self.folder, self.optics = names, folder, Optics()
        self.places = [find_expanded_place(content, split_key(name)) for name in names]
        content = expand_paint(content)
        for name, index in zip(names, self.places, strict=True):
            if index[0] in REQUESTS:
                raise SceneError(f"{name} is of what is asked for, not of the scene")
            try:
                find_number(content, index, name)
            except SceneError:
                content = expand_materials(content, folder)  # it may be of a material that a layer names
                find_number(content, index, name)
        if len({*self.places}) != len(self.places):
            raise SceneError.of("names", "two of them are the same number")
        self.content = content

    @property
    def values(self) -> list[float]:
        """The numbers as the file has them."""
        return [find_number(self.content, *both) for both in zip(self.places, self.names, strict=True)]

    def content_at(self, values: Array) -> dict[str, Any]:
        """The content with other values of its numbers."""
        found = copy.deepcopy(self.content)
        for index, value in zip(self.places, values.tolist(), strict=True):
            put(found, index, convert_to_plain_number(value) if math.isfinite(value) else value)
        return found

    def make(self, values: Array, compute: Compute) -> SceneFile:
        """The scene file with other values, whatever is asked for about its scene."""
        content = self.content_at(values)
        kind = next((name for name in REQUESTS if name in content), None)
        return make_scene_file(content if kind else content | ANYTHING, kind, self.folder, compute)


class Optics:
    """Makes particles of a source and its keywords, each kind once."""

    def __init__(self) -> None:
        self.known: dict[str, tuple[Particles, Averaging]] = {}

    def __call__(self, source: str, given: dict[str, Any]) -> Particles:
        return replace_sizes(self.find(source, given)[0], lambda ball: ball.size.distribution)

    def find(self, source: str, given: dict[str, Any], taken: Averaging | None = None) -> tuple[Particles, Averaging]:
        """Particles, and over how many radii their sizes are averaged: as many as ``taken`` says, or as it takes."""
        described, radii = describe_particles(source, given), [*(taken or ())[:1]]
        key = described + repr(radii)
        if key not in self.known:
            held = {"size": Held(given["size"], radii)} if "size" in given else {}
            if len(self.known) > MOST_KINDS:
                self.known.clear()
            made = make_particles(source, given | held), radii  # which now has as many as it took
            self.known[key] = self.known[described + repr(radii)] = made
        return self.known[key]


class HeldOptics:
    """Particles of scenes that differ a little, all averaged over as many radii as the first one needs: ``radii`` and
    ``particles`` of that, by kind in the order in which they are made."""

    def __init__(self, optics: Optics) -> None:
        self.optics = optics
        self.radii: list[Averaging] = []
        self.particles: list[Particles] = []

    def start(self) -> Compute:
        """What makes the particles of one scene."""
        kinds = itertools.count()

        def compute(source: str, given: dict[str, Any]) -> Particles:
            kind = next(kinds)
            if kind == len(self.radii):
                found, taken = self.optics.find(source, given)
                self.radii.append(taken[:1])
                self.particles.append(found)
            found, taken = self.optics.find(source, given, self.radii[kind])
            # media that they are put in by a packing are counted anew in each scene
            return replace_sizes(found, lambda ball: Held(ball.size.distribution, self.radii[kind], [ball.host]))

        return compute


def replace_sizes(particles: Particles, make_size: Callable[[Any], SizeDistribution]) -> Particles:
    """The same particles, the sizes of what they are made of given otherwise where they are held."""
    balls = (
        (replace(cast(Any, ball), size=make_size(ball)) if isinstance(ball.size, Held) else ball, fraction)
        for ball, fraction in particles.balls
    )
    return replace(particles, balls=tuple(balls))


class Recipe:
    """What a scene file makes its ``scene`` of, with stand-ins for particles: ``descriptions`` of its kinds,
    ``particles`` that were only checked, and the ``layers`` that hold them."""

    def __init__(self, file: ChangingFile, values: Array) -> None:
        self.descriptions: list[str] = []
        self.particles: list[Particles] = []
        made = file.make(values, self.compute)
        self.scene, self.layers = made.scene, made.filled

    def compute(self, source: str, given: dict[str, Any]) -> Particles:
        """Stands in for what computes particles."""
        found = check_particles(source, given)
        self.descriptions.append(describe_particles(source, given))
        self.particles.append(found)
        return found

    def find_numbers(self, kind: int, taken: Averaging) -> SphereNumbers | None:
        """What a kind of particle depends on, averaged over so many radii; None where no derivatives are known."""
        balls = self.particles[kind].balls
        if len(balls) != 1 or not isinstance(balls[0][0], Ball):
            return None
        return SphereNumbers.of(balls[0][0], *(taken[0] if taken else ONE_SIZE))


@dataclass(eq=False)
class Draft:
    """What is known of a variation: the ``slopes`` of what its scene is made of; the kinds of particles that it
    ``changed``, with theirs; and those of the ingredients of all layers, where not all of that is in closed form."""

    name: str
    value: float
    scene_at: Callable[[float], Scene]
    is_outside: bool = False
    slopes: Arrays = field(default_factory=dict)
    changed: set[int] = field(default_factory=set)
    particles: dict[int, ParticleSlopes] = field(default_factory=dict)
    base: tuple[tuple[float, Boundary], ...] = ()
    ingredients: Arrays = field(default_factory=dict)


class Neighbourhood:
    """A scene file whose numbers are about to change: its ``scene``, the ``recipe`` of that, the ``held`` optics, and
    what the spheres among its particles depend on, by kind."""

    def __init__(self, file: ChangingFile, values: Array) -> None:
        self.file, self.values, self.held = file, values, HeldOptics(file.optics)
        self.scene = file.make(values, self.held.start()).scene
        self.recipe = Recipe(file, values)
        found = {kind: self.recipe.find_numbers(kind, radii) for kind, radii in enumerate(self.held.radii)}
        self.numbers = {kind: numbers for kind, numbers in found.items() if numbers is not None}

    def vary(self) -> list[Variation]:
        """How the scene changes with each of the numbers; what kinds of particles have in common is worked out once."""
        drafts = [self.draft(which) for which in range(len(self.values))]
        for kind, numbers in self.numbers.items():
            users = [draft for draft in drafts if kind in draft.changed and not draft.ingredients]
            changes = [
                SphereNumbers(**{name: draft.slopes["spheres", kind, name] for name in SPHERES}) for draft in users
            ]
            ball, particles = cast(Ball, self.recipe.particles[kind].balls[0][0]), self.held.particles[kind]
            found = vary_spheres(ball, particles, numbers, changes) if users else []
            for draft, slope in zip(users, found, strict=True):
                draft.particles[kind] = slope
        return [self.finish(draft) for draft in drafts]

    def draft(self, which: int) -> Draft:
        """How all changes with one of the numbers but the optics of spheres. Raises SceneError where it cannot."""
        file, name, value = self.file, self.file.names[which], float(self.values[which])

        def move(number: float) -> Array:
            return np.where(np.arange(self.values.size) == which, number, self.values)

        def scene_at(number: float) -> Scene:
            return file.make(move(number), self.held.start()).scene

        def base_at(number: float) -> Boundary | None:
            return read_base(Reading(Table((), file.content_at(move(number)), FILE_KEYS), file.folder))

        def numbers_at(number: float) -> list[Array]:
            recipe, here = Recipe(file, move(number)), self.recipe
            same = recipe.scene.media == here.scene.media and recipe.scene.interfaces == here.scene.interfaces
            draft.is_outside |= not same
            draft.changed |= {kind for kind, one in enumerate(recipe.descriptions) if one != here.descriptions[kind]}
            return [*self.list_numbers(recipe).values()]

        def ingredients_at(number: float) -> list[Array]:
            return [*list_ingredients(scene_at(number), self.scene).values()]

        draft = Draft(name, value, scene_at)
        reach = max(abs(value) * LARGEST_STEP, 0.0 if value and name.endswith("_um") else SMALLEST_STEP)
        try:
            slopes = find_slopes(numbers_at, value, reach)
            draft.slopes = dict(zip(self.list_numbers(self.recipe), slopes, strict=True))
            if file.places[which][0] in ("base", "wavelength_um"):
                step = BASE_STEP * max(abs(value), LEAST_SCALE)
                draft.base = vary_base(base_at, value, step)
            if self.needs_differences(draft):
                here = list_ingredients(self.scene, self.scene)
                slopes = find_slopes(ingredients_at, value, reach, [*here.values()])
                draft.ingredients = dict(zip(here, slopes, strict=True))
        except SceneError as error:
            raise error.behind(f"{name} cannot change by a little") from error
        return draft

    def list_numbers(self, recipe: Recipe) -> Arrays:
        """What a recipe's scene is made of: ingredients of its layers without particles, amounts in those of particles,
        absorption around each kind, and what spheres depend on."""
        found = list_ingredients(recipe.scene, self.recipe.scene)
        found |= {("amounts", index): layer.amounts for index, layer in enumerate(recipe.layers)}
        found["absorption",] = np.array([kind.host_absorption for kind in recipe.particles])
        for kind, numbers in self.numbers.items():
            if recipe.descriptions[kind] != self.recipe.descriptions[kind]:
                numbers = cast(SphereNumbers, recipe.find_numbers(kind, self.held.radii[kind]))
            found |= {("spheres", kind, name): getattr(numbers, name) for name in SPHERES}
        return found

    def needs_differences(self, draft: Draft) -> bool:
        """Whether other particles than spheres change, or a layer in which spheres do not scatter independently."""
        return not draft.changed <= self.numbers.keys() or any(
            layer.packing != INDEPENDENT
            and (
                draft.slopes["amounts", index].any()
                or draft.changed & {*layer.kinds}
                or draft.slopes["absorption",][[*layer.kinds]].any()
            )
            for index, layer in enumerate(self.recipe.layers)
        )

    def finish(self, draft: Draft) -> Variation:
        """The variation of a draft. Raises SceneError where nothing changes."""
        known = dict(draft.ingredients or draft.slopes)
        n, bulk = len(self.scene.layers), known["bulk",]
        rows = {index: row for row, index in enumerate(self.scene.places)}
        for number, layer in enumerate(self.recipe.layers if not draft.ingredients else ()):
            row = rows[layer.place]
            bulk[row], bulk[n + row], known["table", row] = self.vary_layer(draft, number, layer)
        outside = draft.is_outside or any(one.keeps_beams for _, one in draft.base)
        tables = [known["table", row] for row in range(n)]
        ends = [max(np.flatnonzero(table.any(axis=1)), default=-1) + 1 for table in tables]  # of rows that are not 0
        cut = tuple(table[:end] for table, end in zip(tables, ends, strict=True))
        found = Variation(draft.name, draft.value, bulk[:n], bulk[n:], cut, draft.base, draft.scene_at, outside)
        if found.changes_nothing:
            raise SceneError(f"{draft.name} changes nothing in the scene")
        return found

    def vary_layer(self, draft: Draft, number: int, layer: FilledLayer) -> tuple[float, float, Array]:
        """Derivatives of optical thickness, albedo and coefficients of a layer of particles, (terms, 6)."""
        kinds = [self.held.particles[kind] for kind in layer.kinds]
        changes = [draft.particles.get(kind, UNCHANGED) for kind in layer.kinds]
        terms = max(kind.phase_matrix.terms for kind in kinds)
        # the part of the volume counts, and how thick it is where that has an end
        counts = layer.is_length or is_fraction_needed(kinds[0], INDEPENDENT), math.isfinite(layer.amounts[-1])

        def fill(parts: Sequence[Any], tables: Sequence[Array], amounts: Array, absorbed: float) -> Filling:
            areas = np.array([(part.extinction_um2, part.scattering_um2, part.volume_um3) for part in parts]).T
            padded = np.array([np.pad(table, ((0, terms - len(table)), (0, 0))) for table in tables])
            fraction, extent = np.where(counts, amounts[-2:], 0.0)
            return Filling(amounts[:-2], areas[0], areas[1], areas[2], padded, np.array(absorbed), fraction, extent)

        there = [kind.phase_matrix.coefficients for kind in kinds]
        moved, absorbed = draft.slopes["amounts", number], float(draft.slopes["absorption",][layer.kinds[0]])
        here = fill(kinds, there, layer.amounts, kinds[0].host_absorption)
        change = fill(changes, [one.coefficients for one in changes], moved, absorbed)
        return vary_filling(here, change, layer.by_volume, layer.is_length)


def list_ingredients(scene: Scene, like: Scene) -> Arrays:
    """Optical thicknesses and albedos of all layers, one array, and the coefficients of each, (terms, 6), with as many
    terms as those of the scene that it is ``like``."""
    bulk = [layer.thickness for layer in scene.layers] + [layer.albedo for layer in scene.layers]
    found: Arrays = {("bulk",): np.array(bulk)}
    for row, (layer, other) in enumerate(zip(scene.layers, like.layers, strict=True)):
        known, terms = layer.phase_matrix.coefficients, other.phase_matrix.terms
        found["table", row] = np.pad(known[:terms], ((0, max(terms - len(known), 0)), (0, 0)))
    return found
