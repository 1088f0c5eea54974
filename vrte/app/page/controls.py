"""What the page is made of: headings, tables, menus, and the form's sections, fields, choices, boxes and files."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from nicegui import ui

from vrte.app.form import content as form
from vrte.app.form.checks import name_part
from vrte.app.form.fields import LONGEST_TEXT, find_field, get_value, parse_field_text, write_field_text
from vrte.app.solving.tab_session import TabSession
from vrte.app.solving.uploads import LARGEST_LIST, LARGEST_TABLE
from vrte.basics.errors import Place, SceneError
from vrte.formats.keys import Choice, FilePath, Flag, Numbers, Substance
from vrte.formats.media import TABLE
from vrte.formats.named import find_named_tables
from vrte.formats.toml_table import show_toml
from vrte.optics.refractive_index import MATERIALS


def add_heading(text: str, level: int = 3) -> None:
    ui.label(text).classes("vrte-heading").props(f"role=heading aria-level={level}")


def add_table_row(tag: str, cells: list[str]) -> list[Any]:
    """A row of labels; an empty cell heads nothing."""
    labels = []
    with ui.element("tr"):
        for text in cells:
            with ui.element(tag if text else "td"):
                labels.append(ui.label(text))
    return labels


def add_message(classes: str, role: str = "") -> Any:
    """A label that is there while it has a text."""
    label = ui.label().classes(classes).props(f"role={role}" if role else "")
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


def select(options: Any, value: Any, label: str, act: Callable[[Any], None], width: int = 260) -> Any:
    """One of several."""
    found = ui.select(options, value=value, label=label, on_change=lambda event: act(event.value))
    found.props("outlined dense options-dense stack-label").style(f"width: {width}px")
    return found.classes("vrte-field vrte-fixed")


SHORT = 24  # characters of a label in half of the form
LONG = 42  # of a choice, for which there is no room


class Controls:
    """Fields over the content of a session; ``changed`` is called after each change."""

    def __init__(self, session: TabSession, changed: Callable[[], None]) -> None:
        self.session, self.changed = session, changed
        self.fields: dict[Place, tuple[Any, Any]] = {}  # each with its section
        self.section_now: Any = None
        self.words: dict[Place, Any] = {}  # about files that were read
        self.asked: tuple[Place, tuple[str, ...], int] = ((), (), 0)  # where the next file goes, what it may be
        self.refused: dict[Place, str] = {}  # files, and why
        self.body = ui.column().classes("w-full gap-0 no-wrap")
        self.general = add_message("vrte-error px-4 pb-1")
        self.upload = ui.upload(auto_upload=True, max_file_size=LARGEST_TABLE, on_upload=self.take_file)
        self.upload.on_rejected(lambda: self.refuse(f"the file has more than {LARGEST_TABLE / 1e6:g} MB"))
        self.upload.classes("hidden")
        self.draw()

    def draw(self) -> None:
        """Everything anew, after what is there has changed."""
        self.fields.clear()
        self.words.clear()
        self.body.clear()
        with self.body:
            self.lay_out()
        self.check()

    def lay_out(self) -> None:
        """All sections of the form."""
        raise NotImplementedError

    def check(self) -> None:
        """Every message at its field; what belongs to none, below."""
        session = self.session
        at_fields: dict[Place, str] = {}
        rest = []
        for place, message in session.find_problems().items():
            around = [place[:end] for end in range(len(place), 0, -1) if place[:end] in self.fields]
            if around:
                at_fields.setdefault(around[0], message)
            else:
                rest.append(message)
        for place, (field, section) in self.fields.items():
            wrong = self.refused.get(place) or at_fields.get(place, "")
            if isinstance(field, ui.label):
                field.set_text(wrong)
            else:
                field.error = wrong or None
            if wrong:
                section.set_value(True)  # a message must be seen
        for place, label in self.words.items():
            part = place[:1] if place[0] == "base" else place[:3]
            said = session.said.get(name_part(session.content, part))
            label.set_text(said.words if said else "")
        self.general.set_text("; ".join(rest))
        told: list[tuple[str, Place]] = [(message, place) for place, message in at_fields.items()]
        session.wrong = next(iter([*told, *((message, ()) for message in rest)]), None)
        self.changed()

    def jump(self) -> None:
        """To the field that is wrong."""
        place = self.session.wrong[1] if self.session.wrong else ()
        if place in self.fields:
            field, section = self.fields[place]
            section.set_value(True)
            ui.run_javascript(f"setTimeout(() => vrte.jump({field.id}), 250)")

    def change(self, action: Callable[..., Any], *arguments: Any) -> None:
        """Something other than a field's text: done, then all is drawn anew; what cannot be done is told."""
        try:
            action(*arguments)
        except SceneError as error:
            ui.notify(str(error), type="warning", multi_line=True)
        self.refused.clear()
        self.draw()
        with self.body:  # what was clicked is gone
            ui.run_javascript("vrte.focus_again()")

    # pieces

    @contextmanager
    def section(self, title: str, symbol: str, opened: bool = True) -> Iterator[None]:
        """A part of the form that opens and closes, and stays so when it is drawn anew."""
        view = self.session.view
        part = ui.expansion(title, icon=symbol, value=view.get(title, opened)).props("dense dense-toggle")
        part.classes("vrte-section w-full").on_value_change(lambda event: view.update({title: bool(event.value)}))
        self.section_now = part
        with part, ui.column().classes("w-full gap-2 px-1 pb-2"):
            yield

    def keys(self, places: Iterable[Place], chosen: Callable[[], None] = lambda: None) -> None:
        """What the keys of a registry are entered by, numbers with short names two in a row."""
        row: list[Place] = []
        for place in [*places, ()]:
            if row and not (place and self._is_short(place)):
                for first in range(0, len(row), 2):
                    with make_row():
                        for one in row[first : first + 2]:
                            self.field(*one)
                row = []
            if place and self._is_short(place):
                row.append(place)
            elif place:
                self.key(*place, chosen=chosen)

    def _is_short(self, place: Place) -> bool:
        """Whether half of the form's width is enough for a field."""
        key = find_field(place, self.session.content)
        return not isinstance(key, (Substance, FilePath, Choice, Flag, Numbers)) and len(key.label) <= SHORT

    def key(self, *place: str | int, chosen: Callable[[], None] = lambda: None) -> None:
        """What a registry's key is entered by; ``chosen`` is called once there is a substance."""
        content = self.session.content
        key, value = find_field(place, content), get_value(content, place)
        put = partial(form.put, content, place)
        if isinstance(key, Substance):
            self.substance(*place, chosen=chosen)
        elif isinstance(key, FilePath):
            self.file(*place, key=key)
        elif isinstance(key, Choice):
            names = dict(key.names) if key.needed or not key.empty else {"": key.empty, **key.names}
            now = value or next(iter(names))
            long = max(map(len, names.values())) > LONG
            shown = {name: name or key.empty for name in names} if long else names
            found = self.choice(shown, now, key.label, lambda chosen: put(chosen or None))
            found.props.update({"hint": names.get(now, "")} if long else {})
            self.enter(place, found)
        elif isinstance(key, Flag):
            usual = key.usual(get_value(content, place[:-1]))
            now = usual if value is None else value is True
            told = key.needed or key.start is not None  # else a box as it usually is puts in nothing
            self.switch(key.label, now, lambda ticked: put(ticked if told or ticked != usual else None))
            self.complaint(*place)
        else:
            self.field(*place)

    def field(self, *place: str | int, classes: str = "") -> Any:
        """A text that is read, put in its place and checked while somebody types."""
        content = self.session.content
        about = find_field(place, content)

        def typed(event: Any) -> None:
            form.put(content, place, parse_field_text(str(event.value or "")))
            self.refused.pop(place, None)
            self.check()

        label, value = about.label.format(place[-1]), write_field_text(get_value(content, place))
        found = ui.input(label, value=value, on_change=typed)
        found.props("outlined dense stack-label hide-bottom-space debounce=120 autocomplete=off spellcheck=false")
        found.without_auto_validation()  # it would wipe out the message that `typed` has brought
        found.props(f"maxlength={LONGEST_TEXT}").classes(f"vrte-field {classes}")
        found.props.update({name: text for name, text in (("placeholder", about.empty), ("hint", about.hint)) if text})
        self.enter(place, found)
        return found

    def substance(self, *place: str | int, chosen: Callable[[], None] = lambda: None) -> None:
        """A field for a substance, with a menu of those that have names, and of a table of one's own."""
        index = self.field(*place)

        def choose(material: str) -> None:
            index.set_value(material)
            chosen()

        index.on("change", chosen)
        with index.add_slot("append"), make_icon("arrow_drop_down", "known substances"), make_menu():
            self.ask_for_file(add_menu_item(f"a table of n, k ({TABLE}) ..."), place, (TABLE,), LARGEST_LIST)
            for material in MATERIALS:
                add_menu_item(material, partial(choose, material))

    def file(self, *place: str | int, key: FilePath) -> None:
        """A file that somebody chooses, and what was read from it."""
        about = find_field(place, self.session.content)
        name = write_field_text(get_value(self.session.content, place))
        found = ui.input(about.label, value=name).without_auto_validation().classes("vrte-field")
        found.props("outlined dense stack-label hide-bottom-space readonly")
        found.props.update(
            {"placeholder": about.empty or "no file yet", "hint": about.hint or " or ".join(key.suffixes)}
        )
        most = LARGEST_LIST if place[0] == "particles" else LARGEST_TABLE
        with found.add_slot("append"):
            if name and not key.needed:
                make_icon("close", "without a file", partial(self.change, form.put, self.session.content, place, None))
            self.ask_for_file(make_icon("upload_file", "choose a file"), place, key.suffixes, most)
        self.enter(place, found)
        self.words[place] = add_message("vrte-note")

    def ask_for_file(self, button: Any, place: Place, suffixes: tuple[str, ...], most: int) -> None:
        """A click on the button lets somebody choose a file for a place."""

        def ask() -> None:
            self.asked = place, suffixes, most

        button.on(
            "click",
            ask,
            js_handler=f"() => {{ emit(); vrte.pick({self.upload.id}, '{','.join(suffixes)}'); }}",
            args=[],
        )

    async def take_file(self, event: Any) -> None:
        """A file that somebody has chosen."""
        place, suffixes, most = self.asked
        self.upload.reset()
        name, size = str(event.file.name), int(event.file.size())
        try:
            if size > most:
                raise SceneError(f"{show_toml(name)} has {size / 1e6:.3g} MB, and at most {most / 1e6:g} MB are taken")
            named = frozenset(find_named_tables(self.session.content).values())
            kept = self.session.uploads.add(name, await event.file.read(), suffixes, most, named)
        except (SceneError, OSError) as error:
            self.refuse(str(error))
            return
        self.refused.pop(place, None)
        form.put(self.session.content, place, kept)
        self.draw()

    def refuse(self, why: str) -> None:
        """What is wrong with a file, at the field that it was for, which stays as it is."""
        self.refused[self.asked[0]] = why
        self.check()

    def choice(self, names: dict[str, str], value: Any, label: str, act: Callable[[Any], None]) -> Any:
        """One of several; the rest of the form may depend on it."""
        found = ui.select(names, value=value, label=label)
        found.on_value_change(lambda event: self.change(act, event.value))
        found.without_auto_validation()
        return found.props("outlined dense options-dense stack-label hide-bottom-space").classes("w-full vrte-field")

    def switch(self, text: str, value: bool, act: Callable[[bool], Any]) -> None:
        """A box that is ticked or not; the rest of the form depends on it."""
        box = ui.checkbox(text, value=value).props("dense size=sm").classes("vrte-note")
        box.on_value_change(lambda event: self.change(act, bool(event.value)))

    def adder(self, text: str, add: Callable[[form.Content], Any]) -> None:
        """A button that adds something."""
        button = ui.button(text, icon="add", on_click=lambda: self.change(add, self.session.content))
        button.props("flat dense no-caps size=sm color=primary")

    def complaint(self, *place: str | int) -> None:
        """Where messages about a whole table are shown."""
        self.enter(place, add_message("vrte-error"))

    def enter(self, place: Place, field: Any) -> None:
        """A field, or what stands for one, where messages about it find it."""
        self.fields[place] = field, self.section_now


def make_row(wrap: str = "no-wrap") -> Any:
    """Fields beside each other."""
    return ui.row().classes(f"w-full gap-2 {wrap}")


def make_card_head() -> Any:
    """The name of a card, and its buttons."""
    return ui.row().classes("w-full items-center no-wrap gap-1")


def make_icon(symbol: str, tip: str, act: Callable[[], Any] | None = None) -> Any:
    """A small round button."""
    return ui.button(icon=symbol, on_click=act).props(f'flat dense round size=sm aria-label="{tip}"').tooltip(tip)
