"""What is remembered of rough surfaces: the same numbers, within so many bytes."""

import numpy as np
import pytest

import vrte
from vrte.basics.arrays import Remembered
from vrte.discrete_ordinates.orders import rough
from vrte.optics import facet_energy


def test_the_least_recently_used_go_first() -> None:
    store = Remembered(most_bytes=8 * 100)  # an entry takes at most 10 numbers
    for name in range(12):
        store.find(name, lambda name=name: (np.full(10, float(name)),))
        store.find(0, lambda: (np.full(10, -1.0),))  # ever used again
    assert store.bytes <= 800
    assert [store.find(name, lambda: (np.full(10, -1.0),))[0][0] for name in (0, 1, 11)] == [0.0, -1.0, 11.0]


def test_what_is_large_is_made_anew_and_nothing_can_be_changed() -> None:
    store = Remembered(most_bytes=800)
    first = store.find("large", lambda: (np.ones(50),))
    assert store.find("large", lambda: (np.ones(50),)) is not first
    assert store.bytes == 0
    assert not first[0].flags.writeable


@pytest.mark.parametrize("below", [[], [vrte.Interface(1.5, 1.0)]], ids=["on top", "in a stack"])
def test_a_rough_surface_is_worked_out_once(below: list[vrte.Interface], monkeypatch: pytest.MonkeyPatch) -> None:
    """For all thicknesses and bases below it, bit for bit what it is anew; another surface is another one."""

    def solve(thickness: float, roughness: float = 0.3) -> vrte.Brdf:
        surface = vrte.Interface(1.0, 1.5, roughness=roughness, distribution="ggx", shadowing=True, conserving=True)
        scene = vrte.Scene([surface, vrte.Layer(vrte.rayleigh(), 0.99, thickness), *below], vrte.Lambertian(0.3))
        return vrte.brdf(scene, 0.6, [0.3, 0.9], [0.0, 90.0], nodes=6)

    def forget() -> None:
        monkeypatch.setattr(rough, "_EXPANDED", Remembered())
        facet_energy.find_lost.cache_clear()

    anew = []
    for thickness in (1.0, 1.1):
        forget()
        anew.append(solve(thickness))
    forget()
    calls = []
    integrate = rough.gather_orders
    monkeypatch.setattr(rough, "gather_orders", lambda *given: calls.append(given) or integrate(*given))
    counts = []
    for thickness, expected in zip((1.0, 1.1), anew, strict=True):
        found = solve(thickness)
        counts.append(len(calls))
        np.testing.assert_array_equal(found.mueller, expected.mueller)
        np.testing.assert_array_equal(found.reflectance, expected.reflectance)
    assert 0 < counts[0] == counts[1]
    solve(1.0, roughness=0.31)
    assert len(calls) > counts[1]
