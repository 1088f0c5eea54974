"""Ready materials: their files, what they come to, how scene files, sweeps and Python name them."""

import copy
import itertools
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte import SceneError
from vrte.app.form.checks import adopt_with_notes
from vrte.appearance.colours import import_colour_science
from vrte.commands import materials as commands
from vrte.formats.materials import expand_materials, find_material, list_materials
from vrte.formats.particle_sources import make_particles
from vrte.formats.scene_file import find_known_wavelengths, find_named_tables, make_scene_file, read_scene
from vrte.optics.refractive_index import MATERIALS, find_wavelength_range, refractive_index
from vrte.render.sky import weigh_wavelengths
from vrte.render.swatches import compute_card
from vrte.sweep.template import make_scene_at, read_sweep

from .helpers import close_to, run
from .samples import slow_but

MADE = sorted(list_materials())
BEAM = {"brdf": {"mu_i": 0.5, "mu_o": 0.5}}
PINK = """title = "Pink"
[particles.red]
index = "hematite"
radius_um = 0.05
[particles.white]
index = "rutile"
radius_um = 0.1
[layer]
volume_fractions = { red = 0.01, white = 0.03 }
thickness_um = 50
"""


def of(material: Any, wavelength_um: float | None = 0.55, **given: Any) -> dict[str, Any]:
    content: dict[str, Any] = {"layer": [{"material": material, **given}], **BEAM}
    return content if wavelength_um is None else content | {"wavelength_um": wavelength_um}


def make_layer(*what: Any, **given: Any) -> vrte.Layer:
    return make_scene_file(of(*what, **given)).scene.layers[0]


# ---- substances


# n_D or n at the wavelength, from elsewhere than the page
# acrylic, polystyrene, polycarbonate, BK7: common values of n_D; ice: Hobbs, Ice Physics (1974), 1.3091 for the
# ordinary ray at the D line and 1.3105 for the other; calcite: 1.6584 and 1.4864 there, mean permittivity 1.6030
KNOWN = {
    "acrylic": (1.491, 0.003),
    "polystyrene": (1.590, 0.003),
    "polycarbonate": (1.585, 0.008),
    "glass": (1.5168, 0.0002),
    "ice": (1.3096, 0.001),
    "calcite": (1.6030, 0.0005),
}


def test_substances_are_known_over_most_of_the_visible_with_the_index_at_the_d_line() -> None:
    for name in MATERIALS:
        low, high = find_wavelength_range(name)
        assert low <= 0.45 < 0.7 <= high, name
        indices = [refractive_index(name, wavelength) for wavelength in np.linspace(max(low, 0.4), 0.7, 7)]
        assert all(0.03 <= index.n < 3.5 and 0.0 <= index.k < 9.0 for index in indices), name
    for name, (n, within) in KNOWN.items():
        assert refractive_index(name, 0.5893).n == close_to(n, rtol=0.0, atol=within)
    assert refractive_index("air", 10.0).value == 1.0
    assert "typical" in refractive_index("alkyd", 0.55).source
    with pytest.raises(
        SceneError, match=r"^index: alkyd goes from 0\.36 to 0\.83 um; a wavelength of 1 um is outside$"
    ):
        refractive_index("alkyd", 1.0)


# ---- the files


def test_a_file_says_what_it_is_how_far_and_from_where_and_the_page_lists_it() -> None:
    for material in list_materials().values():
        assert all((material.title, material.description.endswith("."), material.approximations, material.sources))
        for words in material.sources:  # a year, or the word that it is typical
            assert words.startswith("typical") or any(f"({year})" in words for year in range(1950, 2026))
    page = (Path(__file__).parents[1] / "docs" / "how_to" / "materials.md").read_text(encoding="utf-8")
    assert all(f"\n| {name} | " in page for name in (*MADE, *MATERIALS))
    assert all(entry.reason in page for entry in MATERIALS.values())


QUICK = [(name, False) for name in MADE if name not in ("chalk", "cumulus cloud", "old snow")]  # these take seconds


@pytest.mark.parametrize("case", slow_but(itertools.product(MADE, (False, True)), *QUICK))
def test_it_is_physical_in_red_light_or_over_the_visible_and_warns_of_nothing(case: tuple[str, bool]) -> None:
    name, everywhere = case
    low, high, _ = find_known_wavelengths(of(name, None))
    for wavelength in (max(low, 0.4), 0.55, min(high, 0.7)) if everywhere else (0.69,):
        file = make_scene_file(of(name, wavelength))
        (layer,) = file.scene.layers
        assert layer.thickness > 1.0
        assert 0.0 < layer.albedo <= 1.0
        assert 0.0 < layer.phase_matrix.asymmetry < 0.95
        assert all(particles.host_index == layer.host_index for particles in file.particles.values())


# ---- in scene files


def test_a_layer_that_names_one_is_as_its_tables_and_the_file_keeps_its_own() -> None:
    dust, own = {"index": 1.5, "radius_um": 0.1}, {"particles": "dust", "thickness": 1.0}
    layers = [{"material": "rutile in alkyd", "thickness": 1.0}, own, {"material": "chalk"}, {"material": "chalk"}]
    given = {"particles": {"dust": dust}, "layer": layers}
    kept, ready = copy.deepcopy(given), list_materials()
    rutile, chalk = (f"{name}: {kind}" for name, kind in (("rutile in alkyd", "rutile"), ("chalk", "calcite")))
    found = expand_materials(given)
    assert found["particles"] == {
        "dust": dust,
        rutile: ready["rutile in alkyd"].particles["rutile"],
        chalk: ready["chalk"].particles["calcite"],
    }
    paint = {"volume_fractions": {rutile: 0.1}, "host_index": "alkyd", "thickness": 1.0}
    powder = ready["chalk"].layer | {"particles": chalk}
    assert found["layer"] == [paint, own, powder, powder]
    assert given == kept


def test_thickness_and_density_can_be_others(tmp_path: Path) -> None:
    whole = make_layer("hematite in acrylic").thickness
    fifth = close_to(whole / 5.0, rtol=1e-4, atol=0.0)  # what the resin absorbs is not much
    assert make_layer("hematite in acrylic", thickness=7.0).thickness == 7.0
    assert make_layer("hematite in acrylic", thickness_um=10.0).thickness == close_to(whole / 4.0, rtol=1e-6, atol=0.0)
    assert make_layer("hematite in acrylic", volume_fraction="1 %", thickness_um=80.0).thickness / 2.0 == fifth
    assert 1.0 < make_layer("chalk", thickness_um=10.0, volume_fraction=0.1).thickness < 10.0
    (tmp_path / "pink.toml").write_text(PINK)  # of which two kinds are scaled together
    (layer,) = expand_materials(of("pink.toml", volume_fraction=0.08), tmp_path)["layer"]
    fractions = {"pink.toml: red": 0.02, "pink.toml: white": 0.06}
    assert layer["volume_fractions"] == close_to(fractions, rtol=1e-6, atol=0.0)
    assert len(make_scene_file(of("pink.toml"), folder=tmp_path).scene.layers) == 1
    assert find_named_tables(of("pink.toml")) == {("layer", 0, "material"): "pink.toml"}


def test_spectra_sweeps_and_the_page_take_it(tmp_path: Path) -> None:
    assert find_known_wavelengths(of("rutile in alkyd", None))[:2] == (0.36, 0.83)
    black = of("titanium black in acrylic", None, volume_fraction=0.05)
    found = vrte.spectrum(black | {"nodes": 4}, [0.45, 0.65])
    assert all(0.005 < brdf.mueller[0, 0, 0, 0, 0] < 0.05 for brdf in found)
    axes = {"layer[1].volume_fraction": [0.01, 0.05], "wavelength_um": [0.45, 0.65]}
    sweep = read_sweep(black | {"wavelength_um": 0.45, "axes": axes}, tmp_path)
    thin, thick = (make_scene_at(sweep, index, make_particles).scene for index in ((0, 1), (1, 1)))
    assert thick.thickness == close_to(5.0 * thin.thickness, rtol=1e-4, atol=0.0)  # what the resin absorbs is not much
    content, notes = adopt_with_notes(of("hematite in acrylic", None))
    assert "wavelength_um is missing" in notes[0]
    assert list(content["particles"]) == ["hematite in acrylic: hematite"]
    assert "material" not in content["layer"][0]
    with pytest.raises(SceneError, match="reads no files of the machine"):
        adopt_with_notes(of("/etc/own.toml"))


HERE = "layer[1].material ="
OWN = {  # a file of one's own that is wrong: what is reported behind its name
    "title = 3\n[particles.a]\n[layer]\n": "title = 3: must be a text",
    "[particles.a]\n": "layer: is missing; it must be a table [layer]",
    "[particles]\na = 1\n[layer]\n": "must be tables headed [particles.NAME]",
    '[particles.a]\nindex = "a.csv"\n[layer]\n': 'particles.a.index = "a.csv": a material names no other files',
    '[particles.a]\n[layer]\nmaterial = "chalk"\n': "a material is not made of another",
    "[particles.a]\nindex = 1.5\nradius_um = 1\n[layer]\nthicknes = 1\n": "layer[1].thicknes = 1: unknown key",
}
WRONG = [
    (of("chalkk"), "did you mean 'chalk'?"),
    (of(3), HERE + " 3: must be a .toml beside the scene file or one of alumina powder, "),
    (of("nowhere.toml"), HERE + ' "nowhere.toml": the file cannot be read: No such file'),
    (of("chalk", thickness_um=1.0), "layer[1]: either thickness (optical) or thickness_um with volume_fr"),
    (of("rutile in alkyd", volume_fraction=1.0), "layer[1].volume_fraction = 1.0: must be above 0 and below 1"),
    (of("rutile in alkyd", 0.35), HERE + ' "rutile in alkyd": particles."rutile in alkyd: rutile".index: rutile goe'),
    (of("rutile in alkyd", 0.85), "alkyd goes from 0.36 to 0.83 um; a wavelength of 0.85 um is outside"),
    (of("chalk") | {"particles": {"chalk: calcite": {}}}, 'calls its particles "chalk: calcite", as a table of'),
    *[(of(f"{number}.toml"), words) for number, words in enumerate(OWN.values())],
]


@pytest.mark.parametrize(("content", "words"), WRONG)
def test_what_is_wrong_is_reported_at_the_layers_place(content: dict[str, Any], words: str, tmp_path: Path) -> None:
    for number, text in enumerate(OWN):
        (tmp_path / f"{number}.toml").write_text(text)
    with pytest.raises(SceneError, match=re.escape(words)) as caught:
        make_scene_file(content, folder=tmp_path)
    assert caught.value.place[:2] == ("layer", 0)


# ---- from Python and the command line


def test_python_has_them_by_name() -> None:
    layer = vrte.material("rutile-in_Alkyd", 0.55, thickness_um=30.0)
    assert layer.host_index == 1.52
    assert layer.thickness == close_to(vrte.material("rutile in alkyd", 0.55).thickness / 2.0, rtol=1e-6, atol=0.0)
    assert list(vrte.materials()) == MADE
    assert find_material("gold") is None
    with pytest.raises(SceneError, match=r'^material = "no such": must be'):
        vrte.material("no such", 0.55)
    with pytest.raises(SceneError, match=r"^volume_fraction must be a number >= 0, not -1"):
        vrte.material("chalk", 0.55, volume_fraction=-1.0)


def test_the_command_lists_them_and_reports_how_one_scatters(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run("materials") == 0
    assert [line.partition("  ")[0] for line in capsys.readouterr().out.splitlines()] == MADE
    monkeypatch.chdir(tmp_path)
    where = ("-o", "rutile.csv", "--scene", "scene.toml")
    assert run("material", "rutile in alkyd", "--range-um", "0.5:0.6:3", *where) == 0
    assert "from: Devore" in capsys.readouterr().out
    rows = np.genfromtxt("rutile.csv", delimiter=",", names=True, skip_header=1)
    layer = vrte.material("rutile in alkyd", 0.55)
    extinction, transport = rows["extinction_per_um"][1], rows["transport_um"][1]
    assert extinction == close_to(layer.thickness / 60.0, rtol=1e-6, atol=0.0)
    assert transport == close_to(
        1.0 / (extinction * (1.0 - layer.albedo * layer.phase_matrix.asymmetry)), rtol=1e-6, atol=0.0
    )
    scene = read_scene("scene.toml").scene
    assert scene.layers[0].thickness == layer.thickness
    Path("scenes").mkdir()  # from where a material of one's own is named
    Path("haze.toml").write_text(PINK.replace("thickness_um = 50", "thickness = 2.0"))
    assert run("material", "haze.toml", "--scene", "scenes/one.toml") == 0
    assert read_scene("scenes/one.toml").scene.layers[0].thickness == 2.0


# ---- colours, and what is published

WHITE = (94.0, 100.0), (-2.0, 2.0), (-3.0, 2.0)
POWDER = (98.0, 100.1), (-3.0, 3.0), (-6.0, 1.0)
LAB = {  # CIE L*, a* and b* from and to, over black
    "titanium black in acrylic": ((0.0, 22.0), (-5.0, 5.0), (-5.0, 15.0)),
    "hematite in acrylic": ((10.0, 45.0), (12.0, 45.0), (8.0, 45.0)),
    "rutile in alkyd": WHITE,
    "silica-coated rutile in alkyd": WHITE,
    "alumina-coated rutile in acrylic": WHITE,
    "gold powder": ((45.0, 80.0), (8.0, 40.0), (25.0, 70.0)),
    "hollow polymer in acrylic": ((75.0, 95.0), (-4.0, 4.0), (-8.0, 4.0)),
    **dict.fromkeys(("alumina powder", "chalk", "fresh snow", "old snow"), POWDER),
}


@pytest.mark.parametrize("name", slow_but(LAB, "titanium black in acrylic"))
def test_the_colour_is_that_of_the_material(name: str) -> None:
    """In the light that the card lies in."""
    card = compute_card(name) if LAB[name] is POWDER else compute_card(name, 5)
    white = weigh_wavelengths(card.wavelengths_um).sum(axis=1)
    found = import_colour_science().XYZ_to_Lab(card.xyz[0], white[:2] / white.sum())
    assert all(low < value < high for value, (low, high) in zip(found, LAB[name], strict=True)), found


@pytest.mark.slow
def test_a_thin_paint_hides_less_over_black_than_over_white() -> None:
    hollow, rutile = compute_card("hollow polymer in acrylic"), compute_card("rutile in alkyd")
    assert (hollow.reflectances[0] < hollow.reflectances[1] - 0.05).all()
    assert (rutile.reflectances[0] > 0.95 * rutile.reflectances[1]).all()


@pytest.mark.slow
def test_the_command_draws_a_card_of_each(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    two = {name: list_materials()[name] for name in ("hematite in acrylic", "titanium black in acrylic")}
    monkeypatch.setattr(commands, "list_materials", lambda: two)
    assert run("materials", "-o", tmp_path / "cards.png") == 0
    assert (tmp_path / "cards.png").stat().st_size > 10_000


def find_snow_albedo(radius_um: float, wavelength_um: float, mu_i: float) -> float:
    """The fraction of a beam that deep snow of one grain size reflects."""
    ice = vrte.spheres("ice", radius_um=radius_um, wavelength_um=wavelength_um)
    return float(vrte.brdf(vrte.Scene([vrte.Layer.of(ice, math.inf)]), mu_i, 1.0, nodes=16).reflectance[0])


def test_snow_at_1310_nm_reflects_what_its_specific_surface_is_measured_by() -> None:
    """Gallet and others, The Cryosphere 3, 167 (2009), abstract: below 60 m2/kg it is between 15 and 50 %, of a laser
    beam. A specific surface S is a radius of 3/(917 kg/m3 S)."""
    assert find_snow_albedo(3e6 / (917.0 * 60.0), 1.31, 1.0) == close_to(0.50, rtol=0.0, atol=0.03)


@pytest.mark.slow
def test_clean_snow_has_the_albedo_that_is_published() -> None:
    """Visible: 0.96 to 0.99 for pure snow after Wiscombe and Warren (1980), as Warren and Wiscombe (1980) sum it up.

    At 1 um 0.45 to 0.75 are measured: Wuttke and others, Ann. Geophys. 24, 7 (2006), abstract.
    """
    assert 0.96 < find_snow_albedo(200.0, 0.55, 0.5) < find_snow_albedo(50.0, 0.55, 0.5) < 1.0
    assert 0.45 < find_snow_albedo(400.0, 1.0, 0.5) < find_snow_albedo(150.0, 1.0, 0.5) < 0.77
