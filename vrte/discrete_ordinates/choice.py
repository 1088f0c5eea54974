"""Which of the two exact routes a scene takes: a rule written from measured accuracy and time (docs/accuracy.md)."""

from dataclasses import dataclass

from vrte.discrete_ordinates.problem import Problem

ALGORITHMS = ("auto", "modes", "doubling")
THIN = 1e-5  # fluxes by modes are right to 1e-16 over the optical thickness that scatters


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
        return Choice("doubling", f"auto: what scatters is thinner than {THIN:g}")
    return Choice("modes", "auto: modes are faster")
