# The same faces of slabs over black ground for a few beams: the Neumann series, by GMRES. With the fractions of
# core/tanh_poles.pxi, u = f(A) v needs x_k = (A + p_k)^-1 v, and (1 + E f(A)) v = beam. E and F being diagonal but for
# phi psi^T, all that one scattering has to know of the field are its moments a_k = psi_e^T x_k, c_k = psi_f^T E x_k and
# psi_e^T v: they make v and all x_k on every node by itself, which make the next ones. Moments = T moments + those of
# the beam, by GMRES: scattering contracts. The odd half is the same with E and F exchanged, f(A) F = F f(E F). Lengths
# are counted in half thicknesses and psi_e^T v times the constant fraction, so that moments of slabs and beams of any
# size are as large as their light: one tolerance is right for all. At z half thicknesses below the middle the halves
# are C v = cosh(h z sqrt A)/cosh(h sqrt A) v and E S v, S = sinh(h z sqrt A)/(sqrt A cosh(h sqrt A)): sums over the
# same x_k.

cdef int MOST_SCATTERED = 40  # steps of GMRES; a layer that absorbs nothing and is 4 thick needs 20


cdef size_t gmres_doubles(const Arrays* t) noexcept nogil:
    """Scratch memory of a layer of an order."""
    cdef size_t g = 4 * t.n_term, n = t.n, o = t.n_out_rows, k = t.n_share
    return (3 * t.n_all * t.n_term + t.n_all + g * (6 * n + 2 * o + g + 2 * t.n_in_rows) + (n + o) * (3 * k + 5) + 2 * g
            + g * k * (MOST_SCATTERED + 7) + (MOST_SCATTERED + 3) * (MOST_SCATTERED + 1)
            + t.n_depth * (2 * max(n, o) + g))


cdef struct Rows:
    # nodes or outgoing directions: how one scattering makes v and x_k of moments, row by row
    int n
    doubles lead         # (n, g): [phi_f, D phi_e], from [c; a]
    doubles gap          # (n, poles): 1/(D^2 + p)
    doubles rate, start  # (n,): D = 1/mu, 1/(1 + D f(D^2))
    doubles made         # (n, poles + 1)


cdef struct ParityHalf:
    # of one parity: g moments, those of the other kind first, so many; k = poles + 1 columns of them, that of v first
    int g, other, poles, k
    double depth, constant  # half the thickness; 1/mu is counted in it
    given place, weight  # (poles,): p and its share
    doubles back         # (n, g): [D psi_f, psi_e], to the moments
    doubles mixing       # (other, g - other): psi_f^T phi_e
    doubles given_to     # (g, k): [c; a] of the moments
    Rows nodes, outside


cdef inline void fill_rows(Rows* rows, const ParityHalf* half, given mu, int n_mu, int stokes) noexcept nogil:
    """gap, rate and start of the directions."""
    cdef int i, k
    cdef double rate, total, gap
    for i in range(rows.n):
        rate = half.depth / mu[i // stokes]
        rows.rate[i] = rate
        rows.start[i] = half.constant
    for k in range(half.poles):
        for i in range(rows.n):
            gap = 1.0 / (rows.rate[i] * rows.rate[i] + half.place[k])
            rows.gap[<size_t>k * rows.n + i] = gap
            rows.start[i] += half.weight[k] * gap
    for i in range(rows.n):
        rows.start[i] = 1.0 / (1.0 + rows.rate[i] * rows.start[i])


cdef void moments_to_sources(const ParityHalf* half, given moments, given first) noexcept nogil:
    """given_to = [c; a] of each fraction and, first, [0; psi^T f(A) v], of moments [c + mixing a; a]; those of
    `first`, which the beam gave, are left out of all but the mixing unless it is NULL."""
    cdef int g = half.g, f = half.other, i, k
    cdef doubles to = half.given_to
    copy(<size_t>g * half.k, moments, to)
    product(b"N", b"N", f, half.poles, g - f, -1.0, half.mixing, f, moments + g + f, g, 1.0, to + g, g)
    if first != NULL:
        for i in range(g * half.k):
            to[i] -= first[i]
    for i in range(f):
        to[i] = 0.0
    for k in range(half.poles):
        for i in range(f, g):
            to[i] += half.weight[k] * to[<size_t>(k + 1) * g + i]


cdef void nodal_field(const ParityHalf* half, const Rows* rows, bint fractions) noexcept nogil:
    """made = v, then all x_k if asked for, of what `moments_to_sources` passes on."""
    cdef int n = rows.n, i, k
    cdef doubles v = rows.made, x
    cdef given gap
    cdef double weight
    multiply(n, half.k, half.g, 1.0, rows.lead, half.given_to, 0.0, v)
    for i in range(n):
        v[i] /= rows.rate[i] * rows.rate[i]
    for k in range(half.poles):
        x, gap, weight = v + <size_t>(k + 1) * n, rows.gap + <size_t>k * n, half.weight[k]
        for i in range(n):
            v[i] -= weight * gap[i] * x[i]
    for i in range(n):
        v[i] *= rows.rate[i] * rows.start[i]
    if not fractions:
        return
    for k in range(half.poles):
        x, gap = v + <size_t>(k + 1) * n, rows.gap + <size_t>k * n
        for i in range(n):
            x[i] = gap[i] * (x[i] + v[i])


cdef void scatter_once(const ParityHalf* half, given moments, doubles found) noexcept nogil:
    """found = T moments."""
    cdef int i
    moments_to_sources(half, moments, NULL)
    nodal_field(half, &half.nodes, True)
    product(b"T", b"N", half.g, half.k, half.nodes.n, 1.0, half.back, half.nodes.n, half.nodes.made, half.nodes.n,
            0.0, found, half.g)
    for i in range(half.other):
        found[i] = 0.0
    for i in range(half.other, half.g):
        found[i] *= half.constant


cdef void add_inside(const ParityHalf* half, const Rows* rows, given moments, given first, given shares, int depths,
                     double sign, size_t stride, doubles memory, doubles found) noexcept nogil:
    """Adds (C v + E S v)/2 times `sign` to the light up, (C v - E S v)/2 to that down, depth by depth: found (depth,
    2), each n doubles, `stride` apart, of all fractions on the rows; `first` as in `moments_to_sources`, called
    before."""
    cdef int n = rows.n, g = half.g, f = half.other, K = half.k, count = half.g - half.other, d, i
    cdef doubles even = memory, odd = memory + <size_t>n * depths, to = odd + <size_t>n * depths, up, down
    cdef given shares_odd = shares + <size_t>depths * K
    cdef double share, rate
    multiply(n, 2 * depths, K, 1.0, rows.made, shares, 0.0, even)
    product(b"N", b"N", count, depths, half.poles, 1.0, half.given_to + g + f, g, shares_odd + 1, K, 0.0, to, count)
    for d in range(depths):
        share = shares_odd[<size_t>d * K] / half.constant
        for i in range(count):
            to[d * count + i] += share * (moments[f + i] - (0.0 if first == NULL else first[f + i]))
        for i in range(n):
            odd[<size_t>d * n + i] *= rows.rate[i] * rows.rate[i]
    product(b"N", b"N", n, depths, count, -1.0, rows.lead + <size_t>f * n, n, to, count, 1.0, odd, n)
    for d in range(depths):
        up, down = found + 2 * d * stride, found + (2 * d + 1) * stride
        for i in range(n):
            rate = 0.5 * odd[<size_t>d * n + i] / rows.rate[i]
            share = 0.5 * even[<size_t>d * n + i]
            up[i] += sign * (share + rate)
            down[i] += share - rate


cdef inline void gemv_t(size_t size, int count, given basis, given vector, double* shares) noexcept nogil:
    """shares = basis^T vector."""
    cdef char form = b"T"
    cdef int one = 1, rows = <int>size
    cdef double unit = 1.0, zero = 0.0
    dgemv(&form, &rows, &count, &unit, <doubles>basis, &rows, <doubles>vector, &one, &zero, shares, &one)


cdef int find_moments(const ParityHalf* half, given first, double tolerance, doubles moments, doubles memory,
                      double* change) noexcept nogil:
    """moments = T moments + first, by GMRES down to the tolerance and one more scattering, which changes them by
    `change`; 1 where they converge not."""
    cdef int size = half.g * half.k, one = 1, step = 0, i, j
    cdef int most = MOST_SCATTERED
    cdef doubles basis = memory, H = basis + <size_t>(most + 1) * size
    cdef doubles left = H + most * (most + 1), cosines = left + most + 1     # sines after them
    cdef double length = sqrt(ddot(&size, <doubles>first, &one, <doubles>first, &one)), a, b, c
    cdef doubles w
    cdef doubles column
    copy(size, first, moments)
    change[0] = 0.0
    if length == 0.0:
        return 0
    for i in range(size):
        basis[i] = first[i] / length
    left[0] = length
    while step < most and fabs(left[step]) > tolerance:
        w, column = basis + <size_t>(step + 1) * size, H + step * (most + 1)
        scatter_once(half, basis + <size_t>step * size, w)
        for i in range(size):
            w[i] = basis[<size_t>step * size + i] - w[i]
        gemv_t(size, step + 1, basis, w, column)
        product(b"N", b"N", size, 1, step + 1, -1.0, basis, size, column, step + 1, 1.0, w, size)
        length = sqrt(ddot(&size, w, &one, w, &one))
        for j in range(step):
            a, b, c = column[j], column[j + 1], cosines[2 * j]
            column[j] = c * a + cosines[2 * j + 1] * b
            column[j + 1] = c * b - cosines[2 * j + 1] * a
        a = hypot(column[step], length)
        cosines[2 * step], cosines[2 * step + 1] = column[step] / a, length / a
        column[step] = a
        left[step + 1] = -cosines[2 * step + 1] * left[step]
        left[step] *= cosines[2 * step]
        if length > 0.0:
            for i in range(size):
                w[i] /= length
        step += 1
    if not fabs(left[step]) <= tolerance:
        return 1
    for j in range(step - 1, -1, -1):
        for i in range(j + 1, step):
            left[j] -= H[i * (most + 1) + j] * left[i]
        left[j] /= H[j * (most + 1) + j]
    w = basis + <size_t>step * size
    set_zero(size, w)
    product(b"N", b"N", size, 1, step, 1.0, basis, size, left, step, 0.0, w, size)
    scatter_once(half, w, moments)
    for i in range(size):
        moments[i] += first[i]
        a = moments[i] - w[i]
        change[0] += a * a
    change[0] = sqrt(change[0])
    return 0


cdef doubles place_half(ParityHalf* half, int n, int o, int mixed, doubles memory) noexcept nogil:
    """Lays out the arrays of n nodes and o outgoing directions; what of the memory is left."""
    half.back = memory
    half.mixing = half.back + <size_t>n * half.g
    half.given_to = half.mixing + mixed
    memory = place_rows(&half.nodes, half, n, half.given_to + <size_t>half.g * half.k)
    return place_rows(&half.outside, half, o, memory)


cdef inline doubles place_rows(Rows* rows, const ParityHalf* half, int n, doubles memory) noexcept nogil:
    """The same of one set of directions."""
    rows.n, rows.lead = n, memory
    rows.gap = rows.lead + <size_t>n * half.g
    rows.rate = rows.gap + <size_t>n * half.poles
    rows.start = rows.rate + n
    rows.made = rows.start + n
    return rows.made + <size_t>n * half.k


cdef double beam_moments(const ParityHalf* half, double rate, int stokes, int into, given other, given own,
                         given column, doubles first) noexcept nogil:
    """Moments of one beam's own light, `rate` half thicknesses over mu0, Stokes vector `column`; `other`, `own`: its
    rows of psi, `into` rows a column. What they would be together, were the beam scattered evenly."""
    cdef int g = half.g, f = half.other, j, k, s
    cdef double start = half.constant, total = half.constant * half.constant, gap
    cdef given psi
    for k in range(half.poles):
        start += half.weight[k] / (rate * rate + half.place[k])
    start = 1.0 / (1.0 + rate * start)
    for j in range(g):
        psi = other + <size_t>j * into if j < f else own + <size_t>(j - f) * into
        first[j] = 0.0
        for s in range(stokes):
            first[j] += psi[s] * column[s]
        first[j] *= start
    for k in range(half.poles):
        gap = 1.0 / (rate * rate + half.place[k])
        total += gap * gap * (1.0 + rate * rate)
        for j in range(g):
            first[(k + 1) * g + j] = gap * first[j] * (rate if j < f else 1.0)
    set_zero(f, first)
    for j in range(f, g):
        first[j] *= half.constant
    return start * sqrt(total)


cdef inline void add_half(int n, given v, bint is_odd, doubles up, doubles down) noexcept nogil:
    """Light of the faces: even less odd up, their sum down, in turn."""
    cdef int i
    cdef double even
    if not is_odd:
        copy(n, v, up)
        return
    for i in range(n):
        even = up[i]
        up[i], down[i] = even - v[i], even + v[i]


cdef int scatter_by_fractions_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    cdef int m = t.orders[0], terms = t.terms[0], stokes = t.stokes
    cdef int n = t.n, o = t.n_out_rows, r = t.n_rhs, into = t.n_in_rows
    cdef int poles = t.n_pole, K = poles + 1, i, j, kind, g, gk, count, other, column, beam
    cdef size_t nr = <size_t>n * r, orr = <size_t>o * r
    cdef int depths = t.n_depth
    cdef doubles out = t.out, on_nodes = t.on_nodes, out_inside = t.out_inside, nodes_inside = t.on_nodes_inside
    cdef given mu_out = t.directions + t.n_node, mu0 = mu_out + t.n_out
    cdef double h = 0.5 * t.thickness[0], rate, total, change, largest = 0.0
    cdef Expansion x = Expansion(parity_of(m, stokes, t.members), m, terms, h * t.albedo[0],
                                 t.coefficients)
    cdef doubles prt = t.work, scale = prt + <size_t>3 * t.n_all * t.n_term, memory = scale + t.n_all
    cdef doubles phi[2]
    cdef doubles psi[2]
    cdef doubles phi_out[2]
    cdef doubles psi_in[2]
    cdef doubles phi_in, moments, first, spare
    cdef int width[2]
    cdef ParityHalf half
    t.residual[0] = 0.0
    set_zero(2 * depths * orr, out_inside)
    set_zero(2 * depths * nr, nodes_inside)
    if terms <= m or x.albedo == 0.0:
        set_zero(2 * orr, out)
        set_zero(2 * nr, on_nodes)
        return 0
    spherical(m, terms, is_polar(x.p), t.directions, t.n_all, prt)
    scale_nodes(t, scale)
    for kind in range(2):
        count = columns_of(&x, kind)
        width[kind] = count
        phi[kind], psi[kind] = memory, memory + <size_t>n * count
        phi_out[kind] = psi[kind] + <size_t>n * count
        psi_in[kind] = phi_out[kind] + <size_t>o * count
        phi_in = psi_in[kind] + <size_t>into * count
        memory = phi_in + <size_t>into * count
        parity_columns(&x, kind, prt, t.n_all, 0, t.n_node, scale, phi[kind])
        times_coefficients(&x, kind, 1.0, n, phi[kind], psi[kind])
        parity_columns(&x, kind, prt, t.n_all, t.n_node, t.n_out, NULL, phi_out[kind])
        parity_columns(&x, kind, prt, t.n_all, t.n_node + t.n_out, t.n_in, NULL, phi_in)
        times_coefficients(&x, kind, 1.0, into, phi_in, psi_in[kind])
    g = width[0] + width[1]
    gk = g * K
    half.g, half.poles, half.k, half.depth, half.constant = g, poles, K, h, t.constant
    half.place, half.weight = t.poles, t.shares
    memory = place_half(&half, n, o, width[0] * width[1], memory)
    first = memory
    moments = first + gk
    spare = moments + gk
    memory = spare + <size_t>depths * (2 * max(n, o) + g)
    fill_rows(&half.nodes, &half, t.directions, t.n_node, stokes)
    fill_rows(&half.outside, &half, mu_out, t.n_out, stokes)
    for kind in range(2):               # 0: the even half; 1: the odd one, by E and F exchanged
        other = width[1 - kind]
        half.other = other
        copy(<size_t>n * other, phi[1 - kind], half.nodes.lead)
        copy(<size_t>n * width[kind], psi[kind], half.back + <size_t>n * other)
        for j in range(other):
            for i in range(n):
                half.back[<size_t>j * n + i] = half.nodes.rate[i] * psi[1 - kind][<size_t>j * n + i]
            for i in range(o):
                half.outside.lead[<size_t>j * o + i] = half.outside.rate[i] / h * phi_out[1 - kind][<size_t>j * o + i]
        for j in range(width[kind]):
            for i in range(n):
                half.nodes.lead[<size_t>(other + j) * n + i] = half.nodes.rate[i] * phi[kind][<size_t>j * n + i]
            for i in range(o):
                rate = half.outside.rate[i]
                half.outside.lead[<size_t>(other + j) * o + i] = rate * rate / h * phi_out[kind][<size_t>j * o + i]
        product(b"T", b"N", other, width[kind], n, 1.0, psi[1 - kind], n, phi[kind], n, 0.0, half.mixing, other)
        for column in range(r):
            beam = column // t.n_col
            total = x.albedo * beam_moments(
                &half, h / mu0[beam], stokes, into, psi_in[1 - kind] + beam * stokes, psi_in[kind] + beam * stokes,
                t.columns + (column % t.n_col) * stokes, first)
            if find_moments(&half, first, t.tolerance * total, moments, memory, &change) != 0:
                return 1
            largest = max(largest, change / total)
            moments_to_sources(&half, moments, NULL)
            nodal_field(&half, &half.nodes, depths > 0)
            if depths > 0:
                add_inside(&half, &half.nodes, moments, NULL, t.inside, depths, 1.0 - 2.0 * kind, nr, spare,
                           nodes_inside + <size_t>column * n)
            add_half(n, half.nodes.made, kind, on_nodes + column * n, on_nodes + nr + column * n)
            if o == 0:
                continue
            moments_to_sources(&half, moments, first)
            nodal_field(&half, &half.outside, depths > 0)
            if depths > 0:
                add_inside(&half, &half.outside, moments, first, t.inside, depths, 1.0 - 2.0 * kind, orr, spare,
                           out_inside + <size_t>column * o)
            add_half(o, half.outside.made, kind, out + column * o, out + orr + column * o)
    t.residual[0] = largest
    return 0
