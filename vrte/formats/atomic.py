"""Files that are either complete or not there."""

import errno
import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from vrte.formats.text_file import file_name


@contextmanager
def atomic_write(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A path beside ``path`` to write to; it takes the place of ``path`` when the block ends well.

    Any exception, an interrupt included, removes what was written and leaves a file that was at ``path``
    before as it was. Raises SceneError for a path that no file can have, OSError where the folder is not there,
    cannot be written to, or has another folder at that place.

    >>> with atomic_write("result.csv") as part:
    ...     part.write_text("mu_i,mu_o")
    9
    """
    target = Path(os.path.realpath(file_name(path)))  # through a symbolic link, so that the link survives
    if target.is_dir() or not target.parent.is_dir():
        code = errno.EISDIR if target.is_dir() else errno.ENOTDIR if target.parent.exists() else errno.ENOENT
        raise OSError(code, os.strerror(code), os.fsdecode(path))
    # a name of its own: with more added to it, one as long as may be would be too long
    part = target.with_name(f".vrte.{uuid.uuid4().hex}.part")
    try:
        yield part
        os.replace(part, target)
    finally:
        part.unlink(missing_ok=True)
