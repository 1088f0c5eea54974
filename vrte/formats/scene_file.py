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
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

from vrte.basics.arrays import put_in_one_line
from vrte.basics.errors import Place, SceneError
from vrte.formats.coefficient_table import read_coefficients
from vrte.formats.index_table import read_index
from vrte.formats.media import (
    TABLE,
    WAVE_KEYS,
    check_material,
    find_clear_index,
    find_index,
    list_materials,
    read_beside,
)
from vrte.formats.particle_sources import check_source
from vrte.formats.text_file import read_text
from vrte.formats.toml_table import (
    Table,
    locate_errors,
    shorten_text,
    show_key,
    show_toml,
    suggest_nearest,
    translate_error,
)
from vrte.optics.particles import Particles, mixture
from vrte.optics.phase_matrix import (
    MOST_TERMS,
    PhaseMatrix,
    count_henyey_greenstein_terms,
    henyey_greenstein,
    isotropic,
    rayleigh,
)
from vrte.optics.refractive_index import find_wavelength_range
from vrte.optics.spheres import spheres
from vrte.request.how import AUTO, OPTIONS
from vrte.request.request import SIDES
from vrte.scene.boundary import Boundary, Lambertian
from vrte.scene.facets import Facets
from vrte.scene.interface import DISTRIBUTIONS, ROUGHNESS_ALLOWED, Interface
from vrte.scene.layer import Layer
from vrte.scene.mirror import Mirror
from vrte.scene.scene import MOST_LAYERS, Scene

LARGEST_FILE = 10_000_000  # bytes
# a key of so many parts is no key of a scene, and takes the parser a time that grows with the square of their number
LONG_KEY = re.compile(r"(?<![^\s,=\[{])(?:[^\s.,=\[{]+[ \t]*\.[ \t]*){32}")
OPTION_KEYS = ("nodes", "accuracy", "truncation", "method", "illuminate", "settings")
FILE_KEYS = (*WAVE_KEYS, *OPTION_KEYS, "particles", "layer", "base", "render", "brdf", "field")
FILLINGS = ("particles", "volume_fractions", "phase")  # what a layer holds, in one of these ways
THICKNESS_KEYS = ("thickness", "thickness_um", "volume_fraction")
LAYER_KEYS = (*FILLINGS, "tolerance", "albedo", *THICKNESS_KEYS, "interface")
FACET_KEYS = tuple(field.name for field in fields(Interface) if not field.name.startswith("index_"))
INTERFACE_KEYS = ("above", "below", *FACET_KEYS)
BASES: dict[str, tuple[str, ...]] = {  # keys of each kind
    "black": (),
    "lambertian": ("albedo",),
    "mirror": ("index",),
    "facets": ("index", *FACET_KEYS),
}
BASE_KEYS = ("kind", *dict.fromkeys(key for keys in BASES.values() for key in keys))
# keys that say the same in another way: twice the radius, and the angle from the normal in place of its cosine
ANGLES = {"mu_i": "angle_i_deg", "mu_o": "angle_o_deg", "mu0": "angle0_deg"}
NAMED_PHASES: dict[str, Callable[[], PhaseMatrix]] = {"isotropic": isotropic, "rayleigh": rayleigh}
PHASE_KEYS = ("henyey_greenstein", "rayleigh", "terms")
PHASES = (
    '"isotropic", "rayleigh", { henyey_greenstein = g }, { rayleigh = depolarization } '
    "or the path of a .csv with the columns l, a1, a2, a3, a4, b1, b2"
)
SHARE = "a number fraction >= 0"
PART = 'from 0 to below 1, or per cent in quotes, "5 %"'
ALBEDO = 'a number between 0 and 1, or per cent in quotes, "30 %"'
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
    spheres_of: Callable[..., Particles] = spheres,
) -> SceneFile:
    """What a scene file with this content would hold; tables of coefficients lie in ``folder``. Errors as `read_scene`.

    ``spheres_of`` is called like `vrte.spheres` for each kind of particle: who reads many files can remember its
    answers, and who only checks one can do without them (`check_spheres`).

    >>> layer = {"phase": "rayleigh", "albedo": 1.0, "thickness": 0.5}
    >>> make_scene_file({"layer": [layer], "brdf": {"mu_i": 0.5, "mu_o": 1.0}}).scene.thickness
    0.5
    """
    file = Table((), content, FILE_KEYS)
    kind = _choose_kind(file, kind)
    request = {name: file.table(name, keys) for name, keys in REQUEST_KEYS.items() if name in file}[kind]
    asked = {
        KEYWORDS.get(key, key): read(request, key)
        for key, read in REQUESTS[kind].items()
        if key in request or key in ANGLES  # these must be there, in one of two ways
    }
    options = {name: _read_option(file, name) for name in OPTION_KEYS if name in file}
    particles = _Particles(file, spheres_of, folder)
    layers, base = _read_layer_tables(file), _read_base(file, folder)
    makers = [_prepare_layer(layer, particles, file, folder) for layer in layers]  # all are checked before one is made
    pile: list[Any] = [made() for made in makers]
    scene = Scene(pile, base)
    angles = frozenset(name for name, key in ANGLES.items() if key in request)
    return SceneFile(scene, kind, asked, options, particles.computed, angles=angles)


def find_named_tables(content: Mapping[str, Any]) -> dict[Place, str]:
    """The tables of one's own (.csv) that a scene file names, by the place that does, whatever else is in it.

    >>> layers = [{"phase": "fog.csv"}, {"phase": "rayleigh"}]
    >>> find_named_tables({"particles": {"clay": {"index": "clay.csv"}}, "layer": layers})
    {('layer', 0, 'phase'): 'fog.csv', ('particles', 'clay', 'index'): 'clay.csv'}
    """
    layers = content.get("layer")
    phases: dict[Place, Any] = {
        ("layer", place, "phase"): layer.get("phase")
        for place, layer in enumerate(layers if isinstance(layers, list) else [])
        if isinstance(layer, dict)
    }
    named = phases | dict(list_materials(content))
    return {place: name for place, name in named.items() if isinstance(name, str) and name.endswith(TABLE)}


def find_known_wavelengths(content: Mapping[str, Any], folder: Path = Path()) -> tuple[float, float, str]:
    """The wavelengths [um] from and to which all indices of a scene file are known, and the last substance that ends
    them; (0, inf, "") where none does. Indices that are wrong count as known. Raises OSError."""
    found = (0.0, math.inf, "")
    for _, index in list_materials(content):
        with suppress(SceneError):
            low, high = find_wavelength_range(read_index(folder / index) if index.endswith(TABLE) else index)
            if low > found[0] or high < found[1]:
                found = max(low, found[0]), min(high, found[1]), index
    return found


def parse_toml(text: str) -> dict[str, Any]:
    """TOML, parsed; what would keep the parser busy for minutes is refused first. Raises SceneError."""
    long_key = LONG_KEY.search(text)
    if long_key:
        raise SceneError(f"not a scene: a key of more than 30 parts, {show_toml(long_key[0])}")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"not valid TOML: {put_in_one_line(str(error), 200)}") from error
    except ValueError as error:
        raise SceneError("not valid TOML: a whole number of more than 4000 digits") from error
    except RecursionError as error:
        raise SceneError("not a scene: tables or lists nested too deeply") from error


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


def _read_layer_tables(file: Table) -> list[Table]:
    layers = file.required("layer", "at least one table [[layer]], top first")
    if not isinstance(layers, list) or not layers or not all(isinstance(layer, dict) for layer in layers):
        raise file.wrong("layer", "must be tables headed [[layer]], top first")
    if len(layers) > MOST_LAYERS:
        raise SceneError(f"layer: there must be at most {MOST_LAYERS} of them, not {len(layers)}", "layer")
    return [Table(("layer", place), layer, LAYER_KEYS) for place, layer in enumerate(layers)]


def _prepare_layer(layer: Table, particles: "_Particles", file: Table, folder: Path) -> Callable[[], Layer | Interface]:
    """What makes a layer or an interface, all its keys checked, nothing computed."""
    if "interface" in layer:
        return _prepare_interface(layer, file, folder)
    layer.exactly_one(*FILLINGS)
    if "tolerance" in layer and not str(layer.content.get("phase")).endswith(TABLE):
        raise layer.wrong("tolerance", "goes with a phase from a .csv only: how far below zero it may be")
    if "phase" in layer:
        albedo = layer.share("albedo", ALBEDO)
        for key in THICKNESS_KEYS[1:]:
            if key in layer:
                raise layer.wrong(key, "needs particles; with phase, give the optical thickness")
        thickness = layer.number("thickness", "an optical thickness >= 0 (inf is allowed)")

        def of_phase() -> Layer:
            matrix = _read_phase(layer, folder)
            with locate_errors(layer.place, LAYER_KEYS):
                return Layer(matrix, albedo, thickness)

        return of_phase
    if "albedo" in layer:
        raise layer.wrong("albedo", "goes with phase only; particles bring their own")
    key = "volume_fractions" if "volume_fractions" in layer else "particles"
    shares, lengths = _read_fractions(layer, key, particles.makers), _read_lengths(layer)
    if key == "volume_fractions" and "thickness_um" in layer:
        lengths["volume_fraction"] = math.fsum(shares.values())

    def of_particles() -> Layer:
        parts = [(particles.kind(name), share) for name, share in shares.items()]
        if key == "volume_fractions":  # how many of them make such a part of the volume
            parts = [(kind, share / kind.volume_um3) for kind, share in parts]
        with locate_errors(layer.place, LAYER_KEYS):
            return Layer.of(mixture(parts) if len(parts) > 1 else parts[0][0], **lengths)

    return of_particles


def _prepare_interface(layer: Table, file: Table, folder: Path) -> Callable[[], Interface]:
    """What makes an interface, which stands alone in its table."""
    for key in layer.content:
        if key != "interface":
            raise layer.wrong(key, "an interface has a [[layer]] of its own; what scatters stands in the next")
    table = layer.table("interface", INTERFACE_KEYS)
    for key in INTERFACE_KEYS[:2]:
        check_material(table, key)
    facets = _read_facets(table)

    def made() -> Interface:
        above, below = (find_clear_index(file, table, key, folder) for key in INTERFACE_KEYS[:2])
        said: dict[str, tuple[str, str | None]] = {f"index_{key}": (key, None) for key in INTERFACE_KEYS[:2]}
        with locate_errors(table.place, INTERFACE_KEYS, said=said):
            return Interface(above, below, **facets)

    return made


def _read_facets(table: Table) -> dict[str, Any]:
    """How rough a surface is, as far as it is said."""
    readers: dict[str, Callable[[str], Any]] = {
        "roughness": lambda key: table.number(key, ROUGHNESS_ALLOWED),
        "distribution": lambda key: table.choice(key, DISTRIBUTIONS),
    }
    return {key: readers.get(key, table.flag)(key) for key in FACET_KEYS if key in table}


def _read_lengths(layer: Table) -> dict[str, Any]:
    """How thick a layer of particles is, and how densely they lie."""
    optical, geometrical, by_volume = "thickness" in layer, "thickness_um" in layer, "volume_fractions" in layer
    if by_volume and "volume_fraction" in layer:
        raise layer.wrong("volume_fraction", "is the sum of volume_fractions; leave it out")
    if optical == geometrical or ("volume_fraction" in layer) != (geometrical and not by_volume):
        alone = "" if by_volume else " with volume_fraction"
        raise layer.unfit(f"either thickness (optical) or thickness_um{alone} is needed")
    found: dict[str, Any] = {key: layer.number(key, "a number >= 0") for key in THICKNESS_KEYS[:2] if key in layer}
    return found | {key: layer.share(key, PART) for key in THICKNESS_KEYS[2:] if key in layer}


def _read_fractions(layer: Table, key: str, kinds: Mapping[str, Any]) -> dict[str, float]:
    """The kinds of particles in a layer, with their fractions: of the number, or of the layer's volume."""
    by_volume = key == "volume_fractions"
    allowed, word = (PART, "fraction") if by_volume else (SHARE, "number fraction")
    value = layer.content[key]
    if isinstance(value, str) and not by_volume:
        _check_known(layer, key, value, kinds)
        return {value: 1.0}
    if not isinstance(value, dict) or not value:
        raise layer.wrong(key, f"must be {'' if by_volume else 'a name, or '}a table {{ name = {word}, ... }}")
    for name in value:
        _check_known(layer, key, name, kinds)
    fractions = layer.table(key, tuple(kinds))
    shares = {name: fractions.share(name, allowed) for name in value}
    for name, share in shares.items():
        if not 0.0 <= share < (1.0 if by_volume else math.inf):
            raise fractions.wrong(name, f"must be {allowed}")
    if not any(shares.values()):
        raise layer.wrong(key, f"at least one {word} must be above 0")
    if by_volume and math.fsum(shares.values()) >= 1.0:
        raise layer.wrong(key, "their sum must be below 1, the whole layer")
    return shares


def _check_known(layer: Table, key: str, name: str, kinds: Mapping[str, Any]) -> None:
    if name not in kinds:
        defined = shorten_text(", ".join(map(show_key, kinds)) or "none", 200)
        hint = suggest_nearest(name, kinds) or "."
        raise layer.wrong(key, f"no table [particles.{show_key(name)}]{hint} Defined: {defined}")


class _Particles:
    """The particles of a file by name: all are checked at once, each is computed when a layer first asks for it."""

    def __init__(self, file: Table, spheres_of: Callable[..., Particles], folder: Path) -> None:
        content = file.content.get("particles", {})
        if not isinstance(content, dict) or not all(isinstance(kind, dict) for kind in content.values()):
            raise file.wrong("particles", "must be tables headed [particles.NAME]")
        self.makers = {name: check_source(file, name, kind, spheres_of, folder) for name, kind in content.items()}
        self.computed: dict[str, Particles] = {}

    def kind(self, name: str) -> Particles:
        if name not in self.computed:
            self.computed[name] = self.makers[name]()
        return self.computed[name]


def _read_phase(layer: Table, folder: Path) -> PhaseMatrix:
    value = layer.content["phase"]
    if isinstance(value, dict):
        return _read_parametric_phase(layer)
    if not isinstance(value, str):
        raise layer.wrong("phase", f"must be {PHASES}")
    if value in NAMED_PHASES:
        return NAMED_PHASES[value]()
    if not value.endswith(TABLE):
        raise layer.wrong("phase", f"must be {PHASES}{suggest_nearest(value, NAMED_PHASES)}")
    tolerance = layer.number("tolerance") if "tolerance" in layer else 0.0
    return read_beside(layer, "phase", partial(read_coefficients, tolerance=tolerance), folder)


def _read_parametric_phase(layer: Table) -> PhaseMatrix:
    table = layer.table("phase", PHASE_KEYS)
    names = [name for name in PHASE_KEYS[:2] if name in table]
    if len(names) != 1 or ("terms" in table and "rayleigh" in table):
        raise layer.wrong("phase", f"must be {PHASES}")
    value = table.number(names[0])
    terms = table.whole("terms", 1, MOST_TERMS) if "terms" in table else count_henyey_greenstein_terms(value)
    if abs(value) < 1.0 and terms > MOST_TERMS:
        raise table.wrong(names[0], f"it takes {terms} terms, and at most {MOST_TERMS} are allowed")
    with locate_errors((*table.place, names[0])):
        return rayleigh(value) if "rayleigh" in table else henyey_greenstein(value, terms)


def _read_base(file: Table, folder: Path) -> Boundary | None:
    if "base" not in file:
        return None
    base = file.table("base", BASE_KEYS)
    kind = base.choice("kind", tuple(BASES))
    for key in base.content:
        owners = [f'"{owner}"' for owner, keys in BASES.items() if key in keys]
        if key != "kind" and key not in BASES[kind]:
            raise base.wrong(key, f"goes with kind = {' or '.join(owners)} only")
    if kind == "black":
        return None
    if kind == "lambertian":
        albedo = base.share("albedo", ALBEDO)
        with locate_errors(base.place, BASE_KEYS):
            return Lambertian(albedo)
    if kind == "facets":
        base.required("roughness", ROUGHNESS_ALLOWED)
    index, facets = find_index(file, base, "index", folder), _read_facets(base)
    with locate_errors(base.place, BASE_KEYS):
        return Facets(index, **facets) if kind == "facets" else Mirror(index)
