"""Tables 1 to 3 and figure 1 of the GPU paper, measured here in its six configurations.

`vrte tables` measures the `problems` in every `Configuration`, in processes that `started` makes, and writes a page, a
CSV file and the figure.
"""

from vrte.studies.tables.children import Child, facts, started
from vrte.studies.tables.configurations import Configuration, chosen
from vrte.studies.tables.figure import write_figure
from vrte.studies.tables.measuring import ROUNDS, ROUNDS_QUICK, Measured, measure, require_all
from vrte.studies.tables.messages import Task
from vrte.studies.tables.page import as_text, write_page
from vrte.studies.tables.problems import Problem, problems

__all__ = [
    "ROUNDS",
    "ROUNDS_QUICK",
    "Child",
    "Configuration",
    "Measured",
    "Problem",
    "Task",
    "as_text",
    "chosen",
    "facts",
    "measure",
    "problems",
    "require_all",
    "started",
    "write_figure",
    "write_page",
]
