# Slabs joined by the star product from the base up, (2:8), then the field at their interfaces from the top down.

cdef Job join_slabs_job(Arrays* t) noexcept nogil:
    cdef size_t n = t.n, r = t.n_rhs
    return Job(t.n_order, t.n_place * n * (n + r) + (2 * t.n_place + 6) * n * r + 5 * n * n + 5 * n
               + 2 * t.n_out_rows * (n + r), n)


cdef struct SlabStack:
    # one order of a stack of slabs, from the base up
    Sizes s
    Nodes nodes
    bint conserving
    int n_place, per_beam
    given_ints slabs
    given above, mu0, R, T, lost
    doubles G, g                    # per place: from falling at its bottom to up there, and what comes up by itself
    doubles going_up, going_down    # per interface
    doubles below, scratch, vectors # n^2, 4 n^2, 4 n n_rhs
    doubles absorbed                # row of 1 - below that belongs to the flux
    doubles v, row, out             # the turn to the flux's axis; 3 n spare; base_out, turned
    ints pivots


cdef inline Extended slab_of(const SlabStack* p, given matrices, int place) noexcept nogil:
    """R or T of the slab at a place."""
    return extended_at(p.s, <doubles>matrices + p.slabs[place] * size_extended(p.s))


# (2:10)-(2:11)
cdef int join_slabs_one(const void* task, int item, Workspace desk) noexcept nogil:
    cdef const Arrays* t = <const Arrays*>task
    cdef Sizes s = sizes_of(t)
    cdef Nodes nodes = nodes_of(t)
    cdef int n_place = t.n_place, row = t.base_row[item], place, level, info, i, n = s.n, r = s.r
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * r, each = size_extended(s)
    cdef size_t first = <size_t>item * t.n_slab, wanted = <size_t>item * t.n_level, size = <size_t>r * s.o
    cdef doubles G = desk.work, g = G + n_place * nn, going_up = g + n_place * nr
    cdef doubles going_down = going_up + (n_place + 1) * nr, below = going_down + (n_place + 1) * nr
    cdef doubles scratch = below + nn, vectors = scratch + 4 * nn, absorbed = vectors + 4 * nr, v = absorbed + n
    cdef SlabStack p = SlabStack(
        s, nodes, t.conserving and t.orders[item] == 0, n_place, r // t.n_in, t.slabs, t.above, t.mu0,
        t.R + first * each, t.T + first * each, t.lost + first * n, G, g, going_up, going_down, below, scratch, vectors,
        absorbed, v, v + n, v + 4 * n, desk.pivots)
    cdef double size_of_flux = 0.0
    set_zero(nn, below)
    set_zero(n, absorbed)
    set_zero(2 * (n_place + 1) * nr, going_up)
    absorbed[flux_axis(n, s.stokes)] = 1.0
    if p.conserving:
        conserving_axis(nodes, v)
        size_of_flux = half_range(nodes)
    if row >= 0:
        put_base(&p, t.base + row * nn, t.base_source + row * nr, t.base_out + <size_t>row * n * s.o)
    for place in range(n_place - 1, -1, -1):
        if desk.stop[0]:
            return 0
        info = add_below(&p, place, t.residual + <size_t>item * n_place + place)
        if info != 0:
            return info
    for place in range(n_place):        # falling: T down + emitted, then up = G falling + g, then R up on top of it
        emitted(&p, place, p.T, vectors)
        multiply(n, r, n, 1.0, slab_of(&p, p.T, place).N, going_down + place * nr, 1.0, vectors)
        copy(nr, g + place * nr, going_up + (place + 1) * nr)
        multiply(n, r, n, 1.0, G + place * nn, vectors, 1.0, going_up + (place + 1) * nr)
        copy(nr, vectors, going_down + (place + 1) * nr)
        multiply(n, r, n, 1.0, slab_of(&p, p.R, place).N, going_up + (place + 1) * nr, 1.0,
                 going_down + (place + 1) * nr)
    for level in range(t.n_level):
        for i in range(r):
            first = t.interface[level] * nr + <size_t>i * n + flux_axis(n, s.stokes)
            t.flux[2 * (wanted + level) * r + i] = -sqrt(size_of_flux) * going_up[first]
            t.flux[(2 * (wanted + level) + 1) * r + i] = -sqrt(size_of_flux) * going_down[first]
    leave(&p, row >= 0, t.n_level, t.interface, t.up + wanted * size, t.down + wanted * size)
    return 0


cdef void put_base(const SlabStack* p, given base, given base_source, given base_out) noexcept nogil:
    """The base's operator, the beam that it reflects, its rows out, and (order 0) the row of what it absorbs."""
    cdef int i, n = p.s.n, axis = flux_axis(n, p.s.stokes)
    cdef size_t nr = <size_t>n * p.s.r, k
    cdef doubles up = p.going_up + p.n_place * nr
    copy(<size_t>n * n, base, p.below)
    copy(<size_t>n * p.s.o, base_out, p.out)
    for k in range(nr):
        up[k] = base_source[k] * exp(-p.above[p.n_place] / p.mu0[k // (n * <size_t>p.per_beam)])
    if not p.conserving:
        return
    reflect_both(p.nodes, p.v, p.below, p.scratch)
    turn_columns(p.nodes, p.s.r, p.v, up)
    turn_rows(p.nodes, p.s.o, p.v, p.out, p.scratch)
    for i in range(n):
        p.absorbed[i] = (1.0 if i == axis else 0.0) - p.below[<size_t>i * n + axis]
        if fabs(p.absorbed[i]) < ROUNDING:
            p.absorbed[i] = 0.0


cdef inline void emitted(const SlabStack* p, int place, given matrices, doubles out) noexcept nogil:
    """What the slab at a place sends out of the attenuated beam, up (R) or down (T)."""
    cdef int i, j
    cdef double decay
    cdef given NI = slab_of(p, matrices, place).NI
    for j in range(p.s.r):
        decay = exp(-p.above[place] / p.mu0[j // p.per_beam])
        for i in range(p.s.n):
            out[<size_t>j * p.s.n + i] = decay * NI[<size_t>j * p.s.n + i]


# (2:8)
cdef int add_below(const SlabStack* p, int place, doubles residual) noexcept nogil:
    """Puts a slab upon what lies below: G = (1 - below R)^-1 below, g = (1 - below R)^-1 up, below <- R + T G T.

    In order 0 the flux's row of 1 - below R, which is small where nothing absorbs, is summed from what is lost:
    lost + T's row + absorbed R, and `absorbed` becomes lost + (lost G + absorbed (1 + R G)) T.
    """
    cdef int n = p.s.n, n_rhs = p.s.r, i, info, axis = flux_axis(n, p.s.stokes)
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * n_rhs
    cdef Extended r = slab_of(p, p.R, place), t = slab_of(p, p.T, place)
    cdef given lost = p.lost + <size_t>p.slabs[place] * n
    cdef doubles M = p.scratch, kept = M + nn, GT = kept + nn, below = p.below, absorbed = p.absorbed, row = p.row
    cdef doubles G = p.G + place * nn, g = p.g + place * nr, vectors = p.vectors, up_above = p.going_up + place * nr
    cdef double largest
    one_minus_product(n, below, r.N, M)
    copy(nn, below, G)
    copy(nr, p.going_up + (place + 1) * nr, g)
    if p.conserving:
        multiply(1, n, n, 1.0, absorbed, r.N, 0.0, row)
        for i in range(n):
            row[i] += lost[i] + t.N[<size_t>i * n + axis]
        largest = largest_of(n, row)
        if largest > 0.0:
            for i in range(n):
                M[<size_t>i * n + axis] = row[i] / largest
                G[<size_t>i * n + axis] /= largest
            for i in range(n_rhs):
                g[<size_t>i * n + axis] /= largest
    copy(nn, M, kept)
    copy(nr, g, vectors)
    info = factorise(n, M, n, p.pivots)
    if info != 0:
        return info
    solve(n, n, M, p.pivots, G, n)
    solve(n, n_rhs, M, p.pivots, g, n)
    largest = largest_of(nr, vectors)
    multiply(n, n_rhs, n, -1.0, kept, g, 1.0, vectors)
    residual[0] = largest_of(nr, vectors) / largest if largest > NO_LIGHT else 0.0
    multiply(n, n, n, 1.0, G, t.N, 0.0, GT)
    if p.conserving:
        # absorbed (1 + R G) T = absorbed T + (absorbed R) GT
        multiply(1, n, n, 1.0, absorbed, r.N, 0.0, row)
        for i in range(n):
            row[i] += lost[i]
        copy(n, lost, row + n)
        multiply(1, n, n, 1.0, row, GT, 1.0, row + n)
        multiply(1, n, n, 1.0, absorbed, t.N, 1.0, row + n)
        copy(n, row + n, absorbed)
    copy(nn, r.N, below)
    multiply(n, n, n, 1.0, t.N, GT, 1.0, below)
    # up above = emitted up + T (G emitted down + g)
    emitted(p, place, p.T, vectors)
    copy(nr, g, vectors + nr)
    multiply(n, n_rhs, n, 1.0, G, vectors, 1.0, vectors + nr)
    emitted(p, place, p.R, up_above)
    multiply(n, n_rhs, n, 1.0, t.N, vectors + nr, 1.0, up_above)
    return 0


cdef void leave(const SlabStack* p, bint has_base, int n_level, given_ints interface, doubles up,
                doubles down) noexcept nogil:
    """The field off the nodes at every wanted interface, first up through the slabs, then down."""
    cdef size_t nr = <size_t>p.s.n * p.s.r, size = <size_t>p.s.o * p.s.r
    cdef doubles running = p.out + <size_t>p.s.n * p.s.o, next = running + size
    cdef int place, level
    set_zero(size, running)
    if has_base:
        multiply(p.s.o, p.s.r, p.s.n, 1.0, p.out, p.going_down + p.n_place * nr, 0.0, running)
    for place in range(p.n_place, -1, -1):
        for level in range(n_level):
            if interface[level] == place:
                copy(size, running, up + level * size)
        if place > 0:
            off_nodes(p, place - 1, p.R, p.going_up + place * nr, p.going_down + (place - 1) * nr, running, next)
            copy(size, next, running)
    set_zero(size, running)
    for place in range(p.n_place + 1):
        for level in range(n_level):
            if interface[level] == place:
                copy(size, running, down + level * size)
        if place < p.n_place:
            off_nodes(p, place, p.T, p.going_down + place * nr, p.going_up + (place + 1) * nr, running, next)
            copy(size, next, running)


cdef void off_nodes(const SlabStack* p, int place, given of_beam, given through, given turned, given entering,
                    doubles out) noexcept nogil:
    """out = entering let straight through + T_ON through + R_ON turned + OI of the attenuated beam, that of R (up) or T
    (down)."""
    cdef int i, j, o = p.s.o
    cdef size_t k
    cdef double decay
    cdef Extended r = slab_of(p, p.R, place), t = slab_of(p, p.T, place)
    cdef given OI = slab_of(p, of_beam, place).OI
    for j in range(p.s.r):
        decay = exp(-p.above[place] / p.mu0[j // p.per_beam])
        for i in range(o):
            k = <size_t>j * o + i
            out[k] = t.OO[i] * entering[k] + decay * OI[k]
    multiply(o, p.s.r, p.s.n, 1.0, t.ON, through, 1.0, out)
    multiply(o, p.s.r, p.s.n, 1.0, r.ON, turned, 1.0, out)
