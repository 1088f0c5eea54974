"""From scene files with a table [render] to what a picture shows: light, camera, objects, colours, Stokes vectors."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from vrte.appearance.colours import import_colour_science
from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.calls.spectrum import spectrum
from vrte.exports.half_vectors import HalfVectorTable, tabulate_half_vectors
from vrte.formats.materials import expand_content
from vrte.formats.measured_polarized import directions
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
from vrte.render.geometry import (
    FIELD_DEG,
    SHAPES,
    SUFFIXES,
    UP,
    Body,
    find_shape,
    halve,
    place_camera,
    place_lens,
)
from vrte.render.glare import spread_glare
from vrte.render.objects import (
    CHANNELS,
    Stage,
    View,
    add_glints,
    add_sun,
    draw_background,
    draw_object,
    weigh_channels,
)
from vrte.render.sky import (
    FEWEST,
    FROM_UM,
    KINDS,
    MOST,
    NEEDED,
    TO_UM,
    Film,
    Sky,
    choose_wavelengths,
    make_film,
    make_sky,
    weigh_wavelengths,
)
from vrte.render.surfaces import SceneLight, compute_irradiance
from vrte.render.tables import BrdfTable, Resolution, tabulate_brdf
from vrte.render.tracing import VARIANT, Scene, Tracing, mirror_beam
from vrte.results.brdf import Brdf, Spectrum, check_ascending
from vrte.results.facets import find_facets, leave_out_facets

ACCURACY = 1e-4  # of a BRDF, where the file asks for none
SMALLEST_SIZE, LARGEST_SIZE = 16, 1024
OWN = ("title", "wavelengths", "wavelengths_um", "object", "turn_deg")  # of each material; all else is common
LONGEST_TITLE = 60
SPHERE = "sphere"  # by itself, with neither ground nor sky behind it
OBJECTS = (SPHERE, *SHAPES)
HALVES = ("left", "right")  # of an object, as the camera sees it
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
    vertical by ``turn_deg``: one of OBJECTS, or the path of a mesh, whose axis ``up`` points up."""

    path: Path
    title: str
    content: dict[str, Any]
    wavelengths_um: Array
    note: str = ""
    shape: str = SPHERE
    turn_deg: float = 0.0
    up: str = "z"

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
        return make_scene_file(content, "brdf", self.path.parent, check_particles).scene.facets_on_top

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


def split_object(shape: str) -> tuple[str, str]:
    """The name of an object and, of a half of it, "left" or "right"; otherwise ""."""
    name, _, side = shape.rpartition(":")
    return (name, side) if side in HALVES else (shape, "")


def check_object(name: str, folder: Path = Path()) -> str:
    """The name of an object, or the path of a mesh in ``folder``. Raises SceneError with what is wrong with it."""
    whole, side = split_object(name)
    if side and whole == SPHERE:
        raise SceneError(f'has no halves: "ball:{side}" is half of one on the ground')
    if whole in OBJECTS:
        return name
    if Path(whole).suffix.lower() not in SUFFIXES:
        raise SceneError(ALLOWED_OBJECTS)
    if not (folder / whole).is_file():
        raise SceneError(f"no such file: {folder / whole}")
    return str(folder / name)


def place_side_by_side(materials: Sequence[Material]) -> list[tuple[float, float, str]]:
    """Of each material in a row: where the middle of what it covers is and how wide, in distances of objects from the
    row's middle, and which half of its object that is, "" for all. Raises SceneError."""
    found: list[tuple[float, float, str]] = []
    count = 0
    for index, material in enumerate(materials):
        shape, side = split_object(material.shape)
        partner = materials[index - 1 : index] if side == "right" else materials[index + 1 : index + 2]
        whole = {"left": "right", "right": "left"}
        if side and [split_object(other.shape) for other in partner] != [(shape, whole[side])]:
            words = (
                f"{shape}:left and {shape}:right are of two scenes, one after the other, of one picture (--together)"
            )
            raise SceneError(f"{material.path}: {material.shape} is half of an object: {words}")
        count += side != "right"
        found.append((count - 1.0 + {"": 0.0, "left": -0.25, "right": 0.25}[side], 0.5 if side else 1.0, side))
    return [(middle - 0.5 * (count - 1), room, side) for middle, room, side in found]


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


RESOLUTIONS = (Resolution(), Resolution(48, 180), Resolution(64, 240))
MOST_AT_ONCE = 12  # wavelengths whose tables are in memory, 24 MB each and as much again while they are made
MOST_SPLINES = 2_000_000  # coefficients, of 128 bytes each, of all tables of a sphere that are in memory
APART = 1.15  # middles of objects beside each other
DETAIL = 3  # of traced shapes: flat triangles shadow each other where light grazes
MEAN_DEVIATE = 0.798  # the mean size of a normal deviate of variance 1
FINE_ENOUGH = 3e-3  # error of a BRDF between the directions of its table


@dataclass(frozen=True, eq=False)
class Rendering:
    """One picture before it is drawn, of a material, or of more that stand beside each other.

    CIE ``xyz`` (height, width, 3) and ``stokes`` (height, width, 4), weighted by luminance; Y and I are 1 for a white
    Lambertian surface that faces the sun, NaN around a sphere. Stokes axes: l upright, r to the right. ``cover``
    (height, width) is a sphere's fraction of each pixel, 1 around what stands on the ground. ``errors`` of the BRDFs
    between the directions of their tables; ``places`` of objects across the picture, and the room of each [pixels];
    ``pixel_deg``, the angle between pixels; ``light`` in words, where it is not that of the setting; ``noise`` of a
    traced picture, the standard error of Y over its mean; whether it is shown with ``glare``. ``body`` (height, width):
    which one stands in each pixel, -1 for none, None of a sphere.
    """

    materials: Sequence[Material]
    xyz: Array
    stokes: Array
    cover: Array
    film: Film
    errors: Sequence[float]
    pixel_deg: float = 0.0
    places: Sequence[tuple[float, float]] = ()
    light: str = ""
    noise: float | None = None
    glare: bool = False
    body: Any = None

    @property
    def title(self) -> str:
        """The words above a picture that say which material it shows."""
        return ", ".join(material.title for material in self.materials)

    @property
    def rgba(self) -> Array:
        """The picture in colour, (height, width, 4) from 0 to 1, transparent around a sphere."""
        xyz = np.nan_to_num(self.xyz)
        if self.glare:
            xyz = spread_glare(xyz, self.film.brightness(xyz), self.pixel_deg)
        return np.concatenate([self.film(xyz), self.cover[..., None]], axis=-1)


def compute_pictures(
    materials: Sequence[Material],
    setting: PictureSetting,
    progress: Callable[[int, int, str], None] | None = None,
    resolutions: Sequence[Resolution] = RESOLUTIONS,
    together: bool = False,
    tracing: Tracing | None = None,
) -> list[Rendering]:
    """The pictures of all materials, or the one in which they stand beside each other; ``progress`` is called with
    (steps done, steps, what begins). The first of ``resolutions`` that is fine enough is taken, or the last; with
    ``tracing``, Mitsuba traces objects. Raises MissingExtraError, SceneError, and what `vrte.brdf` raises."""
    import_colour_science(*NEEDED)
    done, steps = 0, sum(2 * material.wavelengths_um.size for material in materials)  # a table and a picture each

    def step(count: int, title: str) -> None:
        nonlocal done
        done += count
        if progress is not None:
            progress(done, steps, title)

    def draw(some: Sequence[Material]) -> Rendering:
        if tracing is not None:
            return draw_traced(some, setting, step, tracing)
        return draw_on_ground(some, setting, step, resolutions)

    if together:
        return [draw(materials)]
    return [
        draw_sphere(material, setting, step, resolutions) if material.shape == SPHERE else draw([material])
        for material in materials
    ]


Step = Callable[[int, str], None]


@dataclass(frozen=True, eq=False)
class Lit:
    """A material in its light: sky, observer and film for its wavelengths, and the tables of its BRDF."""

    material: Material
    setting: PictureSetting
    resolutions: Sequence[Resolution]
    step: Step

    @cached_property
    def sky(self) -> Sky:
        setting = self.setting
        wavelengths = self.material.wavelengths_um.tolist()
        return make_sky(setting.sky, wavelengths, setting.sun_elevation_deg, setting.ground_albedo)

    @cached_property
    def weighed(self) -> tuple[Array, Film]:
        """The observer, Y = 1 for a white surface that faces the sun, and the film for level ground's light."""
        observer = weigh_wavelengths(self.material.wavelengths_um)
        white = observer @ compute_irradiance(self.sky, np.stack([-self.sky.beam, UP])) / np.pi
        return observer / white[1, 0], make_film(white[:, 1], self.setting.exposure)

    @cached_property
    def first(self) -> tuple[BrdfTable, float]:
        """The table that is fine enough at the first, shortest wavelength, where BRDFs vary most, and its error."""
        return find_fine_table(self.material, self.resolutions)

    def tabulate(self, most: int) -> Iterator[tuple[Any, list[BrdfTable]]]:
        """Indices of wavelengths, at most so many at once, and the tables there."""
        material, table = self.material, self.first[0]
        wavelengths = material.wavelengths_um
        for chosen in np.array_split(np.arange(wavelengths.size), -(-wavelengths.size // most)):
            tables = []
            for index in chosen.tolist():
                same = index == 0 or not material.coloured
                tables.append(table if same else tabulate_material(material, wavelengths[index], table.resolution))
                self.step(1, material.title)
            yield chosen, tables
            self.step(chosen.size, material.title)


def draw_sphere(
    material: Material, setting: PictureSetting, step: Step, resolutions: Sequence[Resolution]
) -> Rendering:
    """One sphere without surroundings."""
    step(0, material.title)
    lit = Lit(material, setting, resolutions, step)
    table, error = lit.first
    camera = place_camera(setting.camera_elevation_deg, -setting.sun_azimuth_deg)  # the sun stands at azimuth 0
    view = View(camera, lit.sky, setting.size_px, table.resolution)
    observer, film = lit.weighed
    found = np.full((view.size**2, CHANNELS), np.nan)
    found[view.pixels[0]] = 0.0
    for chosen, tables in lit.tabulate(max(1, MOST_SPLINES // (table.splines.size // 16))):
        found[view.pixels[0]] += weigh_channels(view.stokes(tables, chosen), observer[:, chosen])
    picture = found.reshape(view.size, view.size, CHANNELS)
    stokes = picture[..., [1, 3, 4, 5]]
    return Rendering([material], picture[..., :3], stokes, view.cover, film, [error], FIELD_DEG / view.size)


def draw_on_ground(
    materials: Sequence[Material], setting: PictureSetting, step: Step, resolutions: Sequence[Resolution]
) -> Rendering:
    """Objects beside each other, on the ground under the sky."""
    stage = set_stage(materials, setting)
    all_lit = [Lit(material, setting, resolutions, step) for material in materials]
    step(0, materials[0].title)
    light = SceneLight.of(all_lit[0].sky, setting.ground_albedo, stage.ground)
    found, samples = draw_background(stage, light, all_lit[0].weighed[0])
    for index, lit in enumerate(all_lit):
        step(0, lit.material.title)
        own = samples.choose(np.flatnonzero(samples.body == index))
        for chosen, tables in lit.tabulate(MOST_AT_ONCE):
            light = SceneLight.of(lit.sky.choose(chosen), setting.ground_albedo, stage.ground)
            if own.pixel.size:
                found += draw_object(stage, own, tables, light, lit.weighed[0][:, chosen])
    add_sun(found, stage, all_lit[0].sky, all_lit[0].weighed[0])
    bare = Rendering(materials, *split_channels(found, stage), all_lit[0].weighed[1], [lit.first[1] for lit in all_lit])
    return set_out(bare, stage)


def split_channels(channels: Array, stage: Stage) -> tuple[Array, Array, Array]:
    """XYZ (height, width, 3), Stokes vectors (height, width, 4) and the cover of channels (pixel, 6)."""
    picture = channels.reshape(stage.lens.height, stage.lens.width, CHANNELS)
    return picture[..., :3], picture[..., [1, 3, 4, 5]], np.ones(picture.shape[:2])


def set_out(rendering: Rendering, stage: Stage) -> Rendering:
    """The same with what it takes to write beside its objects."""
    lens = stage.lens
    unit = APART / np.radians(lens.pixel_deg) / lens.distance
    row = place_side_by_side(rendering.materials)
    places = [(0.5 * lens.width + unit * middle, unit * room) for middle, room, _ in row]
    pixel = np.arange(lens.width * lens.height)
    body = stage.rays.find_hits(*stage.look(pixel, np.array(0.5), np.array(0.5)))[0]
    return replace(rendering, pixel_deg=lens.pixel_deg, places=places, body=body.reshape(lens.height, lens.width))


def draw_traced(materials: Sequence[Material], setting: PictureSetting, step: Step, tracing: Tracing) -> Rendering:
    """Objects beside each other, traced at the wavelengths of the material that has most of them; another has the BRDF
    of its own range's end beyond that."""
    from vrte.mitsuba.bsdf import make_bsdf, mi

    mi.set_variant(VARIANT)
    stage = set_stage(materials, setting, DETAIL)
    main = Lit(max(materials, key=lambda one: one.wavelengths_um.size), setting, RESOLUTIONS, step)
    wavelengths = main.material.wavelengths_um
    observer, film = main.weighed
    albedo: float | None = {"rayleigh": setting.ground_albedo, "uniform": 1.0, "sun": 0.0}[setting.sky]
    if tracing.environment is not None:
        albedo, observer = None, weigh_wavelengths(wavelengths)
        film = make_film(observer.sum(axis=1), setting.exposure)
    halves = np.zeros((2, stage.lens.height * stage.lens.width, CHANNELS))
    scene, samples = Scene(stage.bodies, stage.lens, albedo), max(1, tracing.samples // 2)
    made: dict[int, tuple[Any, float]] = {}
    mirrors: dict[int, list[Any]] = {}
    for index, wavelength in enumerate(wavelengths.tolist()):
        for place, material in enumerate(materials):
            step(0, material.title)
            if index == 0 or material.coloured:
                at = float(np.clip(wavelength, *material.wavelengths_um[[0, -1]]))
                table = tabulate_for_tracing(material, at)
                error = made[place][1] if index else measure_table_error(material, at, table)
                made[place] = make_bsdf(table), error
                if table.beam is not None:
                    mirrors.setdefault(place, []).append(partial(mirror_beam, table.beam[:, 0]))
            elif place in mirrors:
                mirrors[place].append(mirrors[place][0])
            step(1, material.title)
        light = tracing.make_light(main.sky.choose([index]), film, observer, index)
        seen = scene.trace(
            [made[place][0] for place in range(len(materials))], light, samples, [2 * index, 2 * index + 1]
        )
        halves += weigh_channels(seen.reshape(-1, 1, 4), observer[:, index : index + 1]).reshape(halves.shape)
        step(len(materials), main.material.title)
    flat = halves.mean(axis=0)
    apart_by = 0.5 * float(np.abs(halves[0] - halves[1])[:, 1].mean()) / MEAN_DEVIATE
    noise = apart_by / (float(flat[:, 1].mean()) or 1.0)  # a black picture has none
    if tracing.environment is None and not tracing.caustics:  # no path has met the sun
        add_sun(flat, stage, main.sky, observer)
        shown = stage.find_samples()
        for place, mirror in mirrors.items():
            own = shown.choose(shown.body == place)
            if own.pixel.size:
                add_glints(flat, stage, own, mirror, main.sky, observer)
    words = "" if tracing.environment is None else f"environment {tracing.environment.name}"
    errors = [made[place][1] for place in range(len(materials))]
    bare = Rendering(materials, *split_channels(flat, stage), film, errors, light=words, noise=noise)
    return set_out(bare, stage)


def tabulate_for_tracing(material: Material, wavelength_um: float) -> HalfVectorTable:
    """The table by which Mitsuba samples a material."""
    brdf = material.brdf(wavelength_um, **directions())
    return tabulate_half_vectors(Spectrum(np.array([wavelength_um]), (brdf,)), [material.surface(wavelength_um)])


def measure_table_error(material: Material, wavelength_um: float, table: HalfVectorTable) -> float:
    """The error of `measure_interpolation_error`, of such a table."""
    mu_i, mu_o, phi = draw_directions()
    exact = material.brdf(wavelength_um, mu_i, mu_o, phi).mueller.reshape(mu_i.size, -1, 4, 4)
    seen, turned = (part.ravel() for part in np.meshgrid(mu_o, phi, indexing="ij"))
    shape = mu_i.size, seen.size
    found = table.evaluate(mu_i, np.broadcast_to(seen, shape), np.broadcast_to(turned, shape))[:, :, 0]
    scale = mu_i[:, None, None, None]
    largest = float(np.abs(exact * scale).max())
    return float(np.abs((found - exact) * scale).max()) / largest if largest else 0.0


def set_stage(materials: Sequence[Material], setting: PictureSetting, detail: int = 1) -> Stage:
    """Objects in a row on the ground, before the camera, with ``detail`` times the corners along each line. Raises
    SceneError, OSError, MissingExtraError."""
    camera = place_camera(setting.camera_elevation_deg, -setting.sun_azimuth_deg)  # the sun stands at azimuth 0
    bodies: list[Body] = []
    for material, (middle, room, side) in zip(materials, place_side_by_side(materials), strict=True):
        shape = find_shape(split_object(material.shape)[0], material.up, detail)
        sideways = APART * (middle + (0.5 * room * (-1.0 if side == "right" else 1.0) if side else 0.0)) * camera.right
        turn = material.turn_deg - setting.sun_azimuth_deg  # the same side faces the camera, wherever the sun is
        body = shape.place(turn, (float(sideways[0]), float(sideways[1])))
        bodies.append(halve(body, camera.right, side) if side else body)
    sky = make_sky("sun", [1.0], setting.sun_elevation_deg, 0.0)
    return Stage(bodies, place_lens(camera, bodies, setting.size_px), sky.beam)


def find_fine_table(material: Material, resolutions: Sequence[Resolution]) -> tuple[BrdfTable, float]:
    """The table at the first, shortest wavelength, where BRDFs vary most, fine enough; and its error."""
    wavelength = float(material.wavelengths_um[0])
    for resolution in resolutions:
        table = tabulate_material(material, wavelength, resolution)
        error = measure_interpolation_error(material, wavelength, table)
        if error <= FINE_ENOUGH:
            break
    return table, error


def tabulate_material(material: Material, wavelength_um: float, resolution: Resolution) -> BrdfTable:
    brdf = material.brdf(wavelength_um, resolution.mu, resolution.mu, resolution.phi)
    return tabulate_brdf(brdf, resolution, find_facets(brdf, material.surface(wavelength_um)))


def draw_directions() -> tuple[Array, Array, Array]:
    """Eight cosines of incidence, of exit, and azimuths [degrees], to compare BRDFs at."""
    draw = np.random.default_rng(0)
    mu_i, mu_o = draw.uniform(0.05, 1.0, (2, 8))
    return mu_i, mu_o, draw.uniform(0.0, 180.0, 8)


def measure_interpolation_error(material: Material, wavelength_um: float, table: BrdfTable) -> float:
    """The largest error of any element of the BRDF times mu_i in 512 directions off the table's grid, all cosines above
    0.05, over the largest such value; or that of the fraction mirrored as a beam, where it is larger."""
    mu_i, mu_o, phi = draw_directions()
    brdf = material.brdf(wavelength_um, mu_i, mu_o, phi)
    exact = leave_out_facets(brdf, table.facets) * mu_i[:, None, None, None, None]
    points = [part.ravel() for part in np.meshgrid(mu_i, mu_o, np.radians(phi), indexing="ij")]
    found = table.mueller(*points).reshape(exact.shape) * mu_i[:, None, None, None, None]
    largest = float(np.abs(brdf.mueller * mu_i[:, None, None, None, None]).max())
    error = float(np.abs(found - exact).max()) / largest if largest else 0.0
    if brdf.specular is None or table.specular is None:
        return error
    return max(error, float(np.abs(table.mirror(mu_i) - brdf.specular).max()))
