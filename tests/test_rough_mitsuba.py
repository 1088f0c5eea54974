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


def draw_directions(through: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    mu_i, mu_o = rng.uniform(0.1, 1.0, (2, 300))
    phi = rng.uniform(0.0, 60.0, 300)
    spread = np.sqrt(1.0 - mu_i**2), np.sqrt(1.0 - mu_o**2)
    # towards the light: against its travel, which heads for phi = 0
    light = np.stack([-spread[0], 0.0 * mu_i, mu_i], axis=1)
    turn = np.radians(phi)
    eye = np.stack([spread[1] * np.cos(turn), spread[1] * np.sin(turn), -mu_o if through else mu_o], axis=1)
    return light, eye, mu_i, mu_o, phi


@pytest.mark.slow
@pytest.mark.parametrize("distribution", ["beckmann", "ggx"])
@pytest.mark.parametrize("through", [False, True])
def test_roughdielectric(mitsuba: Any, distribution: str, through: bool) -> None:
    """Its shadowing of Beckmann's facets is a rational fit of Smith's, within 0.4 %; GGX's agrees to single
    precision."""
    light, eye, mu_i, mu_o, phi = draw_directions(through)
    bsdf = {"type": "roughdielectric", "int_ior": 1.5, "ext_ior": 1.0, "alpha": ALPHA, "distribution": distribution}
    for below, surface in ((False, RoughSurface(1.0, 1.5, ALPHA, distribution, shadowing=True)), (True, None)):
        surface = surface or RoughSurface(1.5, 1.0, ALPHA, distribution, shadowing=True)
        mirror = np.array([1.0, 1.0, -1.0]) if below else np.ones(3)
        expected = evaluate(mitsuba, bsdf, light * mirror, eye * mirror)
        found = (surface.transmit if through else surface.reflect)(mu_i, mu_o, phi)[:, 0, 0]
        seen = found > 1e-3 * found.max()
        assert seen.sum() > 30
        assert_close(found[seen], expected[seen], rtol=1e-4 if distribution == "ggx" else 1e-2, atol=0.0)


@pytest.mark.slow
@pytest.mark.parametrize("distribution", ["beckmann", "ggx"])
def test_roughconductor(mitsuba: Any, distribution: str) -> None:
    light, eye, mu_i, mu_o, phi = draw_directions(False)
    bsdf = {"type": "roughconductor", "eta": 0.2, "k": 3.0, "alpha": ALPHA, "distribution": distribution}
    found = RoughSurface(1.0, 0.2 + 3.0j, ALPHA, distribution, shadowing=True).reflect(mu_i, mu_o, phi)[:, 0, 0]
    expected = evaluate(mitsuba, bsdf, light, eye)
    seen = found > 1e-3 * found.max()
    assert seen.sum() > 30
    assert_close(found[seen], expected[seen], rtol=1e-4 if distribution == "ggx" else 1e-2, atol=0.0)
