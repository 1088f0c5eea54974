"""Files that are either complete or not there."""

import errno
import os
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from vrte.formats.seal import COMMENT, LENGTH, make_seal, read_blocks
from vrte.formats.text_file import check_file_name


@contextmanager
def write_atomically(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A path beside ``path`` to write to; it takes the place of ``path`` when the block ends well.

    Any exception, an interrupt included, removes what was written and leaves a file that was at ``path``
    before as it was. Raises SceneError for a path that no file can have, OSError, which names ``path``, where the
    folder is not there or cannot be written to, the disk is full, or something else than a file is at that place: a
    folder, a pipe, a device or a link to one.

    >>> with write_atomically("result.csv") as part:
    ...     part.write_text("mu_i,mu_o")
    9
    """
    target = Path(os.path.realpath(check_file_name(path)))  # through a symbolic link, so that the link survives
    if target.exists() and not target.is_file():
        code, words = (errno.EISDIR, "") if target.is_dir() else (errno.EEXIST, "A pipe or a device is there, no file")
        raise OSError(code, words or os.strerror(code), os.fsdecode(path))
    part = _choose_name_beside(target)
    with _name_in_errors(path, part):
        try:
            yield part
            os.replace(part, target)
        finally:
            part.unlink(missing_ok=True)


@contextmanager
def write_sealed_text(path: str | os.PathLike[str]) -> Iterator[TextIO]:
    """A text file in UTF-8 to write to, complete or not there, whose first line is a comment with the checksum of all
    lines behind it, by which readers know damage; raises as `write_atomically`.

    >>> with write_sealed_text("index.csv") as file:
    ...     file.write("wavelength_um,n,k\\n0.55,1.5,0.0\\n")
    31
    >>> print(Path("index.csv").read_text()[:24])
    # vrte sha256 ef98813214
    """
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


@contextmanager
def write_folder_atomically(path: str | os.PathLike[str], mark: str) -> Iterator[Path]:
    """The like for a folder of files; one at ``path`` that holds the file ``mark`` is replaced, nothing else is.

    >>> with write_folder_atomically("result.zarr", "zarr.json") as part:
    ...     part.mkdir()
    """
    target = Path(os.path.realpath(check_file_name(path)))
    if target.exists() and not (target / mark).is_file():
        code = errno.EEXIST if target.is_dir() else errno.ENOTDIR
        raise OSError(code, os.strerror(code), os.fsdecode(path))
    part, before = _choose_name_beside(target), _choose_name_beside(target)
    with _name_in_errors(path, part):
        try:
            yield part
            if target.exists():
                os.replace(target, before)
            os.replace(part, target)
        finally:
            if before.exists() and not target.exists():
                os.replace(before, target)
            for folder in (part, before):
                shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def _name_in_errors(path: str | os.PathLike[str], part: Path) -> Iterator[None]:
    """An error of the system about ``part``, or about no file at all, names the file that is written."""
    try:
        yield
    except OSError as error:
        named = error.filename is None or os.fsdecode(error.filename).startswith(str(part))
        if error.errno is None or not named:
            raise
        raise OSError(error.errno, error.strerror, os.fsdecode(path)) from error


def _choose_name_beside(target: Path) -> Path:
    """A name of its own in the same folder: with more added to it, one as long as may be would be too long."""
    if not target.parent.is_dir():
        code = errno.ENOTDIR if target.parent.exists() else errno.ENOENT
        raise OSError(code, os.strerror(code), os.fsdecode(target))
    return target.with_name(f".vrte.{uuid.uuid4().hex}.part")
