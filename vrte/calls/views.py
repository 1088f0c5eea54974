"""The radiance in single geometries, as instruments in orbit list them: sun, line of sight and azimuth of each."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte.basics.arrays import Array, check_number, check_vector
from vrte.basics.errors import SceneError
from vrte.calls.plan import make_request, warn_runtime_of_all
from vrte.calls.radiance import radiance
from vrte.request.how import complete_docstring
from vrte.request.request import Request
from vrte.results.field import Views
from vrte.scene.scene import Scene

MOST_GEOMETRIES = 1_000_000
LARGEST_GRID = 1e6  # directions of all distinct mu0, mu and phi that are solved for together: 32 MB


@complete_docstring
def views(
    scene: Scene,
    mu0: Any,
    mu: Any,
    phi: Any = 0.0,
    stokes: Any = (1.0, 0.0, 0.0, 0.0),
    tau: float = 0.0,
    **how: Any,
) -> Views:
    """The diffuse radiance of many beams, each in one direction of its own.

    Parameters
    ----------
    {scene}
    mu0, mu : float or array_like (n,)
        Positive cosines of the beams, and signed cosines of the lines of sight, above 0 going up, a geometry each; a
        number is taken for all.
    phi : float or array_like (n,), optional
        Azimuths from each beam's heading [degrees].
    stokes : array_like (4,), optional
        Flux vector I, Q, U, V of all beams, perpendicular to them; default: unpolarized.
    tau : float, optional
        One optical depth, by default the top.
    **how
        All else as for `vrte.radiance`; ``time_limit_s`` is for all geometries together.

    Returns
    -------
    Views
        A row a geometry; they are solved for together, few or many as their distinct values allow.

    Raises
    ------
    {SceneError, AccuracyError, DeviceError}

    Examples
    --------
    >>> import vrte
    >>> scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=1.0, thickness=0.5)])
    >>> vrte.views(scene, mu0=[0.6, 0.61, 0.62], mu=[0.9, 0.8, 0.7], phi=30.0, nodes=8).stokes.shape
    (3, 4)
    """
    if how.get("derivatives") is not None:
        raise SceneError.of("derivatives", "are not for single geometries: ask vrte.radiance for them")
    given = [check_vector(name, values) for name, values in (("mu0", mu0), ("mu", mu), ("phi", phi))]
    depth = check_number("tau", tau, 0.0, float("inf"), "one optical depth >= 0")
    try:
        geometries = np.array(np.broadcast_arrays(*given))
    except ValueError:
        sizes = ", ".join(str(each.size) for each in given)
        raise SceneError(f"mu0, mu and phi must be of one length, a geometry each, not of {sizes}") from None
    beams, sights, azimuths = geometries
    if beams.size > MOST_GEOMETRIES:
        raise SceneError(f"there must be at most {MOST_GEOMETRIES} geometries, not {beams.size}")
    groups = list(split_geometries(np.lexsort((azimuths, sights, beams)), geometries))

    def asked_at(place: int) -> tuple[Request, float]:
        mu0, mu, phi = map(np.unique, geometries[:, groups[place]])
        return make_request("radiance", scene, mu0, stokes, mu, phi, depth, **how), 0.0

    warn_runtime_of_all(len(groups), asked_at, f"{len(groups)} groups of geometries")
    seen, solves = np.empty((beams.size, 4)), list[dict[str, Any]]()
    for rows in groups:
        (mu0, i), (mu, o), (phi, p) = (np.unique(each[rows], return_inverse=True) for each in geometries)
        found = radiance(scene, mu0, stokes, mu, phi, depth, **how)
        seen[rows] = found.stokes[i, 0, o, p]
        solves.append(found.diagnostics)
    index = None if found.index is None else float(found.index[0])
    return Views(seen, beams, sights, azimuths, depth, found.incident_stokes, {"solves": solves}, index)


def split_geometries(rows: NDArray[np.intp], geometries: Array) -> Iterator[NDArray[np.intp]]:
    """Rows, equal ones next to each other, halved until the grid of their distinct values is small enough."""
    grid = np.prod([float(np.unique(each[rows]).size) for each in geometries])
    if rows.size > 1 and grid > LARGEST_GRID:
        for half in np.array_split(rows, 2):
            yield from split_geometries(half, geometries)
    else:
        yield rows
