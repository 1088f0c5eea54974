"""What is solved for Tables 2 and 3 of the GPU paper, and for its BRDF.

Table 2: the benchmark of Wauben and Hovenier, as in Siewert, JQSRT 64, 227 (2000), problem IIA. Table 3: gold spheres
of radius 0.6 um at 400 nm, optical thickness 100 over black, one beam at mu0 = 0.6, 11 zenith and 19 azimuth angles.
The BRDF is of the same layer; the paper prints neither its incident nor its outgoing directions, so those are ours.
"""

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.calls.brdf import brdf
from vrte.calls.radiance import radiance
from vrte.optics.phase_matrix import PhaseMatrix
from vrte.optics.spheres import spheres
from vrte.results.brdf import Brdf
from vrte.results.field import Field
from vrte.scene.layer import Layer
from vrte.scene.scene import Scene

# Siewert (2000), problem IIA: a1, a2, a3, a4, b1, b2 of the twelve degrees
SIEWERT_IIA = [
    [1.0, 0.0, 0.0, 0.915207, 0.0, 0.0],
    [2.104031, 0.0, 0.0, 2.095727, 0.0, 0.0],
    [2.095158, 3.726079, 3.615946, 2.008624, 0.116688, 0.065456],
    [1.414939, 2.202868, 2.240516, 1.436545, 0.20937, 0.221658],
    [0.703593, 1.190694, 1.139473, 0.706244, 0.227137, 0.097752],
    [0.235001, 0.391203, 0.365605, 0.238475, 0.144524, 0.052458],
    [0.064039, 0.105556, 0.082779, 0.056448, 0.05264, 0.009239],
    [0.012837, 0.020484, 0.013649, 0.009703, 0.0124, 0.001411],
    [0.00201, 0.003097, 0.001721, 0.001267, 0.002093, 0.000133],
    [0.000246, 0.000366, 0.000172, 0.00013, 0.000267, 1.1e-05],
    [2.4e-05, 3.5e-05, 1.4e-05, 1.1e-05, 2.7e-05, 1e-06],
    [2e-06, 3e-06, 1e-06, 1e-06, 2e-06, 0.0],
]
# the same tables, quoted, mu0 0.6, phi 90: I, Q, U, V at mu 0.5 up at the top, and at mu 0.2 down at tau 1
SIEWERT_UP = [1.24626e-1, 5.12123e-3, -8.04140e-3, 7.49254e-5]
SIEWERT_DOWN = [2.03778e-1, 8.17683e-3, -1.52561e-2, 1.02806e-4]
PUBLISHED_TO = 1e-5  # relative: six digits are printed
LEVELS = [0.0, 0.125, 0.25, 0.5, 0.75, 0.875, 1.0]  # optical depths of Siewert's tables


@dataclass(frozen=True)
class Problem:
    """One scene and request. ``name`` is the key of the tables, ``title`` their caption; ``directions`` of a BRDF."""

    name: str
    title: str
    nodes: int
    radius_um: float | None = None
    directions: tuple[int, int, int] | None = None
    is_the_papers: bool = True

    def solve(self, options: dict[str, Any]) -> Field | Brdf:
        """What the solver makes of it."""
        if self.radius_um is None:
            return siewert(self.nodes, options)
        if self.directions is None:
            return gold_radiance(self.radius_um, self.nodes, options)
        return gold_brdf(self.radius_um, self.nodes, self.directions, options)


TABLE_2, TABLE_3, BRDF = "table 2", "table 3", "brdf"
FULL_SIZE = (
    Problem(TABLE_2, "Siewert's scene, 30 nodes, 12 orders, 7 depths, 20 x 3 directions", 30),
    Problem(TABLE_3, "gold, radius 0.6 um, 400 nm, thickness 100, 40 nodes, mu0 0.6, 11 x 19 directions", 40, 0.6),
    Problem(BRDF, "the Mueller BRDF of the gold layer, 40 nodes, 20 x 20 x 37 directions", 40, 0.6, (20, 20, 37)),
)
SMALL = (
    FULL_SIZE[0],
    replace(FULL_SIZE[1], title="gold, radius 0.2 um, 12 nodes", nodes=12, radius_um=0.2, is_the_papers=False),
    Problem(BRDF, "the same, 4 x 4 x 5 directions", 12, 0.2, (4, 4, 5), is_the_papers=False),
)


def problems(quick: bool = False) -> tuple[Problem, ...]:
    """Table 2, Table 3 and the BRDF, the last two small for ``quick``."""
    return SMALL if quick else FULL_SIZE


def siewert_scene() -> Scene:
    """Spheroids with b2 != 0, albedo 0.973527, thickness 1."""
    return Scene([Layer(PhaseMatrix(*np.array(SIEWERT_IIA).T), 0.973527, 1.0)])


@cache
def gold_scene(radius_um: float) -> Scene:
    """Gold spheres at 400 nm, thickness 100."""
    return Scene([Layer.of(spheres("gold", radius_um=radius_um, wavelength_um=0.4), thickness=100.0)])


def siewert(nodes: int, options: dict[str, Any]) -> Field:
    """The tables' field: (7, 20, 3, 4)."""
    cosines = np.linspace(0.1, 1.0, 10)
    mu, phi = np.concatenate([cosines, -cosines]), [0.0, 90.0, 180.0]
    flux = (np.pi, 0.0, 0.0, 0.0)
    return radiance(siewert_scene(), mu0=0.6, stokes=flux, mu=mu, phi=phi, tau=LEVELS, nodes=nodes, **options)


def gold_radiance(radius_um: float, nodes: int, options: dict[str, Any]) -> Field:
    """The field at the top: (1, 11, 19, 4)."""
    mu, phi = np.linspace(0.05, 1.0, 11), np.arange(0.0, 181.0, 10.0)
    return radiance(gold_scene(radius_um), mu0=0.6, mu=mu, phi=phi, tau=0.0, nodes=nodes, **options)


def gold_brdf(radius_um: float, nodes: int, directions: tuple[int, int, int], options: dict[str, Any]) -> Brdf:
    """For so many incident and outgoing cosines and azimuths."""
    into, out, around = directions
    phi = np.linspace(0.0, 360.0, around)
    return brdf(
        gold_scene(radius_um), np.linspace(0.05, 1.0, into), np.linspace(0.05, 1.0, out), phi, nodes=nodes, **options
    )


def answer_of(result: Field | Brdf) -> Array:
    """The Stokes vectors or the Mueller matrices."""
    return result.stokes if isinstance(result, Field) else result.mueller


def difference(answer: Array, reference: Array) -> float:
    """The largest, relative to the largest of the reference.

    >>> difference(np.array([1.0, 2.5]), np.array([1.0, 2.0]))
    0.25
    """
    return float(np.abs(answer - reference).max() / np.abs(reference).max())


def off_siewert(answer: Array) -> float:
    """The largest relative error of the eight quoted values, in an answer to Table 2."""
    found = np.concatenate([answer[0, 4, 1], answer[-1, 11, 1]])  # mu 0.5 up at tau 0, mu 0.2 down at tau 1, phi 90
    published = np.array(SIEWERT_UP + SIEWERT_DOWN)
    return float(np.abs(found / published - 1.0).max())
