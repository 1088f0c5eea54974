"""Published tables, sign by sign: values quoted here, and whole tables where they lie beside the repository."""

import csv
from collections.abc import Callable
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from bench import cases
from bench.tables import SIEWERT_DOWN, SIEWERT_UP
from tests import exact

Find = Callable[[str], Path]
FLUX_PI = (np.pi, 0.0, 0.0, 0.0)
EITHER = pytest.mark.parametrize("source", ["quoted", "whole"])


def rows(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


def phase_matrix(path: Path) -> vrte.PhaseMatrix:
    names = ("a1", "a2", "a3", "a4", "b1", "b2")
    return vrte.PhaseMatrix(*(np.array([float(row[name]) for row in rows(path)]) for name in names))


def at(axis: np.ndarray, values: Any) -> np.ndarray:
    return np.array([int(np.argmin(np.abs(axis - value))) for value in values])


@EITHER
@pytest.mark.parametrize(("accuracy", "route"), [(1e-15, "modes"), (1e-9, "scatterings")])
def test_siewert_2000_problem_iia(source: str, accuracy: float, route: str, reference: Find) -> None:
    """JQSRT 64, 227: spheroids with b2 != 0, seven depths, I, Q, U, V to 1.5 units of the sixth digit; with nothing
    left out, and as the rule goes for an accuracy of 1e-9."""
    if source == "quoted":
        matrix = cases.find_phase_matrix("spheroids")
        pairs = ((0.0, 0.5, SIEWERT_UP), (1.0, -0.2, SIEWERT_DOWN))
        table = [(tau, mu, 90.0, k, value) for tau, mu, light in pairs for k, value in enumerate(light)]
    else:
        matrix = phase_matrix(reference("siewert2000_IIA/expansion.csv"))
        table = [
            (
                float(row["tau"]),
                float(row["abs_mu"]) * (1 if row["direction"] == "up" else -1),
                float(row["phi_deg"]),
                "IQUV".index(row["stokes"]),
                float(row["value"]),
            )
            for row in rows(reference("siewert2000_IIA/table.csv"))
        ]
        assert len(table) > 900
    tau, mu, phi, stokes, value = (np.array(column) for column in zip(*table, strict=True))
    asked = (np.unique(mu), np.unique(phi), np.unique(tau))
    scene = vrte.Scene([vrte.Layer(matrix, 0.973527, 1.0)])
    field = exact.radiance(scene, 0.6, FLUX_PI, *asked, nodes=30, accuracy=accuracy)
    assert route in field.diagnostics["orders_by"]
    light = field.stokes[at(field.tau, tau), at(field.mu, mu), at(field.phi, phi)]
    error, inside = np.abs(light[np.arange(tau.size), stokes] - value), np.abs(mu) < 1.0
    unit = 10.0 ** (np.floor(np.log10(np.where(value == 0.0, 1e-12, np.abs(value)))) - 5.0)
    assert (error / unit)[inside].max() <= 1.5
    assert (error <= 1e-5 * light[:, 0])[~inside].all()


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


@EITHER
@pytest.mark.parametrize(("tau", "nodes"), [(0.1, 40), (0.5, 32)])
def test_natraj_2009_rayleigh(source: str, tau: float, nodes: int, reference: Find) -> None:
    """ApJ 691, 1909: Rayleigh, omega = 1, Lambertian bases; their Q and U have the opposite sign."""
    table = [row for row in NATRAJ if row[0] == tau]
    if source == "whole":
        names, reported = ("tau", "albedo", "mu0", "mu", "phi_deg"), rows(reference("natraj2009/rayleigh.csv"))
        signs = [1 if row["direction"] == "UP" else -1 for row in reported]
        numbers = [[float(row[name]) for name in names] for row in reported]
        light = [[float(row[name]) for name in "IQU"] for row in reported]
        table = [
            (depth, albedo, mu0, sign * mu, phi, values)
            for (depth, albedo, mu0, mu, phi), sign, values in zip(numbers, signs, light, strict=True)
            if depth == tau and mu >= 0.1
        ]
        assert len(table) > 1500
    for (albedo, mu0), part in groupby(sorted(table), lambda row: row[1:3]):
        _, _, _, mu, phi, published = (np.array(column) for column in zip(*part, strict=True))
        scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 1.0, tau)], vrte.Lambertian(albedo) if albedo else None)
        field = exact.radiance(scene, mu0, FLUX_PI, np.unique(mu), np.unique(phi), [0.0, tau], nodes=nodes)
        found = field.stokes[np.where(mu > 0.0, 0, 1), at(field.mu, mu), at(field.phi, phi), :3]
        assert np.abs(found - published * [1, -1, -1]).max() <= 3e-8


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
FILES = {("mie", 0): "mieL8_m0", ("mie", 1): "mieL8_m1", ("haze", 0): "hazeL_w0.9_mu0_1"}


@EITHER
@pytest.mark.parametrize(("name", "order"), GARCIA)
def test_garcia_siewert_1985(source: str, name: str, order: int, reference: Find) -> None:
    """Transp. Theory Stat. Phys. 14, 437: scalar, tau 1, diffuse Fourier terms. The quoted haze L is from its size
    distribution, which ends at 10 um here: straight ahead, where that is seen, nothing is quoted."""
    if source == "quoted":
        table = np.array(GARCIA[name, order])
        beta = MIE_L8 if name == "mie" else cases.find_phase_matrix("haze-L").a1
    else:
        table = np.genfromtxt(reference(f"garcia_siewert1985/{FILES[name, order]}.csv"), delimiter=",", skip_header=1)
        table = table[table[:, 0] != 0.0]
        beta = [float(r["beta_l"]) for r in rows(reference(f"garcia_siewert1985/{FILES[name, order][:5]}_beta.csv"))]
    omega, mu0 = (0.95, 0.5) if name == "mie" else (0.9, 1.0)
    phi = np.arange(64) * (360.0 / 64)  # the terms of an azimuthal cosine series, from samples
    scene = vrte.Scene([vrte.Layer(vrte.PhaseMatrix(np.array(beta)), omega, 1.0)])
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
    """Mishchenko et al., JQSRT 63, 409: semi-infinite, omega = 1. The expansion it prints is that of spheres of index
    1.44 with a gamma distribution of 1.05 um and variance 0.07 at 0.55 um (the clouds of Venus), to 3.4e-4."""
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


# mu, phi; I, Q, U, of haze L, tau 0.2, omega 1, mu0 0.6, without the direction straight ahead
HAZE_L = [
    (0.6, 0.0, [1.2874e-2, -1.056e-3, 0.0]),
    (0.6, 90.0, [4.63e-3, 4.16e-4, -7.8e-4]),
    (-0.6, 90.0, [1.5914e-2, 4.9e-4, -9.18e-4]),
    (0.6, 180.0, [7.664e-3, 0.0, 0.0]),
    (-0.6, 180.0, [4.787e-3, -8.75e-4, 0.0]),
]


@EITHER
def test_haze_l_single_scattering(source: str, reference: Find) -> None:
    """Peaked phase matrix of 117 terms, where quoted from Deirmendjian's size distribution (Electromagnetic Scattering,
    1969): single scattering takes all of them whatever the nodes."""
    table, matrix = HAZE_L, cases.find_phase_matrix("haze-L")
    if source == "whole":
        matrix, reported = (
            phase_matrix(reference("haze_L/expansion.csv")),
            rows(reference("haze_L/single_scattering.csv")),
        )
        table = [
            (-float(row["mu_neg_is_up"]), float(row["az_deg"]), [float(row[name]) for name in "IQU"])
            for row in reported
        ]
    tiny = 1e-7  # at this albedo multiple scattering is below the print precision
    scene = vrte.Scene([vrte.Layer(matrix, tiny, 0.2)])
    for mu, phi, published in table:
        field = exact.radiance(scene, 0.6, FLUX_PI, mu, phi, 0.0 if mu > 0.0 else 0.2, nodes=4)
        difference = np.abs(field.stokes[0, 0, 0, :3] / tiny - published).max()
        assert difference <= 1.5e-6 * (1.0 if source == "quoted" else max(1.0, published[0])), (mu, phi)
