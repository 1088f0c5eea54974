"""The light that leaves, in any direction of the hemisphere: the spline through the given directions of a BRDF.

Pictures take it from here, as Stokes vectors: whatever is divided, a degree or an angle of polarization, is divided
after the splines. It ends where the data end: at the last mu_o, and around the normal where no mu_o is near.
"""

from typing import Any

import numpy as np

from vrte.basics.arrays import Array, check_number, check_numbers, check_vector, check_whole
from vrte.basics.errors import SceneError
from vrte.basics.splines import compute_weights, extend_azimuths, extend_over_pole, mirror_azimuths
from vrte.results.brdf import Brdf

EDGE = 1e-9  # [degrees] beyond the last mu_o: rounding
MOST_TIMES = 1000
HOLE = 25.0  # [degrees] from the normal, where the first mu_o is no nearer to it: a spline across would be invention


def stokes_over_hemisphere(brdf: Brdf, place: int, theta: Array, phi: Array, incident: Any = (1, 0, 0, 0)) -> Array:
    """Stokes vectors (n_theta, n_phi, 4) [1/sr] at angles theta and azimuths phi [degrees] under light (4,) along
    ``brdf.mu_i[place]``, by splines over the pole; NaN beyond the last mu_o, and within a hole of 25 degrees."""
    place = check_whole("place", place, 0, brdf.mu_i.size - 1)
    theta, phi = check_vector("theta", theta), check_vector("phi", phi)
    light = check_vector("incident", incident)
    if light.size != 4:
        raise SceneError.of("incident", f"must be four numbers I, Q, U, V, not {light.size}")
    azimuths, matrices = extend_azimuths(brdf.phi, brdf.mueller[place])
    if not np.isfinite(matrices).all():
        raise SceneError("a picture of the lobes needs finite Mueller matrices; NaN or inf was found")
    # Q and U of axes that do not turn with the azimuth: smooth at the pole, where meridian planes are not
    smooth = _turn_axes(matrices @ light, -azimuths)
    given, indices = np.unique(np.degrees(np.arccos(brdf.mu_o)), return_index=True)
    here, opposite = (compute_weights(azimuths, turned % 360.0) @ smooth[indices] for turned in (phi, phi + 180.0))
    circle, light = extend_over_pole(given, here, opposite)
    found = np.einsum("tc,cps->tps", compute_weights(circle, theta), light)
    found[theta > given[-1] + EDGE] = np.nan
    if given[0] > HOLE:
        found[theta < given[0] - EDGE] = np.nan
    return _turn_axes(found, phi)


def _turn_axes(light: Array, degrees: Array) -> Array:
    """Stokes vectors (..., n, 4) in axes turned by angles (n,)."""
    linear = (light[..., 1] + 1j * light[..., 2]) * np.exp(2j * np.radians(degrees))
    return np.stack([light[..., 0], linear.real, linear.imag, light[..., 3]], axis=-1)


def light_on_mesh(
    brdf: Brdf, place: int, incident: Any = (1, 0, 0, 0), step_deg: float = 0.5
) -> tuple[Array, Array, Array]:
    """Rings and spokes [degrees] ``step_deg`` apart at most, and Stokes vectors (n_theta, n_phi, 4) [1/sr]."""
    theta = _list_polar_angles(brdf, step_deg)
    phi = np.linspace(0.0, 360.0, 1 + _count_steps(360.0, step_deg))
    return theta, phi, stokes_over_hemisphere(brdf, place, theta, phi, incident)


def light_in_plane(
    brdf: Brdf, place: int, phi_deg: float = 0.0, incident: Any = (1, 0, 0, 0), step_deg: float = 0.5
) -> tuple[Array, Array]:
    """Angles (n,) [degrees] in the plane of an azimuth, below 0 half a turn away, and Stokes vectors (n, 4) [1/sr]."""
    theta = _list_polar_angles(brdf, step_deg)
    there, opposite = stokes_over_hemisphere(
        brdf, place, theta, np.array([phi_deg, phi_deg + 180.0]), incident
    ).swapaxes(0, 1)
    if theta[0] > 0.0:
        theta, there, opposite = (
            np.insert(part, 0, filler, axis=0) for part, filler in ((theta, 0.0), (there, np.nan), (opposite, np.nan))
        )
    return np.concatenate([-theta[:0:-1], theta]), np.concatenate([opposite[:0:-1], there])


def _list_polar_angles(brdf: Brdf, step_deg: float) -> Array:
    """Angles [degrees] from the normal, or a first mu_o far from it, to the last. Raises SceneError if too few."""
    check_directions(brdf.mu_o, brdf.phi)
    first, last = np.degrees(np.arccos([brdf.mu_o.max(), brdf.mu_o.min()])).tolist()
    first = first if first > HOLE else 0.0
    return np.linspace(first, last, 1 + _count_steps(last - first, step_deg))


def _count_steps(length: float, most: float) -> int:
    """The number of steps of at most ``most``, whatever the rounding."""
    most = check_number("step_deg", most, 0.01, 360.0, "from 0.01 to 360 degrees")
    return max(1, int(np.ceil(length / most - 1e-9)))


def between_angles(angle: Array, stokes: Array, times: int = 8) -> tuple[Array, Array]:
    """Ascending angles [degrees] ``times`` as dense, and Stokes vectors (m, 4) there, by monotone cubics."""
    from scipy.interpolate import PchipInterpolator

    angle, stokes = check_vector("angle", angle), check_numbers("stokes", stokes)
    times = check_whole("times", times, 1, MOST_TIMES)
    if stokes.shape[:1] != angle.shape:
        raise SceneError.of("stokes", f"must be one a angle, {angle.size}, not of shape {stokes.shape}")
    order = np.argsort(angle)
    angle, stokes = angle[order], stokes[order]
    if angle.size < 3 or not np.isfinite(stokes).all():
        return angle, stokes
    finer = np.interp(np.arange((angle.size - 1) * times + 1) / times, np.arange(angle.size), angle)
    return finer, PchipInterpolator(angle, stokes, axis=0)(finer)


def check_directions(mu_o: Any, phi: Any) -> None:
    """Whether cosines mu_o (n_out,) and azimuths phi (n_phi,) [degrees] are enough for a picture. Raises SceneError."""
    mu_o, phi = check_vector("mu_o", mu_o), check_vector("phi", phi)
    if mirror_azimuths(phi)[0].size < 4 or np.unique(mu_o).size < 2:
        raise SceneError(
            "a picture of the lobes needs at least 2 different mu_o and 3 different phi_deg from 0 to 180 (of the "
            "others, the mirror images are taken)"
        )
