"""The radiance field inside and outside a scene; and Stokes vectors in single geometries, as instruments in orbit list
them."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.results.result import Labelled, Result, describe_derivatives, describe_error

FIELD_DERIVATIVES = {  # dictionaries by names of numbers, and what they are the derivatives of
    "jacobian": "stokes",
    "flux_up_jacobian": "flux_up",
    "flux_down_jacobian": "flux_down",
    "direct_jacobian": "direct",
    "direct_up_jacobian": "direct_up",
}


@dataclass(frozen=True, eq=False, repr=False)
class Field(Result):
    """Stokes vectors of the diffuse light inside a scene or leaving it, with fluxes, as `vrte.radiance` finds them.

    Of several beams of the same Stokes vector, where ``mu0`` is an array (n_in,), ``stokes`` and the fluxes have an
    axis (n_in,) in front; `beam` is the field of one of them. Where light is refracted, cosines ``mu`` are those in the
    medium that the depth lies in. All arrays are read-only.

    Attributes
    ----------
    stokes
        I, Q, U, V, (n_tau, n_mu, n_phi, 4), without the direct beam [W m-2 sr-1 for an incident beam in W m-2].
    flux_up
        Flux of the diffuse light up through a horizontal plane, (n_tau,) [W m-2].
    flux_down
        The same down, (n_tau,) [W m-2].
    direct
        Flux of the beam, (n_tau,) [W m-2]: mu0 incident_stokes[0] exp(-tau/mu0), or where light is refracted that of
        all beams that go down. Lit from the bottom it goes up, with the thickness left above the bottom in place of
        tau.
    tau
        Optical depths, (n_tau,), which grow downward from the top.
    mu
        Signed cosines, (n_mu,): above 0 light that goes up, below 0 light that goes down.
    phi
        Azimuths from the beam's [degrees], (n_phi,), both along the direction of travel.
    mu0
        The beam's positive cosine, or those of several, (n_in,).
    incident_stokes
        The beam's flux vector I, Q, U, V, (4,), perpendicular to it [W m-2].
    diagnostics
        How it was found, by name.
    direct_up
        Flux of all beams that go up, (n_tau,) [W m-2], where light is refracted; else None.
    index
        Refractive index of the medium of each depth, (n_tau,), where light is refracted; else None.
    jacobian
        Derivatives of ``stokes`` by the names that were asked for, each of its shape, per unit of the number; None
        where none was. Depths at the faces of layers stay there, others where they are below the top of all.
    flux_up_jacobian
        The same of ``flux_up``.
    flux_down_jacobian
        The same of ``flux_down``.
    direct_jacobian
        The same of ``direct``.
    direct_up_jacobian
        The same of ``direct_up``; None where that is.

    Raises
    ------
    SceneError
        Where the shapes do not fit together.

    Examples
    --------
    >>> import vrte
    >>> haze = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=1.0, thickness=0.5)], vrte.Lambertian(1.0))
    >>> field = vrte.radiance(haze, mu0=0.6, mu=[], tau=[0.0, 0.5], nodes=8)
    >>> bool(abs(field.flux_up - field.flux_down - field.direct).max() < 1e-9)  # nothing is absorbed
    True
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
    jacobian: dict[str, Array] | None = None
    flux_up_jacobian: dict[str, Array] | None = None
    flux_down_jacobian: dict[str, Array] | None = None
    direct_jacobian: dict[str, Array] | None = None
    direct_up_jacobian: dict[str, Array] | None = None

    def __post_init__(self) -> None:
        beams = np.shape(self.mu0)
        depths = (*beams, np.size(self.tau))
        shapes: dict[str, tuple[int, ...]] = {"stokes": (*depths, np.size(self.mu), np.size(self.phi), 4)}
        shapes |= dict.fromkeys(("flux_up", "flux_down", "direct"), depths)
        shapes |= {"direct_up": depths} if self.direct_up is not None else {}
        shapes |= {"index": (np.size(self.tau),)} if self.index is not None else {}
        shapes |= {name: (np.size(getattr(self, name)),) for name in ("tau", "mu", "phi")} | {"incident_stokes": (4,)}
        if len(beams) > 1:
            raise SceneError(f"mu0 must be a number or a 1-D list, not of shape {beams}")
        self._freeze(shapes | ({"mu0": beams} if beams else {}))
        self._freeze_derivatives(FIELD_DERIVATIVES, shapes)
        if not beams:
            object.__setattr__(self, "mu0", float(self.mu0))

    def __repr__(self) -> str:
        beams = f"mu0={self.mu0:g}" if isinstance(self.mu0, float) else f"{self.mu0.size} mu0"
        return (
            f"Field({self.tau.size} tau, {self.mu.size} mu, {self.phi.size} phi, {beams}, "
            f"incident_stokes={self.incident_stokes.tolist()}{describe_derivatives(self.jacobian)}"
            f"{describe_error(self.diagnostics)})"
        )

    def beam(self, place: int) -> "Field":
        """The field of one beam of several, by its index in ``mu0``, without the axis of beams."""
        if isinstance(self.mu0, float):
            raise SceneError("this is the field of one beam: there are no others to choose from")
        if not -self.mu0.size <= place < self.mu0.size:
            raise SceneError.of("place", f"must be one of {self.mu0.size} beams, from 0 on, not {place}")
        place = int(place)  # 1.0 is a whole number, too
        names = ("stokes", "flux_up", "flux_down", "direct", *(("direct_up",) if self.direct_up is not None else ()))
        shares: dict[str, Any] = {name: getattr(self, name)[place] for name in names}
        for name in FIELD_DERIVATIVES:
            if (found := getattr(self, name)) is not None:
                shares[name] = {key: array[place] for key, array in found.items()}
        return replace(self, mu0=float(self.mu0[place]), **shares)


def require_one_beam(field: Field) -> float:
    """The cosine mu0 of a field of one beam, which is what a picture shows; SceneError for a field of several."""
    if isinstance(field.mu0, float):
        return field.mu0
    raise SceneError(f"a picture shows one beam, and these are {field.mu0.size}: take one by field.beam(place)")


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
