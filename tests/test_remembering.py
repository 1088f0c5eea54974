"""What is remembered of rough surfaces: the same numbers, within so many bytes."""

import numpy as np
import pytest

import vrte
from vrte.basics.remembering import Remembered
from vrte.discrete_ordinates.orders import rough
from vrte.optics import facet_energy


def test_the_least_recently_used_go_first() -> None:
    store = Remembered(most_bytes=8 * 100)  # an entry takes at most 10 numbers
    for name in range(12):
        store.find(name, lambda name=name: (np.full(10, float(name)),))
        store.find(0, lambda: (np.full(10, -1.0),))  # ever used again
    assert store.bytes <= 800
    assert store.find(0, lambda: (np.full(10, -1.0),))[0][0] == 0.0
    assert store.find(1, lambda: (np.full(10, -1.0),))[0][0] == -1.0
    assert store.find(11, lambda: (np.full(10, -1.0),))[0][0] == 11.0


def test_what_is_large_is_made_anew_and_nothing_can_be_changed() -> None:
    store = Remembered(most_bytes=800)
    first = store.find("large", lambda: (np.ones(50),))
    assert store.find("large", lambda: (np.ones(50),)) is not first
    assert store.bytes == 0
    with pytest.raises(ValueError, match="read-only"):
        first[0][0] = 2.0


def test_a_rough_surface_is_worked_out_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """For all thicknesses and bases below it, bit for bit what it is anew."""
    surface = vrte.Interface(1.0, 1.5, roughness=0.3, distribution="ggx", shadowing=True, conserving=True)
    scenes = [vrte.Scene([surface, vrte.Layer(vrte.rayleigh(), 0.99, t)], vrte.Lambertian(0.3)) for t in (1.0, 2.0)]

    def forget() -> None:
        for module, name in ((rough, "_EXPANDED"), (facet_energy, "_SHARED")):
            monkeypatch.setattr(module, name, Remembered())

    anew = []
    for scene in scenes:
        forget()
        anew.append(vrte.brdf(scene, 0.6, [0.3, 0.9], [0.0, 90.0], nodes=6))
    forget()
    calls = []
    integrate = rough.integrate_interface
    monkeypatch.setattr(rough, "integrate_interface", lambda *given: calls.append(given) or integrate(*given))
    first = vrte.brdf(scenes[0], 0.6, [0.3, 0.9], [0.0, 90.0], nodes=6)
    once = len(calls)
    second = vrte.brdf(scenes[1], 0.6, [0.3, 0.9], [0.0, 90.0], nodes=6)
    assert once > 0
    assert len(calls) == once
    for found, expected in zip((first, second), anew, strict=True):
        assert np.array_equal(found.mueller, expected.mueller)
        assert np.array_equal(found.reflectance, expected.reflectance)
    # another surface is another one
    other = vrte.Interface(1.0, 1.5, roughness=0.31, distribution="ggx", shadowing=True, conserving=True)
    vrte.brdf(vrte.Scene([other, scenes[0].layers[0]], vrte.Lambertian(0.3)), 0.6, [0.3, 0.9], [0.0, 90.0], nodes=6)
    assert len(calls) > once
