"""The page: a header, the form on the left, the result on the right, and what connects them."""

import asyncio
import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

from nicegui import ui

from vrte import __version__
from vrte.app import downloads, form
from vrte.app.form_panel import FormPanel
from vrte.app.messages import Outcome, Read, Tensor, Written
from vrte.app.result_panel import ResultPanel
from vrte.app.solving import memory_of_one
from vrte.app.state import Bench
from vrte.errors import MissingExtraError, SceneError
from vrte.formats.scene_file import toml_content

LARGEST_UPLOAD = 300_000_000  # bytes
STYLE, SCRIPT = (Path(__file__).with_name(name) for name in ("page.css", "page.js"))
LARGEST_SCENE = 1_000_000
SUFFIXES = (".toml", ".nc", ".csv")
TOO_LARGE = (
    f"a file must end in {', '.join(SUFFIXES)}; a scene must be at most {LARGEST_SCENE / 1e6:g} MB, "
    f"a result {LARGEST_UPLOAD / 1e6:g} MB"
)


def adopted(data: bytes, folder: Path, tables: frozenset[str]) -> tuple[form.Content, tuple[str, ...]]:
    """The content of a scene file for the form, and what was filled in. Raises SceneError."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SceneError(f"not a text file in UTF-8 (byte {error.start})") from error
    return form.adopted_and_told(toml_content(text), folder, tables)


class Page:
    """One tab's page over its bench."""

    def __init__(self, bench: Bench, tidy: Callable[[], Any]) -> None:
        """``tidy`` is called after a new result: old ones of others may have to go."""
        self.bench, self.tidy, self.fine = bench, tidy, True
        ui.add_css(STYLE)
        ui.colors(primary="#1f4e79", secondary="#d98200", accent="#d98200", negative="#b3262e")
        self._header()
        ui.run_javascript(f"{SCRIPT.read_text(encoding='utf-8')}\nvrte.take_drops({self.upload.id});")
        with ui.row().classes("vrte-page w-full no-wrap gap-0"):
            with ui.column().classes("vrte-left no-wrap gap-0"):
                with ui.scroll_area().classes("grow w-full vrte-scroll"):
                    self.form_area = ui.column().classes("w-full gap-0")
                self._solve_bar()
            with ui.column().classes("vrte-right no-wrap gap-0"):
                self.results = ResultPanel(bench)
        self._draw_form()
        self.follow()
        ui.timer(0.2, self.follow)

    # layout

    def _header(self) -> None:
        with ui.header().classes("vrte-header items-center no-wrap gap-3"):
            ui.label("vrte").classes("vrte-logo")
            ui.label("polarized light from powders and paints").classes("vrte-tagline")
            ui.space()
            self.changed_chip = ui.label("the form has changed since").classes("vrte-chip")
            self.upload = ui.upload(
                auto_upload=True, max_file_size=LARGEST_UPLOAD, on_upload=self.opened, on_rejected=self.rejected
            )
            self.upload.props(f'accept="{",".join(SUFFIXES)}"').classes("hidden")
            opener = ui.button("Open", icon="folder_open").props("flat no-caps dense color=white")
            opener.on("click", js_handler=f"() => vrte.pick({self.upload.id})")
            opener.tooltip("a scene (.toml) or a result (.nc, .csv); or drop it anywhere on the page")
            download = ui.button("Download", icon="download").props("flat no-caps dense color=white")
            with download, ui.menu().props("auto-close"):
                self._downloads()
            ui.label(__version__).classes("vrte-tagline")

    def _downloads(self) -> None:
        for text, act in (
            ("BRDF, NetCDF", lambda: self.hand_out(downloads.brdf_file, self.bench.outcome, ".nc")),
            ("BRDF, CSV", lambda: self.hand_out(downloads.brdf_file, self.bench.outcome, ".csv")),
            ("field inside, NetCDF", lambda: self.hand_out(*self._field(".nc"))),
            ("field inside, CSV", lambda: self.hand_out(*self._field(".csv"))),
            ("picture of the figure, PNG", self.picture),
            ("BRDF as a Mitsuba tensor (solves for its directions)", self.tensor),
            ("scene, TOML", lambda: self.hand_out(downloads.scene_file, self.bench.content)),
        ):
            ui.menu_item(text, act)

    def _field(self, suffix: str) -> tuple[Any, ...]:
        return downloads.field_file, self.bench.outcome, self.bench.view["wavelength"], suffix

    def _solve_bar(self) -> None:
        with ui.column().classes("vrte-solve w-full gap-1"):
            self.failure = ui.label().classes("vrte-error")
            with ui.row().classes("w-full items-center no-wrap gap-2"):
                self.solve_button = ui.button("Solve", icon="play_arrow", on_click=self.solve).props(
                    "no-caps unelevated"
                )
                self.solve_button.classes("grow")
                self.cancel_button = ui.button("Cancel", icon="stop", on_click=self.bench.cancel)
                self.cancel_button.props("no-caps outline color=negative")
            self.bar = ui.linear_progress(0, show_value=False).props("rounded size=6px")
            self.stage = ui.label().classes("vrte-note")

    def _draw_form(self) -> None:
        self.form_area.clear()
        with self.form_area:
            self.form = FormPanel(self.bench, self.form_changed)

    # what happens

    def form_changed(self, fine: bool) -> None:
        """After every change of the form."""
        self.fine = fine
        self._mark()

    def _mark(self) -> None:
        outcome, busy = self.bench.outcome, self.bench.busy
        self.solve_button.set_enabled(self.fine and not busy)
        solved = outcome.content if outcome else None
        self.changed_chip.set_visibility(solved is not None and not busy and solved != self.bench.content)

    def solve(self) -> None:
        """What the form says; the server checks it again, whatever the page has sent."""
        try:
            form.check(self.bench.content, self.bench.folder, self.bench.tables)
        except SceneError as error:
            self.failure.set_text(str(error))
            return
        self.bench.solve()
        self.follow()

    def follow(self) -> None:
        """Looks how far the job is, and takes what it brought."""
        job, busy = self.bench.job, self.bench.busy
        for element in (self.cancel_button, self.bar, self.stage):
            element.set_visibility(busy)
        if busy and job is not None:
            self.bar.set_value(round(job.share, 3))
            self.stage.set_text(job.stage)
            self.failure.set_visibility(False)
        elif job is not None and not busy and job is not self.bench.taken:
            self.bench.taken = job
            self.failure.set_text(job.message)
            self.take(job.outcome)
            job.outcome = None  # the bench has it, or the browser
        if not busy:
            self.failure.set_visibility(bool(self.failure.text))
        self._mark()

    def take(self, outcome: Outcome | Written | None) -> None:
        """What a job brought, once."""
        if isinstance(outcome, Written):
            ui.download.content(outcome.data, outcome.name)
        elif isinstance(outcome, Outcome):
            self.bench.outcome = outcome
            self.tidy()
            if outcome.opened and outcome.content is not None:
                self.bench.content = form.adopted(outcome.content)
                self._draw_form()
            if not outcome.brdfs and self.bench.view["tab"] in ("lobe", "cuts"):
                self.results.tabs.set_value("inside")
            self.results.refresh()

    async def opened(self, event: Any) -> None:
        """A file that somebody chose: a scene fills the form, a result is shown."""
        name, size = str(event.file.name), int(event.file.size())
        suffix = Path(name).suffix.lower()
        self.upload.reset()
        try:
            if size > (LARGEST_SCENE if suffix == ".toml" else LARGEST_UPLOAD):
                raise SceneError(TOO_LARGE)
            data = await event.file.read()
            if suffix == ".toml":
                bench = self.bench
                bench.content, told = await asyncio.to_thread(adopted, data, bench.folder, bench.tables)
                self._draw_form()
                if told:
                    ui.notify("; ".join(told), type="info", multi_line=True, close_button=True, timeout=10_000)
            elif suffix in SUFFIXES:
                self.bench.start(Read(data, suffix, memory_of_one()))
            else:
                raise SceneError(f"the file must end in {', '.join(SUFFIXES)}, not {suffix[:20]!r}")
        except SceneError as error:
            self.complain(str(error))

    def rejected(self) -> None:
        """By the browser itself."""
        self.complain(TOO_LARGE)

    def complain(self, text: str) -> None:
        """Where it is seen."""
        ui.notify(text, type="negative", multi_line=True, close_button=True, timeout=10_000)

    async def hand_out(self, make: Any, *arguments: Any) -> None:
        """A file for the browser to keep, made aside: the page stays alive."""
        try:
            name, data = await asyncio.to_thread(make, *arguments)
        except (SceneError, MissingExtraError, OSError) as error:
            self.complain(str(error))
            return
        ui.download.content(data, name)

    def picture(self) -> None:
        """What the figure of the open tab looks like now, drawn by the browser."""
        tab = self.bench.view["tab"]
        if self.bench.outcome is None or tab not in self.results.plots or not self.results.areas[tab].visible:
            self.complain("there is no figure to download: solve a scene, and open the tab of a figure")
            return
        options = {"format": "png", "width": 1200, "height": 900, "scale": 2, "filename": f"vrte-{tab}"}
        self.results.plots[tab].run_plot_method("downloadImage", options)

    def tensor(self) -> None:
        """Mitsuba's file wants directions of its own: they are solved for first."""
        bench = self.bench
        try:
            form.check(bench.content, bench.folder, bench.tables)
            downloads.check_tensor(bench.content)
        except SceneError as error:
            self.complain(str(error))
            return
        bench.start(Tensor(copy.deepcopy(bench.content), bench.folder, memory_of_one()))
