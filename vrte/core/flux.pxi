# The flux, which order 0 conserves at omega = 1: one axis carries it, its row and column of E are known exactly.

cdef struct Nodes:
    # N nodes, S Stokes parameters each, n = S N
    int n, stokes
    given mu, weights


cdef inline int flux_axis(int n, int stokes) noexcept nogil:
    """The axis that carries the flux once order 0 is turned: I of the last node, so that steep nodes stay apart (turned
    into the first, the small eigenvalues would be known to 1e-16 of the largest only)."""
    return n - stokes


cdef inline bint is_lossy(const Arrays* t, int layer) noexcept nogil:
    """Whether oriented flakes absorb in a layer: its row of the flux is then what the nodes say."""
    return t.oriented != NULL and t.oriented[layer] and t.albedo[layer] < 1.0


cdef inline given slants(given slant, int layer, int count, given mu) noexcept nogil:
    """mu/k of `count` directions in a layer, mu where particles alone attenuate."""
    return mu if slant == NULL else slant + <size_t>layer * count


cdef inline double half_range(Nodes nodes) noexcept nogil:
    """The sum of weight mu, 1/2 but for rounding."""
    cdef int i
    cdef double size = 0.0
    for i in range(nodes.n // nodes.stokes):
        size += nodes.weights[i] * nodes.mu[i]
    return size


cdef void conserving_axis(Nodes nodes, doubles v) noexcept nogil:
    """v: the Householder vector that turns sqrt(weight mu) on I, E's null vector at omega = 1, to the flux's axis."""
    cdef int i, count = nodes.n // nodes.stokes
    cdef double size = 0.0
    set_zero(nodes.n, v)
    for i in range(count):
        v[nodes.stokes * i] = sqrt(nodes.weights[i] * nodes.mu[i])
        size += v[nodes.stokes * i] * v[nodes.stokes * i]
    v[flux_axis(nodes.n, nodes.stokes)] += sqrt(size)
    size = 0.0
    for i in range(count):
        size += v[nodes.stokes * i] * v[nodes.stokes * i]
    size = sqrt(2.0 / size)
    for i in range(count):
        v[nodes.stokes * i] *= size


cdef inline void turn_columns(Nodes nodes, int columns, given v, doubles a) noexcept nogil:
    """a <- (1 - v v^T) a, a of n rows."""
    cdef int i, j, stokes = nodes.stokes, count = nodes.n // stokes
    cdef double total
    cdef doubles column
    for j in range(columns):
        column = a + <size_t>j * nodes.n
        total = 0.0
        for i in range(count):
            total += v[i * stokes] * column[i * stokes]
        for i in range(count):
            column[i * stokes] -= total * v[i * stokes]


cdef inline void turn_rows(Nodes nodes, int rows, given v, doubles a, doubles spare) noexcept nogil:
    """a <- a (1 - v v^T), a of n columns."""
    cdef int i, j, stokes = nodes.stokes, count = nodes.n // stokes
    set_zero(rows, spare)
    for j in range(count):
        for i in range(rows):
            spare[i] += a[<size_t>j * stokes * rows + i] * v[j * stokes]
    for j in range(count):
        for i in range(rows):
            a[<size_t>j * stokes * rows + i] -= spare[i] * v[j * stokes]


cdef void reflect_both(Nodes nodes, given v, doubles a, doubles spare) noexcept nogil:
    """a <- (1 - v v^T) a (1 - v v^T)."""
    turn_columns(nodes, nodes.n, v, a)
    turn_rows(nodes, nodes.n, v, a, spare)


cdef void exact_conservation(Nodes nodes, double albedo, given v, doubles e, doubles row) noexcept nogil:
    """The flux's row and column of the turned E: (1 - omega) M^-1 v exactly (2 N terms at most), zero at omega = 1."""
    cdef int i, n = nodes.n, stokes = nodes.stokes, axis = flux_axis(n, stokes)
    cdef double size = half_range(nodes), total = 0.0
    set_zero(n, row)
    for i in range(n // stokes):     # M^-1 on minus the unit null vector: the reflection sends the null vector to -|.|
        row[stokes * i] = -sqrt(nodes.weights[i] * nodes.mu[i] / size) / nodes.mu[i]
    for i in range(n // stokes):
        total += v[i * stokes] * row[i * stokes]
    for i in range(n // stokes):
        row[i * stokes] = (1.0 - albedo) * (row[i * stokes] - total * v[i * stokes])
    for i in range(n):
        e[axis * n + i] = row[i]
        e[i * n + axis] = row[i]
