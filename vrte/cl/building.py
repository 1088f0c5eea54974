"""Kernels from their sources, with the arguments that core/stages.toml declares: their order, types and shapes."""

import json
import re
import warnings
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from vrte import _core
from vrte.basics.errors import DeviceError
from vrte.cl.caches import PYOPENCL, own_folder

KERNEL = re.compile(r"^(?:__kernel void |KERNEL\(\w+, )(\w+)", re.MULTILINE)
WHOLE = ("whole", "flag")
COMPLAINT = re.compile(r"\berror\b")
LONGEST = 300  # characters of a compiler's log quoted in a message


class Taken(NamedTuple):
    """One argument of a kernel: its form and shape as stages.toml has them, and whether the kernel writes it."""

    name: str
    form: str
    dims: list[str]
    writes: bool

    @property
    def parameters(self) -> str:
        """As the kernel's parameters, in C.

        >>> Taken("M", "stack", ["n_item", "n", "n"], True).parameters
        '__global real* restrict M, long M_first, int M_ld, long M_stride'
        """
        if not self.dims:
            return f"{'int' if self.form in WHOLE else 'real'} {self.name}"
        if self.form in ("stack", "overlapping"):
            memory = f"__global real*{' restrict' * (self.form == 'stack')} {self.name}"
            return f"{memory}, long {self.name}_first, int {self.name}_ld, long {self.name}_stride"
        kind = "real" if self.form == "double" else self.form
        return f"__global {'' if self.writes else 'const '}{kind}* restrict {self.name}"

    def types(self, real: Any) -> list[Any]:
        """Of those parameters, None for memory."""
        if not self.dims:
            return [np.int32 if self.form in WHOLE else real]
        return [None, np.int64, np.int32, np.int64] if self.form in ("stack", "overlapping") else [None]


@cache
def read_declared() -> dict[str, list[Taken]]:
    """What each kernel takes, by its name."""
    return {name: [Taken(*each) for each in found] for name, found in json.loads(_core.KERNELS).items()}


def write_parameters() -> str:
    """Parameters of all kernels as macros, TAKES_ and the kernel's name."""
    lines = [
        f"#define TAKES_{name} {', '.join(each.parameters for each in taken)}"
        for name, taken in read_declared().items()
    ]
    return "\n".join([*lines, ""])


def arrange(name: str, known: Mapping[str, Any], given: Mapping[str, Any]) -> list[Any]:
    """What is given, or else known, in the order that a kernel takes it, and sizes, which shapes tell.

    Raises ValueError for a shape or a size that does not fit the others, TypeError for what is missing or not taken.
    """
    taken, sizes, found = read_declared()[name], dict[str, int](), []
    if strange := given.keys() - {each.name for each in taken}:
        raise TypeError(f"{name} does not take {', '.join(sorted(strange))}")
    values = {each.name: given.get(each.name, known.get(each.name)) for each in taken}
    for each in taken:
        shape = getattr(values[each.name], "shape", ())
        if each.dims and values[each.name] is not None:
            fitting = [
                int(d) if d.isdecimal() else sizes.setdefault(d, n) for d, n in zip(each.dims, shape, strict=False)
            ]
            if len(shape) != len(each.dims) or list(shape) != fitting:
                wanted = ", ".join(f"{d} {sizes.get(d, '')}".strip() for d in each.dims)
                raise ValueError(f"{name}: {each.name} must have the shape ({wanted}), not {tuple(shape)}")
    for each in taken:
        value = values[each.name]
        if value is None and not each.dims:
            value = sizes.get(each.name)
        if value is None and not (each.dims and each.name in given):
            raise TypeError(f"{name} needs {each.name}")
        if not each.dims and value != sizes.get(each.name, value):
            raise ValueError(f"{name}: {each.name} must be {sizes[each.name]}, not {value}")
        found.append(value)
    return found


class Kernels(dict[str, Any]):
    """The kernels of a program by name, each made when it is first asked for, with the types of its arguments: a launch
    takes 4 microseconds with them, 200 without. ``groups``: the size of the work-group that each asks for, in three
    dimensions."""

    def __init__(self, program: Any, text: str, real: Any = np.float64) -> None:
        super().__init__()
        self.program, self.names, self.real = program, set(KERNEL.findall(text)), real
        self.groups: dict[str, tuple[int, ...]] = {}

    def __missing__(self, name: str) -> Any:
        import pyopencl

        self[name] = pyopencl.Kernel(self.program, name)
        self[name].set_scalar_arg_dtypes([kind for each in read_declared()[name] for kind in each.types(self.real)])
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
    program = pyopencl.Program(context, write_parameters() + text)
    try:
        with warnings.catch_warnings():  # a compiler with something to say is none for whoever wants an answer
            warnings.simplefilter("ignore", pyopencl.CompilerWarning)
            warnings.filterwarnings("ignore", "PyOpenCL compiler caching failed")
            program.build(list(options), cache_dir=str(own_folder() / PYOPENCL))
        made = program.get_info(pyopencl.program_info.KERNEL_NAMES).split(";")
    except pyopencl.RuntimeError as error:
        raise DeviceError(build_message(device.name, str(error))) from error
    kernels = Kernels(program, text, real)
    if missing := kernels.names - set(made):
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
