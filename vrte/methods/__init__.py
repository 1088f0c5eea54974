"""Methods for the same scenes, behind the same call: a table of methods.toml each, and a file of this folder."""

import itertools
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from importlib import import_module
from pathlib import Path

from vrte.basics import cost
from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress, Run, start_run
from vrte.discrete_ordinates.execution.engines import choose_engine, find_usual_accuracy
from vrte.discrete_ordinates.planning.choose_quadrature import choose_first_nodes, find_next_count, find_unseen_share
from vrte.methods.parts.auto import choose_by_rule
from vrte.methods.parts.method import NODES, Answer, Method, Setting, Settings, Task
from vrte.methods.parts.refinement import describe_unseen, measure_difference, refine, share_steps
from vrte.request.how import AUTO, EXACT, METHODS, Backend
from vrte.request.request import Request, estimate_operations
from vrte.results.result import Solution

TABLE = Path(__file__).with_name("methods.toml")


@cache
def find_method(name: str) -> Method:
    """A method by its row of methods.toml and its file of this folder."""
    assert name in METHODS
    row = tomllib.loads(TABLE.read_text("utf-8"))[name]
    file, _, solve = row["solve"].rpartition(".")
    module = import_module(f"vrte.methods.{file or name.replace('-', '_')}")
    by_accuracy = getattr(module, "BY_ACCURACY", {})
    row["settings"] = {
        key: Setting(f"setting {key!r} of method {name!r}", **values, for_accuracy=by_accuracy.get(key))
        for key, values in row.get("settings", {}).items()
    }
    own = {"solve": getattr(module, solve), "operations": getattr(module, row.get("operations", ""), None)}
    return Method(name, **row | own)


def choose_method(request: Request) -> Request:
    """The request with its method named, for "auto" by the rules. Raises SceneError where that does not take it."""
    if request.backend is Backend.OPENCL and request.precision == "auto" and "accuracy" not in request.given:
        request = replace(request, accuracy=find_usual_accuracy(request.accuracy))
    if request.method == AUTO:
        request = choose_by_rule(request)
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
    """Signed cosines and solution by the request's method. Raises SceneError where that does not take it."""
    method = find_method(request.method)
    settings = method.checked(request)
    if request.method != EXACT:
        on, fewer = "", "photons"
        if "nodes" in method.options:
            on, fewer = f" on {find_usual_nodes(request)} nodes", "nodes"
        why, change = f", most of it for method {request.method!r}{on}", f"fewer {fewer} take less, as does {EXACT!r}"
        cost.warn_runtime(predict_seconds(request, run), request.time_limit_s, why, change, run.runtime_warned)
    # nodes are found by the accuracy
    if request.nodes is None and (request.method == EXACT or "accuracy" in request.given):
        ((mu, found),) = refine_request(request, method, settings, run, progress)
    else:
        mu, found = method.solve(Task(request, settings, run, progress))
        if request.verify and request.nodes is not None and request.backend is not Backend.OPENCL:
            found = compare_counts(request, method, settings, run, found)
    if request.method_rule:
        promised = {"promised": True, "notes": []} | found.diagnostics
        ruled = {"method_rule": request.method_rule, "accuracy": request.accuracy}
        found = replace(found, diagnostics=promised | ruled)
    return mu, found


def refine_request(
    request: Request, method: Method, settings: Settings, run: Run, progress: Progress | None
) -> list[Answer]:
    """Solves a request on counts of nodes until they agree."""
    step = itertools.count()

    def solve(asked: Sequence[Request]) -> list[Answer]:
        return [method.solve(Task(one, settings, run, share_steps(progress, next(step)))) for one in asked]

    return refine([request], solve)


def compare_counts(request: Request, method: Method, settings: Settings, run: Run, found: Solution) -> Solution:
    """A solution on given nodes with what more of them change, as verification asks."""
    scene, given = request.scene, request.nodes or 0
    more = find_next_count(scene, given)
    if request.mu is None or more is None:
        return found
    _, other = method.solve(Task(replace(request, nodes=more, verify=False), settings, run))
    achieved, unseen = measure_difference(request, found, other), find_unseen_share(scene, given, request.grading or 1)
    notes = [] if achieved <= request.accuracy else [f"{more} nodes differ by {achieved:.1g} from the {given} given"]
    if unseen > request.accuracy:
        notes.append(describe_unseen(unseen))
    report = {"achieved": achieved, "promised": not notes, "notes": notes}
    return replace(found, diagnostics=found.diagnostics | report)


def find_usual_nodes(request: Request) -> int:
    """The nodes that a method beside the exact one takes, as far as is known before."""
    if request.nodes is not None or "accuracy" not in request.given:
        return request.nodes or NODES
    first = choose_first_nodes(request).nodes
    return find_next_count(request.scene, first) or first


def predict_seconds(request: Request, run: Run) -> float:
    """Seconds of the request's method beside the exact one. Raises SceneError where it does not take the request."""
    method = find_method(request.method)
    settings = method.checked(request)
    if method.operations is None:
        return 0.0
    task = Task(replace(request, nodes=find_usual_nodes(request)), settings, run)
    return method.operations(task) / cost.RATE.get(request.method, cost.RATE[EXACT])
