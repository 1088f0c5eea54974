"""What is varied for figures 2 to 9 of the GPU paper, (1), section 4: one axis for each pair of figures.

The layer is the paper's: gold spheres of radius 0.6 um at 400 nm, optical thickness 100 over black, 40 nodes, 11
outgoing cosines and 19 azimuths. On each axis all else stays as it is. The paper prints no values along its axes but
the radii, 0.2 to 0.7 um, sorted by the orders of expansion of their phase matrices; the values here are ours. No axis
goes below the nodes that carry every term of the phase matrix (terms <= 2 N), so that the number of nodes does not
change the number of Fourier orders.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from bench import cases
from bench.tables.paper import STEPS, TOTAL
from vrte.basics.arrays import Array
from vrte.scene.scene import Scene

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
        return self.scene.layers[0].phase_matrix.terms

    @property
    def scene(self) -> Scene:
        """The layer."""
        return cases.make_gold_scene(self.radius_um)


@dataclass(frozen=True)
class Claim:
    """How a step's cost grows in the paper: an exponent, in words, and the section that states it."""

    text: str
    section: str

    def __str__(self) -> str:
        return f"{self.text} ({self.section})"


@dataclass(frozen=True)
class Axis:
    """The name of what is varied, a property of `Point`, in increasing order; the two figures it is for (total time,
    time of each step), and what the paper claims of each step."""

    name: str
    title: str
    figures: tuple[int, int]
    points: tuple[Point, ...]
    varied: str
    claims: dict[str, Claim] = field(compare=False)

    def value(self, point: Point) -> float:
        """What stands on the axis for a point."""
        return float(getattr(point, self.varied))

    @property
    def values(self) -> Array:
        """Along the axis: (points,)."""
        return np.array([self.value(point) for point in self.points])


# title, figures, what of a point is varied, how far in full and where quick, and, of the total and the paper's steps
# (section 3), what it says. Of the nodes, 4.B.1 says quadratic or cubic, depending on the computation; which of the two
# is counted from section 3.
AXES = {
    "nodes": (
        *("quadrature nodes of a hemisphere", (2, 3), "nodes"),
        *((24, 32, 40, 48, 64, 80, 96, 128), (12, 16, 20, 24)),
        (("2 to 3", "4.B.1"), ("3", "3.A"), ("3", "3.B"), ("2 or 3", "4.B.1"), ("2", "3.D")),
    ),
    "outgoing": (
        *("outgoing directions (zenith angles)", (4, 5), "outgoing"),
        *((1, 2, 4, 8, 16, 32, 64, 128, 256, 512), (1, 4, 16, 64)),
        (("at most 1, by the reconstruction", "4.B.2"), *3 * (("0", "4.B.2"),), ("1", "4.B.2")),
    ),
    "orders": (
        *("orders of expansion of the phase matrix", (6, 7), "radius_um"),
        *(tuple(round(0.2 + 0.05 * step, 2) for step in range(11)), (0.2, 0.25, 0.3)),
        5 * (("1", "4.B.3"),),
    ),
    "incident": (
        *("incident directions", (8, 9), "incident"),
        *((1, 2, 4, 8, 16, 32, 64, 128, 256), (1, 4, 16)),
        (("at most 1, by all but the homogeneous", "4.C"), ("0", "4.C"), *3 * (("1", "4.C"),)),
    ),
}


def list_axes(quick: bool = False) -> tuple[Axis, ...]:
    """The four axes, in the order of the figures.

    >>> [axis.figures for axis in list_axes(quick=True)]
    [(2, 3), (4, 5), (6, 7), (8, 9)]
    """
    base = Point(radius_um=0.3, nodes=12) if quick else Point()
    found = []
    for name, (title, figures, varied, full, small, said) in AXES.items():
        points = [replace(base, **dict[str, Any]({varied: value})) for value in (small if quick else full)]
        shown = "terms" if varied == "radius_um" else varied
        points.sort(key=lambda point, shown=shown: getattr(point, shown))  # type: ignore[misc]
        claims = {step: Claim(*words) for step, words in zip((TOTAL, *STEPS), said, strict=True)}
        found.append(Axis(name, title, figures, tuple(points), shown, claims))
    return tuple(found)


def make_cosines(count: int) -> Array:
    """The middles of equal intervals from 0 to 1: (count,), never the normal, where most orders vanish.

    >>> make_cosines(2).tolist()
    [0.25, 0.75]
    """
    return (np.arange(count) + 0.5) / count
