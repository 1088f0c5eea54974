"""What the owner of a new device runs first: it passes here, and a spoiled kernel is noticed."""

import os
from dataclasses import replace
from typing import Any

import pytest

from vrte.basics.errors import DeviceError
from vrte.cl import device
from vrte.cl.session import Session, open_session
from vrte.commands import verify_device

from .helpers import run

QUICK = "products and inverses", "less memory than they need", "stopped midway, then solved again"


def spoil(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """A kernel that does nothing."""

    def opened(handle: Any, precision: str) -> Session:
        session = open_session(handle, precision=precision)
        assert session.kernels[name]  # whose work-groups a launch asks for
        session.kernels[name] = lambda *_: None
        return session

    monkeypatch.setattr(verify_device, "open_session", opened)


def test_a_small_set_passes_and_a_spoiled_kernel_is_noticed(opencl: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    reported, begun = list[str](), list[str]()
    assert verify_device.verify_device(None, reported.append, begun.append, wanted=QUICK) == ""
    own = device.find_chosen_device()
    assert own.name in reported[0]
    assert own.driver in reported[0]
    assert [line.split("  ")[1] for line in reported[1:4]] == list(QUICK)
    assert "3 of 3 checks passed" in reported[4]
    assert len(begun) == 4
    spoil(monkeypatch, "product")
    complaint = verify_device.verify_device(None, reported.append, wanted=QUICK[:1])
    assert "is not to be trusted: products and inverses: differs by" in complaint
    assert any("<- WRONG" in line for line in reported)
    assert not verify_device.Check("?", float("nan"), 1e-10, 0.0).passed


def test_what_there_is_no_time_for_and_no_such_device(opencl: Session) -> None:
    reported: list[str] = []
    complaint = verify_device.verify_device(None, reported.append, seconds=0.0)
    assert "is not verified: there was no time for any check" in complaint
    assert reported[-1].startswith("  left out for want of time: products and inverses")
    assert reported[-1].count("; ") == 13
    with pytest.raises(DeviceError, match="there is no OpenCL device 99: 0 = "):
        verify_device.verify_device(99)


@pytest.mark.slow
def test_all_of_it(opencl: Session, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Every kernel is launched. However busy the machine is, there is time for all."""
    usual = verify_device.verify_device.__defaults__
    monkeypatch.setattr(verify_device.verify_device, "__defaults__", (*usual[:3], 900.0, ()))
    index = device.devices().index(device.find_chosen_device())
    assert run("devices", "--verify", str(index)) == 0
    output = capsys.readouterr()
    assert "14 of 14 checks passed" in output.out
    assert "never launched" not in output.out
    assert output.err.count(" ...") == 15


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["double_slabs", "join_slabs", "invariance_converge", "add_orders", "add_scattering", "times_coefficients"]
)
def test_each_kernel_matters(
    opencl: Session, name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil(monkeypatch, name)
    assert run("devices", "--verify") == 1
    output = capsys.readouterr()
    assert "<- WRONG" in output.out
    assert "is not to be trusted" in output.err


@pytest.mark.slow
def test_a_device_without_doubles(opencl: Session, alone: dict[str, Any]) -> None:
    """In floats, all that goes without doubles."""
    alone.update(process=os.getpid(), devices=(replace(device.find_chosen_device(), double_precision=False),))
    reported: list[str] = []
    assert verify_device.verify_device(None, reported.append) == ""
    assert "no doubles" in reported[0]
    names = {line[2:54].strip() for line in reported}
    assert names >= {"products and inverses", "twelve depths", *QUICK}
