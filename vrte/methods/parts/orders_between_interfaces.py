"""Orders of scattering in piles with interfaces and mirrors: each is light that was reflected and refracted as often as
light is, to and fro along its direction, before it is scattered or reflected by a base again.

Light is counted as radiance over the square of the refractive index, times 2 pi, the same on either side of a joint.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array
from vrte.discrete_ordinates.orders.base import UNTOLD
from vrte.discrete_ordinates.orders.media import find_fading_of_pieces, join_pieces
from vrte.discrete_ordinates.orders.passage import Passage
from vrte.discrete_ordinates.orders.problem import ALL
from vrte.methods.parts.convergence import Convergence, sum_scatterings
from vrte.methods.parts.in_depth import find_gauss_depths
from vrte.methods.parts.method import Settings
from vrte.methods.parts.on_nodes import OnNodes, Scattered
from vrte.methods.parts.panels import FINEST_SCALE, POINTS, Light, Way, divide_into_panels
from vrte.methods.parts.task import Task
from vrte.scene.beams import Passing, pass_along
from vrte.scene.boundary import BLACK

ROUNDING = 1e-12  # edges of panels that are the same
Faces = tuple[Array, Array]  # light that leaves a section, up at its top and down at its bottom


def solve_between_interfaces(task: Task, convergence: Convergence) -> tuple[Array, Faces, int]:
    """Kernels of all Fourier orders (order, n_tau, n_in, n_col, n_out, 4), fluxes up and down (n_tau, n_in, n_col), and
    how many panels there are."""
    problem, settings = task.problem, task.settings
    count = problem.coefficients.shape[1]
    shape = problem.level.size, problem.mu0.size, problem.columns.shape[0]
    kernels = np.empty((count, *shape, problem.mu_out.size, len(ALL)))
    fluxes = np.zeros(shape), np.zeros(shape)
    pile = Sections(Passage(problem, task.request.scene.below, count, UNTOLD), settings["levels"])
    for order in range(count):
        kernels[order], up, down = pile.solve_order(order, settings, convergence)
        if order == 0:
            fluxes = up.reshape(shape), down.reshape(shape)
        task.tell(order + 1, count)
    return kernels, fluxes, pile.panels


@dataclass(frozen=True, eq=False)
class Section:
    """A piece that scatters, in its own medium: ``place`` in the pile, its layer, its panels' tops below its own and
    sizes, each (panel,), and where they are among all; flux of unit beams from above and from below (n_in, S, n_col)
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
    def fades(self) -> Faces:
        """What is left at the Gauss points of light from the top and from the bottom, (panel, POINTS, n, 1)."""
        rows = self.on_nodes.rows[: self.on_nodes.n]
        from_top, from_bottom = (np.exp(-way[..., None] / rows) for way in (self.depths, self.thickness - self.depths))
        return from_top[..., None], from_bottom[..., None]

    @cached_property
    def along_nodes(self) -> Way:
        """What carries light along the nodes."""
        return Way.along(self.on_nodes.rows[: self.on_nodes.n], self.size)

    @cached_property
    def along_sights(self) -> Way:
        """What carries light along the directions off the nodes."""
        return Way.along(self.on_nodes.rows[self.on_nodes.n :], self.size)

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
            paths = np.repeat((np.abs(mu) * paths).swapaxes(1, 2), len(self.on_nodes.members), axis=1)
            return np.split(paths, 2, axis=1)

        (down, up), (up_again, down_again) = integrate(levels), integrate(self.thickness - levels)
        return down, up, down_again, up_again

    def scatter_beams(self, scattered: Scattered) -> tuple[Array, Faces]:
        """Light scattered once, from (2:24) in closed form: at Gauss points (2, panel, POINTS, n, b), and leaving."""
        n, stokes = self.on_nodes.n, len(self.on_nodes.members)
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

    def scatter(self, scattered: Scattered, light: Light, way: Way, rows: slice) -> tuple[Array, Faces]:
        """The same of light along the nodes, (2:27), along some rows."""
        n = self.on_nodes.n
        down, up = light.points[:, self.panels, :, self.nodes]
        ahead, back = scattered.ahead[rows, :n], scattered.back[rows, :n]
        sources = ahead @ down + back @ up, ahead @ up + back @ down
        nothing = np.zeros(sources[0].shape[2:])
        falls, rises = way.down(sources[0], nothing), way.up(sources[1], nothing)
        return np.stack([falls[0], rises[0]]), (rises[1][0], falls[1][-1])


class Sections:
    """What of a pile scatters, and light on its way along the nodes through all of it."""

    def __init__(self, passage: Passage, levels: int | None) -> None:
        self.passage, problem, media, cut = passage, passage.problem, passage.media, passage.cut
        self.joints = join_pieces(media.joints_along(media.cosines), cut)
        self.fade = find_fading_of_pieces(cut, media.cosines)
        self.scale = np.repeat(np.sqrt(media.nodes.measure), len(ALL))[:, None]
        on_nodes = {
            index: OnNodes(passage.of_medium(index, 1 + layer), BLACK)
            for layer, index in enumerate(media.scene.indices)
        }
        lowest = min(min(each.problem.nodes.min(), each.problem.mu0.min()) for each in on_nodes.values())
        scale = max(FINEST_SCALE, float(lowest))
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

    def solve_order(self, order: int, settings: Settings, convergence: Convergence) -> tuple[Array, Array, Array]:
        """Radiance for unit beams, (n_tau, n_in, n_col, n_out, S), public frame, and fluxes up and down, (n_tau, b)."""
        scattered = {section.place: section.on_nodes.scattered(order, section.layer) for section in self.sections}
        base, beam = self.find_base_light(order)
        once = self.once(scattered, beam)
        total, lit = sum_scatterings(
            once, lambda light: self.scatter(scattered, light, base), order, settings, convergence
        )
        up, down = self.passage.sum_fluxes(*(self.scale * total.edges))
        return self.see(scattered, lit, order), up, down

    def find_base_light(self, order: int) -> tuple[Array | None, Array]:
        """What the base makes of light on the nodes, (n, n) or None, and of beams, (n, b)."""
        matrix, light = self.passage.reflect_on_base(order)
        return None if matrix is None else matrix / self.scale * self.scale[:, 0], light / self.scale

    def once(self, scattered: dict[int, Scattered], beam: Array) -> Light:
        """Light scattered, or reflected by the base, once."""
        made = {section.place: section.scatter_beams(scattered[section.place]) for section in self.sections}
        return self.carry(made, beam)

    def scatter(self, scattered: dict[int, Scattered], light: Light, base: Array | None) -> Light:
        """Light that was scattered or reflected by the base once more than this."""
        made = {
            section.place: section.scatter(
                scattered[section.place], light, section.along_nodes, slice(0, section.on_nodes.n)
            )
            for section in self.sections
        }
        arriving = light.edges[0, -1]
        return self.carry(made, np.zeros_like(arriving) if base is None else base @ arriving)

    def carry(self, made: dict[int, tuple[Array, Faces]], from_base: Array) -> Light:
        """What sets out in the sections, at Gauss points and faces, and at the base, on its way through all joints;
        edges (4, joint, n, b): arriving, leaving, entering and rising at each."""
        count, (n, b) = self.joints.above.shape[0], from_base.shape
        sources = Passing(*np.zeros((4, count, n, b)))
        points = np.zeros((2, self.panels, POINTS, n, b))
        for section in self.sections:
            points[:, section.panels, :, section.nodes], (up, down) = made[section.place]
            sources.rising[section.place, section.nodes] += up
            sources.arriving[section.place + 1, section.nodes] += down
        sources.leaving[-1] += from_base
        stokes = (count, -1, len(ALL), b)
        found = pass_along(self.joints, self.fade, Passing(*(part.reshape(stokes) for part in vars(sources).values())))
        edges = np.stack([part.reshape(count, n, b) for part in vars(found).values()])
        _, leaving, entering, _ = edges
        for section in self.sections:
            from_top, from_bottom = section.fades
            here = points[:, section.panels, :, section.nodes]
            here[0] += from_top * entering[section.place, section.nodes]
            here[1] += from_bottom * leaving[section.place + 1, section.nodes]
        return Light(points, edges)

    def see(self, scattered: dict[int, Scattered], lit: Light | None, order: int) -> Array:
        """Radiance for unit beams of light that was scattered or reflected by the base once more than ``lit``."""
        passage = self.passage
        shape = passage.sights.cosines.shape[1], len(ALL), passage.problem.n_rhs
        sent = np.zeros((len(passage.sources), *shape))
        if lit is not None:
            for section in self.sections:
                rows = slice(section.on_nodes.n, None)
                _, faces = section.scatter(scattered[section.place], lit, section.along_sights, rows)
                for end, light in enumerate(faces):
                    sent[2 * section.place + end] = light.reshape(shape)
            if passage.base is not None:
                sent[-1] = passage.leave_base(order, self.scale * lit.edges[0, -1])
        return passage.look(sent)
