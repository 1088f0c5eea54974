"""Small scenes that are alike, solved together by modes: pairs of a scene and an order are the items of each stage."""

import math
from dataclasses import dataclass

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, BoolArray, IntArray, make_readonly, replace_unchecked
from vrte.basics.polarization import FLIP
from vrte.basics.running import Run
from vrte.discrete_ordinates.execution.sums import find_column_kinds
from vrte.discrete_ordinates.orders.base import Base, make_base_operators
from vrte.discrete_ordinates.orders.fused_modes import run_fused_modes
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.routes import Modes, is_quick_on
from vrte.discrete_ordinates.planning.azimuths import Azimuths, compute_cos_sin, fold_azimuths
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
    azimuths, index = fold_azimuths(request.phi), request.wanted.place
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
        add_orders(alike, stokes, wanted, kernels, azimuths, found, run)
    add_once(alike, azimuths, index, found, run)
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
    here = run_fused_modes(problem, orders, slab_stack, make_base(alike, problem), rows, quick, run)
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
    alike: Alike,
    stokes: tuple[int, ...],
    wanted: BoolArray,
    kernels: Array,
    azimuths: Azimuths,
    found: Together,
    run: Run,
) -> None:
    """The sum over Fourier orders: scenes are depths of one result."""
    request = alike.request
    assert request.wanted is not None
    there = np.flatnonzero(wanted.any(axis=1)).astype(np.int32)
    cosine, sine = azimuths.cos_sin(there)
    levels = request.tau.size
    columns = np.array(stokes, np.int32)
    flat = kernels[there].reshape(there.size, -1, *kernels.shape[3:])
    for k, (_, rows) in enumerate(request.wanted.parts):
        with run.timed("fourier sum") as crew:
            run.kernels.azimuthal_sum(
                crew,
                kernels=flat,
                stokes=columns,
                kind=find_column_kinds(request.columns)[columns],
                place=request.wanted.place[columns],
                cosine=cosine,
                sine=sine,
                angle=azimuths.angle,
                sign=azimuths.sign,
                levels=np.arange(k, alike.size * levels, levels, dtype=np.int32),
                rows=rows,
                scale=request.wanted.scale,
                first=0,
                last=request.mu0.size,
                out=found.parts[k],
            )


def add_once(alike: Alike, azimuths: Azimuths, index: IntArray, found: Together, run: Run) -> None:
    """Light scattered once, by the phase matrices of all scenes, a layer at a time."""
    request = alike.request
    assert request.wanted is not None
    cosine, sine = compute_cos_sin(azimuths.distinct)
    for values, (levels, rows) in zip(found.parts, request.wanted.parts, strict=True):
        mu = alike.mu[rows]
        paths = request.wanted.scale[:, None] * alike.integrate_paths(levels, mu, alike.gain)
        for layer, first in enumerate(alike.likeness.shared):
            if first != layer:
                continue
            with run.timed("single scattering") as crew:
                run.kernels.add_single_scattering(
                    crew,
                    table=np.ascontiguousarray(alike.tables[:, layer]).reshape(-1, _core.SERIES),
                    path=np.ascontiguousarray(paths[:, layer]).reshape(-1, *paths.shape[3:]),
                    mu0=request.mu0,
                    mu=mu,
                    cos_phi=cosine,
                    sin_phi=sine,
                    angle=azimuths.angle,
                    sign=azimuths.sign,
                    columns=request.columns,
                    kind=find_column_kinds(request.columns),
                    place=index,
                    first=0,
                    last=request.mu0.size,
                    out=values,
                    slab_stacks=alike.size,
                )


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
