"""Section 3.A, first step: E and F of (1:41), and the rows and columns that lead out of and into the nodes."""

from dataclasses import dataclass

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, IntArray
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.problem import Problem


@dataclass(frozen=True, eq=False)
class Assembled:
    """E, F (order, layer, n, n); G_E, G_F (order, layer, n, 4 n_out); source_s, source_d (order, layer, 4 n_in, n)."""

    E: Array
    F: Array
    G_E: Array
    G_F: Array
    source_s: Array
    source_d: Array


def assemble(problem: Problem, orders: IntArray, run: Run) -> Assembled:
    """All matrices of the given Fourier orders; last axes are (column, row)."""
    shape, n = (orders.size, problem.albedo.size), problem.size
    out, into = problem.rows_out, len(problem.stokes) * problem.mu0.size
    result = Assembled(
        *(np.empty((*shape, *tail)) for tail in [(n, n), (n, n), (n, out), (n, out), (into, n), (into, n)])
    )
    directions = problem.directions
    work = run.work(_core.assembly_work(directions.size, problem.coefficients.shape[1], len(problem.stokes)))
    run.timed(
        "assembly",
        run.kernels.assemble,
        orders,
        np.array(problem.stokes, np.int32),
        problem.coefficients,
        problem.terms,
        problem.albedo,
        directions,
        problem.weights,
        problem.mu_out.size,
        result.E,
        result.F,
        result.G_E,
        result.G_F,
        result.source_s,
        result.source_d,
        run.threads,
        work,
    )
    return result
