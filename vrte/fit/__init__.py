"""From a measurement back to the material: least squares over the numbers of a scene."""

from vrte.fit.measurement import Measurement, read_measurement
from vrte.fit.result import Fit
from vrte.fit.run import fit

__all__ = ["Fit", "Measurement", "fit", "read_measurement"]
