"""Error against run time of every method, scene by scene: `vrte report -o FOLDER`."""

from vrte.studies.methods.knobs import Curve, Setting, curves
from vrte.studies.methods.measuring import CSV, FULL, HASTE, measure, steps_of
from vrte.studies.methods.page import as_text, require_page, write_page
from vrte.studies.methods.records import Row
from vrte.studies.methods.registry import registry_table
from vrte.studies.methods.scenes import CASES, QUICK, Case, case, matching

__all__ = [
    "CASES",
    "CSV",
    "FULL",
    "HASTE",
    "QUICK",
    "Case",
    "Curve",
    "Row",
    "Setting",
    "as_text",
    "case",
    "curves",
    "matching",
    "measure",
    "registry_table",
    "require_page",
    "steps_of",
    "write_page",
]
