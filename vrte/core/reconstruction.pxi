# Reconstruction by source-function integration, (1:36)-(1:38), as products of matrices. The beam's direct
# source is left out: single scattering has a closed form over all orders (single_scattering.pxi).

cdef extern from "core/gains.h":
    ctypedef struct vrte_arrival:
        int rows, upward, decaying
        double left, far, thickness
        const double *mu, *passed, *decayed, *half, *gone, *moments
    enum: VRTE_MOMENTS
    void vrte_odd_moments(const vrte_arrival*, double*) noexcept nogil
    ctypedef void vrte_real_gains_form(const vrte_arrival*, double, const double*, const double*, double*, double*,
                                       double*) noexcept nogil
    vrte_real_gains_form* vrte_real_gains_best(bint wide) noexcept nogil

cdef extern from "core/kernels/in_c.h":
    ctypedef struct vrte_mode_gains:
        vrte_complex even[2]
        vrte_complex odd[2]
        vrte_complex beam[2]
    double vrte_beam_path(bint upward, double mu, double mu0, double left, double depth) noexcept nogil
    vrte_mode_gains vrte_gains_of_mode(vrte_complex k, bint upward, bint decaying, double mu, double left,
                                       double far) noexcept nogil
    void vrte_apply_gain(const vrte_complex* gain, double e_re, double e_im, double f_re, double f_im, double* re,
                         double* im) noexcept nogil


cdef enum: ARRIVAL = 5 + VRTE_MOMENTS     # doubles of a row that `arrival_of` fills


cdef struct Path:
    # what arrives at a depth of a layer from its far face: the layer's modes, the beam's part of them, and directions
    Modes modes
    bint upward
    int stokes, rows, n_mu, unlit, n_rhs, per_beam   # unlit: right-hand sides before the beams' that no beam feeds
    given g_e, g_f                        # G_E X and G_F Y, S n_mu used rows of `rows`
    given c, zeta, even, odd, mu0, mu_out
    double above, depth
    double left, far      # optical path over mu; depth of its end below the face that e^(-k x) decays from


cdef int reconstruct_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    cdef int n = t.n, n_layer = t.n_layer, row = t.base_row[0], rows = t.n_out_rows, layer
    cdef size_t nn = <size_t>n * n, room = <size_t>rows * n, size = <size_t>rows * t.n_rhs
    for layer in range(n_layer):
        if made_of(t, layer) == layer:
            multiply(rows, n, n, 1.0, t.G_E + layer * room, t.X + layer * nn, 0.0, t.g_e + layer * room)
            multiply(rows, n, n, 1.0, t.G_F + layer * room, t.Y + layer * nn, 0.0, t.g_f + layer * room)
    # light going up: from the base through the layers
    set_zero(size, t.running)
    if row >= 0 and t.n_up > 0:
        product(b"N", b"N", t.stokes * t.n_up, t.n_rhs, n, 1.0, t.base_out + row * room, rows, t.base_down, n, 0.0,
                t.running, rows)
    for layer in range(n_layer - 1, -1, -1):
        through_levels(t, layer, True)
    # light going down: from the top through the layers
    set_zero(size, t.running)
    for layer in range(n_layer):
        through_levels(t, layer, False)
    return 0


cdef inline int made_of(const Arrays* t, int layer) noexcept nogil:
    """The first layer that is made of the same, where that is told."""
    return layer if t.twin == NULL else t.twin[layer]


cdef void through_levels(const Arrays* t, int layer, bint upward) noexcept nogil:
    """The field at the wanted depths of a layer; `running`, what enters it, becomes what leaves it for the next."""
    cdef int rows = t.n_out_rows, level, skipped = 0 if upward else t.stokes * t.n_up
    cdef size_t size = <size_t>rows * t.n_rhs, nr = <size_t>t.n * t.n_rhs
    cdef size_t made = <size_t>made_of(t, layer) * rows * t.n + skipped
    cdef int here = first_layer(t.slab_stack, t.n_layer, 0) + layer
    cdef given levels = t.level + first_layer(t.slab_stack, t.n_level, 0)
    cdef Path path = Path(
        modes_at(t.n, layer, t.lam_re, t.lam_im, t.X, t.Y, t.thickness[here], t.decaying[layer]), upward, t.stokes,
        rows, t.n_up if upward else t.n_out - t.n_up, 0, t.n_rhs, t.n_rhs // t.n_in, t.g_e + made, t.g_f + made,
        t.c + layer * nr, t.zeta + layer * nr, t.even + layer * nr, t.odd + layer * nr, t.mu0,
        t.mu_out + (0 if upward else t.n_up), t.above[here], 0.0, 0.0, 0.0)
    for level in range(t.n_level):
        if t.level_layer[level] == layer:
            path.depth = levels[level]
            through_layer(&path, t.running + skipped, t.out + level * size + skipped, t.work)
    if layer != (0 if upward else t.n_layer - 1):
        path.depth = 0.0 if upward else path.modes.thickness
        through_layer(&path, t.running + skipped, t.passed_on + skipped, t.work)
        copy(size, t.passed_on, t.running)


# (1:36)-(1:38)
cdef void through_layer(Path* path, given entering, doubles out, doubles work) noexcept nogil:
    """out = what arrives at the depth: entering light attenuated, plus the layer's source between its far face and it.

    entering and out have S n_mu used rows of `rows`.
    """
    cdef const Modes* a = &path.modes
    cdef bint upward = path.upward
    cdef int n = a.n, stokes = path.stokes, rows = path.rows, n_mu = path.n_mu, n_rhs = path.n_rhs, used = stokes * n_mu
    cdef int j = 0, mu, beam, r, i, columns = path.unlit + n_rhs
    cdef size_t column, place
    cdef double thickness = a.thickness, depth = path.depth, left = thickness - depth if upward else depth
    cdef double sign = -1.0 if upward else 1.0, decay, light
    cdef given mu0 = path.mu0, mu_out = path.mu_out
    cdef doubles even_gain = work                         # (n, used): amplitude of the even modes -> radiance
    cdef doubles odd_gain = even_gain + <size_t>used * n
    cdef doubles beam_gain = odd_gain + <size_t>used * n  # (g_e -+ k g_f)/(1 + k mu) or /(k mu - 1)
    cdef doubles fed = beam_gain + <size_t>used * n       # coordinates c D(.) of all right-hand sides
    cdef doubles first = fed + <size_t>n * n_rhs          # beam_gain c, beam_gain c D, g_f zeta
    cdef doubles second = first + <size_t>used * n_rhs, third = second + <size_t>used * n_rhs
    cdef cplx* response = <cplx*>(third + <size_t>used * n_rhs)
    cdef doubles along = <doubles>(response + n)                               # mu of each row
    cdef vrte_arrival arrival
    if n_mu == 0:
        return
    if left == 0.0:
        for r in range(columns):
            copy(used, entering + <size_t>r * rows, out + <size_t>r * rows)
        return
    path.left = left
    # by symmetry about the middle, down at depth is up at thickness - depth
    path.far = depth if upward else thickness - left
    for i in range(used):
        along[i] = mu_out[i // stokes]
    arrival = arrival_of(used, upward, a.decaying, left, path.far, thickness, slowest_rate(a), along)
    while j < n:
        column = <size_t>j * used
        if a.lam_im[j] == 0.0:
            vrte_real_gains_best(True)(&arrival, a.lam_re[j], path.g_e + <size_t>j * rows, path.g_f + <size_t>j * rows,
                                       even_gain + column, odd_gain + column, beam_gain + column)
            j = j + 1
        else:
            pair_gains(path, j, even_gain + column, odd_gain + column, beam_gain + column)
            j = j + 2
    for r in range(columns):
        for i in range(used):
            out[<size_t>r * rows + i] = arrival.decayed[i] * entering[<size_t>r * rows + i]
    product(b"N", b"N", used, columns, n, 1.0, even_gain, used, path.even, n, 1.0, out, rows)
    product(b"N", b"N", used, columns, n, 1.0, odd_gain, used, path.odd, n, 1.0, out, rows)
    out = out + <size_t>path.unlit * rows
    multiply(used, n_rhs, n, 0.5, beam_gain, path.c, 0.0, first)
    product(b"N", b"N", used, n_rhs, n, 0.5 * sign, path.g_f, rows, path.zeta, n, 0.0, third, used)
    feed(path, depth, response, fed)
    multiply(used, n_rhs, n, 0.5, beam_gain, fed, 0.0, second)
    for r in range(n_rhs):
        beam = r // path.per_beam
        decay = exp(-path.above / mu0[beam])
        for mu in range(n_mu):
            light = vrte_beam_path(upward, mu_out[mu], mu0[beam], left, depth)
            for i in range(stokes * mu, stokes * (mu + 1)):
                column = <size_t>r * used + i
                out[<size_t>r * rows + i] += decay * (light * (mu_out[mu] * first[column] + third[column])
                                                     + (second[column] if upward else -second[column]))
    if upward and thickness < SEMI_INFINITE:
        feed(path, thickness, response, fed)
        multiply(used, n_rhs, n, 0.5, beam_gain, fed, 0.0, second)
        for r in range(n_rhs):
            for mu in range(n_mu):
                decay = exp(-path.above / mu0[r // path.per_beam] - left / mu_out[mu])
                for i in range(stokes * mu, stokes * (mu + 1)):
                    out[<size_t>r * rows + i] -= decay * second[<size_t>r * used + i]
    if not upward:
        resonances(path, out)


cdef vrte_arrival arrival_of(int rows, bint upward, bint decaying, double left, double far, double thickness,
                             double slowest, doubles mu) noexcept nogil:
    """The rows' mu (rows,) and, behind it, left/mu, e^(-left/mu), its root, 1 - e^(-left/mu) and moments, which are
    filled; slowest: the smallest rate of the modes."""
    cdef doubles passed = mu + rows, decayed = passed + rows, half = decayed + rows, gone = half + rows
    cdef double along
    cdef int i
    for i in range(rows):
        along = left / mu[i]
        decayed[i], half[i], gone[i] = exp(-along), exp(-0.5 * along), -expm1(-along)
        passed[i] = along if left < SEMI_INFINITE else 0.0
    cdef vrte_arrival arrival = vrte_arrival(rows, upward, decaying, left, far, thickness, mu, passed, decayed, half,
                                             gone, NULL)
    if not decaying and slowest * thickness <= 1.0:
        vrte_odd_moments(&arrival, gone + rows)
        arrival.moments = gone + rows
    return arrival


cdef int real_gains_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    cdef int rows = t.n_row
    cdef double left = t.whole_layer - t.depth if t.upward else t.depth
    copy(rows, t.row_mu, t.work)
    cdef vrte_arrival arrival = arrival_of(rows, t.upward, t.decays, left,
                                           t.depth if t.upward else t.whole_layer - left, t.whole_layer, sqrt(t.lam),
                                           t.work)
    vrte_real_gains_best(t.wide)(&arrival, t.lam, t.row_g, t.row_g + rows, t.gains, t.gains + rows, t.gains + 2 * rows)
    return 0


cdef void pair_gains(const Path* path, int j, doubles even_gain, doubles odd_gain, doubles beam_gain) noexcept nogil:
    """As `vrte_real_gains`, the two columns of a complex pair as the real and imaginary parts of one."""
    cdef int stokes = path.stokes, rows = path.rows, used = stokes * path.n_mu, i
    cdef given e = path.g_e + <size_t>j * rows, f = path.g_f + <size_t>j * rows
    cdef vrte_complex k = pair(rate_of(&path.modes, j))
    cdef vrte_mode_gains gains
    for i in range(used):
        if i % stokes == 0:
            gains = vrte_gains_of_mode(k, path.upward, path.modes.decaying, path.mu_out[i // stokes], path.left,
                                       path.far)
        vrte_apply_gain(gains.even, e[i], e[i + rows], f[i], f[i + rows], even_gain + i, even_gain + i + used)
        vrte_apply_gain(gains.odd, e[i], e[i + rows], f[i], f[i + rows], odd_gain + i, odd_gain + i + used)
        vrte_apply_gain(gains.beam, e[i], e[i + rows], f[i], f[i + rows], beam_gain + i, beam_gain + i + used)


cdef void feed(const Path* path, double depth, cplx* response, doubles fed) noexcept nogil:
    """fed = c D(depth), all right-hand sides."""
    cdef const Modes* a = &path.modes
    cdef int r, j
    for r in range(path.n_rhs):
        if r % path.per_beam == 0:
            for j in range(a.n):
                response[j] = beam_response(rate_of(a, j), 1.0 / path.mu0[r // path.per_beam], depth)
        scale_coordinates(a.n, a.lam_im, response, path.c + <size_t>r * a.n, fed + <size_t>r * a.n)


cdef void resonances(const Path* path, doubles out) noexcept nogil:
    """Adds the beam's part of the modes with k mu close to 1, left out above: int D e^(-(depth - x)/mu) dx/mu is
    depth^2/mu exp[-depth/mu, -k depth, -depth/mu0]."""
    cdef const Modes* a = &path.modes
    cdef int n = a.n, stokes = path.stokes, rows = path.rows, place, j = 0, width, r, i
    cdef double depth = path.depth, mu, mu0
    cdef given y
    cdef cplx k, value, gain
    cdef size_t row
    while j < n:
        width = 1 if a.lam_im[j] == 0.0 else 2
        k = rate_of(a, j)
        for place in range(path.n_mu):
            mu = path.mu_out[place]
            if not (fabs(mu * k.real - 1.0) < RESONANT and size_of(mu * k - 1.0) < RESONANT):
                continue
            for r in range(path.n_rhs):
                if r % path.per_beam == 0:
                    mu0 = path.mu0[r // path.per_beam]
                    value = (0.5 * depth * depth / mu * exp(-path.above / mu0)) * of_pair(vrte_second_difference(
                        vrte_pair(-depth / mu, 0.0), pair(-depth * k), vrte_pair(-depth / mu0, 0.0)))
                y = path.c + <size_t>r * n + j
                for i in range(stokes * place, stokes * (place + 1)):
                    row = <size_t>j * rows + i
                    gain = times(value, make(path.g_e[row], path.g_e[row + rows] if width == 2 else 0.0)
                                 + times(k, make(path.g_f[row], path.g_f[row + rows] if width == 2 else 0.0)))
                    out[<size_t>r * rows + i] += gain.real * y[0] + (gain.imag * y[1] if width == 2 else 0.0)
        j = j + width


cdef int nodal_fluxes_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    """Half the sum, and difference, of what the modes of one order carry through the nodes."""
    cdef int n = t.n, layer, here, level, r, i, j
    cdef size_t nr = <size_t>n * t.n_rhs, row
    cdef doubles even_carry = t.even_carry, odd_carry = t.odd_carry, at = t.at
    cdef double total, difference, weight, depth
    cdef Modes a
    cdef Nodes nodes = nodes_of(t)
    for level in range(t.n_level):
        layer = t.level_layer[level]
        here = first_layer(t.slab_stack, t.n_layer, 0) + layer
        a = modes_at(n, layer, t.lam_re, t.lam_im, t.X, t.Y, t.thickness[here], t.decaying[layer])
        set_zero(2 * nr, at)
        depth = t.level[first_layer(t.slab_stack, t.n_level, 0) + level]
        coordinates_of(&a, t.n_rhs, t.n_in, t.even + layer * nr, t.odd + layer * nr, t.c + layer * nr,
                       t.zeta + layer * nr, t.mu0, t.above[here], depth, <cplx*>t.profile, t.coordinate, at)
        for j in range(n):
            even_carry[j] = odd_carry[j] = 0.0
            for i in range(nodes.n // nodes.stokes):
                weight = 0.5 * sqrt(nodes.weights[i] * nodes.mu[i])
                even_carry[j] += a.X[<size_t>j * n + i * nodes.stokes] * weight
                odd_carry[j] += a.Y[<size_t>j * n + i * nodes.stokes] * weight
        for r in range(t.n_rhs):
            total = difference = 0.0
            row = <size_t>r * n
            for j in range(n):
                total += at[row + j] * even_carry[j]
                difference += at[nr + row + j] * odd_carry[j]
            t.flux[level * t.n_rhs + r] = total - difference
            t.flux[(t.n_level + level) * t.n_rhs + r] = total + difference
    return 0


cdef void coordinates_of(const Modes* a, int n_rhs, int n_in, given even, given odd, given c, given zeta, given mu0,
                         double above, double depth, cplx* profile, doubles part, doubles out) noexcept nogil:
    """Fills out (2, n_rhs, n), zeros before, with y and z of the modes at a depth below the layer's top; profile
    (6, n): of even, odd, c: y and z; part (n,)."""
    cdef int n = a.n, per_beam = n_rhs // n_in, r, j, f
    cdef double light, decayed
    cdef given coordinates
    cdef cplx k, response
    cdef size_t row
    profiles(a, depth, profile)
    for r in range(n_rhs):
        row = <size_t>r * n
        light = exp(-above / mu0[r // per_beam])
        decayed = light * exp(-depth / mu0[r // per_beam])
        for j in range(n):
            k = rate_of(a, j)
            response = light * beam_response(k, 1.0 / mu0[r // per_beam], depth) if depth > 0.0 else make(0.0, 0.0)
            profile[4 * n + j], profile[5 * n + j] = response, times(k, response)
            out[(<size_t>n_rhs + r) * n + j] = decayed * zeta[row + j]
        for f in range(6):
            coordinates = even + row if f < 2 else odd + row if f < 4 else c + row
            scale_coordinates(n, a.lam_im, profile + f * n, coordinates, part)
            for j in range(n):
                out[(<size_t>(f % 2) * n_rhs + r) * n + j] += part[j]


# (1:24)-(1:25)
cdef void profiles(const Modes* a, double depth, cplx* out) noexcept nogil:
    """The even and the odd mode's y and z at a depth, (n,) each: y_even, z_even, y_odd, z_odd; see `boundary`."""
    cdef int j, n = a.n
    cdef double thickness = a.thickness
    cdef cplx k, from_top, from_bottom, whole, cosine, sine
    for j in range(n):
        k = rate_of(a, j)
        from_top = c_exp(-depth * k)
        from_bottom = make(0.0, 0.0) if thickness > SEMI_INFINITE else c_exp((depth - thickness) * k)
        if a.decaying:
            out[j], out[n + j] = from_top, times(k, from_top)
            out[2 * n + j], out[3 * n + j] = from_bottom, -times(k, from_bottom)
            continue
        whole = 1.0 + c_exp(-thickness * k)
        cosine = over(from_top + from_bottom, whole)
        # (e^(k t) - e^(-k t))/(2 k), t = depth - thickness/2, then over cosh(k h) = e^(k h) whole/2
        sine = (2.0 * depth - thickness) * over(exp_difference((depth - thickness) * k, -depth * k), whole)
        out[j], out[n + j] = cosine, -times(lambda_of(a, j), sine)
        out[2 * n + j], out[3 * n + j] = sine, -cosine
