"""Layers, bases and scenes: what they keep, how they pickle, and what is warned of."""

import math
import pickle
from typing import Any

import numpy as np
import pytest

import vrte

from .helpers import close_to
from .samples import rough_mirror

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
    endless = vrte.Scene([thin, deep], vrte.Lambertian(0.3))
    assert (endless.thickness, endless.base_is_reached) == (math.inf, False)


def test_a_variation_that_does_nothing_says_so() -> None:
    assert vrte.Variation("p", 1.0, [0.0], [0.0]).changes_nothing
    assert not vrte.Variation("p", 1.0, [0.0], [1.0]).changes_nothing


def test_mueller_base_is_called_with_arrays() -> None:
    f = vrte.MuellerBase(rough_mirror)(np.array([0.2, 0.9])[:, None, None], np.array([0.5])[:, None], [0.0, 10.0, 20.0])
    assert f.shape == (2, 1, 3, 4, 4)
    np.testing.assert_array_equal(f[1, 0, 2], rough_mirror(0.9, 0.5, 20.0))
    assert vrte.MuellerBase(NotPickled())(0.5, 0.5, [1.0, 2.0]).shape == (2, 4, 4)


def test_everything_pickles_or_says_what_does_not() -> None:
    gold = vrte.spheres((0.2, 3.5), radius_um=0.05, wavelength_um=0.64)
    layers = [vrte.Layer.of(gold, thickness=2.0), vrte.Layer(vrte.rayleigh(), 0.9, math.inf)]
    copy = pickle.loads(pickle.dumps(vrte.Scene(layers, vrte.MuellerBase(rough_mirror))))
    assert (copy.base.function, copy.layers[0].albedo) == (rough_mirror, gold.albedo)
    np.testing.assert_array_equal(copy.layers[0].phase_matrix.b2, gold.phase_matrix.b2)
    assert not copy.layers[0].phase_matrix.b2.flags.writeable
    assert pickle.loads(pickle.dumps(vrte.Lambertian(0.2))) == vrte.Lambertian(0.2)
    for function in (lambda i, o, p: 0.1 * np.eye(4), NotPickled()):
        with pytest.raises(vrte.SceneError, match=r"MuellerBase function .*(lambda|NotPickled).* cannot be pickled"):
            pickle.dumps(vrte.Scene(layers, vrte.MuellerBase(function)))
