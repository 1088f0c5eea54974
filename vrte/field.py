"""The radiance field inside and outside a scene."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.arrays import Array, frozen, is_settled, settled
from vrte.discrete_ordinates.problem import Progress
from vrte.errors import SceneError
from vrte.illumination import mirrored_stokes
from vrte.request import depths, radiance_request, solver_options
from vrte.running import interruptible
from vrte.scene import Scene
from vrte.solving import chosen, run_of, solved

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class Field:
    """Stokes vectors of the diffuse subsurface light, with fluxes, at each depth and direction.

    ``stokes`` (tau, mu, phi, 4) holds I, Q, U, V [W m-2 sr-1 for an incident beam in W m-2] without the direct beam.
    ``flux_up``, ``flux_down`` (tau,) are its fluxes through a horizontal plane [W m-2]; ``direct`` (tau,) is the
    beam's, mu0 * incident_stokes[0] * exp(-tau/mu0), upward and with the thickness left above the bottom in place of
    tau where ``diagnostics["illuminate"]`` is "bottom". ``tau`` grows downward from the top; ``mu`` > 0 is light going
    up, ``mu`` < 0 down; ``phi`` [deg] is relative to the beam, both along the direction of travel. ``mu0`` > 0 and
    ``incident_stokes`` (4,) describe the beam; ``diagnostics`` says how the field was made. All arrays are read-only.
    Raises SceneError where the shapes do not fit together.
    """

    stokes: Array
    flux_up: Array
    flux_down: Array
    direct: Array
    tau: Array
    mu: Array
    phi: Array
    mu0: float
    incident_stokes: Array
    diagnostics: dict[str, Any]

    def __post_init__(self) -> None:
        depths = (len(self.tau),)
        shapes = {
            "stokes": (*depths, len(self.mu), len(self.phi), 4),
            "flux_up": depths,
            "flux_down": depths,
            "direct": depths,
            "tau": depths,
            "mu": (len(self.mu),),
            "phi": (len(self.phi),),
            "incident_stokes": (4,),
        }
        freeze(self, shapes)

    def __reduce__(self) -> tuple[Any, ...]:
        # through the constructor: an unpickled array would otherwise be writable
        return type(self), tuple(getattr(self, field.name) for field in fields(self))

    def __repr__(self) -> str:
        return (
            f"Field({self.tau.size} tau, {self.mu.size} mu, {self.phi.size} phi, mu0={self.mu0:g}, "
            f"incident_stokes={self.incident_stokes.tolist()})"
        )

    def _repr_html_(self) -> str:
        from vrte.report.notebook import field_html

        return field_html(self)

    def plot(self) -> "Figure":
        """I and the degree of polarization against mu, at some depths and azimuths. Raises SceneError for a field of
        fluxes alone, MissingExtraError without the extra "plot"."""
        from vrte.report.lobes import field_figure

        return field_figure(self)

    def to_xarray(self) -> "xarray.Dataset":
        """An xarray.Dataset: ``stokes`` with dims (tau, mu, phi_deg, stokes). MissingExtraError without xarray."""
        from vrte.formats.netcdf import to_xarray

        return to_xarray(self)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes CSV where the name ends in .csv, otherwise NetCDF, all of it or nothing; `vrte.load` reads it back.

        Raises OSError, for NetCDF MissingExtraError without the extra "files".
        """
        from vrte.formats import save

        save(self, path)


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


def radiance(
    scene: Scene,
    mu0: float,
    stokes: Any = (1.0, 0.0, 0.0, 0.0),
    mu: Any = None,
    phi: Any = 0.0,
    tau: Any = 0.0,
    nodes: int | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    algorithm: str = "auto",
    verify: bool = False,
    accuracy: float | None = None,
    truncation: str = "auto",
    backend: str = "openmp",
    method: str = "discrete-ordinates",
    settings: Mapping[str, Any] | None = None,
    illuminate: str = "top",
) -> Field:
    """The diffuse field of one beam, by discrete ordinates or another method.

    Parameters: ``mu0``, the beam's positive cosine; ``stokes``, its flux vector perpendicular to it; ``mu``, signed
    cosines (default: the nodes, up and down); ``phi``, degrees from the beam's heading; ``tau``, optical depths;
    ``nodes`` a hemisphere (2 x nodes terms of the phase matrix are used for multiple scattering, all of them for
    single scattering); ``accuracy``, relative to the largest I at each depth: of the discrete problem where nodes are
    given (default 1e-8), of the continuous one where the plan chooses them (default 1e-6; ``diagnostics["promised"]``
    and ``["notes"]`` say where it cannot be promised); ``threads``, default all usable CPUs; ``progress``, called with
    (orders done, orders); ``algorithm``, "modes" (eigenvectors), "doubling" (impedance doubling, no eigenproblem) or
    "auto", which takes one by rule; ``verify=True`` solves by both and puts their agreement into ``diagnostics``;
    ``truncation``, what becomes of phase matrices with more terms than the nodes carry: "none" cuts them, "delta-m"
    counts their forward peak as light that was not scattered, "small-angle" does so too and spreads that light, "auto"
    takes one by rule (docs/truncation.md); ``backend``, what computes: "openmp", the compiled core on ``threads``,
    "sequential", the same on one, "opencl", an OpenCL device, or one of the mixtures in docs/opencl.md; ``method``,
    "discrete-ordinates" (exact), another of docs/methods.md, with its own ``settings`` by name, or "auto", which takes
    one for the ``accuracy`` by rule, without nodes and settings (``diagnostics["method_rule"]``); ``illuminate``,
    where the beam comes from: "top", or "bottom", for scenes without a base and with a finite thickness. Raises
    SceneError for bad input, AccuracyError where neither algorithm can vouch for its answer, DeviceError where a device
    is missing or fails. Source: Collin, Pattanaik, Bouatouch, section 2.

    >>> import vrte
    >>> scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=1.0, thickness=0.5)])
    >>> radiance(scene, mu0=0.6, mu=[0.5, -0.5], nodes=8).stokes.shape
    (1, 2, 1, 4)
    """
    options = solver_options(nodes, accuracy, algorithm, verify, truncation, backend, method, settings, illuminate)
    request, incident = radiance_request(scene, mu0, stokes, mu, phi, tau, options)
    request = chosen(request)
    run = run_of(request, threads)
    directions, solution = interruptible(run, lambda: solved(request, run, progress))
    seen = settled(solution.parts[0])[:, 0, ..., 0]
    levels, beam = request.tau, request.mu0
    direct = beam[0] * incident[0] * np.exp(-levels / beam[0])
    fluxes = solution.flux_up, solution.flux_down
    if request.illuminate == "bottom":
        levels, seen, fluxes = depths(tau, request.scene), mirrored_stokes(seen), fluxes[::-1]
        if request.mu is None:  # the nodes, up and down, the other way round
            seen = np.roll(seen, directions.size // 2, axis=1)
        else:
            directions = -directions
    if request.fluxes_only:
        directions = directions[:0]
    return Field(
        stokes=seen[:, : directions.size],
        flux_up=frozen(fluxes[0][:, 0].sum(axis=-1)),
        flux_down=frozen(fluxes[1][:, 0].sum(axis=-1)),
        direct=frozen(direct),
        tau=levels,
        mu=directions,
        phi=request.phi,
        mu0=float(beam[0]),
        incident_stokes=incident,
        diagnostics=solution.diagnostics | {"illuminate": request.illuminate},
    )
