"""The left side of the page: the scene as fields, each checked as it is typed."""

import copy
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from nicegui import ui

from vrte.app.form import content as form
from vrte.app.form.checks import name_part
from vrte.app.form.fields import LONGEST_TEXT, find_field, get_value, parse_typed_text, write_field_text
from vrte.app.page import controls
from vrte.app.page.controls import OUTLINED, add_message, add_note, make_icon, report_errors
from vrte.app.solving.tab_session import LARGEST_LIST, LARGEST_TABLE, TabSession, check_size
from vrte.basics.errors import Place
from vrte.formats.bases import BASES, FACETS
from vrte.formats.keys import TABLE, Choice, FilePath, Flag, Numbers, Substance
from vrte.formats.layers import PHASES
from vrte.formats.particle_sources import SOURCES
from vrte.formats.scene_file import ANGLES, REQUEST_KEYS, find_named_tables
from vrte.optics.crowding import INDEPENDENT, PACKINGS
from vrte.optics.refractive_index import MATERIALS
from vrte.optics.truncation import CHOICES

LIST_HINT = "one number, several with commas, or start:stop:count"
SHORT = 24  # characters of a label in half of the form
LONG = 42  # of a choice, for which there is no room


class FormPanel:
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

    def check(self) -> None:
        """Every message at its field; what belongs to none, below."""
        session = self.session
        at_fields: dict[Place, str] = {}
        rest = []
        for place, message in session.find_problems().items():
            around = next((place[:end] for end in range(len(place), 0, -1) if place[:end] in self.fields), None)
            if around:
                at_fields.setdefault(around, message)
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
            read = session.parts_read.get(name_part(session.content, part))
            label.set_text(read.words if read else "")
        self.general.set_text("; ".join(rest))
        found = [*((message, place) for place, message in at_fields.items()), *((message, ()) for message in rest)]
        session.wrong = found[0] if found else None
        self.changed()

    def jump(self) -> None:
        """To the field that is wrong."""
        place = self.session.wrong[1] if self.session.wrong else ()
        if place in self.fields:
            field, section = self.fields[place]
            section.set_value(True)
            ui.run_javascript(f"setTimeout(() => vrte.jump({field.id}), 250)")

    def change(self, action: Callable[..., Any], *arguments: Any) -> None:
        """Something other than a field's text: done, then all is drawn anew; what cannot be done is notified."""
        with report_errors(lambda why: ui.notify(why, type="warning", multi_line=True)):
            action(*arguments)
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

    @contextmanager
    def card(self, *place: str | int) -> Iterator[Any]:
        """A box for one of several alike, with a row for its name and its buttons; messages about all of it below."""
        with ui.column().classes("vrte-card"):
            yield ui.row().classes("w-full items-center no-wrap gap-1")
            self.complaint(*place)

    def keys(self, places: Iterable[Place], chosen: Callable[[], None] = lambda: None) -> None:
        """What the keys of a registry are entered by, numbers with short names two in a row."""
        waiting: Any = None  # a row that has room for one more field
        for place in places:
            key = find_field(place, self.session.content)
            if isinstance(key, (Substance, FilePath, Choice, Flag, Numbers)) or len(key.label) > SHORT:
                waiting = None
                self.key(*place, chosen=chosen)
            else:
                row = make_row() if waiting is None else waiting
                waiting = row if waiting is None else None
                with row:
                    self.key(*place)

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
            found = self.choice(shown, now, key.label, lambda chosen: put(chosen or None), *place)
            found.props.update({"hint": names.get(now, "")} if long else {})
        elif isinstance(key, Flag):
            usual = key.usual(get_value(content, place[:-1]))
            now = usual if value is None else value is True
            kept = key.needed or key.start is not None  # else a box as it usually is puts in nothing
            self.switch(key.label, now, lambda ticked: put(ticked if kept or ticked != usual else None))
            self.complaint(*place)
        else:
            self.field(*place)

    def field(self, *place: str | int, classes: str = "") -> Any:
        """A text field whose value is read and checked during typing."""
        content = self.session.content
        about = find_field(place, content)

        def typed(event: Any) -> None:
            form.put(content, place, parse_typed_text(str(event.value or ""), place, content))
            self.refused.pop(place, None)
            self.check()

        label, value = about.label.format(place[-1]), write_field_text(get_value(content, place))
        found = ui.input(label, value=value, on_change=typed)
        found.props(f"{OUTLINED} debounce=120 autocomplete=off spellcheck=false maxlength={LONGEST_TEXT}")
        found.without_auto_validation()  # it would wipe out the message that `typed` has brought
        found.classes(f"vrte-field {classes}")
        found.props.update({name: text for name, text in (("placeholder", about.empty), ("hint", about.hint)) if text})
        return self.enter(place, found)

    def substance(self, *place: str | int, chosen: Callable[[], None] = lambda: None) -> None:
        """A field for a substance, with a menu of those that have names, and of a table of one's own."""
        index = self.field(*place)

        def choose(material: str) -> None:
            index.set_value(material)
            chosen()

        index.on("change", chosen)
        with index.add_slot("append"), make_icon("arrow_drop_down", "known substances"), controls.make_menu():
            own = controls.add_menu_item(f"a table of n, k ({TABLE}) ...")
            self.ask_for_file(own, place, (TABLE,), LARGEST_LIST)
            for material in MATERIALS:
                controls.add_menu_item(material, partial(choose, material))

    def file(self, *place: str | int, key: FilePath) -> None:
        """A button to choose a file, and what was read from the file."""
        name = write_field_text(get_value(self.session.content, place))
        found = ui.input(key.label, value=name).without_auto_validation().classes("vrte-field")
        found.props(f"{OUTLINED} readonly")
        found.props.update({"placeholder": key.empty or "no file yet", "hint": key.hint or " or ".join(key.suffixes)})
        with found.add_slot("append"):
            if name and not key.needed:
                make_icon("close", "without a file", partial(self.change, form.put, self.session.content, place, None))
            most = LARGEST_LIST if place[0] == "particles" else LARGEST_TABLE
            self.ask_for_file(make_icon("upload_file", "choose a file"), place, key.suffixes, most)
        self.enter(place, found)
        self.words[place] = add_message()

    def ask_for_file(self, button: Any, *asked: Any) -> None:
        """A click on the button opens the choice of a file for a place, with allowed suffixes and a largest size."""

        def ask() -> None:
            self.asked = asked[0], asked[1], asked[2]

        script = f"() => {{ emit(); vrte.pick({self.upload.id}, '{','.join(asked[1])}'); }}"
        button.on("click", ask, js_handler=script, args=[])

    async def take_file(self, event: Any) -> None:
        """Puts the chosen file into the form."""
        place, suffixes, most = self.asked
        self.upload.reset()
        name = str(event.file.name)
        with report_errors(self.refuse):
            check_size(name, int(event.file.size()), most)
            named = frozenset(find_named_tables(self.session.content).values())
            kept = self.session.uploads.add(name, await event.file.read(), suffixes, most, named)
            self.refused.pop(place, None)
            form.put(self.session.content, place, kept)
            self.draw()

    def refuse(self, why: str) -> None:
        """What is wrong with a file, at the field that it was for, which stays as it is."""
        self.refused[self.asked[0]] = why
        self.check()

    def choice(self, names: Any, value: Any, label: str, act: Callable[[Any], None], *place: str | int) -> Any:
        """One of several; the rest of the form may depend on it, and messages about a place be at it."""
        found = ui.select(names, value=value, label=label)
        found.on_value_change(lambda event: self.change(act, event.value))
        found.without_auto_validation().props(f"{OUTLINED} options-dense").classes("w-full vrte-field")
        return self.enter(place, found) if place else found

    def switch(self, text: str, value: bool, act: Callable[[bool], Any]) -> None:
        """A box that is ticked or not; the rest of the form depends on it."""
        box = ui.checkbox(text, value=value).props("dense size=sm").classes("vrte-note")
        box.on_value_change(lambda event: self.change(act, bool(event.value)))

    def adder(self, text: str, add: Callable[[form.Content], Any]) -> None:
        """A button that adds something."""
        controls.add_button(text, "add", lambda: self.change(add, self.session.content), controls.QUIET)

    def complaint(self, *place: str | int) -> None:
        """Where messages about a whole table are shown."""
        self.enter(place, add_message("vrte-error"))

    def enter(self, place: Place, field: Any) -> Any:
        """A field, or what stands for one, where messages about it find it."""
        self.fields[place] = field, self.section_now
        return field

    # the form

    def lay_out(self) -> None:
        content = self.session.content
        with self.section("Light", "wb_sunny"):
            self.field("wavelength_um")
            self.key("host_index")
        with self.section("Particles", "grain"):
            if not content.get("particles"):
                add_note().set_text("None: the layers name their phase functions.")
            for name in content.get("particles", {}):
                with self.card("particles", name) as head:
                    self._kind(head, name)
            self.adder("add a kind of particle", form.add_kind)
        with self.section("Layers, top first", "layers"):
            for place in range(len(content["layer"])):
                with self.card("layer", place) as head:
                    self._layer(head, place)
            with make_row():
                self.adder("add a layer", form.add_layer)
                self.adder("add a surface or interface", form.add_interface)
        with self.section("Base", "horizontal_rule"):
            kind = content.get("base", {}).get("kind", "black")
            names = {name: row.words for name, row in BASES.items()}
            self.choice(names, kind, "what lies beneath", partial(form.set_base, content))
            self.keys(("base", key) for key in (BASES[kind].keys if kind in BASES else ()))
            self.complaint("base")
        with self.section("Directions of the BRDF", "explore", opened=False):
            add_note().set_text(LIST_HINT)
            degrees = any(key in content.get(kind, {}) for kind in REQUEST_KEYS for key in ANGLES.values())
            self.switch("in degrees from the normal", degrees, partial(form.set_degrees, content))
            for key in ("mu_i", "mu_o", "phi_deg"):
                self.field("brdf", ANGLES.get(key, key) if degrees else key)
        with self.section("Inside the layers", "vertical_align_center", opened=False):
            put, start = partial(form.put, content, ("field",)), copy.deepcopy(form.START["field"])
            self.switch("the radiance field, too", "field" in content, lambda wanted: put(start if wanted else None))
            beam = ANGLES["mu0"] if ANGLES["mu0"] in content.get("field", {}) else "mu0"
            for key in (beam, "tau", "phi_deg", "stokes", "mu") if "field" in content else ():
                self.field("field", key)
        with self.section("Accuracy", "tune", opened=False):
            with make_row():
                self.field("accuracy")
                self.field("nodes")
            truncate = partial(form.put, content, ("truncation",))
            self.choice(list(CHOICES), content.get("truncation", "auto"), "truncation of forward peaks", truncate)

    def _kind(self, head: Any, name: str) -> None:
        content = self.session.content
        kind = content["particles"][name]
        with head:
            label = ui.input(value=name).props(f"dense borderless maxlength={form.LONGEST_NAME}")
            label.props('aria-label="name of the kind"').classes("vrte-name grow").tooltip("the name of this kind")
            label.on("change", lambda: self.change(form.rename_kind, content, name, str(label.value)))
            make_icon("close", "remove this kind", lambda: self.change(form.remove_kind, content, name))
        before = form.get_substance(kind)

        def name_after() -> None:
            """Once it is typed or chosen; a card that has its name by hand keeps it."""
            form.name_after(content, name, before)
            if name not in content["particles"]:
                self.draw()

        source, mode = form.get_source(kind), form.get_size_mode(kind)
        names = {one: row.words for one, row in SOURCES.items()}
        self.choice(names, source, "what", partial(form.set_source, kind), "particles", name, "source")
        self.keys((("particles", name, key) for key in SOURCES[source].keys), name_after)
        if SOURCES[source].sized:
            names = {one: words for one, (words, _) in form.SIZE_MODES.items()}
            self.choice(names, mode, "size", partial(form.set_size_mode, kind))
            self.keys(("particles", name, *below) for below in form.list_size_places(mode))
        if "host_index" in kind or any(map(form.is_interface, content["layer"])):
            self.key("particles", name, "host_index")

    def _layer(self, head: Any, place: int) -> None:
        content = self.session.content
        layer, last = content["layer"][place], len(content["layer"]) - 1
        with head:
            ui.label(form.name_layers(content["layer"])[place].capitalize()).classes("vrte-name grow")
            for symbol, tip, possible, act in (
                ("arrow_upward", "up", place > 0, partial(form.move_layer, content, place, -1)),
                ("arrow_downward", "down", place < last, partial(form.move_layer, content, place, 1)),
                ("close", "remove this layer", last > 0, partial(form.remove_layer, content, place)),
            ):
                make_icon(symbol, tip, partial(self.change, act)).set_enabled(possible)
        if form.is_interface(layer):
            surface = layer["interface"]
            with make_row():
                for key in ("above", "below"):
                    self.key("layer", place, "interface", key)
            rough = surface.get("roughness", 0) != 0
            self.choice(form.SURFACES, "rough" if rough else "smooth", "surface", partial(form.set_rough, surface))
            self.keys(("layer", place, "interface", key) for key in (FACETS if rough else ()))
            return
        medium = form.get_medium(layer)
        names = {name: words for name, (words, _) in form.MEDIA.items()}
        self.choice(names, medium, "filled with", partial(form.set_medium, content, place))
        self._medium(place, layer, medium)
        geometric, held = form.is_geometric(layer), medium in form.HELD
        lengths = ["thickness_um" if geometric else "thickness"]
        if "flakes" in layer:
            core = "substrate" if "substrate" in layer["flakes"] else "index"
            self.keys([("layer", place, "flakes", key) for key in (core, "tilt_deg")])
            sizes = [key for key in (*form.OF_FLAKES[1:], *form.THICKNESS_KEYS[1:]) if key in layer]
            lengths = sizes if medium == "flakes" else [*lengths, "flake_area"]
        with make_row():
            for key in lengths:
                self.field("layer", place, key)
            if held and medium != "volumes" and (geometric or form.is_fraction_asked(content, place)):
                self.field("layer", place, "volume_fraction")
        if held:
            self.switch("thickness in µm", geometric, partial(form.set_geometric, layer))
            packing, pack = layer.get("packing", INDEPENDENT), partial(form.set_packing, layer)
            self.choice(list(PACKINGS), packing, "close particles scatter", pack, "layer", place, "packing")
        if "host_index" in layer or medium in ("clear", "flakes") or any(map(form.is_interface, content["layer"])):
            self.key("layer", place, "host_index")

    def _medium(self, place: int, layer: form.Content, medium: str) -> None:
        known = list(self.session.content.get("particles", {}))
        if medium == "particles":
            value, put = layer["particles"], partial(form.put, layer, ("particles",))
            self.choice(known, value if value in known else None, "kind", put, "layer", place, "particles")
        elif medium in ("mixture", "volumes"):
            with make_row(""):
                for name in known:
                    key = "particles" if medium == "mixture" else "volume_fractions"
                    self.field("layer", place, key, name, classes="w-[150px]")
        elif medium == "coefficients":
            self.key("layer", place, "phase")
            self.keys(("layer", place, key) for key in ("albedo", "tolerance"))
        elif medium not in ("clear", "flakes"):
            self.keys([*(("layer", place, "phase", key) for key in PHASES[medium].keys), ("layer", place, "albedo")])


def make_row(wrap: str = "no-wrap") -> Any:
    """Fields beside each other."""
    return ui.row().classes(f"w-full gap-2 {wrap}")
