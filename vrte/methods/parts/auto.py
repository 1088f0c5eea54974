"""method="auto": the first rule that a request meets, by what is known before a solve.

The rules are written from the report of docs/explanation/methods.md; nobody's timings are read here. `python -m
bench.rules docs/explanation/methods/methods.csv` holds them against a report.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from vrte.methods.parts.method import NODES
from vrte.request.how import EXACT
from vrte.request.request import Request

EULER = 0.5772156649015329
ANGLES_A_TERM = 8  # at which a phase function's extremes are looked for


@dataclass(frozen=True)
class Rule:
    """A row: the method taken where all QUANTITIES keep to their limits, ``why``, and ``evidence``: runs (scene, curve,
    setting, accuracy) of the report that were good enough and quicker than the exact method."""

    name: str
    method: str
    why: str
    at_most: Mapping[str, float] = field(default_factory=dict)
    evidence: tuple[tuple[str, str, str, float], ...] = ()

    def takes(self, request: Request) -> bool:
        """Whether the request keeps to all limits; what the rule does not name is not worked out."""
        return all(QUANTITIES[name](request) <= most for name, most in self.at_most.items())


RULES = (
    Rule(
        name="scattered once",
        method="single-scattering",
        why="all light scattered more than once is less than the accuracy, by a bound",
        # more terms: the sums over azimuth of its fluxes take longer than discrete ordinates
        at_most={"special wishes": 0, "terms": 32, "scattered again over accuracy": 1.0},
        evidence=(("Rayleigh, thin", "single-scattering", "no knob", 1e-1),),
    ),
    Rule(
        name="accuracy",
        method=EXACT,
        why="the exact method was the quickest on every scene of the report",
    ),
)


def choose_by_rule(request: Request) -> Request:
    """The request with the method that the table takes, its nodes where the rule finds them, and the rule in words."""
    index, rule = find_rule(request)
    rule_text = f"auto, rule {index + 1} ({rule.name}): {rule.why}"
    if rule.method != EXACT:
        nodes_rule = "of the quadrature of fluxes"
        found = replace(request, method=rule.method, method_rule=rule_text, nodes=NODES, nodes_rule=nodes_rule)
        return replace(found, given=frozenset())  # the rules have used them
    return replace(request, method=rule.method, method_rule=rule_text)


def find_rule(request: Request) -> tuple[int, Rule]:
    """The index of the first rule that takes a request, and the rule; the last rule takes everything."""
    return next((index, rule) for index, rule in enumerate(RULES) if rule.takes(request))


def count_special_wishes(request: Request) -> float:
    """The number of things asked for besides scene, directions and accuracy, or beyond what rules were tried on."""
    scene, chosen = request.scene, (request.algorithm != "auto", request.truncation != "auto")
    bases = request.mu is None, scene.below.orders_reflected > 1, scene.needs_beam_paths, scene.has_flakes
    return float(sum((*chosen, *bases, request.verify, request.backend.needs_device)))


def bound_multiple_scattering(request: Request) -> float:
    """A bound on light scattered more than once over that scattered once into the same direction, over the accuracy:
    omega p_max z/(1 - z) over p_min e^(-tau/mu0) mu0/(mu0 + mu), z = omega p_max (1 - E_2(tau/2))."""
    scene, layer = request.scene, request.scene.layers[0]
    if len(scene.layers) > 1 or (scene.below.orders_reflected > 0):
        return math.inf
    if request.kind == "radiance" and request.columns[:, 1:].any() and not layer.phase_matrix.is_scalar:
        return math.inf
    again = layer.albedo * bound_caught_share(layer.thickness)
    if again > request.accuracy:  # too much already, whatever the phase function: p_max >= 1 >= p_min
        return again / request.accuracy
    a1 = layer.phase_matrix.a1
    phase = np.polynomial.legendre.legval(np.cos(np.linspace(0.0, np.pi, ANGLES_A_TERM * a1.size + 1)), a1)
    least, most = float(phase.min()), float(phase.max())  # to about a percent
    again *= most
    if not (least > 0.0 and again < 1.0):
        return math.inf
    beam = float(request.mu0.min())
    loss = math.exp(min(layer.thickness / beam, 700.0))
    if not request.tau.any():
        loss = min(loss, 1.0 + float(np.max(1.0 if request.mu is None else request.mu)) / beam)
    return most / least * loss * again / (1.0 - again) / request.accuracy


def bound_caught_share(thickness: float) -> float:
    """A bound on 1 - E_2(tau/2), by E_2(x) = e^-x - x E_1(x) and E_1(x) <= x - ln x - 0.577."""
    x = 0.5 * thickness
    return min(1.0, x * (1.0 - EULER - math.log(x) + x)) if x > 0.0 else 0.0


QUANTITIES: Mapping[str, Callable[[Request], float]] = {
    "special wishes": count_special_wishes,
    "terms": lambda request: float(max(layer.phase_matrix.terms for layer in request.scene.layers)),
    "scattered again over accuracy": bound_multiple_scattering,
}
