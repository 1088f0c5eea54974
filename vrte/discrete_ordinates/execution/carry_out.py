"""Plans carried out: block after block of Fourier orders on an engine, what fails once more by another algorithm."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import AccuracyError
from vrte.basics.running import Progress, Run
from vrte.discrete_ordinates.execution.agreement import Agreement
from vrte.discrete_ordinates.execution.engines.engine import Answer, Engine, Piece
from vrte.discrete_ordinates.execution.sums import Light, Target, count_pieces, fill_results
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.truncating import find_peak_flux
from vrte.discrete_ordinates.planning.order_bounds import calibrate_bounds, count_orders_that_matter
from vrte.discrete_ordinates.planning.plan import Plan, stack_depths
from vrte.results.result import Solution


@dataclass(eq=False)
class Steps:
    """Tells how many orders and pieces of results are done, of how many."""

    progress: Progress | None
    total: int
    done: int = 0

    def ahead(self, more: int) -> None:
        """So many more than what is done for good."""
        if self.progress is not None:
            self.progress(self.done + more, self.total)

    def reach(self, done: int) -> None:
        """So many are done for good."""
        self.done = done
        self.ahead(0)


@dataclass(eq=False)
class Task:
    """A plan on its way.

    brightest (n_tau, n_in): light that orders are compared with; left: how many of them matter; flux (2, scene n_tau,
    n_in, n_col), up and down; blocks and steps: how far it is; found: the largest radiance of each order that is
    solved, (n_tau, n_in), where orders are counted again; lights: theirs; by: how many orders each algorithm solved;
    repeated: which were solved again, by which; residuals: the largest, by name, of each scene where there are several;
    unknowns: of a hemisphere, of all orders together.
    """

    plan: Plan
    brightest: Array
    left: int
    flux: Array
    blocks: int = 0
    steps: int = 0
    found: dict[int, Array | None] = field(default_factory=dict)
    lights: list[Light] = field(default_factory=list)
    by: dict[str, int] = field(default_factory=dict)
    repeated: dict[str, set[int]] = field(default_factory=dict)
    residuals: dict[str, Any] = field(default_factory=dict)
    unknowns: int = 0
    agreement: Agreement | None = None

    def next_pieces(self, index: int) -> list[Piece]:
        """Blocks that come before the next look at how many orders are left, with their orders."""
        blocks = self.plan.blocks
        if self.blocks < len(blocks) and blocks[self.blocks].orders[0] > max(self.found, default=self.left):
            self.left = count_orders_left(self.plan, self.brightest, self.found, self.left)
        taken: list[Piece] = []
        last = -1
        at_once = self.plan.is_solved_at_once
        while self.blocks < len(blocks) and (at_once or not taken or blocks[self.blocks].orders[0] <= last):
            block = blocks[self.blocks]
            last = int(block.orders[-1])
            orders = block.orders if last < self.left else block.orders[block.orders < self.left]
            self.blocks, self.steps = self.blocks + 1, self.steps + block.orders.size
            if orders.size:
                taken.append(Piece(index, self.plan, block, orders, block.choice.name))
        return taken

    def note(self, piece: Piece, answer: Answer) -> None:
        """Puts down what was found for a piece."""
        block, orders = piece.block, answer.light.orders.tolist()
        self.lights.append(answer.light)
        if answer.largest is None:
            self.found.update(dict.fromkeys(orders))
        else:
            for order, largest in zip(orders, answer.largest, strict=True):
                known = self.found.get(order)
                self.found[order] = largest if known is None else np.maximum(known, largest)
        if orders[0] == 0 and block.stokes[0] == 0:
            for k, column in enumerate(block.columns):
                self.flux[..., column] += answer.flux[..., k]
            if answer.brightest is not None:
                self.brightest = np.maximum(self.brightest, answer.brightest)
        self.unknowns += len(orders) * block.problem.size
        self.by[piece.name] = self.by.get(piece.name, 0) + len(orders)
        if piece.tried:
            self.repeated.setdefault(piece.name, set()).update(orders)
        for name, values in answer.residuals.items():
            known = self.residuals.get(name, 0.0)
            several = self.plan.others
            self.residuals[name] = np.maximum(known, values) if several else max(known, *values.tolist())


def carry_out(plans: Sequence[Plan], engine: Engine, run: Run, progress: Progress | None = None) -> list[Solution]:
    """The diffuse fields of plans: together where the engine takes many, otherwise in turn.

    Raises AccuracyError where no algorithm can verify an order, SceneError or DeviceError where there is too little
    memory, DeviceError where a device fails.
    """
    steps = Steps(progress, sum(count_steps(plan, engine) for plan in plans) if progress is not None else 0)
    batches = [plans] if engine.takes_many else [[plan] for plan in plans]
    try:
        return [solution for batch in batches for solution in carry_out_batch(batch, engine, run, steps)]
    finally:
        run.release_threads()


def count_steps(plan: Plan, engine: Engine) -> int:
    """What `progress` counts: orders, and pieces of the result."""
    pieces = count_pieces(plan.wanted, plan.request.phi.size, engine.piece_bytes)
    return sum(block.orders.size for block in plan.blocks) + pieces


def carry_out_batch(plans: Sequence[Plan], engine: Engine, run: Run, steps: Steps) -> list[Solution]:
    """The same of plans that the engine works on side by side."""
    start, before = time.perf_counter(), steps.done
    with engine.at_work():
        engine.check_memory(plans, run)
        tasks = [make_task(plan) for plan in plans]
        while pieces := [piece for index, task in enumerate(tasks) for piece in task.next_pieces(index)]:
            for group in engine.grouped(pieces):
                solve_group(engine, tasks, group, run, steps.ahead)
                steps.reach(steps.done + sum(piece.orders.size for piece in group))
            steps.reach(before + sum(task.steps for task in tasks))
        if steps.progress is not None:  # orders that turned out not to matter are done with, too
            steps.reach(before + sum(block.orders.size for plan in plans for block in plan.blocks))
        targets = [make_target(plan) for plan in plans]
        lit = [(target, task.lights) for target, task in zip(targets, tasks, strict=True)]
        parts = fill_results(lit, engine, run, steps.ahead)
        if steps.progress is not None:
            steps.done = before + sum(count_steps(plan, engine) for plan in plans)
        finished = zip(tasks, targets, parts, strict=True)
        return [finish_task(*each, engine, run, start) for each in finished]


def make_task(plan: Plan) -> Task:
    """A plan not begun. Under smooth surfaces the light of its orders is compared with light that is found alone: the
    plan's bounds and brightness are both of beams that no surface has weakened."""
    request = plan.request
    weakened = plan.problem.media is not None and not request.scene.is_rough
    brightest = np.zeros_like(plan.brightest[0]) if weakened else plan.brightest[0]
    flux = np.zeros((2, plan.problem.level.size, request.mu0.size, request.columns.shape[0]))
    return Task(plan, brightest, plan.orders, flux, agreement=Agreement() if request.verify else None)


def make_target(plan: Plan) -> Target:
    """What the light of a plan is added up into."""
    return Target(plan.wanted, plan.scenes, plan.problem, plan.mu, plan.azimuths, plan.spreads)


def count_orders_left(plan: Plan, brightest: Array, found: dict[int, Any], left: int) -> int:
    """How many orders matter, now that some are solved."""
    if plan.is_solved_at_once:
        return left
    bounds = calibrate_bounds(plan.needs, plan.bounds, found)
    return min(left, int(count_orders_that_matter(bounds, brightest[None], plan.accuracy)[0]))


def solve_group(
    engine: Engine,
    tasks: Sequence[Task],
    group: list[Piece],
    run: Run,
    report: Callable[[int], None] = lambda done: None,
) -> None:
    """Solves pieces that go together and notes what was found with their tasks; orders in doubt are solved again."""
    again = []
    for piece, answer in zip(group, engine.solve(group, run, report), strict=True):
        task = tasks[piece.place]
        if answer.doubts:
            again.append(make_second_try(engine, piece, answer))
        if answer.light.orders.size:
            task.note(piece, answer)
        if task.agreement is not None and not piece.tried:
            task.agreement.compare(engine, piece, answer, run)
    for pieces in engine.grouped(again):
        solve_group(engine, tasks, pieces, run)


def make_second_try(engine: Engine, piece: Piece, answer: Answer) -> Piece:
    """The orders in doubt as a piece for another algorithm. Raises AccuracyError where there is none left."""
    order, reason = next(iter(answer.doubts.items()))
    if piece.tried or piece.name not in engine.others:
        raise AccuracyError(engine.failure(piece, order, reason) + advise_user(piece.problem))
    tried = {order: (piece.name, reason) for order, reason in answer.doubts.items()}
    return replace(piece, orders=np.array(sorted(tried), np.int32), name=engine.others[piece.name], tried=tried)


def advise_user(problem: Problem) -> str:
    """What a user can do about a scene that no algorithm solves."""
    resolved = problem.terms_cut == 0
    return "" if resolved else f"; {problem.nodes.size} nodes do not resolve the phase matrix, use more"


def finish_task(task: Task, target: Target, parts: list[Array], engine: Engine, run: Run, start: float) -> Solution:
    """All light of a plan added up, and how it was found."""
    plan = task.plan
    if plan.problem.fraction.any() and (plan.problem.media is None or not plan.others):  # seen from above there is none
        task.flux += find_peak_flux(plan.problem, stack_depths(plan.request, plan.scenes).ravel())
    diagnostics = {
        **plan.diagnostics(),
        "threads": run.threads,
        **engine.diagnostics(),
        "orders": len(task.found),
        "unknowns": task.unknowns,
        "orders_by": task.by,
        "orders_repeated": describe_repeats(task.repeated),
        **dict(sorted(task.residuals.items())),
        **({"agreement": task.agreement.statement(target, parts, task.flux)} if task.agreement else {}),
        "stages": run.stages,
        "wall_seconds": time.perf_counter() - start,
    }
    return Solution(parts, task.flux[0], task.flux[1], diagnostics)


def describe_repeats(repeated: dict[str, set[int]]) -> dict[str, Any] | None:
    """Which orders were solved again and by which algorithms, None without any."""
    if not repeated:
        return None
    return {"by": " and ".join(sorted(repeated)), "orders": sorted(set().union(*repeated.values()))}
