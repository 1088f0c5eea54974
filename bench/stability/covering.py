"""Covering arrays: a few rows in which every pair of values of two axes occurs.

Greedy, one row after another, like the AETG of Cohen, Dalal, Fredman and Patton, IEEE Trans. Softw. Eng. 23, 437
(1997). Only `random.Random.random` draws, the one sequence that Python keeps the same in all its versions.
"""

from collections.abc import Callable, Sequence
from functools import partial
from itertools import combinations, product
from random import Random
from typing import TypeVar

Value = TypeVar("Value")
Row = tuple[int, ...]
Cell = tuple[tuple[int, int], ...]  # (axis, value), axes ascending
CANDIDATES = 20  # tried for each row


def make_covering_array(
    sizes: Sequence[int], rows: int, seed: int, unwanted: Callable[[Row], bool] = lambda row: False
) -> list[Row]:
    """Rows of value numbers, one an axis, that cover every pair; then more, up to ``rows``, for triples.

    ``sizes``: how many values each axis has, two axes or more. A row for which ``unwanted`` holds is taken where a
    pair needs it, never for a triple. Fewer rows come back where there are no more, more where the pairs need them.

    >>> rows = make_covering_array([2, 2, 2], rows=6, seed=1)
    >>> len(rows), find_uncovered_cells(rows, [2, 2, 2], 2)
    (6, set())
    """
    draw = Random(seed)
    pairs = find_uncovered_cells([], sizes, 2)
    found: list[Row] = []
    while pairs:
        tries = [_make_row_for_pair(sizes, pairs, draw) for _ in range(CANDIDATES)]
        best = max(tries, key=lambda row: (len(combine_values(row, 2) & pairs), not unwanted(row)))
        pairs -= combine_values(best, 2)
        found.append(best)
    triples = find_uncovered_cells(found, sizes, 3)
    for _ in range(10 * rows):  # ends even where all that is left is unwanted
        if len(found) >= rows or not triples:
            break
        tries = [tuple(_choose_value(range(size), draw) for size in sizes) for _ in range(3 * CANDIDATES)]
        best = max(tries, key=lambda row: -1 if unwanted(row) else len(combine_values(row, 3) & triples))
        if not unwanted(best) and best not in found:
            triples -= combine_values(best, 3)
            found.append(best)
    return found


def find_uncovered_cells(rows: Sequence[Row], sizes: Sequence[int], strength: int) -> set[Cell]:
    """The combinations of ``strength`` values of different axes that occur in no row.

    >>> find_uncovered_cells([(0, 0), (1, 0)], [2, 2], 2) == {((0, 0), (1, 1)), ((0, 1), (1, 1))}
    True
    """
    values = [[(axis, value) for value in range(size)] for axis, size in enumerate(sizes)]
    every = {cell for axes in combinations(values, strength) for cell in product(*axes)}
    return every.difference(*(combine_values(row, strength) for row in rows))


def combine_values(row: Row, strength: int) -> set[Cell]:
    """All combinations of ``strength`` values that occur in a row.

    >>> combine_values((0, 2), 2)
    {((0, 0), (1, 2))}
    """
    return set(combinations(tuple(enumerate(row)), strength))


def _make_row_for_pair(sizes: Sequence[int], pairs: set[Cell], draw: Random) -> Row:
    """A row that holds one open pair, the other axes filled in random order, each with the value that closes most."""
    row: dict[int, int] = dict(_choose_value(sorted(pairs), draw))

    def closed(axis: int, value: int) -> int:
        """How many open pairs this value of one more axis would close."""
        return sum(tuple(sorted([(other, there), (axis, value)])) in pairs for other, there in row.items())

    for axis in _order_randomly([axis for axis in range(len(sizes)) if axis not in row], draw):
        row[axis] = max(_order_randomly(range(sizes[axis]), draw), key=partial(closed, axis))
    return tuple(row[axis] for axis in range(len(sizes)))


def _choose_value(values: Sequence[Value], draw: Random) -> Value:
    return values[int(draw.random() * len(values))]


def _order_randomly(values: Sequence[int], draw: Random) -> list[int]:
    return sorted(values, key=lambda _: draw.random())
