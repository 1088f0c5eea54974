"""What each Fourier order can add where rough surfaces lie on top of layers, known beforehand.

Facets make light of every order of a beam, and with these alone it is seen in closed form. What is left of order m >= 1
enters as light on the nodes, e_m, comes back from the layers, R_m e_m, and may be sent down again by the facets, top_m.
With the norm of L2, light scaled on the nodes by sqrt(weight mu), a base that reflects evenly is black, and

    |R_m| <= q/(2 - q),    |top_m| <= 1,    so that    |L_m| <= |t_m| |e_m| q/(2 (1 - q))/(2 pi)

for t_m, which facets send up with. The first: light u within obeys d/dtau <mu u, u> = -2 (<u, u> - <u, A u>), so that
|e|^2 - |r|^2 >= 2 (1 - q) int |u|^2; and the r that comes out has |r|^2 <= q^2/2 int |u|^2 by Schwarz's inequality. The
second: no facet reflects more than all light. Orders of facets are at most the integral of the norm of their Mueller
matrix over azimuth, which is twice that of I at most.
"""

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, replace_unchecked
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.rough import FacetOrders
from vrte.discrete_ordinates.orders.single_interface import find_depths_within, is_under_one_surface
from vrte.discrete_ordinates.orders.single_scattering import integrate_paths
from vrte.discrete_ordinates.planning.order_bounds import ALMOST_ONE
from vrte.scene.boundary import Boundary

# trial factors by which these bounds may exceed the light that is found: 1e5 to 1e8 at alpha = 0.05 to 0.2
CAREFUL_UNDER_FACETS = 1e7, 1e5, 1e3


SAMPLES = 16  # incident and outgoing directions that facets are integrated for, the others between them
ENOUGH = 1e-3  # accuracy of these integrals


def couples_orders(problem: Problem, base: Boundary) -> bool:
    """Whether light of orders or Stokes parameters that no particle scatters comes back: from flakes, an uneven base,
    or between surfaces, one of them rough."""
    media = problem.media
    if any(problem.oriented):
        return True
    return base.is_uneven or (media is not None and media.scene.is_rough and not is_under_one_surface(media))


def bound_orders_under_facets(problem: Problem, strength: Array) -> tuple[Array, Array]:
    """Bounds (1, order, n_tau, n_in) on the light of each order, infinite below the surface and where facets do not
    hide each other, and a light it can be compared with, (1, n_tau, n_in): I scattered once in the layers, order 0.
    strength (order,): the norms q."""
    media, mu0 = problem.media, problem.mu0
    assert media is not None
    surface, within = media.scene.interfaces[0], find_depths_within(media)
    assert surface is not None
    beams, seen = (np.unique(cosines) for cosines in (mu0, problem.mu_out))
    beams, seen = (each[np.linspace(0, each.size - 1, min(each.size, SAMPLES)).astype(int)] for each in (beams, seen))
    mu, weights = media.nodes.carried(media.scene.indices[0])
    root = np.sqrt(weights * mu)
    above = FacetOrders(surface.facets, media.nodes, ENOUGH)
    up, down = above.turned.seen(True, seen, 1), above.sent(True, beams, 1)
    up, entering = up[0, :, :, 0, 0].T * root, down[0, :, :, 0, 0] * root * beams[:, None]  # I, (direction, node)
    most = 4.0 * np.linalg.norm(problem.columns, axis=1).max() * np.linalg.norm(up, axis=1).max()
    norms = np.interp(mu0, beams, most * np.linalg.norm(entering, axis=1))
    q = np.minimum(strength, ALMOST_ONE)
    bounds = np.empty((1, q.size, within.size, mu0.size))
    bounds[:] = (q / (4.0 * np.pi * (1.0 - q)))[:, None, None] * norms
    bounds[0, np.setdiff1d(np.arange(q.size), [0, 2])[:, None], :, np.flatnonzero(mu0 == 1.0)] = 0.0
    bounds[0, :, within] = np.inf
    bounds[:, : q.size if not surface.facets.shadowing else 1] = np.inf
    first = np.zeros(1, np.int32)
    along = replace_unchecked(problem, mu0=mu, level=np.zeros(1), level_layer=first)
    paths = integrate_paths(along, first, mu).reshape(-1, mu.size, mu.size)
    once = np.zeros((mu.size, mu.size))
    for coefficients, albedo, path in zip(problem.coefficients, problem.albedo.tolist(), paths, strict=True):
        matrix = _core.phase_matrices(0, coefficients, -mu, mu)[..., 0, 0]
        once += 0.25 / np.pi * albedo * path.T * matrix
    light = up * root @ once @ (entering * np.sqrt(weights / mu)).T  # (n_out, n_in)
    brightest = np.interp(mu0, beams, light.max(axis=0))
    return bounds, np.broadcast_to(brightest, (1, within.size, mu0.size)).copy()
