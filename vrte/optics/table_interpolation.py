"""What a scattering matrix is between the angles of a table, and its integrals.

Elements (6, angles) are in the order F11, F12, F22, F33, F34, F44; integrals and coefficients (terms, 6) in that of
`project_elements`. As functions of the angle all six are sums of cosines, so angles in even steps know those below
their number.
"""

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.spherical_functions import compute_wigner_functions, find_gap, find_gauss_legendre
from vrte.optics.phase_matrix import NEGATIVE_ALLOWED, PAIRS, find_lowest_coherency_eigenvalue, project_elements

NEAR = 1e-9  # degrees: as far from an angle of a quadrature is on it
FEWEST = 8  # angles from which a decay of the spectrum can be seen
DECAYED = 1e-4  # of the least F11: what the last quarter of the spectrum may add up to
FLOOR = 1e-3  # of the mean of F11: where F11 is less, errors are relative to this
SMOOTH = 8  # Gauss nodes between two neighbouring angles, for a spline; oscillating functions take more
ANGLES_AT_ONCE = 1024


def combine_elements(elements: Array) -> Array:
    """What expands in one kind of function each (6, angles): F11, F44, -F12, -F34, F22 + F33, F22 - F33."""
    f11, f12, f22, f33, f34, f44 = elements
    return np.stack([f11, f44, -f12, -f34, f22 + f33, f22 - f33])


def integrate_elements(theta: Array, weights: Array, elements: Array, terms: int) -> Array:
    """Integrals (terms, 6) of elements on the nodes of a quadrature in the cosine: angles [radians], descending."""
    return project_elements(np.cos(theta), weights * combine_elements(elements), terms, find_gap(theta))


def integrate_exactly(angles: Array, elements: Array) -> Array | None:
    """Integrals for as many terms as there are angles, where these are a quadrature (Gauss-Legendre nodes, or even
    steps from 0 to 180 degrees or over their middles) and the spectrum has decayed; else None. Source: Clenshaw and
    Curtis, Numer. Math. 2, 197 (1960), for even steps."""
    from scipy.fft import dct

    count = angles.size
    if count < FEWEST:
        return None
    even = np.linspace(0.0, 180.0, count)
    middles = (np.arange(count) + 0.5) * 180.0 / count
    if np.abs(angles - even).max() < NEAR:
        series = dct(elements, type=1, axis=1) / (count - 1)
        series[:, [0, -1]] *= 0.5
    elif np.abs(angles - middles).max() < NEAR:
        series = dct(elements, type=2, axis=1) / count
        series[:, 0] *= 0.5
    else:
        cosine, weights = find_gauss_legendre(count)
        if np.abs(angles[::-1] - np.degrees(np.arccos(cosine))).max() > NEAR:
            return None
        theta = np.radians(angles[::-1])
        return check_decay(integrate_elements(theta, weights, elements[:, ::-1], count), elements[0])
    finer = 2 * count  # steps: products of two series of cosines need twice as many
    padded = np.pad(0.5 * series, ((0, 0), (0, finer + 1 - count)))
    padded[:, 0] *= 2.0
    order = np.arange(finer + 1)
    of_cosines = np.where(order % 2, 0.0, 2.0 / (1.0 - np.where(order % 2, 0, order) ** 2.0))
    weights = dct(of_cosines, type=1) / finer
    weights[[0, -1]] *= 0.5
    values = dct(padded, type=1, axis=1)[:, ::-1]
    theta = np.pi * order[::-1] / finer
    return check_decay(integrate_elements(theta, weights, values, count), elements[0])


def check_decay(sums: Array, f11: Array) -> Array | None:
    """The integrals, where the last quarter of those of F11 adds up to less than 1e-4 of the least F11."""
    tail = (np.arange(len(sums)) + 0.5) * np.abs(sums[:, 0])
    least = max(float(f11.min()), FLOOR * 0.5 * sums[0, 0])
    return sums if tail[3 * len(sums) // 4 :].sum() <= DECAYED * least else None


def limit_polarization(ratios: Array) -> Array:
    """F12, F22, F33, F34, F44 over F11 (5, angles), less polarizing where no particles are so, as between matrices of
    spheres; half of what a phase matrix may be below 0 is left alone, so that no corners are made for nothing."""
    f12, f22, f33, f34, f44 = ratios
    wanted = -0.5 * NEGATIVE_ALLOWED
    lowest = np.minimum(find_lowest_coherency_eigenvalue(np.ones_like(f12), f22, f33, f44, f12, f34), wanted)
    return ratios * (0.25 - wanted) / (0.25 - lowest)  # a share s that depolarizes: s/4 + (1 - s) lowest = wanted


class ElementSpline:
    """Elements between the angles of a table from 0 to 180 degrees: a spline of log F11 and those of F_ij/F11."""

    def __init__(self, angles: Array, elements: Array) -> None:
        """Of angles (n,) [degrees] and elements (6, n), F11 above 0."""
        from scipy.interpolate import CubicSpline

        self.edges = np.radians(angles)
        shape = np.vstack([np.log(elements[:1]), elements[1:] / elements[0]])
        # zero slopes at both ends: Hovenier and Guirado, JQSRT 133, 596 (2014)
        self._spline = CubicSpline(self.edges, shape, axis=1, bc_type="clamped")

    def compare(self, angles: Array, f11: Array) -> float:
        """By how much the spline's F11 is off at other angles (n,) [degrees]: the largest |log| of a ratio."""
        return float(np.abs(self._spline(np.radians(angles))[0] - np.log(f11)).max())

    def integrate(self, terms: int) -> Array:
        """Integrals (terms, 6), by Gauss-Legendre quadrature between each two neighbouring angles."""
        steps = np.diff(self.edges)
        counts = SMOOTH + np.ceil(0.5 * terms * steps).astype(int)
        theta, weights = [], []
        for count in np.unique(counts):
            nodes, shares = find_gauss_legendre(int(count))
            here = np.flatnonzero(counts == count)
            half = 0.5 * steps[here, None]
            theta.append((self.edges[here, None] + half * (1.0 + nodes)).ravel())
            weights.append((half * shares).ravel())
        angle = np.concatenate(theta)
        order = np.argsort(-angle)
        angle, weight = angle[order], np.concatenate(weights)[order]
        shape = self._spline(angle)
        f11 = np.exp(shape[0])
        elements = np.vstack([f11[None], limit_polarization(shape[1:]) * f11])
        return integrate_elements(angle, weight * np.sin(angle), elements, terms)


def follow_errors(coefficients: Array, angles: Array, elements: Array) -> tuple[Array, Array]:
    """The largest error of an expansion cut after each of its terms (terms,), and that of all, angle by angle
    (angles,): the largest |difference| of an element over F11, or over 1e-3 of its mean where that is more."""
    combined = combine_elements(elements)[:, ::-1]
    theta = np.radians(angles)[::-1]
    cosine, difference = np.cos(theta), find_gap(theta)
    worst, final = np.zeros(len(coefficients)), np.empty(angles.size)
    kinds = np.array([0, 0, 1, 1, 2, 3])  # of the functions: places in PAIRS
    for start in range(0, angles.size, ANGLES_AT_ONCE):
        here = slice(start, start + ANGLES_AT_ONCE)
        scale = np.maximum(combined[0, here], FLOOR)
        rest = -combined[:, here]
        for first, block in compute_wigner_functions(PAIRS, len(coefficients), cosine[here], difference[here]):
            rows = slice(first, first + len(block))
            rests = rest + np.cumsum(coefficients[rows, :, None] * block[:, kinds], axis=0)
            rest = rests[-1]
            sizes = np.abs(rests)
            both = 0.5 * (sizes[:, 4] + sizes[:, 5])  # the larger one of F22 and F33
            errors = np.maximum(sizes[:, :4].max(axis=1), both) / scale
            worst[rows] = np.maximum(worst[rows], errors.max(axis=1))
            final[here] = errors[-1]
    return worst, final[::-1]


def count_terms(worst: Array, accuracy: float) -> int:
    """How many terms are enough, all of them where none are."""
    too_large = np.flatnonzero(worst > accuracy)
    return min(len(worst), int(too_large[-1]) + 2) if too_large.size else 1
