"""Phase matrices: functions, named ones, checks, tables of the literature."""

import pickle
import re
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flint import arb, ctx

import vrte
from bench.cases import SPHEROIDS
from vrte import _core
from vrte.basics.quadrature import compute_wigner_functions, find_gauss_legendre
from vrte.formats.keys import FilePath, make_start
from vrte.formats.layers import PHASES
from vrte.formats.scene_file import read_scene
from vrte.formats.toml_table import write_value
from vrte.optics.phase_matrix import CHECK_COSINES, PAIRS, UNSURE, NegativeScatteringWarning, PhaseMatrix
from vrte.scene.boundary import find_coherency

from .helpers import assert_close, close_to

NAMES = ["a1", "a2", "a3", "a4", "b1", "b2"]
ANGLES = np.array([0.0, 30.0, 90.0, 140.0, 180.0])
COS = np.cos(np.radians(ANGLES))


def functions(pairs: Any, terms: int, cosine: Any) -> np.ndarray:
    return np.concatenate([block for _, block in compute_wigner_functions(pairs, terms, np.asarray(cosine))])


def henyey_greenstein(g: float, angle_deg: Any) -> Any:
    return (1 - g**2) / (1 + g**2 - 2 * g * np.cos(np.radians(angle_deg))) ** 1.5


def test_functions_of_degrees_2_and_3() -> None:
    u = np.linspace(-1, 1, 9)
    d = functions(PAIRS, 4, u)
    expected = {
        (2, 1): np.sqrt(6) / 4 * (1 - u**2),
        (2, 2): (1 + u) ** 2 / 4,
        (2, 3): (1 - u) ** 2 / 4,
        (3, 0): (5 * u**3 - 3 * u) / 2,
        (3, 2): (1 + u) ** 2 * (3 * u - 2) / 4,
    }
    for index, values in expected.items():
        assert_close(d[index], values, rtol=0.0, atol=1e-15)
    assert not d[:2, 1:].any()


def test_functions_keep_their_digits_at_high_degree() -> None:
    ctx.prec = 200
    nodes = find_gauss_legendre(700)[0]
    u = np.concatenate([[-1.0], nodes[:5], nodes[345:355], nodes[-5:], [1.0]])
    exact = [float(arb(float(value)).legendre_p(699).mid()) for value in u]
    assert_close(functions([(0, 0)], 700, u)[699, 0], exact, rtol=0.0, atol=2e-15)


@pytest.mark.parametrize("pairs", [PAIRS, ((1, 1), (1, -1))])
def test_functions_are_orthogonal(pairs: Any) -> None:
    u, weights = find_gauss_legendre(80)
    d, degree = functions(pairs, 60, u), np.arange(60)
    for index, (m, n) in enumerate(pairs):
        gram = (d[:, index] * weights) @ d[:, index].T
        expected = np.diag(np.where(degree >= max(m, abs(n)), 2.0 / (2 * degree + 1), 0.0))
        assert_close(gram, expected, rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("count", [1, 2, 7, 40, 301])
def test_gauss_legendre_to_the_last_digits(count: int) -> None:
    ctx.prec = 200
    exact = [arb.legendre_p_root(count, k, weight=True) for k in range(count)][::-1]
    nodes, weights = find_gauss_legendre(count)
    assert_close(nodes, [float(node.mid()) for node, _ in exact], rtol=0.0, atol=3e-16)
    assert_close(weights, [float(weight.mid()) for _, weight in exact], rtol=2e-14, atol=0.0)


def test_rayleighs_coefficients_and_functions() -> None:
    """By hand; light polarized across or along the scattering plane: their ratio at 90 degrees is rho."""
    expected = [[1, 0, 0, 0, 0, 0], [0, 0, 0, 1.5, 0, 0], [0.5, 3, 0, 0, 1.2247448713915890, 0]]
    assert_close(vrte.rayleigh().coefficients, expected, rtol=1e-7, atol=0.0)
    f = vrte.rayleigh().scattering_matrix(ANGLES)
    along, across, turned = 0.75 * (1 + COS**2), -0.75 * (1 - COS**2), 1.5 * COS
    for (row, column), values in {(0, 0): along, (1, 1): along, (0, 1): across, (2, 2): turned, (3, 3): turned}.items():
        assert_close(f[:, row, column], values, rtol=0.0, atol=1e-15)
    rho = 0.0279
    matrix, f = vrte.rayleigh(rho), vrte.rayleigh(rho).scattering_matrix(90.0)
    assert (f[0, 0] + f[0, 1]) / (f[0, 0] - f[0, 1]) == close_to(rho, rtol=0.0, atol=1e-14)
    assert matrix.a4[1] == close_to(3 * (1 - 2 * rho) / (2 + rho), rtol=1e-6, atol=0.0)
    assert matrix.a1[2] == close_to((1 - rho) / (1 + rho / 2) / 2, rtol=1e-6, atol=0.0)
    vrte.rayleigh(6 / 7)


def test_henyey_greenstein_is_the_closed_form_and_says_how_many_terms_it_takes() -> None:
    angle, matrix = np.linspace(0, 180, 31), vrte.henyey_greenstein(0.6, 90)
    assert_close(matrix.scattering_matrix(angle)[:, 0, 0], henyey_greenstein(0.6, angle), rtol=1e-12, atol=0.0)
    assert (matrix.is_scalar, matrix.asymmetry) == (True, 0.6)
    assert vrte.henyey_greenstein(0.0, 5).a1.tolist() == [1, 0, 0, 0, 0]
    for g, terms in ((0.9, 60), (-0.9, 30), (0.99, 200)):
        with pytest.raises(vrte.SceneError, match=r"turns negative somewhere\); \d+ are enough") as error:
            vrte.henyey_greenstein(g, terms)
        assert vrte.henyey_greenstein(g).terms == int(re.findall(r"\d+", str(error.value))[-1])
    many = PhaseMatrix((2 * np.arange(700) + 1) * 0.97 ** np.arange(700))  # in several blocks
    assert many.scattering_matrix(25.0)[0, 0] == close_to(henyey_greenstein(0.97, 25.0), rtol=1e-7, atol=0.0)


def test_mixtures_and_lists_of_different_lengths() -> None:
    assert vrte.isotropic().coefficients.tolist() == [[1, 0, 0, 0, 0, 0]]
    mixed = vrte.mix([(vrte.rayleigh(), 3.0), (vrte.henyey_greenstein(0.5, 40), 1.0)])
    assert (mixed.terms, mixed.a1[0]) == (40, 1.0)
    assert_close([mixed.a1[1], mixed.a2[2]], [0.25 * 1.5, 0.75 * 3.0], rtol=1e-6, atol=0.0)
    padded = PhaseMatrix([1.0 + 5e-7, 0.3], b1=[0, 0, 0.1, 0.01], a2=[0, 0, 0.2])
    assert padded.coefficients.shape == (padded.terms, 6) == (4, 6)
    assert padded.a1[:2].tolist() == [1.0, 0.3 / (1.0 + 5e-7)]
    assert not padded.is_scalar
    assert PhaseMatrix(1.0).asymmetry == 0.0


def test_scattering_matrix_takes_any_shape_and_order_and_many_angles_in_pieces() -> None:
    matrix = vrte.mix([(vrte.rayleigh(), 1.0), (vrte.henyey_greenstein(0.7, 60), 1.0)])
    f = matrix.scattering_matrix([[170.0, 3.0], [90.0, 91.0], [0.0, 180.0]])
    assert f.shape == (3, 2, 4, 4)
    assert_close(f[1, 1], matrix.scattering_matrix(91.0), rtol=1e-14, atol=1e-15)
    assert matrix.scattering_matrix(np.zeros((0, 3))).shape == (0, 3, 4, 4)
    angle = np.linspace(0.0, 180.0, 10_001)
    some = matrix.scattering_matrix(angle[::500])
    assert_close(matrix.scattering_matrix(angle)[::500], some, rtol=1e-13, atol=1e-15)


def test_the_eigenvalue_checked_is_that_of_the_coherency_matrix() -> None:
    """Rayleigh's fourth element scaled up: negative by little, then by more than 1e-4 F11."""
    coefficients = {name: getattr(vrte.rayleigh(), name) for name in NAMES}
    for excess, refused in ((1e-4, nullcontext()), (1e-3, pytest.raises(vrte.SceneError, match="coherency"))):
        ahead = np.diag([1.5, 1.5, 1.5, 1.5 * (1 + excess)])
        assert (np.linalg.eigvalsh(find_coherency(ahead)).min() > -1e-4 * 1.5) == isinstance(refused, nullcontext)
        with refused:
            PhaseMatrix(**{**coefficients, "a4": coefficients["a4"] * (1 + excess)})
    PhaseMatrix([1.0, 1.0])  # 1 + cos: a phase function may vanish


def test_published_tables_are_physical(reference: Callable[[str], Path]) -> None:
    f = PhaseMatrix(*np.array(SPHEROIDS).T).scattering_matrix([20.0, 130.0])
    assert np.linalg.eigvalsh(find_coherency(f)).min() > 0.0
    for name in ("siewert2000_IIA", "mishchenko_semi_infinite", "haze_L", "aerosol_107"):
        lines = reference(f"{name}/expansion.csv").read_text().splitlines()
        table = np.genfromtxt([line for line in lines if not line.startswith("#")], delimiter=",", names=True)
        assert PhaseMatrix(**{name: table[name] for name in NAMES}).a1[0] == 1.0


def test_an_expansion_cut_short_is_taken_with_a_warning_where_asked() -> None:
    """The spheroids of Siewert (2000), problem IIA, without their last terms: negative straight back."""
    nine, seven = (np.array(SPHEROIDS[:terms]).T for terms in (9, 7))
    with pytest.raises(vrte.SceneError, match=r"at a scattering angle of 180 .* tolerance=1\.9e-05 takes it"):
        PhaseMatrix(*nine)
    with pytest.warns(NegativeScatteringWarning, match=r"180 degrees .* -1\.75e-05 where F11 is 0\.098; taken"):
        cut = PhaseMatrix(*nine, tolerance=1e-4)
    with pytest.raises(vrte.SceneError, match=r"146\.75 degrees .* -0\.00273 where F11 is 0\.0717.* tolerance=0\.003"):
        PhaseMatrix(*seven, tolerance=1e-4)
    assert pickle.loads(pickle.dumps(cut)).tolerance == 1e-4
    with pytest.warns(NegativeScatteringWarning):
        assert vrte.mix([(cut, 1.0), (cut, 1.0)]).tolerance == 1e-4
    mixed = vrte.mix([(cut, 0.01), (vrte.isotropic(), 0.99)])  # nothing negative is left
    assert_close(mixed.a1[1:], 0.01 * cut.a1[1:], rtol=1e-7, atol=0.0)
    PhaseMatrix([1.0, 0.5], tolerance=0.1)  # silent: nothing needs it


SOURCES = [name for name, row in PHASES.items() if not any(isinstance(key, FilePath) for key in row.keys.values())]


@pytest.mark.parametrize("name", SOURCES)
def test_every_named_source_scatters_what_it_gets_and_is_read_from_a_file(name: str, tmp_path: Path) -> None:
    path, row = tmp_path / "scene.toml", PHASES[name]
    phase = write_value(start) if (start := make_start(row.keys)) else f'"{name}"'
    path.write_text(f"[[layer]]\nphase = {phase}\nalbedo = 1\nthickness = 1\n[field]\nmu0 = 0.6\n")
    matrix = read_scene(path).scene.layers[0].phase_matrix
    np.testing.assert_array_equal(matrix.coefficients, row.make(**start).coefficients)
    field = vrte.radiance(vrte.Scene([vrte.Layer(matrix, 1.0, 1.0)]), 0.6, tau=[0.0, 1.0], nodes=16)
    net = field.flux_down + field.direct - field.flux_up
    assert_close(net, net[0], rtol=0.0, atol=3e-13)


@pytest.mark.parametrize(
    "matrix",
    [vrte.henyey_greenstein(0.97), vrte.spheres("gold", radius_um=3.0, wavelength_um=0.64).phase_matrix],
    ids=["scalar", "gold"],
)
def test_plain_recurrences_are_as_near_as_the_check_of_phase_matrices_takes_them(matrix: PhaseMatrix) -> None:
    f11, f22, f33, f44, f12, f34 = matrix.compute_elements(CHECK_COSINES)
    within = 0.5 * UNSURE * matrix.terms * np.abs(matrix.coefficients).sum()
    found = _core.sum_elements(matrix.series, CHECK_COSINES)
    assert_close(found, [f11, f44, f12, f34, f22 + f33, f22 - f33], rtol=0.0, atol=within)


def test_where_the_plain_recurrences_cannot_tell_the_others_decide() -> None:
    """F11 = 1 - b straight back: the allowed -1e-13 of the sum of coefficients lies between."""
    assert PhaseMatrix([1.0, 1.0 + 4e-13]).terms == 2
    with pytest.raises(vrte.SceneError, match="at a scattering angle of 180 degrees its coherency matrix"):
        PhaseMatrix([1.0, 1.0 + 2e-12])
