"""Double-Gauss quadrature, (1:15): Gauss-Legendre nodes on each hemisphere."""

import numpy as np

from vrte.arrays import Array


def double_gauss(nodes: int) -> tuple[Array, Array]:
    """Nodes mu in (0, 1), ascending, and their weights (they sum to 1), each (nodes,).

    >>> double_gauss(1)
    (array([0.5]), array([1.]))
    """
    x, weights = np.polynomial.legendre.leggauss(nodes)
    return 0.5 * (x + 1.0), 0.5 * weights
