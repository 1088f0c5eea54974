"""Many small scenes solved together: each as by itself, to the last bit."""

import math
import warnings

import numpy as np
import pytest

import vrte
from vrte import _core
from vrte.basics.running import ThreadTeam
from vrte.calls import alike

MU = np.array([0.1, 0.45, 1.0])
PHI = np.array([0.0, 30.0, 180.0, 300.0])
GREY = vrte.henyey_greenstein(0.4, 16)


def layer(phase=GREY, albedo=0.9, thickness=0.7):
    """A layer, thick enough to be solved by modes."""
    return vrte.Layer(phase, albedo, thickness)


def make_scenes(seed=3, count=14):
    """Scalar and polarizing ones of one to three layers, over black and even bases."""
    draw = np.random.default_rng(seed)
    found = []
    for k in range(count):
        phases = [
            vrte.rayleigh(draw.uniform(0.0, 0.1)) if k % 2 else vrte.henyey_greenstein(draw.uniform(0.1, 0.5), 16)
            for _ in range(1 + k % 3)
        ]
        layers = [layer(phase, draw.uniform(0.3, 1.0), 10 ** draw.uniform(-0.5, 0.4)) for phase in phases]
        found.append(vrte.Scene(layers, vrte.Lambertian(draw.uniform(0.0, 1.0)) if k % 4 else None))
    return found


def assert_same(found, alone):
    """Every array, to the last bit."""
    for name in ("mueller", "reflectance", "transmission", "direct_transmittance", "specular", "mu_i", "phi"):
        one, other = getattr(found, name), getattr(alone, name)
        assert (one is None) == (other is None)
        assert one is None or np.array_equal(one, other), name
    assert found.jacobian is None
    assert not set(alone.diagnostics) - set(found.diagnostics)
    for name, value in alone.diagnostics.items():
        if name not in ("stages", "wall_seconds", "threads", "polarized_light"):
            assert found.diagnostics[name] == value, name


@pytest.mark.parametrize("transmission", [False, True])
def test_each_is_as_by_itself(transmission):
    scenes, asked = make_scenes(), {"nodes": 8, "threads": 1, "transmission": transmission}
    together = vrte.brdfs(scenes, MU, MU, PHI, **asked)
    assert all("_tell" in vars(one) for one in together)
    for scene, found in zip(scenes, together, strict=True):
        assert_same(found, vrte.brdf(scene, MU, MU, PHI, **asked))
        assert found.diagnostics["solved_together"] > 1


@pytest.mark.parametrize("truncation", ["auto", "delta-m", "none"])
def test_peaks_are_cut_as_by_itself(truncation):
    peaked = [vrte.henyey_greenstein(g) for g in (0.5, 0.6, 0.7, 0.75)]
    scenes = [vrte.Scene([layer(one, 0.8, 0.9), layer(two)]) for one, two in zip(peaked, reversed(peaked), strict=True)]
    scenes += [vrte.Scene([layer(GREY), layer(vrte.henyey_greenstein(0.2, 16))])]
    asked = {"nodes": 8, "threads": 1, "truncation": truncation}
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        together = vrte.brdfs(scenes, MU, MU, PHI, **asked)
    assert all("_tell" in vars(one) for one in together)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        for scene, found in zip(scenes, together, strict=True):
            assert_same(found, vrte.brdf(scene, MU, MU, PHI, **asked))
    assert sorted(str(one.message) for one in told) == sorted(str(one.message) for one in said)


def test_what_cannot_be_shared_is_solved_by_itself():
    odd = [
        vrte.Scene([layer(thickness=math.inf)]),
        vrte.Scene([layer(thickness=1e-6)]),
        vrte.Scene([layer(thickness=60.0)], vrte.Lambertian(0.3)),
        vrte.Scene([layer(thickness=0.0)], vrte.Lambertian(0.3)),
        vrte.Scene([layer(vrte.henyey_greenstein(0.6, 40)), layer(vrte.rayleigh())]),
        vrte.Scene([layer()], vrte.Mirror(1.5)),
        vrte.Scene([vrte.Interface(1.0, 1.3), layer()]),
    ]
    plain = [vrte.Scene([layer(albedo=albedo)]) for albedo in (0.5, 0.0, 1.0)]
    shared = vrte.Scene([layer(thickness=0.8), layer(vrte.isotropic()), layer(thickness=0.9)])
    scenes = [*odd, *plain, shared, shared]
    together = vrte.brdfs(scenes, MU, MU, PHI, nodes=8, threads=1)
    assert sum("_tell" in vars(one) for one in together) == 4  # without scattering nothing is left to share
    for scene, found in zip(scenes, together, strict=True):
        assert_same(found, vrte.brdf(scene, MU, MU, PHI, nodes=8, threads=1))


def test_threads_and_batches_change_no_bit(monkeypatch):
    scenes = make_scenes()
    first = vrte.brdfs(scenes, MU, MU, PHI, nodes=8, threads=1)
    monkeypatch.setattr(alike, "BATCH_BYTES", 1.0)
    told = []
    again = vrte.brdfs(scenes, MU, MU, PHI, nodes=8, threads=2, progress=lambda *at: told.append(at))
    assert told == sorted(told)
    assert told[-1] == (1400, 1400)
    for one, other in zip(first, again, strict=True):
        assert np.array_equal(one.mueller, other.mueller)


def test_an_interruption_stops_them(monkeypatch):
    calls = []

    def interrupt(requests, likeness, places, run):
        calls.append(places)
        raise KeyboardInterrupt

    monkeypatch.setattr(alike, "solve_batch", interrupt)
    with pytest.raises(KeyboardInterrupt):
        vrte.brdfs(make_scenes(), MU, MU, PHI, nodes=8, threads=1)
    assert len(calls) == 1


def test_results_are_read_only_and_go_through_pickles():
    import pickle

    found = vrte.brdfs(make_scenes(count=6), MU, MU, PHI, nodes=8)[0]
    with pytest.raises(ValueError, match="read-only"):
        found.mueller[0] = 1.0
    again = pickle.loads(pickle.dumps(found))
    assert np.array_equal(again.mueller, found.mueller)
    assert again.diagnostics == found.diagnostics
    with pytest.raises(AttributeError, match="nothing"):
        _ = found.nothing


def test_a_bad_scene_is_named():
    with pytest.raises(vrte.SceneError, match="scene 2"):
        vrte.brdfs([make_scenes()[0], "none"], MU, MU, nodes=8)


def test_loops_over_stacks_are_those_of_each_scene():
    draw, crew = np.random.default_rng(5), ThreadTeam(1, np.zeros(1), np.zeros(1, np.int32))
    above = np.array([[0.0, 0.3], [0.0, 1.5]])
    thickness = np.array([[0.3, 0.4], [1.5, 0.1]])
    level, at, chosen = np.array([[0.0, 0.4], [0.0, 0.1]]), np.array([0, 1], np.int32), np.array([0, 1], np.int32)
    where = {"level_layer": at, "chosen": chosen, "mu0": MU, "mu": np.array([0.3, -0.6])}
    every = _core.path_integrals(
        above=above.ravel(), thickness=thickness.ravel(), level=level.ravel(), slab_stacks=2, **where
    )
    for k in range(2):
        one = _core.path_integrals(above=above[k], thickness=thickness[k], level=level[k], **where)
        assert np.array_equal(every[2 * k : 2 * k + 2], one)
    coefficients = np.stack([vrte.henyey_greenstein(g, 6).coefficients for g in (0.05, 0.1, 0.2, 0.15)])
    terms, albedo, weights = np.full(4, 6, np.int32), draw.uniform(0.2, 1.0, 4), np.array([0.5, 0.5])

    def bound(rows, piles):
        found = np.empty((rows.size, 6)), np.empty(6 * piles), np.empty((6 * piles, 2))
        _core.order_bounds(
            crew,
            coefficients=coefficients[rows],
            terms=terms[rows],
            albedo=albedo[rows],
            directions=np.array([0.2, 0.8, 0.3, 0.6]),
            weights=weights,
            n_out=1,
            strength=found[0],
            bounds=found[1],
            effect=found[2],
            slab_stacks=piles,
        )
        return found

    both = bound(np.arange(4), 2)
    apart = zip(bound(np.arange(2), 1), bound(np.arange(2, 4), 1), strict=True)
    for whole, halves in zip(both, apart, strict=True):
        assert np.array_equal(whole, np.concatenate(halves))
