"""Tables as bases: against functions that they are tables of, and what is refused."""

import pickle
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

import vrte
from vrte.basics.splines import make_cosines, stretch_cosines
from vrte.scene.boundary import PAULI
from vrte.scene.tabulated_base import expand_azimuths, extrapolate_error

from .helpers import assert_close, close_to

Function = Callable[..., np.ndarray]
EVEN = np.linspace(0.0, 180.0, 9)
Q = np.diag([1.0, 1.0, 1.0, -1.0])
AIR = vrte.Layer(vrte.rayleigh(), 0.9, 0.4)


def dipoles(mu_i: Any, mu_o: Any, phi_deg: Any) -> np.ndarray:
    """A semi-infinite layer of dipoles which turn the phase of light across the meridian plane, seen by single
    scattering, with some white: smooth, reciprocal, and all 16 elements but the mirror's are there."""
    mu_i, mu_o, phi = np.broadcast_arrays(mu_i, mu_o, np.radians(phi_deg))

    def frame(mu: Any, azimuth: Any, up: float) -> tuple[np.ndarray, np.ndarray]:
        across = np.sqrt(1.0 - mu**2)
        cosine, sine = np.cos(azimuth), np.sin(azimuth)
        travel = np.stack([across * cosine, across * sine, up * mu], -1)
        along = np.stack([up * mu * cosine, up * mu * sine, -across], -1)
        return along, np.cross(along, travel)

    into, out = frame(mu_i, 0.0 * phi, -1.0), frame(mu_o, phi, 1.0)
    jones = np.stack([np.stack([(a * b).sum(-1) for b in into], -1) for a in out], -2).astype(complex)
    turned = np.array([1.0, np.exp(0.4j)])
    jones = turned[:, None] * jones * turned
    mueller = 0.5 * np.einsum("iab,...bc,jcd,...ad->...ij", PAULI, jones, PAULI, jones.conj()).real
    white = np.diag([0.05, 0.0, 0.0, 0.0])
    return 0.12 * mueller / (mu_i + mu_o)[..., None, None] + white


def tabulate(function: Function, mu: np.ndarray, phi: np.ndarray = EVEN, **more: Any) -> vrte.TabulatedBase:
    return vrte.TabulatedBase(mu, mu, phi, function(mu[:, None, None], mu[:, None], phi), **more)


def directions(count: int = 40, lowest: float = 0.1) -> tuple[np.ndarray, ...]:
    dice = np.random.default_rng(3)
    return dice.uniform(lowest, 1.0, count), dice.uniform(lowest, 1.0, count), dice.uniform(-180.0, 360.0, count)


@pytest.fixture(scope="module")
def table() -> vrte.TabulatedBase:
    return tabulate(dipoles, make_cosines(24))


def test_a_lambertian_table_is_exact() -> None:
    mu = np.array([0.8, 0.03, 0.4, 0.97])
    base = tabulate(lambda i, o, p: np.broadcast_to(np.diag([0.7 / np.pi, 0, 0, 0]), (4, 4, 3, 4, 4)), mu, EVEN[::4])
    assert base.interpolation_error < 1e-14
    scenes = [vrte.Scene([AIR], one) for one in (base, vrte.Lambertian(0.7))]
    found, expected = (vrte.brdf(one, [0.02, 0.9], [0.01, 0.5, 1.0], [0.0, 70.0], nodes=8) for one in scenes)
    assert_close(found.mueller, expected.mueller, rtol=0.0, atol=2e-15)
    assert_close(found.reflectance, expected.reflectance, rtol=1e-13, atol=0.0)


def test_the_interpolation_is_that_of_splines_one_after_another(table: vrte.TabulatedBase) -> None:
    """A literal oracle at the table's own azimuths: f times the cosines' sum, over s of one direction and then of the
    other, on great circles over the normal and mirrored at the horizon."""
    mu, s = table.mu_i, stretch_cosines(table.mu_i)
    mirror = np.outer([1, 1, -1, -1], [1, 1, -1, -1])

    def along(values: np.ndarray, opposite: np.ndarray, at: float) -> np.ndarray:
        grid = np.concatenate([-s[15::-1], s, 2.0 - s[:-17:-1]])
        return make_interp_spline(grid, np.concatenate([opposite[15::-1], values, values[:-17:-1]]), k=5)(at)

    def opposite(values: np.ndarray) -> np.ndarray:  # half a turn on: 180 - phi, mirrored
        return values[..., ::-1, :, :] * mirror

    assert_close(table.reflect(mu[:, None, None], mu[:, None], EVEN), table.mueller, rtol=1e-13, atol=1e-14)
    both = (mu[:, None] + mu)[:, :, None, None, None]
    for mu_i, mu_o in ((0.31, 0.77), (0.999, 0.04)):
        at_i, at_o = stretch_cosines(np.array([mu_i, mu_o]))
        first = along(table.mueller * both, opposite(table.mueller * both), at_i)
        found = along(first, opposite(first), at_o) / (along(mu, mu, at_i) + along(mu, mu, at_o))
        assert_close(table.reflect(np.array([[mu_i]]), np.array([[mu_o]]), EVEN)[0], found, rtol=0.0, atol=1e-14)


def test_orders_are_those_of_the_function(table: vrte.TabulatedBase) -> None:
    """Against the quadrature over azimuths of a `MuellerBase`."""
    into, out = np.array([0.15, 0.6, 0.98]), np.array([0.2, 1.0])
    given = into, out, np.ones((3, 2), bool), 6, lambda size: 1e-13 * (1.0 + size)
    (found, _), (expected, _) = (one.reflect_orders(*given) for one in (table, vrte.MuellerBase(dipoles)))
    assert len(found) == 3  # all that there are
    assert_close(found, expected[:3], rtol=0.0, atol=2e-5)
    assert np.abs(expected[3:]).max() < 1e-13


def test_orders_come_to_the_accuracy_asked_for_and_no_further() -> None:
    """A glossy table has many orders; those left out are within what is allowed."""

    def glossy(mu_i: Any, mu_o: Any, phi_deg: Any) -> np.ndarray:
        lobe = np.exp(8.0 * (np.cos(np.radians(phi_deg)) - 1.0)) * np.sqrt((1 - mu_i**2) * (1 - mu_o**2))
        return (0.02 + 0.2 * lobe)[..., None, None] * np.diag([1.0, 0, 0, 0])

    f = np.zeros((1, 1, 4, 4, 4))
    f[..., 0, 0] = np.cos(3 * np.radians([0.0, 60.0, 120.0, 180.0]))
    orders, azimuths = expand_azimuths(np.array([0.0, 60.0, 120.0, 180.0]), f, False)
    assert azimuths == 6
    assert_close(orders[:, 0, 0, 0, 0], [0, 0, 0, 0.5], rtol=0.0, atol=1e-15)  # the highest passes through few azimuths
    base = tabulate(glossy, make_cosines(12), np.linspace(0.0, 180.0, 61))
    given: tuple[Any, ...] = np.array([0.3]), np.array([0.5]), np.ones((1, 1), bool), 60
    every, coarse, fine = (
        base.reflect_orders(*given, lambda size, most=most: most * size)[0] for most in (0.0, 1e-2, 1e-6)
    )
    assert len(coarse) < len(fine) < len(every)
    for most, some in ((1e-2, coarse), (1e-6, fine)):
        np.testing.assert_array_equal(some, every[: len(some)])
        assert np.abs(every[len(some) :]).max() <= most * np.abs(every).max()
        assert np.abs(some[-1]).max() > most * np.abs(every).max()


def test_reciprocity_is_kept(table: vrte.TabulatedBase) -> None:
    """f(mu_i, mu_o, phi) = Q f(mu_o, mu_i, phi)^T Q, between the directions of the table too."""
    mu_i, mu_o, phi = directions(lowest=0.005)
    there, back = table.reflect(mu_i, mu_o, phi), table.reflect(mu_o, mu_i, phi)
    assert_close(there, Q @ back.swapaxes(1, 2) @ Q, rtol=0.0, atol=1e-14 * np.abs(there).max())
    assert np.abs(there[:, 2, 3]).max() > 1e-3
    lowest = table.mu_i.min()  # below the smallest cosine f is constant
    low, at = (table.reflect(np.array(mu), np.array(0.5), np.array(30.0)) for mu in (1e-4 * lowest, lowest))
    np.testing.assert_array_equal(low, at)


@pytest.mark.parametrize(
    ("phi", "allowed"),
    [
        (np.arange(0.0, 360.0, 45.0), 1e-14),
        (np.linspace(0.0, 360.0, 9), 1e-14),
        (np.arange(15.0, 180.0, 30.0), 1e-14),
        (np.sort(np.random.default_rng(1).uniform(0.0, 180.0, 40)), 5e-3),
    ],
    ids=["all around", "both ends", "half a step off", "uneven"],
)
def test_azimuths_are_those_of_the_table(phi: np.ndarray, allowed: float, table: vrte.TabulatedBase) -> None:
    """Evenly spaced ones give the same orders wherever they begin; through others a spline runs."""
    found, where = tabulate(dipoles, make_cosines(24), phi), directions()
    assert_close(found.reflect(*where), table.reflect(*where), rtol=0.0, atol=allowed)


def test_mirror_images_that_differ_are_refused_or_averaged(table: vrte.TabulatedBase) -> None:
    phi, mu = np.arange(0.0, 360.0, 45.0), make_cosines(24)
    noise = 1e-4 * np.random.default_rng(5).uniform(-1.0, 1.0, (24, 24, 8, 4, 4))
    measured = dipoles(mu[:, None, None], mu[:, None], phi) * (1.0 + noise)
    with pytest.raises(vrte.SceneError, match=r"base: f\(-phi\) must equal D f\(phi\) D .* breaks this by"):
        vrte.TabulatedBase(mu, mu, phi, measured)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", vrte.CoarseTableWarning)
        mean = vrte.TabulatedBase(mu, mu, phi, measured, average_mirrored=True)
    where = mu[:, None, None], mu[:, None], phi
    assert 0.0 < np.abs(mean.reflect(*where) - table.reflect(*where)).max() < 1e-4 * table.mueller.max()
    flip = np.diag([1.0, 1.0, -1.0, -1.0])
    assert_close(mean.reflect(where[0], where[1], -phi), flip @ mean.reflect(*where) @ flip, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("count", [16, 32])
def test_the_error_told_is_about_the_error_made(count: int) -> None:
    """Root mean square, both cosines as weights, on a grid ten times as fine."""
    base, mu, phi = tabulate(dipoles, make_cosines(count)), np.linspace(0.005, 1.0, 80), np.linspace(7.0, 172.0, 4)
    where = mu[:, None, None], mu[:, None], phi
    weight = np.sqrt(mu[:, None] * mu)[:, :, None, None, None]
    exact = dipoles(*where)
    made = np.linalg.norm(weight * (base.reflect(*where) - exact)) / np.linalg.norm(weight * exact)
    assert made / 8 < base.interpolation_error < 8 * made
    assert extrapolate_error(1e-3, 1e-1) == close_to(1e-5, rtol=1e-6, atol=0.0)  # carried on at the rate of its fall
    assert extrapolate_error(0.3, 0.2) == 0.3  # noise does not fall


@pytest.mark.parametrize(
    ("mu", "words"),
    [
        (np.linspace(0.1, 1.0, 12), r"begins at the cosine 0\.1: what falls in or leaves below is taken for that"),
        (np.linspace(0.01, 0.8, 30), r"has no direction nearer to the normal than 36\.9 degrees"),
        (np.linspace(0.04, 1.0, 5), r"is off by about 0\.\d+ of itself between its directions"),
    ],
)
def test_what_a_table_does_not_reach_is_told(mu: np.ndarray, words: str) -> None:
    with pytest.warns(vrte.CoarseTableWarning, match=words):
        tabulate(dipoles, mu)


def test_it_is_said_in_few_words_and_goes_through_pickle(table: vrte.TabulatedBase) -> None:
    assert repr(table) == "TabulatedBase(24 mu_i, 24 mu_o, 3 Fourier orders)"
    again = pickle.loads(pickle.dumps(table))
    where = directions(5)
    np.testing.assert_array_equal(again.reflect(*where), table.reflect(*where))
    assert vrte.Scene([AIR], again).base_in_words == repr(table)


def test_fields_and_plans_have_tables(table: vrte.TabulatedBase) -> None:
    given = 0.5, [1, 0.2, 0.1, 0.3], [-0.4, 0.3, 1.0], [0, 50], [0, 0.4]
    scenes = [vrte.Scene([AIR], base) for base in (table, vrte.MuellerBase(dipoles))]
    found, expected = (vrte.radiance(scene, *given, nodes=6) for scene in scenes)
    assert_close(found.stokes, expected.stokes, rtol=0.0, atol=1e-6 * expected.stokes.max())
    assert_close(found.flux_up, expected.flux_up, rtol=1e-6, atol=0.0)
    plan = vrte.plan("radiance", scenes[0], 0.5, mu=[0.3], nodes=6)
    assert plan.diagnostics()["base"] == "TabulatedBase"
    assert found.diagnostics["base_interpolation_error"] == table.interpolation_error
