"""Semi-infinite layers in floats with corrections against doubles, and what becomes of items that do not settle."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.cl import device, invariance, mixed
from vrte.cl import precision as rules
from vrte.cl.matrices import Stack, download_stack
from vrte.discrete_ordinates.orders.discretise import discretise_scene

from .helpers import assert_close
from .samples import spheroids

TIGHT = 1e-15


def ask(
    albedos: Sequence[float], orders: Sequence[int], tolerance: float, nodes: int = 6, scalar: bool = False
) -> list[Any]:
    """What `reflect_semi_infinite` takes behind its session: every order of a layer of each albedo."""
    phase = vrte.henyey_greenstein(0.5) if scalar else spheroids()
    mu = np.array([0.08, 0.5, 1.0])
    problem = discretise_scene(vrte.Scene([vrte.Layer(phase, 0.5, np.inf)]), mu, np.eye(4), mu, np.zeros(1), nodes)
    off, places = np.unique(np.concatenate([problem.mu_out, problem.mu0]), return_inverse=True)
    order = np.tile(np.array(orders, np.int32), len(albedos))
    material = np.repeat(np.arange(len(albedos), dtype=np.int32), len(orders))
    count = problem.mu_out.size
    return [
        np.arange(order.size, dtype=np.int32),
        order,
        material,
        tuple(problem.stokes),
        np.repeat(problem.coefficients[:1], len(albedos), axis=0),
        np.repeat(problem.terms[:1].astype(np.int32), len(albedos)),
        np.array(albedos),
        np.concatenate([problem.nodes, off]),
        problem.weights,
        places[:count].astype(np.int32),
        places[count:].astype(np.int32),
        problem.columns,
        np.full(order.size, tolerance),
    ]


def in_doubles(session: Any, asked: Sequence[Any], tolerance: float = TIGHT) -> invariance.SemiInfinite:
    """The same in doubles, to another tolerance."""
    return invariance.reflect_semi_infinite(
        session, *mixed.upload_all(session, [*asked[:-1], np.full(asked[1].size, tolerance)])
    )


def find_gaps(session: Any, found: Any, expected: Any) -> np.ndarray:
    """The largest difference of each item, relative to its largest element."""
    one, other = (session.download(each).reshape(each.shape[0], -1) for each in (found, expected))
    gaps: np.ndarray = np.abs(one - other).max(axis=1) / np.abs(other).max(axis=1)
    return gaps


class TestFixedPoints:
    @pytest.mark.parametrize("scalar", [False, True])
    @pytest.mark.parametrize("tolerance", [5e-9, 1e-13])
    def test_as_exact_as_in_doubles(self, either_form: Any, tolerance: float, scalar: bool) -> None:
        """The residual is that of doubles, and it keeps its word."""
        asked = ask([0.6, 0.97], [0, 1, 3], tolerance, scalar=scalar)
        found, doubted = mixed.reflect_semi_infinite_mixed(either_form, asked)
        exact, residual = in_doubles(either_form, asked), either_form.download(found.residual)
        assert not doubted.size
        assert (residual <= tolerance).all()
        for name in ("up", "on_nodes"):
            assert (find_gaps(either_form, getattr(found, name), getattr(exact, name)) < 3 * tolerance).all()

    def test_floats_alone_are_not_enough(self, opencl: Any) -> None:
        """So that it is the corrections that are measured above."""
        asked = ask([0.9], [0, 1], 5e-9)
        single = opencl.in_precision("single")
        rough = invariance.reflect_semi_infinite(single, *mixed.upload_all(single, asked))
        gaps = find_gaps(opencl, rough.up, in_doubles(opencl, asked).up)
        assert (gaps > 1e-8).any()
        assert (gaps < 1e-4).all()

    def test_an_item_does_not_depend_on_the_others(self, either_form: Any) -> None:
        asked = ask([0.6, 0.97], [0, 2], 1e-9)
        whole = either_form.download(mixed.reflect_semi_infinite_mixed(either_form, asked)[0].up)
        for item in range(4):
            alone = [np.array([item], np.int32), *asked[1:]]
            found = either_form.download(mixed.reflect_semi_infinite_mixed(either_form, alone)[0].up)
            assert (found[item] == whole[item]).all()

    def test_what_does_not_settle_is_solved_in_doubles(self, opencl: Any, monkeypatch: pytest.MonkeyPatch) -> None:
        """One of the items here: the others keep what floats and corrections found."""
        asked = ask([0.6, 0.97], [0, 1], 5e-9)
        usual = opencl.download(mixed.reflect_semi_infinite_mixed(opencl, asked)[0].up)
        whole = mixed.Mixing.correct

        def spoil(self: Any, rows: Any, r: Any, d: Any, *rest: Any) -> None:
            whole(self, rows, r, d, *rest)
            values = opencl.download(d)
            values[2] = np.nan
            self.low.put(values, d)

        monkeypatch.setattr(mixed.Mixing, "correct", spoil)
        found, doubted = mixed.reflect_semi_infinite_mixed(opencl, asked)
        assert doubted.tolist() == [2]
        double = in_doubles(opencl, asked, 5e-9)
        for name in ("up", "on_nodes", "residual", "steps"):
            here, there = (opencl.download(getattr(one, name)) for one in (found, double))
            assert (here[2] == there[2]).all()
        assert (opencl.download(found.up)[[0, 1, 3]] == usual[[0, 1, 3]]).all()


def test_a_correction_solves_its_equations(either_form: Any) -> None:
    """d = r + (d K + (d K)^T) Q/2 over 1/mu + 1/mu' as one system of equations, on the nodes and off them."""
    asked = ask([0.9], [1], 1e-9, nodes=3)
    work = mixed.make_mixing(either_form, asked)
    low, narrow = work.low, work.narrow
    work.converge_roughly(narrow.nodes, low.zeros((1,), np.int32), None)
    K = work.make_K()
    matrix = download_stack(low, K)[0].T
    for rows in (narrow.nodes, narrow.off):
        count, n, ld = rows.phi.rows, work.n, rows.H.ld
        r = np.zeros((1, n, ld))
        r[0, :, :count] = np.random.default_rng(count).normal(size=(n, count))
        row, column = (either_form.download(one.signed_mu) for one in (rows, narrow.nodes))
        row, column = np.abs(row[:count, None]), column[None, :n]
        share = 0.5 * column * row / (row + np.abs(column))
        mirror = rows is narrow.nodes

        def apply(d: np.ndarray, share: np.ndarray = share, mirror: bool = mirror) -> np.ndarray:
            product = d @ matrix
            return share * (product + product.T if mirror else product)

        units = np.eye(count * n).reshape(-1, count, n)
        system = np.eye(count * n) - np.stack([apply(unit).ravel() for unit in units], axis=1)
        expected = np.linalg.solve(system, r[0, :, :count].T.ravel()).reshape(count, n)
        d = low.zeros((1, n, ld))
        work.correct(rows, low.upload(r), d, K, low.constant(asked[0]))
        gap = np.abs(low.download(d)[0, :, :count].T - expected).max() / np.abs(expected).max()
        assert gap < 10 * mixed.PROPER


def test_renewed_rows(either_form: Any) -> None:
    """H = +-phi + R phi on the nodes, from R at random."""
    asked = ask([0.9], [0], 1e-9, nodes=3)
    work = mixed.make_mixing(either_form, asked)
    wide = work.wide
    count_E, count_F = either_form.download(wide.counts)[0]
    phi = either_form.download(wide.nodes.phi.data)[
        0, : count_E + count_F
    ]  # (column, row) of nodes, then of the others
    for rows in (wide.nodes, wide.off):
        n, ld = work.n, rows.H.ld
        R = np.zeros((1, n, ld))
        R[0, :, : rows.phi.rows] = np.random.default_rng(0).normal(size=(n, rows.phi.rows))
        data = either_form.upload(R)
        stack = Stack(data, rows.phi.rows, n, ld, n * ld)
        Y = Stack(either_form.zeros((1, n, ld)), rows.phi.rows, n, ld, n * ld)
        work.renew(either_form, rows, stack, Y, either_form.constant(asked[0]))
        found = either_form.download(rows.H.data)[0, : count_E + count_F, : rows.phi.rows]
        signs = np.where(np.arange(count_E + count_F) < count_E, 1.0, -1.0)[:, None]
        first = rows.phi.first
        expected = signs * phi[:, first : first + rows.phi.rows] + phi[:, :n] @ R[0, :, : rows.phi.rows]
        assert_close(found, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())


class TestCalls:
    def test_a_brdf(self, opencl: Any) -> None:
        """To the accuracy asked for; what has a bottom is solved in doubles, to the same bits."""
        gold = vrte.spheres("gold", radius_um=0.2, wavelength_um=0.64)
        asked = {"mu_i": [0.1, 0.6, 1.0], "mu_o": [0.2, 0.9], "phi": [0.0, 70.0], "nodes": 12, "backend": "opencl"}
        endless = vrte.Scene([vrte.Layer.of(gold, thickness=np.inf)])
        exact, found = vrte.brdf(endless, **asked, accuracy=1e-12), vrte.brdf(endless, **asked, precision="mixed")
        assert np.abs(found.mueller - exact.mueller).max() < 1e-8 * exact.mueller[..., 0, 0].max()
        made = found.diagnostics
        assert (made["precision"], made["precision_rule"], made["orders_doubted"]) == ("mixed", "asked for", 0)
        assert made["residual_of_invariance"] < 1e-8
        thick = vrte.Scene([vrte.Layer.of(gold, thickness=2.0)])
        pair = [vrte.brdf(thick, **asked, precision=one).mueller for one in ("mixed", "double")]
        assert (pair[0] == pair[1]).all()


class TestRule:
    CARD = device.Device("Maker", "Card", "gpu", True, 1 << 33, 1 << 31, 40, "1")

    @pytest.mark.parametrize(("ratio", "precision"), [(2.0, "double"), (32.0, "mixed")])
    def test_slow_doubles(self, ratio: float, precision: str, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(rules, "measure_ratio", lambda session: ratio)
        rule = f"doubles take {ratio:.2g} times as long as floats here"
        assert rules.choose_precision("auto", 1e-8, self.CARD, lambda: None) == (precision, rule)

    def test_processors_have_quick_doubles(self) -> None:
        processor = replace(self.CARD, kind="cpu")
        assert rules.choose_precision("auto", 1e-3, processor) == ("double", "a processor's doubles are quick")

    def test_doubles_are_timed(self, opencl: Any, monkeypatch: pytest.MonkeyPatch) -> None:
        """On a processor a double takes twice the room of a float, and no more than that."""
        monkeypatch.setattr(rules, "TIMED", (1 << 11, 64))
        monkeypatch.setattr(opencl, "constants", {})
        assert 0.5 < rules.measure_ratio(opencl) < rules.SLOW or not opencl.on_host

    def test_a_device_without_doubles_cannot_mix(self) -> None:
        with pytest.raises(vrte.DeviceError, match="Card has no doubles, which precision 'mixed' needs"):
            rules.choose_precision("mixed", 1e-8, replace(self.CARD, double_precision=False))
