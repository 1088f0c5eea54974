"""vrte beside the peers that pip installs: same scene, same outputs, one thread each.

``python -m bench.peers`` prints the table, ``-o docs/reference/peers.md`` writes the page that carries it. Both
need the extra "bench". The time is the process's CPU time: cold, of a scene never seen, and warm, of one solved again.
"""

import argparse
import functools
import inspect
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

import vrte
from bench import cases
from bench import other_codes as codes
from bench.cases import SPHEROIDS
from bench.other_codes import Asked
from vrte.basics.arrays import Array
from vrte.basics.errors import MissingExtraError
from vrte.formats.atomic import write_atomically

Solve = Callable[[], Array]  # radiances (tau, mu, phi, Stokes compared)

# how many times faster vrte has to be, by streams
TARGETS: dict[str, dict[int, float]] = {
    "nanodisort": {32: 2.5, 64: 4.0, 128: 4.0},
    "sasktran2": {32: 25.0, 60: 25.0},
}
ACCURACY = 1e-8  # where the azimuthal series may stop, for every code that can be told
# keywords of vrte.radiance that the comparison wants; a version that lacks one goes without
WANTED: dict[str, Any] = {"accuracy": ACCURACY}
REFERENCE_STREAMS = 256
ROUNDS = (5, 41)  # at least and at most, odd
SECONDS = 3.0  # for the rounds of one scene, as far as ROUNDS lets


@dataclass(frozen=True, eq=False)
class Problem:
    """One homogeneous layer over black ground, by its name in `bench.cases`, lit by an unpolarized beam along
    mu0 = 0.6, and the radiances wanted of it.

    ``flux`` is the beam's, perpendicular to it; ``mu``, ``phi`` [deg] and ``tau`` are as in `vrte.radiance`; ``stokes``
    says how many of I, Q, U are compared.
    """

    peer: str
    name: str
    scene: str
    streams: tuple[int, ...]
    flux: float
    mu: Array
    phi: Array
    tau: tuple[float, ...]
    stokes: int

    @functools.cached_property
    def asked(self) -> Asked:
        """The same for any code: coefficients, albedo and thickness are read off its scene."""
        scene, beam = cases.find_scene(self.scene), np.array([self.flux, 0.0, 0.0, 0.0])
        return Asked(scene, 0.6, beam, self.mu, self.phi, np.array(self.tau))

    def make_scene(self) -> vrte.Scene:
        """The scene made anew from its coefficients, which is part of what vrte takes for one never seen."""
        (layer,) = self.asked.scene.layers
        matrix = layer.phase_matrix
        made = vrte.PhaseMatrix(matrix.a1) if matrix.is_scalar else vrte.PhaseMatrix(*matrix.coefficients.T)
        return vrte.Scene([vrte.Layer(made, layer.albedo, layer.thickness)])


Prepare = Callable[[Problem, int], Solve]  # set-up, for so many streams


@dataclass(frozen=True)
class Row:
    """What one code made of one problem: medians in milliseconds of CPU, errors relative to the largest I.

    ``cold_ms``: all that a scene never seen takes; ``ratio`` of the warm solves, ``cold_ratio`` of the cold ones, over
    vrte's; ``target``: what the ratio has to be at least, or ``at_most``.
    """

    problem: str
    streams: int | None
    code: str
    cold_ms: float
    cold_ratio: float
    solve_ms: float
    ratio: float
    errors: tuple[float, ...]
    target: float | None
    at_most: bool = False


# scalar, albedo 0.99, enough terms for g**terms to be below 1e-15: I going up and down at the top and at the bottom, 20
# cosines, 5 azimuths; and I, Q, U leaving the top, at the ten cosines and three azimuths of Siewert's tables
UP = np.linspace(0.1, 1.0, 10)
BOTH_WAYS, FIVE = np.concatenate([-UP[::-1], UP]), np.linspace(0.0, 180.0, 5)
IIA, THREE = "Siewert (2000), problem IIA", np.array([0.0, 90.0, 180.0])
HG = "Henyey-Greenstein, g"
PROBLEMS = (
    Problem(
        *("nanodisort", f"{HG} 0.75, thickness 1", "HG 0.75, 128 terms", (32, 64), 1.0, BOTH_WAYS, FIVE, (0.0, 1.0), 1)
    ),
    Problem(
        *("nanodisort", f"{HG} 0.9, thickness 100", "HG 0.9, 384 terms", (64, 128)),
        *(1.0, BOTH_WAYS, FIVE, (0.0, 100.0), 1),
    ),
    Problem("sasktran2", IIA, "spheroids", (32, 60), np.pi, UP, THREE, (0.0,), 3),
)

# Siewert (2000), JQSRT 64, 227, tables 2 to 9: I, Q, U up at tau 0, phi 90, mu 0.2, 0.5 and 0.8
SIEWERT_QUOTED = {
    0.2: (1.69216e-1, 6.96260e-3, -9.12219e-3),
    0.5: (1.24626e-1, 5.12123e-3, -8.04140e-3),
    0.8: (7.50297e-2, 3.11982e-3, -4.21322e-3),
}


def with_vrte(problem: Problem, streams: int, **keywords: Any) -> Solve:
    """vrte, which carries all four Stokes parameters wherever Q or U can arise."""
    asked, scene = problem.asked, problem.make_scene()
    keywords = {"nodes": streams // 2, "threads": 1, **keywords}

    def solve() -> Array:
        field = vrte.radiance(scene, asked.mu0, asked.stokes, asked.mu, asked.phi, asked.tau, **keywords)
        return field.stokes[..., : problem.stokes]

    return solve


def wanted_keywords() -> dict[str, Any]:
    """Those of WANTED that this version of vrte.radiance has."""
    known = inspect.signature(vrte.radiance).parameters
    return {name: value for name, value in WANTED.items() if name in known}


def with_nanodisort(problem: Problem, streams: int, accuracy: float = ACCURACY) -> Solve:
    """nanodisort (cdisort), its arrays made beforehand."""
    asked = problem.asked
    state = codes.make_nanodisort_state(asked, streams, accuracy)
    return lambda: codes.solve_nanodisort(asked, state).stokes[..., : problem.stokes]


def with_sasktran2(problem: Problem, streams: int, orders: int | None = None) -> Solve:
    """sasktran2, engine and atmosphere made beforehand; ``orders`` fixes its number of azimuthal orders."""
    asked = problem.asked
    engine, geometry, config = codes.make_sasktran2_engine(asked, streams, orders)
    atmosphere = codes.make_sasktran2_atmosphere(asked, geometry, config)
    return lambda: codes.solve_sasktran2(asked, engine, atmosphere).stokes[..., : problem.stokes]


# by the peer a problem is for, then by the name in the table
CODES: dict[str, dict[str, Prepare]] = {
    "nanodisort": {"nanodisort": with_nanodisort},
    "sasktran2": {
        "sasktran2": with_sasktran2,
        "sasktran2, 12 orders": functools.partial(with_sasktran2, orders=len(SPHEROIDS)),
    },
}


@functools.cache
def reference(problem: Problem) -> Array:
    """What errors are counted from, on 256 streams: nanodisort's own answer; for Siewert's scene vrte's by doubling."""
    if problem.peer == "nanodisort":
        return with_nanodisort(problem, REFERENCE_STREAMS, accuracy=0.0)()
    return with_vrte(problem, REFERENCE_STREAMS, algorithm="doubling")()


def check_of_reference(problem: Problem) -> float:
    """How far the reference is from an independent answer, relative to the largest I.

    That is vrte on 256 streams; for Siewert's scene the nine numbers of his tables that are quoted above.
    """
    there = reference(problem)
    if problem.peer == "nanodisort":
        other = with_vrte(problem, REFERENCE_STREAMS)()
    else:
        indices = [int(np.argmin(np.abs(problem.mu - mu))) for mu in SIEWERT_QUOTED]
        other = there.copy()
        other[0, indices, list(problem.phi).index(90.0)] = list(SIEWERT_QUOTED.values())
    return max(errors(problem, other))


def errors(problem: Problem, radiances: Array) -> tuple[float, ...]:
    """The largest differences from the reference in I, Q, U, relative to its largest I."""
    there = reference(problem)
    return tuple((np.abs(radiances - there).max(axis=(0, 1, 2)) / there[..., 0].max()).tolist())


def cpu_ms(call: Callable[[], Any]) -> float:
    """The process's CPU time of one call, all its threads together."""
    start = time.process_time()
    call()
    return 1e3 * (time.process_time() - start)


def time_in_turn(calls: dict[Any, Callable[[], Any]]) -> tuple[dict[Any, float], dict[Any, float]]:
    """CPU times [ms] by name: of the first call of each, and the medians of as many rounds of all as fit."""
    first = {name: cpu_ms(call) for name, call in calls.items()}
    taken: dict[Any, list[float]] = {name: [] for name in calls}
    for _ in range(rounds_for(sum(first.values()))):
        for name, call in calls.items():
            taken[name].append(cpu_ms(call))
    return first, {name: statistics.median(found) for name, found in taken.items()}


def rounds_for(milliseconds: float) -> int:
    """How many rounds of that length fit, odd."""
    fewest, most = ROUNDS
    return int(np.clip(1e3 * SECONDS / max(milliseconds, 1e-3), fewest, most)) // 2 * 2 + 1


def compare(problem: Problem, streams: int) -> list[Row]:
    """vrte, then its peers, in turn, BLAS with one thread: a scene never seen, from its coefficients, and one solved
    again."""
    codes: dict[str, Prepare] = {"vrte": functools.partial(with_vrte, **wanted_keywords()), **CODES[problem.peer]}
    with threadpool_limits(1):
        solves = {code: prepare(problem, streams) for code, prepare in codes.items()}
        answers = {code: solve() for code, solve in solves.items()}
        cold = {("cold", code): lambda prepare=prepare: prepare(problem, streams)() for code, prepare in codes.items()}
        _, medians = time_in_turn(cold | {("warm", code): solve for code, solve in solves.items()})
    cold_ms, warm_ms = ({code: medians[state, code] for code in codes} for state in ("cold", "warm"))
    return [
        Row(
            *(problem.name, streams, code, cold_ms[code], cold_ms[code] / cold_ms["vrte"], warm_ms[code]),
            *(warm_ms[code] / warm_ms["vrte"], errors(problem, answers[code]), TARGETS.get(code, {}).get(streams)),
        )
        for code in codes
    ]


def shortfalls(rows: list[Row]) -> list[str]:
    """What one comparison, vrte's row first, misses: a sentence for each; only codes with a target count."""
    ours, found = rows[0], []
    for row in rows[1:]:
        if row.target is None:
            continue
        where = f"{row.problem}, {row.streams} streams, {row.code}"
        if row.at_most:
            if row.ratio > row.target:
                found.append(f"{row.problem}, {row.code}: {row.ratio:.2f} times the plain solve, wanted {row.target:g}")
            continue
        if row.ratio < row.target:
            found.append(f"{where}: vrte is {row.ratio:.2f} x as fast, wanted {row.target:g} x")
        found += [
            f"{where}: error in {name} {mine:.1e}, the peer's {theirs:.1e}"
            for name, mine, theirs in zip("IQU", ours.errors, row.errors, strict=False)
            if mine > theirs
        ]
    return found


def main(arguments: list[str] | None = None) -> int:
    """Prints the page, or writes it: 0, or 1 with a sentence where a peer is missing or the file cannot be written."""
    from bench.features import FEATURES, measure_feature
    from bench.peers_page import page
    from bench.study import describe_load

    parser = argparse.ArgumentParser(prog="python -m bench.peers", description="vrte beside nanodisort and sasktran2")
    parser.add_argument("-o", "--output", type=Path, help="write the page there, docs/reference/peers.md say")
    options = parser.parse_args(arguments)
    comparisons, before = [], describe_load()
    try:
        for peer in TARGETS:
            codes.import_peer(peer)
        for problem in PROBLEMS:
            for streams in problem.streams:
                print(f"{problem.name}, {streams} streams", file=sys.stderr, flush=True)
                comparisons.append(compare(problem, streams))
        for name in FEATURES:
            print(name, file=sys.stderr, flush=True)
            comparisons.append(measure_feature(name))
        with threadpool_limits(1):
            checks = {problem: check_of_reference(problem) for problem in PROBLEMS}
        text = page(comparisons, checks, before)
        if options.output is None:
            print(text)
        else:
            with write_atomically(options.output) as part:
                part.write_text(text, encoding="utf-8")
    except (MissingExtraError, OSError) as reason:
        print(f"error: {reason}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    # under its own name, so that the page's imports find these very classes
    from bench.peers import main as run

    sys.exit(run())
