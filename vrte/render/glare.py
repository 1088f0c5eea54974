"""Glare: light that is brighter than a screen shows, spread over a picture as an eye scatters it.

The point spread function is the total one of the CIE's committee on disability glare (Vos and van den Berg, CIE
Collection 135/1, 1999), of a young eye. Its integral over all directions is 1.03.
"""

import numpy as np

from vrte.basics.arrays import Array

PIGMENT = 0.5  # of a brown eye; 0 of the darkest, 1 of a green one


def find_spread(angle_deg: Array) -> Array:
    """The eye's point spread function [1/sr] at angles from where the light comes from."""
    square = np.asarray(angle_deg) ** 2
    core = 9.2e6 / (1.0 + square / 0.0046**2) ** 1.5 + 1.5e5 / (1.0 + square / 0.045**2) ** 1.5
    wide = 1.0 + square / 0.1**2
    return np.asarray(core + 400.0 / wide + 3e-8 * square + PIGMENT * (1300.0 / wide**1.5 + 0.8 / wide**0.5 + 2.5e-3))


def make_kernel(height: int, width: int, pixel_deg: float) -> Array:
    """The fraction of a pixel's light in the pixels around (2 height - 1, 2 width - 1), each ``pixel_deg`` wide; in the
    middle what the others leave."""
    down, across = (np.arange(1 - count, count) for count in (height, width))
    kernel = find_spread(pixel_deg * np.hypot(down[:, None], across)) * np.radians(pixel_deg) ** 2
    kernel[height - 1, width - 1] = 0.0
    kernel[height - 1, width - 1] = 1.0 - kernel.sum()
    return kernel


def spread_glare(xyz: Array, brightness: Array, pixel_deg: float) -> Array:
    """XYZ (height, width, 3) with what is beyond the screen's white, 1 of ``brightness`` (height, width), spread."""
    from scipy.signal import fftconvolve

    beyond = xyz * (1.0 - 1.0 / np.maximum(brightness, 1.0))[..., None]
    height, width = brightness.shape
    kernel = make_kernel(height, width, pixel_deg)[..., None]
    return np.asarray(xyz - beyond + np.maximum(fftconvolve(beyond, kernel, mode="same", axes=(0, 1)), 0.0))
