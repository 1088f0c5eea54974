"""The rules of method="auto", written from the report of docs/explanation/methods.md; nobody's timings are read here.

The first rule that a request meets is taken. Limits hold for quantities of `vrte.methods.auto.QUANTITIES`, the extremes
included. `python -m vrte.studies.methods.rules docs/explanation/methods/methods.csv` holds it against a report.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from vrte.request.how import EXACT


@dataclass(frozen=True)
class Rule:
    """A row: the method taken, on nodes estimated for the accuracy over ``margin`` and not checked (None: nodes as the
    method finds them), where all quantities keep to their limits. ``why``, for ``diagnostics["method_rule"]``;
    ``evidence``: (scene, curve, setting, accuracy): runs of the report that were good enough for the accuracy, and
    quicker than the exact method that looks for its nodes itself."""

    name: str
    method: str
    why: str
    at_most: Mapping[str, float] = field(default_factory=dict)
    at_least: Mapping[str, float] = field(default_factory=dict)
    margin: float | None = None
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
        name="nodes unchecked",
        method=EXACT,
        why="a small problem, solved in the time that a check of its nodes takes: nodes are estimated with a margin",
        # estimates were found wrong beyond a fading of 20, up to 100 times; layers and terms: as many as were tried;
        # cubes: where the margin costs what the check does
        at_most={"special wishes": 0, "layers": 3, "terms": 300, "fading": 8.0, "cubes": 3e6},
        at_least={"accuracy": 1e-6, "lowest cosine": 0.02},
        margin=2.0,
        evidence=(
            ("Rayleigh, thin", f"{EXACT}, modes", "16 nodes", 1e-3),
            ("isotropic", f"{EXACT}, modes", "32 nodes", 1e-6),
            ("aerosol, thin", f"{EXACT}, modes", "16 nodes", 1e-4),
            ("cloud", f"{EXACT}, modes", "16 nodes", 1e-2),
            ("gold powder", f"{EXACT}, modes", "4 nodes", 1e-2),
            ("white, without end", f"{EXACT}, modes", "16 nodes", 1e-4),
            ("normal incidence", f"{EXACT}, modes", "32 nodes", 1e-6),
            ("two layers over a base", f"{EXACT}, modes", "4 nodes", 1e-2),
        ),
    ),
    Rule(
        name="accuracy",
        method=EXACT,
        why="the exact method was the quickest on every scene of the report",
        evidence=(),
    ),
)
