"""Spheres of a core and a shell around it, averaged over sizes: coated pigments, hollow spheres, droplets on grains."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vrte._core import coated_sphere_coefficients, coated_sphere_slopes
from vrte.basics.arrays import Array, check_number
from vrte.basics.errors import SceneError
from vrte.optics.particles import Particles
from vrte.optics.populations import Complex, check_size_parameter, drop_negligible, find_wavenumber
from vrte.optics.refractive_index import Material, RefractiveIndex, refractive_index
from vrte.optics.size_distribution import SizeDistribution, check_length
from vrte.optics.spheres import (
    SAME_INDEX,
    average_ball,
    check_ball,
    check_light,
    check_phase,
    choose_distribution,
    count_orders,
)

BELOW_ONE = math.nextafter(1.0, 0.0)
SMALLEST_RATIO = 1e-6  # of the core's radius to the whole: it holds 1e-18 of the volume


@dataclass(frozen=True)
class CoatedBall:
    """A core in a shell: a `vrte.optics.populations.Ball`. The core's radius is ``core_ratio`` times the outer one,
    less ``shell_um``."""

    core: RefractiveIndex
    shell: RefractiveIndex
    wavelength_um: float
    host: float
    size: SizeDistribution
    core_ratio: float = 1.0
    shell_um: float = 0.0

    @property
    def absorbs(self) -> bool:
        return max(self.core.k, self.shell.k) > 0.0

    @property
    def in_words(self) -> str:
        core, shell = (f"index {one.n:.6g} + {one.k:.6g}i ({one.source})" for one in (self.core, self.shell))
        if self.shell_um:
            return f"a shell of {self.shell_um:.6g} um, {shell}, around a core, {core}"
        return f"a core of {self.core_ratio:.6g} of the radius, {core}, in a shell, {shell}"

    def find_core_radius(self, radius_um: float) -> float:
        """Of a sphere of this outer radius [um]."""
        return self.core_ratio * radius_um - self.shell_um

    def check_radii(self, radii: Array) -> None:
        size = check_size_parameter(self, radii)
        if self.find_core_radius(float(radii[0])) <= 0.0:
            raise SceneError.of(
                "shell_um",
                f"must be less than the smallest radius that is averaged over, {radii[0]:.4g} um, not "
                f"{self.shell_um:.4g}: sizes are those of whole spheres, and core_ratio fits all of them",
            )
        for index, share in ((self.core, self.find_core_radius(float(radii[-1])) / radii[-1]), (self.shell, 1.0)):
            check_phase(index.n / self.host, share * size, radii[-1])

    def find_coefficients(self, radius_um: float) -> tuple[Complex, Complex]:
        wavenumber = find_wavenumber(self)
        return compute_coated_coefficients(
            self.core.value / self.host,
            self.shell.value / self.host,
            wavenumber * self.find_core_radius(radius_um),
            wavenumber * radius_um,
        )

    def list_arguments(self, radii: Array) -> Complex:
        """What the coefficients of spheres are functions of, (4, sizes): relative indices of core and shell, size
        parameters of the core and of the whole."""
        wavenumber = find_wavenumber(self)
        indices = [np.full(radii.shape, index.value / self.host) for index in (self.core, self.shell)]
        return np.stack(
            [*indices, wavenumber * (self.core_ratio * radii - self.shell_um) + 0j, wavenumber * radii + 0j]
        )

    def find_slopes(self, radius_um: float) -> Complex:
        """a_n and b_n, and their derivatives with each of these, (5, 2, orders)."""
        core, shell = (complex(index.value / self.host) for index in (self.core, self.shell))
        size = find_wavenumber(self) * radius_um
        inner = find_wavenumber(self) * self.find_core_radius(radius_um)
        return coated_sphere_slopes(core, shell, inner, size, count_orders(size))

    def find_permittivity(self, radius_um: float) -> complex:
        """Source: Bohren and Huffman (1983), (5.36), solved for one substance."""
        share = (self.find_core_radius(radius_um) / radius_um) ** 3
        core, shell = self.core.value**2, self.shell.value**2
        dipole = share * (core - shell) / (core + 2.0 * shell)
        return shell * (1.0 + 2.0 * dipole) / (1.0 - dipole)

    def put_in(self, host: float) -> "CoatedBall":
        return replace(self, host=host)


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
    wavelength_um : float
        In vacuum [um]; inside the host it is shorter by ``host_index``.
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
    host_index : str, complex, pair, IndexTable or RefractiveIndex
        Of the medium around them, as in `spheres`.

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
    ball, host = _make_ball(
        core, shell, wavelength_um, core_radius_um, shell_um, core_ratio, radius_um, size, host_index
    )
    return average_ball(ball, host)


def check_coated_spheres(
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
    """All that `coated_spheres` checks, without its work: parameters and errors as there, particles as
    `check_spheres`."""
    return check_ball(
        *_make_ball(core, shell, wavelength_um, core_radius_um, shell_um, core_ratio, radius_um, size, host_index)
    )


def _make_ball(
    core: Material,
    shell: Material,
    wavelength_um: Any,
    core_radius_um: Any,
    shell_um: Any,
    core_ratio: Any,
    radius_um: Any,
    size: SizeDistribution | None,
    host_index: Material,
) -> tuple[CoatedBall, RefractiveIndex]:
    """The ball, and the index of the medium around it, checked."""
    indices = _find_index("core", core, wavelength_um), _find_index("shell", shell, wavelength_um)
    host, wavelength = check_light(wavelength_um, host_index)
    if all(abs(index.value / host.n - 1.0) < SAME_INDEX for index in indices):
        raise SceneError(
            f"coated_spheres: core and shell have the refractive index of their host, {host.n:g}, so they scatter "
            "nothing"
        )
    if sum(given is not None for given in (core_radius_um, shell_um, core_ratio)) != 1:
        raise SceneError("coated_spheres: give exactly one of core_radius_um, shell_um and core_ratio")
    distribution = choose_distribution(radius_um, size)
    shape = _find_shape(core_radius_um, shell_um, core_ratio, radius_um)
    return CoatedBall(*indices, wavelength, host.n, distribution, *shape), host


def _find_shape(core_radius_um: Any, shell_um: Any, core_ratio: Any, radius_um: Any) -> tuple[float, float]:
    """``core_ratio`` and ``shell_um`` of a CoatedBall, from the one of three that is given; the radius is checked."""
    if shell_um is not None:
        return 1.0, check_length("shell_um", shell_um)
    if core_ratio is not None:
        allowed = f"a ratio of radii from {SMALLEST_RATIO:g} to below 1"
        return check_number("core_ratio", core_ratio, SMALLEST_RATIO, BELOW_ONE, allowed), 0.0
    if radius_um is None:
        raise SceneError.of("core_radius_um", "goes with radius_um; spheres of many sizes need shell_um or core_ratio")
    radius = float(radius_um)
    allowed = f"above 0 and less than radius_um, {radius:g} um"
    core = check_number("core_radius_um", core_radius_um, SMALLEST_RATIO * radius, radius, allowed)
    if core == radius:
        raise SceneError.of("core_radius_um", f"must be {allowed}, not {core:g}")
    return core / radius, 0.0


def _find_index(name: str, material: Material, wavelength_um: float) -> RefractiveIndex:
    """Of the core or the shell. Raises SceneError, naming it."""
    try:
        return refractive_index(material, wavelength_um)
    except SceneError as error:
        if error.place != ("index",):
            raise
        raise SceneError(f"{name}{str(error).removeprefix('index')}", name) from error


def compute_coated_coefficients(
    core_index: complex, shell_index: complex, core_size: float, size: float
) -> tuple[Complex, Complex]:
    """a_n and b_n from n = 1 of a sphere with the size parameter ``size`` around a core of ``core_size``, indices
    relative to the host."""
    orders = count_orders(size)
    return drop_negligible(
        *coated_sphere_coefficients(complex(core_index), complex(shell_index), core_size, size, orders)
    )
