"""Adding and doubling: its starting layer's order, and white layers."""

import numpy as np
import pytest

import vrte

from .helpers import assert_close

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


def test_grazing_beams_and_nodes() -> None:
    """The starting layer is thin along them too."""
    scene = vrte.Scene([vrte.Layer(vrte.isotropic(), 0.9, 1.0)])
    low = np.array([2e-3, 0.5])
    exact = vrte.brdf(scene, low, low, nodes=20, accuracy=1e-13)
    found = vrte.brdf(scene, low, low, nodes=20, method="adding-doubling", settings={"start": 4})
    assert_close(found.mueller, exact.mueller, rtol=1e-11, atol=0.0)


@pytest.mark.parametrize(
    "phase",
    [
        pytest.param(vrte.rayleigh(), id="Rayleigh"),
        pytest.param(vrte.henyey_greenstein(0.7, 40), id="peaked", marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize("thickness", [0.1, 1e3, 1e8, np.inf])
def test_white_layers_lose_nothing(phase: vrte.PhaseMatrix, thickness: float) -> None:
    """Flux to rounding, and R as good as where something is absorbed, whatever the starting layer left out."""
    scene = vrte.Scene([vrte.Layer(phase, 1.0, thickness)])
    asked = {"mu_i": [0.02, 0.5, 1.0], "mu_o": [0.1, 0.9], "nodes": 20, "transmission": bool(np.isfinite(thickness))}
    found = vrte.brdf(scene, **asked, method="adding-doubling")
    exact = vrte.brdf(scene, **asked, accuracy=1e-13)
    assert_close(found.mueller, exact.mueller, rtol=0.0, atol=1e-11 * exact.mueller.max())
    if np.isinf(thickness):
        assert_close(found.reflectance, 1.0, rtol=0.0, atol=2e-15)
    else:
        net = vrte.radiance(
            scene, 0.5, mu=[], tau=thickness * np.array([0.0, 0.3, 1.0]), nodes=20, method="adding-doubling"
        )
        rest = net.flux_down + net.direct - net.flux_up
        assert_close(rest, rest[-1], rtol=0.0, atol=2e-15)
