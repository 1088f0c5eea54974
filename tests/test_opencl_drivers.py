"""Which drivers are found, that each is tried before its device is taken, and what is said of one that fails."""

import itertools
import os
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyopencl
import pytest

from vrte import cli
from vrte.basics.errors import DeviceError
from vrte.cl import device, drivers, probe
from vrte.cl.device import Device, choose
from vrte.cl.session import Session
from vrte.commands.devices import describe_devices

OLD = "error: unknown target CPU 'generic'"
CARD = Device("Maker", "Card", "gpu", True, 8 << 30, 2 << 30, 40, "1")
BY_POCL = Device(probe.POCL, "Processor", "cpu", True, 4 << 30, 2 << 30, 8, "2")
BY_INTEL = Device(probe.INTEL, "Processor", "cpu", True, 64 << 30, 16 << 30, 8, "3")


def failing(*indices: int) -> Callable[[int], str]:
    """These devices do not compile."""
    return lambda index: OLD if index in indices else ""


@pytest.fixture
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Intel's runtime as pip leaves it, an empty library, and no drivers of the system's."""
    site, library = tmp_path / "lib" / "python" / "site", tmp_path / "lib" / "libintelocl.so"
    information = site / "intel_opencl_rt-2026.9.dist-info"
    information.mkdir(parents=True)
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: intel-opencl-rt\nVersion: 2026.9\n")
    (information / "RECORD").write_text("../../libintelocl.so,,\n../../../etc/OpenCL/vendors/intel-cpu.icd,,\n")
    library.touch()
    (tmp_path / "vendors").mkdir()
    monkeypatch.syspath_prepend(site)
    monkeypatch.setenv("OPENCL_VENDOR_PATH", str(tmp_path / "vendors"))
    monkeypatch.delenv(drivers.FOLDER, raising=False)
    return library


class TestWhatIsVisible:
    def named(self) -> list[str]:
        with drivers.make_drivers_visible():
            folder = os.environ.get(drivers.FOLDER)
            found = [] if folder is None else [path.read_text() for path in sorted(Path(folder).glob("*.icd"))]
        assert folder is None or not Path(folder).exists()
        assert drivers.FOLDER not in os.environ
        return found

    def test_intels_runtime_beside_the_systems_drivers(self, runtime: Path, tmp_path: Path) -> None:
        there = tmp_path / "libcard.so"
        there.touch()
        for name, text in [("a", f"{there}\n"), ("b", "libnvidia-opencl.so.1"), ("c", "/gone/libcard.so\n"), ("d", "")]:
            (tmp_path / "vendors" / f"{name}.icd").write_text(text)
        (tmp_path / "vendors" / "e.icd").mkdir()
        assert self.named() == [f"{there}\n", "libnvidia-opencl.so.1\n", f"{runtime}\n"]

    def test_the_systems_own_is_enough(self, runtime: Path, tmp_path: Path) -> None:
        (tmp_path / "vendors" / "a.icd").write_text("libintelocl.so\n")
        assert self.named() == []

    def test_a_folder_that_was_named_stands(self, runtime: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv(drivers.FOLDER, "/mine")
        with drivers.make_drivers_visible():
            assert os.environ[drivers.FOLDER] == "/mine"

    def test_not_installed_or_only_in_part(self, runtime: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        runtime.unlink()
        assert drivers.find_intel_runtime() is None
        assert self.named() == []
        monkeypatch.setattr(sys, "path", [])
        assert drivers.find_intel_runtime() is None

    def test_nowhere_to_put_the_folder(self, runtime: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(drivers.tempfile, "tempdir", str(tmp_path / "absent"))
        assert self.named() == []

    def test_windows_has_a_variable_for_it(self, runtime: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(drivers, "WINDOWS", True)
        monkeypatch.setenv(drivers.FILES, "mine.dll")
        with drivers.make_drivers_visible():
            assert os.environ[drivers.FILES] == f"mine.dll{os.pathsep}{runtime}"
        assert os.environ[drivers.FILES] == "mine.dll"


@pytest.mark.skipif(drivers.find_intel_runtime() is None, reason="intel-opencl-rt is not installed")
@pytest.mark.skipif(bool(os.environ.get(drivers.FOLDER)), reason=f"{drivers.FOLDER} names other drivers")
def test_intels_runtime_is_listed(opencl: Session) -> None:
    """Whether it computes is found by trial: a processor may be newer than the runtime."""
    (found,) = (found for found in device.devices() if found.platform == probe.INTEL)
    assert found.kind == "cpu"


class TestChoice:
    @pytest.mark.parametrize(
        ("found", "broken", "taken", "reason"),
        [
            ([BY_POCL, BY_INTEL], (0,), 1, "the only CPU (passed over: 0)"),
            ([BY_POCL, BY_INTEL, BY_INTEL], (0,), 1, "the first CPU (passed over: 0)"),
            ([CARD, BY_INTEL, BY_POCL], (0,), 2, "the CPU by PoCL, the faster driver (passed over: 0)"),
            ([BY_POCL, BY_INTEL, CARD], (0, 2), 1, "the only CPU (passed over: 0, 2)"),
            ([BY_POCL, BY_INTEL], (1,), 0, "the CPU by PoCL, the faster driver"),
        ],
    )
    def test_one_that_fails_is_passed_over(
        self, found: list[Device], broken: tuple[int, ...], taken: int, reason: str
    ) -> None:
        assert choose(found, "", failing(*broken)) == (taken, reason)

    def test_none_is_left(self) -> None:
        with pytest.raises(DeviceError) as raised:
            choose([BY_POCL, CARD], "", failing(0, 1))
        assert str(raised.value) == (
            f"no OpenCL device compiles kernels (1 = Card: {OLD}; 0 = Processor: {OLD}): {device.INSTALL}"
        )
        assert "pip install 'vrte[opencl]'" in device.INSTALL

    def test_one_that_was_asked_for(self) -> None:
        with pytest.raises(DeviceError, match=f"VRTE_OPENCL_DEVICE=0 names a device that does not compute: {OLD}"):
            choose([BY_POCL, BY_INTEL], "0", failing(0))

    def test_the_table_says_why(self) -> None:
        lines = describe_devices([BY_POCL, BY_INTEL], 1, "the only CPU", {0: OLD, 1: ""}).splitlines()
        assert lines[3] == f"     never taken: {OLD}"
        assert sum("never taken" in line for line in lines) == 1


class TestTrial:
    def test_it_is_done_once(self, alone: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
        tried: list[int] = []
        monkeypatch.setattr(probe, "try_device", lambda index, *_: tried.append(index) or "")
        for _ in range(3):
            device.find_chosen_device()
        device.forget()
        device.find_chosen_device()
        assert len(tried) == 1

    @pytest.mark.parametrize("broken", [1, 2])
    def test_a_driver_older_than_its_processor(
        self,
        broken: int,
        opencl: Session,
        alone: dict[str, Any],
        capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        """What PoCL 3.0 says where even an empty kernel does not build: the first ``broken`` of two devices say it, of
        which both are the one that computes here."""
        found = tuple(replace(each, handle=opencl.device) for each in (BY_POCL, BY_INTEL))
        alone.update(process=os.getpid(), devices=found)
        build, built = pyopencl.Program.build, itertools.count(1)

        def old(program: Any, *arguments: Any, **named: Any) -> Any:
            if next(built) <= broken:
                raise pyopencl.RuntimeError(f"clBuildProgram failed: BUILD_PROGRAM_FAILURE\n\n{OLD}\n")
            return build(program, *arguments, **named)

        monkeypatch.setattr(pyopencl.Program, "build", old)
        monkeypatch.setattr(probe, "is_safe_in_process", lambda platform: True)
        assert cli.main(["devices"]) == broken - 1
        output = capsys.readouterr()
        assert output.out.count(f"never taken: the kernels do not compile on {opencl.device.name}: {OLD}") == broken
        if broken < len(found):
            assert output.out.endswith("taken: 1, the only CPU (passed over: 0)\n")
            assert device.find_chosen_device() is found[1]
        else:
            assert "taken: none" in output.out
            assert output.err.splitlines()[-1].startswith("vrte: error: no OpenCL device compiles kernels")
            assert device.INSTALL in output.err.splitlines()[-1]

    @pytest.mark.parametrize("name", ["OUT_OF_RESOURCES", "DEVICE_NOT_AVAILABLE"])
    def test_a_device_that_fails_midway(self, name: str, opencl: Session, monkeypatch: pytest.MonkeyPatch) -> None:
        def fail(*_: Any, **__: Any) -> None:
            raise pyopencl.RuntimeError(
                pyopencl._cl._ErrorRecord("clEnqueueReadBuffer", getattr(pyopencl.status_code, name), "")
            )

        monkeypatch.setattr(pyopencl, "enqueue_copy", fail)
        assert probe.try_here(opencl.device) == f"it fails ({name} in clEnqueueReadBuffer)"

    def test_a_device_that_cannot_reckon(self, opencl: Session, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(pyopencl, "enqueue_copy", lambda *_: None)
        assert probe.try_here(opencl.device) == "it finds 2 x 3 + 1 = 3.0"

    def test_drivers_that_nobody_tried_have_a_process_of_their_own(
        self, opencl: Session, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        assert probe.try_device(0, "Another", None) == device.find_complaint(0)
        monkeypatch.setattr(probe, "TRY_ONE", "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)  # {}")
        assert probe.try_device(0, "Another", None) == "it ends the process (signal SIGSEGV)"

    def test_one_that_hangs(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(probe, "LONGEST_WAIT", 0.01)
        assert probe.try_device(0, "Another", None) == "it gives no answer in 0.01 s"

    def test_how_it_ended(self) -> None:
        assert probe.end_of_the_process(-11, "one\ntwo\n\n") == "it ends the process (signal SIGSEGV: two)"
        assert probe.end_of_the_process(1, "") == "it ends the process (exit code 1)"
        assert "install binutils" in probe.end_of_the_process(1, "Path to linker /usr/bin/ld doesn't exist\n")
