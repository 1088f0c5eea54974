"""What the viewer and its worker processes send each other: tasks one way, messages the other (`worker_process`)."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from vrte.app.form.checks import PartRead
from vrte.basics.arrays import Array
from vrte.basics.errors import Place
from vrte.optics.phase_matrix import PhaseMatrix
from vrte.results.brdf import Brdf
from vrte.results.field import Field


@dataclass(frozen=True)
class Solve:
    """A scene to solve: the form's content, and the folder of its tables."""

    content: dict[str, Any]
    folder: Path


@dataclass(frozen=True)
class Tensor(Solve):
    """The same for the directions of Mitsuba's tensor file, and the wavelengths [um] that it gets."""

    wavelengths_um: tuple[float, ...]


@dataclass(frozen=True)
class Look(Solve):
    """A part of a scene that is made from a file, by its ``place``, to be read alone: it is a stranger's file."""

    place: Place


@dataclass(frozen=True)
class Fit(Solve):
    """Numbers of a scene to be fitted to a measurement: its file's bytes, and start, low and high by each key."""

    data: bytes
    suffix: str
    free: dict[str, dict[str, float]]


@dataclass(frozen=True)
class Read:
    """A result file to read, its bytes: whatever is in them harms that process alone."""

    data: bytes
    suffix: str


@dataclass(frozen=True)
class Adopt:
    """A scene to be taken into the form: the bytes of its file, or the text of a link, which are a stranger's; and the
    ``names`` of the tables in ``folder`` that it may name."""

    given: bytes | str
    folder: Path
    names: frozenset[str]


Task = Solve | Read | Adopt | Any  # and the questions of `LiveQuery`


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
    """How far it is, from 0 to 1, and with what."""

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


@dataclass(frozen=True, eq=False)
class Fitted(Message):
    """What a fit found: ``content`` as it began, keys, values and errors (n,), inf or NaN where they are unknown,
    correlations (n, n), chi2, what the scene then shows (rows,); in sentences what the data cannot tell; a page of all
    of it, b"" without; and what else is to be known."""

    content: dict[str, Any]
    names: tuple[str, ...]
    values: Array
    errors: Array
    correlations: Array
    chi2: float
    predicted: Array
    sentences: tuple[str, ...] = ()
    page: bytes = b""
    notes: tuple[str, ...] = ()

    @classmethod
    def of_step(cls, task: Fit, step: Step, why: str) -> "Fitted":
        """What is left of a fit that ended without a result: its last step, without errors."""
        n = len(task.free)
        unknown = np.full(n, np.nan), np.full((n, n), np.nan)
        notes = (f"{why}: these are the values of the last step, without errors",)
        return cls(task.content, (*task.free,), step.values, *unknown, step.chi2, step.predicted, notes=notes)


@dataclass(frozen=True)
class Written(Message):
    """A file to be downloaded."""

    name: str
    data: bytes


@dataclass(frozen=True)
class Planned:
    """The plan of the BRDF at the first wavelength: its table, and what is left out and shared, line by line."""

    text: str
    left_out: tuple[str, ...] = ()
    shared: tuple[str, ...] = ()


@dataclass(frozen=True)
class Inside:
    """What the layers are made of, at one wavelength."""

    names: tuple[str, ...]
    phase_matrices: tuple[PhaseMatrix, ...]


@dataclass(frozen=True, eq=False)
class Reflectances:
    """Reflectances of unpolarized light: ``curves``, (wavelength, mu_i) by what lies beneath, and where some light is
    mirrored as a beam, with that and without it.

    ``colours`` are "#rrggbb" of the same names, one a mu_i, of the scene under an evenly white, unpolarized sky seen
    from there: by reciprocity the same reflectances. ``why_none`` says why there are no colours. ``mu_i`` (n,).
    """

    mu_i: Array
    curves: dict[str, Array]
    colours: dict[str, tuple[str, ...]] = field(default_factory=dict)
    why_none: str = ""


@dataclass(frozen=True)
class Outcome(Message):
    """Everything there is to see. ``content`` is the scene as solved, None where a result file was read; ``brdfs`` and
    ``fields`` are one a wavelength, either may be empty; ``inside`` too; ``wavelength_um`` is empty where unknown;
    ``opened``: from a file; ``reflectances`` of the BRDFs."""

    content: dict[str, Any] | None
    wavelength_um: tuple[float, ...] = ()
    brdfs: tuple[Brdf, ...] = ()
    fields: tuple[Field, ...] = ()
    inside: tuple[Inside, ...] = ()
    plan: Planned | None = None
    notes: tuple[str, ...] = ()
    opened: bool = False
    reflectances: Reflectances | None = None

    @property
    def count(self) -> int:
        """How many wavelengths there are."""
        return max(len(self.brdfs), len(self.fields))

    @property
    def size(self) -> int:
        """Bytes of its arrays, the small ones left out."""
        matrices = sum(one.mueller.nbytes * (1 if one.transmission is None else 2) for one in self.brdfs)
        return matrices + sum(field.stokes.nbytes for field in self.fields)


Answer = Outcome | Written | PartRead | Fitted | Adopted
