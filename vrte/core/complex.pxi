ctypedef double complex cplx

cdef extern from "core/gains.h":
    double vrte_exp_difference(double a, double b) noexcept nogil


# Small complex functions. Divided differences of exp make every resonance (mu0 on a node, on the reciprocal
# of an eigenvalue, mu = mu0) an ordinary case.

cdef inline cplx make(double re, double im) noexcept nogil:
    cdef cplx z
    z.real = re
    z.imag = im
    return z


cdef inline cplx times(cplx a, cplx b) noexcept nogil:
    return make(a.real * b.real - a.imag * b.imag, a.real * b.imag + a.imag * b.real)


cdef inline cplx over(cplx a, cplx b) noexcept nogil:
    """a / b; every caller keeps |b|^2 in range."""
    cdef double size
    if b.imag == 0.0:
        return make(a.real / b.real, a.imag / b.real)
    size = b.real * b.real + b.imag * b.imag
    return make((a.real * b.real + a.imag * b.imag) / size, (a.imag * b.real - a.real * b.imag) / size)


cdef inline double size_of(cplx a) noexcept nogil:
    return fabs(a.real) if a.imag == 0.0 else hypot(a.real, a.imag)


cdef inline cplx c_exp(cplx z) noexcept nogil:
    cdef double scale = exp(z.real)
    if z.imag == 0.0:
        return make(scale, 0.0)
    return make(scale * cos(z.imag), scale * sin(z.imag))


cdef inline cplx c_expm1(cplx z) noexcept nogil:
    cdef double half
    if z.imag == 0.0:
        return make(expm1(z.real), 0.0)
    half = sin(0.5 * z.imag)
    return make(expm1(z.real) * cos(z.imag) - 2.0 * half * half, exp(z.real) * sin(z.imag))


cdef inline cplx c_sqrt(cplx z) noexcept nogil:
    """The root with a non-negative real part."""
    cdef double size, re
    if z.imag == 0.0:
        return make(sqrt(z.real), 0.0) if z.real >= 0.0 else make(0.0, sqrt(-z.real))
    size = hypot(z.real, z.imag)
    if z.real >= 0.0:
        re = sqrt(0.5 * (size + z.real))
        return make(re, 0.5 * z.imag / re)
    re = 0.5 * fabs(z.imag) / sqrt(0.5 * (size - z.real))
    return make(re, 0.5 * z.imag / re)


cdef inline cplx exp_difference(cplx a, cplx b) noexcept nogil:
    """exp[a, b] = (e^a - e^b)/(a - b), and e^a where they meet."""
    cdef cplx gap
    if a.imag == 0.0 and b.imag == 0.0:
        return make(vrte_exp_difference(a.real, b.real), 0.0)
    if a.real < b.real:
        a, b = b, a
    gap = b - a
    if size_of(gap) == 0.0:
        return c_exp(a)
    if size_of(gap) > 1.0:
        return over(c_exp(b) - c_exp(a), gap)
    return times(c_exp(a), over(c_expm1(gap), gap))


cdef cplx exp_difference_2(cplx a, cplx b, cplx c) noexcept nogil:
    """exp[a, b, c], the second divided difference, for any spacing of its arguments."""
    cdef double ab = size_of(a - b), bc = size_of(b - c), ca = size_of(c - a)
    cdef cplx centre, h1, h2, h3, total, t
    cdef double factor
    cdef int i
    if ab >= bc and ab >= ca:      # the outer pair goes to a and c
        b, c = c, b
        ca = ab
    elif bc >= ca:
        a, b = b, a
        ca = bc
    if ca > 1.0:
        return over(exp_difference(a, b) - exp_difference(b, c), a - c)
    centre = (a + b + c) / 3.0
    a, b, c = a - centre, b - centre, c - centre
    h1 = h2 = h3 = total = make(1.0, 0.0)   # complete homogeneous polynomials of 1, 2, 3 offsets
    total = total * 0.5
    factor = 0.5
    for i in range(1, 18):
        h1 = times(a, h1)
        h2 = h1 + times(b, h2)
        h3 = h2 + times(c, h3)
        factor = factor / (i + 2)
        total = total + factor * h3
    return times(c_exp(centre), total)
