"""A journal: what a fit or a sweep has done so far, in files that end in a checksum, so that it can be resumed."""

import json
import os
from pathlib import Path
from typing import Any

from vrte.basics.errors import SceneError
from vrte.formats.atomic import DAMAGED, LENGTH, WORD, PathName, check_file_name, make_seal, write_atomically

LARGEST_FILE = 500_000_000  # bytes


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
    if os.path.getsize(name) > LARGEST_FILE:
        raise SceneError(f"{name}: longer than {LARGEST_FILE} bytes")
    found = Path(name).read_bytes()
    content, seal = found[:-LENGTH], found[-LENGTH:]
    if not seal.startswith(WORD):
        raise SceneError(f"{name}: no file that {writer} wrote")
    if seal != make_seal([content]):
        raise SceneError(f"{name}: {DAMAGED}")
    return content


def write_journal(path: PathName, content: Any, on_disk: bool = False) -> None:
    """Writes the content as one line of JSON and its checksum, as `write_sealed` does."""
    write_sealed(path, json.dumps(content).encode() + b"\n", on_disk)


def read_journal(path: PathName, writer: str = "vrte") -> Any:
    """The content that `write_journal` wrote; raises as `read_sealed` does."""
    content = read_sealed(path, writer)
    try:
        return json.loads(content)
    except (ValueError, RecursionError) as error:
        raise SceneError(f"{os.fspath(path)}: {error}") from error


def flush(path: Path) -> None:
    """Writes a file, or the names of the files in a folder, from memory to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
