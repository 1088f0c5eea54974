"""Light from below, and any light at all: (2:1), (2:2)."""

from collections.abc import Callable
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, check_numbers, check_vector, check_whole, freeze_copy
from vrte.basics.errors import SceneError
from vrte.basics.polarization import FLIP
from vrte.basics.quadrature import make_double_gauss
from vrte.scene.scene import Scene

SIDES = ("top", "bottom")
SAME = 1e-9  # of cosines, of degrees: apart by no more, they are taken for those of a quadrature
MOST_COSINES = 4096
LARGEST_STOKES = 1e100  # sums over nodes and orders stay far below overflow
OVERPOLARIZED = 1e-6  # by how much of I polarization may exceed it: the rounding of single precision


def turn_to_light(side: str, scene: Scene) -> Scene:
    """The scene as light from that side meets it. Raises SceneError from below a base or without an end."""
    if side == "top":
        return scene
    if scene.base is not None:
        raise SceneError(
            "illuminate='bottom' needs a scene without a base: light from below would come through it", "illuminate"
        )
    if not np.isfinite(scene.thickness):
        raise SceneError(
            "illuminate='bottom' needs a finite thickness: a semi-infinite layer has no bottom", "illuminate"
        )
    return scene.turned()


def mirror_stokes(stokes: Array) -> Array:
    """Stokes vectors (..., 4) in a horizontal mirror: U and V change sign."""
    return np.multiply(stokes, FLIP)


def mirror_mueller(matrices: Array) -> Array:
    """Mueller matrices (..., 4, 4) in a horizontal mirror, D f D."""
    return np.multiply(matrices, np.outer(FLIP, FLIP))


def check_physical(name: str, stokes: Array) -> None:
    """Raises SceneError unless Stokes vectors (..., 4) are light: I >= 0, I^2 >= Q^2 + U^2 + V^2, none above 1e100."""
    if stokes.shape == (4,):
        i, q, u, v = stokes.tolist()
        if 0.0 <= i <= LARGEST_STOKES and q * q + u * u + v * v <= i * i:  # light, without a doubt
            return
    light = stokes.reshape(-1, 4)
    largest = np.abs(light).max(initial=0.0)
    if not largest <= LARGEST_STOKES:
        raise SceneError.of(name, f"must be numbers of at most {LARGEST_STOKES:g} in size, not {largest:g}")
    polarized = np.linalg.norm(light[:, 1:], axis=1)
    wrong = np.flatnonzero((light[:, 0] < 0.0) | (polarized > light[:, 0] * (1.0 + OVERPOLARIZED)))
    if wrong.size:
        words = f"must be light, I >= 0 and I^2 >= Q^2 + U^2 + V^2: {light[wrong[0]].tolist()} is none"
        raise SceneError.of(name, words)


def hemisphere(n: int) -> tuple[Array, Array]:
    """Cosines over a hemisphere and their weights, the nodes for `Brdf.under`.

    Parameters
    ----------
    n : int
        How many, 1 to 4096.

    Returns
    -------
    mu : ndarray (n,)
        Gauss cosines from 0 to 1, ascending: the nodes that a solve with nodes=n uses itself, on which energy is
        conserved to rounding.
    weights : ndarray (n,)
        Their weights, which sum to 1.

    References
    ----------
    (1:15), double-Gauss quadrature.

    Examples
    --------
    >>> import vrte
    >>> mu, weights = vrte.hemisphere(2)
    >>> round(float(weights @ mu**3), 12)
    0.25
    """
    points, weights = make_double_gauss(check_whole("n", n, 1, MOST_COSINES))
    return freeze_copy(points), freeze_copy(weights)


def choose_weights(mu_i: Array, weights: Any) -> Array:
    """The weights (mu_i,) given, or those of `hemisphere` where mu_i are its cosines."""
    if weights is None:
        points, found = hemisphere(mu_i.size)
        if np.abs(points - mu_i).max() > SAME:
            raise SceneError.of("weights", "are missing: mu_i are not the cosines of vrte.hemisphere")
        return found
    given = check_vector("weights", weights)
    if given.shape != mu_i.shape:
        raise SceneError.of("weights", f"must be {mu_i.size} numbers, one for each mu_i, not {given.size}")
    return given


def check_azimuths(phi: Array) -> None:
    """Raises SceneError unless phi (n_phi,) goes once around in equal steps, from 0."""
    if phi.size < 2 or np.abs(phi - np.arange(phi.size) * (360.0 / phi.size)).max() > SAME:
        raise SceneError(
            "light from all sides needs phi all around in equal steps from 0, at least two: "
            "np.arange(n) * 360 / n, n above twice the Fourier orders of the BRDF"
        )


def sample_incident_light(light: Callable[[Any, Any], Any] | Any, mu_i: Array, phi: Array) -> Array:
    """Stokes radiance (mu_i, phi, 4) that falls in, from a function of broadcastable (mu_i, phi_deg), or numbers."""
    shape = (mu_i.size, phi.size, 4)
    given = light(mu_i[:, None].copy(), phi[None, :].copy()) if callable(light) else light
    values = check_numbers("the incident light", given)
    try:
        values = np.broadcast_to(values, shape)
    except ValueError:
        raise SceneError(f"the incident light must have the shape {shape}, not {values.shape}") from None
    if not np.isfinite(values).all():
        raise SceneError("the incident light must be finite; NaN or inf was found")
    check_physical("the incident light", values)
    return values


def sum_outgoing_light(mueller: Array, light: Array, mu_i: Array, weights: Array) -> Array:
    """(2:1)-(2:2), (mu_o, phi, 4), of mueller (mu_i, mu_o, phi, 4, 4) and light (mu_i, phi, 4), by convolution."""
    n_phi = light.shape[1]
    spectra = np.fft.rfft(mueller, axis=2), np.fft.rfft(light, axis=1)
    share = weights * mu_i * (2.0 * np.pi / n_phi)
    total = np.einsum("iompq,imq->omp", spectra[0], share[:, None, None] * spectra[1], optimize=True)
    return np.asarray(np.fft.irfft(total, n_phi, axis=1))
