"""Idle threads of OpenMP sleep: by default they spin, which takes the processor from whoever else has work."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

POLICY = "OMP_WAIT_POLICY"  # read once, when the first library brings OpenMP


@contextmanager
def wait_passively() -> Iterator[None]:
    """The policy for what is loaded within, where the user has set none; other programs' OpenMP keeps its own."""
    if POLICY in os.environ:
        yield
        return
    os.environ[POLICY] = "passive"
    try:
        yield
    finally:
        del os.environ[POLICY]
