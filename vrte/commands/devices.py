"""`vrte devices`: OpenCL devices, and what they can do."""

import argparse
from typing import Any

from vrte.basics.errors import DeviceError
from vrte.commands.common import new_command, progress


def add(commands: Any) -> None:
    """`vrte devices`."""
    told = "a list of OpenCL platforms and devices, and which one is taken"
    devices = new_command(commands, "devices", run, told)
    devices.add_argument("--measure", action="store_true", help="products a second, beside BLAS; some seconds")


def run(options: argparse.Namespace) -> None:
    from vrte.basics.running import usable_cpus
    from vrte.cl import device
    from vrte.studies import devices

    found = device.devices()
    with progress() as (phase, tick):
        phase("trying each device")
        complaints = {}
        for index, each in enumerate(found):
            tick(index, len(found))
            complaints[index] = device.complaint_of(index) if each.double_precision else ""
    try:
        taken, reason = device.choose(found, device.wanted(), device.complaint_of)
    except DeviceError:
        print(devices.as_text(found, None, "for the reason below", complaints), flush=True)
        raise
    print(devices.as_text(found, taken, reason, complaints))
    if options.measure:
        with device.device_errors(), progress() as (phase, tick):
            phase("products")
            rates = devices.measure(device.session(), usable_cpus(), tick)
        print(f"\n{devices.rates_as_text(rates, usable_cpus())}")
