"""Light scattered once, (2:24)-(2:26) with s = 1, in closed form, and the beam that the base sends back."""

import time

from vrte.basics.arrays import Array
from vrte.basics.running import Progress, Run
from vrte.methods.common import diagnostics_of, discrete, fluxes_by_quadrature, summed
from vrte.methods.method import Method, Settings
from vrte.request.request import Request
from vrte.results.solution import Solution


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
