"""How large particles are, in a scene file: a radius or diameter, or one of the distributions by name.

A new distribution is a class with a ``quadrature``, and a row in `SIZES` (docs/how_to/extending.md).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from vrte.formats.columns import read_sizes
from vrte.formats.keys import FilePath, Key, Number, Numbers, Reading, read_keys
from vrte.formats.toml_table import Table, locate_errors
from vrte.optics.size_distribution import Gamma, Lognormal, SizeDistribution, Tabulated

SIZE_KEYS = ("radius_um", "diameter_um", "size")
# who is told of the one wrote the other
DIAMETERS = {"radius_um": "diameter_um", "median_um": "median_diameter_um", "r_eff_um": "d_eff_um"}
HALVED = {name: (key, "half of it, ") for name, key in DIAMETERS.items()}


class SizeRow(NamedTuple):
    """``words`` of a form, before radii or diameters; what makes the distribution; its keys. One of `DIAMETERS` may be
    given twice as large by another name; a row with a key of its own name is written size = { name = value }."""

    words: str
    make: Callable[..., SizeDistribution]
    keys: dict[str, Key]


SIZES: dict[str, SizeRow] = {
    "lognormal": SizeRow(
        "lognormal", Lognormal, {"median_um": Number("median radius [µm]", 0.2), "sigma": Number("sigma", 1.4)}
    ),
    "gamma": SizeRow("gamma", Gamma, {"r_eff_um": Number("r_eff [µm]", 0.2), "v_eff": Number("v_eff", 0.07)}),
    "tabulated": SizeRow(
        "tabulated",
        Tabulated,
        {"radius_um": Numbers("radii [µm]", [0.1, 0.2, 0.4]), "density": Numbers("number density", [0.0, 1.0, 0.0])},
    ),
    "table": SizeRow("a table of sizes", lambda table: table, {"table": FilePath("file", open=read_sizes)}),
}
ONE: dict[str, Key] = {"radius_um": Number("radius [µm]", 0.3), "diameter_um": Number("diameter [µm]", 0.6)}
DIAMETER_LABELS = {"radius_um": "diameters [µm]", "median_um": "median diameter [µm]", "r_eff_um": "d_eff [µm]"}


def read_size(table: Table, reading: Reading) -> dict[str, Any]:
    """The keyword that says how large particles are: ``radius_um`` or ``size``. Raises SceneError."""
    for key, factor in (("radius_um", 1.0), ("diameter_um", 0.5)):
        if key in table:
            return {"radius_um": factor * table.number(key, f"a {key.removesuffix('_um')} in micrometres > 0")}
    size = table.table("size", tuple(SIZES))
    if len(size.content) != 1:
        raise table.wrong("size", f"must be exactly one of {', '.join(SIZES)}")
    (name,) = size.content
    row = SIZES[name]
    if name in row.keys:
        values = read_keys(row.keys, size, reading)
        with locate_errors(size.place, size.allowed):
            return {"size": row.make(**values)}
    doubled = [key for key in row.keys if key in DIAMETERS]
    numbers = size.table(name, (*row.keys, *(DIAMETERS[key] for key in doubled)))
    keys = dict(row.keys)
    for radius in doubled:
        numbers.not_both(radius, DIAMETERS[radius])
        if DIAMETERS[radius] in numbers:
            keys[DIAMETERS[radius]] = keys.pop(radius)
    values = read_keys(keys, numbers, reading)
    said = {radius: HALVED[radius] for radius in doubled if DIAMETERS[radius] in numbers}
    for radius in said:
        values[radius] = halve(values.pop(DIAMETERS[radius]))
    with locate_errors(numbers.place, numbers.allowed, said=said):
        return {"size": row.make(**values)}


def halve(value: Any) -> Any:
    """Half of a number, or of each of a list.

    >>> halve([1.0, 2.0])
    [0.5, 1.0]
    """
    return [0.5 * one for one in value] if isinstance(value, list) else 0.5 * value
