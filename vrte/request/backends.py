"""What does the work: which kernels, and which linear algebra behind them. Table 1 of the GPU paper, and its six
configurations, are made of these."""

from enum import Enum


class Backend(Enum):
    """kernels: the compiled core on one thread ("sequential") or all ("openmp"), or the OpenCL device; linear_algebra:
    LAPACK on the processor, or products and inverses of all orders at once on the OpenCL device."""

    OPENMP = "openmp", "openmp", "lapack"
    SEQUENTIAL = "sequential", "sequential", "lapack"
    SEQUENTIAL_DEVICE = "sequential+device", "sequential", "device"
    OPENCL_LAPACK = "opencl+lapack", "opencl", "lapack"
    OPENCL = "opencl", "opencl", "device"

    def __init__(self, label: str, kernels: str, linear_algebra: str) -> None:
        self.label, self.kernels, self.linear_algebra = label, kernels, linear_algebra
        self.needs_device = kernels == "opencl" or linear_algebra == "device"


_BY_LABEL = {backend.label: backend for backend in Backend}
BACKENDS = tuple(_BY_LABEL)


def find_backend(label: str) -> Backend:
    """The backend of that label.

    >>> find_backend("opencl").linear_algebra
    'device'
    """
    return _BY_LABEL[label]
