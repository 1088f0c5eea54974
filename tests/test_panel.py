"""A panel: a scene at several wavelengths, its particles worked out once, solved as often as is asked."""

import math
import threading

import numpy as np
import pytest

import vrte
from vrte.appearance.panel import make_panel
from vrte.calls.side_by_side import run_side_by_side

from .helpers import assert_close

FILM = {"phase": "isotropic", "albedo": 0.9, "thickness": 2.0}
COAT = [
    {"interface": {"above": 1.0, "below": 1.5}},
    {"phase": {"henyey_greenstein": 0.6}, "albedo": 0.99, "thickness": 3.0},
]
TWO = [0.5, 0.6]


def test_a_panel_gives_what_brdf_gives_at_each_wavelength() -> None:
    panel = make_panel({"layer": COAT, "base": {"kind": "lambertian", "albedo": 0.3}}, TWO, nodes=8)
    assert [one.index_below for one in panel.surface if one] == [1.5, 1.5]
    bare = panel.take_off_surface()
    assert (bare.surface, bare.scenes[0].index_above) == ((None, None), 1.5)
    found = panel.solve([0.5, 0.9], [0.3, 1.0], [0.0, 180.0])
    for scene, one in zip(panel.scenes, found, strict=True):
        alone = vrte.brdf(scene, [0.5, 0.9], [0.3, 1.0], [0.0, 180.0], nodes=8, threads=1)
        assert np.array_equal(one.mueller, alone.mueller)
        assert np.array_equal(one.total_reflectance, alone.total_reflectance)


def test_a_film_is_made_thicker_and_put_over_other_bases() -> None:
    white = {"index": 2.5, "size": {"lognormal": {"median_um": 0.1, "sigma": 1.2}}}
    content = {"host_index": 1.5, "particles": {"white": white}}
    film = {"particles": "white", "thickness_um": 5.0, "volume_fraction": 0.05}
    panel = make_panel({**content, "layer": [film]}, TWO, nodes=6)
    assert (panel.film, panel.length_um) == (0, 5.0)
    base = {"kind": "lambertian", "albedo": 0.8}
    other = make_panel({**content, "layer": [film | {"thickness_um": 20.0}], "base": base}, TWO, nodes=6)
    moved = panel.make_as_thick(20.0).put_over(vrte.Lambertian(0.8))
    assert moved.length_um == 20.0
    assert_close(moved.solve(0.7).reflectance, other.solve(0.7).reflectance, rtol=0.0, atol=1e-13)
    semi_infinite = panel.make_as_thick(math.inf)
    assert semi_infinite.length_um == math.inf
    assert_close(semi_infinite.solve(0.7).reflectance, 1.0, rtol=0.0, atol=1e-8)  # nothing absorbs
    # the layers below a semi-infinite film go, also their thickness, and which layer is the film stays said
    layers = [FILM, {"interface": {"above": 1.0, "below": 1.5}}, FILM]
    panel = make_panel({"layer": layers}, TWO, layer=1, nodes=4).scale_film(math.inf)
    assert panel.lengths_um == (math.inf,)
    alone = make_panel({"layer": [FILM]}, TWO, nodes=4).scale_film(math.inf)
    assert np.array_equal(panel.solve(0.5).reflectance, alone.solve(0.5).reflectance)


def test_wavelengths_are_the_files_or_the_visible_as_far_as_it_is_known() -> None:
    assert make_panel({"layer": [FILM]}).wavelength_um[[0, -1]].tolist() == [0.4, 0.7]
    assert make_panel({"layer": [FILM], "wavelength_um": [0.45, 0.5]}).wavelength_um.tolist() == [0.45, 0.5]
    grains = {"r": {"index": "rutile", "radius_um": 0.01}}
    panel = make_panel({"particles": grains, "layer": [{"particles": "r", "thickness": 1.0}]})
    assert panel.wavelength_um[[0, -1]].tolist() == [0.43, 0.7]
    assert make_panel(panel, nodes=5).asked["nodes"] == 5


def test_calls_side_by_side_keep_their_order_and_end_with_the_first_error() -> None:
    together = threading.Barrier(2, timeout=30)  # passed only where two are in it at once
    assert run_side_by_side([lambda: (together.wait(), 1)[1], lambda: (together.wait(), 2)[1]], workers=2) == [1, 2]
    stop, ticks = np.zeros(1, np.int32), []

    def fail() -> int:
        raise ExpectedError

    class ExpectedError(Exception):
        pass

    with pytest.raises(ExpectedError):
        run_side_by_side([fail, lambda: 1], lambda done, total: ticks.append((done, total)), 2, stop)
    assert stop[0] == 1
    assert all(total == 2 for _, total in ticks)
