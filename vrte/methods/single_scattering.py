"""Light scattered once, (2:24)-(2:26) with s = 1, in closed form, and the beam that the base sends back."""

import time

from vrte.arrays import Array
from vrte.discrete_ordinates.problem import Progress, Run
from vrte.discrete_ordinates.solver import Solution
from vrte.methods.common import diagnostics_of, discrete, fluxes_by_quadrature, summed
from vrte.methods.method import Method, Settings
from vrte.request import Request


def solve(request: Request, settings: Settings, run: Run, progress: Progress | None = None) -> tuple[Array, Solution]:
    """Single scattering with all terms of the phase matrix; fluxes by quadrature over its nodes."""
    start = time.perf_counter()
    mu, problem = discrete(request)
    parts = summed(request, problem, mu, [], run)
    fluxes = fluxes_by_quadrature(request, lambda problem: [], run)
    return mu, Solution(parts, *fluxes, diagnostics_of(request, problem, run, start))


METHOD = Method(
    name="single-scattering",
    solve=solve,
    purpose="thin or very dark layers, and the narrow peaks of any layer",
    conserves="nothing: light scattered twice is lost",
    source="(2:24)-(2:26), first order",
)
