"""An OpenCL device: all orders of many plans in one call, by products and inverses alone.

What the loops need goes up, what was asked for comes down; in between come only a few numbers an order, which steer:
norms, gaps, residuals, and the largest light, which says how many orders are left.
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
from vrte.basics.arrays import Array, IntArray
from vrte.basics.memory import ALWAYS_THERE, BYTES, find_available_bytes
from vrte.basics.running import Run
from vrte.cl import assembly, doubling, invariance, joining, reconstruction, sums
from vrte.cl.device import choose_precision, find_chosen_device, raise_device_errors
from vrte.cl.device import session as open_session
from vrte.cl.doubling import Frame, Items
from vrte.cl.errors import check_room
from vrte.cl.session import Reading, Session, Traffic
from vrte.discrete_ordinates.execution.engines.device_sums import add_up
from vrte.discrete_ordinates.execution.engines.engine import Answer, Piece, make_empty_answer
from vrte.discrete_ordinates.execution.sums import Light, Sum
from vrte.discrete_ordinates.orders.base import expand_base
from vrte.discrete_ordinates.orders.doubling import Doubling, find_asymmetry
from vrte.discrete_ordinates.orders.invariance import TIGHTER, find_allowed_residuals, find_flux_up
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.slabs import SlabStack, cut_layers
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


@dataclass(frozen=True, eq=False)
class Found:
    """What items of a sort are, one behind the other: kernels (item, n_tau, n_in, n_col, n_out, S) on the device,
    ``shape`` that; incoming (n_col,): the largest element of each column; factors (n_out, S): what kernels are to be
    multiplied with; its `Numbers`, yet to be read."""

    kernels: Any
    shape: tuple[int, ...]
    incoming: Array
    factors: Array
    numbers: Reading


@dataclass(frozen=True, eq=False)
class Numbers:
    """Of the same items: flux (item, n_tau, 2, n_in, n_col); residuals by name, (item,); singular (item,): above 0
    where a matrix was."""

    flux: Array
    residuals: dict[str, Array]
    singular: Array


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
    def overwrites(self) -> bool:
        """What comes down is put in place of whatever is there."""
        return True

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

    def solve(self, pieces: list[Piece], run: Run, told: Callable[[int], None]) -> list[Answer]:
        """All orders of all pieces of a group; where an order is in doubt, its piece is."""
        found = self.find(pieces, run)
        (largest, brightest), numbers = self.session.read([look_at(self.session, found), found.numbers])
        answers, first = list[Answer](), 0
        for piece in pieces:
            items = slice(first, first + piece.orders.size)
            doubts = find_doubts(piece, numbers, items, self.session.precision)
            full = piece, found, numbers, items, largest[items], brightest[first]
            answers.append(make_empty_answer(doubts) if doubts else make_answer(*full))
            first = items.stop
        return answers

    def find(self, pieces: list[Piece], run: Run) -> Found:
        """What the items of pieces are, in the precision of `session`."""
        if pieces[0].name == "invariance":
            return solve_by_invariance(self.session, pieces, run)
        if pieces[0].name != IN_DOUBLES:
            return solve_by_doubling(self.session, pieces, run)
        assert self.in_doubles is not None
        found = solve_by_doubling(self.in_doubles, pieces, run)
        return replace(found, kernels=self.session.upload(self.in_doubles.download(found.kernels)))

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

    def add_up(self, sums: Sequence[Sum], run: Run, told: Callable[[int], None]) -> None:
        """Results that are alike together, in pieces that the device has room for; single scattering always in
        doubles."""
        add_up(self.session, self.in_doubles, sums, run, told, self.piece_bytes)


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


def look_at(opened: Session, found: Found) -> Reading:
    """The largest radiance of each item at each depth for each beam, and I in the brightest column per unit of what
    comes in, (item, n_tau, n_in)."""
    items, levels, n_in, n_col, n_mu, stokes = found.shape
    light = opened.empty((2, items, levels, n_in))
    rows = int(np.count_nonzero(found.factors.any(axis=1)))
    shape = levels, n_in, n_col, n_mu, rows, stokes, int(np.argmax(found.incoming))
    opened.launch("largest_light", (n_in, levels, items), *shape, found.kernels, light, light.size // 2)

    def scale(seen: Array) -> tuple[Array, Array]:
        largest, intensity = float(np.abs(found.factors).max()) * seen
        return largest, intensity / max(float(found.incoming.max()), 1e-300)

    return Reading([light], scale)


def find_doubts(piece: Piece, found: Numbers, items: slice, precision: str) -> dict[int, str]:
    """What is wrong with the orders of a piece, solved in a precision; all of them are in doubt, or none."""
    allowed: dict[str, float] = Doubling.allowed | find_allowed_residuals(piece.plan.accuracy)
    if precision == "single" and piece.name != IN_DOUBLES:
        allowed |= ALLOWED_OF_FLOATS
    doubts = {index: "a matrix is singular" for index in np.flatnonzero(found.singular[items]).tolist()}
    for name, values in found.residuals.items():
        for index in np.flatnonzero(~(values[items] <= allowed[name])).tolist():
            doubts.setdefault(index, f"{name} {values[items][index]:.2g}, allowed {allowed[name]:g}")
    if not doubts:
        return {}
    orders = piece.orders.tolist()
    first = {orders[index]: reason for index, reason in doubts.items()}
    return first | {order: "solved together with others in doubt" for order in orders if order not in first}


def make_answer(piece: Piece, found: Found, numbers: Numbers, items: slice, largest: Array, brightest: Array) -> Answer:
    """What a group's items are to a piece."""
    block, orders, shape = piece.block, piece.orders, found.shape[1:]
    kernels = sums.make_dense_kernels(found.kernels.data, (orders.size, *shape), items.start * int(np.prod(shape)))
    stokes, columns = np.array(block.stokes, np.int32), np.array(block.columns, np.int32)
    light = Light(orders, stokes, columns, kernels, found.factors)
    everywhere = orders.size, piece.problem.level.size, largest.shape[2]  # light of the top alone has one depth
    residuals = {name: values[items] for name, values in numbers.residuals.items()}
    flux = numbers.flux[items.start].swapaxes(0, 1)
    return Answer(light, flux, np.broadcast_to(largest, everywhere), brightest, residuals, {})


@dataclass(frozen=True, eq=False)
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
        slabs = doubling.double(opened, frame, list_slab_items(batch), matrices, run.stop)
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
        shape = (slab_stacks.slab.shape[0], slab_stack.interface.size, problem.mu0.size, problem.columns.shape[0])
        directions = pieces[0].problem.mu_out.size, len(problem.stokes)
        kernels = find_leaving_light(opened, batch, joined, (*shape, *directions))

    def make_numbers(state: Any, info: Array, flux: Array, of_slabs: Array, of_adding: Array) -> Numbers:
        residuals = find_worst_of_items(batch, of_slabs)
        allowed = {
            "residual_of_reflection": residuals[:, 0],
            "residual_of_transmission": residuals[:, 1],
            "residual_of_adding": of_adding.max(axis=1),
        }
        singular = np.maximum(find_worst_of_items(batch, state["singular"])[:, 0], info)
        return Numbers(flux.reshape(*shape[:2], 2, *shape[2:]), allowed, singular)

    numbers = Reading((slabs.state, joined.info, joined.flux, slabs.residual, joined.residual), make_numbers)
    incoming = np.abs(problem.columns).max(axis=1)
    return Found(kernels, (*shape, *directions), incoming, np.ones(directions), numbers)


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
    problem, upload = batch.problem, opened.constant
    order = batch.joined(lambda piece, slab_stack: np.repeat(piece.orders, slab_stack.problem.albedo.size))
    albedo = batch.joined(lambda piece, slab_stack: slab_stack.problem.albedo)
    numbers = np.split(np.arange(albedo.size), np.cumsum([each.problem.albedo.size for each in batch.slab_stacks])[:-1])
    pairs = zip(numbers, batch.pieces, strict=True)
    material = np.concatenate([np.tile(of, piece.orders.size) for of, piece in pairs])
    return assembly.assemble(
        opened,
        upload(np.arange(order.size, dtype=np.int32)),
        upload(order.astype(np.int32)),
        upload(material.astype(np.int32)),
        problem.stokes,
        upload(pad_coefficients([slab_stack.problem.coefficients for slab_stack in batch.slab_stacks])),
        upload(batch.joined(lambda piece, slab_stack: slab_stack.problem.terms)),
        upload(albedo),
        upload(problem.directions),
        upload(problem.weights),
        problem.mu_out.size,
    )


def list_slab_items(batch: Batch) -> Items:
    """Every slab of every order."""

    def each(make: Callable[[SlabStack], Array]) -> Array:
        return batch.joined(lambda piece, slab_stack: np.tile(make(slab_stack), piece.orders.size))

    albedo = each(lambda slab_stack: slab_stack.problem.albedo[slab_stack.material])
    orders = batch.joined(lambda piece, slab_stack: np.repeat(piece.orders, slab_stack.thickness.size))
    return Items(
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


def find_leaving_light(opened: Session, batch: Batch, joined: joining.Joined, shape: tuple[int, ...]) -> Any:
    """Radiance of every item in the public frame, (item, n_tau, n_in, n_col, n_out, S)."""
    items, levels, n_in, n_col, n_mu, stokes = shape
    problem, slab_stack = batch.problem, batch.slab_stacks[0]
    kernels = opened.empty(shape)
    sizes = n_in * n_col, levels, n_mu, batch.pieces[0].problem.n_up, problem.mu_out.size, stokes
    factors = opened.constant(problem.flip / (2.0 * np.pi)), opened.constant(np.full(stokes, 1.0 / (2.0 * np.pi)))
    opened.launch(
        "leaving",
        (n_in * n_col, levels, items),
        *(np.int32(size) for size in sizes),
        *(opened.constant(slab_stack.out), *factors, joined.up, joined.down, kernels),
        opened.constant(np.arange(items, dtype=np.int32)),
    )
    return kernels


def solve_by_invariance(opened: Session, pieces: list[Piece], run: Run) -> Found:
    """Fixed points of the invariance equation for all orders of all pieces: the top of semi-infinite layers."""
    problem, orders = pieces[0].problem, np.concatenate([piece.orders for piece in pieces])
    with run.timed("invariance", opened.finish):
        light = invariance.reflect_semi_infinite(opened, **gather_layers(opened, pieces), stop=run.stop)
    directions = problem.mu_out.size, len(problem.stokes)
    shape = orders.size, 1, problem.mu0.size, problem.columns.shape[0], *directions
    factors = np.zeros(directions)
    factors[: problem.n_up] = problem.flip / (2.0 * np.pi)

    def make_numbers(residual: Array, *nodal: Array) -> Numbers:
        flux = np.zeros((shape[0], 1, 2, *shape[2:4]))
        for each in nodal:
            flux[:, 0, 0] = np.concatenate([find_flux_up(problem, item) for item in each])
        return Numbers(flux, {"residual_of_invariance": residual}, np.zeros(shape[0]))

    numbers = Reading([light.residual, *([light.on_nodes] if (orders == 0).any() else [])], make_numbers)
    return Found(light.up.reshape(shape), shape, np.abs(problem.columns).max(axis=1), factors, numbers)


def gather_layers(opened: Session, pieces: list[Piece]) -> dict[str, Any]:
    """The arguments of `reflect_semi_infinite` for all orders of pieces, on the device."""
    problem = pieces[0].problem
    off, indices = np.unique(np.concatenate([problem.mu_out, problem.mu0]), return_inverse=True)
    n_out, sizes = problem.mu_out.size, [piece.orders.size for piece in pieces]
    orders = np.concatenate([piece.orders for piece in pieces])
    arrays = {
        "items": np.arange(orders.size, dtype=np.int32),
        "order": orders,
        "material": np.repeat(np.arange(len(pieces), dtype=np.int32), sizes),
        "coefficients": pad_coefficients([piece.problem.coefficients[:1] for piece in pieces]),
        "terms": np.array([piece.problem.terms[0] for piece in pieces], np.int32),
        "albedo": np.array([piece.problem.albedo[0] for piece in pieces]),
        "directions": np.concatenate([problem.nodes, off]),
        "weights": problem.weights,
        "out": indices[:n_out].astype(np.int32),
        "into": indices[n_out:].astype(np.int32),
        "columns": problem.columns,
        "tolerance": np.repeat([TIGHTER * piece.plan.accuracy for piece in pieces], sizes),
    }
    uploaded: dict[str, Any] = {name: opened.constant(values) for name, values in arrays.items()}
    return uploaded | {"members": tuple(problem.stokes)}
