"""Section 3.A, first step: E and F of (1:41), and the rows and columns that lead out of and into the nodes."""

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, IntArray, record
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.oriented_flakes import add_flakes
from vrte.discrete_ordinates.orders.problem import Problem


@record
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
    with run.timed("assembly") as crew:
        result = Assembled(**run.kernels.assemble(crew, orders=orders, **problem.phase_arguments))
    if problem.conserves and 0 in orders and not problem.is_exact:
        balance_flux(problem, result, int(np.argmax(orders == 0)))
    if any(problem.oriented):
        add_flakes(problem, result, orders, run.threads)
    return result


def find_even_shifts(problem: Problem, terms: int) -> Array:
    """What Legendre functions p_l of order 0 are multiplied with and lessened by, (terms, 2), so that the nodes
    integrate those of even degree exactly, as Gauss's do: the flux is then conserved."""
    found = np.tile([1.0, 0.0], (terms, 1))
    if not problem.is_exact:
        total = problem.weights.sum()
        means = problem.weights @ _core.generalized_spherical_functions(0, terms, problem.nodes)[:, :, 0].T / total
        found[2::2, 1] = means[2::2]
        found[0, 0] = 1.0 / np.sqrt(total)
    return found


def balance_flux(problem: Problem, matrices: Assembled, order: int) -> None:
    """Puts the shifts of `find_even_shifts` into order 0: the rows and columns of I lose what the nodes get wrong of
    the flux of light scattered once."""
    _core.balance_flux(
        stokes=len(problem.stokes),
        coefficients=problem.coefficients,
        albedo=problem.albedo,
        directions=problem.directions,
        weights=problem.weights,
        n_out=problem.mu_out.size,
        E=matrices.E[order],
        G_E=matrices.G_E[order],
        source_d=matrices.source_d[order],
    )
