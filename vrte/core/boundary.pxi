# Boundary conditions, (1:49)-(1:65), all layers of one order. Even and odd modes about the middle of a layer,
#   even: y = cosh(k t)/cosh(k h), z = -lambda y_odd;  odd: y = sinh(k t)/(k cosh(k h)), z = -y_even,
# split the 8N system of a slab into two 4N systems and stay regular at lambda = 0; layers join by the star
# product from the base up, as in (2:8). In a layer so thick that every mode fades (`fades`), "even" is e^(-k tau)
# and "odd" e^(-k (thickness - tau)), each referred to its own face as in (2:12)-(2:15): faint light keeps its digits.

cdef inline double slowest_rate(int n, given lam_re, given lam_im) noexcept nogil:
    cdef int j
    cdef double rate = INFINITY, smallest = INFINITY
    for j in range(n):
        if lam_im[j] == 0.0:
            smallest = min(smallest, lam_re[j])
        else:
            rate = min(rate, c_sqrt(make(lam_re[j], lam_im[j])).real)
    return min(rate, c_sqrt(make(smallest, 0.0)).real)


cdef inline bint fades(int n, given lam_re, given lam_im, double thickness) noexcept nogil:
    """Whether every mode loses e^4 from face to face; always in a layer without end."""
    return thickness > 1e300 or slowest_rate(n, lam_re, lam_im) * thickness > 4.0


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


def boundary_work(n, n_layer, n_rhs):
    """Doubles of `work` that one thread of `boundary` needs."""
    return 5 * n_layer * n * n + 5 * n_layer * n * n_rhs + 4 * n * n + 5 * n * n_rhs + 10 * n


cdef struct Boundary:
    int n, n_layer, n_in, n_rhs
    given lam_re, lam_im, X, Y, c, zeta
    given_ints clear
    given thickness, mu0, above
    given_ints base_row
    given base, base_source
    doubles even, odd, base_down
    ints fading
    doubles residual


def boundary(crew, *, const double[:, :, ::1] lam_re, const double[:, :, ::1] lam_im, const double[:, :, :, ::1] X,
             const double[:, :, :, ::1] Y, const double[:, :, :, ::1] c, const double[:, :, :, ::1] zeta,
             const int[::1] clear, const double[::1] thickness, const double[::1] mu0, const double[::1] above,
             const int[::1] base_row, const double[:, :, ::1] base, const double[:, :, ::1] base_source,
             double[:, :, :, ::1] even, double[:, :, :, ::1] odd, double[:, :, ::1] base_down, int[:, ::1] fading,
             double[:, ::1] residual, int[::1] info):
    """The amplitudes of the even and odd modes of every layer.

    clear (layer,): not 0 for layers known not to scatter; thickness (layer,), inf allowed last; above (layer,): optical
    depth of each layer's top; base_row (order,): the row of `base` (row, n, n) and `base_source` (row, n_rhs, n) of that
    order, or -1 for black: the base's operator and its reflection of the unattenuated beam, scaled and flipped. even,
    odd (order, layer, n_rhs, n); base_down (order, n_rhs, n): the scaled diffuse field that falls on the base; fading
    (order, layer): whether every mode of a layer fades, which is decided here, and says what its amplitudes are of;
    residual (order, layer): of the linear systems, relative.
    """
    cdef int n = <int>X.shape[3], n_layer = <int>X.shape[1], n_rhs = <int>c.shape[2]
    cdef Boundary task = Boundary(
        n, n_layer, <int>mu0.shape[0], n_rhs, &lam_re[0, 0, 0], &lam_im[0, 0, 0], &X[0, 0, 0, 0], &Y[0, 0, 0, 0],
        &c[0, 0, 0, 0], &zeta[0, 0, 0, 0], &clear[0], &thickness[0], &mu0[0], &above[0], &base_row[0], &base[0, 0, 0],
        &base_source[0, 0, 0], &even[0, 0, 0, 0], &odd[0, 0, 0, 0], &base_down[0, 0, 0], &fading[0, 0],
        &residual[0, 0])
    run_items(crew, boundary_one, &task, <int>X.shape[0], boundary_work(n, n_layer, n_rhs), (2 * n_layer + 1) * n, &info[0])


cdef int boundary_one(const void* task, int item, Desk desk) noexcept nogil:
    cdef const Boundary* t = <const Boundary*>task
    cdef int n = t.n, n_layer = t.n_layer, n_in = t.n_in, n_rhs = t.n_rhs, layer, info, row = t.base_row[item]
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * n_rhs, i, per_beam = <size_t>(n_rhs // n_in) * n
    cdef size_t first = <size_t>item * n_layer
    cdef given lam_re = t.lam_re + first * n, lam_im = t.lam_im + first * n
    cdef given X = t.X + first * nn, Y = t.Y + first * nn, c = t.c + first * nr, zeta = t.zeta + first * nr
    cdef given thickness = t.thickness, mu0 = t.mu0, above = t.above
    cdef given base = t.base + row * nn if row >= 0 else NULL
    cdef given base_source = t.base_source + row * nr if row >= 0 else NULL
    cdef doubles even = t.even + first * nr, odd = t.odd + first * nr, residual = t.residual + first
    cdef doubles base_down = t.base_down + item * nr
    cdef ints fading = t.fading + first
    cdef ints pivots = desk.pivots
    cdef bint joined = n_layer > 1 or base != NULL
    cdef doubles systems = desk.work                         # per layer: LU even, LU odd, R, T, G
    cdef doubles vectors = systems + 5 * n_layer * nn       # per layer: beam down at the top, up and down at the
    cdef doubles scratch = vectors + 5 * n_layer * nr       # bottom; emitted down; g: sent up from below
    cdef doubles below = scratch + 3 * nn + 8 * n
    cdef doubles up = below + nn
    cdef doubles down = up + nr
    cdef doubles falling = down + nr
    cdef doubles spare = falling + nr                       # 2 n n_rhs + 2 n
    cdef doubles system
    cdef doubles vector
    for layer in range(n_layer):
        fading[layer] = fades(n, lam_re + layer * n, lam_im + layer * n, thickness[layer])
        info = slab_systems(n, n_in, n_rhs, lam_re + layer * n, lam_im + layer * n, X + layer * nn, Y + layer * nn,
                            c + layer * nr, zeta + layer * nr, fading[layer], thickness[layer], mu0, above[layer],
                            systems + 5 * layer * nn, pivots + 2 * layer * n, vectors + 5 * layer * nr, scratch, spare)
        if info != 0:
            return info
    if joined:
        memset(below, 0, sizeof(double) * nn)
        memset(up, 0, sizeof(double) * nr)
        if base != NULL:
            memcpy(below, base, sizeof(double) * nn)
            for i in range(nr):
                up[i] = base_source[i] * exp(-(above[n_layer - 1] + thickness[n_layer - 1]) / mu0[i // per_beam])
        for layer in range(n_layer - 1, -1, -1):
            if t.clear[layer]:
                join_clear_layer(n, n_rhs, lam_re + layer * n, thickness[layer], systems + 5 * layer * nn,
                                 vectors + 5 * layer * nr, below, up)
                continue
            info = join_layer(n, n_rhs, lam_re + layer * n, lam_im + layer * n, X + layer * nn, Y + layer * nn,
                              fading[layer], thickness[layer], systems + 5 * layer * nn,
                              pivots + 2 * layer * n, pivots + 2 * n_layer * n, vectors + 5 * layer * nr, below, up,
                              scratch, spare)
            if info != 0:
                return info
    memset(down, 0, sizeof(double) * nr)
    for layer in range(n_layer):
        system = systems + 5 * layer * nn
        vector = vectors + 5 * layer * nr
        if joined:          # up = G (T down + emitted) + g at the layer's bottom
            memcpy(falling, vector + 3 * nr, sizeof(double) * nr)
            product(b"N", b"N", n, n_rhs, n, 1.0, system + 3 * nn, n, down, n, 1.0, falling, n)
            memcpy(up, vector + 4 * nr, sizeof(double) * nr)
            product(b"N", b"N", n, n_rhs, n, 1.0, system + 4 * nn, n, falling, n, 1.0, up, n)
            product(b"N", b"N", n, n_rhs, n, 1.0, system + 2 * nn, n, up, n, 1.0, falling, n)
        else:
            memset(up, 0, sizeof(double) * nr)
        for i in range(nr):
            down[i] -= vector[i]
            up[i] -= vector[nr + i]
        residual[layer] = amplitudes(n, n_rhs, lam_re + layer * n, lam_im + layer * n, X + layer * nn, Y + layer * nn,
                                     fading[layer], thickness[layer], system, pivots + 2 * layer * n, down, up, even + layer * nr,
                                     odd + layer * nr, scratch, spare)
        memcpy(down, falling, sizeof(double) * nr)
    if joined:
        memcpy(base_down, down, sizeof(double) * nr)
    else:
        memset(base_down, 0, sizeof(double) * nr)
    return 0


# (1:45)
cdef void slab_matrix(int n, bint is_odd, given lam_re, given lam_im, given X, given Y, bint fading,
                      double thickness, doubles matrix, doubles spare) noexcept nogil:
    """Even: X + Y lambda f (where all fades: X + Y k); odd: X f + Y; f = tanh(k h)/k."""
    cdef int j
    cdef size_t i
    cdef cplx* f = <cplx*>spare
    cdef cplx k
    for j in range(n):
        k = c_sqrt(make(lam_re[j], lam_im[j]))
        if fading:
            f[j] = k
        else:
            f[j] = half_tangent(k, thickness)
            if not is_odd:
                f[j] = times(f[j], make(lam_re[j], lam_im[j]))
    scale_columns(n, n, lam_im, f, X if is_odd else Y, matrix)
    for i in range(<size_t>n * n):
        matrix[i] += Y[i] if is_odd else X[i]


cdef int slab_systems(int n, int n_in, int n_rhs, given lam_re, given lam_im, given X,
                      given Y, given c, given zeta, bint fading, double thickness, given mu0,
                      double above, doubles systems, ints pivots, doubles vectors, doubles scratch,
                      doubles spare) noexcept nogil:
    """Factorises the two systems of a slab; the beam's field at its top and bottom."""
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * n_rhs, r, i
    cdef int info, per_beam = n_rhs // n_in, beam, j
    cdef doubles y = scratch
    cdef doubles z = scratch + n
    cdef doubles xy = scratch + 2 * n
    cdef cplx* response = <cplx*>(scratch + 4 * n)
    cdef cplx k
    cdef double at_top, at_bottom
    slab_matrix(n, False, lam_re, lam_im, X, Y, fading, thickness, systems, spare)
    info = factorise(n, systems, n, pivots)
    if info == 0 and not fading:
        slab_matrix(n, True, lam_re, lam_im, X, Y, False, thickness, systems + nn, spare)
        info = factorise(n, systems + nn, n, pivots + n)
    product(b"N", b"N", n, n_rhs, n, 0.5, Y, n, zeta, n, 0.0, vectors, n)
    memset(vectors + nr, 0, sizeof(double) * 2 * nr)
    for r in range(n_rhs):
        beam = <int>r // per_beam
        at_top = exp(-above / mu0[beam])
        for i in range(n):
            vectors[r * n + i] *= at_top
        if thickness > 1e300:
            continue
        at_bottom = exp(-thickness / mu0[beam])
        if r % per_beam == 0:
            for j in range(n):
                k = c_sqrt(make(lam_re[j], lam_im[j]))
                response[j] = beam_response(k, 1.0 / mu0[beam], thickness)
                response[n + j] = times(k, response[j])
        scale_coordinates(n, lam_im, response, c + r * n, y)
        scale_coordinates(n, lam_im, response + n, c + r * n, z)
        for j in range(n):
            z[j] += zeta[r * n + j] * at_bottom
        product(b"N", b"N", n, 1, n, 0.5 * at_top, X, n, y, n, 0.0, xy, n)
        product(b"N", b"N", n, 1, n, 0.5 * at_top, Y, n, z, n, 0.0, xy + n, n)
        for j in range(n):
            vectors[nr + r * n + j] = xy[j] - xy[n + j]
            vectors[2 * nr + r * n + j] = xy[j] + xy[n + j]
    return info


cdef int fading_slab(int n, given lam_re, given lam_im, given X, given Y, double thickness,
                     given systems, given_ints pivots, ints pivots_inner, doubles R, doubles T, doubles scratch,
                     doubles spare) noexcept nogil:
    """R and T from those of the endless layer, R0 = (X - Y k) P^-1, and S = P e^(-k thickness) P^-1, P = X + Y k:
    R = (R0 - S W) a and T = (S - R0 W) a with W = R0 S, a = (1 - W^2)^-1."""
    cdef size_t nn = <size_t>n * n, i
    cdef int j, info = 0
    cdef double rate = slowest_rate(n, lam_re, lam_im)
    cdef doubles W = scratch
    cdef doubles M = scratch + nn
    cdef cplx* fade = <cplx*>spare
    transpose(n, X, W)
    solve(b"T", n, n, systems, n, pivots, W, n)
    transpose(n, W, R)
    for i in range(nn):
        R[i] *= 2.0
    for i in range(<size_t>n):
        R[i * n + i] -= 1.0
    memset(T, 0, sizeof(double) * nn)
    if thickness > 1e300:
        return 0
    slab_matrix(n, False, lam_re, lam_im, X, Y, True, thickness, M, spare)
    for j in range(n):
        fade[j] = c_exp(-thickness * c_sqrt(make(lam_re[j], lam_im[j])))
    scale_columns(n, n, lam_im, fade, M, W)
    transpose(n, W, M)
    solve(b"T", n, n, systems, n, pivots, M, n)
    transpose(n, M, T)                                                      # S
    product(b"N", b"N", n, n, n, 1.0, R, n, T, n, 0.0, W, n)
    memcpy(M, R, sizeof(double) * nn)                                       # R0
    product(b"N", b"N", n, n, n, -1.0, T, n, W, n, 1.0, R, n)
    product(b"N", b"N", n, n, n, -1.0, M, n, W, n, 1.0, T, n)
    if rate * thickness < 20.0:                                             # else W^2 < 1e-17
        memset(M, 0, sizeof(double) * nn)
        for i in range(<size_t>n):
            M[i * n + i] = 1.0
        product(b"N", b"N", n, n, n, -1.0, W, n, W, n, 1.0, M, n)
        info = factorise(n, M, n, pivots_inner)
        times_inverse(n, M, pivots_inner, R, W)
        times_inverse(n, M, pivots_inner, T, W)
    return info


cdef inline void times_inverse(int n, given lu, given_ints pivots, doubles a, doubles spare) noexcept nogil:
    """a <- a M^-1, M given by its factors."""
    transpose(n, a, spare)
    solve(b"T", n, n, lu, n, pivots, spare, n)
    transpose(n, spare, a)


# (1:57)-(1:65)
cdef int join_layer(int n, int n_rhs, given lam_re, given lam_im, given X, given Y,
                    bint fading, double thickness, doubles systems,
                    given_ints pivots, ints pivots_below, doubles vectors, doubles below, doubles up, doubles scratch,
                    doubles spare) noexcept nogil:
    """R and T of the layer, then (star product) what lies below its top: `below` its reflection, `up` its emission."""
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * n_rhs, i, j
    cdef doubles R = systems + 2 * nn
    cdef doubles T = systems + 3 * nn
    cdef doubles G = systems + 4 * nn
    cdef doubles falling = vectors + 3 * nr
    cdef doubles g = vectors + 4 * nr
    cdef doubles old = scratch
    cdef int info
    if fading:
        info = fading_slab(n, lam_re, lam_im, X, Y, thickness, systems, pivots, pivots_below, R, T, scratch, spare)
        if info != 0:
            return info
    else:
        # X (X + Y lambda f)^-1 = (1 + R + T)/2 and Y (X f + Y)^-1 = (1 - R + T)/2, by transposed systems
        transpose(n, X, old)
        solve(b"T", n, n, systems, n, pivots, old, n)
        transpose(n, old, R)
        transpose(n, Y, old)
        solve(b"T", n, n, systems + nn, n, pivots + n, old, n)
        transpose(n, old, T)
        for i in range(nn):
            R[i], T[i] = R[i] - T[i], R[i] + T[i]
        for i in range(<size_t>n):
            T[i * n + i] -= 1.0
    # emitted with nothing falling in: the beam's own field leaving, less what would have to fall in to allow it
    for i in range(nr):
        falling[i] = vectors[2 * nr + i]
        spare[i] = -vectors[i]
    product(b"N", b"N", n, n_rhs, n, -1.0, T, n, vectors, n, 1.0, falling, n)
    product(b"N", b"N", n, n_rhs, n, -1.0, R, n, vectors + nr, n, 1.0, falling, n)
    product(b"N", b"N", n, n_rhs, n, -1.0, R, n, vectors, n, 1.0, spare, n)
    product(b"N", b"N", n, n_rhs, n, -1.0, T, n, vectors + nr, n, 1.0, spare, n)
    # between the layer and what lies below: (1 - Rb R)^-1
    memset(old, 0, sizeof(double) * nn)
    for i in range(<size_t>n):
        old[i * n + i] = 1.0
    product(b"N", b"N", n, n, n, -1.0, below, n, R, n, 1.0, old, n)
    info = factorise(n, old, n, pivots_below)
    memcpy(G, below, sizeof(double) * nn)
    solve(b"N", n, n, old, n, pivots_below, G, n)
    memcpy(g, up, sizeof(double) * nr)
    solve(b"N", n, n_rhs, old, n, pivots_below, g, n)
    product(b"N", b"N", n, n, n, 1.0, G, n, T, n, 0.0, old, n)
    memcpy(below, R, sizeof(double) * nn)
    product(b"N", b"N", n, n, n, 1.0, T, n, old, n, 1.0, below, n)
    memcpy(spare + nr, g, sizeof(double) * nr)
    product(b"N", b"N", n, n_rhs, n, 1.0, G, n, falling, n, 1.0, spare + nr, n)
    memcpy(up, spare, sizeof(double) * nr)
    product(b"N", b"N", n, n_rhs, n, 1.0, T, n, spare + nr, n, 1.0, up, n)
    return info


cdef void join_clear_layer(int n, int n_rhs, given lam_re, double thickness, doubles systems, doubles vectors,
                           doubles below, doubles up) noexcept nogil:
    """join_layer where nothing scatters: R = 0, T = e^(-thickness/mu), and the beam has no field of its own."""
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * n_rhs
    cdef int i, j
    cdef double passed
    cdef doubles T = systems + 3 * nn
    memset(systems + 2 * nn, 0, sizeof(double) * 2 * nn)
    for i in range(n):
        T[<size_t>i * n + i] = exp(-thickness * sqrt(lam_re[i]))
    memcpy(systems + 4 * nn, below, sizeof(double) * nn)
    memset(vectors + 3 * nr, 0, sizeof(double) * nr)
    memcpy(vectors + 4 * nr, up, sizeof(double) * nr)
    for j in range(n):
        passed = T[<size_t>j * n + j]
        for i in range(n):
            below[<size_t>j * n + i] *= passed * T[<size_t>i * n + i]
    for j in range(n_rhs):
        for i in range(n):
            up[<size_t>j * n + i] *= T[<size_t>i * n + i]


# (1:49)-(1:56)
cdef double amplitudes(int n, int n_rhs, given lam_re, given lam_im, given X, given Y,
                       bint fading, double thickness, given systems, given_ints pivots, given top, given bottom,
                       doubles even, doubles odd, doubles scratch, doubles spare) noexcept nogil:
    """even = (X + Y lambda f)^-1 (top + bottom), odd = (X f + Y)^-1 (bottom - top); the relative residual."""
    cdef size_t nr = <size_t>n * n_rhs, nn = <size_t>n * n, i
    cdef double worst, largest = 0.0
    if fading:
        return fading_amplitudes(n, n_rhs, lam_re, lam_im, X, Y, thickness, systems, pivots, top, bottom, even, odd,
                                 scratch, spare)
    for i in range(nr):
        even[i] = top[i] + bottom[i]
        odd[i] = bottom[i] - top[i]
        largest = max(largest, max(fabs(even[i]), fabs(odd[i])))
    memcpy(spare, even, sizeof(double) * nr)
    solve(b"N", n, n_rhs, systems, n, pivots, even, n)
    slab_matrix(n, False, lam_re, lam_im, X, Y, False, thickness, scratch, scratch + nn)
    product(b"N", b"N", n, n_rhs, n, -1.0, scratch, n, even, n, 1.0, spare, n)
    worst = largest_of(nr, spare)
    memcpy(spare, odd, sizeof(double) * nr)
    solve(b"N", n, n_rhs, systems + nn, n, pivots + n, odd, n)
    slab_matrix(n, True, lam_re, lam_im, X, Y, False, thickness, scratch, scratch + nn)
    product(b"N", b"N", n, n_rhs, n, -1.0, scratch, n, odd, n, 1.0, spare, n)
    worst = max(worst, largest_of(nr, spare))
    return worst / largest if largest > 1e-280 else 0.0      # below, denormal numbers have no digits to check


# (2:12)-(2:15)
cdef double fading_amplitudes(int n, int n_rhs, given lam_re, given lam_im, given X,
                              given Y, double thickness, given systems, given_ints pivots,
                              given top, given bottom, doubles from_top, doubles from_bottom,
                              doubles scratch, doubles spare) noexcept nogil:
    """from_top = P^-1 (2 top - Q e^(-k thickness) from_bottom), from_bottom = P^-1 (2 bottom - Q e^(-k thickness) from_top)
    by turns, P, Q = X +- Y k: each gains the factor e^(-k thickness) squared. The relative residual at the top."""
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * n_rhs, i
    cdef int sweep, sweeps = 1
    cdef double largest = 0.0
    for i in range(nr):
        largest = max(largest, 2.0 * fabs(top[i]))
        from_top[i] = 2.0 * top[i]
    solve(b"N", n, n_rhs, systems, n, pivots, from_top, n)
    memset(from_bottom, 0, sizeof(double) * nr)
    if thickness < 1e300:
        sweeps = 1 + <int>(19.0 / (slowest_rate(n, lam_re, lam_im) * thickness))
        for sweep in range(sweeps):
            if sweep > 0:
                other_face(n, n_rhs, lam_re, lam_im, X, Y, thickness, top, from_bottom, from_top, scratch, spare)
                solve(b"N", n, n_rhs, systems, n, pivots, from_top, n)
            other_face(n, n_rhs, lam_re, lam_im, X, Y, thickness, bottom, from_top, from_bottom, scratch, spare)
            solve(b"N", n, n_rhs, systems, n, pivots, from_bottom, n)
        other_face(n, n_rhs, lam_re, lam_im, X, Y, thickness, top, from_bottom, spare + nr, scratch, spare)
    else:
        for i in range(nr):
            spare[nr + i] = 2.0 * top[i]
    slab_matrix(n, False, lam_re, lam_im, X, Y, True, thickness, scratch, scratch + nn)
    product(b"N", b"N", n, n_rhs, n, -1.0, scratch, n, from_top, n, 1.0, spare + nr, n)
    return largest_of(nr, spare + nr) / largest if largest > 1e-280 else 0.0


cdef void other_face(int n, int n_rhs, given lam_re, given lam_im, given X, given Y,
                     double thickness, given entering, given amplitude, doubles out, doubles scratch,
                     doubles spare) noexcept nogil:
    """out = 2 entering - (X - Y k) e^(-k thickness) amplitude."""
    cdef size_t nr = <size_t>n * n_rhs, i
    cdef int j, r
    cdef cplx* fade = <cplx*>scratch
    cdef cplx* slope = fade + n
    cdef cplx k
    for j in range(n):
        k = c_sqrt(make(lam_re[j], lam_im[j]))
        fade[j] = c_exp(-thickness * k)
        slope[j] = times(k, fade[j])
    for i in range(nr):
        out[i] = 2.0 * entering[i]
    for r in range(n_rhs):
        scale_coordinates(n, lam_im, fade, amplitude + <size_t>r * n, spare + <size_t>r * n)
    product(b"N", b"N", n, n_rhs, n, -1.0, X, n, spare, n, 1.0, out, n)
    for r in range(n_rhs):
        scale_coordinates(n, lam_im, slope, amplitude + <size_t>r * n, spare + <size_t>r * n)
    product(b"N", b"N", n, n_rhs, n, 1.0, Y, n, spare, n, 1.0, out, n)
