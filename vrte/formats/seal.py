"""A checksum at the end of a file: whether its bytes are still those that were written."""

import hashlib
import os

from vrte.basics.errors import SceneError

WORD = b"vrte sha256 "
LENGTH = len(WORD) + 64 + 1
BLOCK = 1 << 20  # bytes


def seal_of(*parts: "bytes | memoryview") -> bytes:
    """The last line of a file whose bytes are these parts.

    >>> seal_of(b"gold")[:20], len(seal_of(b"gold")) == LENGTH
    (b'vrte sha256 24d7f03d', True)
    """
    made = hashlib.sha256()
    for part in parts:
        made.update(part)
    return WORD + made.hexdigest().encode() + b"\n"


def is_sealed(path: str) -> bool:
    """Whether a file ends in a checksum, which fits. Raises SceneError where it does not, OSError.

    HDF5 takes such an end away when it changes a file: nothing that others did to it is taken for damage.
    """
    size = os.path.getsize(path) - LENGTH
    if size < 0:
        return False
    with open(path, "rb") as file:
        file.seek(size)
        seal = file.read(LENGTH)
        if not seal.startswith(WORD):
            return False
        file.seek(0)
        made = hashlib.sha256()
        while size > 0 and (block := file.read(min(BLOCK, size))):
            made.update(block)
            size -= len(block)
    if seal != WORD + made.hexdigest().encode() + b"\n":
        raise SceneError("is damaged: its bytes are not those that were written (checksum)")
    return True
