"""Each method against its own equations, written down anew, and what its settings promise."""

import itertools

import numpy as np
import pytest
import scipy.linalg
import scipy.special

import vrte
from vrte.basics.errors import AccuracyError
from vrte.basics.quadrature import find_gauss_legendre
from vrte.methods.parts.slab import find_gauss_depths, solve_riccati, weigh_downward, weigh_upward
from vrte.methods.slabs import propagator
from vrte.methods.two_fluxes import BOUNDARIES

from .helpers import assert_close
from .literal import a_matrix, azimuthal_sum
from .samples import spheroids

MU, PHI, MU0 = np.array([0.05, 0.3, 1.0]), np.array([0.0, 40.0, 180.0]), 0.6
RAYLEIGH, ISOTROPIC = vrte.rayleigh(), vrte.isotropic()
MATRIX = vrte.PhaseMatrix(  # all six differ from zero
    [1.0, 1.2, 0.9, 0.2], [0.0, 0.0, 2.4, 0.5], [0.0, 0.0, 1.9, 0.4], [0.6, 1.3, 0.7, 0.2], [0.0, 0.0, 0.3, 0.05],
    [0.0, 0.0, 0.2, 0.1],
)  # fmt: skip


def one_layer(phase: vrte.PhaseMatrix, albedo: float, thickness: float, base: object = None) -> vrte.Scene:
    return vrte.Scene([vrte.Layer(phase, albedo, thickness)], base)


def off(found: vrte.Field, right: vrte.Field) -> float:
    """The largest difference at each depth over the largest I there."""
    difference = np.abs(found.stokes - right.stokes).max(axis=(1, 2, 3))
    return float((difference / np.abs(right.stokes[..., 0]).max(axis=(1, 2))).max())


# adding and doubling


@pytest.mark.parametrize("start", [0, 1, 2, 3])
def test_order_of_the_starting_layer(start: int) -> None:
    scene, asked = one_layer(RAYLEIGH, 0.99, 1.0), {"mu_i": MU, "mu_o": MU, "phi": PHI, "nodes": 6}
    right, errors = vrte.brdf(scene, accuracy=1e-13, **asked).mueller, []
    for thin in (0.125, 0.0625) if start < 2 else (0.25, 0.125):
        found = vrte.brdf(scene, method="adding-doubling", settings={"thin": thin, "start": start}, **asked)
        errors.append(np.abs(found.mueller - right).max())
    assert abs(np.log2(errors[0] / errors[1]) - max(1, 2 * start)) < 0.25


@pytest.mark.parametrize("thickness", [0.1, 1e3, 1e8, np.inf])
def test_white_layers_lose_nothing(thickness: float) -> None:
    """Flux to rounding, and R as good as where something is absorbed, whatever the starting layer left out."""
    scene = one_layer(RAYLEIGH, 1.0, thickness)
    asked = {"mu_i": [0.02, 0.5, 1.0], "mu_o": [0.1, 0.9], "nodes": 20}
    found, right = vrte.brdf(scene, **asked, method="adding-doubling"), vrte.brdf(scene, **asked, accuracy=1e-13)
    assert_close(found.mueller, right.mueller, rtol=0.0, atol=1e-11 * right.mueller.max())
    if np.isinf(thickness):
        assert_close(found.reflectance, 1.0, rtol=0.0, atol=2e-15)
        return
    tau = thickness * np.array([0.0, 0.3, 1.0])
    net = vrte.radiance(scene, 0.5, mu=[], tau=tau, nodes=20, method="adding-doubling")
    rest = net.flux_down + net.direct - net.flux_up
    assert_close(rest, rest[-1], rtol=0.0, atol=2e-15)


# the matrix operator


def test_propagator_is_the_exponential_of_the_layer_matrix() -> None:
    """(2:7), in the public frame: the flux-scaled, flipped form of the solver is not used here."""
    nodes, thin = 6, vrte.Scene([vrte.Layer(spheroids(), 0.9, 0.1), vrte.Layer(RAYLEIGH, 0.7, 0.05)])
    found = propagator(thin, order=1, nodes=nodes).reshape(8 * nodes, 8 * nodes)
    points, weights = (each / 2 for each in np.polynomial.legendre.leggauss(nodes))
    downward = np.concatenate([-points - 0.5, points + 0.5])  # cosines, light going up first
    expected = np.eye(8 * nodes)
    for layer in thin.layers:
        table = layer.phase_matrix.coefficients[: 2 * nodes]
        A = vrte._core.phase_matrices(1, table, downward, downward).transpose(0, 2, 1, 3).reshape(8 * nodes, -1)
        scattered = layer.albedo / 2 * A * np.repeat(np.tile(weights, 2), 4)
        slope = (scattered - np.eye(8 * nodes)) / np.repeat(downward, 4)[:, None]
        expected = scipy.linalg.expm(layer.thickness * slope) @ expected
    assert_close(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    with pytest.raises(AccuracyError, match=r"condition number of T_minus is .* R and T of \(2:8\)"):
        propagator(one_layer(RAYLEIGH, 0.9, 5.0), nodes=nodes)


# invariant imbedding


@pytest.mark.parametrize("rtol", [1e-4, 1e-7, 1e-10])
def test_a_slab_to_what_was_asked_for(rtol: float) -> None:
    """The largest error of the radiance reflected and transmitted, relative to the largest I reflected."""
    scene = one_layer(RAYLEIGH, 0.99, 2.0)
    asked = {"mu_i": MU, "mu_o": MU, "phi": PHI, "nodes": 4, "transmission": True}
    right = vrte.brdf(scene, accuracy=1e-13, **asked)
    found = vrte.brdf(scene, method="invariant-imbedding", settings={"rtol": rtol}, **asked)
    cosine = MU[:, None, None, None, None]
    assert np.abs(cosine * (found.mueller - right.mueller)).max() < 10.0 * rtol * (cosine * right.mueller).max()
    assert np.abs(cosine * (found.transmission - right.transmission)).max() < 10.0 * rtol


def test_a_low_cosine_takes_some_steps_more_not_steps_as_small_as_itself() -> None:
    how, scene = {"nodes": 6, "method": "invariant-imbedding"}, one_layer(ISOTROPIC, 0.9, 1.0)
    steps = [vrte.brdf(scene, low, low, **how).diagnostics["steps"] for low in (1e-1, 1e-6)]
    assert steps[1] < steps[0] + 50


def test_steps_whose_sweeps_do_not_converge_are_repeated() -> None:
    """Long steps into a thick white layer: shorter ones take their place."""
    scene, asked = one_layer(ISOTROPIC, 1.0, 4.0), {"mu_i": 0.5, "mu_o": [0.3, 0.9], "nodes": 4}
    found, right = vrte.brdf(scene, method="invariant-imbedding", **asked), vrte.brdf(scene, accuracy=1e-13, **asked)
    assert found.diagnostics["steps_repeated"] > 0
    assert_close(found.mueller, right.mueller, rtol=0.0, atol=1e-7 * right.mueller.max())


@pytest.mark.parametrize("b", [0.3, 0.5, 0.7, 1.0, 4.0])
def test_structure_preserving_doubling_of_numbers(b: float) -> None:
    """x^2 c - x (a + d) + b = 0, the smaller root."""
    found, _ = solve_riccati(*(np.array([[value]]) for value in (3.0, b, 0.5, 2.0)))
    assert_close(found[0, 0], 2.0 * b / (5.0 + np.sqrt(25.0 - 2.0 * b)), rtol=2e-15, atol=0.0)


@pytest.mark.parametrize("method", ["adding-doubling", "matrix-operator"])
def test_slabs_that_no_system_joins_are_refused(method: str) -> None:
    """Light between a white layer of thickness 1e12 and a white base hardly finds a way out."""
    with pytest.raises(AccuracyError, match=r"residual of adding is .*ask for 'discrete-ordinates'"):
        vrte.brdf(one_layer(RAYLEIGH, 1.0, 1e12, vrte.Lambertian(1.0)), 0.5, 0.5, nodes=4, method=method)


# successive orders

PAIR = vrte.Scene(
    [vrte.Layer(RAYLEIGH, 0.9, 0.5), vrte.Layer(vrte.henyey_greenstein(0.4, 6), 0.95, 0.7)], vrte.Lambertian(0.3)
)


def by_orders(scene: vrte.Scene, **settings: float) -> vrte.Brdf:
    return vrte.brdf(scene, MU, MU, PHI, nodes=4, method="successive-orders", settings=settings)


@pytest.mark.parametrize("power", [1, 3])
@pytest.mark.parametrize("z", [0.0, 1e-9, 0.05, 0.3, 7.9, 8.1, 50.0, 1e9])
def test_integrals_in_depth(z: float, power: int) -> None:
    """Against the closed form for S = s^p, a confluent hypergeometric function."""
    weights, s = weigh_downward(np.array(z), 4), find_gauss_depths(4)
    x = np.append(s, 1.0)
    right = x ** (power + 1) / (power + 1) * scipy.special.hyp1f1(1.0, power + 2.0, -z * x)
    assert_close(weights @ s**power, right, rtol=1e-12, atol=0.0)
    assert_close(weigh_upward(np.array(z), 4)[-1] @ (1.0 - s) ** power, right[-1], rtol=1e-12, atol=0.0)


def test_tolerance_and_order_in_depth() -> None:
    """Twice the panels: the error falls towards 2^-8, and faster than 2^-5 from the start. Levels by themselves leave
    about 1e-8, in thin and thick layers, conservative ones too."""
    right = vrte.brdf(PAIR, MU, MU, PHI, nodes=4, accuracy=1e-13).mueller
    for tolerance, left in ((1e-3, 2e-3), (1e-6, 2e-6), (1e-9, 2e-9), (1e-12, 1e-11)):  # 120 depths leave more
        found = by_orders(PAIR, tolerance=tolerance, levels=120)
        assert np.abs(found.mueller - right).max() <= left * np.abs(right).max()
        assert found.diagnostics["converged"]
        assert found.diagnostics["remainder"] <= tolerance
    scene = one_layer(RAYLEIGH, 0.9, 1.0)
    right = vrte.brdf(scene, MU, MU, PHI, nodes=4, accuracy=1e-13).mueller
    errors = [np.abs(by_orders(scene, tolerance=1e-14, levels=n).mueller - right).max() for n in (24, 48)]
    assert errors[1] < errors[0] / 32.0
    for albedo, thickness in ((0.9, 1e-3), (1.0, 3.0), (0.8, 30.0)):
        scene, asked = one_layer(ISOTROPIC, albedo, thickness), {"mu_i": MU[1:], "mu_o": MU[1:], "nodes": 8}
        right = vrte.brdf(scene, accuracy=1e-13, **asked).mueller
        found = vrte.brdf(scene, **asked, method="successive-orders", settings={"tolerance": 1e-10}).mueller
        assert_close(found, right, rtol=0.0, atol=5e-8 * right.max())


def test_orders_count_scatterings_whatever_is_reflected() -> None:
    """One order is single scattering; the s-th is albedo^s times that of albedo 1, also between glass and a mirror."""
    once = vrte.brdf(PAIR, MU, MU, PHI, nodes=4, method="single-scattering")
    np.testing.assert_array_equal(by_orders(PAIR, orders=1).mueller, once.mueller)
    for above, base in (([], None), ([vrte.Interface(1.0, 1.5)], vrte.Mirror((0.05, 3.0)))):
        by_albedo = []
        for albedo in (1.0, 0.5):
            scene = vrte.Scene([*above, vrte.Layer(RAYLEIGH, albedo, 1.0)], base)
            one, two, three = (by_orders(scene, orders=s, tolerance=1e-15).mueller for s in (1, 2, 3))
            by_albedo.append(np.stack([one / albedo, (two - one) / albedo**2, (three - two) / albedo**3]))
        assert_close(*by_albedo, rtol=0.0, atol=1e-14 * max(1.0, by_albedo[0].max()))
        assert (np.abs(by_albedo[0]).max(axis=(1, 2, 3, 4, 5)) > 1e-2).all()


def test_it_says_that_it_did_not_converge() -> None:
    reported = by_orders(one_layer(ISOTROPIC, 1.0, 10.0), orders=20).diagnostics  # few orders on purpose: no warning
    assert reported["scattering_orders"] == 20
    assert not reported["converged"]
    assert not reported["promised"]
    assert any("energy is not conserved" in note for note in reported["notes"])
    converged = by_orders(PAIR).diagnostics
    assert converged["converged"]
    assert not any("energy" in note for note in converged["notes"])


@pytest.mark.slow
def test_the_cap_of_orders_that_nobody_asked_for_is_a_warning() -> None:
    with pytest.warns(vrte.AccuracyWarning, match=r"1000 orders of scattering leave out about .* its setting 'orders'"):
        found = by_orders(one_layer(ISOTROPIC, 1.0, 100.0))
    assert found.reflectance[0] < 0.99
    assert not found.diagnostics["promised"]


# two-stream

HG = vrte.henyey_greenstein(0.6, 40)
STREAMS = {
    "isotropic": [(ISOTROPIC, 0.9, 1.0)],
    "thin": [(HG, 0.9, 1e-6)],
    "dark": [(HG, 0.3, 30.0)],
    "conservative": [(HG, 1.0, 5.0)],
    "thick": [(HG, 1.0, 1e3)],
    "stack": [(HG, 0.95, 0.2), (ISOTROPIC, 0.5, 1.0), (ISOTROPIC, 0.0, 0.3), (HG, 1.0, 3.0)],
    "backward": [(vrte.henyey_greenstein(-0.3, 30), 0.8, 2.0)],
    "semi-infinite": [(HG, 0.95, 0.5), (HG, 0.8, np.inf)],
    "semi-infinite and conservative": [(HG, 1.0, np.inf)],
}


@pytest.mark.parametrize("name", STREAMS)
def test_two_streams_are_one_node(name: str) -> None:
    """Radiance in all directions and fluxes, relative to the largest I at each depth: 1e-12 or better."""
    base = vrte.Lambertian(0.4) if np.isfinite(STREAMS[name][-1][2]) else None
    scene = vrte.Scene([vrte.Layer(*layer) for layer in STREAMS[name]], base)
    deepest = scene.thickness if np.isfinite(scene.thickness) else 20.0
    mu = [1e-3, 0.5, 0.8, 1.0, -1e-3, -0.3, -0.5, -1.0]
    for mu0, truncation in itertools.product((1.0, 0.5, 0.02), ("none", "delta-m", "auto")):
        asked = {"mu0": mu0, "mu": mu, "phi": PHI, "tau": deepest * np.array([0.0, 0.3, 1.0]), "truncation": truncation}
        right = vrte.radiance(scene, nodes=1, accuracy=1e-15, **asked)  # which says whether light near the beam matters
        found = vrte.radiance(scene, nodes=1, method="two-stream", **asked)
        assert off(found, right) <= 1e-12
        for some, other in ((found.flux_up, right.flux_up), (found.flux_down, right.flux_down)):
            assert_close(some, other, rtol=0.0, atol=1e-12 * right.flux_up.max())


# diffusion

G = 0.3
DIFFUSING = vrte.PhaseMatrix([1.0, 3.0 * G])


def diffuse(scene: vrte.Scene, tau: object, **settings: object) -> vrte.Field:
    return vrte.radiance(scene, MU0, mu=[], tau=tau, method="diffusion", settings=settings)


@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize("albedo", [0.3, 0.9, 1.0 - 1e-9, 1.0])
def test_fluxes_obey_their_equations(boundary: str, albedo: float) -> None:
    """(2:19) by the matrix exponential: E_0, E_z and the beam e with E_0' = -3 (1 - w g) E_z + 3 w g mu0 e and E_z' =
    -(1 - w) E_0 + w e; E_0 + c E_z = 0 at the top, and the base sends back its part of all flux."""
    c, tau = BOUNDARIES[boundary], np.linspace(0.0, 2.0, 6)
    slopes = [[0.0, -3.0 * (1.0 - albedo * G), 3.0 * albedo * G * MU0], [albedo - 1.0, 0.0, albedo], [0, 0, -1.0 / MU0]]
    passed = [scipy.linalg.expm(t * np.array(slopes)) for t in tau]
    up, down = (0.5 * np.array([1.0 / c, sign, 0.0]) for sign in (-1.0, 1.0))
    for base in (0.0, 0.1):
        at_base = (up - base * (down + np.array([0.0, 0.0, MU0]))) @ passed[-1]
        E_z = -at_base[2] / (at_base[:2] @ [-c, 1.0])  # at the top
        right = passed @ np.array([-c * E_z, E_z, 1.0])
        field = diffuse(one_layer(DIFFUSING, albedo, 2.0, vrte.Lambertian(base)), tau, boundary=boundary)
        assert_close(field.flux_up, right @ up, rtol=1e-12, atol=1e-13)
        assert_close(field.flux_down, right @ down, rtol=1e-12, atol=1e-13)


def test_diffuse_light_decays_in_a_clear_layer() -> None:
    """As in one that hardly scatters, e^(-sqrt(3) t), whatever no scattering would otherwise leave out."""
    one, other = (
        diffuse(vrte.Scene([vrte.Layer(DIFFUSING, 0.9, 0.5), vrte.Layer(DIFFUSING, albedo, 1.0)]), [0.5, 1.0])
        for albedo in (0.0, 1e-14)
    )
    assert one.flux_down.min() > 0.01
    assert_close(one.flux_down, other.flux_down, rtol=1e-12, atol=0.0)


def test_radiance_is_its_source_integrated() -> None:
    """At the top, against quadrature over E_0 and E_z, found from fluxes at many depths."""
    albedo, h, mu, phi = 0.8, 1.5, np.array([0.3, 1.0]), np.array([0.0, 60.0])
    scene = one_layer(DIFFUSING, albedo, h)
    x, w = np.polynomial.legendre.leggauss(24)
    t, w = 0.5 * h * (x + 1.0), 0.5 * h * w
    inside = diffuse(scene, t)
    E_0, E_z = 2.0 * (inside.flux_down + inside.flux_up), inside.flux_down - inside.flux_up
    E_x = albedo * G * np.sqrt(1.0 - MU0**2) / (1.0 - albedo * G) * np.exp(-t / MU0)
    across = np.sqrt(1.0 - mu**2)[:, None, None] * np.cos(np.radians(phi))[:, None] * E_x
    source = albedo / (4.0 * np.pi) * (E_0 + 3.0 * G * (-mu[:, None, None] * E_z + across))
    expected = np.einsum("upt,t,ut->up", source, w, np.exp(-t / mu[:, None]) / mu[:, None])
    once, found = (
        vrte.radiance(scene, MU0, mu=mu, phi=phi, method=name).stokes for name in ("single-scattering", "diffusion")
    )
    assert_close((found - once)[0, ..., 0], expected, rtol=1e-10, atol=0.0)


@pytest.mark.parametrize("boundary", BOUNDARIES)
def test_radiance_over_a_base_is_what_the_base_sends_out(boundary: str) -> None:
    """At the base, going up: its albedo times all flux down over pi, whatever the boundary."""
    scene = one_layer(DIFFUSING, 0.9, 1.5, vrte.Lambertian(0.4))
    asked = {"mu": [0.2, 1.0], "phi": 30.0, "tau": 1.5, "method": "diffusion", "settings": {"boundary": boundary}}
    field = vrte.radiance(scene, MU0, **asked)
    expected = 0.4 / np.pi * (field.flux_down + field.direct)
    assert_close(field.stokes[0, :, 0, 0], expected * np.ones(2), rtol=1e-12, atol=0.0)


# small angles

PEAKED = vrte.henyey_greenstein(0.5, 16)


@pytest.mark.parametrize(
    "layers",
    [[(PEAKED, 0.9, 2.0)], [(PEAKED, 1.0, 40.0)], [(MATRIX, 0.95, 2.0)], [(MATRIX, 0.9, 0.5), (MATRIX, 0.8, 1.0)]],
)
def test_small_angles_are_the_sum_over_orders(layers: list[tuple[vrte.PhaseMatrix, float, float]]) -> None:
    """(2:29) literally: Fourier orders of generalized spherical functions, S_l through the matrix exponential."""
    scene, mu = vrte.Scene([vrte.Layer(*layer) for layer in layers]), np.array([0.2, 0.7, 0.95])
    a = layers[0][0].coefficients
    path = sum(layer[2] for layer in layers) / MU0
    albedo = sum(layer[1] * layer[2] for layer in layers) / MU0  # times the path
    degrees = np.zeros_like(a)
    for l, (a1, a2, a3, a4, b1, b2) in enumerate(a):
        S = albedo / (2.0 * l + 1.0) * np.array([[a1, b1, 0, 0], [b1, a2, 0, 0], [0, 0, a3, b2], [0, 0, -b2, a4]])
        E = (2.0 * l + 1.0) * np.exp(-path) * (scipy.linalg.expm(S) - np.eye(4))
        degrees[l] = E[0, 0], E[1, 1], E[2, 2], E[3, 3], E[0, 1], E[2, 3]
    orders = [a_matrix(m, degrees, mu, np.array([MU0])).reshape(mu.size, 4, 1, 4)[:, :, 0] for m in range(len(a))]
    expected = azimuthal_sum([each[None] for each in orders], PHI)[0] / (4.0 * np.pi)  # (mu, phi, 4, 4)
    found = vrte.brdf(scene, MU0, mu, PHI, transmission=True, method="small-angle", nodes=8)
    assert_close(MU0 * found.transmission[0], expected, rtol=0.0, atol=1e-13 * np.abs(expected).max())
    assert not found.mueller.any()


def test_small_angles_flux_and_note() -> None:
    """The flux down is that of the radiance; up there is nothing, and it says so; at the beam's own direction, as in
    figure 2 of the paper, light is within 2 % where tau is 0.3."""
    x, w = find_gauss_legendre(40)
    mu, w, phi = 0.5 * (x + 1.0), 0.5 * w, np.arange(0.0, 360.0, 10.0)
    scene = one_layer(PEAKED, 0.9, 2.0)
    field = vrte.radiance(scene, MU0, mu=-mu, phi=phi, tau=[0.5, 2.0], method="small-angle")
    flux = 2.0 * np.pi * np.einsum("tup,u->t", field.stokes[..., 0], w * mu) / phi.size
    assert_close(field.flux_down, flux, rtol=1e-12, atol=0.0)
    assert not field.flux_up.any()
    up = vrte.radiance(scene, MU0, mu=0.5, method="small-angle")
    assert not up.stokes.any()
    assert up.diagnostics["notes"] == ["small-angle: nothing goes up; radiance there is zero by definition"]
    near, asked = one_layer(vrte.henyey_greenstein(0.9, 120), 0.99, 0.3), {"mu0": 0.5, "mu": -0.5, "tau": 0.3}
    right = vrte.radiance(near, nodes=24, **asked).stokes[..., 0]
    assert_close(vrte.radiance(near, method="small-angle", **asked).stokes[..., 0], right, rtol=0.02, atol=0.0)


# synthetic iteration

SHARP = vrte.henyey_greenstein(0.8, 60)
SCENES = {
    "scalar": one_layer(SHARP, 0.95, 2.0),
    "stack": vrte.Scene([vrte.Layer(SHARP, 0.9, 0.5), vrte.Layer(ISOTROPIC, 0.7, 1.0)], vrte.Lambertian(0.4)),
    "vector": vrte.Scene([vrte.Layer(MATRIX, 0.9, 0.4), vrte.Layer(RAYLEIGH, 0.8, 0.5)], vrte.Lambertian(0.3)),
}
AROUND = {"mu0": MU0, "mu": [0.3, 0.9, -0.3, -0.9], "phi": [0.0, 50.0, 180.0]}


def iterate(scene: vrte.Scene, asked: dict[str, object], **settings: object) -> vrte.Field:
    return vrte.radiance(scene, method="synthetic-iteration", settings=settings, **asked)


@pytest.mark.parametrize(
    ("name", "regular"),
    [
        ("scalar", "two-stream"),
        ("stack", "discrete-ordinates"),
        ("vector", "diffusion"),
        ("vector", "single-scattering"),
    ],
)
def test_iterations_converge_to_discrete_ordinates(name: str, regular: str) -> None:
    """On the same nodes, whatever the guess: what is left is of the 8th order in the panels of depths."""
    scene = SCENES[name]
    asked = AROUND | {"tau": [0.0, 0.7, scene.thickness], "nodes": 4}
    asked["stokes"] = [1.0, 0.0, 0.0, 0.0] if name != "vector" else [1.0, 0.2, -0.5, 0.3]
    right = vrte.radiance(scene, truncation="small-angle", accuracy=1e-13, **asked)
    coarse, finer = (off(iterate(scene, asked, iterations=60, regular=regular, depths=n), right) for n in (16, 32))
    assert finer < 1e-7
    assert finer < coarse / 32.0


@pytest.mark.parametrize("slope", [0.9, -0.9])
def test_one_iteration_knows_where_light_goes(slope: float) -> None:
    """Of scattering forward or back, by the net flux of the exact method: radiance to 11 % of the brightest."""
    scene = one_layer(vrte.PhaseMatrix(a1=[1.0, slope]), 0.9, 0.5, vrte.Lambertian(0.4))
    asked = AROUND | {"tau": [0.0, 0.5], "nodes": 8}
    assert off(iterate(scene, asked, regular="discrete-ordinates"), vrte.radiance(scene, **asked)) < 0.11


@pytest.mark.parametrize(("place", "within"), [(2, 0.15), (3, 0.3)])
def test_two_iterations_know_the_signs_of_polarization(place: int, within: float) -> None:
    """U or V comes in: what goes up of it beyond light scattered once, to a share of its largest."""
    asked = {"mu": [0.3, 0.9], "phi": [0.0, 50.0, 180.0], "stokes": np.eye(4)[0] + 0.9 * np.eye(4)[place]}
    scene = one_layer(MATRIX, 0.9, 0.5)
    once = vrte.radiance(scene, MU0, method="single-scattering", **asked).stokes
    right = vrte.radiance(scene, MU0, truncation="small-angle", nodes=16, **asked).stokes
    how = {"method": "synthetic-iteration", "settings": {"regular": "discrete-ordinates", "iterations": 2}}
    found = vrte.radiance(scene, MU0, nodes=16, **asked, **how).stokes
    assert np.abs(found - right)[..., 2].max() < within * np.abs(right - once)[..., 2].max()


@pytest.mark.parametrize("regular", ["two-stream", "diffusion"])
def test_one_iteration(regular: str) -> None:
    """Below a thin peaked layer, where the peak is: within 3 % of the brightest, where the regular part alone is far
    off; and of an even phase function, without order 1, the closed form is the regular part's own."""
    asked = AROUND | {"mu": [-0.3, -0.55, -0.6, -0.7, -1.0], "tau": 0.3}
    scene = one_layer(vrte.henyey_greenstein(0.97, 400), 0.99, 0.3)
    right = vrte.radiance(scene, nodes=20, truncation="small-angle", **asked)
    found, alone = (
        iterate(scene, asked, regular=regular),
        vrte.radiance(scene, method=regular, truncation="delta-m", **asked),
    )
    assert off(found, right) < 0.03
    assert off(alone, right) > 0.3
    assert off(found, vrte.radiance(scene, method=regular, truncation="small-angle", **asked)) < 1e-14  # it is the same
    asked = AROUND | {"tau": [0.0, 0.7, 2.0], "nodes": 8}
    scene = one_layer(ISOTROPIC, 0.9, 2.0, vrte.Lambertian(0.4))
    assert off(iterate(scene, asked, regular=regular), vrte.radiance(scene, method=regular, **asked)) < 1e-14
    assert off(iterate(scene, asked, regular="discrete-ordinates"), vrte.radiance(scene, **asked)) < 0.1


@pytest.mark.parametrize("name", ["two-stream", "diffusion", "discrete-ordinates"])
def test_fluxes_are_those_of_the_regular_part(name: str) -> None:
    asked = {"mu0": MU0, "mu": [], "tau": [0.0, 1.0, 2.0], "nodes": 8}
    found = iterate(SCENES["scalar"], asked, regular=name)
    regular = vrte.radiance(SCENES["scalar"], method=name, truncation="delta-m", **asked)
    assert_close(found.flux_up, regular.flux_up, rtol=1e-12, atol=0.0)
    assert_close(found.flux_down, regular.flux_down, rtol=1e-12, atol=1e-13)
