"""Wall times of solves, in total and step by step, the configurations taking turns."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.calls.brdf import brdf
from vrte.calls.radiance import radiance
from vrte.studies.cost.claims import TOTAL
from vrte.studies.cost.sweeps import MU0, PHI, Axis, Point, cosines
from vrte.studies.tables.configurations import Configuration as Papers

REST = "outside the steps"
# stages of the solver that are part of a step of the paper; any other stage is a step by its own name
STEP_OF_STAGE = {
    "fourier sum": "reconstruction",  # (1:12)
    "single scattering": "reconstruction",  # Q of (1:38)
}
FEWEST_ROUNDS, MOST_ROUNDS = 3, 15
SECONDS_A_POINT = 1.5  # of all configurations and rounds together, where 3 rounds fit in
SECONDS_A_POINT_QUICK = 0.1
PAPERS = (Papers.TWO, Papers.FIVE)  # that the paper's figures show; all by its own method, modes
OPENMP = Papers.OPENMP_FULL
Tick = Callable[[int, int, str], None]


@dataclass(frozen=True)
class Configuration:
    """A way to run the solver: its name, and what `radiance` and `brdf` are told."""

    name: str
    options: dict[str, Any]


@dataclass(frozen=True)
class Measurement:
    """One solve: wall ``seconds`` in total and of each stage of the solver, by the names in its diagnostics.

    ``orders_solved`` counts the Fourier orders with multiple scattering.
    """

    axis: str
    value: float
    point: Point
    configuration: str
    round: int
    seconds: float
    orders_solved: int
    stages: dict[str, float] = field(default_factory=dict)


def configurations(threads: int = 2) -> tuple[Configuration, ...]:
    """The paper's 2 and, where there is an OpenCL device, 5; OpenMP if more than one of its ``threads`` is asked for.

    Raises SceneError where the compiled core has no OpenMP but more threads are asked for.

    >>> [configuration.name for configuration in configurations(1)][:1]
    ['configuration 2']
    """
    if threads > 1 and not _core.HAS_OPENMP:
        raise SceneError("the compiled core was built without OpenMP: only --threads 1 can be measured")
    found = [Configuration(each.title, each.options(1)) for each in PAPERS if each.refusal() is None]
    if threads > 1:
        found.append(Configuration(f"OpenMP, {threads} threads", OPENMP.options(threads)))
    return tuple(found)


def left_out() -> list[str]:
    """Why one of the paper's is not among them."""
    return [reason for each in PAPERS if (reason := each.refusal()) is not None]


def solve(point: Point, configuration: Configuration) -> dict[str, Any]:
    """Solves and returns the diagnostics. The one call of the solver."""
    common: dict[str, Any] = {"phi": PHI, "nodes": point.nodes, **configuration.options}
    out = cosines(point.outgoing)
    if point.incident is None:
        return radiance(point.scene, mu0=MU0, mu=out, **common).diagnostics
    return brdf(point.scene, mu_i=cosines(point.incident), mu_o=out, **common).diagnostics


def measure(
    axes: Sequence[Axis],
    configurations: Sequence[Configuration],
    seconds_a_point: float = SECONDS_A_POINT,
    tick: Tick = lambda done, total, name: None,
) -> list[Measurement]:
    """Every point of every axis in one round after another, the configurations in turn: 3 rounds, and up to 15 of
    points that take less than ``seconds_a_point`` in all.

    Whole rounds, so that a disturbance meets a round of many points and not all rounds of one. ``tick(done, total,
    name)`` before each point. One solve of each configuration beforehand is not counted.
    """
    places = [(axis, point) for axis in axes for point in axis.points]
    for configuration in configurations:
        solve(places[0][1], configuration)
    wanted = [FEWEST_ROUNDS] * len(places)
    found: list[Measurement] = []
    done = 0
    for number in range(MOST_ROUNDS):
        for place, (axis, point) in enumerate(places):
            if number >= wanted[place]:
                continue
            tick(done, sum(wanted), f"{axis.name} {axis.value(point)}")
            start = time.perf_counter()
            found += [measured(axis, point, configuration, number) for configuration in configurations]
            if number == 0:
                wanted[place] = rounds(time.perf_counter() - start, seconds_a_point)
            done += 1
    tick(done, done, "")
    return found


def rounds(first: float, available: float) -> int:
    """How many fit into the ``available`` seconds if the first is typical, from FEWEST_ROUNDS to MOST_ROUNDS.

    >>> rounds(0.3, 1.5), rounds(2.0, 1.5), rounds(1e-6, 1.5)
    (5, 3, 15)
    """
    return int(min(max(available / first, FEWEST_ROUNDS), MOST_ROUNDS))


def measured(axis: Axis, point: Point, configuration: Configuration, number: int) -> Measurement:
    """One solve, timed by its own diagnostics."""
    made = solve(point, configuration)
    return Measurement(
        axis=axis.name,
        value=float(axis.value(point)),
        point=point,
        configuration=configuration.name,
        round=number,
        seconds=made["wall_seconds"],
        orders_solved=made["orders"],
        stages={name: clock["wall_seconds"] for name, clock in made["stages"].items()},
    )


def steps(measurement: Measurement) -> dict[str, float]:
    """Seconds of the total, of each step, and of what no stage accounts for.

    >>> found = Measurement("nodes", 8.0, Point(), "", 0, 4.0, 1, {"fourier sum": 1.0, "reconstruction": 2.0})
    >>> steps(found)
    {'total': 4.0, 'reconstruction': 3.0, 'outside the steps': 1.0}
    """
    found = {TOTAL: measurement.seconds}
    for stage, seconds in measurement.stages.items():
        step = STEP_OF_STAGE.get(stage, stage)
        found[step] = found.get(step, 0.0) + seconds
    found[REST] = max(0.0, measurement.seconds - sum(measurement.stages.values()))
    return found


@dataclass(frozen=True, eq=False)
class Series:
    """Of one step in one configuration, along an axis: x, and median, least and greatest seconds, (points,) each."""

    x: Array
    seconds: Array
    least: Array
    greatest: Array


def series(measurements: Sequence[Measurement], axis: str, configuration: str) -> dict[str, Series]:
    """Every step's, the total first, what is outside the steps last; 0 seconds where a step did not run."""
    chosen = [found for found in measurements if (found.axis, found.configuration) == (axis, configuration)]
    by_value: dict[float, list[dict[str, float]]] = {}
    for found in chosen:
        by_value.setdefault(found.value, []).append(steps(found))
    names = list(dict.fromkeys(name for solves in by_value.values() for solve in solves for name in solve))
    names.sort(key=lambda name: (name != TOTAL, name == REST))
    x = np.array(sorted(by_value))
    result = {}
    for name in names:
        times = [np.array([solve.get(name, 0.0) for solve in by_value[value]]) for value in x.tolist()]
        median, least, greatest = (np.array([of(row) for row in times]) for of in (np.median, np.min, np.max))
        result[name] = Series(x, median, least, greatest)
    return result
