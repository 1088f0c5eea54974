"""The plan of a call of `vrte.brdf` or `vrte.radiance`, from the same arguments."""

from dataclasses import replace
from typing import Any, Literal

from vrte.basics.errors import SceneError
from vrte.basics.running import run_interruptible, start_run
from vrte.calls.derivatives import Derivatives, check_differentiable, plan_derivatives, read_derivatives
from vrte.discrete_ordinates.planning.forecast import warn_runtime_of_planning
from vrte.discrete_ordinates.planning.plan import Plan, plan_request
from vrte.methods import choose_method
from vrte.request.how import AUTO, EXACT, complete_docstring
from vrte.request.request import Request, make_brdf_request, make_radiance_request
from vrte.scene.scene import Scene


@complete_docstring
def plan(
    kind: Literal["brdf", "radiance"], scene: Scene, *arguments: Any, derivatives: Derivatives = None, **keywords: Any
) -> Plan:
    """What `vrte.brdf` or `vrte.radiance` would do, without doing it.

    Parameters
    ----------
    kind : {'brdf', 'radiance'}
        The function.
    scene, *arguments, **keywords
        As that function takes them, but for the name of another ``method``, which has no plan. With method="auto" the
        plan says which method the rules take; without ``nodes`` they are chosen, by a small solve.
    {derivatives}

    Returns
    -------
    Plan
        ``print(plan)`` shows the Fourier orders and what each block of them costs, what is left out and why, the
        predicted operations and memory; ``plan.as_dict()`` has the same for programs.

    Raises
    ------
    {SceneError}
    TypeError
        For a keyword that the function does not have.

    Examples
    --------
    >>> import vrte
    >>> scene = vrte.Scene([vrte.Layer(vrte.isotropic(), albedo=0.9, thickness=1.0)])
    >>> vrte.plan("radiance", scene, mu0=0.6, nodes=8)
    Plan(radiance, 1 orders at most, 1 blocks)
    """
    request = make_request(kind, scene, *arguments, **keywords)
    if request.method != EXACT and not request.method_rule:
        words = f"has no plan: there are plans of {EXACT!r} and {AUTO!r}"
        raise SceneError(f"method {request.method!r} {words}", "method")
    variations = read_derivatives(scene, derivatives)
    if variations:
        check_differentiable(request)
    run = start_run(request.threads)
    warn_runtime_of_planning(request, run)
    found = run_interruptible(run, lambda: plan_request(request, run))
    found = replace(found, derivatives=plan_derivatives(found, variations))
    # what the rules gave to another method has no Fourier order to solve
    return replace(found, blocks=(), orders=0) if request.method_rule and request.method != EXACT else found


def make_request(kind: Any, scene: Any, *arguments: Any, **keywords: Any) -> Request:
    """The request that `vrte.brdf` or `vrte.radiance` would make of its arguments, its method named."""
    make: Any = make_brdf_request if kind == "brdf" else make_radiance_request
    return choose_method(make(scene, *arguments, **keywords))
