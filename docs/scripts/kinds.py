"""The page docs/reference/kinds.md, of all that a scene file knows by name, printed from the registries."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from bench.study import make_markdown_table
from vrte.appearance.quantities import QUANTITIES
from vrte.formats.bases import BASES
from vrte.formats.flakes import FLAKES
from vrte.formats.keys import Choice, FilePath, Key
from vrte.formats.layers import PHASES
from vrte.formats.materials import PIGMENTS
from vrte.formats.particle_sources import DIAMETERS, SIZES, SOURCES
from vrte.formats.toml_table import write_value
from vrte.optics.crowding import PACKINGS
from vrte.optics.flakes import MAKE_UPS

INTRODUCTION = """# What a scene file knows by name

All kinds of particles, sizes, phase functions, bases, pigments and readings, for whoever writes a scene file and looks
for a name. Every key with its unit and default is on [the page of scene files](scene_files.md).

Made from the registries that scene files, sweeps and the viewer's form read, by `python -m docs.scripts.kinds`.
Keys in brackets may be left out. How to add a row: [extending.md](../how_to/extending.md).
"""
WRITTEN: dict[str, Callable[[str], str]] = {  # a registry's heading, and how its row is written in a scene file
    "Particles": '`[particles.NAME]`, `source = "{}"`'.format,
    "Sizes of particles": "`size = {{ {} = {{ ... }} }}`, or radius_um, or diameter_um".format,
    "Phase functions and matrices": "`phase` of a `[[layer]]`".format,
    "Bases": '`[base]`, `kind = "{}"`'.format,
}


def describe_key(name: str, key: Key) -> str:
    """A key with what it is, and what may stand there.

    >>> from vrte.formats.keys import Number
    >>> describe_key("sigma", Number("sigma of radii", 1.4))
    '`sigma` (sigma of radii; 1.4, say)'
    """
    said = [key.label] if key.label and key.label != name else []
    said += [key.hint] if key.hint else []
    if isinstance(key, Choice):
        said.append(" or ".join(f'"{one}"' for one in key.names))
    elif isinstance(key, FilePath):
        said.append(" or ".join(key.suffixes))
    elif key.start is not None:
        said.append(f"{write_value(key.start)}, say")
    said += [key.empty] if key.empty else []
    text = f"`{name}`" + (f" ({'; '.join(said)})" if said else "")
    return text if key.needed else f"[{text}]"


def list_rows(registry: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Name, words and keys of every row."""
    for name, row in registry.items():
        keys = [describe_key(key, one) for key, one in row.keys.items()]
        keys += [
            f"`{DIAMETERS[key]}` in place of `{key}`" for key in row.keys if registry is SIZES and key in DIAMETERS
        ]
        keys += ["a size", "[`host_index`]"] if getattr(row, "sized", False) else []
        yield f"`{name}`", row.words, ", ".join(keys)


def write_page() -> str:
    """The page of all names that scene files know, in Markdown."""
    registries: dict[str, Mapping[str, Any]] = {
        "Particles": SOURCES,
        "Sizes of particles": SIZES,
        "Phase functions and matrices": PHASES,
        "Bases": BASES,
    }
    parts = [INTRODUCTION]
    for heading, registry in registries.items():
        table = make_markdown_table(("name", "what", "keys"), list_rows(registry))
        parts.append(f"## {heading}\n\n{WRITTEN[heading]('NAME' if heading != 'Bases' else 'name')}\n\n{table}")
    made_up = make_markdown_table(("name", "what"), [(f"`{name}`", row["reason"]) for name, row in MAKE_UPS.items()])
    keys, there = (
        ", ".join(describe_key(*each) for each in FLAKES.items()),
        "[scene_files.md](scene_files.md#layerflakes)",
    )
    flakes = f"`flakes = {{ ... }}` of a `[[layer]]` or of [paint] ({there}): {keys}."
    parts.append(f"## Flakes\n\n{flakes}\n\nNames of `index` beside substances:\n\n{made_up}")
    packings = make_markdown_table(("name", "what"), [(f"`{name}`", one.words) for name, one in PACKINGS.items()])
    parts.append(
        f"## Packing\n\n`packing` of a `[[layer]]` of particles ([particles.md](../how_to/particles.md))\n\n{packings}"
    )
    pigments = make_markdown_table(("name", "grains of"), [(f"`{name}`", whose) for name, whose in PIGMENTS.items()])
    parts.append(f"## Pigments\n\n`pigment` of [paint] ([materials.md](../how_to/materials.md#paints))\n\n{pigments}")
    rows = [
        (f"`{name}`", one.long_name, one.units, ", ".join(f"`{used}`" for used in one.uses))
        for name, one in QUANTITIES.items()
    ]
    quantities = make_markdown_table(("name", "what", "unit", "depends on"), rows)
    there = "[sweeps.md](../how_to/sweeps.md#colour-and-hiding-power)"
    parts.append(f"## Quantities of appearance\n\n`quantities` of [appearance] ({there})\n\n{quantities}")
    return "\n".join(parts)


if __name__ == "__main__":
    print(write_page(), end="")
