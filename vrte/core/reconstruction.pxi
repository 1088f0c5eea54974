# Reconstruction by source-function integration, (1:36)-(1:38), as products of matrices. The beam's direct
# source is left out: single scattering has a closed form over all orders (single_scattering.pxi).

cdef inline void fading_integrals(cplx k, double mu, double thickness, double depth, cplx* from_top,
                                  cplx* from_bottom) noexcept nogil:
    """int e^(-k x) and int e^(-k (thickness - x)) times e^(-(x - depth)/mu) dx/mu over x from depth to the bottom."""
    cdef double left = thickness - depth
    from_bottom[0] = make(0.0, 0.0)
    if thickness > 1e300:
        from_top[0] = over(c_exp(-depth * k), 1.0 + mu * k)
    else:
        from_top[0] = over(times(c_exp(-depth * k), -c_expm1(-left * (k + 1.0 / mu))), 1.0 + mu * k)
        from_bottom[0] = (left / mu) * exp_difference(-left * k, make(-left / mu, 0.0))


cdef void hyperbolic_integrals(cplx k, double mu, double thickness, double depth, cplx* cosine, cplx* sine) noexcept nogil:
    """int cosh(k t)/cosh(k h) and int sinh(k t)/(k cosh(k h)) times e^(-(x - depth)/mu) dx/mu over x from depth to
    the slab's bottom, t = x - h."""
    cdef double left = thickness - depth, h = 0.5 * thickness
    cdef cplx from_top, from_bottom, whole, u, v, plus, minus
    fading_integrals(k, mu, thickness, depth, &from_top, &from_bottom)
    whole = 1.0 + c_exp(-thickness * k)
    cosine[0] = over(from_top + from_bottom, whole)
    if size_of(k) * thickness > 1.0:
        sine[0] = over(from_bottom - from_top, times(k, whole))
        return
    # near k = 0: e^(k(depth - h)) times int e^(k(x - depth)) ..., differenced between k and -k
    plus, minus = left * k - left / mu, -left * k - left / mu
    u = (2.0 * (depth - h)) * exp_difference((depth - h) * k, (h - depth) * k)
    v = (left / mu) * exp_difference(make(0.0, 0.0), plus)
    sine[0] = 0.5 * times(u, v)
    v = (2.0 * left * left / mu) * exp_difference_2(make(0.0, 0.0), plus, minus)
    sine[0] = sine[0] + 0.5 * times(c_exp((h - depth) * k), v)
    whole = 0.5 * (c_exp(h * k) + c_exp(-h * k))
    sine[0] = over(sine[0], whole)


cdef inline double beam_up(double mu, double mu0, double thickness, double depth) noexcept nogil:
    """int e^(-x/mu0) e^(-(x - depth)/mu) dx/mu from depth to the slab's bottom."""
    cdef double rate = 1.0 / mu + 1.0 / mu0
    return exp(-depth / mu0) * -expm1(-(thickness - depth) * rate) / (mu * rate)


cdef inline double beam_down(double mu, double mu0, double depth) noexcept nogil:
    """int e^(-x/mu0) e^(-(depth - x)/mu) dx/mu from the slab's top to depth."""
    return (depth / mu) * exp_difference(make(-depth / mu0, 0.0), make(-depth / mu, 0.0)).real


def reconstruction_work(n, rows, n_rhs, n_layer):
    """Doubles of `work` that one thread of `reconstruct` needs."""
    return 2 * rows * n * n_layer + 5 * rows * n_rhs + 3 * rows * n + n * n_rhs + 2 * n + rows


cdef struct Reconstruction:
    int n, stokes, n_out, n_up, n_layer, n_in, n_rhs, n_level
    given G_E, G_F, lam_re, lam_im, X, Y, c, zeta, even, odd, base_down
    given_ints fading, base_row
    given base_out, thickness, above, mu0, mu_out, level
    given_ints level_layer
    doubles out


def reconstruct(crew, *, const double[:, :, :, ::1] G_E, const double[:, :, :, ::1] G_F,
                const double[:, :, ::1] lam_re, const double[:, :, ::1] lam_im, const double[:, :, :, ::1] X,
                const double[:, :, :, ::1] Y, const double[:, :, :, ::1] c, const double[:, :, :, ::1] zeta,
                const double[:, :, :, ::1] even, const double[:, :, :, ::1] odd, const double[:, :, ::1] base_down,
                const int[:, ::1] fading, const int[::1] base_row, const double[:, :, ::1] base_out, const double[::1] thickness,
                const double[::1] above, const double[::1] mu0, const double[::1] mu_out, int n_up,
                const double[::1] level, const int[::1] level_layer, double[:, :, :, ::1] out):
    """The field at any depth and direction, one Fourier order after another, without singly scattered light.

    mu_out (n_out,): positive cosines, the first n_up of them for light going up, the others down; level (n_tau,):
    depth below the top of layer level_layer; base_out (row, n, S n_out): what the base sends up from the scaled
    field on its nodes. out (order, n_tau, n_rhs, S n_out): radiance times 2 pi for a unit beam; upward rows are
    flipped by D; fading: of `boundary`.
    """
    cdef int n = <int>X.shape[3], n_layer = <int>X.shape[1], n_rhs = <int>c.shape[2], n_out = <int>mu_out.shape[0]
    cdef Reconstruction task = Reconstruction(
        n, <int>out.shape[3] // max(1, n_out), n_out, n_up, n_layer, <int>mu0.shape[0], n_rhs, <int>level.shape[0],
        &G_E[0, 0, 0, 0], &G_F[0, 0, 0, 0], &lam_re[0, 0, 0], &lam_im[0, 0, 0], &X[0, 0, 0, 0], &Y[0, 0, 0, 0],
        &c[0, 0, 0, 0], &zeta[0, 0, 0, 0], &even[0, 0, 0, 0], &odd[0, 0, 0, 0], &base_down[0, 0, 0], &fading[0, 0],
        &base_row[0], &base_out[0, 0, 0], &thickness[0], &above[0], &mu0[0], &mu_out[0], &level[0], &level_layer[0], &out[0, 0, 0, 0])
    run_items(crew, reconstruct_one, &task, <int>X.shape[0], reconstruction_work(n, <int>out.shape[3], n_rhs, n_layer), 0,
              NULL)


cdef int reconstruct_one(const void* task, int item, Desk desk) noexcept nogil:
    cdef const Reconstruction* a = <const Reconstruction*>task
    cdef int n = a.n, stokes = a.stokes, n_out = a.n_out, n_up = a.n_up, n_layer = a.n_layer, n_in = a.n_in
    cdef int n_rhs = a.n_rhs, n_level = a.n_level, row = a.base_row[item]
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * n_rhs, rows = stokes * n_out, size = rows * n_rhs, i, r
    cdef size_t first = <size_t>item * n_layer
    cdef given G_E = a.G_E + first * n * rows, G_F = a.G_F + first * n * rows
    cdef given lam_re = a.lam_re + first * n, lam_im = a.lam_im + first * n
    cdef given X = a.X + first * nn, Y = a.Y + first * nn, c = a.c + first * nr, zeta = a.zeta + first * nr
    cdef given even = a.even + first * nr, odd = a.odd + first * nr, base_down = a.base_down + item * nr
    cdef given thickness = a.thickness, above = a.above, mu0 = a.mu0, mu_out = a.mu_out, level = a.level
    cdef given base_out = a.base_out + row * n * rows if row >= 0 else NULL
    cdef given_ints level_layer = a.level_layer, fading = a.fading + first
    cdef doubles out = a.out + item * n_level * size
    cdef doubles g_e = desk.work                        # G_E X and G_F Y, per layer
    cdef doubles g_f = g_e + rows * n * n_layer
    cdef doubles running = g_f + rows * n * n_layer     # the field that enters the present layer
    cdef doubles part = running + size
    cdef doubles spare = part + size
    cdef int layer, t
    for layer in range(n_layer):
        product(b"N", b"N", <int>rows, n, n, 1.0, G_E + layer * rows * n, <int>rows, X + layer * nn, n, 0.0,
                g_e + layer * rows * n, <int>rows)
        product(b"N", b"N", <int>rows, n, n, 1.0, G_F + layer * rows * n, <int>rows, Y + layer * nn, n, 0.0,
                g_f + layer * rows * n, <int>rows)
    # light going up: from the base through the layers
    memset(running, 0, sizeof(double) * size)
    if base_out != NULL and n_up > 0:
        product(b"N", b"N", stokes * n_up, n_rhs, n, 1.0, base_out, <int>rows, base_down, n, 0.0, running, <int>rows)
    for layer in range(n_layer - 1, -1, -1):
        for t in range(n_level + 1):
            if t < n_level and level_layer[t] != layer:
                continue
            if t == n_level and layer == 0:
                continue
            through_layer(True, fading[layer], n, stokes, <int>rows, n_up, n_in, n_rhs, g_e + layer * rows * n, g_f + layer * rows * n,
                          lam_re + layer * n, lam_im + layer * n, c + layer * nr, zeta + layer * nr, even + layer * nr,
                          odd + layer * nr, thickness[layer], above[layer], mu0, mu_out, level[t] if t < n_level else 0.0,
                          running, out + t * size if t < n_level else part, spare)
        if layer > 0:
            memcpy(running, part, sizeof(double) * size)
    # light going down: from the top through the layers
    memset(running, 0, sizeof(double) * size)
    for layer in range(n_layer):
        for t in range(n_level + 1):
            if t < n_level and level_layer[t] != layer:
                continue
            if t == n_level and layer == n_layer - 1:
                continue
            through_layer(False, fading[layer], n, stokes, <int>rows, n_out - n_up, n_in, n_rhs, g_e + layer * rows * n + stokes * n_up,
                          g_f + layer * rows * n + stokes * n_up, lam_re + layer * n, lam_im + layer * n, c + layer * nr,
                          zeta + layer * nr, even + layer * nr, odd + layer * nr, thickness[layer], above[layer], mu0,
                          mu_out + n_up, level[t] if t < n_level else thickness[layer], running + stokes * n_up,
                          (out + t * size if t < n_level else part) + stokes * n_up, spare)
        if layer < n_layer - 1:
            memcpy(running, part, sizeof(double) * size)
    return 0


# (1:36)-(1:38)
cdef void through_layer(bint upward, bint fading, int n, int stokes, int rows, int n_mu, int n_in, int n_rhs, given g_e, given g_f,
                        given lam_re, given lam_im, given c, given zeta,
                        given even, given odd, double thickness, double above, given mu0,
                        given mu_out, double depth, given entering, doubles out, doubles work) noexcept nogil:
    """out = what arrives at `depth`: entering light attenuated, plus the layer's source between its far face and depth.

    g_e, g_f, entering and out have S n_mu used rows of `rows`.
    """
    cdef size_t used = stokes * n_mu, r, i, column
    cdef int j, mu, beam, per_beam = n_rhs // n_in
    cdef double left = thickness - depth if upward else depth     # optical path over mu
    cdef double sign = -1.0 if upward else 1.0, fade, light, far
    cdef doubles even_gain = work                     # (n, used): amplitude of the even modes -> radiance
    cdef doubles odd_gain = even_gain + used * n
    cdef doubles beam_gain = odd_gain + used * n      # (g_e -+ k g_f)/(1 + k mu) or /(k mu - 1)
    cdef doubles fed = beam_gain + used * n           # coordinates c D(.) of all right-hand sides
    cdef doubles first = fed + <size_t>n * n_rhs      # beam_gain c, beam_gain c D, g_f zeta
    cdef doubles second = first + used * n_rhs
    cdef doubles third = second + used * n_rhs
    cdef cplx* response = <cplx*>(third + used * n_rhs)
    cdef doubles faded = <doubles>(response + n)      # (n_mu,): e^(-left/mu)
    if n_mu == 0:
        return
    if left == 0.0:
        for r in range(n_rhs):
            memcpy(out + r * rows, entering + r * rows, sizeof(double) * used)
        return
    far = depth if upward else thickness - left        # by symmetry about the middle, down at depth is up at T - depth
    for mu in range(n_mu):
        faded[mu] = exp(-left / mu_out[mu])
    j = 0
    while j < n:
        if lam_im[j] == 0.0:
            real_gains(upward, fading, stokes, rows, n_mu, g_e + <size_t>j * rows, g_f + <size_t>j * rows, lam_re[j], thickness,
                       left, far, mu_out, faded, even_gain + j * used, odd_gain + j * used, beam_gain + j * used)
            j = j + 1
        else:
            pair_gains(upward, fading, stokes, rows, n_mu, g_e + <size_t>j * rows, g_f + <size_t>j * rows, make(lam_re[j], lam_im[j]),
                       thickness, left, far, mu_out, even_gain + j * used, odd_gain + j * used, beam_gain + j * used)
            j = j + 2
    for r in range(n_rhs):
        for mu in range(n_mu):
            for i in range(stokes):
                out[r * rows + stokes * mu + i] = faded[mu] * entering[r * rows + stokes * mu + i]
    product(b"N", b"N", <int>used, n_rhs, n, 1.0, even_gain, <int>used, even, n, 1.0, out, rows)
    product(b"N", b"N", <int>used, n_rhs, n, 1.0, odd_gain, <int>used, odd, n, 1.0, out, rows)
    product(b"N", b"N", <int>used, n_rhs, n, 0.5, beam_gain, <int>used, c, n, 0.0, first, <int>used)
    product(b"N", b"N", <int>used, n_rhs, n, 0.5 * sign, g_f, rows, zeta, n, 0.0, third, <int>used)
    feed(n, n_in, n_rhs, lam_re, lam_im, c, mu0, depth, response, fed)
    product(b"N", b"N", <int>used, n_rhs, n, 0.5, beam_gain, <int>used, fed, n, 0.0, second, <int>used)
    for r in range(n_rhs):
        beam = <int>r // per_beam
        fade = exp(-above / mu0[beam])
        for mu in range(n_mu):
            light = beam_up(mu_out[mu], mu0[beam], thickness, depth) if upward else beam_down(mu_out[mu], mu0[beam], depth)
            for i in range(stokes):
                column = r * used + stokes * mu + i
                out[r * rows + stokes * mu + i] += fade * (
                    light * (mu_out[mu] * first[column] + third[column]) + (second[column] if upward else -second[column]))
    if upward and thickness < 1e300:
        feed(n, n_in, n_rhs, lam_re, lam_im, c, mu0, thickness, response, fed)
        product(b"N", b"N", <int>used, n_rhs, n, 0.5, beam_gain, <int>used, fed, n, 0.0, second, <int>used)
        for r in range(n_rhs):
            for mu in range(n_mu):
                fade = exp(-above / mu0[<int>r // per_beam] - left / mu_out[mu])
                for i in range(stokes):
                    out[r * rows + stokes * mu + i] -= fade * second[r * used + stokes * mu + i]
    if not upward:
        resonances(n, stokes, rows, n_mu, n_in, n_rhs, g_e, g_f, lam_re, lam_im, c, mu0, mu_out, depth, above, out)


cdef void real_gains(bint upward, bint fading, int stokes, int rows, int n_mu, given g_e, given g_f, double lam,
                     double thickness, double left, double far, given mu_out, given faded, doubles even_gain,
                     doubles odd_gain, doubles beam_gain) noexcept nogil:
    """Columns of the gains of `through_layer` for one real mode. left: the path; far: depth of its end below the face that
    e^(-k x) fades from; faded: e^(-left/mu). The integrals are those of `fading_integrals`, `hyperbolic_integrals`."""
    cdef double k = sqrt(lam), mode_faded = exp(-left * k), at_far = exp(-far * k), sign = -1.0 if upward else 1.0
    cdef double whole = 1.0 if fading else 1.0 + exp(-thickness * k), mu, gap, from_top, from_bottom, cosine, sine, bottom
    cdef double a, b
    cdef cplx c_cosine, c_sine
    cdef int i, m
    for m in range(n_mu):
        mu = mu_out[m]
        if left > 1e300:
            from_top, from_bottom = at_far / (1.0 + mu * k), 0.0
        else:
            gap = left * (k + 1.0 / mu)
            from_top = at_far * (1.0 - mode_faded * faded[m] if gap > 1.0 else -expm1(-gap)) / (1.0 + mu * k)
            gap = left / mu - left * k
            if fabs(gap) > 1.0:
                from_bottom = (left / mu) * ((mode_faded - faded[m]) / gap)
            elif gap == 0.0:
                from_bottom = (left / mu) * mode_faded
            else:
                from_bottom = (left / mu) * (max(mode_faded, faded[m]) * (-expm1(-fabs(gap)) / fabs(gap)))
        if fading and not upward and thickness > 1e300:
            from_top = 0.0
        if fading:      # y = e^(-k x), z = k y; y = e^(-k (thickness - x)), z = -k y; down, one is the other's image
            cosine, sine = (from_top, from_bottom) if upward else (from_bottom, from_top)
        elif k * thickness > 1.0:
            cosine, sine = (from_top + from_bottom) / whole, (from_bottom - from_top) / (k * whole)
        else:
            hyperbolic_integrals(make(k, 0.0), mu, thickness, far, &c_cosine, &c_sine)
            cosine, sine = c_cosine.real, c_sine.real
        bottom = 1.0 + mu * k if upward else mu * k - 1.0
        bottom = 0.0 if fabs(bottom) < 0.02 else 1.0 / bottom
        for i in range(stokes * m, stokes * (m + 1)):
            if fading:
                a, b = cosine * (g_e[i] + sign * k * g_f[i]), sine * (g_e[i] - sign * k * g_f[i])
            else:
                a, b = cosine * g_e[i] + lam * sine * g_f[i], sine * g_e[i] + cosine * g_f[i]
                if not upward:
                    b = -b
            even_gain[i], odd_gain[i], beam_gain[i] = 0.5 * a, 0.5 * b, bottom * (g_e[i] + sign * k * g_f[i])


cdef void pair_gains(bint upward, bint fading, int stokes, int rows, int n_mu, given g_e, given g_f, cplx lam,
                     double thickness, double left, double far, given mu_out, doubles even_gain, doubles odd_gain,
                     doubles beam_gain) noexcept nogil:
    """As `real_gains`, the two columns of a complex pair as the real and imaginary parts of one."""
    cdef size_t used = <size_t>stokes * n_mu
    cdef double sign = -1.0 if upward else 1.0
    cdef cplx k = c_sqrt(lam), cosine, sine, bottom, ge, gf, a, b
    cdef int i, m
    for m in range(n_mu):
        if not fading:
            hyperbolic_integrals(k, mu_out[m], thickness, far, &cosine, &sine)
        elif upward:
            fading_integrals(k, mu_out[m], thickness, far, &cosine, &sine)
        else:
            sine = make(0.0, 0.0)
            if thickness < 1e300:
                sine = over(times(c_exp(-far * k), -c_expm1(-left * (k + 1.0 / mu_out[m]))), 1.0 + mu_out[m] * k)
            cosine = (left / mu_out[m]) * exp_difference(-left * k, make(-left / mu_out[m], 0.0))
        bottom = 1.0 + mu_out[m] * k if upward else mu_out[m] * k - 1.0
        bottom = make(0.0, 0.0) if size_of(bottom) < 0.02 else over(make(1.0, 0.0), bottom)
        for i in range(stokes * m, stokes * (m + 1)):
            ge, gf = make(g_e[i], g_e[i + rows]), make(g_f[i], g_f[i + rows])
            if fading:
                a = times(cosine, ge + sign * times(k, gf))
                b = times(sine, ge - sign * times(k, gf))
            else:
                a = times(cosine, ge) + times(times(lam, sine), gf)
                b = times(sine, ge) + times(cosine, gf)
                if not upward:
                    b = -b
            even_gain[i], even_gain[i + used] = 0.5 * a.real, 0.5 * a.imag
            odd_gain[i], odd_gain[i + used] = 0.5 * b.real, 0.5 * b.imag
            a = times(bottom, ge + sign * times(k, gf))
            beam_gain[i], beam_gain[i + used] = a.real, a.imag


cdef void feed(int n, int n_in, int n_rhs, given lam_re, given lam_im, given c, given mu0,
               double depth, cplx* response, doubles fed) noexcept nogil:
    """fed = c D(depth), all right-hand sides."""
    cdef int r, j, per_beam = n_rhs // n_in
    for r in range(n_rhs):
        if r % per_beam == 0:
            for j in range(n):
                response[j] = beam_response(c_sqrt(make(lam_re[j], lam_im[j])), 1.0 / mu0[r // per_beam], depth)
        scale_coordinates(n, lam_im, response, c + <size_t>r * n, fed + <size_t>r * n)


cdef void resonances(int n, int stokes, int rows, int n_mu, int n_in, int n_rhs, given g_e, given g_f,
                     given lam_re, given lam_im, given c, given mu0, given mu_out,
                     double depth, double above, doubles out) noexcept nogil:
    """Adds the beam's part of the modes with k mu close to 1, left out above: int D e^(-(depth - x)/mu) dx/mu is
    depth^2/mu exp[-depth/mu, -k depth, -depth/mu0]."""
    cdef int mu, j, width, r, i, per_beam = n_rhs // n_in
    cdef cplx k, value, gain
    cdef given y
    cdef size_t row
    j = 0
    while j < n:
        width = 1 if lam_im[j] == 0.0 else 2
        k = c_sqrt(make(lam_re[j], lam_im[j]))
        for mu in range(n_mu):
            if fabs(mu_out[mu] * k.real - 1.0) < 0.02 and size_of(mu_out[mu] * k - 1.0) < 0.02:
                for r in range(n_rhs):
                    if r % per_beam == 0:
                        value = (0.5 * depth * depth / mu_out[mu] * exp(-above / mu0[r // per_beam])) * exp_difference_2(
                            make(-depth / mu_out[mu], 0.0), -depth * k, make(-depth / mu0[r // per_beam], 0.0))
                    y = c + <size_t>r * n + j
                    for i in range(stokes):
                        row = <size_t>j * rows + stokes * mu + i
                        gain = times(value, make(g_e[row], g_e[row + rows] if width == 2 else 0.0)
                                     + times(k, make(g_f[row], g_f[row + rows] if width == 2 else 0.0)))
                        out[<size_t>r * rows + stokes * mu + i] += gain.real * y[0] + (gain.imag * y[1] if width == 2 else 0.0)
        j = j + width


def mode_coordinates(*, const double[::1] lam_re, const double[::1] lam_im, const double[:, ::1] even,
                     const double[:, ::1] odd, const double[:, ::1] c, const double[:, ::1] zeta,
                     const double[::1] mu0, bint fading, double thickness, double above, double depth):
    """y and z of the modes of one order and layer (n,) at a depth below its top: (2, n_rhs, n); see `boundary`.

    even, odd, c, zeta (n_rhs, n); mu0 (n_in,); fading: of `boundary`; above: optical depth of the layer's top.
    """
    cdef int n = <int>lam_re.shape[0], n_rhs = <int>even.shape[0], per_beam = n_rhs // <int>mu0.shape[0], r, j, f
    cdef double[:, :, ::1] out = np.zeros((2, n_rhs, n))
    cdef double complex[:, ::1] profile = np.empty((6, n), complex)    # of even, odd, c: y and z
    cdef double[::1] part = np.empty(n)
    cdef double light, faded
    cdef cplx k, response
    profiles(n, &lam_re[0], &lam_im[0], fading, thickness, depth, &profile[0, 0])
    for r in range(n_rhs):
        light = exp(-above / mu0[r // per_beam])
        faded = light * exp(-depth / mu0[r // per_beam])
        for j in range(n):
            k = c_sqrt(make(lam_re[j], lam_im[j]))
            response = light * beam_response(k, 1.0 / mu0[r // per_beam], depth) if depth > 0.0 else make(0.0, 0.0)
            profile[4, j], profile[5, j] = response, times(k, response)
            out[1, r, j] = faded * zeta[r, j]
        for f in range(6):
            scale_coordinates(n, &lam_im[0], &profile[f, 0], &even[r, 0] if f < 2 else &odd[r, 0] if f < 4 else &c[r, 0], &part[0])
            for j in range(n):
                out[f % 2, r, j] += part[j]
    return np.asarray(out)


# (1:24)-(1:25)
cdef void profiles(int n, given lam_re, given lam_im, bint fading, double thickness, double depth, cplx* out) noexcept nogil:
    """The even and the odd mode's y and z at a depth, (n,) each: y_even, z_even, y_odd, z_odd; see `boundary`."""
    cdef int j
    cdef cplx k, lam, from_top, from_bottom, whole, cosine, sine
    for j in range(n):
        lam = make(lam_re[j], lam_im[j])
        k = c_sqrt(lam)
        from_top = c_exp(-depth * k)
        from_bottom = make(0.0, 0.0) if thickness > 1e300 else c_exp((depth - thickness) * k)
        if fading:
            out[j], out[n + j] = from_top, times(k, from_top)
            out[2 * n + j], out[3 * n + j] = from_bottom, -times(k, from_bottom)
            continue
        whole = 1.0 + c_exp(-thickness * k)
        cosine = over(from_top + from_bottom, whole)
        # (e^(k t) - e^(-k t))/(2 k), t = depth - thickness/2, then over cosh(k h) = e^(k h) whole/2
        sine = (2.0 * depth - thickness) * over(exp_difference((depth - thickness) * k, -depth * k), whole)
        out[j], out[n + j] = cosine, -times(lam, sine)
        out[2 * n + j], out[3 * n + j] = sine, -cosine
