"""What is shown of a BRDF, by name, and the light between the given directions."""

import numpy as np
import pytest

import vrte
from vrte.results.over_hemisphere import light_in_plane, light_on_mesh, stokes_over_hemisphere
from vrte.results.quantities import FIELD_QUANTITIES, QUANTITIES, SIGNED, of_brdf, of_stokes, unit_of

from .helpers import assert_close, close_to

MU_O, PHI = np.linspace(0.1, 1.0, 12), np.arange(0, 360, 15)
LIGHT = (2.0, 0.5, -1.0, 1.2)


@pytest.fixture(scope="module")
def scene() -> vrte.Scene:
    return vrte.Scene([vrte.Layer(vrte.rayleigh(0.1), albedo=0.95, thickness=1.0)], vrte.Lambertian(0.2))


@pytest.fixture(scope="module")
def brdf(scene: vrte.Scene) -> vrte.Brdf:
    return vrte.brdf(scene, [0.4, 0.8], MU_O, PHI, nodes=6, threads=1, transmission=True)


def test_the_light_that_leaves_by_hand(brdf: vrte.Brdf) -> None:
    """Mueller elements are those of the matrix, of reflected and of transmitted light; a Lambertian base has its albedo
    as reflectance factor; and without light there is no polarization."""
    for transmitted, matrices in ((False, brdf.mueller), (True, brdf.transmission)):
        for row, column in np.ndindex(4, 4):
            found = of_brdf(brdf, f"f{row}{column}", LIGHT, transmitted)
            assert np.array_equal(found, matrices[..., row, column])
    i, q, u, v = np.moveaxis(sum(part * brdf.mueller[..., column] for column, part in enumerate(LIGHT)), -1, 0)
    expected = {
        "degree of linear polarization": np.hypot(q, u) / i,
        "degree of circular polarization": v / i,
        "reflectance factor": np.pi * i / LIGHT[0],
    }
    for name, values in expected.items():
        assert_close(of_brdf(brdf, name, LIGHT), values, rtol=1e-12, atol=1e-15)
    turned = np.radians(2.0 * of_brdf(brdf, "angle of linear polarization", LIGHT))
    assert_close(np.hypot(q, u) * np.cos(turned), q, rtol=1e-9, atol=1e-12)
    assert_close(np.hypot(q, u) * np.sin(turned), u, rtol=1e-9, atol=1e-12)
    bare = vrte.Scene([vrte.Layer(vrte.isotropic(), albedo=0.5, thickness=0.0)], vrte.Lambertian(0.3))
    found = of_brdf(vrte.brdf(bare, [0.2, 1.0], MU_O, [0.0, 90.0], nodes=4), "reflectance factor", LIGHT)
    assert_close(found, 0.3, rtol=1e-13, atol=0.0)
    assert np.isnan(of_stokes(np.zeros((3, 4)), "degree of polarization")).all()
    assert np.isnan(of_stokes([1.0, 0.0, 0.0, 0.5], "angle of linear polarization"))


def test_every_name_has_a_unit_and_what_is_not_signed_is_never_negative(brdf: vrte.Brdf) -> None:
    assert len(QUANTITIES) == 20
    for name in QUANTITIES:
        assert unit_of(name) in {"", "°", "sr⁻¹"}
        assert name in SIGNED or of_brdf(brdf, name, LIGHT).min() >= 0.0
    assert [unit_of(name) for name in FIELD_QUANTITIES[:4]] == ["W m⁻² sr⁻¹"] * 4


@pytest.mark.parametrize("step", [0.7, 4.0, 200.0])
def test_meshes_and_cuts_end_at_the_last_direction(brdf: vrte.Brdf, step: float) -> None:
    theta, phi, light = light_on_mesh(brdf, 1, LIGHT, step)
    assert (theta[0], phi[0], phi[-1]) == (0.0, 0.0, 360.0)
    assert theta[-1] == close_to(np.degrees(np.arccos(MU_O.min())), rtol=0.0, atol=1e-9)
    assert max(np.diff(theta).max(), np.diff(phi).max()) <= step + 1e-9
    assert_close(light[-1, 0], brdf.mueller[1, MU_O.argmin(), 0] @ LIGHT, rtol=0.0, atol=1e-13)
    angle, cut = light_in_plane(brdf, 1, 90.0, LIGHT, step)
    assert_close(angle, np.concatenate([-theta[:0:-1], theta]), rtol=0.0, atol=1e-12)
    both = stokes_over_hemisphere(brdf, 1, np.abs(angle), np.array([90.0, 270.0]), LIGHT)
    assert_close(cut, both[np.arange(angle.size), (angle < 0.0).astype(int)], rtol=0.0, atol=1e-13)


def test_around_the_normal_nothing_is_drawn_where_nothing_is_near() -> None:
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.95, 3.0)])
    near, far = (vrte.brdf(scene, 0.6, np.linspace(0.1, top, 8), np.arange(0, 361, 30), nodes=6) for top in (0.95, 0.7))
    assert light_on_mesh(near, 0)[0][0] == 0.0
    theta, _, light = light_on_mesh(far, 0)
    assert theta[0] == close_to(np.degrees(np.arccos(0.7)), rtol=1e-6, atol=0.0)
    assert np.isfinite(light).all()
    assert np.isnan(stokes_over_hemisphere(far, 0, np.array([30.0]), np.array([0.0]))).all()
    angle, cut = light_in_plane(far, 0)
    assert np.isnan(cut[angle == 0.0]).all()  # a line breaks there
    assert np.isfinite(cut[angle != 0.0]).all()
    assert np.abs(angle[angle != 0.0]).min() == close_to(theta[0], rtol=1e-6, atol=0.0)


def test_at_the_pole_only_the_meridian_plane_turns(brdf: vrte.Brdf) -> None:
    phi = np.array([0.0, 20.0, 145.0])
    pole = stokes_over_hemisphere(brdf, 0, np.array([0.0]), phi, LIGHT)[0]
    assert_close(pole[:, [0, 3]], pole[:1, [0, 3]].repeat(3, axis=0), rtol=0.0, atol=1e-13)
    plane = (pole[:, 1] + 1j * pole[:, 2]) * np.exp(-2j * np.radians(phi))
    assert_close(plane, plane[0], rtol=0.0, atol=1e-13)
    assert abs(plane[0]) > 1e-3
