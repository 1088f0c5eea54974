"""The last few plans of small requests: the same scene, seen once more along the same directions, is planned once."""

import threading
import time
from collections import OrderedDict
from typing import TYPE_CHECKING, Any

from vrte.basics.fields import change_fields
from vrte.basics.running import Run
from vrte.request.request import Request

if TYPE_CHECKING:
    from vrte.discrete_ordinates.planning.plan import Plan

MOST_PLANS = 32

_plans: "OrderedDict[tuple[Any, ...], Plan]" = OrderedDict()
_lock = threading.Lock()


def name_request(request: Request, run: Run) -> tuple[Any, ...] | None:
    """What two requests with the same plan have in common; None for those that are not worth to be kept.

    A scene is itself alone: another one like it is planned anew. Small ones alone are kept, of a base that is no
    function of a user's.
    """
    if not run.brief or request.mu is None or request.settings:
        return None
    arrays = request.mu0, request.columns, request.mu, request.phi, request.tau, request.under
    how = request.accuracy, request.algorithm, request.truncation, request.backend, request.nodes, request.verify
    rules = request.kind, request.fluxes_only, request.method_rule, request.nodes_rule, request.wanted is None
    numbers = tuple(None if one is None else one.tobytes() for one in arrays)
    return (request.scene, run.threads, request.columns.shape, numbers, how, rules)


def find_plan(name: tuple[Any, ...] | None, request: Request, run: Run) -> "Plan | None":
    """The plan of a request like this one, for this one."""
    begin = time.perf_counter()
    with _lock:
        found = _plans.get(name) if name is not None else None
        if found is None or name is None:
            return None
        _plans.move_to_end(name)
    run.book("planning", time.perf_counter() - begin)
    if request.wanted is None:
        return change_fields(found, request=request)
    return change_fields(found, request=request, wanted=request.wanted)


def keep_plan(name: tuple[Any, ...] | None, plan: "Plan") -> None:
    """Keeps a plan, and lets go of the one that was not asked for the longest."""
    if name is None:
        return
    with _lock:
        _plans[name] = plan
        if len(_plans) > MOST_PLANS:
            _plans.popitem(last=False)
