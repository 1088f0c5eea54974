"""One thread of BLAS inside a solve, whose parallel loops are our own; and how many solves are under way, for forks.

A process that was forked while another thread of its parent was solving would wait for ever for the locks of Python,
BLAS and OpenMP that this thread held.
"""

import ctypes
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

_lock = threading.Lock()
_before: list[tuple[Callable[[int], Any], int]] = []  # setters of threads of each BLAS, and how many it had
_state: dict[str, Any] = {"libraries": None, "inside": 0}
SETTERS = [f"{one}openblas_set_num_threads{end}" for one in ("scipy_", "") for end in ("64_", "_64", "")]
FORKED = (
    "this process was forked while another thread of its parent was solving, and would wait for that thread for ever: "
    'start processes by multiprocessing.get_context("spawn"), or before or after the solve'
)
_under_way: list[None] = []  # one for each
_forked = {"stranded": False}


@contextmanager
def count_solve() -> Iterator[None]:
    """Counts a solve, or a part of one, as long as it lasts. Raises RuntimeError where nothing can be solved."""
    if _forked["stranded"]:
        raise RuntimeError(FORKED)
    _under_way.append(None)
    try:
        yield
    finally:
        _under_way.pop()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=lambda: _forked.update(stranded=bool(_under_way)))


@contextmanager
def keep_to_one_thread() -> Iterator[None]:
    """Limits every BLAS of this process to one thread; the last to leave restores what the first one found."""
    with count_solve():
        with _lock:
            if _state["libraries"] is None:
                _state["libraries"] = [(find_setter(library), library) for library in find_blas_libraries()]
            if _state["inside"] == 0:
                _before[:] = [(change, library.get_num_threads()) for change, library in _state["libraries"]]
                _set_threads(lambda threads: 1)
            _state["inside"] += 1
        try:
            yield
        finally:
            with _lock:
                _state["inside"] -= 1
                if _state["inside"] == 0:
                    _set_threads(lambda threads: threads)


def _set_threads(choose: Callable[[int], int]) -> None:
    """Sets each BLAS that had other than one thread."""
    for change, threads in _before:
        if threads is not None and threads != 1:
            change(choose(threads))


def find_setter(library: Any) -> Callable[[int], Any]:
    """What sets the number of threads of a BLAS, whichever thread calls it: threadpoolctl from 3.6 on leaves OpenBLAS
    to the first thread that has set it, for as long as that one lives, and does nothing for others."""
    loaded = ctypes.CDLL(library.filepath) if library.internal_api == "openblas" else None
    found: Callable[[int], Any] = library.set_num_threads
    return next((getattr(loaded, name) for name in SETTERS if hasattr(loaded, name)), found)


def find_blas_libraries() -> list[Any]:
    """threadpoolctl's handles of every BLAS of this process, SciPy's own included."""
    import scipy.linalg.cython_lapack  # noqa: F401  the controller must see SciPy's own OpenBLAS
    from threadpoolctl import ThreadpoolController

    return [library for library in ThreadpoolController().lib_controllers if library.user_api == "blas"]
