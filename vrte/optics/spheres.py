"""Spheres after Mie, of one substance or of a core in a shell: pigments, hollow spheres, droplets on grains; and their
derivatives in closed form.

Derivatives of a_n and b_n come from the compiled recursions (core/mie.pxi); cross sections and phase matrix are
quadratic in a_n and b_n, and linear in the weights of sizes. Radii, their number and that of terms are the value's.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte._core import coated_sphere_coefficients, coated_sphere_slopes, sphere_coefficients, sphere_slopes
from vrte.basics.arrays import Array, check_number
from vrte.basics.errors import SceneError
from vrte.basics.quadrature import find_gauss_legendre
from vrte.optics.particles import (
    ParticleKind,
    Particles,
    check_kind,
    describe_convergence,
    describe_index,
    make_check,
    refuse_size,
)
from vrte.optics.phase_matrix import arrange_coefficients, project_elements
from vrte.optics.populations import (
    ANGLES_AT_ONCE,
    FEWEST_RADII,
    SIZES_AT_ONCE,
    Complex,
    average_population,
    combine_sphere_elements,
    compute_angular_functions,
    count_held_orders,
    expand_population,
    find_amplitudes,
    sum_bulk,
)
from vrte.optics.refractive_index import Material
from vrte.optics.size_distribution import LENGTH, SizeDistribution

LARGEST_SIZE = 1e4  # size parameter 2 pi r/wavelength: beyond, an expansion of 2e4 terms helps nobody
LARGEST_PHASE = 1e5  # relative index times size parameter: Mie's recurrence takes as many steps
BELOW_ONE = math.nextafter(1.0, 0.0)
SMALLEST_RATIO = 1e-6  # of the core's radius to the whole: it holds 1e-18 of the volume


@dataclass(frozen=True)
class Ball(ParticleKind):
    """Spheres of one substance, or with a core of ``core_ratio`` times the radius, less ``shell_um``."""

    core_ratio: float = 1.0
    shell_um: float = 0.0

    @property
    def in_words(self) -> str:
        """What it consists of."""
        core, shell = (describe_index(self.substances[index]) for index in (0, -1))
        if len(self.substances) == 1:
            return core
        if self.shell_um:
            return f"a shell of {self.shell_um:.6g} um, {shell}, around a core, {core}"
        return f"a core of {self.core_ratio:.6g} of the radius, {core}, in a shell, {shell}"

    def find_core_radius(self, radius_um: Any) -> Any:
        """The radius of the core [um] of spheres of outer radii [um]."""
        return self.core_ratio * radius_um - self.shell_um

    def list_sizes(self, radius_um: Any) -> list[Any]:
        """Size parameters of core and whole, or of the whole alone, of outer radii [um]."""
        radii = [self.find_core_radius(radius_um), radius_um]
        return [self.wavenumber * radius for radius in radii[-len(self.substances) :]]

    def check_radii(self, radii: Array) -> None:
        """Raises SceneError where the smallest of ascending radii [um] is too small, or the largest too large."""
        size = float(self.wavenumber * radii[-1])
        if size > LARGEST_SIZE:
            raise refuse_size(f"{self.words}: the size parameter 2 pi r/wavelength", LARGEST_SIZE, size, radii[-1])
        if self.find_core_radius(float(radii[0])) <= 0.0:
            raise SceneError.of(
                "shell_um",
                f"must be less than the smallest radius that is averaged over, {radii[0]:.4g} um, not "
                f"{self.shell_um:.4g}: sizes are those of whole spheres, and core_ratio fits all of them",
            )
        for index, part in zip(self.relative_indices, self.list_sizes(float(radii[-1])), strict=True):
            if index.real * part > LARGEST_PHASE:
                raise SceneError(
                    f"spheres: the index relative to the host times the size parameter must be at most "
                    f"{LARGEST_PHASE:g}, not {index.real * part:.4g} (a radius of {radii[-1]:.4g} um)"
                )

    def find_coefficients(self, radii: Array) -> tuple[Complex, Complex]:
        """a_n and b_n from n = 1 of spheres of these outer radii [um], (sizes, orders)."""
        return compute_mie_coefficients(*self.relative_indices, *self.list_sizes(radii))

    def list_arguments(self, radii: Array) -> Complex:
        """Arguments (arguments, sizes) of coefficients: relative indices and size parameters, from the inside out."""
        indices = [np.full(radii.shape, index) for index in self.relative_indices]
        return np.stack([*indices, *(size + 0j for size in self.list_sizes(radii))])

    def find_slopes(self, radius_um: float) -> Complex:
        """a_n and b_n, and their derivatives with each argument, (1 + arguments, 2, orders)."""
        find: Any = sphere_slopes if len(self.substances) == 1 else coated_sphere_slopes
        sizes = self.list_sizes(radius_um)
        return find(*map(complex, self.relative_indices), *sizes, count_orders(sizes[-1]))

    def find_permittivity(self, radius_um: float) -> complex:
        """Permittivity of the homogeneous sphere of equal static polarizability (Bohren and Huffman (1983), (5.36))."""
        core, shell = self.substances[0].value ** 2, self.substances[-1].value ** 2
        if len(self.substances) == 1:
            return shell
        dipole = (self.find_core_radius(radius_um) / radius_um) ** 3 * (core - shell) / (core + 2.0 * shell)
        return shell * (1.0 + 2.0 * dipole) / (1.0 - dipole)

    def make_stand_in(self) -> Particles:
        self.check_radii(self.read_quadrature(FEWEST_RADII, 6)[0])
        return super().make_stand_in()


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
        are 2049. Clear spheres have resonances narrower than any such spacing: ``description`` says how far the cross
        sections have converged (1e-3 for a clear index of 2.7), and a SizeAverageWarning is given above 1e-2.

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
    sizes = {"radius_um": radius_um, "size": size}
    return average_ball(make_ball(material, wavelength_um=wavelength_um, host_index=host_index, **sizes))


def make_ball(material: Material, **how: Any) -> Ball:
    """What `spheres` averages over, checked."""
    return Ball(*check_kind("spheres", {"index": material}, **how))


def coated_spheres(
    core: Material,
    shell: Material,
    *,
    wavelength_um: float,
    core_radius_um: float | None = None,
    shell_um: float | None = None,
    core_ratio: float | None = None,
    radius_um: float | None = None,
    size: SizeDistribution | None = None,
    host_index: Material = 1.0,
) -> Particles:
    """Spheres of a core and a shell, of one radius or of a size distribution, in a host medium.

    Hollow spheres have "air", or 1.0, for their core.

    Parameters
    ----------
    core, shell : str, complex, pair, IndexTable or RefractiveIndex
        What they consist of, all that `refractive_index` takes: a name, a database path, n + i k or (n, k).
    wavelength_um, host_index
        Of the light in vacuum [um], and of the medium around them, as in `spheres`.
    core_radius_um : float, optional
        Of the core [um], less than ``radius_um`` and only with it, or
    shell_um : float, optional
        thickness of the shell [um], the same on spheres of all sizes, or
    core_ratio : float, optional
        radius of the core over the whole radius, below 1, the same in spheres of all sizes: one of the three.
    radius_um : float, optional
        Of all of them, the shell included [um], or
    size : Lognormal, Gamma, Monodisperse or Tabulated, optional
        the distribution of their radii, shells included.

    Returns
    -------
    Particles
        Averaged over sizes as in `spheres`; ``volume_um3`` is that of core and shell.

    Raises
    ------
    SceneError
        Naming the argument: for none or two of the three that say how thick the shell is, a shell that is thicker than
        the smallest sphere, both or neither of radius_um and size, and all that `spheres` refuses.

    References
    ----------
    Bohren and Huffman (1983), section 8.1.

    Examples
    --------
    >>> import vrte
    >>> hollow = vrte.coated_spheres(1.0, 1.59, core_ratio=0.8, radius_um=0.25, wavelength_um=0.55, host_index=1.33)
    >>> f"{hollow.scattering_um2 / hollow.volume_um3:.3f} 1/um"
    '0.715 1/um'
    """
    how = {"wavelength_um": wavelength_um, "host_index": host_index, "radius_um": radius_um, "size": size}
    thickness = {"core_radius_um": core_radius_um, "shell_um": shell_um, "core_ratio": core_ratio}
    return average_ball(make_coated_ball(core, shell, **thickness, **how))


def make_coated_ball(
    core: Material,
    shell: Material,
    core_radius_um: Any = None,
    shell_um: Any = None,
    core_ratio: Any = None,
    **how: Any,
) -> Ball:
    """What `coated_spheres` averages over, checked."""
    if sum(given is not None for given in (core_radius_um, shell_um, core_ratio)) != 1:
        raise SceneError("coated_spheres: give exactly one of core_radius_um, shell_um and core_ratio")
    common = check_kind("coated_spheres", {"core": core, "shell": shell}, **how)
    if shell_um is not None:
        return Ball(*common, shell_um=check_number("shell_um", shell_um, *LENGTH))
    if core_ratio is not None:
        allowed = f"a ratio of radii from {SMALLEST_RATIO:g} to below 1"
        return Ball(*common, check_number("core_ratio", core_ratio, SMALLEST_RATIO, BELOW_ONE, allowed))
    if how.get("radius_um") is None:
        raise SceneError.of("core_radius_um", "goes with radius_um; spheres of many sizes need shell_um or core_ratio")
    radius = float(how["radius_um"])
    allowed = f"above 0 and less than radius_um, {radius:g} um"
    inner = check_number("core_radius_um", core_radius_um, SMALLEST_RATIO * radius, radius, allowed)
    if inner == radius:
        raise SceneError.of("core_radius_um", f"must be {allowed}, not {inner:g}")
    return Ball(*common, inner / radius)


check_spheres, check_coated_spheres = make_check(make_ball), make_check(make_coated_ball)


def average_ball(ball: Ball) -> Particles:
    """Spheres of one kind, averaged over sizes."""
    population, count, change = average_population(ball)
    description = f"spheres, {ball.size}, {ball.where}, {ball.in_words}{describe_convergence(count, change)}"
    extinction, scattering, _, _ = sum_bulk(population) * (2.0 * math.pi / ball.wavenumber**2)
    volume = population.weights @ (4.0 / 3.0 * math.pi * (population.sizes / ball.wavenumber) ** 3)
    bulk = float(extinction), float(scattering), float(volume)
    return ball.make_particles(expand_population(population), *bulk, description, change)


def compute_mie_coefficients(*numbers: Any) -> tuple[Complex, Complex]:
    """a_n and b_n (..., orders), n >= 1, of spheres or coated ones (...): Bohren and Huffman (1983), (4.53), 8.1."""
    given = np.broadcast_arrays(*numbers)
    half, shape = len(given) // 2, given[0].shape
    indices = [np.array(each, np.complex128).ravel() for each in given[:half]]
    sizes = [np.array(each, float).ravel() for each in given[half:]]
    find: Any = sphere_coefficients if half == 1 else coated_sphere_coefficients
    found = find(*indices, *sizes, np.array([*map(count_orders, sizes[-1].tolist())], np.int32))
    held = count_held_orders(found)
    found *= np.arange(found.shape[-1]) < held[:, None, None]
    a, b = np.ascontiguousarray(found[..., : held.max()].swapaxes(0, 1))
    return a.reshape(*shape, -1), b.reshape(*shape, -1)


def count_orders(size: float) -> int:
    """How many a_n and b_n to compute: more than Wiscombe's number, which loses 1e-8 of an amplitude."""
    return int(size + 6.0 * size ** (1.0 / 3.0) + 8.0)


@dataclass(frozen=True, eq=False)
class SphereNumbers:
    """What spheres depend on, or its change: ``arguments`` (arguments, sizes), radii [um], weights, wavenumber
    [1/um]."""

    arguments: Complex
    radii: Array
    weights: Array
    wavenumber: Array

    @classmethod
    def of(cls, ball: Ball, count: int, moment: int) -> "SphereNumbers":
        """The numbers of a ball, averaged over ``count`` radii up to a ``moment``."""
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
