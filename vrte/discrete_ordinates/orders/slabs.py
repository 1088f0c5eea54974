"""A scene as a stack of homogeneous slabs, cut wherever the field is wanted, and the slabs joined, (2:8)."""

import itertools
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from vrte.basics.arrays import Array, IntArray, record, replace_unchecked
from vrte.basics.errors import AccuracyError
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.base import Base
from vrte.discrete_ordinates.orders.problem import Problem


@record
class Slabs:
    """R, T (order, slab, blocks), see core/doubling.pxi; lost (order, slab, n); residual (order, slab, 2) of
    R and of T; doublings (order, slab)."""

    R: Array
    T: Array
    lost: Array
    residual: Array
    doublings: IntArray


@record
class SlabStack:
    """Which slab lies where; equal slabs are doubled once.

    ``problem``: the distinct materials as its layers, the distinct outgoing cosines as its mu_out; material, thickness
    (slab,); slabs (place,), top first; above (place + 1,): optical depth of the interfaces; interface (n_tau,): where
    the field is wanted; out (n_out,): place of each outgoing direction among the distinct ones.
    """

    problem: Problem
    material: IntArray
    thickness: Array
    slabs: IntArray
    above: Array
    interface: IntArray
    out: IntArray


PILES: WeakKeyDictionary[Problem, SlabStack] = WeakKeyDictionary()  # of problems that are at work


def cut_layers(problem: Problem) -> SlabStack:
    """What `find_slab_stack` finds, once for each problem."""
    found = PILES.get(problem)
    if found is None:
        found = PILES[problem] = find_slab_stack(problem)
    return found


def find_slab_stack(problem: Problem) -> SlabStack:
    """The layers cut at the wanted depths, and which of the slabs are equal."""
    materials, kinds = find_materials(problem)
    found: dict[tuple[int, float, int], int] = {}
    slabs: list[int] = []
    above = [0.0]
    interface = np.zeros(problem.level.size, np.int32)
    for layer, cuts in enumerate(list_cuts(problem)):
        here = problem.level_layer == layer
        interface[here] = len(slabs) + np.searchsorted(cuts, problem.level[here])
        for top, bottom in itertools.pairwise(cuts):
            which = 0 if problem.skip_flags.repeats else len(slabs)
            slabs.append(found.setdefault((int(kinds[layer]), bottom - top, which), len(found)))
        above += [problem.above[layer] + depth for depth in cuts[1:]]
    cosines, out = np.unique(problem.mu_out, return_inverse=True)
    return SlabStack(
        problem=replace_unchecked(select_materials(problem, materials), mu_out=cosines),
        material=np.array([material for material, _, _ in found], np.int32),
        thickness=np.array([thickness for _, thickness, _ in found]),
        slabs=np.array(slabs, np.int32),
        above=np.array(above),
        interface=interface,
        out=out.astype(np.int32),
    )


def list_cuts(problem: Problem) -> list[list[float]]:
    """Depths below the top of each layer between which its slabs lie: its ends, and where the field is wanted."""
    cuts: list[set[float]] = [{0.0, thickness} for thickness in problem.thickness.tolist()]
    for layer, level in zip(problem.level_layer.tolist(), problem.level.tolist(), strict=True):
        cuts[layer].add(level)
    return [sorted(each) for each in cuts]


def list_slabs(problem: Problem) -> tuple[list[float], int, int]:
    """Thickness of each distinct slab that `cut_layers` would find, how many slabs there would be, and materials."""
    kinds = find_materials(problem)[1].tolist()
    every = [
        (kind, bottom - top)
        for kind, cuts in zip(kinds, list_cuts(problem), strict=True)
        for top, bottom in itertools.pairwise(cuts)
    ]
    distinct = dict.fromkeys(every) if problem.skip_flags.repeats else every
    return [thickness for _, thickness in distinct], len(every), len(set(kinds))


def find_materials(problem: Problem) -> tuple[list[int], IntArray]:
    """The first layer of each material, and the material of each layer. What does not scatter is all one material."""
    if not problem.skip_flags.repeats or problem.albedo.size == 1:
        return list(range(problem.albedo.size)), np.arange(problem.albedo.size, dtype=np.int32)
    first: list[int] = []
    kinds = np.empty(problem.albedo.size, np.int32)
    known: dict[tuple[Any, ...], int] = {}
    for layer, (albedo, terms) in enumerate(zip(problem.albedo, problem.terms, strict=True)):
        key = (float(albedo), int(terms), problem.coefficients[layer].tobytes()) if albedo > 0.0 else (0.0, 0, b"")
        one = problem.oriented[layer] if problem.oriented else None
        if one is not None:
            key = (*key, id(one.flakes), one.particles, one.area)
        if key not in known:
            known[key] = len(first)
            first.append(layer)
        kinds[layer] = known[key]
    return first, kinds


def merge_materials(problem: Problem) -> tuple[Problem, IntArray | None]:
    """The problem with its distinct materials as layers, and the material of each layer, None where all differ."""
    if problem.albedo.size == 1:
        return problem, None
    materials, kinds = find_materials(problem)
    return (select_materials(problem, materials), kinds) if len(materials) < kinds.size else (problem, None)


def select_materials(problem: Problem, layers: list[int]) -> Problem:
    """The problem with the materials of some layers; thicknesses and depths stay those of all."""
    return replace_unchecked(
        problem,
        coefficients=np.ascontiguousarray(problem.coefficients[layers]),
        terms=problem.terms[layers],
        albedo=problem.albedo[layers],
        oriented=tuple([problem.oriented[layer] for layer in layers]) if problem.oriented else (),
    )


def join_stack(
    slab_stack: SlabStack, orders: IntArray, slabs: Slabs, base: Base, run: Run
) -> tuple[Array, Array, Array, Array]:
    """The field at the wanted depths: kernels (order, n_tau, n_in, n_col, n_out, S), flux up and down of order 0
    (n_tau, n_in, n_col), and the residual of each order. Raises AccuracyError where a interface is singular."""
    problem = slab_stack.problem
    with run.timed("joining") as crew:
        found = run.kernels.join_slabs(
            crew,
            orders=orders,
            conserving=problem.conserves,
            slabs=slab_stack.slabs,
            above=slab_stack.above,
            nodes=problem.nodes,
            weights=problem.weights,
            mu0=problem.mu0,
            n_out=problem.mu_out.size,
            R=slabs.R,
            T=slabs.T,
            lost=slabs.lost,
            base_row=base.row[orders],
            base=base.matrix,
            base_source=base.source,
            base_out=base.out,
            interface=slab_stack.interface,
        )
    info = found["info"]
    if info.any():
        raise AccuracyError(
            f"two slabs cannot be joined at order {orders[np.argmax(info != 0)]}: the system is singular"
        )
    kernels = find_leaving_light(slab_stack, found["up"], found["down"])
    beams = problem.mu0.size, problem.columns.shape[0]
    fluxes = found["flux"][0].reshape(-1, 2, *beams)
    return kernels, fluxes[:, 0], fluxes[:, 1], np.max(found["residual"], axis=1, initial=0.0)


def find_leaving_light(slab_stack: SlabStack, up: Array, down: Array) -> Array:
    """Radiance in the public frame, (order, n_tau, n_in, n_col, n_out, S), of light from the interfaces, (order,
    n_tau, n_rhs, S n_out)."""
    problem, n_up = slab_stack.problem, slab_stack.problem.n_up
    shape = *up.shape[:2], problem.mu0.size, problem.columns.shape[0], problem.mu_out.size, len(problem.stokes)
    rising = up.reshape(shape)[..., slab_stack.out[:n_up], :] * problem.flip
    kernels = np.concatenate([rising, down.reshape(shape)[..., slab_stack.out[n_up:], :]], axis=-2)
    kernels /= 2.0 * np.pi
    return kernels
