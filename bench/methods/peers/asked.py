"""What is asked of a code other than vrte, and what it answers, in vrte's frame."""

from dataclasses import dataclass

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.results.field import Field
from vrte.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class Asked:
    """As `vrte.radiance` takes it: mu0, stokes (4,) of the beam, signed mu (n_mu,), phi (n_phi,) in degrees, tau
    (n_tau,)."""

    scene: Scene
    mu0: float
    stokes: Array
    mu: Array
    phi: Array
    tau: Array

    @property
    def flux(self) -> float:
        """Of the beam, perpendicular to it."""
        return float(self.stokes[0])

    @property
    def depth(self) -> Array:
        """Optical depth below the top of the bottom of each layer, (layer,)."""
        return np.cumsum([layer.thickness for layer in self.scene.layers])

    @property
    def albedos(self) -> Array:
        """Of single scattering, (layer,)."""
        return np.array([layer.albedo for layer in self.scene.layers])

    @property
    def terms(self) -> int:
        """Most terms of a phase matrix."""
        return max(layer.phase_matrix.terms for layer in self.scene.layers)

    @property
    def is_scalar(self) -> bool:
        """Whether no phase matrix polarizes."""
        return all(layer.phase_matrix.is_scalar for layer in self.scene.layers)

    @property
    def base_albedo(self) -> float:
        """Of a Lambertian base, 0 of a black one."""
        return self.scene.below.even_albedo

    def legendre(self, terms: int) -> Array:
        """Moments of the phase functions without the factor 2 l + 1, (layer, terms), zeros behind what there is."""
        found = np.zeros((len(self.scene.layers), terms))
        for moments, layer in zip(found, self.scene.layers, strict=True):
            a1 = layer.phase_matrix.a1[:terms]
            moments[: a1.size] = a1 / (2.0 * np.arange(a1.size) + 1.0)
        return found

    def check(self, name: str, polarization: bool, conservative: bool = True) -> None:
        """Raises SceneError, which names the peer, for what no such code takes, and for polarization and albedo 1 where
        this one does not."""
        if not np.isfinite(self.scene.thickness):
            raise SceneError(f"{name} takes no layer without end")
        if self.scene.keeps_beams:
            raise SceneError(f"{name} takes no refracting or mirroring surface here")
        if self.scene.base is not None and self.scene.base.orders_reflected > 1:
            raise SceneError(f"{name} takes no base {self.scene.base.name} here: black or Lambertian alone")
        if self.stokes[1:].any():
            raise SceneError(f"{name} takes no polarized beam")
        if not (polarization or self.is_scalar):
            raise SceneError(f"{name} takes no polarization: scalar phase functions alone")
        if not conservative and (self.albedos == 1.0).any():
            raise SceneError(f"{name} takes no albedo of 1")

    def answer(self, stokes: Array, flux_up: Array, flux_down: Array) -> Field:
        """What was found: stokes (n_tau, n_mu, n_phi, 4), diffuse fluxes (n_tau,); NaN where the code does not tell."""
        direct = self.mu0 * self.flux * np.exp(-self.tau / self.mu0)
        described = self.tau, self.mu, self.phi, self.mu0, self.stokes
        return Field(stokes, flux_up, flux_down, direct, *described, {})


def make_unpolarized(intensity: Array) -> Array:
    """Stokes vectors (..., 4) of a scalar code's intensity (...). Raises ArithmeticError as `finite` does."""
    stokes: Array = np.zeros((*intensity.shape, 4))
    stokes[..., 0] = require_finite(intensity)
    return stokes


def require_finite(values: Array) -> Array:
    """The values, which have to be numbers. Raises ArithmeticError."""
    if not np.isfinite(values).all():
        raise ArithmeticError("NaN or inf among the radiances")
    return values
