# The end of a solve, added straight into the result: sums over Fourier orders, and single scattering over all of
# them in closed form. `out` (n_level, n_in, n_mu, n_phi, 4, n_place) is never copied; the incident directions
# first .. last - 1 are done, so that a caller can go through a large table in pieces that stay in the cache.
# Columns (incident Stokes vectors) lie within (I, Q), kind 0, or within (U, V), kind 1; several may share a place.
# Azimuths beyond 180 degrees are the mirror images of others: Z(-phi) = D Z(phi) D, D = diag(1, 1, -1, -1), so `angle`
# (n_phi,) names the azimuth that was computed and `sign` (n_phi,) is -1 where it is to be mirrored.

cdef enum:
    TILE = 8              # outgoing directions of one product of matrices
    TILE_DOUBLES = 32768  # what the products of a tile should not exceed


cdef struct Entries:
    # elements of a Mueller matrix with cos(m phi) first, then those with sin: where they lie in a kernel's (column,
    # out, Stokes) and in a row of `out`
    int count, cosines
    int column[MOST_ENTRIES]
    int component[MOST_ENTRIES]
    int target[MOST_ENTRIES]
    double factor[MOST_ENTRIES]


cdef void list_entries(const Arrays* t, Entries* e) noexcept nogil:
    """(1:6)-(1:8): cos in the blocks (I,Q)-(I,Q) and (U,V)-(U,V), sin in (U,V)-(I,Q), -sin in (I,Q)-(U,V); (1:12)."""
    cdef int with_sine, c, s, k
    e.count = 0
    for with_sine in range(2):
        for c in range(t.n_col):
            for s in range(t.stokes):
                if ((t.members[s] >= 2) != (t.kind[c] == 1)) == with_sine:
                    k = e.count
                    e.column[k], e.component[k], e.target[k] = c, s, t.members[s] * t.n_target + t.place[c]
                    e.factor[k] = -1.0 if with_sine and t.members[s] < 2 else 1.0
                    e.count += 1
        if not with_sine:
            e.cosines = e.count


cdef inline int tile_of(const Arrays* t) noexcept nogil:
    """Outgoing directions of one item."""
    return max(1, min(<int>TILE, <int>TILE_DOUBLES // max(1, t.n_col * t.stokes * t.n_angle)))


cdef Job azimuthal_sum_job(Arrays* t) noexcept nogil:
    cdef int tile = tile_of(t)
    if t.n_col * t.stokes > MOST_ENTRIES:
        t.wrong = b"there are too many columns times Stokes components"
    if min(min(t.n_order, t.n_stored), min(t.n_kept, t.n_col)) == 0 or min(min(t.stokes, t.n_target), t.n_phi) == 0:
        return Job(0, 0, 0)
    return Job(<size_t>t.n_level * max(t.last - t.first, 0) * ((t.n_mu + tile - 1) // tile),
               <size_t>tile * t.n_col * t.stokes * (t.n_order + t.n_angle), 0)


cdef inline double kernel_at(const Arrays* t, const char* here, int order, int column, int row,
                             int component) noexcept nogil:
    return (<given>(here + order * t.kernels_strides[0] + column * t.kernels_strides[3] + row * t.kernels_strides[4]
                            + component * t.kernels_strides[5]))[0]


cdef int azimuthal_sum_one(const Arrays* t, int item, Workspace desk) noexcept nogil:
    """Some outgoing directions of one incident direction and one level."""
    cdef Entries e
    list_entries(t, &e)
    cdef int n_order = t.n_order, n_angle = t.n_angle, n_phi = t.n_phi, n_place = t.n_target
    cdef int n_here = t.last - t.first, tile = tile_of(t), tiles = (t.n_mu + tile - 1) // tile
    cdef int level = item // (n_here * tiles), i = t.first + item // tiles % n_here
    cdef int begin = item % tiles * tile, end = min(t.n_mu, begin + tile)
    cdef int wide = end - begin, with_cosine = wide * e.cosines, with_sine = wide * (e.count - e.cosines)
    cdef const char* kernels = t.kernels + t.levels[level] * t.kernels_strides[1] + i * t.kernels_strides[2]
    cdef double scale = t.scale[i]
    cdef int m, k, p, f
    cdef doubles a = desk.work                               # (order, wide, entry): cosines
    cdef doubles b = a + <size_t>n_order * with_cosine       # the same for sines
    cdef doubles at_cosine = b + <size_t>n_order * with_sine  # (angle, wide, entry)
    cdef doubles at_sine = at_cosine + <size_t>n_angle * with_cosine
    cdef doubles to
    cdef given from_cosine
    cdef given from_sine
    for m in range(n_order):
        for p in range(wide):
            for k in range(e.cosines):
                a[(<size_t>m * wide + p) * e.cosines + k] = (
                    scale * kernel_at(t, kernels, m, e.column[k], t.rows[begin + p], e.component[k]))
            for k in range(e.cosines, e.count):
                b[(<size_t>m * wide + p) * (e.count - e.cosines) + k - e.cosines] = (
                    scale * e.factor[k] * kernel_at(t, kernels, m, e.column[k], t.rows[begin + p], e.component[k]))
    if with_cosine:
        product(b"N", b"T", with_cosine, n_angle, n_order, 1.0, a, with_cosine, t.cosine, n_angle, 0.0, at_cosine,
                with_cosine)
    if with_sine:
        product(b"N", b"T", with_sine, n_angle, n_order, 1.0, b, with_sine, t.sine, n_angle, 0.0, at_sine, with_sine)
    for p in range(wide):
        to = t.out + ((<size_t>level * t.n_in + i) * t.n_mu + begin + p) * n_phi * 4 * n_place
        for f in range(n_phi):
            from_cosine = at_cosine + (<size_t>t.angle[f] * wide + p) * e.cosines
            for k in range(e.cosines):
                to[e.target[k]] += from_cosine[k]
            from_sine = at_sine + (<size_t>t.angle[f] * wide + p) * (e.count - e.cosines) - e.cosines
            for k in range(e.cosines, e.count):
                to[e.target[k]] += t.sign[f] * from_sine[k]
            to += 4 * n_place
    return 0
