"""Engines by the name of the backend that asks for them: a new one is a file here, its kernels, and a row."""

from types import SimpleNamespace
from typing import Any

from vrte import _core
from vrte.discrete_ordinates.execution.engines.cpu import PROCESSOR, Processor
from vrte.discrete_ordinates.execution.engines.engine import Engine
from vrte.request.backends import Backend

# Table 1 of the GPU paper: what its kernels are, and what the linear algebra behind them
KERNELS = ("assemble", "reconstruct", "azimuthal_sum", "add_single_scattering")
LINEAR_ALGEBRA = ("homogeneous", "particular", "boundary", "double_slabs", "join_slabs", "reflect_endless")


def engine_of(backend: Backend) -> Engine:
    """The engine of a backend; where kernels and linear algebra are not of one kind, a processor's with stages of two.

    Raises DeviceError where there is no device, MissingExtraError without pyopencl.
    """
    if not backend.needs_device:
        return PROCESSOR
    from vrte.discrete_ordinates.execution.engines.opencl import Device, device_stages

    if backend is Backend.OPENCL:
        return Device()
    own, device = (_core, device_stages())
    kernels = device if backend.kernels == "opencl" else own
    algebra = device if backend.linear_algebra == "device" else own
    return Processor(mixed(kernels, algebra))


def mixed(kernels: Any, linear_algebra: Any) -> Any:
    """Stages of two engines; those that an engine does not have are the processor's."""
    found = {name: getattr(_core, name) for name in dir(_core) if not name.startswith("_")}
    for names, engine in ((KERNELS, kernels), (LINEAR_ALGEBRA, linear_algebra)):
        found |= {name: getattr(engine, name, found[name]) for name in names}
    return SimpleNamespace(**found)
