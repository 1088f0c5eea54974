# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""The compiled loops: arrays in, arrays out, no class of the package, the caller owns every buffer.

Matrices are stored column by column, so in the shapes below the *last* axis is the row. `n` is S N: node by
node, S Stokes parameters inside: all four, or those of a set that mixes with no other. Inside the solver the unknowns on the nodes are scaled by
sqrt(weight mu) and the upward field is flipped by D = diag(1, 1, -1, -1) (handbook: docs/conventions.md).
s and d are the sum and the difference of the two hemispheres. (1:n) is equation n of Collin, Pattanaik and
Bouatouch, (2:n) of Budak and Efremenko.

A complex pair of modes occupies two columns, Re v and Im v, and two real coordinates y1, y2 with
s = Re[v (y1 - i y2)]: a function of lambda multiplies the complex number y1 - i y2.

Every parallel kernel runs its items (Fourier orders, or orders and layers) on `threads` OpenMP threads, gives
each thread one row of `work`, adds its seconds to `seconds`, stops early once `stop[0]` is set, and leaves
LAPACK's verdict in `info` (0: fine). No item depends on another, so results do not depend on `threads`.
"""

import numpy as np

from cython.parallel cimport prange, threadid
from libc.math cimport INFINITY, M_PI as PI, cbrt, cos, exp, expm1, fabs, fmax, hypot, sin, sqrt, tanh
from libc.string cimport memcpy, memset
from scipy.linalg.cython_blas cimport ddot, dgemm, dgemv, dtrmm, dtrsm, idamax
from scipy.linalg.cython_lapack cimport dgeevx, dgetrf, dgetri, dgetrs, dpotrf, dsyevd

cdef extern from *:
    """
    #include <time.h>
    #ifdef _OPENMP
    static const int vrte_openmp = 1;
    #else
    static const int vrte_openmp = 0;
    #endif
    static double vrte_seconds(void) {
        struct timespec now;
        clock_gettime(CLOCK_MONOTONIC, &now);
        return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
    }
    """
    const int vrte_openmp
    double vrte_seconds() noexcept nogil

HAS_OPENMP = bool(vrte_openmp)

ctypedef double complex cplx


# ---------------------------------------------------------------------------------------------------------
# Small complex functions. Divided differences of exp make every resonance (mu0 on a node, on the reciprocal
# of an eigenvalue, mu = mu0) an ordinary case.
# ---------------------------------------------------------------------------------------------------------

cdef inline cplx make(double re, double im) noexcept nogil:
    cdef cplx z
    z.real = re
    z.imag = im
    return z


cdef inline cplx times(cplx a, cplx b) noexcept nogil:
    return make(a.real * b.real - a.imag * b.imag, a.real * b.imag + a.imag * b.real)


cdef inline cplx over(cplx a, cplx b) noexcept nogil:
    """a / b; every caller keeps |b|^2 in range."""
    cdef double size
    if b.imag == 0.0:
        return make(a.real / b.real, a.imag / b.real)
    size = b.real * b.real + b.imag * b.imag
    return make((a.real * b.real + a.imag * b.imag) / size, (a.imag * b.real - a.real * b.imag) / size)


cdef inline double size_of(cplx a) noexcept nogil:
    return fabs(a.real) if a.imag == 0.0 else hypot(a.real, a.imag)


cdef inline cplx c_exp(cplx z) noexcept nogil:
    cdef double scale = exp(z.real)
    if z.imag == 0.0:
        return make(scale, 0.0)
    return make(scale * cos(z.imag), scale * sin(z.imag))


cdef inline cplx c_expm1(cplx z) noexcept nogil:
    cdef double half
    if z.imag == 0.0:
        return make(expm1(z.real), 0.0)
    half = sin(0.5 * z.imag)
    return make(expm1(z.real) * cos(z.imag) - 2.0 * half * half, exp(z.real) * sin(z.imag))


cdef inline cplx c_sqrt(cplx z) noexcept nogil:
    """The root with a non-negative real part."""
    cdef double size, re
    if z.imag == 0.0:
        return make(sqrt(z.real), 0.0) if z.real >= 0.0 else make(0.0, sqrt(-z.real))
    size = hypot(z.real, z.imag)
    if z.real >= 0.0:
        re = sqrt(0.5 * (size + z.real))
        return make(re, 0.5 * z.imag / re)
    re = 0.5 * fabs(z.imag) / sqrt(0.5 * (size - z.real))
    return make(re, 0.5 * z.imag / re)


cdef inline cplx exp_difference(cplx a, cplx b) noexcept nogil:
    """exp[a, b] = (e^a - e^b)/(a - b), and e^a where they meet."""
    cdef cplx gap
    if a.real < b.real:
        a, b = b, a
    gap = b - a
    if size_of(gap) == 0.0:
        return c_exp(a)
    if size_of(gap) > 1.0:
        return over(c_exp(b) - c_exp(a), gap)
    return times(c_exp(a), over(c_expm1(gap), gap))


cdef cplx exp_difference_2(cplx a, cplx b, cplx c) noexcept nogil:
    """exp[a, b, c], the second divided difference, for any spacing of its arguments."""
    cdef double ab = size_of(a - b), bc = size_of(b - c), ca = size_of(c - a)
    cdef cplx centre, h1, h2, h3, total, t
    cdef double factor
    cdef int i
    if ab >= bc and ab >= ca:      # the outer pair goes to a and c
        b, c = c, b
        ca = ab
    elif bc >= ca:
        a, b = b, a
        ca = bc
    if ca > 1.0:
        return over(exp_difference(a, b) - exp_difference(b, c), a - c)
    centre = (a + b + c) / 3.0
    a, b, c = a - centre, b - centre, c - centre
    h1 = h2 = h3 = total = make(1.0, 0.0)   # complete homogeneous polynomials of 1, 2, 3 offsets
    total = total * 0.5
    factor = 0.5
    for i in range(1, 18):
        h1 = times(a, h1)
        h2 = h1 + times(b, h2)
        h3 = h2 + times(c, h3)
        factor = factor / (i + 2)
        total = total + factor * h3
    return times(c_exp(centre), total)


# ---------------------------------------------------------------------------------------------------------
# Matrices stored by columns.
# ---------------------------------------------------------------------------------------------------------

cdef inline void product(char a_form, char b_form, int rows, int columns, int inner, double scale,
                         const double* a, int lda, const double* b, int ldb, double add, double* c, int ldc) noexcept nogil:
    """c = scale op(a) op(b) + add c."""
    cdef int one = 1, i, k
    cdef double factor
    if rows <= 0 or columns <= 0:
        return
    if columns == 1 and a_form == b"N" and b_form == b"N":
        if rows * inner > 4096:
            dgemv(&a_form, &rows, &inner, &scale, <double*>a, &lda, <double*>b, &one, &add, c, &one)
            return
        for i in range(rows):      # here a call of BLAS would take longer than its work
            c[i] = add * c[i] if add != 0.0 else 0.0
        for k in range(inner):
            factor = scale * b[k]
            for i in range(rows):
                c[i] += factor * a[<size_t>k * lda + i]
    else:
        dgemm(&a_form, &b_form, &rows, &columns, &inner, &scale, <double*>a, &lda, <double*>b, &ldb, &add, c, &ldc)


cdef inline int factorise(int n, double* a, int lda, int* pivots) noexcept nogil:
    cdef int info = 0
    if n > 0:
        dgetrf(&n, &n, a, &lda, pivots, &info)
    return info


cdef inline void solve(char form, int n, int columns, const double* lu, int lda, const int* pivots,
                       double* b, int ldb) noexcept nogil:
    cdef int info = 0
    if n > 0 and columns > 0:
        dgetrs(&form, &n, &columns, <double*>lu, &lda, <int*>pivots, b, &ldb, &info)


cdef inline void transpose(int n, const double* a, double* b) noexcept nogil:
    cdef int i, j
    for j in range(n):
        for i in range(n):
            b[j * n + i] = a[i * n + j]


cdef inline void scale_columns(int n, int rows, const double* lam_im, const cplx* f, const double* a, double* b) noexcept nogil:
    """b = a f: the columns of mode j, each row (Re, Im) of a pair, times f[j]."""
    cdef int i, j = 0
    cdef double fr, fi, x, y
    while j < n:
        fr, fi = f[j].real, f[j].imag
        if lam_im[j] == 0.0:
            for i in range(rows):
                b[j * rows + i] = fr * a[j * rows + i]
            j = j + 1
        else:
            for i in range(rows):
                x, y = a[j * rows + i], a[(j + 1) * rows + i]
                b[j * rows + i] = x * fr - y * fi
                b[(j + 1) * rows + i] = x * fi + y * fr
            j = j + 2


cdef inline void scale_coordinates(int n, const double* lam_im, const cplx* f, const double* y, double* out) noexcept nogil:
    """out = f y on the coordinates of one right-hand side."""
    cdef int j = 0
    cdef double a, b
    while j < n:
        a = y[j]
        if lam_im[j] == 0.0:
            out[j] = f[j].real * a
            j = j + 1
        else:
            b = y[j + 1]
            out[j] = f[j].real * a + f[j].imag * b
            out[j + 1] = f[j].real * b - f[j].imag * a
            j = j + 2


# ---------------------------------------------------------------------------------------------------------
# A sphere: Bohren and Huffman, "Absorption and scattering of light by small particles" (1983), chapter 4.
# ---------------------------------------------------------------------------------------------------------

cdef inline int first_settled(double size, int orders) noexcept nogil:
    """The degree from which recurrences downward, begun there with anything, have forgotten it at `orders` and at |z| = size."""
    return <int>(fmax(size, orders) + 8.0 * cbrt(size) + 16.0)


def sphere_coefficients(cplx relative_index, double size, int orders):
    """a_n and b_n, (2, orders) from n = 1, of a sphere of size parameter `size`; Bohren and Huffman (4.88).

    Each recurrence runs the way it is stable: D_n(mx) = psi_n'/psi_n downward (4.89), y_n upward, psi_n upward to n = x and
    beyond it by psi_n/psi_(n-1), found downward.
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


# ---------------------------------------------------------------------------------------------------------
# Spherical functions and the phase matrices A^m, (1:9).
# ---------------------------------------------------------------------------------------------------------

cdef inline double to_the_power(double x, int m) noexcept nogil:
    """x^m, m >= 0."""
    cdef double result = 1.0
    while m > 0:
        if m & 1:
            result *= x
        x *= x
        m >>= 1
    return result


cdef void wigner_starts(int m, bint polar, const double* mu, int n_mu, double* zero, double* plus, double* minus) noexcept nogil:
    """d^l_{m,0} at l = m, then d^l_{m,2} and d^l_{m,-2} at l = max(m, 2) unless the polar ones are not wanted."""
    cdef double factor = 1.0 if m % 2 == 0 else -1.0, growth = factor, sine, power
    cdef int i, j
    for j in range(1, m + 1):
        factor *= sqrt((2.0 * j - 1.0) / (2.0 * j))
    for j in range(2, m):
        growth *= 0.5 * sqrt((2.0 * j + 2.0) * (2.0 * j + 1.0) / ((j - 1.0) * (j + 3.0)))
    for i in range(n_mu):
        sine = sqrt((1.0 - mu[i]) * (1.0 + mu[i]))
        zero[i] = factor * to_the_power(sine, m)
        if not polar:
            continue
        if m == 0:
            plus[i] = minus[i] = sqrt(6.0) / 4.0 * sine * sine
        elif m == 1:
            plus[i], minus[i] = 0.5 * sine * (1.0 + mu[i]), -0.5 * sine * (1.0 - mu[i])
        else:
            power = 0.25 * growth * to_the_power(sine, m - 2)
            plus[i], minus[i] = (1.0 + mu[i]) * (1.0 + mu[i]) * power, (1.0 - mu[i]) * (1.0 - mu[i]) * power


cdef void wigner_step(int m, int k, int l, const double* mu, int n_mu, const double* before, const double* now,
                      double* after) noexcept nogil:
    """d^{l+1}_{m,k} from d^l and, above the first l, d^{l-1}; (n_mu,) each."""
    cdef double lower, upper, odd = 2.0 * l + 1.0, steep = <double>l * (l + 1.0), shift = <double>m * k
    cdef int i
    if l == 0:
        memcpy(after, mu, sizeof(double) * n_mu)
        return
    # factors that all mu share are whole numbers where m = 0: rounded ones would make P_l and 1 overlap at every node alike
    lower = (l + 1.0) * sqrt((<double>l * l - <double>m * m) * (<double>l * l - <double>k * k))
    upper = l * sqrt(((l + 1.0) * (l + 1.0) - <double>m * m) * ((l + 1.0) * (l + 1.0) - <double>k * k))
    if lower == 0.0:      # before is not there yet
        for i in range(n_mu):
            after[i] = odd * (steep * mu[i] - shift) * now[i] / upper
    else:
        for i in range(n_mu):
            after[i] = (odd * (steep * mu[i] - shift) * now[i] - lower * before[i]) / upper


cdef void spherical(int m, int terms, bint polar, const double* mu, int n_mu, double* out) noexcept nogil:
    """out (l, 3, mu) = p, r, t of the handbook for l = m .. terms - 1; r and t only if `polar`."""
    cdef int i, l, first = max(m, 2)
    cdef size_t row = 3 * n_mu
    cdef double* now
    cdef double plus, minus
    if terms <= m:
        return
    now = out + row * min(first, terms - 1)
    wigner_starts(m, polar and first < terms, mu, n_mu, out + row * m, now + n_mu, now + 2 * n_mu)
    for l in range(m, terms - 1):
        now = out + row * l
        wigner_step(m, 0, l, mu, n_mu, now - row, now, now + row)
    if not polar:
        return
    for l in range(m, min(first, terms)):
        memset(out + row * l + n_mu, 0, sizeof(double) * 2 * n_mu)
    for l in range(first, terms - 1):
        now = out + row * l + n_mu
        wigner_step(m, 2, l, mu, n_mu, now - row, now, now + row)
        wigner_step(m, -2, l, mu, n_mu, now + n_mu - row, now + n_mu, now + n_mu + row)
    for l in range(first, terms):
        now = out + row * l + n_mu
        for i in range(n_mu):
            plus, minus = now[i], now[n_mu + i]
            now[i], now[n_mu + i] = 0.5 * (plus + minus), 0.5 * (plus - minus)


def generalized_spherical_functions(int m, int terms, mu):
    """The elements of the associated Legendre matrices P_l^m (1:9)-(1:10).

    Parameters: Fourier order ``m`` >= 0, number of ``terms`` (degrees l = 0..terms-1), cosines ``mu`` (n_mu,)
    in [-1, 1]. Returns (terms, n_mu, 3): p = d^l_{m,0}, r = (d^l_{m,2} + d^l_{m,-2})/2 and
    t = (d^l_{m,2} - d^l_{m,-2})/2 with Wigner's d; zero for l < m. Raises ValueError for a negative order, no
    terms or a cosine outside [-1, 1].

    >>> generalized_spherical_functions(0, 3, [0.5])[:, 0, 0]  # Legendre polynomials
    array([ 1.   ,  0.5  , -0.125])
    """
    cdef double[::1] cosines = np.ascontiguousarray(np.atleast_1d(mu), dtype=float)
    if m < 0 or terms < 1:
        raise ValueError(f"need an order m >= 0 and at least one term, not m = {m} and {terms} terms")
    if cosines.shape[0] and not np.all(np.abs(cosines) <= 1.0):
        raise ValueError("cosines must lie in [-1, 1]")
    cdef double[:, :, ::1] out = np.zeros((terms, 3, cosines.shape[0]))
    if cosines.shape[0]:
        with nogil:
            spherical(m, terms, True, &cosines[0], <int>cosines.shape[0], &out[0, 0, 0])
    return np.ascontiguousarray(np.asarray(out).transpose(0, 2, 1))


cdef struct Parity:
    # which columns of P_l^m a set of Stokes parameters has, [l - m even or odd as asked][left, right], and where its
    # parameters lie inside a node (-1: not of the set)
    int has[2][2]
    int place[4]
    int stokes


cdef Parity parity_of(int m, int stokes, const int* members) noexcept nogil:
    """From P_l^m the left column is I, or Q and U where the parity is the other; the right one Q and U, or V."""
    cdef Parity p
    cdef int i
    cdef bint turns = m > 0          # t_l^0 = 0
    p.stokes = stokes
    for i in range(4):
        p.place[i] = -1
    for i in range(stokes):
        p.place[members[i]] = i
    p.has[0][0] = p.place[0] >= 0
    p.has[0][1] = p.place[1] >= 0 or (turns and p.place[2] >= 0)
    p.has[1][0] = p.place[2] >= 0 or (turns and p.place[1] >= 0)
    p.has[1][1] = p.place[3] >= 0
    return p


cdef inline bint is_polar(Parity p) noexcept nogil:
    """Whether Q or U is of the set: else r and t of P_l^m play no part."""
    return p.place[1] >= 0 or p.place[2] >= 0


cdef inline int columns_of(Parity p, int m, int terms, int even_kind) noexcept nogil:
    """Columns of all degrees m .. terms - 1."""
    cdef int same = (terms - m + 1) // 2, other = (terms - m) // 2    # l - m even, odd
    if even_kind != 0:
        same, other = other, same
    return max(0, same) * (p.has[0][0] + p.has[0][1]) + max(0, other) * (p.has[1][0] + p.has[1][1])


# (1:10)-(1:11)
cdef void parity_columns(Parity p, int m, int terms, int even_kind, const double* prt, int n_all, int first, int n_mu,
                         const double* scale, double* out) noexcept nogil:
    """out, S n_mu rows by `columns_of`: from P_l^m its columns I, Q where l - m has the parity of `even_kind`, else
    U, V (the rest of (1:41) cancels), those that the set has; rows times scale."""
    cdef int l, i, kind, rows = p.stokes * n_mu
    cdef size_t column = 0
    cdef double* left
    cdef double* right
    cdef const double* value
    cdef double f
    memset(out, 0, sizeof(double) * <size_t>rows * columns_of(p, m, terms, even_kind))
    for l in range(m, terms):
        kind = (l - m) % 2 != even_kind
        left = out + <size_t>rows * column
        right = left + <size_t>rows * p.has[kind][0]
        column += p.has[kind][0] + p.has[kind][1]
        for i in range(n_mu):
            value = prt + <size_t>3 * l * n_all + first + i      # p, r, t
            f = scale[i] if scale != NULL else 1.0
            if kind == 0:
                if p.place[0] >= 0:
                    left[p.stokes * i + p.place[0]] = f * value[0]
                if p.place[1] >= 0:
                    right[p.stokes * i + p.place[1]] = f * value[n_all]
                if p.place[2] >= 0 and p.has[0][1]:
                    right[p.stokes * i + p.place[2]] = -f * value[2 * n_all]
            else:
                if p.place[1] >= 0 and p.has[1][0]:
                    left[p.stokes * i + p.place[1]] = -f * value[2 * n_all]
                if p.place[2] >= 0:
                    left[p.stokes * i + p.place[2]] = f * value[n_all]
                if p.place[3] >= 0:
                    right[p.stokes * i + p.place[3]] = f * value[0]


cdef void times_coefficients(Parity p, int m, int terms, int even_kind, double factor, double v_sign,
                             const double* coefficients, int rows, const double* phi, double* out) noexcept nogil:
    """out = factor phi B^T, column by column: B_l of (1:9) cut to the kept columns; V's column of phi counts v_sign
    times."""
    cdef int l, i, kind
    cdef size_t column = 0
    cdef double b00, b01, b10, b11
    cdef const double* c
    cdef const double* x
    cdef double* y
    for l in range(m, terms):
        c = coefficients + 6 * l
        kind = (l - m) % 2 != even_kind
        if kind == 0:
            b00, b01, b10, b11 = c[0], -c[4], -c[4], c[1]
        else:
            b00, b01, b10, b11 = c[2], -v_sign * c[5], c[5], v_sign * c[3]
        x = phi + <size_t>rows * column
        y = out + <size_t>rows * column
        column += p.has[kind][0] + p.has[kind][1]
        if p.has[kind][0] and p.has[kind][1]:
            for i in range(rows):
                y[i] = factor * (b00 * x[i] + b01 * x[rows + i])
                y[rows + i] = factor * (b10 * x[i] + b11 * x[rows + i])
        elif p.has[kind][0] or p.has[kind][1]:
            b00 = factor * (b00 if p.has[kind][0] else b11)
            for i in range(rows):
                y[i] = b00 * x[i]


def phase_matrices(int m, coefficients, mu, mu_from):
    """A^m(mu, mu_from) = sum_l P_l^m(mu) B_l P_l^m(mu_from), (1:9), as matrix products.

    Parameters: order ``m``; ``coefficients`` (terms, 6), columns a1, a2, a3, a4, b1, b2; cosines ``mu`` (n,) and
    ``mu_from`` (k,), positive *downward* as in the solver (for public cosines pass -mu, -mu_from). Returns
    (n, k, 4, 4). Raises ValueError for wrong shapes or cosines.

    >>> phase_matrices(0, [[1.0, 0, 0, 0, 0, 0]], [0.3], [-0.7])[0, 0, 0, 0]  # isotropic
    np.float64(1.0)
    """
    table = np.ascontiguousarray(coefficients, dtype=float)
    if table.ndim != 2 or table.shape[1] != 6:
        raise ValueError(f"coefficients must have the shape (terms, 6), not {table.shape}")
    to, frm = np.atleast_1d(np.asarray(mu, float)), np.atleast_1d(np.asarray(mu_from, float))
    result = np.zeros((to.size, frm.size, 4, 4))
    terms = table.shape[0]
    if m >= terms or to.size == 0 or frm.size == 0:
        return result
    left = legendre_matrices(generalized_spherical_functions(m, terms, to)[m:])
    right = legendre_matrices(generalized_spherical_functions(m, terms, frm)[m:])
    middle = np.zeros((terms - m, 4, 4))
    a1, a2, a3, a4, b1, b2 = table[m:].T
    middle[:, 0, 0], middle[:, 1, 1], middle[:, 2, 2], middle[:, 3, 3] = a1, a2, a3, a4
    middle[:, 0, 1] = middle[:, 1, 0] = -b1
    middle[:, 2, 3], middle[:, 3, 2] = -b2, b2
    # rows (mu, i), inner (l, j), columns (mu_from, k)
    scaled = np.matmul(left, middle[:, None]).transpose(1, 2, 0, 3).reshape(4 * to.size, -1)
    columns = right.transpose(0, 2, 1, 3).reshape(-1, 4 * frm.size)
    return (scaled @ columns).reshape(to.size, 4, frm.size, 4).transpose(0, 2, 1, 3)


def legendre_matrices(functions):
    """P_l^m as 4x4 matrices (terms, n_mu, 4, 4) from p, r, t (terms, n_mu, 3)."""
    p, r, t = np.moveaxis(functions, -1, 0)
    matrices = np.zeros((*p.shape, 4, 4))
    matrices[..., 0, 0] = matrices[..., 3, 3] = p
    matrices[..., 1, 1] = matrices[..., 2, 2] = r
    matrices[..., 1, 2] = matrices[..., 2, 1] = -t
    return matrices


def bounds_work(n_all, n_term):
    """Doubles of `work` that one thread of `order_bounds` needs."""
    return 4 * n_all * n_term + 3 * n_all + 3 * n_term


def order_bounds(const double[:, :, ::1] coefficients, const int[::1] terms, const double[::1] albedo,
                 const double[::1] directions, const double[::1] weights, int n_out, double[:, ::1] strength,
                 double[::1] bounds, double[:, ::1] effect, int threads, double[:, ::1] work, double[::1] seconds,
                 const int[::1] stop):
    """What multiple scattering can do, order by order, before anything is solved.

    coefficients (layer, term, 6); directions: nodes, then n_out outgoing, then incident cosines. strength (layer, order): the
    norm q of one scattering, the largest omega |B_l|/(2 l + 1) of the degrees l >= m; bounds (order,): what all light
    scattered at least twice adds, times 1 - q, to the radiance of one order for a unit beam: with the norm of L2 over
    depth and direction, u v sqrt(mu0/mu)/(16 pi), where u and v are the norms of A^m's row to an outgoing direction and
    of its column from an incident one. effect (order, node): what light that is scattered by way of one node adds,
    times (1 - q)^2.
    """
    cdef int n_term = <int>coefficients.shape[1], m, thread
    cdef double start
    cdef bint polar = np.any(np.asarray(coefficients)[:, :, 1:])
    for m in prange(n_term, nogil=True, schedule="dynamic", num_threads=threads):
        thread = threadid()
        if not stop[0]:
            start = vrte_seconds()
            order_bound(m, polar, n_term, <int>coefficients.shape[0], &coefficients[0, 0, 0], &terms[0], &albedo[0],
                        &directions[0], <int>directions.shape[0], &weights[0], <int>weights.shape[0], n_out, &strength[0, m],
                        &bounds[m], &effect[m, 0], &work[thread, 0])
            seconds[thread] += vrte_seconds() - start


cdef inline double norm_of_coefficients(const double* c) noexcept nogil:
    """Of both 2 x 2 blocks of B_l, the larger norm, or a little more."""
    cdef double first = 0.5 * fabs(c[0] + c[1]) + hypot(0.5 * (c[0] - c[1]), c[4])
    return max(first, max(fabs(c[2]), fabs(c[3])) + fabs(c[5]))


cdef void order_bound(int m, bint polar, int n_term, int n_layer, const double* coefficients, const int* terms,
                      const double* albedo, const double* directions, int n_all, const double* weights, int n_node, int n_out,
                      double* strength, double* bound, double* effect, double* work) noexcept nogil:
    cdef double* prt = work
    cdef double* norms = prt + <size_t>3 * n_all * n_term      # (l, direction): |P_l^m|
    cdef double* u = norms + <size_t>n_all * n_term
    cdef double* to_out = u + n_all                            # (node,): by way of it
    cdef double* to_in = to_out + n_all
    cdef double* size = to_in + n_all
    cdef double* out = size + n_term                           # (l,): the largest norm of an outgoing, an incident
    cdef double* into = out + n_term                           # direction
    cdef int l, i, layer
    cdef double worst_u, worst_v, factor, out_factor, in_factor
    cdef const double* p
    cdef double* norm
    cdef double* q
    bound[0] = 0.0
    memset(effect, 0, sizeof(double) * n_node)
    spherical(m, n_term, polar, directions, n_all, prt)
    for l in range(m, n_term):
        p = prt + <size_t>3 * l * n_all
        norm = norms + <size_t>l * n_all
        if polar:
            for i in range(n_all):
                norm[i] = max(fabs(p[i]), fabs(p[n_all + i]) + fabs(p[2 * n_all + i]))
        else:
            for i in range(n_all):
                norm[i] = fabs(p[i])
        out[l] = largest_of(n_out, norm + n_node)
        into[l] = largest_of(n_all - n_node - n_out, norm + n_node + n_out)
    for layer in range(n_layer):
        worst_u = worst_v = 0.0
        q = strength + <size_t>layer * n_term
        q[0] = 0.0
        memset(u, 0, sizeof(double) * 3 * n_all)
        for l in range(m, terms[layer]):
            norm = norms + <size_t>l * n_all
            size[l] = albedo[layer] * norm_of_coefficients(coefficients + (<size_t>layer * n_term + l) * 6)
            q[0] = max(q[0], size[l] / (2.0 * l + 1.0))
            factor = 2.0 / (2.0 * l + 1.0) * size[l] * size[l]
            out_factor, in_factor = size[l] * out[l], size[l] * into[l]
            for i in range(n_all):
                u[i] += factor * norm[i] * norm[i]
            for i in range(n_node):
                to_out[i] += out_factor * norm[i]
                to_in[i] += in_factor * norm[i]
        for i in range(n_node, n_node + n_out):      # grazing light leaves the uppermost sheet: no more than at 0.01
            worst_u = max(worst_u, u[i] / max(directions[i], 0.01))
        for i in range(n_node + n_out, n_all):
            worst_v = max(worst_v, u[i] * directions[i])
        bound[0] = max(bound[0], sqrt(worst_u * worst_v) / (16.0 * PI))
        for i in range(n_node):
            effect[i] = max(effect[i], weights[i] * to_out[i] * to_in[i] / (8.0 * PI))


def bounds_at(const double[::1] strength, const double[::1] bounds, const double[::1] depth, const double[::1] decays):
    """What multiple scattering of each order adds at most at each depth, (order, n_tau).

    An order fades with depth at least as fast as e^(-kappa tau), kappa < 1 - q: its bound there is
    bound e^(-kappa tau)/((1 - kappa) (1 - q/(1 - kappa))), the least of it for kappa = decays (1 - q).
    """
    cdef int n_order = <int>strength.shape[0], n_tau = <int>depth.shape[0], m, t, d
    cdef double[:, ::1] out = np.zeros((n_order, n_tau))
    cdef double q, kappa, rest, least
    for m in range(n_order):
        if not bounds[m] > 0.0:
            continue
        q = min(strength[m], 1.0)
        for t in range(n_tau):
            least = INFINITY
            for d in range(<int>decays.shape[0]):
                kappa = decays[d] * (1.0 - q)
                rest = 1.0 - kappa - q
                if rest > 0.0:
                    least = min(least, exp(-kappa * depth[t]) / rest)
            out[m, t] = bounds[m] * least
    return np.asarray(out)


def nodes_seen(const double[::1] strength, const double[:, ::1] effect, double allowed, double largest_gain):
    """How many nodes, from the lowest mu, each order needs (order,): what passes by way of the others is less than
    `allowed`. All for order 0; no more than the order before."""
    cdef int n_order = <int>effect.shape[0], n_node = <int>effect.shape[1], m, count, most = 1
    cdef int[::1] seen = np.empty(n_order, np.int32)
    cdef double lost, gain
    for m in range(n_order - 1, -1, -1):
        gain = 1.0 / max(1.0 - strength[m], sqrt(1.0 / largest_gain))
        lost = 0.0
        count = n_node
        while count > 0:
            lost += effect[m, count - 1] * gain * gain
            if not lost <= allowed:
                break
            count = count - 1
        most = max(most, count)
        seen[m] = most if m > 0 else n_node
    return np.asarray(seen)


def assembly_work(n_all, n_term, stokes):
    """Doubles of `work` that one thread of `assemble` needs."""
    return 3 * n_all * n_term + 4 * (stokes * n_all) * (2 * n_term) + n_all


# (1:4), the beam's direction of travel
def assemble(const int[::1] orders, const int[::1] members, const double[:, :, ::1] coefficients, const int[::1] terms,
             const double[::1] albedo, const double[::1] directions, const double[::1] weights, int n_out,
             double[:, :, :, ::1] E, double[:, :, :, ::1] F, double[:, :, :, ::1] G_E, double[:, :, :, ::1] G_F,
             double[:, :, :, ::1] source_s, double[:, :, :, ::1] source_d, int threads, double[:, ::1] work,
             double[::1] seconds, const int[::1] stop):
    """E and F of (1:41) in the symmetric scaling, the rows that lead out of them and the beam's sources.

    members (S,): the Stokes parameters, ascending; directions: nodes, then n_out outgoing, then incident cosines (all
    positive); weights of the nodes. E, F (order, layer, n, n): M^-1 - omega/2 (Pp +- Pm), unit 1/optical depth; G_E, G_F
    (order, layer, n, S n_out): from the scaled field on the nodes to the sum and difference of the two sources of
    (1:38); source_s, source_d (order, layer, S n_in, n): M^-1 omega (Pp -+ Pm)(., mu0), (1:14) for a unit beam but for
    1/(2 pi).
    """
    cdef int n_order = <int>orders.shape[0], n_layer = <int>coefficients.shape[0], stokes = <int>members.shape[0]
    cdef int n_all = <int>directions.shape[0], n_node = <int>weights.shape[0]
    cdef int item, thread, n_in = n_all - n_node - n_out, n_item = n_order * n_layer
    cdef double start
    for item in prange(n_item, nogil=True, schedule="dynamic", num_threads=threads):
        thread = threadid()
        if not stop[0]:
            start = vrte_seconds()
            assemble_one(orders[item // n_layer], parity_of(orders[item // n_layer], stokes, &members[0]),
                         terms[item % n_layer], albedo[item % n_layer],
                         &coefficients[item % n_layer, 0, 0], &directions[0], &weights[0], n_node, n_out, n_in,
                         <int>coefficients.shape[1],
                         &E[item // n_layer, item % n_layer, 0, 0], &F[item // n_layer, item % n_layer, 0, 0],
                         &G_E[item // n_layer, item % n_layer, 0, 0], &G_F[item // n_layer, item % n_layer, 0, 0],
                         &source_s[item // n_layer, item % n_layer, 0, 0],
                         &source_d[item // n_layer, item % n_layer, 0, 0], &work[thread, 0])
            seconds[thread] += vrte_seconds() - start


# (1:13), (1:16)-(1:23)
cdef void assemble_one(int m, Parity p, int terms, double albedo, const double* coefficients, const double* directions,
                       const double* weights, int n_node, int n_out, int n_in, int n_term, double* E, double* F,
                       double* G_E, double* G_F, double* source_s, double* source_d, double* work) noexcept nogil:
    cdef int n_all = n_node + n_out + n_in, n = p.stokes * n_node, into = p.stokes * n_in, out = p.stokes * n_out
    cdef int i, j, kind, inner
    cdef size_t room = <size_t>(2 * p.stokes * n_all) * n_term
    cdef double* prt = work
    cdef double* phi = prt + <size_t>3 * n_all * n_term
    cdef double* psi = phi + room
    cdef double* phi_in = psi + room
    cdef double* psi_in = phi_in + room
    cdef double* scale = psi_in + room
    cdef double* matrix
    if terms <= m or albedo == 0.0:
        memset(E, 0, sizeof(double) * n * n)
        memset(F, 0, sizeof(double) * n * n)
        memset(G_E, 0, sizeof(double) * out * n)
        memset(G_F, 0, sizeof(double) * out * n)
        memset(source_s, 0, sizeof(double) * into * n)
        memset(source_d, 0, sizeof(double) * into * n)
    else:
        spherical(m, terms, is_polar(p), directions, n_all, prt)
        for i in range(n_node):
            scale[i] = sqrt(weights[i] / directions[i])
        for kind in range(2):       # 0: E, 1: F
            matrix = F if kind else E
            inner = columns_of(p, m, terms, kind)
            parity_columns(p, m, terms, kind, prt, n_all, 0, n_node, scale, phi)
            times_coefficients(p, m, terms, kind, albedo, 1.0, coefficients, n, phi, psi)
            product(b"N", b"T", n, n, inner, -1.0, phi, n, psi, n, 0.0, matrix, n)
            # the beam: column mu0 of the same product; rows: phi, the nodes
            parity_columns(p, m, terms, kind, prt, n_all, n_node + n_out, n_in, NULL, phi_in)
            times_coefficients(p, m, terms, kind, albedo, 1.0, coefficients, into, phi_in, psi_in)
            product(b"N", b"T", n, into, inner, 1.0, phi, n, psi_in, into, 0.0, source_s if kind else source_d, n)
            parity_columns(p, m, terms, kind, prt, n_all, n_node, n_out, NULL, phi)
            product(b"N", b"T", out, n, inner, 1.0, phi, out, psi, n, 0.0, G_F if kind else G_E, out)
    for i in range(n):
        j = i * n + i
        E[j] += 1.0 / directions[i // p.stokes]
        F[j] += 1.0 / directions[i // p.stokes]


# ---------------------------------------------------------------------------------------------------------
# Homogeneous solution, (1:40)-(1:45): s' = -F d, d' = -E s; s = X y, d = Y z, so y' = -z, z' = -lambda y.
# ---------------------------------------------------------------------------------------------------------

def homogeneous_work(n):
    """Doubles of `work` that one thread of `homogeneous` needs (its LAPACK block included)."""
    return 5 * n * n + 50 * n + 8


def homogeneous(const int[::1] orders, bint conserving, bint quick, bint clear, const double[::1] albedo, const double[::1] directions, const double[::1] weights,
                const double[:, :, :, ::1] E, const double[:, :, :, ::1] F, double[:, :, ::1] lam_re,
                double[:, :, ::1] lam_im, double[:, :, :, ::1] X, double[:, :, :, ::1] Y, double[:, :, :, ::1] X_lu,
                int[:, :, ::1] X_pivots, double[:, ::1] residual, int[:, ::1] info, int threads, double[:, ::1] work,
                int[:, ::1] pivots, double[::1] seconds, const int[::1] stop):
    """The modes F E X = X lambda, (1:43), and Y = F^-1 X, (1:44), without a division by lambda.

    conserving: whether order 0 has I, so that its flux is conserved; quick: whether symmetric E and F go to the
    symmetric eigensolver, which is several times faster and loses a digit; clear: whether layers without scattering go
    without an eigenproblem. E, F, X, Y, X_lu (order, layer, n, n); lam_re, lam_im (order, layer, n), unit 1/optical depth
    squared, complex pairs adjacent, the positive imaginary part first; X_lu and X_pivots factorise X, or X_pivots starts
    with -1, X_lu is not filled and X^-1 = Y^T (symmetric modes); residual (order, layer):
    the largest of |F E X - X lambda| over that of |F E X|, 1 where lambda < 0: a mode that swings instead of fading,
    which only a phase matrix with more terms than the nodes carry has.
    """
    cdef int n_order = <int>orders.shape[0], n_layer = <int>albedo.shape[0], n = <int>X.shape[3]
    cdef int item, thread, o, k, n_item = n_order * n_layer, stokes = n // <int>weights.shape[0]
    cdef double start
    for item in prange(n_item, nogil=True, schedule="dynamic", num_threads=threads):
        thread = threadid()
        if not stop[0]:
            start = vrte_seconds()
            o = item // n_layer
            k = item % n_layer
            if clear and albedo[k] == 0.0:
                clear_modes(n, stokes, &directions[0], &lam_re[o, k, 0], &lam_im[o, k, 0], &X[o, k, 0, 0], &Y[o, k, 0, 0],
                            &X_lu[o, k, 0, 0], &X_pivots[o, k, 0])
            else:
                info[o, k] = homogeneous_one(
                    n, stokes, conserving and orders[o] == 0, quick, albedo[k], &directions[0], &weights[0], &E[o, k, 0, 0], &F[o, k, 0, 0], &lam_re[o, k, 0],
                    &lam_im[o, k, 0], &X[o, k, 0, 0], &Y[o, k, 0, 0], &X_lu[o, k, 0, 0], &X_pivots[o, k, 0],
                    &residual[o, k], &work[thread, 0], &pivots[thread, 0])
            seconds[thread] += vrte_seconds() - start


cdef void clear_modes(int n, int stokes, const double* directions, double* lam_re, double* lam_im, double* X, double* Y,
                      double* X_lu, int* X_pivots) noexcept nogil:
    """A layer that does not scatter: E = F = 1/mu, so X = 1, lambda = 1/mu^2 and Y = mu."""
    cdef int i
    cdef size_t size = sizeof(double) * <size_t>n * n
    memset(X, 0, size)
    memset(Y, 0, size)
    memset(X_lu, 0, size)
    for i in range(n):
        X[<size_t>i * n + i] = X_lu[<size_t>i * n + i] = 1.0
        Y[<size_t>i * n + i] = directions[i // stokes]
        lam_re[i] = 1.0 / (directions[i // stokes] * directions[i // stokes])
        lam_im[i] = 0.0
        X_pivots[i] = i + 1      # LAPACK counts from 1


# (1:40)-(1:44)
cdef int homogeneous_one(int n, int stokes, bint conserving, bint quick, double albedo, const double* directions, const double* weights, const double* E,
                         const double* F, double* lam_re, double* lam_im, double* X, double* Y, double* X_lu,
                         int* X_pivots, double* residual, double* work, int* pivots) noexcept nogil:
    cdef double* e = work
    cdef double* f = e + n * n
    cdef double* a = f + n * n
    cdef double* v = a + n * n
    cdef double* spare = v + n
    cdef int info, i, together
    cdef bint paired = False       # X^-1 = Y^T
    cdef bint growing = False      # a mode that neither fades nor grows: only a phase matrix with too many terms has one
    cdef double largest
    info = modes_by_stokes(n, stokes, quick, E, F, lam_re, lam_im, X, NULL if conserving else Y, &paired, work,
                           spare, pivots, &together)
    if info != 0:
        return info
    if not paired:
        memcpy(f, F, sizeof(double) * n * n)
        info = factorise(n, f, n, pivots)
        if info != 0:
            return info
    if conserving:
        conserving_axis(n, stokes, directions, weights, v)
        memcpy(e, E, sizeof(double) * n * n)
        reflect_both(n, stokes, v, e, spare)
        exact_conservation(n, stokes, albedo, directions, weights, v, e, spare)
        polish_smallest(n, stokes, together, albedo, directions, weights, v, e, f, pivots, lam_re, lam_im, X, a, spare,
                        pivots + n)
    largest = 0.0
    for i in range(n):
        largest = max(largest, fabs(lam_re[i]))
    for i in range(n):
        if lam_im[i] == 0.0 and lam_re[i] < 0.0:
            growing = growing or lam_re[i] < -1e-15 * largest      # else rounding below zero
            lam_re[i] = 0.0
    if not paired:
        memcpy(Y, X, sizeof(double) * n * n)
        solve(b"N", n, n, f, n, pivots, Y, n)
    residual[0] = 1.0 if growing else mode_residual(n, E, F, lam_re, lam_im, X, a, e)
    if paired:
        X_pivots[0] = -1
        return 0
    memcpy(X_lu, X, sizeof(double) * n * n)
    return factorise(n, X_lu, n, X_pivots)


cdef int eigenproblem(int n, double* a, double* lam_re, double* lam_im, double* X, double* spare, int* pivots) noexcept nogil:
    """a X = X lambda; destroys a. Neither permutes nor scales: steep nodes have to stay on top, else small eigenvalues are
    known to 1e-16 of the largest only."""
    cdef char no = b"N", yes = b"V"
    cdef int info = 0, lwork = n * n + 8 * n, low, high, one = 1
    cdef double norm, unused = 0.0
    dgeevx(&no, &no, &yes, &no, &n, a, &n, lam_re, lam_im, &unused, &one, X, &n, &low, &high, spare + lwork, &norm,
           &unused, &unused, spare, &lwork, pivots, &info)
    return info


cdef int modes_by_stokes(int n, int stokes, bint quick, const double* E, const double* F, double* lam_re, double* lam_im, double* X, double* Y,
                         bint* paired, double* room, double* spare, int* pivots, int* together) noexcept nogil:
    """The modes of each set of Stokes parameters that mix, one set after another; `together`: columns of I's set. Y, unless
    NULL, is filled where all is one set of symmetric modes, which `paired` says.

    Order 0 keeps (I, Q) from (U, V), b2 = 0 keeps V apart, a scalar phase function everything. In one system their
    equal eigenvalues would mix and lose digits.
    """
    cdef int set_of[4]
    cdef int a, b, i, j, row, info = 0, size, column = 0, old
    cdef size_t at
    for a in range(stokes):
        set_of[a] = a
    for j in range(n if stokes > 1 else 0):
        for i in range(n // stokes):
            for row in range(stokes):
                a, b = set_of[row], set_of[j % stokes]
                at = <size_t>j * n + i * stokes + row
                if a != b and (E[at] != 0.0 or F[at] != 0.0):
                    old = max(a, b)
                    for size in range(stokes):
                        if set_of[size] == old:
                            set_of[size] = min(a, b)
    for a in range(stokes):
        size = 0
        for b in range(stokes):
            size += set_of[b] == a
        if size > 0 and info == 0:
            info = modes_of_set(n, stokes, quick, a, size, set_of, E, F, lam_re + column, lam_im + column, X + <size_t>column * n, Y,
                                paired, room, spare, pivots)
            column += size * (n // stokes)
            if a == 0:
                together[0] = column
    return info


cdef int modes_of_set(int n, int stokes, bint quick, int which, int members, const int* set_of, const double* E, const double* F,
                      double* lam_re, double* lam_im, double* X, double* Y, bint* paired, double* room, double* spare,
                      int* pivots) noexcept nogil:
    """The modes of one set: columns of X, zero in the other rows."""
    cdef int h = members * (n // stokes), i, j, row, column, info
    cdef size_t hh = <size_t>h * h
    cdef double* e = room
    cdef double* f = e + hh
    cdef double* a = f + hh
    cdef double* x = X if members == stokes else a + hh
    column = 0
    if members == stokes:
        memcpy(e, E, sizeof(double) * hh)
        memcpy(f, F, sizeof(double) * hh)
    for j in range(n if members < stokes else 0):
        if set_of[j % stokes] != which:
            continue
        row = 0
        for i in range(n):
            if set_of[i % stokes] == which:
                e[<size_t>column * h + row] = E[<size_t>j * n + i]
                f[<size_t>column * h + row] = F[<size_t>j * n + i]
                row += 1
        column += 1
    info = 1
    if quick and symmetric(h, e) and symmetric(h, f):
        info = symmetric_modes(h, e, f, lam_re, lam_im, x, Y if members == stokes else NULL, a, spare, pivots)
        paired[0] = info == 0 and members == stokes and Y != NULL
    if info != 0:
        product(b"N", b"N", h, h, h, 1.0, f, h, e, h, 0.0, a, h)
        info = eigenproblem(h, a, lam_re, lam_im, x, spare, pivots)
    if members == stokes:
        return info
    memset(X, 0, sizeof(double) * <size_t>h * n)
    for j in range(h):
        row = 0
        for i in range(n):
            if set_of[i % stokes] == which:
                X[<size_t>j * n + i] = x[<size_t>j * h + row]
                row += 1
    return info


cdef bint symmetric(int n, const double* a) noexcept nogil:
    """But for rounding."""
    cdef int i, j
    cdef double gap = 0.0
    for j in range(n):
        for i in range(j):
            gap = fabs(a[<size_t>j * n + i] - a[<size_t>i * n + j])
            if gap * gap > 1e-26 * fabs(a[<size_t>i * n + i] * a[<size_t>j * n + j]):
                return False
    return True


cdef int symmetric_modes(int n, const double* e, const double* f, double* lam_re, double* lam_im, double* X, double* Y,
                         double* a, double* spare, int* pivots) noexcept nogil:
    """Modes of symmetric E and F = L L^T: L^T E L W = W lambda, X = L W, Y = F^-1 X = L^-T W unless NULL, so X^-1 = Y^T;
    steep nodes first, where the reduction to tridiagonal form starts. Not 0 where F is not positive; f is kept, for a
    second try."""
    cdef char side = b"L", lower = b"L", yes = b"V", no = b"N", transposed = b"T", right = b"R"
    cdef int info = 0, lwork = 2 * n * n + 6 * n + 1, liwork = 5 * n + 3
    cdef double one = 1.0
    cdef double* L = a
    memcpy(L, f, sizeof(double) * <size_t>n * n)
    dpotrf(&lower, &n, L, &n, &info)
    if info != 0:
        return info
    memcpy(X, e, sizeof(double) * <size_t>n * n)
    dtrmm(&right, &lower, &no, &no, &n, &n, &one, L, &n, X, &n)
    dtrmm(&side, &lower, &transposed, &no, &n, &n, &one, L, &n, X, &n)
    dsyevd(&yes, &lower, &n, X, &n, lam_re, spare, &lwork, pivots, &liwork, &info)
    memset(lam_im, 0, sizeof(double) * n)
    if info == 0:
        if Y != NULL:
            memcpy(Y, X, sizeof(double) * <size_t>n * n)
            dtrsm(&side, &lower, &transposed, &no, &n, &n, &one, L, &n, Y, &n)
        dtrmm(&side, &lower, &no, &no, &n, &n, &one, L, &n, X, &n)
    return info


cdef inline int flux_axis(int n, int stokes) noexcept nogil:
    """The axis that carries the flux once order 0 is turned: I of the last node, so that steep nodes stay apart (turned
    into the first, the small eigenvalues would be known to 1e-16 of the largest only)."""
    return n - stokes


cdef void conserving_axis(int n, int stokes, const double* directions, const double* weights, double* v) noexcept nogil:
    """v: the Householder vector that turns sqrt(weight mu) on I, the null vector of E at omega = 1, to the flux's axis."""
    cdef int i
    cdef double size = 0.0
    memset(v, 0, sizeof(double) * n)
    for i in range(n // stokes):
        v[stokes * i] = sqrt(weights[i] * directions[i])
        size += v[stokes * i] * v[stokes * i]
    v[flux_axis(n, stokes)] += sqrt(size)
    size = 0.0
    for i in range(n // stokes):
        size += v[stokes * i] * v[stokes * i]
    size = sqrt(2.0 / size)
    for i in range(n // stokes):
        v[stokes * i] *= size


cdef inline void turn_columns(int n, int stokes, int columns, const double* v, double* a) noexcept nogil:
    """a <- (1 - v v^T) a, a of n rows."""
    cdef int i, j
    cdef double total
    for j in range(columns):
        total = 0.0
        for i in range(n // stokes):
            total += v[i * stokes] * a[<size_t>j * n + i * stokes]
        for i in range(n // stokes):
            a[<size_t>j * n + i * stokes] -= total * v[i * stokes]


cdef inline void turn_rows(int n, int stokes, int rows, const double* v, double* a, double* spare) noexcept nogil:
    """a <- a (1 - v v^T), a of n columns."""
    cdef int i, j
    memset(spare, 0, sizeof(double) * rows)
    for j in range(n // stokes):
        for i in range(rows):
            spare[i] += a[<size_t>j * stokes * rows + i] * v[j * stokes]
    for j in range(n // stokes):
        for i in range(rows):
            a[<size_t>j * stokes * rows + i] -= spare[i] * v[j * stokes]


cdef void reflect_both(int n, int stokes, const double* v, double* a, double* spare) noexcept nogil:
    """a <- (1 - v v^T) a (1 - v v^T)."""
    turn_columns(n, stokes, n, v, a)
    turn_rows(n, stokes, n, v, a, spare)


cdef void exact_conservation(int n, int stokes, double albedo, const double* directions, const double* weights, const double* v,
                             double* e, double* row) noexcept nogil:
    """The flux's row and column of the turned E: (1 - omega) M^-1 v exactly (2 N terms at most), zero at omega = 1."""
    cdef int i, axis = flux_axis(n, stokes)
    cdef double size = 0.0, total = 0.0
    memset(row, 0, sizeof(double) * n)
    for i in range(n // stokes):
        size += weights[i] * directions[i]
    for i in range(n // stokes):     # M^-1 on minus the unit null vector: the reflection sends the null vector to -|.|
        row[stokes * i] = -sqrt(weights[i] * directions[i] / size) / directions[i]
    for i in range(n // stokes):
        total += v[i * stokes] * row[i * stokes]
    for i in range(n // stokes):
        row[i * stokes] = (1.0 - albedo) * (row[i * stokes] - total * v[i * stokes])
    for i in range(n):
        e[axis * n + i] = row[i]
        e[i * n + axis] = row[i]


cdef void polish_smallest(int n, int stokes, int together, double albedo, const double* directions, const double* weights, const double* v,
                          const double* e, const double* f_lu, const int* f_pivots, double* lam_re, double* lam_im,
                          double* X, double* work, double* spare, int* pivots) noexcept nogil:
    """The diffusion mode, whose small lambda is else known only to 1e-16 of the largest: at omega = 1 the null vector
    itself, below by inverse iteration with e, the turned E, whose row and column of the flux are exact."""
    cdef int inner = n - 1, i, j, best = -1, sweep, axis = flux_axis(n, stokes)
    cdef double smallest = 0.05, pivot, top, norm, growth = 1.0
    cdef double* lu = work                       # (n-1, n-1), e without the axis
    cdef double* row = spare                     # (n-1,)
    cdef double* column = row + inner            # e''^-1 row, e is symmetric there
    cdef double* part = column + inner
    cdef double* x
    for j in range(together):     # those that have I
        if lam_im[j] == 0.0 and fabs(lam_re[j]) < smallest:
            best, smallest = j, fabs(lam_re[j])
    if best < 0:
        return
    x = X + best * n
    if albedo == 1.0:
        for i in range(n):
            x[i] = 0.0 if i % stokes else sqrt(weights[i // stokes] * directions[i // stokes])
        lam_re[best] = 0.0
        return
    for j in range(inner):
        leave_out(n, axis, e + (j if j < axis else j + 1) * n, lu + j * inner)
    if factorise(inner, lu, inner, pivots) != 0:
        return
    leave_out(n, axis, e + axis * n, row)
    memcpy(column, row, sizeof(double) * inner)
    solve(b"N", inner, 1, lu, inner, pivots, column, inner)
    pivot = e[axis * n + axis]
    for i in range(inner):
        pivot -= row[i] * column[i]
    for sweep in range(8):
        solve(b"N", n, 1, f_lu, n, f_pivots, x, n)
        turn_columns(n, stokes, 1, v, x)
        top = x[axis]
        leave_out(n, axis, x, part)
        solve(b"N", inner, 1, lu, inner, pivots, part, inner)
        for i in range(inner):
            top -= row[i] * part[i]
        top /= pivot
        norm = top * top
        for i in range(inner):
            part[i] -= column[i] * top
            norm += part[i] * part[i]
        growth = sqrt(norm)
        for i in range(inner):
            x[i if i < axis else i + 1] = part[i] / growth
        x[axis] = top / growth
        turn_columns(n, stokes, 1, v, x)
    lam_re[best] = 1.0 / growth


cdef inline void leave_out(int n, int axis, const double* x, double* out) noexcept nogil:
    """x (n,) without one element."""
    memcpy(out, x, sizeof(double) * axis)
    memcpy(out + axis, x + axis + 1, sizeof(double) * (n - 1 - axis))


cdef double mode_residual(int n, const double* e, const double* f, const double* lam_re, const double* lam_im,
                          const double* X, double* a, double* b) noexcept nogil:
    cdef int i, j = 0
    cdef double worst = 0.0, largest = 0.0, re, im
    product(b"N", b"N", n, n, n, 1.0, e, n, X, n, 0.0, a, n)
    product(b"N", b"N", n, n, n, 1.0, f, n, a, n, 0.0, b, n)
    while j < n:
        re, im = lam_re[j], lam_im[j]
        if im == 0.0:
            for i in range(n):
                largest = max(largest, fabs(b[j * n + i]))
                worst = max(worst, fabs(b[j * n + i] - re * X[j * n + i]))
            j = j + 1
        else:
            for i in range(n):
                largest = max(largest, fabs(b[j * n + i]))
                worst = max(worst, fabs(b[j * n + i] - re * X[j * n + i] + im * X[(j + 1) * n + i]))
                worst = max(worst, fabs(b[(j + 1) * n + i] - re * X[(j + 1) * n + i] - im * X[j * n + i]))
            j = j + 2
    return worst / largest if largest > 0.0 else 0.0


# ---------------------------------------------------------------------------------------------------------
# Particular solution, (1:28)-(1:34), without its resonance. With D(tau) = (e^(-tau/mu0) - e^(-k tau))/(k - 1/mu0),
# y = c D and z = zeta e^(-tau/mu0) + c k D, where c = (q + p/mu0)/(k + 1/mu0), zeta = (p k - q)/(k + 1/mu0).
# ---------------------------------------------------------------------------------------------------------

def particular_work(n, n_in, stokes):
    """Doubles of `work` that one thread of `particular` needs."""
    return 2 * n * stokes * n_in + 4 * n


def particular(const double[:, :, :, ::1] F, const double[:, :, :, ::1] source_s, const double[:, :, :, ::1] source_d,
               const double[::1] mu0, const double[:, ::1] columns, const double[:, :, ::1] lam_re,
               const double[:, :, ::1] lam_im, const double[:, :, :, ::1] X, const double[:, :, :, ::1] Y,
               const double[:, :, :, ::1] X_lu, const int[:, :, ::1] X_pivots, double[:, :, :, ::1] c, double[:, :, :, ::1] zeta, int threads, double[:, ::1] work, double[::1] seconds,
               const int[::1] stop):
    """The beam's solution in the coordinates of the modes.

    source_s, source_d (order, layer, S n_in, n) as `assemble` leaves them; mu0 (n_in,); columns (n_col, S): the
    incident Stokes vectors. c, zeta (order, layer, n_in n_col, n).
    """
    cdef int n_order = <int>F.shape[0], n_layer = <int>F.shape[1], n = <int>F.shape[3], n_in = <int>mu0.shape[0]
    cdef int n_col = <int>columns.shape[0], item, thread, o, k, n_item = n_order * n_layer
    cdef double start
    for item in prange(n_item, nogil=True, schedule="dynamic", num_threads=threads):
        thread = threadid()
        if not stop[0]:
            start = vrte_seconds()
            o = item // n_layer
            k = item % n_layer
            particular_one(n, <int>columns.shape[1], n_in, n_col, &F[o, k, 0, 0], &source_s[o, k, 0, 0], &source_d[o, k, 0, 0], &mu0[0],
                           &columns[0, 0], &lam_re[o, k, 0], &lam_im[o, k, 0], &X[o, k, 0, 0], &Y[o, k, 0, 0],
                           &X_lu[o, k, 0, 0], &X_pivots[o, k, 0], &c[o, k, 0, 0], &zeta[o, k, 0, 0], &work[thread, 0])
            seconds[thread] += vrte_seconds() - start


# (1:28)-(1:34), (1:46)-(1:48)
cdef void particular_one(int n, int stokes, int n_in, int n_col, const double* F, const double* source_s, const double* source_d,
                         const double* mu0, const double* columns, const double* lam_re, const double* lam_im,
                         const double* X, const double* Y, const double* X_lu, const int* X_pivots, double* c, double* zeta,
                         double* work) noexcept nogil:
    cdef int j, a, col
    cdef bint paired = X_pivots[0] < 0        # X^-1 = Y^T, Y^-1 = X^T
    cdef double* ps = work
    cdef double* fd = ps + <size_t>n * stokes * n_in      # F source_d: Y^-1 = X^-1 F
    cdef double* p = c
    cdef double* q = zeta
    cdef double* out_c
    cdef double* out_z
    cdef double p1, p2, q1, q2, rate
    cdef cplx k, below, pc, qc, value
    if paired:
        product(b"T", b"N", n, stokes * n_in, n, 1.0, Y, n, source_s, n, 0.0, ps, n)
        product(b"T", b"N", n, stokes * n_in, n, 1.0, X, n, source_d, n, 0.0, fd, n)
    else:
        memcpy(ps, source_s, sizeof(double) * <size_t>n * stokes * n_in)
        product(b"N", b"N", n, stokes * n_in, n, 1.0, F, n, source_d, n, 0.0, fd, n)
    for a in range(n_in):                     # the right-hand sides' Stokes columns
        product(b"N", b"N", n, n_col, stokes, 1.0, ps + <size_t>stokes * a * n, n, columns, stokes, 0.0, p + <size_t>a * n_col * n, n)
        product(b"N", b"N", n, n_col, stokes, 1.0, fd + <size_t>stokes * a * n, n, columns, stokes, 0.0, q + <size_t>a * n_col * n, n)
    if not paired:
        solve(b"N", n, n_in * n_col, X_lu, n, X_pivots, p, n)
        solve(b"N", n, n_in * n_col, X_lu, n, X_pivots, q, n)
    for a in range(n_in):
        rate = 1.0 / mu0[a]
        for col in range(n_col):
            out_c = p + <size_t>(a * n_col + col) * n
            out_z = q + <size_t>(a * n_col + col) * n
            j = 0
            while j < n:
                k = c_sqrt(make(lam_re[j], lam_im[j]))
                below = k + rate
                if lam_im[j] == 0.0:
                    pc, qc = make(out_c[j], 0.0), make(out_z[j], 0.0)
                else:
                    pc, qc = make(out_c[j], -out_c[j + 1]), make(out_z[j], -out_z[j + 1])
                value = over(qc + rate * pc, below)
                qc = over(times(pc, k) - qc, below)
                out_c[j], out_z[j] = value.real, qc.real
                if lam_im[j] == 0.0:
                    j = j + 1
                else:
                    out_c[j + 1], out_z[j + 1] = -value.imag, -qc.imag
                    j = j + 2


# ---------------------------------------------------------------------------------------------------------
# Boundary conditions, (1:49)-(1:65), all layers of one order. Even and odd modes about the middle of a layer,
#   even: y = cosh(k t)/cosh(k h), z = -lambda y_odd;  odd: y = sinh(k t)/(k cosh(k h)), z = -y_even,
# split the 8N system of a slab into two 4N systems and stay regular at lambda = 0; layers join by the star
# product from the base up, as in (2:8). In a layer so thick that every mode fades (`fades`), "even" is e^(-k tau)
# and "odd" e^(-k (thickness - tau)), each referred to its own face as in (2:12)-(2:15): faint light keeps its digits.
# ---------------------------------------------------------------------------------------------------------

cdef inline double slowest_rate(int n, const double* lam_re, const double* lam_im) noexcept nogil:
    cdef int j
    cdef double rate = INFINITY, smallest = INFINITY
    for j in range(n):
        if lam_im[j] == 0.0:
            smallest = min(smallest, lam_re[j])
        else:
            rate = min(rate, c_sqrt(make(lam_re[j], lam_im[j])).real)
    return min(rate, c_sqrt(make(smallest, 0.0)).real)


cdef inline bint fades(int n, const double* lam_re, const double* lam_im, double thickness) noexcept nogil:
    """Whether every mode loses e^4 from face to face; always in a layer without end."""
    return thickness > 1e300 or slowest_rate(n, lam_re, lam_im) * thickness > 4.0


def modes_fade(const double[:, :, ::1] lam_re, const double[:, :, ::1] lam_im, const double[::1] thickness, int[:, ::1] out):
    """Whether every mode of each order and layer fades, out (order, layer), 0 or 1: what `boundary` and `reconstruct`
    decide, for who does one of them elsewhere."""
    cdef Py_ssize_t order, layer
    cdef int n = <int>lam_re.shape[2]
    for order in range(lam_re.shape[0]):
        for layer in range(lam_re.shape[1]):
            out[order, layer] = fades(n, &lam_re[order, layer, 0], &lam_im[order, layer, 0], thickness[layer])


cdef inline cplx half_tangent(cplx k, double thickness) noexcept nogil:
    """tanh(k h)/k with h = thickness/2."""
    cdef cplx e
    if size_of(k) * thickness < 1e-150:
        return make(0.5 * thickness, 0.0)
    e = c_expm1(-thickness * k)
    return over(-e, times(k, e + 2.0))


cdef inline cplx beam_response(cplx k, double rate, double depth) noexcept nogil:
    """D(depth) = (e^(-depth rate) - e^(-k depth))/(k - rate), unit optical depth."""
    return depth * exp_difference(make(-depth * rate, 0.0), -depth * k)


def boundary_work(n, n_layer, n_rhs):
    """Doubles of `work` that one thread of `boundary` needs."""
    return 5 * n_layer * n * n + 5 * n_layer * n * n_rhs + 4 * n * n + 5 * n * n_rhs + 10 * n


def boundary(const double[:, :, ::1] lam_re, const double[:, :, ::1] lam_im, const double[:, :, :, ::1] X,
             const double[:, :, :, ::1] Y, const double[:, :, :, ::1] c, const double[:, :, :, ::1] zeta,
             const int[::1] clear, const double[::1] thickness, const double[::1] mu0, const double[::1] above, const int[::1] base_row,
             const double[:, :, ::1] base, const double[:, :, ::1] base_source, double[:, :, :, ::1] even,
             double[:, :, :, ::1] odd, double[:, :, ::1] base_down, double[:, ::1] residual, int[::1] info, int threads,
             double[:, ::1] work, int[:, ::1] pivots, double[::1] seconds, const int[::1] stop):
    """The amplitudes of the even and odd modes of every layer.

    clear (layer,): not 0 for layers known not to scatter; thickness (layer,), inf allowed last; above (layer,): optical
    depth of each layer's top; base_row (order,): the
    row of `base` (row, n, n) and `base_source` (row, n_rhs, n) of that order, or -1 for black: the base's operator
    and its reflection of the unattenuated beam, scaled and flipped. even, odd (order, layer, n_rhs, n); base_down
    (order, n_rhs, n): the scaled diffuse field that falls on the base; residual (order, layer): of the linear
    systems, relative. `pivots`: 2 n n_layer + n integers a thread.
    """
    cdef int n_order = <int>X.shape[0], o, thread
    cdef double start
    for o in prange(n_order, nogil=True, schedule="dynamic", num_threads=threads):
        thread = threadid()
        if not stop[0]:
            start = vrte_seconds()
            info[o] = boundary_one(
                <int>X.shape[3], <int>X.shape[1], <int>mu0.shape[0], <int>c.shape[2], &lam_re[o, 0, 0], &lam_im[o, 0, 0],
                &X[o, 0, 0, 0], &Y[o, 0, 0, 0], &c[o, 0, 0, 0], &zeta[o, 0, 0, 0], &clear[0], &thickness[0], &mu0[0],
                &above[0], &base[base_row[o], 0, 0] if base_row[o] >= 0 else NULL,
                &base_source[base_row[o], 0, 0] if base_row[o] >= 0 else NULL,
                &even[o, 0, 0, 0], &odd[o, 0, 0, 0], &base_down[o, 0, 0], &residual[o, 0], &work[thread, 0],
                &pivots[thread, 0])
            seconds[thread] += vrte_seconds() - start


cdef int boundary_one(int n, int n_layer, int n_in, int n_rhs, const double* lam_re, const double* lam_im, const double* X,
                      const double* Y, const double* c, const double* zeta, const int* clear, const double* thickness,
                      const double* mu0, const double* above, const double* base, const double* base_source, double* even, double* odd,
                      double* base_down, double* residual, double* work, int* pivots) noexcept nogil:
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * n_rhs, i, per_beam = <size_t>(n_rhs // n_in) * n
    cdef int layer, info
    cdef bint joined = n_layer > 1 or base != NULL
    cdef double* systems = work                             # per layer: LU even, LU odd, R, T, G
    cdef double* vectors = systems + 5 * n_layer * nn       # per layer: beam down at the top, up and down at the
    cdef double* scratch = vectors + 5 * n_layer * nr       # bottom; emitted down; g: sent up from below
    cdef double* below = scratch + 3 * nn + 8 * n
    cdef double* up = below + nn
    cdef double* down = up + nr
    cdef double* falling = down + nr
    cdef double* spare = falling + nr                       # 2 n n_rhs + 2 n
    cdef double* system
    cdef double* vector
    for layer in range(n_layer):
        info = slab_systems(n, n_in, n_rhs, lam_re + layer * n, lam_im + layer * n, X + layer * nn, Y + layer * nn,
                            c + layer * nr, zeta + layer * nr, thickness[layer], mu0, above[layer],
                            systems + 5 * layer * nn, pivots + 2 * layer * n, vectors + 5 * layer * nr, scratch, spare)
        if info != 0:
            return info
    if joined:
        memset(below, 0, sizeof(double) * nn)
        memset(up, 0, sizeof(double) * nr)
        if base != NULL:
            memcpy(below, base, sizeof(double) * nn)
            for i in range(nr):
                up[i] = base_source[i] * exp(-(above[n_layer - 1] + thickness[n_layer - 1]) / mu0[i // per_beam])
        for layer in range(n_layer - 1, -1, -1):
            if clear[layer]:
                join_clear_layer(n, n_rhs, lam_re + layer * n, thickness[layer], systems + 5 * layer * nn,
                                 vectors + 5 * layer * nr, below, up)
                continue
            info = join_layer(n, n_rhs, lam_re + layer * n, lam_im + layer * n, X + layer * nn, Y + layer * nn, thickness[layer], systems + 5 * layer * nn,
                              pivots + 2 * layer * n, pivots + 2 * n_layer * n, vectors + 5 * layer * nr, below, up,
                              scratch, spare)
            if info != 0:
                return info
    memset(down, 0, sizeof(double) * nr)
    for layer in range(n_layer):
        system = systems + 5 * layer * nn
        vector = vectors + 5 * layer * nr
        if joined:          # up = G (T down + emitted) + g at the layer's bottom
            memcpy(falling, vector + 3 * nr, sizeof(double) * nr)
            product(b"N", b"N", n, n_rhs, n, 1.0, system + 3 * nn, n, down, n, 1.0, falling, n)
            memcpy(up, vector + 4 * nr, sizeof(double) * nr)
            product(b"N", b"N", n, n_rhs, n, 1.0, system + 4 * nn, n, falling, n, 1.0, up, n)
            product(b"N", b"N", n, n_rhs, n, 1.0, system + 2 * nn, n, up, n, 1.0, falling, n)
        else:
            memset(up, 0, sizeof(double) * nr)
        for i in range(nr):
            down[i] -= vector[i]
            up[i] -= vector[nr + i]
        residual[layer] = amplitudes(n, n_rhs, lam_re + layer * n, lam_im + layer * n, X + layer * nn, Y + layer * nn,
                                     thickness[layer], system, pivots + 2 * layer * n, down, up, even + layer * nr,
                                     odd + layer * nr, scratch, spare)
        memcpy(down, falling, sizeof(double) * nr)
    if joined:
        memcpy(base_down, down, sizeof(double) * nr)
    else:
        memset(base_down, 0, sizeof(double) * nr)
    return 0


# (1:45)
cdef void slab_matrix(int n, bint is_odd, const double* lam_re, const double* lam_im, const double* X, const double* Y,
                      double thickness, double* matrix, double* spare) noexcept nogil:
    """Even: X + Y lambda f (where all fades: X + Y k); odd: X f + Y; f = tanh(k h)/k."""
    cdef int j
    cdef size_t i
    cdef cplx* f = <cplx*>spare
    cdef cplx k
    cdef bint fading = fades(n, lam_re, lam_im, thickness)
    for j in range(n):
        k = c_sqrt(make(lam_re[j], lam_im[j]))
        if fading:
            f[j] = k
        else:
            f[j] = half_tangent(k, thickness)
            if not is_odd:
                f[j] = times(f[j], make(lam_re[j], lam_im[j]))
    scale_columns(n, n, lam_im, f, X if is_odd else Y, matrix)
    for i in range(<size_t>n * n):
        matrix[i] += Y[i] if is_odd else X[i]


cdef int slab_systems(int n, int n_in, int n_rhs, const double* lam_re, const double* lam_im, const double* X,
                      const double* Y, const double* c, const double* zeta, double thickness, const double* mu0,
                      double above, double* systems, int* pivots, double* vectors, double* scratch,
                      double* spare) noexcept nogil:
    """Factorises the two systems of a slab; the beam's field at its top and bottom."""
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * n_rhs, r, i
    cdef int info, per_beam = n_rhs // n_in, beam, j
    cdef double* y = scratch
    cdef double* z = scratch + n
    cdef double* xy = scratch + 2 * n
    cdef cplx* response = <cplx*>(scratch + 4 * n)
    cdef cplx k
    cdef double at_top, at_bottom
    slab_matrix(n, False, lam_re, lam_im, X, Y, thickness, systems, spare)
    info = factorise(n, systems, n, pivots)
    if info == 0 and not fades(n, lam_re, lam_im, thickness):
        slab_matrix(n, True, lam_re, lam_im, X, Y, thickness, systems + nn, spare)
        info = factorise(n, systems + nn, n, pivots + n)
    product(b"N", b"N", n, n_rhs, n, 0.5, Y, n, zeta, n, 0.0, vectors, n)
    memset(vectors + nr, 0, sizeof(double) * 2 * nr)
    for r in range(n_rhs):
        beam = <int>r // per_beam
        at_top = exp(-above / mu0[beam])
        for i in range(n):
            vectors[r * n + i] *= at_top
        if thickness > 1e300:
            continue
        at_bottom = exp(-thickness / mu0[beam])
        if r % per_beam == 0:
            for j in range(n):
                k = c_sqrt(make(lam_re[j], lam_im[j]))
                response[j] = beam_response(k, 1.0 / mu0[beam], thickness)
                response[n + j] = times(k, response[j])
        scale_coordinates(n, lam_im, response, c + r * n, y)
        scale_coordinates(n, lam_im, response + n, c + r * n, z)
        for j in range(n):
            z[j] += zeta[r * n + j] * at_bottom
        product(b"N", b"N", n, 1, n, 0.5 * at_top, X, n, y, n, 0.0, xy, n)
        product(b"N", b"N", n, 1, n, 0.5 * at_top, Y, n, z, n, 0.0, xy + n, n)
        for j in range(n):
            vectors[nr + r * n + j] = xy[j] - xy[n + j]
            vectors[2 * nr + r * n + j] = xy[j] + xy[n + j]
    return info


cdef int fading_slab(int n, const double* lam_re, const double* lam_im, const double* X, const double* Y, double thickness,
                     const double* systems, const int* pivots, int* pivots_inner, double* R, double* T, double* scratch,
                     double* spare) noexcept nogil:
    """R and T from those of the endless layer, R0 = (X - Y k) P^-1, and S = P e^(-k thickness) P^-1, P = X + Y k:
    R = (R0 - S W) a and T = (S - R0 W) a with W = R0 S, a = (1 - W^2)^-1."""
    cdef size_t nn = <size_t>n * n, i
    cdef int j, info = 0
    cdef double rate = slowest_rate(n, lam_re, lam_im)
    cdef double* W = scratch
    cdef double* M = scratch + nn
    cdef cplx* fade = <cplx*>spare
    transpose(n, X, W)
    solve(b"T", n, n, systems, n, pivots, W, n)
    transpose(n, W, R)
    for i in range(nn):
        R[i] *= 2.0
    for i in range(<size_t>n):
        R[i * n + i] -= 1.0
    memset(T, 0, sizeof(double) * nn)
    if thickness > 1e300:
        return 0
    slab_matrix(n, False, lam_re, lam_im, X, Y, thickness, M, spare)
    for j in range(n):
        fade[j] = c_exp(-thickness * c_sqrt(make(lam_re[j], lam_im[j])))
    scale_columns(n, n, lam_im, fade, M, W)
    transpose(n, W, M)
    solve(b"T", n, n, systems, n, pivots, M, n)
    transpose(n, M, T)                                                      # S
    product(b"N", b"N", n, n, n, 1.0, R, n, T, n, 0.0, W, n)
    memcpy(M, R, sizeof(double) * nn)                                       # R0
    product(b"N", b"N", n, n, n, -1.0, T, n, W, n, 1.0, R, n)
    product(b"N", b"N", n, n, n, -1.0, M, n, W, n, 1.0, T, n)
    if rate * thickness < 20.0:                                             # else W^2 < 1e-17
        memset(M, 0, sizeof(double) * nn)
        for i in range(<size_t>n):
            M[i * n + i] = 1.0
        product(b"N", b"N", n, n, n, -1.0, W, n, W, n, 1.0, M, n)
        info = factorise(n, M, n, pivots_inner)
        times_inverse(n, M, pivots_inner, R, W)
        times_inverse(n, M, pivots_inner, T, W)
    return info


cdef inline void times_inverse(int n, const double* lu, const int* pivots, double* a, double* spare) noexcept nogil:
    """a <- a M^-1, M given by its factors."""
    transpose(n, a, spare)
    solve(b"T", n, n, lu, n, pivots, spare, n)
    transpose(n, spare, a)


# (1:57)-(1:65)
cdef int join_layer(int n, int n_rhs, const double* lam_re, const double* lam_im, const double* X, const double* Y,
                    double thickness, double* systems,
                    const int* pivots, int* pivots_below, double* vectors, double* below, double* up, double* scratch,
                    double* spare) noexcept nogil:
    """R and T of the layer, then (star product) what lies below its top: `below` its reflection, `up` its emission."""
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * n_rhs, i, j
    cdef double* R = systems + 2 * nn
    cdef double* T = systems + 3 * nn
    cdef double* G = systems + 4 * nn
    cdef double* falling = vectors + 3 * nr
    cdef double* g = vectors + 4 * nr
    cdef double* old = scratch
    cdef int info
    if fades(n, lam_re, lam_im, thickness):
        info = fading_slab(n, lam_re, lam_im, X, Y, thickness, systems, pivots, pivots_below, R, T, scratch, spare)
        if info != 0:
            return info
    else:
        # X (X + Y lambda f)^-1 = (1 + R + T)/2 and Y (X f + Y)^-1 = (1 - R + T)/2, by transposed systems
        transpose(n, X, old)
        solve(b"T", n, n, systems, n, pivots, old, n)
        transpose(n, old, R)
        transpose(n, Y, old)
        solve(b"T", n, n, systems + nn, n, pivots + n, old, n)
        transpose(n, old, T)
        for i in range(nn):
            R[i], T[i] = R[i] - T[i], R[i] + T[i]
        for i in range(<size_t>n):
            T[i * n + i] -= 1.0
    # emitted with nothing falling in: the beam's own field leaving, less what would have to fall in to allow it
    for i in range(nr):
        falling[i] = vectors[2 * nr + i]
        spare[i] = -vectors[i]
    product(b"N", b"N", n, n_rhs, n, -1.0, T, n, vectors, n, 1.0, falling, n)
    product(b"N", b"N", n, n_rhs, n, -1.0, R, n, vectors + nr, n, 1.0, falling, n)
    product(b"N", b"N", n, n_rhs, n, -1.0, R, n, vectors, n, 1.0, spare, n)
    product(b"N", b"N", n, n_rhs, n, -1.0, T, n, vectors + nr, n, 1.0, spare, n)
    # between the layer and what lies below: (1 - Rb R)^-1
    memset(old, 0, sizeof(double) * nn)
    for i in range(<size_t>n):
        old[i * n + i] = 1.0
    product(b"N", b"N", n, n, n, -1.0, below, n, R, n, 1.0, old, n)
    info = factorise(n, old, n, pivots_below)
    memcpy(G, below, sizeof(double) * nn)
    solve(b"N", n, n, old, n, pivots_below, G, n)
    memcpy(g, up, sizeof(double) * nr)
    solve(b"N", n, n_rhs, old, n, pivots_below, g, n)
    product(b"N", b"N", n, n, n, 1.0, G, n, T, n, 0.0, old, n)
    memcpy(below, R, sizeof(double) * nn)
    product(b"N", b"N", n, n, n, 1.0, T, n, old, n, 1.0, below, n)
    memcpy(spare + nr, g, sizeof(double) * nr)
    product(b"N", b"N", n, n_rhs, n, 1.0, G, n, falling, n, 1.0, spare + nr, n)
    memcpy(up, spare, sizeof(double) * nr)
    product(b"N", b"N", n, n_rhs, n, 1.0, T, n, spare + nr, n, 1.0, up, n)
    return info


cdef void join_clear_layer(int n, int n_rhs, const double* lam_re, double thickness, double* systems, double* vectors,
                           double* below, double* up) noexcept nogil:
    """join_layer where nothing scatters: R = 0, T = e^(-thickness/mu), and the beam has no field of its own."""
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * n_rhs
    cdef int i, j
    cdef double passed
    cdef double* T = systems + 3 * nn
    memset(systems + 2 * nn, 0, sizeof(double) * 2 * nn)
    for i in range(n):
        T[<size_t>i * n + i] = exp(-thickness * sqrt(lam_re[i]))
    memcpy(systems + 4 * nn, below, sizeof(double) * nn)
    memset(vectors + 3 * nr, 0, sizeof(double) * nr)
    memcpy(vectors + 4 * nr, up, sizeof(double) * nr)
    for j in range(n):
        passed = T[<size_t>j * n + j]
        for i in range(n):
            below[<size_t>j * n + i] *= passed * T[<size_t>i * n + i]
    for j in range(n_rhs):
        for i in range(n):
            up[<size_t>j * n + i] *= T[<size_t>i * n + i]


# (1:49)-(1:56)
cdef double amplitudes(int n, int n_rhs, const double* lam_re, const double* lam_im, const double* X, const double* Y,
                       double thickness, const double* systems, const int* pivots, const double* top, const double* bottom,
                       double* even, double* odd, double* scratch, double* spare) noexcept nogil:
    """even = (X + Y lambda f)^-1 (top + bottom), odd = (X f + Y)^-1 (bottom - top); the relative residual."""
    cdef size_t nr = <size_t>n * n_rhs, nn = <size_t>n * n, i
    cdef double worst, largest = 0.0
    if fades(n, lam_re, lam_im, thickness):
        return fading_amplitudes(n, n_rhs, lam_re, lam_im, X, Y, thickness, systems, pivots, top, bottom, even, odd,
                                 scratch, spare)
    for i in range(nr):
        even[i] = top[i] + bottom[i]
        odd[i] = bottom[i] - top[i]
        largest = max(largest, max(fabs(even[i]), fabs(odd[i])))
    memcpy(spare, even, sizeof(double) * nr)
    solve(b"N", n, n_rhs, systems, n, pivots, even, n)
    slab_matrix(n, False, lam_re, lam_im, X, Y, thickness, scratch, scratch + nn)
    product(b"N", b"N", n, n_rhs, n, -1.0, scratch, n, even, n, 1.0, spare, n)
    worst = largest_of(nr, spare)
    memcpy(spare, odd, sizeof(double) * nr)
    solve(b"N", n, n_rhs, systems + nn, n, pivots + n, odd, n)
    slab_matrix(n, True, lam_re, lam_im, X, Y, thickness, scratch, scratch + nn)
    product(b"N", b"N", n, n_rhs, n, -1.0, scratch, n, odd, n, 1.0, spare, n)
    worst = max(worst, largest_of(nr, spare))
    return worst / largest if largest > 1e-280 else 0.0      # below, denormal numbers have no digits to check


# (2:12)-(2:15)
cdef double fading_amplitudes(int n, int n_rhs, const double* lam_re, const double* lam_im, const double* X,
                              const double* Y, double thickness, const double* systems, const int* pivots,
                              const double* top, const double* bottom, double* from_top, double* from_bottom,
                              double* scratch, double* spare) noexcept nogil:
    """from_top = P^-1 (2 top - Q e^(-k thickness) from_bottom), from_bottom = P^-1 (2 bottom - Q e^(-k thickness) from_top)
    by turns, P, Q = X +- Y k: each gains the factor e^(-k thickness) squared. The relative residual at the top."""
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * n_rhs, i
    cdef int sweep, sweeps = 1
    cdef double largest = 0.0
    for i in range(nr):
        largest = max(largest, 2.0 * fabs(top[i]))
        from_top[i] = 2.0 * top[i]
    solve(b"N", n, n_rhs, systems, n, pivots, from_top, n)
    memset(from_bottom, 0, sizeof(double) * nr)
    if thickness < 1e300:
        sweeps = 1 + <int>(19.0 / (slowest_rate(n, lam_re, lam_im) * thickness))
        for sweep in range(sweeps):
            if sweep > 0:
                other_face(n, n_rhs, lam_re, lam_im, X, Y, thickness, top, from_bottom, from_top, scratch, spare)
                solve(b"N", n, n_rhs, systems, n, pivots, from_top, n)
            other_face(n, n_rhs, lam_re, lam_im, X, Y, thickness, bottom, from_top, from_bottom, scratch, spare)
            solve(b"N", n, n_rhs, systems, n, pivots, from_bottom, n)
        other_face(n, n_rhs, lam_re, lam_im, X, Y, thickness, top, from_bottom, spare + nr, scratch, spare)
    else:
        for i in range(nr):
            spare[nr + i] = 2.0 * top[i]
    slab_matrix(n, False, lam_re, lam_im, X, Y, thickness, scratch, scratch + nn)
    product(b"N", b"N", n, n_rhs, n, -1.0, scratch, n, from_top, n, 1.0, spare + nr, n)
    return largest_of(nr, spare + nr) / largest if largest > 1e-280 else 0.0


cdef void other_face(int n, int n_rhs, const double* lam_re, const double* lam_im, const double* X, const double* Y,
                     double thickness, const double* entering, const double* amplitude, double* out, double* scratch,
                     double* spare) noexcept nogil:
    """out = 2 entering - (X - Y k) e^(-k thickness) amplitude."""
    cdef size_t nr = <size_t>n * n_rhs, i
    cdef int j, r
    cdef cplx* fade = <cplx*>scratch
    cdef cplx* slope = fade + n
    cdef cplx k
    for j in range(n):
        k = c_sqrt(make(lam_re[j], lam_im[j]))
        fade[j] = c_exp(-thickness * k)
        slope[j] = times(k, fade[j])
    for i in range(nr):
        out[i] = 2.0 * entering[i]
    for r in range(n_rhs):
        scale_coordinates(n, lam_im, fade, amplitude + <size_t>r * n, spare + <size_t>r * n)
    product(b"N", b"N", n, n_rhs, n, -1.0, X, n, spare, n, 1.0, out, n)
    for r in range(n_rhs):
        scale_coordinates(n, lam_im, slope, amplitude + <size_t>r * n, spare + <size_t>r * n)
    product(b"N", b"N", n, n_rhs, n, 1.0, Y, n, spare, n, 1.0, out, n)


cdef inline double largest_of(size_t n, const double* a) noexcept nogil:
    cdef size_t i
    cdef double largest = 0.0
    for i in range(n):
        largest = max(largest, fabs(a[i]))
    return largest


# ---------------------------------------------------------------------------------------------------------
# Impedance doubling: R and T of a homogeneous slab without an eigenproblem. With A = F E, half a slab's thickness h
# and f(A) = tanh(h sqrt A)/sqrt A: Ze = E f, Zo = f F, S = Z (1 + Z)^-1, R = So - Se, T = 1 - So - Se.
#
# Directions off the nodes are nodes of weight zero: a matrix is lower triangular in its blocks (incident, nodes,
# outgoing). On the diagonal II (r,) and OO (o,) are numbers, one a right-hand side or row, and N (n, n) a matrix; below
# it NI (r, n), ON (n, o), OI (r, o). The beam's scattering straight into an outgoing direction would be E's and F's OI:
# it is left at zero, because single scattering has a closed form; what OI then holds is multiple scattering alone.
# ---------------------------------------------------------------------------------------------------------

cdef struct Extended:
    double* N
    double* NI
    double* ON
    double* OI
    double* OO
    double* II


cdef struct Sizes:
    int n
    int r
    int o
    int stokes


def extended_size(n, r, o):
    """Doubles of one matrix with its incident and outgoing directions."""
    return n * n + r * n + n * o + r * o + o + r


cdef inline size_t size_extended(Sizes s) noexcept nogil:
    return <size_t>s.n * s.n + <size_t>s.r * s.n + <size_t>s.n * s.o + <size_t>s.r * s.o + s.o + s.r


cdef inline Extended extended_at(Sizes s, double* memory) noexcept nogil:
    cdef Extended x
    x.N = memory
    x.NI = x.N + <size_t>s.n * s.n
    x.ON = x.NI + <size_t>s.r * s.n
    x.OI = x.ON + <size_t>s.n * s.o
    x.OO = x.OI + <size_t>s.r * s.o
    x.II = x.OO + s.o
    return x


cdef inline void copy_extended(Sizes s, Extended a, Extended b) noexcept nogil:
    memcpy(b.N, a.N, sizeof(double) * size_extended(s))


cdef inline void scale_extended(Sizes s, double factor, Extended a) noexcept nogil:
    cdef size_t i
    for i in range(size_extended(s)):
        a.N[i] *= factor


cdef inline void add_extended(Sizes s, double factor, Extended a, Extended b) noexcept nogil:
    """b += factor a."""
    cdef size_t i
    for i in range(size_extended(s)):
        b.N[i] += factor * a.N[i]


cdef inline void add_identity(Sizes s, double factor, Extended a) noexcept nogil:
    cdef int i
    for i in range(s.n):
        a.N[<size_t>i * s.n + i] += factor
    for i in range(s.o):
        a.OO[i] += factor
    for i in range(s.r):
        a.II[i] += factor


cdef void product_extended(Sizes s, double factor, Extended a, Extended b, Extended c) noexcept nogil:
    """c = factor a b; c is neither a nor b."""
    cdef int i, j
    cdef size_t k
    product(b"N", b"N", s.n, s.n, s.n, factor, a.N, s.n, b.N, s.n, 0.0, c.N, s.n)
    for j in range(s.r):
        for i in range(s.n):
            k = <size_t>j * s.n + i
            c.NI[k] = a.NI[k] * b.II[j]
        for i in range(s.o):
            k = <size_t>j * s.o + i
            c.OI[k] = factor * (a.OI[k] * b.II[j] + a.OO[i] * b.OI[k])
        c.II[j] = factor * a.II[j] * b.II[j]
    for j in range(s.n):
        for i in range(s.o):
            k = <size_t>j * s.o + i
            c.ON[k] = a.OO[i] * b.ON[k]
    for i in range(s.o):
        c.OO[i] = factor * a.OO[i] * b.OO[i]
    product(b"N", b"N", s.n, s.r, s.n, factor, a.N, s.n, b.NI, s.n, factor, c.NI, s.n)
    product(b"N", b"N", s.o, s.n, s.n, factor, a.ON, s.o, b.N, s.n, factor, c.ON, s.o)
    product(b"N", b"N", s.o, s.r, s.n, factor, a.ON, s.o, b.NI, s.n, 1.0, c.OI, s.o)


cdef int invert_extended(Sizes s, Extended a, Extended spare, int* pivots) noexcept nogil:
    """a <- a^-1."""
    cdef int i, j, info = factorise(s.n, a.N, s.n, pivots), room = s.n * s.n
    cdef size_t k
    if info != 0:
        return info
    dgetri(&s.n, a.N, &s.n, pivots, spare.N, &room, &info)
    if info != 0:
        return info
    for i in range(s.o):
        a.OO[i] = 1.0 / a.OO[i]
    for j in range(s.r):
        a.II[j] = 1.0 / a.II[j]
        for i in range(s.n):
            spare.NI[<size_t>j * s.n + i] = -a.NI[<size_t>j * s.n + i] * a.II[j]
    product(b"N", b"N", s.n, s.r, s.n, 1.0, a.N, s.n, spare.NI, s.n, 0.0, a.NI, s.n)
    for j in range(s.r):
        for i in range(s.o):
            k = <size_t>j * s.o + i
            a.OI[k] = -a.OO[i] * a.OI[k] * a.II[j]
    for j in range(s.n):
        for i in range(s.o):
            k = <size_t>j * s.o + i
            spare.ON[k] = -a.OO[i] * a.ON[k]
    product(b"N", b"N", s.o, s.r, s.n, 1.0, spare.ON, s.o, a.NI, s.n, 1.0, a.OI, s.o)
    product(b"N", b"N", s.o, s.n, s.n, 1.0, spare.ON, s.o, a.N, s.n, 0.0, a.ON, s.o)
    return 0


def doubling_work(n, r, o):
    """Doubles of `work` that one thread of `double_slabs` needs."""
    return 8 * extended_size(n, r, o) + 4 * n


def double_slabs(const int[::1] orders, bint conserving, bint clear, bint settled, const int[::1] material, const double[::1] thickness, const double[::1] albedo,
                 const double[::1] asymmetry, const double[::1] nodes, const double[::1] weights, const double[::1] mu0,
                 const double[:, ::1] columns, const double[::1] mu_out, const double[:, :, :, ::1] E,
                 const double[:, :, :, ::1] F, const double[:, :, :, ::1] G_E, const double[:, :, :, ::1] G_F,
                 const double[:, :, :, ::1] source_s, const double[:, :, :, ::1] source_d, double[:, :, ::1] R,
                 double[:, :, ::1] T, double[:, :, ::1] lost, double[:, :, ::1] residual, int[:, ::1] doublings,
                 int[:, ::1] info, int threads, double[:, ::1] work, int[:, ::1] pivots, double[::1] seconds,
                 const int[::1] stop):
    """Reflection and transmission of homogeneous slabs, on the nodes and for directions off them.

    conserving: whether order 0 has I; clear: whether slabs without scattering are not doubled; settled: whether doublings
    that change R no more are cut short; material (slab,): place of the slab's material in albedo, asymmetry (material,) and in the matrices that `assemble`
    left; thickness (slab,), inf allowed; mu0 (n_in,), columns (n_col, S) the incident Stokes vectors, mu_out (n_out,).
    R, T (order, slab, extended_size(n, n_in n_col, S n_out)): blocks N, NI, ON, OI, OO, II one behind the other, T with
    the unscattered light on its diagonal; in order 0 the nodes are turned so that one axis (`flux_axis`) carries the flux.
    lost (order, slab, n): what the slab absorbs of it, its row of 1 - R - T. residual (order, slab, 2): how well
    R, and T, satisfy invariance, relative; doublings (order, slab).
    """
    cdef int n_order = <int>orders.shape[0], n_slab = <int>material.shape[0], item, thread, o, k, m
    cdef int n_item = n_order * n_slab
    cdef double start
    for item in prange(n_item, nogil=True, schedule="dynamic", num_threads=threads):
        thread = threadid()
        if not stop[0]:
            start = vrte_seconds()
            o = item // n_slab
            k = item % n_slab
            m = material[k]
            info[o, k] = double_one(
                orders[o] if conserving else max(orders[o], 1), clear, settled, <int>columns.shape[1], <int>weights.shape[0], <int>mu0.shape[0], <int>columns.shape[0], <int>mu_out.shape[0],
                thickness[k], albedo[m], asymmetry[m], &nodes[0], &weights[0], &mu0[0], &columns[0, 0], &mu_out[0],
                &E[o, m, 0, 0], &F[o, m, 0, 0], &G_E[o, m, 0, 0], &G_F[o, m, 0, 0], &source_s[o, m, 0, 0],
                &source_d[o, m, 0, 0], &R[o, k, 0], &T[o, k, 0], &lost[o, k, 0], &residual[o, k, 0], &doublings[o, k],
                &work[thread, 0], &pivots[thread, 0], &stop[0])
            seconds[thread] += vrte_seconds() - start


cdef int double_one(int m, bint clear, bint settled, int stokes, int n_node, int n_in, int n_col, int n_out, double thickness, double albedo, double asymmetry,
                    const double* nodes, const double* weights, const double* mu0, const double* columns,
                    const double* mu_out, const double* E, const double* F, const double* G_E, const double* G_F,
                    const double* source_s, const double* source_d, double* R, double* T, double* lost, double* residual,
                    int* doublings, double* work, int* pivots, const int* stop) noexcept nogil:
    cdef Sizes s
    cdef int info, i
    cdef size_t each
    s.n, s.r, s.o, s.stokes = stokes * n_node, n_in * n_col, stokes * n_out, stokes
    each = size_extended(s)
    cdef Extended e = extended_at(s, work), f = extended_at(s, work + each)
    cdef Extended Ze = extended_at(s, work + 2 * each), Zo = extended_at(s, work + 3 * each)
    cdef Extended C = extended_at(s, work + 4 * each), a = extended_at(s, work + 5 * each)
    cdef Extended b = extended_at(s, work + 6 * each), spare = extended_at(s, work + 7 * each)
    cdef Extended r = extended_at(s, R), t = extended_at(s, T)
    cdef double* v = work + 8 * each
    cdef double steepest = 0.0
    memset(R, 0, sizeof(double) * each)
    memset(T, 0, sizeof(double) * each)
    memset(lost, 0, sizeof(double) * s.n)
    residual[0] = residual[1] = 0.0
    doublings[0] = 0
    rates(s, n_col, nodes, mu0, mu_out, e, &steepest)
    if albedo == 0.0 and clear:
        clear_slab(s, thickness, nodes, weights, e, t, m, lost, v, spare.N)
        return 0
    extend(s, n_col, n_in, columns, E, G_E, source_d, mu_out, e)
    rates(s, n_col, nodes, mu0, mu_out, f, &steepest)
    extend(s, n_col, n_in, columns, F, G_F, source_s, mu_out, f)
    if m == 0:
        turn_extended(s, albedo, nodes, weights, columns, n_col, mu_out, v, e, f, spare.N)
    if thickness < 1e300:
        info = double_plainly(s, m, settled, thickness, steepest, e, f, Ze, Zo, C, a, b, spare, doublings, pivots, stop)
    else:
        info = double_endless(s, m, albedo, asymmetry, steepest, e, f, Ze, Zo, a, b, spare, doublings, pivots, stop)
    if info != 0 or stop[0]:
        return info
    info = reflect_and_transmit(s, thickness, Ze, Zo, C, a, b, spare, r, t, lost, m, pivots)
    if info == 0:
        half_sum_and_difference(s, e, f)
        if thickness > 1.5:
            reflect_by_invariance(s, e, f, r, t, a)
        invariance(s, thickness, e, f, r, t, a, b, spare, residual)
    return info


cdef void rates(Sizes s, int n_col, const double* nodes, const double* mu0, const double* mu_out, Extended a,
                double* steepest) noexcept nogil:
    """1/mu of the incident and outgoing directions on the diagonal; the largest of all."""
    cdef int i
    for i in range(s.o):
        a.OO[i] = 1.0 / mu_out[i // s.stokes]
        steepest[0] = max(steepest[0], a.OO[i])
    for i in range(s.r):
        a.II[i] = 1.0 / mu0[i // n_col]
        steepest[0] = max(steepest[0], a.II[i])
    for i in range(s.n // s.stokes):
        steepest[0] = max(steepest[0], 1.0 / nodes[i])


cdef void clear_slab(Sizes s, double thickness, const double* nodes, const double* weights, Extended rate, Extended t, int m,
                     double* lost, double* v, double* spare) noexcept nogil:
    """A slab that does not scatter: T alone."""
    cdef int i
    cdef double size = 0.0
    for i in range(s.n):
        t.N[<size_t>i * s.n + i] = exp(-thickness / nodes[i // s.stokes])
    for i in range(s.o):
        t.OO[i] = exp(-thickness * rate.OO[i])
    for i in range(s.r):
        t.II[i] = exp(-thickness * rate.II[i])
    if m != 0:
        return
    conserving_axis(s.n, s.stokes, nodes, weights, v)
    reflect_both(s.n, s.stokes, v, t.N, spare)
    for i in range(s.n // s.stokes):
        size += weights[i] * nodes[i]
    for i in range(s.n // s.stokes):     # the axis is minus the unit null vector
        lost[s.stokes * i] = sqrt(weights[i] * nodes[i] / size) * expm1(-thickness / nodes[i])
    turn_columns(s.n, s.stokes, 1, v, lost)


cdef void extend(Sizes s, int n_col, int n_in, const double* columns, const double* matrix, const double* G,
                 const double* source, const double* mu_out, Extended a) noexcept nogil:
    """E or F with its incident and outgoing directions: the sources with the other sign, no OI."""
    cdef int i, j
    memcpy(a.N, matrix, sizeof(double) * <size_t>s.n * s.n)
    for j in range(s.n):
        for i in range(s.o):
            a.ON[<size_t>j * s.o + i] = -G[<size_t>j * s.o + i] / mu_out[i // s.stokes]
    for i in range(n_in):
        product(b"N", b"N", s.n, n_col, s.stokes, -1.0, source + <size_t>s.stokes * i * s.n, s.n, columns, s.stokes, 0.0,
                a.NI + <size_t>i * n_col * s.n, s.n)
    memset(a.OI, 0, sizeof(double) * <size_t>s.r * s.o)


cdef void turn_extended(Sizes s, double albedo, const double* nodes, const double* weights, const double* columns, int n_col,
                        const double* mu_out, double* v, Extended e, Extended f, double* spare) noexcept nogil:
    """Order 0: one axis becomes sqrt(weight mu) on I, whose row and column of E are known exactly (2 N terms)."""
    cdef int i, axis = flux_axis(s.n, s.stokes)
    cdef double size = 0.0
    conserving_axis(s.n, s.stokes, nodes, weights, v)
    for i in range(s.n // s.stokes):
        size += weights[i] * nodes[i]
    size = sqrt(size)
    reflect_both(s.n, s.stokes, v, e.N, spare)
    reflect_both(s.n, s.stokes, v, f.N, spare)
    exact_conservation(s.n, s.stokes, albedo, nodes, weights, v, e.N, spare)
    turn_edges(s, v, e, spare)
    turn_edges(s, v, f, spare)
    for i in range(s.r):
        e.NI[<size_t>i * s.n + axis] = albedo * columns[s.stokes * (i % n_col)] / size
    for i in range(s.o):
        e.ON[<size_t>axis * s.o + i] = 0.0 if i % s.stokes else albedo / (mu_out[i // s.stokes] * size)


cdef inline void turn_edges(Sizes s, const double* v, Extended a, double* spare) noexcept nogil:
    """NI <- (1 - v v^T) NI, ON <- ON (1 - v v^T)."""
    turn_columns(s.n, s.stokes, s.r, v, a.NI)
    turn_rows(s.n, s.stokes, s.o, v, a.ON, spare)


cdef inline double norm_1(int n, const double* a) noexcept nogil:
    """The largest sum of a column's |elements|."""
    cdef int i, j
    cdef double largest = 0.0, total
    for j in range(n):
        total = 0.0
        for i in range(n):
            total += fabs(a[<size_t>j * n + i])
        largest = max(largest, total)
    return largest


cdef double SETTLED = 1e-17     # below the rounding of 1


cdef int double_plainly(Sizes s, int m, bint settled, double thickness, double steepest, Extended e, Extended f, Extended Ze, Extended Zo,
                        Extended C, Extended a, Extended b, Extended spare, int* doublings, int* pivots,
                        const int* stop) noexcept nogil:
    """Ze, Zo and C = 1 - Zo Ze of a finite slab: a rational start, then Zo <- 2 L^-1 Zo, Ze <- 2 Ze L^-1, L = 1 + Zo Ze.

    C is formed while half the thickness is at most 0.75, so that 1 - Zo Ze keeps its digits, then carried,
    C <- (C L^-1)^2, which keeps them where T is too small for a difference. settled: once C is below the rounding of 1,
    L = 2 and doublings change C alone.
    """
    cdef int info, step, i, count = 0, axis = flux_axis(s.n, s.stokes)
    cdef size_t k
    cdef double h = 0.5 * thickness
    cdef bint carried = False
    product_extended(s, 1.0, f, e, a)
    steepest = max(steepest, sqrt(norm_1(s.n, a.N)))
    while h * steepest > 0.5:
        h = 0.5 * h
        count = count + 1
    doublings[0] = count
    info = rational_start(s, h, e, f, Ze, Zo, a, b, C, spare, pivots)
    for step in range(count):
        if info != 0 or stop[0]:
            return info
        if settled and carried and largest_of(size_extended(s), C.N) < SETTLED:
            product_extended(s, 0.25, C, C, b)
            copy_extended(s, b, C)
            h = 2.0 * h
            direct_complement(s, h, e, C)
            continue
        product_extended(s, 1.0, Zo, Ze, a)                      # L - 1
        if 2.0 * h > 0.75 and not carried:
            complement(s, h, e, a, C)
            carried = True
        add_identity(s, 1.0, a)
        info = invert_extended(s, a, spare, pivots)
        product_extended(s, 2.0, a, Zo, b)
        copy_extended(s, b, Zo)
        if m == 0:
            for i in range(s.n):    # reciprocity; rounding in this row would double at each step
                k = <size_t>axis * s.n + i
                Zo.N[<size_t>i * s.n + axis] = -Zo.N[k] if s.stokes == 4 and i % 4 == 3 else Zo.N[k]
        product_extended(s, 2.0, Ze, a, b)
        copy_extended(s, b, Ze)
        h = 2.0 * h
        for i in range(s.o):
            Ze.OO[i] = Zo.OO[i] = tanh(h * e.OO[i])
        for i in range(s.r):
            Ze.II[i] = Zo.II[i] = tanh(h * e.II[i])
        if carried:
            product_extended(s, 1.0, C, a, b)
            product_extended(s, 1.0, b, b, C)
            direct_complement(s, h, e, C)
    if not carried:
        product_extended(s, 1.0, Zo, Ze, a)
        complement(s, h, e, a, C)
    return info


cdef inline void complement(Sizes s, double h, Extended rate, Extended product_of_both, Extended C) noexcept nogil:
    """C = 1 - Zo Ze."""
    copy_extended(s, product_of_both, C)
    scale_extended(s, -1.0, C)
    add_identity(s, 1.0, C)
    direct_complement(s, h, rate, C)


cdef inline void direct_complement(Sizes s, double h, Extended rate, Extended C) noexcept nogil:
    """1 - tanh^2 = 1/cosh^2 of the unscattered light, without a difference."""
    cdef int i
    for i in range(s.o):
        C.OO[i] = one_over_cosh_squared(h * rate.OO[i])
    for i in range(s.r):
        C.II[i] = one_over_cosh_squared(h * rate.II[i])


cdef inline double one_over_cosh_squared(double x) noexcept nogil:
    cdef double e = exp(-2.0 * x)
    return 4.0 * e / ((1.0 + e) * (1.0 + e))


cdef int rational_start(Sizes s, double h, Extended e, Extended f, Extended Ze, Extended Zo, Extended z, Extended power,
                        Extended above, Extended below, int* pivots) noexcept nogil:
    """Ze = E f, Zo = f F with the seventh convergent of tanh's continued fraction (2e-16 for h sqrt(A) <= 1/2).

    z: F E on entry. power, above, below: scratch.
    """
    cdef int info
    cdef double numerator[4]
    cdef double denominator[4]
    cdef int i
    numerator[0], numerator[1], numerator[2], numerator[3] = 135135.0, 17325.0, 378.0, 1.0
    denominator[0], denominator[1], denominator[2], denominator[3] = 135135.0, 62370.0, 3150.0, 28.0
    scale_extended(s, h * h, z)
    memset(above.N, 0, sizeof(double) * size_extended(s))
    memset(below.N, 0, sizeof(double) * size_extended(s))
    add_identity(s, numerator[0], above)
    add_identity(s, denominator[0], below)
    copy_extended(s, z, power)
    for i in range(1, 4):
        add_extended(s, numerator[i], power, above)
        add_extended(s, denominator[i], power, below)
        if i < 3:
            product_extended(s, 1.0, z, power, Ze)
            copy_extended(s, Ze, power)
    info = invert_extended(s, below, power, pivots)
    product_extended(s, h, below, above, z)
    product_extended(s, 1.0, e, z, Ze)
    product_extended(s, 1.0, z, f, Zo)
    for i in range(s.o):
        Ze.OO[i] = Zo.OO[i] = tanh(h * e.OO[i])
    for i in range(s.r):
        Ze.II[i] = Zo.II[i] = tanh(h * e.II[i])
    return info


cdef int double_endless(Sizes s, int m, double albedo, double asymmetry, double steepest, Extended e, Extended f,
                        Extended Ze, Extended Zo, Extended a, Extended b, Extended spare, int* doublings, int* pivots,
                        const int* stop) noexcept nogil:
    """Ze and Zo of a slab without end, where Zo Ze = 1, by scaled doublings.

    Before each, both are multiplied by ratio^(-1/2), `ratio` being the smallest over the largest eigenvalue of
    sqrt(Zo Ze): the smallest is estimated from below, and a wrong guess costs steps, no digits. The condition of L is
    1/ratio: it is not let below 1e-3.
    """
    cdef int info = 0, step, i, axis = flux_axis(s.n, s.stokes)
    cdef double ratio, used, gap, slowest
    product_extended(s, 1.0, f, e, a)
    steepest = max(steepest, sqrt(norm_1(s.n, a.N)))
    slowest = sqrt((1.0 - albedo) * (1.0 - albedo * asymmetry))
    if m > 0 or albedo == 1.0:
        slowest = max(slowest, 0.05)
    ratio = min(1.0, slowest / steepest)
    copy_extended(s, e, Ze)
    copy_extended(s, f, Zo)
    scale_extended(s, 1.0 / steepest, Ze)
    scale_extended(s, 1.0 / steepest, Zo)
    for step in range(100):
        if stop[0]:
            return 0
        used = max(ratio, 1e-3)
        scale_extended(s, 1.0 / sqrt(used), Ze)
        scale_extended(s, 1.0 / sqrt(used), Zo)
        product_extended(s, 1.0, Zo, Ze, a)
        gap = 0.0
        for i in range(s.n):
            if not (m == 0 and albedo == 1.0 and i == axis):     # there Ze = 0 for ever
                gap = max(gap, fabs(a.N[<size_t>i * s.n + i] - 1.0))
        for i in range(s.o):
            gap = max(gap, fabs(a.OO[i] - 1.0))
        for i in range(s.r):
            gap = max(gap, fabs(a.II[i] - 1.0))
        add_identity(s, 1.0, a)
        info = invert_extended(s, a, spare, pivots)
        if info != 0:
            return info
        product_extended(s, 2.0, a, Zo, b)
        copy_extended(s, b, Zo)
        product_extended(s, 2.0, Ze, a, b)
        copy_extended(s, b, Ze)
        doublings[0] += 1
        if gap < 1e-9 and ratio > 0.999:      # the error is squared by the step just done
            break
        # x -> 2 (x/sqrt(used))/(1 + x^2/used) of the two ends; the largest is 1 again
        ratio = min(2.0 * ratio * sqrt(used) / (used + ratio * ratio), 2.0 * sqrt(used) / (1.0 + used))
    return 0


cdef int reflect_and_transmit(Sizes s, double thickness, Extended Ze, Extended Zo, Extended C, Extended a, Extended b,
                              Extended spare, Extended r, Extended t, double* lost, int m, int* pivots) noexcept nogil:
    """r = So - Se and t = (1 + Zo)^-1 C (1 + Ze)^-1; without end r = 1 - 2 Se and t = 0. lost = 2 Se, the flux's row."""
    cdef int info, i, axis = flux_axis(s.n, s.stokes)
    cdef bint endless = thickness > 1e300
    copy_extended(s, Ze, a)
    add_identity(s, 1.0, a)
    info = invert_extended(s, a, spare, pivots)
    if info != 0:
        return info
    product_extended(s, -2.0 if endless else -1.0, Ze, a, r)
    if m == 0:
        for i in range(s.n):
            lost[i] = r.N[<size_t>i * s.n + axis] * (-1.0 if endless else -2.0)
    if endless:
        add_identity(s, 1.0, r)
    else:
        product_extended(s, 1.0, C, a, b)                        # C (1 + Ze)^-1
        copy_extended(s, Zo, a)
        add_identity(s, 1.0, a)
        info = invert_extended(s, a, spare, pivots)
        product_extended(s, 1.0, a, b, t)
        if thickness > 1.5:     # Zo may be as large as the slab is thick: So = 1 - (1 + Zo)^-1
            add_extended(s, -1.0, a, r)
            add_identity(s, 1.0, r)
        else:                   # Zo may be small: So = Zo (1 + Zo)^-1
            product_extended(s, 1.0, Zo, a, b)
            add_extended(s, 1.0, b, r)
    for i in range(s.o):      # unscattered light only
        r.OO[i] = 0.0
    for i in range(s.r):
        r.II[i] = 0.0
    return info


cdef inline void half_sum_and_difference(Sizes s, Extended e, Extended f) noexcept nogil:
    """E, F <- alpha, beta = (E +- F)/2: I+' = -alpha I+ - beta I~ and I~' = beta I+ + alpha I~."""
    cdef size_t i
    cdef double x
    for i in range(size_extended(s)):
        x = e.N[i]
        e.N[i] = 0.5 * (x + f.N[i])
        f.N[i] = 0.5 * (x - f.N[i])


cdef void reflect_by_invariance(Sizes s, Extended alpha, Extended beta, Extended r, Extended t, Extended spare) noexcept nogil:
    """R's OI anew, from R's and T's other blocks: a thin layer added on top and taken off below changes nothing.

    In a thick slab at omega = 1 Zo grows with the thickness, and what it leaves in OI is the difference of two such
    numbers; here nothing is large. (1/mu + 1/mu0) R = -(alpha R + R alpha + R beta R - T beta T) through the nodes.
    """
    cdef int i, j
    cdef size_t k, nr = <size_t>s.n * s.r
    # everything right of R_ON, and of T_ON
    memcpy(spare.NI, alpha.NI, sizeof(double) * nr)
    product(b"N", b"N", s.n, s.r, s.n, 1.0, beta.N, s.n, r.NI, s.n, 1.0, spare.NI, s.n)
    product(b"N", b"N", s.o, s.r, s.n, -1.0, r.ON, s.o, spare.NI, s.n, 0.0, r.OI, s.o)
    for j in range(s.r):
        for i in range(s.n):
            k = <size_t>j * s.n + i
            spare.NI[k] = beta.NI[k] * t.II[j]
    product(b"N", b"N", s.n, s.r, s.n, 1.0, beta.N, s.n, t.NI, s.n, 1.0, spare.NI, s.n)
    product(b"N", b"N", s.o, s.r, s.n, 1.0, t.ON, s.o, spare.NI, s.n, 1.0, r.OI, s.o)
    product(b"N", b"N", s.o, s.r, s.n, -1.0, alpha.ON, s.o, r.NI, s.n, 1.0, r.OI, s.o)
    for j in range(s.n):
        for i in range(s.o):
            k = <size_t>j * s.o + i
            spare.ON[k] = t.OO[i] * beta.ON[k]
    product(b"N", b"N", s.o, s.r, s.n, 1.0, spare.ON, s.o, t.NI, s.n, 1.0, r.OI, s.o)
    for j in range(s.r):
        for i in range(s.o):
            r.OI[<size_t>j * s.o + i] /= alpha.OO[i] + alpha.II[j]


cdef void invariance(Sizes s, double thickness, Extended alpha, Extended beta, Extended r, Extended t, Extended a, Extended b,
                     Extended c, double* residual) noexcept nogil:
    """How far R and T are from not caring whether a thin layer is added on top or at the bottom, relative:
    beta + alpha R + R alpha + R beta R = T beta T and (alpha + R beta) T = T (alpha + beta R).

    R counts relative to the light that it meets, not to itself: where albedo is 1e-12, nobody sees its last digits."""
    cdef size_t i, nn = <size_t>s.n * s.n
    cdef int n = s.n
    cdef double* x = a.N
    cdef double* y = b.N
    cdef double* z = c.N
    cdef double largest
    memcpy(x, alpha.N, sizeof(double) * nn)
    product(b"N", b"N", n, n, n, 1.0, r.N, n, beta.N, n, 1.0, x, n)      # alpha + R beta
    product(b"N", b"N", n, n, n, 1.0, t.N, n, beta.N, n, 0.0, y, n)      # T beta
    product(b"N", b"N", n, n, n, 1.0, r.N, n, alpha.N, n, 0.0, z, n)
    largest = largest_of(nn, alpha.N)
    largest = max(max(largest_of(nn, z), largest_of(nn, beta.N)), largest * min(1.0, thickness * largest))
    for i in range(nn):
        z[i] += beta.N[i]
    product(b"N", b"N", n, n, n, 1.0, x, n, r.N, n, 1.0, z, n)
    product(b"N", b"N", n, n, n, -1.0, y, n, t.N, n, 1.0, z, n)
    residual[0] = largest_of(nn, z) / largest if largest > 0.0 else 0.0
    product(b"N", b"N", n, n, n, 1.0, x, n, t.N, n, 0.0, z, n)
    largest = largest_of(nn, z)
    product(b"N", b"N", n, n, n, -1.0, t.N, n, alpha.N, n, 1.0, z, n)
    product(b"N", b"N", n, n, n, -1.0, y, n, r.N, n, 1.0, z, n)
    residual[1] = largest_of(nn, z) / largest if largest > 1e-280 else 0.0


# ---------------------------------------------------------------------------------------------------------
# Slabs joined by the star product from the base up, (2:8), then the field at their interfaces from the top down.
# ---------------------------------------------------------------------------------------------------------

def joining_work(n, n_slab, n_rhs, o):
    """Doubles of `work` that one thread of `join_slabs` needs."""
    return n_slab * (n * n + n * n_rhs) + (n_slab + 1) * 2 * n * n_rhs + 5 * n * n + 4 * n * n_rhs + 5 * n + 2 * o * (n + n_rhs)


def join_slabs(const int[::1] orders, bint conserving, const int[::1] slabs, const double[::1] above, const double[::1] nodes,
               const double[::1] weights, const double[::1] mu0, int n_out, const double[:, :, ::1] R,
               const double[:, :, ::1] T, const double[:, :, ::1] lost, const int[::1] base_row,
               const double[:, :, ::1] base, const double[:, :, ::1] base_source, const double[:, :, ::1] base_out,
               const int[::1] interface, double[:, :, :, ::1] up, double[:, :, :, ::1] down, double[:, :, :, ::1] flux,
               double[:, ::1] residual, int[::1] info, int threads, double[:, ::1] work, int[:, ::1] pivots,
               double[::1] seconds, const int[::1] stop):
    """The multiply scattered field at the interfaces of a pile of slabs, one Fourier order after another.

    conserving: whether order 0 has I. slabs (place,): which slab of R, T and lost (order, slab, ...) lies there, top first; above (place + 1,): optical
    depth of each interface, the last below the pile; base_row (order,): row of base (row, n, n), base_source (row,
    n_rhs, n) and base_out (row, n, S n_out), or -1 for black; interface (level,): where the field is wanted. up, down
    (order, level, n_rhs, S n_out): radiance times 2 pi for a unit beam, upward flipped by D; flux (order, level, 2,
    n_rhs): up and down through a horizontal plane, in order 0; residual (order, place): of the joints' systems.
    """
    cdef int n_order = <int>orders.shape[0], o, thread
    cdef Sizes s
    cdef double start
    s.stokes = <int>up.shape[3] // n_out
    s.n, s.r, s.o = s.stokes * <int>nodes.shape[0], <int>up.shape[2], s.stokes * n_out
    for o in prange(n_order, nogil=True, schedule="dynamic", num_threads=threads):
        thread = threadid()
        if not stop[0]:
            start = vrte_seconds()
            info[o] = join_one(
                s, conserving and orders[o] == 0, <int>slabs.shape[0], <int>mu0.shape[0], <int>interface.shape[0], &slabs[0], &above[0],
                &nodes[0], &weights[0], &mu0[0], <double*>&R[o, 0, 0], <double*>&T[o, 0, 0], &lost[o, 0, 0],
                &base[base_row[o], 0, 0] if base_row[o] >= 0 else NULL,
                &base_source[base_row[o], 0, 0] if base_row[o] >= 0 else NULL,
                &base_out[base_row[o], 0, 0] if base_row[o] >= 0 else NULL, &interface[0], &up[o, 0, 0, 0],
                &down[o, 0, 0, 0], &flux[o, 0, 0, 0], &residual[o, 0], &work[thread, 0], &pivots[thread, 0], &stop[0])
            seconds[thread] += vrte_seconds() - start


# (2:10)-(2:11)
cdef int join_one(Sizes s, bint conserving, int n_place, int n_in, int n_level, const int* slabs, const double* above,
                  const double* nodes, const double* weights, const double* mu0, double* R, double* T,
                  const double* lost, const double* base, const double* base_source, const double* base_out,
                  const int* interface, double* up, double* down, double* flux, double* residual, double* work, int* pivots,
                  const int* stop) noexcept nogil:
    cdef size_t nn = <size_t>s.n * s.n, nr = <size_t>s.n * s.r, no = <size_t>s.n * s.o, each = size_extended(s), i
    cdef double* G = work                                # per place: from falling at its bottom to up there,
    cdef double* g = G + n_place * nn                    # and what comes up by itself
    cdef double* going_up = g + n_place * nr             # per interface
    cdef double* going_down = going_up + (n_place + 1) * nr
    cdef double* below = going_down + (n_place + 1) * nr
    cdef double* scratch = below + nn                    # 4 n^2
    cdef double* vectors = scratch + 4 * nn              # 4 n n_rhs
    cdef double* absorbed = vectors + 4 * nr             # row of 1 - below that belongs to the flux
    cdef double* v = absorbed + s.n                      # then 3 n spare
    cdef double* out = v + 4 * s.n                       # base_out, turned, then running and spare
    cdef Extended r, t
    cdef int place, info, b, axis = flux_axis(s.n, s.stokes)
    cdef double size = 0.0
    memset(below, 0, sizeof(double) * nn)
    memset(absorbed, 0, sizeof(double) * s.n)
    memset(going_up, 0, sizeof(double) * 2 * (n_place + 1) * nr)
    absorbed[flux_axis(s.n, s.stokes)] = 1.0
    if conserving:
        conserving_axis(s.n, s.stokes, nodes, weights, v)
        for i in range(<size_t>s.n // s.stokes):
            size += weights[i] * nodes[i]
    if base != NULL:
        put_base(s, conserving, n_in, v, base, base_source, base_out, above[n_place], mu0, below,
                 going_up + n_place * nr, out, absorbed, scratch)
    for place in range(n_place - 1, -1, -1):
        if stop[0]:
            return 0
        r = extended_at(s, R + slabs[place] * each)
        t = extended_at(s, T + slabs[place] * each)
        info = join_below(s, conserving, n_in, above[place], mu0, r, t, lost + <size_t>slabs[place] * s.n, below, absorbed,
                          going_up + (place + 1) * nr, going_up + place * nr, G + place * nn, g + place * nr, scratch,
                          vectors, v + s.n, &residual[place], pivots)
        if info != 0:
            return info
    for place in range(n_place):        # falling: T down + emitted, then up = G falling + g, then R up on top of it
        r = extended_at(s, R + slabs[place] * each)
        t = extended_at(s, T + slabs[place] * each)
        emitted(s, n_in, above[place], mu0, t.NI, vectors)
        product(b"N", b"N", s.n, s.r, s.n, 1.0, t.N, s.n, going_down + place * nr, s.n, 1.0, vectors, s.n)
        memcpy(going_up + (place + 1) * nr, g + place * nr, sizeof(double) * nr)
        product(b"N", b"N", s.n, s.r, s.n, 1.0, G + place * nn, s.n, vectors, s.n, 1.0, going_up + (place + 1) * nr, s.n)
        memcpy(going_down + (place + 1) * nr, vectors, sizeof(double) * nr)
        product(b"N", b"N", s.n, s.r, s.n, 1.0, r.N, s.n, going_up + (place + 1) * nr, s.n, 1.0,
                going_down + (place + 1) * nr, s.n)
    for b in range(n_level):
        for i in range(<size_t>s.r):
            flux[(2 * b) * s.r + i] = -sqrt(size) * going_up[interface[b] * nr + i * s.n + axis]
            flux[(2 * b + 1) * s.r + i] = -sqrt(size) * going_down[interface[b] * nr + i * s.n + axis]
    leave(s, n_place, n_in, n_level, slabs, above, mu0, R, T, base_out != NULL, out, going_up, going_down, interface, up, down,
          out + no)
    return 0


cdef void put_base(Sizes s, bint conserving, int n_in, const double* v, const double* base, const double* base_source,
                   const double* base_out, double depth, const double* mu0, double* below, double* up, double* out,
                   double* absorbed, double* spare) noexcept nogil:
    """The base's operator, the beam that it reflects, its rows out, and (order 0) the row of what it absorbs."""
    cdef size_t nr = <size_t>s.n * s.r, i
    cdef int axis = flux_axis(s.n, s.stokes)
    memcpy(below, base, sizeof(double) * <size_t>s.n * s.n)
    memcpy(out, base_out, sizeof(double) * <size_t>s.n * s.o)
    for i in range(nr):
        up[i] = base_source[i] * exp(-depth / mu0[(i // s.n) // <size_t>(s.r // n_in)])
    if not conserving:
        return
    reflect_both(s.n, s.stokes, v, below, spare)
    turn_columns(s.n, s.stokes, s.r, v, up)
    turn_rows(s.n, s.stokes, s.o, v, out, spare)
    for i in range(<size_t>s.n):
        absorbed[i] = (1.0 if <int>i == axis else 0.0) - below[i * s.n + axis]
        if fabs(absorbed[i]) < 4e-16:    # rounding of the operator's quadrature, not a loss
            absorbed[i] = 0.0


cdef inline void emitted(Sizes s, int n_in, double depth, const double* mu0, const double* NI, double* out) noexcept nogil:
    """What a slab below optical depth `depth` sends out of the attenuated beam."""
    cdef size_t i
    cdef int j
    cdef double fade
    for j in range(s.r):
        fade = exp(-depth / mu0[j // (s.r // n_in)])
        for i in range(<size_t>s.n):
            out[<size_t>j * s.n + i] = fade * NI[<size_t>j * s.n + i]


# (2:8)
cdef int join_below(Sizes s, bint conserving, int n_in, double depth, const double* mu0, Extended r, Extended t,
                    const double* lost, double* below, double* absorbed, const double* up, double* up_above, double* G,
                    double* g, double* scratch, double* vectors, double* row, double* residual, int* pivots) noexcept nogil:
    """Puts a slab upon what lies below: G = (1 - below R)^-1 below, g = (1 - below R)^-1 up, below <- R + T G T.

    In order 0 the flux's row of 1 - below R, which is small where nothing absorbs, is summed from what is lost:
    lost + T's row + absorbed R, and `absorbed` becomes lost + (lost G + absorbed (1 + R G)) T.
    """
    cdef size_t nn = <size_t>s.n * s.n, nr = <size_t>s.n * s.r, i
    cdef int n = s.n, info, axis = flux_axis(s.n, s.stokes)
    cdef double* M = scratch
    cdef double* kept = M + nn
    cdef double* GT = kept + nn
    cdef double largest
    cdef double* rhs = vectors
    memset(M, 0, sizeof(double) * nn)
    for i in range(<size_t>n):
        M[i * n + i] = 1.0
    product(b"N", b"N", n, n, n, -1.0, below, n, r.N, n, 1.0, M, n)
    memcpy(G, below, sizeof(double) * nn)
    memcpy(g, up, sizeof(double) * nr)
    if conserving:
        product(b"N", b"N", 1, n, n, 1.0, absorbed, 1, r.N, n, 0.0, row, 1)
        for i in range(<size_t>n):
            row[i] += lost[i] + t.N[i * n + axis]
        largest = largest_of(n, row)
        if largest > 0.0:
            for i in range(<size_t>n):
                M[i * n + axis] = row[i] / largest
                G[i * n + axis] /= largest
            for i in range(<size_t>s.r):
                g[i * n + axis] /= largest
    memcpy(kept, M, sizeof(double) * nn)
    memcpy(rhs, g, sizeof(double) * nr)
    info = factorise(n, M, n, pivots)
    if info != 0:
        return info
    solve(b"N", n, n, M, n, pivots, G, n)
    solve(b"N", n, s.r, M, n, pivots, g, n)
    largest = largest_of(nr, rhs)
    product(b"N", b"N", n, s.r, n, -1.0, kept, n, g, n, 1.0, rhs, n)
    residual[0] = largest_of(nr, rhs) / largest if largest > 1e-280 else 0.0
    product(b"N", b"N", n, n, n, 1.0, G, n, t.N, n, 0.0, GT, n)
    if conserving:
        # absorbed (1 + R G) T = absorbed T + (absorbed R) GT
        product(b"N", b"N", 1, n, n, 1.0, absorbed, 1, r.N, n, 0.0, row, 1)
        for i in range(<size_t>n):
            row[i] += lost[i]
        memcpy(row + n, lost, sizeof(double) * n)
        product(b"N", b"N", 1, n, n, 1.0, row, 1, GT, n, 1.0, row + n, 1)
        product(b"N", b"N", 1, n, n, 1.0, absorbed, 1, t.N, n, 1.0, row + n, 1)
        memcpy(absorbed, row + n, sizeof(double) * n)
    memcpy(below, r.N, sizeof(double) * nn)
    product(b"N", b"N", n, n, n, 1.0, t.N, n, GT, n, 1.0, below, n)
    # up above = emitted up + T (G emitted down + g)
    emitted(s, n_in, depth, mu0, t.NI, vectors)
    memcpy(vectors + nr, g, sizeof(double) * nr)
    product(b"N", b"N", n, s.r, n, 1.0, G, n, vectors, n, 1.0, vectors + nr, n)
    emitted(s, n_in, depth, mu0, r.NI, up_above)
    product(b"N", b"N", n, s.r, n, 1.0, t.N, n, vectors + nr, n, 1.0, up_above, n)
    return 0


cdef void leave(Sizes s, int n_place, int n_in, int n_level, const int* slabs, const double* above, const double* mu0,
                double* R, double* T, bint has_base, const double* base_out, const double* going_up,
                const double* going_down, const int* interface, double* up, double* down, double* work) noexcept nogil:
    """The field off the nodes at every wanted interface, first up through the slabs, then down."""
    cdef size_t nr = <size_t>s.n * s.r, size = <size_t>s.o * s.r, each = size_extended(s)
    cdef double* running = work
    cdef double* next = running + size
    cdef Extended r, t
    cdef int place, level
    memset(running, 0, sizeof(double) * size)
    if has_base:
        product(b"N", b"N", s.o, s.r, s.n, 1.0, base_out, s.o, going_down + n_place * nr, s.n, 0.0, running, s.o)
    for place in range(n_place, -1, -1):
        for level in range(n_level):
            if interface[level] == place:
                memcpy(up + level * size, running, sizeof(double) * size)
        if place > 0:
            r = extended_at(s, R + slabs[place - 1] * each)
            t = extended_at(s, T + slabs[place - 1] * each)
            off_nodes(s, n_in, above[place - 1], mu0, r, t, going_up + place * nr, going_down + (place - 1) * nr, r.OI, t.OO,
                      running, next)
            memcpy(running, next, sizeof(double) * size)
    memset(running, 0, sizeof(double) * size)
    for place in range(n_place + 1):
        for level in range(n_level):
            if interface[level] == place:
                memcpy(down + level * size, running, sizeof(double) * size)
        if place < n_place:
            r = extended_at(s, R + slabs[place] * each)
            t = extended_at(s, T + slabs[place] * each)
            off_nodes(s, n_in, above[place], mu0, r, t, going_down + place * nr, going_up + (place + 1) * nr, t.OI, t.OO,
                      running, next)
            memcpy(running, next, sizeof(double) * size)


cdef inline void off_nodes(Sizes s, int n_in, double depth, const double* mu0, Extended r, Extended t,
                           const double* through, const double* turned, const double* OI, const double* direct,
                           const double* entering, double* out) noexcept nogil:
    """out = direct entering + T_ON through + R_ON turned + OI of the attenuated beam."""
    cdef int i, j
    cdef size_t k
    cdef double fade
    for j in range(s.r):
        fade = exp(-depth / mu0[j // (s.r // n_in)])
        for i in range(s.o):
            k = <size_t>j * s.o + i
            out[k] = direct[i] * entering[k] + fade * OI[k]
    product(b"N", b"N", s.o, s.r, s.n, 1.0, t.ON, s.o, through, s.n, 1.0, out, s.o)
    product(b"N", b"N", s.o, s.r, s.n, 1.0, r.ON, s.o, turned, s.n, 1.0, out, s.o)


# ---------------------------------------------------------------------------------------------------------
# The top of a layer without end, by invariance alone: a thin layer added on top changes nothing, so with E = D - e and
# F = D - f, D = 1/mu,
#   D R + R D = ((1 + R) e (1 + R) - (1 - R) f (1 - R))/2.
# e = phi C phi^T and f alike are of low rank, a few columns a degree. With He = phi_e + R phi_e, Hf = phi_f - R phi_f
# (Ambarzumian's functions, as matrices) R = (He Ce He'^T - Hf Cf Hf'^T)/2 over 1/mu + 1/mu', and H' = Q H q by
# reciprocity, Q and q the signs of V. A fixed point of it gains a factor of about q of `order_bounds` a step.
# ---------------------------------------------------------------------------------------------------------

def invariance_work(n_node, n_off, stokes, n_term):
    """Doubles of `work` that one thread of `reflect_endless` needs."""
    n, u = stokes * n_node, stokes * n_off
    return 3 * (n_node + n_off) * n_term + n_node + 12 * n_term * (n + u) + n * n + u * n + u * u + 6 * n * max(n, u) + u * u


def reflect_endless(const int[::1] orders, const int[::1] members, const double[:, ::1] coefficients, int terms,
                    double albedo, const double[::1] directions, const double[::1] weights, const int[::1] out,
                    const int[::1] into, const double[:, ::1] columns, double tolerance, bint halves,
                    double[:, :, :, ::1] up, double[:, :, ::1] on_nodes, double[::1] residual, int[::1] steps, int threads, double[:, ::1] work,
                    double[::1] seconds, const int[::1] stop):
    """The light that a layer without end sends back, one Fourier order after another, single scattering left out.

    members (S,): the Stokes parameters; coefficients (term, 6); directions: nodes, then off the nodes; weights (N,);
    out (n_out,), into (n_in,): places among the latter; columns (n_col, S); halves: whether one half of each symmetric
    product is computed and the other mirrored. up (order, n_in, n_col, S n_out): radiance times 2 pi for a unit beam, flipped by D; on_nodes (order, n_in n_col, n): the scaled diffuse field on the nodes, all
    of it. residual (order,): what is still missing of R, estimated from the last steps, relative to its largest element;
    steps (order,).
    """
    cdef int n_order = <int>orders.shape[0], o, thread, stokes = <int>members.shape[0]
    cdef double start
    for o in prange(n_order, nogil=True, schedule="dynamic", num_threads=threads):
        thread = threadid()
        if not stop[0]:
            start = vrte_seconds()
            endless_one(orders[o], parity_of(orders[o], stokes, &members[0]), terms, albedo, &coefficients[0, 0],
                        &directions[0], <int>directions.shape[0], &weights[0], <int>weights.shape[0], &out[0],
                        <int>out.shape[0], &into[0], <int>into.shape[0], &columns[0, 0], <int>columns.shape[0], tolerance, halves,
                        &up[o, 0, 0, 0], &on_nodes[o, 0, 0], &residual[o], &steps[o], &work[thread, 0], &stop[0])
            seconds[thread] += vrte_seconds() - start


cdef struct Sheet:
    # what one kind (E or F) has on some rows: phi, H and H C, column by column
    int rows
    int columns
    double* phi
    double* H
    double* HC


cdef double* sheet_at(double* memory, Parity p, int m, int terms, int kind, int n_mu, Sheet* sheet) noexcept nogil:
    """Places a sheet; what lies behind it."""
    sheet.rows, sheet.columns = p.stokes * n_mu, columns_of(p, m, terms, kind)
    sheet.phi = memory
    sheet.H = sheet.phi + <size_t>sheet.rows * sheet.columns
    sheet.HC = sheet.H + <size_t>sheet.rows * sheet.columns
    return sheet.HC + <size_t>sheet.rows * sheet.columns


cdef void step_of(Sheet rows, Sheet nodes, double sign, double* HC_H, double add) noexcept nogil:
    """HC_H = sign H C H_nodes^T + add HC_H."""
    product(b"N", b"T", rows.rows, nodes.rows, rows.columns, sign, rows.HC, rows.rows, nodes.H, nodes.rows, add, HC_H,
            rows.rows)


cdef void half_step_of(Sheet nodes, double sign, double* HC_H, double add) noexcept nogil:
    """step_of on the nodes, where it is symmetric: STRIPS strips of columns, each from the diagonal down."""
    cdef int strip, first, last
    for strip in range(STRIPS):
        first, last = nodes.rows * strip // STRIPS, nodes.rows * (strip + 1) // STRIPS
        if last > first:
            product(b"N", b"T", nodes.rows - first, last - first, nodes.columns, sign, nodes.HC + first, nodes.rows,
                    nodes.H + first, nodes.rows, add, HC_H + <size_t>first * nodes.rows + first, nodes.rows)


cdef void mirror(int n, double* a) noexcept nogil:
    """a's lower triangle above the diagonal."""
    cdef int i, j
    for j in range(n):
        for i in range(j + 1, n):
            a[<size_t>i * n + j] = a[<size_t>j * n + i]


cdef void renew(Sheet rows, Sheet nodes, double sign, const double* R) noexcept nogil:
    """H = phi + sign R phi_nodes."""
    memcpy(rows.H, rows.phi, sizeof(double) * <size_t>rows.rows * rows.columns)
    product(b"N", b"N", rows.rows, rows.columns, nodes.rows, sign, R, rows.rows, nodes.phi, nodes.rows, 1.0, rows.H,
            rows.rows)


cdef void divide_by_rates(Parity p, int n_row, const double* mu_row, int n_column, const double* mu_column,
                          double* new) noexcept nogil:
    """new <- new Q/2 over 1/mu + 1/mu'."""
    cdef int i, j, a, b, rows = p.stokes * n_row
    cdef double share, sign
    cdef double* column
    for j in range(n_column):
        for i in range(n_row):
            share = 0.5 * mu_row[i] * mu_column[j] / (mu_row[i] + mu_column[j])
            for b in range(p.stokes):
                sign = -share if b == p.place[3] else share
                column = new + <size_t>(p.stokes * j + b) * rows + p.stokes * i
                for a in range(p.stokes):
                    column[a] *= sign


cdef inline double largest_in(int size, const double* a) noexcept nogil:
    cdef int one = 1
    return fabs(a[idamax(&size, <double*>a, &one) - 1]) if size > 0 else 0.0


cdef inline double scalar_product(int size, const double* a, const double* b) noexcept nogil:
    cdef int one = 1
    return ddot(&size, <double*>a, &one, <double*>b, &one)


cdef struct Past:
    # what the last fixed-point steps led to, by how much they moved, this one first; products of the movements
    int steps
    double* led[3]
    double* moved[3]
    double products[3][3]


cdef void remember(int size, Past* past) noexcept nogil:
    """The step just done becomes the last one; room for a new one is where the oldest was."""
    cdef double* led = past.led[2]
    cdef double* moved = past.moved[2]
    past.led[2], past.led[1], past.led[0] = past.led[1], past.led[0], led
    past.moved[2], past.moved[1], past.moved[0] = past.moved[1], past.moved[0], moved
    past.products[2][2], past.products[1][1] = past.products[1][1], past.products[0][0]
    past.products[1][2] = past.products[0][1]
    past.steps += 1


cdef void accelerate(int size, Past* past, double* R) noexcept nogil:
    """R <- the combination of this step and the last two that would have moved least (Anderson's acceleration)."""
    cdef int k
    cdef double a11, a12, a22 = 0.0, b1, b2 = 0.0, det, g1 = 0.0, g2 = 0.0, c0, c1
    cdef const double* x = past.led[0]
    cdef const double* y = past.led[1]
    cdef const double* z = past.led[2]
    for k in range(min(past.steps, 2) + 1):
        past.products[0][k] = scalar_product(size, past.moved[0], past.moved[k])
    if past.steps > 0:
        a11 = past.products[0][0] - 2.0 * past.products[0][1] + past.products[1][1]
        b1 = past.products[0][0] - past.products[0][1]
        if past.steps > 1:
            a12 = past.products[0][1] - past.products[0][2] - past.products[1][1] + past.products[1][2]
            a22 = past.products[1][1] - 2.0 * past.products[1][2] + past.products[2][2]
            b2 = past.products[0][1] - past.products[0][2]
            det = a11 * a22 - a12 * a12
            if det > 1e-10 * a11 * a22:
                g1, g2 = (b1 * a22 - b2 * a12) / det, (b2 * a11 - b1 * a12) / det
        if g2 == 0.0 and a11 > 0.0:
            g1 = b1 / a11
    if g1 == 0.0:
        memcpy(R, x, sizeof(double) * size)
        return
    c0, c1 = 1.0 - g1, g1 - g2
    if g2 == 0.0:
        for k in range(size):
            R[k] = c0 * x[k] + c1 * y[k]
    else:
        for k in range(size):
            R[k] = c0 * x[k] + c1 * y[k] + g2 * z[k]


cdef double settle(Parity p, int m, int terms, double albedo, const double* coefficients, Sheet* rows, Sheet* nodes,
                   const double* mu_row, const double* mu_node, double rate, double tolerance, bint halves,
                   double* R, double* room, int* steps, const int* stop) noexcept nogil:
    """Fixed points for R of some rows until what is missing is below the tolerance; the rows may be the nodes. rate: what
    a step gains at least; room: six matrices like R; halves: on the nodes alone, where H C H^T is symmetric."""
    cdef int step, kind, k, size = rows[0].rows * nodes[0].rows
    cdef double gap, largest, missing = 1.0
    cdef double* new
    cdef bint done
    cdef Past past
    past.steps = 0
    for k in range(3):
        past.led[k], past.moved[k] = room + <size_t>2 * k * size, room + <size_t>(2 * k + 1) * size
    memset(R, 0, sizeof(double) * size)
    for kind in range(2):
        memcpy(rows[kind].H, rows[kind].phi, sizeof(double) * <size_t>rows[kind].rows * rows[kind].columns)
    for step in range(MOST_STEPS):
        new = past.led[0]
        for kind in range(2):
            times_coefficients(p, m, terms, kind, albedo, -1.0, coefficients, rows[kind].rows, rows[kind].H, rows[kind].HC)
            if halves:
                half_step_of(nodes[kind], -1.0 if kind else 1.0, new, 1.0 if kind else 0.0)
            else:
                step_of(rows[kind], nodes[kind], -1.0 if kind else 1.0, new, 1.0 if kind else 0.0)
        if halves:
            mirror(nodes[0].rows, new)
        divide_by_rates(p, rows[0].rows // p.stokes, mu_row, nodes[0].rows // p.stokes, mu_node, new)
        for k in range(size):
            past.moved[0][k] = new[k] - R[k]
        gap, largest = largest_in(size, past.moved[0]), largest_in(size, new)
        missing = gap * rate / (1.0 - rate) / largest if largest > 0.0 else 1.0
        steps[0] += 1
        done = largest == 0.0 or missing <= tolerance or gap <= 4e-16 * largest or stop[0]
        if done:
            memcpy(R, new, sizeof(double) * size)
        else:
            accelerate(size, &past, R)
            remember(size, &past)
        for kind in range(2):
            renew(rows[kind], nodes[kind], -1.0 if kind else 1.0, R)
        if done:
            return 0.0 if largest == 0.0 else missing
    return missing


cdef enum:
    MOST_STEPS = 400
    STRIPS = 4     # that a symmetric product is made in


cdef void endless_one(int m, Parity p, int terms, double albedo, const double* coefficients, const double* directions,
                      int n_all, const double* weights, int n_node, const int* out, int n_out, const int* into, int n_in,
                      const double* columns, int n_col, double tolerance, bint halves, double* up, double* on_nodes, double* residual,
                      int* steps, double* work, const int* stop) noexcept nogil:
    cdef int n_off = n_all - n_node, n = p.stokes * n_node, u = p.stokes * n_off, kind, i, j, a, b, c, beam, rhs
    cdef const double* off = directions + n_node
    cdef double* prt = work
    cdef double* scale = prt + <size_t>3 * n_all * terms
    cdef double* R = scale + n_node
    cdef double* Ru = R + <size_t>n * n                   # (u, n)
    cdef double* Ruu = Ru + <size_t>u * n                 # (u, u)
    cdef double* new = Ruu + <size_t>u * u                # room for steps
    cdef double* memory = new + 6 * <size_t>n * max(n, u) + <size_t>u * u
    cdef Sheet nodes[2]
    cdef Sheet rows[2]
    cdef double total, sign, rate = 0.0
    spherical(m, terms, is_polar(p), directions, n_all, prt)
    for i in range(m, terms):
        rate = max(rate, albedo * norm_of_coefficients(coefficients + 6 * i) / (2.0 * i + 1.0))
    rate = min(rate, 0.999)
    for i in range(n_node):
        scale[i] = sqrt(weights[i] / directions[i])
    for kind in range(2):
        memory = sheet_at(memory, p, m, terms, kind, n_node, &nodes[kind])
        memory = sheet_at(memory, p, m, terms, kind, n_off, &rows[kind])
        parity_columns(p, m, terms, kind, prt, n_all, 0, n_node, scale, nodes[kind].phi)
        parity_columns(p, m, terms, kind, prt, n_all, n_node, n_off, NULL, rows[kind].phi)
    steps[0] = 0
    residual[0] = settle(p, m, terms, albedo, coefficients, nodes, nodes, directions, directions, rate, tolerance, halves, R,
                         new, steps, stop)
    residual[0] = max(residual[0], settle(p, m, terms, albedo, coefficients, rows, nodes, off, directions, rate, tolerance, False,
                                          Ru, new, steps, stop))
    # from off the nodes to off the nodes, less what is scattered once
    for kind in range(2):
        sign = -1.0 if kind else 1.0
        times_coefficients(p, m, terms, kind, albedo, -1.0, coefficients, u, rows[kind].H, rows[kind].HC)
        product(b"N", b"T", u, u, rows[kind].columns, sign, rows[kind].HC, u, rows[kind].H, u, 1.0 if kind else 0.0, new, u)
        times_coefficients(p, m, terms, kind, albedo, -1.0, coefficients, u, rows[kind].phi, rows[kind].HC)
        product(b"N", b"T", u, u, rows[kind].columns, -sign, rows[kind].HC, u, rows[kind].phi, u, 1.0, new, u)
    divide_by_rates(p, n_off, off, n_off, off, new)
    memcpy(Ruu, new, sizeof(double) * <size_t>u * u)
    for beam in range(n_in):
        for c in range(n_col):
            rhs = beam * n_col + c
            for i in range(n_out):
                for a in range(p.stokes):
                    total = 0.0
                    for b in range(p.stokes):
                        total += Ruu[<size_t>(p.stokes * into[beam] + b) * u + p.stokes * out[i] + a] * columns[c * p.stokes + b]
                    up[(<size_t>rhs * n_out + i) * p.stokes + a] = total / off[out[i]]
            for j in range(n):                           # R_NI = Q Ru^T Q
                total = 0.0
                for b in range(p.stokes):
                    sign = -1.0 if (b == p.place[3]) != (j % p.stokes == p.place[3]) else 1.0
                    total += sign * Ru[<size_t>j * u + p.stokes * into[beam] + b] * columns[c * p.stokes + b]
                on_nodes[<size_t>rhs * n + j] = total


# ---------------------------------------------------------------------------------------------------------
# Reconstruction by source-function integration, (1:36)-(1:38), as products of matrices. The beam's direct
# source is left out: single scattering has a closed form over all orders (`single_scattering` below).
# ---------------------------------------------------------------------------------------------------------

cdef inline void fading_integrals(cplx k, double mu, double thickness, double depth, cplx* from_top,
                                  cplx* from_bottom) noexcept nogil:
    """int e^(-k x) and int e^(-k (thickness - x)) times e^(-(x - depth)/mu) dx/mu over x from depth to the bottom."""
    cdef double left = thickness - depth
    from_bottom[0] = make(0.0, 0.0)
    if thickness > 1e300:
        from_top[0] = over(c_exp(-depth * k), 1.0 + mu * k)
    else:
        from_top[0] = over(times(c_exp(-depth * k), -c_expm1(-left * (k + 1.0 / mu))), 1.0 + mu * k)
        from_bottom[0] = (left / mu) * exp_difference(-left * k, make(-left / mu, 0.0))


cdef void hyperbolic_integrals(cplx k, double mu, double thickness, double depth, cplx* cosine, cplx* sine) noexcept nogil:
    """int cosh(k t)/cosh(k h) and int sinh(k t)/(k cosh(k h)) times e^(-(x - depth)/mu) dx/mu over x from depth to
    the slab's bottom, t = x - h."""
    cdef double left = thickness - depth, h = 0.5 * thickness
    cdef cplx from_top, from_bottom, whole, u, v, plus, minus
    fading_integrals(k, mu, thickness, depth, &from_top, &from_bottom)
    whole = 1.0 + c_exp(-thickness * k)
    cosine[0] = over(from_top + from_bottom, whole)
    if size_of(k) * thickness > 1.0:
        sine[0] = over(from_bottom - from_top, times(k, whole))
        return
    # near k = 0: e^(k(depth - h)) times int e^(k(x - depth)) ..., differenced between k and -k
    plus, minus = left * k - left / mu, -left * k - left / mu
    u = (2.0 * (depth - h)) * exp_difference((depth - h) * k, (h - depth) * k)
    v = (left / mu) * exp_difference(make(0.0, 0.0), plus)
    sine[0] = 0.5 * times(u, v)
    v = (2.0 * left * left / mu) * exp_difference_2(make(0.0, 0.0), plus, minus)
    sine[0] = sine[0] + 0.5 * times(c_exp((h - depth) * k), v)
    whole = 0.5 * (c_exp(h * k) + c_exp(-h * k))
    sine[0] = over(sine[0], whole)


cdef inline double beam_up(double mu, double mu0, double thickness, double depth) noexcept nogil:
    """int e^(-x/mu0) e^(-(x - depth)/mu) dx/mu from depth to the slab's bottom."""
    cdef double rate = 1.0 / mu + 1.0 / mu0
    return exp(-depth / mu0) * -expm1(-(thickness - depth) * rate) / (mu * rate)


cdef inline double beam_down(double mu, double mu0, double depth) noexcept nogil:
    """int e^(-x/mu0) e^(-(depth - x)/mu) dx/mu from the slab's top to depth."""
    return (depth / mu) * exp_difference(make(-depth / mu0, 0.0), make(-depth / mu, 0.0)).real


def reconstruction_work(n, rows, n_rhs, n_layer):
    """Doubles of `work` that one thread of `reconstruct` needs."""
    return 2 * rows * n * n_layer + 5 * rows * n_rhs + 3 * rows * n + n * n_rhs + 2 * n + rows


def reconstruct(const double[:, :, :, ::1] G_E, const double[:, :, :, ::1] G_F, const double[:, :, ::1] lam_re,
                const double[:, :, ::1] lam_im, const double[:, :, :, ::1] X, const double[:, :, :, ::1] Y,
                const double[:, :, :, ::1] c, const double[:, :, :, ::1] zeta, const double[:, :, :, ::1] even,
                const double[:, :, :, ::1] odd, const double[:, :, ::1] base_down, const int[::1] base_row,
                const double[:, :, ::1] base_out, const double[::1] thickness, const double[::1] above,
                const double[::1] mu0, const double[::1] mu_out, int n_up, const double[::1] level,
                const int[::1] level_layer, double[:, :, :, ::1] out, int threads, double[:, ::1] work, double[::1] seconds,
                const int[::1] stop):
    """The field at any depth and direction, one Fourier order after another, without singly scattered light.

    mu_out (n_out,): positive cosines, the first n_up of them for light going up, the others down; level (n_tau,):
    depth below the top of layer level_layer; base_out (row, n, S n_out): what the base sends up from the scaled
    field on its nodes. out (order, n_tau, n_rhs, S n_out): radiance times 2 pi for a unit beam; upward rows are
    flipped by D.
    """
    cdef int n_order = <int>X.shape[0], o, thread
    cdef double start
    for o in prange(n_order, nogil=True, schedule="dynamic", num_threads=threads):
        thread = threadid()
        if not stop[0]:
            start = vrte_seconds()
            reconstruct_one(
                <int>X.shape[3], <int>(out.shape[3] // mu_out.shape[0]), <int>mu_out.shape[0], n_up, <int>X.shape[1], <int>mu0.shape[0], <int>c.shape[2],
                <int>level.shape[0], &G_E[o, 0, 0, 0], &G_F[o, 0, 0, 0], &lam_re[o, 0, 0], &lam_im[o, 0, 0],
                &X[o, 0, 0, 0], &Y[o, 0, 0, 0], &c[o, 0, 0, 0], &zeta[o, 0, 0, 0], &even[o, 0, 0, 0], &odd[o, 0, 0, 0],
                &base_down[o, 0, 0], &base_out[base_row[o], 0, 0] if base_row[o] >= 0 else NULL, &thickness[0], &above[0],
                &mu0[0], &mu_out[0], &level[0], &level_layer[0], &out[o, 0, 0, 0], &work[thread, 0])
            seconds[thread] += vrte_seconds() - start


cdef void reconstruct_one(int n, int stokes, int n_out, int n_up, int n_layer, int n_in, int n_rhs, int n_level, const double* G_E,
                          const double* G_F, const double* lam_re, const double* lam_im, const double* X, const double* Y,
                          const double* c, const double* zeta, const double* even, const double* odd,
                          const double* base_down, const double* base_out, const double* thickness, const double* above,
                          const double* mu0, const double* mu_out, const double* level, const int* level_layer,
                          double* out, double* work) noexcept nogil:
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * n_rhs, rows = stokes * n_out, size = rows * n_rhs, i, r
    cdef double* g_e = work                             # G_E X and G_F Y, per layer
    cdef double* g_f = g_e + rows * n * n_layer
    cdef double* running = g_f + rows * n * n_layer     # the field that enters the present layer
    cdef double* part = running + size
    cdef double* spare = part + size
    cdef int layer, t
    for layer in range(n_layer):
        product(b"N", b"N", <int>rows, n, n, 1.0, G_E + layer * rows * n, <int>rows, X + layer * nn, n, 0.0,
                g_e + layer * rows * n, <int>rows)
        product(b"N", b"N", <int>rows, n, n, 1.0, G_F + layer * rows * n, <int>rows, Y + layer * nn, n, 0.0,
                g_f + layer * rows * n, <int>rows)
    # light going up: from the base through the layers
    memset(running, 0, sizeof(double) * size)
    if base_out != NULL and n_up > 0:
        product(b"N", b"N", stokes * n_up, n_rhs, n, 1.0, base_out, <int>rows, base_down, n, 0.0, running, <int>rows)
    for layer in range(n_layer - 1, -1, -1):
        for t in range(n_level + 1):
            if t < n_level and level_layer[t] != layer:
                continue
            if t == n_level and layer == 0:
                continue
            through_layer(True, n, stokes, <int>rows, n_up, n_in, n_rhs, g_e + layer * rows * n, g_f + layer * rows * n,
                          lam_re + layer * n, lam_im + layer * n, c + layer * nr, zeta + layer * nr, even + layer * nr,
                          odd + layer * nr, thickness[layer], above[layer], mu0, mu_out, level[t] if t < n_level else 0.0,
                          running, out + t * size if t < n_level else part, spare)
        if layer > 0:
            memcpy(running, part, sizeof(double) * size)
    # light going down: from the top through the layers
    memset(running, 0, sizeof(double) * size)
    for layer in range(n_layer):
        for t in range(n_level + 1):
            if t < n_level and level_layer[t] != layer:
                continue
            if t == n_level and layer == n_layer - 1:
                continue
            through_layer(False, n, stokes, <int>rows, n_out - n_up, n_in, n_rhs, g_e + layer * rows * n + stokes * n_up,
                          g_f + layer * rows * n + stokes * n_up, lam_re + layer * n, lam_im + layer * n, c + layer * nr,
                          zeta + layer * nr, even + layer * nr, odd + layer * nr, thickness[layer], above[layer], mu0,
                          mu_out + n_up, level[t] if t < n_level else thickness[layer], running + stokes * n_up,
                          (out + t * size if t < n_level else part) + stokes * n_up, spare)
        if layer < n_layer - 1:
            memcpy(running, part, sizeof(double) * size)


# (1:36)-(1:38)
cdef void through_layer(bint upward, int n, int stokes, int rows, int n_mu, int n_in, int n_rhs, const double* g_e, const double* g_f,
                        const double* lam_re, const double* lam_im, const double* c, const double* zeta,
                        const double* even, const double* odd, double thickness, double above, const double* mu0,
                        const double* mu_out, double depth, const double* entering, double* out, double* work) noexcept nogil:
    """out = what arrives at `depth`: entering light attenuated, plus the layer's source between its far face and depth.

    g_e, g_f, entering and out have S n_mu used rows of `rows`.
    """
    cdef size_t used = stokes * n_mu, r, i, column
    cdef int j, mu, beam, per_beam = n_rhs // n_in
    cdef bint fading
    cdef double left = thickness - depth if upward else depth     # optical path over mu
    cdef double sign = -1.0 if upward else 1.0, fade, light, far
    cdef double* even_gain = work                     # (n, used): amplitude of the even modes -> radiance
    cdef double* odd_gain = even_gain + used * n
    cdef double* beam_gain = odd_gain + used * n      # (g_e -+ k g_f)/(1 + k mu) or /(k mu - 1)
    cdef double* fed = beam_gain + used * n           # coordinates c D(.) of all right-hand sides
    cdef double* first = fed + <size_t>n * n_rhs      # beam_gain c, beam_gain c D, g_f zeta
    cdef double* second = first + used * n_rhs
    cdef double* third = second + used * n_rhs
    cdef cplx* response = <cplx*>(third + used * n_rhs)
    cdef double* faded = <double*>(response + n)      # (n_mu,): e^(-left/mu)
    if n_mu == 0:
        return
    if left == 0.0:
        for r in range(n_rhs):
            memcpy(out + r * rows, entering + r * rows, sizeof(double) * used)
        return
    fading = fades(n, lam_re, lam_im, thickness)
    far = depth if upward else thickness - left        # by symmetry about the middle, down at depth is up at T - depth
    for mu in range(n_mu):
        faded[mu] = exp(-left / mu_out[mu])
    j = 0
    while j < n:
        if lam_im[j] == 0.0:
            real_gains(upward, fading, stokes, rows, n_mu, g_e + <size_t>j * rows, g_f + <size_t>j * rows, lam_re[j], thickness,
                       left, far, mu_out, faded, even_gain + j * used, odd_gain + j * used, beam_gain + j * used)
            j = j + 1
        else:
            pair_gains(upward, fading, stokes, rows, n_mu, g_e + <size_t>j * rows, g_f + <size_t>j * rows, make(lam_re[j], lam_im[j]),
                       thickness, left, far, mu_out, even_gain + j * used, odd_gain + j * used, beam_gain + j * used)
            j = j + 2
    for r in range(n_rhs):
        for mu in range(n_mu):
            for i in range(stokes):
                out[r * rows + stokes * mu + i] = faded[mu] * entering[r * rows + stokes * mu + i]
    product(b"N", b"N", <int>used, n_rhs, n, 1.0, even_gain, <int>used, even, n, 1.0, out, rows)
    product(b"N", b"N", <int>used, n_rhs, n, 1.0, odd_gain, <int>used, odd, n, 1.0, out, rows)
    product(b"N", b"N", <int>used, n_rhs, n, 0.5, beam_gain, <int>used, c, n, 0.0, first, <int>used)
    product(b"N", b"N", <int>used, n_rhs, n, 0.5 * sign, g_f, rows, zeta, n, 0.0, third, <int>used)
    feed(n, n_in, n_rhs, lam_re, lam_im, c, mu0, depth, response, fed)
    product(b"N", b"N", <int>used, n_rhs, n, 0.5, beam_gain, <int>used, fed, n, 0.0, second, <int>used)
    for r in range(n_rhs):
        beam = <int>r // per_beam
        fade = exp(-above / mu0[beam])
        for mu in range(n_mu):
            light = beam_up(mu_out[mu], mu0[beam], thickness, depth) if upward else beam_down(mu_out[mu], mu0[beam], depth)
            for i in range(stokes):
                column = r * used + stokes * mu + i
                out[r * rows + stokes * mu + i] += fade * (
                    light * (mu_out[mu] * first[column] + third[column]) + (second[column] if upward else -second[column]))
    if upward and thickness < 1e300:
        feed(n, n_in, n_rhs, lam_re, lam_im, c, mu0, thickness, response, fed)
        product(b"N", b"N", <int>used, n_rhs, n, 0.5, beam_gain, <int>used, fed, n, 0.0, second, <int>used)
        for r in range(n_rhs):
            for mu in range(n_mu):
                fade = exp(-above / mu0[<int>r // per_beam] - left / mu_out[mu])
                for i in range(stokes):
                    out[r * rows + stokes * mu + i] -= fade * second[r * used + stokes * mu + i]
    if not upward:
        resonances(n, stokes, rows, n_mu, n_in, n_rhs, g_e, g_f, lam_re, lam_im, c, mu0, mu_out, depth, above, out)


cdef void real_gains(bint upward, bint fading, int stokes, int rows, int n_mu, const double* g_e, const double* g_f, double lam,
                     double thickness, double left, double far, const double* mu_out, const double* faded, double* even_gain,
                     double* odd_gain, double* beam_gain) noexcept nogil:
    """Columns of the gains of `through_layer` for one real mode. left: the path; far: depth of its end below the face that
    e^(-k x) fades from; faded: e^(-left/mu). The integrals are those of `fading_integrals`, `hyperbolic_integrals`."""
    cdef double k = sqrt(lam), mode_faded = exp(-left * k), at_far = exp(-far * k), sign = -1.0 if upward else 1.0
    cdef double whole = 1.0 if fading else 1.0 + exp(-thickness * k), mu, gap, from_top, from_bottom, cosine, sine, bottom
    cdef double a, b
    cdef cplx c_cosine, c_sine
    cdef int i, m
    for m in range(n_mu):
        mu = mu_out[m]
        if left > 1e300:
            from_top, from_bottom = at_far / (1.0 + mu * k), 0.0
        else:
            gap = left * (k + 1.0 / mu)
            from_top = at_far * (1.0 - mode_faded * faded[m] if gap > 1.0 else -expm1(-gap)) / (1.0 + mu * k)
            gap = left / mu - left * k
            if fabs(gap) > 1.0:
                from_bottom = (left / mu) * ((mode_faded - faded[m]) / gap)
            elif gap == 0.0:
                from_bottom = (left / mu) * mode_faded
            else:
                from_bottom = (left / mu) * (max(mode_faded, faded[m]) * (-expm1(-fabs(gap)) / fabs(gap)))
        if fading and not upward and thickness > 1e300:
            from_top = 0.0
        if fading:      # y = e^(-k x), z = k y; y = e^(-k (thickness - x)), z = -k y; down, one is the other's image
            cosine, sine = (from_top, from_bottom) if upward else (from_bottom, from_top)
        elif k * thickness > 1.0:
            cosine, sine = (from_top + from_bottom) / whole, (from_bottom - from_top) / (k * whole)
        else:
            hyperbolic_integrals(make(k, 0.0), mu, thickness, far, &c_cosine, &c_sine)
            cosine, sine = c_cosine.real, c_sine.real
        bottom = 1.0 + mu * k if upward else mu * k - 1.0
        bottom = 0.0 if fabs(bottom) < 0.02 else 1.0 / bottom
        for i in range(stokes * m, stokes * (m + 1)):
            if fading:
                a, b = cosine * (g_e[i] + sign * k * g_f[i]), sine * (g_e[i] - sign * k * g_f[i])
            else:
                a, b = cosine * g_e[i] + lam * sine * g_f[i], sine * g_e[i] + cosine * g_f[i]
                if not upward:
                    b = -b
            even_gain[i], odd_gain[i], beam_gain[i] = 0.5 * a, 0.5 * b, bottom * (g_e[i] + sign * k * g_f[i])


cdef void pair_gains(bint upward, bint fading, int stokes, int rows, int n_mu, const double* g_e, const double* g_f, cplx lam,
                     double thickness, double left, double far, const double* mu_out, double* even_gain, double* odd_gain,
                     double* beam_gain) noexcept nogil:
    """As `real_gains`, the two columns of a complex pair as the real and imaginary parts of one."""
    cdef size_t used = <size_t>stokes * n_mu
    cdef double sign = -1.0 if upward else 1.0
    cdef cplx k = c_sqrt(lam), cosine, sine, bottom, ge, gf, a, b
    cdef int i, m
    for m in range(n_mu):
        if not fading:
            hyperbolic_integrals(k, mu_out[m], thickness, far, &cosine, &sine)
        elif upward:
            fading_integrals(k, mu_out[m], thickness, far, &cosine, &sine)
        else:
            sine = make(0.0, 0.0)
            if thickness < 1e300:
                sine = over(times(c_exp(-far * k), -c_expm1(-left * (k + 1.0 / mu_out[m]))), 1.0 + mu_out[m] * k)
            cosine = (left / mu_out[m]) * exp_difference(-left * k, make(-left / mu_out[m], 0.0))
        bottom = 1.0 + mu_out[m] * k if upward else mu_out[m] * k - 1.0
        bottom = make(0.0, 0.0) if size_of(bottom) < 0.02 else over(make(1.0, 0.0), bottom)
        for i in range(stokes * m, stokes * (m + 1)):
            ge, gf = make(g_e[i], g_e[i + rows]), make(g_f[i], g_f[i + rows])
            if fading:
                a = times(cosine, ge + sign * times(k, gf))
                b = times(sine, ge - sign * times(k, gf))
            else:
                a = times(cosine, ge) + times(times(lam, sine), gf)
                b = times(sine, ge) + times(cosine, gf)
                if not upward:
                    b = -b
            even_gain[i], even_gain[i + used] = 0.5 * a.real, 0.5 * a.imag
            odd_gain[i], odd_gain[i + used] = 0.5 * b.real, 0.5 * b.imag
            a = times(bottom, ge + sign * times(k, gf))
            beam_gain[i], beam_gain[i + used] = a.real, a.imag


cdef void feed(int n, int n_in, int n_rhs, const double* lam_re, const double* lam_im, const double* c, const double* mu0,
               double depth, cplx* response, double* fed) noexcept nogil:
    """fed = c D(depth), all right-hand sides."""
    cdef int r, j, per_beam = n_rhs // n_in
    for r in range(n_rhs):
        if r % per_beam == 0:
            for j in range(n):
                response[j] = beam_response(c_sqrt(make(lam_re[j], lam_im[j])), 1.0 / mu0[r // per_beam], depth)
        scale_coordinates(n, lam_im, response, c + <size_t>r * n, fed + <size_t>r * n)


cdef void resonances(int n, int stokes, int rows, int n_mu, int n_in, int n_rhs, const double* g_e, const double* g_f,
                     const double* lam_re, const double* lam_im, const double* c, const double* mu0, const double* mu_out,
                     double depth, double above, double* out) noexcept nogil:
    """Adds the beam's part of the modes with k mu close to 1, left out above: int D e^(-(depth - x)/mu) dx/mu is
    depth^2/mu exp[-depth/mu, -k depth, -depth/mu0]."""
    cdef int mu, j, width, r, i, per_beam = n_rhs // n_in
    cdef cplx k, value, gain
    cdef const double* y
    cdef size_t row
    j = 0
    while j < n:
        width = 1 if lam_im[j] == 0.0 else 2
        k = c_sqrt(make(lam_re[j], lam_im[j]))
        for mu in range(n_mu):
            if fabs(mu_out[mu] * k.real - 1.0) < 0.02 and size_of(mu_out[mu] * k - 1.0) < 0.02:
                for r in range(n_rhs):
                    if r % per_beam == 0:
                        value = (0.5 * depth * depth / mu_out[mu] * exp(-above / mu0[r // per_beam])) * exp_difference_2(
                            make(-depth / mu_out[mu], 0.0), -depth * k, make(-depth / mu0[r // per_beam], 0.0))
                    y = c + <size_t>r * n + j
                    for i in range(stokes):
                        row = <size_t>j * rows + stokes * mu + i
                        gain = times(value, make(g_e[row], g_e[row + rows] if width == 2 else 0.0)
                                     + times(k, make(g_f[row], g_f[row + rows] if width == 2 else 0.0)))
                        out[<size_t>r * rows + stokes * mu + i] += gain.real * y[0] + (gain.imag * y[1] if width == 2 else 0.0)
        j = j + width


def mode_coordinates(const double[::1] lam_re, const double[::1] lam_im, const double[:, ::1] even, const double[:, ::1] odd,
                     const double[:, ::1] c, const double[:, ::1] zeta, const double[::1] mu0, double thickness, double above,
                     double depth):
    """y and z of the modes of one order and layer (n,) at a depth below its top: (2, n_rhs, n); see `boundary`.

    even, odd, c, zeta (n_rhs, n); mu0 (n_in,); above: optical depth of the layer's top.
    """
    cdef int n = <int>lam_re.shape[0], n_rhs = <int>even.shape[0], per_beam = n_rhs // <int>mu0.shape[0], r, j, f
    cdef double[:, :, ::1] out = np.zeros((2, n_rhs, n))
    cdef double complex[:, ::1] profile = np.empty((6, n), complex)    # of even, odd, c: y and z
    cdef double[::1] part = np.empty(n)
    cdef double light, faded
    cdef cplx k, response
    profiles(n, &lam_re[0], &lam_im[0], thickness, depth, &profile[0, 0])
    for r in range(n_rhs):
        light = exp(-above / mu0[r // per_beam])
        faded = light * exp(-depth / mu0[r // per_beam])
        for j in range(n):
            k = c_sqrt(make(lam_re[j], lam_im[j]))
            response = light * beam_response(k, 1.0 / mu0[r // per_beam], depth) if depth > 0.0 else make(0.0, 0.0)
            profile[4, j], profile[5, j] = response, times(k, response)
            out[1, r, j] = faded * zeta[r, j]
        for f in range(6):
            scale_coordinates(n, &lam_im[0], &profile[f, 0], &even[r, 0] if f < 2 else &odd[r, 0] if f < 4 else &c[r, 0], &part[0])
            for j in range(n):
                out[f % 2, r, j] += part[j]
    return np.asarray(out)


# (1:24)-(1:25)
cdef void profiles(int n, const double* lam_re, const double* lam_im, double thickness, double depth, cplx* out) noexcept nogil:
    """The even and the odd mode's y and z at a depth, (n,) each: y_even, z_even, y_odd, z_odd; see `boundary`."""
    cdef int j
    cdef bint fading = fades(n, lam_re, lam_im, thickness)
    cdef cplx k, lam, from_top, from_bottom, whole, cosine, sine
    for j in range(n):
        lam = make(lam_re[j], lam_im[j])
        k = c_sqrt(lam)
        from_top = c_exp(-depth * k)
        from_bottom = make(0.0, 0.0) if thickness > 1e300 else c_exp((depth - thickness) * k)
        if fading:
            out[j], out[n + j] = from_top, times(k, from_top)
            out[2 * n + j], out[3 * n + j] = from_bottom, -times(k, from_bottom)
            continue
        whole = 1.0 + c_exp(-thickness * k)
        cosine = over(from_top + from_bottom, whole)
        # (e^(k t) - e^(-k t))/(2 k), t = depth - thickness/2, then over cosh(k h) = e^(k h) whole/2
        sine = (2.0 * depth - thickness) * over(exp_difference((depth - thickness) * k, -depth * k), whole)
        out[j], out[n + j] = cosine, -times(lam, sine)
        out[2 * n + j], out[3 * n + j] = sine, -cosine


# ---------------------------------------------------------------------------------------------------------
# The end of a solve, added straight into the result: sums over Fourier orders, and single scattering over all of
# them in closed form. `out` (n_level, n_in, n_mu, n_phi, 4, n_place) is never copied; the incident directions
# first .. last - 1 are done, so that a caller can go through a large table in pieces that stay in the cache.
# Columns (incident Stokes vectors) lie within (I, Q), kind 0, or within (U, V), kind 1; several may share a place.
# Azimuths beyond 180 degrees are the mirror images of others: Z(-phi) = D Z(phi) D, D = diag(1, 1, -1, -1), so `angle`
# (n_phi,) names the azimuth that was computed and `sign` (n_phi,) is -1 where it is to be mirrored.
# ---------------------------------------------------------------------------------------------------------

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


cdef extern from *:
    """
    #include <math.h>

    /* Azimuths are done VRTE_BLOCK at a time, in loops that a compiler turns into vectors of any width. With GNU C on
       x86-64 the same code is compiled a second time for AVX2 and FMA, and the processor says which one runs. */
    #if defined(__GNUC__)
    #define VRTE_INLINE static inline __attribute__((always_inline))
    #else
    #define VRTE_INLINE static __inline
    #endif
    enum { VRTE_BLOCK = 32, VRTE_SERIES = 13 };

    /* F11, F44, F12, F34, F22 + F33, F22 - F33 at the cosines x, one a row of f; terms is even. A row of the table: the
       factors of d^{l+1} = (a x -+ b) d^l - c d^{l-1} (a, c of d_00; a, c of d_02; a, b, c of d_2,+-2), then the
       coefficients. Two terms at a time: their functions stay in registers, and so do the sums. */
    VRTE_INLINE void vrte_series(int terms, const double* table, const double* x, double* f) {
        double p[VRTE_BLOCK], p_old[VRTE_BLOCK], q[VRTE_BLOCK], q_old[VRTE_BLOCK];
        double u[VRTE_BLOCK], u_old[VRTE_BLOCK], w[VRTE_BLOCK], w_old[VRTE_BLOCK];
        double *f11 = f, *f44 = f + VRTE_BLOCK, *f12 = f + 2 * VRTE_BLOCK, *f34 = f + 3 * VRTE_BLOCK;
        double *sum = f + 4 * VRTE_BLOCK, *difference = f + 5 * VRTE_BLOCK;
        const double *s = table, *t = table + VRTE_SERIES;
        for (int i = 0; i < VRTE_BLOCK; i++) {
            f11[i] = s[7] + t[7] * x[i];
            f44[i] = s[8] + t[8] * x[i];
            f12[i] = f34[i] = sum[i] = difference[i] = 0.0;
            p[i] = 1.5 * x[i] * x[i] - 0.5;
            p_old[i] = x[i];
            q[i] = -0.6123724356957945 * (1.0 - x[i]) * (1.0 + x[i]); /* sqrt(6)/4 */
            u[i] = 0.25 * (1.0 + x[i]) * (1.0 + x[i]);
            w[i] = 0.25 * (1.0 - x[i]) * (1.0 - x[i]);
            q_old[i] = u_old[i] = w_old[i] = 0.0;
        }
        for (int l = 2; l < terms; l += 2) {
            s = table + VRTE_SERIES * l;
            t = s + VRTE_SERIES;
            for (int i = 0; i < VRTE_BLOCK; i++) {
                double p_next = s[0] * x[i] * p[i] - s[1] * p_old[i], q_next = s[2] * x[i] * q[i] - s[3] * q_old[i];
                f11[i] += s[7] * p[i] + t[7] * p_next;
                f44[i] += s[8] * p[i] + t[8] * p_next;
                f12[i] += s[9] * q[i] + t[9] * q_next;
                f34[i] += s[10] * q[i] + t[10] * q_next;
                p[i] = t[0] * x[i] * p_next - t[1] * p[i];
                q[i] = t[2] * x[i] * q_next - t[3] * q[i];
                p_old[i] = p_next;
                q_old[i] = q_next;
            }
            for (int i = 0; i < VRTE_BLOCK; i++) {
                double u_next = (s[4] * x[i] - s[5]) * u[i] - s[6] * u_old[i];
                double w_next = (s[4] * x[i] + s[5]) * w[i] - s[6] * w_old[i];
                sum[i] += s[11] * u[i] + t[11] * u_next;
                difference[i] += s[12] * w[i] + t[12] * w_next;
                u[i] = (t[4] * x[i] - t[5]) * u_next - t[6] * u[i];
                w[i] = (t[4] * x[i] + t[5]) * w_next - t[6] * w[i];
                u_old[i] = u_next;
                w_old[i] = w_next;
            }
        }
    }

    /* cos and sin of twice the angles from the scattering plane to the meridian planes, outgoing then incident: 4 rows
       of turns. l is theta-hat, r = l x k; n, normal to the scattering plane, is k x k'; in a plane with r_s = n:
       cos(sigma) = n.r and sin(sigma) = -n.l. Straight on and straight back the meridian plane serves. */
    VRTE_INLINE void vrte_turns(double mu0, double mu, int count, const double* cos_phi, const double* sin_phi,
                                double* turns) {
        double sine0 = sqrt((1.0 - mu0) * (1.0 + mu0)), sine = sqrt((1.0 - mu) * (1.0 + mu));
        for (int i = 0; i < count; i++) {
            double kx = sine * cos_phi[i], ky = sine * sin_phi[i], kz = mu; /* outgoing; incident: (sine0, 0, -mu0) */
            double lx = mu * cos_phi[i], ly = mu * sin_phi[i], lz = -sine;
            double rx = ly * kz - lz * ky, ry = lz * kx - lx * kz; /* l x k is horizontal */
            double nx = -ky * mu0, ny = kz * sine0 + kx * mu0, nz = -ky * sine0;
            int none = nx * nx + ny * ny + nz * nz < 1e-18;
            nx = none ? rx : nx;
            ny = none ? ry : ny;
            nz = none ? 0.0 : nz;
            double c = nx * rx + ny * ry, s = -(nx * lx + ny * ly + nz * lz), length = c * c + s * s;
            turns[i] = (c * c - s * s) / length;
            turns[VRTE_BLOCK + i] = 2.0 * c * s / length;
            c = -ny; /* incident: l' = (-mu0, 0, -sine0), r' = l' x k' = (0, -1, 0) */
            s = nx * mu0 + nz * sine0;
            length = c * c + s * s;
            turns[2 * VRTE_BLOCK + i] = (c * c - s * s) / length;
            turns[3 * VRTE_BLOCK + i] = 2.0 * c * s / length;
        }
    }

    /* The phase matrix times one column (g, h) within (I, Q), kind 0, or (U, V), kind 1: 4 rows of z. */
    VRTE_INLINE void vrte_scattered(int kind, double g, double h, int count, const double* f, const double* turns,
                                    double* z, size_t stride) {
        for (int i = 0; i < count; i++) {
            double a1 = f[i], a4 = f[VRTE_BLOCK + i], b1 = f[2 * VRTE_BLOCK + i], b2 = f[3 * VRTE_BLOCK + i];
            double a2 = 0.5 * (f[4 * VRTE_BLOCK + i] + f[5 * VRTE_BLOCK + i]);
            double a3 = 0.5 * (f[4 * VRTE_BLOCK + i] - f[5 * VRTE_BLOCK + i]);
            double c = turns[i], s = turns[VRTE_BLOCK + i];
            double c_in = turns[2 * VRTE_BLOCK + i], s_in = turns[3 * VRTE_BLOCK + i];
            double i_s = kind ? b1 * s_in * g : a1 * g + b1 * c_in * h; /* I, Q, U, V in the scattering plane */
            double q_s = kind ? a2 * s_in * g : b1 * g + a2 * c_in * h;
            double u_s = kind ? a3 * c_in * g + b2 * h : -a3 * s_in * h;
            double v_s = kind ? a4 * h - b2 * c_in * g : b2 * s_in * h;
            z[i] = i_s;
            z[stride + i] = c * q_s - s * u_s;
            z[2 * stride + i] = s * q_s + c * u_s;
            z[3 * stride + i] = v_s;
        }
    }

    VRTE_INLINE void vrte_scatter(int terms, const double* table, double mu0, double mu, int count, const double* cos_phi,
                                  const double* sin_phi, int n_col, const int* kind, const double* columns, double* z,
                                  size_t stride) {
        double x[VRTE_BLOCK] = {0.0}, f[6 * VRTE_BLOCK], turns[4 * VRTE_BLOCK];
        double sines = sqrt((1.0 - mu) * (1.0 + mu)) * sqrt((1.0 - mu0) * (1.0 + mu0));
        for (int i = 0; i < count; i++) {
            double cosine = sines * cos_phi[i] - mu * mu0;
            x[i] = cosine > 1.0 ? 1.0 : cosine < -1.0 ? -1.0 : cosine;
        }
        vrte_series(terms, table, x, f);
        vrte_turns(mu0, mu, count, cos_phi, sin_phi, turns);
        for (int c = 0; c < n_col; c++) {
            const double* pair = columns + 4 * c + 2 * kind[c];
            if (kind[c])
                vrte_scattered(1, pair[0], pair[1], count, f, turns, z + 4 * c * stride, stride);
            else
                vrte_scattered(0, pair[0], pair[1], count, f, turns, z + 4 * c * stride, stride);
        }
    }

    typedef void vrte_scatterer(int, const double*, double, double, int, const double*, const double*, int, const int*,
                                const double*, double*, size_t);

    static void vrte_scatter_plain(int terms, const double* table, double mu0, double mu, int count, const double* cos_phi,
                                   const double* sin_phi, int n_col, const int* kind, const double* columns, double* z,
                                   size_t stride) {
        vrte_scatter(terms, table, mu0, mu, count, cos_phi, sin_phi, n_col, kind, columns, z, stride);
    }

    #if defined(__GNUC__) && defined(__x86_64__)
    __attribute__((target("avx2,fma")))
    static void vrte_scatter_wide(int terms, const double* table, double mu0, double mu, int count, const double* cos_phi,
                                  const double* sin_phi, int n_col, const int* kind, const double* columns, double* z,
                                  size_t stride) {
        vrte_scatter(terms, table, mu0, mu, count, cos_phi, sin_phi, n_col, kind, columns, z, stride);
    }

    static vrte_scatterer* vrte_best_scatterer(int wide) {
        __builtin_cpu_init();
        wide = wide && __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
        return wide ? vrte_scatter_wide : vrte_scatter_plain;
    }
    #else
    static vrte_scatterer* vrte_best_scatterer(int wide) { return vrte_scatter_plain; }
    #endif
    """
    const int VRTE_BLOCK, VRTE_SERIES
    ctypedef void vrte_scatterer(int, const double*, double, double, int, const double*, const double*, int, const int*,
                                 const double*, double*, size_t) noexcept nogil
    vrte_scatterer* vrte_best_scatterer(bint wide) noexcept nogil


def series_table(const double[:, :] coefficients):
    """The phase matrix with coefficients (terms, 6) as `add_single_scattering` takes it, (terms, 13), terms made even: the
    factors of the recurrences, then the coefficients."""
    cdef int terms = <int>coefficients.shape[0], l
    cdef double[:, ::1] table = np.zeros((terms + terms % 2, VRTE_SERIES))
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
        table[l, 7], table[l, 8] = coefficients[l, 0], coefficients[l, 3]
        table[l, 9], table[l, 10] = coefficients[l, 4], coefficients[l, 5]
        table[l, 11], table[l, 12] = coefficients[l, 1] + coefficients[l, 2], coefficients[l, 1] - coefficients[l, 2]
    return np.asarray(table)


def path_integrals(const double[::1] above, const double[::1] thickness, const double[::1] level,
                   const int[::1] level_layer, const int[::1] chosen, const double[::1] mu0, const double[::1] mu):
    """Optical path integrals of one scattering in each layer, (layer, chosen, n_in, n_mu); mu signed, > 0 up.

    The integral of e^(-t/mu0) e^(-|t - tau|/|mu|) dt/|mu| over the part of the layer that light at tau comes from.
    above, thickness (layer,); level, level_layer (n_tau,): depths below the top of a layer; chosen: which of them.
    """
    cdef int n_layer = <int>above.shape[0], n_in = <int>mu0.shape[0], n_mu = <int>mu.shape[0], layer, place, i, j, at
    cdef double[:, :, :, ::1] out = np.zeros((n_layer, chosen.shape[0], n_in, n_mu))
    cdef double depth, length, start, way, rate, rate_in
    with nogil:
        for place in range(<int>chosen.shape[0]):
            at = level_layer[chosen[place]]
            depth = level[chosen[place]]
            for layer in range(n_layer):
                way = path_between(layer, at, depth, &thickness[0])
                for i in range(n_in):
                    rate_in = 1.0 / mu0[i]
                    for j in range(n_mu):
                        if mu[j] > 0.0 and layer >= at:        # light going up comes from below tau
                            rate = 1.0 / mu[j]
                            start = above[layer] + depth if layer == at else above[layer]
                            length = thickness[layer] - depth if layer == at else thickness[layer]
                            out[layer, place, i, j] = (exp(-start * rate_in - way * rate) * -expm1(-length * (rate_in + rate))
                                                       * rate / (rate_in + rate))
                        elif mu[j] < 0.0 and layer <= at:
                            rate = -1.0 / mu[j]
                            length = depth if layer == at else thickness[layer]
                            if length > 0.0:
                                out[layer, place, i, j] = (length * rate * exp(-above[layer] * rate_in - way * rate)
                                                           * exp_difference(make(-length * rate_in, 0.0), make(-length * rate, 0.0)).real)
    return np.asarray(out)


cdef double path_between(int layer, int at, double depth, const double* thickness) noexcept nogil:
    """Optical depth between a level and the nearer face of a layer, 0 inside it: a sum of thicknesses, never a difference
    of depths, whose last place would be seen along a cosine of 1e-8."""
    cdef int i
    cdef double way
    if layer == at:
        return 0.0
    way = thickness[at] - depth if layer > at else depth
    for i in range(min(layer, at) + 1, max(layer, at)):
        way += thickness[i]
    return way


def scattering_work(n_col, n_angle):
    """Doubles of `work` that one thread of `add_single_scattering` needs."""
    return 4 * n_col * n_angle


# (1:5)
def add_single_scattering(const double[:, ::1] table, const double[:, :, ::1] path, const double[::1] mu0,
                          const double[::1] mu, const double[::1] cos_phi, const double[::1] sin_phi, const int[::1] angle,
                          const double[::1] sign, const double[:, ::1] columns, const int[::1] kind,
                          const int[::1] place, int first, int last, double[:, :, :, :, :, ::1] out, int threads,
                          double[:, ::1] work, double[::1] seconds, const int[::1] stop, bint wide=True):
    """Adds path Z(mu, -mu0, phi) columns, Z the phase matrix of all terms between meridian planes.

    table: of `series_table`; path (n_level, n_in, n_mu): whatever multiplies Z, nothing is done where it is zero; mu0
    (n_in,) > 0: light going down; mu (n_mu,): signed public cosines; cos_phi, sin_phi (n_angle,); columns (n_col, 4).
    `wide=False` leaves AVX2 unused.
    """
    cdef int n_mu = <int>mu.shape[0], n_level = <int>path.shape[0], n_col = <int>columns.shape[0], item, thread
    cdef vrte_scatterer* scatter = vrte_best_scatterer(wide)
    cdef double start
    if 4 * n_col > MOST_ENTRIES:
        raise ValueError(f"at most {MOST_ENTRIES // 4} columns")
    if table.shape[0] % 2 or table.shape[1] != VRTE_SERIES:
        raise ValueError("the table must be one of series_table")
    if out.size == 0:
        return
    for item in prange((last - first) * n_mu, nogil=True, schedule="dynamic", num_threads=threads):
        thread = threadid()
        if not stop[0]:
            start = vrte_seconds()
            scatter_pair(scatter, <int>table.shape[0], &table[0, 0], path, mu0[first + item // n_mu], mu[item % n_mu], first + item // n_mu,
                         item % n_mu, cos_phi, sin_phi, angle, sign, columns, kind, place, out, &work[thread, 0])
            seconds[thread] += vrte_seconds() - start


cdef void scatter_pair(vrte_scatterer* scatter, int terms, const double* table, const double[:, :, ::1] path, double mu0,
                       double mu, int i, int j, const double[::1] cos_phi, const double[::1] sin_phi, const int[::1] angle,
                       const double[::1] sign, const double[:, ::1] columns, const int[::1] kind, const int[::1] place,
                       double[:, :, :, :, :, ::1] out, double* z) noexcept nogil:
    """All azimuths and depths of one pair of directions; z (column, Stokes, angle)."""
    cdef int n_angle = <int>cos_phi.shape[0], n_col = <int>columns.shape[0], n_place = <int>out.shape[5]
    cdef int n_level = <int>path.shape[0], n_phi = <int>angle.shape[0], first = 0, t, f, k
    cdef int target[MOST_ENTRIES]
    cdef double factor[2][MOST_ENTRIES]     # as computed, and mirrored
    cdef double* to
    cdef const double* now
    cdef bint lit = False
    for t in range(n_level):
        lit = lit or path[t, i, j] != 0.0
    if not lit:
        return
    while first < n_angle:
        scatter(terms, table, mu0, mu, min(<int>VRTE_BLOCK, n_angle - first), &cos_phi[first], &sin_phi[first], n_col,
                &kind[0], &columns[0, 0], z + first, n_angle)
        first += VRTE_BLOCK
    for t in range(n_level):
        if path[t, i, j] == 0.0:
            continue
        for k in range(4 * n_col):
            target[k] = k % 4 * n_place + place[k // 4]
            factor[0][k] = path[t, i, j]
            factor[1][k] = path[t, i, j] if (k % 4 >= 2) == (kind[k // 4] == 1) else -path[t, i, j]
        to = &out[t, i, j, 0, 0, 0]
        for f in range(n_phi):
            now = &factor[sign[f] < 0.0][0]
            for k in range(4 * n_col):
                to[target[k]] += now[k] * z[<size_t>k * n_angle + angle[f]]
            to += 4 * n_place
