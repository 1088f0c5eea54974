# Slabs joined by the star product from the base up, (2:8), then the field at their interfaces from the top down.

def joining_work(n, n_slab, n_rhs, o):
    """Doubles of `work` that one thread of `join_slabs` needs."""
    return n_slab * (n * n + n * n_rhs) + (n_slab + 1) * 2 * n * n_rhs + 5 * n * n + 4 * n * n_rhs + 5 * n + 2 * o * (n + n_rhs)


cdef struct Joining:
    Sizes s
    int n_slab, n_place, n_in, n_level, residuals
    bint conserving
    given_ints orders, slabs
    given above, nodes, weights, mu0
    doubles R, T
    given lost
    given_ints base_row
    given base, base_source, base_out
    given_ints interface
    doubles up, down, flux, residual


def join_slabs(crew, *, const int[::1] orders, bint conserving, const int[::1] slabs, const double[::1] above,
               const double[::1] nodes, const double[::1] weights, const double[::1] mu0, int n_out,
               const double[:, :, ::1] R, const double[:, :, ::1] T, const double[:, :, ::1] lost,
               const int[::1] base_row, const double[:, :, ::1] base, const double[:, :, ::1] base_source,
               const double[:, :, ::1] base_out, const int[::1] interface, double[:, :, :, ::1] up,
               double[:, :, :, ::1] down, double[:, :, :, ::1] flux, double[:, ::1] residual, int[::1] info):
    """The multiply scattered field at the interfaces of a pile of slabs, one Fourier order after another.

    conserving: whether order 0 has I. slabs (place,): which slab of R, T and lost (order, slab, ...) lies there, top
    first; above (place + 1,): optical depth of each interface, the last below the pile; base_row (order,): row of base
    (row, n, n), base_source (row, n_rhs, n) and base_out (row, n, S n_out), or -1 for black; interface (level,): where
    the field is wanted. up, down (order, level, n_rhs, S n_out): radiance times 2 pi for a unit beam, upward flipped by
    D; flux (order, level, 2, n_rhs): up and down through a horizontal plane, in order 0; residual (order, place): of the
    joints' systems.
    """
    cdef int stokes = <int>up.shape[3] // n_out, n = stokes * <int>nodes.shape[0], n_place = <int>slabs.shape[0]
    cdef Sizes s = Sizes(n, <int>up.shape[2], stokes * n_out, stokes)
    cdef Joining task = Joining(
        s, <int>R.shape[1], n_place, <int>mu0.shape[0], <int>interface.shape[0],
        <int>residual.shape[1], conserving, &orders[0], &slabs[0],
        &above[0], &nodes[0], &weights[0], &mu0[0], <doubles>&R[0, 0, 0], <doubles>&T[0, 0, 0], &lost[0, 0, 0],
        &base_row[0], &base[0, 0, 0], &base_source[0, 0, 0], &base_out[0, 0, 0], &interface[0], &up[0, 0, 0, 0],
        &down[0, 0, 0, 0], &flux[0, 0, 0, 0], &residual[0, 0])
    run_items(crew, join_one, &task, <int>orders.shape[0], joining_work(n, n_place, s.r, s.o), n, &info[0])


# (2:10)-(2:11)
cdef int join_one(const void* task, int item, Desk desk) noexcept nogil:
    cdef const Joining* pile = <const Joining*>task
    cdef Sizes s = pile.s
    cdef int n_place = pile.n_place, n_in = pile.n_in, n_level = pile.n_level, row = pile.base_row[item]
    cdef bint conserving = pile.conserving and pile.orders[item] == 0
    cdef size_t nn = <size_t>s.n * s.n, nr = <size_t>s.n * s.r, no = <size_t>s.n * s.o, each = size_extended(s), i
    cdef size_t first = <size_t>item * pile.n_slab, wanted = <size_t>item * n_level
    cdef given_ints slabs = pile.slabs, interface = pile.interface
    cdef given above = pile.above, nodes = pile.nodes, weights = pile.weights, mu0 = pile.mu0, lost = pile.lost + first * s.n
    cdef given base = pile.base + row * nn if row >= 0 else NULL
    cdef given base_source = pile.base_source + row * nr if row >= 0 else NULL
    cdef given base_out = pile.base_out + row * no if row >= 0 else NULL
    cdef doubles R = pile.R + first * each, T = pile.T + first * each, residual = pile.residual + <size_t>item * pile.residuals
    cdef doubles up = pile.up + wanted * s.r * s.o, down = pile.down + wanted * s.r * s.o, flux = pile.flux + wanted * 2 * s.r
    cdef ints pivots = desk.pivots
    cdef doubles G = desk.work                           # per place: from falling at its bottom to up there,
    cdef doubles g = G + n_place * nn                    # and what comes up by itself
    cdef doubles going_up = g + n_place * nr             # per interface
    cdef doubles going_down = going_up + (n_place + 1) * nr
    cdef doubles below = going_down + (n_place + 1) * nr
    cdef doubles scratch = below + nn                    # 4 n^2
    cdef doubles vectors = scratch + 4 * nn              # 4 n n_rhs
    cdef doubles absorbed = vectors + 4 * nr             # row of 1 - below that belongs to the flux
    cdef doubles v = absorbed + s.n                      # then 3 n spare
    cdef doubles out = v + 4 * s.n                       # base_out, turned, then running and spare
    cdef Extended r, t
    cdef int place, info, b, axis = flux_axis(s.n, s.stokes)
    cdef double size = 0.0
    memset(below, 0, sizeof(double) * nn)
    memset(absorbed, 0, sizeof(double) * s.n)
    memset(going_up, 0, sizeof(double) * 2 * (n_place + 1) * nr)
    absorbed[flux_axis(s.n, s.stokes)] = 1.0
    if conserving:
        conserving_axis(s.n, s.stokes, nodes, weights, v)
        for i in range(<size_t>s.n // s.stokes):
            size += weights[i] * nodes[i]
    if base != NULL:
        put_base(s, conserving, n_in, v, base, base_source, base_out, above[n_place], mu0, below,
                 going_up + n_place * nr, out, absorbed, scratch)
    for place in range(n_place - 1, -1, -1):
        if desk.stop[0]:
            return 0
        r = extended_at(s, R + slabs[place] * each)
        t = extended_at(s, T + slabs[place] * each)
        info = join_below(s, conserving, n_in, above[place], mu0, r, t, lost + <size_t>slabs[place] * s.n, below, absorbed,
                          going_up + (place + 1) * nr, going_up + place * nr, G + place * nn, g + place * nr, scratch,
                          vectors, v + s.n, &residual[place], pivots)
        if info != 0:
            return info
    for place in range(n_place):        # falling: T down + emitted, then up = G falling + g, then R up on top of it
        r = extended_at(s, R + slabs[place] * each)
        t = extended_at(s, T + slabs[place] * each)
        emitted(s, n_in, above[place], mu0, t.NI, vectors)
        product(b"N", b"N", s.n, s.r, s.n, 1.0, t.N, s.n, going_down + place * nr, s.n, 1.0, vectors, s.n)
        memcpy(going_up + (place + 1) * nr, g + place * nr, sizeof(double) * nr)
        product(b"N", b"N", s.n, s.r, s.n, 1.0, G + place * nn, s.n, vectors, s.n, 1.0, going_up + (place + 1) * nr, s.n)
        memcpy(going_down + (place + 1) * nr, vectors, sizeof(double) * nr)
        product(b"N", b"N", s.n, s.r, s.n, 1.0, r.N, s.n, going_up + (place + 1) * nr, s.n, 1.0,
                going_down + (place + 1) * nr, s.n)
    for b in range(n_level):
        for i in range(<size_t>s.r):
            flux[(2 * b) * s.r + i] = -sqrt(size) * going_up[interface[b] * nr + i * s.n + axis]
            flux[(2 * b + 1) * s.r + i] = -sqrt(size) * going_down[interface[b] * nr + i * s.n + axis]
    leave(s, n_place, n_in, n_level, slabs, above, mu0, R, T, base_out != NULL, out, going_up, going_down, interface, up, down,
          out + no)
    return 0


cdef void put_base(Sizes s, bint conserving, int n_in, given v, given base, given base_source,
                   given base_out, double depth, given mu0, doubles below, doubles up, doubles out,
                   doubles absorbed, doubles spare) noexcept nogil:
    """The base's operator, the beam that it reflects, its rows out, and (order 0) the row of what it absorbs."""
    cdef size_t nr = <size_t>s.n * s.r, i
    cdef int axis = flux_axis(s.n, s.stokes)
    memcpy(below, base, sizeof(double) * <size_t>s.n * s.n)
    memcpy(out, base_out, sizeof(double) * <size_t>s.n * s.o)
    for i in range(nr):
        up[i] = base_source[i] * exp(-depth / mu0[(i // s.n) // <size_t>(s.r // n_in)])
    if not conserving:
        return
    reflect_both(s.n, s.stokes, v, below, spare)
    turn_columns(s.n, s.stokes, s.r, v, up)
    turn_rows(s.n, s.stokes, s.o, v, out, spare)
    for i in range(<size_t>s.n):
        absorbed[i] = (1.0 if <int>i == axis else 0.0) - below[i * s.n + axis]
        if fabs(absorbed[i]) < 4e-16:    # rounding of the operator's quadrature, not a loss
            absorbed[i] = 0.0


cdef inline void emitted(Sizes s, int n_in, double depth, given mu0, given NI, doubles out) noexcept nogil:
    """What a slab below optical depth `depth` sends out of the attenuated beam."""
    cdef size_t i
    cdef int j
    cdef double fade
    for j in range(s.r):
        fade = exp(-depth / mu0[j // (s.r // n_in)])
        for i in range(<size_t>s.n):
            out[<size_t>j * s.n + i] = fade * NI[<size_t>j * s.n + i]


# (2:8)
cdef int join_below(Sizes s, bint conserving, int n_in, double depth, given mu0, Extended r, Extended t,
                    given lost, doubles below, doubles absorbed, given up, doubles up_above, doubles G,
                    doubles g, doubles scratch, doubles vectors, doubles row, doubles residual, ints pivots) noexcept nogil:
    """Puts a slab upon what lies below: G = (1 - below R)^-1 below, g = (1 - below R)^-1 up, below <- R + T G T.

    In order 0 the flux's row of 1 - below R, which is small where nothing absorbs, is summed from what is lost:
    lost + T's row + absorbed R, and `absorbed` becomes lost + (lost G + absorbed (1 + R G)) T.
    """
    cdef size_t nn = <size_t>s.n * s.n, nr = <size_t>s.n * s.r, i
    cdef int n = s.n, info, axis = flux_axis(s.n, s.stokes)
    cdef doubles M = scratch
    cdef doubles kept = M + nn
    cdef doubles GT = kept + nn
    cdef double largest
    cdef doubles rhs = vectors
    memset(M, 0, sizeof(double) * nn)
    for i in range(<size_t>n):
        M[i * n + i] = 1.0
    product(b"N", b"N", n, n, n, -1.0, below, n, r.N, n, 1.0, M, n)
    memcpy(G, below, sizeof(double) * nn)
    memcpy(g, up, sizeof(double) * nr)
    if conserving:
        product(b"N", b"N", 1, n, n, 1.0, absorbed, 1, r.N, n, 0.0, row, 1)
        for i in range(<size_t>n):
            row[i] += lost[i] + t.N[i * n + axis]
        largest = largest_of(n, row)
        if largest > 0.0:
            for i in range(<size_t>n):
                M[i * n + axis] = row[i] / largest
                G[i * n + axis] /= largest
            for i in range(<size_t>s.r):
                g[i * n + axis] /= largest
    memcpy(kept, M, sizeof(double) * nn)
    memcpy(rhs, g, sizeof(double) * nr)
    info = factorise(n, M, n, pivots)
    if info != 0:
        return info
    solve(b"N", n, n, M, n, pivots, G, n)
    solve(b"N", n, s.r, M, n, pivots, g, n)
    largest = largest_of(nr, rhs)
    product(b"N", b"N", n, s.r, n, -1.0, kept, n, g, n, 1.0, rhs, n)
    residual[0] = largest_of(nr, rhs) / largest if largest > 1e-280 else 0.0
    product(b"N", b"N", n, n, n, 1.0, G, n, t.N, n, 0.0, GT, n)
    if conserving:
        # absorbed (1 + R G) T = absorbed T + (absorbed R) GT
        product(b"N", b"N", 1, n, n, 1.0, absorbed, 1, r.N, n, 0.0, row, 1)
        for i in range(<size_t>n):
            row[i] += lost[i]
        memcpy(row + n, lost, sizeof(double) * n)
        product(b"N", b"N", 1, n, n, 1.0, row, 1, GT, n, 1.0, row + n, 1)
        product(b"N", b"N", 1, n, n, 1.0, absorbed, 1, t.N, n, 1.0, row + n, 1)
        memcpy(absorbed, row + n, sizeof(double) * n)
    memcpy(below, r.N, sizeof(double) * nn)
    product(b"N", b"N", n, n, n, 1.0, t.N, n, GT, n, 1.0, below, n)
    # up above = emitted up + T (G emitted down + g)
    emitted(s, n_in, depth, mu0, t.NI, vectors)
    memcpy(vectors + nr, g, sizeof(double) * nr)
    product(b"N", b"N", n, s.r, n, 1.0, G, n, vectors, n, 1.0, vectors + nr, n)
    emitted(s, n_in, depth, mu0, r.NI, up_above)
    product(b"N", b"N", n, s.r, n, 1.0, t.N, n, vectors + nr, n, 1.0, up_above, n)
    return 0


cdef void leave(Sizes s, int n_place, int n_in, int n_level, given_ints slabs, given above, given mu0,
                doubles R, doubles T, bint has_base, given base_out, given going_up,
                given going_down, given_ints interface, doubles up, doubles down, doubles work) noexcept nogil:
    """The field off the nodes at every wanted interface, first up through the slabs, then down."""
    cdef size_t nr = <size_t>s.n * s.r, size = <size_t>s.o * s.r, each = size_extended(s)
    cdef doubles running = work
    cdef doubles next = running + size
    cdef Extended r, t
    cdef int place, level
    memset(running, 0, sizeof(double) * size)
    if has_base:
        product(b"N", b"N", s.o, s.r, s.n, 1.0, base_out, s.o, going_down + n_place * nr, s.n, 0.0, running, s.o)
    for place in range(n_place, -1, -1):
        for level in range(n_level):
            if interface[level] == place:
                memcpy(up + level * size, running, sizeof(double) * size)
        if place > 0:
            r = extended_at(s, R + slabs[place - 1] * each)
            t = extended_at(s, T + slabs[place - 1] * each)
            off_nodes(s, n_in, above[place - 1], mu0, r, t, going_up + place * nr, going_down + (place - 1) * nr, r.OI, t.OO,
                      running, next)
            memcpy(running, next, sizeof(double) * size)
    memset(running, 0, sizeof(double) * size)
    for place in range(n_place + 1):
        for level in range(n_level):
            if interface[level] == place:
                memcpy(down + level * size, running, sizeof(double) * size)
        if place < n_place:
            r = extended_at(s, R + slabs[place] * each)
            t = extended_at(s, T + slabs[place] * each)
            off_nodes(s, n_in, above[place], mu0, r, t, going_down + place * nr, going_up + (place + 1) * nr, t.OI, t.OO,
                      running, next)
            memcpy(running, next, sizeof(double) * size)


cdef inline void off_nodes(Sizes s, int n_in, double depth, given mu0, Extended r, Extended t,
                           given through, given turned, given OI, given direct,
                           given entering, doubles out) noexcept nogil:
    """out = direct entering + T_ON through + R_ON turned + OI of the attenuated beam."""
    cdef int i, j
    cdef size_t k
    cdef double fade
    for j in range(s.r):
        fade = exp(-depth / mu0[j // (s.r // n_in)])
        for i in range(s.o):
            k = <size_t>j * s.o + i
            out[k] = direct[i] * entering[k] + fade * OI[k]
    product(b"N", b"N", s.o, s.r, s.n, 1.0, t.ON, s.o, through, s.n, 1.0, out, s.o)
    product(b"N", b"N", s.o, s.r, s.n, 1.0, r.ON, s.o, turned, s.n, 1.0, out, s.o)
