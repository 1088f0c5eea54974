"""The problems of the GPU paper's Tables 2 and 3 and of its BRDF, and the seconds that it prints of them.

Table 2: the benchmark of Wauben and Hovenier, as in Siewert, JQSRT 64, 227 (2000), problem IIA. Table 3: gold spheres
of radius 0.6 um at 400 nm, optical thickness 100 over black, one beam at mu0 = 0.6, 11 zenith and 19 azimuth angles.
The BRDF is of the same layer; the paper prints neither its incident nor its outgoing directions, so those are ours.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bench import cases
from vrte.basics.arrays import Array
from vrte.calls.brdf import brdf
from vrte.calls.radiance import radiance
from vrte.results.brdf import Brdf
from vrte.results.field import Field

# Siewert's tables, quoted, mu0 0.6, phi 90: I, Q, U, V at mu 0.5 up at the top, and at mu 0.2 down at tau 1
SIEWERT_UP = [1.24626e-1, 5.12123e-3, -8.04140e-3, 7.49254e-5]
SIEWERT_DOWN = [2.03778e-1, 8.17683e-3, -1.52561e-2, 1.02806e-4]
PUBLISHED_TO = 1e-5  # relative: six digits are printed
LEVELS = [0.0, 0.125, 0.25, 0.5, 0.75, 0.875, 1.0]  # optical depths of Siewert's tables
TABLE_2, TABLE_3, BRDF = "table 2", "table 3", "brdf"


@dataclass(frozen=True)
class Problem:
    """One scene and request. ``name`` is the key of the tables, ``title`` their caption; ``radius_um`` of the gold,
    None of Siewert's scene; ``directions`` of a BRDF: incident and outgoing cosines, azimuths."""

    name: str
    title: str
    nodes: int
    radius_um: float | None = None
    directions: tuple[int, int, int] | None = None
    is_the_papers: bool = True

    def solve(self, options: dict[str, Any]) -> Field | Brdf:
        """The field at (7, 20, 3) depths and directions of Table 2, at (1, 11, 19) of Table 3, or the BRDF."""
        how = {"nodes": self.nodes, **options}
        if self.radius_um is None:
            cosines, flux = np.linspace(0.1, 1.0, 10), (np.pi, 0.0, 0.0, 0.0)
            mu, phi = np.concatenate([cosines, -cosines]), [0.0, 90.0, 180.0]
            return radiance(cases.find_scene("spheroids"), mu0=0.6, stokes=flux, mu=mu, phi=phi, tau=LEVELS, **how)
        gold = cases.make_gold_scene(self.radius_um)
        if self.directions is None:
            return radiance(
                gold, mu0=0.6, mu=np.linspace(0.05, 1.0, 11), phi=np.arange(0.0, 181.0, 10.0), tau=0.0, **how
            )
        into, out, around = self.directions
        return brdf(gold, np.linspace(0.05, 1.0, into), np.linspace(0.05, 1.0, out), np.linspace(0, 360, around), **how)


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


def list_problems(quick: bool = False) -> tuple[Problem, ...]:
    """Table 2, Table 3 and the BRDF, the last two small for ``quick``."""
    return SMALL if quick else FULL_SIZE


def get_answer(result: Field | Brdf) -> Array:
    """The Stokes vectors or the Mueller matrices."""
    return result.stokes if isinstance(result, Field) else result.mueller


def measure_difference(answer: Array, reference: Array) -> float:
    """The largest, relative to the largest of the reference.

    >>> measure_difference(np.array([1.0, 2.5]), np.array([1.0, 2.0]))
    0.25
    """
    return float(np.abs(answer - reference).max() / np.abs(reference).max())


def measure_siewert_error(answer: Array) -> float:
    """The largest relative error of the eight quoted values, in an answer to Table 2."""
    found = np.concatenate([answer[0, 4, 1], answer[-1, 11, 1]])  # mu 0.5 up at tau 0, mu 0.2 down at tau 1, phi 90
    return measure_difference(found / np.array(SIEWERT_UP + SIEWERT_DOWN), np.ones(8))


# An Intel Core i7 and an Nvidia GTX 580 in a laptop. Table 3 is called Table 4 in the paper's text; the total of
# configuration 6 is as printed, its steps add up to 11.28.
MACHINE = "Intel Core i7 and Nvidia GTX 580"
STEPS = ("homogeneous", "particular", "boundary", "reconstruction")
TOTAL, ASSEMBLY, OTHER = "total", "assembly", "other"
OWN_STEPS = (*STEPS, ASSEMBLY, OTHER)
LABELS = ("1", "2", "3", "4", "5", "6")
SECONDS = {
    key: dict(zip(LABELS, printed, strict=True))
    for key, printed in {
        (TABLE_2, TOTAL): (2.79, 2.74, 2.94, 0.99, 0.97, 1.18),
        (TABLE_3, "homogeneous"): (6.50, 6.11, 9.18, 6.07, 5.75, 8.43),
        (TABLE_3, "particular"): (0.04, 0.04, 0.07, 0.04, 0.04, 0.07),
        (TABLE_3, "boundary"): (0.24, 0.24, 0.25, 0.24, 0.24, 0.25),
        (TABLE_3, "reconstruction"): (22.1, 22.0, 22.1, 2.52, 2.51, 2.53),
        (TABLE_3, TOTAL): (28.9, 28.4, 31.5, 8.88, 8.56, 11.18),
    }.items()
} | {(BRDF, TOTAL): {"2": 7200.0, "5": 900.0}}  # "close to two hours", "15 minutes"
# Stages of the solver that are part of a step of the paper. Where no eigenproblem is solved, the reflection and
# transmission of the layer, found with the beams in it, stand for the homogeneous and the particular solution together,
# and joining for the boundary conditions.
WITHOUT_EIGENVECTORS = ("doubling", "invariance")
IN_RECONSTRUCTION = {"fourier sum": "reconstruction", "single scattering": "reconstruction"}  # (1:12), Q of (1:38)
STEP_OF_STAGE = {
    **{name: name for name in (*STEPS, ASSEMBLY)},
    **IN_RECONSTRUCTION,
    "joining": "boundary",
    **dict.fromkeys(WITHOUT_EIGENVECTORS, "homogeneous"),
}


def find_printed_seconds(problem: str, step: str, label: str) -> float | None:
    """Of a step in a configuration; None where the paper has none.

    >>> find_printed_seconds("table 3", "total", "5"), find_printed_seconds("brdf", "total", "1")
    (8.56, None)
    """
    return SECONDS.get((problem, step), {}).get(label)


def split_into_steps(seconds: float, stages: Mapping[str, float]) -> dict[str, float]:
    """Seconds of OWN_STEPS; what no step accounts for, planning and transfers among it, is OTHER.

    >>> split_into_steps(10.0, {"doubling": 4.0, "joining": 1.0, "fourier sum": 2.0, "planning": 1.0})["other"]
    3.0
    """
    found = dict.fromkeys(OWN_STEPS, 0.0)
    for stage, spent in stages.items():
        found[STEP_OF_STAGE.get(stage, OTHER)] += spent
    found[OTHER] += max(0.0, seconds - sum(stages.values()))
    return found


def has_no_eigenvectors(stages: Mapping[str, float]) -> bool:
    """Whether orders were solved by another algorithm than the paper's."""
    return any(stages.get(name, 0.0) > 0.0 for name in WITHOUT_EIGENVECTORS)
