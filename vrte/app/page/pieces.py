"""Small parts of the result's side: headings, lists, rows of tables, menus."""

from collections.abc import Callable
from typing import Any

from nicegui import ui


def add_heading(text: str) -> None:
    ui.label(text).classes("vrte-heading").props("role=heading aria-level=3")


def add_table_row(tag: str, cells: list[str]) -> list[Any]:
    """A row of labels."""
    labels = []
    with ui.element("tr"):
        for text in cells:
            with ui.element(tag):
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


def select(options: Any, value: Any, label: str, act: Callable[[Any], None], width: int = 260) -> Any:
    """One of several."""
    found = ui.select(options, value=value, label=label, on_change=lambda event: act(event.value))
    found.props("outlined dense options-dense stack-label").style(f"width: {width}px")
    return found.classes("vrte-field vrte-fixed")
