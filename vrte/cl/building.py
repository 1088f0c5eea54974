"""Kernels from their sources, with the types that their arguments have there."""

import re
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from vrte.basics.errors import DeviceError
from vrte.cl.caches import PYOPENCL, own_folder

KERNEL = re.compile(r"^\s*__kernel\s+void\s+(\w+)\s*\(([^{;]*)\)\s*\{", re.MULTILINE)
LISTS = re.compile(r"^#define ([A-Z_]+)(?:\(x\))? +((?:__global|IN|INTS|OUT|int|long) .*,.*)$", re.MULTILINE)
MACRO = re.compile(r"\b([A-Z_]+)\b(\(\w+\))?")
NUMBERS = {"int": np.int32, "long": np.int64}
COMPLAINT = re.compile(r"\berror\b")
LONGEST = 300  # characters of a compiler's log quoted in a message


def parse_argument_types(text: str, real: Any = np.float64) -> dict[str, list[Any]]:
    """The kernels that a source defines, and the types of their arguments, None for memory; macros that stand for
    several arguments are written out; ``real`` is what they call so.

    >>> source = "#define STACK(x) __global double* x, long x##_first\\n__kernel void fill(int n, STACK(a)) { }"
    >>> parse_argument_types(source)
    {'fill': [<class 'numpy.int32'>, None, <class 'numpy.int64'>]}
    """
    text = text.replace("\\\n", " ")
    lists = dict(LISTS.findall(text))
    found, numbers = {}, NUMBERS | {"real": real}
    for name, arguments in KERNEL.findall(text):
        written_out = ""
        while written_out != arguments:
            written_out, arguments = arguments, MACRO.sub(lambda macro: lists.get(macro[1], macro[0]), arguments)
        found[name] = [
            None if "*" in argument else numbers.get(argument.split()[0]) for argument in written_out.split(",")
        ]
    return found


class Kernels(dict[str, Any]):
    """The kernels of a program by name, each made when it is first asked for, with the types of its arguments: a launch
    takes 4 microseconds with them, 200 without. ``groups``: the size of the work-group that each asks for, in three
    dimensions."""

    def __init__(self, program: Any, text: str, real: Any = np.float64) -> None:
        super().__init__()
        self.program, self.types = program, parse_argument_types(text, real)
        self.groups: dict[str, tuple[int, ...]] = {}

    def __missing__(self, name: str) -> Any:
        import pyopencl

        self[name] = pyopencl.Kernel(self.program, name)
        self[name].set_scalar_arg_dtypes(self.types[name])
        asked = pyopencl.kernel_work_group_info.COMPILE_WORK_GROUP_SIZE
        device = self.program.devices[0]
        self.groups[name] = tuple(max(1, size) for size in self[name].get_work_group_info(asked, device))
        return self[name]


def build_kernels(context: Any, text: str, options: Sequence[str], real: Any = np.float64) -> Kernels:
    """The kernels of a source, compiled; ``real``: what they compute with.

    Raises DeviceError with the compiler's first complaint.
    """
    import pyopencl

    device = context.devices[0]
    program = pyopencl.Program(context, text)
    try:
        with warnings.catch_warnings():  # a compiler with something to say is none for whoever wants an answer
            warnings.simplefilter("ignore", pyopencl.CompilerWarning)
            warnings.filterwarnings("ignore", "PyOpenCL compiler caching failed")
            program.build(list(options), cache_dir=str(own_folder() / PYOPENCL))
        made = program.get_info(pyopencl.program_info.KERNEL_NAMES).split(";")
    except pyopencl.RuntimeError as error:
        raise DeviceError(build_message(device.name, str(error))) from error
    kernels = Kernels(program, text, real)
    if missing := set(kernels.types) - set(made):
        raise DeviceError(f"the compiler of {device.name} left out {', '.join(sorted(missing))}")
    return kernels


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
