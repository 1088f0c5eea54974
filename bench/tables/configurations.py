"""Table 1 of the GPU paper: the six configurations, and rows of our own beside them.

The paper pairs its kernels, sequential or parallel (OpenCL), with EIGEN on one thread, without and with vector
instructions, or with MAGMA on the graphics card. Here EIGEN is LAPACK from OpenBLAS, on the least instructions that it
has code for or on all of the processor's, and MAGMA is the package's own products and inverses on the OpenCL device.
No eigensolver runs there, so configurations 3 and 6 solve without eigenvectors: by impedance doubling, or by the
invariance equation where only the top of something very thick is seen. All others solve by modes, as the paper does.
"""

import platform
from enum import Enum
from typing import Any

from vrte.basics.errors import DeviceError, MissingExtraError, SceneError

SEQUENTIAL, OPENCL, OPENMP = "sequential", "OpenCL", "OpenMP"
BASELINE, FULL, DEVICE = "LAPACK, baseline SIMD", "LAPACK, full SIMD", "on the OpenCL device"
X86 = ("x86_64", "amd64", "i686", "i386", "x86")  # what platform.machine() says, in small letters


class Configuration(Enum):
    """kernels, linear_algebra: as in Table 1; backend, algorithm: what `radiance` and `brdf` are told."""

    ONE = "1", SEQUENTIAL, BASELINE, "sequential", "modes"
    TWO = "2", SEQUENTIAL, FULL, "sequential", "modes"
    THREE = "3", SEQUENTIAL, DEVICE, "sequential+device", "auto"
    FOUR = "4", OPENCL, BASELINE, "opencl+lapack", "modes"
    FIVE = "5", OPENCL, FULL, "opencl+lapack", "modes"
    SIX = "6", OPENCL, DEVICE, "opencl", "auto"
    OPENMP_BASELINE = "OpenMP baseline", OPENMP, BASELINE, "openmp", "modes"
    OPENMP_FULL = "OpenMP full", OPENMP, FULL, "openmp", "modes"
    DEFAULT = "default", OPENMP, FULL, "openmp", "auto"

    def __init__(self, label: str, kernels: str, linear_algebra: str, backend: str, algorithm: str) -> None:
        self.label, self.kernels, self.linear_algebra = label, kernels, linear_algebra
        self.backend, self.algorithm = backend, algorithm

    @property
    def simd(self) -> str:
        """Which of the two processes it runs in, "baseline" or "full"."""
        return "baseline" if self.linear_algebra == BASELINE else "full"

    @property
    def needs_device(self) -> bool:
        """Whether OpenCL has a part in it."""
        return self.kernels == OPENCL or self.linear_algebra == DEVICE

    @property
    def title(self) -> str:
        """Of a row or a column.

        >>> Configuration.ONE.title, Configuration.OPENMP_FULL.title
        ('configuration 1', 'OpenMP full')
        """
        return f"configuration {self.label}" if self.label.isdecimal() else self.label

    def options(self, threads: int) -> dict[str, Any]:
        """What `radiance` and `brdf` are told; ``threads`` are those of OpenMP. LAPACK beside OpenCL has one, as in the
        paper.

        >>> Configuration.TWO.options(8)
        {'algorithm': 'modes', 'backend': 'sequential', 'threads': 1}
        >>> Configuration.DEFAULT.options(8)
        {'algorithm': 'auto', 'backend': 'openmp', 'threads': 8}
        """
        count = threads if self.kernels == OPENMP else 1
        return {"algorithm": self.algorithm, "backend": self.backend, "threads": count}

    def refusal(self) -> str | None:
        """Why this machine cannot run it, None where it can.

        >>> Configuration.TWO.refusal() is None
        True
        """
        if self.simd == "baseline" and platform.machine().lower() not in X86:
            return f"{self.title} needs the baseline SIMD of an x86 processor, and this is {platform.machine()}"
        if self.needs_device and (reason := explain_missing_device()) is not None:
            return f"{self.title} needs an OpenCL device: {reason}"
        return None


def explain_missing_device() -> str | None:
    """Why there is no OpenCL device to take, None where there is one."""
    from vrte.cl.device import find_chosen_device

    try:
        find_chosen_device()
    except (DeviceError, MissingExtraError) as error:
        return str(error)
    return None


def find_configuration(label: str) -> Configuration:
    """The configuration of that label. Raises SceneError where there is none, or where this machine cannot run it.

    >>> find_configuration("2").linear_algebra
    'LAPACK, full SIMD'
    """
    found = [configuration for configuration in Configuration if configuration.label == label.strip()]
    if not found:
        labels = ", ".join(configuration.label for configuration in Configuration)
        raise SceneError(f"there is no configuration {label!r}; there are {labels}")
    if (refused := found[0].refusal()) is not None:
        raise SceneError(refused)
    return found[0]


def choose_configurations(labels: str | None = None) -> tuple[tuple[Configuration, ...], list[str]]:
    """The configurations named, or all that this machine can run; and of all, why the others cannot.

    Raises SceneError for a name that is none, and for one that this machine cannot run.

    >>> [configuration.label for configuration in choose_configurations("2, OpenMP full")[0]]
    ['2', 'OpenMP full']
    """
    if labels is not None:
        return tuple(dict.fromkeys(find_configuration(label) for label in labels.split(","))), []
    refusals = {configuration: configuration.refusal() for configuration in Configuration}
    able = tuple(configuration for configuration, reason in refusals.items() if reason is None)
    return able, [reason for reason in refusals.values() if reason is not None]
