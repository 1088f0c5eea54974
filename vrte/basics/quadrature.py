"""Double-Gauss quadrature, (1:15): Gauss-Legendre nodes on each hemisphere."""

from functools import lru_cache

from vrte.basics.arrays import Array
from vrte.basics.spherical_functions import find_gauss_legendre

kept = lru_cache(maxsize=16)(find_gauss_legendre)


def make_double_gauss(nodes: int) -> tuple[Array, Array]:
    """Nodes mu in (0, 1), ascending, and their weights (they sum to 1), each (nodes,), of (1:15).

    >>> make_double_gauss(1)
    (array([0.5]), array([1.]))
    """
    x, weights = kept(nodes)
    return 0.5 * (x + 1.0), 0.5 * weights
