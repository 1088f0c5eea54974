"""What a process of its own may take: memory and time, so that whatever it is given harms nothing but itself."""

from contextlib import suppress
from pathlib import Path


def limit_memory(size: float) -> None:
    """So many bytes more than now, where the system has such a limit; if memory is short, this process goes first."""
    with suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("1000")
    with suppress(ImportError, OSError, ValueError):
        import resource

        now = resource.getpagesize() * int(Path("/proc/self/statm").read_text().split()[0])
        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        limit = now + int(size)
        resource.setrlimit(resource.RLIMIT_AS, (limit if hard < 0 else min(limit, hard), hard))


def limit_time(seconds: float) -> None:
    """So many seconds of work from now on, where the system has such a limit: it ends also what nobody waits for."""
    with suppress(ImportError, OSError, ValueError):
        import resource

        spent = resource.getrusage(resource.RUSAGE_SELF)
        hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
        limit = int(spent.ru_utime + spent.ru_stime + seconds) + 1
        resource.setrlimit(resource.RLIMIT_CPU, (limit if hard < 0 else min(limit, hard), hard))
