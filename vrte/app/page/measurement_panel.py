"""The tab that shows a measurement over the scene of the form, and fits the scene's numbers to it."""

import re
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import ui

from vrte.app.form.checks import write_content
from vrte.app.form.numbers import list_free_numbers, put_values
from vrte.app.page import controls
from vrte.app.page.controls import add_bullets, add_button, add_heading, add_message, add_note, add_table, show
from vrte.app.page.free_numbers import FreeNumbers, ValueTaker, find_places, replace_keys, write_digits
from vrte.app.solving import measuring
from vrte.app.solving.measuring import Compared
from vrte.app.solving.worker import Fitted, Refused
from vrte.basics.errors import SceneError
from vrte.pictures.fit import SCENE, measurement

LOOK_EVERY = 0.1  # seconds between two looks whether something has come
NOTHING = (
    "Drop a measurement on the page, or open one: the text of a spectrophotometer or a goniometer, CGATS or CxF; "
    "a table with the columns quantity, value, and what is known of each row; or NetCDF."
)
LEFT_OPEN = "what the file leaves open"
SUFFIXES, LARGEST = measuring.SUFFIXES, measuring.LARGEST_MEASUREMENT
TOO_LARGE = f"a measurement must be a file of at most {LARGEST / 1e6:g} MB, {' or '.join(SUFFIXES)}"
OF_FIT, OF_STEP = "the scene that fits best", "the fit's last step"


class MeasurementPanel:
    """A measurement, the form's scene beside it, and the fit; ``results`` is the panel whose tab this is."""

    def __init__(self, results: Any) -> None:
        self.results, self.session, self.view = results, results.session, results.view
        self.drawn: tuple[Any, ...] = ()  # what the figure and the table show
        self.written: Fitted | None = None  # of which the result is shown
        self.taker: ValueTaker | None = None  # of the values that were found
        with ui.row().classes("w-full gap-3 pt-3 items-center"):
            opener = add_button("Open a measurement", "upload_file", None, "outline dense", "px-2")
            opener.on("click", js_handler="() => vrte.pick(vrte.upload)")
            add_button("Template", "download", self.hand_out_template, "outline dense", "px-2")
            self.keywords = ui.input(LEFT_OPEN, value=self.view.get("keywords", "")).classes("vrte-fixed w-96")
            self.keywords.props("outlined dense stack-label debounce=500 maxlength=500").without_auto_validation()
            self.keywords.props.update({"placeholder": "geometry='8:di', sample='White'", "aria-label": LEFT_OPEN})
            self.keywords.on_value_change(self.read_anew)
            self.shown = controls.select([], None, "shown", self.look, 250)
            self.name = add_note()
        self.message = add_message("vrte-warning w-full mt-2", "status")
        self.offers = ui.row().classes("gap-2")  # answers to what the file leaves open, to click
        self.understood = add_note()
        self.nothing = ui.label(NOTHING).classes("vrte-empty")
        with ui.column().classes("w-full gap-2 no-wrap pb-4") as self.answer:
            self.table = ui.element("div").classes("w-full overflow-auto mt-2")
            with ui.element("div").classes("vrte-look"):
                with ui.column().classes("gap-0 no-wrap vrte-spectra"):
                    results.add_plot("measurement")
                with ui.column().classes("gap-2 no-wrap"):
                    add_heading("What the fit may change")
                    self.free = FreeNumbers(self.view.setdefault("free", {}))
                    with ui.row().classes("w-full items-center gap-2"):
                        self.fit = add_button("Fit", "insights", self.begin, controls.GO, "vrte-go px-4 mt-1")
                        self.stop = add_button("Stop", "stop", self.end, f"outline {controls.DANGER}")
                        self.stop.tooltip("keeps the best so far; once more: the last step, at once")
                        self.spinner = ui.spinner(size="16px")
                        self.status = add_note(role="status aria-live=polite")
                    self.failure = add_message("vrte-error vrte-narrow", "alert")
                    self.result = ui.column().classes("gap-2 vrte-narrow")
            self.details = ui.column().classes("w-full gap-2")
        self.timer = ui.timer(LOOK_EVERY, self.follow, active=False)

    # what the user does

    def take(self, name: str, data: bytes) -> None:
        """A measurement: it is read aside, and shown beside the scene."""
        self.view["dropped"] = name, data
        self.view["refused"] = TOO_LARGE if len(data) > LARGEST else ""  # the measurement stays as it was
        if not self.view["refused"]:
            self.view["kept"] = self.view.pop("kept", self.view.get("measurement"))  # until this one is read
            self.view["measurement"] = name[:100], data, Path(name).suffix.lower()
        self.refresh()

    def read_anew(self, event: Any) -> None:
        """Reads the file that was dropped last by other keywords."""
        if self.view.get("keywords", "") != (event.value or ""):
            self.view["keywords"] = event.value or ""
            if "dropped" in self.view:
                self.take(*self.view["dropped"])

    def hand_out_template(self) -> None:
        """A table to fill in, for the browser to keep."""
        ui.download.content(measuring.TEMPLATE.read_bytes(), measuring.TEMPLATE.name)

    def look(self, shown: Any) -> None:
        """Shows another quantity of the measurement."""
        if shown and shown != self.view.get("shown"):
            self.view["shown"] = shown
            self._show()

    def begin(self) -> None:
        """Starts the fit; what keeps it from that is shown."""
        session = self.session
        self.failure.set_text("")
        with controls.report_errors(self.failure.set_text):
            for message in session.find_problems().values():
                raise SceneError(f"the form: {message}")
            if not isinstance(session.beside.answer, Compared) or "measurement" not in self.view:
                raise SceneError("there is no measurement to fit to")
            free = self.free.choose()
            self.view.pop("before_taken", None)
            _, data, suffix = self.view["measurement"]
            more = {"data": data, "suffix": suffix, "free": free, "keywords": self.view.get("keywords", "")}
            session.start_fit(session.make_task("measuring.fit_scene", **more))
            self.view["stopped"] = False
            self.timer.activate()
            self.follow()

    def end(self) -> None:
        """The fit, with the best so far; once more, at once."""
        (self.session.fits.close if self.view.get("stopped") else self.session.fits.stop)()
        self.view["stopped"] = True
        self.status.set_text("stopping")

    # what follows

    def refresh(self) -> None:
        """Asks what the form's scene shows beside the measurement, where that is not known yet."""
        session, given = self.session, self.view.get("measurement")
        self.free.draw(list_free_numbers(session.content))
        if given is not None:
            content = {key: value for key, value in session.content.items() if key not in ("brdf", "field")}
            task = session.make_task(
                "measuring.Comparer", content, data=given[1], suffix=given[2], keywords=self.view.get("keywords", "")
            )
            session.beside.ask(replace(task, content=None) if session.wrong else task)
            self.timer.activate()
        self._show()
        self.follow()

    def follow(self) -> None:
        """Looks what has come: an answer, a step of the fit, its end."""
        session = self.session
        session.beside.refresh()
        self._replace_measurement()
        fits, busy = session.fits, session.fits.waits
        show(busy, self.stop, self.spinner)
        self.fit.set_enabled(not busy)
        if busy and not self.view.get("stopped"):
            self.status.set_text(fits.progress.stage)
        elif not busy:
            session.take_fit()
            self.status.set_text("")
            if session.fitted is None and isinstance(fits.answer, Refused):
                self.failure.set_text(fits.answer.message)
        self._show()
        if not busy and not session.beside.waits:
            self.timer.deactivate()

    def _replace_measurement(self) -> None:
        """A new measurement was read, and takes the place of the one before; or it was not, and that one is back."""
        answer = self.session.beside.answer
        if "kept" not in self.view or self.session.beside.answered is None:
            return
        kept = self.view.pop("kept")
        if isinstance(answer, Refused):
            self.view |= {"refused": answer.message, "measurement": kept}
            self.refresh()
        else:
            self.session.end_fit()
            self.failure.set_text("")

    def _show(self) -> None:
        """The measurement and what is beside it, where that has changed; or why there is none."""
        reply, given = self.session.beside.answer, self.view.get("measurement")
        compared = reply if isinstance(reply, Compared) and given is not None else None
        refused = reply.message if isinstance(reply, Refused) and given is not None else ""
        wrong = f"the form waits: {self.session.wrong[0]}" if self.session.wrong else ""
        beside = "; ".join(filter(None, (compared.message, *compared.notes))) if compared else ""
        text = self.view.get("refused") or refused or (wrong or beside if given is not None else "")
        if text != self.message.text:
            self.message.set_text(text)
            self._offer(list_answers(text))
        show(given is None, self.nothing)
        self.understood.set_text("; ".join(compared.measured.understood) if compared else "")
        self.name.set_text(given[0] if given else "")
        show(compared is not None, self.answer, self.shown)
        if compared is not None:
            self._draw(compared)
            self._write_result()

    def _offer(self, answers: list[str]) -> None:
        """A button for each answer to a question."""
        self.offers.clear()
        with self.offers:
            for one in answers:
                add_button(one, "add", partial(self.answer_with, one), "outline dense", "px-2")

    def answer_with(self, answer: str) -> None:
        """Adds an answer to what the file leaves open, and reads it once more."""
        self.keywords.set_value(", ".join(filter(None, [self.view.get("keywords", ""), answer])))

    def _draw(self, compared: Compared) -> None:
        """Draws the table of what was read, and the figure over it."""
        measured, view = compared.measured, self.view
        offered = measuring.list_shown(measured)
        if view.get("shown") not in offered:
            view["shown"] = offered[0]
        step, fitted = self.session.fits.step, self.session.fitted
        predicted, fine, source = compared.predicted, compared.fine, SCENE
        if fitted is not None and self.session.content == fitted.content:
            predicted, fine, source = fitted.predicted, None, OF_FIT
        elif step is not None and fitted is None:
            predicted, fine, source = step.predicted, None, OF_STEP
        wanted = compared, view["shown"], predicted, bool(view.get("dark"))
        if len(self.drawn) == len(wanted) and all(a is b for a, b in zip(self.drawn, wanted, strict=True)):
            return
        if not self.drawn or self.drawn[0] is not compared:
            self.shown.set_options({one: one.replace("_", " ") for one in offered}, value=view["shown"])
            self.table.clear()
            with self.table:
                rows = ((name.replace("_", " "), *row) for name, *row in measuring.describe_measured(measured))
                add_table("vrte-columns whitespace-nowrap", measuring.HEADS, rows)
        self.drawn = wanted
        if predicted is not None and predicted.size != len(measured):  # of another measurement
            predicted, fine = None, None
        self.results.draw_figure("measurement", measurement(measured, view["shown"], predicted, fine, source))

    def _write_result(self) -> None:
        """What the fit found, once."""
        fitted = self.session.fitted
        if self.taker is not None:
            self.taker.refresh()
        if fitted is self.written:
            return
        self.written, self.taker = fitted, None
        self.result.clear()
        self.details.clear()
        if fitted is None:
            return
        known = {one.key: one for one in list_free_numbers(fitted.content)}
        names = {name: known[name].label for name in fitted.names}
        found = zip(fitted.names, fitted.values, fitted.errors, strict=True)
        rows = [
            [names[name], write_digits(known[name].start), f"{value:.6g}", f"{error:.2g}" if error < np.inf else "–"]
            for name, value, error in found
        ]
        with self.result:
            add_heading(f"What fits best: χ² = {fitted.chi2:.5g} of {fitted.predicted.size} numbers")
            add_table("vrte-columns", ["number", "began at", "fits best", "± one sigma"], rows)
            with ui.row().classes("gap-2 items-center"):
                places = find_places(fitted.content, fitted.names, fitted.values)
                self.taker = ValueTaker(self.results, places, self.failure.set_text)
                scene = write_content(put_values(fitted.content, places)).encode()
                files = {"Page of the fit": ("fit.html", fitted.page), "Fitted scene, TOML": ("fitted.toml", scene)}
                for text, (name, data) in files.items():
                    if data:
                        add_button(text, "download", partial(ui.download.content, data, name), "flat dense")
        with self.details:
            if len(names) > 1 and np.isfinite(fitted.correlations).any():
                add_heading("Correlations")
                numbered = enumerate(zip(names.values(), fitted.correlations, strict=True), 1)
                below = ([f"{n}  {label}", *(f"{value:.3f}" for value in row[:n])] for n, (label, row) in numbered)
                with ui.element("div").classes("w-full overflow-auto"):
                    add_table("vrte-columns whitespace-nowrap", ["", *map(str, range(1, len(names) + 1))], below)
            add_bullets("What these data cannot tell", tuple(replace_keys(one, names) for one in fitted.sentences))
            add_bullets("To be known", tuple(replace_keys(one, names) for one in fitted.notes))


def list_answers(question: str) -> list[str]:
    """The answers that a question about a file names, as they are written into the field."""
    plain = re.sub(r" \([^)]*\)", "", question)
    found = []
    for name, values in re.findall(r"(\w+)=(.*?) (?:says|takes)", plain):
        listed = [values] if values.startswith("{") else re.findall(r"'[^']*'|\d+", values)
        found += [f"{name}={value}" for value in listed]
    return found
