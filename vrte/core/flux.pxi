# The flux, which order 0 conserves at omega = 1: one axis carries it, its row and column of E are known exactly.

cdef inline int flux_axis(int n, int stokes) noexcept nogil:
    """The axis that carries the flux once order 0 is turned: I of the last node, so that steep nodes stay apart (turned
    into the first, the small eigenvalues would be known to 1e-16 of the largest only)."""
    return n - stokes


cdef void conserving_axis(int n, int stokes, given directions, given weights, doubles v) noexcept nogil:
    """v: the Householder vector that turns sqrt(weight mu) on I, the null vector of E at omega = 1, to the flux's axis."""
    cdef int i
    cdef double size = 0.0
    memset(v, 0, sizeof(double) * n)
    for i in range(n // stokes):
        v[stokes * i] = sqrt(weights[i] * directions[i])
        size += v[stokes * i] * v[stokes * i]
    v[flux_axis(n, stokes)] += sqrt(size)
    size = 0.0
    for i in range(n // stokes):
        size += v[stokes * i] * v[stokes * i]
    size = sqrt(2.0 / size)
    for i in range(n // stokes):
        v[stokes * i] *= size


cdef inline void turn_columns(int n, int stokes, int columns, given v, doubles a) noexcept nogil:
    """a <- (1 - v v^T) a, a of n rows."""
    cdef int i, j
    cdef double total
    for j in range(columns):
        total = 0.0
        for i in range(n // stokes):
            total += v[i * stokes] * a[<size_t>j * n + i * stokes]
        for i in range(n // stokes):
            a[<size_t>j * n + i * stokes] -= total * v[i * stokes]


cdef inline void turn_rows(int n, int stokes, int rows, given v, doubles a, doubles spare) noexcept nogil:
    """a <- a (1 - v v^T), a of n columns."""
    cdef int i, j
    memset(spare, 0, sizeof(double) * rows)
    for j in range(n // stokes):
        for i in range(rows):
            spare[i] += a[<size_t>j * stokes * rows + i] * v[j * stokes]
    for j in range(n // stokes):
        for i in range(rows):
            a[<size_t>j * stokes * rows + i] -= spare[i] * v[j * stokes]


cdef void reflect_both(int n, int stokes, given v, doubles a, doubles spare) noexcept nogil:
    """a <- (1 - v v^T) a (1 - v v^T)."""
    turn_columns(n, stokes, n, v, a)
    turn_rows(n, stokes, n, v, a, spare)


cdef void exact_conservation(int n, int stokes, double albedo, given directions, given weights, given v,
                             doubles e, doubles row) noexcept nogil:
    """The flux's row and column of the turned E: (1 - omega) M^-1 v exactly (2 N terms at most), zero at omega = 1."""
    cdef int i, axis = flux_axis(n, stokes)
    cdef double size = 0.0, total = 0.0
    memset(row, 0, sizeof(double) * n)
    for i in range(n // stokes):
        size += weights[i] * directions[i]
    for i in range(n // stokes):     # M^-1 on minus the unit null vector: the reflection sends the null vector to -|.|
        row[stokes * i] = -sqrt(weights[i] * directions[i] / size) / directions[i]
    for i in range(n // stokes):
        total += v[i * stokes] * row[i * stokes]
    for i in range(n // stokes):
        row[i * stokes] = (1.0 - albedo) * (row[i * stokes] - total * v[i * stokes])
    for i in range(n):
        e[axis * n + i] = row[i]
        e[i * n + axis] = row[i]
