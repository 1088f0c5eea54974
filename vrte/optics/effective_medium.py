"""The refractive index that light meets in a host full of spheres, by two rules.

Both give a real index, that of the wave's phase; what is scattered out of it is the layer's affair.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from vrte._core import coated_sphere_coefficients
from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.optics.populations import FEWEST_RADII
from vrte.optics.spheres import count_orders

Kinds = Sequence[tuple[Any, float]]  # balls with number shares, in one host at one wavelength
FEW = 1e-3  # volume fraction up to which an index rises in proportion to it
STEP, STEP_OF_PHASE, FURTHEST = 0.01, 0.1, 2.0  # of the host's index, in search of another; of a sphere; a factor


def list_sizes(kinds: Kinds) -> tuple[Array, Array, Array]:
    """Radii [um] of spheres of all kinds, their number shares, and the permittivity of each: all (sizes,)."""
    rows = []
    for ball, share in kinds:
        radii, weights = ball.read_quadrature(FEWEST_RADII, 6)
        rows.append((radii, share * weights, [ball.find_permittivity(float(radius)) for radius in radii]))
    radii, weights, permittivities = map(np.concatenate, zip(*rows, strict=True))
    return radii, weights, permittivities


def find_maxwell_garnett_index(kinds: Kinds, volume_fraction: float) -> float:
    """Maxwell Garnett's index of a host with spheres much smaller than the wavelength: (e - e_h)/(e + 2 e_h) = sum over
    kinds of f_k (e_k - e_h)/(e_k + 2 e_h). Source: Bohren and Huffman (1983), section 8.5."""
    radii, weights, permittivities = list_sizes(kinds)
    host = kinds[0][0].host ** 2
    volumes = weights * radii**3
    dipoles = volume_fraction * complex(volumes @ ((permittivities - host) / (permittivities + 2.0 * host)))
    dipoles /= float(volumes.sum())
    return float(np.sqrt(host * (1.0 + 2.0 * dipoles) / (1.0 - dipoles)).real)


def find_coherent_potential_index(kinds: Kinds, volume_fraction: float) -> float:
    """The index of the coherent potential: around it, spheres in shells of host do not change the phase of light.

    A sphere of radius r stands in a shell of host up to r volume_fraction^(-1/3), in the medium that is looked for: the
    imaginary part of S(0), summed over sizes, is zero there. Small spheres have Maxwell Garnett's index, few ones
    van de Hulst's. The solution is the first one from the host's index on. Coated spheres count as homogeneous ones of
    the same static polarizability. Raises SceneError where there is no solution up to a factor of 2.

    Source: Soukoulis, Datta and Economou, Phys. Rev. B 49, 3800 (1994), of which the condition on the phase is taken.
    """
    from scipy.optimize import brentq

    radii, weights, permittivities = list_sizes(kinds)
    host, wavelength = kinds[0][0].host, kinds[0][0].wavelength_um
    if volume_fraction < FEW:
        return host + volume_fraction / FEW * (find_coherent_potential_index(kinds, FEW) - host)
    substances, shells = np.sqrt(permittivities), radii * volume_fraction ** (-1.0 / 3.0)
    most = count_orders(2.0 * math.pi * FURTHEST * host / wavelength * float(shells.max()) * (1.0 + STEP))
    twice = np.arange(3.0, 2.0 * most + 2.0, 2.0)  # 2 n + 1

    def advance(index: float) -> float:
        """The phase that light gains by the spheres, with any positive factor."""
        wavenumber = 2.0 * math.pi * index / wavelength
        sizes = wavenumber * radii, wavenumber * shells
        orders = np.array([*map(count_orders, sizes[1].tolist())], np.int32)
        indices = np.array([substances, np.full(radii.size, host)], np.complex128) / index
        found = coated_sphere_coefficients(indices[0], indices[1], *sizes, orders)
        gained = -weights @ (found.imag @ twice[: found.shape[2]]).sum(axis=1)  # Im S(0)
        return float(gained) / wavenumber**3

    phase = 2.0 * math.pi * host / wavelength * float(weights @ shells**3) / float(weights @ shells**2)
    before, sign = host, math.copysign(1.0, advance(host))
    step = sign * host * min(STEP, STEP_OF_PHASE / phase)
    while host / FURTHEST < before < host * FURTHEST:
        if sign * advance(before + step) <= 0.0:
            return float(brentq(advance, before, before + step, xtol=1e-12, rtol=1e-12))
        before += step
    words = "has no solution for these spheres at this volume fraction"
    raise SceneError.of("layer: packing", f'"coherent-potential" {words}; "effective-medium" always has')
