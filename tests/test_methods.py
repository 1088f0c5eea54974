"""One body of tests over all methods beside the exact one."""

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

from .helpers import assert_close

OTHERS = tuple(name for name in METHODS if name != EXACT)
MU, PHI = np.array([0.3, 0.8]), np.array([0.0, 40.0, 180.0])


@pytest.fixture(params=OTHERS)
def method(request: pytest.FixtureRequest) -> Method:
    """Every one of them."""
    return find_method(request.param)


def test_what_it_says_of_itself(method: Method) -> None:
    assert find_method(method.name) is method
    assert method.purpose
    assert method.conserves
    assert "(2:" in method.source or "(1:" in method.source
    for name, setting in method.settings.items():
        assert setting.meaning
        assert setting.checked(setting.default) == setting.default, name


def test_unknown_settings_are_refused(method: Method) -> None:
    scene = vrte.Scene([vrte.Layer(vrte.isotropic(), 0.9, 1.0)])
    with pytest.raises(SceneError, match=f"method '{method.name}' has no setting 'nonsense'"):
        vrte.brdf(scene, MU, MU, method=method.name, settings={"nonsense": 1})


def test_what_it_does_not_take_is_refused(method: Method) -> None:
    layer = vrte.Layer(vrte.isotropic(), 0.9, 1.0)
    cases = {
        "polarization": (vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)]), "phase matrix that polarizes"),
        "layers": (vrte.Scene([layer, layer]), "pile of several layers"),
        "base": (vrte.Scene([layer], vrte.Lambertian(0.5)), "base"),
        "endless": (vrte.Scene([vrte.Layer(vrte.isotropic(), 0.9, np.inf)]), "layer without end"),
    }
    for ability, (scene, words) in cases.items():
        if getattr(method, ability) in (False, "none"):
            with pytest.raises(SceneError, match=f"method '{method.name}' takes no {words}"):
                vrte.brdf(scene, MU, MU, method=method.name)
    if not method.depths:
        with pytest.raises(SceneError, match=f"method '{method.name}' takes no depth inside a layer"):
            vrte.radiance(vrte.Scene([layer]), 0.5, tau=0.5, method=method.name)


def test_names() -> None:
    scene = vrte.Scene([vrte.Layer(vrte.isotropic(), 0.9, 1.0)])
    with pytest.raises(SceneError, match=r"method must be 'discrete-ordinates', .*, not 'magic'"):
        vrte.brdf(scene, MU, MU, method="magic")
    with pytest.raises(SceneError, match="settings must be a dictionary"):
        vrte.brdf(scene, MU, MU, method=OTHERS[0], settings=[1])
    with pytest.raises(SceneError, match="method 'discrete-ordinates' has no settings"):
        vrte.brdf(scene, MU, MU, settings={"orders": 3})


NOT_THIN = {"two-stream", "diffusion", "small-angle"}  # what they do not claim


def test_thin_layers_scatter_once(method: Method) -> None:
    """Linear in the thickness, and the phase function's shape."""
    if method.name in NOT_THIN:
        pytest.skip("not claimed")
    phase = vrte.rayleigh() if method.polarization else vrte.henyey_greenstein(0.5, 12)
    scene = vrte.Scene([vrte.Layer(phase, 0.9, 1e-6)])
    found = vrte.brdf(scene, MU, MU, PHI, nodes=8, method=method.name)
    once = vrte.brdf(scene, MU, MU, PHI, nodes=8, method="single-scattering")
    assert_close(found.mueller, once.mueller, rtol=0.0, atol=1e-4 * np.abs(once.mueller).max())


def test_energy(method: Method) -> None:
    """Whether it says so or not: what conserves energy does to rounding, in a pile of layers over a white base and
    without one, and what leaves more than that does not say so."""
    phase = vrte.henyey_greenstein(0.7, 30)
    layers = [vrte.Layer(phase, 1.0, 0.3), vrte.Layer(vrte.isotropic(), 1.0, 4.0)] if method.layers else []
    layers = layers or [vrte.Layer(phase, 1.0, 4.0)]
    bases = [None, vrte.Lambertian(1.0)] if method.base != "none" else [None]
    lost = []
    for base in bases:
        scene = vrte.Scene(layers, base)
        tau = [0.0, scene.thickness] if method.transmission else [0.0]
        field = vrte.radiance(scene, 0.6, mu=[], tau=tau, method=method.name, nodes=16)
        if base is not None:
            lost.append(field.flux_up[0] - 0.6)
        if method.transmission:
            net = field.flux_down + field.direct - field.flux_up
            lost.append(np.abs(net - (net[0] if base is None else 0.0)).max())
    assert (np.abs(lost).max() <= 1e-12) == method.conserves_energy


# settings of methods on nodes, and the error that they leave then, relative to the largest I
FINE = {
    "adding-doubling": ({"start": 4}, 1e-12),
    "invariant-imbedding": ({"rtol": 1e-10}, 1e-9),
    "matrix-operator": ({}, 1e-11),
    "successive-orders": ({"tolerance": 1e-12, "levels": 160}, 1e-11),
}


@pytest.fixture(params=sorted(FINE))
def fine(request: pytest.FixtureRequest) -> dict[str, object]:
    """A method on nodes and its settings, as arguments of a call."""
    return {"method": request.param, "settings": FINE[request.param][0], "nodes": 5}


def depolarizing_base() -> vrte.MuellerBase:
    """Reflects other azimuthal orders than 0, and polarizes."""

    def matrix(mu_i: np.ndarray, mu_o: np.ndarray, phi: np.ndarray) -> np.ndarray:
        cosine = np.cos(np.radians(phi))
        result = np.zeros((*np.broadcast_shapes(np.shape(mu_i), np.shape(mu_o), np.shape(phi)), 4, 4))
        result[..., 0, 0] = 0.1 + 0.02 * cosine * mu_i * mu_o
        result[..., 1, 0] = result[..., 0, 1] = 0.02 * mu_i * mu_o
        result[..., 1, 1] = result[..., 2, 2] = 0.03
        return result

    return vrte.MuellerBase(matrix)


WHITE, MUELLER = vrte.Lambertian(0.4), depolarizing_base()
HAZE, EVEN = vrte.henyey_greenstein(0.3, 5), vrte.isotropic()
SPHERES = vrte.spheres((1.5, 2.0), radius_um=0.05, wavelength_um=0.5).phase_matrix  # with b2: V, and signs of U and V
SAME = {
    "pile": vrte.Scene([vrte.Layer(HAZE, 0.95, 0.4), vrte.Layer(vrte.rayleigh(), 0.9, 0.8)]),
    "pile over white": vrte.Scene([vrte.Layer(HAZE, 1.0, 0.4), vrte.Layer(vrte.rayleigh(), 0.9, 0.8)], WHITE),
    "pile over Mueller": vrte.Scene([vrte.Layer(HAZE, 0.95, 0.4), vrte.Layer(vrte.rayleigh(), 0.9, 0.8)], MUELLER),
    "scalar over Mueller": vrte.Scene([vrte.Layer(EVEN, 0.9, 0.5)], MUELLER),
    "spheres": vrte.Scene([vrte.Layer(SPHERES, 0.95, 1.0)]),
    "white": vrte.Scene([vrte.Layer(vrte.rayleigh(), 1.0, 2.0)]),
    "endless": vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.99, np.inf)]),
    "endless, dark": vrte.Scene([vrte.Layer(HAZE, 0.5, np.inf)]),
    "endless, white": vrte.Scene([vrte.Layer(HAZE, 1.0, np.inf)]),
    "endless, nearly white": vrte.Scene([vrte.Layer(EVEN, 1.0 - 1e-6, np.inf)]),
    "upon endless": vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 0.5), vrte.Layer(HAZE, 0.99, np.inf)]),
}  # fmt: skip


QUICK = {"pile over Mueller", "spheres", "white", "endless", "upon endless"}


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in SAME]
)
def test_the_same_on_the_same_nodes(fine: dict[str, object], name: str) -> None:
    """As discrete ordinates: fields of a polarized beam at the faces and, where the method
    takes that, inside, their fluxes, and the reflection of any light."""
    scene, method = SAME[name], find_method(str(fine["method"]))
    left = FINE[method.name][1]
    if name.startswith("endless"):
        left = 1e-10 if name == "endless, nearly white" else min(left, 1e-10)
    ends = bool(np.isfinite(scene.thickness))
    if not (ends or method.endless):
        pytest.skip("not claimed")
    inside = [0.2, 0.4, 0.45] if method.depths else []
    tau = [0.0, *inside, *([scene.thickness] if ends else [])]
    asked = {"mu": np.array([0.2, -0.3, 0.9, -0.6]), "phi": PHI, "tau": tau}
    stokes = [1.0, 0.3, -0.2, 0.4]
    exact = vrte.radiance(scene, 0.6, stokes, nodes=5, accuracy=1e-13, **asked)
    found = vrte.radiance(scene, 0.6, stokes, **asked, **fine)
    for values in ("stokes", "flux_up", "flux_down"):
        assert_close(getattr(found, values), getattr(exact, values), rtol=0.0, atol=left)
    both = ({"nodes": 5, "accuracy": 1e-13}, fine)
    exact, found = (vrte.brdf(scene, MU, MU, PHI, transmission=ends, **how) for how in both)
    assert_close(found.mueller, exact.mueller, rtol=0.0, atol=left * exact.mueller.max())
    if ends:
        assert_close(found.transmission, exact.transmission, rtol=0.0, atol=left * exact.transmission.max())
    if name == "spheres":  # far above what is compared
        assert np.abs(exact.mueller[..., 3, 0]).max() > 1e-5 * exact.mueller.max()


@pytest.mark.parametrize("thickness", [5e-324, 1e-310, 1e-20])
def test_the_thinnest_layers_scatter_once(fine: dict[str, object], thickness: float) -> None:
    """And no arithmetic goes wrong on the way."""
    scene, method = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, thickness)]), str(fine["method"])
    found = vrte.brdf(scene, [0.5, 0.05], 0.5, nodes=8, method=method, transmission=True)
    once = vrte.brdf(scene, [0.5, 0.05], 0.5, nodes=8, method="single-scattering", transmission=True)
    pairs = [(found.mueller, once.mueller), (found.transmission, once.transmission)]
    # the matrix operator holds what passes unscattered as well, 1e-16 of which is more than this
    for some, other in pairs[:1] if method == "matrix-operator" else pairs:
        assert_close(some, other, rtol=0.0, atol=1e-320 + 1e-9 * np.abs(other).max())
    assert_close(found.reflectance, once.reflectance, rtol=1e-6, atol=1e-320)


def h_function(mu: np.ndarray, albedo: float, nodes: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Ambarzumian's and Chandrasekhar's: 1/H = sqrt(1 - omega) + omega/2 times the integral of u H(u)/(u + mu) du,
    iterated on nodes; every other iterate lies above, so that means of two settle quickly."""

    def of(cosines: np.ndarray, on_nodes: np.ndarray) -> np.ndarray:
        inner = nodes * weights * on_nodes / (cosines[:, None] + nodes)
        return 1.0 / (np.sqrt(1.0 - albedo) + 0.5 * albedo * inner.sum(axis=1))

    found = np.ones(nodes.size)
    for _ in range(400):
        found = 0.5 * (found + of(nodes, found))
    return of(mu, found)


@pytest.mark.parametrize("albedo", [0.3, 0.9, 0.99])
def test_isotropic_layer_without_end(fine: dict[str, object], albedo: float) -> None:
    """f = omega/(4 pi) H(mu) H(mu')/(mu + mu'), on many nodes."""
    if not find_method(str(fine["method"])).endless:
        pytest.skip("not claimed")
    scene = vrte.Scene([vrte.Layer(vrte.isotropic(), albedo, np.inf)])
    points, weights = np.polynomial.legendre.leggauss(60)
    h = h_function(MU, albedo, 0.5 * (points + 1.0), 0.5 * weights)
    exact = albedo / (4.0 * np.pi) * h[:, None] * h / (MU[:, None] + MU)
    found = vrte.brdf(scene, MU, MU, **(fine | {"nodes": 24}))
    assert_close(found.mueller[:, :, 0, 0, 0], exact, rtol=1e-8, atol=0.0)


def test_light_from_below(method: Method) -> None:
    """A layer alone has no top: the same from both sides, whatever the method."""
    phase = vrte.rayleigh() if method.polarization else vrte.henyey_greenstein(0.5, 12)
    scene, how = vrte.Scene([vrte.Layer(phase, 0.9, 0.7)]), {"nodes": 8, "method": method.name}
    transmission = method.transmission
    above, below = (
        vrte.brdf(scene, MU, MU, PHI, transmission=transmission, illuminate=side, **how) for side in ("top", "bottom")
    )
    flip = np.outer([1, 1, -1, -1], [1, 1, -1, -1])
    np.testing.assert_array_equal(below.mueller, above.mueller * flip)
    if transmission:
        np.testing.assert_array_equal(below.transmission, above.transmission * flip)


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("adding-doubling", {}),
        ("invariant-imbedding", {}),
        ("matrix-operator", {}),
        ("successive-orders", {}),
        ("synthetic-iteration", {"iterations": 3}),
    ],
)
def test_an_interrupt_ends_what_takes_long(name: str, settings: dict[str, object]) -> None:
    told = []

    def interrupted(done: int, total: int) -> None:
        told.append((done, total))
        raise KeyboardInterrupt

    scene = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.5, 12), 0.9, 1.0)])
    with pytest.raises(KeyboardInterrupt):
        vrte.brdf(scene, MU, MU, PHI, nodes=6, method=name, settings=settings, progress=interrupted)
    assert len(told) == 1
    assert told[0][0] < told[0][1]


OPTIONS = {"accuracy": 1e-4, "backend": "opencl", "verify": True, "algorithm": "auto", "truncation": "delta-m"}


@pytest.mark.parametrize("method", OTHERS)
@pytest.mark.parametrize("option", OPTIONS)
def test_what_a_method_does_not_use_is_refused_by_name(method: str, option: str) -> None:
    """Also with the value that is the default: who asks for it shall not think that it does something."""
    scene = vrte.Scene([vrte.Layer(vrte.isotropic(), albedo=0.5, thickness=0.1)])
    asked = {"mu_i": 0.5, "mu_o": 0.5, "method": method, option: OPTIONS[option]}
    if option in find_method(method).options and option != "backend":
        if method != "synthetic-iteration":
            assert vrte.brdf(scene, **asked).mueller[0, 0, 0, 0, 0] > 0.0
        return
    refused = rf"method '{method}' takes no {option}"
    with pytest.raises(vrte.SceneError, match=refused):
        vrte.brdf(scene, **asked)
    with pytest.raises(vrte.SceneError, match=refused):
        vrte.plan("brdf", scene, **asked)
    with pytest.raises(vrte.SceneError, match=refused):
        vrte.radiance(scene, 0.5, mu=0.5, method=method, **{option: OPTIONS[option]})


def test_options_of_the_processor_go_with_every_method() -> None:
    scene = vrte.Scene([vrte.Layer(vrte.isotropic(), albedo=0.5, thickness=0.1)])
    for backend in ("openmp", "sequential"):
        made = vrte.brdf(scene, 0.5, 0.5, method="adding-doubling", backend=backend, nodes=2, verify=False).diagnostics
        assert made["nodes"] == 2
    with pytest.raises(vrte.SceneError, match="there are plans of 'discrete-ordinates' and 'auto'"):
        vrte.plan("brdf", scene, 0.5, 0.5, method="adding-doubling")
    assert "auto, rule" in str(vrte.plan("brdf", scene, 0.5, 0.5, method="auto", accuracy=1e-2))


def test_files_and_spectra_are_refused_alike(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content = 'method = "diffusion"\n[[layer]]\nphase = "isotropic"\nalbedo = 1\nthickness = 0.5\n'
    asked = "[brdf]\nmu_i = 0.5\nmu_o = 0.5\n"
    scene, out = tmp_path / "scene.toml", str(tmp_path / "out.csv")
    scene.write_text(content + asked)
    for options in (["--accuracy", "1e-3"], ["--verify"], ["--algorithm", "modes"]):
        assert main(["brdf", str(scene), "-o", str(tmp_path / "out.nc"), "--csv", out, *options]) == 2
        assert f"takes no {options[0][2:]}" in capsys.readouterr().err
    assert main(["brdf", str(scene), "-o", str(tmp_path / "out.nc")]) == 0
    scene.write_text("accuracy = 1e-3\n" + content + asked)
    assert main(["brdf", str(scene), "-o", str(tmp_path / "out.nc")]) == 2
    assert "takes no accuracy: it goes by nodes and truncation, and its settings boundary" in capsys.readouterr().err
    with pytest.raises(vrte.SceneError, match="takes no accuracy"):
        vrte.spectrum(scene, [0.5, 0.6])
    with pytest.raises(vrte.SceneError, match="takes no accuracy, algorithm: it goes by nodes"):
        vrte.spectrum(scene, [0.5, 0.6], algorithm="modes")


BY_ACCURACY = [name for name in OTHERS if "accuracy" in find_method(name).options]
CONTINUOUS = {
    "Rayleigh": vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.99, 1.0)]),
    "thin, white": vrte.Scene([vrte.Layer(vrte.isotropic(), 1.0, 0.05)]),
    "over a base": vrte.Scene(
        [vrte.Layer(vrte.rayleigh(), 0.9, 0.3), vrte.Layer(vrte.henyey_greenstein(0.4, 8), 0.9, 2.0)],
        vrte.Lambertian(0.5),
    ),
    "peaked": vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.7, 30), 0.9, 3.0)]),
}
SLOW = {name for name in CONTINUOUS if name != "thin, white"}


@pytest.fixture(scope="module")
def converged() -> dict[str, vrte.Field]:
    """The exact method's fields, far beyond what is asked for."""
    return {name: field_of(scene, accuracy=1e-12) for name, scene in CONTINUOUS.items()}


def field_of(scene: vrte.Scene, **how: object) -> vrte.Field:
    """Light at the faces, off the nodes."""
    asked = {"mu": [0.1, 0.5, 1.0, -0.2, -0.7], "phi": PHI, "tau": [0.0, scene.thickness]}
    return vrte.radiance(scene, 0.6, stokes=[1.0, 0.3, 0.2, 0.5], **asked, **how)


@pytest.mark.parametrize("accuracy", [1e-2, 1e-4, pytest.param(1e-6, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] if name in SLOW else []) for name in CONTINUOUS]
)
@pytest.mark.parametrize("method", BY_ACCURACY)
def test_accuracy(converged: dict[str, vrte.Field], method: str, name: str, accuracy: float) -> None:
    """Of the continuous problem, relative to the largest I at each depth, on nodes chosen for it."""
    found = field_of(CONTINUOUS[name], method=method, accuracy=accuracy)
    right = converged[name].stokes
    gap = np.abs(found.stokes - right).reshape(2, -1).max(axis=1) / right[..., 0].reshape(2, -1).max(axis=1)
    assert gap.max() <= accuracy
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
