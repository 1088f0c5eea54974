"""Small scenes that are alike, solved together by modes: pairs of a scene and an order are the items of each stage."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, BoolArray, IntArray, make_readonly
from vrte.basics.polarization import FLIP
from vrte.basics.running import Run
from vrte.discrete_ordinates.execution.sums import find_column_kinds
from vrte.discrete_ordinates.orders.base import make_base_operators
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
    problem, layers = make_frame(alike, stokes), alike.likeness.layers
    orders, slab_stack = (each.astype(np.int32) for each in np.nonzero(wanted))
    shape, n, rhs = (orders.size, layers), problem.size, problem.n_rhs
    rows, into = problem.rows_out, len(stokes) * problem.mu0.size
    albedo, thickness, above = alike.albedo.ravel(), alike.thickness.ravel(), alike.above.ravel()
    E, F, X, Y, X_lu = (np.empty((*shape, n, n)) for _ in range(5))
    G_E, G_F = (np.empty((*shape, n, rows)) for _ in range(2))
    source_s, source_d = (np.empty((*shape, into, n)) for _ in range(2))
    with run.timed("assembly") as crew:
        run.kernels.assemble(
            crew,
            orders=orders,
            members=np.array(stokes, np.int32),
            coefficients=alike.coefficients.reshape(-1, *alike.coefficients.shape[2:]),
            terms=alike.terms.ravel(),
            albedo=albedo,
            directions=problem.directions,
            weights=problem.weights,
            n_out=problem.mu_out.size,
            E=E,
            F=F,
            G_E=G_E,
            G_F=G_F,
            source_s=source_s,
            source_d=source_d,
            slab_stack=slab_stack,
        )
    lam_re, lam_im = np.empty((*shape, n)), np.empty((*shape, n))
    pivots, info = np.empty((*shape, n), np.int32), np.zeros(shape, np.int32)
    residual = np.zeros(shape)
    with run.timed("homogeneous") as crew:
        run.kernels.homogeneous(
            crew,
            orders=orders,
            conserving=problem.conserves,
            quick=is_quick_on(alike.nodes.size, alike.request.accuracy),
            clear=True,
            albedo=albedo,
            directions=problem.nodes,
            weights=problem.weights,
            E=E,
            F=F,
            lam_re=lam_re,
            lam_im=lam_im,
            X=X,
            Y=Y,
            X_lu=X_lu,
            X_pivots=pivots,
            residual=residual,
            info=info,
            slab_stack=slab_stack,
        )
    note_residuals(found, "residual_of_modes", slab_stack, residual, (info != 0).any(axis=1))
    c, zeta, even, odd = (np.empty((*shape, rhs, n)) for _ in range(4))
    modes: dict[str, Any] = {"lam_re": lam_re, "lam_im": lam_im, "X": X, "Y": Y}
    with run.timed("particular") as crew:
        run.kernels.particular(
            crew,
            F=F,
            source_s=source_s,
            source_d=source_d,
            mu0=problem.mu0,
            columns=problem.columns,
            X_lu=X_lu,
            X_pivots=pivots,
            c=c,
            zeta=zeta,
            **modes,
        )
    matrix, source, leaving = make_bases(alike, problem)
    base_row = np.where((orders == 0) & (alike.even[slab_stack] > 0.0) & problem.conserves, slab_stack, -1).astype(
        np.int32
    )
    down, decaying = np.empty((orders.size, rhs, n)), np.empty(shape, np.int32)
    residual, singular = np.zeros(shape), np.zeros(orders.size, np.int32)
    with run.timed("boundary") as crew:
        run.kernels.boundary(
            crew,
            c=c,
            zeta=zeta,
            clear=(albedo == 0.0).astype(np.int32),
            thickness=thickness,
            mu0=problem.mu0,
            above=above,
            base_row=base_row,
            base=matrix,
            base_source=source,
            top=np.zeros((0, 1, 1)),
            even=even,
            odd=odd,
            base_down=down,
            decaying=decaying,
            residual=residual,
            info=singular,
            slab_stack=slab_stack,
            **modes,
        )
    note_residuals(found, "residual_of_boundary", slab_stack, residual, singular != 0)
    out = np.empty((orders.size, problem.level.size, rhs, rows))
    with run.timed("reconstruction") as crew:
        run.kernels.reconstruct(
            crew,
            G_E=G_E,
            G_F=G_F,
            c=c,
            zeta=zeta,
            even=even,
            odd=odd,
            base_down=down,
            decaying=decaying,
            base_row=base_row,
            base_out=leaving,
            thickness=thickness,
            above=above,
            mu0=problem.mu0,
            mu_out=problem.mu_out,
            n_up=problem.n_up,
            level=alike.level.ravel(),
            level_layer=alike.level_layer,
            out=out,
            slab_stack=slab_stack,
            **modes,
        )
    lit = np.flatnonzero(orders == 0) if problem.conserves else orders[:0]
    if lit.size:
        coordinates = _core.mode_coordinates_of_stacks(
            lam_re=lam_re[lit, 0],
            lam_im=lam_im[lit, 0],
            even=even[lit, 0],
            odd=odd[lit, 0],
            c=c[lit, 0],
            zeta=zeta[lit, 0],
            mu0=problem.mu0,
            decaying=decaying[lit, 0],
            thickness=alike.thickness[slab_stack[lit], 0],
            above=np.zeros(lit.size),
            depth=np.zeros(lit.size),
        )
        add_flux(problem, coordinates, X[lit, 0], Y[lit, 0], slab_stack[lit], found)
    np.maximum.at(found.orders, slab_stack, orders + 1)
    np.add.at(found.unknowns, slab_stack, n)
    kernels = np.zeros((*wanted.shape, problem.level.size, problem.mu0.size, rhs // problem.mu0.size, rows))
    kernels[orders, slab_stack] = out.reshape(orders.size, *kernels.shape[2:])
    kernels = kernels.reshape(*kernels.shape[:-1], problem.mu_out.size, len(stokes))
    kernels[..., : problem.n_up, :] *= problem.flip
    kernels /= 2.0 * np.pi
    return kernels


def note_residuals(found: Together, name: str, slab_stack: IntArray, residual: Array, failed: BoolArray) -> None:
    """Keeps the largest of each scene; what ``failed`` (item,) leaves none."""
    np.maximum.at(found.residuals[name], slab_stack, residual.max(axis=1))
    found.right[slab_stack[failed]] = False


def add_flux(problem: Problem, coordinates: Array, X: Array, Y: Array, slab_stack: IntArray, found: Together) -> None:
    """The flux that leaves the top: see `find_nodal_fluxes`; coordinates (item, 2, n_rhs, n), X, Y (item, n, n)."""
    weight, step = 0.5 * np.sqrt(problem.weights * problem.nodes), len(problem.stokes)
    total, difference = (
        (coordinates[:, k] @ (modes[..., ::step] @ weight)[..., None])[..., 0] for k, modes in enumerate((X, Y))
    )
    found.flux[slab_stack] = (total - difference).reshape(slab_stack.size, problem.mu0.size, -1)[..., 0]


def make_bases(alike: Alike, problem: Problem) -> tuple[Array, Array, Array]:
    """What each scene's even base does in order 0, as `Base` has it of each order; one row where nothing comes back."""
    seen = problem.conserves and alike.even.any()
    into, out = alike.nodes.size + problem.mu0.size, alike.nodes.size + problem.mu_out.size
    orders = np.zeros((alike.size if seen else 1, into, out, len(problem.stokes), len(problem.stokes)))
    if seen:
        orders[..., 0, 0] = FLIP[0] * (2.0 * alike.even[:, None, None])
    return make_base_operators(problem, orders)


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
