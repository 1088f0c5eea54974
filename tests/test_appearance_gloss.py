"""Gloss: apertures of glossmeters, what rough surfaces send into them, and gloss units against closed forms."""

import itertools
import math

import numpy as np
import pytest

import vrte
from vrte.appearance.geometries import Rectangular, Round, collect_mirrored, project_solid_angle
from vrte.appearance.gloss import (
    BLACK_GLASS,
    RECEPTORS,
    SOURCE,
    find_gloss,
    find_glosses,
    list_gloss_directions,
    read_gloss,
)
from vrte.appearance.panel import Panel
from vrte.basics.errors import SceneError
from vrte.optics.fresnel import reflect_smooth
from vrte.scene.boundary import Boundary
from vrte.scene.interface import Interface

from .helpers import close_to

ANGLES = [20.0, 60.0, 85.0]
VISIBLE = np.array([0.43, 0.466, 0.505, 0.544, 0.583, 0.622, 0.66])
NOTHING = vrte.Layer(vrte.isotropic(), albedo=0.0, thickness=0.0)


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


def test_apertures_have_the_projected_solid_angles_of_closed_forms() -> None:
    """Of a cone, and of a rectangle parallel to a small area below its middle: a textbook's configuration factor
    (Siegel, Howell)."""
    for angle_deg, half_deg in itertools.product((0.0, 8.0, 30.0, 75.0), (0.5, 5.0, 15.0)):
        expected = np.pi * math.sin(math.radians(half_deg)) ** 2 * cosine(angle_deg)
        assert project_solid_angle(Round(2.0 * half_deg), angle_deg) == close_to(expected, rtol=1e-13, atol=0.0)
    x, y = (math.tan(math.radians(0.5 * one)) for one in (60.0, 100.0))
    x_size, y_size = math.sqrt(1.0 + x * x), math.sqrt(1.0 + y * y)
    quarter = 0.5 * (x / x_size * math.atan(y / x_size) + y / y_size * math.atan(x / y_size))
    assert project_solid_angle(Rectangular(60.0, 100.0), 0.0) == close_to(4.0 * quarter, rtol=1e-9, atol=0.0)
    flat = project_solid_angle(RECEPTORS[85.0], 0.0)
    assert project_solid_angle(RECEPTORS[85.0], 85.0) == close_to(flat * cosine(85.0), rtol=1e-12, atol=0.0)


SURFACES = [
    Interface(1.0, 1.5, 0.01, shadowing=False),
    Interface(1.0, 1.5, 0.01, "ggx", conserving=False),
    Interface(1.0, 1.5, 0.08, "ggx", shadowing=False),
    Interface(1.0, 1.5, 0.4),
]


@pytest.mark.parametrize("surface", SURFACES[:3], ids=lambda one: one.in_words[35:])
def test_receptor_gets_what_a_plain_grid_sums_up(surface: Interface) -> None:
    """The grid is as good as 1/count^2; at 85 degrees the lobe is a fifth of a degree wide across and needs more."""
    for (angle_deg, receptor), finer in zip(RECEPTORS.items(), (1, 3, 8), strict=True):
        coarse, fine = (sum_grid(surface, angle_deg, receptor, count, finer) for count in (32, 64))
        expected = fine + (fine - coarse) / 3.0
        assert collect_mirrored(surface, cosine(angle_deg), receptor) == close_to(expected, rtol=2e-5, atol=0.0)


@pytest.mark.parametrize("surface", SURFACES, ids=lambda one: one.in_words[35:])
def test_hemisphere_gets_all_that_the_surface_reflects(surface: Interface) -> None:
    """A smooth surface sends its whole beam into any receptor, and the source's extent moves that little."""
    fraction = collect_mirrored(surface, 1.0, Round(180.0), points=16)
    assert fraction == close_to(surface.share(1.0)[0].item(), rtol=1e-6, atol=0.0)
    for angle_deg, receptor in RECEPTORS.items():
        expected = Interface(1.0, 1.5).share(cosine(angle_deg))[0].item()
        for source, rtol in ((None, 1e-13), (SOURCE, 7e-4)):
            found = collect_mirrored(Interface(1.0, 1.5), cosine(angle_deg), receptor, source)
            assert found == close_to(expected, rtol=rtol, atol=0.0)


def make_bare_panel(surface: Interface | None, base: Boundary | None = None, **asked: object) -> Panel:
    """A surface over a base at wavelengths of the visible, and nothing between them."""
    stack = [NOTHING] if surface is None else [surface, NOTHING]
    scene = vrte.Scene(stack, base)
    return Panel(VISIBLE, (scene,) * VISIBLE.size, (0.0,), asked)


def reflect_by_fresnel(index: float, angle_deg: float) -> float:
    """Of unpolarized light, after the sine and tangent formulas."""
    incident = math.radians(angle_deg)
    refracted = math.asin(math.sin(incident) / index)
    less, more = incident - refracted, incident + refracted
    return 0.5 * ((math.sin(less) / math.sin(more)) ** 2 + (math.tan(less) / math.tan(more)) ** 2)


def test_smooth_surface_has_the_gloss_of_fresnel() -> None:
    """A black glass of 1.567 has 100, and reflects 0.0491, 0.1001 and 0.6191 (the standards, from memory)."""
    for index in (1.567, 1.5, 1.33):
        for angle, gloss in find_glosses(make_bare_panel(Interface(1.0, index))).items():
            expected = 100.0 * reflect_by_fresnel(index, angle) / reflect_by_fresnel(1.567, angle)
            assert gloss == close_to(expected, rtol=1e-12, atol=0.0)
    glass = [BLACK_GLASS.share(cosine(angle))[0].item() for angle in ANGLES]
    assert glass == close_to([0.0491, 0.1001, 0.6191], rtol=0.0, atol=6e-5)
    metal = find_gloss(make_bare_panel(None, vrte.Mirror((0.8, 6.0))), 20.0)  # no surface but the mirror itself
    expected = reflect_smooth(0.8 + 6.0j, cosine(20.0))[0, 0] / reflect_by_fresnel(1.567, 20.0)
    assert metal == close_to(100.0 * expected, rtol=1e-12, atol=0.0)
    assert metal > 1000.0


def test_white_below_a_smooth_surface_adds_its_closed_form() -> None:
    """a/(pi n^2) T_i T_o/(1 - a R), R of light from everywhere inside, over the receptor by a fine grid."""
    index, albedo = 1.5, 0.9
    surface = Interface(1.0, index)
    mu, weights = vrte.hemisphere(2000)
    outside = float(2.0 * (weights * mu) @ surface.share(mu)[0])
    inside = 1.0 - (1.0 - outside) / index**2
    glosses = find_glosses(make_bare_panel(surface, vrte.Lambertian(albedo), nodes=64))
    for angle, gloss in glosses.items():
        receptor, (s, t) = RECEPTORS[angle], np.meshgrid(*2 * [np.linspace(-0.995, 0.995, 200)])
        direction, density = receptor.aim(s, t)
        mu_o = direction[..., 2] * cosine(angle) - direction[..., 0] * math.sin(math.radians(angle))
        through = surface.share(mu_o.ravel())[1].reshape(mu_o.shape)
        seen = float((density * mu_o * through).sum()) * 0.01**2
        diffuse = albedo / (np.pi * index**2) * surface.share(cosine(angle))[1][0] * seen / (1.0 - albedo * inside)
        smooth = reflect_by_fresnel(index, angle)
        mirrored = 100.0 * smooth / reflect_by_fresnel(1.567, angle)
        assert gloss - mirrored == close_to(100.0 * diffuse / reflect_by_fresnel(1.567, angle), rtol=2e-3, atol=0.0)


def test_rough_surface_over_black_has_its_lobe_alone() -> None:
    """Of the smooth glass the average over the source is what the lobe is compared with."""
    surface = Interface(1.0, 1.5, 0.2, shadowing=True)
    for angle, gloss in find_glosses(make_bare_panel(surface, nodes=8), [20.0, 60.0]).items():
        lobe, glass = (collect_mirrored(one, cosine(angle), RECEPTORS[angle], SOURCE) for one in (surface, BLACK_GLASS))
        assert gloss == close_to(100.0 * lobe / glass, rtol=1e-6, atol=0.0)


def test_finest_roughness_is_smooth_at_60_and_85_degrees_and_not_at_20() -> None:
    """Lobes of alpha 0.01 are 1.1 degrees wide on either side in the plane, and the receptor at 20 degrees 0.9."""
    for (angle, receptor), least in zip(RECEPTORS.items(), (0.65, 0.99, 0.98), strict=True):
        surfaces = Interface(1.0, 1.5, 0.01), Interface(1.0, 1.5)
        fine, smooth = (collect_mirrored(one, cosine(angle), receptor, SOURCE) for one in surfaces)
        assert least < fine / smooth < (0.67 if angle == 20.0 else 1.0)
    in_plane, across = (math.tan(math.radians(half)) / 0.02 for half in (0.9, 1.8))
    alone = collect_mirrored(Interface(1.0, 1.5, 0.01), cosine(20.0), RECEPTORS[20.0]) / reflect_by_fresnel(1.5, 20.0)
    assert alone == close_to(math.erf(in_plane) * math.erf(across / cosine(20.0)), rtol=1e-3, atol=0.0)  # a Gaussian


def test_spectrum_of_the_right_directions_is_read() -> None:
    panel = make_bare_panel(Interface(1.0, 1.5), vrte.Lambertian(0.5), nodes=8)
    spectrum = panel.solve(*list_gloss_directions([20.0, 60.0]))
    assert read_gloss(spectrum, panel.surface, 60) == close_to(find_gloss(panel), rtol=1e-9, atol=0.0)
    with pytest.raises(SceneError, match=r"gloss at 85 degrees needs mu_i = 0\.0871"):
        read_gloss(spectrum, panel.surface, 85.0)
