"""A panel: what lies on it at several wavelengths, its particles worked out once, solved as often as is asked."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, check_number, check_whole
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress, count_usable_cpus
from vrte.calls.brdfs import is_shared, run_side_by_side, solve_side_by_side
from vrte.calls.plan import make_request, warn_runtime_of_all
from vrte.calls.spectrum import Source, name_wavelength, read_source
from vrte.formats.materials import expand_content
from vrte.formats.particle_sources import Compute, make_particles
from vrte.formats.scene_file import find_known_wavelengths, make_scene_file, read_listed_wavelengths
from vrte.request.request import Request
from vrte.results.brdf import Spectrum, check_ascending
from vrte.results.field import Field
from vrte.results.result import find_finest_nodes
from vrte.scene.boundary import Boundary
from vrte.scene.interface import Interface
from vrte.scene.layer import LARGEST_THICKNESS
from vrte.scene.scene import Scene

VISIBLE = 0.40, 0.70  # [um], as far as the substances are known
WAVELENGTHS = 16  # by default
ACCURACY = 1e-4  # of each reflectance: below what any instrument shows
NOT_ASKED = ("brdf", "field", "render")  # tables of a scene file for other calls
FIXED = ("mu_i", "mu_o", "phi", "illuminate", "transmission", "threads", "progress", "time_limit_s")  # the panel's own


@dataclass(frozen=True, eq=False)
class Panel:
    """Scenes at ascending wavelengths in vacuum (n,), lit from above; ``lengths_um`` of layers, or None; ``asked``:
    keywords of `vrte.brdf`; ``layer``: the film, from 1, None for the only one that scatters."""

    wavelength_um: Array
    scenes: tuple[Scene, ...]
    lengths_um: tuple[float | None, ...]
    asked: Mapping[str, Any] = field(default_factory=dict)
    layer: int | None = None
    title: str = ""

    def __len__(self) -> int:
        return len(self.scenes)

    def __repr__(self) -> str:
        first, last = self.wavelength_um[[0, -1]]
        name = f"{self.title!r}, " if self.title else ""
        return f"Panel({name}{len(self)} wavelengths from {first:g} to {last:g} um, {len(self.lengths_um)} layers)"

    @property
    def surface(self) -> tuple[Interface | None, ...]:
        """The interface on top at each wavelength, or None."""
        return tuple(scene.interfaces[0] for scene in self.scenes)

    @property
    def film(self) -> int:
        """The index from 0 of the film: that of ``layer``, or of the only layer that scatters, or that is there."""
        count = len(self.lengths_um)
        if self.layer is not None:
            return check_whole("layer", self.layer, 1, count) - 1
        layers = self.scenes[0].layers
        scattering = [layer.has_flakes or layer.albedo * layer.thickness > 0.0 for layer in layers]
        for some in (scattering, [layer.extent > 0.0 for layer in layers]):
            if sum(some) == 1:
                return some.index(True)
        which = f"there are {count} layers, of which {sum(some)} have a thickness" if count > 1 else "it is empty"
        raise SceneError(f"which layer is the film, whose thickness counts? Say layer=1 to {count}: {which}", "layer")

    @property
    def length_um(self) -> float | None:
        """The thickness of the film [um]; None where only its optical thickness is known."""
        return self.lengths_um[self.film]

    @property
    def ends_and_middle(self) -> list[int]:
        """Indices of the first, a middle and the last wavelength, from which the nodes of all are chosen."""
        return sorted({0, len(self) // 2, len(self) - 1})

    def pick(self, indices: Sequence[int]) -> "Panel":
        """The same panel at some of its wavelengths, by their indices."""
        scenes = tuple(self.scenes[index] for index in indices)
        return replace(self, wavelength_um=self.wavelength_um[list(indices)], scenes=scenes)

    def choose_quadrature(self, mu_i: Any, mu_o: Any = 1.0, phi: Any = 0.0) -> dict[str, int]:
        """Options nodes and grading that the accuracy takes: the most of three wavelengths. Raises SceneError."""
        return find_finest_nodes(self.pick(self.ends_and_middle).light(mu_i, mu_o, phi))

    def join(self, others: Sequence["Panel"]) -> "Panel":
        """This panel's wavelengths, then those of others that are solved alike: for one call."""
        scenes = (scene for panel in (self, *others) for scene in panel.scenes)
        at = np.concatenate([panel.wavelength_um for panel in (self, *others)])
        return replace(self, wavelength_um=at, scenes=tuple(scenes))

    def put_over(self, base: Boundary | None) -> "Panel":
        """The same panel over another base; None is black."""
        return replace(self, scenes=tuple(replace(scene, base=base) for scene in self.scenes))

    def scale_film(self, times: float) -> "Panel":
        """The same panel with a film ``times`` as thick; math.inf: semi-infinite, and nothing lies below it."""
        index = self.film
        times = check_number("times", times, 0.0, np.inf, "how many times as thick, >= 0")
        ends, own = np.isfinite(times), self.length_um
        stop = None if ends else index + 1  # nothing lies below a semi-infinite film
        length = np.inf if not ends else None if own is None else own * times

        def scale(scene: Scene) -> Scene:
            film = scene.layers[index]
            if np.isinf(film.extent):
                raise SceneError("the film is semi-infinite, and can be made no thicker: give it a thickness_um")
            layers = *scene.layers[:index], film.scale(times), *scene.layers[index + 1 : stop]
            below = (scene.base, scene.interfaces) if ends else (None, (*scene.interfaces[:stop], None))
            return Scene(layers, *below)

        lengths = *self.lengths_um[:index], length, *self.lengths_um[index + 1 : stop]
        return replace(self, scenes=tuple(scale(scene) for scene in self.scenes), lengths_um=lengths)

    def make_as_thick(self, length_um: float) -> "Panel":
        """The same panel with a film of a thickness [um]; math.inf as for `scale_film`."""
        allowed = f"a length in micrometres >= 0, at most {LARGEST_THICKNESS:g} or inf"
        wanted = check_number("length_um", length_um, 0.0, np.inf, allowed)
        if np.isinf(wanted):
            return self.scale_film(np.inf)
        known = self.length_um
        if known is None or not 0.0 < known < np.inf:
            given = "is given by its optical thickness" if known is None else f"is {known:g} um thick"
            words = f"cannot be made of one that {given}: give it a thickness_um above 0"
            raise SceneError(f"a film of {wanted:g} um {words}")
        return self.scale_film(wanted / known)

    def take_off_surface(self) -> "Panel":
        """The same panel without the interface on top, seen from the medium below it."""
        return replace(self, scenes=tuple(scene.without_surface() for scene in self.scenes))

    def solve(self, mu_i: Any, mu_o: Any = 1.0, phi: Any = 0.0, progress: Progress | None = None) -> Spectrum:
        """The BRDFs at all wavelengths; as `solve_as` solves them."""
        return Spectrum(self.wavelength_um, self.solve_as("brdf", progress, mu_i=mu_i, mu_o=mu_o, phi=phi))

    def light(self, mu_i: Any, mu_o: Any = (), phi: Any = 0.0, progress: Progress | None = None) -> tuple[Field, ...]:
        """The field of unpolarized beams at each wavelength; without mu_o its fluxes, of one Fourier order."""
        return self.solve_as("radiance", progress, mu0=np.atleast_1d(mu_i), mu=list(np.atleast_1d(mu_o)), phi=phi)

    def solve_as(self, kind: str, progress: Progress | None = None, **directions: Any) -> tuple[Any, ...]:
        """What `vrte.brdf` or `vrte.radiance` finds at all wavelengths, nodes being those of three of them."""
        count = len(self)
        looked_at = [] if "nodes" in self.asked else self.ends_and_middle
        rest = [index for index in range(count) if index not in looked_at]
        requests = {index: self._ask(kind, index, **directions, **self.asked) for index in looked_at}
        part = progress and (lambda done, total: progress(done, count))
        found = dict(zip(looked_at, solve_side_by_side(list(requests.values()), part), strict=True))
        if rest:
            fixed = find_finest_nodes(found.values()) if looked_at and "accuracy" in self.asked else {}
            others = [self._ask(kind, index, **directions, **{**self.asked, **fixed}) for index in rest]
            words = f"the other {len(rest)} wavelengths" if looked_at else f"{len(rest)} wavelengths"
            if not is_shared():  # who shares the cores has warned of all of it
                warn_runtime_of_all(len(rest), lambda index: (others[index], 0.0), words, workers=count_usable_cpus())
            part = progress and (lambda done, total: progress(done + len(looked_at), count))
            found |= dict(zip(rest, solve_side_by_side(others, part), strict=True))
        return tuple(found[index] for index in range(count))

    def _ask(self, kind: str, index: int, **asked: Any) -> Request:
        """The request at one wavelength, on one thread. Raises SceneError, which names it."""
        with name_wavelength(self.wavelength_um[index]):
            return make_request(kind, self.scenes[index], threads=1, **asked)


def make_panel(
    scene: Source | Panel,
    wavelengths_um: Any = None,
    folder: str | os.PathLike[str] = ".",
    progress: Progress | None = None,
    layer: int | None = None,
    compute: Compute = make_particles,
    **asked: Any,
) -> Panel:
    """The panel of a scene file or content, its ``layer`` (from 1) the film, at ascending ``wavelengths_um`` (None: the
    file's, or 16 in the visible); ``compute`` makes particles; ``asked``: keywords of `vrte.brdf`. Raises SceneError,
    OSError."""
    if isinstance(scene, Panel):
        if wavelengths_um is not None:
            raise SceneError("wavelengths_um: a panel has its own", "wavelengths_um")
        kept = scene.layer if layer is None else layer
        return replace(scene, asked={**scene.asked, **check_asked(asked)}, layer=kept)
    content, folder = read_source(scene, folder)
    content = {key: value for key, value in content.items() if key not in NOT_ASKED}
    asked = check_asked(asked)
    at = find_wavelengths(content, wavelengths_um, folder)

    def make(wavelength: float) -> Any:
        full = {**content, "wavelength_um": wavelength, "brdf": {"mu_i": 1.0, "mu_o": 1.0}}
        with name_wavelength(wavelength):
            return make_scene_file(full, "brdf", folder, compute)

    low, high, _ = find_known_wavelengths(content, folder)
    for end in at[[0, -1]][[at[0] < low, at[-1] > high]].tolist():  # what is refused is refused before the work
        make(end)
    files = run_side_by_side([partial(make, wavelength) for wavelength in at.tolist()], progress)
    options = dict(files[0].options)
    if options.pop("illuminate", "top") != "top":
        raise SceneError("illuminate must be 'top': a panel is looked at from above", "illuminate")
    how = options | asked
    if not {"nodes", "accuracy", "method"} & {*how}:
        how["accuracy"] = ACCURACY
    scenes, listed = tuple(file.scene for file in files), expand_content(content, folder).get("layer", ())
    lengths = (0.0 if index is None else listed[index].get("thickness_um") for index in scenes[0].places)
    found = Panel(at, scenes, tuple(lengths), how, layer, str(content.get("title", "")))
    if layer is not None:
        _ = found.film
    return found


def check_asked(asked: dict[str, Any]) -> dict[str, Any]:
    """Raises SceneError for keywords of `vrte.brdf` that a panel chooses itself."""
    for name in FIXED:
        if name in asked:
            raise SceneError.of(name, "is not asked for here: the geometry of each instrument says it")
    return asked


def find_wavelengths(scene: Source | Panel, wavelengths_um: Any, folder: str | os.PathLike[str] = ".") -> Array:
    """The wavelengths (n,) of a panel, or of one that `make_panel` would make. Raises SceneError, OSError."""
    if isinstance(scene, Panel):
        return scene.wavelength_um
    return check_ascending(
        choose_wavelengths(*read_source(scene, folder)) if wavelengths_um is None else wavelengths_um
    )


def choose_wavelengths(content: dict[str, Any], folder: Path) -> Sequence[float] | Array:
    """Wavelengths [um] that a file lists, or 16 over as much of the visible as its substances are known for."""
    listed = read_listed_wavelengths(content)
    if listed is not None:
        return listed
    low, high, substance = find_known_wavelengths(content, folder)
    first, last = max(low, VISIBLE[0]), min(high, VISIBLE[1])
    if first >= last:
        known = f"{substance} is known from {low:g} to {high:g} um, outside of the visible"
        raise SceneError(f"wavelengths_um are missing: {known}")
    return np.linspace(first, last, WAVELENGTHS).round(6).clip(first, last)
