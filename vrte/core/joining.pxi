# Doubled slabs added from the base up, then the field at their interfaces from the top down, on the nodes and off them.

cdef inline Extended slab_of(const Arrays* t, given matrices, int place) noexcept nogil:
    """R or T of the slab at a place."""
    return extended_at(sizes_of(t), <doubles>matrices + t.slabs[place] * size_extended(sizes_of(t)))


cdef int join_slabs_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    cdef int n_place = t.n_place, row = t.base_row[0], place, level, info, i, n = t.n, r = t.n_rhs
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * r, at
    cdef doubles up = t.going_up, down = t.going_down
    cdef Stack stack = stack_at(n, r, t.memory, t.pivots, True)
    cdef Flux flux = Flux(flux_axis(n, t.stokes), NULL, t.absorbed, t.row)
    cdef Element one
    cdef double size_of_flux = 0.0
    set_zero(n, t.absorbed)
    set_zero((n_place + 1) * nr, up)
    set_zero((n_place + 1) * nr, down)
    t.absorbed[flux.axis] = 1.0
    if t.conserving and t.orders[0] == 0:
        stack.flux = &flux
        conserving_axis(nodes_of(t), t.v)
        size_of_flux = half_range(nodes_of(t))
    if row >= 0:
        put_base(t, &stack, row)
    for place in range(n_place - 1, -1, -1):
        if desk.stop[0]:
            return 0
        flux.lost, stack.missing = t.lost + t.slabs[place] * <size_t>n, 0.0
        one = slab_element(n, slab_of(t, t.R, place).N, slab_of(t, t.T, place).N)
        emitted(t, place, t.R, up + place * nr)
        emitted(t, place, t.T, down + (place + 1) * nr)
        info = add(&stack, &one, down + (place + 1) * nr, up + (place + 1) * nr, up + place * nr, up + place * nr,
                   t.G + place * nn if place > 0 else NULL, t.g + place * nr)
        if info != 0:
            return info
        t.residual[place] = stack.missing
    for place in range(n_place):
        one = slab_element(n, slab_of(t, t.R, place).N, slab_of(t, t.T, place).N)
        go_down(n, r, &one, down + place * nr, t.G + place * nn if place > 0 else NULL, t.g + place * nr,
                up + (place + 1) * nr, down + (place + 1) * nr, t.right)
    for level in range(t.n_level):
        for i in range(r):
            at = t.interface[level] * nr + <size_t>i * n + flux.axis
            t.flux[2 * level * r + i] = -sqrt(size_of_flux) * up[at]
            t.flux[(2 * level + 1) * r + i] = -sqrt(size_of_flux) * down[at]
    leave(t, row >= 0)
    return 0


cdef void put_base(const Arrays* t, Stack* stack, int row) noexcept nogil:
    """The base's operator, the beam that it reflects, its rows out, and (order 0) the row of what it absorbs."""
    cdef int i, n = t.n
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * t.n_rhs, k
    cdef doubles up = t.going_up + t.n_place * nr, absorbed = t.absorbed
    copy(nn, t.base + row * nn, stack.below)
    copy(<size_t>n * t.n_out_rows, t.base_out + row * <size_t>n * t.n_out_rows, t.base_rows)
    stack.dark = False
    for k in range(nr):
        up[k] = t.base_source[row * nr + k] * exp(-t.above[t.n_place] / t.mu0[k // (n * <size_t>t.n_col)])
    if stack.flux == NULL:
        return
    reflect_both(nodes_of(t), t.v, stack.below, stack.spare)
    turn_columns(nodes_of(t), t.n_rhs, t.v, up)
    turn_rows(nodes_of(t), t.n_out_rows, t.v, t.base_rows, t.running)
    for i in range(n):
        absorbed[i] -= stack.below[<size_t>i * n + stack.flux.axis]
        if fabs(absorbed[i]) < ROUNDING:
            absorbed[i] = 0.0


cdef inline void emitted(const Arrays* t, int place, given matrices, doubles out) noexcept nogil:
    """What the slab at a place sends out of the attenuated beam, up (R) or down (T)."""
    cdef int i, j
    cdef double decay
    cdef given NI = slab_of(t, matrices, place).NI
    for j in range(t.n_rhs):
        decay = exp(-t.above[place] / t.mu0[j // t.n_col])
        for i in range(t.n):
            out[<size_t>j * t.n + i] = decay * NI[<size_t>j * t.n + i]


cdef void leave(const Arrays* t, bint has_base) noexcept nogil:
    """The field off the nodes at every wanted interface, first up through the slabs, then down."""
    cdef size_t nr = <size_t>t.n * t.n_rhs, size = <size_t>t.n_out_rows * t.n_rhs
    cdef int step, here, level, upward
    for upward in range(1, -1, -1):
        set_zero(size, t.running)
        if upward and has_base:
            multiply(t.n_out_rows, t.n_rhs, t.n, 1.0, t.base_rows, t.going_down + t.n_place * nr, 0.0, t.running)
        for step in range(t.n_place + 1):
            here = t.n_place - step if upward else step
            for level in range(t.n_level):
                if t.interface[level] == here:
                    copy(size, t.running, (t.up if upward else t.down) + level * size)
            if step == t.n_place:
                break
            if upward:
                off_nodes(t, here - 1, t.R, t.going_up + here * nr, t.going_down + (here - 1) * nr)
            else:
                off_nodes(t, here, t.T, t.going_down + here * nr, t.going_up + (here + 1) * nr)
            copy(size, t.passed_on, t.running)


cdef void off_nodes(const Arrays* t, int place, given of_beam, given through, given turned) noexcept nogil:
    """passed_on = running let straight through + T_ON through + R_ON turned + OI of the attenuated beam, that of R (up)
    or T (down)."""
    cdef int i, j, o = t.n_out_rows
    cdef size_t k
    cdef double decay
    cdef Extended R = slab_of(t, t.R, place), T = slab_of(t, t.T, place)
    cdef given OI = slab_of(t, of_beam, place).OI
    for j in range(t.n_rhs):
        decay = exp(-t.above[place] / t.mu0[j // t.n_col])
        for i in range(o):
            k = <size_t>j * o + i
            t.passed_on[k] = T.OO[i] * t.running[k] + decay * OI[k]
    multiply(o, t.n_rhs, t.n, 1.0, T.ON, through, 1.0, t.passed_on)
    multiply(o, t.n_rhs, t.n, 1.0, R.ON, turned, 1.0, t.passed_on)
