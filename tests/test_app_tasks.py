"""What a chemist does with the viewer, at three widths: clicks, scrolls and seconds that it takes, and how soon numbers
follow a slider; `pytest -m slow -n 0 -s tests/test_app_tasks.py` prints the tables of docs/how_to/viewer.md."""

import os
import re
import statistics
import time
from functools import cache
from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.app.form.checks import begin_with_material, write_link
from vrte.formats.materials import list_paints
from vrte.formats.toml_table import write_toml

from .helpers import close_to
from .test_app_browser import DROP, Tab
from .viewer_server import viewer

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(find_spec("colour") is None, reason="colours take the extra appearance"),
]
WIDTHS = {1400: 900, 820: 1180, 390: 844}  # pixels, and the heights that go with them
PATIENCE = 120_000  # milliseconds
READ = r"""() => { const cells = row => [...row.children].map(one => one.textContent);
    const rows = [...document.querySelectorAll('.vrte-look tr')].map(cells);
    const found = Object.fromEntries(rows.map(row => [row[0].trim(), row.slice(1).map(Number)]));
    const heading = document.querySelector('.vrte-now .vrte-heading').innerText;
    return {L: found['L*'], contrast: Number(heading.match(/[\d.]+/))}; }"""
FINAL = "!document.querySelector('.vrte-old') && [...document.querySelectorAll('.vrte-status .vrte-note')]" + (
    ".some(one => /^16 wavelengths.* s$/.test(one.innerText))"
)
SEEN = """one => { const box = one.getBoundingClientRect(), bar = document.querySelector('.vrte-solve');
    const end = getComputedStyle(bar).position === 'fixed' ? bar.getBoundingClientRect().top : innerHeight;
    return box.top >= 46 && box.bottom <= end; }"""


HELD = "text => document.querySelector('.vrte-left [aria-label=\"thickness [µm]\"]').value !== text"


class Chemist(Tab):
    """Counts what a person does: clicks, fields filled, files dropped and sliders moved, and scrolls to get there."""

    clicks, scrolls = 0, 0

    def reach(self, place: Any) -> Any:
        """A place to click, once it is in sight."""
        place.wait_for(timeout=PATIENCE)
        if not place.evaluate(SEEN):
            self.scrolls += 1
            place.evaluate("one => one.scrollIntoView({block: 'center'})")
        self.clicks += 1
        return place

    def click(self, name: str, role: Any = "button") -> None:
        exact = role != "tab"  # whose name begins with that of its symbol
        self.reach(self.page.get_by_role(role, name=name, exact=exact).first).click()

    def take(self, item: str) -> None:
        """An item of the open menu."""
        self.reach(self.page.locator(".q-menu .q-item").get_by_text(item, exact=True).first).click()

    def type(self, label: str, text: str) -> None:
        """Fills a field of the open tab, or else of the form."""
        field = self.page.locator(".vrte-right").get_by_label(label, exact=True)
        self.reach((field if field.count() else self.label(label)).first).fill(text)

    def set(self, label: str, text: str) -> None:
        """Types a number beside its slider, and waits until the form has it."""
        self.type(f"{label}, number", text)
        held = "text => [...document.querySelectorAll('.vrte-left input')].some(one => one.value === text)"
        self.waits_for(held, arg=text)

    def drop(self, text: str, name: str) -> None:
        self.clicks += 1
        self.evaluate(DROP, [text, name])

    def finish(self) -> dict[str, Any]:
        """The numbers of the tab Appearance, once all of them are there and of the form's scene."""
        self.waits_for(FINAL, timeout=PATIENCE)
        return dict(self.evaluate(READ))

    def time_a_move(self, name: str, fraction: float) -> dict[str, float]:
        """Milliseconds from a click on a slider to what changes then."""
        bar = self.page.locator(f'.vrte-bars .q-slider[aria-label="{name}"]')
        bar.scroll_into_view_if_needed()
        box = bar.bounding_box()
        self.rest(500)
        self.evaluate(WATCH)
        self.page.mouse.click(box["x"] + fraction * box["width"], box["y"] + box["height"] / 2)
        self.waits_for("window.seen.all", timeout=PATIENCE)
        return dict(self.evaluate("window.seen"))


def make_paint(name: str, **changed: Any) -> dict[str, Any]:
    """The content of a ready paint, with other keys of its table."""
    content = list_paints()[name].content
    return {**content, "paint": {**content["paint"], **changed}}


@cache
def measure_colour(name: str, **changed: float) -> dict[str, float]:
    """L*, a*, b* 45/0 of a ready paint over black, with other numbers."""
    rows = vrte.Measurement([*"Lab"], 0.0, geometry="45:0", illuminant="D65", observer=10)
    found = rows.predict(make_paint(name, **changed), accuracy=1e-4)
    return dict(zip("Lab", found.tolist(), strict=True))


@cache
def measure_white() -> str:
    """The text of a spectrophotometer on the white gloss paint of 40 um over black."""
    at = np.arange(440.0, 701.0, 20.0)
    rows = vrte.Measurement("reflectance", 0.0, geometry="8:di", wavelength_um=at / 1e3)
    read = 100.0 * rows.predict(make_paint("white gloss", thickness_um=40.0), accuracy=1e-4)
    lines = [f"{nm:.0f};{value:.3f}".replace(".", ",") for nm, value in zip(at, read, strict=True)]
    return "\n".join(["nm;White", *lines, ""])


def fit(one: Chemist, *numbers: str) -> None:
    """Fits numbers of the form to the measurement that was dropped, and takes what was found."""
    for number in numbers:
        one.click(number, "checkbox")
    one.click("Fit")
    one.page.get_by_text("What fits best").first.wait_for(timeout=PATIENCE)
    one.click("Take these values")


def match(one: Chemist, number: str, **lab: float) -> None:
    """Matches a colour over black by a number of the form, and takes what was found."""
    one.click("Match", "tab")
    for name, value in lab.items():
        one.type(f"{name}*", f"{value:.3f}")
    one.click(number, "checkbox")
    one.rest(200)  # what is typed is taken after 0.12 s
    one.click("Match")
    one.page.get_by_text("target met").first.wait_for(timeout=PATIENCE)
    one.click("Take these values")


def match_a_white(one: Chemist) -> None:
    """The white gloss paint over black, by its thickness, to the colour that it has at 25 um, of L* 94 to 96."""
    target = measure_colour("white gloss", thickness_um=25.0)
    assert target["L"] == close_to(95.0, rtol=0.0, atol=1.0)
    one.click("A paint")
    match(one, "thickness [µm]", **target)
    one.page.wait_for_function(HELD, arg="60", timeout=PATIENCE)


def match_a_red(one: Chemist) -> None:
    """The red oxide paint over black, by its load, to the colour of another."""
    one.click("A paint")
    one.click("Begin with a paint")
    one.take("Red oxide paint")
    match(one, "hematite: volume fraction", **measure_colour("red oxide", volume_fraction=0.06))


def fit_a_thickness(one: Chemist) -> None:
    """A white of 40 um measured in a sphere over black, as its software writes it: semicolons and decimal commas."""
    one.click("A paint")
    one.finish()
    one.drop(measure_white(), "white.txt")
    one.says("geometry='8:di' (sphere")
    one.click("geometry='8:di'")
    one.says("by their size")
    fit(one, "layer 2: thickness [µm]")
    one.waits_for(HELD, arg="60")
    assert float(one.value("thickness [µm]")) == close_to(40.0, rtol=0.01, atol=0.0)


def compare_roughnesses(one: Chemist) -> None:
    """The matt white, and how it changes with a roughness of 0.2."""
    one.click("A paint")
    one.click("Begin with a paint")
    one.take("White matt paint")
    one.finish()
    one.click("Compare with this from now on")
    one.set("roughness", "0.2")
    one.finish()
    one.says(re.compile(r"ΔE2000 from before: over black [\d.]+"))


def tabulate(one: Chemist) -> None:
    """A paint's numbers as a table."""
    one.click("A paint")
    one.finish()
    with one.page.expect_download() as waiting:
        one.click("Numbers, CSV")
    assert "hiding thickness" in waiting.value.path().read_text(encoding="utf-8-sig")


def open_yesterdays(one: Chemist) -> None:
    """A scene that was saved, with its colours."""
    content = begin_with_material(list_paints()["red oxide"])[0]
    one.drop(write_toml(content), "yesterday.toml")
    one.holds("thickness [µm]", "50")
    if one.page.get_by_role("tab", name="Appearance").get_attribute("aria-selected") != "true":
        one.click("Appearance", "tab")
    one.finish()


def open_a_link(one: Chemist) -> None:
    """A scene from an address, with its colours."""
    link = write_link(begin_with_material(list_paints()["red oxide"])[0])
    one.clicks += 1
    one.evaluate("text => { location.hash = `scene=${text}`; }", link)
    one.holds("thickness [µm]", "50")
    if one.page.get_by_role("tab", name="Appearance").get_attribute("aria-selected") != "true":
        one.click("Appearance", "tab")
    one.finish()


TASKS = {  # and the clicks that each may take
    "a white of L* 95 over black": (match_a_white, 8),
    "a red matched to a Lab": (match_a_red, 10),
    "two roughnesses compared": (compare_roughnesses, 5),
    "a thickness fitted to an own file": (fit_a_thickness, 6),
    "numbers to a spreadsheet": (tabulate, 2),
    "yesterday's file opened": (open_yesterdays, 1),
    "a link opened": (open_a_link, 1),
}


@pytest.mark.parametrize("width", WIDTHS)
def test_tasks_take_few_clicks(chromium: Any, width: int) -> None:
    """Each in a tab of its own; seconds are those of the page, without the person's."""
    wrong: list[str] = []
    taken: dict[str, int] = {}
    with viewer() as url:
        for words, (work, _) in TASKS.items():
            one = Chemist(chromium, url, (width, WIDTHS[width]), accept_downloads=True)
            one.page.get_by_text(re.compile("^Solved: ")).first.wait_for(timeout=PATIENCE)
            begin = time.perf_counter()
            work(one)
            seconds = time.perf_counter() - begin
            load = os.getloadavg()[0]
            print(f"{width} | {words} | {one.clicks} | {one.scrolls} | {seconds:.1f} | load {load:.0f}", flush=True)
            wrong += one.wrong
            taken[words] = one.clicks
            one.context.close()
    assert wrong == []
    assert {words: clicks for words, clicks in taken.items() if clicks > TASKS[words][1]} == {}


WATCH = r"""() => { const numbers = () => document.querySelector('.vrte-look table')?.textContent ?? '';
    const before = numbers(), begun = performance.now(), seen = window.seen = {};
    const note = name => { seen[name] ??= performance.now() - begun; };
    const look = () => {
        if (numbers() === before || !numbers().includes('h [') || document.querySelector('.vrte-old.vrte-now')) return;
        const status = document.querySelector('.vrte-status .vrte-note').textContent;
        note('first');
        if (/^16 wavelengths/.test(status)) note('colours');
        if (/^16 wavelengths.* s$/.test(status)) note('all'); };
    const what = {subtree: true, childList: true, characterData: true, attributes: true};
    new MutationObserver(look).observe(document.querySelector('.vrte-right'), what); }"""
MOVES = 0.45, 0.6, 0.5, 0.65, 0.55  # of a slider's length


def test_numbers_follow_a_slider_soon(chromium: Any) -> None:
    """Milliseconds to the first numbers, to the final colours, and to gloss and hiding: medians of moves."""
    with viewer() as url:
        for paint in ("Rutile in alkyd", "White gloss paint", "White matt paint"):
            one = Chemist(chromium, url, (1400, 900))  # whose numbers are of no other paint
            one.go_to("Appearance")
            one.begin_with(paint)
            one.finish()
            bars = one.page.locator(".vrte-bars .q-slider").all()
            for name in [
                bar.get_attribute("aria-label") for bar in bars if "card" not in bar.get_attribute("aria-label")
            ]:
                times = [one.time_a_move(name, fraction) for fraction in MOVES]
                took = {key: round(statistics.median(each[key] for each in times)) for key in times[0]}
                print(f"{paint} | {name} | {took} | load {os.getloadavg()[0]:.0f}", flush=True)
                assert took["first"] <= took["colours"] <= took["all"]
            one.context.close()
