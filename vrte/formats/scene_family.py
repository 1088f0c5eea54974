"""Scenes that differ in a few of their numbers, and how they change with each: what derivatives and fits start from.

What layers are made of changes by differences, with stand-ins for the particles, which cost nothing; the optics of
spheres that scatter independently follow from these by the chain rule, in closed form.
"""

import copy
import itertools
import math
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np

from vrte.basics.arrays import Array, check_list, check_number, check_numbers, freeze_copy, put_in_one_line
from vrte.basics.differences import ROUNDING, find_slopes
from vrte.basics.errors import SceneError
from vrte.formats.bases import BASES, read_base_table
from vrte.formats.keys import Reading
from vrte.formats.layers import FilledLayer
from vrte.formats.materials import expand_materials, expand_paint
from vrte.formats.particle_sources import Compute, check_particles, describe_particles, make_particles
from vrte.formats.scene_file import FILE_KEYS, REQUESTS, SceneFile, make_scene_file, read_content
from vrte.formats.scene_numbers import SceneNumber, find_places, find_scene_number, share_places
from vrte.formats.toml_table import Table, convert_to_plain_content
from vrte.optics.crowding import INDEPENDENT
from vrte.optics.particles import Particles
from vrte.optics.size_distribution import Held, SizeDistribution
from vrte.optics.spheres import Ball, ParticleSlopes, SphereNumbers, vary_spheres
from vrte.scene.boundary import Boundary
from vrte.scene.layer import is_fraction_needed
from vrte.scene.scene import Scene
from vrte.scene.vary import BASE_STEP, LEAST_SCALE, Filling, Variation, vary_base, vary_filling, vary_scene

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
    """A scene file's content, expanded, with ``names`` of some of its ``numbers``. Raises SceneError."""

    def __init__(self, content: dict[str, Any], names: Sequence[str], folder: Path) -> None:
        self.names, self.folder, self.optics = names, folder, Optics()
        self.content = expand_paint(content)
        try:
            self.numbers = self.find_numbers(content)
        except SceneError:
            self.content = expand_materials(self.content, folder)  # they may be of a material that a layer names
            self.numbers = self.find_numbers(content)
        if share_places(self.numbers):
            raise SceneError.of("names", "two of them are the same number")

    def find_numbers(self, given: Mapping[str, Any]) -> list[SceneNumber]:
        """The numbers, of a content given with a paint or without. Raises SceneError."""
        places = [find_places(self.content, name, given) for name in self.names]
        for name, found in zip(self.names, places, strict=True):
            if found[0][0] in REQUESTS:
                raise SceneError(f"{put_in_one_line(name)} is of what is asked for, not of the scene")
        return [find_scene_number(self.content, *both) for both in zip(self.names, places, strict=True)]

    def content_at(self, values: Array) -> dict[str, Any]:
        """The content with other values of its numbers."""
        found = copy.deepcopy(self.content)
        for number, value in zip(self.numbers, values.tolist(), strict=True):
            number.put(found, value)
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
    """Particles, by kind in order, of scenes that differ a little, averaged over the ``radii`` of the first one."""

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
    """What a file makes its ``scene`` of, with stand-ins: ``descriptions`` and ``particles`` by kind, ``layers``."""

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
    """A variation under way: ``slopes``, kinds it ``changed`` with theirs, ``ingredients`` where not closed."""

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
    """A scene file about to change: its ``scene``, ``recipe``, ``held`` optics, and the spheres' numbers by kind;
    differences of ingredients are right to the ``accuracy`` of their largest."""

    def __init__(self, file: ChangingFile, values: Array, accuracy: float) -> None:
        self.file, self.values, self.held, self.accuracy = file, values, HeldOptics(file.optics), accuracy
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
            return read_base_table(Reading(Table((), file.content_at(move(number)), FILE_KEYS), file.folder))

        def numbers_at(number: float) -> list[Array]:
            recipe, here = Recipe(file, move(number)), self.recipe
            same = [
                (
                    one.scene.media,
                    one.scene.interfaces,
                    [(layer.flakes, layer.flake_area) for layer in one.scene.layers],
                )
                for one in (recipe, here)
            ]
            draft.is_outside |= here.scene.has_flakes or same[0] != same[1]
            draft.changed |= {kind for kind, one in enumerate(recipe.descriptions) if one != here.descriptions[kind]}
            return [*self.list_numbers(recipe).values()]

        def ingredients_at(number: float) -> list[Array]:
            return [*list_ingredients(scene_at(number), self.scene).values()]

        draft = Draft(name, value, scene_at)
        reach = max(abs(value) * LARGEST_STEP, 0.0 if value and name.endswith("_um") else SMALLEST_STEP)
        try:
            slopes = find_slopes(numbers_at, value, reach)
            draft.slopes = dict(zip(self.list_numbers(self.recipe), slopes, strict=True))
            if file.numbers[which].places[0][0] in ("base", "wavelength_um"):
                step = BASE_STEP * max(abs(value), LEAST_SCALE)
                draft.base = vary_base(base_at, value, step)
            if self.needs_differences(draft):
                here = list_ingredients(self.scene, self.scene)
                slopes = find_slopes(ingredients_at, value, reach, [*here.values()], self.accuracy)
                draft.ingredients = dict(zip(here, slopes, strict=True))
        except SceneError as error:
            raise error.behind(f"{name} cannot change by a little") from error
        return draft

    def list_numbers(self, recipe: Recipe) -> Arrays:
        """Layers without particles, amounts in those of particles, absorption around kinds, numbers of spheres."""
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
    """Thicknesses and albedos, one array, and coefficients (terms, 6) of layers, terms as those of ``like``."""
    bulk = [layer.thickness for layer in scene.layers] + [layer.albedo for layer in scene.layers]
    found: Arrays = {("bulk",): np.array(bulk)}
    for row, (layer, other) in enumerate(zip(scene.layers, like.layers, strict=True)):
        known, terms = layer.phase_matrix.coefficients, other.phase_matrix.terms
        found["table", row] = np.pad(known[:terms], ((0, max(terms - len(known), 0)), (0, 0)))
    return found


MOST_NAMES = 1000


@dataclass(frozen=True, eq=False)
class SceneFamily:
    """Scenes that differ in a few of their numbers.

    Parameters
    ----------
    source : path, mapping or Scene
        A scene file, its content (also with a table [paint]), or a scene.
    names : str or sequence of str
        The numbers that change, as keys of axes of sweeps have them: "layer[1].thickness", "particles.gold.radius_um",
        "particles.gold.index[2]" for k where a file says [n, k], "wavelength_um", "base.albedo", "paint.thickness_um";
        of a ready material that a layer names, 'particles."chalk: calcite".size.lognormal.sigma'. One of several
        layers, "layer[1:40].thickness", or of those with a kind of particles, "layer[dust].thickness": thicknesses are
        the sum, of which each layer keeps its part; any other number is the same in all of them.
        Of a `Scene`: layer[k].thickness, layer[k].albedo, layer[k].coefficients[l].a1 to .b2, base.albedo and other
        numbers of its base, interface[k].index and .roughness.
    folder : path, optional
        Where files that a mapping names lie; a path's own folder without.

    Raises
    ------
    SceneError
        For a name that is no number of the scene, one that comes twice, and one that changes nothing.
    OSError
        Where the file cannot be read.

    Examples
    --------
    >>> import vrte
    >>> layer = {"phase": "rayleigh", "albedo": 0.9, "thickness": 0.5}
    >>> family = vrte.SceneFamily({"layer": [layer]}, ["layer[1].thickness"])
    >>> family.at([2.0]).thickness, family.variations()[0].thickness.tolist()
    (2.0, [1.0])
    """

    source: str | os.PathLike[str] | Mapping[str, Any] | Scene
    names: Annotated[Sequence[str], str | Sequence[str]]
    folder: Annotated[Path | None, str | os.PathLike[str] | None] = None
    _file: ChangingFile | None = field(init=False, repr=False)  # None: of a Scene

    def __post_init__(self) -> None:
        names = (self.names,) if isinstance(self.names, str) else tuple(check_list("names", self.names, MOST_NAMES))
        for name in names:
            if names.count(name) > 1:
                raise SceneError.of("names", f"{put_in_one_line(name)} comes twice")
        file, folder = None, Path(self.folder or "")
        if isinstance(self.source, Mapping):
            file = ChangingFile(convert_to_plain_content(self.source), names, folder.absolute())
        elif not isinstance(self.source, Scene):
            folder = Path(self.folder or Path(self.source).parent)
            file = ChangingFile(read_content(self.source), names, folder.absolute())
        for name, value in {"names": names, "folder": folder.absolute(), "_file": file}.items():
            object.__setattr__(self, name, value)

    @cached_property
    def values(self) -> Array:
        """The numbers as the source has them, (n,)."""
        if self._file is None:
            return freeze_copy(np.array([variation.value for variation in self._vary_scene(self._scene)], float))
        return freeze_copy(np.array([number.value for number in self._file.numbers], float))

    @cached_property
    def limits(self) -> dict[str, tuple[float, float]]:
        """What the numbers of the base may be, from and to, by ``names``, as far as the base says."""
        kind = "black" if self._file is None else self._file.content.get("base", {}).get("kind", "black")
        known = getattr(self._scene.base if self._file is None else BASES[kind].make, "LIMITS", {})
        keys = {name: name.partition(".")[2] for name in self.names if name.startswith("base.")}
        return {name: known[key] for name, key in keys.items() if key in known}

    def content_at(self, values: Any) -> dict[str, Any]:
        """The content of a scene file with ``values`` (n,) of its numbers, as `tomllib` would give it; a paint is
        expanded to layers. Raises SceneError where their number is wrong, or the source is no file."""
        if self._file is None:
            raise SceneError.of("source", "is a Scene and no scene file: it has no content")
        return self._file.content_at(self._check(values))

    def file_at(self, values: Any) -> SceneFile:
        """What a scene file holds with ``values`` (n,) of its numbers: its scene, and what it asks for. Raises
        SceneError for values that the scene does not allow, and where the source is no file."""
        content = self.content_at(values)
        assert self._file is not None
        return make_scene_file(content, folder=self._file.folder, compute=self._file.optics)

    def at(self, values: Any) -> Scene:
        """The scene with ``values`` (n,) of its numbers; what of its particles is the same as before is not worked out
        again. Raises SceneError for values that the scene does not allow."""
        values = self._check(values)
        if self._file is not None:
            return self._file.make(values, self._file.optics).scene
        scene = self._scene
        for which, value in enumerate(values.tolist()):
            at = self._vary_scene(scene)[which].scene_at
            assert at is not None
            scene = at(value)
        return scene

    def variations(self, values: Any = None, accuracy: float = ROUNDING) -> list[Variation]:
        """How thicknesses, albedos, phase matrices and the base change with each number, per unit of it, at ``values``
        (n,), by default those of the source: one `vrte.Variation` for each name.

        In closed form, right to some 1e-12: all numbers of spheres and coated spheres that scatter independently of
        each other, fractions, thicknesses and albedos. By differences of the ingredients alone, at steps that are
        halved until nothing changes and extrapolated to none, right to some 1e-10: spheroids and cylinders, other
        packings, phase functions and bases. In packings, those of clear spheres with resonances narrower than a
        thousandth of their radius may be off. A coarser ``accuracy``, of the largest change, takes fewer of such steps:
        1e-7 a third of the time. Raises SceneError for values that the scene does not allow, for whole
        numbers, which cannot change by a little, for infinite ones, and for what changes nothing.
        """
        values = self.values if values is None else self._check(values)
        accuracy = check_number("accuracy", accuracy, ROUNDING, 0.1, f"between {ROUNDING:g} and 0.1")
        for name, value in zip(self.names, values.tolist(), strict=True):
            if not math.isfinite(value):
                raise SceneError(f"{name} is {value:g}, and only a finite number has a derivative")
        scene = self.at(values)
        if self._file is None:
            return self._vary_scene(scene)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the scene at the values themselves they have been given
            return Neighbourhood(self._file, values, accuracy).vary()

    @property
    def _scene(self) -> Scene:
        assert isinstance(self.source, Scene)
        return self.source

    def _check(self, values: Any) -> Array:
        """One value for each name."""
        found = check_numbers("values", values).reshape(-1)
        if found.size != len(self.names):
            raise SceneError.of("values", f"must be {len(self.names)}, one for each name, not {found.size}")
        return found

    def _vary_scene(self, scene: Scene) -> list[Variation]:
        """The changes of a scene that is not of a file, one for each number."""
        return [vary_scene(scene, name) for name in self.names]
