"""Homogeneous spheres after Mie, averaged over sizes."""

import math
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from vrte._core import sphere_coefficients, sphere_slopes
from vrte.basics.arrays import Array, check_number, show_value
from vrte.basics.errors import SceneError, warn_user
from vrte.optics.particles import HOST_ALLOWED, Particles
from vrte.optics.phase_matrix import PhaseMatrix, rayleigh
from vrte.optics.populations import (
    DOUBTFUL,
    FEWEST_RADII,
    Ball,
    Complex,
    Population,
    SizeAverageWarning,
    check_quadrature,
    check_size_parameter,
    drop_negligible,
    expand_population,
    find_wavenumber,
    settle_population,
    sum_bulk,
)
from vrte.optics.refractive_index import IndexTable, Material, RefractiveIndex, check_wavelength, refractive_index
from vrte.optics.size_distribution import Monodisperse, SizeDistribution

LARGEST_PHASE = 1e5  # relative index times size parameter: Mie's recurrence takes as many steps
SAME_INDEX = 1e-9  # |m - 1| where the coefficients a_n, b_n are down to their rounding
ABSORBING_UP_TO = 0.01  # k over n of a host: amplitudes are wrong by m/(m - 1) times that where it is taken as clear


@dataclass(frozen=True)
class HomogeneousBall:
    """A sphere of one substance: a `vrte.optics.populations.Ball`."""

    index: RefractiveIndex
    wavelength_um: float
    host: float
    size: SizeDistribution

    @property
    def relative_index(self) -> complex:
        """Relative to the host's."""
        return self.index.value / self.host

    @property
    def absorbs(self) -> bool:
        return self.relative_index.imag > 0.0

    @property
    def in_words(self) -> str:
        return f"index {self.index.n:.6g} + {self.index.k:.6g}i ({self.index.source})"

    def check_radii(self, radii: Array) -> None:
        check_phase(self.relative_index.real, check_size_parameter(self, radii), radii[-1])

    def find_coefficients(self, radius_um: float) -> tuple[Complex, Complex]:
        return compute_mie_coefficients(self.relative_index, find_wavenumber(self) * radius_um)

    def list_arguments(self, radii: Array) -> Complex:
        """What the coefficients of spheres are functions of, (2, sizes): relative index and size parameter."""
        size = find_wavenumber(self) * radii
        return np.stack([np.full(size.shape, self.relative_index), size.astype(complex)])

    def find_slopes(self, radius_um: float) -> Complex:
        """a_n and b_n, and their derivatives with each of these, (3, 2, orders)."""
        size = find_wavenumber(self) * radius_um
        return sphere_slopes(complex(self.relative_index), size, count_orders(size))

    def find_permittivity(self, radius_um: float) -> complex:
        return self.index.value**2

    def put_in(self, host: float) -> "HomogeneousBall":
        return replace(self, host=host)


def spheres(
    material: Material,
    *,
    wavelength_um: float,
    radius_um: float | None = None,
    size: SizeDistribution | None = None,
    host_index: Material = 1.0,
) -> Particles:
    """Homogeneous spheres of one radius or of a size distribution, in a host medium.

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
    host_index : str, complex, pair, IndexTable or RefractiveIndex
        Of the medium around them, in the same ways. One that absorbs a little, k up to 0.01 n, is taken as clear in the
        sphere's boundary conditions, which makes amplitudes wrong by some k/n times m/(m - 1), m the relative index;
        what it absorbs between the particles is counted by `Layer.of`.

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

    References
    ----------
    Bohren and Huffman (1983), chapter 4; de Rooij and van der Stap, Astron. Astrophys. 131, 237 (1984).

    Examples
    --------
    >>> import vrte
    >>> glass = vrte.spheres(1.5, radius_um=0.5, wavelength_um=0.5)
    >>> glass.albedo, glass.phase_matrix.a1[0]
    (1.0, np.float64(1.0))
    """
    ball, host = _make_ball(material, wavelength_um, radius_um, size, host_index)
    return average_ball(ball, host)


def check_spheres(
    material: Material,
    *,
    wavelength_um: float,
    radius_um: float | None = None,
    size: SizeDistribution | None = None,
    host_index: Material = 1.0,
) -> Particles:
    """All that `spheres` checks, without its work: parameters and errors as there.

    What comes back are no such particles, but Rayleigh's, of extinction and volume 1: something to go on with.

    >>> check_spheres(1.5, radius_um=-1.0, wavelength_um=0.5)
    Traceback (most recent call last):
    vrte.SceneError: radius_um must be a length from 1e-06 to 1e+06 um, not -1.0
    """
    return check_ball(*_make_ball(material, wavelength_um, radius_um, size, host_index))


def _make_ball(
    material: Material, wavelength_um: Any, radius_um: Any, size: SizeDistribution | None, host_index: Material
) -> tuple[HomogeneousBall, RefractiveIndex]:
    """The ball, and the index of the medium around it, checked."""
    index, (host, wavelength) = refractive_index(material, wavelength_um), check_light(wavelength_um, host_index)
    if abs(index.value / host.n - 1.0) < SAME_INDEX:
        raise SceneError(
            f"spheres: the particles have the refractive index of their host, {host.n:g}, so they scatter nothing"
        )
    return HomogeneousBall(index, wavelength, host.n, choose_distribution(radius_um, size)), host


def check_phase(relative_index: float, size: float, radius_um: float) -> None:
    """Raises SceneError where a relative index times the size parameter of a radius is too large."""
    if relative_index * size > LARGEST_PHASE:
        raise SceneError(
            f"spheres: the index relative to the host times the size parameter must be at most {LARGEST_PHASE:g}, "
            f"not {relative_index * size:.4g} (a radius of {radius_um:.4g} um)"
        )


def check_light(wavelength_um: Any, host_index: Material) -> tuple[RefractiveIndex, float]:
    """The index of the medium around particles, and the wavelength in vacuum [um]. Raises SceneError."""
    wavelength = check_wavelength(wavelength_um)
    return find_host_index(host_index, wavelength), wavelength


def find_host_index(host_index: Material, wavelength_um: float) -> RefractiveIndex:
    """n + ik of the medium around particles. Raises SceneError, naming it, where it absorbs too much."""
    low, high, allowed = HOST_ALLOWED
    try:
        found = refractive_index(host_index, wavelength_um)
        check_number("host_index", found.n, low, high, allowed)
    except SceneError as error:
        if isinstance(host_index, (str, IndexTable)):
            raise SceneError(f"host_{error}", "host_index") from error
        given = f"{allowed}, or n + ik that absorbs little, not {show_value(host_index)}"
        raise SceneError.of("host_index", f"must be {given}") from None
    if found.k > ABSORBING_UP_TO * found.n:
        raise SceneError(
            f"host_index: {found.n:.6g} + {found.k:.3g}i absorbs too much: light goes through media with k from 0 to "
            f"{ABSORBING_UP_TO:g} n, taken as clear around particles and at surfaces; what absorbs more is for bases",
            "host_index",
        )
    return found


def average_ball(ball: Ball, host: RefractiveIndex) -> Particles:
    """Particles of one kind, averaged over sizes; says so where these have not settled."""
    population, changes = settle_population(ball)
    description = _describe_spheres(ball, population, float(changes[:2].max()))
    if changes[:2].max() > DOUBTFUL:
        warn_user(f"spheres: not settled; {description}", SizeAverageWarning)
    extinction, scattering, _, _ = sum_bulk(population) * (2.0 * math.pi / find_wavenumber(ball) ** 2)
    if not ball.absorbs:
        extinction = scattering  # the two sums differ by rounding, and an albedo of 1 should be exactly that
    phase_matrix = expand_population(population)
    volumes = 4.0 / 3.0 * math.pi * (population.sizes / find_wavenumber(ball)) ** 3
    return Particles(
        phase_matrix=phase_matrix,
        albedo=min(1.0, float(scattering / extinction)),
        asymmetry=phase_matrix.asymmetry,
        extinction_um2=float(extinction),
        scattering_um2=float(scattering),
        volume_um3=float(population.weights @ volumes),
        description=description,
        host_index=host.n,
        host_absorption=find_absorption(host, ball.wavelength_um),
        balls=((ball, 1.0),),
    )


def find_absorption(host: RefractiveIndex, wavelength_um: float) -> float:
    """What a medium absorbs, 4 pi k/wavelength [1/um]."""
    return 4.0 * math.pi * host.k / wavelength_um


def check_ball(ball: Ball, host: RefractiveIndex) -> Particles:
    """All that `average_ball` checks, and particles to go on with: Rayleigh's, of extinction and volume 1."""
    radii, _ = check_quadrature(ball.size, FEWEST_RADII, 6)
    ball.check_radii(radii)
    return Particles(
        make_stand_in_matrix(),
        1.0,
        0.0,
        extinction_um2=1.0,
        scattering_um2=1.0,
        volume_um3=1.0,
        host_index=host.n,
        host_absorption=find_absorption(host, ball.wavelength_um),
        balls=((ball, 1.0),),
        stands_in=True,
    )


@cache
def make_stand_in_matrix() -> PhaseMatrix:
    """Of particles that are none: Rayleigh's."""
    return rayleigh()


def compute_mie_coefficients(relative_index: complex, size: float) -> tuple[Complex, Complex]:
    """a_n and b_n from n = 1 of a sphere with the size parameter ``size``, index relative to the host.

    Source: Bohren and Huffman (1983), (4.53).
    """
    return drop_negligible(*sphere_coefficients(complex(relative_index), size, count_orders(size)))


def count_orders(size: float) -> int:
    """How many a_n and b_n to work out: Wiscombe's number of orders leaves out some 1e-8 of an amplitude, so more are
    asked for, and those that hold nothing are dropped."""
    return int(size + 6.0 * size ** (1.0 / 3.0) + 8.0)


def choose_distribution(
    radius_um: float | None, size: SizeDistribution | None, whose: str = "spheres"
) -> SizeDistribution:
    """The distribution of radii that one of two arguments gives. Raises SceneError."""
    if (radius_um is None) == (size is None):
        raise SceneError(f"{whose}: give either radius_um or size")
    if size is None:
        return Monodisperse(radius_um)  # type: ignore[arg-type]
    if isinstance(size, type) or not callable(getattr(size, "quadrature", None)):
        raise SceneError(
            f"{whose}: size must be a Lognormal, Gamma, Monodisperse or Tabulated, not {type(size).__name__}"
        )
    return size


def _describe_spheres(ball: Ball, population: Population, change: float) -> str:
    """One line: what the spheres are, where their index comes from and how well their sizes are averaged."""
    where = f"at {ball.wavelength_um:g} um" + (f" in a host of index {ball.host:g}" if ball.host != 1.0 else "")
    text = f"spheres, {ball.size}, {where}, {ball.in_words}"
    if population.sizes.size > 1:
        text += f", {population.sizes.size} radii, cross sections settled to {max(change, 1e-16):.0e}"
    return text
