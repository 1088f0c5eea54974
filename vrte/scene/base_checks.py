"""What every surface does: its matrices are sums of reflections, and it gives back no more light than it gets."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from vrte.basics.arrays import Array, check_whole, make_readonly
from vrte.basics.errors import SceneError
from vrte.optics.phase_matrix import NEGATIVE_ALLOWED

LARGEST_BASE = 1e100  # of an element of a base's Mueller matrix [1/sr]
CHECKED_COSINES = make_readonly(np.array([0.01, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0]))  # mu_i of a base's energy
GRAZING = 0.05  # mu_i below which a base may give back more than it gets
ENERGY_ALLOWED = 1e-3  # relative: what quadratures of coarse functions leave
MOST_POINTS = 4096
COARSE = 24  # points of a first look at a base's energy
PAULI = np.array([[[1, 0], [0, 1]], [[1, 0], [0, -1]], [[0, 1], [1, 0]], [[0, -1j], [1j, 0]]])  # of I, Q, U, V


def find_coherency(mueller: Array) -> NDArray[np.complex128]:
    """H = sum_ij f_ij (sigma_i x sigma_j^*)/4 of Mueller matrices (..., 4, 4), whose eigenvalues are >= 0 for mixtures
    of Jones matrices: (..., 4, 4). Source: Cloude, Optik 75, 26 (1986)."""
    products = 0.25 * np.einsum("iab,jcd->ijacbd", PAULI, PAULI.conj()).reshape(4, 4, 4, 4)
    return np.einsum("...ij,ijab->...ab", mueller, products)


def check_physical(f: Array, mu_i: Array, mu_o: Array, phi_deg: Array) -> None:
    """Whether f (..., 4, 4) at directions (...) is physical: sums of what single reflections do to the field have
    coherency matrices without negative eigenvalues. Raises SceneError, which names the worst."""
    lowest, intensity = np.linalg.eigvalsh(find_coherency(f))[..., 0], f[..., 0, 0]
    floor = -NEGATIVE_ALLOWED * intensity - 1e-12 * np.abs(f).max()
    worst = np.unravel_index(np.argmin(lowest - floor), lowest.shape)
    if lowest[worst] < floor[worst]:
        raise SceneError(
            f"base: the Mueller matrix from mu_i {mu_i[worst]:g} to mu_o {mu_o[worst]:g} at phi_deg "
            f"{phi_deg[worst]:g} is not physical: its coherency matrix has the eigenvalue {lowest[worst]:.3g} where "
            f"f_00 is {intensity[worst]:.3g}; at least -{NEGATIVE_ALLOWED:g} f_00 is allowed (check signs and order)"
        )


def make_exit_rule(points: int) -> tuple[Array, Array]:
    """Cosines of exit (points,), dense at the horizon, where lobes of grazing light are, and weights of a flux: the sum
    of weight f over mu_o is the integral of mu_o f dmu_o."""
    root, weight = np.polynomial.legendre.leggauss(check_whole("points", points, 2, MOST_POINTS))
    mu_o = (0.5 * (root + 1.0)) ** 2
    return mu_o, weight * np.sqrt(mu_o) * mu_o


def check_energy(reflectance: Callable[[Array, int], Array]) -> None:
    """Whether a base gives back no more than it gets: ``reflectance`` of cosines (n,) and points of a quadrature is
    computed with more points, until it converges, only where it seems to be too much. Raises SceneError."""
    most = (1.0 + ENERGY_ALLOWED) * np.maximum(1.0, GRAZING / CHECKED_COSINES)
    excess = reflectance(CHECKED_COSINES, COARSE) / most
    for index in np.argsort(-excess)[: np.count_nonzero(excess > 1.0)]:  # the worst first
        mu_i, before = CHECKED_COSINES[index : index + 1], np.inf
        for points in (2 * COARSE, 4 * COARSE, 8 * COARSE, 16 * COARSE):
            now = reflectance(mu_i, points)[0]
            if now <= most[index] or abs(now - before) <= ENERGY_ALLOWED * now:
                break
            before = now
        else:
            continue  # too narrow for this quadrature: the solver's own will tell
        if now > most[index]:
            raise SceneError(
                f"base: it gives back {now:.4g} of the light along mu_i = {mu_i[0]:g}, and at most "
                f"{most[index]:.4g} is allowed there (facets without shadows give back too much near the horizon)"
            )
