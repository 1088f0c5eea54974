"""Plotly figures of results, phase matrices and measurements, as the viewer shows them.

The light is inside the host medium, before any refraction at its surface, where titles say "subsurface".
"""

from vrte.pictures.fit import SCENE, measurement
from vrte.pictures.lobes import lobe
from vrte.pictures.results import coefficients, cuts, field_polar, reflectance, scattering_matrix, spectra

__all__ = [
    "SCENE",
    "coefficients",
    "cuts",
    "field_polar",
    "lobe",
    "measurement",
    "reflectance",
    "scattering_matrix",
    "spectra",
]
