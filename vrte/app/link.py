"""A scene in an address: its TOML, compressed, in signs that an address takes. Whoever sends one is a stranger."""

import base64
import binascii
import zlib
from typing import Any

from vrte.basics.errors import SceneError
from vrte.formats.scene_file import toml_content
from vrte.formats.scene_writer import toml_text

LONGEST = 200_000  # signs of a link; browsers take no more than some 100 000 to 2 million
LARGEST = 1_000_000  # bytes of the scene in it


def text_of(content: dict[str, Any]) -> str:
    """A scene's content as the end of an address, behind "#scene=". Raises SceneError where it is too long.

    >>> content_of(text_of({"nodes": 8}))
    {'nodes': 8}
    """
    packed = base64.urlsafe_b64encode(zlib.compress(toml_text(content).encode(), 9)).decode().rstrip("=")
    if len(packed) > LONGEST:
        raise SceneError(
            f"the scene makes a link of {len(packed)} signs, and at most {LONGEST} work: download it instead"
        )
    return packed


def content_of(text: str) -> dict[str, Any]:
    """The content of a scene that a link carries. Raises SceneError for what is none, before it takes any memory."""
    if len(text) > LONGEST:
        raise SceneError(f"a link must have at most {LONGEST} signs, not {len(text)}")
    try:
        unpacker = zlib.decompressobj()
        data = unpacker.decompress(base64.b64decode(text + "=" * (-len(text) % 4), "-_", validate=True), LARGEST + 1)
        if len(data) > LARGEST:
            raise SceneError(f"a scene in a link must have at most {LARGEST} bytes")
        if not unpacker.eof:
            raise SceneError("the link is cut short")
        return toml_content(data.decode())
    except (binascii.Error, zlib.error, ValueError) as error:
        if isinstance(error, SceneError):
            raise
        raise SceneError("the link holds no scene, or it is damaged") from error
