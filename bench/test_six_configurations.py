"""The paper's six configurations, and the OpenMP rows, on its Tables 2 and 3: pytest-benchmark cases.

The solves run in the processes of the two SIMD settings, and their time is taken there: the timer of these cases counts
the seconds that the processes report, so that neither the messages between them nor the answers on their way are in it.
"""

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
import scipy

import vrte
from bench.processes import Child, Reply, Task, describe_processes, start_processes
from bench.tables import FULL_SIZE, TABLE_2, TABLE_3, Configuration, Problem, check_answer

from .conftest import ROUNDS, eigenproblems, floor_seconds

THREADS = 2
spent = {"in solves": 0.0}


def seconds_in_solves() -> float:
    """So far, in the processes themselves."""
    return spent["in solves"]


@pytest.fixture(scope="module")
def children() -> Iterator[dict[str, Child]]:
    settings = {each.simd for each in Configuration if each.refusal() is None}
    with start_processes(sorted(settings)) as found:
        yield found


@pytest.fixture(scope="module")
def references(children: dict[str, Child]) -> dict[str, np.ndarray]:
    """What a call that is told nothing else answers, by problem."""
    answers = {each.name: children["full"].solve(Task(each, {}, True)).answer for each in FULL_SIZE}
    return {name: answer for name, answer in answers.items() if answer is not None}


@pytest.fixture(scope="module")
def matrices(gold: vrte.Scene, spheroids: vrte.Scene) -> dict[str, list[np.ndarray]]:
    """The eigenproblems of the LAPACK floor, by problem."""
    return {TABLE_2: eigenproblems(spheroids, 30, 12), TABLE_3: eigenproblems(gold, 40, 41)}


@pytest.mark.benchmark(timer=seconds_in_solves)
@pytest.mark.parametrize("configuration", list(Configuration), ids=lambda each: each.title)
@pytest.mark.parametrize("problem", FULL_SIZE[:2], ids=lambda problem: problem.name)
def test_configuration(
    problem: Problem,
    configuration: Configuration,
    children: dict[str, Child],
    references: dict[str, np.ndarray],
    matrices: dict[str, list[np.ndarray]],
    benchmark: Any,
) -> None:
    """The same answer as the default, Siewert's values among it; timed in turn with the LAPACK floor."""
    if (reason := configuration.refusal()) is not None:
        pytest.skip(reason)
    solve = solver(problem, configuration, children)
    check = check_answer(problem, solve(wants_answer=True), references[problem.name])
    assert check.passed, check
    replies: list[Reply] = []
    floors: list[float] = []
    start = time.perf_counter()
    benchmark.pedantic(
        lambda: replies.append(solve()),
        setup=lambda: floors.append(floor_seconds(matrices[problem.name])),
        rounds=ROUNDS,
        warmup_rounds=1,
    )
    wall, floor = time.perf_counter() - start, float(np.median(floors))
    median = float(benchmark.stats.stats.median)
    benchmark.extra_info |= {
        "ratio_to_floor": median / floor,
        "least_ratio_to_floor": float(benchmark.stats.stats.min) / min(floors),
        "floor_seconds": floor,
        "stage_seconds": stage_medians(replies[1:]),
        "message_seconds": (wall - sum(floors) - sum(reply.seconds for reply in replies)) / len(replies),
        "difference_from_default": check.gap,
        "off_siewert": check.published,
        "orders_by": check.orders_by,
        "versions": [*versions(), *describe_processes(children, [configuration])],
    }
    print(f"\n{benchmark.name}: {1e3 * median:.1f} ms, {median / floor:.2f} x the LAPACK floor of {1e3 * floor:.1f} ms")


def versions() -> list[str]:
    """Of what is not told by the processes."""
    return [f"vrte {vrte.__version__}", f"numpy {np.__version__}", f"scipy {scipy.__version__}"]


def solver(problem: Problem, configuration: Configuration, children: dict[str, Child]) -> Callable[..., Reply]:
    """One solve in the configuration's process, its seconds counted."""

    def solve(wants_answer: bool = False) -> Reply:
        task = Task(problem, configuration.options(THREADS), wants_answer)
        reply = children[configuration.simd].solve(task)
        spent["in solves"] += reply.seconds
        return reply

    return solve


def stage_medians(replies: list[Reply]) -> dict[str, float]:
    """Of each stage of the solver [s]."""
    names = dict.fromkeys(name for reply in replies for name in reply.stages)
    return {name: float(np.median([reply.stages.get(name, 0.0) for reply in replies])) for name in names}
