"""A measurement beside what the form's scene shows at the same places, worked out anew as somebody changes the form."""

import tempfile
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vrte.app.form.content import Content, list_page_wavelengths, select_wavelength
from vrte.app.solving.measured import refine_curves
from vrte.app.solving.questions import Refused, explain_failure
from vrte.basics.arrays import Array
from vrte.basics.errors import LongSolveWarning, SceneError
from vrte.fit.measurement import COLUMNS, Measurement, read_measurement

LARGEST_MEASUREMENT = 2_000_000  # bytes: 20 000 rows or more
MOST_POINTS = 20_000  # rows that the page shows and fits
SUFFIXES = (".csv", ".nc")
MOST_NOTES = 30
FIRST = 100_000  # bytes of a file in which its columns are named
RESULT = "# vrte result"  # what files of results begin with, behind their checksum


@dataclass(frozen=True)
class Comparison:
    """A question: a measurement's file, its bytes, and the form's content to be beside it, None while that is wrong."""

    number: int
    content: Content | None
    folder: Path
    data: bytes
    suffix: str


@dataclass(frozen=True, eq=False)
class Compared:
    """The answer: what was measured, what the scene shows there, ``predicted`` (n,), and at more places, ``fine``; or
    ``message``, why it does not. Without a scene these are empty; ``follows``: another answer does."""

    number: int
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

    def answer(self, question: Comparison, tell: Callable[[Any], None], is_old: Callable[[], bool]) -> None:
        """Tells an answer; a new measurement at once, before the scene is solved."""
        number, begin = question.number, time.perf_counter()

        def read() -> None:
            if self.read is None or self.read[0] != question.data:
                self.read = question.data, read_bytes(question.data, question.suffix)
                tell(Compared(number, self.read[1], follows=True))

        if message := explain_failure(read, question.folder):
            tell(Refused(number, message))
        if message or self.read is None or is_old():
            return
        measured, found = self.read[1], list[Compared]()

        def compare() -> None:
            if question.content is None:
                return
            content, notes = choose_wavelength(question.content, measured)
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always", UserWarning)
                predicted, fine = predict_rows(measured, content, question.folder)
            notes += tuple(str(one.message) for one in caught if not issubclass(one.category, LongSolveWarning))
            seconds, notes = time.perf_counter() - begin, tuple(dict.fromkeys(notes))[:MOST_NOTES]
            found.append(Compared(number, measured, False, predicted, fine, "", seconds, notes))

        message = explain_failure(compare, question.folder)
        tell(found[0] if found else Compared(number, measured, message=message))


def is_measurement(data: bytes, suffix: str, wanted: bool) -> bool:
    """Whether a file is a measurement, not a result: by its columns, or because that is ``wanted`` and it is no result.

    >>> is_measurement(b"# a panel\\nquantity, value\\nf00, 0.1\\n", ".csv", wanted=False)
    True
    """
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
