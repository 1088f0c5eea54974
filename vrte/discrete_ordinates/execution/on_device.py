"""Plans executed on an OpenCL device: all orders of all of them in one call, by products and inverses alone.

What the loops need goes up, what was asked for comes down; in between come only a few numbers an order, which steer:
norms, gaps, residuals, and the largest light, which says how many orders are left.
"""

import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte.basics.arrays import Array, IntArray
from vrte.basics.errors import AccuracyError
from vrte.basics.memory import ALWAYS_THERE, BYTES, available_bytes
from vrte.basics.running import Progress, Run
from vrte.cl import assembly, doubling, invariance, joining
from vrte.cl.device import chosen, device_errors, session
from vrte.cl.doubling import Frame, Items
from vrte.cl.faults import check_room
from vrte.cl.session import Session
from vrte.cl.sums import Kernels, dense
from vrte.discrete_ordinates.execution.solver import advice, orders_left, statement_of, steps
from vrte.discrete_ordinates.orders.base import Base as Reflection
from vrte.discrete_ordinates.orders.base import expand_base
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.routes import TIGHTER, Doubling
from vrte.discrete_ordinates.orders.slabs import Pile, cut
from vrte.discrete_ordinates.orders.truncating import flux_of_the_peak, spread_towards
from vrte.discrete_ordinates.planning.blocks import Block
from vrte.discrete_ordinates.planning.choice import Choice
from vrte.discrete_ordinates.planning.memory import doubles_of_kernels
from vrte.discrete_ordinates.planning.plan import Plan
from vrte.results.solution import Solution

REPEATED = Choice("doubling", "the fixed points of invariance did not settle")
STACKS = 14  # extended matrices that an item needs at once, R and T included
SHARE = 0.5  # of the device's memory
LARGEST_SHARE = 0.5  # of the largest allocation: of a result at once
CACHED = 256e6  # bytes of matrices at once on a processor: more does not make it faster


@dataclass(frozen=True, eq=False)
class Light:
    """Multiply scattered light of some orders on the device, ``kernels`` (order, n_tau, n_in, n_col, n_out, S) times
    ``factors`` (n_out, S) in the public frame, with its places in the request."""

    orders: IntArray
    stokes: IntArray
    columns: IntArray
    kernels: Kernels
    factors: Array


@dataclass(eq=False)
class Task:
    """A plan on its way: blocks done, orders left, what was found."""

    plan: Plan
    flux_up: Array
    flux_down: Array
    brightest: Array
    left: int
    blocks: int = 0
    steps: int = 0
    found: dict[int, Array] = field(default_factory=dict)
    lights: list[Light] = field(default_factory=list)
    orders: set[int] = field(default_factory=set)
    by: dict[str, int] = field(default_factory=dict)
    residuals: dict[str, float] = field(default_factory=dict)
    unknowns: int = 0
    repeated: set[int] = field(default_factory=set)

    def next_blocks(self) -> list[tuple[Block, IntArray]]:
        """Blocks that come before the next look at how many orders are left, with their orders."""
        blocks = self.plan.blocks
        if self.blocks < len(blocks) and blocks[self.blocks].orders[0] > max(self.found, default=self.left):
            self.left = orders_left(self.plan, self.brightest, self.found, self.left)
        taken: list[tuple[Block, IntArray]] = []
        last = -1
        while self.blocks < len(blocks) and (not taken or blocks[self.blocks].orders[0] <= last):
            block = blocks[self.blocks]
            orders = block.orders[block.orders < self.left]
            self.blocks, self.steps, last = self.blocks + 1, self.steps + block.orders.size, int(block.orders[-1])
            if orders.size:
                taken.append((block, orders))
        return taken


@dataclass(frozen=True, eq=False)
class Piece:
    """Orders of a block of a task."""

    task: Task
    block: Block
    orders: IntArray

    @property
    def problem(self) -> Problem:
        """What they are orders of."""
        return self.block.problem

    @property
    def key(self) -> tuple[Any, ...]:
        """Alike for pieces that can be solved in one call."""
        problem, name = self.problem, self.block.choice.name
        arrays = problem.nodes, problem.weights, problem.mu_out, problem.mu0, problem.columns
        shape: tuple[Any, ...] = ()
        if name == "doubling":
            pile = cut(problem)
            shape = pile.slabs.size, pile.interface.tobytes(), self.block.base.orders_reflected > 0
        return name, problem.stokes, problem.n_up, *(a.tobytes() for a in arrays), *shape

    def halves(self) -> tuple["Piece", "Piece"]:
        """The first orders and the others."""
        middle = self.orders.size // 2
        return replace(self, orders=self.orders[:middle]), replace(self, orders=self.orders[middle:])


@dataclass(frozen=True, eq=False)
class Found:
    """kernels (item, n_tau, n_in, n_col, n_out, S) on the device, ``shape`` that; what they are to be multiplied with,
    (n_out, S); flux (item, n_tau, 2, n_in, n_col); residuals by name, (item,); singular (item,): above 0 where a matrix
    was."""

    kernels: Any
    shape: tuple[int, ...]
    factors: Array
    flux: Array
    residuals: dict[str, Array]
    singular: Array


def solve(plan: Plan, run: Run, progress: Progress | None = None) -> Solution:
    """The diffuse field of a plan. Raises AccuracyError where the device cannot vouch for its answer, DeviceError where
    it fails."""
    return solve_all([plan], run, progress)[0]


def solve_all(plans: Sequence[Plan], run: Run, progress: Progress | None = None) -> list[Solution]:
    """The fields of many plans; blocks of different plans that are alike are solved in one call."""
    from vrte.discrete_ordinates.execution.summing_on_device import fill

    start = time.perf_counter()
    opened = session()
    tasks = [task_of(plan) for plan in plans]
    total = sum(steps(plan) for plan in plans)
    with opened.lock, device_errors():
        check_memory(opened, tasks)
        while pieces := [Piece(task, *found) for task in tasks for found in task.next_blocks()]:
            for group in grouped(pieces, opened):
                solve_group(opened, group, run)
            done = sum(task.steps for task in tasks)
            told(progress, done, total)
        parts = [fill(opened, task, run) for task in tasks]
    told(progress, total, total)
    return [solution(task, values, run, start) for task, values in zip(tasks, parts, strict=True)]


def check_memory(opened: Session, tasks: Sequence[Task]) -> None:
    """Raises DeviceError where not even one order at a time, what all of them leave and a share of the result fit."""
    blocks = [block for task in tasks for block in task.plan.blocks]
    kernels = [BYTES * doubles_of_kernels(block) for block in blocks]
    matrices = max((bytes_of(Piece(tasks[0], block, block.orders[:1])) for block in blocks), default=0.0)
    result = max(BYTES * task.plan.wanted.doubles(task.plan.request.phi.size) for task in tasks)
    share = min(result, LARGEST_SHARE * float(opened.device.max_mem_alloc_size))
    if sum(kernels) + matrices + result < ALWAYS_THERE:
        return
    largest = max(matrices / STACKS, *kernels, 0.0)
    check_room(opened, sum(kernels) + matrices + share, largest, max(0.0, available_bytes() - result))


def told(progress: Progress | None, done: int, total: int) -> None:
    """Calls it if it is there."""
    if progress is not None:
        progress(done, total)


def task_of(plan: Plan) -> Task:
    """A plan not begun."""
    request = plan.request
    flux_up, flux_down = np.zeros((2, request.tau.size, request.mu0.size, request.columns.shape[0]))
    return Task(plan, flux_up, flux_down, plan.brightest, plan.orders)


def grouped(pieces: Sequence[Piece], opened: Session) -> Iterator[list[Piece]]:
    """Pieces that are alike, as many as the device has room for."""
    groups: dict[tuple[Any, ...], list[Piece]] = {}
    for piece in pieces:
        groups.setdefault(piece.key, []).append(piece)
    room = room_for_matrices(opened)
    for group in groups.values():
        taken: list[Piece] = []
        waiting, used = list(group), 0.0
        while waiting:
            piece = waiting.pop(0)
            size = bytes_of(piece)
            if size > room and piece.orders.size > 1:
                waiting[:0] = piece.halves()
                continue
            if taken and used + size > room:
                yield taken
                taken, used = [], 0.0
            taken.append(piece)
            used += size
        yield taken


def room_for_matrices(opened: Session) -> float:
    """Bytes."""
    device = opened.device
    room = min(SHARE * device.global_mem_size, STACKS * float(device.max_mem_alloc_size))
    return min(room, CACHED) if opened.on_host else room


def bytes_of(piece: Piece) -> float:
    """Of the matrices that a piece needs."""
    problem = piece.problem
    rows, columns = problem.size + problem.rows_out + 16, problem.size + problem.n_rhs
    slabs = cut(problem).thickness.size if piece.block.choice.name == "doubling" else 1
    return 8.0 * STACKS * piece.orders.size * slabs * rows * columns


def solve_group(opened: Session, pieces: list[Piece], run: Run) -> None:
    """Solves pieces that are alike, and notes what was found with their tasks."""
    name = pieces[0].block.choice.name
    found = SOLVERS[name](opened, pieces, run)
    if wrong := what_is_wrong(name, pieces, found):
        if name == "invariance":
            by_doubling = [replace(piece, block=replace(piece.block, choice=REPEATED)) for piece in pieces]
            for group in grouped(by_doubling, opened):
                solve_group(opened, group, run)
            return
        raise AccuracyError(wrong)
    problem = pieces[0].problem
    lit = np.abs(problem.columns).max(axis=1)
    largest, brightest = looked_at(opened, found, int(np.argmax(lit)))
    first = 0
    for piece in pieces:
        last = first + piece.orders.size
        note(piece, name, found, slice(first, last), largest, brightest / max(float(lit.max()), 1e-300))
        first = last


def note(piece: Piece, name: str, found: Found, items: slice, largest: Array, brightest: Array) -> None:
    """Puts down what a group's items are to a piece's task."""
    task, block, orders = piece.task, piece.block, piece.orders
    size = int(np.prod(found.shape[1:]))
    kernels = dense(found.kernels.data, (orders.size, *found.shape[1:]), items.start * size)
    stokes, columns = np.array(block.stokes, np.int32), np.array(block.columns, np.int32)
    task.lights.append(Light(orders, stokes, columns, kernels, found.factors))
    n_tau = task.plan.request.tau.size
    for order, light in zip(orders.tolist(), largest[items], strict=True):
        light = np.broadcast_to(light, (n_tau, light.shape[1]))
        task.found[order] = np.maximum(task.found[order], light) if order in task.found else light
    if orders[0] == 0:
        task.flux_up[..., list(block.columns)] += found.flux[items.start, :, 0]
        task.flux_down[..., list(block.columns)] += found.flux[items.start, :, 1]
        if block.stokes[0] == 0:
            task.brightest = np.maximum(task.brightest, brightest[items.start])
    task.orders |= set(orders.tolist())
    task.unknowns += orders.size * block.problem.size
    task.by[name] = task.by.get(name, 0) + orders.size
    if block.choice is REPEATED:
        task.repeated |= set(orders.tolist())
    for key, values in found.residuals.items():
        task.residuals[key] = max(task.residuals.get(key, 0.0), float(values[items].max()))


def looked_at(opened: Session, found: Found, lit: int) -> tuple[Array, Array]:
    """The largest of each item at each depth for each beam, and I in the column ``lit``, (item, n_tau, n_in)."""
    items, levels, n_in, n_col, n_mu, stokes = found.shape
    both = [opened.empty((items, levels, n_in)) for _ in range(2)]
    seen = int(np.count_nonzero(found.factors.any(axis=1)))
    shape = (np.int32(k) for k in (levels, n_in, n_col, n_mu, seen, stokes, lit))
    opened.launch("largest_light", (n_in, levels, items), *shape, found.kernels, *both)
    largest, brightest = (float(np.abs(found.factors).max()) * opened.download(a) for a in both)
    return largest, brightest


def what_is_wrong(name: str, pieces: list[Piece], found: Found) -> str:
    """Of the first item whose own equations do not hold, nothing where all do."""
    allowed: dict[str, float] = Doubling.allowed | {"residual_of_invariance": allowed_of_invariance(pieces)}
    orders = np.concatenate([piece.orders for piece in pieces])
    if found.singular.any():
        bad, reason = int(np.argmax(found.singular)), "a matrix is singular"
    else:
        doubts = [(key, int(np.argmax(~(values <= allowed[key])))) for key, values in found.residuals.items()]
        wrong = [(key, place) for key, place in doubts if not found.residuals[key][place] <= allowed[key]]
        if not wrong:
            return ""
        key, bad = wrong[0]
        reason = f"{key} {found.residuals[key][bad]:.2g}, allowed {allowed[key]:g}"
    return (
        f"the OpenCL device cannot vouch for Fourier order {orders[bad]} by {name} ({reason}): "
        f"backend 'openmp' has another algorithm{advice(pieces[0].problem)}"
    )


@dataclass(frozen=True, eq=False)
class Batch:
    """Pieces with their piles one behind the other; where each one's materials, pairs of (order, material), slabs of an
    order and items begin."""

    pieces: list[Piece]
    piles: list[Pile]

    @property
    def problem(self) -> Problem:
        """Of the first: directions and Stokes parameters are the same for all."""
        return self.piles[0].problem

    @property
    def frame(self) -> Frame:
        """What all slabs share."""
        problem = self.problem
        return Frame(problem.nodes, problem.weights, problem.mu0, problem.columns, problem.mu_out)

    def joined(self, make: Callable[[Piece, Pile], NDArray[Any]]) -> Any:
        """What it makes of each, one behind the other."""
        return np.concatenate([make(*pair) for pair in zip(self.pieces, self.piles, strict=True)])

    def starts(self, size: Callable[[Piece, Pile], int]) -> list[int]:
        """Where each one's begin, if it has so many."""
        sizes = [size(*pair) for pair in zip(self.pieces, self.piles, strict=True)]
        return [0, *itertools.accumulate(sizes)][:-1]


def solve_by_doubling(opened: Session, pieces: list[Piece], run: Run) -> Found:
    """Assembly, doubling and joining of all orders of all pieces."""
    batch = Batch(pieces, [cut(piece.problem) for piece in pieces])
    problem, frame, pile = batch.problem, batch.frame, batch.piles[0]
    begin = time.perf_counter()
    matrices = assembled(opened, batch)
    begin = booked(opened, run, "assembly", begin)
    slabs = doubling.Doubling(opened, frame, slab_items(batch), matrices).run(run.stop)
    begin = booked(opened, run, "doubling", begin)
    piles = joining.Piles(
        slab=places_of_slabs(batch),
        above=batch.joined(lambda piece, pile: np.broadcast_to(pile.above, (piece.orders.size, pile.above.size))),
        turned=batch.joined(lambda piece, pile: piece.orders == 0) & problem.conserves,
        interface=pile.interface,
        ground=ground_of(batch),
    )
    joint = joining.Joining(opened, frame, piles, slabs.R, slabs.T, slabs.lost).run(run.stop)
    if run.stop[0]:
        raise KeyboardInterrupt
    shape = (piles.slab.shape[0], pile.interface.size, problem.mu0.size, problem.columns.shape[0])
    directions = pieces[0].problem.mu_out.size, len(problem.stokes)
    kernels = leaving(opened, batch, joint, (*shape, *directions))
    worst = worst_of_items(batch, slabs.residual)
    singular = worst_of_items(batch, opened.download(slabs.info)[:, None].astype(float))[:, 0]
    residuals = {
        "residual_of_reflection": worst[:, 0],
        "residual_of_transmission": worst[:, 1],
        "residual_of_joints": joint.residual.max(axis=1),
    }
    flux = opened.download(joint.flux).reshape(*shape[:2], 2, *shape[2:])
    singular = np.maximum(singular, opened.download(joint.info))
    booked(opened, run, "joining", begin)
    return Found(kernels, (*shape, *directions), np.ones(directions), flux, residuals, singular)


def worst_of_items(batch: Batch, values: Array) -> Array:
    """The largest over the slabs of each item: values (slab item, k), (item, k)."""
    starts = batch.starts(lambda piece, pile: piece.orders.size * pile.thickness.size)
    found = [
        values[start : start + piece.orders.size * pile.thickness.size]
        .reshape(piece.orders.size, pile.thickness.size, -1)
        .max(axis=1)
        for start, piece, pile in zip(starts, batch.pieces, batch.piles, strict=True)
    ]
    return np.concatenate(found)


def booked(opened: Session, run: Run, name: str, begin: float) -> float:
    """Waits for what was enqueued and books its time; now. Raises KeyboardInterrupt where the solve is to stop."""
    opened.finish()
    now = time.perf_counter()
    run.book(name, now - begin)
    if run.stop[0]:
        raise KeyboardInterrupt
    return now


def assembled(opened: Session, batch: Batch) -> assembly.Assembled:
    """E, F, G and sources of every pair of (order, material)."""
    problem = batch.problem
    upload, longest = opened.constant, max(pile.problem.coefficients.shape[1] for pile in batch.piles)
    materials = batch.starts(lambda piece, pile: pile.problem.albedo.size)
    coefficients = np.zeros((materials[-1] + batch.piles[-1].problem.albedo.size, longest, 6))
    for start, pile in zip(materials, batch.piles, strict=True):
        given = pile.problem.coefficients
        coefficients[start : start + given.shape[0], : given.shape[1]] = given
    order = batch.joined(lambda piece, pile: np.repeat(piece.orders, pile.problem.albedo.size))
    material = np.concatenate(
        [
            np.tile(np.arange(start, start + pile.problem.albedo.size), piece.orders.size)
            for start, piece, pile in zip(materials, batch.pieces, batch.piles, strict=True)
        ]
    )
    return assembly.assemble(
        opened,
        upload(np.arange(order.size, dtype=np.int32)),
        upload(order.astype(np.int32)),
        upload(material.astype(np.int32)),
        problem.stokes,
        upload(coefficients),
        upload(batch.joined(lambda piece, pile: pile.problem.terms)),
        upload(batch.joined(lambda piece, pile: pile.problem.albedo)),
        upload(problem.directions),
        upload(problem.weights),
        problem.mu_out.size,
    )


def slab_items(batch: Batch) -> Items:
    """Every slab of every order."""

    def each(make: Callable[[Pile], Array]) -> Array:
        return batch.joined(lambda piece, pile: np.tile(make(pile), piece.orders.size))

    pairs = batch.starts(lambda piece, pile: piece.orders.size * pile.problem.albedo.size)
    of = np.concatenate(
        [
            (start + np.arange(piece.orders.size)[:, None] * pile.problem.albedo.size + pile.material).ravel()
            for start, piece, pile in zip(pairs, batch.pieces, batch.piles, strict=True)
        ]
    )
    albedo = each(lambda pile: pile.problem.albedo[pile.material])
    orders = batch.joined(lambda piece, pile: np.repeat(piece.orders, pile.thickness.size))
    return Items(
        thickness=each(lambda pile: pile.thickness),
        albedo=albedo,
        asymmetry=each(lambda pile: asymmetry_of(pile.problem)[pile.material]),
        of=of.astype(np.int32),
        turned=(orders == 0) & batch.problem.conserves,
        clear=(albedo == 0.0) & batch.problem.leave_out.clear,
    )


def asymmetry_of(problem: Problem) -> Array:
    """g of every material."""
    several = problem.coefficients.shape[1] > 1
    found: Array = problem.coefficients[:, 1, 0] / 3.0 if several else np.zeros_like(problem.albedo)
    return found


def places_of_slabs(batch: Batch) -> IntArray:
    """Which of the slab items lies where, (item, place)."""
    starts = batch.starts(lambda piece, pile: piece.orders.size * pile.thickness.size)
    found = [
        start + np.arange(piece.orders.size)[:, None] * pile.thickness.size + pile.slabs
        for start, piece, pile in zip(starts, batch.pieces, batch.piles, strict=True)
    ]
    return np.concatenate(found).astype(np.int32)


def ground_of(batch: Batch) -> joining.Ground | None:
    """The base of every item; None where all are black."""
    if not batch.pieces[0].block.base.orders_reflected:
        return None
    grounds = []
    for piece, pile in zip(batch.pieces, batch.piles, strict=True):
        accuracy, n_order = piece.task.plan.accuracy, int(piece.orders[-1]) + 1
        base: Reflection = expand_base(piece.block.base, pile.problem, n_order, accuracy)
        turned = (piece.orders == 0) & pile.problem.conserves
        row = base.row[piece.orders]
        grounds.append(joining.ground_of(batch.frame, turned, row, base.matrix, base.source, base.out))
    names = "matrix", "source", "out", "absorbed"
    return joining.Ground(*(np.concatenate([getattr(ground, name) for ground in grounds]) for name in names))


def leaving(opened: Session, batch: Batch, joint: joining.Joined, shape: tuple[int, ...]) -> Any:
    """Radiance of every item in the public frame, (item, n_tau, n_in, n_col, n_out, S)."""
    items, levels, n_in, n_col, n_mu, stokes = shape
    problem, pile = batch.problem, batch.piles[0]
    kernels = opened.empty(shape)
    sizes = n_in * n_col, levels, n_mu, batch.pieces[0].problem.n_up, problem.mu_out.size, stokes
    factors = opened.constant(problem.flip / (2.0 * np.pi)), opened.constant(np.full(stokes, 1.0 / (2.0 * np.pi)))
    opened.launch(
        "leaving",
        (n_in * n_col, levels, items),
        *(np.int32(size) for size in sizes),
        *(opened.constant(pile.out), *factors, joint.up, joint.down, kernels),
        opened.constant(np.arange(items, dtype=np.int32)),
    )
    return kernels


def tolerance_of(piece: Piece) -> float:
    """Where the iterations of its orders stop."""
    return TIGHTER * piece.task.plan.accuracy


def allowed_of_invariance(pieces: list[Piece]) -> float:
    """Residual up to which the answer counts."""
    return max(1e-9, 2.0 * max(tolerance_of(piece) for piece in pieces))


def solve_by_invariance(opened: Session, pieces: list[Piece], run: Run) -> Found:
    """Fixed points of the invariance equation for all orders of all pieces: the top of layers without end."""
    problem, upload = pieces[0].problem, opened.constant
    off, places = np.unique(np.concatenate([problem.mu_out, problem.mu0]), return_inverse=True)
    n_out, sizes = problem.mu_out.size, [piece.orders.size for piece in pieces]
    coefficients = np.zeros((len(pieces), max(piece.problem.coefficients.shape[1] for piece in pieces), 6))
    for k, piece in enumerate(pieces):
        coefficients[k, : piece.problem.coefficients.shape[1]] = piece.problem.coefficients[0]
    begin = time.perf_counter()
    made = invariance.reflect_endless(
        opened,
        upload(np.arange(sum(sizes), dtype=np.int32)),
        upload(np.concatenate([piece.orders for piece in pieces])),
        upload(np.repeat(np.arange(len(pieces), dtype=np.int32), sizes)),
        problem.stokes,
        upload(coefficients),
        upload(np.array([piece.problem.terms[0] for piece in pieces], np.int32)),
        upload(np.array([piece.problem.albedo[0] for piece in pieces])),
        upload(np.concatenate([problem.nodes, off])),
        upload(problem.weights),
        upload(places[:n_out].astype(np.int32)),
        upload(places[n_out:].astype(np.int32)),
        upload(problem.columns),
        upload(np.repeat([tolerance_of(piece) for piece in pieces], sizes)),
        run.stop,
    )
    shape = sum(sizes), 1, problem.mu0.size, problem.columns.shape[0], n_out, len(problem.stokes)
    flux = np.zeros((shape[0], 1, 2, *shape[2:4]))
    orders = np.concatenate([piece.orders for piece in pieces])
    if (orders == 0).any() and problem.conserves:
        on_nodes = opened.download(made.on_nodes)[:, :, :: len(problem.stokes)]
        flux[:, 0, 0] = (on_nodes @ np.sqrt(problem.weights * problem.nodes)).reshape(-1, *shape[2:4])
    factors = np.zeros(shape[4:])
    factors[: problem.n_up] = problem.flip / (2.0 * np.pi)
    booked(opened, run, "invariance", begin)
    residuals = {"residual_of_invariance": opened.download(made.residual)}
    return Found(made.up.reshape(shape), shape, factors, flux, residuals, np.zeros(shape[0]))


SOLVERS: dict[str, Callable[[Session, list[Piece], Run], Found]] = {
    "doubling": solve_by_doubling,
    "invariance": solve_by_invariance,
}


def solution(task: Task, parts: list[Array], run: Run, start: float) -> Solution:
    """What was found, and how."""
    plan = task.plan
    task.flux_down += flux_of_the_peak(plan.problem, plan.request.tau)
    diagnostics = {
        **plan.diagnostics(),
        "device": chosen().name,
        "threads": run.threads,
        "orders": len(task.orders),
        "unknowns": task.unknowns,
        "orders_by": task.by,
        "orders_repeated": statement_of({"doubling": task.repeated} if task.repeated else {}),
        **{name: value for name, value in sorted(task.residuals.items())},
        "stages": run.stages,
        "wall_seconds": time.perf_counter() - start,
    }
    return Solution(parts, task.flux_up, task.flux_down, diagnostics)


def spreads_of(plan: Plan) -> Any:
    """Towards which directions light of small angles stands for single scattering, (n_mu,)."""
    return spread_towards(plan.truncation, plan.problem, plan.mu)
