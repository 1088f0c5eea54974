"""Adding and doubling: slabs doubled from a thin layer, layers and base added, the field between them, (2:8)."""

import math
from functools import partial

import numpy as np

from vrte.basics import cost
from vrte.basics.arrays import Array, IntArray, check_number, check_whole
from vrte.basics.blas import keep_to_one_thread
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.responses import Response
from vrte.discrete_ordinates.orders.slabs import Pile, cut_layers
from vrte.methods.parts.adding import Slab, double_slab, find_light_inside, make_ground_slab, make_homogeneous_slab
from vrte.methods.parts.between_interfaces import join_through_interfaces, respond_as_slab
from vrte.methods.parts.in_depth import POINTS
from vrte.methods.parts.method import Answer, Method, Setting, Settings
from vrte.methods.parts.on_nodes import OnNodes, Scattered, solve_in_turn
from vrte.methods.parts.task import Task
from vrte.methods.parts.thin_layer import make_thin_slab
from vrte.scene.boundary import BLACK

THICKEST, THINNEST = 8.0, 1e-6
LOWEST = 1e-4  # below, starting layers are so thin that rounding is seen
DARK = 1e-16  # transmission of a layer that may as well have no end
MOST_DOUBLINGS = 70
ENOUGH = 1e-3, 1e-6, 1e-10  # accuracy that 1, 2 and 3 depths of a starting layer of 0.25 keep: a tenth and less is seen
NEARLY_DARK = (
    1e-6  # transmission of a white layer so thick that it lacks of an endless one's R just what it lets through
)


def solve_by_adding_doubling(task: Task) -> Answer:
    """Every Fourier order of the truncated phase matrices in turn."""
    doublings: list[int] = []
    if task.problem.media is not None:
        with keep_to_one_thread():
            kernels, fluxes = join_through_interfaces(task, partial(respond_by_adding, task.settings, doublings))
        return task.answer_on_nodes(kernels, fluxes, doublings=max(doublings))
    pile = cut_layers(task.problem)
    on_nodes = OnNodes(pile.problem, task.request.scene.below)

    def field(order: int, base: Array) -> tuple[Array, Array]:
        up, down, most = solve_order(pile, on_nodes, order, base, task.settings)
        doublings.append(most)
        return up, down

    with keep_to_one_thread():
        kernels, fluxes = solve_in_turn(task, on_nodes, pile.out, field)
    return task.answer_on_nodes(kernels, fluxes, doublings=max(doublings))


def solve_order(pile: Pile, on_nodes: OnNodes, order: int, base: Array, settings: Settings) -> tuple[Array, Array, int]:
    """Light up and down at the wanted depths of an order, each (n_tau, r, n_rhs), and most doublings of a slab."""
    scattered = [on_nodes.scattered(order, material) for material in range(pile.problem.albedo.size)]
    white = (order == 0) & (pile.problem.albedo == 1.0)
    slabs = [
        build_slab(on_nodes, scattered[material], float(tau), settings, bool(white[material]))
        for material, tau in zip(pile.material, pile.thickness, strict=True)
    ]
    below = [] if np.isinf(pile.above[-1]) else [make_ground_slab(base, on_nodes.n)]
    up, down = find_light_inside([slabs[k][0] for k in pile.slabs] + below)
    most = max((doublings for _, doublings in slabs), default=0)
    return up[pile.interface, :, on_nodes.n :], down[pile.interface, :, on_nodes.n :], most


def respond_by_adding(
    settings: Settings,
    doublings: list[int],
    problem: Problem,
    material: IntArray,
    thickness: Array,
    orders: IntArray,
    run: Run,
) -> list[Response]:
    """R and T of slabs (slab,) in one medium at the first of the orders; notes how often each was doubled."""
    on_nodes, order = OnNodes(problem, BLACK), int(orders[0])
    found = []
    with run.booked("doubling"):
        for kind, tau in zip(material.tolist(), thickness.tolist(), strict=True):
            is_white = order == 0 and problem.albedo[kind] == 1.0
            slab, done = build_slab(on_nodes, on_nodes.scattered(order, kind), tau, settings, is_white)
            doublings.append(done)
            found.append(respond_as_slab(on_nodes, slab))
    return found


def limit_starting_thickness(on_nodes: OnNodes, thin: float) -> float:
    """Optical thickness of the starting layer, at most: ``thin`` along the lowest cosine that light comes from, and
    between interfaces along the lowest that it goes to: mirrored light of the nodes then goes there too."""
    seen = on_nodes.columns if on_nodes.problem.media is None else np.append(on_nodes.columns, on_nodes.rows)
    return thin * max(LOWEST, float(seen.min()))


def count_doublings(tau: float, thin: float) -> int:
    """How often a starting layer of an optical thickness of at most ``thin`` is doubled."""
    if np.isinf(tau):
        return MOST_DOUBLINGS
    return max(0, math.ceil(math.log2(tau / thin))) if tau > 0.0 else 0


def build_slab(
    on_nodes: OnNodes, scattered: Scattered, tau: float, settings: Settings, is_white: bool
) -> tuple[Slab, int]:
    """A homogeneous slab and its doublings; one without end is doubled until nothing comes through, one ``is_white``
    (order 0 at albedo 1) until what comes through is what R still lacks."""
    thin = limit_starting_thickness(on_nodes, settings["thin"])
    most = count_doublings(tau, thin)
    now = thin if np.isinf(tau) else tau / 2.0**most
    slab = make_thin_slab(scattered, now, on_nodes.rows, on_nodes.columns, on_nodes.n, settings["start"])
    slab = balance_flux(on_nodes, slab, now) if is_white else slab
    for done in range(most):
        if np.isinf(tau) and is_white and np.abs(slab.T).max() < NEARLY_DARK:
            nothing = np.zeros_like(slab.T)
            return make_homogeneous_slab(
                slab.R + slab.T, nothing, tau, on_nodes.rows, on_nodes.columns, on_nodes.n
            ), done
        if np.isinf(tau) and max(np.abs(slab.T).max(), slab.passed[: on_nodes.n].max()) < DARK:
            return slab, done
        slab, now = double_slab(slab), 2.0 * now
        slab = balance_flux(on_nodes, slab, now) if is_white else slab
    return slab, most


def balance_flux(on_nodes: OnNodes, slab: Slab, tau: float) -> Slab:
    """A white slab of optical thickness tau whose flux out is the flux in, exactly: what doubling misses by the error
    of its starting layer and by rounding comes through, evenly.

    The row of fluxes, weight mu for I, is then a left eigenvector of R + T, on which the inverse of 1 - R R hangs."""
    problem, stokes = on_nodes.problem, len(on_nodes.members)
    row = np.zeros(on_nodes.n)
    row[::stokes] = problem.weights * problem.nodes
    into = np.concatenate([row, np.outer(problem.mu0, problem.columns[:, 0]).ravel()])
    missing = into * -np.expm1(-tau / on_nodes.columns) - row @ (slab.R + slab.T)[: on_nodes.n]
    evenly = np.zeros(on_nodes.rows.size)
    evenly[::stokes] = 1.0 / row.sum()
    return make_homogeneous_slab(
        slab.R, slab.T + np.outer(evenly, missing), tau, on_nodes.rows, on_nodes.columns, on_nodes.n
    )


def predict_operations(task: Task) -> float:
    """Doublings of each distinct slab, starting layers, joints."""
    problem, settings = task.problem, task.settings
    pile = cut_layers(problem)
    on_nodes = OnNodes(pile.problem, task.request.scene.below)
    n, r, c = on_nodes.sizes
    thin = limit_starting_thickness(on_nodes, settings["thin"])
    doublings = sum(
        cost.SLAB_STEPS_ENDLESS if math.isinf(tau) else count_doublings(tau, thin)
        for tau in np.unique(pile.thickness).tolist()
    )
    start = (2.0 * settings["start"] * n) ** 2 * (settings["start"] * n + 2.0 * c)
    slabs = pile.slabs.size * (start + 40.0 * r * n * c)
    return on_nodes.n_order * (slabs + doublings * (12.0 * r * n * c + cost.A_DOUBLING))


METHOD = Method(
    name="adding-doubling",
    solve=solve_by_adding_doubling,
    purpose="thick layers and piles of layers, the field between them too",
    conserves="flux to rounding at albedo 1, otherwise up to the error of the starting layer",
    source="(2:8); van de Hulst's doubling, Fourier order by Fourier order",
    conserves_energy=True,
    interfaces="smooth",
    options=("nodes", "accuracy", "backend"),
    finest=1e-12,
    operations=predict_operations,
    settings={
        "thin": Setting(
            0.25,
            lambda value: check_number("thin", value, THINNEST, THICKEST, f"between {THINNEST:g} and {THICKEST:g}"),
            "largest optical thickness of the layer that doubling starts from, along the lowest cosine of nodes and "
            "beams, or 1e-4",
        ),
        "start": Setting(
            3,
            lambda value: check_whole("start", value, 0, POINTS),
            "depths at which the starting layer's source function is solved for: error of order thin^(2 start); 0: "
            "single scattering, error of order thin",
            for_accuracy=lambda accuracy: 1 + sum(accuracy < limit for limit in ENOUGH),
        ),
    },
)
