"""Optics of particles, computed once for each index, size, host and wavelength, and kept on disk for all workers."""

import dataclasses
import hashlib
import io
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from vrte.formats.particle_sources import check_particles, describe_value, make_particles
from vrte.optics.particles import Particles
from vrte.optics.phase_matrix import SEQUENCES, PhaseMatrix
from vrte.sweep.sealed import DamagedError, is_whole, read_sealed, write_sealed

IN_MEMORY = 256  # kinds of particle that a process remembers, some 10 kB each
NUMBERS = ("albedo", "asymmetry", "extinction_um2", "scattering_um2", "volume_um3", "host_index", "host_absorption")


class Optics:
    """Makes particles of a source and its keywords, but looks first in ``folder``, whose last ones it remembers."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._read = lru_cache(IN_MEMORY)(read)

    def __call__(self, source: str, given: dict[str, Any]) -> Particles:
        try:
            found = self._read(self._path(source, given))
        except DamagedError:
            return make_particles(source, given)
        return dataclasses.replace(found, balls=check_particles(source, given).balls)  # a recipe, and no work

    def keep(self, source: str, given: dict[str, Any]) -> Particles:
        """The same, put on disk where it was not; of several that ask at once, one computes."""
        path = self._path(source, given)
        if not path.is_file():
            with lock_file(path.with_suffix(".lock")):
                if not path.is_file():
                    write(make_particles(source, given), path)
        return self(source, given)

    def forget_damaged(self) -> int:
        """Takes away what cannot be read any more; how many files that were."""
        damaged = [path for path in self.folder.iterdir() if path.suffix != ".lock" and not is_whole(path)]
        for path in damaged:
            path.unlink()
        return len(damaged)

    def _path(self, source: str, given: dict[str, Any]) -> Path:
        return self.folder / make_file_name(source, given)


def make_file_name(source: str, given: dict[str, Any]) -> str:
    """A file's name that stands for the values, all digits of them, and for what is kept of them."""
    said = [NUMBERS, source, sorted((name, describe_value(value)) for name, value in given.items())]
    return hashlib.sha256(repr(said).encode()).hexdigest()[:40]


def write(particles: Particles, path: Path) -> None:
    """One kind of particle, all of it or nothing."""
    matrix = particles.phase_matrix
    sequences = {name: getattr(matrix, name) for name in SEQUENCES}
    numbers = {name: getattr(particles, name) for name in NUMBERS}
    content = io.BytesIO()
    np.savez(content, allow_pickle=False, description=particles.description, **sequences, **numbers)
    write_sealed(path, content.getvalue())


def read(path: Path) -> Particles:
    """What `write` wrote, every digit as it was. Raises DamagedError."""
    with np.load(io.BytesIO(read_sealed(path)), allow_pickle=False) as file:
        matrix = PhaseMatrix(**{name: file[name] for name in SEQUENCES})
        numbers = {name: float(file[name]) for name in NUMBERS}
        return Particles(matrix, description=str(file["description"]), **numbers)  # type: ignore[arg-type]


@contextmanager
def lock_file(path: Path) -> Iterator[None]:
    """Waits until no other thread or process is in here with the same file; a killed one leaves."""
    import fcntl

    with open(path, "a") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
