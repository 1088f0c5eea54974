"""The errors of more and more nodes, by which the choice of nodes is judged: docs/explanation/accuracy/errors.csv.

`python -m docs.scripts.fewest_nodes docs/explanation/accuracy/errors.csv` measures the scenes that the file has not,
with each grading, half an hour for all of them; `python -m bench.accuracy` sets what is chosen beside it.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

from bench.accuracy import (
    COVERED,
    PROBES,
    Errors,
    Probe,
    answer_probe,
    measure_difference,
    read_errors,
    solve_references,
)
from bench.study import write_rows
from vrte.basics.errors import AccuracyError

GRADINGS = (1, 2, 3)
FIRST, GROWTH = 4, 1.1  # nodes tried: every number first, then so many times more each time
DISCRETE = 1e-10  # accuracy of the discrete problems
BELOW = 5e-10  # errors that are not followed further


def list_nodes_to_try(most: int) -> Iterator[int]:
    """Nodes to try, ascending.

    >>> list(list_nodes_to_try(10)), max(list_nodes_to_try(100))
    ([4, 5, 6, 7, 8, 9], 99)
    """
    nodes = FIRST
    while nodes < most:
        yield nodes
        nodes = max(nodes + 1, round(GROWTH * nodes))


def measure_node_errors(case: Probe, grading: int) -> Errors:
    """The error of more and more nodes, until it is as small as the reference's, infinite where they are refused."""
    right, uncertain = solve_references(case, given=False)
    errors: Errors = {}
    for nodes in list_nodes_to_try(2 * case.more[1]):
        try:
            found = answer_probe(case, DISCRETE, nodes, grading=grading)
            errors[nodes] = max(measure_difference(found, one) for one in right)
        except AccuracyError:
            errors[nodes] = float("inf")
        if max(list(errors.values())[-2:]) < max(BELOW, 2.0 * uncertain):
            break
    return errors


def add_missing_errors(path: Path) -> None:
    """The errors of more and more nodes of every scene and grading that the file has not."""
    table = read_errors(path)
    for name, case in (PROBES | COVERED).items():
        for grading in GRADINGS:
            if (name, grading) not in table:
                table[name, grading] = measure_node_errors(case, grading)
                rows = [
                    (*key, nodes, f"{error:.3g}") for key, errors in table.items() for nodes, error in errors.items()
                ]
                write_rows(path, ("scene", "grading", "nodes", "error"), rows)
                print(f"{name}, grading {grading}: to {max(table[name, grading])} nodes", flush=True)


if __name__ == "__main__":
    add_missing_errors(Path(sys.argv[1]))
