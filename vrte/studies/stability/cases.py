"""Which scenes there are: the covering array and the corners, those the oracle answers, and the quick selection."""

from fnmatch import fnmatchcase
from functools import cache

from vrte.basics.errors import SceneError
from vrte.studies.stability.corners import corner_cases
from vrte.studies.stability.scenes import ORACLE_NODES, Case, covering_cases

QUICK_SCENES = 24  # of the covering array, beside the corners


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
    """Every second corner and some scenes, of at most 16 nodes that carry all terms, without a hundred layers.

    >>> 40 <= len(quick_cases()) <= 60
    True
    """
    small = [case for case in oracle_cases() if case.resolved and case.layering != "hundred"]
    corners = [case for case in small if case.reason]
    scenes = [case for case in small if not case.reason]
    return (*corners[::2], *scenes[:: len(scenes) // QUICK_SCENES][:QUICK_SCENES])


def matching(pattern: str, quick: bool = False) -> list[Case]:
    """The cases whose names match a shell's pattern, of all or of the quick selection. Raises SceneError for none.

    >>> [case.name for case in matching("thickness 0*lobe")]
    ['thickness 0 over a lobe']
    """
    found = [case for case in (quick_cases() if quick else all_cases()) if fnmatchcase(case.name, pattern)]
    if not found:
        raise SceneError(f"--cases {pattern!r} matches no scene{' of the quick selection' if quick else ''}")
    return found
