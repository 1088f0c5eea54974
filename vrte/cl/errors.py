"""What goes wrong on a device, in words."""

import math
import sys
from typing import Any

from vrte.basics.errors import DeviceError
from vrte.basics.memory import write_gigabytes
from vrte.cl.session import Session

SHARE = 0.9  # fraction of the device memory that may be allocated
MEMORY = ("MEM_OBJECT_ALLOCATION_FAILURE", "OUT_OF_RESOURCES", "OUT_OF_HOST_MEMORY", "INVALID_BUFFER_SIZE")
LOST = (
    "DEVICE_NOT_AVAILABLE",
    "DEVICE_NOT_FOUND",
    "INVALID_DEVICE",
    "INVALID_CONTEXT",
    "INVALID_COMMAND_QUEUE",
    "INVALID_MEM_OBJECT",
    "INVALID_EVENT",
    "INVALID_EVENT_WAIT_LIST",
    "EXEC_STATUS_ERROR_FOR_EVENTS_IN_WAIT_LIST",
)


def name_of(error: Any) -> str:
    """OpenCL's name of an error, or its number where a driver has one of its own."""
    import pyopencl

    code: int = error.code
    return pyopencl.status_code.to_string(code, "code %d")


def make_device_error(error: BaseException) -> DeviceError | None:
    """What to tell of an error of pyopencl, None for any other."""
    module = sys.modules.get("pyopencl")
    if module is None or not isinstance(error, module.Error):
        return None
    name, where = name_of(error), getattr(error, "routine", None) or "OpenCL"
    if name in MEMORY:
        return DeviceError(
            f"the OpenCL device ran out of memory or other resources ({name} in {where}): ask for less at once, or for "
            "another device"
        )
    if name in LOST or name.startswith("code "):
        return DeviceError(
            f"the OpenCL device was lost on the way ({name} in {where}): nothing was computed, another call starts anew"
        )
    return DeviceError(f"the OpenCL device failed ({name} in {where}): nothing was computed")


def check_room(session: Session, needed: float, largest: float = 0.0, host: float = math.inf) -> None:
    """Before a solve that takes ``needed`` bytes on the device, ``largest`` of them in one array; ``host``: bytes that
    are free beside the device, which a CPU device takes its memory from.

    Raises DeviceError where they are not there: drivers promise memory that they do not have, and then the whole
    process ends.
    """
    device = session.device
    room = SHARE * min(device.global_mem_size, host if session.on_host else math.inf)
    if needed > room:
        raise DeviceError(
            f"this needs about {write_gigabytes(needed)} on the OpenCL device {device.name.strip()}, which has "
            f"{write_gigabytes(room / SHARE)}: ask for fewer nodes or directions, or for another device"
        )
    if largest > device.max_mem_alloc_size:
        raise DeviceError(
            f"this needs an array of {write_gigabytes(largest)} on the OpenCL device {device.name.strip()}, which "
            f"allows "
            f"{write_gigabytes(device.max_mem_alloc_size)}: ask for fewer nodes or directions, or for another device"
        )
