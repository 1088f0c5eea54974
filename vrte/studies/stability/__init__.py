"""Every digit, in stiff and extreme scenes: the scenes, what is checked of each, and the table of what was found.

A covering array of the axes in `scenes` and the named `corners` are solved and checked against stored answers of ball
arithmetic where there are any, and against the laws that every answer has to keep. `vrte stability` runs it all.
"""

from vrte.studies.stability.cases import all_cases, matching, oracle_cases, quick_cases
from vrte.studies.stability.corners import corner_cases
from vrte.studies.stability.run import Record, require_all, run_cases
from vrte.studies.stability.scenes import (
    LOBE_AMPLITUDE,
    LOBE_MATRIX,
    LOBE_WIDTH_DEG,
    Case,
    Slab,
    covering_cases,
    mueller_lobe,
)
from vrte.studies.stability.solving import Options
from vrte.studies.stability.table import as_markdown, as_text, write_tables

__all__ = [
    "LOBE_AMPLITUDE",
    "LOBE_MATRIX",
    "LOBE_WIDTH_DEG",
    "Case",
    "Options",
    "Record",
    "Slab",
    "all_cases",
    "as_markdown",
    "as_text",
    "corner_cases",
    "covering_cases",
    "matching",
    "mueller_lobe",
    "oracle_cases",
    "quick_cases",
    "require_all",
    "run_cases",
    "write_tables",
]
