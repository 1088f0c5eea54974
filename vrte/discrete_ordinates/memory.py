"""How much memory a request takes, said before it starts."""

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vrte import _core
from vrte.discrete_ordinates.azimuths import Azimuths
from vrte.discrete_ordinates.blocks import Block
from vrte.discrete_ordinates.problem import Problem
from vrte.discrete_ordinates.slabs import Pile, cut, materials_of
from vrte.errors import SceneError
from vrte.scene import MuellerBase

BYTES = 8
CHUNK_BYTES = 48e6  # meant for the matrices of the orders done at once
PIECE_BYTES = 16e6  # of the result at a time: it stays in the cache, and a progress bar moves
TILE_DOUBLES = 32768  # of a thread at the end, more where one direction's azimuths take more
ALWAYS_THERE = 32e6  # less than what the interpreter has taken already
LARGEST_SHARE = 0.9  # of what is available
FILES = (  # what a control group may use, and what it uses: version 2, version 1
    ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current"),
    ("/sys/fs/cgroup/memory/memory.limit_in_bytes", "/sys/fs/cgroup/memory/memory.usage_in_bytes"),
)


def check_memory(problem: Problem, blocks: Sequence[Block], result: float, azimuths: Azimuths, threads: int) -> None:
    """Raises SceneError where the request, with so many doubles of result, needs more memory than there is."""
    needed = BYTES * doubles_needed(problem, blocks, result, azimuths, threads)
    if needed < ALWAYS_THERE:  # asking the system takes as long as a small solve
        return
    available = available_bytes()
    if needed > LARGEST_SHARE * available:
        raise SceneError(
            f"nodes, layers and directions together need about {in_gigabytes(needed)} of memory and "
            f"{in_gigabytes(available)} are available: ask for fewer nodes, depths, mu or phi"
        )


def doubles_needed(problem: Problem, blocks: Sequence[Block], result: float, azimuths: Azimuths, threads: int) -> float:
    """Doubles at the peak: one block after another, beside what they add up to."""
    sums = threads * (TILE_DOUBLES + 8.0 * problem.columns.shape[0] * azimuths.distinct.size)
    base = 0.0
    if any(isinstance(block.base, MuellerBase) for block in blocks):  # its samples for one piece of the result
        base = 4.0 * max(4.0 * result / problem.mu0.size, PIECE_BYTES / BYTES)
    kernels = sum(doubles_of_kernels(block) for block in blocks)
    matrices = max((doubles_of_block(block, threads) for block in blocks), default=0.0)
    return result + 8.0 * azimuths.angle.size + sums + base + kernels + matrices


def doubles_of_kernels(block: Block) -> float:
    """Doubles of what a block finds, twice."""
    problem = block.problem
    return 2.0 * block.orders.size * problem.level.size * problem.n_rhs * problem.rows_out


def doubles_of_block(block: Block, threads: int) -> float:
    """Doubles of the matrices of the orders done at once."""
    problem, n_order = block.problem, float(block.orders.size)
    per_order, per_thread = doubles_of_route(block.choice.name, problem)
    base = 0.0
    if isinstance(block.base, MuellerBase):
        base = n_order * 48.0 * (problem.nodes.size + problem.mu0.size) * (problem.nodes.size + problem.mu_out.size)
    return min(n_order, orders_at_once(per_order, threads)) * per_order + threads * per_thread + base


def doubles_of_route(name: str, problem: Problem) -> tuple[float, float]:
    """Doubles of an order's arrays, and of a thread's scratch memory."""
    if name == "doubling":
        return doubles_of_doubling(cut(problem))
    return doubles_of_invariance(problem) if name == "invariance" else doubles_of_modes(problem)


def doubles_of_invariance(problem: Problem) -> tuple[float, float]:
    """Doubles of an order's arrays, and of a thread's scratch memory, by invariance."""
    directions = np.union1d(problem.mu_out, problem.mu0)
    work = _core.invariance_work(problem.nodes.size, directions.size, len(problem.stokes), int(problem.terms.max()))
    return float(problem.n_rhs * (problem.rows_out + problem.size)), float(work)


def doubles_of_modes(problem: Problem) -> tuple[float, float]:
    """Doubles of an order's arrays, and of a thread's scratch memory, by modes."""
    n, n_layer, n_rhs = problem.size, problem.albedo.size, problem.n_rhs
    out, into = problem.rows_out, len(problem.stokes) * problem.mu0.size
    materials, kinds = materials_of(problem)
    per_order = float(materials.albedo.size) * n * (5 * n + 2 * out + 2 * into + 2 * n_rhs)
    per_order += n_layer * n * (2.0 * n_rhs if kinds is None else 2.0 * n + 2.0 * out + 4.0 * n_rhs)
    scratch = (
        _core.assembly_work(problem.directions.size, problem.coefficients.shape[1], len(problem.stokes)),
        _core.homogeneous_work(n),
        _core.boundary_work(n, n_layer, n_rhs),
        _core.reconstruction_work(n, problem.rows_out, n_rhs, n_layer),
    )
    return per_order, float(max(scratch))


def doubles_of_doubling(pile: Pile) -> tuple[float, float]:
    """Doubles of an order's arrays, and of a thread's scratch memory, by impedance doubling."""
    problem = pile.problem
    n, n_rhs, out, into = problem.size, problem.n_rhs, problem.rows_out, len(problem.stokes) * problem.mu0.size
    per_order = (
        2.0 * problem.albedo.size * n * (n + out + into)
        + 2.0 * max(1, pile.material.size) * _core.extended_size(n, n_rhs, out)
        + 2.0 * pile.interface.size * n_rhs * out
    )
    scratch = (
        _core.assembly_work(problem.directions.size, problem.coefficients.shape[1], len(problem.stokes)),
        _core.doubling_work(n, n_rhs, out),
        _core.joining_work(n, pile.slabs.size, n_rhs, out),
    )
    return per_order, float(max(scratch))


def orders_at_once(per_order: float, threads: int) -> int:
    """Orders whose matrices fit the memory meant for them, at least one a thread."""
    return max(threads, int(CHUNK_BYTES / (BYTES * per_order)))


def available_bytes() -> float:
    """What this process may still take: of the machine's free memory, of its control group's, and of its own limit."""
    free = [machine_bytes(), address_bytes()]
    for limit, used in FILES:
        try:
            free.append(float(Path(limit).read_text()) - float(Path(used).read_text()))
        except (OSError, ValueError):  # no such file, or "max"
            continue
    return max(0.0, min(free))


def address_bytes() -> float:
    """What `ulimit -v` leaves, infinite without it."""
    try:
        import resource  # on Unix only

        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        if limit == resource.RLIM_INFINITY:
            return float("inf")
        return limit - resource.getpagesize() * float(Path("/proc/self/statm").read_text().split()[0])
    except (ImportError, OSError, ValueError):
        return float("inf")


def machine_bytes() -> float:
    """Memory of the machine that can be had, infinite where it does not tell."""
    try:
        lines = dict(line.split(":", 1) for line in Path("/proc/meminfo").read_text().splitlines())
        return 1024.0 * float(lines["MemAvailable"].split()[0])
    except (OSError, KeyError, ValueError):
        pass
    try:
        return float(os.sysconf("SC_PAGE_SIZE")) * float(os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, OSError, ValueError):
        return float("inf")


def in_gigabytes(size: float) -> str:
    """Three digits."""
    return f"{size / 1e9:.3g} GB"
