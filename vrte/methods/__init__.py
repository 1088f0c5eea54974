"""Other methods for the same scenes, behind the same call: one a file, found by name."""

import math
from dataclasses import replace
from importlib import import_module

from vrte.basics.arrays import Array
from vrte.basics.forecast import foretell
from vrte.basics.running import Progress, Run
from vrte.discrete_ordinates.planning.forecast import RATE
from vrte.methods.common import NODES
from vrte.methods.method import Method
from vrte.request.request import EXACT, METHODS, Request
from vrte.results.solution import Solution


def method_of(name: str) -> Method:
    """What a method's file says of it; not for "discrete-ordinates", which is the solver itself.

    >>> method_of("single-scattering").polarization
    True
    """
    assert name in METHODS
    assert name != EXACT
    found: Method = import_module(f"vrte.methods.{name.replace('-', '_')}").METHOD
    return found


def solve(request: Request, run: Run, progress: Progress | None = None) -> tuple[Array, Solution]:
    """The cosines of the result and the solution by the request's method. Raises SceneError, which names the method,
    where it does not take the scene or what is asked for."""
    method = method_of(request.method)
    settings = method.checked(request)
    why = f", most of it for method {request.method!r} on {request.nodes or NODES} nodes"
    change = f"fewer nodes take less, as does {EXACT!r}"
    foretell(predicted(request, run), request.time_limit_s, why, change, run.told)
    mu, found = method.solve(request, settings, run, progress)
    if request.method_rule:
        promised = {"promised": True, "notes": []} | found.diagnostics
        ruled = {"method_rule": request.method_rule, "accuracy": request.accuracy}
        found = replace(found, diagnostics=promised | ruled)
    return mu, found


def predicted(request: Request, run: Run) -> float:
    """Seconds of the request's method. Raises SceneError where it does not take the request."""
    from vrte.methods.costs import operations_before  # it knows the methods

    settings = method_of(request.method).checked(request)
    return operations_before(request, settings, run) / RATE.get(request.method, math.inf)
