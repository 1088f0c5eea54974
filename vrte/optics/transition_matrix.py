"""Scattering by an axially symmetric particle in random orientation, from its transition matrix.

The null-field solver of the extra "shapes" keeps the matrix to itself and gives amplitudes of one pair of directions.
At Gauss-Legendre nodes of both polar angles and evenly spaced azimuths they are as many numbers as determine it, so it
is found from them exactly, in the basis of helicity (Jacob and Wick, Ann. Phys. 7, 404 (1959)): with z the axis,

    S_st(theta, phi; theta', 0) = sum over n, n', m of c^m_(n s, n' t) d^n_ms(theta) d^n'_mt(theta') exp(i m phi).

Turned particles have the same c, and d^n_Mm(beta) between. All averages are polynomials, integrated without error.
Lengths are in units of wavelength/2 pi in the medium around: a radius is a size parameter, a cross section is k^2 C.
"""

import math
import os
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vrte.basics import cost
from vrte.basics.arrays import Array
from vrte.basics.errors import import_extra
from vrte.basics.quadrature import find_gauss_legendre
from vrte.basics.running import count_usable_cpus, keep_to_one_thread
from vrte.optics.phase_matrix import project_elements

Complex = NDArray[np.complex128]

SPHEROID, CYLINDER = -1, -2  # the solver's names
NUDGE = 1e-7  # by which the solver moves polar angles towards 90 degrees [rad]
TOLERANCES = 10.0 ** -np.arange(3, 11)  # of its cross sections of order 0, ever finer
ENOUGH = 1e-7  # relative error of reciprocity of the amplitudes that is good enough for a phase matrix
MOST_NODES = 300  # nodes of the solver's integrals over half a surface, beyond which it gives up
FAIR = 1e-3  # relative error of amplitudes that edges and lost digits often leave; above it there is a warning
SPARE_ORDERS = 30  # beyond those of a sphere around the particle
TRIALS = 24  # pairs of directions at which reciprocity is measured
ORIENTATIONS_AT_ONCE = 8  # bounds the memory

_silencing = threading.Lock()


class Average(NamedTuple):
    """Over orientations: k^2 times cross sections, integrals (terms, 6) of k^2 F, share that is not reciprocal."""

    extinction: float
    scattering: float
    sums: Array
    error: float


def average_orientations(shape: int, aspect_ratio: float, size: float, index: complex) -> Average | None:
    """Scattering in random orientation by aspect ratio, size parameter, relative index; None if not converged."""
    solver = import_solver()
    found = choose_matrix(solver, shape, aspect_ratio, size, index)
    if found is None:
        return None
    handle, error = found
    amplitudes = sample_amplitudes(solver, handle)
    with keep_to_one_thread():
        matrix = project_amplitudes(amplitudes)
        sums = expand_average(matrix)
    degrees = 2.0 * np.arange(1, matrix.shape[-1] + 1) + 1.0
    forward = np.einsum("mnn->n", matrix[0]) / degrees  # optical theorem: S_++ ahead, averaged
    return Average(4.0 * math.pi * float(forward.sum().imag), 2.0 * math.pi * float(sums[0, 0]), sums, error)


def import_solver() -> Any:
    """The solver's compiled part. Raises MissingExtraError."""
    return import_extra("rustmatrix._core", "scattering by spheroids and cylinders", "shapes")


def count_orders(size: float) -> int:
    """Orders that a sphere of a size parameter takes, as the solver counts them."""
    return int(max(4.0, size + 4.05 * size ** (1.0 / 3.0)))


def choose_matrix(
    solver: Any, shape: int, aspect_ratio: float, size: float, index: complex
) -> tuple[Any, float] | None:
    """The most reciprocal of the matrices by ever finer tolerances, and its error; None where none converges."""
    nodes_an_order = max(2, min(8, MOST_NODES // (count_orders(find_reach(shape, aspect_ratio) * size) + SPARE_ORDERS)))
    best: tuple[Any, float] | None = None
    before = (0, 0)
    for tolerance in TOLERANCES:
        arguments = (size, 1.0, 2.0 * math.pi, index.real, index.imag, aspect_ratio, shape, tolerance, nodes_an_order)
        handle = build_matrix(solver, arguments)
        if handle is None:
            break
        is_dear = cost.SECONDS_OF_ORDERS * handle.nmax**6 > 0.2  # a few digits more would take five times as long
        if is_dear and best is not None and best[1] < FAIR and handle.nmax > 1.3 * best[0].nmax:
            break
        if (handle.nmax, handle.ngauss) == before:
            continue
        before = handle.nmax, handle.ngauss
        error = measure_reciprocity(solver, handle)
        if best is None or error < best[1]:
            best = handle, error
        if error < ENOUGH:
            break
    return best


def find_reach(shape: int, aspect_ratio: float) -> float:
    """The radius of the sphere around a particle over that of the sphere of equal volume."""
    if shape == SPHEROID:
        return max(aspect_ratio ** (1.0 / 3.0), aspect_ratio ** (-2.0 / 3.0))
    return (2.0 / (3.0 * aspect_ratio**2)) ** (1.0 / 3.0) * math.hypot(1.0, aspect_ratio)


def build_matrix(solver: Any, arguments: tuple[Any, ...]) -> Any:
    """The solver's handle to a matrix, or None where it gives up, which it does by a panic."""
    with keep_quiet():
        try:
            return solver.calctmat(*arguments)[0]
        except BaseException as error:
            if type(error).__name__ != "PanicException":
                raise
    return None


@contextmanager
def keep_quiet() -> Iterator[None]:
    """Keeps what compiled code writes to standard error from the screen: whoever calls says it in words."""
    with _silencing:
        try:
            kept = os.dup(2)
        except OSError:  # a process without standard error
            yield
            return
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 2)
        try:
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            os.close(nowhere)


def measure_reciprocity(solver: Any, handle: Any) -> float:
    """How far amplitudes at directions all over the sphere are from reciprocal: root of mean squares, as a share."""
    steps = (np.arange(TRIALS)[:, None] + 0.5) * [0.5545497, 0.3087079, 0.6180340] % 1.0  # spread without a pattern
    polar, incident = np.degrees(np.arccos(1.0 - 2.0 * steps[:, :2])).T
    azimuth = 180.0 * steps[:, 2]
    there, back = (
        np.array([solver.calcampl_py(handle, 0.0, *pair, 0.0, phi, 0.0, 0.0)[0] for *pair, phi in given])
        for given in (np.stack(ways, axis=1) for ways in ((incident, polar, azimuth), (polar, incident, azimuth)))
    )
    error = float(np.linalg.norm(there - turn_around(back)) / np.linalg.norm(there))
    return error if math.isfinite(error) else math.inf


OPPOSITE = np.array([[1.0, -1.0], [-1.0, 1.0]])  # a mirror turns over the amplitudes between the polarizations


def turn_around(amplitudes: Complex) -> Complex:
    """Amplitudes of theta, theta', phi from those of theta', theta, phi: reversed light, mirrored at the equator."""
    return amplitudes.swapaxes(-1, -2) * OPPOSITE


def sample_amplitudes(solver: Any, handle: Any) -> Complex:
    """S of both polarizations at nodes theta, theta' (ascending cosines) and azimuths, (n, n, azimuths, 2, 2): a
    quarter is asked for, as the particle is its own mirror image at the equator and light goes back the way it came."""
    orders = handle.nmax
    cosines, _ = find_nodes(orders)
    angles = np.arccos(cosines)
    polar = np.degrees(angles + np.copysign(NUDGE, angles - 0.5 * math.pi))
    azimuths = np.degrees(find_azimuths(orders))
    count, half = cosines.size, cosines.size // 2
    amplitudes = np.empty((count, count, azimuths.size, 2, 2), dtype=np.complex128)

    def fill_pair(incident: int, row: int) -> None:
        for index, azimuth in enumerate(azimuths):
            found = solver.calcampl_py(handle, 0.0, polar[incident], polar[row], 0.0, azimuth, 0.0, 0.0)[0]
            amplitudes[row, incident, index] = found

    with ThreadPoolExecutor(count_usable_cpus()) as pool:  # the solver lets go of Python's lock
        for incident in range(half, count):
            inner = range(half, incident + 1)
            rows = [*inner, *(count - 1 - row for row in inner)]
            list(pool.map(partial(fill_pair, incident), rows))  # so few at once that Ctrl-C is heard
            for row in inner:
                amplitudes[incident, row] = turn_around(amplitudes[row, incident])
                amplitudes[count - 1 - incident, row] = OPPOSITE * turn_around(amplitudes[count - 1 - row, incident])
    amplitudes[:, :half] = OPPOSITE * amplitudes[::-1, : half - 1 : -1]
    return amplitudes


def find_nodes(orders: int) -> tuple[Array, Array]:
    """Gauss-Legendre nodes for products of two functions d^n, n <= ``orders``; none of them at the equator."""
    return find_gauss_legendre(orders + 1 + (orders + 1) % 2)


def find_azimuths(orders: int) -> Array:
    """Azimuths [rad] within half a circle at which cosines and sines up to ``orders`` are distinguished."""
    return (np.arange(orders + 1) + 0.5) * math.pi / (orders + 1)


def project_amplitudes(amplitudes: Complex) -> Complex:
    """c^m_(n s, n' t) of s = 1 and t = 1, -1, n and n' from 1, m from -orders, (2, 2 orders + 1, orders, orders); those
    of s = -1 are c^-m_(n -s, n' -t), as the particle is its own mirror image at planes through its axis."""
    orders = amplitudes.shape[2] - 1
    cosines, weights = find_nodes(orders)
    phases = np.outer(find_azimuths(orders), np.arange(orders + 1))
    even, odd = np.cos(phases) / (orders + 1), np.sin(phases) / (orders + 1)

    def find_modes(cosine_part: Complex, sine_part: Complex) -> Complex:
        """Factors of exp(i m phi)."""
        real, imaginary = cosine_part @ even, sine_part @ odd
        return np.concatenate([(real - imaginary)[..., :0:-1], real + imaginary], axis=-1)

    same = find_modes(amplitudes[..., 0, 0] + amplitudes[..., 1, 1], amplitudes[..., 0, 1] - amplitudes[..., 1, 0])
    turned = find_modes(amplitudes[..., 0, 0] - amplitudes[..., 1, 1], -amplitudes[..., 0, 1] - amplitudes[..., 1, 0])
    axes = [find_rotation(degree) for degree in range(1, orders + 1)]
    factors = weights * (np.arange(1, orders + 1) + 0.5)[:, None]
    up, down = (stack_functions(axes, helicity, -np.arccos(cosines)) * factors for helicity in (1, -1))
    pairs = (same, up), (turned, down)
    return 0.5 * np.stack([up @ modes.transpose(2, 0, 1) @ light.swapaxes(-1, -2) for modes, light in pairs])


@lru_cache(maxsize=128)
def find_rotation(degree: int) -> tuple[Array, Complex]:
    """Eigenvalues (2 n + 1,) and eigenvectors (in columns) of J_y of degree n, m ascending; d^n = exp(-i beta J_y)."""
    lower = np.arange(-degree, degree)
    steps = 0.5j * np.sqrt(degree * (degree + 1.0) - lower * (lower + 1.0))
    values, vectors = np.linalg.eigh(np.diag(steps, 1) + np.diag(-steps, -1))
    return np.round(values), vectors


def stack_functions(axes: list[tuple[Array, Complex]], row: int, angles: Array) -> Array:
    """d^n_(row, m) of angles [rad], n from 1, m from -orders: (2 orders + 1, orders, angles), zero for |m| > n."""
    orders = len(axes)
    functions = np.zeros((2 * orders + 1, orders, angles.size))
    for degree, (values, vectors) in enumerate(axes, 1):
        turned = np.exp(-1j * np.outer(values, angles)) * vectors[degree + row, :, None]
        functions[orders - degree : orders + degree + 1, degree - 1] = (vectors.conj() @ turned).real
    return functions


def expand_average(matrix: Complex) -> Array:
    """Integrals as of `project_elements` of k^2 F averaged over orientations: products of G^M_st = sum d^n_Ms(Theta)
    d^n_Mm(beta) c^m_(n s, n' t) d^n'_tm(beta) over cosines of beta, half of which are mirror images."""
    orders = matrix.shape[-1]
    axes = [find_rotation(degree) for degree in range(1, orders + 1)]
    cosines, weights = find_gauss_legendre(2 * orders + 2)
    tilts, shares = np.arccos(cosines[orders + 1 :]), weights[orders + 1 :]
    scattered, measure = find_gauss_legendre(2 * orders + 1)
    outgoing = stack_functions(axes, 1, -np.arccos(scattered))  # d^n_M1 = d^n_1M of the opposite angle
    elements = np.zeros((6, scattered.size))
    for first in range(0, tilts.size, ORIENTATIONS_AT_ONCE):
        part = slice(first, first + ORIENTATIONS_AT_ONCE)
        incoming = np.stack([stack_functions(axes, helicity, tilts[part]) for helicity in (1, -1)])
        fields = matrix @ incoming
        for degree, (values, vectors) in enumerate(axes, 1):
            inner = slice(orders - degree, orders + degree + 1)
            phases = np.exp(-1j * np.outer(values, tilts[part]))
            fields[:, inner, degree - 1] = vectors @ (phases * (vectors.conj().T @ fields[:, inner, degree - 1]))
        same, turned = fields.swapaxes(-1, -2) @ outgoing
        elements += multiply_fields(same, turned, shares[part])
    f11, f44, plus, minus, f12, f34 = measure * elements
    return project_elements(scattered, np.stack([f11, f44, -f12, -f34, plus, minus]), scattered.size)


def multiply_fields(same: Complex, turned: Complex, shares: Array) -> Array:
    """F11, F44, F22 + F33, F22 - F33, F12 and F34 (6, angles), of G^M with s = 1 and t = 1 or -1: (M, beta, angles)."""
    orders = len(same) // 2

    def correlate(first: Complex, second: Complex, total: int) -> Complex:
        """Mean over beta of the sum over M of G^M and the conjugate of G^(total - M), whose s and t are opposite."""
        there = slice(max(0, total), min(2 * orders, 2 * orders + total) + 1)
        return shares @ (first[there] * second[there][::-1].conj()).sum(axis=0)

    kept = shares @ (np.abs(same) ** 2).sum(axis=0)
    changed = shares @ (np.abs(turned) ** 2).sum(axis=0)
    mixed = 2.0 * correlate(same, turned, 0)
    plus, minus = 2.0 * correlate(same, same, 2).real, 2.0 * correlate(turned, turned, -2).real
    return np.stack([kept + changed, kept - changed, plus, minus, mixed.real, -mixed.imag])
