"""What data can tell of the numbers that were fitted: covariance, singular values, and in words what they cannot."""

from collections.abc import Sequence

import numpy as np

from vrte.basics.arrays import Array

ALIKE = 0.99  # of a correlation: beyond, two numbers cannot be told apart
LEAST = 3.0  # of a singular value: below, a third of a number's value is less than one sigma of all data together
NOTICED = 0.1  # sigma of any one row
NAMED = 0.1  # of the largest part of a direction


def find_scales(values: Array, ranges: Array) -> Array:
    """What changes of each number are counted in: its value, or its range where that is 0."""
    ranges = np.where(np.isfinite(ranges), ranges, 1.0)
    return np.where(values == 0.0, ranges, np.abs(values))


def find_covariance(slopes: Array, scales: Array) -> Array:
    """(n, n) from the derivatives (residuals, n) in sigmas; inf along what they do not tell at all."""
    _, singular, ways = np.linalg.svd(slopes * scales, full_matrices=False)
    told = singular > singular.max(initial=0.0) * slopes.shape[1] * np.finfo(float).eps
    spread = (ways[told].T / singular[told] ** 2) @ ways[told]
    lost = (np.abs(ways[~told]) > 1e-8).any(axis=0)
    if ways.shape[0] < scales.size:
        lost[:] = True
    spread[lost, lost] = np.inf
    return spread * np.outer(scales, scales)


def find_correlations(covariance: Array) -> Array:
    """(n, n), 1 on the diagonal; NaN where an error is not finite."""
    with np.errstate(invalid="ignore", divide="ignore"):
        errors = np.sqrt(np.diag(covariance))
        found = covariance / np.outer(errors, errors)
    found[~np.isfinite(found)] = np.nan
    np.fill_diagonal(found, 1.0)
    return found


def list_alike(names: Sequence[str], correlations: Array) -> list[tuple[str, str, float]]:
    """Pairs of numbers that cannot be told apart, and their correlations."""
    pairs = np.argwhere(np.triu(np.ones(correlations.shape), 1)).tolist()
    return [(names[i], names[j], float(correlations[i, j])) for i, j in pairs if abs(correlations[i, j]) > ALIKE]


def find_blind_spots(names: Sequence[str], slopes: Array, values: Array, scales: Array) -> tuple[Array, list[str]]:
    """Singular values (n,) of the derivatives in sigmas by relative changes, and what they cannot tell in words."""
    scaled = slopes * scales
    _, singular, ways = np.linalg.svd(scaled, full_matrices=True)
    singular = np.concatenate([singular, np.zeros(len(names) - singular.size)])
    told = []
    for size, way in zip(singular.tolist(), ways, strict=True):
        if size >= LEAST:
            continue
        strongest = float(np.abs(scaled @ way).max())
        length = min(NOTICED / strongest, 1.0) if strongest > 0.0 else 1.0
        told.append(describe_way(names, way * length, values, scales))
    return singular, told


def describe_way(names: Sequence[str], way: Array, values: Array, scales: Array) -> str:
    """A direction that the data do not see, in words.

    >>> describe_way(["radius_um", "width"], np.array([0.03, -0.05]), np.ones(2), np.ones(2))
    'radius_um up 3 % with width down 5 % changes no row by more than 0.1 sigma'
    """
    parts = []
    first = int(np.flatnonzero(np.abs(way) >= NAMED * np.abs(way).max())[0])
    sign = 1.0 if way[first] > 0.0 else -1.0
    for name, part, value, scale in zip(names, sign * way, values, scales, strict=True):
        if abs(part) < NAMED * np.abs(way).max():
            continue
        much = f"{100.0 * abs(part):.2g} %" if value != 0.0 else f"by {abs(part) * scale:.2g}"
        parts.append(f"{name} {'up' if part > 0.0 else 'down'} {much}")
    return f"{' with '.join(parts)} changes no row by more than {NOTICED:g} sigma"
