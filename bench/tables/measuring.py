"""Every problem in every configuration, one round after another, the configurations in turn."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from bench.tables import paper
from bench.tables.configurations import Configuration
from bench.tables.paper import TOTAL, Problem
from bench.tables.processes import Child, Reply, Task
from bench.timing import Tick, Times
from vrte.basics.errors import AccuracyError

ROUNDS, ROUNDS_QUICK = 9, 2
AGREE_TO = 1e-9  # relative to the largest: every configuration with the default one


@dataclass(frozen=True)
class Check:
    """Of one answer: ``gap`` to the default's, relative to the largest; ``published``: the largest relative error of
    Siewert's quoted values, None of other problems; ``orders_by``: Fourier orders by algorithm."""

    gap: float
    published: float | None
    orders_by: dict[str, int]

    @property
    def passed(self) -> bool:
        """Whether the answer counts."""
        return self.gap <= AGREE_TO and (self.published is None or self.published <= paper.PUBLISHED_TO)


@dataclass(frozen=True)
class Measured:
    """All solves that were timed, and what the answers were like: by (name of the problem, configuration)."""

    problems: tuple[Problem, ...]
    configurations: tuple[Configuration, ...]
    replies: dict[tuple[str, Configuration], list[Reply]] = field(default_factory=dict)
    checks: dict[tuple[str, Configuration], Check] = field(default_factory=dict)

    def times(self, problem: str, configuration: Configuration, step: str = TOTAL) -> Times | None:
        """Of the whole solve or of a step of it; None where it was not measured."""
        replies = self.replies.get((problem, configuration), [])
        seconds = [
            reply.seconds if step == TOTAL else paper.split_into_steps(reply.seconds, reply.stages)[step]
            for reply in replies
        ]
        return Times.of(seconds) if seconds else None

    def printed(self, problem: str, configuration: Configuration, step: str = TOTAL) -> float | None:
        """Seconds in the paper; None where it has none, and of a scene that is not the paper's."""
        asked = next(each for each in self.problems if each.name == problem)
        return paper.find_printed_seconds(problem, step, configuration.label) if asked.is_the_papers else None


def measure(
    children: Mapping[str, Child],
    problems: Sequence[Problem],
    configurations: Sequence[Configuration],
    threads: int,
    rounds: int = ROUNDS,
    tick: Tick = lambda done, total, name: None,
) -> Measured:
    """First every answer, checked and not timed, then ``rounds`` rounds. ``tick(done, total, name)`` before each solve.

    Raises what the solver raises, ChildProcessError where a process dies.
    """
    found = Measured(tuple(problems), tuple(configurations))
    total, done = (rounds + 1) * len(problems) * len(configurations), 0
    for number in range(rounds + 1):
        for problem in problems:
            answer = children["full"].solve(Task(problem, {}, True)).answer if number == 0 else None
            for configuration in configurations:
                tick(done, total, f"{problem.name}, {configuration.title}")
                task = Task(problem, configuration.options(threads), wants_answer=number == 0)
                reply = children[configuration.simd].solve(task)
                if answer is None:
                    found.replies.setdefault((problem.name, configuration), []).append(reply)
                else:
                    found.checks[problem.name, configuration] = check_answer(problem, reply, answer)
                done += 1
    tick(done, total, "")
    return found


def check_answer(problem: Problem, reply: Reply, reference: np.ndarray) -> Check:
    """An answer against the default's, and against Siewert's values where it has them."""
    assert reply.answer is not None
    published = paper.measure_siewert_error(reply.answer) if problem.name == paper.TABLE_2 else None
    return Check(paper.measure_difference(reply.answer, reference), published, reply.orders_by)


def require_right_answers(found: Measured) -> None:
    """Raises AccuracyError where an answer does not count."""
    wrong = [
        f"{problem} in {configuration.title} (off by {check.gap:.1e}"
        + (")" if check.published is None else f", from Siewert's values by {check.published:.1e})")
        for (problem, configuration), check in found.checks.items()
        if not check.passed
    ]
    if wrong:
        raise AccuracyError(f"the answers differ by more than {AGREE_TO:g}: {', '.join(wrong)}")
