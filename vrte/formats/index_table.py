"""A refractive index over wavelength, from a CSV table of one's own."""

import os

from vrte.basics.errors import SceneError
from vrte.formats.text_file import check_file_name, read_rows
from vrte.optics.refractive_index import IndexTable

MOST_ROWS = 100_000
LARGEST_FILE = 10_000_000  # bytes
IN_A_UM = {"wavelength_um": 1.0, "wavelength_nm": 1e3}
IN_WORDS = "wavelength_um,n,k (or wavelength_nm in front; without k nothing is absorbed)"


def read_index(path: str | os.PathLike[str]) -> IndexTable:
    """The refractive index n + i k over wavelength in a CSV file, for `vrte.spheres` and scene files.

    Parameters
    ----------
    path : path
        A text file whose header is wavelength_um,n,k or wavelength_nm,n,k (k may be left out: no absorption), with one
        row a wavelength in vacuum, ascending; lines that start with # are comments.

    Returns
    -------
    IndexTable
        Between rows n and k are linear in the wavelength; outside, an error gives the table's range.

    Raises
    ------
    SceneError
        Naming the line.
    OSError
        Where the file cannot be read.

    Examples
    --------
    >>> import vrte
    >>> with open("pigment.csv", "w") as file:
    ...     _ = file.write("wavelength_nm,n,k\\n400,2.0,0.25\\n800,1.5,0.0\\n")
    >>> vrte.read_index("pigment.csv").at(0.4)
    (2+0.25j)
    """
    header, rows = read_rows(path, LARGEST_FILE, MOST_ROWS)
    if not header or header[0] not in IN_A_UM or header[1:] not in (["n"], ["n", "k"]):
        raise SceneError(f"the first line must be {IN_WORDS}")
    for line, row in rows:
        if len(row) != len(header):
            raise SceneError(f"line {line}: {len(header)} numbers are needed, not {len(row)}")
    columns = {"k": (0.0,) * len(rows)} | {
        name: tuple(row[place] for _, row in rows) for place, name in enumerate(header)
    }
    wavelengths = tuple(value / IN_A_UM[header[0]] for value in columns[header[0]])  # 700 nm are 0.7 to the last bit
    return IndexTable(wavelengths, columns["n"], columns["k"], f"the table {os.path.basename(check_file_name(path))}")
