"""All methods beside the exact one: what they take, and that they solve the same discrete problem."""

from functools import cache
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.basics.errors import SceneError
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
# settings of methods on nodes, and the errors that they leave then, over the largest I
FINE = {
    "adding-doubling": ({"start": 4}, 1e-12),
    "invariant-imbedding": ({"rtol": 1e-10}, 1e-9),
    "matrix-operator": ({}, 1e-11),
    "successive-orders": ({"tolerance": 1e-12, "levels": 160}, 1e-11),
}
ISOTROPIC, RAYLEIGH = vrte.isotropic(), vrte.rayleigh()
LEAF = vrte.MuellerBase(make_leaf)  # polarizes, and reflects other azimuthal orders than 0
GLASS, SILVER = vrte.Interface(1.0, 1.5), vrte.Mirror((0.05, 3.0))


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


def few_nodes(method: Method) -> dict[str, Any]:
    """Four, of a method that has nodes."""
    return {"nodes": 4} if "nodes" in method.options else {}


def layers(phase: vrte.PhaseMatrix = ISOTROPIC, thickness: float = 1.0) -> list[vrte.Layer]:
    return [vrte.Layer(phase, 0.9, thickness)]


REFUSED = {
    "polarization": (vrte.Scene(layers(phase=RAYLEIGH)), "phase matrix that polarizes"),
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
    asked = {"mu_i": 0.6, "mu_o": [0.3, 0.9], "method": method.name, **few_nodes(method)}
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


# Their light on the scenes of tests/scenes.py: tests/test_every_way.py.


def compare(found: np.ndarray, right: np.ndarray, left: float) -> None:
    """Within that part of the largest, at least 1e-13: light and fluxes of incident light of flux 1."""
    assert_close(found, right, rtol=0.0, atol=left * max(float(np.abs(right).max(initial=0.0)), 0.01))


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


def test_energy(method: Method) -> None:
    """Whether it says so or not: what conserves energy does to rounding, over a white base and without one, and what
    leaves more than that does not say so."""
    stack = [vrte.Layer(vrte.henyey_greenstein(0.5, 12), 1.0, 0.3), vrte.Layer(ISOTROPIC, 1.0, 1.0)]
    lost = []
    for base in (None, vrte.Lambertian(1.0)) if method.base != "none" else (None,):
        field = vrte.radiance(
            vrte.Scene(stack, base), 0.6, mu=[], tau=[0.0, 1.3], method=method.name, **few_nodes(method)
        )
        net = field.flux_down + field.direct - field.flux_up
        lost.append(np.abs(net - (net[0] if base is None else 0.0)).max())
    assert (max(lost) <= 1e-12) == method.conserves_energy


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
    "aerosol over sea": vrte.Scene(
        [
            vrte.Layer(vrte.henyey_greenstein(0.3, 5), 0.95, 0.4),
            vrte.Interface(1.0, 1.34),
            vrte.Layer(RAYLEIGH, 0.8, 1),
        ],
        vrte.Lambertian(0.1),
    ),
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
    return field_of(scene, **({"nodes": 40} if scene.needs_beam_paths else {"accuracy": 1e-12}))


@pytest.mark.parametrize("accuracy", [1e-2, 1e-4, pytest.param(1e-6, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", slow_but(CONTINUOUS, *tuple(CONTINUOUS)[:2]))
@pytest.mark.parametrize("method", BY_ACCURACY)
def test_accuracy(method: str, name: str, accuracy: float) -> None:
    """Of the continuous problem, relative to the largest I at each depth, on nodes chosen for it."""
    scene = CONTINUOUS[name]
    if scene.needs_beam_paths and method not in TAKES_INTERFACES:
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
