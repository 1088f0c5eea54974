"""Stokes vectors in single geometries, as instruments in orbit list them."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.results.result import Labelled


@dataclass(frozen=True, eq=False, repr=False)
class Views(Labelled):
    """Stokes vectors of the diffuse light in single geometries, a row each, as `vrte.views` finds them.

    All arrays are read-only.

    Attributes
    ----------
    stokes
        I, Q, U, V, (n, 4) [W m-2 sr-1 for a beam in W m-2].
    mu0
        Positive cosines of the beams, (n,).
    mu
        Signed cosines of the lines of sight, (n,): above 0 light that goes up.
    phi
        Azimuths from each beam's [degrees], (n,).
    tau
        The optical depth of all.
    incident_stokes
        The flux vector of all beams, (4,), perpendicular to them [W m-2].
    diagnostics
        ``diagnostics["solves"]`` lists those of the solves that it took, each for some of the rows.
    index
        Refractive index of the medium that the depth lies in, where light is refracted; else None.

    Examples
    --------
    >>> import vrte
    >>> haze = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=1.0, thickness=0.5)])
    >>> vrte.views(haze, mu0=[0.5, 0.6], mu=[0.9, 0.8], phi=[0.0, 90.0], nodes=4)
    Views(2 geometries, tau=0, incident_stokes=[1.0, 0.0, 0.0, 0.0])
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
        rows = (np.size(self.mu0),)
        self._freeze({"stokes": (*rows, 4), "mu0": rows, "mu": rows, "phi": rows, "incident_stokes": (4,)})

    def __repr__(self) -> str:
        return f"Views({self.mu0.size} geometries, tau={self.tau:g}, incident_stokes={self.incident_stokes.tolist()})"
