"""Small scenes that are alike, solved together by modes: pairs of a scene and an order are the items of each stage."""

import math
from dataclasses import dataclass

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, BoolArray, IntArray, make_readonly, replace_unchecked
from vrte.basics.polarization import FLIP
from vrte.basics.running import Run
from vrte.discrete_ordinates.execution.engines.cpu import PROCESSOR
from vrte.discrete_ordinates.execution.sums import Light, Part, Share, Target, prepare_closed_form
from vrte.discrete_ordinates.orders.base import Base, make_base_operators
from vrte.discrete_ordinates.orders.fused_modes import run_fused_modes
from vrte.discrete_ordinates.orders.modes import Modes, is_quick_on
from vrte.discrete_ordinates.orders.problem import ALL, Problem
from vrte.discrete_ordinates.planning.azimuths import fold_azimuths
from vrte.discrete_ordinates.planning.batch_plan import Alike, make_frame


@dataclass(frozen=True, eq=False)
class Together:
    """What was found: Mueller matrices (scene, n_in, n_out, n_phi, 4, 4) of what comes back and, where that is asked
    for, gets through; flux (scene, n_in) that comes back of unpolarized light; residuals (scene,) by name; right
    (scene,): where all of these are small and numbers; orders, unknowns (scene,): how many were solved."""

    parts: list[Array]
    flux: Array
    residuals: dict[str, Array]
    right: BoolArray
    orders: IntArray
    unknowns: IntArray


def solve_together(alike: Alike, run: Run) -> Together:
    """All orders of all scenes, added up."""
    request, count = alike.request, alike.size
    assert request.wanted is not None
    azimuths, nowhere = fold_azimuths(request.phi), np.zeros(alike.mu.size, bool)
    target = Target(request.wanted, alike.scenes[0], make_frame(alike, ALL), alike.mu, azimuths, nowhere)
    n_mu, n_in = alike.mu.size // request.tau.size, request.mu0.size
    parts = [np.zeros((count, n_in, n_mu, request.phi.size, 4, 4)) for _ in request.wanted.parts]
    found = Together(
        parts,
        np.zeros((count, n_in)),
        {name: np.zeros(count) for name in sorted(Modes.allowed)},
        np.ones(count, bool),
        np.zeros(count, np.int32),
        np.zeros(count, np.int32),
    )
    for stokes, wanted in alike.wanted.items():
        kernels = solve_stokes(alike, stokes, wanted, found, run)
        add_orders(target, stokes, wanted, kernels, found, run)
    add_once(alike, target, found, run)
    add_base(alike, found)
    for name, values in found.residuals.items():
        found.right[:] &= values <= Modes.allowed[name]  # not where it is no number
    for values in (*parts, found.flux):
        found.right[:] &= np.isfinite(values.reshape(count, -1).sum(axis=1))
        make_readonly(values)
    return found


def solve_stokes(alike: Alike, stokes: tuple[int, ...], wanted: BoolArray, found: Together, run: Run) -> Array:
    """Radiance of the orders ``wanted`` (order, scene) for unit beams, (order, scene, n_tau, n_in, n_col, n_out, S),
    public frame, 0 for others; fluxes, residuals and numbers go to what is ``found``."""
    names = "terms", "albedo", "thickness", "above", "level"  # those of all scenes, one behind the other
    all_layers = {name: getattr(alike, name).ravel() for name in names}
    coefficients = alike.coefficients.reshape(-1, *alike.coefficients.shape[2:])
    problem = replace_unchecked(make_frame(alike, stokes), coefficients=coefficients, **all_layers)
    orders, slab_stack = (each.astype(np.int32) for each in np.nonzero(wanted))
    seen = (orders == 0) & (alike.even[slab_stack] > 0.0) & problem.conserves
    rows = np.where(seen, slab_stack, -1).astype(np.int32)
    quick = is_quick_on(alike.nodes.size, alike.request.accuracy)
    alone = np.arange(alike.albedo.shape[1], dtype=np.int32)
    here = run_fused_modes(problem, orders, slab_stack, make_base(alike, problem), rows, quick, run, alone)
    for name, residual in zip(("residual_of_modes", "residual_of_boundary"), here.residual, strict=True):
        np.maximum.at(found.residuals[name], slab_stack, residual.max(axis=1))
    found.right[slab_stack[here.missed[:, 0] != 0]] = False
    if problem.conserves:
        lit = orders == 0
        found.flux[slab_stack[lit]] = here.flux[lit, 0, 0, :, 0]
    np.maximum.at(found.orders, slab_stack, orders + 1)
    np.add.at(found.unknowns, slab_stack, problem.size)
    kernels = np.zeros((*wanted.shape, *here.radiance.shape[1:]))
    kernels[orders, slab_stack] = here.radiance
    return kernels


def make_base(alike: Alike, problem: Problem) -> Base:
    """What each scene's even base does in order 0, a row each; one row where nothing comes back."""
    seen = problem.conserves and alike.even.any()
    into, out = alike.nodes.size + problem.mu0.size, alike.nodes.size + problem.mu_out.size
    orders = np.zeros((alike.size if seen else 1, into, out, len(problem.stokes), len(problem.stokes)))
    if seen:
        orders[..., 0, 0] = FLIP[0] * (2.0 * alike.even[:, None, None])
    return Base(np.zeros(0, np.int32), *make_base_operators(problem, orders))


def add_orders(
    target: Target, stokes: tuple[int, ...], wanted: BoolArray, kernels: Array, found: Together, run: Run
) -> None:
    """The sum over Fourier orders: scenes are depths of one result."""
    there, columns = np.flatnonzero(wanted.any(axis=1)).astype(np.int32), np.array(stokes, np.int32)
    light = Light(there, columns, columns, kernels[there].reshape(there.size, -1, *kernels.shape[3:]))
    add, levels = PROCESSOR.prepare_orders(target, [light], run), len(found.parts)
    for k, (_, rows) in enumerate(target.wanted.parts):
        depths = np.arange(k, light.kernels.shape[1], levels, dtype=np.int32)
        own = Part(depths, rows, target.mu[rows], target.spreads[rows], found.parts[k])
        add(Share(own, 0, target.problem.mu0.size))


def add_once(alike: Alike, target: Target, found: Together, run: Run) -> None:
    """Light scattered once, by the phase matrices of all scenes, a layer at a time."""
    add, mu0 = prepare_closed_form(target, run), target.problem.mu0
    for values, (levels, rows) in zip(found.parts, target.wanted.parts, strict=True):
        paths = target.wanted.scale[:, None] * alike.integrate_paths(levels, target.mu[rows], alike.gain)
        for layer, first in enumerate(alike.likeness.shared):
            if first == layer:
                table = np.ascontiguousarray(alike.tables[:, layer]).reshape(-1, _core.SERIES)
                path = np.ascontiguousarray(paths[:, layer]).reshape(-1, *paths.shape[3:])
                seen = mu0, target.mu[rows], 0, mu0.size
                add("single scattering", table, path, *seen, values, slab_stacks=alike.size)


def add_base(alike: Alike, found: Together) -> None:
    """The beam that an even base sends up, decaying on both ways: see `add_base_reflected`."""
    request = alike.request
    assert request.wanted is not None
    if not alike.even.any():
        return
    mu = alike.mu[: found.parts[0].shape[2]]
    total = (alike.above[:, -1] + alike.thickness[:, -1])[:, None]
    left = np.array([row[0] + math.fsum(row[1:]) for row in alike.thickness.tolist()])
    strength = request.wanted.scale * request.mu0 * np.exp(-total / request.mu0)
    decay = strength[..., None] * np.exp(-left[:, None, None] / mu)
    light = decay * (alike.even / np.pi)[:, None, None]
    found.parts[0][..., 0, 0] += light[..., None]
