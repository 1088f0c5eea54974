"""Checksums of files: whether their bytes are still those that were written.

Binary files end in theirs. Tables of text begin with theirs, as a comment: what was cut off is noticed, too.
"""

import hashlib
import math
import os
from collections.abc import Iterable, Iterator
from typing import BinaryIO

from vrte.basics.errors import SceneError

WORD = b"vrte sha256 "
LENGTH = len(WORD) + 64 + 1
BLOCK = 1 << 20  # bytes
COMMENT = b"# "
DAMAGED = "is damaged: its bytes are not those that were written (checksum)"


def make_seal(parts: "Iterable[bytes | memoryview]") -> bytes:
    """The line with the checksum of a file whose other bytes are these parts.

    >>> make_seal([b"gold"])[:20], len(make_seal([b"go", b"ld"])) == LENGTH
    (b'vrte sha256 24d7f03d', True)
    """
    made = hashlib.sha256()
    for part in parts:
        made.update(part)
    return WORD + made.hexdigest().encode() + b"\n"


def read_blocks(file: BinaryIO, size: float = math.inf) -> Iterator[bytes]:
    """So many bytes of an open file, or all that are left, piece by piece."""
    while size > 0 and (block := file.read(int(min(BLOCK, size)))):
        yield block
        size -= len(block)


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
        if seal != make_seal(read_blocks(file, size)):
            raise SceneError(DAMAGED)
    return True


def check_text(first: bytes, rest: Iterable[bytes]) -> bool:
    """Whether the ``first`` line of a text is the checksum of the ``rest``. Raises SceneError where it is another one.

    Whoever has saved it in an own way, with other ends of lines or as cells of a sheet, has changed that line, too:
    nothing is said of such a text.

    >>> check_text(b"# " + make_seal([b"gold"]), [b"go", b"ld"]), check_text(b"n,k", [b"gold"])
    (True, False)
    """
    if not (first.startswith(COMMENT + WORD) and len(first) == len(COMMENT) + LENGTH):
        return False
    if first != COMMENT + make_seal(rest):
        raise SceneError(f"{DAMAGED}; if they were changed on purpose, take its first line away")
    return True
