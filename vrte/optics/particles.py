"""How one kind of particle scatters, or several side by side: what a layer needs to know of them."""

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from vrte.basics.arrays import check_fields, check_number, put_in_one_line
from vrte.basics.errors import SceneError
from vrte.basics.views import view
from vrte.optics.phase_matrix import PhaseMatrix, check_mixture, mix

if TYPE_CHECKING:
    from vrte.optics.particle_kind import ParticleKind

LARGEST_AREA = 1e100  # cross section [um2] and volume [um3] of a particle: products stay far below overflow
LARGEST_ABSORPTION = 1e6  # of a medium [1/um]
HOST_ALLOWED = 1e-3, 1e3, "a real refractive index from 0.001 to 1000"
ABOVE_ZERO = 1.0 / LARGEST_AREA, LARGEST_AREA, f"above 0 and at most {LARGEST_AREA:g}"
LIMITS = {  # of the numbers of particles: from, to, in words
    "albedo": (0.0, 1.0, "between 0 and 1"),
    "asymmetry": (-1.001, 1.001, "a mean cosine, between -1 and 1"),  # published tables are rounded
    "extinction_um2": ABOVE_ZERO,
    "scattering_um2": (0.0, LARGEST_AREA, f"between 0 and {LARGEST_AREA:g}"),
    "volume_um3": ABOVE_ZERO,
    "host_absorption": (0.0, LARGEST_ABSORPTION, f"between 0 and {LARGEST_ABSORPTION:g} a micrometre"),
    "host_index": HOST_ALLOWED,
}


@dataclass(frozen=True, eq=False, repr=False)
class Particles:
    """How one kind of particle scatters, averaged over its sizes: what a Layer needs to know of it.

    Parameters
    ----------
    phase_matrix : PhaseMatrix
        How they scatter, the mean over the particles weighted by what each scatters.
    albedo : float
        Of single scattering, 0 to 1.
    asymmetry : float
        g, the mean cosine of the scattering angle, -1 to 1.
    extinction_um2 : float
        Mean extinction cross section of one particle [um2].
    scattering_um2 : float
        Mean scattering cross section of one particle [um2].
    volume_um3 : float
        Mean volume of one particle [um3].
    description : str
        In words, what it is and where its refractive index comes from.
    host_index : float or None
        Refractive index of the medium that they lie in; None: any.
    host_absorption : float
        Of that medium [1/um], 4 pi k/wavelength: what it takes of the light between them.
    balls : tuple of (ParticleKind, float)
        What spheres among them are made of, with number shares; empty where that is not known, or not all are spheres.
    stands_in : bool
        Whether these are none, but something to go on with while a scene is only checked.

    Examples
    --------
    >>> import vrte
    >>> vrte.Particles(vrte.rayleigh(), 0.5, 0.0, extinction_um2=0.4, scattering_um2=0.2, volume_um3=0.1).albedo
    0.5
    """

    phase_matrix: PhaseMatrix
    albedo: float
    asymmetry: float
    extinction_um2: float
    scattering_um2: float
    volume_um3: float
    description: str = ""
    host_index: float | None = None
    host_absorption: float = 0.0
    balls: tuple[tuple["ParticleKind", float], ...] = ()
    stands_in: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.phase_matrix, PhaseMatrix):
            given = type(self.phase_matrix).__name__
            raise SceneError(f"particles: phase_matrix must be a vrte.PhaseMatrix, not {given}")
        check_fields("particles: ", self, LIMITS)

    def __repr__(self) -> str:
        return (
            f"Particles: {put_in_one_line(str(self.description), 300) or 'given by their phase matrix'}\n"
            f"  albedo {self.albedo:.6g}, {self.phase_matrix.in_words}\n"
            f"  extinction {self.extinction_um2:.5g} um2, scattering {self.scattering_um2:.5g} um2, "
            f"volume {self.volume_um3:.5g} um3"
        )

    def _repr_html_(self) -> str:
        return view(self, "_repr_html_")


def mixture(parts: Annotated[Sequence[tuple[Particles, float]], Any]) -> Particles:
    """Several kinds of particles side by side.

    Parameters
    ----------
    parts : sequence of (Particles, float)
        Each with its number fraction, of which only the ratios matter.

    Returns
    -------
    Particles
        Cross sections and volume are means over all particles; each kind's phase matrix counts by what it scatters.

    Examples
    --------
    >>> import vrte
    >>> small, large = (vrte.spheres(1.5, radius_um=r, wavelength_um=0.5) for r in (0.1, 0.3))
    >>> vrte.mixture([(small, 0.5), (large, 0.5)]).volume_um3 == (small.volume_um3 + large.volume_um3) / 2
    True
    """
    pairs = check_mixture(parts, Particles, "particles, number fraction", "vrte.mix mixes phase matrices")
    hosts = [kind.host_index for kind, _ in pairs if kind.host_index is not None]
    if hosts and max(hosts) != min(hosts):
        words = f"the host_index must not be {min(hosts):g} of one kind and {max(hosts):g} of another"
        raise SceneError(f"particles of a mixture lie in one medium: {words}")
    if len({kind.host_absorption for kind, _ in pairs if kind.host_index is not None}) > 1:
        raise SceneError("particles of a mixture lie in one medium: their host must absorb the same")
    shares = [check_number("number fraction", share, 0.0, sys.float_info.max, "a number >= 0") for _, share in pairs]
    largest = max(shares)
    if largest == 0.0:
        raise SceneError("number fraction: at least one kind of particle in a mixture needs more than 0")
    # of the largest: only ratios matter, and what is made of these neither overflows nor vanishes
    pairs = [(kind, share / largest) for (kind, _), share in zip(pairs, shares, strict=True)]
    total = math.fsum(share for _, share in pairs)

    extinction, scattering, volume = (
        math.fsum(getattr(kind, name) * share for kind, share in pairs) / total
        for name in ("extinction_um2", "scattering_um2", "volume_um3")
    )
    balls = tuple((ball, share * inner) for kind, share in pairs for ball, inner in kind.balls)
    stands_in = any(kind.stands_in for kind, _ in pairs)
    phase_matrix = pairs[0][0].phase_matrix
    if not stands_in:
        phase_matrix = mix([(kind.phase_matrix, share * kind.scattering_um2) for kind, share in pairs])
    return Particles(
        phase_matrix=phase_matrix,
        albedo=min(1.0, scattering / extinction),
        asymmetry=phase_matrix.asymmetry,
        extinction_um2=extinction,
        scattering_um2=scattering,
        volume_um3=volume,
        host_index=hosts[0] if hosts else None,
        host_absorption=max(kind.host_absorption for kind, _ in pairs),
        balls=balls if all(kind.balls for kind, _ in pairs) else (),
        stands_in=stands_in,
        description="; ".join(f"{share / total:.6g} of {kind.description}" for kind, share in pairs),
    )
