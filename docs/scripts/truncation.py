"""Error of the radiance against the number of nodes for peaked phase functions, the truncations side by side.

``python -m docs.scripts.truncation -o FOLDER`` writes truncation.csv, truncation.md and truncation.png there. Every
scene is one conservative layer, lit by one unpolarized beam with mu0 = 0.6; its thickness times 1 - g is 0.5, so all
turn about as much light away.
"""

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bench import cases
from bench.study import make_markdown_table, write_rows, write_text
from vrte.basics.arrays import Array
from vrte.basics.errors import AccuracyError
from vrte.calls.radiance import radiance
from vrte.optics.truncation import TRUNCATIONS
from vrte.pictures.figures import require_pictures, save
from vrte.scene.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MU0 = 0.6
MU = np.linspace(0.05, 1.0, 20)
PHI = np.array([0.0, 5.0, 15.0, 30.0, 60.0, 90.0, 135.0, 180.0])
NEAR_DEG = 10.0  # from the beam's own direction
PARTS = ("reflected", "transmitted aside", "transmitted near the beam")
STYLES = {"none": ("#8c8c8c", "x"), "delta-m": ("#d98200", "o"), "small-angle": ("#1f4e79", "s")}
HEADER = ("case", "truncation", "nodes", "part", "largest_error", "rms_error", "seconds")


@dataclass(frozen=True)
class Case:
    """The name of a scene in `cases`, the numbers of nodes to try, and the two that the reference takes, the finer one
    last; ``resolved``: the reference carries all terms of the phase function. ``name``: for the table."""

    name: str
    scene: str
    nodes: tuple[int, ...]
    reference: tuple[int, int]
    resolved: bool = False


@dataclass(frozen=True)
class Row:
    """What one solve got wrong in one part: largest and rms error over the directions, over the largest I there."""

    case: str
    truncation: str
    nodes: int
    part: str
    largest: float
    rms: float
    seconds: float


CASES = (
    Case("haze L", "haze L, thickness 2.5", (4, 6, 8, 12, 16, 24), (40, 50), resolved=True),
    Case("cloud C1", "cloud C1", (4, 8, 16, 32, 64), (80, 100)),
    Case("g = 0.9", "g = 0.9", (4, 8, 16, 32, 64), (100, 110), resolved=True),
    Case("g = 0.99", "g = 0.99", (4, 8, 16, 32, 64), (100, 128)),
    Case("g = 0.9999", "g = 0.9999", (4, 8, 16, 32, 64), (100, 128)),
)


def measure_case_errors(case: Case, progress: Callable[[str], Any] = print) -> tuple[list[Row], list[Row]]:
    """The errors of every truncation and number of nodes; and what the reference differs by from the same with fewer
    nodes and, where it does not carry all terms, from delta-M with as many nodes."""
    scene = cases.find_scene(case.scene)
    coarse, fine = case.reference
    name = "none" if case.resolved else "small-angle"
    exact, _ = solve_intensity(scene, fine, name)
    doubt = [(name, coarse)] if case.resolved else [(name, coarse), ("delta-m", fine)]

    def errors(tried: list[tuple[str, int]]) -> list[Row]:
        rows: list[Row] = []
        for truncation, nodes in tried:
            try:
                values, seconds = solve_intensity(scene, nodes, truncation)
            except AccuracyError:
                progress(f"{case.name}, {truncation}, {nodes} nodes: refused, neither algorithm verifies it")
                continue
            progress(f"{case.name}, {truncation}, {nodes} nodes: {seconds:.2f} s")
            rows += compare_parts(case.name, truncation, nodes, values, exact, seconds)
        return rows

    return errors([(name, nodes) for nodes in case.nodes for name in TRUNCATIONS]), errors(doubt)


def solve_intensity(scene: Scene, nodes: int, truncation: str) -> tuple[Array, float]:
    """Diffuse I, up at the top and down at the bottom: (2, mu, phi); and the seconds it took."""
    start, bottom = time.perf_counter(), scene.thickness
    field = radiance(
        scene, MU0, mu=np.concatenate([MU, -MU]), phi=PHI, tau=[0.0, bottom], nodes=nodes, truncation=truncation
    )
    seconds = time.perf_counter() - start
    return np.stack([field.stokes[0, : MU.size, :, 0], field.stokes[1, MU.size :, :, 0]]), seconds


def compare_parts(case: str, truncation: str, nodes: int, values: Array, exact: Array, seconds: float) -> list[Row]:
    """One row for each of PARTS."""
    cosine = MU0 * MU[:, None] + np.sqrt((1.0 - MU0**2) * (1.0 - MU[:, None] ** 2)) * np.cos(np.radians(PHI))
    near = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))) < NEAR_DEG
    rows = []
    for part, side, chosen in zip(PARTS, (0, 1, 1), (np.ones_like(near), ~near, near), strict=True):
        error, largest = np.abs(values - exact)[side][chosen], np.abs(exact[side][chosen]).max()
        rms = float(np.sqrt((error**2).mean()) / largest)
        rows.append(Row(case, truncation, nodes, part, float(error.max() / largest), rms, seconds))
    return rows


def write_report(errors: Sequence[Row], reference: Sequence[Row], folder: Path) -> None:
    """truncation.csv, truncation.md and truncation.png. Raises MissingExtraError without matplotlib, or OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    write_rows(folder / "truncation.csv", HEADER, map(list_row_cells, errors))
    write_text(folder / "truncation.md", f"{make_error_table(errors)}\nReferences:\n\n{make_error_table(reference)}")
    save(draw_figure(errors, reference), folder / "truncation.png")


def list_row_cells(row: Row) -> list[object]:
    """In the order of HEADER.

    >>> list_row_cells(Row("haze L", "none", 8, "reflected", 0.5, 0.25, 1.0))
    ['haze L', 'none', 8, 'reflected', '0.5', '0.25', '1.000']
    """
    return [row.case, row.truncation, row.nodes, row.part, f"{row.largest:.3g}", f"{row.rms:.3g}", f"{row.seconds:.3f}"]


def make_error_table(rows: Sequence[Row]) -> str:
    """A line for each solve, a column for each part, largest and rms error in it.

    >>> print(make_error_table([Row("haze L", "none", 8, part, 0.5, 0.25, 1.0) for part in PARTS]).splitlines()[2])
    | haze L | 8 | none | 5e-01, 2e-01 | 5e-01, 2e-01 | 5e-01, 2e-01 | 1.00 |
    """
    solves: dict[tuple[str, int, str], list[Row]] = {}
    for row in rows:
        solves.setdefault((row.case, row.nodes, row.truncation), []).append(row)
    header = ["phase function", "nodes", "truncation", *PARTS, "seconds"]
    return make_markdown_table(
        header,
        [
            [*map(str, key), *(f"{row.largest:.0e}, {row.rms:.0e}" for row in found), f"{found[0].seconds:.2f}"]
            for key, found in solves.items()
        ],
    )


def draw_figure(errors: Sequence[Row], reference: Sequence[Row]) -> "Figure":
    """A line of panels for each case, a column for each part. Raises MissingExtraError without matplotlib."""
    require_pictures()
    from matplotlib.figure import Figure

    names = list(dict.fromkeys(row.case for row in errors))
    drawing = Figure(figsize=(9.5, 2.1 * len(names) + 0.8), facecolor="white")
    panels: Any = drawing.subplots(len(names), len(PARTS), sharex=True, sharey=True, squeeze=False)
    for line, case in zip(panels, names, strict=True):
        for panel, part in zip(line, PARTS, strict=True):
            draw_error_lines(panel, [row for row in errors if (row.case, row.part) == (case, part)])
            doubt = max((row.largest for row in reference if (row.case, row.part) == (case, part)), default=0.0)
            panel.axhspan(1e-9, max(doubt, 1e-9), color="#e8e8e8", zorder=0)
        line[0].set_ylabel(f"{case}\nerror of I / largest I")
    for panel, part in zip(panels[0], PARTS, strict=True):
        panel.set_title(part, fontsize=11)
    for panel in panels[-1]:
        panel.set_xlabel("nodes a hemisphere")
    panels[0, 0].legend(fontsize=8, frameon=False)
    drawing.suptitle("Largest (solid) and rms error (dotted); grey: below what the reference is known to", fontsize=11)
    drawing.tight_layout(rect=(0.0, 0.0, 1.0, 0.99))
    return drawing


def draw_error_lines(panel: Any, rows: Sequence[Row]) -> None:
    """Largest and rms error of each truncation against the nodes, both axes logarithmic."""
    for name, (colour, marker) in STYLES.items():
        chosen = [row for row in rows if row.truncation == name]
        nodes, style = [row.nodes for row in chosen], {"color": colour, "marker": marker, "markersize": 4}
        panel.plot(nodes, [row.largest for row in chosen], label=name, linewidth=1.6, **style)
        panel.plot(nodes, [row.rms for row in chosen], linewidth=1.0, linestyle=":", **style)
    panel.set_xscale("log", base=2)
    panel.set_yscale("log")
    panel.set_ylim(1e-8, 1e2)
    panel.set_xticks([4, 8, 16, 32, 64], ["4", "8", "16", "32", "64"])
    panel.grid(color="#d0d0d0", linewidth=0.5)


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line: ``-o FOLDER``, and ``--case NAME`` for one of them only."""
    parser = argparse.ArgumentParser(prog="python -m docs.scripts.truncation", description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("truncation"), help="folder to write to")
    parser.add_argument("--case", choices=[case.name for case in CASES], help="this one only")
    options = parser.parse_args(arguments)
    chosen = [case for case in CASES if options.case in (None, case.name)]
    errors, reference = zip(*map(measure_case_errors, chosen), strict=True)
    write_report([*chain(*errors)], [*chain(*reference)], options.output)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
