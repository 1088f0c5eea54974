"""Optics of particles, computed once for each index, size, host and wavelength, and kept on disk for all workers."""

import dataclasses
import hashlib
import io
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from vrte.basics.errors import SceneError
from vrte.formats.atomic import read_sealed, write_sealed
from vrte.formats.particle_sources import check_particles, describe_value, make_particles
from vrte.optics.particles import Particles
from vrte.optics.phase_matrix import SEQUENCES, PhaseMatrix

IN_MEMORY = 256  # kinds of particle that a process remembers, some 10 kB each
NUMBERS = ("albedo", "asymmetry", "extinction_um2", "scattering_um2", "volume_um3", "host_index", "host_absorption")


class KeptOptics:
    """Makes particles of a source and its keywords, but looks first in ``folder``, whose last ones it remembers."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._read = lru_cache(IN_MEMORY)(read)

    def __call__(self, source: str, given: dict[str, Any]) -> Particles:
        try:
            found = self._read(self.folder / make_file_name(source, given))
        except (SceneError, OSError):  # a damaged file, or none
            return make_particles(source, given)
        return dataclasses.replace(found, balls=check_particles(source, given).balls)  # a recipe, and no work

    def keep(self, source: str, given: dict[str, Any]) -> Particles:
        """The same particles, written to the disk where they were not; of several callers at once, one computes."""
        import fcntl

        path = self.folder / make_file_name(source, given)
        if not path.is_file():
            with open(path.with_suffix(".lock"), "a") as lock:  # a killed process releases it
                fcntl.flock(lock, fcntl.LOCK_EX)
                if not path.is_file():
                    write(make_particles(source, given), path)
        return self(source, given)

    def remove_damaged(self) -> int:
        """Removes the files that cannot be read any more; returns their number."""
        damaged = []
        for path in self.folder.iterdir():
            try:
                path.suffix == ".lock" or read_sealed(path)
            except (SceneError, OSError):
                damaged.append(path)
        for path in damaged:
            path.unlink()
        return len(damaged)


def make_file_name(source: str, given: dict[str, Any]) -> str:
    """A file's name that stands for all digits of the keywords, and for the names of the numbers in the file."""
    key = [NUMBERS, source, sorted((name, describe_value(value)) for name, value in given.items())]
    return hashlib.sha256(repr(key).encode()).hexdigest()[:40]


def write(particles: Particles, path: Path) -> None:
    """Writes one kind of particle, all of it or nothing."""
    matrix = particles.phase_matrix
    sequences = {name: getattr(matrix, name) for name in SEQUENCES}
    numbers = {name: getattr(particles, name) for name in NUMBERS}
    content = io.BytesIO()
    np.savez(content, allow_pickle=False, description=particles.description, **sequences, **numbers)
    write_sealed(path, content.getvalue())


def read(path: Path) -> Particles:
    """The particles that `write` wrote, every digit as it was. Raises SceneError, OSError."""
    with np.load(io.BytesIO(read_sealed(path)), allow_pickle=False) as file:
        matrix = PhaseMatrix(**{name: file[name] for name in SEQUENCES})
        numbers = {name: float(file[name]) for name in NUMBERS}
        return Particles(matrix, description=str(file["description"]), **numbers)  # type: ignore[arg-type]
