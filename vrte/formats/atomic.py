"""Files: their names, their checksums, how they are written, complete or not at all; journals, which are resumed.

Binary files end in their checksum. Tables of text begin with theirs, as a comment: a cut is noticed, too.
"""

import errno
import hashlib
import json
import math
import os
import shutil
import uuid
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, TextIO

from vrte.basics.arrays import show_value
from vrte.basics.errors import SceneError

PathName = str | os.PathLike[str]
WORD = b"vrte sha256 "
LENGTH = len(WORD) + 64 + 1  # bytes of a seal
BLOCK = 1 << 20  # bytes
LARGEST_SEALED = 500_000_000  # bytes of what a fit or a sweep keeps
COMMENT = b"# "
DAMAGED = "it is damaged: its bytes are not those that were written (checksum)"


def check_file_name(path: str | bytes | os.PathLike[str]) -> str:
    """A name that a file can have. Raises SceneError."""
    name = os.fsdecode(path) if isinstance(path, str | bytes | os.PathLike) else ""
    if not name or "\0" in name:
        raise SceneError(f"path must be the name of a file, not {show_value(path)}")
    return name


def check_file(path: PathName) -> str:
    """The name of a file, if no folder, pipe or device is there: these may have no end. Raises SceneError."""
    name = check_file_name(path)
    if os.path.exists(name) and not os.path.isfile(name):
        raise SceneError("it is no file, but a folder, a pipe or a device")
    return name


def read_text(path: PathName, most: int) -> str:
    """The text of a file in UTF-8 of at most ``most`` bytes, as it was written. Raises SceneError, OSError."""
    with open(check_file_name(path), "rb") as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise SceneError(f"the file is longer than {most} bytes")
    first, end, rest = content.partition(b"\n")
    check_text(first + end, [rest])
    try:
        return content.decode("utf-8").removeprefix("\ufeff")
    except UnicodeDecodeError as error:
        raise SceneError(f"not a text file in UTF-8 (byte {error.start})") from error


def make_seal(parts: "Iterable[bytes | memoryview]") -> bytes:
    """The line with the checksum of a file whose other bytes are these parts."""
    made = hashlib.sha256()
    for part in parts:
        made.update(part)
    return WORD + made.hexdigest().encode() + b"\n"


def read_blocks(file: BinaryIO, size: float = math.inf) -> Iterator[bytes]:
    """At most ``size`` bytes of an open file, piece by piece."""
    while size > 0 and (block := file.read(int(min(BLOCK, size)))):
        yield block
        size -= len(block)


def is_sealed(path: str) -> bool:
    """Whether a file ends in a checksum, which changes by HDF5 remove. Raises SceneError where it is wrong, OSError."""
    size = os.path.getsize(path) - LENGTH
    with open(path, "rb") as file:
        file.seek(max(size, 0))
        seal = file.read(LENGTH)
        file.seek(0)
        if seal.startswith(WORD) and seal != make_seal(read_blocks(file, size)):
            raise SceneError(DAMAGED)
    return seal.startswith(WORD)


def check_text(first: bytes, rest: Iterable[bytes]) -> bool:
    """Whether the ``first`` line is the checksum of the ``rest``. Raises SceneError where it does not fit."""
    if not (first.startswith(COMMENT + WORD) and len(first) == len(COMMENT) + LENGTH):
        return False
    if first != COMMENT + make_seal(rest):
        raise SceneError(f"{DAMAGED}; if they were changed on purpose, take its first line away")
    return True


@contextmanager
def write_atomically(path: PathName, mark: str = "") -> Iterator[Path]:
    """A path to write to, which takes the place of ``path`` when the block ends well, else all is as before; with
    ``mark`` that of a folder, which replaces only one that holds the file ``mark``. Raises SceneError, OSError."""
    target = Path(os.path.realpath(check_file_name(path)))  # through a symbolic link, so that the link survives
    code = 0
    if not target.parent.is_dir():
        code = errno.ENOTDIR if target.parent.exists() else errno.ENOENT
    elif target.exists() and not (target / mark).is_file():
        code = errno.EISDIR if target.is_dir() and not mark else errno.EEXIST
    if code:
        raise OSError(code, os.strerror(code), os.fsdecode(path))
    part, before = (target.with_name(f".vrte.{uuid.uuid4().hex}.part") for _ in range(2))
    try:
        yield part
        if mark and target.exists():
            os.replace(target, before)
        os.replace(part, target)
    except OSError as error:  # of the system, about the part or about no file at all
        if error.errno is None or not os.fsdecode(error.filename or part).startswith(str(part)):
            raise
        raise OSError(error.errno, error.strerror, os.fsdecode(path)) from error
    finally:
        if before.exists() and not target.exists():
            os.replace(before, target)
        for left in (part, before):
            if left.is_dir():
                shutil.rmtree(left, ignore_errors=True)
            else:
                left.unlink(missing_ok=True)


def write_text(text: str, path: PathName) -> None:
    """Writes a text file in UTF-8, all of it or nothing. Raises as `write_atomically`."""
    with write_atomically(path) as part:
        part.write_text(text, encoding="utf-8", newline="")


@contextmanager
def write_sealed_text(path: PathName) -> Iterator[TextIO]:
    """A text file in UTF-8 to write to, behind a comment with its checksum. Raises as `write_atomically`."""
    head = len(COMMENT) + LENGTH
    with write_atomically(path) as part:
        with open(part, "w", encoding="utf-8", newline="") as file:
            file.write(" " * head)
            yield file
        with open(part, "r+b") as whole:
            whole.seek(head)
            seal = make_seal(read_blocks(whole))
            whole.seek(0)
            whole.write(COMMENT + seal)


def write_sealed(path: PathName, content: bytes, on_disk: bool = False) -> None:
    """Writes content and checksum, all of it or nothing, ``on_disk`` also across a power cut. Raises OSError."""
    with write_atomically(path) as part:
        part.write_bytes(content + make_seal([content]))
        if on_disk:
            flush(part)
    if on_disk:
        flush(Path(path).parent)


def read_sealed(path: PathName, writer: str = "vrte") -> bytes:
    """The content that `write_sealed` wrote. Raises SceneError for a file of others or a damaged one, OSError."""
    name = check_file_name(path)
    try:
        if os.path.getsize(name) > LARGEST_SEALED or not is_sealed(name):
            raise SceneError(f"no file that {writer} wrote")
    except SceneError as error:
        raise error.behind(name) from error
    return Path(name).read_bytes()[:-LENGTH]


def write_journal(path: PathName, content: Any, on_disk: bool = False) -> None:
    """Writes the content as one line of JSON and its checksum, as `write_sealed` does."""
    write_sealed(path, json.dumps(content).encode() + b"\n", on_disk)


def read_journal(path: PathName, writer: str = "vrte") -> Any:
    """The content that `write_journal` wrote; raises as `read_sealed` does."""
    try:
        return json.loads(read_sealed(path, writer))
    except SceneError:
        raise
    except (ValueError, RecursionError) as error:
        raise SceneError(f"{os.fspath(path)}: {error}") from error


def flush(path: Path) -> None:
    """Writes a file, or the names of the files in a folder, from memory to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
