"""A scene file (TOML): what light meets, and what is asked about it.

Every key is checked before anything is computed; a key that nobody knows is an error, because a mistyped one
would silently leave its default in place. Tables of one's own, coefficients and refractive indices, are
looked for beside the scene file.
"""

import math
import os
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from vrte.basics.arrays import in_one_line
from vrte.basics.errors import Place, SceneError
from vrte.formats.coefficient_table import read_coefficients
from vrte.formats.index_table import read_index
from vrte.formats.text_file import read_text
from vrte.formats.toml_table import Table, is_number, located, nearest, shortened, shown, shown_key
from vrte.optics.phase_matrix import (
    MOST_TERMS,
    PhaseMatrix,
    henyey_greenstein,
    henyey_greenstein_terms,
    isotropic,
    rayleigh,
)
from vrte.optics.refractive_index import Material, wavelength_range
from vrte.optics.size_distribution import Gamma, Lognormal
from vrte.optics.spheres import Particles, mixture, spheres
from vrte.optics.truncation import CHOICES
from vrte.request.request import AUTO, COARSEST, FINEST, METHOD_NAMES, MOST_NODES
from vrte.scene.boundary import Lambertian
from vrte.scene.illumination import SIDES
from vrte.scene.layer import Layer
from vrte.scene.scene import MOST_LAYERS, Scene

Read = TypeVar("Read")
LARGEST_FILE = 10_000_000  # bytes
# a key of so many parts is no key of a scene, and takes the parser a time that grows with the square of their number
LONG_KEY = re.compile(r"(?<![^\s,=\[{])(?:[^\s.,=\[{]+[ \t]*\.[ \t]*){32}")
KINDS = ("brdf", "field")
TABLE = ".csv"  # the suffix of tables of one's own
NAMED = {"truncation": CHOICES, "method": METHOD_NAMES, "illuminate": SIDES}
WAVE_KEYS = ("wavelength_um", "host_index")  # of the light, for all particles
OPTION_KEYS = ("nodes", "accuracy", *NAMED, "settings")
FILE_KEYS = (*WAVE_KEYS, *OPTION_KEYS, "particles", "layer", "base", "render", *KINDS)
PARTICLE_KEYS = ("index", "radius_um", "diameter_um", "size")
FILLINGS = ("particles", "volume_fractions", "phase")  # what a layer holds, in one of these ways
LAYER_KEYS = (*FILLINGS, "tolerance", "albedo", "thickness", "thickness_um", "volume_fraction")
THICKNESS_KEYS = ("thickness", "thickness_um", "volume_fraction")
BASE_KEYS = ("kind", "albedo")
REQUEST_KEYS = {
    "brdf": ("mu_i", "angle_i_deg", "mu_o", "angle_o_deg", "phi_deg", "transmission"),
    "field": ("mu0", "angle0_deg", "stokes", "mu", "phi_deg", "tau"),
}
SIZES: dict[str, tuple[Callable[..., Lognormal | Gamma], tuple[str, ...]]] = {
    "lognormal": (Lognormal, ("median_um", "sigma")),
    "gamma": (Gamma, ("r_eff_um", "v_eff")),
}
# keys that say the same in another way: twice the radius, and the angle from the normal in place of its cosine
DIAMETERS = {"radius_um": "diameter_um", "median_um": "median_diameter_um", "r_eff_um": "d_eff_um"}
ANGLES = {"mu_i": "angle_i_deg", "mu_o": "angle_o_deg", "mu0": "angle0_deg"}
NAMED_PHASES: dict[str, Callable[[], PhaseMatrix]] = {"isotropic": isotropic, "rayleigh": rayleigh}
PHASE_KEYS = ("henyey_greenstein", "rayleigh", "terms")
PHASES = (
    '"isotropic", "rayleigh", { henyey_greenstein = g }, { rayleigh = depolarization } '
    "or the path of a .csv with the columns l, a1, a2, a3, a4, b1, b2"
)
INDEX = (
    'the name of a material, a path in the database such as "main/Au/Johnson", the path of a .csv with the columns '
    "wavelength_um (or wavelength_nm), n, k, or [n, k]"
)
BEAMS = "a cosine above 0, up to 1, or a list of them"
SHARE = "a number fraction >= 0"
PART = 'from 0 to below 1, or per cent in quotes, "5 %"'
ALBEDO = 'a number between 0 and 1, or per cent in quotes, "30 %"'
ANGLE = "degrees from the normal, from 0 to below 90"
ONE_WAVELENGTH = "the wavelength in micrometres; a list is for spectra: `vrte brdf`, `vrte view`, `vrte.spectrum`"


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
        try:
            yield
        except SceneError as error:
            name, message = str(error.place[0]) if error.place else "", str(error)
            key = ANGLES[name] if name in self.angles else "phi_deg" if name == "phi" else name
            if key not in REQUEST_KEYS[self.kind]:
                raise
            if name in self.angles:
                message = f"{self.kind}.{key}: {message}"
            elif message.startswith(name):  # it may be that of one scene of several
                message = f"{self.kind}.{key}{message[len(name) :]}"
            raise SceneError(message, self.kind, key) from error


def read_scene(path: str | os.PathLike[str], kind: str | None = None, wavelength_um: float | None = None) -> SceneFile:
    """Reads and checks the scene file ``path`` for the command ``kind``: "brdf" or "field".

    Without ``kind`` the file must have one of the two tables; ``wavelength_um`` wins over the file's. Raises SceneError
    naming the dotted key, what was given and what is allowed, OSError where the file cannot be read.

    >>> read_scene("gold_powder.toml").kind
    'brdf'
    """
    text = read_text(path, LARGEST_FILE)
    changed = {} if wavelength_um is None else {"wavelength_um": wavelength_um}
    return replace(scene_of(toml_content(text) | changed, kind, Path(path).parent), text=text)


def read_content(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The keys and tables of a file in TOML, as they are. Raises SceneError where it is none, OSError."""
    return toml_content(read_text(path, LARGEST_FILE))


def listed_wavelengths(content: dict[str, Any]) -> list[float] | None:
    """``wavelength_um`` where it is a list or a range, for a spectrum; None where it is one number, or not there.

    Raises SceneError.

    >>> listed_wavelengths({"wavelength_um": {"start": 0.4, "stop": 0.5, "count": 2}})
    [0.4, 0.5]
    """
    if not isinstance(content.get("wavelength_um"), (list, dict)):
        return None
    return Table((), content, FILE_KEYS).numbers("wavelength_um")


def scene_of(
    content: dict[str, Any],
    kind: str | None = None,
    folder: Path = Path(),
    spheres_of: Callable[..., Particles] = spheres,
) -> SceneFile:
    """What a scene file with this content would hold; tables of coefficients lie in ``folder``. Errors as `read_scene`.

    ``spheres_of`` is called like `vrte.spheres` for each kind of particle: who reads many files can remember its
    answers, and who only checks one can do without them (`check_spheres`).

    >>> layer = {"phase": "rayleigh", "albedo": 1.0, "thickness": 0.5}
    >>> scene_of({"layer": [layer], "brdf": {"mu_i": 0.5, "mu_o": 1.0}}).scene.thickness
    0.5
    """
    file = Table((), content, FILE_KEYS)
    kind = _kind(file, kind)
    request = _request(file, kind)
    options = _options(file)
    particles = _Particles(file, _particle_tables(file), spheres_of, folder)
    angles = frozenset(name for name, key in ANGLES.items() if key in content[kind])
    return SceneFile(_scene(file, particles, folder), kind, request, options, particles.computed, angles=angles)


def tables_named(content: Mapping[str, Any]) -> dict[Place, str]:
    """The tables of one's own (.csv) that a scene file names, by the place that does, whatever else is in it.

    >>> layers = [{"phase": "fog.csv"}, {"phase": "rayleigh"}]
    >>> tables_named({"particles": {"clay": {"index": "clay.csv"}}, "layer": layers})
    {('layer', 0, 'phase'): 'fog.csv', ('particles', 'clay', 'index'): 'clay.csv'}
    """
    layers, kinds = content.get("layer"), content.get("particles")
    named: list[tuple[Place, Any]] = [
        *((("layer", place, "phase"), layer) for place, layer in enumerate(layers if isinstance(layers, list) else [])),
        *((("particles", name, "index"), kind) for name, kind in (kinds.items() if isinstance(kinds, dict) else ())),
    ]
    found = {place: table.get(place[-1]) for place, table in named if isinstance(table, dict)}
    return {place: name for place, name in found.items() if isinstance(name, str) and name.endswith(TABLE)}


def wavelengths_known(content: Mapping[str, Any], folder: Path = Path()) -> tuple[float, float, str]:
    """The wavelengths [um] from and to which the indices of all particles of a scene file are known, and the last
    substance that ends them; (0, inf, "") where none does. Indices that are wrong count as known. Raises OSError."""
    found = (0.0, math.inf, "")
    kinds = content.get("particles")
    for kind in kinds.values() if isinstance(kinds, dict) else ():
        index = kind.get("index") if isinstance(kind, dict) else None
        if isinstance(index, str):
            with suppress(SceneError):
                low, high = wavelength_range(read_index(folder / index) if index.endswith(TABLE) else index)
                if low > found[0] or high < found[1]:
                    found = max(low, found[0]), min(high, found[1]), index
    return found


def toml_content(text: str) -> dict[str, Any]:
    """TOML, parsed; what would keep the parser busy for minutes is refused first. Raises SceneError."""
    long_key = LONG_KEY.search(text)
    if long_key:
        raise SceneError(f"not a scene: a key of more than 30 parts, {shown(long_key[0])}")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"not valid TOML: {in_one_line(str(error), 200)}") from error
    except ValueError as error:
        raise SceneError("not valid TOML: a whole number of more than 4000 digits") from error
    except RecursionError as error:
        raise SceneError("not a scene: tables or lists nested too deeply") from error


def _kind(file: Table, kind: str | None) -> str:
    """The command whose table is there."""
    there = [name for name in KINDS if name in file]
    if kind is not None:
        if kind not in there:
            other = f" (there is [{there[0]}], for `vrte {there[0]}`)" if there else ""
            raise SceneError(f"{kind} is missing: the file needs a table [{kind}]{other}", kind)
        return kind
    if len(there) != 1:
        raise SceneError(f"exactly one of the tables [brdf] and [field] is needed, not {len(there)}")
    return there[0]


def _request(file: Table, kind: str) -> dict[str, Any]:
    tables = {name: file.table(name, REQUEST_KEYS[name]) for name in KINDS if name in file}
    table = tables[kind]
    return _brdf_request(table) if kind == "brdf" else _field_request(table)


def _options(file: Table) -> dict[str, Any]:
    """How to solve, as far as the file says so."""
    options: dict[str, Any] = {}
    if "nodes" in file:
        options["nodes"] = file.whole("nodes", 1, MOST_NODES)
    if "accuracy" in file:
        allowed = f"a number between {FINEST:g} and {COARSEST:g}"
        options["accuracy"] = file.number("accuracy", allowed)
        if not FINEST <= options["accuracy"] <= COARSEST:
            raise file.wrong("accuracy", f"must be {allowed}")
    options |= {name: file.choice(name, choices) for name, choices in NAMED.items() if name in file}
    if "settings" in file:
        if not isinstance(file.content["settings"], dict):
            raise file.wrong("settings", "must be a table of the method's settings by name")
        options["settings"] = dict(file.content["settings"])
    return options


def _brdf_request(table: Table) -> dict[str, Any]:
    request: dict[str, Any] = {name: _cosines(table, name) for name in ("mu_i", "mu_o")}
    if "phi_deg" in table:
        request["phi"] = table.numbers("phi_deg")
    if "transmission" in table:
        request["transmission"] = table.flag("transmission")
    return request


def _field_request(table: Table) -> dict[str, Any]:
    key = ANGLES["mu0"] if ANGLES["mu0"] in table else "mu0"
    several = isinstance(table.content.get(key), (list, dict))
    if not several:
        table.number(key, BEAMS if key == "mu0" else ANGLE)
    beams = _cosines(table, "mu0")
    request: dict[str, Any] = {"mu0": beams if several else beams[0]}
    for key, keyword in (("mu", "mu"), ("phi_deg", "phi"), ("tau", "tau")):
        if key in table:
            none = key == "mu" and table.content[key] == []  # fluxes alone
            request[keyword] = [] if none else table.numbers(key)
    if "stokes" in table:
        request["stokes"] = table.numbers("stokes")
        if len(request["stokes"]) != 4:
            raise table.wrong("stokes", "must be four numbers I, Q, U, V")
    return request


def _cosines(table: Table, name: str) -> list[float]:
    """The numbers at ``name``, or the cosines of those at its key for degrees."""
    key = ANGLES[name]
    if key not in table:
        return table.numbers(name)
    if name in table:
        raise table.unfit(f"exactly one of {name} and {key} is needed")
    degrees = table.numbers(key)
    if not all(0.0 <= angle < 90.0 for angle in degrees):
        raise table.wrong(key, f"must be {ANGLE}")
    return [math.cos(math.radians(angle)) for angle in degrees]


def _scene(file: Table, particles: "_Particles", folder: Path) -> Scene:
    layers = _layer_tables(file)
    base = _base(file)
    for layer in layers:
        _check_layer(layer, particles.kinds)
    return Scene([_layer(layer, particles, folder) for layer in layers], base)


def _layer_tables(file: Table) -> list[Table]:
    layers = file.required("layer", "at least one table [[layer]], top first")
    if not isinstance(layers, list) or not layers or not all(isinstance(layer, dict) for layer in layers):
        raise file.wrong("layer", "must be tables headed [[layer]], top first")
    if len(layers) > MOST_LAYERS:
        raise SceneError(f"layer: there must be at most {MOST_LAYERS} of them, not {len(layers)}", "layer")
    return [Table(("layer", place), layer, LAYER_KEYS) for place, layer in enumerate(layers)]


def _particle_tables(file: Table) -> dict[str, Table]:
    """The tables [particles.NAME], checked without computing anything."""
    content = file.content.get("particles", {})
    if not isinstance(content, dict) or not all(isinstance(kind, dict) for kind in content.values()):
        raise file.wrong("particles", "must be tables headed [particles.NAME]")
    tables = {name: Table(("particles", name), kind, PARTICLE_KEYS) for name, kind in content.items()}
    for table in tables.values():
        table.required("index", INDEX)
        if sum(key in table for key in PARTICLE_KEYS[1:]) != 1:
            raise table.unfit("exactly one of radius_um, diameter_um and size is needed")
        _index(table), _size(table)  # checked also where no layer asks for them
    return tables


def _check_layer(layer: Table, kinds: dict[str, Table]) -> None:
    """Whether the keys of a layer go together."""
    if sum(key in layer for key in FILLINGS) != 1:
        raise layer.unfit(f"exactly one of {', '.join(FILLINGS)} is needed")
    if "tolerance" in layer and not str(layer.content.get("phase")).endswith(TABLE):
        raise layer.wrong("tolerance", "goes with a phase from a .csv only: how far below zero it may be")
    if "phase" in layer:
        layer.share("albedo", ALBEDO)
        for key in THICKNESS_KEYS[1:]:
            if key in layer:
                raise layer.wrong(key, "needs particles; with phase, give the optical thickness")
        layer.number("thickness", "an optical thickness >= 0 (inf is allowed)")
        return
    if "albedo" in layer:
        raise layer.wrong("albedo", "goes with phase only; particles bring their own")
    _fractions(layer, kinds)
    _check_thickness(layer)


def _check_thickness(layer: Table) -> None:
    optical, geometrical, by_volume = "thickness" in layer, "thickness_um" in layer, "volume_fractions" in layer
    if by_volume and "volume_fraction" in layer:
        raise layer.wrong("volume_fraction", "is the sum of volume_fractions; leave it out")
    if optical == geometrical or ("volume_fraction" in layer) != (geometrical and not by_volume):
        alone = "" if by_volume else " with volume_fraction"
        raise layer.unfit(f"either thickness (optical) or thickness_um{alone} is needed")
    for key in THICKNESS_KEYS[:2]:
        if key in layer:
            layer.number(key, "a number >= 0")
    if "volume_fraction" in layer:
        layer.share("volume_fraction", PART)


def _fractions(layer: Table, kinds: dict[str, Table]) -> list[tuple[str, float]]:
    """The kinds of particles in a layer, with their fractions: of the number, or of the layer's volume."""
    key, allowed = ("volume_fractions", PART) if "volume_fractions" in layer else ("particles", SHARE)
    value = layer.content[key]
    if isinstance(value, str) and key == "particles":
        _known(layer, key, value, kinds)
        return [(value, 1.0)]
    if not isinstance(value, dict) or not value:
        word = "a name, or a table { name = number fraction" if key == "particles" else "a table { name = fraction"
        raise layer.wrong(key, f"must be {word}, ... }}")
    for name in value:
        _known(layer, key, name, kinds)
    fractions = layer.table(key, tuple(kinds))
    shares = [(name, fractions.share(name, allowed)) for name in value]
    for name, share in shares:
        if not 0.0 <= share < (1.0 if key == "volume_fractions" else math.inf):
            raise fractions.wrong(name, f"must be {allowed}")
    if not any(share for _, share in shares):
        word = "number fraction" if key == "particles" else "fraction"
        raise layer.wrong(key, f"at least one {word} must be above 0")
    if key == "volume_fractions" and math.fsum(share for _, share in shares) >= 1.0:
        raise layer.wrong(key, "their sum must be below 1, the whole layer")
    return shares


def _known(layer: Table, key: str, name: str, kinds: dict[str, Table]) -> None:
    if name not in kinds:
        defined = shortened(", ".join(map(shown_key, kinds)) or "none", 200)
        hint = nearest(name, kinds) or "."
        raise layer.wrong(key, f"no table [particles.{shown_key(name)}]{hint} Defined: {defined}")


class _Particles:
    """The particles of a file, each kind computed once, when a layer first asks for it."""

    def __init__(
        self, file: Table, kinds: dict[str, Table], spheres_of: Callable[..., Particles], folder: Path
    ) -> None:
        self.file, self.kinds, self.spheres_of, self.folder = file, kinds, spheres_of, folder
        self.computed: dict[str, Particles] = {}

    def __call__(self, layer: Table) -> Particles:
        fractions = _fractions(layer, self.kinds)
        if len(fractions) == 1:
            return self.kind(fractions[0][0])
        parts = [(self.kind(name), fraction) for name, fraction in fractions]
        if "volume_fractions" in layer:  # how many of them make such a part of the volume
            parts = [(kind, fraction / kind.volume_um3) for kind, fraction in parts]
        with located(layer.place, LAYER_KEYS):
            return mixture(parts)

    def kind(self, name: str) -> Particles:
        if name not in self.computed:
            self.computed[name] = self._compute(self.kinds[name])
        return self.computed[name]

    def _compute(self, table: Table) -> Particles:
        wavelength = self.file.number("wavelength_um", ONE_WAVELENGTH)
        host = self.file.number("host_index") if "host_index" in self.file else 1.0
        index, size = _material(table, self.folder), _size(table)
        with located(table.place, PARTICLE_KEYS, WAVE_KEYS), _told_in_diameters(table):
            return self.spheres_of(index, wavelength_um=wavelength, host_index=host, **size)


def _index(table: Table) -> str | tuple[float, float]:
    value = table.content["index"]
    if isinstance(value, str):
        return value
    parts = value if isinstance(value, list) else [value, 0.0]
    if len(parts) != 2 or not all(is_number(part) for part in parts):
        raise table.wrong("index", f"must be {INDEX}")
    return float(parts[0]), float(parts[1])


def _material(table: Table, folder: Path) -> Material:
    """The index, or the table that it names."""
    index = _index(table)
    if not (isinstance(index, str) and index.endswith(TABLE)):
        return index
    return _read_beside(table, "index", read_index, folder)


def _read_beside(table: Table, key: str, read: Callable[[Path], Read], folder: Path) -> Read:
    """What is in the file that a key names, beside the scene file."""
    try:
        return read(folder / table.content[key])
    except SceneError as error:
        raise table.wrong(key, str(error)) from error
    except OSError as error:
        raise table.wrong(key, f"the file cannot be read: {error.strerror}") from error


def _size(table: Table) -> dict[str, Any]:
    """The keyword of ``spheres`` that says how large the particles are."""
    for key, factor in (("radius_um", 1.0), ("diameter_um", 0.5)):
        if key in table:
            return {"radius_um": factor * table.number(key, f"a {key.removesuffix('_um')} in micrometres > 0")}
    size = table.table("size", tuple(SIZES))
    if len(size.content) != 1:
        raise table.wrong("size", f"must be exactly one of {', '.join(SIZES)}")
    (name,) = size.content
    distribution, keys = SIZES[name]
    numbers = size.table(name, (*keys, DIAMETERS[keys[0]]))
    if keys[0] in numbers and DIAMETERS[keys[0]] in numbers:
        raise numbers.unfit(f"exactly one of {keys[0]} and {DIAMETERS[keys[0]]} is needed")
    values = {
        key: 0.5 * numbers.number(twice) if (twice := DIAMETERS.get(key, "")) in numbers else numbers.number(key)
        for key in keys
    }
    with located(numbers.place, numbers.allowed), _told_in_diameters(numbers):
        return {"size": distribution(**values)}


@contextmanager
def _told_in_diameters(table: Table) -> Iterator[None]:
    """Puts the key of a diameter that the file gives in front of a complaint about its half."""
    try:
        yield
    except SceneError as error:
        key = DIAMETERS.get(str(error.place[0]), "") if error.place else ""
        if key not in table:
            raise
        message = str(error).removeprefix("lognormal: ").removeprefix("gamma: ")
        raise SceneError(f"{key}: half of it, {message}", key) from error


def _layer(layer: Table, particles: _Particles, folder: Path) -> Layer:
    if "phase" not in layer:
        inside = particles(layer)
        lengths = {key: layer.share(key, PART) for key in THICKNESS_KEYS if key in layer}
        if "volume_fractions" in layer and "thickness_um" in layer:
            lengths["volume_fraction"] = math.fsum(share for _, share in _fractions(layer, particles.kinds))
        with located(layer.place, LAYER_KEYS):
            return Layer.of(inside, **lengths)
    matrix, albedo, thickness = _phase(layer, folder), layer.share("albedo", ALBEDO), layer.number("thickness")
    with located(layer.place, LAYER_KEYS):
        return Layer(matrix, albedo, thickness)


def _phase(layer: Table, folder: Path) -> PhaseMatrix:
    value = layer.content["phase"]
    if isinstance(value, dict):
        return _parametric_phase(layer)
    if not isinstance(value, str):
        raise layer.wrong("phase", f"must be {PHASES}")
    if value in NAMED_PHASES:
        return NAMED_PHASES[value]()
    if not value.endswith(TABLE):
        raise layer.wrong("phase", f"must be {PHASES}{nearest(value, NAMED_PHASES)}")
    tolerance = layer.number("tolerance") if "tolerance" in layer else 0.0
    return _read_beside(layer, "phase", partial(read_coefficients, tolerance=tolerance), folder)


def _parametric_phase(layer: Table) -> PhaseMatrix:
    table = layer.table("phase", PHASE_KEYS)
    names = [name for name in PHASE_KEYS[:2] if name in table]
    if len(names) != 1 or ("terms" in table and "rayleigh" in table):
        raise layer.wrong("phase", f"must be {PHASES}")
    value = table.number(names[0])
    terms = table.whole("terms", 1, MOST_TERMS) if "terms" in table else henyey_greenstein_terms(value)
    if abs(value) < 1.0 and terms > MOST_TERMS:
        raise table.wrong(names[0], f"it takes {terms} terms, and at most {MOST_TERMS} are allowed")
    with located((*table.place, names[0])):
        return rayleigh(value) if "rayleigh" in table else henyey_greenstein(value, terms)


def _base(file: Table) -> Lambertian | None:
    if "base" not in file:
        return None
    base = file.table("base", BASE_KEYS)
    if base.choice("kind", ("black", "lambertian")) == "black":
        if "albedo" in base:
            raise base.wrong("albedo", 'goes with kind = "lambertian" only')
        return None
    albedo = base.share("albedo", ALBEDO)
    with located(base.place, BASE_KEYS):
        return Lambertian(albedo)
