"""What control groups, those of containers among them, leave this process: cores and memory."""

import math
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path

ROOT, OWN = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")


def read_groups(controller: str, *names: str) -> Iterator[list[float]]:
    """The numbers in files of those names, joined, of every group around this process that has them all, innermost
    first; "max" is infinite."""
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
