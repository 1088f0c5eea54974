"""All methods beside the exact one: what they take, and that they solve the same discrete problem."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import vrte
from vrte.basics.errors import SceneError
from vrte.cli import main
from vrte.discrete_ordinates.planning import choose_quadrature
from vrte.methods import find_method
from vrte.methods.parts.method import Method
from vrte.request.how import EXACT, METHODS

from . import exact
from .helpers import assert_close
from .samples import slow_but
from .scenes import make_leaf

OTHERS = tuple(name for name in METHODS if name != EXACT)
BY_ACCURACY = [name for name in OTHERS if "accuracy" in find_method(name).options]
TAKES_INTERFACES = [name for name in OTHERS if find_method(name).interfaces != "none"]
MU, PHI = np.array([0.3, 0.8]), np.array([0.0, 40.0, 180.0])
STOKES, Q = [1.0, 0.3, -0.2, 0.4], [1.0, 1.0, 1.0, -1.0]
# settings of methods on nodes, and the errors that they leave then without and with interfaces, over the largest I
FINE = {
    "adding-doubling": ({"start": 4}, 1e-12, 1e-12),
    "invariant-imbedding": ({"rtol": 1e-10}, 1e-9, np.nan),
    "matrix-operator": ({}, 1e-11, 1e-13),
    "successive-orders": ({"tolerance": 1e-12, "levels": 160}, 1e-11, 1e-11),
}
ISOTROPIC, RAYLEIGH, HAZE = vrte.isotropic(), vrte.rayleigh(), vrte.henyey_greenstein(0.3, 5)
SPHERES = vrte.spheres((1.5, 2.0), radius_um=0.05, wavelength_um=0.5).phase_matrix  # with b2: V, and signs of U and V
THIN = vrte.Scene([vrte.Layer(ISOTROPIC, albedo=0.5, thickness=0.1)])
LEAF = vrte.MuellerBase(make_leaf)  # polarizes, and reflects other azimuthal orders than 0
GLASS, WATER, SILVER = vrte.Interface(1.0, 1.5), vrte.Interface(1.0, 1.34), vrte.Mirror((0.05, 3.0))


@pytest.fixture(params=OTHERS)
def method(request: pytest.FixtureRequest) -> Method:
    """Every one of them."""
    return find_method(request.param)


@pytest.fixture(params=sorted(FINE))
def fine(request: pytest.FixtureRequest) -> dict[str, object]:
    """A method on nodes and its settings, as arguments of a call."""
    return {"method": request.param, "settings": FINE[request.param][0], "nodes": 5}


def test_what_it_says_of_itself(method: Method) -> None:
    assert find_method(method.name) is method
    assert method.purpose
    assert method.conserves
    assert "(2:" in method.source or "(1:" in method.source
    for name, setting in method.settings.items():
        assert setting.meaning
        assert setting.checked(setting.default) == setting.default, name
    with pytest.raises(SceneError, match=f"method '{method.name}' has no setting 'nonsense'"):
        vrte.brdf(THIN, MU, MU, method=method.name, settings={"nonsense": 1})


def layers(count: int = 1, phase: vrte.PhaseMatrix = ISOTROPIC, thickness: float = 1.0) -> list[vrte.Layer]:
    return [vrte.Layer(phase, 0.9, thickness)] * count


REFUSED = {
    "polarization": (vrte.Scene(layers(phase=RAYLEIGH)), "phase matrix that polarizes"),
    "layers": (vrte.Scene(layers(2)), "stack of several layers"),
    "base": (vrte.Scene(layers(), vrte.Lambertian(0.5)), "base"),
    "semi_infinite": (vrte.Scene(layers(thickness=np.inf)), "semi-infinite layer"),
    "interfaces": (vrte.Scene([GLASS, *layers()]), "refracting or mirroring surface"),
    "interfaces below": (vrte.Scene([*layers(), GLASS.turned]), "refracting or mirroring surface"),
    "interfaces, a mirror": (vrte.Scene(layers(), SILVER), "refracting or mirroring surface"),
    "rough": (vrte.Scene([vrte.Interface(1.0, 1.5, roughness=0.2), *layers()]), "rough interface"),
}


@pytest.mark.parametrize("ability", REFUSED)
def test_what_it_does_not_take_is_refused_by_name(method: Method, ability: str) -> None:
    """And what is taken is seen: light is not what it would be without."""
    scene, words = REFUSED[ability]
    name = ability.split(",")[0].split()[0]
    taken = method.interfaces if name in ("interfaces", "rough") else getattr(method, name)
    if name == "rough" and taken == "none":
        words = "refracting or mirroring surface"
    asked = {"mu_i": 0.6, "mu_o": [0.3, 0.9], "nodes": 4, "method": method.name}
    if taken in (False, "none") or (name == "rough" and taken == "smooth"):
        with pytest.raises(SceneError, match=f"method '{method.name}' takes no {words}: ask for '{EXACT}'") as refused:
            vrte.brdf(scene, **asked)
        assert refused.value.place == ("method",)
        return
    transmitted = method.name == "small-angle"
    plain = vrte.brdf(vrte.Scene(layers(thickness=0.5)), transmission=transmitted, **asked)
    found = vrte.brdf(scene, transmission=transmitted and bool(np.isfinite(scene.thickness)), **asked)
    if not transmitted:
        assert np.abs(found.mueller - plain.mueller).max() > 1e-3


OPTIONS = {"accuracy": 1e-4, "backend": "opencl", "verify": True, "algorithm": "auto", "truncation": "delta-m"}


@pytest.mark.parametrize("option", OPTIONS)
def test_options_that_it_does_not_use_are_refused_by_name(method: Method, option: str) -> None:
    """Also with the value that is the default: who asks for it shall not think that it does something."""
    asked = {"mu_i": 0.5, "mu_o": 0.5, "method": method.name, option: OPTIONS[option]}
    if option in method.options and option != "backend":
        if method.name != "synthetic-iteration":
            assert vrte.brdf(THIN, **asked).mueller[0, 0, 0, 0, 0] > 0.0
        return
    refused = rf"method '{method.name}' takes no {option}"
    for call in (
        lambda: vrte.brdf(THIN, **asked),
        lambda: vrte.plan("brdf", THIN, **asked),
        lambda: vrte.radiance(THIN, 0.5, mu=0.5, method=method.name, **{option: OPTIONS[option]}),
    ):
        with pytest.raises(SceneError, match=refused):
            call()


CALLS = [
    (lambda: vrte.radiance(THIN, 0.5, tau=0.05, method="invariant-imbedding"), "takes no depth inside a layer"),
    *(
        (lambda name=name: vrte.brdf(vrte.Scene(layers(), LEAF), 0.5, 0.5, method=name), words)
        for name in ("two-stream", "diffusion", "synthetic-iteration")
        for words in [f"method '{name}' takes no base but a Lambertian one"]
    ),
    (lambda: vrte.brdf(THIN, MU, MU, method="magic"), r"method must be 'discrete-ordinates', .*, not 'magic'"),
    (lambda: vrte.brdf(THIN, MU, MU, method=OTHERS[0], settings=[1]), "settings must be a dictionary"),
    (lambda: vrte.brdf(THIN, MU, MU, settings={"orders": 3}), "method 'discrete-ordinates' has no settings"),
    (
        lambda: vrte.plan("brdf", THIN, 0.5, 0.5, method="adding-doubling"),
        "there are plans of 'discrete-ordinates' and 'auto'",
    ),
]


@pytest.mark.parametrize(("call", "words"), CALLS)
def test_calls_that_are_refused(call: Callable[[], object], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        call()


def test_files_and_spectra_are_refused_alike(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content = 'method = "diffusion"\n[[layer]]\nphase = "isotropic"\nalbedo = 1\nthickness = 0.5\n'
    asked = "[brdf]\nmu_i = 0.5\nmu_o = 0.5\n"
    scene, out = tmp_path / "scene.toml", str(tmp_path / "out.nc")
    scene.write_text(content + asked)
    for options in (["--accuracy", "1e-3"], ["--verify"], ["--algorithm", "modes"]):
        assert main(["brdf", str(scene), "-o", out, *options]) == 2
        assert f"takes no {options[0][2:]}" in capsys.readouterr().err
    assert main(["brdf", str(scene), "-o", out]) == 0
    scene.write_text("accuracy = 1e-3\n" + content + asked)
    assert main(["brdf", str(scene), "-o", out]) == 2
    assert "takes no accuracy: it goes by nodes and truncation, and its settings boundary" in capsys.readouterr().err
    with pytest.raises(SceneError, match="takes no accuracy, algorithm: it goes by nodes"):
        vrte.spectrum(scene, [0.5, 0.6], algorithm="modes")


# beside the scenes of tests/scenes.py, which every method is tried on: tests/test_every_way.py
TWO = [vrte.Layer(HAZE, 0.95, 0.4), vrte.Layer(RAYLEIGH, 0.9, 0.8)]
SAME = {
    "stack over Mueller": vrte.Scene(TWO, LEAF),
    "scalar over Mueller": vrte.Scene([vrte.Layer(ISOTROPIC, 0.9, 0.5)], LEAF),
    "clear and empty layers": vrte.Scene([vrte.Layer(HAZE, 0.9, 0.0), vrte.Layer(ISOTROPIC, 0.0, 0.5), TWO[0]]),
    "spheres": vrte.Scene([vrte.Layer(SPHERES, 0.95, 1.0)]),
    "white, thick": vrte.Scene([vrte.Layer(RAYLEIGH, 1.0, 1e4)]),
    "nearly white, thick": vrte.Scene([vrte.Layer(RAYLEIGH, 1.0 - 1e-12, 1e4)]),
    "semi-infinite": vrte.Scene([vrte.Layer(RAYLEIGH, 0.99, np.inf)]),
    "semi-infinite, dark": vrte.Scene([vrte.Layer(HAZE, 0.5, np.inf)]),
    "semi-infinite, polarizing, white": vrte.Scene([vrte.Layer(RAYLEIGH, 1.0, np.inf)]),
    "semi-infinite, nearly white": vrte.Scene([vrte.Layer(ISOTROPIC, 1.0 - 1e-6, np.inf)]),
    "upon semi-infinite": vrte.Scene([vrte.Layer(RAYLEIGH, 0.9, 0.5), vrte.Layer(HAZE, 0.99, np.inf)]),
    "varnish over paint": vrte.Scene(
        [GLASS, vrte.Layer(HAZE, 0.3, 0.1), vrte.Interface(1.5, 1.33), vrte.Layer(RAYLEIGH, 0.95, 1.0)],
        vrte.Lambertian(0.4),
    ),
    "aerosol over sea": vrte.Scene([TWO[0], WATER, vrte.Layer(RAYLEIGH, 0.8, 1.0)], vrte.Lambertian(0.1)),
    "glass, semi-infinite": vrte.Scene([GLASS, vrte.Layer(RAYLEIGH, 0.99, np.inf)]),
    "glass, semi-infinite, white": vrte.Scene([GLASS, vrte.Layer(HAZE, 1.0, np.inf)]),
}
QUICK = (
    "stack over Mueller",
    "spheres",
    "semi-infinite",
    "upon semi-infinite",
    "clear and empty layers",
    "varnish over paint",
)


def compare(found: np.ndarray, right: np.ndarray, left: float) -> None:
    """Within that part of the largest, at least 1e-13: light and fluxes of incident light of flux 1."""
    assert_close(found, right, rtol=0.0, atol=left * max(float(np.abs(right).max(initial=0.0)), 0.01))


@pytest.mark.parametrize("name", slow_but(SAME, *QUICK))
def test_the_same_on_the_same_nodes(fine: dict[str, object], name: str) -> None:
    """As discrete ordinates: fields of a polarized beam at the faces, inside and on either side of interfaces, along
    nodes, near them and near the beam's own; their fluxes; and the reflection of any light, from below as well."""
    scene, taken = SAME[name], find_method(str(fine["method"]))
    if (name.endswith("thick") and taken.name != "matrix-operator") or (
        scene.keeps_beams and taken.interfaces == "none"
    ):
        pytest.skip("not claimed")
    ends = bool(np.isfinite(scene.thickness))
    if not (ends or taken.semi_infinite):
        pytest.skip("not claimed")
    left = FINE[taken.name][2 if scene.keeps_beams else 1]
    if name.startswith("semi-infinite"):
        left = 1e-10 if "nearly" in name else min(left, 1e-10)
    depths = np.cumsum([0.0, *(layer.thickness for layer in scene.layers)])
    last = scene.thickness if ends else 1.0
    inside = [0.2 * last, 0.45 * last] if taken.depths and last else []
    faces = depths[np.isfinite(depths)] if taken.depths else [0.0, scene.thickness][: 1 + ends]
    mu = [0.5, 0.5 * (1.0 + 1e-9), 0.2, 1.0, -0.2, -0.5, -0.500001, -1.0]
    asked = {"mu": mu, "phi": PHI, "tau": np.unique([*faces, *inside])}
    lower = [d for d, each in zip(depths, scene.interfaces, strict=False) if each and np.isfinite(d)]
    lower = [d for d in lower if scene.thickness and (d < scene.thickness or scene.base is None)]
    for sides in [{}, {"tau": lower, "side": "below"}] if lower else [{}]:
        right = exact.radiance(scene, 0.5, STOKES, **asked | sides, nodes=5)
        found = vrte.radiance(scene, 0.5, STOKES, **asked | sides, **fine)
        brightest = np.maximum(right.stokes[..., 0].max(axis=(1, 2)), 1e-290)[:, None, None, None]
        if not name.endswith("thick"):
            assert_close(found.stokes / brightest, right.stokes / brightest, rtol=0.0, atol=10.0 * left)
        compare(found.stokes, right.stokes, left)
        compare(found.flux_up, right.flux_up, left)
        compare(found.flux_down, right.flux_down, left)
    mu_o = [0.3, 0.8, 0.05] if scene.keeps_beams else MU  # what is mirrored goes along the lowest cosine, too
    for side in ("top", "bottom") if ends and scene.base is None else ("top",):
        both = ({"nodes": 5, "accuracy": 1e-13, "truncation": "none"}, fine)
        tables = [vrte.brdf(scene, MU, mu_o, PHI, transmission=ends, illuminate=side, **how) for how in both]
        for values in ("mueller", "transmission") if ends else ("mueller",):
            compare(getattr(tables[1], values), getattr(tables[0], values), left)
        for values in ("specular", "specular_transmission", "direct_transmittance"):
            np.testing.assert_array_equal(*(getattr(each, values) for each in tables))
    if side == "top" and "Mueller" not in name:  # Helmholtz: light sent back along its way
        there = tables[1].mueller[:, :2]
        compare(there.transpose(1, 0, 2, 4, 3) * np.outer(Q, Q), there, 20.0 * left)


def test_one_node_and_neighbouring_cosines(fine: dict[str, object]) -> None:
    """One node stays one; and 1/mu of neighbours may be the same number."""
    scene = vrte.Scene([vrte.Layer(ISOTROPIC, 0.9, 2.0)], vrte.Lambertian(0.3))
    mu = np.array([0.7, np.nextafter(0.7, 1.0), np.nextafter(0.7, 0.0), 0.3])
    for nodes in (1, 4):
        found, right = vrte.brdf(scene, mu, mu, **fine | {"nodes": nodes}), exact.brdf(scene, mu, mu, nodes=nodes)
        compare(found.mueller, right.mueller, FINE[str(fine["method"])][1])
        assert found.diagnostics["nodes"] == nodes


@pytest.mark.parametrize("thickness", [5e-324, 1e-310, 1e-20])
def test_the_thinnest_layers_scatter_once(fine: dict[str, object], thickness: float) -> None:
    """And no arithmetic goes wrong on the way."""
    scene, method = vrte.Scene([vrte.Layer(RAYLEIGH, 0.9, thickness)]), str(fine["method"])
    found, once = (
        vrte.brdf(scene, [0.5, 0.05], 0.5, nodes=8, method=name, transmission=True)
        for name in (method, "single-scattering")
    )
    # the matrix operator holds what passes unscattered as well, 1e-16 of which is more than this
    for values in ("mueller",) if method == "matrix-operator" else ("mueller", "transmission"):
        right = getattr(once, values)
        assert_close(getattr(found, values), right, rtol=0.0, atol=1e-320 + 1e-9 * np.abs(right).max())
    assert_close(found.reflectance, once.reflectance, rtol=1e-6, atol=1e-320)


def test_thin_layers_scatter_once(method: Method) -> None:
    """Linear in the thickness, and the phase function's shape."""
    if method.name in ("two-stream", "diffusion", "small-angle"):
        pytest.skip("not claimed")
    phase = RAYLEIGH if method.polarization else vrte.henyey_greenstein(0.5, 12)
    scene = vrte.Scene([vrte.Layer(phase, 0.9, 1e-6)])
    found, once = (vrte.brdf(scene, MU, MU, PHI, nodes=8, method=name) for name in (method.name, "single-scattering"))
    compare(found.mueller, once.mueller, 1e-4)


def h_function(mu: np.ndarray, albedo: float, nodes: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Ambarzumian's and Chandrasekhar's: 1/H = sqrt(1 - omega) + omega/2 times the integral of u H(u)/(u + mu) du,
    iterated on nodes; every other iterate lies above, so that means of two converge quickly."""

    def of(cosines: np.ndarray, on_nodes: np.ndarray) -> np.ndarray:
        inner = nodes * weights * on_nodes / (cosines[:, None] + nodes)
        return 1.0 / (np.sqrt(1.0 - albedo) + 0.5 * albedo * inner.sum(axis=1))

    found = np.ones(nodes.size)
    for _ in range(400):
        found = 0.5 * (found + of(nodes, found))
    return of(mu, found)


@pytest.mark.parametrize("albedo", [0.3, 0.9, 0.99])
def test_isotropic_semi_infinite_layer(fine: dict[str, object], albedo: float) -> None:
    """f = omega/(4 pi) H(mu) H(mu')/(mu + mu'), on many nodes."""
    if not find_method(str(fine["method"])).semi_infinite:
        pytest.skip("not claimed")
    scene = vrte.Scene([vrte.Layer(ISOTROPIC, albedo, np.inf)])
    points, weights = np.polynomial.legendre.leggauss(60)
    h = h_function(MU, albedo, 0.5 * (points + 1.0), 0.5 * weights)
    right = albedo / (4.0 * np.pi) * h[:, None] * h / (MU[:, None] + MU)
    found = vrte.brdf(scene, MU, MU, **(fine | {"nodes": 24}))
    assert_close(found.mueller[:, :, 0, 0, 0], right, rtol=1e-8, atol=0.0)


def test_energy(method: Method) -> None:
    """Whether it says so or not: what conserves energy does to rounding, over a white base and without one, and what
    leaves more than that does not say so."""
    stack = [vrte.Layer(vrte.henyey_greenstein(0.7, 30), 1.0, 0.3), vrte.Layer(ISOTROPIC, 1.0, 1.0)]
    lost = []
    for base in (None, vrte.Lambertian(1.0)) if method.base != "none" else (None,):
        field = vrte.radiance(vrte.Scene(stack, base), 0.6, mu=[], tau=[0.0, 1.3], method=method.name, nodes=8)
        net = field.flux_down + field.direct - field.flux_up
        lost.append(np.abs(net - (net[0] if base is None else 0.0)).max())
    assert (max(lost) <= 1e-12) == method.conserves_energy


def test_light_from_below(method: Method) -> None:
    """A layer alone has no top: the same from both sides, whatever the method."""
    phase = RAYLEIGH if method.polarization else vrte.henyey_greenstein(0.5, 12)
    above, below = (
        vrte.brdf(
            vrte.Scene([vrte.Layer(phase, 0.9, 0.7)]), MU, MU, PHI, transmission=True, illuminate=side, nodes=8,
            method=method.name,
        )
        for side in ("top", "bottom")
    )  # fmt: skip
    flip = np.outer([1, 1, -1, -1], [1, 1, -1, -1])
    np.testing.assert_array_equal(below.mueller, above.mueller * flip)
    np.testing.assert_array_equal(below.transmission, above.transmission * flip)


@pytest.mark.parametrize("method", [EXACT, *TAKES_INTERFACES])
def test_a_base_sends_all_its_orders_to_and_fro(method: str) -> None:
    """Below a surface also where no particle scatters that many: the clear layer's number of terms means nothing."""
    how = {"truncation": "none"} if method == EXACT else {"settings": FINE[method][0]}
    found = [
        vrte.brdf(
            vrte.Scene([GLASS, vrte.Layer(phase, 0.0, 0.1)], LEAF), [0.3, 0.8], [0.2, 0.9],
            phi=[0.0, 70.0], nodes=6, method=method, **how,
        ).mueller
        for phase in (ISOTROPIC, vrte.henyey_greenstein(0.5, 6))
    ]  # fmt: skip
    compare(*found, 1e-11)


@pytest.mark.parametrize("name", [*sorted(FINE), "synthetic-iteration"])
def test_an_interrupt_ends_what_takes_long(name: str) -> None:
    reported = []

    def interrupted(done: int, total: int) -> None:
        reported.append((done, total))
        raise KeyboardInterrupt

    settings = {"iterations": 3} if name == "synthetic-iteration" else {}
    scene = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.5, 12), 0.9, 1.0)])
    with pytest.raises(KeyboardInterrupt):
        vrte.brdf(scene, MU, MU, PHI, nodes=6, method=name, settings=settings, progress=interrupted)
    assert len(reported) == 1
    assert reported[0][0] < reported[0][1]


CONTINUOUS = {
    "thin, white": vrte.Scene([vrte.Layer(ISOTROPIC, 1.0, 0.05)]),
    "aerosol over sea": SAME["aerosol over sea"],
    "Rayleigh": vrte.Scene([vrte.Layer(RAYLEIGH, 0.99, 1.0)]),
    "over a base": vrte.Scene(
        [vrte.Layer(RAYLEIGH, 0.9, 0.3), vrte.Layer(vrte.henyey_greenstein(0.4, 8), 0.9, 2.0)], vrte.Lambertian(0.5)
    ),
    "peaked": vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.7, 30), 0.9, 3.0)]),
}


def field_of(scene: vrte.Scene, **how: object) -> vrte.Field:
    """Light at the faces, off the nodes."""
    asked = {"mu": [0.1, 0.5, 1.0, -0.2, -0.7], "phi": PHI, "tau": [0.0, scene.thickness]}
    return vrte.radiance(scene, 0.6, stokes=[1.0, 0.3, 0.2, 0.5], **asked, **how)


@cache
def converge(name: str) -> vrte.Field:
    """The exact method's field, far beyond what is asked for."""
    scene = CONTINUOUS[name]
    return field_of(scene, **({"nodes": 40} if scene.keeps_beams else {"accuracy": 1e-12}))


@pytest.mark.parametrize("accuracy", [1e-2, 1e-4, pytest.param(1e-6, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", slow_but(CONTINUOUS, *tuple(CONTINUOUS)[:2]))
@pytest.mark.parametrize("method", BY_ACCURACY)
def test_accuracy(method: str, name: str, accuracy: float) -> None:
    """Of the continuous problem, relative to the largest I at each depth, on nodes chosen for it."""
    scene = CONTINUOUS[name]
    if scene.keeps_beams and method not in TAKES_INTERFACES:
        pytest.skip("not claimed")
    found = field_of(scene, method=method, accuracy=accuracy)
    right = converge(name).stokes
    off = np.abs(found.stokes - right).reshape(2, -1).max(axis=1) / right[..., 0].reshape(2, -1).max(axis=1)
    assert off.max() <= accuracy
    assert found.diagnostics["promised"], found.diagnostics["notes"]
    assert found.diagnostics["accuracy"] == accuracy
    assert found.diagnostics["achieved"] <= accuracy


@pytest.mark.parametrize("method", BY_ACCURACY)
def test_the_discrete_problem_is_solved_to_the_finest_accuracy(method: str) -> None:
    """On nodes that are given the accuracy is that of the discrete problem; a finer one is refused, not missed."""
    finest, scene = find_method(method).finest, CONTINUOUS["Rayleigh"]
    right = field_of(scene, nodes=6, accuracy=1e-14).stokes
    found = field_of(scene, nodes=6, accuracy=finest, method=method).stokes
    assert np.abs(found - right).max() <= finest * right[..., 0].reshape(2, -1).max(axis=1).min()
    with pytest.raises(SceneError, match=rf"method '{method}' keeps an accuracy of {finest:g} at best") as refused:
        field_of(scene, accuracy=0.5 * finest, method=method)
    assert refused.value.place == ("accuracy",)


def test_an_accuracy_that_cannot_be_promised_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(choose_quadrature, "SERIES", (4, 6))
    made = vrte.brdf(CONTINUOUS["thin, white"], 0.01, 0.5, method="adding-doubling", accuracy=1e-3).diagnostics
    assert not made["promised"]
    assert "6 nodes differ by" in made["notes"][0]
