cdef inline Sizes sizes_of(const Arrays* t) noexcept nogil:
    return Sizes(t.n, t.n_rhs, t.n_out_rows, t.stokes)


cdef struct Work:
    # one slab of one order at work: E and F with their directions off the nodes, Ze, Zo and C = 1 - Zo Ze, R and T
    Sizes s
    Nodes nodes
    int m, n_in, n_col
    bint oriented, lossy
    double thickness, albedo, asymmetry, steepest
    given columns, mu0, mu_out, steep       # mu/k of beams, outgoing directions, nodes
    Extended e, f, Ze, Zo, C, a, b, spare, r, t
    doubles v
    Workspace desk


cdef int double_slabs_one(Arrays* d, int item, Workspace desk) noexcept nogil:
    cdef int material = d.material[0], stokes = d.stokes, info
    cdef Sizes s = sizes_of(d)
    cdef size_t each = size_extended(s), at = material, n = s.n, into = stokes * d.n_in
    cdef doubles memory = d.room, lost = d.lost, residual = d.residual
    cdef Work w = Work(
        s, Nodes(s.n, stokes, d.nodes, d.weights), d.orders[0] if d.conserving else max(d.orders[0], 1), d.n_in,
        d.n_col, d.oriented != NULL and d.oriented[material] != 0, is_lossy(d, material), d.thickness[0],
        d.albedo[material], d.asymmetry[material], 0.0, d.columns,
        slants(d.slant_in, material, d.n_in, d.mu0), slants(d.slant_out, material, d.n_out, d.mu_out),
        slants(d.slant_nodes, material, d.n_node, d.nodes),
        extended_at(s, memory), extended_at(s, memory + each), extended_at(s, memory + 2 * each),
        extended_at(s, memory + 3 * each), extended_at(s, memory + 4 * each), extended_at(s, memory + 5 * each),
        extended_at(s, memory + 6 * each), extended_at(s, memory + 7 * each), extended_at(s, d.R), extended_at(s, d.T),
        d.v, Workspace(NULL, d.pivots, desk.stop))
    set_zero(each, w.r.N)
    set_zero(each, w.t.N)
    set_zero(n, lost)
    residual[0] = residual[1] = 0.0
    d.doublings[0] = 0
    put_rates(&w, w.e)
    if w.albedo == 0.0 and d.clear:
        clear_slab(&w, lost)
        return 0
    extend(&w, d.E + at * n * n, d.G_E + at * n * s.o, d.source_d + at * into * n, w.e)
    put_rates(&w, w.f)
    extend(&w, d.F + at * n * n, d.G_F + at * n * s.o, d.source_s + at * into * n, w.f)
    if w.m == 0:
        turn_extended(&w)
    product_extended(s, 1.0, w.f, w.e, w.a)
    w.steepest = max(w.steepest, sqrt(norm_1(s.n, w.a.N)))
    if w.thickness < SEMI_INFINITE:
        info = double_plainly(&w, d.converged, d.doublings)
    else:
        info = double_semi_infinite(&w, d.doublings)
    if info != 0 or desk.stop[0]:
        return info
    info = reflect_and_transmit(&w, lost)
    if info == 0:
        half_sum_and_difference(s, w.e, w.f)
        if w.thickness > THICK:
            reflect_by_invariance(s, w.e, w.f, w.r, w.t, w.a)
        invariance(&w, residual)
    return info


cdef void put_rates(Work* w, Extended a) noexcept nogil:
    """1/mu of the incident and outgoing directions on a's diagonal; `steepest`: the largest of all."""
    cdef int i
    for i in range(w.s.o):
        a.OO[i] = 1.0 / w.mu_out[i // w.s.stokes]
        w.steepest = max(w.steepest, a.OO[i])
    for i in range(w.s.r):
        a.II[i] = 1.0 / w.mu0[i // w.n_col]
        w.steepest = max(w.steepest, a.II[i])
    for i in range(w.s.n // w.s.stokes):
        w.steepest = max(w.steepest, 1.0 / w.steep[i])


cdef void clear_slab(const Work* w, doubles lost) noexcept nogil:
    """A slab that does not scatter: T alone."""
    cdef int i, n = w.s.n, stokes = w.s.stokes
    cdef double size = half_range(w.nodes)
    for i in range(n):
        w.t.N[<size_t>i * n + i] = exp(-w.thickness / w.nodes.mu[i // stokes])
    for i in range(w.s.o):
        w.t.OO[i] = exp(-w.thickness * w.e.OO[i])
    for i in range(w.s.r):
        w.t.II[i] = exp(-w.thickness * w.e.II[i])
    if w.m != 0:
        return
    conserving_axis(w.nodes, w.v)
    reflect_both(w.nodes, w.v, w.t.N, w.spare.N)
    for i in range(n // stokes):     # the axis is minus the unit null vector
        lost[stokes * i] = sqrt(w.nodes.weights[i] * w.nodes.mu[i] / size) * expm1(-w.thickness / w.nodes.mu[i])
    turn_columns(w.nodes, 1, w.v, lost)


cdef void extend(const Work* w, given matrix, given G, given source, Extended a) noexcept nogil:
    """E or F with its incident and outgoing directions: the sources with the other sign, no OI."""
    cdef int i, j, n = w.s.n, o = w.s.o, stokes = w.s.stokes
    copy(<size_t>n * n, matrix, a.N)
    for j in range(n):
        for i in range(o):
            a.ON[<size_t>j * o + i] = -G[<size_t>j * o + i] / w.mu_out[i // stokes]
    for i in range(w.n_in):
        multiply(n, w.n_col, stokes, -1.0, source + <size_t>stokes * i * n, w.columns, 0.0,
                 a.NI + <size_t>i * w.n_col * n)
    set_zero(<size_t>w.s.r * o, a.OI)


cdef void turn_extended(Work* w) noexcept nogil:
    """Order 0: one axis becomes sqrt(weight mu) on I, whose row and column of E are known exactly (2 N terms)."""
    cdef int i, stokes = w.s.stokes, axis = flux_axis(w.s.n, stokes)
    cdef double size = sqrt(half_range(w.nodes))
    conserving_axis(w.nodes, w.v)
    reflect_both(w.nodes, w.v, w.e.N, w.spare.N)
    reflect_both(w.nodes, w.v, w.f.N, w.spare.N)
    if not w.lossy:
        exact_conservation(w.nodes, w.albedo, w.v, w.e.N, w.spare.N)
    turn_edges(w, w.e)
    turn_edges(w, w.f)
    if w.oriented:                          # beams lose what their k says: balanced where it is assembled
        return
    for i in range(w.s.r):
        w.e.NI[<size_t>i * w.s.n + axis] = w.albedo * w.columns[stokes * (i % w.n_col)] / size
    for i in range(w.s.o):
        w.e.ON[<size_t>axis * w.s.o + i] = 0.0 if i % stokes else w.albedo / (w.mu_out[i // stokes] * size)


cdef inline void turn_edges(const Work* w, Extended a) noexcept nogil:
    """NI <- (1 - v v^T) NI, ON <- ON (1 - v v^T)."""
    turn_columns(w.nodes, w.s.r, w.v, a.NI)
    turn_rows(w.nodes, w.s.o, w.v, a.ON, w.spare.N)


cdef double CONVERGED = 1e-17     # below the rounding of 1
TANH_NUMERATOR = 135135.0, 17325.0, 378.0, 1.0      # tanh's continued fraction, its seventh convergent
TANH_DENOMINATOR = 135135.0, 62370.0, 3150.0, 28.0
cdef double[4] NUMERATOR = TANH_NUMERATOR
cdef double[4] DENOMINATOR = TANH_DENOMINATOR


cdef int double_plainly(Work* w, bint converged, int* doublings) noexcept nogil:
    """Ze, Zo and C = 1 - Zo Ze of a finite slab: a rational start, then Zo <- 2 L^-1 Zo, Ze <- 2 Ze L^-1, L = 1 + Zo
    Ze; a is F E on entry.

    C is formed while half the thickness is at most 0.75, so that 1 - Zo Ze keeps its digits, then carried,
    C <- (C L^-1)^2, which keeps them where T is too small for a difference. converged: once C is below the rounding of
    1, L = 2 and doublings change C alone.
    """
    cdef Sizes s = w.s
    cdef int info, step, i, count = 0, axis = flux_axis(s.n, s.stokes)
    cdef size_t k
    cdef double h = 0.5 * w.thickness
    cdef bint carried = False
    while h * w.steepest > 0.5:
        h = 0.5 * h
        count = count + 1
    doublings[0] = count
    info = rational_start(w, h)
    for step in range(count):
        if info != 0 or w.desk.stop[0]:
            return info
        if converged and carried and largest_of(size_extended(s), w.C.N) < CONVERGED:
            product_extended(s, 0.25, w.C, w.C, w.b)
            copy_extended(s, w.b, w.C)
            h = 2.0 * h
            direct_complement(w, h)
            continue
        product_extended(s, 1.0, w.Zo, w.Ze, w.a)                      # L - 1
        if 2.0 * h > COMPLEMENTED and not carried:
            complement(w, h)
            carried = True
        info = double_both(w)
        if w.m == 0:
            for i in range(s.n):    # reciprocity; rounding in this row would double at each step
                k = <size_t>axis * s.n + i
                w.Zo.N[<size_t>i * s.n + axis] = -w.Zo.N[k] if s.stokes == 4 and i % 4 == 3 else w.Zo.N[k]
        h = 2.0 * h
        go_straight(w, h)
        if carried:
            product_extended(s, 1.0, w.C, w.a, w.b)
            product_extended(s, 1.0, w.b, w.b, w.C)
            direct_complement(w, h)
    if not carried:
        product_extended(s, 1.0, w.Zo, w.Ze, w.a)
        complement(w, h)
    return info


cdef int double_both(const Work* w) noexcept nogil:
    """Zo <- 2 L^-1 Zo, Ze <- 2 Ze L^-1; a <- L^-1, L - 1 on entry."""
    cdef int info
    add_identity(w.s, 1.0, w.a)
    info = invert_extended(w.s, w.a, w.spare, w.desk.pivots)
    if info == 0:
        product_extended(w.s, 2.0, w.a, w.Zo, w.b)
        copy_extended(w.s, w.b, w.Zo)
        product_extended(w.s, 2.0, w.Ze, w.a, w.b)
        copy_extended(w.s, w.b, w.Ze)
    return info


cdef void go_straight(const Work* w, double h) noexcept nogil:
    """Ze and Zo of unscattered light."""
    cdef int i
    for i in range(w.s.o):
        w.Ze.OO[i] = w.Zo.OO[i] = tanh(h * w.e.OO[i])
    for i in range(w.s.r):
        w.Ze.II[i] = w.Zo.II[i] = tanh(h * w.e.II[i])


cdef void complement(const Work* w, double h) noexcept nogil:
    """C = 1 - Zo Ze, which a is."""
    copy_extended(w.s, w.a, w.C)
    scale_extended(w.s, -1.0, w.C)
    add_identity(w.s, 1.0, w.C)
    direct_complement(w, h)


cdef void direct_complement(const Work* w, double h) noexcept nogil:
    """1 - tanh^2 = 1/cosh^2 of the unscattered light, without a difference."""
    cdef int i
    for i in range(w.s.o):
        w.C.OO[i] = vrte_over_cosh_squared(h * w.e.OO[i])
    for i in range(w.s.r):
        w.C.II[i] = vrte_over_cosh_squared(h * w.e.II[i])


cdef extern from "core/kernels/in_c.h":
    double vrte_over_cosh_squared(double x) noexcept nogil
    double vrte_doubled_ratio(double ratio, double used) noexcept nogil


cdef int rational_start(const Work* w, double h) noexcept nogil:
    """Ze = E f, Zo = f F with the seventh convergent of tanh's continued fraction (2e-16 for h sqrt(A) <= 1/2); a is
    F E on entry."""
    cdef int i, info
    cdef Sizes s = w.s
    cdef Extended z = w.a, power = w.b, above = w.C, below = w.spare
    scale_extended(s, h * h, z)
    set_zero(size_extended(s), above.N)
    set_zero(size_extended(s), below.N)
    add_identity(s, NUMERATOR[0], above)
    add_identity(s, DENOMINATOR[0], below)
    copy_extended(s, z, power)
    for i in range(1, 4):
        add_extended(s, NUMERATOR[i], power, above)
        add_extended(s, DENOMINATOR[i], power, below)
        if i < 3:
            product_extended(s, 1.0, z, power, w.Ze)
            copy_extended(s, w.Ze, power)
    info = invert_extended(s, below, power, w.desk.pivots)
    product_extended(s, h, below, above, z)
    product_extended(s, 1.0, w.e, z, w.Ze)
    product_extended(s, 1.0, z, w.f, w.Zo)
    go_straight(w, h)
    return info


cdef int double_semi_infinite(Work* w, int* doublings) noexcept nogil:
    """Ze and Zo of a semi-infinite slab, where Zo Ze = 1, by scaled doublings.

    Before each, both are multiplied by ratio^(-1/2), `ratio` being the smallest over the largest eigenvalue of
    sqrt(Zo Ze): the smallest is estimated from below, and a wrong guess costs steps, no digits. The condition of L is
    1/ratio: it is not let below STEEPEST_RATIO.
    """
    cdef Sizes s = w.s
    cdef int info, step, i, axis = flux_axis(s.n, s.stokes)
    cdef double ratio, used, gap, slowest = sqrt((1.0 - w.albedo) * (1.0 - w.albedo * w.asymmetry))
    if w.m > 0 or w.albedo == 1.0:
        slowest = max(slowest, 0.05)
    ratio = min(1.0, slowest / w.steepest)
    copy_extended(s, w.e, w.Ze)
    copy_extended(s, w.f, w.Zo)
    scale_extended(s, 1.0 / w.steepest, w.Ze)
    scale_extended(s, 1.0 / w.steepest, w.Zo)
    for step in range(MOST_DOUBLINGS):
        if w.desk.stop[0]:
            return 0
        used = max(ratio, STEEPEST_RATIO)
        scale_extended(s, 1.0 / sqrt(used), w.Ze)
        scale_extended(s, 1.0 / sqrt(used), w.Zo)
        product_extended(s, 1.0, w.Zo, w.Ze, w.a)
        gap = 0.0
        for i in range(s.n):
            if not (w.m == 0 and w.albedo == 1.0 and i == axis):     # there Ze = 0 for ever
                gap = max(gap, fabs(w.a.N[<size_t>i * s.n + i] - 1.0))
        for i in range(s.o):
            gap = max(gap, fabs(w.a.OO[i] - 1.0))
        for i in range(s.r):
            gap = max(gap, fabs(w.a.II[i] - 1.0))
        info = double_both(w)
        if info != 0:
            return info
        doublings[0] += 1
        if gap < 1e-9 and ratio > 0.999:      # the error is squared by the step just done
            break
        ratio = vrte_doubled_ratio(ratio, used)
    return 0


cdef int reflect_and_transmit(const Work* w, doubles lost) noexcept nogil:
    """R = So - Se and T = (1 + Zo)^-1 C (1 + Ze)^-1; semi-infinite: R = 1 - 2 Se and T = 0. lost = 2 Se, the flux's
    row."""
    cdef Sizes s = w.s
    cdef int info, i, axis = flux_axis(s.n, s.stokes)
    cdef bint semi_infinite = w.thickness > SEMI_INFINITE
    copy_extended(s, w.Ze, w.a)
    add_identity(s, 1.0, w.a)
    info = invert_extended(s, w.a, w.spare, w.desk.pivots)
    if info != 0:
        return info
    product_extended(s, -2.0 if semi_infinite else -1.0, w.Ze, w.a, w.r)
    if w.m == 0:
        for i in range(s.n):
            lost[i] = w.r.N[<size_t>i * s.n + axis] * (-1.0 if semi_infinite else -2.0)
    if semi_infinite:
        add_identity(s, 1.0, w.r)
    else:
        product_extended(s, 1.0, w.C, w.a, w.b)                        # C (1 + Ze)^-1
        copy_extended(s, w.Zo, w.a)
        add_identity(s, 1.0, w.a)
        info = invert_extended(s, w.a, w.spare, w.desk.pivots)
        product_extended(s, 1.0, w.a, w.b, w.t)
        if w.thickness > THICK:     # Zo may be as large as the slab is thick: So = 1 - (1 + Zo)^-1
            add_extended(s, -1.0, w.a, w.r)
            add_identity(s, 1.0, w.r)
        else:                       # Zo may be small: So = Zo (1 + Zo)^-1
            product_extended(s, 1.0, w.Zo, w.a, w.b)
            add_extended(s, 1.0, w.b, w.r)
    set_zero(s.o, w.r.OO)           # unscattered light only
    set_zero(s.r, w.r.II)
    return info


cdef inline void half_sum_and_difference(Sizes s, Extended e, Extended f) noexcept nogil:
    """E, F <- alpha, beta = (E +- F)/2: I+' = -alpha I+ - beta I~ and I~' = beta I+ + alpha I~."""
    cdef size_t i
    cdef double x
    for i in range(size_extended(s)):
        x = e.N[i]
        e.N[i] = 0.5 * (x + f.N[i])
        f.N[i] = 0.5 * (x - f.N[i])


cdef void reflect_by_invariance(Sizes s, Extended alpha, Extended beta, Extended r, Extended t,
                                Extended spare) noexcept nogil:
    """R's OI anew, from R's and T's other blocks: a thin layer added on top and taken off below changes nothing.

    In a thick slab at omega = 1 Zo grows with the thickness, and what it leaves in OI is the difference of two such
    numbers; here nothing is large. (1/mu + 1/mu0) R = -(alpha R + R alpha + R beta R - T beta T) through the nodes.
    """
    cdef int i, j
    cdef size_t k, nr = <size_t>s.n * s.r
    # everything right of R_ON, and of T_ON
    copy(nr, alpha.NI, spare.NI)
    multiply(s.n, s.r, s.n, 1.0, beta.N, r.NI, 1.0, spare.NI)
    multiply(s.o, s.r, s.n, -1.0, r.ON, spare.NI, 0.0, r.OI)
    for j in range(s.r):
        for i in range(s.n):
            k = <size_t>j * s.n + i
            spare.NI[k] = beta.NI[k] * t.II[j]
    multiply(s.n, s.r, s.n, 1.0, beta.N, t.NI, 1.0, spare.NI)
    multiply(s.o, s.r, s.n, 1.0, t.ON, spare.NI, 1.0, r.OI)
    multiply(s.o, s.r, s.n, -1.0, alpha.ON, r.NI, 1.0, r.OI)
    for j in range(s.n):
        for i in range(s.o):
            k = <size_t>j * s.o + i
            spare.ON[k] = t.OO[i] * beta.ON[k]
    multiply(s.o, s.r, s.n, 1.0, spare.ON, t.NI, 1.0, r.OI)
    for j in range(s.r):
        for i in range(s.o):
            r.OI[<size_t>j * s.o + i] /= alpha.OO[i] + alpha.II[j]


cdef void invariance(const Work* w, doubles residual) noexcept nogil:
    """How far R and T are from not caring whether a thin layer is added on top or at the bottom, relative:
    beta + alpha R + R alpha + R beta R = T beta T and (alpha + R beta) T = T (alpha + beta R); e, f: alpha, beta.

    R counts relative to the light that it meets, not to itself: where albedo is 1e-12, nobody sees its last digits."""
    cdef int n = w.s.n
    cdef size_t i, nn = <size_t>n * n
    cdef given alpha = w.e.N, beta = w.f.N, R = w.r.N, T = w.t.N
    cdef doubles x = w.a.N, y = w.b.N, z = w.spare.N
    cdef double largest
    copy(nn, alpha, x)
    multiply(n, n, n, 1.0, R, beta, 1.0, x)                  # alpha + R beta
    multiply(n, n, n, 1.0, T, beta, 0.0, y)                  # T beta
    multiply(n, n, n, 1.0, R, alpha, 0.0, z)
    largest = largest_of(nn, alpha)
    largest = max(max(largest_of(nn, z), largest_of(nn, beta)), largest * min(1.0, w.thickness * largest))
    for i in range(nn):
        z[i] += beta[i]
    multiply(n, n, n, 1.0, x, R, 1.0, z)
    multiply(n, n, n, -1.0, y, T, 1.0, z)
    residual[0] = largest_of(nn, z) / largest if largest > 0.0 else 0.0
    multiply(n, n, n, 1.0, x, T, 0.0, z)
    largest = largest_of(nn, z)
    multiply(n, n, n, -1.0, T, alpha, 1.0, z)
    multiply(n, n, n, -1.0, y, R, 1.0, z)
    residual[1] = largest_of(nn, z) / largest if largest > NO_LIGHT else 0.0
