"""Spheres: Mie amplitudes, scattering matrix, expansion, averaged over sizes and mixed over species.

Amplitudes S1 and S2 and coefficients a_n and b_n are those of Bohren and Huffman, "Absorption and scattering
of light by small particles" (1983), chapter 4, for a refractive index n + i k.
"""

import math
import sys
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte._core import sphere_coefficients
from vrte.basics import cost
from vrte.basics.arrays import Array, check_number, check_vector, put_in_one_line
from vrte.basics.errors import LongSolveWarning, SceneError
from vrte.basics.spherical_functions import compute_wigner_functions, find_gauss_legendre
from vrte.basics.views import view
from vrte.optics.phase_matrix import PAIRS, PhaseMatrix, check_mixture, mix, rayleigh
from vrte.optics.refractive_index import Material, RefractiveIndex, refractive_index
from vrte.optics.size_distribution import Monodisperse, SizeDistribution

Complex = NDArray[np.complex128]

LARGEST_SIZE = 1e4  # size parameter 2 pi r/wavelength: beyond, an expansion of 2e4 terms helps nobody
LARGEST_PHASE = 1e5  # relative index times size parameter: Mie's recurrence takes as many steps
LARGEST_AREA = 1e100  # cross section [um2] and volume [um3] of a particle: products stay far below overflow
HOST_ALLOWED = 1e-3, 1e3, "a real refractive index from 0.001 to 1000"
SAME_INDEX = 1e-9  # |m - 1| where the coefficients a_n, b_n are down to their rounding
NEGLIGIBLE = 1e-16  # of the largest |a_n|, |b_n|: what the orders left out may hold
LEFT_OUT = 1e-12  # what an expansion coefficient left out may hold; a1[0] is 1
FEWEST_RADII, MOST_RADII = 129, 2049
SETTLED = np.array([1e-6, 1e-6, 1e-6, 1e-4])  # relative: extinction, scattering, asymmetry, backscattering
DOUBTFUL = 1e-2  # relative change of a cross section at MOST_RADII from which the user is warned
ALL_SIZES_UP_TO = 100.0  # size parameter from which radii follow the sum of r^4 instead of r^6
ANGLES_AT_ONCE, SIZES_AT_ONCE = 512, 256  # bound the memory


class SizeAverageWarning(UserWarning):
    """The average over sizes still changes with the number of radii (sharp resonances of clear spheres)."""


@dataclass(frozen=True, eq=False, repr=False)
class Particles:
    """How one kind of particle scatters, averaged over its sizes: what a Layer needs to know of it.

    Parameters
    ----------
    phase_matrix : PhaseMatrix
    albedo, asymmetry : float
        Of single scattering; g.
    extinction_um2, scattering_um2, volume_um3 : float
        Mean cross sections [um2] and volume [um3] of one particle.
    description : str
        In words, what it is and where its refractive index comes from.
    host_index : float or None
        Refractive index of the medium that they lie in; None: any.

    Raises
    ------
    SceneError
        Naming the field.

    >>> from vrte.optics.phase_matrix import rayleigh
    >>> Particles(rayleigh(), 0.5, 0.0, extinction_um2=0.4, scattering_um2=0.2, volume_um3=0.1).albedo
    0.5
    """

    phase_matrix: PhaseMatrix
    albedo: float
    asymmetry: float
    extinction_um2: float
    scattering_um2: float
    volume_um3: float
    description: str = ""
    host_index: float | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.phase_matrix, PhaseMatrix):
            given = type(self.phase_matrix).__name__
            raise SceneError(f"particles: phase_matrix must be a vrte.PhaseMatrix, not {given}")
        above_zero = f"above 0 and at most {LARGEST_AREA:g}"
        ranges = {
            "albedo": (0.0, 1.0, "between 0 and 1"),
            "asymmetry": (-1.001, 1.001, "a mean cosine, between -1 and 1"),  # published tables are rounded
            "extinction_um2": (1.0 / LARGEST_AREA, LARGEST_AREA, above_zero),
            "scattering_um2": (0.0, LARGEST_AREA, f"between 0 and {LARGEST_AREA:g}"),
            "volume_um3": (1.0 / LARGEST_AREA, LARGEST_AREA, above_zero),
        }
        for name, (low, high, allowed) in ranges.items():
            object.__setattr__(self, name, check_number(f"particles: {name}", getattr(self, name), low, high, allowed))
        if self.host_index is not None:
            host = check_number("particles: host_index", self.host_index, *HOST_ALLOWED)
            object.__setattr__(self, "host_index", host)

    def __repr__(self) -> str:
        return (
            f"Particles: {put_in_one_line(str(self.description), 300) or 'given by their phase matrix'}\n"
            f"  albedo {self.albedo:.6g}, {self.phase_matrix.in_words}\n"
            f"  extinction {self.extinction_um2:.5g} um2, scattering {self.scattering_um2:.5g} um2, "
            f"volume {self.volume_um3:.5g} um3"
        )

    def _repr_html_(self) -> str:
        return view(self, "_repr_html_")


@dataclass(frozen=True, eq=False)
class _Population:
    """Spheres of many sizes: size parameters and weights (sizes,), a_n and b_n (sizes, orders) from n = 1."""

    sizes: Array
    weights: Array
    a: Complex
    b: Complex


def spheres(
    material: Material,
    *,
    wavelength_um: float,
    radius_um: float | None = None,
    size: SizeDistribution | None = None,
    host_index: float = 1.0,
) -> Particles:
    """Homogeneous spheres of one radius or of a size distribution, in a clear host medium.

    Parameters
    ----------
    material : str, complex, pair, IndexTable or RefractiveIndex
        All that `refractive_index` takes: a name, a database path, n + i k or (n, k).
    wavelength_um : float
        In vacuum [um]; inside the host it is shorter by ``host_index``.
    radius_um : float, optional
        Of all of them, or
    size : Lognormal, Gamma, Monodisperse or Tabulated, optional
        The distribution of their radii.
    host_index : float
        Real refractive index around them.

    Returns
    -------
    Particles
        An average over sizes starts with 129 radii and doubles their number, keeping those it has, until extinction,
        scattering and asymmetry change by less than 1e-6 and backscattering by less than 1e-4, relative, or until there
        are 2049. Clear spheres have resonances narrower than any such spacing: ``description`` says to what the cross
        sections have settled (1e-3 for a clear index of 2.7), and a SizeAverageWarning is given above 1e-2.

    Raises
    ------
    SceneError
        For both or neither of radius_um and size, for an index that is not allowed or equals the host's (nothing would
        be scattered), and for size parameters above 1e4.

    Source: Bohren and Huffman (1983), chapter 4; de Rooij and van der Stap, Astron. Astrophys. 131, 237 (1984).

    >>> glass = spheres(1.5, radius_um=0.5, wavelength_um=0.5)
    >>> glass.albedo, glass.phase_matrix.a1[0]
    (1.0, np.float64(1.0))
    """
    index, host, wavelength = _check_light(material, wavelength_um, host_index)
    relative, distribution = _find_relative_index(index, host), _choose_distribution(radius_um, size)
    wavenumber = 2.0 * math.pi * host / wavelength
    population, changes = _settle_population(relative, wavenumber, distribution)
    description = _describe_spheres(index, distribution, population, changes, wavelength, host)
    if changes[:2].max() > DOUBTFUL:
        warnings.warn(f"spheres: not settled; {description}", SizeAverageWarning, stacklevel=2)
    return _average_population(
        population, wavenumber, absorbing=relative.imag > 0.0, description=description, host=host
    )


def check_spheres(
    material: Material,
    *,
    wavelength_um: float,
    radius_um: float | None = None,
    size: SizeDistribution | None = None,
    host_index: float = 1.0,
) -> Particles:
    """All that `spheres` checks, without its work: parameters and errors as there.

    What comes back are no such particles, but Rayleigh's, of extinction and volume 1: something to go on with.

    >>> check_spheres(1.5, radius_um=-1.0, wavelength_um=0.5)
    Traceback (most recent call last):
    vrte.SceneError: radius_um must be a length from 1e-06 to 1e+06 um, not -1.0
    """
    index, host, wavelength = _check_light(material, wavelength_um, host_index)
    relative, distribution = _find_relative_index(index, host), _choose_distribution(radius_um, size)
    radii, _ = _check_quadrature(distribution, FEWEST_RADII, 6)
    _check_sizes(relative, 2.0 * math.pi * host / wavelength, radii)
    return Particles(rayleigh(), 1.0, 0.0, extinction_um2=1.0, scattering_um2=1.0, volume_um3=1.0, host_index=host)


def _check_light(material: Material, wavelength_um: Any, host_index: Any) -> tuple[RefractiveIndex, float, float]:
    """The index of the particles and of the host, and the wavelength in vacuum."""
    index = refractive_index(material, wavelength_um)
    host = check_number("host_index", host_index, *HOST_ALLOWED)
    return index, host, check_number("wavelength_um", wavelength_um, 0.0, math.inf, "a length")


def _find_relative_index(index: RefractiveIndex, host: float) -> complex:
    """The index relative to the host's, which it must not equal."""
    relative = index.value / host
    if abs(relative - 1.0) < SAME_INDEX:
        raise SceneError(
            f"spheres: the particles have the refractive index of their host, {host:g}, so they scatter nothing"
        )
    return relative


def mixture(parts: Sequence[tuple[Particles, float]]) -> Particles:
    """Several kinds of particles side by side.

    Parameters
    ----------
    parts : sequence of (Particles, float)
        Each with its number fraction, of which only the ratios matter.

    Returns
    -------
    Particles
        Cross sections and volume are means over all particles; each kind's phase matrix counts by what it scatters.

    Raises
    ------
    SceneError
        For an empty list, something else than pairs, or fractions that are negative or all zero.

    >>> small, large = (spheres(1.5, radius_um=r, wavelength_um=0.5) for r in (0.1, 0.3))
    >>> mixture([(small, 0.5), (large, 0.5)]).volume_um3 == (small.volume_um3 + large.volume_um3) / 2
    True
    """
    pairs: list[tuple[Particles, float]] = check_mixture(parts, "particles, number fraction")
    for kind, _ in pairs:
        if not isinstance(kind, Particles):
            raise SceneError(f"a mixture needs pairs (particles, number fraction), not {type(kind).__name__}")
    hosts = [kind.host_index for kind, _ in pairs if kind.host_index is not None]
    if hosts and max(hosts) != min(hosts):
        raise SceneError(
            f"particles of a mixture lie in one medium: the host_index must not be {min(hosts):g} of one kind and "
            f"{max(hosts):g} of another"
        )
    shares = [check_number("number fraction", share, 0.0, sys.float_info.max, "a number >= 0") for _, share in pairs]
    largest = max(shares)
    if largest == 0.0:
        raise SceneError("number fraction: at least one kind of particle in a mixture needs more than 0")
    # of the largest: only ratios matter, and what is made of these neither overflows nor vanishes
    pairs = [(kind, share / largest) for (kind, _), share in zip(pairs, shares, strict=True)]
    total = math.fsum(share for _, share in pairs)

    def mean(value: Callable[[Particles], float]) -> float:
        return math.fsum(value(kind) * share for kind, share in pairs) / total

    extinction, scattering = mean(lambda kind: kind.extinction_um2), mean(lambda kind: kind.scattering_um2)
    phase_matrix = mix([(kind.phase_matrix, share * kind.scattering_um2) for kind, share in pairs])
    return Particles(
        phase_matrix=phase_matrix,
        albedo=min(1.0, scattering / extinction),
        asymmetry=phase_matrix.asymmetry,
        extinction_um2=extinction,
        scattering_um2=scattering,
        volume_um3=mean(lambda kind: kind.volume_um3),
        host_index=hosts[0] if hosts else None,
        description="; ".join(f"{share / total:.6g} of {kind.description}" for kind, share in pairs),
    )


def compute_mie_coefficients(relative_index: complex, size: float) -> tuple[Complex, Complex]:
    """a_n and b_n from n = 1 of a sphere with the size parameter ``size``, index relative to the host.

    Wiscombe's number of orders leaves out some 1e-8 of an amplitude, so more are asked for and those that
    hold nothing are dropped. Source: Bohren and Huffman (1983), (4.53).

    >>> a, b = compute_mie_coefficients(1.5 + 1.0j, 1e-3)
    >>> f"{1.5j * a[0] / 1e-9:.5f}"  # (m^2 - 1)/(m^2 + 2) of the dipole
    '0.50160+0.46006j'
    """
    a, b = sphere_coefficients(complex(relative_index), size, int(size + 6.0 * size ** (1.0 / 3.0) + 8.0))
    strength = np.maximum(np.abs(a), np.abs(b))
    orders = 1 + int(np.flatnonzero(strength > NEGLIGIBLE * strength.max())[-1])
    return a[:orders], b[:orders]


def _choose_distribution(radius_um: float | None, size: SizeDistribution | None) -> SizeDistribution:
    if (radius_um is None) == (size is None):
        raise SceneError("spheres: give either radius_um or size")
    if size is None:
        return Monodisperse(radius_um)  # type: ignore[arg-type]
    if isinstance(size, type) or not callable(getattr(size, "quadrature", None)):
        raise SceneError(
            f"spheres: size must be a Lognormal, Gamma, Monodisperse or Tabulated, not {type(size).__name__}"
        )
    return size


def _settle_population(
    relative_index: complex, wavenumber: float, distribution: SizeDistribution
) -> tuple[_Population, Array]:
    """As many radii as it takes, and the relative change of (extinction, scattering, g, back) by the last step."""
    coarsest = _check_quadrature(distribution, 2, 6)[0]
    moment = 6 if wavenumber * coarsest[-1] <= ALL_SIZES_UP_TO else 4
    known: dict[float, tuple[Complex, Complex]] = {}
    count = max(FEWEST_RADII, coarsest.size)
    most = max(MOST_RADII, 2 * count - 1)
    population = _make_population(relative_index, wavenumber, _check_quadrature(distribution, count, moment), known)
    changes = np.zeros(4)
    sums = _sum_bulk(population)
    while population.sizes.size > 1 and count < most:
        count = 2 * count - 1
        population = _make_population(relative_index, wavenumber, _check_quadrature(distribution, count, moment), known)
        before, sums = sums, _sum_bulk(population)
        changes = np.abs(sums - before) / sums[[0, 1, 1, 3]]
        if np.all(changes <= SETTLED):
            break
    return population, changes


def _check_quadrature(distribution: SizeDistribution, count: int, moment: int) -> tuple[Array, Array]:
    """Radii and weights, checked: a distribution may be anybody's."""
    try:
        radii, weights = distribution.quadrature(count, moment)
    except Exception as reason:
        name = type(distribution).__name__
        raise SceneError(f"spheres: size: {name}.quadrature failed with {type(reason).__name__}") from reason
    radii, weights = (
        check_vector("spheres: size: the radii", radii),
        check_vector("spheres: size: the weights", weights),
    )
    if radii.size != weights.size or radii[0] <= 0.0 or (np.diff(radii) < 0.0).any():
        raise SceneError("spheres: size: the radii must increase from above 0, with one weight for each")
    if (weights < 0.0).any() or not weights.any():
        raise SceneError("spheres: size: the weights must be >= 0 and not all zero")
    return radii, weights


def _make_population(
    relative_index: complex,
    wavenumber: float,
    quadrature: tuple[Array, Array],
    known: dict[float, tuple[Complex, Complex]],
) -> _Population:
    """Mie coefficients at all the radii, padded with zeros; those not ``known`` are worked out and kept there."""
    radii, weights = quadrature
    sizes = _check_sizes(relative_index, wavenumber, radii)
    for size in sizes:
        if size not in known:
            known[size] = compute_mie_coefficients(relative_index, size)
    orders = max(known[size][0].size for size in sizes)
    a, b = np.zeros((2, sizes.size, orders), dtype=np.complex128)
    for row, size in enumerate(sizes):
        found = known[size]
        a[row, : found[0].size], b[row, : found[1].size] = found
    return _Population(sizes, weights, a, b)


def _check_sizes(relative_index: complex, wavenumber: float, radii: Array) -> Array:
    """The size parameters of ascending radii, or a SceneError where the largest is too large."""
    sizes = wavenumber * radii
    if sizes[-1] > LARGEST_SIZE:
        raise SceneError(
            f"spheres: the size parameter 2 pi r/wavelength must be at most {LARGEST_SIZE:g}, not {sizes[-1]:.4g} "
            f"(a radius of {radii[-1]:.4g} um: did you mean nanometres, {radii[-1] / 1e3:.4g} um?)"
        )
    if relative_index.real * sizes[-1] > LARGEST_PHASE:
        raise SceneError(
            f"spheres: the index relative to the host times the size parameter must be at most {LARGEST_PHASE:g}, "
            f"not {relative_index.real * sizes[-1]:.4g} (a radius of {radii[-1]:.4g} um)"
        )
    return sizes


def _sum_bulk(population: _Population) -> Array:
    """Extinction, scattering, asymmetry x scattering and backscattering, averaged; cross sections k^2/(2 pi).

    Source: Bohren and Huffman (1983), (4.61), (4.62), section 4.5 (asymmetry and backscattering).
    """
    a, b = population.a, population.b
    order = np.arange(1.0, a.shape[1] + 1.0)
    twice = 2.0 * order + 1.0
    extinction = (a + b).real @ twice
    scattering = (np.abs(a) ** 2 + np.abs(b) ** 2) @ twice
    neighbours = (a[:, :-1] * a[:, 1:].conj() + b[:, :-1] * b[:, 1:].conj()).real
    asymmetry = neighbours @ (order * (order + 2.0) / (order + 1.0))[:-1]
    asymmetry += (a * b.conj()).real @ (twice / (order * (order + 1.0)))
    back = np.abs((a - b) @ (twice * (-1.0) ** order)) ** 2
    return population.weights @ np.stack([extinction, scattering, 2.0 * asymmetry, 0.5 * back], axis=1)


def _average_population(
    population: _Population, wavenumber: float, *, absorbing: bool, description: str, host: float
) -> Particles:
    extinction, scattering, _, _ = _sum_bulk(population) * (2.0 * math.pi / wavenumber**2)
    if not absorbing:
        extinction = scattering  # the two sums differ by rounding, and an albedo of 1 should be exactly that
    phase_matrix = _expand_population(population)
    volumes = 4.0 / 3.0 * math.pi * (population.sizes / wavenumber) ** 3
    return Particles(
        phase_matrix=phase_matrix,
        albedo=min(1.0, float(scattering / extinction)),
        asymmetry=phase_matrix.asymmetry,
        extinction_um2=float(extinction),
        scattering_um2=float(scattering),
        volume_um3=float(population.weights @ volumes),
        description=description,
        host_index=host,
    )


def _expand_population(population: _Population) -> PhaseMatrix:
    """The six sequences, by Gauss-Legendre quadrature over the cosine of the scattering angle.

    The elements of F are polynomials of degree 2 n in the cosine (n orders), so 2 n + 1 nodes and as many terms
    are exact. Source: de Rooij and van der Stap (1984), section 3.
    """
    terms = 2 * population.a.shape[1] + 1
    seconds = cost.SECONDS_OF_TERMS * terms**2
    if seconds > cost.LONG:
        told = f"this will take about {seconds:.0f} s, most of it for a phase matrix of {terms} terms"
        warnings.warn(f"{told}; smaller particles, or a smaller host_index, take less", LongSolveWarning, stacklevel=3)
    cosine, weights = find_gauss_legendre(terms)
    pieces = range(0, terms, ANGLES_AT_ONCE)
    elements = [_compute_scattering_elements(population, cosine[start : start + ANGLES_AT_ONCE]) for start in pieces]
    plus, minus, f12, f34 = weights * np.concatenate(elements, axis=1)
    plain, crossed = 0.5 * np.stack([plus + minus, plus - minus], axis=1), -np.stack([f12, f34], axis=1)
    sums = np.empty((terms, 6))
    for first, block in compute_wigner_functions(PAIRS, terms, cosine):
        rows = slice(first, first + len(block))
        sums[rows, :2], sums[rows, 2:4] = block[:, 0] @ plain, block[:, 1] @ crossed
        sums[rows, 4], sums[rows, 5] = block[:, 2] @ plus, block[:, 3] @ minus
    sums *= (2.0 * np.arange(terms)[:, None] + 1.0) / sums[0, 0]
    kept = 1 + int(np.flatnonzero(np.abs(sums).max(axis=1) > LEFT_OUT)[-1])
    a1, a4, b1, b2, total, difference = sums[:kept].T
    return PhaseMatrix(a1, 0.5 * (total + difference), 0.5 * (total - difference), a4, b1, b2)


def _compute_scattering_elements(population: _Population, cosine: Array) -> Array:
    """F11 + F33, F11 - F33, F12 and F34 at ``cosine`` (angles,), ascending, averaged over sizes: (4, angles).

    Times k^2. With S1 + S2 = sum (2n+1)(a_n + b_n) d^n_11 and S1 - S2 = sum (2n+1)(a_n - b_n) d^n_1,-1, which are
    Bohren and Huffman (1983), (4.74), with pi_n +- tau_n = n(n+1) d^n_1,+-1; the elements are their (4.77).
    """
    orders = population.a.shape[1]
    blocks = [block for _, block in compute_wigner_functions(((1, 1), (1, -1)), orders + 1, cosine)]
    functions = np.concatenate(blocks)[1:] * (2.0 * np.arange(1, orders + 1)[:, None, None] + 1.0)
    elements = np.zeros((4, cosine.size))
    for start in range(0, population.sizes.size, SIZES_AT_ONCE):
        rows = slice(start, start + SIZES_AT_ONCE)
        a, b, weights = population.a[rows], population.b[rows], population.weights[rows]
        total, difference = _multiply_real(a + b, functions[:, 0]), _multiply_real(a - b, functions[:, 1])
        cross = weights @ (total * difference.conj())
        elements[0] += 0.5 * (weights @ np.abs(total) ** 2)
        elements[1] += 0.5 * (weights @ np.abs(difference) ** 2)
        elements[2:] += 0.5 * np.stack([-cross.real, cross.imag])
    return elements


def _multiply_real(coefficients: Complex, functions: Array) -> Complex:
    """(sizes, orders) complex times (orders, angles) real, as one product of real matrices."""
    both = np.concatenate([coefficients.real, coefficients.imag]) @ functions
    result = np.empty((len(coefficients), functions.shape[1]), dtype=np.complex128)
    result.real, result.imag = both[: len(coefficients)], both[len(coefficients) :]
    return result


def _describe_spheres(
    index: RefractiveIndex,
    distribution: SizeDistribution,
    population: _Population,
    changes: Array,
    wavelength_um: float,
    host: float,
) -> str:
    """One line: what the spheres are, where their index comes from and how well their sizes are averaged."""
    where = f"at {wavelength_um:g} um" + (f" in a host of index {host:g}" if host != 1.0 else "")
    text = f"spheres, {distribution}, {where}, index {index.n:.6g} + {index.k:.6g}i ({index.source})"
    if population.sizes.size > 1:
        settled = max(float(changes[:2].max()), 1e-16)
        text += f", {population.sizes.size} radii, cross sections settled to {settled:.0e}"
    return text
