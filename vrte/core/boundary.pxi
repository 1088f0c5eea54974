# Boundary conditions, (1:49)-(1:65), all layers of one order. Even and odd modes about the middle of a layer,
#   even: y = cosh(k t)/cosh(k h), z = -lambda y_odd;  odd: y = sinh(k t)/(k cosh(k h)), z = -y_even,
# split the 8N system of a slab into two 4N systems and stay regular at lambda = 0; layers join by the star
# product from the base up, as in (2:8). In a layer so thick that every mode decays (`decays`), "even" is e^(-k tau)
# and "odd" e^(-k (thickness - tau)), each referred to its own face as in (2:12)-(2:15): faint light keeps its digits.

cdef struct Modes:
    # of one order and layer: s = X y, d = Y z; whether every mode loses e^FADING from face to face
    int n
    given lam_re, lam_im, X, Y
    double thickness
    bint decaying


cdef inline Modes modes_at(int n, size_t at, given lam_re, given lam_im, given X, given Y, double thickness,
                           bint decaying) noexcept nogil:
    """The modes number `at` of arrays (..., n) and (..., n, n)."""
    return Modes(n, lam_re + at * n, lam_im + at * n, X + at * n * n, Y + at * n * n, thickness, decaying)


cdef inline cplx lambda_of(const Modes* a, int j) noexcept nogil:
    return make(a.lam_re[j], a.lam_im[j])


cdef inline cplx rate_of(const Modes* a, int j) noexcept nogil:
    """k = sqrt(lambda)."""
    return c_sqrt(lambda_of(a, j))


cdef double slowest_rate(const Modes* a) noexcept nogil:
    cdef int j
    cdef double rate = INFINITY, smallest = INFINITY
    for j in range(a.n):
        if a.lam_im[j] == 0.0:
            smallest = min(smallest, a.lam_re[j])
        else:
            rate = min(rate, rate_of(a, j).real)
    return min(rate, c_sqrt(make(smallest, 0.0)).real)


cdef inline cplx half_tangent(cplx k, double thickness) noexcept nogil:
    """tanh(k h)/k with h = thickness/2."""
    cdef cplx e
    if size_of(k) * thickness < 1e-150:
        return make(0.5 * thickness, 0.0)
    e = c_expm1(-thickness * k)
    return over(-e, times(k, e + 2.0))


cdef inline cplx beam_response(cplx k, double rate, double depth) noexcept nogil:
    """D(depth) = (e^(-depth rate) - e^(-k depth))/(k - rate), unit optical depth."""
    return depth * exp_difference(make(-depth * rate, 0.0), -depth * k)


cdef Job boundary_job(Arrays* t) noexcept nogil:
    cdef size_t n = t.n, n_layer = t.n_layer, r = t.n_rhs
    return Job(t.n_order, 5 * n_layer * n * (n + r) + 4 * n * n + 5 * n * r + (10 + 2 * n_layer) * n,
               (2 * n_layer + 1) * n)


cdef struct Slab:
    # one layer of an order
    Modes modes
    int n_rhs, per_beam
    given c, zeta, mu0
    double above
    doubles even_lu, odd_lu      # the two systems, factorised
    doubles R, T, G              # G: from what falls at the bottom to what goes up there
    doubles top, rising, falling # the beam's field: down at the top; up and down at the bottom (n_rhs, n)
    doubles emitted, g           # down and up at the bottom where nothing falls in
    cplx* tangents               # tanh(k thickness/2)/k, (n,), unless all decays
    ints pivots


cdef Slab slab_at(const Arrays* t, int item, int layer, Workspace desk) noexcept nogil:
    cdef size_t n = t.n, nn = n * n, nr = n * t.n_rhs, at = <size_t>item * t.n_layer + layer
    cdef doubles systems = desk.work + 5 * layer * nn, vectors = desk.work + 5 * (t.n_layer * nn + layer * nr)
    cdef int here = first_layer(t.slab_stack, t.n_layer, item) + layer
    return Slab(
        modes_at(t.n, at, t.lam_re, t.lam_im, t.X, t.Y, t.thickness[here], t.decaying[at]), t.n_rhs,
        t.n_rhs // t.n_in, t.c + at * nr, t.zeta + at * nr, t.mu0, t.above[here], systems, systems + nn,
        systems + 2 * nn, systems + 3 * nn, systems + 4 * nn, vectors, vectors + nr, vectors + 2 * nr,
        vectors + 3 * nr, vectors + 4 * nr, <cplx*>(desk.work + 5 * t.n_layer * (nn + nr)) + layer * n,
        desk.pivots + 2 * layer * n)


cdef int boundary_one(const void* task, int item, Workspace desk) noexcept nogil:
    cdef const Arrays* t = <const Arrays*>task
    cdef int n = t.n, n_layer = t.n_layer, n_rhs = t.n_rhs, layer, info, row = t.base_row[item]
    cdef int first = first_layer(t.slab_stack, n_layer, item), last = first + n_layer - 1
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * n_rhs, i, at
    cdef bint topped = t.top_row != NULL and t.top_row[item] >= 0, joined = n_layer > 1 or row >= 0 or topped
    cdef double missing = 0.0
    cdef doubles scratch = desk.work + 5 * n_layer * (nn + nr) + 2 * n_layer * n
    cdef doubles below = scratch + 3 * nn + 8 * n, up = below + nn
    cdef doubles down = up + nr, falling = down + nr, spare = falling + nr      # spare: 2 n n_rhs + 2 n
    cdef doubles base_down = t.base_down + item * nr
    cdef ints pivots_below = desk.pivots + 2 * n_layer * n
    cdef Slab slab
    for layer in range(n_layer):
        slab = slab_at(t, item, layer, desk)
        slab.modes.decaying = (
            t.thickness[first + layer] > SEMI_INFINITE
            or slowest_rate(&slab.modes) * t.thickness[first + layer] > DECAYING)
        t.decaying[<size_t>item * n_layer + layer] = slab.modes.decaying
        info = slab_systems(&slab, scratch, spare)
        if info != 0:
            return info
    set_zero(nn + nr, below)                                                    # and up
    if row >= 0:
        copy(nn, t.base + row * nn, below)
        for i in range(nr if t.n_sent == 0 else 0):
            up[i] = t.base_source[row * nr + i] * exp(
                -(t.above[last] + t.thickness[last]) / t.mu0[i // (slab.per_beam * <size_t>n)])
    for layer in range(n_layer - 1 if joined else -1, -1, -1):
        slab = slab_at(t, item, layer, desk)
        if t.clear_layers[first + layer]:
            join_clear_layer(&slab, below, up)
            continue
        info = join_layer(&slab, row < 0 and layer == n_layer - 1, pivots_below, below, up, scratch, spare)
        if info != 0:
            return info
    set_zero(nr, down)
    if topped:
        if t.n_sent > 0:
            copy(nr, t.sent + item * nr, down)
        info = send_back(t, t.top + t.top_row[item] * <size_t>n * t.block, below, up, down, pivots_below, scratch,
                         spare, &missing)
        if info != 0:
            return info
        if t.n_sent > 0:
            copy(nr, up, t.rising + item * nr)
            multiply(n, n_rhs, n, 1.0, below, down, 1.0, t.rising + item * nr)
    for layer in range(n_layer):
        slab = slab_at(t, item, layer, desk)
        if joined:          # up = G (T down + emitted) + g at the layer's bottom
            copy(nr, slab.emitted, falling)
            multiply(n, n_rhs, n, 1.0, slab.T, down, 1.0, falling)
            copy(nr, slab.g, up)
            multiply(n, n_rhs, n, 1.0, slab.G, falling, 1.0, up)
            multiply(n, n_rhs, n, 1.0, slab.R, up, 1.0, falling)
        else:
            set_zero(nr, up)
        for i in range(nr):
            down[i] -= slab.top[i]
            up[i] -= slab.rising[i]
        at = <size_t>item * n_layer + layer
        t.residual[at] = max(missing, amplitudes(&slab, down, up, t.even + at * nr, t.odd + at * nr, scratch, spare))
        copy(nr, falling, down)
    if joined:
        copy(nr, down, base_down)
    else:
        set_zero(nr, base_down)
    return 0


cdef int send_back(const Arrays* t, given top, given below, given up, doubles down, ints pivots, doubles scratch,
                   doubles spare, double* missing) noexcept nogil:
    """down <- (1 - top below)^-1 (top up + down): what the interface above sends down beside what it sends back of the
    light that comes out; missing: the relative residual."""
    cdef int n = t.n, b = t.block, i, k, info
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * t.n_rhs
    cdef doubles kept = scratch + nn
    cdef double largest
    for k in range(n // b):
        i = k * b
        product(b"T", b"N", b, n, b, -1.0, top + <size_t>i * b, b, below + i, n, 0.0, scratch + i, n)
        product(b"T", b"N", b, t.n_rhs, b, 1.0, top + <size_t>i * b, b, up + i, n, 1.0, down + i, n)
    for i in range(n):
        scratch[<size_t>i * n + i] += 1.0
    copy(nn, scratch, kept)
    copy(nr, down, spare)
    info = factorise(n, scratch, n, pivots)
    if info != 0:
        return info
    solve(n, t.n_rhs, scratch, pivots, down, n)
    largest = largest_of(nr, spare)
    multiply(n, t.n_rhs, n, -1.0, kept, down, 1.0, spare)
    missing[0] = largest_of(nr, spare) / largest if largest > NO_LIGHT else 0.0
    return 0


# (1:45)
cdef void slab_matrix(const Slab* slab, bint is_odd, doubles matrix, doubles spare) noexcept nogil:
    """Even: X + Y lambda f (where all decays: X + Y k); odd: X f + Y; f = tanh(k h)/k."""
    cdef const Modes* a = &slab.modes
    cdef int j
    cdef size_t i
    cdef cplx* f = <cplx*>spare
    for j in range(a.n):
        if a.decaying:
            f[j] = rate_of(a, j)
        else:
            f[j] = slab.tangents[j] if is_odd else times(slab.tangents[j], lambda_of(a, j))
    scale_columns(a.n, a.n, a.lam_im, f, a.X if is_odd else a.Y, matrix)
    for i in range(<size_t>a.n * a.n):
        matrix[i] += a.Y[i] if is_odd else a.X[i]


cdef int slab_systems(Slab* slab, doubles scratch, doubles spare) noexcept nogil:
    """Factorises the two systems of a slab; the beam's field at its top and bottom."""
    cdef const Modes* a = &slab.modes
    cdef int n = a.n, info, beam, j, r, i
    cdef size_t nr = <size_t>n * slab.n_rhs, at
    cdef doubles y = scratch, z = y + n, xy = z + n
    cdef cplx* response = <cplx*>(scratch + 4 * n)
    cdef cplx k
    cdef double at_top, at_bottom
    for j in range(0 if a.decaying else n):
        slab.tangents[j] = half_tangent(rate_of(a, j), a.thickness)
    slab_matrix(slab, False, slab.even_lu, spare)
    info = factorise(n, slab.even_lu, n, slab.pivots)
    if info == 0 and not a.decaying:
        slab_matrix(slab, True, slab.odd_lu, spare)
        info = factorise(n, slab.odd_lu, n, slab.pivots + n)
    multiply(n, slab.n_rhs, n, 0.5, a.Y, slab.zeta, 0.0, slab.top)
    set_zero(2 * nr, slab.rising)                                               # and falling
    for r in range(slab.n_rhs):
        beam, at = r // slab.per_beam, <size_t>r * n
        at_top = exp(-slab.above / slab.mu0[beam])
        for i in range(n):
            slab.top[at + i] *= at_top
        if a.thickness > SEMI_INFINITE:
            continue
        at_bottom = exp(-a.thickness / slab.mu0[beam])
        if r % slab.per_beam == 0:
            for j in range(n):
                k = rate_of(a, j)
                response[j] = beam_response(k, 1.0 / slab.mu0[beam], a.thickness)
                response[n + j] = times(k, response[j])
        scale_coordinates(n, a.lam_im, response, slab.c + at, y)
        scale_coordinates(n, a.lam_im, response + n, slab.c + at, z)
        for j in range(n):
            z[j] += slab.zeta[at + j] * at_bottom
        multiply(n, 1, n, 0.5 * at_top, a.X, y, 0.0, xy)
        multiply(n, 1, n, 0.5 * at_top, a.Y, z, 0.0, xy + n)
        for j in range(n):
            slab.rising[at + j] = xy[j] - xy[n + j]
            slab.falling[at + j] = xy[j] + xy[n + j]
    return info


cdef int decaying_slab(const Slab* slab, ints pivots_inner, doubles scratch, doubles spare) noexcept nogil:
    """R and T from those of the semi-infinite layer, R0 = (X - Y k) P^-1, and S = P e^(-k thickness) P^-1, P = X + Y k:
    R = (R0 - S W) a and T = (S - R0 W) a with W = R0 S, a = (1 - W^2)^-1."""
    cdef const Modes* a = &slab.modes
    cdef int n = a.n, j, info = 0
    cdef size_t nn = <size_t>n * n, i
    cdef doubles R = slab.R, T = slab.T, W = scratch, M = scratch + nn
    cdef cplx* decay = <cplx*>spare
    copy(nn, a.X, R)
    times_inverse(n, slab.even_lu, slab.pivots, R)
    for i in range(nn):
        R[i] *= 2.0
    for j in range(n):
        R[<size_t>j * n + j] -= 1.0
    set_zero(nn, T)
    if a.thickness > SEMI_INFINITE:
        return 0
    slab_matrix(slab, False, M, spare)
    for j in range(n):
        decay[j] = c_exp(-a.thickness * rate_of(a, j))
    scale_columns(n, n, a.lam_im, decay, M, T)
    times_inverse(n, slab.even_lu, slab.pivots, T)                           # S
    multiply(n, n, n, 1.0, R, T, 0.0, W)
    copy(nn, R, M)                                                              # R0
    multiply(n, n, n, -1.0, T, W, 1.0, R)
    multiply(n, n, n, -1.0, M, W, 1.0, T)
    if slowest_rate(a) * a.thickness < 20.0:                                          # else W^2 < 1e-17
        one_minus_product(n, W, W, M)
        info = factorise(n, M, n, pivots_inner)
        times_inverse(n, M, pivots_inner, R)
        times_inverse(n, M, pivots_inner, T)
    return info


# (1:57)-(1:65)
cdef int join_layer(const Slab* slab, bint lowest, ints pivots_below, doubles below, doubles up, doubles scratch,
                    doubles spare) noexcept nogil:
    """R and T of the layer, then (star product) what lies below its top: `below` its reflection, `up` its emission.

    lowest: nothing lies below it, and both are zero.
    """
    cdef const Modes* a = &slab.modes
    cdef int n = a.n, n_rhs = slab.n_rhs, j, info
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * n_rhs, i
    cdef doubles R = slab.R, T = slab.T, G = slab.G, g = slab.g, inner = scratch
    if a.decaying:
        info = decaying_slab(slab, pivots_below, scratch, spare)
        if info != 0:
            return info
    else:
        # X (X + Y lambda f)^-1 = (1 + R + T)/2 and Y (X f + Y)^-1 = (1 - R + T)/2
        copy(nn, a.X, R)
        times_inverse(n, slab.even_lu, slab.pivots, R)
        copy(nn, a.Y, T)
        times_inverse(n, slab.odd_lu, slab.pivots + n, T)
        for i in range(nn):
            R[i], T[i] = R[i] - T[i], R[i] + T[i]
        for j in range(n):
            T[<size_t>j * n + j] -= 1.0
    # emitted with nothing falling in: the beam's own field leaving, less what would have to fall in to allow it
    for i in range(nr):
        slab.emitted[i] = slab.falling[i]
        spare[i] = -slab.top[i]
    multiply(n, n_rhs, n, -1.0, T, slab.top, 1.0, slab.emitted)
    multiply(n, n_rhs, n, -1.0, R, slab.rising, 1.0, slab.emitted)
    multiply(n, n_rhs, n, -1.0, R, slab.top, 1.0, spare)
    multiply(n, n_rhs, n, -1.0, T, slab.rising, 1.0, spare)
    if lowest:
        set_zero(nn, G)
        set_zero(nr, g)
        copy(nn, R, below)
        copy(nr, spare, up)
        return 0
    # between the layer and what lies below: (1 - below R)^-1
    one_minus_product(n, below, R, inner)
    info = factorise(n, inner, n, pivots_below)
    copy(nn, below, G)
    solve(n, n, inner, pivots_below, G, n)
    copy(nr, up, g)
    solve(n, n_rhs, inner, pivots_below, g, n)
    multiply(n, n, n, 1.0, G, T, 0.0, inner)
    copy(nn, R, below)
    multiply(n, n, n, 1.0, T, inner, 1.0, below)
    copy(nr, g, spare + nr)
    multiply(n, n_rhs, n, 1.0, G, slab.emitted, 1.0, spare + nr)
    copy(nr, spare, up)
    multiply(n, n_rhs, n, 1.0, T, spare + nr, 1.0, up)
    return info


cdef void join_clear_layer(const Slab* slab, doubles below, doubles up) noexcept nogil:
    """join_layer where nothing scatters: R = 0, T = e^(-thickness/mu), and the beam has no field of its own."""
    cdef int n = slab.modes.n, i, j
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * slab.n_rhs
    cdef double passed
    cdef doubles T = slab.T
    set_zero(2 * nn, slab.R)                                                    # and T
    for i in range(n):
        T[<size_t>i * n + i] = exp(-slab.modes.thickness * sqrt(slab.modes.lam_re[i]))
    copy(nn, below, slab.G)
    set_zero(nr, slab.emitted)
    copy(nr, up, slab.g)
    for j in range(n):
        passed = T[<size_t>j * n + j]
        for i in range(n):
            below[<size_t>j * n + i] *= passed * T[<size_t>i * n + i]
    for j in range(slab.n_rhs):
        for i in range(n):
            up[<size_t>j * n + i] *= T[<size_t>i * n + i]


# (1:49)-(1:56)
cdef double amplitudes(const Slab* slab, given top, given bottom, doubles even, doubles odd, doubles scratch,
                       doubles spare) noexcept nogil:
    """even = (X + Y lambda f)^-1 (top + bottom), odd = (X f + Y)^-1 (bottom - top); the relative residual."""
    cdef size_t nr = <size_t>slab.modes.n * slab.n_rhs, i
    cdef double worst, largest = 0.0
    if slab.modes.decaying:
        return decaying_amplitudes(slab, top, bottom, even, odd, scratch, spare)
    for i in range(nr):
        even[i] = top[i] + bottom[i]
        odd[i] = bottom[i] - top[i]
        largest = max(largest, max(fabs(even[i]), fabs(odd[i])))
    worst = solve_checked(slab, False, even, scratch, spare)
    worst = max(worst, solve_checked(slab, True, odd, scratch, spare))
    return worst / largest if largest > NO_LIGHT else 0.0


cdef double solve_checked(const Slab* slab, bint is_odd, doubles amplitude, doubles scratch,
                          doubles spare) noexcept nogil:
    """amplitude <- one of the slab's two systems^-1 amplitude; the largest residual."""
    cdef int n = slab.modes.n
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * slab.n_rhs
    copy(nr, amplitude, spare)
    if is_odd:
        solve(n, slab.n_rhs, slab.odd_lu, slab.pivots + n, amplitude, n)
    else:
        solve(n, slab.n_rhs, slab.even_lu, slab.pivots, amplitude, n)
    slab_matrix(slab, is_odd, scratch, scratch + nn)
    multiply(n, slab.n_rhs, n, -1.0, scratch, amplitude, 1.0, spare)
    return largest_of(nr, spare)


# (2:12)-(2:15)
cdef double decaying_amplitudes(const Slab* slab, given top, given bottom, doubles from_top, doubles from_bottom,
                              doubles scratch, doubles spare) noexcept nogil:
    """from_top = P^-1 (2 top - Q e^(-k thickness) from_bottom), from_bottom = P^-1 (2 bottom - Q e^(-k thickness)
    from_top) by turns, P, Q = X +- Y k: each gains the factor e^(-k thickness) squared. The relative residual at the
    top."""
    cdef const Modes* a = &slab.modes
    cdef int n = a.n, n_rhs = slab.n_rhs, sweep
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * n_rhs, i
    cdef double largest = 0.0
    for i in range(nr):
        largest = max(largest, 2.0 * fabs(top[i]))
        from_top[i] = 2.0 * top[i]
    solve(n, n_rhs, slab.even_lu, slab.pivots, from_top, n)
    set_zero(nr, from_bottom)
    if a.thickness < SEMI_INFINITE:
        for sweep in range(1 + <int>(19.0 / (slowest_rate(a) * a.thickness))):
            if sweep > 0:
                other_face(slab, top, from_bottom, from_top, scratch, spare)
                solve(n, n_rhs, slab.even_lu, slab.pivots, from_top, n)
            other_face(slab, bottom, from_top, from_bottom, scratch, spare)
            solve(n, n_rhs, slab.even_lu, slab.pivots, from_bottom, n)
        other_face(slab, top, from_bottom, spare + nr, scratch, spare)
    else:
        for i in range(nr):
            spare[nr + i] = 2.0 * top[i]
    slab_matrix(slab, False, scratch, scratch + nn)
    multiply(n, n_rhs, n, -1.0, scratch, from_top, 1.0, spare + nr)
    return largest_of(nr, spare + nr) / largest if largest > NO_LIGHT else 0.0


cdef void other_face(const Slab* slab, given entering, given amplitude, doubles out, doubles scratch,
                     doubles spare) noexcept nogil:
    """out = 2 entering - (X - Y k) e^(-k thickness) amplitude."""
    cdef const Modes* a = &slab.modes
    cdef int n = a.n, n_rhs = slab.n_rhs, j, r
    cdef size_t i
    cdef cplx* decay = <cplx*>scratch
    cdef cplx* slope = decay + n
    for j in range(n):
        decay[j] = c_exp(-a.thickness * rate_of(a, j))
        slope[j] = times(rate_of(a, j), decay[j])
    for i in range(<size_t>n * n_rhs):
        out[i] = 2.0 * entering[i]
    for r in range(n_rhs):
        scale_coordinates(n, a.lam_im, decay, amplitude + <size_t>r * n, spare + <size_t>r * n)
    multiply(n, n_rhs, n, -1.0, a.X, spare, 1.0, out)
    for r in range(n_rhs):
        scale_coordinates(n, a.lam_im, slope, amplitude + <size_t>r * n, spare + <size_t>r * n)
    multiply(n, n_rhs, n, 1.0, a.Y, spare, 1.0, out)
