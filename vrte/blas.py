"""BLAS has one thread inside a solve: the parallel loops are ours."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_lock = threading.Lock()
_state: dict[str, Any] = {"controller": None, "limit": None, "inside": 0}


@contextmanager
def single_threaded() -> Iterator[None]:
    """Limits every BLAS of this process to one thread; the last to leave restores what the first one found."""
    from threadpoolctl import ThreadpoolController

    with _lock:
        if _state["controller"] is None:
            import scipy.linalg.cython_lapack  # noqa: F401  the controller must see SciPy's own OpenBLAS

            _state["controller"] = ThreadpoolController()
        if _state["inside"] == 0:
            _state["limit"] = _state["controller"].limit(limits=1, user_api="blas")
            _state["limit"].__enter__()
        _state["inside"] += 1
    try:
        yield
    finally:
        with _lock:
            _state["inside"] -= 1
            if _state["inside"] == 0:
                _state["limit"].__exit__(None, None, None)
