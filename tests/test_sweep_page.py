"""The page of a sweep: what it holds is the table, what it shows is what vrte.interpolate says, and it works in a
browser from the disk alone. Debian's Chromium, or the one that VRTE_CHROMIUM names."""

import json
import re
import runpy
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray

import vrte
from vrte.cli import main
from vrte.results.over_hemisphere import stokes_over_hemisphere
from vrte.sweep.interpolation import interpolate
from vrte.sweep.page.writing import (
    STEP,
    check_sweep_for_page,
    pack_matrices,
    save_page,
    take_half_circle,
    unpack_matrices,
)
from vrte.sweep.template import read_sweep

from .helpers import close_to

TRY = Path(__file__).parents[1] / "docs" / "try"
BRDF = {"mu_i": [0.9, 0.5], "mu_o": [1.0, 0.9, 0.7, 0.45, 0.2], "phi_deg": [0, 30, 60, 90, 120, 150, 180]}
AXES: dict[str, Any] = {
    "depth": {"key": "layer[1].thickness", "values": [0.2, 0.5, 1.0, 1.8, 4.0]},
    "base.albedo": [0.6, 0.1],
}
SWEEP: dict[str, Any] = {
    "nodes": 6,
    "layer": [{"phase": "rayleigh", "albedo": 0.9, "thickness": 1.0}],
    "base": {"kind": "lambertian", "albedo": 0.3},
    "brdf": BRDF,
    "axes": AXES,
}


@pytest.fixture(scope="module")
def table() -> Any:
    return vrte.sweep(SWEEP, workers=1)


@pytest.fixture(scope="module")
def page(table: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "rayleigh.html"
    glossy = {**SWEEP, "layer": [{"interface": {"above": 1.0, "below": 1.5}}, {**SWEEP["layer"][0], "host_index": 1.5}]}
    glossy |= {"axes": {"depth": {**AXES["depth"], "key": "layer[2].thickness"}}}
    tables = {"a <Rayleigh> layer": table, "under a smooth surface": vrte.sweep(glossy, workers=1)}
    errors = save_page(tables, path, points=2)
    assert [found.shape for found in errors.values()] == [(2,), (2,)]
    assert all(0.0 < found.max() < 0.05 for found in errors.values())
    return path


def read_content(page: Path) -> Any:
    found = re.search(
        r'<script type="application/json" id="content">(.*?)</script>', page.read_text("utf-8"), re.DOTALL
    )
    assert found
    return json.loads(found[1])


def test_the_page_holds_the_table(table: Any, page: Path) -> None:
    """Mueller matrices decoded again, axes ascending, and the shares beside them."""
    held = read_content(page)["tables"][0]
    assert held["name"] == "a <Rayleigh> layer"
    assert [axis["values"] for axis in held["axes"]] == [AXES["depth"]["values"], [0.1, 0.6]]
    assert [axis["between"] for axis in held["axes"]] == [True, False]
    found, given = unpack_matrices(held["packed"]), table.isel({"base.albedo": [1, 0]}).mueller.values
    assert found.shape == given.shape
    assert (np.abs(found - given) <= 1.01 * STEP * given[..., :1, :1]).all()
    assert np.abs(found - given).max() > 0.0
    reflectance = table.isel({"base.albedo": [1, 0]}).reflectance.values
    assert np.abs(np.array(held["shares"]["reflectance"]) - reflectance).max() < 1e-6


@pytest.mark.parametrize("spread", [1.0, 60.0])
def test_what_is_packed_comes_back(spread: float) -> None:
    """Numbers without any order, and f_00 over so many powers of e that its steps are wider."""
    chance = np.random.default_rng(0)
    brightness = np.exp(chance.uniform(-spread, spread, (3, 2, 4, 5)))
    matrices = brightness[..., None, None] * chance.uniform(-1.0, 1.0, (3, 2, 4, 5, 4, 4))
    matrices[..., 0, 0] = brightness
    packed = pack_matrices(matrices)
    assert (packed["step"] > STEP) == (spread > 30.0)
    off = np.abs(unpack_matrices(packed) - matrices) / brightness[..., None, None]
    assert off.max() < 0.51 * (STEP + 2.0 * packed["step"])


def test_other_azimuths_are_mirror_images() -> None:
    """A table from 180 to 360 degrees is that from 0 to 180."""
    turned = {**BRDF, "phi_deg": [180, 210, 240, 270, 300, 330, 360]}
    tables = [vrte.sweep({**SWEEP, "brdf": one, "axes": {"base.albedo": [0.1]}}, workers=1) for one in (BRDF, turned)]
    (phi, given), (again, mirrored) = map(take_half_circle, tables)
    assert phi.tolist() == again.tolist() == BRDF["phi_deg"]
    assert np.abs(given - mirrored).max() < 1e-12


FIELD = {key: value for key, value in SWEEP.items() if key != "brdf"} | {"field": {"mu0": 0.5, "mu": [0.5]}}
KEYS = {"depth": "layer[1].thickness", "grey": "base.albedo"}
TOGETHER = {name: {"key": key, "values": [0.2, 0.5], "along": "case"} for name, key in KEYS.items()}
REFUSED = [
    (FIELD, "lobes of BRDFs, and this is a table of fields"),
    ({**SWEEP, "axes": TOGETHER}, "mine: axes.depth: is one of several along case"),
    ({**SWEEP, "axes": {"layer[1].thickness": [1.0, np.inf]}}, "has an infinite value"),
    ({**SWEEP, "axes": {"base.albedo": [0.1, 0.1]}}, "mine: axes.base.albedo: has the same value twice"),
    ({**SWEEP, "brdf": {**BRDF, "mu_o": [0.5]}}, "at least 2 different mu_o"),
    ({**SWEEP, "brdf": {**BRDF, "mu_i": [0.5, 0.5]}}, "brdf.mu_i has the same value twice"),
    ({"mueller": 0.0}, "mine: a page needs light in every direction"),
    ({"error": "no"}, "mine: 10 of its 10 scenes have no result"),
    (None, "at least one table"),
]


@pytest.mark.parametrize(("given", "words"), REFUSED, ids=[words[:30] for _, words in REFUSED])
def test_what_a_page_cannot_show_is_refused(table: Any, tmp_path: Path, given: Any, words: str) -> None:
    """A sweep, a table whose variables are all the same, or none."""
    made = vrte.sweep(given, workers=1) if given and "nodes" in given else table.copy()
    for name, value in (given or {}).items() if given and "nodes" not in given else ():
        made[name] = xarray.full_like(table[name], value)
    with pytest.raises(vrte.SceneError, match=re.escape(words)):
        save_page({"mine": made} if given else {}, tmp_path / "page.html", points=1)
    with pytest.raises(vrte.SceneError, match=r"must end in \.html"):
        save_page({"mine": table}, tmp_path / "page.txt", points=1)
    assert not list(tmp_path.iterdir())


PAINT = """
wavelength_um = 0.55
nodes = 4
paint = { pigment = "rutile", binder = "alkyd", volume_fraction = 0.1, thickness_um = 10 }
axes = { 'paint.thickness_um' = [5, 10, 20, 40] }
brdf = { mu_i = 0.5, mu_o = [0.3, 0.6, 1.0], phi_deg = [0, 60, 120, 180] }
"""


def test_the_command_writes_a_page_beside_the_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """And refuses what no page can show before anything is computed."""
    path = tmp_path / "paint.toml"
    words = ["sweep", str(path), "-o", str(tmp_path / "paint.zarr"), "--page", str(tmp_path / "paint.html")]
    path.write_text(PAINT.partition("brdf")[0] + "field = { mu0 = 0.5, mu = [0.5] }\n")
    assert main(words) == 2
    assert "this is a table of fields" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [path]
    path.write_text(PAINT)
    assert main(words) == 0
    reported = capsys.readouterr().out
    assert f"wrote {tmp_path / 'paint.html'}" in reported
    assert "off by at most" in reported
    (held,) = read_content(tmp_path / "paint.html")["tables"]
    assert held["name"] == "paint"
    assert held["axes"][0]["key"] == "layer[2].thickness_um"  # where the paint's film is
    assert set(held["shares"]) == {"reflectance", "total_reflectance", "specular"}


def test_the_sweeps_of_the_site_fit_a_page() -> None:
    """Each sweep file of docs/try is in the menu of the site's page, begins with its name there, and can be shown."""
    script = runpy.run_path(str(TRY / "make_page.py"))
    files = sorted(TRY.glob("*.toml"))
    assert sorted(script["FILES"]) == [path.stem for path in files]
    for path in files:
        assert re.match(r"# [A-Z]", path.read_text("utf-8"))
        check_sweep_for_page(read_sweep(path))


@pytest.fixture
def tab(chromium: Any, page: Path) -> Iterator[Any]:
    """The page as a reader has it, from the disk; in the end nothing went wrong, and nothing else was asked for."""
    wrong: list[str] = []
    context = chromium.new_context(viewport={"width": 1280, "height": 800})
    found = context.new_page()
    found.on("console", lambda said: wrong.append(said.text))
    found.on("pageerror", lambda error: wrong.append(str(error)))
    found.on("request", lambda request: wrong.append(request.url) if request.url != page.as_uri() else None)
    found.goto(page.as_uri())
    found.wait_for_selector("body[data-table]")
    yield found
    context.close()
    assert wrong == []


def look(tab: Any) -> str:
    """The picture as it is now."""
    tab.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return tab.evaluate("document.getElementById('lobe').toDataURL()")


@pytest.mark.slow
def test_the_page_interpolates_as_vrte_does(tab: Any, table: Any) -> None:
    """Mueller matrices and reflectances between the scenes, and the light between the directions."""
    for depth, albedo, index in ((0.2, 0.6, 0), (0.71, 0.1, 1), (3.3, 0.6, 1)):
        at = f"[tables[0], [{depth}, {albedo}], {index}]".replace("tables", "content.tables")
        found = np.array(tab.evaluate(f"Array.from(interpolateMatrices(...{at}))")).reshape(4, 4, 5, 7)
        here = interpolate(table, {"depth": depth, "base.albedo": albedo})
        expected = here.mueller.values[index]
        assert np.abs(found.transpose(2, 3, 0, 1) - expected).max() < 2.5 * STEP * expected[..., 0, 0].max()
        fraction = tab.evaluate(f"interpolateShares(content.tables[0], 'reflectance', [{depth}, {albedo}], {index})")
        assert fraction == close_to(here.reflectance.values[index], rtol=0.0, atol=2e-6)
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=0.9, thickness=1.0)], vrte.Lambertian(0.6))
    brdf = vrte.brdf(scene, *(np.array(BRDF[key], float) for key in ("mu_i", "mu_o", "phi_deg")), nodes=6)
    incident = [1.0, 0.3, -0.5, 0.2]
    script = f"spreadLight(content.tables[0], interpolateMatrices(content.tables[0], [1.0, 0.6], 1), {incident})"
    light = np.array(tab.evaluate(f"Array.from({script})")).reshape(36, 72, 4)
    rings, spokes = np.linspace(0.0, np.degrees(np.arccos(0.2)), 36), 5.0 * np.arange(72)
    expected = stokes_over_hemisphere(brdf, 1, rings, spokes, incident)
    assert np.abs(light - expected).max() < 2.5 * STEP * expected[..., 0].max()


@pytest.mark.slow
def test_sliders_menus_keys_and_clicks_change_what_is_shown(tab: Any) -> None:
    seen = [look(tab)]

    def changed(what: str) -> None:
        seen.append(look(tab))
        assert seen[-1] != seen[-2], what

    numbers = {tab.locator("#summary").inner_text()}
    for slider in ("depth", "angle of incidence"):
        tab.get_by_role("slider", name=slider).focus()
        tab.keyboard.press("ArrowRight")
        changed(slider)
        numbers.add(tab.locator("#summary").inner_text())
    assert len(numbers) == 3
    colours = "Q/I", "Mueller element f22", "angle of linear polarization", "radiance I"
    for menu, names in {"#colour": colours, "#incident": ("linear, across it",), "#height": ("U/I",)}.items():
        for name in names:
            tab.select_option(menu, label=name)
            changed(name)
    tab.locator("#lobe").focus()
    for key in ("ArrowLeft", "ArrowUp", "+", "0"):
        tab.keyboard.press(key)
        changed(key)
    before, box = tab.locator("#numbers").inner_text(), tab.locator("#lobe").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    tab.mouse.click(box["x"] + 0.45 * box["width"], box["y"] + 0.55 * box["height"])
    assert tab.locator("#numbers").inner_text() != before
    index = tab.evaluate("findPlace()")
    assert tab.locator("#theta-said").inner_text() == f"{tab.evaluate('shown.mesh.theta')[index[0]]:.1f}°"
    look(tab)
    tab.mouse.move(x, y), tab.mouse.down(), tab.mouse.move(x + 60, y + 20), tab.mouse.up()
    changed("a drag")
    assert "mirrored as a beam" not in tab.locator("#summary").inner_text()
    tab.select_option("#pick", label="under a smooth surface")
    tab.wait_for_selector("body[data-table='under a smooth surface']")
    assert "mirrored as a beam" in tab.locator("#summary").inner_text()


@pytest.mark.slow
@pytest.mark.parametrize("width", [390, 800])
def test_the_page_fits_a_phone(chromium: Any, page: Path, width: int) -> None:
    context = chromium.new_context(viewport={"width": width, "height": 844}, color_scheme="dark")
    found = context.new_page()
    found.goto(page.as_uri())
    found.wait_for_selector("body[data-table]")
    assert found.evaluate("document.documentElement.scrollWidth") == width
    assert found.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(20, 24, 28)"
    context.close()
