# A sphere: Bohren and Huffman, "Absorption and scattering of light by small particles" (1983), chapter 4.

cdef inline int first_settled(double size, int orders) noexcept nogil:
    """The degree from which recurrences downward, begun there with anything, have forgotten it at `orders` and at
    |z| = size."""
    return <int>(fmax(size, orders) + 8.0 * cbrt(size) + 16.0)


def sphere_coefficients(cplx relative_index, double size, int orders):
    """a_n and b_n, (2, orders) from n = 1, of a sphere of size parameter `size`; Bohren and Huffman (4.88).

    Each recurrence runs the way it is stable: D_n(mx) = psi_n'/psi_n downward (4.89), y_n upward, psi_n upward to n = x
    and beyond it by psi_n/psi_(n-1), found downward.
    """
    cdef cplx[:, ::1] found = np.empty((2, orders), np.complex128)
    cdef cplx[::1] slope = np.empty(orders + 1, np.complex128)
    cdef double[::1] ratio = np.empty(orders + 1)
    cdef cplx z = times(relative_index, make(size, 0.0)), d = make(0.0, 0.0), sum_, factor
    cdef double r = 0.0, psi, psi_before, psi_next, y, y_before, y_next, over_x
    cdef int n
    with nogil:
        for n in range(first_settled(size_of(z), orders), 0, -1):
            if n <= orders:
                slope[n] = d
            sum_ = d + over(make(n, 0.0), z)
            if size_of(sum_) == 0.0:
                sum_ = make(1e-30, 0.0)   # a pole of the next D, on its very place
            d = over(make(n, 0.0), z) - over(make(1.0, 0.0), sum_)
        for n in range(first_settled(size, orders), 0, -1):
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
            factor = over(slope[n], relative_index) + over_x
            found[0, n - 1] = over(factor * psi - psi_before, times(factor, make(psi, y)) - make(psi_before, y_before))
            factor = times(slope[n], relative_index) + over_x
            found[1, n - 1] = over(factor * psi - psi_before, times(factor, make(psi, y)) - make(psi_before, y_before))
    return np.asarray(found)
