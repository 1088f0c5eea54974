"""Which device is taken, and what is said where there is none or where it fails."""

import os
import re
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pyopencl
import pytest

import vrte
from vrte import cli
from vrte.basics.errors import DeviceError, MissingExtraError
from vrte.cl import building, device, errors, probe
from vrte.cl import session as sessions
from vrte.cl.device import Device, choose
from vrte.cl.errors import check_room
from vrte.cl.session import Session, open_session
from vrte.commands import device_speed as report

from .conftest import working_session
from .helpers import assert_close, close_to


def made(name: str, kind: str, gigabytes: float, fp64: bool = True, platform: str = "Maker", **more: Any) -> Device:
    """A device that nobody has."""
    units = more.pop("units", 8)
    return Device(platform, name, kind, fp64, int(gigabytes * 1e9), int(gigabytes * 2.5e8), units, "1.0", **more)


PROCESSOR = made("Processor X", "cpu", 128.0, platform="Portable")
SMALL, LARGE, OTHER = (
    made("Card S", "gpu", 8.0),
    made("Card L", "gpu", 4.0, units=16),
    made("Board", "accelerator", 200.0),
)
BY_POCL = made("Processor X", "cpu", 4.0, platform=probe.POCL)
FLOAT = made("Card F", "gpu", 32.0, fp64=False)
BUILT_IN = made("Graphics", "gpu", 48.0, units=96, clock=2.2e9, shared=True, architecture="gfx1150")
CONSUMER = made("RTX 4090", "gpu", 24.0, units=128, clock=2.52e9, architecture="sm_89")
OLDER = made("A100", "gpu", 16.0, units=108, clock=1.41e9, architecture="sm_80")


@pytest.fixture
def reopening(opencl: Session, alone: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The same, and what is opened has a queue and memory of its own, but kernels that are compiled already."""

    def opened(handle: Any) -> Session:
        queue = pyopencl.CommandQueue(opencl.context)
        kernels = building.Kernels(opencl.kernels.program, sessions.read_sources())
        return Session(opencl.context, queue, kernels, sessions._make_memory_pool(queue), opencl.form)

    alone.update(process=os.getpid(), devices=(device.find_chosen_device(),))
    monkeypatch.setattr(device, "open_session", opened)
    return alone


class TestChoice:
    @pytest.mark.parametrize(
        ("found", "taken", "reason"),
        [
            ([PROCESSOR], 0, "the only device"),
            ([PROCESSOR, SMALL], 1, "the only GPU"),
            ([PROCESSOR, SMALL, LARGE, OTHER], 2, "the fastest GPU, about 6.4e+10 operations a second in doubles"),
            ([PROCESSOR, LARGE, LARGE], 1, "the first GPU"),
            ([BUILT_IN, CONSUMER], 1, "the only GPU with memory of its own"),
            ([BUILT_IN, PROCESSOR], 0, "the only GPU"),
            ([BUILT_IN, BUILT_IN], 0, "the first GPU"),
            ([CONSUMER, OLDER, BUILT_IN], 1, "the fastest GPU, about 9.7e+12 operations a second in doubles"),
            ([PROCESSOR, OTHER], 1, "the only accelerator"),
            ([FLOAT, PROCESSOR], 1, "the only CPU"),
            ([made("?", "other", 500.0), PROCESSOR], 1, "the only CPU"),
            ([PROCESSOR, BY_POCL], 1, "the CPU by PoCL, the faster driver"),
            ([BY_POCL, PROCESSOR, SMALL], 2, "the only GPU"),
        ],
    )
    def test_the_rule(self, found: list[Device], taken: int, reason: str) -> None:
        assert choose(found) == (taken, reason)

    @pytest.mark.parametrize(
        ("asked_for", "taken"), [("0", 0), ("2", 2), ("card l", 2), ("PROCESSOR", 0), ("portable", 0), ("5s", 1)]
    )
    def test_the_variable_wins(self, asked_for: str, taken: int) -> None:
        found = [PROCESSOR, made("Card 5s", "gpu", 8.0), made("Card L", "gpu", 24.0)]
        assert choose(found, asked_for) == (taken, f"VRTE_OPENCL_DEVICE={asked_for}")

    @pytest.mark.parametrize(
        ("asked_for", "complaint"),
        [
            ("7", "fits no OpenCL device"),
            ("-1", "fits no OpenCL device"),
            ("nonesuch", "fits no OpenCL device"),
            ("card", "fits more than one OpenCL device"),
        ],
    )
    def test_what_it_cannot_mean(self, asked_for: str, complaint: str) -> None:
        with pytest.raises(DeviceError, match=complaint) as raised:
            choose([PROCESSOR, SMALL, FLOAT], asked_for)
        assert str(raised.value).endswith(
            ": 0 = Processor X (Portable), 1 = Card S (Maker), 2 = Card F (Maker, no fp64)"
        )

    @pytest.mark.parametrize(
        ("architecture", "units", "clock", "teraflops"),
        [("sm_90", 132, 1.98e9, 33.5), ("sm_80", 108, 1.41e9, 9.7), ("gfx942:sramecc+", 304, 2.1e9, 81.7)],
    )
    def test_rates_of_data_sheets(self, architecture: str, units: int, clock: float, teraflops: float) -> None:
        found = made("?", "gpu", 80.0, units=units, clock=clock, architecture=architecture).rate
        assert found == close_to(1e12 * teraflops, rtol=0.01, atol=0.0)

    def test_doubles_come_first(self) -> None:
        assert choose([FLOAT, PROCESSOR]) == (1, "the only CPU")
        assert choose([FLOAT]) == (0, "the only device, without doubles")
        assert choose([PROCESSOR, FLOAT], "card f") == (1, "VRTE_OPENCL_DEVICE=card f")

    def test_a_session_in_doubles_needs_them(self, alone: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
        alone.update(process=os.getpid(), devices=(FLOAT,), complaints={(0, FLOAT.platform, FLOAT.name): ""})
        monkeypatch.delenv(device.VARIABLE, raising=False)
        with pytest.raises(
            DeviceError, match=r"Card F computes in single precision only: 0 = Card F \(Maker, no fp64\)"
        ):
            device.session()


class TestDevices:
    def test_what_they_say_of_themselves(self) -> None:
        for found in device.devices():
            assert found.kind in device.PREFERENCE
            assert found.memory >= found.largest > 0
            assert found.units > 0
            assert found.name
            assert found.platform
        assert device.find_chosen_device().double_precision

    @pytest.mark.parametrize(("extensions", "doubles"), [("cl_khr_icd", False), ("cl_khr_icd cl_khr_fp64", True)])
    def test_a_driver_that_fails_when_asked(self, extensions: str, doubles: bool) -> None:
        class Silent:
            name, driver_version, type, available = "Card ", "1 ", pyopencl.device_type.GPU, True
            global_mem_size, max_mem_alloc_size, max_compute_units = 8 << 30, 2 << 30, 20

            def __getattr__(self, name: str) -> Any:
                raise error_of("clGetDeviceInfo", "INVALID_VALUE")

        silent = Silent()
        silent.__dict__["extensions"] = extensions
        found = device._describe_device(SimpleNamespace(name="Maker"), silent)
        assert found.double_precision is doubles
        assert (found.clock, found.shared, found.architecture) == (1e9, False, "card")

    def test_without_pyopencl(self, alone: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setitem(sys.modules, "pyopencl", None)
        with pytest.raises(MissingExtraError, match=r"OpenCL needs the extra 'opencl': pip install 'vrte\[opencl\]'"):
            device.devices()

    def test_without_a_platform(self, alone: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(pyopencl, "get_platforms", raising("clGetPlatformIDs", "PLATFORM_NOT_FOUND_KHR"))
        with pytest.raises(DeviceError, match=r"there is no OpenCL platform.*vrte\[opencl\]"):
            device.devices()

    def test_platforms_without_a_device(self, alone: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
        class Empty:
            name = "A driver "
            get_devices = staticmethod(raising("clGetDeviceIDs", "DEVICE_NOT_FOUND"))

        monkeypatch.setattr(pyopencl, "get_platforms", lambda: [Empty()])
        with pytest.raises(DeviceError, match=r"no OpenCL platform has a device \(platforms: A driver\)"):
            device.devices()

    def test_a_process_that_was_forked(self, opencl: Session, alone: dict[str, Any]) -> None:
        device.devices()
        alone["process"] = os.getpid() + 1
        with pytest.raises(DeviceError, match=r"this process was forked from one that had used OpenCL.*spawn"):
            device.session()


class TestSession:
    def test_one_for_all_threads(self, alone: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
        opened: list[Any] = []

        def slow_open(handle: Any) -> object:
            opened.append(handle)
            time.sleep(0.05)
            return object()

        monkeypatch.setattr(device, "open_session", slow_open)
        found: list[Any] = []
        threads = [threading.Thread(target=lambda: found.append(device.session())) for _ in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert len(opened) == 1
        assert len(found) == 8
        assert len(set(map(id, found))) == 1

    def test_one_for_each_choice(self, alone: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
        alone.update(process=os.getpid(), devices=(SMALL, LARGE))
        monkeypatch.setattr(probe, "try_device", lambda *_: "")
        monkeypatch.setattr(device, "open_session", lambda handle: object())
        large = device.session()
        monkeypatch.setenv(device.VARIABLE, " Card S")
        small = device.session()
        assert small is not large
        assert device.session() is small
        monkeypatch.delenv(device.VARIABLE)
        assert device.session() is large

    def test_a_form_for_each_kind(self, opencl: Session) -> None:
        assert opencl.form == ("cpu" if device.find_chosen_device().kind == "cpu" else "gpu")


def raising(routine: str, name: str) -> Callable[..., Any]:
    """Fails as OpenCL does."""

    def call(*_: Any, **__: Any) -> Any:
        raise error_of(routine, name)

    return call


def error_of(routine: str, name: str) -> Exception:
    """An error as pyopencl raises it; ``name``: of the code, or a number of a driver's own."""
    code = int(name) if name.startswith("-") else getattr(pyopencl.status_code, name)
    kind = pyopencl.MemoryError if "ALLOCATION" in name else pyopencl.LogicError
    return kind(pyopencl._cl._ErrorRecord(routine, code, ""))


class TestFaults:
    @pytest.mark.parametrize(
        ("name", "message"),
        [
            (
                "MEM_OBJECT_ALLOCATION_FAILURE",
                "ran out of memory or other resources .MEM_OBJECT_ALLOCATION_FAILURE in clX.: ask for less",
            ),
            ("OUT_OF_RESOURCES", "ran out of memory"),
            ("OUT_OF_HOST_MEMORY", "ran out of memory"),
            ("INVALID_BUFFER_SIZE", "ran out of memory"),
            ("DEVICE_NOT_AVAILABLE", "was lost on the way .DEVICE_NOT_AVAILABLE in clX.: nothing was computed"),
            ("INVALID_COMMAND_QUEUE", "was lost on the way"),
            ("EXEC_STATUS_ERROR_FOR_EVENTS_IN_WAIT_LIST", "was lost on the way"),
            ("-9999", "was lost on the way .code -9999 in clX."),
            ("INVALID_KERNEL_ARGS", "failed .INVALID_KERNEL_ARGS in clX.: nothing was computed"),
        ],
    )
    def test_each_in_one_sentence(self, name: str, message: str, alone: dict[str, Any]) -> None:
        alone["sessions"][0] = object()
        cause = error_of("clX", name)
        with pytest.raises(DeviceError, match=message) as raised, device.raise_device_errors():
            raise cause
        assert raised.value.__cause__ is cause
        assert not alone["sessions"]

    def test_others_pass(self, alone: dict[str, Any]) -> None:
        alone["sessions"][0] = kept = object()
        with pytest.raises(ZeroDivisionError), device.raise_device_errors():
            raise ZeroDivisionError
        assert alone["sessions"] == {0: kept}

    def test_after_a_lost_device_the_next_call_starts_anew(self, reopening: dict[str, Any]) -> None:
        first = device.session()
        assert first.kernels["product"]  # made, with its work-groups, before it fails
        first.kernels["product"] = raising("clEnqueueNDRangeKernel", "DEVICE_NOT_AVAILABLE")
        with pytest.raises(DeviceError, match="was lost"), device.raise_device_errors():
            first.launch("product", (1,))
        second = device.session()
        assert second is not first
        np.testing.assert_array_equal(second.download(second.upload(np.arange(3.0))), [0.0, 1.0, 2.0])

    def test_one_that_is_lost_fails_one_test(self, reopening: dict[str, Any]) -> None:
        first = working_session()
        assert working_session() is first
        first.__dict__["download"] = raising("clEnqueueReadBuffer", "DEVICE_NOT_AVAILABLE")
        second = working_session()
        assert second is not first
        assert working_session() is second

    def test_an_array_that_is_too_large(self, reopening: dict[str, Any]) -> None:
        too_large = 4 * max(found.memory for found in device.devices())
        opened = device.session()
        with pytest.raises(DeviceError, match="ran out of memory"), device.raise_device_errors():
            opened.empty((too_large // 8,))

    @pytest.mark.parametrize("on_host", [True, False])
    def test_room_is_looked_for_before(self, on_host: bool) -> None:
        card = SimpleNamespace(global_mem_size=8e9, max_mem_alloc_size=2e9, name="Card ")
        on_card: Any = SimpleNamespace(device=card, on_host=on_host)
        check_room(on_card, 7e9, 2e9)
        with pytest.raises(
            DeviceError, match=r"this needs about 7.5 GB on the OpenCL device Card, which has 8 GB: ask"
        ):
            check_room(on_card, 7.5e9)
        with pytest.raises(DeviceError, match=r"this needs an array of 2.2 GB .*, which allows 2 GB"):
            check_room(on_card, 0.0, 2.2e9)
        if on_host:
            with pytest.raises(DeviceError, match=r"this needs about 0.001 GB .*, which has 0.001 GB"):
                check_room(on_card, 1e6, host=1e6)
        else:
            check_room(on_card, 1e6, host=1e6)

    def test_kernels_that_do_not_compile(self, opencl: Session, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(
            sessions, "read_sources", lambda *_: "__kernel void broken(__global doubel* x) { x[0] = 1; }\n" * 40
        )
        with pytest.raises(DeviceError, match=r"the kernels do not compile on .*error.*doubel") as raised:
            open_session(opencl.device)
        assert "\n" not in str(raised.value)
        assert len(str(raised.value)) < 450
        assert isinstance(raised.value.__cause__, pyopencl.Error)

    def test_a_compiler_with_something_to_say(self, opencl: Session, monkeypatch: pytest.MonkeyPatch) -> None:
        text = '#warning "look here"\n__kernel void fine(__global double* x) { x[0] = 1.0; }\n'
        monkeypatch.setattr(sessions, "read_sources", lambda *_: text)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            opened = open_session(opencl.device)
        values = opened.zeros((1,))
        opened.launch("fine", (1,), values)
        assert opened.download(values) == [1.0]

    def test_kernels_that_the_compiler_left_out(self, opencl: Session, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(pyopencl.Program, "get_info", lambda *_: "product;invert")
        with pytest.raises(DeviceError, match=r"the compiler of .* left out .*, product_gpu, "):
            open_session(opencl.device)


USE_ALL_MEMORY = """
import resource
import numpy as np
from vrte.cl import device, session
session.SOURCES = ("probe",)
from vrte.basics.memory import find_address_bytes
opened = device.session()
opened.zeros((1,))
used = resource.getpagesize() * int(open("/proc/self/statm").read().split()[0])
resource.setrlimit(resource.RLIMIT_AS, (used + (400 << 20), resource.RLIM_INFINITY))
assert 200e6 < find_address_bytes() < 420e6
kept = []
try:
    with device.raise_device_errors():
        while len(kept) < 10:
            kept.append(opened.zeros(((100 << 20) // 8,)))
            opened.finish()
except device.DeviceError as error:
    print(len(kept), error)
kept.clear()
again = device.session()
print(again is opened, again.download(again.upload(np.arange(3.0))))
"""


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits a process as Linux does")
def test_memory_that_runs_out(opencl: Session) -> None:
    if not opencl.on_host:
        pytest.skip("the device has memory of its own")
    command = [sys.executable, "-c", USE_ALL_MEMORY]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    first, second = done.stdout.splitlines()
    assert 1 <= int(first.split()[0]) <= 4
    assert "the OpenCL device ran out of memory" in first
    assert second == "False [0. 1. 2.]"


class TestSolve:
    """Failures in the middle of a solve."""

    request: ClassVar[dict[str, Any]] = {"mu0": 0.6, "mu": [0.5, -0.5], "phi": [0, 90], "tau": [0.0, 1.0], "nodes": 4}
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)])

    @pytest.mark.parametrize(
        ("backend", "method"),
        [
            *(("opencl", method) for method in ("launch", "upload", "download", "empty")),
            *(
                pytest.param(backend, method, marks=pytest.mark.slow)
                for backend in ("opencl+lapack", "sequential+device")
                for method in ("launch", "upload", "download", "empty")
            ),
        ],
    )
    def test_an_error_then_a_right_answer(
        self, backend: str, method: str, reopening: dict[str, Any], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        right = vrte.radiance(self.scene, **self.request)
        original, count = getattr(Session, method), {"calls": 0, "fails at": 0}

        def counted(*arguments: Any, **named: Any) -> Any:
            count["calls"] += 1
            if count["calls"] == count["fails at"]:
                raise error_of("clX", "OUT_OF_RESOURCES" if method == "empty" else "DEVICE_NOT_AVAILABLE")
            return original(*arguments, **named)

        monkeypatch.setattr(Session, method, counted)
        vrte.radiance(self.scene, **self.request, backend=backend)
        calls = count["calls"]
        assert calls
        for fails_at in sorted({1, max(1, calls // 2), calls}):
            count.update({"calls": 0, "fails at": fails_at})
            with pytest.raises(DeviceError, match="ran out of memory" if method == "empty" else "was lost on the way"):
                vrte.radiance(self.scene, **self.request, backend=backend)
            assert not reopening["sessions"]
        count["fails at"] = 0
        found = vrte.radiance(self.scene, **self.request, backend=backend)
        assert_close(found.stokes, right.stokes, rtol=0.0, atol=1e-13)

    def test_threads_take_turns(self, opencl: Session) -> None:
        scenes = [vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo, 1.0)]) for albedo in (0.1, 0.5, 0.9, 1.0)]
        backends = ("opencl", "opencl+lapack", "sequential+device")
        calls = [(scene, backend) for scene in scenes for backend in backends]
        with ThreadPoolExecutor(4) as pool:
            found = list(pool.map(lambda call: vrte.radiance(call[0], **self.request, backend=call[1]), calls))
        for (scene, _), field in zip(calls, found, strict=True):
            assert_close(field.stokes, vrte.radiance(scene, **self.request).stokes, rtol=0.0, atol=1e-13)

    @pytest.mark.parametrize("thickness", [pytest.param(1.0, marks=pytest.mark.slow), np.inf])
    @pytest.mark.slow
    def test_the_form_for_a_gpu(
        self, thickness: float, opencl: Session, alone: dict[str, Any], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(device, "open_session", lambda handle: opencl.in_form("gpu"))
        matrix = vrte.PhaseMatrix(
            a1=[1.0, 0.5, 0.2], a2=[0, 0, 0.9], a3=[0, 0, 0.5], a4=[0, 0.3, 0.1], b1=[0, 0, 0.2], b2=[0, 0, 0.1]
        )
        scene = vrte.Scene([vrte.Layer(matrix, 0.9, thickness)])
        mu = np.linspace(0.1, 1.0, 5)
        call = partial(vrte.brdf, scene, mu, mu, [0.0, 50.0, 180.0], nodes=7)
        found, right = call(backend="opencl"), call()
        assert device.session().form == "gpu"
        assert_close(found.mueller, right.mueller, rtol=0.0, atol=1e-13)

    def test_no_device_is_no_reason_to_take_the_processor(
        self, alone: dict[str, Any], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(pyopencl, "get_platforms", raising("clGetPlatformIDs", "PLATFORM_NOT_FOUND_KHR"))
        with pytest.raises(DeviceError, match="there is no OpenCL platform"):
            vrte.radiance(self.scene, **self.request, backend="opencl")


class TestCommand:
    @pytest.mark.parametrize(
        ("broken", "asked_for", "taken"),
        [
            ("", "", "1, the CPU by PoCL, the faster driver"),
            ("it fails", "", "0, the only CPU (passed over: 1)"),
            ("it fails", "0", "0, VRTE_OPENCL_DEVICE=0"),
        ],
    )
    def test_the_table(
        self,
        broken: str,
        asked_for: str,
        taken: str,
        alone: dict[str, Any],
        capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        found = (PROCESSOR, BY_POCL)
        tried = {(i, each.platform, each.name): broken * i for i, each in enumerate(found)}
        alone.update(process=os.getpid(), devices=found, complaints=tried)
        monkeypatch.setenv(device.VARIABLE, asked_for)
        assert cli.main(["devices"]) == 0
        text = capsys.readouterr().out
        assert text.endswith(f"  taken: {taken}\n")
        assert text.count("\n     on ") == len(found)
        for each in found:
            assert f" {each.name} " in text
            assert f"\n     on {each.platform}\n" in text
        assert re.findall(r"^ \* (\d)", text, re.MULTILINE) == [taken[0]]
        assert text.count("never taken: it fails") == bool(broken)

    @pytest.mark.parametrize(
        ("found", "variable", "complaint"),
        [
            ((SMALL,), "x", "VRTE_OPENCL_DEVICE=x fits no OpenCL device: 0 = Card S (Maker)"),
        ],
    )
    def test_no_device_that_will_do(
        self,
        found: tuple[Device, ...],
        variable: str,
        complaint: str,
        alone: dict[str, Any],
        capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        alone.update(process=os.getpid(), devices=found)
        monkeypatch.setenv(device.VARIABLE, variable)
        assert cli.main(["devices"]) == 1
        output = capsys.readouterr()
        assert found[0].name in output.out
        assert "taken: none" in output.out
        assert output.err == f"vrte: error: {complaint} (docs/how_to/opencl.md)\n"

    def test_no_device_at_all(
        self, alone: dict[str, Any], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(pyopencl, "get_platforms", raising("clGetPlatformIDs", "PLATFORM_NOT_FOUND_KHR"))
        assert cli.main(["devices"]) == 1
        output = capsys.readouterr()
        assert output.out == ""
        assert output.err.startswith("vrte: error: there is no OpenCL platform")
        assert output.err.count("\n") == 1

    def test_rates(self, opencl: Session, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(report, "SIZES", ((16, 4), (24, 2)))
        monkeypatch.setattr(report, "SECONDS", 1e-4)
        assert all(
            rate.device > 0.0 < rate.blas for rate in report.measure_rates(opencl, 1)
        )  # of a GPU, less than is printed
        assert cli.main(["devices", "--measure"]) == 0
        rows = capsys.readouterr().out.splitlines()[-2:]
        for row, size in zip(rows, ("16 x 16", "24 x 24"), strict=True):
            assert row.split("  ")[1] == size
            assert len([float(number) for number in row.split()[3:]]) == 4


def test_the_error_is_public() -> None:
    assert vrte.DeviceError is DeviceError
    assert errors.make_device_error(ValueError("x")) is None
