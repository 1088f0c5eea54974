"""The stored answers of the ball-arithmetic oracle (`python -m tests.oracle_table` makes them)."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bench.cases import restore_slabs, store_phase_matrices
from bench.stability.cases import ORACLE_NODES, Case
from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError

TABLE = Path(__file__).parents[2] / "tests" / "stability_oracle.npz"  # in the source tree alone
MISSING = f"no answers of ball arithmetic: they are tests/{TABLE.name} in vrte's sources, to be given by --oracle FILE"
LEFT_OUT = ("missing", "out of date")  # of what the oracle should have answered: python -m tests.oracle_table does


@dataclass(frozen=True, eq=False)
class OracleAnswer:
    """Right to the last digit of ``case``, whose phase matrices and cosines are those of the table.

    orders, m -> (2, tau, mu, 4) for incident (I, Q) and (U, V) apart [W m-2 sr-1]; c, m -> what they change by when a
    number of the scene moves by one unit in the last place; flux_up and flux_down (tau,) [W m-2].
    """

    case: Case
    orders: dict[int, Array]
    c: dict[int, float]
    flux_up: Array
    flux_down: Array


Table = Mapping[str, Array]


def read_oracle_table(path: Path | None) -> Table:
    """The table of a file, or that of the source tree; empty where vrte is used without its source tree.

    Raises SceneError for a file that is none.
    """
    if path is None and not TABLE.is_file():
        return {}
    try:
        with np.load(path or TABLE, allow_pickle=False) as table:
            return dict(table)
    except (OSError, ValueError, TypeError, AttributeError, EOFError) as error:
        raise SceneError(f"{path or TABLE} cannot be read as a table of the oracle: {error}") from error


def find_oracle_answer(case: Case, table: Table) -> OracleAnswer | str:
    """The oracle's answer, or why there is none.

    >>> from bench.cases import Slab
    >>> find_oracle_answer(Case("unheard of", 8, (Slab("rayleigh", 1.0, 1.0),)), {})
    'none'
    """
    name = case.name
    if not table:
        return "none"
    if case.media:
        return "surfaces"
    if case.nodes > ORACLE_NODES:
        return "too many nodes"
    if f"{name}/hash" not in table:
        return "missing"
    if str(table[f"{name}/hash"]) != case.key:
        return "out of date"
    if any(f"{name}/{m}/radiance" not in table for m in case.orders):
        return "no stable answer"
    return OracleAnswer(
        case=restore_case(case, table),
        orders={m: table[f"{name}/{m}/radiance"] for m in case.orders},
        c={m: float(table[f"{name}/{m}/c"]) for m in case.orders},
        flux_up=table[f"{name}/flux_up"].sum(axis=0),
        flux_down=table[f"{name}/flux_down"].sum(axis=0),
    )


def store_case(case: Case) -> dict[str, Array]:
    """What the oracle's answer is made from and the case says in words alone, by the key that `restore_case` reads."""
    return {f"{case.name}/mu": np.array([case.mu0, *case.mu]), **store_phase_matrices(case.slabs)}


def restore_case(case: Case, table: Table) -> Case:
    """The case in the numbers that the table's answer was made from."""
    cosines = tuple(table[f"{case.name}/mu"].tolist())
    return replace(case, slabs=restore_slabs(case.slabs, table), cosines=cosines)
