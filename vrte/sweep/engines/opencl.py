"""The OpenCL device: all scenes of a chunk go to it together. Particles are computed on the processor, as ever."""

from collections.abc import Iterable, Iterator

from vrte.sweep.chunks import Task, perform, solve_on_device
from vrte.sweep.store import Work


def perform_tasks(work: Work, tasks: Iterable[Task]) -> Iterator[int]:
    """Does the tasks in turn."""
    for task in tasks:
        yield perform(work, task, solve_on_device, "opencl")
