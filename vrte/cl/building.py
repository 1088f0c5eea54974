"""Kernels from their sources, compiled once and kept by the libraries' own caches, whatever state those are in."""

import re
import uuid
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from vrte.basics.errors import DeviceError
from vrte.cl import caches

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
    """The program, and its kernels by name; a second time past all caches where the first gives anything else.

    Raises DeviceError with the compiler's first complaint.
    """
    import pyopencl

    device = context.devices[0]
    try:
        made = _built_once(context, text, options, None)
    except pyopencl.RuntimeError as error:
        if COMPLAINT.search(str(error)):
            raise DeviceError(build_message(device.name, str(error))) from error
        made = None  # a cache that fails looks like a compiler without a complaint
    except pyopencl.Error:
        raise
    except Exception:
        # pyopencl's cache, which raises whatever its files make Python raise (a KeyError of its own among them)
        made = None
    if made is None or set(made[1]) != kernel_names(text):
        made = built_past_caches(context, text, options)
    caches.note_use()
    return made


def built_past_caches(context: Any, text: str, options: Sequence[str]) -> tuple[Any, dict[str, Any]]:
    """From the sources, under a name that no cache knows."""
    import pyopencl

    device = context.devices[0]
    fresh = f"{text}\n__constant int compiled_anew_{uuid.uuid4().hex} = 0;\n"
    try:
        program, kernels = _built_once(context, fresh, options, False)
    except pyopencl.Error as error:
        raise DeviceError(build_message(device.name, str(error))) from error
    missing = kernel_names(text) - set(kernels)
    if missing:
        raise DeviceError(f"the compiler of {device.name} left out {', '.join(sorted(missing))}")
    return program, kernels


def _built_once(
    context: Any, text: str, options: Sequence[str], cache_folder: bool | None
) -> tuple[Any, dict[str, Any]]:
    import pyopencl

    with _quiet():
        program = pyopencl.Program(context, text).build(list(options), cache_dir=cache_folder)
        return program, {kernel.function_name: kernel for kernel in caches.past_the_invokers(program.all_kernels)}


@contextmanager
def _quiet() -> Iterator[None]:
    """A compiler that has something to say is no warning for whoever wants an answer."""
    import pyopencl

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pyopencl.CompilerWarning)
        warnings.filterwarnings("ignore", "PyOpenCL (compiler caching failed|encountered an invalid info file)")
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
