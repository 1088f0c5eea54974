"""A run of the report: what it took, how far it was off, and what became of it."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from bench.methods.peers import PEERS

MEASURED, REFUSED, FAILED, LEFT_OUT = "measured", "does not take", "failed", "left out"
STOKES = "iquv"


@dataclass(frozen=True)
class Row:
    """A run: median, least and greatest seconds of its rounds; errors of I, Q, U, V, largest and root mean square over
    directions, relative to the largest I at each depth, and of energy, relative to the incident flux; what the
    reference is uncertain by; floating-point operations as far as they can be counted. NaN where there is nothing to
    tell; ``status`` says why."""

    scene: str
    curve: str
    method: str
    setting: str
    status: str
    seconds: float = np.nan
    least: float = np.nan
    greatest: float = np.nan
    rounds: int = 0
    i_max: float = np.nan
    i_rms: float = np.nan
    q_max: float = np.nan
    q_rms: float = np.nan
    u_max: float = np.nan
    u_rms: float = np.nan
    v_max: float = np.nan
    v_rms: float = np.nan
    energy: float = np.nan
    reference_within: float = np.nan
    nodes: int = 0
    orders: int = 0
    operations: float = np.nan
    fingerprint: str = ""

    @property
    def is_measured(self) -> bool:
        """Whether there are figures."""
        return self.status == MEASURED

    @property
    def is_peer(self) -> bool:
        """Whether this is another code, not a method of vrte."""
        return self.method in PEERS

    @property
    def worst(self) -> float:
        """The largest error of any Stokes parameter; of a peer, of those that it finds."""
        each = [self.i_max, self.q_max, self.u_max, self.v_max]
        return float(np.nanmax(each)) if self.is_peer and self.is_measured else float(np.max(each))


def group_rows(rows: Iterable[Row], by: str = "scene") -> dict[str, list[Row]]:
    """Rows of each scene or curve, in their order."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(getattr(row, by), []).append(row)
    return found
