"""From a measurement back to the material, and from a target to a recipe: the numbers of a scene that meet either."""

from vrte.fit.match import Match, match
from vrte.fit.measurement import Measurement, read_measurement
from vrte.fit.result import Fit
from vrte.fit.run import fit

__all__ = ["Fit", "Match", "Measurement", "fit", "match", "read_measurement"]
