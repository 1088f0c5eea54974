"""Reconstruction on a device: the field at any depth and direction from the modes, (1:36)-(1:38)."""

from contextlib import ExitStack
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

from vrte import _core
from vrte.basics.running import ThreadTeam
from vrte.cl.matrices import STRIP, pad_to_strips
from vrte.cl.session import Placed, Session
from vrte.cl.stages import stand_in_for

MOST_DOUBLES = 1 << 26  # doubles of scratch memory for a group of orders, beside the caller's arrays
OF_ORDERS = (
    "G_E",
    "G_F",
    "lam_re",
    "lam_im",
    "X",
    "Y",
    "c",
    "zeta",
    "even",
    "odd",
    "base_down",
    "decaying",
    "base_row",
)
OF_ALL = ("base_out", "thickness", "above", "mu0", "mu_out", "level", "level_layer")


@dataclass(frozen=True)
class Sizes(Placed):
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
        lit = 2 * self.layers * self.n * pad_to_strips(self.rows)
        return lit, self.stops * self.n_rhs * self.n, self.layers * self.n_rhs * self.rows

    @property
    def place(self) -> tuple[Any, ...]:
        """COUNTS of reconstruction.cl."""
        return self.n, self.stokes, self.n_up, self.layers, self.levels, self.n_in, self.n_rhs


def reconstruct_orders(session: Session, sizes: Sizes, of: Any, out: Any, has_base: bool) -> None:
    """Fills out (order, n_level, n_rhs, rows): radiance times 2 pi for a unit beam, without singly scattered light;
    rows of light going up come first, flipped by D. of: what `_core.reconstruct` takes, on the device."""
    orders, layers, ld, launch = sizes.orders, sizes.layers, pad_to_strips(sizes.rows), session.launch
    lit, fed, part = (session.empty((orders * count,)) for count in sizes.doubles)
    indices = of.thickness, of.above, of.mu0, of.mu_out, of.level, of.level_layer
    lighting = sizes, sizes.rows, ld, of.G_E, of.G_F, of.X, of.Y, lit
    launch("light_of_modes", (ld // STRIP, orders * layers, 2), *lighting)
    launch("feed_modes", (sizes.stops, sizes.n_in, orders), sizes, of.lam_re, of.lam_im, of.c, *indices, fed)
    modes = of.lam_re, of.lam_im, of.decaying, of.even, of.odd, of.c, of.zeta
    stops = sizes.stops if layers > 1 else sizes.levels
    launch("sum_sources", (sizes.n_out, stops, orders), sizes, ld, lit, *modes, fed, *indices, out, part)
    if layers > 1 or has_base:
        base = of.base_down, of.base_row, of.base_out
        launch("pass_layers", (sizes.n_out, sizes.n_rhs, orders), sizes, *base, *indices, out, part)


@stand_in_for(_core.reconstruct)
def reconstruct(session: Session, crew: ThreadTeam, given: Any) -> None:
    """Fills out (order, n_tau, n_rhs, S n_out). As many orders are done at once as scratch memory is meant for, and
    none once the crew is stopped."""
    (orders, layers, n), n_out, n_rhs = given.lam_re.shape, given.mu_out.size, given.c.shape[2]
    stokes, n_level = given.out.shape[3] // max(n_out, 1), given.level.size
    whole = Sizes(orders, layers, n, stokes, n_out, given.n_up, given.mu0.size, n_rhs, n_level)
    each = max(1, MOST_DOUBLES // max(1, sum(whole.doubles)))
    for first in range(0, whole.orders if given.out.size else 0, each):
        if crew.stop[0]:
            break
        here = slice(first, min(first + each, whole.orders))
        arrays = {name: getattr(given, name)[here] for name in OF_ORDERS} | {
            name: getattr(given, name) for name in OF_ALL
        }
        with session.lent(given.out[here]) as out, ExitStack() as stack:
            lent = {name: stack.enter_context(session.lent(values, False)) for name, values in arrays.items()}
            sizes = replace(whole, orders=here.stop - first)
            reconstruct_orders(session, sizes, SimpleNamespace(**lent), out, bool((given.base_row >= 0).any()))
