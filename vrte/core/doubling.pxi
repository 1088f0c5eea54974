def doubling_work(n, r, o):
    """Doubles of `work` that one thread of `double_slabs` needs."""
    return 8 * extended_size(n, r, o) + 4 * n


cdef struct Doubling:
    int stokes, n_node, n_in, n_col, n_out, n_slab, n_material
    bint conserving, clear, settled
    given_ints orders, material
    given thickness, albedo, asymmetry, nodes, weights, mu0, columns, mu_out
    given E, F, G_E, G_F, source_s, source_d
    doubles R, T, lost, residual
    ints doublings


def double_slabs(crew, *, const int[::1] orders, bint conserving, bint clear, bint settled, const int[::1] material,
                 const double[::1] thickness, const double[::1] albedo, const double[::1] asymmetry,
                 const double[::1] nodes, const double[::1] weights, const double[::1] mu0,
                 const double[:, ::1] columns, const double[::1] mu_out, const double[:, :, :, ::1] E,
                 const double[:, :, :, ::1] F, const double[:, :, :, ::1] G_E, const double[:, :, :, ::1] G_F,
                 const double[:, :, :, ::1] source_s, const double[:, :, :, ::1] source_d, double[:, :, ::1] R,
                 double[:, :, ::1] T, double[:, :, ::1] lost, double[:, :, ::1] residual, int[:, ::1] doublings,
                 int[:, ::1] info):
    """Reflection and transmission of homogeneous slabs, on the nodes and for directions off them.

    conserving: whether order 0 has I; clear: whether slabs without scattering are not doubled; settled: whether
    doublings that change R no more are cut short; material (slab,): place of the slab's material in albedo, asymmetry
    (material,) and in the matrices that `assemble` left; thickness (slab,), inf allowed; mu0 (n_in,), columns (n_col, S)
    the incident Stokes vectors, mu_out (n_out,). R, T (order, slab, extended_size(n, n_in n_col, S n_out)): blocks N,
    NI, ON, OI, OO, II one behind the other, T with the unscattered light on its diagonal; in order 0 the nodes are
    turned so that one axis (`flux_axis`) carries the flux. lost (order, slab, n): what the slab absorbs of it, its row
    of 1 - R - T. residual (order, slab, 2): how well R, and T, satisfy invariance, relative; doublings (order, slab).
    """
    cdef int stokes = <int>columns.shape[1], n_slab = <int>material.shape[0]
    cdef Doubling task = Doubling(
        stokes, <int>weights.shape[0], <int>mu0.shape[0], <int>columns.shape[0], <int>mu_out.shape[0], n_slab,
        <int>albedo.shape[0], conserving, clear, settled, &orders[0], &material[0], &thickness[0], &albedo[0],
        &asymmetry[0], &nodes[0], &weights[0], &mu0[0], &columns[0, 0], &mu_out[0], &E[0, 0, 0, 0], &F[0, 0, 0, 0],
        &G_E[0, 0, 0, 0], &G_F[0, 0, 0, 0], &source_s[0, 0, 0, 0], &source_d[0, 0, 0, 0], &R[0, 0, 0], &T[0, 0, 0],
        &lost[0, 0, 0], &residual[0, 0, 0], &doublings[0, 0])
    cdef int n = stokes * task.n_node
    run_items(crew, double_one, &task, <int>orders.shape[0] * n_slab,
              doubling_work(n, task.n_in * task.n_col, stokes * task.n_out), n, &info[0, 0])


cdef int double_one(const void* task, int item, Desk desk) noexcept nogil:
    cdef const Doubling* d = <const Doubling*>task
    cdef int order = item // d.n_slab, k = item % d.n_slab, material = d.material[k], stokes = d.stokes, info, i
    cdef int n_in = d.n_in, n_col = d.n_col, m = d.orders[order] if d.conserving else max(d.orders[order], 1)
    cdef Sizes s = Sizes(stokes * d.n_node, n_in * n_col, stokes * d.n_out, stokes)
    cdef size_t each = size_extended(s), at = <size_t>order * d.n_material + material, n = s.n
    cdef double thickness = d.thickness[k], albedo = d.albedo[material]
    cdef given nodes = d.nodes, weights = d.weights, mu0 = d.mu0, columns = d.columns, mu_out = d.mu_out
    cdef given E = d.E + at * n * n, F = d.F + at * n * n
    cdef given G_E = d.G_E + at * n * s.o, G_F = d.G_F + at * n * s.o
    cdef given source_s = d.source_s + at * stokes * n_in * n, source_d = d.source_d + at * stokes * n_in * n
    cdef doubles R = d.R + item * each, T = d.T + item * each, lost = d.lost + item * n
    cdef doubles residual = d.residual + 2 * <size_t>item, work = desk.work
    cdef ints doublings = d.doublings + item, pivots = desk.pivots
    cdef given_ints stop = desk.stop
    cdef Extended e = extended_at(s, work), f = extended_at(s, work + each)
    cdef Extended Ze = extended_at(s, work + 2 * each), Zo = extended_at(s, work + 3 * each)
    cdef Extended C = extended_at(s, work + 4 * each), a = extended_at(s, work + 5 * each)
    cdef Extended b = extended_at(s, work + 6 * each), spare = extended_at(s, work + 7 * each)
    cdef Extended r = extended_at(s, R), t = extended_at(s, T)
    cdef doubles v = work + 8 * each
    cdef double steepest = 0.0
    memset(R, 0, sizeof(double) * each)
    memset(T, 0, sizeof(double) * each)
    memset(lost, 0, sizeof(double) * s.n)
    residual[0] = residual[1] = 0.0
    doublings[0] = 0
    rates(s, n_col, nodes, mu0, mu_out, e, &steepest)
    if albedo == 0.0 and d.clear:
        clear_slab(s, thickness, nodes, weights, e, t, m, lost, v, spare.N)
        return 0
    extend(s, n_col, n_in, columns, E, G_E, source_d, mu_out, e)
    rates(s, n_col, nodes, mu0, mu_out, f, &steepest)
    extend(s, n_col, n_in, columns, F, G_F, source_s, mu_out, f)
    if m == 0:
        turn_extended(s, albedo, nodes, weights, columns, n_col, mu_out, v, e, f, spare.N)
    if thickness < 1e300:
        info = double_plainly(s, m, d.settled, thickness, steepest, e, f, Ze, Zo, C, a, b, spare, doublings, pivots, stop)
    else:
        info = double_endless(s, m, albedo, d.asymmetry[material], steepest, e, f, Ze, Zo, a, b, spare, doublings, pivots, stop)
    if info != 0 or stop[0]:
        return info
    info = reflect_and_transmit(s, thickness, Ze, Zo, C, a, b, spare, r, t, lost, m, pivots)
    if info == 0:
        half_sum_and_difference(s, e, f)
        if thickness > 1.5:
            reflect_by_invariance(s, e, f, r, t, a)
        invariance(s, thickness, e, f, r, t, a, b, spare, residual)
    return info


cdef void rates(Sizes s, int n_col, given nodes, given mu0, given mu_out, Extended a,
                doubles steepest) noexcept nogil:
    """1/mu of the incident and outgoing directions on the diagonal; the largest of all."""
    cdef int i
    for i in range(s.o):
        a.OO[i] = 1.0 / mu_out[i // s.stokes]
        steepest[0] = max(steepest[0], a.OO[i])
    for i in range(s.r):
        a.II[i] = 1.0 / mu0[i // n_col]
        steepest[0] = max(steepest[0], a.II[i])
    for i in range(s.n // s.stokes):
        steepest[0] = max(steepest[0], 1.0 / nodes[i])


cdef void clear_slab(Sizes s, double thickness, given nodes, given weights, Extended rate, Extended t, int m,
                     doubles lost, doubles v, doubles spare) noexcept nogil:
    """A slab that does not scatter: T alone."""
    cdef int i
    cdef double size = 0.0
    for i in range(s.n):
        t.N[<size_t>i * s.n + i] = exp(-thickness / nodes[i // s.stokes])
    for i in range(s.o):
        t.OO[i] = exp(-thickness * rate.OO[i])
    for i in range(s.r):
        t.II[i] = exp(-thickness * rate.II[i])
    if m != 0:
        return
    conserving_axis(s.n, s.stokes, nodes, weights, v)
    reflect_both(s.n, s.stokes, v, t.N, spare)
    for i in range(s.n // s.stokes):
        size += weights[i] * nodes[i]
    for i in range(s.n // s.stokes):     # the axis is minus the unit null vector
        lost[s.stokes * i] = sqrt(weights[i] * nodes[i] / size) * expm1(-thickness / nodes[i])
    turn_columns(s.n, s.stokes, 1, v, lost)


cdef void extend(Sizes s, int n_col, int n_in, given columns, given matrix, given G,
                 given source, given mu_out, Extended a) noexcept nogil:
    """E or F with its incident and outgoing directions: the sources with the other sign, no OI."""
    cdef int i, j
    memcpy(a.N, matrix, sizeof(double) * <size_t>s.n * s.n)
    for j in range(s.n):
        for i in range(s.o):
            a.ON[<size_t>j * s.o + i] = -G[<size_t>j * s.o + i] / mu_out[i // s.stokes]
    for i in range(n_in):
        product(b"N", b"N", s.n, n_col, s.stokes, -1.0, source + <size_t>s.stokes * i * s.n, s.n, columns, s.stokes, 0.0,
                a.NI + <size_t>i * n_col * s.n, s.n)
    memset(a.OI, 0, sizeof(double) * <size_t>s.r * s.o)


cdef void turn_extended(Sizes s, double albedo, given nodes, given weights, given columns, int n_col,
                        given mu_out, doubles v, Extended e, Extended f, doubles spare) noexcept nogil:
    """Order 0: one axis becomes sqrt(weight mu) on I, whose row and column of E are known exactly (2 N terms)."""
    cdef int i, axis = flux_axis(s.n, s.stokes)
    cdef double size = 0.0
    conserving_axis(s.n, s.stokes, nodes, weights, v)
    for i in range(s.n // s.stokes):
        size += weights[i] * nodes[i]
    size = sqrt(size)
    reflect_both(s.n, s.stokes, v, e.N, spare)
    reflect_both(s.n, s.stokes, v, f.N, spare)
    exact_conservation(s.n, s.stokes, albedo, nodes, weights, v, e.N, spare)
    turn_edges(s, v, e, spare)
    turn_edges(s, v, f, spare)
    for i in range(s.r):
        e.NI[<size_t>i * s.n + axis] = albedo * columns[s.stokes * (i % n_col)] / size
    for i in range(s.o):
        e.ON[<size_t>axis * s.o + i] = 0.0 if i % s.stokes else albedo / (mu_out[i // s.stokes] * size)


cdef inline void turn_edges(Sizes s, given v, Extended a, doubles spare) noexcept nogil:
    """NI <- (1 - v v^T) NI, ON <- ON (1 - v v^T)."""
    turn_columns(s.n, s.stokes, s.r, v, a.NI)
    turn_rows(s.n, s.stokes, s.o, v, a.ON, spare)


cdef double SETTLED = 1e-17     # below the rounding of 1


cdef int double_plainly(Sizes s, int m, bint settled, double thickness, double steepest, Extended e, Extended f, Extended Ze, Extended Zo,
                        Extended C, Extended a, Extended b, Extended spare, ints doublings, ints pivots,
                        given_ints stop) noexcept nogil:
    """Ze, Zo and C = 1 - Zo Ze of a finite slab: a rational start, then Zo <- 2 L^-1 Zo, Ze <- 2 Ze L^-1, L = 1 + Zo Ze.

    C is formed while half the thickness is at most 0.75, so that 1 - Zo Ze keeps its digits, then carried,
    C <- (C L^-1)^2, which keeps them where T is too small for a difference. settled: once C is below the rounding of 1,
    L = 2 and doublings change C alone.
    """
    cdef int info, step, i, count = 0, axis = flux_axis(s.n, s.stokes)
    cdef size_t k
    cdef double h = 0.5 * thickness
    cdef bint carried = False
    product_extended(s, 1.0, f, e, a)
    steepest = max(steepest, sqrt(norm_1(s.n, a.N)))
    while h * steepest > 0.5:
        h = 0.5 * h
        count = count + 1
    doublings[0] = count
    info = rational_start(s, h, e, f, Ze, Zo, a, b, C, spare, pivots)
    for step in range(count):
        if info != 0 or stop[0]:
            return info
        if settled and carried and largest_of(size_extended(s), C.N) < SETTLED:
            product_extended(s, 0.25, C, C, b)
            copy_extended(s, b, C)
            h = 2.0 * h
            direct_complement(s, h, e, C)
            continue
        product_extended(s, 1.0, Zo, Ze, a)                      # L - 1
        if 2.0 * h > 0.75 and not carried:
            complement(s, h, e, a, C)
            carried = True
        add_identity(s, 1.0, a)
        info = invert_extended(s, a, spare, pivots)
        product_extended(s, 2.0, a, Zo, b)
        copy_extended(s, b, Zo)
        if m == 0:
            for i in range(s.n):    # reciprocity; rounding in this row would double at each step
                k = <size_t>axis * s.n + i
                Zo.N[<size_t>i * s.n + axis] = -Zo.N[k] if s.stokes == 4 and i % 4 == 3 else Zo.N[k]
        product_extended(s, 2.0, Ze, a, b)
        copy_extended(s, b, Ze)
        h = 2.0 * h
        for i in range(s.o):
            Ze.OO[i] = Zo.OO[i] = tanh(h * e.OO[i])
        for i in range(s.r):
            Ze.II[i] = Zo.II[i] = tanh(h * e.II[i])
        if carried:
            product_extended(s, 1.0, C, a, b)
            product_extended(s, 1.0, b, b, C)
            direct_complement(s, h, e, C)
    if not carried:
        product_extended(s, 1.0, Zo, Ze, a)
        complement(s, h, e, a, C)
    return info


cdef inline void complement(Sizes s, double h, Extended rate, Extended product_of_both, Extended C) noexcept nogil:
    """C = 1 - Zo Ze."""
    copy_extended(s, product_of_both, C)
    scale_extended(s, -1.0, C)
    add_identity(s, 1.0, C)
    direct_complement(s, h, rate, C)


cdef inline void direct_complement(Sizes s, double h, Extended rate, Extended C) noexcept nogil:
    """1 - tanh^2 = 1/cosh^2 of the unscattered light, without a difference."""
    cdef int i
    for i in range(s.o):
        C.OO[i] = one_over_cosh_squared(h * rate.OO[i])
    for i in range(s.r):
        C.II[i] = one_over_cosh_squared(h * rate.II[i])


cdef inline double one_over_cosh_squared(double x) noexcept nogil:
    cdef double e = exp(-2.0 * x)
    return 4.0 * e / ((1.0 + e) * (1.0 + e))


cdef int rational_start(Sizes s, double h, Extended e, Extended f, Extended Ze, Extended Zo, Extended z, Extended power,
                        Extended above, Extended below, ints pivots) noexcept nogil:
    """Ze = E f, Zo = f F with the seventh convergent of tanh's continued fraction (2e-16 for h sqrt(A) <= 1/2).

    z: F E on entry. power, above, below: scratch.
    """
    cdef int info
    cdef double numerator[4]
    cdef double denominator[4]
    cdef int i
    numerator[0], numerator[1], numerator[2], numerator[3] = 135135.0, 17325.0, 378.0, 1.0
    denominator[0], denominator[1], denominator[2], denominator[3] = 135135.0, 62370.0, 3150.0, 28.0
    scale_extended(s, h * h, z)
    memset(above.N, 0, sizeof(double) * size_extended(s))
    memset(below.N, 0, sizeof(double) * size_extended(s))
    add_identity(s, numerator[0], above)
    add_identity(s, denominator[0], below)
    copy_extended(s, z, power)
    for i in range(1, 4):
        add_extended(s, numerator[i], power, above)
        add_extended(s, denominator[i], power, below)
        if i < 3:
            product_extended(s, 1.0, z, power, Ze)
            copy_extended(s, Ze, power)
    info = invert_extended(s, below, power, pivots)
    product_extended(s, h, below, above, z)
    product_extended(s, 1.0, e, z, Ze)
    product_extended(s, 1.0, z, f, Zo)
    for i in range(s.o):
        Ze.OO[i] = Zo.OO[i] = tanh(h * e.OO[i])
    for i in range(s.r):
        Ze.II[i] = Zo.II[i] = tanh(h * e.II[i])
    return info


cdef int double_endless(Sizes s, int m, double albedo, double asymmetry, double steepest, Extended e, Extended f,
                        Extended Ze, Extended Zo, Extended a, Extended b, Extended spare, ints doublings, ints pivots,
                        given_ints stop) noexcept nogil:
    """Ze and Zo of a slab without end, where Zo Ze = 1, by scaled doublings.

    Before each, both are multiplied by ratio^(-1/2), `ratio` being the smallest over the largest eigenvalue of
    sqrt(Zo Ze): the smallest is estimated from below, and a wrong guess costs steps, no digits. The condition of L is
    1/ratio: it is not let below 1e-3.
    """
    cdef int info = 0, step, i, axis = flux_axis(s.n, s.stokes)
    cdef double ratio, used, gap, slowest
    product_extended(s, 1.0, f, e, a)
    steepest = max(steepest, sqrt(norm_1(s.n, a.N)))
    slowest = sqrt((1.0 - albedo) * (1.0 - albedo * asymmetry))
    if m > 0 or albedo == 1.0:
        slowest = max(slowest, 0.05)
    ratio = min(1.0, slowest / steepest)
    copy_extended(s, e, Ze)
    copy_extended(s, f, Zo)
    scale_extended(s, 1.0 / steepest, Ze)
    scale_extended(s, 1.0 / steepest, Zo)
    for step in range(100):
        if stop[0]:
            return 0
        used = max(ratio, 1e-3)
        scale_extended(s, 1.0 / sqrt(used), Ze)
        scale_extended(s, 1.0 / sqrt(used), Zo)
        product_extended(s, 1.0, Zo, Ze, a)
        gap = 0.0
        for i in range(s.n):
            if not (m == 0 and albedo == 1.0 and i == axis):     # there Ze = 0 for ever
                gap = max(gap, fabs(a.N[<size_t>i * s.n + i] - 1.0))
        for i in range(s.o):
            gap = max(gap, fabs(a.OO[i] - 1.0))
        for i in range(s.r):
            gap = max(gap, fabs(a.II[i] - 1.0))
        add_identity(s, 1.0, a)
        info = invert_extended(s, a, spare, pivots)
        if info != 0:
            return info
        product_extended(s, 2.0, a, Zo, b)
        copy_extended(s, b, Zo)
        product_extended(s, 2.0, Ze, a, b)
        copy_extended(s, b, Ze)
        doublings[0] += 1
        if gap < 1e-9 and ratio > 0.999:      # the error is squared by the step just done
            break
        # x -> 2 (x/sqrt(used))/(1 + x^2/used) of the two ends; the largest is 1 again
        ratio = min(2.0 * ratio * sqrt(used) / (used + ratio * ratio), 2.0 * sqrt(used) / (1.0 + used))
    return 0


cdef int reflect_and_transmit(Sizes s, double thickness, Extended Ze, Extended Zo, Extended C, Extended a, Extended b,
                              Extended spare, Extended r, Extended t, doubles lost, int m, ints pivots) noexcept nogil:
    """r = So - Se and t = (1 + Zo)^-1 C (1 + Ze)^-1; without end r = 1 - 2 Se and t = 0. lost = 2 Se, the flux's row."""
    cdef int info, i, axis = flux_axis(s.n, s.stokes)
    cdef bint endless = thickness > 1e300
    copy_extended(s, Ze, a)
    add_identity(s, 1.0, a)
    info = invert_extended(s, a, spare, pivots)
    if info != 0:
        return info
    product_extended(s, -2.0 if endless else -1.0, Ze, a, r)
    if m == 0:
        for i in range(s.n):
            lost[i] = r.N[<size_t>i * s.n + axis] * (-1.0 if endless else -2.0)
    if endless:
        add_identity(s, 1.0, r)
    else:
        product_extended(s, 1.0, C, a, b)                        # C (1 + Ze)^-1
        copy_extended(s, Zo, a)
        add_identity(s, 1.0, a)
        info = invert_extended(s, a, spare, pivots)
        product_extended(s, 1.0, a, b, t)
        if thickness > 1.5:     # Zo may be as large as the slab is thick: So = 1 - (1 + Zo)^-1
            add_extended(s, -1.0, a, r)
            add_identity(s, 1.0, r)
        else:                   # Zo may be small: So = Zo (1 + Zo)^-1
            product_extended(s, 1.0, Zo, a, b)
            add_extended(s, 1.0, b, r)
    for i in range(s.o):      # unscattered light only
        r.OO[i] = 0.0
    for i in range(s.r):
        r.II[i] = 0.0
    return info


cdef inline void half_sum_and_difference(Sizes s, Extended e, Extended f) noexcept nogil:
    """E, F <- alpha, beta = (E +- F)/2: I+' = -alpha I+ - beta I~ and I~' = beta I+ + alpha I~."""
    cdef size_t i
    cdef double x
    for i in range(size_extended(s)):
        x = e.N[i]
        e.N[i] = 0.5 * (x + f.N[i])
        f.N[i] = 0.5 * (x - f.N[i])


cdef void reflect_by_invariance(Sizes s, Extended alpha, Extended beta, Extended r, Extended t, Extended spare) noexcept nogil:
    """R's OI anew, from R's and T's other blocks: a thin layer added on top and taken off below changes nothing.

    In a thick slab at omega = 1 Zo grows with the thickness, and what it leaves in OI is the difference of two such
    numbers; here nothing is large. (1/mu + 1/mu0) R = -(alpha R + R alpha + R beta R - T beta T) through the nodes.
    """
    cdef int i, j
    cdef size_t k, nr = <size_t>s.n * s.r
    # everything right of R_ON, and of T_ON
    memcpy(spare.NI, alpha.NI, sizeof(double) * nr)
    product(b"N", b"N", s.n, s.r, s.n, 1.0, beta.N, s.n, r.NI, s.n, 1.0, spare.NI, s.n)
    product(b"N", b"N", s.o, s.r, s.n, -1.0, r.ON, s.o, spare.NI, s.n, 0.0, r.OI, s.o)
    for j in range(s.r):
        for i in range(s.n):
            k = <size_t>j * s.n + i
            spare.NI[k] = beta.NI[k] * t.II[j]
    product(b"N", b"N", s.n, s.r, s.n, 1.0, beta.N, s.n, t.NI, s.n, 1.0, spare.NI, s.n)
    product(b"N", b"N", s.o, s.r, s.n, 1.0, t.ON, s.o, spare.NI, s.n, 1.0, r.OI, s.o)
    product(b"N", b"N", s.o, s.r, s.n, -1.0, alpha.ON, s.o, r.NI, s.n, 1.0, r.OI, s.o)
    for j in range(s.n):
        for i in range(s.o):
            k = <size_t>j * s.o + i
            spare.ON[k] = t.OO[i] * beta.ON[k]
    product(b"N", b"N", s.o, s.r, s.n, 1.0, spare.ON, s.o, t.NI, s.n, 1.0, r.OI, s.o)
    for j in range(s.r):
        for i in range(s.o):
            r.OI[<size_t>j * s.o + i] /= alpha.OO[i] + alpha.II[j]


cdef void invariance(Sizes s, double thickness, Extended alpha, Extended beta, Extended r, Extended t, Extended a, Extended b,
                     Extended c, doubles residual) noexcept nogil:
    """How far R and T are from not caring whether a thin layer is added on top or at the bottom, relative:
    beta + alpha R + R alpha + R beta R = T beta T and (alpha + R beta) T = T (alpha + beta R).

    R counts relative to the light that it meets, not to itself: where albedo is 1e-12, nobody sees its last digits."""
    cdef size_t i, nn = <size_t>s.n * s.n
    cdef int n = s.n
    cdef doubles x = a.N
    cdef doubles y = b.N
    cdef doubles z = c.N
    cdef double largest
    memcpy(x, alpha.N, sizeof(double) * nn)
    product(b"N", b"N", n, n, n, 1.0, r.N, n, beta.N, n, 1.0, x, n)      # alpha + R beta
    product(b"N", b"N", n, n, n, 1.0, t.N, n, beta.N, n, 0.0, y, n)      # T beta
    product(b"N", b"N", n, n, n, 1.0, r.N, n, alpha.N, n, 0.0, z, n)
    largest = largest_of(nn, alpha.N)
    largest = max(max(largest_of(nn, z), largest_of(nn, beta.N)), largest * min(1.0, thickness * largest))
    for i in range(nn):
        z[i] += beta.N[i]
    product(b"N", b"N", n, n, n, 1.0, x, n, r.N, n, 1.0, z, n)
    product(b"N", b"N", n, n, n, -1.0, y, n, t.N, n, 1.0, z, n)
    residual[0] = largest_of(nn, z) / largest if largest > 0.0 else 0.0
    product(b"N", b"N", n, n, n, 1.0, x, n, t.N, n, 0.0, z, n)
    largest = largest_of(nn, z)
    product(b"N", b"N", n, n, n, -1.0, t.N, n, alpha.N, n, 1.0, z, n)
    product(b"N", b"N", n, n, n, -1.0, y, n, r.N, n, 1.0, z, n)
    residual[1] = largest_of(nn, z) / largest if largest > 1e-280 else 0.0
