"""What was compiled, kept from process to process in a folder of vrte's own; no other cache is read, mended or removed.

The folder holds one archive with its checksum. A process unpacks it into a folder that nobody else uses, where drivers
read and write while it runs, and at its end adds what is new; the next process removes that folder. So no driver ever
meets a damaged or half-written file, or one of another account's.
"""

import atexit
import hashlib
import io
import os
import shutil
import tempfile
import threading
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.resources import files
from pathlib import Path
from typing import Any

from vrte.basics.errors import DeviceError, warn_user
from vrte.cl.drivers import set_variable

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

VARIABLE = "POCL_CACHE_DIR"
POCL, PYOPENCL, WRAPPERS = "pocl", "pyopencl", "wrappers"  # of a process's folder; the first two are kept
_lock = threading.Lock()
_own: dict[str, Any] = {}


def find_kept_folder() -> Path:
    """Where archives lie: below POCL_CACHE_DIR where that is set, else in the account's folder of caches."""
    import platformdirs

    given = os.environ.get(VARIABLE)
    return Path(given, "vrte") if given else Path(platformdirs.user_cache_dir("vrte", False), "opencl")


@contextmanager
def keep_files_private() -> Iterator[None]:
    """While pyopencl and its drivers are first asked for anything: they are told to keep their files here."""
    folder = own_folder()
    with set_variable("XDG_CACHE_HOME", str(folder / WRAPPERS)):
        import pyopencl.invoker  # noqa: F401  where Python wrappers of kernels are kept is converged by its import
    with set_variable(VARIABLE, str(folder / POCL)):  # children choose for themselves
        yield


def own_folder() -> Path:
    """This process's folder, made and filled when it is first asked for.

    Raises DeviceError where no file can be written anywhere.
    """
    with _lock:
        if not _own:
            _own["folder"] = _prepare(find_kept_folder())
        return _own["folder"]


def _prepare(kept: Path) -> Path:
    archive = kept / f"kernels-{_hash_sources()}.zip"
    try:
        kept.mkdir(parents=True, exist_ok=True, mode=0o700)
        remove_abandoned(kept)
        handle, name = tempfile.mkstemp(prefix="process-", suffix=".lock", dir=kept)
        if fcntl:
            fcntl.flock(handle, fcntl.LOCK_EX)  # as long as this process lives: see `remove_abandoned`
        folder = Path(name).with_suffix("")
        folder.mkdir(mode=0o700)
        content = read_archive(archive)
        for path, data in content.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_bytes(data)
    except OSError as error:
        folder = _make_temporary_folder(kept, error)
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
    else:
        atexit.register(keep_new, archive, folder, set(content), os.getpid())
    (folder / PYOPENCL).mkdir(exist_ok=True)
    return folder


def _hash_sources() -> str:
    folders = (files("vrte").joinpath(folder) for folder in ("cl", "core", "core/kernels"))
    paths = (file for folder in folders for file in folder.iterdir() if file.name.endswith((".cl", ".h")))
    texts = sorted(file.read_bytes() for file in paths)
    return hashlib.sha256(b"".join(texts)).hexdigest()[:16]


def _make_temporary_folder(unusable: Path, error: OSError) -> Path:
    try:
        folder = tempfile.mkdtemp(prefix="vrte-opencl-")
    except OSError as second:
        raise DeviceError(f"OpenCL kernels cannot be compiled: neither {unusable} ({error}) nor {second}") from second
    warn_user(
        f"OpenCL kernels are compiled anew by each process: no files can be written in {unusable} "
        f"({VARIABLE} names another folder)",
        UserWarning,
    )
    return Path(folder)


def remove_abandoned(kept: Path) -> None:
    """Folders of processes that ended: nobody holds their lock."""
    for lock in kept.glob("process-*.lock") if fcntl else ():
        with suppress(OSError), lock.open() as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(lock.with_suffix(""), ignore_errors=True)
            lock.unlink()


def read_archive(path: Path) -> dict[str, bytes]:
    """Its files by name; nothing where there is none, where it is not this account's, or where a byte is not as it was
    written."""
    try:
        if hasattr(os, "getuid") and path.stat().st_uid != os.getuid():
            return {}
        whole = path.read_bytes()
    except OSError:
        return {}
    checksum, content = whole[:32], whole[32:]
    if hashlib.sha256(content).digest() != checksum:
        return {}
    with zipfile.ZipFile(io.BytesIO(content)) as packed:
        return {name: packed.read(name) for name in packed.namelist()}


def write_archive(path: Path, content: dict[str, bytes]) -> None:
    """All of it or nothing, whoever else writes it."""
    memory = io.BytesIO()
    with zipfile.ZipFile(memory, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as packed:
        for name, data in content.items():
            packed.writestr(name, data)
    handle, name = tempfile.mkstemp(dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(hashlib.sha256(memory.getvalue()).digest() + memory.getvalue())
        os.replace(name, path)
    except OSError:
        os.unlink(name)
        raise


def keep_new(archive: Path, folder: Path, known: set[str], process: int) -> None:
    """At the end of a process, not of one forked from it: what it compiled goes to the archive, beside what others have
    put there meanwhile. Its folder stays for the next one to remove: a driver may be compiling yet, for a queue that
    nobody waited for, and would end the process."""
    if os.getpid() != process:
        return
    with suppress(OSError):  # a full disk: compiled again another time
        found = [path for part in (POCL, PYOPENCL) for path in (folder / part).rglob("*") if path.is_file()]
        names = {str(path.relative_to(folder)): path for path in found if not path.name.startswith("tempfile")}
        if set(names) - known:
            write_archive(archive, read_archive(archive) | {name: path.read_bytes() for name, path in names.items()})
    if not fcntl:
        shutil.rmtree(folder, ignore_errors=True)
