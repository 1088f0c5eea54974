"""Semi-infinite layers by invariance on a device against the compiled core."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from vrte import _core
from vrte.basics.running import ThreadTeam
from vrte.cl import invariance

from .helpers import assert_close
from .test_opencl_assembly import ALL, SETS, directions_and_weights, largest_gap

N_OUT, N_IN = 2, 3


@dataclass
class Answer:
    """The arrays that `reflect_semi_infinite` fills."""

    up: np.ndarray
    on_nodes: np.ndarray
    residual: np.ndarray
    steps: np.ndarray


def some_coefficients(terms: int) -> np.ndarray:
    """Of a strength that a scene can have, b2 and all others at random."""
    degree = np.arange(terms)[:, None]
    found = np.random.default_rng(terms).normal(size=(terms, 6)) * (2 * degree + 1) * 0.8**degree / 3.0
    found[0, 0] = 1.0
    return found


def by_both(
    either_form: Any,
    stokes: Sequence[int],
    orders: Sequence[int],
    n_node: int,
    terms: int,
    tolerance: float = 1e-15,
    albedo: float = 0.7,
) -> tuple[Answer, Answer]:
    """The device's answer and the core's."""
    directions, weights = directions_and_weights(n_node, N_OUT + N_IN)
    S, count = len(stokes), len(orders)
    columns = np.random.default_rng(S).normal(size=(2, S))
    given = {
        "orders": np.array(orders, np.int32),
        "members": np.array(stokes, np.int32),
        "coefficients": some_coefficients(terms),
        "terms": terms,
        "albedo": albedo,
        "directions": directions,
        "weights": weights,
        "out": np.array([1, 0], np.int32),
        "into": np.array([2, 4, 3], np.int32),
        "columns": columns,
        "tolerance": tolerance,
        "halves": True,
    }
    answers = []
    for kernel, session in (
        (invariance.reflect_semi_infinite_arrays, [either_form]),
        (_core.reflect_semi_infinite, []),
    ):
        answer = Answer(
            np.full((count, N_IN, 2, S * N_OUT), np.nan),
            np.full((count, 2 * N_IN, S * n_node), np.nan),
            np.full(count, np.nan),
            np.full(count, -1, np.int32),
        )
        kernel(*session, ThreadTeam(2, np.zeros(2), np.zeros(1, np.int32)), **given, **vars(answer))
        answers.append(answer)
    return answers[0], answers[1]


@pytest.mark.parametrize("stokes", SETS)
@pytest.mark.parametrize("n_node", [1, 3, 7])
def test_fixed_points(either_form: Any, stokes: Sequence[int], n_node: int) -> None:
    found, expected = by_both(either_form, stokes, [0, 1, 2, 5, 8, 10], n_node, 9)
    assert largest_gap(found.up, expected.up) < 1e-13
    assert largest_gap(found.on_nodes, expected.on_nodes) < 1e-13
    assert (found.residual < 1e-12).all()  # both stop where rounding leaves no more to gain


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-9])
def test_it_takes_the_steps_that_the_core_takes(either_form: Any, tolerance: float) -> None:
    """The last order has nothing to scatter."""
    found, expected = by_both(either_form, ALL, [1, 2, 3, 4, 5, 9], 12, 9, tolerance, 0.9)
    assert (found.steps == expected.steps).all()
    assert_close(found.residual, expected.residual, rtol=1e-3, atol=1e-14)
    assert largest_gap(found.up, expected.up) < 1e-11
    assert largest_gap(found.on_nodes, expected.on_nodes) < 1e-11


def test_a_clear_layer_sends_nothing_back(either_form: Any) -> None:
    found, expected = by_both(either_form, ALL, [0, 1], 4, 9, albedo=0.0)
    assert not found.up.any()
    assert not found.on_nodes.any()
    assert (found.residual == expected.residual).all()
    assert (found.steps == expected.steps).all()


def test_an_item_does_not_depend_on_the_others(either_form: Any) -> None:
    """Nor on a material or a tolerance that is not its own."""
    upload, stokes = either_form.upload, ALL
    directions, weights = directions_and_weights(5, 2)
    coefficients = np.stack([some_coefficients(7), 0.5 * some_coefficients(7)])
    order, material = np.array([4, 0, 1, 2], np.int32), np.array([0, 1, 0, 1], np.int32)
    pairs = upload(order), upload(material)
    shared = [
        upload(values)
        for values in (
            *(coefficients, np.array([7, 5], np.int32), np.array([0.9, 0.6]), directions, weights),
            *(np.zeros(1, np.int32), np.ones(1, np.int32), np.eye(4), np.array([1e-3, 1e-12, 1e-6, 1e-9])),
        )
    ]

    def light(items: Sequence[int]) -> tuple[np.ndarray, ...]:
        found = invariance.reflect_semi_infinite(
            either_form, upload(np.array(items, np.int32)), *pairs, stokes, *shared
        )
        return tuple(
            either_form.download(a)[list(items)] for a in (found.up, found.on_nodes, found.residual, found.steps)
        )

    whole = light([0, 1, 2, 3])
    for items in ([3], [2, 0], [1, 3, 2]):
        for part, complete in zip(light(items), whole, strict=True):
            assert (part == complete[items]).all()
    assert (whole[2] <= [1e-3, 1e-12, 1e-6, 1e-9]).all()


def test_it_ends_when_told(either_form: Any) -> None:
    upload = either_form.upload
    directions, weights = directions_and_weights(3, 1)
    one, place = upload(np.zeros(1, np.int32)), upload(np.zeros(1, np.int32))
    scene = upload(some_coefficients(5)[None]), upload(np.array([5], np.int32)), upload(np.array([0.999]))
    rest = upload(directions), upload(weights), place, place, upload(np.eye(1)), upload(np.array([1e-15]))
    steps = [
        int(
            either_form.download(
                invariance.reflect_semi_infinite(either_form, one, one, one, (0,), *scene, *rest, stop).steps
            )[0]
        )
        for stop in (np.ones(1, np.int32), np.zeros(1, np.int32))
    ]
    assert steps[0] < steps[1]
