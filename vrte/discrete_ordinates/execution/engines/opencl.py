"""An OpenCL device: all orders of many plans in one call, by products and inverses alone.

What the loops need goes up, what was asked for comes down; in between come only a few numbers an order, which steer:
norms, gaps and residuals.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, partial
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from vrte import _core
from vrte.basics.arrays import Array, IntArray, record, replace_unchecked
from vrte.basics.memory import ALWAYS_THERE, BYTES, find_available_bytes
from vrte.basics.running import Run, ThreadTeam
from vrte.cl import assembly, doubling, invariance, joining, reconstruction, sums
from vrte.cl.device import choose_precision, find_chosen_device, raise_device_errors
from vrte.cl.device import session as open_session
from vrte.cl.doubling import Frame
from vrte.cl.errors import check_room
from vrte.cl.session import Session, Traffic
from vrte.discrete_ordinates.execution.engines.cpu import Processor, keep_verified, make_answer
from vrte.discrete_ordinates.execution.engines.engine import Answer, Piece
from vrte.discrete_ordinates.execution.sums import Sum
from vrte.discrete_ordinates.orders.base import expand_base
from vrte.discrete_ordinates.orders.doubling import Doubling, find_asymmetry
from vrte.discrete_ordinates.orders.invariance import TIGHTER, find_allowed_residuals, find_flux_up
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.slabs import SlabStack, cut_layers, find_leaving_light
from vrte.discrete_ordinates.orders.solved import Orders
from vrte.discrete_ordinates.planning.memory import count_doubles_of_kernels
from vrte.discrete_ordinates.planning.plan import Plan

STACKS = 14  # extended matrices in memory per item, R and T included
SHARE = 0.5  # fraction of the device memory that a batch may use
LARGEST_SHARE = 0.5  # fraction of the largest allocation that a part of the result may use
IN_DOUBLES = "doubling in doubles"  # algorithm of items whose answer in floats is in doubt
BY_SLABS = ("doubling", IN_DOUBLES)  # algorithms that work slab by slab
# Residuals up to which an answer in floats counts: a tenth of its accuracy of 1e-4, as 1e-9 is of doubles' 1e-8; that
# of transmission is nine times the error that rounding makes of T, and more (docs/how_to/opencl.md).
ALLOWED_OF_FLOATS = {"residual_of_reflection": 1e-5, "residual_of_transmission": 5e-4, "residual_of_adding": 1e-5}
STACKED = {"kernels": 1, "path": 0, "table": 0, "out": 0}  # axis along which scenes follow each other
TOGETHER = 32e6  # bytes of what waiting sums read and add to, after which they are performed
CACHED = 256e6  # bytes of matrices per batch on a processor: larger batches are not faster


def open_stages() -> Any:
    """The stages that run on the device by themselves, with the arguments of those of `_core`.

    Raises DeviceError where there is no device, MissingExtraError without pyopencl; whatever fails on the device while
    they run is a DeviceError, too.
    """
    opened = open_session()
    stages: dict[str, Callable[..., Any]] = {
        "assemble": assembly.assemble_arrays,
        "reconstruct": reconstruction.reconstruct,
        "azimuthal_sum": sums.azimuthal_sum,
        "add_single_scattering": sums.add_single_scattering,
        "double_slabs": doubling.double_slabs,
        "join_slabs": joining.join_slabs,
        "reflect_semi_infinite": invariance.reflect_semi_infinite_arrays,
    }
    return SimpleNamespace(**{name: partial(run_alone, stage, opened) for name, stage in stages.items()})


def run_alone(stage: Callable[..., Any], opened: Session, *arguments: Any, **named: Any) -> Any:
    """One call of a stage, no other thread's kernels beside it."""
    with opened.lock, raise_device_errors():
        return stage(opened, *arguments, **named)


@record
class Found:
    """Fourier orders of scenes, one scene behind the other: kernels (item, n_tau, n_in, n_col, n_out, S) in the
    public frame; flux (item, n_tau, 2, n_in, n_col), up and down; residuals by name, (item,)."""

    kernels: Array
    flux: Array
    residuals: dict[str, Array]

    def part(self, items: slice) -> Orders:
        """The light of some items, with their residuals."""
        up, down = self.flux[items.start].swapaxes(0, 1)
        return Orders(self.kernels[items], up, down, {name: values[items] for name, values in self.residuals.items()})


@dataclass(eq=False)
class Device:
    """See `Engine`. ``asked``: the precision asked for, ``accuracy``: the finest that is; ``before``: what had gone to
    and from the device when the work began."""

    asked: str = "auto"
    accuracy: float = 0.0
    before: Traffic = field(default_factory=Traffic)
    stages: ClassVar[Any] = _core
    takes_many: ClassVar[bool] = True

    @cached_property
    def precision(self) -> tuple[str, str]:
        """The precision, "double" or "single", and why."""
        return choose_precision(self.asked, self.accuracy, find_chosen_device())

    @cached_property
    def session(self) -> Session:
        """The device at work on Fourier orders."""
        return open_session(self.precision[0])

    @cached_property
    def in_doubles(self) -> Session | None:
        """The same in double precision, for what needs it; None where the device has none."""
        return open_session() if find_chosen_device().double_precision else None

    @property
    def others(self) -> Mapping[str, str]:
        """By which algorithm an order is solved again; what is in doubt in floats is solved in doubles."""
        if self.precision[0] == "single" and self.in_doubles is not None:
            return {"invariance": IN_DOUBLES, "doubling": IN_DOUBLES}
        return {"invariance": "doubling"}

    @property
    def piece_bytes(self) -> float:
        """Of a result at once."""
        return LARGEST_SHARE * float(self.session.device.max_mem_alloc_size)

    @contextmanager
    def at_work(self) -> Iterator[None]:
        """No other thread's kernels beside; what fails on the device is a DeviceError."""
        with self.session.lock, raise_device_errors():
            self.before = replace(self.session.traffic)
            yield

    def check_memory(self, plans: Sequence[Plan], run: Run) -> None:
        """Raises DeviceError where not even one order at a time, what all of them leave and a share of the result
        fit."""
        pieces = [Piece(0, plan, block, block.orders[:1], block.choice.name) for plan in plans for block in plan.blocks]
        kernels = [BYTES * count_doubles_of_kernels(piece.block) for piece in pieces]
        matrices = max(map(count_matrix_bytes, pieces), default=0.0)
        result = max(BYTES * plan.wanted.doubles(plan.request.phi.size) for plan in plans)
        if sum(kernels) + matrices + result < ALWAYS_THERE:
            return
        needed = sum(kernels) + matrices + min(result, self.piece_bytes)
        check_room(
            self.session, needed, max(matrices / STACKS, *kernels, 0.0), max(0.0, find_available_bytes() - result)
        )

    def grouped(self, pieces: Sequence[Piece]) -> Iterator[list[Piece]]:
        """Pieces that are alike, as many as the device has room for."""
        groups: dict[tuple[Any, ...], list[Piece]] = {}
        for piece in pieces:
            groups.setdefault(make_group_key(piece), []).append(piece)
        room = find_matrix_room(self.session)
        for waiting in groups.values():
            taken: list[Piece] = []
            used = 0.0
            while waiting:
                piece = waiting.pop(0)
                size = count_matrix_bytes(piece)
                if size > room and piece.orders.size > 1:
                    waiting[:0] = piece.halves()
                    continue
                if taken and used + size > room:
                    yield taken
                    taken, used = [], 0.0
                taken.append(piece)
                used += size
            yield taken

    def solve(self, pieces: list[Piece], run: Run, report: Callable[[int], None]) -> list[Answer]:
        """All orders of all pieces of a group."""
        found, allowed = self.find(pieces, run), self.find_allowed(pieces[0])
        answers, first = list[Answer](), 0
        for piece in pieces:
            part = found.part(slice(first, first + piece.orders.size))
            answers.append(make_answer(piece, *keep_verified(piece.orders, part, allowed)))
            first += piece.orders.size
        return answers

    def find(self, pieces: list[Piece], run: Run) -> Found:
        """What the items of pieces are, in the precision of `session` or, where that left doubts, in doubles."""
        if pieces[0].name == "invariance":
            return solve_by_invariance(self.session, pieces, run)
        session = self.in_doubles if pieces[0].name == IN_DOUBLES else self.session
        assert session is not None
        return solve_by_doubling(session, pieces, run)

    def find_allowed(self, piece: Piece) -> dict[str, float]:
        """Residuals up to which the orders of a piece count."""
        allowed: dict[str, float] = Doubling.allowed | find_allowed_residuals(piece.plan.accuracy)
        return allowed | (ALLOWED_OF_FLOATS if self.precision[0] == "single" and piece.name != IN_DOUBLES else {})

    def failure(self, piece: Piece, order: int, reason: str) -> str:
        """What to tell of an order that nothing here can verify."""
        return f"the OpenCL device cannot verify Fourier order {order} by {piece.name} ({reason}): " + (
            "there are no doubles to solve it in"
            if self.in_doubles is None
            else "backend 'openmp' has another algorithm"
        )

    def diagnostics(self) -> dict[str, Any]:
        """Which device it was, what it computed in, and what went to and from it for all scenes of the call so far."""
        precision, rule = self.precision
        reported: dict[str, Any] = {"device": find_chosen_device().name, "precision": precision, "precision_rule": rule}
        return reported | {"traffic": asdict(self.session.traffic.since(self.before))}

    def add_up(self, results: Sequence[Sum], run: Run, report: Callable[[int], None]) -> None:
        """As the processor does, with the device's stages; single scattering always in doubles, by the processor where
        the device has none."""
        doubles, room, calls = self.in_doubles, self.piece_bytes, WaitingCalls(run)
        scatter = partial(sums.add_single_scattering, doubles) if doubles else _core.add_single_scattering
        stages = SimpleNamespace(
            azimuthal_sum=partial(calls.add, "fourier sum", partial(sums.azimuthal_sum, self.session)),
            add_single_scattering=partial(calls.add, "single scattering", scatter),
        )

        def advance(done: int) -> None:
            if calls.size >= min(TOGETHER, room):
                calls.perform()
            report(done)

        Processor(piece_bytes=room).add_up(results, replace_unchecked(run, kernels=stages), advance)
        calls.perform()


@dataclass(eq=False)
class WaitingCalls:
    """Calls of the sums' stages that wait until they are performed, those that differ in the arrays of `STACKED` alone
    in one call; ``waiting``: by what they have in common and a number, their arguments; ``last``: the number of the
    newest calls that add to a table, by its address, since each table is added to in the order of the calls; ``size``:
    bytes of those arrays."""

    run: Run
    waiting: dict[Any, list[dict[str, Any]]] = field(default_factory=dict)
    newest: dict[Any, int] = field(default_factory=dict)
    last: dict[int, int] = field(default_factory=dict)
    size: float = 0.0

    def add(self, name: str, stage: Callable[..., Any], crew: ThreadTeam, **given: Any) -> None:
        """One more call of a stage, to be timed under ``name``."""
        shared = (
            (key, value) if not isinstance(value, np.ndarray) else (key, value.shape, key in STACKED or value.tobytes())
            for key, value in given.items()
        )
        common, table = (name, stage, *shared), given["out"].__array_interface__["data"][0]
        number = self.newest.get(common, -1)
        if number < self.last.get(table, 0):
            number = self.newest[common] = len(self.waiting)
        self.last[table] = number
        self.waiting.setdefault((number, *common), []).append(given)
        self.size += sum(given[key].nbytes for key in STACKED.keys() & given.keys())

    def perform(self) -> None:
        """Makes all waiting calls, and adds what joined ones find to each table."""
        for (_, name, stage, *_), calls in self.waiting.items():
            joined = calls[0] if len(calls) == 1 else join_calls(calls)
            with self.run.timed(name) as crew:
                stage(crew, **joined)
            if len(calls) > 1:
                for call, found in zip(calls, np.split(joined["out"], len(calls)), strict=True):
                    call["out"][...] += found
        self.waiting, self.newest, self.last, self.size = {}, {}, {}, 0.0


def join_calls(calls: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Arguments of one call of a stage that does what several do, and adds to zeros: stack behind stack."""
    first, count = calls[0], len(calls)
    joined: dict[str, Any] = {"out": np.zeros((count * first["out"].shape[0], *first["out"].shape[1:]))}
    for key in STACKED.keys() & (first.keys() - joined.keys()):
        joined[key] = np.concatenate([call[key] for call in calls], STACKED[key])
    if "kernels" in first:
        before = first["kernels"].shape[1] * np.arange(count, dtype=np.int32)[:, None]
        joined["levels"] = (before + first["levels"]).ravel()
    else:
        joined["slab_stacks"] = count * first.get("slab_stacks", 1)
    return first | joined


def open_engine(asked: str = "auto", accuracy: float = 0.0) -> Device:
    """The device that is chosen, opened when it is used; ``asked``: the precision, for an ``accuracy``."""
    return Device(asked, accuracy)


def make_group_key(piece: Piece) -> tuple[Any, ...]:
    """Alike for pieces that can be solved in one call: whose matrices have the same sizes."""
    problem = piece.problem
    arrays = problem.nodes, problem.weights, problem.mu_out, problem.mu0, problem.columns
    shape: tuple[Any, ...] = ()
    if piece.name in BY_SLABS:
        slab_stack = cut_layers(problem)
        shape = slab_stack.slabs.size, slab_stack.interface.tobytes(), piece.block.base.orders_reflected > 0
    return piece.name, problem.stokes, problem.n_up, *(a.tobytes() for a in arrays), *shape


def find_matrix_room(opened: Session) -> float:
    """Bytes of the device's memory that matrices may take."""
    device = opened.device
    room = min(opened.room, SHARE * device.global_mem_size, STACKS * float(device.max_mem_alloc_size))
    return min(room, CACHED) if opened.on_host else room


def count_matrix_bytes(piece: Piece) -> float:
    """Of the matrices that a piece needs."""
    problem = piece.problem
    rows, columns = problem.size + problem.rows_out + 16, problem.size + problem.n_rhs
    slabs = cut_layers(problem).thickness.size if piece.name in BY_SLABS else 1
    return 8.0 * STACKS * piece.orders.size * slabs * rows * columns


@record
class Batch:
    """Pieces and their stacks, whose materials, pairs of (order, material) and slabs of orders lie one behind the
    other; directions and Stokes parameters are the same for all."""

    pieces: list[Piece]
    slab_stacks: list[SlabStack]

    @property
    def problem(self) -> Problem:
        """Of the first."""
        return self.slab_stacks[0].problem

    @property
    def frame(self) -> Frame:
        """What all slabs share."""
        problem = self.problem
        return Frame(problem.nodes, problem.weights, problem.mu0, problem.columns, problem.mu_out)

    def joined(self, make: Callable[[Piece, SlabStack], NDArray[Any]]) -> Any:
        """What it makes of each, one behind the other."""
        return np.concatenate([make(*pair) for pair in zip(self.pieces, self.slab_stacks, strict=True)])

    def places(self, each: Callable[[SlabStack], Any], count: Callable[[SlabStack], int]) -> IntArray:
        """Places among so many of each order, counted on through all orders of all pieces."""
        first, found = 0, []
        for piece, slab_stack in zip(self.pieces, self.slab_stacks, strict=True):
            starts = first + count(slab_stack) * np.arange(piece.orders.size)
            found.append((starts[:, None] + each(slab_stack)).ravel())
            first += count(slab_stack) * piece.orders.size
        return np.concatenate(found).astype(np.int32)


def solve_by_doubling(opened: Session, pieces: list[Piece], run: Run) -> Found:
    """Assembly, doubling and joining of all orders of all pieces."""
    batch = Batch(pieces, [cut_layers(piece.problem) for piece in pieces])
    problem, frame, slab_stack = batch.problem, batch.frame, batch.slab_stacks[0]
    with run.timed("assembly", opened.finish):
        matrices = assemble_batch(opened, batch)
    with run.timed("doubling", opened.finish):
        slabs = doubling.double(opened, frame, describe_batch(opened, batch), matrices, run.stop)
    if run.stop[0]:
        raise KeyboardInterrupt
    with run.timed("joining", opened.finish):
        slab_stacks = joining.SlabStacks(
            slab=batch.places(lambda each: each.slabs, lambda each: each.thickness.size).reshape(
                -1, slab_stack.slabs.size
            ),
            above=batch.joined(
                lambda piece, slab_stack: np.broadcast_to(slab_stack.above, (piece.orders.size, slab_stack.above.size))
            ),
            turned=batch.joined(lambda piece, slab_stack: piece.orders == 0) & problem.conserves,
            interface=slab_stack.interface,
            ground=make_ground(batch),
        )
        joined = joining.join(opened, frame, slab_stacks, slabs.R, slabs.T, slabs.lost)
        made = joined.up, joined.down, joined.flux, joined.info, joined.residual, slabs.state, slabs.residual
        up, down, flux, info, of_adding, state, of_slabs = opened.download_all(made)
    of_slabs = find_worst_of_items(batch, of_slabs)
    singular = (info != 0) | (find_worst_of_items(batch, state["singular"])[:, 0] != 0)
    residuals = {
        "residual_of_reflection": of_slabs[:, 0],
        "residual_of_transmission": of_slabs[:, 1],
        "residual_of_adding": np.where(singular, np.inf, of_adding.max(axis=1)),
    }
    flux = flux.reshape(*flux.shape[:3], problem.mu0.size, -1)
    return Found(find_leaving_light(slab_stack, up, down), flux, residuals)


def find_worst_of_items(batch: Batch, values: Array) -> Array:
    """The largest over the slabs of each item: values (slab item, ...), (item, k)."""
    shapes = [
        (piece.orders.size, each.thickness.size) for piece, each in zip(batch.pieces, batch.slab_stacks, strict=True)
    ]
    parts = np.split(values, np.cumsum([orders * slabs for orders, slabs in shapes])[:-1])
    return np.concatenate([part.reshape(*shape, -1).max(axis=1) for part, shape in zip(parts, shapes, strict=True)])


def pad_coefficients(tables: Sequence[Array]) -> Array:
    """Expansion coefficients (material, term, 6) of several problems, one behind the other, as long as the longest."""
    found = np.zeros((sum(table.shape[0] for table in tables), max(table.shape[1] for table in tables), 6))
    first = 0
    for table in tables:
        found[first : first + table.shape[0], : table.shape[1]] = table
        first += table.shape[0]
    return found


def assemble_batch(opened: Session, batch: Batch) -> assembly.Assembled:
    """E, F, G and sources of every pair of (order, material)."""
    problem, counts = batch.problem, [each.problem.albedo.size for each in batch.slab_stacks]
    first = np.cumsum([0, *counts])
    pairs = [
        np.meshgrid(piece.orders, k + np.arange(n), indexing="ij")
        for piece, k, n in zip(batch.pieces, first, counts, strict=False)
    ]
    order, material = (np.concatenate([pair[k].ravel() for pair in pairs]) for k in range(2))
    what = assembly.upload_scattering(
        opened,
        order,
        material,
        pad_coefficients([each.problem.coefficients for each in batch.slab_stacks]),
        batch.joined(lambda piece, slab_stack: slab_stack.problem.terms),
        batch.joined(lambda piece, slab_stack: slab_stack.problem.albedo),
        problem.stokes,
    )
    return assembly.assemble(opened, what, problem.directions, problem.weights, problem.mu_out.size)


def describe_batch(opened: Session, batch: Batch) -> Any:
    """Every slab of every order."""

    def each(make: Callable[[SlabStack], Array]) -> Array:
        return batch.joined(lambda piece, slab_stack: np.tile(make(slab_stack), piece.orders.size))

    albedo = each(lambda slab_stack: slab_stack.problem.albedo[slab_stack.material])
    orders = batch.joined(lambda piece, slab_stack: np.repeat(piece.orders, slab_stack.thickness.size))
    return doubling.describe_slabs(
        opened,
        batch.frame,
        thickness=each(lambda slab_stack: slab_stack.thickness),
        albedo=albedo,
        asymmetry=each(lambda slab_stack: find_asymmetry(slab_stack.problem)[slab_stack.material]),
        of=batch.places(lambda each: each.material, lambda each: each.problem.albedo.size),
        turned=(orders == 0) & batch.problem.conserves,
        clear=(albedo == 0.0) & batch.problem.skip_flags.clear,
    )


def make_ground(batch: Batch) -> joining.Ground | None:
    """The base of every item; None where all are black."""
    if not batch.pieces[0].block.base.orders_reflected:
        return None
    grounds = []
    for piece, slab_stack in zip(batch.pieces, batch.slab_stacks, strict=True):
        base = expand_base(piece.block.base, slab_stack.problem, int(piece.orders[-1]) + 1, piece.plan.accuracy)
        turned = (piece.orders == 0) & slab_stack.problem.conserves
        row = base.row[piece.orders]
        grounds.append(joining.turn_ground(batch.frame, turned, row, base.matrix, base.source, base.out))
    names = "matrix", "source", "out", "absorbed"
    return joining.Ground(*(np.concatenate([getattr(ground, name) for ground in grounds]) for name in names))


def solve_by_invariance(opened: Session, pieces: list[Piece], run: Run) -> Found:
    """Fixed points of the invariance equation for all orders of all pieces: the top of semi-infinite layers."""
    problem, orders = pieces[0].problem, np.concatenate([piece.orders for piece in pieces])
    off, indices = problem.off_nodes
    n_out, which = problem.mu_out.size, np.repeat(np.arange(len(pieces)), [piece.orders.size for piece in pieces])
    problems = [piece.problem for piece in pieces]
    table = pad_coefficients([each.coefficients[:1] for each in problems])
    terms, albedo = (np.array([getattr(each, name)[0] for each in problems]) for name in ("terms", "albedo"))
    tolerance = np.array([TIGHTER * piece.plan.accuracy for piece in pieces])[which]
    directions = np.concatenate([problem.nodes, off]), problem.weights, indices[:n_out], indices[n_out:]
    with run.timed("invariance", opened.finish):
        what = assembly.upload_scattering(opened, orders, which, table, terms, albedo, problem.stokes)
        found = invariance.reflect_semi_infinite(opened, what, *directions, problem.columns, tolerance, run.stop)
    levels, beams = problem.level.size, (problem.mu0.size, problem.columns.shape[0])
    kernels = found.up.reshape(orders.size, 1, *beams, n_out, len(problem.stokes))
    kernels[..., : problem.n_up, :] *= problem.flip / (2.0 * np.pi)
    kernels[..., problem.n_up :, :] = 0.0
    flux = np.zeros((orders.size, levels, 2, *beams))
    for item in np.flatnonzero(orders == 0):
        flux[item, :, 0] = find_flux_up(problem, found.on_nodes[item])
    kernels = np.broadcast_to(kernels, (orders.size, levels, *kernels.shape[2:]))
    return Found(kernels, flux, {"residual_of_invariance": found.residual})
