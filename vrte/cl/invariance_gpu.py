"""Fixed points of invariance as a GPU wants them: all items take a step together, two launches, whatever their sizes.

Whether an item has converged stays on the device: its work-groups return at once from then on, and the host looks every
few steps, at growing distances, whether there is one left."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

import numpy as np

from vrte import _core
from vrte.basics.arrays import IntArray
from vrte.cl.assembly import compute_parity_columns, count_most_columns
from vrte.cl.invariance import Asked, FactorColumns, SemiInfinite, compute_off_node_results, put_cosines
from vrte.cl.matrices import GROUP, Stack, count_work_items, pad_to_strips
from vrte.cl.session import DeviceArray, Session

FIRST_LOOK, FEWEST, GROWTH = (
    6,
    4,
    4,
)  # steps before the first look, and before another: those done over GROWTH or FEWEST
LEFT = 1  # state of an item whose iteration has ended


@dataclass(frozen=True, eq=False)
class Sort:
    """Items on the same nodes among others: numbers of rows of R on the nodes and off them (``n``, ``u``), of columns;
    where its own begin in the memory of all, by name, in doubles, columns or items."""

    asked: Asked
    n: int
    u: int
    columns: int
    first: dict[str, int]

    @property
    def room(self) -> int:
        """How many fixed points are sought at once."""
        return self.asked.what.room

    @property
    def phi_ld(self) -> int:
        """Rows of phi, those on the nodes before those off them."""
        return pad_to_strips(self.n) + pad_to_strips(self.u)

    @property
    def stride_of_R(self) -> int:
        """What an item takes of R, on the nodes or off them."""
        return max(pad_to_strips(self.n), pad_to_strips(self.u)) * self.n

    def sizes(self) -> dict[str, int]:
        """What all its items take of each memory."""
        n, u, room = pad_to_strips(self.n), pad_to_strips(self.u), self.room
        each = {"phi": self.phi_ld * self.columns, "nodes_H": n * self.columns, "off_H": u * self.columns}
        each |= {"R": self.stride_of_R, "pairs": self.columns, "items": 1}
        return {name: room * size for name, size in each.items()} | {"mus": n + u}

    def places(self, rows: str) -> np.ndarray:
        """Rows of `Place` in invariance.cl, R's ``rows`` being "nodes" or "off" them."""
        n, u, item = pad_to_strips(self.n), pad_to_strips(self.u), np.arange(self.room)
        first, ld, row = self.first, (n, u)[rows == "off"], (0, n)[rows == "off"]
        phi = first["phi"] + item * self.phi_ld * self.columns
        H = first[f"{rows}_H"] + item * ld * self.columns
        nodes_H, R = first["nodes_H"] + item * n * self.columns, first["R"] + item * self.stride_of_R
        mus, pairs = first["mus"], first["pairs"] + item * self.columns
        columns = phi, phi + row, nodes_H, H, R, mus + row, mus, pairs, self.phi_ld, n, ld, self.n
        return np.stack(np.broadcast_arrays(*columns), axis=1).astype(np.int64)

    def sheet(self, rows: str, memory: dict[str, Any]) -> FactorColumns:
        """The nodes or what is off them."""
        n, u = pad_to_strips(self.n), pad_to_strips(self.u)
        size, ld, row = (self.n, n, 0) if rows == "nodes" else (self.u, u, n)
        phi = self.stack("phi", memory, self.phi_ld, size, row)
        return FactorColumns(phi, self.stack(f"{rows}_H", memory, ld, size), memory["mus"], self.first["mus"] + row)

    def stack(self, name: str, memory: dict[str, Any], ld: int, rows: int, row: int = 0) -> Stack:
        """Its matrices in a memory, from some row on."""
        return Stack(memory[name].data, rows, self.columns, ld, ld * self.columns, self.first[name] + row)


@dataclass(frozen=True, eq=False)
class Converged:
    """Of all items on the device: counts (item, 2) of columns, tolerance and rate, (item,), what makes HC of H, column
    by column, and listed (item,), 0 where an item is asked for; residual and steps (item,): how each has converged."""

    counts: Any
    tolerance: Any
    rate: Any
    pairs: Any
    weights: Any
    listed: Any
    residual: Any
    steps: Any


def reflect_batch(session: Session, asked: Sequence[Asked], stop: IntArray | None) -> list[SemiInfinite]:
    """As a GPU wants it, see `reflect_sorts`."""
    sorts = lay_out(asked)
    total = {name: sum(sort.sizes()[name] for sort in sorts) for name in sorts[0].sizes()}
    memory = {name: session.empty((size,)) for name, size in total.items() if name not in ("pairs", "items")}
    converged = make_convergence(session, total["pairs"], total["items"])
    counts = [begin_sort(session, sort, memory, converged) for sort in sorts]
    # the first two steps read by how much steps moved that there were not, and do nothing with it
    last = [session.empty((total["R"],)) for _ in range(4)] + [session.zeros((total["R"],)) for _ in range(2)]
    for rows in ("nodes", "off"):
        if stop is None or not stop[0]:
            converge_rows(session, sorts, rows, memory, converged, last[:3], last[3:], stop)
    found = []
    for sort, own in zip(sorts, counts, strict=True):
        Ru = memory["R"], sort.first["R"], sort.stride_of_R
        light = compute_off_node_results(session, sort.asked, own, sort.sheet("off", memory), *Ru, sort.n)
        found.append(SemiInfinite(*light, converged.residual, converged.steps, sort.first["items"]))
    return found


def lay_out(asked: Sequence[Asked]) -> list[Sort]:
    """Places for all of each in the memory of all, one behind the other."""
    bare = []
    for one in asked:
        n, u = (one.what.stokes * number for number in (int(one.weights.size), one.n_off))
        bare.append(Sort(one, n, u, count_most_columns(one.what.members, one.what.n_term), {}))
    sizes = [sort.sizes() for sort in bare]
    firsts = {name: list(accumulate((size[name] for size in sizes), initial=0)) for name in sizes[0]}
    return [
        Sort(sort.asked, sort.n, sort.u, sort.columns, {name: starts[k] for name, starts in firsts.items()})
        for k, sort in enumerate(bare)
    ]


def make_convergence(session: Session, columns: int, items: int) -> Converged:
    """Of items none of which is listed yet."""
    empty, zeros, whole = session.empty, session.zeros, np.int32
    return Converged(
        zeros((items, 2), whole),
        empty((items,)),
        zeros((items,)),
        empty((columns, 2), whole),
        empty((columns, 2)),
        session.upload(np.full(items, LEFT, whole)),
        zeros((items,)),
        zeros((items,), whole),
    )


def begin_sort(session: Session, sort: Sort, memory: dict[str, Any], converged: Converged) -> Any:
    """Columns of P_l^m, cosines, what makes HC of H; the numbers of columns of its own items."""
    asked, what = sort.asked, sort.asked.what
    phi = sort.stack("phi", memory, sort.phi_ld, sort.phi_ld)
    columns = compute_parity_columns(session, what, asked.directions, asked.weights, asked.n_off, phi)
    n_node, to = int(asked.weights.size), sort.first["mus"]
    for first, number, row in ((0, n_node, 0), (n_node, asked.n_off, pad_to_strips(sort.n))):
        put_cosines(session, what, asked.directions, first, number, memory["mus"], to + row)
    indices = sort.first["items"], sort.first["pairs"], sort.columns
    made = converged.pairs, converged.weights, converged.counts, asked.tolerance, converged.tolerance, converged.rate
    size = max(what.n_term, 1), what.items.size
    session.launch(
        "invariance_pairs", size, what, *indices, columns.counts, *made, converged.listed, what.items, group=(1, 1)
    )
    return columns.counts


def converge_rows(
    session: Session,
    sorts: Sequence[Sort],
    rows: str,
    memory: dict[str, Any],
    converged: Converged,
    led: list[DeviceArray],
    moved: list[DeviceArray],
    stop: IntArray | None,
) -> None:
    """Steps for R and H of some rows, the "nodes" or "off" them, as many as each item needs; ``led``: to which R the
    last steps led, ``moved``: by how much, this one first."""
    indices = session.upload(np.concatenate([sort.places(rows) for sort in sorts]))
    sheets = [sort.sheet(rows, memory) for sort in sorts]
    items, H = converged.residual.size, memory[f"{rows}_H"]
    steps, renewals = (
        [count_work_items(sheet.H.ld, of(sort)) for sort, sheet in zip(sorts, sheets, strict=True)]
        for of in (lambda sort: sort.n, lambda sort: max(sort.columns, 1))
    )
    tiles = max(across // GROUP * along // GROUP for across, along in steps)
    found = session.empty((items, tiles, 5))
    states = [session.empty((items,), np.int32) for _ in range(2)]
    convergence = [session.zeros((items, 7)) for _ in range(2)]
    group = (GROUP, GROUP, 1)

    def renew(step: int, before: tuple[Any, Any], after: tuple[Any, Any]) -> None:
        arrays = indices, converged.counts, memory["phi"], H, memory["R"], *led, *moved, tiles, found
        judged = converged.rate, converged.tolerance, converged.residual, converged.steps
        state = before[0], after[0], before[1], after[1]
        size = *(max(pair) for pair in zip(*renewals, strict=True)), items
        session.launch("invariance_renew_gpu", size, step, _core.MOST_STEPS, *arrays, *judged, *state, group=group)

    now, other = (convergence[0], states[0]), (convergence[1], states[1])
    renew(-1, (convergence[1], converged.listed), now)
    looks = list_looks()
    look = next(looks)
    size = *(max(pair) for pair in zip(*steps, strict=True)), items
    for step in range(_core.MOST_STEPS):
        arrays = indices, converged.counts, memory["mus"], converged.pairs, converged.weights, memory["nodes_H"], H
        last = memory["R"], *led, *moved, tiles, found, now[1]
        session.launch("invariance_step_gpu", size, *arrays, *last, group=group)
        renew(step, now, other)
        now, other = other, now
        led[:], moved[:] = led[2:] + led[:2], moved[2:] + moved[:2]
        if step + 1 == look:
            if (session.download(now[1]) == LEFT).all() or (stop is not None and stop[0]):
                return
            look = next(looks)


def list_looks() -> Iterator[int]:
    """After how many steps the host looks whether items are left: it waits, and what it launches needlessly returns at
    once.

    >>> looks = list_looks()
    >>> [next(looks) for _ in range(7)]
    [6, 10, 14, 18, 22, 27, 33]
    """
    look = FIRST_LOOK
    while True:
        yield look
        look += max(FEWEST, look // GROWTH)
