"""Kernels from their sources."""

import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from vrte.basics.errors import DeviceError
from vrte.cl.caches import PYOPENCL, own_folder

KERNEL = re.compile(r"^\s*__kernel\s+void\s+(\w+)\s*\(", re.MULTILINE)
COMPLAINT = re.compile(r"\berror\b")
LONGEST = 300  # characters of a compiler's log in a message


def kernel_names(text: str) -> set[str]:
    """What a source defines.

    >>> kernel_names("__kernel void product(int n) { }")
    {'product'}
    """
    return set(KERNEL.findall(text))


def built(context: Any, text: str, options: Sequence[str]) -> tuple[Any, dict[str, Any]]:
    """The program, and its kernels by name.

    Raises DeviceError with the compiler's first complaint.
    """
    import pyopencl

    device = context.devices[0]
    try:
        with _quiet():
            program = pyopencl.Program(context, text).build(list(options), cache_dir=str(own_folder() / PYOPENCL))
            kernels = {kernel.function_name: kernel for kernel in program.all_kernels()}
    except pyopencl.RuntimeError as error:
        raise DeviceError(build_message(device.name, str(error))) from error
    if missing := kernel_names(text) - set(kernels):
        raise DeviceError(f"the compiler of {device.name} left out {', '.join(sorted(missing))}")
    return program, kernels


@contextmanager
def _quiet() -> Iterator[None]:
    """A compiler that has something to say is no warning for whoever wants an answer, nor is its cache."""
    import pyopencl

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pyopencl.CompilerWarning)
        warnings.filterwarnings("ignore", "PyOpenCL compiler caching failed")
        yield


def build_message(device: str, log: str) -> str:
    """One line of a compiler's log: its first error, or its beginning.

    >>> build_message("a GPU", "clBuildProgram failed\\nx.cl:3:5: error: unknown type name 'doubel'\\n1 error")
    "the kernels do not compile on a GPU: x.cl:3:5: error: unknown type name 'doubel'"
    """
    lines = [" ".join(line.split()) for line in log.splitlines() if line.strip()]
    complaint = next((line for line in lines if COMPLAINT.search(line)), "; ".join(lines))
    if len(complaint) > LONGEST:
        complaint = complaint[:LONGEST] + "..."
    return f"the kernels do not compile on {device}: {complaint}"
