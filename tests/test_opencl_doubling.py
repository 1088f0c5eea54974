"""Doubling on a device: what tests/test_engines.py does not see of it."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from vrte.basics.running import Run
from vrte.cl import steps
from vrte.cl.doubling import double_slabs as double_on_device
from vrte.cl.session import Session
from vrte.discrete_ordinates.orders.doubling import Slabs, double_slabs
from vrte.discrete_ordinates.orders.phase_assembly import assemble
from vrte.discrete_ordinates.orders.slabs import SlabStack, cut_layers

from .opencl_scenes import SCENES, kernels_with, problem_of

ORDERS = np.array([0, 1, 3], np.int32)


def doubled(pile: SlabStack, orders: np.ndarray, kernels: Any) -> Slabs:
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


@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize("name", ["conservative over white", "semi-infinite", "semi-infinite and dark", "three kinds"])
def test_steps_in_one_launch_are_those_of_a_launch_each(
    either_form: Any, name: str, precision: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To the last bit, with fewer launches, wherever the list is cut."""
    session = either_form.in_precision(precision)
    pile, kernels = cut_layers(problem_of(SCENES[name], 5)), kernels_with(session, double_slabs=double_on_device)

    def solve() -> tuple[Slabs, int]:
        before = session.traffic.launches
        return doubled(pile, ORDERS, kernels), session.traffic.launches - before

    together, few = solve()
    monkeypatch.setattr(steps, "LONGEST", 1e-7)
    cut, some = solve()
    monkeypatch.setattr(session, "at_once", False)
    apart, many = solve()
    assert few < some < many
    assert few < 0.5 * many
    for found in (together, cut):
        for one in ("R", "T", "lost", "residual", "doublings"):
            np.testing.assert_array_equal(getattr(found, one), getattr(apart, one))


def test_one_launch_is_for_many_items_or_little_work(opencl: Session) -> None:
    units = opencl.units
    assert steps.is_quicker_fused(opencl, 1, 1e4)
    assert steps.is_quicker_fused(opencl, 3 * units, 1e12)
    assert not steps.is_quicker_fused(opencl, 3 * units + 1, 1e12) or units == 1


def test_slow_doubles_make_one_launch_dear() -> None:
    """A unit of an RTX 4090 has a 60th of an H100's doubles, but its floats."""
    pyopencl = pytest.importorskip("pyopencl")

    def describe(architecture: tuple[int, int], precision: str) -> Any:
        major, minor = architecture
        device = SimpleNamespace(
            type=pyopencl.device_type.GPU,
            max_clock_frequency=2000,
            compute_capability_major_nv=major,
            compute_capability_minor_nv=minor,
        )
        return SimpleNamespace(device=device, form="gpu", precision=precision, units=130)

    assert steps.find_rate(describe((8, 9), "double")) < 0.1 * steps.find_rate(describe((9, 0), "double"))
    assert steps.find_rate(describe((8, 9), "single")) == steps.find_rate(describe((9, 0), "single"))
    assert steps.is_quicker_fused(describe((9, 0), "double"), 120, 1e8)
    assert not steps.is_quicker_fused(describe((8, 9), "double"), 120, 1e8)


def test_what_was_put_off_is_done_before_anything_else(opencl: Session) -> None:
    """A read, a launch and a wait alike."""
    for ask in (opencl.finish, lambda: opencl.download(opencl.upload(np.ones(3)))):
        done: list[int] = []
        opencl.waiting.append(lambda done=done: done.append(1))
        ask()
        assert done == [1]
        assert not opencl.waiting


def test_stops_when_asked(opencl: Session) -> None:
    pile, run = (
        cut_layers(problem_of(SCENES["thick"], 6)),
        Run(1, kernels=kernels_with(opencl, double_slabs=double_on_device)),
    )
    matrices = assemble(pile.problem, ORDERS, Run(1))
    run.stop[0] = 1
    with pytest.raises(KeyboardInterrupt):
        double_slabs(pile.problem, pile.material, pile.thickness, ORDERS, matrices, run)
