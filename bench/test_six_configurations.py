"""The paper's six configurations, and the OpenMP rows, on its Tables 2 and 3: pytest-benchmark cases.

Solves run in the processes of the two SIMD settings. The timer of these cases adds up the seconds that the processes
report, so that messages between processes are not timed.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import scipy

import vrte
from bench.processes import Child, Reply, Task, describe_processes, start_processes
from bench.tables import FULL_SIZE, TABLE_2, TABLE_3, Configuration, Problem, check_answer

from .conftest import ROUNDS, eigenproblems, floor_seconds

THREADS = 2
SECONDS_OF_SOLVES = [0.0]


@pytest.fixture(scope="module")
def children() -> Iterator[dict[str, Child]]:
    with start_processes(sorted({each.simd for each in Configuration if each.refusal() is None})) as found:
        yield found


@pytest.fixture(scope="module")
def references(children: dict[str, Child]) -> dict[str, Any]:
    """The answer of a call without options, by problem."""
    return {each.name: children["full"].solve(Task(each, {}, True)).answer for each in FULL_SIZE[:2]}


@pytest.fixture(scope="module")
def matrices(gold: vrte.Scene, spheroids: vrte.Scene) -> dict[str, list[np.ndarray]]:
    """The eigenproblems of the LAPACK floor, by problem."""
    return {TABLE_2: eigenproblems(spheroids, 30, 12), TABLE_3: eigenproblems(gold, 40, 41)}


@pytest.mark.benchmark(timer=lambda: SECONDS_OF_SOLVES[0])
@pytest.mark.parametrize("configuration", list(Configuration), ids=lambda each: each.title)
@pytest.mark.parametrize("problem", FULL_SIZE[:2], ids=lambda problem: problem.name)
def test_configuration(
    problem: Problem,
    configuration: Configuration,
    children: dict[str, Child],
    references: dict[str, Any],
    matrices: dict[str, list[np.ndarray]],
    benchmark: Any,
) -> None:
    """The default's answer, Siewert's values among it; each round is timed beside the LAPACK floor."""
    if (reason := configuration.refusal()) is not None:
        pytest.skip(reason)

    def solve(wants_answer: bool = False) -> Reply:
        reply = children[configuration.simd].solve(Task(problem, configuration.options(THREADS), wants_answer))
        SECONDS_OF_SOLVES[0] += reply.seconds
        return reply

    check = check_answer(problem, solve(True), references[problem.name])
    assert check.passed, check
    replies: list[Reply] = []
    floors: list[float] = []
    benchmark.pedantic(
        lambda: replies.append(solve()),
        setup=lambda: floors.append(floor_seconds(matrices[problem.name])),
        rounds=ROUNDS,
        warmup_rounds=1,
    )
    median, floor = float(benchmark.stats.stats.median), float(np.median(floors))
    names = dict.fromkeys(name for reply in replies[1:] for name in reply.stages)
    benchmark.extra_info |= {
        "ratio_to_floor": median / floor,
        "least_ratio_to_floor": float(benchmark.stats.stats.min) / min(floors),
        "floor_seconds": floor,
        "stage_seconds": {
            name: float(np.median([reply.stages.get(name, 0.0) for reply in replies[1:]])) for name in names
        },
        "difference_from_default": check.gap,
        "off_siewert": check.published,
        "orders_by": check.orders_by,
        "versions": [
            *(f"{module.__name__} {module.__version__}" for module in (vrte, np, scipy)),
            *describe_processes(children, [configuration]),
        ],
    }
    print(f"\n{benchmark.name}: {1e3 * median:.1f} ms, {median / floor:.2f} x the LAPACK floor of {1e3 * floor:.1f} ms")
