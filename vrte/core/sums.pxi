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


cdef void list_entries(const int[::1] stokes, const int[::1] kind, const int[::1] place, int n_place,
                       Entries* e) noexcept nogil:
    """(1:6)-(1:8): cos in the blocks (I,Q)-(I,Q) and (U,V)-(U,V), sin in (U,V)-(I,Q), -sin in (I,Q)-(U,V)."""
    cdef int with_sine, c, s, k
    e.count = 0
    for with_sine in range(2):
        for c in range(<int>kind.shape[0]):
            for s in range(<int>stokes.shape[0]):
                if ((stokes[s] >= 2) != (kind[c] == 1)) == with_sine:
                    k = e.count
                    e.column[k], e.component[k], e.target[k] = c, s, stokes[s] * n_place + place[c]
                    e.factor[k] = -1.0 if with_sine and stokes[s] < 2 else 1.0
                    e.count += 1
        if not with_sine:
            e.cosines = e.count


cdef struct Summing:
    Entries entries
    int n_here, n_mu, tile, tiles, first, n_order, n_angle, n_phi, n_place, n_in
    given_ints angle, levels, rows
    given cosine, sine, sign, scale
    const char* kernels
    Py_ssize_t strides[6]
    doubles out


def azimuthal_sum(crew, *, const double[:, :, :, :, :, :] kernels, const int[::1] stokes, const int[::1] kind,
                  const int[::1] place, const double[:, ::1] cosine, const double[:, ::1] sine,
                  const int[::1] angle, const double[::1] sign, const int[::1] levels, const int[::1] rows,
                  const double[::1] scale, int first, int last, double[:, :, :, :, :, ::1] out):
    """Adds the sum over Fourier orders of kernels times cos or sin(m phi), (1:6)-(1:8) and (1:12) without its 1/2.

    kernels (order, n_tau, n_in, n_col, n_out, S), in any order in memory, hold the Stokes components `stokes` (S,) for
    the columns of `kind` (n_col,), which go to `place` (n_col,) of out; cosine, sine (order, n_angle): times 2 for
    m > 0; levels (n_level,), rows (n_mu,): what of the kernels' n_tau and n_out is wanted; scale (n_in,): factor of
    each incident direction.
    """
    cdef Summing task
    cdef int n_angle = <int>cosine.shape[1], n_mu = <int>rows.shape[0], k
    if kind.shape[0] * stokes.shape[0] > MOST_ENTRIES:
        raise ValueError(f"at most {MOST_ENTRIES} columns times Stokes components")
    if kernels.size == 0 or out.size == 0:
        return
    list_entries(stokes, kind, place, <int>out.shape[5], &task.entries)
    task.n_here, task.n_mu, task.first, task.n_in = last - first, n_mu, first, <int>out.shape[1]
    task.tile = max(1, min(<int>TILE, <int>TILE_DOUBLES // max(1, task.entries.count * n_angle)))
    task.tiles = (n_mu + task.tile - 1) // task.tile
    task.n_order, task.n_angle = <int>kernels.shape[0], n_angle
    task.n_phi, task.n_place = <int>angle.shape[0], <int>out.shape[5]
    task.angle, task.levels, task.rows = &angle[0], &levels[0], &rows[0]
    task.cosine, task.sine, task.sign, task.scale = &cosine[0, 0], &sine[0, 0], &sign[0], &scale[0]
    task.kernels, task.out = <const char*>&kernels[0, 0, 0, 0, 0, 0], &out[0, 0, 0, 0, 0, 0]
    for k in range(6):
        task.strides[k] = kernels.strides[k]
    run_items(crew, sum_tile, &task, <int>levels.shape[0] * task.n_here * task.tiles,
              task.tile * task.entries.count * (task.n_order + n_angle), 0, NULL)


cdef inline double kernel_at(const Summing* t, const char* here, int order, int column, int row,
                             int component) noexcept nogil:
    return (<given>(here + order * t.strides[0] + column * t.strides[3] + row * t.strides[4]
                            + component * t.strides[5]))[0]


cdef int sum_tile(const void* task, int item, Workspace desk) noexcept nogil:
    """Some outgoing directions of one incident direction and one level."""
    cdef const Summing* t = <const Summing*>task
    cdef const Entries* e = &t.entries
    cdef int n_order = t.n_order, n_angle = t.n_angle, n_phi = t.n_phi, n_place = t.n_place
    cdef int level = item // (t.n_here * t.tiles), i = t.first + item // t.tiles % t.n_here
    cdef int begin = item % t.tiles * t.tile, end = min(t.n_mu, begin + t.tile)
    cdef int wide = end - begin, with_cosine = wide * e.cosines, with_sine = wide * (e.count - e.cosines)
    cdef const char* kernels = t.kernels + t.levels[level] * t.strides[1] + i * t.strides[2]
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
