"""Every digit, in stiff and extreme scenes: `python -m bench.stability`.

The cases of `bench.stability_cases` are solved and checked against stored answers of ball arithmetic where there are
any, and against the laws that every answer has to keep. Each check gives a number and the limit that the number has to
keep. Light is compared relative to the largest I over all directions at the same depth, in the Fourier orders that the
case looks at. ``c`` is what the answer changes by when a number of the scene moves by one unit in the last place: from
the oracle's table, or estimated where there is no oracle.
"""

import math
import sys
import time
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np

from bench import stability_cases
from bench.cases import make_scene, restore_slabs, store_phase_matrices
from bench.stability_cases import (
    AXES,
    BEAM,
    CONDITIONS,
    GROUPS,
    ORACLE_NODES,
    ORDINARY,
    SURFACE_CONDITIONS,
    Case,
    find_matching_cases,
)
from bench.study import (
    Study,
    add_study,
    carry_out,
    hash_files,
    list_run_facts,
    make_command,
    make_fingerprint,
    make_markdown_list,
    make_markdown_table,
    run_command,
    show_two_digits,
    write_text,
)
from vrte.basics.arrays import Array
from vrte.basics.errors import AccuracyError, AccuracyWarning, LongSolveWarning, SceneError
from vrte.basics.running import count_usable_cpus
from vrte.calls.brdf import brdf
from vrte.calls.radiance import radiance
from vrte.discrete_ordinates.orders.routes import OTHER
from vrte.request.how import FINEST, OPTIONS
from vrte.results.brdf import Brdf
from vrte.results.field import Field
from vrte.scene.scene import Scene

TABLE = Path(__file__).parents[1] / "tests" / "stability_oracle.npz"  # in the source tree alone
LEFT_OUT = ("missing", "out of date")  # of what the oracle should have answered: python -m tests.oracle_table does


@dataclass(frozen=True, eq=False)
class OracleAnswer:
    """Right to the last digit of ``case``, whose phase matrices and cosines are those of the table.

    orders, m -> (2, tau, mu, 4) for incident (I, Q) and (U, V) apart [W m-2 sr-1]; c, m -> what they change by when a
    number of the scene moves by one unit in the last place; flux_up and flux_down (tau,) [W m-2].
    """

    case: Case
    orders: dict[int, Array]
    c: dict[int, float]
    flux_up: Array
    flux_down: Array


Table = Mapping[str, Array]


def read_oracle_table() -> Table:
    """The table of the source tree."""
    with np.load(TABLE, allow_pickle=False) as table:
        return dict(table)


def find_oracle_answer(case: Case, table: Table) -> OracleAnswer | str:
    """The oracle's answer, or why there is none.

    >>> from bench.cases import Slab
    >>> find_oracle_answer(Case("unheard of", 8, (Slab("rayleigh", 1.0, 1.0),)), {})
    'none'
    """
    name = case.name
    if not table:
        return "none"
    if case.media:
        return "surfaces"
    if case.nodes > ORACLE_NODES:
        return "too many nodes"
    if f"{name}/hash" not in table:
        return "missing"
    if str(table[f"{name}/hash"]) != case.key:
        return "out of date"
    if any(f"{name}/{m}/radiance" not in table for m in case.orders):
        return "no stable answer"
    return OracleAnswer(
        case=restore_case(case, table),
        orders={m: table[f"{name}/{m}/radiance"] for m in case.orders},
        c={m: float(table[f"{name}/{m}/c"]) for m in case.orders},
        flux_up=table[f"{name}/flux_up"].sum(axis=0),
        flux_down=table[f"{name}/flux_down"].sum(axis=0),
    )


def store_case(case: Case) -> dict[str, Array]:
    """What the oracle's answer is made from and the case says in words alone, by the key that `restore_case` reads."""
    return {f"{case.name}/mu": np.array([case.mu0, *case.mu]), **store_phase_matrices(case.slabs)}


def restore_case(case: Case, table: Table) -> Case:
    """The case in the numbers that the table's answer was made from."""
    cosines = tuple(table[f"{case.name}/mu"].tolist())
    return replace(case, slabs=restore_slabs(case.slabs, table), cosines=cosines)


LOBE_ORDERS = 136  # beyond, the lobe's orders are below 1e-17 of the first
SECOND_DIRECTION = 0.35  # incident beside the sun, for reciprocity
EVERYTHING: dict[str, Any] = {"accuracy": FINEST, "truncation": "none"}


@dataclass(frozen=True)
class Options:
    """How the scenes are solved: "auto", "modes" or "doubling", on how many threads (None: all)."""

    algorithm: str = "auto"
    threads: int | None = None


def make_azimuths(case: Case) -> Array:
    """Equal steps [degrees], a multiple of 8, so many that none of ``case.orders`` is mistaken for another: (phi,)."""
    highest = max(case.terms, LOBE_ORDERS if case.base_kind == "lobe" else 0)
    steps = 8 * -(-(highest + max(case.orders) + 2) // 8)
    return np.arange(steps, dtype=np.float64) * (360.0 / steps)


def solve_field(case: Case, scene: Scene, phi: Array, algorithm: str, threads: int | None) -> Field:
    """What the case asks of a scene, at the given azimuths; where light is refracted at depths twice: on the upper side
    of interfaces, then on the lower."""
    asked: dict[str, Any] = {"mu0": case.mu0, "stokes": case.beam, "mu": case.mu, "phi": phi, "tau": case.tau}
    asked |= EVERYTHING | {"nodes": case.nodes, "algorithm": algorithm, "threads": threads}
    if not scene.has_interfaces:
        return radiance(scene, **asked)
    fields = [radiance(scene, side=side, **asked) for side in ("above", "below")]
    names = ("stokes", "flux_up", "flux_down", "direct", "direct_up", "index", "tau")
    joined: dict[str, Any] = {name: np.concatenate([getattr(field, name) for field in fields]) for name in names}
    return replace(fields[0], **joined)


def solve_brdf(case: Case, options: Options, phi: Array, illuminate: str = "top") -> Brdf:
    """The BRDF and, of a finite scene, BTDF for the sun's direction and the second one, out to all of the case's."""
    directions: dict[str, Any] = {"mu_i": [case.mu0, SECOND_DIRECTION], "mu_o": case.mu[case.mu > 0.0], "phi": phi}
    directions |= {"transmission": math.isfinite(case.thickness)}
    how: dict[str, Any] = {"algorithm": options.algorithm, "threads": options.threads, "illuminate": illuminate}
    return brdf(case.scene, **directions, **EVERYTHING, nodes=case.nodes, **how)


def cut_layers_otherwise(case: Case) -> Scene:
    """The same scene with its layers cut otherwise: identical neighbours joined, or the described slab in two."""
    if case.layering == "identical-neighbours":
        whole = math.fsum(slab.thickness for slab in case.slabs)
        return make_scene((replace(case.slabs[0], thickness=whole),), case.base, case.media)
    slab = case.slabs[case.main]
    upper = min(slab.thickness / 2.0, 1.0)
    parts = (replace(slab, thickness=upper), replace(slab, thickness=slab.thickness - upper))
    after = case.main + 1
    media = (*case.media[:after], *case.media[after : after + 1], *case.media[after:])  # the described one's twice
    return make_scene((*case.slabs[: case.main], *parts, *case.slabs[after:]), case.base, media)


TARGET = 1e-10
ENERGY = 1e-13
SURFACE_ENERGY = 1e-12  # light comes back to the same place n^2 times as often
TRANSMITTED = 1e-8
UNIT = 2.0**-53  # the last place of a number near 1, relative
NOTHING = 1e-290  # light fainter than this, for a beam of 1 W m-2, is none
SIGN = np.array([1.0, 1.0, 1.0, -1.0])  # Q of the reciprocity relation
MIRROR = np.array([1.0, 1.0, -1.0, -1.0])  # D of the mirror symmetry


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


def examine_case(case: Case, oracle: OracleAnswer | str, options: Options) -> dict[str, Any]:
    """Solves the case and checks the answer: its checks, its c, and the oracle's part in it, "yes" or why there is
    none. ``oracle``: its answer, whose numbers are then solved, or a word that says why there is none."""
    answer = oracle if isinstance(oracle, OracleAnswer) else None
    case = case if answer is None else answer.case
    c = max(answer.c.values()) if answer is not None else estimate_c(case)
    limit = max(TARGET, 10.0 * c)
    checks = [*check_case(case, answer, options, limit)]
    return {"checks": checks, "c": c, "oracle": "yes" if answer is not None else str(oracle)}


def check_case(case: Case, oracle: OracleAnswer | None, options: Options, limit: float) -> Iterator[Check]:
    """Every check there is."""
    phi = make_azimuths(case)
    few = np.array([0, 1, 4, 7]) * (phi.size // 8)  # 0, 45, 180 and 315 degrees
    field = solve_field(case, case.scene, phi, options.algorithm, options.threads)
    brdf = solve_brdf(case, options, phi[few])
    other = solve_field(case, cut_layers_otherwise(case), phi[few], options.algorithm, options.threads)
    yield check_finite(field.stokes, field.flux_up, field.flux_down, brdf.mueller, brdf.transmission, other.stokes)
    if oracle is not None:
        lit_as_there = replace(case, beam=BEAM), case.scene, phi, options.algorithm, options.threads
        yield from check_against_oracle(case, field if case.beam == BEAM else solve_field(*lit_as_there), oracle)
    # the BRDF times the irradiance is the radiance at the top, the BTDF times the irradiance that at the bottom
    lit = case.mu0 * np.array(case.beam)
    up = field.mu > 0.0
    difference = measure_relative_difference((brdf.mueller[0] @ lit)[None], field.stokes[:1, up][:, :, few])
    yield Check("BRDF and radiance", difference, limit)
    if brdf.transmission is not None:
        indices = [brdf.mu_o.tolist().index(-mu) for mu in case.mu[case.mu < 0.0]]
        below = (brdf.transmission[0, indices] @ lit)[None]
        difference = measure_relative_difference(below, field.stokes[-1:, ~up][:, :, few])
        yield Check("BTDF and radiance", difference, limit)
    yield Check("layer cut otherwise", measure_relative_difference(other.stokes, field.stokes[:, :, few]), limit)
    yield Check("layer cut otherwise, fluxes", measure_flux_gap(other, field), limit)
    counts = oracle is None and not case.is_thin
    with suppress(AccuracyError):  # the other algorithm may say that it cannot
        other = solve_field(case, case.scene, phi[few], OTHER[field.diagnostics["algorithm"]], options.threads)
        difference = measure_relative_difference(other.stokes, field.stokes[:, :, few])
        yield Check("both algorithms", difference, limit, counts)
        yield Check("both algorithms, fluxes", measure_flux_gap(other, field), limit, counts)
    net = field.flux_down + field.direct - field.flux_up - (0.0 if field.direct_up is None else field.direct_up)
    for part, where in zip(np.split(net, net.size // case.tau.size), ("", " on lower sides"), strict=False):
        yield from check_energy(case, part, field.direct[0], where)
    if case.reflects_everything and case.is_white((0, 0.0)):  # it reflects everything
        difference = find_largest(np.abs(brdf.total_reflectance - 1.0))
        yield Check("reflectance of 1", difference, choose_energy_limit(case), kind="energy")
    yield Check("reciprocity", measure_reciprocity_gap(brdf), limit)
    if case.media and case.base is None and brdf.transmission is not None:
        from_below = solve_brdf(case, options, phi[few], "bottom")
        yield Check("reciprocity of what gets through", measure_passing_gap(case, brdf, from_below), limit)
    yield Check("mirror symmetry", measure_mirror_gap(brdf), TARGET)
    if brdf.specular is not None:
        yield Check("physical beams", measure_unphysical_matrix(brdf.specular[:, None]), TARGET, kind="other")
    yield Check("physical BRDF", measure_unphysical_matrix(brdf.mueller), TARGET, case.resolved, "other")
    yield Check("physical light", measure_unphysical_light(field.stokes), TARGET, case.resolved, "other")


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
        difference = abs(field.flux_down[-1] - oracle.flux_down[-1])
        yield Check(
            "transmitted flux, omega = 1", float(difference / max(through, NOTHING)), TRANSMITTED, kind="oracle"
        )


def measure_flux_gap(got: Field, right: Field) -> float:
    """Fluxes of two fields, relative to all that crosses that depth, the beam included."""
    size = np.abs(right.flux_up) + np.abs(right.flux_down) + np.abs(right.direct)
    difference = np.maximum(np.abs(got.flux_up - right.flux_up), np.abs(got.flux_down - right.flux_down))
    return find_largest(difference / np.maximum(size, NOTHING))


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


def measure_reciprocity_gap(brdf: Brdf) -> float:
    """f(a, b) = Q f(b, a)^T Q, relative to the largest element that either direction sends anywhere."""
    indices = [brdf.mu_o.tolist().index(mu) for mu in brdf.mu_i]
    f = brdf.mueller[:, indices]  # (a, b, phi, 4, 4)
    back = SIGN[:, None] * f.transpose(1, 0, 2, 4, 3) * SIGN
    return measure_pairwise_gap(f, back, np.abs(brdf.mueller).max(axis=(1, 2, 3, 4)))


def measure_passing_gap(case: Case, down: Brdf, up: Brdf) -> float:
    """t_down(a, b) = n^2 Q t_up(b, a)^T Q, n the index below over that above, relative to the largest element that
    either direction sends anywhere."""
    assert down.transmission is not None
    assert up.transmission is not None
    indices = [down.mu_o.tolist().index(mu) for mu in down.mu_i]
    ratio = (case.media[-1] / case.media[0]) ** 2
    back = ratio * SIGN[:, None] * up.transmission[:, indices].transpose(1, 0, 2, 4, 3) * SIGN
    sizes = [np.abs(each).max(axis=(1, 2, 3, 4)) for each in (down.transmission, ratio * up.transmission)]
    difference = np.abs(down.transmission[:, indices] - back).max(axis=(2, 3, 4))
    return find_largest(difference / np.maximum(np.maximum(sizes[0][:, None], sizes[1]), NOTHING))


def measure_pairwise_gap(f: Array, other: Array, size: Array) -> float:
    """The largest difference for each pair (a, b, ...) of directions, over the larger size (a,) of the two."""
    difference = np.abs(f - other).max(axis=tuple(range(2, f.ndim)))
    return find_largest(difference / np.maximum(np.maximum(size[:, None], size), NOTHING))


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


# (pattern of the case's name, pattern of the check's name or "refused", why the target is out of reach): told in the
# table with the figure, and not counted as falling short
NO_ANSWER = (
    "the phase matrix cut at 2 N terms is negative over wide angles, a mode swings instead of fading, and the discrete "
    "problem is next to singular or, semi-infinite, has no solution; both algorithms say so"
)
TRAPPED = (
    "light that both faces of a plate reflect totally leaves it by being scattered alone, 1e-6 of it a crossing, and "
    "the last places of what is not are rounded: some 2e-16 n^2/thickness of what comes out"
)
KNOWN: tuple[tuple[str, str, str], ...] = (
    ("HG*", "refused", NO_ANSWER),
    ("g = *", "refused", NO_ANSWER),
    ("*-x200 *", "refused", NO_ANSWER),
    *(
        (name, check, TRAPPED)
        for name in (
            "n=* plate: * t=1e-06 *",
            "n=* t=1e-06 perfect mirror *",
            "n=4, trapped *, thin",
            "n=1.5, * thin plate",
        )
        for check in ("BRDF and *", "BTDF and *", "layer cut *", "both algorithms*", "reciprocity*")
    ),
)


@dataclass(frozen=True)
class Record:
    """What became of a case: its checks, or ``trouble`` where there was no answer; ``c``, ``oracle`` as in `Examined`.

    ``seconds`` of wall time; ``stack``, "" where nothing refracts.
    """

    name: str
    group: str
    conditions: list[str]
    base: str
    layering: str
    nodes: int
    reason: str
    seconds: float
    oracle: str = "none"
    c: float = 0.0
    checks: list[Check] = field(default_factory=list)
    trouble: str = ""
    stack: str = ""
    index: float = 1.0
    fingerprint: str = ""

    def __post_init__(self) -> None:
        """Checks that come from a file are made ones again."""
        made = [Check(**check) if isinstance(check, dict) else check for check in self.checks]
        object.__setattr__(self, "checks", made)

    def worst(self, kind: str) -> float | None:
        """The largest value of one kind of check, NaN if there is one; None without such a check."""
        values = [check.value for check in self.checks if check.kind == kind]
        return max(values, key=lambda value: (value != value, value)) if values else None

    @property
    def shortfalls(self) -> list[str]:
        """What falls short, in words, known reasons left out."""
        return [text for name, text in self._broken() if find_known_reason(self.name, name) is None]

    @property
    def reasons(self) -> list[str]:
        """What falls short for a known reason, with that reason."""
        found = [(text, find_known_reason(self.name, name)) for name, text in self._broken()]
        return [f"{text}: {reason}" for text, reason in found if reason is not None]

    @property
    def verdict(self) -> str:
        """Whether the case holds, falls short or does so for a known reason, in words."""
        return "falls short" if self.shortfalls else "known" if self.reasons else "holds"

    def _broken(self) -> list[tuple[str, str]]:
        if self.trouble:
            return [("refused", self.trouble)]
        left_out = [("left out", f"the oracle's answer is {self.oracle}")] if self.oracle in LEFT_OUT else []
        return left_out + [
            (check.name, f"{check.name} {check.value:.1e}, allowed {check.limit:.1e}")
            for check in self.checks
            if not check.holds
        ]


def find_known_reason(case: str, check: str) -> str | None:
    """Why this check of this case is known to be out of reach, or None."""
    fits = (reason for names, checks, reason in KNOWN if fnmatchcase(case, names) and fnmatchcase(check, checks))
    return next(fits, None)


def make_study(
    cases: Sequence[Case], table: Table, options: Options | None = None, settings: str = ""
) -> Study[Case, None, Record]:
    """Every case once. A record is found again by the case, the package, the oracle's answer and the options."""
    options = options or Options()
    sources = hash_files([Path(__file__), Path(stability_cases.__file__)])
    how = f"{options.algorithm} {options.threads or count_usable_cpus()} {sources}"

    def mark(case: Case, way: None) -> str:
        right = find_oracle_answer(case, table)
        return make_fingerprint(case.name, case.key, how, right if isinstance(right, str) else "the oracle's")

    return Study(
        cases=cases,
        ways=lambda case: [None],
        measure=lambda case, way, number: record_case(case, table, options, mark(case, way)),
        name=lambda case, way: case.name,
        page=write_page,
        describe=lambda records: "\n".join(list_blocks(records)),
        require=require_all,
        kept=(Record, LOG),
        mark=mark,
        settings=settings,
    )


def record_case(case: Case, table: Table, options: Options, mark: str = "") -> Record:
    """Examines one case; whatever goes wrong becomes part of the record."""
    start = time.perf_counter()
    found: dict[str, Any] = {}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            found = examine_case(case, find_oracle_answer(case, table), options)
        except (AccuracyError, SceneError) as error:
            found["trouble"] = f"refused: {error}"
        except Exception as error:
            found["trouble"] = f"{type(error).__name__}: {error}"
    # that a solve takes long says nothing of digits; too few nodes for the phase matrix are told, and do not count
    for counts, few in ((True, False), (case.resolved, True)):
        reported = [each for each in caught if issubclass(each.category, AccuracyWarning) == few]
        reported = [each for each in reported if not issubclass(each.category, LongSolveWarning)]
        if reported and "checks" in found:
            text = " ".join(str(reported[0].message).split())
            found["checks"].append(Check(f"warnings ({text})", float(len(reported)), 0.0, counts, "other"))
    return Record(
        name=case.name,
        group=case.group,
        conditions=case.conditions,
        base=case.base_kind,
        layering=case.layering,
        nodes=case.nodes,
        reason=case.reason,
        stack=case.stack,
        index=case.index,
        seconds=time.perf_counter() - start,
        fingerprint=mark,
        **found,
    )


def require_all(records: Sequence[Record]) -> None:
    """Raises AccuracyError, naming the first, where a case falls short."""
    short = [record for record in records if record.shortfalls]
    if short:
        raise AccuracyError(
            f"{len(short)} of {len(records)} scenes fall short, the first: {short[0].name}: {short[0].shortfalls[0]}"
        )


LOG, PAGE = "stability_cases.csv", "stability.md"
KINDS = ("oracle", "consistency", "energy")
COLUMNS = ("scenes", "", "cases", "oracle", "largest error", "c", "consistency", "energy", "seconds", "verdict")
CORNER_COLUMNS = ("corner", "what makes it hard", "error", "c", "consistency", "energy", "seconds", "verdict")


def make_rows(title: str, groups: Mapping[str, Sequence[Record]]) -> list[list[str]]:
    """Rows of the table, in the order of COLUMNS: of each group that has records what they come to."""
    rows = []
    for label, records in groups.items():
        if not records:
            continue
        error, consistency, energy = (find_largest_given(record.worst(kind) for record in records) for kind in KINDS)
        answered = [record for record in records if record.oracle == "yes"]
        c = find_largest_given(record.c for record in answered)
        known, short = (sum(bool(getattr(each, name)) for each in records) for name in ("reasons", "shortfalls"))
        words = [f"{short} fall short"] * bool(short) + [f"{known} for a known reason"] * bool(known)
        rows.append(
            [
                *(title, label, str(len(records)), str(len(answered))),
                *map(show_number, (error, c, consistency, energy)),
                f"{math.fsum(record.seconds for record in records):.1f}",
                ", ".join(words if short else ["holds", *words]),
            ]
        )
    return rows


def find_largest_given(values: Iterable[float | None]) -> float | None:
    """The largest that is there, NaN if one is NaN; None of nothing.

    >>> find_largest_given([None, 2.0, 1.0]), find_largest_given([None])
    (2.0, None)
    """
    found = [value for value in values if value is not None]
    return max(found, key=lambda value: (math.isnan(value), value)) if found else None


def show_number(value: float | None) -> str:
    """Two digits, or a dash for nothing; NaN, which a check may have found, by its name.

    >>> show_number(3.14e-12), show_number(math.nan)
    ('3.1e-12', 'nan')
    """
    return "nan" if value is not None and math.isnan(value) else show_two_digits(value)


def group_by(records: Sequence[Record], name: str, values: Iterable[Any] | None = None) -> dict[str, list[Record]]:
    """Records by what one of their fields is, or has in it; by default by all that occurs, ascending."""
    wanted = sorted({getattr(record, name) for record in records}) if values is None else values

    def fits(record: Record, value: Any) -> bool:
        there = getattr(record, name)
        return value in there if isinstance(there, list) else bool(there == value)

    labels = {(f"{value:.5g}" if isinstance(value, float) else str(value)): value for value in wanted}
    return {label: [record for record in records if fits(record, value)] for label, value in labels.items()}


def list_blocks(records: Sequence[Record]) -> list[str]:
    """The tables, the corners one by one, what falls short, and what is out of reach, as Markdown; a case counts in
    every row that it belongs to."""
    plain, under = ([record for record in records if bool(record.stack) == is_under] for is_under in (False, True))
    by_condition = [
        row
        for group in GROUPS
        for row in make_rows(
            group, group_by([one for one in plain if one.group == group], "conditions", [*CONDITIONS, ORDINARY])
        )
    ]
    by_axis = [
        row for axis in ("base", "layering", "nodes") for row in make_rows(axis, group_by(plain, axis, AXES[axis]))
    ]
    surfaces = make_rows("surfaces", group_by(under, "conditions", [*SURFACE_CONDITIONS, ORDINARY]))
    for axis in ("stack", "index", "base", "nodes"):
        surfaces += make_rows(axis, group_by(under, axis))
    corners = []
    for one in (record for record in records if record.reason):
        c = one.c if one.oracle == "yes" else None
        figures = one.worst("oracle"), c, one.worst("consistency"), one.worst("energy")
        corners.append([one.name, one.reason, *map(show_number, figures), f"{one.seconds:.1f}", one.verdict])
    short, known = (
        make_markdown_list(
            f"{record.name}: {'; '.join(getattr(record, name))}" for record in records if getattr(record, name)
        )
        for name in ("shortfalls", "reasons")
    )
    tables = {
        "By what scatters and under which condition": by_condition,
        "By base, layering and number of nodes": [*by_axis, *make_rows("all", {"": plain})],
        "Under surfaces": [*surfaces, *make_rows("all under surfaces", {"": under})],
    }
    blocks = [f"## {title}\n\n{make_markdown_table(COLUMNS, rows)}" for title, rows in tables.items() if rows]
    blocks += [f"## Corners\n\n{make_markdown_table(CORNER_COLUMNS, corners)}"] if corners else []
    blocks += ["## What falls short\n", short or "Nothing.\n"]
    return blocks + (["## Out of reach, and why\n", known] if known else [])


def write_page(records: Sequence[Record], folder: Path, settings: str) -> list[Path]:
    """stability.md in the folder, beside stability_cases.csv, where the records are already. Raises OSError."""
    scenes = f"{len(records)} scenes, {math.fsum(record.seconds for record in records):.0f} s"
    facts = make_markdown_list([*list_run_facts(settings), scenes])
    write_text(folder / PAGE, "\n".join(["# Stability: the last run\n", facts, *list_blocks(records)]).rstrip() + "\n")
    return [folder / PAGE, folder / LOG]


def measure_stability(options: Any) -> None:
    """The study that the command line asks for."""
    cases, answers = find_matching_cases(options.cases, options.quick), read_oracle_table()
    settings = f"{'quick, ' if options.quick else ''}cases {options.cases}, algorithm {options.algorithm}"
    study = make_study(cases, answers, Options(options.algorithm, options.threads), settings)
    carry_out(study, options.output, options.fresh)


def main(arguments: Sequence[str] | None = None) -> int:
    """Solves and checks stiff and extreme scenes; returns the exit code."""
    command = make_command(
        "stability",
        "stiff and extreme scenes, solved and checked, as a table",
        ("python -m bench.stability --quick", "some forty small scenes: under a minute"),
        ('python -m bench.stability --cases "rayleigh*N=8" -o rayleigh', "those of one name, into a folder"),
    )
    add_study(command, "some forty small scenes instead of all")
    command.take_options("algorithm", "threads")
    command.add_argument("--cases", metavar="PATTERN", default="*", help='names, such as "rayleigh*N=8"; default: all')
    command.set_defaults(algorithm=OPTIONS["algorithm"].default)
    return run_command(command, measure_stability, arguments)


if __name__ == "__main__":
    sys.exit(main())
