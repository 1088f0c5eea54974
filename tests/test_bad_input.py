"""Bad input, found by machine: whatever is given, the answer is right or a SceneError says what is wrong, where."""

import contextlib
import io
import re
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import vrte
from vrte import cli
from vrte.formats.scene_file import make_scene_file
from vrte.formats.toml_table import parse_toml

from .helpers import assert_close

QUICK, FULL = {"calls": 60, "parts": 80, "files": 40}, {"calls": 1000, "parts": 800, "files": 600}
PATIENCE = 10.0  # seconds an example may take


class Sullen:
    """Something that refuses to be an array."""

    def __array__(self, *_: Any, **__: Any) -> Any:
        raise RuntimeError("no")

    def __repr__(self) -> str:
        return "Sullen()"


WHOLE = st.sampled_from([-(10**30), -1, 0, 1, 2, 3, 5, 5000, 2**31, 2**63, 10**30])  # no request of an hour's work
REAL = st.one_of(
    st.sampled_from([0.0, -0.0, 1.0, 0.5, -0.5, 1e-8, 9e-9, 5e-324, 1e308, -1e308, np.inf, -np.inf, np.nan, 1 + 1e-15]),
    st.floats(),
)
SCALAR = st.one_of(
    st.none(), st.booleans(), WHOLE, REAL, st.complex_numbers(), st.text(max_size=5), st.binary(max_size=5)
)
NUMBERS = st.lists(st.one_of(REAL, REAL, WHOLE), max_size=4)
ARRAYS = st.one_of(
    NUMBERS.map(lambda x: np.array(x, dtype=object)),
    st.lists(st.floats(0, 1), max_size=4).map(lambda x: np.array(x, np.float16)),
    st.sampled_from(
        [
            np.zeros((0,)),
            np.zeros((2, 2)),
            np.array(0.5),
            np.array(["a"]),
            np.array(["2026-01-01"], "datetime64[D]"),
            np.zeros(2, "f8,i4"),
            np.arange(8.0)[::3] / 8.0,
            np.ma.masked_array([0.5, 0.6], [0, 1]),
        ]
    ),
)
ODD = st.sampled_from([Sullen(), {}, {"a": 1}, [[1.0], [1.0, 2.0]], [[]], object, print, "x" * 1000, range(3), {0.5}])
JUNK = st.one_of(SCALAR, NUMBERS, ARRAYS, ODD, st.lists(SCALAR, max_size=3))


def tried(example: Callable[[], Any], *names: str) -> Any:
    """The result, or None after a SceneError in one sentence that has one of the names."""
    start = time.monotonic()
    try:
        return example()
    except vrte.SceneError as error:
        text = str(error)
        assert text.isprintable()
        assert "Traceback" not in text
        assert 0 < len(text) < 1000
        assert any(name in text for name in names), f"none of {names} in: {text}"
        return None
    finally:
        assert time.monotonic() - start < PATIENCE


def is_right(found: Any) -> None:
    """Finite, not negative, no more light than came in."""
    if isinstance(found, vrte.Field):
        assert np.isfinite(found.stokes).all()
        size = max(float(np.abs(found.incident_stokes).max()), 1e-300)
        if found.incident_stokes[0] >= np.sqrt((found.incident_stokes[1:] ** 2).sum()):
            assert found.stokes[..., 0].min(initial=0.0) >= -1e-9 * size
            assert np.all(found.flux_up[..., 0] <= found.mu0 * found.incident_stokes[0] * (1 + 1e-9))
        return
    assert np.isfinite(found.mueller).all()
    assert found.mueller[..., 0, 0].min(initial=0.0) >= -1e-9
    assert ((found.reflectance >= -1e-12) & (found.reflectance <= 1 + 1e-9)).all()


QUICKLY = {"nodes": 3, "threads": 1}
REQUESTS: dict[str, dict[str, Any]] = {
    "radiance": {"mu0": 0.6, "stokes": (1, 0, 0, 0), "mu": [0.5, -0.5], "phi": 0.0, "tau": 0.5, **QUICKLY},
    "brdf": {"mu_i": 0.6, "mu_o": [0.5, 1.0], "phi": [0, 90], "transmission": True, **QUICKLY},
}


@st.composite
def calls(draw: st.DrawFn) -> tuple[str, dict[str, Any], list[str]]:
    """A function, its keywords, and which of them are junk."""
    name = draw(st.sampled_from(sorted(REQUESTS)))
    request = dict(REQUESTS[name])
    extra = ["algorithm", "verify"]
    spoilt = draw(st.lists(st.sampled_from(sorted(request) + extra), min_size=1, max_size=2, unique=True))
    for field in spoilt:
        request[field] = draw(JUNK)
    if isinstance(request.get("threads"), int) and request["threads"] > 8:
        request["threads"] = -request["threads"]
    return name, request, spoilt


@st.composite
def layers(draw: st.DrawFn) -> vrte.Layer:
    """A layer that is right, however odd."""
    kind = draw(st.sampled_from([vrte.isotropic(), vrte.rayleigh(), vrte.henyey_greenstein(0.5, 9)]))
    albedo = draw(st.one_of(st.sampled_from([0.0, 1.0, 1 - 1e-12, 5e-324]), st.floats(0, 1)))
    return vrte.Layer(kind, albedo, draw(st.one_of(st.sampled_from([0.0, 5e-324, 1e-10, 0.5]), st.floats(0, 1e6))))


@given(calls(), st.lists(layers(), min_size=1, max_size=2), st.sampled_from([None, 0.0, 0.3, 1.0]))
def property_of_calls(call: tuple[str, dict[str, Any], list[str]], stack: list[vrte.Layer], base: float | None) -> None:
    name, request, spoilt = call
    scene = vrte.Scene(stack, None if base is None else vrte.Lambertian(base))
    if "tau" not in spoilt and "tau" in request:
        request["tau"] = scene.thickness / 2
    found = tried(lambda: getattr(vrte, name)(scene, **request), *spoilt, "memory")
    if found is not None:
        is_right(found)


PARTS: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
    "PhaseMatrix": (vrte.PhaseMatrix, {"a1": [1.0, 0.3], "a2": None, "a3": None, "a4": None, "b1": None, "b2": None}),
    "henyey_greenstein": (vrte.henyey_greenstein, {"g": 0.5, "terms": 9}),
    "rayleigh": (vrte.rayleigh, {"depolarization": 0.0}),
    "Layer": (vrte.Layer, {"phase_matrix": vrte.rayleigh(), "albedo": 0.9, "thickness": 1.0}),
    "Lambertian": (vrte.Lambertian, {"albedo": 0.3}),
    "Scene": (vrte.Scene, {"layers": [vrte.Layer(vrte.rayleigh(), 0.9, 1.0)], "base": None}),
    "MuellerBase": (vrte.MuellerBase, {"function": None}),
    "Gamma": (vrte.Gamma, {"r_eff_um": 0.2, "v_eff": 0.1}),
    "Lognormal": (vrte.Lognormal, {"median_um": 0.2, "sigma": 1.4}),
    "spheres": (vrte.spheres, {"material": 1.5, "radius_um": 0.05, "wavelength_um": 0.5, "size": None}),
}


@st.composite
def parts(draw: st.DrawFn) -> tuple[str, dict[str, Any], str]:
    """A constructor, its arguments and which one is junk."""
    name = draw(st.sampled_from(sorted(PARTS)))
    arguments = dict(PARTS[name][1])
    spoilt = draw(st.sampled_from(sorted(arguments)))
    arguments[spoilt] = draw(JUNK)
    if name == "spheres":  # a radius of a metre is a legal request of an hour's work
        for length in ("radius_um", "wavelength_um"):
            value = arguments[length]
            if isinstance(value, (int, float)) and value > 0 and not 1e-3 <= value <= 2:
                arguments[length] = -value
    return name, arguments, spoilt


@given(parts())
def property_of_parts(part: tuple[str, dict[str, Any], str]) -> None:
    name, arguments, spoilt = part
    words = {"layers": ("layer",), "depolarization": ("depolar",), "material": ("index", "k ")}
    tried(lambda: PARTS[name][0](**arguments), spoilt, *words.get(spoilt, ()), "phase matrix is not physical")


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
        index = draw(st.integers(0, len(lines) - 1))
        what = draw(st.sampled_from(["drop", "twice", "value", "key", "cut", "swap", "junk"]))
        key, equals, _ = lines[index].partition("=")
        if what == "drop":
            del lines[index]
        elif what == "twice":
            lines.insert(index, lines[index])
        elif what == "value" and equals:
            lines[index] = f"{key}= {draw(st.sampled_from(TOKENS))}"
        elif what == "key":
            lines[index] = draw(st.sampled_from(["x", "nodess", "[layer]", "[[layer]]", "albedo"])) + equals + " 1"
        elif what == "cut":
            lines[index] = lines[index][: len(lines[index]) // 2]
        elif what == "swap":
            other = draw(st.integers(0, len(lines) - 1))
            lines[index], lines[other] = lines[other], lines[index]
        else:
            lines.insert(index, draw(st.text(max_size=8)))
        lines = lines or [""]
    text = "\n".join(lines).encode("utf-8", "surrogatepass")
    return text + draw(st.sampled_from([b"", b"", b"", b"\xff\xfe", b"\x00"]))


@given(files())
def property_of_files(text: bytes) -> None:
    """Exit code 0 and a file, or 2, one line on standard error and no file."""
    with tempfile.TemporaryDirectory() as folder:
        scene, output = Path(folder, "scene.toml"), Path(folder, "out.nc")
        scene.write_bytes(text)
        errors, start = io.StringIO(), time.monotonic()
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(errors):
            code = cli.main(["brdf", str(scene), "-o", str(output), "--threads", "1"])
        assert time.monotonic() - start < PATIENCE
        if code == 0:
            assert np.isfinite(vrte.load(output).mueller).all()
            return
        assert code == 2
        assert {file.name for file in Path(folder).iterdir()} == {"scene.toml"}
        assert re.fullmatch(r"vrte: error: .*scene\.toml.*\n", errors.getvalue())


PROPERTIES = {"calls": property_of_calls, "parts": property_of_parts, "files": property_of_files}


@pytest.mark.parametrize(
    ("name", "examples"), [*QUICK.items(), *(pytest.param(*one, marks=pytest.mark.slow) for one in FULL.items())]
)
def test_a_right_answer_or_a_clear_error(name: str, examples: int) -> None:
    """With examples that are the same every time."""
    how: dict[str, Any] = {"deadline": None, "suppress_health_check": list(HealthCheck)}
    settings(max_examples=examples, derandomize=True, database=None, **how)(PROPERTIES[name])()


def spoiling(mu_i: Any, mu_o: Any, phi_deg: Any) -> Any:
    """A Lambertian base whose function overwrites the arrays it is given."""
    f = np.zeros((*np.broadcast_shapes(mu_i.shape, mu_o.shape, phi_deg.shape), 4, 4))
    f[..., 0, 0] = 0.3 / np.pi
    for values in (mu_i, mu_o, phi_deg):
        values[...] = np.nan
    return f


def test_a_base_may_overwrite_what_it_is_given() -> None:
    layer = vrte.Layer(vrte.rayleigh(), 0.9, 0.5)
    request: dict[str, Any] = {"mu_i": 0.5, "mu_o": [0.5, 1.0], "phi": [0.0, 90.0], "nodes": 4, "threads": 1}
    found = vrte.brdf(vrte.Scene([layer], vrte.MuellerBase(spoiling)), **request)
    expected = vrte.brdf(vrte.Scene([layer], vrte.Lambertian(0.3)), **request)
    assert_close(found.mueller, expected.mueller, rtol=0.0, atol=1e-13)


PLAIN = vrte.Layer(vrte.isotropic(), 0.5, 1.0)
SCENE = vrte.Scene(PLAIN)
ANSWERS: list[tuple[Callable[[], Any], str]] = [
    (lambda: vrte.Layer(vrte.isotropic(), True, 1.0), "Layer: albedo"),
    (lambda: vrte.Layer(vrte.isotropic(), "0.5", 1.0), "Layer: albedo"),
    (lambda: vrte.Layer(vrte.isotropic(), 0.5, 1e13), "layer: thickness"),
    (lambda: vrte.Scene([PLAIN] * 10_001), "layers"),
    (lambda: vrte.brdf(SCENE, 0.5, np.array([0.5 + 1e-3j]), 0.0, nodes=2), "mu_o"),
    (lambda: vrte.brdf(SCENE, 0.5, np.ma.masked_array([0.5, 0.6], [0, 1]), 0.0, nodes=2), "mu_o"),
    (lambda: vrte.brdf(SCENE, 0.5, np.broadcast_to(0.5, 10**12), 0.0, nodes=2), "mu_o"),
    (lambda: vrte.radiance(SCENE, 0.5, (1e200, 0, 0, 0), 0.5, 0.0, 0.0, nodes=2), "stokes"),
    (lambda: vrte.spheres(1e-5, radius_um=0.1, wavelength_um=0.5), "index"),
    (lambda: vrte.spheres(1.5, radius_um=0.1, wavelength_um="0.5"), "wavelength_um"),
    (lambda: vrte.henyey_greenstein(1 - 1e-9, 50), "at most"),
    (lambda: make_scene_file(parse_toml('"a\\nb" = 1')), "a\\nb"),
    (lambda: parse_toml("a" + ".a" * 5000 + " = 1"), "30 keys"),
    (lambda: parse_toml("nodes = " + "9" * 5000), "4000 digits"),
    # what the machine found: it hung, overflowed, raised what the object raised, and gave two lines
    (lambda: vrte.spheres(1e308, radius_um=1.0, wavelength_um=0.5), "n and k must be at most 10000"),
    (lambda: vrte.PhaseMatrix([1.0], b1=[0.0, 0.0, 1e308]), "b1 holds 1e+308"),
    (lambda: vrte.rayleigh(Sullen()), "depolar"),
    (lambda: vrte.Lambertian(np.array([1.0, 2.0, 1.0 + 1e-15], dtype=object)), "Lambertian: albedo must be a number"),
    # a flag is true or false, and an empty array is neither
    *[
        (lambda value=value: vrte.brdf(SCENE, 0.5, 0.5, nodes=2, transmission=value), "transmission must be True or")
        for value in (np.array([]), 1, "yes", None)
    ],
    (lambda: vrte.brdf(SCENE, 0.5, 0.5, nodes=2, verify=np.array([])), "verify must be True or False"),
]


@pytest.mark.parametrize(("call", "named"), ANSWERS)
def test_refused_by_name(call: Callable[[], Any], named: str) -> None:
    with pytest.raises(vrte.SceneError) as caught:
        call()
    assert named in str(caught.value)
    assert str(caught.value).isprintable()
