# Photons followed one by one, a batch an item: what they do is in photons.h.

cdef extern from "core/photons.h":
    void photon_follow_batch(const Arrays* t, int batch, const int* flag) noexcept nogil


cdef int trace_photons_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    photon_follow_batch(t, item, desk.stop)
    return 0
