"""The page: a header, the form on the left, the result on the right, and what connects them."""

import asyncio
import base64
import copy
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import ui

from vrte import __version__
from vrte.app.form.checks import (
    LARGEST_SCENE,
    adopt_with_notes,
    begin_with_material,
    list_films,
    parse_content,
    write_link,
)
from vrte.app.form.content import START, Content
from vrte.app.form.fields import translate_message, write_field_text
from vrte.app.form.numbers import explain_missing
from vrte.app.page import controls
from vrte.app.page.controls import notify, report_errors, show
from vrte.app.page.form_panel import FormPanel
from vrte.app.page.result_panel import OF_BRDF, ResultPanel
from vrte.app.server.guard import LARGEST_UPLOAD
from vrte.app.solving import tab_session
from vrte.app.solving.measuring import TEXTS, is_measurement
from vrte.app.solving.tab_session import TabSession
from vrte.app.solving.worker import Adopted, Outcome, Refused, Task, Written
from vrte.basics.errors import Place, SceneError
from vrte.formats.materials import ReadyMaterial, list_materials, list_paints
from vrte.formats.scene_file import find_named_tables
from vrte.formats.toml_table import is_number

THEMES = {"auto": "as the system has it", "light": "light", "dark": "dark"}
GALLERY = Path(__file__).parents[1] / "gallery"
PAINT, POWDER = "white gloss", "alumina"  # that a page begins with: of the ready paints, of the gallery
CLOUD = Path(__file__).parents[2] / "starters" / "cloud.toml"
STYLE, SCRIPT = (Path(__file__).with_name(name) for name in ("page.css", "page.js"))
SUFFIXES = (".toml", ".nc", *TEXTS)
LONG_ENOUGH = 10_000  # milliseconds to read what is notified
TOO_LARGE = (
    f"a file must end in {', '.join(SUFFIXES)}; a scene must be at most {LARGEST_SCENE / 1e6:g} MB, "
    f"a result {LARGEST_UPLOAD / 1e6:g} MB"
)


class Page:
    """One tab's page over its session."""

    start_outcome: Outcome | None = None  # of the start scene, solved once for all tabs

    def __init__(self, session: TabSession, tidy: Callable[[], Any]) -> None:
        """``tidy`` is called after a new result: old ones of others may have to go."""
        self.session, self.tidy = session, tidy
        ui.add_css(STYLE)
        ui.colors(primary="#1f4e79", secondary="#d98200", accent="#d98200", negative="#b3262e", info="#1f4e79")
        self.dark = ui.dark_mode(bool(session.view.get("dark")))
        acts = {"theme": self.set_theme, "link": self.take_link, "carried": self.carried, "camera": self.keep_camera}
        for event, act in acts.items():
            ui.on(f"vrte-{event}", act)
        self._header()
        with ui.row().classes("vrte-page w-full no-wrap gap-0"):
            with ui.column().classes("vrte-left no-wrap gap-0").props('role=form aria-label="scene"'):
                controls.add_heading("Scene", 2, "vrte-hidden")
                with ui.element("div").classes("w-full vrte-scroll"):
                    self.form_area = ui.column().classes("w-full gap-0")
                entered = "event => vrte.entered(event, () => emit())"
                self.form_area.on("keydown.enter", self.solve, js_handler=entered, args=[])
                self._solve_bar()
            with ui.column().classes("vrte-right no-wrap gap-0").props('role=region aria-label="result"'):
                self._add_ways_in()
                self.results = ResultPanel(session, self.write_field, self.fill, self._list_reports())
        self._draw_form()
        ui.run_javascript(f"{SCRIPT.read_text(encoding='utf-8')}\nvrte.begin({self.upload.id});")
        if not session.outcome.count and session.solves.task is None and session.content == START:  # something to turn
            if Page.start_outcome is None:
                session.start()
            else:
                self.take(Page.start_outcome)
        self.follow()
        ui.timer(0.2, self.follow)

    # layout

    def _header(self) -> None:
        with ui.header().classes("vrte-header items-center no-wrap gap-3"):
            controls.add_heading("vrte", 1, "vrte-logo")
            ui.label("polarized light from powders and paints").classes("vrte-tagline")
            ui.space()
            self.upload = ui.upload(auto_upload=True, max_file_size=LARGEST_UPLOAD, on_upload=self.opened)
            self.upload.on_rejected(lambda: self.complain(TOO_LARGE))  # by the browser itself
            self.upload.props(f'accept="{",".join(SUFFIXES)}"').classes("hidden")
            gallery = self._header_button("Gallery", "collections", "scenes and materials to begin with")
            gallery.on_click(self.show_gallery)
            to_open = "a scene (.toml), a result (.nc, .csv) or a measurement; or drop it here"
            opener = self._header_button("Open", "folder_open", to_open)
            opener.on("click", js_handler=f"() => vrte.pick({self.upload.id})")
            with self._header_button("Download", "download", "results, figures, the scene"), controls.make_menu():
                self._downloads()
            self._header_button("Link", "link", "copies an address that carries the scene").on_click(self.make_link)
            with self._header_button("Theme", "contrast", "light or dark"), controls.make_menu():
                for theme, text in THEMES.items():
                    controls.add_menu_item(text).on("click", js_handler=f"() => vrte.set_theme('{theme}')")
            ui.label(__version__).classes("vrte-tagline")

    def _add_ways_in(self) -> None:
        """What a page begins with: a choice of what its user has, until there is another scene in the form."""
        ways = {
            "A paint": ("format_paint", "its colour, hiding and gloss over black and white", self.begin_with_paint),
            "A powder": ("grain", "the lobes of what it reflects, and their polarization", self.begin_with_powder),
            "An atmosphere": ("cloud", "the light above, in and below a cloud over the sea", self.begin_with_cloud),
            "Something to look at": ("collections", "spheres of scenes and paints under the sky", self.show_gallery),
        }
        with ui.row().classes("vrte-ways w-full items-center gap-2") as self.ways:
            controls.add_heading("Begin with")
            for text, (icon, tip, act) in ways.items():
                controls.add_button(text, icon, act, "outline dense", "px-2").tooltip(tip)

    def _header_button(self, text: str, symbol: str, tip: str) -> Any:
        return controls.add_button(text, symbol, props=f'flat dense color=white aria-label="{text}"').tooltip(tip)

    def _downloads(self) -> None:
        session = self.session
        for kind, title in (("brdf", "BRDF"), ("field", "field inside")):
            for suffix, words in ((".nc", "NetCDF"), (".csv", "CSV")):
                controls.add_menu_item(f"{title}, {words}", partial(self.hand_out_result, kind, suffix))
        controls.add_menu_item("picture of the figure, PNG", self.picture)
        controls.add_menu_item("BRDF as a Mitsuba tensor (solves for its directions)", self.tensor)
        for words, with_comma in (("CSV", False), ("CSV with semicolons and decimal commas", True)):
            title = f"colours, gloss and hiding of Appearance, {words}"
            controls.add_menu_item(title, partial(self.hand_out_colours, with_comma))
        for suffix, words in ((".html", "page of the paint, HTML"), (".pdf", "sheet of the paint, PDF")):
            controls.add_menu_item(f"{words} (reads off all of it)", partial(self.report_paint, suffix))
        scene = partial(self.hand_out, lambda: tab_session.make_scene_download(session.content, session.uploads))
        controls.add_menu_item("scene, TOML", scene)

    def _list_reports(self) -> dict[str, Callable[[], Any]]:
        """What the tab Appearance hands out by a click: the numbers as tables are written in the browser's language."""
        return {
            "Numbers, CSV": lambda: self.hand_out_colours(bool(self.session.view.get("comma"))),
            "Report, HTML": lambda: self.report_paint(".html"),
            "Report, PDF": lambda: self.report_paint(".pdf"),
        }

    def _solve_bar(self) -> None:
        with ui.column().classes("vrte-solve w-full gap-1"):
            self.failure = controls.add_message("vrte-error", "alert")
            self.waits = controls.add_button(
                "", "arrow_upward", lambda: self.form.jump(), f"flat dense {controls.DANGER} align=left"
            )
            self.waits.classes("w-full vrte-waits")
            with ui.row().classes("w-full items-center no-wrap gap-2"):
                self.solve_button = controls.add_button("Solve", "play_arrow", self.solve, controls.GO, "grow vrte-go")
                self.cancel_button = controls.add_button(
                    "Cancel", "stop", lambda: self.session.solves.close(), f"outline {controls.DANGER}"
                )
            self.bar = ui.linear_progress(0, show_value=False).props('rounded size=6px aria-label="progress"')
            self.stage = controls.add_note()
            self.report = controls.add_note(role="status aria-live=polite")

    def _draw_form(self) -> None:
        self.form_area.clear()
        with self.form_area:
            self.form = FormPanel(self.session, self._follow_form)

    def write_field(self, place: Place, value: float) -> None:
        """A number into the form's field, as if it were typed there."""
        self.form.fields[place][0].set_value(write_field_text(value))

    def _follow_form(self) -> None:
        """After every change of the form."""
        self._mark()
        self.results.follow_form()

    # what happens

    def _mark(self) -> None:
        """Whether there is something to solve, and whether it is still the first scene."""
        show(self.session.content == START, self.ways)
        wrong, busy = self.session.wrong, self.session.solves.waits
        self.solve_button.set_enabled(wrong is None and not busy)
        show(wrong is not None, self.waits)
        self.waits.set_text(f"Solve waits: {wrong[0]}" if wrong else "")
        if self.results.mark_stale() and not busy:
            self.report.set_text("")  # it was of another scene

    def solve(self) -> None:
        """Solves the scene of the form, which the server checks again."""
        wrong = self.session.find_problems()
        if wrong:
            self.failure.set_text("; ".join(wrong.values()))
        elif not self.session.solves.waits:
            self.report.set_text("Solving.")
            self.session.start()
            self.follow()

    def follow(self) -> None:
        """Looks how far the task is, and takes what it brought."""
        if self.session.has_looked():
            self.form.check()
        solves = self.session.solves
        show(solves.waits, self.cancel_button, self.bar, self.stage)
        if solves.waits:
            self.bar.set_value(round(solves.progress.fraction, 3))
            self.stage.set_text(solves.progress.stage)
            self.failure.set_text("")
        elif (answer := solves.take()) is not None:  # the session has it now, or the browser
            refused = answer.message if isinstance(answer, Refused) else ""
            self.failure.set_text(translate_message(refused, self.session.content))
            self.report.set_text("")
            self.take(answer)
        self._mark()

    def take(self, answer: Any) -> None:
        """What a task brought, once."""
        if isinstance(answer, Written):
            ui.download.content(answer.data, answer.name)
        elif isinstance(answer, Adopted):
            if self.session.view["tab"] in OF_BRDF and not explain_missing(answer.content):  # the colours of a paint
                self.results.tabs.set_value("appearance")
            self.fill(answer.content, answer.notes)
        elif isinstance(answer, Outcome):
            self.session.outcome = answer
            self.tidy()
            if answer.opened and answer.content is not None:
                self.session.content = copy.deepcopy(answer.content)
                self._draw_form()
            if not answer.brdfs and self.session.view["tab"] in OF_BRDF:
                self.results.tabs.set_value("inside")
            self.results.refresh()
            if answer.brdfs:
                done = "Opened" if answer.opened else "Solved"
                self.report.set_text(f"{done}: {self.results.describe_reflectance(answer)}.")
            if answer.content == START:
                Page.start_outcome = answer
            else:
                ui.run_javascript("vrte.show_result()")

    async def opened(self, event: Any) -> None:
        """Opens a file of the user: a scene fills the form, a result is shown."""
        name, size = str(event.file.name), int(event.file.size())
        suffix = Path(name).suffix.lower()
        self.upload.reset()
        with report_errors(self.complain):
            if size > (LARGEST_SCENE if suffix == ".toml" else LARGEST_UPLOAD):
                raise SceneError(TOO_LARGE)
            data = await event.file.read()
            if suffix == ".toml":
                self.session.start_adopting(data)
            elif is_measurement(data, suffix, wanted=self.session.view["tab"] == "measurement"):
                self.results.tabs.set_value("measurement")
                self.results.live["measurement"].take(name, data)
            elif suffix in SUFFIXES:
                self.session.start(Task("solve.read", data, more={"suffix": suffix}))
            else:
                raise SceneError(f"the file must end in {', '.join(SUFFIXES)}, not {suffix[:20]!r}")

    def complain(self, text: str) -> None:
        """Shows what is wrong, where it is seen."""
        notify(text, "negative", timeout=LONG_ENOUGH)

    async def hand_out(self, make: Callable[[], tuple[str, bytes]]) -> None:
        """A file for the browser to keep, made aside: the page stays alive."""
        with report_errors(self.complain):
            name, data = await asyncio.to_thread(make)
            ui.download.content(data, name)

    async def hand_out_colours(self, with_comma: bool) -> None:
        """What the tab Appearance shows, as a table."""
        live, content = self.session.live, self.session.content
        await self.hand_out(lambda: tab_session.make_colours_download(live, content, with_comma))

    async def hand_out_result(self, kind: str, suffix: str) -> None:
        """The BRDF or the field as a file."""
        outcome, which = self.session.outcome, self.session.view["wavelength"]
        await self.hand_out(lambda: tab_session.make_result_download(kind, outcome, suffix, which))

    def fill(self, content: Content, notes: tuple[str, ...] = ()) -> None:
        """The form with another scene, and what was filled in."""
        self.session.content = content
        self._draw_form()
        if notes:
            notify("; ".join(notes), timeout=LONG_ENOUGH)

    def show_gallery(self) -> None:
        """Offers scenes, paints and materials with their pictures."""
        show_gallery(self.begin, self.begin_with_material)

    def begin_with_paint(self) -> None:
        """A white paint, on its sliders."""
        self.begin_with_material(list_paints()[PAINT])

    def begin_with_powder(self) -> None:
        """A powder of the gallery, solved."""
        self.begin(adopt_file(GALLERY / f"{POWDER}.toml"))

    def begin_with_cloud(self) -> None:
        """The cloud that `vrte init` writes, solved, and the light inside it."""
        self.results.tabs.set_value("inside")
        self.begin(adopt_file(CLOUD))

    def begin_with_material(self, material: ReadyMaterial) -> None:
        """Fills the form with a ready material; of a film, its colours are shown."""
        if material.title in list_films():
            self.results.tabs.set_value("appearance")
        self.fill(*begin_with_material(material))

    def begin(self, content: Content) -> None:
        """Fills the form with a scene of the gallery and solves it."""
        self.fill(content)
        self.session.start()
        self.follow()

    def set_theme(self, event: Any) -> None:
        """Takes the theme that the browser reports, light or dark, and whether it writes decimal commas."""
        given = event.args if isinstance(event.args, dict) else {}
        dark, self.session.view["comma"] = given.get("dark") is True, given.get("comma") is True
        self.dark.set_value(dark)
        if dark != bool(self.session.view.get("dark")):
            self.session.view["dark"] = dark
            self.results.draw()

    def keep_camera(self, event: Any) -> None:
        """Keeps the camera of the lobe, so that the next lobe is seen from the same side."""
        given = event.args if isinstance(event.args, dict) else {}
        sides = {name: given.get(name) for name in ("eye", "center", "up")}
        if all(isinstance(side, dict) and all(is_number(side.get(axis)) for axis in "xyz") for side in sides.values()):
            self.session.view["camera"] = {
                name: {axis: float(side[axis]) for axis in "xyz"} for name, side in sides.items() if side
            }

    def make_link(self) -> None:
        """The address with the scene in it, into the browser's address line and its clipboard."""
        with report_errors(self.complain):
            self.session.view["link"] = text = write_link(self.session.content)
            ui.run_javascript(f"vrte.carry({json.dumps(text)})")

    def carried(self, event: Any) -> None:
        """Whether the browser has put it on the clipboard."""
        copied = "It is copied." if event.args is True else "Copy it from there."
        names = ", ".join(dict.fromkeys(find_named_tables(self.session.content).values()))
        without = f" It cannot carry {names}: whoever opens it puts that in." if names else ""
        others = "Others put what stands from # on behind the address that their own `vrte view` has printed."
        notify(f"The address of this page carries the scene now. {copied} {others}{without}")

    def take_link(self, event: Any) -> None:
        """Takes a scene from the address: checked as a file is, solved only on a click."""
        if isinstance(event.args, str) and event.args != self.session.view.get("link"):
            self.session.view["link"] = event.args
            self.session.start_adopting(event.args)

    def picture(self) -> None:
        """What the figure of the open tab looks like now, drawn by the browser."""
        tab, results = self.session.view["tab"], self.results
        if tab not in results.plots or not results.areas[tab].visible or not results.captions[tab][0].text:
            self.complain("there is no figure to download: solve a scene, and open the tab of a figure")
            return
        title = "<br>".join(label.text for label in results.captions[tab])
        ui.run_javascript(f"vrte.picture({results.plots[tab].id}, {json.dumps(title)}, 'vrte-{tab}')")

    def start_writing(self, words: str, call: str, **more: Any) -> None:
        """Solves the form's scene for a file. Raises SceneError where the form is wrong."""
        for message in self.session.find_problems().values():
            raise SceneError(message)
        self.report.set_text(words)
        self.session.start(self.session.make_task(call, **more))

    def report_paint(self, suffix: str) -> None:
        """What a laboratory reads off the paint, all of it, as `vrte paint` writes it."""
        with report_errors(self.complain):
            if unfit := explain_missing(self.session.content):
                raise SceneError(unfit)
            viewing = self.session.view["viewing"]
            self.start_writing(
                "Reading all numbers off the paint.", "solve.write_report", suffix=suffix, viewing=viewing
            )

    def tensor(self) -> None:
        """Mitsuba's file wants directions of its own: they are solved for first."""
        with report_errors(self.complain):
            wavelengths = tab_session.choose_tensor_wavelengths(self.session.content)
            words = f"Solving for the tensor at {', '.join(f'{one:g}' for one in wavelengths)} µm."
            self.start_writing(words, "solve.write_tensor", wavelengths_um=wavelengths)


def adopt_file(path: Path) -> Content:
    """The content of a scene file of the package, as the form takes it."""
    return adopt_with_notes(parse_content(path.read_bytes()))[0]


def show_gallery(solve: Callable[[Content], Any], fill: Callable[[ReadyMaterial], Any]) -> None:
    """Offers scenes, to ``solve`` at once, and ready paints and materials, to ``fill`` the form with."""

    def add_picture(name: str, title: str, act: Callable[[], Any]) -> ui.button:
        with ui.button(on_click=dialog.close) as button:
            button.on_click(act).props(f'flat no-caps aria-label="{title}"').classes("vrte-start")
            drawn = base64.b64encode((GALLERY / f"{name}.png").read_bytes()).decode()
            ui.element("img").props('alt="" width=84 height=84').props["src"] = f"data:image/png;base64,{drawn}"
            ui.label(title)
        return button

    with ui.dialog().props('aria-label="gallery"') as dialog, ui.card().classes("items-center vrte-gallery"):
        controls.add_heading("Scenes to begin with", 2)
        with ui.row().classes("justify-center gap-1"):
            for path in sorted(GALLERY.glob("*.toml")):
                content = adopt_file(path)
                add_picture(path.stem, content["render"]["title"], partial(solve, content))
        controls.add_heading("Paints to begin with", 2)
        with ui.row().classes("justify-center gap-1"):
            for one in list_paints().values():
                add_picture(one.name.replace(" ", "_"), one.title, partial(fill, one)).tooltip(one.description)
        controls.add_heading("Materials to begin with", 2)
        with ui.row().classes("justify-center gap-1"):
            for one in list_materials().values():
                button = ui.button(one.title, on_click=partial(fill, one))
                button.on_click(dialog.close).props("flat no-caps dense").classes("px-2").tooltip(one.description)
    dialog.on("hide", dialog.delete)
    dialog.open()
