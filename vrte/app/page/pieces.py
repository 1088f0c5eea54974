"""Small parts of the result's side: headings, lists, rows of tables, menus."""

from collections.abc import Callable
from typing import Any

from nicegui import ui


def add_heading(text: str) -> None:
    ui.label(text).classes("vrte-heading").props("role=heading aria-level=3")


def add_table_row(tag: str, cells: list[str]) -> list[Any]:
    """A row of labels; an empty cell heads nothing."""
    labels = []
    with ui.element("tr"):
        for text in cells:
            with ui.element(tag if text else "td"):
                labels.append(ui.label(text))
    return labels


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


def select(options: Any, value: Any, label: str, act: Callable[[Any], None], width: int = 260) -> Any:
    """One of several."""
    found = ui.select(options, value=value, label=label, on_change=lambda event: act(event.value))
    found.props("outlined dense options-dense stack-label").style(f"width: {width}px")
    return found.classes("vrte-field vrte-fixed")
