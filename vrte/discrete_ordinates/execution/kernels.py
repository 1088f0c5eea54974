"""The loops that a backend's stages run: those of `_core`, or the same on an OpenCL device."""

from collections.abc import Callable
from functools import partial
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from vrte import _core
from vrte.request.backends import Backend

if TYPE_CHECKING:
    from vrte.cl.session import Session


def kernels_of(backend: Backend) -> Any:
    """`_core`, or what stands for it: on the device are the kernels, the linear algebra, or both.

    Raises DeviceError where there is no device, MissingExtraError without pyopencl; whatever fails on the device while
    they run is a DeviceError, too.
    """
    if not backend.needs_device:
        return _core
    from vrte.cl.assembly import assemble_arrays
    from vrte.cl.device import session
    from vrte.cl.doubling import double_slabs
    from vrte.cl.invariance import reflect_endless_arrays
    from vrte.cl.joining import join_slabs
    from vrte.cl.reconstruction import reconstruct
    from vrte.cl.sums import add_single_scattering, azimuthal_sum

    device = session()
    on_device_kernels: dict[str, Any] = {
        "assemble": assemble_arrays,
        "reconstruct": reconstruct,
        "azimuthal_sum": azimuthal_sum,
        "add_single_scattering": add_single_scattering,
    }
    on_device_algebra: dict[str, Any] = {
        "double_slabs": double_slabs,
        "join_slabs": join_slabs,
        "reflect_endless": reflect_endless_arrays,
    }
    found = SimpleNamespace(**{name: getattr(_core, name) for name in dir(_core) if not name.startswith("_")})
    stages = (on_device_kernels if backend.kernels == "opencl" else {}) | (
        on_device_algebra if backend.linear_algebra == "device" else {}
    )
    for name, stage in stages.items():
        setattr(found, name, partial(on_device, stage, device))
    return found


def on_device(stage: Callable[..., Any], device: "Session", *arguments: Any, **named: Any) -> Any:
    """One call of a stage, no other thread's kernels beside it."""
    from vrte.cl.device import device_errors

    with device.lock, device_errors():
        return stage(device, *arguments, **named)
