"""The viewer's Match tab: what is typed becomes a target, a worker meets it, and the recipe goes to the form."""

import csv
import io
import re
import time
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.app.form.checks import begin_with_material
from vrte.app.form.numbers import list_sliders, put_values
from vrte.app.page.free_numbers import choose_free, find_places
from vrte.app.page.match_panel import WORDS, collect_target, list_matched, split_table
from vrte.app.solving.matching import Matched, match_scene, read_target
from vrte.app.solving.tab_session import TabSession
from vrte.app.solving.worker import Refused
from vrte.formats.materials import list_paints

from .helpers import assert_close, run, wait_until
from .test_app_browser import Tab
from .viewer_server import viewer, work

LOOKS = {"over": "black", "geometry": "45:0", "illuminant": "D65", "observer": 10}
THICKNESS = "layer[2].thickness_um"


def collect(looks: dict[str, Any] = LOOKS, prices: Any = None, densities: Any = None, **fields: str) -> dict[str, Any]:
    """Keywords of a match, of what is typed."""
    return collect_target({"looks": looks, "fields": fields, "prices": prices or {}, "densities": densities or {}})


@pytest.fixture(scope="module")
def white() -> dict[str, Any]:
    """The form's content of a white paint."""
    return begin_with_material(list_paints()["white gloss"])[0]


def test_what_is_typed_becomes_a_target(white: dict[str, Any]) -> None:
    typed = {
        "L": "95",
        "a": "-1,5",
        "b": " -2 ",
        "contrast_ratio": "0,98",
        "gloss_60": "",
        "solids": "50",
        "starts": "2",
    }
    assert collect(prices={"rutile": "3,2", "alkyd": ""}, densities={"volatile": "1"}, **typed) == {
        **LOOKS,
        "lab": [95.0, -1.5, -2.0],
        "contrast_ratio": 0.98,
        "volume_solids": 0.5,
        "starts": 2,
        "cost": {"rutile": 3.2},
        "densities": {"volatile": 1.0},
    }
    for wrong, words in (
        ({"L": "95"}, "L*, a*, b*: type all three, or none of them"),
        ({"gloss_60": "high"}, "gloss 60° [GU] must be a number, not 'high'"),
        ({"prices": {"rutile": "x"}}, "price of rutile must be a number, not 'x'"),
        ({"starts": "0"}, "starts must be a whole number"),
    ):
        with pytest.raises(vrte.SceneError, match=re.escape(words)):
            collect(**wrong)
    offered = {one.key: (one.label, one.low, one.high) for one in list_matched(list_sliders(white))}
    assert offered[THICKNESS] == ("thickness [µm]", 12.0, 300.0)
    assert offered["layer[2].volume_fractions.rutile"] == ("rutile: volume fraction", 0.015, 0.3)
    ticked = {THICKNESS: {"free": True, "high": 20.0}}
    free = choose_free(list_matched(list_sliders(white)), ticked, around_start=False)
    assert free == {THICKNESS: {"low": 12.0, "high": 20.0}}


def test_a_recipe_with_its_files_goes_to_the_form(
    white: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    colour = {"L": "91", "a": "-1", "b": "-4", "tolerance": "6"}
    asked = collect(contrast_ratio="0.93", starts="1", solids="50", **colour)
    asked["free"] = {THICKNESS: {"low": 5.0, "high": 40.0}}
    *reported, found = work(match_scene, white, asked=asked)
    assert isinstance(found, Matched), found
    assert 0.0 <= reported[-1].fraction <= 1.0
    assert found.lines[0] == "target met"
    (length,) = found.values.tolist()
    assert_close([found.shades["wanted"].numbers[name] for name in "Lab"], [91.0, -1.0, -4.0], rtol=1e-9, atol=1e-9)
    lab = [float(row[2]) for row in found.tables[1][1:4]]
    assert_close([found.shades["found"].numbers[name] for name in "Lab"], lab, rtol=1e-4, atol=1e-4)
    taken = put_values(white, find_places(found.content, found.names, found.values))
    look = vrte.appearance({key: taken[key] for key in ("particles", "layer")}, geometries=["45:0"])
    assert_close(look.hiding().contrast_ratio, 0.93, rtol=2e-4, atol=0.0)
    heads, rows = split_table(found.tables[2], {THICKNESS: "thickness [µm]"})
    assert heads[:2] == ["1 % more of", "value"]
    assert rows[0][:2] == ["thickness [µm]", f"{length:.5g}"]
    assert list(found.files) == ["target.toml", "recipe.toml", "recipe.csv", "recipe.html"]
    assert tomllib.loads(found.files["recipe.toml"].decode())["layer"][1]["thickness_um"] == length
    numbers = {tuple(row[:3]): row[3] for row in csv.reader(io.StringIO(found.files["recipe.csv"].decode()))}
    assert numbers["recipe [%]", "rutile", "wet volume"] == "7.500"
    monkeypatch.chdir(tmp_path)
    Path("target.toml").write_bytes(found.files["target.toml"])
    target = tomllib.loads(found.files["target.toml"].decode())
    paint = target.pop("paint")
    assert vrte.match(paint, **target).values.tolist() == [length]
    assert run("paint", "--match", "target.toml", "--nodes", "2.5") == 2  # refused before the work


def test_a_refusal_is_in_the_words_of_the_tab(white: dict[str, Any]) -> None:
    for fields, words in (
        ({}, "match needs a target"),
        ({"contrast_ratio": "98"}, "contrast ratio ≥ must be above 0 and below 1, not 98"),
        ({"L": "195", "a": "0", "b": "0"}, "L*, a*, b* must be with L* from 0 to 120"),
    ):
        (*_, found) = work(match_scene, white, asked=collect(**fields) | {"free": [THICKNESS]})
        assert isinstance(found, Refused)
        message = found.message
        for key in sorted(WORDS, key=len, reverse=True):
            message = message.replace(key, WORDS[key])
        assert words in message


def test_a_measurement_is_a_target() -> None:
    at = np.linspace(0.4, 0.7, 31)
    both = vrte.Measurement(
        "reflectance", [*(0.6 + 0.0 * at), *(0.7 + 0.0 * at)], wavelength_um=[*at, *at], geometry="8:di",
        base=[0.0] * 31 + [0.8] * 31,
    )  # fmt: skip
    found = read_target(both)
    assert found["over"] == "black"
    assert found["geometry"] == "8:di"
    assert_close(found["contrast_ratio"], 6.0 / 7.0, rtol=1e-4, atol=0.0)
    assert_close(found["lab"], [116.0 * 0.6 ** (1.0 / 3.0) - 16.0, 0.0, 0.0], rtol=1e-5, atol=2e-3)
    coloured = vrte.Measurement([*"Lab"], [50.0, 20.0, -3.0], geometry="45:0", illuminant="A", observer=2)
    expected = {"lab": [50.0, 20.0, -3.0], "geometry": "45:0", "illuminant": "A", "observer": 2}
    assert read_target(coloured) == expected
    glossy = vrte.Measurement(["gloss_60", "gloss_60"], [80.0, 82.0])
    assert read_target(glossy) == {"gloss_60": 81.0}
    with pytest.raises(vrte.SceneError, match="neither a colour"):
        read_target(vrte.Measurement("total_reflectance", 0.5, theta_i_deg=8.0))


@pytest.mark.slow
def test_a_match_is_stopped_with_the_best_so_far(white: dict[str, Any]) -> None:
    asked = collect(contrast_ratio="0.93", starts="50") | {"free": {THICKNESS: {"low": 5.0, "high": 40.0}}}
    session = TabSession(white, pages=1)
    session.matches.ask(session.make_task("matching.match_scene", asked=asked))
    wait_until(lambda: session.matches.progress.fraction > 0.0)
    session.matches.stop()
    begin = time.monotonic()
    wait_until(lambda: not session.matches.waits)
    assert time.monotonic() - begin < 30.0
    assert any("Interrupted" in note for note in session.matches.answer.notes)
    session.leave()


@pytest.mark.slow
@pytest.mark.parametrize("size", [(1400, 900), (390, 844)], ids=["wide", "narrow"])
def test_a_target_is_typed_met_and_taken(chromium: Any, tmp_path: Path, size: tuple[int, int]) -> None:
    """Errors in the words of the tab, a recipe with its files, values to the form and back, a target from a file."""
    with viewer() as url:
        tab = Tab(chromium, url, size, accept_downloads=True)
        tab.page.set_default_timeout(120_000)
        tab.button("A paint").click()
        tab.go_to("Match")
        for act, words in (
            (lambda: None, "tick at least one number that may change"),
            (lambda: tab.page.get_by_role("checkbox", name="thickness [µm]").click(), "match needs a target"),
            (lambda: tab.fill("contrast ratio ≥", "98"), "contrast ratio ≥ must be above 0 and below 1, not 98"),
            (lambda: tab.fill("gloss 60° [GU]", "x"), "gloss 60° [GU] must be a number, not 'x'"),
        ):
            act()
            tab.rest(400)
            tab.button("Match").click()
            tab.says(words)
        for label, text in (
            ("contrast ratio ≥", "0,9"), ("gloss 60° [GU]", ""), ("starts", "1"), ("ΔE2000 allowed", "9"),
            ("L*", "91"), ("a*", "-1"), ("b*", "-4"), ("volume solids [%]", "50"),
        ):  # fmt: skip
            tab.fill(label, text)
        tab.rest(400)
        tab.button("Match").click()
        tab.button("Stop").wait_for()
        tab.says("target met")
        tab.page.get_by_role("img", name=re.compile("colour wanted: #")).wait_for()
        assert tab.evaluate("document.documentElement.scrollWidth <= innerWidth")
        target = tomllib.loads(tab.download("Target, TOML", tmp_path).read_text("utf-8"))
        assert (target["contrast_ratio"], target["lab"]) == (0.9, [91, -1, -4])
        for button, begin in (("Page, HTML", "<!DOCTYPE html>"), ("Numbers, CSV", "table,row,column,value")):
            assert tab.download(button, tmp_path).read_text("utf-8").startswith(begin)
        found = tomllib.loads(tab.download("Paint, TOML", tmp_path).read_text("utf-8"))
        length = found["layer"][1]["thickness_um"]
        tab.button("Take these values").click()
        field = "value => document.querySelector('input[aria-label=\"thickness [µm]\"]').value == value"
        tab.waits_for(field, arg=f"{length:g}")
        tab.button("Back to those before").click()
        tab.waits_for(field, arg="60")
        (tmp_path / "lab.csv").write_text("L*;a*;b*\n88,5;1;2\n")
        tab.page.locator(".vrte-header input[type=file]").set_input_files(tmp_path / "lab.csv")
        tab.fill("what the file leaves open", "geometry='8:di', illuminant='D50', observer=10")
        tab.says("points")
        tab.go_to("Match")
        tab.button("From the measurement").click()
        tab.holds("L*", "88.5")
        tab.page.reload()  # a light that is not among those offered stays
        tab.holds("L*", "88.5")
        tab.says("D50")
        assert tab.wrong == []
        tab.context.close()
