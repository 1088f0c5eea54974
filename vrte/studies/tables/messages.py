"""What the processes of the two SIMD settings are told, and what they say: pickled, one after another."""

from dataclasses import dataclass
from typing import Any

from vrte.basics.arrays import Array
from vrte.studies.tables.problems import Problem


@dataclass(frozen=True)
class Hello:
    """A process is ready. ``cores``: for which processor each of its BLAS libraries took its kernels; ``versions``: of
    those libraries, in words; ``cpu_seconds`` of the process so far."""

    cores: tuple[str, ...]
    versions: tuple[str, ...]
    cpu_seconds: float


@dataclass(frozen=True)
class Task:
    """One solve; ``wants_answer``: whether the reply is to carry the radiances."""

    problem: Problem
    options: dict[str, Any]
    wants_answer: bool = False


@dataclass(frozen=True, eq=False)
class Reply:
    """Wall ``seconds`` of the call in the process itself, of its stages, and ``cpu_seconds`` of the process so far."""

    seconds: float
    stages: dict[str, float]
    orders_by: dict[str, int]
    cpu_seconds: float
    answer: Array | None = None


@dataclass(frozen=True)
class Failure:
    """A solve that raised: the error's class and what it said."""

    kind: str
    message: str
