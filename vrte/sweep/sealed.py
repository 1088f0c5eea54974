"""Small files that know when they are damaged: written whole, with a checksum at their end."""

import json
import os
from pathlib import Path
from typing import Any

from vrte.formats.atomic import write_atomically
from vrte.formats.seal import LENGTH, make_seal


class DamagedError(ValueError):
    """A file is not as it was written: cut, changed, or gone."""


def write_sealed(path: Path, content: bytes, on_disk: bool = False) -> None:
    """All of it or nothing; ``on_disk``: also after a power cut."""
    with write_atomically(path) as part, open(part, "wb") as file:
        file.write(content + make_seal([content]))
        if on_disk:
            file.flush()
            os.fsync(file.fileno())
    if on_disk:
        flush(path.parent)


def read_sealed(path: Path) -> bytes:
    """What `write_sealed` wrote. Raises DamagedError."""
    try:
        found = path.read_bytes()
    except OSError as error:
        raise DamagedError(f"{path} cannot be read") from error
    content = found[:-LENGTH]
    if found[-LENGTH:] != make_seal([content]):
        raise DamagedError(f"{path} is not as it was written")
    return content


def is_whole(path: Path) -> bool:
    """Whether a file is as it was written."""
    try:
        return read_sealed(path) is not None
    except DamagedError:
        return False


def write_json(path: Path, said: Any, on_disk: bool = False) -> None:
    """Writes what is said as one line of JSON that ends in its checksum."""
    write_sealed(path, json.dumps(said).encode() + b"\n", on_disk)


def read_json(path: Path) -> Any:
    """What `write_json` wrote. Raises DamagedError."""
    return json.loads(read_sealed(path))


def flush(path: Path) -> None:
    """To the disk with a file, or with a folder's names of its files."""
    place = os.open(path, os.O_RDONLY)
    try:
        os.fsync(place)
    finally:
        os.close(place)
