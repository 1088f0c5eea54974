"""The targets against nanodisort and sasktran2: so many times faster, and no larger error in I, Q, U."""

import importlib.util

import pytest

from .conftest import PEER_ROWS
from .peers import PROBLEMS, Problem, compare, shortfalls

CASES = [
    pytest.param(
        problem,
        streams,
        id=f"{problem.name}, {streams} streams",
        marks=pytest.mark.skipif(
            importlib.util.find_spec(problem.peer) is None,
            reason=f"{problem.peer} is not installed: pip install 'vrte[bench]'",
        ),
    )
    for problem in PROBLEMS
    for streams in problem.streams
]


@pytest.mark.parametrize(("problem", "streams"), CASES)
def test_peer(problem: Problem, streams: int, pytestconfig: pytest.Config) -> None:
    rows = compare(problem, streams)
    pytestconfig.stash.setdefault(PEER_ROWS, []).extend(rows)
    missed = shortfalls(rows)
    assert not missed, "\n".join(missed)
