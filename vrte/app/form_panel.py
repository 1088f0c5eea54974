"""The left side of the page: the scene as fields, each checked as it is typed."""

import copy
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from nicegui import ui

from vrte.app import form
from vrte.app.form import Place
from vrte.app.state import Bench
from vrte.basics.errors import SceneError
from vrte.formats.scene_file import ANGLES
from vrte.optics.refractive_index import MATERIALS
from vrte.optics.truncation import CHOICES

MEDIUM_NAMES = {
    "particles": "particles of one kind",
    "mixture": "a mixture, by number",
    "volumes": "a mixture, by volume",
    "isotropic": "isotropic scatterers",
    "rayleigh": "Rayleigh scatterers",
    "henyey_greenstein": "Henyey-Greenstein scatterers",
    "table": "a table of coefficients",
}
SIZE_NAMES = {
    "radius": "one radius",
    "diameter": "one diameter",
    "lognormal": "lognormal radii",
    "lognormal, diameters": "lognormal diameters",
    "gamma": "gamma radii",
    "gamma, diameters": "gamma diameters",
}
LOGNORMAL, GAMMA = ("size", "lognormal"), ("size", "gamma")
SIZE_FIELDS = {
    "radius": ((("radius_um",), "radius [µm]"),),
    "diameter": ((("diameter_um",), "diameter [µm]"),),
    "lognormal": (((*LOGNORMAL, "median_um"), "median radius [µm]"), ((*LOGNORMAL, "sigma"), "sigma")),
    "lognormal, diameters": (
        ((*LOGNORMAL, "median_diameter_um"), "median diameter [µm]"),
        ((*LOGNORMAL, "sigma"), "sigma"),
    ),
    "gamma": (((*GAMMA, "r_eff_um"), "r_eff [µm]"), ((*GAMMA, "v_eff"), "v_eff")),
    "gamma, diameters": (((*GAMMA, "d_eff_um"), "d_eff [µm]"), ((*GAMMA, "v_eff"), "v_eff")),
}
BASE_NAMES = {"black": "black", "lambertian": "white or grey (Lambertian)"}
LIST_HINT = "one number, several with commas, or start:stop:count"


class FormPanel:
    """Fields over the content of a bench; ``changed`` is called after each change."""

    def __init__(self, bench: Bench, changed: Callable[[], None]) -> None:
        self.bench, self.changed = bench, changed
        self.wrong: tuple[str, str] | None = None  # the first that is wrong: its message, and the field's dotted key
        self.fields: dict[str, Any] = {}  # by dotted key
        self.sections: dict[str, Any] = {}  # of each field
        self.section_now: Any = None
        self.body = ui.column().classes("w-full gap-0 no-wrap")
        self.general = ui.label().classes("vrte-error px-4 pb-1")
        self.draw()

    def draw(self) -> None:
        """Everything anew, after what is there has changed."""
        self.fields.clear()
        self.body.clear()
        with self.body:
            self._light()
            self._particles()
            self._layers()
            self._base()
            self._directions()
            self._inside()
            self._accuracy()
        self.check()

    def check(self) -> None:
        """Every message at its field; what belongs to none, below."""
        bench = self.bench
        found = form.problems(bench.content, bench.folder, bench.tables)
        at_fields: dict[str, str] = {}
        rest = []
        for key, message in found.items():
            owner = max((known for known in self.fields if holds(known, key)), key=len, default=None)
            if owner is None:
                rest.append(message)
            else:
                at_fields.setdefault(owner, message)
        for key, field in self.fields.items():
            field.error = at_fields.get(key)
            if key in at_fields:
                self.sections[key].set_value(True)  # a message must be seen
        self.general.set_text("; ".join(rest))
        self.general.set_visibility(bool(rest))
        self.wrong = next(((message, key) for key, message in (*at_fields.items(), *(("", one) for one in rest))), None)
        self.changed()

    def jump(self) -> None:
        """To the field that is wrong."""
        key = self.wrong[1] if self.wrong else ""
        if key in self.fields:
            self.sections[key].set_value(True)
            ui.run_javascript(f"setTimeout(() => vrte.jump({self.fields[key].id}), 250)")

    def change(self, action: Callable[[], Any]) -> None:
        """Something other than a field's text: done, then all is drawn anew; what cannot be done is told."""
        try:
            action()
        except SceneError as error:
            ui.notify(str(error), type="warning", multi_line=True)
        self.draw()
        with self.body:  # what was clicked is gone
            ui.run_javascript("vrte.focus_again()")

    # parts

    def _light(self) -> None:
        with self.section("Light", "wb_sunny"):
            self.field(
                ("wavelength_um",), "wavelengths in vacuum [µm]", "one, several with commas, or start:stop:count"
            )
            self.field(("host_index",), "refractive index of the host medium", "1 if empty", optional=True)

    def _particles(self) -> None:
        kinds = self.bench.content.get("particles", {})
        with self.section("Particles", "grain"):
            if not kinds:
                ui.label("None: the layers name their phase functions.").classes("vrte-note")
            for name in kinds:
                self._kind(name)
            self.adder("add a kind of particle", lambda: form.add_kind(self.bench.content))

    def _kind(self, name: str) -> None:
        content, place = self.bench.content, ("particles", name)
        kind = content["particles"][name]
        with ui.column().classes("vrte-card"):
            with ui.row().classes("w-full items-center no-wrap gap-1"):
                label = (
                    ui.input(value=name)
                    .props('dense borderless maxlength=60 aria-label="name of the kind"')
                    .classes("vrte-name grow")
                )
                label.tooltip("the name of this kind")
                label.on("change", lambda: self.change(lambda: form.rename_kind(content, name, str(label.value))))
                icon("close", "remove this kind", lambda: self.change(lambda: form.remove_kind(content, name)))
            index = self.field((*place, "index"), "substance", "a name, a database path, or n, k")
            before = kind.get("index")

            def name_after() -> None:
                """Once it is typed or chosen; a card that has its name by hand keeps it."""
                form.name_after(content, name, before)
                if name not in content["particles"]:
                    self.draw()

            def choose(material: str) -> None:
                index.set_value(material)
                name_after()

            index.on("change", name_after)
            with index.add_slot("append"):
                arrow = ui.button(icon="arrow_drop_down").props(
                    'flat dense round size=sm aria-label="known substances"'
                )
            with arrow, ui.menu().props("auto-close"):
                for material in MATERIALS:
                    ui.menu_item(material, lambda material=material: choose(material))
            mode = form.size_mode(kind)
            self.choice(SIZE_NAMES, mode, "size", lambda new: form.set_size_mode(kind, new))
            with ui.row().classes("w-full no-wrap gap-2"):
                for below, label_text in SIZE_FIELDS[mode]:
                    self.field((*place, *below), label_text)
            self.complaint(place)

    def _layers(self) -> None:
        content = self.bench.content
        with self.section("Layers, top first", "layers"):
            for place in range(len(content["layer"])):
                self._layer(place)
            self.adder("add a layer", lambda: form.add_layer(content))

    def _layer(self, place: int) -> None:
        content = self.bench.content
        layer, last = content["layer"][place], len(content["layer"]) - 1
        with ui.column().classes("vrte-card"):
            with ui.row().classes("w-full items-center no-wrap gap-1"):
                ui.label(f"Layer {place + 1}").classes("vrte-name grow")
                up = icon("arrow_upward", "up", lambda: self.change(lambda: form.move_layer(content, place, -1)))
                down = icon("arrow_downward", "down", lambda: self.change(lambda: form.move_layer(content, place, 1)))
                gone = icon(
                    "close", "remove this layer", lambda: self.change(lambda: form.remove_layer(content, place))
                )
                up.set_enabled(place > 0), down.set_enabled(place < last), gone.set_enabled(last > 0)
            medium = form.medium_of(layer)
            names = {name: text for name, text in MEDIUM_NAMES.items() if name != "table" or medium == "table"}
            self.choice(names, medium, "filled with", lambda new: form.set_medium(content, place, new))
            self._medium(place, layer, medium)
            self._thickness(place, layer, medium)
            self.complaint(("layer", place))

    def _medium(self, place: int, layer: dict[str, Any], medium: str) -> None:
        content = self.bench.content
        kinds = list(content.get("particles", {}))
        if medium == "particles":
            value = layer["particles"] if layer["particles"] in kinds else None
            chosen = self.choice(
                {name: name for name in kinds}, value, "kind", lambda new: form.put(layer, ("particles",), new)
            )
            self.enter(("layer", place, "particles"), chosen)
        elif medium == "mixture":
            with ui.row().classes("w-full gap-2"):
                for name in kinds:
                    where = ("layer", place, "particles", name)
                    self.field(where, f"{name}: number fraction", classes="w-[150px]", optional=True)
        elif medium == "volumes":
            with ui.row().classes("w-full gap-2"):
                for name in kinds:
                    where = ("layer", place, "volume_fractions", name)
                    self.field(where, f"{name}: of the volume", "5 % or 0.05", "w-[150px]", optional=True)
        elif medium == "table":
            ui.label(str(layer["phase"])).classes("vrte-note")
            self.field(("layer", place, "albedo"), "single-scattering albedo")
        else:
            with ui.row().classes("w-full no-wrap gap-2"):
                if medium == "henyey_greenstein":
                    self.field(("layer", place, "phase", medium), "asymmetry g")
                elif medium == "rayleigh":
                    self.field(("layer", place, "phase", medium), "depolarization")
                self.field(("layer", place, "albedo"), "single-scattering albedo")

    def _thickness(self, place: int, layer: dict[str, Any], medium: str) -> None:
        geometric = form.is_geometric(layer)
        with ui.row().classes("w-full no-wrap gap-2"):
            if geometric:
                self.field(("layer", place, "thickness_um"), "thickness [µm]")
                if medium != "volumes":
                    self.field(("layer", place, "volume_fraction"), "volume fraction", "5 % or 0.05")
            else:
                self.field(("layer", place, "thickness"), "optical thickness", "inf: without end")
        if medium in ("particles", "mixture", "volumes"):
            switch = ui.checkbox("thickness in µm", value=geometric).props("dense size=sm")
            switch.classes("vrte-note").on_value_change(
                lambda event: self.change(lambda: form.set_geometric(layer, bool(event.value)))
            )

    def _base(self) -> None:
        content = self.bench.content
        with self.section("Base", "horizontal_rule"):
            kind = content.get("base", {}).get("kind", "black")
            self.choice(BASE_NAMES, kind, "what lies beneath", lambda new: form.set_base(content, new))
            if kind == "lambertian":
                self.field(("base", "albedo"), "albedo of the base")

    def _directions(self) -> None:
        with self.section("Directions of the BRDF", "explore", opened=False):
            ui.label(LIST_HINT).classes("vrte-note")
            content = self.bench.content
            degrees = form.in_degrees(content)
            switch = (
                ui.checkbox("in degrees from the normal", value=degrees).props("dense size=sm").classes("vrte-note")
            )
            switch.on_value_change(lambda event: self.change(lambda: form.set_degrees(content, bool(event.value))))
            for name, word in (("mu_i", "incidence"), ("mu_o", "exit")):
                label = f"angles of {word} [°]" if degrees else f"cosines of {word} µ_{name[-1]}"
                self.field(("brdf", ANGLES[name] if degrees else name), label)
            self.field(("brdf", "phi_deg"), "azimuths φ [°]", "0 forward, 180 back")

    def _inside(self) -> None:
        content = self.bench.content
        with self.section("Inside the layers", "vertical_align_center", opened=False):
            switch = ui.checkbox("the radiance field, too", value="field" in content).props("dense")
            switch.on_value_change(lambda event: self.change(lambda: self._set_field(bool(event.value))))
            if "field" not in content:
                return
            if ANGLES["mu0"] in content["field"]:
                self.field(("field", ANGLES["mu0"]), "angle of the beam's incidence [°]")
            else:
                self.field(("field", "mu0"), "cosine of the beam's incidence µ_0")
            self.field(("field", "tau"), "optical depths τ", "five, evenly if empty", optional=True)
            self.field(("field", "phi_deg"), "azimuths φ [°]", "0 and 180: the plane of incidence")
            self.field(("field", "stokes"), "Stokes vector of the beam", "1, 0, 0, 0 if empty", optional=True)
            self.field(("field", "mu"), "signed cosines µ", "the nodes if empty", optional=True)

    def _set_field(self, wanted: bool) -> None:
        self.bench.content.pop("field", None)
        if wanted:
            self.bench.content["field"] = copy.deepcopy(form.START["field"])

    def _accuracy(self) -> None:
        with self.section("Accuracy", "tune", opened=False):
            with ui.row().classes("w-full no-wrap gap-2"):
                self.field(("accuracy",), "accuracy", "1e-6 if empty", optional=True)
                self.field(("nodes",), "nodes a hemisphere", "chosen", optional=True)
            value = self.bench.content.get("truncation", "auto")
            self.choice(
                {name: name for name in CHOICES}, value, "truncation of forward peaks", self._put(("truncation",))
            )

    def _put(self, place: Place) -> Callable[[Any], None]:
        return lambda value: form.put(self.bench.content, place, value)

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

    def adder(self, text: str, act: Callable[[], Any]) -> None:
        """A button that adds something."""
        button = ui.button(text, icon="add", on_click=lambda: self.change(act))
        button.props("flat dense no-caps size=sm color=primary")

    def field(self, place: Place, label: str, hint: str = "", classes: str = "", optional: bool = False) -> Any:
        """A text that is read, put in its place and checked while somebody types."""

        def typed(event: Any) -> None:
            form.put(self.bench.content, place, form.value_of(str(event.value or "")))
            self.check()

        found = ui.input(label, value=form.text_of(form.got(self.bench.content, place)), on_change=typed)
        found.props("outlined dense stack-label hide-bottom-space debounce=120 autocomplete=off spellcheck=false")
        found.without_auto_validation()  # it would wipe out the message that `typed` has brought
        found.props(f"maxlength={form.LONGEST_TEXT}").classes(f"vrte-field {classes}")
        if optional and hint:
            found.props["placeholder"] = hint
        elif hint:
            found.props["hint"] = hint
        self.enter(place, found)
        return found

    def choice(self, names: dict[str, str], value: Any, label: str, act: Callable[[Any], None]) -> Any:
        """One of several; the rest of the form may depend on it."""
        found = ui.select(names, value=value, label=label)
        found.on_value_change(lambda event: self.change(lambda: act(event.value)))
        found.without_auto_validation()
        return found.props("outlined dense options-dense stack-label hide-bottom-space").classes("w-full vrte-field")

    def complaint(self, place: Place) -> None:
        """Where messages about a whole table are shown."""
        self.enter(place, Complaint())

    def enter(self, place: Place, field: Any) -> None:
        """A field, or what stands for one, where messages about it find it."""
        key = form.dotted(place)
        self.fields[key], self.sections[key] = field, self.section_now


def holds(known: str, key: str) -> bool:
    """Whether a dotted key is that one or lies below it.

    >>> holds("layer[1]", "layer[1].albedo"), holds("brdf.mu", "brdf.mu_i")
    (True, False)
    """
    return key.startswith(known) and key[len(known) :][:1] in ("", ".", "[")


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


def icon(symbol: str, tip: str, act: Callable[[], Any]) -> Any:
    """A small round button."""
    return ui.button(icon=symbol, on_click=act).props(f'flat dense round size=sm aria-label="{tip}"').tooltip(tip)
