"""What bounds a stack below: orders of bases, a published surface, a user's own, how azimuths are integrated, and what
is refused."""

import runpy
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.discrete_ordinates.orders.base import find_reflected_orders
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.formats.bases import BASES
from vrte.formats.keys import FilePath
from vrte.methods import find_method
from vrte.request.how import EXACT, METHODS
from vrte.scene.azimuths import sum_over_azimuths, sum_pieces
from vrte.scene.boundary import BLACK, Boundary, Lambertian, MuellerBase, make_azimuth_rule

from .helpers import assert_close

EXAMPLES = Path(__file__).parents[1] / "examples"
Function = Callable[..., np.ndarray]
DIRECTIONS: dict[str, Any] = {"mu_i": [0.3, 0.9], "mu_o": [0.2, 1.0], "phi": [0.0, 70.0]}
PILE = [vrte.Layer(vrte.rayleigh(), 0.9, 0.4)]
THREE = [BLACK, Lambertian(0.3), MuellerBase(lambda mu_i, mu_o, phi: np.diag([0.1, 0.05, 0.05, 0.02]))]


@dataclass(frozen=True)
class Grey(Boundary):
    """Reflects half of the light evenly, as a third party would write it."""

    orders_reflected = 1

    @property
    def even_albedo(self) -> float:
        return 0.5

    def reflect(self, mu_i: Any, mu_o: Any, phi_deg: Any) -> Any:
        return np.array([[0.5 / np.pi]])

    def reflect_orders(self, mu_i: Any, mu_o: Any, pairs: Any, n_order: int, allowed: Any) -> Any:
        orders = np.zeros((1, mu_i.size, mu_o.size, 4, 4))
        orders[..., 0, 0] = 1.0
        return orders, 0


BOUNDARIES: dict[str, Boundary] = {f"{k}: {one.name}": one for k, one in enumerate(THREE)} | {
    kind: base
    for kind, row in BASES.items()
    if not any(isinstance(key, FilePath) for key in row.keys.values())
    and (base := row.make(**{name: key.start for name, key in row.keys.items() if key.needed})) is not None
}


def combine(cosine: np.ndarray, sine: np.ndarray) -> np.ndarray:
    """R^m, (1:35), of integrals of f with cos(m phi) and with sin(m phi)."""
    found = cosine.copy()
    found[..., 2:, :2], found[..., :2, 2:] = sine[..., 2:, :2], -sine[..., :2, 2:]
    return found


@pytest.mark.parametrize("kind", BOUNDARIES)
def test_orders_are_the_integrals_of_the_reflection(kind: str) -> None:
    """By a literal sum over azimuths; half of R^0 is the share of light that comes back, at most 1."""
    base, mu_i, mu_o, n_order = BOUNDARIES[kind], np.array([0.25, 0.8]), np.array([0.4, 0.95]), 4
    orders, _ = base.reflect_orders(mu_i, mu_o, np.ones((2, 2), bool), n_order, lambda size: 1e-9 * (1.0 + size))
    assert len(orders) <= base.orders_reflected
    phi, weight = make_azimuth_rule(np.arange(1, 8192), 8192)
    f = np.zeros((phi.size, 2, 2, 4, 4))
    found = base.reflect(mu_i[:, None], mu_o, np.degrees(phi)[:, None, None])
    f[..., : found.shape[-1], : found.shape[-1]] = found
    for m in range(n_order):
        expected = combine(*(np.einsum("p,pioab->ioab", 2.0 * weight * w(m * phi), f) for w in (np.cos, np.sin)))
        given = orders[m] if m < len(orders) else np.zeros((2, 2, 4, 4))
        assert_close(given, expected, rtol=0.0, atol=2e-7 * max(1.0, np.abs(expected).max()))


def test_below_a_semi_infinite_layer_everything_is_black() -> None:
    assert vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, np.inf)], Lambertian(0.5)).below is BLACK
    assert vrte.Scene(PILE, Lambertian(0.5)).below == Lambertian(0.5)


def test_a_boundary_of_ones_own() -> None:
    """The same bits as the one of the house that does the same, by every method that takes it."""
    for method in METHODS:
        if method != EXACT and find_method(method).base == "none":
            continue
        how: dict[str, Any] = {"method": method}
        how |= {"nodes": 6} if method not in ("diffusion", "monte-carlo", "two-stream") else {}
        stack = [vrte.Layer(vrte.henyey_greenstein(0.3, 8), 0.9, 0.4)]
        found, expected = (
            vrte.brdf(vrte.Scene(stack, base), **DIRECTIONS, **how) for base in (Grey(), Lambertian(0.5))
        )
        assert np.array_equal(found.mueller, expected.mueller), method


@pytest.fixture(scope="module")
def rough_sea(tmp_path_factory: pytest.TempPathFactory) -> Function:
    """The function of the example, without what the example does with it."""
    script = tmp_path_factory.mktemp("sea") / "rough_sea.py"
    script.write_text((EXAMPLES / "rough_sea.py").read_text().split("\nfolder = ")[0])
    return runpy.run_path(str(script))["rough_sea"]


def hapke(mu_i: Any, mu_o: Any, phi_deg: Any) -> np.ndarray:
    """Hapke's regolith with B0 = 1, h = 0.06, w = 0.6 and the phase function 1 + cos/2 (DISORT's problem 6d)."""
    cosine = mu_i * mu_o - np.sqrt((1 - mu_i**2) * (1 - mu_o**2)) * np.cos(np.radians(phi_deg))
    half = np.tan(0.5 * np.arccos(np.clip(cosine, -1.0, 1.0)))
    many = [(1 + 2 * mu) / (1 + 2 * mu * np.sqrt(0.4)) for mu in (mu_i, mu_o)]
    rho = 0.15 / (mu_i + mu_o) * ((1 + 0.06 / (0.06 + half)) * (1 + 0.5 * cosine) + many[0] * many[1] - 1)
    return (rho / np.pi)[..., None, None] * np.diag([1.0, 0.0, 0.0, 0.0])


REGOLITH = vrte.Hapke(0.6, linear=0.5, h_function="1981")


def problem_over(base: Function, nodes: int, mu0: list[float], mu: list[float]) -> tuple[vrte.MuellerBase, Problem]:
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 1.0, 0.2)], vrte.MuellerBase(base))
    assert isinstance(scene.base, vrte.MuellerBase)
    return scene.base, discretise_scene(scene, np.array(mu0), np.eye(4), np.array(mu), np.array([0.0]), nodes)


@pytest.mark.parametrize("base", [vrte.MuellerBase(hapke), REGOLITH], ids=["function", "named"])
def test_disort_problem_6d(base: Boundary) -> None:
    """Stamnes, Tsay, Wiscombe and Laszlo, DISORT report v1.1 (2000): a beam of 200 along mu0 0.5 through an absorbing
    layer of thickness 1 onto a Hapke surface; flux up, and intensity at mu 0.1 and 1, phi 90, tau 0, 0.5, 1.

    Its 16 streams sum 16 Fourier orders. So many of ours are its six digits; all of them are 1e-5 away at mu 0.1.
    """
    scene, tau, phi = vrte.Scene([vrte.Layer(vrte.isotropic(), 0.0, 1.0)], base), [0.0, 0.5, 1.0], 90
    field = vrte.radiance(scene, 0.5, (200, 0, 0, 0), [0.1, 1.0], np.arange(0, 360, 2), tau, nodes=8)
    published = np.array([[6.80068e-5, 3.15441e-1], [1.00931e-2, 5.20074e-1], [1.49795, 8.57458e-1]])
    orders = np.fft.rfft(field.stokes[..., 0], axis=2)
    orders[:, :, 16:] = 0.0
    assert_close(np.fft.irfft(orders, axis=2)[:, :, phi // 2], published, rtol=5e-6, atol=0.0)
    whole = field.stokes[:, :, phi // 2, 0]
    assert (np.abs(whole - published).max(axis=1) <= 1e-5 * whole.max(axis=1)).all()
    assert_close(field.flux_up, [6.70783e-1, 1.39084, 3.31655], rtol=1e-5, atol=0.0)
    assert_close(field.direct, [100.0, 36.7879, 13.5335], rtol=1e-5, atol=0.0)
    assert not field.stokes[..., 1:].any()


def test_the_function_of_the_example_is_the_sea_of_the_house(rough_sea: Function) -> None:
    """Jones vectors in space, and the facets that a published sea is compared with (tests/test_rough.py)."""
    (mu_i, mu_o), phi = np.random.default_rng(4).uniform(0.05, 1.0, (2, 40)), np.linspace(0.0, 350.0, 40)
    expected = vrte.cox_munk(7.0).reflect(mu_i, mu_o, phi)
    assert_close(rough_sea(mu_i, mu_o, phi), expected, rtol=1e-9, atol=1e-12)


def test_the_accuracy_asked_for_is_that_of_the_light(rough_sea: Function) -> None:
    call: dict[str, Any] = {"mu_i": [0.2, 0.9], "mu_o": [0.1, 0.5, 1.0], "phi": [0.0, 70.0, 180.0], "nodes": 12}
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 1.0, 1.0)], vrte.MuellerBase(rough_sea))
    best = vrte.brdf(scene, accuracy=1e-12, **call).mueller
    for accuracy in (1e-2, 1e-5, 1e-8):
        difference = np.abs(vrte.brdf(scene, accuracy=accuracy, **call).mueller - best).max(axis=(1, 2, 3, 4))
        assert (difference <= accuracy * best[..., 0, 0].max(axis=(1, 2))).all()


def cut_sea(mu_i: Any, mu_o: Any, phi_deg: Any, rough_sea: Function, limit: float = 0.9) -> np.ndarray:
    """Steep facets that end where their normal leans further than ``limit``, the cosine of their tilt."""
    between = np.sqrt((1 - mu_i**2) * (1 - mu_o**2)) * np.cos(np.radians(phi_deg)) - mu_i * mu_o
    there = (mu_i + mu_o) / np.sqrt(2 * (1 - between)) > limit
    return np.where(there[..., None, None], rough_sea(mu_i, mu_o, phi_deg, variance=0.3), 0.0)


@pytest.mark.parametrize("accuracy", [1e-4, 1e-8])
def test_facets_that_end_at_a_tilt_have_the_orders_of_both_sides_of_the_jump(
    accuracy: float, rough_sea: Function
) -> None:
    """Against 60 Gauss points on either side of the azimuth where f jumps, which is known in closed form."""
    base, problem = problem_over(lambda i, o, p: cut_sea(i, o, p, rough_sea), 4, [0.35], [0.7])
    found, azimuths = find_reflected_orders(base, problem, 4, accuracy=accuracy)
    assert azimuths < 2500
    scale = np.sqrt(np.append(problem.weights * problem.nodes, 1.0))
    into, out = np.append(problem.nodes, 0.35), np.append(problem.nodes, 0.7)
    x, weight = np.polynomial.legendre.leggauss(60)
    difference, largest = np.zeros((5, 5)), np.zeros((5, 5))
    for i, o in np.ndindex(5, 5):
        if i == o == 4:
            continue  # from the beam straight to the direction asked for: in closed form, not here
        between = 1 - 0.5 * ((into[i] + out[o]) / 0.9) ** 2
        cosine = (between + into[i] * out[o]) / np.sqrt((1 - into[i] ** 2) * (1 - out[o] ** 2))
        t_jump = np.arccos(np.clip(cosine, -1.0, 1.0))
        phi = 0.5 * np.array([t_jump * (1 + x), np.pi + t_jump + (np.pi - t_jump) * x])
        fraction = 0.5 * np.array([t_jump * weight, (np.pi - t_jump) * weight])
        f = cut_sea(into[i], out[o], np.degrees(phi), rough_sea)
        waves = (turn(np.arange(4)[:, None, None] * phi) for turn in (np.cos, np.sin))
        even = combine(*(np.einsum("mqp,qp,qpab->mab", wave, 2 * fraction, f) for wave in waves))
        difference[i, o] = np.abs(found[:, i, o] - even).max() * scale[i] * scale[o]
        largest[i, o] = np.abs(even).max() * scale[i] * scale[o]
    assert difference.max() <= 0.1 * accuracy * largest.max()


@pytest.mark.parametrize("width", [0.1, 0.3])
def test_narrow_lobes_that_a_coarse_rule_sees_are_integrated(width: float) -> None:
    """Lobes of some tenths of a degree at azimuths of their own: pieces lose none that 512 azimuths show."""
    cosine, seen = np.array([0.5]), 0
    for centre in np.linspace(20.0, 160.0, 36):

        def sample(mu_i: np.ndarray, mu_o: np.ndarray, phi_deg: np.ndarray, centre: float = centre) -> np.ndarray:
            return (0.01 + np.exp(-(((phi_deg - centre) / width) ** 2)) + 0.0 * (mu_i + mu_o))[..., None, None]

        rules = [sum_over_azimuths(sample, cosine, cosine, 1, np.arange(1, n), n)[0, 0, 0, 0] for n in (256, 512)]
        if abs(rules[1] - rules[0]) > 1e-7:
            seen += 1
            found, error, _ = sum_pieces(sample, cosine, cosine, 1, np.array([1e-7]))
            expected = 0.02 * np.pi + 2.0 * np.radians(width) * np.sqrt(np.pi)
            assert abs(found[0, 0, 0, 0] - expected) <= 1e-7
            assert error[0] <= 1e-7
    assert seen > 8


def test_what_does_not_converge_is_named_with_the_accuracy_there_is() -> None:
    """Speckles too fine to be integrated: told where they are faint, refused where they are all there is."""

    def speckled(mu_i: Any, mu_o: Any, phi_deg: Any, contrast: float) -> np.ndarray:
        grain = np.sin(1e6 * np.cos(np.radians(phi_deg)) + 0.0 * (mu_i + mu_o)) > 0.0
        return (0.1 * (1.0 + contrast * grain))[..., None, None] * np.eye(4)

    scenes = [
        vrte.Scene(
            [vrte.Layer(vrte.rayleigh(), 1.0, 0.2)],
            vrte.MuellerBase(lambda i, o, p, contrast=contrast: speckled(i, o, p, contrast)),
        )
        for contrast in (0.0, 1e-4, 1.0)
    ]
    plain = vrte.brdf(scenes[0], 0.5, 0.5, 90.0, nodes=2, accuracy=1e-8).mueller
    words = (
        r"do not converge with \d+ azimuths: from mu_i 0\.\d+ to mu_o .* at accuracy 1e-08: what .* accuracy \de-0[5-6]"
    )
    with pytest.warns(vrte.AccuracyWarning, match=words):
        found = vrte.brdf(scenes[1], 0.5, 0.5, 90.0, nodes=2, accuracy=1e-8).mueller
    assert np.abs(found - plain).max() < 2e-4 * plain.max()
    with pytest.raises(vrte.AccuracyError, match=r"is allowed at accuracy 1e-08: ask for a coarser"):
        vrte.brdf(scenes[2], 0.5, 0.5, 90.0, nodes=2, accuracy=1e-8)


def test_what_surfaces_do_is_taken(rough_sea: Function) -> None:
    """A narrow lobe that a coarse quadrature overestimates, a sea without shadows, white paper, a perfect depolarizer
    and retarders: their energy is 1, their coherency matrices singular."""

    def glossy(mu_i: Any, mu_o: Any, phi_deg: Any) -> np.ndarray:
        return rough_sea(mu_i, mu_o, phi_deg, index=2.4, variance=1e-4)

    for function in (glossy, rough_sea, lambda i, o, p: rough_sea(i, o, p, variance=0.3), hapke):
        assert vrte.MuellerBase(function).reflectance([0.3, 1.0], 48).max() < 0.5
    for diagonal in ([1, 0, 0, 0], [1, 1, 1, 1], [1, 1, -1, -1], [1, -1, 1, -1]):
        base = vrte.MuellerBase(lambda i, o, p, diagonal=diagonal: np.diag(diagonal) / np.pi)
        assert_close(base.reflectance([0.01, 0.3, 1.0]), 1.0, rtol=1e-12, atol=0.0)
