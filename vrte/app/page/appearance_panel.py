"""The tab that shows what a paint looks like over black and over white, while its sliders are moved."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import ui

from vrte.app.form.checks import begin_with_material, list_films
from vrte.app.form.fields import get_value, translate_message
from vrte.app.form.numbers import STEPS, FormNumber, explain_missing, list_sliders
from vrte.app.form.units import BY_WEIGHT, WET, PaintUnits, check_per_cent, list_units, read_number
from vrte.app.page import controls
from vrte.app.page.controls import NumberSlider, add_message, add_note, add_text, show
from vrte.app.solving import appearance
from vrte.app.solving.appearance import CARDS, OTHER_CARDS, OVER_BASE, Appeared
from vrte.appearance.colours import convert_to_hex
from vrte.appearance.hiding import Conditions
from vrte.basics.errors import Place, SceneError
from vrte.fit.recipe import find_densities, read_film
from vrte.formats.toml_table import read_fraction
from vrte.pictures.results import spectra

ALBEDOS = {"black": (0.0, 0.2), "white": (0.4, 1.0)}  # of the cards
THROTTLE = 0.1  # seconds between two positions of a slider
LOOK_EVERY = 0.03  # seconds between two looks whether an answer has come
BRIGHT = 55.0  # L*: words on darker colours are white
NAMES = {"X": "X", "Y": "Y", "Z": "Z", "L": "L*", "a": "a*", "b": "b*", "C": "C*", "h": "h [°]"}
LOOKS = {  # what is chosen, and how wide that is [pixels]
    "illuminant": (appearance.ILLUMINANTS, 175),
    "observer": (appearance.OBSERVERS, 130),
    "geometry": (appearance.GEOMETRIES, 240),
}


class AppearancePanel:
    """Sliders over the form's numbers, and colours, gloss and hiding that follow; ``results``: the panel around it."""

    def __init__(self, results: Any) -> None:
        self.results, self.session, self.view = results, results.session, results.view
        self.view.setdefault("viewing", Conditions())
        self.view.setdefault("over_base", False)
        self.view.setdefault("units", PaintUnits())
        self.sliders: dict[Place, tuple[FormNumber, NumberSlider]] = {}
        self.cards: dict[str, NumberSlider] = {}
        self.typed: dict[Place, float | None] = {}  # what the text means that was typed beside a slider, if anything
        self.drawn: Any = None  # units, and what they ask for
        self.missing = ""
        self.shown: Any = None
        self.figure: Any = None  # what it shows, and whether in the dark
        self.moved: Place | None = None
        with ui.row().classes("w-full gap-2 pt-3 items-center vrte-looks"):
            classes = "px-2 vrte-begin"
            begin = controls.add_button(
                "Begin with a paint", "format_paint", None, "outline dense", classes, plain=True
            )
            with begin, controls.make_menu():
                for title in list_films():
                    controls.add_menu_item(title, partial(self.begin_with, title))
            for key, (names, width) in LOOKS.items():
                controls.select(names, getattr(self.view["viewing"], key), key, partial(self.look, key), width)
            self.over = controls.select([], None, "cards", self.lay_over, 215)
        self.message = add_message("vrte-warning w-full mt-2", "status")
        with ui.row().classes("w-full gap-x-4 gap-y-1 items-center pt-2 relative vrte-now") as self.colours:
            with ui.element("div").classes("vrte-drawdown") as self.drawdown:
                self.swatches = [make_swatch() for _ in range(2)]
                self.old = ui.label("for the previous setting").classes("vrte-warning vrte-mark").props("role=status")
            with ui.column().classes("gap-0"):
                self.contrast = add_note("vrte-heading")
                self.apart, self.changed, self.gloss, self.hiding = (add_message() for _ in range(4))
                with ui.row().classes("gap-x-1 gap-y-0"):
                    quiet = controls.QUIET
                    controls.add_button("Compare with this from now on", "bookmark_border", self.keep, quiet)
                    for text, act in results.reports.items():
                        controls.add_button(text, "download", act, quiet)
        self.bars = ui.element("div").classes("vrte-bars")
        self.needs = ui.row().classes("w-full gap-x-6 gap-y-1 px-2 items-center")
        with ui.row().classes("w-full items-center gap-2 no-wrap vrte-status") as self.progress:
            self.status = add_note()
            self.stop = controls.add_button("Stop", "stop", self.end, f"{controls.QUIET} {controls.DANGER}")
        self.spoken = add_note("vrte-hidden", "status aria-live=polite")
        with ui.column().classes("w-full gap-2 no-wrap pb-4 vrte-below") as self.answer:
            self.beyond, self.notes = add_message(), add_message("vrte-warning w-full")
            with ui.element("div").classes("vrte-look"):
                with ui.column().classes("gap-0 no-wrap vrte-spectra"):
                    results.add_plot("appearance")
                self.numbers = ui.element("div")
        self.timer = ui.timer(LOOK_EVERY, self.follow, active=False)

    def _draw_sliders(self) -> None:
        """One a number of the form; anew where there are others, or a number has left its slider's range."""
        content, units = self.session.content, self.view["units"]
        wanted = {slider.place: slider for slider in list_sliders(content)}
        now = {place: slider for place, (slider, _) in self.sliders.items()}
        same = {place: one.label for place, one in now.items()} == {place: one.label for place, one in wanted.items()}
        needs = units.chosen, self._list_ingredients([*wanted])
        if self.drawn != needs or not same or not all(now[place].reaches(one.start) for place, one in wanted.items()):
            self.drawn = needs
            self._lay_out_sliders([*wanted.values()])
        for place, (number, row) in self.sliders.items():
            value = read_fraction(get_value(content, place)) or 0.0
            text, message = row.text, row.message.text
            if place not in self.typed or self.typed[place] not in (value, None):
                self.typed.pop(place, None)
                text, message = units.write(content, place, value)
            row.show(text, None if place == self.moved else number.find_step(value), message)
        viewing = self.view["viewing"]
        for side, row in self.cards.items():
            row.show(f"{getattr(viewing, side):g}", getattr(viewing, side))
        pair = viewing.black, viewing.white
        cards = next((name for name, albedos in CARDS.items() if albedos == pair), OTHER_CARDS)
        self.over.set_options([*CARDS, OVER_BASE, OTHER_CARDS], value=OVER_BASE if self.view["over_base"] else cards)

    def _lay_out_sliders(self, wanted: list[FormNumber]) -> None:
        """A slider of each number and of each card, and fields for what the units ask for."""
        content, units = self.session.content, self.view["units"]
        self.sliders.clear()
        self.typed.clear()
        self.bars.clear()
        with self.bars:
            for one in wanted:
                names = list_units(content, one.place)
                label = one.label.removesuffix(" [µm]") if names else one.label
                acts = partial(self.move, one.place), partial(self.type, one.place)
                chosen = units.get(content, one.place), partial(self.measure_in, one.place)
                row = NumberSlider(label, (0, STEPS), 1, THROTTLE, *acts, names, *chosen)
                self.sliders[one.place] = one, row
            for side, ends in ALBEDOS.items():
                acts = partial(self.paint_card, side), partial(self.type_card, side)
                self.cards[side] = NumberSlider(f"albedo of the {side} card", ends, 0.01, THROTTLE, *acts)
        self.needs.clear()
        _, densities = self.drawn
        asked = {"volume solids of the wet film [%]": (units.solids and 100.0 * units.solids, self.type_solids)}
        asked = asked if WET in units.chosen.values() else {}
        asked |= {
            f"density of {name} [kg/l]": (one, partial(self.type_density, name)) for name, one in densities.items()
        }
        with self.needs:
            for label, (value, take) in asked.items():
                with ui.row().classes("items-center gap-2 no-wrap"):
                    add_note().set_text(label)
                    field = add_text(label, lambda text: None)
                    field.set_value(f"{value:g}" if value else "")
                    field.on_value_change(lambda event, take=take: take(str(event.value or "")))
            self.unread = add_message("vrte-error")

    def _list_ingredients(self, places: list[Place]) -> dict[str, float | None]:
        """What the films hold whose loads are by weight, and the densities [kg/l] that are known of it."""
        content, units = self.session.content, self.view["units"]
        found: dict[str, float | None] = {}
        for place in places:
            if units.get(content, place) == BY_WEIGHT:
                film = read_film(content, int(place[1]), Path())
                known = find_densities(film, units.list_given(film))
                found |= {name: known.get(name) for name in film.parts}
        return found

    # what the user does

    def begin_with(self, title: str) -> None:
        """A paint: the form gets it."""
        self.view.pop("before", None)
        self.results.fill(*begin_with_material(list_films()[title]))

    def look(self, key: str, value: Any) -> None:
        """Shows the paint in another light, to another observer, in another geometry or over another card."""
        self.view["viewing"] = replace(self.view["viewing"], **{key: value})
        self.refresh()

    def lay_over(self, name: str) -> None:
        """Over cards that have a name, or over the form's base."""
        if name in (None, OTHER_CARDS):
            return
        self.view["over_base"] = name == OVER_BASE
        if name in CARDS:
            black, white = CARDS[name]
            self.view["viewing"] = replace(self.view["viewing"], black=black, white=white)
        self.refresh()

    def paint_card(self, side: str, albedo: float) -> None:
        """A card of another albedo."""
        low, high = ALBEDOS[side]
        albedo = min(max(round(albedo, 3), low), high)
        if albedo != getattr(self.view["viewing"], side):
            self.view["over_base"] &= side == "black"
            self.look(side, albedo)

    def type_card(self, side: str, text: str) -> None:
        """An albedo that is typed."""
        with controls.report_errors(self.cards[side].message.set_text):
            value, (low, high) = read_number(text), ALBEDOS[side]
            if not low <= value <= high:
                raise SceneError(f"must be from {low:g} to {high:g}, not {value:g}")
            self.cards[side].message.set_text("")
            self.paint_card(side, value)

    def move(self, place: Place, step: float) -> None:
        """A slider to another step: its number goes to the form, and what changes there is shown here."""
        if place in self.sliders:  # it may have gone meanwhile
            self.typed.pop(place, None)
            self.moved = place
            self.results.write(place, self.sliders[place][0].find_value(step))
            self.moved = None

    def type(self, place: Place, text: str) -> None:
        """A number typed beside a slider in its unit, which the form checks."""
        if place not in self.sliders:
            return
        message, content = self.sliders[place][1].message, self.session.content
        self.typed[place] = None
        with controls.report_errors(message.set_text):
            self.typed[place] = value = self.view["units"].read(content, place, text)
            message.set_text("")
            if value != read_fraction(get_value(content, place)):
                self.results.write(place, value)

    def measure_in(self, place: Place, unit: str) -> None:
        """Another unit of all numbers of a kind."""
        self.view["units"] = self.view["units"].choose(place, unit)
        self._learn_gloss()
        self.refresh()

    def type_solids(self, text: str) -> None:
        """Takes the volume solids that are typed, and shows the numbers that follow from them."""
        with controls.report_errors(self.unread.set_text):
            solids = check_per_cent(read_number(text), "the volume solids")
            if solids == 0.0:
                raise SceneError("the volume solids must be above 0 %")
            self._convert_anew(solids=solids)

    def type_density(self, name: str, text: str) -> None:
        """The density of an ingredient [kg/l]."""
        with controls.report_errors(self.unread.set_text):
            density = read_number(text)
            if not 0.0 < density < 30.0:
                raise SceneError(f"the density of {name} must be above 0 and below 30 kg/l, not {density:g}")
            self._convert_anew(densities={**self.view["units"].densities, name: density})

    def _convert_anew(self, **known: Any) -> None:
        """Shows the numbers once more with what the units ask for."""
        self.unread.set_text("")
        self.view["units"] = replace(self.view["units"], **known)
        self.typed.clear()
        if self.drawn is not None:
            self.drawn = self.view["units"].chosen, self._list_ingredients([*self.sliders])  # the fields stay
        self.refresh()

    def keep(self) -> None:
        """Later colours are compared with those that are shown."""
        answer = self.session.live.answer
        if isinstance(answer, Appeared):
            self.view["before"] = answer.spectra
            self.refresh()

    def end(self) -> None:
        """Ends the process that works it out."""
        self.session.live.close()
        self.follow()

    # what follows

    def refresh(self) -> None:
        session, live = self.session, self.session.live
        unfit = explain_missing(session.content)
        self.missing = unfit or (f"The form waits: {session.wrong[0]}" if session.wrong else "")
        self.bars.set_visibility(not unfit)
        self._draw_sliders()
        if not self.missing:
            asked = {key: self.view.get(key) for key in ("viewing", "before", "over_base")}
            live.ask(session.make_task("appearance.AppearanceAnswerer", **asked))
            self.timer.activate()
        self._show()
        self.follow()

    def follow(self) -> None:
        """Looks whether an answer has come; greys one for another scene than the form's, or in another light."""
        live = self.session.live
        live.refresh()
        if live.answer is not self.shown:
            self._show()
        show(live.waits, self.stop)
        asked, now = live.answered, (self.session.content, self.view["viewing"], self.view["over_base"])
        old = asked is None or (asked.content, asked.more["viewing"], asked.more["over_base"]) != now
        show(old, self.old)
        for part in (self.colours, self.answer):
            part.classes("vrte-old") if old else part.classes(remove="vrte-old")
        if old:
            stopped = "stopped: a slider or a change of the form begins again"
            self.status.set_text("being worked out" if live.waits else stopped)
        if not live.waits:
            self.timer.deactivate()

    def _show(self) -> None:
        """The last answer, or why there is none."""
        answer = self.shown = self.session.live.answer
        refused = "" if answer is None or isinstance(answer, Appeared) else answer.message
        text = self.missing or translate_message(refused, self.session.content)
        self.message.set_text(text)
        show(not self.missing, self.progress)
        show(isinstance(answer, Appeared) and not text, self.colours, self.answer)
        if isinstance(answer, Appeared) and not text:
            self._write(answer)

    def _learn_gloss(self) -> None:
        """What the last answer's gloss says of the light from below the surface."""
        answer, asked = self.session.live.answer, self.session.live.answered
        for one in answer.readings if isinstance(answer, Appeared) and asked is not None else ():
            if one.quantity == "gloss" and one.geometry.startswith("60:"):
                self.view["units"] = self.view["units"].learn_gloss(asked.content, one.value)

    def _write(self, answer: Appeared) -> None:
        """Colours, numbers and spectra of an answer."""
        shades = answer.black, answer.white
        beyond_screens = []
        for (swatch, below, words), side, shade, then in zip(
            self.swatches, answer.sides, shades, answer.before or (None, None), strict=True
        ):
            colour_swatch(swatch, shade)
            swatch.props.update({"aria-label": f"colour {side}: {shade.hex}"})
            words.set_text(f"{side} {shade.hex}")
            below.set_visibility(then is not None)
            colour_swatch(below, then or shade)
            if shade.gamut_gap > 0.0:
                beyond_screens.append(
                    f"{side}: no screen of sRGB shows it; the swatch is {shade.gamut_gap:.1f} ΔE2000 away"
                )
        left, right = (shade_card(getattr(answer.viewing, side)) for side in ALBEDOS)
        self.drawdown.style(f"background: linear-gradient(90deg, {left} 50%, {right} 50%)")
        self.beyond.set_text("; ".join(beyond_screens))
        self.contrast.set_text(f"contrast ratio {answer.contrast:.4f}")
        self.apart.set_text(f"ΔE2000 between both: {answer.apart:.2f}")
        changed = [f"{side} {value:.2f}" for side, value in zip(answer.sides, answer.changed or (), strict=False)]
        self.changed.set_text(f"ΔE2000 from before: {'; '.join(changed)}" if changed else "")
        glosses = {one.geometry.partition(":")[0]: one.value for one in answer.readings if one.quantity == "gloss"}
        values = " / ".join(f"{value:.1f}" for value in glosses.values())
        gloss = f"gloss {'/'.join(f'{angle}°' for angle in glosses)}: {values} GU" if glosses else ""
        read = {one.quantity: one.value for one in answer.readings}
        length, rate = read.get("hiding thickness", 0.0), read.get("spreading rate", 0.0)
        (film, unit), target = self.view["units"].convert_film(length), appearance.TARGET
        rate *= length / film if film else 1.0
        hiding = f"hiding thickness {film:.3g} {unit} (contrast ratio {target:g}), {rate:.3g} m²/l" if length else ""
        waits = ("gloss and", "hiding thickness are being worked out") if answer.follows else ("", "")  # nothing jumps
        for line, text, words in zip((self.gloss, self.hiding), (gloss, hiding), waits, strict=True):
            line.set_text(text or words)
        self._learn_gloss()
        beyond = shades[0].extrapolation
        notes = [f"light beyond the wavelengths: {beyond}"] if beyond else []
        sentences = "; ".join([*notes, *answer.why_none, *answer.notes])
        self.notes.set_text(translate_message(sentences, self.session.content))
        at = answer.spectra.wavelength_um
        words = f"coarse: {appearance.COARSE}" if answer.coarse else f"{at.size}"
        ends = f"{at[0]:.4g} to {at[-1]:.4g} µm, accuracy {appearance.ACCURACY:g}"
        self.status.set_text(f"{words} wavelengths, {ends}; {answer.seconds:.2f} s" + "; more follows" * answer.follows)
        if not answer.follows:
            self.spoken.set_text("; ".join(one.text for one in (self.contrast, self.apart, self.hiding) if one.text))
        self.numbers.clear()
        with self.numbers:
            rows = [[label, *(f"{shade.numbers[key]:.2f}" for shade in shades)] for key, label in NAMES.items()]
            controls.add_table("", ["", *answer.sides], rows)
        figure = spectra(answer.spectra, self.view.get("before"), answer.viewing.geometry)
        wanted = figure.to_json(), bool(self.view.get("dark"))
        if wanted != self.figure:  # gloss and hiding change no curve
            self.figure = wanted
            self.results.draw_figure("appearance", figure)


def make_swatch() -> tuple[Any, Any, Any]:
    """A colour, below it that of before, and words on it."""
    with ui.element("div").props("role=img") as swatch:
        words = ui.label()
        with ui.element("div").classes("vrte-then") as below:
            ui.label("before")
    return swatch, below, words


def shade_card(albedo: float) -> str:
    """The grey of a card as a screen of sRGB shows it."""
    value = 12.92 * albedo if albedo <= 0.0031308 else 1.055 * albedo ** (1.0 / 2.4) - 0.055
    return convert_to_hex(np.full(3, value))


def colour_swatch(element: Any, shade: appearance.Shade) -> None:
    """A colour behind words that can be read on it."""
    element.style(f"background: {shade.hex}; color: {'#000' if shade.numbers['L'] > BRIGHT else '#fff'}")
