# The end of a solve, added straight into the result: sums over Fourier orders, and single scattering over all of
# them in closed form. `out` (n_level, n_in, n_mu, n_phi, 4, n_place) is never copied; the incident directions
# first .. last - 1 are done, so that a caller can go through a large table in pieces that stay in the cache.
# Columns (incident Stokes vectors) lie within (I, Q), kind 0, or within (U, V), kind 1; several may share a place.
# Azimuths beyond 180 degrees are the mirror images of others: Z(-phi) = D Z(phi) D, D = diag(1, 1, -1, -1), so `angle`
# (n_phi,) names the azimuth that was computed and `sign` (n_phi,) is -1 where it is to be mirrored.

cdef enum:
    MOST_ENTRIES = 64     # columns times Stokes components
    TILE = 8              # outgoing directions of one product of matrices
    TILE_DOUBLES = 32768  # what the products of a tile should not exceed


cdef struct Entries:
    # elements of a Mueller matrix with cos(m phi) first, then those with sin: where they lie in a kernel's (column, out,
    # Stokes) and in a row of `out`
    int count, cosines
    int column[MOST_ENTRIES]
    int component[MOST_ENTRIES]
    int target[MOST_ENTRIES]
    double factor[MOST_ENTRIES]


cdef void list_entries(const int[::1] stokes, const int[::1] kind, const int[::1] place, int n_place, Entries* e) noexcept nogil:
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


cdef inline int tile_of(int n_entry, int n_angle) noexcept nogil:
    return max(1, min(<int>TILE, <int>TILE_DOUBLES // max(1, n_entry * n_angle)))


def azimuthal_work(n_order, n_col, n_stokes, n_angle):
    """Doubles of `work` that one thread of `azimuthal_sum` needs."""
    n_entry = n_col * n_stokes
    return tile_of(n_entry, n_angle) * n_entry * (n_order + n_angle)


def azimuthal_sum(const double[:, :, :, :, :, :] kernels, const int[::1] stokes, const int[::1] kind, const int[::1] place,
                  const double[:, ::1] cosine, const double[:, ::1] sine, const int[::1] angle, const double[::1] sign,
                  const int[::1] levels, const int[::1] rows, const double[::1] scale, int first, int last,
                  double[:, :, :, :, :, ::1] out, int threads, double[:, ::1] work, double[::1] seconds,
                  const int[::1] stop):
    """Adds the sum over Fourier orders of kernels times cos or sin(m phi), (1:6)-(1:8) and (1:12) without its 1/2.

    kernels (order, n_tau, n_in, n_col, n_out, S), in any order in memory, hold the Stokes components `stokes` (S,) for
    the columns of `kind` (n_col,), which go to `place` (n_col,) of out; cosine, sine (order, n_angle): times 2 for
    m > 0; levels (n_level,), rows (n_mu,): what of the kernels' n_tau and n_out is wanted; scale (n_in,): factor of
    each incident direction.
    """
    cdef int n_mu = <int>rows.shape[0], n_here = last - first, n_angle = <int>cosine.shape[1], tile, tiles, item, thread
    cdef Entries entries
    cdef double start
    if kind.shape[0] * stokes.shape[0] > MOST_ENTRIES:
        raise ValueError(f"at most {MOST_ENTRIES} columns times Stokes components")
    list_entries(stokes, kind, place, <int>out.shape[5], &entries)
    if kernels.size == 0 or out.size == 0:
        return
    tile = tile_of(entries.count, n_angle)
    tiles = (n_mu + tile - 1) // tile
    for item in prange(<int>levels.shape[0] * n_here * tiles, nogil=True, schedule="dynamic", num_threads=threads):
        thread = threadid()
        if not stop[0]:
            start = vrte_seconds()
            sum_tile(kernels, &entries, cosine, sine, angle, sign, levels[item // (n_here * tiles)],
                     first + item // tiles % n_here, rows, item % tiles * tile, min(n_mu, (item % tiles + 1) * tile),
                     scale[first + item // tiles % n_here],
                     &out[item // (n_here * tiles), first + item // tiles % n_here, 0, 0, 0, 0], <int>out.shape[5],
                     &work[thread, 0])
            seconds[thread] += vrte_seconds() - start


cdef void sum_tile(const double[:, :, :, :, :, :] kernels, const Entries* e, const double[:, ::1] cosine,
                   const double[:, ::1] sine, const int[::1] angle, const double[::1] sign, int level, int i,
                   const int[::1] rows, int begin, int end, double scale, double* out, int n_place,
                   double* work) noexcept nogil:
    """Some outgoing directions of one incident direction; out (n_mu, n_phi, 4, n_place)."""
    cdef int n_order = <int>kernels.shape[0], n_angle = <int>cosine.shape[1], n_phi = <int>angle.shape[0]
    cdef int wide = end - begin, with_cosine = wide * e.cosines, with_sine = wide * (e.count - e.cosines)
    cdef int m, k, p, f
    cdef double* a = work                                    # (order, wide, entry): cosines
    cdef double* b = a + <size_t>n_order * with_cosine       # the same for sines
    cdef double* at_cosine = b + <size_t>n_order * with_sine  # (angle, wide, entry)
    cdef double* at_sine = at_cosine + <size_t>n_angle * with_cosine
    cdef double* to
    cdef const double* from_cosine
    cdef const double* from_sine
    for m in range(n_order):
        for p in range(wide):
            for k in range(e.cosines):
                a[(<size_t>m * wide + p) * e.cosines + k] = (
                    scale * kernels[m, level, i, e.column[k], rows[begin + p], e.component[k]])
            for k in range(e.cosines, e.count):
                b[(<size_t>m * wide + p) * (e.count - e.cosines) + k - e.cosines] = (
                    scale * e.factor[k] * kernels[m, level, i, e.column[k], rows[begin + p], e.component[k]])
    if with_cosine:
        product(b"N", b"T", with_cosine, n_angle, n_order, 1.0, a, with_cosine, &cosine[0, 0], n_angle, 0.0, at_cosine,
                with_cosine)
    if with_sine:
        product(b"N", b"T", with_sine, n_angle, n_order, 1.0, b, with_sine, &sine[0, 0], n_angle, 0.0, at_sine, with_sine)
    for p in range(wide):
        to = out + <size_t>(begin + p) * n_phi * 4 * n_place
        for f in range(n_phi):
            from_cosine = at_cosine + (<size_t>angle[f] * wide + p) * e.cosines
            for k in range(e.cosines):
                to[e.target[k]] += from_cosine[k]
            from_sine = at_sine + (<size_t>angle[f] * wide + p) * (e.count - e.cosines) - e.cosines
            for k in range(e.cosines, e.count):
                to[e.target[k]] += sign[f] * from_sine[k]
            to += 4 * n_place
