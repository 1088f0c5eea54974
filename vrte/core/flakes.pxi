# Oriented flakes: Fourier orders of what they scatter, a pair of directions at a time (vrte/optics/flakes.py has the
# same in closed form, azimuth by azimuth). The flakes that turn light from one direction into another have one slope in
# the plane of both normals and any slope v across it: sin^2 of half the azimuth is (v D)^2/(4 sin sin), D the change
# of the cosine. So azimuths are integrated over between the tilts at which the density is smooth.


cdef int flake_orders_one(Arrays* f, int item, Workspace desk) noexcept nogil:
    """The integral over azimuth in pieces of Gauss's rule between tilts, no wider than the highest order allows."""
    cdef double mu_i = f.mu_i[0], mu_o = f.mu_o[0], start = 0.0, stop, end, size, half, sine, longest
    cdef double slope, least
    cdef int edge, k, j, pieces, count = 0
    cdef Pair g
    cdef double z[4][4]
    set_zero(<size_t>f.n_order * 16, f.sums)
    set_zero(<size_t>f.n_order * 16, f.out)
    g.mu_i, g.mu_o = mu_i, mu_o
    g.sine_i, g.sine_o = sqrt((1.0 - mu_i) * (1.0 + mu_i)), sqrt((1.0 - mu_o) * (1.0 + mu_o))
    g.vertical = (mu_o - mu_i) * (mu_o - mu_i)
    sine = g.sine_i + g.sine_o
    g.across = ((mu_i - mu_o) * (mu_i + mu_o) / sine) ** 2 if sine > 0.0 else 0.0
    g.apart, g.between = 4.0 * g.sine_i * g.sine_o, g.sine_i * mu_o - mu_i * g.sine_o
    if g.vertical == 0.0:
        return 0
    least = g.across / g.vertical
    longest = <double>f.n_point / max(1, f.first_order + f.n_order - 1)
    for edge in range(1, f.n_edge):
        slope = tan(f.edges[edge])
        slope = (slope * slope - least) * g.vertical
        if slope <= 0.0 and f.edges[edge] < 0.5 * PI:
            continue
        end = 2.0 * asin(sqrt(slope / g.apart)) if slope < g.apart and f.edges[edge] < 0.5 * PI else PI
        while start < end:      # ever wider pieces: in that of the steepest flakes azimuths may begin anywhere
            stop = min(end, 3.0 * start) if start > 0.0 else end
            pieces = 1 + <int>((stop - start) / longest)
            size = (stop - start) / pieces
            for k in range(pieces):
                for j in range(f.n_point):
                    half = 0.5 * (start + (k + f.points[j]) * size)
                    flake_mueller(f, &g, sin(half), cos(half), 2.0 * f.point_weights[j] * size, edge, z)
                    add_azimuth(f, sin(half), cos(half), z, &count)
            start = stop
        if end == PI:
            break
    finish_orders(f, &count)
    return 0


cdef void flake_mueller(const Arrays* f, const Pair* g, double sh, double ch, double weight, int edge,
                        double (*z)[4]) noexcept nogil:
    """z: weight times Z at an azimuth whose half has the sine sh and the cosine ch; its tilt lies below that edge."""
    cdef double full = 2.0 * sh * ch, across = g.across + g.apart * sh * sh, tilt = atan(sqrt(across / g.vertical))
    cdef double cosine = min(0.5 * sqrt(across + g.vertical), 1.0), a_i, b_i, a_o, b_o, part
    cdef double m[4]
    cdef cplx p, s
    if f.roughness > 0.0:
        weight *= f.density[0] * exp(-0.5 * (tilt / f.roughness) * (tilt / f.roughness))
    else:
        part = (tilt - f.edges[edge - 1]) / (f.edges[edge] - f.edges[edge - 1])
        weight *= f.density[edge - 1] + part * (f.density[edge] - f.density[edge - 1])
    a_i, a_o = -g.sine_o * full, -g.sine_i * full
    b_i, b_o = g.between + 2.0 * g.mu_i * g.sine_o * sh * sh, g.between - 2.0 * g.sine_i * g.mu_o * sh * sh
    if a_i * a_i + b_i * b_i == 0.0 or a_o * a_o + b_o * b_o == 0.0:     # parallel: r of what comes
        a_i, b_i, a_o, b_o = 0.0, 1.0, -g.mu_o * full, 1.0 - 2.0 * sh * sh
    weight *= 0.25
    if f.mirror == NULL:
        reflect_flat(make(f.index, f.absorption), cosine, &p, &s)
        turn_to_meridians(weight, p, s, a_i, b_i, a_o, b_o, z)
    else:
        look_up(f, cosine, m)
        turn_elements(weight * m[0], weight * m[1], weight * m[2], weight * m[3], a_i, b_i, a_o, b_o, z)


cdef void look_up(const Arrays* f, double cosine, double* m) noexcept nogil:
    """Elements 11, 12, 33 and 34 of a table over cosines from 0 to 1, by the cubic through the four nearest."""
    cdef double x = cosine * (f.n_cosine - 1), a, b, c, d
    cdef int k = min(max(<int>x - 1, 0), f.n_cosine - 4), j
    cdef given row = f.mirror + 4 * k
    x -= k
    a, b = -(x - 1.0) * (x - 2.0) * (x - 3.0) / 6.0, 0.5 * x * (x - 2.0) * (x - 3.0)
    c, d = -0.5 * x * (x - 1.0) * (x - 3.0), x * (x - 1.0) * (x - 2.0) / 6.0
    for j in range(4):
        m[j] = a * row[j] + b * row[4 + j] + c * row[8 + j] + d * row[12 + j]
