# Complex numbers and divided differences of exp: core/kernels/complexes.h, which OpenCL kernels share.

ctypedef double complex cplx

cdef extern from "core/kernels/in_c.h":
    ctypedef struct vrte_complex:
        double x
        double y
    vrte_complex vrte_pair(double x, double y) noexcept nogil
    vrte_complex vrte_times(vrte_complex a, vrte_complex b) noexcept nogil
    vrte_complex vrte_over(vrte_complex a, vrte_complex b) noexcept nogil
    double vrte_size(vrte_complex a) noexcept nogil
    vrte_complex vrte_exp(vrte_complex z) noexcept nogil
    vrte_complex vrte_expm1(vrte_complex z) noexcept nogil
    vrte_complex vrte_sqrt(vrte_complex z) noexcept nogil
    double vrte_exp_difference(double a, double b) noexcept nogil
    vrte_complex vrte_exp_difference_of(vrte_complex a, vrte_complex b) noexcept nogil
    vrte_complex vrte_second_difference(vrte_complex a, vrte_complex b, vrte_complex c) noexcept nogil
    vrte_complex vrte_beam_response(vrte_complex k, double rate, double depth) noexcept nogil


cdef inline cplx make(double re, double im) noexcept nogil:
    cdef cplx z
    z.real = re
    z.imag = im
    return z


cdef inline vrte_complex pair(cplx z) noexcept nogil:
    return vrte_pair(z.real, z.imag)


cdef inline cplx of_pair(vrte_complex z) noexcept nogil:
    return make(z.x, z.y)


cdef inline cplx times(cplx a, cplx b) noexcept nogil:
    return of_pair(vrte_times(pair(a), pair(b)))


cdef inline cplx over(cplx a, cplx b) noexcept nogil:
    return of_pair(vrte_over(pair(a), pair(b)))


cdef inline double size_of(cplx a) noexcept nogil:
    return vrte_size(pair(a))


cdef inline cplx c_exp(cplx z) noexcept nogil:
    return of_pair(vrte_exp(pair(z)))


cdef inline cplx c_expm1(cplx z) noexcept nogil:
    return of_pair(vrte_expm1(pair(z)))


cdef inline cplx c_sqrt(cplx z) noexcept nogil:
    return of_pair(vrte_sqrt(pair(z)))


cdef inline cplx exp_difference(cplx a, cplx b) noexcept nogil:
    return of_pair(vrte_exp_difference_of(pair(a), pair(b)))


cdef inline cplx beam_response(cplx k, double rate, double depth) noexcept nogil:
    return of_pair(vrte_beam_response(pair(k), rate, depth))
