"""Files that are either complete or not there."""

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def atomic_write(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A path beside ``path`` to write to; it takes the place of ``path`` when the block ends well.

    Any exception, an interrupt included, removes what was written and leaves a file that was at ``path``
    before as it was. Raises OSError where the folder cannot be written to.

    >>> with atomic_write("result.csv") as part:
    ...     part.write_text("mu_i,mu_o")
    9
    """
    target = Path(os.path.realpath(path))  # through a symbolic link, so that the link survives
    part = target.with_name(f".{target.name}.{uuid.uuid4().hex}.part")
    try:
        yield part
        os.replace(part, target)
    finally:
        part.unlink(missing_ok=True)
