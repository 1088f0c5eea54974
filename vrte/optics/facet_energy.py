"""What facets do with the energy of light: shares reflected and let through once, and what they hide given back.

Facets see of light along mu what Smith's factor G(mu) leaves, and send all of that on, R + T = 1, into directions that
other facets hide by G(mu_o). Light let through that meets another facet is let through there as well, the straighter
the closer both indices are: it goes on where it was going, and f_t has the lesser of G(mu_i) and G(mu_o) in place of
their product. That is reciprocal, makes nothing, and all of the light goes on as the indices become one.

What is lost then, l(mu) = 1 - R - T of I and Q, leaves after more bounces. Given back it is even but for what makes it
reciprocal, f = c l(mu_o) l(mu_i)^T on either side: with L the integral of l mu over the hemisphere, c = (1 - t)/L on
the side it came from, t/L' on the other, so that R + T = 1 for every mu_i. t and t' are as large as exchange between
both sides, t n^2 L = t' n'^2 L', and the shares let through of light from everywhere allow. Where light that gets in
stays there, l is that of facets which reflect everything, and each further bounce takes its mean share.

Source: Kulla and Conty, Revisiting physically based shading at Imageworks (2017), for one side.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from vrte.basics.arrays import Array, Remembered
from vrte.basics.quadrature import RefractedNodes, make_double_gauss, make_refracted_nodes
from vrte.optics.facet_integrals import gather_orders
from vrte.optics.facets import RoughSurface
from vrte.optics.fresnel import reflect_smooth

NODES, FINE = 40, 1e-9
TABLE = 512  # cosines, even in their root, between which splines are right to 1e-6 (mu < 0.005, n - 1 = 1e-5: 4e-3)
_SHARED = Remembered()  # the same facets lie on a panel at every thickness, over every base
EVERYTHING = 1e6j  # times the index before: facets that reflect all, whatever the angle


def share_energy(surface: RoughSurface, mu: Array) -> tuple[Array, Array]:
    """Shares R, T of unpolarized light along mu (n,) that facets reflect and let through, (n,) each."""
    reflected, through = (part[:, 0] for part in share_once(surface, mu))
    if not surface.conserving:
        return reflected, through
    own, other = find_strengths(surface)
    lost = find_lost(surface, mu)[:, 0]
    reflected = reflected + own * lost * weigh_lost(surface)
    return reflected, through if surface.closed else through + other * lost * weigh_lost(surface.turned)


def restore_lost(surface: RoughSurface, mu_i: Array, mu_o: Array, transmitted: bool) -> Array:
    """What single bounces lose, given back: f of I and Q [1/sr], (..., 2, 2) on the shape of the directions, mu_o on
    the side it goes to."""
    there = find_lost(surface.turned if transmitted else surface, mu_o)
    both: Array = there[..., :, None] * find_lost(surface, mu_i)[..., None, :]
    return find_strengths(surface)[transmitted] * both


def share_once(surface: RoughSurface, mu: Array) -> tuple[Array, Array]:
    """R and T of single bounces, of I and of what Q adds, (n, 2) each, by reciprocity: the I and Q that evenly lit
    facets send along mu."""

    def integrate() -> tuple[Array, Array]:
        nodes = place_nodes(surface)
        cosines, weights = nodes.carried(surface.index_from)
        sent = gather_orders(surface, False, nodes, mu, 1, FINE)[0, ..., :2, 0]
        reflected = np.tensordot(weights * cosines, sent, 1)
        if not surface.is_clear:
            return reflected, np.zeros_like(reflected)
        cosines, weights = nodes.carried(surface.index.real)
        sent = gather_orders(surface.turned, True, nodes, mu, 1, FINE)[0, ..., :2, 0]
        return reflected, surface.ratio.real**2 * np.tensordot(weights * cosines, sent, 1)

    reflected, through = _SHARED.find((surface, mu.tobytes()), integrate)
    return reflected, through


def find_lost(surface: RoughSurface, mu: Array) -> Array:
    """1 - R - T of single bounces along mu (...), of I and of what Q adds, (..., 2), of facets that reflect everything
    where light that gets in stays."""
    cosines, index = np.unique(mu, return_inverse=True)
    if cosines.size > TABLE:
        from scipy.interpolate import CubicSpline

        root = np.arange(1, TABLE + 1) / TABLE
        lost = CubicSpline(root, find_lost(surface, root**2))(np.sqrt(cosines))
    else:
        lit = replace(surface, index=EVERYTHING * surface.index_from) if surface.closed else surface
        reflected, through = share_once(lit, cosines)
        lost = np.array([1.0, 0.0]) - reflected - through
    lost[:, 0] = np.maximum(lost[:, 0], 0.0)  # of I: integrals may miss that where it is next to nothing
    return lost[index].reshape(*np.shape(mu), 2)


@lru_cache(maxsize=64)
def weigh_lost(surface: RoughSurface) -> float:
    """L, the integral of l mu over the hemisphere."""
    mu, weights = place_nodes(surface).carried(surface.index_from)
    return float(2.0 * np.pi * (weights * mu) @ find_lost(surface, mu)[:, 0])


@lru_cache(maxsize=64)
def find_strengths(surface: RoughSurface) -> tuple[float, float]:
    """c on the side that light comes from, and on the other."""
    lost = weigh_lost(surface)
    if surface.closed:
        mu, weights = make_double_gauss(NODES)
        mean = 2.0 * weights * mu
        each, kept = float(mean @ reflect_smooth(surface.ratio, mu)[:, 0, 0]), 1.0 - lost / np.pi
        return each**2 * kept / (1.0 - each * (1.0 - kept)) / lost, 0.0
    sides = surface, surface.turned
    most = []
    for side in sides:
        mu, weights = place_nodes(side).carried(side.index_from)
        reflected, through = (float((weights * mu) @ share[:, 0]) for share in share_once(side, mu))
        most.append(through / (reflected + through) * side.index_from**2 * weigh_lost(side))
    through = min(most) / (surface.index_from**2 * lost)
    return (1.0 - through) / lost, through / weigh_lost(sides[1])


def place_nodes(surface: RoughSurface) -> RefractedNodes:
    """Nodes of the medium that light comes from, and of the one behind where light comes back from there."""
    return make_refracted_nodes([surface.index_from, *([surface.index.real] if surface.is_clear else [])], NODES)
