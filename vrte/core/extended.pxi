# Impedance doubling: R and T of a homogeneous slab without an eigenproblem. With A = F E, half a slab's thickness h
# and f(A) = tanh(h sqrt A)/sqrt A: Ze = E f, Zo = f F, S = Z (1 + Z)^-1, R = So - Se, T = 1 - So - Se.
#
# Directions off the nodes are nodes of weight zero: a matrix is lower triangular in its blocks (incident, nodes,
# outgoing). On the diagonal II (r,) and OO (o,) are numbers, one a right-hand side or row, and N (n, n) a matrix; below
# it NI (r, n), ON (n, o), OI (r, o). The beam's scattering straight into an outgoing direction would be E's and F's OI:
# it is left at zero, because single scattering has a closed form; what OI then holds is multiple scattering alone.

cdef struct Extended:
    doubles N
    doubles NI
    doubles ON
    doubles OI
    doubles OO
    doubles II


cdef struct Sizes:
    int n
    int r
    int o
    int stokes


def extended_size(n, r, o):
    """Doubles of one matrix with its incident and outgoing directions."""
    return n * n + r * n + n * o + r * o + o + r


cdef inline size_t size_extended(Sizes s) noexcept nogil:
    return <size_t>s.n * s.n + <size_t>s.r * s.n + <size_t>s.n * s.o + <size_t>s.r * s.o + s.o + s.r


cdef inline Extended extended_at(Sizes s, doubles memory) noexcept nogil:
    cdef Extended x
    x.N = memory
    x.NI = x.N + <size_t>s.n * s.n
    x.ON = x.NI + <size_t>s.r * s.n
    x.OI = x.ON + <size_t>s.n * s.o
    x.OO = x.OI + <size_t>s.r * s.o
    x.II = x.OO + s.o
    return x


cdef void combine(Sizes s, double alpha, Extended a, double beta, Extended b, double gamma, Extended c) noexcept nogil:
    """c = alpha a + beta b + gamma 1."""
    cdef size_t i
    for i in range(size_extended(s)):
        c.N[i] = alpha * a.N[i] if beta == 0.0 else alpha * a.N[i] + beta * b.N[i]
    for i in range(s.n if gamma != 0.0 else 0):
        c.N[i * s.n + i] += gamma
    for i in range(s.o + s.r if gamma != 0.0 else 0):
        c.OO[i] += gamma                                                        # and II behind it


cdef void product_extended(Sizes s, double factor, Extended a, Extended b, Extended c) noexcept nogil:
    """c = factor a b; c is neither a nor b."""
    cdef int i, j
    cdef size_t k
    product(b"N", b"N", s.n, s.n, s.n, factor, a.N, s.n, b.N, s.n, 0.0, c.N, s.n)
    for j in range(s.r):
        for i in range(s.n):
            k = <size_t>j * s.n + i
            c.NI[k] = a.NI[k] * b.II[j]
        for i in range(s.o):
            k = <size_t>j * s.o + i
            c.OI[k] = factor * (a.OI[k] * b.II[j] + a.OO[i] * b.OI[k])
        c.II[j] = factor * a.II[j] * b.II[j]
    for j in range(s.n):
        for i in range(s.o):
            k = <size_t>j * s.o + i
            c.ON[k] = a.OO[i] * b.ON[k]
    for i in range(s.o):
        c.OO[i] = factor * a.OO[i] * b.OO[i]
    product(b"N", b"N", s.n, s.r, s.n, factor, a.N, s.n, b.NI, s.n, factor, c.NI, s.n)
    product(b"N", b"N", s.o, s.n, s.n, factor, a.ON, s.o, b.N, s.n, factor, c.ON, s.o)
    product(b"N", b"N", s.o, s.r, s.n, factor, a.ON, s.o, b.NI, s.n, 1.0, c.OI, s.o)


cdef int invert_extended(Sizes s, Extended a, Extended spare, ints pivots) noexcept nogil:
    """a <- a^-1."""
    cdef int i, j, info = factorise(s.n, a.N, s.n, pivots), room = s.n * s.n
    cdef size_t k
    if info != 0:
        return info
    dgetri(&s.n, a.N, &s.n, pivots, spare.N, &room, &info)
    if info != 0:
        return info
    for i in range(s.o):
        a.OO[i] = 1.0 / a.OO[i]
    for j in range(s.r):
        a.II[j] = 1.0 / a.II[j]
        for i in range(s.n):
            spare.NI[<size_t>j * s.n + i] = -a.NI[<size_t>j * s.n + i] * a.II[j]
    product(b"N", b"N", s.n, s.r, s.n, 1.0, a.N, s.n, spare.NI, s.n, 0.0, a.NI, s.n)
    for j in range(s.r):
        for i in range(s.o):
            k = <size_t>j * s.o + i
            a.OI[k] = -a.OO[i] * a.OI[k] * a.II[j]
    for j in range(s.n):
        for i in range(s.o):
            k = <size_t>j * s.o + i
            spare.ON[k] = -a.OO[i] * a.ON[k]
    product(b"N", b"N", s.o, s.r, s.n, 1.0, spare.ON, s.o, a.NI, s.n, 1.0, a.OI, s.o)
    product(b"N", b"N", s.o, s.n, s.n, 1.0, spare.ON, s.o, a.N, s.n, 0.0, a.ON, s.o)
    return 0


cdef inline double norm_1(int n, given a) noexcept nogil:
    """The largest sum of a column's |elements|."""
    cdef int i, j
    cdef double largest = 0.0, total
    for j in range(n):
        total = 0.0
        for i in range(n):
            total += fabs(a[<size_t>j * n + i])
        largest = max(largest, total)
    return largest
