"""vrte.fit: the numbers of a scene that fit a measurement best, by least squares with the scene's own derivatives."""

import math
import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from vrte.basics.arrays import Array, check_choice, check_whole, make_readonly
from vrte.basics.errors import IndistinguishableWarning, MisfitWarning, SceneError, UnitsWarning, warn_user
from vrte.basics.running import Progress, share_progress
from vrte.calls.spectrum import Source
from vrte.fit import verdict
from vrte.fit.files import Journal, find_fingerprint
from vrte.fit.measurement import Measurement
from vrte.fit.model import make_model
from vrte.fit.problem import (
    ENOUGH,
    JACOBIANS,
    LOSSES,
    MOST_STARTS,
    FitProblem,
    Parameter,
    Point,
    choose_sigma,
    convert_to_steps,
    convert_to_values,
    fit_residuals,
    list_ends,
    read_parameters,
    read_priors,
)
from vrte.fit.result import Fit, Start
from vrte.formats.scene_family import SceneFamily
from vrte.request.how import complete_docstring
from vrte.scene.scene import Scene

NOTHING = 1e-6  # sigma by which a number that does nothing may move any row
NODES_MATTER = 0.1  # sigma by which more nodes may move a row


class FitStep(NamedTuple):
    """Where a fit is after a step, as ``watch`` is told: which start, from 0, how many steps, the free numbers by name,
    chi2, and what the scene shows there (rows,)."""

    start: int
    step: int
    values: dict[str, float]
    chi2: float
    predicted: Any


Watch = Callable[[FitStep], None]


@complete_docstring
def fit(
    measurement: Measurement,
    scene: Source | Scene | SceneFamily,
    free: Sequence[str] | Mapping[str, Any],
    priors: Mapping[str, Any] | None = None,
    bounds: Mapping[str, Any] | None = None,
    starts: int = 1,
    seed: int = 0,
    loss: str = "linear",
    jacobian: str = "exact",
    nodes: int | None = None,
    accuracy: float | None = None,
    wavelengths_um: Any = None,
    most_steps: int = 100,
    threads: int | None = None,
    folder: str | os.PathLike[str] = ".",
    progress: Progress | None = None,
    watch: Watch | None = None,
    resume: str | os.PathLike[str] | None = None,
) -> Fit:
    """The numbers of a scene that fit a measurement best, with error bars and what the data cannot tell.

    Least squares within bounds (trust region reflective). Ctrl-C ends it with the best so far, marked ``interrupted``.

    Parameters
    ----------
    measurement : Measurement
        What was measured, as `vrte.read_measurement` reads it.
    scene : path, mapping, Scene or SceneFamily
        A scene file, its content, or a scene; where wavelengths were measured a file or its content, whose
        ``wavelength_um`` is set to each. What is asked in it, [brdf] and [field], plays no part.
    free : sequence of str, or mapping
        Names of the numbers that change, as in sweeps, "layer[1].thickness", "particles.gold.radius_um", of
        several layers "layer[dust].thickness"; or by each name its bounds, [low, high], or a table of ``start``,
        ``low``, ``high`` and ``spacing`` ("linear", or "log" for steps in the logarithm). What is left out is as the
        scene has it; bounds are those of a base's number where it has some, otherwise 0 below where the start is not,
        and 1 above for shares such as albedo.
    priors : mapping, optional
        By names a mean and a standard deviation that are known beforehand: each counts like one more row.
    bounds : mapping, optional
        By names (low, high), in place of those in ``free``.
    starts : int, optional
        How many starts: the given one, and others spread over the bounds (a Latin hypercube), which must then be
        finite; the best is kept, all are told.
    seed : int, optional
        Of these.
    loss : {'linear', 'soft_l1'}, optional
        Sum of squares, or the robust 2 (sqrt(1 + r^2) - 1), which minds outliers less.
    jacobian : {'exact', 'differences'}, optional
        How derivatives are found: those of `vrte.brdf`, or by differences of all that the model does, to check them.
    nodes : int, optional
        Nodes in each hemisphere; default: the scene file's, or as many as the accuracy takes at the start, the same all
        through; whether they are enough at the end is looked at.
    accuracy : float, optional
        Of the solves, relative to the largest radiance; default: the scene file's, or 1e-5.
    wavelengths_um : sequence of float, optional
        At which colours are worked out, ascending [um]; default: those that the file lists, or 16 from 0.40 to 0.70, as
        far as all substances are known there; beyond, reflectance stays as at the end, which a note tells.
    most_steps : int, optional
        How many trials each start has at most.
    {threads, folder, progress}
    watch : callable, optional
        Called with a `vrte.fit.run.FitStep` after each step: numbers, chi2, and what the scene shows there.
    resume : path, optional
        A file in which the fit notes after each step how far it has come: the same call goes on from there.

    Returns
    -------
    Fit
        Values, errors, covariance, residuals and what the data cannot tell; ``print`` shows the main ones.

    Raises
    ------
    SceneError
        For bad input: data outside the model, a number that does nothing to the data, fewer rows than free numbers,
        bounds that exclude the start; for a file to resume that is another fit's.
    {OSError}

    Warns
    -----
    MisfitWarning
        Where residuals as large, or with as few changes of sign, come by chance in less than 1 % of fits. Where they
        are too large, errors grow by the root of the reduced chi-square.
    UnitsWarning
        Of such a fit, and where there is no sigma: angles that look like cosines or radians, factors like per cent.
    IndistinguishableWarning
        Where two numbers cannot be told apart, or a combination of them from these data.

    References
    ----------
    Branch, Coleman and Li, SIAM J. Sci. Comput. 21 (1999), 1, by `scipy.optimize.least_squares`.

    Examples
    --------
    >>> import numpy as np
    >>> import vrte
    >>> rows = vrte.Measurement("total_reflectance", 0.0, 0.001, theta_i_deg=[0.0, 30.0, 60.0])
    >>> layer = {"phase": "rayleigh", "albedo": 1.0, "thickness": 0.5}
    >>> measured = rows.measure(rows.predict({"layer": [layer]}, nodes=4))
    >>> guess = {"layer": [{**layer, "thickness": 0.3}]}
    >>> found = vrte.fit(measured, guess, ["layer[1].thickness"], nodes=4)
    >>> round(found.values.item(), 6), round(found.errors.item(), 4)
    (0.5, 0.0015)
    """
    check_choice("loss", loss, LOSSES)
    check_choice("jacobian", jacobian, JACOBIANS)
    count = check_whole("starts", starts, 1, MOST_STARTS)
    most = check_whole("most_steps", most_steps, 1, 100_000)
    check_whole("seed", seed, 0, 2**64)
    names = list(free)
    if not names or len(set(names)) < len(names):
        raise SceneError.of("free", "must be one or more names of numbers of the scene, each once")
    model = make_model(measurement, scene, names, nodes, accuracy, wavelengths_um, folder, threads, jacobian)
    begun = dict(zip(names, model.start.tolist(), strict=True))
    parameters = read_parameters(free, bounds, begun, model.source.limits)
    problem = FitProblem(model, parameters, read_priors(priors, names), choose_sigma(model), loss)
    first = np.array([one.start for one in parameters])
    rows, known = len(measurement), int(problem.known.sum())
    if rows + known < len(names):
        words = f"{rows} row{'s'[: rows != 1]}" + (f" and {known} priors" if known else "")
        raise SceneError(f"measurement has {words}, too few for {len(names)} free numbers: at least as many are needed")
    begins = spread_starts(parameters, count, seed)
    how = {"starts": count, "seed": seed, "loss": loss}
    journal = Journal(resume, "" if resume is None else find_fingerprint(problem, how))
    model.nodes = model.nodes or journal.nodes
    model.converge_on_nodes(first)
    check_slopes(problem, first)
    search, interrupted = Search(problem, journal, most, watch), False
    try:
        for index, begin in enumerate(begins):
            search.descend(index, begin, share_progress(progress, index, count))
        search.refine(isinstance(nodes, int) or "nodes" in model.options)
    except KeyboardInterrupt:
        if search.best is None:
            raise
        interrupted = True
    return make_fit(problem, search, interrupted)


def check_slopes(problem: FitProblem, values: Array) -> None:
    """Whether each free number does something to the data, or has a prior. Raises SceneError."""
    point = problem.find_point(values, True)
    assert point.slopes is not None
    ranges = np.array([one.high - one.low for one in problem.parameters])
    effect = np.abs(point.slopes / problem.sigma[:, None]).max(axis=0) * verdict.find_scales(values, ranges)
    for one, moved in zip(problem.parameters, effect.tolist(), strict=True):
        if not moved > NOTHING:
            raise SceneError(f"free: {one.name} does nothing to these data", "free", one.name)


def spread_starts(parameters: Sequence[Parameter], count: int, seed: int) -> list[Array]:
    """The given start, and others that share the bounds evenly between them, in coordinates. Raises SceneError."""
    first = convert_to_steps(parameters, [one.start for one in parameters])
    if count == 1:
        return [first]
    ends = list_ends(parameters)
    for one, pair in zip(parameters, ends, strict=True):
        if not np.isfinite(pair).all():
            above = " above 0" if one.is_log else ""
            raise SceneError(f"starts: {one.name} needs finite bounds{above} for several starts", "starts")
    generator = np.random.default_rng(seed)  # of every number, each of the shares of its range once
    order = np.stack([generator.permutation(count - 1) for _ in parameters], axis=1)
    spread = (order + generator.random(order.shape)) / (count - 1)
    return [first, *(ends[:, 0] + spread * (ends[:, 1] - ends[:, 0]))]


class Search:
    """Least squares from several starts; ``best``: the point of the least sum so far, with derivatives where it has as
    little, so far as a descent can tell."""

    def __init__(self, problem: FitProblem, journal: Journal, most_steps: int, watch: Watch | None) -> None:
        self.problem, self.journal, self.most_steps, self.watch = problem, journal, most_steps, watch
        self.best: Point | None = None
        self.cost = math.inf

    def descend(self, index: int, begin: Array, progress: Progress | None) -> None:
        """One start to its end, or on from where it was. Raises SceneError where the model takes no such start."""
        problem, journal, before, step = self.problem, self.journal, self.problem.model.solves, 0
        if index < len(journal.finished):
            self.keep(problem.find_point(np.array(journal.finished[index].found), True))
            return
        start = convert_to_values(problem.parameters, begin)

        def report(point: Point) -> None:
            nonlocal step
            self.keep(point)
            journal.note(point.values.tolist(), problem.model.nodes)
            if self.watch is not None:
                values_by_name = dict(zip(problem.model.names, point.values.tolist(), strict=True))
                chi2 = problem.measure(problem.join(point))
                self.watch(FitStep(index, step, values_by_name, chi2, make_readonly(point.predicted.copy())))
            step += 1
            if progress is not None:
                progress(min(step, self.most_steps), self.most_steps)

        from_here = begin if journal.here is None else convert_to_steps(problem.parameters, journal.here)
        everything = np.ones(begin.size, bool)
        point, chi2, converged = fit_residuals(problem, from_here, everything, self.most_steps, report)
        self.keep(problem.find_point(point.values, True))
        ended = "converged" if converged else f"stopped after {self.most_steps} trials"
        if progress is not None:
            progress(self.most_steps, self.most_steps)
        solves = problem.model.solves - before
        journal.finished.append(Start(tuple(start.tolist()), tuple(point.values.tolist()), chi2, solves, ended))
        journal.note(None, problem.model.nodes)

    def keep(self, point: Point) -> None:
        """Remembers a point that is better than all before."""
        cost, known = self.problem.measure(self.problem.join(point)), point.slopes is not None
        if cost < self.cost or (known and cost <= (1.0 + ENOUGH) * self.cost):
            self.best, self.cost = point, cost

    def refine(self, fixed: bool) -> None:
        """More nodes, and some more steps, where those that were chosen at the start are too few at the end."""
        model = self.problem.model
        if fixed or self.best is None or model.nodes is None:
            return
        needed = model.find_nodes(self.best.values)
        if needed is None or needed <= model.nodes:
            return
        before, model.nodes = model.nodes, needed
        values, old = self.best.values, self.best.predicted
        self.problem.kept.clear()
        moved = float(np.abs((model.predict(values) - old) / self.problem.sigma).max())
        model.notes.append(f"{before} nodes were chosen at the start; {needed} at the end, which move no row by more "
                           f"than {moved:.2g} sigma")  # fmt: skip
        self.best, self.cost = None, math.inf
        if moved > NODES_MATTER:
            begin, everything = convert_to_steps(self.problem.parameters, values), np.ones(values.size, bool)
            values = fit_residuals(self.problem, begin, everything, self.most_steps, self.keep)[0].values
        self.keep(self.problem.find_point(values, True))


def make_fit(problem: FitProblem, search: Search, interrupted: bool) -> Fit:
    """The result, with errors and what the data cannot tell. Warns (IndistinguishableWarning)."""
    best, model, given = search.best, problem.model, problem.model.measurement
    assert best is not None
    best = best if best.slopes is not None else problem.find_point(best.values, True)
    assert best.slopes is not None
    residuals, slopes = problem.join(best), problem.join_slopes(best)
    chi2, freedom = float(residuals @ residuals), residuals.size - len(problem.parameters)
    least = problem.measure(residuals)  # chi2, or what a robust loss makes of it
    p_value = verdict.find_p_value(least, freedom) if given.has_sigma else math.nan
    faults = [] if interrupted else list_faults(given, -residuals[: len(given)], chi2, least, freedom, p_value)
    notes = [*faults, *model.notes]
    grown = math.sqrt(least / freedom) if p_value < verdict.UNLIKELY else 1.0
    scale = 1.0
    if not given.has_sigma:
        scale = math.sqrt(chi2 / freedom) if freedom and chi2 else math.nan
        scaled = f"the root of the reduced chi-square{'' if freedom else ', which needs more rows than free numbers'}"
        notes.append(f"the measurement has no sigma: rows of a quantity count alike, and errors are scaled by {scaled}")
    if problem.loss != "linear":  # what outliers count for
        slopes = slopes * ((1.0 + residuals**2) ** -0.25)[:, None]
    rows = len(given)
    unit = scale if math.isfinite(scale) else 1.0
    slopes = np.concatenate([slopes[:rows] / unit, slopes[rows:]])
    ranges = np.array([one.high - one.low for one in problem.parameters])
    scales = verdict.find_scales(best.values, ranges)
    covariance = verdict.find_covariance(slopes, scales) * (scale / unit) * grown**2
    singular, blind = verdict.find_blind_spots(model.names, slopes, best.values, scales)
    notes += list_bounds(problem.parameters, best.values)
    if interrupted:
        notes.append("interrupted: the best so far, which need not be the best there is")
    alike = verdict.list_alike(model.names, verdict.find_correlations(covariance))
    for one, other, correlation in alike:
        words = f"{one} and {other} cannot be told apart by these data (correlation {correlation:.4f})"
        warn_user(f"{words}: fix one, or give it a prior", IndistinguishableWarning)
        blind.append(words)
    if blind and not alike:
        warn_user(f"the data cannot tell: {'; '.join(blind)}", IndistinguishableWarning)
    return Fit(
        names=tuple(model.names),
        values=best.values,
        errors=np.sqrt(np.diag(covariance)),
        covariance=covariance,
        measurement=given,
        predicted=best.predicted,
        sigma=problem.sigma * unit,
        slopes=best.slopes,
        chi2=chi2,
        degrees_of_freedom=freedom,
        p_value=p_value,
        error_scale=grown,
        singular_values=singular,
        blind_spots=tuple(blind),
        notes=tuple(notes),
        starts=tuple(sorted(search.journal.finished, key=lambda one: one.chi2)),
        nodes=model.nodes,
        interrupted=interrupted,
        problem=problem,
    )


def list_faults(
    given: Measurement, residuals: Array, chi2: float, least: float, freedom: int, p_value: float
) -> list[str]:
    """Why a model does not fit, in words; ``residuals`` (rows,) in sigmas, ``least``: the sum that was minimized. Warns
    (MisfitWarning, UnitsWarning)."""
    sound = p_value >= verdict.UNLIKELY
    chance, pattern = verdict.describe_pattern(given, residuals)
    faults = []
    if p_value < verdict.UNLIKELY:
        found = f"chi2 {chi2:.4g} with {freedom} degrees of freedom", verdict.write_chance(p_value)
        grown = f"errors are {math.sqrt(least / freedom):.3g} times larger for it"
        faults = ["the model does not fit: {} comes by chance in {} of fits; {}".format(*found, grown), *pattern]
    elif chance < verdict.UNLIKELY and np.sqrt(np.mean(residuals**2)) > verdict.NO_NOISE[not given.has_sigma]:
        faults, sound = [f"the model may not fit: {pattern[0]}"], False
    guesses = [] if sound else [*verdict.guess_units(given)]
    for words in guesses:
        warn_user(words, UnitsWarning)
    if faults:
        warn_user("; ".join(faults), MisfitWarning)
    return [*faults, *guesses]


def list_bounds(parameters: Sequence[Parameter], values: Array) -> list[str]:
    """Which numbers have reached a bound, in words."""
    pairs = [(one.name, one.find_side(value)[1]) for one, value in zip(parameters, values.tolist(), strict=True)]
    return [f"{name} is at {bound}: its error knows nothing of the bound" for name, bound in pairs if bound]
