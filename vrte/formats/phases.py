"""Phase functions and matrices of a layer in a scene file, by name. A new one is a function and a row in `PHASES`."""

from collections.abc import Callable
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

from vrte.formats.columns import read_coefficients
from vrte.formats.keys import Choice, FilePath, Flag, Key, Number, Reading, Whole, make_start, read_keys
from vrte.formats.media import ONE_WAVELENGTH, TABLE, read_beside
from vrte.formats.scattering import CSV, NETCDF_SUFFIXES, read_scattering
from vrte.formats.toml_table import Table, locate_errors, suggest_nearest
from vrte.optics import phase_matrix as optics
from vrte.optics.angle_tables import EXTRAPOLATE
from vrte.optics.conventions import CONVENTIONS
from vrte.optics.phase_matrix import MOST_TERMS, PhaseMatrix


class PhaseRow(NamedTuple):
    """``words`` of a form; what makes the phase matrix, called with the values of its keys by their names. A row is
    written phase = { name = value, ... }, or phase = "name" where no key is needed."""

    words: str
    make: Callable[..., PhaseMatrix]
    keys: dict[str, Key]

    @property
    def start(self) -> dict[str, object]:
        """What a form begins with."""
        return make_start(self.keys)


class AngleTable(FilePath):
    """A file of scattering matrices over angle, and the scene's wavelength where the file is for several."""

    def read(self, table: Table, name: str, reading: Reading) -> tuple[Path, float | None]:
        path = super().read(table, name, reading)
        if path.suffix.lower() == CSV:
            return path, None
        return path, reading.file.number("wavelength_um", ONE_WAVELENGTH)


def find_file(path: Path) -> Path:
    """The path of a file that is there. Raises OSError."""
    path.stat()
    return path


def read_angles(table: tuple[Path, float | None], **options: object) -> PhaseMatrix:
    """The phase matrix of an `AngleTable`, with the options of `vrte.read_scattering`."""
    path, wavelength = table
    about = path.stat()
    return expand_file(path, (about.st_mtime_ns, about.st_size), wavelength, tuple(options.items()))


@lru_cache(maxsize=16)
def expand_file(
    path: Path, changed: tuple[int, int], wavelength: float | None, options: tuple[tuple[str, object], ...]
) -> PhaseMatrix:
    """The same, remembered while the file is not ``changed``: a sweep reads its scene again for each of its own."""
    found = read_scattering(path, wavelength_um=wavelength, **dict(options))  # type: ignore[arg-type]
    assert isinstance(found, PhaseMatrix)  # no density is given
    return found


@lru_cache(maxsize=16)
def make_by_name(name: str, layer: tuple[str | int, ...], values: tuple[tuple[str, Any], ...]) -> PhaseMatrix:
    """The phase matrix of a row and the values of its keys, remembered for each ``layer``: one whose matrix is shared
    with another adds up its light in another order."""
    return PHASES[name].make(**dict(values))


TERMS = Whole("terms", needed=False, limits=(1, MOST_TERMS))
PHASES: dict[str, PhaseRow] = {
    "isotropic": PhaseRow("isotropic scatterers", optics.isotropic, {}),
    "rayleigh": PhaseRow(
        "Rayleigh scatterers",
        lambda rayleigh=0.0: optics.rayleigh(rayleigh),
        {"rayleigh": Number("depolarization", 0.0, needed=False)},
    ),
    "henyey_greenstein": PhaseRow(
        "Henyey-Greenstein scatterers",
        lambda henyey_greenstein, terms=None: optics.henyey_greenstein(henyey_greenstein, terms),
        {
            "henyey_greenstein": Number("asymmetry g", 0.8),
            "terms": Whole("terms", needed=False, limits=(1, MOST_TERMS)),
        },
    ),
    "table": PhaseRow(
        "a scattering matrix over angle",
        read_angles,
        {
            "table": AngleTable("file", suffixes=(CSV, *NETCDF_SUFFIXES), open=find_file),
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


def describe_phases() -> str:
    """How a phase can be written, in words."""
    named = [f'"{name}"' for name, row in PHASES.items() if not any(key.needed for key in row.keys.values())]
    tables = [f"{{ {name} = {row.keys[name].label or '...'} }}" for name, row in PHASES.items() if row.keys]
    return f"{', '.join(named + tables)} or the path of a .csv with the columns l, a1, a2, a3, a4, b1, b2"


def read_phase(layer: Table, reading: Reading) -> PhaseMatrix:
    """The phase matrix of a layer's key ``phase``. Raises SceneError."""
    value = layer.content["phase"]
    if isinstance(value, dict):
        return read_phase_table(layer, reading)
    row = PHASES.get(value) if isinstance(value, str) else None
    if row is not None and not any(key.needed for key in row.keys.values()):
        return make_by_name(value, layer.place, ())
    if not isinstance(value, str) or not value.endswith(TABLE):
        hint = suggest_nearest(value, PHASES) if isinstance(value, str) else ""
        raise layer.wrong("phase", f"must be {describe_phases()}{hint}")
    tolerance = layer.number("tolerance") if "tolerance" in layer else 0.0
    return read_beside(layer, "phase", partial(read_coefficients, tolerance=tolerance), reading.folder)


def read_phase_table(layer: Table, reading: Reading) -> PhaseMatrix:
    """The phase matrix of a table phase = { name = value, ... }."""
    table = layer.table("phase", tuple(dict.fromkeys(key for row in PHASES.values() for key in row.keys)))
    names = [name for name in PHASES if name in table]
    if len(names) != 1 or any(key not in PHASES[names[0]].keys for key in table.content):
        raise layer.wrong("phase", f"must be {describe_phases()}")
    values = read_keys(PHASES[names[0]].keys, table, reading)
    with locate_errors((*table.place, names[0])):
        if names[0] == "table":  # remembered while its file is as it was
            return read_angles(**values)
        return make_by_name(names[0], layer.place, tuple(values.items()))
