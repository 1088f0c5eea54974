"""Bases by the ``kind`` of a table [base]. A new one is a class and a row (docs/how_to/extending.md)."""

import inspect
from dataclasses import replace
from functools import partial

from vrte.formats.base_file import TENSORS, read_base_once
from vrte.formats.keys import (
    Choice,
    FilePath,
    Flag,
    Fraction,
    Index,
    Key,
    Number,
    Reading,
    Row,
    join_rows,
    make_of_keys,
    read_beside,
)
from vrte.formats.toml_table import Table
from vrte.scene.boundary import Boundary, Lambertian
from vrte.scene.facets import MEASURED, MOST_WIND, Facets, cox_munk
from vrte.scene.hapke import Hapke
from vrte.scene.interface import LEAST_ROUGHNESS, MOST_ROUGHNESS, ROUGHNESS_ALLOWED
from vrte.scene.mirror import Mirror
from vrte.scene.ross_li import RossLi
from vrte.scene.rpv import RPV

ALBEDO = 'a number between 0 and 1, or per cent in quotes, "30 %"'
ROUGHNESS = 0.1  # that a rough surface begins with
SLOPES = {"beckmann": "Gaussian (Beckmann)", "ggx": "with long tails (GGX)"}
H_WORDS = {"2002": "Hapke 2002, within 1 %", "1981": "Hapke 1981, within 4 %"}
FACETS: dict[str, Key] = {  # how rough a surface is, of a base or an interface
    "roughness": Number(
        "roughness",
        ROUGHNESS,
        hint=f"slopes' rms times √2, {LEAST_ROUGHNESS:g} to {MOST_ROUGHNESS:g}",
        allowed=ROUGHNESS_ALLOWED,
    ),
    "distribution": Choice("slopes of facets", names=SLOPES, needed=False),
    "shadowing": Flag("facets hide each other (Smith)", needed=False, usual=lambda table: True),
    "conserving": Flag(
        "light lost between facets is given back", needed=False, usual=lambda table: table.get("shadowing", True)
    ),
}
AVERAGED = "average_mirrored"
SUBSTANCE = Index("substance", [1.5, 0.0])


class BaseFile(FilePath):
    """A file that holds a base, at the wavelength of the scene where it has one."""

    def read(self, table: Table, name: str, reading: Reading) -> Boundary:
        super().read(table, name, reading)
        wavelength = reading.wavelength if "wavelength_um" in reading.file else None
        averaged = AVERAGED in table and table.flag(AVERAGED)
        read = partial(read_base_once, wavelength_um=wavelength, average_mirrored=averaged)
        return read_beside(table, name, read, reading.folder)


def limit(make: type[Boundary], name: str, label: str, start: float | None = None, hint: str = "") -> Number:
    """The key of a number that a base limits, and may have a default for."""
    low, high = make.LIMITS[name]
    default = inspect.signature(make).parameters[name].default
    empty = f"{default:g}" if isinstance(default, float) and start is None else ""
    words = "; ".join(filter(None, (f"{low:g} to {high:g}", hint)))
    return Number(label, start, hint=words, empty=empty, needed=default is inspect.Parameter.empty)


BASES: dict[str, Row] = {
    "black": Row("black", lambda: None, {}),
    "lambertian": Row(
        "white or grey (Lambertian)", Lambertian, {"albedo": Fraction("albedo of the base", 0.5, allowed=ALBEDO)}
    ),
    "mirror": Row("smooth metal or glass (a mirror)", Mirror, {"index": SUBSTANCE}),
    "facets": Row("rough metal or glass (facets)", Facets, {"index": SUBSTANCE, **FACETS}),
    "cox-munk": Row(
        "rough sea, by the wind (Cox and Munk)",
        cox_munk,
        {
            "wind": Number("wind", 7.0, hint=f"m/s, 0 to {MOST_WIND:g}; measured up to {MEASURED:g}"),
            "index": Index("water", [1.34, 0.0], empty="1.34", needed=False),
            "shadowing": Flag("waves hide each other (Smith)", needed=False),
        },
    ),
    "rpv": Row(
        "vegetation, soil, snow (Rahman, Pinty, Verstraete)",
        RPV,
        {
            "rho_0": limit(RPV, "rho_0", "amplitude ρ0", 0.1),
            "k": limit(RPV, "k", "bowl or bell k", 0.7, "below 1 brighter to the horizon"),
            "asymmetry": limit(RPV, "asymmetry", "asymmetry Θ", -0.1, "below 0 sends light back"),
            "rho_c": replace(limit(RPV, "rho_c", "hot spot ρc", None, "1: none"), empty="as ρ0"),
        },
    ),
    "ross-li": Row(
        "land as MODIS has it (Ross-Li)",
        RossLi,
        {
            "f_iso": limit(RossLi, "f_iso", "even f_iso", 0.2),
            "f_vol": limit(RossLi, "f_vol", "leaves f_vol", 0.1),
            "f_geo": limit(RossLi, "f_geo", "crowns f_geo", 0.0, "above 0 negative f at the horizon is cut"),
            "crown_height": limit(RossLi, "crown_height", "crown height h/b"),
            "crown_shape": limit(RossLi, "crown_shape", "crown shape b/r"),
            "hot_spot": Flag("hot spot of leaves (Maignan)", needed=False),
        },
    ),
    "hapke": Row(
        "regolith, powder (Hapke)",
        Hapke,
        {
            "albedo": Fraction("albedo of a grain", 0.6, allowed=ALBEDO),
            "opposition": limit(Hapke, "opposition", "opposition effect B0"),
            "width": limit(Hapke, "width", "its width h"),
            "linear": limit(Hapke, "linear", "phase function: cos g"),
            "quadratic": limit(Hapke, "quadratic", "phase function: (3 cos² g - 1)/2"),
            "asymmetry": limit(Hapke, "asymmetry", "or its asymmetry", None, "below 0 sends light back"),
            "h_function": Choice("formula for H", names=H_WORDS, empty="2002", needed=False),
        },
    ),
    "table": Row(
        "a table of measured or solved Mueller matrices",
        lambda file, average_mirrored=False: file,  # it was averaged where it was read
        {
            "file": BaseFile("file", suffixes=(".nc", ".csv", *TENSORS)),
            AVERAGED: Flag("mirror images are averaged", needed=False),
        },
    ),
}


def read_base(reading: Reading) -> Boundary | None:
    """The base of a scene file; None where it is black. Raises SceneError."""
    if "base" not in reading.file:
        return None
    table = reading.file.table("base", ("kind", *join_rows(BASES)))
    row = BASES[table.choice("kind", tuple(BASES))]
    for key in table.content:
        if key != "kind" and key not in row.keys:
            owners = [f'"{owner}"' for owner, other in BASES.items() if key in other.keys]
            raise table.wrong(key, f"goes with kind = {' or '.join(owners)} only")
    return make_of_keys(row, table, reading)


INTERFACE: dict[str, Key] = {**FACETS, "roughness": replace(FACETS["roughness"], needed=False)}
