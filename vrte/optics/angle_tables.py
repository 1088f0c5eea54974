"""Scattering matrices tabulated over angle: checked, made whole, interpolated and expanded.

Where the table's angles are those of an exact quadrature (Gauss-Legendre, or evenly spaced from 0 to 180 degrees or
over the middles of even steps) and its spectrum has decayed, what lies between the angles is known, and the expansion
is right to rounding; elsewhere it is a spline of log F11 and of the ratios F_ij/F11 with zero slope at both ends.

Elements (6, angles) are in the order F11, F12, F22, F33, F34, F44; integrals and coefficients (terms, 6) in that of
`project_elements`. As functions of the angle all six are sums of cosines: even steps know those below their number.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, check_number, check_vector, freeze_copy, make_readonly, show_value
from vrte.basics.errors import AccuracyWarning, SceneError, warn_user
from vrte.basics.quadrature import compute_wigner_functions, find_gap, find_gauss_legendre
from vrte.optics.conventions import ELEMENTS, Convention, find_convention
from vrte.optics.phase_matrix import (
    NEGATIVE_ALLOWED,
    PAIRS,
    PhaseMatrix,
    arrange_coefficients,
    find_lowest_coherency_eigenvalue,
    project_elements,
)

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
    """Integrals (terms, 6), terms as many as angles, where these are Gauss-Legendre nodes or even steps (Clenshaw and
    Curtis, Numer. Math. 2, 197 (1960)) and the spectrum has decayed; else None."""
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
    """Ratios (5, angles) to F11, less polarizing where no particles are so: half of NEGATIVE_ALLOWED is left alone."""
    f12, f22, f33, f34, f44 = ratios
    wanted = -0.5 * NEGATIVE_ALLOWED
    lowest = np.minimum(find_lowest_coherency_eigenvalue(np.ones_like(f12), f22, f33, f44, f12, f34), wanted)
    return ratios * (0.25 - wanted) / (0.25 - lowest)  # a share s that depolarizes: s/4 + (1 - s) lowest = wanted


class ElementSpline:
    """Elements between the angles of a table from 0 to 180 degrees: a spline of log F11 and those of F_ij/F11."""

    def __init__(self, angles: Array, elements: Array) -> None:
        """The spline through angles (n,) [degrees] and elements (6, n), F11 above 0."""
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
    """Largest errors over F11 of an expansion cut after each term (terms,), and by angle of all (angles,)."""
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


MOST_ANGLES = 20_000
MEAN_ALLOWED = 0.05  # how far the mean of F11 may be from what the convention says
NO_MORE_TERMS = 1e-12  # a coefficient where the table is exact, unless the user wants fewer
NOISE = 10.0  # times what the last quarter of an exact spectrum holds: what is less is no signal
ROUNDED = 1e-12  # of the largest F11: how far below zero rounding may bring one
FINE_ENOUGH = 5e-5  # error of an expansion of a spline, unless the user wants another
FIRST_TERMS, LAST_TERMS = 64, 4096
MISSED = 0.2  # relative change of the integral without every other angle from which a peak may have been missed
UNRESOLVED = math.log(2.0)  # of F11 at an angle left out: the same, since a spline of all is some 16 times better
FEW = 9  # angles below which that says nothing
EXTRAPOLATE, FORWARD, BACKWARD = "extrapolate", "short", "beyond"


@dataclass(frozen=True, eq=False)
class ScatteringTable:
    """A scattering matrix over scattering angles [degrees] (angles,), in vrte's signs; the mean of F11 is 1."""

    angle_deg: Array
    F11: Array
    F12: Array
    F22: Array
    F33: Array
    F34: Array
    F44: Array

    @property
    def elements(self) -> Array:
        """All six in one array (6, angles): F11, F12, F22, F33, F34, F44."""
        return np.stack([getattr(self, name) for name in ELEMENTS])


@dataclass(frozen=True, eq=False)
class Expansion:
    """How a phase matrix came from a table over angle, and how far it is off.

    ``table`` is as it was given, normalised, in vrte's signs, ``convention`` the name of its own; ``integral`` the mean
    of its F11 over the sphere, over what the convention says (over 1 where that says nothing); ``way`` how it was
    integrated, and what was assumed beyond its ends. ``error`` (angles,) is the largest |difference| of an element over
    F11 (over 1e-3 where F11 is less), ``lowest_eigenvalue`` the table's lowest coherency eigenvalue over F11, at
    ``lowest_angle_deg`` [degrees]. ``albedo`` is that of single scattering where the table's file says it.
    """

    table: ScatteringTable
    convention: str
    integral: float
    way: str
    error: Array
    lowest_eigenvalue: float
    lowest_angle_deg: float
    albedo: float | None = None

    @property
    def largest_error(self) -> float:
        """The largest ``error`` over all angles."""
        return float(self.error.max())

    @property
    def largest_error_angle_deg(self) -> float:
        """The scattering angle [degrees] of the largest ``error``."""
        return float(self.table.angle_deg[np.argmax(self.error)])


def describe_expansion(matrix: PhaseMatrix) -> dict[str, str]:
    """What was found in the table that a phase matrix came from, in words: integral, peak, terms, error, coherency."""
    found = matrix.expansion
    assert found is not None  # it is from a table
    angles = np.concatenate([[0.0], np.geomspace(1e-3, 180.0, 2000)])
    f11 = matrix.to_angles(angles).F11
    below = np.flatnonzero(f11 <= 0.5 * f11[0])
    reach = f"half of that at {angles[below[0]]:.3g} degrees" if below.size else "nowhere half as large"
    rows = {
        "integral": f"{found.integral:.6g} (F11's mean over the sphere, over the convention's)",
        "peak": f"F11 is {f11[0]:.5g} at 0 degrees, {reach}",
        "asymmetry": f"{round(matrix.asymmetry, 9) + 0.0:.6g}",
        "terms": f"{matrix.terms}",
        "error": f"{found.largest_error:.2g} of F11 at most, at {found.largest_error_angle_deg:g} degrees",
        "coherency": f"lowest eigenvalue {found.lowest_eigenvalue:.2g} of F11, at {found.lowest_angle_deg:g} degrees",
    }
    return rows if found.albedo is None else rows | {"albedo": f"{found.albedo:.6g}"}


def tabulate_phase_matrix(phase_matrix: PhaseMatrix, angle_deg: Any) -> ScatteringTable:
    """The elements of a phase matrix at angles [degrees], by default so many that the way back is exact."""
    if angle_deg is None:
        count = 180 * math.ceil(1.5 * max(phase_matrix.terms, 8) / 180.0)
        angles = 180.0 * np.arange(count + 1) / count
    else:
        angles = check_vector("angle_deg", angle_deg)
    theta = np.radians(angles % 360.0)
    theta = np.minimum(theta, 2.0 * np.pi - theta)
    order = np.argsort(-theta)
    found = np.empty((6, angles.size))
    found[:, order] = phase_matrix.compute_elements(np.cos(theta[order]), find_gap(theta[order]))
    a1, a2, a3, a4, b1, b2 = found
    return ScatteringTable(freeze_copy(angles), *map(freeze_copy, (a1, b1, a2, a3, b2, a4)))


def expand_table(
    angle_deg: Any,
    columns: Sequence[Any],
    convention: str,
    normalise: bool,
    spheres: bool,
    ends: str | None,
    accuracy: float | None,
    tolerance: float,
) -> PhaseMatrix:
    """The phase matrix of a table over angle: see `PhaseMatrix.from_angles`."""
    about = find_convention(convention)
    check_number("tolerance", tolerance, 0.0, 1.0, "between 0 and 1, of the mean of F11 over the sphere")
    if accuracy is not None:
        accuracy = check_number("accuracy", accuracy, 1e-12, 0.1, "from 1e-12 to 0.1, of F11")
    if ends not in (None, EXTRAPOLATE):
        raise SceneError.of("ends", f'must be "{EXTRAPOLATE}" or left out, not {show_value(ends)}')
    angles = check_angles(angle_deg)
    elements = read_elements(angles, columns, about, spheres)
    sums = integrate_exactly(angles, elements)
    way, spline = f"exact quadrature over {angles.size} angles", None
    if ends is not None and (sums is not None or (angles[0] == 0.0 and angles[-1] == 180.0)):
        raise SceneError.of("ends", "fills what a table leaves out, and this one leaves out nothing")
    if sums is None:
        whole_angles, whole, way = fill_ends(angles, elements, ends)
        spline = ElementSpline(whole_angles, whole)
        sums = spline.integrate(1)
    mean = 0.5 * float(sums[0, 0])
    integral = check_integral(mean, about, convention, normalise)
    table = ScatteringTable(angles, *(freeze_copy(row) for row in elements / mean))
    lowest, where = check_coherency(table, tolerance)
    if spline is None:
        coefficients = cut_exact_terms(sums / mean, table, accuracy)
    else:
        warn_of_coarse_steps(whole_angles, whole, sums[0, 0])
        coefficients = expand_spline(spline, mean, whole_angles, whole / mean, accuracy or FINE_ENOUGH)
    error = make_readonly(follow_errors(coefficients, angles, table.elements)[1])
    found = Expansion(table, convention, integral, way, error, lowest, where)
    if found.largest_error > (accuracy or FINE_ENOUGH):
        warn_user(
            f"the expansion of a table over angle is off by {found.largest_error:.2g} of F11 at "
            f"{found.largest_error_angle_deg:g} degrees, with {len(coefficients)} terms; {accuracy or FINE_ENOUGH:g} "
            "was asked for (accuracy=)",
            AccuracyWarning,
        )
    return PhaseMatrix(*arrange_coefficients(coefficients), tolerance=tolerance, expansion=found)


def check_angles(angle_deg: Any) -> Array:
    """Scattering angles [degrees], ascending from 0 to 180 at most. Raises SceneError."""
    angles = check_vector("angle_deg", angle_deg)
    if not 2 <= angles.size <= MOST_ANGLES:
        raise SceneError.of("angle_deg", f"must be 2 to {MOST_ANGLES} angles, not {angles.size}")
    if angles[0] < 0.0 or angles[-1] > 180.0 or (np.diff(angles) <= 0.0).any():
        wrong = angles[1:][np.diff(angles) <= 0.0]
        given = f"{wrong[0]:g} behind a larger or the same one" if wrong.size else f"{angles[0]:g} to {angles[-1]:g}"
        raise SceneError.of("angle_deg", f"must ascend from 0 to 180 degrees, not be {given}")
    return angles


def check_columns(angles: Array, columns: Sequence[Any]) -> list[Array | None]:
    """Six columns (angles,) in the order of ELEMENTS, None where one is missing. Raises SceneError."""
    pairs = zip(ELEMENTS, columns, strict=True)
    found = [None if column is None else check_vector(name, column) for name, column in pairs]
    for name, column in zip(ELEMENTS, found, strict=True):
        if column is not None and column.size != angles.size:
            raise SceneError.of(name, f"must have a value for each of {angles.size} angles, not {column.size}")
    return found


def read_elements(angles: Array, columns: Sequence[Any], about: Convention, spheres: bool) -> Array:
    """vrte's elements (6, angles), not normalised, from six columns in the order of ELEMENTS, None where missing."""
    found = check_columns(angles, columns)
    missing = [name for name, column in zip(ELEMENTS, found, strict=True) if column is None]
    is_scalar = len(missing) >= len(ELEMENTS) - 1
    if spheres and not missing:
        raise SceneError.of("spheres", "fills columns that are missing, and none is")
    if spheres and not is_scalar:
        found = about.fill_in_spheres(found)
        missing = [name for name, column in zip(ELEMENTS, found, strict=True) if column is None]
    if missing and (spheres or not is_scalar):
        cure = "" if spheres else "; of spheres F22 = F11 and F44 = F33, which spheres=True takes for granted"
        words = f"is missing: all six elements are needed, or F11 alone (a scalar phase function){cure}"
        raise SceneError.of(missing[0], words)
    if missing and about.columns[0] != "F11":
        raise SceneError.of("F12", "is missing: in the convention F11 alone is not the intensity")
    elements = about.read(np.stack([np.zeros_like(angles) if column is None else column for column in found]))
    worst = int(np.argmin(elements[0]))
    if elements[0, worst] < -ROUNDED * elements[0].max() or elements[0].max() <= 0.0:
        raise SceneError.of("F11", f"must be positive, not {elements[0, worst]:.6g} at {angles[worst]:g} degrees")
    return elements


def fill_ends(angles: Array, elements: Array, ends: str | None) -> tuple[Array, Array, str]:
    """Angles and elements from 0 to 180 degrees, and in words what was done."""
    worst = int(np.argmin(elements[0]))
    if elements[0, worst] <= 0.0:
        raise SceneError.of("F11", f"must be above 0: it is {elements[0, worst]:.3g} at {angles[worst]:g} degrees")
    missing = [name for name, is_missing in ((FORWARD, angles[0] > 0.0), (BACKWARD, angles[-1] < 180.0)) if is_missing]
    way = f"a spline over {angles.size} angles"
    if not missing:
        return angles, elements, way
    if ends is None:
        words = (
            f"must reach from 0 to 180 degrees, not from {angles[0]:g} to {angles[-1]:g}: what lies beyond is unknown"
        )
        cure = f'ends="{EXTRAPOLATE}" goes on with log F11 and the ratios as parabolas'
        raise SceneError.of("angle_deg", f"{words}, and may be most of the light; {cure}")
    if angles.size < 3:
        raise SceneError.of("angle_deg", "must be at least 3 angles where the ends are extrapolated")
    for name in missing:
        theta = np.radians(angles if name == FORWARD else 180.0 - angles[::-1])
        end = extend_to_end(theta, elements if name == FORWARD else elements[:, ::-1], forward=name == FORWARD)
        angles = np.append(0.0, angles) if name == FORWARD else np.append(angles, 180.0)
        elements = np.hstack([end, elements] if name == FORWARD else [elements, end])
    names = " and ".join(f"{name} of {angles[1 if name == FORWARD else -2]:g} degrees" for name in missing)
    return angles, elements, f"{way}, extrapolated {names}"


def extend_to_end(theta: Array, elements: Array, forward: bool) -> Array:
    """Elements (6, 1) in the exact forward or backward direction, ``theta`` (n,) [radians] away: parabolas of log F11
    and ratios, with the symmetries of Hovenier and Mackowski, JQSRT 60, 483 (1998)."""
    near = theta <= max(2.0 * theta[0], theta[2])
    shape = np.vstack([np.log(elements[:1, near]), elements[[2, 3], :][:, near] / elements[0, near]])
    parabola = np.stack([np.ones(near.sum()), theta[near] ** 2], axis=1)
    log_f11, f22, f33 = np.linalg.lstsq(parabola, shape.T, rcond=None)[0][0]
    sign = 1.0 if forward else -1.0
    ratio = float(np.clip(0.5 * (f22 + sign * f33), 0.0, 1.0))
    scalar = not elements[1:].any()
    ratios = [1.0, 0.0, ratio, sign * ratio, 0.0, 0.0 if scalar else sign * (2.0 * ratio - 1.0)]
    return np.exp(log_f11) * np.array(ratios)[:, None]


def check_integral(mean: float, about: Convention, name: str, normalise: bool) -> float:
    """The mean of F11 over what it should be. Raises SceneError where that is too far from 1, or nothing is known."""
    integral = mean / (about.mean or 1.0)
    if normalise:
        return integral
    if about.mean is None:
        words = (
            f'must be True for the convention "{name}", which leaves the mean of F11 over the sphere open; here it is'
        )
        raise SceneError.of("normalise", f"{words} {mean:.6g}")
    if abs(integral - 1.0) > MEAN_ALLOWED:
        words = f'has a mean over the sphere of {integral:.6g} times what it should be in the convention "{name}"'
        why = "a peak is missed by the steps of the table, or it is of another convention"
        raise SceneError.of("F11", f"{words}: {why}; normalise=True divides by it all the same")
    return integral


def check_coherency(table: ScatteringTable, tolerance: float) -> tuple[float, float]:
    """The lowest coherency eigenvalue of a normalised table over F11, and its angle. Raises SceneError."""
    f11, f12, f22, f33, f34, f44 = table.elements
    lowest = find_lowest_coherency_eigenvalue(f11, f22, f33, f44, f12, f34)
    beyond = lowest + np.maximum(NEGATIVE_ALLOWED * f11 + ROUNDED * f11.max(), tolerance)
    worst = int(np.argmin(beyond))
    if beyond[worst] < 0.0:
        raise SceneError(
            f"the table is not physical: at {table.angle_deg[worst]:g} degrees its coherency matrix has the eigenvalue "
            f"{lowest[worst]:.3g} where F11 is {f11[worst]:.3g}; at least -{NEGATIVE_ALLOWED:g} F11 is allowed (check "
            f"the signs and the convention; tolerance={-1.1 * float(lowest.min()):.2g} takes it)"
        )
    relative = lowest / np.where(f11 > 0.0, f11, 1.0)
    index = int(np.argmin(relative))
    return float(relative[index]), float(table.angle_deg[index])


def warn_of_coarse_steps(angles: Array, elements: Array, integral: float) -> None:
    """Says so where a spline through every other angle has another integral, or is far off at those left out."""
    if angles.size < FEW:
        return
    kept = np.zeros(angles.size, dtype=bool)
    kept[::2] = kept[-1] = True
    fewer = ElementSpline(angles[kept], elements[:, kept])
    ratio, off = fewer.integrate(1)[0, 0] / integral, fewer.compare(angles[~kept], elements[0, ~kept])
    if abs(ratio - 1.0) > MISSED or off > UNRESOLVED:
        warn_user(
            f"the steps of a table over angle are coarse: without every other angle the mean of F11 is {ratio:.3g} "
            f"times as large, and F11 at those left out is missed by up to a factor of {math.exp(min(off, 99.0)):.3g}; "
            "what lies between its angles is as uncertain, a peak above all",
            AccuracyWarning,
        )


def cut_exact_terms(sums: Array, table: ScatteringTable, accuracy: float | None) -> Array:
    """Coefficients (terms, 6) from integrals: those above noise, or as few as an accuracy takes."""
    coefficients = (np.arange(len(sums)) + 0.5)[:, None] * sums
    if accuracy is not None:
        worst, _ = follow_errors(coefficients, table.angle_deg, table.elements)
        return coefficients[: count_terms(worst, accuracy)]
    size = np.abs(coefficients).max(axis=1)
    noise = max(NO_MORE_TERMS, NOISE * float(size[3 * len(size) // 4 :].max()))
    kept = np.flatnonzero(size > noise)
    return coefficients[: 1 + int(kept[-1])] if kept.size else coefficients


def expand_spline(spline: ElementSpline, mean: float, angles: Array, elements: Array, accuracy: float) -> Array:
    """Coefficients (terms, 6), as many as the accuracy needs at the angles of the table, or LAST_TERMS."""
    terms = FIRST_TERMS
    while True:
        coefficients = (np.arange(terms) + 0.5)[:, None] * spline.integrate(terms) / mean
        worst, _ = follow_errors(coefficients, angles, elements)
        if worst[-1] <= accuracy or terms == LAST_TERMS:
            return coefficients[: count_terms(worst, accuracy)]
        terms *= 2
