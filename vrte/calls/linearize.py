"""vrte.linearize: a BRDF, and how it changes with anything that layers and base are made of."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte.basics import cost
from vrte.basics.arrays import Array, check_numbers
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress, run_interruptible
from vrte.calls.brdf import make_brdf
from vrte.calls.derivatives import (
    check_differentiable,
    count_orders_found,
    differentiate,
    read_derivatives,
    warn_runtime_of_derivatives,
)
from vrte.discrete_ordinates.derivatives.adjoint import Gradient, pull_back
from vrte.discrete_ordinates.derivatives.differentiate import find_spread
from vrte.discrete_ordinates.planning.forecast import plan_within_limit
from vrte.discrete_ordinates.planning.operations import count_operations_of_derivatives
from vrte.discrete_ordinates.planning.plan import Plan
from vrte.methods import choose_method, make_run
from vrte.methods.discrete_ordinates import solve_plans
from vrte.request.how import complete_docstring
from vrte.request.request import Request, make_brdf_request
from vrte.results.brdf import Brdf
from vrte.scene.scene import Scene
from vrte.scene.vary import Variation


@dataclass(frozen=True, eq=False, repr=False)
class Linearized:
    """A BRDF and the linear map from small changes of its scene to changes of it, as `vrte.linearize` makes it.

    Attributes
    ----------
    brdf
        The BRDF itself.
    request
        What was asked for.
    plan
        How it was solved: its nodes and truncation are those of the derivatives.

    Examples
    --------
    >>> import vrte
    >>> haze = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=0.9, thickness=1.0)])
    >>> vrte.linearize(haze, mu_i=0.5, mu_o=0.5, nodes=4).jvp("layer[1].thickness").shape
    (1, 1, 1, 4, 4)
    """

    brdf: Brdf
    request: Request
    plan: Plan

    def __repr__(self) -> str:
        return f"Linearized({self.brdf!r})"

    def jvp(self, variation: Variation | str) -> Array:
        """The derivative along a variation or a named number, (n_in, n_out, n_phi, 4, 4) [1/sr] per unit."""
        variations = read_derivatives(self.request.scene, [variation])
        run, orders = make_run(self.request), count_orders_found(self.brdf.diagnostics)
        (found,) = run_interruptible(run, lambda: differentiate(self.plan, variations, run, orders=orders))
        return found.solution.parts[0][0]

    def vjp(self, cotangent: Any) -> Gradient:
        """The gradient of a sum of the BRDF's elements, weighted by ``cotangent`` (n_in, n_out, n_phi, 4, 4), with all
        that layers and base consist of.

        It takes one solve for light from the eye, whatever the number of coefficients, by reciprocity
        (docs/explanation/derivatives.md). Fourier orders are those that the light itself needs: along directions whose
        coefficients decay much more slowly than the phase matrix's, `jvp` takes all orders and is the one to trust.
        """
        weights = np.asarray(check_numbers("cotangent", cotangent), float)
        if weights.shape != self.brdf.mueller.shape:
            raise SceneError.of("cotangent", f"must have the shape {self.brdf.mueller.shape}, not {weights.shape}")
        if not np.isfinite(weights).all():
            raise SceneError.of("cotangent", "must be finite")
        run, orders = make_run(self.request), count_orders_found(self.brdf.diagnostics)
        operations = count_operations_of_derivatives(self.plan, cost.GRADIENT, cost.GRADIENT_ONCE)
        warn_runtime_of_derivatives(self.plan, operations, "for the derivatives with everything", run)
        return run_interruptible(run, lambda: pull_back(self.plan, weights, run, orders))


@complete_docstring
def linearize(
    scene: Scene,
    mu_i: Any,
    mu_o: Any,
    phi: Any = 0.0,
    nodes: int | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    algorithm: str | None = None,
    accuracy: float | None = None,
    truncation: str | None = None,
    backend: str | None = None,
    time_limit_s: float | None = None,
) -> Linearized:
    """The BRDF of a scene with the means to differentiate it along any direction, or with everything at once.

    For a few named numbers ``derivatives=`` of `vrte.brdf` is simpler. This is for many: a phase matrix of forty
    coefficients, or the gradient of what a fit or a design makes as small as it can.

    Parameters
    ----------
    {all}

    Returns
    -------
    Linearized
        ``brdf``, ``jvp(variation)`` and ``vjp(cotangent)``.

    Raises
    ------
    {SceneError, AccuracyError, DeviceError}

    Examples
    --------
    >>> import vrte
    >>> haze = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=0.9, thickness=1.0)])
    >>> vrte.linearize(haze, mu_i=0.5, mu_o=0.5, nodes=4).brdf.mueller.shape
    (1, 1, 1, 4, 4)
    """
    request = choose_method(make_brdf_request(**locals()))
    check_differentiable(request)
    run = make_run(request)

    def solve() -> tuple[Plan, Brdf]:
        plan = plan_within_limit(request, run)
        if find_spread(plan):
            raise SceneError.of("truncation", "must not be 'small-angle' for derivatives: 'delta-m' or 'none' do")
        (solution,) = solve_plans([plan], run, progress)
        return plan, make_brdf(request, solution)

    plan, found = run_interruptible(run, solve)
    return Linearized(found, request, plan)
