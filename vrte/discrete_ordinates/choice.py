"""Which of the two exact routes a scene takes: a rule written from measured accuracy and time (docs/accuracy.md)."""

from dataclasses import dataclass

import numpy as np

from vrte.discrete_ordinates.problem import Problem

ALGORITHMS = ("auto", "modes", "doubling")
DEEP = 1e-4  # of the light at the top: modes know a field to 1e-15 of what enters, not of itself


@dataclass(frozen=True)
class Choice:
    """The route's name and, in a few words, the reason."""

    name: str
    reason: str


def choose(algorithm: str, problem: Problem) -> Choice:
    """The route asked for, or for "auto" the one that the rule takes."""
    if algorithm != "auto":
        return Choice(algorithm, "asked for")
    if deepest(problem) < DEEP:
        return Choice("doubling", "auto: light at the deepest level is too faint for modes")
    return Choice("modes", "auto: modes are faster")


def deepest(problem: Problem) -> float:
    """A guess of the diffuse light at the deepest wanted level over that at the top: exp(-sum k thickness)."""
    asymmetry = problem.coefficients[:, 1, 0] / 3.0 if problem.coefficients.shape[1] > 1 else 0.0 * problem.albedo
    rate = np.minimum(1.0, np.sqrt(3.0 * (1.0 - problem.albedo) * (1.0 - problem.albedo * asymmetry)))
    level = int(np.argmax(problem.above[problem.level_layer] + problem.level))
    layer = problem.level_layer[level]
    depth = float(rate[:layer] @ problem.thickness[:layer] + rate[layer] * problem.level[level])
    return float(np.exp(-depth))
