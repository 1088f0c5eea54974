"""What the viewer and the process that solves for it tell each other, one pickle after another."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vrte.app.form.parts import Said
from vrte.app.solving.reflectance import Reflectances
from vrte.basics.errors import Place
from vrte.optics.phase_matrix import PhaseMatrix
from vrte.results.brdf import Brdf
from vrte.results.field import Field
from vrte.results.spectrum import Spectrum


@dataclass(frozen=True)
class Solve:
    """A scene to solve: the form's content, where its tables of coefficients lie, and how much memory it may take."""

    content: dict[str, Any]
    folder: Path
    memory_bytes: float


class Tensor(Solve):
    """The same for the directions of Mitsuba's tensor file."""


@dataclass(frozen=True)
class Read:
    """A result file to read, its bytes: whatever is in them harms that process alone."""

    data: bytes
    suffix: str
    memory_bytes: float


@dataclass(frozen=True)
class Look(Solve):
    """A part of a scene that is made from a file, by its ``place``, to be read alone: it is a stranger's file."""

    place: Place


@dataclass(frozen=True)
class Progress:
    """How far it is, from 0 to 1, and with what."""

    share: float
    stage: str


@dataclass(frozen=True)
class Written:
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


@dataclass(frozen=True)
class Outcome:
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

    def brdf_to_save(self) -> Brdf | Spectrum | None:
        """What goes into a file."""
        if len(self.brdfs) > 1:
            return Spectrum(np.array(self.wavelength_um), self.brdfs)
        return self.brdfs[0] if self.brdfs else None


Task = Solve | Read
Answer = Outcome | Written | Said | str  # in one sentence, why there is none
