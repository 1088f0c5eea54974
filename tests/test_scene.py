"""Layers, bases and scenes: what is allowed, and what the errors say."""

import math
import pickle
from functools import partial

import numpy as np
import pytest

from vrte.basics.errors import SceneError
from vrte.optics.crowding import IndependentScatteringWarning
from vrte.optics.particles import Particles
from vrte.optics.phase_matrix import isotropic, rayleigh
from vrte.optics.spheres import spheres
from vrte.scene.boundary import Lambertian, MuellerBase
from vrte.scene.layer import Layer
from vrte.scene.scene import Scene

from .helpers import close_to

DUST = Particles(rayleigh(), 0.9, 0.0, extinction_um2=2.0, scattering_um2=1.8, volume_um3=0.5)
FLIP = np.diag([1.0, 1.0, -1.0, -1.0])


def rough_mirror(mu_i, mu_o, phi_deg):
    """Mirror-symmetric, with all sixteen elements."""
    c, s = np.cos(np.radians(phi_deg)), np.sin(np.radians(phi_deg))
    shape = np.broadcast_shapes(np.shape(mu_i), np.shape(mu_o), np.shape(phi_deg))
    f = np.zeros((*shape, 4, 4))
    f[..., 0, 0] = 0.2 + 0.1 * mu_i * mu_o * c
    f[..., 0, 1] = f[..., 1, 0] = 0.02 * c
    f[..., 0, 2], f[..., 2, 0] = 0.03 * s, -0.03 * s
    f[..., 1, 1] = f[..., 2, 2] = f[..., 3, 3] = 0.05
    f[..., 2, 3] = 0.01 * c
    return f


def tilted(mu_i, mu_o, phi_deg):
    f = rough_mirror(mu_i, mu_o, phi_deg)
    f[..., 0, 2] += 1e-6
    return f


class NotPickled:
    def __call__(self, mu_i, mu_o, phi_deg):
        return 0.1 * np.eye(4)

    def __reduce__(self):
        raise TypeError("it holds an open file")


def test_a_layer_keeps_what_it_is_given():
    layer = Layer(rayleigh(), albedo=1, thickness=math.inf)
    assert (layer.albedo, layer.thickness) == (1.0, math.inf)
    assert isinstance(layer.albedo, float)
    assert Layer(isotropic(), 0, 0).thickness == 0.0
    with pytest.raises(AttributeError):
        layer.albedo = 0.5


ONE, EITHER = Layer(rayleigh(), 1, 1), "either thickness, or thickness_um together with volume_fraction"


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: Layer(rayleigh(), 1.5, 1.0), "albedo must be between 0 and 1, not 1.5"),
        (lambda: Layer(rayleigh(), -1e-9, 1.0), "albedo"),
        (lambda: Layer(rayleigh(), math.nan, 1.0), "albedo must be between 0 and 1, not nan"),
        (lambda: Layer(rayleigh(), "much", 1.0), "albedo must be a number"),
        (lambda: Layer(rayleigh(), 0.5, -1.0), "thickness must be an optical thickness >= 0"),
        (lambda: Layer(rayleigh(), 0.5, math.nan), "thickness"),
        (lambda: Layer(rayleigh(), 0.5, None), "thickness"),
        (lambda: Layer(np.ones(3), 0.5, 1.0), "phase_matrix must be a vrte.PhaseMatrix, not array"),
        (lambda: Layer.of(DUST), EITHER),
        (lambda: Layer.of(DUST, thickness=1.0, thickness_um=1.0, volume_fraction=0.05), EITHER),
        (lambda: Layer.of(DUST, thickness=1.0, volume_fraction=0.05), "volume_fraction is not used beside thickness"),
        (lambda: Layer.of(DUST, thickness_um=1.0), EITHER),
        (lambda: Layer.of(DUST, volume_fraction=0.05), EITHER),
        *(
            (partial(Layer.of, DUST, thickness_um=1.0, volume_fraction=part), "must be above 0 and below 1")
            for part in (0.0, 1.0, -0.1, math.nan)
        ),
        (lambda: Layer.of(rayleigh(), thickness=1.0), "particles must be"),
        (lambda: Layer.of(DUST, thickness_um=-1.0, volume_fraction=0.05), "thickness_um must be a length"),
        (lambda: Scene([]), "at least one layer, or a base"),
        (
            lambda: Scene([ONE, rayleigh()]),
            "item 2 of layers must be a vrte.Layer or a vrte.Interface, not an object of type PhaseMatrix",
        ),
        (lambda: Scene([Layer(rayleigh(), 1, math.inf), ONE]), "layer 1: thickness inf .* last layer only"),
        (lambda: Scene(None), "layers must be a list"),
        (lambda: Scene([ONE], 0.3), "base must be None .* not 0.3; .* vrte.Lambertian"),
        *((partial(Lambertian, albedo), "albedo") for albedo in (-0.1, 1.1, math.nan, None)),
        (lambda: MuellerBase(tilted), r"f\(-phi\) must equal D f\(phi\) D"),
        (lambda: MuellerBase(lambda i, o, p: np.full((4, 4), np.nan)), "finite"),
        (lambda: MuellerBase(lambda i, o, p: -np.eye(4)), "f_00 must be >= 0, not -1"),
        (lambda: MuellerBase(lambda i, o, p: np.zeros((3, 3))), "must return the shape"),
        (lambda: MuellerBase(lambda i, o, p: 1j * np.eye(4)), "real numbers"),
        (lambda: MuellerBase(lambda i, o, p: math.cos(p) * np.eye(4)), "called with arrays .* failed with TypeError"),
        (lambda: MuellerBase(lambda i, o: np.eye(4)), "failed with TypeError"),
        (lambda: MuellerBase(0.3), "function must be a function, not 0.3"),
    ],
)
def test_what_is_wrong_is_refused_in_words(call, words):
    with pytest.raises(SceneError, match=words):
        call()


def test_layer_of_particles():
    assert Layer.of(DUST, thickness=3.0).albedo == 0.9
    layer = Layer.of(DUST, thickness_um=10.0, volume_fraction=0.05)
    assert layer.thickness == close_to(10.0 * 0.05 / 0.5 * 2.0, rtol=1e-6, atol=0.0)
    assert math.isinf(Layer.of(DUST, thickness_um=math.inf, volume_fraction=0.05).thickness)
    assert Layer.of(DUST, 2.0).phase_matrix is DUST.phase_matrix


def test_dense_particles_bring_a_warning():
    with pytest.warns(IndependentScatteringWarning, match=r"volume_fraction of 0.3 is above 0.1"):
        Layer.of(DUST, thickness_um=1.0, volume_fraction=0.3)
    Layer.of(DUST, thickness_um=1.0, volume_fraction=0.1)


def test_scene_of_layers():
    scene = Scene([Layer(rayleigh(), 1.0, 0.5), Layer(isotropic(), 0.3, 1.5)], base=Lambertian(0.3))
    assert isinstance(scene.layers, tuple)
    assert scene.thickness == 2.0
    assert scene.base_is_reached
    assert Scene(Layer(isotropic(), 1.0, 1.0)).base is None
    endless = Scene([Layer(rayleigh(), 1.0, 0.5), Layer(rayleigh(), 0.9, math.inf)], Lambertian(0.3))
    assert math.isinf(endless.thickness)
    assert not endless.base_is_reached


def test_mueller_base_is_called_with_arrays():
    base = MuellerBase(rough_mirror)
    f = base(np.array([0.2, 0.9])[:, None, None], np.array([0.5])[:, None], [0.0, 10.0, 20.0])
    assert f.shape == (2, 1, 3, 4, 4)
    np.testing.assert_array_equal(f[1, 0, 2], rough_mirror(0.9, 0.5, 20.0))
    assert MuellerBase(lambda mu_i, mu_o, phi_deg: 0.1 * np.eye(4))(0.5, 0.5, [1.0, 2.0]).shape == (2, 4, 4)


def test_everything_pickles():
    gold = spheres((0.2, 3.5), radius_um=0.05, wavelength_um=0.64)
    layers = [Layer.of(gold, thickness=2.0), Layer(rayleigh(), 0.9, math.inf)]
    scene = Scene(layers, MuellerBase(rough_mirror))
    copy = pickle.loads(pickle.dumps(scene))
    assert copy.base.function is rough_mirror
    assert copy.layers[0].albedo == gold.albedo
    np.testing.assert_array_equal(copy.layers[0].phase_matrix.b2, gold.phase_matrix.b2)
    assert not copy.layers[0].phase_matrix.b2.flags.writeable
    assert pickle.loads(pickle.dumps(Lambertian(0.2))) == Lambertian(0.2)


@pytest.mark.parametrize("function", [lambda i, o, p: 0.1 * np.eye(4), NotPickled()])
def test_a_function_that_does_not_pickle_is_named(function):
    base = MuellerBase(function)
    with pytest.raises(SceneError, match=r"the MuellerBase function .*(lambda|NotPickled).* cannot be pickled"):
        pickle.dumps(Scene([Layer(rayleigh(), 1.0, 1.0)], base))
