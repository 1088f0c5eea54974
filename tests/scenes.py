"""The scenes that every way of solving them is tested on (tests/test_every_way.py), and their right answers.

Ball arithmetic answers: for cases of the study of stability from a table (tests/stability_oracle.npz), for smooth
interfaces and mirrors while the tests run (tests/oracle.py). Scenes with rough interfaces and named bases have no
oracle: their ways are compared with each other.
"""

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np

import vrte
from bench.stability import OracleAnswer, find_oracle_answer, make_azimuths, read_oracle_table
from bench.stability_cases import BEAM, list_oracle_cases

from . import oracle


@dataclass(frozen=True, eq=False)
class Problem:
    """A scene and what is asked of it: mu0, signed cosines mu, azimuths phi [degrees] at equal steps, optical depths
    tau, nodes; ``answer``: that of the table, or None; ``known``: whether tests/oracle.py has another."""

    scene: vrte.Scene
    mu0: float
    mu: np.ndarray
    phi: np.ndarray
    tau: np.ndarray
    nodes: int
    answer: OracleAnswer | None = None
    known: bool = False

    @property
    def c(self) -> float:
        """What the answer changes by, relatively, when a number of the scene moves by one unit in the last place."""
        return max(self.answer.c.values()) if self.answer else 0.0

    @property
    def ends(self) -> bool:
        """Whether it has a bottom."""
        return bool(np.isfinite(self.scene.thickness))

    @property
    def is_white(self) -> bool:
        """Whether no layer absorbs."""
        return all(layer.albedo == 1.0 or layer.thickness == 0.0 for layer in self.scene.layers)

    @property
    def reflects_everything(self) -> bool:
        """Whether it is white, and semi-infinite or over white."""
        return self.is_white and (not self.ends or self.scene.base == vrte.Lambertian(1.0))

    @cached_property
    def right(self) -> oracle.Answer:
        """Ball arithmetic's answer for the directions of `ask_table`."""
        terms = max(layer.phase_matrix.terms for layer in self.scene.layers)
        asked = self.ask_table()
        return oracle.brdf(self.scene, asked["mu_i"], asked["mu_o"], self.nodes, range(terms))

    def ask_field(self) -> dict[str, Any]:
        """The arguments of `vrte.radiance`."""
        asked = {"mu0": self.mu0, "stokes": BEAM, "mu": self.mu, "phi": self.phi, "tau": self.tau}
        return asked | {"nodes": self.nodes}

    def ask_table(self) -> dict[str, Any]:
        """The arguments of `vrte.brdf`: two incident directions, which are looked along as well, at 0, 45, 180 and 315
        degrees."""
        up = np.unique(np.append(self.mu[self.mu > 0.0], 0.35))
        asked = {"mu_i": [self.mu0, 0.35], "mu_o": up, "phi": [0.0, 45.0, 180.0, 315.0], "nodes": self.nodes}
        return asked | {"transmission": self.ends}


def make_plain_problems() -> dict[str, Problem]:
    """Cases of the study of stability whose nodes carry all terms: the corners, and some of the covering array."""
    cases = [case for case in list_oracle_cases() if case.resolved and case.layering != "hundred" and case.beam == BEAM]
    corners = [case for case in cases if case.reason]
    others = [case for case in cases if not case.reason and case.nodes == 8 and case.base_kind != "lobe"]
    table, found = read_oracle_table(), {}
    for each in (*corners, *others[::2]):
        answer = find_oracle_answer(each, table)
        assert isinstance(answer, OracleAnswer), each.name
        case = answer.case
        found[case.name] = Problem(case.scene, case.mu0, case.mu, make_azimuths(case), case.tau, case.nodes, answer)
    return found


AIR, PAINT = vrte.rayleigh(), vrte.henyey_greenstein(0.3, 5)
TURNING = vrte.PhaseMatrix(
    *(vrte.rayleigh(0.1).coefficients + np.outer([0, 0, 0.3], np.eye(6)[5])).T
)  # b2 != 0: V from U
GLASS, SILVER = vrte.Interface(1.0, 1.5), vrte.Mirror((0.05, 3.0))
layer = vrte.Layer


def make_leaf(mu_i: Any, mu_o: Any, phi_deg: Any) -> np.ndarray:
    """A base that polarizes, and reflects orders 0 and 1: (..., 4, 4) [1/sr]."""
    cosine = np.cos(np.radians(phi_deg)) * mu_i * mu_o
    found = np.zeros((*cosine.shape, 4, 4))
    found[..., 0, 0] = 0.1 + 0.02 * cosine
    found[..., 1, 0] = found[..., 0, 1] = 0.02 * mu_i * mu_o
    found[..., 1, 1] = found[..., 2, 2] = 0.03
    return found


KNOWN = {
    "glass over black": vrte.Scene([GLASS, layer(TURNING, 0.95, 0.8)], vrte.Lambertian(0.0)),
    "a dense medium over white": vrte.Scene([vrte.Interface(1.0, 4.0), layer(TURNING, 1.0, 5.0)], vrte.Lambertian(1.0)),
    "glass over white": vrte.Scene([GLASS, layer(AIR, 1.0, 0.8)], vrte.Lambertian(1.0)),
    "glass over Lambertian, nothing else": vrte.Scene([GLASS], vrte.Lambertian(0.7)),
    "almost no surface": vrte.Scene([vrte.Interface(1.0, 1.0001), layer(TURNING, 1.0, 0.8)], vrte.Lambertian(0.4)),
    "plate": vrte.Scene([GLASS, layer(AIR, 0.9, 0.5), GLASS.turned]),
    "plate, conservative": vrte.Scene([GLASS, layer(TURNING, 1.0, 3.0), GLASS.turned]),
    "varnish over paint": vrte.Scene(
        [GLASS, layer(AIR, 0.3, 0.1), vrte.Interface(1.5, 1.33), layer(AIR, 0.95, 1.0)], vrte.Lambertian(0.4)
    ),
    "air over sea": vrte.Scene([layer(AIR, 1.0, 0.3), vrte.Interface(1.0, 1.34), layer(PAINT, 0.8, 1.0)], SILVER),
    "three media": vrte.Scene(
        [layer(AIR, 0.9, 0.3), GLASS, layer(TURNING, 1.0, 1.0), vrte.Interface(1.5, 1.3), layer(AIR, 0.9, 0.4)],
        vrte.Lambertian(0.5),
    ),
    "varnish that scatters nothing, over paint on metal": vrte.Scene(
        [vrte.Interface(1.0, 1.3), layer(AIR, 0.0, 0.2), vrte.Interface(1.3, 1.5), layer(TURNING, 0.95, 0.5)], SILVER
    ),
    "gap of air in glass": vrte.Scene([GLASS.turned, layer(TURNING, 0.9, 0.5), GLASS]),
    "towards a thinner medium": vrte.Scene([vrte.Interface(1.33, 0.7), layer(TURNING, 0.5, 0.3)]),
    "lit from glass, over glass": vrte.Scene([vrte.Interface(1.5, 1.25), layer(TURNING, 0.9, 0.5)], vrte.Mirror(1.4)),
    "mirror": vrte.Scene([layer(TURNING, 0.95, 0.6)], SILVER),
    "perfect mirror under n=4": vrte.Scene(
        [vrte.Interface(1.0, 4.0), layer(TURNING, 1.0, 1.0)], vrte.Mirror(1e-3 + 1e3j)
    ),
    "glass, semi-infinite": vrte.Scene([GLASS, layer(AIR, 0.9, 0.3), layer(TURNING, 0.95, np.inf)]),
    "more terms than nodes carry": vrte.Scene([layer(vrte.henyey_greenstein(0.4, 12), 0.9, 1.0)]),
}
COMPARED = {
    "glass, semi-infinite, conservative": vrte.Scene([GLASS, layer(TURNING, 1.0, np.inf)]),
    "leaf": vrte.Scene([layer(TURNING, 0.9, 0.5)], vrte.MuellerBase(make_leaf)),
    "leaf under glass": vrte.Scene([GLASS, layer(PAINT, 0.9, 0.5)], vrte.MuellerBase(make_leaf)),
    "soil under air": vrte.Scene([layer(AIR, 1.0, 0.3)], vrte.RPV(0.1, 0.8, -0.1)),
    "rough sea": vrte.Scene([layer(AIR, 0.9, 0.2), vrte.Interface(1.0, 1.34, roughness=0.3), layer(AIR, 0.8, 1.0)]),
    "frosted plate": vrte.Scene(
        [vrte.Interface(1.0, 1.5, roughness=0.4, distribution="ggx"), layer(TURNING, 0.9, 0.5), GLASS.turned]
    ),
}


def make_problem(scene: vrte.Scene, **more: Any) -> Problem:
    """On 4 nodes: directions that all media know, up and down, and depths at the faces and inside."""
    inside, bottom = (0.3, []) if np.isinf(scene.thickness) else (0.3 * scene.thickness, [scene.thickness])
    mu = np.array([0.35, 0.6, 0.9, -0.35, -0.6, -0.9])
    tau = np.unique([0.0, inside, *bottom])
    return Problem(scene, 0.6, mu, np.arange(16) * 22.5, tau, 4, **more)


@cache
def find_problems() -> dict[str, Problem]:
    """All of them by name."""
    known = {name: make_problem(scene, known=True) for name, scene in KNOWN.items()}
    return make_plain_problems() | known | {name: make_problem(scene) for name, scene in COMPARED.items()}
