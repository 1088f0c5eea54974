"""Layers, bases and scenes: what they keep and how they pickle; light from below, and any light: (2:1), (2:2)."""

import math
import pickle
from typing import Any

import numpy as np
import pytest

import vrte

from . import exact
from .helpers import assert_close, close_to
from .samples import rough_mirror, spheroids

DUST = vrte.Particles(vrte.rayleigh(), 0.9, 0.0, extinction_um2=2.0, scattering_um2=1.8, volume_um3=0.5)


class NotPickled:
    def __call__(self, mu_i: Any, mu_o: Any, phi_deg: Any) -> np.ndarray:
        return 0.1 * np.eye(4)

    def __reduce__(self) -> Any:
        raise TypeError("it holds an open file")


def test_layers_keep_what_they_are_given_or_made_of() -> None:
    layer = vrte.Layer(vrte.rayleigh(), albedo=1, thickness=math.inf)
    assert (layer.albedo, layer.thickness, type(layer.albedo)) == (1.0, math.inf, float)
    with pytest.raises(AttributeError):
        layer.albedo = 0.5
    assert vrte.Layer.of(DUST, thickness=3.0).albedo == 0.9
    assert vrte.Layer.of(DUST, 2.0).phase_matrix is DUST.phase_matrix
    made = vrte.Layer.of(DUST, thickness_um=10.0, volume_fraction=0.05)
    assert made.thickness == close_to(10.0 * 0.05 / 0.5 * 2.0, rtol=1e-6, atol=0.0)
    assert math.isinf(vrte.Layer.of(DUST, thickness_um=math.inf, volume_fraction=0.05).thickness)
    with pytest.warns(vrte.IndependentScatteringWarning, match=r"volume_fraction of 0.3 is above 0.1"):
        vrte.Layer.of(DUST, thickness_um=1.0, volume_fraction=0.3)
    vrte.Layer.of(DUST, thickness_um=1.0, volume_fraction=0.1)


def test_scenes_of_layers() -> None:
    thin, deep = vrte.Layer(vrte.rayleigh(), 1.0, 0.5), vrte.Layer(vrte.isotropic(), 0.3, math.inf)
    scene = vrte.Scene([thin, vrte.Layer(vrte.isotropic(), 0.3, 1.5)], base=vrte.Lambertian(0.3))
    assert (type(scene.layers), scene.thickness, scene.base_is_reached) == (tuple, 2.0, True)
    assert vrte.Scene(thin).base is None
    half_space = vrte.Scene([thin, deep], vrte.Lambertian(0.3))
    assert (half_space.thickness, half_space.base_is_reached) == (math.inf, False)


def test_a_variation_that_does_nothing_says_so() -> None:
    assert vrte.Variation("p", 1.0, [0.0], [0.0]).changes_nothing
    assert not vrte.Variation("p", 1.0, [0.0], [1.0]).changes_nothing


def spoil(mu_i: Any, mu_o: Any, phi_deg: Any) -> Any:
    """f of a Lambertian base, by a function that overwrites what it is given."""
    for values in (mu_i, mu_o, phi_deg):
        values[...] = math.nan
    return np.diag([0.1, 0.0, 0.0, 0.0])


def test_mueller_base_is_called_with_arrays_that_it_may_overwrite() -> None:
    found = vrte.brdf(vrte.Scene(UPPER, vrte.MuellerBase(spoil)), MU, MU, PHI, nodes=4).mueller
    right = vrte.brdf(vrte.Scene(UPPER, vrte.Lambertian(0.1 * math.pi)), MU, MU, PHI, nodes=4).mueller
    assert_close(found, right, rtol=0.0, atol=1e-13)
    f = vrte.MuellerBase(rough_mirror)(np.array([0.2, 0.9])[:, None, None], np.array([0.5])[:, None], [0.0, 10.0, 20.0])
    assert f.shape == (2, 1, 3, 4, 4)
    np.testing.assert_array_equal(f[1, 0, 2], rough_mirror(0.9, 0.5, 20.0))
    assert vrte.MuellerBase(NotPickled())(0.5, 0.5, [1.0, 2.0]).shape == (2, 4, 4)


def test_everything_pickles_or_says_what_does_not() -> None:
    gold = vrte.spheres("gold", size=vrte.Tabulated([0.1, 0.2], [1.0, 2.0]), wavelength_um=0.64)
    layers = [vrte.Layer.of(gold, thickness=2.0), vrte.Layer(vrte.rayleigh(), 0.9, math.inf)]
    copy = pickle.loads(pickle.dumps(vrte.Scene(layers, vrte.MuellerBase(rough_mirror))))
    assert (copy.base.function, copy.layers[0].albedo) == (rough_mirror, gold.albedo)
    np.testing.assert_array_equal(copy.layers[0].phase_matrix.b2, gold.phase_matrix.b2)
    again = pickle.loads(pickle.dumps(gold))
    assert again.extinction_um2 == gold.extinction_um2
    arrays = [getattr(again.phase_matrix, name) for name in ("a1", "a2", "a3", "a4", "b1", "b2")]
    assert not any(one.flags.writeable for one in [*arrays, again.balls[0][0].size.radius_um])
    for frozen, name in ((again, "albedo"), (again.phase_matrix, "a1")):
        with pytest.raises(AttributeError):
            setattr(frozen, name, 0.5)
    assert pickle.loads(pickle.dumps(vrte.Lambertian(0.2))) == vrte.Lambertian(0.2)
    for function in (lambda i, o, p: 0.1 * np.eye(4), NotPickled()):
        with pytest.raises(vrte.SceneError, match=r"MuellerBase function .*(lambda|NotPickled).* cannot be pickled"):
            pickle.dumps(vrte.Scene(layers, vrte.MuellerBase(function)))


MU, PHI = np.array([0.2, 0.7, 1.0]), np.array([0.0, 40.0, 130.0, 180.0, 250.0])
UPPER, LOWER = vrte.Layer(spheroids(), 0.9, 0.4), vrte.Layer(vrte.rayleigh(0.03), 0.7, 1.2)
TWO, TURNED = vrte.Scene([UPPER, LOWER]), vrte.Scene([LOWER, UPPER])
NODES = 6


# any light


def table(scene: vrte.Scene, cosines: int, mu_o: np.ndarray, azimuths: int = 8, **how: object) -> vrte.Brdf:
    """Of Gauss cosines and azimuths all around."""
    mu_i = vrte.hemisphere(cosines)[0]
    return exact.brdf(scene, mu_i, mu_o, np.arange(azimuths) * 360.0 / azimuths, **how)


WHITE = {
    "thin, on white": vrte.Scene([vrte.Layer(vrte.rayleigh(), 1.0, 0.3)], vrte.Lambertian(1.0)),
    "on white": vrte.Scene([vrte.Layer(vrte.rayleigh(), 1.0, 2.0)], vrte.Lambertian(1.0)),
    "semi-infinite": vrte.Scene([vrte.Layer(vrte.rayleigh(), 1.0, np.inf)]),
}


@pytest.mark.parametrize("name", WHITE)
def test_white_under_a_white_sky_is_white(name: str) -> None:
    """On the solver's own nodes to rounding, in any direction."""
    found = table(WHITE[name], 8, np.concatenate([vrte.hemisphere(8)[0], MU]), nodes=8)
    assert_close(found.diffuse_reflectance(), 1.0, rtol=1e-13, atol=0.0)
    assert found.bihemispherical_reflectance() == close_to(1.0, rtol=1e-13, atol=0.0)
    assert_close(table(WHITE[name], 16, MU, nodes=24).diffuse_reflectance(), 1.0, rtol=1e-7, atol=0.0)


def test_any_light_is_the_sum_of_its_beams() -> None:
    """Against the sum written out: each incident direction by itself, its azimuth turned."""
    found = table(TWO, 4, MU, azimuths=2 * spheroids().terms, nodes=NODES, transmission=True)
    phi, (_, weights) = found.phi, vrte.hemisphere(4)

    def sky(mu_i: np.ndarray, phi_deg: np.ndarray) -> np.ndarray:
        c, s = np.cos(np.radians(phi_deg)), np.sin(2.0 * np.radians(phi_deg))
        return np.stack(np.broadcast_arrays(1.3 + mu_i + c, 0.3 * s, 0.1 * c * mu_i, 0.05 * mu_i), axis=-1)

    light = sky(found.mu_i[:, None], phi[None])
    for matrices, transmitted in ((found.mueller, False), (found.transmission, True)):
        expected = np.zeros((MU.size, phi.size, 4))
        for i, q in np.ndindex(light.shape[:2]):
            turned = np.roll(matrices[i], q, axis=1)
            expected += weights[i] * found.mu_i[i] * 2 * np.pi / phi.size * turned @ light[i, q]
        assert_close(found.under(sky, transmitted=transmitted), expected, rtol=0.0, atol=1e-13)
    assert_close(found.under(light, weights), found.under(sky), rtol=0.0, atol=1e-15)
