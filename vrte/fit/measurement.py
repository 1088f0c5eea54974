"""vrte.Measurement: what was measured, where, and how well."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.appearance.colours import check_light
from vrte.appearance.geometries import read_geometry
from vrte.basics.arrays import Array, check_list, check_numbers, make_readonly, put_in_one_line, show_value
from vrte.basics.errors import SceneError
from vrte.fit.instruments import Interpreter, Reading
from vrte.fit.quantities import QUANTITIES, MeasuredQuantity
from vrte.formats.columns import write_table
from vrte.formats.measurement import MOST_ROWS, WORDS, read_columns
from vrte.formats.toml_table import suggest_nearest
from vrte.request.how import complete_docstring

if TYPE_CHECKING:
    from vrte.formats.scene_family import SceneFamily
    from vrte.scene.scene import Scene

DEFAULTS: dict[str, Any] = {"illuminant": "D65", "observer": 10.0, "phi_deg": 0.0}  # where a place is left empty
OPTIONAL = ("wavelength_um", "base")
OUTSIDE = 5.0  # sigmas that a value may lie beyond what its quantity can be


@dataclass(frozen=True, eq=False, repr=False)
class Measurement:
    """Numbers that were measured, one a row: which quantity, where, its value and its standard deviation.

    Every column is one number or word for all rows, or one a row. What a quantity does not need stays empty, NaN or "";
    which quantities there are, and what each needs, is listed in docs/how_to/fitting.md.

    Parameters
    ----------
    quantity : str or sequence of str
        Names of quantities, such as "f00", "total_reflectance" or "degree_of_linear_polarization".
    value : float or array_like (n,)
        What was measured, in the unit of the quantity.
    sigma : float or array_like (n,), optional
        Standard deviations, above 0, in the same unit; without them all rows of a quantity count alike, and errors are
        scaled by how well the model fits.
    theta_i_deg : float or array_like (n,), optional
        Angles of incidence from the normal [degrees], from 0 to below 90.
    theta_o_deg : float or array_like (n,), optional
        Angles of exit from the normal [degrees], below 90; those below 0 lie on the other side: phi_deg + 180.
    phi_deg : float or array_like (n,), optional
        Azimuths as `vrte.brdf` counts them [degrees]: 0 is forward, 180 turns back; 0 where left out.
    wavelength_um : float or array_like (n,), optional
        Wavelengths in vacuum [um]; the scene's own where left out.
    geometry : str or sequence of str, optional
        An instrument's geometry, "8:di" or "d/8 SCI", of reflectances and colours.
    illuminant : str or sequence of str, optional
        The light of colours; "D65" where left out.
    observer : int or sequence of int, optional
        Degrees of the observer of colours, 2 or 10; 10 where left out.
    base : float or array_like (n,), optional
        Albedo of the Lambertian base under the panel, 0 to 1, in place of the scene's own base, so that a film over
        black and over white is one measurement; the scene's where left out.

    Raises
    ------
    SceneError
        Naming the row, from 1, for an unknown quantity, for what it needs and is not there, or is there and not needed,
        for angles beyond the horizon, for what is no finite number, and for values that no light has.

    Examples
    --------
    >>> import vrte
    >>> vrte.Measurement("total_reflectance", [0.52, 0.48], sigma=0.01, theta_i_deg=[8.0, 45.0])
    Measurement(2 rows: total_reflectance)
    """

    quantity: Any
    value: Any
    sigma: Any = None
    theta_i_deg: Any = None
    theta_o_deg: Any = None
    phi_deg: Any = None
    wavelength_um: Any = None
    geometry: Any = None
    illuminant: Any = None
    observer: Any = None
    base: Any = None
    understood: tuple[str, ...] = field(default=(), init=False)

    def __post_init__(self) -> None:
        columns = {name: make_column(name, getattr(self, name)) for name in COLUMNS}
        count = max(column.size for column in columns.values())
        if count > MOST_ROWS:
            raise SceneError(f"a measurement must have at most {MOST_ROWS} rows, not {count}")
        for name, column in columns.items():
            if column.size not in (1, count):
                raise SceneError.of(name, f"must be one for all, or one a row, {count}, not {column.size}")
            object.__setattr__(self, name, np.broadcast_to(column, (count,)).copy())
        check_quantities(self.quantity)
        for name in QUANTITIES:
            rows = np.flatnonzero(self.quantity == name)
            if rows.size:
                self._fill(QUANTITIES[name], rows)
        if np.isnan(self.sigma).any() and not np.isnan(self.sigma).all():
            row = int(np.flatnonzero(np.isnan(self.sigma))[0])
            raise SceneError(f"row {row + 1}: sigma is missing; it must be there for all rows, or for none", "sigma")
        for name in COLUMNS:
            make_readonly(getattr(self, name))

    def _fill(self, known: MeasuredQuantity, rows: Any) -> None:
        """Checks the rows of a quantity, and fills in what may be left out. Raises SceneError."""
        what = self.quantity[rows[0]]
        for name in COORDINATES:
            column = getattr(self, name)
            empty = column[rows] == "" if name in WORDS else np.isnan(column[rows])
            if name not in known.needs and not (name == "base" or (name in OPTIONAL and not known.is_over_visible)):
                self._refuse(rows, ~empty, name, f"must be empty: {what} has none")
                continue
            if name not in DEFAULTS and name not in OPTIONAL:
                self._refuse(rows, empty, name, f"is missing: {what} needs it")
            elif name not in OPTIONAL:
                column[rows[empty]] = DEFAULTS[name]
            self._check_column(name, rows)
        self._check_values(known, rows)

    def _check_column(self, name: str, rows: Any) -> None:
        """Whether what says where something was measured is allowed. Raises SceneError."""
        given = getattr(self, name)[rows]
        if name in ALLOWED:
            low, high, words = ALLOWED[name]
            bad = ~((given >= low) & (given < high)) & ~np.isnan(given)
            self._refuse(rows, bad, name, f"must be {words}, not {{:g}}")
        if name == "geometry":
            for one in {*given.tolist()}:
                read_geometry(one)
        if name == "illuminant":
            for one, degrees in {*zip(given.tolist(), self.observer[rows].tolist(), strict=True)}:
                check_light(one, 10 if np.isnan(degrees) else int(degrees))
        if name == "observer":
            self._refuse(rows, ~np.isin(given, (2.0, 10.0)), name, "must be 2 or 10 (degrees)")

    def _check_values(self, known: MeasuredQuantity, rows: Any) -> None:
        """Whether values are finite and what the quantity can be, give or take the noise. Raises SceneError."""
        value, sigma = self.value[rows], self.sigma[rows]
        self._refuse(rows, ~np.isfinite(value), "value", "must be a finite number, not {:g}")
        bad = ~np.isnan(sigma) & ~((sigma > 0.0) & np.isfinite(sigma))
        self._refuse(rows, bad, "sigma", "must be above 0 and finite, not {:g}")
        low, high = known.bounds
        slack = np.where(np.isnan(sigma), 0.05 * np.abs(value).max(), OUTSIDE * sigma)
        noise = "by more than noise" if np.isnan(sigma).any() else f"by more than {OUTSIDE:g} sigma"
        for bad, side in ((value < low - slack, f"below {low:g}"), (value > high + slack, f"above {high:g}")):
            percent = high == 1.0 and bad.any() and 1.5 < value[bad][0] <= 150.0
            words = f"{{:g}} is {side}, which {self.quantity[rows[0]]} cannot be, {noise}"
            self._refuse(rows, bad, "value", words + ("; it looks like per cent" if percent else ""))

    def _refuse(self, rows: Any, bad: Any, name: str, words: str) -> None:
        """Raises SceneError for the first of the rows that are bad, where ``words`` may have a place for its value."""
        if bad.any():
            row = rows[bad][0]
            raise SceneError(f"row {row + 1}: {name} {words.format(getattr(self, name)[row])}", name)

    def __len__(self) -> int:
        return int(self.value.size)

    def __repr__(self) -> str:
        return f"Measurement({len(self)} rows: {', '.join(self.names)})"

    def __str__(self) -> str:
        return "\n  ".join([repr(self), *self.understood])

    @property
    def names(self) -> tuple[str, ...]:
        """The quantities that there are, each once, in the order of the rows."""
        return tuple(dict.fromkeys(self.quantity.tolist()))

    @property
    def has_sigma(self) -> bool:
        """Whether standard deviations are known."""
        return not bool(np.isnan(self.sigma).any())

    def pick(self, rows: Any) -> "Measurement":
        """Some of the ``rows``, by their indices from 0 or by a mask."""
        try:
            here = np.atleast_1d(np.arange(len(self))[rows])
        except Exception:  # whatever NumPy says of it
            here = np.zeros((0, 0))
        if here.ndim != 1 or not here.size:
            words = f"must be places from 0 to {len(self) - 1}, or whether each row is taken, not {show_value(rows)}"
            raise SceneError.of("rows", words)
        return Measurement(**{name: getattr(self, name)[here] for name in COLUMNS})

    def join(self, others: Sequence["Measurement"]) -> "Measurement":
        """These rows and those of ``others`` as one measurement: of several files, a film over black and over white."""
        parts = (self, *others)
        columns = {name: np.concatenate([getattr(one, name) for one in parts]) for name in COLUMNS}
        found = Measurement(**columns)
        object.__setattr__(found, "understood", tuple(line for one in parts for line in one.understood))
        return found

    def measure(self, value: Any, sigma: Any = None) -> "Measurement":
        """The same rows with other values (n,), and standard deviations where they are given: what another panel, or a
        model, shows there."""
        columns = {"value": make_column("value", value), "sigma": make_column("sigma", sigma)}
        for name, column in columns.items():
            if column.size not in (1, len(self)):
                raise SceneError.of(name, f"must be one for all, or one a row, {len(self)}, not {column.size}")
        return replace(self, value=value, sigma=self.sigma if sigma is None else sigma)

    def predict(
        self,
        scene: "str | os.PathLike[str] | Mapping[str, Any] | Scene | SceneFamily",
        nodes: int | None = None,
        accuracy: float | None = None,
        wavelengths_um: Any = None,
        folder: str | os.PathLike[str] = ".",
    ) -> Array:
        """What a scene would show in every row (n,), in the units of the quantities; arguments as of `vrte.fit`."""
        from vrte.fit.model import make_model

        return make_model(self, scene, (), nodes, accuracy, wavelengths_um, folder).predict(np.zeros(0))

    def save(self, path: str | os.PathLike[str], comment: str = "") -> None:
        """Writes the rows as CSV, below the lines of a ``comment``; `vrte.read_measurement` brings them back."""
        if os.path.splitext(os.fspath(path))[1].lower() != ".csv":
            raise SceneError(f"the measurement {put_in_one_line(os.fspath(path))} must end in .csv")
        names = ("quantity", *COORDINATES, "value", "sigma")
        kept = {name: getattr(self, name).tolist() for name in names}
        is_empty = {name: all(one == "" or one != one for one in column) for name, column in kept.items()}
        write_table({name: column for name, column in kept.items() if not is_empty[name]}, path, comment)


COLUMNS = tuple(one.name for one in fields(Measurement) if one.init)
COORDINATES = tuple(name for name in COLUMNS if name not in ("quantity", "value", "sigma"))
ALLOWED = {
    "theta_i_deg": (0.0, 90.0, "degrees from the normal, from 0 to below 90, where the horizon is"),
    "theta_o_deg": (np.nextafter(-90.0, 0.0), 90.0, "degrees from the normal, above -90 and below 90: the horizon"),
    "phi_deg": (-3600.0, 3600.0, "degrees"),
    "wavelength_um": (1e-6, 1e6, "a wavelength in um, above 0"),
    "base": (0.0, np.nextafter(1.0, 2.0), "the albedo of a Lambertian base, from 0 to 1"),
}


def make_column(name: str, given: Any) -> Any:
    """A column as an array (1,) or (n,); empty places are NaN or "". Raises SceneError."""
    if name in WORDS:
        words = [""] if given is None else [given] if isinstance(given, str) else check_list(name, given, MOST_ROWS)
        if not words or not all(isinstance(one, str) for one in words):
            raise SceneError.of(name, f"must be a text, or one a row, not {show_value(given)}")
        return np.array([str(one) for one in words], dtype=object)
    found = np.atleast_1d(check_numbers(name, np.nan if given is None else given))
    if found.ndim != 1 or not found.size:
        raise SceneError.of(name, f"must be a number, or one a row, not of shape {found.shape}")
    return found.astype(float)


def check_quantities(given: Sequence[str]) -> None:
    """Whether all quantities are known. Raises SceneError."""
    for row, name in enumerate(given):
        if name not in QUANTITIES:
            others = ", ".join(one for one in QUANTITIES if not one[-1].isdigit())
            matrices = "f00 to f33, t00 to t33, normalized_f01 to normalized_f33, normalized_t01 to normalized_t33"
            hint = suggest_nearest(name, QUANTITIES) or f"; there are {matrices}, {others}"
            raise SceneError(f"row {row + 1}: there is no quantity {show_value(name)}{hint}", "quantity")


@complete_docstring
def read_measurement(
    path: str | os.PathLike[str],
    geometry: str | None = None,
    illuminant: str | None = None,
    observer: int | None = None,
    base: float | Mapping[str, float] | None = None,
    sample: str | int | None = None,
    quantity: str | None = None,
    columns: Mapping[str, str | int] | None = None,
    wavelength_unit: str | None = None,
    value_unit: str | None = None,
    theta_i_deg: float | None = None,
    theta_o_deg: float | None = None,
    phi_deg: float | None = None,
    wavelength_um: float | None = None,
    sigma: float | None = None,
) -> Measurement:
    """A measurement from a file: a table of vrte's columns, or one as an instrument wrote it.

    Parameters
    ----------
    path : path
        A text file with a line of column names, quantity and value among them and any of sigma, theta_i_deg,
        theta_o_deg, phi_deg, wavelength_um, geometry, illuminant, observer, base, and a row a number; lines that start
        with # are comments. Or a NetCDF file with such columns, or with quantities as variables over such coordinates
        and their standard deviations as variables that end in _sigma. Or what instruments write: wavelengths and
        reflectances in columns or in rows, angles and values, colours; with semicolons, tabs, commas or blanks,
        decimal commas, a preamble, in UTF-8, UTF-16 or Latin-1; CGATS.17 and CxF3.
    geometry : str, optional
        The instrument's, "8:di", "45:0", "SCE", where the file does not say it.
    illuminant : str, optional
        Of colours, "D65", where the file does not say it.
    observer : {{2, 10}}, optional
        Of colours [degrees], where the file does not say it.
    base : float or mapping, optional
        Albedo of the base below the panel; or albedos by the names of samples, which are then one measurement, or by
        the words of a column of bases: {{"over black": 0.0, "over white": 0.8}}.
    sample : str or int, optional
        Which of several samples, by its name or its number from 1.
    quantity : str, optional
        What the values are, a name of docs/how_to/fitting.md, or "Lab" or "XYZ", where heads do not say it.
    columns : mapping, optional
        Columns of other languages or names, {{"wavelength_um": "Wellenlänge", "value": "Remission"}}, by their name or
        their number from 1: wavelength_um, theta_i_deg, theta_o_deg, phi_deg, value, sigma, sample, base or a quantity.
    wavelength_unit : {{'nm', 'um', '1/cm'}}, optional
        Of wavelengths, where neither head nor size says it.
    value_unit : {{'fraction', 'percent'}}, optional
        Of values, where neither head nor size says it.
    theta_i_deg, theta_o_deg, phi_deg, wavelength_um : float, optional
        Of all rows, where they have no column.
    sigma : float, optional
        Standard deviation of all values, in the unit of the quantity, where it has no column.

    Returns
    -------
    Measurement
        All rows; its ``understood`` says in sentences what was taken for what, and so does print().

    Raises
    ------
    SceneError
        Naming the line or the row, from 1 without header and comments; what is missing, and the keyword that says it.
    {MissingExtraError, OSError}

    Examples
    --------
    >>> import vrte
    >>> with open("slab.csv", "w") as file:
    ...     _ = file.write("quantity,theta_i_deg,value,sigma\\ntotal_reflectance,8,0.52,0.01\\n")
    >>> vrte.read_measurement("slab.csv")
    Measurement(1 rows: total_reflectance)
    >>> with open("white.txt", "w") as file:
    ...     _ = file.write("Serial 4711\\nnm;White\\n400;61,5\\n500;82,0\\n")
    >>> print(vrte.read_measurement("white.txt", geometry="8:di"))
    Measurement(2 rows: reflectance)
      text in UTF-8
      rows in lines 3 to 4, columns by semicolons, decimal commas
      the words above the table are not read as numbers
      wavelengths 400 to 500 nm in 'nm': by the head
      values of 'White'
      reflectance of 'White' in per cent: by their size, up to 82
    """
    reading = understand_file(path, {name: value for name, value in locals().items() if name != "path"})
    try:
        return make_measurement(reading)
    except SceneError as error:
        raise error.behind(os.fspath(path)) from error


def make_measurement(reading: Reading) -> Measurement:
    """The measurement of a file that was understood. Raises SceneError for what is missing."""
    if reading.asks:
        raise SceneError("; ".join(reading.asks.values()), *[*reading.asks][:1])
    found = Measurement(**reading.columns)
    object.__setattr__(found, "understood", tuple(reading.understood))
    return found


def understand_file(path: str | os.PathLike[str], keywords: Mapping[str, Any]) -> Reading:
    """What a file holds, with the keywords of `read_measurement`, and what is missing. Raises as that does."""
    given = {name: value for name, value in keywords.items() if value is not None}
    try:
        table = read_columns(path, COLUMNS)
        if not isinstance(table, dict):
            return Interpreter(table, given).interpret()
        for name in given:
            if name not in COORDINATES or name in table:
                words = "is in the file" if name in table else "is of instruments' files, and this has vrte's columns"
                raise SceneError.of(name, words)
        return Reading(["a table of vrte's own columns"], columns=table | given)
    except SceneError as error:
        raise error.behind(os.fspath(path)) from error
