"""How the cost grows: figures 2 to 9 of the GPU paper, measured here, with fitted exponents beside its claims.

`vrte tables --figures` measures the `sweeps`, and writes `figures` and a `page`.
"""

from vrte.report.cost.figures import write_figures
from vrte.report.cost.measuring import (
    SECONDS_A_POINT,
    SECONDS_A_POINT_QUICK,
    Configuration,
    Measurement,
    configurations,
    left_out,
    measure,
)
from vrte.report.cost.others import OthersClock
from vrte.report.cost.page import as_text, write_page
from vrte.report.cost.sweeps import Axis, Point, axes
from vrte.report.pictures import require_pictures

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
