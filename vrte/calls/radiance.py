"""vrte.radiance: the field of one beam, or of several."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, frozen, settled
from vrte.basics.running import Progress, interruptible
from vrte.methods import choose_method, run_of, solve_request
from vrte.methods.discrete_ordinates import warn_of_negative
from vrte.request.request import Request, depths, radiance_request, solver_options
from vrte.results.field import Field
from vrte.results.solution import Solution
from vrte.scene.illumination import mirrored_stokes
from vrte.scene.scene import Scene


def radiance(
    scene: Scene,
    mu0: Any,
    stokes: Any = (1.0, 0.0, 0.0, 0.0),
    mu: Any = None,
    phi: Any = 0.0,
    tau: Any = 0.0,
    nodes: int | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    algorithm: str | None = None,
    verify: bool | None = None,
    accuracy: float | None = None,
    truncation: str | None = None,
    backend: str | None = None,
    method: str = "discrete-ordinates",
    settings: Mapping[str, Any] | None = None,
    illuminate: str = "top",
    time_limit_s: float | None = None,
) -> Field:
    """The diffuse field of one beam, or of several in one solve, by discrete ordinates or another method.

    Parameters: ``mu0``, the beam's positive cosine, or a list of cosines, whose axis the result then has in front;
    ``stokes``, its flux vector perpendicular to it, I >= 0 and I^2 >= Q^2 + U^2 + V^2; ``mu``, signed cosines
    (default: the nodes, up and down); ``phi``, degrees from the beam's heading; ``tau``, optical depths; ``nodes``
    a hemisphere (2 x nodes terms of the phase matrix are used for multiple scattering, all of them for single
    scattering); ``accuracy``, relative to the largest I at each depth: of the discrete problem where nodes are
    given (default 1e-8), of the continuous one where the plan chooses them (default 1e-6;
    ``diagnostics["promised"]`` and ``["notes"]`` say where it cannot be promised); ``threads``, default all usable
    CPUs; ``progress``, called with (orders done, orders); ``algorithm``, "modes" (eigenvectors), "doubling"
    (impedance doubling, no eigenproblem) or "auto", which takes one by rule; ``verify=True`` solves by both and
    puts their agreement into ``diagnostics``; ``truncation``, what becomes of phase matrices with more terms than
    the nodes carry: "none" cuts them, "delta-m" counts their forward peak as light that was not scattered,
    "small-angle" does so too and spreads that light, "auto" takes one by rule (docs/truncation.md); ``backend``,
    what computes: "openmp", the compiled core on ``threads``, "sequential", the same on one, "opencl", an OpenCL
    device, or one of the mixtures in docs/opencl.md; ``method``, "discrete-ordinates" (exact), another of
    docs/methods.md, with its own ``settings`` by name, or "auto", which takes one for the ``accuracy`` by rule,
    without nodes and settings (``diagnostics["method_rule"]``); ``illuminate``, where the beam comes from: "top",
    or "bottom", for scenes without a base and with a finite thickness; ``time_limit_s``: what is predicted, to a
    factor of about 3, to take longer is refused (default an hour; math.inf: nothing is); what takes more than 20
    seconds says so at once in a LongSolveWarning. Raises SceneError for bad input, AccuracyError where neither
    algorithm can vouch for its answer, DeviceError where a device is missing or fails. Source: Collin, Pattanaik,
    Bouatouch, section 2.

    >>> import vrte
    >>> scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=1.0, thickness=0.5)])
    >>> radiance(scene, mu0=0.6, mu=[0.5, -0.5], nodes=8).stokes.shape
    (1, 2, 1, 4)
    """
    options = solver_options(
        nodes, accuracy, algorithm, verify, truncation, backend, method, settings, illuminate, time_limit_s
    )
    request, incident = radiance_request(scene, mu0, stokes, mu, phi, tau, options)
    request = choose_method(request)
    run = run_of(request, threads)
    directions, solution = interruptible(run, lambda: solve_request(request, run, progress))
    found = field_of(request, directions, solution, depths(tau, request.scene), incident)
    return found.beam(0) if is_one_number(mu0) else found


def is_one_number(value: Any) -> bool:
    """Whether this is a number and no list of them, not even one of length 1."""
    return type(value) is float or np.ndim(value) == 0


def field_of(request: Request, directions: Array, solution: Solution, tau: Array, incident: Array) -> Field:
    """What was found, as a result of as many beams as were asked for; tau (n_tau,) as asked."""
    seen = np.moveaxis(settled(solution.parts[0])[..., 0], 1, 0)  # (n_in, n_tau, n_mu, n_phi, 4)
    warn_of_negative(request, seen[..., 0], solution.diagnostics)
    beams = request.mu0[:, None]
    direct = beams * incident[0] * np.exp(-request.tau / beams)
    fluxes = [np.moveaxis(flux, 1, 0).sum(axis=-1) for flux in (solution.flux_up, solution.flux_down)]
    if request.illuminate == "bottom":
        seen, fluxes = mirrored_stokes(seen), fluxes[::-1]
        if request.mu is None:  # the nodes, up and down, the other way round
            seen = np.roll(seen, directions.size // 2, axis=2)
        else:
            directions = -directions
    if request.fluxes_only:
        directions = directions[:0]
    return Field(
        stokes=seen[:, :, : directions.size],
        flux_up=frozen(fluxes[0]),
        flux_down=frozen(fluxes[1]),
        direct=frozen(direct),
        tau=tau,
        mu=directions,
        phi=request.phi,
        mu0=request.mu0,
        incident_stokes=incident,
        diagnostics=solution.diagnostics | {"illuminate": request.illuminate},
    )
