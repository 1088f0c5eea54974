"""The BRDF of a scene at several wavelengths."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from vrte.basics.arrays import Array, check_vector, put_in_one_line, settle_array
from vrte.basics.errors import SceneError
from vrte.results.brdf import BRDF_DERIVATIVES, Brdf
from vrte.results.field import Field
from vrte.results.result import Result

MOST_WAVELENGTHS = 10_000
SCENE = "scene_toml"  # in diagnostics: the text of the scene file
Found = TypeVar("Found", bound=Brdf | Field)


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

    def __getitem__(self, place: int) -> Brdf:
        return self.brdfs[place]

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

    @property
    def mueller(self) -> Array:
        """The BRDFs [1/sr], (n, n_in, n_out, n_phi, 4, 4), a new read-only array."""
        return self._stacked("mueller")

    @property
    def reflectance(self) -> Array:
        """Directional-hemispherical reflectances of diffuse light, (n, n_in)."""
        return self._stacked("reflectance")

    @property
    def transmission(self) -> Array | None:
        """The BTDFs [1/sr], of the same shape as ``mueller``, or None."""
        return self._stacked("transmission")

    @property
    def direct_transmittance(self) -> Array | None:
        """The share of the beam that gets through unscattered, (n, n_in), or None."""
        return self._stacked("direct_transmittance")

    @property
    def specular(self) -> Array | None:
        """Mueller matrices of the shares of beams that are mirrored as beams, (n, n_in, 4, 4), or None."""
        return self._stacked("specular")

    @property
    def specular_transmission(self) -> Array | None:
        """Mueller matrices of the shares of beams that leave the other face as beams, (n, n_in, 4, 4), or None."""
        return self._stacked("specular_transmission")

    @property
    def surface(self) -> Array | None:
        """What rough surfaces send back before any particle is met [1/sr], of the shape of ``mueller``, or None."""
        return self._stacked("surface")

    @property
    def specular_reflectance(self) -> Array | None:
        """The shares of unpolarized light that are mirrored as beams, (n, n_in), or None."""
        return self._stacked("specular_reflectance")

    @property
    def total_reflectance(self) -> Array:
        """The shares of unpolarized light that come back, as beams and diffuse, (n, n_in)."""
        return self._stacked("total_reflectance")

    @property
    def jacobian(self) -> dict[str, Array] | None:
        """Derivatives of ``mueller`` by the names of numbers, each of its shape, or None."""
        return self._stacked_by_name("jacobian")

    @property
    def reflectance_jacobian(self) -> dict[str, Array] | None:
        """Derivatives of ``reflectance`` by the names of numbers, each (n, n_in), or None."""
        return self._stacked_by_name("reflectance_jacobian")

    @property
    def transmission_jacobian(self) -> dict[str, Array] | None:
        """Derivatives of ``transmission`` by the names of numbers, each of its shape, or None."""
        return self._stacked_by_name("transmission_jacobian")

    @property
    def direct_transmittance_jacobian(self) -> dict[str, Array] | None:
        """Derivatives of ``direct_transmittance`` by the names of numbers, each (n, n_in), or None."""
        return self._stacked_by_name("direct_transmittance_jacobian")

    @property
    def specular_jacobian(self) -> dict[str, Array] | None:
        """Derivatives of ``specular`` by the names of numbers, each (n, n_in, 4, 4), or None."""
        return self._stacked_by_name("specular_jacobian")

    def _stacked_by_name(self, name: str) -> dict[str, Array] | None:
        """Derivatives of all BRDFs as one array a name, read-only; None where they have none."""
        first = getattr(self.brdfs[0], name)
        if first is None:
            return None
        return {key: settle_array(np.stack([getattr(one, name)[key] for one in self.brdfs])) for key in first}

    def _stacked(self, name: str) -> Any:
        """An array of all BRDFs as one, read-only; None where they have none."""
        if getattr(self.brdfs[0], name) is None:
            return None
        return settle_array(np.stack([getattr(one, name) for one in self.brdfs]))

    def at(self, wavelengths_um: Any) -> "Spectrum":
        """The spectrum at some of its own wavelengths.

        Parameters
        ----------
        wavelengths_um : float or sequence of float
            Ascending [um], each one of ``wavelength_um`` to 1e-9 um.

        Returns
        -------
        Spectrum
            Of those alone.

        Raises
        ------
        SceneError
            For a wavelength that it has not.

        Examples
        --------
        >>> import vrte
        >>> import numpy as np
        >>> white = vrte.Brdf(np.zeros((1, 1, 1, 4, 4)), [0.0], [0.6], [0.5], [0.0], {})
        >>> vrte.Spectrum([0.45, 0.55, 0.65], [white] * 3).at([0.45, 0.65]).wavelength_um.tolist()
        [0.45, 0.65]
        """
        wanted = check_ascending(wavelengths_um)
        places = [int(np.argmin(np.abs(self.wavelength_um - one))) for one in wanted]
        for one, place in zip(wanted, places, strict=True):
            if abs(self.wavelength_um[place] - one) > 1e-9:
                raise SceneError(
                    f"wavelength {one:g} um is none of the spectrum's: the next is at {self.wavelength_um[place]:g} um"
                )
        return Spectrum(self.wavelength_um[places], tuple(self.brdfs[place] for place in places))


def check_ascending(wavelengths_um: Any) -> Array:
    """Wavelengths above 0, each above the one before."""
    found = check_vector("wavelength_um", wavelengths_um)
    if found.size > MOST_WAVELENGTHS:
        raise SceneError(f"wavelength_um must be at most {MOST_WAVELENGTHS} wavelengths, not {found.size}")
    if found[0] <= 0.0 or np.any(np.diff(found) <= 0.0):
        raise SceneError(f"wavelength_um must be positive and ascending, not {put_in_one_line(str(found.tolist()))}")
    return found


def fill_shares(brdfs: tuple[Brdf, ...]) -> tuple[Brdf, ...]:
    """The same, with zeros where others have light of surfaces and one has none: beams that fade out below the smallest
    number, two media of one index."""
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
