"""What the OpenCL libraries keep on disk may be damaged, locked away or used by several processes: answers stay right.

PoCL ends the whole process where it reads a damaged file, so each of these runs in a process of its own.
"""

import os
import shutil
import sqlite3
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import vrte
from vrte.basics.errors import DeviceError
from vrte.cl import caches, device
from vrte.cl.session import Session
from vrte.cl.trial import POCL

ROOT = Path(__file__).parents[1]
BEGIN = """
import sys
import numpy as np
from vrte.cl import device, session
session.SOURCES = ("trial",)

def compute(opened):
    values = opened.upload(np.array([3.0]))
    opened.launch("trial", (1,), values)
    assert opened.download(values) == 7.0
"""
COMPUTE = f"{BEGIN}\ncompute(device.session())\nprint('right')\n"
THROUGH_PYOPENCL = (
    f"import pyopencl.characterize\npyopencl.characterize.has_src_build_cache = lambda _: False\n{COMPUTE}"
)
FORK = f"""{BEGIN}
import multiprocessing, os
opened = device.session()
compute(opened)

def child():
    for use in (device.session, device.devices, opened.finish, lambda: opened.zeros((3,))):
        try:
            use()
        except RuntimeError as error:
            print(error, flush=True)

if sys.argv[1] == "fork":
    if not (process := os.fork()):
        child()
        sys.exit(3)
    code = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
else:
    process = multiprocessing.get_context("fork").Process(target=child)
    process.start()
    process.join()
    code = process.exitcode
compute(opened)
print("child", code)
"""
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="PoCL's folder lies elsewhere there")


def environment(home: Path, **changes: str) -> dict[str, str]:
    """With a home of its own: PoCL's and pyopencl's caches lie in it."""
    unwanted = ("POCL_CACHE_DIR", "XDG_CACHE_HOME", "PYOPENCL_NO_CACHE")
    kept = {name: value for name, value in os.environ.items() if name not in unwanted}
    return kept | {"HOME": str(home), "PYTHONPATH": str(Path(vrte.__file__).parents[1])} | changes


def started(script: str, home: Path, *arguments: str, **changes: str) -> subprocess.Popen[str]:
    """A process at work."""
    command = [sys.executable, "-c", script, *arguments]
    both = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen(command, env=environment(home, **changes), cwd=home.parent, text=True, **both)  # type: ignore[call-overload, no-any-return]


def finished(process: subprocess.Popen[str]) -> tuple[str, str]:
    """Both outputs of a process that must succeed."""
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, f"exit code {process.returncode}\n{out}\n{err}"
    return out, err


def compute(home: Path, script: str = COMPUTE, **changes: str) -> str:
    """A right answer in a process of its own; what it says on standard error."""
    out, err = finished(started(script, home, **changes))
    assert out == "right\n"
    return err


@pytest.fixture(scope="module")
def used_home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A home after one use: all caches full."""
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
        pytest.skip(f"about files of PoCL's, and the device is of {platform}")


def pocl_files(home: Path, pattern: str) -> list[Path]:
    """Files in PoCL's cache."""
    found = [path for path in (home / ".cache" / "pocl").rglob(pattern) if path.is_file()]
    assert found
    return found


def garbage(path: Path) -> None:
    path.write_bytes(b"garbage")


def nothing(path: Path) -> None:
    path.write_bytes(b"")


def half(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def a_bit(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 64
    path.write_bytes(content)


def a_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


class TestDamage:
    @pytest.mark.parametrize(
        ("pattern", "damage"),
        [
            ("*.so", garbage),
            *(pytest.param("*.so", damage, marks=pytest.mark.slow) for damage in (nothing, half, a_bit, a_folder)),
            *(pytest.param("*.bc", damage, marks=pytest.mark.slow) for damage in (garbage, nothing, half, a_bit)),
            pytest.param(caches.CHECKSUMS, garbage, marks=pytest.mark.slow),
            pytest.param("last_accessed", garbage, marks=pytest.mark.slow),
        ],
    )
    def test_files_of_pocl(self, pocl: None, pattern: str, damage: Callable[[Path], None], home: Path) -> None:
        for path in pocl_files(home, pattern):
            damage(path)
        assert compute(home) == ""
        assert compute(home) == ""

    @pytest.mark.slow
    @pytest.mark.parametrize("damage", [garbage, nothing, half])
    @pytest.mark.parametrize("pattern", ["*.so", "*.bc"])
    def test_files_without_a_checksum(
        self, pocl: None, pattern: str, damage: Callable[[Path], None], home: Path
    ) -> None:
        for path in pocl_files(home, caches.CHECKSUMS):
            path.unlink()
        for path in pocl_files(home, pattern):
            damage(path)
        assert compute(home) == ""

    def test_whole_files_without_a_checksum_are_kept(self, pocl: None, home: Path) -> None:
        for path in pocl_files(home, caches.CHECKSUMS):
            path.unlink()
        files = [*pocl_files(home, "*.so"), *pocl_files(home, "*.bc")]
        caches.remove_damaged(home / ".cache" / "pocl" / "kcache")
        assert all(path.is_file() for path in files)

    @pytest.mark.slow
    @pytest.mark.parametrize("depth", [0, 1, 2])
    def test_files_where_folders_belong(self, pocl: None, depth: int, home: Path) -> None:
        (library,) = pocl_files(home, "*.so")
        folder = library.parents[3 - depth]
        shutil.rmtree(folder)
        folder.touch()
        assert compute(home) == ""

    def test_wrappers_of_pyopencl(self, home: Path) -> None:
        (database,) = (home / ".cache" / "pytools").glob("*.sqlite")
        garbage(database)
        assert compute(home) == ""

    @pytest.mark.slow
    def test_rows_of_wrappers(self, home: Path) -> None:
        (database,) = (home / ".cache" / "pytools").glob("*.sqlite")
        connection = sqlite3.connect(database)
        connection.execute("UPDATE dict SET key_value = ?", (b"garbage",))
        connection.commit()
        connection.close()
        assert compute(home) == ""

    @pytest.mark.slow
    @pytest.mark.parametrize(("name", "damage"), [("info", garbage), ("info", nothing), ("binary", garbage)])
    def test_programs_of_pyopencl(self, name: str, damage: Callable[[Path], None], home: Path) -> None:
        """Which PoCL goes without: other drivers' programs are kept so."""
        compute(home, THROUGH_PYOPENCL)
        (path,) = (home / ".cache" / "pyopencl").glob(f"*/*/{name}")
        damage(path)
        assert compute(home, THROUGH_PYOPENCL) == ""

    @pytest.mark.slow
    def test_nowhere_to_keep_programs_of_pyopencl(self, home: Path) -> None:
        (home / ".cache" / "pyopencl").touch()
        assert compute(home, THROUGH_PYOPENCL) == ""


class TestNoPlace:
    def test_a_home_that_takes_no_files(self, tmp_path: Path) -> None:
        home = tmp_path / "a file"
        home.touch()
        said = compute(home)
        assert f"OpenCL kernels are compiled anew by each process: no files can be written in {home}" in said
        assert home.read_bytes() == b""

    @pytest.mark.slow
    @pytest.mark.skipif(not Path("/proc/self").exists(), reason="no /proc")
    def test_a_home_of_the_system(self) -> None:
        process = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", COMPUTE],
            env=environment(Path("/proc")),
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=False,
        )
        # Mesa says on its own account where it would keep its shaders
        said = [line for line in process.stderr.splitlines() if "shader cache" not in line]
        assert (process.returncode, process.stdout, said) == (0, "right\n", [])

    @pytest.mark.slow
    def test_a_cache_folder_that_is_a_file(self, home: Path) -> None:
        (home / "file").touch()
        for name in ("file", "file/below"):
            assert "no files can be written in" in compute(home, POCL_CACHE_DIR=str(home / name))

    def test_a_temporary_folder_goes_with_its_process(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, recwarn: pytest.WarningsRecorder
    ) -> None:
        at_exit: list[tuple[Any, ...]] = []
        monkeypatch.setattr(caches.atexit, "register", lambda *call, **_: at_exit.append(call))
        monkeypatch.setitem(caches._state, "prepared", False)
        (tmp_path / "file").touch()
        monkeypatch.setenv("POCL_CACHE_DIR", str(tmp_path / "file"))
        with pytest.warns(UserWarning, match="compiled anew by each process"):
            caches.prepare()
        folder = Path(os.environ["POCL_CACHE_DIR"])
        assert folder.is_dir()
        ((remove, *arguments),) = at_exit
        remove(*arguments)
        assert not folder.exists()


class TestFolder:
    def test_pocls_own_rule(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("POCL_CACHE_DIR", "/a")
        monkeypatch.setenv("XDG_CACHE_HOME", "/b")
        monkeypatch.setenv("HOME", "/c")
        found = []
        for name in ("POCL_CACHE_DIR", "XDG_CACHE_HOME", "HOME"):
            found.append(str(caches.pocl_folder()))
            monkeypatch.delenv(name)
        assert found == ["/a", "/b/pocl/kcache", "/c/.cache/pocl/kcache"]

    def test_programs_of_others_are_left_alone(self, tmp_path: Path) -> None:
        ours, theirs = tmp_path / "AB" / ("A" * 37), tmp_path / "AB" / ("B" * 37)
        for program, kernel in ((ours, "product"), (theirs, "another_kernel")):
            (program / kernel / "1-1-1").mkdir(parents=True)
            (program / "program.bc").write_bytes(b"BC\xc0\xde" + bytes(8))
            (program / kernel / "1-1-1" / f"{kernel}.so").write_bytes(b"garbage")
        caches.remove_misplaced(tmp_path)
        caches.remove_damaged(tmp_path)
        assert not ours.exists()
        assert len([path for path in theirs.rglob("*") if path.is_file()]) == 2

    def test_other_files_are_left_alone(self, tmp_path: Path) -> None:
        """POCL_CACHE_DIR may name a folder that is used for more."""
        kept = [
            tmp_path / "AB",
            tmp_path / "xy" / "notes",
            tmp_path / "CD" / "NOTES",
            tmp_path / "EF" / "G" / "product",
        ]
        for path in kept:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(b"mine")
        misplaced = [tmp_path / "CD" / ("A" * 37), tmp_path / "EF" / ("B" * 37) / "product"]
        for path in misplaced:
            path.parent.mkdir(exist_ok=True)
            path.touch()
        caches.remove_misplaced(tmp_path)
        caches.remove_damaged(tmp_path)
        assert all(path.read_bytes() == b"mine" for path in kept)
        assert not any(path.exists() for path in misplaced)

    def test_checksums_are_added(self, tmp_path: Path) -> None:
        program = tmp_path / "AB" / ("A" * 37)
        (program / "product").mkdir(parents=True)
        (program / "program.bc").write_bytes(b"BC\xc0\xde" + bytes(8))
        caches.note_checksums(tmp_path, os.getpid() + 1)
        assert not (program / caches.CHECKSUMS).exists()
        caches.note_checksums(tmp_path, os.getpid())
        first = caches.noted_checksums(program)
        assert set(first) == {"program.bc"}
        (program / "product" / "product.so").write_bytes(b"\x7fELF" + bytes(60))
        (program / "program.bc").write_bytes(b"BC\xc0\xde" + bytes(12))
        caches.note_checksums(tmp_path, os.getpid())
        second = caches.noted_checksums(program)
        assert set(second) == {"program.bc", str(Path("product", "product.so"))}
        assert second["program.bc"] == first["program.bc"]
        caches.remove_damaged(tmp_path)
        assert not program.exists()


class TestProcesses:
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

    @pytest.mark.parametrize("count", [2, pytest.param(6, marks=pytest.mark.slow)])
    def test_several_compile_at_once(self, count: int, tmp_path: Path) -> None:
        home = tmp_path / "home"
        home.mkdir()
        for process in [started(COMPUTE, home) for _ in range(count)]:
            assert finished(process) == ("right\n", "")
        assert compute(home) == ""

    @pytest.mark.slow
    def test_several_find_damage_at_once(self, pocl: None, home: Path) -> None:
        for path in pocl_files(home, "*.so"):
            garbage(path)
        for process in [started(COMPUTE, home) for _ in range(4)]:
            assert finished(process) == ("right\n", "")

    @pytest.mark.parametrize("how", ["fork", pytest.param("multiprocessing", marks=pytest.mark.slow)])
    def test_one_forked_after_opencl_was_used(self, how: str, home: Path) -> None:
        out, err = finished(started(FORK, home, how))
        lines = out.splitlines()
        assert err == ""
        assert len(lines) == 5
        assert all(line.startswith("this process was forked from one that had used OpenCL") for line in lines[:4])
        assert lines[4] == f"child {3 if how == 'fork' else 0}"


@pytest.mark.slow
def test_pocl_without_a_linker(pocl: None, tmp_path: Path) -> None:
    """Not even from its cache: what is not in there could not be compiled."""
    home = tmp_path / "home"
    home.mkdir()
    index = next(i for i, found in enumerate(device.devices()) if found.platform == POCL)
    compute(home, VRTE_OPENCL_DEVICE=str(index))
    _, err = started(COMPUTE, home, PATH="/nonexistent", VRTE_OPENCL_DEVICE=str(index)).communicate(timeout=120)
    assert err.splitlines()[-1] == (
        f"vrte.DeviceError: "
        f"VRTE_OPENCL_DEVICE={index} names a device that does not compute: it finds no linker "
        "(install binutils, which brings ld)"
    )


def test_the_session_of_the_tests_keeps_its_kernels_here(opencl: Session) -> None:
    assert opencl.kernels
    assert Path.home() not in caches.pocl_folder().parents or ROOT in caches.pocl_folder().parents


def test_no_temporary_folder_either(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(caches.tempfile, "tempdir", str(tmp_path / "absent"))
    with pytest.raises(DeviceError, match="OpenCL kernels cannot be compiled: neither"):
        caches._use_temporary_folder(tmp_path)
