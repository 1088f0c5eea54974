"""The tab that finds a recipe: the target, what may change for it, what that costs, and what came out."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

from nicegui import ui

from vrte.app.form.fields import parse_field_text, translate_message, write_field_text
from vrte.app.form.numbers import FormNumber, explain_missing, list_filled, list_sliders
from vrte.app.page import controls
from vrte.app.page.appearance_panel import colour_swatch, make_swatch
from vrte.app.page.controls import add_bullets, add_button, add_heading, add_message, add_note, add_table, show
from vrte.app.page.free_numbers import FreeNumbers, ValueTaker, add_cell, find_places, replace_keys
from vrte.app.solving import appearance
from vrte.app.solving.matching import Matched, read_target
from vrte.app.solving.measuring import Compared
from vrte.app.solving.worker import Refused
from vrte.basics.arrays import check_whole
from vrte.basics.errors import SceneError
from vrte.fit.match import find_bounds
from vrte.fit.problem import MOST_STARTS
from vrte.fit.recipe import VOLATILE, Film, find_densities, read_film
from vrte.formats.toml_table import is_number

LOOK_EVERY = 0.1  # seconds between two looks whether something has come
FIELDS = {  # of a target, by keywords of vrte.match: what stands above each, and what nothing means
    "L": ("L*", "any"),
    "a": ("a*", "any"),
    "b": ("b*", "any"),
    "contrast_ratio": ("contrast ratio ≥", "any"),
    "gloss_20": ("gloss 20° [GU]", "any"),
    "gloss_60": ("gloss 60° [GU]", "any"),
    "gloss_85": ("gloss 85° [GU]", "any"),
    "tolerance": ("ΔE2000 allowed", "1"),
    "gloss_tolerance": ("gloss allowed ± [GU]", "3"),
    "starts": ("starts", "3"),
}
SOLIDS = "volume solids [%]"
WORDS = {  # of the library, and of this page
    **{name: label for name, (label, _) in FIELDS.items() if len(name) > 1},
    "lab must": "L*, a*, b* must",
    "volume_solids": SOLIDS,
    "densities of": "density of",
    "cost of": "price of",
    "free: ": "",
}
LOOKS: dict[str, tuple[str, dict[Any, str], int]] = {  # what is chosen, by keyword, and how wide that is [pixels]
    "over": ("colour over", {"black": "black", "white": "white, 0.8", "base": "the form's base"}, 165),
    "geometry": ("geometry", {**appearance.GEOMETRIES, "8:de": "d/8 SCE, without what is mirrored"}, 255),
    "illuminant": ("illuminant", appearance.ILLUMINANTS, 175),
    "observer": ("observer", appearance.OBSERVERS, 110),
}
FILES = {
    "target.toml": "Target, TOML",
    "recipe.html": "Page, HTML",
    "recipe.csv": "Numbers, CSV",
    "recipe.toml": "Paint, TOML",
}
TYPICAL = "Densities in grey are typical values. They enter weights and money alone, not volumes, colour or hiding."


class MatchPanel:
    """A target, the numbers that may change, prices, and the recipe; ``results`` is the panel whose tab this is."""

    def __init__(self, results: Any) -> None:
        self.results, self.session, self.view = results, results.session, results.view
        first = {name: next(iter(known)) for name, (_, known, _) in LOOKS.items()}
        self.asked = self.view.setdefault("match", {"fields": {}, "looks": first, "prices": {}, "densities": {}})
        self.film: Film | None = None
        self.written: Matched | None = None  # of which the result is shown
        self.taker: ValueTaker | None = None
        self.missing = add_message("vrte-warning w-full mt-2", "status")
        with ui.column().classes("w-full gap-2 no-wrap pb-4") as self.body:
            add_heading("What is wanted")
            with ui.row().classes("w-full gap-2 items-start"):
                self.fields = {name: self._add_field(name, *words) for name, words in FIELDS.items()}
            with ui.row().classes("w-full gap-2 items-center"):
                self.looks = {
                    name: controls.select(
                        list_options(name, value), value, LOOKS[name][0], partial(self.look, name), LOOKS[name][2]
                    )
                    for name, value in self.asked["looks"].items()
                }
                self.measured = add_button("From the measurement", "insights", self.take_measured, "outline dense")
            with ui.element("div").classes("vrte-look"):
                with ui.column().classes("gap-2 no-wrap"):
                    add_heading("What may change")
                    self.free = FreeNumbers(self.asked.setdefault("free", {}))
                with ui.column().classes("gap-2 no-wrap"):
                    add_heading("What it costs")
                    self.costs = ui.element("div").classes("overflow-auto")
                    self.solids = self._add_field("solids", SOLIDS, "of the wet paint")
            with ui.row().classes("w-full items-center gap-2"):
                self.start = add_button("Match", "colorize", self.begin, controls.GO, "vrte-go px-4 mt-1")
                self.stop = add_button("Stop", "stop", self.end, f"outline {controls.DANGER}")
                self.stop.tooltip("keeps the best so far; once more: ends at once")
                self.status = add_note(role="status aria-live=polite")
            self.bar = ui.linear_progress(0, show_value=False).props(
                'rounded size=6px aria-label="progress of the match"'
            )
            self.failure = add_message("vrte-error", "alert")
            self.answer = ui.column().classes("w-full gap-2 no-wrap")
        self.timer = ui.timer(LOOK_EVERY, self.follow, active=False)

    def _add_field(self, name: str, label: str, empty: str) -> Any:
        """A field for a number of the target."""
        field = ui.input(label, value=self.asked["fields"].get(name, "")).without_auto_validation()
        field.props(f"{controls.OUTLINED} debounce=120 autocomplete=off maxlength=40").classes("vrte-fixed")
        field.style("width: 138px").props.update({"placeholder": empty, "aria-label": label})
        return field.on_value_change(partial(self.keep, "fields", name))

    # what the user does

    def keep(self, kind: str, name: str, event: Any) -> None:
        """What is typed, until it is asked for."""
        self.asked[kind][name] = str(event.value or "")

    def look(self, name: str, value: Any) -> None:
        """Another base, light, observer or geometry."""
        if value is not None:
            self.asked["looks"][name] = value

    def take_measured(self) -> None:
        """The target of the measurement on its tab."""
        self.failure.set_text("")
        with controls.report_errors(self.failure.set_text):
            reply = self.session.beside.answer
            if not isinstance(reply, Compared):
                raise SceneError("there is no measurement: open one on the tab Measurement, or drop it on the page")
            found = read_target(reply.measured)
            found |= dict(zip("Lab", found.pop("lab", ()), strict=False))
            for name, field in self.fields.items():
                if name in found:
                    field.set_value(write_field_text(found[name]))
            for name, chosen in self.looks.items():
                if name in found:
                    chosen.set_options(list_options(name, found[name]), value=found[name])

    def begin(self) -> None:
        """Starts the match; what keeps it from that is shown."""
        session = self.session
        self.failure.set_text("")
        with controls.report_errors(self.failure.set_text):
            for message in session.find_problems().values():
                raise SceneError(f"the form: {message}")
            asked = collect_target(self.asked)
            asked["free"] = self.free.choose(around_start=False)
            self.view.pop("before_taken", None)
            session.matches.ask(session.make_task("matching.match_scene", asked=asked))
            self.view["match_stopped"] = False
            self.timer.activate()
            self.follow()

    def end(self) -> None:
        """The match, with the best so far; once more, at once."""
        (self.session.matches.close if self.view.get("match_stopped") else self.session.matches.stop)()
        self.view["match_stopped"] = True
        self.status.set_text("stopping")

    # what follows

    def refresh(self) -> None:
        """What may change and what it costs, of the paint that the form has now."""
        content = self.session.content
        film, missing = None, explain_missing(content)
        if not missing:
            try:
                film = read_film(content, next(list_filled(content))[0], self.session.uploads.folder)
            except SceneError as error:
                missing = translate_message(str(error), content)
        self.missing.set_text(missing)
        show(film is not None, self.body)
        if film is None:
            return
        self.free.draw([*list_matched(list_sliders(content))])
        if self.film is None or {*self.film.parts} != {*film.parts}:
            self._draw_costs(film)
        self.film = film
        self.measured.set_enabled(isinstance(self.session.beside.answer, Compared))
        if self.taker is not None:
            self.taker.refresh()
        if self.session.matches.waits:
            self.timer.activate()
        self.follow()

    def _draw_costs(self, film: Film) -> None:
        """A row for each ingredient: its price, and its density."""
        known = find_densities(film, None)
        self.costs.clear()
        with self.costs, add_table("vrte-columns", ["ingredient", "price of a kg", "density [kg/l]"]):
            for name in (*film.parts, VOLATILE):
                with ui.element("tr"):
                    with ui.element("td"):
                        ui.label(name)
                    for kind, word, empty in (("prices", "price", "0"), ("densities", "density", "?")):
                        with ui.element("td"):
                            if (kind, name) == ("prices", VOLATILE):
                                continue
                            usual = f"{known[name]:g}" if kind == "densities" and name in known else empty
                            field = add_cell(self.asked[kind].get(name, ""), usual, f"{name}, {word}")
                            field.on_value_change(partial(self.keep, kind, name))
        with self.costs:
            ui.label(f"Without prices the volume of pigments is made least. {TYPICAL}").classes("vrte-note vrte-narrow")

    def follow(self) -> None:
        """Looks how far the match is, and what it brought."""
        matches, answer = self.session.matches, self.session.matches.answer
        busy = matches.waits
        show(busy, self.stop, self.bar)
        self.start.set_enabled(not busy)
        if busy:
            self.bar.set_value(round(matches.progress.fraction, 3))
            if not self.view.get("match_stopped"):
                self.status.set_text(matches.progress.stage)
            return
        self.timer.deactivate()
        self.status.set_text("")
        if isinstance(answer, Refused):
            self.failure.set_text(self._translate(answer.message))
        elif isinstance(answer, Matched) and answer is not self.written:
            self.written = answer
            self._write(answer)

    def _translate(self, message: str) -> str:
        """A sentence of the library in the words of the form and of this tab."""
        return translate_message(replace_keys(message, WORDS), self.session.content)

    def _write(self, found: Matched) -> None:
        """Recipe, both colours, what each number does, and what can be done with it."""
        self.answer.clear()
        names = {one.key: one.label for one in list_sliders(found.content)}
        with self.answer:
            add_heading("What was found")
            for line in found.lines:
                ui.label(replace_keys(line, names)).classes("vrte-narrow")
            with ui.element("div").classes("vrte-drawdown"):
                for name, shade in found.shades.items():
                    swatch, below, words = make_swatch()
                    colour_swatch(swatch, shade)
                    show(False, below)
                    swatch.props.update({"aria-label": f"colour {name}: {shade.hex}"})
                    words.set_text(f"{name} {shade.hex}")
            for rows in found.tables:
                with ui.element("div").classes("w-full overflow-auto"):
                    add_table("vrte-columns whitespace-nowrap", *split_table(rows, names))
            with ui.row().classes("gap-2 items-center"):
                self.taker = ValueTaker(
                    self.results, find_places(found.content, found.names, found.values), self.failure.set_text
                )
                for name, text in FILES.items():
                    if data := found.files.get(name):
                        add_button(text, "download", partial(ui.download.content, data, name), "flat dense")
            add_bullets("To be known", tuple(replace_keys(one, names) for one in found.notes))


def list_options(name: str, value: Any) -> dict[Any, str]:
    """What can be chosen for a keyword: what is known, and the value that a measurement has."""
    return {value: f"{value}", **LOOKS[name][1]}


def split_table(rows: list[list[str]], names: dict[str, str]) -> tuple[list[str], list[list[str]]]:
    """The heads of a table and its rows, each number by the form's name for it."""
    known = {**names, **{name: f"{name}*" for name in "Lab"}}
    heads, *below = [[known.get(cell, cell.replace("_", " ")) for cell in row] for row in rows]
    return heads, below


def list_matched(numbers: list[FormNumber]) -> Iterator[FormNumber]:
    """The numbers with the bounds that a match gives them."""
    for one in numbers:
        low, high = find_bounds(one.key, one.start)
        yield replace(one, low=float(f"{low:.3g}"), high=float(f"{high:.3g}"))


def collect_target(asked: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Keywords of `vrte.match` by what was typed and chosen. Raises SceneError for what is no number."""
    found: dict[str, Any] = {**asked["looks"]}
    labels = {**{name: label for name, (label, _) in FIELDS.items()}, "solids": SOLIDS}
    typed = {name: read_typed(labels[name], text) for name, text in asked["fields"].items() if text.strip()}
    lab = [typed.pop(name) for name in "Lab" if name in typed]
    if len(lab) not in (0, 3):
        raise SceneError("L*, a*, b*: type all three, or none of them")
    found |= {"lab": lab} if lab else {}
    if "starts" in typed:
        typed["starts"] = check_whole("starts", typed["starts"], 1, MOST_STARTS)
    if "solids" in typed:
        found["volume_solids"] = typed.pop("solids") / 100.0
    for kind, keyword, word in (("prices", "cost", "price"), ("densities", "densities", "density")):
        given = {name: text for name, text in asked[kind].items() if text.strip()}
        if numbers := {name: read_typed(f"{word} of {name}", text) for name, text in given.items()}:
            found[keyword] = numbers
    return found | typed


def read_typed(label: str, text: str) -> float:
    """A number that was typed, with a decimal point or comma. Raises SceneError."""
    value = parse_field_text(text.replace(",", "."))
    if not is_number(value):
        raise SceneError(f"{label} must be a number, not {text.strip()!r}")
    return float(value)
