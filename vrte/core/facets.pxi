# Rough surfaces: Fourier orders of what facets of random slopes reflect or let through, a pair of directions at a time
# (vrte/optics/facets.py has the same in closed form, azimuth by azimuth).

cdef extern from "core/surfaces.h":
    double vrte_smith(double alpha, bint is_ggx, double mu) noexcept nogil
    vrte_complex vrte_fresnel(vrte_complex m, double c, vrte_complex* p, vrte_complex* s) noexcept nogil

cdef enum:
    AZIMUTHS = 128      # of one product of matrices

cdef double WIDEST = 0.5    # radians: a piece of azimuth where facets reflect totally, or nearly: at 1 they miss 1e-6


cdef struct Pair:
    # across, vertical: squares of the horizontal part of k_i - n k_o at azimuth 0, and of the vertical one; apart: what
    # the former gains with sin^2 of half the azimuth; between: sin(theta_i - theta_o); common: what no azimuth changes
    double mu_i, mu_o, sine_i, sine_o, across, vertical, apart, between, common


cdef inline double steep_of(const Arrays* f) noexcept nogil:
    """alpha squared."""
    return f.roughness * f.roughness


cdef inline double shade(const Arrays* f, double mu) noexcept nogil:
    return vrte_smith(f.roughness, f.is_ggx, mu)


cdef int facet_orders_one(Arrays* f, int item, Workspace desk) noexcept nogil:
    """The integral over azimuth in pieces of Gauss's rule: as wide as the facets' lobe where it is, then ever wider, no
    wider than the highest order allows, cut where facets turn away or begin to reflect totally."""
    cdef Pair p
    cdef double n = f.index, mu_i = f.mu_i[0], mu_o = f.mu_o[0], sum_of_sines, width, last, next
    cdef double edge = 0.0, before = 0.0
    cdef double lobe, seen, lit, longest = <double>f.n_point / max(1, f.n_order - 1), critical = -1.0, cosine, unit
    cdef int piece, count = 0
    set_zero(<size_t>f.n_order * 16, f.sums)
    set_zero(<size_t>f.n_order * 16, f.out)
    p.mu_i, p.mu_o = mu_i, mu_o
    p.sine_i, p.sine_o = sqrt((1.0 - mu_i) * (1.0 + mu_i)), sqrt((1.0 - mu_o) * (1.0 + mu_o))
    sum_of_sines = p.sine_i * mu_o + mu_i * p.sine_o
    p.between = (mu_o - mu_i) * (mu_o + mu_i) / sum_of_sines if sum_of_sines > 0.0 else 0.0
    p.common = 1.0 / (PI * steep_of(f) * mu_i * mu_o)
    if f.shadowing:
        lit, seen = shade(f, mu_i), shade(f, mu_o)
        p.common *= lit * seen if f.shadowing == 1 else min(lit, seen)
    last = PI
    if f.transmitted:
        p.across, p.vertical = p.sine_i - n * p.sine_o, mu_i - n * mu_o
        p.apart = 4.0 * n * p.sine_i * p.sine_o
        p.common *= n * n
        if (n > 1.0) == (p.vertical >= 0.0) or p.vertical == 0.0:
            return 0
        # facets are met from their proper sides while cos(k_i, k_o) > min(n, 1/n)
        cosine = min(n, 1.0 / n) - mu_i * mu_o
        unit = p.sine_i * p.sine_o
        if cosine >= unit:
            return 0
        if cosine > -unit:
            last = acos(cosine / unit)
    else:
        p.across, p.vertical, p.apart = p.sine_i - p.sine_o, mu_i + mu_o, 4.0 * p.sine_i * p.sine_o
        p.common *= 0.25
        if f.absorption == 0.0 and n < 1.0:
            cosine, unit = 2.0 * n * n - 1.0 + mu_i * mu_o, p.sine_i * p.sine_o      # where sin^2 of incidence is n^2
            longest = min(longest, WIDEST)
            if fabs(cosine) < unit:
                critical = acos(cosine / unit)
    p.across, p.vertical = p.across * p.across, p.vertical * p.vertical
    if not f.is_ggx and p.across > f.reach * f.reach * steep_of(f) * p.vertical:
        return 0
    # half the azimuth at which the slope is by alpha (GGX: and what it is at least) longer than across
    lobe = steep_of(f) * p.vertical + (p.across if f.is_ggx else 0.0)
    width = sqrt(lobe / p.apart) if p.apart > lobe else 1.0
    piece = 1
    while edge < last:
        # sin of half an azimuth: 1, 2, 3 ... lobes of a Gaussian, 1, 2, 4 ... of GGX's
        lobe = width * piece
        next = 2.0 * asin(lobe) if lobe < 1.0 else PI
        piece = 2 * piece if f.is_ggx else piece + 1
        if edge == critical and next < last and next - edge < 0.5 * (edge - before):
            continue
        if not f.is_ggx and width < 1.0 and (piece - 2) * (piece - 2) * width * width * p.apart > (
                f.reach * f.reach * steep_of(f) * p.vertical - p.across):
            break
        next = min(next, last)
        if edge < critical and critical < next + 0.5 * (next - edge):      # no end of a piece near the root
            next = critical
        facet_piece(f, &p, edge, next, 1 if next == critical else -1 if edge == critical else 0, longest, &count)
        before, edge = edge, next
    finish_orders(f, &count)
    return 0


cdef void add_azimuth(const Arrays* f, double sh, double ch, const double (*z)[4], int* count) noexcept nogil:
    """Adds z, weighed, at an azimuth whose half has the sine sh and the cosine ch, to samples (azimuth, 8) of the
    blocks with cos and of those with sin; as many as there is room for are added up."""
    cdef doubles even = f.even_samples + 8 * count[0], odd = f.odd_samples + 8 * count[0]
    cdef int r
    for r in range(2):
        even[2 * r], even[2 * r + 1] = z[r][0], z[r][1]
        even[4 + 2 * r], even[5 + 2 * r] = z[2 + r][2], z[2 + r][3]
        odd[2 * r], odd[2 * r + 1] = -z[r][2], -z[r][3]
        odd[4 + 2 * r], odd[5 + 2 * r] = z[2 + r][0], z[2 + r][1]
    f.turn[count[0]], f.turn[AZIMUTHS + count[0]] = 1.0 - 2.0 * sh * sh, 2.0 * sh * ch
    count[0] += 1
    if count[0] == AZIMUTHS:
        add_samples(f, count)


cdef void finish_orders(const Arrays* f, int* count) noexcept nogil:
    """R^m (order, 16) of all azimuths that were added."""
    cdef int m, k
    cdef doubles low, high, out = f.out
    add_samples(f, count)
    for m in range(f.n_order):
        for k in range(4):      # rows I, Q: even, even, odd, odd; rows U, V the other way round
            low, high = f.sums + 8 * m + 2 * k, f.sums + 8 * (f.n_order + m) + 2 * k
            if k > 1:
                low, high = high, low
            out[0], out[1], out[2], out[3] = low[0], low[1], high[0], high[1]
            out += 4


cdef void facet_piece(const Arrays* f, const Pair* p, double start, double end, int root_at, double longest,
                      int* count) noexcept nogil:
    """Adds a piece of azimuth; at its end (root_at 1) or start (-1) may be a square root, which t^2 makes smooth."""
    cdef int pieces = 1 + <int>((end - start) / longest), k, j
    cdef double size = (end - start) / pieces, x, half, sh, ch, weight
    cdef double z[4][4]
    for k in range(pieces):
        for j in range(f.n_point):
            x, weight = f.points[j], 2.0 * f.point_weights[j] * size
            if root_at < 0 and k == 0:
                weight *= 2.0 * x
                x *= x
            elif root_at > 0 and k == pieces - 1:
                weight *= 2.0 * x
                x = 1.0 - x * x
            half = 0.5 * (start + (k + x) * size)
            sh, ch = sin(half), cos(half)
            facet_mueller(f, p, sh, ch, weight, z)
            add_azimuth(f, sh, ch, z, count)


cdef void add_samples(const Arrays* f, int* count) noexcept nogil:
    """sums += f cos(m phi), f sin(m phi), and begins anew."""
    cdef int m, k, n = count[0]
    cdef double angle
    cdef given c = f.turn, s = f.turn + AZIMUTHS
    cdef doubles cosine = f.multiples, sine = f.multiples + <size_t>f.n_order * AZIMUTHS
    count[0] = 0
    if n == 0:
        return
    for k in range(n):
        cosine[k], sine[k] = 1.0, 0.0
        if f.first_order > 0:
            angle = f.first_order * atan2(s[k], c[k])
            cosine[k], sine[k] = cos(angle), sin(angle)
    for m in range(1, f.n_order):
        for k in range(n):
            cosine[AZIMUTHS + k] = cosine[k] * c[k] - sine[k] * s[k]
            sine[AZIMUTHS + k] = sine[k] * c[k] + cosine[k] * s[k]
        cosine += AZIMUTHS
        sine += AZIMUTHS
    multiply_apart(n, f.n_order, f.even_samples, f.multiples, f.sums)
    multiply_apart(n, f.n_order, f.odd_samples, f.multiples + <size_t>f.n_order * AZIMUTHS, f.sums + 8 * f.n_order)


cdef void multiply_apart(int n, int n_order, given samples, given multiples, doubles sums) noexcept nogil:
    """sums (order, 8) += multiples (order, AZIMUTHS) samples (azimuth, 8), of the first n azimuths."""
    cdef int eight = 8, leading = AZIMUTHS
    cdef double one = 1.0
    dgemm(b"N", b"N", &eight, &n_order, &n, &one, <doubles>samples, &eight, <doubles>multiples, &leading, &one, sums,
          &eight)


cdef void facet_mueller(const Arrays* f, const Pair* g, double sh, double ch, double weight,
                        double (*z)[4]) noexcept nogil:
    """z: weight times f at an azimuth whose half has the sine sh and the cosine ch, as in vrte/optics/facets.py."""
    cdef double full = 2.0 * sh * ch, n = f.index
    cdef double across = g.across + g.apart * sh * sh, tilt = across / g.vertical, strength = weight * g.common
    cdef double size, less, ci, co, a_i, b_i, a_o, b_o
    cdef cplx p, s, m = make(f.index, f.absorption)
    if f.is_ggx:
        strength *= ((1.0 + tilt) / (1.0 + tilt / steep_of(f))) ** 2
    else:
        strength *= exp(-tilt / steep_of(f)) * (1.0 + tilt) * (1.0 + tilt)
    size = across + g.vertical
    a_i, a_o = -g.sine_o * full, -g.sine_i * full
    if f.transmitted:
        # 1 - k_i k_o
        less = 0.5 * ((g.sine_i - g.sine_o) ** 2 + (g.mu_i - g.mu_o) ** 2) + 2.0 * g.sine_i * g.sine_o * sh * sh
        size = sqrt(size)
        ci, co = fabs(n - 1.0 - n * less) / size, fabs(n - 1.0 + less) / size
        strength *= ci * co / (size * size) * (n * co / ci)
        p = make(2.0 * ci / (n * ci + co), 0.0)
        s = make(2.0 * ci / (ci + n * co), 0.0)
        b_i = -2.0 * g.mu_i * g.sine_o * sh * sh - g.between
        b_o = 2.0 * g.mu_o * g.sine_i * sh * sh - g.between
    else:
        ci = 0.5 * sqrt(size)
        reflect_flat(m, ci, &p, &s)
        b_i = 2.0 * g.mu_i * g.sine_o * ch * ch + g.between
        b_o = 2.0 * g.mu_o * g.sine_i * ch * ch - g.between
    if a_i * a_i + b_i * b_i == 0.0 or a_o * a_o + b_o * b_o == 0.0:     # parallel: r of what comes
        a_i, b_i = 0.0, 1.0
        a_o, b_o = (g.mu_o if f.transmitted else -g.mu_o) * full, 1.0 - 2.0 * sh * sh
    turn_to_meridians(strength, p, s, a_i, b_i, a_o, b_o, z)


cdef void turn_to_meridians(double strength, cplx p, cplx s, double a_i, double b_i, double a_o, double b_o,
                            double (*z)[4]) noexcept nogil:
    """z: strength times what amplitudes p and s do to Stokes vectors in meridian planes; s lies along (a, b) in l and r
    of light in and out."""
    cdef double a, b, re, im
    a = 0.5 * strength * (p.real * p.real + p.imag * p.imag)
    b = 0.5 * strength * (s.real * s.real + s.imag * s.imag)
    re = strength * (p.real * s.real + p.imag * s.imag)
    im = strength * (p.imag * s.real - p.real * s.imag)
    turn_elements(a + b, a - b, re, im, a_i, b_i, a_o, b_o, z)


cdef void turn_elements(double a, double b, double re, double im, double a_i, double b_i, double a_o, double b_o,
                        double (*z)[4]) noexcept nogil:
    """The same of a Mueller matrix with the elements 11, 12, 33 and 34 in the plane of incidence."""
    cdef double norm, c2, s2, d2, e2
    norm = 1.0 / (a_i * a_i + b_i * b_i)
    c2, s2 = (b_i - a_i) * (b_i + a_i) * norm, -2.0 * a_i * b_i * norm
    norm = 1.0 / (a_o * a_o + b_o * b_o)
    d2, e2 = (b_o - a_o) * (b_o + a_o) * norm, -2.0 * a_o * b_o * norm
    z[0][0], z[0][1], z[0][2], z[0][3] = a, b * c2, b * s2, 0.0
    z[1][0], z[1][1] = d2 * b, d2 * a * c2 + e2 * re * s2
    z[1][2], z[1][3] = d2 * a * s2 - e2 * re * c2, -e2 * im
    z[2][0], z[2][1] = e2 * b, e2 * a * c2 - d2 * re * s2
    z[2][2], z[2][3] = e2 * a * s2 + d2 * re * c2, d2 * im
    z[3][0], z[3][1], z[3][2], z[3][3] = 0.0, im * s2, -im * c2, re


cdef void reflect_flat(cplx m, double c, cplx* p, cplx* s) noexcept nogil:
    """Fresnel's r_p, r_s of a flat surface of relative index m where c is the cosine of incidence."""
    cdef vrte_complex r_p, r_s
    vrte_fresnel(pair(m), c, &r_p, &r_s)
    p[0], s[0] = of_pair(r_p), of_pair(r_s)


cdef int facet_shares_one(Arrays* f, int item, Workspace desk) noexcept nogil:
    """The integral over the angle of incidence on facets in pieces, each by Gauss's rule in what makes roots at both
    ends smooth."""
    cdef double mu = f.mu_i[0], sine = sqrt((1.0 - mu) * (1.0 + mu)), start, size, x, weight
    cdef double lit = shade(f, mu) if f.shadowing else 1.0
    cdef doubles edges = f.edges
    cdef int k, j
    set_zero(6, f.shares)
    for k in range(f.n_edge - 1):
        start, size = edges[k], edges[k + 1] - edges[k]
        if size < 1e-13:
            continue
        for j in range(f.n_point):
            x = f.points[j]
            weight = 6.0 * x * (1.0 - x) * f.point_weights[j] * size
            facets_around(f, mu, sine, lit, start + x * x * (3.0 - 2.0 * x) * size, weight, f.ends, f.shares)
    return 0


cdef void facets_around(const Arrays* f, double mu, double sine, double lit, double angle, double weight, doubles ends,
                        doubles out) noexcept nogil:
    """Adds the facets that light along mu meets at that angle of incidence, by their azimuth around it, 0 where they
    are the most upright: in pieces between the slopes given, and where reflected light turns below the horizon, and
    refracted light does, or is as low as what comes."""
    cdef double n = f.index, c = cos(angle), a = c * mu, b = sin(angle) * sine, h, tilt, turn, w, up, through
    cdef double bent = 0.0, mu_o, flat, skew, start, end, lowest = 0.0, edge
    cdef int k, j, count = 0
    cdef cplx p, s
    cdef bint total = f.absorption != 0.0 or (n - 1.0) * (n + 1.0) + c * c < 0.0
    reflect_flat(make(n, f.absorption), c, &p, &s)
    flat = 0.5 * (p.real * p.real + p.imag * p.imag + s.real * s.real + s.imag * s.imag)
    skew = 0.5 * (p.real * p.real + p.imag * p.imag - s.real * s.real - s.imag * s.imag)
    for k in range(f.n_slope):
        ends[k] = 1.0 / sqrt(1.0 + f.slopes[k] * f.slopes[k] * steep_of(f))
    count = f.n_slope
    ends[count] = 0.5 * mu / c if c > 0.0 else 1.0
    count += 1
    if not total:
        bent = sqrt((n - 1.0) * (n + 1.0) + c * c) - c
        if bent != 0.0:
            ends[count], ends[count + 1] = -mu / bent, mu * (n - 1.0) / bent
            count += 2
    if not f.is_ggx:
        lowest = 1.0 / sqrt(1.0 + f.reach * f.reach * steep_of(f))
    for k in range(1, count):       # upright facets first
        edge, j = ends[k], k
        while j > 0 and ends[j - 1] < edge:
            ends[j] = ends[j - 1]
            j -= 1
        ends[j] = edge
    ends[count] = lowest
    weight *= 2.0 * lit * c * sin(angle) / (PI * steep_of(f) * mu)
    start = 0.0
    for k in range(count + 1):
        edge = max(ends[k], lowest)
        if a + b <= edge or start == PI:
            continue
        end = PI if a - b >= edge else acos(min(max((edge - a) / b, -1.0), 1.0))
        for j in range(f.n_point if end > start else 0):
            turn = cos(start + f.points[j] * (end - start))
            h = a + b * turn
            turn = 2.0 * turn * turn - 1.0
            tilt = max((1.0 - h) * (1.0 + h) / (h * h), 0.0) / steep_of(f)
            w = weight * f.point_weights[j] * (end - start) / (h * h * h * h)
            w *= exp(-tilt) if not f.is_ggx else 1.0 / ((1.0 + tilt) * (1.0 + tilt))
            mu_o = min(2.0 * c * h - mu, 1.0)
            up = 0.0 if mu_o <= 0.0 else shade(f, mu_o) if f.shadowing else 1.0
            through = 1.0
            if not total:
                mu_o = min((mu + bent * h) / n, 1.0)
                if mu_o <= 0.0:
                    through = 0.0
                elif f.hiding:
                    through = shade(f, mu_o)
                    if f.hiding == 2:
                        through = min(through, lit) / lit
            out[0] += w * flat * up
            out[1] += w * skew * turn * up
            out[2] += w * (1.0 - flat) * through
            out[3] -= w * skew * turn * through
            out[4] += w * (flat * (1.0 - up) + (1.0 - flat) * (1.0 - through))
            out[5] -= w * skew * turn * (up - through)
        start = end
