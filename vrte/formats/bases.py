"""Bases by the ``kind`` of a table [base]. A new one is a class and a row (docs/extending.md)."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from vrte.formats.keys import SUBSTANCE_HINT, Choice, Flag, Index, Key, Number, Reading, Share, read_keys
from vrte.formats.toml_table import Table, locate_errors
from vrte.scene.boundary import Boundary, Lambertian
from vrte.scene.facets import Facets
from vrte.scene.interface import ROUGHNESS_ALLOWED
from vrte.scene.mirror import Mirror

ALBEDO = 'a number between 0 and 1, or per cent in quotes, "30 %"'
ROUGHNESS = 0.1  # that a rough surface begins with
SLOPES = {"beckmann": "Gaussian (Beckmann)", "ggx": "with long tails (GGX)"}
FACETS: dict[str, Key] = {  # how rough a surface is, of a base or an interface
    "roughness": Number("roughness", ROUGHNESS, hint="slopes' rms times √2, 0.01 to 1.5", allowed=ROUGHNESS_ALLOWED),
    "distribution": Choice("slopes of facets", names=SLOPES, needed=False),
    "shadowing": Flag("facets hide each other (Smith)", needed=False),
    "conserving": Flag("light lost between facets is given back", needed=False),
}
SUBSTANCE = Index("substance", [1.5, 0.0], hint=SUBSTANCE_HINT)


class BaseRow(NamedTuple):
    """``words`` of a form; what makes the base, called with the values of its keys by their names."""

    words: str
    make: Callable[..., Boundary | None]
    keys: dict[str, Key]


BASES: dict[str, BaseRow] = {
    "black": BaseRow("black", lambda: None, {}),
    "lambertian": BaseRow(
        "white or grey (Lambertian)", Lambertian, {"albedo": Share("albedo of the base", 0.5, allowed=ALBEDO)}
    ),
    "mirror": BaseRow("smooth metal or glass (a mirror)", Mirror, {"index": SUBSTANCE}),
    "facets": BaseRow("rough metal or glass (facets)", Facets, {"index": SUBSTANCE, **FACETS}),
}


def read_base(table: Table, reading: Reading) -> Boundary | None:
    """The base of a table [base]; None where it is black. Raises SceneError."""
    row = BASES[table.choice("kind", tuple(BASES))]
    for key in table.content:
        if key != "kind" and key not in row.keys:
            owners = [f'"{owner}"' for owner, other in BASES.items() if key in other.keys]
            raise table.wrong(key, f"goes with kind = {' or '.join(owners)} only")
    values = read_keys(row.keys, table, reading)
    with locate_errors(table.place, table.allowed):
        return row.make(**values)


def list_base_keys() -> tuple[str, ...]:
    """The keys of all kinds of bases, and ``kind``.

    >>> list_base_keys()[:2]
    ('kind', 'albedo')
    """
    return ("kind", *dict.fromkeys(key for row in BASES.values() for key in row.keys))


INTERFACE: dict[str, Key] = {**FACETS, "roughness": replace(FACETS["roughness"], needed=False)}
