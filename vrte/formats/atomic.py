"""Files that are either complete or not there."""

import errno
import os
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from vrte.formats.text_file import check_file_name


@contextmanager
def write_atomically(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A path beside ``path`` to write to; it takes the place of ``path`` when the block ends well.

    Any exception, an interrupt included, removes what was written and leaves a file that was at ``path``
    before as it was. Raises SceneError for a path that no file can have, OSError where the folder is not there,
    cannot be written to, or has another folder at that place.

    >>> with write_atomically("result.csv") as part:
    ...     part.write_text("mu_i,mu_o")
    9
    """
    target = Path(os.path.realpath(check_file_name(path)))  # through a symbolic link, so that the link survives
    if target.is_dir():
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR), os.fsdecode(path))
    part = _choose_name_beside(target)
    try:
        yield part
        os.replace(part, target)
    finally:
        part.unlink(missing_ok=True)


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


def _choose_name_beside(target: Path) -> Path:
    """A name of its own in the same folder: with more added to it, one as long as may be would be too long."""
    if not target.parent.is_dir():
        code = errno.ENOTDIR if target.parent.exists() else errno.ENOENT
        raise OSError(code, os.strerror(code), os.fsdecode(target))
    return target.with_name(f".vrte.{uuid.uuid4().hex}.part")
