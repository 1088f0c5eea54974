"""Rough surfaces against Mitsuba's: intensities of its roughdielectric and roughconductor, direction by direction."""

from typing import Any

import numpy as np
import pytest

from vrte.optics.facets import RoughSurface

from .helpers import assert_close

ALPHA = 0.25


@pytest.fixture(scope="module")
def mitsuba() -> Any:
    found = pytest.importorskip("mitsuba")
    found.set_variant("scalar_rgb")
    return found


def evaluate(mitsuba: Any, bsdf: dict[str, Any], light: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """f of pairs of directions that point away from the surface, (n,): its value is times the light's cosine."""
    made, found = mitsuba.load_dict(bsdf), []
    for towards_light, towards_eye in zip(light, eye, strict=True):
        at = mitsuba.SurfaceInteraction3f()
        at.wi, at.sh_frame = mitsuba.Vector3f(towards_eye), mitsuba.Frame3f(mitsuba.Vector3f(0, 0, 1))
        value = made.eval(mitsuba.BSDFContext(), at, mitsuba.Vector3f(towards_light))
        found.append(float(value[0]) / abs(towards_light[2]))
    return np.array(found)


@pytest.mark.slow
@pytest.mark.parametrize("distribution", ["beckmann", "ggx"])
@pytest.mark.parametrize(
    ("into", "through", "below"),
    [(1.5, False, False), (1.5, False, True), (1.5, True, False), (1.5, True, True), (0.2 + 3.0j, False, False)],
)
def test_rough_surfaces(mitsuba: Any, distribution: str, into: complex, through: bool, below: bool) -> None:
    """Its shadowing of Beckmann's facets is a rational fit of Smith's, within 0.4 %; GGX's agrees to single
    precision."""
    rng = np.random.default_rng(3)
    mu_i, mu_o = rng.uniform(0.1, 1.0, (2, 300))
    phi = rng.uniform(0.0, 60.0, 300)
    turn, spread = np.radians(phi), (np.sqrt(1.0 - mu_i**2), np.sqrt(1.0 - mu_o**2))
    # towards the light: against its travel, which heads for phi = 0
    light = np.stack([-spread[0], 0.0 * mu_i, mu_i], axis=1)
    eye = np.stack([spread[1] * np.cos(turn), spread[1] * np.sin(turn), -mu_o if through else mu_o], axis=1)
    bsdf = {"type": "roughdielectric", "int_ior": 1.5, "ext_ior": 1.0, "alpha": ALPHA, "distribution": distribution}
    if into.imag:
        bsdf = {"type": "roughconductor", "eta": 0.2, "k": 3.0, "alpha": ALPHA, "distribution": distribution}
    indices = (into, 1.0) if below else (1.0, into)
    surface = RoughSurface(*indices, ALPHA, distribution, shadowing=True)
    mirror = np.array([1.0, 1.0, -1.0 if below else 1.0])
    expected = evaluate(mitsuba, bsdf, light * mirror, eye * mirror)
    found = (surface.transmit if through else surface.reflect)(mu_i, mu_o, phi)[:, 0, 0]
    seen = found > 1e-3 * found.max()
    assert seen.sum() > 30
    assert_close(found[seen], expected[seen], rtol=1e-4 if distribution == "ggx" else 1e-2, atol=0.0)
