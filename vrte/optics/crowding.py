"""Particles close to each other: how they scatter where the light of neighbours interferes, by a named model each.

Hard spheres of many sizes lie side by side after Percus and Yevick. With n_i spheres of diameter d_i a volume,
xi_k = pi/6 sum n_i d_i^k, the matrix of structure factors is S(q) = [Q(q)^H Q(q)]^-1 with Baxter's factor

    Q_ij(q) = delta_ij - 2 pi sqrt(n_i n_j) int_s^r [a_i/2 (t^2 - r^2) + b_i (t - r)] exp(iqt) dt,
    s = (d_i - d_j)/2,  r = (d_i + d_j)/2,
    a_i = (1 - xi_3 + 3 d_i xi_2)/(1 - xi_3)^2,  b_i = -3/2 d_i^2 xi_2/(1 - xi_3)^2

Counted from s, the integral is exp(iq(d_i - d_j)/2) times two products of what belongs to i and what belongs to j: Q is
the identity less a matrix of rank 2, whose spherical Bessel functions lose no digits at small q (Baxter, J. Chem. Phys.
52, 4559 (1970); Vrij, J. Chem. Phys. 71, 3267 (1979)). The index that light meets in a host full of spheres is real,
that of the wave's phase: what is scattered out of it is the layer's affair.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from vrte._core import coated_sphere_coefficients
from vrte.basics.arrays import Array, show_value
from vrte.basics.errors import SceneError, warn_user
from vrte.optics.particles import Particles, mixture
from vrte.optics.phase_matrix import MOST_TERMS, PhaseMatrix
from vrte.optics.populations import (
    FEWEST_RADII,
    LEFT_OUT,
    Complex,
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
from vrte.optics.refractive_index import RefractiveIndex
from vrte.optics.spheres import average_ball, count_orders


def compute_structure_factor(q_um: ArrayLike, radius_um: float, volume_fraction: float) -> Array:
    """Structure factor S(q) (n,) of hard spheres of one radius [um] at q = 2 k sin(theta/2) [1/um] (n,)."""
    q = np.asarray(q_um, dtype=np.float64)
    alone = np.ones((1, 1, q.size), dtype=np.complex128)
    return np.abs(join_amplitudes(alone, q, np.array([radius_um]), np.ones(1), volume_fraction)[0, 0]) ** 2


def join_amplitudes(amplitudes: Complex, q: Array, radii: Array, weights: Array, volume_fraction: float) -> Complex:
    """Q^-H F of amplitudes F (kinds, sizes, angles), times roots of ``weights``: F_i S_ij F'_j* when multiplied."""
    start, end = find_factors(q, radii, weights, volume_fraction)
    # Woodbury: (1 - v* u^H)^-1 = 1 + v* (1 - u^H v*)^-1 u^H, with matrices of rank 2
    inner = np.eye(2) - np.einsum("kis,lis->skl", start.conj(), end.conj())
    shared = np.linalg.solve(inner, np.einsum("kis,fis->skf", start.conj(), amplitudes))
    return amplitudes + np.einsum("kis,skf->fis", end.conj(), shared)


def find_factors(q: Array, radii: Array, weights: Array, volume_fraction: float) -> tuple[Complex, Complex]:
    """u and v of Q_ij = delta_ij - sum over k of u_ki v_kj: each (2, sizes, angles)."""
    from scipy.special import spherical_jn

    diameter = 2.0 * radii[:, None]
    filling = math.pi / 6.0 * (weights @ diameter**3)
    root = np.sqrt(weights * volume_fraction / filling)[:, None]  # of n_i
    free = 1.0 - volume_fraction
    crowd = volume_fraction * (weights @ diameter**2) / (weights @ diameter**3)  # xi_2
    phase = q * radii[:, None]  # q d/2
    j0, j1, j2 = (spherical_jn(order, phase) for order in range(3))
    turn = root * np.exp(1j * phase)
    start = np.stack([turn * (0.5 * (1.0 + 3.0 * diameter * crowd / free) / free), turn * (0.5 * diameter / free)])
    shell = 2.0 * math.pi * root * radii[:, None] ** 2
    # int (s^2 - 1) exp(iys) ds = -4 j1(y)/y and int (s - 1) exp(iys) ds = 2i j1(y) - 2 j0(y), both from -1 to 1
    end = np.stack([shell * radii[:, None] * (-4.0 / 3.0 * (j0 + j2)), shell * (2j * j1 - 2.0 * j0)])
    return start, end


Kinds = Sequence[tuple[Any, float]]  # balls with number shares, in one host at one wavelength
FEW = 1e-3  # volume fraction up to which an index rises in proportion to it
STEP, STEP_OF_PHASE, FURTHEST = 0.01, 0.1, 2.0  # of the host's index, in search of another; of a sphere; a factor


def list_sizes(kinds: Kinds) -> tuple[Array, Array, Array]:
    """Radii [um] of spheres of all kinds, their number shares, and the permittivity of each: all (sizes,)."""
    rows = []
    for ball, share in kinds:
        radii, weights = ball.read_quadrature(FEWEST_RADII, 6)
        rows.append((radii, share * weights, [ball.find_permittivity(float(radius)) for radius in radii]))
    radii, weights, permittivities = map(np.concatenate, zip(*rows, strict=True))
    return radii, weights, permittivities


def find_maxwell_garnett_index(kinds: Kinds, volume_fraction: float) -> float:
    """Maxwell Garnett's index of a host with spheres much smaller than the wavelength: (e - e_h)/(e + 2 e_h) = sum over
    kinds of f_k (e_k - e_h)/(e_k + 2 e_h). Source: Bohren and Huffman (1983), section 8.5."""
    radii, weights, permittivities = list_sizes(kinds)
    host = kinds[0][0].host ** 2
    volumes = weights * radii**3
    dipoles = volume_fraction * complex(volumes @ ((permittivities - host) / (permittivities + 2.0 * host)))
    dipoles /= float(volumes.sum())
    return float(np.sqrt(host * (1.0 + 2.0 * dipoles) / (1.0 - dipoles)).real)


def find_coherent_potential_index(kinds: Kinds, volume_fraction: float) -> float:
    """The index of the coherent potential: around it, spheres in shells of host do not change the phase of light.

    A sphere of radius r stands in a shell of host up to r volume_fraction^(-1/3), in the medium that is looked for: the
    imaginary part of S(0), summed over sizes, is zero there. Small spheres have Maxwell Garnett's index, few ones
    van de Hulst's. The solution is the first one from the host's index on. Coated spheres count as homogeneous ones of
    the same static polarizability. Raises SceneError where there is no solution up to a factor of 2.

    Source: Soukoulis, Datta and Economou, Phys. Rev. B 49, 3800 (1994), of which the condition on the phase is taken.
    """
    from scipy.optimize import brentq

    radii, weights, permittivities = list_sizes(kinds)
    host, wavelength = kinds[0][0].host, kinds[0][0].wavelength_um
    if volume_fraction < FEW:
        return host + volume_fraction / FEW * (find_coherent_potential_index(kinds, FEW) - host)
    substances, shells = np.sqrt(permittivities), radii * volume_fraction ** (-1.0 / 3.0)
    most = count_orders(2.0 * math.pi * FURTHEST * host / wavelength * float(shells.max()) * (1.0 + STEP))
    twice = np.arange(3.0, 2.0 * most + 2.0, 2.0)  # 2 n + 1

    def advance(index: float) -> float:
        """The phase that light gains by the spheres, with any positive factor."""
        wavenumber = 2.0 * math.pi * index / wavelength
        sizes = wavenumber * radii, wavenumber * shells
        orders = np.array([*map(count_orders, sizes[1].tolist())], np.int32)
        indices = np.array([substances, np.full(radii.size, host)], np.complex128) / index
        found = coated_sphere_coefficients(indices[0], indices[1], *sizes, orders)
        gained = -weights @ (found.imag @ twice[: found.shape[2]]).sum(axis=1)  # Im S(0)
        return float(gained) / wavenumber**3

    phase = 2.0 * math.pi * host / wavelength * float(weights @ shells**3) / float(weights @ shells**2)
    before, sign = host, math.copysign(1.0, advance(host))
    step = sign * host * min(STEP, STEP_OF_PHASE / phase)
    while host / FURTHEST < before < host * FURTHEST:
        if sign * advance(before + step) <= 0.0:
            return float(brentq(advance, before, before + step, xtol=1e-12, rtol=1e-12))
        before += step
    words = "has no solution for these spheres at this volume fraction"
    raise SceneError.of("layer: packing", f'"coherent-potential" {words}; "effective-medium" always has')


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
    """The phase matrix and the integral of F11, nodes doubled until terms left out are below 1e-12."""
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
    medium = RefractiveIndex(find_index(kinds, volume_fraction), 0.0, "of host and spheres together")
    alone = mixture([(average_ball(replace(ball, medium=medium)), share) for ball, share in kinds])
    return replace(
        alone,
        host_index=particles.host_index,
        host_absorption=particles.host_absorption,
        balls=particles.balls,
        description=f"{alone.description}: what {volume_fraction:g} of the volume make of their medium",
    )


class Packing(NamedTuple):
    """A model of crowding: words, domain, how it scatters, what it is ``meant`` for, its densest volume fraction."""

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
