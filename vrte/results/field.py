"""The radiance field inside and outside a scene."""

import os
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.arrays import Array, frozen, is_settled
from vrte.basics.errors import SceneError
from vrte.basics.views import view

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class Field:
    """Stokes vectors of the diffuse subsurface light, with fluxes, at each depth and direction, of one beam or several.

    ``stokes`` (tau, mu, phi, 4) holds I, Q, U, V [W m-2 sr-1 for an incident beam in W m-2] without the direct beam.
    ``flux_up``, ``flux_down`` (tau,) are its fluxes through a horizontal plane [W m-2]; ``direct`` (tau,) is the
    beam's, mu0 * incident_stokes[0] * exp(-tau/mu0), upward and with the thickness left above the bottom in place of
    tau where ``diagnostics["illuminate"]`` is "bottom". ``tau`` grows downward from the top; ``mu`` > 0 is light going
    up, ``mu`` < 0 down; ``phi`` [deg] is relative to the beam, both along the direction of travel. ``mu0`` > 0 and
    ``incident_stokes`` (4,) describe the beam; ``diagnostics`` says how the field was made. Where ``mu0`` is an array
    (n_in,), beams of the same Stokes vector, ``stokes`` and the fluxes have its axis in front, and `beam` is the field
    of one of them. All arrays are read-only. Raises SceneError where the shapes do not fit together.
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

    def __post_init__(self) -> None:
        beams = np.shape(self.mu0)
        depths = (*beams, len(self.tau))
        shapes = {
            "stokes": (*depths, len(self.mu), len(self.phi), 4),
            "flux_up": depths,
            "flux_down": depths,
            "direct": depths,
            "tau": (len(self.tau),),
            "mu": (len(self.mu),),
            "phi": (len(self.phi),),
            "incident_stokes": (4,),
        }
        if len(beams) > 1:
            raise SceneError(f"mu0 must be a number or a 1-D list, not of shape {beams}")
        freeze(self, shapes | ({"mu0": beams} if beams else {}))
        if not beams:
            object.__setattr__(self, "mu0", float(self.mu0))

    def __reduce__(self) -> tuple[Any, ...]:
        # through the constructor: an unpickled array would otherwise be writable
        return type(self), tuple(getattr(self, field.name) for field in fields(self))

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
        shares = {name: getattr(self, name)[place] for name in ("stokes", "flux_up", "flux_down", "direct")}
        return replace(self, mu0=float(self.mu0[place]), **shares)

    def _repr_html_(self) -> str:
        return view(self, "_repr_html_")

    def plot(self) -> "Figure":
        """I and the degree of polarization against mu, at some depths and azimuths, or beams at the first azimuth.

        Raises SceneError for a field of fluxes alone, MissingExtraError without the extra "plot"."""
        return view(self, "plot")

    def to_xarray(self) -> "xarray.Dataset":
        """An xarray.Dataset: ``stokes`` with dims (tau, mu, phi_deg, stokes_parameter), mu0 in front for several.

        ``.stokes.sel(stokes_parameter="Q")`` takes one of them. Raises MissingExtraError without xarray."""
        return view(self, "to_xarray")

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes NetCDF, CSV or Zarr as the name ends in .nc, .csv or .zarr, all or nothing; `vrte.load` reads it back.

        Raises SceneError for another ending, OSError, but for CSV MissingExtraError without the extra "files".
        """
        return view(self, "save", path)


def one_beam(field: Field) -> float:
    """The cosine mu0 of a field of one beam, which is what a picture shows; SceneError for a field of several."""
    if isinstance(field.mu0, float):
        return field.mu0
    raise SceneError(f"a picture shows one beam, and these are {field.mu0.size}: take one by field.beam(place)")


def freeze(result: Any, shapes: dict[str, tuple[int, ...]]) -> None:
    """Replaces the named arrays of a frozen dataclass by read-only ones, and its ``diagnostics`` by a copy.

    Arrays that are read-only already, all the way down, are taken as they are: a large table would be copied twice.
    Raises SceneError for an array that has not the shape given.
    """
    for name, shape in shapes.items():
        given = getattr(result, name)
        array = given if is_settled(given) else frozen(given)
        if array.shape != shape:
            raise SceneError(f"{name} must have the shape {shape} to fit its directions, not {array.shape}")
        object.__setattr__(result, name, array)
    object.__setattr__(result, "diagnostics", dict(result.diagnostics))
