"""Successive orders of scattering, (2:21)-(2:27): light scattered s times from light scattered s - 1 times."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vrte import _core
from vrte.basics import cost
from vrte.basics.arrays import Array, IntArray, check_number, check_whole
from vrte.basics.blas import keep_to_one_thread
from vrte.basics.errors import AccuracyWarning, warn_user
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.planning.needs import find_needs
from vrte.methods.parts.convergence import Convergence, sum_scatterings
from vrte.methods.parts.in_depth import find_gauss_depths
from vrte.methods.parts.method import Answer, Method, Setting, Settings
from vrte.methods.parts.on_nodes import OnNodes, Scattered, find_distinct_directions, solve_in_turn
from vrte.methods.parts.orders_between_interfaces import solve_between_interfaces
from vrte.methods.parts.panels import FINEST_SCALE, MOST_LEVELS, POINTS, Light, Pair, Way, divide_into_panels
from vrte.methods.parts.task import Task

LEFT_OUT = 30.0  # what the orders left out add, over what they are estimated to: 13 was seen
MOST_ORDERS = 100_000


@dataclass(frozen=True, eq=False)
class Depths:
    """Panels of all layers, finer towards the faces, every wanted depth at an edge.

    layer (panel,); top, size (panel,): depth below the layer's top, and thickness; place (n_tau,): the edges at the
    wanted depths.
    """

    layer: IntArray
    top: Array
    size: Array
    place: IntArray

    @cached_property
    def at(self) -> tuple[Array, IntArray]:
        """Depths below the layers' tops, and layers, of the Gauss points of every panel, each (panel * POINTS,)."""
        depth = self.top[:, None] + self.size[:, None] * find_gauss_depths(POINTS)
        return depth.ravel(), np.repeat(self.layer, POINTS)


def choose_depths(problem: Problem, levels: int | None) -> Depths:
    """At least ``levels`` Gauss depths in every layer; None: as many as its thickness asks for."""
    scale = max(FINEST_SCALE, min(problem.nodes.min(), problem.mu0.min()))
    layer: list[int] = []
    top: list[float] = []
    size: list[float] = []
    place = np.zeros(problem.level.size, np.int32)
    for k, thickness in enumerate(problem.thickness.tolist()):
        here = problem.level_layer == k
        edges = np.unique(np.concatenate([divide_into_panels(thickness, scale, levels), problem.level[here]]))
        place[here] = len(layer) + np.searchsorted(edges, problem.level[here])
        layer += [k] * (edges.size - 1)
        top += edges[:-1].tolist()
        size += np.diff(edges).tolist()
    return Depths(np.array(layer, np.int32), np.array(top), np.array(size), place)


@dataclass(frozen=True, eq=False)
class Orders:
    """Orders of scattering of a scene whose every Fourier order has the same depths."""

    on_nodes: OnNodes
    depths: Depths
    nodes: Way
    out: Way
    paths_down: Array
    paths_up: Array

    @staticmethod
    def of(on_nodes: OnNodes, levels: int | None) -> "Orders":
        """All that Fourier orders share; paths (layer, panel * POINTS + panel + 1, r = n, b) of light scattered once,
        per optical depth."""
        problem, n = on_nodes.problem, on_nodes.n
        depths = choose_depths(problem, levels)
        level, layer = depths.at
        level = np.concatenate([level, depths.top, problem.thickness[-1:]])
        layer = np.concatenate([layer, depths.layer, [problem.albedo.size - 1]]).astype(np.int32)
        mu = np.concatenate([problem.nodes, -problem.nodes])
        every = np.arange(level.size, dtype=np.int32)
        paths = _core.path_integrals(
            above=problem.above,
            thickness=problem.thickness,
            level=level,
            level_layer=layer,
            chosen=every,
            mu0=problem.mu0,
            mu=mu,
        )
        paths = np.repeat(np.abs(mu) * paths, len(on_nodes.members), axis=3)
        paths = np.repeat(paths, problem.columns.shape[0], axis=2).swapaxes(2, 3)
        return Orders(
            on_nodes,
            depths,
            Way.along(on_nodes.rows[:n], depths.size),
            Way.along(on_nodes.rows[n:], depths.size),
            paths[:, :, n:],
            paths[:, :, :n],
        )

    def field(self, order: int, base: Array, settings: Settings, convergence: Convergence) -> Pair:
        """Light down and up at the wanted depths, each (n_tau, r, b), all rows: along the nodes all of it, along the
        others what is scattered more than once: the sum (2:21) of what (2:22)-(2:23) make of each other."""
        n, problem = self.on_nodes.n, self.on_nodes.problem
        scattered = [self.on_nodes.scattered(order, layer) for layer in range(problem.albedo.size)]
        total, lit = sum_scatterings(
            self.once(scattered, base),
            lambda light: self.scatter(scattered, light, self.nodes, base[:n, :n], slice(0, n)),
            order,
            settings,
            convergence,
        )
        wanted = total.edges[:, self.depths.place]
        if lit is None:
            more = np.zeros((*wanted.shape[:2], self.on_nodes.rows.size - n, wanted.shape[3]))
        else:
            more = self.scatter(scattered, lit, self.out, base[n:, :n], slice(n, None)).edges[:, self.depths.place]
        down, up = np.concatenate([wanted, more], axis=2)
        return down, up

    def once(self, scattered: list[Scattered], base: Array) -> Light:
        """Light scattered once, from (2:24) in closed form, and what the base makes of it and of the beam, on nodes."""
        n, panels = self.on_nodes.n, self.depths.layer.size
        down, up = (
            sum((each[:n, n:] * path for each, path in zip(matrices, paths, strict=True)), np.zeros(paths.shape[1:]))
            for matrices, paths in (
                ([each.ahead for each in scattered], self.paths_down),
                ([each.back for each in scattered], self.paths_up),
            )
        )
        beam = np.exp(-self.on_nodes.problem.thickness.sum() / self.on_nodes.columns[n:])
        enters = base[:n, :n] @ down[-1] + base[:n, n:] * beam
        cut = panels * POINTS
        points = np.stack([down[:cut], up[:cut]]).reshape(2, panels, POINTS, *down.shape[1:])
        reflected = self.nodes.up(np.zeros(points.shape[1:]), enters)
        points[1] += reflected[0]
        edges = np.stack([down[cut:], up[cut:] + reflected[1]])
        return Light(points, edges)

    def scatter(self, scattered: list[Scattered], light: Light, way: Way, base: Array, rows: slice) -> Light:
        """Light along some rows from the source function (2:27) of light along the nodes; base (rows, n)."""
        n = self.on_nodes.n
        sources = np.empty((2, *light.points.shape[1:3], way.passed.shape[1], light.points.shape[4]))
        for layer, (ahead, back) in enumerate(scattered):
            here = self.depths.layer == layer
            down, up = light.points[:, here]
            sources[0, here] = ahead[rows, :n] @ down + back[rows, :n] @ up
            sources[1, here] = ahead[rows, :n] @ up + back[rows, :n] @ down
        nothing = np.zeros(sources.shape[3:])
        falls = way.down(sources[0], nothing)
        bottom = light.edges[0, -1] if rows.start else falls[1][-1]
        return Light.of(falls, way.up(sources[1], base @ bottom))


def solve_by_successive_orders(task: Task) -> Answer:
    """Every Fourier order of the truncated phase matrices in turn.

    Diagnostics: "scattering_orders", "last_ratio", "remainder", "converged" and "notes" speak of the orders left out,
    not of the error in depth, which more "levels" make smaller.
    """
    distinct, out = find_distinct_directions(task.problem)
    on_nodes, settings = OnNodes(distinct, task.request.scene.below), task.settings
    convergence = Convergence()

    def field_of(order: int, base: Array) -> tuple[Array, Array]:
        down, up = scene.field(order, base, settings, convergence)
        return up, down

    with keep_to_one_thread():
        if task.problem.media is not None:
            kernels, fluxes, panels = solve_between_interfaces(task, convergence)
        else:
            scene = Orders.of(on_nodes, settings["levels"])
            kernels, fluxes = solve_in_turn(task, on_nodes, out, field_of)
            panels = scene.depths.layer.size
    more = {"levels": int(panels * POINTS), **convergence.diagnostics(settings)}
    for note in () if "orders" in task.request.settings else more["notes"]:  # who says how many knows what they are
        warn_user(note, AccuracyWarning)
    return task.answer_on_nodes(kernels, fluxes, **more)


def predict_operations(task: Task) -> float:
    """As many orders as it takes, by how strongly a Fourier order scatters and how much leaves through the faces."""
    problem, settings = task.problem, task.settings
    n, _, c = OnNodes(problem, task.request.scene.below).sizes
    levels = choose_depths(problem, settings["levels"]).layer.size * POINTS
    depth = float(problem.thickness.sum())
    media = task.request.scene.media
    # of what comes to a surface from within, about so much gets out
    kept = 1.0 - min(0.5, math.pi**2 / (3.0 * (depth + 1.42) ** 2)) * (min(media) / max(media)) ** 2
    ratio = np.clip(find_needs(problem, task.run).strength * kept, 1e-6, 1.0 - 1e-9)
    scatterings = np.minimum(settings["orders"], 1.0 + math.log(settings["tolerance"]) / np.log(ratio)).sum()
    a_row = levels * (8.0 * n + 4.0 * (POINTS + 1)) * (c - n)
    return float(scatterings) * (n * a_row * 2.0 + levels / POINTS * cost.OVERHEAD / 30.0)


METHOD = Method(
    name="successive-orders",
    solve=solve_by_successive_orders,
    purpose="thin and absorbing layers; how much each order of scattering adds",
    conserves="nothing at low orders: light scattered more often than they say is lost; flux once they have converged",
    source="(2:21)-(2:27)",
    endless=False,
    interfaces="smooth",
    options=("nodes", "accuracy", "backend"),
    finest=1e-7,
    operations=predict_operations,
    settings={
        "orders": Setting(
            1000,
            lambda value: check_whole("orders", value, 1, MOST_ORDERS),
            "most orders of scattering; 1: light scattered once, and the beam that the base reflects",
        ),
        "tolerance": Setting(
            1e-8,
            lambda value: check_number("tolerance", value, 1e-15, 1.0, "between 1e-15 and 1"),
            "orders end where neither the last one nor those left out, as a geometric series, add more, relative to "
            "the largest radiance of azimuthal order 0",
            for_accuracy=lambda accuracy: accuracy / LEFT_OUT,
        ),
        "levels": Setting(
            None,
            lambda value: None if value is None else check_whole("levels", value, 1, MOST_LEVELS),
            "depths in every layer at which the source function is held, at least, in panels of four Gauss points: "
            "error of their 8th order; None: by the thickness, for about 1e-8",
        ),
    },
)
