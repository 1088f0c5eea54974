"""The polarized radiance field at any depth."""

from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.arrays import Array, frozen, vector
from vrte.discrete_ordinates.problem import Progress
from vrte.discrete_ordinates.quadrature import double_gauss
from vrte.discrete_ordinates.solver import solve
from vrte.errors import SceneError
from vrte.request import check_scene, cosines, depths, node_count, stokes_vector
from vrte.running import interruptible, new_run
from vrte.scene import Scene

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True, eq=False)
class Field:
    """Diffuse Stokes field below the surface (nothing is refracted there), arrays read-only.

    stokes (tau, mu, phi, 4) [per steradian, in the unit of the incident flux vector]: I, Q, U, V in the meridian
    plane of each direction, mu > 0 up, mu < 0 down. flux_up, flux_down (tau,): diffuse, through a horizontal plane;
    direct (tau,): mu0 stokes[0] e^(-tau/mu0). tau (optical depth), mu, phi (degrees), mu0, incident_stokes (4,).
    diagnostics: how it was made.
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

    def to_xarray(self) -> "xarray.Dataset":
        """A labelled dataset (extra 'files')."""
        from vrte.formats.netcdf import to_xarray

        return to_xarray(self)

    def save(self, path: str | PathLike[str]) -> None:
        """Writes NetCDF, whole or not at all (extra 'files')."""
        from vrte.formats.netcdf import save

        save(self, path)


def radiance(
    scene: Scene,
    mu0: float,
    stokes: Any = (1.0, 0.0, 0.0, 0.0),
    mu: Any = None,
    phi: Any = 0.0,
    tau: Any = 0.0,
    nodes: int = 40,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Field:
    """The diffuse field of one beam, by discrete ordinates.

    Parameters: ``mu0``, the beam's positive cosine; ``stokes``, its flux vector perpendicular to it; ``mu``, signed
    cosines (default: the nodes, up and down); ``phi``, degrees from the beam's heading; ``tau``, optical depths;
    ``nodes`` a hemisphere (2 x nodes terms of the phase matrix are used for multiple scattering, all of them for
    single scattering); ``threads``, default all usable CPUs; ``progress``, called with (orders done, orders).
    Raises SceneError for bad input, AccuracyError where the solver cannot vouch for its answer.
    Source: Collin, Pattanaik, Bouatouch, section 2.

    >>> import vrte
    >>> scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=1.0, thickness=0.5)])
    >>> radiance(scene, mu0=0.6, mu=[0.5, -0.5], nodes=8).stokes.shape
    (1, 2, 1, 4)
    """
    scene = check_scene(scene)
    beam = cosines("mu0", mu0)
    if beam.size != 1:
        raise SceneError(f"mu0 must be one number a call, not {beam.size}")
    node_total = node_count(nodes)
    points = double_gauss(node_total)[0]
    directions = cosines("mu", np.concatenate([points, -points]) if mu is None else mu, signed=True)
    incident, azimuths, levels = stokes_vector(stokes), vector("phi", phi), depths(tau, scene)
    parts = [incident * [1, 1, 0, 0], incident * [0, 0, 1, 1]]
    columns = np.array([part for part in parts if part.any()] or parts[:1])
    run = new_run(threads)
    solution = interruptible(
        run, lambda: solve(scene, beam, columns, directions, azimuths, levels, node_total, run, progress)
    )
    return Field(
        stokes=frozen(solution.radiance[:, 0].sum(axis=-1)),
        flux_up=frozen(solution.flux_up[:, 0].sum(axis=-1)),
        flux_down=frozen(solution.flux_down[:, 0].sum(axis=-1)),
        direct=frozen(beam[0] * incident[0] * np.exp(-levels / beam[0])),
        tau=levels,
        mu=directions,
        phi=azimuths,
        mu0=float(beam[0]),
        incident_stokes=incident,
        diagnostics=solution.diagnostics,
    )
