# Threads and clocks.

cdef extern from "core/clock.h":
    const int vrte_openmp
    double vrte_seconds() noexcept nogil

HAS_OPENMP = bool(vrte_openmp)
