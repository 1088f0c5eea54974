"""Every field of the form, declared once: what stands above and below it, what no check objects to in its place; and
the library's messages in these words."""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from vrte.basics.errors import Place
from vrte.formats.bases import BASES, INTERFACE
from vrte.formats.keys import SUBSTANCE_HINT, FilePath, Key
from vrte.formats.media import ONE_WAVELENGTH, TABLE
from vrte.formats.named import MEDIUM, SIDES
from vrte.formats.particle_sources import SOURCES, SPHERES
from vrte.formats.phases import PHASES
from vrte.formats.sizes import DIAMETER_LABELS, DIAMETERS, ONE, SIZES
from vrte.formats.toml_table import RANGE_KEYS

LONGEST_TEXT = 4000  # characters of a field
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?inf|nan")
WHOLE = re.compile(r"[+-]?\d{1,300}")


@dataclass(frozen=True)
class Field:
    """A field: its ``label``, a ``hint`` below it, or within it what is taken where it is ``empty``, and what is
    ``right`` whatever the others hold; None: nothing."""

    label: str = ""
    hint: str = ""
    right: Any = None
    empty: str = ""


SHARE = "5 % or 0.05"
FIELDS = {  # by place; * is any layer, any kind of particle
    "wavelength_um": Field("wavelengths in vacuum [µm]", "one, several with commas, or start:stop:count", right=0.5),
    "host_index": Field("refractive index of the host medium", SUBSTANCE_HINT, empty="1 if empty"),
    "particles.*": Field(right={"index": [3.1, 0.1], "radius_um": 0.1}),
    "particles.*.host_index": Field("refractive index around it", empty="that of the host"),
    "layer.*.host_index": Field("refractive index of its medium", SUBSTANCE_HINT, empty="that of the host"),
    "layer.*.interface.above": Field("index above", "a number or a substance"),
    "layer.*.interface.below": Field("index below", "that of what follows"),
    "layer.*": Field(right={"phase": "isotropic", "albedo": 0.5, "thickness": 1.0}),
    "layer.*.particles.*": Field("{}: number fraction", right=1.0),
    "layer.*.volume_fractions.*": Field("{}: of the volume", right=1e-3, empty=SHARE),
    "layer.*.phase": Field("table of coefficients", "columns l, a1, a2, a3, a4, b1, b2", right="isotropic"),
    "layer.*.tolerance": Field("tolerance", "how far below zero it may be", empty="0 if empty"),
    "layer.*.albedo": Field("single-scattering albedo", right=0.5),
    "layer.*.thickness": Field("optical thickness", "inf: without end", right=1.0),
    "layer.*.thickness_um": Field("thickness [µm]", right=1.0),
    "layer.*.volume_fraction": Field("volume fraction", SHARE, right=0.01),
    "base": Field(right={"kind": "black"}),
    "base.kind": Field(right="black"),
    "brdf": Field(right={"mu_i": 0.5, "mu_o": 0.5}),
    "brdf.mu_i": Field("cosines of incidence µ_i", right=0.5),
    "brdf.angle_i_deg": Field("angles of incidence [°]", right=60.0),
    "brdf.mu_o": Field("cosines of exit µ_o", right=0.5),
    "brdf.angle_o_deg": Field("angles of exit [°]", right=60.0),
    "brdf.phi_deg": Field("azimuths φ [°]", "0 forward, 180 back"),
    "field": Field(right={"mu0": 0.5}),
    "field.mu0": Field("cosine of the beam's incidence µ_0", right=0.5),
    "field.angle0_deg": Field("angle of the beam's incidence [°]", right=60.0),
    "field.tau": Field("optical depths τ", empty="five, evenly if empty"),
    "field.phi_deg": Field("azimuths φ [°]", "0 and 180: the plane of incidence"),
    "field.stokes": Field("Stokes vector of the beam", empty="1, 0, 0, 0 if empty"),
    "field.mu": Field("signed cosines µ", empty="the nodes if empty"),
    "accuracy": Field("accuracy", empty="1e-6 if empty"),
    "nodes": Field("nodes a hemisphere", empty="chosen"),
}


def find_field(place: Place, content: dict[str, Any]) -> Field:
    """What is declared of a place in a content: in FIELDS or in a registry; nothing of one that has no field.

    >>> find_field(("layer", 3, "particles", "gold"), {}).label
    '{}: number fraction'
    >>> find_field(("base", "albedo"), {"base": {"kind": "lambertian"}}).label
    'albedo of the base'
    """
    key = find_key(place, content) or Key()
    steps = [str(step) for step in place]
    if place[0] in ("layer", "particles"):
        steps[1:2] = "*" * len(steps[1:2])
    if place[2:3] in (("particles",), ("volume_fractions",)):
        steps[3:4] = "*" * len(steps[3:4])
    known = FIELDS.get(".".join(steps), Field())
    right = known.right if key.start is None else key.start
    return Field(key.label or known.label, key.hint or known.hint, right, key.empty or known.empty)


def find_key(place: Place, content: dict[str, Any]) -> Key | None:
    """The key of a registry at a place: of the base, of a layer's phase or interface, of particles or their size."""
    name = str(place[-1])
    if name in MEDIUM:
        return MEDIUM[name]
    if place[0] == "base":
        base = content.get("base")
        row = BASES.get(base.get("kind", "black")) if isinstance(base, dict) else None
        return row.keys.get(name) if row else None
    if place[0] == "layer":
        return find_layer_key(place, content)
    if place[0] == "particles" and len(place) == 3:
        kind = content.get("particles", {}).get(place[1])
        source = SOURCES.get(kind.get("source", SPHERES)) if isinstance(kind, dict) else None
        return {**ONE, **(source.keys if source else {})}.get(name)
    return find_size_key(place, content) if place[2:3] == ("size",) and place[3:] else None


def find_layer_key(place: Place, content: dict[str, Any]) -> Key | None:
    """The key of a phase or an interface at a place, or that of a table of coefficients."""
    name, layers = str(place[-1]), content.get("layer")
    if place[2:3] == ("interface",) and len(place) == 4:
        return {**SIDES, **INTERFACE}.get(name)
    if place[2:3] != ("phase",) or not isinstance(layers, list):
        return None
    phase: Any = layers[int(place[1])].get("phase")
    if isinstance(phase, dict) and len(place) == 4:
        return next((row.keys.get(name) for own, row in PHASES.items() if own in phase), None)
    return FilePath(suffixes=(TABLE,)) if isinstance(phase, str) and phase not in PHASES else None


def find_size_key(place: Place, content: dict[str, Any]) -> Key | None:
    """The key of a size distribution at a place; where it is told by diameters, with their label."""
    name = str(place[-1])
    radius = next((one for one, other in DIAMETERS.items() if other == name), name)
    size: Any = content.get("particles", {}).get(place[1], {}).get("size")
    row = next((row for own, row in SIZES.items() if isinstance(size, dict) and own in size), None)
    key = row.keys.get(radius) if row else None
    return replace(key, label=DIAMETER_LABELS.get(radius, key.label)) if key and radius != name else key


def list_places(table: Any, *place: str) -> Iterator[Place]:
    """The places of all that is in a table and in the tables below it.

    >>> list(list_places({"size": {"gamma": {"r_eff_um": 1.0, "v_eff": 0.1}}}))
    [('size', 'gamma', 'r_eff_um'), ('size', 'gamma', 'v_eff')]
    """
    if not isinstance(table, dict):
        yield place
        return
    for key, value in table.items():
        yield from list_places(value, *place, key)


def parse_field_text(text: str) -> Any:
    """What a field's text means: a number, numbers with commas, start:stop:count, otherwise itself; None if empty."""
    text = text.strip()
    parts = [part.strip() for part in re.split("[,:]", text)]
    if len(text) > LONGEST_TEXT or not all(NUMBER.fullmatch(part) for part in parts):
        return text or None
    numbers = [int(part) if WHOLE.fullmatch(part) else float(part) for part in parts]
    if ":" not in text:
        return numbers if len(numbers) > 1 else numbers[0]
    return dict(zip(RANGE_KEYS, numbers, strict=True)) if len(numbers) == 3 and "," not in text else text


def write_field_text(value: Any) -> str:
    """A field's text, which `parse_field_text` reads."""
    if value is None:
        return ""
    if isinstance(value, dict):
        return ":".join(write_field_text(value.get(key)) for key in RANGE_KEYS)
    if isinstance(value, list):
        return ", ".join(map(write_field_text, value))
    return repr(value).removesuffix(".0") if isinstance(value, float) else str(value)


KEY = r'(?:\.(?:[A-Za-z0-9_-]+|"(?:[^"\\]|\\.)*"))'
KEYS = re.compile(
    rf"(?<![\w.'\"\[])(?:layer\[\d+\]{KEY}*|(?:particles|base|brdf|field){KEY}+|wavelength_um\b{KEY}*|host_index\b)"
)
FIRST = re.compile(r"(?:nodes|accuracy)\b")  # words that are also said otherwise
STEP = re.compile(r'\[(\d+)\]|"((?:[^"\\]|\\.)*)"|[A-Za-z0-9_-]+')
HALF = re.compile(r"half of it, \w+ must")  # of a diameter: the argument is a radius
WAVELENGTHS = "wavelengths [µm]: one, several with commas, or start:stop:count"


def translate_message(message: str, content: dict[str, Any]) -> str:
    """A message with the form's words for the keys of a scene file.

    >>> content = {"particles": {"fool's gold": {"diameter_um": 0.2}}, "layer": [{"thickness": -1}]}
    >>> translate_message("layer[1].thickness = -1: must be above 0", content)
    'layer 1: optical thickness = -1: must be above 0'
    >>> translate_message('particles."fool\\'s gold".diameter_um: half of it', content)
    "fool's gold: diameter [µm]: half of it"
    """
    first = FIRST.match(message)
    if first:
        message = name_place((first[0],), content) + message[first.end() :]
    message = HALF.sub("half of it must", message.replace(ONE_WAVELENGTH, WAVELENGTHS))
    return KEYS.sub(lambda found: name_place(read_place(found[0]), content), message)


def read_place(key: str) -> Place:
    """The place that a dotted key names."""
    return tuple(
        int(step[1]) - 1 if step[1] else json.loads(step[0]) if step[2] is not None else step[0]
        for step in STEP.finditer(key)
    )


def name_place(place: Place, content: Any) -> str:
    """What the form calls a place: the card that it is on, and the field."""
    on = ""
    if len(place) > 1 and place[0] in ("layer", "particles"):
        on = f"layer {place[1] + 1}" if isinstance(place[1], int) else str(place[1])
    rest = place[2:] if on else place[1:]
    for end in range(len(place), 0, -1):  # the start of a range is on its field
        try:
            label = find_field(place[:end], content).label.format(place[end - 1])
        except (AttributeError, IndexError, KeyError, TypeError, ValueError):  # the content has changed since
            label = ""
        if label:
            return f"{on}: {label}" if on else label
    return ": ".join(filter(None, [on or str(place[0]), " ".join(str(one).replace("_", " ") for one in rest)]))
