# What a slab does to all light, from its modes: light that falls in along a node has the amplitudes that the inverses
# of the slab's two systems say, and the beams' own field those that let nothing fall in. A slab does the same to light
# from above and from below (flipped frame): "odd" modes change sign, those that decay from the faces change places.

cdef Job respond_job(Arrays* t) noexcept nogil:
    cdef size_t n = t.n, r = t.n_rhs, rows = t.n_out_rows
    return Job(<size_t>t.n_slab * t.n_order, 4 * n * n + 6 * n * (n + r) + 5 * n * r + rows * (6 * n + 4 * r + ARRIVAL)
               + 24 * n, 3 * n)


# (1:36)-(1:38), (1:49)-(1:65), (2:8)
cdef int respond_one(const void* task, int item, Workspace desk) noexcept nogil:
    cdef const Arrays* t = <const Arrays*>task
    cdef int n = t.n, r = t.n_rhs, o = t.n_out_rows, all_ = n + r, info, i, j
    cdef int k = item // t.n_order, kind = t.material[k]
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * r, at = <size_t>(item % t.n_order) * t.n_layer + kind, first
    cdef double length = t.thickness[k]
    cdef given slant_in = slants(t.slant_in, kind, t.n_in, t.mu0)
    cdef doubles R = t.nodes + 2 * item * nn, T = R + nn, up = t.entering + 2 * item * nr, down = up + nr
    cdef doubles leaving = t.leaving + 2 * item * (<size_t>n * o), passing = t.passing + 2 * item * (<size_t>r * o)
    cdef doubles systems = desk.work, top = systems + 2 * nn, rising = top + nr
    cdef doubles above = rising + nr, below = above + all_ * n, even = below + all_ * n, odd = even + all_ * n
    cdef doubles scratch = odd + all_ * n, spare = scratch + 2 * nn + 8 * n, tangents = spare + 2 * all_ * n + 8 * n
    cdef doubles g_e = tangents + 2 * n, g_f = g_e + <size_t>o * n, seen = g_f + <size_t>o * n
    cdef doubles work = seen + <size_t>o * all_
    cdef Slab slab = Slab(modes_at(n, at, t.lam_re, t.lam_im, t.X, t.Y, length, False), r, r // t.n_in, t.c + at * nr,
                          t.zeta + at * nr, slant_in, 0.0, systems, systems + nn, R, T, NULL, top, rising, up, down,
                          NULL, <cplx*>tangents, desk.pivots)
    cdef Path path
    set_zero(2 * nn, R)
    set_zero(2 * nr, up)
    set_zero(2 * <size_t>n * o, leaving)
    set_zero(2 * <size_t>r * o, passing)
    t.residual[item] = 0.0
    if length == 0.0 or t.clear_layers[kind]:
        for i in range(n):
            T[<size_t>i * n + i] = exp(-length * sqrt(slab.modes.lam_re[i])) if length > 0.0 else 1.0
        return 0
    slab.modes.decaying = length > SEMI_INFINITE or slowest_rate(&slab.modes) * length > DECAYING
    info = slab_systems(&slab, scratch, spare)
    if info == 0:
        info = reflect_by_modes(&slab, desk.pivots + 2 * n, scratch, spare)             # scratch: 1 - T
    if info != 0:
        return info
    emit(&slab, scratch)
    set_zero(2 * <size_t>all_ * n, above)                            # falling in from above, and from below
    for i in range(n):
        above[<size_t>i * n + i] = 1.0
    for first in range(nr):
        above[nn + first], below[nn + first] = -top[first], -rising[first]
    slab.n_rhs = all_
    t.residual[item] = amplitudes(&slab, above, below, even, odd, scratch, spare)
    multiply(o, n, n, 1.0, t.G_E + at * n * o, slab.modes.X, 0.0, g_e)
    multiply(o, n, n, 1.0, t.G_F + at * n * o, slab.modes.Y, 0.0, g_f)
    path = Path(slab.modes, True, t.stokes, o, t.n_out, n, r, r // t.n_in, g_e, g_f, slab.c, slab.zeta, even, odd,
                slant_in, slants(t.slant_out, kind, t.n_out, t.mu_out), 0.0, 0.0, 0.0, 0.0)
    set_zero(<size_t>o * all_, seen)
    through_layer(&path, seen, seen, work)
    copy(<size_t>o * n, seen, leaving)
    copy(<size_t>o * r, seen + <size_t>o * n, passing)
    if length > SEMI_INFINITE:
        return 0
    # from below: work still begins with the gains of even and of odd modes, one of which changes its sign
    if slab.modes.decaying:
        multiply(o, n, n, 1.0, work, odd, 0.0, leaving + <size_t>o * n)
        multiply(o, n, n, 1.0, work + <size_t>o * n, even, 1.0, leaving + <size_t>o * n)
    else:
        for first in range(<size_t>o * n):
            leaving[o * n + first] = -leaving[first]
        multiply(o, n, n, 2.0, work, even, 1.0, leaving + <size_t>o * n)
    passing += <size_t>r * o
    path.upward, path.depth, path.unlit = False, length, 0
    path.even, path.odd = even + nn, odd + nn
    through_layer(&path, passing, passing, work)
    return 0
