"""What the viewer and its worker processes send each other: tasks one way, messages the other (`worker`)."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vrte.basics.arrays import Array
from vrte.optics.phase_matrix import PhaseMatrix
from vrte.results.brdf import Brdf
from vrte.results.field import Field


@dataclass(frozen=True)
class Task:
    """Work for a worker process: ``call``, a function of this folder by its module and name, gets the form's content or
    a file's bytes, the folder of the tables that it names, and the keywords ``more``."""

    call: str
    content: Any = None
    folder: Path = Path()
    more: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Message:
    """Something that a worker process reports on a task; ``follows``: another message does."""

    follows = False


@dataclass(frozen=True)
class Refused(Message):
    """Why there is no answer, in a sentence."""

    message: str


@dataclass(frozen=True)
class Progress(Message):
    """How far a task is, from 0 to 1, and with what."""

    fraction: float
    stage: str
    follows = True


@dataclass(frozen=True, eq=False)
class Step(Progress):
    """A step that a fit has accepted: its values (n,), their chi2, and what the scene shows with them, (rows,)."""

    values: Array
    chi2: float
    predicted: Array


@dataclass(frozen=True)
class Adopted(Message):
    """The ``content`` that the form gets, and a sentence for each part that was filled in."""

    content: dict[str, Any]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Written(Message):
    """A file to be downloaded."""

    name: str
    data: bytes


@dataclass(frozen=True, eq=False)
class Fitted(Message):
    """What a fit found: ``content`` as it began, keys, values and errors (n,), inf or NaN where they are unknown,
    correlations (n, n), chi2, what the scene then shows (rows,); in sentences what the data cannot tell and what else
    is to be known; a page of all of it, b"" without."""

    content: dict[str, Any]
    names: tuple[str, ...]
    values: Array
    errors: Array
    correlations: Array
    chi2: float
    predicted: Array
    sentences: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    page: bytes = b""

    @classmethod
    def of_step(cls, task: Task, step: Step, why: str) -> "Fitted":
        """The last step of a fit that ended without a result, without errors."""
        names = tuple(task.more["free"])
        unknown = np.full(len(names), np.nan), np.full((len(names),) * 2, np.nan)
        notes = (f"{why}: these are the values of the last step, without errors",)
        return cls(task.content, names, step.values, *unknown, step.chi2, step.predicted, notes=notes)


class Planned(NamedTuple):
    """The plan of the BRDF at the first wavelength: its table, and what is left out and shared, line by line."""

    text: str
    left_out: tuple[str, ...]
    shared: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Reflectances:
    """Reflectances of unpolarized light incident along ``mu_i`` (n,): ``curves`` (wavelength, n) by the base, and where
    some light is mirrored as a beam, with that and without it.

    ``colours`` are "#rrggbb" by the same names, one a mu_i, of the scene under an evenly white, unpolarized sky seen
    from there: by reciprocity the same reflectances. ``why_none`` says why there are no colours.
    """

    mu_i: Array
    curves: dict[str, Array]
    colours: dict[str, tuple[str, ...]] = field(default_factory=dict)
    why_none: str = ""


@dataclass(frozen=True)
class Outcome(Message):
    """Everything there is to see: the scene as solved, None where a result file was ``opened`` that does not hold it;
    BRDFs and fields one a wavelength, or none; phase matrices by the names of their layers, at each wavelength."""

    content: dict[str, Any] | None
    wavelength_um: tuple[float, ...] = ()
    brdfs: tuple[Brdf, ...] = ()
    fields: tuple[Field, ...] = ()
    inside: tuple[dict[str, PhaseMatrix], ...] = ()
    plan: Planned | None = None
    notes: tuple[str, ...] = ()
    opened: bool = False
    reflectances: Reflectances | None = None

    @property
    def count(self) -> int:
        """The number of wavelengths."""
        return max(len(self.brdfs), len(self.fields))

    @property
    def size(self) -> int:
        """Bytes of the large arrays."""
        matrices = sum(one.mueller.nbytes * (1 if one.transmission is None else 2) for one in self.brdfs)
        return matrices + sum(field.stokes.nbytes for field in self.fields)


EMPTY = Outcome(None)
