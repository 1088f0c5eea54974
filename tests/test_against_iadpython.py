"""Beside iadpython (Prahl's adding-doubling, scalar): light that a slab sends back and lets through.

UR1 and UT1 are shares of a beam along the normal, URU and UTU of an even sky's light, with all that surfaces mirror.
iadpython averages the two polarizations at each surface, vrte carries them from one surface to the next: the numbers
agree where no light meets two surfaces without a particle between, and differ elsewhere by what is pinned here.
"""

import iadpython
import numpy as np
import pytest
from iadpython import combine, start
from scipy.special import roots_jacobi

import vrte

from .helpers import assert_close, close_to

POINTS = 32
MATCHED = [(0.9, 2.0, 0.75), (1.0, 5.0, 0.5), (0.95, 2.0, 0.0), (0.5, 0.2, 0.0), (0.999, 64.0, 0.5)]
SLABS = [  # albedo, thickness, g, index; how far iadpython's own shares are from vrte's at most
    (0.5, 0.2, 0.0, 1.5, 4.426e-3),
    (1.0, 4.0, 0.0, 1.4, 4.362e-6),
    (1.0, 1.0, 0.5, 1.4, 7.606e-4),
    *(
        pytest.param(*row, marks=pytest.mark.slow)
        for row in ((0.9, 1.0, 0.5, 1.5, 1.290e-3), (1.0, 0.2, 0.5, 1.5, 4.535e-3), (1.0, 30.0, 0.5, 1.5, 0.0))
    ),
]


def find_ours(a: float, b: float, g: float, n: float = 1.0) -> np.ndarray:
    """UR1, UT1, URU, UTU by vrte."""
    layer = vrte.Layer(vrte.henyey_greenstein(g, terms=128) if g else vrte.isotropic(), a, b)
    below = [vrte.Interface(n, 1.0)] if np.isfinite(b) else []
    scene = vrte.Scene([layer] if n == 1.0 else [vrte.Interface(1.0, n), layer, *below])
    mu, weights = vrte.hemisphere(40)
    mu, sky = np.append(mu, 1.0), np.append(2.0 * weights * mu, 0.0)
    back, through = vrte.brdf(scene, mu, 1.0, nodes=POINTS).total_reflectance, np.zeros_like(mu)
    if np.isfinite(b):
        field = vrte.radiance(scene, mu, mu=0.5, tau=b, nodes=POINTS, **({"side": "below"} if n > 1.0 else {}))
        through = (field.flux_down + field.direct)[:, 0] / mu
    return np.array([back[-1], through[-1], sky @ back, sky @ through])


def make_sample(a: float, b: float, g: float, n: float = 1.0) -> iadpython.Sample:
    """A slab of iadpython's on nodes that know the critical angle, the last one along the normal.

    Its own are Gauss's and Radau's in the cosine, which see reflectance's square-root edge there as N^-3. These are
    Radau's in the cosine of air, and Gauss's in the angle t beneath, mu = mu_c sin t, where all is reflected.
    """
    sample = iadpython.Sample(a=a, b=b, g=g, n=n, quad_pts=POINTS)
    beneath = POINTS // 2 if n > 1.0 else 0
    count = POINTS - beneath
    x, w = roots_jacobi(count - 1, 1.0, 0.0)  # Radau's inner nodes on [-1, 1], the weights times 1 - x
    air, weights = np.append((1.0 + x) / 2.0, 1.0), np.append(w / (1.0 - x) / 2.0, 1.0 / count**2)
    sample.nu, sample.twonuw = np.sqrt(1.0 - (1.0 - air**2) / n**2), 2.0 * air * weights / n**2
    if beneath:
        x, w = np.polynomial.legendre.leggauss(beneath)
        t, edge = np.pi / 4.0 * (1.0 + x), np.sqrt(1.0 - 1.0 / n**2)
        sample.nu = np.append(edge * np.sin(t), sample.nu)
        sample.twonuw = np.append(edge**2 * np.sin(2.0 * t) * w * np.pi / 4.0, sample.twonuw)
    return sample


def double_slab(sample: iadpython.Sample) -> tuple[np.ndarray, np.ndarray]:
    """R and T of a slab without surfaces, from iadpython's diamond of 1/64 of the thickness it would begin with."""
    halvings = max(0, int(np.ceil(np.log2(sample.b_delta_M() / sample.nu.min())))) + 6
    sample.b_thinnest = sample.b_delta_M() / 2**halvings
    return combine.double_until(sample, *start.diamond(sample), sample.b_thinnest, sample.b_delta_M())


def keep_polarization(sample: iadpython.Sample, r: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """R and T with surfaces on both sides that reflect the two polarizations, p and s, each by its own share.

    Scattered light is unpolarized; what goes straight through keeps its polarization. Flux u leaves the slab upward,
    e downward: u = R (in + F u) + T F e, e = T (in + F u) + R F e, in = 1 - F of what falls on the surface.
    """
    mu, n, flux = sample.nu, sample.n, sample.twonuw
    air = np.sqrt((1.0 - n**2 * (1.0 - mu**2)).astype(complex))
    mirrored = np.append(abs((mu - n * air) / (mu + n * air)) ** 2, abs((n * mu - air) / (n * mu + air)) ** 2)
    straight, even = np.exp(-sample.b_delta_M() / mu), np.full((2, 2), 0.5)
    sent_back = np.kron(even, flux[:, None] * r)
    let_on = np.kron(even, flux[:, None] * t - np.diag(straight)) + np.diag(np.tile(straight, 2))
    slab = np.block([[sent_back, let_on], [let_on, sent_back]])
    light = np.linalg.solve(np.eye(len(slab)) - slab * np.tile(mirrored, 2), slab[:, : 2 * len(mu)] * (1.0 - mirrored))
    up, down = np.split((1.0 - np.tile(mirrored, 2))[:, None] * light, 2)
    of_both = [
        part.reshape(2, len(mu), 2, len(mu)).sum(0).mean(1) / flux[:, None] for part in (up + np.diag(mirrored), down)
    ]
    return of_both[0], of_both[1]


@pytest.mark.parametrize(("a", "b", "g"), MATCHED)
def test_without_surfaces_the_codes_agree(a: float, b: float, g: float) -> None:
    sample = make_sample(a, b, g)
    theirs = sample.UX1_and_UXU(*double_slab(sample))
    assert_close(find_ours(a, b, g), theirs, rtol=0.0, atol=5e-8 if g == 0.75 else 5e-9)  # of delta-M


@pytest.mark.parametrize(("a", "b", "g", "n", "apart"), SLABS)
def test_between_two_surfaces_polarization_is_the_whole_difference(
    a: float, b: float, g: float, n: float, apart: float
) -> None:
    """iadpython's slab under surfaces that keep the polarizations apart gives vrte's numbers; its own surfaces, which
    average them, give others: up to 0.0045 apart where an even sky falls on a thin slab, nothing where it is thick."""
    ours, sample = find_ours(a, b, g, n), make_sample(a, b, g, n)
    slab = double_slab(sample)
    assert_close(sample.UX1_and_UXU(*keep_polarization(sample, *slab)), ours, rtol=0.0, atol=1e-8)
    averaged = sample.UX1_and_UXU(*combine.add_same_slides(sample, *start.boundary_layer(sample, top=True), *slab))
    assert abs(np.array(averaged) - ours).max() == close_to(apart, rtol=3e-4, atol=1e-9)


@pytest.mark.parametrize("n", [1.0, 1.4, 1.5])
def test_semi_infinite_light_meets_one_surface(n: float) -> None:
    sample = make_sample(0.99, 2000.0, 0.5, n)
    r, t = double_slab(sample)
    if n > 1.0:
        r, _, t, _ = combine.add_slide_above(sample, *start.boundary_layer(sample, top=True), r, r, t, t)
    assert_close(find_ours(0.99, np.inf, 0.5, n), sample.UX1_and_UXU(r, t), rtol=0.0, atol=1e-8)


def test_published_numbers() -> None:
    """Both as Wang, Jacques and Zheng quote them (Comput. Methods Programs Biomed. 47, 131, 1995, Tables 1 and 2)."""
    ur1, ut1, _, _ = find_ours(0.9, 2.0, 0.75)  # van de Hulst (1980)
    assert (round(ur1, 5), round(ut1, 5)) == (0.09739, 0.66096)
    assert find_ours(0.9, np.inf, 0.0, 1.5)[0] == close_to(
        0.2600, rtol=0.0, atol=1e-4
    )  # Giovanelli (1955); we: 0.25992
