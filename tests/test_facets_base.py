"""Rough bases: as functions of one's own give them, smooth where facets hardly tilt, in any medium, quickly."""

from typing import Any

import numpy as np
import pytest

import vrte

from .helpers import assert_close, close_to

AIR = vrte.Layer(vrte.rayleigh(), 1.0, 0.4)
SEEN: dict[str, Any] = {"mu_i": [0.5, 0.9], "mu_o": [0.2, 0.6, 0.95], "phi": [0.0, 90.0, 130.0, 180.0]}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((1.5, 0.0), "base: roughness must be above 0: vrte.Mirror"),
        ((1.5, 2.0), "base: roughness must be 0 .smooth. or from"),
        ((1.5, 0.1, "gauss"), "Facets: distribution must be 'beckmann' or 'ggx'"),
        (
            (1.5, 0.1, "beckmann", False, True),
            "base: conserving gives back what facets hide from each other, and without",
        ),
        ((0.0, 0.1), "base: index must be n or n"),
        (((1.5, -1.0), 0.1), "base: index must be n or n"),
    ],
)
def test_what_no_surface_has_is_refused(arguments: tuple[Any, ...], words: str) -> None:
    with pytest.raises(vrte.SceneError, match=words):
        vrte.Facets(*arguments)


@pytest.mark.parametrize("base", [vrte.Facets(1.34, 0.197, shadowing=False), vrte.Facets((0.2, 3.0), 0.5, "ggx")])
def test_a_function_with_the_same_facets_gives_the_same_light(base: vrte.Facets) -> None:
    """Azimuths by an adaptive rule for any function there, nodes as sampling points: wide lobes are no harder."""
    scenes = [vrte.Scene([AIR], base), vrte.Scene([AIR], vrte.MuellerBase(base.reflect))]
    facets, function = (vrte.brdf(scene, **SEEN, nodes=20, accuracy=1e-9).mueller for scene in scenes)
    assert np.abs(facets - function).max() <= 1e-8 * function.max()


@pytest.mark.parametrize("distribution", ["beckmann", "ggx"])
def test_narrow_lobes_need_no_more_nodes(distribution: Any) -> None:
    scene = vrte.Scene([AIR], vrte.Facets(1.34, 0.03, distribution))
    few, many = (vrte.brdf(scene, **SEEN, nodes=nodes, accuracy=1e-8).mueller for nodes in (16, 40))
    mirrored = np.abs(many) > 0.5 * np.abs(many).max()  # the lobe itself is closed form
    assert np.abs(few - many)[~mirrored].max() <= 1e-5 * np.abs(many[~mirrored]).max()


def test_facets_that_hardly_tilt_are_a_mirror() -> None:
    away = SEEN | {"phi": [90.0, 130.0]}
    mirror = vrte.brdf(vrte.Scene([AIR], vrte.Mirror((0.2, 3.0))), **away, nodes=20).mueller
    for roughness, allowed in ((0.02, 1e-3), (0.01, 3e-4)):
        facets = vrte.brdf(vrte.Scene([AIR], vrte.Facets((0.2, 3.0), roughness)), **away, nodes=20).mueller
        assert np.abs(facets - mirror).max() <= allowed * mirror.max()


def test_what_counts_is_the_index_over_that_of_the_medium() -> None:
    inside = vrte.Layer(vrte.rayleigh(), 1.0, 0.4, host_index=1.5)
    binder, air = vrte.Scene([inside], vrte.Facets(2.4, 0.3)), vrte.Scene([AIR], vrte.Facets(2.4 / 1.5, 0.3))
    assert binder.below == binder.base
    found, expected = (vrte.brdf(scene, **SEEN, nodes=8).mueller for scene in (binder, air))
    assert_close(found, expected, rtol=0.0, atol=1e-13 * expected.max())


def test_what_bounces_between_facets_is_given_back() -> None:
    """All of it where facets reflect everything, less of it where each bounce takes its share; f stays reciprocal."""
    mu = [0.1, 0.5, 1.0]
    once, all_ = (vrte.Facets((0.2, 3.0), 0.5, "ggx", True, conserving) for conserving in (False, True))
    assert (once.reflectance(mu) < all_.reflectance(mu)).all()
    assert (all_.reflectance(mu) < 0.95).all()  # 0.92 after one bounce at most
    perfect = vrte.Facets((0.001, 1000.0), 0.5, "ggx")
    assert_close(perfect.reflectance(mu), 1.0, rtol=0.0, atol=1e-6)
    there, back = (all_.reflect(np.array(a), np.array(b), np.array(40.0))[0, 0] for a, b in ((0.2, 0.7), (0.7, 0.2)))
    assert there == close_to(back, rtol=1e-12, atol=0.0)
    scenes = [vrte.Scene([AIR], all_), vrte.Scene([AIR], vrte.MuellerBase(all_.reflect))]
    found, expected = (vrte.brdf(scene, **SEEN, nodes=16, accuracy=1e-8).mueller for scene in scenes)
    assert np.abs(found - expected).max() <= 1e-6 * expected.max()
