"""Spheroids and cylinders in random orientation, averaged over sizes: the extra "shapes"."""

from typing import Any

from vrte.basics.arrays import check_number
from vrte.basics.errors import SceneError
from vrte.optics.particles import Particles
from vrte.optics.refractive_index import Material, refractive_index
from vrte.optics.shape_sizes import WORDS, Shape, average_shape, find_largest_radius
from vrte.optics.size_distribution import SizeDistribution
from vrte.optics.spheres import (
    SAME_INDEX,
    check_light,
    choose_distribution,
    find_absorption,
    make_stand_in_matrix,
)
from vrte.optics.transition_matrix import CYLINDER, SPHEROID, import_solver

ASPECT_ALLOWED = 0.1, 10.0, "a width over a length, from 0.1 to 10"


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
    material : str, complex, pair, IndexTable or RefractiveIndex
        All that `refractive_index` takes: a name, a database path, n + i k or (n, k).
    wavelength_um : float
        In vacuum [um]; inside the host it is shorter by ``host_index``.
    aspect_ratio : float
        Width across the axis of rotation over length along it, from 0.1 to 10: above 1 flat (oblate), below 1 long
        (prolate), 1 a sphere.
    radius_um : float, optional
        Of the sphere of equal volume, the same for all, or
    size : Lognormal, Gamma, Monodisperse or Tabulated, optional
        The distribution of these radii; all sizes have the same aspect ratio.
    host_index : str, complex, pair, IndexTable or RefractiveIndex
        Of the medium around them, as for `spheres`.

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
    return average_shape(_make_shape(SPHEROID, material, wavelength_um, aspect_ratio, radius_um, size, host_index))


def check_spheroids(
    material: Material,
    *,
    wavelength_um: float,
    aspect_ratio: float,
    radius_um: float | None = None,
    size: SizeDistribution | None = None,
    host_index: Material = 1.0,
) -> Particles:
    """All that `spheroids` checks, without its work: what comes back is Rayleigh's, to go on with.

    >>> check_spheroids(1.5, aspect_ratio=-2.0, radius_um=0.1, wavelength_um=0.5)
    Traceback (most recent call last):
    vrte.SceneError: aspect_ratio must be a width over a length, from 0.1 to 10, not -2.0
    """
    return check_shape(_make_shape(SPHEROID, material, wavelength_um, aspect_ratio, radius_um, size, host_index))


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
    material : str, complex, pair, IndexTable or RefractiveIndex
        All that `refractive_index` takes: a name, a database path, n + i k or (n, k).
    wavelength_um : float
        In vacuum [um]; inside the host it is shorter by ``host_index``.
    aspect_ratio : float
        Diameter over length, from 0.1 to 10: above 1 discs, below 1 rods.
    radius_um : float, optional
        Of the sphere of equal volume, the same for all, or
    size : Lognormal, Gamma, Monodisperse or Tabulated, optional
        The distribution of these radii; all sizes have the same aspect ratio.
    host_index : str, complex, pair, IndexTable or RefractiveIndex
        Of the medium around them, as for `spheres`.

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

    Warns
    -----
    LongSolveWarning
        Where it will take more than 20 s: time grows with the sixth power of the size.

    References
    ----------
    As of `spheroids`.

    Examples
    --------
    >>> import vrte
    >>> crystals = vrte.cylinders(1.31, aspect_ratio=1.0, radius_um=0.1, wavelength_um=0.5)
    >>> f"{crystals.volume_um3:.6f}"  # that of the sphere
    '0.004189'
    """
    return average_shape(_make_shape(CYLINDER, material, wavelength_um, aspect_ratio, radius_um, size, host_index))


def check_cylinders(
    material: Material,
    *,
    wavelength_um: float,
    aspect_ratio: float,
    radius_um: float | None = None,
    size: SizeDistribution | None = None,
    host_index: Material = 1.0,
) -> Particles:
    """All that `cylinders` checks, without its work: what comes back is Rayleigh's, to go on with.

    >>> check_cylinders(1.5, aspect_ratio=1.0, wavelength_um=0.5)
    Traceback (most recent call last):
    vrte.SceneError: cylinders: give either radius_um or size
    """
    return check_shape(_make_shape(CYLINDER, material, wavelength_um, aspect_ratio, radius_um, size, host_index))


def _make_shape(
    kind: int,
    material: Material,
    wavelength_um: Any,
    aspect_ratio: Any,
    radius_um: Any,
    size: SizeDistribution | None,
    host_index: Material,
) -> Shape:
    """The particles, all of them checked, and the solver's presence."""
    words = WORDS[kind]
    index, (host, wavelength) = refractive_index(material, wavelength_um), check_light(wavelength_um, host_index)
    if abs(index.value / host.n - 1.0) < SAME_INDEX:
        raise SceneError(
            f"{words}: the particles have the refractive index of their host, {host.n:g}, so they scatter nothing"
        )
    aspect = check_number("aspect_ratio", aspect_ratio, *ASPECT_ALLOWED)
    shape = Shape(kind, index, wavelength, host, aspect, choose_distribution(radius_um, size, words))
    find_largest_radius(shape)
    import_solver()
    return shape


def check_shape(shape: Shape) -> Particles:
    """Particles to go on with: Rayleigh's, of extinction and volume 1."""
    return Particles(
        make_stand_in_matrix(),
        1.0,
        0.0,
        extinction_um2=1.0,
        scattering_um2=1.0,
        volume_um3=1.0,
        host_index=shape.host.n,
        host_absorption=find_absorption(shape.host, shape.wavelength_um),
    )
