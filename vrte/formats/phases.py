"""Phase functions and matrices of a layer in a scene file, by name. A new one is a function and a row in `PHASES`."""

from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from vrte.formats.columns import read_coefficients
from vrte.formats.keys import (
    TABLE,
    Choice,
    FilePath,
    Flag,
    Key,
    Number,
    Reading,
    Row,
    Whole,
    join_rows,
    read_beside,
    read_keys,
)
from vrte.formats.scattering import CSV, NETCDF_SUFFIXES, read_scattering
from vrte.formats.toml_table import Table, locate_errors, suggest_nearest
from vrte.optics import phase_matrix as optics
from vrte.optics.angle_tables import EXTRAPOLATE
from vrte.optics.conventions import CONVENTIONS
from vrte.optics.phase_matrix import MOST_TERMS, PhaseMatrix

AngleFile = tuple[Path, float | None, tuple[int, int]]  # the scene's wavelength [um], and when and how it was changed


class AngleTable(FilePath):
    """A file of scattering matrices over angle, and the scene's wavelength where the file is for several."""

    def read(self, table: Table, name: str, reading: Reading) -> AngleFile:
        path: Path = super().read(table, name, reading)
        about = read_beside(table, name, Path.stat, reading.folder)
        wavelength = None if path.suffix.lower() == CSV else reading.wavelength
        return path, wavelength, (about.st_mtime_ns, about.st_size)


def read_angles(table: AngleFile, **options: Any) -> PhaseMatrix:
    """The phase matrix of an `AngleTable`, with the options of `vrte.read_scattering`."""
    found = read_scattering(table[0], wavelength_um=table[1], **options)
    assert isinstance(found, PhaseMatrix)  # no density is given
    return found


# a row is written phase = { name = value, ... }, or phase = "name" where no key is needed
PHASES: dict[str, Row] = {
    "isotropic": Row("isotropic scatterers", optics.isotropic, {}),
    "rayleigh": Row(
        "Rayleigh scatterers",
        lambda rayleigh=0.0: optics.rayleigh(rayleigh),
        {"rayleigh": Number("depolarization", 0.0, needed=False)},
    ),
    "henyey_greenstein": Row(
        "Henyey-Greenstein scatterers",
        lambda henyey_greenstein, terms=None: optics.henyey_greenstein(henyey_greenstein, terms),
        {
            "henyey_greenstein": Number("asymmetry g", 0.8),
            "terms": Whole("terms", needed=False, limits=(1, MOST_TERMS)),
        },
    ),
    "table": Row(
        "a scattering matrix over angle",
        read_angles,
        {
            "table": AngleTable("file", suffixes=(CSV, *NETCDF_SUFFIXES)),
            "convention": Choice(
                "written as",
                names={name: about.words for name, about in CONVENTIONS.items()},
                empty="as the file's kind has it",
                needed=False,
            ),
            "normalise": Flag("divide by its integral", needed=False),
            "spheres": Flag("of spheres", needed=False),
            "ends": Choice("ends that are left out", names={EXTRAPOLATE: "extrapolate"}, empty="refuse", needed=False),
            "accuracy": Number("error of the expansion", empty="5e-5, or rounding", needed=False),
            "tolerance": Number("negative eigenvalues up to", empty="0", needed=False),
            "effective_radius_um": Number("effective radius [µm]", hint="of NetCDF with several", needed=False),
            "humidity_percent": Number("humidity [%]", hint="of NetCDF with several", needed=False),
        },
    ),
}


@lru_cache(maxsize=16)
def make_once(name: str, layer: tuple[str | int, ...], values: tuple[tuple[str, Any], ...]) -> PhaseMatrix:
    """The phase matrix of a row and the values of its keys, remembered for each ``layer``: one whose matrix is shared
    with another adds up its light in another order."""
    return PHASES[name].make(**dict(values))


class Phase(FilePath):
    """The phase matrix of a layer: a row of `PHASES`, or a table of coefficients."""

    @property
    def inside(self) -> dict[str, Key]:
        return join_rows(PHASES)

    def read(self, table: Table, name: str, reading: Reading) -> PhaseMatrix:
        value = table.content[name]
        if isinstance(value, str) and value.endswith(TABLE):
            tolerance = table.number("tolerance") if "tolerance" in table else 0.0
            return read_beside(table, name, partial(read_coefficients, tolerance=tolerance), reading.folder)
        if "tolerance" in table:
            raise table.wrong("tolerance", "goes with a phase from a .csv only: how far below zero it may be")
        inner = Table((*table.place, name), {}, ())
        bare = [own for own, row in PHASES.items() if not any(key.needed for key in row.keys.values())]
        found = [own for own in bare if own == value]
        if isinstance(value, dict):
            inner = table.table(name, tuple(self.inside))
            found = [own for own in PHASES if own in inner and {*value} <= {*PHASES[own].keys}]
        if len(found) != 1:
            tables = [f"{{ {own} = {row.keys[own].label} }}" for own, row in PHASES.items() if row.keys]
            words = ", ".join([*(f'"{own}"' for own in bare), *tables])
            words += " or the path of a .csv with the columns l, a1, a2, a3, a4, b1, b2"
            raise table.wrong(name, f"must be {words}{suggest_nearest(value, PHASES)}")
        values = read_keys(PHASES[found[0]].keys, inner, reading)
        with locate_errors((*inner.place, found[0])):
            return make_once(found[0], table.place, tuple(values.items()))
