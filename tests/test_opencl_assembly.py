"""E and F, with what leads out of and into the nodes, on a device against those of the compiled core."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from vrte import _core
from vrte.basics.running import ThreadTeam
from vrte.cl import assembly

from .helpers import assert_close

ALL = (0, 1, 2, 3)
SETS = [(0,), (3,), (0, 1), (1, 2), (2, 3), (0, 3), ALL]


def directions_and_weights(n_node: int, others: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes on (0, 1), then other cosines; the nodes' weights."""
    nodes, weights = np.polynomial.legendre.leggauss(n_node)
    others_there = np.random.default_rng(n_node).uniform(0.01, 1.0, others)
    return np.concatenate([(nodes + 1.0) / 2.0, others_there]), weights / 2.0


def largest_gap(found: np.ndarray, expected: np.ndarray) -> float:
    """Relative to the largest."""
    return float(np.abs(found - expected).max() / max(np.abs(expected).max(), 1e-300))


MATRICES = ("E", "F", "G_E", "G_F", "source_s", "source_d")


def assembled_by_both(
    either_form: Any, stokes: Sequence[int], orders: np.ndarray, n_node: int, n_out: int, n_in: int, n_term: int
) -> list[tuple[np.ndarray, np.ndarray]]:
    """What the device and what the core makes of three materials, the second one clear, the last one of few terms."""
    rng = np.random.default_rng(n_term)
    directions, weights = directions_and_weights(n_node, n_out + n_in)
    terms = np.array([n_term, n_term, (n_term + 1) // 2], np.int32)
    given = {
        "orders": orders,
        "members": np.array(stokes, np.int32),
        "coefficients": rng.normal(size=(3, n_term, 6)),
        "terms": terms,
        "albedo": np.array([0.9, 0.0, 0.4]),
        "directions": directions,
        "weights": weights,
        "n_out": n_out,
    }
    n, out, into = (len(stokes) * size for size in (n_node, n_out, n_in))
    shapes = [(n, n), (n, n), (n, out), (n, out), (into, n), (into, n)]
    found, expected = ([np.full((orders.size, 3, *shape), np.nan) for shape in shapes] for _ in range(2))
    for kernel, arrays in ((_core.assemble, expected), (assembly.assemble_arrays, found)):
        session = () if kernel is _core.assemble else (either_form,)
        crew = ThreadTeam(2, np.zeros(2), np.zeros(1, np.int32))
        kernel(*session, crew, **given, **dict(zip(MATRICES, arrays, strict=True)))
        assert crew.seconds.sum() > 0.0
    return list(zip(found, expected, strict=True))


@pytest.mark.parametrize("stokes", SETS)
@pytest.mark.parametrize("n_node", [1, 3, 7])
def test_assembly(either_form: Any, stokes: Sequence[int], n_node: int) -> None:
    orders = np.array([0, 1, 2, 4, 7, 8, 11], np.int32)
    for found, expected in assembled_by_both(either_form, stokes, orders, n_node, 2, 3, 9):
        assert largest_gap(found, expected) < 1e-14


@pytest.mark.parametrize(("n_out", "n_in"), [(0, 1), (1, 0), (5, 4)])
def test_assembly_of_many_nodes(either_form: Any, n_out: int, n_in: int) -> None:
    for found, expected in assembled_by_both(either_form, ALL, np.array([0, 1, 30, 40], np.int32), 40, n_out, n_in, 80):
        assert found.size == 0 or largest_gap(found, expected) < 2e-14


def test_items_are_pairs_of_order_and_material(either_form: Any) -> None:
    """Those listed, in any order, and nothing else."""
    rng = np.random.default_rng(3)
    directions, weights = directions_and_weights(5, 3)
    coefficients, terms = rng.normal(size=(2, 6, 6)), np.array([6, 4], np.int32)
    order, material = np.array([3, 0, 1, 0], np.int32), np.array([0, 1, 1, 0], np.int32)
    upload = either_form.upload
    what = [upload(values) for values in (coefficients, terms, np.array([0.8, 0.6]), directions, weights)]

    def matrices_of(items: Sequence[int]) -> np.ndarray:
        listed = upload(np.array(items, np.int32))
        made = assembly.assemble(either_form, listed, upload(order), upload(material), ALL, *what, 1)
        return np.array(assembly.download_stack(either_form, made.E)[list(items)])

    whole = matrices_of([0, 1, 2, 3])
    assert (matrices_of([2, 0]) == whole[[2, 0]]).all()
    E = np.empty((2, 2, 20, 20))
    rest = [np.empty((2, 2, *shape)) for shape in [(20, 20), (20, 4), (20, 4), (8, 20), (8, 20)]]
    _core.assemble(
        ThreadTeam(1, np.zeros(1), np.zeros(1, np.int32)),
        orders=np.array([0, 1], np.int32),
        members=np.array(ALL, np.int32),
        coefficients=coefficients,
        terms=terms,
        albedo=np.array([0.8, 0.6]),
        directions=directions,
        weights=weights,
        n_out=1,
        **dict(zip(MATRICES, (E, *rest), strict=True)),
    )
    assert_close(whole[[3, 1, 2]], E[[0, 0, 1], [0, 1, 1]], rtol=0.0, atol=1e-13)
