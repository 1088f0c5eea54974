"""Pictures of the viewer for docs/how_to/viewer.md, taken in Chromium: `python -m docs.scripts.viewer_pictures`."""

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Page, sync_playwright

import vrte

IMAGES = Path(__file__).parents[1] / "images"
SIZE = {"width": 1280, "height": 800}
GRAPHICS = "--use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader"
PATIENCE = 120_000  # milliseconds
FINAL = re.compile("^16 wavelengths.* s$")  # of the tab Appearance, once gloss and hiding are there
DROP = """([text, name]) => { const transfer = new DataTransfer(); transfer.items.add(new File([text], name));
    document.body.dispatchEvent(new DragEvent('drop', {dataTransfer: transfer, bubbles: true, cancelable: true})); }"""
HAZE = """
[[layer]]
phase = { henyey_greenstein = 0.6 }
albedo = 0.9
thickness = 0.4
[base]
kind = "lambertian"
albedo = 0.3
"""
THICKNESS = 0.7  # of the film that is measured


def take(page: Page, name: str) -> None:
    """Writes a picture once nothing moves any more."""
    page.wait_for_timeout(1500)
    page.mouse.move(0, 0)
    for button in page.get_by_role("button", name="Close", exact=True).all():
        button.click()
    page.wait_for_timeout(1500)
    page.screenshot(path=IMAGES / f"{name}.png")


def click(page: Page, *names: str, role: Any = "button") -> None:
    for name in names:
        page.get_by_role(role, name=name, exact=True).first.click()


def show_start(page: Page) -> None:
    page.get_by_text(re.compile("^Solved: ")).wait_for()
    take(page, "viewer")


def show_paint(page: Page) -> None:
    click(page, "A paint", "Begin with a paint")
    page.locator(".q-menu").get_by_text("Pink, white tinted with red oxide", exact=True).click()
    page.get_by_text(FINAL).first.wait_for()
    take(page, "viewer_appearance")


def show_match(page: Page) -> None:
    """A white that has to hide, from the white gloss paint."""
    click(page, "A paint")
    click(page, "Match", role="tab")
    target = {"L*": "95", "a*": "-2", "b*": "1", "contrast ratio ≥": "0.98", "starts": "1", "volume solids [%]": "50"}
    for label, text in {**target, "volatile, density": "1", "thickness [µm], to": "90"}.items():
        page.get_by_label(label, exact=True).fill(text)
    click(page, "thickness [µm]", "rutile: volume fraction", role="checkbox")
    page.wait_for_timeout(500)
    click(page, "Match")
    page.get_by_text("target met").wait_for()
    page.get_by_role("button", name="Paint, TOML").scroll_into_view_if_needed()
    take(page, "viewer_match")


def show_measurement(page: Page) -> None:
    """A haze measured along a goniometer's arc, with 1 % of noise, and fitted."""
    scene = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.6), 0.9, THICKNESS)], base=vrte.Lambertian(0.3))
    arc = vrte.Measurement("f00", 0.0, 0.001, theta_i_deg=30.0, theta_o_deg=np.arange(-75.0, 76.0, 5.0))
    exact = arc.predict(scene)
    noisy = exact * (1.0 + 0.01 * np.random.default_rng(1).standard_normal(exact.shape))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "haze.csv"
        arc.measure(noisy).save(path)
        table = path.read_text(encoding="utf-8")
    page.get_by_text(re.compile("^Solved: ")).wait_for()
    page.evaluate(DROP, [HAZE, "haze.toml"])
    page.wait_for_function("document.querySelector('[aria-label=\"optical thickness\"]').value == '0.4'")
    page.evaluate(DROP, [table, "haze.csv"])
    page.get_by_role("checkbox", name="layer 1: optical thickness").click()
    click(page, "Fit")
    page.get_by_text("What fits best").first.wait_for()
    take(page, "viewer_measurement")


def main() -> None:
    command = [sys.executable, "-m", "vrte.cli", "view", "--no-browser", "--port", "0"]
    with sync_playwright() as playwright, subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        address = re.search(r"http://\S+", server.stdout.readline())
        assert address is not None
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"),
            args=f"--no-sandbox --disable-background-networking {GRAPHICS}".split(),
        )
        for show in (show_start, show_paint, show_match, show_measurement):
            page = browser.new_context(viewport=SIZE).new_page()
            page.set_default_timeout(PATIENCE)
            page.goto(address[0])
            page.add_style_tag(content=".vrte-header > .vrte-tagline:last-child { visibility: hidden; }")  # the version
            show(page)
            page.context.close()
        browser.close()
        server.terminate()


if __name__ == "__main__":
    main()
