"""Memory that there is, and shares of it that arrays are cut to."""

import os
from pathlib import Path

from vrte.basics.control_groups import find_group_bytes
from vrte.basics.errors import SceneError

BYTES = 8
CHUNK_BYTES = 48e6  # meant for the matrices of the orders done at once
PIECE_BYTES = 16e6  # of the result at a time: it stays in the cache, and a progress bar moves
TILE_DOUBLES = 32768  # of a thread at the end, more where one direction's azimuths take more
ALWAYS_THERE = 32e6  # less than what the interpreter has taken already
LARGEST_SHARE = 0.9  # of what is available


def count_orders_at_once(per_order: float, threads: int) -> int:
    """Orders whose matrices fit the memory meant for them, at least one a thread."""
    return max(threads, int(CHUNK_BYTES / (BYTES * per_order)))


def find_available_bytes() -> float:
    """What this process may still take: of the machine's free memory, of its control groups', and of its own limit."""
    return max(0.0, min(find_machine_bytes(), find_address_bytes(), find_group_bytes()))


def check_bytes(needed: float, what: str, change: str) -> None:
    """Raises SceneError where so many bytes, which ``what`` need, are not to be had."""
    if needed < ALWAYS_THERE:  # asking the system takes as long as a small solve
        return
    available = find_available_bytes()
    if needed > LARGEST_SHARE * available:
        raise SceneError(
            f"{what} need about {write_gigabytes(needed)} of memory and {write_gigabytes(available)} are available: "
            f"{change}"
        )


def write_gigabytes(size: float) -> str:
    """A number of bytes in gigabytes, to three digits."""
    return f"{size / 1e9:.3g} GB"


def find_address_bytes() -> float:
    """What `ulimit -v` leaves, infinite without it."""
    try:
        import resource  # on Unix only

        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        if limit == resource.RLIM_INFINITY:
            return float("inf")
        return limit - resource.getpagesize() * float(Path("/proc/self/statm").read_text().split()[0])
    except (ImportError, OSError, ValueError):
        return float("inf")


def find_machine_bytes() -> float:
    """Memory of the machine that can be had, infinite where it does not tell."""
    try:
        lines = dict(line.split(":", 1) for line in Path("/proc/meminfo").read_text().splitlines())
        return 1024.0 * float(lines["MemAvailable"].split()[0])
    except (OSError, KeyError, ValueError):
        pass
    try:
        return float(os.sysconf("SC_PAGE_SIZE")) * float(os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, OSError, ValueError):
        return float("inf")
