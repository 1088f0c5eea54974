"""Batches that several devices share: the same light as from one, and one sentence where a device fails."""

import threading
import time
from dataclasses import replace
from typing import Any

import numpy as np
import pyopencl
import pytest

import vrte
from vrte.basics.errors import DeviceError
from vrte.basics.running import Run
from vrte.cl import device
from vrte.cl.device import Device, choose, select_output
from vrte.cl.session import Session
from vrte.discrete_ordinates.execution import carry_out, share_devices
from vrte.discrete_ordinates.execution.engines import opencl

ASKED: dict[str, Any] = {"mu_i": [0.3, 0.8], "mu_o": [0.2, 0.9], "phi": [0.0, 70.0], "nodes": 6, "backend": "opencl"}
CARD = Device("Maker", "Card", "gpu", True, 1 << 33, 1 << 31, 10, "1")
BOARD = Device("Other", "Board", "gpu", True, 1 << 33, 1 << 31, 30, "1")
FLOAT = Device("Other", "Small", "gpu", False, 1 << 33, 1 << 31, 30, "1")


def scenes(count: int = 5) -> list[vrte.Scene]:
    return [vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.5 + 0.1 * k, np.inf)]) for k in range(count)]


@pytest.fixture
def both(opencl: Session, alone: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> tuple[Device, Device]:
    """The device that computes here under two names, a session each."""
    chosen = device.find_chosen_device()
    found = chosen, replace(chosen, name="The second")
    alone["devices"] = found
    monkeypatch.setattr(device, "_find_devices", lambda: found)
    monkeypatch.setenv(device.VARIABLE, "0,1")
    monkeypatch.setattr(share_devices, "_speeds", {})
    return found


class TestChoice:
    def test_several_by_index_and_name(self) -> None:
        assert select_output([CARD, BOARD, FLOAT], "board, 0") == [1, 0]
        assert choose([CARD, BOARD], "0,1") == (0, "VRTE_OPENCL_DEVICE=0,1; batches are shared by 0, 1")

    def test_all_are_those_as_precise_as_the_best(self) -> None:
        assert select_output([CARD, BOARD, FLOAT], "all") == [1, 0]
        assert select_output([CARD, BOARD, FLOAT], "ALL", lambda index: "no" if index == 1 else "") == [0]

    @pytest.mark.parametrize(
        ("asked_for", "complaint"),
        [("0,0", "names a device twice"), ("0,7", "fits no OpenCL device"), ("0,", "fits no OpenCL device")],
    )
    def test_what_it_cannot_mean(self, asked_for: str, complaint: str) -> None:
        with pytest.raises(DeviceError, match=f"VRTE_OPENCL_DEVICE={asked_for} {complaint}"):
            select_output([CARD, BOARD], asked_for)

    def test_one_that_does_not_compute(self) -> None:
        with pytest.raises(DeviceError, match="names a device that does not compute: it fails"):
            select_output([CARD, BOARD], "0,1", lambda index: "it fails" if index else "")


class TestShares:
    def test_by_speed(self) -> None:
        assert share_devices.share_out(12, [10.0, 30.0]) == [3, 9]
        assert sum(share_devices.share_out(7, [1.0, 1.0, 1.0])) == 7

    def test_what_was_measured_comes_before_what_is_guessed(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(share_devices, "_speeds", {("Maker", "Card"): 5.0})
        assert share_devices.find_speeds([CARD, BOARD]) == [CARD.rate, BOARD.rate]
        share_devices._speeds["Other", "Board"] = 1.0
        assert share_devices.find_speeds([CARD, BOARD]) == [5.0, 1.0]


class TestSolve:
    @pytest.mark.slow
    def test_the_same_light_as_from_one(self, both: tuple[Device, Device], monkeypatch: pytest.MonkeyPatch) -> None:
        told: list[tuple[int, int]] = []
        found = vrte.brdfs(scenes(), **ASKED, progress=lambda done, total: told.append((done, total)))
        assert {each.diagnostics["device"] for each in found} == {each.name for each in both}
        assert told[-1][0] == told[-1][1] == 500
        assert sorted(done for done, _ in told) == [done for done, _ in told]
        monkeypatch.setenv(device.VARIABLE, device.read_wanted_device().split(",")[0])
        for each, right in zip(found, vrte.brdfs(scenes(), **ASKED), strict=True):
            np.testing.assert_array_equal(each.mueller, right.mueller)

    @pytest.mark.slow
    def test_one_scene_goes_to_the_first(self, both: tuple[Device, Device]) -> None:
        assert vrte.brdf(scenes(1)[0], **ASKED).diagnostics["device"] == both[0].name

    @pytest.mark.slow
    def test_a_device_that_fails(self, both: tuple[Device, Device], monkeypatch: pytest.MonkeyPatch) -> None:
        with device.take_device(device.devices().index(both[1])):
            second = device.session()

        def fail(*_: Any, **__: Any) -> None:
            code = pyopencl.status_code.DEVICE_NOT_AVAILABLE
            raise pyopencl.LogicError(pyopencl._cl._ErrorRecord("clEnqueueNDRangeKernel", code, ""))

        monkeypatch.setattr(second, "launch", fail)
        with pytest.raises(DeviceError, match=r"which shared the work: the OpenCL device was lost") as raised:
            vrte.brdfs(scenes(), **ASKED)
        assert str(raised.value).startswith(f"{both[1].name} ({both[1].platform})")
        assert len(vrte.brdfs(scenes(), **ASKED)) == 5

    @pytest.mark.slow
    def test_ctrl_c_reaches_all(self, both: tuple[Device, Device], monkeypatch: pytest.MonkeyPatch) -> None:
        begun = threading.Barrier(3)
        whole = carry_out.carry_out_batch

        def slow(plans: Any, engine: Any, run: Any, steps: Any) -> Any:
            begun.wait(10.0)
            while not run.stop[0]:
                time.sleep(0.01)
            return whole(plans, engine, run, steps)

        monkeypatch.setattr(carry_out, "carry_out_batch", slow)
        plans: list[Any] = [vrte.plan("brdf", scene, **ASKED) for scene in scenes()]
        run = Run(2)
        stopping = threading.Thread(target=lambda: (begun.wait(10.0), run.stop.__setitem__(0, 1)))
        stopping.start()
        with pytest.raises(KeyboardInterrupt):
            share_devices.carry_out_on_devices(plans, opencl.open_engine(), run)
        stopping.join()
