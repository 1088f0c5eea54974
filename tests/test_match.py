"""vrte.match: a recipe is found again, the cheapest is the cheapest, what holds a paint back is named, and every fault
of a target is one sentence."""

import csv
import math
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.appearance.gloss import find_gloss
from vrte.appearance.hiding import Conditions, Drawdown
from vrte.appearance.panel import make_panel
from vrte.fit.recipe import DENSITIES
from vrte.fit.search import PaintReader, bend_curves
from vrte.fit.target import CARDS
from vrte.formats.toml_table import write_toml

from .helpers import close_to, run

AT = [0.43, 0.47, 0.51, 0.55, 0.59, 0.63, 0.67]
QUICK: dict[str, Any] = {"wavelengths_um": AT, "nodes": 6, "starts": 1}
WHITE = {"pigment": "rutile", "volume_fraction": 0.15, "binder": "alkyd", "thickness_um": 60.0}
TINT = {"pigment": {"rutile": "15 %", "hematite": 0.003}, "binder": "alkyd", "thickness_um": 12.0}


def read(paint: dict[str, Any], *, over: float = 0.0) -> tuple[float, float, float]:
    """L*, a*, b* of a paint over a card, by `vrte.appearance`."""
    base = {"kind": "lambertian", "albedo": over}
    colour = vrte.appearance({"paint": {**paint, "substrate": base}}, AT, ["45:0"], nodes=6).colour()
    return colour.L, colour.a, colour.b


@pytest.mark.parametrize("over", ["black", pytest.param("white", marks=pytest.mark.slow)])
def test_a_recipe_is_found_again(over: str) -> None:
    """Two loads by colour and hiding, from others twice and half as high: to 0.1 CIEDE2000."""
    hidden = {"pigment": {"rutile": 0.08, "hematite": 0.006}, "binder": "alkyd", "thickness_um": 12.0}
    starts = 1 + (over == "white")
    contrast = Drawdown(make_panel({"paint": hidden}, AT, nodes=6), Conditions()).find_contrast(1.0)
    lab = read(hidden, over=CARDS[over])
    found = vrte.match(
        {"paint": TINT}, ["rutile", "hematite"], lab, contrast, over=over, tolerance=0.1, **{**QUICK, "starts": starts}
    )
    assert found.why == ""
    assert found.difference <= 0.1 * 1.002
    made = found.content["paint"]
    again = read(made, over=CARDS[over])
    assert again == close_to([found.reached[name][1] for name in "Lab"], rtol=1e-6, atol=1e-4)
    assert found.reached["contrast_ratio"][1] > contrast - 1e-4
    assert found.starts.shape == (starts, 2, 2)
    assert [*made["pigment"].values()] == close_to([0.08, 0.006], rtol=0.05, atol=0.0)


def test_no_other_load_hides_with_less_pigment() -> None:
    """Of loads and thicknesses with a contrast ratio of 0.95: thicknesses by the search of hiding power."""
    found = vrte.match({"paint": WHITE}, {"rutile": [0.02, 0.25], "thickness_um": [5.0, 60.0]}, None, 0.95, **QUICK)
    assert found.why == ""
    assert found.reached["contrast_ratio"] == (0.95, close_to(0.95, rtol=2e-4, atol=0.0))
    assert found.cost == close_to(found.values.prod(), rtol=1e-9, atol=0.0)  # um of pigment are cm3/m2
    for load in (0.9 * found.values[0], 1.1 * found.values[0], 0.05, 0.1, 0.2):
        panel = make_panel({"paint": {**WHITE, "volume_fraction": float(load)}}, AT, nodes=6)
        times, _ = Drawdown(panel, Conditions(target=0.95)).find_hiding_times()
        assert times is not None
        if 5.0 <= 60.0 * times <= 60.0:
            assert load * 60.0 * times > 0.998 * found.cost, load
    changes = dict(zip(("contrast_ratio", "CIEDE2000", "cost"), found.sensitivities.T, strict=True))
    assert changes["cost"] == close_to([0.01 * found.cost] * 2, rtol=1e-3, atol=0.0)
    assert (changes["contrast_ratio"] > 0.0).all()


def test_prices_weights_and_the_wet_film() -> None:
    """One number and one limit leave no choice; all else is arithmetic."""
    density = {"rutile": 4.0, "alkyd": 1.0, "volatile": 0.8}
    asked = {"cost": {"rutile": 3.0, "alkyd": 2.0}, "densities": density, "volume_solids": 0.4}
    found = vrte.match({"paint": WHITE}, ["thickness_um"], contrast_ratio=0.95, **asked, **QUICK)
    length = found.thickness_um
    assert found.cost == close_to(1e-3 * length * (0.15 * 4.0 * 3.0 + 0.85 * 2.0), rtol=1e-12, atol=0.0)
    assert found.wet_thickness_um == close_to(length / 0.4, rtol=1e-12, atol=0.0)
    rows = {one.name: one[1:] for one in found.recipe}
    dry, wet = 0.15 * 4.0 + 0.85, 0.4 * (0.15 * 4.0 + 0.85) + 0.6 * 0.8
    assert rows["rutile"] == close_to([4.0, 0.15, 0.6 / dry, 0.06, 0.24 / wet], rtol=1e-12, atol=0.0)
    assert rows["volatile"] == close_to([0.8, 0.0, 0.0, 0.6, 0.48 / wet], rtol=1e-12, atol=0.0)
    for column in (1, 2, 3, 4):
        assert sum(one[column] for one in rows.values()) == close_to(1.0, rtol=1e-12, atol=0.0)
    panel = make_panel({"paint": {**WHITE, "thickness_um": length}}, AT, nodes=6)
    assert Drawdown(panel, Conditions()).find_contrast(1.0) == close_to(0.95, rtol=1e-4, atol=0.0)
    text = str(found)
    assert re.search(r"rutile +15\.000 +41\.379 +6\.000 +22\.64", text)
    assert ">rutile</td><td>15.000</td>" in found._repr_html_()
    assert "money a m²" in repr(found)


def test_what_holds_a_paint_back_is_named(tmp_path: Path) -> None:
    """A bound, or a colour that no free number moves."""
    thin = vrte.match({"paint": WHITE}, {"thickness_um": [5.0, 20.0]}, contrast_ratio=0.99, **QUICK)
    assert thin.why == "contrast_ratio is too low; paint.thickness_um is held at its upper bound 20"
    assert thin.values == close_to([20.0], rtol=1e-6, atol=0.0)
    blue = vrte.match({"paint": WHITE}, {"rutile": [0.05, 0.2]}, lab=(80.0, 0.0, -40.0), over="white", **QUICK)
    assert re.fullmatch(r"the colour is \d+ CIEDE2000 off: b\* is \d+ too yellow; .*", blue.why)
    for load in (0.06, 0.1, 0.19):  # any other is farther off
        fixed = {"rutile": [0.999 * load, 1.001 * load]}
        there = vrte.match({"paint": WHITE}, fixed, lab=(80.0, 0.0, -40.0), over="white", **QUICK)
        assert blue.difference < there.difference + 1e-3
    blue.save(tmp_path / "blue.html")
    page = (tmp_path / "blue.html").read_text("utf-8")
    assert "wanted and found side by side" in page
    assert blue.why in page
    blue.save(tmp_path / "blue.csv")
    with open(tmp_path / "blue.csv", encoding="utf-8", newline="") as file:
        rows = {(row["table"], row["row"], row["column"]): row["value"] for row in csv.DictReader(file)}
    assert rows["target", "b", "wanted"] == "-40"
    assert float(rows["target", "b", "found"]) == close_to(blue.reached["b"][1], rtol=1e-4, atol=0.0)
    assert float(rows["recipe [%]", "rutile", "volume"]) == close_to(100.0 * blue.values[0], rtol=1e-3, atol=0.0)
    with pytest.raises(vrte.SceneError, match=r"must end in \.html or \.csv"):
        blue.save(tmp_path / "blue.txt")
    thin.write_scene(tmp_path / "thin.toml")
    assert vrte.appearance(tmp_path / "thin.toml", AT, ["45:0"], nodes=6).panel.length_um == close_to(
        20.0, rtol=1e-6, atol=0.0
    )  # type: ignore[union-attr]
    assert thin.paint(wavelengths_um=AT, nodes=4).title == "Paint"


def test_roughness_meets_a_gloss() -> None:
    """By the lobe of the surface, which is all that changes; nothing costs, so the middle is wanted."""
    satin = {**WHITE, "surface": {"roughness": 0.05, "distribution": "ggx"}}
    found = vrte.match({"paint": satin}, ["roughness"], gloss_60=20.0, **QUICK)
    assert found.why == ""
    gloss = found.reached["gloss_60"][1]
    assert gloss == close_to(20.0, rtol=0.0, atol=0.05)
    panel = make_panel(
        {"paint": {**satin, "surface": {"roughness": found.values[0], "distribution": "ggx"}}}, AT, nodes=6
    )
    assert find_gloss(panel) == close_to(gloss, rtol=1e-9, atol=0.0)


def test_a_layer_of_any_scene_is_a_film_and_a_semi_infinite_one_costs_by_the_litre() -> None:
    grain = {"particles": {"grain": {"index": 2.5, "radius_um": 0.1}}}
    film = {"host_index": 1.5, "particles": "grain", "volume_fraction": 0.05, "thickness_um": math.inf}
    scene = {**grain, "layer": [{"interface": {"above": 1.0, "below": 1.5}}, film]}
    name = "particles.grain.radius_um"
    found = vrte.match(vrte.SceneFamily(scene, []), {name: [0.05, 0.15]}, lab=(99.0, 0.0, 0.0), tolerance=5.0, **QUICK)
    assert found.cost_unit == "cm³ of pigment a litre of dry film"
    assert found.cost == close_to(50.0, rtol=1e-12, atol=0.0)
    assert [one.name for one in found.recipe] == ["grain", "binder"]
    assert found.notes == ("Weights need densities={'grain': ..., 'binder': ...} [kg/l].",)
    assert found.content["particles"]["grain"]["radius_um"] == found.values[0]
    assert all(0.5 < one < 20.0 for one in DENSITIES.values())


def test_ctrl_c_keeps_the_best_so_far(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before any paint was looked at there is none to keep."""

    def interrupt(done: int, total: int) -> None:
        if done > 0:
            raise KeyboardInterrupt

    asked = {"contrast_ratio": 0.95, **QUICK, "starts": 2}
    found = vrte.match({"paint": WHITE}, {"thickness_um": [10.0, 60.0]}, **asked, progress=interrupt)
    assert found.notes == ("Interrupted: the best so far, which need not be the best there is.",)
    assert found.starts.shape == (1, 2, 1)
    assert 10.0 < found.thickness_um < 60.0

    def refuse(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(PaintReader, "fix_nodes", refuse)
    with pytest.raises(KeyboardInterrupt):
        vrte.match({"paint": WHITE}, ["thickness_um"], **asked)


def test_curvature_is_learned_from_slopes() -> None:
    """A quadratic's in as many steps as there are numbers."""
    curve = np.array([[3.0, 1.0], [1.0, -2.0]])
    found = np.zeros((1, 2, 2))
    for way in np.array([[1.0, 0.0], [0.3, 0.8]]):
        bend_curves(found, way, (curve @ way)[None])
    assert found[0] == close_to(curve, rtol=1e-12, atol=1e-12)


GREY = {"pigment": {"rutile": 0.15, "carbon": 0.0}, "binder": [1.5, 0.0], "thickness_um": 30.0,
        "particles": {"carbon": {"diameter_um": 0.05}}}  # fmt: skip
REFUSED: list[tuple[dict[str, Any], str]] = [
    ({"free": ["rutil"]}, "free: the scene has no rutil; short names here: rutile, thickness_um"),
    ({"free": {"rutile": [0.3, 0.1]}}, "free: paint.volume_fraction needs low below high, not 0.3 and 0.1"),
    ({"free": {"rutile": 3}}, "free: paint.volume_fraction takes its bounds, [low, high], or a table of start, low, "),
    ({"free": {"rutile": {"lo": 3}}}, "free: paint.volume_fraction takes its bounds, [low, high], or a table of start"),
    ({"free": []}, "free must name one or more numbers of the paint"),
    ({"free": ["rutile", "rutile"]}, "free: names paint.volume_fraction comes twice"),
    ({"free": ["roughness"]}, "free: paint.surface.roughness changes facets, and the paint has none"),
    ({"free": {"thickness_um": [1.0, math.inf]}}, "free: paint.thickness_um needs finite bounds"),
    ({"paint": {"paint": GREY}, "free": ["carbon"]}, "free: paint.pigment.carbon is 0: say its bounds"),
    ({"lab": None}, "match needs a target: lab, contrast_ratio, gloss_20, gloss_60 or gloss_85"),
    ({"lab": (95.0, 0.0)}, "lab must be L*, a*, b*, three finite numbers, not (95.0, 0.0)"),
    ({"lab": (195.0, 0.0, 0.0)}, "lab must be with L* from 0 to 120, not 195"),
    ({"contrast_ratio": 98.0}, "contrast_ratio must be above 0 and below 1, not 98"),
    ({"gloss_60": -1.0}, "gloss_60 must be gloss units, from 0.001 to 2000, not -1"),
    ({"tolerance": 0.0}, "tolerance must be CIEDE2000 from 0.001 to 100, not 0"),
    ({"over": "base"}, "over is 'base', and the paint has none: over='black', 'white' or an albedo says"),
    ({"over": "brown"}, "over must be 'base', 'black', 'white' or an albedo, not 'brown'"),
    ({"cost": {"zinc": 2.0}}, "cost names 'zinc', and the film is made of rutile, alkyd"),
    ({"cost": {"rutile": -2.0}}, "cost of rutile must be a price of a kg, at least 0, not -2"),
    ({"paint": {"paint": GREY}, "free": ["rutile"], "cost": {"binder": 2.0}},
     "cost of binder needs its density: densities={'binder': ...}"),
    ({"densities": {"gold": 2.0}}, "densities names 'gold', and the film is made of rutile, alkyd, volatile"),
    ({"densities": {"rutile": 0.0}}, "densities of rutile must be above 0 kg/l, not 0"),
    ({"volume_solids": 40.0}, "volume_solids must be 0.001 to 1, not 40"),
    ({"paint": "white glos"}, "paint must be a scene file (.toml), its content or a ready paint, black gloss, "),
    ({"paint": {"layer": [{"phase": "isotropic", "albedo": 0.5, "thickness": 1.0}]}, "free": ["layer[1].albedo"]},
     "layer[1] must say volume fractions and thickness_um, of which a recipe is made"),
    ({"wavelengths_um": [0.5, 0.6]}, "wavelengths_um must cover the visible"),
]  # fmt: skip


@pytest.mark.parametrize(("changed", "words"), REFUSED)
def test_what_is_wrong_with_a_target_is_one_sentence(changed: dict[str, Any], words: str) -> None:
    asked = {"paint": {"paint": WHITE}, "free": ["rutile"], "lab": (95.0, 0.0, 0.0), **QUICK} | changed
    with pytest.raises(vrte.SceneError, match=re.escape(words)):
        vrte.match(**asked)


TARGET = f"""contrast_ratio = 0.95
over = "white"
starts = 1
wavelengths_um = {AT}
free = {{ thickness_um = [5.0, 80.0] }}
"""
FILE = f"""wavelength_um = {AT}
nodes = 4
[paint]
pigment = "rutile"
volume_fraction = 0.15
binder = "alkyd"
thickness_um = 60.0
"""


def test_the_command_reads_a_target_and_writes_recipe_and_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "white.toml").write_text(FILE)
    (tmp_path / "target.toml").write_text(TARGET)
    (tmp_path / "named.toml").write_text('paint = "white.toml"\n' + TARGET)
    assert run("paint", "white.toml", "--match", "target.toml", "--toml", "found.toml", "-o", "found.html") == 0
    printed = capsys.readouterr().out
    assert "target met\n" in printed
    assert re.search(r"contrast ratio: 0\.95\d\d", printed)
    assert (tmp_path / "found.html").stat().st_size > 10_000
    assert f"dry film {make_panel(tmp_path / 'found.toml').length_um:.4g} µm;" in printed
    for line, words in (
        ("paint", "PAINT.toml is missing"),
        ("paint white.toml --toml a.toml", "--toml goes with --match"),
        ("paint white.toml --match named.toml", "paint is named twice"),
        ("paint --match target.toml", "paint is missing: a scene file or a ready paint"),
    ):
        assert run(*line.split()) == 2
        assert words in capsys.readouterr().err
    whole = {**tomllib.loads(TARGET), "paint": tomllib.loads(FILE)}  # a target that brings its paint
    (tmp_path / "whole.toml").write_text(write_toml(whole))
    assert run("paint", "--match", "whole.toml", "--toml", "again.toml") == 0
    assert (tmp_path / "again.toml").read_text() == (tmp_path / "found.toml").read_text()
    (tmp_path / "target.toml").write_text("glos = 3\n" + TARGET)
    assert run("paint", "white.toml", "--match", "target.toml") == 2
    assert "glos = 3: unknown key" in capsys.readouterr().err
