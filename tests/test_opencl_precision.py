"""Kernels in single precision: what they compute with, and how far their answers are from those in doubles."""

import re
from typing import Any

import numpy as np
import pytest

from vrte.cl.session import OPTIONS_OF, REALS, read_sources

COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)
EITHER = re.compile(r"#ifdef SINGLE\n(.*?)#else\n.*?#endif\n", re.DOTALL)


class TestSessions:
    def test_nothing_is_double_in_single_precision(self) -> None:
        """As a compiler without doubles sees the sources: literals are floats by an option."""
        assert "-cl-single-precision-constant" in OPTIONS_OF["single"]
        left = EITHER.sub(r"\1", COMMENT.sub("", read_sources("single")))
        assert "#define real float\n" in left
        assert not re.search(r"double|fp64|\blong4\b|#ifdef", left)

    def test_numbers_go_up_as_floats_and_come_down_as_doubles(self, opencl: Any) -> None:
        single = opencl.in_precision("single")
        for values in (np.array([1.0 / 3.0, np.inf, 1e300]), np.full(5000, 1.0 / 3.0)):
            up = single.upload(values)
            assert up.dtype == REALS["single"]
            with np.errstate(over="ignore"):
                expected = values.astype(np.float32)
            assert (single.download(up) == expected).all()
            assert single.download(up).dtype == np.float64
        assert single.download(single.upload(np.arange(3, dtype=np.int32))).dtype == np.int32

    def test_one_session_a_precision_on_the_same_queue(self, opencl: Any) -> None:
        single = opencl.in_precision("single")
        assert single.in_precision("single") is single
        assert opencl.in_precision("single") is single
        assert single.in_precision("double").queue is single.queue
        assert single.lock is opencl.lock
        assert single.constants is not opencl.constants


@pytest.mark.parametrize("precision", ["double", "single"])
def test_products(opencl: Any, precision: str) -> None:
    """A stack of matrices times another, to the rounding of what is computed with."""
    from vrte.cl.matrices import download_stack, make_stack, multiply_stacks, upload_stack

    session = opencl.in_precision(precision)
    a, b = np.random.default_rng(0).normal(size=(2, 3, 20, 20))
    made = make_stack(session, 3, 20, 20)
    items = session.upload(np.arange(3, dtype=np.int32))
    multiply_stacks(session, items, upload_stack(session, a), upload_stack(session, b), made)
    expected = np.swapaxes(np.swapaxes(a, 1, 2) @ np.swapaxes(b, 1, 2), 1, 2)
    gap = np.abs(download_stack(session, made) - expected).max() / np.abs(expected).max()
    assert gap < 20 * np.finfo(REALS[precision]).eps
    assert precision == "double" or gap > np.finfo(np.float64).eps * 1e4
