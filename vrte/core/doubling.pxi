# Slabs doubled: lists of operations, which OpenCL kernels share.

cdef extern from "core/kernels/in_c.h":
    ctypedef struct vrte_slab:
        double thickness, albedo, slowest, steepest, h, ratio
        int turned, clear, conservative, left, carried, doublings, singular
    ctypedef struct vrte_operation:
        int kind, when, a, b, c, times
        double alpha, beta
        double gamma
    enum: e_, f_, Ze_, Zo_, C_, a_, b_, spare_, R_, T_
    enum: PRODUCT, COMBINE, INVERT, STRAIGHT, BLOCKS, BEGIN, CARRY, DISTANCE, NEXT, MIRROR, LOSE, LEAD, DIVIDE, MEASURE
    enum: TANH, COMPLEMENT, N_NI, VRTE_START, VRTE_DOUBLE, VRTE_END, VRTE_SQUARE
    int vrte_list_length(int which) noexcept nogil
    vrte_operation vrte_operation_of(int which, int k) noexcept nogil
    int vrte_conditions_of(vrte_slab slab) noexcept nogil
    double vrte_factor_of(vrte_slab slab, int times) noexcept nogil
    void vrte_begin(vrte_slab* slab, double norm) noexcept nogil
    void vrte_next(vrte_slab* slab, double distance) noexcept nogil
    double vrte_missing_of_reflection(const double* measured, double thickness) noexcept nogil
    double vrte_missing_of_transmission(const double* measured) noexcept nogil
    double vrte_over_cosh_squared(double x) noexcept nogil

cdef double CONVERGED = 1e-17     # below the rounding of 1


cdef inline Sizes sizes_of(const Arrays* t) noexcept nogil:
    return Sizes(t.n, t.n_rhs, t.n_out_rows, t.stokes)


cdef struct Work:
    # one slab of one order at work: its matrices by their names in kernels/doubling.h, mu/k of beams and outgoing
    # directions, what was measured
    const Arrays* t
    Sizes s
    Nodes nodes
    vrte_slab slab
    Extended m[10]
    given mu0, mu_out
    double measured[6]


cdef int double_slabs_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    cdef int k, material = t.material[0]
    cdef Sizes s = sizes_of(t)
    cdef size_t each = size_extended(s), at = material, n = s.n
    cdef double albedo = t.albedo[material], slowest = sqrt((1.0 - albedo) * (1.0 - albedo * t.asymmetry[material]))
    cdef bint turned = t.conserving and t.orders[0] == 0
    cdef Work w
    memset(&w, 0, sizeof(Work))
    w.t, w.s, w.nodes = t, s, nodes_of(t)
    w.mu0 = slants(t.slant_in, material, t.n_in, t.mu0)
    w.mu_out = slants(t.slant_out, material, t.n_out, t.mu_out)
    w.slab.thickness, w.slab.albedo, w.slab.turned, w.slab.conservative = t.thickness[0], albedo, turned, albedo == 1.0
    w.slab.slowest = slowest if turned and albedo < 1.0 else max(slowest, 0.05)
    w.slab.steepest = put_rates(&w, slants(t.slant_nodes, material, t.n_node, t.nodes))
    for k in range(8):
        w.m[k] = extended_at(s, t.room + k * each)
    w.m[<int>R_], w.m[<int>T_] = extended_at(s, t.R), extended_at(s, t.T)
    set_zero(each, t.R)
    set_zero(each, t.T)
    set_zero(n, t.lost)
    t.residual[0] = t.residual[1] = 0.0
    t.doublings[0] = 0
    if albedo == 0.0 and t.clear:
        clear_slab(&w)
        return 0
    extend(&w, t.E + at * n * n, t.G_E + at * n * s.o, t.source_d + at * t.n_in_rows * n, w.m[<int>e_])
    extend(&w, t.F + at * n * n, t.G_F + at * n * s.o, t.source_s + at * t.n_in_rows * n, w.m[<int>f_])
    if turned:
        turn_extended(&w)
    perform_list(&w, VRTE_START)
    while w.slab.left > 0 and not w.slab.singular and not desk.stop[0]:
        if t.converged and w.slab.carried and largest_of(each, w.m[<int>C_].N) < CONVERGED:
            perform_list(&w, VRTE_SQUARE)
        else:
            perform_list(&w, VRTE_DOUBLE)
    t.doublings[0] = w.slab.doublings
    if not w.slab.singular and not desk.stop[0]:
        perform_list(&w, VRTE_END)
        t.residual[0] = vrte_missing_of_reflection(w.measured, w.slab.thickness)
        t.residual[1] = vrte_missing_of_transmission(w.measured)
    return w.slab.singular


cdef void perform_list(Work* w, int which) noexcept nogil:
    """The operations of a list, those whose conditions hold when they are reached."""
    cdef int k
    cdef vrte_operation now
    for k in range(vrte_list_length(which)):
        now = vrte_operation_of(which, k)
        if not w.slab.singular and now.when & vrte_conditions_of(w.slab) == now.when:
            perform(w, now)


cdef void perform(Work* w, vrte_operation now) noexcept nogil:
    cdef Sizes s = w.s
    cdef Extended a = w.m[now.a], b = w.m[now.b], c = w.m[now.c], T = w.m[<int>T_]
    cdef int n = s.n, axis = flux_axis(n, s.stokes), i, j, rows = s.o if now.times % 2 else n
    cdef bint outgoing = now.times % 2, beams = now.times >= N_NI
    cdef given rates = w.t.rates_off
    cdef doubles Zo = w.m[<int>Zo_].N
    cdef double across
    if now.kind == PRODUCT:
        product_extended(s, now.alpha * vrte_factor_of(w.slab, now.times), a, b, c)
    elif now.kind == COMBINE:
        combine(s, now.alpha * vrte_factor_of(w.slab, now.times), a, now.beta, b, now.gamma, c)
    elif now.kind == INVERT:
        w.slab.singular = invert_extended(s, a, b, w.t.pivots) != 0
    elif now.kind == BLOCKS:
        product(b"N", b"N", rows, s.r if beams else n, n, now.alpha, a.ON if outgoing else a.N, rows,
                b.NI if beams else b.N, n, now.beta,
                (c.OI if outgoing else c.NI) if beams else c.ON if outgoing else c.N, rows)
    elif now.kind == MEASURE:
        w.measured[now.b] = largest_of(<size_t>n * n, a.N)
    elif now.kind == BEGIN:
        vrte_begin(&w.slab, norm_1(n, w.m[<int>a_].N))
    elif now.kind == DISTANCE:              # where the flux is conserved Ze = 0 on its axis for ever
        a, w.measured[0] = w.m[<int>a_], 0.0
        for i in range(n):
            if not (w.slab.turned and w.slab.conservative and i == axis):
                w.measured[0] = max(w.measured[0], fabs(a.N[<size_t>i * n + i] - 1.0))
        for i in range(s.o + s.r):
            w.measured[0] = max(w.measured[0], fabs(a.OO[i] - 1.0))
    elif now.kind == NEXT:
        vrte_next(&w.slab, w.measured[0])
    elif now.kind == CARRY:
        w.slab.carried = 1
    elif now.kind == STRAIGHT:              # of unscattered light
        for i in range(s.o + s.r):
            c.OO[i] = (tanh(w.slab.h * rates[i]) if now.b == TANH
                       else vrte_over_cosh_squared(w.slab.h * rates[i]) if now.b == COMPLEMENT else 0.0)
    elif now.kind == MIRROR:                # reciprocity; rounding in the flux's row would double at each step
        for i in range(n):
            across = Zo[<size_t>axis * n + i]
            Zo[<size_t>i * n + axis] = -across if s.stokes == 4 and i % 4 == 3 else across
    elif now.kind == LOSE:                  # 2 Se, the flux's row
        for i in range(n):
            w.t.lost[i] = w.t.R[<size_t>i * n + axis] * (-2.0 if w.slab.thickness < SEMI_INFINITE else -1.0)
    elif now.kind == LEAD:                  # spare: beta's NI times T's II, T's OO times beta's ON
        for j in range(s.r):
            for i in range(n):
                w.m[<int>spare_].NI[<size_t>j * n + i] = w.m[<int>b_].NI[<size_t>j * n + i] * T.II[j]
        for j in range(n):
            for i in range(s.o):
                w.m[<int>spare_].ON[<size_t>j * s.o + i] = T.OO[i] * w.m[<int>b_].ON[<size_t>j * s.o + i]
    elif now.kind == DIVIDE:
        for j in range(s.r):
            for i in range(s.o):
                w.m[<int>R_].OI[<size_t>j * s.o + i] /= rates[i] + rates[s.o + j]


cdef double put_rates(const Work* w, given steep) noexcept nogil:
    """1/mu of the outgoing rows, then of the incident columns, into `rates_off`; the largest of all, nodes too, whose
    mu/k are `steep`."""
    cdef int i
    cdef double largest = 0.0
    for i in range(w.s.o):
        w.t.rates_off[i] = 1.0 / w.mu_out[i // w.s.stokes]
    for i in range(w.s.r):
        w.t.rates_off[w.s.o + i] = 1.0 / w.mu0[i // w.t.n_col]
    for i in range(w.t.n_node):
        largest = max(largest, 1.0 / steep[i])
    return max(largest, largest_of(w.s.o + w.s.r, w.t.rates_off))


cdef void clear_slab(const Work* w) noexcept nogil:
    """A slab that does not scatter: T alone."""
    cdef int i, n = w.s.n, stokes = w.s.stokes
    cdef double size = half_range(w.nodes), thickness = w.slab.thickness
    cdef Extended T = w.m[<int>T_]
    for i in range(n):
        T.N[<size_t>i * n + i] = exp(-thickness / w.nodes.mu[i // stokes])
    for i in range(w.s.o + w.s.r):
        T.OO[i] = exp(-thickness * w.t.rates_off[i])
    if not w.slab.turned:
        return
    conserving_axis(w.nodes, w.t.v)
    reflect_both(w.nodes, w.t.v, T.N, w.t.room)
    for i in range(n // stokes):     # the axis is minus the unit null vector
        w.t.lost[stokes * i] = sqrt(w.nodes.weights[i] * w.nodes.mu[i] / size) * expm1(-thickness / w.nodes.mu[i])
    turn_columns(w.nodes, 1, w.t.v, w.t.lost)


cdef void extend(const Work* w, given matrix, given G, given source, Extended a) noexcept nogil:
    """E or F with its incident and outgoing directions: the sources with the other sign, no OI; 1/mu on the
    diagonal."""
    cdef int i, j, n = w.s.n, o = w.s.o, stokes = w.s.stokes
    copy(<size_t>n * n, matrix, a.N)
    for j in range(n):
        for i in range(o):
            a.ON[<size_t>j * o + i] = -G[<size_t>j * o + i] / w.mu_out[i // stokes]
    for i in range(w.t.n_in):
        multiply(n, w.t.n_col, stokes, -1.0, source + <size_t>stokes * i * n, w.t.columns, 0.0,
                 a.NI + <size_t>i * w.t.n_col * n)
    set_zero(<size_t>w.s.r * o, a.OI)
    copy(o + w.s.r, w.t.rates_off, a.OO)


cdef void turn_extended(const Work* w) noexcept nogil:
    """Order 0: one axis becomes sqrt(weight mu) on I, whose row and column of E are known exactly (2 N terms)."""
    cdef int i, k, stokes = w.s.stokes, axis = flux_axis(w.s.n, stokes), material = w.t.material[0]
    cdef double size = sqrt(half_range(w.nodes)), albedo = w.slab.albedo
    cdef doubles v = w.t.v, spare = w.m[<int>spare_].N
    cdef Extended e = w.m[<int>e_]
    conserving_axis(w.nodes, v)
    for k in range(2):                      # e, f
        reflect_both(w.nodes, v, w.m[k].N, spare)
        turn_columns(w.nodes, w.s.r, v, w.m[k].NI)
        turn_rows(w.nodes, w.s.o, v, w.m[k].ON, spare)
    if not is_lossy(w.t, material):
        exact_conservation(w.nodes, albedo, v, e.N, spare)
    if w.t.oriented != NULL and w.t.oriented[material]:     # beams lose what their k says: balanced where assembled
        return
    for i in range(w.s.r):
        e.NI[<size_t>i * w.s.n + axis] = albedo * w.t.columns[stokes * (i % w.t.n_col)] / size
    for i in range(w.s.o):
        e.ON[<size_t>axis * w.s.o + i] = 0.0 if i % stokes else albedo / (w.mu_out[i // stokes] * size)
