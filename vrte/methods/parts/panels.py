"""Panels that layers are cut into, Gauss depths in each, and light carried through them."""

import math
from dataclasses import dataclass

import numpy as np

from vrte.basics.arrays import Array
from vrte.methods.parts.in_depth import find_gauss_depths, weigh_downward, weigh_upward

POINTS = 4  # Gauss depths of a panel: error of the 8th order in its thickness
FINEST_SCALE = 1e-3  # panels at a face are no finer than light along the lowest cosine asks for, nor than this
MOST_LEVELS = 4096
FINE_DEPTHS = 20_001
DENSITY = 1.5  # panels for a factor e of distance to a face, and for an optical depth of 1
Pair = tuple[Array, Array]


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
