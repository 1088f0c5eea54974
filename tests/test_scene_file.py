"""Scene files: what is right is read as meant and written back, what is wrong is named by its dotted key."""

import copy
import json
import math
import pickle
import re
import time
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import vrte
from vrte.basics.errors import Place
from vrte.formats.particle_sources import SOURCES
from vrte.formats.scene_file import (
    SceneFile,
    find_known_wavelengths,
    find_named_tables,
    make_scene_file,
    read_content,
    read_scene,
)
from vrte.formats.toml_table import DEEPEST, parse_toml, show_place, split_key, write_toml
from vrte.optics.refractive_index import refractive_index

from .helpers import assert_close

EXAMPLES = Path(__file__).parents[1] / "examples"
Content = dict[str, Any]
GOLD: Content = {
    "wavelength_um": 0.64,
    "nodes": 12,
    "particles": {"gold": {"index": "gold", "radius_um": 0.1}},
    "layer": [{"particles": "gold", "thickness": 2.0}],
    "base": {"kind": "lambertian", "albedo": 0.3},
    "brdf": {"mu_i": [0.6, 1.0], "mu_o": {"start": 0.5, "stop": 1.0, "count": 3}},
}
HAZE = {"phase": "rayleigh", "albedo": 0.5, "thickness": 0.1}
FOG: Content = {"layer": [{"phase": "rayleigh", "albedo": 0.9, "thickness": 2.0}], "brdf": GOLD["brdf"]}
ONE: Content = {  # one kind of particle, which a row gives
    "wavelength_um": 0.55,
    "particles": {"one": {"index": [1.5, 0.0]}},
    "layer": [{"particles": "one", "thickness": 1.0}],
    "brdf": {"mu_i": 0.5, "mu_o": 0.5},
}
BEADS = {"index": [1.7, 0.0], "radius_um": 0.1}
FILM = {"particles": "beads", "thickness": 2.0}
MEDIA: Content = {"wavelength_um": 0.55, "particles": {"beads": BEADS}, "layer": [FILM], "brdf": ONE["brdf"]}
FIELD: Content = {key: value for key, value in GOLD.items() if key != "brdf"} | {"field": {"mu0": 0.5}}
FACETS = {"roughness": 0.1, "distribution": "ggx", "shadowing": True}
HOLLOW = {"source": "coated-spheres", "core": [1.0, 0.0], "shell": [1.59, 0.0], "host_index": 1.33}
GLASS = {"index": [1.5, 0], "radius_um": 0.2}
CSV = {
    "rayleigh.csv": "l,a1,a2,a3,a4,b1,b2\n# c\n0,1,0,0,0,0,0\n1,0,0,0,1.5,0,0\n2,0.5,3,0,0,1.224744871391589,0\n",
    "cut.csv": "l,a1,a2,a3,a4,b1,b2\n0,1,0,0,0,0,0\n1,1.01,0,0,0,0,0\n",  # F11 is -0.01 at 180
    "sizes.csv": "# a sieve\ndiameter_um,density\n0.1,0\n0.12,5\n0.14,1\n0.16,0\n",
    "radii.csv": "radius_um,density\n0.05,0\n0.06,5\n0.07,1\n0.08,0\n",
    "clay.csv": "wavelength_um,n,k\n0.5,1.4,0.1\n0.6,1.6,0.1\n",
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the files of CSV."""
    for name, text in CSV.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def change(content: Content, changes: Content) -> Content:
    """A scene's content with other values at dotted keys; None takes a key away."""
    found = copy.deepcopy(content)
    for key, value in changes.items():
        *way, last = split_key(key)
        table: Any = found
        for step in way:
            table = table.setdefault(step, {}) if isinstance(table, dict) else table[step]
        if value is None:
            del table[last]
        else:
            table[last] = copy.deepcopy(value)
    return found


def between(above: Any, below: Any, **more: Any) -> Content:
    """A [[layer]] that is an interface."""
    return {"interface": {"above": above, "below": below, **more}}


# ---- what is right


LOGNORMAL, GAMMA = vrte.Lognormal(median_um=0.1, sigma=1.2), vrte.Gamma(r_eff_um=0.1, v_eff=0.05)
MEDIAN, DIAMETER = {"median_um": 0.1, "sigma": 1.2}, {"median_diameter_um": 0.2, "sigma": 1.2}
R_EFF, D_EFF = {"r_eff_um": 0.1, "v_eff": 0.05}, {"d_eff_um": 0.2, "v_eff": 0.05}
RADII, DENSITY = [0.05, 0.06, 0.07, 0.08], [0.0, 5.0, 1.0, 0.0]
SIEVE = vrte.Tabulated(RADII, DENSITY)
SIEVES: list[Content] = [
    {"tabulated": {"radius_um": RADII, "density": DENSITY}},
    {"tabulated": {"diameter_um": [2.0 * radius for radius in RADII], "density": DENSITY}},
    {"table": "sizes.csv"},
    {"table": "radii.csv"},
]
COATED: Content = {"core": 1.0, "shell": 1.59, "radius_um": 0.25, "host_index": 1.33}
FLAT: Content = {"index": [1.5, 0.01], "aspect_ratio": 2.0, "radius_um": 0.05, "host_index": 1.33}
MIXED = {"particles.glass": GLASS, "layer[1].thickness": None, "layer[1].thickness_um": 5}
SOIL = {"kind": "rpv", "rho_0": 0.076, "k": 0.648, "asymmetry": -0.29, "rho_c": 0.6}
TINT = [1.5, 1e-3]


def of_gold(material: Any = "gold", **how: Any) -> vrte.Layer:
    """The layer of GOLD, but for what is given."""
    size = {} if "size" in how else {"radius_um": 0.1}
    return vrte.Layer.of(vrte.spheres(material, **{"wavelength_um": 0.64} | size | how), thickness=2.0)


def of_mixture(**how: float) -> vrte.Layer:
    """Gold and glass, 2 : 1 by number."""
    made = [vrte.spheres(index, radius_um=r, wavelength_um=0.64) for index, r in (("gold", 0.1), (1.5, 0.2))]
    return vrte.Layer.of(vrte.mixture([(made[0], 2.0), (made[1], 1.0)]), **how)


def of_one(make: Callable[..., Any], *material: Any, **how: Any) -> vrte.Layer:
    """The layer of ONE."""
    return vrte.Layer.of(make(*material, wavelength_um=0.55, **how), thickness=1.0)


def of_beads(host_index: Any, wavelength_um: float = 0.55) -> vrte.Layer:
    """The layer of MEDIA in a medium."""
    beads = vrte.spheres(1.7, radius_um=0.1, wavelength_um=wavelength_um, host_index=host_index)
    return vrte.Layer.of(beads, thickness=2.0)


def find_n(name: str, wavelength_um: float) -> float:
    return refractive_index(name, wavelength_um).n


RIGHT: list[tuple[Content, Content, Callable[[], Any]]] = [  # a scene, what is changed, and the same made by hand
    (GOLD, {"particles.gold": {"index": "gold", "size": {"lognormal": MEDIAN}}}, lambda: of_gold(size=LOGNORMAL)),
    (GOLD, {"particles.gold": {"index": "gold", "size": {"lognormal": DIAMETER}}}, lambda: of_gold(size=LOGNORMAL)),
    (GOLD, {"particles.gold": {"index": "gold", "size": {"gamma": R_EFF}}}, lambda: of_gold(size=GAMMA)),
    (GOLD, {"particles.gold": {"index": "gold", "size": {"gamma": D_EFF}}}, lambda: of_gold(size=GAMMA)),
    (GOLD, {"particles.gold": {"index": "gold", "diameter_um": 0.2}}, of_gold),
    (GOLD, {"particles.gold.index": [0.2, 3.5]}, lambda: of_gold(0.2 + 3.5j)),
    (GOLD, {"particles.gold.index": 1.5}, lambda: of_gold(1.5)),
    (GOLD, {"host_index": 1.33}, lambda: of_gold(host_index=1.33)),
    (GOLD, {"layer": None, "particles": None}, lambda: vrte.Scene([], vrte.Lambertian(0.3))),
    (GOLD, {"base.albedo": "30 %"}, lambda: vrte.Scene(of_gold(), vrte.Lambertian(0.3))),
    (
        GOLD,
        MIXED | {"layer[1].particles": {"gold": 2, "glass": 1}, "layer[1].volume_fraction": "5%"},
        lambda: of_mixture(thickness_um=5.0, volume_fraction=0.05),
    ),
    (  # of volumes 1 : 4, where a sphere of glass has 8 times the volume of one of gold: 2 : 1 by number
        GOLD,
        MIXED | {"layer[1].particles": None, "layer[1].volume_fractions": {"gold": "1 %", "glass": 0.04}},
        lambda: of_mixture(thickness_um=5.0, volume_fraction=0.05),
    ),
    (
        GOLD,
        {"layer": [{"volume_fractions": {"gold": 0.1, "glass": 0.4}, "thickness": 3.0}], "particles.glass": GLASS},
        lambda: of_mixture(thickness=3.0),  # their ratios alone
    ),
    *[(ONE, {"particles.one.size": size}, lambda: of_one(vrte.spheres, 1.5, size=SIEVE)) for size in SIEVES],
    *[
        (ONE, {"particles.one": HOLLOW | size | coat}, lambda coat=coat: of_one(vrte.coated_spheres, **COATED, **coat))
        for size, coat in (
            ({"radius_um": 0.25}, {"shell_um": 0.05}),
            ({"diameter_um": 0.5}, {"core_ratio": 0.8}),
            ({"radius_um": 0.25}, {"core_radius_um": 0.2}),
        )
    ],
    (
        ONE,
        {"particles.one": FLAT | {"source": "spheroids"}},
        lambda: of_one(vrte.spheroids, FLAT["index"], **{name: FLAT[name] for name in FLAT if name != "index"}),
    ),
    (FOG, {"layer[1].phase": "isotropic"}, lambda: vrte.Layer(vrte.isotropic(), 0.9, 2.0)),
    (FOG, {}, lambda: vrte.Layer(vrte.rayleigh(), 0.9, 2.0)),
    (FOG, {"layer[1].phase": {"rayleigh": 0.03}}, lambda: vrte.Layer(vrte.rayleigh(0.03), 0.9, 2.0)),
    (
        FOG,
        {"layer[1].phase": {"henyey_greenstein": 0.5, "terms": 9}},
        lambda: vrte.Layer(vrte.henyey_greenstein(0.5, 9), 0.9, 2.0),
    ),
    (FOG, {"layer[1].phase": "rayleigh.csv"}, lambda: vrte.Layer(vrte.rayleigh(), 0.9, 2.0)),
    (FOG, {"layer[1].thickness": math.inf}, lambda: vrte.Layer(vrte.rayleigh(), 0.9, math.inf)),
    (
        MEDIA,
        {"host_index": 1.5, "layer": [between(1.0, 1.4), HAZE, between(1.4, 1.5, **FACETS), FILM]},
        lambda: vrte.Scene(
            [
                vrte.Interface(1.0, 1.4),
                vrte.Layer(vrte.rayleigh(), 0.5, 0.1),
                vrte.Interface(1.4, 1.5, 0.1, "ggx", True),
                of_beads(1.5),
            ]
        ),
    ),
    (
        MEDIA,  # a plate
        {"layer": [between(1.0, [1.5, 0]), between(1.5, 1.33)]},
        lambda: vrte.Scene([vrte.Interface(1.0, 1.5), vrte.Interface(1.5, 1.33)]),
    ),
    (  # what has a name follows the wavelength; so little of water's k that it is clear
        MEDIA,
        {"wavelength_um": 0.65, "host_index": "silica", "layer": [between("water", "silica"), FILM]},
        lambda: vrte.Scene([vrte.Interface(find_n("water", 0.65), find_n("silica", 0.65)), of_beads("silica", 0.65)]),
    ),
    (  # particles, layers and the file have media, of which the layer's wins over the file's
        MEDIA,
        {
            "host_index": 1.33,
            "particles.haze": BEADS | {"host_index": 1.0},
            "layer": [{"particles": "haze", "thickness": 2.0}, between(1.0, 1.5), FILM | {"host_index": 1.5}],
        },
        lambda: vrte.Scene([of_beads(1.0), vrte.Interface(1.0, 1.5), of_beads(1.5)]),
    ),
    (  # the tint of a coat, which absorbs 4 pi k/wavelength a micrometre
        MEDIA,
        {"layer": [between(1.0, TINT), {"host_index": TINT, "thickness_um": 100.0}, between(TINT, 1.33)]},
        lambda: vrte.Scene(
            [
                vrte.Interface(1.0, 1.5),
                vrte.Layer(vrte.isotropic(), 0.0, 100.0 * 4e-3 * math.pi / 0.55, 1.5),
                vrte.Interface(1.5, 1.33),
            ]
        ),
    ),
    (MEDIA, {"base": {"kind": "mirror", "index": "gold"}}, lambda: vrte.Mirror(refractive_index("gold", 0.55).value)),
    (MEDIA, {"base": {"kind": "mirror", "index": "clay.csv"}}, lambda: vrte.Mirror(1.5 + 0.1j)),
    (MEDIA, {"base": {"kind": "facets", "index": 1.34, **FACETS}}, lambda: vrte.Facets(1.34, 0.1, "ggx", True)),
    (FOG, {"base": SOIL}, lambda: vrte.RPV(0.076, 0.648, -0.29, rho_c=0.6)),
    (FOG, {"base": {"kind": "hapke", "albedo": "60 %", "linear": 0.5}}, lambda: vrte.Hapke(0.6, linear=0.5)),
    (
        FOG,
        {"base": {"kind": "ross-li", "f_iso": 0.2, "f_vol": 0.1, "f_geo": 0, "hot_spot": True}},
        lambda: vrte.RossLi(0.2, 0.1, 0.0, hot_spot=True),
    ),
    (FOG, {"base": {"kind": "cox-munk", "wind": 7}}, lambda: vrte.cox_munk(7.0)),
]


@pytest.mark.parametrize(("content", "changes", "make"), RIGHT)
def test_a_scene_is_the_one_made_by_hand_and_what_is_written_reads_back(
    content: Content, changes: Content, make: Callable[[], Any], folder: Path
) -> None:
    content = change(content, changes)
    text = write_toml(content)
    assert tomllib.loads(text) == content
    found, made = make_scene_file(tomllib.loads(text), folder=folder).scene, make()
    if isinstance(made, vrte.Layer):
        made = vrte.Scene(made, found.base)
    if not isinstance(made, vrte.Scene):
        made = vrte.Scene(list(found.layers), made)
    assert (found.interfaces, found.indices, found.base) == (made.interfaces, made.indices, made.base)
    for layer, twin in zip(found.layers, made.layers, strict=True):
        assert_close([layer.thickness, layer.albedo], [twin.thickness, twin.albedo], rtol=1e-14, atol=0.0)
        assert_close(layer.phase_matrix.coefficients, twin.phase_matrix.coefficients, rtol=0.0, atol=1e-13)


ANGLES = {"angle_i_deg": [math.degrees(math.acos(0.6)), 0], "angle_o_deg": [60, math.degrees(math.acos(0.75)), 0]}
COSINES = {"mu_i": [0.6, 1.0], "mu_o": [0.5, 0.75, 1.0]}
WANTED = {"stokes": [3, 0, 0, 1], "mu": -0.5, "phi_deg": [0, 90], "tau": {"start": 0, "stop": 2, "count": 3}}
READ = {"mu0": 0.5, "stokes": [3.0, 0.0, 0.0, 1.0], "mu": [-0.5], "phi": [0.0, 90.0], "tau": [0.0, 1.0, 2.0]}
METHOD = {"method": "successive-orders", "settings": {"orders": 3}, "illuminate": "bottom"}
TRUNCATION = {"accuracy": 1e-4, "truncation": "delta-m"}


@pytest.mark.parametrize(
    ("content", "changes", "request_", "options"),
    [
        (GOLD, {}, COSINES, {"nodes": 12}),
        (GOLD, {"brdf": ANGLES, "nodes": None}, COSINES, {}),
        (FIELD, {"field": {"angle0_deg": 60}}, {"mu0": 0.5}, {"nodes": 12}),
        (FIELD, {"field.mu0": [0.5, 1], "field.mu": []}, {"mu0": [0.5, 1.0], "mu": []}, {"nodes": 12}),
        (FIELD, {f"field.{key}": value for key, value in WANTED.items()}, READ, {"nodes": 12}),
        (FIELD, {"nodes": None, **TRUNCATION}, {"mu0": 0.5}, TRUNCATION),
        (FIELD, {"nodes": None, **METHOD}, {"mu0": 0.5}, METHOD),
    ],
)
def test_what_is_asked_for_and_how(content: Content, changes: Content, request_: Any, options: Any) -> None:
    file = make_scene_file(change(content, changes))
    assert (file.kind, file.options) == ("brdf" if content is GOLD else "field", options)
    assert file.request.keys() == request_.keys()
    for name, values in file.request.items():
        assert_close(values, request_[name], rtol=1e-14, atol=0.0)


def test_a_table_that_was_cut_short_is_taken_where_the_file_says_so(folder: Path) -> None:
    with pytest.warns(vrte.NegativeScatteringWarning, match="180 degrees"):
        file = make_scene_file(change(FOG, {"layer[1].phase": "cut.csv", "layer[1].tolerance": 0.003}), folder=folder)
    assert file.scene.layers[0].phase_matrix.tolerance == 0.003


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
    for wrong, words in (
        ({"colour": 1}, "colour = 1: unknown key.* source, "),
        ({"source": "x"}, "source = .*'spheres'"),
    ):
        with pytest.raises(vrte.SceneError, match=rf"particles\.one\.{words}"):
            make_scene_file({**rest, "particles": {"one": {**kind, **wrong}}})


# ---- media


def test_tables_and_wavelengths_of_media_are_found() -> None:
    content = change(
        MEDIA,
        {
            "host_index": "wax.csv",
            "particles.beads.host_index": "oil.csv",
            "particles.dust": {"source": "coated-spheres", "core": "rutile", "shell": "clay.csv"},
            "particles.clay": {"index": 1.5, "size": {"table": "sizes.csv"}},
            "layer": [between(1.0, "oil.csv"), {"phase": "fog.csv"}, {"phase": {"table": "ice.nc"}}],
            "base": {"kind": "mirror", "index": "gold.csv"},
        },
    )
    assert {show_place(index): name for index, name in find_named_tables(content).items()} == {
        "layer[1].interface.below": "oil.csv",
        "layer[2].phase": "fog.csv",
        "layer[3].phase.table": "ice.nc",
        "base.index": "gold.csv",
        "host_index": "wax.csv",
        "particles.beads.host_index": "oil.csv",
        "particles.dust.shell": "clay.csv",
        "particles.clay.size.table": "sizes.csv",
    }
    assert find_known_wavelengths(change(MEDIA, {"layer": [between(1.0, "rutile")]})) == (0.36, 1.53, "rutile")


# ---- what is wrong

Rows = list[tuple[Any, str]]  # what is changed, and words of the sentence that says so
GOLDS: Rows = [
    # a key nobody knows, with the one that was meant
    ({"node": 12}, "node = 12: unknown key; did you mean 'nodes'? Allowed: wavelength_um, "),
    # a value of the wrong kind
    ({"nodes": True}, "nodes = true: must be a whole number from 1 to "),
    ({"accuracy": math.nan}, "accuracy = nan: must be a number between 1e-15 and 0.1"),
    ({"method": "two-streams"}, 'method = "two-streams": must be '),
    ({"wavelength_um": "0.64"}, 'wavelength_um = "0.64": must be the wavelength in micrometres'),
    ({"layer[1].thickness": math.nan}, "layer[1].thickness = nan: must be a number >= 0"),
    ({"layer[1].thickness": 10**400}, ": must be a number >= 0"),
    ({"layer[1].thickness": -2.0}, "layer[1].thickness must be an optical thickness >= 0"),
    ({"particles.gold.index": [1, 2, 3]}, "particles.gold.index = [1, 2, 3]: must be the name of a material"),
    ({"particles.gold.index": "glod"}, "particles.gold.index: 'glod' is neither"),
    ({"particles": 3}, "particles = 3: must be tables headed [particles.NAME]"),
    ({"layer": {}}, "layer = {}: must be tables headed [[layer]], top first"),
    ({"layer": [HAZE] * 10_001}, "layer: there must be at most 10000 of them, not 10001"),
    ({"layer": None, "base": None}, "layer: is missing; it must be at least one table [[layer]]"),
    ({"brdf.mu_i": [0.6, math.nan]}, "brdf.mu_i = [0.6, nan]: must be a number, a list"),
    ({"brdf.mu_o.count": 0}, "brdf.mu_o.count = 0: must be a whole number from 1"),
    ({"brdf.mu_o.count": 1}, "brdf.mu_o.count = 1: one value needs start = stop"),
    ({"brdf.mu_o.start": None}, "brdf.mu_o.start: is missing"),
    ({"brdf.mu_o.stop": math.inf}, "brdf.mu_o = { start = 0.5, stop = inf, count = 3 }: start and stop must be"),
    # something missing or too much
    ({"wavelength_um": None}, "wavelength_um: is missing; it must be the wavelength in micrometres"),
    ({"particles.gold.diameter_um": 1}, "particles.gold: exactly one of radius_um, diameter_um and size is"),
    ({"layer[1].thickness_um": 2}, "layer[1]: either thickness (optical) or thickness_um with volume_fraction is"),
    ({"layer[1].albedo": 1}, "layer[1].albedo = 1: goes with phase only"),
    ({"layer[1].phase": "rayleigh"}, "layer[1]: exactly one of particles, volume_fractions and phase is needed"),
    ({"base.kind": "black"}, 'base.albedo = 0.3: goes with kind = "lambertian" or "hapke" only'),
    ({"base.albedo": 1.3}, "base.albedo must be between 0 and 1, not 1.3"),
    ({"base.albedo": "30"}, 'base.albedo = "30": must be a number between 0 and 1, or per cent'),
    ({"layer[1].particles": "gild"}, 'layer[1].particles = "gild": no table [particles.gild]; did you mean'),
    ({"layer[1].particles": 3}, "layer[1].particles = 3: must be a name, or a table { name = number fraction, "),
    ({"layer[1].particles": {"gold": 1, "x": 2}}, "no table [particles.x]. Defined: gold"),
    ({"layer[1].particles": {"gold": -1}}, "layer[1].particles.gold = -1: must be a number fraction >= 0"),
    ({"layer[1].particles": {"gold": 0}}, "layer[1].particles = { gold = 0 }: at least one number fraction"),
    ({"wavelength_um": 640.0}, "particles.gold.index: gold goes from"),
    ({"wavelength_um": -1}, "particles.gold: wavelength_um must be"),
    ({"brdf.angle_i_deg": 3}, "brdf: exactly one of mu_i and angle_i_deg is needed"),
    ({"brdf": {"angle_i_deg": [9, 90]}}, "brdf.angle_i_deg = [9, 90]: must be degrees from the normal"),
]
FIELDS: Rows = [
    ({"field.mu0": "high"}, 'field.mu0 = "high": must be a cosine above 0, up to 1, or a list of them'),
    ({"field.stokes": [1, 0, 0]}, "field.stokes = [1, 0, 0]: must be four numbers"),
]
SIZES: Rows = [
    ({"lognormal": {"median_um": 0.1, "sigma": 0.5}}, "particles.one.size.lognormal.sigma must be"),
    ({"gamma": {"d_eff_um": -1, "v_eff": 0.1}}, "one.size.gamma.d_eff_um: half of it, r_eff_um must"),
    ({"table": "sizes.txt"}, 'particles.one.size.table = "sizes.txt": must be the path of a .csv file'),
    ({"table": "lost.csv"}, 'particles.one.size.table = "lost.csv": the file cannot be read: No such file'),
    ({"table": "sizes.csv", "gamma": {}}, "must be exactly one of lognormal, gamma, tabulated, table"),
]
COATS: Rows = [
    ({}, "particles.one: coated_spheres: give exactly one of core_radius_um, shell_um and core"),
]
VOLUMES: Rows = [
    ({"gold": 1.5}, "layer[1].volume_fractions.gold = 1.5: must be from 0 to below 1"),
    ({"gold": "0 %"}, "at least one fraction must be above 0"),
]
PHASES: Rows = [
    ("isotropc", 'layer[1].phase = "isotropc": must be'),
    ("cut.csv", 'layer[1].phase = "cut.csv": the phase matrix is not physical: '),
    ({"rayleigh": 2}, "layer[1].phase.rayleigh: depolarization must be"),
    ({"rayleigh": 0, "terms": 3}, "layer[1].phase = { rayleigh = 0, terms = 3 }: must"),
]
LAYERS: Rows = [
    ([{"volume_fractions": {"beads": 0.1}}], "layer[1]: either thickness (optical) or thickness_um is needed"),
    ([{"volume_fractions": {"beads": 0.1}, "volume_fraction": 0.1}], "is the sum of volume_fractions; leave"),
    ([HAZE | {"thickness_um": 1}], "layer[1].thickness_um = 1: needs particles"),
    ([HAZE | {"tolerance": 0.003}], "layer[1].tolerance = 0.003: goes with a phase from a .csv only"),
    ([HAZE | {"host_index": [1.5, 1e-3]}], "layer[1].host_index = [1.5, 0.001]: absorbs; with phase, count"),
    ([between(1.0, 1.5) | {"thickness": 1}], "layer[1].thickness = 1: an interface has a [[layer]] of its own"),
    ([{"interface": 1.5}], "layer[1].interface = 1.5: must be a table with the keys above, below"),
    ([between(1.0, 0.05)], "layer[1].interface.below must be a real refractive index from 0.1"),
    ([between(1.0, "gold")], "what absorbs more is for bases"),
    ([between(1.0, "wter")], "layer[1].interface.below: 'wter' is neither a known name"),
    ([between(1.0, 1.5, roughness=2.0)], "layer[1].interface.roughness must be"),
    ([{"host_index": 1.5, "thickness": 1.0}], "layer[1].thickness = 1.0: goes with particles, volume_fractions or"),
    ([{"host_index": [1.5, 0.1], "thickness_um": 1.0}], "k from 0 to 0.01 n"),
    ([between(1.0, 1.5), FILM], "layer 2 has the refractive index 1, and the interface above it has 1.5"),
    ([between(1.0, 1.5), HAZE, FILM], "layer 3 has the refractive index 1, and layer 2, without an interface"),
    ([FILM, between(1.4, 1.5)], "layer 1 has the refractive index 1, and the interface below it has 1.4"),
    ([between(1.0, 1.5), between(1.4, 1.0)], "medium between two interfaces has the refractive index 1.5"),
    ([between(1.0, [1.5, 1e-3]), HAZE, between([1.5, 1e-3], 1.3)], "absorbs, which no layer counts"),
]
BASES: Rows = [
    ({"kind": "mirror", "index": [1.5, -1]}, "k from 0 to"),
    ({"kind": "facets", "index": 1.5}, "base.roughness: is missing"),
    ({"kind": "facets", "index": 1.5, "roughness": 0}, "Mirror"),
]
HOSTS: Rows = [
    ({"particles.beads.host_index": 0.0}, "particles.beads.host_index must be a real refractive index"),
    (
        {"particles.beads.host_index": 1.5, "layer[1].host_index": 1.4},
        "layer[1].host_index = 1.4: particles.beads has a host_index of its own: give it once",
    ),
    ({"layer": [between("zinc oxide", 1.0)], "wavelength_um": 0.4}, "layer[1].interface.above: zinc oxide goes"),
]
WRONG = [
    *((GOLD, changes, words) for changes, words in GOLDS),
    *((FIELD, changes, words) for changes, words in FIELDS),
    *((ONE, {"particles.one.size": size}, words) for size, words in SIZES),
    *((ONE, {"particles.one": HOLLOW | {"radius_um": 0.2} | coat}, words) for coat, words in COATS),
    *((GOLD, {"layer[1]": {"volume_fractions": parts, "thickness": 2.0}}, words) for parts, words in VOLUMES),
    *((FOG, {"layer[1].phase": phase}, words) for phase, words in PHASES),
    *((MEDIA, {"layer": layers}, words) for layers, words in LAYERS),
    *((MEDIA, {"base": base}, words) for base, words in BASES),
    *((MEDIA, changes, words) for changes, words in HOSTS),
]


@pytest.mark.parametrize(("content", "changes", "words"), WRONG, ids=[words for *_, words in WRONG])
def test_a_mistake_is_named(content: Content, changes: Content, words: str, folder: Path) -> None:
    """In one sentence that begins with its place; of media that do not fit, and of the light, with whose they are."""
    with pytest.raises(vrte.SceneError) as caught:
        make_scene_file(change(content, changes), folder=folder)
    message, index = str(caught.value), caught.value.place
    assert words in message
    assert "\n" not in message
    at_its_place = not index or re.match(re.escape(show_place(index)) + "[ :]", message)
    assert at_its_place or index[:1] in (("wavelength_um",), ("host_index",)) or "has the refractive index" in message
    assert pickle.loads(pickle.dumps(caught.value)).place == index


def test_each_command_takes_its_own_table_and_text(folder: Path) -> None:
    both, neither = change(GOLD, {"field": {"mu0": 0.5}}), change(GOLD, {"brdf": None})
    one = "exactly one of the tables [brdf] and [field] is needed, not"
    for content, kind, words in (
        (both, None, f"{one} 2"),
        (neither, None, f"{one} 0"),
        (GOLD, "field", "there is [brdf]"),
    ):
        with pytest.raises(vrte.SceneError, match=re.escape(words)):
            make_scene_file(content, kind)
    for text, words in (b"a == 1", "not valid TOML"), (b"a = 1\na = 2", "not valid TOML"), (b"a = \xff", "UTF-8"):
        (folder / "scene.toml").write_bytes(text)
        with pytest.raises(vrte.SceneError, match=words) as caught:
            read_scene(folder / "scene.toml")
        assert caught.value.place == ()
    with pytest.raises(FileNotFoundError):
        read_scene(folder / "absent.toml")


@pytest.mark.parametrize(
    ("asked", "place"),
    [({"phi": math.inf}, ("brdf", "phi_deg")), ({"mu_o": 2.0}, ("brdf", "mu_o")), ({"nodes": 0}, ("nodes",))],
)
def test_a_request_is_complained_about_by_the_keys_of_the_file(asked: Content, place: Place) -> None:
    file: SceneFile = make_scene_file(GOLD)
    with pytest.raises(vrte.SceneError, match=rf"^{show_place(place)} must ") as caught, file.located():
        vrte.brdf(file.scene, **file.keywords(asked))
    assert caught.value.place == place


def test_nothing_is_computed_for_a_scene_with_a_mistake(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SOURCES, "spheres", SOURCES["spheres"]._replace(make=lambda **_: pytest.fail("computed")))
    with pytest.raises(vrte.SceneError, match=r"layer\[2\]: either thickness"):
        make_scene_file(change(GOLD, {"layer": [*GOLD["layer"], {"particles": "gold"}]}))


# ---- texts of TOML

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


TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
VALUE = st.recursive(
    st.one_of(st.booleans(), st.integers(), st.floats(allow_nan=False), TEXT),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(TEXT, inner, max_size=3)),
    max_leaves=8,
)


@settings(max_examples=60, deadline=None)
@given(st.dictionaries(st.one_of(TEXT, st.sampled_from(["particles", "layer", "brdf"])), VALUE, max_size=6))
def test_any_content_reads_back(content: dict[str, object]) -> None:
    found = tomllib.loads(write_toml(content))
    assert found == content
    assert json.dumps(found, sort_keys=True) == json.dumps(content, sort_keys=True)  # 1, 1.0 and true are not the same


def test_every_example_and_what_needs_care_read_back() -> None:
    careful = {"a": [math.inf, -math.inf, 1e16, 1e-7, -0.0, 10**300], "b": 'q"\\\n\t\x00\x7f\x9f\u2028\U000e0001'}
    for content in (careful, *map(read_content, EXAMPLES.glob("*.toml"))):
        assert tomllib.loads(write_toml(content)) == content
    assert math.isnan(tomllib.loads(write_toml({"a": math.nan}))["a"])
    text = write_toml(change(GOLD, {"particles.'fool\u2019s gold'": BEADS}))
    for words in ('[particles."fool\u2019s gold"]', "[[layer]]", "mu_o = { start = 0.5, stop = 1.0, count = 3 }"):
        assert words in text


@pytest.mark.parametrize("value", ["\ud800", None, b"x", 10**4000, {"k" * 99: ["\ud800" * 99] * 99}])
def test_what_no_scene_holds_is_refused_in_one_short_sentence(value: object) -> None:
    with pytest.raises(vrte.SceneError, match="cannot be written") as caught:
        write_toml({"a": value})
    assert len(str(caught.value)) < 200
    for _ in range(100):
        value = [value]
    with pytest.raises(vrte.SceneError, match="too deeply"):
        write_toml({"a": value})
    with pytest.raises(vrte.SceneError, match="must be true or false"):
        make_scene_file(change(GOLD, {"brdf.transmission": value}))
