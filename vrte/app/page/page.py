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
from vrte.app.form import files
from vrte.app.form.checks import PartRead
from vrte.app.form.content import START, Content
from vrte.app.form.fields import translate_message, write_field_text
from vrte.app.page.controls import GO, add_heading, add_menu_item, add_message, make_menu, report_errors
from vrte.app.page.form_panel import FormPanel
from vrte.app.page.result_panel import ResultPanel
from vrte.app.server.guard import LARGEST_UPLOAD
from vrte.app.solving import page_files
from vrte.app.solving.measuring import is_measurement
from vrte.app.solving.messages import Adopted, Fitted, Outcome, Read, Tensor, Written
from vrte.app.solving.tab_session import TabSession
from vrte.basics.errors import Place, SceneError
from vrte.formats.materials import list_materials
from vrte.formats.named import find_named_tables
from vrte.formats.paints import list_paints
from vrte.formats.toml_table import is_number

THEMES = {"auto": "as the system has it", "light": "light", "dark": "dark"}
GALLERY = Path(__file__).parents[1] / "gallery"
STYLE, SCRIPT = (Path(__file__).with_name(name) for name in ("page.css", "page.js"))
SUFFIXES = (".toml", ".nc", ".csv")
TOO_LARGE = (
    f"a file must end in {', '.join(SUFFIXES)}; a scene must be at most {files.LARGEST_SCENE / 1e6:g} MB, "
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
        ui.on("vrte-theme", self.set_theme)
        ui.on("vrte-link", self.take_link)
        ui.on("vrte-carried", self.carried)
        ui.on("vrte-camera", self.keep_camera)
        self._header()
        with ui.row().classes("vrte-page w-full no-wrap gap-0"):
            with ui.column().classes("vrte-left no-wrap gap-0").props('role=form aria-label="scene"'):
                ui.label("Scene").classes("vrte-hidden").props("role=heading aria-level=2")
                with ui.element("div").classes("w-full vrte-scroll"):
                    self.form_area = ui.column().classes("w-full gap-0")
                self.form_area.on(
                    "keydown.enter", self.solve, js_handler="event => vrte.entered(event, () => emit())", args=[]
                )
                self._solve_bar()
            with ui.column().classes("vrte-right no-wrap gap-0").props('role=region aria-label="result"'):
                self.results = ResultPanel(session, self.write_field, self.fill)
        self._draw_form()
        ui.run_javascript(f"{SCRIPT.read_text(encoding='utf-8')}\nvrte.begin({self.upload.id});")
        if session.outcome is None and session.job is None and session.content == START:  # something to turn
            if Page.start_outcome is None:
                session.start()
            else:
                self.take(Page.start_outcome)
        self.follow()
        ui.timer(0.2, self.follow)

    # layout

    def _header(self) -> None:
        with ui.header().classes("vrte-header items-center no-wrap gap-3"):
            ui.label("vrte").classes("vrte-logo").props("role=heading aria-level=1")
            ui.label("polarized light from powders and paints").classes("vrte-tagline")
            ui.space()
            self.upload = ui.upload(auto_upload=True, max_file_size=LARGEST_UPLOAD, on_upload=self.opened)
            self.upload.on_rejected(lambda: self.complain(TOO_LARGE))  # by the browser itself
            self.upload.props(f'accept="{",".join(SUFFIXES)}"').classes("hidden")
            self._header_button("Gallery", "collections", "scenes and materials to begin with").on_click(
                lambda: show_gallery(self.begin, self.fill)
            )
            to_open = "a scene (.toml) or a result (.nc, .csv); or drop it here"
            opener = self._header_button("Open", "folder_open", to_open)
            opener.on("click", js_handler=f"() => vrte.pick({self.upload.id})")
            with self._header_button("Download", "download", "results, figures, the scene"), make_menu():
                self._downloads()
            self._header_button("Link", "link", "copies an address that carries the scene").on_click(self.make_link)
            with self._header_button("Theme", "contrast", "light or dark"), make_menu():
                for theme, text in THEMES.items():
                    add_menu_item(text).on("click", js_handler=f"() => vrte.set_theme('{theme}')")
            ui.label(__version__).classes("vrte-tagline")

    def _header_button(self, text: str, symbol: str, tip: str) -> Any:
        button = ui.button(text, icon=symbol).props(f'flat no-caps dense color=white aria-label="{text}"')
        return button.tooltip(tip)

    def _downloads(self) -> None:
        session, make = self.session, page_files.make_result_download
        for text, act in (
            ("BRDF, NetCDF", lambda: make("brdf", session.outcome, ".nc")),
            ("BRDF, CSV", lambda: make("brdf", session.outcome, ".csv")),
            ("field inside, NetCDF", lambda: make("field", session.outcome, ".nc", session.view["wavelength"])),
            ("field inside, CSV", lambda: make("field", session.outcome, ".csv", session.view["wavelength"])),
            ("picture of the figure, PNG", None),
            ("BRDF as a Mitsuba tensor (solves for its directions)", None),
            (
                "colours, gloss and hiding of Appearance, CSV",
                lambda: page_files.make_colours_download(session.live, session.content),
            ),
            ("scene, TOML", lambda: page_files.make_scene_download(session.content, session.uploads)),
        ):
            other = self.picture if text.startswith("picture") else self.tensor
            add_menu_item(text, partial(self.hand_out, act) if act else other)

    def _solve_bar(self) -> None:
        with ui.column().classes("vrte-solve w-full gap-1"):
            self.failure = add_message("vrte-error", "alert")
            self.waits = ui.button(icon="arrow_upward", on_click=lambda: self.form.jump())
            self.waits.props("flat no-caps dense color=negative align=left").classes("w-full vrte-waits")
            with ui.row().classes("w-full items-center no-wrap gap-2"):
                self.solve_button = ui.button("Solve", icon="play_arrow", on_click=self.solve, color=None)
                self.solve_button.props(GO).classes("grow vrte-go")
                self.cancel_button = ui.button("Cancel", icon="stop", on_click=self.session.cancel)
                self.cancel_button.props("no-caps outline color=negative")
            self.bar = ui.linear_progress(0, show_value=False).props('rounded size=6px aria-label="progress"')
            self.stage = ui.label().classes("vrte-note")
            self.report = ui.label().classes("vrte-note").props("role=status aria-live=polite")

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
        """Whether there is something to solve."""
        wrong = self.session.wrong
        self.solve_button.set_enabled(wrong is None and not self.session.busy)
        self.waits.set_visibility(wrong is not None)
        if wrong is not None:
            self.waits.set_text(f"Solve waits: {wrong[0]}")
        if self.results.mark_stale() and not self.session.busy:
            self.report.set_text("")  # it was of another scene

    def solve(self) -> None:
        """What the form says; the server checks it again, whatever the page has sent."""
        wrong = self.session.find_problems()
        if wrong:
            self.failure.set_text("; ".join(wrong.values()))
            return
        if not self.session.busy:
            self.report.set_text("Solving.")
            self.session.start()
            self.follow()

    def follow(self) -> None:
        """Looks how far the job is, and takes what it brought."""
        if self.session.has_looked():
            self.form.check()
        job, busy = self.session.job, self.session.busy
        for element in (self.cancel_button, self.bar, self.stage):
            element.set_visibility(busy)
        if busy and job is not None:
            self.bar.set_value(round(job.fraction, 3))
            self.stage.set_text(job.stage)
            self.failure.set_text("")
        elif job is not None and not busy and job is not self.session.taken:
            self.session.taken = job
            self.failure.set_text(translate_message(job.message, self.session.content))
            self.report.set_text("")
            self.take(job.outcome)
            job.outcome = None  # the session has it, or the browser
        self._mark()

    def take(self, outcome: Outcome | Written | PartRead | Fitted | Adopted | None) -> None:
        """What a job brought, once."""
        if isinstance(outcome, Written):
            ui.download.content(outcome.data, outcome.name)
        elif isinstance(outcome, Adopted):
            self.fill(outcome.content, outcome.notes)
        elif isinstance(outcome, Outcome):
            self.session.outcome = outcome
            self.tidy()
            if outcome.opened and outcome.content is not None:
                self.session.content = copy.deepcopy(outcome.content)
                self._draw_form()
            if not outcome.brdfs and self.session.view["tab"] in ("lobe", "cuts", "reflectance"):
                self.results.tabs.set_value("inside")
            self.results.refresh()
            if outcome.brdfs:
                done = "Opened" if outcome.opened else "Solved"
                self.report.set_text(f"{done}: {self.results.describe_reflectance(outcome)}.")
            if outcome.content == START:
                Page.start_outcome = outcome
            else:
                ui.run_javascript("vrte.show_result()")

    async def opened(self, event: Any) -> None:
        """A file that somebody chose: a scene fills the form, a result is shown."""
        name, size = str(event.file.name), int(event.file.size())
        suffix = Path(name).suffix.lower()
        self.upload.reset()
        with report_errors(self.complain):
            if size > (files.LARGEST_SCENE if suffix == ".toml" else LARGEST_UPLOAD):
                raise SceneError(TOO_LARGE)
            data = await event.file.read()
            if suffix == ".toml":
                self.session.start_adopting(data)
            elif is_measurement(data, suffix, wanted=self.session.view["tab"] == "measurement"):
                self.results.tabs.set_value("measurement")
                self.results.live["measurement"].take(name, data)
            elif suffix in SUFFIXES:
                self.session.start(Read(data, suffix))
            else:
                raise SceneError(f"the file must end in {', '.join(SUFFIXES)}, not {suffix[:20]!r}")

    def complain(self, text: str) -> None:
        """Shows what is wrong, where it is seen."""
        ui.notify(text, type="negative", multi_line=True, close_button=True, timeout=10_000)

    async def hand_out(self, make: Callable[[], tuple[str, bytes]]) -> None:
        """A file for the browser to keep, made aside: the page stays alive."""
        with report_errors(self.complain):
            name, data = await asyncio.to_thread(make)
            ui.download.content(data, name)

    def fill(self, content: Content, notes: tuple[str, ...] = ()) -> None:
        """The form with another scene, and what was filled in."""
        self.session.content = content
        self._draw_form()
        if notes:
            ui.notify("; ".join(notes), type="info", multi_line=True, close_button=True, timeout=10_000)

    def begin(self, content: Content) -> None:
        """With a scene of the gallery, solved at once."""
        self.fill(content)
        self.session.cancel()
        self.session.start()
        self.follow()

    def set_theme(self, event: Any) -> None:
        """What this browser shows, as it says: light or dark."""
        dark = isinstance(event.args, dict) and event.args.get("dark") is True
        self.dark.set_value(dark)
        if dark != bool(self.session.view.get("dark")):
            self.session.view["dark"] = dark
            self.results.draw()

    def keep_camera(self, event: Any) -> None:
        """From where the lobe is seen, turned by keys: the next lobe is seen from there, too."""
        given = event.args if isinstance(event.args, dict) else {}
        sides = {name: given.get(name) for name in ("eye", "center", "up")}
        if all(isinstance(side, dict) and all(is_number(side.get(axis)) for axis in "xyz") for side in sides.values()):
            self.session.view["camera"] = {
                name: {axis: float(side[axis]) for axis in "xyz"} for name, side in sides.items() if side
            }

    def make_link(self) -> None:
        """The address with the scene in it, into the browser's address line and its clipboard."""
        with report_errors(self.complain):
            self.session.view["link"] = text = files.write_link(self.session.content)
            ui.run_javascript(f"vrte.carry({json.dumps(text)})")

    def carried(self, event: Any) -> None:
        """Whether the browser has put it on the clipboard."""
        copied = "It is copied." if event.args is True else "Copy it from there."
        names = ", ".join(dict.fromkeys(find_named_tables(self.session.content).values()))
        without = f" It cannot carry {names}: whoever opens it puts that in." if names else ""
        others = "Others put what stands from # on behind the address that their own `vrte view` has printed."
        text = f"The address of this page carries the scene now. {copied} {others}{without}"
        ui.notify(text, type="info", multi_line=True, close_button=True)

    def take_link(self, event: Any) -> None:
        """A scene that an address brought: a stranger's text, checked like a file, solved when somebody asks."""
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

    def tensor(self) -> None:
        """Mitsuba's file wants directions of its own: they are solved for first."""
        session = self.session
        with report_errors(self.complain):
            for message in session.find_problems().values():
                raise SceneError(message)
            wavelengths = page_files.choose_tensor_wavelengths(session.content)
            self.report.set_text(f"Solving for the tensor at {', '.join(f'{one:g}' for one in wavelengths)} µm.")
            session.start(Tensor(copy.deepcopy(session.content), session.uploads.folder, wavelengths))


def show_gallery(solve: Callable[[Content], Any], fill: Callable[[Content, tuple[str, ...]], Any]) -> None:
    """Offers scenes, to ``solve`` at once, and ready paints and materials, to ``fill`` the form with, beside the
    sentences about their approximations."""

    def solve_scene(path: Path) -> None:
        dialog.close()
        solve(files.adopt_with_notes(files.parse_content(path.read_bytes()))[0])

    with ui.dialog().props('aria-label="gallery"') as dialog, ui.card().classes("items-center vrte-gallery"):
        add_heading("Scenes to begin with", 2)
        with ui.row().classes("justify-center gap-1"):
            for path in sorted(GALLERY.glob("*.toml")):
                title = files.parse_content(path.read_bytes())["render"]["title"]
                with ui.button(on_click=partial(solve_scene, path)) as button:
                    button.props(f'flat no-caps aria-label="{title}"').classes("vrte-start")
                    picture = ui.element("img").props('alt="" width=84 height=84')
                    drawn = base64.b64encode(path.with_suffix(".png").read_bytes()).decode()
                    picture.props["src"] = f"data:image/png;base64,{drawn}"
                    ui.label(title)
        for title, known in (("Paints", list_paints()), ("Materials", list_materials())):
            add_heading(f"{title} to begin with", 2)
            with ui.row().classes("justify-center gap-1"):
                for one in known.values():
                    button = ui.button(one.title, on_click=lambda one=one: fill(*files.begin_with_material(one)))
                    button.on_click(dialog.close).props("flat no-caps dense").classes("px-2").tooltip(one.description)
    dialog.on("hide", dialog.delete)
    dialog.open()
