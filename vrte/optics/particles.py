"""How one kind of particle scatters, or several side by side: what a layer needs to know of them. A kind, spheres and
shapes alike, is checked, averaged over sizes, and made `Particles`."""

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, TypeVar

import numpy as np

from vrte.basics.arrays import Array, check_fields, check_number, check_vector, put_in_one_line, show_value
from vrte.basics.errors import SceneError, warn_user
from vrte.basics.views import view
from vrte.optics.phase_matrix import PhaseMatrix, check_mixture, mix, rayleigh
from vrte.optics.refractive_index import IndexTable, Material, RefractiveIndex, check_wavelength, refractive_index
from vrte.optics.size_distribution import Held, Monodisperse, SizeDistribution

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


make_stand_in_matrix = cache(rayleigh)
SAME_INDEX = 1e-9  # |m - 1| of a relative index m where the coefficients a_n, b_n are down to their rounding
ABSORBING_UP_TO = 0.01  # k over n of a host: amplitudes are wrong by m/(m - 1) times that where it is taken as clear
DOUBTFUL = 1e-2  # relative change of a cross section with the last radii, from which the user is warned
Average = TypeVar("Average")


class SizeAverageWarning(UserWarning):
    """The average over sizes still changes with the number of radii (sharp resonances of clear spheres)."""


@dataclass(frozen=True)
class ParticleKind:
    """Particles of one make-up in a medium: ``substances`` from the inside out, the wavelength in vacuum [um], and the
    distribution of radii [um]. Equal ones are packed once, so it is hashable."""

    substances: tuple[RefractiveIndex, ...]
    wavelength_um: float
    medium: RefractiveIndex
    size: SizeDistribution

    @property
    def words(self) -> str:
        """What it is called in messages."""
        return "spheres"

    @property
    def host(self) -> float:
        """The real refractive index around it."""
        return self.medium.n

    @property
    def host_absorption(self) -> float:
        """What the medium absorbs, 4 pi k/wavelength [1/um]."""
        return find_absorption(self.medium, self.wavelength_um)

    @property
    def relative_indices(self) -> tuple[complex, ...]:
        """Complex indices of the substances over that of the host."""
        return tuple(one.value / self.host for one in self.substances)

    @property
    def wavenumber(self) -> float:
        """k = 2 pi n/wavelength in the medium around it [1/um]."""
        return 2.0 * math.pi * self.host / self.wavelength_um

    @property
    def absorbs(self) -> bool:
        """Whether extinction is more than scattering."""
        return max(one.k for one in self.substances) > 0.0

    @property
    def where(self) -> str:
        """The light and the medium, in words."""
        return f"at {self.wavelength_um:g} um" + (f" in a host of index {self.host:g}" if self.host != 1.0 else "")

    def read_quadrature(self, count: int, moment: int) -> tuple[Array, Array]:
        """About ``count`` radii [um] and their weights, (n,) each, checked: a distribution may be anybody's."""
        where = f"{self.words}: size:"
        try:
            radii, weights = self.size.quadrature(count, moment)
        except Exception as reason:
            name = type(self.size).__name__
            raise SceneError(f"{where} {name}.quadrature failed with {type(reason).__name__}") from reason
        radii, weights = check_vector(f"{where} the radii", radii), check_vector(f"{where} the weights", weights)
        if radii.size != weights.size or radii[0] <= 0.0 or (np.diff(radii) < 0.0).any():
            raise SceneError(f"{where} the radii must increase from above 0, with one weight for each")
        if (weights < 0.0).any() or not weights.any():
            raise SceneError(f"{where} the weights must be >= 0 and not all zero")
        return radii, weights

    def average_sizes(
        self,
        average: Callable[[int, int], tuple[Average, Array, int]],
        moment: int,
        counts: tuple[int, int],
        converged: Array,
    ) -> tuple[Average, int, float]:
        """An average over sizes to ``converged`` sums (4,), its number of radii, last change of cross sections."""
        held = self.size if isinstance(self.size, Held) else None
        if held and (counts_taken := held.find(self.host)):
            found, _, used = average(*counts_taken)
            return found, used, 0.0
        count = max(counts[0], self.read_quadrature(2, moment)[0].size)
        most, changes = max(counts[1], 2 * count - 1), np.zeros(4)
        found, sums, used = average(count, moment)
        while used > 1 and count < most:
            before, count = sums, 2 * count - 1
            found, sums, used = average(count, moment)
            changes = np.abs(sums - before) / sums[[0, 1, 1, 3]]
            if np.all(changes <= converged):
                break
        if held:
            held.settled.append((count, moment))
        return found, used, float(changes[:2].max())

    def make_particles(
        self,
        phase_matrix: PhaseMatrix,
        extinction_um2: float,
        scattering_um2: float,
        volume_um3: float,
        description: str,
        change: float,
    ) -> Particles:
        """The particles of these means over sizes; warns where the last radii changed cross sections by over 1 %."""
        if change > DOUBTFUL:
            warn_user(f"{self.words}: not converged; {description}", SizeAverageWarning)
        if not self.absorbs:  # the two sums differ by rounding, and an albedo of 1 should be exactly that
            extinction_um2 = scattering_um2
        albedo, g = min(1.0, scattering_um2 / extinction_um2), phase_matrix.asymmetry
        bulk = albedo, g, extinction_um2, scattering_um2, volume_um3
        return Particles(phase_matrix, *bulk, description, self.host, self.host_absorption, self.list_balls())

    def make_stand_in(self) -> Particles:
        """Particles to go on with while a scene is only checked: Rayleigh's, of extinction and volume 1."""
        matrix, balls = make_stand_in_matrix(), self.list_balls()
        medium = self.host, self.host_absorption
        return Particles(matrix, 1.0, 0.0, 1.0, 1.0, 1.0, "", *medium, balls, stands_in=bool(balls))

    def list_balls(self) -> tuple[tuple["ParticleKind", float], ...]:
        """Itself with the number share 1, where a packing can take it: spheres."""
        return ((self, 1.0),)


def check_kind(
    words: str,
    materials: Mapping[str, Material],
    wavelength_um: Any,
    host_index: Material = 1.0,
    radius_um: Any = None,
    size: SizeDistribution | None = None,
) -> tuple[tuple[RefractiveIndex, ...], float, RefractiveIndex, SizeDistribution]:
    """Indices by name, the wavelength [um], the medium and sizes of a `ParticleKind`. Raises SceneError."""
    substances = tuple(find_named_index(name, material, wavelength_um) for name, material in materials.items())
    wavelength = check_wavelength(wavelength_um)
    medium = find_host_index(host_index, wavelength)
    if all(abs(one.value / medium.n - 1.0) < SAME_INDEX for one in substances):
        what = "the particles" if len(substances) == 1 else " and ".join(materials)
        why = f"have the refractive index of their host, {medium.n:g}, so they scatter nothing"
        raise SceneError(f"{words}: {what} {why}")
    if (radius_um is None) == (size is None):
        raise SceneError(f"{words}: give either radius_um or size")
    size = Monodisperse(radius_um) if size is None else size
    if isinstance(size, type) or not callable(getattr(size, "quadrature", None)):
        allowed = "a Lognormal, Gamma, Monodisperse or Tabulated"
        raise SceneError(f"{words}: size must be {allowed}, not {type(size).__name__}")
    return substances, wavelength, medium, size


def find_named_index(name: str, material: Material, wavelength_um: float) -> RefractiveIndex:
    """The index of a material, by the argument that it was given as. Raises SceneError, which names it."""
    try:
        return refractive_index(material, wavelength_um)
    except SceneError as error:
        if error.place != ("index",) or name == "index":
            raise
        raise SceneError(f"{name}{str(error).removeprefix('index')}", name) from error


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


def find_absorption(medium: RefractiveIndex, wavelength_um: float) -> float:
    """What a medium absorbs, 4 pi k/wavelength [1/um]."""
    return 4.0 * math.pi * medium.k / wavelength_um


def describe_index(index: RefractiveIndex) -> str:
    """n, k and their source, in words."""
    return f"index {index.n:.6g} + {index.k:.6g}i ({index.source})"


def describe_convergence(count: int, change: float, up_to: str = "") -> str:
    """The number of radii of an average and its convergence, in words; "" for one size."""
    return f", {count} radii{up_to}, cross sections converged to {max(change, 1e-16):.0e}" if count > 1 else ""


def make_check(make: Callable[..., ParticleKind]) -> Callable[..., Particles]:
    """A function that checks the arguments of ``make`` and returns Rayleigh's particles as a stand-in."""
    return lambda *given, **named: make(*given, **named).make_stand_in()


def refuse_size(what: str, most: float, size: float, radius_um: float) -> SceneError:
    """The error of particles that are too large, which suggests nanometres."""
    shown = f"a radius of {radius_um:.4g} um: did you mean nanometres, {radius_um / 1e3:.4g} um?"
    return SceneError(f"{what} must be at most {most:g}, not {size:.4g} ({shown})")
