"""An accuracy without nodes: the request solved on neighbouring counts of nodes until their results agree.

The difference between two counts of a fixed series is the error of the coarser one. The trend from one difference to
the next bounds the error of the finest, whose result is returned. All that was asked for is compared, of many azimuths
a few. An estimate chooses where the series starts and the grading, nothing else.
"""

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import replace

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import AccuracyError
from vrte.basics.running import Progress
from vrte.discrete_ordinates.orders.truncating import count_terms_carried
from vrte.discrete_ordinates.planning.choose_quadrature import (
    AIM,
    OF_NODES,
    choose_first_nodes,
    find_next_count,
    find_scattering_thickness,
    find_unseen_share,
    has_mirrored_horizon,
)
from vrte.methods.parts.method import Answer
from vrte.request.request import Request
from vrte.results.result import NO_LIGHT, Solution
from vrte.scene.scene import Scene

AZIMUTHS = 9  # compared, at most
ROUNDING, STALLED = 1e-9, 0.5  # differences below the former that do not fall to this part of the last are rounding
STEADY = 0.1  # optical thickness of what scatters in a medium from which on errors fall steadily with more nodes
DEEP, PANELS = 30.0, 12  # how many times as thick one layer has to be for that under a surface, and nodes it takes
LEAST_TREND = 0.1  # error of a count over that of the one before, at least, as far as it is believed
CUT_TREND = 0.3  # the same where the nodes do not carry all terms: by 0.11 a coarse pigment missed 1e-8 by 1.4
Solve = Callable[[Sequence[Request]], Sequence[Answer]]


def refine_one(request: Request) -> Generator[Request, Answer | AccuracyError, Answer]:
    """Yields a request on ever more nodes, is sent answers or errors, returns the finest. Raises AccuracyError."""
    first, accuracy = choose_first_nodes(request), request.accuracy
    azimuths = np.unique(np.linspace(0, request.phi.size - 1, AZIMUTHS).round().astype(np.int32))  # that are compared
    differences: dict[int, float] = {}  # over the brightest light, by the finer count
    spent: list[float] = []  # seconds of each solve
    unseen, coarse, nodes = 0.0, None, 0
    count: int | None = first.nodes
    while count is not None:
        asked = replace(request, nodes=count, grading=first.grading, refined=True)
        if request.mu is None:
            asked = replace(asked, mu=np.concatenate([OF_NODES, -OF_NODES]))
        if not nodes:
            asked = replace(asked, phi=request.phi[azimuths], verify=False)
        answer = yield asked
        if isinstance(answer, AccuracyError):  # no algorithm finds an answer there: the count is passed over
            coarse = None
        else:
            found = answer[1]
            spent.append(float(found.diagnostics["wall_seconds"]))
            seen = replace(found, parts=[part[:, :, :, azimuths] for part in found.parts]) if nodes else found
            if coarse is not None:
                differences[count] = measure_difference(request, coarse, seen)
                unseen = find_unseen_share(request.scene, nodes, first.grading)
            coarse = seen
        error = max(unseen, estimate_error(differences, request.scene))
        last = [*differences.values()][-2:]
        is_rounding = len(last) == 2 and STALLED * last[0] < last[1] < ROUNDING
        is_done = coarse is not None and (error <= AIM * accuracy or is_rounding)
        nodes, count = count, None if is_done else find_next_count(request.scene, count)
    if request.mu is None and not isinstance(answer, AccuracyError):  # light along the nodes themselves, at last
        answer = yield replace(request, nodes=nodes, grading=first.grading, refined=True)
    if isinstance(answer, AccuracyError):
        raise answer
    mu, found = answer
    spent += [float(found.diagnostics["wall_seconds"])] if request.mu is None else []
    achieved = estimate_error(differences, request.scene)
    steps = [f"{count}: {difference:.1g}" for count, difference in differences.items()]
    graded = f" with grading {first.grading}" if first.grading > 1 else ""
    notes = list(found.diagnostics.get("notes", ()))
    if not achieved <= accuracy:
        notes.append(f"{nodes} nodes differ by {achieved:.1g} from fewer, which is more than {accuracy:g}")
    elif unseen > accuracy:
        notes.append(describe_unseen(unseen))
    rule = f"{first.nodes} nodes{graded}; difference to the count before, {', '.join(steps)}"
    report = {"accuracy": accuracy, "nodes_rule": rule, "achieved": float(achieved), "promised": not notes}
    report |= {"notes": notes, "choosing_seconds": sum(spent[:-1])}
    return mu, replace(found, diagnostics=found.diagnostics | report)


def estimate_error(differences: dict[int, float], scene: Scene) -> float:
    """The error of the finest count: the last difference times the root of its ratio to the one before, where errors
    fall steadily, else a tenth of the one before at least: two counts may agree by chance."""
    before, last = [np.inf, np.inf, *differences.values()][-2:]
    thinnest = min(find_scattering_thickness(scene).values(), default=np.inf)
    if scene.needs_beam_paths or scene.is_rough:
        even = has_mirrored_horizon(scene) and len(scene.layers) == 1 and not scene.is_rough
        even = even and max(differences, default=0) >= PANELS  # on 8 one was off by more than the last difference
        thinnest = thinnest / DEEP if even else 0.0
    if thinnest < STEADY or not 0.0 < last < before < np.inf:
        return max(last, LEAST_TREND * before) if last < before < np.inf else last
    terms = max(layer.phase_matrix.terms for layer in scene.layers)
    least = CUT_TREND if terms > count_terms_carried(scene, max(differences)) else LEAST_TREND
    return last * max(math.sqrt(last / before), least)


def describe_unseen(share: float) -> str:
    """The note on counts of nodes that agree without having seen a thin layer, ``share`` of the light."""
    return (
        f"too few nodes to see the thin layer: none below its optical thickness, {share:.1g} of the light may be missed"
    )


def refine(requests: Sequence[Request], solve: Solve) -> list[Answer]:
    """The answers to requests without nodes, each to its accuracy; ``solve`` takes several on nodes at once."""
    ways = [refine_one(request) for request in requests]
    asked = {index: next(way) for index, way in enumerate(ways)}
    found: dict[int, Answer] = {}
    while asked:
        for index, answer in zip([*asked], try_to_solve([*asked.values()], solve), strict=True):
            try:
                asked[index] = ways[index].send(answer)
            except StopIteration as end:
                found[index] = end.value
                del asked[index]
    return [found[index] for index in range(len(ways))]


def try_to_solve(requests: Sequence[Request], solve: Solve) -> Sequence[Answer | AccuracyError]:
    """The answers; one by one where a request among several has none."""
    try:
        return solve(requests)
    except AccuracyError as error:
        return [error] if len(requests) == 1 else [each for one in requests for each in try_to_solve([one], solve)]


def share_steps(progress: Progress | None, step: int) -> Progress | None:
    """Progress of a step of a search of unknown length: each has half of what is left."""
    if progress is None:
        return None
    begin = 1.0 - 0.5**step
    return lambda done, total: progress(round(1000 * (begin + 0.5 ** (step + 1) * done / max(total, 1))), 1000)


def measure_difference(request: Request, one: Solution, other: Solution) -> float:
    """The largest difference of radiances over the brightest I, and of fluxes/pi over that or what falls in."""
    wanted, every = request.wanted, np.arange(request.tau.size, dtype=np.int32)
    levels = [every] * len(other.parts) if wanted is None else [at for at, _ in wanted.parts]
    fluxes = [sum_fluxes(request, each) for each in (one, other)]
    size = np.abs(fluxes[1]).max(axis=0)
    brightest = np.zeros_like(size)
    seen = [] if request.fluxes_only else [*zip(levels, one.parts, other.parts, strict=True)]
    for rows, _, many in seen:
        brightest[rows] = np.maximum(brightest[rows], np.abs(many[..., 0, 0]).max(axis=(2, 3), initial=0.0))
    size = np.maximum(np.where(brightest > 0.0, brightest, size), NO_LIGHT)
    incident = request.mu0 * np.abs(request.columns[:, 0]).sum() / np.pi * (1.0 if wanted is None else wanted.scale)
    found = float((np.abs(fluxes[0] - fluxes[1]) / np.minimum(size, np.maximum(incident, NO_LIGHT))).max())
    for rows, few, many in seen:
        found = max(found, float((np.abs(few - many).max(axis=(2, 3, 4, 5), initial=0.0) / size[rows]).max()))
    return found


def sum_fluxes(request: Request, solution: Solution) -> Array:
    """Fluxes over pi up and down, (2, n_tau, n_in), as the result scales them, of all columns or of the first."""
    both, wanted = np.stack([solution.flux_up, solution.flux_down]) / np.pi, request.wanted
    return both.sum(axis=-1) if wanted is None else both[..., 0] * wanted.scale
