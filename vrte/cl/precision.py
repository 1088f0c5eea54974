"""Which precision a device computes in: by rule, or as it is asked for."""

import time
from typing import Any

import numpy as np

from vrte.basics.errors import DeviceError
from vrte.cl.building import build_kernels
from vrte.cl.device import Device
from vrte.cl.session import OPTIONS_OF, REALS, Session
from vrte.request.how import OF_SINGLE

SLOW = 4.0  # time of doubles over that of floats from which mixed precision pays
TIMED = 1 << 16, 64  # work-items, and work-items of a group, in the timed kernel
# Multiply-adds from register to register, four chains a work-item.
CHAINS = """
#ifdef SINGLE
#define real4 float4
#else
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
#define real4 double4
#endif
__kernel void chains(__global real4* x)
{
    real4 a = x[get_global_id(0)], b = a + 1.0, c = a + 2.0, d = a + 3.0;
    for (int i = 0; i < 512; i++) {
        a = a * 0.999 + b;
        b = b * 0.998 + c;
        c = c * 0.997 + d;
        d = d * 0.996 + a;
    }
    x[get_global_id(0)] = a + b + c + d;
}
"""


def choose_precision(asked: str, accuracy: float, device: Device, opened: Any = None) -> tuple[str, str]:
    """The precision that a device computes in, and why; ``opened()``: its session, where doubles have to be timed.

    Raises DeviceError where a device without doubles cannot give what is asked for.

    >>> card = Device("A", "card", "gpu", False, 8 << 30, 2 << 30, 40, "1")
    >>> choose_precision("auto", 1e-3, card)
    ('single', 'the device has no doubles')
    """
    if not device.double_precision and asked in ("double", "mixed"):
        raise DeviceError(f"the OpenCL device {device.name} has no doubles, which precision {asked!r} needs")
    if asked != "auto":
        return asked, "asked for"
    if not device.double_precision:
        if accuracy < OF_SINGLE:
            raise DeviceError(
                f"the OpenCL device {device.name} has no doubles, and single precision is good for an accuracy of "
                f"{OF_SINGLE:g}, not {accuracy:g}: ask for accuracy={OF_SINGLE:g}, or take another device"
            )
        return "single", "the device has no doubles"
    if device.kind == "cpu" or opened is None:
        return "double", "a processor's doubles are quick"
    ratio = measure_ratio(opened())
    times = f"doubles take {ratio:.2g} times as long as floats here"
    return ("mixed" if ratio >= SLOW else "double"), times


def measure_ratio(session: Session) -> float:
    """How many times as long as with floats multiply-adds take with doubles; measured once a session."""
    found: float = session.remembered("ratio", lambda: time_chains(session, "double") / time_chains(session, "single"))
    return found


def time_chains(session: Session, precision: str) -> float:
    """Seconds of the same multiply-adds, the fastest of three launches behind one that warms up."""
    import pyopencl

    count, group = TIMED
    kernels = build_kernels(session.context, CHAINS, OPTIONS_OF[precision], REALS[precision])
    numbers: Any = np.zeros((count, 4), REALS[precision])
    flags = pyopencl.mem_flags.READ_WRITE | pyopencl.mem_flags.COPY_HOST_PTR
    buffer = pyopencl.Buffer(session.context, flags, hostbuf=numbers)
    seconds = []
    with session.lock:
        for _ in range(4):
            session.finish()
            start = time.perf_counter()
            kernels["chains"](session.queue, (count,), (group,), buffer)
            session.finish()
            seconds.append(time.perf_counter() - start)
    return min(seconds[1:])
