"""A measurement beside what the form's scene shows at the same places, and the form's numbers fitted to it."""

import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from vrte.app.form.content import Content, list_page_wavelengths, select_wavelength
from vrte.app.solving.messages import Fit, Fitted, Message, Progress, Refused, Step
from vrte.app.solving.page_files import collect_bytes
from vrte.app.solving.worker import MOST_NOTES, Exchange, explain_failure
from vrte.basics.arrays import Array
from vrte.basics.errors import IndistinguishableWarning, LongSolveWarning, MissingExtraError, SceneError
from vrte.fit import run as least_squares
from vrte.fit.curves import COORDINATES, DIGITS, find_axis, find_rows, name_bars, split_curves
from vrte.fit.measurement import COLUMNS, Measurement, read_measurement

LARGEST_MEASUREMENT = 2_000_000  # bytes: 20 000 rows or more
MOST_POINTS = 20_000  # rows that the page shows and fits
SUFFIXES = (".csv", ".nc")
FIRST = 100_000  # bytes of a file in which its columns are named
RESULT = "# vrte result"  # what files of results begin with, behind their checksum


@dataclass(frozen=True)
class Comparison:
    """A question: a measurement's file, its bytes, and the form's content to be beside it, None while that is wrong."""

    content: Content | None
    folder: Path
    data: bytes
    suffix: str


@dataclass(frozen=True, eq=False)
class Compared(Message):
    """The answer: what was measured, what the scene shows there, ``predicted`` (n,), and at more places, ``fine``; or
    ``message``, why it does not. Without a scene these are empty; ``follows``: another answer does."""

    measured: Measurement
    follows: bool = False
    predicted: Array | None = None
    fine: tuple[Measurement, Array] | None = None
    message: str = ""
    seconds: float = 0.0
    notes: tuple[str, ...] = ()


class Comparer:
    """Answers questions about measurements; the last one is not read again."""

    def __init__(self) -> None:
        self.read: tuple[bytes, Measurement] | None = None

    def answer(self, question: Comparison, exchange: Exchange) -> Message:
        """A new measurement is reported at once, before the scene is solved."""
        begin = time.perf_counter()
        if self.read is None or self.read[0] != question.data:
            self.read = question.data, read_bytes(question.data, question.suffix)
            exchange.report(Compared(self.read[1], follows=True))
        exchange.check()
        measured = self.read[1]
        found = explain_failure(partial(self._compare, measured), question, Exchange(exchange.report))
        if isinstance(found, Compared):
            return replace(found, seconds=time.perf_counter() - begin)
        return Compared(measured, message=found.message if isinstance(found, Refused) else "")

    def _compare(self, measured: Measurement, question: Comparison, exchange: Exchange) -> Compared:
        if question.content is None:
            return Compared(measured)
        content, notes = choose_wavelength(question.content, measured)
        predicted, fine = predict_rows(measured, content, question.folder)
        notes += exchange.notes(LongSolveWarning)
        return Compared(measured, predicted=predicted, fine=fine, notes=tuple(dict.fromkeys(notes))[:MOST_NOTES])


def is_measurement(data: bytes, suffix: str, wanted: bool) -> bool:
    """Whether a file is a measurement, not a result: by its columns, or if that is ``wanted`` and it is no result."""
    lines = [line.strip() for line in data[:FIRST].split(b"\n")]
    if suffix != ".csv" or any(line.startswith(RESULT.encode()) for line in lines[:2]):
        return wanted and suffix == ".nc"
    header = next((line for line in lines if line and not line.startswith(b"#")), b"")
    return wanted or {b"quantity", b"value"} <= {name.strip() for name in header.split(b",")}


def read_bytes(data: bytes, suffix: str) -> Measurement:
    """A measurement's file, through a folder of its own. Raises SceneError."""
    with tempfile.TemporaryDirectory(prefix="vrte-view-") as folder:
        path = Path(folder) / f"measurement{suffix}"
        path.write_bytes(data)
        try:
            found = read_measurement(path)
        except SceneError as error:
            raise SceneError(str(error).replace(str(path), "the file")) from error
    if len(found) > MOST_POINTS:
        raise SceneError(f"the page takes at most {MOST_POINTS} numbers, not {len(found)}; `vrte fit` takes more")
    return found


def choose_wavelength(content: Content, measured: Measurement) -> tuple[Content, tuple[str, ...]]:
    """The content at one of its wavelengths, where it has several and the measurement names none; and that this is so.

    >>> seen = Measurement("total_reflectance", 0.5, theta_i_deg=8.0)
    >>> choose_wavelength({"wavelength_um": [0.5, 0.6]}, seen)
    ({'wavelength_um': 0.5}, ('the measurement names no wavelength: the first of the form, 0.5 µm, is taken',))
    """
    several = isinstance(content.get("wavelength_um"), (list, dict))
    if not several:
        return content, ()
    first = list_page_wavelengths(content)[0]
    unnamed = "the measurement names no wavelength: " if np.isnan(measured.wavelength_um).any() else ""
    notes = (f"{unnamed}the first of the form, {first:g} µm, is taken",) if unnamed else ()
    return select_wavelength(content, first), notes


def predict_rows(
    measured: Measurement, content: Content, folder: Path
) -> tuple[Array, tuple[Measurement, Array] | None]:
    """What a scene shows at a measurement's places, and at more of them for smooth curves. Raises SceneError."""
    more = refine_curves(measured)
    if more is None:
        return measured.predict(content, folder=folder), None
    columns = {name: np.concatenate([getattr(measured, name), getattr(more, name)]) for name in COLUMNS}
    both = Measurement(**{**columns, "sigma": None}).predict(content, folder=folder)
    return both[: len(measured)], (more, both[len(measured) :])


def fit_scene(task: Fit, exchange: Exchange) -> Fitted:
    """What a fit finds, each step reported. Raises SceneError, KeyboardInterrupt before the first step."""
    exchange.report(Progress(0.0, "reading the measurement"))
    measured = read_bytes(task.data, task.suffix)
    content, notes = choose_wavelength(task.content, measured)
    fraction = 0.0

    def progress(done: int, total: int) -> None:
        nonlocal fraction
        fraction = done / max(total, 1)

    def watch(step: least_squares.FitStep) -> None:
        stage = f"step {step.step}: χ² = {step.chi2:.5g}"
        exchange.report(Step(fraction, stage, np.array([*step.values.values()]), step.chi2, np.array(step.predicted)))

    exchange.report(Progress(0.0, "the scene as it is, and how it changes with each number"))
    found = least_squares.fit(measured, content, task.free, folder=task.folder, progress=progress, watch=watch)
    exchange.report(Progress(1.0, "the page of the fit"))
    page = b""
    with suppress(MissingExtraError):
        page = collect_bytes("fit.html", found.page)
    notes = (
        *notes,
        *found.notes,
        *exchange.notes(IndistinguishableWarning, LongSolveWarning),
    )  # the first is a sentence already
    return Fitted(
        task.content,
        tuple(found.names),
        np.array(found.values),
        np.array(found.errors),
        np.array(found.correlations),
        found.chi2,
        np.array(found.predicted),
        found.blind_spots,
        page,
        tuple(dict.fromkeys(notes))[:MOST_NOTES],
    )


HEADS = ("quantity", "points", "incidence", "exit", "azimuth", "wavelength", "sigma")
TOLD = ("theta_i_deg", "theta_o_deg", "phi_deg", "wavelength_um")
FINE = 61  # points of a curve from its first to its last angle
MOST_FINE = 1500  # directions that are worth a finer curve


def list_shown(measured: Measurement) -> list[str]:
    """What there is to look at: each quantity along its axis; those of single numbers together."""
    along = [name for name in measured.names if find_axis(measured, name)]
    kinds = dict.fromkeys(name_bars(name) for name in measured.names if name not in along)
    return [*along, *kinds]


def refine_curves(measured: Measurement) -> Measurement | None:
    """The same quantities at more angles of exit, for smooth curves; None where none runs along one, or many do.

    Other axes stay as they are: more wavelengths or angles of incidence would take more solves.
    """
    parts: list[dict[str, Any]] = []
    for quantity in measured.names:
        if find_axis(measured, quantity) != "theta_o_deg":
            continue
        for curve in split_curves(measured, quantity)[1]:
            x = np.union1d(np.linspace(curve.x[0], curve.x[-1], FINE).round(DIGITS), curve.x.round(DIGITS))
            first = curve.rows[0]
            phi = float(measured.phi_deg[first]) + (180.0 if measured.theta_o_deg[first] < 0.0 else 0.0)
            parts += [
                {
                    "quantity": quantity,
                    "theta_i_deg": measured.theta_i_deg[first],
                    "theta_o_deg": abs(angle),
                    "phi_deg": phi % 180.0 + (180.0 if angle < 0.0 else 0.0),
                    "wavelength_um": measured.wavelength_um[first],
                }
                for angle in x.tolist()
            ]
    if not 0 < len(parts) <= MOST_FINE:
        return None
    columns = {name: [part[name] for part in parts] for name in parts[0]}
    return Measurement(value=0.0, **columns)


def describe_measured(measured: Measurement) -> Iterator[tuple[str, ...]]:
    """Rows of a table: quantity, number of points, angles, wavelengths, and whether their errors are known."""
    for quantity in measured.names:
        rows = find_rows(measured, quantity)
        ranges = [write_range(getattr(measured, name)[rows], COORDINATES[name][2]) for name in TOLD]
        yield quantity, str(rows.size), *ranges, "yes" if measured.has_sigma else "no"


def write_range(column: Array, unit: str) -> str:
    """From where to where a column goes, and how many values it has.

    >>> write_range(np.array([0.4, 0.5, 0.5]), "µm"), write_range(np.array([np.nan]), "°")
    ('0.4 to 0.5 µm (2)', '–')
    """
    values = np.unique(column[np.isfinite(column)].round(DIGITS))
    space = "" if unit == "°" else " "
    if values.size == 0:
        return "–"
    if values.size == 1:
        return f"{values[0]:.4g}{space}{unit}"
    return f"{values[0]:.4g} to {values[-1]:.4g}{space}{unit} ({values.size})"
