"""Stokes vectors in single geometries, as instruments in orbit list them."""

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

from vrte.basics.arrays import Array
from vrte.basics.views import view
from vrte.results.field import freeze

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True, eq=False, repr=False)
class Views:
    """Stokes vectors of the diffuse light in single geometries, a row each.

    ``stokes`` (n, 4) [W m-2 sr-1 for a beam in W m-2]; ``mu0``, ``mu``, ``phi`` (n,) as in `vrte.Field`; ``tau`` the
    depth of all, ``incident_stokes`` (4,) of all beams; ``diagnostics``: of the solves that it took, each for some of
    the rows, ``diagnostics["solves"]``. All arrays are read-only.
    """

    stokes: Array
    mu0: Array
    mu: Array
    phi: Array
    tau: float
    incident_stokes: Array
    diagnostics: dict[str, Any]

    def __post_init__(self) -> None:
        rows = (len(self.mu0),)
        freeze(self, {"stokes": (*rows, 4), "mu0": rows, "mu": rows, "phi": rows, "incident_stokes": (4,)})

    def __reduce__(self) -> tuple[Any, ...]:
        # through the constructor: an unpickled array would otherwise be writable
        return type(self), tuple(getattr(self, field.name) for field in fields(self))

    def __repr__(self) -> str:
        return f"Views({self.mu0.size} geometries, tau={self.tau:g}, incident_stokes={self.incident_stokes.tolist()})"

    def to_xarray(self) -> "xarray.Dataset":
        """An xarray.Dataset: ``stokes`` with dims (geometry, stokes_parameter). MissingExtraError without xarray."""
        return view(self, "to_xarray")
