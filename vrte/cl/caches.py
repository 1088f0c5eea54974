"""What the OpenCL libraries keep on disk between processes: looked through before they read it, and done without where
it cannot be used.

PoCL keeps a folder a program: `program.bc` and one shared library a kernel. It ends the process (no exception) where
one of them is damaged, and shows no device at all where its folder cannot be written. So each file's checksum is noted
at the end of a process that used it, and at the start of the next whatever differs is removed: it is compiled again.
"""

import atexit
import hashlib
import json
import os
import re
import shutil
import tempfile
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib.resources import files
from pathlib import Path
from typing import Any

from vrte.basics.errors import DeviceError

CHECKSUMS = "vrte-checksums.json"
SHORT, LONG = re.compile("[A-P]{2}"), re.compile("[A-P]{30,}")  # names of PoCL's folders
_lock = threading.Lock()
_state: dict[str, Any] = {"prepared": False, "noted": False}


def prepare() -> None:
    """Once a process, before OpenCL is first asked for anything."""
    with _lock:
        if _state["prepared"]:
            return
        _state["prepared"] = True
        folder = pocl_folder()
        if can_write_in(folder):
            remove_misplaced(folder)
            remove_damaged(folder)
        else:
            _use_temporary_folder(folder)


def pocl_folder() -> Path:
    """Where PoCL keeps what it compiled: its own rule."""
    given = os.environ.get("POCL_CACHE_DIR")
    if given:
        return Path(given)
    if os.environ.get("XDG_CACHE_HOME"):
        return Path(os.environ["XDG_CACHE_HOME"], "pocl", "kcache")
    if os.environ.get("HOME"):
        return Path(os.environ["HOME"], ".cache", "pocl", "kcache")
    return Path(tempfile.gettempdir(), "pocl", "kcache")


def can_write_in(folder: Path) -> bool:
    """Whether it is a folder, or can be made one, and takes files: tried, because permissions do not tell all."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _use_temporary_folder(unusable: Path) -> None:
    try:
        folder = tempfile.mkdtemp(prefix="vrte-opencl-")
    except OSError as error:
        raise DeviceError(f"OpenCL kernels cannot be compiled: neither {unusable} nor {error}") from error
    os.environ["POCL_CACHE_DIR"] = folder
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    warnings.warn(
        f"OpenCL kernels are compiled anew by each process: no files can be written in {unusable} "
        "(POCL_CACHE_DIR names another folder)",
        UserWarning,
        stacklevel=2,
    )


def remove_misplaced(folder: Path) -> None:
    """Files where PoCL has folders of programs and of this package's kernels: it cannot compile there."""
    ours = our_kernels()
    for program in programs(folder):
        kernels = [program / name for name in ours] if program.is_dir() else []
        for path in (program, *kernels):
            if path.is_file():
                with suppress(OSError):
                    path.unlink()


def programs(folder: Path) -> Iterator[Path]:
    """What has the name of a program of PoCL's: many letters from A to P, in a folder of two."""
    for path in folder.glob("??/*"):
        if SHORT.fullmatch(path.parent.name) and LONG.fullmatch(path.name):
            yield path


def programs_of_ours(folder: Path) -> Iterator[Path]:
    """Folders of programs that hold no kernels but this package's: others' are left alone."""
    ours = our_kernels()
    for program in programs(folder):
        try:
            kernels = {entry.name for entry in os.scandir(program) if entry.is_dir()}
        except OSError:  # no folder, or gone since
            continue
        if kernels <= ours and (program / "program.bc").is_file():
            yield program


def our_kernels() -> set[str]:
    """Names of all kernels of the package."""
    from vrte.cl.building import kernel_names

    texts = (file.read_text(encoding="utf-8") for file in files("vrte.cl").iterdir() if file.name.endswith(".cl"))
    return set().union(*map(kernel_names, texts))


def remove_damaged(folder: Path) -> None:
    """Whatever differs from its checksum, or has none and does not look like what it is, goes with its program."""
    for program in programs_of_ours(folder):
        known = noted_checksums(program)
        if any(is_damaged(path, known.get(str(path.relative_to(program)))) for path in compiled(program)):
            shutil.rmtree(program, ignore_errors=True)


def compiled(program: Path) -> list[Path]:
    """What PoCL compiled of a program."""
    return [path for path in program.rglob("*") if path.suffix in LOOKS]


def is_damaged(path: Path, checksum: str | None) -> bool:
    """Against its checksum; without one, by how it begins and whether it is all there."""
    try:
        content = path.read_bytes()
    except OSError:
        return path.exists()
    if checksum is not None:
        return hashlib.sha256(content).hexdigest() != checksum
    beginning, size = LOOKS[path.suffix]
    return not content.startswith(beginning) or len(content) < size(content)


def elf_size(content: bytes) -> int:
    """Bytes that a 64-bit little-endian ELF file must have: its section headers come last.

    >>> header = bytearray(64)
    >>> header[40:48], header[58:60], header[60:62] = (5000).to_bytes(8, "little"), b"\\x40\\0", b"\\x03\\0"
    >>> elf_size(bytes(header))
    5192
    """
    begin, size, count = (
        int.from_bytes(content[first:last], "little") for first, last in ((40, 48), (58, 60), (60, 62))
    )
    return max(64, begin + size * count)


def bitcode_size(content: bytes) -> int:
    """Bytes that LLVM's bitcode must have: four, then blocks that say how many words follow their first two.

    >>> bitcode_size(b"BC\\xc0\\xde" + bytes(4) + (5).to_bytes(4, "little") + bytes(20))
    32
    """
    at = 4
    while at + 8 <= len(content):
        at += 8 + 4 * int.from_bytes(content[at + 4 : at + 8], "little")
    return max(12, at)


LOOKS: dict[str, tuple[bytes, Callable[[bytes], int]]] = {
    ".so": (b"\x7fELF", elf_size),
    ".bc": (b"BC\xc0\xde", bitcode_size),
}


def noted_checksums(program: Path) -> dict[str, str]:
    """By path in the program's folder; none where the list itself is damaged."""
    try:
        found = json.loads((program / CHECKSUMS).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def note_use() -> None:
    """Checksums are noted at the end of this process: by then each file in use has proved to load."""
    with _lock:
        if not _state["noted"]:
            _state["noted"] = True
            atexit.register(note_checksums, pocl_folder(), os.getpid())


def note_checksums(folder: Path, process: int) -> None:
    """Adds the checksums of what has none yet; in a forked process, nothing."""
    if os.getpid() != process:
        return
    for program in programs_of_ours(folder):
        known, paths = noted_checksums(program), compiled(program)
        missing = [path for path in paths if str(path.relative_to(program)) not in known]
        try:
            if missing:
                found = {str(path.relative_to(program)): checksum_of(path) for path in missing}
                write_whole(program / CHECKSUMS, json.dumps(known | found, indent=0))
        except OSError:  # another process removed it, or the disk is full: the next one notes it
            continue


def checksum_of(path: Path) -> str:
    """SHA-256 in hexadecimal."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def write_whole(path: Path, text: str) -> None:
    """All of the file or nothing of it, whoever else writes it."""
    handle, name = tempfile.mkstemp(dir=path.parent)
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        file.write(text)
    os.replace(name, path)


def past_the_invokers(make: Callable[[], Any]) -> Any:
    """What ``make`` makes of kernels, without pyopencl's cache of their Python wrappers where that cannot be used."""
    import pyopencl

    if not pyopencl._PYOPENCL_NO_CACHE and not can_write_in(invoker_folder()):
        _without_invoker_cache()
    try:
        return make()
    except pyopencl.Error:
        raise
    except Exception:
        # a damaged file: sqlite3 and pickle raise all sorts of things
        if pyopencl._PYOPENCL_NO_CACHE:
            raise
        _without_invoker_cache()
        return make()


def _without_invoker_cache() -> None:
    """As PYOPENCL_NO_CACHE does, which pyopencl reads once, when it is imported."""
    import pyopencl

    pyopencl._PYOPENCL_NO_CACHE = True


def invoker_folder() -> Path:
    """Where pyopencl keeps them: the folder of pytools' dictionaries."""
    import platformdirs

    return Path(platformdirs.user_cache_dir("pytools", "pytools"))
