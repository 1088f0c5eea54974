"""The content of a scene file as a form changes it: a plain dict, in which a field is named by its place."""

import copy
import math
import re
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from vrte.app.form.fields import get_value, list_places
from vrte.basics.errors import Place, SceneError
from vrte.formats.bases import BASES, FACETS, ROUGHNESS
from vrte.formats.keys import Key, Substance, make_start
from vrte.formats.layers import FILLINGS, PHASES, THICKNESS_KEYS
from vrte.formats.particle_sources import DIAMETERS, ONE, SIZE_KEYS, SIZES, SOURCES, SPHERES
from vrte.formats.scene_file import ANGLES, REQUEST_KEYS, SceneFile, read_listed_wavelengths
from vrte.formats.toml_table import is_number, show_key, write_toml
from vrte.optics.crowding import INDEPENDENT
from vrte.optics.refractive_index import MATERIALS
from vrte.results.brdf import check_ascending

Content = dict[str, Any]

MOST_WAVELENGTHS = 40  # that a page shows
HUGE = 10**9
DEEPEST = 10.0  # optical depth down to which the field is shown where none is given

START: Content = {
    "wavelength_um": 0.64,
    "particles": {"gold": {"index": "gold", "radius_um": 0.6}},
    "layer": [{"particles": "gold", "thickness": 100.0}],
    "base": {"kind": "black"},
    "brdf": {
        "mu_i": {"start": 0.2, "stop": 1.0, "count": 9},
        "mu_o": {"start": 0.05, "stop": 1.0, "count": 20},
        "phi_deg": {"start": 0, "stop": 360, "count": 37},
    },
    "field": {"mu0": 0.6, "mu": {"start": -1.0, "stop": 1.0, "count": 120}, "phi_deg": [0, 180]},
}


def put(content: Content, place: Place, value: Any) -> None:
    """Sets what is at a place of a table, or of a list, that is there; None removes it."""
    table: Any = get_value(content, place[:-1])
    step: Any = place[-1]
    if isinstance(table, dict) and value is None:
        table.pop(step, None)
    elif isinstance(table, dict if isinstance(step, str) else list):  # not removed meanwhile
        table[step] = value


def remove(table: Content, *keys: str) -> None:
    """Takes keys out of a table, where they are."""
    for key in keys:
        table.pop(key, None)


def is_interface(layer: Content) -> bool:
    """Whether there is nothing but an interface between two media."""
    return "interface" in layer


def name_layers(layers: list[Content]) -> list[str]:
    """What layers are called, counted as messages about a file do it."""
    return ["interface" if is_interface(layer) else f"layer {place}" for place, layer in enumerate(layers, 1)]


# base and directions


def set_base(content: Content, kind: str) -> None:
    """What lies beneath; what both kinds know of stays."""
    before = content.get("base", {})
    known = BASES[before["kind"]].keys if before.get("kind") in BASES else {}
    keys = BASES[kind].keys
    content["base"] = {"kind": kind} | make_start(keys) | keep_values(before, known, keys)


def keep_values(table: Content, known: Mapping[str, Key], keys: Mapping[str, Key]) -> Content:
    """The values of a table whose keys mean the same in another table."""
    return {name: table[name] for name, key in keys.items() if name in table and known.get(name) == key}


def set_degrees(content: Content, degrees: bool) -> None:
    """Directions in degrees from the normal, or as cosines; a range keeps its ends and its number."""
    new = ANGLES if degrees else {key: name for name, key in ANGLES.items()}
    for kind in REQUEST_KEYS:
        if isinstance(table := content.get(kind), dict):
            content[kind] = {
                new.get(key, key): convert_angles(one, degrees) if key in new else one for key, one in table.items()
            }


def convert_angles(value: Any, degrees: bool) -> Any:
    """Cosines as degrees, or degrees as cosines; what is neither stays."""
    if isinstance(value, list):
        return [convert_angles(one, degrees) for one in value]
    if isinstance(value, dict):
        return {key: one if key == "count" else convert_angles(one, degrees) for key, one in value.items()}
    if not is_number(value) or not (0.0 < value <= 1.0 if degrees else 0.0 <= value < 90.0):
        return value
    angle = math.degrees(math.acos(value)) if degrees else math.cos(math.radians(value))
    return float(f"{angle:.6g}")


# what is asked of the library


def count_of(value: Any) -> int:
    """How many numbers a list or a range has; 1 for what is neither."""
    if isinstance(value, list):
        return max(1, len(value))
    count = value.get("count") if isinstance(value, dict) else 1
    return min(count, HUGE) if isinstance(count, int) and count > 0 else 1


def list_page_wavelengths(content: Content) -> list[float]:
    """The wavelengths [um], ascending; one where no particles need any. Raises SceneError for what are none."""
    value: Any = content.get("wavelength_um")
    if not isinstance(value, (list, dict)):
        return [value] if is_number(value) else [math.nan]
    if (count := count_of(value)) > MOST_WAVELENGTHS:
        words = f"the page takes at most {MOST_WAVELENGTHS} wavelengths, not {count}"
        raise SceneError(f"wavelength_um: {words}", "wavelength_um")
    try:
        listed = value if isinstance(value, list) else read_listed_wavelengths(content)
        return [float(one) for one in check_ascending(listed)]
    except SceneError as error:
        raise SceneError(str(error), "wavelength_um") from error


def select_wavelength(content: Content, wavelength: float) -> Content:
    """The content of a scene file for one of the wavelengths."""
    several = isinstance(content.get("wavelength_um"), (list, dict))
    return {**content, "wavelength_um": wavelength} if several else content


def choose_keywords(file: SceneFile) -> Content:
    """The keywords of `vrte.brdf` or `vrte.radiance`; the depths of a field where none is given: five, evenly."""
    found = file.keywords({})
    if file.kind == "field" and "tau" not in found:
        bottom = min(file.scene.thickness, DEEPEST)
        found["tau"] = [bottom * step / 4.0 for step in range(5)]
    return found


MOST_KINDS = 12  # that a page shows
LONGEST_NAME = 60  # of a kind
NUMBERED, NUMBERED_AFTER = re.compile(r"kind-\d+"), re.compile(r"-\d+$")  # names that a card gets by itself


def list_size_modes() -> Iterator[tuple[str, tuple[str, Content]]]:
    """How a size can be given: in words, and what it begins with."""
    for name in ("radius", "diameter"):
        yield name, (f"one {name}", {f"{name}_um": ONE[f"{name}_um"].start})
    for name, row in SIZES.items():
        start = make_start(row.keys)
        if name in row.keys:
            yield name, (row.words, {"size": start})
            continue
        yield name, (f"{row.words} radii", {"size": {name: dict(start)}})
        doubled = {DIAMETERS[key]: (2.0 * np.array(start.pop(key))).tolist() for key in row.keys if key in DIAMETERS}
        if doubled:
            yield f"{name}, diameters", (f"{row.words} diameters", {"size": {name: doubled | start}})


SIZE_MODES: dict[str, tuple[str, Content]] = dict(list_size_modes())


def add_kind(content: Content) -> str:
    """One more kind of particle; its name. Raises SceneError where there are as many as a page shows."""
    kinds = content.setdefault("particles", {})
    if len(kinds) >= MOST_KINDS:
        raise SceneError(f"particles: the page shows at most {MOST_KINDS} kinds; `vrte brdf` takes more")
    name = next(name for k in range(1, MOST_KINDS + 2) if (name := f"kind-{k}") not in kinds)
    kinds[name] = {"index": "rutile", "radius_um": 0.2}
    return name


def remove_kind(content: Content, name: str) -> None:
    """Raises SceneError where a layer holds it."""
    for called, layer in zip(name_layers(content["layer"]), content["layer"], strict=True):
        held = layer.get("volume_fractions", layer.get("particles", ()))
        if name == held or (isinstance(held, dict) and name in held):
            raise SceneError(f"particles.{show_key(name)}: {called} holds it; fill that with something else first")
    content.get("particles", {}).pop(name, None)


def rename_kind(content: Content, old: str, new: str) -> None:
    """Renames a kind of particle, in the layers too. Raises SceneError for an empty, long or taken name."""
    new = new.strip()
    if new == old:
        return
    if not 0 < len(new) <= LONGEST_NAME:
        raise SceneError(f"particles: a name must have 1 to {LONGEST_NAME} characters, not {len(new)}")
    write_toml({new: 1})
    if new in content["particles"]:
        raise SceneError(f"particles.{show_key(new)}: there is another kind of that name")
    for table in (content, *content["layer"]):
        for key in {"particles", "volume_fractions"} & table.keys():
            held = table[key]
            many = isinstance(held, dict) and {new if name == old else name: value for name, value in held.items()}
            table[key] = many or (new if held == old else held)


def get_substance(kind: Content) -> Any:
    """What particles of a kind consist of, of several substances the first."""
    keys = SOURCES[get_source(kind)].keys
    return next((kind.get(name) for name, key in keys.items() if isinstance(key, Substance)), None)


def name_after(content: Content, name: str, before: Any) -> None:
    """Calls a kind after its substance, "Au" of main/Au/Johnson, where its name followed the substance ``before``."""
    index = get_substance(content["particles"][name])
    wanted, first = (
        one if one in MATERIALS else one.split("/")[1] if one.count("/") == 2 else ""
        for one in (index if isinstance(index, str) else "", before if isinstance(before, str) else "")
    )
    by_itself = NUMBERED.fullmatch(name) or (first and NUMBERED_AFTER.sub("", name) == first)
    if wanted and by_itself and index != before:
        others = content["particles"].keys() - {name}
        free = (wanted if k == 1 else f"{wanted}-{k}" for k in range(1, MOST_KINDS + 2))
        rename_kind(content, name, next(one for one in free if one not in others))


def get_source(kind: Content) -> str:
    """Where particles of a kind come from, one of SOURCES."""
    source = kind.get("source", SPHERES)
    return source if source in SOURCES else SPHERES


def set_source(kind: Content, source: str) -> None:
    """Another source; what both know of stays."""
    before, row = SOURCES[get_source(kind)], SOURCES[source]
    kept = keep_values(kind, before.keys, row.keys)
    kept |= {key: kind[key] for key in ("host_index", *(SIZE_KEYS if row.sized else ())) if key in kind}
    kind.clear()
    kind.update({} if source == SPHERES else {"source": source})
    kind.update(make_start(row.keys) | kept)
    if row.sized and not any(key in kind for key in SIZE_KEYS):
        kind.update(copy.deepcopy(SIZE_MODES["radius"][1]))


def get_size_mode(kind: Content) -> str:
    """How a kind's size is given, one of SIZE_MODES."""
    size = kind.get("size")
    if not isinstance(size, dict):
        return "diameter" if "diameter_um" in kind else "radius"
    name = next((one for one in SIZES if one in size), next(iter(SIZES)))
    by_diameter = any(place[-1] in DIAMETERS.values() for place in list_places(size.get(name), name))
    return f"{name}, diameters" if by_diameter else name


def list_size_places(mode: str) -> list[tuple[str, ...]]:
    """Where a kind of particle has its size, given in one of SIZE_MODES."""
    name, _, diameters = mode.partition(", ")
    if name not in SIZES:
        return [(f"{name}_um",)]
    keys = SIZES[name].keys
    above = ("size",) if name in keys else ("size", name)
    return [(*above, DIAMETERS.get(key, key) if diameters else key) for key in keys]


def set_size_mode(kind: Content, mode: str) -> None:
    """Another way to give the size; between radius and diameter it stays as it is."""
    before = get_size_mode(kind)
    if mode == before:
        return
    given = {key: kind.pop(key, None) for key in ("radius_um", "diameter_um", "size")}
    kind.update(copy.deepcopy(SIZE_MODES[mode][1]))
    size: Any = given.get(f"{before}_um")
    if mode in ("radius", "diameter") and is_number(size):
        kind[f"{mode}_um"] = size * (2.0 if mode == "diameter" else 0.5)


MOST_LAYERS = 30  # that a page shows
MEDIA: dict[str, tuple[str, Any]] = {  # what fills a layer: in words, and the phase function that it begins with
    "particles": ("particles of one kind", None),
    "mixture": ("a mixture, by number", None),
    "volumes": ("a mixture, by volume", None),
    **{name: (row.words, make_start(row.keys) or name) for name, row in PHASES.items()},
    "coefficients": ("a table of coefficients", ""),
    "flakes": ("oriented flakes", None),
    "clear": ("nothing: clear or tinted", None),
}
FLAKES: Content = {
    "flakes": {"index": "aluminium", "tilt_deg": 12.0},
    "flake_area": 3.0,
}  # that such a layer begins with
OF_FLAKES = ("flakes", "flake_area", "flake_thickness_um")
HELD = ("particles", "mixture", "volumes")  # particles, in these ways
SURFACES = {"smooth": "smooth: beams stay beams", "rough": "rough: many small facets"}
LENGTH, FRACTION, OPTICAL = 50.0, 0.05, 10.0  # that a layer begins with: um, of the volume, optical thickness


def add_layer(content: Content) -> None:
    """One more at the bottom, like the last, with an end. Raises SceneError where there are as many as a page shows."""
    layers = content["layer"]
    filled = [layer for layer in layers if not is_interface(layer)]
    like = filled[-1] if filled else {"phase": "isotropic", "albedo": 0.99, "thickness": 10.0}
    ends = {"thickness": 1.0} if like.get("thickness") == math.inf else {}
    insert_layer(layers, len(layers), copy.deepcopy(like) | ends)


def insert_layer(layers: list[Content], place: int, layer: Content) -> None:
    """Puts a layer in; a semi-infinite one above it gets an end. Raises SceneError beyond MOST_LAYERS."""
    if len(layers) >= MOST_LAYERS:
        raise SceneError(f"layer: the page shows at most {MOST_LAYERS} layers; `vrte brdf` takes more")
    if place and layers[-1].get("thickness") == math.inf:
        layers[-1]["thickness"] = 1.0
    layers.insert(place, layer)


def add_interface(content: Content) -> None:
    """Air above the stack, or below it where its top is an interface. Raises SceneError as `add_layer` does."""
    index: Any = content.get("host_index")
    if index is None:
        index = 1.5
        if content.get("particles"):
            content["host_index"] = index  # that of the binder between its surface and the next
    layers = content["layer"]
    if not is_interface(layers[0]):
        insert_layer(layers, 0, {"interface": {"above": 1.0, "below": index}})
        return
    last = next(layer["interface"] for layer in reversed(layers) if is_interface(layer))
    above = last.get("below", index)
    insert_layer(layers, len(layers), {"interface": {"above": above, "below": index if above == 1.0 else 1.0}})


def set_rough(table: Content, surface: str) -> None:
    """One of SURFACES: facets, or a smooth surface, which has no distribution of slopes."""
    if surface == "rough":
        table.setdefault("roughness", ROUGHNESS)
    else:
        remove(table, *FACETS)


def remove_layer(content: Content, place: int) -> None:
    """Removes a layer, but never the last one."""
    if len(content["layer"]) > 1:
        del content["layer"][place]


def move_layer(content: Content, place: int, by: int) -> None:
    """Up (-1) or down (1), as far as there is room."""
    layers, target = content["layer"], place + by
    if 0 <= target < len(layers):
        layers[place], layers[target] = layers[target], layers[place]


def get_medium(layer: Content) -> str:
    """What fills a layer, one of MEDIA."""
    phase = layer.get("phase")
    if isinstance(phase, dict):
        return next((name for name in PHASES if name in phase), "isotropic")
    if phase is not None:
        return phase if phase in PHASES else "coefficients"
    if not any(key in layer for key in FILLINGS):
        return "flakes" if "flakes" in layer else "clear"
    several = "mixture" if isinstance(layer.get("particles"), dict) else "particles"
    return "volumes" if "volume_fractions" in layer else several


def set_medium(content: Content, place: int, medium: str) -> None:
    """Changes the medium of a layer, and keeps its thickness where it can."""
    layer, kinds = content["layer"][place], content.get("particles", {})
    if medium == get_medium(layer):
        return
    geometric, phase = is_geometric(layer), MEDIA[medium][1]
    if get_medium(layer) == "clear":
        remove(layer, "host_index")  # of the clear medium
    if "flakes" in (medium, get_medium(layer)):  # alone: they have no thickness that others keep
        remove(layer, *OF_FLAKES, *THICKNESS_KEYS)
        layer["thickness"], geometric = OPTICAL, False
    remove(layer, *FILLINGS, "tolerance")
    if medium == "flakes":
        remove(layer, "packing", "albedo", *THICKNESS_KEYS)
        layer.update(copy.deepcopy(FLAKES))
        return
    if medium == "clear":
        remove(layer, *OF_FLAKES)
    if medium not in HELD:
        remove(layer, "packing")
        set_geometric(layer, medium == "clear")
    if phase is not None:
        layer["phase"] = copy.deepcopy(phase)
        layer.setdefault("albedo", 0.99)
        return
    remove(layer, "albedo")
    names = list(kinds) or ([add_kind(content)] if medium in HELD else [])
    if medium == "clear":  # the index of the medium in which it lies: below the last interface above it, or the file's
        remove(layer, "volume_fraction")
        above = [one["interface"].get("below") for one in content["layer"][:place] if is_interface(one)]
        layer.setdefault("host_index", copy.deepcopy((above or [content.get("host_index", 1.0)])[-1]))
    elif medium == "volumes":
        layer["volume_fractions"] = dict.fromkeys(names[:2], FRACTION)
        remove(layer, "volume_fraction")
    else:
        layer["particles"] = names[0] if medium == "particles" else dict.fromkeys(names[:2], 1.0)
        if geometric or is_fraction_needed(layer):
            layer.setdefault("volume_fraction", FRACTION)


def is_geometric(layer: Content) -> bool:
    """Whether a layer's thickness is given in micrometres."""
    return "thickness_um" in layer or ("volume_fraction" in layer and "thickness" not in layer)


def set_geometric(layer: Content, geometric: bool) -> None:
    """Thickness in micrometres with a volume fraction, or optical."""
    if geometric == is_geometric(layer):
        return
    remove(layer, *THICKNESS_KEYS)
    layer.update({"thickness_um": LENGTH} if geometric else {"thickness": OPTICAL})
    if "volume_fractions" not in layer and (geometric or is_fraction_needed(layer)):
        layer["volume_fraction"] = FRACTION


def is_fraction_needed(layer: Content) -> bool:
    """Whether particles of a layer of a given optical thickness scatter otherwise where they are closer."""
    return layer.get("packing", INDEPENDENT) != INDEPENDENT


def is_fraction_asked(content: Content, place: int) -> bool:
    """The same, or they lie in a medium that may absorb: the message about that is at the volume fraction's field."""
    layer, kinds = content["layer"][place], content.get("particles", {})
    held = layer.get("particles", ())
    around = [kinds.get(name, {}) for name in ((held,) if isinstance(held, str) else held)]
    clear = all(isinstance(one.get("host_index", 1.0), (int, float)) for one in (content, layer, *around))
    return is_fraction_needed(layer) or "volume_fraction" in layer or not clear


def set_packing(layer: Content, packing: str) -> None:
    """The packing of particles that are close to each other; a layer that needs a volume fraction for it gets one."""
    if packing == INDEPENDENT:
        remove(layer, "packing", *([] if is_geometric(layer) else ["volume_fraction"]))
        return
    layer["packing"] = packing
    if "volume_fractions" not in layer:
        layer.setdefault("volume_fraction", FRACTION)
