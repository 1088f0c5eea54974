"""The BRDF of a scene, at one wavelength or at several."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from vrte.basics.arrays import Array, check_vector, make_readonly, put_in_one_line
from vrte.basics.errors import SceneError
from vrte.results.field import Field
from vrte.results.result import Result, describe_derivatives, describe_error
from vrte.scene.illumination import check_azimuths, choose_weights, sample_incident_light, sum_outgoing_light
from vrte.scene.tabulated_base import TabulatedBase

BRDF_DERIVATIVES = {  # dictionaries by names of numbers, and what they are the derivatives of
    "jacobian": "mueller",
    "reflectance_jacobian": "reflectance",
    "transmission_jacobian": "transmission",
    "direct_transmittance_jacobian": "direct_transmittance",
    "specular_jacobian": "specular",
}


@dataclass(frozen=True, eq=False, repr=False)
class Brdf(Result):
    """Mueller BRDF, BTDF and reflectances of a scene, as `vrte.brdf` finds them.

    Radiance out is ``mueller`` @ irradiance in. The lit face is the top, or as ``diagnostics["illuminate"]`` says.
    Cosines are those outside the scene. All arrays are read-only; what smooth interfaces mirror or let through as a
    beam is in ``specular`` and ``specular_transmission``, and not in ``mueller``, ``transmission`` or ``reflectance``.

    Attributes
    ----------
    mueller
        The BRDF [1/sr] of diffuse light, (n_in, n_out, n_phi, 4, 4), in the meridian planes of both directions.
    reflectance
        Directional-hemispherical reflectance of diffuse light, (n_in,), under unpolarized light: flux out over flux in.
    mu_i
        Cosines of incidence, (n_in,), above 0 up to 1.
    mu_o
        Cosines of exit, (n_out,), above 0 up to 1.
    phi
        Azimuths [degrees], (n_phi,), outgoing minus incident, both along the direction of travel: 0 is forward, 180
        turns back.
    diagnostics
        How it was found: method, algorithm, nodes, accuracy, residuals and timings, by name.
    transmission
        The BTDF [1/sr] of diffuse light out of the face that is not lit, base included, of the shape of ``mueller``;
        None where it was not asked for.
    direct_transmittance
        The share of the beam that gets through unscattered, (n_in,), or None.
    specular
        Mueller matrices of the share of a beam's power that is mirrored and stays a beam, (n_in, 4, 4); None where none
        is.
    specular_transmission
        The same of what leaves the other face as a beam, (n_in, 4, 4), or None.
    surface
        The part of ``mueller`` [1/sr] that rough interfaces send back before any particle is met; None without them.
    coherent
        What interference adds to ``mueller`` [1/sr] in the one direction back to the source, mu_o = mu_i and phi = 180,
        (n_in, 4, 4); None where it was not asked for.
    jacobian
        Derivatives of ``mueller`` by the names that were asked for, each of its shape, per unit of the number; None
        where none was.
    reflectance_jacobian
        The same of ``reflectance``, each (n_in,).
    transmission_jacobian
        The same of ``transmission``; None where that is.
    direct_transmittance_jacobian
        The same of ``direct_transmittance``, each (n_in,).
    specular_jacobian
        The same of ``specular``; None where that is.

    Raises
    ------
    SceneError
        Where the shapes do not fit together.

    Examples
    --------
    >>> import vrte
    >>> haze = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=1.0, thickness=0.5)], vrte.Lambertian(1.0))
    >>> vrte.brdf(haze, mu_i=[0.3, 0.9], mu_o=[0.2, 0.5, 0.8], nodes=4).reflectance.round(9).tolist()
    [1.0, 1.0]
    """

    mueller: Array
    reflectance: Array
    mu_i: Array
    mu_o: Array
    phi: Array
    diagnostics: dict[str, Any]
    transmission: Array | None = None
    direct_transmittance: Array | None = None
    specular: Array | None = None
    specular_transmission: Array | None = None
    surface: Array | None = None
    coherent: Array | None = None
    jacobian: dict[str, Array] | None = None
    reflectance_jacobian: dict[str, Array] | None = None
    transmission_jacobian: dict[str, Array] | None = None
    direct_transmittance_jacobian: dict[str, Array] | None = None
    specular_jacobian: dict[str, Array] | None = None

    def __post_init__(self) -> None:
        incident = (np.size(self.mu_i),)
        matrices = (*incident, np.size(self.mu_o), np.size(self.phi), 4, 4)
        shapes: dict[str, tuple[int, ...]] = {"mueller": matrices, "transmission": matrices, "surface": matrices}
        shapes |= dict.fromkeys(("reflectance", "mu_i", "direct_transmittance"), incident)
        shapes |= dict.fromkeys(("specular", "specular_transmission", "coherent"), (*incident, 4, 4))
        shapes |= {"mu_o": (np.size(self.mu_o),), "phi": (np.size(self.phi),)}
        there = {name: shape for name, shape in shapes.items() if getattr(self, name) is not None}
        self._freeze(there)
        self._freeze_derivatives(BRDF_DERIVATIVES, there)

    def __repr__(self) -> str:
        extra = "" if self.transmission is None else ", with transmission"
        extra += describe_derivatives(self.jacobian) + describe_error(self.diagnostics)
        return f"Brdf({self.mu_i.size} mu_i, {self.mu_o.size} mu_o, {self.phi.size} phi{extra})"

    @property
    def specular_reflectance(self) -> Array | None:
        """The share (n_in,) of unpolarized light that is mirrored as a beam; None where no beam is."""
        return None if self.specular is None else self.specular[:, 0, 0]

    @property
    def total_reflectance(self) -> Array:
        """The share (n_in,) of unpolarized light that comes back, as a beam and diffuse."""
        return self.reflectance if self.specular is None else self.reflectance + self.specular[:, 0, 0]

    def as_base(self, average_mirrored: bool = False) -> TabulatedBase:
        """The base of another stack, in the medium of the light; `vrte.solve_base` chooses a grid of directions."""
        if self.diagnostics.get("illuminate", "top") != "top":
            raise SceneError("base: a BRDF that is lit from the bottom is no base; solve the stack upside down")
        index = self.diagnostics.get("index_outside")
        return TabulatedBase(self.mu_i, self.mu_o, self.phi, self.mueller, self.specular, index, average_mirrored)

    def under(self, light: Any, weights: Any = None, transmitted: bool = False, mirrored: bool = False) -> Array:
        """Stokes radiance (n_out, n_phi, 4) that comes out under any incident light, in its unit, (2:2).

        ``light`` is a function of broadcastable (mu_i, phi_deg) to (..., 4), or an array that broadcasts to (n_in,
        n_phi, 4), azimuths along the direction of travel; ``weights`` (n_in,) are those of a quadrature over mu_i from
        0 to 1, by default of `vrte.hemisphere`. ``phi`` must be all around in equal steps from 0, more of them than
        Fourier orders of BRDF and light together. ``transmitted``: scattered light that leaves the other face;
        ``mirrored`` adds what ``specular`` reflects, where each mu_o is one of mu_i.
        """
        matrices = self.transmission if transmitted else self.mueller
        if matrices is None:
            raise SceneError("no transmission here: ask vrte.brdf for it with transmission=True")
        check_azimuths(self.phi)
        falls_in = sample_incident_light(light, self.mu_i, self.phi)
        found = sum_outgoing_light(matrices, falls_in, self.mu_i, choose_weights(self.mu_i, weights))
        if not mirrored or self.specular is None:
            return found
        if transmitted or not np.isin(self.mu_o, self.mu_i).all():
            raise SceneError("mirrored light leaves the lit face along its own cosine: each mu_o must be one of mu_i")
        same = np.argmax(self.mu_i == self.mu_o[:, None], axis=1)  # mirrored light keeps cosine and azimuth
        return found + np.einsum("oij,opj->opi", self.specular[same], falls_in[same])

    def diffuse_reflectance(self, weights: Any = None) -> Array:
        """Radiance factor (n_out,) under an even unpolarized sky, mean over ``phi``, no specular reflection."""
        return self.under([1.0, 0.0, 0.0, 0.0], weights)[..., 0].mean(axis=1)

    def bihemispherical_reflectance(self, weights: Any = None) -> float:
        """Flux out over flux in under an even unpolarized sky, specular included; any ``phi`` will do."""
        return float(2.0 * (choose_weights(self.mu_i, weights) * self.mu_i) @ self.total_reflectance)


MOST_WAVELENGTHS = 10_000
SCENE = "scene_toml"  # in diagnostics: the text of the scene file
Found = TypeVar("Found", bound=Brdf | Field)


def share(name: str, words: str) -> Any:
    """A property of a spectrum: the directions that all of its BRDFs have."""
    return property(lambda spectrum: getattr(spectrum.brdfs[0], name), doc=words)


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

    mu_i = share("mu_i", "Cosines of incidence, (n_in,).")
    mu_o = share("mu_o", "Cosines of exit, (n_out,).")
    phi = share("phi", "Azimuths of exit from the incident light's [degrees], (n_phi,).")
    mueller = stack("mueller", "The BRDFs [1/sr], (n, n_in, n_out, n_phi, 4, 4), a new read-only array.")
    reflectance = stack("reflectance", "Directional-hemispherical reflectances of diffuse light, (n, n_in).")
    transmission = stack("transmission", "The BTDFs [1/sr], of the same shape as ``mueller``, or None.")
    direct_transmittance = stack("direct_transmittance", "Transmittance of the unscattered beam, (n, n_in), or None.")
    specular = stack("specular", "Mueller matrices of specular reflection of beams, (n, n_in, 4, 4), or None.")
    specular_transmission = stack("specular_transmission", "The same of beams through the other face, or None.")
    surface = stack("surface", "Light of rough surfaces alone [1/sr], of the shape of ``mueller``, or None.")
    coherent = stack("coherent", "What interference adds back to the source [1/sr], (n, n_in, 4, 4), or None.")
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
    """Raises SceneError where two BRDFs differ in directions, in the lit side or in the arrays that they hold."""
    for name in ("mu_i", "mu_o", "phi"):
        if not np.array_equal(getattr(first, name), getattr(other, name)):
            raise SceneError(f"brdfs must be for the same directions: {name} differs")
    for name in BRDF_DERIVATIVES:
        if list(getattr(first, name) or ()) != list(getattr(other, name) or ()):
            raise SceneError(f"brdfs must all have the same derivatives, in the same order: {name} differs")
    for name in ("transmission", "direct_transmittance", "coherent"):
        if (getattr(first, name) is None) != (getattr(other, name) is None):
            raise SceneError(f"brdfs must all have {name}, or none of them")
    if first.diagnostics.get("illuminate") != other.diagnostics.get("illuminate"):
        raise SceneError("brdfs must all be lit from the same side")


def add_scene_text(found: Found, text: str) -> Found:
    """The same with the text of its scene file in its diagnostics, where there is one."""
    return replace(found, diagnostics=found.diagnostics | {SCENE: text}) if text else found
