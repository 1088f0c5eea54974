"""What fits and matches have in common on the page: which numbers of the form may change, and what takes them over."""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

from nicegui import ui

from vrte.app.form.content import Content
from vrte.app.form.fields import parse_field_text, write_field_text
from vrte.app.form.numbers import FormNumber, list_free_numbers, put_values
from vrte.app.page import controls
from vrte.app.page.controls import add_button, add_table, show
from vrte.basics.errors import Place, SceneError
from vrte.formats.toml_table import is_number

DIGITS = 6


class FreeNumbers:
    """A table of numbers: whether each may change, its value now, its limits; ``asked``: what is ticked and typed."""

    def __init__(self, asked: dict[str, dict[str, Any]]) -> None:
        self.asked = asked
        self.listed: list[FormNumber] = []
        self.area = ui.element("div").classes("overflow-auto")

    def draw(self, listed: list[FormNumber]) -> None:
        """A row for each number, where these are others than before."""
        if listed == self.listed:
            return
        self.listed = listed
        self.area.clear()
        with self.area, add_table("vrte-columns", ["may change", "now", "from", "to"]):
            for one in listed:
                given = self.asked.get(one.key, {})
                with ui.element("tr"):
                    with ui.element("td"):
                        box = ui.checkbox(one.label, value=bool(given.get("free"))).props("dense size=sm")
                        box.tooltip(one.key).on_value_change(partial(self.set, one.key, "free"))
                    with ui.element("td"):
                        ui.label(write_digits(one.start))
                    for side, words in (("low", "from"), ("high", "to")):
                        with ui.element("td"):
                            text = write_field_text(given.get(side))
                            field = add_cell(text, write_digits(getattr(one, side)), f"{one.label}, {words}")
                            field.on_value_change(partial(self.set, one.key, side))

    def set(self, key: str, side: str, event: Any) -> None:
        """Whether a number may change, or how far, as it is typed; as far as it is suggested where nothing is."""
        value = event.value if side == "free" else parse_field_text(str(event.value or ""))
        self.asked.setdefault(key, {})[side] = value
        if value is None:
            del self.asked[key][side]

    def choose(self, around_start: bool = True) -> dict[str, dict[str, float]]:
        """Start, low and high of the numbers that may change. Raises SceneError."""
        return choose_free(self.listed, self.asked, around_start)


def choose_free(
    listed: Iterable[FormNumber], asked: Mapping[str, dict[str, Any]], around_start: bool = True
) -> dict[str, dict[str, float]]:
    """Start, low and high of the numbers that may change, by their keys; ``around_start``: limits must hold the value
    that is there now, else it is left out. Raises SceneError."""
    found = {}
    for one in listed:
        given = asked.get(one.key, {})
        if not given.get("free"):
            continue
        low, high = given.get("low", one.low), given.get("high", one.high)
        if not is_number(low) or not is_number(high) or not low < high:
            raise SceneError(f"{one.label}: from and to must be two numbers, the first one smaller")
        if around_start and not low <= one.start <= high:
            raise SceneError(f"{one.label} is {one.start:g} now, which is not between {low:g} and {high:g}")
        found[one.key] = {"start": one.start} if around_start else {}
        found[one.key] |= {"low": float(low), "high": float(high)}
    if not found:
        raise SceneError("tick at least one number that may change")
    return found


class ValueTaker:
    """Buttons that put values which were found into the form, and bring back those of before; ``results``: the panel
    of the tabs, ``report`` shows what keeps it from that."""

    def __init__(self, results: Any, places: Mapping[Place, float], report: Callable[[str], Any]) -> None:
        self.results, self.places, self.report = results, places, report
        add_button("Take these values", "check", self.take, controls.GO, "vrte-go px-3")
        self.back = add_button("Back to those before", "undo", self.go_back, "flat dense")
        self.refresh()

    def refresh(self) -> None:
        """Whether there is something to go back to."""
        show("before_taken" in self.results.view, self.back)

    def take(self) -> None:
        """The values go to the form; those of before can come back."""
        with controls.report_errors(self.report):
            content = put_values(self.results.session.content, self.places)
            self.results.view["before_taken"] = self.results.session.content
            self.results.fill(content)

    def go_back(self) -> None:
        """The form as it was before the values were taken."""
        content = self.results.view.pop("before_taken", None)
        if content is not None:
            self.results.fill(content)


def find_places(content: Content, names: Iterable[str], values: Iterable[float]) -> dict[Place, float]:
    """Values by their places in the form, from their keys."""
    indices = {one.key: one.place for one in list_free_numbers(content)}
    return {indices[name]: float(value) for name, value in zip(names, values, strict=True)}


def add_cell(text: str, placeholder: str, label: str) -> Any:
    """A small field in a table."""
    field = ui.input(value=text).classes("vrte-end").without_auto_validation()
    field.props("outlined dense hide-bottom-space debounce=120 maxlength=40")
    field.props.update({"placeholder": placeholder, "aria-label": label})
    return field


def replace_keys(sentence: str, names: Mapping[str, str]) -> str:
    """A sentence about keys with the words that the form has for them."""
    for key in sorted(names, key=len, reverse=True):
        sentence = sentence.replace(key, names[key])
    return sentence


def write_digits(value: float) -> str:
    """A number as a person reads it: 0.1 + 0.2 is 0.3."""
    return write_field_text(float(f"{value:.{DIGITS}g}"))
