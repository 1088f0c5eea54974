"""Doubling on a device: what tests/test_engines.py does not see of it."""

from typing import Any

import numpy as np
import pytest

from vrte.basics.running import Run
from vrte.cl.doubling import double_slabs as double_on_device
from vrte.cl.session import Session
from vrte.discrete_ordinates.orders.doubling import Slabs, double_slabs
from vrte.discrete_ordinates.orders.phase_assembly import assemble
from vrte.discrete_ordinates.orders.slabs import Pile, cut_layers

from .opencl_scenes import kernels_with, problem_of, scenes

ORDERS = np.array([0, 1, 3], np.int32)
SCENES = scenes()


def doubled(pile: Pile, orders: np.ndarray, kernels: Any) -> Slabs:
    """R and T by some kernels."""
    run = Run(1)
    matrices = assemble(pile.problem, orders, run)
    return double_slabs(pile.problem, pile.material, pile.thickness, orders, matrices, Run(1, kernels=kernels))


def test_what_a_slab_is_does_not_depend_on_the_others(opencl: Session) -> None:
    pile = cut_layers(problem_of(SCENES["repeated"], 5))
    kernels = kernels_with(opencl, double_slabs=double_on_device)
    together, alone = doubled(pile, ORDERS, kernels), doubled(pile, ORDERS[1:2], kernels)
    np.testing.assert_array_equal(together.R[1], alone.R[0])
    np.testing.assert_array_equal(together.T[1], alone.T[0])


def test_stops_when_asked(opencl: Session) -> None:
    pile, run = (
        cut_layers(problem_of(SCENES["thick"], 6)),
        Run(1, kernels=kernels_with(opencl, double_slabs=double_on_device)),
    )
    matrices = assemble(pile.problem, ORDERS, Run(1))
    run.stop[0] = 1
    with pytest.raises(KeyboardInterrupt):
        double_slabs(pile.problem, pile.material, pile.thickness, ORDERS, matrices, run)
