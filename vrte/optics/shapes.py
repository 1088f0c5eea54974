"""Spheroids and cylinders in random orientation, averaged over sizes: the extra "shapes"."""

import math
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from vrte.basics import cost
from vrte.basics.arrays import Array, check_number
from vrte.basics.errors import AccuracyWarning, SceneError, warn_user
from vrte.basics.running import count_usable_cpus
from vrte.optics.particles import (
    ParticleKind,
    Particles,
    check_kind,
    describe_convergence,
    describe_index,
    make_check,
    refuse_size,
)
from vrte.optics.populations import make_phase_matrix
from vrte.optics.refractive_index import Material
from vrte.optics.size_distribution import SizeDistribution
from vrte.optics.transition_matrix import (
    CYLINDER,
    FAIR,
    SPHEROID,
    Average,
    average_orientations,
    count_orders,
    find_reach,
    import_solver,
)

WORDS = {SPHEROID: "spheroids", CYLINDER: "cylinders"}
ASPECT_ALLOWED = 0.1, 10.0, "a width over a length, from 0.1 to 10"
SMALLEST_SIZE, LARGEST_SIZE = 1e-4, 50.0  # size parameters of the sphere of equal volume, and of that around a particle
TOO_SMALL = 1e-2 * SMALLEST_SIZE  # for the solver's Bessel functions; left out beside larger ones
TAIL = 1e-4  # of the sum of cross sections: what is held by larger sizes than those worked out
FEWEST_RADII, MOST_RADII = 17, 129
CONVERGED = np.array([1e-4, 1e-4, 1e-4, 1e-3])  # relative: extinction, scattering, asymmetry, backscattering
REFUSED = 1e-2  # error of amplitudes, or of energy
MOMENT = 4  # of the radius, up to which radii are averaged over


@dataclass(frozen=True)
class Shape(ParticleKind):
    """Particles of one ``shape``, SPHEROID or CYLINDER, and width over length; radii are of equal volume."""

    shape: int
    aspect_ratio: float

    @property
    def words(self) -> str:
        return WORDS[self.shape]

    @property
    def reach(self) -> float:
        """The size parameter of the sphere around a particle over its radius [1/um]."""
        return find_reach(self.shape, self.aspect_ratio) * self.wavenumber

    def list_balls(self) -> tuple[()]:
        return ()


def spheroids(
    material: Material,
    *,
    wavelength_um: float,
    aspect_ratio: float,
    radius_um: float | None = None,
    size: SizeDistribution | None = None,
    host_index: Material = 1.0,
) -> Particles:
    """Homogeneous spheroids in random orientation, of one size or of a size distribution, in a host medium.

    Parameters
    ----------
    material, wavelength_um, host_index
        As of `spheres`.
    aspect_ratio : float
        Width across the axis of rotation over length along it, from 0.1 to 10: above 1 flat (oblate), below 1 long
        (prolate), 1 a sphere.
    radius_um : float, optional
        Of the sphere of equal volume, the same for all, or
    size : Lognormal, Gamma, Monodisperse or Tabulated, optional
        The distribution of these radii; all sizes have the same aspect ratio.

    Returns
    -------
    Particles
        Averaged over orientations exactly, from the transition matrix. It is found by the null-field method (extended
        boundary conditions), which loses digits of large, long and flat particles: ``description`` says how far
        amplitudes are from reciprocal and, of clear particles, how well energy is kept (an AccuracyWarning tells of
        more than 1e-3). Averages over sizes double the number of radii from 17 until cross sections and asymmetry
        change by less than 1e-4 and backscattering by less than 1e-3, or until there are 129 (SizeAverageWarning above
        1e-2); the largest sizes, which hold 1e-4 of the cross sections, scatter as the largest of the others, by their
        areas.

    Raises
    ------
    SceneError
        As `spheres`; where the size parameter of the sphere around the largest is above 50 or that of the sphere of
        equal volume below 1e-4, or where the null-field method does not converge to 1e-2.
    MissingExtraError
        Without the extra "shapes".

    Warns
    -----
    LongSolveWarning
        Where it will take more than 20 s: time grows with the sixth power of the size.

    References
    ----------
    Mishchenko, Travis and Lacis, "Scattering, absorption, and emission of light by small particles" (2002),
    chapter 5; Mishchenko, J. Opt. Soc. Am. A 8, 871 (1991).

    Examples
    --------
    >>> import vrte
    >>> dust = vrte.spheroids(1.5, aspect_ratio=2.0, radius_um=0.1, wavelength_um=0.5)
    >>> dust.albedo, dust.phase_matrix.a2[2] > dust.phase_matrix.a3[2]
    (1.0, np.True_)
    """
    how = {"wavelength_um": wavelength_um, "radius_um": radius_um, "size": size, "host_index": host_index}
    return average_shape(make_shape(SPHEROID, material, aspect_ratio, **how))


def cylinders(
    material: Material,
    *,
    wavelength_um: float,
    aspect_ratio: float,
    radius_um: float | None = None,
    size: SizeDistribution | None = None,
    host_index: Material = 1.0,
) -> Particles:
    """Homogeneous round cylinders with flat ends in random orientation, in a host medium.

    Parameters
    ----------
    material, wavelength_um, host_index
        As of `spheres`.
    aspect_ratio : float
        Diameter over length, from 0.1 to 10: above 1 discs, below 1 rods.
    radius_um, size
        As of `spheroids`.

    Returns
    -------
    Particles
        As from `spheroids`. Edges make the null-field method converge slower: to some 1e-4 to 1e-3.

    Raises
    ------
    SceneError
        As `spheroids`.
    MissingExtraError
        Without the extra "shapes".

    Examples
    --------
    >>> import vrte
    >>> crystals = vrte.cylinders(1.31, aspect_ratio=1.0, radius_um=0.1, wavelength_um=0.5)
    >>> f"{crystals.volume_um3:.6f}"  # that of the sphere
    '0.004189'
    """
    how = {"wavelength_um": wavelength_um, "radius_um": radius_um, "size": size, "host_index": host_index}
    return average_shape(make_shape(CYLINDER, material, aspect_ratio, **how))


def make_shape(shape: int, material: Material, aspect_ratio: Any, **how: Any) -> Shape:
    """What `spheroids` and `cylinders` average over, checked, and the solver's presence."""
    common = check_kind(WORDS[shape], {"index": material}, **how)
    found = Shape(*common, shape, check_number("aspect_ratio", aspect_ratio, *ASPECT_ALLOWED))
    find_largest_radius(found)
    import_solver()
    return found


check_spheroids, check_cylinders = (make_check(partial(make_shape, shape)) for shape in (SPHEROID, CYLINDER))


def find_largest_radius(shape: Shape) -> float:
    """The radius beyond which sizes hold little; those scatter as it does, by their areas. Raises SceneError."""
    radii, weights = shape.read_quadrature(MOST_RADII, MOMENT)
    parameters = shape.wavenumber * radii
    if parameters[-1] < SMALLEST_SIZE:
        words = f"at least {SMALLEST_SIZE:g}, not {parameters[-1]:.4g} (a radius of {radii[-1]:.4g} um)"
        raise SceneError(f"{shape.words}: the size parameter 2 pi r/wavelength must be {words}")
    section = weights * radii**2 * np.minimum(2.0, parameters) ** 4  # small ones scatter as r^6
    beyond = np.cumsum(section[::-1])[::-1] - section  # what larger ones hold
    largest = float(radii[np.argmax(beyond <= TAIL * section.sum())])
    around = shape.reach * largest
    if around > LARGEST_SIZE:
        what = f"{shape.words}: the size parameter 2 pi r/wavelength of the sphere around the largest"
        raise refuse_size(what, LARGEST_SIZE, around, largest)
    return largest


def average_shape(shape: Shape) -> Particles:
    """Particles averaged over orientations and sizes; warns where the null-field method hardly converges."""
    largest, known = find_largest_radius(shape), dict[float, Average]()
    average = partial(add_sizes, shape, largest, known)
    mean, count, change = shape.average_sizes(average, MOMENT, (FEWEST_RADII, MOST_RADII), CONVERGED)
    extinction, scattering = mean.extinction / shape.wavenumber**2, mean.scattering / shape.wavenumber**2
    energy = 0.0 if shape.absorbs else abs(extinction / scattering - 1.0)
    description = (
        f"{shape.words} in random orientation, aspect ratio {shape.aspect_ratio:g}, volumes of {shape.size}, "
        f"{shape.where}, {describe_index(shape.substances[0])}, reciprocal to {max(mean.error, 1e-16):.0e}"
        f"{'' if shape.absorbs else f', energy kept to {max(energy, 1e-16):.0e}'}"
        f"{describe_convergence(count, change, f' up to {largest:.3g} um')}"
    )
    if max(mean.error, energy) > FAIR:
        warn_user(f"{shape.words}: the null-field method hardly converges; {description}", AccuracyWarning)
    sums = mean.sums * ((2.0 * np.arange(len(mean.sums))[:, None] + 1.0) / mean.sums[0, 0])
    radii, weights = shape.read_quadrature(MOST_RADII, MOMENT)
    volume = float(weights @ (4.0 / 3.0 * math.pi * radii**3))
    return shape.make_particles(make_phase_matrix(sums), extinction, scattering, volume, description, change)


def add_sizes(
    shape: Shape, largest: float, known: dict[float, Average], count: int, moment: int
) -> tuple[Average, Array, int]:
    """The mean over ``count`` radii up to a ``moment``, and its `sum_bulk`; those not ``known`` are kept there."""
    radii, weights = shape.read_quadrature(count, moment)
    counts = shape.wavenumber * radii >= TOO_SMALL
    radii, weights = radii[counts], weights[counts]
    solved = np.minimum(radii, largest)
    new = {radius for radius in solved.tolist() if radius not in known}
    work = sum((1.2 * count_orders(shape.reach * radius)) ** 6 for radius in new)
    seconds = cost.SECONDS_OF_ORDERS * work / count_usable_cpus()
    why = f", most of it for the largest {shape.words}"
    cost.warn_runtime(seconds, math.inf, why, "smaller or rounder ones take less")
    for radius in sorted(new, reverse=True):  # what may fail comes first
        known[radius] = solve_size(shape, radius)
    parts = [known[radius] for radius in solved.tolist()]
    weights = weights * (radii / solved) ** 2  # of larger ones: their areas
    sums = np.zeros((max(len(part.sums) for part in parts), 6))
    for weight, part in zip(weights, parts, strict=True):
        sums[: len(part.sums)] += weight * part.sums
    numbers = [[part.extinction, part.scattering, part.scattering * part.error] for part in parts]
    extinction, scattering, errors = (weights @ numbers).tolist()
    mean = Average(extinction, scattering, sums, errors / scattering)
    alternate = (-1.0) ** np.arange(len(sums)) * (2.0 * np.arange(len(sums)) + 1.0)
    asymmetry, back = 2.0 * math.pi * sums[1, 0], 2.0 * math.pi * alternate @ sums[:, 0]
    return mean, np.array([mean.extinction, mean.scattering, asymmetry, back]), np.unique(solved).size


def solve_size(shape: Shape, radius_um: float) -> Average:
    """One size in random orientation. Raises SceneError where the null-field method does not converge."""
    size = shape.wavenumber * radius_um
    (index,) = shape.relative_indices
    found = average_orientations(shape.shape, shape.aspect_ratio, size, index)
    if found is not None:
        excess = found.scattering / found.extinction - 1.0
        if max(found.error, excess if shape.absorbs else abs(excess)) <= REFUSED:
            return found
    raise SceneError(
        f"{shape.words}: the null-field method does not converge to {REFUSED:g} at an aspect ratio of "
        f"{shape.aspect_ratio:g}, a size parameter of {size:.4g} and an index {index.real:.4g} + {index.imag:.3g}i "
        f"relative to the host (a sphere of equal volume of {radius_um:.4g} um): smaller or rounder ones do"
    )
