"""Whether a device computes: the smallest kernel in its widest precision, tried before the device is taken.

A driver may list a device and fail to compile for it (one older than its processor, say), end the whole process, or,
as Mesa 22.3 does on processors, leave loops after 65,535 turns.
"""

import os
import shutil
import signal
import subprocess
import sys
import uuid
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from vrte.basics.errors import DeviceError
from vrte.cl.building import LONGEST, build_kernels
from vrte.cl.errors import name_of
from vrte.cl.session import OPTIONS_OF, REALS

POCL, INTEL = "Portable Computing Language", "Intel(R) OpenCL"
TURNS = 1_000_000  # of the loop
LONGEST_WAIT = 120  # seconds to wait for the process that probes a device
TRY_ONE = "from vrte.cl import device, probe; print(probe.try_here(device.devices()[{}].handle, {!r}))"


def try_device(index: int, platform: str, handle: Any, precision: str = "double") -> str:
    """Why the device of that index in `vrte.cl.device.devices` does not compute, in one line; empty where it does."""
    return try_here(handle, precision) if is_safe_in_process(platform) else try_elsewhere(index, precision)


def is_safe_in_process(platform: str) -> bool:
    """Whether a failure of the platform's driver is an error: PoCL ends the process where it finds no linker, and of
    drivers that were not tried nothing is known."""
    return platform == INTEL or (platform == POCL and has_linker()) or not sys.executable


def has_linker() -> bool:
    """Whether there is what PoCL links with."""
    return shutil.which("ld") is not None


def try_here(handle: Any, precision: str = "double") -> str:
    """The trial, in this process."""
    import pyopencl

    text = files("vrte.cl").joinpath("probe.cl").read_text(encoding="utf-8")
    numbers: Any = np.full(2, 3.0, REALS[precision])
    flags = pyopencl.mem_flags.READ_WRITE | pyopencl.mem_flags.COPY_HOST_PTR
    try:
        context = pyopencl.Context([handle])
        if handle.platform.name == POCL and not has_linker():
            # what was compiled before would still run: tried is whether it compiles
            text += f"__constant int compiled_anew_{uuid.uuid4().hex} = 0;\n"
        kernels = build_kernels(context, text, OPTIONS_OF[precision])
        queue = pyopencl.CommandQueue(context)
        buffer = pyopencl.Buffer(context, flags, hostbuf=numbers)
        kernels["probe"](queue, (1,), (1,), TURNS, buffer)
        pyopencl.enqueue_copy(queue, numbers, buffer)
    except DeviceError as error:
        return str(error)
    except pyopencl.Error as error:
        return f"it fails ({name_of(error)} in {getattr(error, 'routine', None) or 'OpenCL'})"
    if numbers[0] != 7.0:
        return f"it finds 2 x 3 + 1 = {numbers[0]}"
    return "" if numbers[1] == 3.0 * TURNS else f"it leaves a loop of {TURNS} turns after {numbers[1] / 3.0:.0f}"


def try_elsewhere(index: int, precision: str = "double") -> str:
    """The trial, in a process of its own."""
    command = [sys.executable, "-P", "-c", TRY_ONE.format(index, precision)]
    path = os.pathsep.join([str(Path(__file__).parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])])
    try:
        done = subprocess.run(
            command,
            env=os.environ | {"PYTHONPATH": path},
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
            timeout=LONGEST_WAIT,
        )
    except subprocess.TimeoutExpired:
        return f"it gives no answer in {LONGEST_WAIT} s"
    return end_of_the_process(done.returncode, done.stderr) if done.returncode else done.stdout.strip()


def end_of_the_process(code: int, text: str) -> str:
    """Why the other process ended, in one line.

    >>> end_of_the_process(-11, "")
    'it ends the process (signal SIGSEGV)'
    """
    if "ld" in text and "doesn't exist" in text:
        return "it finds no linker (install binutils, which brings ld)"
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    how = f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
    return f"it ends the process ({how}{f': {lines[-1][:LONGEST]}' if lines else ''})"
