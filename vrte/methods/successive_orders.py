"""Successive orders of scattering, (2:21)-(2:27): light scattered s times from light scattered s - 1 times."""

import math
import warnings
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from vrte import _core
from vrte.basics import cost
from vrte.basics.arrays import Array, IntArray, check_number, check_whole
from vrte.basics.blas import keep_to_one_thread
from vrte.basics.errors import AccuracyWarning
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.planning.needs import find_needs
from vrte.methods.parts.in_depth import find_gauss_depths, weigh_downward, weigh_upward
from vrte.methods.parts.method import Answer, Method, Setting, Settings
from vrte.methods.parts.on_nodes import OnNodes, Scattered, find_distinct_directions, solve_in_turn
from vrte.methods.parts.task import Task
from vrte.request.how import EXACT

POINTS = 4  # Gauss depths of a panel: error of the 8th order in its thickness
FINEST_SCALE = 1e-3  # panels at a face are no finer than light along the lowest cosine asks for, nor than this
LEFT_OUT = 30.0  # what the orders left out add, over what they are estimated to: 13 was seen
MOST_ORDERS, MOST_LEVELS = 100_000, 4096
FINE_DEPTHS = 20_001
DENSITY = 1.5  # panels for a factor e of distance to a face, and for an optical depth of 1
Pair = tuple[Array, Array]


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


def divide_into_panels(thickness: float, scale: float, levels: int | None) -> Array:
    """Edges of panels from 0 to the thickness: about as thick as the distance to the nearer face, not below ``scale``,
    nor above 1 where ``levels`` is None."""
    if thickness == 0.0:
        return np.zeros(1)
    # depths to look up, far closer than panels and evenly spaced where panels are
    steps = np.linspace(-1.0, 1.0, FINE_DEPTHS) * math.log1p(thickness / scale)
    depths = np.clip((thickness + 2.0 * scale) / (1.0 + np.exp(-steps)) - scale, 0.0, thickness)
    depths[0], depths[-1] = 0.0, thickness
    count = steps - steps[0] + depths  # of panels above a depth
    panels = math.ceil(DENSITY * count[-1] if levels is None else levels / POINTS)
    edges: Array = np.interp(np.linspace(0.0, count[-1], min(panels, MOST_LEVELS // POINTS) + 1), count, depths)
    return edges


@dataclass(frozen=True, eq=False)
class Way:
    """Light carried along the cosines of some rows through all panels, (2:25)-(2:26).

    falls, rises (panel, POINTS + 1, POINTS, r): weights of the source for light down and up at the Gauss points and
    where the panel is left; to_points, to_points_up (panel, POINTS, r) and passed (panel, r): what is left of light
    that enters.
    """

    falls: Array
    rises: Array
    to_points: Array
    to_points_up: Array
    passed: Array

    @staticmethod
    def along(cosines: Array, size: Array) -> "Way":
        """For rows (r,) and panels (panel,)."""
        z = size[:, None] / cosines
        x = find_gauss_depths(POINTS)[:, None]
        falls, rises = (np.moveaxis(weights(z, POINTS), 2, 0) for weights in (weigh_downward, weigh_upward))
        thickness = size[:, None, None, None]
        near, far = np.exp(-x * z[:, None]), np.exp(-(1.0 - x) * z[:, None])
        return Way(thickness * falls, thickness * rises, near, far, np.exp(-z))

    def down(self, source: Array, enters: Array) -> Pair:
        """Light at the Gauss points (panel, POINTS, r, b) and at the edges (panel + 1, r, b) from source (panel,
        POINTS, r, b) and what enters at the top (r, b)."""
        made = np.einsum("pkjr,pjrb->pkrb", self.falls, source)
        edges = np.empty((source.shape[0] + 1, *enters.shape))
        edges[0] = enters
        for p, passed in enumerate(self.passed):
            edges[p + 1] = passed[:, None] * edges[p] + made[p, -1]
        return made[:, :-1] + self.to_points[..., None] * edges[:-1, None], edges

    def up(self, source: Array, enters: Array) -> Pair:
        """The same for what enters at the bottom."""
        made = np.einsum("pkjr,pjrb->pkrb", self.rises, source)
        edges = np.empty((source.shape[0] + 1, *enters.shape))
        edges[-1] = enters
        for p in range(source.shape[0] - 1, -1, -1):
            edges[p] = self.passed[p, :, None] * edges[p + 1] + made[p, -1]
        return made[:, :-1] + self.to_points_up[..., None] * edges[1:, None], edges


@dataclass(frozen=True, eq=False)
class Light:
    """Diffuse light down and up, at the Gauss points (2, panel, POINTS, r, b) and edges (2, panel + 1, r, b)."""

    points: Array
    edges: Array

    @staticmethod
    def of(down: Pair, up: Pair) -> "Light":
        """From what a `Way` gives."""
        return Light(np.stack([down[0], up[0]]), np.stack([down[1], up[1]]))

    def __add__(self, other: "Light") -> "Light":
        return Light(self.points + other.points, self.edges + other.edges)

    @property
    def largest(self) -> float:
        """In size."""
        return float(max(np.abs(self.points).max(initial=0.0), np.abs(self.edges).max()))


@dataclass(eq=False)
class Convergence:
    """Orders of scattering summed, at most of any Fourier order and of all together; what the last one added, relative
    to the largest light of Fourier order 0, and what those left out would add as a geometric series; whether that is
    little enough."""

    largest: float = 0.0
    used: int = 1
    total: int = 0
    last: float = 0.0
    remainder: float = 0.0
    converged: bool = True

    def remainder_of(self, added: list[float], total: Light, order: int) -> float:
        """What the orders that follow would add, relative to the largest light of Fourier order 0."""
        largest = total.largest if order == 0 else self.largest
        return estimate_remainder(added) / largest if largest > 0.0 else 0.0

    def note(self, added: list[float], total: Light, order: int, tolerance: float) -> None:
        """One Fourier order is done."""
        if order == 0:
            self.largest = total.largest
        remainder = self.remainder_of(added, total, order)
        self.used = max(self.used, len(added))
        self.total += len(added)
        self.last = max(self.last, added[-1] / self.largest if self.largest > 0.0 else 0.0)
        self.remainder = max(self.remainder, remainder)
        self.converged = self.converged and remainder <= tolerance

    def diagnostics(self, settings: Settings) -> dict[str, Any]:
        """In words and numbers."""
        notes = [] if self.converged else [self.told(settings)]
        return {
            "scattering_orders": self.used,
            "scatterings": self.total,
            "last_ratio": self.last,
            "remainder": self.remainder,
            "converged": self.converged,
            "promised": self.converged,
            "notes": notes,
        }

    def told(self, settings: Settings) -> str:
        """What is missing, and what to do about it."""
        return (
            f"method 'successive-orders' has not converged: {settings['orders']} orders of scattering leave out about "
            f"{self.remainder:.1e} of the light, and energy is not conserved to better than that; ask for more by its "
            f"setting 'orders', or for {EXACT!r}"
        )


def estimate_remainder(added: list[float]) -> float:
    """What the orders that follow would add as a geometric series, and no less than what the last one added."""
    before, last = added[-2] if len(added) > 1 else added[-1], added[-1]
    if last == 0.0:
        return 0.0
    return last * max(1.0, last / (before - last)) if last < before else math.inf


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
        light = self.once(scattered, base)
        # what the source function of the wanted directions is made of: one order fewer than they have
        lit, total, added = None, light, [light.largest]
        while len(added) < settings["orders"] and convergence.remainder_of(added, total, order) > settings["tolerance"]:
            lit = total
            light = self.scatter(scattered, light, self.nodes, base[:n, :n], slice(0, n))
            total = total + light
            added.append(light.largest)
        convergence.note(added, total, order, settings["tolerance"])
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
        scene = Orders.of(on_nodes, settings["levels"])
        kernels, fluxes = solve_in_turn(task, on_nodes, out, field_of)
    more = {"levels": int(scene.depths.layer.size * POINTS), **convergence.diagnostics(settings)}
    for note in () if "orders" in task.request.settings else more["notes"]:  # who says how many knows what they are
        warnings.warn(note, AccuracyWarning, stacklevel=2)
    return task.answer_on_nodes(kernels, fluxes, **more)


def predict_operations(task: Task) -> float:
    """As many orders as it takes, by how strongly a Fourier order scatters and how much leaves through the faces."""
    problem, settings = task.problem, task.settings
    n, _, c = OnNodes(problem, task.request.scene.below).sizes
    levels = choose_depths(problem, settings["levels"]).layer.size * POINTS
    depth = float(problem.thickness.sum())
    kept = 1.0 - min(0.5, math.pi**2 / (3.0 * (depth + 1.42) ** 2))
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
