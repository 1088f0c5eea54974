"""What smooth surfaces of spheres mirror: frames against fields in space, the sun's image against closed forms."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import vrte
from tests.test_render import COARSE, normals_of, sky_coherency, table, view
from vrte.basics.arrays import Array
from vrte.optics.facets import RoughSurface
from vrte.optics.fresnel import reflect_smooth
from vrte.render.geometry import place_camera
from vrte.render.rendering import find_fine_table
from vrte.render.setting import read
from vrte.render.sky import make_sky
from vrte.render.spheres import SUN_RADIUS, mirror_sun
from vrte.render.tables import Table, tabulate_brdf

from .helpers import assert_close, close_to

INDEX = 1.5 + 0.3j


def mirror_table(index: complex) -> Table:
    """A sphere that only mirrors, as if of glass or metal without end."""
    directions = COARSE.mu, COARSE.mu, COARSE.phi
    dark = np.zeros((*(one.size for one in directions), 4, 4))
    share = np.zeros(COARSE.mu.size)
    beams = reflect_smooth(index, COARSE.mu)
    return tabulate_brdf(vrte.Brdf(dark, share, *directions, {}, direct_transmittance=share, specular=beams), COARSE)


def amplitudes(index: complex, cosine: float) -> tuple[complex, complex]:
    """Fresnel's r_p, r_s, as anyone would write them."""
    behind = np.sqrt(1.0 - (1.0 - cosine**2) / index**2 + 0j)
    p = (index * cosine - behind) / (index * cosine + behind)
    return p, (cosine - index * behind) / (cosine + index * behind)


def stokes_of(coherency: Array, up: Array, right: Array) -> Array:
    """On the upright and the right of the picture; V is (handbook, conventions) 2 Im E_r conj(E_l) for l, r = l x k."""
    uu, rr, ur = up @ coherency @ up, right @ coherency @ right, up @ coherency @ right
    return np.array([uu + rr, uu - rr, 2.0 * ur.real, -2.0 * ur.imag]).real


def test_a_mirror_shows_the_sky_as_fields_in_space_are_reflected() -> None:
    sky = replace(make_sky("rayleigh", [0.45], 25.0, 0.3), sun=np.zeros(1))
    seen = view(sky, camera=place_camera(20.0, 130.0), size=60)
    found, normal = seen.stokes([mirror_table(INDEX)])[:, 0], normals_of(seen)
    toward = seen.camera.toward
    checked = 0
    for pixel in range(0, normal.shape[0], 101):
        cosine = float(normal[pixel] @ toward)
        travel = toward - 2.0 * cosine * normal[pixel]
        if travel[2] > -0.05 or cosine < 0.05:
            continue
        s = np.cross(travel, normal[pixel])
        s /= np.linalg.norm(s)
        r_p, r_s = amplitudes(INDEX, cosine)
        # p = s x k for both: at grazing incidence they are one, and r_p = r_s = -1 there
        turned = r_s * np.outer(s, s) + r_p * np.outer(np.cross(s, toward), np.cross(s, travel))
        light = turned @ sky_coherency(sky, travel) @ turned.conj().T
        expected = stokes_of(light, seen.camera.up, seen.camera.right)
        assert_close(found[pixel], expected, rtol=0.0, atol=2e-4 * expected[0])
        checked += 1
    assert checked > 10
    assert np.abs(found[:, 3]).max() > 0.02 * found[:, 0].max()  # a metal makes V of skylight


def test_in_a_furnace_a_mirror_shows_its_reflectance() -> None:
    seen = view(make_sky("uniform", [0.5], 30.0, 0.0))
    found = seen.stokes([mirror_table(1.5)])[:, 0]
    expected = reflect_smooth(1.5, np.cos(seen.pixels[1]))
    assert_close(found[:, 0], expected[:, 0, 0], rtol=0.0, atol=2e-4)
    assert_close(np.hypot(found[:, 1], found[:, 2]), -expected[:, 1, 0], rtol=0.0, atol=2e-4)


def test_nothing_absorbs_so_a_shiny_paint_cannot_be_told_from_a_furnace() -> None:
    """What the surface mirrors and what comes out below it make up for each other at every angle."""
    layers = [vrte.Interface(1.0, 1.5), vrte.Layer(vrte.rayleigh(), 1.0, 1.0)]
    here = table(vrte.Scene(layers, vrte.Lambertian(1.0)))
    assert here.specular is not None
    found = view(make_sky("uniform", [0.5], 30.0, 0.0)).stokes([here])[:, 0]
    assert np.abs(found - [1.0, 0.0, 0.0, 0.0]).max() < 2e-3


@pytest.mark.parametrize("size", [16, 60, 600])
def test_the_suns_image_holds_what_a_sphere_mirrors(size: int) -> None:
    """E/4 times the cross section, R of half the angle between sun and camera, where the normal halves it."""
    sky = make_sky("sun", [0.5], 40.0, 0.0)
    camera = place_camera(10.0, 50.0)
    image = mirror_sun(camera, sky.beam, 0.47 * size, size).reshape(size, size)
    assert image.sum() == close_to(0.25 * (0.47 * size) ** 2, rtol=1e-6, atol=0.0)
    half = camera.toward - sky.beam
    half /= np.linalg.norm(half)
    across = np.arange(size) + 0.5 - 0.5 * size
    middle = image.sum(axis=0) @ across, -image.sum(axis=1) @ across
    expected = 0.47 * size * np.array([half @ camera.right, half @ camera.up])
    assert_close(np.array(middle) / image.sum(), expected, rtol=0.0, atol=0.5)
    # no brighter than the sun, and as bright where its image fills a pixel
    brightest = 1.0 / (np.pi * np.sin(SUN_RADIUS) ** 2)
    assert image.max() < 1.02 * brightest
    if size == 600:
        assert image.max() > 0.9 * brightest


def test_the_suns_glint_is_polarized_as_fresnel_says() -> None:
    brewster = float(np.degrees(np.arctan(1.5)))  # from the vertical: that of the sun, and on its other side the camera
    sky = make_sky("sun", [0.5], 90.0 - brewster, 0.0)
    seen = view(sky, size=120, camera=place_camera(90.0 - brewster, 180.0))
    share = ((1.5**2 - 1.0) / (1.5**2 + 1.0)) ** 2 / 2.0  # all of it across the plane of incidence
    expected = share * 0.25 * seen.radius**2 * np.array([1.0, -1.0, 0.0, 0.0])
    assert_close(seen.stokes([mirror_table(1.5)])[:, 0].sum(axis=0), expected, rtol=0.0, atol=2e-3 * expected[0])


def rough_table(surface: RoughSurface) -> Table:
    """A sphere of facets alone."""
    return replace(mirror_table(1.5), specular=None, facets=surface)


@pytest.mark.parametrize(
    ("distribution", "roughness"), [("beckmann", 0.3), pytest.param("ggx", 0.3, marks=pytest.mark.slow)]
)
def test_in_a_furnace_facets_show_what_they_reflect(distribution: str, roughness: float) -> None:
    surface = RoughSurface(1.0, 1.5, roughness, distribution, shadowing=True)
    seen = view(make_sky("uniform", [0.5], 30.0, 0.0))
    found = seen.stokes([rough_table(surface)])[:, 0]
    points, weights = np.polynomial.legendre.leggauss(200)
    mu_i, phi = 0.5 * (points + 1.0), np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
    cosines = np.cos(seen.pixels[1])
    for wanted in (0.95, 0.6, 0.3):
        pixel = int(np.abs(cosines - wanted).argmin())
        columns = surface.reflect(mu_i[:, None], cosines[pixel], np.degrees(phi))[..., 0]
        expected = np.einsum("ips,i->s", columns, 0.5 * weights * mu_i) * (2.0 * np.pi / phi.size)
        assert found[pixel, 0] == close_to(expected[0], rtol=0.01, atol=0.0)
        assert np.hypot(found[pixel, 1], found[pixel, 2]) == close_to(
            abs(expected[1]), rtol=0.0, atol=0.01 * expected[0]
        )


@pytest.mark.slow
def test_hardly_rough_facets_show_what_a_mirror_does() -> None:
    """Frames of Stokes vectors, too: away from the horizon and the sun, which facets see beside the mirrored ray."""
    sky = make_sky("rayleigh", [0.45], 25.0, 0.3)
    seen = view(sky, camera=place_camera(20.0, 130.0), size=60)
    rough = seen.stokes([rough_table(RoughSurface(1.0, 1.5, 0.01, "beckmann", True))])[:, 0]
    smooth = seen.stokes([mirror_table(1.5)])[:, 0]
    normal = normals_of(seen)
    cosine = normal @ seen.camera.toward
    mirrored = 2.0 * cosine[:, None] * normal - seen.camera.toward  # to where each pixel looks
    clear = (np.abs(mirrored[:, 2]) > 0.15) & (cosine > 0.25) & (mirrored @ -sky.beam < 0.99)
    assert clear.sum() > 500
    largest = smooth[clear, 0].max()
    assert_close(rough[clear], smooth[clear], rtol=0.0, atol=0.02 * largest)
    assert np.abs(smooth[clear, 1:3]).max() > 0.2 * largest  # polarized enough to tell


@pytest.mark.slow
def test_facets_spread_the_suns_glint_and_keep_its_light() -> None:
    seen = view(make_sky("sun", [0.5], 25.0, 0.0), camera=place_camera(20.0, 130.0), size=300)
    rough, smooth = (
        seen.stokes([one])[:, 0]
        for one in (rough_table(RoughSurface(1.0, 1.5, 0.05, "beckmann", True)), mirror_table(1.5))
    )
    assert_close(rough.sum(axis=0), smooth.sum(axis=0), rtol=0.02, atol=0.0)
    assert rough[:, 0].max() < 0.03 * smooth[:, 0].max()


def test_a_bare_rough_base_is_seen_facet_by_facet(tmp_path: Path) -> None:
    """A table of 32 angles cannot hold its highlight: 20 % off by splines."""
    path = tmp_path / "metal.toml"
    facets = 'kind = "facets"\nindex = [0.2, 3.4]\nroughness = 0.1\nconserving = false\n'
    path.write_text(f'[[layer]]\nphase = "isotropic"\nalbedo = 0.0\nthickness = 0.0\n\n[base]\n{facets}')
    (material,), _ = read([path])
    found, error = find_fine_table(material, [COARSE])
    assert found.facets == RoughSurface(1.0, 0.2 + 3.4j, 0.1, shadowing=True, closed=True)
    assert error < 1e-6
    assert np.abs(found.splines).max() < 1e-6
    assert not material.coloured
    path.write_text(path.read_text().replace("[0.2, 3.4]", '"gold"'))
    assert read([path])[0][0].coloured
