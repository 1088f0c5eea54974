"""Layers of oriented flakes, opaque and clear, solved: against numbers of another program, a literal adding-doubling,
energy, reciprocity, and one way of the solver against another."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

import vrte
from vrte.basics.arrays import Array
from vrte.basics.quadrature import find_gauss_legendre
from vrte.basics.running import start_run
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.orders.phase_assembly import Assembled
from vrte.discrete_ordinates.orders.slab_response import respond_by_doubling

from .helpers import assert_close
from .test_plates import make_pearl

METAL = vrte.flakes(0.3 + 3.0j, tilt_deg=15.0)
ALUMINIUM = vrte.flakes(0.9 + 6.0j, tilt_deg=12.0)
MU, PHI = np.array([0.2, 0.5, 0.9]), np.array([0.0, 40.0, 90.0, 180.0])
Q, FLIP = np.diag([1.0, 1.0, 1.0, -1.0]), np.diag([1.0, 1.0, -1.0, -1.0])
WHITE = vrte.Lambertian(1.0)

# handbook: flux out per flux in at 50 degrees, in bins of mu_o (rows) and |phi| (columns); 3e-4 of the largest
BINS, TURNS = [0.0, 0.35, 0.6, 0.8, 1.0], [0.0, 45.0, 135.0, 180.0]
BARE = (
    [[0.06322, 0.00660, 0.00105], [0.10806, 0.01783, 0.00237], [0.10953, 0.03284, 0.00423],
     [0.09264, 0.06488, 0.01417]],
    [[-0.00499, -0.00035, -0.00010], [-0.00685, -0.00045, -0.00016], [-0.00511, -0.00015, -0.00015],
     [-0.00274, 0.00062, -0.00022]],
)  # fmt: skip
UNDER = (
    [[0.01333, 0.00958, 0.00186], [0.03331, 0.02657, 0.00555], [0.03868, 0.03675, 0.00890],
     [0.04169, 0.05435, 0.01813]],
    [[0.00242, 0.00149, 0.00037], [0.00285, 0.00156, 0.00059], [0.00151, 0.00039, 0.00054],
     [0.00084, -0.00072, 0.00062]],
)  # fmt: skip


def spread(edges: list[float], count: int = 16) -> tuple[Array, Array]:
    """Gauss points in each interval, and their weights."""
    x, weights = find_gauss_legendre(count)
    low, size = np.array(edges[:-1])[:, None], np.diff(edges)[:, None]
    return (low + 0.5 * (x + 1.0) * size).ravel(), (0.5 * weights * size).ravel()


@pytest.mark.parametrize(("index", "right"), [(1.0, BARE), (1.5, UNDER)])
def test_bins_are_those_of_another_program(index: float, right: Any) -> None:
    (mu, share), (phi, turn) = spread(BINS), spread(TURNS)
    layer = vrte.Layer.of(replace(METAL, host_index=index), flake_area=2.0)
    scene = vrte.Scene([layer] if index == 1.0 else [vrte.Interface(1.0, index), layer])
    found = vrte.brdf(scene, np.cos(np.radians(50.0)), mu, phi, nodes=12).mueller[0]
    flux = 2.0 * (share * mu)[:, None] * np.radians(turn)
    for stokes, expected in enumerate(right):
        bins = (flux * found[..., stokes, 0]).reshape(4, 16, 3, 16).sum(axis=(1, 3))
        assert_close(bins, expected, rtol=0.0, atol=3e-4 * np.max(right[0]))


STACKS: dict[str, Any] = {
    "metal": vrte.Scene([vrte.Layer.of(METAL, flake_area=2.0)], vrte.Lambertian(0.4)),
    "beside particles": vrte.Scene(
        [
            vrte.Layer(vrte.henyey_greenstein(0.5, 32), 0.9, 1.5, None, ALUMINIUM, 2.0),
            vrte.Layer.of(METAL, flake_area=0.7),
        ]
    ),
    "under a surface": vrte.Scene(
        [
            vrte.Interface(1.0, 1.5),
            vrte.Layer.clear(10.0, 1.5, 0.55),
            vrte.Layer(vrte.rayleigh(), 0.99, 0.5, None, replace(ALUMINIUM, host_index=1.5), 1.5),
        ],
        vrte.Lambertian(0.6),
    ),
    "under a rough surface": vrte.Scene(
        [vrte.Interface(1.0, 1.5, roughness=0.2), vrte.Layer.of(replace(METAL, host_index=1.5), flake_area=2.0)]
    ),
    "semi-infinite": vrte.Scene([vrte.Layer.of(ALUMINIUM, flake_area=np.inf)]),
    "plates": vrte.Scene([vrte.Layer.of(make_pearl(), flake_area=2.0)], vrte.Lambertian(0.4)),
    "plates beside particles": vrte.Scene(
        [
            vrte.Layer(vrte.henyey_greenstein(0.5, 16), 0.9, 1.5, None, make_pearl(film=2.5 + 0.05j), 2.0),
            vrte.Layer.of(METAL, flake_area=0.7),
        ]
    ),
    "plates under a surface": vrte.Scene(
        [vrte.Interface(1.0, 1.5), vrte.Layer.of(make_pearl(1.5), flake_area=3.0)], vrte.Lambertian(0.6)
    ),
    "plates under a rough surface": vrte.Scene(
        [vrte.Interface(1.0, 1.5, roughness=0.2), vrte.Layer(vrte.rayleigh(), 0.99, 0.5, None, make_pearl(1.5), 1.5)]
    ),
    "semi-infinite plates": vrte.Scene([vrte.Layer.of(make_pearl(), flake_area=np.inf)]),
}


@pytest.mark.parametrize("name", STACKS)
def test_modes_and_doubling_agree_and_light_is_reciprocal(name: str) -> None:
    """What the weight of directions off the nodes changes in modes of plates is 2e-7 and less."""
    asked: dict[str, Any] = {"nodes": 8, "truncation": "none"}
    modes, doubling = (vrte.brdf(STACKS[name], MU, MU, PHI, algorithm=each, **asked) for each in ("modes", "doubling"))
    rounding, largest = 1e-6 if "plates" in name else 1e-12, np.abs(doubling.mueller).max()
    assert_close(modes.mueller, doubling.mueller, rtol=0.0, atol=rounding * largest)
    assert_close(doubling.mueller, Q @ doubling.mueller.transpose(1, 0, 2, 4, 3) @ Q, rtol=0.0, atol=1e-12 * largest)
    verified = vrte.brdf(STACKS[name], MU[:1], MU[:1], 0.0, verify=True, **asked).diagnostics["agreement"]
    assert verified["radiance"] < 10.0 * rounding


MIRRORS = {
    "thin": [vrte.Layer.of(vrte.flakes(tilt_deg=8.0), flake_area=0.1)],
    "thick": [vrte.Layer.of(vrte.flakes(tilt_deg=15.0), flake_area=1e4)],
    "beside particles": [vrte.Layer(vrte.rayleigh(), 1.0, 1.5, None, vrte.flakes(tilt_deg=12.0), 2.0)],
    "over particles": [
        vrte.Layer.of(vrte.flakes(tilt_deg=12.0), flake_area=1.0), vrte.Layer(vrte.henyey_greenstein(0.8, 64), 1.0, 3.0)
    ],
    "under a surface": [
        vrte.Interface(1.0, 1.5), vrte.Layer.of(vrte.flakes(tilt_deg=5.0, host_index=1.5), flake_area=3.0)
    ],
    "plates": [
        vrte.Layer(vrte.rayleigh(), 1.0, 0.5, None, make_pearl(), 2.0),
        vrte.Layer.of(make_pearl(tilt=20.0), flake_area=1.0),
    ],
    "plates under a surface": [
        vrte.Interface(1.0, 1.5), vrte.Layer(vrte.rayleigh(), 1.0, 0.5, None, make_pearl(1.5), 2.0),
        vrte.Layer.of(make_pearl(1.5, tilt=20.0), flake_area=1.0),
    ],
}  # fmt: skip


@pytest.mark.parametrize("algorithm", ["modes", "doubling"])
@pytest.mark.parametrize("name", MIRRORS)
def test_mirrors_and_clear_plates_over_white_lose_nothing(name: str, algorithm: str) -> None:
    found = vrte.brdf(vrte.Scene(MIRRORS[name], WHITE), MU, MU, 0.0, nodes=8, algorithm=algorithm)
    mirrored = 0.0 if found.specular is None else found.specular[:, 0, 0]
    assert_close(found.reflectance + mirrored, 1.0, rtol=0.0, atol=1e-13)


def test_flux_is_lost_to_flakes_that_absorb_alone() -> None:
    """Between depths: what is absorbed is what Kirchhoff's plain integral over the field says; a note tells no loss."""
    scene = STACKS["beside particles"]
    field = vrte.radiance(scene, 0.6, mu=[0.5], tau=[0.0, 1.0, 3.5, 4.2], nodes=12)
    net = field.flux_down + field.direct - field.flux_up
    assert (np.diff(net) < 0.0).all()
    assert not any("energy" in note for note in field.diagnostics["notes"])


@cache
def add_and_double(nodes: int, n_order: int) -> tuple[Array, Array]:
    """A literal adding-doubling of METAL, area 2, from `Flakes.scatter` alone: nodes, and R of each order, (order, N,
    4, N, 4), of radiance from radiance over weight mu. Azimuths by plain sums, the first layer by single scattering."""
    x, weights = find_gauss_legendre(nodes)
    mu, weights = 0.5 * (x + 1.0), 0.5 * weights
    phi = (np.arange(360) + 0.5) * (2.0 * np.pi / 360)
    ways = [METAL.scatter(sign * mu[:, None, None], -mu[:, None], phi) for sign in (1.0, -1.0)]
    even = np.kron(np.eye(2), np.ones((2, 2)))
    odd = np.zeros((4, 4))
    odd[2:, :2], odd[:2, 2:] = 1.0, -1.0
    steep, share, one = np.repeat(mu, 4), np.repeat(weights, 4), np.eye(4 * nodes)
    depth, found = 2.0 * 2.0**-40, []
    for m in range(n_order):
        reflected, passed = (
            sum(np.einsum("p,ijpab->ijab", wave(m * phi), z) * part for wave, part in ((np.cos, even), (np.sin, odd)))
            for z in ways
        )
        reflected, passed = (
            depth * 2.0 * np.pi / phi.size / steep[:, None] * z.transpose(0, 2, 1, 3).reshape(4 * nodes, -1) * share
            for z in (FLIP @ reflected, passed)
        )
        passed = passed + np.diag(1.0 - depth * np.repeat(METAL.project(mu), 4) / steep)
        for _ in range(40):
            between = np.linalg.inv(one - reflected @ reflected)
            reflected, passed = reflected + passed @ reflected @ between @ passed, passed @ between @ passed
        found.append((reflected / (share * steep)).reshape(nodes, 4, nodes, 4))
    return mu, np.array(found)


def test_a_literal_adding_doubling_has_the_same_light() -> None:
    """Orders 0 to 2, I and Q, on Gauss nodes whose plain sums miss the kink of Z straight on: by 1e-3 on 16 of them, a
    quarter of what 8 miss."""
    phi, errors = np.arange(64) * 360.0 / 64, []
    scene = vrte.Scene([vrte.Layer.of(METAL, flake_area=2.0)])
    for nodes in (8, 16):
        mu, right = add_and_double(nodes, 3)
        some = [nodes // 3, nodes // 2, nodes - 2]
        found = vrte.brdf(scene, mu[some], mu[some], phi, nodes=12).mueller[..., :2, :2]
        expected = right[np.ix_(range(3), some, [0, 1], some, [0, 1])] / (2.0 * np.pi)
        orders = np.einsum("mp,iopab->moaib", np.cos(np.outer(np.arange(3), np.radians(phi))) / 64.0, found)
        errors.append(np.abs(orders - expected).max() / np.abs(expected).max())
    assert errors[1] < 2e-3
    assert errors[1] < 0.4 * errors[0]


def test_a_tinted_coat_without_a_surface_attenuates_as_beer_has_it() -> None:
    coat, basecoat = vrte.Layer(vrte.isotropic(), 0.0, 0.3), vrte.Layer.of(METAL, flake_area=5.0)
    bare, coated = (vrte.brdf(vrte.Scene(layers), MU, MU, PHI, nodes=12) for layers in ([basecoat], [coat, basecoat]))
    slant = np.exp(-0.3 * (1.0 / MU[:, None] + 1.0 / MU))[:, :, None, None, None]
    assert_close(coated.mueller, bare.mueller * slant, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize(("name", "rounding"), [("beside particles", 1e-14), ("plates beside particles", 1e-9)])
def test_light_from_below_is_that_of_the_scene_upside_down(name: str, rounding: float) -> None:
    scene = STACKS[name]
    asked: dict[str, Any] = {"nodes": 8, "transmission": True, "truncation": "none"}
    down, up = (vrte.brdf(scene, MU, MU, PHI, illuminate=side, **asked) for side in ("top", "bottom"))
    turned = vrte.brdf(vrte.Scene(scene.layers[::-1]), MU, MU, PHI, **asked)
    assert_close(up.mueller, FLIP @ turned.mueller @ FLIP, rtol=0.0, atol=1e-13 * np.abs(up.mueller).max())
    back = Q @ up.transmission.transpose(1, 0, 2, 4, 3) @ Q
    assert_close(down.transmission, back, rtol=0.0, atol=1e-12 * np.abs(back).max())
    K = 1.5 * np.eye(4) + 2.0 * scene.layers[0].flakes.extinguish(MU) + 0.7 * METAL.extinguish(MU)
    expected = [expm(-each / mu)[0, 0] for each, mu in zip(K, MU, strict=True)]
    assert_close(down.direct_transmittance, expected, rtol=rounding, atol=0.0)


@pytest.mark.parametrize("algorithm", ["modes", "doubling"])
@pytest.mark.parametrize(("flakes", "rounding"), [(METAL, 1e-13), (make_pearl(), 1e-6)])
def test_fields_inside_follow_from_the_parts_of_a_layer(flakes: vrte.Flakes, rounding: float, algorithm: str) -> None:
    """A layer cut in two is the same layer; beams between the parts are those of a matrix exponential."""
    depths, base = [0.0, 0.5, 2.0], vrte.Mirror(1.5)
    asked: dict[str, Any] = {
        "mu": [0.7, 0.2, -0.2, -0.7],
        "phi": PHI,
        "tau": depths,
        "nodes": 8,
        "algorithm": algorithm,
    }
    cuts = ([vrte.Layer.of(flakes, flake_area=each) for each in areas] for areas in ([2.0], [0.5, 1.5]))
    one, other = (vrte.radiance(vrte.Scene(layers, base), 0.6, **asked) for layers in cuts)
    for name in ("stokes", "flux_up", "flux_down", "direct", "direct_up"):
        found, right = getattr(one, name), getattr(other, name)
        assert_close(found, right, rtol=0.0, atol=(rounding if algorithm == "modes" else 1e-13) * np.abs(right).max())
    K = flakes.extinguish(0.6) / 0.6
    assert_close(np.ravel(one.direct), [0.6 * expm(-depth * K)[0, 0] for depth in depths], rtol=1e-9, atol=0.0)


@pytest.mark.parametrize("way", ["modes", "doubling"])
def test_extinction_and_scattering_times_c_are_a_layer_c_times_as_thick(
    way: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Flakes that attenuate by k = c along all directions and scatter like particles: no flake is needed to see that
    mu/k stands wherever light is attenuated."""
    from vrte.discrete_ordinates.orders import slab_response

    c = 1.7
    scene = vrte.Scene([vrte.Interface(1.0, 1.3), vrte.Layer(vrte.rayleigh(0.03), 0.95, 1.0)])
    problem = discretise_scene(scene, np.array([0.4]), np.eye(4), MU, np.zeros(1), 6)
    inside = replace(problem, mu0=np.array([0.7]), n_up=3)
    orders, material, run = np.arange(3, dtype=np.int32), np.zeros(1, np.int32), start_run(1)
    plain = slab_response.assemble(inside, orders, run)
    scaled = Assembled(c * plain.E, c * plain.F, plain.G_E, plain.G_F, c * plain.source_s, c * plain.source_d)
    monkeypatch.setattr(slab_response, "assemble", lambda *_: scaled)
    slants = {
        "slant_nodes": inside.nodes[None] / c, "slant_in": inside.mu0[None] / c, "slant_out": inside.mu_out[None] / c
    }  # fmt: skip
    of_flakes = replace(inside)
    vars(of_flakes)["slants"] = slants | {"oriented": np.ones(1, np.int32)}
    asked = material, np.array([0.6 / c]), orders, run
    found = slab_response.respond(way, of_flakes, *asked, quick=False)
    monkeypatch.undo()
    right = slab_response.respond(way, inside, material, np.array([0.6]), orders, run, quick=False)
    if way == "modes":
        found, right = found.expand(), right.expand()
    for name in ("nodes", "entering", "leaving", "passing"):
        one, other = getattr(found, name), getattr(right, name)
        assert_close(one, other, rtol=0.0, atol=1e-14 * np.abs(other).max(), err_msg=name)
    assert respond_by_doubling(inside, material, np.array([0.6]), orders, run).nodes.shape == found.nodes.shape


PROMISED = [(30.0, 1.0, 1e-4), (12.0, 1.5, 1e-4), (5.0, 1.0, 1e-4)]
MORE = [(tilt, index, accuracy) for tilt in (3.0, 5.0, 12.0, 30.0) for index in (1.0, 1.5) for accuracy in (1e-4, 1e-6)]


@pytest.mark.parametrize(
    ("tilt", "index", "accuracy"), [*PROMISED, *(pytest.param(*each, marks=pytest.mark.slow) for each in MORE)]
)
def test_the_promised_accuracy_holds(tilt: float, index: float, accuracy: float) -> None:
    """Against half as many nodes more, and orders until a thousandth of the accuracy is left."""
    layer = vrte.Layer.of(vrte.flakes(0.9 + 6.0j, tilt_deg=tilt, host_index=index), flake_area=3.0)
    scene = vrte.Scene([layer] if index == 1.0 else [vrte.Interface(1.0, index), layer], vrte.Lambertian(0.5))
    asked = [0.5, 0.85], np.array([0.4, 0.6, 0.95]), PHI
    found = vrte.brdf(scene, *asked, accuracy=accuracy)
    right = vrte.brdf(scene, *asked, nodes=3 * found.diagnostics["nodes"] // 2, accuracy=1e-3 * accuracy)
    assert found.diagnostics["promised"]
    error = np.abs(found.mueller - right.mueller).max(axis=(1, 2, 3, 4)) / np.abs(right.mueller).max(axis=(1, 2, 3, 4))
    assert error.max() < accuracy


def test_derivatives_with_what_lies_beside_flakes_are_differences_of_solves() -> None:
    scene = STACKS["metal"]
    found = vrte.brdf(scene, 0.5, MU, PHI, nodes=8, derivatives=["base.albedo"])
    sides = [
        vrte.brdf(vrte.Scene(scene.layers, vrte.Lambertian(0.4 + step)), 0.5, MU, PHI, nodes=8).mueller
        for step in (1e-4, -1e-4)
    ]
    right = (sides[0] - sides[1]) / 2e-4
    assert_close(found.jacobian["base.albedo"], right, rtol=0.0, atol=1e-6 * np.abs(right).max())


@pytest.mark.parametrize(("key", "tolerance"), [("flake_area", 1e-6), ("tilt_deg", 5e-6)])
def test_derivatives_with_numbers_of_flakes_are_differences_of_solves(key: str, tolerance: float) -> None:
    """Steps of a tilt are a thousandth of it, between which integrals differ in their last digits: 2e-6 is left."""
    scene, step = STACKS["metal"], 2e-4
    found = vrte.brdf(scene, 0.5, MU, PHI, nodes=8, derivatives=[f"layer[1].{key}"]).jacobian[f"layer[1].{key}"]

    def solve(more: float) -> Array:
        tilt, area = (15.0 + more, 2.0) if key == "tilt_deg" else (15.0, 2.0 + more)
        layer = vrte.Layer.of(vrte.flakes(0.3 + 3.0j, tilt_deg=tilt), flake_area=area)
        return vrte.brdf(vrte.Scene([layer], scene.base), 0.5, MU, PHI, nodes=8).mueller

    right = (solve(step) - solve(-step)) / (2.0 * step)
    assert_close(found, right, rtol=0.0, atol=tolerance * np.abs(right).max())


@pytest.mark.parametrize(("name", "words"), [
    ("layer[2].flake_area", "there is no such layer"),
    ("layer[1].tilt_deg", "it has no flakes"),
])  # fmt: skip
def test_derivatives_without_flakes_are_refused(name: str, words: str) -> None:
    with pytest.raises(vrte.SceneError, match=words):
        vrte.brdf(vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)]), 0.5, 0.5, derivatives=[name])


def test_many_scenes_with_flakes_are_each_as_alone() -> None:
    scenes = [STACKS["metal"], vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)]), STACKS["under a surface"]]
    together = vrte.brdfs(scenes, MU, MU, PHI, nodes=6)
    for scene, found in zip(scenes, together, strict=True):
        np.testing.assert_array_equal(found.mueller, vrte.brdf(scene, MU, MU, PHI, nodes=6).mueller)


def test_flux_that_flakes_scatter_is_that_of_a_plain_sum() -> None:
    """Over tilts and azimuths of Jones vectors: of I and of Q."""
    tilt, psi = np.linspace(0.0, 0.5 * np.pi, 2001)[1::2], (np.arange(720) + 0.5) * (np.pi / 720)
    share = METAL.find_density(tilt) * np.sin(tilt) * (np.pi / 2000) * (2.0 * np.pi / 720)
    for mu in (0.05, 0.6):
        sine = np.sqrt(1.0 - mu * mu)
        h = np.stack([np.outer(np.sin(tilt), np.cos(psi)), np.outer(np.sin(tilt), np.sin(psi))])
        upright = np.cos(tilt)[:, None]
        c = sine * h[0] + mu * upright
        r_p, r_s = (np.abs(each) ** 2 for each in METAL.reflect(np.abs(c)))
        along = mu * h[0] - sine * upright  # along theta-hat, and h[1] across
        cosine = (along**2 - h[1] ** 2) / (along**2 + h[1] ** 2)
        right = [share @ (np.abs(c) * part).sum(axis=1) for part in (0.5 * (r_p + r_s), 0.5 * (r_p - r_s) * cosine)]
        assert_close(METAL.scatter_flux([mu])[0], right, rtol=0.0, atol=3e-6)


@pytest.mark.usefixtures("opencl")
def test_a_device_assembles_and_adds_up_light_of_flakes() -> None:
    scene = STACKS["beside particles"]
    one, other = (vrte.brdf(scene, MU, MU, PHI, nodes=6, backend=each).mueller for each in ("openmp", "opencl"))
    assert_close(one, other, rtol=0.0, atol=1e-12 * np.abs(one).max())
