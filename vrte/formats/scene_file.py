"""A scene file (TOML): what light meets, and what is asked about it.

Every key is checked before anything is computed; a key that nobody knows is an error, because a mistyped one
would silently leave its default in place. Tables of one's own, coefficients and refractive indices, are
looked for beside the scene file.
"""

import math
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from vrte.basics.errors import SceneError
from vrte.formats.atomic import read_text
from vrte.formats.bases import list_base_keys, read_base
from vrte.formats.keys import Reading
from vrte.formats.layers import Kinds, prepare_layer, read_layer_tables
from vrte.formats.materials import WORDS, locate_material_errors, read_words
from vrte.formats.media import WAVE_KEYS
from vrte.formats.paints import expand_content, locate_paint_errors
from vrte.formats.particle_sources import Compute, make_particles
from vrte.formats.toml_table import LARGEST_FILE, Table, parse_toml, translate_error
from vrte.optics.particles import Particles
from vrte.request.how import AUTO, OPTIONS
from vrte.request.request import SIDES
from vrte.scene.scene import Scene

OPTION_KEYS = ("nodes", "grading", "accuracy", "truncation", "method", "illuminate", "settings", "precision")
FILE_KEYS = (*WAVE_KEYS, *OPTION_KEYS, "particles", "layer", "base", "paint", "render", "fit", "brdf", "field", *WORDS)
# keys that say the same in another way: twice the radius, and the angle from the normal in place of its cosine
ANGLES = {"mu_i": "angle_i_deg", "mu_o": "angle_o_deg", "mu0": "angle0_deg"}
ANGLE = "degrees from the normal, from 0 to below 90"


def _read_cosines(table: Table, name: str) -> list[float]:
    """The numbers at ``name``, or the cosines of those at its key for degrees."""
    key = ANGLES[name]
    if key not in table:
        return table.numbers(name)
    table.not_both(name, key)
    degrees = table.numbers(key)
    if not all(0.0 <= angle < 90.0 for angle in degrees):
        raise table.wrong(key, f"must be {ANGLE}")
    return [math.cos(math.radians(angle)) for angle in degrees]


def _read_beams(table: Table, name: str) -> list[float] | float:
    """The cosine of one beam, or a list of them."""
    key = ANGLES[name] if ANGLES[name] in table else name
    if isinstance(table.content.get(key), (list, dict)):
        return _read_cosines(table, name)
    table.number(key, "a cosine above 0, up to 1, or a list of them" if key == name else ANGLE)
    return _read_cosines(table, name)[0]


def _read_directions(table: Table, key: str) -> list[float]:
    """Signed cosines; an empty list asks for fluxes alone."""
    return [] if table.content[key] == [] else table.numbers(key)


def _read_stokes(table: Table, key: str) -> list[float]:
    """I, Q, U, V."""
    found = table.numbers(key)
    if len(found) != 4:
        raise table.wrong(key, "must be four numbers I, Q, U, V")
    return found


# what is asked for: the keys of [brdf] and [field], what reads each, and the keywords of the calls where they differ
REQUESTS: dict[str, dict[str, Callable[[Table, str], Any]]] = {
    "brdf": {"mu_i": _read_cosines, "mu_o": _read_cosines, "phi_deg": Table.numbers, "transmission": Table.flag},
    "field": {
        "mu0": _read_beams,
        "stokes": _read_stokes,
        "mu": _read_directions,
        "phi_deg": Table.numbers,
        "tau": Table.numbers,
        "side": lambda table, key: table.choice(key, SIDES),
    },
}
KEYWORDS = {"phi_deg": "phi"}
REQUEST_KEYS = {
    kind: tuple(one for key in keys for one in ((key, ANGLES[key]) if key in ANGLES else (key,)))
    for kind, keys in REQUESTS.items()
}


@dataclass(frozen=True, eq=False)
class SceneFile:
    """What a scene file holds.

    ``kind`` is "brdf" or "field"; ``request`` holds the keywords of ``vrte.brdf`` or ``vrte.radiance``, ``options``
    those of them that say how to solve, OPTION_KEYS, as far as they are given;
    ``particles`` the kinds that the layers hold, by name; ``text`` the file as it is, "" where there was none;
    ``angles`` those cosines of the request that the file gives in degrees.
    """

    scene: Scene
    kind: str
    request: dict[str, Any]
    options: dict[str, Any]
    particles: dict[str, Particles]
    text: str = ""
    angles: frozenset[str] = frozenset()

    def keywords(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        """All keywords of ``vrte.brdf`` or ``vrte.radiance`` but the scene, those ``asked`` in place of the file's.

        Settings by other names stay, but not those of another method, nor nodes where "auto" is to choose.

        >>> SceneFile(None, "brdf", {"mu_i": [0.5]}, {"nodes": 4}, {}).keywords({"nodes": 8})
        {'mu_i': [0.5], 'nodes': 8}
        """
        found = self.request | self.options | dict(asked)
        if asked.get("method") == AUTO and "nodes" not in asked:
            found.pop("nodes", None)
            found.pop("grading", None)
        if "settings" in self.options:
            of_file = {} if "method" in asked else self.options["settings"]
            found["settings"] = of_file | asked.get("settings", {})
        return found

    @contextmanager
    def located(self) -> Iterator[None]:
        """Puts the dotted key of the file in front of the library's complaints about the request.

        >>> with SceneFile(None, "brdf", {}, {}, {}).located():
        ...     raise SceneError.of("phi", "must be finite, not nan")
        Traceback (most recent call last):
        vrte.SceneError: brdf.phi_deg must be finite, not nan
        """
        said: dict[str, tuple[str, str | None]] = {name: (key, None) for key, name in KEYWORDS.items()}
        said |= {name: (ANGLES[name], "") for name in self.angles}
        try:
            yield
        except SceneError as error:
            found = translate_error(error, (self.kind,), REQUEST_KEYS[self.kind], said)
            if found is None:
                raise
            raise found from error


def read_scene(path: str | os.PathLike[str], kind: str | None = None, wavelength_um: float | None = None) -> SceneFile:
    """Reads and checks the scene file ``path`` for the command ``kind``: "brdf" or "field".

    Without ``kind`` the file must have one of the two tables; ``wavelength_um`` wins over the file's. Raises SceneError
    naming the dotted key, what was given and what is allowed, OSError where the file cannot be read.

    >>> read_scene("gold_powder.toml").kind
    'brdf'
    """
    text = read_text(path, LARGEST_FILE)
    changed = {} if wavelength_um is None else {"wavelength_um": wavelength_um}
    return replace(make_scene_file(parse_toml(text) | changed, kind, Path(path).parent), text=text)


def read_content(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The keys and tables of a file in TOML, as they are. Raises SceneError where it is none, OSError."""
    return parse_toml(read_text(path, LARGEST_FILE))


def read_listed_wavelengths(content: dict[str, Any]) -> list[float] | None:
    """``wavelength_um`` where it is a list or a range, for a spectrum; None where it is one number, or not there.

    Raises SceneError.

    >>> read_listed_wavelengths({"wavelength_um": {"start": 0.4, "stop": 0.5, "count": 2}})
    [0.4, 0.5]
    """
    if not isinstance(content.get("wavelength_um"), (list, dict)):
        return None
    return Table((), content, FILE_KEYS).numbers("wavelength_um")


def make_scene_file(
    content: dict[str, Any],
    kind: str | None = None,
    folder: Path = Path(),
    compute: Compute = make_particles,
) -> SceneFile:
    """What a scene file with this content would hold; tables of coefficients lie in ``folder``. Errors as `read_scene`.

    ``compute`` is called with the source and the keywords of each kind of particle: who reads many files can remember
    its answers, and who only checks one can do without them (`check_particles`).

    >>> layer = {"phase": "rayleigh", "albedo": 1.0, "thickness": 0.5}
    >>> make_scene_file({"layer": [layer], "brdf": {"mu_i": 0.5, "mu_o": 1.0}}).scene.thickness
    0.5
    """
    file = Table((), expand_content(content, folder), FILE_KEYS)
    for key in WORDS:
        read_words(file, key)
    kind = _choose_kind(file, kind)
    request = {name: file.table(name, keys) for name, keys in REQUEST_KEYS.items() if name in file}[kind]
    asked = {
        KEYWORDS.get(key, key): read(request, key)
        for key, read in REQUESTS[kind].items()
        if key in request or key in ANGLES  # these must be there, in one of two ways
    }
    options = {name: _read_option(file, name) for name in OPTION_KEYS if name in file}
    reading = Reading(file, folder)
    with locate_paint_errors(content), locate_material_errors(content):
        kinds = Kinds(compute, reading)
        layers = read_layer_tables(file)
        base = read_base(file.table("base", list_base_keys()), reading) if "base" in file else None
        makers = [prepare_layer(layer, kinds, reading) for layer in layers]  # all are checked before one is made
        pile: list[Any] = [made() for made in makers]
    scene = Scene(pile, base)
    angles = frozenset(name for name, key in ANGLES.items() if key in request)
    return SceneFile(scene, kind, asked, options, kinds.computed, angles=angles)


def _choose_kind(file: Table, kind: str | None) -> str:
    """The command whose table is there."""
    there = [name for name in REQUESTS if name in file]
    if kind is not None and kind not in there:
        other = f" (there is [{there[0]}], for `vrte {there[0]}`)" if there else ""
        raise SceneError(f"{kind} is missing: the file needs a table [{kind}]{other}", kind)
    if kind is None and len(there) != 1:
        raise SceneError(f"exactly one of the tables [brdf] and [field] is needed, not {len(there)}")
    return kind or there[0]


def _read_option(file: Table, name: str) -> Any:
    """How to solve, checked as the calls check it."""
    known, value = OPTIONS[name], file.content[name]
    if known.choices:
        return file.choice(name, known.choices)
    if type(value) is known.of or (known.of is float and type(value) is int):
        with suppress(SceneError):
            return known.check(name, value)
    raise file.wrong(name, f"must be {known.allowed}")
