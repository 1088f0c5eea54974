"""Gloss: apertures of glossmeters, what rough surfaces send into them, and gloss units against closed forms."""

import math

import numpy as np
import pytest

from vrte.appearance.apertures import Receptor, Rectangular, Round, collect_mirrored, project_solid_angle
from vrte.basics.errors import SceneError
from vrte.scene.interface import Interface

SOURCE = Rectangular(0.75, 2.5)
RECEPTORS = {20.0: Rectangular(1.8, 3.6), 60.0: Rectangular(4.4, 11.7), 85.0: Rectangular(4.0, 6.0)}


def cosine(angle_deg: float) -> float:
    return math.cos(math.radians(angle_deg))


def sum_grid(interface: Interface, angle_deg: float, receptor: Rectangular, count: int, fine: int) -> float:
    """The share in a receptor by the midpoint rule on a plane grid, from the facets' BRDF and plain vectors."""
    angle = math.radians(angle_deg)
    axis, in_plane = np.array([[math.sin(angle), 0.0, math.cos(angle)], [math.cos(angle), 0.0, -math.sin(angle)]])
    middle, across = ((np.arange(n) + 0.5) / n * 2.0 - 1.0 for n in (count, count * fine))
    broad, high = (math.tan(math.radians(0.5 * one)) for one in (receptor.in_plane_deg, receptor.across_deg))
    x, y = np.meshgrid(broad * middle, high * across, indexing="ij")
    ray = axis + x[..., None] * in_plane + y[..., None] * np.array([0.0, 1.0, 0.0])
    length = np.linalg.norm(ray, axis=-1)
    mu_o = ray[..., 2] / length
    f = interface.facets.reflect(math.cos(angle), mu_o, np.degrees(np.arctan2(ray[..., 1], ray[..., 0])))[..., 0, 0]
    return float((f * mu_o / length**3).sum()) * 4.0 * broad * high / (count**2 * fine)


@pytest.mark.parametrize("angle_deg", [0.0, 8.0, 30.0, 75.0])
@pytest.mark.parametrize("half_deg", [0.5, 5.0, 15.0])
def test_cone_has_the_projected_solid_angle_of_the_closed_form(angle_deg: float, half_deg: float) -> None:
    expected = np.pi * math.sin(math.radians(half_deg)) ** 2 * cosine(angle_deg)
    assert project_solid_angle(Round(2.0 * half_deg), angle_deg) == pytest.approx(expected, rel=1e-13)


def test_rectangle_has_the_view_factor_of_the_closed_form() -> None:
    """Of a rectangle parallel to a small area below its middle: a textbook's configuration factor (Siegel, Howell)."""
    x, y = (math.tan(math.radians(0.5 * one)) for one in (60.0, 100.0))
    x_size, y_size = math.sqrt(1.0 + x * x), math.sqrt(1.0 + y * y)
    quarter = 0.5 * (x / x_size * math.atan(y / x_size) + y / y_size * math.atan(x / y_size))
    assert project_solid_angle(Rectangular(60.0, 100.0), 0.0) == pytest.approx(4.0 * quarter, rel=1e-9)
    flat = project_solid_angle(RECEPTORS[85.0], 0.0)
    assert project_solid_angle(RECEPTORS[85.0], 85.0) == pytest.approx(flat * cosine(85.0), rel=1e-12)


SURFACES = [
    Interface(1.0, 1.5, 0.01),
    Interface(1.0, 1.5, 0.01, "ggx", shadowing=True),
    Interface(1.0, 1.5, 0.08, "ggx"),
    Interface(1.0, 1.5, 0.4, shadowing=True, conserving=True),
]


@pytest.mark.parametrize("surface", SURFACES[:3], ids=lambda one: one.in_words[35:])
@pytest.mark.parametrize("angle_deg", [20.0, 60.0, 85.0])
def test_receptor_gets_what_a_plain_grid_sums_up(surface: Interface, angle_deg: float) -> None:
    """The grid is as good as 1/count^2; at 85 degrees the lobe is a fifth of a degree wide across and needs more."""
    receptor, finer = RECEPTORS[angle_deg], {20.0: 1, 60.0: 3, 85.0: 8}[angle_deg]
    coarse, fine = (sum_grid(surface, angle_deg, receptor, count, finer) for count in (32, 64))
    expected = fine + (fine - coarse) / 3.0
    assert collect_mirrored(surface, cosine(angle_deg), receptor) == pytest.approx(expected, rel=2e-5)


@pytest.mark.parametrize("surface", SURFACES[1:], ids=lambda one: one.in_words[35:])
@pytest.mark.parametrize("angle_deg", [20.0, 60.0, 85.0])
def test_more_points_change_nothing(surface: Interface, angle_deg: float, monkeypatch: pytest.MonkeyPatch) -> None:
    share = collect_mirrored(surface, cosine(angle_deg), RECEPTORS[angle_deg], SOURCE)
    monkeypatch.setattr("vrte.appearance.apertures.SOURCE_POINTS", 5)
    more = collect_mirrored(surface, cosine(angle_deg), RECEPTORS[angle_deg], SOURCE, 10)
    assert share == pytest.approx(more, rel=1e-6)


@pytest.mark.parametrize("surface", SURFACES, ids=lambda one: one.in_words[35:])
def test_hemisphere_gets_all_that_the_surface_reflects(surface: Interface) -> None:
    share = collect_mirrored(surface, 1.0, Round(180.0), points=16)
    assert share == pytest.approx(surface.share(1.0)[0].item(), rel=1e-6)


def test_wide_cone_gets_all_of_a_narrow_lobe() -> None:
    """Of a slanted beam whose lobe is well inside, seen through both kinds of aperture."""
    surface = Interface(1.0, 1.5, 0.02)
    expected = surface.share(cosine(50.0))[0].item()
    wide: list[Receptor] = [Round(60.0), Rectangular(60.0, 60.0)]
    for receptor in wide:
        assert collect_mirrored(surface, cosine(50.0), receptor) == pytest.approx(expected, rel=1e-8)


def test_smooth_surface_sends_its_whole_beam_and_a_source_moves_that_little() -> None:
    glass = Interface(1.0, 1.5)
    for angle_deg, receptor in RECEPTORS.items():
        expected = glass.share(cosine(angle_deg))[0].item()
        assert collect_mirrored(glass, cosine(angle_deg), receptor) == pytest.approx(expected, rel=1e-13)
        assert collect_mirrored(glass, cosine(angle_deg), receptor, SOURCE) == pytest.approx(expected, rel=7e-4)


def test_apertures_below_the_horizon_and_without_size_are_refused() -> None:
    glass = Interface(1.0, 1.5, 0.1)
    with pytest.raises(SceneError, match=r"aperture reaches 5 degrees from its axis at 87: below the surface"):
        collect_mirrored(glass, cosine(87.0), Round(10.0))
    with pytest.raises(SceneError, match="mu_i must be above 0"):
        collect_mirrored(glass, 0.0, Round(10.0))
    with pytest.raises(SceneError, match=r"aperture: diameter_deg must be an angle from 0.001 to 180 degrees, not 0"):
        Round(0.0)
    with pytest.raises(SceneError, match=r"aperture: across_deg must be an angle from 0.001 to 170 degrees, not 180"):
        Rectangular(1.0, 180.0)
