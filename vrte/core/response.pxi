# What a slab does to all light, from its modes: light that falls in along a node has the amplitudes that the inverses
# of the slab's two systems say, and the beams' own field those that let nothing fall in. A slab does the same to light
# from above and from below (flipped frame).

cdef Slab lit_slab(const Arrays* t) noexcept nogil:
    """A slab of a material in an order."""
    cdef int n = t.n, r = t.n_rhs
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * r, at = t.material[0]
    cdef Slab slab = Slab(modes_at(n, at, t.lam_re, t.lam_im, t.X, t.Y, t.thickness[0], False), r, r // t.n_in,
                          t.c + at * nr, t.zeta + at * nr, slants(t.slant_in, t.material[0], t.n_in, t.mu0), 0.0,
                          t.systems, t.systems + nn, NULL, NULL, NULL, t.beams, t.beams + nr, t.beams + 2 * nr,
                          t.beams + 3 * nr, NULL, <cplx*>t.tangents, t.pivots)
    slab.modes.decaying = t.thickness[0] > SEMI_INFINITE or slowest_rate(&slab.modes) * t.thickness[0] > DECAYING
    return slab


cdef inline bint is_clear(const Arrays* t) noexcept nogil:
    return t.thickness[0] == 0.0 or t.clear_layers[t.material[0]]


cdef double begin_beams(Slab* slab, const Arrays* t, int first) noexcept nogil:
    """The modes of light that falls upon a slab, whose columns from `first` on are what has to fall in for the beams'
    own field to be all there is; the relative residual."""
    cdef size_t i, at = <size_t>first * t.n
    for i in range(<size_t>t.n * t.n_rhs):
        t.light_above_columns[at + i], t.light_below_columns[at + i] = -slab.top[i], -slab.rising[i]
    slab.n_rhs = first + t.n_rhs
    return amplitudes(slab, t.light_above_columns, t.light_below_columns, t.even_columns, t.odd_columns, t.scratch,
                      t.spare)


# (1:49)-(1:65), (2:8)
cdef int respond_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    cdef int n = t.n, info, i
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * t.n_rhs
    cdef double light
    cdef Slab slab = lit_slab(t)
    slab.R, slab.T, slab.up, slab.down = t.nodes, t.nodes + nn, t.entering, t.entering + nr
    set_zero(2 * nn, slab.R)
    set_zero(2 * nr, slab.up)
    t.residual[0] = 0.0
    if is_clear(t):
        for i in range(n):
            light = exp(-t.thickness[0] * sqrt(slab.modes.lam_re[i])) if t.thickness[0] > 0.0 else 1.0
            slab.T[<size_t>i * n + i] = light
        return 0
    info = slab_systems(&slab, t.scratch, t.spare)
    if info == 0:
        info = reflect_by_modes(&slab, t.pivots + 2 * n, t.scratch, t.spare)      # scratch: 1 - T
    if info != 0:
        return info
    emit(&slab, t.scratch)
    t.residual[0] = begin_beams(&slab, t, 0)
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


# (1:36)-(1:38)
cdef int leave_slabs_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    cdef int n = t.n, r = t.n_rhs, o = t.n_out_rows, k = t.n_light, info
    cdef size_t nk = <size_t>n * k, ok = <size_t>o * k, on = <size_t>o * n, at = t.material[0]
    cdef doubles passing = t.passing, seen = t.seen_columns
    cdef Slab slab = lit_slab(t)
    cdef Path path
    set_zero(2 * ok, t.leaving)
    set_zero(2 * <size_t>o * r, passing)
    t.residual[0] = 0.0
    if is_clear(t):
        return 0
    info = slab_systems(&slab, t.scratch, t.spare)
    if info != 0:
        return info
    copy(nk, t.light_above, t.light_above_columns)
    copy(nk, t.light_below, t.light_above_columns + nk)
    set_zero(2 * nk, t.light_below_columns)
    t.residual[0] = begin_beams(&slab, t, 2 * k)
    both_faces(slab.modes.decaying, nk, t.even_columns, t.odd_columns)
    multiply(o, n, n, 1.0, t.G_E + at * on, slab.modes.X, 0.0, t.g_e)
    multiply(o, n, n, 1.0, t.G_F + at * on, slab.modes.Y, 0.0, t.g_f)
    path = Path(slab.modes, True, t.stokes, o, t.n_out, 2 * k, r, slab.per_beam, t.g_e, t.g_f, slab.c, slab.zeta,
                t.even_columns, t.odd_columns, slab.mu0, slants(t.slant_out, t.material[0], t.n_out, t.mu_out),
                0.0, 0.0, 0.0, 0.0)
    set_zero(<size_t>o * (2 * k + r), seen)
    through_layer(&path, seen, seen, t.work)
    copy((1 if t.thickness[0] > SEMI_INFINITE else 2) * ok, seen, t.leaving)
    copy(<size_t>o * r, seen + 2 * ok, passing)
    if t.thickness[0] > SEMI_INFINITE:
        return 0
    passing += <size_t>r * o
    path.upward, path.depth, path.unlit = False, t.thickness[0], 0
    path.even, path.odd = t.even_columns + 2 * nk, t.odd_columns + 2 * nk
    through_layer(&path, passing, passing, t.work)
    return 0
