"""How much memory a request takes, said before it starts."""

from collections.abc import Sequence

from vrte.basics.arrays import MOST_BYTES
from vrte.basics.memory import BYTES, PIECE_BYTES, TILE_DOUBLES, check_bytes, count_orders_at_once
from vrte.discrete_ordinates.orders.oriented_flakes import count_orders_together
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.routes import ROUTES
from vrte.discrete_ordinates.orders.single_interface import is_under_one_surface
from vrte.discrete_ordinates.planning.azimuths import Azimuths
from vrte.discrete_ordinates.planning.blocks import Block
from vrte.optics.facet_integrals import DOUBLES_AT_ONCE


def check_memory(problem: Problem, blocks: Sequence[Block], result: float, azimuths: Azimuths, threads: int) -> None:
    """Raises SceneError where the request, with so many doubles of result, needs more memory than there is."""
    needed = BYTES * count_doubles_needed(problem, blocks, result, azimuths, threads)
    check_bytes(needed, "nodes, layers and directions together", "ask for fewer nodes, depths, mu or phi")


def count_doubles_needed(
    problem: Problem, blocks: Sequence[Block], result: float, azimuths: Azimuths, threads: int
) -> float:
    """Doubles at the peak: one block after another, beside what they add up to."""
    sums = threads * (TILE_DOUBLES + 8.0 * problem.columns.shape[0] * azimuths.distinct.size)
    base = 0.0
    if any(block.base.is_uneven for block in blocks):  # its samples for one piece of the result
        base = 4.0 * max(4.0 * result / problem.mu0.size, PIECE_BYTES / BYTES)
    kernels = sum(count_doubles_of_kernels(block) for block in blocks)
    matrices = max((count_doubles_of_block(block, threads) for block in blocks), default=0.0)
    return result + 8.0 * azimuths.angle.size + sums + base + kernels + matrices + count_doubles_of_flakes(problem)


def count_doubles_of_flakes(problem: Problem) -> float:
    """Doubles of the Fourier matrices of flakes as they are made, some orders at a time, and of those remembered."""
    if not any(problem.oriented):
        return 0.0
    made = 3.0 * 2.0 * 16.0 * count_orders_together(problem) * problem.directions.size * problem.nodes.size
    return made + MOST_BYTES / BYTES


def count_doubles_of_kernels(block: Block) -> float:
    """Doubles of what a block finds, twice."""
    problem = block.problem
    return 2.0 * block.orders.size * problem.level.size * problem.n_rhs * problem.rows_out


def count_doubles_of_block(block: Block, threads: int) -> float:
    """Doubles of the matrices of the orders done at once."""
    problem, n_order = block.problem, float(block.orders.size)
    per_order, per_thread = ROUTES[block.choice.name].count_doubles(problem)
    base = 0.0
    if block.base.is_uneven:
        base = n_order * 48.0 * (problem.nodes.size + problem.mu0.size) * (problem.nodes.size + problem.mu_out.size)
    rough = 0 if problem.media is None else sum(not each.is_smooth for each in problem.media.scene.interfaces if each)
    if rough:  # of all orders, four ways, in the frame of facets and in the solver's; integrals on their way
        pairs = float(problem.nodes.size + problem.mu0.size) * (problem.nodes.size + problem.mu_out.size)
        ways = 1.5 if problem.media is not None and is_under_one_surface(problem.media) else 4.0
        base += rough * 1.5 * 16.0 * ways * n_order * pairs + 2.0 * DOUBLES_AT_ONCE
    return min(n_order, count_orders_at_once(per_order, threads)) * per_order + threads * per_thread + base
