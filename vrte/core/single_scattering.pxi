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


def series_table(const double[:, :] coefficients, int apiece=1):
    """The phase matrix with coefficients (terms, 6) as `add_single_scattering` takes it, (terms, SERIES), terms made
    even: the factors of the recurrences, then the coefficients. Of ``apiece`` matrices with as many terms each, one
    behind the other, their tables in the same way."""
    cdef int terms = <int>coefficients.shape[0] // apiece, l, i, even = terms + terms % 2, first, at
    cdef double[:, ::1] table = np.zeros((apiece * even, SERIES))
    cdef double degree, here, above  # degree: the square of an int ends at 46340
    for l in range(terms):
        degree = l
        table[l, 0], table[l, 1] = (2.0 * degree + 1.0) / (degree + 1.0), degree / (degree + 1.0)
        if l >= 2:
            here, above = sqrt(degree * degree - 4.0), sqrt((degree + 1.0) * (degree + 1.0) - 4.0)
            table[l, 2], table[l, 3] = (2.0 * degree + 1.0) / above, here / above
            table[l, 4] = (2.0 * degree + 1.0) * (degree + 1.0) / (above * above)
            table[l, 5] = 4.0 * (2.0 * degree + 1.0) / (degree * above * above)
            table[l, 6] = (degree + 1.0) * here * here / (degree * above * above)
        for i in range(1, apiece):
            memcpy(&table[i * even + l, 0], &table[l, 0], 7 * sizeof(double))
        for i in range(apiece):
            first, at = i * even + l, i * terms + l
            table[first, 7], table[first, 8] = coefficients[at, 0], coefficients[at, 3]
            table[first, 9], table[first, 10] = coefficients[at, 4], coefficients[at, 5]
            table[first, 11] = coefficients[at, 1] + coefficients[at, 2]
            table[first, 12] = coefficients[at, 1] - coefficients[at, 2]
    return np.asarray(table)


def sum_elements(const double[:, ::1] table, const double[::1] cosine):
    """F11, F44, F12, F34, F22 + F33 and F22 - F33 (6, n) at cosines of the scattering angle (n,), by the plain
    recurrences of a table of `series_table`."""
    cdef double[:, ::1] out = np.zeros((6, cosine.shape[0]))
    cdef int terms = <int>table.shape[0]
    if terms and cosine.shape[0]:
        with nogil:
            vrte_elements_best(True)(has_intensity_alone(&table[0, 0], terms), terms, &table[0, 0], 
                                     <int>cosine.shape[0], &cosine[0], &out[0, 0], cosine.shape[0])
    return np.asarray(out)


def path_integrals(*, const double[::1] above, const double[::1] thickness, const double[::1] level,
                   const int[::1] level_layer, const int[::1] chosen, const double[::1] mu0, const double[::1] mu,
                   int slab_stacks=1):
    """Optical path integrals of one scattering in each layer, (layer, chosen, n_in, n_mu); mu signed, > 0 up.

    The integral of e^(-t/mu0) e^(-|t - tau|/|mu|) dt/|mu| over the part of the layer that light at tau comes from.
    above, thickness (layer,); level, level_layer (n_tau,): depths below the top of a layer; chosen: which of them. Of
    several `slab_stacks` with as many layers and levels each, all of these lie one behind the other but level_layer and
    chosen, which are the same of all.
    """
    cdef int n_layer = <int>above.shape[0] // slab_stacks, n_level = <int>level.shape[0] // slab_stacks
    cdef int n_in = <int>mu0.shape[0], n_mu = <int>mu.shape[0], place, row, i, j, at, layer, slab_stack
    cdef double[:, :, :, ::1] out = np.zeros((slab_stacks * n_layer, chosen.shape[0], n_in, n_mu))
    cdef double depth, length, start, way, rate, rate_in
    with nogil:
        for place in range(<int>chosen.shape[0]):
            at = level_layer[chosen[place]]
            for row in range(slab_stacks * n_layer):
                slab_stack = row // n_layer
                layer = row % n_layer
                depth = level[slab_stack * n_level + chosen[place]]
                way = path_between(layer, at, depth, &thickness[slab_stack * n_layer])
                for i in range(n_in):
                    rate_in = 1.0 / mu0[i]
                    for j in range(n_mu):
                        if mu[j] > 0.0 and layer >= at:        # light going up comes from below tau
                            rate = 1.0 / mu[j]
                            start = above[row] + depth if layer == at else above[row]
                            length = thickness[row] - depth if layer == at else thickness[row]
                            out[row, place, i, j] = (
                                exp(-start * rate_in - way * rate) * -expm1(-length * (rate_in + rate))
                                * rate / (rate_in + rate))
                        elif mu[j] < 0.0 and layer <= at:
                            rate = -1.0 / mu[j]
                            length = depth if layer == at else thickness[row]
                            if length > 0.0:
                                out[row, place, i, j] = (
                                    length * rate * exp(-above[row] * rate_in - way * rate)
                                    * exp_difference(make(-length * rate_in, 0.0), make(-length * rate, 0.0)).real)
    return np.asarray(out)


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


cdef struct Scattering:
    vrte_scatter_form* scatter
    bint scalar, apiece
    int terms, n_level, n_in, n_mu, n_angle, n_phi, n_col, n_place, first, n_here
    given_ints angle, kind, place
    given table, path, mu0, mu, cos_phi, sin_phi, sign, columns
    doubles out


# (1:5)
def add_single_scattering(crew, *, const double[:, ::1] table, const double[:, :, ::1] path, const double[::1] mu0,
                          const double[::1] mu, const double[::1] cos_phi, const double[::1] sin_phi,
                          const int[::1] angle, const double[::1] sign, const double[:, ::1] columns,
                          const int[::1] kind, const int[::1] place, int first, int last,
                          double[:, :, :, :, :, ::1] out, bint wide=True, int slab_stacks=1, bint apiece=False):
    """Adds path Z(mu, -mu0, phi) columns, Z the phase matrix of all terms between meridian planes.

    table: of `series_table`; path (n_level, n_in, n_mu): whatever multiplies Z, nothing is done where it is zero; mu0
    (n_in,) > 0: light going down; mu (n_mu,): signed public cosines; cos_phi, sin_phi (n_angle,); columns (n_col, 4).
    `wide=False` leaves AVX2 unused. Of several `slab_stacks` with as many terms and levels each, tables and paths lie
    one behind another; ``apiece``: so do tables for each of mu.
    """
    cdef int n_mu = <int>mu.shape[0], tables = slab_stacks * (n_mu if apiece else 1)
    cdef int n_col = <int>columns.shape[0], n_angle = <int>cos_phi.shape[0]
    if n_col > MOST_COLUMNS:
        raise ValueError(f"at most {MOST_COLUMNS} columns")
    if table.shape[0] % 2 or table.shape[1] != SERIES:
        raise ValueError("the table must be one of series_table")
    if out.size == 0:
        return
    cdef Scattering task = Scattering(
        vrte_scatter_best(wide), has_intensity_alone(&table[0, 0], <int>table.shape[0]), apiece,
        <int>table.shape[0] // tables, <int>path.shape[0] // slab_stacks, <int>path.shape[1], n_mu,
        n_angle,
        <int>angle.shape[0], n_col, <int>out.shape[5], first, last - first, &angle[0], &kind[0], &place[0],
        &table[0, 0],
        &path[0, 0, 0], &mu0[0], &mu[0], &cos_phi[0], &sin_phi[0], &sign[0], &columns[0, 0], &out[0, 0, 0, 0, 0, 0])
    run_items(crew, scatter_pair, &task, slab_stacks * (last - first) * n_mu, 4 * n_col * n_angle, 0, NULL)


cdef bint has_intensity_alone(given table, int terms) noexcept nogil:
    """Whether a table of `series_table` has no other coefficient than a1."""
    cdef int l, k
    for l in range(terms):
        for k in range(8, SERIES):
            if table[<size_t>l * SERIES + k] != 0.0:
                return False
    return True


cdef int scatter_pair(const void* task, int item, Workspace desk) noexcept nogil:
    """All azimuths and depths of one pair of directions; z (column, Stokes, angle)."""
    cdef const Scattering* s = <const Scattering*>task
    cdef int n_angle = s.n_angle, n_col = s.n_col, n_phi = s.n_phi, n_place = s.n_place, n_level = s.n_level
    cdef int first = 0, t, f, k, i = s.first + item // s.n_mu % s.n_here
    cdef int j = item % s.n_mu
    cdef size_t each = <size_t>s.n_in * s.n_mu, pair = <size_t>i * s.n_mu + j    # levels apart; the pair's place in one
    cdef size_t level = <size_t>(item // (s.n_here * s.n_mu)) * n_level       # the first of the stack
    cdef given path = s.path + level * each + pair, sign = s.sign
    cdef size_t before = level // n_level * s.n_mu + j if s.apiece else level // n_level      # tables
    cdef given table = s.table + before * s.terms * SERIES
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
        s.scatter(s.scalar, s.terms, table, s.mu0[i], s.mu[j], min(<int>VRTE_BLOCK, n_angle - first), s.cos_phi + first,
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
