"""The last few plans: the same scene, seen once more along the same directions, is planned once."""

import threading
import time
from collections import OrderedDict
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from vrte.basics.running import Run
from vrte.request.request import Request

if TYPE_CHECKING:
    from vrte.discrete_ordinates.planning.plan import Plan

MOST_PLANS = 32
MOST_NUMBERS = 50_000  # largest plan that is kept, in numbers, roughly
NUMBERS = ("mu0", "columns", "mu", "phi", "tau", "under")  # arrays of a request
APART = {*NUMBERS, "scene", "wanted", "settings", "threads", "asked_tau", "incident"}
TOLD = tuple(one.name for one in fields(Request) if one.name not in APART)  # of a request, beside its scene and numbers

_plans: "OrderedDict[tuple[Any, ...], Plan]" = OrderedDict()
_lock = threading.Lock()


def name_request(request: Request, run: Run) -> tuple[Any, ...] | None:
    """What two requests with the same plan have in common, their scene itself among it; None where a plan is not kept:
    of much memory, of a user's function, or with a choice of nodes, which has things to say."""
    scene = request.scene
    terms = sum(layer.phase_matrix.terms for layer in scene.layers)
    if request.nodes is None or request.mu is None or request.settings:
        return None
    if scene.below.is_uneven or scene.needs_beam_paths:
        return None
    if terms * (request.nodes + len(scene.layers)) + request.mu.size + request.mu0.size > MOST_NUMBERS:
        return None
    arrays: list[Any] = [getattr(request, name) for name in NUMBERS]
    wanted = request.wanted
    if wanted is not None:
        arrays += [wanted.place, wanted.scale, *(each for part in wanted.parts for each in part)]
    numbers = tuple([None if one is None else (one.shape, one.tobytes()) for one in arrays])
    how = tuple([getattr(request, name) for name in TOLD])
    return scene, run.threads, how, numbers


def find_plan(name: tuple[Any, ...] | None, run: Run) -> "Plan | None":
    """The plan of a request of that name."""
    if name is None:
        return None
    begin = time.perf_counter()
    with _lock:
        found = _plans.get(name)
        if found is None:
            return None
        _plans.move_to_end(name)
    run.record("planning", time.perf_counter() - begin)
    return found


def keep_plan(name: tuple[Any, ...] | None, plan: "Plan") -> None:
    """Keeps a plan, and lets go of the one that was not asked for the longest."""
    if name is None:
        return
    with _lock:
        _plans[name] = plan
        if len(_plans) > MOST_PLANS:
            _plans.popitem(last=False)
