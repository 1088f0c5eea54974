"""Which scenes there are: the covering array and the corners, those the oracle answers, and the quick selection."""

from functools import cache

from vrte.report.stability.corners import corner_cases
from vrte.report.stability.scenes import ORACLE_NODES, Case, covering_cases

QUICK_SCENES = 16  # of the covering array, beside the corners of at most ORACLE_NODES nodes


@cache
def all_cases() -> tuple[Case, ...]:
    """The corners and the covering array, names unique.

    >>> len(all_cases()) >= 340
    True
    """
    return (*corner_cases(), *covering_cases())


def oracle_cases() -> tuple[Case, ...]:
    """The cases of at most 16 nodes, which ball arithmetic can answer.

    >>> max(case.nodes for case in oracle_cases())
    16
    """
    return tuple(case for case in all_cases() if case.nodes <= ORACLE_NODES)


def quick_cases() -> tuple[Case, ...]:
    """About 40 cases of at most 16 nodes, a hundred layers left out: some seconds on two cores.

    >>> 30 <= len(quick_cases()) <= 60
    True
    """
    small = [case for case in oracle_cases() if case.layering != "hundred"]
    corners = [case for case in small if case.reason]
    scenes = [case for case in small if not case.reason]
    return (*corners[::2], *scenes[:: len(scenes) // QUICK_SCENES][:QUICK_SCENES])
