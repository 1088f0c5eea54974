# How light that leaves a slab changes with its matrices E and F, by real modes: the formulas above
# discrete_ordinates/derivatives/slab.py, whose arrays (there for modes of any kind) have the same names.
#
# Right coordinates are those of light: modes, then rays (directions of beams, or places around one that is close to a
# mode's rate). Left coordinates are those of weights: modes, then rays of outgoing directions.

cdef struct Ray:
    # one ray: its rate, its share, the direction that it belongs to, tanh(h rate), share/(1 + tanh)
    double rate, share, tangent, own
    int of


cdef inline Ray ray_at(given rates, given shares, given_ints of, int k, double half) noexcept nogil:
    cdef double tangent = tanh(half * rates[k])
    return Ray(rates[k], shares[k], tangent, shares[k] / (1.0 + tangent), of[k])


cdef inline Ray ray_in(const Arrays* t, int k) noexcept nogil:
    return ray_at(t.rate_in, t.share_in, t.of_in, k, t.half)


cdef inline Ray ray_out(const Arrays* t, int k) noexcept nogil:
    return ray_at(t.rate_out, t.share_out, t.of_out, k, t.half)


cdef inline given lam_of(const Arrays* t) noexcept nogil:
    return t.lam_re + t.layer * t.n


cdef inline bint has_end(const Arrays* t) noexcept nogil:
    return t.half < SEMI_INFINITE


cdef inline double f_of(double half, double rate) noexcept nogil:
    """tanh(h k)/k."""
    return half if rate == 0.0 else (tanh(half * rate) if half < SEMI_INFINITE else 1.0) / rate


cdef inline double c_of(double half, double rate) noexcept nogil:
    """sech(h k)^2, to the last digits."""
    cdef double decay = exp(-2.0 * half * rate)
    return 4.0 * decay / square(1.0 + decay)


cdef inline void by_inverse(const Arrays* t, bint of_X, bint transposed, int columns, double factor, given a, int lda,
                            doubles b, int ldb) noexcept nogil:
    """b (n, columns) = factor X^-1 a, or Y^-1 a, or with their transposes; X^-1 = Y^T where modes are paired."""
    cdef given of_X_inverse = t.right_Y if t.paired[0] else t.X_inverse
    cdef given of_Y_inverse = t.right_X if t.paired[0] else t.Y_inverse
    cdef char form = b"T" if (t.paired[0] != 0) != transposed else b"N"
    product(form, b"N", t.n, columns, t.n, factor, of_X_inverse if of_X else of_Y_inverse, t.n, a, lda, 0.0, b, ldb)


cdef int invert(int n, given a, doubles b, doubles spare, ints pivots) noexcept nogil:
    """b = a^-1."""
    cdef int info, room = n * n
    copy(<size_t>n * n, a, b)
    info = factorise(n, b, n, pivots)
    if info == 0:
        dgetri(&n, b, &n, pivots, spare, &room, &info)
    return info


cdef double missing_of(int n, given a, given inverse, doubles spare) noexcept nogil:
    """The largest element of (1 - a a^-1) v, of a vector v of elements from 1 to 2."""
    cdef int i
    cdef doubles v = spare, w = spare + n
    for i in range(n):
        v[i] = 1.0 + i / <double>n
    multiply(n, 1, n, 1.0, inverse, v, 0.0, w)
    multiply(n, 1, n, -1.0, a, w, 1.0, v)
    return largest_of(n, v)


cdef void see_along(const Arrays* t, given G, int columns, given right, doubles out) noexcept nogil:
    """out (n_out_rows, columns) = ON right, the rows of E or F that lead out: -G over the cosines."""
    cdef int o = t.n_out_rows, i, j
    multiply(o, columns, t.n, -1.0, G, right, 0.0, out)
    for j in range(columns):
        for i in range(o):
            out[<size_t>j * o + i] /= t.mu_out[i // t.stokes]


cdef void put_rays_in(const Arrays* t, bint odd, doubles out) noexcept nogil:
    """out (n, rays in): what beams that come in with amplitude 1 make at both faces in even or odd light."""
    cdef int n = t.n, k, i
    cdef size_t at
    cdef Ray ray
    for k in range(t.used_in[0]):
        ray = ray_in(t, k)
        for i in range(n):
            at = <size_t>(n + k) * n + i
            if odd:
                out[k * n + i] = t.right_Y[at] + ray.tangent / ray.rate * t.right_X[at]
            else:
                out[k * n + i] = t.right_X[at] + ray.tangent * ray.rate * t.right_Y[at]


cdef void put_rays_out(const Arrays* t, bint odd, doubles out) noexcept nogil:
    """out (rays out, n): the same of weights along outgoing directions."""
    cdef int n = t.n, rays = t.used_out[0], k, j
    cdef size_t at
    cdef double f, g, rate
    cdef Ray ray
    for j in range(n):
        rate = sqrt(lam_of(t)[j])
        f = f_of(t.half, rate)
        g = rate * rate * f if has_end(t) else rate
        for k in range(rays):
            at = <size_t>j * t.n_ray_out + k
            ray.tangent = tanh(t.half * t.rate_out[k])
            if odd:
                out[j * rays + k] = ray.tangent * t.out_y[at] - f * t.out_x[at]
            else:
                out[j * rays + k] = ray.tangent * t.out_x[at] - g * t.out_y[at]


cdef int slab_by_modes_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    cdef int n = t.n, info, i, j
    cdef size_t nn = <size_t>n * n, own
    cdef given X = t.X + t.layer * nn, Y = t.Y + t.layer * nn, lam = lam_of(t)
    cdef doubles system = t.spare, spare = t.spare + nn, inverse
    cdef bint odd
    cdef double rate
    t.residual[0] = 0.0
    t.paired[0] = t.X_pivots[t.layer * n] < 0
    if not t.paired[0]:
        info = invert(n, X, t.X_inverse, spare, t.pivots)
        if info == 0:
            info = invert(n, Y, t.Y_inverse, spare, t.pivots)
        if info != 0:
            return info
    set_zero(2 * nn, t.nodes)
    for odd in range(2 if has_end(t) else 1):
        inverse = t.odd_inverse if odd else t.even_inverse
        for j in range(n):
            rate = f_of(t.half, sqrt(lam[j]))
            if not odd:
                rate = lam[j] * rate if has_end(t) else sqrt(lam[j])
            for i in range(n):
                own = <size_t>j * n + i
                system[own] = Y[own] + X[own] * rate if odd else X[own] + Y[own] * rate
        info = invert(n, system, inverse, spare, t.pivots)
        if info != 0:
            return info
        t.residual[0] = max(t.residual[0], missing_of(n, system, inverse, spare))
        multiply(n, n, n, 1.0, Y if odd else X, inverse, 0.0, spare)        # 1 - S
        for j in range(n):
            for i in range(n):
                own = <size_t>j * n + i
                give(t, odd, (i == j) - spare[own], t.nodes + own, t.nodes + nn + own)
            if has_end(t):
                t.nodes[nn + <size_t>j * n + j] += 0.5
            else:
                t.nodes[<size_t>j * n + j] += 1.0
    return 0


cdef int slab_along_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    cdef int n = t.n, r = t.n_in_rows, o = t.n_out_rows, ki = t.used_in[0], ko = t.used_out[0], i, j, k
    cdef size_t nn = <size_t>n * n, own
    cdef given lam = lam_of(t)
    cdef doubles out_E = t.along, out_F = t.along + <size_t>o * (n + ki), in_x = t.spare, in_y = in_x + <size_t>n * ki
    cdef doubles lit_X = in_y + <size_t>n * ki, lit_Y = lit_X + <size_t>n * r
    cdef bint odd
    cdef double rate
    cdef Differences d
    cdef Ray ray
    copy(nn, t.X + t.layer * nn, t.right_X)
    copy(nn, t.Y + t.layer * nn, t.right_Y)
    by_inverse(t, True, False, r, -1.0, t.source_s + t.layer * <size_t>n * r, n, lit_X, n)
    by_inverse(t, False, False, r, -1.0, t.source_d + t.layer * <size_t>n * r, n, lit_Y, n)
    for k in range(ki):
        ray = ray_in(t, k)
        for j in range(n):
            own = <size_t>k * n + j
            in_x[own] = (ray.rate * lit_X[ray.of * n + j] + lit_Y[ray.of * n + j]) / (ray.rate * ray.rate - lam[j])
            in_y[own] = in_x[own] - lit_X[ray.of * n + j] / ray.rate
    multiply(n, ki, n, 1.0, t.right_X, in_x, 0.0, t.right_X + nn)
    multiply(n, ki, n, 1.0, t.right_Y, in_y, 0.0, t.right_Y + nn)
    see_along(t, t.G_E + t.layer * <size_t>n * o, n + ki, t.right_X, out_E)
    see_along(t, t.G_F + t.layer * <size_t>n * o, n + ki, t.right_Y, out_F)
    for j in range(n):
        for k in range(ko):
            rate, i = t.rate_out[k], t.of_out[k]
            own = <size_t>j * t.n_ray_out + k
            t.out_x[own] = (rate * out_E[j * o + i] + out_F[j * o + i] * lam[j]) / (lam[j] - rate * rate)
            t.out_y[own] = (t.out_x[own] - out_F[j * o + i]) / rate
    list_points(t)
    for j in range(n + ki):
        for k in range(ko):
            d = differences(t.half, t.series_of_tanh, left_points(t) + n + k, right_points(t) + j, False)
            t.differences_out[2 * (<size_t>j * ko + k)], t.differences_out[2 * (<size_t>j * ko + k) + 1] = d.f, d.g
    set_zero(2 * <size_t>n * r, t.entering)
    set_zero(2 * <size_t>n * o, t.leaving)
    set_zero(2 * <size_t>o * r, t.passing)
    for odd in range(2 if has_end(t) else 1):
        respond_along(t, odd, out_E, out_F)
    return 0


cdef inline void give(const Arrays* t, bint odd, double value, doubles reflected, doubles transmitted) noexcept nogil:
    """Adds what even or odd light makes of S = Z (1 + Z)^-1 to R = So - Se and to T = 1 - So - Se; So is 1 - Se where
    there is no other end."""
    if has_end(t):
        reflected[0] += value if odd else -value
        transmitted[0] -= value
    else:
        reflected[0] -= 2.0 * value


cdef void respond_along(const Arrays* t, bint odd, given out_E, given out_F) noexcept nogil:
    """What a slab does from beams and along outgoing directions in even or odd light."""
    cdef int n = t.n, r = t.n_in_rows, o = t.n_out_rows, ki = t.used_in[0], ko = t.used_out[0], i, j, k
    cdef size_t nn = <size_t>n * n, at
    cdef given inverse = t.odd_inverse if odd else t.even_inverse, right = t.right_Y if odd else t.right_X
    cdef doubles rays = t.spare, lit = rays + <size_t>n * ki, sent = lit + <size_t>n * ki
    cdef doubles rows = sent + <size_t>n * ki, seen = rows + <size_t>ko * n, between = seen + <size_t>ko * n
    cdef double own, e, p, f, g
    cdef Ray ray, other
    put_rays_in(t, odd, rays)
    multiply(n, ki, n, 1.0, inverse, rays, 0.0, lit)
    multiply(n, ki, n, 1.0, right, lit, 0.0, sent)
    for k in range(ki):
        ray = ray_in(t, k)
        own = ray.own * ray.rate if odd else ray.own
        for i in range(n):
            at = <size_t>ray.of * n + i
            give(t, odd, own * (sent[k * n + i] - right[nn + <size_t>k * n + i]), t.entering + at,
                 t.entering + <size_t>n * r + at)
    put_rays_out(t, odd, rows)
    multiply(ko, n, n, 1.0, rows, inverse, 0.0, seen)
    for k in range(ko):
        ray = ray_out(t, k)
        for j in range(n):
            at = <size_t>j * o + ray.of
            give(t, odd, -ray.own * seen[j * ko + k], t.leaving + at, t.leaving + <size_t>n * o + at)
    for j in range(n + ki):
        for k in range(ko):
            at = <size_t>j * ko + k
            f, g = t.differences_out[2 * at], t.differences_out[2 * at + 1]
            e = out_E[<size_t>j * o + t.of_out[k]] * t.rate_out[k]
            p = out_F[<size_t>j * o + t.of_out[k]]
            between[at] = f * e + g * p if odd else g * e + left_points(t)[n + k].x * right_points(t)[j].x * f * p
    multiply(ko, ki, n, -1.0, between, lit, 1.0, between + <size_t>ko * n)
    for j in range(ki):
        other = ray_in(t, j)
        for k in range(ko):
            ray = ray_out(t, k)
            own = ray.own * other.own * (other.rate if odd else 1.0 / ray.rate)
            at = <size_t>other.of * o + ray.of
            give(t, odd, own * between[<size_t>(n + j) * ko + k], t.passing + at, t.passing + <size_t>o * r + at)


cdef inline Point* left_points(const Arrays* t) noexcept nogil:
    return <Point*>t.points_of_tanh


cdef inline Point* right_points(const Arrays* t) noexcept nogil:
    return left_points(t) + t.n_left


cdef void list_points(const Arrays* t) noexcept nogil:
    """The points of left, then of right coordinates."""
    cdef int k
    for k in range(t.n):
        left_points(t)[k] = right_points(t)[k] = point_of(t.half, lam_of(t)[k])
    for k in range(t.used_out[0]):
        left_points(t)[t.n + k] = point_of(t.half, square(t.rate_out[k]))
    for k in range(t.used_in[0]):
        right_points(t)[t.n + k] = point_of(t.half, square(t.rate_in[k]))
    tanh_series(t.series_of_tanh)


cdef void take_in(const Arrays* t, bint odd, given rays, given light, given beams, doubles spare,
                  doubles out) noexcept nogil:
    """out (n_right, n_light): coordinates X^-1 (1 + Ze)^-1 or Y^-1 (1 + Zo)^-1 of light (n, n_light) and of beams
    (rays in, n_light)."""
    cdef int n = t.n, ki = t.used_in[0], r = t.n_light, k, j
    cdef double share
    for k in range(ki):
        share = 1.0 / (1.0 + tanh(t.half * t.rate_in[k]))
        share = share * t.rate_in[k] if odd else share
        for j in range(r):
            out[<size_t>j * t.n_right + n + k] = share * beams[<size_t>j * ki + k]
    copy(<size_t>n * r, light, spare)
    product(b"N", b"N", n, r, ki, -1.0, rays, n, out + n, t.n_right, 1.0, spare, n)
    product(b"N", b"N", n, r, n, 1.0, t.odd_inverse if odd else t.even_inverse, n, spare, n, 0.0, out, t.n_right)


cdef void take_out(const Arrays* t, bint odd, given rows, given weights, given sights, doubles spare,
                   doubles out) noexcept nogil:
    """out (n_left, n_weigh): Y^T (1 + Ze)^-T or X^T (1 + Zo)^-T of weights, X^T or Y^T of those on the nodes
    (n, n_weigh), and of weights along sights (rays out, n_weigh)."""
    cdef int n = t.n, ko = t.used_out[0], w = t.n_weigh, k, j
    cdef double share
    cdef doubles own = spare, rest = own + <size_t>ko * w, found = rest + <size_t>n * w
    for k in range(ko):
        share = 1.0 / (1.0 + tanh(t.half * t.rate_out[k]))
        for j in range(w):
            own[<size_t>j * ko + k] = share * sights[<size_t>j * ko + k]
            out[<size_t>j * t.n_left + n + k] = own[<size_t>j * ko + k] / (1.0 if odd else t.rate_out[k])
    copy(<size_t>n * w, weights, rest)
    product(b"T", b"N", n, w, ko, 1.0, rows, ko, own, ko, 1.0, rest, n)
    product(b"T", b"N", n, w, n, 1.0, t.odd_inverse if odd else t.even_inverse, n, rest, n, 0.0, found, n)
    product(b"T", b"N", n, w, n, 1.0, t.right_X if odd else t.right_Y, n, found, n, 0.0, out, t.n_left)
    product(b"T", b"N", n, w, ko, 1.0, t.out_x if odd else t.out_y, t.n_ray_out, own, ko, 1.0, out, t.n_left)


cdef void deal(given shares, given_ints of, int rays, int directions, int columns, given values,
               doubles out) noexcept nogil:
    """out (rays, columns): values of directions (directions, columns) dealt out to rays."""
    cdef int k, j
    for j in range(columns):
        for k in range(rays):
            out[<size_t>j * rays + k] = shares[k] * values[<size_t>j * directions + of[k]]


cdef void combine_faces(size_t count, double sign, given a, given b, doubles out) noexcept nogil:
    """out = a + sign b."""
    cdef size_t i
    for i in range(count):
        out[i] = a[i] + sign * b[i]


cdef enum: EVEN, ODD, PASSED        # the matrix between modes of part k of a derivative is number k % 3


cdef int slab_terms_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    cdef int n = t.n, ki = t.used_in[0], ko = t.used_out[0], r = t.n_light, w = t.n_weigh, here, there, i, j, part
    cdef size_t nr = <size_t>n * r, nw = <size_t>n * w, kr = <size_t>ki * r, kw = <size_t>ko * w, at
    cdef size_t most = <size_t>t.n_right * t.n_left
    cdef size_t light_size = t.n_right * <size_t>r, weight_size = t.n_left * <size_t>w
    cdef doubles rays[2], rows[2], light = t.lights, beams = light + nr, spare = t.spare
    cdef doubles weights = t.weighings, turned = weights + nw, sights = turned + nw
    cdef double sign
    cdef bint odd
    cdef Differences d
    list_points(t)
    for odd in range(2 if has_end(t) else 1):
        rays[odd], rows[odd] = t.ray_columns + odd * <size_t>n * ki, t.ray_rows + odd * <size_t>n * ko
        put_rays_in(t, odd, rays[odd])
        put_rays_out(t, odd, rows[odd])
    deal(t.share_in, t.of_in, ki, t.n_in_rows, r, t.falling, t.dealt)
    deal(t.share_in, t.of_in, ki, t.n_in_rows, r, t.rising, t.dealt + kr)
    deal(t.share_out, t.of_out, ko, t.n_out_rows, w, t.seen_falling, t.dealt + 2 * kr)
    deal(t.share_out, t.of_out, ko, t.n_out_rows, w, t.seen_rising, t.dealt + 2 * kr + kw)
    if t.n_part < 6:
        for part in range(t.n_part):
            sign = 0.0 if t.n_part == 1 else -1.0 if part == ODD else 1.0
            combine_faces(nr, sign, t.light_above, t.light_below, light)
            combine_faces(kr, sign, t.dealt, t.dealt + kr, beams)
            take_in(t, part == ODD, rays[part], light, beams, spare, t.right + part * light_size)
            combine_faces(nw, sign, t.weight_above, t.weight_below, weights)
            combine_faces(kw, sign, t.dealt + 2 * kr, t.dealt + 2 * kr + kw, sights)
            product(b"T", b"N", n, w, n, 1.0, t.right_Y if part == ODD else t.right_X, n, weights, n, 0.0, turned, n)
            take_out(t, part == ODD, rows[part], turned, sights, spare, t.left + part * weight_size)
            if part == EVEN:
                sign = -2.0 if t.n_part == 1 else -1.0
                for at in range(weight_size):
                    t.left[at] *= sign
    else:
        dim_terms(t, rays, rows)
    for i in range(n + ko):
        for j in range(n + ki):
            d = differences(t.half, t.series_of_tanh, left_points(t) + i, right_points(t) + j, t.n_part == 6)
            at = (<size_t>j) * t.n_left + i
            t.of_E[at] = d.g
            t.of_F[at] = left_points(t)[i].x * right_points(t)[j].x * d.f
            if t.n_kind > 1:
                t.of_E[most + at] = d.f
                t.of_F[most + at] = d.g
            if t.n_kind > 2:
                t.of_E[2 * most + at] = d.c
                t.of_F[2 * most + at] = right_points(t)[j].x * d.c
    return 0


cdef void dim_terms(const Arrays* t, doubles* rays, doubles* rows) noexcept nogil:
    """Of a slab that lets little light through: what is let through on its own, see slab.py."""
    cdef int n = t.n, ki = t.used_in[0], ko = t.used_out[0], r = t.n_light, w = t.n_weigh, side, here, i, j
    cdef size_t kr = <size_t>ki * r, kw = <size_t>ko * w, of_light = <size_t>t.n_right * r, k
    cdef size_t of_weight = <size_t>t.n_left * w
    cdef doubles parts = t.parts, light, weight, spare = t.spare, turned = t.weighings
    cdef doubles even[2], odd[2], passed[2], even_seen[2], odd_seen[2], let[2]
    for side in range(2):
        even[side], odd[side], passed[side] = parts, parts + of_light, parts + 2 * of_light
        parts += 3 * of_light
        even_seen[side], odd_seen[side], let[side] = parts, parts + of_weight, parts + 2 * of_weight
        parts += 3 * of_weight
        light, weight = t.light_below if side else t.light_above, t.weight_below if side else t.weight_above
        take_in(t, False, rays[0], light, t.dealt + side * kr, spare, even[side])
        take_in(t, True, rays[1], light, t.dealt + side * kr, spare, odd[side])
        product(b"T", b"N", n, w, n, 1.0, t.right_X, n, weight, n, 0.0, turned, n)
        take_out(t, False, rows[0], turned, t.dealt + 2 * kr + side * kw, spare, even_seen[side])
        product(b"T", b"N", n, w, n, 1.0, t.right_Y, n, weight, n, 0.0, turned, n)
        take_out(t, True, rows[1], turned, t.dealt + 2 * kr + side * kw, spare, odd_seen[side])
        pass_light(t, rays[1], even[side], passed[side])
        pass_weights(t, rows[0], odd_seen[side], let[side])
    for here in range(2):
        light, weight = t.right + 3 * here * of_light, t.left + 3 * here * of_weight
        copy(of_light, even[here], light)
        combine_faces(of_light, -1.0, odd[here], passed[1 - here], light + of_light)
        copy(of_light, even[1 - here], light + 2 * of_light)
        for k in range(of_weight):
            weight[k] = -even_seen[here][k] - let[1 - here][k]
        copy(of_weight, odd_seen[here], weight + of_weight)
        copy(of_weight, odd_seen[here], weight + 2 * of_weight)


cdef void pass_light(const Arrays* t, given rays, given even, doubles out) noexcept nogil:
    """Y^-1 T of light, from X^-1 (1 + Ze)^-1 of it."""
    cdef int n = t.n, ki = t.used_in[0], k, j, all_ = t.n + t.used_in[0]
    cdef doubles scaled = t.lights, own = scaled + <size_t>all_ * t.n_light, light = own + <size_t>ki * t.n_light
    cdef double c
    for k in range(all_):
        c = c_of(t.half, right_points(t)[k].root)
        for j in range(t.n_light):
            scaled[<size_t>j * all_ + k] = c * even[<size_t>j * t.n_right + k]
            if k >= n:
                own[<size_t>j * ki + k - n] = scaled[<size_t>j * all_ + k]
    multiply(n, t.n_light, all_, 1.0, t.right_X, scaled, 0.0, light)
    take_in(t, True, rays, light, own, t.spare, out)


cdef void pass_weights(const Arrays* t, given rows, given odd, doubles out) noexcept nogil:
    """(T Y)^T of weights, from X^T (1 + Zo)^-T of them."""
    cdef int n = t.n, ko = t.used_out[0], k, j
    cdef doubles weights = t.weighings, own = weights + <size_t>n * t.n_weigh
    cdef double c
    for k in range(n + ko):
        c = c_of(t.half, left_points(t)[k].root)
        for j in range(t.n_weigh):
            if k < n:
                weights[<size_t>j * n + k] = c * odd[<size_t>j * t.n_left + k]
            else:
                own[<size_t>j * ko + k - n] = c * odd[<size_t>j * t.n_left + k]
    product(b"T", b"N", n, t.n_weigh, ko, -1.0, t.out_x, t.n_ray_out, own, ko, 1.0, weights, n)
    take_out(t, False, rows, weights, own, t.spare, out)


cdef void expand_change(const Arrays* t, bint of_F, doubles spare, doubles out) noexcept nogil:
    """out (n_left, n_right): a change of E or F between modes and rays, e or p."""
    cdef int n = t.n, r = t.n_in_rows, o = t.n_out_rows, ki = t.used_in[0], ko = t.used_out[0], i, j, k
    cdef given right = t.right_Y if of_F else t.right_X, source = t.source_s if of_F else t.source_d
    cdef given lead = t.out_x if of_F else t.out_y
    cdef doubles along = spare + <size_t>n * (n + ki)
    cdef double scale
    multiply(n, n + ki, n, 1.0, t.F if of_F else t.E, right, 0.0, spare)
    for k in range(ki):
        scale = 1.0 / t.rate_in[k] if of_F else 1.0
        for i in range(n):
            spare[<size_t>(n + k) * n + i] -= scale * source[<size_t>t.of_in[k] * n + i]
    by_inverse(t, of_F, False, n + ki, 1.0, spare, n, out, t.n_left)
    see_along(t, t.G_F if of_F else t.G_E, n + ki, right, along)
    for j in range(n + ki):
        for k in range(ko):
            out[<size_t>j * t.n_left + n + k] = along[<size_t>j * o + t.of_out[k]]
    product(b"N", b"N", ko, n + ki, n, -1.0, lead, t.n_ray_out, out, t.n_left, 1.0, out + n, t.n_left)
    for j in range(0 if of_F else n + ki):
        for k in range(ko):
            out[<size_t>j * t.n_left + n + k] *= t.rate_out[k]


cdef int change_slab_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    cdef int left = t.n + t.used_out[0], right = t.n + t.used_in[0], kind, part, i, j
    cdef size_t size = <size_t>t.n_left * t.n_right, at
    cdef doubles e = t.between, p = e + size, both = p + size
    expand_change(t, False, t.spare, e)
    expand_change(t, True, t.spare, p)
    set_zero(<size_t>t.n_light * t.n_weigh, t.found)
    for kind in range(t.n_kind):
        for j in range(right):
            for i in range(left):
                at = <size_t>j * t.n_left + i
                both[at] = t.of_E[kind * size + at] * e[at] + t.of_F[kind * size + at] * p[at]
        for part in range(t.n_part):
            if part % 3 != kind:
                continue
            product(b"N", b"N", left, t.n_light, right, 1.0, both, t.n_left,
                    t.right + part * <size_t>t.n_light * t.n_right, t.n_right, 0.0, t.spare, left)
            product(b"T", b"N", t.n_weigh, t.n_light, left, 1.0, t.left + part * <size_t>t.n_weigh * t.n_left, t.n_left,
                    t.spare, left, 1.0, t.found, t.n_weigh)
    return 0


cdef int pull_slab_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    cdef int left = t.n + t.used_out[0], right = t.n + t.used_in[0], kind, part, i, j
    cdef size_t size = <size_t>t.n_left * t.n_right, at
    cdef doubles e = t.between, p = e + size, both = p + size
    set_zero(2 * size, e)
    for kind in range(t.n_kind):
        set_zero(size, both)
        for part in range(t.n_part):
            if part % 3 != kind:
                continue
            product(b"N", b"N", left, t.n_light, t.n_weigh, 1.0, t.left + part * <size_t>t.n_weigh * t.n_left, t.n_left,
                    t.pull_of_light, t.n_weigh, 0.0, t.spare, left)
            product(b"N", b"T", left, right, t.n_light, 1.0, t.spare, left,
                    t.right + part * <size_t>t.n_light * t.n_right, t.n_right, 1.0, both, t.n_left)
        for j in range(right):
            for i in range(left):
                at = <size_t>j * t.n_left + i
                e[at] += t.of_E[kind * size + at] * both[at]
                p[at] += t.of_F[kind * size + at] * both[at]
    pull_expanded(t, False, e, t.pulled_E)
    pull_expanded(t, True, p, t.pulled_F)
    return 0


cdef void pull_expanded(const Arrays* t, bint of_F, doubles of_change, doubles out) noexcept nogil:
    """The transpose of `expand_change`: out (n_to, n_from)."""
    cdef int n = t.n, o = t.n_out_rows, ki = t.used_in[0], ko = t.used_out[0], all_ = t.n + t.used_in[0], i, j, k
    cdef given right = t.right_Y if of_F else t.right_X
    cdef doubles own = t.spare, rows = own + <size_t>n * all_
    cdef double scale
    for j in range(0 if of_F else all_):
        for k in range(ko):
            of_change[<size_t>j * t.n_left + n + k] *= t.rate_out[k]
    product(b"T", b"N", n, all_, ko, -1.0, t.out_x if of_F else t.out_y, t.n_ray_out, of_change + n, t.n_left, 1.0,
            of_change, t.n_left)
    by_inverse(t, of_F, True, all_, 1.0, of_change, t.n_left, own, n)
    set_zero(<size_t>o * all_, rows)
    for j in range(all_):
        for k in range(ko):
            rows[<size_t>j * o + t.of_out[k]] += of_change[<size_t>j * t.n_left + n + k]
    set_zero(<size_t>t.n_to * t.n_from, out)
    product(b"N", b"T", n, n, all_, 1.0, own, n, right, n, 0.0, out, t.n_to)
    product(b"N", b"T", o, n, all_, 1.0, rows, o, right, n, 0.0, out + n, t.n_to)
    for k in range(ki):
        scale = 1.0 / t.rate_in[k] if of_F else 1.0
        for i in range(n):
            out[<size_t>(n + t.of_in[k]) * t.n_to + i] += scale * own[<size_t>(n + k) * n + i]


# What weighs the light that a thicker slab sends out: a thin sheet more at the face that light leaves,
# b = (F - E)/2 and c = (F + E)/2, makes dR = T b T and dT = -(c - R b) T.
cdef int deepen_slab_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    cdef int n = t.n, r = t.n_light, w = t.n_weigh, o = t.n_out_rows, beams = t.n_in_rows, side, i, j
    cdef size_t nn = <size_t>n * n, on = <size_t>o * n, nr = <size_t>n * r, own = t.layer * nn, out = t.layer * on, k
    cdef size_t lead = t.layer * <size_t>n * beams
    cdef doubles through = t.spare, in_E = through + nr, in_F = in_E + nr, met = in_F + nr
    cdef doubles decayed = met + <size_t>n * w, leaving = decayed + <size_t>beams * r
    cdef doubles out_E = leaving + <size_t>o * r, out_F = out_E + <size_t>o * r, along_out = out_F + <size_t>o * r
    cdef given light, of_beams, same, other, along, beyond, R = t.nodes, T = t.nodes + nn
    cdef double e, f, mu
    set_zero(<size_t>r * w, t.found)
    for side in range(2):
        light, of_beams = t.light_below if side else t.light_above, t.rising if side else t.falling
        same, other = t.weight_below if side else t.weight_above, t.weight_above if side else t.weight_below
        along, beyond = t.seen_rising if side else t.seen_falling, t.seen_falling if side else t.seen_rising
        for j in range(r):
            for i in range(beams):
                k = <size_t>j * beams + i
                decayed[k] = exp(-2.0 * t.half / t.mu0[i // t.stokes]) * of_beams[k]
        multiply(n, r, n, 1.0, T, light, 0.0, through)
        multiply(n, r, beams, 1.0, t.entering + <size_t>n * beams, of_beams, 1.0, through)
        multiply(n, r, n, 1.0, t.E + own, through, 0.0, in_E)
        multiply(n, r, beams, -1.0, t.source_d + lead, decayed, 1.0, in_E)
        multiply(n, r, n, 1.0, t.F + own, through, 0.0, in_F)
        multiply(n, r, beams, -1.0, t.source_s + lead, decayed, 1.0, in_F)
        for k in range(nr):
            e, f = in_E[k], in_F[k]
            in_E[k], in_F[k] = 0.5 * (f - e), -0.5 * (f + e)
        product(b"T", b"N", n, w, n, 1.0, T, n, same, n, 0.0, met, n)
        product(b"T", b"N", n, w, n, 1.0, R, n, other, n, 1.0, met, n)
        product(b"T", b"N", n, w, o, 1.0, t.leaving + on, o, along, o, 1.0, met, n)
        product(b"T", b"N", n, w, o, 1.0, t.leaving, o, beyond, o, 1.0, met, n)
        product(b"T", b"N", w, r, n, 1.0, met, n, in_E, n, 1.0, t.found, w)
        product(b"T", b"N", w, r, n, 1.0, other, n, in_F, n, 1.0, t.found, w)
        multiply(o, r, n, 1.0, t.leaving + on, light, 0.0, leaving)
        multiply(o, r, beams, 1.0, t.passing + <size_t>o * beams, of_beams, 1.0, leaving)
        multiply(o, r, n, 1.0, t.G_E + out, through, 0.0, out_E)
        multiply(o, r, n, 1.0, t.G_F + out, through, 0.0, out_F)
        for j in range(r):
            for i in range(o):
                k, mu = <size_t>j * o + i, t.mu_out[i // t.stokes]
                e, f = out_E[k], out_F[k]
                out_E[k], out_F[k] = 0.5 * (e - f) / mu, (0.5 * (e + f) - leaving[k]) / mu
        for j in range(w):
            for i in range(o):
                along_out[<size_t>j * o + i] = along[<size_t>j * o + i] * exp(-2.0 * t.half / t.mu_out[i // t.stokes])
        product(b"T", b"N", w, r, o, 1.0, along_out, o, out_E, o, 1.0, t.found, w)
        product(b"T", b"N", w, r, o, 1.0, beyond, o, out_F, o, 1.0, t.found, w)
    return 0
