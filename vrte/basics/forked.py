"""A process that was forked in the middle of a solve says so: it would wait for ever.

What another thread of its parent held at that moment, the locks of Python, BLAS and OpenMP, nobody gives back there.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager

FORKED = (
    "this process was forked while another thread of its parent was solving, and would wait for that thread for ever: "
    'start processes by multiprocessing.get_context("spawn"), or before or after the solve'
)
_under_way: list[None] = []  # one for each
_state = {"stranded": False}


@contextmanager
def count_solve() -> Iterator[None]:
    """Counts a solve, or a part of one, as long as it lasts. Raises RuntimeError where nothing can be solved."""
    if _state["stranded"]:
        raise RuntimeError(FORKED)
    _under_way.append(None)
    try:
        yield
    finally:
        _under_way.pop()


def find_out() -> None:
    """Whether this process, just forked, has half a solve in it."""
    _state["stranded"] = bool(_under_way)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=find_out)
