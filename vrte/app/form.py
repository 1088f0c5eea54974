"""What the form holds: the content of a scene file as a plain dict, typed text in, the library's messages out.

A field is named by its path in the content, ("layer", 0, "thickness"); the library's messages begin with the dotted
key of that path, "layer[1].thickness", and so find their field.
"""

import copy
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from vrte.basics.errors import SceneError
from vrte.calls.plan import request_of
from vrte.formats.scene_file import (
    ANGLES,
    BASE_KEYS,
    DIAMETERS,
    FILE_KEYS,
    FILLINGS,
    LAYER_KEYS,
    PARTICLE_KEYS,
    REQUEST_KEYS,
    SceneFile,
    listed_wavelengths,
    scene_of,
    tables_named,
)
from vrte.formats.scene_writer import toml_text
from vrte.formats.toml_table import RANGE_KEYS, is_number, shown, shown_key
from vrte.optics.phase_matrix import MOST_TERMS, henyey_greenstein_terms
from vrte.optics.refractive_index import MATERIALS
from vrte.optics.spheres import check_spheres
from vrte.results.spectrum import ascending

Content = dict[str, Any]
Place = tuple[str | int, ...]

MOST_LAYERS, MOST_KINDS, MOST_WAVELENGTHS = 30, 12, 40  # that a page shows
MOST_DIRECTIONS, HUGE = 10_000, 10**9
LARGEST_RESULT = 2e8  # bytes
LONGEST_TEXT = 4000  # characters of a field
MOST_ROUNDS = 40  # fields that are wrong at once
MOST_OF_AXIS = 10  # wavelengths that are taken of a sweep's
VISIBLE: Content = {
    "start": 0.43,
    "stop": 0.7,
    "count": 7,
}  # um: enough for a colour, within the tables of all pigments
DEEPEST = 10.0  # optical depth down to which the field is shown where nothing is said
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?inf|nan")
WHOLE = re.compile(r"[+-]?\d{1,300}")
NUMBERED, NUMBERED_AFTER = re.compile(r"kind-\d+"), re.compile(r"-\d+$")  # names that a card gets by itself

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
MEDIA = ("particles", "mixture", "volumes", "isotropic", "rayleigh", "henyey_greenstein", "table")
SIZE_MODES: dict[str, Content] = {
    "radius": {"radius_um": 0.3},
    "diameter": {"diameter_um": 0.6},
    "lognormal": {"size": {"lognormal": {"median_um": 0.2, "sigma": 1.4}}},
    "lognormal, diameters": {"size": {"lognormal": {"median_diameter_um": 0.4, "sigma": 1.4}}},
    "gamma": {"size": {"gamma": {"r_eff_um": 0.2, "v_eff": 0.07}}},
    "gamma, diameters": {"size": {"gamma": {"d_eff_um": 0.4, "v_eff": 0.07}}},
}
PHASES: Content = {
    "isotropic": "isotropic",
    "rayleigh": {"rayleigh": 0.0},
    "henyey_greenstein": {"henyey_greenstein": 0.8},
}
# what no check objects to, in place of a field that is wrong, so that the next one is heard
HARMLESS: Content = {
    "wavelength_um": 0.5,
    "host_index": 1.0,
    "index": [3.1, 0.1],
    "radius_um": 0.1,
    "diameter_um": 0.1,
    "median_um": 0.1,
    "median_diameter_um": 0.1,
    "d_eff_um": 0.1,
    "sigma": 1.2,
    "r_eff_um": 0.1,
    "v_eff": 0.1,
    "albedo": 0.5,
    "thickness": 1.0,
    "thickness_um": 1.0,
    "volume_fraction": 0.01,
    "henyey_greenstein": 0.5,
    "rayleigh": 0.0,
    "kind": "black",
    "mu_i": 0.5,
    "mu_o": 0.5,
    "mu0": 0.5,
    **dict.fromkeys(ANGLES.values(), 60.0),
}


def value_of(text: str) -> Any:
    """What a field's text means: a number, numbers with commas, start:stop:count, otherwise itself; None if empty.

    >>> value_of("0.64"), value_of("1.5, 0.01"), value_of("gold"), value_of(" ")
    (0.64, [1.5, 0.01], 'gold', None)
    >>> value_of("0.05:1:20")
    {'start': 0.05, 'stop': 1, 'count': 20}
    """
    text = text.strip()
    if not text:
        return None
    if len(text) > LONGEST_TEXT:
        return text
    parts = [part.strip() for part in re.split("[,:]", text)]
    if not all(NUMBER.fullmatch(part) for part in parts):
        return text
    numbers = [int(part) if WHOLE.fullmatch(part) else float(part) for part in parts]
    if ":" not in text:
        return numbers if len(numbers) > 1 else numbers[0]
    return dict(zip(RANGE_KEYS, numbers, strict=True)) if len(numbers) == 3 and "," not in text else text


def text_of(value: Any) -> str:
    """A field's text, which `value_of` reads.

    >>> text_of({"start": 0.05, "stop": 1.0, "count": 20}), text_of([1.5, 0.01]), text_of(None)
    ('0.05:1:20', '1.5, 0.01', '')
    """
    if value is None:
        return ""
    if isinstance(value, dict):
        return ":".join(text_of(value.get(key)) for key in RANGE_KEYS)
    if isinstance(value, list):
        return ", ".join(map(text_of, value))
    return repr(value).removesuffix(".0") if isinstance(value, float) else str(value)


def got(content: Content, place: Place) -> Any:
    """What is there, or None."""
    found: Any = content
    for step in place:
        try:
            found = found[step]
        except (KeyError, IndexError, TypeError):
            return None
    return found


def put(content: Content, place: Place, value: Any) -> None:
    """Sets a key of a table that is there; None removes it."""
    table = got(content, place[:-1])
    if not isinstance(table, dict):
        return  # it went away while somebody typed
    if value is None:
        table.pop(place[-1], None)
    else:
        table[place[-1]] = value


def dotted(place: Place) -> str:
    """As the library's messages name it.

    >>> dotted(("layer", 0, "particles", "gold"))
    'layer[1].particles.gold'
    """
    found = ""
    for step in place:
        found += f"[{step + 1}]" if isinstance(step, int) else f".{shown_key(step)}"
    return found.removeprefix(".")


# layers


def add_layer(content: Content) -> None:
    """One more at the bottom, like the last, with an end. Raises SceneError where there are as many as a page shows."""
    layers = content["layer"]
    if len(layers) >= MOST_LAYERS:
        raise SceneError(f"layer: the page shows at most {MOST_LAYERS} layers; `vrte brdf` takes more")
    last = layers[-1]
    if last.get("thickness") == math.inf:
        last["thickness"] = 1.0
    layers.append(copy.deepcopy(last))


def remove_layer(content: Content, place: int) -> None:
    """All but the last one that is left."""
    if len(content["layer"]) > 1:
        del content["layer"][place]


def move_layer(content: Content, place: int, by: int) -> None:
    """Up (-1) or down (1), as far as there is room."""
    layers, target = content["layer"], place + by
    if 0 <= target < len(layers):
        layers[place], layers[target] = layers[target], layers[place]


def medium_of(layer: Content) -> str:
    """What fills a layer, one of MEDIA.

    >>> medium_of({"phase": {"henyey_greenstein": 0.9}}), medium_of({"particles": {"gold": 1}})
    ('henyey_greenstein', 'mixture')
    """
    if "volume_fractions" in layer:
        return "volumes"
    if "phase" not in layer:
        return "mixture" if isinstance(layer.get("particles"), dict) else "particles"
    phase = layer["phase"]
    if isinstance(phase, dict):
        return "henyey_greenstein" if "henyey_greenstein" in phase else "rayleigh"
    return phase if phase in ("isotropic", "rayleigh") else "table"


def set_medium(content: Content, place: int, medium: str) -> None:
    """Fills a layer with something else; its thickness stays where it can."""
    layer, kinds = content["layer"][place], list(content.get("particles", {}))
    if medium == medium_of(layer):
        return
    geometric = is_geometric(layer)
    for key in (*FILLINGS, "tolerance"):
        layer.pop(key, None)
    if medium in ("particles", "mixture", "volumes"):
        kinds = kinds or [add_kind(content)]
        layer.pop("albedo", None)
        if medium == "volumes":
            layer["volume_fractions"] = dict.fromkeys(kinds[:2], 0.05)
            layer.pop("volume_fraction", None)
        else:
            layer["particles"] = kinds[0] if medium == "particles" else dict.fromkeys(kinds[:2], 1.0)
            if geometric:
                layer.setdefault("volume_fraction", 0.05)
        return
    layer["phase"] = copy.deepcopy(PHASES[medium])
    layer.setdefault("albedo", 0.99)
    set_geometric(layer, False)


def is_geometric(layer: Content) -> bool:
    """Whether a layer's thickness is given in micrometres."""
    return "thickness_um" in layer or "volume_fraction" in layer


def set_geometric(layer: Content, geometric: bool) -> None:
    """Thickness in micrometres with a volume fraction, or optical."""
    if geometric == is_geometric(layer):
        return
    for key in ("thickness", "thickness_um", "volume_fraction"):
        layer.pop(key, None)
    layer.update({"thickness_um": 50.0} if geometric else {"thickness": 10.0})
    if geometric and "volume_fractions" not in layer:
        layer["volume_fraction"] = 0.05


# kinds of particles


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
    for place, layer in enumerate(content["layer"], 1):
        held = layer.get("volume_fractions", layer.get("particles", ()))
        if name == held or (isinstance(held, dict) and name in held):
            raise SceneError(
                f"particles.{shown_key(name)}: layer {place} holds it; fill that with something else first"
            )
    content.get("particles", {}).pop(name, None)


def rename_kind(content: Content, old: str, new: str) -> None:
    """In the layers, too. Raises SceneError for an empty or a long name, or one that another kind has."""
    new = new.strip()
    if new == old:
        return
    if not 0 < len(new) <= 60:
        raise SceneError(f"particles: a name must have 1 to 60 characters, not {len(new)}")
    toml_text({new: 1})
    if new in content["particles"]:
        raise SceneError(f"particles.{shown_key(new)}: there is another kind of that name")
    content["particles"] = {new if name == old else name: kind for name, kind in content["particles"].items()}
    for layer in content["layer"]:
        for key in ("particles", "volume_fractions"):
            held = layer.get(key)
            if isinstance(held, dict):
                layer[key] = {new if name == old else name: share for name, share in held.items()}
            elif held == old:
                layer[key] = new


def name_of_substance(index: Any) -> str:
    """What a kind of this substance is called, "" where that says nothing.

    >>> name_of_substance("zinc oxide"), name_of_substance("main/Au/Johnson"), name_of_substance([1.5, 0.0])
    ('zinc oxide', 'Au', '')
    """
    if index in MATERIALS if isinstance(index, str) else False:
        return str(index)
    parts = index.split("/") if isinstance(index, str) else []
    return parts[1] if len(parts) == 3 and all(parts) else ""


def name_after(content: Content, name: str, before: Any) -> None:
    """Calls a kind after its substance where it was called after the one ``before``, and not by hand."""
    index = content["particles"][name]["index"]
    wanted, first = name_of_substance(index), name_of_substance(before)
    by_itself = NUMBERED.fullmatch(name) or (first and NUMBERED_AFTER.sub("", name) == first)
    if not wanted or not by_itself or index == before:
        return
    others = content["particles"].keys() - {name}
    free = (wanted if k == 1 else f"{wanted}-{k}" for k in range(1, MOST_KINDS + 2))
    rename_kind(content, name, next(one for one in free if one not in others))


def size_mode(kind: Content) -> str:
    """One of SIZE_MODES."""
    size = kind.get("size")
    if not isinstance(size, dict):
        return "diameter" if "diameter_um" in kind else "radius"
    name = "gamma" if "gamma" in size else "lognormal"
    inner = size.get(name)
    by_diameter = isinstance(inner, dict) and any(key in inner for key in DIAMETERS.values())
    return f"{name}, diameters" if by_diameter else name


def set_size_mode(kind: Content, mode: str) -> None:
    """Another way to tell the size; between radius and diameter it stays as it is."""
    before = size_mode(kind)
    if mode == before:
        return
    told = {key: kind.pop(key, None) for key in ("radius_um", "diameter_um", "size")}
    kind.update(copy.deepcopy(SIZE_MODES[mode]))
    size = told.get(f"{before}_um")
    if mode in ("radius", "diameter") and isinstance(size, (int, float)) and is_number(size):
        kind[f"{mode}_um"] = size * (2.0 if mode == "diameter" else 0.5)


def set_base(content: Content, kind: str) -> None:
    """What lies beneath."""
    content["base"] = {"kind": kind} | ({"albedo": 0.5} if kind == "lambertian" else {})


def in_degrees(content: Content) -> bool:
    """Whether directions are told in degrees from the normal."""
    return any(key in content.get(kind, {}) for kind in ("brdf", "field") for key in ANGLES.values())


def set_degrees(content: Content, degrees: bool) -> None:
    """Directions in degrees from the normal, or as cosines; a range keeps its ends and its number."""
    new = ANGLES if degrees else {key: name for name, key in ANGLES.items()}
    for kind in REQUEST_KEYS:
        if isinstance(content.get(kind), dict):
            content[kind] = {
                new.get(key, key): turned(value, degrees) if key in new else value
                for key, value in content[kind].items()
            }


def turned(value: Any, degrees: bool) -> Any:
    """Cosines as degrees, or degrees as cosines; what is neither stays.

    >>> turned([0.5, 1.0], True), turned({"start": 60, "stop": 0, "count": 3}, False)
    ([60.0, 0.0], {'start': 0.5, 'stop': 1.0, 'count': 3})
    """
    if isinstance(value, list):
        return [turned(one, degrees) for one in value]
    if isinstance(value, dict):
        return {key: one if key == "count" else turned(one, degrees) for key, one in value.items()}
    if not is_number(value) or not (0.0 < value <= 1.0 if degrees else 0.0 <= value < 90.0):
        return value
    angle = math.degrees(math.acos(value)) if degrees else math.cos(math.radians(value))
    return float(f"{angle:.6g}")


# checks


def wavelengths_of(content: Content) -> list[float]:
    """The wavelengths [um], ascending; one where no particles need any. Raises SceneError for what are none."""
    value: Any = content.get("wavelength_um")
    if not isinstance(value, (list, dict)):
        return [value] if is_number(value) else [math.nan]
    if count_of(value) > MOST_WAVELENGTHS:
        raise SceneError(f"wavelength_um: the page takes at most {MOST_WAVELENGTHS} wavelengths, not {count_of(value)}")
    return [float(one) for one in ascending(value if isinstance(value, list) else listed_wavelengths(content))]


def at(content: Content, wavelength: float) -> Content:
    """The content of a scene file for one of the wavelengths."""
    if isinstance(content.get("wavelength_um"), (list, dict)):
        return {**content, "wavelength_um": wavelength}
    return content


def keywords_of(file: SceneFile) -> Content:
    """The keywords of `vrte.brdf` or `vrte.radiance`; the depths of a field where nothing is said: five, evenly."""
    found = file.keywords({})
    if file.kind == "field" and "tau" not in found:
        bottom = min(file.scene.thickness, DEEPEST)
        found["tau"] = [bottom * step / 4.0 for step in range(5)]
    return found


def check(content: Content, folder: Path = Path(), tables: frozenset[str] = frozenset()) -> None:
    """Everything that can be checked in milliseconds. Raises SceneError, with the dotted key in front.

    ``tables`` in ``folder`` are the only files that a scene may name: who sits before a page must not read others.
    """
    check_amount(content)
    wavelengths = wavelengths_of(content)
    check_tables(content, tables)
    content = lightened(content)
    for wavelength in dict.fromkeys((wavelengths[0], wavelengths[-1])):  # tables are ranges: the ends will do
        for kind in ("brdf", "field") if "field" in content else ("brdf",):
            file = scene_of(at(content, wavelength), kind, folder, check_spheres)
            keywords = keywords_of(file)
            if any(is_geometric(layer) for layer in content["layer"]):
                keywords.pop("tau", None)  # how deep that is optically is not known yet
            with file.located():
                request_of("brdf" if kind == "brdf" else "radiance", file.scene, **keywords)


def lightened(content: Content) -> Content:
    """The content with isotropic layers in place of Henyey-Greenstein's where nothing is wrong with them: to add up
    their expansion, with up to 1e5 terms, takes up to two seconds."""
    layers = content.get("layer")
    if not isinstance(layers, list):
        return content
    return {**content, "layer": [{**layer, "phase": "isotropic"} if is_fine(layer) else layer for layer in layers]}


def is_fine(layer: Any) -> bool:
    """Whether a layer has a Henyey-Greenstein phase function that no check objects to.

    >>> is_fine({"phase": {"henyey_greenstein": 0.9}}), is_fine({"phase": {"henyey_greenstein": 1.0}})
    (True, False)
    """
    phase = layer.get("phase") if isinstance(layer, dict) else None
    if not isinstance(phase, dict) or not {"henyey_greenstein"} <= set(phase) <= {"henyey_greenstein", "terms"}:
        return False
    g, terms = phase["henyey_greenstein"], phase.get("terms", 1)
    if not is_number(g) or not -1.0 < g < 1.0 or not isinstance(terms, int) or isinstance(terms, bool):
        return False
    return 1 <= terms <= MOST_TERMS and ("terms" in phase or henyey_greenstein_terms(g) <= MOST_TERMS)


def check_amount(content: Content) -> None:
    """Whether a page can show it."""
    for key, most, word in (("layer", MOST_LAYERS, "layers"), ("particles", MOST_KINDS, "kinds of particles")):
        count = len(content[key]) if isinstance(content.get(key), (list, dict)) else 0
        if count > most:
            raise SceneError(f"{key}: the page shows at most {most} {word}, not {count}; `vrte brdf` takes more")
    wavelengths = count_of(content.get("wavelength_um"))
    for kind, keys, size in (("brdf", ("mu_i", "mu_o", "phi_deg"), 128.0), ("field", ("tau", "mu", "phi_deg"), 32.0)):
        table = content.get(kind)
        if isinstance(table, dict):
            if kind == "field" and any(count_of(table.get(key)) > 1 for key in ("mu0", ANGLES["mu0"])):
                key = "mu0" if "mu0" in table else ANGLES["mu0"]
                raise SceneError(f"field.{key}: the page shows one beam; `vrte field` takes more")
            said = {ANGLES[key] if ANGLES.get(key) in table else key: 0 for key in keys}
            check_directions(kind, {key: count_of(table.get(key, 0.0)) for key in said}, size * wavelengths)


def check_directions(kind: str, counts: dict[str, int], size: float) -> None:
    """Whether so many directions, of ``size`` bytes each, are no more than a page can show."""
    for key, count in counts.items():
        if count > MOST_DIRECTIONS:
            raise SceneError(f"{kind}.{key}: the page takes at most {MOST_DIRECTIONS} of them, not {count:.3g}")
    needed = math.prod(counts.values()) * size
    if needed > LARGEST_RESULT:
        product = " x ".join(map(str, counts.values()))
        raise SceneError(
            f"{kind}: {product} directions make {needed / 1e9:.3g} GB; the page takes at most "
            f"{LARGEST_RESULT / 1e9:g} GB: ask for fewer; `vrte {kind}` takes more"
        )


def count_of(value: Any) -> int:
    """How many numbers a list or a range has; 1 for what is neither."""
    if isinstance(value, list):
        return max(1, len(value))
    count = value.get("count") if isinstance(value, dict) else 1
    return min(count, HUGE) if isinstance(count, int) and count > 0 else 1


def check_tables(content: Content, tables: frozenset[str]) -> None:
    """Whether a scene names no file but those."""
    for key, name in tables_named(content).items():
        if name not in tables:
            raise SceneError(
                f"{key} = {shown(name)}: a page reads no files of the machine that it runs on; start `vrte view` with "
                "this scene to see it"
            )


def tables_of(content: Content) -> frozenset[str]:
    """The tables of its own that a scene names."""
    return frozenset(tables_named(content).values())


def problems(content: Content, folder: Path = Path(), tables: frozenset[str] = frozenset()) -> dict[str, str]:
    """Messages of the library by the dotted key that they are about, "" for none; empty where all is well.

    A field that is wrong is replaced in a copy by what is right, and the check goes on.

    >>> list(problems(START | {"nodes": 10**6, "wavelength_um": -1}))
    ['nodes', 'wavelength_um']
    """
    found: dict[str, str] = {}
    trial = copy.deepcopy(content)
    for _ in range(MOST_ROUNDS):
        try:
            check(trial, folder, tables)
            return found
        except SceneError as error:
            message = str(error)
        place = place_of(message, trial)
        key = dotted(place) if place else ""
        if key in found:
            return found
        found[key] = message
        if not place:
            return found
        mend(trial, place)
    return found


def place_of(message: str, content: Content) -> Place:
    """The field that a message begins with, () for none: of those that fit the longest."""
    fitting = [
        place
        for place in places(content)
        if message.startswith(key := dotted(place)) and (message[len(key) :] or " ")[0] in " :,.["
    ]
    found = max(fitting, key=lambda place: len(dotted(place)), default=())
    rest = message[len(dotted(found)) :].removeprefix(": ").split(" ", 1)[0]
    return (rest,) if found[:1] == ("particles",) and rest in FILE_KEYS else found  # the light's, told of the particles


def places(content: Content) -> Iterator[Place]:
    """All fields, those that are not there included."""
    yield from ((key,) for key in FILE_KEYS)
    for key, inner in (("base", BASE_KEYS), *REQUEST_KEYS.items()):
        yield from ((key, name) for name in inner)
    kinds, layers = content.get("particles"), content.get("layer")
    for name in kinds if isinstance(kinds, dict) else ():
        yield ("particles", name)
        yield from (("particles", name, key) for key in PARTICLE_KEYS)
        yield from below(content, ("particles", name, "size"))
    for place in range(len(layers)) if isinstance(layers, list) else ():
        yield ("layer", place)
        yield from (("layer", place, key) for key in LAYER_KEYS)
        yield from below(content, ("layer", place, "particles"))
        yield from below(content, ("layer", place, "volume_fractions"))
        yield from below(content, ("layer", place, "phase"))


def below(content: Content, place: Place) -> Iterator[Place]:
    """The keys of a table and of the tables in it."""
    table = got(content, place)
    for key in table if isinstance(table, dict) else ():
        yield (*place, key)
        yield from below(content, (*place, key))


def mend(content: Content, place: Place) -> None:
    """Puts in something that is right, or nothing where that is."""
    if place[0] == "layer" and place[2:3] in (("particles",), ("volume_fractions",)) and len(place) == 4:
        put(content, place, 1.0 if place[2] == "particles" else 1e-3)
    elif len(place) == 2 and place[0] == "particles":
        content["particles"][place[1]] = {"index": [3.1, 0.1], "radius_um": 0.1}
    elif len(place) == 2 and place[0] == "layer":
        content["layer"][place[1]] = {"phase": "isotropic", "albedo": 0.5, "thickness": 1.0}
    elif place[-1] == "phase":
        put(content, place, "isotropic")
    elif place == ("brdf",):
        content["brdf"] = {"mu_i": 0.5, "mu_o": 0.5}
    elif place == ("field",):
        content["field"] = {"mu0": 0.5}
    elif place[0] == "layer" and place[-1] == "volume_fractions":
        put(content, place, dict.fromkeys(list(content.get("particles") or {})[:1], 0.01))
    elif place[0] == "layer" and place[-1] == "particles":
        put(content, place, next(iter(content.get("particles") or {}), ""))
    else:
        put(content, place, copy.deepcopy(HARMLESS.get(str(place[-1]))))


# files


def adopted(content: Content, folder: Path = Path(), tables: frozenset[str] = frozenset()) -> Content:
    """The content of a file, checked, with what a form needs besides. Raises SceneError."""
    return adopted_and_told(content, folder, tables)[0]


def adopted_and_told(
    content: Content, folder: Path = Path(), tables: frozenset[str] = frozenset()
) -> tuple[Content, tuple[str, ...]]:
    """The same, and a sentence for each part that the file did not have, or that the page cannot show."""
    found = copy.deepcopy(content)
    told = (*without_axes(found), *with_defaults(found))
    check(found, folder, tables)
    found.setdefault("base", {"kind": "black"})
    for layer in found["layer"]:
        if layer.get("phase") == "rayleigh":
            layer["phase"] = {"rayleigh": 0.0}  # the same, with a field for its depolarization
    return found, told


def without_axes(content: Content) -> Iterator[str]:
    """A sweep's template is one scene; of its axes, the wavelengths can be shown."""
    axes = content.pop("axes", None)
    if axes is None:
        return
    table = axes if isinstance(axes, dict) else {}
    along = table.get("wavelength_um")
    values = along.get("values") if isinstance(along, dict) else along
    if isinstance(along, dict) and set(along) == set(RANGE_KEYS):
        values = along | {"count": min(count_of(along), MOST_OF_AXIS)}
    elif isinstance(values, list):
        step = -(-len(values) // MOST_OF_AXIS)
        values = values[::step]
    if isinstance(values, (list, dict)) and values:
        content["wavelength_um"] = values
        if count_of(values) < count_of(along):
            yield f"axes.wavelength_um: {count_of(values)} of its {count_of(along)} wavelengths are taken"
    others = [shown_key(name) for name in table if name != "wavelength_um" or "wavelength_um" not in content]
    if others or not table:
        yield f"axes: {', '.join(others)} stay as the template has them; `vrte sweep` computes them all"


def with_defaults(content: Content) -> Iterator[str]:
    """What a scene file for another command does not have."""
    if "brdf" not in content:
        content["brdf"] = copy.deepcopy(START["brdf"])
        yield "[brdf] is missing: directions all over the hemisphere are taken"
    if "wavelength_um" not in content and "particles" in content:
        render = content.get("render")
        listed = render.get("wavelengths_um") if isinstance(render, dict) else None
        content["wavelength_um"] = copy.deepcopy(VISIBLE if listed is None else listed)
        yield f"wavelength_um is missing: {text_of(content['wavelength_um'])} is taken"


def scene_text(content: Content) -> str:
    """A scene file. Raises SceneError."""
    wavelengths_of(content)
    return toml_text(content)
