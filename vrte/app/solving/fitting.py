"""A fit of the form's numbers to a measurement, in the process that solves."""

import warnings
from collections.abc import Callable, Sequence

import numpy as np

from vrte.app.solving.downloads import collect_bytes
from vrte.app.solving.measuring import MOST_NOTES, choose_wavelength, read_bytes
from vrte.app.solving.messages import Fit, Fitted, Progress, Step
from vrte.basics.errors import IndistinguishableWarning, LongSolveWarning, MissingExtraError
from vrte.fit import run as least_squares
from vrte.fit.result import Fit as Result

SILENT = IndistinguishableWarning, LongSolveWarning  # the first is told among the sentences


def fit_scene(task: Fit, tell: Callable[[Progress], None], caught: Sequence[warnings.WarningMessage]) -> Fitted:
    """What a fit finds, each step told. Raises SceneError, KeyboardInterrupt before the first step."""
    tell(Progress(0.0, "reading the measurement"))
    measured = read_bytes(task.data, task.suffix)
    content, notes = choose_wavelength(task.content, measured)
    share = 0.0

    def progress(done: int, total: int) -> None:
        nonlocal share
        share = done / max(total, 1)

    def watch(step: least_squares.Step) -> None:
        stage = f"step {step.step}: χ² = {step.chi2:.5g}"
        tell(Step(share, stage, np.array([*step.values.values()]), step.chi2, np.array(step.predicted)))

    tell(Progress(0.0, "the scene as it is, and how it changes with each number"))
    found = least_squares.fit(measured, content, task.free, folder=task.folder, progress=progress, watch=watch)
    tell(Progress(1.0, "the page of the fit"))
    said = [str(one.message) for one in caught if not issubclass(one.category, SILENT)]
    notes = (*notes, *found.notes, *said)
    return Fitted(
        task.content,
        tuple(found.names),
        np.array(found.values),
        np.array(found.errors),
        np.array(found.correlations),
        found.chi2,
        np.array(found.predicted),
        found.blind_spots,
        write_page(found),
        tuple(dict.fromkeys(notes))[:MOST_NOTES],
    )


def write_page(found: Result) -> bytes:
    """The page of a fit, b"" where what draws it is not installed."""
    try:
        return collect_bytes("fit.html", found.page)
    except MissingExtraError:
        return b""
