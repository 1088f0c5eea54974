"""The left side of the page: the scene as fields, each checked as it is typed."""

import copy
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from nicegui import ui

from vrte.app.form import content as form
from vrte.app.form.checks import find_problems
from vrte.app.form.fields import LONGEST_TEXT, find_field, find_key, list_places, parse_field_text, write_field_text
from vrte.app.solving.bench import Bench
from vrte.basics.errors import Place, SceneError
from vrte.formats.bases import BASES, FACETS, SLOPES
from vrte.formats.keys import Choice, Flag, Substance
from vrte.formats.particle_sources import SOURCES
from vrte.formats.scene_file import ANGLES
from vrte.optics.refractive_index import MATERIALS
from vrte.optics.truncation import CHOICES

LIST_HINT = "one number, several with commas, or start:stop:count"


class FormPanel:
    """Fields over the content of a bench; ``changed`` is called after each change."""

    def __init__(self, bench: Bench, changed: Callable[[], None]) -> None:
        self.bench, self.changed = bench, changed
        self.fields: dict[Place, Any] = {}
        self.sections: dict[Place, Any] = {}  # of each field
        self.section_now: Any = None
        self.body = ui.column().classes("w-full gap-0 no-wrap")
        self.general = ui.label().classes("vrte-error px-4 pb-1")
        self.draw()

    def draw(self) -> None:
        """Everything anew, after what is there has changed."""
        self.fields.clear()
        self.body.clear()
        with self.body:
            for part in ("light", "particles", "layers", "base", "directions", "inside", "accuracy"):
                getattr(self, f"_{part}")()
        self.check()

    def check(self) -> None:
        """Every message at its field; what belongs to none, below."""
        bench = self.bench
        at_fields: dict[Place, str] = {}
        rest = []
        for place, message in find_problems(bench.content, bench.folder, bench.tables).items():
            around = [place[:end] for end in range(len(place), 0, -1) if place[:end] in self.fields]
            if around:
                at_fields.setdefault(around[0], message)
            else:
                rest.append(message)
        for place, field in self.fields.items():
            field.error = at_fields.get(place)
            if place in at_fields:
                self.sections[place].set_value(True)  # a message must be seen
        self.general.set_text("; ".join(rest))
        self.general.set_visibility(bool(rest))
        told: list[tuple[str, Place]] = [(message, place) for place, message in at_fields.items()]
        bench.wrong = next(iter([*told, *((message, ()) for message in rest)]), None)
        self.changed()

    def jump(self) -> None:
        """To the field that is wrong."""
        place = self.bench.wrong[1] if self.bench.wrong else ()
        if place in self.fields:
            self.sections[place].set_value(True)
            ui.run_javascript(f"setTimeout(() => vrte.jump({self.fields[place].id}), 250)")

    def change(self, action: Callable[..., Any], *arguments: Any) -> None:
        """Something other than a field's text: done, then all is drawn anew; what cannot be done is told."""
        try:
            action(*arguments)
        except SceneError as error:
            ui.notify(str(error), type="warning", multi_line=True)
        self.draw()
        with self.body:  # what was clicked is gone
            ui.run_javascript("vrte.focus_again()")

    # parts

    def _light(self) -> None:
        with self.section("Light", "wb_sunny"):
            self.field("wavelength_um")
            self.field("host_index")

    def _particles(self) -> None:
        kinds = self.bench.content.get("particles", {})
        with self.section("Particles", "grain"):
            if not kinds:
                ui.label("None: the layers name their phase functions.").classes("vrte-note")
            for name in kinds:
                with ui.column().classes("vrte-card"):
                    self._kind(name)
            self.adder("add a kind of particle", form.add_kind)

    def _kind(self, name: str) -> None:
        content = self.bench.content
        kind = content["particles"][name]
        with make_card_head():
            label = ui.input(value=name).props('dense borderless maxlength=60 aria-label="name of the kind"')
            label.classes("vrte-name grow").tooltip("the name of this kind")
            label.on("change", lambda: self.change(form.rename_kind, content, name, str(label.value)))
            make_icon("close", "remove this kind", lambda: self.change(form.remove_kind, content, name))
        before = form.get_substance(kind)

        def name_after() -> None:
            """Once it is typed or chosen; a card that has its name by hand keeps it."""
            form.name_after(content, name, before)
            if name not in content["particles"]:
                self.draw()

        source = form.get_source(kind)
        self.choice({one: row.words for one, row in SOURCES.items()}, source, "what", partial(form.set_source, kind))
        for key in SOURCES[source].keys:
            self._key("particles", name, key, chosen=name_after)
        if SOURCES[source].sized:
            mode = form.get_size_mode(kind)
            self.choice(form.list_size_choices(mode), mode, "size", partial(form.set_size_mode, kind))
            with make_row():
                for below in list_places(form.SIZE_MODES[mode][1]):
                    self._key("particles", name, *below)
        if "host_index" in kind or any(map(form.is_interface, self.bench.content["layer"])):
            self.field("particles", name, "host_index")
        self.complaint("particles", name)

    def _key(self, *place: str | int, chosen: Callable[[], None] = lambda: None) -> None:
        """What a registry's key is entered by."""
        key, table = find_key(place, self.bench.content), form.get_value(self.bench.content, place[:-1])
        value = form.get_value(self.bench.content, place)
        put = partial(form.put, table, (place[-1],))
        if isinstance(key, Substance):
            self._substance(*place, chosen=chosen)
        elif isinstance(key, Choice):
            self.choice(dict(key.names), value or next(iter(key.names)), key.label, put)
        elif isinstance(key, Flag):
            self.switch(key.label, value is True, put)
        else:
            self.field(*place)

    def _substance(self, *place: str | int, chosen: Callable[[], None] = lambda: None) -> None:
        """A field for a substance, with a menu of those that have names; ``chosen`` is called once there is one."""
        index = self.field(*place)

        def choose(material: str) -> None:
            index.set_value(material)
            chosen()

        index.on("change", chosen)
        with index.add_slot("append"), make_icon("arrow_drop_down", "known substances"), ui.menu().props("auto-close"):
            for material in MATERIALS:
                ui.menu_item(material, partial(choose, material))

    def _layers(self) -> None:
        with self.section("Layers, top first", "layers"):
            for place in range(len(self.bench.content["layer"])):
                with ui.column().classes("vrte-card"):
                    self._layer(place)
            with make_row():
                self.adder("add a layer", form.add_layer)
                self.adder("add a surface or interface", form.add_interface)

    def _layer(self, place: int) -> None:
        content = self.bench.content
        layer, last = content["layer"][place], len(content["layer"]) - 1
        with make_card_head():
            ui.label(form.name_layers(content["layer"])[place].capitalize()).classes("vrte-name grow")
            for symbol, tip, act, possible in (
                ("arrow_upward", "up", partial(form.move_layer, content, place, -1), place > 0),
                ("arrow_downward", "down", partial(form.move_layer, content, place, 1), place < last),
                ("close", "remove this layer", partial(form.remove_layer, content, place), last > 0),
            ):
                make_icon(symbol, tip, partial(self.change, act)).set_enabled(possible)
        if form.is_interface(layer):
            with make_row():
                for key in ("above", "below"):
                    self.field("layer", place, "interface", key)
            self._surface(layer["interface"], "layer", place, "interface")
            self.complaint("layer", place)
            return
        medium = form.get_medium(layer)
        names = {name: words for name, (words, _) in form.MEDIA.items() if name not in form.OF_FILES or medium == name}
        self.choice(names, medium, "filled with", partial(form.set_medium, content, place))
        self._medium(place, layer, medium)
        self._thickness(place, layer, medium)
        self.complaint("layer", place)

    def _surface(self, table: form.Content, *place: str | int) -> None:
        """Whether the surface of an interface is smooth, and if not its facets."""
        rough = form.is_rough(table)
        names, now = form.SURFACES, "rough" if rough else "smooth"
        self.choice(names, now, "surface", lambda chosen: form.set_rough(table, chosen == "rough"))
        if rough:
            self._facets(table, *place)

    def _facets(self, table: form.Content, *place: str | int) -> None:
        """How rough, how the slopes of facets are distributed, and whether these hide each other."""
        self.field(*place, "roughness")
        slopes = table.get("distribution", "beckmann")
        self.choice(SLOPES, slopes, "slopes of facets", partial(form.put, table, ("distribution",)))
        shadowing = partial(form.put, table, ("shadowing",))
        self.switch("facets hide each other (Smith)", table.get("shadowing") is True, shadowing)
        if table.get("shadowing") is True or "conserving" in table:
            conserving = partial(form.put, table, ("conserving",))
            self.switch("light lost between facets is given back", table.get("conserving") is True, conserving)

    def _medium(self, place: int, layer: form.Content, medium: str) -> None:
        kinds = list(self.bench.content.get("particles", {}))
        if medium == "particles":
            value = layer["particles"] if layer["particles"] in kinds else None
            put = partial(form.put, layer, ("particles",))
            self.enter(("layer", place, "particles"), self.choice({name: name for name in kinds}, value, "kind", put))
            return
        if medium == "coefficients":
            ui.label(str(layer["phase"])).classes("vrte-note")
        with make_row("" if medium in ("mixture", "volumes") else "no-wrap"):
            if medium in ("mixture", "volumes"):
                for name in kinds:
                    key = "particles" if medium == "mixture" else "volume_fractions"
                    self.field("layer", place, key, name, classes="w-[150px]")
            else:
                if isinstance(layer["phase"], dict):
                    for key in layer["phase"]:
                        self._key("layer", place, "phase", key)
                self.field("layer", place, "albedo")

    def _thickness(self, place: int, layer: form.Content, medium: str) -> None:
        geometric = form.is_geometric(layer)
        with make_row():
            self.field("layer", place, "thickness_um" if geometric else "thickness")
            if geometric and medium != "volumes":
                self.field("layer", place, "volume_fraction")
        if medium in ("particles", "mixture", "volumes"):
            self.switch("thickness in µm", geometric, partial(form.set_geometric, layer))

    def _base(self) -> None:
        content = self.bench.content
        with self.section("Base", "horizontal_rule"):
            kind = content.get("base", {}).get("kind", "black")
            names = form.list_base_choices(kind)
            self.choice(names, kind, "what lies beneath", partial(form.set_base, content))
            keys = BASES[kind].keys if kind in BASES else {}
            has_facets = keys.keys() >= FACETS.keys()
            for key in keys:
                if not (has_facets and key in FACETS):
                    self._key("base", key)
            if has_facets:
                self._facets(content["base"], "base")
            self.complaint("base")

    def _directions(self) -> None:
        content = self.bench.content
        with self.section("Directions of the BRDF", "explore", opened=False):
            ui.label(LIST_HINT).classes("vrte-note")
            degrees = form.is_in_degrees(content)
            self.switch("in degrees from the normal", degrees, partial(form.set_degrees, content))
            for key in ("mu_i", "mu_o"):
                self.field("brdf", ANGLES[key] if degrees else key)
            self.field("brdf", "phi_deg")

    def _inside(self) -> None:
        content = self.bench.content

        def set_field(wanted: bool) -> None:
            form.put(content, ("field",), copy.deepcopy(form.START["field"]) if wanted else None)

        with self.section("Inside the layers", "vertical_align_center", opened=False):
            self.switch("the radiance field, too", "field" in content, set_field)
            if "field" in content:
                beam = ANGLES["mu0"] if ANGLES["mu0"] in content["field"] else "mu0"
                for key in (beam, "tau", "phi_deg", "stokes", "mu"):
                    self.field("field", key)

    def _accuracy(self) -> None:
        content = self.bench.content
        with self.section("Accuracy", "tune", opened=False):
            with make_row():
                self.field("accuracy")
                self.field("nodes")
            value, names = content.get("truncation", "auto"), {name: name for name in CHOICES}
            self.choice(names, value, "truncation of forward peaks", partial(form.put, content, ("truncation",)))

    # pieces

    @contextmanager
    def section(self, title: str, symbol: str, opened: bool = True) -> Iterator[None]:
        """A part of the form that opens and closes, and stays so when it is drawn anew."""
        view = self.bench.view
        part = ui.expansion(title, icon=symbol, value=view.get(title, opened)).props("dense dense-toggle")
        part.classes("vrte-section w-full").on_value_change(lambda event: view.update({title: bool(event.value)}))
        self.section_now = part
        with part, ui.column().classes("w-full gap-2 px-1 pb-2"):
            yield

    def adder(self, text: str, add: Callable[[form.Content], Any]) -> None:
        """A button that adds something."""
        button = ui.button(text, icon="add", on_click=lambda: self.change(add, self.bench.content))
        button.props("flat dense no-caps size=sm color=primary")

    def switch(self, text: str, value: bool, act: Callable[[bool], Any]) -> None:
        """A box that is ticked or not; the rest of the form depends on it."""
        box = ui.checkbox(text, value=value).props("dense size=sm").classes("vrte-note")
        box.on_value_change(lambda event: self.change(act, bool(event.value)))

    def field(self, *place: str | int, classes: str = "") -> Any:
        """A text that is read, put in its place and checked while somebody types."""
        content = self.bench.content
        about = find_field(place, content)

        def typed(event: Any) -> None:
            form.put(content, place, parse_field_text(str(event.value or "")))
            self.check()

        found = ui.input(
            about.label.format(place[-1]), value=write_field_text(form.get_value(content, place)), on_change=typed
        )
        found.props("outlined dense stack-label hide-bottom-space debounce=120 autocomplete=off spellcheck=false")
        found.without_auto_validation()  # it would wipe out the message that `typed` has brought
        found.props(f"maxlength={LONGEST_TEXT}").classes(f"vrte-field {classes}")
        found.props.update({name: text for name, text in (("placeholder", about.empty), ("hint", about.hint)) if text})
        self.enter(place, found)
        return found

    def choice(self, names: dict[str, str], value: Any, label: str, act: Callable[[Any], None]) -> Any:
        """One of several; the rest of the form may depend on it."""
        found = ui.select(names, value=value, label=label)
        found.on_value_change(lambda event: self.change(act, event.value))
        found.without_auto_validation()
        return found.props("outlined dense options-dense stack-label hide-bottom-space").classes("w-full vrte-field")

    def complaint(self, *place: str | int) -> None:
        """Where messages about a whole table are shown."""
        self.enter(place, Complaint())

    def enter(self, place: Place, field: Any) -> None:
        """A field, or what stands for one, where messages about it find it."""
        self.fields[place], self.sections[place] = field, self.section_now


class Complaint:
    """A line that is there when something is wrong."""

    def __init__(self) -> None:
        self.label = ui.label().classes("vrte-error")
        self.id, self.error = self.label.id, None

    @property
    def error(self) -> str | None:
        return self.label.text or None

    @error.setter
    def error(self, message: str | None) -> None:
        self.label.set_text(message or "")
        self.label.set_visibility(bool(message))


def make_row(wrap: str = "no-wrap") -> Any:
    """Fields beside each other."""
    return ui.row().classes(f"w-full gap-2 {wrap}")


def make_card_head() -> Any:
    """The name of a card, and its buttons."""
    return ui.row().classes("w-full items-center no-wrap gap-1")


def make_icon(symbol: str, tip: str, act: Callable[[], Any] | None = None) -> Any:
    """A small round button."""
    return ui.button(icon=symbol, on_click=act).props(f'flat dense round size=sm aria-label="{tip}"').tooltip(tip)
