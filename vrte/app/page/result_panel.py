"""The right side of the page: what came out, to be turned, cut and read."""

import re
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from nicegui import ui

from vrte.app.form.fields import parse_field_text, translate_message
from vrte.app.page import controls
from vrte.app.page.appearance_panel import AppearancePanel
from vrte.app.page.controls import add_bullets, add_heading, add_message, add_slider, select, show
from vrte.app.page.match_panel import MatchPanel
from vrte.app.page.measurement_panel import MeasurementPanel
from vrte.app.solving.tab_session import TabSession
from vrte.app.solving.worker import Outcome, Reflectances
from vrte.basics.errors import Place, SceneError
from vrte.pictures import interactive
from vrte.pictures import results as figures
from vrte.pictures.lobes import describe_mirrored_beam, lobe
from vrte.results import quantities
from vrte.results.brdf import SCENE
from vrte.results.quantities import FIELD_QUANTITIES, QUANTITIES

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

TABS = {  # title and symbol
    "lobe": ("Lobe", "blur_on"),
    "cuts": ("Cuts", "pie_chart_outline"),
    "reflectance": ("Reflectance", "show_chart"),
    "appearance": ("Appearance", "palette"),
    "match": ("Match", "colorize"),
    "measurement": ("Measurement", "insights"),
    "inside": ("Inside", "vertical_align_center"),
    "scattering": ("Scattering", "grain"),
    "plan": ("Plan", "rule"),
}
LIGHTS = {
    "unpolarized": "1, 0, 0, 0",
    "linear in the plane (Q)": "1, 1, 0, 0",
    "linear across it (−Q)": "1, -1, 0, 0",
    "linear at 45° (U)": "1, 0, 1, 0",
    "linear at −45° (−U)": "1, 0, -1, 0",
    "circular (V)": "1, 0, 0, 1",
    "circular (−V)": "1, 0, 0, -1",
    "other": "",
}
NAMES = {name: name for name in (*QUANTITIES, *FIELD_QUANTITIES)}
NAMES |= {name: f"Mueller element {name}" for name in quantities.MUELLER}
VIEW = {  # what a new tab looks at
    "tab": "lobe",
    "place": 0,
    "wavelength": 0,
    "layer": 0,
    "height": "f00",
    "colour": quantities.DEGREE_LINEAR,
    "cut": "f00",
    "inside": "I",
    "over_largest": False,
    "light": "unpolarized",
    "stokes": "1, 0, 0, 0",
}
LEGEND = {**interactive.LEGEND, "y": 0.0, "yref": "container", "yanchor": "bottom", "font": {"size": 12}}
SELECTS = {  # of each tab: what is chosen, in words, among what
    "lobe": (("height", "distance from the centre", QUANTITIES), ("colour", "colour", QUANTITIES)),
    "cuts": (("cut", "quantity", QUANTITIES),),
    "inside": (("inside", "quantity", FIELD_QUANTITIES),),
}
OF_BRDF = ("lobe", "cuts", "reflectance")  # tabs that show a BRDF
LIVE = {
    "appearance": AppearancePanel,
    "match": MatchPanel,
    "measurement": MeasurementPanel,
}  # tabs of the form's scene, whether it is solved or not
NOTHING = "Describe a scene and press Solve, or open a file; the Gallery has scenes to begin with."
CHANGED = "The form has changed since this was solved: what is shown here is the scene before."
SOLVING = "The scene of the form is being solved: what is shown here is the scene before."
OF_FILE = "What is shown here is of a file that does not hold its scene: the form has another."
SYMBOLS = {"<sub>i</sub>": "ᵢ", "<sub>o</sub>": "ₒ", "<sub>0</sub>": "₀", "<br>": "\n"}
UNDER_THE_SKY = "As seen from this angle under an evenly white sky of sunlight, white where the reflectance is 1."
NO_FIELD = 'No radiance field here: turn on "Inside the layers" in the form and solve.'
NO_BRDF = "No BRDF here: the file that was opened holds a radiance field; see Inside."
NO_MATRICES = "A result file holds no phase matrices: solve its scene to see them."
NO_PARTICLES = "Nothing scatters here: there are interfaces alone."
NO_PLAN = "No plan here: a result file has none, nor have methods other than discrete ordinates."


class ResultPanel:
    """Figures of a session's outcome; the one of the open tab is drawn, the others when they are looked at. ``write``
    puts a number into a field of the form, ``fill`` another scene; ``reports``: what a paint's page hands out."""

    def __init__(
        self,
        session: TabSession,
        write: Callable[[Place, float], None],
        fill: Callable[..., None],
        reports: dict[str, Callable[[], Any]],
    ) -> None:
        self.session, self.write, self.fill, self.reports = session, write, fill, reports
        self.view = session.view
        self.view.update(VIEW | self.view)
        self.plots: dict[str, Any] = {}
        self.areas: dict[str, Any] = {}
        self.texts: dict[str, Any] = {}  # below each figure
        self.live: dict[str, Any] = {}  # panels of the tabs that show the form's scene
        self.captions: dict[str, tuple[Any, Any]] = {}  # of each figure: its title, and the line below it
        add_heading("Result", 2, "vrte-hidden")
        with ui.tabs(value=self.view["tab"], on_change=lambda event: self.set("tab", event.value)) as self.tabs:
            for name, (title, symbol) in TABS.items():
                ui.tab(name, title, icon=symbol)
        self.tabs.props("dense no-caps inline-label align=left active-color=primary").classes("w-full vrte-tabs")
        with ui.column().classes("w-full grow no-wrap gap-0 px-4 relative overflow-auto").props("tabindex=0"):
            self.stale = ui.label(CHANGED).classes("vrte-warning w-full mt-2").props("role=status")
            self.notes = add_message("vrte-warning w-full mt-2")
            self._add_controls()
            self.message = add_message("vrte-empty")
            for name in TABS:
                self.areas[name] = ui.column().classes("w-full grow gap-0 no-wrap")
                with self.areas[name]:
                    self._lay_out(name)
        self.refresh()

    # layout

    def _add_controls(self) -> None:
        """What all tabs share: incidence, wavelength, incident light."""
        with ui.row().classes("w-full items-center gap-x-6 gap-y-1 pt-3") as self.controls:
            self.sliders = {  # of each: its container, its text, its bar
                key: add_slider(label, (0, 1), 1, partial(self.set, key), 0.15, leading_events=False)
                for key, label in (("place", "incident angle"), ("wavelength", "wavelength"))
            }
            for around, _, bar in self.sliders.values():
                around.classes("grow").style("min-width: 200px")
                bar.props("snap")
            with ui.row().classes("gap-2 items-start") as self.light:
                self.named = select(list(LIGHTS), self.view["light"], "incident light", self.set_light, 210)
                self.stokes = ui.input("I, Q, U, V", value=self.view["stokes"], on_change=self.set_stokes)
                self.stokes.without_auto_validation().props(f"{controls.OUTLINED} debounce=120 maxlength=200")
                self.stokes.classes("vrte-fixed").style("width: 150px")

    def _lay_out(self, tab: str) -> None:
        """What a tab holds, empty."""
        if tab in LIVE:
            self.live[tab] = LIVE[tab](self)
            return
        with ui.row().classes("w-full items-center gap-2 pt-2"):
            for key, label, names in SELECTS.get(tab, ()):
                select({name: NAMES[name] for name in names}, self.view[key], label, partial(self.set, key))
            if tab == "inside":
                each = ui.checkbox("I: each depth over its largest", value=self.view["over_largest"]).props("dense")
                each.on_value_change(lambda event: self.set("over_largest", bool(event.value)))
            if tab == "scattering":
                self.layer = select([], None, "layer", partial(self.set, "layer"))
        if tab == "scattering":
            with ui.element("div").classes("vrte-pair"):
                for name in ("scattering", "coefficients"):
                    with ui.column().classes("gap-0 no-wrap"):
                        self.add_plot(name)
        elif tab != "plan":
            plot = self.add_plot(tab)
        if tab == "lobe":
            plot.props("tabindex=0").on("keydown", js_handler=f"event => vrte.turn(event, {plot.id})")
            ui.label("Drag, or arrow keys, to turn; plus and minus come nearer.").classes("vrte-note")
        if tab in ("reflectance", "plan"):
            self.texts[tab] = ui.column().classes("w-full gap-2 pb-4")

    def add_plot(self, name: str) -> Any:
        """An empty figure below its title: there it can be as long as it likes."""
        self.captions[name] = add_heading("", 3, "vrte-caption"), ui.label().classes("vrte-under")
        self.plots[name] = ui.plotly({"data": [], "layout": {}}).classes("vrte-plot").props("role=figure")
        return self.plots[name]

    # what is looked at

    def set(self, key: str, value: Any) -> None:
        """A choice, and the figure that follows from it."""
        value = int(value) if key in self.sliders else value
        if value != self.view.get(key):
            self.view[key] = value
            if key == "place" and self.session.outcome.brdfs:
                self.view["mu_i"] = float(self.session.outcome.brdfs[0].mu_i[value])
            self.draw()

    def set_light(self, name: str) -> None:
        """One of LIGHTS."""
        self.view["light"] = name
        if LIGHTS[name]:
            self.stokes.set_value(LIGHTS[name])
        self.draw()

    def set_stokes(self, event: Any) -> None:
        """Any other light, checked as it is typed."""
        self.view["stokes"] = str(event.value or "")
        if self.view["stokes"] != LIGHTS[self.view["light"]]:
            self.named.set_value("other")
        self.stokes.error = None
        try:
            read_stokes(self.view["stokes"])
            self.draw()
        except SceneError as error:
            self.stokes.error = str(error)

    # drawing

    def refresh(self) -> None:
        """After a new outcome: the sliders' ends, then the figure."""
        outcome, view = self.session.outcome, self.view
        angles = outcome.brdfs[0].mu_i if outcome.brdfs else np.empty(0)
        if angles.size:  # light from where it came from before, as nearly as there is
            view["place"] = int(np.abs(angles - view.get("mu_i", angles[angles.size // 2])).argmin())
        inside = [*outcome.inside[0]] if outcome.inside else []
        for key, size in (("place", angles.size), ("wavelength", outcome.count), ("layer", len(inside))):
            view[key] = min(view[key], max(size - 1, 0))
            if key in self.sliders:
                bar = self.sliders[key][2].props(f"max={max(size - 1, 1)}")
                bar.set_enabled(size > 1)
                bar.set_value(view[key])
        self.layer.set_options(dict(enumerate(inside)), value=view["layer"] if inside else None)
        self.draw()

    def draw(self) -> None:
        """The open tab."""
        tab, outcome = self.view["tab"], self.session.outcome
        live, solved = tab in LIVE, outcome.count > 0
        for name, area in self.areas.items():
            show(name == tab and (live or solved), area)
        self._describe(outcome)
        text = "" if solved or live else NOTHING
        try:
            if live:
                self.live[tab].refresh()
            elif solved:
                self._show(tab, outcome)
        except (SceneError, IndexError) as error:
            show(False, self.areas[tab])
            text = str(error)
        self.message.set_text(text)

    def _describe(self, outcome: Outcome) -> None:
        """The notes, the sliders that there are, and what stands beside them."""
        tab, place = self.view["tab"], self.view["place"]
        live = tab in LIVE
        self.mark_stale()
        self.notes.set_text("" if live else translate_message("; ".join(outcome.notes), self.session.content))
        with_angle = bool(outcome.brdfs) and tab in OF_BRDF
        several = outcome.count > 1 and not live
        (incidence, beside, _), (wavelength, above, _) = self.sliders.values()
        show(with_angle, incidence)
        show(with_angle and tab != "reflectance", self.light)
        show(several, wavelength)
        show(with_angle or several, self.controls)
        if outcome.brdfs:
            mu = float(outcome.brdfs[0].mu_i[place])
            where = f"light from {np.degrees(np.arccos(mu)):.1f}° off the normal (µ_i = {mu:.4g})"
            beside.set_text(f"{where}; {self.describe_reflectance(outcome)}")
        if outcome.wavelength_um:
            above.set_text(f"wavelength {write_wavelength(outcome, self.view['wavelength'])}")

    def _show(self, tab: str, outcome: Outcome) -> None:
        """The figure of a tab. Raises SceneError where the outcome has none."""
        view, which, place = self.view, self.view["wavelength"], self.view["place"]
        if tab in OF_BRDF and not outcome.brdfs:
            raise SceneError(NO_BRDF)
        if tab == "plan":
            self._write_plan(outcome)
        elif tab == "scattering":
            if not outcome.inside or not outcome.inside[which]:
                raise SceneError(NO_PARTICLES if outcome.inside else NO_MATRICES)
            matrix = [*outcome.inside[which].values()][view["layer"]]
            self.draw_figure("scattering", figures.scattering_matrix(matrix))
            self.draw_figure("coefficients", figures.coefficients(matrix))
        elif tab == "inside":
            if not outcome.fields:
                raise SceneError(NO_FIELD)
            how = view["inside"], view["over_largest"] and view["inside"] == "I", bool(view.get("dark"))
            self.draw_figure(tab, figures.field_polar(outcome.fields[which], *how))
        elif tab == "reflectance":
            assert outcome.reflectances is not None  # wherever there is a BRDF
            self._write_reflectances(outcome, outcome.reflectances)
            self.draw_figure(tab, figures.reflectance(outcome.reflectances, outcome.wavelength_um, place))
        else:
            brdf, stokes = outcome.brdfs[which], read_stokes(view["stokes"])
            if tab == "lobe":
                figure = lobe(brdf, place, view["height"], view["colour"], stokes)
            else:
                figure = figures.cuts(brdf, place, view["cut"], stokes)
            self.draw_figure(tab, figure)

    def draw_figure(self, name: str, figure: "Figure") -> None:
        """A figure in its place, its title above it."""
        whole = figure.to_plotly_json()
        layout = whole["layout"]
        text = remove_marks(layout.pop("title")["text"])
        for label, line in zip(self.captions[name], [*text.split("\n"), ""], strict=False):
            label.set_text(line)
        left, right, below = (64, 24, 100) if "xaxis" in layout else (0, 0, 0) if "scene" in layout else (40, 40, 96)
        layout |= {"autosize": True, "legend": LEGEND, "margin": {"l": left, "r": right, "b": below, "t": 24}}
        if "camera" in self.view and "scene" in layout:
            layout["scene"] = {**layout["scene"], "camera": self.view["camera"]}
        config = {"displaylogo": False, "responsive": True, "modeBarButtonsToRemove": ["sendDataToCloud"]}
        dark = interactive.convert_to_dark(whole) if self.view.get("dark") else whole
        self.plots[name].props["aria-label"] = text.replace("\n", "; ")
        self.plots[name].update_figure({**dark, "config": config})

    def describe_reflectance(self, outcome: Outcome) -> str:
        """The reflectance, and how much is mirrored as a beam."""
        brdf, place = outcome.brdfs[self.view["wavelength"]], self.view["place"]
        back = f"reflectance {float(brdf.reflectance[place]):.3g}"
        mirrored = describe_mirrored_beam(brdf, place).partition(",")[0]
        return f"diffuse {back}, {mirrored}" if mirrored else back

    def mark_stale(self) -> bool:
        """Says where the figure shows another scene than the form; whether it does."""
        outcome, solves = self.session.outcome, self.session.solves
        changed = outcome.count > 0 and outcome.content != self.session.content
        solving = solves.waits and solves.task is not None and solves.task.call == "solve.solve"
        self.stale.set_text(SOLVING if solving else CHANGED if outcome.content else OF_FILE)
        show(changed and self.view["tab"] not in LIVE, self.stale)
        return changed

    def follow_form(self) -> None:
        """After a change of the form."""
        self.mark_stale()
        if self.view["tab"] in LIVE:
            self.live[self.view["tab"]].refresh()

    def _write_reflectances(self, outcome: Outcome, found: Reflectances) -> None:
        """Swatches, and the numbers of the figure."""
        self.texts["reflectance"].clear()
        place = self.view["place"]
        with self.texts["reflectance"]:
            with ui.row().classes("gap-4"):
                for name, colours in found.colours.items():
                    with ui.column().classes("gap-1"):
                        swatch = ui.element("div").classes("vrte-swatch").style(f"background: {colours[place]}")
                        swatch.props(f'role=img aria-label="colour {name}: {colours[place]}"')
                        ui.label(f"{name}: {colours[place]}").classes("vrte-note")
            ui.label(f"No colour: {found.why_none}" if found.why_none else UNDER_THE_SKY).classes("vrte-note")
            numbers = [
                [write_wavelength(outcome, which), *(f"{curve[which, place]:.4f}" for curve in found.curves.values())]
                for which in range(outcome.count)
            ]
            controls.add_table("", ["wavelength", *found.curves], numbers)

    def _write_plan(self, outcome: Outcome) -> None:
        """What was left out, what was shared, the table, and how it was made."""
        self.texts["plan"].clear()
        diagnostics = (outcome.brdfs or outcome.fields)[self.view["wavelength"]].diagnostics
        clocks = {name: one for name, one in diagnostics.get("stages", {}).items() if "wall_seconds" in one}
        made = {name: one for name, one in diagnostics.items() if isinstance(one, (str, int, float)) and name != SCENE}
        made |= {name: f"{clock['wall_seconds']:.4f} s" for name, clock in clocks.items()}
        with self.texts["plan"]:
            if outcome.plan is None:
                ui.label(NO_PLAN)
            else:
                add_bullets("Left out, and why", outcome.plan.left_out)
                add_bullets("Done once for many", outcome.plan.shared)
                add_heading("The plan in full")
                ui.label(outcome.plan.text).classes("vrte-text")
            add_heading("How it was made")
            ui.label("\n".join(f"{name}: {value}" for name, value in made.items())).classes("vrte-text")


def read_stokes(text: str) -> Any:
    """The Stokes vector of the incident light (4,). Raises SceneError."""
    found = parse_field_text(text)
    if isinstance(found, str):
        raise SceneError("stokes must be four numbers I, Q, U, V")
    quantities.incident_for(quantities.REFLECTANCE_FACTOR, found)
    return found


def write_wavelength(outcome: Outcome, which: int) -> str:
    """One of an outcome's wavelengths, with its unit."""
    return f"{outcome.wavelength_um[which]:.5g} µm" if outcome.wavelength_um else "–"


def remove_marks(title: str) -> str:
    """A figure's title without Plotly's marks, its second line parted by a line break."""
    for mark, sign in SYMBOLS.items():
        title = title.replace(mark, sign)
    return re.sub("</?su[bp]>", "", title)
