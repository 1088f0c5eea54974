# Spheres: Bohren and Huffman, "Absorption and scattering of light by small particles" (1983), chapter 4, and, with a
# shell, section 8.1. psi_n(z) = z j_n(z) and xi_n(z) = z (j_n(z) + i y_n(z)) are their Riccati-Bessel functions.

cdef double LARGEST_WAVE = 1e60   # beyond it xi_n is scaled down: it grows like (2n/z)^n


cdef struct Waves:
    cplx z                # where
    cplx psi, psi_slope   # psi_n(z) exp(-Im z) and its derivative, times what xi is scaled down by
    cplx xi, xi_slope     # xi_n(z) exp(Im z) and its derivative, scaled down
    double scale          # of xi, by the last step


cdef inline int first_converged(double size, int orders) noexcept nogil:
    """The degree from which recurrences downward, begun there with anything, have forgotten it at `orders` and at
    |z| = size."""
    return <int>(fmax(size, orders) + 8.0 * cbrt(size) + 16.0)


cdef void find_slopes(cplx z, int orders, cplx *slope) noexcept nogil:
    """slope[n] = D_n(z) = psi_n'/psi_n for n = 1 .. orders, downward; (4.89)."""
    cdef cplx d = make(0.0, 0.0), sum_
    cdef int n
    for n in range(first_converged(size_of(z), orders), 0, -1):
        if n <= orders:
            slope[n] = d
        sum_ = d + over(make(n, 0.0), z)
        if size_of(sum_) == 0.0:
            sum_ = make(1e-30, 0.0)   # a pole of the next D, on its very place
        d = over(make(n, 0.0), z) - over(make(1.0, 0.0), sum_)


cdef void match_outside(double size, int orders, int row, double *ratio, cplx *found, cplx *gain) noexcept nogil:
    """a_n and b_n in `found`, in the place of the slopes L = u'/u of the field within the surface, divided by the
    relative index there (a_n) and times it (b_n); (4.88).

    y_n goes upward, psi_n upward to n = x and beyond it by psi_n/psi_(n-1), found downward. Rows are `row` long. In
    `gain`, unless NULL, what they change by with -L: i/(L xi_n - xi_n')^2, as psi_n xi_n' - psi_n' xi_n = i; with x
    they change by that times n(n + 1)/x^2 - 1 - L^2, the slopes' own equation.
    """
    cdef double r = 0.0, psi, psi_before, psi_next, y, y_before, y_next, over_x
    cdef cplx factor, below
    cdef int n, kind
    for n in range(first_converged(size, orders), 0, -1):
        r = 1.0 / ((2 * n + 1) / size - r)
        if n <= orders:
            ratio[n] = r
    psi_before, psi = cos(size), sin(size)            # psi_-1, psi_0
    y_before, y = sin(size), -cos(size)               # x y_-1, x y_0: xi_n = psi_n + i x y_n
    for n in range(1, orders + 1):
        over_x = n / size
        psi_next = (2 * n - 1) / size * psi - psi_before if n <= size else ratio[n] * psi
        y_next = (2 * n - 1) / size * y - y_before
        psi_before, psi, y_before, y = psi, psi_next, y, y_next
        for kind in range(2):
            factor = found[kind * row + n - 1] + over_x
            below = times(factor, make(psi, y)) - make(psi_before, y_before)
            found[kind * row + n - 1] = over(factor * psi - psi_before, below)
            if gain != NULL:
                gain[kind * row + n - 1] = over(over(make(0.0, 1.0), below), below)


cdef int find_spheres_one(Arrays* t, int k, Workspace desk) noexcept nogil:
    cdef cplx* gain = <cplx*>t.gain if t.n_number > 1 else NULL
    if t.core_indices == NULL:
        find_sphere_coefficients((<cplx*>t.indices)[0], t.sizes[0], t.degrees[0], t.n_degree, <cplx*>t.series,
                                 <cplx*>t.slope_of_psi, t.ratio, gain)
    else:
        find_coated_coefficients((<cplx*>t.core_indices)[0], (<cplx*>t.indices)[0], t.core_sizes[0], t.sizes[0],
                                 t.degrees[0], t.n_degree, <cplx*>t.series, <cplx*>t.slope_of_psi, t.ratio, gain)
    return 0


def sphere_coefficients(relative_indices, sizes, orders):
    """a_n and b_n, (sizes, 2, orders) from n = 1, of spheres of size parameters `sizes`, 0 beyond the `orders` (sizes,)
    of each; Bohren and Huffman (4.88)."""
    return find_spheres(relative_indices, sizes, orders, 1, np.max(orders))[:, 0]


def sphere_slopes(relative_index, size, orders):
    """The same of one sphere and their derivatives with the relative index and with the size parameter,
    (3, 2, orders)."""
    return find_spheres(*as_arrays(relative_index, size, orders), 3, orders)[0]


def coated_sphere_coefficients(core_indices, shell_indices, core_sizes, sizes, orders):
    """a_n and b_n, (sizes, 2, orders) from n = 1, of cores in shells, `sizes` the size parameters of the whole and both
    indices relative to the host's, 0 beyond the `orders` (sizes,) of each; Bohren and Huffman (8.2)."""
    return find_spheres(shell_indices, sizes, orders, 1, np.max(orders), core_indices, core_sizes)[:, 0]


def coated_sphere_slopes(core_index, shell_index, core_size, size, orders):
    """The same of one sphere and their derivatives with the core's index, the shell's, the core's size and the whole
    one, (5, 2, orders)."""
    core = np.array([core_index], np.complex128), np.array([core_size], float)
    return find_spheres(*as_arrays(shell_index, size, orders), 5, orders, *core)[0]


def as_arrays(index, size, orders):
    """Those of one sphere, of length 1."""
    return np.array([index], np.complex128), np.array([size], float), np.array([orders], np.int32)


cdef void find_sphere_coefficients(cplx relative_index, double size, int orders, int row, cplx *found, cplx *slope,
                                   doubles ratio, cplx *gain) noexcept nogil:
    """found (1 or 3, 2, row); scratch slope and ratio (orders + 1,), gain (2, row) with slopes. D' = n(n + 1)/z^2 - 1 -
    D^2, and what is the same on both sides of the surface is left out of the difference."""
    cdef cplx z = times(relative_index, make(size, 0.0)), square = times(relative_index, relative_index), d, dz
    cdef double bend
    cdef int n
    find_slopes(z, orders, slope)
    for n in range(1, orders + 1):
        found[n - 1] = over(slope[n], relative_index)
        found[row + n - 1] = times(slope[n], relative_index)
    match_outside(size, orders, row, ratio, found, gain)
    if gain != NULL:
        for n in range(1, orders + 1):
            d, bend = slope[n], n / size * ((n + 1) / size)
            dz = times(z, over(make(bend, 0.0), square) - 1.0 - times(d, d))   # z D'
            found[2 * row + n - 1] = times(gain[n - 1], over(d - dz, square))
            found[3 * row + n - 1] = -times(gain[row + n - 1], dz + d)
            d = times(1.0 - over(make(1.0, 0.0), square), bend + times(d, d))
            found[4 * row + n - 1] = times(gain[n - 1], d)
            found[5 * row + n - 1] = times(gain[row + n - 1], square - 1.0)


cdef Waves begin_waves(cplx z) noexcept nogil:
    """Of n = 0, where xi_0 = -i exp(iz) and xi_0' = exp(iz)."""
    cdef Waves waves
    waves.z, waves.scale = z, 1.0
    waves.xi_slope = make(cos(z.real), sin(z.real))
    waves.xi = make(sin(z.real), -cos(z.real))
    return waves


cdef void climb(Waves *waves, int n, cplx slope) noexcept nogil:
    """From n - 1 to n: xi upward, where it grows, and psi, whose D_n is `slope`, by psi xi' - psi' xi = i."""
    cdef cplx over_z = over(make(n, 0.0), waves.z), before = waves.xi
    waves.xi = times(over_z, before) - waves.xi_slope
    waves.scale = 1.0 / LARGEST_WAVE if size_of(waves.xi) > LARGEST_WAVE else 1.0
    waves.xi, before = waves.xi * waves.scale, before * waves.scale
    waves.xi_slope = before - times(over_z, waves.xi)
    waves.psi = over(make(0.0, 1.0), waves.xi_slope - times(slope, waves.xi))
    waves.psi_slope = times(slope, waves.psi)


cdef inline cplx bend_slope(int n, cplx z, cplx slope) noexcept nogil:
    """d/dz of a slope u'/u in one medium: n(n + 1)/z^2 - 1 - (u'/u)^2."""
    return times(over(make(n, 0.0), z), over(make(n + 1, 0.0), z)) - 1.0 - times(slope, slope)


cdef void find_coated_coefficients(cplx core_index, cplx shell_index, double core_size, double size, int orders,
                                   int row, cplx *found, cplx *slopes, doubles ratio, cplx *gain) noexcept nogil:
    """found (1 or 5, 2, row); scratch as for `find_sphere_coefficients`: slopes of the core, of the shell inside and
    outside, (3, orders + 1).

    In the shell the field is u = A psi_n + B xi_n; A and B are Wronskians of u at the core with xi_n and psi_n there,
    which lose nothing where a function has a zero or the shell is thin. Both are kept without the exponential growth
    of psi_n and decay of xi_n in a medium that absorbs, and without the growth of xi_n beyond n = |z|. So u is i at the
    core, and u'/u outside changes by 1/u^2 times what it changes by there.
    """
    cdef cplx core = times(core_index, make(core_size, 0.0))
    cdef Waves inside = begin_waves(times(shell_index, make(core_size, 0.0)))
    cdef Waves outside = begin_waves(times(shell_index, make(size, 0.0)))
    cdef double spread = exp(2.0 * (inside.z.imag - outside.z.imag))   # what B xi is worth beside A psi outside
    cdef cplx contrast = over(shell_index, core_index), at_core, a, b, u, at_surface, carried, in_core, bend, part
    cdef int n, kind, number, step = 2 * row
    cdef cplx *here
    find_slopes(core, orders, slopes)
    find_slopes(inside.z, orders, slopes + orders + 1)
    find_slopes(outside.z, orders, slopes + 2 * (orders + 1))
    for n in range(1, orders + 1):
        climb(&inside, n, slopes[orders + 1 + n])
        climb(&outside, n, slopes[2 * (orders + 1) + n])
        spread = spread * (inside.scale / outside.scale) * (inside.scale / outside.scale)
        for kind in range(2):
            here = found + kind * row + n - 1
            at_core = times(slopes[n], contrast) if kind == 0 else over(slopes[n], contrast)   # u'/u
            a = inside.xi_slope - times(at_core, inside.xi)
            b = (times(at_core, inside.psi) - inside.psi_slope) * spread
            u = times(a, outside.psi) + times(b, outside.xi)
            if size_of(u) == 0.0:
                u = make(1e-30 * (size_of(a) + size_of(b)), 0.0)
            at_surface = over(times(a, outside.psi_slope) + times(b, outside.xi_slope), u)
            here[0] = over(at_surface, shell_index) if kind == 0 else times(at_surface, shell_index)
            if gain != NULL:   # of L, with the four numbers
                carried = -over(make(spread, 0.0), u)
                carried = over(carried, u)
                in_core = bend_slope(n, core, slopes[n])
                in_core = times(in_core, contrast) if kind == 0 else over(in_core, contrast)
                bend = bend_slope(n, inside.z, at_core)
                part = over(at_core, core_index)   # by the contrast alone
                here[step] = times(carried, in_core * core_size + (-part if kind == 0 else part))
                part = over(at_core, shell_index)
                here[2 * step] = bend_slope(n, outside.z, at_surface) * size + times(
                    carried, (part if kind == 0 else -part) - bend * core_size)
                here[3 * step] = times(carried, times(in_core, core_index) - times(bend, shell_index))
                here[4 * step] = times(bend_slope(n, outside.z, at_surface), shell_index)
                for number in range(1, 5):
                    part = here[number * step]
                    here[number * step] = over(part, shell_index) if kind == 0 else times(part, shell_index)
                part = over(at_surface, times(shell_index, shell_index))
                here[2 * step] = here[2 * step] + (-part if kind == 0 else at_surface)
                part = here[0]
                here[4 * step] = here[4 * step] - bend_slope(n, make(size, 0.0), part)
    match_outside(size, orders, row, ratio, found, gain)
    if gain != NULL:
        for number in range(1, 5):
            here = found + number * step
            for kind in range(2):
                for n in range(orders):
                    here[kind * row + n] = -times(gain[kind * row + n], here[kind * row + n])
