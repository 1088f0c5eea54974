"""Doubles that one Fourier order's arrays take, by each route."""

from vrte import _core
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.slabs import SlabStack, cut_layers, merge_materials


def count_doubles_of_route(name: str, problem: Problem) -> tuple[float, float]:
    """Doubles of an order's arrays, and of a thread's scratch memory."""
    if name == "doubling":
        return count_doubles_of_doubling(cut_layers(problem))
    if name == "scatterings":
        return count_doubles_of_scatterings(problem)
    return count_doubles_of_invariance(problem) if name == "invariance" else count_doubles_of_modes(problem)


def count_doubles_of_invariance(problem: Problem) -> tuple[float, float]:
    """Doubles of an order's arrays, and of a thread's scratch memory, by invariance."""
    directions = problem.off_nodes[0].size
    work = _core.count_scratch(
        "reflect_semi_infinite",
        stokes=len(problem.stokes),
        n_node=problem.nodes.size,
        n_off=directions,
        n_term=int(problem.terms.max()),
    )
    return float(problem.n_rhs * (problem.rows_out + problem.size)), float(work)


MOST_POLES = 35  # of the steepest slabs, at whose faces there are at most 26, and inside which at most 35


def count_doubles_of_scatterings(problem: Problem) -> tuple[float, float]:
    """Doubles of an order's arrays, and of a thread's scratch memory, by successive scatterings (GMRES)."""
    work = _core.count_scratch(
        "scatter_by_fractions", **count_sizes(problem), n_pole=MOST_POLES, n_depth=problem.level.size
    )
    return 2.0 * (1 + problem.level.size) * problem.n_rhs * (problem.size + problem.rows_out), float(work)


def count_sizes(problem: Problem) -> dict[str, int]:
    """Sizes of a problem as the core names them."""
    return {
        "stokes": len(problem.stokes),
        "n_node": problem.nodes.size,
        "n_out": problem.mu_out.size,
        "n_in": problem.mu0.size,
        "n_col": problem.columns.shape[0],
        "n_layer": problem.albedo.size,
        "n_term": problem.coefficients.shape[1],
    }


def count_doubles_of_modes(problem: Problem) -> tuple[float, float]:
    """Doubles of an order's arrays, and of a thread's scratch memory, by modes."""
    n, n_layer, n_rhs = problem.size, problem.albedo.size, problem.n_rhs
    out, into = problem.rows_out, len(problem.stokes) * problem.mu0.size
    materials, kinds = merge_materials(problem)
    per_order = float(materials.albedo.size) * n * (5 * n + 2 * out + 2 * into + 2 * n_rhs)
    per_order += n_layer * n * (2.0 * n_rhs if kinds is None else 2.0 * n + 2.0 * out + 4.0 * n_rhs)
    scratch = (
        _core.assembly_work(problem.directions.size, problem.coefficients.shape[1], len(problem.stokes)),
        _core.homogeneous_work(n),
        _core.boundary_work(n, n_layer, n_rhs),
        _core.reconstruction_work(n, problem.rows_out, n_rhs, n_layer),
    )
    return per_order, float(max(scratch))


def count_doubles_of_doubling(slab_stack: SlabStack) -> tuple[float, float]:
    """Doubles of an order's arrays, and of a thread's scratch memory, by impedance doubling."""
    problem = slab_stack.problem
    n, n_rhs, out, into = problem.size, problem.n_rhs, problem.rows_out, len(problem.stokes) * problem.mu0.size
    per_order = (
        2.0 * problem.albedo.size * n * (n + out + into)
        + 2.0 * max(1, slab_stack.material.size) * _core.extended_size(n, n_rhs, out)
        + 2.0 * slab_stack.interface.size * n_rhs * out
    )
    scratch = (
        _core.assembly_work(problem.directions.size, problem.coefficients.shape[1], len(problem.stokes)),
        _core.doubling_work(n, n_rhs, out),
        _core.joining_work(n, slab_stack.slabs.size, n_rhs, out),
    )
    return per_order, float(max(scratch))
