"""Every field of the form, declared once: what stands above and below it, what no check objects to in its place; and
the library's messages in these words."""

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from vrte.basics.errors import Place
from vrte.formats.bases import BASES, INTERFACE
from vrte.formats.flakes import FLAKES
from vrte.formats.keys import ONE_WAVELENGTH, SUBSTANCE_HINT, TABLE, FilePath, Key, Numbers, Substance
from vrte.formats.layers import PHASES, SIDES
from vrte.formats.particle_sources import DIAMETER_LABELS, DIAMETERS, HOST, ONE, SIZES, SOURCES, SPHERES
from vrte.formats.toml_table import RANGE_KEYS

LONGEST_TEXT = 4000  # characters of a field
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?inf|nan")
TYPED = re.compile(r"([+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?)\s*(%|nm|[uµ]m)?")  # with a point or a comma
WHOLE = re.compile(r"[+-]?\d{1,300}")
SHARE = "5 % or 0.05"
FIELDS = {  # by place, * being any layer or kind of particle: label, and what no check objects to in its place
    "wavelength_um": Key("wavelengths in vacuum [µm]", hint="one, several with commas, or start:stop:count", start=0.5),
    "host_index": Key("refractive index of the host medium", hint=SUBSTANCE_HINT, empty="1 if empty"),
    "particles.*": Key(start={"index": [3.1, 0.1], "radius_um": 0.1}),
    "particles.*.host_index": Key("refractive index around it", empty="that of the host"),
    "layer.*.host_index": Key("refractive index of its medium", hint=SUBSTANCE_HINT, empty="that of the host"),
    "layer.*.interface.above": Key("index above", hint="a number or a substance"),
    "layer.*.interface.below": Key("index below", hint="that of what follows"),
    "layer.*": Key(start={"phase": "isotropic", "albedo": 0.5, "thickness": 1.0}),
    "layer.*.particles.*": Key("{}: number fraction", start=1.0),
    "layer.*.volume_fractions.*": Key("{}: of the volume", start=1e-3, empty=SHARE),
    "layer.*.phase": Key("table of coefficients", hint="columns l, a1, a2, a3, a4, b1, b2", start="isotropic"),
    "layer.*.tolerance": Key("tolerance", hint="how far below zero it may be", empty="0 if empty"),
    "layer.*.albedo": Key("single-scattering albedo", start=0.5),
    "layer.*.thickness": Key("optical thickness", hint="inf: semi-infinite", start=1.0),
    "layer.*.thickness_um": Key("thickness [µm]", start=1.0),
    "layer.*.volume_fraction": Key("volume fraction", hint=SHARE, start=0.01),
    "layer.*.flake_area": Key("flake area over the layer's", hint="inf: semi-infinite, alone", start=1.0),
    "layer.*.flake_thickness_um": Key("thickness of the flakes [µm]", start=0.3),
    "base": Key(start={"kind": "black"}),
    "base.kind": Key(start="black"),
    "brdf": Key(start={"mu_i": 0.5, "mu_o": 0.5}),
    "brdf.mu_i": Key("cosines of incidence µ_i", start=0.5),
    "brdf.angle_i_deg": Key("angles of incidence [°]", start=60.0),
    "brdf.mu_o": Key("cosines of exit µ_o", start=0.5),
    "brdf.angle_o_deg": Key("angles of exit [°]", start=60.0),
    "brdf.phi_deg": Key("azimuths φ [°]", hint="0 forward, 180 back"),
    "field": Key(start={"mu0": 0.5}),
    "field.mu0": Key("cosine of the beam's incidence µ_0", start=0.5),
    "field.angle0_deg": Key("angle of the beam's incidence [°]", start=60.0),
    "field.tau": Key("optical depths τ", empty="five, evenly if empty"),
    "field.phi_deg": Key("azimuths φ [°]", hint="0 and 180: the plane of incidence"),
    "field.stokes": Key("Stokes vector of the beam", empty="1, 0, 0, 0 if empty"),
    "field.mu": Key("signed cosines µ", empty="the nodes if empty"),
    "accuracy": Key("accuracy", empty="1e-6 if empty"),
    "nodes": Key("nodes a hemisphere", empty="chosen"),
}


def find_field(place: Place, content: dict[str, Any]) -> Key:
    """The key of a registry at a place of a content, with what FIELDS adds; without a label there is no field."""
    steps = [str(step) for step in place]
    if place[0] in ("layer", "particles"):
        steps[1:2] = "*" * len(steps[1:2])
    if place[2:3] in (("particles",), ("volume_fractions",)):
        steps[3:4] = "*" * len(steps[3:4])
    known = FIELDS.get(".".join(steps), Key())
    key = find_key(place, content)
    if key is None:
        return known
    words = {name: getattr(key, name) or getattr(known, name) for name in ("label", "hint", "empty")}
    return replace(key, start=known.start if key.start is None else key.start, **words)


def find_key(place: Place, content: dict[str, Any]) -> Key | None:
    """The key of a registry at a place: of a medium, base, phase, interface, particles or their size."""
    name, around = str(place[-1]), get_value(content, place[:-1])
    table: dict[str, Any] = around if isinstance(around, dict) else {}
    if name in HOST:
        return HOST[name]
    if place[0] == "base":
        kind = table.get("kind", "black")
        return BASES[kind].keys.get(name) if table and kind in BASES else None
    if place[0] == "layer":
        if place[2:-1] == ("interface",):
            return {**SIDES, **INTERFACE}.get(name)
        if place[2:-1] == ("flakes",):
            return FLAKES.get(name)
        if place[2:-1] == ("phase",):
            return next((row.keys.get(name) for own, row in PHASES.items() if own in table), None)
        named = table.get("phase") if name == "phase" else None
        return FilePath(suffixes=(TABLE,)) if isinstance(named, str) and named not in PHASES else None
    if place[0] != "particles" or len(place) < 3:
        return None
    if len(place) == 3:
        source = SOURCES.get(table.get("source", SPHERES))
        return {**ONE, **(source.keys if source else {})}.get(name)
    size: Any = get_value(content, (*place[:2], "size"))
    row = next((row for own, row in SIZES.items() if isinstance(size, dict) and own in size), None)
    radius = next((one for one, other in DIAMETERS.items() if other == name), name)
    key = row.keys.get(radius) if row and place[2] == "size" else None
    return replace(key, label=DIAMETER_LABELS.get(radius, key.label)) if key and radius != name else key


def get_value(content: dict[str, Any], place: Place) -> Any:
    """What is there, or None."""
    found: Any = content
    for step in place:
        try:
            found = found[step]
        except (KeyError, IndexError, TypeError):
            return None
    return found


def list_places(table: Any, *place: str) -> Iterator[Place]:
    """The places of all that is in a table and in the tables below it."""
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


def parse_typed_text(text: str, place: Place, content: dict[str, Any]) -> Any:
    """What is typed in a field; where that takes one number, also with a decimal comma, per cent, nm or µm."""
    key, found = find_field(place, content), TYPED.fullmatch(text.strip())
    if place[0] not in ("layer", "particles", "base") or isinstance(key, (Substance, Numbers)):
        return parse_field_text(text)
    if found is None:  # a size that is emptied stays where it is missing
        return parse_field_text(text) or ("" if place[0] == "particles" and key.needed else None)
    number, unit = found[1].replace(",", "."), found[2]
    value = parse_field_text(number)
    if unit == "%":
        return f"{number} %"
    if unit and "[µm]" not in key.label:
        return text.strip()
    return float(f"{value / 1e3:.6g}") if unit == "nm" else value


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
FIRST = re.compile(r"(?:nodes|accuracy)\b")  # words that also have another meaning
STEP = re.compile(r'\[(\d+)\]|"((?:[^"\\]|\\.)*)"|[A-Za-z0-9_-]+')
HALF = re.compile(r"half of it, \w+ must")  # of a diameter: the argument is a radius
GIVEN = re.compile(r' = (\{[^{}]*\}|\[[^\[\]]*\]|"(?:[^"\\]|\\.)*"|[-+\w.]+): must ([^;]*)$')  # of the file's syntax
EMPTY = '""', "{}"
WORDS = {
    'per cent in quotes, "5 %"': "per cent, 5 %",
    "either thickness (optical) or thickness_um is needed": "a thickness is needed",
    "a table { name = fraction, ... }": "a fraction of each kind of particle",
}
WAVELENGTHS = "wavelengths [µm]: one, several with commas, or start:stop:count"


def translate_message(message: str, content: dict[str, Any]) -> str:
    """A message with the form's words for the keys of a scene file."""
    first = FIRST.match(message)
    if first:
        message = name_place((first[0],), content) + message[first.end() :]
    message = HALF.sub("half of it must", message.replace(ONE_WAVELENGTH, WAVELENGTHS))
    message = KEYS.sub(lambda found: name_place(read_place(found[0]), content), message)
    message = GIVEN.sub(lambda found: f" must {found[2]}{'' if found[1] in EMPTY else f', not {found[1]}'}", message)
    for words, ours in WORDS.items():
        message = message.replace(words, ours)
    return message


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
