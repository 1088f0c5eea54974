"""What goes wrong on a device, in words."""

import sys
from typing import Any

from vrte.errors import DeviceError

SHARE = 0.9  # of what there is
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
    name: str = pyopencl.status_code.to_string(code, f"code {code}")
    return name


def translated(error: BaseException) -> DeviceError | None:
    """What to tell of an error of pyopencl, None for any other."""
    module = sys.modules.get("pyopencl")
    if module is None or not isinstance(error, module.Error):
        return None
    name, where = name_of(error), getattr(error, "routine", None) or "OpenCL"
    if name in MEMORY:
        return DeviceError(
            f"the OpenCL device ran out of memory ({name} in {where}): ask for less at once, or for another device"
        )
    if name in LOST or name.startswith("code "):
        return DeviceError(
            f"the OpenCL device was lost on the way ({name} in {where}): nothing was computed, another call starts anew"
        )
    return DeviceError(f"the OpenCL device failed ({name} in {where}): nothing was computed")
