"""Particles of one shape in random orientation, averaged over sizes."""

import math
from dataclasses import dataclass

import numpy as np

from vrte.basics import cost
from vrte.basics.arrays import Array
from vrte.basics.errors import AccuracyWarning, LongSolveWarning, SceneError, warn_user
from vrte.basics.running import count_usable_cpus
from vrte.optics.expansion import arrange_coefficients
from vrte.optics.particles import Particles
from vrte.optics.phase_matrix import PhaseMatrix
from vrte.optics.populations import DOUBTFUL, LEFT_OUT, SizeAverageWarning, check_quadrature
from vrte.optics.refractive_index import RefractiveIndex
from vrte.optics.size_distribution import Held, SizeDistribution
from vrte.optics.spheres import find_absorption
from vrte.optics.transition_matrix import (
    CYLINDER,
    FAIR,
    SPHEROID,
    Average,
    average_orientations,
    count_orders,
    find_reach,
)

WORDS = {SPHEROID: "spheroids", CYLINDER: "cylinders"}
SMALLEST_SIZE, LARGEST_SIZE = 1e-4, 50.0  # size parameters of the sphere of equal volume, and of that around a particle
TOO_SMALL = 1e-2 * SMALLEST_SIZE  # for the solver's Bessel functions; left out beside larger ones
TAIL = 1e-4  # of the sum of cross sections: what is held by larger sizes than those worked out
FEWEST_RADII, MOST_RADII = 17, 129
SETTLED = np.array([1e-4, 1e-4, 1e-4, 1e-3])  # relative: extinction, scattering, asymmetry, backscattering
REFUSED = 1e-2  # error of amplitudes, or of energy


@dataclass(frozen=True)
class Shape:
    """Particles of one ``kind``, SPHEROID or CYLINDER, and substance; ``size``: radii of spheres of equal volume."""

    kind: int
    index: RefractiveIndex
    wavelength_um: float
    host: RefractiveIndex
    aspect_ratio: float
    size: SizeDistribution

    @property
    def words(self) -> str:
        """What it is called."""
        return WORDS[self.kind]

    @property
    def wavenumber(self) -> float:
        """k = 2 pi n/wavelength in the medium around them [1/um]."""
        return 2.0 * math.pi * self.host.n / self.wavelength_um

    @property
    def relative_index(self) -> complex:
        """Relative to the host's."""
        return self.index.value / self.host.n

    @property
    def absorbs(self) -> bool:
        """Whether extinction is more than scattering."""
        return self.relative_index.imag > 0.0


def find_largest_radius(shape: Shape) -> float:
    """The radius beyond which sizes hold little; those scatter as it does, by their areas. Raises SceneError."""
    radii, weights = check_quadrature(shape.size, MOST_RADII, 4, shape.words)
    parameters = shape.wavenumber * radii
    if parameters[-1] < SMALLEST_SIZE:
        raise SceneError(
            f"{shape.words}: the size parameter 2 pi r/wavelength must be at least {SMALLEST_SIZE:g}, not "
            f"{parameters[-1]:.4g} (a radius of {radii[-1]:.4g} um)"
        )
    section = weights * radii**2 * np.minimum(2.0, parameters) ** 4  # small ones scatter as r^6
    beyond = np.cumsum(section[::-1])[::-1] - section  # what larger ones hold
    largest = float(radii[np.argmax(beyond <= TAIL * section.sum())])
    around = find_reach(shape.kind, shape.aspect_ratio) * shape.wavenumber * largest
    if around > LARGEST_SIZE:
        raise SceneError(
            f"{shape.words}: the size parameter 2 pi r/wavelength of the sphere around the largest must be at most "
            f"{LARGEST_SIZE:g}, not {around:.4g} (a radius of {largest:.4g} um: did you mean nanometres, "
            f"{largest / 1e3:.4g} um?)"
        )
    return largest


def average_shape(shape: Shape) -> Particles:
    """Particles averaged over orientations and sizes; says so where these have not settled."""
    largest = find_largest_radius(shape)
    mean, count, change = settle_sizes(shape, largest)
    extinction, scattering = mean.extinction / shape.wavenumber**2, mean.scattering / shape.wavenumber**2
    energy = abs(extinction / scattering - 1.0)
    description = describe_shape(shape, mean, None if shape.absorbs else energy)
    if count > 1:
        description += f", {count} radii up to {largest:.3g} um, cross sections settled to {max(change, 1e-16):.0e}"
    if not shape.absorbs:
        extinction = scattering
    if max(mean.error, 0.0 if shape.absorbs else energy) > FAIR:
        warn_user(f"{shape.words}: the null-field method hardly converges; {description}", AccuracyWarning)
    if change > DOUBTFUL:
        warn_user(f"{shape.words}: not settled; {description}", SizeAverageWarning)
    sums = mean.sums * ((2.0 * np.arange(len(mean.sums))[:, None] + 1.0) / mean.sums[0, 0])
    kept = 1 + int(np.flatnonzero(np.abs(sums).max(axis=1) > LEFT_OUT)[-1])
    phase_matrix = PhaseMatrix(*arrange_coefficients(sums[:kept]))
    radii, weights = check_quadrature(shape.size, MOST_RADII, 4, shape.words)
    return Particles(
        phase_matrix=phase_matrix,
        albedo=min(1.0, scattering / extinction),
        asymmetry=phase_matrix.asymmetry,
        extinction_um2=extinction,
        scattering_um2=scattering,
        volume_um3=float(weights @ (4.0 / 3.0 * math.pi * radii**3)),
        description=description,
        host_index=shape.host.n,
        host_absorption=find_absorption(shape.host, shape.wavelength_um),
    )


def settle_sizes(shape: Shape, largest: float) -> tuple[Average, int, float]:
    """The mean over as many radii as it takes, their number, and the last change of cross sections, relative."""
    known: dict[float, Average] = {}
    held = shape.size if isinstance(shape.size, Held) else None
    if held and (settled := held.find(shape.host.n)):
        return *add_sizes(shape, largest, settled[0], known), 0.0
    count = max(FEWEST_RADII, check_quadrature(shape.size, 2, 4, shape.words)[0].size)
    most = max(MOST_RADII, 2 * count - 1)
    mean, used = add_sizes(shape, largest, count, known)
    changes = np.zeros(4)
    while used > 1 and count < most:
        count = 2 * count - 1
        before = sum_bulk(mean)
        mean, used = add_sizes(shape, largest, count, known)
        sums = sum_bulk(mean)
        changes = np.abs(sums - before) / sums[[0, 1, 1, 3]]
        if np.all(changes <= SETTLED):
            break
    if held:
        held.keep(count, 4)
    return mean, used, float(changes[:2].max())


def add_sizes(shape: Shape, largest: float, count: int, known: dict[float, Average]) -> tuple[Average, int]:
    """The mean over ``count`` radii, and how many count; those not ``known`` are worked out and kept there."""
    radii, weights = check_quadrature(shape.size, count, 4, shape.words)
    counts = shape.wavenumber * radii >= TOO_SMALL
    radii, weights = radii[counts], weights[counts]
    solved = np.minimum(radii, largest)
    new = {radius for radius in solved.tolist() if radius not in known}
    warn_of_time(shape, new)
    for radius in sorted(new, reverse=True):  # what may fail comes first
        known[radius] = solve_size(shape, radius)
    parts = [known[radius] for radius in solved.tolist()]
    weights = weights * (radii / solved) ** 2  # of larger ones: their areas
    sums = np.zeros((max(len(part.sums) for part in parts), 6))
    for weight, part in zip(weights, parts, strict=True):
        sums[: len(part.sums)] += weight * part.sums
    numbers = [[part.extinction, part.scattering, part.scattering * part.error] for part in parts]
    extinction, scattering, errors = weights @ numbers
    return Average(float(extinction), float(scattering), sums, float(errors / scattering)), np.unique(solved).size


def warn_of_time(shape: Shape, radii: set[float]) -> None:
    """Says what will take long."""
    reach = find_reach(shape.kind, shape.aspect_ratio) * shape.wavenumber
    work = sum((1.2 * count_orders(reach * radius)) ** 6 for radius in radii)
    seconds = cost.SECONDS_OF_ORDERS * work / count_usable_cpus()
    if seconds > cost.LONG:
        told = f"this will take about {cost.say_time(seconds)}, most of it for the largest {shape.words}"
        warn_user(f"{told}; smaller or rounder ones take less", LongSolveWarning)


def solve_size(shape: Shape, radius_um: float) -> Average:
    """One size in random orientation. Raises SceneError where the null-field method does not converge."""
    size = shape.wavenumber * radius_um
    found = average_orientations(shape.kind, shape.aspect_ratio, size, shape.relative_index)
    lost = math.inf
    if found is not None:
        excess = found.scattering / found.extinction - 1.0
        lost = max(found.error, excess if shape.absorbs else abs(excess))
    if found is None or not lost <= REFUSED:
        raise SceneError(
            f"{shape.words}: the null-field method does not converge to {REFUSED:g} at an aspect ratio of "
            f"{shape.aspect_ratio:g}, a size parameter of {size:.4g} and an index {shape.relative_index.real:.4g} + "
            f"{shape.relative_index.imag:.3g}i relative to the host (a sphere of equal volume of {radius_um:.4g} um): "
            "smaller or rounder ones do"
        )
    return found


def sum_bulk(mean: Average) -> Array:
    """Extinction, scattering, asymmetry x scattering and backscattering, times k^2."""
    alternate = (-1.0) ** np.arange(len(mean.sums)) * (2.0 * np.arange(len(mean.sums)) + 1.0)
    asymmetry, back = 2.0 * math.pi * mean.sums[1, 0], 2.0 * math.pi * alternate @ mean.sums[:, 0]
    return np.array([mean.extinction, mean.scattering, asymmetry, back])


def describe_shape(shape: Shape, mean: Average, energy: float | None) -> str:
    """One line: what the particles are, where their index comes from, and how exact their matrices are."""
    where = f"at {shape.wavelength_um:g} um" + (f" in a host of index {shape.host.n:g}" if shape.host.n != 1.0 else "")
    text = (
        f"{shape.words} in random orientation, aspect ratio {shape.aspect_ratio:g}, volumes of {shape.size}, {where}, "
        f"index {shape.index.n:.6g} + {shape.index.k:.6g}i ({shape.index.source}), reciprocal to "
        f"{max(mean.error, 1e-16):.0e}"
    )
    return text if energy is None else f"{text}, energy kept to {max(energy, 1e-16):.0e}"
