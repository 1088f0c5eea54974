"""The two-stream method: discrete ordinates with one node, in closed form."""

import numpy as np
import pytest

import vrte
from vrte.basics.errors import SceneError

from .helpers import assert_close

MU, PHI = np.array([1e-3, 0.5, 0.8, 1.0, -1e-3, -0.3, -0.5, -1.0]), [0.0, 40.0, 130.0]
HG, EVEN = vrte.henyey_greenstein(0.6, 40), vrte.isotropic()
SCENES = {
    "even": [(EVEN, 0.9, 1.0)],
    "thin": [(HG, 0.9, 1e-6)],
    "dark": [(HG, 0.3, 30.0)],
    "conservative": [(HG, 1.0, 5.0)],
    "thick": [(HG, 1.0, 1e3)],
    "pile": [(HG, 0.95, 0.2), (EVEN, 0.5, 1.0), (EVEN, 0.0, 0.3), (HG, 1.0, 3.0)],
    "backward": [(vrte.henyey_greenstein(-0.3, 30), 0.8, 2.0)],
    "endless": [(HG, 0.95, 0.5), (HG, 0.8, np.inf)],
    "endless and conservative": [(HG, 1.0, np.inf)],
}


def scene_of(layers, base=None):
    return vrte.Scene([vrte.Layer(*layer) for layer in layers], base)


@pytest.mark.parametrize("truncation", ["none", "delta-m", "auto"])
@pytest.mark.parametrize("mu0", [1.0, 0.5, 0.02])
@pytest.mark.parametrize("name", SCENES)
def test_is_one_node(name, mu0, truncation):
    """Radiance in all directions and fluxes, relative to the largest I at each depth: 1e-13 or better."""
    scene = scene_of(SCENES[name], vrte.Lambertian(0.4) if np.isfinite(SCENES[name][-1][2]) else None)
    deepest = scene.thickness if np.isfinite(scene.thickness) else 20.0
    asked = {"mu0": mu0, "mu": MU, "phi": PHI, "tau": deepest * np.array([0.0, 0.3, 1.0]), "nodes": 1}
    asked |= {"truncation": truncation}
    exact = vrte.radiance(scene, accuracy=1e-15, **asked)  # which says whether light near the beam matters
    found = vrte.radiance(scene, method="two-stream", **asked)
    largest = exact.stokes[..., 0].max(axis=(1, 2))
    assert (np.abs(found.stokes - exact.stokes).max(axis=(1, 2, 3)) <= 1e-12 * largest).all()
    for some, other in ((found.flux_up, exact.flux_up), (found.flux_down, exact.flux_down)):
        assert_close(some, other, rtol=0.0, atol=1e-12 * exact.flux_up.max())


def test_brdf_is_one_node():
    scene = scene_of(SCENES["pile"], vrte.Lambertian(0.2))
    asked = {"mu_i": [0.2, 0.9], "mu_o": [0.3, 1.0], "phi": PHI, "nodes": 1, "transmission": True}
    exact = vrte.brdf(scene, accuracy=1e-15, **asked)
    found = vrte.brdf(scene, method="two-stream", **asked)
    assert_close(found.mueller, exact.mueller, rtol=0.0, atol=1e-13)
    assert_close(found.transmission, exact.transmission, rtol=0.0, atol=1e-13)


def test_what_it_refuses():
    peaked = scene_of([(vrte.henyey_greenstein(0.95, 300), 1.0, 1.0)])
    with pytest.raises(SceneError, match=r"'two-stream': on one node an asymmetry of 0.95 .* ask for truncation"):
        vrte.brdf(peaked, 0.5, 0.5, method="two-stream", truncation="none")
    mirror = vrte.MuellerBase(lambda mu_i, mu_o, phi_deg: np.diag([0.1, 0.0, 0.0, 0.0]))
    with pytest.raises(SceneError, match="method 'two-stream' takes no base but a Lambertian one"):
        vrte.brdf(scene_of([(HG, 0.9, 1.0)], mirror), 0.5, 0.5, method="two-stream")
