"""Error against run time of every method, scene by scene: `python -m bench.methods -o FOLDER`.

Each scene is asked for the light that leaves it, in directions off every node. What is right is found by the exact
method on many more nodes than any run has, by modes, confirmed by doubling on other nodes. A curve of the report is one
method over one knob, from coarse to fine; every run has its seconds on one thread and its errors.
"""

import hashlib
import json
import math
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from bench import cases, other_codes
from bench.cases import POLARIZED
from bench.other_codes import PEERS, Asked, PeerError
from bench.study import (
    Records,
    Study,
    Times,
    add_study,
    carry_out,
    count_fitting_rounds,
    make_command,
    make_fingerprint,
    run_command,
)
from bench.tables import explain_missing_device
from vrte.basics.arrays import Array
from vrte.basics.errors import AccuracyError, SceneError
from vrte.calls.radiance import radiance
from vrte.formats.atomic import write_atomically
from vrte.request.how import AUTO, EXACT, METHODS
from vrte.results.field import Field
from vrte.scene.scene import Scene

NATURAL = (1.0, 0.0, 0.0, 0.0)
COSINES = (0.1, 0.35, 0.6, 0.85, 1.0)
PHI = (0.0, 60.0, 120.0, 180.0)


@dataclass(frozen=True)
class Case:
    """A scene, by its name in `cases`, the beam (cosine and Stokes vector) and the cosines of the light asked for:
    going up at the top and, unless ``top_only``, down at the bottom. ``nodes``: of the reference by modes, and by
    doubling."""

    name: str
    of: str
    words: str
    nodes: tuple[int, int] = (256, 192)
    mu0: float = 0.6
    stokes: tuple[float, ...] = NATURAL
    cosines: tuple[float, ...] = COSINES
    top_only: bool = False

    @property
    def scene(self) -> Scene:
        """What is solved."""
        return cases.find_scene(self.of)

    @property
    def tau(self) -> tuple[float, ...]:
        """Optical depths asked for: the top and, unless ``top_only``, the bottom."""
        return (0.0,) if self.top_only else (0.0, self.scene.thickness)

    @property
    def signed_mu(self) -> Array:
        """The cosines up and, where the bottom is looked at, down, (n_mu,)."""
        return np.array([*self.cosines, *(() if self.top_only else (-mu for mu in self.cosines))])

    @property
    def asked(self) -> Asked:
        """The scene and what is asked of it, as other codes take it."""
        return Asked(self.scene, self.mu0, np.array(self.stokes), self.signed_mu, np.array(PHI), np.array(self.tau))

    @property
    def is_conservative(self) -> bool:
        """Whether all light comes out again, through the faces that are looked at."""
        scattered = all(layer.albedo == 1.0 or layer.thickness == 0.0 for layer in self.scene.layers)
        everything = not self.top_only or math.isinf(self.scene.thickness)
        return scattered and everything and self.scene.base is None

    @property
    def outgoing(self) -> Array:
        """Which of the depths and signed cosines is light that leaves, (n_tau, n_mu)."""
        up = self.signed_mu > 0.0
        return np.array([up if tau == 0.0 else ~up for tau in self.tau])

    @property
    def fingerprint(self) -> str:
        """Changes with anything that changes an answer."""
        found = hashlib.sha256()
        for layer in self.scene.layers:
            matrix = layer.phase_matrix
            for name in ("a1", "a2", "a3", "a4", "b1", "b2"):
                found.update(np.ascontiguousarray(getattr(matrix, name)).tobytes())
            found.update(repr((layer.albedo, layer.thickness)).encode())
        asked = (self.scene.base, self.nodes, self.mu0, self.stokes, self.cosines, PHI, self.tau)
        found.update(repr(asked).encode())
        return found.hexdigest()[:16]


def index_by_name(*rows: Case) -> dict[str, Case]:
    """Cases by their names."""
    return {case.name: case for case in rows}


SMALL = index_by_name(
    Case("isotropic, small", "isotropic", "albedo 0.9, thickness 1", (48, 32)),
    Case(
        "Rayleigh, small",
        "Rayleigh, thickness 0.5",
        "albedo 1, thickness 0.5, polarized beam",
        (32, 24),
        0.6,
        POLARIZED,
    ),
    Case(
        *("semi-infinite, small", "HG 0.5, semi-infinite", "Henyey-Greenstein 0.5, albedo 0.9", (32, 24)), top_only=True
    ),
)
THIN = "albedo 1, thickness 0.02, polarized beam"
WHITE = "Henyey-Greenstein 0.75, albedo 1, semi-infinite"
IIA = "Siewert's problem IIA, albedo 0.973527, thickness 1, polarized beam"
POWDER = "radius 0.3 um at 0.64 um, thickness 100, light from the top"
COATED = "Rayleigh 0.3, clear spheres 2 (albedo 0.9), Lambertian 0.3"
GRAZING = "clear spheres, albedo 0.99, thickness 2, mu0 = 0.05"
CASES = index_by_name(
    Case("Rayleigh, thin", "Rayleigh, thickness 0.02", THIN, (224, 160), stokes=POLARIZED),
    Case("Rayleigh, thick", "Rayleigh, thickness 50", "albedo 1, thickness 50"),
    Case("isotropic", "isotropic", "albedo 0.9, thickness 1"),
    Case("aerosol, thin", "HG 0.75, thickness 0.1, clearer", "Henyey-Greenstein 0.75, albedo 0.95, thickness 0.1"),
    Case("absorbing", "HG 0.5, thickness 5", "Henyey-Greenstein 0.5, albedo 0.2, thickness 5"),
    Case("forward peak", "forward peak", "Henyey-Greenstein 0.9, albedo 0.99, thickness 2"),
    Case("cloud", "cloud", "droplets of 4 um at 2.2 um, scalar, albedo 1, thickness 16"),
    Case("white, semi-infinite", "HG 0.75, white, semi-infinite", WHITE, top_only=True),
    Case("normal incidence", "HG 0.75, thickness 5", "Henyey-Greenstein 0.75, albedo 0.99, thickness 5", mu0=1.0),
    Case("haze L", "haze L, thickness 1", "albedo 0.9, thickness 1, 4x4", (128, 96)),
    Case("spheroids", "spheroids", IIA, (160, 112), stokes=POLARIZED),
    Case("gold powder", "red gold powder", POWDER, (128, 96), top_only=True),
    Case("rutile powder", "rutile powder", "0.12 um at 0.55 um, albedo 1, thickness 20", (128, 96)),
    Case("two layers over a base", "two layers over a base", COATED, (112, 80)),
    Case("grazing incidence", "clear spheres, thickness 2", GRAZING, (144, 112), mu0=0.05, cosines=(0.05, *COSINES)),
)


def find_case(name: str) -> Case:
    """The case of that name.

    >>> find_case("isotropic").is_conservative
    False
    """
    return (CASES | SMALL)[name]


def find_matching_scenes(pattern: str, quick: bool = False) -> tuple[str, ...]:
    """The names that a pattern such as "Rayleigh*" fits. Raises SceneError where none does.

    >>> find_matching_scenes("g*")
    ('gold powder', 'grazing incidence')
    """
    known = tuple(SMALL) if quick else tuple(CASES)
    found = tuple(name for name in known if fnmatchcase(name, pattern))
    if not found:
        raise SceneError(f"--scenes must fit one of {', '.join(map(repr, known))}, not {pattern!r}")
    return found


MEASURED, REFUSED, FAILED, LEFT_OUT = "measured", "does not take", "failed", "left out"
STOKES = "iquv"


@dataclass(frozen=True)
class Row:
    """A run: median, least and greatest seconds of its rounds; errors of I, Q, U, V, largest and root mean square over
    directions, relative to the largest I at each depth, and of energy, relative to the incident flux; what the
    reference is uncertain by. NaN where there is nothing to
    tell; ``status`` says why."""

    scene: str
    curve: str
    method: str
    setting: str
    status: str
    seconds: float = np.nan
    least: float = np.nan
    greatest: float = np.nan
    rounds: int = 0
    i_max: float = np.nan
    i_rms: float = np.nan
    q_max: float = np.nan
    q_rms: float = np.nan
    u_max: float = np.nan
    u_rms: float = np.nan
    v_max: float = np.nan
    v_rms: float = np.nan
    energy: float = np.nan
    reference_within: float = np.nan
    nodes: int = 0
    orders: int = 0
    fingerprint: str = ""

    @property
    def is_measured(self) -> bool:
        """Whether there are figures."""
        return self.status == MEASURED

    @property
    def is_peer(self) -> bool:
        """Whether this is another code, not a method of vrte."""
        return self.method in PEERS

    @property
    def worst(self) -> float:
        """The largest error of any Stokes parameter; of a peer, of those that it finds."""
        each = [self.i_max, self.q_max, self.u_max, self.v_max]
        return float(np.nanmax(each)) if self.is_peer and self.is_measured else float(np.max(each))


def group_rows(rows: Iterable[Row], by: str = "scene") -> dict[str, list[Row]]:
    """Rows of each scene or curve, in their order."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(getattr(row, by), []).append(row)
    return found


EXPONENTS, EXPONENTS_QUICK = (1, 2, 3, 4, 6, 8, 10), (2, 3, 6)  # of the accuracies that auto is asked for
Options = Mapping[str, Any]  # keywords of vrte.radiance


@dataclass(frozen=True)
class Setting:
    """A point of a curve: what hovering tells, and the keywords."""

    label: str
    options: Options = field(default_factory=dict)


@dataclass(frozen=True)
class Curve:
    """A method, or a peer, over its knob; ``made_by``: a peer's version."""

    name: str
    method: str
    settings: tuple[Setting, ...]
    made_by: str = ""

    def key(self, setting: Setting) -> str:
        """Of one point, whatever the order of its keywords."""
        return json.dumps([self.name, self.method, setting.label, setting.options, self.made_by], sort_keys=True)


def vary_nodes(counts: tuple[int, ...], **options: Any) -> tuple[Setting, ...]:
    """The same with more and more nodes.

    >>> vary_nodes((4, 8))[1].label
    '8 nodes'
    """
    return tuple(Setting(f"{count} nodes", {"nodes": count, **options}) for count in counts)


def vary_accuracy(exponents: tuple[int, ...], **options: Any) -> tuple[Setting, ...]:
    """The same with finer and finer requests, nodes left to the plan."""
    return tuple(Setting(f"accuracy 1e-{k}", {"accuracy": 10.0**-k, **options}) for k in exponents)


def make_settings(*each: tuple[int | None, dict[str, Any]]) -> tuple[Setting, ...]:
    """Nodes (None: the method's own) and settings of each point.

    >>> make_settings((8, {"orders": 3}))[0].label
    '8 nodes, orders 3'
    """
    return tuple(
        Setting(
            ", ".join([*([f"{nodes} nodes"] if nodes else []), *(f"{name} {value}" for name, value in values.items())])
            or "no knob",
            ({"nodes": nodes} if nodes else {}) | ({"settings": values} if values else {}),
        )
        for nodes, values in each
    )


NODES, NODES_QUICK = (2, 4, 8, 16, 32, 64), (2, 8)
ACCURACIES, ACCURACIES_QUICK = (2, 3, 4, 6, 8, 10), (3, 6)
FINE = 1e-12  # accuracy where the nodes are the knob
# (name of the curve, settings) of each method other than the exact one; one that is not here goes over its nodes
KNOBS: dict[str, tuple[tuple[str, tuple[Setting, ...]], ...]] = {
    "adding-doubling": (
        ("adding-doubling", vary_nodes((2, 4, 8, 16, 32))),
        ("adding-doubling, start", make_settings(*((16, {"start": start, "thin": 0.25}) for start in (0, 1, 3)))),
    ),
    "diffusion": (
        ("diffusion", make_settings(*((None, {"boundary": boundary}) for boundary in ("marshak", "mark", "milne")))),
    ),
    "invariant-imbedding": (
        ("invariant-imbedding", vary_nodes((2, 4, 8, 16))),
        ("invariant-imbedding, rtol", make_settings(*((8, {"rtol": 10.0**-k}) for k in (2, 5, 8)))),
    ),
    "matrix-operator": (("matrix-operator", vary_nodes((2, 4, 8, 16, 32))),),
    "monte-carlo": (("monte-carlo", make_settings(*((None, {"photons": 10**k}) for k in (3, 4, 5, 6)))),),
    "single-scattering": (("single-scattering", make_settings((None, {}))),),
    "small-angle": (("small-angle", make_settings((None, {}))),),
    "successive-orders": (
        ("successive-orders", vary_nodes((2, 4, 8, 16, 32))),
        ("successive-orders, orders", make_settings(*((16, {"orders": orders}) for orders in (1, 2, 4, 8, 16, 64)))),
    ),
    "synthetic-iteration": (
        *(
            (
                f"synthetic-iteration, {regular}",
                make_settings(*((None, {"regular": regular, "iterations": count}) for count in (1, 2, 3))),
            )
            for regular in ("two-stream", "diffusion")
        ),
        (f"synthetic-iteration, {EXACT}", make_settings(*((nodes, {"regular": EXACT}) for nodes in (2, 4, 8)))),
    ),
    "two-stream": (("two-stream", make_settings((None, {}))),),
}


def list_curves(quick: bool = False) -> tuple[Curve, ...]:
    """All of them: of the exact method, over nodes by each algorithm, over the accuracy asked for, on an OpenCL device;
    of every other method registered; of whatever auto takes, over the accuracy asked for (its rows say which method
    that was); of every peer that is installed, over its streams, two for a node of a hemisphere.

    Where quick, a coarse and a middle point of each.

    >>> [curve.name for curve in list_curves(quick=True)][0]
    'discrete-ordinates, modes'
    """
    nodes, accuracies = (NODES_QUICK, ACCURACIES_QUICK) if quick else (NODES, ACCURACIES)
    few = pick_coarse_and_middle if quick else tuple[Setting, ...]
    found = [
        Curve(f"{EXACT}, {name}", EXACT, vary_nodes(nodes, algorithm=name, accuracy=FINE))
        for name in ("modes", "doubling")
    ]
    found.append(Curve(f"{EXACT}, accuracy", EXACT, vary_accuracy(accuracies)))
    if not quick:
        found.append(Curve(f"{EXACT}, sequential", EXACT, vary_accuracy((3, 6, 10), backend="sequential")))
        if explain_missing_device() is None:
            found.append(Curve(f"{EXACT}, opencl", EXACT, vary_accuracy(accuracies, backend="opencl")))
    for method in METHODS:
        if method != EXACT:
            each = KNOBS.get(method, ((method, vary_nodes(NODES)),))
            found += [Curve(name, method, few(settings)) for name, settings in each]
    found.append(Curve(AUTO, AUTO, vary_accuracy(EXPONENTS_QUICK if quick else EXPONENTS)))
    for peer in other_codes.list_installed():
        settings = tuple(Setting(f"{streams} streams", {"streams": streams}) for streams in peer.streams)
        found.append(Curve(f"{peer.name}{peer.lacks}", peer.name, few(settings), peer.made_by))
    return tuple(found)


def pick_coarse_and_middle(settings: tuple[Setting, ...]) -> tuple[Setting, ...]:
    """The first setting and the one halfway."""
    half = len(settings) // 2
    return settings[: half + 1 : max(1, half)]


FINEST = 1e-14  # accuracy: no Fourier order is left out that could matter
NO_LIGHT = 1e-290
FOLDER = "references"


@dataclass(frozen=True, eq=False)
class Reference:
    """The light that leaves, (n_out, n_phi, 4), each direction over the largest I at its depth, which is ``largest``,
    (n_out, 1, 1); the shares of the incident flux that go up at the top and, with the beam, down at the bottom,
    (n_tau,); ``within``: the largest difference of two routes in light and shares."""

    light: Array
    shares: Array
    largest: Array
    within: float

    @staticmethod
    def of(case: Case, field: Field, within: float = 0.0) -> "Reference":
        """What was found, in units of its own largest I."""
        light, level = field.stokes[case.outgoing], np.nonzero(case.outgoing)[0]
        most = np.array([np.abs(light[level == index, :, 0]).max() for index in range(len(case.tau))])
        largest = np.maximum(most, NO_LIGHT)[level][:, None, None]
        return Reference(light / largest, find_flux_shares(case, field), largest, within)

    def gaps(self, case: Case, field: Field) -> tuple[Array, Array]:
        """By what another answer is off: light as here, and shares."""
        return field.stokes[case.outgoing] / self.largest - self.light, find_flux_shares(case, field) - self.shares


def solve_case(case: Case, **options: Any) -> Field:
    """The case solved; what the plan warns of is measured here anyway."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return radiance(case.scene, case.mu0, case.stokes, case.signed_mu, PHI, case.tau, **options)


def find_flux_shares(case: Case, field: Field) -> Array:
    """Of the incident flux, (n_tau,): reflected, and transmitted with the beam."""
    below = (field.flux_down + field.direct)[1:]
    return np.concatenate([field.flux_up[:1], below]) / (case.mu0 * case.stokes[0])


def solve_twice(case: Case) -> Reference:
    """By modes on more nodes, which is taken, and by doubling on fewer, which tells how well it is known."""
    fine, coarse = (
        solve_case(case, nodes=nodes, accuracy=FINEST, algorithm=algorithm, truncation="none")
        for nodes, algorithm in zip(case.nodes, ("modes", "doubling"), strict=True)
    )
    differences = Reference.of(case, fine).gaps(case, coarse)
    return Reference.of(case, fine, float(max(np.abs(difference).max() for difference in differences)))


@cache
def get_reference(case: Case, folder: Path) -> Reference:
    """Of a case, from the folder if it is there and nothing has changed since, else solved and kept. Raises OSError."""
    mark = make_fingerprint("reference", case.fingerprint)
    path = folder / FOLDER / f"{make_file_stem(case.name)}.npz"
    if path.exists():
        with np.load(path) as kept:
            if str(kept["mark"]) == mark:
                return Reference(kept["light"], kept["shares"], kept["largest"], float(kept["within"]))
    found = solve_twice(case)
    path.parent.mkdir(parents=True, exist_ok=True)
    with write_atomically(path) as part, open(part, "wb") as file:
        np.savez(file, mark=mark, **vars(found))
    return found


def make_file_stem(name: str) -> str:
    """A name that a file can have.

    >>> make_file_stem("Rayleigh, thin")
    'rayleigh_thin'
    """
    return "_".join("".join(letter if letter.isalnum() else " " for letter in name.lower()).split())


CSV = "methods.csv"


@dataclass(frozen=True)
class Pace:
    """Rounds of a run: as many as fit into ``seconds``, at least ``fewest`` and at most ``most``, after a first one
    that builds and fills caches; one that takes longer than ``alone`` counts, and is the only one. A curve ends after a
    run of more than ``longest`` seconds."""

    seconds: float = 0.2
    fewest: int = 2
    most: int = 9
    alone: float = 1.0
    longest: float = 2.0


FULL, HASTE = Pace(), Pace(seconds=0.005, fewest=1, most=3)


@dataclass(frozen=True)
class Run:
    """One way to solve a scene: a point of a curve, and the one before it."""

    curve: Curve
    place: int

    @property
    def setting(self) -> Setting:
        """What the method is told."""
        return self.curve.settings[self.place]


def make_study(
    names: Sequence[str], curves: Sequence[Curve], folder: Path, pace: Pace, settings: str = ""
) -> Study[Case, Run, Row]:
    """Every scene by every curve; references are kept in the folder."""
    before: dict[tuple[str, str], Row] = {}  # the last run of a curve, by scene and curve

    def measure(one: Case, run: Run, number: int) -> Row:
        blank = Row(one.name, run.curve.name, run.curve.method, run.setting.label, "", fingerprint=mark(one, run))
        last = before.get((one.name, run.curve.name)) if run.place else None
        if last is not None and last.status.startswith(LEFT_OUT):
            row = replace(blank, status=last.status)
        elif last is not None and last.least > pace.longest:
            row = replace(blank, status=f"{LEFT_OUT}: {last.setting} took {last.least:.1f} s")
        else:
            row = measure_run(one, run.curve.method, run.setting, get_reference(one, folder), pace, blank)
        before[one.name, run.curve.name] = row
        return row

    def write(rows: list[Row], folder: Path, said: str) -> list[Path]:
        from bench.methods_page import write_page

        Records(Row, folder / CSV).write(rows)  # of this run alone
        return [folder / CSV, *write_page(rows, folder, said)]

    def describe(rows: list[Row]) -> str:
        from bench.methods_page import describe_report

        return describe_report(rows)

    return Study(
        cases=[find_case(name) for name in names],
        ways=lambda one: [Run(curve, index) for curve in curves for index in range(len(curve.settings))],
        measure=measure,
        name=lambda one, run: f"{one.name}: {run.curve.name}, {run.setting.label}",
        page=write,
        describe=describe,
        kept=(Row, CSV),
        mark=mark,
        settings=settings,
    )


def mark(one: Case, run: Run) -> str:
    """The fingerprint of a run."""
    return make_fingerprint(one.fingerprint, run.curve.key(run.setting))


def measure_run(one: Case, method: str, setting: Setting, right: Reference, pace: Pace, blank: Row) -> Row:
    """A run: refused, failed, or its seconds and errors."""
    try:
        with threadpool_limits(1):
            field, seconds = time_solve(prepare_solve(one, method, setting.options), pace)
    except SceneError as error:
        return replace(blank, status=f"{REFUSED}: {error}")
    except (AccuracyError, ArithmeticError, PeerError) as error:
        return replace(blank, status=f"{FAILED}: {error}")
    taken, times = field.diagnostics["method"] if method == AUTO else method, Times.of(seconds)
    return replace(
        blank,
        method=taken,
        status=MEASURED,
        seconds=times.median,
        least=times.least,
        greatest=times.greatest,
        rounds=times.rounds,
        nodes=int(field.diagnostics.get("nodes", 0)),
        orders=int(field.diagnostics.get("orders", 0)),
        reference_within=right.within,
        **measure_run_errors(one, field, right, blank.is_peer),
    )


def prepare_solve(one: Case, method: str, options: Options) -> Callable[[], Field]:
    """What is timed. Raises SceneError, PeerError where a peer does not get that far."""
    if method in PEERS:
        return other_codes.prepare_solve(method, one.asked, **options)
    return partial(solve_case, one, method=method, threads=1, **options)


def time_solve(solve: Callable[[], Field], pace: Pace) -> tuple[Field, list[float]]:
    """The field, and the seconds of each round."""
    seconds, rounds = list[float](), 1
    while len(seconds) < rounds:
        start = time.perf_counter()
        field = solve()
        seconds.append(time.perf_counter() - start)
        if len(seconds) == 1 and seconds[0] < pace.alone:
            rounds = 1 + count_fitting_rounds(seconds[0], pace.seconds, pace.fewest, pace.most)
    return field, seconds[1:] or seconds


def measure_run_errors(one: Case, field: Field, right: Reference, is_partial: bool = False) -> dict[str, Any]:
    """Of I, Q, U, V, largest and root mean square over directions (the larger of the depths), and of energy.

    ``is_partial``: what is NaN was not to be found and does not count; otherwise it makes the error NaN.
    """
    light, lost = right.gaps(one, field)
    level = np.nonzero(one.outgoing)[0]
    result = {}
    for index, letter in enumerate(STOKES):
        by_depth = [measure_gap_sizes(light[level == depth, :, index], is_partial) for depth in range(len(one.tau))]
        by_depth = [part for part in by_depth if part.size] or [np.array([np.nan])]
        result[f"{letter}_max"] = float(max(part.max() for part in by_depth))
        result[f"{letter}_rms"] = float(max(np.sqrt(np.mean(part**2)) for part in by_depth))
    if one.is_conservative and not (is_partial and np.isnan(lost).any()):
        return result | {"energy": float(abs(1.0 - find_flux_shares(one, field).sum()))}
    return result | {"energy": float(measure_gap_sizes(lost, is_partial).max())}


def measure_gap_sizes(differences: Array, is_partial: bool) -> Array:
    """Their sizes, (any,), without those that are NaN where that is no error."""
    sizes = np.abs(differences)
    return sizes[~np.isnan(sizes)] if is_partial else sizes.ravel()


def report_on_methods(options: Any) -> None:
    """The study that the command line asks for."""
    from bench.methods_page import require_page

    names, curves = find_matching_scenes(options.scenes, options.quick), list_curves(options.quick)
    require_page()
    settings = f"{'quick, ' if options.quick else ''}one thread"
    study = make_study(names, curves, options.output, HASTE if options.quick else FULL, settings)
    carry_out(study, options.output, options.fresh)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measures error against run time; returns the exit code."""
    command = make_command(
        "methods",
        "error against run time of every method, measured on this machine",
        ("python -m bench.methods --quick", "three small scenes: seconds"),
        ('python -m bench.methods --scenes "Rayleigh*" -o rayleigh', "of some scenes, an HTML page and pictures"),
    )
    add_study(command, "three small scenes instead of all: seconds")
    command.add_argument("--scenes", metavar="PATTERN", default="*", help='names, such as "Rayleigh*"; default: all')
    return run_command(command, report_on_methods, arguments)


if __name__ == "__main__":
    sys.exit(main())
