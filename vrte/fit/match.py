"""vrte.match: the numbers of a paint that meet a target of colour, hiding and gloss for the least pigment or money."""

import copy
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np

from vrte.appearance.colours import Colour, find_colour_of_lab
from vrte.appearance.hiding import Conditions
from vrte.appearance.paint import Paint, note_warnings
from vrte.appearance.paint import paint as make_paint
from vrte.appearance.panel import find_wavelengths, read_source
from vrte.basics.arguments import check_arguments
from vrte.basics.arrays import Array, check_number, check_whole, make_readonly
from vrte.basics.errors import AccuracyError, SceneError
from vrte.basics.running import Progress, share_progress
from vrte.basics.views import view
from vrte.calls.spectrum import Source
from vrte.fit.model import make_family
from vrte.fit.problem import MOST_STARTS, Parameter, read_parameters
from vrte.fit.recipe import Ingredient, Prices, find_densities, list_ingredients
from vrte.fit.run import spread_starts
from vrte.fit.search import STEP, PaintReader, RecipeSearch, Trial
from vrte.fit.target import make_target, read_over
from vrte.formats.materials import PAINT_KEYS, find_paint
from vrte.formats.scene_family import SceneFamily
from vrte.formats.scene_file import read_content, write_content
from vrte.formats.toml_table import Table, put, split_key, write_key
from vrte.optics.crowding import CROWDED_UP_TO
from vrte.request.how import complete_docstring

DIGITS = 9  # of the numbers of a recipe: rounding tips no target over its limit
USUAL_BOUNDS = {"fraction": 10.0, "thickness_um": 5.0}  # factors to either side of the start
OTHER_BOUNDS, ROUGHNESSES = 2.0, (0.001, 0.6)


def list_short_names(content: Mapping[str, Any]) -> dict[str, str]:
    """The keys, as sweeps have them, of numbers of a paint that may be named alone: a pigment's own name is its load.

    >>> names = list_short_names({"paint": {"pigment": {"rutile": 0.1, "chalk": 0.1}}})
    >>> names["rutile"], names["thickness_um"], names["roughness"]
    ('paint.pigment.rutile', 'paint.thickness_um', 'paint.surface.roughness')
    """
    paint = content.get("paint")
    if not isinstance(paint, Mapping):
        return {}
    pigment = paint.get("pigment")
    loads = {pigment: "paint.volume_fraction"} if isinstance(pigment, str) else {}
    if isinstance(pigment, Mapping):
        loads = {name: f"paint.pigment.{write_key(name)}" for name in pigment}
    return loads | {key: f"paint.{key}" for key in PAINT_KEYS} | {"roughness": "paint.surface.roughness"}


def read_free(free: Sequence[str] | Mapping[str, Any], names: Sequence[str], starts: Array) -> tuple[Parameter, ...]:
    """The free numbers, in logarithms where their lower bound is above 0; a start beyond its bounds is moved to them.
    Raises SceneError."""
    given = dict(free) if isinstance(free, Mapping) else dict.fromkeys(free)
    begun = dict(zip(names, starts.tolist(), strict=True))
    usual = {name: find_bounds(name, value) for name, value in begun.items()}
    found = read_parameters(dict(zip(names, given.values(), strict=True)), None, begun, usual, is_search=True)
    for one in found:
        if not all(map(math.isfinite, (one.convert_to_step(one.low), one.convert_to_step(one.high)))):
            words = "needs finite bounds" + ", above 0 for steps in its logarithm" * one.is_log
            raise SceneError(f"free: {one.name} {words}: it has {one.low:g} and {one.high:g}", "free")
    return found


def find_bounds(name: str, start: float) -> tuple[float, float]:
    """Bounds of a number where none are given.

    >>> find_bounds("paint.thickness_um", 60.0), find_bounds("paint.volume_fraction", 0.15)
    ((12.0, 300.0), (0.015, 0.3))
    """
    last = name.rpartition(".")[2]
    if last == "roughness":
        return ROUGHNESSES
    is_load = last == "volume_fraction" or ".pigment." in name or ".volume_fractions." in name
    factor = USUAL_BOUNDS.get("fraction" if is_load else last, OTHER_BOUNDS)
    if not 0.0 < start < math.inf:
        raise SceneError(f"free: {name} is {start:g}: say its bounds, as {{{name!r}: [low, high]}}", "free")
    high = min(start * factor, max(CROWDED_UP_TO, start)) if is_load else start * factor
    return start / factor, high


@dataclass(frozen=True, eq=False, repr=False)
class Match:
    """The recipe that `vrte.match` found, and how near it comes. ``matched`` in the example is one of a white paint.

    Attributes
    ----------
    recipe
        What the film is made of: of each ingredient its name, density [kg/l], and its parts of the volume and of the
        weight of the dry and of the wet film; None where that takes a density or volume_solids.
    difference
        CIEDE2000 from the colour that is wanted; 0 where none is.
    why
        What held the recipe back from the target; "" where it is met.
    names
        The free numbers, n.
    values
        Their values, (n,).
    bounds
        From and to, (n, 2).
    reached
        What is wanted and what was found of each quantity, by its name.
    cost
        What a square metre of dry film costs, in cost_unit; of a semi-infinite film a litre.
    cost_unit
        cm3 of pigment, or the money of the prices.
    sensitivities
        What 1 % more of each free number does to each quantity of reached, to the colour difference and to the cost,
        (n, quantities + 2).
    thickness_um
        Of the dry film [um].
    wet_thickness_um
        Of the wet film [um]; None without volume_solids.
    starts
        Where walks began and ended, (starts, 2, n), the best first.
    notes
        What was warned of, and what else is to be known.
    content
        The content of the scene file of the recipe.
    folder
        Where tables that it names lie.
    colours
        What is wanted and what was found, "wanted" and "found"; empty where no colour is wanted.

    Examples
    --------
    >>> matched.why
    ''
    """

    recipe: tuple[Ingredient, ...]
    difference: float
    why: str
    names: tuple[str, ...]
    values: Array
    bounds: Array
    reached: Mapping[str, tuple[float, float]]
    cost: float
    cost_unit: str
    sensitivities: Array
    thickness_um: float
    wet_thickness_um: float | None
    starts: Array
    notes: tuple[str, ...]
    content: Mapping[str, Any]
    folder: Path
    colours: Mapping[str, Colour]

    def __repr__(self) -> str:
        missed = "" if not self.why else f", {self.why}"
        return f"Match({self.cost:.4g} {self.cost_unit}, CIEDE2000 {self.difference:.2f}{missed})"

    def __str__(self) -> str:
        """Recipe, target, free numbers and what each does, as tables."""
        lines = self.describe()
        for rows in self.list_tables():
            widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
            pairs = (zip(row, widths, strict=True) for row in rows)
            lines += ["  ".join(["", *(cell.ljust(width) for cell, width in row)]).rstrip() for row in pairs]
        return "\n".join([*lines, *self.notes])

    def _repr_html_(self) -> str:
        return str(view(self, "_repr_html_"))

    def describe(self) -> list[str]:
        """Whether the target is met, how thick the film is, and what it costs."""
        wet = "" if self.wet_thickness_um is None else f", wet film {self.wet_thickness_um:.4g} µm"
        met = f"target {'not met: ' + self.why if self.why else 'met'}"
        return [met, f"dry film {self.thickness_um:.4g} µm{wet}; {self.cost:.4g} {self.cost_unit}"]

    def list_tables(self) -> Iterator[list[list[str]]]:
        """The tables of recipe, target and free numbers, each the row of its heads and the rows below."""
        parts = ("volume", "weight", *(("wet_volume", "wet_weight") if self.wet_thickness_um is not None else ()))
        rows = [[one.name, *(write_part(getattr(one, part)) for part in parts)] for one in self.recipe]
        yield [["recipe [%]", *(part.replace("_", " ") for part in parts)], *rows]
        rows = [[name, f"{wanted:.5g}", f"{found:.5g}"] for name, (wanted, found) in self.reached.items()]
        rows += [["CIEDE2000", "", f"{self.difference:.3g}"]] if "L" in self.reached else []
        yield [["target", "wanted", "found"], *rows]
        columns = self.names, self.values.tolist(), self.bounds.tolist(), self.sensitivities.tolist()
        rows = [
            [name, f"{value:.5g}", f"{low:.4g} to {high:.4g}", *(f"{one:+.2g}" for one in changes)]
            for name, value, (low, high), changes in zip(*columns, strict=True)
        ]
        yield [["1 % more of", "value", "bounds", *self.reached, "CIEDE2000", "cost"], *rows]

    def paint(self, **asked: Any) -> Paint:
        """All that a laboratory reads off it: the page of `vrte.paint`, whose keywords it takes."""
        return make_paint(dict(self.content), folder=self.folder, **asked)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes recipe, target and what each number does as a page (.html) or as a table of numbers (.csv)."""
        view(self, "save", path)

    def write_scene(self, path: str | os.PathLike[str]) -> None:
        """Writes the scene file (.toml) of the recipe."""
        write_content(self.content, path)


def write_part(part: float | None) -> str:
    """A part of the whole in per cent, "?" where it is not known."""
    return "?" if part is None else f"{100.0 * part:.3f}"


def explain(search: RecipeSearch, trial: Trial, slopes: Array) -> str:
    """Why a target is not met: what misses by how much, and which number at a bound would bring it nearer."""
    held = []
    for index, (one, value) in enumerate(zip(search.parameters, search.find_values(trial.place).tolist(), strict=True)):
        side, bound = one.find_side(value)
        further = search.target.find_missed(trial.bent + side * STEP * slopes[:, index])
        if side and further < (1.0 - 1e-4) * trial.missed:
            held.append(f"{one.name} is held at {bound}")
    missed = ", ".join(search.target.describe_misses(trial.bent))
    return f"{missed}; {', '.join(held) if held else 'no free number brings it nearer: free another'}"


@complete_docstring
def match(
    paint: Source | SceneFamily,
    free: Sequence[str] | Mapping[str, Any],
    lab: Sequence[float] | None = None,
    contrast_ratio: float | None = None,
    gloss_20: float | None = None,
    gloss_60: float | None = None,
    gloss_85: float | None = None,
    cost: Mapping[str, float] | None = None,
    tolerance: float = 1.0,
    gloss_tolerance: float = 3.0,
    over: str | float | None = None,
    geometry: str = Conditions.geometry,
    illuminant: str = "D65",
    observer: int = 10,
    starts: int = 3,
    seed: int = 0,
    densities: Mapping[str, float] | None = None,
    volume_solids: float | None = None,
    wavelengths_um: Any = None,
    layer: int | None = None,
    accuracy: float | None = None,
    nodes: int | None = None,
    folder: str | os.PathLike[str] = ".",
    progress: Progress | None = None,
) -> Match:
    """The loads, thickness, sizes and roughness with which a paint meets a target of colour, hiding and gloss.

    Of all that meet the target the one of the least cost, pigment or money; where none does, the one that misses least.
    Ctrl-C ends the search with the best so far, which a note tells.

    Parameters
    ----------
    paint : path, mapping, str or SceneFamily
        A scene file with a table [paint] or any other whose film lies in one layer, its content, or the name of a ready
        paint, "white gloss". Its numbers are the first start.
    free : sequence of str, or mapping
        The numbers that change: names of pigments, "thickness_um", "roughness", or any as in sweeps; or by each name
        its bounds, [low, high], or a table of ``start``, ``low``, ``high`` and ``spacing``. Without bounds a load goes
        from a tenth to ten times what it is, at most 0.3 of the volume; a thickness from a fifth to five times,
        roughness from 0.001 to 0.6, anything else from half to twice.
    lab : sequence of float, optional
        L*, a*, b* that are wanted.
    contrast_ratio : float, optional
        Y over black over Y over white (0.8) that the film has at least.
    gloss_20, gloss_60, gloss_85 : float, optional
        Gloss units that are wanted.
    cost : mapping, optional
        Prices of a kg by ingredient, pigments and binder, {"rutile": 3.0, "alkyd": 2.0}; what is not named costs
        nothing. Without it the volume of pigments on a square metre is made least.
    tolerance : float, optional
        CIEDE2000 that the colour may be off.
    gloss_tolerance : float, optional
        Gloss units that gloss may be off.
    over : {'base', 'black', 'white'} or float, optional
        What the colour is read over: the paint's own base, a card (albedo 0 or 0.8), or any albedo; by default the own
        base, or black where the paint has none.
    geometry : str, optional
        Of the colour and of the contrast ratio, as for `vrte.appearance`.
    {illuminant, observer}
    starts : int, optional
        How many starts: the paint's own numbers, and others spread over the bounds.
    seed : int, optional
        Of these.
    densities : mapping, optional
        kg/l by ingredient, in place of known ones; "volatile" is what leaves the wet film. Weights are told where
        all are known.
    volume_solids : float, optional
        The part of the wet film's volume that stays, for wet thickness and wet recipe.
    {wavelengths_um, layer, accuracy, nodes, folder, progress}

    Returns
    -------
    Match
        Recipe, values, what was reached, what 1 % more of each does, and why the target is not met, if so.

    Raises
    ------
    SceneError
        For bad input: no target, unknown numbers, bounds the wrong way, prices without densities.
    {MissingExtraError, OSError}

    References
    ----------
    Kraft, DFVLR-FB 88-28 (1988), by `scipy.optimize.minimize` (SLSQP), within a trust region.

    Examples
    --------
    >>> import vrte
    >>> film = {"host_index": 1.5, "particles": "grain", "volume_fraction": 0.05, "thickness_um": 20.0}
    >>> grain = {"index": 2.5, "radius_um": 0.1}
    >>> white = {"particles": {"grain": grain}, "layer": [{"interface": {"above": 1.0, "below": 1.5}}, film]}
    >>> at = [0.42, 0.46, 0.50, 0.54, 0.58, 0.62, 0.66, 0.70]
    >>> found = vrte.match(white, ["layer[2].thickness_um"], contrast_ratio=0.9, wavelengths_um=at, nodes=4, starts=1)
    >>> f"{found.reached['contrast_ratio'][1]:.3f}", found.why
    ('0.900', '')
    """
    target = make_target(lab, contrast_ratio, (gloss_20, gloss_60, gloss_85), tolerance, gloss_tolerance)
    count = check_whole("starts", starts, 1, MOST_STARTS)
    check_whole("seed", seed, 0, 2**64)
    solids = None if volume_solids is None else check_number("volume_solids", volume_solids, 1e-3, 1.0, "0.001 to 1")
    folder = Path(folder)
    if isinstance(paint, SceneFamily):
        paint, folder = paint.source, paint.folder or folder  # type: ignore[assignment]
    if isinstance(paint, str) and not paint.endswith(".toml"):
        paint = find_paint(paint).content
    if not isinstance(paint, str | os.PathLike | Mapping):
        raise SceneError.of("paint", "must be a scene file, its content or a ready paint: a vrte.Scene has no pigments")
    content, folder = read_source(paint, folder)
    typed = list(free)
    if not typed:
        raise SceneError.of("free", "must name one or more numbers of the paint")
    short = list_short_names(content)
    try:
        family = make_family(content, [short.get(name, name) for name in typed], folder)
    except SceneError as error:
        known = ", ".join(name for name in short if name not in PAINT_KEYS or name == "thickness_um")
        raise SceneError(f"{error}; short names here: {known}" if known else str(error), *error.place) from error
    parameters = read_free(free, family.names, family.values)
    conditions = Conditions(geometry, illuminant, observer)
    at = find_wavelengths(content, wavelengths_um, folder)
    conditions.weigh(at)  # what is refused is refused before the work
    asked = {name: one for name, one in {"accuracy": accuracy, "nodes": nodes}.items() if one is not None}
    reader = PaintReader(family, at, target.names, conditions, read_over(over, content), layer, asked)
    notes: list[str] = []
    with note_warnings(notes):
        film = reader.find_film(family.values)
        weighed = find_densities(film, densities)
        prices = Prices(cost, weighed)
        prices.check(film)
        search = RecipeSearch(reader, prices, target, parameters)
        begins = [(one - search.low) / search.range for one in spread_starts(parameters, count, seed)]
        ends: list[Trial | None] = []
        try:
            reader.fix_nodes(search.find_values(begins[0]))
            for index, begin in enumerate(begins):
                ends.append(descend_from(search, begin, share_progress(progress, index, count), needed=index == 0))
        except KeyboardInterrupt:
            if search.best is None:
                raise
            notes.append("Interrupted: the best so far, which need not be the best there is.")
            ends.append(search.best)
        found = make_match(search, begins, ends, weighed, solids)
    return replace(found, notes=(*dict.fromkeys(notes), *note_densities(found.recipe)))


def note_densities(recipe: Sequence[Ingredient]) -> list[str]:
    """Which densities weights lack, in words."""
    names = [one.name for one in recipe if one.density is None]
    needed = f"Weights need densities={{{', '.join(f'{name!r}: ...' for name in names)}}} [kg/l]."
    return [needed] if names else []


def descend_from(search: RecipeSearch, begin: Array, progress: Progress | None, needed: bool) -> Trial | None:
    """The end of a walk; None where a start that was drawn is no paint."""
    try:
        return search.descend(begin, progress)
    except (SceneError, AccuracyError):
        if needed:
            raise
        return None


def make_match(
    search: RecipeSearch,
    begins: Sequence[Array],
    ends: Sequence[Trial | None],
    densities: Mapping[str, float],
    solids: float | None,
) -> Match:
    """The result: the best paint, read once more with all that is around it."""
    reader, target, best = search.reader, search.target, search.best
    assert best is not None
    bounds = np.array([(one.low, one.high) for one in search.parameters])
    values = np.array([float(f"{value:.{DIGITS}g}") for value in search.find_values(best.place)])
    values = np.clip(values, *bounds.T)
    near = search.find_neighbours(values)
    points = [values, *near]
    read = reader.read(points)
    trial = search.judge(search.find_place(values), read[0])
    differences = [target.find_difference(target.bend(one)) for one in read]
    costs = [search.find_cost(one) for one in points]
    rows = np.column_stack([read, differences, costs])  # of the paint, and of each neighbour
    steps = np.array([(point - values)[index] for index, point in enumerate(near)])
    changes = (rows[1:] - rows[0]) * (STEP * np.where(values, np.abs(values), 1.0) / steps)[:, None]
    walks = [
        (one.rank, search.find_values(begin), search.find_values(one.place))
        for begin, one in zip(begins, ends, strict=False)
        if one is not None
    ]
    film, seen = reader.find_film(values), reader.conditions
    reached = {name: (target.wanted[name], float(one)) for name, one in zip(target.names, read[0], strict=True)}
    labs = zip(*(reached[name] for name in "Lab" if name in reached), strict=True)
    colours = (find_colour_of_lab(lab, seen.illuminant, seen.observer) for lab in labs)
    return Match(
        recipe=list_ingredients(film, densities, solids),
        difference=differences[0],
        why="" if trial.is_met else explain(search, trial, search.find_slopes(trial, near, read[1:])),
        names=tuple(reader.family.names),
        values=make_readonly(values),
        bounds=make_readonly(bounds),
        reached=reached,
        cost=costs[0],
        cost_unit=search.prices.describe(film),
        sensitivities=make_readonly(changes),
        thickness_um=film.thickness_um,
        wet_thickness_um=None if solids is None else film.thickness_um / solids,
        starts=make_readonly(np.array([pair for _, *pair in sorted(walks, key=lambda one: one[0])])),
        notes=(),
        content=fill_in(reader.family, values),
        folder=reader.folder,
        colours=dict(zip(("wanted", "found"), colours, strict=False)),
    )


def fill_in(family: SceneFamily, values: Array) -> dict[str, Any]:
    """The content of a file with other numbers: a paint stays one where all of them are its own."""
    if not all(name.startswith("paint.") for name in family.names):
        return family.content_at(values)
    assert isinstance(family.source, Mapping)
    found = copy.deepcopy(dict(family.source))
    for name, value in zip(family.names, values.tolist(), strict=True):
        put(found, split_key(name), value)
    return found


def match_file(
    path: str | os.PathLike[str], scene: str | os.PathLike[str] | None = None, progress: Progress | None = None
) -> Match:
    """The match of a target file (.toml), whose keys are keywords of `vrte.match`; ``scene``: the file of the paint,
    where the target does not name it. Raises SceneError, OSError."""
    keys = (name for name in signature(match).parameters if name not in ("folder", "progress"))
    table = Table((), read_content(path), tuple(keys))
    asked = dict(table.content)
    named, folder = asked.pop("paint", None), Path(path).parent
    if (named is None) == (scene is None):
        words = "is named twice, here and as a scene file" if named else "is missing: a scene file or a ready paint"
        raise SceneError.of("paint", words)
    if isinstance(named, str) and named.endswith(".toml"):
        named = folder / named
    table.required("free", "a list of names, or a table of bounds by names")
    return check_arguments(match)(named if scene is None else scene, folder=folder, progress=progress, **asked)
