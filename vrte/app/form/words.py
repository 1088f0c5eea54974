"""Messages of the library about keys of a scene file, in the words that stand above the fields of the form."""

import json
import re
from typing import Any

from vrte.app.form.content import Content
from vrte.app.form.fields import find_field
from vrte.basics.errors import Place
from vrte.formats.media import ONE_WAVELENGTH

KEY = r'(?:\.(?:[A-Za-z0-9_-]+|"(?:[^"\\]|\\.)*"))'
KEYS = re.compile(
    rf"(?<![\w.'\"\[])(?:layer\[\d+\]{KEY}*|(?:particles|base|brdf|field){KEY}+|wavelength_um\b{KEY}*|host_index\b)"
)
FIRST = re.compile(r"(?:nodes|accuracy)\b")  # words that are also said otherwise
STEP = re.compile(r'\[(\d+)\]|"((?:[^"\\]|\\.)*)"|[A-Za-z0-9_-]+')
HALF = re.compile(r"half of it, \w+ must")  # of a diameter: the argument is a radius
WAVELENGTHS = "wavelengths [µm]: one, several with commas, or start:stop:count"


def translate_message(message: str, content: Content) -> str:
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
    """The place that a dotted key names.

    >>> read_place('layer[2].particles."fool\\'s gold"')
    ('layer', 1, 'particles', "fool's gold")
    """
    return tuple(
        int(step[1]) - 1 if step[1] else json.loads(step[0]) if step[2] is not None else step[0]
        for step in STEP.finditer(key)
    )


def name_place(place: Place, content: Any) -> str:
    """What the form calls a place: the card that it is on, and the field.

    >>> name_place(("layer", 0, "volume_fractions", "gold"), {"layer": [{}]})
    'layer 1: gold: of the volume'
    """
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
