"""Doubling and joining on a device against the same stages of `_core`."""

from typing import Any

import numpy as np
import pytest

from vrte.basics.running import Run
from vrte.cl.doubling import double_slabs as double_on_device
from vrte.cl.joining import join_slabs as join_on_device
from vrte.cl.session import Session
from vrte.discrete_ordinates.orders.base import expand_base
from vrte.discrete_ordinates.orders.doubling import Slabs, double_slabs
from vrte.discrete_ordinates.orders.phase_assembly import assemble
from vrte.discrete_ordinates.orders.problem import ALL
from vrte.discrete_ordinates.orders.slabs import Pile, cut, join

from .opencl_scenes import kernels_with, problem_of, scenes

ORDERS = np.array([0, 1, 3], np.int32)
SCENES = scenes()


@pytest.fixture
def session(either_form: Session) -> Session:
    """Both forms of products and inverses."""
    return either_form


def doubled(pile: Pile, orders: np.ndarray, kernels: Any) -> Slabs:
    """R and T by some kernels."""
    run = Run(1)
    matrices = assemble(pile.problem, orders, run)
    return double_slabs(pile.problem, pile.material, pile.thickness, orders, matrices, Run(1, kernels=kernels))


def close(found: np.ndarray, expected: np.ndarray, tolerance: float) -> None:
    """Relative to the largest."""
    assert np.abs(found - expected).max() <= tolerance * np.abs(expected).max()


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize(("stokes", "nodes"), [(ALL, 6), ((0, 1), 5), ((0,), 9)], ids=["IQUV", "IQ", "I"])
def test_doubling(opencl: Session, name: str, stokes: tuple[int, ...], nodes: int) -> None:
    pile = cut(problem_of(SCENES[name], nodes, stokes))
    orders = ORDERS if stokes == ALL else ORDERS[:1]
    expected = doubled(pile, orders, Run(1).kernels)
    found = doubled(pile, orders, kernels_with(opencl, double_slabs=double_on_device))
    close(found.R, expected.R, 1e-12)
    # both know T only so well where it is small and nothing absorbs: two roundings of different order
    close(found.T, expected.T, 1e-11 if name == "thick" else 1e-12)
    np.testing.assert_allclose(found.lost, expected.lost, atol=1e-13)
    np.testing.assert_array_equal(found.doublings, expected.doublings)
    assert found.residual.max() < 1e-10


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize(("stokes", "nodes"), [(ALL, 6), ((0, 1), 5)], ids=["IQUV", "IQ"])
def test_joining(opencl: Session, name: str, stokes: tuple[int, ...], nodes: int) -> None:
    pile = cut(problem_of(SCENES[name], nodes, stokes))
    orders = ORDERS if stokes == ALL else ORDERS[:1]
    slabs = doubled(pile, orders, Run(1).kernels)
    base = expand_base(SCENES[name].below, pile.problem, int(orders[-1]) + 1)
    expected = join(pile, orders, slabs, base, Run(1))
    found = join(pile, orders, slabs, base, Run(1, kernels=kernels_with(opencl, join_slabs=join_on_device)))
    for one, other in zip(found[:3], expected[:3], strict=True):
        close(one, other, 1e-12)
    assert found[3].max() < 1e-12


def test_both_forms_of_the_products(session: Session) -> None:
    pile = cut(problem_of(SCENES["three kinds"], 5))
    expected = doubled(pile, ORDERS, Run(1).kernels)
    found = doubled(pile, ORDERS, kernels_with(session, double_slabs=double_on_device))
    close(found.R, expected.R, 1e-12)
    close(found.T, expected.T, 1e-12)


def test_what_a_slab_is_does_not_depend_on_the_others(opencl: Session) -> None:
    pile = cut(problem_of(SCENES["repeated"], 5))
    kernels = kernels_with(opencl, double_slabs=double_on_device)
    together, alone = doubled(pile, ORDERS, kernels), doubled(pile, ORDERS[1:2], kernels)
    np.testing.assert_array_equal(together.R[1], alone.R[0])
    np.testing.assert_array_equal(together.T[1], alone.T[0])


def test_stops_when_asked(opencl: Session) -> None:
    pile, run = cut(problem_of(SCENES["thick"], 6)), Run(1, kernels=kernels_with(opencl, double_slabs=double_on_device))
    matrices = assemble(pile.problem, ORDERS, Run(1))
    run.stop[0] = 1
    with pytest.raises(KeyboardInterrupt):
        double_slabs(pile.problem, pile.material, pile.thickness, ORDERS, matrices, run)
