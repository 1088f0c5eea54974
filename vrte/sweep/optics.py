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

from vrte.optics.particles import Particles
from vrte.optics.phase_matrix import SEQUENCES, PhaseMatrix
from vrte.optics.spheres import spheres
from vrte.sweep.sealed import DamagedError, is_whole, read_sealed, write_sealed

IN_MEMORY = 256  # kinds of particle that a process remembers, some 10 kB each
NUMBERS = ("albedo", "asymmetry", "extinction_um2", "scattering_um2", "volume_um3", "host_index", "host_absorption")


class Optics:
    """Called like `vrte.spheres`, but looks for the answer first in ``folder``, whose last ones it remembers."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._read = lru_cache(IN_MEMORY)(read)

    def __call__(self, material: Any, **how: Any) -> Particles:
        try:
            return self._read(self._path(material, how))
        except DamagedError:
            return spheres(material, **how)

    def keep(self, material: Any, **how: Any) -> Particles:
        """The same, put on disk where it was not; of several that ask at once, one computes."""
        path = self._path(material, how)
        if not path.is_file():
            with lock_file(path.with_suffix(".lock")):
                if not path.is_file():
                    write(spheres(material, **how), path)
        return self(material, **how)

    def forget_damaged(self) -> int:
        """Takes away what cannot be read any more; how many files that were."""
        damaged = [path for path in self.folder.iterdir() if path.suffix != ".lock" and not is_whole(path)]
        for path in damaged:
            path.unlink()
        return len(damaged)

    def _path(self, material: Any, how: dict[str, Any]) -> Path:
        return self.folder / make_file_name(material, how)


def make_file_name(material: Any, how: dict[str, Any]) -> str:
    """A file's name that stands for the values, all digits of them, and for what is kept of them."""
    size = how.get("size")
    given = [NUMBERS, material, how["wavelength_um"], how.get("host_index", 1.0), how.get("radius_um")]
    given += [] if size is None else [type(size).__name__, dataclasses.astuple(size)]
    return hashlib.sha256(repr(given).encode()).hexdigest()[:40]


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
