"""Section 3.A, first step: E and F of (1:41), and the rows and columns that lead out of and into the nodes."""

from dataclasses import dataclass

import numpy as np

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
    with run.timed("assembly") as crew:
        run.kernels.assemble(
            crew,
            orders=orders,
            members=np.array(problem.stokes, np.int32),
            coefficients=problem.coefficients,
            terms=problem.terms,
            albedo=problem.albedo,
            directions=directions,
            weights=problem.weights,
            n_out=problem.mu_out.size,
            E=result.E,
            F=result.F,
            G_E=result.G_E,
            G_F=result.G_F,
            source_s=result.source_s,
            source_d=result.source_d,
        )
    return result
