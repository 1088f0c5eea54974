"""`vrte devices`: OpenCL devices, and what they can do."""

import argparse
import sys

from vrte.basics.errors import DeviceError
from vrte.commands.common import Parser, show_progress


def add(command: Parser) -> None:
    """The arguments of `vrte devices`."""
    command.add_argument("--measure", action="store_true", help="products a second, beside BLAS; some seconds")
    command.add_argument(
        "--verify",
        metavar="INDEX",
        nargs="?",
        const=-1,
        type=int,
        help="whether a device of the list, by default the one that is taken, computes what the processor does: two "
        "minutes at most, a table to send in a report",
    )


def run(options: argparse.Namespace) -> None:
    from vrte.basics.running import Run, run_interruptible

    run_interruptible(Run(1), lambda: show_devices(options))  # drivers compile for minutes, and hear no signal


def show_devices(options: argparse.Namespace) -> None:
    """The list, and what else is asked for."""
    from vrte.basics.running import count_usable_cpus
    from vrte.cl import device
    from vrte.commands import verify_device

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
        print(verify_device.describe_devices(found, None, "for the reason below", complaints), flush=True)
        raise
    print(verify_device.describe_devices(found, taken, reason, complaints))
    if options.measure:
        with device.raise_device_errors(), show_progress() as (phase, tick):
            phase("products")
            rates = verify_device.measure_rates(device.session(), count_usable_cpus(), tick)
        print(f"\n{verify_device.describe_rates(rates, count_usable_cpus())}")
    if options.verify is not None:
        verify_and_print(None if options.verify < 0 else options.verify)


def verify_and_print(index: int | None) -> None:
    """The table of all checks. Raises DeviceError where one does not pass."""
    from vrte.commands import verify_device

    found = verify_device.verify_device(index, lambda line: print(f"  {line} ...", file=sys.stderr, flush=True))
    print(f"\n{verify_device.describe_verified(found)}", flush=True)
    if complaint := verify_device.complain_about(found):
        raise DeviceError(complaint)
