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


cdef struct Slab:
    # one layer of an order; T is a diagonal (n,) where it does not scatter
    Modes modes
    int n_rhs, per_beam
    given c, zeta, mu0
    double above
    doubles even_lu, odd_lu      # the two systems, factorised
    doubles R, T, G              # G: from what falls at the bottom to what goes up there
    doubles top, rising          # the beam's field: down at the top; up at the bottom (n_rhs, n)
    doubles up, down             # the beam's field: up at the top, down at the bottom; then all that the slab sends out
    doubles g                    # what comes up at the bottom where nothing falls in
    cplx* tangents               # tanh(k thickness/2)/k, (n,), unless all decays
    ints pivots


cdef Slab slab_at(const Arrays* t, int layer) noexcept nogil:
    cdef size_t n = t.n, nn = n * n, nr = n * t.n_rhs
    cdef doubles systems = t.systems + 5 * layer * nn, vectors = t.vectors + 5 * layer * nr
    cdef int here = first_layer(t.slab_stack, t.n_layer, 0) + layer
    return Slab(
        modes_at(t.n, layer, t.lam_re, t.lam_im, t.X, t.Y, t.thickness[here], t.decaying[layer]), t.n_rhs,
        t.n_rhs // t.n_in, t.c + layer * nr, t.zeta + layer * nr, t.mu0, t.above[here], systems, systems + nn,
        systems + 2 * nn, systems + 3 * nn, systems + 4 * nn, vectors, vectors + nr, vectors + 2 * nr,
        vectors + 3 * nr, vectors + 4 * nr, <cplx*>t.tangents + layer * n, t.slab_pivots + 2 * layer * n)


# (1:57)-(1:65)
cdef int boundary_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    cdef int n = t.n, n_layer = t.n_layer, n_rhs = t.n_rhs, layer, info, row = t.base_row[0]
    cdef int first = first_layer(t.slab_stack, n_layer, 0), last = first + n_layer - 1
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * n_rhs, i
    cdef bint topped = t.top_row != NULL and t.top_row[0] >= 0, joined = n_layer > 1 or row >= 0 or topped
    cdef doubles scratch = t.scratch, up = t.up, down = t.down, falling = t.falling, spare = t.spare
    cdef Stack stack = stack_at(n, n_rhs, t.memory, t.pivots, False)
    cdef Element one
    cdef Slab slab
    set_zero(nr, up)
    if row >= 0:
        copy(nn, t.base + row * nn, stack.below)
        stack.dark = False
        for i in range(nr if t.n_sent == 0 else 0):
            up[i] = t.base_source[row * nr + i] * exp(
                -(t.above[last] + t.thickness[last]) / t.mu0[i // (t.n_rhs // t.n_in * <size_t>n)])
    for layer in range(n_layer - 1, -1, -1):
        slab = slab_at(t, layer)
        slab.modes.decaying = (
            t.thickness[first + layer] > SEMI_INFINITE
            or slowest_rate(&slab.modes) * t.thickness[first + layer] > DECAYING)
        t.decaying[layer] = slab.modes.decaying
        info = slab_systems(&slab, scratch, spare)
        if info == 0 and joined:
            if t.clear_layers[first + layer]:
                clear_layer(&slab)
            else:
                info = reflect_by_modes(&slab, stack.pivots, scratch, spare)
                emit(&slab, scratch)
            one = layer_element(&slab, t.clear_layers[first + layer])
            if info == 0:
                info = add(&stack, &one, slab.down, up, slab.up, up, slab.G if layer > 0 or topped else NULL, slab.g)
        if info != 0:
            return info
    set_zero(nr, down)
    if topped:
        one = Element(n, t.block, NULL, t.top + t.top_row[0] * <size_t>n * t.block, NULL, NULL)
        stack.checked = True
        info = add(&stack, &one, t.sent + item * nr if t.n_sent > 0 else NULL, up, up, up, NULL, t.g)
        if info != 0:
            return info
        share(&one, one.below, n_rhs, t.g, n, down, n)
        if t.n_sent > 0:
            copy(nr, t.g, t.rising + item * nr)
            for i in range(nr):
                down[i] += t.sent[item * nr + i]
    for layer in range(n_layer):
        slab = slab_at(t, layer)
        if joined:
            one = layer_element(&slab, t.clear_layers[first + layer])
            copy(nr, slab.down, falling)
            go_down(n, n_rhs, &one, down, slab.G if layer > 0 or topped else NULL, slab.g, up, falling, t.right)
        else:
            set_zero(nr, up)
        for i in range(nr):
            down[i] -= slab.top[i]
            up[i] -= slab.rising[i]
        t.residual[layer] = max(
            stack.missing, amplitudes(&slab, down, up, t.even + layer * nr, t.odd + layer * nr, scratch, spare))
        copy(nr, falling, down)
    if joined:
        copy(nr, down, t.base_down)
    else:
        set_zero(nr, t.base_down)
    return 0


cdef inline Element layer_element(const Slab* slab, bint clear) noexcept nogil:
    return Element(slab.modes.n, 1, NULL, NULL, slab.T, slab.T) if clear else slab_element(slab.modes.n, slab.R, slab.T)


cdef void clear_layer(const Slab* slab) noexcept nogil:
    """Where nothing scatters: T = e^(-thickness/mu), a diagonal, and the beam has no field of its own."""
    cdef int n = slab.modes.n, i
    for i in range(n):
        slab.T[i] = exp(-slab.modes.thickness * sqrt(slab.modes.lam_re[i]))
    set_zero(2 * <size_t>n * slab.n_rhs, slab.up)                               # and down


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


cdef inline bint is_thin(const Modes* a) noexcept nogil:
    """Whether what leaves a slab is told from what enters it: not where it is so thick that little gets through."""
    return a.thickness < 1.0


cdef int slab_systems(Slab* slab, doubles scratch, doubles spare) noexcept nogil:
    """Factorises the two systems of a slab; the beam's field at both faces. What leaves a thin slab is less what enters
    on the other face: as little as the slab is thick."""
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
    for r in range(slab.n_rhs):
        beam, at = r // slab.per_beam, <size_t>r * n
        at_top = exp(-slab.above / slab.mu0[beam])
        for j in range(n if r % slab.per_beam == 0 else 0):
            k = rate_of(a, j)
            response[j] = make(0.0, 0.0)
            if a.thickness < SEMI_INFINITE:
                response[j] = beam_response(k, 1.0 / slab.mu0[beam], a.thickness)
            response[n + j] = times(k, response[j])
        scale_coordinates(n, a.lam_im, response, slab.c + at, y)
        scale_coordinates(n, a.lam_im, response + n, slab.c + at, z)
        at_bottom = -a.thickness / slab.mu0[beam]
        at_bottom = expm1(at_bottom) if is_thin(a) else exp(at_bottom)
        for j in range(n):
            z[j] += slab.zeta[at + j] * at_bottom
        multiply(n, 1, n, 0.5 * at_top, a.X, y, 0.0, xy)
        multiply(n, 1, n, 0.5 * at_top, a.Y, z, 0.0, xy + n)
        for i in range(n):
            slab.top[at + i] *= at_top
            slab.rising[at + i], slab.down[at + i] = xy[i] - xy[n + i], xy[i] + xy[n + i]
            slab.up[at + i] = -slab.rising[at + i] if is_thin(a) else -slab.top[at + i]
            if is_thin(a):
                slab.rising[at + i] -= slab.top[at + i]
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


cdef void emit(const Slab* slab, given lost) noexcept nogil:
    """What a slab sends out of beams where nothing falls in, up at its top and down at its bottom: the beams' own field
    at both faces, less what would have to fall in to allow it; lost: 1 - T."""
    cdef int n = slab.modes.n, r = slab.n_rhs
    cdef double sign = 1.0 if is_thin(&slab.modes) else -1.0
    cdef given through = lost if is_thin(&slab.modes) else slab.T
    multiply(n, r, n, -1.0, slab.R, slab.top, 1.0, slab.up)
    multiply(n, r, n, sign, through, slab.rising, 1.0, slab.up)
    multiply(n, r, n, sign, through, slab.top, 1.0, slab.down)
    multiply(n, r, n, -1.0, slab.R, slab.rising, 1.0, slab.down)


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
