"""How a layer of particles that scatter independently changes with what it is made of, in closed form."""

from dataclasses import dataclass

import numpy as np

from vrte.basics.arrays import Array

TINY = 1e-100  # the step of an imaginary part, whose square is nothing: derivatives come out to all digits


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


def vary_layer(filling: Filling, change: Filling, by_volume: bool, is_length: bool) -> tuple[float, float, Array]:
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
