# Photons followed one by one, a batch an item: what they do is in photons.h.

cdef extern from "core/photons.h":
    void photon_follow_batch(const Arrays* t, int batch, const int* flag) noexcept nogil


cdef Job trace_photons_job(Arrays* t) noexcept nogil:
    return Job(t.n_batch, 0, 0)


cdef int trace_photons_one(const void* task, int item, Workspace desk) noexcept nogil:
    photon_follow_batch(<const Arrays*>task, item, desk.stop)
    return 0
