"""Kinds of particles in the form: added, renamed, called after their substance; their source, and their sizes."""

import copy
import re
from collections.abc import Iterator
from typing import Any

from vrte.app.form.content import Content, keep_values, name_layers
from vrte.app.form.fields import list_places
from vrte.basics.errors import SceneError
from vrte.formats.keys import Substance, make_start
from vrte.formats.particle_sources import SOURCES, SPHERES
from vrte.formats.scene_writer import write_toml
from vrte.formats.sizes import DIAMETERS, ONE, SIZE_KEYS, SIZES
from vrte.formats.toml_table import is_number, show_key
from vrte.optics.refractive_index import MATERIALS

MOST_KINDS = 12  # that a page shows
LONGEST_NAME = 60  # of a kind
NUMBERED, NUMBERED_AFTER = re.compile(r"kind-\d+"), re.compile(r"-\d+$")  # names that a card gets by itself


def list_size_modes() -> Iterator[tuple[str, tuple[str, Content]]]:
    """How a size can be told: in words, and what it begins with."""
    yield "radius", ("one radius", {"radius_um": ONE["radius_um"].start})
    yield "diameter", ("one diameter", {"diameter_um": ONE["diameter_um"].start})
    for name, row in SIZES.items():
        start = make_start(row.keys)
        if name in row.keys:
            yield name, (row.words, {"size": start})
            continue
        yield name, (f"{row.words} radii", {"size": {name: dict(start)}})
        doubled = {DIAMETERS[key]: double(start.pop(key)) for key in list(start) if key in DIAMETERS}
        if doubled:
            yield f"{name}, diameters", (f"{row.words} diameters", {"size": {name: doubled | start}})


def double(value: Any) -> Any:
    """Twice a number, or each of a list.

    >>> double([0.5, 1.0])
    [1.0, 2.0]
    """
    return [2.0 * one for one in value] if isinstance(value, list) else 2.0 * value


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
    """In the layers, too. Raises SceneError for an empty or a long name, or one that another kind has."""
    new = new.strip()
    if new == old:
        return
    if not 0 < len(new) <= LONGEST_NAME:
        raise SceneError(f"particles: a name must have 1 to {LONGEST_NAME} characters, not {len(new)}")
    write_toml({new: 1})
    if new in content["particles"]:
        raise SceneError(f"particles.{show_key(new)}: there is another kind of that name")

    def renamed(held: Any) -> Any:
        if isinstance(held, dict):
            return {new if name == old else name: value for name, value in held.items()}
        return new if held == old else held

    content["particles"] = renamed(content["particles"])
    for layer in content["layer"]:
        layer.update({key: renamed(layer[key]) for key in ("particles", "volume_fractions") if key in layer})


def name_of_substance(index: Any) -> str:
    """What a kind of this substance is called, "" where that says nothing.

    >>> name_of_substance("zinc oxide"), name_of_substance("main/Au/Johnson"), name_of_substance([1.5, 0.0])
    ('zinc oxide', 'Au', '')
    """
    if not isinstance(index, str) or index in MATERIALS:
        return index if isinstance(index, str) else ""
    parts = index.split("/")
    return parts[1] if len(parts) == 3 and all(parts) else ""


def get_substance(kind: Content) -> Any:
    """What particles of a kind consist of, of several substances the first.

    >>> get_substance({"index": "gold", "radius_um": 0.6})
    'gold'
    """
    keys = SOURCES[get_source(kind)].keys
    return next((kind.get(name) for name, key in keys.items() if isinstance(key, Substance)), None)


def name_after(content: Content, name: str, before: Any) -> None:
    """Calls a kind after its substance where it was called after the one ``before``, and not by hand."""
    index = get_substance(content["particles"][name])
    wanted, first = name_of_substance(index), name_of_substance(before)
    by_itself = NUMBERED.fullmatch(name) or (first and NUMBERED_AFTER.sub("", name) == first)
    if not wanted or not by_itself or index == before:
        return
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
    """How a kind's size is told, one of SIZE_MODES."""
    size = kind.get("size")
    if not isinstance(size, dict):
        return "diameter" if "diameter_um" in kind else "radius"
    name = next((one for one in SIZES if one in size), next(iter(SIZES)))
    by_diameter = any(place[-1] in DIAMETERS.values() for place in list_places(size.get(name), name))
    return f"{name}, diameters" if by_diameter else name


def list_size_places(mode: str) -> list[tuple[str, ...]]:
    """Where a kind of particle has its size, told in one of SIZE_MODES.

    >>> list_size_places("gamma, diameters"), list_size_places("radius")
    ([('size', 'gamma', 'd_eff_um'), ('size', 'gamma', 'v_eff')], [('radius_um',)])
    """
    name, _, diameters = mode.partition(", ")
    if name not in SIZES:
        return [(f"{name}_um",)]
    keys = SIZES[name].keys
    above = ("size",) if name in keys else ("size", name)
    return [(*above, DIAMETERS.get(key, key) if diameters else key) for key in keys]


def set_size_mode(kind: Content, mode: str) -> None:
    """Another way to tell the size; between radius and diameter it stays as it is."""
    before = get_size_mode(kind)
    if mode == before:
        return
    told = {key: kind.pop(key, None) for key in ("radius_um", "diameter_um", "size")}
    kind.update(copy.deepcopy(SIZE_MODES[mode][1]))
    size: Any = told.get(f"{before}_um")
    if mode in ("radius", "diameter") and is_number(size):
        kind[f"{mode}_um"] = size * (2.0 if mode == "diameter" else 0.5)
