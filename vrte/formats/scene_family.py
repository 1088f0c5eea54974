"""Scenes that differ in a few of their numbers, and how they change with each: what derivatives and fits start from."""

import math
import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from vrte.basics.arrays import Array, check_list, check_numbers, freeze_copy
from vrte.basics.errors import SceneError
from vrte.formats.bases import BASES
from vrte.formats.scene_file import SceneFile, make_scene_file, read_content
from vrte.formats.scene_slopes import ChangingFile, Neighbourhood
from vrte.formats.toml_table import convert_to_plain_content
from vrte.scene.scene import Scene
from vrte.scene.variation import Variation
from vrte.scene.vary import vary_scene

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
    _file: ChangingFile | None = field(init=False, repr=False)  # None: of a Scene

    def __post_init__(self) -> None:
        names = (self.names,) if isinstance(self.names, str) else tuple(check_list("names", self.names, MOST_NAMES))
        for name in names:
            if names.count(name) > 1:
                raise SceneError.of("names", f"{name} comes twice")
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
        return freeze_copy(np.array(self._file.values, float))

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

    def variations(self, values: Any = None) -> list[Variation]:
        """How thicknesses, albedos, phase matrices and the base change with each number, per unit of it, at ``values``
        (n,), by default those of the source: one `vrte.Variation` for each name.

        In closed form, right to some 1e-12: all numbers of spheres and coated spheres that scatter independently of
        each other, fractions, thicknesses and albedos. By differences of the ingredients alone, at steps that are
        halved until nothing changes and extrapolated to none, right to some 1e-10: spheroids and cylinders, other
        packings, phase functions and bases. In packings, those of clear spheres with resonances narrower than a
        thousandth of their radius may be off. Raises SceneError for values that the scene does not allow, for whole
        numbers, which cannot change by a little, for infinite ones, and for what changes nothing.
        """
        values = self.values if values is None else self._check(values)
        for name, value in zip(self.names, values.tolist(), strict=True):
            if not math.isfinite(value):
                raise SceneError(f"{name} is {value:g}, and only a finite number has a derivative")
        scene = self.at(values)
        if self._file is None:
            return self._vary_scene(scene)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the scene at the values themselves they have been given
            return Neighbourhood(self._file, values).vary()

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
        """Of a scene that is no file's."""
        return [vary_scene(scene, name) for name in self.names]
