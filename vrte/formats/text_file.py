"""Files of text, read up to a length that makes sense."""

import os

from vrte.errors import SceneError


def file_name(path: str | bytes | os.PathLike[str]) -> str:
    """A name that a file can have, or a SceneError.

    >>> file_name("scene.toml")
    'scene.toml'
    """
    try:
        name = os.fsdecode(path)
    except TypeError:
        raise SceneError(f"path must be the name of a file, not an object of type {type(path).__name__}") from None
    if not name or "\0" in name:
        raise SceneError(f"path must be the name of a file, not {name!r:.80}")
    return name


def read_text(path: str | os.PathLike[str], most: int) -> str:
    """The text of a file in UTF-8, with or without a byte-order mark, of at most ``most`` bytes.

    Raises SceneError for something else, OSError where the file cannot be read.

    >>> read_text("gold_powder.toml", 1_000_000).count("[[layer]]")
    1
    """
    with open(file_name(path), "rb") as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise SceneError(f"the file is longer than {most} bytes")
    try:
        return content.decode("utf-8").removeprefix("\ufeff")
    except UnicodeDecodeError as error:
        raise SceneError(f"not a text file in UTF-8 (byte {error.start})") from error
