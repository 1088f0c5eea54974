"""A request as a method gets it, and the result made of what the method finds: the same for all methods on nodes."""

import time
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, BoolArray
from vrte.basics.quadrature import make_double_gauss
from vrte.basics.running import Progress, Run
from vrte.discrete_ordinates.execution.engines.cpu import PROCESSOR
from vrte.discrete_ordinates.execution.sums import Light, Target, fill_parts
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.orders.problem import ALL, Problem
from vrte.discrete_ordinates.planning.azimuths import fold_azimuths
from vrte.discrete_ordinates.planning.choose_quadrature import take_given_nodes
from vrte.discrete_ordinates.planning.plan import want_everything
from vrte.methods.parts.method import Answer, Settings
from vrte.request.request import Request
from vrte.results.solution import Solution

NODES = 16  # of a hemisphere, where neither nodes nor an accuracy are asked for


def find_cosines(request: Request) -> Array:
    """The signed cosines of the result: those asked for, or the nodes."""
    if request.mu is not None:
        return request.mu
    points = make_double_gauss(request.nodes or NODES)[0]
    return np.concatenate([points, -points])


def discretise_request(request: Request, nodes: int | None = None, peaks: Any = "none") -> Problem:
    """The scene on nodes, phase matrices cut to the terms that they carry; light going up comes first."""
    mu = find_cosines(request)
    rank = np.argsort(mu < 0.0, kind="stable")
    return discretise_scene(
        request.scene,
        request.mu0,
        request.columns,
        mu[rank],
        request.tau,
        nodes or request.nodes or NODES,
        peaks,
        request.under,
    )


@dataclass(frozen=True, eq=False)
class Task:
    """A request, with all settings of its method, and what it runs on."""

    request: Request
    settings: Settings
    run: Run
    progress: Progress | None = None
    begin: float = field(default_factory=time.perf_counter)

    @cached_property
    def mu(self) -> Array:
        """The signed cosines of the result, (n_mu,)."""
        return find_cosines(self.request)

    @cached_property
    def problem(self) -> Problem:
        """The scene on the request's nodes."""
        return discretise_request(self.request)

    def target_of(self, problem: Problem, spread: bool | BoolArray = False) -> Target:
        """What light is added up into."""
        wanted, spreads = self.request.wanted or want_everything(self.request, self.mu), np.asarray(spread)
        spreads = np.broadcast_to(spreads, self.mu.shape)
        return Target(wanted, self.request.scene, problem, self.mu, fold_azimuths(self.request.phi), spreads)

    def tell(self, done: int, total: int) -> None:
        """Says how many steps are done. Raises KeyboardInterrupt where the user wants no more."""
        if self.run.stop[0]:
            raise KeyboardInterrupt
        if self.progress is not None:
            self.progress(done, total)

    def sum_orders(
        self, problem: Problem, kernels: Array | None = None, spread: bool | BoolArray = False
    ) -> list[Array]:
        """The radiance of every part of what is wanted: Fourier orders, single scattering and the beam that the base
        reflects; ``spread``, True or (n_mu,): there one scattering of the beam as it spreads by small angles stands for
        single scattering. kernels (order, n_tau, n_in, n_col, n_out, 4): multiply scattered light of orders 0, 1, ...
        for a unit beam in the public frame, light going up first."""
        lights = []
        if kernels is not None:
            orders, columns = (np.arange(kernels.shape[axis], dtype=np.int32) for axis in (0, 3))
            lights = [Light(orders, np.array(ALL, np.int32), columns, kernels)]
        return fill_parts(self.target_of(problem, spread), lights, PROCESSOR, self.run)

    def answer(self, parts: list[Array], fluxes: tuple[Array, Array], problem: Problem, **told: Any) -> Answer:
        """The result: radiance of every part wanted, diffuse fluxes up and down, (n_tau, n_in, n_col), and what is
        ``told`` of how they were made."""
        diagnostics = {
            "method": self.request.method,
            "nodes": int(problem.nodes.size),
            "terms_cut": problem.terms_cut,
            "threads": self.run.threads,
            **told,
            "stages": self.run.stages,
            "wall_seconds": time.perf_counter() - self.begin,
        }
        return self.mu, Solution(parts, *fluxes, diagnostics)

    def answer_on_nodes(self, kernels: Array, fluxes: tuple[Array, Array], **told: Any) -> Answer:
        """The result of what solves the discrete problem order by order, and why no accuracy can be promised."""
        choice = take_given_nodes(self.request, self.problem.nodes.size)
        if "accuracy" in self.request.given:
            told = {"accuracy": self.request.accuracy, "nodes_rule": choice.rule, "promised": True, "notes": []} | told
        if choice.notes:
            told |= {"promised": False, "notes": [*told.get("notes", ()), *choice.notes]}
        return self.answer(self.sum_orders(self.problem, kernels), fluxes, self.problem, orders=len(kernels), **told)
