"""Files of text, read up to a length that makes sense."""

import os

from vrte.basics.arrays import put_in_one_line
from vrte.basics.errors import SceneError
from vrte.formats.seal import check_text


def check_file_name(path: str | bytes | os.PathLike[str]) -> str:
    """A name that a file can have, or a SceneError.

    >>> check_file_name("scene.toml")
    'scene.toml'
    """
    try:
        name = os.fsdecode(path)
    except TypeError:
        raise SceneError(f"path must be the name of a file, not an object of type {type(path).__name__}") from None
    if not name or "\0" in name:
        raise SceneError(f"path must be the name of a file, not {name!r:.80}")
    return name


def check_file(path: str | os.PathLike[str]) -> str:
    """The name of a file, if no folder, pipe or device is there: these may have no end. Raises SceneError.

    >>> check_file("gold_powder.toml")
    'gold_powder.toml'
    """
    name = check_file_name(path)
    if os.path.exists(name) and not os.path.isfile(name):
        raise SceneError("it is no file, but a folder, a pipe or a device")
    return name


def read_text(path: str | os.PathLike[str], most: int) -> str:
    """The text of a file in UTF-8, with or without a byte-order mark, of at most ``most`` bytes.

    Raises SceneError for something else, and for a table of vrte's that is not as it was written; OSError where the
    file cannot be read.

    >>> read_text("gold_powder.toml", 1_000_000).count("[[layer]]")
    1
    """
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


def read_rows(
    path: str | os.PathLike[str], most_bytes: int, most_rows: int
) -> tuple[list[str], list[tuple[int, list[float]]]]:
    """A small table: the names in its first line that is no comment (#), and the numbers of every other with its place.

    Raises SceneError naming the line, OSError where the file cannot be read.

    >>> read_rows("rayleigh.csv", 1_000_000, 10)[1][0]
    (2, [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    """
    text = read_text(check_file(path), most_bytes)
    lines = [
        (place, line) for place, line in enumerate(text.splitlines(), 1) if line.strip() and line.lstrip()[0] != "#"
    ]
    header = [name.strip() for name in lines[0][1].split(",")] if lines else []
    if len(lines) > most_rows + 1:
        raise SceneError(f"the table must have at most {most_rows} rows, not {len(lines) - 1}")
    return header, [(place, _read_numbers(place, line)) for place, line in lines[1:]]


def _read_numbers(place: int, line: str) -> list[float]:
    try:
        return [float(item) for item in line.split(",")]
    except ValueError:
        given = put_in_one_line(repr(line.strip()), 60)
        raise SceneError(f"line {place}: {given} holds something that is not a number") from None
