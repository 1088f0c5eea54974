"""Many scenes in one call: the wavelengths of a spectrum, the entries of a table."""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any

from vrte.basics.arrays import check_list
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress, Run, run_interruptible, share_progress
from vrte.calls.batch import make_alike_request, solve_alike_ones
from vrte.calls.brdf import make_brdf
from vrte.calls.derivatives import Derivatives, check_differentiable, find_light, read_derivatives
from vrte.calls.plan import warn_runtime_of_all
from vrte.discrete_ordinates.execution.engines import choose_engine
from vrte.discrete_ordinates.planning.plan import plan_request
from vrte.methods import choose_method, make_run
from vrte.methods.discrete_ordinates import solve_plans
from vrte.methods.parts.method import Answer
from vrte.methods.parts.refinement import refine, share_steps
from vrte.request.how import EXACT, complete_docstring
from vrte.request.request import Request, check_scene, make_brdf_request
from vrte.results.brdf import Brdf
from vrte.scene.scene import Scene
from vrte.scene.vary import Variation

MOST_SCENES = 1_000_000


@complete_docstring
def brdfs(
    scenes: Annotated[Iterable[Scene], Any],
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
    verify: bool | None = None,
    method: str = "discrete-ordinates",
    settings: Mapping[str, Any] | None = None,
    precision: str | None = None,
    grading: int | None = None,
    derivatives: Derivatives = None,
) -> list[Brdf]:
    """The Mueller BRDFs of many scenes, for the same directions; each the same as by itself.

    With ``backend="opencl"`` all scenes go to the device together, where blocks of Fourier orders that are alike are
    solved in one call; otherwise one scene is solved after another. ``time_limit_s`` is for all scenes together.

    Parameters
    ----------
    scenes : iterable of Scene
        What light meets in each.
    {mu_i, mu_o, phi, transmission, progress, options, derivatives}

    Returns
    -------
    list of Brdf
        One a scene.

    Raises
    ------
    {SceneError, AccuracyError, DeviceError}

    Examples
    --------
    >>> import vrte
    >>> layers = [vrte.Layer(vrte.rayleigh(), albedo=a, thickness=1.0) for a in (0.5, 1.0)]
    >>> [len(b.mu_o) for b in vrte.brdfs([vrte.Scene([layer]) for layer in layers], 0.5, [0.2, 0.7], nodes=4)]
    [2, 2]
    """
    asked = locals()
    given = check_list("scenes", asked.pop("scenes"), MOST_SCENES)
    names = asked.pop("derivatives")
    requests: list[Request] = []
    variations = []
    for index, scene in enumerate(given, 1):
        try:
            variations.append(read_derivatives(check_scene(scene), names))
            request = make_alike_request(requests[0], scene) if requests else None
            requests.append(request or choose_method(make_brdf_request(scene, **asked)))
        except SceneError as error:
            raise error.behind(f"scene {index} of {len(given)}") from error
    return solve_brdfs(requests, progress, "scenes", variations=variations)


def solve_brdfs(
    requests: Sequence[Request],
    progress: Progress | None,
    what: str,
    warned: bool | None = None,
    variations: Sequence[Sequence[Variation]] = (),
) -> list[Brdf]:
    """Of requests with their methods named; ``warned``: whether it was said that they take long, None where nobody
    looked; ``variations`` of each, to differentiate with."""
    variations = variations or [()] * len(requests)
    count = len(requests)
    if not requests:
        return []
    if warned is None:
        warned = warn_runtime_of_all(count, lambda index: (requests[index], 0.0), f"{count} {what}")
    exact = all(request.method == EXACT and not request.verify for request in requests)
    for request, some in zip(requests, variations, strict=True):
        if some:
            check_differentiable(request)
    if exact and choose_engine(requests[0].backend).takes_many:
        run = make_run(requests[0])
        run.runtime_warned = warned
        return run_interruptible(run, lambda: solve_together(requests, run, progress))
    found = {} if any(variations) else solve_alike_ones(requests, warned, progress)
    rest = [index for index in range(count) if index not in found]
    for done, index in enumerate(rest, len(found)):
        part = share_progress(progress, done, count)
        light = find_light(requests[index], variations[index], part, warned)
        found[index] = make_brdf(requests[index], *light[1:])
        if part is not None:
            part(1, 1)
    return [found[index] for index in range(count)]


def solve_together(requests: Sequence[Request], run: Run, progress: Progress | None) -> list[Brdf]:
    """All of them at once, by an engine that takes many."""
    step = itertools.count()

    def solve(asked: Sequence[Request]) -> list[Answer]:
        plans = [plan_request(request, run) for request in asked]
        found = solve_plans(plans, run, share_steps(progress, next(step)) if asked[0].refined else progress)
        return [(plan.mu, one) for plan, one in zip(plans, found, strict=True)]

    answers = refine(requests, solve) if requests[0].nodes is None else solve(requests)
    return [make_brdf(request, found) for request, (_, found) in zip(requests, answers, strict=True)]
