"""Successive orders of scattering, (2:21)-(2:27): light scattered s times from light scattered s - 1 times.

Each order is light that was reflected and refracted as often as light is, to and fro along its direction, before it is
scattered or reflected by a base again. Light is counted as radiance over the square of the refractive index, times
2 pi, the same on either side of an interface. The source function is a polynomial in panels of Gauss depths.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from vrte import _core
from vrte.basics import cost
from vrte.basics.arrays import Array, check_number, check_whole
from vrte.basics.blas import keep_to_one_thread
from vrte.basics.errors import AccuracyWarning, warn_user
from vrte.discrete_ordinates.orders.base import UNTOLD
from vrte.discrete_ordinates.orders.media import find_fading_of_pieces, join_pieces
from vrte.discrete_ordinates.orders.passage import Passage
from vrte.discrete_ordinates.orders.problem import ALL, Problem
from vrte.discrete_ordinates.planning.needs import find_needs
from vrte.methods.parts.in_depth import find_gauss_depths, weigh_downward, weigh_upward
from vrte.methods.parts.method import Answer, Method, Setting, Settings
from vrte.methods.parts.on_nodes import OnNodes, Scattered, connect_media, count_sizes
from vrte.methods.parts.task import Task
from vrte.request.how import EXACT
from vrte.scene.beams import Passing, pass_along

LEFT_OUT = 30.0  # what the orders left out add, over their estimate: 13 was seen
MOST_ORDERS = 100_000
POINTS = 4  # Gauss depths of a panel: error of the 8th order in its thickness
FINEST_SCALE = (
    1e-3  # optical thickness: panels at a face are no finer than light along the lowest cosine, or this, asks
)
MOST_LEVELS = 4096
FINE_DEPTHS = 20_001
DENSITY = 1.5  # panels for a factor e of distance to a face, and for an optical depth of 1
ROUNDING = 1e-12  # of a layer's thickness: edges of panels that are the same
Faces = tuple[Array, Array]  # light that leaves a section, up at its top and down at its bottom


def solve_by_successive_orders(task: Task) -> Answer:
    """Every Fourier order of the truncated phase matrices in turn.

    Diagnostics: "scattering_orders", "last_ratio", "remainder", "converged" and "notes" are about the orders left out,
    not about the error in depth, which more "levels" make smaller.
    """
    problem, settings, convergence = (
        connect_media(task.request, task.problem),
        task.settings,
        Convergence(task.settings),
    )
    count = problem.coefficients.shape[1]
    shape = problem.level.size, problem.mu0.size, problem.columns.shape[0]
    kernels = np.zeros((count, *shape, problem.mu_out.size, len(ALL)))
    fluxes = np.zeros(shape), np.zeros(shape)
    with keep_to_one_thread():
        stack = Sections(Passage(problem, task.request.scene.below, count, UNTOLD), settings["levels"])
        for order in range(count):
            kernels[order][..., list(problem.stokes)], (up, down) = stack.solve_order(order, convergence)
            if order == 0:
                fluxes = up.reshape(shape), down.reshape(shape)
            task.tell(order + 1, count)
    more = {"levels": int(stack.panels * POINTS), **convergence.diagnostics}
    for note in () if "orders" in task.request.settings else more["notes"]:  # who says how many knows what they are
        warn_user(note, AccuracyWarning)
    return task.answer_on_nodes(kernels, fluxes, **more)


@dataclass(frozen=True, eq=False)
class Light:
    """Diffuse light at Gauss points, (2, panel, POINTS, n, b), and ``edges`` (4, interface, n, b): arriving at and
    leaving each interface above it, entering and rising below it."""

    points: Array
    edges: Array

    def __add__(self, other: "Light") -> "Light":
        return Light(self.points + other.points, self.edges + other.edges)

    @property
    def largest(self) -> float:
        """The largest entry in size."""
        return float(max(np.abs(self.points).max(initial=0.0), np.abs(self.edges).max()))


@dataclass(eq=False)
class Convergence:
    """Orders of scattering: most of any Fourier order and of all together; what the last one added, relative to the
    largest light of Fourier order 0, and what those left out would add as a geometric series."""

    settings: Settings
    largest: float = 0.0
    used: int = 1
    total: int = 0
    last: float = 0.0
    remainder: float = 0.0

    def sum(self, light: Light, scatter: Callable[[Light], Light], order: int) -> tuple[Light, Light | None]:
        """The sum (2:21) of light scattered once and of what ``scatter`` makes of each order in turn, and the same with
        one order fewer, None for none: the light that directions off the nodes are lit by."""
        lit, total, added = None, light, [light.largest]
        while True:
            if order == 0:
                self.largest = total.largest
            left = estimate_remainder(added) / self.largest if self.largest > 0.0 else 0.0
            if len(added) >= self.settings["orders"] or left <= self.settings["tolerance"]:
                break
            lit = total
            light = scatter(light)
            total = total + light
            added.append(light.largest)
        self.used, self.total = max(self.used, len(added)), self.total + len(added)
        self.last = max(self.last, added[-1] / self.largest if self.largest > 0.0 else 0.0)
        self.remainder = max(self.remainder, left)
        return total, lit

    @property
    def diagnostics(self) -> dict[str, Any]:
        """In words and numbers."""
        converged = self.remainder <= self.settings["tolerance"]
        note = (
            f"method 'successive-orders' has not converged: {self.settings['orders']} orders of scattering leave out "
            f"about {self.remainder:.1e} of the light, and energy is not conserved to better than that; ask for more "
            f"by its setting 'orders', or for {EXACT!r}"
        )
        return {
            "scattering_orders": self.used,
            "scatterings": self.total,
            "last_ratio": self.last,
            "remainder": self.remainder,
            "converged": converged,
            "promised": converged,
            "notes": [] if converged else [note],
        }


def estimate_remainder(added: list[float]) -> float:
    """What the orders that follow would add as a geometric series, and no less than what the last one added."""
    before, last = added[-2] if len(added) > 1 else added[-1], added[-1]
    if last == 0.0:
        return 0.0
    return last * max(1.0, last / (before - last)) if last < before else math.inf


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


class Paths:
    """Light of a source carried along the cosines (r,) of some rows through all panels of ``size`` (panel,),
    (2:25)-(2:26)."""

    def __init__(self, cosines: Array, size: Array) -> None:
        z = size[:, None] / cosines
        thickness, x = size[:, None, None, None], find_gauss_depths(POINTS)[:, None]
        # weights of the source at the Gauss points and where the panel is left, (panel, POINTS + 1, POINTS, r)
        self.falls, self.rises = (thickness * np.moveaxis(f(z, POINTS), 2, 0) for f in (weigh_downward, weigh_upward))
        # what is left of light that enters, at the Gauss points (panel, POINTS, r) and behind the panel (panel, r)
        self.near, self.far, self.passed = np.exp(-x * z[:, None]), np.exp(-(1.0 - x) * z[:, None]), np.exp(-z)

    def carry(self, down: Array, up: Array) -> tuple[Array, Faces]:
        """Light at the Gauss points (2, panel, POINTS, r, b) and leaving, from sources (panel, POINTS, r, b)."""
        found, faces = [], []
        ways = ((self.falls, self.near, 1, down), (self.rises, self.far, -1, up))
        for weights, left, turn, source in ways:
            made = np.einsum("pkjr,pjrb->pkrb", weights, source)
            light = np.zeros(made.shape[2:])
            for p in range(len(made))[::turn]:
                made[p, :-1] += left[p, ..., None] * light
                light = made[p, -1] + self.passed[p, :, None] * light
            found.append(made[:, :-1])
            faces.append(light)
        return np.stack(found), (faces[1], faces[0])


@dataclass(frozen=True, eq=False)
class Section:
    """A slab that scatters, in its own medium: ``place`` in the stack, its layer, tops (below its own) and sizes of its
    panels, each (panel,), and where they are among all; flux of unit beams from above and from below (n_in, S, n_col)
    over the square of the index."""

    place: int
    layer: int
    thickness: float
    top: Array
    size: Array
    panels: slice
    on_nodes: OnNodes
    falling: Array
    mirrored: Array

    @property
    def nodes(self) -> slice:
        """Its own among those of all media."""
        return slice(-self.on_nodes.n, None)

    @cached_property
    def depths(self) -> Array:
        """Of the Gauss points below its top, (panel, POINTS)."""
        return self.top[:, None] + self.size[:, None] * find_gauss_depths(POINTS)

    @cached_property
    def decays(self) -> Faces:
        """What is left at the Gauss points of light from the top and from the bottom, (panel, POINTS, n, 1)."""
        rows = self.on_nodes.rows[: self.on_nodes.n]
        from_top, from_bottom = (np.exp(-way[..., None] / rows) for way in (self.depths, self.thickness - self.depths))
        return from_top[..., None], from_bottom[..., None]

    @cached_property
    def along_nodes(self) -> Paths:
        """What carries light along the nodes."""
        return Paths(self.on_nodes.rows[: self.on_nodes.n], self.size)

    @cached_property
    def along_sights(self) -> Paths:
        """What carries light along the directions off the nodes."""
        return Paths(self.on_nodes.rows[self.on_nodes.n :], self.size)

    @cached_property
    def paths(self) -> tuple[Array, Array, Array, Array]:
        """Of light scattered once, per optical depth, (point + 2, n, n_in), at Gauss points, the top and the bottom: of
        a beam from above, down and up, and of one from below."""
        problem = self.on_nodes.problem
        levels = np.concatenate([self.depths.ravel(), [0.0, self.thickness]])
        mu = np.concatenate([-problem.nodes, problem.nodes])

        def integrate(level: Array) -> list[Array]:
            paths = _core.path_integrals(
                above=np.zeros(1),
                thickness=np.array([self.thickness]),
                level=np.ascontiguousarray(level),
                level_layer=np.zeros(level.size, np.int32),
                chosen=np.arange(level.size, dtype=np.int32),
                mu0=problem.mu0,
                mu=mu,
            )[0]
            paths = np.repeat((np.abs(mu) * paths).swapaxes(1, 2), len(problem.stokes), axis=1)
            return np.split(paths, 2, axis=1)

        (down, up), (up_again, down_again) = integrate(levels), integrate(self.thickness - levels)
        return down, up, down_again, up_again

    def scatter_beams(self, scattered: Scattered) -> tuple[Array, Faces]:
        """Light scattered once, from (2:24) in closed form: at Gauss points (2, panel, POINTS, n, b), and leaving."""
        n, stokes = self.on_nodes.n, len(self.on_nodes.problem.stokes)
        down, up = np.zeros((2, self.depths.size + 2, n, self.falling.shape[0] * self.falling.shape[2]))
        ahead, back = (part[:n, n:].reshape(n, -1, stokes) for part in scattered)
        paths = self.paths
        ways = ((self.falling, ahead, back, *paths[:2]), (self.mirrored, back, ahead, *paths[2:]))
        for flux, to_down, to_up, path_down, path_up in ways:
            if flux.any():
                for light, matrix, path in ((down, to_down, path_down), (up, to_up, path_up)):
                    sent = np.einsum("nis,isc->nic", matrix, flux)
                    light += (path[..., None] * sent).reshape(light.shape)
        points = np.stack([down[:-2], up[:-2]]).reshape(2, *self.depths.shape, n, -1)
        return points, (up[-2], down[-1])

    def scatter(self, scattered: Scattered, light: Light, paths: Paths, rows: slice) -> tuple[Array, Faces]:
        """The same of light along the nodes, (2:27), along some rows."""
        n = self.on_nodes.n
        down, up = light.points[:, self.panels, :, self.nodes]
        ahead, back = scattered.ahead[rows, :n], scattered.back[rows, :n]
        return paths.carry(ahead @ down + back @ up, ahead @ up + back @ down)


class Sections:
    """The sections of a stack, and light on its way along the nodes through all of it."""

    def __init__(self, passage: Passage, levels: int | None) -> None:
        self.passage, problem, media, cut = passage, passage.problem, passage.media, passage.cut
        self.joints = join_pieces(media.joints_along(media.cosines), cut)
        self.members = np.ix_(problem.stokes, problem.stokes)
        self.joints = type(self.joints)(
            *(part[..., self.members[0], self.members[1]] for part in vars(self.joints).values())
        )
        self.decay = find_fading_of_pieces(cut, media.cosines)
        self.scale = np.repeat(np.sqrt(media.nodes.measure), len(problem.stokes))[:, None]
        on_nodes = {
            index: OnNodes(passage.of_medium(index, 1 + layer)) for layer, index in enumerate(media.scene.indices)
        }
        scale = find_panel_scale(each.problem for each in on_nodes.values())
        self.sections: list[Section] = []
        self.panels = 0
        for place, (layer, thickness) in enumerate(zip(cut.layer.tolist(), cut.thickness.tolist(), strict=True)):
            if thickness == 0.0 or problem.albedo[layer] == 0.0:
                continue
            index, into = media.scene.indices[layer], passage.into[1 + layer][:, None, None]
            begin = float(cut.thickness[:place][cut.layer[:place] == layer].sum())
            edges = divide_into_panels(float(problem.thickness[layer]), scale, levels) - begin
            inside = edges[(edges > ROUNDING * thickness) & (edges < (1.0 - ROUNDING) * thickness)]
            edges = np.concatenate([[0.0], inside, [thickness]])
            with np.errstate(divide="ignore", invalid="ignore"):
                beams = passage.falling[place], passage.mirrored[place]
                falling, mirrored = (np.where(into > 0.0, power / (into * index**2), 0.0) for power in beams)
            panels = slice(self.panels, self.panels + edges.size - 1)
            top, size = edges[:-1], np.diff(edges)
            self.sections.append(
                Section(place, layer, thickness, top, size, panels, on_nodes[index], falling, mirrored)
            )
            self.panels = panels.stop

    def solve_order(self, order: int, convergence: Convergence) -> tuple[Array, Array]:
        """Radiance for unit beams, (n_tau, n_in, n_col, n_out, S), public frame, and fluxes up and down, (2, n_tau,
        b), of all orders of scattering, (2:21)-(2:23)."""
        scattered = {section.layer: section.on_nodes.scatter(order, section.layer) for section in self.sections}
        base, beam = self.passage.reflect_on_base(order)
        base = None if base is None else base / self.scale * self.scale[:, 0]
        once = {section.place: section.scatter_beams(scattered[section.layer]) for section in self.sections}
        total, lit = convergence.sum(
            self.carry(once, beam / self.scale), lambda light: self.scatter(scattered, light, base), order
        )
        return self.view(scattered, lit, order), self.passage.sum_fluxes(*(self.scale * total.edges))

    def scatter(self, scattered: dict[int, Scattered], light: Light, base: Array | None) -> Light:
        """Light that was scattered or reflected by the base once more than this."""
        made = {
            section.place: section.scatter(
                scattered[section.layer], light, section.along_nodes, slice(0, section.on_nodes.n)
            )
            for section in self.sections
        }
        arriving = light.edges[0, -1]
        return self.carry(made, np.zeros_like(arriving) if base is None else base @ arriving)

    def carry(self, made: dict[int, tuple[Array, Faces]], from_base: Array) -> Light:
        """Light that sets out in the sections, at Gauss points and faces, and at the base, on its way through all
        interfaces."""
        count, (n, b) = self.joints.above.shape[0], from_base.shape
        sources = Passing(*np.zeros((4, count, n, b)))
        points = np.zeros((2, self.panels, POINTS, n, b))
        for section in self.sections:
            points[:, section.panels, :, section.nodes], (up, down) = made[section.place]
            sources.rising[section.place, section.nodes] += up
            sources.arriving[section.place + 1, section.nodes] += down
        sources.leaving[-1] += from_base
        stokes = (count, -1, len(self.passage.problem.stokes), b)
        found = pass_along(self.joints, self.decay, Passing(*(part.reshape(stokes) for part in vars(sources).values())))
        edges = np.stack([part.reshape(count, n, b) for part in vars(found).values()])
        _, leaving, entering, _ = edges
        for section in self.sections:
            from_top, from_bottom = section.decays
            here = points[:, section.panels, :, section.nodes]
            here[0] += from_top * entering[section.place, section.nodes]
            here[1] += from_bottom * leaving[section.place + 1, section.nodes]
        return Light(points, edges)

    def view(self, scattered: dict[int, Scattered], lit: Light | None, order: int) -> Array:
        """Radiance for unit beams of light that was scattered or reflected by the base once more than ``lit``."""
        passage = self.passage
        shape = passage.sights.cosines.shape[1], len(passage.problem.stokes), passage.problem.n_rhs
        sent = np.zeros((len(passage.sources), *shape))
        if lit is not None:
            for section in self.sections:
                rows = slice(section.on_nodes.n, None)
                _, faces = section.scatter(scattered[section.layer], lit, section.along_sights, rows)
                for end, light in enumerate(faces):
                    sent[2 * section.place + end] = light.reshape(shape)
            if passage.base is not None:
                sent[-1] = passage.leave_base(order, self.scale * lit.edges[0, -1])
        return passage.look(sent)


def find_panel_scale(problems: Iterable[Problem]) -> float:
    """Optical thickness of the finest panels: the lowest cosine of nodes and beams, or FINEST_SCALE."""
    return max(FINEST_SCALE, min(min(float(each.nodes.min()), float(each.mu0.min())) for each in problems))


def predict_operations(task: Task) -> float:
    """As many orders as it takes, by how strongly a Fourier order scatters and how much leaves through the faces."""
    problem, settings, scale = task.problem, task.settings, find_panel_scale([task.problem])
    n, _, _ = count_sizes(task.request, task.problem)
    panels = sum(divide_into_panels(each, scale, settings["levels"]).size - 1 for each in problem.thickness.tolist())
    levels, depth = panels * POINTS, float(problem.thickness.sum())
    media = task.request.scene.media
    # of what comes to a surface from within, about so much gets out
    kept = 1.0 - min(0.5, math.pi**2 / (3.0 * (depth + 1.42) ** 2)) * (min(media) / max(media)) ** 2
    ratio = np.clip(find_needs(problem, task.run).strength * kept, 1e-6, 1.0 - 1e-9)
    scatterings = np.minimum(settings["orders"], 1.0 + math.log(settings["tolerance"]) / np.log(ratio)).sum()
    a_row = levels * (8.0 * n + 4.0 * (POINTS + 1)) * problem.n_rhs
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
