"""How busy other processes keep the machine during a measurement: the times of two threads mean little beside them."""

import os
import time
from collections.abc import Callable

BUSY_FIELDS = (0, 1, 2, 5, 6, 7)  # of /proc/stat: user, nice, system, two kinds of interrupts, stolen by the host


class OthersClock:
    """Counts from when it is made.

    >>> clock = OthersClock()
    >>> clock.cores() is None or clock.cores() >= 0.0
    True
    """

    def __init__(self, helpers: Callable[[], float] = lambda: 0.0) -> None:
        """``helpers``: CPU seconds so far of other processes that measure, too."""
        self._helpers = helpers
        self._wall, self._all, self._own = time.perf_counter(), machine_seconds(), own_seconds() + helpers()

    def cores(self) -> float | None:
        """Cores that other processes kept busy on average; None where the system does not tell."""
        now, wall = machine_seconds(), time.perf_counter() - self._wall
        if now is None or self._all is None:
            return None
        return max(0.0, (now - self._all) - (own_seconds() + self._helpers() - self._own)) / wall

    def statement(self) -> str:
        """In words."""
        cores = self.cores()
        return (
            "use by other processes unknown" if cores is None else f"other processes used {cores:.2f} cores meanwhile"
        )


def machine_seconds() -> float | None:
    """CPU seconds that all processors were busy since the system started; None where it does not tell."""
    try:
        with open("/proc/stat", encoding="ascii") as file:
            ticks = [int(text) for text in file.readline().split()[1:]]
        return sum(ticks[place] for place in BUSY_FIELDS) / os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError, IndexError):
        return None


def own_seconds() -> float:
    """CPU seconds of this process."""
    return time.process_time()
