"""Transparent flakes: what a plate does to light, extinction as a matrix, and what a layer of plates needs of a solver;
test_flakes_solved.py solves layers of them."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.linalg

import vrte
from vrte.basics.running import start_run
from vrte.discrete_ordinates.execution.through_interfaces import pass_plates
from vrte.discrete_ordinates.orders import plates
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.orders.slab_response import respond
from vrte.optics.facets import make_rotation
from vrte.optics.films import find_amplitudes, find_plate
from vrte.optics.fresnel import lay_out_mueller, list_elements, reflect_amplitudes
from vrte.scene.oriented import Oriented

from .helpers import assert_close
from .test_discrete_ordinates import frame

COSINES = np.array([0.02, 0.3, 0.7, 1.0])
FILMS = [(2.5 + 0.0j, 0.06), (1.46 + 0.0j, 0.02)]


def make_pearl(host: float = 1.0, film: complex = 2.5, tilt: float = 12.0) -> vrte.Flakes:
    """Titania on mica, or what absorbs a little."""
    return vrte.flakes(None, tilt, [(film, 0.06)], 0.55, host, substrate=1.59, transparent=True)


@pytest.mark.parametrize("host", [1.0, 1.5])
def test_a_clear_plate_loses_nothing(host: float) -> None:
    cosine = np.append(COSINES, [0.0, 1e-7, 1e-3])
    reflected, passed = find_plate(host, FILMS, 1.59, cosine, 0.55)
    assert_close(reflected[:, 0] + passed[:, 0], 1.0, rtol=0.0, atol=3e-15)
    assert_close(reflected[:, 1] + passed[:, 1], 0.0, rtol=0.0, atol=3e-15)
    assert_close(reflected[4, 0], 1.0, rtol=0.0, atol=1e-8)


def test_a_bare_plate_has_a_closed_form() -> None:
    """2 R/(1 + R) of its faces' R."""
    reflected, _ = find_plate(1.5, [], 1.59, COSINES, 1.0)
    face = np.abs(reflect_amplitudes(1.59 / 1.5, COSINES)) ** 2
    assert_close(reflected[:, 0] + reflected[:, 1], 2.0 * face[0] / (1.0 + face[0]), rtol=1e-12, atol=1e-15)
    assert_close(reflected[:, 0] - reflected[:, 1], 2.0 * face[1] / (1.0 + face[1]), rtol=1e-12, atol=1e-15)
    beyond, passed = find_plate(1.5, [], 1.3, np.array([0.3, 0.6]), 1.0)  # of total reflection, and not
    assert_close(beyond[0, :2], [1.0, 0.0], rtol=0.0, atol=1e-14)
    assert not passed[0].any()
    assert passed[1, 0] > 0.5


@pytest.mark.parametrize("film", [FILMS[0], (2.0 + 0.5j, 0.03)])
def test_light_in_a_plate_is_the_mean_of_coherent_plates_of_all_thicknesses(film: Any) -> None:
    """Their fields interfere by characteristic matrices; a period of thickness is averaged over."""
    for cosine in (0.15, 0.3, 0.7, 1.0):
        inside = np.sqrt(1.0 - (1.5 / 1.59) ** 2 * (1.0 - cosine**2))
        right = np.zeros((2, 4))
        for thickness in 7.0 + np.arange(400) / 400 * 0.55 / (2.0 * 1.59 * inside):
            stack = [film, FILMS[1], (1.59 + 0.0j, float(thickness)), FILMS[1], film]
            r_p, r_s, t_p, t_s = find_amplitudes(1.5, stack, 1.5, cosine, 0.55)
            for row, (p, s) in zip(right, ((r_p, r_s), (t_p, t_s)), strict=True):
                row += list_elements(abs(p) ** 2, abs(s) ** 2, p * s.conj()) / 400
        assert_close(find_plate(1.5, [film, FILMS[1]], 1.59, cosine, 0.55), right, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("mu", [0.05, 0.6, -0.8, 1.0])
def test_extinction_is_what_plates_do_not_let_through(mu: float) -> None:
    """The mean of 1 - T over normals in space, T turned from the plane of incidence of each by its own vectors."""
    flakes = make_pearl(1.5)
    (w, l, r), expected = frame(mu, 0.0), np.zeros((4, 4))
    tilt, psi = (np.arange(600) + 0.5) / 600 * flakes.panels[-1], (np.arange(400) + 0.5) / 400 * 2.0 * np.pi
    for one in tilt.tolist():
        normal = np.stack([np.sin(one) * np.cos(psi), np.sin(one) * np.sin(psi), np.full(psi.size, np.cos(one))], -1)
        across = np.cross(np.broadcast_to(w, normal.shape), normal)
        across /= np.linalg.norm(across, axis=1)[:, None]
        met, turn = np.abs(normal @ w), make_rotation(across @ l, across @ r)
        through = turn.swapaxes(-1, -2) @ lay_out_mueller(flakes.list_elements(np.minimum(met, 1.0))[1]) @ turn
        weight = flakes.find_density(one) * np.sin(one) * met * flakes.panels[-1] / 600 * 2.0 * np.pi / 400
        expected += np.tensordot(weight, np.eye(4) - through, 1)
    found = flakes.extinguish(mu)
    assert_close(found, expected, rtol=0.0, atol=3e-6)
    assert_close(flakes.scatter_flux([mu])[0], found[0, :2], rtol=1e-14, atol=0.0)
    lossy = make_pearl(1.5, 2.5 + 0.1j)
    assert (lossy.scatter_flux([mu])[0, 0] < lossy.extinguish(mu)[0, 0]).all()


def test_attenuation_and_paths_are_matrix_exponentials() -> None:
    """Of K along the normal, where rates are degenerate, and along others; paths by Gauss's rule over the depth."""
    one = Oriented(make_pearl(1.5), 0.3, 0.7)
    mu_in, mu_out = np.array([0.4, 1.0]), np.array([0.25, 0.4, 1.0])
    K_in, K_out = (one.extinguish(mu) / mu[:, None, None] for mu in (mu_in, mu_out))
    rates, parts = one.find_rates(mu_out)
    left = np.einsum("nr,nrab->nab", np.exp(-1.7 * rates / mu_out[:, None]), parts).real
    assert_close(left, [scipy.linalg.expm(-1.7 * K) for K in K_out], rtol=0.0, atol=1e-10)
    Z = np.random.default_rng(1).normal(size=(2, 3, 2, 4, 4))
    x, weights = np.polynomial.legendre.leggauss(24)
    for way in range(2):
        found = pass_plates(one, np.array([0.0, 0.9]), mu_in, mu_out, way, Z)
        right = np.zeros_like(Z)
        for s, weight in zip(0.45 * (x + 1.0), 0.45 * weights, strict=True):
            out = s if way == 0 else 0.9 - s
            for i, o in np.ndindex(2, 3):
                inner = scipy.linalg.expm(-s * K_in[i])
                right[i, o] += weight / mu_out[o] * scipy.linalg.expm(-out * K_out[o]) @ Z[i, o] @ inner
        assert not found[0].any()
        assert_close(found[1], right, rtol=0.0, atol=1e-9)
    endless = pass_plates(one, np.array([np.inf, 60.0]), mu_in, mu_out, 0, Z)
    assert_close(endless[0], endless[1], rtol=0.0, atol=1e-8)
    assert not pass_plates(one, np.array([np.inf]), mu_in, mu_out, 1, Z).any()


@pytest.mark.parametrize(("way", "rounding"), [("doubling", 1e-13), ("modes", 5e-6)])
def test_directions_off_the_nodes_may_be_nodes(way: str, rounding: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Opaque flakes and particles, whose directions off the nodes the core knows, as if they were plates."""
    layers = [
        vrte.Layer(vrte.rayleigh(0.03), 0.9, 0.7, None, vrte.flakes(0.9 + 6.0j), 1.5),
        vrte.Layer(vrte.henyey_greenstein(0.5, 12), 0.95, 1.0),
    ]
    mu = np.array([0.9, 0.7, 0.4, 0.35, 0.2, 0.15, 0.95])
    problem = discretise_scene(vrte.Scene(layers), np.array([0.4, 0.8]), np.eye(4), mu, np.zeros(1), 5)
    asked = np.arange(2, dtype=np.int32), np.array([2.0, 1.0]), np.arange(2, dtype=np.int32), start_run(1)
    right: Any = respond(way, problem, *asked, quick=False)
    right = right.expand() if way == "modes" else right
    monkeypatch.setattr(plates, "polarizes_beams", lambda _: True)
    found: Any = plates.respond_with_plates(way, problem, *asked, quick=False)
    for name in ("nodes", "entering", "leaving", "passing"):
        one, other = getattr(found, name), getattr(right, name)
        assert_close(one, other, rtol=0.0, atol=rounding * np.abs(other).max(), err_msg=name)


BARE = vrte.Scene([vrte.Layer.of(make_pearl(), flake_area=2.0)], vrte.Lambertian(0.4))


def test_invariance_gives_way_to_doubling() -> None:
    asked: dict[str, Any] = {"nodes": 8, "truncation": "none"}
    auto, doubling = (vrte.brdf(BARE, 0.5, 0.5, 0.0, algorithm=each, **asked) for each in ("invariance", "doubling"))
    assert auto.diagnostics["algorithm"] == "doubling"
    assert "invariance is not for plates" in auto.diagnostics["algorithm_rule"]
    np.testing.assert_array_equal(auto.mueller, doubling.mueller)


def test_a_plate_without_reflection_is_refused_and_a_faint_one_is_not() -> None:
    with pytest.raises(vrte.SceneError, match=r"substrate is that of the medium, 1\.5: such plates do nothing"):
        vrte.flakes(substrate=1.5, host_index=1.5)
    faint = vrte.Layer.of(vrte.flakes(substrate=1.5001, host_index=1.5), flake_area=2.0)
    found = vrte.brdf(vrte.Scene([faint], vrte.Lambertian(1.0)), 0.5, 0.5, nodes=4)
    assert_close(found.reflectance, 1.0, rtol=0.0, atol=1e-13)


def test_the_same_plates_by_what_they_are_made_of() -> None:
    given: dict[str, Any] = {"stack": [("rutile", 0.05)], "wavelength_um": 0.55, "host_index": 1.5}
    flakes = vrte.flakes(substrate="mica", transparent=True, **given)
    assert flakes == replace(flakes, substrate=1.59)
    assert "0.05 um of index" in flakes.in_words
    assert "on clear plates of index 1.59" in flakes.in_words
    assert flakes == vrte.flakes(substrate="mica", tilt_deg=12.0, **given)
    with pytest.raises(vrte.SceneError, match="plates reflect at both faces, and have no amplitudes"):
        flakes.reflect(0.5)


@pytest.mark.parametrize(("given", "words"), [
    ({"transparent": True}, "flakes: transparent needs a substrate"),
    ({"substrate": 1.6, "transparent": False}, "flakes: transparent must be True with a substrate, or left out"),
    ({"substrate": 1.6, "index": 1.5}, "flakes: give either index, of an opaque core, or substrate, of clear plates"),
    ({"substrate": "mica"}, "flakes: substrate is that of a wavelength: give wavelength_um"),
    ({"substrate": "aluminium", "wavelength_um": 0.55}, "flakes: substrate must be that of a clear plate, k at most"),
])  # fmt: skip
def test_what_is_no_plate_is_refused(given: dict[str, Any], words: str) -> None:
    with pytest.raises(vrte.SceneError) as caught:
        vrte.flakes(**given)
    assert words in str(caught.value)
    with pytest.raises(vrte.SceneError, match="give either index, of an opaque core, or substrate"):
        vrte.Flakes(1.5, substrate=1.6)


def test_photons_past_plates_are_counted_in_bins_alone() -> None:
    with pytest.raises(vrte.SceneError, match="follows no light along single directions past transparent flakes"):
        vrte.brdf(BARE, 0.5, 0.5, method="monte-carlo")
    assert vrte.brdf(BARE, 0.5, 0.5, nodes=4, verify="photons").diagnostics["photons"]["notes"] == []
