"""A measurement beside what the form's scene shows at the same places, and the form's numbers fitted to it."""

import ast
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from vrte.app.form.content import Content, list_page_wavelengths, select_wavelength
from vrte.app.solving.tab_session import collect_bytes, read_bytes
from vrte.app.solving.worker import Exchange, Fitted, Message, Progress, Refused, Step, Task, explain_failure
from vrte.basics.arguments import check_arguments
from vrte.basics.arrays import Array, show_value
from vrte.basics.errors import IndistinguishableWarning, LongSolveWarning, MissingExtraError, SceneError
from vrte.fit import run as least_squares
from vrte.fit.curves import COORDINATES, DIGITS, find_axis, find_rows, name_bars, split_curves
from vrte.fit.instruments import KEYWORDS
from vrte.fit.measurement import COLUMNS, Measurement, read_measurement

LARGEST_MEASUREMENT = 2_000_000  # bytes: 20 000 rows or more
MOST_POINTS = 20_000  # rows that the page shows and fits
TEXTS = (".csv", ".txt", ".tsv", ".dat", ".asc", ".cgats", ".cxf", ".xml")
SUFFIXES = (*TEXTS, ".nc")
TEMPLATE = Path(__file__).parents[2] / "starters" / "measurement.csv"
FIRST = 1000  # bytes of a file in which a result says that it is one
Free = dict[str, dict[str, float]]  # start, low and high by each key
RESULT = b"# vrte result"  # what files of results begin with, behind their checksum


@dataclass(frozen=True, eq=False)
class Compared(Message):
    """The answer: what was measured, what the scene shows there, ``predicted`` (n,), and at more places, ``fine``; or
    ``message``, why it does not. Without a scene these are empty; ``follows``: another answer does."""

    measured: Measurement
    follows: bool = False
    predicted: Array | None = None
    fine: tuple[Measurement, Array] | None = None
    message: str = ""
    notes: tuple[str, ...] = ()


class Comparer:
    """Answers questions about measurements; the last one is not read again."""

    def __init__(self) -> None:
        self.read: tuple[tuple[bytes, str], Measurement] | None = None

    def answer(
        self, exchange: Exchange, content: Content | None, folder: Path, data: bytes, suffix: str, keywords: str = ""
    ) -> Message:
        """What the form's content, if right, shows beside a measurement's bytes, which ``keywords`` help to read; a new
        one is reported at once."""
        if self.read is None or self.read[0] != (data, keywords):
            self.read = (data, keywords), read_limited(data, suffix, keywords)
            exchange.report(Compared(self.read[1], follows=True))
        exchange.check()
        measured = self.read[1]
        if content is None:
            return Compared(measured)
        found = explain_failure(compare, Task("", content, folder, {"measured": measured}), Exchange(exchange.report))
        return Compared(measured, message=found.message) if isinstance(found, Refused) else found or Compared(measured)


def compare(exchange: Exchange, content: Content, folder: Path, measured: Measurement) -> Compared:
    """What the form's content shows beside a measurement. Raises SceneError."""
    chosen, notes = choose_wavelength(content, measured)
    predicted, fine = predict_rows(measured, chosen, folder)
    return Compared(measured, False, predicted, fine, notes=exchange.notes(LongSolveWarning, before=notes))


def is_measurement(data: bytes, suffix: str, wanted: bool) -> bool:
    """Whether a file is a measurement, not a result: any text that is none, NetCDF where it is ``wanted``."""
    is_result = any(line.startswith(RESULT) for line in data[:FIRST].split(b"\n")[:2])
    return (suffix in TEXTS and not is_result) or (wanted and suffix == ".nc")


def parse_keywords(text: str) -> dict[str, Any]:
    """Keywords of `vrte.read_measurement` as its errors write them. Raises SceneError.

    >>> parse_keywords("geometry='8:di', base={'over black': 0.0}")
    {'geometry': '8:di', 'base': {'over black': 0.0}}
    """
    with suppress(SyntaxError, ValueError, TypeError, MemoryError, RecursionError):
        call = ast.parse(f"read({text})", mode="eval").body
        if isinstance(call, ast.Call) and not call.args:
            found = {str(one.arg): ast.literal_eval(one.value) for one in call.keywords}
            if {*found} <= {*KEYWORDS}:
                return found
    words = "what the file leaves open must be written as geometry='8:di', sample='White', with"
    raise SceneError(f"{words} {', '.join(KEYWORDS)}, not {show_value(text)}")


def read_limited(data: bytes, suffix: str, keywords: str = "") -> Measurement:
    """A measurement's file, by its bytes. Raises SceneError."""
    found = read_bytes(data, suffix, partial(check_arguments(read_measurement), **parse_keywords(keywords)))
    if len(found) > MOST_POINTS:
        raise SceneError(f"the page takes at most {MOST_POINTS} numbers, not {len(found)}; `vrte fit` takes more")
    return found


def choose_wavelength(content: Content, measured: Measurement) -> tuple[Content, tuple[str, ...]]:
    """The content at one wavelength, where it has several, and a note where the measurement names none."""
    if not isinstance(content.get("wavelength_um"), (list, dict)):
        return content, ()
    first = list_page_wavelengths(content)[0]
    note = f"the measurement names no wavelength: the first of the form, {first:g} µm, is taken"
    return select_wavelength(content, first), (note,) if np.isnan(measured.wavelength_um).any() else ()


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


def fit_scene(
    exchange: Exchange, content: Content, folder: Path, data: bytes, suffix: str, free: Free, keywords: str = ""
) -> Fitted:
    """A fit of ``free`` numbers to a measurement, each step reported. Raises SceneError, KeyboardInterrupt."""
    exchange.report(Progress(0.0, "reading the measurement"))
    measured = read_limited(data, suffix, keywords)
    chosen, notes = choose_wavelength(content, measured)
    fraction = 0.0

    def progress(done: int, total: int) -> None:
        nonlocal fraction
        fraction = done / max(total, 1)

    def watch(step: least_squares.FitStep) -> None:
        stage = f"step {step.step}: χ² = {step.chi2:.5g}"
        exchange.report(Step(fraction, stage, np.array([*step.values.values()]), step.chi2, np.array(step.predicted)))

    exchange.report(Progress(0.0, "the scene as it is, and how it changes with each number"))
    found = least_squares.fit(measured, chosen, free, folder=folder, progress=progress, watch=watch)
    exchange.report(Progress(1.0, "the page of the fit"))
    page = b""
    with suppress(MissingExtraError):
        page = collect_bytes("fit.html", found.page)
    silent = IndistinguishableWarning, LongSolveWarning  # the first is a sentence of the fit already
    notes = exchange.notes(*silent, before=(*notes, *found.notes))
    values, errors, correlations = np.array(found.values), np.array(found.errors), np.array(found.correlations)
    fitted = values, errors, correlations, found.chi2, np.array(found.predicted)
    return Fitted(content, tuple(found.names), *fitted, found.blind_spots, notes, page)


HEADS = ("quantity", "points", "incidence", "exit", "azimuth", "wavelength", "base", "sigma")
COORDINATE_NAMES = ("theta_i_deg", "theta_o_deg", "phi_deg", "wavelength_um", "base")
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
    parts: list[tuple[Any, ...]] = []
    for quantity in measured.names:
        if find_axis(measured, quantity) != "theta_o_deg":
            continue
        for curve in split_curves(measured, quantity)[1]:
            x = np.union1d(np.linspace(curve.x[0], curve.x[-1], FINE).round(DIGITS), curve.x.round(DIGITS))
            first = curve.rows[0]
            phi = (float(measured.phi_deg[first]) + (180.0 if measured.theta_o_deg[first] < 0.0 else 0.0)) % 180.0
            theta_i, at = measured.theta_i_deg[first], (measured.wavelength_um[first], measured.base[first])
            parts += [(quantity, theta_i, abs(o), phi + (180.0 if o < 0.0 else 0.0), *at) for o in x.tolist()]
    if not 0 < len(parts) <= MOST_FINE:
        return None
    columns = zip(("quantity", *COORDINATE_NAMES), map(list, zip(*parts, strict=True)), strict=True)
    return Measurement(value=0.0, **dict(columns))


def describe_measured(measured: Measurement) -> Iterator[tuple[str, ...]]:
    """Rows of a table: quantity, number of points, angles, wavelengths, and whether their errors are known."""
    for quantity in measured.names:
        rows = find_rows(measured, quantity)
        units = {name: COORDINATES[name][2] if name in COORDINATES else "" for name in COORDINATE_NAMES}
        ranges = [write_range(getattr(measured, name)[rows], unit) for name, unit in units.items()]
        yield quantity, str(rows.size), *ranges, "yes" if measured.has_sigma else "no"


def write_range(column: Array, unit: str) -> str:
    """The range of a column and its number of values, as text."""
    values = np.unique(column[np.isfinite(column)].round(DIGITS))
    space = " " if unit == "µm" else ""
    if values.size == 0:
        return "–"
    if values.size == 1:
        return f"{values[0]:.4g}{space}{unit}"
    return f"{values[0]:.4g} to {values[-1]:.4g}{space}{unit} ({values.size})"
