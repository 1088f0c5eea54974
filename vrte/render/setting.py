"""The table [render] of a scene file: light, camera, wavelengths, exposure, the object and how it is called."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.calls.spectrum import spectrum
from vrte.formats.materials import expand_content
from vrte.formats.particle_sources import check_particles
from vrte.formats.scene_file import (
    FILE_KEYS,
    find_known_wavelengths,
    list_substances,
    make_scene_file,
    read_content,
    read_listed_wavelengths,
)
from vrte.formats.toml_table import Table
from vrte.optics.facets import RoughSurface
from vrte.render.shapes import SHAPES, SUFFIXES
from vrte.render.sky import FEWEST, FROM_UM, KINDS, MOST, TO_UM, choose_wavelengths
from vrte.results.brdf import Brdf
from vrte.results.spectrum import check_ascending

ACCURACY = 1e-4  # of a BRDF, where the file asks for none
SMALLEST_SIZE, LARGEST_SIZE = 16, 1024
OWN = ("title", "wavelengths", "wavelengths_um", "object", "turn_deg")  # of each material; all else is common
LONGEST_TITLE = 60
SPHERE = "sphere"  # by itself, with neither ground nor sky behind it
OBJECTS = (SPHERE, *SHAPES)
ALLOWED_OBJECTS = f"must be {' or '.join(OBJECTS)}, or a file that ends in {' or '.join(SUFFIXES)}"
RANGES = {  # key: lowest, highest, in words
    "sun_elevation_deg": (1.0, 90.0, "degrees from 1 to 90"),
    "sun_azimuth_deg": (-360.0, 360.0, "degrees from -360 to 360; 0 is behind the camera, 90 at its right"),
    "ground_albedo": (0.0, 1.0, "a number from 0 to 1"),
    "turn_deg": (-360.0, 360.0, "degrees from -360 to 360; counter-clockwise seen from above"),
    "camera_elevation_deg": (-90.0, 90.0, "degrees from -90 to 90"),
    "exposure": (-20.0, 20.0, "stops from -20 to 20; each doubles the brightness"),
}


@dataclass(frozen=True)
class PictureSetting:
    """What is common to all materials of a picture: the ``sky``, one of `vrte.render.sky.KINDS`, angles in degrees, the
    sun's azimuth from behind the camera to its right, ``exposure`` in stops, the side of a picture ``size_px``."""

    sky: str = "rayleigh"
    sun_elevation_deg: float = 40.0
    sun_azimuth_deg: float = -50.0
    ground_albedo: float = 0.2
    camera_elevation_deg: float = 10.0
    exposure: float = 0.0
    size_px: int = 512


@dataclass(frozen=True, eq=False)
class Material:
    """A scene file as the surface of an object: its ``title``, its ``content`` without [render], and the wavelengths
    [um]; ``note`` says where those end before the light that is seen does. ``shape`` is the object, turned about the
    vertical by ``turn_deg``: one of OBJECTS, or the path of a mesh."""

    path: Path
    title: str
    content: dict[str, Any]
    wavelengths_um: Array
    note: str = ""
    shape: str = SPHERE
    turn_deg: float = 0.0

    def brdf(self, wavelength_um: float, mu_i: Array, mu_o: Array, phi: Array) -> Brdf:
        """Its BRDF at one wavelength. Raises SceneError, which names the file, and what `vrte.brdf` raises."""
        content = {"accuracy": ACCURACY, "brdf": {"mu_i": 1.0, "mu_o": 1.0}} | self.content
        asked: dict[str, Any] = {"mu_i": mu_i, "mu_o": mu_o, "phi": phi, "transmission": False}
        try:
            return spectrum(content, wavelength_um, folder=self.path.parent, **asked)[0]
        except SceneError as error:
            hint = "; [render] wavelengths_um can name others" if "wavelength" in str(error) else ""
            raise SceneError(f"{self.path}: {error}{hint}") from error

    def surface(self, wavelength_um: float) -> RoughSurface | None:
        """The rough surface that light meets first, of an interface or a bare base. Raises SceneError."""
        content = {"wavelength_um": wavelength_um, "brdf": {"mu_i": 1.0, "mu_o": 1.0}}
        content = {**self.content, **content}
        scene = make_scene_file(content, "brdf", self.path.parent, check_particles).scene
        top = scene.interfaces[0]
        if top is None:
            return None if scene.thickness else scene.below.facets
        return None if top.is_smooth else top.facets

    @property
    def coloured(self) -> bool:
        """Whether anything in it depends on the wavelength."""
        return "particles" in self.content or any(True for _ in list_substances(self.content))


def read(
    paths: Sequence[Path], count: int | None = None, shapes: Sequence[str] = ()
) -> tuple[list[Material], PictureSetting]:
    """Materials of scene files and the one setting of their picture; ``count`` and ``shapes``, one or one each, win
    over the files'. Raises SceneError, also where two files disagree in the setting."""
    materials: list[Material] = []
    given: dict[str, tuple[Any, Path]] = {}
    if len(shapes) not in (0, 1, len(paths)):
        raise SceneError(f"{len(shapes)} objects for {len(paths)} scenes: must be one for all, or one for each")
    for index, path in enumerate(paths):
        try:
            content = read_content(path)
            keys = (*OWN, *(field.name for field in fields(PictureSetting)))
            file = Table((), content, FILE_KEYS)
            table = file.table("render", keys) if "render" in file else Table(("render",), {}, keys)
            ours: dict[str, Any] = {key: read_bounded(table, key) for key in RANGES if key in table and key not in OWN}
            ours |= {"sky": table.choice("sky", KINDS)} if "sky" in table else {}
            ours |= {"size_px": table.whole("size_px", SMALLEST_SIZE, LARGEST_SIZE)} if "size_px" in table else {}
            shape = shapes[index % len(shapes)] if shapes else None
            title = table.content.get("title", content.get("title", path.stem.replace("_", " ")))
            if not isinstance(title, str) or not title.isprintable() or not 0 < len(title) <= LONGEST_TITLE:
                raise table.wrong("title", f"must be a text of 1 to {LONGEST_TITLE} characters in one line")
            chosen, note = choose_material_wavelengths(path, content, table, count)
            without = {key: one for key, one in expand_content(content, path.parent).items() if key != "render"}
            materials.append(Material(path, title, without, chosen, note, *read_object(path, table, shape)))
        except SceneError as error:
            raise error.behind(path) from error
        except OSError as error:
            raise SceneError(f"{path}: {error.strerror or error}") from error
        for key, value in ours.items():
            other = given.setdefault(key, (value, path))
            if other[0] != value:
                words = f"{other[1]} says {other[0]!r}, and a picture has one"
                raise SceneError(f"{path}: render.{key} = {value!r}: {words}")
    setting = replace(PictureSetting(), **{key: value for key, (value, _) in given.items()})
    if setting.camera_elevation_deg <= 0.0 and any(material.shape != SPHERE for material in materials):
        elevation, path = given["camera_elevation_deg"]
        words = "must be more than 0 for an object that stands on the ground"
        raise SceneError(f"{path}: render.camera_elevation_deg = {elevation:g}: {words}")
    return materials, setting


def read_bounded(table: Table, key: str) -> float:
    """The number of one of RANGES."""
    low, high, allowed = RANGES[key]
    found = table.number(key, allowed)
    if not low <= found <= high:
        raise table.wrong(key, f"must be {allowed}")
    return found


def check_object(name: str, folder: Path = Path()) -> str:
    """The name of an object, or the path of a mesh in ``folder``. Raises SceneError with what is wrong with it."""
    if name in OBJECTS:
        return name
    if Path(name).suffix.lower() not in SUFFIXES:
        raise SceneError(ALLOWED_OBJECTS)
    if not (folder / name).is_file():
        raise SceneError(f"no such file: {folder / name}")
    return str(folder / name)


def read_object(path: Path, table: Table, given: str | None) -> tuple[str, float]:
    """The object and how far it is turned."""
    shape = given or SPHERE
    if given is None and "object" in table:
        name = table.content["object"]
        if not isinstance(name, str):
            raise table.wrong("object", ALLOWED_OBJECTS)
        try:
            shape = check_object(name, path.parent)
        except SceneError as error:
            raise table.wrong("object", str(error)) from None
    if "turn_deg" not in table:
        return shape, 0.0
    if shape == SPHERE:
        raise table.wrong("turn_deg", 'a sphere looks the same however it is turned; object = "vase", say, does not')
    return shape, read_bounded(table, "turn_deg")


def choose_material_wavelengths(
    path: Path, content: dict[str, Any], table: Table, count: int | None
) -> tuple[Array, str]:
    """Wavelengths [um]: ``count`` in equal steps, or those that [render] or the file lists, or as many as it says in
    equal steps, over the visible as far as the tables of substances go; and a note where these end before."""
    if "wavelengths" in table and "wavelengths_um" in table and count is None:
        raise table.unfit("at most one of wavelengths and wavelengths_um")
    if "wavelengths_um" in table and count is None:
        found = np.array(table.numbers("wavelengths_um"))
        if not (0 < found.size <= MOST and found[0] > 0.0 and (np.diff(found) > 0.0).all()):
            raise table.wrong("wavelengths_um", f"must be 1 to {MOST} ascending wavelengths in micrometres")
        return found, ""
    listed = None if count is not None or "wavelengths" in table else read_listed_wavelengths(content)
    if listed and len(listed) <= MOST:
        return check_ascending(listed), ""
    if count is None:
        count = table.whole("wavelengths", FEWEST, MOST) if "wavelengths" in table else FEWEST
    low, high, substance = find_known_wavelengths(content, path.parent)
    if low >= TO_UM or high <= FROM_UM:
        words = f"goes from {low:g} to {high:g} um: nothing of {FROM_UM:g} to {TO_UM:g} um"
        raise SceneError(f"the table of {substance} {words}")
    ends = [f"{end} {edge:g} um" for end, edge in (("begins at", low), ("ends at", high)) if FROM_UM < edge < TO_UM]
    note = f"the table of {substance} {' and '.join(ends)}: beyond, the spectrum stays as it is there" if ends else ""
    return choose_wavelengths(count, low, high), note
