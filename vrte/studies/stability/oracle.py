"""The stored answers of the ball-arithmetic oracle (`python -m tests.oracle_table` makes them)."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vrte.basics.arrays import Array
from vrte.studies.stability.scenes import ORACLE_NODES, Case

TABLE = Path(__file__).with_name("oracle.npz")


@dataclass(frozen=True, eq=False)
class OracleAnswer:
    """Right to the last digit: orders, m -> (2, tau, mu, 4) for incident (I, Q) and (U, V) apart [W m-2 sr-1];
    c, m -> what they change by when a number of the scene moves by one unit in the last place; flux_up and flux_down
    (tau,) [W m-2].
    """

    orders: dict[int, Array]
    c: dict[int, float]
    flux_up: Array
    flux_down: Array


Table = Mapping[str, Array]


@contextmanager
def stored_table() -> Iterator[Table]:
    """The table that comes with the package; empty where there is none."""
    if TABLE.is_file():
        with np.load(TABLE) as table:
            yield table
    else:
        yield {}


def lookup(case: Case, table: Table) -> OracleAnswer | str:
    """The oracle's answer, or why there is none.

    >>> from vrte.studies.stability.scenes import Slab
    >>> lookup(Case("unheard of", 8, (Slab("rayleigh", 1.0, 1.0),)), {})
    'none'
    """
    name = case.name
    if case.nodes > ORACLE_NODES:
        return "too many nodes"
    if f"{name}/hash" not in table:
        return "none"
    if str(table[f"{name}/hash"]) != case.key:
        return "out of date"
    if any(f"{name}/{m}/radiance" not in table for m in case.orders):
        return "no stable answer"
    return OracleAnswer(
        orders={m: table[f"{name}/{m}/radiance"] for m in case.orders},
        c={m: float(table[f"{name}/{m}/c"]) for m in case.orders},
        flux_up=table[f"{name}/flux_up"].sum(axis=0),
        flux_down=table[f"{name}/flux_down"].sum(axis=0),
    )
