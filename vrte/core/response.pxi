# What a slab does to all light, from its modes: light that falls in along a node has the amplitudes that the inverses
# of the slab's two systems say, and the beams' own field those that let nothing fall in. A slab does the same to light
# from above and from below (flipped frame).

cdef Job respond_job(Arrays* t) noexcept nogil:
    cdef size_t n = t.n, r = t.n_rhs
    return Job(<size_t>t.n_slab * t.n_order, slab_doubles(n, r, r), 3 * n)


cdef size_t slab_doubles(size_t n, size_t r, size_t columns) noexcept nogil:
    """Scratch memory of a slab's systems, its beams and columns of light."""
    return 4 * n * n + 6 * n * columns + 4 * n * r + 24 * n


cdef struct Columns:
    # light that falls upon a slab, from above and from below, and its even and odd modes; scratch memory
    doubles above, below, even, odd, scratch, spare, rest


cdef Slab lit_slab(const Arrays* t, int item, int count, Workspace desk, Columns* light) noexcept nogil:
    """A slab of a material in an order, and room for columns of light."""
    cdef int n = t.n, r = t.n_rhs, k = item // t.n_order
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * r, room = <size_t>n * count
    cdef size_t at = <size_t>(item % t.n_order) * t.n_layer + t.material[k]
    cdef given slant_in = slants(t.slant_in, t.material[k], t.n_in, t.mu0)
    cdef doubles systems = desk.work, top = systems + 2 * nn, tangents = top + 4 * nr
    light.above = tangents + 2 * n
    light.below, light.even, light.odd = light.above + room, light.above + 2 * room, light.above + 3 * room
    light.scratch = light.above + 4 * room
    light.spare = light.scratch + 2 * nn + 8 * n
    light.rest = light.spare + 2 * room + 8 * n
    cdef Slab slab = Slab(modes_at(n, at, t.lam_re, t.lam_im, t.X, t.Y, t.thickness[k], False), r, r // t.n_in,
                          t.c + at * nr, t.zeta + at * nr, slant_in, 0.0, systems, systems + nn, NULL, NULL, NULL, top,
                          top + nr, top + 2 * nr, top + 3 * nr, NULL, <cplx*>tangents, desk.pivots)
    slab.modes.decaying = t.thickness[k] > SEMI_INFINITE or slowest_rate(&slab.modes) * t.thickness[k] > DECAYING
    return slab


cdef inline bint is_clear(const Arrays* t, int item) noexcept nogil:
    return t.thickness[item // t.n_order] == 0.0 or t.clear_layers[t.material[item // t.n_order]]


cdef void begin_beams(const Slab* slab, Columns* light, int first) noexcept nogil:
    """The columns from `first` on: what has to fall in for the beams' own field to be all there is."""
    cdef size_t i, at = <size_t>first * slab.modes.n
    for i in range(<size_t>slab.modes.n * slab.n_rhs):
        light.above[at + i], light.below[at + i] = -slab.top[i], -slab.rising[i]


# (1:49)-(1:65), (2:8)
cdef int respond_one(const void* task, int item, Workspace desk) noexcept nogil:
    cdef const Arrays* t = <const Arrays*>task
    cdef int n = t.n, r = t.n_rhs, info, i
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * r
    cdef double length = t.thickness[item // t.n_order]
    cdef Columns light
    cdef Slab slab = lit_slab(t, item, r, desk, &light)
    slab.R, slab.up = t.nodes + 2 * item * nn, t.entering + 2 * item * nr
    slab.T, slab.down = slab.R + nn, slab.up + nr
    set_zero(2 * nn, slab.R)
    set_zero(2 * nr, slab.up)
    t.residual[item] = 0.0
    if is_clear(t, item):
        for i in range(n):
            slab.T[<size_t>i * n + i] = exp(-length * sqrt(slab.modes.lam_re[i])) if length > 0.0 else 1.0
        return 0
    info = slab_systems(&slab, light.scratch, light.spare)
    if info == 0:
        info = reflect_by_modes(&slab, desk.pivots + 2 * n, light.scratch, light.spare)      # scratch: 1 - T
    if info != 0:
        return info
    emit(&slab, light.scratch)
    begin_beams(&slab, &light, 0)
    t.residual[item] = amplitudes(&slab, light.above, light.below, light.even, light.odd, light.scratch, light.spare)
    return 0


cdef void both_faces(bint decaying, size_t nk, doubles even, doubles odd) noexcept nogil:
    """Of columns as if lit from above, those of light from above and then those of light from below: modes of the
    former with the latter from below, then the other way round: what goes down is what goes up of the slab upside
    down."""
    cdef size_t i
    cdef double e, o
    for i in range(nk):
        e, o = even[i], odd[i]
        if decaying:        # modes from the faces change places
            even[i], odd[i] = e + odd[nk + i], o + even[nk + i]
            even[nk + i], odd[nk + i] = even[nk + i] + o, odd[nk + i] + e
        else:
            even[i], odd[i] = e + even[nk + i], o - odd[nk + i]
            even[nk + i], odd[nk + i] = even[i], -odd[i]


cdef Job leave_slabs_job(Arrays* t) noexcept nogil:
    cdef size_t n = t.n, r = t.n_rhs, rows = t.n_out_rows, columns = 2 * <size_t>t.n_light + r
    return Job(<size_t>t.n_slab * t.n_order,
               slab_doubles(n, r, columns) + n * r + rows * (5 * n + columns + 3 * r + ARRIVAL) + 2 * n, 2 * n)


# (1:36)-(1:38)
cdef int leave_slabs_one(const void* task, int item, Workspace desk) noexcept nogil:
    cdef const Arrays* t = <const Arrays*>task
    cdef int n = t.n, r = t.n_rhs, o = t.n_out_rows, k = t.n_light, info
    cdef size_t nk = <size_t>n * k, ok = <size_t>o * k, on = <size_t>o * n
    cdef size_t at = <size_t>(item % t.n_order) * t.n_layer + t.material[item // t.n_order]
    cdef double length = t.thickness[item // t.n_order]
    cdef doubles leaving = t.leaving + 2 * item * ok, passing = t.passing + 2 * item * (<size_t>o * r)
    cdef given above = t.light_above + item * nk
    cdef given below = t.light_below + item * nk
    cdef Columns light
    cdef Slab slab = lit_slab(t, item, 2 * k + r, desk, &light)
    cdef doubles g_e = light.rest, g_f = g_e + on, seen = g_f + on, work = seen + <size_t>o * (2 * k + r)
    cdef Path path
    set_zero(2 * ok, leaving)
    set_zero(2 * <size_t>o * r, passing)
    t.residual[item] = 0.0
    if is_clear(t, item):
        return 0
    info = slab_systems(&slab, light.scratch, light.spare)
    if info != 0:
        return info
    copy(nk, above, light.above)
    copy(nk, below, light.above + nk)
    set_zero(2 * nk, light.below)
    begin_beams(&slab, &light, 2 * k)
    slab.n_rhs = 2 * k + r
    t.residual[item] = amplitudes(&slab, light.above, light.below, light.even, light.odd, light.scratch, light.spare)
    both_faces(slab.modes.decaying, nk, light.even, light.odd)
    multiply(o, n, n, 1.0, t.G_E + at * on, slab.modes.X, 0.0, g_e)
    multiply(o, n, n, 1.0, t.G_F + at * on, slab.modes.Y, 0.0, g_f)
    path = Path(slab.modes, True, t.stokes, o, t.n_out, 2 * k, r, slab.per_beam, g_e, g_f, slab.c, slab.zeta,
                light.even, light.odd, slab.mu0, slants(t.slant_out, t.material[item // t.n_order], t.n_out, t.mu_out),
                0.0, 0.0, 0.0, 0.0)
    set_zero(<size_t>o * (2 * k + r), seen)
    through_layer(&path, seen, seen, work)
    copy((1 if length > SEMI_INFINITE else 2) * ok, seen, leaving)
    copy(<size_t>o * r, seen + 2 * ok, passing)
    if length > SEMI_INFINITE:
        return 0
    passing += <size_t>r * o
    path.upward, path.depth, path.unlit = False, length, 0
    path.even, path.odd = light.even + 2 * nk, light.odd + 2 * nk
    through_layer(&path, passing, passing, work)
    return 0
