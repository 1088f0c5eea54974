"""The reference of scene files has a row for every key that they know, and none for another."""

import re
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path

from vrte.fit.files import KEYS as FIT_KEYS
from vrte.fit.problem import KEYS as FREE_KEYS
from vrte.formats import materials
from vrte.formats.bases import BASES, INTERFACE
from vrte.formats.flakes import FLAKES, TILTS
from vrte.formats.keys import Key, list_names
from vrte.formats.layers import INTERFACE_KEYS, LAYER_KEYS, PHASES
from vrte.formats.particle_sources import SIZE_KEYS, SIZES, SOURCES
from vrte.formats.scene_file import FILE_KEYS, REQUEST_KEYS
from vrte.formats.toml_table import RANGE_KEYS
from vrte.render.rendering import OWN, PictureSetting
from vrte.sweep.results import KEYS as APPEARANCE_KEYS
from vrte.sweep.template import AXIS_KEYS

PAGE = (Path(__file__).parents[1] / "docs" / "reference" / "scene_files.md").read_text(encoding="utf-8")
HEADINGS = re.compile(r"^##+ ([^\n]+)\n(.*?)(?=^##|\Z)", re.M | re.S)
SETTING = {field.name: field.default for field in fields(PictureSetting)}


def read_rows(section: str) -> dict[str, list[str]]:
    """The cells of each key's row in a section."""
    lines = [line for line in section.splitlines() if line.startswith("| `")]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return {row[0].strip("`"): row[1:] for row in cells}


ROWS = {heading.replace("`", ""): read_rows(section) for heading, section in HEADINGS.findall(PAGE)}
REGISTRIES = {'source = "{}"': SOURCES, "phase = {{ {} = ... }}": PHASES, 'kind = "{}"': BASES, "size.{}": SIZES}
KEYS: dict[str, Mapping[str, Key]] = {  # sections of which the registries know more than the names of keys
    **{
        form.format(name): row.keys
        for form, registry in REGISTRIES.items()
        for name, row in registry.items()
        if row.keys and not (registry is SIZES and name in row.keys)
    },
    "paint.surface": INTERFACE,
}
KNOWN: dict[str, tuple[str, ...]] = {
    **{heading: list_names(keys) for heading, keys in KEYS.items()},
    "The file": (*FILE_KEYS, "appearance", "axes"),
    "[particles.NAME]": ("source", *SIZE_KEYS, "host_index"),
    "size": tuple(SIZES),
    "[[layer]]": LAYER_KEYS,
    "phase": (),
    "layer.flakes": tuple(FLAKES),
    "flakes.tilts": tuple(TILTS),
    "layer.interface": INTERFACE_KEYS,
    "[base]": ("kind",),
    "[brdf]": REQUEST_KEYS["brdf"],
    "[field]": REQUEST_KEYS["field"],
    "[render]": (*OWN, *SETTING),
    "[paint]": materials.PAINT_KEYS,
    "[fit]": FIT_KEYS,
    "[fit.free.NAME]": FREE_KEYS,
    "[appearance]": APPEARANCE_KEYS,
    "[axes.NAME]": AXIS_KEYS,
    "A range": RANGE_KEYS,
    "A material's file": materials.MATERIAL_KEYS,
}


def test_every_key_has_a_row_and_every_row_a_key() -> None:
    assert {heading: {*rows} for heading, rows in ROWS.items()} == {name: {*keys} for name, keys in KNOWN.items()}
    for cells in (cells for rows in ROWS.values() for cells in rows.values()):
        assert len(cells) == 4  # meaning, unit, default, allowed
        assert all((cells[0], cells[2], cells[3])), cells
