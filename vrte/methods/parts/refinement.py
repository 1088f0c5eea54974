"""An accuracy without nodes: the request solved on neighbouring counts of nodes until their results agree.

The difference between two counts of a fixed series counts as the error of the finer one, whose result is returned. All
that was asked for is compared, of many azimuths a few. An estimate chooses where the series starts, nothing else.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from vrte.basics.arrays import Array, IntArray
from vrte.basics.errors import AccuracyError
from vrte.basics.running import Progress
from vrte.discrete_ordinates.planning.choose_quadrature import (
    AIM,
    OF_NODES,
    NodeChoice,
    choose_first_nodes,
    find_next_count,
    find_unseen_share,
)
from vrte.methods.parts.method import Answer
from vrte.request.request import Request
from vrte.results.solution import NO_LIGHT, Solution

AZIMUTHS = 9  # compared, at most
ROUNDING, STALLED = 1e-9, 0.5  # differences below the former that do not fall to this part of the last are rounding
Solve = Callable[[Sequence[Request]], Sequence[Answer]]


@dataclass(eq=False)
class Refinement:
    """A request on its way: ``first``, where its series starts; ``nodes`` last solved on; ``differences``, over the
    brightest light, by the finer count; ``unseen``, what the last two may both miss; ``coarse``, the last light at the
    azimuths compared; ``spent``, seconds of each solve; ``failed``: why the last count found no answer."""

    request: Request
    first: NodeChoice
    nodes: int = 0
    differences: dict[int, float] = field(default_factory=dict)
    unseen: float = 0.0
    coarse: Solution | None = None
    answer: Answer | None = None
    spent: list[float] = field(default_factory=list)
    failed: AccuracyError | None = None

    @cached_property
    def azimuths(self) -> IntArray:
        """Places of the azimuths that are compared."""
        last = self.request.phi.size - 1
        return np.unique(np.linspace(0, last, AZIMUTHS).round().astype(np.int32))

    @property
    def following(self) -> Request | None:
        """The next solve, None where the answer is found."""
        request, started = self.request, bool(self.nodes)
        count = find_next_count(request.scene, self.nodes) if started else self.first.nodes
        if self.is_done or count is None:
            if request.mu is None and not (self.answer or self.failed):  # light along the nodes themselves, at last
                return self.put_on(self.nodes)
            return None
        asked = self.put_on(count)
        if request.mu is None:
            asked = replace(asked, mu=np.concatenate([OF_NODES, -OF_NODES]))
        return asked if started else replace(asked, phi=request.phi[self.azimuths], verify=False)

    def put_on(self, nodes: int) -> Request:
        """The request on so many nodes."""
        return replace(self.request, nodes=nodes, grading=self.first.grading, refined=True)

    @property
    def is_done(self) -> bool:
        """Whether the last two solutions agree to the accuracy, or to rounding."""
        last = [*self.differences.values()][-2:]
        stalled = len(last) == 2 and STALLED * last[0] < last[1] < ROUNDING
        agrees = bool(last) and max(last[-1], self.unseen) <= AIM * self.request.accuracy
        return self.failed is None and (agrees or stalled)

    def take(self, asked: Request, answer: Answer | AccuracyError) -> None:
        """Compares a solution with the one before; a count on which no algorithm finds an answer is passed over."""
        assert asked.nodes is not None
        if isinstance(answer, AccuracyError):
            self.nodes, self.coarse, self.failed = asked.nodes, None, answer
            return
        _, found = answer
        self.spent.append(float(found.diagnostics["wall_seconds"]))
        if self.request.mu is None and asked.mu is None:
            self.answer = answer
            return
        seen = replace(found, parts=[part[:, :, :, self.azimuths] for part in found.parts]) if self.nodes else found
        if self.coarse is not None:
            self.differences[asked.nodes] = measure_difference(self.request, self.coarse, seen)
            self.unseen = find_unseen_share(self.request.scene, self.nodes, self.first.grading)
        self.nodes, self.coarse, self.failed = asked.nodes, seen, None
        self.answer = None if self.request.mu is None else answer

    def finish(self) -> Answer:
        """The finest solution, with what its error is estimated to be. Raises AccuracyError where the finest count
        found none."""
        if self.failed is not None:
            raise self.failed
        assert self.answer is not None
        (mu, found), accuracy = self.answer, self.request.accuracy
        achieved = [*self.differences.values()][-1] if self.differences else np.inf
        steps = [f"{nodes}: {difference:.1g}" for nodes, difference in self.differences.items()]
        graded = f" with grading {self.first.grading}" if self.first.grading > 1 else ""
        notes = list(found.diagnostics.get("notes", ()))
        if not achieved <= accuracy:
            notes.append(f"{self.nodes} nodes differ by {achieved:.1g} from fewer, which is more than {accuracy:g}")
        elif self.unseen > accuracy:
            notes.append(describe_unseen(self.unseen))
        rule = f"{self.first.nodes} nodes{graded}; difference to the count before, {', '.join(steps)}"
        told = {"accuracy": accuracy, "nodes_rule": rule, "achieved": float(achieved), "promised": not notes}
        told |= {"notes": notes, "choosing_seconds": sum(self.spent[:-1])}
        return mu, replace(found, diagnostics=found.diagnostics | told)


def describe_unseen(share: float) -> str:
    """The note on counts of nodes that agree without having seen a thin layer, ``share`` of the light."""
    return (
        f"too few nodes to see the thin layer: none below its optical thickness, {share:.1g} of the light may be missed"
    )


def refine(requests: Sequence[Request], solve: Solve) -> list[Answer]:
    """The answers to requests without nodes, each to its accuracy; ``solve`` takes requests on nodes, several at a
    time."""
    ways = [Refinement(request, choose_first_nodes(request)) for request in requests]
    open_ = [(way, asked) for way in ways if (asked := way.following)]
    while open_:
        for (way, asked), answer in zip(open_, try_to_solve([asked for _, asked in open_], solve), strict=True):
            way.take(asked, answer)
        open_ = [(way, asked) for way, _ in open_ if (asked := way.following)]
    return [way.finish() for way in ways]


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
    """The largest of radiances over the brightest I at the same depth for the same beam, over flux/pi where no light
    comes along the directions; and of fluxes/pi over that or over what falls in, whichever is less."""
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
    """Fluxes over pi up and down, (2, n_tau, n_in), as the result scales them: of all of a beam's columns, or of the
    first, unpolarized light, where each has a place of its own."""
    both, wanted = np.stack([solution.flux_up, solution.flux_down]) / np.pi, request.wanted
    found: Array = both.sum(axis=-1) if wanted is None else both[..., 0] * wanted.scale
    return found
