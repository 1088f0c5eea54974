"""Requested against achieved accuracy, scene by scene: `python -m vrte.studies.accuracy -o FOLDER`."""

from vrte.studies.accuracy.fewest import fewest_that_hold, ratios, read_errors
from vrte.studies.accuracy.page import as_text, write_pages
from vrte.studies.accuracy.scenes import PROBES, Probe, probe
from vrte.studies.accuracy.sweep import CHOSEN, GIVEN, Outcome, median_slack, quick_names, sweep

__all__ = [
    "CHOSEN",
    "GIVEN",
    "PROBES",
    "Outcome",
    "Probe",
    "as_text",
    "fewest_that_hold",
    "median_slack",
    "probe",
    "quick_names",
    "ratios",
    "read_errors",
    "sweep",
    "write_pages",
]
