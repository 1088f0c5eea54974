"""Scattering matrices on nodes of a quadrature, projected on the functions that they expand in."""

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.spherical_functions import compute_wigner_functions
from vrte.optics.phase_matrix import PAIRS


def project_elements(
    cosine: Array, plain: Array, crossed: Array, plus: Array, minus: Array, terms: int, gap: Array | None = None
) -> Array:
    """Integrals over the cosine of six combinations of a scattering matrix times their functions: (terms, 6).

    On nodes ``cosine`` (n,), ascending, times their weights: ``plain`` (n, 2), F11 and F44, with d^l_00; ``crossed``
    (n, 2), -F12 and -F34, with d^l_02; ``plus`` and ``minus`` (n,), F22 + F33 and F22 - F33, with d^l_22 and d^l_2,-2.
    ``gap`` as in `compute_wigner_functions`.
    """
    sums = np.empty((terms, 6))
    for first, block in compute_wigner_functions(PAIRS, terms, cosine, gap):
        rows = slice(first, first + len(block))
        sums[rows, :2], sums[rows, 2:4] = block[:, 0] @ plain, block[:, 1] @ crossed
        sums[rows, 4], sums[rows, 5] = block[:, 2] @ plus, block[:, 3] @ minus
    return sums


def arrange_coefficients(sums: Array) -> tuple[Array, ...]:
    """a1, a2, a3, a4, b1, b2 from integrals (terms, 6) that have their factor."""
    a1, a4, b1, b2, total, difference = sums.T
    return a1, 0.5 * (total + difference), 0.5 * (total - difference), a4, b1, b2
