"""Layers of the form: added, moved and removed, what fills each, how thick it is, and the interfaces between them."""

import copy
import math
from typing import Any

from vrte.app.form.content import Content, is_interface
from vrte.app.form.kinds import add_kind
from vrte.basics.errors import SceneError
from vrte.formats.bases import FACETS, ROUGHNESS
from vrte.formats.layers import FILLINGS, THICKNESS_KEYS
from vrte.formats.phases import PHASES
from vrte.optics.crowding import INDEPENDENT

MOST_LAYERS = 30  # that a page shows
MEDIA: dict[str, tuple[str, Any]] = {  # what fills a layer: in words, and the phase function that it begins with
    "particles": ("particles of one kind", None),
    "mixture": ("a mixture, by number", None),
    "volumes": ("a mixture, by volume", None),
    **{name: (row.words, row.start or name) for name, row in PHASES.items()},
    "coefficients": ("a table of coefficients", ""),
    "clear": ("nothing: clear or tinted", None),
}
HELD = ("particles", "mixture", "volumes")  # particles, in these ways
SURFACES = {"smooth": "smooth: beams stay beams", "rough": "rough: many small facets"}
LENGTH, FRACTION, OPTICAL = 50.0, 0.05, 10.0  # that a layer begins with: um, of the volume, optical thickness


def add_layer(content: Content) -> None:
    """One more at the bottom, like the last, with an end. Raises SceneError where there are as many as a page shows."""
    layers = make_room(content)
    filled = [layer for layer in layers if not is_interface(layer)]
    layers.append(copy.deepcopy(filled[-1] if filled else {"phase": "isotropic", "albedo": 0.99, "thickness": 10.0}))


def check_room(content: Content) -> None:
    """Raises SceneError where there are as many layers as a page shows."""
    if len(content["layer"]) >= MOST_LAYERS:
        raise SceneError(f"layer: the page shows at most {MOST_LAYERS} layers; `vrte brdf` takes more")


def make_room(content: Content) -> list[Content]:
    """The layers, where one more may stand below them. Raises SceneError as `check_room` does."""
    check_room(content)
    layers: list[Content] = content["layer"]
    if layers[-1].get("thickness") == math.inf:
        layers[-1]["thickness"] = 1.0
    return layers


def add_interface(content: Content) -> None:
    """Air above the pile, or below it where its top is an interface. Raises SceneError as `add_layer` does."""
    index: Any = content.get("host_index")
    if index is None:
        index = 1.5
        if content.get("particles"):
            content["host_index"] = index  # that of the binder between its surface and the next
    if not is_interface(content["layer"][0]):
        check_room(content)
        content["layer"].insert(0, {"interface": {"above": 1.0, "below": index}})
        return
    layers = make_room(content)
    last = next(layer["interface"] for layer in reversed(layers) if is_interface(layer))
    above = last.get("below", index)
    layers.append({"interface": {"above": above, "below": index if above == 1.0 else 1.0}})


def is_rough(table: Content) -> bool:
    """Whether an interface or a base consists of facets.

    >>> is_rough({"above": 1.0, "below": 1.5, "roughness": 0.1})
    True
    """
    return table.get("roughness", 0) != 0


def set_rough(table: Content, rough: bool) -> None:
    """Facets, or a smooth surface, which has no distribution of slopes."""
    if rough:
        table.setdefault("roughness", ROUGHNESS)
        return
    for key in FACETS:
        table.pop(key, None)


def remove_layer(content: Content, place: int) -> None:
    """All but the last one that is left."""
    if len(content["layer"]) > 1:
        del content["layer"][place]


def move_layer(content: Content, place: int, by: int) -> None:
    """Up (-1) or down (1), as far as there is room."""
    layers, target = content["layer"], place + by
    if 0 <= target < len(layers):
        layers[place], layers[target] = layers[target], layers[place]


def get_medium(layer: Content) -> str:
    """What fills a layer, one of MEDIA.

    >>> get_medium({"phase": {"henyey_greenstein": 0.9}}), get_medium({"particles": {"gold": 1}})
    ('henyey_greenstein', 'mixture')
    """
    phase = layer.get("phase")
    if isinstance(phase, dict):
        return next((name for name in PHASES if name in phase), "isotropic")
    if phase is not None:
        return phase if phase in PHASES else "coefficients"
    if not any(key in layer for key in FILLINGS):
        return "clear"
    several = "mixture" if isinstance(layer.get("particles"), dict) else "particles"
    return "volumes" if "volume_fractions" in layer else several


def set_medium(content: Content, place: int, medium: str) -> None:
    """Fills a layer with something else; its thickness stays where it can."""
    layer = content["layer"][place]
    if medium == get_medium(layer):
        return
    geometric, phase = is_geometric(layer), MEDIA[medium][1]
    if get_medium(layer) == "clear":
        layer.pop("host_index", None)  # which it consisted of
    for key in (*FILLINGS, "tolerance"):
        layer.pop(key, None)
    if medium not in HELD:
        layer.pop("packing", None)
        set_geometric(layer, medium == "clear")
    if phase is not None:
        layer["phase"] = copy.deepcopy(phase)
        layer.setdefault("albedo", 0.99)
        return
    layer.pop("albedo", None)
    if medium == "clear":
        layer.pop("volume_fraction", None)
        layer.setdefault("host_index", find_index_above(content, place))
        return
    kinds = list(content.get("particles", {})) or [add_kind(content)]
    if medium == "volumes":
        layer["volume_fractions"] = dict.fromkeys(kinds[:2], FRACTION)
        layer.pop("volume_fraction", None)
    else:
        layer["particles"] = kinds[0] if medium == "particles" else dict.fromkeys(kinds[:2], 1.0)
        if geometric or is_fraction_needed(layer):
            layer.setdefault("volume_fraction", FRACTION)


def find_index_above(content: Content, place: int) -> Any:
    """The refractive index of the medium in which a layer lies: below the last interface above it, or the file's."""
    above = [layer["interface"].get("below") for layer in content["layer"][:place] if is_interface(layer)]
    return copy.deepcopy((above or [content.get("host_index", 1.0)])[-1])


def is_geometric(layer: Content) -> bool:
    """Whether a layer's thickness is given in micrometres."""
    return "thickness_um" in layer or ("volume_fraction" in layer and "thickness" not in layer)


def set_geometric(layer: Content, geometric: bool) -> None:
    """Thickness in micrometres with a volume fraction, or optical."""
    if geometric == is_geometric(layer):
        return
    for key in THICKNESS_KEYS:
        layer.pop(key, None)
    layer.update({"thickness_um": LENGTH} if geometric else {"thickness": OPTICAL})
    if "volume_fractions" not in layer and (geometric or is_fraction_needed(layer)):
        layer["volume_fraction"] = FRACTION


def is_fraction_needed(layer: Content) -> bool:
    """Whether particles of a layer of a given optical thickness scatter otherwise where they are closer.

    >>> is_fraction_needed({"particles": "gold", "thickness": 1.0})
    False
    """
    return layer.get("packing", INDEPENDENT) != INDEPENDENT


def is_fraction_asked(content: Content, place: int) -> bool:
    """The same, or they lie in a medium that may absorb; which it is said to be at its volume fraction's field."""
    layer, kinds = content["layer"][place], content.get("particles", {})
    held = layer.get("particles", ())
    around = [kinds.get(name, {}) for name in ((held,) if isinstance(held, str) else held)]
    media = [one.get("host_index", 1.0) for one in (content, layer, *around)]
    clear = all(isinstance(one, (int, float)) for one in media)
    return is_fraction_needed(layer) or "volume_fraction" in layer or not clear


def has_medium(content: Content, place: int) -> bool:
    """Whether there is something to say of the medium of a layer."""
    layer = content["layer"][place]
    return "host_index" in layer or get_medium(layer) == "clear" or any(map(is_interface, content["layer"]))


def set_packing(layer: Content, packing: str) -> None:
    """How particles that are close to each other are reckoned with; what needs their volume fraction gets one."""
    if packing == INDEPENDENT:
        layer.pop("packing", None)
        if not is_geometric(layer):
            layer.pop("volume_fraction", None)
        return
    layer["packing"] = packing
    if "volume_fractions" not in layer:
        layer.setdefault("volume_fraction", FRACTION)
