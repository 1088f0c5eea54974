"""How large particles are, in a scene file: a radius or diameter, or one of the distributions by name.

A new distribution is a class with a ``quadrature``, and a row in `SIZES` (docs/how_to/extending.md).
"""

from typing import Any

from vrte.formats.columns import read_sizes
from vrte.formats.keys import FilePath, Key, Number, Numbers, Other, Reading, Row, list_names, make_of_keys
from vrte.formats.toml_table import Table
from vrte.optics.size_distribution import Gamma, Lognormal, Tabulated

SIZE_KEYS = ("radius_um", "diameter_um", "size")
DIAMETERS = {"radius_um": "diameter_um", "median_um": "median_diameter_um", "r_eff_um": "d_eff_um"}
DIAMETER_LABELS = {"radius_um": "diameters [µm]", "median_um": "median diameter [µm]", "r_eff_um": "d_eff [µm]"}


def halve(value: Any) -> Any:
    """Half of a number, or of each of a list: radii of diameters."""
    return [0.5 * one for one in value] if isinstance(value, list) else 0.5 * value


MEDIAN, R_EFF, RADIUS = (Other(DIAMETERS[key], halve, "half of it, ") for key in ("median_um", "r_eff_um", "radius_um"))
SIZES: dict[str, Row] = {  # one with a key of its own name is written size = { name = value }
    "lognormal": Row(
        "lognormal",
        Lognormal,
        {"median_um": Number("median radius [µm]", 0.2, other=MEDIAN), "sigma": Number("sigma", 1.4)},
    ),
    "gamma": Row("gamma", Gamma, {"r_eff_um": Number("r_eff [µm]", 0.2, other=R_EFF), "v_eff": Number("v_eff", 0.07)}),
    "tabulated": Row(
        "tabulated",
        Tabulated,
        {
            "radius_um": Numbers("radii [µm]", [0.1, 0.2, 0.4], other=RADIUS),
            "density": Numbers("number density", [0.0, 1.0, 0.0]),
        },
    ),
    "table": Row("a table of sizes", lambda table: table, {"table": FilePath("file", open=read_sizes)}),
}
ONE: dict[str, Key] = {"radius_um": Number("radius [µm]", 0.3), "diameter_um": Number("diameter [µm]", 0.6)}


class Size(Key):
    """One of `SIZES`."""

    @property
    def inside(self) -> dict[str, Key]:
        return {name: row.keys[name] for name, row in SIZES.items() if name in row.keys}

    def read(self, table: Table, name: str, reading: Reading) -> Any:
        size = table.table(name, tuple(SIZES))
        if len(size.content) != 1:
            raise table.wrong(name, f"must be exactly one of {', '.join(SIZES)}")
        (kind,) = size.content
        row = SIZES[kind]
        return make_of_keys(row, size if kind in row.keys else size.table(kind, list_names(row.keys)), reading)


SIZED: dict[str, Key] = {  # the keys of particles that say how large they are
    "radius_um": Number(allowed="a length in micrometres > 0", other=RADIUS, needed=False),
    "size": Size(needed=False),
}
