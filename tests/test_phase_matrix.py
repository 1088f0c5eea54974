"""Phase matrices: functions, named ones, checks, tables of the literature."""

import pickle
from pathlib import Path

import numpy as np
import pytest
from flint import arb, ctx

import vrte
from bench.cases import SPHEROIDS
from vrte.basics.errors import SceneError
from vrte.basics.spherical_functions import compute_wigner_functions, find_gauss_legendre
from vrte.formats.keys import FilePath, make_start
from vrte.formats.phases import PHASES
from vrte.formats.scene_file import read_scene
from vrte.formats.toml_table import write_value
from vrte.optics.phase_matrix import (
    PAIRS,
    NegativeScatteringWarning,
    PhaseMatrix,
    henyey_greenstein,
    isotropic,
    mix,
    rayleigh,
)

from .helpers import assert_close, close_to

NAMES = ["a1", "a2", "a3", "a4", "b1", "b2"]


def functions(pairs, terms, cosine):
    return np.concatenate([block for _, block in compute_wigner_functions(pairs, terms, np.asarray(cosine))])


def published(path):
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    table = np.genfromtxt(lines, delimiter=",", names=True)
    return PhaseMatrix(**{name: table[name] for name in NAMES})


def coherency_eigenvalues(f):
    """Eigenvalues of H = sum F_ij sigma_i x conj(sigma_j) / 4, written out."""
    sigma = np.array([[[1, 0], [0, 1]], [[1, 0], [0, -1]], [[0, 1], [1, 0]], [[0, -1j], [1j, 0]]])
    return np.linalg.eigvalsh(sum(f[i, j] * np.kron(sigma[i], sigma[j].conj()) / 4 for i in range(4) for j in range(4)))


def test_functions_of_degrees_2_and_3():
    u = np.linspace(-1, 1, 9)
    d = functions(PAIRS, 4, u)
    assert_close(d[2, 1], np.sqrt(6) / 4 * (1 - u**2), rtol=0.0, atol=1e-15)
    assert_close(d[2, 2], (1 + u) ** 2 / 4, rtol=0.0, atol=1e-15)
    assert_close(d[2, 3], (1 - u) ** 2 / 4, rtol=0.0, atol=1e-15)
    assert_close(d[3, 0], (5 * u**3 - 3 * u) / 2, rtol=0.0, atol=1e-15)
    assert_close(d[3, 2], (1 + u) ** 2 * (3 * u - 2) / 4, rtol=0.0, atol=1e-15)
    assert not d[:2, 1:].any()


def test_functions_keep_their_digits_at_high_degree():
    ctx.prec = 200
    nodes = find_gauss_legendre(700)[0]
    u = np.concatenate([[-1.0], nodes[:5], nodes[345:355], nodes[-5:], [1.0]])
    exact = [float(arb(float(value)).legendre_p(699).mid()) for value in u]
    assert_close(functions([(0, 0)], 700, u)[699, 0], exact, rtol=0.0, atol=2e-15)


@pytest.mark.parametrize("pairs", [PAIRS, ((1, 1), (1, -1))])
def test_functions_are_orthogonal(pairs):
    u, weights = find_gauss_legendre(80)
    d = functions(pairs, 60, u)
    for place, (m, n) in enumerate(pairs):
        gram = (d[:, place] * weights) @ d[:, place].T
        degree = np.arange(60)
        expected = np.diag(np.where(degree >= max(m, abs(n)), 2.0 / (2 * degree + 1), 0.0))
        assert_close(gram, expected, rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("count", [1, 2, 7, 40, 301])
def test_gauss_legendre_to_the_last_digits(count):
    ctx.prec = 200
    exact = [arb.legendre_p_root(count, k, weight=True) for k in range(count)][::-1]
    nodes, weights = find_gauss_legendre(count)
    assert_close(nodes, [float(node.mid()) for node, _ in exact], rtol=0.0, atol=3e-16)
    assert_close(weights, [float(weight.mid()) for _, weight in exact], rtol=2e-14, atol=0.0)


def test_rayleigh_without_depolarization():
    pm = rayleigh()
    assert_close(pm.a1, [1, 0, 0.5], rtol=1e-7, atol=0.0)
    assert_close(pm.a2, [0, 0, 3], rtol=1e-7, atol=0.0)
    assert_close(pm.a4, [0, 1.5, 0], rtol=1e-7, atol=0.0)
    assert_close(pm.b1, [0, 0, 1.2247448713915890], rtol=1e-7, atol=0.0)
    assert not pm.a3.any()
    assert not pm.b2.any()
    angle = np.array([0.0, 30.0, 90.0, 140.0, 180.0])
    c, f = np.cos(np.radians(angle)), pm.scattering_matrix(angle)
    assert_close(f[:, 0, 0], 0.75 * (1 + c**2), rtol=0.0, atol=1e-15)
    assert_close(f[:, 1, 1], 0.75 * (1 + c**2), rtol=0.0, atol=1e-15)
    assert_close(f[:, 0, 1], -0.75 * (1 - c**2), rtol=0.0, atol=1e-15)
    assert_close(f[:, 2, 2], 1.5 * c, rtol=0.0, atol=1e-15)
    assert_close(f[:, 3, 3], 1.5 * c, rtol=0.0, atol=1e-15)


def test_rayleigh_with_depolarization():
    rho = 0.0279
    f = rayleigh(rho).scattering_matrix(90.0)
    # light polarized across or along the scattering plane: their ratio at 90 degrees is rho
    assert (f[0, 0] + f[0, 1]) / (f[0, 0] - f[0, 1]) == close_to(rho, rtol=0.0, atol=1e-14)
    r = (1 - rho) / (1 + rho / 2)
    assert rayleigh(rho).a4[1] == close_to(3 * (1 - 2 * rho) / (2 + rho), rtol=1e-6, atol=0.0)
    assert rayleigh(rho).a1[2] == close_to(r / 2, rtol=1e-6, atol=0.0)
    rayleigh(6 / 7)


def test_henyey_greenstein_is_the_closed_form():
    g, angle = 0.6, np.linspace(0, 180, 31)
    pm = henyey_greenstein(g, 90)
    exact = (1 - g**2) / (1 + g**2 - 2 * g * np.cos(np.radians(angle))) ** 1.5
    assert_close(pm.scattering_matrix(angle)[:, 0, 0], exact, rtol=1e-12, atol=0.0)
    assert pm.is_scalar
    assert pm.asymmetry == g
    assert henyey_greenstein(0.0, 5).a1.tolist() == [1, 0, 0, 0, 0]


@pytest.mark.parametrize(("g", "terms"), [(0.9, 60), (-0.9, 30), (0.99, 200)])
def test_henyey_greenstein_says_how_many_terms_it_takes(g, terms):
    with pytest.raises(SceneError, match=r"turns negative somewhere\); \d+ are enough") as error:
        henyey_greenstein(g, terms)
    assert henyey_greenstein(g).terms == int(str(error.value).split("; ")[-1].split()[0])


def test_henyey_greenstein_of_too_many_terms_is_refused():
    with pytest.raises(SceneError, match=r"g = 0\.9999 takes \d+ terms, and at most 100000 are allowed"):
        henyey_greenstein(0.9999)


def test_isotropic_and_mixtures():
    assert isotropic().coefficients.tolist() == [[1, 0, 0, 0, 0, 0]]
    mixed = mix([(rayleigh(), 3.0), (henyey_greenstein(0.5, 40), 1.0)])
    assert mixed.terms == 40
    assert mixed.a1[0] == 1.0
    assert mixed.a1[1] == close_to(0.25 * 1.5, rtol=1e-6, atol=0.0)
    assert mixed.a2[2] == close_to(0.75 * 3.0, rtol=1e-6, atol=0.0)


def test_lists_are_padded_and_divided_by_the_first_coefficient():
    pm = PhaseMatrix([1.0 + 5e-7, 0.3], b1=[0, 0, 0.1, 0.01], a2=[0, 0, 0.2])
    assert pm.terms == 4
    assert pm.coefficients.shape == (4, 6)
    assert pm.a1[0] == 1.0
    assert pm.a1[1] == 0.3 / (1.0 + 5e-7)
    assert not pm.is_scalar
    assert PhaseMatrix(1.0).asymmetry == 0.0


def test_scattering_matrix_takes_any_shape_and_order():
    pm = mix([(rayleigh(), 1.0), (henyey_greenstein(0.7, 60), 1.0)])
    angle = np.array([[170.0, 3.0], [90.0, 91.0], [0.0, 180.0]])
    f = pm.scattering_matrix(angle)
    assert f.shape == (3, 2, 4, 4)
    assert pm.scattering_matrix(7.0).shape == (4, 4)
    assert_close(f[1, 1], pm.scattering_matrix(91.0), rtol=1e-14, atol=1e-15)


def test_many_angles_come_in_pieces():
    pm, angle = henyey_greenstein(0.6, 90), np.linspace(0.0, 180.0, 10_001)
    assert_close(pm.scattering_matrix(angle)[::500], pm.scattering_matrix(angle[::500]), rtol=1e-13, atol=0.0)
    assert pm.scattering_matrix(np.zeros((0, 3))).shape == (0, 3, 4, 4)


def test_many_terms_come_in_blocks():
    g, terms = 0.97, 700
    a1 = (2 * np.arange(terms) + 1) * g ** np.arange(terms)
    exact = (1 - g**2) / (1 + g**2 - 2 * g * np.cos(np.radians(25.0))) ** 1.5
    assert PhaseMatrix(a1).scattering_matrix(25.0)[0, 0] == close_to(exact, rtol=1e-7, atol=0.0)


@pytest.mark.parametrize(
    ("lists", "words"),
    [
        ({"a1": [0.9]}, r"a1\[0\] must be 1 within 1e-6 .* not 0.9"),
        ({"a1": [1.0 + 2e-6]}, r"a1\[0\] must be 1"),
        ({"a1": []}, "a1 must be a number or a non-empty 1-D list"),
        ({"a1": [[1.0, 0.0]]}, "a1 must be .* 1-D"),
        ({"a1": [1.0, np.nan]}, "a1 must be finite"),
        ({"a1": [1.0], "b2": [0, 0, np.inf]}, "b2 must be finite"),
        ({"a1": ["x"]}, "a1 must be real numbers"),
        ({"a1": [1.0, 3.1]}, "180 degrees .* coherency matrix has the eigenvalue"),
        ({"a1": [1.0], "a2": [0, 0, 5.0]}, "not physical"),
        ({"a1": [1.0], "b1": [0, 0, 2.0]}, "not physical"),
    ],
)
def test_what_is_refused(lists, words):
    with pytest.raises(SceneError, match=words):
        PhaseMatrix(**lists)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: rayleigh(0.9), "depolarization must be between 0 and 6/7, not 0.9"),
        (lambda: rayleigh(-0.1), "depolarization"),
        (lambda: henyey_greenstein(1.0, 10), "g must be between -1 and 1"),
        (lambda: henyey_greenstein(0.5, 0), "terms must be a whole number"),
        (lambda: henyey_greenstein(0.5, 2.5), "terms"),
        (lambda: mix([]), "at least one kind"),
        (lambda: mix([(rayleigh(), -1.0)]), "weights .* >= 0"),
        (lambda: mix([(rayleigh(), 0.0)]), "not all zero"),
        (lambda: mix([rayleigh()]), "pairs"),
        (lambda: mix([(1.0, 1.0)]), "pairs .* not float"),
        (lambda: rayleigh().scattering_matrix(np.nan), "angle_deg"),
    ],
)
def test_errors_of_the_named_ones(call, words):
    with pytest.raises(SceneError, match=words):
        call()


def test_the_eigenvalue_checked_is_that_of_the_coherency_matrix():
    # rayleigh's fourth element scaled up: negative by little, then by more than 1e-4 F11
    coefficients = {name: getattr(rayleigh(), name) for name in NAMES}
    for excess, fits in ((1e-4, True), (1e-3, False)):
        changed = {**coefficients, "a4": coefficients["a4"] * (1 + excess)}
        f = np.array([[1.5, 0, 0, 0], [0, 1.5, 0, 0], [0, 0, 1.5, 0], [0, 0, 0, 1.5 * (1 + excess)]])  # at 0 degrees
        assert (coherency_eigenvalues(f).min() > -1e-4 * 1.5) == fits
        if fits:
            PhaseMatrix(**changed)
        else:
            with pytest.raises(SceneError, match="coherency"):
                PhaseMatrix(**changed)


def test_a_phase_function_may_vanish():
    PhaseMatrix([1.0, 1.0])  # 1 + cos: zero in backward direction
    PhaseMatrix([1.0, 0.0, 0.5], a2=[0, 0, 3.0], a4=[0, 1.5], b1=[0, 0, np.sqrt(1.5)])


def test_published_tables_are_physical(reference):
    for name in ("siewert2000_IIA", "mishchenko_semi_infinite", "haze_L", "aerosol_107"):
        assert published(reference(f"{name}/expansion.csv")).a1[0] == 1.0


def test_a_published_matrix_is_physical_by_the_full_coherency_matrix():
    f = PhaseMatrix(*np.array(SPHEROIDS).T).scattering_matrix([20.0, 130.0])
    assert all(coherency_eigenvalues(one).min() > 0.0 for one in f)


def test_frozen_read_only_and_pickled():
    pm = pickle.loads(pickle.dumps(rayleigh(0.03)))
    np.testing.assert_array_equal(pm.coefficients, rayleigh(0.03).coefficients)
    for name in NAMES:
        with pytest.raises(ValueError, match="read-only"):
            getattr(pm, name)[0] = 2.0
    with pytest.raises(AttributeError):
        pm.a1 = np.ones(1)
    given = np.array([1.0, 0.2])
    PhaseMatrix(given)
    given[1] = 0.3  # the caller's array stays the caller's


def test_an_expansion_cut_short_is_taken_with_a_warning_where_asked():
    """The spheroids of Siewert (2000), problem IIA, without their last terms: negative straight back."""
    nine, seven = (np.array(SPHEROIDS[:terms]).T for terms in (9, 7))
    with pytest.raises(SceneError, match=r"not physical: at a scattering angle of 180 .* tolerance=1\.9e-05 takes it"):
        PhaseMatrix(*nine)
    with pytest.warns(NegativeScatteringWarning, match=r"180 degrees .* -1\.75e-05 where F11 is 0\.098; taken"):
        cut = PhaseMatrix(*nine, tolerance=1e-4)
    with pytest.raises(SceneError, match=r"146\.75 degrees .* -0\.00273 where F11 is 0\.0717.* tolerance=0\.003 takes"):
        PhaseMatrix(*seven, tolerance=1e-4)
    assert pickle.loads(pickle.dumps(cut)).tolerance == 1e-4
    with pytest.warns(NegativeScatteringWarning):
        assert mix([(cut, 1.0), (cut, 1.0)]).tolerance == 1e-4
    mixed = mix([(cut, 0.01), (isotropic(), 0.99)])  # nothing negative is left
    assert_close(mixed.a1[1:], 0.01 * cut.a1[1:], rtol=1e-7, atol=0.0)
    PhaseMatrix([1.0, 0.5], tolerance=0.1)  # silent: nothing needs it
    for wrong in (-1e-3, 2.0, np.nan, "much"):
        with pytest.raises(
            SceneError, match=r"tolerance must be (a number|between 0 and 1, of the mean of F11 over the sphere), not"
        ):
            PhaseMatrix([1.0], tolerance=wrong)


@pytest.mark.parametrize(
    "name", [n for n, r in PHASES.items() if not any(isinstance(k, FilePath) for k in r.keys.values())]
)
def test_every_named_source_scatters_what_it_gets_and_is_read_from_a_file(name: str, tmp_path: Path) -> None:
    path, row = tmp_path / "scene.toml", PHASES[name]
    phase = write_value(start) if (start := make_start(row.keys)) else f'"{name}"'
    path.write_text(f"[[layer]]\nphase = {phase}\nalbedo = 1\nthickness = 1\n[field]\nmu0 = 0.6\n")
    matrix = read_scene(path).scene.layers[0].phase_matrix
    np.testing.assert_array_equal(matrix.coefficients, row.make(**start).coefficients)
    field = vrte.radiance(vrte.Scene([vrte.Layer(matrix, 1.0, 1.0)]), 0.6, tau=[0.0, 1.0], nodes=16)
    net = field.flux_down + field.direct - field.flux_up
    assert_close(net, net[0], rtol=0.0, atol=3e-13)
