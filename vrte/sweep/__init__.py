"""Many scenes: a template and axes in, one labelled table out."""

from vrte.sweep.interpolation import interpolate
from vrte.sweep.run import sweep

__all__ = ["interpolate", "sweep"]
