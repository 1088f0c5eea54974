"""Methods that take smooth interfaces and mirrors, beside discrete ordinates on the same nodes."""

import numpy as np
import pytest

import vrte
from vrte.basics.errors import SceneError
from vrte.methods import find_method
from vrte.request.how import AUTO, EXACT, METHODS

from .helpers import assert_close
from .test_methods import depolarizing_base

# settings, and the error that they leave then, relative to the largest I
FINE = {
    "adding-doubling": ({"start": 4}, 1e-12),
    "matrix-operator": ({}, 1e-13),
    "successive-orders": ({"tolerance": 1e-12, "levels": 64}, 1e-11),
}
OTHERS = tuple(name for name in METHODS if name != EXACT)
TAKEN = [name for name in OTHERS if find_method(name).interfaces != "none"]
GLASS, WATER = vrte.Interface(1.0, 1.5), vrte.Interface(1.0, 1.34)
RAYLEIGH, HAZE = vrte.rayleigh(), vrte.henyey_greenstein(0.3, 3)
SPHERES = vrte.spheres((1.5, 2.0), radius_um=0.05, wavelength_um=0.5).phase_matrix  # with b2: V, and signs of U and V
SILVER = vrte.Mirror((0.05, 3.0))
SAME = {
    "over black": vrte.Scene([GLASS, vrte.Layer(SPHERES, 0.95, 0.8)], vrte.Lambertian(0.0)),
    "over white": vrte.Scene([GLASS, vrte.Layer(RAYLEIGH, 1.0, 0.8)], vrte.Lambertian(1.0)),
    "plate": vrte.Scene([GLASS, vrte.Layer(RAYLEIGH, 0.9, 0.5), GLASS.turned]),
    "varnish over paint": vrte.Scene(
        [GLASS, vrte.Layer(HAZE, 0.3, 0.1), vrte.Interface(1.5, 1.33), vrte.Layer(RAYLEIGH, 0.95, 1.0)],
        vrte.Lambertian(0.4),
    ),
    "aerosol over sea": vrte.Scene(
        [vrte.Layer(HAZE, 0.9, 0.3), WATER, vrte.Layer(RAYLEIGH, 0.8, 1.0)], vrte.Lambertian(0.1)
    ),
    "mirror": vrte.Scene([vrte.Layer(SPHERES, 0.95, 0.6)], SILVER),
    "without end": vrte.Scene([GLASS, vrte.Layer(RAYLEIGH, 0.99, np.inf)]),
    "white, without end": vrte.Scene([GLASS, vrte.Layer(HAZE, 1.0, np.inf)]),
    "Lambertian, nothing else": vrte.Scene([GLASS], vrte.Lambertian(0.7)),
}
STOKES, ANGLES = [1.0, 0.3, -0.2, 0.4], {"mu": np.array([0.2, -0.3, 0.9, -0.6]), "phi": [0.0, 40.0, 180.0]}
EXACTLY = {"nodes": 4, "accuracy": 1e-13, "truncation": "none"}


def compare(method: str, scene: vrte.Scene, **asked: object) -> None:
    """Fields and fluxes of a method with those of discrete ordinates."""
    settings, left = FINE[method]
    exact = vrte.radiance(scene, 0.6, STOKES, **ANGLES, **asked, **EXACTLY)
    found = vrte.radiance(scene, 0.6, STOKES, **ANGLES, **asked, nodes=4, method=method, settings=settings)
    largest = exact.stokes[..., 0].reshape(exact.tau.size, -1).max(axis=1)[:, None, None, None]
    assert_close(found.stokes / largest, exact.stokes / largest, rtol=0.0, atol=left)
    for name in ("flux_up", "flux_down"):
        assert_close(getattr(found, name), getattr(exact, name), rtol=0.0, atol=left)


LONGER = {"over white", "plate", "aerosol over sea", "white, without end"}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] if name in LONGER else []) for name in SAME]
)
@pytest.mark.parametrize("method", FINE)
def test_the_same_on_the_same_nodes(method: str, name: str) -> None:
    """Fields of polarized beams at the faces and inside, on either side of the interfaces."""
    scene = SAME[name]
    if not (np.isfinite(scene.thickness) or find_method(method).endless):
        pytest.skip("not claimed")
    depths = np.cumsum([0.0, *(layer.thickness for layer in scene.layers)])
    inside = 0.3 * min(1.0, scene.thickness)
    compare(method, scene, tau=[*depths[np.isfinite(depths)], inside] if scene.thickness else 0.0)
    faces = depths[:-1] if scene.base is not None else depths
    lower = [tau for tau, interface in zip(faces, scene.interfaces, strict=False) if interface and np.isfinite(tau)]
    if lower and scene.thickness > 0.0:
        compare(method, scene, tau=lower, side="below")


@pytest.mark.parametrize("method", FINE)
def test_light_from_below(method: str) -> None:
    settings, left = FINE[method]
    scene = vrte.Scene([GLASS, vrte.Layer(SPHERES, 0.95, 0.4), vrte.Interface(1.5, 1.33), vrte.Layer(HAZE, 0.9, 0.3)])
    asked = {"mu_i": [0.3, 0.8], "mu_o": [0.05, 0.9], "phi": [0.0, 70.0], "transmission": True, "illuminate": "bottom"}
    exact = vrte.brdf(scene, **asked, **EXACTLY)
    found = vrte.brdf(scene, **asked, nodes=4, method=method, settings=settings)
    for name in ("mueller", "transmission"):
        expected = getattr(exact, name)
        assert_close(getattr(found, name), expected, rtol=0.0, atol=left * expected.max())
    for name in ("specular", "specular_transmission", "direct_transmittance"):
        np.testing.assert_array_equal(getattr(found, name), getattr(exact, name))


@pytest.mark.parametrize("algorithm", ["modes", "doubling"])
def test_circular_polarization_on_nodes_of_two_media(algorithm: str) -> None:
    """What puts the flux of I right on such nodes leaves V as it is: by both algorithms, and by adding."""
    exact = vrte.radiance(SAME["over black"], 0.6, STOKES, **ANGLES, **EXACTLY, algorithm=algorithm)
    found = vrte.radiance(SAME["over black"], 0.6, STOKES, **ANGLES, nodes=4, method="adding-doubling")
    assert np.abs(exact.stokes[..., 3]).max() > 1e-3 * exact.stokes.max()
    assert_close(exact.stokes[..., 3], found.stokes[..., 3], rtol=0.0, atol=1e-9 * exact.stokes.max())


@pytest.mark.parametrize("accuracy", [1e-3, pytest.param(1e-6, marks=pytest.mark.slow)])
@pytest.mark.parametrize("method", TAKEN)
def test_accuracy(method: str, accuracy: float) -> None:
    """Of the continuous problem, on nodes chosen for it."""
    scene = SAME["aerosol over sea"]
    asked = {"stokes": STOKES, "mu": [0.1, 1.0, -0.3], "tau": [0.0, 1.3]}
    right = vrte.radiance(scene, 0.6, **asked, nodes=40).stokes
    found = vrte.radiance(scene, 0.6, **asked, accuracy=accuracy, method=method)
    assert np.abs(found.stokes - right).max() <= accuracy * right[..., 0].max()
    assert found.diagnostics["promised"], found.diagnostics["notes"]


@pytest.mark.parametrize("method", [name for name in TAKEN if find_method(name).conserves_energy])
@pytest.mark.parametrize("base", [None, vrte.Lambertian(1.0)], ids=["plate", "over white"])
def test_energy(method: str, base: vrte.Lambertian | None) -> None:
    """Nothing absorbs: the net flux is the same everywhere, on either side of what refracts."""
    layers = [vrte.Layer(HAZE, 1.0, 0.5), vrte.Interface(1.5, 1.2), vrte.Layer(RAYLEIGH, 1.0, 40.0)]
    scene = vrte.Scene([GLASS, *layers, *([] if base else [vrte.Interface(1.2, 1.0)])], base)
    nets = []
    for side, tau in (("above", [0.0, 0.2, 0.5, 40.5]), ("below", [0.0, 0.5])):
        field = vrte.radiance(scene, 0.3, mu=[], tau=tau, side=side, method=method, nodes=6)
        nets += (field.flux_down + field.direct - field.flux_up - field.direct_up).ravel().tolist()
    assert_close(nets, 0.0 if base else nets[0], rtol=0.0, atol=1e-12)


def test_orders_count_scatterings_whatever_is_reflected() -> None:
    """Between a surface and a mirror the s-th order is still albedo^s times that of albedo 1, and all add up."""
    by_albedo = []
    for albedo in (1.0, 0.5):
        scene = vrte.Scene([GLASS, vrte.Layer(RAYLEIGH, albedo, 1.0)], SILVER)
        asked = {"mu_i": [0.2, 0.9], "mu_o": [0.3, 1.0], "phi": [0.0, 50.0], "nodes": 4, "method": "successive-orders"}
        found = [vrte.brdf(scene, **asked, settings={"orders": s, "tolerance": 1e-15}).mueller for s in (1, 2, 3)]
        once, twice, thrice = found
        by_albedo.append(np.stack([once / albedo, (twice - once) / albedo**2, (thrice - twice) / albedo**3]))
    assert_close(*by_albedo, rtol=0.0, atol=1e-14)
    assert (np.abs(by_albedo[0]).max(axis=(1, 2, 3, 4, 5)) > 1e-2).all()


@pytest.mark.parametrize("method", [EXACT, *FINE])
def test_a_base_sends_all_its_orders_to_and_fro(method: str) -> None:
    """Below a surface also where no particle scatters that many: the clear layer's number of terms means nothing."""
    base, found = depolarizing_base(), []
    settings = FINE[method][0] if method in FINE else {}
    for phase in (vrte.isotropic(), vrte.henyey_greenstein(0.5, 6)):
        scene = vrte.Scene([GLASS, vrte.Layer(phase, 0.0, 0.1)], base)
        asked = {"mu_i": [0.3, 0.8], "mu_o": [0.2, 0.9], "phi": [0.0, 70.0], "nodes": 6, "truncation": "none"}
        asked |= {"method": method, "settings": settings} if settings else {"method": method}
        if method != EXACT:
            del asked["truncation"]
        found.append(vrte.brdf(scene, **asked).mueller)
    assert_close(*found, rtol=0.0, atol=1e-11 * found[0].max())


@pytest.mark.parametrize("method", OTHERS)
@pytest.mark.parametrize(
    "scene",
    [
        vrte.Scene([GLASS, vrte.Layer(HAZE, 0.9, 0.5)]),
        vrte.Scene([vrte.Layer(HAZE, 0.9, 0.5), vrte.Interface(1.5, 1.0)]),
        vrte.Scene([vrte.Layer(HAZE, 0.9, 0.5)], SILVER),
        vrte.Scene([vrte.Interface(1.0, 1.5, roughness=0.2), vrte.Layer(HAZE, 0.9, 0.5)]),
        vrte.Scene([GLASS, vrte.Layer(HAZE, 0.9, np.inf)]),
    ],
    ids=["above", "below", "mirror", "rough", "without end"],
)
def test_interfaces_are_taken_or_refused_by_name(method: str, scene: vrte.Scene) -> None:
    """What is taken is not what it would be without them."""
    taken = find_method(method)
    asked = {"mu_i": 0.6, "mu_o": [0.3, 0.9], "nodes": 4, "method": method}
    if taken.interfaces == "none":
        words = "refracting or mirroring surface"
    elif scene.is_rough:
        words = "rough interface"
    elif np.isinf(scene.thickness) and not taken.endless:
        words = "layer without end"
    else:
        without = vrte.brdf(vrte.Scene(scene.layers), **asked)
        assert np.abs(vrte.brdf(scene, **asked).mueller - without.mueller).max() > 1e-3
        return
    with pytest.raises(SceneError, match=f"method '{method}' takes no {words}: ask for '{EXACT}'") as refused:
        vrte.brdf(scene, **asked)
    assert refused.value.place == ("method",)


@pytest.mark.parametrize("accuracy", [1e-1, 1e-3])
def test_auto_takes_what_takes_interfaces(accuracy: float) -> None:
    """However thin the layer: light scattered once is not all that a surface mirrors."""
    for parts, base in (([GLASS], None), ([], SILVER)):
        scene = vrte.Scene([*parts, vrte.Layer(vrte.isotropic(), 0.9, 1e-4)], base)
        made = vrte.brdf(scene, 0.6, 0.4, method=AUTO, accuracy=accuracy).diagnostics
        assert made["method"] == EXACT
        assert made["method_rule"].startswith("auto, rule 2 (accuracy)")
