"""What a scene and a request need, what is left out, and why, before any heavy work."""

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vrte.arrays import Array
from vrte.discrete_ordinates.blocks import Block, make_blocks
from vrte.discrete_ordinates.discretise import discretise
from vrte.discrete_ordinates.needs import Needs, bounds_at, brightness, needs_of, orders_that_matter, stages_of
from vrte.discrete_ordinates.node_choice import DISCRETE, NodeChoice, choose_nodes
from vrte.discrete_ordinates.problem import Problem, Run
from vrte.discrete_ordinates.quadrature import double_gauss
from vrte.discrete_ordinates.summing import Wanted
from vrte.request import Request
from vrte.scene import MuellerBase, Scene


@dataclass(frozen=True, eq=False)
class Plan:
    """What the solver will do, and nothing else.

    ``problem``: the scene on ``nodes`` nodes a hemisphere; ``mu``: the signed cosines, as asked; ``needs``, ``bounds``
    (order, n_tau, 1) and ``brightest`` (n_tau, n_in): bounds on each order, and the light they are compared with;
    ``orders``: how many there are at most; ``blocks``: how they are solved; ``accuracy``: of the discrete problem;
    ``choice``: of its nodes.
    """

    request: Request
    problem: Problem
    mu: Array
    needs: Needs
    bounds: Array
    brightest: Array
    wanted: Wanted
    orders: int
    blocks: tuple[Block, ...]
    accuracy: float
    choice: NodeChoice

    @property
    def notes(self) -> tuple[str, ...]:
        """What cannot be promised."""
        return self.choice.notes

    @property
    def fed_back(self) -> bool:
        """Whether the base mixes orders and Stokes parameters as it likes."""
        return isinstance(self.request.scene.base, MuellerBase) and self.request.scene.base_is_reached

    def diagnostics(self) -> dict[str, Any]:
        """What a result says of how it was made."""
        longest = max(layer.phase_matrix.terms for layer in self.request.scene.layers)
        nodes = self.problem.nodes.size
        names = {block.choice.name: block.choice.reason for block in self.blocks}
        return {
            "method": "discrete-ordinates",
            "algorithm": " and ".join(sorted(names)),
            "algorithm_rule": "; ".join(dict.fromkeys(names.values())),
            "accuracy": self.request.accuracy,
            "nodes": nodes,
            "nodes_rule": self.choice.rule,
            "promised": not self.notes,
            "notes": list(self.notes),
            "orders_of_phase_matrix": longest,
            "terms_cut": max(0, longest - 2 * nodes),
            "base": base_statement(self.request.scene),
        }


def base_statement(scene: Scene) -> str:
    """What the base is, and whether light gets there."""
    name = "black" if scene.base is None else type(scene.base).__name__
    return name if scene.base_is_reached or scene.base is None else f"{name}, not reached below an infinite layer"


def make_plan(request: Request, run: Run) -> Plan:
    """The plan of a request."""
    choice, accuracy = nodes_for(request, run)
    nodes = choice.nodes
    mu = np.concatenate([double_gauss(nodes)[0], -double_gauss(nodes)[0]]) if request.mu is None else request.mu
    scene = request.scene
    rank = np.argsort(mu < 0.0, kind="stable")
    problem = discretise(scene, request.mu0, request.columns, mu[rank], request.tau, nodes)
    needs = needs_of(problem, run)
    brightest = brightness(scene, problem, mu, request.phi, run)
    bounds = bounds_at(needs, request.tau)
    base = scene.base if scene.base_is_reached else None
    stages: tuple[int, ...] = ()
    if isinstance(base, MuellerBase):
        count = int(problem.terms.max())
    elif request.fluxes_only:
        count = 1
    else:
        count = orders_that_matter(bounds, brightest, accuracy)
        stages = stages_of(bounds, brightest, accuracy)
    orders = np.arange(count, dtype=np.int32)
    faintest = float(brightest.min())
    blocks = make_blocks(problem, base, orders, stages, needs, faintest, accuracy, request.algorithm)
    wanted = request.wanted or everything(request.tau.size, mu.size, request.columns.shape[0])
    return Plan(request, problem, mu, needs, bounds, brightest, wanted, count, tuple(blocks), accuracy, choice)


def nodes_for(request: Request, run: Run) -> tuple[NodeChoice, float]:
    """The nodes, as given or chosen, and the accuracy that the discrete problem is solved to."""
    if request.nodes is not None:
        return NodeChoice(request.nodes, "as asked for", ()), request.accuracy
    asked = request.scene, request.mu0, request.mu, request.phi, request.tau, request.accuracy
    begin = time.perf_counter()
    choice = choose_nodes(*asked, replace(run, threads=1, stages={}))
    run.book("choice of nodes", time.perf_counter() - begin)
    return choice, DISCRETE * request.accuracy


def everything(n_tau: int, n_mu: int, n_col: int) -> Wanted:
    """All depths and directions of one beam, its columns added up."""
    part = np.arange(n_tau, dtype=np.int32), np.arange(n_mu, dtype=np.int32)
    return Wanted([part], np.zeros(n_col, np.int32), np.ones(1))
