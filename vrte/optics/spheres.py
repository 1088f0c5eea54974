"""Mie: amplitudes of spheres -> scattering matrix -> expansion coefficients, averaged over sizes, mixed over species.

Amplitude coefficients a_n, b_n (Bohren and Huffman) come from miepython; the angular sums and size averages are matrix products.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte import _core
from vrte.arrays import Array, number, vector
from vrte.errors import SceneError
from vrte.optics.phase_matrix import PhaseMatrix, mix
from vrte.optics.refractive_index import refractive_index
from vrte.optics.size_distribution import Monodisperse, SizeDistribution

SETTLED = 1e-9  # relative change of the cross sections and of g when the radii are doubled
MOST_RADII = 4096
NEGLIGIBLE = 1e-12  # trailing expansion coefficients


@dataclass(frozen=True, eq=False)
class Particles:
    """What one mean particle does: ``phase_matrix``, ``extinction_um2`` and ``scattering_um2`` (mean cross sections,
    square micrometres), ``volume_um3`` (mean), ``description``.
    """

    phase_matrix: PhaseMatrix
    extinction_um2: float
    scattering_um2: float
    volume_um3: float
    description: str

    @property
    def albedo(self) -> float:
        """single_scattering_albedo, 0..1."""
        return min(1.0, self.scattering_um2 / self.extinction_um2)

    @property
    def asymmetry(self) -> float:
        """g, the mean cosine of the scattering angle."""
        return self.phase_matrix.asymmetry


def spheres(
    material: Any,
    radius_um: float | None = None,
    *,
    wavelength_um: float,
    size: SizeDistribution | None = None,
    host_index: float = 1.0,
) -> Particles:
    """Homogeneous spheres in a clear host.

    ``material``: a name, database path, n + ik or (n, k) (see `refractive_index`); ``radius_um``, or ``size``: a
    Lognormal, Gamma, Tabulated distribution, whose radii are doubled until the cross sections and g change by less
    than 1e-9; ``wavelength_um`` in vacuum; ``host_index`` real. Raises SceneError for bad input, for spheres with
    their host's index, and for sizes that do not settle.

    >>> particles = spheres(1.5 + 0.01j, radius_um=0.5, wavelength_um=0.55)
    >>> 0.0 < particles.albedo < 1.0
    True
    """
    if (radius_um is None) == (size is None):
        raise SceneError("spheres need either radius_um or size, not both or neither")
    host = number("host_index", host_index, 0.1, 100.0, "a real index between 0.1 and 100")
    index = refractive_index(material, wavelength_um)
    relative = index.value / host
    if relative == 1.0:
        raise SceneError("spheres with the index of their host scatter nothing: index and host_index must differ")
    wave_number = 2.0 * np.pi * host / float(wavelength_um)
    distribution = Monodisperse(radius_um) if size is None else size  # type: ignore[arg-type]
    return average(distribution, relative, wave_number, f"spheres, index {index.n:g} + {index.k:g}i ({index.source})")


def average(distribution: SizeDistribution, relative: complex, wave_number: float, description: str) -> Particles:
    """Doubles the number of radii until the result settles."""
    count = 64
    before: Array | None = None
    while count <= MOST_RADII:
        radii, weights = distribution.quadrature(count)
        result, summary = of_radii(radii, weights, relative, wave_number, description)
        if before is not None and np.all(np.abs(summary - before) <= SETTLED * np.abs(summary)):
            return result
        if radii.size != count:  # one radius, or a table: nothing to refine
            return result
        before, count = summary, 2 * count
    raise SceneError(f"the size distribution needs more than {MOST_RADII} radii: it is too wide for Mie averages to settle")


def of_radii(
    radii: Array, weights: Array, relative: complex, wave_number: float, description: str
) -> tuple[Particles, Array]:
    """The mean over given radii; also the numbers that tell whether it has settled."""
    an, bn = mie_coefficients(relative, wave_number * radii)
    degree = np.arange(1, an.shape[1] + 1)
    factor = 2.0 * np.pi / wave_number**2 * (2.0 * degree + 1.0)
    extinction = float(weights @ ((an + bn).real @ factor))
    scattering = float(weights @ ((np.abs(an) ** 2 + np.abs(bn) ** 2) @ factor))
    coefficients = expansion(an, bn, weights)
    volume = float(weights @ (4.0 / 3.0 * np.pi * radii**3))
    if relative.imag == 0.0:
        extinction = scattering  # nothing is absorbed: the albedo is exactly 1
    matrix = PhaseMatrix(*coefficients.T)
    result = Particles(matrix, extinction, scattering, volume, description)
    return result, np.array([extinction, scattering, matrix.asymmetry + 1.0])


def mie_coefficients(relative: complex, x: Array) -> tuple[Array, Array]:
    """a_n, b_n of every size parameter, (size, n), zero beyond each size's last order."""
    from miepython import an_bn

    pairs = [an_bn(relative, float(value), 0) for value in x]
    longest = max(a.size for a, _ in pairs)
    an, bn = (np.zeros((x.size, longest), complex) for _ in range(2))
    for row, (a, b) in enumerate(pairs):
        an[row, : a.size], bn[row, : b.size] = a, b
    return an, bn


def amplitudes(an: Array, bn: Array, cosine: Array) -> tuple[Array, Array]:
    """S1, S2 (size, angle) of Bohren and Huffman, as matrix products with pi_n and tau_n."""
    degree = np.arange(1, an.shape[1] + 1)
    pi, tau = angular_functions(degree.size, cosine)
    scale = (2.0 * degree + 1.0) / (degree * (degree + 1.0))
    return (an * scale) @ pi + (bn * scale) @ tau, (an * scale) @ tau + (bn * scale) @ pi


def angular_functions(count: int, cosine: Array) -> tuple[Array, Array]:
    """pi_n, tau_n for n = 1 .. count: (n, angle), upward recurrence."""
    pi, tau = np.empty((count, cosine.size)), np.empty((count, cosine.size))
    before, now = np.zeros_like(cosine), np.ones_like(cosine)
    for n in range(1, count + 1):
        pi[n - 1], tau[n - 1] = now, n * cosine * now - (n + 1) * before
        before, now = now, ((2 * n + 1) * cosine * now - (n + 1) * before) / n
    return pi, tau


def expansion(an: Array, bn: Array, weights: Array) -> Array:
    """The six coefficient lists, (terms, 6), of the weighted mean: exact by Gauss quadrature, for F is a polynomial."""
    terms = 2 * an.shape[1] + 1
    cosine, gauss = np.polynomial.legendre.leggauss(terms + 1)
    s1, s2 = amplitudes(an, bn, cosine)
    i1, i2 = weights @ (np.abs(s1) ** 2), weights @ (np.abs(s2) ** 2)
    cross = weights @ (s2 * s1.conj())
    f11, f12, f33, f34 = 0.5 * (i1 + i2), 0.5 * (i2 - i1), cross.real, cross.imag
    plain = _core.generalized_spherical_functions(0, terms, cosine)
    paired = _core.generalized_spherical_functions(2, terms, cosine)
    half = np.arange(terms) + 0.5
    plus = half * ((paired[..., 1] + paired[..., 2]) @ (gauss * (f11 + f33)))
    minus = half * ((paired[..., 1] - paired[..., 2]) @ (gauss * (f11 - f33)))
    a1, a4 = half * (plain[..., 0] @ (gauss * f11)), half * (plain[..., 0] @ (gauss * f33))
    b1, b2 = half * (-plain[..., 1] @ (gauss * f12)), half * (-plain[..., 1] @ (gauss * f34))
    table = np.stack([a1, 0.5 * (plus + minus), 0.5 * (plus - minus), a4, b1, b2], axis=1) / a1[0]
    table[0, 0] = 1.0
    kept = np.flatnonzero(np.abs(table).max(axis=1) > NEGLIGIBLE)[-1] + 1
    return table[:kept]


def mixture(species: Sequence[tuple[Particles, float]]) -> Particles:
    """Several kinds of particles together, by number fractions (they are normalised to sum 1).

    Raises SceneError for an empty list or a negative fraction. Cross sections and volumes are the means; phase
    matrices are weighted by what each scatters.

    >>> small, large = (spheres(1.5, radius_um=r, wavelength_um=0.55) for r in (0.1, 0.2))
    >>> mixture([(small, 0.5), (large, 0.5)]).volume_um3 > small.volume_um3
    True
    """
    if not species:
        raise SceneError("a mixture needs at least one kind of particle, not an empty list")
    fractions = vector("the number fractions of a mixture", [fraction for _, fraction in species])
    if (fractions < 0.0).any() or fractions.sum() == 0.0:
        raise SceneError(f"the number fractions of a mixture must be >= 0 and not all zero, not {fractions.tolist()}")
    fractions = fractions / fractions.sum()
    kinds = [particles for particles, _ in species]
    scattering = [f * p.scattering_um2 for p, f in zip(kinds, fractions, strict=True)]
    return Particles(
        mix([(p.phase_matrix, s) for p, s in zip(kinds, scattering, strict=True)]),
        float(sum(f * p.extinction_um2 for p, f in zip(kinds, fractions, strict=True))),
        float(sum(scattering)),
        float(sum(f * p.volume_um3 for p, f in zip(kinds, fractions, strict=True))),
        "; ".join(f"{f:g} of {p.description}" for p, f in zip(kinds, fractions, strict=True)),
    )
