"""The processor: one block of orders after another by the compiled core, or by other stages on the same arrays."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from vrte import _core
from vrte.basics import cost
from vrte.basics.arrays import IntArray
from vrte.basics.blas import keep_to_one_thread
from vrte.basics.errors import AccuracyError
from vrte.basics.fields import change_fields
from vrte.basics.memory import PIECE_BYTES
from vrte.basics.running import Run
from vrte.discrete_ordinates.execution.engines.engine import Answer, Piece, make_empty_answer
from vrte.discrete_ordinates.execution.sums import (
    Adder,
    Light,
    Part,
    Share,
    Sum,
    Target,
    choose_sum_threads,
    prepare_closed_form,
    split_into_pieces,
    weigh_scatterers,
)
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.routes import OTHER, Route, make_route
from vrte.discrete_ordinates.orders.small_angle import count_scratch_doubles
from vrte.discrete_ordinates.orders.solved import Orders
from vrte.discrete_ordinates.orders.truncating import find_spread_directions
from vrte.discrete_ordinates.planning.azimuths import fold_azimuths
from vrte.discrete_ordinates.planning.memory import check_memory
from vrte.discrete_ordinates.planning.plan import Plan
from vrte.scene.boundary import Boundary


@dataclass(frozen=True)
class Processor:
    """See `Engine`."""

    stages: Any = _core
    piece_bytes: float = PIECE_BYTES
    others: ClassVar[Mapping[str, str]] = OTHER
    takes_many: ClassVar[bool] = False

    def at_work(self) -> AbstractContextManager[Any]:
        """One thread of BLAS in each of ours."""
        return keep_to_one_thread()

    def check_memory(self, plans: Sequence[Plan], run: Run) -> None:
        """Raises SceneError where a plan needs more memory than there is."""
        for plan in plans:
            request, problem = plan.request, plan.problem
            spreads = find_spread_directions(plan.truncation, problem, plan.mu).any()
            if not run.brief or spreads:
                result = plan.wanted.doubles(request.phi.size) + (
                    count_scratch_doubles(request.scene) if spreads else 0.0
                )
                azimuths = fold_azimuths(request.phi, problem.leave_out.azimuths)
                check_memory(problem, plan.blocks, result, azimuths, run.threads)

    def grouped(self, pieces: Sequence[Piece]) -> Iterator[list[Piece]]:
        """One after the other."""
        return ([piece] for piece in pieces)

    def solve(self, pieces: list[Piece], run: Run, told: Callable[[int], None]) -> list[Answer]:
        """All orders of the one piece, a few at a time to bound memory."""
        (piece,) = pieces
        problem, orders = piece.problem, piece.orders
        run = choose_threads(run, problem, orders)
        return [
            make_answer(
                piece, *solve_orders(problem, piece.block.base, orders, piece.name, run, piece.plan.accuracy, told)
            )
        ]

    def failure(self, piece: Piece, order: int, reason: str) -> str:
        """Both algorithms and what was wrong."""
        tried, before = piece.tried[order]
        return f"neither algorithm can vouch for Fourier order {order}: {tried} ({before}), {piece.name} ({reason})"

    def diagnostics(self) -> dict[str, Any]:
        """Whether threads share the work."""
        return {"openmp": _core.HAS_OPENMP}

    def prepare_orders(self, target: Target, lights: Sequence[Light], run: Run) -> Adder:
        """What adds the sum over Fourier orders, (1:6)-(1:8), to a share."""
        azimuths, wanted, kind = target.azimuths, target.wanted, target.kind
        prepared = [(light, *azimuths.cos_sin(light.orders)) for light in lights]

        def add(share: Share) -> None:
            part = share.part
            for light, cosine, sine in prepared:
                with run.timed("fourier sum") as crew:
                    run.kernels.azimuthal_sum(
                        crew,
                        kernels=light.kernels,
                        stokes=light.stokes,
                        kind=kind[light.columns],
                        place=wanted.place[light.columns],
                        cosine=cosine,
                        sine=sine,
                        angle=azimuths.angle,
                        sign=azimuths.sign,
                        levels=part.levels,
                        rows=part.rows,
                        scale=wanted.scale,
                        first=share.first,
                        last=share.last,
                        out=part.values,
                    )

        return add

    def prepare_scattering(self, target: Target, parts: Sequence[Part], run: Run) -> Adder:
        """What adds single scattering in all layers to a share, but where small angles are separated."""
        scatter, mu0 = prepare_closed_form(target, run), target.problem.mu0
        with run.booked("single scattering"):
            tables = {id(part): weigh_scatterers(target, part) for part in parts}

        def add(share: Share) -> None:
            for table, path in tables[id(share.part)]:
                place = mu0, share.part.mu, share.first, share.last
                scatter("single scattering", table, path, *place, share.part.values)

        return add

    def add_up(self, sums: Sequence[Sum], run: Run, told: Callable[[int], None]) -> None:
        """Result after result, piece by piece in place."""
        done = 0
        for result in sums:
            target, of = result.target, choose_sum_threads(result, run)
            adders = [self.prepare_orders(target, result.lights, of)]
            if result.in_closed_form:
                adders.append(self.prepare_scattering(target, result.parts, of))
            for first, last in split_into_pieces(target.wanted, target.azimuths.phi.size, self.piece_bytes):
                for part in result.parts:
                    for add in adders:
                        add(Share(part, first, last))
                done += 1
                told(done)


PROCESSOR = Processor()


def open_engine() -> Processor:
    """The processor with the compiled core."""
    return PROCESSOR


def open_stages() -> Any:
    """The compiled core."""
    return _core


def choose_threads(run: Run, problem: Problem, orders: IntArray) -> Run:
    """The run, on one thread where starting another would take longer than the solve."""
    n = float(problem.size)
    work = orders.size * n * (n * n + problem.n_rhs * problem.rows_out)
    return (
        run
        if work > cost.WORTH_THREADS_STAGES and orders.size * problem.albedo.size > 1
        else change_fields(run, threads=1)
    )


def solve_orders(
    problem: Problem,
    base: Boundary,
    orders: IntArray,
    name: str,
    run: Run,
    accuracy: float,
    told: Callable[[int], None] = lambda done: None,
) -> tuple[IntArray, Orders | None, dict[int, str]]:
    """Orders by the named algorithm, a few at a time to bound memory: which of them it vouches for, what it found for
    them, with the fluxes of the first, and what is wrong with each of the others."""
    route = make_route(name, problem, base, int(orders[-1]) + 1, accuracy)
    right: list[IntArray] = []
    found: list[Orders] = []
    doubts: dict[int, str] = {}
    step = route.chunk(run.threads)
    for first in range(0, orders.size, step):
        kept, result, doubtful = try_orders(route, orders[first : first + step], run)
        if result is not None and kept.size:
            found.append(result)
            right.append(kept)
        doubts |= doubtful
        told(min(first + step, orders.size))
    if len(found) < 2:
        return right[0] if right else orders[:0], found[0] if found else None, doubts
    kernels = np.concatenate([part.kernels for part in found])
    residuals = {name: np.concatenate([part.residuals[name] for part in found]) for name in found[0].residuals}
    return np.concatenate(right), change_fields(found[0], kernels=kernels, residuals=residuals), doubts


def try_orders(route: Route, orders: IntArray, run: Run) -> tuple[IntArray, Orders | None, dict[int, str]]:
    """Which of the orders a route vouches for, what it finds for them, and what is wrong with each of the others."""
    try:
        found = route.solve(orders, run)
    except AccuracyError as error:
        return orders[:0], None, dict.fromkeys(orders.tolist(), str(error))
    doubts: dict[int, str] = {}
    for name, values in found.residuals.items():
        for place in np.flatnonzero(~(values <= route.allowed[name])).tolist():
            doubts[place] = f"{name} {values[place]:.2g}, allowed {route.allowed[name]:g}"
    finite = np.isfinite(found.kernels)
    if not finite.all():
        for place in np.flatnonzero(~finite.all(axis=tuple(range(1, finite.ndim)))).tolist():
            doubts[place] = "the answer is not finite"
    if not doubts:
        return orders, found, {}
    kept = np.setdiff1d(np.arange(orders.size), list(doubts))
    residuals = {name: values[kept] for name, values in found.residuals.items()}
    right = change_fields(found, kernels=found.kernels[kept], residuals=residuals)
    return orders[kept], right, {int(orders[place]): doubts[place] for place in sorted(doubts)}


def make_answer(piece: Piece, orders: IntArray, found: Orders | None, doubts: dict[int, str]) -> Answer:
    """What is found for the orders that are vouched for."""
    if found is None:
        return make_empty_answer(doubts)
    block, kernels, lit = piece.block, found.kernels, np.abs(piece.problem.columns).max(axis=1)
    light = Light(orders, np.array(block.stokes, np.int32), np.array(block.columns, np.int32), kernels)
    # order by order: the absolute values of all of them would take as much memory again
    largest = np.stack([np.abs(values).max(axis=(2, 3, 4), initial=0.0) for values in kernels])
    first = np.abs(kernels[0, :, :, int(np.argmax(lit)), :, 0])  # not of incident I, which may be none
    brightest = first.max(axis=2, initial=0.0) / max(float(lit.max()), 1e-300)
    return Answer(light, np.stack([found.flux_up, found.flux_down]), largest, brightest, found.residuals, doubts)
