# Doubled slabs added from the base up, then the field at their interfaces from the top down, on the nodes and off them.

cdef Job join_slabs_job(Arrays* t) noexcept nogil:
    cdef size_t n = t.n, r = t.n_rhs
    return Job(t.n_order, t.n_place * n * (n + r) + (2 * t.n_place + 3) * n * r + stack_doubles(n, r) + 5 * n
               + t.n_out_rows * (n + 2 * r), n)


cdef struct SlabStack:
    # one order of a stack of slabs
    Sizes s
    Nodes nodes
    int n_place, per_beam
    given_ints slabs
    given above, mu0, R, T
    doubles going_up, going_down    # per interface
    doubles v, out                  # the turn to the flux's axis; base_out, turned


cdef inline Extended slab_of(const SlabStack* p, given matrices, int place) noexcept nogil:
    """R or T of the slab at a place."""
    return extended_at(p.s, <doubles>matrices + p.slabs[place] * size_extended(p.s))


cdef int join_slabs_one(const void* task, int item, Workspace desk) noexcept nogil:
    cdef const Arrays* t = <const Arrays*>task
    cdef Sizes s = sizes_of(t)
    cdef int n_place = t.n_place, row = t.base_row[item], place, level, info, i, n = s.n, r = s.r
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * r, each = size_extended(s)
    cdef size_t first = <size_t>item * t.n_slab, wanted = <size_t>item * t.n_level, size = <size_t>r * s.o
    cdef doubles G = desk.work, g = G + n_place * nn, going_up = g + n_place * nr
    cdef doubles going_down = going_up + (n_place + 1) * nr, right = going_down + (n_place + 1) * nr
    cdef doubles v = right + nr, absorbed = v + n, memory = absorbed + 3 * n, out = memory + stack_doubles(n, r)
    cdef SlabStack p = SlabStack(s, nodes_of(t), n_place, r // t.n_in, t.slabs, t.above, t.mu0, t.R + first * each,
                                 t.T + first * each, going_up, going_down, v, out)
    cdef Stack stack = stack_at(n, r, memory, desk.pivots, True)
    cdef Flux flux = Flux(flux_axis(n, s.stokes), NULL, absorbed, absorbed + n)
    cdef Element one
    cdef double size_of_flux = 0.0
    set_zero(n, absorbed)
    set_zero(2 * (n_place + 1) * nr, going_up)
    absorbed[flux.axis] = 1.0
    if t.conserving and t.orders[item] == 0:
        stack.flux = &flux
        conserving_axis(p.nodes, v)
        size_of_flux = half_range(p.nodes)
    if row >= 0:
        put_base(&p, &stack, t.base + row * nn, t.base_source + row * nr, t.base_out + <size_t>row * n * s.o)
    for place in range(n_place - 1, -1, -1):
        if desk.stop[0]:
            return 0
        flux.lost, stack.missing = t.lost + (first + t.slabs[place]) * n, 0.0
        one = slab_element(n, slab_of(&p, p.R, place).N, slab_of(&p, p.T, place).N)
        emitted(&p, place, p.R, going_up + place * nr)
        emitted(&p, place, p.T, going_down + (place + 1) * nr)
        info = add(&stack, &one, going_down + (place + 1) * nr, going_up + (place + 1) * nr, going_up + place * nr,
                   going_up + place * nr, G + place * nn if place > 0 else NULL, g + place * nr)
        if info != 0:
            return info
        t.residual[<size_t>item * n_place + place] = stack.missing
    for place in range(n_place):
        one = slab_element(n, slab_of(&p, p.R, place).N, slab_of(&p, p.T, place).N)
        go_down(n, r, &one, going_down + place * nr, G + place * nn if place > 0 else NULL, g + place * nr,
                going_up + (place + 1) * nr, going_down + (place + 1) * nr, right)
    for level in range(t.n_level):
        for i in range(r):
            first = t.interface[level] * nr + <size_t>i * n + flux.axis
            t.flux[2 * (wanted + level) * r + i] = -sqrt(size_of_flux) * going_up[first]
            t.flux[(2 * (wanted + level) + 1) * r + i] = -sqrt(size_of_flux) * going_down[first]
    leave(&p, row >= 0, t.n_level, t.interface, t.up + wanted * size, t.down + wanted * size)
    return 0


cdef void put_base(const SlabStack* p, Stack* stack, given base, given base_source, given base_out) noexcept nogil:
    """The base's operator, the beam that it reflects, its rows out, and (order 0) the row of what it absorbs."""
    cdef int i, n = p.s.n
    cdef size_t nr = <size_t>n * p.s.r, k
    cdef doubles up = p.going_up + p.n_place * nr, absorbed
    copy(<size_t>n * n, base, stack.below)
    copy(<size_t>n * p.s.o, base_out, p.out)
    stack.dark = False
    for k in range(nr):
        up[k] = base_source[k] * exp(-p.above[p.n_place] / p.mu0[k // (n * <size_t>p.per_beam)])
    if stack.flux == NULL:
        return
    reflect_both(p.nodes, p.v, stack.below, stack.spare)
    turn_columns(p.nodes, p.s.r, p.v, up)
    turn_rows(p.nodes, p.s.o, p.v, p.out, p.out + <size_t>n * p.s.o)
    absorbed = stack.flux.absorbed
    for i in range(n):
        absorbed[i] -= stack.below[<size_t>i * n + stack.flux.axis]
        if fabs(absorbed[i]) < ROUNDING:
            absorbed[i] = 0.0


cdef inline void emitted(const SlabStack* p, int place, given matrices, doubles out) noexcept nogil:
    """What the slab at a place sends out of the attenuated beam, up (R) or down (T)."""
    cdef int i, j
    cdef double decay
    cdef given NI = slab_of(p, matrices, place).NI
    for j in range(p.s.r):
        decay = exp(-p.above[place] / p.mu0[j // p.per_beam])
        for i in range(p.s.n):
            out[<size_t>j * p.s.n + i] = decay * NI[<size_t>j * p.s.n + i]


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
