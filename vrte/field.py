"""The radiance field inside and outside a scene."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.arrays import Array, frozen, is_settled, settled
from vrte.discrete_ordinates.problem import Progress
from vrte.discrete_ordinates.solver import Solution
from vrte.errors import SceneError
from vrte.illumination import mirrored_stokes
from vrte.request import Request, depths, radiance_request, solver_options
from vrte.running import interruptible
from vrte.scene import Scene
from vrte.solving import chosen, run_of, solved, warn_of_negative

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
        from vrte.report.notebook import field_html

        return field_html(self)

    def plot(self) -> "Figure":
        """I and the degree of polarization against mu, at some depths and azimuths, or beams at the first azimuth.

        Raises SceneError for a field of fluxes alone, MissingExtraError without the extra "plot"."""
        from vrte.report.lobes import field_figure

        return field_figure(self)

    def to_xarray(self) -> "xarray.Dataset":
        """An xarray.Dataset: ``stokes`` with dims (tau, mu, phi_deg, stokes_parameter), mu0 in front for several.

        ``.stokes.sel(stokes_parameter="Q")`` takes one of them. Raises MissingExtraError without xarray."""
        from vrte.formats.netcdf import to_xarray

        return to_xarray(self)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes NetCDF, CSV or Zarr as the name ends in .nc, .csv or .zarr, all or nothing; `vrte.load` reads it back.

        Raises SceneError for another ending, OSError, but for CSV MissingExtraError without the extra "files".
        """
        from vrte.formats import save

        save(self, path)


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


def radiance(
    scene: Scene,
    mu0: Any,
    stokes: Any = (1.0, 0.0, 0.0, 0.0),
    mu: Any = None,
    phi: Any = 0.0,
    tau: Any = 0.0,
    nodes: int | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    algorithm: str | None = None,
    verify: bool | None = None,
    accuracy: float | None = None,
    truncation: str | None = None,
    backend: str | None = None,
    method: str = "discrete-ordinates",
    settings: Mapping[str, Any] | None = None,
    illuminate: str = "top",
    time_limit_s: float | None = None,
) -> Field:
    """The diffuse field of one beam, or of several in one solve, by discrete ordinates or another method.

    Parameters: ``mu0``, the beam's positive cosine, or a list of cosines, whose axis the result then has in front;
    ``stokes``, its flux vector perpendicular to it, I >= 0 and I^2 >= Q^2 + U^2 + V^2; ``mu``, signed cosines
    (default: the nodes, up and down); ``phi``, degrees from the beam's heading; ``tau``, optical depths; ``nodes``
    a hemisphere (2 x nodes terms of the phase matrix are used for multiple scattering, all of them for single
    scattering); ``accuracy``, relative to the largest I at each depth: of the discrete problem where nodes are
    given (default 1e-8), of the continuous one where the plan chooses them (default 1e-6;
    ``diagnostics["promised"]`` and ``["notes"]`` say where it cannot be promised); ``threads``, default all usable
    CPUs; ``progress``, called with (orders done, orders); ``algorithm``, "modes" (eigenvectors), "doubling"
    (impedance doubling, no eigenproblem) or "auto", which takes one by rule; ``verify=True`` solves by both and
    puts their agreement into ``diagnostics``; ``truncation``, what becomes of phase matrices with more terms than
    the nodes carry: "none" cuts them, "delta-m" counts their forward peak as light that was not scattered,
    "small-angle" does so too and spreads that light, "auto" takes one by rule (docs/truncation.md); ``backend``,
    what computes: "openmp", the compiled core on ``threads``, "sequential", the same on one, "opencl", an OpenCL
    device, or one of the mixtures in docs/opencl.md; ``method``, "discrete-ordinates" (exact), another of
    docs/methods.md, with its own ``settings`` by name, or "auto", which takes one for the ``accuracy`` by rule,
    without nodes and settings (``diagnostics["method_rule"]``); ``illuminate``, where the beam comes from: "top",
    or "bottom", for scenes without a base and with a finite thickness; ``time_limit_s``: what is predicted, to a
    factor of about 3, to take longer is refused (default an hour; math.inf: nothing is); what takes more than 20
    seconds says so at once in a LongSolveWarning. Raises SceneError for bad input, AccuracyError where neither
    algorithm can vouch for its answer, DeviceError where a device is missing or fails. Source: Collin, Pattanaik,
    Bouatouch, section 2.

    >>> import vrte
    >>> scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=1.0, thickness=0.5)])
    >>> radiance(scene, mu0=0.6, mu=[0.5, -0.5], nodes=8).stokes.shape
    (1, 2, 1, 4)
    """
    options = solver_options(
        nodes, accuracy, algorithm, verify, truncation, backend, method, settings, illuminate, time_limit_s
    )
    request, incident = radiance_request(scene, mu0, stokes, mu, phi, tau, options)
    request = chosen(request)
    run = run_of(request, threads)
    directions, solution = interruptible(run, lambda: solved(request, run, progress))
    found = field_of(request, directions, solution, depths(tau, request.scene), incident)
    return found.beam(0) if is_one_number(mu0) else found


def is_one_number(value: Any) -> bool:
    """Whether this is a number and no list of them, not even one of length 1."""
    return type(value) is float or np.ndim(value) == 0


def field_of(request: Request, directions: Array, solution: Solution, tau: Array, incident: Array) -> Field:
    """What was found, as a result of as many beams as were asked for; tau (n_tau,) as asked."""
    seen = np.moveaxis(settled(solution.parts[0])[..., 0], 1, 0)  # (n_in, n_tau, n_mu, n_phi, 4)
    warn_of_negative(request, seen[..., 0], solution.diagnostics)
    beams = request.mu0[:, None]
    direct = beams * incident[0] * np.exp(-request.tau / beams)
    fluxes = [np.moveaxis(flux, 1, 0).sum(axis=-1) for flux in (solution.flux_up, solution.flux_down)]
    if request.illuminate == "bottom":
        seen, fluxes = mirrored_stokes(seen), fluxes[::-1]
        if request.mu is None:  # the nodes, up and down, the other way round
            seen = np.roll(seen, directions.size // 2, axis=2)
        else:
            directions = -directions
    if request.fluxes_only:
        directions = directions[:0]
    return Field(
        stokes=seen[:, :, : directions.size],
        flux_up=frozen(fluxes[0]),
        flux_down=frozen(fluxes[1]),
        direct=frozen(direct),
        tau=tau,
        mu=directions,
        phi=request.phi,
        mu0=request.mu0,
        incident_stokes=incident,
        diagnostics=solution.diagnostics | {"illuminate": request.illuminate},
    )
