"""How long a GPU would take, from what a solve asks of it: a model, see docs/how_to/opencl.md, and no measurement.

The host's calls are followed one by one: each takes the processor time that it takes here, a launch then waits for the
device to be free, and a read for the launch before it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from vrte.studies.device_counts import Event, Work

LATENCY = 0.6e-6  # seconds that a work-item waits for memory that is in no cache
SECTOR = 32.0  # bytes that one waits for at once
CLOCKS = 4.0  # between two multiply-adds of a work-item
SCHEDULERS = 4.0  # of a unit: as many warps keep it busy
GROUPS, THREADS = 32.0, 2048.0  # work-groups and work-items that a unit holds at most


@dataclass(frozen=True)
class Machine:
    """A GPU: compute units, their clock (Hz), multiply-adds a unit and clock in doubles and in floats, bytes a second
    of memory and of the way to the host, work-items in step (``warp``), bytes of local memory a unit and clock, and
    seconds that a launch and a blocking read cost beside their work, and a call of the driver costs the host."""

    name: str
    units: float
    clock: float
    doubles: float
    singles: float
    bandwidth: float
    link: float
    warp: int
    local: float
    launch: float
    read: float
    call: float

    @property
    def peak(self) -> float:
        """Operations in doubles a second."""
        return 2.0 * self.units * self.doubles * self.clock


# Units, clocks, rates, bandwidths: NVIDIA H100 Tensor Core GPU data sheet and architecture paper (SXM5), A100 80GB data
# sheet (SXM), Ada architecture paper (RTX 4090), AMD Instinct MI300X data sheet; the link is PCIe of 16 lanes, one way.
# Local memory: 128 bytes a clock and unit in NVIDIA's programming guide and in AMD's CDNA 3 paper. The seconds of a
# launch, a read and a call are assumptions: no data sheet has them.
MACHINES: Mapping[str, Machine] = MappingProxyType(
    {
        machine.name: machine
        for machine in (
            Machine("H100", 132, 1.98e9, 64, 128, 3.35e12, 64e9, 32, 128, 3e-6, 12e-6, 4e-6),
            Machine("A100", 108, 1.41e9, 32, 64, 2.04e12, 32e9, 32, 128, 3e-6, 12e-6, 4e-6),
            Machine("RTX 4090", 128, 2.52e9, 2, 128, 1.01e12, 32e9, 32, 128, 3e-6, 12e-6, 4e-6),
            Machine("MI300X", 304, 2.10e9, 64, 128, 5.3e12, 64e9, 64, 128, 6e-6, 25e-6, 6e-6),
        )
    }
)


@dataclass(frozen=True)
class Forecast:
    """Seconds in all, of the host's processor and of the device; the device's by kernel, and by what holds it up."""

    seconds: float
    host: float
    device: float
    kernels: Mapping[str, float]
    limits: Mapping[str, float]


def predict_launch(machine: Machine, event: Event, scale: float = 1.0) -> tuple[float, str]:
    """Seconds of a launch on an idle device, and what holds it up; ``scale``: times as many work-groups and work."""
    work, groups, lanes = event.work, max(1.0, event.groups * scale), event.lanes
    warps = -(-lanes // machine.warp)
    used = min(machine.units, groups)
    held = min(GROUPS, max(1.0, THREADS / (warps * machine.warp)))  # work-groups of a unit at a time
    waves = max(1.0, groups / (machine.units * held))
    resident = min(groups / used, held)
    busy = lanes / (warps * machine.warp) * min(1.0, warps * resident / SCHEDULERS) * used / machine.units
    in_flight = used * resident * lanes * SECTOR / LATENCY
    flops_each = scale * work.flops / (groups * lanes)
    took = {
        "multiplying": scale * work.flops / (machine.peak * busy),
        "memory": scale * work.bytes / machine.bandwidth,
        "waiting for memory": max(scale * work.bytes / in_flight, waves * work.rounds * LATENCY),
        "local memory": scale * work.local / (machine.local * machine.clock * used),
        "one work-item after the other": waves * flops_each * CLOCKS / (2.0 * machine.clock),
    }
    limit = max(took, key=took.__getitem__)
    return machine.launch + took[limit], limit if took[limit] > machine.launch else "launching"


def predict_run(machine: Machine, events: Sequence[Event], scale: float = 1.0, host: float = 1.0) -> Forecast:
    """The host's clock and the device's, call after call; ``scale``: times as much work in each launch and copy,
    ``host``: times as much time of the host."""
    now = ready = at_work = 0.0
    kernels: dict[str, float] = {}
    limits: dict[str, float] = {}
    for event in events:
        now += host * event.host + (machine.call if event.what != "host" else 0.0)
        if event.what == "launch":
            seconds, limit = predict_launch(machine, event, scale)
            kernels[event.name] = kernels.get(event.name, 0.0) + seconds
        elif event.what == "fill":
            seconds, limit = machine.launch + scale * event.bytes / machine.bandwidth, "filling"
        elif event.what == "call":
            continue
        elif event.what in ("wait", "host"):
            now = max(now, ready)
            continue
        else:
            seconds, limit = scale * event.bytes / machine.link, "copying"
        limits[limit] = limits.get(limit, 0.0) + seconds
        ready = max(now, ready) + seconds
        at_work += seconds
        if event.what in ("read", "put"):
            now = max(now, ready) + machine.read
    calls = machine.call * sum(event.what != "host" for event in events)
    return Forecast(max(now, ready), calls + host * sum(event.host for event in events), at_work, kernels, limits)


def add_work(events: Sequence[Event]) -> Work:
    """Of all launches together."""
    return Work(*(sum(getattr(event.work, name) for event in events) for name in ("flops", "bytes", "local", "rounds")))
