# Divided differences between the rates of a slab's modes and directions, and coefficients' derivatives from those of E
# and F. With half a slab's thickness h, p = sqrt(a), q = sqrt(b): f(a) = tanh(h p)/p, g = a f, c = 1 - f g, and
# tanh(h p) - tanh(h q) = tanh(h (p - q)) (1 - tanh(h p) tanh(h q)) leaves no difference of close numbers.

cdef enum: FLAT = 26        # terms of tanh(sqrt y)/sqrt y: 0.5^25 over the radius pi^2/4 to the same power
cdef double THIN = 0.5      # h^2 a below which f[a, b] is summed as a series
cdef double CLOSE = 0.1     # points closer than this fraction of the larger one


cdef struct Point:
    # an argument of f: x, its root, tanh(h root), f(x)
    double x, root, tangent, f


cdef struct Differences:
    double f, g, c


cdef int divided_differences_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    cdef int i, j, rows = t.n_row, columns = t.n_column
    cdef given a = t.row_points, b = t.column_points
    cdef size_t at = 0
    cdef double h = t.half
    cdef Differences d
    cdef doubles series = t.series_of_tanh
    cdef Point* points = <Point*>t.points_of_tanh
    tanh_series(series)
    for i in range(rows):
        points[i] = point_of(h, a[i])
    for j in range(columns):
        points[rows + j] = point_of(h, b[j])
    for i in range(rows):
        for j in range(columns):
            d = differences(h, series, &points[i], &points[rows + j], t.with_c)
            t.f[at], t.g[at] = d.f, d.g
            if t.with_c:
                t.c_between[at] = d.c
            at += 1
    return 0


cdef void tanh_series(doubles series) noexcept nogil:
    """Coefficients of tanh(sqrt y)/sqrt y, from tan' = 1 + tan^2 with signs that alternate."""
    cdef int i, j
    cdef double value
    series[0] = 1.0
    for i in range(1, FLAT):
        value = 0.0
        for j in range(i):
            value += series[j] * series[i - 1 - j]
        series[i] = -value / (2 * i + 1)


cdef inline Point point_of(double h, double square_of_rate) noexcept nogil:
    cdef double root = sqrt(square_of_rate), tangent = tanh(h * root) if h < SEMI_INFINITE else 1.0
    return Point(square_of_rate, root, tangent, tangent / root if root > 0.0 else h)


cdef inline Differences differences(double h, given series, const Point* a, const Point* b, bint with_c) noexcept nogil:
    """Between two points."""
    cdef double x = a.x, y = b.x, p = a.root, q = b.root, tp = a.tangent, tq = b.tangent, f, larger = max(x, y), low
    cdef Differences d = Differences(0.0, 0.0, 0.0)
    if h >= SEMI_INFINITE:
        # not absorbing: g[0, 0] is infinite, and what it is multiplied with zero
        d.f = -1.0 / (p * q * (p + q)) if p > 0.0 and q > 0.0 else 0.0
        d.g = 1.0 / (p + q) if larger > 0.0 else 0.0
        return d
    if h * h * larger < THIN:
        f = h * h * h * series_difference(series, h * h * x, h * h * y)
    elif fabs(x - y) < CLOSE * larger:
        f = (q * (1.0 - tp * tq) * tanh_over(h, p - q) - tq) / (p * q * (p + q))
    else:
        f = (a.f - b.f) / (x - y)
    d.f = f
    # from the larger point, where the two terms do not cancel
    d.g = b.f + x * f if x < y else a.f + y * f
    if with_c:
        low = exp(-2.0 * h * min(p, q))
        d.c = -square(h * (1.0 + tp) * (1.0 + tq)) * low * (decay_over(h * fabs(p - q)) * decay_over(h * (p + q)))
    return d


cdef inline double square(double x) noexcept nogil:
    return x * x


cdef inline double tanh_over(double h, double difference) noexcept nogil:
    """tanh(h d)/d."""
    cdef double x = h * difference
    return h * (1.0 - x * x / 3.0) if fabs(x) < 1e-5 else tanh(x) / difference


cdef inline double decay_over(double x) noexcept nogil:
    """(1 - e^(-2 x))/(2 x)."""
    return 1.0 if x == 0.0 else -expm1(-2.0 * x) / (2.0 * x)


cdef double series_difference(given series, double x, double y) noexcept nogil:
    """The divided difference of sum c_k y^k."""
    cdef int k
    cdef double total = 0.0, power = 1.0, term = 1.0
    for k in range(1, FLAT):
        total += series[k] * term
        if fabs(series[k] * term) < 1e-18 * fabs(total):
            break
        power *= x
        term = y * term + power
    return total


cdef int pull_scattering_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    """E and F, on nodes and directions off them, are rates less phi B phi^T, by (1:41)."""
    cdef int m = t.orders[0], terms = t.n_term, n = t.n, i, kind, columns, n_all = t.n_all, n_node = t.n_node
    cdef int rows = n + t.n_out_rows, others = n + t.n_in_rows, l
    cdef Expansion x = Expansion(parity_of(m, t.stokes, t.members), m, terms, 1.0, NULL)
    cdef doubles prt = t.prt, scale = t.scale, left = t.left, right = t.right, spare = t.spare
    if m >= terms:
        return 0
    spherical(m, terms, is_polar(x.p), t.directions, n_all, prt)
    scale_nodes(t, scale)
    for l in range(terms if m == 0 and x.p.place[0] >= 0 else 0):
        for i in range(n_all):              # `find_even_shifts` of orders/phase_assembly.py
            prt[<size_t>3 * l * n_all + i] = t.shifts[2 * l] * prt[<size_t>3 * l * n_all + i] - t.shifts[2 * l + 1]
    for kind in range(2):
        columns = columns_of(&x, kind)
        put_columns(&x, kind, prt, n_all, 0, n_node, scale, rows, 0, spare, left)
        put_columns(&x, kind, prt, n_all, 0, n_node, scale, others, 0, spare, right)
        put_columns(&x, kind, prt, n_all, n_node, t.n_out, NULL, rows, n, spare, left)
        put_columns(&x, kind, prt, n_all, n_node + t.n_out, t.n_in, NULL, others, n, spare, right)
        for l in range(columns):
            for i in range(t.n_out_rows):
                left[<size_t>l * rows + n + i] /= t.directions[n_node + i // t.stokes]
        pull_coefficients(&x, kind, -1.0, 1.0, rows, left, t.pulled_F if kind else t.pulled_E, others, right, spare,
                          t.gradient)
    return 0


cdef void put_columns(const Expansion* x, int kind, given prt, int n_all, int first, int n_mu, given scale, int rows,
                      int at, doubles spare, doubles out) noexcept nogil:
    """`parity_columns` of some directions as the rows from `at` on of a matrix of so many rows."""
    cdef int k, own = x.p.stokes * n_mu
    parity_columns(x, kind, prt, n_all, first, n_mu, scale, spare)
    for k in range(columns_of(x, kind)):
        copy(own, spare + <size_t>k * own, out + <size_t>k * rows + at)
