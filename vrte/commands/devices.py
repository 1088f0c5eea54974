"""`vrte devices`: OpenCL devices, and what they can do."""

import argparse
from typing import Any

from vrte.basics.errors import DeviceError
from vrte.commands.common import add_command, show_progress


def add(commands: Any) -> None:
    """Adds `vrte devices`, which lists OpenCL devices, to the commands."""
    told = "a list of OpenCL platforms and devices, and which one is taken"
    devices = add_command(
        commands,
        "devices",
        run,
        told,
        ("vrte devices", "what there is, and which one is taken"),
        ("vrte devices --measure", "and how many products each computes in a second"),
    )
    devices.add_argument("--measure", action="store_true", help="products a second, beside BLAS; some seconds")


def run(options: argparse.Namespace) -> None:
    from vrte.basics.running import count_usable_cpus
    from vrte.cl import device
    from vrte.studies import devices

    found = device.devices()
    with show_progress() as (phase, tick):
        phase("trying each device")
        complaints = {}
        for index in range(len(found)):
            tick(index, len(found))
            complaints[index] = device.find_complaint(index)
    try:
        taken, reason = device.choose(found, device.read_wanted_device(), device.find_complaint)
    except DeviceError:
        print(devices.describe_devices(found, None, "for the reason below", complaints), flush=True)
        raise
    print(devices.describe_devices(found, taken, reason, complaints))
    if options.measure:
        with device.raise_device_errors(), show_progress() as (phase, tick):
            phase("products")
            rates = devices.measure_rates(device.session(), count_usable_cpus(), tick)
        print(f"\n{devices.describe_rates(rates, count_usable_cpus())}")
