"""Plotly figures of results and phase matrices, as the viewer shows them: each small enough to be sent at every click.

The light is inside the host medium, before any refraction at its surface: titles say "subsurface".
"""

from vrte.app.figures.lines import coefficients, reflectance, scattering_matrix, spectra
from vrte.app.figures.lobe import lobe
from vrte.app.figures.measurement import SCENE, measurement
from vrte.app.figures.polar import cuts, field_polar

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
