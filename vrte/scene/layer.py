"""A layer of particles."""

import math
import warnings
from dataclasses import dataclass
from typing import Any

from vrte.basics.arrays import check_number
from vrte.basics.errors import SceneError
from vrte.basics.views import view
from vrte.optics.phase_matrix import PhaseMatrix
from vrte.optics.spheres import HOST_ALLOWED, Particles

INDEPENDENT_UP_TO = 0.1  # volume fraction
LARGEST_THICKNESS = 1e12  # of a layer that ends; beyond, one without end is meant


class IndependentScatteringWarning(UserWarning):
    """The particles are so close that they no longer scatter independently of each other."""


@dataclass(frozen=True, eq=False, repr=False)
class Layer:
    """A homogeneous layer of particles.

    Parameters
    ----------
    phase_matrix : PhaseMatrix
    albedo : float
        Of single scattering, 0 to 1.
    thickness : float
        Optical, >= 0; ``math.inf`` is allowed for the last layer of a scene.
    host_index : float or None, optional
        Refractive index of the medium that its particles lie in; None: whatever the scene has there.

    Raises
    ------
    SceneError
        Naming the field.

    >>> from vrte.optics.phase_matrix import isotropic
    >>> Layer(isotropic(), albedo=0.9, thickness=2.0).thickness
    2.0
    """

    phase_matrix: PhaseMatrix
    albedo: float
    thickness: float
    host_index: float | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.phase_matrix, PhaseMatrix):
            raise SceneError(f"layer: phase_matrix must be a vrte.PhaseMatrix, not {type(self.phase_matrix).__name__}")
        object.__setattr__(self, "albedo", check_number("layer: albedo", self.albedo, 0.0, 1.0, "between 0 and 1"))
        allowed = f"an optical thickness >= 0, at most {LARGEST_THICKNESS:g} or inf"
        object.__setattr__(self, "thickness", _check_extent("layer: thickness", self.thickness, allowed))
        if self.host_index is not None:
            object.__setattr__(self, "host_index", check_number("layer: host_index", self.host_index, *HOST_ALLOWED))

    def __repr__(self) -> str:
        return f"Layer({self.in_words})"

    @property
    def in_words(self) -> str:
        """Its optical thickness, albedo, and phase matrix.

        >>> from vrte.optics.phase_matrix import isotropic
        >>> Layer(isotropic(), albedo=0.9, thickness=2.0).in_words
        'optical thickness 2, albedo 0.9, g 0, 1 term, scalar'
        """
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
    ) -> "Layer":
        """A layer of ``particles``: optical ``thickness``, or ``thickness_um`` and ``volume_fraction``.

        The volume fraction lies between 0 and 1; above 0.1 it warns (IndependentScatteringWarning). Raises
        SceneError for both or neither.

        >>> from vrte.optics.phase_matrix import rayleigh
        >>> dust = Particles(rayleigh(), 1.0, 0.0, extinction_um2=0.5, scattering_um2=0.5, volume_um3=0.1)
        >>> Layer.of(dust, thickness_um=20.0, volume_fraction=0.01).thickness
        1.0
        """
        if not isinstance(particles, Particles):
            raise SceneError(f"layer: particles must be vrte.spheres(...) or a mixture, not {type(particles).__name__}")
        geometric = thickness_um is not None or volume_fraction is not None
        if (thickness is not None) == geometric or (geometric and (thickness_um is None or volume_fraction is None)):
            raise SceneError("layer: give either thickness, or thickness_um together with volume_fraction")
        if thickness is None:
            thickness = _find_optical_thickness(particles, thickness_um, volume_fraction)
        return Layer(particles.phase_matrix, particles.albedo, thickness, particles.host_index)


def _check_extent(name: str, value: Any, allowed: str) -> float:
    """From 0 to LARGEST_THICKNESS, or infinite."""
    extent = check_number(name, value, 0.0, math.inf, allowed)
    return extent if math.isinf(extent) else check_number(name, value, 0.0, LARGEST_THICKNESS, allowed)


def _find_optical_thickness(particles: Particles, thickness_um: Any, volume_fraction: Any) -> float:
    """Extinction cross section times number density (volume fraction over particle volume) times length."""
    allowed = f"a length in micrometres >= 0, at most {LARGEST_THICKNESS:g} or inf"
    length = _check_extent("layer: thickness_um", thickness_um, allowed)
    fraction = check_number("layer: volume_fraction", volume_fraction, 5e-324, 1.0 - 2.0**-53, "above 0 and below 1")
    if fraction > INDEPENDENT_UP_TO:
        warnings.warn(
            f"layer: a volume_fraction of {fraction:g} is above {INDEPENDENT_UP_TO}: independent scattering, "
            "which is assumed here, is doubtful",
            IndependentScatteringWarning,
            stacklevel=3,
        )
    return length * fraction / particles.volume_um3 * particles.extinction_um2
