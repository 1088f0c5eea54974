"""What a method finds, and what all results share: arrays that nobody can write into, also in pickles, and what shows
and writes them."""

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any, Self

from vrte.basics.arrays import Array, freeze, record
from vrte.basics.errors import SceneError
from vrte.basics.views import view

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure


def find_finest_nodes(found: Iterable[Any]) -> dict[str, int]:
    """The options nodes and grading of the result on the most nodes, by diagnostics; none without nodes."""
    finest = max((one.diagnostics for one in found), key=lambda one: one.get("nodes", 0))
    return {name: int(finest[name]) for name in ("nodes", "grading") if finest.get(name)}


class Labelled:
    """A frozen dataclass of read-only arrays."""

    @classmethod
    def with_late_diagnostics(cls, make_diagnostics: Callable[[], dict[str, Any]], **given: Any) -> Self:
        """One of read-only arrays whose shapes fit; its diagnostics are made when they are first read."""
        found = object.__new__(cls)
        found.__dict__.update(given, _make_diagnostics=make_diagnostics)
        return found

    def __getattr__(self, name: str) -> Any:
        if name != "diagnostics" or "_make_diagnostics" not in vars(self):
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        found = vars(self)["diagnostics"] = vars(self)["_make_diagnostics"]()
        vars(self).pop("_make_diagnostics", None)
        return found

    def __reduce__(self) -> tuple[Any, ...]:
        # through the constructor: an unpickled array would otherwise be writable
        return type(self), tuple(getattr(self, field.name) for field in fields(self))  # type: ignore[arg-type]

    def _freeze(self, shapes: dict[str, tuple[int, ...]]) -> None:
        """Makes the named arrays read-only and copies ``diagnostics``. Raises SceneError for another shape."""
        for name, shape in shapes.items():
            array = freeze(getattr(self, name))
            if array.shape != shape:
                raise SceneError(f"{name} must have the shape {shape} to fit its directions, not {array.shape}", name)
            object.__setattr__(self, name, array)
        object.__setattr__(self, "diagnostics", dict(vars(self)["diagnostics"]))

    def _freeze_derivatives(self, of: dict[str, str], shapes: dict[str, tuple[int, ...]]) -> None:
        """Makes derivatives, each ``of`` an array with a shape, read-only; None if empty. Raises SceneError."""
        names: list[str] | None = None
        for attribute, value in of.items():
            given = getattr(self, attribute)
            if not given:
                object.__setattr__(self, attribute, None)
                continue
            if names is not None and list(given) != names:
                raise SceneError(f"{attribute} must have the names {', '.join(names)}, in that order", attribute)
            names = list(given)
            found = {name: freeze(array) for name, array in given.items()}
            for name, array in found.items():
                if value not in shapes:
                    raise SceneError(f"{attribute} is of {value}, which is not there", attribute)
                if array.shape != shapes[value]:
                    words = f"must have the shape {shapes[value]} of {value}, not {array.shape}"
                    raise SceneError(f"{attribute} of {name} {words}", attribute, name)
            object.__setattr__(self, attribute, found)

    def to_xarray(self) -> "xarray.Dataset":
        """A copy as an xarray.Dataset, labelled by its directions, every variable with ``units`` and ``long_name``.

        Dimensions: of a BRDF's ``mueller`` (mu_i, mu_o, phi_deg, stokes_out, stokes_in), with wavelength_um in front
        for a spectrum; of a field's ``stokes`` (tau, mu, phi_deg, stokes_parameter), with mu0 in front for several
        beams; of views' ``stokes`` (geometry, stokes_parameter). Labels are "I", "Q", "U" and "V". Derivatives have the
        dimension ``parameter`` in front, labelled by their names.
        """
        return view(self, "to_xarray")


class Result(Labelled):
    """What is shown and written as well: a BRDF, a field, a spectrum."""

    def _repr_html_(self) -> str:
        return view(self, "_repr_html_")

    def plot(self) -> "Figure":
        """A figure: of a BRDF lobes of f00 and polar cuts; of a field I and the degree of polarization against mu, at
        some depths and azimuths; of a spectrum reflectance against wavelength, and f00 in the plane of incidence."""
        return view(self, "plot")

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes all or nothing to .nc (NetCDF), .csv (a table) or .zarr (a folder); `vrte.load` reads it."""
        return view(self, "save", path)


def describe_error(diagnostics: Mapping[str, Any]) -> str:
    """The error of a result, found from two numbers of nodes, for its text; "" where only one was solved."""
    achieved = diagnostics.get("achieved")
    return "" if achieved is None else f", right to {achieved:.1g}"


def describe_derivatives(jacobian: dict[str, Any] | None) -> str:
    """The number of derivatives, for a result's text."""
    count = len(jacobian or {})
    return f", {count} derivative{'s'[: count > 1]}" if count else ""


NO_LIGHT = 1e-290  # per unit of incident light: below, numbers lose digits


@record
class Solution:
    """Diffuse radiance of parts (n_level, n_in, n_mu, n_phi, 4, n_place), public frame; fluxes (n_tau, n_in, n_col)."""

    parts: list[Array]
    flux_up: Array
    flux_down: Array
    diagnostics: dict[str, Any]
