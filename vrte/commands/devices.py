"""`vrte devices`: OpenCL devices, how fast they are, and whether they are right."""

import argparse
import sys
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

from vrte.basics.errors import DeviceError
from vrte.basics.running import Run, count_usable_cpus, run_interruptible
from vrte.cl import device
from vrte.cl.device import Device
from vrte.commands.common import show_progress

NOTHING: Mapping[Any, Any] = MappingProxyType({})


def run(options: argparse.Namespace) -> None:
    run_interruptible(Run(1), lambda: show_devices(options))  # drivers compile for minutes, and hear no signal


def show_devices(options: argparse.Namespace) -> None:
    """The list, and what else is asked for. Raises DeviceError where a check does not pass."""
    found, complaints = device.devices(), dict[int, str]()
    with show_progress() as (phase, tick):
        phase("trying each device")
        for index in range(len(found)):
            tick(index, len(found))
            complaints[index] = device.find_complaint(index)
    try:
        taken, reason = device.choose(found, device.read_wanted_device(), device.find_complaint)
    except DeviceError:
        print(describe_devices(found, None, "for the reason below", complaints), flush=True)
        raise
    print(describe_devices(found, taken, reason, complaints))
    if options.measure:
        from vrte.commands.verify_device import describe_rates, measure_costs, measure_rates

        with device.raise_device_errors(), show_progress() as (phase, tick):
            phase("products")
            rates = measure_rates(device.session(), count_usable_cpus(), tick)
            costs = measure_costs(device.session())
        print(f"\n{costs}\n{describe_rates(rates, count_usable_cpus())}")
    if options.verify is not None:
        from vrte.commands.verify_device import verify_device

        wanted = None if options.verify < 0 else options.verify
        print()
        if complaint := verify_device(wanted, report=lambda line: print(f"  {line} ...", file=sys.stderr, flush=True)):
            sys.stdout.flush()
            raise DeviceError(complaint)


def describe_devices(
    found: Sequence[Device], taken: int | None, reason: str, complaints: Mapping[int, str] = NOTHING
) -> str:
    """A line a device, and which one is taken and why; complaints: of those that do not compute, by index."""
    columns = f"{'memory':>10}{'largest':>10}{'units':>7}  driver"
    lines = [f"     {'device':44}{'kind':13}{'fp64':4}{columns}"]
    for index, each in enumerate(found):
        precision = "yes" if each.double_precision else "no"
        sizes = "".join(f"{size / 1e9:7.1f} GB" for size in (each.memory, each.largest))
        text = f"{each.name[:43]:44}{each.kind:13}{precision:4}{sizes}{each.units:7}  {each.driver}"
        lines.append(f" {'*' if index == taken else ' '}{index:2} {text}")
        memory = "the processor's memory" if each.shared else "memory of its own"
        lines.append(f"     on {each.platform}" + (f"; {memory}" if each.kind == "gpu" else ""))
        if complaints.get(index):
            lines.append(f"     never taken: {complaints[index]}")
    return "\n".join([*lines, "", f"  taken: {'none' if taken is None else taken}, {reason}"])
