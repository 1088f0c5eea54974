# How the top of a semi-infinite layer changes with its scattering: the invariance equation, linearized. With albedo B
# of E (s = 1) and of F (s = -1) and H = phi + s R phi, R is D o (the sum of s H B H'^T), D = 1/(1/mu + 1/mu'). Hence
# dR = D o (the sum of s dH B H'^T + s H B dH'^T + s H dB H'^T), dH = s dR phi: a fixed point, on the nodes, then off
# them. Backwards, from the derivatives with R to those with B, it is that of L = D o (the sum of L H B phi^T + ...).

cdef size_t change_doubles(const Arrays* t) noexcept nogil:
    """Scratch memory of both stages."""
    cdef size_t n = t.n, u = t.stokes * t.n_off, wide = max(n, u)
    return invariance_doubles(t) + n * n + u * n + wide * n + 8 * wide * t.n_term + 4 * (n + u) * t.n_term


cdef void linear_step(const Expansion* x, const Linear* linear, FactorColumns* rows, FactorColumns* nodes,
                      given mu_row, given mu_node, given R, doubles new) noexcept nogil:
    """new = D o (R phi B H'^T), on the nodes with its transpose, + source; backwards phi and H change places."""
    cdef int kind, k, n_row = rows[0].rows, n = nodes[0].rows, columns
    cdef doubles A = linear.spare, AC
    for kind in range(2):
        columns = nodes[kind].columns
        AC = A + <size_t>n_row * columns
        multiply(n_row, columns, n, 1.0, R, nodes[kind].H if linear.adjoint else nodes[kind].phi, 0.0, A)
        times_coefficients(x, kind, -1.0, n_row, A, AC)
        product(b"N", b"T", n_row, n, columns, 1.0, AC, n_row,
                nodes[kind].phi if linear.adjoint else nodes[kind].H, n, 1.0 if kind else 0.0, new, n_row)
    if linear.symmetric and not linear.adjoint:
        add_transposed(n, new)
    divide_by_rates(x.p, n_row // x.p.stokes, mu_row, n // x.p.stokes, mu_node, new)
    if linear.symmetric and linear.adjoint:
        add_transposed(n, new)
    for k in range(n_row * n):
        new[k] += linear.source[k]


cdef void add_transposed(int n, doubles a) noexcept nogil:
    """a <- a + a^T."""
    cdef int i, j
    cdef double both
    for j in range(n):
        for i in range(j + 1):
            both = a[<size_t>j * n + i] + a[<size_t>i * n + j]
            a[<size_t>j * n + i] = a[<size_t>i * n + j] = both


cdef void add_step(const Expansion* x, int kind, int rows, given H, int others, given H_other, double factor,
                   double add, doubles spare, doubles out) noexcept nogil:
    """out (rows, others) = factor s H B H_other^T + add out."""
    times_coefficients(x, kind, -1.0, rows, H, spare)
    product(b"N", b"T", rows, others, columns_of(x, kind), -factor if kind else factor, spare, rows, H_other, others,
            add, out, rows)


cdef int change_semi_infinite_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    cdef Invariant s
    cdef doubles memory = solve_invariance(t, desk.stop, &s), dR = memory, dRu = dR + <size_t>s.n * s.n
    cdef doubles source = dRu + <size_t>s.u * s.n, spare = source + <size_t>max(s.n, s.u) * s.n
    cdef doubles dH = spare + 8 * <size_t>max(s.n, s.u) * t.n_term, dHu = dH + 2 * <size_t>s.n * t.n_term
    cdef doubles own, Ruu = s.room
    cdef int k, l, i, kind, n = s.n, u = s.u, m = s.x.m, n_node = t.n_node
    cdef bint lit
    cdef double missing = s.residual, sign
    cdef Expansion d
    cdef Linear linear
    for k in range(t.n_change):
        d = Expansion(s.x.p, m, s.x.terms, 1.0, t.changes + <size_t>6 * k * t.n_term)
        lit = False
        for l in range(6 * m, 6 * s.x.terms):
            lit = lit or d.coefficients[l] != 0.0
        if not lit:
            continue
        for kind in range(2):
            add_step(&d, kind, n, s.nodes[kind].H, n, s.nodes[kind].H, 1.0, 1.0 if kind else 0.0, spare, source)
        divide_by_rates(s.x.p, n_node, t.directions, n_node, t.directions, source)
        linear = Linear(False, True, source, spare)
        missing = max(missing, fixed_point(&s.x, s.nodes, s.nodes, t.directions, t.directions, s.rate, t.tolerance,
                                           False, False, dR, s.room, t.steps, desk.stop, &linear))
        own = dH
        for kind in range(2):
            sign = -1.0 if kind else 1.0
            multiply(n, s.nodes[kind].columns, n, sign, dR, s.nodes[kind].phi, 0.0, own)
            add_step(&s.x, kind, u, s.rows[kind].H, n, own, 1.0, 1.0 if kind else 0.0, spare, source)
            add_step(&d, kind, u, s.rows[kind].H, n, s.nodes[kind].H, 1.0, 1.0, spare, source)
            own += <size_t>n * s.nodes[kind].columns
        divide_by_rates(s.x.p, t.n_off, s.off, n_node, t.directions, source)
        linear = Linear(False, False, source, spare)
        missing = max(missing, fixed_point(&s.x, s.rows, s.nodes, s.off, t.directions, s.rate, t.tolerance, False,
                                           False, dRu, s.room, t.steps, desk.stop, &linear))
        for kind in range(2):
            sign = -1.0 if kind else 1.0
            multiply(u, s.nodes[kind].columns, n, sign, dRu, s.nodes[kind].phi, 0.0, dHu)
            add_step(&s.x, kind, u, dHu, u, s.rows[kind].H, 1.0, 1.0 if kind else 0.0, spare, Ruu)
            add_step(&s.x, kind, u, s.rows[kind].H, u, dHu, 1.0, 1.0, spare, Ruu)
            add_step(&d, kind, u, s.rows[kind].H, u, s.rows[kind].H, 1.0, 1.0, spare, Ruu)
            add_step(&d, kind, u, s.rows[kind].phi, u, s.rows[kind].phi, -1.0, 1.0, spare, Ruu)
        divide_by_rates(s.x.p, t.n_off, s.off, t.n_off, s.off, Ruu)
        i = k * t.n_order + item
        light_of_beams(t, &s, Ruu, dRu, t.up + <size_t>i * t.n_rhs * t.n_out_rows, t.on_nodes + <size_t>i * t.n_rhs * n)
    t.residual[0] = missing
    return 0


cdef void pull_coefficients(const Expansion* x, int kind, double sign, double v_sign, int rows, given H, given L,
                            int others, given H_other, doubles spare, doubles gradient) noexcept nogil:
    """gradient (n_term, 6) += derivatives with albedo times coefficients: of sign H B H_other^T weighed by L (rows,
    others); V's column of H_other counts v_sign times, as in `times_coefficients`."""
    cdef Parity p = x.p
    cdef int l, i, j, columns = columns_of(x, kind), parity, place[2]
    cdef double b[2][2]
    cdef doubles g
    place[1] = 0
    multiply(rows, columns, others, sign, L, H_other, 0.0, spare)
    for l in range(x.m, x.terms):
        parity = (l - x.m) % 2 != kind
        g = gradient + 6 * l
        place[0] = place[1]
        place[1] = place[0] + p.has[parity][0]
        for i in range(2):
            for j in range(2):
                b[i][j] = 0.0
                if p.has[parity][i] and p.has[parity][j]:
                    b[i][j] = scalar_product(rows, H + <size_t>place[i] * rows, spare + <size_t>place[j] * rows)
        place[1] += p.has[parity][1]
        if parity == 0:
            g[0] += b[0][0]
            g[1] += b[1][1]
            g[4] -= b[0][1] + b[1][0]
        else:
            g[2] += b[0][0]
            g[3] += v_sign * b[1][1]
            g[5] += b[1][0] - v_sign * b[0][1]


cdef int pull_semi_infinite_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    cdef Invariant s
    cdef doubles memory = solve_invariance(t, desk.stop, &s), L = memory, Lu = L + <size_t>s.n * s.n
    cdef doubles source = Lu + <size_t>s.u * s.n, spare = source + <size_t>max(s.n, s.u) * s.n
    cdef doubles other, Luu = s.room + 6 * <size_t>s.n * max(s.n, s.u)
    cdef doubles gradient = t.gradient
    cdef given weights = t.pull_weights
    cdef int i, j, a, b, kind, n = s.n, u = s.u, stokes = t.stokes, n_node = t.n_node
    cdef double missing = s.residual, sign
    cdef Linear linear
    set_zero(<size_t>u * u, Luu)
    for j in range(t.n_in):
        for b in range(stokes):
            for i in range(t.n_out):
                for a in range(stokes):
                    Luu[<size_t>(stokes * t.in_places[j] + b) * u + stokes * t.out_places[i] + a] += weights[
                        (<size_t>(stokes * j + b) * t.n_out + i) * stokes + a] / s.off[t.out_places[i]]
    divide_by_rates(s.x.p, t.n_off, s.off, t.n_off, s.off, Luu)
    for kind in range(2):       # but for what is scattered once
        sign = -1.0 if kind else 1.0
        pull_coefficients(&s.x, kind, sign, -1.0, u, s.rows[kind].H, Luu, u, s.rows[kind].H, spare, gradient)
        for i in range(u * s.rows[kind].columns):
            s.rows[kind].HC[i] = -s.rows[kind].phi[i]
        pull_coefficients(&s.x, kind, sign, -1.0, u, s.rows[kind].HC, Luu, u, s.rows[kind].phi, spare, gradient)
    add_transposed(u, Luu)
    for kind in range(2):
        other = spare + <size_t>u * s.rows[kind].columns
        multiply(u, s.rows[kind].columns, u, 1.0, Luu, s.rows[kind].H, 0.0, spare)
        times_coefficients(&s.x, kind, -1.0, u, spare, other)
        product(b"N", b"T", u, n, s.rows[kind].columns, 1.0, other, u, s.nodes[kind].phi, n, 1.0 if kind else 0.0,
                source, u)
    divide_by_rates(s.x.p, t.n_off, s.off, n_node, t.directions, source)
    linear = Linear(True, False, source, spare)
    missing = max(missing, fixed_point(&s.x, s.rows, s.nodes, s.off, t.directions, s.rate, t.tolerance, False, False,
                                       Lu, s.room, t.steps, desk.stop, &linear))
    for kind in range(2):
        sign = -1.0 if kind else 1.0
        pull_coefficients(&s.x, kind, sign, -1.0, u, s.rows[kind].H, Lu, n, s.nodes[kind].H, spare, gradient)
        other = spare + <size_t>n * s.rows[kind].columns
        product(b"T", b"N", n, s.rows[kind].columns, u, 1.0, Lu, u, s.rows[kind].H, u, 0.0, spare, n)
        times_coefficients(&s.x, kind, -1.0, n, spare, other)
        product(b"N", b"T", n, n, s.nodes[kind].columns, 0.5, other, n, s.nodes[kind].phi, n, 1.0 if kind else 0.0,
                source, n)
    divide_by_rates(s.x.p, n_node, t.directions, n_node, t.directions, source)
    add_transposed(n, source)
    linear = Linear(True, True, source, spare)
    missing = max(missing, fixed_point(&s.x, s.nodes, s.nodes, t.directions, t.directions, s.rate, t.tolerance, False,
                                       False, L, s.room, t.steps, desk.stop, &linear))
    for kind in range(2):
        sign = -1.0 if kind else 1.0
        pull_coefficients(&s.x, kind, sign, -1.0, n, s.nodes[kind].H, L, n, s.nodes[kind].H, spare, gradient)
    t.residual[0] = missing
    return 0
