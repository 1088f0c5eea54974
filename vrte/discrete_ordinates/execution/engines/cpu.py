"""The processor: one block of orders after another by the compiled core, or by other stages on the same arrays."""

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, ClassVar

import numpy as np

from vrte import _core
from vrte.basics import cost
from vrte.basics.arrays import IntArray, record, replace_unchecked
from vrte.basics.errors import AccuracyError
from vrte.basics.memory import ALWAYS_THERE, BYTES, PIECE_BYTES
from vrte.basics.running import Run, keep_to_one_thread, run_jobs
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
    split_evenly,
    split_into_pieces,
    weigh_scatterers,
)
from vrte.discrete_ordinates.orders.modes import Modes, solve_together
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.routes import OTHER, Route, make_route
from vrte.discrete_ordinates.orders.small_angle import count_scratch_doubles
from vrte.discrete_ordinates.orders.solved import Orders
from vrte.discrete_ordinates.planning.blocks import Block
from vrte.discrete_ordinates.planning.memory import check_memory
from vrte.discrete_ordinates.planning.plan import Plan
from vrte.scene.boundary import Boundary

SHARES = 3  # parts of the incident directions per thread, for summation


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
            if plan.others:  # so many scenes that they fit into the caches
                continue
            request, problem = plan.request, plan.problem
            result = plan.wanted.doubles(request.phi.size)
            if plan.truncation.spread != "none" and plan.spreads.any():
                result += count_scratch_doubles(request.scene)
            if not run.brief or BYTES * result > ALWAYS_THERE:
                check_memory(problem, plan.blocks, result, plan.azimuths, run.threads)

    def grouped(self, pieces: Sequence[Piece]) -> Iterator[list[Piece]]:
        """Together, so that threads have work; one after another where light is refracted."""
        refracted = any(piece.problem.media is not None for piece in pieces)
        return ([piece] for piece in pieces) if refracted or len(pieces) < 2 else iter([list(pieces)])

    def solve(self, pieces: list[Piece], run: Run, report: Callable[[int], None]) -> list[Answer]:
        """A few orders at a time to bound memory: each few by one thread where there are enough for all, otherwise
        piece by piece by all threads together."""
        jobs = cut_into_jobs(pieces, run)
        if jobs:
            ahead = list(itertools.accumulate(job.orders.size for job in jobs))
            found = run_jobs(run, [job.solve for job in jobs], lambda done: report(ahead[done - 1]))
            parts = [[part for job, part in zip(jobs, found, strict=True) if job.piece is each] for each in pieces]
            return [make_answer(piece, *join_found(part)) for piece, part in zip(pieces, parts, strict=True)]
        if are_for_one_call(pieces, run):
            return solve_in_one_call(pieces, run, report)
        answers: list[Answer] = []
        before = 0
        for piece in pieces:
            if piece.block.wanted is not None:
                answers.append(
                    make_answer(piece, piece.orders, solve_scenes(piece.block, piece.plan.accuracy, run), {})
                )
                continue
            own = choose_threads(run, piece.problem, piece.orders)
            asked = piece.problem, piece.block.base, piece.orders, piece.name, own, piece.plan.accuracy
            answers.append(make_answer(piece, *solve_orders(*asked, partial(tell_more, report, before))))
            before += piece.orders.size
        return answers

    def failure(self, piece: Piece, order: int, reason: str) -> str:
        """Both algorithms and what was wrong."""
        tried, before = piece.tried[order]
        return f"neither algorithm can verify Fourier order {order}: {tried} ({before}), {piece.name} ({reason})"

    def diagnostics(self) -> dict[str, Any]:
        """Whether threads share the work."""
        return {"openmp": _core.HAS_OPENMP}

    def prepare_orders(self, target: Target, lights: Sequence[Light], run: Run) -> Adder:
        """What adds the sum over Fourier orders, (1:6)-(1:8), to a share."""
        azimuths, wanted, kind = target.azimuths, target.wanted, target.kind
        prepared = [(light, *azimuths.cos_sin(light.orders)) for light in lights]

        def add(share: Share, own: Run = run) -> None:
            part = share.part
            with own.timed("fourier sum") as crew:
                for light, cosine, sine in prepared:
                    own.kernels.azimuthal_sum(
                        crew,
                        kernels=light.kernels,
                        members=light.stokes,
                        kind=kind[light.columns],
                        place=wanted.place[light.columns],
                        cosine=cosine,
                        sine=sine,
                        angle=azimuths.angle,
                        sign=azimuths.sign,
                        levels=part.places,
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
        with run.timed("single scattering"):
            tables = {id(part): weigh_scatterers(target, part) for part in parts}

        def add(share: Share, own: Run = run) -> None:
            for table, path in tables[id(share.part)]:
                index = mu0, share.part.mu, share.first, share.last
                scatter("single scattering", table, path, *index, share.part.values, own)

        return add

    def add_up(self, sums: Sequence[Sum], run: Run, report: Callable[[int], None]) -> None:
        """Result after result, piece by piece in place."""
        done = 0
        for result in sums:
            target, of = result.target, choose_sum_threads(result, run)
            adders = [self.prepare_orders(target, result.lights, of)]
            if result.in_closed_form:
                adders.append(self.prepare_scattering(target, result.parts, of))
            pieces = list(split_into_pieces(target.wanted, target.azimuths.phi.size, self.piece_bytes))
            if of.kernels is _core and 1 < of.threads <= target.wanted.scale.size:
                ends = [part for piece in pieces for part in split_evenly(*piece, SHARES * of.threads)]
                jobs = [partial(add_shares, adders, [Share(part, *each) for part in result.parts]) for each in ends]
                run_jobs(of, jobs, partial(tell_part, report, done, len(pieces), len(jobs)))
            else:
                for index, (first, last) in enumerate(pieces, done + 1):
                    add_shares(adders, [Share(part, first, last) for part in result.parts], of)
                    report(index)
            done += len(pieces)


PROCESSOR = Processor()


def open_engine() -> Processor:
    """The processor with the compiled core."""
    return PROCESSOR


def open_stages() -> Any:
    """The compiled core."""
    return _core


def add_shares(adders: Sequence[Adder], shares: Sequence[Share], run: Run) -> None:
    """All that is added to the same incident directions."""
    for share in shares:
        for add in adders:
            add(share, run)


def tell_part(report: Callable[[int], None], before: int, pieces: int, jobs: int, done: int) -> None:
    """Says how many pieces are done, after so many of the jobs that they are cut into."""
    report(before + done * pieces // jobs)


Found = tuple[IntArray, Orders | None, dict[int, str]]  # see `solve_orders`


def tell_more(report: Callable[[int], None], before: int, done: int) -> None:
    """Says that so many are done, and others before them."""
    report(before + done)


@record
class Job:
    """A few orders of a piece, on their route."""

    piece: Piece
    route: Route
    orders: IntArray

    def solve(self, run: Run) -> Found:
        """Which of its orders count, what is found for them, and what is wrong with the others."""
        return try_orders(self.route, self.orders, run)


def cut_into_jobs(pieces: Sequence[Piece], run: Run) -> list[Job]:
    """The orders of pieces, a few at a time, for threads that each take the next; none where there are fewer than
    threads, where they are too small for it, or where they share what is refracted."""
    several = any(piece.problem.scenes > 1 for piece in pieces)
    if (
        several
        or run.threads == 1
        or run.kernels is not _core
        or sum(piece.orders.size for piece in pieces) < run.threads
    ):
        return []
    jobs = []
    for piece in pieces:
        problem, orders = piece.problem, piece.orders
        if problem.media is not None:
            return []
        route = make_route(piece.name, problem, piece.block.base, int(orders[-1]) + 1, piece.plan.accuracy)
        each = problem.albedo.size * float(problem.size) ** 2 * (problem.size + problem.n_rhs)
        least, most = math.ceil(cost.WORTH_A_JOB / each), max(1, route.chunk(run.threads) // run.threads)
        first = 0
        while first < orders.size:  # many at first, so that there are few calls, and few in the end
            step = min(most, max(least, math.ceil((orders.size - first) / (2 * run.threads))))
            jobs.append(Job(piece, route, orders[first : first + step]))
            first += step
    return jobs if len(jobs) >= run.threads else []


def solve_orders(
    problem: Problem,
    base: Boundary,
    orders: IntArray,
    name: str,
    run: Run,
    accuracy: float,
    report: Callable[[int], None] = lambda done: None,
) -> Found:
    """Orders by the named algorithm, a few at a time to bound memory: which of them it verifies, what it found for
    them, with the fluxes of the first, and what is wrong with each of the others."""
    route = make_route(name, problem, base, int(orders[-1]) + 1, accuracy, run)
    step = orders.size if run.brief else route.chunk(run.threads)
    found = []
    for first in range(0, orders.size, step):
        found.append(try_orders(route, orders[first : first + step], run))
        report(min(first + step, orders.size))
    return join_found(found)


def are_for_one_call(pieces: Sequence[Piece], run: Run) -> bool:
    """Whether pieces are small and differ in orders and Stokes parameters alone: then what stands between calls takes
    longer than the calls."""
    first = pieces[0].problem
    small = run.kernels is _core and run.threads == 1 and (run.brief or first.scenes > 1) and first.media is None
    return small and all(
        piece.name == "modes" and not piece.tried and piece.problem.thickness is first.thickness for piece in pieces
    )


def solve_in_one_call(pieces: Sequence[Piece], run: Run, report: Callable[[int], None]) -> list[Answer]:
    """The answers of these; a piece in doubt is solved by itself, which says why. Of many scenes whoever asks looks at
    the residuals of each."""
    asked = [(piece.problem, piece.block.base, piece.orders, piece.block.wanted) for piece in pieces]
    answers = []
    for piece, found in zip(pieces, solve_together(asked, pieces[0].plan.accuracy, run), strict=True):
        if piece.block.wanted is None and find_doubts(found, Modes.allowed):
            own = piece.problem, piece.block.base, piece.orders, piece.name, run, piece.plan.accuracy
            answers.append(make_answer(piece, *solve_orders(*own)))
        else:
            answers.append(make_answer(piece, piece.orders, found, {}))
    report(sum(piece.orders.size for piece in pieces))
    return answers


def solve_scenes(block: Block, accuracy: float, run: Run) -> Orders:
    """A block of orders of many scenes: whoever asks looks at the residuals of each."""
    assert block.wanted is not None
    if block.problem.media is None:
        (together,) = solve_together([(block.problem, block.base, block.orders, block.wanted)], accuracy, run)
        return together
    route: Any = make_route("modes", block.problem, block.base, int(block.orders[-1]) + 1, accuracy, run)
    found: Orders = route.solve_scenes(block.orders, block.wanted, run)
    return found


def choose_threads(run: Run, problem: Problem, orders: IntArray) -> Run:
    """The run, on one thread where starting another would take longer than the solve."""
    if run.threads == 1:
        return run
    n = float(problem.size)
    work = orders.size * n * (n * n + problem.n_rhs * problem.rows_out)
    worth = work > cost.WORTH_THREADS_STAGES and orders.size * problem.albedo.size > 1
    return run if worth else replace_unchecked(run, threads=1)


def join_found(parts: list[Found]) -> Found:
    """What was found for a few orders each, for all of them."""
    if len(parts) == 1:
        return parts[0]
    right: list[IntArray] = []
    found: list[Orders] = []
    doubts: dict[int, str] = {}
    for kept, result, doubtful in parts:
        doubts |= doubtful
        if result is not None and kept.size:
            found.append(result)
            right.append(kept)
    if len(found) < 2:
        return right[0] if right else parts[0][0][:0], found[0] if found else None, doubts
    kernels = np.concatenate([part.kernels for part in found])
    residuals = {name: np.concatenate([part.residuals[name] for part in found]) for name in found[0].residuals}
    return np.concatenate(right), replace_unchecked(found[0], kernels=kernels, residuals=residuals), doubts


def try_orders(route: Route, orders: IntArray, run: Run) -> Found:
    """Which of the orders a route verifies, what it finds for them, and what is wrong with each of the others."""
    try:
        found = route.solve(orders, run)
    except AccuracyError as error:
        return orders[:0], None, dict.fromkeys(orders.tolist(), str(error))
    return keep_verified(orders, found, route.allowed)


def keep_verified(orders: IntArray, found: Orders, allowed: Mapping[str, float]) -> Found:
    """Which of the orders pass the checks, what was found for them, and what is wrong with each of the others."""
    doubts = find_doubts(found, allowed)
    if not doubts:
        return orders, found, {}
    kept = np.setdiff1d(np.arange(orders.size), list(doubts))
    residuals = {name: values[kept] for name, values in found.residuals.items()}
    right = replace_unchecked(found, kernels=found.kernels[kept], residuals=residuals)
    return orders[kept], right, {int(orders[index]): doubts[index] for index in sorted(doubts)}


@lru_cache(maxsize=256)
def make_index(places: tuple[int, ...]) -> IntArray:
    """Places of columns, as the core takes them."""
    found = np.array(places, np.int32)
    found.setflags(write=False)  # shared by all who ask
    return found


def find_doubts(found: Orders, allowed: Mapping[str, float]) -> dict[int, str]:
    """What is wrong with each of the orders that cannot be verified, by their places among those found."""
    doubts: dict[int, str] = {}
    for name, values in found.residuals.items():
        most = allowed[name]
        for index, value in enumerate(values.tolist()):
            if not value <= most:
                doubts[index] = f"{name} {value:.2g}, allowed {most:g}"
    finite = np.isfinite(found.kernels)
    if np.count_nonzero(finite) < finite.size:
        wrong = np.flatnonzero(~finite.all(axis=tuple(range(1, finite.ndim)))).tolist()
        doubts |= dict.fromkeys(wrong, "the answer is not finite")
    return doubts


def make_answer(piece: Piece, orders: IntArray, found: Orders | None, doubts: dict[int, str]) -> Answer:
    """What is found for the orders that are verified."""
    if found is None or not orders.size:
        return make_empty_answer(doubts)
    block, kernels = piece.block, found.kernels
    light = Light(orders, block.problem.members, make_index(block.columns), kernels)
    has_flux = orders[0] == 0 and block.stokes[0] == 0
    flux = np.array([found.flux_up, found.flux_down]) if has_flux else np.zeros(0)
    if piece.plan.is_solved_at_once:
        return Answer(light, flux, None, None, found.residuals, doubts)
    # without the absolute values of all, which would take as much memory again
    ends = kernels.max(axis=(3, 4, 5), initial=0.0), kernels.min(axis=(3, 4, 5), initial=0.0)
    largest = np.maximum(ends[0], -ends[1])
    brightest = largest[0]
    if has_flux:
        lit = np.abs(piece.problem.columns).max(axis=1).tolist()
        first = np.abs(kernels[0, :, :, lit.index(max(lit)), :, 0])  # not of incident I, which may be none
        brightest = first.max(axis=2, initial=0.0) / max(*lit, 1e-300)
    return Answer(light, flux, largest, brightest, found.residuals, doubts)
