"""Every argument of every public call, given all that it is not, and scene files with faults drawn by chance: a right
result comes back, or one line that says what is wrong."""

import inspect
import itertools
import math
import pickle
import re
import timeit
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import given as draw_from
from hypothesis import strategies as st

import vrte
from vrte.basics.arguments import check_arguments
from vrte.scene.boundary import Boundary

from .helpers import run
from .samples import slow_but


class Sullen:
    """Something that answers no question."""

    def __array__(self, *_: Any, **__: Any) -> Any:
        raise RuntimeError("no")

    def __repr__(self) -> str:
        return "Sullen()"


class Vast:
    """A class that can be made of anything."""

    def __init__(self, *_: Any) -> None: ...


ZOO: dict[str, Any] = {
    "None": None, "object": object(), "class": Vast, "text": "x", "empty text": "", "NUL": "a\0b", "bytes": b"x",
    "list": [], "ragged": [[1.0], [1.0, 2.0]], "words": ["x"], "nones": [None], "tuple": (), "dict": {},
    "table": {"x": 1}, "odd keys": {1: 2}, "set": {0.5}, "range": range(3), "NaN": math.nan, "inf": math.inf, "-1": -1,
    "-0.5": -0.5, "0": 0, "0.5": 0.5, "1e308": 1e308, "huge": 10**400, "complex": 1j, "True": True, "False": False,
    "pair": np.array([1, 2]), "matrix": np.zeros((2, 2)), "empty": np.zeros(0), "NaNs": np.array([np.nan]),
    "texts": np.array(["x", "y"]), "objects": np.array([None, {}], dtype=object),
    "date": np.array(["2026-01-01"], "datetime64[D]"), "masked": np.ma.masked_array([0.5, 0.6], [0, 1]),
    "line break": "a\nb\x1b", "long": "x" * 500, "subnormal": 5e-324, "-1e308": -1e308, "2**63": 2**63,
    "mixed": [0.5, None], "builtin": print, "half": np.array([0.5, 1.0], np.float16),
    "structured": np.zeros(2, "f8,i4"), "strided": np.arange(8.0)[::3] / 8.0,
    "lambda": lambda *_: None, "module": math, "Sullen": Sullen(), "layer": vrte.Layer(vrte.isotropic(), 0.5, 1.0),
}  # fmt: skip
# other words that name arguments, or what is in them
ALSO = {
    "must end in": "path", "is not a NetCDF file": "path", "not a number": "path", "unknown key": "scene",
    "TOML": "scene source", "is missing": "scene", "axes": "source", "the scene has no": "source names paint",
    "no key": "names", "base.albedo": "values", "scene ": "scenes", "layer": "layers", "a quantity": "name allowed",
    "material = ": "name", "host_index": "index", "index: ": "material", "a mixture": "parts", "place": "rows",
    "derivatives": "variation thickness albedo", "thickness": "thickness_um times", "scene_at": "is_outside",
    "transmission": "transmitted", "stokes": "light", "geometry": "geometries", "six elements": "spheres",
    "a wavelength": "wavelength_um", "wavelength": "wavelengths_um", "angles": "angle_deg",
    "no known convention": "angle_deg", "phi": "phi_deg",
    "directions": "phi_deg mu mu_i mu_o mu0 tau phi mu_edges phi_edges",
    "f must": "f_iso f_vol f_geo hot_spot", "the phase matrix is not physical": "a1 a2 a3 a4 b1 b2",
}  # fmt: skip

RAYLEIGH = vrte.rayleigh()
FLAKES = vrte.flakes(0.3 + 3.0j)
LAYER = vrte.Layer(RAYLEIGH, 0.9, 0.5)
SCENE = vrte.Scene([LAYER], vrte.Lambertian(0.3))
EVEN = {"kind": "lambertian", "albedo": 0.2}
CONTENT = {"nodes": 2, "layer": [{"phase": "isotropic", "albedo": 0.5, "thickness": 1.0}], "base": EVEN}
ASKED = {**CONTENT, "brdf": {"mu_i": 0.5, "mu_o": 0.5}}
FILM = {**CONTENT, "layer": [{"interface": {"above": 1.0, "below": 1.5}}, {"phase": "isotropic", "albedo": 0.5,
                                                                           "thickness": 1.0}]}  # fmt: skip
WHITE = {"pigment": "rutile", "volume_fraction": 0.1, "binder": "alkyd", "thickness_um": 20.0}
MATCH = {"paint": {"paint": WHITE}, "free": ["thickness_um"], "contrast_ratio": 0.9, "starts": 1, "nodes": 2,
         "wavelengths_um": np.linspace(0.43, 0.67, 7)}  # fmt: skip
AXES = {"depth": {"key": "layer[1].thickness", "values": [0.5, 1.0, 1.5, 2.0]}}
SLOW = {"paint", "export", "material", "cylinders", "sweep", "fit", "hiding", "kubelka_munk", "appearance", "page"}
SLOW |= {"match"}
Case = tuple[Callable[..., Any], dict[str, Any]]


def even(mu_i: Any, mu_o: Any, phi_deg: Any) -> Any:
    """f of a Lambertian base."""
    return np.diag([0.1, 0.0, 0.0, 0.0])


def make_objects() -> dict[str, Any]:
    """Objects that other calls start from."""
    cosines, azimuths = vrte.hemisphere(2)[0], np.linspace(0.0, 315.0, 8)
    rows = vrte.Measurement("total_reflectance", [0.2, 0.3], 0.01, theta_i_deg=[0.0, 30.0])
    found = vrte.linearize(SCENE, 0.5, 0.5, nodes=2, threads=1)
    dense = np.linspace(0.05, 1.0, 6)
    table = np.zeros((2, 2, 3, 4, 4))
    table[..., 0, 0] = 0.1
    look = vrte.appearance(FILM, np.linspace(0.4, 0.7, 9), geometries=["45:0"], nodes=2)
    brdf = vrte.brdf(SCENE, cosines, cosines, azimuths, nodes=2, threads=1)
    return {
        "brdf": brdf,
        "dense": vrte.brdf(vrte.Scene(LAYER), dense, dense, np.linspace(0.0, 180.0, 7), nodes=2, threads=1),
        "field": vrte.radiance(SCENE, [0.5, 0.6], mu=[0.5], nodes=2, threads=1),
        "views": vrte.views(SCENE, 0.5, 0.5, nodes=2, threads=1),
        "match": vrte.match(**MATCH),
        "photons": vrte.photons(SCENE, 0.5, [0.0, 1.0], [0.0, 180.0], photons=128, threads=1),
        "linearized": found,
        "gradient": found.vjp(np.ones((1, 1, 1, 4, 4))),
        "measurement": rows,
        "particles": vrte.spheres(1.5, radius_um=0.05, wavelength_um=0.5),
        "look": look,
        "paint": vrte.Paint("x", ("x",), look, {}, None, None, brdf, 0.5, ()),
        "fit": vrte.fit(rows, CONTENT, ["base.albedo"], nodes=2, threads=1),
        "spectrum": vrte.spectrum(ASKED, [0.4, 0.5]),
        "family": vrte.SceneFamily(ASKED, ["base.albedo"]),
        "swept": vrte.sweep({**ASKED, "axes": AXES}, workers=1),
        "table": {"mu_i": [0.5, 1.0], "mu_o": [0.5, 1.0], "phi_deg": [0.0, 90.0, 180.0], "mueller": table},
    }


def list_calls(made: dict[str, Any]) -> list[Case]:
    """Public calls, each with arguments that are right; those that are left out are at their defaults."""
    angle = np.arange(0.0, 181.0, 5.0)
    element = 0.75 * (1.0 + np.cos(np.radians(angle)) ** 2)
    light, axis = (1.0, 0.1, 0.0, 0.0), np.array([0.0, 30.0, 60.0])
    at = {"mu_i": 0.5, "mu_o": 0.5, "nodes": 2, "threads": 1}
    sphere = {"material": 1.5, "wavelength_um": 0.5, "radius_um": 0.05}
    panel = {"wavelengths_um": np.linspace(0.4, 0.7, 9), "nodes": 2}
    rough, smooth = vrte.Facets(1.5, 0.3), vrte.Interface(1.0, 1.5)
    indices = vrte.IndexTable((0.4, 0.7), (2.0, 1.5), (0.1, 0.0))
    base, look, family = vrte.TabulatedBase(**made["table"]), made["look"], made["family"]
    quantities, over = vrte.quantities, vrte.over_hemisphere
    records = [made[name] for name in ("brdf", "field", "views", "photons", "linearized", "gradient", "particles",
                                       "look", "fit", "spectrum", "paint", "family", "match")]  # fmt: skip
    records += [
        *(vrte.RPV(0.1, 0.8), vrte.Hapke(0.5), vrte.RossLi(0.1, 0.02, 0.02), vrte.Mirror(1.5), vrte.MuellerBase(even)),
        *(vrte.Gamma(0.2, 0.1), vrte.Lognormal(0.2, 1.4), vrte.Monodisperse(0.5), vrte.Tabulated([0.1, 0.3], [1, 1])),
        *(vrte.Lambertian(0.3), rough, vrte.Interface(1.0, 1.5, roughness=0.3), base, LAYER, RAYLEIGH, indices, FLAKES),
        *(vrte.Variation("depth", 1.0, [1.0], [0.0]), made["linearized"].plan),
    ]
    return [
        *((type(one), {name: getattr(one, name) for name in inspect.signature(type(one)).parameters})
          for one in records),
        (rough.reflectance, {"mu_i": 0.5}),
        (indices.at, {"wavelength_um": 0.5}),
        (smooth.share, {"mu": 0.5}),
        (smooth.put_between, {"above": 1.0, "below": 1.5}),
        (vrte.Hapke(0.6).warn_beyond, {"words": "it is bright"}),
        (FLAKES.project, {"mu": 0.5}),
        (FLAKES.extinguish, {"mu": 0.5}),
        (FLAKES.scatter_flux, {"mu": [0.5]}),
        (FLAKES.list_elements, {"cosine": 0.5}),
        (FLAKES.reflect, {"cosine": 0.5}),
        (FLAKES.find_density, {"tilt": 0.1}),
        (FLAKES.scatter, {"mu_out": 0.5, "mu_in": -0.5, "phi": 1.0}),
        (FLAKES.scatter_orders, {"mu_out": 0.5, "mu_in": -0.5, "n_order": 2}),
        (vrte.flakes, {"index": 1.5, "tilt_deg": 12.0, "wavelength_um": 0.5, "host_index": 1.5}),
        (vrte.Layer.of, {"particles": made["particles"], "thickness_um": 1.0, "volume_fraction": 0.01}),
        (vrte.Layer.of, {"particles": FLAKES, "volume_fraction": 0.1, "flake_thickness_um": 0.3, "thickness_um": 9.0}),
        (LAYER.scale, {"times": 2.0}),
        (LAYER.put_in_medium, {"index": 1.5}),
        (vrte.Layer.clear, {"thickness_um": 1.0, "host_index": 1.5, "wavelength_um": 0.5}),
        (vrte.Measurement, {"quantity": "f00", "value": 0.1, "theta_i_deg": 0.0, "theta_o_deg": 10.0}),
        (made["measurement"].pick, {"rows": [0]}),
        (made["measurement"].join, {"others": [made["measurement"]]}),
        (made["measurement"].measure, {"value": 0.5}),
        (made["measurement"].predict, {"scene": SCENE, "nodes": 2}),
        (made["measurement"].save, {"path": "rows.csv"}),
        (vrte.MuellerBase(even).reflectance, {"mu_i": 0.5, "points": 4}),
        (vrte.PhaseMatrix.from_angles, {"angle_deg": angle, "F11": element, "F22": element,
                                        **dict.fromkeys(("F12", "F33", "F34", "F44"), 0.0 * angle)}),
        (RAYLEIGH.to_angles, {}),
        (RAYLEIGH.scattering_matrix, {"angle_deg": angle}),
        (vrte.Scene, {"layers": [LAYER], "base": vrte.Lambertian(0.3)}),
        (family.content_at, {"values": [0.5]}),
        (family.file_at, {"values": [0.5]}),
        (family.at, {"values": [0.5]}),
        (family.variations, {}),
        (base.reflectance, {"mu_i": 0.5, "points": 4}),
        *((getattr(look, name), {}) for name in ("reflectance", "colour", "polarization", "gloss", "hiding")),
        (look.kubelka_munk, {}),
        (look.difference, {"other": look}),
        (LAYER.estimate_peak_width, {"wavelength_um": 0.5, "mean_free_path_um": 1.0}),
        (made["dense"].as_base, {}),
        (made["brdf"].under, {"light": light}),
        (made["brdf"].diffuse_reflectance, {}),
        (made["brdf"].bihemispherical_reflectance, {}),
        (made["brdf"].save, {"path": "found.csv"}),
        (made["field"].beam, {"place": 0}),
        (made["fit"].profile, {"name": "base.albedo", "values": [0.2]}),
        (made["fit"].save, {"path": "fit.json"}),
        (vrte.Fit.load, {"path": "fit.json"}),
        (made["fit"].page, {"path": "fit.html"}),
        (made["fit"].scene, {}),
        (made["fit"].write_scene, {"path": "fit.toml"}),
        (made["match"].paint, {}),
        (made["match"].write_scene, {"path": "match.toml"}),
        (made["match"].save, {"path": "match.csv"}),
        (made["gradient"].along, {"variation": vrte.Variation("x", 1.0, [1.0], [0.0])}),
        (made["linearized"].jvp, {"variation": "layer[1].thickness"}),
        (made["linearized"].vjp, {"cotangent": np.ones((1, 1, 1, 4, 4))}),
        (made["paint"].save, {"path": "paint.csv"}),
        (made["spectrum"].at, {"wavelengths_um": [0.4]}),
        (vrte.appearance, {"scene": CONTENT, "geometries": ["45:0"], **panel, "accuracy": 1e-3}),
        (vrte.brdf, {"scene": SCENE, **at}),
        (vrte.brdfs, {"scenes": [SCENE], **at}),
        (vrte.coated_spheres, {"core": 1.5, "shell": 1.4, "wavelength_um": 0.5, "shell_um": 0.01, "radius_um": 0.06}),
        (vrte.cox_munk, {"wind": 5.0}),
        (vrte.cylinders, {**sphere, "aspect_ratio": 1.1}),
        (vrte.spheroids, {**sphere, "aspect_ratio": 1.1}),
        (vrte.spheres, sphere),
        (vrte.fit, {"measurement": made["measurement"], "scene": SCENE, "free": ["base.albedo"], "nodes": 2,
                    "most_steps": 3, "threads": 1}),
        (vrte.hemisphere, {"n": 4}),
        (vrte.henyey_greenstein, {"g": 0.3}),
        (vrte.interpolate, {"table": made["swept"], "point": {"depth": 1.25}}),
        (vrte.isotropic, {}),
        (vrte.linearize, {"scene": SCENE, **at}),
        (vrte.load, {"path": "found.csv"}),
        (vrte.match, MATCH),
        (vrte.material, {"name": "chalk", "wavelength_um": 0.5, "thickness_um": 10.0, "volume_fraction": 0.01}),
        (vrte.materials, {}),
        (vrte.mix, {"parts": [(RAYLEIGH, 1.0)]}),
        (vrte.mixture, {"parts": [(made["particles"], 1.0)]}),
        (vrte.paint, {"scene": FILM, **panel}),
        (vrte.plan, {"kind": "brdf", "scene": SCENE, "mu_i": 0.5, "mu_o": 0.5, "nodes": 2}),
        (vrte.radiance, {"scene": SCENE, "mu0": 0.5, "mu": 0.5, "nodes": 2, "threads": 1}),
        (vrte.rayleigh, {}),
        (vrte.read_base, {"path": "base.csv"}),
        (vrte.read_index, {"path": "index.csv"}),
        (vrte.read_measurement, {"path": "rows.csv"}),
        (vrte.read_scattering, {"path": "dust.csv"}),
        (vrte.read_sizes, {"path": "sizes.csv"}),
        (vrte.recognise_convention, {"angle_deg": [30, 60, 120], "F11": [4.997, 0.4996, 0.1506]}),
        (vrte.refractive_index, {"material": 1.5, "wavelength_um": 0.5}),
        (vrte.show_versions, {}),
        (vrte.solve_base, {"scene": vrte.Scene(LAYER), "accuracy": 0.1, "nodes": 2, "threads": 1}),
        (vrte.spectrum, {"scene": ASKED, "wavelengths_um": [0.4, 0.5]}),
        (vrte.sweep, {"source": {**ASKED, "axes": {"base.albedo": [0.1, 0.2]}}, "workers": 1}),
        (vrte.export, {"scene": ASKED, "wavelengths_um": [0.4, 0.45, 0.5, 0.55, 0.6], "path": "x.pbsdf",
                       "step_deg": 15.0, "nodes": 2}),
        (vrte.views, {"scene": SCENE, "mu0": 0.5, "mu": 0.5, "nodes": 2}),
        (vrte.photons, {"scene": SCENE, "mu_i": 0.5, "photons": 128, "threads": 1}),
        (quantities.of_brdf, {"brdf": made["brdf"], "name": "f00"}),
        (quantities.of_light, {"light": np.array(light), "name": "I"}),
        (quantities.of_stokes, {"stokes": light, "name": "I"}),
        (quantities.incident_for, {"name": "f00", "stokes": light}),
        (quantities.unit_of, {"name": "f00"}),
        (quantities.check_name, {"name": "f00", "allowed": ("f00",)}),
        (over.stokes_over_hemisphere, {"brdf": made["dense"], "place": 0, "theta": axis, "phi": axis}),
        (over.light_on_mesh, {"brdf": made["dense"], "place": 0, "step_deg": 30.0}),
        (over.light_in_plane, {"brdf": made["dense"], "place": 0, "step_deg": 30.0}),
        (over.between_angles, {"angle": axis, "stokes": np.ones((3, 4))}),
        (over.check_directions, {"mu_o": [0.5, 1.0], "phi": axis}),
    ]  # fmt: skip


@cache
def prepare_calls() -> tuple[Case, ...]:
    """All of them, and the files that they read, in the folder of now."""
    made = make_objects()
    made["measurement"].save("rows.csv")
    made["brdf"].save("found.csv")
    made["dense"].save("base.csv")
    made["fit"].save("fit.json")
    Path("index.csv").write_text("wavelength_um,n,k\n0.4,1.5,0\n0.7,1.4,0\n")
    Path("sizes.csv").write_text("radius_um,density\n0.1,1\n0.3,1\n")
    Path("dust.csv").write_text("angle_deg,F11\n0,1.5\n45,1.125\n90,0.75\n135,1.125\n180,1.5\n")
    found = []
    for call, given in list_calls(made):
        known = inspect.signature(call).parameters.values()
        usual = {one.name: one.default for one in known if one.default is not one.empty}
        found.append((call, usual | given))
    return tuple(found)


def find_fault(call: Callable[..., Any], given: dict[str, Any], name: str, spoilt: Any) -> str:
    """What is wrong with the answer to a call with one argument spoilt; nothing where it is as promised."""
    try:
        found = call(**given | {name: spoilt})
        return "" if inspect.isclass(call) or is_right(found) else "not right"
    except vrte.SceneError as error:
        words = str(error)
        if not words.isprintable() or len(words) > 1000:
            return f"not one line: {words}"
        named = [name, *(also for also, names in ALSO.items() if name in names.split())]
        return "" if any(each in words for each in named) else f"not named: {words}"
    except Exception as error:
        return "" if isinstance(error, OSError) and isinstance(spoilt, str) else repr(error)


def is_right(found: Any) -> bool:
    """Whether a BRDF or a field is finite, not negative, and no more light than came in; other results are."""
    if isinstance(found, vrte.Brdf):
        light, intensity, returned = found.mueller, found.mueller[..., 0, 0], found.reflectance
    elif isinstance(found, vrte.Field):
        incident = max(float(found.incident_stokes[0]), 1e-300)
        light, returned = found.stokes / incident, found.flux_up[:1] / (found.mu0 * incident)
        intensity = light[..., 0]
    else:
        return True
    return bool(
        np.isfinite(light).all() and intensity.min(initial=0.0) > -1e-9 and returned.max(initial=0.0) < 1 + 1e-9
    )


def list_faults(cases: Iterable[Case], zoo: dict[str, Any]) -> list[str]:
    """The answers to calls with one argument after another spoilt in every way that are not as promised."""
    return [
        f"{call.__qualname__}({name}={kind}): {fault}"
        for call, given in cases
        for name in given
        if name != "step_deg" or call.__name__ != "export"  # half a degree is right, and takes minutes
        for kind, spoilt in zoo.items()
        if (fault := find_fault(call, given, name, spoilt))
    ]


@pytest.fixture(scope="module")
def cases(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Case, ...]]:
    """All calls, in a folder with the files that they read."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("arguments"))
        yield prepare_calls()


@pytest.mark.filterwarnings("ignore")
class TestZoo:
    def test_every_answer_is_a_result_or_names_the_argument(self, cases: tuple[Case, ...]) -> None:
        """What takes long is refused at the door: it is of no type that the argument is declared with."""
        assert list_faults((case for case in cases if case[0].__name__ not in SLOW), ZOO) == []
        assert list_faults((case for case in cases if case[0].__name__ in SLOW), {"Sullen": ZOO["Sullen"]}) == []

    @pytest.mark.slow
    def test_of_those_that_take_long(self, cases: tuple[Case, ...]) -> None:
        assert list_faults((case for case in cases if case[0].__name__ in SLOW), ZOO) == []

    def test_no_public_call_is_left_out(self, cases: tuple[Case, ...]) -> None:
        tried = {inspect.unwrap(getattr(call, "__func__", call)) for call, _ in cases}
        assert {one.__qualname__ for one in list_public_calls() if one not in tried} == set()


def test_odd_layers_have_right_answers() -> None:
    matrices = vrte.isotropic(), RAYLEIGH, vrte.henyey_greenstein(0.5, 9)
    odd = matrices, (0.0, 5e-324, 1.0 - 1e-12, 1.0), (0.0, 5e-324, 1e-10, 0.5, 1e6), (None, vrte.Lambertian(1.0))
    for matrix, albedo, thickness, base in itertools.product(*odd):
        scene = vrte.Scene([vrte.Layer(matrix, albedo, thickness), LAYER], base)
        asked = {"phi": [0.0, 90.0], "nodes": 3, "threads": 1}
        assert is_right(vrte.brdf(scene, 0.6, [0.5, 1.0], transmission=True, **asked)), scene
        assert is_right(vrte.radiance(scene, 0.6, mu=[0.5, -0.5], tau=[0.0, 0.5 * scene.thickness], **asked)), scene


FILE = """wavelength_um = 0.64
nodes = 3
[particles.p]
index = [1.5, 0.01]
radius_um = 0.05
[[layer]]
particles = "p"
thickness = 1.0
[[layer]]
phase = { henyey_greenstein = 0.5 }
albedo = 0.99
thickness = 2.0
[base]
kind = "lambertian"
albedo = 0.3
[brdf]
mu_i = [0.6, 1.0]
mu_o = { start = 0.05, stop = 1.0, count = 3 }
phi_deg = [0, 90, 180]
"""
NO_SPACES = "nan inf -inf -1 0 1e308 1e-320 [] {} true 1979-05-27 0x2 99999999999999999999 '''x -0.0 [[1]] 2.5 ="
TOKENS = [*NO_SPACES.split(), '"text"', '"p"', "[1, 2]", "", "{ count = 10 }", "\x00", "\u00e9", "1_000_000"]


@st.composite
def files(draw: st.DrawFn) -> bytes:
    """A scene file with one to three things done to it."""
    lines = FILE.splitlines()
    for _ in range(draw(st.integers(1, 3))):
        index, other = draw(st.integers(0, len(lines) - 1)), draw(st.integers(0, len(lines) - 1))
        key, equals, _ = line = lines[index].partition("=")
        name = draw(st.sampled_from(["x", "nodess", "[layer]", "[[layer]]", "albedo"]))
        changes: dict[str, list[str]] = {  # what stands in place of the line
            "drop": [],
            "twice": ["".join(line)] * 2,
            "value": [f"{key}= {draw(st.sampled_from(TOKENS))}"],
            "key": [f"{name}{equals} 1"],
            "cut": [lines[index][: len(lines[index]) // 2]],
            "other": [lines[other]],
            "junk": [draw(st.text(max_size=8)), lines[index]],
        }
        lines[index : index + 1] = changes[draw(st.sampled_from([*changes]))]
        lines = lines or [""]
    text = "\n".join(lines).encode("utf-8", "surrogatepass")
    return text + draw(st.sampled_from([b"", b"", b"", b"\xff\xfe", b"\x00"]))


@pytest.mark.parametrize("examples", slow_but([40, 600], 40))
def test_scene_files_give_a_table_or_one_line(
    examples: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 0 and a file, or 2, one line on standard error and no file; examples are the same every time."""
    monkeypatch.chdir(tmp_path)

    @settings(
        max_examples=examples, derandomize=True, database=None, deadline=10_000, suppress_health_check=[*HealthCheck]
    )
    @draw_from(files())
    def check(text: bytes) -> None:
        Path("scene.toml").write_bytes(text)
        if (code := run("brdf", "scene.toml", "-o", "out.nc", "--threads", "1")) == 0:
            assert np.isfinite(vrte.load("out.nc").mueller).all()
            Path("out.nc").unlink()
        assert [file.name for file in tmp_path.iterdir()] == ["scene.toml"]
        complaint = capsys.readouterr().err
        assert code == 0 or (code == 2 and re.fullmatch(r"vrte: error: .*scene\.toml.*\n", complaint))

    check()


class TestDoor:
    def test_it_costs_next_to_nothing(self) -> None:
        """Of the call of `vrte.brdf` with all of its arguments."""

        def take(scene: vrte.Scene, **_: Any) -> None: ...

        take.__signature__ = inspect.signature(vrte.brdf)  # type: ignore[attr-defined]
        many = {name: one.default for name, one in inspect.signature(vrte.brdf).parameters.items()}
        many |= {"scene": SCENE, "mu_i": 0.5, "mu_o": 0.5, "algorithm": "modes", "accuracy": 1e-4, "time_limit_s": 10.0}
        checked = check_arguments(take)
        times = [min(timeit.repeat(lambda call=call: call(**many), number=1000, repeat=20)) for call in (take, checked)]
        assert (times[1] - times[0]) / 1000 < 10e-6

    @pytest.mark.parametrize("call", [lambda: vrte.cox_munk(20.0), lambda: vrte.refractive_index(1.5, 500.0)])
    def test_a_warning_is_of_the_line_that_called(self, call: Callable[[], Any]) -> None:
        with pytest.warns() as reported:
            call()
        assert {one.filename for one in reported} == {__file__}

    def test_an_unknown_argument_is_python_s_matter_and_pickles_stay(self) -> None:
        with pytest.raises(TypeError, match="unexpected keyword argument 'nods'"):
            vrte.brdf(SCENE, 0.5, 0.5, nods=3)
        for call in (vrte.brdf, vrte.fit, vrte.sweep, vrte.Layer.of, vrte.quantities.of_brdf):
            assert pickle.loads(pickle.dumps(call)) is call


def list_public_calls() -> list[Any]:
    """Functions, classes and their methods with arguments, as users find them."""
    found: list[Any] = []
    for name in vrte.__all__:
        given = getattr(vrte, name)
        if inspect.ismodule(given):
            own = [one for one in vars(given).values() if getattr(one, "__module__", "") == given.__name__]
            found += [inspect.unwrap(one) for one in own if inspect.isfunction(one) and one.__name__[0] != "_"]
        elif not inspect.isclass(given):
            found.append(inspect.unwrap(given))
        elif not issubclass(given, BaseException):
            found.append(given)
            for key, one in inspect.getmembers(given):
                method = inspect.unwrap(getattr(one, "__func__", one))
                asked = inspect.isfunction(method) and len(inspect.signature(one).parameters) > inspect.isfunction(one)
                if asked and key[0] != "_" and key not in {*vars(Boundary), *vrte._INNER}:
                    found.append(method)
    return found
