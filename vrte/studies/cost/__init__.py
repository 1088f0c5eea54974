"""How the cost grows: figures 2 to 9 of the GPU paper, measured here, with fitted exponents beside its claims.

`vrte tables --figures` measures the `sweeps`, and writes `figures` and a `page`.
"""

from vrte.pictures.figures import require_pictures
from vrte.studies.cost.figures import write_figures
from vrte.studies.cost.measuring import (
    SECONDS_A_POINT,
    SECONDS_A_POINT_QUICK,
    Configuration,
    Measurement,
    configurations,
    left_out,
    measure,
)
from vrte.studies.cost.others import OthersClock
from vrte.studies.cost.page import as_text, write_page
from vrte.studies.cost.sweeps import Axis, Point, axes

__all__ = [
    "SECONDS_A_POINT",
    "SECONDS_A_POINT_QUICK",
    "Axis",
    "Configuration",
    "Measurement",
    "OthersClock",
    "Point",
    "as_text",
    "axes",
    "configurations",
    "left_out",
    "measure",
    "require_pictures",
    "write_figures",
    "write_page",
]
