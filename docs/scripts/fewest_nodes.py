"""The errors of more and more nodes, by which the choice of nodes is judged: docs/explanation/accuracy/errors.csv.

`python -m docs.scripts.fewest_nodes docs/explanation/accuracy/errors.csv` measures the scenes that the file has not, a
few minutes for all of them; `python -m bench.accuracy` sets what is chosen beside it.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

from bench.accuracy import (
    CONTINUOUS,
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

FIRST, GROWTH = 4, 1.06  # nodes tried: every number first, then so many times more each time
BELOW = 3e-10  # errors that are not followed further


def list_nodes_to_try(most: int) -> Iterator[int]:
    """Nodes to try, ascending.

    >>> list(list_nodes_to_try(10)), max(list_nodes_to_try(100))
    ([4, 5, 6, 7, 8, 9], 96)
    """
    nodes = FIRST
    while nodes < most:
        yield nodes
        nodes = max(nodes + 1, round(GROWTH * nodes))


def measure_node_errors(case: Probe) -> Errors:
    """The error of more and more nodes, until it is as small as the reference's, infinite where they are refused."""
    right, uncertain = solve_references(case, given=False)
    errors: Errors = {}
    for nodes in list_nodes_to_try(case.more[0]):
        try:
            found = answer_probe(case, CONTINUOUS, nodes)
            errors[nodes] = max(measure_difference(found, one) for one in right)
        except AccuracyError:
            errors[nodes] = float("inf")
        if max(list(errors.values())[-2:]) < max(BELOW, 2.0 * uncertain):
            break
    return errors


def add_missing_errors(path: Path) -> None:
    """The errors of more and more nodes of every scene that the file has not."""
    table = read_errors(path)
    for name in PROBES:
        if name not in table:
            table[name] = measure_node_errors(PROBES[name])
            rows = [(name, nodes, f"{error:.3g}") for name, errors in table.items() for nodes, error in errors.items()]
            write_rows(path, ("scene", "nodes", "error"), rows)
            print(f"{name}: to {max(table[name])} nodes", flush=True)


if __name__ == "__main__":
    add_missing_errors(Path(sys.argv[1]))
