"""Published tables, sign by sign. Whole tables stay outside the repository, and their tests are skipped where there are
none; a few values of each are quoted here, with their source, and are compared everywhere."""

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import vrte
from bench import cases
from bench.tables import SIEWERT_DOWN, SIEWERT_UP
from tests import exact

from .helpers import assert_close

Find = Callable[[str], Path]
FLUX_PI = (np.pi, 0.0, 0.0, 0.0)


def rows(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


def phase_matrix(path: Path) -> vrte.PhaseMatrix:
    names = ("a1", "a2", "a3", "a4", "b1", "b2")
    return vrte.PhaseMatrix(*(np.array([float(row[name]) for row in rows(path)]) for name in names))


def at(axis: np.ndarray, values: list[float]) -> np.ndarray:
    return np.array([int(np.argmin(np.abs(axis - value))) for value in values])


@pytest.mark.parametrize("route", ["modes", "scatterings"])
def test_siewert_2000_problem_iia(reference: Find, route: str) -> None:
    """JQSRT 64, 227: spheroids with b2 != 0, seven depths, I, Q, U, V to 1.5 units of the sixth digit; with nothing
    left out, and as the rule goes for an accuracy of 1e-9."""
    table = rows(reference("siewert2000_IIA/table.csv"))
    scene = vrte.Scene([vrte.Layer(phase_matrix(reference("siewert2000_IIA/expansion.csv")), 0.973527, 1.0)])
    mu = np.array([float(row["abs_mu"]) * (1 if row["direction"] == "up" else -1) for row in table])
    tau, phi = (np.array([float(row[name]) for row in table]) for name in ("tau", "phi_deg"))
    value = np.array([float(row["value"]) for row in table])
    accuracy = 1e-15 if route == "modes" else 1e-9
    asked = (np.unique(mu), np.unique(phi), np.unique(tau))
    field = exact.radiance(scene, 0.6, FLUX_PI, *asked, nodes=30, accuracy=accuracy)
    assert route in field.diagnostics["orders_by"]
    index = (at(field.tau, tau), at(field.mu, mu), at(field.phi, phi), ["IQUV".index(row["stokes"]) for row in table])
    error = np.abs(field.stokes[index] - value)
    inside = np.abs(mu) < 1.0
    unit = 10.0 ** (np.floor(np.log10(np.where(value == 0.0, 1e-12, np.abs(value)))) - 5.0)
    assert inside.sum() > 900
    assert (error / unit)[inside].max() <= 1.5
    largest = field.stokes[index[0], index[1], index[2], 0]
    assert (error <= 1e-5 * largest)[~inside].all()


@pytest.mark.parametrize("accuracy", [1e-15, 1e-9])
def test_siewert_2000_quoted(accuracy: float) -> None:
    """Eight values of the same tables, quoted: mu0 0.6, phi 90, mu 0.5 up at tau 0 and mu 0.2 down at tau 1."""
    scene, mu, tau = cases.find_scene("spheroids"), [0.5, -0.2], [0.0, 0.5, 1.0]
    field = exact.radiance(scene, 0.6, FLUX_PI, mu, 90.0, tau, nodes=30, accuracy=accuracy)
    assert_close(field.stokes[0, 0, 0], SIEWERT_UP, rtol=1e-5, atol=0.0)
    assert_close(field.stokes[2, 1, 0], SIEWERT_DOWN, rtol=1e-5, atol=0.0)


@pytest.mark.parametrize(("tau", "nodes"), [("0.1", 40), ("0.5", 32)])
def test_natraj_2009_rayleigh(reference: Find, tau: str, nodes: int) -> None:
    """ApJ 691, 1909: Rayleigh, omega = 1, Lambertian bases; their Q and U have the opposite sign."""
    table = [row for row in rows(reference("natraj2009/rayleigh.csv")) if row["tau"] == tau and float(row["mu"]) >= 0.1]
    worst, compared = 0.0, 0
    for albedo in sorted({row["albedo"] for row in table}):
        base = vrte.Lambertian(float(albedo)) if float(albedo) else None
        scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 1.0, float(tau))], base)
        for mu0 in sorted({row["mu0"] for row in table}):
            part = [row for row in table if row["albedo"] == albedo and row["mu0"] == mu0]
            up = np.array([row["direction"] == "UP" for row in part])
            mu = np.array([float(row["mu"]) for row in part]) * np.where(up, 1, -1)
            phi = np.array([float(row["phi_deg"]) for row in part])
            levels = [0.0, float(tau)]
            field = exact.radiance(scene, float(mu0), FLUX_PI, np.unique(mu), np.unique(phi), levels, nodes=nodes)
            got = field.stokes[np.where(up, 0, 1), at(field.mu, mu), at(field.phi, phi)]
            published = np.array([[float(row["I"]), -float(row["Q"]), -float(row["U"])] for row in part])
            worst, compared = max(worst, np.abs(got[:, :3] - published).max()), compared + len(part)
    assert compared > 3000
    assert worst <= 3e-8


# tau, albedo of the base, mu0, mu (> 0: up at the top, < 0: down at the bottom), phi; I, Q, U
NATRAJ = [
    (0.1, 0.0, 0.2, 0.2, 60.0, [0.08817335, -0.0469887, 0.0331287]),
    (0.1, 0.8, 0.2, 0.92, 120.0, [0.15095038, -0.0099872, -0.01042037]),
    (0.1, 0.0, 0.2, -0.2, 60.0, [0.09014129, -0.05035614, 0.01124861]),
    (0.1, 0.8, 0.2, -0.92, 120.0, [0.02512067, -0.00747098, 0.01491814]),
    (0.5, 0.25, 0.6, 0.2, 60.0, [0.32432947, -0.02925262, 0.17774346]),
    (0.5, 0.8, 0.6, 0.92, 120.0, [0.48656992, -0.03730378, -0.01108562]),
    (0.5, 0.25, 0.6, -0.2, 60.0, [0.30956451, -0.05547303, 0.10899225]),
    (0.5, 0.8, 0.6, -0.92, 120.0, [0.2015747, -0.00864614, 0.06062264]),
]


@pytest.mark.parametrize(("tau", "albedo", "mu0", "mu", "phi", "published"), NATRAJ)
def test_natraj_2009_quoted(
    tau: float, albedo: float, mu0: float, mu: float, phi: float, published: list[float]
) -> None:
    """Natraj, Li and Yung, ApJ 691, 1909: as above."""
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 1.0, tau)], vrte.Lambertian(albedo) if albedo else None)
    found = exact.radiance(scene, mu0, FLUX_PI, mu, phi, 0.0 if mu > 0.0 else tau, nodes=40).stokes[0, 0, 0, :3]
    assert np.abs(found - np.array(published) * [1, -1, -1]).max() <= 3e-8


@pytest.mark.parametrize(("name", "order"), [("mieL8_m0", 0), ("mieL8_m1", 1), ("hazeL_w0.9_mu0_1", 0)])
def test_garcia_siewert_1985(reference: Find, name: str, order: int) -> None:
    """Transp. Theory Stat. Phys. 14, 437: scalar, tau 1, diffuse Fourier terms."""
    haze = name.startswith("haze")
    beta = np.array([float(r["beta_l"]) for r in rows(reference(f"garcia_siewert1985/{name[:5]}_beta.csv"))])
    table = np.genfromtxt(reference(f"garcia_siewert1985/{name}.csv"), delimiter=",", skip_header=1)
    mu = -table[:, 0]
    keep = np.abs(mu) > 0.0
    omega, mu0 = (0.9, 1.0) if haze else (0.95, 0.5)
    # the terms of an azimuthal cosine series, from samples
    phi = np.arange(64) * (360.0 / 64)
    tau = [0.0, 0.05, 0.1, 0.2, 0.5, 0.75, 1.0]
    scene = vrte.Scene([vrte.Layer(vrte.PhaseMatrix(beta), omega, 1.0)])
    field = exact.radiance(scene, mu0, FLUX_PI, mu[keep], phi, tau, nodes=60)
    weight = np.cos(order * np.radians(phi)) * (1 if order == 0 else 2) / 64
    term = (field.stokes[..., 0] @ weight).T
    assert np.abs(term - table[keep, 1:]).max() <= 1e-5


# mu (< 0: up), and the diffuse Fourier term at tau 0, 0.05, 0.1, 0.2, 0.5, 0.75, 1
GARCIA = {
    ("mie", 0): [
        [-1.0, 0.0476807, 0.0441912, 0.0406467, 0.0337099, 0.0158572, 0.00545297, 0.0],
        [-0.1, 0.340126, 0.338476, 0.331984, 0.312888, 0.241217, 0.170697, 0.0],
        [0.5, 0.0, 0.0437182, 0.0832383, 0.149251, 0.261304, 0.288464, 0.280822],
        [1.0, 0.0, 0.0174231, 0.0339716, 0.0643193, 0.134819, 0.173627, 0.197932],
    ],
    ("mie", 1): [
        [-0.5, 0.168911, 0.160192, 0.150609, 0.130818, 0.0748561, 0.0344878, 0.0],
        [-0.1, 0.428566, 0.416266, 0.399406, 0.361374, 0.249443, 0.163513, 0.0],
        [0.1, 0.0, 0.212101, 0.336358, 0.436674, 0.378485, 0.279507, 0.192369],
        [0.5, 0.0, 0.059794, 0.111999, 0.194715, 0.311216, 0.317429, 0.284863],
    ],
    ("haze", 0): [
        [-1.0, 0.0279717, 0.0265834, 0.0251795, 0.0223421, 0.0137519, 0.00670439, 0.0],
        [-0.1, 0.0655296, 0.0700041, 0.0734324, 0.0785904, 0.0844628, 0.073611, 0.0],
        [0.1, 0.0, 0.0224949, 0.0395181, 0.062653, 0.0962543, 0.108718, 0.108189],
        [0.5, 0.0, 0.0102637, 0.0205023, 0.0406492, 0.0964183, 0.135817, 0.167516],
    ],
}
MIE_L8 = [1.0, 2.00916, 1.56339, 0.67407, 0.22215, 0.04725, 0.00671, 0.00068, 0.00005]


@pytest.mark.parametrize(("name", "order"), GARCIA)
def test_garcia_siewert_1985_quoted(name: str, order: int) -> None:
    """Garcia and Siewert, Transp. Theory Stat. Phys. 14, 437: as above; haze L from its size distribution, which ends
    at 10 um here: straight ahead, where that is seen, nothing is quoted."""
    table = np.array(GARCIA[name, order])
    matrix, omega, mu0 = (MIE_L8, 0.95, 0.5) if name == "mie" else (cases.find_phase_matrix("haze-L").a1, 0.9, 1.0)
    phi = np.arange(64) * (360.0 / 64)
    scene = vrte.Scene([vrte.Layer(vrte.PhaseMatrix(matrix), omega, 1.0)])
    field = exact.radiance(scene, mu0, FLUX_PI, -table[:, 0], phi, [0.0, 0.05, 0.1, 0.2, 0.5, 0.75, 1.0], nodes=60)
    term = field.stokes[..., 0] @ (np.cos(order * np.radians(phi)) * (1 if order == 0 else 2) / 64)
    assert np.abs(term.T - table[:, 1:]).max() <= 1e-5


# the reflection matrix's Fourier orders at mu = mu0 = 0.5
MISHCHENKO = [
    [
        [1.054548, -0.005217, 0, 0],
        [-0.005217, 0.262763, 0, 0],
        [0, 0, 0.146687, 0.032284],
        [0, 0, -0.032284, 0.208790],
    ],
    [
        [0.039998, 0.007864, -0.014080, -0.000034],
        [0.007864, 0.045349, 0.035117, -0.019115],
        [0.014080, -0.035117, 0.164078, -0.032249],
        [-0.000034, -0.019115, 0.032249, 0.114666],
    ],
]


@pytest.mark.parametrize("source", [pytest.param("its expansion", marks=pytest.mark.slow), "spheres"])
def test_mishchenko_semi_infinite(source: str, request: pytest.FixtureRequest) -> None:
    """Mishchenko et al., JQSRT 63, 409: endless, omega = 1. The expansion it prints is that of spheres of index 1.44
    with a gamma distribution of 1.05 um and variance 0.07 at 0.55 um (the clouds of Venus), to 3.4e-4."""
    if source == "spheres":
        matrix = vrte.spheres(1.44, size=vrte.Gamma(1.05, 0.07), wavelength_um=0.55).phase_matrix
    else:
        matrix = phase_matrix(request.getfixturevalue("reference")("mishchenko_semi_infinite/expansion.csv"))
    phi = np.arange(256) * (360.0 / 256)
    f = exact.brdf(vrte.Scene([vrte.Layer(matrix, 1.0, np.inf)]), 0.5, 0.5, phi, nodes=48).mueller[0, 0]
    for order, published in enumerate(MISHCHENKO):
        cosine, sine = (turn(order * np.radians(phi)) / 256 for turn in (np.cos, np.sin))
        got, odd = np.tensordot(cosine, f, 1), np.tensordot(sine, f, 1)
        got[2:, :2], got[:2, 2:] = odd[2:, :2], -odd[:2, 2:]
        assert np.abs(np.pi * got - published).max() <= (1e-5 if source == "spheres" else 6e-7)


def test_haze_l_single_scattering(reference: Find) -> None:
    """Peaked phase matrix of 117 terms: single scattering takes all of them whatever the nodes."""
    matrix = phase_matrix(reference("haze_L/expansion.csv"))
    tiny = 1e-7  # at this albedo multiple scattering is below the print precision
    scene = vrte.Scene([vrte.Layer(matrix, tiny, 0.2)])
    for row in rows(reference("haze_L/single_scattering.csv")):
        up = float(row["mu_neg_is_up"]) < 0.0
        mu = -float(row["mu_neg_is_up"])
        field = exact.radiance(scene, 0.6, FLUX_PI, mu, float(row["az_deg"]), 0.0 if up else 0.2, nodes=4)
        got = field.stokes[0, 0, 0, :3] / tiny
        published = np.array([float(row[name]) for name in "IQU"])
        assert np.abs(got - published).max() <= 1.5e-6 * max(1.0, published[0]), row


# mu, phi; I, Q, U, of haze L, tau 0.2, omega 1, mu0 0.6, without the direction straight ahead
HAZE_L = [
    (0.6, 0.0, [1.2874e-2, -1.056e-3, 0.0]),
    (0.6, 90.0, [4.63e-3, 4.16e-4, -7.8e-4]),
    (-0.6, 90.0, [1.5914e-2, 4.9e-4, -9.18e-4]),
    (0.6, 180.0, [7.664e-3, 0.0, 0.0]),
    (-0.6, 180.0, [4.787e-3, -8.75e-4, 0.0]),
]


@pytest.mark.parametrize(("mu", "phi", "published"), HAZE_L)
def test_haze_l_single_scattering_quoted(mu: float, phi: float, published: list[float]) -> None:
    """As above, the phase matrix from Deirmendjian's size distribution (Electromagnetic Scattering, 1969)."""
    tiny = 1e-7
    scene = vrte.Scene([vrte.Layer(cases.find_phase_matrix("haze-L"), tiny, 0.2)])
    field = exact.radiance(scene, 0.6, FLUX_PI, mu, phi, 0.0 if mu > 0.0 else 0.2, nodes=4)
    assert np.abs(field.stokes[0, 0, 0, :3] / tiny - published).max() <= 1.5e-6
