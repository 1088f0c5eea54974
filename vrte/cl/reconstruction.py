"""Reconstruction on a device: the field at any depth and direction from the modes, (1:36)-(1:38)."""

import time
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, IntArray
from vrte.basics.running import Crew
from vrte.cl.lending import lent
from vrte.cl.matrices import STRIP, padded
from vrte.cl.session import Session

MOST_DOUBLES = 1 << 26  # of what a group of orders takes besides the caller's arrays


@dataclass(frozen=True)
class Sizes:
    """Fourier orders, layers, modes of a layer, Stokes components, outgoing directions and those of them that go up,
    incident directions, right-hand sides, depths."""

    orders: int
    layers: int
    n: int
    stokes: int
    n_out: int
    n_up: int
    n_in: int
    n_rhs: int
    levels: int

    @property
    def rows(self) -> int:
        """Stokes components of all outgoing directions."""
        return self.stokes * self.n_out

    @property
    def stops(self) -> int:
        """Where light is wanted, and the faces that it leaves layers through."""
        return self.levels + self.layers

    @property
    def doubles(self) -> tuple[int, int, int]:
        """Of an order's scratch memory: modes seen from outgoing directions, beams in modes, light at faces."""
        lit = 2 * self.layers * self.n * padded(self.rows)
        return lit, self.stops * self.n_rhs * self.n, self.layers * self.n_rhs * self.rows


@dataclass(frozen=True, eq=False)
class Solved:
    """Of each order, on the device, column by column, as core/reconstruction.pxi has it; fading (order, layer) int:
    of `boundary` in core/boundary.pxi; base_row (order,) int."""

    G_E: Any
    G_F: Any
    lam_re: Any
    lam_im: Any
    X: Any
    Y: Any
    c: Any
    zeta: Any
    even: Any
    odd: Any
    base_down: Any
    fading: Any
    base_row: Any


@dataclass(frozen=True, eq=False)
class Places:
    """What all orders share, on the device: base_out (row, n, rows), thickness, above (layer,), mu0 (n_in,), mu_out
    (n_out,), level, level_layer (n_level,)."""

    base_out: Any
    thickness: Any
    above: Any
    mu0: Any
    mu_out: Any
    level: Any
    level_layer: Any


def reconstruct_orders(
    session: Session, sizes: Sizes, solved: Solved, places: Places, out: Any, has_base: bool
) -> None:
    """Fills out (order, n_level, n_rhs, rows): radiance times 2 pi for a unit beam, without singly scattered light;
    rows of light going up come first, flipped by D."""
    orders, layers, n, ld = sizes.orders, sizes.layers, sizes.n, padded(sizes.rows)
    lit, fed, part = (session.empty((orders * count,)) for count in sizes.doubles)
    numbers = {name: np.int32(value) for name, value in vars(sizes).items()}
    session.launch(
        "light_of_modes",
        (ld // STRIP, orders * layers, 2),
        *(np.int32(n), np.int32(sizes.rows), np.int32(ld)),
        *(solved.G_E, solved.G_F, solved.X, solved.Y, lit),
    )
    session.launch(
        "feed_modes",
        (sizes.stops, sizes.n_in, orders),
        *(numbers[name] for name in ("n", "layers", "levels", "n_rhs")),
        *(solved.lam_re, solved.lam_im, solved.c),
        *(places.mu0, places.thickness, places.level, places.level_layer, fed),
    )
    session.launch(
        "sum_sources",
        (sizes.n_out, sizes.stops if layers > 1 else sizes.levels, orders),
        *(numbers[name] for name in ("n", "stokes", "n_up")),
        np.int32(ld),
        *(numbers[name] for name in ("layers", "levels", "n_in", "n_rhs")),
        *(lit, solved.lam_re, solved.lam_im, solved.fading, solved.even, solved.odd, solved.c, solved.zeta, fed),
        *(places.thickness, places.above, places.mu0, places.mu_out, places.level, places.level_layer, out, part),
    )
    if layers > 1 or has_base:
        session.launch(
            "pass_layers",
            (sizes.n_out, sizes.n_rhs, orders),
            *(numbers[name] for name in ("n", "stokes", "n_up", "layers", "levels")),
            *(solved.base_down, solved.base_row, places.base_out),
            *(places.thickness, places.mu_out, places.level, places.level_layer, out, part),
        )


def reconstruct(
    session: Session,
    crew: Crew,
    *,
    G_E: Array,
    G_F: Array,
    lam_re: Array,
    lam_im: Array,
    X: Array,
    Y: Array,
    c: Array,
    zeta: Array,
    even: Array,
    odd: Array,
    base_down: Array,
    fading: IntArray,
    base_row: Array,
    base_out: Array,
    thickness: Array,
    above: Array,
    mu0: Array,
    mu_out: Array,
    n_up: int,
    level: Array,
    level_layer: Array,
    out: Array,
) -> None:
    """`vrte._core.reconstruct` on a device: fills out (order, n_tau, n_rhs, S n_out).
    As many orders are done at once as scratch memory is meant for, and none once the crew is stopped."""
    start = time.perf_counter()
    (n_order, n_layer, n), n_out = lam_re.shape, mu_out.size
    sizes = Sizes(n_order, n_layer, n, out.shape[3] // max(n_out, 1), n_out, n_up, mu0.size, c.shape[2], level.size)
    per_order = (G_E, G_F, lam_re, lam_im, X, Y, c, zeta, even, odd, base_down, fading, base_row)
    with ExitStack() as stack:

        def lend(values: Any) -> Any:
            return stack.enter_context(lent(session, values, False))

        places = Places(*(lend(values) for values in (base_out, thickness, above, mu0, mu_out, level, level_layer)))
        each = max(1, MOST_DOUBLES // max(1, sum(sizes.doubles)))
        for first in range(0, n_order if out.size else 0, each):
            if crew.stop[0]:
                break
            here = slice(first, min(first + each, n_order))
            solved = Solved(*(lend(values[here]) for values in per_order))
            with lent(session, out[here]) as result:
                group = Sizes(**{**vars(sizes), "orders": here.stop - first})
                reconstruct_orders(session, group, solved, places, result, bool((base_row >= 0).any()))
    crew.seconds[0] += time.perf_counter() - start
