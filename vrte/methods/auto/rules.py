"""The rules of method="auto", written from the report of docs/explanation/methods.md; nobody's timings are read here.

The first rule that a request meets is taken. Limits hold for quantities of `vrte.methods.auto.QUANTITIES`, the extremes
included. `python -m bench.rules docs/explanation/methods/methods.csv` holds it against a report.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from vrte.request.how import EXACT


@dataclass(frozen=True)
class Rule:
    """A row: the method taken where all quantities keep to their limits. ``why``, for ``diagnostics["method_rule"]``;
    ``evidence``: (scene, curve, setting, accuracy): runs of the report that were good enough for the accuracy, and
    quicker than the exact method that looks for its nodes itself."""

    name: str
    method: str
    why: str
    at_most: Mapping[str, float] = field(default_factory=dict)
    at_least: Mapping[str, float] = field(default_factory=dict)
    evidence: tuple[tuple[str, str, str, float], ...] = ()


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
        evidence=(),
    ),
)
