"""Scenes by some of their numbers: what a fit changes."""

import copy
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.formats.scene_file import SceneFile, make_scene_file, read_content
from vrte.formats.toml_table import is_number
from vrte.scene.scene import Scene
from vrte.sweep.template import convert_to_plain_content, find_parent, put, split_key


class FileFamily:
    """Of a scene file or its content."""

    def __init__(self, content: Mapping[str, Any], names: Sequence[str], folder: Path) -> None:
        self.content, self.names, self.folder = convert_to_plain_content(content), tuple(names), folder
        self.places = [split_key(name) for name in names]
        values = []
        for name, places in zip(self.names, self.places, strict=True):
            try:
                values.append(find_parent(self.content, places)[places[-1]])
            except (LookupError, TypeError, AttributeError):
                raise SceneError(f"{name}: the scene has no such key", name) from None
            if not is_number(values[-1]):
                raise SceneError(f"{name} is {values[-1]!r}, and only a number can be changed", name)
        self.values = np.array(values, float)

    def content_at(self, values: Array) -> dict[str, Any]:
        content = copy.deepcopy(self.content)
        for places, value in zip(self.places, values.tolist(), strict=True):
            put(content, places, value)
        return content

    def file_at(self, values: Array) -> SceneFile:
        return make_scene_file(self.content_at(values), None, self.folder)

    def at(self, values: Array) -> Scene:
        return self.file_at(values).scene


class ObjectFamily:
    """Of a Scene."""

    def __init__(self, scene: Scene, names: Sequence[str]) -> None:
        self.scene, self.names = scene, tuple(names)
        self.places = [split_key(name) for name in names]
        found = []
        for name, places in zip(self.names, self.places, strict=True):
            try:
                owner: Any = scene.layers[int(places[1])] if places[0] == "layer" else scene.base
                found.append(float(getattr(owner, str(places[-1]))))
            except (AttributeError, TypeError, ValueError, LookupError):
                raise SceneError(f"{name}: the scene has no such number", name) from None
        self.values = np.array(found)

    def at(self, values: Array) -> Scene:
        layers, base = list(self.scene.layers), self.scene.base
        for places, value in zip(self.places, values.tolist(), strict=True):
            if places[0] == "layer":
                where = int(places[1])
                layers[where] = replace(layers[where], **{str(places[-1]): value})
            else:
                base = replace(base, **{str(places[-1]): value})  # type: ignore[type-var]
        return Scene(layers, base, self.scene.interfaces)


def make_family(source: Any, names: Sequence[str], folder: str | os.PathLike[str]) -> Any:
    """The scenes of a file, its content, or a Scene. Raises SceneError, OSError."""
    if isinstance(source, Scene):
        return ObjectFamily(source, names)
    if isinstance(source, Mapping):
        return FileFamily(source, names, Path(folder))
    if isinstance(source, str | os.PathLike):
        return FileFamily(read_content(source), names, Path(source).parent)
    return source
