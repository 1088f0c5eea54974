"""Scenes that differ in a few of their numbers, and how they change with each: what derivatives and fits start from."""

import copy
import itertools
import math
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np

from vrte.basics.arrays import Array, check_list, check_numbers, freeze_copy
from vrte.basics.differences import find_slopes
from vrte.basics.errors import Place, SceneError
from vrte.formats.bases import find_base_limits, read_base
from vrte.formats.fillings import FilledLayer, Recorder, list_filled_layers, vary_filled_layer
from vrte.formats.keys import Reading
from vrte.formats.materials import expand_materials
from vrte.formats.paints import expand_paint, find_expanded_place
from vrte.formats.particle_sources import Compute, describe_value, make_particles
from vrte.formats.scene_file import FILE_KEYS, REQUESTS, SceneFile, make_scene_file, read_content
from vrte.formats.scene_keys import convert_to_plain_content, convert_to_plain_number, find_number, put, split_key
from vrte.formats.toml_table import Table
from vrte.optics.crowding import INDEPENDENT
from vrte.optics.particles import Particles
from vrte.optics.size_distribution import Held, SizeDistribution
from vrte.optics.spheres import Ball
from vrte.optics.vary_spheres import ParticleSlopes, SphereNumbers, vary_spheres
from vrte.scene.boundary import Boundary
from vrte.scene.scene import Scene
from vrte.scene.variation import Variation
from vrte.scene.vary import BASE_STEP, LEAST_SCALE, vary_base, vary_scene

MOST_NAMES = 1000
MOST_KINDS = 512  # of particles that a family remembers, some 10 kB each
LARGEST_STEP = 1.0 / 64.0  # of a number: what differences begin with
SMALLEST_STEP = 1.0 / 4096.0  # of what is no length: shares, indices and albedos near 0
ANYTHING = {"field": {"mu0": 1.0}}  # a request where a file has none: its scene is asked for alone


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
        of a ready material that a layer names, 'particles."chalk: calcite".size.lognormal.sigma'.
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
    _content: dict[str, Any] | None = field(init=False, repr=False)
    _places: tuple[Place, ...] = field(init=False, repr=False)
    _optics: "Optics" = field(init=False, repr=False)

    def __post_init__(self) -> None:
        names = (self.names,) if isinstance(self.names, str) else tuple(check_list("names", self.names, MOST_NAMES))
        for name in names:
            if names.count(name) > 1:
                raise SceneError.of("names", f"{name} comes twice")
        content, folder = None, Path(self.folder or "")
        if isinstance(self.source, Mapping):
            content = convert_to_plain_content(self.source)
        elif not isinstance(self.source, Scene):
            content, folder = read_content(self.source), Path(self.folder or Path(self.source).parent)
        places = tuple(split_key(name) for name in names) if content is not None else ()
        if content is not None:
            places = tuple(find_expanded_place(content, place) for place in places)
            content = expand_paint(content)
            for name, place in zip(names, places, strict=True):
                if place[0] in REQUESTS:
                    raise SceneError(f"{name} is of what is asked for, not of the scene")
                try:
                    find_number(content, place, name)
                except SceneError:
                    content = expand_materials(content, folder)  # it may be of a material that a layer names
                    find_number(content, place, name)
        settled = {"names": names, "folder": folder.absolute(), "_content": content, "_places": places}
        for name, value in (settled | {"_optics": Optics()}).items():
            object.__setattr__(self, name, value)
        if len(set(places)) != len(places):
            raise SceneError.of("names", "two of them are the same number")

    @cached_property
    def values(self) -> Array:
        """The numbers as the source has them, (n,)."""
        if self._content is None:
            found = [variation.value for variation in self._vary_scene(self._scene)]
        else:
            found = [find_number(self._content, *both) for both in zip(self._places, self.names, strict=True)]
        return freeze_copy(np.array(found, float))

    @cached_property
    def limits(self) -> dict[str, tuple[float, float]]:
        """What the numbers of the base may be, from and to, by ``names``, as far as the base says."""
        if self._content is None:
            known = getattr(self._scene.base, "LIMITS", {})
        else:
            known = find_base_limits(self._content["base"]["kind"]) if "base" in self._content else {}
        keys = {name: name.partition(".")[2] for name in self.names if name.startswith("base.")}
        return {name: known[key] for name, key in keys.items() if key in known}

    def content_at(self, values: Any) -> dict[str, Any]:
        """The content of a scene file with other values of its numbers.

        Parameters
        ----------
        values : array_like (n,)
            In the order of ``names``.

        Returns
        -------
        dict
            As `tomllib` would give it; a paint is expanded to layers.

        Raises
        ------
        SceneError
            Where their number is wrong, or the source is no file.

        Examples
        --------
        >>> import vrte
        >>> layer = {"phase": "rayleigh", "albedo": 0.9, "thickness": 0.5}
        >>> vrte.SceneFamily({"layer": [layer]}, "layer[1].albedo").content_at([0.5])["layer"][0]["albedo"]
        0.5
        """
        if self._content is None:
            raise SceneError.of("source", "is a Scene and no scene file: it has no content")
        found = copy.deepcopy(self._content)
        for place, value in zip(self._places, self._check(values), strict=True):
            put(found, place, convert_to_plain_number(value) if math.isfinite(value) else float(value))
        return found

    def file_at(self, values: Any) -> SceneFile:
        """What a scene file holds with other values of its numbers.

        Parameters
        ----------
        values : array_like (n,)
            In the order of ``names``.

        Returns
        -------
        SceneFile
            Its scene, and what it asks for.

        Raises
        ------
        SceneError
            For values that the scene does not allow, and where the source is no file.

        Examples
        --------
        >>> import vrte
        >>> layer = {"phase": "rayleigh", "albedo": 0.9, "thickness": 0.5}
        >>> content = {"layer": [layer], "brdf": {"mu_i": 0.5, "mu_o": 1.0}}
        >>> vrte.SceneFamily(content, "layer[1].thickness").file_at([3.0]).request["mu_i"]
        [0.5]
        """
        return make_scene_file(self.content_at(values), folder=self._folder, compute=self._optics)

    def at(self, values: Any) -> Scene:
        """The scene with other values of its numbers.

        Parameters
        ----------
        values : array_like (n,)
            In the order of ``names``.

        Returns
        -------
        Scene
            What of its particles is the same as before is not worked out again.

        Raises
        ------
        SceneError
            For values that the scene does not allow.

        Examples
        --------
        >>> import vrte
        >>> layer = {"phase": "rayleigh", "albedo": 0.9, "thickness": 0.5}
        >>> vrte.SceneFamily({"layer": [layer]}, ["layer[1].thickness"]).at([2.0]).thickness
        2.0
        """
        values = self._check(values)
        if self._content is not None:
            return self._make(self.content_at(values), self._optics)
        scene = self._scene
        for which, value in enumerate(values.tolist()):
            at = self._vary_scene(scene)[which].scene_at
            assert at is not None
            scene = at(value)
        return scene

    def variations(self, values: Any = None) -> list[Variation]:
        """How thicknesses, albedos, phase matrices and the base change with each number, per unit of it as it stands.

        Parameters
        ----------
        values : array_like (n,), optional
            Where; by default as the source has them.

        Returns
        -------
        list of Variation
            One for each name.

        Raises
        ------
        SceneError
            For values that the scene does not allow, for whole numbers, which cannot change by a little, for infinite
            ones, and for what changes nothing.

        Notes
        -----
        In closed form: all numbers of spheres and coated spheres that scatter independently of each other (radius,
        width of a distribution, n and k, core and shell, host_index, wavelength_um), fractions, thickness_um, thickness
        and albedo; a_n and b_n by compiled recursions, right to some 1e-12 of the largest. The radii that sizes are
        averaged over keep their number, and move with the distribution. Where an index comes from a table,
        wavelength_um takes its slope there, at a row itself the mean of both sides.

        By differences of the ingredients alone, at steps that are halved until nothing changes and extrapolated to
        none, one-sided where a number is at the end of its range, right to some 1e-10: spheroids and cylinders,
        packings other than "independent", phase functions, and bases, which are told as six weighted boundaries. In
        packings, those of clear spheres with resonances narrower than a thousandth of their radius may be off.

        Examples
        --------
        >>> import vrte
        >>> dust = {"index": 1.5, "radius_um": 0.01}
        >>> layer = {"particles": "dust", "volume_fraction": 0.01, "thickness_um": 1e4}
        >>> content = {"wavelength_um": 0.5, "particles": {"dust": dust}, "layer": [layer]}
        >>> (variation,) = vrte.SceneFamily(content, "particles.dust.radius_um").variations()
        >>> scene = vrte.SceneFamily(content, []).at([])
        >>> f"{variation.thickness[0] * 0.01 / scene.thickness:.2f}"  # scattering of small ones goes as r^6, by volume
        '3.00'
        """
        values = self.values if values is None else self._check(values)
        for name, value in zip(self.names, values.tolist(), strict=True):
            if not math.isfinite(value):
                raise SceneError(f"{name} is {value:g}, and only a finite number has a derivative")
        scene = self.at(values)
        if self._content is None:
            return self._vary_scene(scene)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the scene at the values themselves they have been given
            near = self._look_around(values)
            drafts = [self._draft(which, values, near) for which in range(len(self.names))]
            particles = near.vary_particles(drafts)
        return [draft.finish(near, slopes) for draft, slopes in zip(drafts, particles, strict=True)]

    @property
    def _scene(self) -> Scene:
        assert isinstance(self.source, Scene)
        return self.source

    @property
    def _folder(self) -> Path:
        assert self.folder is not None
        return self.folder

    def _check(self, values: Any) -> Array:
        """One value for each name."""
        found = check_numbers("values", values).reshape(-1)
        if found.size != len(self.names):
            raise SceneError.of("values", f"must be {len(self.names)}, one for each name, not {found.size}")
        return found

    def _vary_scene(self, scene: Scene) -> list[Variation]:
        """Of a scene that is no file's."""
        return [vary_scene(scene, name) for name in self.names]

    def _make(self, content: dict[str, Any], compute: Compute) -> Scene:
        """The scene alone, whatever is asked for about it."""
        kind = next((name for name in REQUESTS if name in content), None)
        return make_scene_file(content if kind else content | ANYTHING, kind, self._folder, compute).scene

    def _read_base(self, content: dict[str, Any]) -> Boundary | None:
        """The base of the scene file, and nothing else of it."""
        return read_base(Reading(Table((), content, FILE_KEYS), self._folder))

    def _look_around(self, values: Array) -> "Neighbourhood":
        """What the scene is made of, where derivatives are asked for."""
        content, held, seen = self.content_at(values), HeldOptics(self._optics), Recorder()
        scene, stand_in = self._make(content, held.start()), self._make(content, seen)
        numbers = [seen.find_numbers(kind, radii) for kind, radii in enumerate(held.radii)]
        return Neighbourhood(scene, stand_in, held, seen, list_filled_layers(content, self._folder), numbers)

    def _draft(self, which: int, values: Array, near: "Neighbourhood") -> "Draft":
        """How all changes with one of the numbers but the optics of spheres."""
        name, value = self.names[which], float(values[which])

        def content_at(number: float) -> dict[str, Any]:
            return self.content_at(np.where(np.arange(values.size) == which, number, values))

        draft = Draft(name, value, lambda number: self._make(content_at(number), near.held.start()))
        reach = max(abs(value) * LARGEST_STEP, 0.0 if value and name.endswith("_um") else SMALLEST_STEP)

        def numbers_at(number: float) -> list[Any]:
            content, seen = content_at(number), Recorder()
            scene = self._make(content, seen)
            here = near.stand_in
            draft.is_outside |= scene.media != here.media or scene.interfaces != here.interfaces
            draft.changed |= {kind for kind, said in enumerate(seen.said) if said != near.seen.said[kind]}
            return list_numbers(scene, list_filled_layers(content, self._folder), seen, near)

        def ingredients_at(number: float) -> list[Array]:
            return list_ingredients(draft.scene_at(number), near.scene)

        try:
            draft.take(find_slopes(numbers_at, value, reach), near)
            if self._places[which][0] in ("base", "wavelength_um"):
                step = BASE_STEP * max(abs(value), LEAST_SCALE)
                draft.base = vary_base(lambda number: self._read_base(content_at(number)), value, step)
            if draft.needs_differences(near):
                draft.ingredients = find_slopes(ingredients_at, value, reach, list_ingredients(near.scene, near.scene))
        except SceneError as error:
            raise error.behind(f"{name} cannot change by a little") from error
        return draft


@dataclass(frozen=True, eq=False)
class Neighbourhood:
    """A scene whose numbers are about to change: the ``scene``, one with the same layers and stand-ins for particles,
    the ``held`` optics, and what its layers and the spheres in them are made of (None: other particles)."""

    scene: Scene
    stand_in: Scene
    held: "HeldOptics"
    seen: Recorder
    layers: list[FilledLayer]
    numbers: list[SphereNumbers | None]

    def vary_particles(self, drafts: Sequence["Draft"]) -> list[dict[int, ParticleSlopes]]:
        """Of each draft, how those kinds of particles change that do; what they have in common is worked out once."""
        found: list[dict[int, ParticleSlopes]] = [{} for _ in drafts]
        for kind, numbers in enumerate(self.numbers):
            users = [place for place, draft in enumerate(drafts) if kind in draft.changed and not draft.ingredients]
            if users and numbers is not None:
                changes = [drafts[place].numbers[kind] for place in users]
                ball = self.seen.particles[kind].balls[0][0]
                slopes = vary_spheres(cast(Ball, ball), self.held.particles[kind], numbers, changes)
                for place, slope in zip(users, slopes, strict=True):
                    found[place][kind] = slope
        return found


@dataclass(eq=False)
class Draft:
    """What is known of a variation: the slopes of all numbers that `list_numbers` lists, or those of the ingredients
    themselves where some are not known in closed form."""

    name: str
    value: float
    scene_at: Callable[[float], Scene]
    is_outside: bool = False
    changed: set[int] = field(default_factory=set)  # kinds of particles
    base: tuple[tuple[float, Boundary], ...] = ()
    plain: list[Array] = field(default_factory=list)  # as `list_ingredients`, of layers without particles
    amounts: list[Array] = field(default_factory=list)
    absorption: list[float] = field(default_factory=list)
    numbers: dict[int, SphereNumbers] = field(default_factory=dict)
    ingredients: list[Array] = field(default_factory=list)

    def take(self, slopes: Sequence[Any], near: Neighbourhood) -> None:
        """Sorts the slopes of what `list_numbers` lists."""
        rest = iter(slopes)
        self.plain = [next(rest) for _ in range(1 + len(near.scene.layers))]
        self.amounts = [next(rest) for _ in near.layers]
        self.absorption = next(rest).tolist()
        for kind, numbers in enumerate(near.numbers):
            if numbers is not None:
                self.numbers[kind] = SphereNumbers(next(rest), next(rest), next(rest), next(rest))

    def needs_differences(self, near: Neighbourhood) -> bool:
        """Whether other particles than spheres change, or a layer in which spheres do not scatter independently."""
        return any(near.numbers[kind] is None for kind in self.changed) or any(
            layer.keys.packing != INDEPENDENT
            and (amounts.any() or self.changed & {*layer.kinds} or any(self.absorption[kind] for kind in layer.kinds))
            for layer, amounts in zip(near.layers, self.amounts, strict=True)
        )

    def finish(self, near: Neighbourhood, particles: dict[int, ParticleSlopes]) -> Variation:
        """All of it. Raises SceneError where nothing changes."""
        bulk, *tables = self.ingredients or self.plain
        filled = {layer.place: number for number, layer in enumerate(near.layers)}
        n = len(tables)
        for row, place in enumerate(near.scene.places if not self.ingredients else ()):
            if place in filled:
                number = filled[place]
                layer = near.layers[number]
                absorption = self.absorption[layer.kinds[0]]
                bulk[row], bulk[n + row], tables[row] = vary_filled_layer(
                    layer, self.amounts[number], absorption, near.held.particles, particles
                )
        is_outside = self.is_outside or any(one.keeps_beams for _, one in self.base)
        cut = tuple(cut_zeros(table) for table in tables)
        found = Variation(self.name, self.value, bulk[:n], bulk[n:], cut, self.base, self.scene_at, is_outside)
        if found.changes_nothing:
            raise SceneError(f"{self.name} changes nothing in the scene")
        return found


class Optics:
    """Makes particles of a source and its keywords, each kind once."""

    def __init__(self) -> None:
        self.known: dict[str, tuple[Particles, list[tuple[int, int]]]] = {}

    def __call__(self, source: str, given: dict[str, Any]) -> Particles:
        return replace_sizes(self.find(source, given)[0], lambda ball: ball.size.distribution)

    def find(
        self, source: str, given: dict[str, Any], settled: Sequence[tuple[int, int]] = ()
    ) -> tuple[Particles, list[tuple[int, int]]]:
        """Particles, and over how many radii their sizes are averaged: as many as ``settled`` says, or as it takes."""
        said = repr((source, sorted((name, describe_value(value)) for name, value in given.items())))
        key = said + repr([*settled[:1]])
        if key not in self.known:
            radii = [*settled[:1]]
            held = {"size": Held(given["size"], radii)} if "size" in given else {}
            if len(self.known) > MOST_KINDS:
                self.known.clear()
            made = make_particles(source, given | held), radii
            self.known[key] = self.known[said + repr(radii)] = made
        return self.known[key]


@dataclass(eq=False)
class HeldOptics:
    """Particles of scenes that differ a little, all averaged over as many radii as the first one needs."""

    optics: Optics
    radii: list[list[tuple[int, int]]] = field(default_factory=list)  # of each kind, in the order they are made in
    particles: list[Particles] = field(default_factory=list)  # of the first scene

    def start(self) -> Compute:
        """What makes the particles of one scene."""
        kinds = itertools.count()

        def compute(source: str, given: dict[str, Any]) -> Particles:
            kind = next(kinds)
            if kind == len(self.radii):
                found, settled = self.optics.find(source, given)
                self.radii.append(settled[:1])
                self.particles.append(found)
            found, settled = self.optics.find(source, given, self.radii[kind])
            # media that they are put in by a packing are counted anew in each scene
            return replace_sizes(found, lambda ball: Held(ball.size.distribution, self.radii[kind], [ball.host]))

        return compute


def replace_sizes(particles: Particles, make_size: Callable[[Any], SizeDistribution]) -> Particles:
    """The same particles, the sizes of what they are made of given otherwise where they are held."""
    balls = (
        (replace(cast(Any, ball), size=make_size(ball)) if isinstance(ball.size, Held) else ball, share)
        for ball, share in particles.balls
    )
    return replace(particles, balls=tuple(balls))


def list_ingredients(scene: Scene, like: Scene) -> list[Array]:
    """Optical thicknesses and albedos of all layers, one array, and the coefficients of each, (terms, 6), with as many
    terms as those of the scene that it is ``like``."""
    tables = []
    for layer, other in zip(scene.layers, like.layers, strict=True):
        known = layer.phase_matrix.coefficients[: other.phase_matrix.terms]
        tables.append(np.pad(known, ((0, other.phase_matrix.terms - len(known)), (0, 0))))
    thickness, albedo = [layer.thickness for layer in scene.layers], [layer.albedo for layer in scene.layers]
    return [np.array([*thickness, *albedo]), *tables]


def list_numbers(scene: Scene, layers: Sequence[FilledLayer], seen: Recorder, near: Neighbourhood) -> list[Any]:
    """What a scene with stand-ins for particles is made of: ingredients of its other layers, amounts in those of
    particles, absorption around each kind, and what spheres depend on."""
    found: list[Any] = [*list_ingredients(scene, near.stand_in), *(layer.amounts for layer in layers)]
    found.append(np.array([each.host_absorption for each in seen.particles]))
    for kind, here in enumerate(near.numbers):
        if here is not None:
            same = seen.said[kind] == near.seen.said[kind]
            numbers = here if same else seen.find_numbers(kind, near.held.radii[kind])
            assert numbers is not None
            found += [numbers.arguments, numbers.radii, numbers.weights, numbers.wavenumber]
    return found


def cut_zeros(table: Array) -> Array:
    """A table without the rows at its end that are zero."""
    there = np.flatnonzero(table.any(axis=1))
    return table[: 1 + there[-1] if there.size else 0]
