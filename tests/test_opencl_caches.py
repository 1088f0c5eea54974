"""What was compiled is kept in a folder of vrte's own, which may be damaged, locked away or used by several processes:
answers stay right, and no other cache is touched.

PoCL ends the whole process where it reads a damaged file, so most of these run in a process of their own.
"""

import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

import vrte
from vrte.basics.errors import DeviceError
from vrte.cl import caches, device
from vrte.cl.probe import POCL
from vrte.cl.session import Session

from .conftest import skip_without_device
from .helpers import HANGS

BEGIN = """
import sys
import numpy as np
from vrte.cl import device, session
session.SOURCES = ("cl/probe.cl",)

def compute(opened):
    values = opened.upload(np.array([3.0, 1.0]))
    opened.launch("probe", (1,), turns=5, x=values)
    assert opened.download(values).tolist() == [7.0, 5.0]
"""
COMPUTE = f"{BEGIN}\ncompute(device.session())\nprint('right')\n"
THROUGH_PYOPENCL = (
    f"import pyopencl.characterize\npyopencl.characterize.has_src_build_cache = lambda _: False\n{COMPUTE}"
)
WAIT = f"{COMPUTE}sys.stdout.flush()\nsys.stdin.read()\n"
FORK = f"""{BEGIN}
import os, warnings
warnings.filterwarnings("ignore", "This process .* is multi-threaded", DeprecationWarning)  # forks, from Python 3.12 on
opened = device.session()
compute(opened)

def child():
    for use in (device.session, device.devices, opened.finish, lambda: opened.zeros((3,))):
        try:
            use()
        except RuntimeError as error:
            print(error, flush=True)

if not (process := os.fork()):
    child()
    sys.exit(3)
code = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
compute(opened)
print("child", code)
"""
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there are no forks, signals and no PoCL there")


def environment(home: Path, **changes: str) -> dict[str, str]:
    """With a home of its own: all caches lie in it."""
    unwanted = (caches.VARIABLE, "XDG_CACHE_HOME", "PYOPENCL_NO_CACHE")
    kept = {name: value for name, value in os.environ.items() if name not in unwanted}
    return kept | {"HOME": str(home), "PYTHONPATH": str(Path(vrte.__file__).parents[1])} | changes


def started(script: str, home: Path, **changes: str) -> subprocess.Popen[str]:
    """A process at work."""
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    command = [sys.executable, "-c", script]
    return subprocess.Popen(command, env=environment(home, **changes), cwd="/", text=True, **pipes)  # type: ignore[call-overload, no-any-return]


def finished(process: subprocess.Popen[str]) -> tuple[str, str]:
    """Both outputs of a process that must succeed."""
    out, err = process.communicate(timeout=HANGS)
    assert process.returncode == 0, f"exit code {process.returncode}\n{out}\n{err}"
    return out, err


def compute(home: Path, script: str = COMPUTE, **changes: str) -> str:
    """A right answer in a process of its own; what it says on standard error."""
    out, err = finished(started(script, home, **changes))
    assert out == "right\n"
    return err


def archive_of(home: Path) -> Path:
    """What is kept."""
    (found,) = (home / ".cache" / "vrte" / "opencl").glob("*.zip")
    return found


@pytest.fixture(scope="module")
def used_home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A home after one use."""
    skip_without_device()
    home = tmp_path_factory.mktemp("used") / "home"
    home.mkdir()
    assert compute(home) == ""
    return home


@pytest.fixture
def home(used_home: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    return Path(shutil.copytree(used_home, tmp_path / "home"))


@pytest.fixture
def pocl(opencl: Session) -> None:
    """Skips where another driver's device is taken."""
    platform = opencl.device.platform.name.strip()
    if platform != POCL:
        pytest.skip(f"about PoCL, and the device is of {platform}")


def flip_a_bit(content: bytes) -> bytes:
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 64]) + content[middle + 1 :]


DAMAGES: dict[str, Callable[[bytes], bytes]] = {
    "a bit": flip_a_bit,
    "half": lambda content: content[: len(content) // 2],
}


class TestArchive:
    @pytest.mark.parametrize(
        "damage", ["a bit", *(pytest.param(name, marks=pytest.mark.slow) for name in (None, "half"))]
    )
    def test_it_holds_what_was_compiled_and_damage_is_made_good(
        self, pocl: None, damage: str | None, home: Path
    ) -> None:
        archive = archive_of(home)
        first = caches.read_archive(archive)
        assert any(name.endswith("/probe.so") for name in first)
        if damage:
            archive.write_bytes(DAMAGES[damage](archive.read_bytes()))
            assert caches.read_archive(archive) == {}
        assert compute(home) == ""
        assert set(caches.read_archive(archive)) == set(first)
        assert damage or caches.read_archive(archive) == first

    @pytest.mark.slow
    def test_programs_that_pyopencl_keeps(self, home: Path) -> None:
        """Which PoCL goes without: other drivers' programs are kept so."""
        for _ in range(2):
            assert compute(home, THROUGH_PYOPENCL) == ""
            names = caches.read_archive(archive_of(home))
            assert {Path(name).name for name in names if name.startswith("pyopencl")} >= {"info", "binary", "source.cl"}

    def test_another_accounts_is_not_read(self, used_home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        archive = archive_of(used_home)
        assert caches.read_archive(archive)
        monkeypatch.setattr(os, "getuid", lambda: archive.stat().st_uid + 1)
        assert caches.read_archive(archive) == {}

    def test_what_others_added_meanwhile_stays(self, tmp_path: Path) -> None:
        archive, folder = tmp_path / "archive", tmp_path / "process-1"
        for damaged in (b"", b"garbage"):
            archive.write_bytes(damaged)
            assert caches.read_archive(archive) == caches.read_archive(tmp_path) == {}
        for name, content in (("pocl/a.so", b"mine"), ("pocl/tempfile_x", b"half"), ("wrappers/w", b"python")):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)
        caches.write_archive(archive, {"pocl/b.so": b"another's"})
        caches.keep_new(archive, folder, set(), os.getpid() + 1)
        assert set(caches.read_archive(archive)) == {"pocl/b.so"}
        assert folder.is_dir()
        caches.keep_new(archive, folder, set(), os.getpid())
        assert caches.read_archive(archive) == {"pocl/a.so": b"mine", "pocl/b.so": b"another's"}

    def test_a_full_disk(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        def full(*_: object) -> None:
            raise OSError(28, "No space left on device")

        archive, folder = tmp_path / "archive", tmp_path / "process-1"
        (folder / "pocl").mkdir(parents=True)
        (folder / "pocl" / "a.so").touch()
        caches.write_archive(archive, {"pocl/b.so": b"old"})
        monkeypatch.setattr(os, "replace", full)
        caches.keep_new(archive, folder, set(), os.getpid())
        assert caches.read_archive(archive) == {"pocl/b.so": b"old"}
        assert sorted(tmp_path.iterdir()) == [archive, folder]


class TestPlace:
    @pytest.mark.slow
    def test_no_other_cache_is_touched(self, pocl: None, tmp_path: Path) -> None:
        """Damaged as they are; Mesa's drivers keep a cache of shaders that is theirs alone."""
        home = tmp_path / "home"
        others = [home / ".cache" / name for name in ("pocl/kcache", "pyopencl", "pytools")]
        for folder in others:
            (folder / "AB" / ("A" * 37)).mkdir(parents=True)
            (folder / "AB" / ("A" * 37) / "program.bc").write_bytes(b"garbage")
        before = sorted(path for path in home.rglob("*"))
        assert compute(home) == ""
        kept = home / ".cache" / "vrte"
        assert sorted(path for path in home.rglob("*") if kept not in (path, *path.parents)) == before
        assert archive_of(home).stat().st_mode & 0o77 == 0

    @pytest.mark.slow
    def test_one_that_was_named(self, tmp_path: Path) -> None:
        home, named = tmp_path / "home", tmp_path / "named"
        home.mkdir()
        assert compute(home, POCL_CACHE_DIR=str(named)) == ""
        assert [path.name for path in named.iterdir()] == ["vrte"]
        assert not any(home.rglob("kernels-*"))

    @pytest.mark.slow
    def test_where_no_files_can_be_written(self, tmp_path: Path) -> None:
        """A temporary folder, gone at the end: the account's folder, or one that was named, is a file or below one."""
        home, temporary = tmp_path / "file", tmp_path / "temporary"
        home.touch()
        temporary.mkdir()
        for named in ("", "file", "file/below"):
            changes = {"TMPDIR": str(temporary)} | ({caches.VARIABLE: str(tmp_path / named)} if named else {})
            reported = compute(home, **changes)
            assert f"OpenCL kernels are compiled anew by each process: no files can be written in {home}" in reported
            assert home.read_bytes() == b""
            assert not any(temporary.iterdir())

    def test_no_temporary_folder_either(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        (tmp_path / "file").touch()
        monkeypatch.setattr(caches.tempfile, "tempdir", str(tmp_path / "absent"))
        with pytest.raises(DeviceError, match="OpenCL kernels cannot be compiled: neither"):
            caches._prepare(tmp_path / "file")


class TestProcesses:
    @pytest.mark.slow
    def test_several_compile_at_once(self, tmp_path: Path) -> None:
        home = tmp_path / "home"
        home.mkdir()
        for process in [started(COMPUTE, home) for _ in range(6)]:
            assert finished(process) == ("right\n", "")
        assert caches.read_archive(archive_of(home))

    @pytest.mark.slow
    def test_what_ended_ones_leave_goes_and_living_ones_stay(self, pocl: None, home: Path) -> None:
        """Neither a stranger's archive nor a process at work is disturbed; others' drivers have a trial more."""
        kept = home / ".cache" / "vrte" / "opencl"
        killed, living = (started(WAIT, home) for _ in range(2))
        for process in (killed, living):
            assert process.stdout.readline() == "right\n"
        killed.send_signal(signal.SIGKILL)
        killed.communicate()
        folders = set(kept.glob("process-*"))
        assert len(folders) == 4  # and locks
        assert compute(home) == ""
        assert len(folders & set(kept.glob("process-*"))) == 2
        finished(living)

    @pytest.mark.slow
    def test_one_that_ends_while_its_driver_compiles(self, pocl: None, tmp_path: Path) -> None:
        """What was enqueued and not waited for is compiled while the process ends."""
        home = tmp_path / "home"
        home.mkdir()
        hurry = COMPUTE.replace("compute(device.session())", "device.session().zeros((1,))").replace(
            "print(",
            "opened = device.session(); opened.launch('probe', (1,), turns=5, x=opened.upload(np.ones(2))); print(",
        )
        assert compute(home, hurry) == ""
        assert compute(home) == ""

    def test_one_forked_while_another_thread_holds_the_lock(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(device, "_state", {"process": os.getpid() + 1, "devices": None, "sessions": {}})
        held, let_go = threading.Event(), threading.Event()

        def hold() -> None:
            with device._lock:
                held.set()
                let_go.wait(60)

        thread = threading.Thread(target=hold)
        thread.start()
        held.wait(60)
        try:
            with pytest.raises(DeviceError, match="this process was forked"):
                device.session()
        finally:
            let_go.set()
            thread.join()

    def test_one_forked_after_opencl_was_used(self, home: Path) -> None:
        """Its parent goes on."""
        out, err = finished(started(FORK, home))
        lines = out.splitlines()
        assert err == ""
        assert len(lines) == 5
        assert all(line.startswith("this process was forked from one that had used OpenCL") for line in lines[:4])
        assert lines[4] == "child 3"


@pytest.mark.slow
def test_pocl_without_a_linker(pocl: None, tmp_path: Path) -> None:
    """Not even from its cache: what is not in there could not be compiled."""
    home = tmp_path / "home"
    home.mkdir()
    index = next(i for i, found in enumerate(device.devices()) if found.platform == POCL)
    compute(home, VRTE_OPENCL_DEVICE=str(index))
    _, err = started(COMPUTE, home, PATH="/nonexistent", VRTE_OPENCL_DEVICE=str(index)).communicate(timeout=HANGS)
    assert err.splitlines()[-1] == (
        f"vrte.DeviceError: "
        f"VRTE_OPENCL_DEVICE={index} names a device that does not compute: it finds no linker "
        "(install binutils, which brings ld)"
    )
