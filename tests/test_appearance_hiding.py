"""Hiding power: closed forms of bare cards, absorbing and semi-infinite films; the thickness that hides, from both
sides."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.appearance.geometries import measure_panel
from vrte.appearance.hiding import (
    Conditions,
    Drawdown,
    Hiding,
    find_contrast,
    find_hiding,
    find_hiding_times,
    fit_lambertian_bases,
)
from vrte.appearance.kubelka_munk import reflect_film
from vrte.appearance.panel import Panel, make_panel

from .helpers import close_to

SEEN = [0.40, 0.44, 0.48, 0.52, 0.56, 0.60, 0.64, 0.68]
INDEX = 1.5
SURFACE = {"interface": {"above": 1.0, "below": INDEX}}
PLATE = {"interface": {"above": INDEX, "below": 1.3}}
MU_I = math.cos(math.radians(45.0))
WHITE = {"phase": {"henyey_greenstein": 0.6}, "albedo": 1.0, "thickness": 30.0}
GREY = {"phase": {"henyey_greenstein": 0.6}, "albedo": 0.8, "thickness": 5.0}


def prepare(*layers: dict[str, Any], at: list[float] = SEEN, **asked: Any) -> Panel:
    return make_panel({"layer": list(layers)}, at, **({"nodes": 6} | asked))


def read(panel: Panel, albedo: float, geometry: str = "45:0") -> np.ndarray:
    return measure_panel(panel.put_over(vrte.Lambertian(albedo)), geometry)


@pytest.mark.parametrize(
    ("above", "below", "nodes", "within"),
    [([], [], 6, 1e-14), ([SURFACE], [], 20, 1e-14), ([SURFACE], [PLATE], 20, 1e-8)],
)
def test_three_solves_tell_the_film_over_every_even_base(above: Any, below: Any, nodes: int, within: float) -> None:
    """f(A) = f(0) + u A/(1 - A r) with polarization: to rounding, and under surfaces to what the nodes miss."""
    film = {"phase": "rayleigh", "albedo": 0.95, "thickness": 0.3}
    panel = prepare(*above, film, *below, at=[0.5], nodes=nodes)
    for geometry in ("45:0", "8:di", "8:de", "45:as25"):
        even = fit_lambertian_bases(*(read(panel, albedo, geometry) for albedo in (0.0, 0.5, 1.0)))
        for albedo in (0.13, 0.8, 0.97):
            assert even.reflect(albedo) == close_to(read(panel, albedo, geometry), rtol=0.0, atol=within)


def test_films_that_never_hide_always_hide_or_need_not() -> None:
    """R = A exp(-tau/mu_i - tau) of a film that only absorbs: the ratio stays that of the cards. Thick dark films look
    as semi-infinite ones. Cards as much alike as the target need no film."""
    film = {"phase": "isotropic", "albedo": 0.0, "thickness": 0.7}
    found = find_hiding(prepare(film), Conditions(black=0.2))
    assert found.reflectance_over_white == close_to(0.8 * math.exp(-0.7 / MU_I - 0.7), rtol=1e-12, atol=0.0)
    assert found.contrast_ratios == close_to(0.25, rtol=1e-12, atol=0.0)
    assert (found.hiding_times, found.semi_infinite.any()) == (None, False)
    assert "however thick" in found.reason
    found = find_hiding(prepare({**GREY, "thickness": 100.0}))
    for ratio in (found.contrast_ratio, found.opacity, found.compare_cards(0.3, 0.9)):
        assert ratio == close_to(1.0, rtol=0.0, atol=1e-12)
    assert found.reflectance_over_black == close_to(found.semi_infinite, rtol=1e-10, atol=0.0)
    assert 0.0 < (found.hiding_times or 0.0) < 0.2
    assert find_contrast(prepare({**GREY, "thickness": math.inf})) == 1.0
    assert find_contrast(prepare(SURFACE, {**WHITE, "thickness": 0.0})) == 0.0
    found = find_hiding(prepare(GREY), Conditions(black=0.795))
    assert found.hiding_times == 0.0
    assert "bare cards" in found.reason


@pytest.mark.parametrize(("film", "times", "above"), [(WHITE, 1e-4, []), (GREY, 1.0, [SURFACE])])
def test_the_thickness_that_hides_is_met_by_direct_solves(film: dict[str, Any], times: float, above: list[Any]) -> None:
    """A thousandth thinner is not enough, a thousandth thicker is; whatever the film was that it began with."""
    began = {**film, "thickness": film["thickness"] * times}
    drawdown = Drawdown(prepare(*above, began), Conditions())
    hiding, reason = find_hiding_times(drawdown.find_contrast, 0.98, 1.0)
    assert (hiding is not None, reason) == (True, "")
    thin, thick = (
        find_contrast(prepare(*above, {**film, "thickness": began["thickness"] * hiding * factor}))
        for factor in (0.999, 1.001)
    )
    assert thin < 0.98 < thick
    assert len(drawdown.luminances) <= 8


@pytest.mark.parametrize("absorption", [1e-4, 0.01, 0.3])
def test_the_search_ends_within_a_thousandth(absorption: float) -> None:
    """Of the thickness that hides, whatever thickness it begins with: of films by Kubelka and Munk's closed form."""
    found = []
    for scattering in np.geomspace(1e-3, 1e3, 25):

        def find_ratio(times: float, S: float = float(scattering)) -> float:
            black, white = reflect_film(absorption * S, S, times, [0.0, 0.8])
            return float(black / white)

        hiding, _ = find_hiding_times(find_ratio, 0.98, 1.0)
        found += [find_ratio(hiding * factor) for factor in (0.999, 1.001)]
    assert max(found[::2]) < 0.98 < min(found[1::2])


@pytest.fixture(scope="module")
def white() -> Hiding:
    return find_hiding(prepare(WHITE))


def test_the_curve_rises_to_the_film_semi_infinite(white: Hiding) -> None:
    rising = np.stack([white.over_black, white.over_white, np.full_like(white.times, white.luminance_semi_infinite)])
    assert (np.diff(rising, axis=0) > 0.0).all()
    assert (np.diff([white.contrast_ratios, white.over_black]) > 0.0).all()
    assert white.opacity < white.paper_opacity < white.contrast_ratio
    index = int(np.flatnonzero(white.times == 1.0)[0])
    assert white.contrast_ratios[index] == close_to(white.contrast_ratio, rtol=1e-12, atol=0.0)
    assert white.times[0] < min(1.0, white.hiding_times) < max(1.0, white.hiding_times) < white.times[-1]
    differences = np.diff(np.log(white.times))
    assert differences.max() < 1.21
    assert differences[white.times[1:] < white.hiding_times].max() < 0.61


def test_between_its_exact_points_the_curve_is_smooth(white: Hiding) -> None:
    for film, found in ((WHITE, white), (GREY, find_hiding(prepare(GREY)))):
        drawdown, between = Drawdown(prepare(film), Conditions()), np.sqrt(found.times[1:] * found.times[:-1])[1:4]
        contrast, over_white = found.interpolate(between)
        exact = np.array([drawdown.measure(times) for times in between])
        assert contrast == close_to(exact[:, 0] / exact[:, 1], rtol=0.0, atol=2e-3)
        assert over_white == close_to(exact[:, 1], rtol=0.0, atol=2e-3)


def test_lengths_follow_where_the_film_has_one_and_a_picture_shows_it(white: Hiding) -> None:
    assert (white.length_um, white.hiding_length_um, white.spreading_rate) == (None, None, None)
    assert "times the film" in str(white)
    with pytest.raises(vrte.SceneError, match="where the curve ends"):
        white.interpolate(1e3)
    known = replace(white, length_um=20.0)
    assert known.hiding_length_um == close_to(20.0 * known.hiding_times, rtol=1e-12, atol=0.0)
    assert known.spreading_rate == close_to(50.0 / known.hiding_times, rtol=1e-12, atol=0.0)
    assert "m2 of dry film a litre" in str(known)
    assert known.plot().axes[0].get_xlabel().endswith("[µm]")
    left, right = white.plot().axes
    shown = [{text.get_text() for text in axes.get_legend().get_texts()} for axes in (left, right)]
    assert shown[0] == {f"0.98 at {white.hiding_times:.3g} times the film"}
    assert shown[1] == {"over white, 0.8", "over black, 0", "semi-infinite"}
    assert any(set(np.asarray(line.get_ydata()).tolist()) == {0.98} for line in left.lines)
