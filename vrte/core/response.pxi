# What a slab does to all light, from its modes: light that falls in along a node has the amplitudes that the inverses
# of the slab's two systems say, and the beams' own field those that let nothing fall in. A slab does the same to light
# from above and from below (flipped frame): "odd" modes change sign, those that decay from the faces change places.

def response_work(n, n_rhs, rows):
    """Doubles of scratch memory that one thread of `respond` needs."""
    return 4 * n * n + 6 * n * (n + n_rhs) + 5 * n * n_rhs + rows * (6 * n + 4 * n_rhs + ARRIVAL) + 24 * n


cdef struct Responding:
    int n, stokes, n_in, n_rhs, n_out, n_order, n_material
    given lam_re, lam_im, X, Y, c, zeta, G_E, G_F
    given_ints clear, material
    given thickness, mu0, mu_out
    doubles nodes, entering, leaving, passing, residual


def respond(crew, *, const double[:, :, ::1] lam_re, const double[:, :, ::1] lam_im, const double[:, :, :, ::1] X,
            const double[:, :, :, ::1] Y, const double[:, :, :, ::1] c, const double[:, :, :, ::1] zeta,
            const double[:, :, :, ::1] G_E, const double[:, :, :, ::1] G_F, const int[::1] clear,
            const int[::1] material, const double[::1] thickness, const double[::1] mu0, const double[::1] mu_out,
            double[:, :, :, :, ::1] nodes, double[:, :, :, :, ::1] entering, double[:, :, :, :, ::1] leaving,
            double[:, :, :, :, ::1] passing, double[:, ::1] residual, int[:, ::1] info):
    """Reflection and transmission of slabs by modes.

    lam_re, lam_im, X, Y (order, material, ...) of `homogeneous`, c, zeta of `particular`, G_E, G_F of `assemble`; clear
    (material,): not 0 for what is known not to scatter; material, thickness (slab,), inf allowed. Filled, reflected (0)
    and transmitted (1), for slab and order: nodes (slab, order, 2, n, n) from the scaled field on the nodes, entering
    (slab, order, 2, n_rhs, n) from unit beams, leaving (slab, order, 2, n, S n_out) and passing (slab, order, 2, n_rhs,
    S n_out), radiance times 2 pi, without what is scattered once from beam to direction; residual (slab, order): of
    the two systems, relative.
    """
    cdef int n = <int>X.shape[3], n_out = <int>mu_out.shape[0], n_rhs = <int>c.shape[2], rows = <int>leaving.shape[4]
    cdef Responding task = Responding(
        n, rows // n_out, <int>mu0.shape[0], n_rhs, n_out, <int>X.shape[0], <int>X.shape[1], &lam_re[0, 0, 0],
        &lam_im[0, 0, 0], &X[0, 0, 0, 0], &Y[0, 0, 0, 0], &c[0, 0, 0, 0], &zeta[0, 0, 0, 0], &G_E[0, 0, 0, 0],
        &G_F[0, 0, 0, 0], &clear[0], &material[0], &thickness[0], &mu0[0], &mu_out[0], &nodes[0, 0, 0, 0, 0],
        &entering[0, 0, 0, 0, 0], &leaving[0, 0, 0, 0, 0], &passing[0, 0, 0, 0, 0], &residual[0, 0])
    run_items(crew, respond_one, &task, <int>(nodes.shape[0] * nodes.shape[1]), response_work(n, n_rhs, rows), 3 * n,
              &info[0, 0])


# (1:36)-(1:38), (1:49)-(1:65), (2:8)
cdef int respond_one(const void* task, int item, Workspace desk) noexcept nogil:
    cdef const Responding* t = <const Responding*>task
    cdef int n = t.n, r = t.n_rhs, o = t.stokes * t.n_out, all_ = n + r, info, i, j
    cdef int k = item // t.n_order, kind = t.material[k]
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * r, at = <size_t>(item % t.n_order) * t.n_material + kind, first
    cdef double length = t.thickness[k]
    cdef doubles R = t.nodes + 2 * item * nn, T = R + nn, up = t.entering + 2 * item * nr, down = up + nr
    cdef doubles leaving = t.leaving + 2 * item * (<size_t>n * o), passing = t.passing + 2 * item * (<size_t>r * o)
    cdef doubles systems = desk.work, top = systems + 2 * nn, rising = top + nr, falling = rising + nr
    cdef doubles above = falling + nr, below = above + all_ * n, even = below + all_ * n, odd = even + all_ * n
    cdef doubles scratch = odd + all_ * n, spare = scratch + 2 * nn + 8 * n, tangents = spare + 2 * all_ * n + 8 * n
    cdef doubles g_e = tangents + 2 * n, g_f = g_e + <size_t>o * n, seen = g_f + <size_t>o * n
    cdef doubles work = seen + <size_t>o * all_
    cdef Slab slab = Slab(modes_at(n, at, t.lam_re, t.lam_im, t.X, t.Y, length, False), r, r // t.n_in, t.c + at * nr,
                          t.zeta + at * nr, t.mu0, 0.0, systems, systems + nn, R, T, NULL, top, rising, falling, NULL,
                          NULL, <cplx*>tangents, desk.pivots)
    cdef Path path
    set_zero(2 * nn, R)
    set_zero(2 * nr, up)
    set_zero(2 * <size_t>n * o, leaving)
    set_zero(2 * <size_t>r * o, passing)
    t.residual[item] = 0.0
    if length == 0.0 or t.clear[kind]:
        for i in range(n):
            T[<size_t>i * n + i] = exp(-length * sqrt(slab.modes.lam_re[i])) if length > 0.0 else 1.0
        return 0
    slab.modes.decaying = length > SEMI_INFINITE or slowest_rate(&slab.modes) * length > DECAYING
    info = slab_systems(&slab, scratch, spare)
    if info == 0:
        info = reflect_by_modes(&slab, desk.pivots + 2 * n, scratch, spare)             # scratch: 1 - T
    if info != 0:
        return info
    emit(&slab, scratch, up, down, spare)
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
                t.mu0, t.mu_out, 0.0, 0.0, 0.0, 0.0)
    set_zero(<size_t>o * all_, seen)
    through_layer(&path, seen, seen, work)
    copy(<size_t>o * n, seen, leaving)
    copy(<size_t>o * r, seen + <size_t>o * n, passing)
    if length > SEMI_INFINITE:
        return 0
    # from below: work still begins with the gains of even and of odd modes
    leaving, passing = leaving + <size_t>o * n, passing + <size_t>o * r
    multiply(o, n, n, 1.0, work, odd if slab.modes.decaying else even, 0.0, leaving)
    multiply(o, n, n, 1.0 if slab.modes.decaying else -1.0, work + <size_t>o * n,
             even if slab.modes.decaying else odd, 1.0, leaving)
    path.upward, path.depth, path.unlit = False, length, 0
    path.even, path.odd = even + nn, odd + nn
    through_layer(&path, passing, passing, work)
    return 0


# (1:57)-(1:65)
cdef int reflect_by_modes(const Slab* slab, ints pivots_inner, doubles scratch, doubles spare) noexcept nogil:
    """R = So - Se, T and 1 - T = So + Se, which is left in scratch, Se = Y lambda f (X + Y lambda f)^-1 and
    So = X f (X f + Y)^-1: of a thin slab both are as small as its thickness, and keep their digits."""
    cdef const Modes* a = &slab.modes
    cdef int n = a.n, j, info = 0
    cdef size_t nn = <size_t>n * n, i
    cdef cplx* f = <cplx*>spare
    cdef doubles R = slab.R, T = slab.T
    if a.decaying:
        info = decaying_slab(slab, pivots_inner, scratch, spare)
        for i in range(nn):
            scratch[i] = -T[i]
        for j in range(n):
            scratch[<size_t>j * n + j] += 1.0
        return info
    scale_columns(n, n, a.lam_im, slab.tangents, a.X, R)
    times_inverse(n, slab.odd_lu, slab.pivots + n, R)
    for j in range(n):
        f[j] = times(slab.tangents[j], lambda_of(a, j))
    scale_columns(n, n, a.lam_im, f, a.Y, scratch)
    times_inverse(n, slab.even_lu, slab.pivots, scratch)
    for i in range(nn):
        R[i], scratch[i] = R[i] - scratch[i], R[i] + scratch[i]
        T[i] = -scratch[i]
    for j in range(n):
        T[<size_t>j * n + j] += 1.0
    return info


# (1:28)-(1:34)
cdef void emit(const Slab* slab, given lost, doubles up, doubles down, doubles spare) noexcept nogil:
    """What a slab sends out of beams where nothing falls in, up at its top and down at its bottom: the beams' own field
    at both faces, less what would have to fall in to allow it; lost: 1 - T. Nothing is a difference of larger terms."""
    cdef const Modes* a = &slab.modes
    cdef int n = a.n, r, j
    cdef doubles y = spare, z = y + n, x = z + n
    cdef cplx* response = <cplx*>(x + 2 * n)
    cdef cplx k
    cdef double rate
    for r in range(slab.n_rhs):
        rate = 1.0 / slab.mu0[r // slab.per_beam]
        for j in range(n if r % slab.per_beam == 0 else 0):
            k = rate_of(a, j)
            response[j] = beam_response(k, rate, a.thickness) if a.thickness < SEMI_INFINITE else make(0.0, 0.0)
            response[n + j] = times(k, response[j])
        scale_coordinates(n, a.lam_im, response, slab.c + <size_t>r * n, y)
        scale_coordinates(n, a.lam_im, response + n, slab.c + <size_t>r * n, z)
        for j in range(n):
            z[j] += slab.zeta[<size_t>r * n + j] * expm1(-a.thickness * rate)
        multiply(n, 1, n, 0.5, a.X, y, 0.0, x)
        multiply(n, 1, n, 0.5, a.Y, z, 0.0, x + n)
        for j in range(n):
            up[<size_t>r * n + j], down[<size_t>r * n + j] = x[n + j] - x[j], x[n + j] + x[j]
    multiply(n, slab.n_rhs, n, -1.0, slab.R, slab.top, 1.0, up)
    multiply(n, slab.n_rhs, n, 1.0, lost, slab.rising, 1.0, up)
    multiply(n, slab.n_rhs, n, 1.0, lost, slab.top, 1.0, down)
    multiply(n, slab.n_rhs, n, -1.0, slab.R, slab.rising, 1.0, down)
