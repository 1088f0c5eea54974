"""The left side of the page: the scene as fields, each checked as it is typed."""

import copy
from functools import partial

from nicegui import ui

from vrte.app.form import content as form
from vrte.app.page.controls import Controls, make_card_head, make_icon, make_row
from vrte.formats.bases import BASES, FACETS
from vrte.formats.particle_sources import SOURCES
from vrte.formats.phases import PHASES
from vrte.formats.scene_file import ANGLES
from vrte.optics.crowding import INDEPENDENT, PACKINGS
from vrte.optics.truncation import CHOICES

LIST_HINT = "one number, several with commas, or start:stop:count"


class FormPanel(Controls):
    """The form of a scene."""

    def lay_out(self) -> None:
        content = self.session.content
        with self.section("Light", "wb_sunny"):
            self.field("wavelength_um")
            self.key("host_index")
        self._particles()
        self._layers()
        self._base()
        with self.section("Directions of the BRDF", "explore", opened=False):
            ui.label(LIST_HINT).classes("vrte-note")
            degrees = form.is_in_degrees(content)
            self.switch("in degrees from the normal", degrees, partial(form.set_degrees, content))
            for key in ("mu_i", "mu_o", "phi_deg"):
                self.field("brdf", ANGLES.get(key, key) if degrees else key)
        self._inside()
        with self.section("Accuracy", "tune", opened=False):
            with make_row():
                self.field("accuracy")
                self.field("nodes")
            value, names = content.get("truncation", "auto"), {name: name for name in CHOICES}
            self.choice(names, value, "truncation of forward peaks", partial(form.put, content, ("truncation",)))

    def _particles(self) -> None:
        known = self.session.content.get("particles", {})
        with self.section("Particles", "grain"):
            if not known:
                ui.label("None: the layers name their phase functions.").classes("vrte-note")
            for name in known:
                with ui.column().classes("vrte-card"):
                    self._kind(name)
            self.adder("add a kind of particle", form.add_kind)

    def _kind(self, name: str) -> None:
        content = self.session.content
        kind = content["particles"][name]
        with make_card_head():
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

        source = form.get_source(kind)
        names = {one: row.words for one, row in SOURCES.items()}
        self.enter(("particles", name, "source"), self.choice(names, source, "what", partial(form.set_source, kind)))
        self.keys((("particles", name, key) for key in SOURCES[source].keys), name_after)
        if SOURCES[source].sized:
            mode = form.get_size_mode(kind)
            names = {one: words for one, (words, _) in form.SIZE_MODES.items()}
            self.choice(names, mode, "size", partial(form.set_size_mode, kind))
            self.keys(("particles", name, *below) for below in form.list_size_places(mode))
        if "host_index" in kind or any(map(form.is_interface, content["layer"])):
            self.key("particles", name, "host_index")
        self.complaint("particles", name)

    def _layers(self) -> None:
        with self.section("Layers, top first", "layers"):
            for place in range(len(self.session.content["layer"])):
                with ui.column().classes("vrte-card"):
                    self._layer(place)
            with make_row():
                self.adder("add a layer", form.add_layer)
                self.adder("add a surface or interface", form.add_interface)

    def _layer(self, place: int) -> None:
        content = self.session.content
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
                    self.key("layer", place, "interface", key)
            rough, put = layer["interface"].get("roughness", 0) != 0, partial(form.set_rough, layer["interface"])
            self.choice(form.SURFACES, "rough" if rough else "smooth", "surface", put)
            self.keys(("layer", place, "interface", key) for key in (FACETS if rough else ()))
        else:
            medium = form.get_medium(layer)
            names = {name: words for name, (words, _) in form.MEDIA.items()}
            self.choice(names, medium, "filled with", partial(form.set_medium, content, place))
            self._medium(place, layer, medium)
            self._thickness(place, layer, medium)
            if form.has_medium(content, place):
                self.key("layer", place, "host_index")
        self.complaint("layer", place)

    def _medium(self, place: int, layer: form.Content, medium: str) -> None:
        known = list(self.session.content.get("particles", {}))
        if medium == "particles":
            value = layer["particles"] if layer["particles"] in known else None
            put = partial(form.put, layer, ("particles",))
            self.enter(("layer", place, "particles"), self.choice({name: name for name in known}, value, "kind", put))
        elif medium in ("mixture", "volumes"):
            with make_row(""):
                for name in known:
                    key = "particles" if medium == "mixture" else "volume_fractions"
                    self.field("layer", place, key, name, classes="w-[150px]")
        elif medium == "coefficients":
            self.key("layer", place, "phase")
            self.keys(("layer", place, key) for key in ("albedo", "tolerance"))
        elif medium != "clear":
            self.keys([*(("layer", place, "phase", key) for key in PHASES[medium].keys), ("layer", place, "albedo")])

    def _thickness(self, place: int, layer: form.Content, medium: str) -> None:
        geometric, held = form.is_geometric(layer), medium in form.HELD
        with make_row():
            self.field("layer", place, "thickness_um" if geometric else "thickness")
            if held and medium != "volumes" and (geometric or form.is_fraction_asked(self.session.content, place)):
                self.field("layer", place, "volume_fraction")
        if held:
            self.switch("thickness in µm", geometric, partial(form.set_geometric, layer))
            packing = layer.get("packing", INDEPENDENT)
            names = {name: name for name in PACKINGS}
            found = self.choice(names, packing, "close particles scatter", partial(form.set_packing, layer))
            self.enter(("layer", place, "packing"), found)

    def _base(self) -> None:
        content = self.session.content
        with self.section("Base", "horizontal_rule"):
            kind = content.get("base", {}).get("kind", "black")
            names = {name: row.words for name, row in BASES.items()}
            self.choice(names, kind, "what lies beneath", partial(form.set_base, content))
            self.keys(("base", key) for key in (BASES[kind].keys if kind in BASES else ()))
            self.complaint("base")

    def _inside(self) -> None:
        content = self.session.content
        with self.section("Inside the layers", "vertical_align_center", opened=False):
            start = copy.deepcopy(form.START["field"])
            self.switch(
                "the radiance field, too",
                "field" in content,
                lambda wanted: form.put(content, ("field",), start if wanted else None),
            )
            if "field" in content:
                beam = ANGLES["mu0"] if ANGLES["mu0"] in content["field"] else "mu0"
                for key in (beam, "tau", "phi_deg", "stokes", "mu"):
                    self.field("field", key)
