# A slab over black ground by partial fractions of tanh, for phase matrices of few terms. With A = F E and half the
# thickness h, f(A) = tanh(h sqrt A)/sqrt A = h (c + sum_k s_k (h^2 A + p_k)^-1), all of it positive; E and F are but
# for their diagonal of as many columns as there are terms, and so is every (A + p)^-1, by small systems. Then Ze = E f
# and Zo = f F, as doubling ends with, and (1 + Ze)^-1 and (1 + Zo)^-1 on what the beams bring alone.

def fractions_work(n, n_out, n_rhs, n_all, n_term, stokes, poles):
    """Doubles of scratch memory that one thread of `reflect_by_fractions` needs."""
    g, o = 4 * n_term, stokes * n_out
    assembling = 3 * n_all * n_term + n_all
    return assembling + n * g * (5 + 2 * poles) + g * g + 2 * n * n + n * o + n_rhs * (
        9 * n + 2 * g * poles + 4 * o) + 5 * n


cdef struct Fractions:
    int n_layer, n_term, n_node, n_out, n_in, n_col, n_all, stokes, poles
    given_ints orders, members, terms
    given coefficients, albedo, thickness, directions, weights, columns, place, share
    double constant
    given E, F, G_E, G_F, source_s, source_d
    doubles out, on_nodes, residual


def reflect_by_fractions(crew, *, const int[::1] orders, const int[::1] members, const double[:, :, ::1] coefficients,
                         const int[::1] terms, const double[::1] albedo, const double[::1] thickness,
                         const double[::1] directions, const double[::1] weights, int n_out,
                         const double[:, ::1] columns, const double[::1] place, const double[::1] share,
                         double constant, const double[:, :, :, ::1] E, const double[:, :, :, ::1] F,
                         const double[:, :, :, ::1] G_E, const double[:, :, :, ::1] G_F,
                         const double[:, :, :, ::1] source_s, const double[:, :, :, ::1] source_d,
                         double[:, :, :, :, ::1] out, double[:, :, :, :, ::1] on_nodes, double[:, ::1] residual,
                         int[:, ::1] info):
    """What slabs over black ground reflect and transmit of some beams, without singly scattered light.

    Each layer is a scene by itself: items are (order, scene), and none depends on another; scenes side by side share
    nodes, directions, Stokes columns and the fractions. orders to n_out and E to
    source_d as in `assemble`; thickness (scene,); columns (n_col, S); place, share (pole,), constant: of
    tanh(x)/x = constant + sum share/(x^2 + place) up to the largest x = thickness/(2 mu). out (order, scene, 2, n_rhs,
    S n_out): light up at the top, then down at the bottom, times 2 pi for a unit beam, upward rows flipped; on_nodes
    (order, scene, 2, n_rhs, n): the same on the nodes, times sqrt(weight mu); residual (order, scene): of the first
    fraction's system, relative.
    """
    cdef int n_all = <int>directions.shape[0], n_node = <int>weights.shape[0], n_layer = <int>albedo.shape[0]
    cdef int n_term = <int>coefficients.shape[1], n_col = <int>columns.shape[0], stokes = <int>members.shape[0]
    cdef int n_in = n_all - n_node - n_out, poles = <int>place.shape[0]
    cdef Fractions task = Fractions(
        n_layer, n_term, n_node, n_out, n_in, n_col, n_all, stokes, poles, &orders[0], &members[0], &terms[0],
        &coefficients[0, 0, 0], &albedo[0], &thickness[0], &directions[0], &weights[0], &columns[0, 0], &place[0],
        &share[0], constant, &E[0, 0, 0, 0], &F[0, 0, 0, 0], &G_E[0, 0, 0, 0], &G_F[0, 0, 0, 0],
        &source_s[0, 0, 0, 0], &source_d[0, 0, 0, 0], &out[0, 0, 0, 0, 0], &on_nodes[0, 0, 0, 0, 0], &residual[0, 0])
    run_items(crew, fractions_one, &task, <int>orders.shape[0] * n_layer,
              fractions_work(stokes * n_node, n_out, n_in * n_col, n_all, n_term, stokes, poles),
              stokes * n_node + 4 * n_term, &info[0, 0])


cdef struct Fraction:
    # f(A) of one order and scene: nodes n, right-hand sides r, rows out o, columns of all fractions together
    int n, r, o, g, poles, per_beam, stokes
    double h
    given place, share, mu0, mu_out
    doubles square        # (n,): 1/mu^2
    doubles left, right   # (n, g poles), times the share, and (g poles, n): (A + p)^-1 = delta + left right
    doubles b, right_b    # A's block from the beams to the nodes (n, r), and right b (g poles, r)
    doubles A_ON, A_OI    # its blocks to the outgoing directions, (o, n) and (o, r)


cdef inline double pole_of(const Fraction* f, int k) noexcept nogil:
    return f.place[k] / (f.h * f.h)


cdef inline double share_of(const Fraction* f, int k) noexcept nogil:
    return f.share[k] / f.h


cdef inline double beam_factor(const Fraction* f, int k, int column) noexcept nogil:
    """The beam's own 1/(A + p), with the sign of the block beside it."""
    cdef double rate = 1.0 / f.mu0[column // f.per_beam]
    return -1.0 / (rate * rate + pole_of(f, k))


cdef int fractions_one(const void* task, int item, Workspace desk) noexcept nogil:
    cdef const Fractions* t = <const Fractions*>task
    cdef int m = t.orders[item // t.n_layer], layer = item % t.n_layer, terms = t.terms[layer], stokes = t.stokes
    cdef int n = stokes * t.n_node, o = stokes * t.n_out, r = t.n_in * t.n_col, into = stokes * t.n_in
    cdef int poles = t.poles, info = 0, i, j, k, kind, r_e, r_f, g, gk
    cdef size_t at = item, nn = <size_t>n * n, nr = <size_t>n * r, orr = <size_t>o * r, first
    cdef doubles out = t.out + 2 * at * orr, on_nodes = t.on_nodes + 2 * at * nr
    cdef given E = t.E + at * nn, F = t.F + at * nn, G_E = t.G_E + at * n * o, G_F = t.G_F + at * n * o
    cdef given source_s = t.source_s + at * into * n, source_d = t.source_d + at * into * n
    cdef given mu_out = t.directions + t.n_node, mu0 = mu_out + t.n_out
    cdef Expansion x = Expansion(parity_of(m, stokes, t.members), m, terms, t.albedo[layer],
                                 t.coefficients + <size_t>6 * layer * t.n_term)
    cdef doubles prt = desk.work, scale = prt + <size_t>3 * t.n_all * t.n_term, phi_e = scale + t.n_all
    cdef doubles phi_f, psi_e, psi_f, P, S, small, f_NN, Z, E_NI, F_NI, f_NI, Z_NI, v, spare, delta
    cdef doubles to, S_rows
    cdef double h = 0.5 * t.thickness[layer], place, weight, rate, gap, start
    cdef Fraction w
    t.residual[at] = 0.0
    if terms <= m or x.albedo == 0.0:
        set_zero(2 * orr, out)
        set_zero(2 * nr, on_nodes)
        return 0
    r_e, r_f = columns_of(&x, 0), columns_of(&x, 1)
    g = r_e + r_f
    gk = g * poles
    psi_e = phi_e + <size_t>n * r_e
    phi_f = psi_e + <size_t>n * r_e
    psi_f = phi_f + <size_t>n * r_f
    P = psi_f + <size_t>n * r_f
    S = P + <size_t>n * g
    w = Fraction(n, r, o, g, poles, t.n_col, stokes, h, t.place, t.share, mu0, mu_out)
    w.left = S + <size_t>n * g
    w.right = w.left + <size_t>n * gk
    small = w.right + <size_t>n * gk
    f_NN = small + <size_t>g * g
    Z = f_NN + nn
    w.A_ON = Z + nn
    w.A_OI = w.A_ON + <size_t>n * o
    w.b = w.A_OI + orr
    w.right_b = w.b + nr
    E_NI = w.right_b + <size_t>gk * r
    F_NI = E_NI + nr
    f_NI = F_NI + nr
    Z_NI = f_NI + nr
    v = Z_NI + nr                     # 2 n r
    spare = v + 2 * nr                # (gk + o + n) r
    w.square = spare + <size_t>(gk + 2 * o + 2 * n) * r
    delta = w.square + n
    S_rows = delta + 3 * <size_t>n
    spherical(m, terms, is_polar(x.p), t.directions, t.n_all, prt)
    for i in range(t.n_node):
        scale[i] = sqrt(t.weights[i] / t.directions[i])
    for kind in range(2):
        parity_columns(&x, kind, prt, t.n_all, 0, t.n_node, scale, phi_f if kind else phi_e)
        times_coefficients(&x, kind, 1.0, n, phi_f if kind else phi_e, psi_f if kind else psi_e)
    # A = 1/mu^2 - P S^T
    for i in range(n):
        rate = 1.0 / t.directions[i // stokes]
        w.square[i] = rate * rate
        for j in range(r_e):
            P[<size_t>j * n + i] = rate * phi_e[<size_t>j * n + i]
    copy(<size_t>n * r_f, phi_f, P + <size_t>n * r_e)
    copy(<size_t>n * r_e, psi_e, S)
    product(b"T", b"N", n, r_f, n, 1.0, E, n, psi_f, n, 0.0, S + <size_t>n * r_e, n)
    for i in range(n):
        delta[i] = t.constant * h
        for j in range(g):
            S_rows[<size_t>i * g + j] = S[<size_t>j * n + i]
    for k in range(poles):
        place, weight = pole_of(&w, k), share_of(&w, k)
        for i in range(n):
            gap = 1.0 / (w.square[i] + place)
            spare[i] = gap
            delta[i] += weight * gap
            to = w.right + <size_t>i * gk + k * g
            for j in range(g):
                to[j] = gap * S_rows[<size_t>i * g + j]
        for j in range(g):
            to = w.left + (<size_t>k * g + j) * n
            for i in range(n):
                to[i] = spare[i] * P[<size_t>j * n + i]
        set_zero(<size_t>g * g, small)
        for i in range(g):
            small[<size_t>i * g + i] = 1.0
        product(b"T", b"N", g, g, n, -1.0, S, n, w.left + <size_t>k * g * n, n, 1.0, small, g)
        info = factorise(g, small, g, desk.pivots)
        if info != 0:
            return info
        solve(g, n, small, desk.pivots, w.right + k * g, gk)
        to = w.left + <size_t>k * g * n
        for i in range(n * g):
            to[i] *= weight
    product(b"N", b"N", n, n, gk, 1.0, w.left, n, w.right, gk, 0.0, f_NN, n)
    for i in range(n):
        f_NN[<size_t>i * n + i] += delta[i]
    # what the beams bring
    for i in range(t.n_in):
        first = <size_t>i * n
        multiply(n, t.n_col, stokes, -1.0, source_d + stokes * first, t.columns, 0.0, E_NI + t.n_col * first)
        multiply(n, t.n_col, stokes, -1.0, source_s + stokes * first, t.columns, 0.0, F_NI + t.n_col * first)
    for j in range(r):
        for i in range(n):
            w.b[<size_t>j * n + i] = F_NI[<size_t>j * n + i] / mu0[j // t.n_col]
    multiply(n, r, n, 1.0, F, E_NI, 1.0, w.b)
    multiply(gk, r, n, 1.0, w.right, w.b, 0.0, w.right_b)
    for j in range(r):
        for k in range(poles):
            gap = beam_factor(&w, k, j)
            for i in range(g):
                spare[<size_t>j * gk + k * g + i] = gap * w.right_b[<size_t>j * gk + k * g + i]
        for i in range(n):
            start = 0.0
            for k in range(poles):
                start += share_of(&w, k) * beam_factor(&w, k, j) / (w.square[i] + pole_of(&w, k))
            f_NI[<size_t>j * n + i] = start * w.b[<size_t>j * n + i]
    multiply(n, r, gk, 1.0, w.left, spare, 1.0, f_NI)
    if o > 0:
        # A's rows that lead out: F_ON E + E_ON/mu, with F_ON = -G_F/mu
        for j in range(n):
            for i in range(o):
                rate = 1.0 / mu_out[i // stokes]
                w.A_ON[<size_t>j * o + i] = G_E[<size_t>j * o + i] * rate
        multiply(o, n, n, 1.0, G_F, E, 1.0, w.A_ON)
        multiply(o, r, n, -1.0, G_F, E_NI, 0.0, w.A_OI)
        for j in range(n):
            for i in range(o):
                w.A_ON[<size_t>j * o + i] *= -1.0 / mu_out[i // stokes]
        for j in range(r):
            for i in range(o):
                w.A_OI[<size_t>j * o + i] /= mu_out[i // stokes]
    # even: (1 + Ze)^-1, Ze = E f
    product(b"T", b"N", r_e, n, n, 1.0, psi_e, n, f_NN, n, 0.0, P, r_e)
    for j in range(n):
        for i in range(n):
            Z[<size_t>j * n + i] = f_NN[<size_t>j * n + i] / t.directions[i // stokes]
        Z[<size_t>j * n + j] += 1.0
    product(b"N", b"N", n, n, r_e, -1.0, phi_e, n, P, r_e, 1.0, Z, n)
    for j in range(r):
        rate = mu0[j // t.n_col] * tanh(h / mu0[j // t.n_col])
        for i in range(n):
            Z_NI[<size_t>j * n + i] = E_NI[<size_t>j * n + i] * rate
    multiply(n, r, n, 1.0, E, f_NI, 1.0, Z_NI)
    info = solve_for_beams(&w, Z, Z_NI, v, desk.pivots)
    if info != 0:
        return info
    t.residual[at] = apply_tangent(&w, False, t.constant, v, E, F, Z_NI, out, spare, delta + n)     # Z_NI: f v
    if o > 0:                         # E_ON = -G_E/mu
        product(b"N", b"N", o, r, n, -1.0, G_E, o, Z_NI, n, 0.0, spare, o)
        for j in range(r):
            for i in range(o):
                k = j * o + i
                rate = 1.0 / mu_out[i // stokes]
                out[k] = -rate * (spare[k] + out[k]) / (1.0 + tanh(h * rate))
    # odd: (1 + Zo)^-1, Zo = f F
    product(b"N", b"N", n, r_f, n, 1.0, f_NN, n, phi_f, n, 0.0, P, n)
    for j in range(n):
        for i in range(n):
            Z[<size_t>j * n + i] = f_NN[<size_t>j * n + i] / t.directions[j // stokes]
        Z[<size_t>j * n + j] += 1.0
    product(b"N", b"T", n, n, r_f, -1.0, P, n, psi_f, n, 1.0, Z, n)
    for j in range(r):
        for i in range(n):
            Z_NI[<size_t>j * n + i] = f_NI[<size_t>j * n + i] / mu0[j // t.n_col]
    multiply(n, r, n, 1.0, f_NN, F_NI, 1.0, Z_NI)
    info = solve_for_beams(&w, Z, Z_NI, v + nr, desk.pivots)
    if info != 0:
        return info
    if o > 0:
        # f_ON (F w + F_NI) + f_OI/mu0, then F_ON w
        for j in range(r):
            rate = beam_start(&w, j)
            for i in range(n):
                E_NI[<size_t>j * n + i] = F_NI[<size_t>j * n + i] * rate
        multiply(n, r, n, 1.0, F, v + nr, 1.0, E_NI)
        apply_tangent(&w, True, t.constant, E_NI, E, F, Z_NI, out + orr, spare, delta + n)
        product(b"N", b"N", o, r, n, -1.0, G_F, o, v + nr, n, 0.0, spare, o)
        for j in range(r):
            for i in range(o):
                k = j * o + i
                rate = 1.0 / mu_out[i // stokes]
                out[orr + k] = -(spare[k] * tanh(h * rate) + out[orr + k]) / (1.0 + tanh(h * rate))
    for i in range(orr):
        start = out[i]
        out[i], out[orr + i] = start - out[orr + i], start + out[orr + i]
    for i in range(nr):
        on_nodes[i], on_nodes[nr + i] = v[i] - v[nr + i], v[i] + v[nr + i]
    return 0


cdef inline double beam_start(const Fraction* f, int column) noexcept nogil:
    """(1 + tanh(h/mu0))^-1: the beam's own (1 + Z)^-1."""
    return 1.0 / (1.0 + tanh(f.h / f.mu0[column // f.per_beam]))


cdef inline double on_beam(const Fraction* f, int column, bint odd) noexcept nogil:
    """What f(A) is applied to beside v: (1 + Ze)^-1 on the beam, or F (1 + Zo)^-1."""
    return beam_start(f, column) / f.mu0[column // f.per_beam] if odd else beam_start(f, column)


cdef int solve_for_beams(const Fraction* f, doubles Z, given Z_NI, doubles v, ints pivots) noexcept nogil:
    """v = -(1 + Z)^-1 Z_NI times the beam's own; Z: 1 + Z on entry."""
    cdef int i, j, info = factorise(f.n, Z, f.n, pivots)
    for j in range(f.r):
        for i in range(f.n):
            v[<size_t>j * f.n + i] = -beam_start(f, j) * Z_NI[<size_t>j * f.n + i]
    if info == 0:
        solve(f.n, f.r, Z, pivots, v, f.n)
    return info


cdef double apply_tangent(const Fraction* f, bint odd, double constant, given x, given E, given F,
                           doubles u, doubles out, doubles spare, doubles spent) noexcept nogil:
    """u = f(A) x on the nodes and out = f(A) x in the outgoing directions, of x on the nodes and what is on the beam;
    how far the first fraction's system is from solved for the first column, relative, unless odd."""
    cdef int n = f.n, r = f.r, o = f.o, gk = f.g * f.poles, i, j, k
    cdef doubles y = spare + <size_t>gk * r, lead = y + <size_t>n * r
    cdef double place, weight, beam, gap, factor, rate, worst = 0.0, largest = 0.0
    multiply(gk, r, n, 1.0, f.right, x, 0.0, spare)
    set_zero(<size_t>o * r, out)
    for i in range(n * r):
        u[i] = constant * f.h * x[i]
    for k in range(f.poles):
        place, weight = pole_of(f, k), share_of(f, k)
        for j in range(r):
            factor = beam_factor(f, k, j) * on_beam(f, j, odd)
            for i in range(f.g):
                spare[<size_t>j * gk + k * f.g + i] += factor * f.right_b[<size_t>j * gk + k * f.g + i]
            for i in range(n):
                gap = weight / (f.square[i] + place)
                y[<size_t>j * n + i] = gap * (x[<size_t>j * n + i] + factor * f.b[<size_t>j * n + i])
        product(b"N", b"N", n, r, f.g, 1.0, f.left + <size_t>k * f.g * n, n, spare + k * f.g, gk, 1.0, y, n)
        for i in range(n * r):
            u[i] += y[i]
        if k == 0 and not odd:      # the farthest from the diagonal
            multiply(n, 1, n, 1.0, E, y, 0.0, spent)
            multiply(n, 1, n, 1.0, F, spent, 0.0, spent + n)
            factor = beam_factor(f, k, 0) * on_beam(f, 0, odd)
            for i in range(n):
                gap = weight * (x[i] + factor * f.b[i])
                worst = max(worst, fabs(spent[n + i] + place * y[i] - gap))
                largest = max(largest, fabs(gap))
        if o == 0:
            continue
        multiply(o, r, n, 1.0, f.A_ON, y, 0.0, lead)
        for j in range(r):
            beam = -weight * beam_factor(f, k, j) * on_beam(f, j, odd)
            for i in range(o):
                rate = 1.0 / f.mu_out[i // f.stokes]
                out[<size_t>j * o + i] -= (lead[<size_t>j * o + i] + beam * f.A_OI[<size_t>j * o + i]) / (
                    rate * rate + place)
    return worst / largest if largest > 0.0 else 0.0
