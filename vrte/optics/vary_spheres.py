"""How spheres change with their numbers: derivatives of cross sections and of the phase matrix, in closed form.

Those of a_n and b_n come from the compiled recursions (core/mie.pxi); what is made of a_n and b_n is quadratic in them,
and linear in the weights of sizes. The radii, their number and the number of terms are those of the value.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.spherical_functions import find_gauss_legendre
from vrte.optics.particles import Particles
from vrte.optics.phase_matrix import arrange_coefficients, project_elements
from vrte.optics.populations import (
    ANGLES_AT_ONCE,
    SIZES_AT_ONCE,
    Complex,
    combine_sphere_elements,
    compute_angular_functions,
    count_held_orders,
    find_amplitudes,
)
from vrte.optics.spheres import Ball


@dataclass(frozen=True, eq=False)
class SphereNumbers:
    """All that spheres of many sizes depend on, or what it changes by with a number: ``arguments`` of a_n and b_n
    (arguments, sizes), radii [um] and weights (sizes,), and the wavenumber in the host [1/um]."""

    arguments: Complex
    radii: Array
    weights: Array
    wavenumber: Array

    @classmethod
    def of(cls, ball: Ball, count: int, moment: int) -> "SphereNumbers":
        """Of a ball, averaged over ``count`` radii up to a ``moment``."""
        radii, weights = ball.read_quadrature(count, moment)
        return cls(ball.list_arguments(radii), radii, weights, np.array(ball.wavenumber))


@dataclass(frozen=True, eq=False)
class ParticleSlopes:
    """Derivatives of cross sections [um2], volume [um3] and coefficients (terms, 6): those of a `Particles`."""

    extinction_um2: float
    scattering_um2: float
    volume_um3: float
    coefficients: Array


def vary_spheres(
    ball: Ball, particles: Particles, numbers: SphereNumbers, changes: Sequence[SphereNumbers]
) -> list[ParticleSlopes]:
    """Derivatives of the ``particles`` that a ball's average over sizes is, for each of several changes of what it
    depends on. Source: the derivative of Bohren and Huffman (1983), (4.61), (4.62) and (4.77)."""
    arguments = np.array([change.arguments for change in changes])  # (changes, arguments, sizes)
    moving = np.flatnonzero(arguments.any(axis=(0, 2)))
    arguments = arguments[:, moving]
    tables = [ball.find_slopes(float(radius)) for radius in numbers.radii]
    orders = max(int(count_held_orders(table[0])) for table in tables)
    values = np.zeros((numbers.radii.size, 2, orders), complex)
    slopes = np.zeros((moving.size, *values.shape), complex)
    for row, table in enumerate(tables):
        kept = min(orders, table.shape[2])
        values[row, :, :kept], slopes[:, row, :, :kept] = table[0, :, :kept], table[1 + moving, :, :kept]
    weights, weight_slopes = numbers.weights, np.array([change.weights for change in changes])
    stretch = np.array([2.0 * float(change.wavenumber / numbers.wavenumber) for change in changes])
    twice = 2.0 * np.arange(1, orders + 1) + 1.0
    # extinction and scattering, and their derivatives with each argument, which a real and an imaginary step share
    sums = np.stack([values.sum(axis=1).real @ twice, (np.abs(values) ** 2).sum(axis=1) @ twice])
    scattered = 2.0 * np.einsum("spn,aspn,n->as", values.conj(), slopes, twice)  # no array between: it would be large
    turns = np.stack([np.einsum("aspn,n->as", slopes, twice), scattered])
    more = np.einsum("kas,qas,s->qk", arguments, turns, weights).real
    areas = sums @ weight_slopes.T + more - np.outer(sums @ weights, stretch)
    areas *= 2.0 * math.pi / float(numbers.wavenumber) ** 2
    integrals = _differentiate_integrals(values, slopes, weights, arguments, weight_slopes)
    coefficients = particles.phase_matrix.coefficients
    degree = np.arange(len(coefficients))[:, None]
    found = []
    for (extinction, scattering), change, table in zip(areas.T.tolist(), changes, integrals, strict=True):
        if not ball.absorbs and not change.arguments.imag.any():
            extinction = scattering  # as their values are the same, to all digits
        volumes = change.weights @ numbers.radii**3 + 3.0 * weights @ (numbers.radii**2 * change.radii)
        turned = np.stack(arrange_coefficients(table[: len(degree)] * (2.0 * degree + 1.0)), axis=1)
        turned = (turned - coefficients * table[0, 0]) / (sums[1] @ weights)
        turned[0, 0] = 0.0  # of a1[0], which is 1, but for rounding
        found.append(ParticleSlopes(extinction, scattering, 4.0 / 3.0 * math.pi * float(volumes), turned))
    return found


def _differentiate_integrals(
    values: Complex, slopes: Complex, weights: Array, arguments: Complex, weight_slopes: Array
) -> Array:
    """Derivatives of the integrals that `project_elements` gives, (changes, terms, 6), without their factors."""
    orders, changes = values.shape[2], len(arguments)
    terms = 2 * orders + 1
    cosine, gauss = find_gauss_legendre(terms)
    squares, cross = np.zeros((2, changes, terms)), np.zeros((changes, terms), complex)
    for start in range(0, terms, ANGLES_AT_ONCE):
        angles = slice(start, start + ANGLES_AT_ONCE)
        functions = compute_angular_functions(orders, cosine[angles])
        for first in range(0, len(values), SIZES_AT_ONCE):
            rows = slice(first, first + SIZES_AT_ONCE)
            both = find_amplitudes(values[rows, 0], values[rows, 1], functions)
            for square, one in zip(squares, both, strict=True):
                square[:, angles] += weight_slopes[:, rows] @ np.abs(one) ** 2
            cross[:, angles] += weight_slopes[:, rows] @ (both[0] * both[1].conj())
            for argument, slope in enumerate(slopes[:, rows]):
                moved, share = find_amplitudes(slope[:, 0], slope[:, 1], functions), arguments[:, argument, rows]
                share = share * weights[rows]
                for square, one, more in zip(squares, both, moved, strict=True):
                    square[:, angles] += 2.0 * (share @ (one.conj() * more)).real
                cross[:, angles] += share @ (moved[0] * both[1].conj()) + (share @ (both[0].conj() * moved[1])).conj()
    combined = combine_sphere_elements(*((0.5 * gauss * part).T for part in (*squares, -cross.real, cross.imag)))
    return np.moveaxis(project_elements(cosine, combined, terms), 2, 0)
