"""BLAS has one thread inside a solve, whichever thread calls and whoever has set it before."""

import threading
from collections.abc import Iterator

import numpy as np
import pytest

import vrte
from vrte.basics.blas import find_blas_libraries, find_setter, keep_to_one_thread


@pytest.fixture(autouse=True)
def two_threads() -> Iterator[None]:
    """Of every BLAS, set by the main thread, which then controls them as threadpoolctl sees it."""
    before = [(library, library.get_num_threads()) for library in find_blas_libraries()]
    for library, _ in before:
        library.set_num_threads(2)
        find_setter(library)(2)
    yield
    for library, threads in before:
        find_setter(library)(threads)


def threads_of_blas() -> set[int]:
    return {library.get_num_threads() for library in find_blas_libraries()}


def test_from_any_thread() -> None:
    seen = []

    def work() -> None:
        with keep_to_one_thread(), keep_to_one_thread():
            seen.append(threads_of_blas())
        seen.append(threads_of_blas())

    for call in (work, lambda: run_in_a_thread(work)):
        call()
    assert seen == [{1}, {2}] * 2


def run_in_a_thread(work: object) -> None:
    thread = threading.Thread(target=work)  # type: ignore[arg-type]
    thread.start()
    thread.join()


def test_inside_a_solve() -> None:
    seen = []
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)])
    mu = np.linspace(0.1, 1.0, 60)
    vrte.brdf(scene, mu, mu, np.arange(181), nodes=20, threads=2, progress=lambda *_: seen.append(threads_of_blas()))
    assert seen
    assert all(found == {1} for found in seen)
    assert threads_of_blas() == {2}
