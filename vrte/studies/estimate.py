"""What a GPU that is not at hand would make of gold: counts from real runs of the form for a GPU, times by a model."""

import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from vrte.basics.errors import DeviceError
from vrte.calls.brdf import brdf
from vrte.calls.brdfs import brdfs
from vrte.cl import device
from vrte.cl.session import WORK_GROUP, open_session
from vrte.optics.particles import Particles
from vrte.optics.spheres import spheres
from vrte.scene.layer import Layer
from vrte.scene.scene import Scene
from vrte.studies.device_counts import Event, Recorder, make_recorder, record_events
from vrte.studies.device_model import MACHINES, Forecast, Machine, add_work, predict_run
from vrte.studies.devices import Costs

Told = Callable[[int, int], None]
Task = Callable[[int], object]
BATCH, PART = 64, 8  # scenes of a batch, and those of it that are really solved
MU, PHI, NODES = np.linspace(0.05, 1.0, 20), np.arange(0.0, 361.0, 10.0), 40
EVERY, THIS = "all", "this"
TIMES = 7


@dataclass(frozen=True, eq=False)
class Counted:
    """A task's events; ``scale``: how many times as much work the whole task is, ``host``: times as much time of the
    host; ``brdfs``: how many of them it makes."""

    name: str
    events: Sequence[Event]
    brdfs: int = 1
    scale: float = 1.0
    host: float = 1.0

    def count(self, what: str) -> int:
        """How many events are of a kind."""
        return sum(event.what == what for event in self.events)


@cache
def make_powder(wavelength_um: float) -> Particles:
    """The paper's gold powder (Table 3)."""
    return spheres("gold", radius_um=0.6, wavelength_um=wavelength_um)


def make_gold(thickness: float, wavelength_um: float = 0.4, turn: int = 0) -> Scene:
    """A layer of it, a trifle thicker at each ``turn``, so that nothing is remembered of the turn before."""
    return Scene([Layer.of(make_powder(wavelength_um), thickness=thickness * (1.0 + 1e-10 * turn))])


def list_tasks(part: int = PART, nodes: int = NODES) -> dict[str, tuple[int, Task]]:
    """By name, how many BRDFs a call makes, and the call, which is told its turn: one of thick gold, one of optical
    thickness 5 by doubling, and a part of a batch."""
    wavelengths = np.linspace(0.39, 0.41, part).tolist()
    asked: Any = {"mu_i": MU, "mu_o": MU, "phi": PHI, "nodes": nodes, "backend": "opencl"}

    def solve_batch(count: int) -> Task:
        return lambda turn: brdfs([make_gold(100.0, each, turn) for each in wavelengths[:count]], **asked)

    return {
        "thick gold": (1, lambda turn: brdf(make_gold(100.0, turn=turn), **asked, algorithm="invariance")),
        "tau 5, doubling": (1, lambda turn: brdf(make_gold(5.0, turn=turn), **asked, algorithm="doubling")),
        f"batch of {BATCH}": (part, solve_batch(part)),
    }


def count_tasks(
    recorder: Recorder, told: Told = lambda done, total: None, part: int = PART, nodes: int = NODES
) -> list[Counted]:
    """What each task asks of a device, as the recorder's session solves it, which must be the one that is taken."""
    found, calls = {}, list_tasks(part, nodes)
    for done, (name, (count, call)) in enumerate(calls.items()):
        told(done, len(calls))
        found[name] = Counted(name, count_events(recorder, call), count)
    one, _, some = found.values()
    alone, host = (sum(event.host for event in each.events) for each in (one, some))
    each = max(host - alone, 0.0) / max(some.brdfs - 1, 1)
    grown = (host + each * (BATCH - some.brdfs)) / host
    found[some.name] = replace(some, brdfs=BATCH, scale=BATCH / some.brdfs, host=grown)
    return list(found.values())


def count_events(recorder: Recorder, call: Task) -> list[Event]:
    """What a solve asks for: solved once to weigh each launch, then for the host's time without the device; of a few
    times the least."""
    call(0)  # what is made once a process
    with record_events(recorder, weighing=True) as weighed:
        call(1)
    timed = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of results that were not computed
        for turn in range(TIMES):
            with record_events(recorder) as events:
                call(2 + turn)
            timed.append(events)
    if len({len(events) for events in (weighed, *timed)}) > 1:
        raise AssertionError("the same solve asked for other things")
    quick = min(timed, key=lambda events: sum(event.host for event in events))
    return [replace(event, host=other.host) for event, other in zip(weighed, quick, strict=True)]


def open_recorder(found: device.Device) -> Recorder:
    """A recorder on a device, in the form for a GPU.

    Raises DeviceError where its work-groups are too small for that form.
    """
    if found.handle.max_work_group_size < WORK_GROUP:
        raise DeviceError(f"{found.name} has no work-groups of {WORK_GROUP}: nothing to count the form for a GPU on")
    return make_recorder(open_session(found.handle, form="gpu"))


def find_machines(name: str) -> list[Machine]:
    """Those of a name, or all. Raises DeviceError for another name."""
    if name == EVERY:
        return list(MACHINES.values())
    wanted = make_squeezed(name)
    found = [machine for key, machine in MACHINES.items() if wanted in make_squeezed(key)]
    if len(found) != 1:
        raise DeviceError(f"no figures of {name!r}: choose one of {', '.join(MACHINES)}, {EVERY} or {THIS}")
    return found


def describe_device(found: device.Device, costs: Costs) -> Machine:
    """A device at hand as the model sees it: what it says of itself, and what was measured."""
    doubles = found.rate / (2.0 * found.units * found.clock)
    warp = 64 if found.architecture.startswith("gfx9") else 32
    figures = doubles, doubles, costs.bandwidth, costs.link, warp, 128.0, costs.launch, costs.read, costs.launch
    return Machine(found.name, found.units, found.clock, *figures)


def time_tasks(told: Told = lambda done, total: None, part: int = PART, nodes: int = NODES) -> dict[str, float]:
    """Seconds of each task on the device that is taken, and of its BRDFs one; the quicker of two runs."""
    found, calls = {}, list_tasks(part, nodes)
    for done, (name, (count, call)) in enumerate(calls.items()):
        told(done, len(calls))
        seconds = []
        for turn in range(3):  # the first has the compiler's time
            start = time.perf_counter()
            call(turn)
            seconds.append((time.perf_counter() - start) / count)
        found[name] = min(seconds[1:])
    return found


def describe_times(name: str, seconds: Mapping[str, float], costs: Costs) -> str:
    """What was measured on a device."""
    lines = [
        f"  {name}, measured: a launch {1e6 * costs.launch:.1f} us, a blocking read {1e6 * costs.read:.1f} us, "
        f"memory {costs.bandwidth / 1e9:.0f} GB/s, to the device {costs.link / 1e9:.1f} GB/s",
        *(f"  {task:18}{1e3 * taken:10.1f} ms a BRDF{1 / taken:8.1f} a second" for task, taken in seconds.items()),
    ]
    return "\n".join(lines)


def make_squeezed(name: str) -> str:
    """A name as people write it."""
    return name.casefold().replace(" ", "")


def describe_estimate(tasks: Sequence[Counted], machines: Sequence[Machine]) -> str:
    """The counts of each task, and what each machine makes of them by the model."""
    lines = [f"  {'counted':18}{'launches':>9}{'reads':>7}{'Gflop':>8}{'GB':>7}{'host ms':>9}"]
    for task in tasks:
        work, host = add_work(task.events), 1e3 * task.host * sum(event.host for event in task.events)
        sizes = f"{task.scale * work.flops / 1e9:8.1f}{task.scale * work.bytes / 1e9:7.2f}{host:9.1f}"
        lines.append(f"  {task.name:18}{task.count('launch'):9}{task.count('read'):7}{sizes}")
    for machine in machines:
        lines += [
            "",
            f"  {machine.name + ', by the model':34}{'ms':>8}{'device ms':>11}{'BRDFs a second':>16}  held up by",
        ]
        for task in tasks:
            found = predict_run(machine, task.events, task.scale, task.host)
            times = f"{1e3 * found.seconds:8.1f}{1e3 * found.device:11.1f}{task.brdfs / found.seconds:16.0f}"
            lines.append(f"  {task.name:34}{times}  {describe_limits(found)}")
    return "\n".join(lines)


def describe_limits(found: Forecast) -> str:
    """The host where it takes most of the time, otherwise what most of the device's time goes to."""
    if found.host > 0.5 * found.seconds:
        return f"the host ({100 * found.host / found.seconds:.0f} %)"
    shares = sorted(found.kernels.items(), key=lambda pair: -pair[1])[:2]
    named = ", ".join(f"{name} {100 * seconds / found.device:.0f} %" for name, seconds in shares)
    return f"{max(found.limits, key=found.limits.__getitem__)} ({named})"
