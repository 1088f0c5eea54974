"""Other codes in the report on methods: the same light where they find it, refusals by name, no part in the advice."""

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import vrte
from bench import methods, methods_page, other_codes
from bench.methods import MEASURED, Row
from bench.other_codes import Asked
from vrte.basics.errors import MissingExtraError, SceneError
from vrte.basics.quadrature import make_double_gauss

from .helpers import assert_close, close_to

NAMES = tuple(other_codes.PEERS)
NATURAL = np.array([2.0, 0.0, 0.0, 0.0])
MU, PHI = np.array([0.9, -0.3, 0.2, -1.0]), np.array([0.0, 70.0, 180.0])
AT_NODES = np.array([1.0, -1.0, 1.0, -1.0]) * make_double_gauss(16)[0][[13, 4, 3, 14]]


def asked(scene: vrte.Scene, stokes: np.ndarray = NATURAL, mu: np.ndarray = MU) -> Asked:
    """At the top and, where there is one, the bottom."""
    ends = np.isfinite(scene.thickness)
    return Asked(scene, 0.6, stokes, mu, PHI, np.array([0.0, scene.thickness] if ends else [0.0]))


def layered(albedo: float = 0.9, base: object = None) -> vrte.Scene:
    """Two unlike scalar layers."""
    upper = vrte.Layer(vrte.henyey_greenstein(0.6, 60), albedo, 0.4)
    return vrte.Scene([upper, vrte.Layer(vrte.isotropic(), 0.7, 0.8)], base)


def relative_to(right: vrte.Field, found: vrte.Field) -> np.ndarray:
    """Largest difference over azimuths, relative to the largest I, (tau, mu, 4)."""
    return np.asarray(np.abs(found.stokes - right.stokes).max(axis=2) / right.stokes[..., 0].max())


def by_vrte(one: Asked) -> vrte.Field:
    return vrte.radiance(one.scene, one.mu0, one.stokes, one.mu, one.phi, one.tau, nodes=32)


@pytest.mark.parametrize("base", [None, vrte.Lambertian(0.4)], ids=["black", "Lambertian"])
@pytest.mark.parametrize("name", NAMES)
def test_layers_over_a_base_are_seen_alike(name: str, base: object) -> None:
    pytest.importorskip(name)
    # off its nodes PythonicDISORT interpolates
    one = asked(layered(base=base), mu=AT_NODES if name == "PythonicDISORT" else MU)
    right, found = by_vrte(one), other_codes.prepare_solve(name, one, 32)()
    gaps = relative_to(right, found)
    assert gaps[0, one.mu > 0].max() < 1e-4
    assert found.flux_up[0] == close_to(right.flux_up[0], rtol=1e-6, atol=0.0)
    if name != "sasktran2":
        assert gaps[1].max() < 1e-4  # down and, off the base, up
        assert_close(found.flux_down[1], right.flux_down[1], rtol=1e-6, atol=0.0)


@pytest.mark.parametrize("name", NAMES)
def test_what_streams_cut_off_is_put_back(name: str) -> None:
    pytest.importorskip(name)
    one = asked(vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.8, 120), 0.95, 1.0)]))
    right = by_vrte(one)
    few, many = (
        relative_to(right, other_codes.prepare_solve(name, one, streams)())[0, MU > 0].max() for streams in (8, 32)
    )
    assert many < 0.2 * few
    assert many < 0.02


def test_the_signs_of_sasktran2_are_those_of_vrte() -> None:
    pytest.importorskip("sasktran2")
    one = asked(vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)], vrte.Lambertian(0.2)))
    right, found = by_vrte(one), other_codes.prepare_solve("sasktran2", one, 16)()
    assert relative_to(right, found)[0, MU > 0, :3].max() < 1e-4
    assert np.abs(right.stokes[0, MU > 0, :, 1:3]).max() > 0.01
    assert np.isnan(found.stokes[0, MU > 0, :, 3]).all()
    assert np.isnan(found.stokes[1]).all()


def refused(scene: vrte.Scene, stokes: np.ndarray = NATURAL) -> dict[str, str]:
    """What each peer says against it."""
    found = {}
    for name, peer in other_codes.PEERS.items():
        try:
            asked(scene, stokes).check(name, peer.polarization, peer.conservative)
        except SceneError as error:
            found[name] = str(error)
    return found


def test_what_they_do_not_take_they_refuse_by_name() -> None:
    endless = vrte.Scene([vrte.Layer(vrte.isotropic(), 0.5, np.inf)])
    assert refused(endless) == {name: f"{name} takes no semi-infinite layer" for name in NAMES}
    mirror = vrte.MuellerBase(lambda mu_i, mu_o, phi: np.diag([0.1, 0.0, 0.0, 0.0]))
    assert all("MuellerBase" in text for text in refused(layered(base=mirror)).values())
    assert set(refused(layered(base=mirror))) == set(NAMES)
    polished = vrte.Scene(layered().layers, vrte.Mirror(1.5))
    under_glass = vrte.Scene(layered().layers, None, (vrte.Interface(1.0, 1.5), None, None))
    assert all("no refracting or mirroring surface" in text for text in refused(polished).values())
    assert set(refused(polished)) == set(refused(under_glass)) == set(NAMES)
    assert set(refused(layered(), np.array([1.0, 0.1, 0.0, 0.0]))) == set(NAMES)
    assert set(refused(vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)]))) == {"nanodisort", "PythonicDISORT"}
    assert refused(layered(albedo=1.0)) == {"PythonicDISORT": "PythonicDISORT takes no albedo of 1"}
    assert refused(layered(base=vrte.Lambertian(0.3))) == {}


def test_without_them_the_report_works_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name in NAMES else find(name))
    assert not any(curve.method in NAMES for curve in methods.list_curves(quick=True))
    assert (
        other_codes.describe_peers()
        == f"other codes: none; not installed: {', '.join(NAMES)} (pip install 'vrte[bench]')"
    )
    with pytest.raises(MissingExtraError, match="nanodisort"):
        other_codes.prepare_solve("nanodisort", asked(layered()), 4)


def test_a_failure_of_theirs_is_a_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("nanodisort")

    def fails(*_: object) -> object:
        raise ValueError("of its own")

    broken = replace(other_codes.PEERS["nanodisort"], prepare=fails)
    monkeypatch.setitem(other_codes.PEERS, "nanodisort", broken)
    curve = methods.Curve("nanodisort", "nanodisort", (methods.Setting("4 streams", {"streams": 4}),))
    once = methods.Pace(seconds=0.0, fewest=1, most=1)
    (row,) = methods.make_study([*methods.SMALL][:1], [curve], tmp_path, once).measure_rows(tmp_path)
    assert row.status == "failed: nanodisort: ValueError: of its own"


def test_only_a_peer_may_leave_something_out() -> None:
    one = methods.find_case("Rayleigh, small")
    field = methods.solve_case(one, nodes=8)
    right = methods.Reference.of(one, field)
    holed = field.stokes.copy()
    holed[..., 3] = np.nan
    holed[1] = np.nan
    partial = replace(field, stokes=holed, flux_down=np.array([0.0, np.nan]))
    found = methods.measure_run_errors(one, partial, right, is_partial=True)
    assert found["i_max"] == found["u_rms"] == 0.0
    assert np.isnan(found["v_max"])
    assert found["energy"] == 0.0
    assert np.isnan(methods.measure_run_errors(one, partial, right)["energy"])


def test_no_peer_is_advised_but_it_is_told_what_it_takes() -> None:
    slow = Row("s", "c", "discrete-ordinates", "8 nodes", MEASURED, 2.0, i_max=1e-7, q_max=0, u_max=0, v_max=0)
    slow = replace(slow, reference_within=1e-12)
    quick = replace(slow, curve="nanodisort", method="nanodisort", setting="16 streams", seconds=1.0, v_max=np.nan)
    assert quick.worst == 1e-7
    assert methods_page.find_pareto_front([slow, quick]) == [slow]
    assert methods_page.find_quickest_candidate([slow, quick], 1e-6) == slow
    assert methods_page.compare_with_peers([slow, quick], 1e-6) == (
        "Beside vrte, for 1e-06: nanodisort with 16 streams takes 1 s, 0.5 times as long."
    )
    assert methods_page.compare_with_peers([slow, quick], 1e-8) == ""
    assert methods_page.list_heights([quick], "v_max") == [None]
    assert "V -" in methods_page.make_hover_text(quick)


def test_another_version_of_a_peer_is_asked_again() -> None:
    setting = methods.Setting("4 streams", {"streams": 4})
    runs = [methods.Run(methods.Curve("c", "nanodisort", (setting,), made), 0) for made in ("1", "2")]
    case = methods.find_case("isotropic, small")
    assert len({methods.mark(case, run) for run in runs}) == 2
