"""Smooth interfaces and mirrors, solved: against the oracle, closed forms, what nature keeps, and others' programs."""

from typing import Any

import numpy as np
import pytest

import vrte
from tests import exact

from . import oracle
from .closed_forms import airy_sum, bare_base, walsh
from .helpers import assert_close, close_to
from .literal import azimuthal_sum
from .scenes import TURNING

MU_I, MU_O = [0.1, 0.6, 1.0], [0.2, 0.7, 1.0]
ANGLES = np.array([0.0, 40.0, 150.0, 250.0])
RAYLEIGH, SHORT = vrte.rayleigh(), TURNING
METAL, SILVER = vrte.Mirror(0.2 + 3.0j), vrte.Mirror(1e-3 + 1e3j)
P, D = np.diag([1.0, 1.0, 1.0, -1.0]), np.diag([1.0, 1.0, -1.0, -1.0])


@pytest.mark.parametrize(("index", "nodes"), [(1.5, 28), (1.0001, 48), (4.0, 40)])
def test_a_lambertian_base_under_a_surface(index: float, nodes: int) -> None:
    """Walsh's integral, known for paint and plastic, closes the sum of all bounces. Measured: 4e-15."""
    assert_close(walsh(1.5), [0.0917780, 0.5963458], rtol=0.0, atol=5e-8)
    scene = vrte.Scene([vrte.Interface(1.0, index)], vrte.Lambertian(0.5))
    f = vrte.brdf(scene, MU_I, MU_O, 0.0, nodes=nodes)
    assert_close(f.mueller[:, :, 0, 0, 0], bare_base(index, 0.5, MU_I, MU_O), rtol=1e-13, atol=0.0)
    assert f.specular is not None


@pytest.mark.parametrize("thickness", [0.0, 0.3, 5.0])
def test_plates_are_airy_sums_of_intensities(thickness: float) -> None:
    """Glass that absorbs between air and water, and varnish on metals and glass, at normal incidence as well."""
    plate = [vrte.Interface(1.0, 1.5), vrte.Layer(RAYLEIGH, 0.0, thickness)]
    f = vrte.brdf(vrte.Scene([*plate, vrte.Interface(1.5, 1.33)]), MU_I, MU_O, ANGLES, nodes=8, transmission=True)
    back, on = airy_sum(MU_I, 1.5, 1.33, thickness)
    assert_close(f.specular, back, rtol=0.0, atol=1e-13)
    assert_close(f.specular_transmission, on, rtol=0.0, atol=1e-13)
    assert_close(f.direct_transmittance, on[:, 0, 0], rtol=0.0, atol=1e-13)
    assert not f.mueller.any()
    for index in (0.2 + 3.0j, 2.0 + 3.0j, 1.7):
        f = vrte.brdf(vrte.Scene(plate, vrte.Mirror(index)), MU_I, MU_O, ANGLES, nodes=8)
        assert_close(f.specular, airy_sum(MU_I, 1.5, index, thickness, True)[0], rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("index", [1.0, 1.5])
def test_an_interface_between_like_media_is_none(index: float) -> None:
    """Bit for bit, whatever the index of both."""
    none, stack = vrte.Interface(index, index), [vrte.Layer(SHORT, 0.95, 1.0)]
    found = [
        vrte.brdf(vrte.Scene(parts), MU_I, MU_O, ANGLES, nodes=6, transmission=True)
        for parts in ([none, *stack, none], stack)
    ]
    assert np.array_equal(found[0].mueller, found[1].mueller)
    assert np.array_equal(found[0].transmission, found[1].transmission)
    assert found[0].specular is None


# eradiate-mitsuba 0.5.0 (PyPI), variant scalar_mono_polarized_double: volpath (rr_depth 50) in stokes (meridian_align),
# mdistant sensors, a homogeneous medium with the phase function rayleigh_polarized under a dielectric of index 1.5, lit
# by an envmap of 1024 x 2049 with the radiance (1 + x)^2, x the component of the unit vector towards the sky: means of
# I, Q, U, V over the seeds 1 to 20 with 200,000 samples each, and the standard errors of these means. U is that of axes
# x, y with x along the meridian and x cross y along the light, ours turned over.
FILM = [  # albedo 1, thickness 0.5, over a diffuse base of reflectance 0.2; mu_o 0.25, 0.7, 0.95, phi 0, 60, 120, 180
    ((0.176289, 0.037328, 0.000071, -0.000036), (0.000281, 0.000155, 0.000118, 0.000030)),
    ((0.239751, -0.007775, -0.012138, 0.000696), (0.000287, 0.000109, 0.000125, 0.000029)),
    ((0.738905, -0.307337, -0.012766, 0.000691), (0.000444, 0.000336, 0.000118, 0.000022)),
    ((1.171685, -0.560571, -0.000016, -0.000004), (0.000892, 0.000548, 0.000071, 0.000030)),
    ((0.220164, 0.011478, 0.000125, -0.000012), (0.000330, 0.000172, 0.000134, 0.000027)),
    ((0.231824, -0.007947, -0.010279, 0.000595), (0.000255, 0.000142, 0.000124, 0.000036)),
    ((0.292753, -0.080436, -0.011329, 0.000589), (0.000395, 0.000224, 0.000157, 0.000030)),
    ((0.342362, -0.134309, 0.000047, -0.000046), (0.000540, 0.000360, 0.000109, 0.000038)),
    ((0.227271, 0.001903, -0.000385, 0.000043), (0.000315, 0.000130, 0.000168, 0.000026)),
    ((0.233730, -0.001107, -0.004047, 0.000239), (0.000266, 0.000117, 0.000135, 0.000024)),
    ((0.253999, -0.009473, -0.004944, 0.000275), (0.000282, 0.000190, 0.000126, 0.000028)),
    ((0.266699, -0.015085, -0.000007, 0.000016), (0.000266, 0.000108, 0.000120, 0.000028)),
]
PLATE = [  # albedo 0.95, thickness 1 in a dielectric cube, the sky above it alone; mu_o 0.3, 0.8, phi 0, 120: seen from
    # above, then from below
    ((0.301711, 0.049662, -0.000433, -0.000101), (0.000631, 0.000389, 0.000281, 0.000118)),
    ((0.741594, -0.286675, -0.019776, 0.002235), (0.000542, 0.000464, 0.000239, 0.000106)),
    ((0.326458, 0.011225, -0.000171, -0.000080), (0.000397, 0.000377, 0.000243, 0.000079)),
    ((0.378899, -0.051127, -0.013492, 0.001519), (0.000549, 0.000272, 0.000305, 0.000106)),
    ((0.248612, 0.012848, -0.000012, -0.000114), (0.000407, 0.000272, 0.000309, 0.000072)),
    ((0.660898, 0.168022, -0.015912, 0.002084), (0.000686, 0.000380, 0.000344, 0.000100)),
    ((0.323496, -0.007333, -0.000242, 0.000033), (0.000383, 0.000329, 0.000316, 0.000099)),
    ((0.812053, 0.037003, -0.009764, 0.001467), (0.000663, 0.000317, 0.000268, 0.000116)),
]


def see_sky(scene: vrte.Scene, mu_o: list[float], phi: list[float], through: bool) -> np.ndarray:
    """Stokes vectors (mu_o, phi, 4) of the sky (1 + x)^2 by way of a scene, beams as well: azimuths are those of
    travel, away from where in the sky light is."""
    x, weights = np.polynomial.legendre.leggauss(24)
    mu, heading = (x + 1) / 2, np.arange(8) * 45.0

    def shine(mu: np.ndarray, phi: np.ndarray) -> np.ndarray:
        return (1.0 - np.sqrt(1.0 - mu**2) * np.cos(np.radians(phi))) ** 2

    turns = np.subtract.outer(phi, heading)
    f = vrte.brdf(scene, mu, mu_o, turns.ravel(), nodes=24, transmission=through)
    beams = vrte.brdf(scene, mu_o, [0.5], 0.0, nodes=24, transmission=through)
    lobes, sent = (f.transmission, beams.specular_transmission) if through else (f.mueller, beams.specular)
    lobes = lobes[..., 0].reshape(mu.size, len(mu_o), *turns.shape, 4)
    lit = (weights / 2 * mu)[:, None] * shine(mu[:, None], heading) * (2 * np.pi / heading.size)
    straight = sent[:, None, :, 0] * shine(np.array(mu_o)[:, None], np.array(phi))[..., None]
    return np.einsum("ih,iophs->ops", lit, lobes) + straight


@pytest.mark.parametrize("place", ["film", pytest.param("plate", marks=pytest.mark.slow)])
def test_polarized_monte_carlo_of_mitsuba(place: str) -> None:
    """Within 3 of its standard errors, which are 0.2 % of I or less: I, Q, U, and the V of total reflection."""
    if place == "film":
        stack = [vrte.Interface(1.0, 1.5), vrte.Layer(RAYLEIGH, 1.0, 0.5)]
        found = see_sky(vrte.Scene(stack, vrte.Lambertian(0.2)), [0.25, 0.7, 0.95], [0.0, 60.0, 120.0, 180.0], False)
    else:
        stack = [vrte.Interface(1.0, 1.5), vrte.Layer(RAYLEIGH, 0.95, 1.0), vrte.Interface(1.5, 1.0)]
        found = np.array([see_sky(vrte.Scene(stack), [0.3, 0.8], [0.0, 120.0], way) for way in (False, True)])
    means, errors = np.array(FILM if place == "film" else PLATE).transpose(1, 0, 2)
    assert (errors[:, 0] < 0.0025 * means[:, 0]).all()
    differences = (means * [1, 1, -1, 1] - found.reshape(-1, 4)) / errors
    assert np.abs(differences).max() < 3.0
    assert np.sqrt(np.mean(differences**2)) < 1.2


def test_media_as_near_as_scenes_take_them() -> None:
    """Nodes that lie almost along an interface cost the modes their digits: 5e-3 of the light at a step of 1e-12."""
    assert vrte.Scene([vrte.Interface(1.0, 1.5), vrte.Interface(1.5, 1.5 + 2e-6)]).index_below == 1.5 + 2e-6


def make_random_scene(draw: np.random.Generator) -> vrte.Scene:
    """One to four interfaces with a layer or two between, over nothing, a Lambertian base or a mirror."""
    index, stack = 1.0, []
    for _ in range(draw.integers(1, 5)):
        below = float(draw.choice([0.7, 1.0, 1.01, 1.33, 1.5, 2.7, 4.0]))
        for _ in range(draw.integers(1, 3)):
            albedo, thickness = draw.choice([0.0, 0.5, 0.99, 1.0 - 1e-6, 1.0]), draw.choice([0.0, 1e-4, 0.3, 2.0, 8.0])
            stack.append(vrte.Layer(SHORT if draw.random() < 0.5 else RAYLEIGH, float(albedo), float(thickness)))
        stack += [vrte.Layer(RAYLEIGH, 0.5, 0.1), vrte.Interface(index, below)]  # between two mirrors light gets lost
        index = below
    bases = [None, vrte.Lambertian(0.3), vrte.Lambertian(1.0), vrte.Mirror(1.2), METAL, SILVER]
    base = bases[draw.integers(len(bases))]
    return vrte.Scene(stack if base is None else [*stack, vrte.Layer(RAYLEIGH, 0.5, 0.1)], base)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(40))
def test_random_stacks(seed: int) -> None:
    """From above or from below, by either algorithm and by two other methods: the oracle's. Measured on 1,500:
    1e-11 of the largest at worst."""
    draw = np.random.default_rng(seed)
    scene, mu_i = make_random_scene(draw), [float(draw.choice([1e-3, 0.11, 0.37, 0.83])), 1.0]
    side = "bottom" if scene.base is None and seed % 2 else "top"
    right = oracle.brdf(scene.turned() if side == "bottom" else scene, mu_i, MU_O, 6, range(3))
    flip = D if side == "bottom" else np.eye(4)  # as seen in a horizontal mirror
    expected = flip @ azimuthal_sum(right.reflected, ANGLES) @ flip
    through = flip @ azimuthal_sum(right.transmitted, ANGLES) @ flip
    ways: list[dict[str, Any]] = [{"algorithm": name} for name in ("doubling", "modes")]
    ways += [{"method": name, "accuracy": 1e-12} for name in ("matrix-operator", "adding-doubling")]
    for how in ways:
        solve = vrte.brdf if "method" in how else exact.brdf
        f = solve(scene, mu_i, MU_O, ANGLES, nodes=6, transmission=scene.base is None, illuminate=side, **how)
        allowed = 1e-10 if "method" in how else 2e-11
        assert np.abs(f.mueller - expected).max() < allowed * max(np.abs(expected).max(), 1e-3)
        if scene.has_interfaces:
            assert np.abs(f.specular - flip @ right.specular @ flip).max() < 1e-12
        if f.transmission is not None:
            assert np.abs(f.transmission - through).max() < allowed * max(np.abs(through).max(), 1e-3)


def test_rough_interfaces_tell_what_facets_lose() -> None:
    """R + T of the beams that reach them, outside and through what lies above."""
    rough = vrte.Interface(1.0, 1.5, roughness=0.5, distribution="ggx", shadowing=True)
    layer = vrte.Layer(RAYLEIGH, 0.9, 1.0)
    found = vrte.brdf(vrte.Scene([rough, layer]), [0.2, 1.0], 0.5, nodes=6).diagnostics
    assert found["facets_send_on"] == {
        "1": [round(sum(parts), 6) for parts in zip(*map(list, rough.share([0.2, 1.0])), strict=True)]
    }
    assert found["interfaces"] == [rough.in_words]
    assert "interfaces" not in vrte.brdf(vrte.Scene([layer]), 0.5, 0.5, nodes=4).diagnostics
    assert "facets of rough interface 1 send on" in str(
        vrte.plan("brdf", vrte.Scene([rough, layer]), 0.5, 0.5, nodes=6)
    )


def test_brdf_surface_is_the_facets_alone() -> None:
    """By itself what facets send back of a beam, less with a layer above; the rest of the matrix is of particles."""
    rough, mu = vrte.Interface(1.0, 1.5, roughness=0.3), np.array([0.3, 0.8])
    bare = vrte.brdf(vrte.Scene([rough]), mu, mu, [0.0, 70.0], nodes=6)
    closed = rough.facets.reflect(mu[:, None, None], mu[:, None], np.array([0.0, 70.0]))
    assert_close(bare.surface, closed, rtol=0.0, atol=1e-14 * closed.max())
    assert_close(bare.mueller, closed, rtol=0.0, atol=1e-14 * closed.max())
    fog = vrte.brdf(vrte.Scene([vrte.Layer(RAYLEIGH, 1.0, 0.5), rough]), mu, mu, [0.0, 70.0], nodes=6)
    fade = np.exp(-0.5 / mu[:, None, None] - 0.5 / mu[:, None])[..., None, None]
    assert_close(fog.surface, fade * closed, rtol=0.0, atol=1e-14 * closed.max())
    assert (fog.mueller[..., 0, 0] > fog.surface[..., 0, 0]).all()


@pytest.mark.parametrize("top", [(1.0, 1.5), (1.5, 1.0), (1.0, 1.5, 0.2)])
def test_invariance_is_joined_with_a_surface(top: tuple[float, ...]) -> None:
    """Light of a semi-infinite layer on either side of the surface is that by modes. Measured: 1e-13."""
    scene = vrte.Scene([vrte.Interface(*top), vrte.Layer(SHORT, 0.95, np.inf)])
    for side in ("above", "below"):
        found, expected = (
            vrte.radiance(
                scene,
                0.6,
                mu=[-0.9, -0.3, 0.2, 0.8],
                phi=ANGLES,
                side=side,
                nodes=10,
                accuracy=1e-11,
                algorithm=algorithm,
            )
            for algorithm in ("invariance", "modes")
        )
        assert found.diagnostics["orders_by"]["invariance"] > 1
        assert_close(found.stokes, expected.stokes, rtol=0.0, atol=1e-11 * np.abs(expected.stokes).max())
        assert_close(found.flux_up, expected.flux_up, rtol=1e-13, atol=0.0)


def test_light_on_either_side_where_nothing_scatters() -> None:
    """A layer without thickness under a surface: both sides of it are at one depth."""
    scene = vrte.Scene([vrte.Interface(1.0, 1.5), vrte.Layer(vrte.isotropic(), 0.0, 0.0)], vrte.Lambertian(0.5))
    outside, inside = (vrte.radiance(scene, 0.6, mu=0.9, nodes=16, side=side) for side in ("above", "below"))
    assert (outside.index[0], inside.index[0]) == (1.0, 1.5)
    net = [field.flux_down + field.direct - field.flux_up - field.direct_up for field in (outside, inside)]
    assert_close(*net, rtol=0.0, atol=1e-14)
    assert_close(inside.flux_up, 0.5 * (inside.flux_down + inside.direct), rtol=1e-13, atol=0.0)


@pytest.mark.parametrize("mu0", [1e-8, 1e-3])
def test_grazing_light_is_reciprocal_through_a_surface(mu0: float) -> None:
    """Into the surface and out of it along one direction: inside it is the critical one, which tells nothing of mu0."""
    mu = [mu0, 0.5]
    stack = [vrte.Interface(1.0, 1.5), vrte.Layer(SHORT, 0.9, 1.0), vrte.Interface(1.5, 1.0)]
    found = vrte.brdf(vrte.Scene(stack), mu, mu, 30.0, nodes=8).mueller[:, :, 0]
    assert_close(found[0, 1], P @ found[1, 0].T @ P, rtol=1e-11, atol=1e-12 * found[0, 1, 0, 0])


def test_facets_that_create_light_warn() -> None:
    """Steep facets without shadowing return more than they get: between a dense medium and a white base that grows."""
    layer, white = vrte.Layer(SHORT, 1.0, 1.0), vrte.Lambertian(1.0)

    def solve(shadowing: bool) -> vrte.Brdf:
        steep = vrte.Interface(1.0, 4.0, roughness=1.0, distribution="ggx", shadowing=shadowing)
        return vrte.brdf(vrte.Scene([steep, layer], white), 0.5, [0.3, 0.5], nodes=16)

    with pytest.warns(vrte.AccuracyWarning, match="give the interface shadowing"):
        assert solve(False).reflectance[0] < 0.0
    assert solve(True).reflectance[0] == close_to(1.0, rtol=0.0, atol=2e-3)  # 16 nodes under index 4
