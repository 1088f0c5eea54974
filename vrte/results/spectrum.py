"""The BRDF of a scene at several wavelengths."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from vrte.basics.arrays import Array, check_vector, make_readonly, put_in_one_line
from vrte.basics.errors import SceneError
from vrte.results.brdf import BRDF_DERIVATIVES, Brdf
from vrte.results.field import Field
from vrte.results.result import Result

MOST_WAVELENGTHS = 10_000
SCENE = "scene_toml"  # in diagnostics: the text of the scene file
Found = TypeVar("Found", bound=Brdf | Field)


def stack(name: str, words: str) -> Any:
    """A property of a spectrum: arrays of its BRDFs, or dictionaries of them, stacked, read-only, or None."""

    def collect(spectrum: "Spectrum") -> Any:
        found = [getattr(one, name) for one in spectrum.brdfs]
        if isinstance(found[0], dict):
            return {key: make_readonly(np.stack([one[key] for one in found])) for key in found[0]}
        return None if found[0] is None else make_readonly(np.stack(found))

    return property(collect, doc=words)


@dataclass(frozen=True, eq=False, repr=False)
class Spectrum(Result):
    """BRDFs at ascending wavelengths, all for the same directions, as `vrte.spectrum` finds them.

    An item of the spectrum is the BRDF at that place. Where some BRDFs have light of surfaces, the others count as
    zero.

    Parameters
    ----------
    wavelength_um : array_like (n,)
        Wavelengths in vacuum [um], ascending.
    brdfs : sequence of Brdf
        n of them, for the same directions, with or without transmission all alike.

    Raises
    ------
    SceneError
        Where they do not fit together.

    Examples
    --------
    >>> import vrte
    >>> import numpy as np
    >>> white = vrte.Brdf(np.zeros((1, 1, 1, 4, 4)), [0.0], [0.6], [0.5], [0.0], {})
    >>> vrte.Spectrum([0.45, 0.65], [white, white]).mueller.shape
    (2, 1, 1, 1, 4, 4)
    """

    wavelength_um: Array
    brdfs: tuple[Brdf, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "wavelength_um", check_ascending(self.wavelength_um))
        object.__setattr__(self, "brdfs", tuple(self.brdfs))
        if len(self.brdfs) != self.wavelength_um.size:
            raise SceneError(f"brdfs must be one a wavelength, {self.wavelength_um.size}, not {len(self.brdfs)}")
        object.__setattr__(self, "brdfs", fill_shares(self.brdfs))
        for one in self.brdfs[1:]:
            check_alike(self.brdfs[0], one)

    def __len__(self) -> int:
        return len(self.brdfs)

    def __getitem__(self, index: int) -> Brdf:
        return self.brdfs[index]

    def __iter__(self) -> Iterator[Brdf]:
        return iter(self.brdfs)

    def __repr__(self) -> str:
        first, last = self.wavelength_um[[0, -1]]
        return f"Spectrum({len(self)} wavelengths from {first:g} to {last:g} um, {self.brdfs[0]!r} at each)"

    @property
    def mu_i(self) -> Array:
        """Cosines of incidence, (n_in,)."""
        return self.brdfs[0].mu_i

    @property
    def mu_o(self) -> Array:
        """Cosines of exit, (n_out,)."""
        return self.brdfs[0].mu_o

    @property
    def phi(self) -> Array:
        """Azimuths of exit from the incident light's [degrees], (n_phi,)."""
        return self.brdfs[0].phi

    mueller = stack("mueller", "The BRDFs [1/sr], (n, n_in, n_out, n_phi, 4, 4), a new read-only array.")
    reflectance = stack("reflectance", "Directional-hemispherical reflectances of diffuse light, (n, n_in).")
    transmission = stack("transmission", "The BTDFs [1/sr], of the same shape as ``mueller``, or None.")
    direct_transmittance = stack("direct_transmittance", "Transmittance of the unscattered beam, (n, n_in), or None.")
    specular = stack("specular", "Mueller matrices of specular reflection of beams, (n, n_in, 4, 4), or None.")
    specular_transmission = stack("specular_transmission", "The same of beams through the other face, or None.")
    surface = stack("surface", "Light of rough surfaces alone [1/sr], of the shape of ``mueller``, or None.")
    specular_reflectance = stack("specular_reflectance", "Of unpolarized beams, (n, n_in), or None.")
    total_reflectance = stack("total_reflectance", "Of unpolarized light, specular and diffuse, (n, n_in).")
    jacobian = stack("jacobian", "Derivatives of ``mueller`` by the names of numbers, each of its shape, or None.")
    reflectance_jacobian = stack("reflectance_jacobian", "The same of ``reflectance``, each (n, n_in).")
    transmission_jacobian = stack("transmission_jacobian", "The same of ``transmission``, or None.")
    direct_transmittance_jacobian = stack("direct_transmittance_jacobian", "The same of that, each (n, n_in).")
    specular_jacobian = stack("specular_jacobian", "The same of ``specular``, each (n, n_in, 4, 4), or None.")

    def at(self, wavelengths_um: Any) -> "Spectrum":
        """The spectrum at some of its own wavelengths, ascending [um], each one of ``wavelength_um`` to 1e-9 um."""
        wanted = check_ascending(wavelengths_um)
        indices = [int(np.argmin(np.abs(self.wavelength_um - one))) for one in wanted]
        for one, index in zip(wanted, indices, strict=True):
            if abs(self.wavelength_um[index] - one) > 1e-9:
                raise SceneError(
                    f"wavelength {one:g} um is none of the spectrum's: the next is at {self.wavelength_um[index]:g} um"
                )
        return Spectrum(self.wavelength_um[indices], tuple(self.brdfs[index] for index in indices))


def check_ascending(wavelengths_um: Any) -> Array:
    """Wavelengths above 0, each above the one before."""
    found = check_vector("wavelength_um", wavelengths_um)
    if found.size > MOST_WAVELENGTHS:
        raise SceneError(f"wavelength_um must be at most {MOST_WAVELENGTHS} wavelengths, not {found.size}")
    if found[0] <= 0.0 or np.any(np.diff(found) <= 0.0):
        raise SceneError(f"wavelength_um must be positive and ascending, not {put_in_one_line(str(found.tolist()))}")
    return found


def fill_shares(brdfs: tuple[Brdf, ...]) -> tuple[Brdf, ...]:
    """The same, zeros where others have light of surfaces: beams below the smallest number, media of one index."""
    shapes = {
        "specular": lambda one: (one.mu_i.size, 4, 4),
        "specular_transmission": lambda one: (one.mu_i.size, 4, 4),
        "surface": lambda one: one.mueller.shape,
    }
    there = [name for name in shapes if any(getattr(one, name) is not None for one in brdfs)]
    missing: list[dict[str, Any]] = [
        {name: np.zeros(shapes[name](one)) for name in there if getattr(one, name) is None} for one in brdfs
    ]
    for one, dark in zip(brdfs, missing, strict=True):
        if "specular" in dark and one.jacobian:
            dark["specular_jacobian"] = dict.fromkeys(one.jacobian, dark["specular"])
    return tuple(replace(one, **dark) if dark else one for one, dark in zip(brdfs, missing, strict=True))


def check_alike(first: Brdf, other: Brdf) -> None:
    """Whether two BRDFs are for the same directions, lit from the same side, and hold the same."""
    for name in ("mu_i", "mu_o", "phi"):
        if not np.array_equal(getattr(first, name), getattr(other, name)):
            raise SceneError(f"brdfs must be for the same directions: {name} differs")
    for name in BRDF_DERIVATIVES:
        if list(getattr(first, name) or ()) != list(getattr(other, name) or ()):
            raise SceneError(f"brdfs must all have the same derivatives, in the same order: {name} differs")
    for name in ("transmission", "direct_transmittance"):
        if (getattr(first, name) is None) != (getattr(other, name) is None):
            raise SceneError(f"brdfs must all have {name}, or none of them")
    if first.diagnostics.get("illuminate") != other.diagnostics.get("illuminate"):
        raise SceneError("brdfs must all be lit from the same side")


def add_scene_text(found: Found, text: str) -> Found:
    """The same with the text of its scene file in its diagnostics, where there is one."""
    return replace(found, diagnostics=found.diagnostics | {SCENE: text}) if text else found
