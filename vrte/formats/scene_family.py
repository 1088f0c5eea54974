"""Scenes that differ in a few of their numbers, and how they change with each: what derivatives and fits start from."""

import copy
import itertools
import math
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any, cast

import numpy as np

from vrte.basics.arrays import Array, check_list, check_numbers, freeze_copy
from vrte.basics.errors import Place, SceneError
from vrte.basics.slopes import find_slopes
from vrte.formats.bases import list_base_keys, read_base
from vrte.formats.keys import Reading
from vrte.formats.paints import expand_paint, find_expanded_place
from vrte.formats.particle_sources import Compute, describe_value, make_particles
from vrte.formats.scene_file import FILE_KEYS, REQUESTS, SceneFile, make_scene_file, read_content
from vrte.formats.scene_keys import convert_to_plain_content, convert_to_plain_number, find_number, put, split_key
from vrte.formats.toml_table import Table
from vrte.optics.particles import Particles
from vrte.optics.size_distribution import Held, SizeDistribution
from vrte.scene.boundary import Boundary
from vrte.scene.scene import Scene
from vrte.scene.variation import Variation
from vrte.scene.vary_base import Weighted, vary_base

MOST_NAMES = 1000
MOST_KINDS = 512  # of particles that a family remembers, some 10 kB each
LARGEST_STEP = 1.0 / 64.0  # of a number: what differences begin with
SMALLEST_STEP = 1.0 / 4096.0  # of what is no length: shares, indices and albedos near 0
BASE_STEP = 1.0 / 4.0  # of these steps, of a base: sixth order, not extrapolated
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
        "particles.gold.index[2]" for k where a file says [n, k], "wavelength_um", "base.albedo", "paint.thickness_um".
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
    names: Sequence[str]
    folder: Path | None = None
    _content: dict[str, Any] | None = field(init=False, repr=False)
    _places: tuple[Place, ...] = field(init=False, repr=False)
    _optics: "Optics" = field(init=False, repr=False)

    def __post_init__(self) -> None:
        names = (self.names,) if isinstance(self.names, str) else tuple(check_list("names", self.names, MOST_NAMES))
        for name in names:
            if not isinstance(name, str):
                raise SceneError.of("names", f"must be keys such as layer[1].thickness, not {name!r}")
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
            One for each name. Each is right to some 1e-10 of its largest: differences of the ingredients alone at steps
            that are halved until nothing changes, extrapolated to none, one-sided where a number is at the end of its
            range. Sizes are averaged over the radii that the values themselves need.

        Raises
        ------
        SceneError
            For values that the scene does not allow, for whole numbers, which cannot change by a little, for infinite
            ones, and for what changes nothing.

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
        held = HeldOptics(self._optics)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the scene at the values themselves they have been given
            self._make(self.content_at(values), held.start())  # first of all: how many radii it takes
            return [self._differentiate(which, values, scene, held) for which in range(len(self.names))]

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
        vary_scene = import_module("vrte.scene.vary").vary_scene
        return [vary_scene(scene, name) for name in self.names]

    def _make(self, content: dict[str, Any], compute: Compute) -> Scene:
        """The scene alone, whatever is asked for about it."""
        kind = next((name for name in REQUESTS if name in content), None)
        return make_scene_file(content if kind else content | ANYTHING, kind, self._folder, compute).scene

    def _read_base(self, content: dict[str, Any]) -> Boundary | None:
        """The base alone."""
        file = Table((), content, FILE_KEYS)
        return read_base(file.table("base", list_base_keys()), Reading(file, self._folder)) if "base" in file else None

    def _differentiate(self, which: int, values: Array, scene: Scene, held: "HeldOptics") -> Variation:
        """With one of the numbers."""
        name, place, value = self.names[which], self._places[which], float(values[which])
        terms, moved = [layer.phase_matrix.terms for layer in scene.layers], []

        def content_at(number: float) -> dict[str, Any]:
            return self.content_at(np.where(np.arange(values.size) == which, number, values))

        def scene_at(number: float) -> Scene:
            return self._make(content_at(number), held.start())

        def ingredients_at(number: float) -> list[Array]:
            changed = scene_at(number)
            moved.append(changed.media != scene.media or changed.interfaces != scene.interfaces)
            return list_ingredients(changed, terms)

        step = max(abs(value) * LARGEST_STEP, 0.0 if value and name.endswith("_um") else SMALLEST_STEP)
        base: Weighted = ()
        try:
            bulk, *tables = find_slopes(ingredients_at, value, step, list_ingredients(scene, terms))
            if place[0] in ("base", "wavelength_um"):
                base = vary_base(lambda number: self._read_base(content_at(number)), value, step * BASE_STEP)
        except SceneError as error:
            raise error.behind(f"{name} cannot change by a little") from error
        is_outside = any(moved) or any(one.keeps_beams for _, one in base)
        tables = [cut_zeros(table) for table in tables]
        n = len(terms)
        found = Variation(name, value, bulk[:n], bulk[n:], tuple(tables), base, scene_at, is_outside)
        if found.changes_nothing:
            raise SceneError(f"{name} changes nothing in the scene")
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

    def start(self) -> Compute:
        """What makes the particles of one scene."""
        kinds = itertools.count()

        def compute(source: str, given: dict[str, Any]) -> Particles:
            kind = next(kinds)
            if kind == len(self.radii):
                found, settled = self.optics.find(source, given)
                self.radii.append(settled[:1])
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


def list_ingredients(scene: Scene, terms: Sequence[int]) -> list[Array]:
    """Optical thicknesses and albedos of all layers, one array, and the coefficients of each, (terms, 6)."""
    tables = []
    for layer, rows in zip(scene.layers, terms, strict=True):
        known = layer.phase_matrix.coefficients[:rows]
        tables.append(np.pad(known, ((0, rows - len(known)), (0, 0))))
    thickness, albedo = [layer.thickness for layer in scene.layers], [layer.albedo for layer in scene.layers]
    return [np.array([*thickness, *albedo]), *tables]


def cut_zeros(table: Array) -> Array:
    """A table without the rows at its end that are zero."""
    there = np.flatnonzero(table.any(axis=1))
    return table[: 1 + there[-1] if there.size else 0]
