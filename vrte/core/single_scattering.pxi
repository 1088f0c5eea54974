# Single scattering over all Fourier orders in closed form, added straight into the result; as in sums.pxi.

cdef extern from "core/scattering.h":
    const int VRTE_BLOCK
    ctypedef void vrte_scatter_form(bint, int, const double*, double, double, int, const double*, const double*, int,
                                    const int*, const double*, double*, size_t) noexcept nogil
    vrte_scatter_form* vrte_scatter_best(bint wide) noexcept nogil
    ctypedef void vrte_elements_form(bint, int, const double*, int, const double*, double*, size_t) noexcept nogil
    vrte_elements_form* vrte_elements_best(bint wide) noexcept nogil

# which copies of loops this processor runs; those of wide.h are there twice
CPU_VARIANT = ("single scattering, small matrices and gains of modes by AVX2 and FMA"
               if vrte_scatter_best(True) != vrte_scatter_best(False) else "one for all processors")


def series_table(coefficients, int apiece=1):
    """The phase matrix with coefficients (terms, 6) as `add_single_scattering` takes it, (terms, SERIES), terms made
    even: the factors of the recurrences, then the coefficients. Of ``apiece`` matrices with as many terms each, one
    behind the other, their tables in the same way."""
    cdef int terms = coefficients.shape[0] // apiece
    return fill_series(coefficients, apiece, apiece * (terms + terms % 2))


cdef int fill_series_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    cdef int k, apiece = t.apiece, terms = t.n_term // apiece, even = t.n_series // apiece, l, i
    cdef doubles to
    cdef const char* row
    cdef double degree, here, above  # degree: the square of an int ends at 46340
    cdef double c[6]
    for l in range(terms):
        degree = l
        here, above = sqrt(max(degree * degree - 4.0, 0.0)), sqrt(max((degree + 1.0) * (degree + 1.0) - 4.0, 1.0))
        for i in range(apiece):
            to = t.table + (<size_t>i * even + l) * SERIES
            to[0], to[1] = (2.0 * degree + 1.0) / (degree + 1.0), degree / (degree + 1.0)
            if l >= 2:
                to[2], to[3] = (2.0 * degree + 1.0) / above, here / above
                to[4] = (2.0 * degree + 1.0) * (degree + 1.0) / (above * above)
                to[5] = 4.0 * (2.0 * degree + 1.0) / (degree * above * above)
                to[6] = (degree + 1.0) * here * here / (degree * above * above)
            row = t.expansions + (<size_t>i * terms + l) * t.expansions_strides[0]
            for k in range(6):
                c[k] = (<given>(row + k * t.expansions_strides[1]))[0]
            to[7], to[8], to[9], to[10], to[11], to[12] = c[0], c[3], c[4], c[5], c[1] + c[2], c[1] - c[2]
    return 0


cdef int sum_elements_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    cdef int terms = t.n_series
    if terms > 0:
        vrte_elements_best(True)(has_intensity_alone(t.table, terms), terms, t.table, t.n_angle, t.cosine,
                                 t.elements, t.n_angle)
    return 0


cdef int path_integrals_one(Arrays* t, int chosen, Workspace desk) noexcept nogil:
    cdef int n_layer = t.n_layer, at = t.level_layer[t.chosen[0]], i, j, layer, row, scene
    cdef double depth, length, start, way, rate, rate_in, mu
    cdef doubles out
    for row in range(t.slab_stacks * n_layer):
        scene, layer = row // n_layer, row % n_layer
        depth = t.level[scene * t.n_level + t.chosen[0]]
        way = path_between(layer, at, depth, t.thickness + scene * n_layer)
        out = t.paths + (<size_t>row * t.n_chosen + chosen) * t.n_in * t.n_mu
        for i in range(t.n_in):
            rate_in = 1.0 / t.mu0[i]
            for j in range(t.n_mu):
                mu = t.mu[j]
                if mu > 0.0 and layer >= at:        # light going up comes from below tau
                    rate = 1.0 / mu
                    start = t.above[row] + depth if layer == at else t.above[row]
                    length = t.thickness[row] - depth if layer == at else t.thickness[row]
                    out[i * t.n_mu + j] = (
                        exp(-start * rate_in - way * rate) * -expm1(-length * (rate_in + rate))
                        * rate / (rate_in + rate))
                elif mu < 0.0 and layer <= at:
                    rate = -1.0 / mu
                    length = depth if layer == at else t.thickness[row]
                    if length > 0.0:
                        out[i * t.n_mu + j] = (
                            length * rate * exp(-t.above[row] * rate_in - way * rate)
                            * vrte_exp_difference(-length * rate_in, -length * rate))
    return 0


cdef double path_between(int layer, int at, double depth, given thickness) noexcept nogil:
    """Optical depth between a level and the nearer face of a layer, 0 inside it: a sum of thicknesses, never a
    difference of depths, whose last place would be seen along a cosine of 1e-8."""
    cdef int i
    cdef double way
    if layer == at:
        return 0.0
    way = thickness[at] - depth if layer > at else depth
    for i in range(min(layer, at) + 1, max(layer, at)):
        way += thickness[i]
    return way


# (1:5)
cdef Job add_single_scattering_job(Arrays* t) noexcept nogil:
    if t.n_col > MOST_COLUMNS:
        t.wrong = b"there are too many columns"
    elif t.n_series % 2:
        t.wrong = b"the table must be one of series_table"
    t.scalar = has_intensity_alone(t.table, t.n_series)
    return Job(<size_t>t.slab_stacks * max(t.last - t.first, 0) * t.n_mu if t.n_phi > 0 and t.n_target > 0 else 0,
               <size_t>4 * t.n_col * t.n_angle, 0)


cdef bint has_intensity_alone(given table, int terms) noexcept nogil:
    """Whether a table of `series_table` has no other coefficient than a1."""
    cdef int l, k
    for l in range(terms):
        for k in range(8, SERIES):
            if table[<size_t>l * SERIES + k] != 0.0:
                return False
    return True


cdef int add_single_scattering_one(const Arrays* s, int item, Workspace desk) noexcept nogil:
    """All azimuths and depths of one pair of directions; z (column, Stokes, angle)."""
    cdef int n_angle = s.n_angle, n_col = s.n_col, n_phi = s.n_phi, n_place = s.n_target, n_level = s.n_level
    cdef int first = 0, n_here = s.last - s.first, t, f, k, i = s.first + item // s.n_mu % n_here
    cdef int terms = s.n_series // (s.slab_stacks * (s.n_mu if s.apiece else 1))
    cdef int j = item % s.n_mu
    cdef size_t each = <size_t>s.n_in * s.n_mu, pair = <size_t>i * s.n_mu + j    # levels apart; the pair's place in one
    cdef size_t level = <size_t>(item // (n_here * s.n_mu)) * n_level       # the first of the stack
    cdef given path = s.path + level * each + pair, sign = s.sign
    cdef size_t before = level // n_level * s.n_mu + j if s.apiece else level // n_level      # tables
    cdef given table = s.table + before * terms * SERIES
    cdef given_ints angle = s.angle
    cdef doubles z = desk.work
    cdef double strength
    cdef int target[MOST_ENTRIES]
    cdef double factor[2][MOST_ENTRIES]     # as computed, and mirrored
    cdef doubles to
    cdef given now
    cdef bint lit = False
    for t in range(n_level):
        lit = lit or path[t * each] != 0.0
    if not lit:
        return 0
    while first < n_angle:
        vrte_scatter_best(s.wide)(
            s.scalar, terms, table, s.mu0[i], s.mu[j], min(<int>VRTE_BLOCK, n_angle - first), s.cos_phi + first,
            s.sin_phi + first, n_col, s.kind, s.columns, z + first, n_angle)
        first += VRTE_BLOCK
    for t in range(n_level):
        strength = path[t * each]
        if strength == 0.0:
            continue
        for k in range(4 * n_col):
            target[k] = k % 4 * n_place + s.place[k // 4]
            factor[0][k] = strength
            factor[1][k] = strength if (k % 4 >= 2) == (s.kind[k // 4] == 1) else -strength
        to = s.out + ((level + t) * each + pair) * n_phi * 4 * n_place
        for f in range(n_phi):
            now = &factor[sign[f] < 0.0][0]
            for k in range(4 * n_col):
                to[target[k]] += now[k] * z[<size_t>k * n_angle + angle[f]]
            to += 4 * n_place
    return 0


cdef int see_scattered_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    """All azimuths of one pair of directions: escape and power are one matrix that acts on the elements of Z."""
    cdef int i = item // t.n_seen, n_col = t.n_col, source, a, b, c, d, elements = 16, wide = 4 * n_col
    cdef double one = 1.0
    cdef given power, escape, scattered
    cdef doubles acts = t.acts
    for source in range(t.n_source):
        power = t.power + (<size_t>source * t.n_in + i) * wide
        for b in range(4):
            for a in range(4):
                escape = t.escapes + (<size_t>a * t.n_source + source) * 4
                for c in range(4):
                    for d in range(n_col):
                        acts[(4 * b + c) * wide + a * n_col + d] = escape[b] * power[c * n_col + d]
        if largest_of(elements * wide, acts) > 0.0:
            scattered = t.scattered + (((<size_t>t.scatterer_of[source] * t.n_in + i) * t.n_sight + t.sight_of[0])
                                       * t.n_phi * elements)
            dgemm(b"N", b"N", &wide, &t.n_phi, &elements, &one, acts, &wide, <doubles>scattered, &elements, &one,
                  t.seen, &wide)
    return 0

