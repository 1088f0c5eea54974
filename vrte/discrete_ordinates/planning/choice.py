"""Which algorithm a block of orders takes: by measured accuracy and time (docs/explanation/accuracy.md)."""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from vrte.basics import cost
from vrte.basics.arrays import Array, BoolArray, IntArray
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.single_interface import is_under_one_surface
from vrte.discrete_ordinates.orders.slabs import list_slabs
from vrte.discrete_ordinates.orders.tanh_poles import FINEST as FINEST_MOMENTS
from vrte.discrete_ordinates.orders.tanh_poles import STEEPEST, STEEPEST_INSIDE, find_depths, find_steepest, place_poles
from vrte.request.how import BY_RULE
from vrte.scene.oriented import polarizes_beams

THIN = 1e-5  # scattering thickness below which fluxes by modes, right to 1e-16 over it, are too inaccurate
ONE_LAYER = 16.0  # thickness over the lowest node cosine from which doubling takes five steps or more
STRONGEST = 0.98  # largest q (scattered fraction) of an order for which invariance iterations converge in time
THICKEST = 4.0  # largest optical thickness of a slab solved by successive scatterings: T is a difference of moments
STEEP_LOSS = 6e-18  # error of light by modes times the square of the lowest node's cosine, at most, with grading 2
SHARE_OF_STEEP = 0.3  # fraction of the requested accuracy that this error of steep nodes may use
FINEST = 1e-13  # smallest requested accuracy for which iterations are used


class Choice(NamedTuple):
    """The route's name and, in a few words, the reason."""

    name: str
    reason: str


def choose_algorithms(
    algorithm: str,
    problem: Problem,
    strength: Array,
    accuracy: float,
    eigensolver: bool = True,
    orders: IntArray | None = None,
    doubling: "DoublingSteps | None" = None,
) -> list[tuple[slice, Choice]]:
    """The route asked for, or for "auto" and "direct" those that the rule takes, each for some of the orders;
    ``strength`` (order,): their q, which falls. ``orders``: their numbers, given over black ground alone; ``doubling``:
    the steps that it would take, where they are counted already.

    Invariance stands for reflection alone: where it does not apply, modes do the orders that were to be done by it, or
    doubling where there is no ``eigensolver``. Plates that let light through are for doubling, or modes that are asked
    for, which lose digits there.
    """
    every = slice(0, strength.size)
    if polarizes_beams(problem.oriented) and algorithm != "modes":
        reason = "auto: plates let light through" if algorithm in BY_RULE else f"{algorithm} is not for plates"
        return [(every, Choice("doubling", "asked for" if algorithm == "doubling" else reason))]
    if not eigensolver:
        return choose_products(algorithm, problem, strength, accuracy)
    if algorithm == "invariance" and not is_top_only(problem):
        reason = "invariance was asked for, and is for the top of one layer that has no end to these orders"
        return [(every, Choice("modes", reason))]
    if algorithm == "invariance":
        first = int(np.count_nonzero(strength > STRONGEST))
        found = [(slice(0, first), Choice("modes", f"orders with q above {STRONGEST:g} are not for invariance"))]
        return (
            found[: first > 0]
            + [(slice(first, strength.size), Choice(algorithm, "asked for"))][: first < strength.size]
        )
    if algorithm not in BY_RULE:
        return [(every, Choice(algorithm, "asked for"))]
    if problem.grading > 1 and is_too_steep(float(problem.nodes[0]), problem.is_scalar, accuracy):
        reason = "auto: modes lose digits along the lowest nodes"
        return [(every, Choice("doubling", reason))]
    first = strength.size
    if algorithm == "auto" and is_top_only(problem) and accuracy >= FINEST:
        operations = count_operations_of_invariance(problem, strength, accuracy)
        fraction = cost.AN_INVARIANCE * operations / count_operations_of_modes(problem)
        first = int(np.count_nonzero((fraction >= 1.0) | (strength > STRONGEST)))
    given = orders if algorithm == "auto" else None
    parts = split_at_scatterings(problem, given, first, accuracy, doubling) if first else []
    if first < strength.size:
        reason = f"auto: only the top is seen; predicted to take {fraction[first]:.2g} of the time of modes and less"
        parts.append((slice(first, strength.size), Choice("invariance", reason)))
    return parts


def is_too_steep(lowest: float, scalar: bool, accuracy: float) -> bool:
    """Whether modes on graded nodes down to this cosine lose too much for an accuracy; of I alone they lose nothing."""
    return not scalar and STEEP_LOSS / lowest**2 > SHARE_OF_STEEP * accuracy


def split_at_scatterings(
    problem: Problem, orders: IntArray | None, count: int, accuracy: float, doubling: "DoublingSteps | None" = None
) -> list[tuple[slice, Choice]]:
    """The first so many orders: successive scatterings from where on they are quicker than eigenproblems, since the
    terms that are left get fewer with every order."""
    other = choose_modes_or_doubling(problem, doubling or count_all_doubling_steps(problem)[0])
    first = count
    if orders is not None and is_for_scatterings(problem, accuracy):
        fraction = count_operations_of_scatterings(problem, orders[:count]) / count_operations_of_modes(problem)
        first = int(np.count_nonzero(fraction >= cost.WORTH_SCATTERINGS))
    parts = [(slice(0, first), other)] if first else []
    if first < count:
        time = f"predicted to take {fraction[first]:.2g} of the time of modes and less"
        reason = f"auto: few terms, few beams, one slab on black; {time}"
        parts.append((slice(first, count), Choice("scatterings", reason)))
    return parts


def choose_products(algorithm: str, problem: Problem, strength: Array, accuracy: float) -> list[tuple[slice, Choice]]:
    """The same without modes: products and inverses alone."""
    first = strength.size
    if algorithm in ("auto", "invariance") and problem.media is None and is_top_only(problem) and accuracy >= FINEST:
        first = int(np.count_nonzero(strength > STRONGEST))
    reason = "asked for" if algorithm == "doubling" else "auto: no eigensolver here"
    parts = [(slice(0, first), Choice("doubling", reason))] if first else []
    if first < strength.size:
        reason = "asked for" if algorithm == "invariance" else "auto: only the top is seen"
        parts.append((slice(first, strength.size), Choice("invariance", reason)))
    return parts


class DoublingSteps(NamedTuple):
    """What doubling would take of a scene: ``steps`` in all distinct slabs, and ``slabs`` that are added, of so many
    ``materials``; thin: where modes lose digits; thick: whether one layer is so thick that nobody needs to count."""

    thin: bool
    thick: bool
    steps: float
    slabs: int
    materials: int


def count_all_doubling_steps(problem: Problem) -> list[DoublingSteps]:
    """Of each scene of a problem, whatever the Stokes parameters."""
    lowest, many = float(problem.directions.min()), ONE_LAYER * float(problem.nodes[0])
    layers, inside, found = problem.layers, problem.level_layer.size > 1 or problem.level.any(), []
    thickness, albedo = problem.thickness.tolist(), problem.albedo.tolist()
    for index in range(problem.scenes):
        first = index * layers
        distinct, slabs, materials = thickness[first : first + layers], 1, 1
        thin = sum([t for t, a in zip(distinct, albedo[first : first + layers], strict=True) if a > 0.0]) < THIN
        thick = layers == 1 and distinct[0] > many
        if layers > 1 or inside or not distinct[0]:  # else one slab
            distinct, slabs, materials = list_slabs(problem.select_scene(index))
        steps = sum([count_doubling_steps(each, lowest) for each in distinct])
        found.append(DoublingSteps(thin, thick, steps, slabs, materials))
    return found


def compare_with_doubling(problem: Problem, doubling: DoublingSteps) -> tuple[bool, float]:
    """Whether doubling is taken in the place of modes, and its predicted time over theirs."""
    sizes = problem.size, problem.rows_out, problem.n_rhs, problem.layers, problem.is_symmetric
    ratio = predict_doubling_time(*sizes, doubling)
    return doubling.thin or (not doubling.thick and ratio < cost.WORTH_DOUBLING), ratio


def choose_modes_or_doubling(problem: Problem, doubling: DoublingSteps) -> Choice:
    """Which of the two is right, and predicted to be faster."""
    if doubling.thin:
        return Choice(
            "doubling", f"auto: what scatters is thinner than {THIN:g}, where modes lose digits of the fluxes"
        )
    if doubling.thick:
        return Choice("modes", "auto: one layer, one eigenproblem")
    doubles, ratio = compare_with_doubling(problem, doubling)
    words = f"auto: doubling is predicted to take {ratio:.2g} times the time of modes"
    return Choice("doubling" if doubles else "modes", words)


def find_scenes_for_modes(
    problem: Problem, doubling: Sequence[DoublingSteps], algorithm: str, accuracy: float
) -> BoolArray:
    """Whether all orders of a scene with a base are solved by modes, (scene,), as `choose_algorithms` has it."""
    if algorithm == "modes":
        return np.ones(problem.scenes, bool)
    if problem.grading > 1 and is_too_steep(float(problem.nodes[0]), problem.is_scalar, accuracy):
        return np.zeros(problem.scenes, bool)
    known = {each: not compare_with_doubling(problem, each)[0] for each in set(doubling)}
    found = np.array([known[each] for each in doubling])
    if algorithm == "auto" and problem.layers == 1 and is_worth_scatterings(problem):
        orders = np.arange(problem.coefficients.shape[1], dtype=np.int32)
        for index in np.flatnonzero(found).tolist():
            parts = split_at_scatterings(problem.select_scene(index), orders, orders.size, accuracy, doubling[index])
            found[index] = all(choice.name != "scatterings" for _, choice in parts)
    return found


def is_top_only(problem: Problem) -> bool:
    """Whether nothing but the light reflected by one semi-infinite layer is asked for, under one surface at most."""
    endless = problem.albedo.size == 1 and math.isinf(problem.thickness[0])
    return endless and not problem.level.any() and (problem.media is None or is_under_one_surface(problem.media))


def count_operations_of_modes(problem: Problem) -> float:
    """Of an order, roughly."""
    n = problem.size
    solving = (cost.MODES_SYMMETRIC if problem.is_symmetric else cost.MODES_GENERAL) * n**3
    return problem.albedo.size * (solving + 4.0 * n * n * (problem.n_rhs + problem.rows_out))


def is_for_scatterings(problem: Problem, accuracy: float) -> bool:
    """Whether light of one slab that is not too thick is asked for, and a scattering of nothing would be quicker."""
    if problem.albedo.size != 1 or problem.media is not None or not problem.is_exact or accuracy < FINEST_MOMENTS:
        return False
    if not is_worth_scatterings(problem) or not 0.0 < float(problem.thickness[0]) <= THICKEST:
        return False
    return find_steepest(problem) <= (STEEPEST_INSIDE if count_depths(problem) else STEEPEST)


def is_worth_scatterings(problem: Problem) -> bool:
    """Whether a scattering of nothing would be quicker than modes of a layer."""
    least = 2.0 * cost.SCATTERINGS * problem.n_rhs * cost.A_SCATTERING
    return least < cost.WORTH_SCATTERINGS * count_operations_of_modes(problem) / problem.scenes


def count_depths(problem: Problem) -> int:
    """Levels inside the one layer."""
    return int(np.count_nonzero(np.abs(find_depths(problem)) < 1.0))


def count_rank_and_poles(problem: Problem, orders: IntArray) -> tuple[Array, float]:
    """Of the scattering that is left of each order, and of the poles up to the steepest direction; roughly."""
    rank = cost.COLUMNS_A_TERM[len(problem.stokes)] * np.clip(problem.terms[0] - orders, 0.0, None)
    steepest = max(find_steepest(problem), 2.0)
    if count_depths(problem):
        return rank, float(place_poles(steepest).size)
    return rank, cost.POLES + cost.POLES_A_FACTOR * math.log2(steepest)


def count_operations_of_scatterings(problem: Problem, orders: IntArray) -> Array:
    """Of each order over black ground, roughly."""
    rank, poles = count_rank_and_poles(problem, orders)
    a_scattering = cost.A_SCATTERING + 4.0 * problem.size * rank * (poles + 1.0)
    found: Array = 2.0 * cost.SCATTERINGS * problem.n_rhs * a_scattering + problem.size * rank**2
    if depths := count_depths(problem):
        rows = problem.size + problem.rows_out
        found += 2.0 * problem.n_rhs * rows * (poles + 1.0) * (2.0 * rank + 4.0 * depths)
    return found


def count_operations_of_invariance(problem: Problem, strength: Array, accuracy: float) -> Array:
    """Of each order, roughly."""
    rank = 2.0 * problem.terms[0]
    rows = problem.size + len(problem.stokes) * problem.off_nodes[0].size
    return 4.0 * rows * problem.size * rank * predict_iterations(strength, accuracy)


def predict_iterations(strength: Array, accuracy: float) -> Array:
    """What accelerated fixed points of the invariance equation need, like those of conjugate gradients."""
    root = np.sqrt(1.0 - np.clip(strength, 1e-3, 1.0 - 1e-6))
    return 3.0 + math.log(accuracy) / np.log((1.0 - root) / (1.0 + root))


def count_doubling_steps(thickness: float, lowest: float) -> float:
    """Of a slab: from a layer that is about as thick as the lowest cosine."""
    return cost.STEPS_ENDLESS if math.isinf(thickness) else math.ceil(math.log2(max(thickness / lowest, 1.0))) + 2.0


@lru_cache(maxsize=256)
def predict_doubling_time(n: int, off: int, n_rhs: int, layers: int, symmetric: bool, doubling: DoublingSteps) -> float:
    """Predicted time of an order by doubling over that by modes, from operations over n^2, of n unknowns of a
    hemisphere and ``off`` rows off the nodes."""
    solving, leaving = (
        (cost.MODES_SYMMETRIC, cost.OFF_SYMMETRIC) if symmetric else (cost.MODES_GENERAL, cost.OFF_GENERAL)
    )
    modes = doubling.materials * solving * float(n) + layers * (cost.BOUNDARY * n + leaving * off)
    doubled = cost.DOUBLING_STEP * doubling.steps * (n + n_rhs + 0.5 * off) + cost.ADDING * doubling.slabs * n
    return doubled / modes
