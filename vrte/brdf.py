"""The polarized subsurface BRDF as a 4x4 Mueller matrix, and on request the BTDF."""

from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.arrays import Array, frozen, vector
from vrte.discrete_ordinates.problem import Progress
from vrte.discrete_ordinates.solver import solve
from vrte.errors import SceneError
from vrte.request import check_scene, cosines, node_count
from vrte.running import interruptible, new_run
from vrte.scene import Scene

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True, eq=False)
class Brdf:
    """Subsurface BRDF (nothing is reflected or refracted at the surface itself), arrays read-only.

    mueller (mu_i, mu_o, phi, 4, 4) [1/sr]: radiance out = mueller . irradiance in, meridian planes, phi in degrees
    (0: forward, 180: back). reflectance (mu_i,): directional-hemispherical, unpolarized light. transmission: None,
    or the same as mueller for diffuse light going down at the bottom of the last layer, with direct_transmittance
    (mu_i,) beside it. diagnostics: how it was made.
    """

    mueller: Array
    reflectance: Array
    transmission: Array | None
    direct_transmittance: Array | None
    mu_i: Array
    mu_o: Array
    phi: Array
    diagnostics: dict[str, Any]

    def to_xarray(self) -> "xarray.Dataset":
        """A labelled dataset (extra 'files')."""
        from vrte.formats.netcdf import to_xarray

        return to_xarray(self)

    def save(self, path: str | PathLike[str]) -> None:
        """Writes NetCDF, whole or not at all (extra 'files')."""
        from vrte.formats.netcdf import save

        save(self, path)


def brdf(
    scene: Scene,
    mu_i: Any,
    mu_o: Any,
    phi: Any = 0.0,
    nodes: int = 40,
    threads: int | None = None,
    transmission: bool = False,
    progress: Progress | None = None,
) -> Brdf:
    """The Mueller BRDF for all pairs of directions, four incident Stokes vectors at once, (1:39).

    Parameters: positive cosines ``mu_i``, ``mu_o``; ``phi`` in degrees; ``nodes``, ``threads``, ``progress`` as for
    `vrte.radiance`; ``transmission=True`` adds the BTDF (not for a layer without end). Raises SceneError for bad
    input, AccuracyError where the solver cannot vouch for its answer.

    >>> import vrte
    >>> white = vrte.Scene([vrte.Layer(vrte.isotropic(), albedo=0.5, thickness=0.0)], vrte.Lambertian(1.0))
    >>> round(float(brdf(white, mu_i=0.5, mu_o=0.5, nodes=4).mueller[0, 0, 0, 0, 0] * np.pi), 12)
    1.0
    """
    scene = check_scene(scene)
    into, out = cosines("mu_i", mu_i), cosines("mu_o", mu_o)
    azimuths, node_total = vector("phi", phi), node_count(nodes)
    if transmission and not np.isfinite(scene.thickness):
        raise SceneError("transmission needs a finite thickness: nothing comes out below a layer without end")
    levels = frozen([0.0, scene.thickness] if transmission else [0.0])
    directions = np.concatenate([out, -out]) if transmission else out
    run = new_run(threads)
    solution = interruptible(
        run, lambda: solve(scene, into, np.eye(4), directions, azimuths, levels, node_total, run, progress)
    )
    per_irradiance = solution.radiance
    per_irradiance /= into[:, None, None, None, None]
    # (n_in, n_mu, n_phi, 4, column)
    return Brdf(
        mueller=frozen(per_irradiance[0, :, : out.size]),
        reflectance=frozen(solution.flux_up[0, :, 0] / into),
        transmission=frozen(per_irradiance[1, :, out.size :]) if transmission else None,
        direct_transmittance=frozen(np.exp(-scene.thickness / into)) if transmission else None,
        mu_i=into,
        mu_o=out,
        phi=azimuths,
        diagnostics=solution.diagnostics,
    )
