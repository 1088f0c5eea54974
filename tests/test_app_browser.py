"""The viewer in a real browser: Debian's Chromium, or the one that VRTE_CHROMIUM names."""

import base64
import copy
import re
import tomllib
import zipfile
import zlib
from collections.abc import Callable, Iterator
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.app.form import content as form
from vrte.app.form.checks import write_link
from vrte.app.form.content import START, Content
from vrte.app.solving.tab_session import LARGEST_TABLE
from vrte.formats.bases import BASES
from vrte.formats.keys import FilePath
from vrte.formats.layers import PHASES
from vrte.formats.measured_polarized import read_tensors
from vrte.formats.particle_sources import SOURCES
from vrte.formats.scene_file import list_keys
from vrte.formats.toml_table import write_toml

from .helpers import assert_close, close_to
from .viewer_server import ROOT, viewer

TABLE = {"layer": [{"phase": "/etc/x.csv", "albedo": 1, "thickness": 1}]}  # a file of the machine
PATIENCE = 120_000  # milliseconds: other work may keep the cores busy
READY = "!document.querySelector('.vrte-go').disabled"
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    with viewer() as address:
        yield address


@pytest.fixture
def open_tab(chromium: Any, url: str) -> Iterator[Callable[..., "Tab"]]:
    """Opens tabs, each of another browser; in the end nothing may have gone wrong in any."""
    tabs: list[Tab] = []

    def opened(address: str = url, **more: Any) -> Tab:
        tabs.append(Tab(chromium, address, **more))
        return tabs[-1]

    yield opened
    for one in tabs:
        one.context.close()
    assert [tab.wrong for tab in tabs] == [[]] * len(tabs)


@pytest.fixture
def tab(open_tab: Callable[..., "Tab"]) -> "Tab":
    return open_tab()


FIGURE = """place => { const plots = [...document.querySelectorAll('.js-plotly-plot')].filter(p => p.offsetParent);
    const plot = plots[place]; if (!plot || !plot._fullData) return null;
    const traces = plot._fullData.map(trace => Array.from(trace.x || trace.r || []));
    traces.sort((a, b) => b.length - a.length);
    return {title: plot.getAttribute('aria-label') || '', points: traces[0] || []}; }"""
DROP = """([text, name]) => { const transfer = new DataTransfer(); transfer.items.add(new File([text], name));
    for (const type of ['dragover', 'drop']) document.body.dispatchEvent(
        new DragEvent(type, {dataTransfer: transfer, bubbles: true, cancelable: true})); }"""


class Tab:
    """A tab of somebody's own; what it asks of other machines, and what goes wrong in it, is written down."""

    def __init__(self, browser: Any, url: str, size: tuple[int, int] = (1280, 800), **more: Any) -> None:
        self.url, self.wrong = url.partition("/?")[0], []
        self.context = browser.new_context(viewport={"width": size[0], "height": size[1]}, **more)
        self.page = self.context.new_page()
        self.page.set_default_timeout(PATIENCE)
        self.page.on("console", lambda said: self.wrong.append(said.text) if said.type == "error" else None)
        self.page.on("pageerror", lambda error: self.wrong.append(str(error)))
        self.page.on("request", lambda request: self.check(request.url))
        self.page.on("websocket", lambda channel: self.check(channel.url.replace("ws:", "http:")))
        self.evaluate, self.waits_for = self.page.evaluate, self.page.wait_for_function
        self.page.goto(url)
        self.button("Solve").wait_for()

    def check(self, address: str) -> None:
        if not address.startswith((f"{self.url}/", "data:", "blob:")):
            self.wrong.append(f"asked for {address}")

    def button(self, name: str) -> Any:
        return self.page.get_by_role("button", name=name, exact=True)

    def label(self, text: str) -> Any:
        return self.page.get_by_label(text, exact=True)

    def go_to(self, name: str) -> None:
        self.page.get_by_role("tab", name=name).click()

    def fill(self, label: str, text: str) -> None:
        self.label(label).fill(text)

    def open(self, section: str) -> None:
        self.page.locator(".vrte-section", has_text=section).locator(".q-item").first.click()

    def solve(self) -> None:
        self.waits_for(READY)
        self.button("Solve").click()
        self.button("Cancel").wait_for()
        self.button("Cancel").wait_for(state="hidden")

    def slide(self, name: str, fraction: float) -> None:
        box = self.page.get_by_role("slider", name=name).bounding_box()
        self.page.mouse.click(box["x"] + fraction * (box["width"] - 4) + 2, box["y"] + box["height"] / 2)

    def wait_for_figure(self, different: Any = None) -> Any:
        """The points of the visible figure's largest trace, and its title, once it is there and another than that."""
        for _ in range(PATIENCE // 100):
            found = self.evaluate(FIGURE, 0)
            if found and found["points"] and (different is None or found["points"] != different["points"]):
                return found
            self.page.wait_for_timeout(100)
        raise AssertionError("no figure came")

    def choose(self, label: str, option: str) -> None:
        """Of the tab that is open: another may have a field of that name."""
        self.label(label).locator("visible=true").click()
        self.pick(option)

    def pick(self, option: str) -> None:
        """Of the open menu."""
        self.page.locator(".q-menu .q-item").get_by_text(option, exact=True).click()

    def download(self, button: str, folder: Path, item: str = "") -> Path:
        with self.page.expect_download() as waiting:
            self.button(button).click()
            if item:
                self.page.locator(".q-menu .q-item", has_text=item).click()
        path = folder / waiting.value.suggested_filename
        waiting.value.save_as(path)
        return path

    def put_in(self, button: str, path: Path) -> None:
        """A file that a button asks for."""
        with self.page.expect_file_chooser() as chooser:
            self.button(button).click()
        chooser.value.set_files(path)

    def says(self, *texts: str | re.Pattern[str], exact: bool = False) -> None:
        """Waits until it does."""
        for text in texts:
            self.page.get_by_text(text, exact=exact).first.wait_for()

    def begin_with(self, paint: str) -> None:
        self.button("Begin with a paint").click()
        self.pick(paint)

    def holds(self, label: str, value: str) -> None:
        """Waits until the fields of this label hold these values, joined by commas."""
        fields = f"[...document.querySelectorAll('[aria-label=\"{label}\"]')]"
        self.waits_for(f"value => {fields}.map(one => one.value).join() == value", arg=value)

    def value(self, label: str) -> str:
        return self.label(label).first.input_value()

    def rest(self, milliseconds: int) -> None:
        self.page.wait_for_timeout(milliseconds)


def fill_a_small_scene(tab: Tab) -> None:
    """Little to solve: absorbing dust at five wavelengths over a grey base."""
    tab.open("Accuracy")
    tab.open("Directions of the BRDF")
    for label, text in (
        ("wavelengths in vacuum [µm]", "0.45:0.65:5"),
        ("substance", "1.5, 0.01"),
        ("radius [µm]", "0.05"),
        ("optical thickness", "1"),
        ("nodes a hemisphere", "6"),
        ("cosines of incidence µ_i", "0.3, 0.6, 1"),
    ):
        tab.fill(label, text)


def test_a_scene_is_described_solved_looked_at_and_downloaded(
    tab: Tab, open_tab: Callable[..., Tab], tmp_path: Path
) -> None:
    start = tab.wait_for_figure()  # a first page shows something
    tab.fill("optical thickness", "-1")
    reason = "Solve waits: layer 1: optical thickness must be an optical thickness >= 0"
    tab.page.get_by_role("button", name=reason).click()
    assert tab.button("Solve").is_disabled()
    tab.waits_for("document.activeElement.getAttribute('aria-label') == 'optical thickness'")
    fill_a_small_scene(tab)
    tab.says("The form has changed since this was solved")
    tab.solve()
    tab.says(re.compile("^Solved: "))
    figure = tab.wait_for_figure(different=start)
    for slider, words in (("incident angle", "(µ_i = 1)"), ("wavelength", "wavelength 0.65 µm")):
        tab.slide(slider, 1.0)
        tab.says(words)
        figure = tab.wait_for_figure(different=figure)
    assert "μᵢ = 1," in figure["title"]
    stranger = open_tab()
    assert stranger.value("radius [µm]") == "0.6"
    assert stranger.wait_for_figure() == start
    tab.page.reload()
    assert tab.wait_for_figure() == figure
    assert tab.value("radius [µm]") == "0.05"

    for quantity in ("Mueller element f11", "reflectance factor"):
        tab.choose("distance from the centre", quantity)
        figure = tab.wait_for_figure(different=figure)
        assert ("|f11|" in figure["title"]) == ("f11" in quantity)
    tab.fill("I, Q, U, V", "0, 1, 0, 0")
    tab.says(re.compile("^stokes must"))
    tab.fill("I, Q, U, V", "2, 1.5, 0, 1")
    tab.wait_for_figure(different=figure)
    assert tab.value("incident light") == "other"
    assert tab.download("Download", tmp_path, "picture of the figure").read_bytes().startswith(b"\x89PNG")
    for name in ("Cuts", "Reflectance", "Inside", "Scattering"):
        tab.go_to(name)
        tab.wait_for_figure()
        for base in ("over black", "over white (albedo 1)") if name == "Reflectance" else ():
            tab.page.get_by_role("img", name=f"colour {base}: #").wait_for()
    tab.go_to("Plan")
    tab.says("transmission: not asked for")

    content = tomllib.loads(tab.download("Download", tmp_path, "scene, TOML").read_text(encoding="utf-8"))
    expected = {**START, "wavelength_um": {"start": 0.45, "stop": 0.65, "count": 5}, "nodes": 6}
    expected["particles"] = {"gold": {"index": [1.5, 0.01], "radius_um": 0.05}}
    expected["layer"] = [{"particles": "gold", "thickness": 1}]
    expected["brdf"] = expected["brdf"] | {"mu_i": [0.3, 0.6, 1]}
    assert content == expected
    numbers = vrte.spectrum(content)
    for suffix in ("NetCDF", "CSV"):
        found = vrte.load(tab.download("Download", tmp_path, f"BRDF, {suffix}"))
        assert_close(found.mueller, numbers.mueller, rtol=1e-12, atol=1e-16)
        field = vrte.load(tab.download("Download", tmp_path, f"field inside, {suffix}"))
        assert field.stokes.shape == (5, 120, 2, 4)
    tensors = read_tensors(tab.download("Download", tmp_path, "Mitsuba tensor"))
    assert tensors["wvls"].ravel().tolist() == [450, 500, 550, 600, 650]
    vrte.export(content, tmp_path / "expected.pbsdf")
    assert_close(tensors["M"], read_tensors(tmp_path / "expected.pbsdf")["M"], rtol=1e-5, atol=1e-9)


def test_hostile_input_gets_a_message_and_a_solve_can_be_cancelled(tab: Tab, tmp_path: Path) -> None:
    tab.wait_for_figure()
    tab.open("Accuracy")
    tab.fill("nodes a hemisphere", "900")
    tab.fill("substance", "<img src=x onerror=alert(1)>")
    tab.says("'<img src=x onerror=alert(1)>' is neither a known name")
    tab.fill("substance", "gold")
    name = '<script>alert(1)</script><img src="http://192.0.2.1/x" onerror="alert(2)">'[:60]
    tab.fill("name of the kind", name)
    tab.page.keyboard.press("Tab")
    tab.page.locator(".vrte-field", has_text=name).wait_for()  # the layer holds it by that name, as text

    tab.fill("radius [µm]", "2.5")  # takes a while
    tab.says("The form has changed since this was solved")
    tab.waits_for(READY)
    tab.button("Solve").click()
    tab.says("The scene of the form is being solved: what is shown here is the scene before.")
    tab.button("Cancel").click()
    tab.says("cancelled", exact=True)

    for file, words in (("bad.toml", "not valid TOML"), ("bad.nc", "the file: it is not a NetCDF file")):
        (tmp_path / file).write_text("[[[")
        tab.page.locator(".vrte-header input[type=file]").set_input_files(tmp_path / file)
        tab.says(words)
    gold = ROOT / "examples" / "gold_powder.toml"  # 40 nodes, which the start scene does not ask for
    tab.put_in("Open", gold)
    tab.holds("nodes a hemisphere", "40")
    tab.evaluate(DROP, [gold.read_text().replace("nodes = 40", "nodes = 17"), "dropped.toml"])
    tab.holds("nodes a hemisphere", "17")


# what a person can click, [text, what it is, place among those alike]: in the menu or dialog on top, else on the page
CONTROLS = """() => {
    const shown = one => one.checkVisibility() && one.getClientRects().length && !one.closest('.q-notifications')
        && !one.matches(':disabled, [aria-disabled=true]') && !one.closest('.disabled');
    const tops = [...document.querySelectorAll('.q-menu, .q-dialog .q-card')].filter(shown);
    const top = tops.at(-1);
    const kinds = top ? '.q-item, button' :
        'button, input:not([type=file]), [role=tab], [role=checkbox], [role=slider], .q-expansion-item .q-item,'
            + '.vrte-plot';
    const counts = {};
    window.controls = {};
    return {top: !!top, list: !!top?.matches('[role=listbox]') || top?.querySelectorAll('.q-menu .q-item').length > 10,
        keys: [...(top ?? document).querySelectorAll(kinds)].filter(shown).map(one => {
            const text = (one.getAttribute('aria-label') ?? one.innerText).trim().slice(0, 50);
            const name = `${one.getAttribute('role') ?? one.tagName} ${text}`;
            counts[name] = (counts[name] ?? 0) + 1;
            const key = `${name} ${counts[name]}`;
            window.controls[key] = one;
            return key; })}; }"""
EXPECTED = (
    "Gallery|rutile paint|White gloss paint|Chalk|Open|Download|BRDF, NetCDF|Link|Theme|dark|Solve|Cancel|add a layer|"
    "add a surface|add a kind|remove this|alkyd|in degrees|thickness in|radiance field|Accuracy|incident light|Lobe|"
    "Cuts|Reflectance|Appearance|Begin with a paint|Match|Measurement|Open a measurement|Inside|Scattering|Plan"
)


def test_every_control_is_clicked(open_tab: Callable[..., Tab]) -> None:
    """All that is on the page, that clicks bring, and that menus and dialogs offer: no error in the console."""
    tab = open_tab(accept_downloads=True)
    tab.page.on("filechooser", lambda chooser: None)
    tab.wait_for_figure()
    clicked: set[str] = set()
    opener = ""
    for _ in range(400):
        found = tab.evaluate(CONTROLS)
        keys = found["keys"]
        if found["list"] and keys:  # else it is still coming
            keys = [keys[-1], keys[0]]  # all of them would take minutes
        left = [key for key in keys if key not in clicked]
        left.sort(key=lambda key: ("Collapse" in key, key.startswith("tab ")))  # what hides others, last
        if not left and not found["top"]:
            break
        if not left:
            tab.page.keyboard.press("Escape")
        else:
            clicked.add(left[0])
            if found["top"] and len(left) > 1:
                clicked.discard(opener)  # opened again for the others
            elif not found["top"]:
                opener = left[0]
            tab.evaluate("key => { controls[key].scrollIntoView({block: 'center'}); }", left[0])
            control = tab.page.evaluate_handle("key => controls[key]", left[0]).as_element()
            box, before = control.bounding_box(), None
            while box and box != before:  # it may still be moving
                tab.rest(60)
                before, box = box, control.bounding_box()
            if box is None:  # gone with its menu or dialog: it comes again
                clicked.discard(left[0])
                continue
            tab.page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
            if "Gallery" in left[0]:  # which takes a while to come
                tab.says("Paints to begin with")
        tab.rest(350 if found["top"] else 800)  # menus and dialogs come and go
    else:
        raise AssertionError(f"there was no end of controls: {sorted(clicked)}")
    assert [name for name in EXPECTED.split("|") if name not in " ".join(clicked)] == [], sorted(clicked)


@pytest.mark.parametrize("size", [(390, 844), (820, 1180)])
def test_narrow_pages_are_one_column_and_nothing_is_cut(open_tab: Callable[..., Tab], size: tuple[int, int]) -> None:
    tab = open_tab(size=size, color_scheme="dark")
    before = None
    for name in ("Lobe", "Cuts", "Reflectance", "Inside", "Scattering"):
        tab.go_to(name)
        before = tab.wait_for_figure(different=before)
        box = tab.page.locator(".vrte-plot:visible").first.bounding_box()
        assert 0.0 <= box["x"] <= box["x"] + box["width"] <= size[0]
        assert box["width"] > 0.85 * min(size[0], 780)
        assert box["height"] > 300
        assert box["y"] < size[1] - 300  # in sight without scrolling
    assert tab.evaluate("document.documentElement.scrollWidth") == size[0]
    assert tab.page.locator("body.body--dark").count() == 1
    assert tab.evaluate("document.querySelector('.vrte-plot:not([style*=none])').layout.paper_bgcolor") == "#14181c"
    tab.button("Theme").click()
    tab.pick("light")
    tab.waits_for("!document.body.classList.contains('body--dark')")
    tab.page.reload()  # the browser keeps the choice
    tab.button("Solve").wait_for()
    tab.wait_for_figure()
    assert tab.page.locator("body.body--dark").count() == 0


def test_keys_solve_and_turn_layers_move_and_a_surface_mirrors(tab: Tab) -> None:
    start = tab.wait_for_figure()
    assert tab.evaluate("document.documentElement.lang") == "en"
    for level, text in ((1, "vrte"), (2, "Scene"), (2, "Result"), (3, "Subsurface BRDF")):
        assert tab.page.get_by_role("heading", level=level, name=text).count() == 1
    camera = "JSON.stringify(document.querySelector('.vrte-plot')._fullLayout.scene._scene.getCamera().eye)"
    before = tab.evaluate(camera)
    tab.page.locator(".vrte-plot").first.focus()
    for key in ("ArrowLeft", "ArrowUp", "+"):
        tab.page.keyboard.press(key)
    tab.waits_for(f"{camera} != {before!r}")
    turned = tab.evaluate(camera)
    tab.fill("optical thickness", "0.5")
    tab.page.keyboard.press("Enter")
    tab.wait_for_figure(different=start)
    tab.says(re.compile("^Solved: "))
    assert tab.evaluate(camera) == turned  # the next lobe is seen from there, too
    tab.choose("size", "one diameter")
    tab.holds("diameter [µm]", "1.2")
    tab.waits_for("document.activeElement.getAttribute('aria-label') == 'size'")  # drawn anew, still there
    tab.choose("size", "one radius")
    tab.holds("radius [µm]", "0.6")  # drawn anew once more
    tab.button("known substances").last.click()  # of the particles, not of the host
    tab.pick("rutile")
    tab.holds("name of the kind", "rutile")

    tab.button("add a layer").click()
    tab.holds("optical thickness", "0.5,0.5")
    tab.label("optical thickness").nth(1).fill("0.3")
    tab.button("down").first.click()
    tab.holds("optical thickness", "0.3,0.5")
    tab.button("remove this layer").last.click()
    tab.holds("optical thickness", "0.3")
    tab.button("add a surface or interface").click()
    tab.says("Interface", exact=True)
    tab.holds("refractive index of the host medium", "1.5")
    tab.open("Accuracy")
    tab.fill("nodes a hemisphere", "6")
    tab.fill("radius [µm]", "0.05")
    tab.solve()
    tab.page.get_by_role("figure", name="mirrored: ").wait_for()
    tab.go_to("Reflectance")
    tab.says("without what is mirrored as a beam")
    tab.choose("filled with", "nothing: clear or tinted")
    tab.go_to("Appearance")
    tab.says("No layer here holds particles")  # the server complains of nothing in the end


def pack(text: bytes) -> str:
    return base64.urlsafe_b64encode(zlib.compress(text, 9)).decode().rstrip("=")


def test_a_link_carries_the_scene_and_is_a_strangers(tab: Tab, open_tab: Callable[..., Tab], url: str) -> None:
    tab.fill("radius [µm]", "0.05")
    tab.fill("optical thickness", "7")
    tab.button("Link").click()
    tab.says("The address of this page carries the scene now")
    other = open_tab(f"{url}#{tab.page.url.partition('#')[2]}")
    other.holds("optical thickness", "7")
    assert other.value("radius [µm]") == "0.05"
    for text, words in (
        ("AAAA", "the link holds no scene, or it is damaged"),
        (pack(b"a" * 10**7), "at most 1000000 bytes"),
        (pack(b'" "' + b'." "' * 16_000 + b"=1"), "leads through more than 30 keys, tables or lists"),
        (write_link(TABLE), "reads no files of the machine"),
    ):
        assert other.value("optical thickness") == "7"
        other.evaluate("text => { location.hash = `scene=${text}`; }", text)
        other.says(words)
    assert other.value("table of coefficients") == "/etc/x.csv"  # a name alone
    assert other.button("Solve").is_disabled()


def test_files_are_put_in_read_and_described(tab: Tab, open_tab: Callable[..., Tab], tmp_path: Path) -> None:
    cosine = np.cos(np.radians(np.arange(181.0)))
    good, bad, large = (tmp_path / name for name in ("Rayleigh (1).csv", "bad.csv", "large.csv"))
    good.write_text("angle_deg,F11\n" + "".join(f"{k},{0.75 * (1 + c * c)}\n" for k, c in enumerate(cosine)))
    bad.write_text("angle_deg,F11\n0,-1\n180,1\n")
    large.write_bytes(bytes(LARGEST_TABLE + 1))
    tab.open("Accuracy")
    tab.fill("nodes a hemisphere", "4")
    tab.choose("filled with", "a scattering matrix over angle")
    tab.says("Solve waits: layer 1: file needs a file")
    other_name = tmp_path / "x.txt"
    other_name.touch()
    for path, words in ((large, "the file has more than 60 MB"), (other_name, "is no plain name"), (bad, "F11")):
        tab.put_in("choose a file", path)
        tab.says(words)
        assert tab.button("Solve").is_disabled()
    tab.put_in("choose a file", good)
    tab.says(re.compile("integral: 1 .*lowest eigenvalue"))
    assert tab.value("file") == "Rayleigh-1.csv"
    start = tab.wait_for_figure()
    tab.solve()
    tab.wait_for_figure(different=start)
    tab.button("Link").click()
    tab.says("It cannot carry Rayleigh-1.csv")
    with zipfile.ZipFile(tab.download("Download", tmp_path, "scene, TOML")) as archive:
        assert archive.namelist() == ["scene.toml", "Rayleigh-1.csv"]
        assert archive.read("Rayleigh-1.csv") == good.read_bytes()
        scene = archive.read("scene.toml").decode()
    other = open_tab()
    other.evaluate(DROP, [scene, "scene.toml"])
    other.says('"Rayleigh-1.csv" is not here', "reads no files of the machine")  # another's is another's
    other.put_in("choose a file", good)
    other.says(re.compile("integral: 1 "))
    other.waits_for(READY)


CUT = """() => { const form = document.querySelector('.vrte-left').getBoundingClientRect();
    const cut = [...document.querySelectorAll('.vrte-left .q-field__label')].filter(one =>
        one.scrollWidth > one.clientWidth + 1 && one.checkVisibility()).map(one => one.innerText);
    const out = [...document.querySelectorAll('.vrte-left .q-field')].filter(one => one.checkVisibility()
        && one.getBoundingClientRect().right > form.right + 1).map(one => one.innerText);
    return [...cut, ...out]; }"""


def make_scene_over(base: str) -> Content:
    """A scene of all sources, all ways to give a size and all phase functions, whose files are not there, on a base."""
    content = copy.deepcopy(START)
    for mode, source in zip(form.SIZE_MODES, cycle(SOURCES), strict=False):
        kind = content["particles"][form.add_kind(content)]
        form.set_source(kind, source)
        form.set_size_mode(kind, mode)
    for number, medium in enumerate(PHASES, 1):
        form.add_layer(content)
        form.set_medium(content, number, medium)
    form.set_base(content, base)
    for place, key, value in list_keys(content):
        if isinstance(key, FilePath) and value == "":
            form.put(content, place, f"gone{key.suffixes[0]}")
    return content


@pytest.mark.parametrize("size", [(1280, 800), (820, 1000)])
def test_every_choice_of_the_form_is_drawn_and_nothing_is_cut(
    open_tab: Callable[..., Tab], size: tuple[int, int]
) -> None:
    """All rows of all registries: labels fit their fields, and no field leaves the form."""
    tab = open_tab(size=size)
    for base, row in BASES.items():
        tab.evaluate(DROP, [write_toml(make_scene_over(base)), "all.toml"])
        tab.page.locator(".vrte-left").get_by_text(row.words, exact=True).first.wait_for()
        tab.rest(300)
        assert tab.evaluate(CUT) == []
    tab.button("add a surface or interface").click()
    tab.choose("surface", "rough: many small facets")
    tab.rest(300)
    assert tab.evaluate(CUT) == []


FINISHED = """() => [...document.querySelectorAll('.vrte-status .vrte-note')].some(
    one => one.innerText.startsWith('16 wavelengths'))
    && !document.querySelector('.vrte-status .q-spinner')?.checkVisibility()"""
# after every change of the page, once a slider has moved: the first swatch's colour, and whether it is grey
WATCH = """() => { window.seen = [];
    const read = () => [...document.querySelectorAll('.vrte-bars input')].map(one => one.value).join();
    const moved = read();
    new MutationObserver(() => {
        if (read() == moved) return;
        const now = document.querySelector('.vrte-now');
        window.seen.push([now.querySelector('.vrte-drawdown > div').ariaLabel, now.classList.contains('vrte-old')]);
    }).observe(document.body, {subtree: true, childList: true, characterData: true, attributes: true}); }"""
SWATCH_CHANGES = "before => document.querySelector('.vrte-drawdown > div').ariaLabel != before"


def test_a_slider_changes_the_colours_at_once(open_tab: Callable[..., Tab]) -> None:
    """On a phone, too, in the dark, and by keys; what is of another setting is grey, and says so."""
    tab = open_tab(size=(390, 844), color_scheme="dark")
    tab.go_to("Appearance")
    tab.says("Layer 1 has an optical thickness")
    for one in tab.page.get_by_role("tab").all():
        box = one.bounding_box()
        assert 0.0 <= box["x"] <= box["x"] + box["width"] <= 390.0
    tab.begin_with("White gloss paint")
    tab.page.get_by_text(re.compile("^Solved: ")).wait_for(state="hidden")  # that was of another scene
    tab.wait_for_figure()
    swatch, slider = (tab.page.locator(one).first.bounding_box() for one in (".vrte-drawdown", ".vrte-bars .q-slider"))
    assert swatch["y"] + swatch["height"] < slider["y"] < 844 - 96  # both are seen at once
    tab.waits_for(FINISHED)
    tab.says(re.compile(r"^hiding thickness [\d.]+ µm"), re.compile(r"^gloss 20°/60°/85°: [\d.]+ / [\d.]+ / [\d.]+ GU"))
    mark = tab.page.get_by_text("for the previous setting", exact=True)
    mark.wait_for(state="hidden")
    assert tab.value("thickness [µm]") == "60"
    assert tab.evaluate("document.documentElement.scrollWidth") == 390
    first = tab.page.get_by_role("img", name=re.compile("^colour over black: #[0-9a-f]{6}$"))
    before = first.get_attribute("aria-label")
    tab.button("Compare with this from now on").click()
    tab.says("ΔE2000 from before: over black 0.00")
    tab.waits_for("!document.querySelector('.vrte-old')")
    tab.evaluate(WATCH)
    tab.slide("thickness", 0.3)
    tab.waits_for(SWATCH_CHANGES, arg=before)
    tab.waits_for(FINISHED)
    mark.wait_for(state="hidden")
    seen = tab.evaluate("window.seen")
    assert any(grey for _, grey in seen)
    assert all(grey for colour, grey in seen if colour == before)  # never the old colour at full strength
    assert seen[-1][1] is False
    thickness = float(tab.value("thickness [µm]"))
    assert 3.0 < thickness < 10.0  # the slider is the form's field
    after = first.get_attribute("aria-label")
    ratio = re.search(r"[\d.]+", tab.page.locator(".vrte-heading", has_text="contrast ratio").inner_text())
    assert ratio
    assert 0.6 < float(ratio[0]) < 0.97
    red, green, blue = (int(after[-6:][index : index + 2], 16) for index in (0, 2, 4))
    colour = tab.evaluate("document.querySelector('.vrte-drawdown > div').style.background")
    assert colour == f"rgb({red}, {green}, {blue})"
    tab.page.keyboard.press("ArrowRight")
    moved = "before => [...document.querySelectorAll('.vrte-left input')].every(i => i.value != before)"
    tab.waits_for(moved, arg=f"{thickness:g}")
    tab.choose("illuminant", "A, light bulb")
    tab.waits_for(SWATCH_CHANGES, arg=after)


def test_a_page_begins_with_what_its_user_has(open_tab: Callable[..., Tab], tmp_path: Path) -> None:
    tab = open_tab()
    tab.button("A paint").click()
    tab.says(re.compile(r"^hiding thickness [\d.]+ µm dry \(contrast ratio 0.98\), [\d.]+ m²/l"))
    tab.button("A paint").wait_for(state="hidden")
    tab.fill("thickness, number", "20")  # beside the slider
    tab.waits_for("document.querySelector('.vrte-left [aria-label=\"thickness [µm]\"]').value == '20'")
    tab.fill("albedo of the white card, number", "0.7")
    tab.waits_for(FINISHED)
    page = tab.download("Download", tmp_path, "page of the paint, HTML (reads off all of it)")
    assert page.name == "paint.html"
    assert "spreading rate" in page.read_text(encoding="utf-8").lower()
    other = open_tab(size=(390, 844))
    other.button("An atmosphere").click()
    other.says(re.compile("^Solved: "))
    assert "Subsurface radiance" in other.wait_for_figure()["title"]
    assert other.evaluate("document.documentElement.scrollWidth") == 390


def test_a_rough_paint_is_shown_and_the_page_answers_meanwhile(tab: Tab) -> None:
    paint = (ROOT / "vrte/paints/white_gloss.toml").read_text(encoding="utf-8").partition("[paint]")[2]
    surface = "surface = { roughness = 0.3 }\n[brdf]\nmu_i = [0.5]\nmu_o = [0.2, 0.5, 0.9]\nphi_deg = [0, 180]\n"
    tab.evaluate(DROP, [f"wavelength_um = 0.55\n[paint]{paint}{surface}", "rough.toml"])
    tab.holds("thickness [µm]", "60")
    tab.solve()
    tab.says(re.compile("^Solved: "))
    tab.go_to("Appearance")
    colour = tab.page.get_by_role("img", name=re.compile("^colour over black: #[0-9a-f]{6}$"))
    before = colour.get_attribute("aria-label")
    tab.slide("thickness", 0.3)
    for name in ("Cuts", "Reflectance", "Plan"):
        tab.go_to(name)
    tab.says("transmission: not asked for")
    tab.go_to("Appearance")
    tab.waits_for(SWATCH_CHANGES, arg=before)


def test_a_result_file_is_shown_from_the_start(open_tab: Callable[..., Tab], tmp_path: Path) -> None:
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)])
    vrte.brdf(scene, [0.6, 1.0], np.linspace(0.05, 1.0, 20), np.arange(0, 361, 10), nodes=4).save(tmp_path / "r.nc")
    with viewer(str(tmp_path / "r.nc")) as address:
        tab = open_tab(address)
        assert "Subsurface BRDF" in tab.wait_for_figure()["title"]
        tab.context.close()


HAZE = """nodes = 4
[[layer]]
phase = "rayleigh"
albedo = 0.9
thickness = 0.4
[base]
kind = "lambertian"
albedo = 0.3
"""


def test_a_measurement_is_dropped_fitted_and_its_values_taken(tab: Tab, tmp_path: Path) -> None:
    rows = vrte.Measurement("f00", 0.0, 0.001, theta_i_deg=30.0, theta_o_deg=np.arange(-60.0, 61.0, 20.0))
    rows.measure(rows.predict(tomllib.loads(HAZE.replace("0.4", "0.7")))).save(tmp_path / "panel.csv")
    start = tab.wait_for_figure()  # of the scene that a page begins with: one dropped before is not solved
    tab.evaluate(DROP, [HAZE, "haze.toml"])
    tab.holds("optical thickness", "0.4")
    tab.evaluate(DROP, ["quantity,value\nf00,bright\n", "bad.csv"])
    tab.says("line 2: value must be a number, not 'bright'")
    tab.evaluate(DROP, ["nm;White\n500;60\n600;65\n", "white.txt"])
    tab.says("geometry='8:di' (sphere")
    tab.fill("what the file leaves open", "geometry='SCE'")
    tab.says("reflectance of 'White' in per cent: by their size, up to 65")
    white = tab.wait_for_figure(different=start)
    tab.fill("what the file leaves open", "")
    tab.evaluate(DROP, [(tmp_path / "panel.csv").read_text(), "panel.csv"])
    first = tab.wait_for_figure(different=white)
    assert first["title"].startswith("Measured f00; points: measured")
    tab.says("-60 to 60° (7)", exact=True)
    tab.page.get_by_role("checkbox", name="layer 1: optical thickness").click()
    tab.fill("layer 1: optical thickness, to", "0.3")
    tab.button("Fit").click()
    tab.says("layer 1: optical thickness is 0.4 now, which is not between 0.04 and 0.3")
    tab.fill("layer 1: optical thickness, to", "5")
    tab.rest(300)
    tab.button("Fit").click()
    tab.says("What fits best")
    page, scene = (tab.download(button, tmp_path) for button in ("Page of the fit", "Fitted scene, TOML"))
    assert (page.name, scene.name) == ("fit.html", "fitted.toml")
    assert "http" not in re.sub(r"http://www\.w3\.org/\S*", "", page.read_text())
    content = tomllib.loads(scene.read_text())
    assert content["layer"][0]["thickness"] == close_to(0.7, rtol=1e-4, atol=0.0)
    assert content["base"] == {"kind": "lambertian", "albedo": 0.3}
    tab.button("Take these values").click()
    tab.waits_for("document.querySelector('[aria-label=\"optical thickness\"]').value.startsWith('0.7')")
    tab.button("Back to those before").click()
    tab.holds("optical thickness", "0.4")
    tab.page.reload()  # the measurement and what was found stay
    tab.says("What fits best")


# elements that are seen: text whose contrast is below 4.5, [text, ratio]; sliders and fields without a name; landmarks
# and pictures with something to click in them that hide it from those who listen
TRAPS = r"""() => {
    const shown = one => one.checkVisibility({checkOpacity: true, checkVisibilityCSS: true})
        && one.getClientRects().length;
    const parse = text => (text.match(/[\d.]+/g) ?? []).map(Number);
    const over = (above, below) => [0, 1, 2].map(k => above[k] * (above[3] ?? 1) + below[k] * (1 - (above[3] ?? 1)));
    const parents = one => one ? [...parents(one.parentElement), one] : [];
    const straight = v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
    const light = rgb => { const linear = rgb.map(v => straight(v / 255));
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]; };
    const faint = [];
    for (const one of document.querySelectorAll('body *')) {
        const text = [...one.childNodes].filter(n => n.nodeType == 3).map(n => n.data.trim()).join('');
        const apart = one.closest('svg, .q-icon, .vrte-hidden, .disabled, :disabled, .js-plotly-plot');
        if (!text || apart || !shown(one)) continue;
        let paper = [255, 255, 255], opacity = 1;
        for (const each of parents(one)) {
            const style = getComputedStyle(each);
            paper = over(parse(style.backgroundColor), paper);
            opacity *= Number(style.opacity);
        }
        if (one.closest('.q-notification') && opacity < 1) continue;  // it comes or goes
        const ink = parse(getComputedStyle(one).color);
        const drawn = over([...ink.slice(0, 3), (ink[3] ?? 1) * opacity], paper);
        const [dark, bright] = [light(drawn), light(paper)].sort((a, b) => a - b);
        const ratio = (bright + 0.05) / (dark + 0.05);
        if (ratio < 4.5) faint.push([text, ratio.toFixed(2)]);
    }
    const named = one => one.getAttribute('aria-label') || one.labels?.length || one.closest('label, [aria-label]');
    const all = 'input:not([type=file]), [role=slider], [role=progressbar], [role=dialog], button';
    const nameless = [...document.querySelectorAll(all)]
        .filter(one => shown(one) && !named(one) && !one.innerText?.trim()).map(one => one.outerHTML.slice(0, 120));
    const mains = document.querySelectorAll('main, [role=main]').length;
    const nested = [...document.querySelectorAll('[role=img], [role=button], button')]
        .filter(one => shown(one) && one.querySelector('a[href], button, input, [tabindex]:not([tabindex="-1"])'))
        .map(one => one.outerHTML.slice(0, 120));
    const heads = [...document.querySelectorAll('th')].filter(one => shown(one) && !one.innerText.trim()).length;
    return {faint, nameless, mains, nested, heads}; }"""
CLEAN = {"faint": [], "nameless": [], "mains": 1, "nested": [], "heads": 0}


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_everything_can_be_read_and_has_a_name(open_tab: Callable[..., Tab], scheme: str) -> None:
    """Contrasts of 4.5, one main landmark, nothing to click inside a picture: on every tab, with a field that is wrong,
    with several wavelengths."""
    tab = open_tab(color_scheme=scheme)

    def is_clean(after: int = 500) -> None:
        tab.rest(after)
        assert tab.evaluate(TRAPS) == CLEAN

    fill_a_small_scene(tab)
    tab.solve()
    for name in ("Lobe", "Cuts", "Reflectance", "Appearance", "Measurement", "Inside", "Scattering", "Plan"):
        tab.go_to(name)
        is_clean(700)
    tab.fill("optical thickness", "-1")
    tab.says("Solve waits")
    is_clean()
    tab.fill("optical thickness", "1")
    tab.go_to("Appearance")
    tab.begin_with("White gloss paint")
    tab.wait_for_figure()
    tab.waits_for("!document.querySelector('.vrte-old')")
    is_clean()
    tab.button("Gallery").click()
    tab.says("Paints to begin with")
    is_clean()
    pictures = [*(ROOT / "vrte/app/gallery").glob("*.png")]
    shown = "document.querySelectorAll('.vrte-start img[src^=\"data:image/png\"]').length"
    assert tab.evaluate(shown) == len(pictures)
    tab.button("Silver metallic basecoat").click()
    tab.label("tilt σ [°]").first.wait_for()
    assert tab.value("tilt σ [°]") == "10"
    tab.button("Gallery").click()
    tab.button("Rutile in alkyd").click()
    tab.says("White gloss paint")
    assert tab.value("median diameter [µm]") == "0.2"
    assert tab.value("refractive index of its medium") == "alkyd"
    tab.waits_for(READY)
