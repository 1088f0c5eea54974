"""Engines, a file each; a new one has `open_engine`, `open_stages` and a row (docs/how_to/extending.md)."""

from importlib import import_module
from types import SimpleNamespace
from typing import Any

from vrte import _core
from vrte.basics.errors import AccuracyWarning, DeviceError, MissingExtraError, SceneError, warn_user
from vrte.discrete_ordinates.execution.engines.cpu import Processor
from vrte.discrete_ordinates.execution.engines.engine import Engine
from vrte.request.how import OF_SINGLE, Backend

# the engine of each kind of kernels, and of the linear algebra behind them: see `Backend`
ENGINES = {"openmp": "cpu", "sequential": "cpu", "lapack": "cpu", "opencl": "opencl", "device": "opencl"}
# Table 1 of the GPU paper: what its kernels are; all other stages are linear algebra
KERNELS = ("assemble", "reconstruct", "azimuthal_sum", "add_single_scattering")


def choose_engine(
    backend: Backend,
    refracts: bool = False,
    precision: str = "auto",
    accuracy: float = 0.0,
    oriented: bool = False,
) -> Engine:
    """The engine of a backend; where kernels and linear algebra are of two engines, a processor's with stages of both.

    For scenes that refract, ``refracts``, that is so for a device as well: the processor joins its slabs, and solves
    them where they hold ``oriented`` flakes, whose attenuation a device does not know. ``precision``
    and ``accuracy``: as asked for, of a device. Raises SceneError where another precision than doubles is asked for and
    the processor has a part in it, DeviceError where there is no device, MissingExtraError without pyopencl."""
    kernels, algebra = (ENGINES[kind] for kind in (backend.kernels, backend.linear_algebra))
    if kernels != algebra or (refracts and kernels != "cpu"):
        if precision == "single":
            words = "is not for scenes that refract or mirror light: the processor joins their slabs, in doubles"
            raise SceneError(f"precision {precision!r} {words}", "precision")
        return Processor(mix_stages(load_stages(kernels), _core if oriented else load_stages(algebra)))
    reported = {"asked": precision, "accuracy": accuracy} if backend.needs_device else {}
    return import_module(f"{__name__}.{kernels}").open_engine(**reported)


def find_usual_accuracy(accuracy: float) -> float:
    """What an OpenCL device is asked for where no accuracy was given: on one without doubles what floats are good for,
    with an AccuracyWarning; where there is no device the solve says so."""
    from vrte.cl.device import find_chosen_device

    try:
        device = find_chosen_device()
    except (DeviceError, MissingExtraError):
        return accuracy
    if device.double_precision or accuracy >= OF_SINGLE:
        return accuracy
    words = f"has no doubles: single precision, for an accuracy of {OF_SINGLE:g} in place of {accuracy:g}"
    warn_user(f"the OpenCL device {device.name} {words}", AccuracyWarning)
    return OF_SINGLE


def load_stages(engine: str) -> Any:
    """The stages of an engine that run by themselves on arrays of the host, with the arguments of those of `_core`."""
    return import_module(f"{__name__}.{engine}").open_stages()


def mix_stages(kernels: Any, linear_algebra: Any) -> Any:
    """Kernels of one engine, linear algebra of another; stages that an engine does not have are the processor's."""
    found = {name: getattr(_core, name) for name in dir(_core) if not name.startswith("_")}
    for name, own in found.items():
        found[name] = getattr(kernels if name in KERNELS else linear_algebra, name, own)
    return SimpleNamespace(**found)
