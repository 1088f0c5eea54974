"""The polarized subsurface BRDF of a scene, and its transmission."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.results.result import Result
from vrte.scene.illumination import check_azimuths, choose_weights, sample_incident_light, sum_outgoing_light
from vrte.scene.tabulated_base import TabulatedBase


@dataclass(frozen=True, eq=False, repr=False)
class Brdf(Result):
    """Mueller matrices of the light that comes back out: radiance out = mueller @ irradiance in.

    ``mueller`` (mu_i, mu_o, phi, 4, 4) [sr-1] is the subsurface BRDF in the meridian planes; ``reflectance`` (mu_i,) is
    directional-hemispherical, for unpolarized light. ``transmission`` (same shape as mueller, or None) is the like for
    diffuse light out of the face that is not lit (going down at the bottom, base included), ``direct_transmittance``
    (mu_i,) or None the beam's share that gets through unscattered. The lit face is the top, or as
    ``diagnostics["illuminate"]`` says. ``mu_i``, ``mu_o`` are positive cosines; ``phi`` [deg] is outgoing minus
    incident, both along the direction of travel: 0 is forward, 180 turns back. All arrays are read-only. Raises
    SceneError where the shapes do not fit together.

    Where light meets interfaces: ``specular`` (mu_i, 4, 4) or None is the share of a beam's power that comes back as a
    beam, mirrored, and ``specular_transmission`` (mu_i, 4, 4) or None the share that leaves the other face as one;
    neither is in ``mueller``, ``transmission`` or ``reflectance``. ``surface`` (shape of mueller) or None is the part
    of ``mueller`` that rough interfaces send back without any particle. mu_i and mu_o are cosines outside.
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

    def __post_init__(self) -> None:
        incident = (len(self.mu_i),)
        matrices = (*incident, len(self.mu_o), len(self.phi), 4, 4)
        shapes: dict[str, tuple[int, ...]] = {"mueller": matrices, "transmission": matrices, "surface": matrices}
        shapes |= dict.fromkeys(("reflectance", "mu_i", "direct_transmittance"), incident)
        shapes |= dict.fromkeys(("specular", "specular_transmission"), (*incident, 4, 4))
        shapes |= {"mu_o": (len(self.mu_o),), "phi": (len(self.phi),)}
        self._freeze({name: shape for name, shape in shapes.items() if getattr(self, name) is not None})

    def __repr__(self) -> str:
        extra = "" if self.transmission is None else ", with transmission"
        return f"Brdf({self.mu_i.size} mu_i, {self.mu_o.size} mu_o, {self.phi.size} phi{extra})"

    @property
    def specular_reflectance(self) -> Array | None:
        """The share (mu_i,) of unpolarized light that comes back as a beam; None where no beam does."""
        return None if self.specular is None else self.specular[:, 0, 0]

    @property
    def total_reflectance(self) -> Array:
        """The share (mu_i,) of unpolarized light that comes back, as a beam and diffuse."""
        return self.reflectance if self.specular is None else self.reflectance + self.specular[:, 0, 0]

    def as_base(self, average_mirrored: bool = False) -> TabulatedBase:
        """What was solved, as the base of another stack: `vrte.Scene` asks for it where a Brdf is its base.

        It lies in the medium that the light came from. The grid of directions counts: `vrte.solve_base` chooses one.
        ``average_mirrored``, errors and warnings as for `vrte.TabulatedBase`; a SceneError where the light came from
        the bottom.
        """
        if self.diagnostics.get("illuminate", "top") != "top":
            raise SceneError("base: a BRDF that is lit from the bottom is no base; solve the stack upside down")
        index = self.diagnostics.get("index_outside")
        return TabulatedBase(self.mu_i, self.mu_o, self.phi, self.mueller, self.specular, index, average_mirrored)

    def under(self, light: Any, weights: Any = None, transmitted: bool = False, mirrored: bool = False) -> Array:
        """Stokes radiance (mu_o, phi, 4) that comes out under any incident light, (2:2).

        Parameters: ``light``, Stokes radiance on the face that is lit, a function of broadcastable (mu_i, phi_deg) or
        an array that broadcasts to (mu_i, phi, 4), azimuths along the direction of travel; ``weights`` (mu_i,) of a
        quadrature over mu_i from 0 to 1, those of `vrte.hemisphere` where left out; ``transmitted`` for what leaves the
        other face (scattered light only: unscattered light goes on as a beam); ``mirrored`` adds what ``specular``
        sends back, which is left out otherwise: each mu_o must then be one of mu_i. The BRDF needs ``phi`` all around
        in equal steps from 0, more of them than Fourier orders of BRDF and light together; the sum over mu_i is as good
        as the weights. Raises SceneError for bad input.

        >>> import vrte
        >>> white = vrte.Scene([vrte.Layer(vrte.isotropic(), albedo=0.5, thickness=0.0)], vrte.Lambertian(0.25))
        >>> f = vrte.brdf(white, vrte.hemisphere(4)[0], mu_o=0.5, phi=[0, 90, 180, 270], nodes=4)
        >>> round(float(f.under([1.0, 0.0, 0.0, 0.0])[0, 0, 0]), 12)
        0.25
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
        """The radiance factor (mu_o,) under an evenly white, unpolarized sky: radiance out over that of a white
        Lambertian surface, without what is mirrored. Parameters and errors as for `under`."""
        return self.under([1.0, 0.0, 0.0, 0.0], weights)[..., 0].mean(axis=1)

    def bihemispherical_reflectance(self, weights: Any = None) -> float:
        """Flux out over flux in under such a sky, mirrored light included, from ``total_reflectance``; any ``phi`` will
        do. ``weights`` as for `under`."""
        return float(2.0 * (choose_weights(self.mu_i, weights) * self.mu_i) @ self.total_reflectance)
