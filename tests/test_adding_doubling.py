"""Adding and doubling: its starting layer's order, slabs added from both sides, the field between them."""

import numpy as np
import pytest

import vrte

MU, PHI = np.array([0.05, 0.3, 1.0]), np.array([0.0, 40.0, 180.0])
SLAB = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.99, 1.0)])


def error(scene: vrte.Scene, **settings: float) -> float:
    """Of the BRDF, relative to its largest entry, against discrete ordinates on the same nodes."""
    exact = vrte.brdf(scene, MU, MU, PHI, nodes=6, accuracy=1e-13)
    found = vrte.brdf(scene, MU, MU, PHI, nodes=6, method="adding-doubling", settings=settings)
    return float(np.abs(found.mueller - exact.mueller).max() / np.abs(exact.mueller).max())


@pytest.mark.parametrize("start", [0, 1, 2, 3])
def test_order_of_the_starting_layer(start: int) -> None:
    thin = 0.125 if start < 2 else 0.25
    errors = [error(SLAB, thin=size, start=start) for size in (thin, thin / 2.0)]
    order = max(1, 2 * start)
    assert order - 0.25 < np.log2(errors[0] / errors[1]) < order + 0.25


def test_layers_base_and_depths() -> None:
    layers = [vrte.Layer(vrte.rayleigh(), 0.9, 0.5), vrte.Layer(vrte.henyey_greenstein(0.4, 6), 1.0, 0.7)]
    scene = vrte.Scene(layers, vrte.Lambertian(0.3))
    ask = {"mu0": 0.6, "stokes": [1.0, 0.3, -0.2, 0.4], "mu": np.array([0.2, -0.3, 0.9, -0.6]), "phi": PHI}
    ask |= {"tau": [0.0, 0.2, 0.5, 0.9, 1.2], "nodes": 4}
    exact = vrte.radiance(scene, accuracy=1e-13, **ask)
    found = vrte.radiance(scene, method="adding-doubling", settings={"start": 4}, **ask)
    np.testing.assert_allclose(found.stokes, exact.stokes, atol=1e-12)
    np.testing.assert_allclose(found.flux_up, exact.flux_up, atol=1e-12)
    np.testing.assert_allclose(found.flux_down, exact.flux_down, atol=1e-12)


def test_energy() -> None:
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 1.0, 10.0)])
    ask = {"mu0": 0.5, "stokes": [1.0, 0.0, 0.0, 0.0], "mu": [], "tau": [0.0, 10.0], "nodes": 6}
    field = vrte.radiance(scene, method="adding-doubling", settings={"start": 4}, **ask)
    out = field.flux_up[0] + field.flux_down[1] + 0.5 * np.exp(-10.0 / 0.5)
    np.testing.assert_allclose(out, 0.5, rtol=1e-11)


def test_layer_without_end() -> None:
    scene = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.5, 8), 0.9, np.inf)])
    assert error(scene, start=4) < 1e-12


def test_grazing_beams_and_nodes() -> None:
    """The starting layer is thin along them too."""
    scene = vrte.Scene([vrte.Layer(vrte.isotropic(), 0.9, 1.0)])
    low = np.array([2e-3, 0.5])
    exact = vrte.brdf(scene, low, low, nodes=20, accuracy=1e-13)
    found = vrte.brdf(scene, low, low, nodes=20, method="adding-doubling", settings={"start": 4})
    np.testing.assert_allclose(found.mueller, exact.mueller, rtol=1e-11)


@pytest.mark.parametrize("phase", [vrte.rayleigh(), vrte.henyey_greenstein(0.7, 40)], ids=["Rayleigh", "peaked"])
@pytest.mark.parametrize("thickness", [0.1, 1e3, 1e8, np.inf])
def test_white_layers_lose_nothing(phase: vrte.PhaseMatrix, thickness: float) -> None:
    """Flux to rounding, and R as good as where something is absorbed, whatever the starting layer left out."""
    scene = vrte.Scene([vrte.Layer(phase, 1.0, thickness)])
    asked = {"mu_i": [0.02, 0.5, 1.0], "mu_o": [0.1, 0.9], "nodes": 20, "transmission": bool(np.isfinite(thickness))}
    found = vrte.brdf(scene, **asked, method="adding-doubling")
    exact = vrte.brdf(scene, **asked, accuracy=1e-13)
    np.testing.assert_allclose(found.mueller, exact.mueller, rtol=0, atol=1e-11 * exact.mueller.max())
    if np.isinf(thickness):
        np.testing.assert_allclose(found.reflectance, 1.0, rtol=0, atol=2e-15)
    else:
        net = vrte.radiance(
            scene, 0.5, mu=[], tau=thickness * np.array([0.0, 0.3, 1.0]), nodes=20, method="adding-doubling"
        )
        rest = net.flux_down + net.direct - net.flux_up
        np.testing.assert_allclose(rest, rest[-1], rtol=0, atol=2e-15)


@pytest.mark.parametrize("method", ["adding-doubling", "matrix-operator", "successive-orders", "invariant-imbedding"])
@pytest.mark.parametrize("thickness", [5e-324, 1e-310, 1e-20])
def test_the_thinnest_layers_scatter_once(method: str, thickness: float) -> None:
    """And no arithmetic goes wrong on the way."""
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, thickness)])
    found = vrte.brdf(scene, [0.5, 0.05], 0.5, nodes=8, method=method, transmission=True)
    once = vrte.brdf(scene, [0.5, 0.05], 0.5, nodes=8, method="single-scattering", transmission=True)
    pairs = [(found.mueller, once.mueller), (found.transmission, once.transmission)]
    # the matrix operator holds what passes unscattered as well, 1e-16 of which is more than this
    for some, other in pairs[:1] if method == "matrix-operator" else pairs:
        np.testing.assert_allclose(some, other, rtol=0, atol=1e-320 + 1e-9 * np.abs(other).max())
    np.testing.assert_allclose(found.reflectance, once.reflectance, rtol=1e-6, atol=1e-320)
