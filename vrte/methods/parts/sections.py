"""Light scattered again and again in a stack of layers, its source function held at Gauss depths, (2:21)-(2:27).

Light is counted as radiance over the square of the refractive index, times 2 pi, the same on either side of an
interface: it is reflected and refracted to and fro along its direction, in closed form, until it is scattered again.
"""

import math
from collections.abc import Iterable
from functools import cached_property

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, record
from vrte.discrete_ordinates.orders.base import DEFAULT_ACCURACY
from vrte.discrete_ordinates.orders.beam_paths import BeamPaths
from vrte.discrete_ordinates.orders.media import find_decaying_of_pieces, join_pieces
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.methods.parts.slab import OnNodes, Scattered, find_gauss_depths, weigh_downward, weigh_upward
from vrte.scene.beams import Passing, pass_along
from vrte.scene.boundary import Boundary

POINTS = 4  # Gauss depths of a panel: error of the 8th order in its thickness
FINEST_SCALE = (
    1e-3  # optical thickness: panels at a face are no finer than light along the lowest cosine, or this, asks
)
MOST_LEVELS = 4096
FINE_DEPTHS = 20_001
DENSITY = 1.5  # panels for a factor e of distance to a face, and for an optical depth of 1
ROUNDING = 1e-12  # of a layer's thickness: edges of panels that are the same
Faces = tuple[Array, Array]  # light that leaves a section, up at its top and down at its bottom


@record
class Light:
    """Light at Gauss points (2, panel, POINTS, n, b); ``edges`` (4, interface, n, b) arriving, leaving, entering,
    rising."""

    points: Array
    edges: Array

    def __add__(self, other: "Light") -> "Light":
        return Light(self.points + other.points, self.edges + other.edges)

    @property
    def largest(self) -> float:
        """The largest entry in size."""
        return float(max(np.abs(self.points).max(initial=0.0), np.abs(self.edges).max()))


def divide_into_panels(thickness: float, scale: float, levels: int | None) -> Array:
    """Edges of panels, about as thick as the nearer face is far, at least ``scale``; by ``levels`` or 1 at most."""
    if thickness == 0.0:
        return np.zeros(1)
    # depths to look up, far closer than panels and evenly spaced where panels are
    steps = np.linspace(-1.0, 1.0, FINE_DEPTHS) * math.log1p(thickness / scale)
    depths = np.clip((thickness + 2.0 * scale) / (1.0 + np.exp(-steps)) - scale, 0.0, thickness)
    depths[0], depths[-1] = 0.0, thickness
    count = steps - steps[0] + depths  # of panels above a depth
    panels = math.ceil(DENSITY * count[-1] if levels is None else levels / POINTS)
    return np.interp(np.linspace(0.0, count[-1], min(panels, MOST_LEVELS // POINTS) + 1), count, depths)


def find_panel_scale(problems: Iterable[Problem]) -> float:
    """Optical thickness of the finest panels: the lowest cosine of nodes and beams, or FINEST_SCALE."""
    return max(FINEST_SCALE, min(min(float(each.nodes.min()), float(each.mu0.min())) for each in problems))


class Paths:
    """Light carried along the cosines (r,) of some rows through panels of ``size`` (panel,), (2:25)-(2:26)."""

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


@record
class Section:
    """A slab that scatters: ``place`` in the stack, layer, tops and sizes of its panels (panel,), where they are among
    all; fluxes of unit beams from above and below (n_in, S, n_col) over index^2."""

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
        """Depths of the Gauss points below the section's top, (panel, POINTS)."""
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
        """Once-scattered light per optical depth, (point + 2, n, n_in): of a beam from above and one from below."""
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

    def scatter(self, scattered: Scattered, light: Light, rows: slice) -> tuple[Array, Array]:
        """The source function (2:27), down and up, along some rows, of light along the nodes."""
        n = self.on_nodes.n
        down, up = light.points[:, self.panels, :, self.nodes]
        ahead, back = scattered.ahead[rows, :n], scattered.back[rows, :n]
        return ahead @ down + back @ up, ahead @ up + back @ down


class Sections:
    """The sections of a stack, and light on its way along the nodes through all of it."""

    def __init__(self, problem: Problem, below: Boundary, levels: int | None) -> None:
        self.beam_paths = beam_paths = BeamPaths(problem, below, problem.coefficients.shape[1], DEFAULT_ACCURACY)
        media, cut = beam_paths.media, beam_paths.cut
        self.interfaces = join_pieces(media.interfaces_along(media.cosines), cut)
        self.members = np.ix_(problem.stokes, problem.stokes)
        self.interfaces = type(self.interfaces)(
            *(part[..., self.members[0], self.members[1]] for part in vars(self.interfaces).values())
        )
        self.decay = find_decaying_of_pieces(media, cut, media.cosines)
        self.scale = np.repeat(np.sqrt(media.nodes.measure), len(problem.stokes))[:, None]
        on_nodes = {
            index: OnNodes(beam_paths.of_medium(index, 1 + layer)) for layer, index in enumerate(media.scene.indices)
        }
        scale = find_panel_scale(each.problem for each in on_nodes.values())
        self.sections: list[Section] = []
        self.panels = 0
        for place, (layer, thickness) in enumerate(zip(cut.layer.tolist(), cut.thickness.tolist(), strict=True)):
            if thickness == 0.0 or problem.albedo[layer] == 0.0:
                continue
            index, into = media.scene.indices[layer], beam_paths.into[1 + layer][:, None, None]
            begin = float(cut.thickness[:place][cut.layer[:place] == layer].sum())
            edges = divide_into_panels(float(problem.thickness[layer]), scale, levels) - begin
            inside = edges[(edges > ROUNDING * thickness) & (edges < (1.0 - ROUNDING) * thickness)]
            edges = np.concatenate([[0.0], inside, [thickness]])
            with np.errstate(divide="ignore", invalid="ignore"):
                beams = beam_paths.falling[place], beam_paths.mirrored[place]
                falling, mirrored = (np.where(into > 0.0, power / (into * index**2), 0.0) for power in beams)
            panels = slice(self.panels, self.panels + edges.size - 1)
            top, size = edges[:-1], np.diff(edges)
            self.sections.append(
                Section(place, layer, thickness, top, size, panels, on_nodes[index], falling, mirrored)
            )
            self.panels = panels.stop

    def carry(self, made: dict[int, tuple[Array, Faces]], from_base: Array) -> Light:
        """Light from sources in sections, at Gauss points and faces, and at the base, through all interfaces."""
        count, (n, b) = self.interfaces.above.shape[0], from_base.shape
        sources = Passing(*np.zeros((4, count, n, b)))
        points = np.zeros((2, self.panels, POINTS, n, b))
        for section in self.sections:
            points[:, section.panels, :, section.nodes], (up, down) = made[section.place]
            sources.rising[section.place, section.nodes] += up
            sources.arriving[section.place + 1, section.nodes] += down
        sources.leaving[-1] += from_base
        stokes = (count, -1, len(self.beam_paths.problem.stokes), b)
        found = pass_along(
            self.interfaces, self.decay, Passing(*(part.reshape(stokes) for part in vars(sources).values()))
        )
        edges = np.stack([part.reshape(count, n, b) for part in vars(found).values()])
        _, leaving, entering, _ = edges
        for section in self.sections:
            from_top, from_bottom = section.decays
            here = points[:, section.panels, :, section.nodes]
            here[0] += from_top * entering[section.place, section.nodes]
            here[1] += from_bottom * leaving[section.place + 1, section.nodes]
        return Light(points, edges)

    def look(self, order: int, faces: dict[int, Faces], arriving: Array) -> Array:
        """Radiance for unit beams, (n_tau, n_in, n_col, n_out, S), public frame: of light that leaves sections along
        directions off the nodes, and of light on the nodes that arrives at the base, (n, b)."""
        beam_paths = self.beam_paths
        rows = beam_paths.sights.cosines.shape[1] * len(beam_paths.problem.stokes)
        sent = np.zeros((1, len(beam_paths.sources), beam_paths.problem.n_rhs, rows))
        for index, pair in faces.items():
            for end, light in enumerate(pair):
                sent[0, 2 * index + end] = light.reshape(rows, -1).T
        if beam_paths.base is not None:
            sent[:, -1] = beam_paths.leave_base(np.array([order]), (self.scale * arriving).T[None])
        return beam_paths.look(sent)[0]


class Order:
    """One Fourier order: what layers scatter, the base's operator (n, n) or None, light scattered ``once``."""

    def __init__(self, stack: Sections, order: int) -> None:
        self.stack, self.order = stack, order
        self.scattered = {section.layer: section.on_nodes.scatter(order, section.layer) for section in stack.sections}
        paths, number = stack.beam_paths, np.array([order])
        beam, self.base = paths.reflect_on_base(number, paths.arriving)[0].T, None
        if paths.base is not None and paths.base.row[order] >= 0:
            own = paths.base.matrix[paths.base.row[order]].T
            self.base = np.pad(own, (stack.scale.size - len(own), 0)) / stack.scale * stack.scale[:, 0]
        once = {section.place: section.scatter_beams(self.scattered[section.layer]) for section in stack.sections}
        self.once = stack.carry(once, beam / stack.scale)

    def reflect(self, arriving: Array) -> Array:
        """What the base sends back of light on the nodes, (n, b)."""
        return np.zeros_like(arriving) if self.base is None else self.base @ arriving

    def scatter(self, light: Light) -> Light:
        """Light that was scattered or reflected by the base once more than this."""
        made = {}
        for section in self.stack.sections:
            sources = section.scatter(self.scattered[section.layer], light, slice(0, section.on_nodes.n))
            made[section.place] = section.along_nodes.carry(*sources)
        return self.stack.carry(made, self.reflect(light.edges[0, -1]))

    def view(self, lit: Light) -> Array:
        """Radiance for unit beams of light that was scattered or reflected by the base once more than ``lit``."""
        faces = {}
        for section in self.stack.sections:
            sources = section.scatter(self.scattered[section.layer], lit, slice(section.on_nodes.n, None))
            faces[section.place] = section.along_sights.carry(*sources)[1]
        return self.stack.look(self.order, faces, lit.edges[0, -1])
