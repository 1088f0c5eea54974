"""How many particles there are of each radius, and the radii that average over them.

``quadrature(count)`` of each distribution gives radii [um] and weights with sum(weights * f(radii)) close to the mean
of f over all particles, those left out too: smaller ones that hold 1e-10 of the sum of r^2, and larger ones that hold
as much of the sum of r^moment, r^6 where particles are much smaller than the wavelength, r^4 (the forward peak) else.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from vrte.basics.arrays import Array, check_fields, check_number, check_vector, freeze_copy
from vrte.basics.errors import SceneError

TAIL = 1e-10
DEVIATIONS = 6.3613  # of a normal distribution, beyond which TAIL of it lies
LENGTH = 1e-6, 1e6, "a length from 1e-06 to 1e+06 um"  # that a particle can have


class SizeDistribution(Protocol):
    """What `vrte.spheres` needs of a size distribution."""

    def quadrature(self, count: int, moment: int = 6) -> tuple[Array, Array]:
        """Radii [um] and weights, both (n,); about ``count`` of them, and the same again among 2 count - 1."""


@dataclass(frozen=True)
class Monodisperse:
    """Spheres of one radius.

    Parameters
    ----------
    radius_um : float
        [um], above 0; SceneError for another.

    Examples
    --------
    >>> import vrte
    >>> vrte.Monodisperse(0.6).quadrature()
    (array([0.6]), array([1.]))
    """

    radius_um: float

    def __post_init__(self) -> None:
        check_fields("", self, {"radius_um": LENGTH})

    def quadrature(self, count: int = 1, moment: int = 6) -> tuple[Array, Array]:
        """The one radius [um] (1,), with the weight 1."""
        return np.array([self.radius_um]), np.ones(1)


@dataclass(frozen=True)
class Lognormal:
    """Radii whose logarithm is normally distributed among the particles (by number, not by mass).

    Parameters
    ----------
    median_um : float
        Median radius [um].
    sigma : float
        Geometric standard deviation, above 1; SceneError for another.

    References
    ----------
    Hansen and Travis, Space Sci. Rev. 16, 527 (1974), whose sigma_g is ln(sigma).

    Examples
    --------
    >>> import vrte
    >>> radii, weights = vrte.Lognormal(median_um=0.2, sigma=1.4).quadrature(100)
    >>> f"{weights @ radii**2:.6f}"  # median^2 exp(2 ln(sigma)^2)
    '0.050164'
    """

    median_um: float
    sigma: float

    def __post_init__(self) -> None:
        sigma = 1.0 + 1e-9, 10.0, "a geometric standard deviation above 1 (and at most 10)"
        check_fields("lognormal: ", self, {"median_um": LENGTH, "sigma": sigma})

    def quadrature(self, count: int, moment: int = 6) -> tuple[Array, Array]:
        """Radii [um] (n,) and number fractions, in equal steps of the logarithm: exact to the mean of r^moment."""
        width = math.log(self.sigma)
        steps = np.linspace(2.0 * width - DEVIATIONS, moment * width + DEVIATIONS, max(2, count))
        density = np.exp(-0.5 * steps**2) / math.sqrt(2.0 * math.pi)
        return self.median_um * np.exp(width * steps), _weigh_steps(density, steps[1] - steps[0])


@dataclass(frozen=True)
class Gamma:
    """Radii with the number density r^((1-3b)/b) exp(-r/(a b)).

    Parameters
    ----------
    r_eff_um : float
        a, the effective radius [um].
    v_eff : float
        b, the effective variance, between 0 and 0.5; SceneError for another.

    References
    ----------
    Hansen and Travis, Space Sci. Rev. 16, 527 (1974).

    Examples
    --------
    >>> import vrte
    >>> radii, weights = vrte.Gamma(r_eff_um=0.2, v_eff=0.07).quadrature(100)
    >>> f"{(weights @ radii**3) / (weights @ radii**2):.6f}"
    '0.200000'
    """

    r_eff_um: float
    v_eff: float

    def __post_init__(self) -> None:
        variance = 1e-6, 0.5 - 1e-6, "an effective variance of at least 1e-6 and below 0.5"
        check_fields("gamma: ", self, {"r_eff_um": LENGTH, "v_eff": variance})

    def quadrature(self, count: int, moment: int = 6) -> tuple[Array, Array]:
        """Radii [um] (n,) and their number shares (n,), in equal steps of the logarithm of the radius."""
        from scipy.special import gammainccinv, gammaincinv, gammaln

        shape, scale = (1.0 - 2.0 * self.v_eff) / self.v_eff, self.r_eff_um * self.v_eff
        low = math.log(gammaincinv(shape + 2.0, TAIL))
        high = math.log(gammainccinv(shape + moment, TAIL))
        steps = np.linspace(low, high, max(2, count))
        density = np.exp(shape * steps - np.exp(steps) - gammaln(shape))
        return scale * np.exp(steps), _weigh_steps(density, steps[1] - steps[0])


@dataclass(frozen=True, eq=False)
class Tabulated:
    """A measured size distribution: number density over radius, linear between the radii given, zero outside.

    Parameters
    ----------
    radius_um : array_like (radii,)
        Radii [um], at least two, increasing.
    density : array_like (radii,)
        How many particles there are a length of radius, in any unit, >= 0 and not zero everywhere; numbers in bins are
        divided by the bins' widths first.

    Examples
    --------
    >>> import vrte
    >>> radii, weights = vrte.Tabulated(radius_um=[0.1, 0.3], density=[1.0, 1.0]).quadrature(65)
    >>> f"{weights @ radii:.6f}"
    '0.200000'
    """

    radius_um: Sequence[float] | Array
    density: Sequence[float] | Array

    def __post_init__(self) -> None:
        radii = check_vector("tabulated: radius_um", self.radius_um)
        density = check_vector("tabulated: density", self.density)
        if radii.size < 2 or radii.size != density.size:
            words = f"must be equally long, at least 2, not {radii.size} and {density.size}"
            raise SceneError(f"tabulated: radius_um and density {words}")
        if not np.all(np.diff(radii) > 0.0):
            raise SceneError.of("tabulated: radius_um", "must increase from each to the next")
        for end in (radii[0], radii[-1]):
            check_number("tabulated: radius_um", float(end), *LENGTH)
        if (density < 0.0).any() or not density.any():
            raise SceneError.of("tabulated: density", "must be >= 0 everywhere and not zero everywhere")
        vars(self).update(radius_um=radii, density=density)

    def quadrature(self, count: int, moment: int = 6) -> tuple[Array, Array]:
        """Radii [um] (n,) and number fractions, by the trapezoidal rule on 2^k parts of each stretch."""
        knots = np.asarray(self.radius_um)
        parts = 2 ** math.ceil(math.log2(max(1.0, (count - 1) / (knots.size - 1))))
        inside = np.arange(parts) / parts
        radii = np.append((knots[:-1, None] + np.diff(knots)[:, None] * inside).ravel(), knots[-1])
        differences = np.diff(radii, prepend=radii[0], append=radii[-1])
        density = np.asarray(self.density) / np.max(self.density)  # it may be as large or small as a double may be
        weights = np.interp(radii, knots, density) * 0.5 * (differences[:-1] + differences[1:])
        return radii, weights / weights.sum()

    def __repr__(self) -> str:
        radii = np.asarray(self.radius_um)
        return f"Tabulated({radii.size} radii from {radii[0]:g} to {radii[-1]:g} um)"

    def __setstate__(self, state: dict[str, Array]) -> None:
        # pickle forgets that an array is read-only
        vars(self).update({name: freeze_copy(values) for name, values in state.items()})


@dataclass(eq=False)
class Held:
    """A distribution averaged over the radii it once took: ``settled``, shared, is their number by medium."""

    distribution: SizeDistribution
    settled: list[tuple[int, int]]
    hosts: list[float] = field(default_factory=list)

    def quadrature(self, count: int, moment: int = 6) -> tuple[Array, Array]:
        """Radii and weights of the distribution, of ``count`` radii up to a ``moment``."""
        return self.distribution.quadrature(count, moment)

    def find(self, host: float) -> tuple[int, int] | None:
        """How many radii to take in a medium, and up to which moment; None the first time."""
        if host not in self.hosts:
            self.hosts.append(host)
        index = self.hosts.index(host)
        return self.settled[index] if index < len(self.settled) else None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Held) and self.settled is other.settled and self.distribution == other.distribution

    def __hash__(self) -> int:
        return id(self.settled)

    def __repr__(self) -> str:
        return repr(self.distribution)


def _weigh_steps(density: Array, step: float) -> Array:
    """Weights (n,) of the trapezoidal rule in even steps."""
    weights = density * step
    weights[[0, -1]] *= 0.5
    return weights
