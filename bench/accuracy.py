"""Requested against achieved accuracy, scene by scene: `python -m bench.accuracy -o FOLDER`.

Every scene is asked for every accuracy, and compared with a reference of its own; under surfaces as well. Beside what
is chosen stand the fewest nodes that hold, from the folder's errors.csv: `docs/scripts/fewest_nodes.py` makes it.
"""

import csv
import sys
import time
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bench import cases
from bench.cost import CONFIGURATIONS, OTHERS
from bench.study import (
    COLOURS,
    MARKERS,
    Study,
    add_study,
    carry_out,
    finish_panel,
    list_run_facts,
    make_command,
    make_fingerprint,
    make_markdown_list,
    make_markdown_table,
    run_command,
    write_rows,
    write_text,
)
from vrte.basics.arrays import Array
from vrte.basics.errors import AccuracyError
from vrte.calls.brdf import brdf
from vrte.calls.radiance import radiance
from vrte.pictures.figures import FAINT, require_pictures, save
from vrte.scene.interface import Interface
from vrte.scene.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MU = (0.02, 0.1, 0.35, 0.6, 0.85, 1.0)
PHI = (0.0, 30.0, 90.0, 150.0, 180.0)
GIVEN = tuple(10.0**-k for k in range(3, 12))
CHOSEN = tuple(10.0**-k for k in range(2, 10))
COMPARED = (
    1e-3,
    1e-6,
    1e-9,
)  # requests by which nodes chosen are set beside the fewest, and all of those under surfaces
EXACT, CONTINUOUS = 1e-15, 1e-12  # accuracy of the references: on the same nodes, on many more
QUICK = ("Rayleigh, thickness 10", "HG 0.5", "spheroids", "gold powder, semi-infinite", "clear spheres, grazing")


@dataclass(frozen=True)
class Probe:
    """A scene, thin or thick, smooth or peaked, clear or absorbing, and what is asked of it: a BRDF between ``mu0``
    (n_in,) and MU, with the transmission where the layer ends, or, with ``tau``, the field of a polarized beam at those
    depths, up and down. ``nodes``: of the discrete problem; ``more``: two numbers of nodes, of this ``grading``, that
    the continuous problem is taken from; ``of``: the name of the scene in `cases`, where that is not the probe's;
    ``surface``: what the scene lies under, one of SURFACES."""

    name: str
    nodes: int
    more: tuple[int, int] = (48, 64)
    mu0: tuple[float, ...] = (0.2, 0.8)
    tau: tuple[float, ...] = ()
    of: str = ""
    grading: int = 2
    surface: str = ""

    @property
    def scene(self) -> Scene:
        """What is solved."""
        bare = cases.find_scene(self.of or self.name)
        covered = [SURFACES.get(self.surface), *[None] * len(bare.layers)]
        return Scene(bare.layers, bare.below, covered) if self.surface else bare

    @property
    def signed_mu(self) -> Array:
        """The cosines up and down."""
        return np.array([*MU, *(-mu for mu in MU)])

    def put_under(self, surface: str) -> "Probe":
        """The same under a surface; nodes of a medium carry half as many terms there."""
        more = (64, 96) if surface == "smooth" else (48, 64)
        covered = f"{self.name}, under a {surface} surface"
        return replace(self, name=covered, of=self.of or self.name, surface=surface, more=more)


SURFACES = {
    "smooth": Interface(1.0, 1.5),
    "rough": Interface(1.0, 1.5, roughness=0.3, shadowing=True, conserving=True),
}
PROBES = {
    probe.name: probe
    for probe in (
        Probe("Rayleigh, thickness 0.01", 16),
        Probe("Rayleigh, thickness 10, field", 16, (48, 64), (0.6,), (0.0, 5.0, 10.0), of="Rayleigh, thickness 10"),
        Probe("HG 0.5, thickness 1", 20),
        Probe("HG 0.75, thickness 0.1", 41, (64, 96)),
        Probe("HG 0.85, semi-infinite", 72, (112, 144), grading=1),
        Probe("clear spheres, thickness 8", 24),
        Probe("gold powder, thickness 100", 24),
        Probe("gold powder, semi-infinite", 24),
        Probe("spheroids, field", 16, (48, 64), (0.6,), (0.0, 0.2, 1.0), of="spheroids"),
        Probe("haze L, thickness 1", 50, (72, 96), (0.5,), grading=1),
        Probe("two layers over a base", 24),
        Probe("absorbing spheroids, thickness 5", 16),
        Probe(
            *("clear spheres, grazing beam", 24, (48, 64), (0.02, 0.05)),
            of="clear spheres, thickness 2, over a base",
        ),
        Probe(
            *("clear spheres, normal beam, field", 24, (48, 64), (1.0,), (0.0, 0.01, 1.0, 2.0)),
            of="clear spheres, thickness 2",
        ),
        Probe("water cloud, thickness 5", 24, (80, 104), (0.5,), grading=1),
        Probe("coarse pigment, thickness 10", 24, (72, 96), grading=1),
        Probe("peak below Rayleigh", 24, (112, 144), grading=1),
    )
}
ROUGH = ("Rayleigh, thickness 0.01", "Rayleigh, thickness 10, field", "HG 0.5, thickness 1", "spheroids, field")
COVERED = {  # phase matrices with a peak take 100 to 250 nodes under a surface, and hours
    probe.name: probe
    for probe in (
        *(each.put_under("smooth") for each in PROBES.values() if each.grading > 1),
        *(PROBES[name].put_under("rough") for name in ROUGH),
    )
}


@dataclass(frozen=True)
class Outcome:
    """One request: ``given``, whether its nodes were; nodes, their grading and unknowns (Stokes parameters and nodes of
    all orders) that it was solved with at last, orders; achieved, and what the reference is uncertain by; how many
    counts of nodes were solved, and the processor seconds of all; whether it was promised; ``saved``: whether fewer
    unknowns did than for the finest request."""

    scene: str
    given: bool
    requested: float
    achieved: float
    uncertain: float
    nodes: int
    grading: int
    orders: int
    unknowns: int
    solves: int
    seconds: float
    promised: bool
    saved: bool
    fingerprint: str = ""

    @property
    def slack(self) -> float:
        """Requested over achieved."""
        return self.requested / max(self.achieved, 1e-300)

    @property
    def kept(self) -> bool:
        """Whether no more was achieved amiss than was requested; NaN is not."""
        return self.achieved <= self.requested


@dataclass(frozen=True, eq=False)
class Answer:
    """Light of each beam at each depth, (depth, beam, values), the largest I, (depth, beam), fluxes over pi, (depth,
    beam, up and down or one of them), and how they were found."""

    light: Array
    largest: Array
    flux: Array
    diagnostics: dict[str, Any]


def answer_probe(
    case: Probe, accuracy: float, nodes: int | None, algorithm: str = "auto", grading: int | None = None
) -> Answer:
    """What is asked of the case."""
    options: dict[str, Any] = {"accuracy": accuracy, "nodes": nodes, "algorithm": algorithm, "grading": grading}
    options["threads"] = 1
    if case.tau:
        field = radiance(case.scene, case.mu0[0], cases.POLARIZED, case.signed_mu, PHI, case.tau, **options)
        flux = np.stack([field.flux_up, field.flux_down], axis=-1)[:, None] / np.pi
        light = field.stokes[:, None]
        return Answer(light, np.abs(light[..., 0]).max(axis=(2, 3)), flux, field.diagnostics)
    ends = bool(np.isfinite(case.scene.thickness))
    found = brdf(case.scene, case.mu0, MU, PHI, transmission=ends, **options)
    matrices = [found.mueller] + ([] if found.transmission is None else [found.transmission])
    light = np.stack(matrices)
    # of the transmitted light no flux is told
    flux = np.stack([found.reflectance] + [np.zeros_like(found.reflectance)] * (len(matrices) - 1))[..., None] / np.pi
    return Answer(light, np.abs(light[..., 0, 0]).max(axis=(2, 3)), flux, found.diagnostics)


def measure_difference(one: Answer, other: Answer) -> float:
    """The largest of light and flux over pi, relative to the largest I of `other` at that depth for that beam."""
    light = np.abs(one.light - other.light).max(axis=tuple(range(2, one.light.ndim)))
    flux = np.abs(one.flux - other.flux).max(axis=2)
    return float((np.maximum(light, flux) / np.maximum(other.largest, 1e-290)).max())


@cache
def solve_references(case: Probe, given: bool) -> tuple[tuple[Answer, ...], float]:
    """What is right, and how well it is known: by both algorithms on the nodes given, and what they differ by; or on
    many more nodes, and what still more of them differ by, which are taken."""
    if given:
        first, second = (answer_probe(case, EXACT, case.nodes, name) for name in ("modes", "doubling"))
        return (first, second), measure_difference(first, second)
    first, second = (answer_probe(case, CONTINUOUS, nodes, grading=case.grading) for nodes in case.more)
    return (second,), measure_difference(first, second)


@cache
def count_finest_unknowns(case: Probe, given: bool, finest: float) -> int:
    """Unknowns that the finest request takes."""
    found = answer_probe(case, EXACT if given else finest, case.nodes if given else None)
    return int(found.diagnostics["unknowns"])


def carries_all_terms(case: Probe) -> bool:
    """Whether the nodes of the discrete problem do."""
    return 2 * case.nodes >= max(layer.phase_matrix.terms for layer in case.scene.layers)


def make_study(
    names: Sequence[str], given: Sequence[bool] = (True, False), step: int = 1
) -> Study[Any, float, Outcome]:
    """Every scene at every ``step``-th request; with nodes given those scenes of which they carry all terms: the others
    have no accuracy."""

    def list_requests(case: tuple[Probe, bool]) -> tuple[float, ...]:
        if case[0].surface:
            return COMPARED if case[0].surface == "smooth" else COMPARED[:1]
        return (GIVEN if case[1] else CHOSEN)[::step]

    def measure(case: tuple[Probe, bool], requested: float, number: int) -> Outcome:
        probe, is_given = case
        right, uncertain = solve_references(probe, is_given)
        start = time.process_time()
        found = answer_probe(probe, requested, probe.nodes if is_given else None)
        seconds = time.process_time() - start
        reported = found.diagnostics
        return Outcome(
            scene=probe.name,
            given=is_given,
            requested=requested,
            achieved=max(measure_difference(found, answered) for answered in right),
            uncertain=uncertain,
            nodes=reported["nodes"],
            grading=reported["grading"],
            orders=reported["orders"],
            unknowns=int(reported["unknowns"]),
            solves=1 + reported["nodes_rule"].count(":"),
            seconds=seconds,
            promised=reported["promised"],
            saved=int(reported["unknowns"]) < count_finest_unknowns(probe, is_given, min(list_requests(case))),
            fingerprint=mark(case, requested),
        )

    def mark(case: tuple[Probe, bool], requested: float) -> str:
        return make_fingerprint(repr(case), f"{requested:g}")

    return Study(
        cases=[
            (case, each)
            for each in given
            for case in [(PROBES | COVERED)[name] for name in names]
            if not each or (not case.surface and carries_all_terms(case))
        ],
        ways=list_requests,
        measure=measure,
        name=lambda case, requested: f"{case[0].name}, {requested:.0e}",
        page=write_pages,
        describe=lambda outcomes: "\n".join(map(describe_outcome, outcomes)),
        require=require_kept,
        kept=(Outcome, KEPT),
        mark=mark,
        settings="requested and achieved accuracy",
    )


def require_kept(outcomes: Sequence[Outcome]) -> None:
    """Raises AccuracyError where a request was not kept."""
    broken = [describe_outcome(outcome) for outcome in outcomes if not outcome.kept]
    if broken:
        raise AccuracyError(f"{len(broken)} requests are not kept, the first: {broken[0]}")


def compute_median_slack(outcomes: Sequence[Outcome]) -> float:
    """Of requested over achieved, where a looser request did with less; NaN where none did."""
    saved = [outcome.slack for outcome in outcomes if outcome.saved]
    return float(np.median(saved)) if saved else float("nan")


TABLE, KEPT = "errors.csv", "measured.csv"  # measured.csv: rows of a run that was not finished

Errors = dict[int, float]  # by nodes


def find_fewest_that_hold(errors: Errors, requested: float) -> int:
    """The fewest nodes tried from which on no number of them that was tried has a larger error; 0 where all have.

    >>> find_fewest_that_hold({4: 1e-2, 5: 1e-4, 6: 2e-3, 7: 1e-4}, 1e-3)
    7
    """
    held = 0
    for nodes in sorted(errors, reverse=True):
        if not errors[nodes] <= requested:
            break
        held = nodes
    return held


def read_errors(path: Path) -> dict[tuple[str, int], Errors]:
    """The table of a file, (scene, grading) -> nodes -> error; empty where there is no file."""
    found: dict[tuple[str, int], Errors] = {}
    if path.exists():
        with open(path, encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                errors = found.setdefault((row["scene"], int(row["grading"])), {})
                errors[int(row["nodes"])] = float(row["error"])
    return found


def find_fewest(table: dict[tuple[str, int], Errors], scene: str, requested: float) -> dict[int, int]:
    """The fewest nodes that hold, by grading, where they are known."""
    found = {
        grading: find_fewest_that_hold(errors, requested) for (name, grading), errors in table.items() if name == scene
    }
    return {grading: nodes for grading, nodes in found.items() if nodes}


def make_fewest_table(table: dict[tuple[str, int], Errors], outcomes: Sequence[Outcome]) -> str:
    """Scenes down, requests across: the fewest nodes that hold with grading 1 and with any, and those chosen."""
    requests = [requested for requested in COMPARED if any(one.requested == requested for one in outcomes)]
    rows: dict[str, list[str]] = {}
    for one in outcomes:
        fewest = find_fewest(table, one.scene, one.requested)
        if one.given or one.requested not in requests:
            continue
        plain = str(fewest.get(1, "?"))
        least = min(((nodes, grading) for grading, nodes in fewest.items()), default=None)
        row = rows.setdefault(one.scene, [one.scene])
        row.append(f"{plain}; {least[0]} ({least[1]})" if least else "?")
        row.append(f"{one.nodes} ({one.grading}) in {one.solves}: {one.achieved:.0e}")
    header = [text for requested in requests for text in (f"{requested:.0e}: fewest", "chosen")]
    note = (
        "\nFewest nodes from which on all that were tried hold: with grading 1; of any grading (that grading). Chosen\n"
        "are nodes (grading) in so many solves: error. ? where the reference is not good enough, or none was tried.\n"
        f"Errors of all nodes tried: {TABLE}.\n"
    )
    return make_markdown_table(["scene", *header], rows.values()) + note if rows else ""


KINDS = ((True, "nodes given: the discrete problem"), (False, "nodes chosen: the continuous problem"))
LINES = tuple(dict.fromkeys([*CONFIGURATIONS, *COLOURS.values(), *OTHERS]))


def describe_outcome(outcome: Outcome) -> str:
    """One request and what was achieved, in one line.

    >>> describe_outcome(Outcome("a scene", True, 1e-3, 2e-5, 1e-14, 8, 1, 3, 96, 1, 0.1, True, True))
    'a scene, 8 nodes given: requested 1e-03, achieved 2e-05, 3 orders'
    """
    how = "given" if outcome.given else "chosen"
    kept = "" if outcome.kept else ", NOT KEPT"
    return (
        f"{outcome.scene}, {outcome.nodes} nodes {how}: requested {outcome.requested:.0e}, "
        f"achieved {outcome.achieved:.0e}, {outcome.orders} orders{kept}"
    )


def write_pages(outcomes: Sequence[Outcome], folder: Path, settings: str) -> list[Path]:
    """accuracy.csv, accuracy.md and accuracy.png in the folder. Raises MissingExtraError, OSError."""
    table, page, picture = (folder / f"accuracy.{ending}" for ending in ("csv", "md", "png"))
    cells = ([f"{one:.3g}" if isinstance(one, float) else one for one in astuple(each)[:-1]] for each in outcomes)
    write_rows(table, [item.name for item in fields(Outcome)][:-1], cells)
    (folder / KEPT).unlink(missing_ok=True)
    write_text(page, make_markdown(outcomes, read_errors(folder / TABLE), settings))
    save(draw_figure(outcomes), picture)
    return [table, page, picture]


def make_markdown(outcomes: Sequence[Outcome], errors: dict[tuple[str, int], Errors], settings: str) -> str:
    """A table for each kind of request: achieved, and the nodes and orders that did; and the nodes chosen beside the
    fewest that hold, where ``errors`` of scenes, gradings and nodes are known."""
    text = "# Requested and achieved accuracy\n\n" + make_markdown_list(list_run_facts("the sweep of bench.accuracy"))
    for given, title in KINDS:
        part = [outcome for outcome in outcomes if outcome.given == given]
        if part:
            broken, saved = sum(not each.kept for each in part), sum(each.saved for each in part)
            text += (
                f"\n## {title.capitalize()}\n\n{len(part)} requests, {broken} not kept; requested over achieved: "
                f"at least {min(each.slack for each in part):.2g}, median {compute_median_slack(part):.2g} over the "
                f"{saved} that did with fewer nodes or orders than the finest.\n\n{make_outcome_table(part)}"
            )
    fewest = make_fewest_table(errors, outcomes)
    return text + (f"\n## Fewest nodes and nodes chosen\n\n{fewest}" if fewest else "")


def make_outcome_table(outcomes: Sequence[Outcome]) -> str:
    """Scenes down, requests across."""
    requests = sorted({outcome.requested for outcome in outcomes}, reverse=True)
    header = ["scene", "reference within", *(f"{requested:.0e}" for requested in requests)]
    rows: dict[str, list[str]] = {}
    for outcome in outcomes:
        row = rows.setdefault(outcome.scene, [outcome.scene, f"{outcome.uncertain:.0e}"])
        doubt = "" if outcome.promised or outcome.given else " ?"
        row.append(f"{outcome.achieved:.0e} ({outcome.nodes}, {outcome.orders}){doubt}")
    note = "\nAchieved (nodes, orders); ? where it is not promised, which it never is with nodes given.\n"
    return make_markdown_table(header, rows.values()) + note


def draw_figure(outcomes: Sequence[Outcome]) -> "Figure":
    """Achieved over requested, a panel for each kind of request, a line a scene."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 5.6), layout="constrained")
    panels: Any = figure.subplots(1, 2, sharey=True)
    names = list(dict.fromkeys(outcome.scene for outcome in outcomes))
    for panel, (given, title) in zip(panels, KINDS, strict=True):
        for index, name in enumerate(names):
            line = [outcome for outcome in outcomes if outcome.given == given and outcome.scene == name]
            x, y = [outcome.requested for outcome in line], [max(outcome.achieved, 1e-16) for outcome in line]
            style = {"color": LINES[index % len(LINES)], "marker": MARKERS[index % len(MARKERS)]}
            panel.plot(x, y, markersize=3.5, linewidth=0.8, label=name, **style)
        requests = [outcome.requested for outcome in outcomes if outcome.given == given]
        ends = [min(requests, default=1e-9), max(requests, default=1e-3)]
        panel.plot(ends, ends, color="black", linewidth=1.2)  # the line that no point may lie above
        panel.fill_between(ends, ends, [10.0 * end for end in ends], color=FAINT, alpha=0.5, linewidth=0)
        finish_panel(panel, title, "requested")
    panels[0].set_ylabel("achieved, relative to the largest I")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    return figure


def measure_accuracy(options: Any) -> None:
    """The study that the command line asks for."""
    require_pictures()
    names = [name for name in PROBES | COVERED if not options.quick or (name in PROBES and name.startswith(QUICK))]
    carry_out(make_study(names, step=3 if options.quick else 1), options.output, options.fresh)


def main(arguments: Sequence[str] | None = None) -> int:
    """Asks all scenes for their accuracies and writes what came; returns the exit code, 1 where one was not kept."""
    command = make_command(
        "accuracy",
        "requested against achieved accuracy of seventeen scenes, bare and under surfaces",
        ("python -m bench.accuracy --quick", "a few small scenes, every third request"),
        ("python -m bench.accuracy -o docs/explanation/accuracy", "the page's table and picture"),
    )
    add_study(command, "a few small scenes, every third request")
    return run_command(command, measure_accuracy, arguments)


if __name__ == "__main__":
    sys.exit(main())
