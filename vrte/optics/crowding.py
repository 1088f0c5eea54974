"""Particles close to each other: how they scatter where the light of neighbours interferes, by a named model each."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from vrte.basics.arrays import Array, show_value
from vrte.basics.errors import SceneError, warn_user
from vrte.optics.effective_medium import Kinds, find_coherent_potential_index, find_maxwell_garnett_index, list_sizes
from vrte.optics.hard_spheres import join_amplitudes
from vrte.optics.particles import Particles, mixture
from vrte.optics.phase_matrix import MOST_TERMS, PhaseMatrix
from vrte.optics.populations import (
    LEFT_OUT,
    Population,
    average_population,
    compute_angular_functions,
    count_terms,
    expand_elements,
    find_amplitudes,
    make_phase_matrix,
    stack_rows,
    sum_amplitudes,
    sum_bulk,
)
from vrte.optics.spheres import average_ball

INDEPENDENT, PERCUS_YEVICK = "independent", "percus-yevick"
EFFECTIVE_MEDIUM, COHERENT_POTENTIAL = "effective-medium", "coherent-potential"
CROWDED_UP_TO = 0.3  # volume fraction of the models of crowding
RANDOM_CLOSE_PACKING = 0.64  # volume fraction: hard spheres of one size fill no more at random
# |m - 1|, index relative to the host: at 30 % by volume of m = 1.35 the wavenumber between the spheres, which the
# structure factor takes for the host's, is by Maxwell Garnett's rule a tenth larger
SOFT = 0.35
# phase shift of light through a sphere, 2 k r |m - 1|: up to here and m = 1.8, Maxwell Garnett's index and the coherent
# potential's lead to transport lengths within a quarter of each other
SHIFTED = 3.0
MORE_TERMS = 2  # times those of one sphere to begin with
ROUNDED = 1e-16  # of a coefficient over (2 l + 1) n^2, n orders: rounding of the cosine near a forward peak leaves less


class PackingWarning(UserWarning):
    """Particles lie closer, or are larger or of a higher index, than the model of their packing allows."""


class IndependentScatteringWarning(PackingWarning):
    """The particles are so close that they no longer scatter independently of each other."""


def find_contrast(kinds: Kinds) -> float:
    """The largest |m - 1| of spheres, m their index relative to the host."""
    return float(np.abs(np.sqrt(list_sizes(kinds)[2]) / kinds[0][0].host - 1.0).max())


def find_phase_shift(kinds: Kinds) -> float:
    """The phase shift 2 k r |m - 1| of the mean sphere."""
    radii, weights, permittivities = list_sizes(kinds)
    contrast = np.abs(np.sqrt(permittivities) / kinds[0][0].host - 1.0)
    return 2.0 * kinds[0][0].wavenumber * float(weights @ (radii**3 * contrast)) / float(weights @ radii**2)


def scatter_as_hard_spheres(particles: Particles, volume_fraction: float) -> Particles:
    """Percus-Yevick's hard spheres in the host: amplitudes of all sizes interfere, F11 = 1/2 sum over pairs of sqrt(n_i
    n_j) (S1_i S1_j* + S2_i S2_j*) S_ij(q), q = 2 k sin(theta/2); absorption stays each one's own."""
    kinds = _normalise_shares(particles)
    populations = [average_population(ball)[0] for ball, _ in kinds]
    factor = 2.0 * math.pi / kinds[0][0].wavenumber ** 2
    absorbed = 0.0
    for (ball, share), population in zip(kinds, populations, strict=True):
        extinction, scattering, _, _ = sum_bulk(population)
        absorbed += share * factor * max(0.0, extinction - scattering) if ball.absorbs else 0.0
    everything = _join_populations(populations, [share for _, share in kinds])
    phase_matrix, integral = _expand_until_converged(everything, volume_fraction)
    scattering = factor * integral
    return replace(
        particles,
        phase_matrix=phase_matrix,
        albedo=min(1.0, scattering / (scattering + absorbed)),
        asymmetry=phase_matrix.asymmetry,
        extinction_um2=scattering + absorbed,
        scattering_um2=scattering,
        volume_um3=4.0 / 3.0 * math.pi * float(everything.weights @ everything.radii**3),
        description=f"{particles.description}, {PERCUS_YEVICK} at {volume_fraction:g} of the volume",
    )


def _expand_until_converged(population: Population, volume_fraction: float) -> tuple[PhaseMatrix, float]:
    """The phase matrix and the integral of F11, with twice as many nodes until the terms left out are below 1e-12, or
    what rounding leaves of them: S(q) is no polynomial."""
    orders, root = population.a.shape[1], np.sqrt(population.weights)[:, None]
    wavenumber, one_each = float(population.sizes[0] / population.radii[0]), np.ones(population.radii.size)

    def find_elements(cosine: Array) -> Array:
        alone = find_amplitudes(population.a, population.b, compute_angular_functions(orders, cosine))
        q = wavenumber * np.sqrt(2.0 * (1.0 - cosine))  # 2 k sin(theta/2)
        crowd = q, population.radii, population.weights, volume_fraction
        total, difference = join_amplitudes(np.stack(alone) * root, *crowd)
        return sum_amplitudes(total, difference, one_each)

    terms = MORE_TERMS * (2 * orders + 1)
    while terms <= MOST_TERMS:
        sums, integral = expand_elements(find_elements, terms)
        kept = count_terms(sums, np.maximum(LEFT_OUT, ROUNDED * (orders + 4) ** 2 * (2.0 * np.arange(terms) + 1.0)))
        if kept <= 3 * terms // 4:
            return make_phase_matrix(sums[:kept]), integral
        terms *= 2
    words = f"would take more than {MOST_TERMS} terms for spheres so large and so close"
    raise SceneError(f'layer: packing="{PERCUS_YEVICK}" {words}', "packing")


def _join_populations(populations: Sequence[Population], shares: Sequence[float]) -> Population:
    """Spheres of several kinds as one population; the sum of shares is 1."""
    weights = np.concatenate([share * one.weights for one, share in zip(populations, shares, strict=True)])
    radii, sizes = (np.concatenate([getattr(one, name) for one in populations]) for name in ("radii", "sizes"))
    names = "a", "b", "cross_sections"
    return Population(
        radii, sizes, weights, *(stack_rows([getattr(one, name) for one in populations]) for name in names)
    )


def scatter_in_medium(
    particles: Particles, volume_fraction: float, find_index: Callable[[Kinds, float], float]
) -> Particles:
    """Each sphere alone, in a medium whose index is that of host and spheres together."""
    kinds = _normalise_shares(particles)
    index = find_index(kinds, volume_fraction)
    alone = mixture([(average_ball(ball.in_host(index)), share) for ball, share in kinds])
    return replace(
        alone,
        host_index=particles.host_index,
        host_absorption=particles.host_absorption,
        balls=particles.balls,
        description=f"{alone.description}: what {volume_fraction:g} of the volume make of their medium",
    )


class Packing(NamedTuple):
    """A model of crowding: its ``words``; the volume fraction above which it warns; particles at a volume fraction as
    they scatter there; what spheres it is ``meant`` for, by a number of them and the most that it may be; the largest
    volume fraction that there is."""

    words: str
    up_to: float
    scatter: Callable[[Particles, float], Particles]
    meant: str = ""
    find: Callable[[Kinds], float] = lambda kinds: 0.0
    most: float = math.inf
    densest: float = 1.0


PACKINGS: dict[str, Packing] = {
    INDEPENDENT: Packing("each as if it were alone: up to 10 % by volume", 0.1, lambda particles, _: particles),
    PERCUS_YEVICK: Packing(
        "hard spheres whose light interferes (Percus-Yevick): nearly the host's index, up to 30 %",
        CROWDED_UP_TO,
        scatter_as_hard_spheres,
        "meant for spheres of nearly their host's index: |m - 1|",
        find_contrast,
        SOFT,
        RANDOM_CLOSE_PACKING,
    ),
    EFFECTIVE_MEDIUM: Packing(
        "alone in a medium of an effective index (Maxwell Garnett): much smaller than the wavelength, up to 30 %",
        CROWDED_UP_TO,
        partial(scatter_in_medium, find_index=find_maxwell_garnett_index),
        "for small spheres: the phase shift 2 k r |m - 1|",
        find_phase_shift,
        SHIFTED,
    ),
    COHERENT_POTENTIAL: Packing(
        "alone in a medium in which they do not change the phase of light (coherent potential): any index, up to 30 %",
        CROWDED_UP_TO,
        partial(scatter_in_medium, find_index=find_coherent_potential_index),
    ),
}


def check_packing(packing: Any) -> str:
    """One of PACKINGS. Raises SceneError."""
    if not (isinstance(packing, str) and packing in PACKINGS):
        allowed = " or ".join(f'"{name}"' for name in PACKINGS)
        raise SceneError.of("layer: packing", f"must be {allowed}, not {show_value(packing)}")
    return packing


def pack(particles: Particles, volume_fraction: float, packing: str) -> Particles:
    """The particles as they scatter where they fill a part of the volume. Raises SceneError for what it cannot do."""
    needed = ""
    if packing != INDEPENDENT and not (particles.balls or particles.stands_in):
        needed = "spheres of known substance and size, as from vrte.spheres: other particles take"
        needed += f' packing="{INDEPENDENT}"'
    elif packing != INDEPENDENT and len({ball.wavelength_um for ball, _ in particles.balls}) > 1:
        needed = "particles at one wavelength"
    if needed:
        raise SceneError(f'layer: packing="{packing}" needs {needed}', "packing")
    model = PACKINGS[packing]
    if volume_fraction > model.densest:
        words = f'at most {model.densest} for packing="{packing}", not {volume_fraction:g}'
        raise SceneError.of("layer: volume_fraction", f"must be {words}: hard spheres fill no more at random")
    if particles.balls and (found := model.find(particles.balls)) > model.most:
        more = f'up to {model.most:g} allowed; packing="{COHERENT_POTENTIAL}" takes more'
        _warn(f'packing="{packing}" is {model.meant} is {found:.3g} here, and {more}')
    if volume_fraction > model.up_to:
        words = f"a volume_fraction of {volume_fraction:g} is above {model.up_to}"
        if packing == INDEPENDENT:
            others = " or ".join(f'packing="{name}"' for name in PACKINGS if name != INDEPENDENT)
            words += f": independent scattering, which is assumed here, is doubtful; {others} accounts for neighbours"
            _warn(words, IndependentScatteringWarning)
        else:
            _warn(f'{words}, where packing="{packing}" ends')
    if particles.stands_in or packing == INDEPENDENT:
        return particles
    return _scatter_remembered(_Crowd(particles.balls, particles.host_absorption, particles), volume_fraction, packing)


@dataclass(frozen=True)
class _Crowd:
    """Particles; equal where all that a packing depends on is equal."""

    balls: tuple[tuple[Any, float], ...]
    host_absorption: float
    particles: Particles = field(compare=False)


@lru_cache(maxsize=64)  # the scenes of a sweep over a thickness have the same crowd
def _scatter_remembered(crowd: _Crowd, volume_fraction: float, packing: str) -> Particles:
    return PACKINGS[packing].scatter(crowd.particles, volume_fraction)


def _normalise_shares(particles: Particles) -> list[tuple[Any, float]]:
    """What spheres are made of, with number shares that sum to 1."""
    total = math.fsum(share for _, share in particles.balls)
    return [(ball, share / total) for ball, share in particles.balls if share > 0.0]


def _warn(words: str, category: type[Warning] = PackingWarning) -> None:
    """A warning of this category that begins with "layer: ", at the line of the caller outside vrte."""
    warn_user(f"layer: {words}", category)
