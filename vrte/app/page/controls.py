"""What all panels of the page are made of: headings, tables, menus, buttons, choices, sliders, messages for errors."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from nicegui import ui

from vrte.basics.errors import MissingExtraError, SceneError

OUTLINED = "outlined dense stack-label hide-bottom-space"
GO = "unelevated"  # a button in the colour of Solve
QUIET = "flat dense size=sm"
DANGER = "color=negative"


def add_heading(text: str, level: int = 3, classes: str = "vrte-heading") -> Any:
    return ui.label(text).classes(classes).props(f"role=heading aria-level={level}")


def add_table(classes: str, head: Iterable[str], rows: Iterable[Iterable[str]] = ()) -> Any:
    """A table of labels; an empty cell heads nothing."""
    with ui.element("table").classes(f"vrte-table {classes}") as table:
        for tag, cells in (("th", head), *(("td", row) for row in rows)):
            with ui.element("tr"):
                for text in cells:
                    with ui.element(tag if text else "td"):
                        ui.label(text)
    return table


def add_note(classes: str = "vrte-note", role: str = "") -> Any:
    """A label, empty at first; with a ``role`` its changes are read out."""
    return ui.label().classes(classes).props(f"role={role}" if role else "")


def add_message(classes: str = "vrte-note", role: str = "") -> Any:
    """A label that is there while it has a text."""
    label = add_note(classes, role)
    return label.bind_visibility_from(label, "text", backward=bool)


def add_bullets(title: str, lines: tuple[str, ...]) -> None:
    """A heading and its lines, nothing without any."""
    if lines:
        add_heading(title)
        with ui.element("ul").classes("vrte-list"):
            for line in lines:
                with ui.element("li"):
                    ui.label(line)


def make_menu() -> Any:
    """A menu that closes when something is chosen."""
    return ui.menu().props("auto-close")


def add_menu_item(text: str, act: Callable[[], Any] | None = None) -> Any:
    """Something to choose in a menu."""
    return ui.menu_item(text, act).props("role=menuitem")


def add_button(
    text: str, icon: str, act: Callable[[], Any] | None = None, props: str = "", classes: str = "", plain: bool = False
) -> Any:
    """A button, in no colour of Quasar's where it is ``plain``, or has its colour of a class as GO has."""
    colour = None if plain or props == GO else "primary"
    return ui.button(text, icon=icon, on_click=act, color=colour).props(f"no-caps {props}").classes(classes)


def make_icon(symbol: str, tip: str, act: Callable[[], Any] | None = None) -> Any:
    """A small round button."""
    return ui.button(icon=symbol, on_click=act).props(f'flat dense round size=sm aria-label="{tip}"').tooltip(tip)


def select(options: Any, value: Any, label: str, act: Callable[[Any], None], width: int = 260) -> Any:
    """One of several."""
    found = ui.select(options, value=value, label=label, on_change=lambda event: act(event.value))
    found.props("outlined dense options-dense stack-label").style(f"width: {width}px")
    return found.classes("vrte-field vrte-fixed")


def add_slider(
    label: str, ends: tuple[float, float], step: float, act: Callable[[float], None], throttle: float, **more: Any
) -> tuple[Any, Any, Any]:
    """What is around a slider, the text above it, and the slider; the last position within ``throttle`` [s] counts."""
    with ui.column().classes("gap-0") as around:
        text = add_note()
        return around, text, make_bar(label, ends, step, act, throttle, **more)


def make_bar(
    label: str, ends: tuple[float, float], step: float, act: Callable[[float], None], throttle: float, **more: Any
) -> Any:
    """A slider between two ends, without a number beside it."""
    bar = ui.slider(min=ends[0], max=ends[1], step=step, value=ends[0]).classes("grow")
    bar.props(f'dense aria-label="{label}"')
    bar.on("update:model-value", lambda event: act(float(event.args)), throttle=throttle, **more)
    return bar


class NumberSlider:
    """A slider, the field of its number beside it, in one of several ``units`` that ``choose`` gets, and a message."""

    def __init__(
        self,
        label: str,
        ends: tuple[float, float],
        step: float,
        throttle: float,
        move: Callable[[float], None],
        take: Callable[[str], None],
        units: tuple[str, ...] = (),
        unit: str = "",
        choose: Callable[[str], None] = lambda unit: None,
    ) -> None:
        self.text, self._take = "", take  # what the field shows, and who gets what is typed there
        with ui.column().classes("gap-0"):
            add_note().set_text(label)
            with ui.row().classes("w-full no-wrap items-center gap-2"):
                self.bar = make_bar(label, ends, step, move, throttle)
                self.field = add_text(f"{label}, number", self._hear)
                if units:
                    chosen = ui.select(list(units), value=unit, on_change=lambda event: choose(event.value))
                    chosen.props(f'dense borderless options-dense aria-label="unit of {label}"').classes("vrte-unit")
            self.message = add_message("vrte-error")

    def _hear(self, text: str) -> None:
        if text != self.text:
            self.text = text
            self._take(text)

    def show(self, text: str, step: float | None, message: str = "") -> None:
        """The number's text; the slider's step, None as it is; and what is wrong."""
        self.text = text
        self.field.set_value(text)
        if step is not None:
            self.bar.set_value(step)
        self.bar.props.update({"aria-valuetext": text})
        self.message.set_text(message)


def add_text(label: str, take: Callable[[str], None]) -> Any:
    """A small field for a number, given as text while it is typed."""
    field = ui.input(on_change=lambda event: take(str(event.value or ""))).without_auto_validation()
    field.props(f'dense borderless debounce=300 maxlength=40 autocomplete=off aria-label="{label}"')
    return field.classes("vrte-number")


def notify(text: str, kind: Any = "info", **more: Any) -> None:
    """Words that stay for a while, and can be closed."""
    ui.notify(text, type=kind, multi_line=True, close_button=True, **more)


def show(shown: bool, *elements: Any) -> None:
    """Shows elements, or hides them."""
    for element in elements:
        element.set_visibility(shown)


@contextmanager
def report_errors(report: Callable[[str], Any]) -> Iterator[None]:
    """Reports an error that is a sentence, in place of raising it."""
    try:
        yield
    except (SceneError, MissingExtraError, OSError) as error:
        report(str(error))
