"""Error of the radiance against the number of nodes for peaked phase functions, the truncations side by side.

``python -m vrte.studies.truncation -o FOLDER`` writes truncation.csv, truncation.md and truncation.png there. Every
scene is one conservative layer, lit by one unpolarized beam with mu0 = 0.6; its thickness times 1 - g is 0.5, so all
turn about as much light away.
"""

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import AccuracyError, MissingExtraError
from vrte.calls.radiance import radiance
from vrte.formats.atomic import atomic_write
from vrte.optics.phase_matrix import PhaseMatrix, henyey_greenstein
from vrte.optics.size_distribution import Gamma
from vrte.optics.spheres import spheres
from vrte.optics.truncation import TRUNCATIONS
from vrte.scene.layer import Layer
from vrte.scene.scene import Scene
from vrte.studies.stability.phases import haze_l

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MU0 = 0.6
MU = np.linspace(0.05, 1.0, 20)
PHI = np.array([0.0, 5.0, 15.0, 30.0, 60.0, 90.0, 135.0, 180.0])
NEAR_DEG = 10.0  # from the beam's own direction
PARTS = ("reflected", "transmitted aside", "transmitted near the beam")
COLOURS = {"none": "#8c8c8c", "delta-m": "#d98200", "small-angle": "#1f4e79"}
MARKERS = {"none": "x", "delta-m": "o", "small-angle": "s"}


@dataclass(frozen=True)
class Case:
    """One layer, the numbers of nodes to try, and the two that the reference takes, the finer one last.

    ``resolved``: the reference carries all terms of the phase function.
    """

    name: str
    matrix: Callable[[], PhaseMatrix]
    thickness: float
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


def cloud_c1() -> PhaseMatrix:
    """Deirmendjian's cloud C1, water spheres at 0.7 um: number density r^6 exp(-1.5 r), r in um, mode at 4 um.

    Source: D. Deirmendjian, Electromagnetic Scattering on Spherical Polydispersions (1969).
    """
    return spheres(1.33, size=Gamma(r_eff_um=6.0, v_eff=1.0 / 9.0), wavelength_um=0.7).phase_matrix


def rounded_henyey_greenstein(g: float, terms: int, width: float) -> PhaseMatrix:
    """a1[l] = (2l+1) g^l exp(-width^2 l (l+1)/2): the function's peak rounded by a Gaussian of ``width`` [rad].

    So it ends with fewer terms than it would otherwise take, and stays positive.

    >>> round(rounded_henyey_greenstein(0.5, 60, 0.01).asymmetry, 6)
    0.49995
    """
    degrees = np.arange(terms, dtype=float)
    return PhaseMatrix((2.0 * degrees + 1.0) * g**degrees * np.exp(-0.5 * width**2 * degrees * (degrees + 1.0)))


CASES = (
    Case("haze L", haze_l, 2.5, (4, 6, 8, 12, 16, 24), (40, 50), resolved=True),
    Case("cloud C1", cloud_c1, 3.3, (4, 8, 16, 32, 64), (80, 100)),
    Case("g = 0.9", lambda: henyey_greenstein(0.9, 200), 5.0, (4, 8, 16, 32, 64), (100, 110), resolved=True),
    Case("g = 0.99", lambda: henyey_greenstein(0.99, 2000), 50.0, (4, 8, 16, 32, 64), (100, 128)),
    Case("g = 0.9999", lambda: rounded_henyey_greenstein(0.9999, 100_000, 8e-5), 5e3, (4, 8, 16, 32, 64), (100, 128)),
)


def measure(case: Case, progress: Callable[[str], Any] = print) -> tuple[list[Row], list[Row]]:
    """The errors of every truncation and number of nodes; and what the reference differs by from the same with fewer
    nodes and, where it does not carry all terms, from delta-M with as many nodes."""
    scene = Scene([Layer(case.matrix(), 1.0, case.thickness)])
    coarse, fine = case.reference
    name = "none" if case.resolved else "small-angle"
    exact, _ = intensity(scene, fine, name)
    doubt = [(name, coarse)] if case.resolved else [(name, coarse), ("delta-m", fine)]

    def errors(tried: list[tuple[str, int]]) -> list[Row]:
        rows: list[Row] = []
        for truncation, nodes in tried:
            try:
                values, seconds = intensity(scene, nodes, truncation)
            except AccuracyError:
                progress(f"{case.name}, {truncation}, {nodes} nodes: refused, neither algorithm vouches for it")
                continue
            progress(f"{case.name}, {truncation}, {nodes} nodes: {seconds:.2f} s")
            rows += compared(case.name, truncation, nodes, values, exact, seconds)
        return rows

    return errors([(name, nodes) for nodes in case.nodes for name in TRUNCATIONS]), errors(doubt)


def intensity(scene: Scene, nodes: int, truncation: str) -> tuple[Array, float]:
    """Diffuse I, up at the top and down at the bottom: (2, mu, phi); and the seconds it took."""
    start, bottom = time.perf_counter(), scene.thickness
    field = radiance(
        scene, MU0, mu=np.concatenate([MU, -MU]), phi=PHI, tau=[0.0, bottom], nodes=nodes, truncation=truncation
    )
    seconds = time.perf_counter() - start
    return np.stack([field.stokes[0, : MU.size, :, 0], field.stokes[1, MU.size :, :, 0]]), seconds


def compared(case: str, truncation: str, nodes: int, values: Array, exact: Array, seconds: float) -> list[Row]:
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
    for name, content in (("truncation.csv", as_csv(errors)), ("truncation.md", as_markdown(errors, reference))):
        with atomic_write(folder / name) as part:
            part.write_text(content)
    with atomic_write(folder / "truncation.png") as part:
        in_few_colours(figure(errors, reference)).save(part, format="png", optimize=True)


def as_csv(rows: Sequence[Row]) -> str:
    """A line a row.

    >>> as_csv([Row("haze L", "none", 8, "reflected", 0.5, 0.25, 1.0)]).splitlines()[1]
    'haze L,none,8,reflected,0.5,0.25,1.000'
    """
    head = "case,truncation,nodes,part,largest_error,rms_error,seconds"
    lines = [
        f"{row.case},{row.truncation},{row.nodes},{row.part},{row.largest:.3g},{row.rms:.3g},{row.seconds:.3f}"
        for row in rows
    ]
    return "\n".join([head, *lines]) + "\n"


def as_markdown(errors: Sequence[Row], reference: Sequence[Row]) -> str:
    """Two tables: the errors, largest and rms, and what the references are worth."""
    return f"{table(errors)}\nReferences:\n\n{table(reference)}"


def table(rows: Sequence[Row]) -> str:
    """A line for each solve, a column for each part.

    >>> print(table([Row("haze L", "none", 8, part, 0.5, 0.25, 1.0) for part in PARTS]).splitlines()[2])
    | haze L | 8 | none | 5e-01, 2e-01 | 5e-01, 2e-01 | 5e-01, 2e-01 | 1.00 |
    """
    lines = [f"| phase function | nodes | truncation | {' | '.join(PARTS)} | seconds |", "|---" * 7 + "|"]
    for row in rows:
        if row.part == PARTS[0]:
            same = [
                other
                for other in rows
                if (other.case, other.truncation, other.nodes) == (row.case, row.truncation, row.nodes)
            ]
            shown = " | ".join(f"{other.largest:.0e}, {other.rms:.0e}" for other in same)
            lines.append(f"| {row.case} | {row.nodes} | {row.truncation} | {shown} | {row.seconds:.2f} |")
    return "\n".join(lines) + "\n"


def figure(errors: Sequence[Row], reference: Sequence[Row]) -> "Figure":
    """A line of panels for each case, a column for each part. Raises MissingExtraError without matplotlib."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingExtraError("a picture", "plot") from error
    cases = list(dict.fromkeys(row.case for row in errors))
    drawing = Figure(figsize=(9.5, 2.1 * len(cases) + 0.8), dpi=90, facecolor="white")
    FigureCanvasAgg(drawing)
    panels: Any = drawing.subplots(len(cases), len(PARTS), sharex=True, sharey=True, squeeze=False)
    for line, case in zip(panels, cases, strict=True):
        for panel, part in zip(line, PARTS, strict=True):
            draw(panel, [row for row in errors if (row.case, row.part) == (case, part)])
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


def in_few_colours(drawing: "Figure") -> Any:
    """A picture of 32 colours, a third of the size in a file; a PIL.Image, which comes with matplotlib."""
    from PIL import Image

    drawing.canvas.draw()
    canvas: Any = drawing.canvas
    return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB").quantize(32)


def draw(panel: Any, rows: Sequence[Row]) -> None:
    """Largest and rms error of each truncation against the nodes, both axes logarithmic."""
    for name, colour in COLOURS.items():
        chosen = [row for row in rows if row.truncation == name]
        nodes = [row.nodes for row in chosen]
        style = {"color": colour, "marker": MARKERS[name], "markersize": 4}
        panel.plot(nodes, [row.largest for row in chosen], label=name, linewidth=1.6, **style)
        panel.plot(nodes, [row.rms for row in chosen], linewidth=1.0, linestyle=":", **style)
    panel.set_xscale("log", base=2)
    panel.set_yscale("log")
    panel.set_ylim(1e-8, 1e2)
    panel.set_xticks([4, 8, 16, 32, 64], ["4", "8", "16", "32", "64"])
    panel.grid(color="#d0d0d0", linewidth=0.5)


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line: ``-o FOLDER``, and ``--case NAME`` for one of them only."""
    parser = argparse.ArgumentParser(
        prog="python -m vrte.studies.truncation", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("-o", "--output", type=Path, default=Path("truncation"), help="folder to write to")
    parser.add_argument("--case", choices=[case.name for case in CASES], help="this one only")
    options = parser.parse_args(arguments)
    errors: list[Row] = []
    reference: list[Row] = []
    for case in CASES:
        if options.case in (None, case.name):
            more, doubt = measure(case)
            errors += more
            reference += doubt
    write_report(errors, reference, options.output)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
