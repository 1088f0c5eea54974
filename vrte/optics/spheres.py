"""Spheres: Mie amplitudes, scattering matrix, expansion, averaged over sizes and mixed over species."""

from dataclasses import dataclass

from vrte.optics.phase_matrix import PhaseMatrix


@dataclass(frozen=True, eq=False)
class Particles:
    """How one kind of particle scatters, averaged over its sizes: what a Layer needs to know of it.

    ``phase_matrix``; ``albedo`` (of single scattering) and ``asymmetry`` (g); ``extinction_um2``,
    ``scattering_um2`` and ``volume_um3``, the mean cross sections and volume of one particle; ``description``
    says in words what it is and where its refractive index comes from.
    """

    phase_matrix: PhaseMatrix
    albedo: float
    asymmetry: float
    extinction_um2: float
    scattering_um2: float
    volume_um3: float
    description: str = ""
