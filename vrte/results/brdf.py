"""The polarized subsurface BRDF of a scene, and its transmission."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.results.result import Result, tell_achieved, tell_derivatives
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
        shapes |= dict.fromkeys(("specular", "specular_transmission"), (*incident, 4, 4))
        shapes |= {"mu_o": (np.size(self.mu_o),), "phi": (np.size(self.phi),)}
        there = {name: shape for name, shape in shapes.items() if getattr(self, name) is not None}
        self._freeze(there)
        self._freeze_derivatives(BRDF_DERIVATIVES, there)

    def __getattr__(self, name: str) -> Any:
        if name != "diagnostics" or "_tell" not in vars(self):
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        found = vars(self)["diagnostics"] = vars(self)["_tell"]()
        vars(self).pop("_tell", None)
        return found

    def __repr__(self) -> str:
        extra = "" if self.transmission is None else ", with transmission"
        extra += tell_derivatives(self.jacobian) + tell_achieved(self.diagnostics)
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


def make_readonly_brdf(tell: Callable[[], dict[str, Any]], **given: Any) -> Brdf:
    """A result whose arrays are read-only and fit together; ``tell`` makes its diagnostics when they are asked for."""
    found = object.__new__(Brdf)
    found.__dict__.update(given, _tell=tell)
    return found
