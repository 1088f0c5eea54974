"""Memory, cores and time that this process may take: of the machine, of its control groups, of limits of its own."""

import math
import os
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path

from vrte.basics.errors import SceneError

ROOT, OWN = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")
BYTES = 8
CHUNK_BYTES = 48e6  # meant for the matrices of the orders done at once
PIECE_BYTES = 16e6  # of the result at a time: it stays in the cache, and a progress bar moves
DERIVATIVE_BYTES = 9e6  # the same for derivatives: more are fresh pages from the system, 3 us each on the test machine
TILE_DOUBLES = 32768  # of a thread at the end, more where one direction's azimuths take more
ALWAYS_THERE = 32e6  # less than what the interpreter has taken already
LARGEST_SHARE = 0.9  # of what is available


def count_orders_at_once(per_order: float, threads: int, memory: float = CHUNK_BYTES) -> int:
    """Orders whose matrices, so many doubles each, fit the memory meant for them [bytes], at least one a thread."""
    return max(threads, int(memory / (BYTES * per_order)))


def find_available_bytes() -> float:
    """What this process may still take: of the machine's free memory, of its control groups', and of its own limit."""
    return max(0.0, min(find_machine_bytes(), find_address_bytes(), find_group_bytes()))


def check_bytes(needed: float, what: str, change: str) -> None:
    """Raises SceneError where so many bytes, which ``what`` need, are not to be had."""
    if needed < ALWAYS_THERE:  # asking the system takes as long as a small solve
        return
    available = find_available_bytes()
    if needed > LARGEST_SHARE * available:
        sizes = f"about {write_gigabytes(needed)} of memory and {write_gigabytes(available)} are available"
        raise SceneError(f"{what} need {sizes}: {change}")


def write_gigabytes(size: float) -> str:
    """A number of bytes in gigabytes, to three digits."""
    return f"{size / 1e9:.3g} GB"


def find_address_bytes() -> float:
    """What `ulimit -v` leaves, infinite without it."""
    with suppress(ImportError, OSError, ValueError):
        import resource  # on Unix only

        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        if limit != resource.RLIM_INFINITY:
            return limit - resource.getpagesize() * float(Path("/proc/self/statm").read_text().split()[0])
    return math.inf


def find_machine_bytes() -> float:
    """Available memory of the machine, infinite where it is unknown."""
    with suppress(OSError, KeyError, ValueError):
        lines = dict(line.split(":", 1) for line in Path("/proc/meminfo").read_text().splitlines())
        return 1024.0 * float(lines["MemAvailable"].split()[0])
    with suppress(AttributeError, OSError, ValueError):
        return float(os.sysconf("SC_PAGE_SIZE")) * float(os.sysconf("SC_PHYS_PAGES"))
    return math.inf


def read_groups(controller: str, *names: str) -> Iterator[list[float]]:
    """Numbers in files of every group around this process that has them all, innermost first; "max" is infinite."""
    try:
        lines = [line.split(":", 2) for line in OWN.read_text().splitlines()]
    except OSError:
        return
    for _, controllers, path in lines:
        if controllers and controller not in controllers.split(","):
            continue
        mount = ROOT / controller if controllers else ROOT  # version 1 has a tree for each controller, version 2 one
        inner = mount / path.strip("/")
        for group in (inner, *inner.parents):
            with suppress(OSError, ValueError):
                read = [(group / name).read_text() for name in names]
                yield [float(word.replace("max", "inf")) for content in read for word in content.split()]
            if group == mount:
                break


def find_group_bytes() -> float:
    """Bytes that the tightest group leaves, infinite without a limit."""
    files = ("memory.max", "memory.current"), ("memory.limit_in_bytes", "memory.usage_in_bytes")
    return min((limit - used for names in files for limit, used in read_groups("memory", *names)), default=math.inf)


@cache
def find_group_cores() -> float:
    """Cores whose time the tightest group leaves, infinite without a quota."""
    files = ("cpu.max",), ("cpu.cfs_quota_us", "cpu.cfs_period_us")
    found = [quota / period for names in files for quota, period in read_groups("cpu", *names) if quota > 0.0]
    return min(found, default=math.inf)


def limit_memory(size: float) -> None:
    """Limits memory to so many bytes more than now, where the system can; where memory is short, this process ends."""
    with suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("1000")
    with suppress(ImportError, OSError, ValueError):
        import resource

        taken = resource.getpagesize() * int(Path("/proc/self/statm").read_text().split()[0])
        reduce_limit("RLIMIT_AS", taken + int(size))


def limit_time(seconds: float) -> None:
    """Limits processor time to so many seconds from now on, where the system can: it also ends abandoned work."""
    with suppress(ImportError, OSError, ValueError):
        reduce_limit("RLIMIT_CPU", int(sum(os.times()[:2]) + seconds) + 1)


def reduce_limit(kind: str, limit: int) -> None:
    """Sets the soft limit of a resource, never above its hard one."""
    import resource

    hard = resource.getrlimit(getattr(resource, kind))[1]
    resource.setrlimit(getattr(resource, kind), (limit if hard < 0 else min(limit, hard), hard))
