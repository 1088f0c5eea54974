"""Scene files: what is right is read as meant, what is wrong is named by its dotted key."""

import math
import pickle
import time
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.basics.errors import Place
from vrte.formats.particle_sources import SOURCES
from vrte.formats.scene_file import SceneFile, make_scene_file, read_scene
from vrte.formats.toml_table import DEEPEST, parse_toml, show_place
from vrte.optics.phase_matrix import count_henyey_greenstein_terms

from .helpers import assert_close

EXAMPLE = Path(__file__).parents[1] / "examples" / "gold_powder.toml"
SCENE = """
wavelength_um = 0.64
nodes = 12
[particles.gold]
index = "gold"
radius_um = 0.1
[[layer]]
particles = "gold"
thickness = 2.0
[base]
kind = "lambertian"
albedo = 0.3
[brdf]
mu_i = [0.6, 1.0]
mu_o = { start = 0.5, stop = 1.0, count = 3 }
"""
PHASE = SCENE.replace('particles = "gold"', "phase = PHASE\nalbedo = 0.9")
GOLD = 'particles = "gold"'
FIELD = SCENE.split("[brdf]")[0] + "[field]\nmu0 = 0.5\n"
Reader = Callable[..., SceneFile]


@pytest.fixture
def read(tmp_path: Path) -> Reader:
    """Reads a text as a scene file, after exchanging parts of it."""

    def reader(text: str, *exchanged: tuple[str, str], kind: str | None = None) -> SceneFile:
        for old, new in exchanged:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / "scene.toml"
        path.write_text(text)
        return read_scene(path, kind)

    return reader


def test_the_example_is_what_it_says() -> None:
    file = read_scene(EXAMPLE)
    assert (file.kind, file.options) == ("brdf", {"nodes": 40})
    assert file.request["mu_i"] == [0.6, 1.0]
    assert_close(file.request["mu_o"], np.linspace(0.05, 1.0, 20), rtol=1e-7, atol=0.0)
    assert file.request["phi"][-1] == 360.0
    assert (file.scene.base, file.scene.thickness) == (None, 100.0)
    by_hand = vrte.spheres("gold", radius_um=0.6, wavelength_um=0.64)
    np.testing.assert_array_equal(file.scene.layers[0].phase_matrix.coefficients, by_hand.phase_matrix.coefficients)
    assert file.scene.layers[0].albedo == by_hand.albedo


def test_defaults(read: Reader) -> None:
    file = read(SCENE, ("nodes = 12\n", ""), ('[base]\nkind = "lambertian"\nalbedo = 0.3\n', ""))
    assert (file.options, file.scene.base) == ({}, None)
    assert set(file.request) == {"mu_i", "mu_o"}


def test_how_to_solve(read: Reader) -> None:
    file = read(SCENE, ("nodes = 12\n", 'accuracy = 1e-4\ntruncation = "delta-m"\n'))
    assert file.options == {"accuracy": 1e-4, "truncation": "delta-m"}
    file = read(
        SCENE, ("nodes = 12\n", 'method = "successive-orders"\nsettings = { orders = 3 }\nilluminate = "bottom"\n')
    )
    assert file.options == {"method": "successive-orders", "settings": {"orders": 3}, "illuminate": "bottom"}


def test_a_field_is_asked_for_by_its_own_table(read: Reader) -> None:
    wanted = "stokes = [3, 0, 0, 1]\nmu = -0.5\nphi_deg = [0, 90]\ntau = { start = 0, stop = 2, count = 3 }\n"
    file = read(FIELD + wanted)
    assert file.kind == "field"
    assert file.request == {
        "mu0": 0.5,
        "stokes": [3.0, 0.0, 0.0, 1.0],
        "mu": [-0.5],
        "phi": [0.0, 90.0],
        "tau": [0.0, 1.0, 2.0],
    }


def test_each_command_takes_its_own_table(read: Reader) -> None:
    both = SCENE + "[field]\nmu0 = 0.5\n"
    assert read(both, kind="brdf").kind == "brdf"
    assert read(both, kind="field").request == {"mu0": 0.5}
    with pytest.raises(vrte.SceneError, match="exactly one of the tables"):
        read(both)
    with pytest.raises(vrte.SceneError, match=r"field is missing.*there is \[brdf\]"):
        read(SCENE, kind="field")


def of_gold(material: Any = "gold", **how: Any) -> vrte.Particles:
    """What SCENE holds, but for what is said."""
    size = {} if "size" in how else {"radius_um": 0.1}
    return vrte.spheres(material, **{"wavelength_um": 0.64} | size | how)


def of_a_mixture() -> vrte.Layer:
    kinds = vrte.mixture([(of_gold(), 0.7), (of_gold(1.5, radius_um=0.2), 0.3)])
    return vrte.Layer.of(kinds, thickness_um=5.0, volume_fraction=0.05)


LOGNORMAL = "size = { lognormal = { median_um = 0.1, sigma = 1.2 } }"
GAMMA = "size = { gamma = { r_eff_um = 0.1, v_eff = 0.05 } }"
GLASS = "[particles.glass]\nindex = [1.5, 0]\nradius_um = 0.2\n"


@pytest.mark.parametrize(
    ("exchanged", "expected"),
    [
        ([("radius_um = 0.1", LOGNORMAL)], lambda: of_gold(size=vrte.Lognormal(median_um=0.1, sigma=1.2))),
        ([("radius_um = 0.1", GAMMA)], lambda: of_gold(size=vrte.Gamma(r_eff_um=0.1, v_eff=0.05))),
        ([('index = "gold"', 'index = "main/Au/Johnson"')], of_gold),
        ([('index = "gold"', "index = [0.2, 3.5]")], lambda: of_gold(0.2 + 3.5j)),
        ([('index = "gold"', "index = 1.5")], lambda: of_gold(1.5)),
        ([("nodes = 12", "host_index = 1.33")], lambda: of_gold(host_index=1.33)),
        (
            [
                ("[base]", f"{GLASS}[base]"),
                ('particles = "gold"', "particles = { gold = 0.7, glass = 0.3 }"),
                ("thickness = 2.0", "thickness_um = 5.0\nvolume_fraction = 0.05"),
            ],
            of_a_mixture,
        ),
    ],
)
def test_a_layer_is_the_one_made_by_hand(
    read: Reader, exchanged: list[tuple[str, str]], expected: Callable[[], vrte.Particles | vrte.Layer]
) -> None:
    found, made = read(SCENE, *exchanged).scene.layers[0], expected()
    layer = made if isinstance(made, vrte.Layer) else vrte.Layer.of(made, thickness=2.0)
    assert (found.albedo, found.thickness) == (layer.albedo, layer.thickness)


def same(text: str, other: str) -> None:
    """Two scene files that say the same."""
    one, two = (make_scene_file(tomllib.loads(given)) for given in (text, other))
    assert one.request.keys() == two.request.keys()
    for name, values in one.request.items():
        assert_close(values, two.request[name], rtol=1e-14, atol=0.0)
    for layer, twin in zip(one.scene.layers, two.scene.layers, strict=True):
        assert_close([layer.thickness, layer.albedo], [twin.thickness, twin.albedo], rtol=1e-14, atol=0.0)
        assert_close(layer.phase_matrix.coefficients, twin.phase_matrix.coefficients, rtol=0.0, atol=1e-13)
    assert one.scene.base == two.scene.base


@pytest.mark.parametrize(
    ("ours", "other"),
    [
        ("radius_um = 0.1", "diameter_um = 0.2"),
        ("mu_i = [0.6, 1.0]", f"angle_i_deg = [{math.degrees(math.acos(0.6))!r}, 0]"),
        ("mu_o = { start = 0.5, stop = 1.0, count = 3 }", f"angle_o_deg = [60, {math.degrees(math.acos(0.75))!r}, 0]"),
        ("albedo = 0.3", 'albedo = "30 %"'),
        ("thickness = 2.0", 'thickness_um = 5\nvolume_fraction = "2.5%"'),
    ],
)
def test_diameters_degrees_and_per_cent(ours: str, other: str) -> None:
    text = SCENE
    if "volume_fraction" in other:
        text = text.replace(ours, "thickness_um = 5.0\nvolume_fraction = 0.025")
        ours = "thickness_um = 5.0\nvolume_fraction = 0.025"
    assert ours in text
    same(text, text.replace(ours, other))
    field = FIELD.replace("mu0 = 0.5", "angle0_deg = 60")
    same(FIELD, field)


def test_size_distributions_of_diameters() -> None:
    for ours, other in (
        ("lognormal = { median_um = 0.1, sigma = 1.2 }", "lognormal = { median_diameter_um = 0.2, sigma = 1.2 }"),
        ("gamma = { r_eff_um = 0.1, v_eff = 0.05 }", "gamma = { d_eff_um = 0.2, v_eff = 0.05 }"),
    ):
        same(*(SCENE.replace("radius_um = 0.1", f"size = {{ {size} }}") for size in (ours, other)))


def test_mixtures_by_volume() -> None:
    text = SCENE + GLASS
    by_volume = text.replace('particles = "gold"', 'volume_fractions = { gold = "1 %", glass = 0.04 }')
    by_volume = by_volume.replace("thickness = 2.0", "thickness_um = 5.0")
    # of volumes 1 : 4, where a sphere of glass has 8 times the volume of one of gold: 2 : 1 by number
    by_number = text.replace('particles = "gold"', "particles = { gold = 2, glass = 1 }")
    by_number = by_number.replace("thickness = 2.0", "thickness_um = 5.0\nvolume_fraction = 0.05")
    same(by_volume, by_number)
    optical = by_volume.replace("thickness_um = 5.0", "thickness = 3.0")
    assert make_scene_file(tomllib.loads(optical)).scene.thickness == 3.0  # their ratios alone


@pytest.mark.parametrize(
    ("phase", "expected"),
    [
        ('"isotropic"', vrte.isotropic()),
        ('"rayleigh"', vrte.rayleigh()),
        ("{ rayleigh = 0.03 }", vrte.rayleigh(0.03)),
        ("{ henyey_greenstein = 0.5, terms = 60 }", vrte.henyey_greenstein(0.5, 60)),
    ],
)
def test_phase_matrices_without_particles(read: Reader, phase: str, expected: vrte.PhaseMatrix) -> None:
    file = read(PHASE, ("PHASE", phase), ("wavelength_um = 0.64\n", ""), ("thickness = 2.0", "thickness = inf"))
    layer = file.scene.layers[0]
    np.testing.assert_array_equal(layer.phase_matrix.coefficients, expected.coefficients)
    assert (layer.albedo, layer.thickness) == (0.9, math.inf)


@pytest.mark.parametrize("g", [0.0, -0.3, 0.9, 0.98])
def test_henyey_greenstein_gets_all_the_terms_that_count(read: Reader, g: float) -> None:
    matrix = read(PHASE, ("PHASE", f"{{ henyey_greenstein = {g} }}")).scene.layers[0].phase_matrix
    angle = np.array([0.0, 30.0, 180.0])
    exact = (1 - g * g) / (1 + g * g - 2 * g * np.cos(np.radians(angle))) ** 1.5
    found = matrix.scattering_matrix(angle)[:, 0, 0]
    assert_close(found, exact, rtol=1e-9, atol=2e-12)
    assert count_henyey_greenstein_terms(g) == matrix.terms


def test_a_table_of_coefficients_lies_beside_the_scene(read: Reader, tmp_path: Path) -> None:
    rows = "l,a1,a2,a3,a4,b1,b2\n# Rayleigh\n0,1,0,0,0,0,0\n1,0,0,0,1.5,0,0\n2,0.5,3,0,0,1.224744871391589,0\n"
    (tmp_path / "rayleigh.csv").write_text(rows)
    matrix = read(PHASE, ("PHASE", '"rayleigh.csv"')).scene.layers[0].phase_matrix
    assert_close(matrix.coefficients, vrte.rayleigh().coefficients, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize(
    ("rows", "complaint"),
    [
        ("l,a1,a2\n0,1,0\n", "the first line must be l,a1,a2,a3,a4,b1,b2"),
        ("l,a1,a2,a3,a4,b1,b2\n", "at least 1 row"),
        ("l,a1,a2,a3,a4,b1,b2\n0,1,0,0,x,0,0\n", "line 2: a4 must be a number, not 'x'"),
        ("l,a1,a2,a3,a4,b1,b2\n0,1,0,0,0,0\n", "line 2: 7 values are needed"),
        ("l,a1,a2,a3,a4,b1,b2\n1,1,0,0,0,0,0\n", "line 2: l must count 0, 1, 2, ...: 0 is next, not 1"),
        ("l,a1,a2,a3,a4,b1,b2\n0,2,0,0,0,0,0\n", "a1"),
        ("", "the first line must be"),
    ],
)
def test_broken_tables_of_coefficients(read: Reader, tmp_path: Path, rows: str, complaint: str) -> None:
    (tmp_path / "broken.csv").write_text(rows)
    with pytest.raises(vrte.SceneError, match=rf'^layer\[1\]\.phase = "broken.csv": .*{complaint}'):
        read(PHASE, ("PHASE", '"broken.csv"'))


def test_a_table_that_was_cut_short_is_taken_where_the_file_says_so(read: Reader, tmp_path: Path) -> None:
    (tmp_path / "cut.csv").write_text("l,a1,a2,a3,a4,b1,b2\n0,1,0,0,0,0,0\n1,1.01,0,0,0,0,0\n")  # F11 is -0.01 at 180
    with pytest.raises(vrte.SceneError, match=r'^layer\[1\]\.phase = "cut.csv": .*tolerance=0\.0028 takes it'):
        read(PHASE, ("PHASE", '"cut.csv"'))
    with pytest.warns(vrte.NegativeScatteringWarning, match="180 degrees"):
        file = read(PHASE, ("PHASE", '"cut.csv"\ntolerance = 0.003'))
    assert file.scene.layers[0].phase_matrix.tolerance == 0.003
    with pytest.raises(vrte.SceneError, match=r"layer\[1\]\.tolerance = 0\.003: goes with a phase from a \.csv only"):
        read(PHASE, ("PHASE", '"rayleigh"\ntolerance = 0.003'))


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        # a key nobody knows, with the one that was meant
        ("nodes", "node", "node = 12: unknown key; did you mean 'nodes'? Allowed: wavelength_um, "),
        ("thickness", "thicknes", "layer[1].thicknes = 2.0: unknown key; did you mean 'thickness'?"),
        ("radius_um", "diameter", "particles.gold.diameter = 0.1: unknown key; did you mean"),
        ("albedo = 0.3", "albdo = 0.3", "base.albdo = 0.3: unknown key; did you mean 'albedo'?"),
        ("count", "cout", "brdf.mu_o.cout = 3: unknown key; did you mean 'count'?"),
        ("[brdf]", "[brfd]", "unknown key; did you mean 'brdf'?"),
        # a value of the wrong kind
        ("12", "true", "nodes = true: must be a whole number from 1 to "),
        ("12", "12.0", "nodes = 12.0: must be a whole number from 1 to "),
        ("12", "0", "nodes = 0: must be a whole number from 1 to "),
        ("nodes = 12", "accuracy = 0.2", "accuracy = 0.2: must be a number between 1e-15 and 0.1"),
        ("nodes = 12", "accuracy = nan", "accuracy = nan: must be a number between 1e-15 and 0.1"),
        ("nodes = 12", 'method = "two-streams"', 'method = "two-streams": must be '),
        ("nodes = 12", "settings = 3", "settings = 3: must be a table of the method's settings by name"),
        ("nodes = 12", 'truncation = "delta"', 'truncation = "delta": must be "auto" or "none" or "delta-m" or '),
        ("0.64", '"0.64"', 'wavelength_um = "0.64": must be the wavelength in micrometres'),
        ("2.0", "nan", "layer[1].thickness = nan: must be a number >= 0"),
        ("2.0", "-2.0", "layer[1].thickness must be an optical thickness >= 0"),
        ('"gold"\nradius', "[1, 2, 3]\nradius", "particles.gold.index = [1, 2, 3]: must be the name of a material"),
        ('"gold"\nradius', '"glod"\nradius', "particles.gold.index"),
        ("0.1", "-0.1", "particles.gold.radius_um"),
        ("[[layer]]", "[layer]", "layer = {"),
        ("[0.6, 1.0]", "[]", "brdf.mu_i = []: must be a number, a list of numbers or { start, stop, count }"),
        ("[0.6, 1.0]", "[0.6, nan]", "brdf.mu_i = [0.6, nan]: must be a number, a list"),
        ("[0.6, 1.0]", "[0.6, [1.0]]", "brdf.mu_i = [0.6, [1.0]]: must be a number, a list"),
        ("count = 3", "count = 0", "brdf.mu_o.count = 0: must be a whole number from 1"),
        ("count = 3", "count = 1", "brdf.mu_o.count = 1: one value needs start = stop"),
        ("start = 0.5, ", "", "brdf.mu_o.start: is missing"),
        ("mu_i = [0.6, 1.0]", "mu_i = 1\ntransmission = 1", "brdf.transmission = 1: must be true or false"),
        # something missing or too much
        ("wavelength_um = 0.64\n", "", "wavelength_um: is missing; it must be the wavelength in micrometres"),
        ("mu_i = [0.6, 1.0]\n", "", "brdf.mu_i: is missing"),
        ("radius_um = 0.1\n", "", "particles.gold: exactly one of radius_um, diameter_um and size is needed"),
        ("thickness = 2.0", "thickness_um = 2.0", "layer[1]: either thickness (optical) or thickness_um with"),
        ("thickness = 2.0", "thickness = 1\nalbedo = 1", "layer[1].albedo = 1: goes with phase only"),
        ('kind = "lambertian"', 'kind = "black"', 'base.albedo = 0.3: goes with kind = "lambertian" or "hapke" only'),
        ('kind = "lambertian"', 'kind = "labmertian"', 'base.kind = "labmertian": must be'),
        ("albedo = 0.3", "", "base.albedo: is missing; it must be a number between 0 and 1"),
        ("albedo = 0.3", "albedo = 1.3", "base.albedo must be between 0 and 1, not 1.3"),
        ('= "gold"\nthick', '= "gild"\nthick', 'layer[1].particles = "gild": no table [particles.gild]; did you mean'),
        ('= "gold"\nthick', "= { gold = 1, x = 2 }\nthick", "no table [particles.x]"),
        ('= "gold"\nthick', "= { gold = -1 }\nthick", "layer[1].particles.gold = -1: must be a number fraction >= 0"),
        ('= "gold"\nthick', "= { gold = 0 }\nthick", "layer[1].particles = { gold = 0 }: at least one number fraction"),
        ("[brdf]", "[field]\nmu00 = 1\n[brdf]", "field.mu00 = 1: unknown key; did you mean 'mu0'?"),
        ("radius_um = 0.1", "size = { normal = 1 }", "particles.gold.size.normal = 1: unknown key; did you mean"),
        (
            "radius_um = 0.1",
            "size = { lognormal = { median_um = 0.1, sigma = 0.5 } }",
            "particles.gold.size.lognormal.sigma must be",
        ),
        ("0.64", "640.0", "particles.gold"),
        # diameters, degrees, per cent and fractions of the volume
        ("radius_um = 0.1", "diameter_um = -1", "particles.gold.diameter_um: half of it, radius_um must be a length"),
        ("radius_um = 0.1", "diameter_um = 1\nradius_um = 1", "exactly one of radius_um, diameter_um and size"),
        (
            "radius_um = 0.1",
            "size = { gamma = { d_eff_um = -1, v_eff = 0.1 } }",
            "particles.gold.size.gamma.d_eff_um: half of it, r_eff_um must be a length",
        ),
        (
            "radius_um = 0.1",
            "size = { gamma = { d_eff_um = 1, r_eff_um = 1, v_eff = 0.1 } }",
            "exactly one of r_eff_um and d_eff_um",
        ),
        ("mu_i = [0.6, 1.0]", "angle_i_deg = [10, 90]", "brdf.angle_i_deg = [10, 90]: must be degrees from the normal"),
        ("mu_i = [0.6, 1.0]", "mu_i = 1\nangle_i_deg = 3", "brdf: exactly one of mu_i and angle_i_deg is needed"),
        ("albedo = 0.3", 'albedo = "30"', 'base.albedo = "30": must be a number between 0 and 1, or per cent'),
        ("albedo = 0.3", 'albedo = "130 %"', "base.albedo must be between 0 and 1, not 1.3"),
        (GOLD, "volume_fractions = { gold = 1.5 }", "volume_fractions.gold = 1.5: must be from 0"),
        (GOLD, "volume_fractions = { lead = 0.5 }", "no table [particles.lead]"),
        (GOLD, "volume_fractions = 0.5", "volume_fractions = 0.5: must be a table"),
        (GOLD, 'volume_fractions = { gold = "0 %" }', "at least one fraction must be above 0"),
        (
            GOLD,
            "volume_fractions = { gold = 0.1 }\nvolume_fraction = 0.1",
            "volume_fraction = 0.1: is the sum of volume_fractions",
        ),
        (
            f"{GOLD}\nthickness = 2.0",
            "volume_fractions = { gold = 0.1 }",
            "either thickness (optical) or thickness_um is needed",
        ),
        # phase matrices without particles
        (GOLD, 'phase = "isotropc"\nalbedo = 1', 'layer[1].phase = "isotropc": must be'),
        (GOLD, 'phase = "absent.csv"\nalbedo = 1', 'layer[1].phase = "absent.csv": the file cannot be read'),
        (GOLD, "phase = { rayleigh = 2 }\nalbedo = 1", "layer[1].phase.rayleigh: depolarization must be"),
        (GOLD, "phase = { henyey_greenstein = 1.0 }\nalbedo = 1", "layer[1].phase.henyey_greenstein: "),
        (
            GOLD,
            "phase = { henyey_greenstein = 0.9, terms = 3 }\nalbedo = 1",
            "layer[1].phase.henyey_greenstein: 3 terms",
        ),
        (
            GOLD,
            "phase = { rayleigh = 0, terms = 3 }\nalbedo = 1",
            "layer[1].phase = { rayleigh = 0, terms = 3 }: must be",
        ),
        (GOLD, "phase = 3\nalbedo = 1", "layer[1].phase = 3: must be"),
        (GOLD, 'phase = "rayleigh"', "layer[1].albedo: is missing"),
        (
            f"{GOLD}\nthickness = 2.0",
            'phase = "rayleigh"\nalbedo = 1\nthickness_um = 1\nvolume_fraction = 0.1',
            "layer[1].thickness_um = 1: needs particles",
        ),
        ("[brdf]", "[field]\nmu0 = 0.5\nstokes = [1, 0, 0]\n[brdf]", "field.stokes = [1, 0, 0]: must be four numbers"),
        # no TOML at all
        ("= 12", "== 12", "not valid TOML: "),
        ("nodes = 12", "nodes = 12\nnodes = 13", "not valid TOML: "),
        ("nodes = 12", f"nodes = {5000 * '['}", "leads through more than 30 keys, tables or lists"),
    ],
)
def test_a_mistake_is_named(read: Reader, old: str, new: str, complaint: str) -> None:
    with pytest.raises(vrte.SceneError) as caught:
        read(SCENE, (old, new), kind="field" if "stokes" in new else "brdf" if "[field]" in new else None)
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(show_place(caught.value.place))


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("nodes", "node", ("node",)),
        ("2.0", "-2.0", ("layer", 0, "thickness")),
        ("thickness = 2.0", "", ("layer", 0)),
        ('= "gold"\nthick', "= { gold = -1 }\nthick", ("layer", 0, "particles", "gold")),
        ("radius_um = 0.1", "diameter_um = -1", ("particles", "gold", "diameter_um")),
        ("wavelength_um = 0.64", "wavelength_um = -1", ("wavelength_um",)),  # told of the particles
        (
            "0.1",
            "{ lognormal = { median_um = 0.1, sigma = 0.5 } }",
            ("particles", "gold", "size", "lognormal", "sigma"),
        ),
        ("= 12", "== 12", ()),
    ],
)
def test_an_error_carries_its_place(read: Reader, old: str, new: str, place: Place) -> None:
    with pytest.raises(vrte.SceneError) as caught:
        read(SCENE, (old, new), *[("radius_um = {", "size = {")] * ("{ log" in new))
    assert caught.value.place == place
    assert pickle.loads(pickle.dumps(caught.value)).place == place


@pytest.mark.parametrize(
    ("asked", "place"),
    [({"phi": math.inf}, ("brdf", "phi_deg")), ({"mu_o": 2.0}, ("brdf", "mu_o")), ({"nodes": 0}, ("nodes",))],
)
def test_a_request_is_complained_about_by_the_keys_of_the_file(
    read: Reader, asked: dict[str, Any], place: Place
) -> None:
    file = read(SCENE)
    with pytest.raises(vrte.SceneError, match=rf"^{show_place(place)} must ") as caught, file.located():
        vrte.brdf(file.scene, **file.keywords(asked))
    assert caught.value.place == place


def test_files_that_are_no_text(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_bytes(b"nodes = \xff")
    with pytest.raises(vrte.SceneError, match="not a text file in UTF-8"):
        read_scene(tmp_path / "scene.toml")
    with pytest.raises(FileNotFoundError):
        read_scene(tmp_path / "absent.toml")


def test_nothing_is_computed_for_a_scene_with_a_mistake(read: Reader, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SOURCES, "spheres", SOURCES["spheres"]._replace(make=lambda **_: pytest.fail("computed")))
    second = '[[layer]]\nparticles = "gold"\n'
    with pytest.raises(vrte.SceneError, match=r"layer\[2\]: either thickness"):
        read(SCENE, ("[base]", second + "[base]"))


@pytest.mark.parametrize("name", SOURCES)
def test_every_source_of_particles_fills_a_layer(name: str) -> None:
    """By its example: named or, for spheres, not, in a scene that loses no energy; other keys are refused by name."""
    row = SOURCES[name]
    kind = {"source": name, **{key: one.start for key, one in row.keys.items() if one.start is not None}}
    kind |= {"radius_um": 0.1} if row.sized else {}
    rest = {"wavelength_um": 0.5, "nodes": 8, "layer": [{"particles": "one", "thickness": 0.5}], "field": {"mu0": 0.6}}
    found = make_scene_file({**rest, "particles": {"one": kind}})
    (layer,) = found.scene.layers
    assert layer.albedo == found.particles["one"].albedo
    field = vrte.radiance(found.scene, 0.6, tau=[0.0, 0.5], nodes=8)
    net = field.flux_down + field.direct - field.flux_up
    assert layer.albedo < 1.0 or abs(net[1] - net[0]) < 1e-12
    with pytest.raises(vrte.SceneError, match=r"particles\.one\.colour = 1: unknown key.* source, "):
        make_scene_file({**rest, "particles": {"one": {**kind, "colour": 1}}})
    with pytest.raises(vrte.SceneError, match=r"particles\.one\.source = \"dust\": must be 'spheres'"):
        make_scene_file({**rest, "particles": {"one": {**kind, "source": "dust"}}})


DEEP = {
    "quoted keys": '" "' + '." "' * 16_000 + "=1",
    "bare keys": "a" + " . a" * 16_000 + "=1",
    "a header": "[" + "a." * 16_000 + "a]",
    "lists": "a = " + "[" * 16_000,
    "tables of long keys": "a = " + "{b.b.b.b.b.b.b.b.b.b = " * 200 + "1" + "}" * 200,
    "behind a text with quotes at its ends": 'a = [{b = """""x"""""}, {c' + ".c" * 16_000 + " = 1}]",
    "behind the same of single quotes": "a = [{b = '''x'''''}, {c" + ".c" * 16_000 + " = 1}]",
    "behind an escaped quote": r'a = [{b = "\"#"}, {c' + ".c" * 16_000 + " = 1}]",
    "in a list of lines": "a = [\n" + "[\n" * 16_000,
}


@pytest.mark.parametrize("way", DEEP)
def test_what_leads_too_deep_is_refused_before_it_is_parsed(way: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The parser would take a GB and 13 s for the first, and its result would be too deep for whoever copies it."""
    monkeypatch.setattr(tomllib, "loads", lambda text: pytest.fail("it was parsed"))
    with pytest.raises(vrte.SceneError, match=r"line \d+ leads through more than 30 keys, tables or lists"):
        parse_toml(DEEP[way])


def test_what_only_looks_deep_is_read() -> None:
    dots, brackets = "." * 100, "[{" * 100
    text = f"""# {brackets}
    a = "{dots}\\"{brackets}"
    b = '{dots}{brackets}'
    c = '''{dots}
    '{brackets}''''
    d = [{"1.5, " * 1000}]
    [e.{".".join("k" * (DEEPEST - 2))}]
    {".".join("k" * DEEPEST)} = 1
    """
    found = parse_toml(text)
    assert (found["a"], found["b"]) == (f'{dots}"{brackets}', f"{dots}{brackets}")
    assert found["c"].endswith(f"{brackets}'")
    assert len(found["d"]) == 1000


@pytest.mark.parametrize("quote", ['"', "'", '\\"', '"""\\"', "'''"])
def test_texts_that_nothing_closes_take_no_longer_than_they_are_long(quote: str) -> None:
    begun = time.process_time()
    with pytest.raises(vrte.SceneError, match="not valid TOML"):
        parse_toml(f"a = {quote * (200_000 // len(quote) | 1)}")
    assert time.process_time() - begun < 2.0  # a pass from every quote to the end would take minutes
