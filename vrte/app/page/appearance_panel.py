"""The tab that shows what a paint looks like over black and over white, while its sliders are moved."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from nicegui import ui

from vrte.app import figures
from vrte.app.form.fields import get_value, translate_message
from vrte.app.form.numbers import STEPS, FormNumber, explain_missing, list_sliders
from vrte.app.page.controls import add_menu_item, add_message, add_table_row, make_menu, select
from vrte.app.page.gallery import list_paint_starts
from vrte.app.solving.appearance import (
    ACCURACY,
    COARSE,
    GEOMETRIES,
    ILLUMINANTS,
    OBSERVERS,
    TARGET,
    Appeared,
    Question,
    Shade,
    Viewing,
)
from vrte.app.solving.tab_session import TabSession
from vrte.basics.errors import Place
from vrte.formats.toml_table import read_share

WHITES = 0.4, 1.0  # albedos of the white card
THROTTLE = 0.1  # seconds between two positions of a slider
LOOK_EVERY = 0.03  # seconds between two looks whether an answer has come
BRIGHT = 55.0  # L*: words on darker colours are white
NAMES = {"X": "X", "Y": "Y", "Z": "Z", "L": "L*", "a": "a*", "b": "b*", "C": "C*", "h": "h [°]"}
SIDES = ("over black", "over white")


class AppearancePanel:
    """Sliders over the form's numbers, and what follows from them. ``write`` puts a number into a field of the form,
    ``fill`` another scene; ``plot`` makes an empty figure, ``draw`` fills it."""

    def __init__(
        self,
        session: TabSession,
        write: Callable[[Place, float], None],
        fill: Callable[..., None],
        plot: Callable[[], Any],
        draw: Callable[[Any], None],
    ) -> None:
        self.session, self.write, self.fill, self.draw_figure = session, write, fill, draw
        self.view = session.view
        self.view.setdefault("viewing", Viewing())
        self.sliders: dict[Place, tuple[FormNumber, Any, Any]] = {}
        self.white: Any = None  # what stands above the slider of the white card
        self.missing = ""
        self.shown: Any = None
        self.moved: Place | None = None
        with ui.row().classes("w-full gap-2 pt-3 items-center vrte-looks"):
            begin = ui.button("Begin with a paint", icon="format_paint", color=None).props("no-caps outline dense")
            with begin.classes("px-2 vrte-begin"), make_menu():
                for title in list_paint_starts():
                    add_menu_item(title, partial(self.begin_with, title))
            for key, names, width in (
                ("illuminant", ILLUMINANTS, 175), ("observer", OBSERVERS, 130), ("geometry", GEOMETRIES, 255),
            ):  # fmt: skip
                select(names, getattr(self.view["viewing"], key), key, partial(self.look, key), width)
        self.message = add_message("vrte-warning w-full mt-2", "status")
        with ui.row().classes("w-full gap-x-4 gap-y-1 items-center pt-2 relative vrte-now") as self.colours:
            self._lay_out_colours()
        self.bars = ui.element("div").classes("vrte-bars")
        with ui.row().classes("w-full items-center gap-2 no-wrap vrte-status") as self.progress:
            self.spinner = ui.spinner(size="16px")
            self.status = ui.label().classes("vrte-note")
            self.stop = ui.button("Stop", icon="stop", on_click=self.end)
            self.stop.props("flat dense no-caps size=sm color=negative")
        self.told = ui.label().classes("vrte-hidden").props("role=status aria-live=polite")
        with ui.column().classes("w-full gap-2 no-wrap pb-4 vrte-below") as self.answer:
            self._lay_out(plot)
        self.timer = ui.timer(LOOK_EVERY, self.follow, active=False)

    # layout

    def _lay_out(self, plot: Callable[[], Any]) -> None:
        """What stands below the sliders: notes, the figure and the table of numbers, empty."""
        self.gaps, self.notes = add_message("vrte-note"), add_message("vrte-warning w-full")
        with ui.element("div").classes("vrte-look"):
            with ui.column().classes("gap-0 no-wrap vrte-spectra"):
                plot()
            with ui.element("table").classes("vrte-table"):
                add_table_row("th", ["", *SIDES])
                self.cells = {name: add_table_row("td", [label, "", ""])[1:] for name, label in NAMES.items()}

    def _lay_out_colours(self) -> None:
        """Swatches, and beside them contrast, differences, gloss and hiding, empty."""
        with ui.element("div").classes("vrte-drawdown"):
            self.swatches = [make_swatch() for _ in SIDES]
            self.old = ui.label("for the previous setting").classes("vrte-warning vrte-mark").props("role=status")
        with ui.column().classes("gap-0"):
            self.contrast = ui.label().classes("vrte-heading")
            self.apart, self.changed, self.gloss, self.hiding = (add_message("vrte-note") for _ in range(4))
            keep = ui.button("Compare with this from now on", icon="bookmark_border", on_click=self.keep)
            keep.props("flat dense no-caps size=sm color=primary")

    def _draw_sliders(self) -> None:
        """One a number of the form; anew where there are others, or a number has left its slider's range."""
        content = self.session.content
        wanted = {slider.place: slider for slider in list_sliders(content)}
        values = {place: read_share(get_value(content, place)) or 0.0 for place in wanted}
        now = {place: slider for place, (slider, _, _) in self.sliders.items()}
        same = {place: one.label for place, one in now.items()} == {place: one.label for place, one in wanted.items()}
        if self.white is None or not same or not all(now[place].reaches(value) for place, value in values.items()):
            self.bars.clear()
            with self.bars:
                self.sliders = {
                    place: (one, *make_bar(one.label, 0, STEPS, 1, partial(self.move, place)))
                    for place, one in wanted.items()
                }
                self.white, bar = make_bar(
                    "albedo of the white card",
                    *WHITES,
                    0.01,
                    lambda albedo: self.look("white", min(max(round(albedo, 2), WHITES[0]), WHITES[1])),
                )
                bar.set_value(self.view["viewing"].white)
        for place, (slider, text, bar) in self.sliders.items():
            text.set_text(f"{slider.label}: {values[place]:.3g}")
            bar.props.update({"aria-valuetext": f"{values[place]:.3g}"})
            if place != self.moved:
                bar.set_value(slider.find_step(values[place]))
        self.white.set_text(f"albedo of the white card: {self.view['viewing'].white:g}")

    # what somebody does

    def begin_with(self, title: str) -> None:
        """A paint: the form gets it."""
        self.view.pop("before", None)
        self.fill(*list_paint_starts()[title]())

    def look(self, key: str, value: Any) -> None:
        """In another light, by another observer, in another geometry, over another card."""
        self.view["viewing"] = replace(self.view["viewing"], **{key: value})
        self.refresh()

    def move(self, place: Place, step: float) -> None:
        """A slider to another step: its number goes to the form, and what changes there is shown here."""
        if place in self.sliders:  # it may have gone meanwhile
            self.moved = place
            self.write(place, self.sliders[place][0].find_value(step))
            self.moved = None

    def keep(self) -> None:
        """What is shown is what later colours are compared with."""
        answer = self.session.live.answer
        if isinstance(answer, Appeared):
            self.view["before"] = answer.shares
            self.refresh()

    def end(self) -> None:
        """Whatever is being worked out."""
        self.session.live.close()
        self.follow()

    # what follows

    def refresh(self) -> None:
        """Asks what the form's scene looks like, where that is not known yet."""
        session, live = self.session, self.session.live
        unfit = explain_missing(session.content)
        self.missing = unfit or (f"The form waits: {session.wrong[0]}" if session.wrong else "")
        self.bars.set_visibility(not unfit)
        self._draw_sliders()
        if not self.missing:
            question = session.content, session.uploads.folder, self.view["viewing"], self.view.get("before")
            live.ask(Question(*question))
            self.timer.activate()
        self._show()
        self.follow()

    def follow(self) -> None:
        """Looks whether an answer has come."""
        live = self.session.live
        live.refresh()
        if live.answer is not self.shown:
            self._show()
        for element in (self.spinner, self.stop):
            element.set_visibility(live.waits)
        self._mark_old()
        if not live.waits:
            self.timer.deactivate()

    def _mark_old(self) -> None:
        """Greys what was worked out for another scene than the form's, or another way of looking at it."""
        live = self.session.live
        asked = live.answered if isinstance(live.answered, Question) else None
        old = asked is None or (asked.content, asked.viewing) != (self.session.content, self.view["viewing"])
        self.old.set_visibility(old)
        for part in (self.colours, self.answer):
            part.classes("vrte-old") if old else part.classes(remove="vrte-old")
        if old:
            stopped = "stopped: a slider or a change of the form begins again"
            self.status.set_text("being worked out" if live.waits else stopped)

    def _show(self) -> None:
        """The last answer, or why there is none."""
        answer = self.shown = self.session.live.answer
        refused = "" if answer is None or isinstance(answer, Appeared) else answer.message
        text = self.missing or translate_message(refused, self.session.content)
        self.message.set_text(text)
        self.progress.set_visibility(not self.missing)
        for part in (self.colours, self.answer):
            part.set_visibility(isinstance(answer, Appeared) and not text)
        if isinstance(answer, Appeared) and not text:
            self._write(answer)

    def _write(self, answer: Appeared) -> None:
        """Colours, numbers and spectra of an answer."""
        shades = answer.black, answer.white
        for (swatch, below, words), side, shade, then in zip(
            self.swatches, SIDES, shades, answer.before or (None, None), strict=True
        ):
            colour_swatch(swatch, shade)
            swatch.props.update({"aria-label": f"colour {side}: {shade.hex}"})
            words.set_text(f"{side} {shade.hex}")
            below.set_visibility(then is not None)
            colour_swatch(below, then or shade)
        self.contrast.set_text(f"contrast ratio {answer.contrast:.4f}")
        self.apart.set_text(f"ΔE2000 between black and white: {answer.apart:.2f}")
        changed = answer.changed and "; ".join(
            f"{side} {value:.2f}" for side, value in zip(SIDES, answer.changed, strict=True)
        )
        self.changed.set_text(f"ΔE2000 from before: {changed}" if changed else "")
        self.gloss.set_text(write_gloss(answer))
        self.hiding.set_text(write_hiding(answer))
        for name, labels in self.cells.items():
            for label, shade in zip(labels, shades, strict=True):
                label.set_text(f"{shade.numbers[name]:.2f}")
        gaps = [
            f"{side}: no screen of sRGB shows it; the swatch is {shade.gap:.1f} ΔE2000 away"
            for side, shade in zip(SIDES, shades, strict=True)
            if shade.gap > 0.0
        ]
        self.gaps.set_text("; ".join(gaps))
        beyond = shades[0].extrapolation
        notes = [f"light beyond the wavelengths: {beyond}"] if beyond else []
        said = "; ".join([*notes, *answer.why_none, *answer.notes])
        self.notes.set_text(translate_message(said, self.session.content))
        at = answer.shares.wavelength_um
        words = f"coarse: {COARSE}" if answer.coarse else f"{at.size}"
        more = "" if answer.coarse or not answer.follows else "; gloss and hiding thickness are being worked out"
        self.status.set_text(
            f"{words} wavelengths, {at[0]:.4g} to {at[-1]:.4g} µm, accuracy {ACCURACY:g}; {answer.seconds:.2f} s{more}"
        )
        if not answer.follows:
            self.told.set_text("; ".join(filter(None, (one.text for one in (self.contrast, self.apart, self.hiding)))))
        self.draw_figure(figures.spectra(answer.shares, self.view.get("before"), answer.viewing.geometry))


def write_gloss(answer: Appeared) -> str:
    """Gloss at its three angles; "" while it is not known, or where there is none."""
    found = [one for one in answer.readings if one.quantity == "gloss"]
    angles = "/".join(one.geometry.partition(":")[0] + "°" for one in found)
    return f"gloss {angles}: {' / '.join(f'{one.value:.1f}' for one in found)} GU" if found else ""


def write_hiding(answer: Appeared) -> str:
    """The thickness that hides, and how far a litre of it goes; "" while it is not known, or where there is none."""
    found = {one.quantity: one.value for one in answer.readings}
    if "hiding thickness" not in found:
        return ""
    length, rate = found["hiding thickness"], found["spreading rate"]
    return f"hiding thickness {length:.3g} µm (contrast ratio {TARGET:g}), {rate:.3g} m²/l"


def make_swatch() -> tuple[Any, Any, Any]:
    """A colour, below it that of before, and words on it."""
    with ui.element("div").props("role=img") as swatch:
        words = ui.label()
        with ui.element("div").classes("vrte-then") as below:
            ui.label("before")
    return swatch, below, words


def colour_swatch(element: Any, shade: Shade) -> None:
    """A colour behind words that can be read on it."""
    element.style(f"background: {shade.hex}; color: {'#000' if shade.numbers['L'] > BRIGHT else '#fff'}")


def make_bar(label: str, low: float, high: float, step: float, act: Callable[[float], None]) -> tuple[Any, Any]:
    """A slider and the text above it; what it says comes at most ten times a second, the last always."""
    with ui.column().classes("gap-0"):
        text = ui.label().classes("vrte-note")
        bar = ui.slider(min=low, max=high, step=step, value=low).props(f'dense aria-label="{label}"').classes("w-full")
        bar.on("update:model-value", lambda event: act(float(event.args)), throttle=THROTTLE)
    return text, bar
