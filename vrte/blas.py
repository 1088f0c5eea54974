"""BLAS has one thread inside a solve: the parallel loops are ours."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_lock = threading.Lock()
_state: dict[str, Any] = {"libraries": None, "before": [], "inside": 0}


@contextmanager
def single_threaded() -> Iterator[None]:
    """Limits every BLAS of this process to one thread; the last to leave restores what the first one found."""
    with _lock:
        if _state["libraries"] is None:
            _state["libraries"] = blas_libraries()
        if _state["inside"] == 0:
            _state["before"] = [library.get_num_threads() for library in _state["libraries"]]
            for library, threads in zip(_state["libraries"], _state["before"], strict=True):
                if threads != 1:
                    library.set_num_threads(1)
        _state["inside"] += 1
    try:
        yield
    finally:
        with _lock:
            _state["inside"] -= 1
            if _state["inside"] == 0:
                for library, threads in zip(_state["libraries"], _state["before"], strict=True):
                    if threads is not None and threads != 1:
                        library.set_num_threads(threads)


def blas_libraries() -> list[Any]:
    """threadpoolctl's handles of every BLAS of this process, SciPy's own included."""
    import scipy.linalg.cython_lapack  # noqa: F401  the controller must see SciPy's own OpenBLAS
    from threadpoolctl import ThreadpoolController

    return [library for library in ThreadpoolController().lib_controllers if library.user_api == "blas"]
