"""The fewest nodes that hold, by trying: the errors of more and more nodes, which the choice of nodes is judged by.

``python -m bench.accuracy.fewest docs/explanation/accuracy/errors.csv`` measures the scenes that the file has
not, a few minutes for all of them; `python -m bench.accuracy` sets what is chosen beside it.
"""

import argparse
import csv
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from bench.accuracy.sweep import (
    CONTINUOUS,
    PROBES,
    Outcome,
    Probe,
    answer_probe,
    measure_difference,
    solve_references,
)
from bench.study import make_markdown_table, write_rows
from vrte.basics.errors import AccuracyError

FIRST, GROWTH = 4, 1.06  # nodes tried: every number first, then so many times more each time
BELOW = 3e-10  # errors that are not followed further
TABLE = "errors.csv"
HEADER = ("scene", "nodes", "error")

Errors = dict[int, float]


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


def find_fewest_that_hold(errors: Errors, requested: float) -> int:
    """The fewest nodes tried from which on no number of them that was tried has a larger error; 0 where all have.

    >>> find_fewest_that_hold({4: 1e-2, 5: 1e-4, 6: 2e-3, 7: 1e-4}, 1e-3)
    7
    """
    held = 0
    for nodes in sorted(errors, reverse=True):
        if not errors[nodes] <= requested:
            break
        held = nodes
    return held


def read_errors(path: str | os.PathLike[str]) -> dict[str, Errors]:
    """The table of a file, scene -> nodes -> error; empty where there is no file."""
    found: dict[str, Errors] = {}
    if Path(path).exists():
        with open(path, encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                found.setdefault(row["scene"], {})[int(row["nodes"])] = float(row["error"])
    return found


def pair_chosen_and_fewest(
    table: dict[str, Errors], outcomes: Sequence[Outcome]
) -> dict[tuple[str, float], tuple[int, int]]:
    """Nodes chosen and the fewest that hold, by scene and request, where those are known."""
    found = {}
    for one in outcomes:
        fewest = find_fewest_that_hold(table.get(one.scene, {}), one.requested)
        if fewest and not one.given:
            found[one.scene, one.requested] = one.nodes, fewest
    return found


def make_ratio_table(table: dict[str, Errors], outcomes: Sequence[Outcome]) -> str:
    """Scenes down, requests across: nodes chosen over the fewest that hold; empty where nothing is known."""
    found = pair_chosen_and_fewest(table, outcomes)
    if not found:
        return ""
    requests = sorted({requested for _, requested in found}, reverse=True)
    rows = []
    for name in dict.fromkeys(scene for scene, _ in found):
        pairs = [found.get((name, requested)) for requested in requests]
        rows.append([name, *(f"{pair[0]}/{pair[1]} = {pair[0] / pair[1]:.2f}" if pair else "?" for pair in pairs)])
    worst = max(chosen / fewest for chosen, fewest in found.values())
    note = (
        f"\nNodes chosen over the fewest from which on all that were tried hold, at most {worst:.2f}; ? where the\n"
        f"reference is not good enough to tell. Errors of all nodes tried: {TABLE}.\n"
    )
    return make_markdown_table(["scene", *(f"{requested:.0e}" for requested in requests)], rows) + note


def main(arguments: Sequence[str] | None = None) -> int:
    """Solves all scenes on more and more nodes and writes their errors; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m bench.accuracy.fewest", description=__doc__)
    parser.add_argument("table", help="the CSV file of errors, added to where scenes are missing")
    path = parser.parse_args(arguments).table
    table = read_errors(path)
    for name in PROBES:
        if name not in table:
            table[name] = measure_node_errors(PROBES[name])
            rows = [(name, nodes, f"{error:.3g}") for name, errors in table.items() for nodes, error in errors.items()]
            write_rows(path, HEADER, rows)
            print(f"{name}: to {max(table[name])} nodes", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
