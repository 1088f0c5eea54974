"""Plotly figures of results and phase matrices, as the viewer shows them: each small enough to be sent at every click.

The light is inside the host medium, before any refraction at its surface: titles say "subsurface".
"""

from vrte.app.lobe_figure import lobe
from vrte.app.phase_figures import coefficients, scattering_matrix
from vrte.app.polar_figures import cuts, field_polar
from vrte.app.reflectance import reflectance

__all__ = ["coefficients", "cuts", "field_polar", "lobe", "reflectance", "scattering_matrix"]
