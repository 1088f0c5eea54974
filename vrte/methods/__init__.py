"""Methods for the same scenes, behind the same call: one a file of this folder, by whose name it is found."""

from dataclasses import replace
from functools import cache
from importlib import import_module

from vrte.basics import cost
from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress, Run, start_run
from vrte.discrete_ordinates.execution.engines import choose_engine
from vrte.discrete_ordinates.planning.node_choice import NodeChoice, choose_nodes
from vrte.methods.auto import choose_by_rule
from vrte.methods.parts.method import Method
from vrte.methods.parts.task import NODES, Task
from vrte.request.how import AUTO, EXACT, METHODS
from vrte.request.request import Request, estimate_operations
from vrte.results.solution import Solution


@cache
def find_method(name: str) -> Method:
    """What a method's file says of it.

    >>> find_method("single-scattering").polarization
    True
    """
    assert name in METHODS
    found: Method = import_module(f"vrte.methods.{name.replace('-', '_')}").METHOD
    return found


def choose_method(request: Request) -> Request:
    """The request with its method named: for "auto", the one that the rules take. Raises SceneError where the method
    does not take the request."""
    if request.method == AUTO:
        return choose_by_rule(request)
    find_method(request.method).checked(request)
    return request


def make_run(request: Request, count: int = 1) -> Run:
    """The run of so many requests like this one: its threads, one of a sequential backend, and its engine's stages."""
    backend, threads = request.backend, request.threads
    if backend.kernels == "sequential":
        if threads not in (None, 1):
            raise SceneError(
                f"backend {backend.label!r} has one thread: leave threads out, or ask for 'openmp'", "backend"
            )
        threads = 1
    run = start_run(threads, count * estimate_operations(request))
    run.kernels = choose_engine(backend).stages
    return run


def solve_request(request: Request, run: Run, progress: Progress | None = None) -> tuple[Array, Solution]:
    """The signed cosines of the result and the solution by the request's method, incident columns added up as wanted.
    Raises SceneError, which names the method, where it does not take the scene or what is asked for."""
    method = find_method(request.method)
    settings = method.checked(request)
    if request.method == EXACT:
        return method.solve(Task(request, settings, run, progress))
    request, choice = fix_nodes(request, run)
    why = f", most of it for method {request.method!r} on {request.nodes or NODES} nodes"
    change = f"fewer nodes take less, as does {EXACT!r}"
    cost.foretell(predict_seconds(request, run), request.time_limit_s, why, change, run.told)
    mu, found = method.solve(Task(request, settings, run, progress, choice))
    if request.method_rule:
        promised = {"promised": True, "notes": []} | found.diagnostics
        ruled = {"method_rule": request.method_rule, "accuracy": request.accuracy}
        found = replace(found, diagnostics=promised | ruled)
    return mu, found


def fix_nodes(request: Request, run: Run) -> tuple[Request, NodeChoice | None]:
    """The request with the nodes that its accuracy takes, where it asks for one by a method that keeps it."""
    if request.nodes is not None or "accuracy" not in request.given:
        return request, None
    asked = request.scene, request.mu0, request.mu, request.phi, request.tau, request.accuracy
    choice = choose_nodes(*asked, replace(run, threads=1, stages={}), under=request.under)
    return replace(request, nodes=choice.nodes), choice


def predict_seconds(request: Request, run: Run) -> float:
    """Seconds of the request's method beside the exact one. Raises SceneError where it does not take the request."""
    method = find_method(request.method)
    settings = method.checked(request)
    if method.operations is None:
        return 0.0
    task = Task(fix_nodes(request, run)[0], settings, run)
    return method.operations(task) / cost.RATE.get(request.method, cost.RATE[EXACT])
