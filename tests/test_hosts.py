"""Media around particles: what they absorb between them, clear and tinted coats, packing in scene files and sweeps."""

import math
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.formats.scene_file import make_scene_file
from vrte.optics.crowding import PACKINGS, pack
from vrte.optics.spheres import check_spheres, compute_mie_coefficients
from vrte.scene.layer import Layer

from .helpers import assert_close, close_to

TINT = (1.5, 2e-4)
ABSORBED = 4.0 * math.pi * 2e-4 / 0.55  # of the host [1/um]
PIGMENT = {"index": [1.7, 0.0], "radius_um": 0.1}


def pigment(host: Any = TINT, index: Any = 1.7) -> vrte.Particles:
    """Spheres of 0.2 um in green light."""
    return vrte.spheres(index, radius_um=0.1, wavelength_um=0.55, host_index=host)


def film(host: Any = TINT, fraction: float = 0.05, packing: str = "independent", length_um: float = 20.0) -> Layer:
    """A layer of these spheres."""
    return Layer.of(pigment(host), thickness_um=length_um, volume_fraction=fraction, packing=packing)


@pytest.mark.parametrize("index", [1.7, (1.7, 0.01)])
def test_a_host_takes_what_lies_between_particles(index: Any) -> None:
    tinted, clear = pigment(index=index), pigment(1.5, index)
    assert tinted.host_absorption == close_to(ABSORBED, rtol=1e-14, atol=0.0)
    assert tinted.extinction_um2 == clear.extinction_um2  # to the first order of k, the spheres do not notice
    number = 0.05 / (4.0 / 3.0 * math.pi * 0.1**3)
    extinction, scattering = number * tinted.extinction_um2 + 0.95 * ABSORBED, number * tinted.scattering_um2
    layer = Layer.of(tinted, thickness_um=20.0, volume_fraction=0.05)
    assert layer.thickness == close_to(20.0 * extinction, rtol=1e-13, atol=0.0)
    assert layer.albedo == close_to(scattering / extinction, rtol=1e-13, atol=0.0)
    assert layer.host_index == 1.5
    optical = Layer.of(tinted, thickness=3.0, volume_fraction=0.05)
    assert (optical.thickness, optical.albedo) == (3.0, layer.albedo)


@pytest.mark.parametrize("name", [name for name in PACKINGS if name != "independent"])
def test_a_crowd_and_its_host_absorb_each_on_its_own(name: str) -> None:
    layer, clear = film(TINT, 0.25, name, 5.0), film(1.5, 0.25, name, 5.0)
    assert clear.albedo == 1.0
    assert layer.thickness - clear.thickness == close_to(5.0 * 0.75 * ABSORBED, rtol=1e-10, atol=0.0)
    assert layer.albedo == close_to(clear.thickness / layer.thickness, rtol=1e-12, atol=0.0)


def test_a_clear_host_takes_nothing_and_one_that_would_be_noticed_is_not_left_out() -> None:
    """k = 3e-6 takes 7e-5 a micrometre at 0.55 um, a hundredth of what a dilute dispersion scatters."""
    assert film(1.5).albedo == Layer.of(pigment(1.5), thickness=1.0).albedo == 1.0
    with pytest.raises(vrte.SceneError, match="volume_fraction is needed beside thickness"):
        Layer.of(pigment((1.33, 3e-6)), thickness=1.0)
    clear = pigment((1.33, 1e-6))
    assert Layer.of(clear, thickness=1.0).albedo == clear.albedo == 1.0


@pytest.mark.parametrize("k", [1e-3, 1e-2])
def test_an_absorbing_host_is_wrong_by_a_fraction_of_the_order_of_k(k: float) -> None:
    """Amplitudes of the sphere with its true relative index: what is left out is k/|m - 1| of them, over n."""
    size, m = 2.0 * math.pi * 1.5 * 0.1 / 0.55, 1.7 / 1.5
    exact, real = (np.concatenate(compute_mie_coefficients(one, size)) for one in (1.7 / (1.5 + 1j * k), m))
    change = np.abs(exact - real).max() / np.abs(real).max()
    assert change == close_to(k / 1.5 * m / (m - 1.0), rtol=0.05, atol=0.0)


def test_a_tinted_coat_obeys_beers_law() -> None:
    layer, mu0 = Layer.clear(100.0, TINT, 0.55), 0.5
    assert layer.thickness == close_to(100.0 * ABSORBED, rtol=1e-14, atol=0.0)
    field = vrte.radiance(vrte.Scene([layer]), mu0, mu=[], tau=[0.0, layer.thickness], nodes=4)
    assert_close(field.direct, mu0 * np.exp([0.0, -100.0 * ABSORBED / mu0]), rtol=1e-12, atol=0.0)
    np.testing.assert_array_equal(field.flux_down, 0.0)
    assert Layer.clear(100.0, 1.5, 0.55).thickness == 0.0


def make_content(**layer: Any) -> dict[str, Any]:
    """A scene of one layer of particles in resin."""
    held = {"particles": "white", "thickness_um": 5.0, "volume_fraction": 0.08} | layer
    content = {"wavelength_um": 0.55, "host_index": 1.5, "particles": {"white": PIGMENT}, "layer": [held]}
    return content | {"brdf": {"mu_i": 0.5, "mu_o": [0.4, 0.8]}, "nodes": 4}


def test_scene_files_and_sweeps_know_every_packing_and_name_the_key_of_one_that_cannot_be() -> None:
    for name in PACKINGS:
        (found,) = make_scene_file(make_content(packing=name)).scene.layers
        expected = film(1.5, 0.08, name, 5.0)
        assert (found.thickness, found.albedo) == (expected.thickness, expected.albedo)
        np.testing.assert_array_equal(found.phase_matrix.coefficients, expected.phase_matrix.coefficients)
    with pytest.raises(vrte.SceneError, match=r"layer\[1\].volume_fraction must be at most 0.64") as refused:
        make_scene_file(make_content(packing="percus-yevick", volume_fraction=0.7))
    assert refused.value.place == ("layer", 0, "volume_fraction")
    with pytest.raises(vrte.SceneError, match=r"layer\[1\].packing = .loose.: must be .*percus-yevick"):
        make_scene_file(make_content(packing="loose"))
    axes = {"axes": {"layer[1].volume_fraction": [0.05, 0.3]}}
    table = vrte.sweep(make_content(packing="percus-yevick") | axes, workers=1)
    for row, fraction in enumerate((0.05, 0.3)):
        scene = vrte.Scene([film(1.5, fraction, "percus-yevick", 5.0)])
        alone = vrte.brdf(scene, [0.5], [0.4, 0.8], nodes=4)
        assert_close(table.mueller[row], alone.mueller, rtol=1e-12, atol=1e-14)


def test_who_only_checks_a_crowd_does_no_work() -> None:
    stand_in = check_spheres(1.59, radius_um=100.0, wavelength_um=0.55, host_index=1.33)
    assert vrte.mixture([(stand_in, 1.0), (pigment(1.33), 1.0)]).stands_in
    assert pack(stand_in, 0.3, "percus-yevick") is stand_in
    with pytest.raises(vrte.SceneError, match=r"at most 0\.64"):
        pack(stand_in, 0.7, "percus-yevick")
    with pytest.warns(vrte.PackingWarning, match=r"above 0\.3"):
        pack(stand_in, 0.4, "percus-yevick")
