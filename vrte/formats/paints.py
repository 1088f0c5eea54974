"""Paints in the words of who makes them: a table [paint] of pigments, binder, dry film, surface and substrate.

Before anything else is read, ordinary particles, layers and a base are put in its place.
"""

import copy
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from vrte.basics.errors import Place, SceneError
from vrte.formats.bases import INTERFACE
from vrte.formats.materials import ReadyMaterial, expand_materials, list_materials, list_named, list_ready, name_kind
from vrte.formats.particle_sources import COATED, SIZE_KEYS, SPHERES
from vrte.formats.toml_table import Table, show_place, show_toml, suggest_nearest
from vrte.optics.crowding import COHERENT_POTENTIAL, INDEPENDENT
from vrte.optics.refractive_index import MATERIALS

KEYS = ("pigment", "volume_fraction", "binder", "thickness_um", "surface", "substrate", "packing", "particles")
SMOOTH, BARE = "smooth", "none"
REPLACED = ("particles", "layer", "base", "host_index")  # by what a paint is expanded to
# keys of a pigment's grains of which one is enough: whichever is given stands in place of the pigment's own
ALTERNATIVES = (SIZE_KEYS, tuple(key for key in COATED if key not in ("core", "shell")))
# the ready material whose grains a pigment has
PIGMENTS = {
    "rutile": "rutile in alkyd",
    "silica-coated rutile": "silica-coated rutile in alkyd",
    "alumina-coated rutile": "alumina-coated rutile in acrylic",
    "hollow polymer": "hollow polymer in acrylic",
    "hematite": "hematite in acrylic",
    "titanium black": "titanium black in acrylic",
    "chalk": "chalk",
    "alumina": "alumina powder",
    "gold": "gold powder",
}


@cache
def list_paints() -> dict[str, ReadyMaterial]:
    """The ready paints by name, in alphabetical order, such as list_paints()["white gloss"]: what each is, in which
    ways it is approximated, where its numbers come from, and its table [paint]."""
    return list_ready("paints", "paint")


def find_pigment(name: str) -> dict[str, Any] | None:
    """The table [particles.NAME] of a pigment, by its name or that of its substance; None for what is no pigment."""
    for pigment, material in PIGMENTS.items():
        (grains,) = list_materials()[material].particles.values()
        if name in (pigment, grains.get("index")):
            return copy.deepcopy(grains)
    return None


def expand_content(content: Mapping[str, Any], folder: Path = Path()) -> dict[str, Any]:
    """The content of a scene file with particles, layers and base in place of a paint and of ready materials; one's own
    materials lie in ``folder``. Raises SceneError."""
    return expand_materials(expand_paint(content), folder)


def expand_paint(content: Mapping[str, Any]) -> dict[str, Any]:
    """The content of a scene file with ordinary particles, layers and a base in place of its table [paint]. What the
    paint says is passed on as it is, to be checked there. Raises SceneError.

    Grains are packed by the coherent potential, which goes over into independent scattering where they are few, so
    that nothing jumps as a volume fraction is changed; grains that are no spheres scatter independently.
    """
    if "paint" not in content:
        return dict(content)
    for key in REPLACED:
        if key in content:
            raise SceneError(f"paint: a file with a table [paint] has no {key} of its own: the paint makes it", "paint")
    paint = Table((), dict(content), tuple(content)).table("paint", KEYS)
    fractions = _read_pigments(paint)
    binder = paint.required("binder", 'a substance such as "alkyd", or [n, k]')
    thickness = paint.required("thickness_um", "the thickness of the dry film in micrometres, or inf")
    own = paint.content.get("particles", {})
    if not isinstance(own, dict) or not all(isinstance(grains, dict) for grains in own.values()):
        raise paint.wrong("particles", "must be tables headed [paint.particles.NAME]")
    for name in {*own} - {*fractions}:
        raise Table(("paint", "particles"), own, tuple(own)).wrong(name, "is none of the pigments of this paint")
    kinds = {name: _make_grains(paint, name, own.get(name)) for name in fractions}
    spheres = all(kind.get("source", SPHERES) in (SPHERES, "coated-spheres") for kind in kinds.values())
    packing = paint.content.get("packing", COHERENT_POTENTIAL if spheres else INDEPENDENT)
    layers = [{"host_index": binder, "volume_fractions": fractions, "thickness_um": thickness, "packing": packing}]
    surface = paint.content.get("surface", SMOOTH)
    if isinstance(surface, dict):
        paint.table("surface", tuple(INTERFACE))
    elif surface not in (SMOOTH, BARE):
        raise paint.wrong("surface", f'must be "{SMOOTH}", "{BARE}" or a table with {", ".join(INTERFACE)}')
    if surface != BARE:
        facets = surface if isinstance(surface, dict) else {}
        layers.insert(0, {"interface": {"above": 1.0, "below": binder, **facets}})
    found = {key: value for key, value in content.items() if key != "paint"} | {"particles": kinds, "layer": layers}
    return copy.deepcopy(found | ({"base": paint.content["substrate"]} if "substrate" in paint else {}))


def _read_pigments(paint: Table) -> dict[str, Any]:
    """The volume fraction of each pigment, as it is given."""
    given = paint.required("pigment", "a name, or a table { name = volume fraction, ... }")
    if isinstance(given, dict) and given:
        if "volume_fraction" in paint:
            raise paint.wrong("volume_fraction", "goes with one pigment by its name; a table has its own")
        return given
    if not isinstance(given, str):
        raise paint.wrong("pigment", "must be a name, or a table { name = volume fraction, ... }")
    return {given: paint.required("volume_fraction", 'from 0 to below 1, or per cent in quotes, "15 %"')}


def _make_grains(paint: Table, name: str, own: dict[str, Any] | None) -> dict[str, Any]:
    """The table [particles.NAME] of a pigment: the known one's, what the paint gives in place of that; or its own."""
    known = find_pigment(name)
    if own is not None and (known is None or "source" in own):
        return own if {"source", "index"} & {*own} else {"index": name, **own}
    if known is None:
        hint = suggest_nearest(name, [*PIGMENTS, *MATERIALS])
        words = f"no pigment {name!r}{hint or '.'} Known: {', '.join(PIGMENTS)}; any other substance needs its size, as"
        raise paint.wrong("pigment", f'{words} particles."{name}" = {{ diameter_um = 0.3 }}')
    replaced = {key for keys in ALTERNATIVES if own and {*keys} & {*own} for key in keys}
    return {key: value for key, value in known.items() if key not in replaced} | (own or {})


def list_places(content: Mapping[str, Any]) -> list[tuple[Place, Place]]:
    """Where what a paint says stands once it is expanded: places in [paint], with those in particles, layers, base."""
    paint = content.get("paint")
    if not isinstance(paint, dict):
        return []
    film = 0 if paint.get("surface") == BARE else 1
    fractions: Place = ("layer", film, "volume_fractions")
    found: list[tuple[str, Place]] = [
        ("volume_fraction", (*fractions, str(paint.get("pigment")))),
        ("pigment", fractions),
        ("particles", ("particles",)),
        ("binder", ("layer", film, "host_index")),
        ("binder", ("layer", 0, "interface", "below")),
        ("thickness_um", ("layer", film, "thickness_um")),
        ("packing", ("layer", film, "packing")),
        ("substrate", ("base",)),
        ("surface", ("layer", 0, "interface")),
    ]
    return [(("paint", ours), theirs) for ours, theirs in found]


def find_expanded_place(content: Mapping[str, Any], place: Place) -> Place:
    """Where a number of a paint stands once it is expanded, or the same place where it is none of a paint. Raises
    SceneError for facets of a paint that has none."""
    for ours, theirs in list_places(content):
        if place[: len(ours)] == ours:
            if ours[-1] == "surface" and not isinstance(content["paint"].get("surface"), dict):
                words = "changes facets, and the paint has none: give it a surface = { roughness = 0.1 } to begin with"
                raise SceneError(f"{show_place(place)} {words}", *place)
            return (*theirs, *place[len(ours) :])
    return place


@contextmanager
def locate_expanded_errors(content: Mapping[str, Any]) -> Iterator[None]:
    """Complaints about particles, layers or base of a paint or a material, as ones about what the file says of it."""
    try:
        yield
    except SceneError as error:
        place, words = error.place, str(error)
        for ours, theirs in list_places(content):
            if place[: len(theirs)] == theirs:
                there, here = show_place(theirs), show_place(ours)
                words = here + words.removeprefix(there) if words.startswith(there) else f"{here}: {words}"
                raise SceneError(words, *ours, *place[len(theirs) :]) from error
        for number, layer in list_named(content) if place[:1] == ("particles",) and len(place) > 1 else ():
            if str(place[1]).startswith(name_kind(layer["material"], "")):
                here = f"layer[{number + 1}].material = {show_toml(layer['material'])}"
                raise SceneError(f"{here}: {words}", "layer", number, "material") from error
        raise
