"""Scenes with surfaces and their light to ten digits: files that hold both, computed again and compared.

A file of docs/reference/benchmarks/ is a table of numbers under a header in words, in which lines that are set in by
four spaces are the scene, as `vrte brdf` and `vrte field` read it: what is computed is what a reader sees.
"""

import csv
import math
import re
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from bench.study import Study, carry_out, make_command, run_command
from vrte.basics.arrays import Array
from vrte.basics.errors import AccuracyError, SceneError
from vrte.calls.brdf import brdf
from vrte.calls.radiance import radiance
from vrte.formats.atomic import read_text, write_atomically
from vrte.formats.scene_file import SceneFile, make_scene_file
from vrte.formats.toml_table import parse_toml
from vrte.results.brdf import Brdf
from vrte.results.field import Field

FOLDER = Path(__file__).parents[1] / "docs" / "reference" / "benchmarks"  # in the source tree alone
SET_IN = "#     "  # begins a line of the scene
KEYS = ("quantity", "mu_in", "mu_out", "phi_deg", "tau", "side", "incident")
STOKES = ("I", "Q", "U", "V")
DIGITS = 10  # of the largest number of a quantity, where a file does not say; all of its numbers have as many places
ROUNDING = 0.05  # of the last place: what computers may round otherwise
ACCURACY = 1e-13  # of the discrete problem
ALGORITHMS = ("modes", "doubling")
LARGEST_FILE = 10_000_000  # bytes

Key = tuple[str, ...]


@dataclass(frozen=True)
class Benchmark:
    """A file: its ``header`` without the signs of comments, and numbers as texts by what they are of, in order."""

    path: Path
    header: str
    numbers: dict[Key, list[str]]

    @property
    def digits(self) -> int:
        """How many of the largest number of a quantity it tells."""
        found = re.search(r"^ Digits: (\d+)$", self.header, re.MULTILINE)
        return int(found[1]) if found else DIGITS

    @property
    def name(self) -> str:
        """The file's, without suffix."""
        return self.path.stem

    def make_files(self) -> list[SceneFile]:
        """The scene, once for what is asked of its BRDF and once for its field."""
        lines = [line.removeprefix(SET_IN[1:]) for line in self.header.splitlines() if line.startswith(SET_IN[1:])]
        content = parse_toml("\n".join(lines))
        kinds = [kind for kind in ("brdf", "field") if kind in content]
        if not kinds:
            raise SceneError(f"{self.path.name}: the scene asks for nothing: it needs [brdf] or [field]")
        return [make_scene_file(content, kind, self.path.parent) for kind in kinds]


@dataclass(frozen=True)
class Comparison:
    """What became of a benchmark: ``largest``, by algorithm, the largest change in units of the last place;
    ``changed``, what is not as it was, in words; ``seconds`` of wall time; ``made``, the file as the first
    algorithm has it."""

    name: str
    nodes: int
    numbers: int
    largest: dict[str, float]
    changed: list[str]
    seconds: float
    made: Benchmark


def find_benchmarks(folder: Path | None = None, scene: str | None = None) -> list[Path]:
    """The files of a folder, by default the source tree's; ``scene``: that of this name alone. Raises SceneError.

    >>> len(find_benchmarks(scene="plate"))
    1
    """
    index = folder or FOLDER
    found = [path for path in sorted(index.glob("*.csv")) if is_benchmark(path)]
    if not found:
        raise SceneError(f"no benchmarks in {index}")
    chosen = [path for path in found if scene in (None, path.stem)]
    if not chosen:
        raise SceneError(f"--scene must be one of {', '.join(path.stem for path in found)}, not {scene!r}")
    return chosen


def is_benchmark(path: Path) -> bool:
    """Whether it is one, and not a table of coefficients beside them."""
    return any(line == ",".join([*KEYS, *STOKES]) for line in read_text(path, LARGEST_FILE).splitlines())


def read_benchmark(path: Path) -> Benchmark:
    """A file as it is. Raises SceneError, OSError."""
    lines = read_text(path, LARGEST_FILE).splitlines()
    rows = list(csv.reader(line for line in lines if line and not line.startswith("#")))[1:]
    if any(len(row) != len(KEYS) + len(STOKES) for row in rows):
        raise SceneError(f"{path.name}: every row must have {len(KEYS) + len(STOKES)} cells")
    numbers = {tuple(row[: len(KEYS)]): row[len(KEYS) :] for row in rows}
    return Benchmark(path, "\n".join(line[1:] for line in lines if line.startswith("#")), numbers)


def write_benchmark(benchmark: Benchmark, folder: Path) -> Path:
    """The file, all of it or nothing. Raises OSError."""
    path = folder / benchmark.path.name
    with write_atomically(path) as part, open(part, "w", encoding="utf-8", newline="") as file:
        file.writelines(f"#{line}\n" for line in benchmark.header.splitlines())
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([*KEYS, *STOKES])
        writer.writerows([*key, *values] for key, values in benchmark.numbers.items())
    return path


def compute_numbers(benchmark: Benchmark, algorithm: str, threads: int | None = None) -> dict[Key, Array]:
    """All numbers of a benchmark, computed again by an algorithm: (4,) each, NaN where there is none."""
    found: dict[Key, Array] = {}
    for file in benchmark.make_files():
        how = file.keywords({"algorithm": algorithm, "accuracy": ACCURACY, "threads": threads})
        if file.kind == "brdf":
            found |= list_brdf_numbers(brdf(file.scene, **how))
            continue
        field = radiance(file.scene, **how)
        found |= list_field_numbers(field, "above")
        if file.scene.has_interfaces:
            below = radiance(file.scene, **how, side="below")
            assert field.index is not None
            assert below.index is not None
            found |= list_field_numbers(below, "below", below.index != field.index)
    return found


def list_brdf_numbers(found: Brdf) -> dict[Key, Array]:
    """What leaves a scene: matrices by columns, light for an irradiance or a power of 1 in one Stokes parameter."""
    numbers: dict[Key, Array] = {}
    for name in ("mueller", "transmission", "surface", "specular", "specular_transmission"):
        matrices = getattr(found, name)
        for index in () if matrices is None else np.ndindex(matrices.shape[:-2]):
            cosines = [show_key(axis[k]) for axis, k in zip((found.mu_i, found.mu_o, found.phi), index, strict=False)]
            cosines += [""] * (3 - len(cosines))  # of beams the incident one alone
            for column, parameter in enumerate(STOKES):
                numbers[(name, *cosines, "", "", parameter)] = matrices[index][:, column]
    for mu, fraction in zip(found.mu_i, found.reflectance, strict=True):
        numbers[("reflectance", show_key(mu), "", "", "", "", "I")] = make_single(fraction)
    return numbers


def list_field_numbers(found: Field, side: str, chosen: Any = True) -> dict[Key, Array]:
    """The field at the ``chosen`` (tau,) of its depths, on one side of interfaces."""
    numbers: dict[Key, Array] = {}
    mu0 = show_key(float(found.mu0))
    for depth in np.flatnonzero(np.broadcast_to(chosen, found.tau.shape)):
        tau = show_key(found.tau[depth])
        for name in ("flux_up", "flux_down", "direct_up", "direct"):
            values = getattr(found, name)
            if values is not None:
                numbers[(name, mu0, "", "", tau, side, "")] = make_single(values[depth])
        for k, mu in enumerate(found.mu):
            for p, phi in enumerate(found.phi):
                numbers[("radiance", mu0, show_key(mu), show_key(phi), tau, side, "")] = found.stokes[depth, k, p]
    return numbers


def make_single(value: float) -> Array:
    """A number that has no polarization, in the place of I."""
    return np.array([value, math.nan, math.nan, math.nan])


def show_key(value: float) -> str:
    """A number of the set-up, as short as it can be told.

    >>> show_key(0.25), show_key(180.0)
    ('0.25', '180')
    """
    return f"{value:.15g}"


def show_numbers(numbers: dict[Key, Array], digits: int = DIGITS) -> dict[Key, list[str]]:
    """Texts of as many places for each quantity as its largest number takes for so many digits; "" for none.

    >>> show_numbers({("flux",): np.array([0.0123456789012, -1e-16, 0.0, math.nan])})
    {('flux',): ['0.01234567890', '0.00000000000', '0.00000000000', '']}
    """
    largest: dict[str, float] = {}
    for key, values in numbers.items():
        largest[key[0]] = max(largest.get(key[0], 0.0), float(np.nanmax(np.abs(values))))
    found = {}
    for key, values in numbers.items():
        size = largest[key[0]]
        indices = digits - 1 - math.floor(math.log10(size)) if size > 0.0 else digits
        texts = ["" if math.isnan(value) else f"{value:.{indices}f}" for value in values]
        found[key] = [text.lstrip("-") if text and float(text) == 0.0 else text for text in texts]
    return found


def find_changes(written: dict[Key, list[str]], numbers: dict[Key, Array]) -> tuple[float, list[str]]:
    """The largest change in units of the last place written, and what is not as it was, in words.

    >>> find_changes({("flux",): ["0.12", "", "", ""]}, {("flux",): np.array([0.131, *3 * [math.nan]])})[1]
    ['flux I: 0.12 has become 0.131']
    """
    changed = [f"{' '.join(filter(None, key))}: not there any more" for key in written if key not in numbers]
    changed += [f"{' '.join(filter(None, key))}: not in the file" for key in numbers if key not in written]
    largest = 0.0
    for key, values in numbers.items():
        for name, text, value in zip(STOKES, written.get(key, []), values, strict=False):
            if not text and math.isnan(value):
                continue
            unit = 10.0 ** -len(text.partition(".")[2])
            change = abs(float(text or "nan") - value) / unit
            largest = max(largest, change)
            if not change <= 0.5 + ROUNDING:
                changed.append(f"{' '.join(filter(None, key))} {name}: {text or 'nothing'} has become {value:.15g}")
    return largest, changed


def compare_benchmark(path: Path, threads: int | None = None) -> Comparison:
    """A benchmark computed again by both algorithms, on graded nodes by doubling alone."""
    start = time.perf_counter()
    benchmark = read_benchmark(path)
    largest, changed = {}, []
    options = benchmark.make_files()[0].options
    algorithms = ALGORITHMS if options.get("grading", 1) == 1 else ALGORITHMS[1:]  # modes lose digits on graded nodes
    answers = {algorithm: compute_numbers(benchmark, algorithm, threads) for algorithm in algorithms}
    made = replace(benchmark, numbers=show_numbers(answers[algorithms[0]], benchmark.digits))
    for algorithm, numbers in answers.items():
        largest[algorithm], found = find_changes(benchmark.numbers, numbers)
        changed += [f"{benchmark.name}, {algorithm}: {text}" for text in found]
    nodes = int(options.get("nodes", 0))
    count = sum(text != "" for texts in benchmark.numbers.values() for text in texts)
    return Comparison(benchmark.name, nodes, count, largest, changed, time.perf_counter() - start, made)


def describe_comparisons(found: Sequence[Comparison]) -> str:
    """A table for a terminal."""
    width = max(len(one.name) for one in found)
    head = f"  {'scene':{width}}  nodes  numbers  " + "  ".join(f"{name:>8}" for name in ALGORITHMS)
    lines = [
        f"  {one.name:{width}}  {one.nodes:5}  {one.numbers:7}  "
        + "  ".join(f"{one.largest[name]:8.2f}" if name in one.largest else f"{'':8}" for name in ALGORITHMS)
        + f"  {one.seconds:7.1f}  {f'{len(one.changed)} changed' if one.changed else 'unchanged'}"
        for one in found
    ]
    reported = "  largest change by each algorithm in units of the last place told; rounding alone is 0.50"
    return "\n".join(
        [f"{head}  seconds", *lines, reported, *(f"  {text}" for one in found for text in one.changed[:5])]
    )


def require_unchanged(found: Sequence[Comparison]) -> None:
    """Raises AccuracyError, naming the first, where a number is not as it was."""
    changed = [text for one in found for text in one.changed]
    if changed:
        raise AccuracyError(f"{len(changed)} numbers are not as they were, the first: {changed[0]}")


def compare_all(options: Any) -> None:
    """The study that the command line asks for."""

    def write(found: Sequence[Comparison], folder: Path, settings: str) -> list[Path]:
        return [write_benchmark(one.made, folder) for one in found]

    study = Study(
        cases=find_benchmarks(options.folder, options.scene),
        ways=lambda path: [options.threads],
        measure=lambda path, threads, number: compare_benchmark(path, threads),
        name=lambda path, threads: path.stem,
        page=write,
        describe=describe_comparisons,
        require=require_unchanged,
    )
    carry_out(study, options.output)


def main(arguments: Sequence[str] | None = None) -> int:
    """Computes the benchmarks again; returns the exit code."""
    command = make_command(
        "benchmarks",
        "ten scenes with surfaces to ten digits, computed again",
        ("python -m bench.benchmarks", "all of them, compared with their tables"),
        ("python -m bench.benchmarks --scene mirror -o again", "one of them, and its table written anew"),
    )
    command.add_argument("--scene", metavar="NAME", help="this one alone")
    command.add_argument("--folder", metavar="FOLDER", type=Path, help="where they are; default: the source tree's")
    command.add_argument("-o", "--output", metavar="FOLDER", type=Path, help="writes them there as they come out")
    command.take_options("threads")
    return run_command(command, compare_all, arguments)


if __name__ == "__main__":
    sys.exit(main())
