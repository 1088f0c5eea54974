"""Which of the two exact routes a scene takes: a rule written from measured accuracy and time (docs/accuracy.md)."""

from dataclasses import dataclass

import numpy as np

from vrte.discrete_ordinates.problem import Problem
from vrte.discrete_ordinates.slabs import Pile, cut

ALGORITHMS = ("auto", "modes", "doubling")
THIN = 1e-5  # fluxes by modes are right to 1e-16 over the optical thickness that scatters
STEPS_ENDLESS = 8
JOINT = 0.2  # time of a joint over that of a layer's modes
WORTH_IT = 0.7  # predicted times are right to about a third


@dataclass(frozen=True)
class Choice:
    """The route's name and, in a few words, the reason."""

    name: str
    reason: str


def choose(algorithm: str, problem: Problem) -> Choice:
    """The route asked for, or for "auto" the one that the rule takes."""
    if algorithm != "auto":
        return Choice(algorithm, "asked for")
    if float(problem.thickness[problem.albedo > 0.0].sum()) < THIN:
        return Choice(
            "doubling", f"auto: what scatters is thinner than {THIN:g}, where modes lose digits of the fluxes"
        )
    ratio = time_of_doubling(cut(problem)) / problem.albedo.size
    name = "doubling" if ratio < WORTH_IT else "modes"
    return Choice(name, f"auto: doubling is predicted to take {ratio:.2g} times the time of modes")


def time_of_doubling(pile: Pile) -> float:
    """Predicted time of an order, in units of one layer's modes."""
    problem = pile.problem
    steepest = 1.0 / float(problem.directions.min())
    with np.errstate(divide="ignore"):
        steps = np.clip(np.ceil(np.log2(pile.thickness * steepest)), 0.0, None) + 2.0
    steps[np.isinf(pile.thickness)] = STEPS_ENDLESS
    return float(steps.sum()) * (0.1 + problem.size / 1500.0) + JOINT * pile.slabs.size
