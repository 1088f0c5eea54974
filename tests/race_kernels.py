"""Every OpenCL kernel on the smallest problems there are, for `test_opencl_races`, which runs this under oclgrind:
`python -m tests.race_kernels FORM RESULT [CASE ...]`, the form of the kernels and the file for what was launched.

Work-groups and tiles are made smaller, so that an interpreter is done in a minute: who shares what stays as it is.
"""

import json
import re
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyopencl

import vrte
from vrte.cl import device, invariance_gpu, matrices, probe, session, steps, sums
from vrte.cl.extended import Algebra, Sizes
from vrte.cl.session import Session

from .helpers import assert_close

LANES, WORKERS, GROUP = 4, 16, 4  # of a SHARED kernel, of an inverse (a panel's columns), along a side of `product_gpu`
SMALLER = {
    "#define GPU_CREW 256 ": f"#define GPU_CREW {WORKERS} ",
    "#define GPU_GROUP 16": f"#define GPU_GROUP {GROUP}",
    "#define GPU_GROUP 8\n": "#define GPU_GROUP 2\n",
    "#define GPU_DEPTH 16 ": "#define GPU_DEPTH 4 ",
}
TILED = {4 * GROUP: "product_gpu", 10: "product_gpu_40", 8: "product_gpu_32"}
DECIMAL = re.compile(r"(?<![\w.])\d+(?:\.\d*(?:e[-+]?\d+)?|e[-+]?\d+)(?![\w.])")
launched: set[str] = set()  # kernel and precision
kept: list[Any] = []  # oclgrind takes memory in the place of what was freed to be as large as that was


def make_everything_small() -> None:
    """Work-groups and tiles, in the kernels and on the host; every small array goes up as the large ones do."""
    whole = session.read_sources

    def read_sources(precision: str = "double") -> str:
        text = whole(precision)
        for old, new in SMALLER.items():
            assert old in text, old
            text = text.replace(old, new)
        # oclgrind passes over -cl-single-precision-constant
        return DECIMAL.sub(r"\g<0>f", text) if precision == "single" else text

    session.read_sources, session.SMALL = read_sources, 0
    session.LANES["gpu"] = sums.LANES = LANES
    matrices.WORKERS, matrices.GROUP, matrices.TILE, invariance_gpu.GROUP = WORKERS, GROUP, 4 * GROUP, GROUP
    steps.WORKERS, steps.TILES = WORKERS, 4 * (4 * GROUP + 4 * GROUP + 1)
    matrices.TILED.clear()
    matrices.TILED.update(TILED)
    steps.Memory.copy = lambda own, values: copy_by_kernel(own.session, values, own.take(values.shape, values.dtype))
    start = threading.Thread.start
    # oclgrind --uninitialized ends the process where a thread copies memory before it has launched a kernel
    threading.Thread.start = lambda thread: thread.run() if thread.name == "vrte-solve" else start(thread)


COPY = """__kernel void put(__global const char* a, __global char* b, int first)
{ b[first + get_global_id(0)] = a[first + get_global_id(0)]; }"""


def copy_by_kernel(on: Session, values: Any, made: Any, first: int = 0, size: int = 0) -> Any:
    """The same bytes in a part of memory: oclgrind holds for unwritten what is copied there in any other way."""
    put = pyopencl.Program(on.context, COPY).build().put
    put.set_args(values.data, made.data, np.int32(first))
    pyopencl.enqueue_nd_range_kernel(on.queue, put, (size or values.nbytes,), None)
    return made


def put_down_launches() -> None:
    """Of every kernel of every program, by name and precision."""
    call = pyopencl.Kernel.__call__

    def watch(kernel: Any, queue: Any, *arguments: Any, **named: Any) -> Any:
        program = kernel.get_info(pyopencl.kernel_info.PROGRAM)
        options = program.get_build_info(queue.device, pyopencl.program_build_info.OPTIONS)
        launched.add(f"{kernel.function_name} {'single' if 'SINGLE' in options else 'double'}")
        return call(kernel, queue, *arguments, **named)

    pyopencl.Kernel.__call__ = watch


class Bare(Session):
    """A session without what oclgrind does not follow: fills and the host's own memory are copies."""

    def zeros(self, shape: tuple[int, ...], dtype: Any = None) -> Any:
        made = self.empty(shape, dtype)
        if made.nbytes:
            pyopencl.enqueue_copy(self.queue, made.data, np.zeros(made.shape, made.dtype))
        return made

    def put(self, values: Any, made: Any) -> None:
        self.catch_up()
        if made.memory is None:
            super().put(values, made)
        else:
            copy_by_kernel(self, self.upload(values), made)

    def copy_items(self, source: Any, target: Any, items: Any) -> None:
        self.catch_up()
        size = target.nbytes // target.shape[0]
        for item in items:
            copy_by_kernel(self, source, target, item * size, size)

    @contextmanager
    def lent(self, values: Any, written: bool = True) -> Iterator[Any]:
        flags = pyopencl.mem_flags
        kept.append(pyopencl.Buffer(self.context, flags.READ_WRITE | flags.COPY_HOST_PTR, hostbuf=values))
        buffer = kept[-1]
        yield buffer
        if written:
            pyopencl.enqueue_copy(self.queue, values, buffer)


def open_bare_session(form: str) -> Bare:
    """On the only device there is; every array has memory of its own, no longer than itself."""
    (found,) = device.devices()
    opened = session.open_session(found.handle, form)

    def allocate(size: int) -> Any:
        kept.append(pyopencl.Buffer(opened.context, pyopencl.mem_flags.READ_WRITE, size))
        return kept[-1]

    return Bare(opened.context, opened.queue, opened.kernels, allocate, form)


def try_devices(on: Session) -> None:
    """What is launched before a device is taken."""
    assert [probe.try_here(on.device, precision) for precision in ("double", "single")] == ["", ""]


def multiply_and_invert(on: Session) -> None:
    """By all tiles, transposed too, and by more than one panel of columns."""
    random = np.random.default_rng(1)
    items = on.upload(np.arange(2, dtype=np.int32))
    for rows, columns in ((3, 5), (10, 9), (16, 15), (18, 18)):
        a, b, square = (random.random(shape) for shape in ((2, 5, rows), (2, columns, 5), (2, rows, rows)))
        left, right, turned = (matrices.upload_stack(on, each) for each in (a, b, b.transpose(0, 2, 1)))
        made = matrices.make_stack(on, 2, rows, columns, bare=True)
        matrices.multiply_stacks(on, items, left, right, made)
        matrices.multiply_stacks(on, items, left, turned, made, 1.0, 1.0, transposed=True)
        assert_close(matrices.download_stack(on, made), 2.0 * (b @ a), rtol=1e-5, atol=0.0)
        stack = matrices.upload_stack(on, square)
        Algebra(on, Sizes(rows, 0, 0, 1), 2).invert_stack(np.ones(2, bool), stack)
        assert_close(matrices.download_stack(on, stack), np.linalg.inv(square), rtol=1e-5, atol=0.0)


SPHERES = vrte.spheres(1.6 + 0.1j, radius_um=0.04, wavelength_um=0.5).phase_matrix
SINGLE: dict[str, Any] = {"precision": "single", "accuracy": 1e-4}
NODES: dict[str, Any] = {"nodes": 2, "backend": "opencl", "precision": "double", "accuracy": 1e-4}
PAIRS: dict[str, Any] = {"mu_i": [0.6], "mu_o": [0.3, 0.8, 1.0], "phi": [0.0, 40.0]}
DEPTHS: dict[str, Any] = {"mu0": 0.6, "mu": [0.7, -0.4], "phi": [0.0, 40.0], "tau": [0.0, 0.2]}
STACK = vrte.Scene(
    [vrte.Layer(vrte.rayleigh(), 0.6, 0.2), vrte.Layer(SPHERES, 0.0, 0.1), vrte.Layer(vrte.rayleigh(), 1.0, 0.3)],
    vrte.Lambertian(0.3),
)


def solve_semi_infinite(algorithm: str, **more: Any) -> None:
    """Two semi-infinite layers in one call, one of which has more degrees than the other."""
    scenes = [vrte.Scene([vrte.Layer(phase, 0.6, np.inf)]) for phase in (vrte.rayleigh(), SPHERES)]
    asked = PAIRS | NODES | {"algorithm": algorithm}
    found, right = (vrte.brdfs(scenes, **(asked | own)) for own in (more, {"backend": "openmp", "precision": "auto"}))
    for one, other in zip(found, right, strict=True):
        assert_close(one.mueller, other.mueller, rtol=0.0, atol=1e-4)


def solve_stack(algorithm: str, **more: Any) -> None:
    """In and around layers that absorb, do not scatter, and do not absorb, over a base."""
    asked = DEPTHS | NODES | {"algorithm": algorithm}
    found, right = (vrte.radiance(STACK, **(asked | own)) for own in (more, {"backend": "openmp", "precision": "auto"}))
    assert_close(found.stokes, right.stokes, rtol=0.0, atol=1e-4)


def launch_each_step(on: Session, solve: Callable[[], None]) -> None:
    """As where matrices are large."""
    own = [on, *on.beside.values()]
    for each in own:
        each.at_once = False
    solve()
    for each in own:
        each.at_once = True


CASES: dict[str, Callable[[Session], None]] = {
    "probe": try_devices,
    "matrices": multiply_and_invert,
    "invariance": lambda on: solve_semi_infinite("invariance"),
    "mixed": lambda on: solve_semi_infinite("invariance", precision="mixed", accuracy=1e-9),
    "invariance in floats": lambda on: solve_semi_infinite("invariance", **SINGLE),
    "semi-infinite": lambda on: solve_semi_infinite("doubling"),
    "semi-infinite, a launch a step": lambda on: launch_each_step(on, lambda: solve_semi_infinite("doubling")),
    "doubling": lambda on: solve_stack("doubling"),
    "doubling, a launch a step": lambda on: launch_each_step(on, lambda: solve_stack("doubling")),
    "doubling in floats": lambda on: solve_stack("doubling", **SINGLE),
    "doubling in floats, a launch a step": lambda on: launch_each_step(on, lambda: solve_stack("doubling", **SINGLE)),
    "modes": lambda on: solve_stack("modes", backend="opencl+lapack", precision="auto"),
    "stages": lambda on: solve_stack("doubling", backend="opencl+lapack", precision="auto"),
    "algebra": lambda on: solve_stack("doubling", backend="sequential+device", precision="auto"),
}


def main(form: str, result: str, *names: str) -> None:
    """All cases, or those named."""
    make_everything_small()
    put_down_launches()
    on = open_bare_session(form)
    with device.take_device(0, on), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # two nodes are few
        for name in names or CASES:
            CASES[name](on)
            on.finish()
            print(name, flush=True)
    Path(result).write_text(json.dumps(sorted(launched)))


if __name__ == "__main__":
    main(*sys.argv[1:])
