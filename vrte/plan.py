"""What a scene and a request need, what is left out, and why, before any heavy work."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vrte.arrays import Array
from vrte.discrete_ordinates.blocks import Block, make_blocks
from vrte.discrete_ordinates.discretise import discretise
from vrte.discrete_ordinates.needs import Needs, brightness, needs_of, orders_that_matter
from vrte.discrete_ordinates.problem import Problem, Run
from vrte.discrete_ordinates.quadrature import double_gauss
from vrte.discrete_ordinates.summing import Wanted
from vrte.discrete_ordinates.truncating import Truncation, choose_truncation
from vrte.request import Request
from vrte.scene import MuellerBase, Scene


@dataclass(frozen=True, eq=False)
class Plan:
    """What the solver will do, and nothing else.

    ``problem``: the scene on ``nodes`` nodes a hemisphere, truncated as ``truncation`` says; ``mu``: the signed
    cosines, as asked; ``needs`` and ``brightest`` (n_tau,): bounds on each order, and the light they are compared with;
    ``orders``: how many there are at most; ``blocks``: how they are solved.
    """

    request: Request
    problem: Problem
    truncation: Truncation
    mu: Array
    needs: Needs
    brightest: Array
    wanted: Wanted
    orders: int
    blocks: tuple[Block, ...]
    notes: tuple[str, ...] = field(default=())

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
            "orders_of_phase_matrix": longest,
            "terms_cut": max(0, longest - 2 * nodes),
            "truncation": self.truncation.name,
            "truncation_rule": self.truncation.reason,
            "peak_fractions": self.problem.fraction.tolist(),
            "base": base_statement(self.request.scene),
        }


def base_statement(scene: Scene) -> str:
    """What the base is, and whether light gets there."""
    name = "black" if scene.base is None else type(scene.base).__name__
    return name if scene.base_is_reached or scene.base is None else f"{name}, not reached below an infinite layer"


def make_plan(request: Request, run: Run) -> Plan:
    """The plan of a request."""
    nodes = request.nodes if request.nodes is not None else 40
    mu = np.concatenate([double_gauss(nodes)[0], -double_gauss(nodes)[0]]) if request.mu is None else request.mu
    scene = request.scene
    rank = np.argsort(mu < 0.0, kind="stable")
    truncation = choose_truncation(request.truncation, scene, request.columns, mu, request.tau, nodes)
    problem = discretise(scene, request.mu0, request.columns, mu[rank], request.tau, nodes, truncation.peaks)
    needs = needs_of(problem, run)
    brightest = brightness(scene, problem, mu, run)
    base = scene.base if scene.base_is_reached else None
    if isinstance(base, MuellerBase):
        count = int(problem.terms.max())
    elif request.fluxes_only:
        count = 1
    else:
        count = orders_that_matter(needs, problem.depth, brightest, request.accuracy)
    orders = np.arange(count, dtype=np.int32)
    blocks = make_blocks(problem, base, orders, needs, float(brightest.min()), request.accuracy, request.algorithm)
    wanted = request.wanted or everything(request.tau.size, mu.size, request.columns.shape[0])
    return Plan(request, problem, truncation, mu, needs, brightest, wanted, count, tuple(blocks))


def everything(n_tau: int, n_mu: int, n_col: int) -> Wanted:
    """All depths and directions of one beam, its columns added up."""
    part = np.arange(n_tau, dtype=np.int32), np.arange(n_mu, dtype=np.int32)
    return Wanted([part], np.zeros(n_col, np.int32), np.ones(1))
