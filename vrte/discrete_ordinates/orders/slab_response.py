"""What a slab of one material does to all light: its reflection and transmission on the nodes, and from and to
directions off them, by each of the exact routes.

Scaled by sqrt(weight mu) on the nodes and flipped, light going up has U and V turned over: a homogeneous slab then does
the same to light from above and from below.
"""

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, IntArray
from vrte.basics.polarization import FLIP
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.base import make_black_base
from vrte.discrete_ordinates.orders.boundary import solve_boundary
from vrte.discrete_ordinates.orders.doubling import double_slabs
from vrte.discrete_ordinates.orders.homogeneous import Modes, find_modes
from vrte.discrete_ordinates.orders.invariance import reflect_semi_infinite
from vrte.discrete_ordinates.orders.particular import Beam, find_beam_field
from vrte.discrete_ordinates.orders.phase_assembly import Assembled, assemble, find_even_shifts
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.reconstruction import reconstruct
from vrte.discrete_ordinates.orders.single_scattering import integrate_slab_paths

INVARIANCE = 1e-13  # convergence limit of the iterations: surfaces amplify what error is left


@dataclass(frozen=True, eq=False)
class Response:
    """R and T of a slab, each (order, ...): nodes (order, 2, n, n) from the scaled field on the nodes; entering (order,
    2, n, n_in, S) from a beam of unit flux; leaving (order, 2, n_out, S, n) into directions off the nodes, radiance
    times 2 pi; passing (order, 2, n_out, S, n_in, S), what is scattered once left out. residuals by name, (order,)."""

    nodes: Array
    entering: Array
    leaving: Array
    passing: Array
    residuals: dict[str, Array]


def respond(
    name: str, problem: Problem, material: IntArray, thickness: Array, orders: IntArray, run: Run, quick: bool
) -> list[Response]:
    """Of slabs (slab,) of the problem's layers, taken as materials, with unit Stokes vectors as its columns; its mu_out
    are seen from above and from below."""
    if name == "doubling":
        return respond_by_doubling(problem, material, thickness, orders, run)
    return respond_by_beams(name, problem, material, thickness, orders, run, quick)


def respond_by_doubling(
    problem: Problem, material: IntArray, thickness: Array, orders: IntArray, run: Run
) -> list[Response]:
    """By impedance doubling, whose matrices have all of it."""
    matrices = assemble(problem, orders, run)
    slabs = double_slabs(problem, material, thickness, orders, matrices, run)
    n, r, o = problem.size, problem.n_rhs, problem.rows_out
    ends = np.cumsum([n * n, r * n, n * o, r * o])
    turned = problem.conserves and orders[0] == 0
    axis = make_flux_axis(problem) if turned else np.zeros(n)
    found = []
    for slab in range(material.size):
        both = np.stack([slabs.R[:, slab], slabs.T[:, slab]], axis=1)
        nodes, entering, leaving, passing = np.split(both[..., : ends[-1]], ends[:-1], axis=-1)
        nodes = nodes.reshape(-1, 2, n, n).swapaxes(-1, -2)
        entering = entering.reshape(-1, 2, r, n).swapaxes(-1, -2)
        leaving = leaving.reshape(-1, 2, n, o).swapaxes(-1, -2)
        passing = passing.reshape(-1, 2, r, o).swapaxes(-1, -2)
        if turned:  # order 0 back from the frame in which one axis carries the flux
            nodes[0] -= 2.0 * axis[:, None] * (axis @ nodes[0])[:, None]
            nodes[0] -= 2.0 * (nodes[0] @ axis)[..., None] * axis
            entering[0] -= 2.0 * axis[:, None] * (axis @ entering[0])[:, None]
            leaving[0] -= 2.0 * (leaving[0] @ axis)[..., None] * axis
        residuals = {
            "residual_of_reflection": slabs.residual[:, slab, 0],
            "residual_of_transmission": slabs.residual[:, slab, 1],
        }
        found.append(shape_response(problem, nodes, entering, leaving, passing, residuals))
    return found


def make_flux_axis(problem: Problem) -> Array:
    """The unit vector whose reflection turns the flux to one axis, see core/flux.pxi: (n,)."""
    v = np.zeros(problem.size)
    v[:: len(problem.stokes)] = np.sqrt(problem.weights * problem.nodes)
    v[problem.size - len(problem.stokes)] += np.linalg.norm(v)
    return v / np.linalg.norm(v)


def shape_response(
    problem: Problem, nodes: Array, entering: Array, leaving: Array, passing: Array, residuals: dict[str, Array]
) -> Response:
    """With directions and Stokes parameters apart: entering (order, 2, n, r), leaving (order, 2, o, n), passing (order,
    2, o, r)."""
    stokes, into, out = len(problem.stokes), problem.mu0.size, problem.mu_out.size
    n = problem.size
    return Response(
        nodes,
        entering.reshape(-1, 2, n, into, stokes),
        leaving.reshape(-1, 2, out, stokes, n),
        passing.reshape(-1, 2, out, stokes, into, stokes),
        residuals,
    )


def respond_by_beams(
    name: str, problem: Problem, material: IntArray, thickness: Array, orders: IntArray, run: Run, quick: bool
) -> list[Response]:
    """By modes or invariance: light on a node is a beam along it, of the flux 2 pi weight times its radiance."""
    n_in, n_out = problem.mu0.size, problem.mu_out.size
    both = np.concatenate([problem.mu_out, problem.nodes])
    wide = replace(
        problem,
        mu0=np.concatenate([problem.mu0, problem.nodes]),
        mu_out=np.concatenate([both, both]),
        n_up=both.size,
        skip_flags=replace(problem.skip_flags, base=True),
    )
    kernels, residuals = (
        find_semi_infinite_responses(wide, orders, run)
        if name == "invariance"
        else find_slab_responses(wide, material, thickness, orders, run, quick)
    )
    members, stokes = list(problem.stokes), len(problem.stokes)
    scale = np.sqrt(problem.weights * problem.nodes)
    per_node = np.sqrt(problem.weights / problem.nodes)
    shifts = find_even_shifts(problem, int(problem.terms.max()))
    found = []
    for slab, (kind, length) in enumerate(zip(material.tolist(), thickness.tolist(), strict=True)):
        # (order, 2, in, S, out, S) -> (order, 2, out, S, in, S)
        light = 2.0 * np.pi * kernels[slab].transpose(0, 1, 4, 5, 2, 3)
        paths = problem.albedo[kind] * integrate_slab_paths(length, wide.mu0, both)
        with run.timed("single scattering"):
            for index, order in enumerate(orders.tolist()):
                once = scatter_once(order, problem.coefficients[kind, : problem.terms[kind]], both, wide.mu0, shifts)
                once = once[..., members, :][..., members].transpose(0, 1, 3, 2, 4)  # (2, out, S, in, S)
                once = once * (0.5 * paths[:, :, None, :, None])
                light[index, :, n_out:] += once[:, n_out:]
                light[index, :, :n_out, :, n_in:] += once[:, :n_out, :, n_in:]
        light[..., n_in:, :] *= per_node[:, None]
        light[:, :, n_out:] *= scale[:, None, None, None]
        nodes = light[:, :, n_out:, :, n_in:].reshape(orders.size, 2, problem.size, problem.size)
        decay = np.repeat(np.exp(-length / problem.nodes), stokes)
        nodes[:, 1, np.arange(problem.size), np.arange(problem.size)] += decay
        found.append(
            shape_response(
                problem,
                nodes,
                light[:, :, n_out:, :, :n_in],
                light[:, :, :n_out, :, n_in:],
                light[:, :, :n_out, :, :n_in],
                {key: values[:, slab] for key, values in residuals.items()},
            )
        )
    return found


def find_slab_responses(
    problem: Problem, material: IntArray, thickness: Array, orders: IntArray, run: Run, quick: bool
) -> tuple[list[Array], dict[str, Array]]:
    """Light scattered more than once by slabs, up from the top and down from the bottom, by modes: (order, 2, n_in, S,
    n_out, S) of each, flipped."""
    matrices = assemble(problem, orders, run)
    modes = find_modes(problem, orders, matrices, run, quick)
    beam = find_beam_field(problem, matrices, modes, run)
    half, found = problem.n_up, []
    by_modes = np.empty((orders.size, material.size))
    by_boundary = np.empty((orders.size, material.size))
    for slab, (kind, length) in enumerate(zip(material.tolist(), thickness.tolist(), strict=True)):
        this = slice(kind, kind + 1)
        finite = bool(np.isfinite(length))
        one = replace(
            problem,
            coefficients=np.ascontiguousarray(problem.coefficients[this]),
            terms=problem.terms[this],
            albedo=problem.albedo[this],
            thickness=np.array([length]),
            above=np.zeros(1),
            level=np.array([0.0, length])[: 1 + finite],
            level_layer=np.zeros(1 + finite, np.int32),
        )
        own_matrices, own_modes, own_beam = take_layer(matrices, kind), take_layer(modes, kind), take_layer(beam, kind)
        base = make_black_base(one, int(orders[-1]) + 1)
        amplitudes = solve_boundary(one, orders, own_modes, own_beam, base, run)
        kernels = reconstruct(one, orders, own_matrices, own_modes, own_beam, amplitudes, base, run)
        kernels[..., :half, :] *= problem.flip
        pair = np.zeros((orders.size, 2, *kernels.shape[2:4], half, kernels.shape[5]))
        pair[:, 0] = kernels[:, 0, :, :, :half]
        if finite:
            pair[:, 1] = kernels[:, 1, :, :, half:]
        found.append(pair)
        by_modes[:, slab], by_boundary[:, slab] = modes.residual[:, kind], amplitudes.residual[:, 0]
    return found, {"residual_of_modes": by_modes, "residual_of_boundary": by_boundary}


Found = TypeVar("Found", Assembled, Modes, Beam)


def take_layer(found: Found, layer: int) -> Found:
    """What was found for one of the layers, (order, 1, ...)."""
    parts = (np.ascontiguousarray(values[:, layer : layer + 1]) for values in vars(found).values())
    return type(found)(*parts)


def find_semi_infinite_responses(problem: Problem, orders: IntArray, run: Run) -> tuple[list[Array], dict[str, Array]]:
    """The same of the first layer, taken as semi-infinite, by invariance."""
    found = reflect_semi_infinite(problem, orders, INVARIANCE, run)
    half = problem.n_up
    up = found.kernels[:, 0, :, :, :half] * problem.flip
    return [np.stack([up, np.zeros_like(up)], axis=1)], {"residual_of_invariance": found.residual[:, None]}


def scatter_once(order: int, coefficients: Array, mu_out: Array, mu_in: Array, shifts: Array) -> Array:
    """A^m into light going up (flipped) and down from light going down, (2, n_out, n_in, 4, 4), times 1; ``shifts``
    (term, 2): what order 0's functions of even degree are multiplied with and lessened by, see `find_even_shifts`."""
    terms = coefficients.shape[0]
    if order >= terms:
        return np.zeros((2, mu_out.size, mu_in.size, 4, 4))
    functions = [
        _core.generalized_spherical_functions(order, terms, cosines)[order:] for cosines in (-mu_out, mu_out, mu_in)
    ]
    up, down, into = (_core.legendre_matrices(table) for table in functions)
    if order == 0:
        for matrices in (up, down, into):  # I alone: V has the same functions, and no flux
            matrices[:, :, 0, 0] = shifts[:terms, :1] * matrices[:, :, 0, 0] - shifts[:terms, 1:]
    a1, a2, a3, a4, b1, b2 = coefficients[order:].T
    middle = np.zeros((terms - order, 4, 4))
    middle[:, 0, 0], middle[:, 1, 1], middle[:, 2, 2], middle[:, 3, 3] = a1, a2, a3, a4
    middle[:, 0, 1] = middle[:, 1, 0] = -b1
    middle[:, 2, 3], middle[:, 3, 2] = -b2, b2
    right = into.transpose(0, 2, 1, 3).reshape(-1, 4 * mu_in.size)
    found = np.empty((2, mu_out.size, mu_in.size, 4, 4))
    for way, left in enumerate((up, down)):
        rows = np.matmul(left, middle[:, None]).transpose(1, 2, 0, 3).reshape(4 * mu_out.size, -1)
        found[way] = (rows @ right).reshape(mu_out.size, 4, mu_in.size, 4).transpose(0, 2, 1, 3)
    found[0] *= FLIP[:, None]
    return found
