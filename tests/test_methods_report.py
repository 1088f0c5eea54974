"""The report on methods, with other codes in it: errors are what they are called, runs are taken up again, the page
needs no network; other codes find the same light, refuse by name, and have no part in the advice."""

import importlib.util
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import vrte
from bench import methods, methods_page, other_codes
from bench.methods import MEASURED, REFUSED, Row
from bench.other_codes import Asked
from bench.study import Records
from docs.scripts import methods_tables, radiance_factor
from vrte.basics.errors import MissingExtraError, SceneError
from vrte.basics.quadrature import make_double_gauss
from vrte.methods import find_method
from vrte.request.how import METHODS

from .helpers import assert_close, close_to

EXPLANATION = Path(__file__).parents[1] / "docs" / "explanation"
CURVE = methods.Curve("modes", "discrete-ordinates", methods.vary_nodes((2, 8), algorithm="modes"))
ONCE = methods.Pace(seconds=0.0, fewest=1, most=1)
FIRST = [*methods.SMALL][:1]
PEERS = tuple(other_codes.PEERS)
NATURAL = np.array([2.0, 0.0, 0.0, 0.0])
MU, PHI = np.array([0.9, -0.3, 0.2, -1.0]), np.array([0.0, 70.0, 180.0])
AT_NODES = np.array([1.0, -1.0, 1.0, -1.0]) * make_double_gauss(16)[0][[13, 4, 3, 14]]
each_peer = pytest.mark.parametrize("name", PEERS)


@pytest.mark.slow
def test_the_quick_report(tmp_path: Path) -> None:
    """Every method and scene has its rows; the exact one and auto keep what is asked; more nodes are closer."""
    assert methods.main(["--quick", "-o", str(tmp_path)]) == 0
    rows = list(Records(Row, tmp_path / methods.CSV).read().values())
    assert {row.method for row in rows} == set(METHODS) | {peer.name for peer in other_codes.list_installed()}
    assert len(rows) == len(methods.SMALL) * sum(len(each.settings) for each in methods.list_curves(True))
    assert all(row.status.startswith((MEASURED, REFUSED)) for row in rows), [row.status for row in rows]
    kept = [row for row in rows if row.curve in ("auto", "discrete-ordinates, accuracy")]
    assert len(kept) == 5 * len(methods.SMALL)
    assert all(row.method == "discrete-ordinates" for row in kept)
    assert all(row.worst <= float(row.setting.split()[1]) for row in kept)
    exact = [row for row in rows if row.method == "discrete-ordinates" and row.scene == "Rayleigh, small"]
    for row in exact:  # scatterings that are summed one by one end where they no longer matter to the accuracy
        accuracy = float(row.setting.split()[1]) if row.setting.startswith("accuracy") else 0.0
        assert row.energy < max(1e-12, 1e-3 * accuracy)
    page = (tmp_path / methods_page.PAGE).read_text(encoding="utf-8")
    for scene in methods.SMALL:
        for name in ("modes", "doubling"):
            few, many = (row for row in rows if (row.curve, row.scene) == (f"discrete-ordinates, {name}", scene))
            assert many.worst < few.worst / 20.0
            assert many.reference_within < 1e-7
        assert f'id="{methods.make_file_stem(scene)}"' in page
        assert (tmp_path / f"{methods.make_file_stem(scene)}.png").stat().st_size > 1000
    assert not re.search(r"<(script|link|img)[^>]*(src|href)=", page)
    assert 'How well method="auto" chose' in page
    assert "For 1e-03 take" in page


def test_a_slow_curve_ends_early(tmp_path: Path) -> None:
    study = methods.make_study(FIRST, [CURVE], tmp_path, replace(ONCE, longest=0.0))
    first, second = study.measure_rows(tmp_path)
    assert first.is_measured
    assert second.status.startswith("left out: 2 nodes took")


def test_errors_are_relative_to_the_largest_intensity_of_their_depth() -> None:
    """Only a peer may leave something out."""
    one = methods.find_case("Rayleigh, small")
    field = methods.solve_case(one, nodes=8)
    right = methods.Reference.of(one, field)
    assert max(methods.measure_run_errors(one, field, right).values()) < 1e-14
    wrong, holed = field.stokes.copy(), field.stokes.copy()
    wrong[1, :, :, 2] += 0.01 * np.abs(field.stokes[1, field.mu < 0.0, :, 0]).max()
    found = methods.measure_run_errors(one, replace(field, stokes=wrong), right)
    assert [found[name] for name in ("i_max", "u_max", "u_rms")] == close_to([0.0, 0.01, 0.01], rtol=1e-6, atol=0.0)
    holed[..., 3] = holed[1] = np.nan
    partial = replace(field, stokes=holed, flux_down=np.array([0.0, np.nan]))
    found = methods.measure_run_errors(one, partial, right, is_partial=True)
    assert found["i_max"] == found["u_rms"] == found["energy"] == 0.0
    assert np.isnan(found["v_max"])
    assert np.isnan(methods.measure_run_errors(one, partial, right)["energy"])


def test_tables_of_knobs_and_methods_are_those_of_the_registry() -> None:
    for method, each in methods.KNOBS.items():
        named = {name for _, some in each for setting in some for name in setting.options.get("settings", {})}
        assert named <= set(find_method(method).settings)
    text = (EXPLANATION / "methods.md").read_text(encoding="utf-8")
    command = "python -m docs.scripts.methods_tables docs/explanation/methods.md"
    assert methods_tables.refresh_tables(text) == text, f"run `{command}`"
    assert all(f"\n| `{name}` |" in text for name in METHODS)


@pytest.mark.slow
def test_figures_of_the_paper(tmp_path: Path) -> None:
    """Inside a conservative slab light turns towards straight down; below a thin one single scattering agrees near the
    beam."""
    assert radiance_factor.main(["-o", str(tmp_path)]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {"radiance_factor_1.png", "radiance_factor_2.png"}
    brightest = [abs(lobe.angle[np.argmax(lobe.radiance)]) for lobe in radiance_factor.solve_inside()]
    assert np.all(np.diff(brightest[1:]) < 0.0)
    lobes = radiance_factor.solve_below(0.01)
    exact, once = (lobes[name] for name in ("discrete-ordinates", "single-scattering"))
    near = np.abs(exact.angle - radiance_factor.BEAM) < 10.0
    assert_close(once.radiance[near], exact.radiance[near], rtol=0.02, atol=0.0)


def ask(scene: vrte.Scene, stokes: np.ndarray = NATURAL, mu: np.ndarray = MU) -> Asked:
    """Light at the top and, where there is one, the bottom."""
    ends = np.isfinite(scene.thickness)
    return Asked(scene, 0.6, stokes, mu, PHI, np.array([0.0, scene.thickness] if ends else [0.0]))


def layered(albedo: float = 0.9, base: object = None) -> vrte.Scene:
    """Two unlike scalar layers."""
    upper = vrte.Layer(vrte.henyey_greenstein(0.6, 60), albedo, 0.4)
    return vrte.Scene([upper, vrte.Layer(vrte.isotropic(), 0.7, 0.8)], base)


def compare(name: str, one: Asked, *streams: int) -> tuple[vrte.Field, list[vrte.Field], list[np.ndarray]]:
    """vrte's field, a peer's, and their largest difference over azimuths relative to the largest I (tau, mu, 4)."""
    right = vrte.radiance(one.scene, one.mu0, one.stokes, one.mu, one.phi, one.tau, nodes=32)
    fields = [other_codes.prepare_solve(name, one, count)() for count in streams]
    size = right.stokes[..., 0].max()
    return right, fields, [np.abs(found.stokes - right.stokes).max(axis=2) / size for found in fields]


@pytest.mark.parametrize("base", [None, vrte.Lambertian(0.4)], ids=["black", "Lambertian"])
@each_peer
def test_layers_over_a_base_are_seen_alike(name: str, base: object) -> None:
    pytest.importorskip(name)
    # off its nodes PythonicDISORT interpolates
    one = ask(layered(base=base), mu=AT_NODES if name == "PythonicDISORT" else MU)
    right, (found,), (differences,) = compare(name, one, 32)
    assert differences[0, one.mu > 0].max() < 1e-4
    assert found.flux_up[0] == close_to(right.flux_up[0], rtol=1e-6, atol=0.0)
    if name != "sasktran2":
        assert differences[1].max() < 1e-4  # down and, off the base, up
        assert_close(found.flux_down[1], right.flux_down[1], rtol=1e-6, atol=0.0)


@each_peer
def test_what_streams_cut_off_is_put_back(name: str) -> None:
    pytest.importorskip(name)
    peaked = ask(vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.8, 120), 0.95, 1.0)]))
    few, many = (difference[0, MU > 0].max() for difference in compare(name, peaked, 8, 32)[2])
    assert many < min(0.2 * few, 0.02)


def test_the_signs_of_sasktran2_are_those_of_vrte() -> None:
    pytest.importorskip("sasktran2")
    one = ask(vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)], vrte.Lambertian(0.2)))
    right, (found,), (differences,) = compare("sasktran2", one, 16)
    assert differences[0, MU > 0, :3].max() < 1e-4
    assert np.abs(right.stokes[0, MU > 0, :, 1:3]).max() > 0.01
    assert np.isnan(found.stokes[0, MU > 0, :, 3]).all()
    assert np.isnan(found.stokes[1]).all()


MIRROR = vrte.MuellerBase(lambda mu_i, mu_o, phi: np.diag([0.1, 0.0, 0.0, 0.0]))


@pytest.mark.parametrize(
    ("scene", "stokes", "names", "words"),
    [
        (vrte.Scene([vrte.Layer(vrte.isotropic(), 0.5, np.inf)]), NATURAL, PEERS, "takes no semi-infinite layer"),
        (layered(base=MIRROR), NATURAL, PEERS, "MuellerBase"),
        (layered(base=vrte.Mirror(1.5)), NATURAL, PEERS, "no refracting or mirroring surface"),
        (
            vrte.Scene(layered().layers, None, (vrte.Interface(1.0, 1.5), None, None)),
            *(NATURAL, PEERS, "no refracting or mirroring surface"),
        ),
        (layered(), np.array([1.0, 0.1, 0.0, 0.0]), PEERS, "takes"),
        (vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)]), NATURAL, ("nanodisort", "PythonicDISORT"), "takes"),
        (layered(albedo=1.0), NATURAL, ("PythonicDISORT",), "PythonicDISORT takes no albedo of 1"),
        (layered(base=vrte.Lambertian(0.3)), NATURAL, (), ""),
    ],
)
def test_what_peers_do_not_take_they_refuse_by_name(
    scene: vrte.Scene, stokes: np.ndarray, names: tuple[str, ...], words: str
) -> None:
    refused = {}
    for name, peer in other_codes.PEERS.items():
        try:
            ask(scene, stokes).check(name, peer.polarization, peer.conservative)
        except SceneError as error:
            refused[name] = str(error)
    assert set(refused) == set(names)
    assert all(words in text and text.startswith(name) for name, text in refused.items())


def test_without_them_the_report_works_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name in PEERS else find(name))
    assert not any(curve.method in PEERS for curve in methods.list_curves(quick=True))
    text = f"other codes: none; not installed: {', '.join(PEERS)} (pip install 'vrte[bench]')"
    assert other_codes.describe_peers() == text
    with pytest.raises(MissingExtraError, match="nanodisort"):
        other_codes.prepare_solve("nanodisort", ask(layered()), 4)
