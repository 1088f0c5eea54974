"""Results to files and back, in the format that the file's name asks for."""

import math
import os
from collections.abc import Callable
from pathlib import Path

from vrte.basics.arrays import check_number
from vrte.basics.errors import SceneError
from vrte.formats.atomic import PathName, check_file_name
from vrte.formats.contents import LARGEST_RESULT, MEANINGLESS, Result, explain_error
from vrte.formats.csv_table import load_csv, write_csv
from vrte.formats.netcdf import load_netcdf, save_netcdf
from vrte.formats.zarr_folder import load_zarr, save_zarr

Writer = Callable[[Result, PathName], None]
Reader = Callable[[PathName, float], Result]
FORMATS: dict[str, tuple[Writer, Reader]] = {  # another one: a file that writes and reads it, and a row
    ".nc": (save_netcdf, load_netcdf),
    ".csv": (write_csv, load_csv),
    ".zarr": (save_zarr, load_zarr),
}


def save(result: Result, path: str | os.PathLike[str]) -> None:
    """Writes a BRDF, field or spectrum to a file, all of it or nothing: NetCDF where its name ends in .nc, a table in
    .csv, a folder of Zarr in .zarr. Raises SceneError for another ending, OSError where the file cannot be written,
    MissingExtraError for NetCDF and Zarr without the extra "files".

    >>> save(brdf, "result.csv")
    """
    suffix = Path(check_file_name(path)).suffix.lower()
    if suffix not in FORMATS:
        raise SceneError(f"the name of a result must end in {', '.join(FORMATS)}, not {check_file_name(path)!r}")
    FORMATS[suffix][0](result, path)


def load(path: str | os.PathLike[str], *, most_bytes: float = LARGEST_RESULT) -> Result:
    """The BRDF, field or spectrum in a file, every digit as it was saved.

    Parameters
    ----------
    path : path
        Its name ends in .csv for a table, in .zarr for a folder of Zarr, otherwise it is NetCDF.
    most_bytes : float
        A result whose values take more than this in memory is refused before it takes them: allow more for a file that
        you trust. Nothing but numbers and texts is read, and nothing from another file (docs/reference/security.md).

    Returns
    -------
    Brdf, Field or Spectrum
        What was saved.

    Raises
    ------
    FileNotFoundError
        Where there is no such file.
    SceneError
        For a file that holds no result of this package.
    MissingExtraError
        For NetCDF and Zarr without the extra "files".

    Examples
    --------
    >>> import vrte
    >>> from vrte.formats.result_file import save
    >>> save(brdf, "result.nc")
    >>> vrte.load("result.nc").mueller.shape
    (2, 20, 37, 4, 4)
    """
    most_bytes = check_number("most_bytes", most_bytes, 0.0, math.inf, "a number of bytes >= 0")
    name = check_file_name(path)
    if not os.path.exists(name):
        raise FileNotFoundError(f"no such file: {name}")
    _, read = FORMATS.get(Path(name).suffix.lower(), FORMATS[".nc"])
    try:
        return read(path, most_bytes)
    except SceneError as error:
        raise error.behind(name) from error
    except (*MEANINGLESS, FileNotFoundError) as error:  # a file of a folder that is not there
        raise SceneError(f"{name} holds no BRDF, field or spectrum written by vrte: {explain_error(error)}") from error
