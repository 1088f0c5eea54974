"""The tab that shows a measurement over the scene of the form, and fits the scene's numbers to it."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import ui

from vrte.app.form.checks import write_content
from vrte.app.form.fields import parse_field_text, write_field_text
from vrte.app.form.numbers import FormNumber, list_free_numbers, put_values, write_fractions
from vrte.app.page import controls
from vrte.app.page.controls import add_bullets, add_button, add_heading, add_message, add_note, add_table, show
from vrte.app.solving import measuring
from vrte.app.solving.measuring import Compared
from vrte.app.solving.worker import Fitted, Refused
from vrte.basics.errors import SceneError
from vrte.formats.toml_table import is_number
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
DIGITS = 6


class MeasurementPanel:
    """A measurement, the form's scene beside it, and the fit; ``results`` is the panel whose tab this is."""

    def __init__(self, results: Any) -> None:
        self.results, self.session, self.view = results, results.session, results.view
        self.view.setdefault("free", {})
        self.listed: list[FormNumber] = []
        self.drawn: tuple[Any, ...] = ()  # what the figure and the table show
        self.written: Fitted | None = None  # of which the result is shown
        self.back: Any = None  # the button to the values before
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
        self.understood = add_note()
        self.nothing = ui.label(NOTHING).classes("vrte-empty")
        with ui.column().classes("w-full gap-2 no-wrap pb-4") as self.answer:
            self.table = ui.element("div").classes("w-full overflow-auto mt-2")
            with ui.element("div").classes("vrte-look"):
                with ui.column().classes("gap-0 no-wrap vrte-spectra"):
                    results.add_plot("measurement")
                with ui.column().classes("gap-2 no-wrap"):
                    add_heading("What the fit may change")
                    self.free = ui.element("div")
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

    def _draw_free(self) -> None:
        """A row for each number of the form: whether it may change, its value, its limits."""
        listed = list_free_numbers(self.session.content)
        if listed == self.listed:
            return
        self.listed = listed
        self.free.clear()
        with self.free, add_table("vrte-columns", ["may change", "now", "from", "to"]):
            for one in listed:
                given = self.view["free"].get(one.key, {})
                with ui.element("tr"):
                    with ui.element("td"):
                        box = ui.checkbox(one.label, value=bool(given.get("free"))).props("dense size=sm")
                        box.tooltip(one.key).on_value_change(partial(self.set_free, one.key, "free"))
                    with ui.element("td"):
                        ui.label(write_digits(one.start))
                    for side, words in (("low", "from"), ("high", "to")):
                        with ui.element("td"):
                            field = ui.input(value=write_field_text(given.get(side))).classes("vrte-end")
                            field.on_value_change(partial(self.set_free, one.key, side)).without_auto_validation()
                            field.props("outlined dense hide-bottom-space debounce=120 maxlength=40")
                            texts = write_digits(getattr(one, side)), f"{one.label}, {words}"
                            field.props.update(zip(("placeholder", "aria-label"), texts, strict=True))

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

    def set_free(self, key: str, side: str, event: Any) -> None:
        """Whether a number may change, or how far, as it is typed; as far as it is suggested where nothing is."""
        value = event.value if side == "free" else parse_field_text(str(event.value or ""))
        self.view["free"].setdefault(key, {})[side] = value
        if value is None:
            del self.view["free"][key][side]

    def begin(self) -> None:
        """Starts the fit; what keeps it from that is shown."""
        session = self.session
        self.failure.set_text("")
        with controls.report_errors(self.failure.set_text):
            for message in session.find_problems().values():
                raise SceneError(f"the form: {message}")
            if not isinstance(session.beside.answer, Compared) or "measurement" not in self.view:
                raise SceneError("there is no measurement to fit to")
            free = choose_free(self.listed, self.view["free"])
            self.view.pop("before_fit", None)
            _, data, suffix = self.view["measurement"]
            content = write_fractions(session.content)
            more = {"data": data, "suffix": suffix, "free": free, "keywords": self.view.get("keywords", "")}
            session.start_fit(session.make_task("measuring.fit_scene", content, **more))
            self.view["stopped"] = False
            self.timer.activate()
            self.follow()

    def end(self) -> None:
        """The fit, with the best so far; once more, at once."""
        (self.session.fits.close if self.view.get("stopped") else self.session.fits.stop)()
        self.view["stopped"] = True
        self.status.set_text("stopping")

    def use(self, fitted: Fitted) -> None:
        """The values that were found go to the form; those of before can come back."""
        with controls.report_errors(self.failure.set_text):
            content = put_values(self.session.content, find_places(fitted))
            self.view["before_fit"] = self.session.content
            self.results.fill(content)

    def go_back(self) -> None:
        """The form as it was before the values were taken."""
        content = self.view.pop("before_fit", None)
        if content is not None:
            self.results.fill(content)

    # what follows

    def refresh(self) -> None:
        """Asks what the form's scene shows beside the measurement, where that is not known yet."""
        session, given = self.session, self.view.get("measurement")
        self._draw_free()
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
        self.message.set_text(text)
        show(given is None, self.nothing)
        self.understood.set_text("; ".join(compared.measured.understood) if compared else "")
        self.name.set_text(given[0] if given else "")
        show(compared is not None, self.answer, self.shown)
        if compared is not None:
            self._draw(compared)
            self._write_result()

    def _draw(self, compared: Compared) -> None:
        """Draws the table of what was read, and the figure over it."""
        measured, view = compared.measured, self.view
        offered = measuring.list_shown(measured)
        if view.get("shown") not in offered:
            view["shown"] = offered[0]
        step, fitted = self.session.fits.step, self.session.fitted
        predicted, fine, source = compared.predicted, compared.fine, SCENE
        if fitted is not None and write_fractions(self.session.content) == fitted.content:
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
        if self.back is not None:
            show("before_fit" in self.view, self.back)
        if fitted is self.written:
            return
        self.written, self.back = fitted, None
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
                add_button("Take these values", "check", partial(self.use, fitted), controls.GO, "vrte-go px-3")
                self.back = add_button("Back to those before", "undo", self.go_back, "flat dense")
                show("before_fit" in self.view, self.back)
                scene = write_content(put_values(fitted.content, find_places(fitted))).encode()
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


def choose_free(listed: list[FormNumber], asked: dict[str, dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Start, low and high of the numbers that may change, by their keys. Raises SceneError."""
    found = {}
    for one in listed:
        given = asked.get(one.key, {})
        if not given.get("free"):
            continue
        low, high = given.get("low", one.low), given.get("high", one.high)
        if not is_number(low) or not is_number(high) or not low < high:
            raise SceneError(f"{one.label}: from and to must be two numbers, the first one smaller")
        if not low <= one.start <= high:
            raise SceneError(f"{one.label} is {one.start:g} now, which is not between {low:g} and {high:g}")
        found[one.key] = {"start": one.start, "low": float(low), "high": float(high)}
    if not found:
        raise SceneError("tick at least one number that the fit may change")
    return found


def find_places(fitted: Fitted) -> dict[Any, float]:
    """The values that were found by their places in the form."""
    indices = {one.key: one.place for one in list_free_numbers(fitted.content)}
    return {indices[name]: float(value) for name, value in zip(fitted.names, fitted.values, strict=True)}


def replace_keys(sentence: str, names: dict[str, str]) -> str:
    """A sentence about keys with the words that the form has for them."""
    for key in sorted(names, key=len, reverse=True):
        sentence = sentence.replace(key, names[key])
    return sentence


def write_digits(value: float) -> str:
    """A number as a person reads it: 0.1 + 0.2 is 0.3."""
    return write_field_text(float(f"{value:.{DIGITS}g}"))
