"""Spheres of many sizes: from the coefficients a_n and b_n of each to what a layer needs to know of all.

Amplitudes S1 and S2 and coefficients are those of Bohren and Huffman, "Absorption and scattering of light by small
particles" (1983), chapter 4, for a refractive index n + i k.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte.basics import cost
from vrte.basics.arrays import Array
from vrte.basics.quadrature import compute_wigner_functions, find_gauss_legendre
from vrte.optics.phase_matrix import PhaseMatrix, arrange_coefficients, project_elements

Complex = NDArray[np.complex128]

NEGLIGIBLE = 1e-16  # |a_n|, |b_n| of orders left out, over the largest
LEFT_OUT = 1e-12  # largest expansion coefficient left out; a1[0] is 1
FEWEST_RADII, MOST_RADII = 129, 2049
CONVERGED = np.array([1e-6, 1e-6, 1e-6, 1e-4])  # relative: extinction, scattering, asymmetry, backscattering
ALL_SIZES_UP_TO = 100.0  # size parameter from which radii follow the sum of r^4 instead of r^6
ORDERS_TOGETHER, FEW_ORDERS = 4, 48  # few orders are rounded up to multiples: their angles are kept
ANGLES_AT_ONCE, SIZES_AT_ONCE = 512, 256  # bound the memory


@dataclass(frozen=True, eq=False)
class Population:
    """Spheres of many sizes: radii [um], size parameters, weights; a_n, b_n (sizes, orders); cross sections."""

    radii: Array
    sizes: Array
    weights: Array
    a: Complex
    b: Complex
    cross_sections: Array


def count_held_orders(found: Complex) -> Any:
    """The number of orders of a_n and b_n (..., 2, orders) without trailing zeros, (...)."""
    strength = np.abs(found).max(axis=-2)
    holds = strength > NEGLIGIBLE * strength.max(axis=-1, keepdims=True)
    return strength.shape[-1] - np.argmax(holds[..., ::-1], axis=-1)


def average_population(ball: Any) -> tuple[Population, int, float]:
    """Spheres of a `Ball` of as many radii as it takes, how many, and the last relative change of cross sections."""
    solved: list[tuple[Array, Complex, Complex, Array]] = []  # radii, a_n, b_n, cross sections of each step

    def average(count: int, moment: int) -> tuple[tuple[Array, Array], Array, int]:
        radii, weights = ball.read_quadrature(count, moment)
        ball.check_radii(radii)
        new = np.setdiff1d(radii, np.concatenate([step[0] for step in solved])) if solved else np.unique(radii)
        if new.size:
            a, b = ball.find_coefficients(new)
            solved.append((new, a, b, find_cross_sections(a, b)))
        return (radii, weights), weights @ stack_rows([step[3] for step in solved])[find_rows(radii)], radii.size

    def find_rows(radii: Array) -> Any:
        known = np.concatenate([step[0] for step in solved])
        order = known.argsort()
        return order[np.searchsorted(known, radii, sorter=order)]

    largest = ball.wavenumber * ball.read_quadrature(2, 6)[0][-1]
    moment = 6 if largest <= ALL_SIZES_UP_TO else 4
    (radii, weights), count, change = ball.average_sizes(average, moment, (FEWEST_RADII, MOST_RADII), CONVERGED)
    rows = find_rows(radii)
    tables = (stack_rows(table)[rows] for table in list(zip(*solved, strict=True))[1:])
    return Population(radii, ball.wavenumber * radii, weights, *tables), count, change


def stack_rows(tables: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """The rows of tables (rows, columns) one below another, with zeros behind shorter ones."""
    stacked = np.zeros((sum(map(len, tables)), max(table.shape[1] for table in tables)), tables[0].dtype)
    first = 0
    for table in tables:
        stacked[first : first + len(table), : table.shape[1]] = table
        first += len(table)
    return stacked


def sum_bulk(population: Population) -> Array:
    """Extinction, scattering, asymmetry x scattering and backscattering, averaged; cross sections k^2/(2 pi)."""
    return population.weights @ population.cross_sections


def find_cross_sections(a: Complex, b: Complex) -> Array:
    """Extinction, scattering, asymmetry, backscattering (sizes, 4), times k^2/(2 pi): Bohren and Huffman (1983), 4."""
    order = np.arange(1.0, a.shape[1] + 1.0)
    twice = 2.0 * order + 1.0
    extinction = (a + b).real @ twice
    scattering = (np.abs(a) ** 2 + np.abs(b) ** 2) @ twice
    neighbours = (a[:, :-1] * a[:, 1:].conj() + b[:, :-1] * b[:, 1:].conj()).real
    asymmetry = neighbours @ (order * (order + 2.0) / (order + 1.0))[:-1]
    asymmetry += (a * b.conj()).real @ (twice / (order * (order + 1.0)))
    back = np.abs((a - b) @ (twice * (-1.0) ** order)) ** 2
    return np.stack([extinction, scattering, 2.0 * asymmetry, 0.5 * back], axis=1)


def expand_population(population: Population) -> PhaseMatrix:
    """The phase matrix of spheres that scatter independently: 2 n + 1 nodes and terms are exact for n orders."""
    terms = 2 * round_up(population.a.shape[1]) + 1
    return make_phase_matrix(expand_elements(partial(compute_scattering_elements, population), terms)[0])


def expand_elements(find_elements: Callable[[Array], Array], terms: int) -> tuple[Array, float]:
    """a1, a4, b1, b2, a2 + a3 and a2 - a3 (terms, 6), by Gauss-Legendre quadrature, and the integral of F11, from F11 +
    F33, F11 - F33, F12, F34 (4, angles) at ascending cosines. Source: de Rooij and van der Stap (1984), section 3."""
    why = f", most of it for a phase matrix of {terms} terms"
    change = "smaller particles, or a smaller host_index, take less"
    cost.warn_runtime(cost.SECONDS_OF_TERMS * terms**2, math.inf, why, change)
    cosine, weights = find_gauss_legendre(terms)
    pieces = range(0, terms, ANGLES_AT_ONCE)
    elements = [find_elements(cosine[start : start + ANGLES_AT_ONCE]) for start in pieces]
    plus, minus, f12, f34 = weights * np.concatenate(elements, axis=1)
    sums = project_elements(cosine, combine_sphere_elements(plus, minus, f12, f34), terms)
    integral = float(sums[0, 0])
    sums *= (2.0 * np.arange(terms)[:, None] + 1.0) / integral
    return sums, integral


def combine_sphere_elements(plus: Array, minus: Array, f12: Array, f34: Array) -> Array:
    """What `project_elements` takes, (6, ...), of F11 + F33, F11 - F33, F12, F34 of spheres: F22 = F11, F44 = F33."""
    return np.stack([0.5 * (plus + minus), 0.5 * (plus - minus), -f12, -f34, plus, minus])


def make_phase_matrix(sums: Array) -> PhaseMatrix:
    """Coefficients of `expand_elements` without trailing zeros."""
    return PhaseMatrix(*arrange_coefficients(sums[: count_terms(sums, LEFT_OUT)]))


def count_terms(sums: Array, left_out: float | Array) -> int:
    """Up to the last one that holds more than what may be left out."""
    return 1 + int(np.flatnonzero(np.abs(sums).max(axis=1) > left_out)[-1])


def compute_scattering_elements(population: Population, cosine: Array) -> Array:
    """k^2 times F11 + F33, F11 - F33, F12 and F34, averaged over sizes, at ascending cosines (angles,): (4, angles)."""
    functions = compute_angular_functions(round_up(population.a.shape[1]), cosine)
    elements = np.zeros((4, cosine.size))
    for start in range(0, population.sizes.size, SIZES_AT_ONCE):
        rows = slice(start, start + SIZES_AT_ONCE)
        a, b = population.a[rows], population.b[rows]
        held = int(count_held_orders(np.stack([a, b], axis=1)).max())  # small spheres come first, and have few
        total, difference = find_amplitudes(a[:, :held], b[:, :held], functions[:held])
        elements += sum_amplitudes(total, difference, population.weights[rows])
    return elements


def round_up(orders: int) -> int:
    """The next multiple of a few orders, where there are not many."""
    return -(-orders // ORDERS_TOGETHER) * ORDERS_TOGETHER if orders <= FEW_ORDERS else orders


def compute_angular_functions(orders: int, cosine: Array) -> Array:
    """(2n+1) d^n_11 and (2n+1) d^n_1,-1 of ``cosine`` (angles,), ascending, n >= 1: (orders, 2, angles)."""
    blocks = [block for _, block in compute_wigner_functions(((1, 1), (1, -1)), orders + 1, cosine)]
    return np.concatenate(blocks)[1:] * (2.0 * np.arange(1, orders + 1)[:, None, None] + 1.0)


def find_amplitudes(a: Complex, b: Complex, functions: Array) -> tuple[Complex, Complex]:
    """S1 + S2 = sum (2n+1)(a_n + b_n) d^n_11 and S1 - S2 = sum (2n+1)(a_n - b_n) d^n_1,-1, both (sizes, angles): Bohren
    and Huffman (1983), (4.74), with pi_n +- tau_n = n(n+1) d^n_1,+-1."""

    def multiply(coefficients: Complex, real: Array) -> Complex:
        """(sizes, orders) complex times (orders, angles) real, as one product of real matrices."""
        both = np.concatenate([coefficients.real, coefficients.imag]) @ real
        result = np.empty((len(coefficients), real.shape[1]), dtype=np.complex128)
        result.real, result.imag = both[: len(coefficients)], both[len(coefficients) :]
        return result

    return multiply(a + b, functions[:, 0]), multiply(a - b, functions[:, 1])


def sum_amplitudes(total: Complex, difference: Complex, weights: Array) -> Array:
    """F11 + F33, F11 - F33, F12 and F34 of S1 + S2 and S1 - S2: Bohren and Huffman (1983), (4.77)."""
    cross = weights @ (total * difference.conj())
    both = np.stack([weights @ np.abs(total) ** 2, weights @ np.abs(difference) ** 2])
    return 0.5 * np.concatenate([both, [-cross.real, cross.imag]])
