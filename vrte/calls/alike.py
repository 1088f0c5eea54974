"""Scenes that are alike, solved together on the processor, as many at a time as fit into the caches."""

import time
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from vrte.basics.arrays import make_readonly, replace_unchecked
from vrte.basics.blas import keep_to_one_thread
from vrte.basics.running import Progress, Run, run_interruptible, run_jobs
from vrte.calls.energy import ROUNDING
from vrte.discrete_ordinates.execution.batch_solve import Together, solve_together
from vrte.discrete_ordinates.planning.batch_plan import (
    Alike,
    BatchKey,
    estimate_bytes,
    find_batch_key,
    is_shared_request,
    plan_batch,
)
from vrte.discrete_ordinates.planning.plan import plan_request
from vrte.methods import make_run
from vrte.methods.discrete_ordinates import warn_of_negative
from vrte.request.request import Request
from vrte.results.brdf import Brdf, make_readonly_brdf
from vrte.scene.scene import Scene

BATCH_BYTES = 16e6  # of what is worked with for the scenes that are solved in one go, by each thread
FEWEST = 2  # scenes that are worth it


def make_alike_request(request: Request, scene: Scene) -> Request | None:
    """The same asked of another scene; None where that has to be checked anew."""
    if not is_shared_request(request) or find_batch_key(scene, request) is None:
        return None
    levels = make_readonly(np.array([0.0, scene.thickness][: request.tau.size]))
    return replace_unchecked(request, scene=scene, tau=levels)


def solve_alike_ones(requests: Sequence[Request], warned: bool, progress: Progress | None) -> dict[int, Brdf]:
    """The BRDFs of those that can be solved with others, by their places among requests that differ in their scenes
    alone."""
    batches = sort_into_batches(requests)
    if not batches:
        return {}
    run = make_run(requests[0], sum(len(indices) for _, indices in batches))
    run.runtime_warned = warned
    return run_interruptible(run, lambda: solve_batches(requests, batches, run, progress))


def solve_batches(
    requests: Sequence[Request],
    batches: Sequence[tuple[BatchKey, list[int]]],
    run: Run,
    progress: Progress | None = None,
) -> dict[int, Brdf]:
    """Those of all batches, by their places, in this thread and the others of a run."""
    found: dict[int, Brdf] = {}

    def report(done: int) -> None:
        if progress is not None:
            progress(100 * len(found), 100 * len(requests))

    def solve_one(batch: tuple[BatchKey, list[int]], own: Run) -> None:
        found.update(solve_batch(requests, *batch, own))

    try:
        with keep_to_one_thread():
            run_jobs(run, [partial(solve_one, batch) for batch in batches], report)
    finally:
        run.release_threads()
    return found


def sort_into_batches(requests: Sequence[Request]) -> list[tuple[BatchKey, list[int]]]:
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
        step = max(FEWEST, int(BATCH_BYTES / estimate_bytes(first, key, min(terms, 2 * first.nodes))))
        if len(indices) >= FEWEST:
            batches += [(key, indices[k : k + step]) for k in range(0, len(indices), step)]
    return batches


def solve_batch(requests: Sequence[Request], key: BatchKey, indices: list[int], run: Run) -> dict[int, Brdf]:
    """Those of one batch that its plan stands for, and that came out right; others are solved by themselves, which says
    why."""
    begin, own = time.perf_counter(), replace_unchecked(run, stages={})
    scenes = [requests[index].scene for index in indices]
    alike, fits = plan_batch(requests[indices[0]], key, scenes, own)
    if not fits.any():
        return {}
    found, asked = solve_together(alike, own), alike.request
    for name, clock in own.stages.items():
        run.record(name, clock["wall_seconds"], clock["thread_seconds"])
    reflectance = make_readonly(found.flux / asked.mu0)
    white = (alike.albedo == 1.0).all(axis=1) & (alike.even == 1.0)
    lost = np.where(white[:, None], np.abs(1.0 - reflectance), reflectance - 1.0).max(axis=1)
    solved = fits & found.right & (lost <= max(asked.accuracy, ROUNDING))
    for k in np.flatnonzero(alike.cut & solved).tolist():
        warn_of_negative(asked, found.parts[0][k][..., 0, 0], {"terms_cut": True, "nodes": alike.nodes.size})
    shared = {  # each scene's fraction of the seconds of all
        "solved_together": alike.size,
        "stages": {
            name: {clock: seconds / alike.size for clock, seconds in clocks.items()}
            for name, clocks in own.stages.items()
        },
        "wall_seconds": (time.perf_counter() - begin) / alike.size,
    }
    thickness = np.array([scene.thickness for scene in scenes])
    through = make_readonly(np.exp(-thickness[:, None] / asked.mu0))
    mu_o = make_readonly(alike.mu[alike.mu > 0.0])
    return {
        indices[k]: make_readonly_brdf(
            partial(describe_solve, requests[indices[k]], alike, found, k, shared),
            mueller=found.parts[0][k],
            reflectance=reflectance[k],
            mu_i=asked.mu0,
            mu_o=mu_o,
            phi=asked.phi,
            transmission=found.parts[1][k] if len(found.parts) > 1 else None,
            direct_transmittance=through[k],
        )
        for k in np.flatnonzero(solved).tolist()
    }


def describe_solve(
    request: Request, alike: Alike, found: Together, index: int, shared: dict[str, Any]
) -> dict[str, Any]:
    """The diagnostics of one scene of a batch; its own plan is made for that."""
    return {
        **plan_request(request, Run(1)).diagnostics(),
        "threads": 1,
        "openmp": True,
        "orders": int(found.orders[index]),
        "unknowns": int(found.unknowns[index]),
        "orders_by": {"modes": sum(int(wanted[:, index].sum()) for wanted in alike.wanted.values())},
        "orders_repeated": None,
        **{name: float(values[index]) for name, values in found.residuals.items()},
        **shared,
        "illuminate": request.illuminate,
        "index_outside": request.scene.index_above,
    }
