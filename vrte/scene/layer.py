"""A layer of particles."""

import math
from dataclasses import dataclass
from typing import Any

from vrte.basics.arrays import check_fields, check_number
from vrte.basics.errors import SceneError
from vrte.basics.views import view
from vrte.optics.crowding import INDEPENDENT, check_packing, pack
from vrte.optics.particles import HOST_ALLOWED, Particles, find_absorption, find_host_index
from vrte.optics.phase_matrix import PhaseMatrix, isotropic
from vrte.optics.refractive_index import Material, check_wavelength

CLEAR_HOST = 3.2e-5  # absorption of a medium [1/um] that an optical thickness alone leaves out: k = 1e-6 at 0.4 um
LARGEST_THICKNESS = 1e12  # optical thickness of a finite layer; beyond, a semi-infinite one is meant


@dataclass(frozen=True, eq=False, repr=False)
class Layer:
    """A homogeneous layer of particles.

    Parameters
    ----------
    phase_matrix : PhaseMatrix
        How its particles scatter.
    albedo : float
        Of single scattering, 0 to 1.
    thickness : float
        Optical, >= 0; ``math.inf`` is allowed for the last layer of a scene.
    host_index : float or None, optional
        Refractive index of the medium that its particles lie in; None: whatever the scene has there.

    Examples
    --------
    >>> import vrte
    >>> vrte.Layer(vrte.isotropic(), albedo=0.9, thickness=2.0).thickness
    2.0
    """

    phase_matrix: PhaseMatrix
    albedo: float
    thickness: float
    host_index: float | None = None

    def __post_init__(self) -> None:
        check_fields("layer: ", self, {"albedo": (0.0, 1.0, "between 0 and 1"), "host_index": HOST_ALLOWED})
        allowed = f"an optical thickness >= 0, at most {LARGEST_THICKNESS:g} or inf"
        object.__setattr__(self, "thickness", _check_extent("layer: thickness", self.thickness, allowed))

    def __repr__(self) -> str:
        return f"Layer({self.in_words})"

    @property
    def in_words(self) -> str:
        """Its optical thickness, albedo, and phase matrix."""
        return f"optical thickness {self.thickness:.6g}, albedo {self.albedo:.6g}, {self.phase_matrix.in_words}"

    def _repr_html_(self) -> str:
        return view(self, "_repr_html_")

    @staticmethod
    def of(
        particles: Particles,
        thickness: float | None = None,
        *,
        thickness_um: float | None = None,
        volume_fraction: float | None = None,
        packing: str = "independent",
    ) -> "Layer":
        """A layer of particles in their host medium, of an optical ``thickness`` (>= 0 or inf), or of a geometrical one
        [um] together with a volume fraction.

        ``volume_fraction`` is the part of the layer that is particles, between 0 and 1. Beside ``thickness`` it is
        needed where the host absorbs more than 3.2e-5 a micrometre (less is left out then) or the packing is not
        independent, else refused. ``packing`` says how their being close is accounted for: not at all ("independent");
        by the structure factor of hard spheres, all sizes of them ("percus-yevick"); or by an effective index of the
        medium around each sphere, Maxwell Garnett's ("effective-medium") or the coherent potential's
        ("coherent-potential"). Each has its domain (docs/how_to/particles.md), outside of which a PackingWarning says
        so: independence up to a volume fraction of 0.1, the others up to 0.3.

        What the host absorbs between the particles counts as extinction without scattering. The layer's ``host_index``
        is that of the host, whatever the packing: surfaces are of binder.
        """
        if (thickness is None) == (thickness_um is None) or (thickness_um is not None and volume_fraction is None):
            raise SceneError("layer: give either thickness, or thickness_um together with volume_fraction")
        check_packing(packing)
        needed = is_fraction_needed(particles, packing)
        if thickness is not None and needed != (volume_fraction is not None):
            why = "is needed beside thickness: the host absorbs, or packing asks for it"
            unused = "is not used beside thickness: the host is clear, and packing independent"
            raise SceneError.of("layer: volume_fraction", why if needed else unused)
        if volume_fraction is None:
            return Layer(particles.phase_matrix, particles.albedo, thickness or 0.0, particles.host_index)
        allowed = "above 0 and below 1"
        fraction = check_number("layer: volume_fraction", volume_fraction, 5e-324, 1.0 - 2.0**-53, allowed)
        packed = pack(particles, fraction, packing)
        number, absorbed = fraction / packed.volume_um3, (1.0 - fraction) * particles.host_absorption
        albedo = packed.albedo
        if absorbed:
            albedo = min(1.0, number * packed.scattering_um2 / (number * packed.extinction_um2 + absorbed))
        if thickness is None:
            allowed = f"a length in micrometres >= 0, at most {LARGEST_THICKNESS:g} or inf"
            length = _check_extent("layer: thickness_um", thickness_um, allowed)
            thickness = length * fraction / packed.volume_um3 * packed.extinction_um2
            thickness += length * absorbed if absorbed else 0.0
        return Layer(packed.phase_matrix, albedo, thickness, particles.host_index)

    @staticmethod
    def clear(thickness_um: float, host_index: Material, wavelength_um: float) -> "Layer":
        """A layer without particles, clear or tinted: thickness [um] and index n + ik with k up to 0.01 n at a
        wavelength in vacuum [um]; its optical thickness is 4 pi k thickness/wavelength."""
        host = find_host_index(host_index, check_wavelength(wavelength_um))
        allowed = "a length in micrometres >= 0"
        length = check_number("layer: thickness_um", thickness_um, 0.0, LARGEST_THICKNESS, allowed)
        return Layer(isotropic(), 0.0, length * find_absorption(host, wavelength_um), host.n)


def is_fraction_needed(particles: Particles, packing: str) -> bool:
    """Whether a layer of given optical thickness depends on its volume fraction: absorbing host, or packing."""
    return packing != INDEPENDENT or particles.host_absorption > CLEAR_HOST


def _check_extent(name: str, value: Any, allowed: str) -> float:
    """Raises SceneError unless a thickness is from 0 to LARGEST_THICKNESS, or infinite."""
    extent = check_number(name, value, 0.0, math.inf, allowed)
    return extent if math.isinf(extent) else check_number(name, value, 0.0, LARGEST_THICKNESS, allowed)
