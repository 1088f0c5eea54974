"""How long something takes: how many rounds, what they come to, and how busy others keep the machine meanwhile."""

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

BUSY_FIELDS = (0, 1, 2, 5, 6, 7)  # of /proc/stat: user, nice, system, two kinds of interrupts, stolen by the host
Tick = Callable[[int, int, str], None]  # what is done, of how much, and what comes now


def count_fitting_rounds(first: float, available: float, fewest: int, most: int) -> int:
    """How many rounds fit into the ``available`` seconds if the first is typical, from ``fewest`` to ``most``.

    >>> [count_fitting_rounds(first, 1.5, 3, 15) for first in (0.3, 2.0, 1e-6)]
    [5, 3, 15]
    """
    return int(min(max(available / first, fewest), most))


@dataclass(frozen=True)
class Times:
    """Seconds of several rounds."""

    median: float
    least: float
    greatest: float
    rounds: int

    @staticmethod
    def of(seconds: Sequence[float]) -> "Times":
        """What some rounds come to."""
        return Times(float(np.median(seconds)), min(seconds), max(seconds), len(seconds))


class OthersClock:
    """Cores that other processes keep busy, from when it is made: the times of two threads mean little beside them.

    >>> clock = OthersClock()
    >>> clock.cores() is None or clock.cores() >= 0.0
    True
    """

    def __init__(self, helpers: Callable[[], float] = lambda: 0.0) -> None:
        """``helpers``: CPU seconds so far of other processes that measure, too."""
        self._own = lambda: time.process_time() + helpers()
        self._wall, self._all_before, self._own_before = time.perf_counter(), read_machine_seconds(), self._own()

    def cores(self) -> float | None:
        """On average; None where the system does not tell."""
        now, wall = read_machine_seconds(), time.perf_counter() - self._wall
        if now is None or self._all_before is None:
            return None
        return max(0.0, (now - self._all_before) - (self._own() - self._own_before)) / wall

    def statement(self) -> str:
        """How many cores other processes used meanwhile, in words."""
        cores = self.cores()
        return (
            "use by other processes unknown" if cores is None else f"other processes used {cores:.2f} cores meanwhile"
        )


def read_machine_seconds() -> float | None:
    """CPU seconds that all processors were busy since the system started; None where it does not tell."""
    try:
        with open("/proc/stat", encoding="ascii") as file:
            ticks = [int(text) for text in file.readline().split()[1:]]
        return sum(ticks[place] for place in BUSY_FIELDS) / os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError, IndexError):
        return None
