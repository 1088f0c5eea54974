"""The radiance field inside and outside a scene."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.results.result import Result


@dataclass(frozen=True, eq=False, repr=False)
class Field(Result):
    """Stokes vectors of the diffuse subsurface light, with fluxes, at each depth and direction, of one beam or several.

    ``stokes`` (tau, mu, phi, 4) holds I, Q, U, V [W m-2 sr-1 for an incident beam in W m-2] without the direct beam.
    ``flux_up``, ``flux_down`` (tau,) are its fluxes through a horizontal plane [W m-2]; ``direct`` (tau,) is the
    beam's, mu0 * incident_stokes[0] * exp(-tau/mu0), upward and with the thickness left above the bottom in place of
    tau where ``diagnostics["illuminate"]`` is "bottom". ``tau`` grows downward from the top; ``mu`` > 0 is light going
    up, ``mu`` < 0 down; ``phi`` [deg] is relative to the beam, both along the direction of travel. ``mu0`` > 0 and
    ``incident_stokes`` (4,) describe the beam; ``diagnostics`` says how the field was made. Where ``mu0`` is an array
    (n_in,), beams of the same Stokes vector, ``stokes`` and the fluxes have its axis in front, and `beam` is the field
    of one of them. Where light is refracted, ``index`` (tau,) is the refractive index of the medium that each depth
    lies in, whose cosines ``mu`` are there, ``direct`` the flux of all that goes down as a beam, and ``direct_up``
    (tau,) of what goes up as one; both are None elsewhere. All arrays are read-only. Raises SceneError where the shapes
    do not fit together.
    """

    stokes: Array
    flux_up: Array
    flux_down: Array
    direct: Array
    tau: Array
    mu: Array
    phi: Array
    mu0: float | Array
    incident_stokes: Array
    diagnostics: dict[str, Any]
    direct_up: Array | None = None
    index: Array | None = None

    def __post_init__(self) -> None:
        beams = np.shape(self.mu0)
        depths = (*beams, len(self.tau))
        shapes: dict[str, tuple[int, ...]] = {"stokes": (*depths, len(self.mu), len(self.phi), 4)}
        shapes |= dict.fromkeys(("flux_up", "flux_down", "direct"), depths)
        shapes |= {"direct_up": depths} if self.direct_up is not None else {}
        shapes |= {"index": (len(self.tau),)} if self.index is not None else {}
        shapes |= {name: (len(getattr(self, name)),) for name in ("tau", "mu", "phi")} | {"incident_stokes": (4,)}
        if len(beams) > 1:
            raise SceneError(f"mu0 must be a number or a 1-D list, not of shape {beams}")
        self._freeze(shapes | ({"mu0": beams} if beams else {}))
        if not beams:
            object.__setattr__(self, "mu0", float(self.mu0))

    def __repr__(self) -> str:
        beams = f"mu0={self.mu0:g}" if isinstance(self.mu0, float) else f"{self.mu0.size} mu0"
        return (
            f"Field({self.tau.size} tau, {self.mu.size} mu, {self.phi.size} phi, {beams}, "
            f"incident_stokes={self.incident_stokes.tolist()})"
        )

    def beam(self, place: int) -> "Field":
        """The field of one beam of several, or SceneError where there is no such place among ``mu0``."""
        if isinstance(self.mu0, float):
            raise SceneError("this is the field of one beam: there are no others to choose from")
        if not -self.mu0.size <= place < self.mu0.size:
            raise SceneError(f"there are {self.mu0.size} beams, from 0 on, none at {place}")
        names = ("stokes", "flux_up", "flux_down", "direct", *(("direct_up",) if self.direct_up is not None else ()))
        shares = {name: getattr(self, name)[place] for name in names}
        return replace(self, mu0=float(self.mu0[place]), **shares)


def require_one_beam(field: Field) -> float:
    """The cosine mu0 of a field of one beam, which is what a picture shows; SceneError for a field of several."""
    if isinstance(field.mu0, float):
        return field.mu0
    raise SceneError(f"a picture shows one beam, and these are {field.mu0.size}: take one by field.beam(place)")
