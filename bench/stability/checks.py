"""What is checked of a case: each check gives a number and the limit that the number has to keep.

Light is compared relative to the largest I over all directions at the same depth, in the Fourier orders that the
case looks at. ``c`` is what the answer changes by when a number of the scene moves by one unit in the last place:
from the oracle's table, or estimated where there is no oracle.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from bench.stability.cases import BEAM, Case
from bench.stability.oracle import OracleAnswer
from bench.stability.solving import (
    FEW,
    SECOND_DIRECTION,
    FewOrders,
    Options,
    choose_few_azimuths,
    cut_layers_otherwise,
    estimate_seconds,
    is_whole,
    make_azimuths,
    solve_brdf,
    solve_few_orders,
    solve_field,
)
from vrte.basics.arrays import Array
from vrte.basics.errors import AccuracyError
from vrte.discrete_ordinates.orders.routes import OTHER
from vrte.results.brdf import Brdf
from vrte.results.field import Field

TARGET = 1e-10
ENERGY = 1e-13
SURFACE_ENERGY = 1e-12  # light comes back to the same place n^2 times as often
TRANSMITTED = 1e-8
UNIT = 2.0**-53  # the last place of a number near 1, relative
NOTHING = 1e-290  # light fainter than this, for a beam of 1 W m-2, is none
SIGN = np.array([1.0, 1.0, 1.0, -1.0])  # Q of the reciprocity relation
MIRROR = np.array([1.0, 1.0, -1.0, -1.0])  # D of the mirror symmetry
SPLIT_UP_TO = 10.0  # seconds that a second solve of few orders may be expected to take


@dataclass(frozen=True)
class Check:
    """A number and the most it may be; ``counts`` is False where the number is only told.

    ``kind``: "oracle", "energy", "consistency" or "other", the table's columns.
    """

    name: str
    value: float
    limit: float
    counts: bool = True
    kind: str = "consistency"

    @property
    def holds(self) -> bool:
        """Whether the limit is kept; NaN keeps none."""
        return not self.counts or self.value <= self.limit


@dataclass(frozen=True)
class Examined:
    """The checks of a case, its c, and the oracle's part in it: "yes" or why there is none."""

    checks: list[Check]
    c: float
    oracle: str


def examine_case(case: Case, oracle: OracleAnswer | str, options: Options) -> Examined:
    """Solves the case and checks the answer. ``oracle``: its answer, whose numbers are then solved, or a word that says
    why there is none."""
    answer = oracle if isinstance(oracle, OracleAnswer) else None
    case = case if answer is None else answer.case
    c = max(answer.c.values()) if answer is not None else estimate_c(case)
    limit = max(TARGET, 10.0 * c)
    if is_whole(case):
        checks = [*check_all_orders(case, answer, options, limit)]
    else:
        checks = [*check_few_orders(case, options, limit)]
    return Examined(checks, c, "yes" if answer is not None else str(oracle))


def check_all_orders(case: Case, oracle: OracleAnswer | None, options: Options, limit: float) -> Iterator[Check]:
    """Every check there is, on all Fourier orders."""
    phi = make_azimuths(case)
    few = choose_few_azimuths(phi)
    field = solve_field(case, case.scene, phi, options.algorithm, options.threads)
    brdf = solve_brdf(case, options, phi[few])
    other = solve_field(case, cut_layers_otherwise(case), phi[few], options.algorithm, options.threads)
    yield check_finite(field.stokes, field.flux_up, field.flux_down, brdf.mueller, brdf.transmission, other.stokes)
    if oracle is not None:
        yield from check_against_oracle(case, solve_in_oracle_light(case, field, options), oracle)
    # the BRDF times the irradiance is the radiance at the top, the BTDF times the irradiance that at the bottom
    lit = case.mu0 * np.array(case.beam)
    yield Check(
        "BRDF and radiance",
        measure_relative_difference((brdf.mueller[0] @ lit)[None], select_outgoing_light(field, few)[0]),
        limit,
    )
    if brdf.transmission is not None:
        places = [brdf.mu_o.tolist().index(-mu) for mu in case.mu[case.mu < 0.0]]
        below = (brdf.transmission[0, places] @ lit)[None]
        yield Check(
            "BTDF and radiance", measure_relative_difference(below, select_outgoing_light(field, few)[1]), limit
        )
    yield Check("layer cut otherwise", measure_relative_difference(other.stokes, field.stokes[:, :, few]), limit)
    yield Check("layer cut otherwise, fluxes", measure_flux_gap(other, field), limit)
    alone = oracle is None and not case.is_thin
    yield from check_other_algorithm(case, field, phi[few], few, options, limit, alone)
    net = field.flux_down + field.direct - field.flux_up - (0.0 if field.direct_up is None else field.direct_up)
    for part, where in zip(np.split(net, net.size // case.tau.size), ("", " on lower sides"), strict=False):
        yield from check_energy(case, part, field.direct[0], where)
    yield from check_closed_scene(case, brdf)
    yield Check("reciprocity", measure_reciprocity_gap(brdf), limit)
    if case.media and case.base is None and brdf.transmission is not None:
        from_below = solve_brdf(case, options, phi[few], "bottom")
        yield Check("reciprocity of what gets through", measure_passing_gap(case, brdf, from_below), limit)
    yield Check("mirror symmetry", measure_mirror_gap(brdf), TARGET)
    if brdf.specular is not None:
        yield Check("physical beams", measure_unphysical_matrix(brdf.specular[:, None]), TARGET, kind="other")
    yield Check("physical BRDF", measure_unphysical_matrix(brdf.mueller), TARGET, case.resolved, "other")
    yield Check("physical light", measure_unphysical_light(field.stokes), TARGET, case.resolved, "other")


def solve_in_oracle_light(case: Case, field: Field, options: Options) -> Field:
    """The field of the beam that the oracle's table is for."""
    if case.beam == BEAM:
        return field
    return solve_field(replace(case, beam=BEAM), case.scene, field.phi, options.algorithm, options.threads)


def check_other_algorithm(
    case: Case, field: Field, phi: Array, few: Array, options: Options, limit: float, counts: bool
) -> Iterator[Check]:
    """The field by the other algorithm, unless that one says that it cannot."""
    algorithm = OTHER[field.diagnostics["algorithm"]]
    try:
        other = solve_field(case, case.scene, phi, algorithm, options.threads)
    except AccuracyError:
        return
    yield Check("both algorithms", measure_relative_difference(other.stokes, field.stokes[:, :, few]), limit, counts)
    yield Check("both algorithms, fluxes", measure_flux_gap(other, field), limit, counts)


def check_few_orders(case: Case, options: Options, limit: float) -> Iterator[Check]:
    """What can be said from a few Fourier orders of multiply scattered light."""
    found = solve_few_orders(case, case.scene, options.algorithm, options.threads)
    yield check_finite(found.kernels, found.flux_up, found.flux_down)
    if estimate_seconds(case, FEW) <= SPLIT_UP_TO:
        other = solve_few_orders(case, cut_layers_otherwise(case), options.algorithm, options.threads)
        yield from compare_few_orders(case, "layer cut otherwise", other, found, limit, True)
        other = solve_few_orders(case, case.scene, OTHER[found.algorithm], options.threads)
        if other.algorithm != found.algorithm:  # the one asked for vouches for its answer
            yield from compare_few_orders(case, "both algorithms", other, found, limit, not case.is_thin)
    for beam, mu0 in enumerate((case.mu0, SECOND_DIRECTION)):
        direct = mu0 * np.exp(-case.tau / mu0)
        yield from check_energy(
            case, found.flux_down[:, beam, 0] + direct - found.flux_up[:, beam, 0], mu0, f" {beam + 1}"
        )
    yield Check("reciprocity", measure_order_reciprocity_gap(case, found), limit)


def compare_few_orders(
    case: Case, name: str, other: FewOrders, found: FewOrders, limit: float, counts: bool
) -> Iterator[Check]:
    """Two answers, depth by depth: radiance over the largest there, no less than the mean; fluxes over all light."""
    sun = np.array([case.mu0, SECOND_DIRECTION])
    beam = sun * np.exp(-case.tau[:, None] / sun)
    diffuse = np.abs(found.flux_up[..., 0]) + np.abs(found.flux_down[..., 0])
    kernels, others = (np.moveaxis(each.kernels, 1, 0) for each in (found, other))  # the depth first
    size = np.maximum(np.abs(kernels[..., 0]).max(axis=(1, 2, 3, 4)), diffuse.max(axis=1) / math.pi)
    gap = np.abs(others - kernels).max(axis=(1, 2, 3, 4, 5))
    yield Check(name, find_largest(gap / np.maximum(size, NOTHING)), limit, counts)
    gap = np.maximum(np.abs(other.flux_up - found.flux_up), np.abs(other.flux_down - found.flux_down)).max(axis=(1, 2))
    yield Check(f"{name}, fluxes", find_largest(gap / np.maximum((diffuse + beam).max(axis=1), NOTHING)), limit, counts)


def estimate_c(case: Case) -> float:
    """The last place of omega or thickness times the scatterings of light that crosses the scene.

    That is thickness times the smaller of thickness and 1/k, k = sqrt(3 (1 - omega)) the rate at which diffuse light
    dies out, in the layer that absorbs least.

    >>> from bench.cases import Slab
    >>> f"{estimate_c(Case('a', 8, (Slab('rayleigh', 1.0, 1e6),))):.0e}"
    '1e-04'
    """
    lost = min(1.0 - slab.albedo for slab in case.slabs)
    depth = min(case.thickness, 1.0 / math.sqrt(3.0 * max(lost, UNIT)))
    through = case.thickness if math.isfinite(case.thickness) else 1.0
    return UNIT * (1.0 + through) * (1.0 + depth)


def check_finite(*arrays: Array | None) -> Check:
    """How many numbers are not finite."""
    return Check("not finite", float(sum((~np.isfinite(a)).sum() for a in arrays if a is not None)), 0.0, kind="other")


def measure_relative_difference(got: Array, right: Array) -> float:
    """The largest difference at a depth over the largest I of ``right`` there; both (tau, ..., 4), I first."""
    axes = tuple(range(1, right.ndim))
    size = np.abs(right[..., 0]).max(axis=axes[:-1])
    return find_largest(np.abs(got - right).max(axis=axes) / np.maximum(size, NOTHING))


def find_largest(values: Array) -> float:
    """The largest, NaN where one is NaN; 0 of none."""
    return float(values.max()) if values.size else 0.0


def compute_fourier_orders(case: Case, stokes: Array, orders: tuple[int, ...]) -> dict[int, Array]:
    """The part of each order that incident (I, Q) and (U, V) make: m -> (2, tau, mu, 4).

    ``stokes`` (tau, mu, phi, 4) at equal steps of azimuth. The two are told apart by parity, (1:6).
    """
    steps = stokes.shape[2]
    found = {}
    for m in orders:
        turn = 2.0 * math.pi * ((m * np.arange(steps)) % steps) / steps
        even, odd = (np.einsum("p,tkps->tks", wave(turn) / steps, stokes) for wave in (np.cos, np.sin))
        first = np.concatenate([even[..., :2], odd[..., 2:]], axis=-1)
        second = np.concatenate([-odd[..., :2], even[..., 2:]], axis=-1)
        found[m] = np.stack([first, second])
    return found


def check_against_oracle(case: Case, field: Field, oracle: OracleAnswer) -> Iterator[Check]:
    """Light up, down and inside and the fluxes against ball arithmetic."""
    right = oracle.orders
    got = compute_fourier_orders(case, field.stokes, tuple(right))
    size = np.max([np.abs(values[..., 0]).max(axis=(0, 2)) for values in right.values()], axis=0)
    last = len(case.tau) - 1 if math.isfinite(case.thickness) else len(case.tau)
    for m, values in right.items():
        error = np.abs(got[m] - values).max(axis=(0, 3)) / np.maximum(size, NOTHING)[:, None]
        limit = max(TARGET, 10.0 * oracle.c[m])
        yield Check(f"order {m}, up at the top", find_largest(error[:1, case.mu > 0.0]), limit, kind="oracle")
        yield Check(f"order {m}, down at the bottom", find_largest(error[last:, case.mu < 0.0]), limit, kind="oracle")
        rest = error.copy()
        rest[:1, case.mu > 0.0] = rest[last:, case.mu < 0.0] = 0.0
        yield Check(f"order {m}, inside", find_largest(rest), limit, kind="oracle")
    yield from check_flux_against_oracle(case, field, oracle)


def check_flux_against_oracle(case: Case, field: Field, oracle: OracleAnswer) -> Iterator[Check]:
    """Fluxes, relative to the larger of the two at the same depth; the transmitted one, relative to itself."""
    got, right = np.stack([field.flux_up, field.flux_down]), np.stack([oracle.flux_up, oracle.flux_down])
    error = np.abs(got - right).max(axis=0) / np.maximum(np.abs(right).max(axis=0), NOTHING)
    yield Check("fluxes", find_largest(error), max(TARGET, 10.0 * oracle.c[0]), kind="oracle")
    white = all(slab.albedo == 1.0 for slab in case.slabs)
    if white and case.base_kind == "black" and 0.0 < case.thickness <= 1e6:
        through = oracle.flux_down[-1] + field.direct[-1]
        gap = abs(field.flux_down[-1] - oracle.flux_down[-1])
        yield Check("transmitted flux, omega = 1", float(gap / max(through, NOTHING)), TRANSMITTED, kind="oracle")


def select_outgoing_light(field: Field, few: Array) -> tuple[Array, Array]:
    """Light up at the top and down at the bottom, at some azimuths: (1, mu, phi, 4) each."""
    up = field.mu > 0.0
    return field.stokes[:1, up][:, :, few], field.stokes[-1:, ~up][:, :, few]


def measure_flux_gap(got: Field, right: Field) -> float:
    """Fluxes of two fields, relative to all that crosses that depth, the beam included."""
    size = np.abs(right.flux_up) + np.abs(right.flux_down) + np.abs(right.direct)
    gap = np.maximum(np.abs(got.flux_up - right.flux_up), np.abs(got.flux_down - right.flux_down))
    return find_largest(gap / np.maximum(size, NOTHING))


def check_energy(case: Case, net: Array, entering: float, which: str = "") -> Iterator[Check]:
    """Net flux: constant where nothing absorbs, zero above what reflects everything, never growing with depth."""
    levels = case.levels
    steps = [(k, case.is_white(levels[k], levels[k + 1])) for k in range(len(levels) - 1)]
    balance = [abs(net[k + 1] - net[k]) for k, white in steps if white]
    if case.reflects_everything:
        balance += [abs(net[k]) for k, level in enumerate(levels) if case.is_white(level)]
    if balance:
        yield Check(f"energy{which}", float(np.max(balance) / entering), choose_energy_limit(case), kind="energy")
    growth = [net[k + 1] - net[k] for k, _ in steps]
    if growth:
        most = max(0.0, float(np.max(growth))) if np.isfinite(growth).all() else math.nan
        limit = SURFACE_ENERGY if case.media else ENERGY
        yield Check(f"net flux grows{which}", most / entering, limit, case.resolved, "other")


def choose_energy_limit(case: Case) -> float:
    """What energy may be off by: 1e-13, 1e-12 under surfaces, or the general target where the nodes do not carry all
    terms."""
    return (SURFACE_ENERGY if case.media else ENERGY) if case.resolved else TARGET


def check_closed_scene(case: Case, brdf: Brdf) -> Iterator[Check]:
    """A scene that absorbs nothing and lets nothing out below reflects everything."""
    if case.reflects_everything and case.is_white((0, 0.0)):
        yield Check(
            "reflectance of 1",
            find_largest(np.abs(brdf.total_reflectance - 1.0)),
            choose_energy_limit(case),
            kind="energy",
        )


def measure_reciprocity_gap(brdf: Brdf) -> float:
    """f(a, b) = Q f(b, a)^T Q, relative to the largest element that either direction sends anywhere."""
    places = [brdf.mu_o.tolist().index(mu) for mu in brdf.mu_i]
    f = brdf.mueller[:, places]  # (a, b, phi, 4, 4)
    back = SIGN[:, None] * f.transpose(1, 0, 2, 4, 3) * SIGN
    return measure_pairwise_gap(f, back, np.abs(brdf.mueller).max(axis=(1, 2, 3, 4)))


def measure_passing_gap(case: Case, down: Brdf, up: Brdf) -> float:
    """t_down(a, b) = n^2 Q t_up(b, a)^T Q, n the index below over that above, relative to the largest element that
    either direction sends anywhere."""
    assert down.transmission is not None
    assert up.transmission is not None
    places = [down.mu_o.tolist().index(mu) for mu in down.mu_i]
    ratio = (case.media[-1] / case.media[0]) ** 2
    back = ratio * SIGN[:, None] * up.transmission[:, places].transpose(1, 0, 2, 4, 3) * SIGN
    sizes = [np.abs(each).max(axis=(1, 2, 3, 4)) for each in (down.transmission, ratio * up.transmission)]
    gap = np.abs(down.transmission[:, places] - back).max(axis=(2, 3, 4))
    return find_largest(gap / np.maximum(np.maximum(sizes[0][:, None], sizes[1]), NOTHING))


def measure_pairwise_gap(f: Array, other: Array, size: Array) -> float:
    """The largest difference for each pair (a, b, ...) of directions, over the larger size (a,) of the two."""
    gap = np.abs(f - other).max(axis=tuple(range(2, f.ndim)))
    return find_largest(gap / np.maximum(np.maximum(size[:, None], size), NOTHING))


def measure_order_reciprocity_gap(case: Case, found: FewOrders) -> float:
    """The same for each order of multiply scattered light at the top: K/mu0 = D Q (K/mu0)^T Q D."""
    up = case.mu[case.mu > 0.0].tolist()
    into = np.array([case.mu0, SECOND_DIRECTION])
    places = [up.index(mu) for mu in into]
    # (order, a, column, b, row) -> (a, b, order, row, column)
    f = (found.kernels[:, 0] / into[:, None, None, None]).transpose(1, 3, 0, 4, 2)
    pairs = f[:, places]
    flip = SIGN * MIRROR
    mean = np.abs(found.flux_up[0, :, 0]) / (math.pi * into)
    size = np.maximum(np.abs(f[:, : len(up)]).max(axis=(1, 2, 3, 4)), mean)
    return measure_pairwise_gap(pairs, flip[:, None] * pairs.transpose(1, 0, 2, 4, 3) * flip, size)


def measure_mirror_gap(brdf: Brdf) -> float:
    """f(-phi) = D f(phi) D at 45 and 315 degrees, relative to the largest element for each incident direction."""
    f, other = brdf.mueller[:, :, 1], MIRROR[:, None] * brdf.mueller[:, :, 3] * MIRROR
    size = np.abs(brdf.mueller).max(axis=(1, 2, 3, 4))
    return find_largest(np.abs(f - other).max(axis=(1, 2, 3)) / np.maximum(size, NOTHING))


PAULI = np.array([[[1, 0], [0, 1]], [[1, 0], [0, -1]], [[0, 1], [1, 0]], [[0, -1j], [1j, 0]]])


def measure_unphysical_matrix(mueller: Array) -> float:
    """How far coherency matrices are from having no negative eigenvalue; mueller (mu_i, ..., 4, 4).

    Relative to the largest f_00 of the same incident direction.

    >>> measure = measure_unphysical_matrix
    >>> measure(np.eye(4)[None]) < 1e-15, measure(np.diag([1.0, 1.0, 1.0, -1.0])[None])
    (True, 0.5)
    """
    if not np.isfinite(mueller).all():
        return math.nan
    basis = np.array([[np.kron(a, b.conj()) for b in PAULI] for a in PAULI]) / 4.0
    each = mueller.reshape(mueller.shape[0], -1, 4, 4)
    size = np.maximum(np.abs(each[..., 0, 0]).max(axis=1), NOTHING)
    lowest = np.linalg.eigvalsh(np.tensordot(each / size[:, None, None, None], basis, 2)).min()
    return max(0.0, -float(lowest))


def measure_unphysical_light(stokes: Array) -> float:
    """How far sqrt(Q^2 + U^2 + V^2) exceeds I, over the largest I at that depth; stokes (tau, ..., 4)."""
    excess = np.sqrt((stokes[..., 1:] ** 2).sum(axis=-1)) - stokes[..., 0]
    axes = tuple(range(1, excess.ndim))
    return max(0.0, find_largest(excess.max(axis=axes) / np.maximum(np.abs(stokes[..., 0]).max(axis=axes), NOTHING)))
