"""Published tables, sign by sign. The tables stay outside the repository; the few values quoted here are cited."""

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import vrte
from tests import exact
from vrte.report.tables.problems import SIEWERT_DOWN, SIEWERT_UP, siewert_scene

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


def test_siewert_2000_problem_iia(reference: Find) -> None:
    """JQSRT 64, 227: spheroids with b2 != 0, seven depths, I, Q, U, V to 1.5 units of the sixth digit."""
    table = rows(reference("siewert2000_IIA/table.csv"))
    scene = vrte.Scene([vrte.Layer(phase_matrix(reference("siewert2000_IIA/expansion.csv")), 0.973527, 1.0)])
    mu = np.array([float(row["abs_mu"]) * (1 if row["direction"] == "up" else -1) for row in table])
    tau, phi = (np.array([float(row[name]) for row in table]) for name in ("tau", "phi_deg"))
    value = np.array([float(row["value"]) for row in table])
    field = exact.radiance(scene, 0.6, FLUX_PI, np.unique(mu), np.unique(phi), np.unique(tau), nodes=30)
    index = (at(field.tau, tau), at(field.mu, mu), at(field.phi, phi), ["IQUV".index(row["stokes"]) for row in table])
    error = np.abs(field.stokes[index] - value)
    inside = np.abs(mu) < 1.0
    unit = 10.0 ** (np.floor(np.log10(np.where(value == 0.0, 1e-12, np.abs(value)))) - 5.0)
    assert inside.sum() > 900
    assert (error / unit)[inside].max() <= 1.5
    largest = field.stokes[index[0], index[1], index[2], 0]
    assert (error <= 1e-5 * largest)[~inside].all()


def test_siewert_2000_quoted() -> None:
    """Eight values of the same tables, quoted: mu0 0.6, phi 90, mu 0.5 up at tau 0 and mu 0.2 down at tau 1."""
    field = exact.radiance(siewert_scene(), 0.6, FLUX_PI, [0.5, -0.2], 90.0, [0.0, 1.0], nodes=30)
    np.testing.assert_allclose(field.stokes[0, 0, 0], SIEWERT_UP, rtol=1e-5)
    np.testing.assert_allclose(field.stokes[1, 1, 0], SIEWERT_DOWN, rtol=1e-5)


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


@pytest.mark.parametrize("order", [0, 1])
def test_mishchenko_semi_infinite(reference: Find, order: int) -> None:
    """JQSRT 63, 409: semi-infinite, omega = 1, the reflection matrix's Fourier orders at mu = mu0 = 0.5."""
    published = np.genfromtxt(reference(f"mishchenko_semi_infinite/reflection_m{order}.csv"), delimiter=",")
    matrix = phase_matrix(reference("mishchenko_semi_infinite/expansion.csv"))
    phi = np.arange(256) * (360.0 / 256)
    f = exact.brdf(vrte.Scene([vrte.Layer(matrix, 1.0, np.inf)]), 0.5, 0.5, phi, nodes=48).mueller[0, 0]
    cosine, sine = np.cos(order * np.radians(phi)) / 256, np.sin(order * np.radians(phi)) / 256
    got = np.tensordot(cosine, f, 1)
    got[2:, :2] = np.tensordot(sine, f, 1)[2:, :2]
    got[:2, 2:] = -np.tensordot(sine, f, 1)[:2, 2:]
    assert np.abs(np.pi * got - published).max() <= 1e-5


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
