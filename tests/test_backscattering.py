"""Coherent backscattering: published values, amplitudes of paths summed one by one, light scattered once, and its
domain."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.basics.arrays import Array
from vrte.basics.quadrature import make_double_gauss
from vrte.scene.backscattering import exchange_amplitudes, scatter_back_once
from vrte.scene.boundary import PAULI

from .helpers import assert_close, close_to, run

ELECTRIC, MAGNETIC = 1.0, 0.4 + 0.5j  # of particles with two dipoles: S1 = e + m cos, S2 = e cos + m
RAYLEIGH = vrte.Scene([vrte.Layer(vrte.rayleigh(), 1.0, math.inf)])
SURFACE = vrte.Interface(1.0, 1.5)
MU = 0.6


def make_two_dipoles() -> vrte.PhaseMatrix:
    """The phase matrix of such particles, of which F12, F34 and the asymmetry differ from 0."""
    angle = np.linspace(0.0, 180.0, 181)
    cosine = np.cos(np.radians(angle))
    s1, s2 = ELECTRIC + MAGNETIC * cosine, ELECTRIC * cosine + MAGNETIC
    total, difference, mixed = abs(s2) ** 2 + abs(s1) ** 2, abs(s2) ** 2 - abs(s1) ** 2, 2.0 * s2 * s1.conj()
    elements = total, difference, total, mixed.real, mixed.imag, mixed.real
    return vrte.PhaseMatrix.from_angles(angle, *elements, normalise=True)


def scatter(field: Array, into: Array, out: Array) -> Array:
    """The field (..., 3) along ``out`` (..., 3) that both dipoles of a particle make of a field along ``into``."""
    electric = field - (field * out).sum(axis=-1, keepdims=True) * out
    return ELECTRIC * electric + MAGNETIC * np.cross(np.cross(into, field), out)


def make_axes(direction: Array) -> Array:
    """l and r (2, 3) of a direction, in and across its meridian plane, r x l along it."""
    across = np.cross(direction, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    return np.stack([np.cross(direction, across), across])


def sum_third_order(mu: float) -> tuple[Array, Array]:
    """The light that three particles of a semi-infinite layer scatter back along mu, over the albedo cubed, without and
    with each path exchanged for its reverse: f [1/sr] (4, 4) from fields in three dimensions. (Paths of two particles
    lie in a plane: they and their reverses have the same Jones matrix.)"""
    into = np.array([math.sqrt(1.0 - mu**2), 0.0, -mu])
    cosines, weights = make_double_gauss(24)
    azimuths = np.arange(10) * (2.0 * np.pi / 10)
    up, azimuth = (each.ravel() for each in np.meshgrid(np.concatenate([cosines, -cosines]), azimuths, indexing="ij"))
    sine = np.sqrt(1.0 - up**2)
    along = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), up], axis=-1)
    first, second = along[:, None], along[None]
    # int exp(-(t1 + t3)/mu - |t1 - t2|/m1 - |t2 - t3|/m2) dt1 dt2 dt3, t2 > t1 where light goes down first, ...
    rate, a = 1.0 / abs(up), 1.0 / mu
    b1, b2 = rate[:, None], rate[None]
    valley = (up < 0.0)[:, None] & (up > 0.0)[None]
    depths = np.where(valley, (1.0 / (a + b1) + 1.0 / (a + b2)) / (b1 + b2), 1.0 / ((a + b1) * (a + b2))) / (2.0 * a)
    solid = np.repeat(np.tile(weights, 2), 10) * (2.0 * np.pi / 10) * rate
    weight = solid[:, None] * solid[None] * depths / mu**2
    strength = 1.5 / (abs(ELECTRIC) ** 2 + abs(MAGNETIC) ** 2) / (4.0 * np.pi)  # of phase matrices with mean 1

    def follow(one: Array, other: Array) -> Array:
        """Jones matrices (..., 2, 2) of paths that go along ``one``, then along ``other`` between particles."""
        fields = [scatter(scatter(scatter(axis, into, one), one, other), other, -into) for axis in make_axes(into)]
        return np.stack([field @ make_axes(-into).T for field in fields], axis=-1)

    def average(path: Array, other: Array) -> Array:
        mean = np.einsum("de,deab,decf->abcf", weight, path, other.conj(), optimize=True)
        return 0.5 * strength**3 * np.einsum("ica,abcd,jbd->ij", PAULI, mean, PAULI).real

    path, reverse = follow(first, second), follow(-second, -first)
    return average(path, path), average(path, reverse)


def test_reversed_paths_add_up_as_fields() -> None:
    """Of three particles: what interference adds follows from the light alone, whose third order vrte has too."""
    multiple, interference = sum_third_order(MU)
    scale = multiple.max()
    assert abs(interference - multiple).max() > 0.01 * scale  # the exchange matters
    assert_close(exchange_amplitudes(multiple), interference, rtol=0.0, atol=1e-13 * scale)
    phase, albedos = make_two_dipoles(), 0.2 * (1.0 - np.cos(np.pi * (np.arange(14) + 0.5) / 14))
    scenes = [vrte.Scene([vrte.Layer(phase, albedo, math.inf)]) for albedo in albedos.tolist()]
    found = np.array([one.mueller[0, 0, 0] for one in vrte.brdfs(scenes, MU, MU, 180.0, nodes=24)])
    series = np.polynomial.polynomial.polyfit(albedos, (found / albedos[:, None, None]).reshape(14, 16), 13)
    once = scatter_back_once(scenes[0], np.array([MU]))[0] / albedos[0]
    assert_close(series[0].reshape(4, 4), once, rtol=0.0, atol=1e-9 * scale)
    assert_close(series[2].reshape(4, 4), multiple, rtol=0.0, atol=1e-4 * scale)


def test_semi_infinite_rayleigh_layer() -> None:
    """Published enhancements at normal incidence: unpolarized, linear and circular light."""
    found = vrte.brdf(RAYLEIGH, 1.0, 1.0, 180.0, accuracy=1e-7, coherent=True)
    alone, total = found.mueller[0, 0, 0], found.mueller[0, 0, 0] + found.coherent[0]
    for seen, sent, enhancement in (
        ([2, 0, 0, 0], [1, 0, 0, 0], 1.5368),
        ([1, 1, 0, 0], [1, 1, 0, 0], 1.7521),
        ([1, -1, 0, 0], [1, 1, 0, 0], 1.1202),
        ([1, 0, 0, 1], [1, 0, 0, 1], 2.0),  # light scattered once changes its helicity
        ([1, 0, 0, -1], [1, 0, 0, 1], 1.2511),
    ):
        ratio = np.array(seen) @ total @ sent / (np.array(seen) @ alone @ sent)
        assert ratio == close_to(enhancement, rtol=0.0, atol=2e-4)


@pytest.mark.parametrize(
    ("layers", "base"),
    [
        ([vrte.Layer(make_two_dipoles(), 1e-7, 0.7), vrte.Layer(vrte.rayleigh(), 2e-7, math.inf)], None),
        ([vrte.Layer(make_two_dipoles(), 1e-7, 0.7)], vrte.Lambertian(1e-7)),
        ([SURFACE, vrte.Layer(make_two_dipoles(), 1e-7, 0.7), vrte.Layer(vrte.rayleigh(), 2e-7, 0.4)], None),
        ([SURFACE, vrte.Layer(make_two_dipoles(), 1e-7, 0.7)], vrte.Lambertian(1e-7)),
        ([vrte.Interface(1.5, 1.0), vrte.Layer(make_two_dipoles(), 1e-7, 0.7)], vrte.Lambertian(1e-7)),
    ],
    ids=["layers", "base", "surface", "surface and base", "from glass into air"],
)
def test_light_scattered_once(layers: list[Any], base: vrte.Lambertian | None) -> None:
    """It is all there is where next to nothing is scattered."""
    scene, mu = vrte.Scene(layers, base), [0.2, MU, 0.9, 1.0]
    every = vrte.brdf(scene, mu, mu, 180.0, nodes=8).mueller
    found = every[np.arange(4), np.arange(4), 0]
    assert_close(scatter_back_once(scene, np.array(mu)), found, rtol=0.0, atol=1e-6 * found.max())


@pytest.mark.parametrize("top", [[], [SURFACE]], ids=["bare", "surface"])
def test_enhancement_is_at_most_2(top: list[Any]) -> None:
    """In every polarization, since reversed paths add at most what they have; circular light of one helicity gets 2
    times what was scattered more than once, also by particles with several dipoles under a surface."""
    scene = vrte.Scene([*top, vrte.Layer(make_two_dipoles(), 0.99, 3.0)], vrte.Lambertian(0.4))
    found = vrte.brdf(scene, [0.3, 1.0], [0.3, 0.7, 1.0], [0.0, 180.0], nodes=16, coherent=True)
    for incident, index in ((0, 0), (1, 2)):
        multiple = found.mueller[incident, index, 1] - scatter_back_once(scene, found.mu_i)[incident]
        for sign in (-1.0, 1.0):
            for axis in range(1, 4):
                light = np.eye(4)[0] + sign * np.eye(4)[axis]
                same = np.array([1.0, 1.0, -1.0, 1.0]) * light  # U turns over with the axis across the meridian plane
                assert same @ found.coherent[incident] @ light == close_to(same @ multiple @ light, rtol=1e-9, atol=0.0)
                opposite = np.array([1.0, -1.0, 1.0, -1.0]) * light
                assert abs(opposite @ found.coherent[incident] @ light) <= opposite @ multiple @ light


@pytest.mark.parametrize(
    ("scene", "asked", "words"),
    [
        (RAYLEIGH, {"phi": 0.0}, "coherent is in the direction back to the source: phi must have 180 degrees"),
        (RAYLEIGH, {"mu_o": 0.5}, "coherent is in the direction back to the source: mu_o must have mu_i = 0.6"),
        (RAYLEIGH, {"method": "two-stream"}, "coherent is for method 'discrete-ordinates', not 'two-stream'"),
        (
            vrte.Scene([vrte.Layer.of(vrte.flakes(0.3 + 3j), flake_area=1.0)]),
            {},
            "coherent is not known with oriented flakes: coherent is for particles",
        ),
        (
            vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)], vrte.Mirror(1.5)),
            {},
            "coherent is not known over the base Mirror(index=(1.5+0j)): coherent is for particles, over a black or "
            "Lambertian base, bare or under one smooth surface on top",
        ),
        (
            vrte.Scene([vrte.Interface(1.0, 1.5, roughness=0.2), vrte.Layer(vrte.rayleigh(), 0.9, 1.0)]),
            {},
            "coherent is not known with this interface, index 1 above and 1.5 below, roughness 0.2",
        ),
        (
            vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0), vrte.Interface(1.0, 1.5)]),
            {},
            "coherent is not known with this interface, index 1 above and 1.5 below: coherent is for particles",
        ),
    ],
)
def test_what_is_refused(scene: vrte.Scene, asked: dict[str, Any], words: str) -> None:
    with pytest.raises(vrte.SceneError) as error:
        vrte.brdf(scene, **{"mu_i": MU, "mu_o": MU, "phi": 180.0, "coherent": True} | asked)
    assert str(error.value).startswith(words)
    assert error.value.place == ("coherent",)


def test_notes_name_the_direction() -> None:
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)])
    words = "back to the source, mu_o = mu_i and phi = 180, interference adds to mueller: "
    for asked, end in (({}, "coherent=True asks for it"), ({"coherent": True}, "coherent has it")):
        for found in (
            vrte.brdf(scene, MU, [0.3, MU], [0.0, 180.0], nodes=4, **asked),
            *vrte.brdfs([scene, scene], MU, MU, 180.0, nodes=4, **asked),
        ):
            assert found.diagnostics["notes"][-1] == words + end
    nothing = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.0, 1.0)], vrte.Lambertian(0.5))
    for of, mu_o, phi in ((scene, 0.3, 180.0), (scene, MU, 179.0), (nothing, MU, 180.0)):
        for found in (vrte.brdf(of, MU, mu_o, phi, nodes=4), *vrte.brdfs([of, of], MU, mu_o, phi, nodes=4)):
            assert not any("interference" in note for note in found.diagnostics["notes"])


def test_every_way_to_ask_has_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One scene, several, a spectrum, a file, the command, and light from below."""
    layer = {"phase": "rayleigh", "albedo": 0.9, "thickness": 1.0}
    content = {"nodes": 6, "layer": [layer], "brdf": {"mu_i": MU, "mu_o": MU, "phi_deg": 180.0}}
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)])
    alone = vrte.brdf(scene, MU, MU, 180.0, nodes=6, coherent=True)
    below = vrte.brdf(scene, MU, MU, 180.0, nodes=6, coherent=True, illuminate="bottom")
    several = vrte.brdfs([scene, scene], MU, MU, 180.0, nodes=6, coherent=True)
    spectrum = vrte.spectrum(content, [0.4, 0.5], coherent=True)
    for found in (below, *several, *spectrum):
        assert_close(found.coherent, alone.coherent, rtol=1e-12, atol=1e-14)
    assert spectrum.coherent.shape == (2, 1, 4, 4)
    scene_file, result = tmp_path / "scene.toml", tmp_path / "result.nc"
    scene_file.write_text(
        'nodes = 6\n[[layer]]\nphase = "rayleigh"\nalbedo = 0.9\nthickness = 1.0\n'
        f"[brdf]\nmu_i = {MU}\nmu_o = {MU}\nphi_deg = 180.0\n"
    )
    assert run("brdf", scene_file, "--coherent", "-o", result) == 0
    assert f"interference adds to f00 [1/sr] straight back: {alone.coherent[0, 0, 0]:.4f} at mu_i 0.6" in (
        capsys.readouterr().out
    )
    assert_close(vrte.load(result).coherent, alone.coherent, rtol=1e-12, atol=1e-14)
    with pytest.raises(vrte.SceneError, match="coherent is not asked for here"):
        vrte.solve_base(scene, coherent=True)


def test_width_of_the_peak() -> None:
    layer = vrte.Layer(vrte.henyey_greenstein(0.75), 1.0, 10.0)
    assert layer.transport_mean_free_path == close_to(4.0, rtol=1e-12, atol=0.0)
    assert layer.estimate_peak_width(0.6, 0.3) == close_to(
        math.degrees(0.6 / (2.0 * math.pi * 1.2)), rtol=1e-12, atol=0.0
    )
    with pytest.raises(vrte.SceneError, match="mean_free_path_um must be a length in micrometres above 0, not 0"):
        layer.estimate_peak_width(0.6, 0.0)
