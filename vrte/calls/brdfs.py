"""Many scenes in one call, the wavelengths of a spectrum or the entries of a table: scenes that are alike are solved
together, as many at a time as fit into the caches, and small solves side by side, one a core."""

import itertools
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, Any, Literal, TypeVar

import numpy as np

from vrte.basics.arrays import Array, IntArray, check_list, make_readonly, replace_unchecked
from vrte.basics.errors import SceneError
from vrte.basics.running import (
    Progress,
    Run,
    count_usable_cpus,
    keep_to_one_thread,
    run_interruptible,
    run_jobs,
    share_progress,
)
from vrte.calls.brdf import find_brdf, make_brdf, note_interference
from vrte.calls.derivatives import Derivatives, check_differentiable, read_derivatives
from vrte.calls.energy import ROUNDING
from vrte.calls.plan import warn_runtime_of_all
from vrte.calls.radiance import make_field
from vrte.discrete_ordinates.execution.carry_out import carry_out
from vrte.discrete_ordinates.execution.engines import choose_engine
from vrte.discrete_ordinates.execution.engines.cpu import PROCESSOR
from vrte.discrete_ordinates.orders.modes import Modes
from vrte.discrete_ordinates.orders.truncating import count_terms_carried
from vrte.discrete_ordinates.planning.batch_plan import (
    BatchKey,
    count_orders_at_most,
    estimate_bytes,
    find_batch_key,
    is_shared_request,
)
from vrte.discrete_ordinates.planning.blocks import Block
from vrte.discrete_ordinates.planning.plan import make_plan, plan_request
from vrte.methods import choose_method, make_run, solve_request
from vrte.methods.discrete_ordinates import solve_plans, warn_of_negative
from vrte.methods.parts.method import Answer
from vrte.methods.parts.refinement import refine, share_steps
from vrte.request.how import EXACT, complete_docstring
from vrte.request.request import Request, check_scene, make_brdf_request
from vrte.results.brdf import Brdf
from vrte.results.field import Field
from vrte.results.result import Solution
from vrte.scene.beams import find_direct_light, locate_depths
from vrte.scene.scene import Scene
from vrte.scene.vary import Variation

BATCH_BYTES = 16e6  # of what is worked with for the scenes that are solved in one go, by each thread
FEWEST = 2  # scenes that are worth it


def make_alike_request(request: Request, scene: Scene) -> Request | None:
    """The same asked of another scene; None where that has to be checked anew."""
    if not is_shared_request(request) or find_batch_key(scene, request) is None:
        return None
    levels = make_readonly(np.array([0.0, scene.thickness][: request.tau.size]))
    return replace_unchecked(request, scene=scene, tau=levels)


def solve_alike_ones(requests: Sequence[Request], warned: bool, progress: Progress | None) -> dict[int, Brdf]:
    """The BRDFs of those that can be solved with others, by their indices; requests differ in scenes alone."""
    batches = sort_into_batches(requests)
    if not batches:
        return {}
    run = make_run(requests[0], sum(map(len, batches)))
    run.runtime_warned = warned
    return run_interruptible(run, lambda: solve_batches(requests, batches, run, progress))


def solve_batches(
    requests: Sequence[Request],
    batches: Sequence[list[int]],
    run: Run,
    progress: Progress | None = None,
) -> dict[int, Brdf]:
    """The BRDFs of all batches, by their places, in this thread and the others of a run."""
    found: dict[int, Brdf] = {}

    def report(done: int) -> None:
        if progress is not None:
            progress(100 * len(found), 100 * len(requests))

    def solve_one(batch: list[int], own: Run) -> None:
        found.update(solve_batch(requests, batch, own))

    try:
        with keep_to_one_thread():
            run_jobs(run, [partial(solve_one, batch) for batch in batches], report)
    finally:
        run.release_threads()
    return found


def sort_into_batches(requests: Sequence[Request]) -> list[list[int]]:
    """Places of scenes of one key, so many that they fit into the caches; those with most orders first."""
    if len(requests) < FEWEST or not is_shared_request(first := requests[0]):
        return []
    assert first.nodes is not None
    alike: dict[BatchKey, list[int]] = {}
    for index, request in enumerate(requests):
        if (key := find_batch_key(request.scene, first)) is not None:
            alike.setdefault(key, []).append(index)
    batches = []
    for key, indices in alike.items():
        terms = max(layer.phase_matrix.terms for index in indices for layer in requests[index].scene.layers)
        orders = count_orders_at_most(first, min(terms, 2 * first.nodes))
        step = max(FEWEST, int(BATCH_BYTES / estimate_bytes(first, key, orders)))
        if len(indices) >= FEWEST:  # one that would be left alone joins those before it
            batches += [indices[k : k + step] for k in range(0, len(indices) - 1, step)]
            batches[-1] = indices[indices.index(batches[-1][0]) :]
    return batches


def solve_batch(requests: Sequence[Request], indices: list[int], run: Run, as_light: bool = False) -> dict[int, Any]:
    """Results of one batch that its plan stands for and that passed the checks; others are solved by themselves."""
    begin, own = time.perf_counter(), replace_unchecked(run, stages={})
    asked, scenes = requests[indices[0]], [requests[index].scene for index in indices]
    plan = make_plan(asked, own, others=scenes[1:])
    if plan.fits is None or not plan.blocks:
        return {}
    (found,) = carry_out([plan], PROCESSOR, own)
    for name, clock in own.stages.items():
        run.record(name, clock["wall_seconds"], clock["thread_seconds"])
    count, levels, parts = len(scenes), asked.tau.size, [make_readonly(values) for values in found.parts]
    reflectance = make_readonly(found.flux_up[::levels, :, 0] / (asked.mu0 * asked.columns[0, 0]))
    white = np.array([scene.below.even_albedo == 1.0 for scene in scenes])
    white &= (plan.problem.albedo.reshape(count, -1) == 1.0).all(axis=1)
    total = reflectance + find_mirrored(asked)
    lost = np.where(white[:, None], np.abs(1.0 - total), total - 1.0).max(axis=1)
    solved = plan.fits & (lost <= max(asked.accuracy, ROUNDING))  # not where it is no number
    residuals = {name: np.atleast_1d(found.diagnostics[name]) for name in sorted(Modes.allowed)}
    for name, values in residuals.items():
        solved &= values <= Modes.allowed[name]
    for values in (*(each for each in parts if each.size), reflectance):
        solved &= np.isfinite(values.reshape(count, -1).sum(axis=1))
    # each scene's fraction of the seconds of all
    spent = {name: {clock: all_of / count for clock, all_of in each.items()} for name, each in own.stages.items()}
    wall = (time.perf_counter() - begin) / count
    shared = {"solved_together": count, "stages": spent, "wall_seconds": wall}
    right = np.flatnonzero(solved).tolist()
    if as_light or asked.kind != "brdf":
        results: dict[int, Any] = {}
        for k in right:
            of_scene = {name: float(values[k]) for name, values in residuals.items()}
            up, down = (flux[k * levels : (k + 1) * levels] for flux in (found.flux_up, found.flux_down))
            light = Solution([part[k : k + 1] for part in parts], up, down, found.diagnostics | of_scene | shared)
            results[indices[k]] = light if as_light else make_field(requests[indices[k]], plan.mu, light)
        return results
    carried = count_terms_carried(scenes[0], plan.problem.nodes.size)
    for k in right:
        if max(layer.phase_matrix.terms for layer in scenes[k].layers) > carried:
            warn_of_negative(asked, parts[0][k][..., 0, 0], {"terms_cut": True, "nodes": plan.problem.nodes.size})
    through = make_readonly(np.exp(-np.array([[scene.thickness] for scene in scenes]) / asked.mu0))
    mu_o = make_readonly(plan.mu[plan.mu > 0.0])
    return {
        indices[k]: Brdf.with_late_diagnostics(
            partial(describe_solve, requests[indices[k]], plan.blocks, residuals, k, shared),
            mueller=parts[0][k],
            reflectance=reflectance[k],
            mu_i=asked.mu0,
            mu_o=mu_o,
            phi=asked.phi,
            transmission=parts[1][k] if levels > 1 else None,
            direct_transmittance=through[k],
        )
        for k in right
    }


def find_mirrored(request: Request) -> Array:
    """The share (n_in,) of unpolarized beams that a surface on top mirrors."""
    scene, top = request.scene, np.zeros(1)
    if not scene.has_interfaces:
        return np.zeros(request.mu0.size)
    return find_direct_light(scene, request.mu0, locate_depths(scene, top, top > 0.0))[0, :, 0, 0, 0]


def describe_solve(
    request: Request, blocks: Sequence[Block], residuals: Mapping[str, Array], index: int, shared: dict[str, Any]
) -> dict[str, Any]:
    """The diagnostics of one scene of a batch; its own plan is made for that."""
    own = [(block, block.orders[block.wanted[:, index]]) for block in blocks if block.wanted is not None]
    found = {
        **plan_request(request, Run(1)).diagnostics(),
        "threads": 1,
        "openmp": True,
        "orders": len({order for _, orders in own for order in orders.tolist()}),
        "unknowns": sum(block.problem.size * orders.size for block, orders in own),
        "orders_by": {"modes": sum(orders.size for _, orders in own)},
        "orders_repeated": None,
        **{name: float(values[index]) for name, values in residuals.items()},
        **shared,
        "illuminate": request.illuminate,
        "index_outside": request.scene.index_above,
    }
    return note_interference(request, found)


Made = TypeVar("Made")


@dataclass(frozen=True, eq=False)
class Share:
    """How many cores whoever calls may use, and the flag (1,) that stops all that goes on there."""

    cores: int
    stop: IntArray = field(default_factory=lambda: np.zeros(1, np.int32))


_share: ContextVar[Share | None] = ContextVar("cores", default=None)


@contextmanager
def share_cores(share: Share) -> Iterator[None]:
    """Within it, what runs side by side has so many cores: for one of several threads at work."""
    before = _share.set(share)
    try:
        yield
    finally:
        _share.reset(before)


def is_shared() -> bool:
    """Whether others are at work beside this thread."""
    return _share.get() is not None


def run_side_by_side(
    calls: Sequence[Callable[[], Made]], progress: Progress | None = None, workers: int | None = None, stop: Any = None
) -> list[Made]:
    """What calls return, in order, on ``workers`` threads; the first error or an interrupt sets ``stop`` (1,)."""
    share = _share.get()

    def perform(call: Callable[[], Made]) -> Made:
        if share and share.stop[0]:
            raise KeyboardInterrupt
        return call()

    def collect(results: Iterable[Made]) -> list[Made]:
        found = []
        for result in results:
            found.append(result)
            if progress is not None:
                progress(len(found), len(calls))
        return found

    count = min(workers or (share.cores if share else count_usable_cpus()), len(calls))
    if count < 2:
        return collect(map(perform, calls))
    with keep_to_one_thread(), ThreadPoolExecutor(count, "vrte-side-by-side") as pool:
        futures = [pool.submit(perform, call) for call in calls]
        try:
            return collect(future.result() for future in futures)
        except BaseException:
            if stop is not None:
                stop[0] = 1
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def solve_side_by_side(
    requests: Sequence[Request], progress: Progress | None = None, as_light: bool = False
) -> list[Any]:
    """Brdfs or Fields, with ``as_light`` Solutions, of requests of one thread each that differ in their scenes alone;
    alike ones are batched."""
    share = _share.get()
    stop = share.stop if share else np.zeros(1, np.int32)
    cores = share.cores if share else count_usable_cpus()
    found: dict[int, Any] = {}

    def start() -> Run:
        run = make_run(requests[0])
        run.stop, run.runtime_warned = stop, True
        return run

    def solve(indices: list[int]) -> dict[int, Any]:
        if len(indices) > 1:
            with keep_to_one_thread():
                return solve_batch(requests, indices, start(), as_light)
        solve_alone = solve_solution if as_light else solve_one
        return {index: solve_alone(requests[index], start()) for index in indices}

    def report(done: int, total: int) -> None:
        if progress is not None:
            progress(len(found), len(requests))

    def perform(jobs: list[list[int]]) -> None:
        calls = [partial(lambda job: found.update(solve(job)), job) for job in jobs]
        run_side_by_side(calls, report, stop=None if share else stop)  # a flag of several stops none of the others

    batches = [part for batch in sort_into_batches(requests) for part in split_among(batch, cores)]
    perform(batches)
    perform([[index] for index in range(len(requests)) if index not in found])
    return [found[index] for index in range(len(requests))]


def solve_solution(request: Request, run: Run) -> Solution:
    """The solution of a request."""
    return solve_request(request, run)[1]


def solve_one(request: Request, run: Run) -> Brdf | Field:
    """The result of a request of either kind."""
    mu, solution = solve_request(request, run)
    return make_brdf(request, solution) if request.kind == "brdf" else make_field(request, mu, solution)


def split_among(batch: list[int], cores: int) -> list[list[int]]:
    """A batch in as many parts as there are cores, each of two or more."""
    step = max(2, -(-len(batch) // cores))
    return [batch[first : first + step] for first in range(0, len(batch), step)]


MOST_SCENES = 1_000_000


@complete_docstring
def brdfs(
    scenes: Annotated[Iterable[Scene], Any],
    mu_i: Any,
    mu_o: Any,
    phi: Any = 0.0,
    nodes: int | None = None,
    threads: int | None = None,
    transmission: bool = False,
    progress: Progress | None = None,
    algorithm: str | None = None,
    accuracy: float | None = None,
    truncation: str | None = None,
    backend: str | None = None,
    illuminate: str = "top",
    time_limit_s: float | None = None,
    verify: bool | Literal["photons"] | None = None,
    method: str = "discrete-ordinates",
    settings: Mapping[str, Any] | None = None,
    precision: str | None = None,
    grading: int | None = None,
    derivatives: Derivatives = None,
    coherent: bool = False,
) -> list[Brdf]:
    """The Mueller BRDFs of many scenes, for the same directions; each the same as by itself.

    With ``backend="opencl"`` all scenes go to the device together, where blocks of Fourier orders that are alike are
    solved in one call; otherwise one scene is solved after another. ``time_limit_s`` is for all scenes together.

    Parameters
    ----------
    scenes : iterable of Scene
        What light meets in each.
    {mu_i, mu_o, phi, transmission, progress, options, derivatives, coherent}

    Returns
    -------
    list of Brdf
        One a scene.

    Raises
    ------
    {SceneError, AccuracyError, DeviceError}

    Examples
    --------
    >>> import vrte
    >>> layers = [vrte.Layer(vrte.rayleigh(), albedo=a, thickness=1.0) for a in (0.5, 1.0)]
    >>> [len(b.mu_o) for b in vrte.brdfs([vrte.Scene([layer]) for layer in layers], 0.5, [0.2, 0.7], nodes=4)]
    [2, 2]
    """
    asked = locals()
    given = check_list("scenes", asked.pop("scenes"), MOST_SCENES)
    names = asked.pop("derivatives")
    requests: list[Request] = []
    variations = []
    for index, scene in enumerate(given, 1):
        try:
            variations.append(read_derivatives(check_scene(scene), names))
            request = make_alike_request(requests[0], scene) if requests else None
            requests.append(request or choose_method(make_brdf_request(scene, **asked)))
        except SceneError as error:
            raise error.behind(f"scene {index} of {len(given)}") from error
    return solve_brdfs(requests, progress, "scenes", variations=variations)


def solve_brdfs(
    requests: Sequence[Request],
    progress: Progress | None,
    what: str,
    warned: bool | None = None,
    variations: Sequence[Sequence[Variation]] = (),
) -> list[Brdf]:
    """The BRDFs of requests; ``warned`` of their time, None: not yet predicted; ``variations`` of each."""
    variations = variations or [()] * len(requests)
    count = len(requests)
    if not requests:
        return []
    if warned is None:
        warned = warn_runtime_of_all(count, lambda index: (requests[index], 0.0), f"{count} {what}")
    exact = all(request.method == EXACT and not request.verify for request in requests)
    for request, some in zip(requests, variations, strict=True):
        if some:
            check_differentiable(request)
    if exact and choose_engine(requests[0].backend).takes_many:
        run = make_run(requests[0])
        run.runtime_warned = warned
        return run_interruptible(run, lambda: solve_together(requests, run, progress))
    found = {} if any(variations) else solve_alike_ones(requests, warned, progress)
    rest = [index for index in range(count) if index not in found]
    for done, index in enumerate(rest, len(found)):
        part = share_progress(progress, done, count)
        found[index] = find_brdf(requests[index], variations[index], part, warned)
        if part is not None:
            part(1, 1)
    return [found[index] for index in range(count)]


def solve_together(requests: Sequence[Request], run: Run, progress: Progress | None) -> list[Brdf]:
    """The BRDFs of all requests at once, by an engine that takes many."""
    step = itertools.count()

    def solve(asked: Sequence[Request]) -> list[Answer]:
        plans = [plan_request(request, run) for request in asked]
        found = solve_plans(plans, run, share_steps(progress, next(step)) if asked[0].refined else progress)
        return [(plan.mu, one) for plan, one in zip(plans, found, strict=True)]

    answers = refine(requests, solve) if requests[0].nodes is None else solve(requests)
    return [make_brdf(request, found) for request, (_, found) in zip(requests, answers, strict=True)]
