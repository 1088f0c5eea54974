"""How a scene changes with one of its numbers: what derivatives of its light are made of; and in closed form how a
layer of particles that scatter independently changes with what it is made of."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vrte.basics.arrays import Array, freeze_copy
from vrte.basics.errors import SceneError
from vrte.scene.boundary import Boundary
from vrte.scene.scene import Scene

TINY = 1e-100  # the step of an imaginary part, whose square is nothing: derivatives come out to all digits


@dataclass(frozen=True, eq=False)
class Variation:
    """How the layers and the base of a scene change with one number p, per unit of p.

    `vrte.SceneFamily` and the names of ``derivatives=`` make them; one's own is a direction in the space of all that
    light meets, such as a phase matrix on its way to another one.

    Attributes
    ----------
    name
        What p is called, such as "particles.gold.radius_um".
    value
        p as it is.
    thickness
        Derivatives of the optical thicknesses, (layer,).
    albedo
        Derivatives of the albedos, (layer,).
    coefficients
        Of the expansion coefficients, for each layer (terms, 6): a1, a2, a3, a4, b1, b2; no rows where none changes.
        a1[0] is 1 whatever p is, so its derivative is 0.
    base
        Weights and boundaries whose weighted sum is the derivative of what the base reflects; empty where it stays.
    scene_at
        The scene as a function of p, where that is known.
    is_outside
        Whether p moves more than layers and base: a refractive index of a medium, a surface. Derivatives then come from
        differences of whole solves of ``scene_at``.

    Raises
    ------
    SceneError
        Where lengths do not agree, a derivative is not finite, a1[0] changes, or ``scene_at`` is missing.

    Examples
    --------
    >>> import vrte
    >>> deeper = vrte.Variation("depth", value=1.0, thickness=[1.0], albedo=[0.0])
    >>> deeper.coefficients[0].shape
    (0, 6)
    """

    name: str
    value: float
    thickness: Array
    albedo: Array
    coefficients: tuple[Array, ...] = ()
    base: tuple[tuple[float, Boundary], ...] = ()
    scene_at: Callable[[float], Scene] | None = None
    is_outside: bool = False

    def __post_init__(self) -> None:
        thickness, albedo = (freeze_copy(np.asarray(part, float)) for part in (self.thickness, self.albedo))
        tables = tuple(freeze_copy(np.asarray(part, float)) for part in self.coefficients)
        tables = tables or (freeze_copy(np.zeros((0, 6))),) * thickness.size
        wrong = ""
        if thickness.ndim != 1 or albedo.shape != thickness.shape or len(tables) != thickness.size:
            wrong = "derivatives of thickness, albedo and coefficients must be one a layer"
        elif any(table.ndim != 2 or table.shape[1] != 6 for table in tables):
            wrong = "derivatives of coefficients must be (terms, 6) in each layer"
        elif not all(np.isfinite(part).all() for part in (thickness, albedo, *tables)):
            wrong = "derivatives must be finite"
        elif any(table.size and table[0, 0] != 0.0 for table in tables):
            wrong = "a1[0] is 1 and cannot change"
        elif self.is_outside and self.scene_at is None:
            wrong = "what moves media or surfaces needs scene_at"
        if wrong:
            raise SceneError(wrong, "derivatives", self.name)
        vars(self).update(thickness=thickness, albedo=albedo, coefficients=tables)

    @property
    def changes_nothing(self) -> bool:
        """Whether no layer and no base change, and nothing outside them."""
        same = not (self.thickness.any() or self.albedo.any() or any(table.any() for table in self.coefficients))
        return same and not any(weight for weight, _ in self.base) and not self.is_outside


@dataclass(frozen=True, eq=False)
class Filling:
    """What `vrte.Layer.of` makes a layer of, or what that changes by with a number: ``shares`` (kinds,) by number or by
    volume; cross sections [um2], volumes [um3] (kinds,) and coefficients (kinds, terms, 6); ``absorption`` of the host
    [1/um]; ``fraction`` of the volume, 0 where it plays no part; ``extent``: optical thickness, or [um]."""

    shares: Array
    extinction: Array
    scattering: Array
    volume: Array
    coefficients: Array
    absorption: Array
    fraction: Array
    extent: Array


def vary_filling(filling: Filling, change: Filling, by_volume: bool, is_length: bool) -> tuple[float, float, Array]:
    """Derivatives of a layer's optical thickness, albedo and coefficients (terms, 6), by a step in the complex plane,
    which subtracts nothing. Source: W. Squire and G. Trapp, SIAM Review 40, 110 (1998)."""
    pairs = zip(vars(filling).values(), vars(change).values(), strict=True)
    stepped = Filling(*(value + 1j * TINY * slope for value, slope in pairs))
    thickness, albedo, coefficients = assemble_layer(stepped, by_volume, is_length)
    slopes = np.asarray(coefficients).imag / TINY
    slopes[0, 0] = 0.0  # of a1[0], which is 1, but for rounding
    return float(thickness.imag / TINY), float(albedo.imag / TINY), slopes


def assemble_layer(filling: Filling, by_volume: bool, is_length: bool) -> tuple[Array, Array, Array]:
    """Optical thickness, albedo and coefficients: the formulas of `vrte.mixture` and `vrte.Layer.of` without checks, of
    real numbers or complex ones."""
    shares = filling.shares / filling.volume if by_volume else filling.shares
    shares = shares / shares.sum()
    extinction, scattering, volume = (
        shares @ each for each in (filling.extinction, filling.scattering, filling.volume)
    )
    coefficients = np.tensordot(shares * filling.scattering, filling.coefficients, 1) / scattering
    if filling.fraction == 0.0:
        return filling.extent, scattering / extinction, coefficients
    scattered, extinguished = filling.fraction / volume * scattering, filling.fraction / volume * extinction
    extinguished = extinguished + (1.0 - filling.fraction) * filling.absorption
    return filling.extent * (extinguished if is_length else 1.0), scattered / extinguished, coefficients
