"""What is varied for figures 2 to 9 of the GPU paper, (1), section 4: one axis for each pair of figures.

The layer is the paper's: gold spheres of radius 0.6 um at 400 nm, optical thickness 100 over black, 40 nodes, 11
outgoing cosines and 19 azimuths. On each axis all else stays as it is. The paper prints no values along its axes but
the radii, 0.2 to 0.7 um, sorted by the orders of expansion of their phase matrices; the values here are ours. No axis
goes below the nodes that carry every term of the phase matrix (terms <= 2 N), so that the number of nodes does not
change the number of Fourier orders.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.optics.spheres import Particles, spheres
from vrte.scene.layer import Layer
from vrte.scene.scene import Scene

WAVELENGTH_UM = 0.4
THICKNESS = 100.0
MU0 = 0.6
PHI = np.arange(0.0, 181.0, 10.0)  # [degrees]


@dataclass(frozen=True)
class Point:
    """One scene and request: what is solved. ``incident`` None is the radiance field of one beam along MU0."""

    radius_um: float = 0.6
    nodes: int = 40
    outgoing: int = 11
    incident: int | None = None

    @property
    def terms(self) -> int:
        """Orders of expansion of the phase matrix."""
        return gold(self.radius_um).phase_matrix.terms

    @property
    def scene(self) -> Scene:
        """The layer."""
        return Scene([Layer.of(gold(self.radius_um), thickness=THICKNESS)])


@dataclass(frozen=True)
class Axis:
    """What is varied, in increasing order, and the two figures it is for (total time, time of each step).

    ``value`` is what stands on the axis for a point.
    """

    name: str
    title: str
    figures: tuple[int, int]
    points: tuple[Point, ...]
    value: Callable[[Point], Any]

    @property
    def values(self) -> Array:
        """Along the axis: (points,)."""
        return np.array([self.value(point) for point in self.points], dtype=np.float64)


@dataclass(frozen=True)
class Extent:
    """How far the axes reach."""

    base: Point
    nodes: Sequence[int]
    outgoing: Sequence[int]
    radii_um: Sequence[float]
    incident: Sequence[int]


FULL = Extent(
    base=Point(),
    nodes=(24, 32, 40, 48, 64, 80, 96, 128),
    outgoing=(1, 2, 4, 8, 16, 32, 64, 128, 256, 512),
    radii_um=tuple(round(0.2 + 0.05 * step, 2) for step in range(11)),
    incident=(1, 2, 4, 8, 16, 32, 64, 128, 256),
)
QUICK = Extent(
    base=Point(radius_um=0.3, nodes=12),
    nodes=(12, 16, 20, 24),
    outgoing=(1, 4, 16, 64),
    radii_um=(0.2, 0.25, 0.3),
    incident=(1, 4, 16),
)


def axes(quick: bool = False) -> tuple[Axis, ...]:
    """The four axes, in the order of the figures.

    >>> [axis.figures for axis in axes(quick=True)]
    [(2, 3), (4, 5), (6, 7), (8, 9)]
    """
    extent = QUICK if quick else FULL
    base = extent.base
    sizes = sorted((replace(base, radius_um=radius) for radius in extent.radii_um), key=lambda point: point.terms)
    return (
        Axis(
            name="nodes",
            title="quadrature nodes of a hemisphere",
            figures=(2, 3),
            points=tuple(replace(base, nodes=count) for count in extent.nodes),
            value=lambda point: point.nodes,
        ),
        Axis(
            name="outgoing",
            title="outgoing directions (zenith angles)",
            figures=(4, 5),
            points=tuple(replace(base, outgoing=count) for count in extent.outgoing),
            value=lambda point: point.outgoing,
        ),
        Axis(
            name="orders",
            title="orders of expansion of the phase matrix",
            figures=(6, 7),
            points=tuple(sizes),
            value=lambda point: point.terms,
        ),
        Axis(
            name="incident",
            title="incident directions",
            figures=(8, 9),
            points=tuple(replace(base, incident=count) for count in extent.incident),
            value=lambda point: point.incident,
        ),
    )


@cache
def gold(radius_um: float) -> Particles:
    """Gold spheres of one radius, at WAVELENGTH_UM."""
    return spheres("gold", radius_um=radius_um, wavelength_um=WAVELENGTH_UM)


def cosines(count: int) -> Array:
    """The middles of equal intervals from 0 to 1: (count,), never the normal, where most orders vanish.

    >>> cosines(2).tolist()
    [0.25, 0.75]
    """
    return (np.arange(count) + 0.5) / count
