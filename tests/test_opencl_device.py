"""Which drivers are found, which device is taken and tried before, what is said where there is none or where it
fails."""

import os
import re
import sys
import time
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import vrte
from vrte import cli
from vrte.basics.errors import DeviceError, MissingExtraError
from vrte.cl import building, device, drivers, matrices, probe
from vrte.cl import session as sessions
from vrte.cl.device import Device, choose
from vrte.cl.errors import check_room
from vrte.cl.session import Session, open_session
from vrte.commands import verify_device as report

from .conftest import working_session
from .helpers import assert_close

pyopencl = pytest.importorskip("pyopencl")
OLD = "error: unknown target CPU 'generic'"


def made(name: str, kind: str, gigabytes: float, fp64: bool = True, platform: str = "Maker", **more: Any) -> Device:
    """A device that nobody has."""
    return Device(platform, name, kind, fp64, int(gigabytes * 1e9), int(gigabytes * 2.5e8), 8, "1.0", **more)


PROCESSOR = made("Processor X", "cpu", 128.0, platform="Portable")
SMALL, LARGE = made("Card S", "gpu", 8.0), made("Card L", "gpu", 24.0)
OTHER = made("Board", "accelerator", 200.0)
BY_POCL = made("Processor X", "cpu", 4.0, platform=probe.POCL)
BY_INTEL = made("Processor X", "cpu", 64.0, platform=probe.INTEL)
FLOAT = made("Card F", "gpu", 32.0, fp64=False)
BUILT_IN = made("Graphics", "gpu", 48.0, shared=True)
FASTER = "the CPU by PoCL, the faster driver"


def failing(*indices: int) -> Callable[[int], str]:
    """These devices do not compile."""
    return lambda index: OLD if index in indices else ""


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


@pytest.fixture
def reopening(opencl: Session, alone: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """As in a process that has not used OpenCL yet; what is opened has a queue and memory of its own, but kernels
    that are compiled."""

    def opened(handle: Any, precision: str) -> Session:
        queue = pyopencl.CommandQueue(opencl.context)
        kernels = building.Kernels(opencl.kernels.program, sessions.read_sources())
        return Session(opencl.context, queue, kernels, sessions._make_memory_pool(queue), opencl.lanes)

    alone.update(process=os.getpid(), devices=(device.find_chosen_device(),))
    monkeypatch.setattr(device, "open_session", opened)
    return alone


CHOICES: list[tuple[list[Device], tuple[int, ...], int, str]] = [  # devices, those that fail, the one taken, why
    ([PROCESSOR], (), 0, "the only device"),
    ([PROCESSOR, SMALL], (), 1, "the only GPU"),
    ([PROCESSOR, SMALL, LARGE, OTHER], (), 2, "the GPU with the most memory"),
    ([PROCESSOR, LARGE, LARGE], (), 1, "the first GPU"),
    ([BUILT_IN, SMALL], (), 1, "the only GPU with memory of its own"),
    ([BUILT_IN, BUILT_IN], (), 0, "the first GPU"),
    ([SMALL, LARGE, BUILT_IN], (), 1, "the GPU with the most memory"),
    ([PROCESSOR, OTHER], (), 1, "the only accelerator"),
    ([FLOAT, PROCESSOR], (), 1, "the only CPU"),  # doubles come first
    ([FLOAT], (), 0, "the only device, without doubles"),
    ([made("?", "other", 500.0), PROCESSOR], (), 1, "the only CPU"),
    ([BY_POCL, BY_INTEL], (0,), 1, "the only CPU (passed over: 0)"),
    ([BY_POCL, BY_INTEL, BY_INTEL], (0,), 1, "the first CPU (passed over: 0)"),
    ([SMALL, BY_INTEL, BY_POCL], (0,), 2, f"{FASTER} (passed over: 0)"),
    ([BY_POCL, BY_INTEL, SMALL], (0, 2), 1, "the only CPU (passed over: 0, 2)"),
]
LISTED = ": 0 = Processor X (Portable), 1 = Card S (Maker), 2 = Card F (Maker, no fp64)"
NOT_BUILT = f"no OpenCL device compiles kernels (1 = Card S: {OLD}; 0 = Processor X: {OLD}; 2 = Card F: {OLD})"
ASKED: list[tuple[str, tuple[int, ...], int | str]] = [  # the variable, those that fail, the one taken or the complaint
    ("0", (), 0),
    ("card s", (), 1),
    ("PROCESSOR", (), 0),
    ("portable", (), 0),
    ("card f", (), 2),
    *((name, (), f"VRTE_OPENCL_DEVICE={name} fits no OpenCL device{LISTED}") for name in ("7", "-1", "nonesuch")),
    ("card", (), f"VRTE_OPENCL_DEVICE=card fits more than one OpenCL device{LISTED}"),
    ("0", (0,), f"VRTE_OPENCL_DEVICE=0 names a device that does not compute: {OLD}"),
    ("", (0, 1, 2), f"{NOT_BUILT}: {device.INSTALL}"),
]


def test_which_device_is_taken() -> None:
    """By the rule, or by an index or a part of a name in the environment variable."""
    for found, broken, taken, reason in CHOICES:
        assert choose(found, "", failing(*broken)) == (taken, reason)
    for asked, broken, answer in ASKED:
        if isinstance(answer, int):
            assert choose([PROCESSOR, SMALL, FLOAT], asked) == (answer, f"VRTE_OPENCL_DEVICE={asked}")
        else:
            with pytest.raises(DeviceError, match=f"^{re.escape(answer)}"):
                choose([PROCESSOR, SMALL, FLOAT], asked, failing(*broken))
    assert "pip install 'vrte[opencl]'" in device.INSTALL


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


def list_visible() -> list[str]:
    """The drivers that are named while devices are looked for; nothing is left of that."""
    with drivers.make_drivers_visible():
        folder = os.environ.get(drivers.FOLDER)
        found = [] if folder is None else [path.read_text() for path in sorted(Path(folder).glob("*.icd"))]
    assert folder is None or not Path(folder).exists()
    assert drivers.FOLDER not in os.environ
    return found


def test_intels_runtime_beside_the_systems_drivers(runtime: Path, tmp_path: Path) -> None:
    there, vendors = tmp_path / "libcard.so", tmp_path / "vendors"
    there.touch()
    for name, text in [("a", f"{there}\n"), ("b", "libnvidia-opencl.so.1"), ("c", "/gone/libcard.so\n"), ("d", "")]:
        (vendors / f"{name}.icd").write_text(text)
    (vendors / "e.icd").mkdir()
    assert list_visible() == [f"{there}\n", "libnvidia-opencl.so.1\n", f"{runtime}\n"]
    (vendors / "a.icd").write_text("libintelocl.so\n")
    assert list_visible() == [], "the system's own is enough"


def test_where_intels_runtime_is_not_named(runtime: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Drivers that the user named stand, Windows has a variable for it, there is no place for a folder, the runtime is
    not installed or only in part."""
    with monkeypatch.context() as patch:
        patch.setenv(drivers.FOLDER, "/mine")
        with drivers.make_drivers_visible():
            assert os.environ[drivers.FOLDER] == "/mine"
    with monkeypatch.context() as patch:
        patch.setattr(drivers, "WINDOWS", True)
        patch.setenv(drivers.FILES, "mine.dll")
        with drivers.make_drivers_visible():
            assert os.environ[drivers.FILES] == f"mine.dll{os.pathsep}{runtime}"
        assert os.environ[drivers.FILES] == "mine.dll"
    with monkeypatch.context() as patch:
        patch.setattr(drivers.tempfile, "tempdir", str(tmp_path / "absent"))
        assert list_visible() == []
    runtime.unlink()
    assert drivers.find_intel_runtime() is None
    assert list_visible() == []
    monkeypatch.setattr(sys, "path", [])
    assert drivers.find_intel_runtime() is None


@pytest.mark.skipif(drivers.find_intel_runtime() is None, reason="intel-opencl-rt is not installed")
@pytest.mark.skipif(bool(os.environ.get(drivers.FOLDER)), reason=f"{drivers.FOLDER} names other drivers")
def test_intels_runtime_is_listed(opencl: Session) -> None:
    """Whether it computes is found by trial: a processor may be newer than the runtime."""
    (found,) = (found for found in device.devices() if found.platform == probe.INTEL)
    assert found.kind == "cpu"


def test_a_device_is_tried_once(alone: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    alone.update(process=os.getpid(), devices=(SMALL, LARGE))
    tried: list[int] = []
    monkeypatch.setattr(probe, "try_device", lambda index, *_: tried.append(index) or "")
    for _ in range(3):
        assert device.find_chosen_device() is LARGE
    assert tried == [1]


def test_a_device_that_fails_or_cannot_reckon(opencl: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("OUT_OF_RESOURCES", "DEVICE_NOT_AVAILABLE"):
        monkeypatch.setattr(pyopencl, "enqueue_copy", raising("clEnqueueReadBuffer", name))
        assert probe.try_here(opencl.device) == f"it fails ({name} in clEnqueueReadBuffer)"
    monkeypatch.setattr(pyopencl, "enqueue_copy", lambda *_: None)
    assert probe.try_here(opencl.device) == "it finds 2 x 3 + 1 = 3.0"
    monkeypatch.setattr(pyopencl, "enqueue_copy", lambda queue, found, buffer: np.copyto(found, [7.0, 3.0 * 65535.0]))
    assert probe.try_here(opencl.device) == "it leaves a loop of 1000000 turns after 65535"

    def build(*_: Any, **__: Any) -> Any:
        """What PoCL 3.0 says where it is older than its processor: even an empty kernel does not build."""
        raise pyopencl.RuntimeError(f"clBuildProgram failed: BUILD_PROGRAM_FAILURE\n\n{OLD}\n")

    monkeypatch.setattr(pyopencl.Program, "build", build)
    assert probe.try_here(opencl.device) == f"the kernels do not compile on {opencl.device.name}: {OLD}"


def test_drivers_that_nobody_tried_have_a_process_of_their_own(
    opencl: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert probe.try_device(0, "Another", None) == device.find_complaint(0)
    monkeypatch.setattr(probe, "TRY_ONE", "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)  # {}")
    assert probe.try_device(0, "Another", None) == "it ends the process (signal SIGSEGV)"
    monkeypatch.setattr(probe, "LONGEST_WAIT", 0.01)
    assert probe.try_device(0, "Another", None) == "it gives no answer in 0.01 s"
    assert probe.end_of_the_process(-11, "one\ntwo\n\n") == "it ends the process (signal SIGSEGV: two)"
    assert probe.end_of_the_process(1, "") == "it ends the process (exit code 1)"
    assert "install binutils" in probe.end_of_the_process(1, "Path to linker /usr/bin/ld doesn't exist\n")


def test_what_devices_say_of_themselves(opencl: Session) -> None:
    """Where a driver raises an error on a question, something else stands in for the answer."""
    for found in device.devices():
        assert found.kind in device.PREFERENCE
        assert found.memory >= found.largest > 0 < found.units
        assert found.name
        assert found.platform
    assert opencl.lanes == (1 if device.find_chosen_device().kind == "cpu" else 64)

    class Silent:
        name, driver_version, type, available = "Card ", "1 ", pyopencl.device_type.GPU, True
        global_mem_size, max_mem_alloc_size, max_compute_units, extensions = 8 << 30, 2 << 30, 20, "cl_khr_icd"

        def __getattr__(self, name: str) -> Any:
            raise error_of("clGetDeviceInfo", "INVALID_VALUE")

    silent = device._describe_device(SimpleNamespace(name="Maker"), Silent())
    assert (silent.name, silent.shared, silent.double_precision) == ("Card", False, False)
    Silent.extensions += " cl_khr_fp64"
    assert device._describe_device(SimpleNamespace(name="Maker"), Silent()).double_precision


NO_PLATFORM = "there is no OpenCL platform"
EMPTY = SimpleNamespace(name="A driver ", get_devices=raising("clGetDeviceIDs", "DEVICE_NOT_FOUND"))
BACKEND: dict[str, Any] = {"mu0": 0.6, "mu": [0.5, -0.5], "phi": [0, 90], "tau": [0.0, 1.0], "nodes": 4}
SCENE = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)])


def test_where_there_is_no_device(
    alone: dict[str, Any], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """No pyopencl, no platform, none with a device: said in one sentence, and the processor is not taken instead."""
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "pyopencl", None)
        with pytest.raises(MissingExtraError, match=r"OpenCL needs the extra 'opencl': pip install 'vrte\[opencl\]'"):
            device.devices()
    monkeypatch.setattr(pyopencl, "get_platforms", lambda: [EMPTY])
    with pytest.raises(DeviceError, match=r"no OpenCL platform has a device \(platforms: A driver\)"):
        device.devices()
    monkeypatch.setattr(pyopencl, "get_platforms", raising("clGetPlatformIDs", "PLATFORM_NOT_FOUND_KHR"))
    with pytest.raises(DeviceError, match=rf"{NO_PLATFORM}.*vrte\[opencl\]"):
        vrte.radiance(SCENE, **BACKEND, backend="opencl")
    assert cli.main(["devices"]) == 1
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.startswith(f"vrte: error: {NO_PLATFORM}")
    assert output.err.count("\n") == 1


def test_sessions(opencl: Session, alone: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """One for all threads, one for each choice, none after a fork, none in doubles on a device without them."""
    opened: list[Any] = []

    def slow_open(handle: Any, precision: str) -> object:
        opened.append(handle)
        time.sleep(0.05)
        return object()

    monkeypatch.setattr(device, "open_session", slow_open)
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(lambda _: device.session(), range(8)))
    assert len(opened) == len(set(map(id, found))) == 1
    alone.update(process=os.getpid(), devices=(SMALL, LARGE), sessions={}, complaints={})
    monkeypatch.setattr(probe, "try_device", lambda *_: "")
    large = device.session()
    monkeypatch.setenv(device.VARIABLE, " Card S")
    small = device.session()
    assert small is not large
    assert device.session() is small
    monkeypatch.delenv(device.VARIABLE)
    assert device.session() is large
    alone.update(devices=(FLOAT,), sessions={}, complaints={(0, FLOAT.platform, FLOAT.name): ""})
    with pytest.raises(DeviceError, match=r"Card F computes in single precision only: 0 = Card F \(Maker, no fp64\)"):
        device.session()
    alone["process"] = os.getpid() + 1
    with pytest.raises(DeviceError, match=r"this process was forked from one that had used OpenCL.*spawn"):
        device.session()


FAILURES = {  # what is told of an error: OpenCL's names of it, or a number that a driver has of its own
    "ran out of memory or other resources ({} in clX): ask": (
        *("MEM_OBJECT_ALLOCATION_FAILURE", "OUT_OF_RESOURCES", "OUT_OF_HOST_MEMORY", "INVALID_BUFFER_SIZE"),
    ),
    "was lost on the way ({} in clX): nothing was comp": (
        *("DEVICE_NOT_AVAILABLE", "INVALID_COMMAND_QUEUE", "EXEC_STATUS_ERROR_FOR_EVENTS_IN_WAIT_LIST"),
    ),
    "was lost on the way (code {} in clX): nothing was comp": ("-9999",),
    "failed ({} in clX): nothing was computed": ("INVALID_KERNEL_ARGS",),
}


def test_each_failure_in_one_sentence(alone: dict[str, Any]) -> None:
    """The sessions are forgotten with it; other errors are not OpenCL's."""
    alone["sessions"][0] = kept = object()
    with pytest.raises(ZeroDivisionError), device.raise_device_errors():
        raise ZeroDivisionError
    assert alone["sessions"] == {0: kept}
    for words, name in [(words, name) for words, names in FAILURES.items() for name in names]:
        alone["sessions"][0], cause = kept, error_of("clX", name)
        with pytest.raises(DeviceError, match=re.escape(words.format(name))) as raised, device.raise_device_errors():
            raise cause
        assert raised.value.__cause__ is cause
        assert not alone["sessions"]
    assert vrte.DeviceError is DeviceError


def test_after_a_lost_device_the_next_call_starts_anew(reopening: dict[str, Any]) -> None:
    """And one that is lost fails one test; an array that is too large is said."""
    first = device.session()
    assert first.kernels["invert"]  # made, with its work-groups, before it fails
    first.kernels["invert"] = raising("clEnqueueNDRangeKernel", "DEVICE_NOT_AVAILABLE")
    with pytest.raises(DeviceError, match="was lost"), device.raise_device_errors():
        matrices.invert(first, matrices.make_stack(first, 1, 3, 3))
    second = working_session()
    assert working_session() is second is not first
    second.__dict__["download"] = raising("clEnqueueReadBuffer", "DEVICE_NOT_AVAILABLE")
    third = working_session()
    assert working_session() is third is not second
    too_large = 4 * max(found.memory for found in device.devices())
    with pytest.raises(DeviceError, match="ran out of memory"), device.raise_device_errors():
        third.empty((too_large // 8,))


def test_room_is_looked_for_before() -> None:
    """A processor's device has the memory that is free beside it; ``asked``: bytes, those of one array, free bytes."""
    card = SimpleNamespace(global_mem_size=8e9, max_mem_alloc_size=2e9, name="Card ")
    on_card, on_host = (SimpleNamespace(device=card, on_host=each) for each in (False, True))
    check_room(on_card, 7e9, 2e9, 1e6)
    for where, asked, words in (
        (on_card, (7.5e9,), r"this needs about 7.5 GB on the OpenCL device Card, which has 8 GB: ask"),
        (on_card, (0.0, 2.2e9), r"this needs an array of 2.2 GB .*, which allows 2 GB"),
        (on_host, (1e6, 0.0, 1e6), r"this needs about 0.001 GB .*, which has 0.001 GB"),
    ):
        with pytest.raises(DeviceError, match=words):
            check_room(where, *asked)


def test_what_a_compiler_says(opencl: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    """A warning passes; an error, and kernels that it left out, are told in one sentence."""
    text = '#warning "look here"\n#define real double\n__kernel void probe(TAKES_probe) { x[0] = turns; }\n'
    monkeypatch.setattr(sessions, "read_sources", lambda *_: text)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        opened = open_session(opencl.device)
    values = opened.zeros((2,))
    opened.launch("probe", (1,), turns=3, x=values)
    assert opened.download(values).tolist() == [3.0, 0.0]
    broken = "__kernel void broken(__global doubel* x) { x[0] = 1; }\n" * 40
    monkeypatch.setattr(sessions, "read_sources", lambda *_: broken)
    with pytest.raises(DeviceError, match=r"the kernels do not compile on .*error.*doubel") as raised:
        open_session(opencl.device)
    assert "\n" not in str(raised.value)
    assert len(str(raised.value)) < 450
    assert isinstance(raised.value.__cause__, pyopencl.Error)
    monkeypatch.undo()
    monkeypatch.setattr(pyopencl.Program, "get_info", lambda *_: "product;invert")
    with pytest.raises(DeviceError, match=r"the compiler of .* left out .*, join_slabs, "):
        open_session(opencl.device)


@pytest.mark.parametrize(
    ("backend", "method"),
    [
        *(("opencl", method) for method in ("launch", "upload", "download", "empty")),
        pytest.param("opencl+lapack", "launch", marks=pytest.mark.slow),
        pytest.param("sequential+device", "download", marks=pytest.mark.slow),
    ],
)
def test_an_error_in_the_middle_of_a_solve_then_a_right_answer(
    backend: str, method: str, reopening: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    right = vrte.radiance(SCENE, **BACKEND)
    original, count = getattr(Session, method), {"calls": 0, "fails at": 0}

    def counted(*arguments: Any, **named: Any) -> Any:
        count["calls"] += 1
        if count["calls"] == count["fails at"]:
            raise error_of("clX", "OUT_OF_RESOURCES" if method == "empty" else "DEVICE_NOT_AVAILABLE")
        return original(*arguments, **named)

    monkeypatch.setattr(Session, method, counted)
    vrte.radiance(SCENE, **BACKEND, backend=backend)
    calls = count["calls"]
    assert calls
    for fails_at in sorted({1, max(1, calls // 2), calls}):
        count.update({"calls": 0, "fails at": fails_at})
        with pytest.raises(DeviceError, match="ran out of memory" if method == "empty" else "was lost on the way"):
            vrte.radiance(SCENE, **BACKEND, backend=backend)
        assert not reopening["sessions"]
    count["fails at"] = 0
    found = vrte.radiance(SCENE, **BACKEND, backend=backend)
    assert_close(found.stokes, right.stokes, rtol=0.0, atol=1e-13)


def test_threads_take_turns(opencl: Session) -> None:
    scenes = [vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo, 1.0)]) for albedo in (0.1, 0.5, 0.9, 1.0)]
    calls = [(scene, backend) for scene in scenes for backend in ("opencl", "opencl+lapack", "sequential+device")]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda call: vrte.radiance(call[0], **BACKEND, backend=call[1]), calls))
    for (scene, _), field in zip(calls, found, strict=True):
        assert_close(field.stokes, vrte.radiance(scene, **BACKEND).stokes, rtol=0.0, atol=1e-13)


TABLES = [  # why the second device does not compute, the variable, what the command takes
    ("", "", f"1, {FASTER}"),
    ("it fails", "", "0, the only CPU (passed over: 1)"),
    ("it fails", "0", "0, VRTE_OPENCL_DEVICE=0"),
    ("", "y", "none, for the reason below"),
]


def test_the_table_of_the_command(
    alone: dict[str, Any], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = PROCESSOR, BY_POCL
    for broken, asked, taken in TABLES:
        tried = {(i, each.platform, each.name): broken * i for i, each in enumerate(found)}
        alone.update(process=os.getpid(), devices=found, complaints=tried)
        monkeypatch.setenv(device.VARIABLE, asked)
        assert cli.main(["devices"]) == (taken[0] == "n")
        text, reported = capsys.readouterr()
        assert f"  taken: {taken}" in text
        assert [line.strip() for line in text.splitlines() if "  on " in line] == [
            f"on {each.platform}" for each in found
        ]
        assert re.findall(r"^ [* ] *\d (\S+ \S) ", text, re.MULTILINE) == [each.name for each in found]
        assert re.findall(r"^ \* (\d)", text, re.MULTILINE) == re.findall(r"^\d", taken)
        assert text.count("never taken: it fails") == bool(broken)
        assert ("VRTE_OPENCL_DEVICE=y fits no OpenCL device: 0 =" in reported) == (taken[0] == "n")
        assert reported.endswith("(docs/how_to/opencl.md)\n" if taken[0] == "n" else "")


def test_rates_are_measured(
    opencl: Session, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(report, "SIZES", ((16, 4), (24, 2)))
    monkeypatch.setattr(report, "SECONDS", 1e-4)
    assert all(rate.device > 0.0 < rate.blas for rate in report.measure_rates(opencl, 1))  # of a GPU, less than printed
    assert cli.main(["devices", "--measure"]) == 0
    rows = capsys.readouterr().out.splitlines()[-2:]
    for row, size in zip(rows, ("16 x 16", "24 x 24"), strict=True):
        assert row.split("  ")[1] == size
        assert len([float(number) for number in row.split()[3:]]) == 4
