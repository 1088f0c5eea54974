"""Every OpenCL kernel on the smallest problems there are, for `test_opencl_races`, which runs this under oclgrind:
`python -m tests.race_kernels LANES RESULT [CASE ...]`, the work-items of a work-group and a file for what was launched.
"""

import json
import re
import sys
import threading
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyopencl

import vrte
from vrte.cl import device, matrices, probe, session
from vrte.cl.session import Session

from .helpers import assert_close

DECIMAL = re.compile(r"(?<![\w.])\d+(?:\.\d*(?:e[-+]?\d+)?|e[-+]?\d+)(?![\w.])")
launched: set[str] = set()  # kernel and precision
kept: list[Any] = []  # oclgrind takes memory in the place of what was freed to be as large as that was


def follow_oclgrind() -> None:
    """What oclgrind does not know goes; every small array goes up as the large ones do."""
    whole = session.read_sources

    def read_sources(precision: str = "double") -> str:
        text = whole(precision)
        # oclgrind passes over -cl-single-precision-constant
        return DECIMAL.sub(r"\g<0>f", text) if precision == "single" else text

    session.read_sources, session.SMALL = read_sources, 0
    start = threading.Thread.start
    # oclgrind --uninitialized ends the process where a thread copies memory before it has launched a kernel
    threading.Thread.start = lambda thread: thread.run() if thread.name == "vrte-solve" else start(thread)


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
    """A session without what oclgrind does not follow: fills are copies."""

    def zeros(self, shape: tuple[int, ...], dtype: Any = None) -> Any:
        made = self.empty(shape, dtype)
        if made.nbytes:
            pyopencl.enqueue_copy(self.queue, made.data, np.zeros(made.shape, made.dtype))
        return made


def open_bare_session(lanes: int) -> Bare:
    """On the only device there is; every array has memory of its own, no longer than itself."""
    (found,) = device.devices()
    opened = session.open_session(found.handle, lanes)

    def allocate(size: int) -> Any:
        kept.append(pyopencl.Buffer(opened.context, pyopencl.mem_flags.READ_WRITE, size))
        return kept[-1]

    return Bare(opened.context, opened.queue, opened.kernels, allocate, lanes)


def try_devices(on: Session) -> None:
    """What is launched before a device is taken."""
    assert [probe.try_here(on.device, precision) for precision in ("double", "single")] == ["", ""]


def multiply_and_invert(on: Session, rtol: float) -> None:
    """By more than one tile, transposed too, and by more than one panel of columns."""
    random = np.random.default_rng(1)
    for rows, columns in ((3, 5), (10, 9), (16, 15), (18, 18)):
        a, b, square = (random.random(shape) for shape in ((2, 5, rows), (2, columns, 5), (2, rows, rows)))
        left, right, turned = (matrices.upload_stack(on, each) for each in (a, b, b.transpose(0, 2, 1)))
        made = matrices.make_stack(on, 2, rows, columns, bare=True)
        matrices.multiply_stacks(on, left, right, made)
        matrices.multiply_stacks(on, left, turned, made, 1.0, 1.0, transposed=True)
        assert_close(matrices.download_stack(on, made), 2.0 * (b @ a), rtol=rtol, atol=0.0)
        stack = matrices.upload_stack(on, square)
        matrices.invert(on, stack)
        inverse = np.linalg.inv(square)
        assert_close(matrices.download_stack(on, stack), inverse, rtol=0.0, atol=rtol * np.abs(inverse).max())


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


CASES: dict[str, Callable[[Session], None]] = {
    "probe": try_devices,
    "matrices": lambda on: multiply_and_invert(on, 1e-10),
    "matrices in floats": lambda on: multiply_and_invert(on.in_precision("single"), 1e-3),
    "invariance": lambda on: solve_semi_infinite("invariance"),
    "invariance in floats": lambda on: solve_semi_infinite("invariance", **SINGLE),
    "semi-infinite": lambda on: solve_semi_infinite("doubling"),
    "doubling": lambda on: solve_stack("doubling"),
    "doubling in floats": lambda on: solve_stack("doubling", **SINGLE),
    "modes": lambda on: solve_stack("modes", backend="opencl+lapack", precision="auto"),
    "stages": lambda on: solve_stack("doubling", backend="opencl+lapack", precision="auto"),
    "algebra": lambda on: solve_stack("doubling", backend="sequential+device", precision="auto"),
}


def main(lanes: str, result: str, *names: str) -> None:
    """All cases, or those named."""
    follow_oclgrind()
    put_down_launches()
    on = open_bare_session(int(lanes))
    with device.take_device(0, on), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # two nodes are few
        for name in names or CASES:
            CASES[name](on)
            on.finish()
            print(name, flush=True)
    Path(result).write_text(json.dumps(sorted(launched)))


if __name__ == "__main__":
    main(*sys.argv[1:])
