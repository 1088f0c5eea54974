"""The tab that shows what a paint looks like over black and over white, while its sliders are moved."""

from dataclasses import replace
from functools import partial
from typing import Any

from nicegui import ui

from vrte.app.form.checks import begin_with_material, list_films
from vrte.app.form.fields import get_value, translate_message
from vrte.app.form.numbers import STEPS, FormNumber, explain_missing, list_sliders
from vrte.app.page import controls
from vrte.app.page.controls import add_message, add_note, add_slider, show
from vrte.app.solving import appearance
from vrte.app.solving.appearance import Appeared
from vrte.appearance.hiding import Conditions
from vrte.basics.errors import Place
from vrte.formats.toml_table import read_fraction
from vrte.pictures.results import spectra

WHITES = 0.4, 1.0  # albedos of the white card
THROTTLE = 0.1  # seconds between two positions of a slider
LOOK_EVERY = 0.03  # seconds between two looks whether an answer has come
BRIGHT = 55.0  # L*: words on darker colours are white
NAMES = {"X": "X", "Y": "Y", "Z": "Z", "L": "L*", "a": "a*", "b": "b*", "C": "C*", "h": "h [°]"}
SIDES = ("over black", "over white")
LOOKS = {  # what is chosen, and how wide that is [pixels]
    "illuminant": (appearance.ILLUMINANTS, 175),
    "observer": (appearance.OBSERVERS, 130),
    "geometry": (appearance.GEOMETRIES, 255),
}


class AppearancePanel:
    """Sliders over the form's numbers, and colours, gloss and hiding that follow; ``results``: the panel around it."""

    def __init__(self, results: Any) -> None:
        self.results, self.session, self.view = results, results.session, results.view
        self.view.setdefault("viewing", Conditions())
        self.sliders: dict[Place, tuple[FormNumber, Any, Any]] = {}  # each with the field of its number and its bar
        self.white: Any = None  # the field of the white card's albedo, and its slider
        self.card: Any = None
        self.missing = ""
        self.shown: Any = None
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
        self.message = add_message("vrte-warning w-full mt-2", "status")
        with ui.row().classes("w-full gap-x-4 gap-y-1 items-center pt-2 relative vrte-now") as self.colours:
            with ui.element("div").classes("vrte-drawdown"):
                self.swatches = [make_swatch() for _ in SIDES]
                self.old = ui.label("for the previous setting").classes("vrte-warning vrte-mark").props("role=status")
            with ui.column().classes("gap-0"):
                self.contrast = add_note("vrte-heading")
                self.apart, self.changed, self.gloss, self.hiding = (add_message() for _ in range(4))
                controls.add_button("Compare with this from now on", "bookmark_border", self.keep, controls.QUIET)
        self.bars = ui.element("div").classes("vrte-bars")
        with ui.row().classes("w-full items-center gap-2 no-wrap vrte-status") as self.progress:
            self.spinner = ui.spinner(size="16px")
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
        content = self.session.content
        wanted = {slider.place: slider for slider in list_sliders(content)}
        now = {place: slider for place, (slider, _, _) in self.sliders.items()}
        same = {place: one.label for place, one in now.items()} == {place: one.label for place, one in wanted.items()}
        if self.white is None or not same or not all(now[place].reaches(one.start) for place, one in wanted.items()):
            self.bars.clear()
            self.sliders.clear()
            with self.bars:
                for place, one in wanted.items():
                    move, take = partial(self.move, place), partial(self.type, place)
                    self.sliders[place] = (one, *add_slider(one.label, (0, STEPS), 1, move, THROTTLE, take)[1:])
                card = "albedo of the white card"
                _, self.white, self.card = add_slider(card, WHITES, 0.01, self.whiten, THROTTLE, self.whiten)
        for place, (slider, field, bar) in self.sliders.items():
            value = read_fraction(get_value(content, place)) or 0.0
            if field.value != value:
                field.set_value(value)
            bar.props.update({"aria-valuetext": f"{value:.3g}"})
            if place != self.moved:
                bar.set_value(slider.find_step(value))
        for part in (self.white, self.card):
            part.set_value(self.view["viewing"].white)

    # what the user does

    def begin_with(self, title: str) -> None:
        """A paint: the form gets it."""
        self.view.pop("before", None)
        self.results.fill(*begin_with_material(list_films()[title]))

    def look(self, key: str, value: Any) -> None:
        """Shows the paint in another light, to another observer, in another geometry or over another card."""
        self.view["viewing"] = replace(self.view["viewing"], **{key: value})
        self.refresh()

    def whiten(self, albedo: float) -> None:
        """Over a white card of another albedo."""
        if albedo != self.view["viewing"].white:
            self.look("white", min(max(round(albedo, 2), WHITES[0]), WHITES[1]))

    def move(self, place: Place, step: float) -> None:
        """A slider to another step: its number goes to the form, and what changes there is shown here."""
        if place in self.sliders:  # it may have gone meanwhile
            self.moved = place
            self.results.write(place, self.sliders[place][0].find_value(step))
            self.moved = None

    def type(self, place: Place, value: float) -> None:
        """A number typed beside a slider, which the form checks."""
        if place in self.sliders and value != read_fraction(get_value(self.session.content, place)):
            self.results.write(place, value)

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
            asked = {"viewing": self.view["viewing"], "before": self.view.get("before")}
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
        show(live.waits, self.spinner, self.stop)
        asked, now = live.answered, (self.session.content, self.view["viewing"])
        old = asked is None or (asked.content, asked.more["viewing"]) != now
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

    def _write(self, answer: Appeared) -> None:
        """Colours, numbers and spectra of an answer."""
        shades = answer.black, answer.white
        beyond_screens = []
        for (swatch, below, words), side, shade, then in zip(
            self.swatches, SIDES, shades, answer.before or (None, None), strict=True
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
        self.beyond.set_text("; ".join(beyond_screens))
        self.contrast.set_text(f"contrast ratio {answer.contrast:.4f}")
        self.apart.set_text(f"ΔE2000 between black and white: {answer.apart:.2f}")
        changed = [f"{side} {value:.2f}" for side, value in zip(SIDES, answer.changed or (), strict=False)]
        self.changed.set_text(f"ΔE2000 from before: {'; '.join(changed)}" if changed else "")
        glosses = {one.geometry.partition(":")[0]: one.value for one in answer.readings if one.quantity == "gloss"}
        values = " / ".join(f"{value:.1f}" for value in glosses.values())
        self.gloss.set_text(f"gloss {'/'.join(f'{angle}°' for angle in glosses)}: {values} GU" if glosses else "")
        read = {one.quantity: one.value for one in answer.readings}
        length, rate = read.get("hiding thickness", 0.0), read.get("spreading rate", 0.0)
        hiding = f"hiding thickness {length:.3g} µm (contrast ratio {appearance.TARGET:g}), {rate:.3g} m²/l"
        self.hiding.set_text(hiding if length else "")
        self.numbers.clear()
        with self.numbers:
            rows = [[label, *(f"{shade.numbers[key]:.2f}" for shade in shades)] for key, label in NAMES.items()]
            controls.add_table("", ["", *SIDES], rows)
        beyond = shades[0].extrapolation
        notes = [f"light beyond the wavelengths: {beyond}"] if beyond else []
        sentences = "; ".join([*notes, *answer.why_none, *answer.notes])
        self.notes.set_text(translate_message(sentences, self.session.content))
        at = answer.spectra.wavelength_um
        words = f"coarse: {appearance.COARSE}" if answer.coarse else f"{at.size}"
        more = "" if answer.coarse or not answer.follows else "; gloss and hiding thickness are being worked out"
        ends = f"{at[0]:.4g} to {at[-1]:.4g} µm, accuracy {appearance.ACCURACY:g}"
        self.status.set_text(f"{words} wavelengths, {ends}; {answer.seconds:.2f} s{more}")
        if not answer.follows:
            self.spoken.set_text("; ".join(one.text for one in (self.contrast, self.apart, self.hiding) if one.text))
        self.results.draw_figure(
            "appearance", spectra(answer.spectra, self.view.get("before"), answer.viewing.geometry)
        )


def make_swatch() -> tuple[Any, Any, Any]:
    """A colour, below it that of before, and words on it."""
    with ui.element("div").props("role=img") as swatch:
        words = ui.label()
        with ui.element("div").classes("vrte-then") as below:
            ui.label("before")
    return swatch, below, words


def colour_swatch(element: Any, shade: appearance.Shade) -> None:
    """A colour behind words that can be read on it."""
    element.style(f"background: {shade.hex}; color: {'#000' if shade.numbers['L'] > BRIGHT else '#fff'}")
