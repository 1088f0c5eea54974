"""The OpenCL device: all scenes of a chunk go to it together. Particles are computed on the processor, as ever."""

from collections.abc import Iterable, Iterator

from vrte.sweep.chunks import Task, perform, together
from vrte.sweep.store import Work


def each(work: Work, tasks: Iterable[Task]) -> Iterator[int]:
    """Does the tasks in turn."""
    for task in tasks:
        yield perform(work, task, together, "opencl")
