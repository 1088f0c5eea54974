"""Many scenes in one call: the wavelengths of a spectrum, the entries of a table."""

from collections.abc import Iterable, Sequence
from typing import Any

from vrte.basics.errors import SceneError
from vrte.basics.running import Progress, Run, interruptible
from vrte.calls.brdf import as_brdf
from vrte.calls.forecast import foretell_all
from vrte.discrete_ordinates.execution.engines import engine_of
from vrte.discrete_ordinates.planning.plan import plan_of
from vrte.methods import run_of, solve_request
from vrte.methods.discrete_ordinates import solved_plans
from vrte.request.request import Request, brdf_request, solver_options
from vrte.results.brdf import Brdf
from vrte.scene.scene import Scene


def brdfs(
    scenes: Iterable[Scene],
    mu_i: Any,
    mu_o: Any,
    phi: Any = 0.0,
    nodes: int | None = None,
    threads: int | None = None,
    transmission: bool = False,
    progress: Progress | None = None,
    algorithm: str | None = None,
    accuracy: float | None = None,
    truncation: str | None = None,
    backend: str | None = None,
    illuminate: str = "top",
    time_limit_s: float | None = None,
) -> list[Brdf]:
    """The Mueller BRDFs of many scenes, for the same directions; each the same as by itself.

    Parameters as for `vrte.brdf`. With ``backend="opencl"`` all scenes go to the device together, where blocks of
    Fourier orders that are alike are solved in one call; with others one scene is solved after another. ``progress`` is
    called with (steps done, steps); ``time_limit_s`` is for all scenes together. Raises SceneError for bad input, which
    names the scene, AccuracyError and DeviceError as `vrte.brdf` does.

    >>> import vrte
    >>> layers = [vrte.Layer(vrte.rayleigh(), albedo=a, thickness=1.0) for a in (0.5, 1.0)]
    >>> [len(b.mu_o) for b in brdfs([vrte.Scene([layer]) for layer in layers], 0.5, [0.2, 0.7], nodes=4)]
    [2, 2]
    """
    given = list(scenes)
    options = solver_options(
        nodes, accuracy, algorithm, False, truncation, backend, illuminate=illuminate, time_limit_s=time_limit_s
    )
    requests = []
    for place, scene in enumerate(given):
        try:
            requests.append(brdf_request(scene, mu_i, mu_o, phi, transmission, options)[0])
        except SceneError as error:
            raise error.behind(f"scene {place + 1} of {len(given)}") from error
    if not requests:
        return []
    run = run_of(requests[0], threads)
    run.told = foretell_all(len(requests), lambda k: (requests[k], run.threads, 0.0), f"{len(requests)} scenes")
    return interruptible(run, lambda: solved_together(requests, run, transmission, progress))


def solved_together(requests: Sequence[Request], run: Run, transmission: bool, progress: Progress | None) -> list[Brdf]:
    """All of them at once on a device, otherwise in turn."""
    if not engine_of(requests[0].backend).takes_many:
        return [in_turn(requests, place, run, transmission, progress) for place in range(len(requests))]
    solutions = solved_plans([plan_of(request, run) for request in requests], run, progress)
    return [as_brdf(request, found, transmission) for request, found in zip(requests, solutions, strict=True)]


def in_turn(requests: Sequence[Request], place: int, run: Run, transmission: bool, progress: Progress | None) -> Brdf:
    """One of them."""
    fresh = Run(run.threads, run.brief, run.kernels, run.stop, told=run.told)
    found = as_brdf(requests[place], solve_request(requests[place], fresh)[1], transmission)
    if progress is not None:
        progress(place + 1, len(requests))
    return found
