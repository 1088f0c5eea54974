"""The plan of a call of `vrte.brdf` or `vrte.radiance`, from the same arguments."""

from collections.abc import Callable
from dataclasses import replace
from inspect import signature
from typing import Any

from vrte.basics.arrays import Array, shown
from vrte.basics.errors import SceneError
from vrte.basics.running import interruptible, new_run
from vrte.calls.brdf import brdf
from vrte.calls.radiance import radiance
from vrte.discrete_ordinates.planning.plan import Plan, plan_of
from vrte.methods import choose_method
from vrte.request.request import EXACT, Request, brdf_request, radiance_request, solver_options
from vrte.scene.scene import Scene

OPTIONS = (
    "nodes",
    "accuracy",
    "algorithm",
    "verify",
    "truncation",
    "backend",
    "method",
    "settings",
    "illuminate",
    "time_limit_s",
)
DIRECTIONS = {"brdf": ("mu_i", "mu_o", "phi", "transmission"), "radiance": ("mu0", "stokes", "mu", "phi", "tau")}


def plan(kind: str, scene: Scene, *arguments: Any, **keywords: Any) -> Plan:
    """What `vrte.brdf` or `vrte.radiance` would do, without doing it.

    Parameters: ``kind``, "brdf" or "radiance"; all else as that function takes it. ``print(plan)`` shows the Fourier
    orders and what each block of them costs, what is left out and why, the predicted operations and memory;
    ``plan.as_dict()`` has the same for programs. With method="auto" it says which method the rules take. Without
    ``nodes`` they are chosen, by a small solve. Raises SceneError for bad input and for another method asked for by
    name, which has no such plan, TypeError for a keyword that the function does not have.

    >>> import vrte
    >>> scene = vrte.Scene([vrte.Layer(vrte.isotropic(), albedo=0.9, thickness=1.0)])
    >>> plan("radiance", scene, mu0=0.6, nodes=8)
    Plan(radiance, 1 orders at most, 1 blocks)
    """
    request, threads = request_of(kind, scene, arguments, keywords)
    if request.method != EXACT and not request.method_rule:
        raise SceneError(f"method {request.method!r} has no plan: there are plans of {EXACT!r} and 'auto'", "method")
    run = new_run(threads)
    found = interruptible(run, lambda: plan_of(request, run))
    # what the rules gave to another method has no Fourier order to solve
    return replace(found, blocks=(), orders=0) if request.method_rule and request.method != EXACT else found


def request_of(kind: Any, scene: Any, arguments: tuple[Any, ...], keywords: dict[str, Any]) -> tuple[Request, Any]:
    """The request that vrte.brdf or vrte.radiance would make of its arguments, and the threads asked for."""
    if not (isinstance(kind, str) and kind in DIRECTIONS):
        raise SceneError(f"kind must be 'brdf' or 'radiance', not {shown(kind)}", "kind")
    given = signature(brdf if kind == "brdf" else radiance).bind(scene, *arguments, **keywords)
    given.apply_defaults()
    values = given.arguments
    options = solver_options(*(values[name] for name in OPTIONS))
    make: Callable[..., tuple[Request, Array]] = brdf_request if kind == "brdf" else radiance_request
    request, _ = make(scene, *(values[name] for name in DIRECTIONS[kind]), options)
    return choose_method(request), values["threads"]
