"""A stack solved at once, and in two parts: the result of the lower one is the base of the upper one."""

import warnings
from typing import Any

import numpy as np
import pytest

import vrte
from tests.samples import largest_gap, spheroids
from vrte.basics.splines import make_cosines
from vrte.calls import solve_base

from .helpers import assert_close

WHERE: dict[str, Any] = {"mu_i": [0.15, 0.6, 1.0], "mu_o": [0.1, 0.3, 0.95], "phi": [0.0, 70.0, 180.0]}
AZIMUTHS = np.linspace(0.0, 180.0, 15)  # the phase matrix has 12 terms
SURFACE = vrte.Interface(1.0, 1.5)


def of_spheroids(thickness: float = 1.0, albedo: float = 0.97, **more: Any) -> vrte.Layer:
    """Siewert's: b2 != 0, so that U and V mix."""
    return vrte.Layer(spheroids(), albedo, thickness, **more)


def solve_on(scene: vrte.Scene, cosines: int, nodes: int) -> vrte.Brdf:
    mu = make_cosines(cosines)
    return vrte.brdf(scene, mu, mu, AZIMUTHS, nodes=nodes)


def over(upper: Any, base: Any, nodes: int, **more: Any) -> vrte.Brdf:
    return vrte.brdf(vrte.Scene(upper, base), **WHERE, nodes=nodes, **more)


def test_a_stack_at_once_is_its_upper_layer_on_the_result_of_its_lower_one() -> None:
    """All 16 elements, over a Lambertian ground; the error falls with the grid of the lower result."""
    ground, upper, lower = vrte.Lambertian(0.3), [of_spheroids(0.4)], [of_spheroids(2.0, 0.9)]
    whole = over([*upper, *lower], ground, 12)
    assert np.abs(whole.mueller[..., 3, 2]).max() > 1e-4 * whole.mueller.max()
    differences = []
    for cosines in (6, 16):
        below = solve_on(vrte.Scene(lower, ground), cosines, 12)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", vrte.CoarseTableWarning)
            found = over(upper, below, 12)
        differences.append(largest_gap(found.mueller, whole.mueller))
    assert differences[0] < 1e-3
    assert differences[1] < 2e-6
    assert_close(found.reflectance, whole.reflectance, rtol=1e-6, atol=0.0)


@pytest.mark.parametrize("algorithm", ["modes", pytest.param("doubling", marks=pytest.mark.slow)])
def test_a_result_under_a_smooth_surface_mirrors_beams(algorithm: str) -> None:
    """Its mirrored beam comes back as a beam, and diffuse light is mirrored on every node; the whole stack has other
    nodes than its parts."""
    upper, lower = [of_spheroids(0.4)], [SURFACE, of_spheroids(2.0, 0.9)]
    whole, below = over([*upper, *lower], None, 16), solve_on(vrte.Scene(lower), 16, 16)
    found = over(upper, below, 16, algorithm=algorithm)
    assert whole.specular[..., 0, 0].max() > 0.01
    assert_close(found.specular, whole.specular, rtol=0.0, atol=1e-8)
    assert largest_gap(found.mueller, whole.mueller) < 3e-6
    assert_close(found.reflectance, whole.reflectance, rtol=0.0, atol=2e-6)


@pytest.mark.parametrize("surface", [[], pytest.param([SURFACE], marks=pytest.mark.slow)], ids=["bare", "surface"])
def test_what_absorbs_nothing_gives_all_back(surface: list[Any]) -> None:
    """Conservative layers on the result of conservative layers over white ground, and over the like under a surface."""
    below = solve_on(vrte.Scene([*surface, of_spheroids(1.0, 1.0)], vrte.Lambertian(1.0)), 16, 12)
    found = over([of_spheroids(0.5, 1.0)], below, 12)
    assert_close(found.total_reflectance, 1.0, rtol=0.0, atol=1e-5)
    assert_close(below.as_base().reflectance([0.3, 0.7, 1.0]), 1.0, rtol=0.0, atol=1e-5)


def test_a_result_lies_in_the_medium_that_it_was_found_in() -> None:
    """In air above its surface, in a binder without one: another is refused, and one that nobody names is its own."""
    in_air = solve_on(vrte.Scene([SURFACE, of_spheroids()]), 12, 6)
    in_binder = solve_on(vrte.Scene([of_spheroids(host_index=1.5)]), 12, 6)
    assert (in_air.diagnostics["index_outside"], in_binder.diagnostics["index_outside"]) == (1.0, 1.5)
    words = r"the base has the refractive index 1, and the medium above it, .* between, has 1\.5"
    with pytest.raises(vrte.SceneError, match=words):
        vrte.Scene([SURFACE], in_air)
    with pytest.raises(vrte.SceneError, match=r"the base has the refractive index 1, and layer 1, .* has 1\.33"):
        vrte.Scene([of_spheroids(host_index=1.33)], in_air)
    assert vrte.Scene([of_spheroids()], in_binder).media == (1.5, 1.5, 1.5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("layers", "parts", "ground", "nodes", "bound"),
    [
        ([of_spheroids(0.4), SURFACE, of_spheroids(2.0, 0.9)], (1,), 0.0, 48, 1e-8),  # nodes and grid together
        ([of_spheroids(0.3), vrte.Layer(vrte.rayleigh(), 0.99, 0.5), of_spheroids(1.0, 0.8)], (2, 1), 0.2, 16, 3e-5),
        ([SURFACE, of_spheroids(0.4), of_spheroids(host_index=1.5)], (2,), 0.0, 24, 2e-5),  # in a binder
    ],
)
def test_parts_one_after_another_lead_to_the_whole(
    layers: list[Any], parts: tuple[int, ...], ground: float, nodes: int, bound: float
) -> None:
    whole = over(layers, vrte.Lambertian(ground), nodes)
    base: Any = vrte.Lambertian(ground)
    for first in parts:
        base = solve_on(vrte.Scene(layers[first:], base), 24, nodes)
        layers = layers[:first]
    assert largest_gap(over(layers, base, nodes).mueller, whole.mueller) < bound


def test_results_that_are_no_base_are_refused() -> None:
    scene, mu = vrte.Scene([of_spheroids()]), make_cosines(6)
    from_below = vrte.brdf(scene, mu, mu, [0, 90, 180], nodes=4, illuminate="bottom")
    few = vrte.brdf(scene, 0.5, mu, [0, 90, 180], nodes=4)
    for base, words in (
        (from_below, "base: a BRDF that is lit from the bottom is no base"),
        (few, "base: mu_i must be at least two different cosines"),
        (3, r"vrte\.TabulatedBase or a vrte\.Brdf, not 3"),
    ):
        with pytest.raises(vrte.SceneError, match=words):
            vrte.Scene([of_spheroids()], base)  # type: ignore[arg-type]
    for given, words in (({"mu_i": 0.5}, "mu_i is not asked for"), ({"accuracy": 1.0}, "accuracy")):
        with pytest.raises(vrte.SceneError, match=words):
            vrte.solve_base(scene, **given)


def test_a_base_is_solved_to_the_accuracy_asked_for() -> None:
    """As many cosines as it takes; how far it is off is measured at directions of the test's own."""
    scene = vrte.Scene([of_spheroids(2.0, 0.9)], vrte.Lambertian(0.3))
    dice = np.random.default_rng(7)
    mu, phi = np.sort(dice.uniform(0.1, 1.0, 5)), dice.uniform(0.0, 360.0, 4)
    exact = vrte.brdf(scene, mu, mu, phi, nodes=6).mueller
    sizes = []
    for accuracy in (1e-2, 1e-4):
        base = vrte.solve_base(scene, accuracy, nodes=6)
        sizes.append(base.mu_i.size)
        assert largest_gap(base.reflect(mu[:, None, None], mu[:, None], phi), exact) < 2 * accuracy
    assert sizes[0] < sizes[1]


def test_a_base_that_stays_off_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(solve_base, "COSINES", (6, 8))
    scene = vrte.Scene([of_spheroids(2.0, 0.9)])
    with pytest.warns(vrte.AccuracyWarning, match=r"the base is off by \S+ between its 8 cosines and \d+ azimuths"):
        vrte.solve_base(scene, 1e-7, nodes=6)


@pytest.mark.slow
def test_narrow_lobes_take_more_azimuths() -> None:
    """A rough surface has more orders than the particles below it."""
    rough = vrte.Interface(1.0, 1.5, roughness=0.4, shadowing=True)
    base = vrte.solve_base(vrte.Scene([rough, vrte.Layer(vrte.isotropic(), 0.9, 1.0)]), 1e-2, nodes=8)
    assert base.phi_deg.size > solve_base.FEWEST_AZIMUTHS
