"""The discrete problem every stage works on: arrays only, no class of the scene."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte import _core
from vrte.arrays import Array
from vrte.discrete_ordinates.leave_out import EVERYTHING, LeaveOut

IntArray = NDArray[np.int32]
Progress = Callable[[int, int], None]
FLIP = np.array([1.0, 1.0, -1.0, -1.0])  # D of (1:11)
ALL = (0, 1, 2, 3)  # places of I, Q, U, V


@dataclass(frozen=True, eq=False)
class Problem:
    """Layers, directions and incident beams in the solver's frame (docs/conventions.md).

    coefficients (layer, term, 6), truncated to 2 N terms; terms, albedo, thickness, above (layer,), of the truncated
    layers like all depths; gain, fraction (layer,): as in `vrte.optics.truncation.Truncated`; nodes, weights (N,);
    mu_out (n_out,) positive, the first ``n_up`` for light going up; mu0 (n_in,); columns (n_col, S) incident Stokes
    vectors; stokes (S,): places of the S Stokes parameters at work, ascending; terms_cut: how many terms of the longest
    phase matrix the nodes do not carry; level, level_layer (n_tau,): depths below the top of a layer; leave_out: what
    need not be done.
    """

    coefficients: Array
    terms: IntArray
    albedo: Array
    thickness: Array
    above: Array
    gain: Array
    fraction: Array
    nodes: Array
    weights: Array
    mu_out: Array
    n_up: int
    mu0: Array
    columns: Array
    level: Array
    level_layer: IntArray
    stokes: tuple[int, ...] = ALL
    terms_cut: int = 0
    leave_out: LeaveOut = EVERYTHING

    @property
    def directions(self) -> Array:
        """Nodes, then outgoing, then incident cosines."""
        return np.concatenate([self.nodes, self.mu_out, self.mu0])

    @property
    def depth(self) -> Array:
        """Optical depths of the levels below the top, (n_tau,), as the truncated layers have them."""
        found: Array = self.above[self.level_layer] + self.level
        return found

    @property
    def size(self) -> int:
        """n = S N."""
        return len(self.stokes) * self.nodes.size

    @property
    def rows_out(self) -> int:
        """S n_out."""
        return len(self.stokes) * self.mu_out.size

    @property
    def flip(self) -> Array:
        """D of (1:11) on the Stokes parameters at work: the Delta of (1:26)-(1:27), node by node."""
        return FLIP[list(self.stokes)]

    @property
    def is_scalar(self) -> bool:
        """Whether I alone is scattered."""
        return not self.coefficients[..., 1:].any()

    @property
    def conserves(self) -> bool:
        """Whether order 0 carries the flux."""
        return self.stokes[0] == 0

    @property
    def n_rhs(self) -> int:
        """Right-hand sides of every order."""
        return int(self.mu0.size * self.columns.shape[0])


@dataclass(eq=False)
class Run:
    """One solve's threads, stop flag and clocks; `stages` collects wall and thread seconds by name; ``brief``: it is
    over in some milliseconds, on one thread; ``kernels``: the stages' loops, those of `_core` or others with the same
    arguments; ``told``: how long it takes was said, with others."""

    threads: int
    brief: bool = False
    kernels: Any = _core
    stop: IntArray = field(default_factory=lambda: np.zeros(1, np.int32))
    stages: dict[str, dict[str, float]] = field(default_factory=dict)
    told: bool = False

    def timed(self, name: str, kernel: Callable[..., None], *arguments: object) -> None:
        """Calls kernel(*arguments, seconds, stop) and books its time under `name`."""
        seconds = np.zeros(self.threads)
        start = time.perf_counter()
        kernel(*arguments, seconds, self.stop)
        self.book(name, time.perf_counter() - start, float(seconds.sum()))
        if self.stop[0]:
            raise KeyboardInterrupt

    def book(self, name: str, wall: float, busy: float | None = None) -> None:
        """Adds seconds to a stage."""
        clock = self.stages.setdefault(name, {"wall_seconds": 0.0, "thread_seconds": 0.0})
        clock["wall_seconds"] += wall
        clock["thread_seconds"] += wall if busy is None else busy

    def work(self, doubles: int) -> Array:
        """Scratch memory, one row a thread."""
        return np.empty((self.threads, doubles))

    def pivots(self, integers: int) -> IntArray:
        """Scratch integers, one row a thread."""
        return np.empty((self.threads, integers), np.int32)
