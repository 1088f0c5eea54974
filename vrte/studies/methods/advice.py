"""What to take for how much: the Pareto front of a scene, and a sentence a scene; of vrte, its peers beside it."""

import math
from collections.abc import Sequence

from vrte.request.request import EXACT
from vrte.studies.methods.records import REFUSED, Row

TARGETS = (1e-3, 1e-6, 1e-10)
COARSE = 1e-2  # what synthetic iteration is held to


def front(rows: Sequence[Row]) -> list[Row]:
    """The runs of vrte that no other one beats in both time and error, slowest last.

    >>> some = [Row("s", "c", "m", str(k), "measured", t, i_max=e, q_max=0.0, u_max=0.0, v_max=0.0)
    ...         for k, (t, e) in enumerate([(1.0, 1e-3), (2.0, 1e-6), (3.0, 1e-5)])]
    >>> [row.setting for row in front(some)]
    ['0', '1']
    """
    found: list[Row] = []
    for row in sorted(candidates(rows), key=lambda row: (row.seconds, row.worst)):
        if row.worst < (found[-1].worst if found else math.inf):  # NaN is no better than anything
            found.append(row)
    return found


def candidates(rows: Sequence[Row]) -> list[Row]:
    """What can be advised: runs of vrte that were measured."""
    return [row for row in rows if row.is_measured and not row.is_peer]


def quickest(rows: Sequence[Row], target: float) -> Row | None:
    """The run of vrte of least time whose error of every Stokes parameter is at most the target; None without one."""
    return least(candidates(rows), target)


def least(rows: Sequence[Row], target: float) -> Row | None:
    """The one of least time that reaches the target."""
    good = [row for row in rows if row.worst <= target]
    return min(good, key=lambda row: row.seconds, default=None)


def within_of(rows: Sequence[Row]) -> float:
    """What the reference of these rows is uncertain by; infinite where none was measured."""
    return max((row.reference_within for row in rows if row.is_measured), default=float("inf"))


def advice(rows: Sequence[Row], target: float) -> str:
    """What to take for one target."""
    if within_of(rows) > target:
        return f"for {target:.0e} nothing can be told (the reference is known to {within_of(rows):.0e})"
    row = quickest(rows, target)
    if row is None:
        return f"for {target:.0e} take none of these"
    return f"for {target:.0e} take {row.curve} with {row.setting} ({time_text(row.seconds)}, error {row.worst:.0e})"


def sentence(rows: Sequence[Row]) -> str:
    """Of a scene, for all targets."""
    text = ", ".join(advice(rows, target) for target in TARGETS)
    return text[0].upper() + text[1:] + "."


def beside_exact(rows: Sequence[Row], method: str = "synthetic-iteration", target: float = COARSE) -> str:
    """How a method stands to the exact one where both are good enough."""
    exact, other = (quickest([row for row in rows if row.method == name], target) for name in (EXACT, method))
    if exact is None:
        return f"At {target:.0e}: {EXACT} was not run."
    if other is None:
        best = min((row.worst for row in rows if row.is_measured and row.method == method), default=None)
        why = "it was not measured" if best is None else f"its least error is {best:.1e}"
        return f"{method} does not reach {target:.0e}: {why}."
    return (
        f"At {target:.0e} {method} ({other.curve}, {other.setting}) takes {time_text(other.seconds)}, {EXACT} "
        f"({exact.curve}, {exact.setting}) {time_text(exact.seconds)}, "
        f"{exact.seconds / other.seconds:.2g} times as much."
    )


def beside_peers(rows: Sequence[Row], target: float) -> str:
    """How each peer that reaches the target stands to what would be advised; empty where none does."""
    ours, texts = quickest(rows, target), []
    for name in dict.fromkeys(row.curve for row in rows if row.is_peer):
        found = least([row for row in rows if row.curve == name and row.is_measured], target)
        if found is not None and within_of(rows) <= target:
            beside = f", {found.seconds / ours.seconds:.2g} times as long" if ours else ""
            texts.append(f"{name} with {found.setting} takes {time_text(found.seconds)}{beside}")
    return f"Beside vrte, for {target:.0e}: {'; '.join(texts)}." if texts else ""


def refusals(rows: Sequence[Row]) -> dict[str, str]:
    """Why each curve that was refused throughout was, by its name."""
    found = {}
    for name in dict.fromkeys(row.curve for row in rows):
        part = [row for row in rows if row.curve == name]
        if all(row.status.startswith(REFUSED) for row in part):
            found[name] = part[0].status
    return found


def time_text(seconds: float) -> str:
    """With a unit that suits it.

    >>> time_text(0.00213)
    '2.1 ms'
    """
    for unit, size in (("s", 1.0), ("ms", 1e-3)):
        if seconds >= size:
            return f"{seconds / size:.2g} {unit}" if seconds < 100.0 * size else f"{seconds / size:.0f} {unit}"
    return f"{seconds / 1e-6:.0f} us"
