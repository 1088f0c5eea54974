"""vrte.photons: energy, bits, and every kind of scene against the solver, with which they share the scene alone."""

import math
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from bench.cases import find_phase_matrix
from vrte import cli
from vrte.basics.arrays import Array
from vrte.calls import photon_check
from vrte.monte_carlo import trace

from .helpers import assert_close
from .random_scenes import cosines, scene, surfaced

RAYLEIGH = vrte.rayleigh()
MU_EDGES, PHI_EDGES = np.linspace(0.0, 1.0, 5), np.linspace(0.0, 180.0, 5)
MOST = 4.0  # standard errors that a mean may be off by
NOISE = 3e-3  # of the largest bin, in the slow test


def spread(edges: Array, points: int) -> tuple[Array, Array]:
    """Gauss points in every bin, and their weights, (bin, point) both."""
    x, weights = np.polynomial.legendre.leggauss(points)
    size = np.diff(edges)[:, None]
    return edges[:-1, None] + 0.5 * size * (x + 1.0), 0.5 * size * weights


def solve_bins(found: vrte.Photons, layers: vrte.Scene, points: int = 8, **options: Any) -> tuple[Array, Array | None]:
    """The solver's fluxes in the bins of photons, reflected and transmitted (n_in, n_mu, n_phi, 4, 4)."""
    mu, weight = spread(found.mu_edges, points)
    phi, share = spread(found.phi_edges, points)
    open_below = layers.base is None and math.isfinite(layers.thickness)
    brdf = vrte.brdf(layers, found.mu_i, mu.ravel(), phi.ravel(), transmission=open_below, **options)
    shape = found.mu_i.size, *mu.shape, *phi.shape, 4, 4
    area = 2.0 * (weight * mu)[:, :, None, None] * np.radians(share)
    both = [None if f is None else np.einsum("impfqst,mpfq->imfst", f.reshape(shape), area)
            for f in (brdf.mueller, brdf.transmission)]  # fmt: skip
    assert both[0] is not None
    return both[0], both[1]


def check(found: vrte.Photons, layers: vrte.Scene, most: float = MOST, **options: Any) -> None:
    """Photons of a scene against the solver, element by element in standard errors. Those of a few photons are not
    known: none is taken for less than a tenth of the error of I in its bin, and of NOISE."""
    reflected, transmitted = solve_bins(found, layers, **options)
    parts = [(found.up[:, 0], found.up_error[:, 0], reflected)]
    if transmitted is not None:
        parts.append((found.down[:, -1], found.down_error[:, -1], transmitted))
    least = 0.1 * NOISE * max(np.abs(right).max() for _, _, right in parts)
    off = []
    for mean, error, right in parts:
        error = np.maximum(np.maximum(error, 0.1 * error[..., :1, :1]), least)
        off.append((np.abs(mean - right) / error).ravel())
    together = np.concatenate(off)
    assert together.max() < most
    assert np.sqrt(np.mean(together**2)) < 1.3  # and no more often than chance has it
    assert not any(found.diagnostics["given_up"])


def find_noise(found: vrte.Photons) -> float:
    """The largest standard error of I over the largest bin, of reflected light."""
    return float(found.up_error[:, 0, ..., 0, 0].max() / found.up[:, 0, ..., 0, 0].max())


GOLD = find_phase_matrix("red gold powder")
SPHEROIDS = find_phase_matrix("spheroids")
GLASS, GGX = vrte.Interface(1.0, 1.5), vrte.Interface(1.0, 1.5, roughness=0.5, distribution="ggx")
METALLIC = vrte.Layer(RAYLEIGH, 0.9, 0.5, flakes=vrte.flakes(0.3 + 3.0j, 12.0, host_index=1.5), flake_area=1.5)
PEARL = vrte.flakes(None, 15.0, [(2.5, 0.06)], 0.55, 1.5, substrate=1.59)
SCENES: dict[str, Callable[[], vrte.Scene]] = {
    "circular": lambda: vrte.Scene([vrte.Layer(SPHEROIDS, 0.99, 2.0)]),
    "two layers": lambda: vrte.Scene([vrte.Layer(GOLD, 0.8, 1.0), vrte.Layer(RAYLEIGH, 0.9, 0.5)]),
    "thin": lambda: vrte.Scene([vrte.Layer(RAYLEIGH, 0.5, 1e-4)]),
    "dark": lambda: vrte.Scene([vrte.Layer(GOLD, 1e-3, 1.0)]),
    "semi-infinite": lambda: vrte.Scene([vrte.Layer(RAYLEIGH, 1.0, math.inf)]),
    "white": lambda: vrte.Scene([vrte.Layer(RAYLEIGH, 1.0, 0.5)], vrte.Lambertian(0.5)),
    "smooth": lambda: vrte.Scene([GLASS, vrte.Layer(GOLD, 0.9, 1.0), vrte.Interface(1.5, 1.2)]),
    "rough": lambda: vrte.Scene([vrte.Interface(1.0, 1.5, roughness=0.3), vrte.Layer(RAYLEIGH, 0.9, 1.0)],
                                vrte.Lambertian(0.5)),
    "rough, GGX": lambda: vrte.Scene([GGX, vrte.Layer(RAYLEIGH, 0.9, 1.0), vrte.Interface(1.5, 1.0)]),
    "not conserving": lambda: vrte.Scene([vrte.Interface(1.0, 1.5, 0.5, conserving=False),
                                          vrte.Layer(RAYLEIGH, 0.9, 1.0)]),
    "without shadowing": lambda: vrte.Scene([vrte.Interface(1.0, 1.4, 0.2, "ggx", shadowing=False),
                                             vrte.Layer(RAYLEIGH, 0.9, 1.0)]),
    "brushed metal": lambda: vrte.Scene([vrte.Layer(RAYLEIGH, 0.9, 0.3)], vrte.Facets((0.2, 3.0), 0.4)),
    "sea": lambda: vrte.Scene([vrte.Layer(RAYLEIGH, 0.9, 0.3)], vrte.cox_munk(10.0)),
    "mirror": lambda: vrte.Scene([vrte.Layer(RAYLEIGH, 0.9, 0.3)], vrte.Mirror((0.2, 3.0))),
    "flakes": lambda: vrte.Scene([vrte.Layer.of(vrte.flakes(0.3 + 3.0j, 15.0), flake_area=2.0)]),
    "mirrors": lambda: vrte.Scene([vrte.Layer.of(vrte.flakes(None, 20.0), flake_area=1.0)], vrte.Lambertian(0.5)),
    "metallic paint": lambda: vrte.Scene([GLASS, METALLIC]),
    "plates": lambda: vrte.Scene([vrte.Layer.of(replace(PEARL, host_index=1.0), flake_area=2.0)]),
    "pearl paint": lambda: vrte.Scene([GLASS, vrte.Layer(RAYLEIGH, 0.9, 0.3, flakes=PEARL, flake_area=2.0)],
                                      vrte.Lambertian(0.8)),
    "rough metallic paint": lambda: vrte.Scene([vrte.Interface(1.0, 1.5, 0.3), METALLIC], vrte.Lambertian(0.3)),
    "soil": lambda: vrte.Scene([vrte.Layer(RAYLEIGH, 0.9, 0.3)], vrte.RPV(0.2, 0.8, -0.1)),
}  # fmt: skip


@pytest.mark.parametrize("name", SCENES)
def test_photons_find_what_the_solver_finds(name: str) -> None:
    layers = SCENES[name]()
    found = vrte.photons(layers, 0.6, MU_EDGES, PHI_EDGES, photons=60_000, seed=1)
    check(found, layers, 4.5, points=5, nodes=16)  # some 300 elements each: beyond 4.5 in one of 450 scenes


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(30))
def test_photons_of_scenes_drawn_by_chance(seed: int) -> None:
    """Layers alone, under surfaces, and over a base of each kind; the noise below 0.3 % of the largest bin."""
    chance = np.random.default_rng(seed)
    found = (scene, surfaced)[seed % 2](chance)
    while sum(each is not None for each in found.interfaces) > 1 and found.thickness < 0.01:
        found = surfaced(chance)  # plates that trap light for thousands of reflections take minutes
    if seed % 3 == 0 and found.base is None and math.isfinite(found.thickness):
        index = found.index_below
        bases = vrte.Facets((0.2, 3.0), 0.3), vrte.Mirror(1.5 * index), vrte.RPV(0.2, 0.8, -0.1), vrte.Lambertian(0.7)
        found = vrte.Scene(found.layers, bases[seed // 3 % 4], found.interfaces)
    mu_i = max(0.15, float(cosines(chance, 1)[0]))
    ratios = [index / found.index_below for index in found.media if index < found.index_below]
    inside = sorted({math.sqrt(1.0 - ratio**2) for ratio in ratios})  # where light below has a step
    edges = np.array([0.0, *(inside or [0.5]), 1.0]), np.array([0.0, 90.0, 180.0])
    few = vrte.photons(found, mu_i, *edges, photons=50_000, seed=1000 + seed)
    photons = int(50_000 * max(1.0, (1.2 * find_noise(few) / NOISE) ** 2))
    many = vrte.photons(found, mu_i, *edges, photons=photons, seed=seed)
    check(many, found, points=10, accuracy=1e-5)
    assert find_noise(many) < NOISE


def test_energy_is_conserved_photon_by_photon() -> None:
    """What absorbs nothing and hides nothing gives all photons back, whatever their number."""
    paint = vrte.Scene([vrte.Interface(1.0, 1.5, roughness=0.4), vrte.Layer(GOLD, 1.0, 1.0)], vrte.Lambertian(1.0))
    found = vrte.photons(paint, [0.3, 1.0], photons=2000)
    assert_close(found.up[:, 0, ..., 0, 0].sum(axis=(1, 2)), 1.0, rtol=1e-12, atol=0.0)
    assert_close(found.balance, 1.0, rtol=1e-12, atol=0.0)
    assert not found.absorbed.any()
    grey = vrte.photons(vrte.Scene([vrte.Layer(GOLD, 0.8, 1.0)], vrte.Lambertian(0.5)), 0.5, photons=2000)
    assert_close(grey.balance, 1.0, rtol=1e-12, atol=0.0)
    assert grey.absorbed[0, 0] > 0.1
    assert grey.lost[0] > 0.05


def test_fields_at_depths() -> None:
    layers = vrte.Scene([GLASS, vrte.Layer(RAYLEIGH, 0.9, 0.5), vrte.Layer(GOLD, 0.8, 0.5)], vrte.Lambertian(0.3))
    tau = [0.0, 0.2, 0.5, 1.0]
    for side in ("above", "below"):
        found = vrte.photons(layers, 0.6, [0.0, 1.0], [0.0, 180.0], tau, photons=100_000, side=side)
        field = vrte.radiance(layers, 0.6, mu=[], tau=tau, nodes=16, side=side)
        for fluxes, mean, error in ((field.flux_up, found.up, found.up_error),
                                    (field.flux_down, found.down, found.down_error),
                                    (field.direct, found.beam_down, found.beam_down_error),
                                    (field.direct_up, found.beam_up, found.beam_up_error)):  # fmt: skip
            every = tuple(range(2, mean.ndim - 2))
            mean, error = mean.sum(axis=every)[0, :, 0, 0], error.sum(axis=every)[0, :, 0, 0]
            assert np.abs(mean - fluxes / 0.6 <= MOST * error + 1e-12).all(), side


def test_light_from_below() -> None:
    layers = vrte.Scene([GLASS, vrte.Layer(SPHEROIDS, 0.9, 0.5), vrte.Layer(GOLD, 0.8, 0.5)])
    found = vrte.photons(layers, 0.6, MU_EDGES, PHI_EDGES, photons=60_000, illuminate="bottom")
    reflected, transmitted = solve_bins(found, layers, points=5, nodes=16, illuminate="bottom")
    assert np.abs((found.down[:, -1] - reflected) / np.maximum(found.down_error[:, -1], 1e-5)).max() < 4.5
    assert np.abs((found.up[:, 0] - transmitted) / np.maximum(found.up_error[:, 0], 1e-5)).max() < 4.5
    assert found.absorbed[0, 1] > found.absorbed[0, 0]


def test_the_same_bits_on_any_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    layers = vrte.Scene([GLASS, vrte.Layer(GOLD, 0.9, 1.0)], vrte.RPV(0.2, 0.8, -0.1))

    def found(seed: int = 5, threads: int = 1) -> vrte.Photons:
        return vrte.photons(layers, [0.4, 0.9], photons=5000, seed=seed, threads=threads)

    first = found()
    monkeypatch.setattr(trace, "AT_ONCE", 7)
    for other in (found(threads=2), found(threads=3)):
        assert first.up.tobytes() == other.up.tobytes()
        assert first.up_error.tobytes() == other.up_error.tobytes()
        assert first.lost.tobytes() == other.lost.tobytes()
    assert first.up.tobytes() != found(seed=6).up.tobytes()
    assert not first.up.flags.writeable


def test_a_base_in_python_is_that_of_the_core() -> None:
    """Parity of both ways that photons are reflected."""

    def even(mu_i: Any, mu_o: Any, phi: Any) -> Array:
        shape = np.broadcast_shapes(np.shape(mu_i), np.shape(mu_o), np.shape(phi))
        return np.broadcast_to(np.diag([0.4 / np.pi, 0.0, 0.0, 0.0]), (*shape, 4, 4))

    layer = vrte.Layer(RAYLEIGH, 1.0, 0.3)
    one, other = (vrte.photons(vrte.Scene([layer], base), 0.7, MU_EDGES, PHI_EDGES, photons=100_000)
                  for base in (vrte.Lambertian(0.4), vrte.MuellerBase(even)))  # fmt: skip
    both = np.hypot(one.up_error, other.up_error)
    assert np.abs((one.up - other.up)[both > 0.0] / both[both > 0.0]).max() < 4.5
    assert_close(other.balance, 1.0, rtol=0.0, atol=0.01)


def test_progress_and_an_interrupt() -> None:
    seen: list[tuple[int, int]] = []
    layers = vrte.Scene([vrte.Layer(RAYLEIGH, 1.0, 50.0)])
    vrte.photons(layers, [0.5, 1.0], photons=1000, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (256, 256)
    assert seen == sorted(seen)

    def stop(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        vrte.photons(layers, 0.5, photons=1000, progress=stop)
    assert threading.active_count() < 50


def test_photons_that_go_on_for_ever_are_given_up_and_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trace, "MOST_EVENTS", 3.0)
    found = vrte.photons(vrte.Scene([vrte.Layer(RAYLEIGH, 1.0, 50.0)]), 0.5, photons=1000)
    assert 0.1 < found.diagnostics["given_up"][0] < 1.0
    assert_close(found.balance, 1.0, rtol=1e-12, atol=0.0)


def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer photons verify."""
    monkeypatch.setattr(photon_check, "PHOTONS", 60_000)
    monkeypatch.setattr(photon_check, "FEWEST", 20_000)


def test_photons_verify_a_brdf_and_a_field(monkeypatch: pytest.MonkeyPatch) -> None:
    few(monkeypatch)
    film = vrte.Scene([GLASS, vrte.Layer(SPHEROIDS, 0.9, 1.0)])
    brdf = vrte.brdf(film, [0.4, 0.8], 0.5, nodes=12, verify="photons")
    field = vrte.radiance(film, 0.5, (1.0, 0.3, 0.1, 0.1), [0.4, -0.4], tau=[0.0, 0.3], nodes=12, illuminate="bottom",
                          verify="photons")  # fmt: skip
    for found in (brdf.diagnostics, field.diagnostics):
        assert max(found["photons"][name] for name in "IQUV") <= photon_check.MOST
        assert min(found["photons"][name] for name in "IQUV") > 1.0
        assert found["photons"]["notes"] == []
    assert brdf.mueller.tobytes() == vrte.brdf(film, [0.4, 0.8], 0.5, nodes=12).mueller.tobytes()


def test_progress_of_a_solve_and_of_the_photons_that_verify_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half each, photons block by block."""
    few(monkeypatch)
    film, seen = vrte.Scene([vrte.Layer(RAYLEIGH, 0.9, 1.0)]), list[float]()
    vrte.brdf(film, 0.5, 0.5, nodes=8, verify="photons", progress=lambda done, total: seen.append(done / total))
    assert seen == sorted(seen)
    assert 0.5 in seen
    assert len({done for done in seen if done > 0.5}) >= 4


VIEWED: dict[str, Callable[[], vrte.Scene]] = {
    "Rayleigh": lambda: vrte.Scene([vrte.Layer(RAYLEIGH, 0.9, 1.0)]),
    "gold-like over grey": lambda: vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.75), 0.95, 2.0)],
                                              vrte.Lambertian(0.4)),
    "two layers": SCENES["two layers"],
    "circular": SCENES["circular"],
    "semi-infinite": lambda: vrte.Scene([vrte.Layer(GOLD, 0.9, math.inf)]),
    "thin": SCENES["thin"],
    "flakes": SCENES["flakes"],
    "mirrors": SCENES["mirrors"],
    "flakes and particles": lambda: vrte.Scene(
        [vrte.Layer(RAYLEIGH, 0.9, 0.5, flakes=vrte.flakes(0.3 + 3.0j, 12.0), flake_area=1.5)], vrte.Lambertian(0.3)),
}  # fmt: skip
ALONG: dict[str, Any] = {"mu_o": [0.2, 0.7, 1.0], "phi": [0.0, 70.0, 180.0, 300.0]}


def check_views(found: Any, right: Any, error: Any) -> None:
    """Light along directions in standard errors, none below a hundredth of that of I."""
    sure = np.maximum(np.array(error), 0.01 * np.array(error)[..., :1, :1])
    off = np.abs(found - right) / sure
    assert off.max() < 4.5
    assert np.sqrt(np.mean(off**2)) < 1.3


@pytest.mark.parametrize("name", VIEWED)
def test_photons_find_light_along_single_directions(name: str) -> None:
    """Method monte-carlo, reflected and transmitted, against the exact one: 200 to 800 elements each."""
    layers = VIEWED[name]()
    asked = ALONG | {"mu_i": [0.5, 0.9], "transmission": layers.base is None and math.isfinite(layers.thickness)}
    found = vrte.brdf(layers, **asked, method="monte-carlo", settings={"photons": 30_000, "seed": 2})
    right = vrte.brdf(layers, **asked, accuracy=1e-5)
    error = found.diagnostics["standard_error"]
    check_views(found.mueller, right.mueller, error[0][0])
    if asked["transmission"]:
        check_views(found.transmission, right.transmission, error[1][0])
    assert found.diagnostics["achieved"] < 0.05
    assert "standard errors are up to" in found.diagnostics["notes"][0]
    assert_close(found.reflectance, right.reflectance, rtol=0.05, atol=0.0)  # counted: noise of 0.4 to 1.2 %


@pytest.mark.parametrize("illuminate", ["top", "bottom"])
def test_photons_find_fields_along_single_directions(illuminate: str) -> None:
    """Of polarized light, at depths, from either side."""
    layers = vrte.Scene([vrte.Layer(SPHEROIDS, 0.9, 0.5), vrte.Layer(RAYLEIGH, 0.8, 0.5)])
    asked: dict[str, Any] = {
        "mu0": [0.5, 0.9],
        "stokes": (1.0, 0.4, 0.3, 0.2),
        "mu": [0.3, -0.6, 1.0],
        "phi": [20.0, 250.0],
    }
    asked |= {"tau": [0.0, 0.3, 0.5, 1.0], "illuminate": illuminate}
    found = vrte.radiance(layers, **asked, method="monte-carlo", settings={"photons": 30_000})
    right = vrte.radiance(layers, **asked, accuracy=1e-6)
    error = np.moveaxis(np.array(found.diagnostics["standard_error"][0])[..., 0], 0, 1)
    sure = np.maximum(error, 0.01 * error[..., :1])
    assert np.abs((found.stokes - right.stokes)[sure > 0.0] / sure[sure > 0.0]).max() < 4.5
    for name in ("flux_up", "flux_down"):
        assert_close(getattr(found, name), getattr(right, name), rtol=0.0, atol=0.01)


def test_light_along_single_directions_by_any_threads_and_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    layers = vrte.Scene([vrte.Layer(GOLD, 0.9, 1.0)], vrte.Lambertian(0.5))

    def found(threads: int, seed: int = 5, photons: int = 3000) -> vrte.Brdf:
        how = {"settings": {"photons": photons, "seed": seed}, "method": "monte-carlo", "threads": threads}
        return vrte.brdf(layers, [0.4, 0.9], **ALONG, **how)

    first = found(1)
    assert first.diagnostics["photons_per_beam"] == 3072
    monkeypatch.setattr(trace, "AT_ONCE", 7)
    for threads in (2, 3):
        assert found(threads).mueller.tobytes() == first.mueller.tobytes()
    assert found(1, seed=6).mueller.tobytes() != first.mueller.tobytes()
    fewer, more = (found(1, photons=each).diagnostics["achieved"] for each in (3000, 48_000))
    assert 2.5 < fewer / more < 6.0  # one over the root of 16


def test_photons_tell_of_light_that_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    """Single scattering of a thick layer; other photons confirm what the first ones find."""
    few(monkeypatch)
    thick = vrte.Scene([vrte.Layer(RAYLEIGH, 0.9, 1.0)])
    with pytest.warns(vrte.AccuracyWarning) as told:
        found = vrte.brdf(thick, 0.5, 0.5, method="single-scattering", verify="photons").diagnostics["photons"]
    assert found["I"] > photon_check.MOST
    assert found["seed"] == 1
    assert any("photons find another I: " in note for note in found["notes"])
    assert {str(each.message) for each in told} == set(found["notes"])


def test_bins_of_verification_end_where_light_is_reflected_totally() -> None:
    edges = photon_check.find_edges((1.0, 1.5, 1.0))
    assert np.abs(edges - math.sqrt(1.0 - 1.0 / 1.5**2)).min() < 1e-12
    assert edges[0] == 0.0
    assert edges[-1] == 1.0
    assert edges.size == photon_check.BINS + 1  # a critical cosine of 0.745 in place of 0.75


def test_the_command_verifies_by_photons(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    few(monkeypatch)
    file = tmp_path / "haze.toml"
    file.write_text(
        'nodes = 8\n[[layer]]\nphase = "rayleigh"\nalbedo = 0.9\nthickness = 0.5\n[brdf]\nmu_i = [0.5]\nmu_o = [0.5]\n'
    )
    assert cli.main(["brdf", str(file), "--photons", "-o", str(tmp_path / "haze.csv")]) == 0
    assert "photons a beam: off by I " in capsys.readouterr().out
    by_photons = ["--method", "monte-carlo", "--set", "photons=3000"]
    text = file.read_text()
    file.write_text(text.replace("nodes = 8\n", ""))
    assert cli.main(["brdf", str(file), *by_photons, "-o", str(tmp_path / "views.csv")]) == 0
    assert "monte-carlo, 3072 photons a beam" in capsys.readouterr().out
    made = vrte.load(tmp_path / "views.csv").diagnostics
    assert np.shape(made["standard_error"]) == (1, 1, 1, 1, 1, 4, 4)
    file.write_text(text)
    assert cli.main(["brdf", str(file), "--photons", "--verify", "-o", str(tmp_path / "other.csv")]) == 2
    assert "--verify and --photons are two checks" in capsys.readouterr().err
