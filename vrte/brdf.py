"""The polarized subsurface BRDF of a scene, and its transmission."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.arrays import Array, frozen, settled
from vrte.discrete_ordinates.problem import Progress
from vrte.discrete_ordinates.solver import Solution
from vrte.errors import SceneError
from vrte.field import freeze
from vrte.illumination import check_azimuths, incident_light, mirrored_mueller, outgoing, weights_of
from vrte.request import Request, brdf_request, solver_options
from vrte.running import interruptible
from vrte.scene import Scene
from vrte.solving import chosen, run_of, solved, warn_of_negative

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class Brdf:
    """Mueller matrices of the light that comes back out: radiance out = mueller @ irradiance in.

    ``mueller`` (mu_i, mu_o, phi, 4, 4) [sr-1] is the subsurface BRDF in the meridian planes; ``reflectance`` (mu_i,) is
    directional-hemispherical, for unpolarized light. ``transmission`` (same shape as mueller, or None) is the like for
    diffuse light out of the face that is not lit (going down at the bottom, base included), ``direct_transmittance``
    (mu_i,) or None the beam's share that gets through unscattered. The lit face is the top, or as
    ``diagnostics["illuminate"]`` says. ``mu_i``, ``mu_o`` are positive cosines; ``phi`` [deg] is outgoing minus
    incident, both along the direction of travel: 0 is forward, 180 turns back. All arrays are read-only. Raises
    SceneError where the shapes do not fit together.
    """

    mueller: Array
    reflectance: Array
    mu_i: Array
    mu_o: Array
    phi: Array
    diagnostics: dict[str, Any]
    transmission: Array | None = None
    direct_transmittance: Array | None = None

    def __post_init__(self) -> None:
        incident = (len(self.mu_i),)
        matrices = (*incident, len(self.mu_o), len(self.phi), 4, 4)
        shapes = {
            "mueller": matrices,
            "reflectance": incident,
            "mu_i": incident,
            "mu_o": (len(self.mu_o),),
            "phi": (len(self.phi),),
        }
        if self.transmission is not None:
            shapes["transmission"] = matrices
        if self.direct_transmittance is not None:
            shapes["direct_transmittance"] = incident
        freeze(self, shapes)

    def __reduce__(self) -> tuple[Any, ...]:
        # through the constructor: an unpickled array would otherwise be writable
        return type(self), tuple(getattr(self, field.name) for field in fields(self))

    def __repr__(self) -> str:
        extra = "" if self.transmission is None else ", with transmission"
        return f"Brdf({self.mu_i.size} mu_i, {self.mu_o.size} mu_o, {self.phi.size} phi{extra})"

    def under(self, light: Any, weights: Any = None, transmitted: bool = False) -> Array:
        """Stokes radiance (mu_o, phi, 4) that comes out under any incident light, (2:2).

        Parameters: ``light``, Stokes radiance on the face that is lit, a function of broadcastable (mu_i, phi_deg) or
        an array that broadcasts to (mu_i, phi, 4), azimuths along the direction of travel; ``weights`` (mu_i,) of a
        quadrature over mu_i from 0 to 1, those of `vrte.hemisphere` where left out; ``transmitted`` for what leaves the
        other face (scattered light only: unscattered light goes on as it came). The BRDF needs ``phi`` all around in
        equal steps from 0, more of them than Fourier orders of BRDF and light together; the sum over mu_i is as good as
        the weights. Raises SceneError for bad input.

        >>> import vrte
        >>> white = vrte.Scene([vrte.Layer(vrte.isotropic(), albedo=0.5, thickness=0.0)], vrte.Lambertian(0.25))
        >>> f = brdf(white, vrte.hemisphere(4)[0], mu_o=0.5, phi=[0, 90, 180, 270], nodes=4)
        >>> round(float(f.under([1.0, 0.0, 0.0, 0.0])[0, 0, 0]), 12)
        0.25
        """
        matrices = self.transmission if transmitted else self.mueller
        if matrices is None:
            raise SceneError("no transmission here: ask vrte.brdf for it with transmission=True")
        check_azimuths(self.phi)
        falls_in = incident_light(light, self.mu_i, self.phi)
        return outgoing(matrices, falls_in, self.mu_i, weights_of(self.mu_i, weights))

    def diffuse_reflectance(self, weights: Any = None) -> Array:
        """The radiance factor (mu_o,) under an evenly white, unpolarized sky: radiance out over that of a white
        Lambertian surface. Parameters and errors as for `under`."""
        return self.under([1.0, 0.0, 0.0, 0.0], weights)[..., 0].mean(axis=1)

    def bihemispherical_reflectance(self, weights: Any = None) -> float:
        """Flux out over flux in under such a sky, from ``reflectance``; any ``phi`` will do. ``weights`` as for
        `under`."""
        return float(2.0 * (weights_of(self.mu_i, weights) * self.mu_i) @ self.reflectance)

    def _repr_html_(self) -> str:
        from vrte.report.notebook import brdf_html

        return brdf_html(self)

    def plot(self) -> "Figure":
        """Lobes of f00 and polar cuts. Raises SceneError where there are too few directions, MissingExtraError without
        the extra "plot"."""
        from vrte.report.lobes import brdf_figure

        return brdf_figure(self)

    def to_xarray(self) -> "xarray.Dataset":
        """An xarray.Dataset: ``mueller`` with dims (mu_i, mu_o, phi_deg, stokes_out, stokes_in).

        Raises MissingExtraError without xarray.
        """
        from vrte.formats.netcdf import to_xarray

        return to_xarray(self)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes NetCDF, CSV or Zarr as the name ends in .nc, .csv or .zarr, all or nothing; `vrte.load` reads it back.

        Raises SceneError for another ending, OSError, but for CSV MissingExtraError without the extra "files".
        """
        from vrte.formats import save

        save(self, path)


def brdf(
    scene: Scene,
    mu_i: Any,
    mu_o: Any,
    phi: Any = 0.0,
    nodes: int | None = None,
    threads: int | None = None,
    transmission: bool = False,
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
) -> Brdf:
    """The Mueller BRDF (1:1) for all pairs of directions, four incident Stokes vectors at once, (1:39).

    Parameters: positive cosines ``mu_i``, ``mu_o``; ``phi`` in degrees; ``nodes``, ``accuracy``, ``threads``,
    ``progress``, ``algorithm``, ``verify``, ``truncation``, ``backend``, ``method``, ``settings``, ``illuminate``,
    ``time_limit_s`` as for `vrte.radiance`; ``transmission=True`` adds the BTDF (not for a layer without end). Lit
    from the bottom, the BRDF is that of the bottom and the BTDF leads out of the top; cosines are positive as ever.
    Raises SceneError for bad input, AccuracyError where neither algorithm can vouch for its answer, DeviceError
    where an OpenCL device is missing or fails.

    >>> import vrte
    >>> white = vrte.Scene([vrte.Layer(vrte.isotropic(), albedo=0.5, thickness=0.0)], vrte.Lambertian(1.0))
    >>> round(float(brdf(white, mu_i=0.5, mu_o=0.5, nodes=4).mueller[0, 0, 0, 0, 0] * np.pi), 12)
    1.0
    """
    options = solver_options(
        nodes, accuracy, algorithm, verify, truncation, backend, method, settings, illuminate, time_limit_s
    )
    request, _ = brdf_request(scene, mu_i, mu_o, phi, transmission, options)
    return brdf_of(chosen(request), threads, transmission, progress)


def brdf_of(
    request: Request, threads: int | None, transmission: bool, progress: Progress | None, told: bool = False
) -> Brdf:
    """Of a request with its method named; ``told``: what it takes was said."""
    run = run_of(request, threads)
    run.told = told
    _, solution = interruptible(run, lambda: solved(request, run, progress))
    return as_brdf(request, solution, transmission)


def as_brdf(request: Request, solution: Solution, transmission: bool) -> Brdf:
    """What was found, as a result."""
    into, directions = request.mu0, request.mu
    assert directions is not None
    # (1, n_in, n_mu, n_phi, 4, column)
    matrices = [settled(values)[0] for values in solution.parts]
    if request.illuminate == "bottom":
        matrices = [mirrored_mueller(values) for values in matrices]
    for values in matrices:
        warn_of_negative(request, values[..., 0, 0], solution.diagnostics)
    return Brdf(
        mueller=matrices[0],
        reflectance=frozen(solution.flux_up[0, :, 0] / into),
        transmission=matrices[1] if transmission else None,
        direct_transmittance=frozen(np.exp(-request.scene.thickness / into)),
        mu_i=into,
        mu_o=directions[directions > 0.0],
        phi=request.phi,
        diagnostics=solution.diagnostics | {"illuminate": request.illuminate},
    )
