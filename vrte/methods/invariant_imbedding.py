"""Invariant imbedding: reflection and transmission grown from the base up by the matrix Riccati equation, and the
algebraic one for a layer without end."""

import time
from dataclasses import dataclass, field, replace

import numpy as np

from vrte.basics.arrays import Array, number
from vrte.basics.blas import single_threaded
from vrte.basics.running import Progress, Run
from vrte.methods.common import discrete, solution_of
from vrte.methods.endless import reflection
from vrte.methods.imbedding import Count, State, grow
from vrte.methods.method import Method, Setting, Settings
from vrte.methods.on_nodes import OnNodes, in_turn
from vrte.request.request import Request
from vrte.results.solution import Solution


@dataclass(eq=False)
class Work:
    """What it took, over all orders."""

    riccati: Count = field(default_factory=Count)
    doublings: int = 0


def solve(request: Request, settings: Settings, run: Run, progress: Progress | None = None) -> tuple[Array, Solution]:
    """Every Fourier order of the truncated phase matrices in turn."""
    start = time.perf_counter()
    mu, problem = discrete(request)
    cosines, out = np.unique(problem.mu_out, return_inverse=True)
    on_nodes = OnNodes(replace(problem, mu_out=cosines), request.scene.below)
    work, at_bottom = Work(), request.tau > 0.0

    def field_of(order: int, base: Array) -> tuple[Array, Array]:
        light = faces(on_nodes, order, base, bool(at_bottom.any()), settings["rtol"], work)
        up, down = (pair[at_bottom.astype(int), :, on_nodes.n :] for pair in light)
        return up, down

    with single_threaded():
        kernels, fluxes = in_turn(on_nodes, problem, out.astype(np.int32), field_of, run, progress)
    orders = np.arange(on_nodes.n_order, dtype=np.int32)
    more = {
        "steps": work.riccati.steps,
        "steps_repeated": work.riccati.repeated,
        "sweeps": work.riccati.sweeps,
        "doublings": work.doublings,
    }
    return solution_of(request, problem, mu, orders, kernels, fluxes, run, start, **more)


def faces(on_nodes: OnNodes, order: int, base: Array, through: bool, rtol: float, work: Work) -> tuple[Array, Array]:
    """Light up and down at the top and the bottom of an order, each (2, r, c); ``through``: the bottom is wanted."""
    problem = on_nodes.problem
    scattered = [on_nodes.scattered(order, layer) for layer in range(problem.albedo.size)]
    layers = list(zip(scattered, problem.thickness.tolist(), strict=True))
    ground = base
    if np.isinf(layers[-1][1]):
        ground, doublings = reflection(on_nodes, layers.pop()[0], order == 0 and problem.albedo[-1] == 1.0)
        work.doublings = max(work.doublings, doublings)
    nothing = np.zeros_like(ground)
    state = State(np.stack([ground, nothing] if through else [ground]), np.ones(on_nodes.rows.size))
    for matrices, thickness in reversed(layers):
        state = grow(on_nodes, matrices, thickness, state, rtol, work.riccati)
    if not through:
        return np.stack([state.both[0], nothing]), np.stack([nothing, nothing])
    R, T = state.both
    passed = np.exp(-problem.thickness.sum() / on_nodes.columns)
    below = ground * passed + ground[:, : on_nodes.n] @ T[: on_nodes.n]
    return np.stack([R, below]), np.stack([nothing, T])


METHOD = Method(
    name="invariant-imbedding",
    solve=solve,
    purpose="layers without end, and layers that grow on a base; light at the two faces",
    conserves="flux to rtol; to rounding below a layer without end",
    source="dR/dtau as the thin layer of (2:8) on top; SDA for its algebraic form",
    depths=False,
    settings={
        "rtol": Setting(
            1e-8,
            lambda value: number("rtol", value, 1e-13, 0.1, "between 1e-13 and 0.1"),
            "estimated error of a step in thickness, relative to the largest entry of R and of T",
        ),
    },
)
