"""Stokes vectors in single geometries, as instruments in orbit list them."""

from dataclasses import dataclass
from typing import Any

from vrte.basics.arrays import Array
from vrte.results.result import Labelled


@dataclass(frozen=True, eq=False, repr=False)
class Views(Labelled):
    """Stokes vectors of the diffuse light in single geometries, a row each.

    ``stokes`` (n, 4) [W m-2 sr-1 for a beam in W m-2]; ``mu0``, ``mu``, ``phi`` (n,) as in `vrte.Field`; ``tau`` the
    depth of all, ``incident_stokes`` (4,) of all beams; ``diagnostics``: of the solves that it took, each for some of
    the rows, ``diagnostics["solves"]``. Where light is refracted, ``index`` is that of the medium that the depth lies
    in, whose cosines ``mu`` are; None elsewhere. All arrays are read-only.
    """

    stokes: Array
    mu0: Array
    mu: Array
    phi: Array
    tau: float
    incident_stokes: Array
    diagnostics: dict[str, Any]
    index: float | None = None

    def __post_init__(self) -> None:
        rows = (len(self.mu0),)
        self._freeze({"stokes": (*rows, 4), "mu0": rows, "mu": rows, "phi": rows, "incident_stokes": (4,)})

    def __repr__(self) -> str:
        return f"Views({self.mu0.size} geometries, tau={self.tau:g}, incident_stokes={self.incident_stokes.tolist()})"
