# Spherical functions and the phase matrices A^m, (1:9).

cdef extern from "core/kernels/in_c.h":
    double vrte_start_factor(int m) noexcept nogil
    double vrte_polar_factor(int m) noexcept nogil
    double vrte_wigner_start(int m, double mu, double factor) noexcept nogil
    void vrte_polar_start(int m, double mu, double factor, double* plus, double* minus) noexcept nogil
    double vrte_wigner_lower(int m, int k, double l) noexcept nogil
    double vrte_wigner_upper(int m, int k, double l) noexcept nogil
    double vrte_wigner_next(int m, int k, int l, double mu, double lower, double upper, double now,
                            double before) noexcept nogil


cdef void wigner_step(int m, int k, int l, given mu, int n_mu, given before, given now,
                      doubles after) noexcept nogil:
    """d^{l+1}_{m,k} from d^l and, above the first l, d^{l-1}; (n_mu,) each."""
    cdef double lower = vrte_wigner_lower(m, k, l), upper = vrte_wigner_upper(m, k, l)
    cdef int i
    if l == 0:
        copy(n_mu, mu, after)
        return
    for i in range(n_mu):
        after[i] = vrte_wigner_next(m, k, l, mu[i], lower, upper, now[i], before[i] if lower != 0.0 else 0.0)


cdef void spherical(int m, int terms, bint polar, given mu, int n_mu, doubles out) noexcept nogil:
    """out (l, 3, mu) = p, r, t of the handbook for l = m .. terms - 1; r and t only if `polar`."""
    cdef int i, l, first = max(m, 2)
    cdef size_t row = 3 * n_mu
    cdef doubles now
    cdef double plus, minus, factor = vrte_start_factor(m)
    if terms <= m:
        return
    for i in range(n_mu):
        out[row * m + i] = vrte_wigner_start(m, mu[i], factor)
    for l in range(m, terms - 1):
        now = out + row * l
        wigner_step(m, 0, l, mu, n_mu, now - row, now, now + row)
    if not polar:
        return
    for l in range(m, min(first, terms)):
        set_zero(2 * n_mu, out + row * l + n_mu)
    factor, now = vrte_polar_factor(m), out + row * first + n_mu
    for i in range(n_mu if first < terms else 0):
        vrte_polar_start(m, mu[i], factor, now + i, now + n_mu + i)
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
    """The elements of the associated Legendre matrices P_l^m, from Wigner's d by upward recurrence in l.

    P_l^m is [[p, 0, 0, 0], [0, r, -t, 0], [0, -t, r, 0], [0, 0, 0, p]].

    Parameters
    ----------
    m : int
        Fourier order, >= 0.
    terms : int
        Number of degrees, l = 0 .. terms - 1.
    mu : array_like (n_mu,)
        Cosines in [-1, 1].

    Returns
    -------
    ndarray (terms, n_mu, 3)
        p = d^l_{m,0}, r = (d^l_{m,2} + d^l_{m,-2})/2 and t = (d^l_{m,2} - d^l_{m,-2})/2; zero for l < m.

    Raises
    ------
    ValueError
        For a negative order, no terms or a cosine outside [-1, 1].

    References
    ----------
    (1:9)-(1:10).

    Examples
    --------
    >>> from vrte import _core
    >>> _core.generalized_spherical_functions(0, 3, [0.5])[:, 0, 0]  # Legendre polynomials
    array([ 1.   ,  0.5  , -0.125])
    """
    cosines = np.ascontiguousarray(np.atleast_1d(mu), dtype=float)
    if m < 0 or terms < 1:
        raise ValueError(f"need an order m >= 0 and at least one term, not m = {m} and {terms} terms")
    if cosines.shape[0] and not np.all(np.abs(cosines) <= 1.0):
        raise ValueError("cosines must lie in [-1, 1]")
    return np.ascontiguousarray(spherical_functions(m, cosines, terms).transpose(0, 2, 1))


cdef int spherical_functions_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    spherical(t.order, t.n_term, True, t.mu, t.n_mu, t.functions)
    return 0


def phase_matrices(int m, coefficients, mu, mu_from):
    """Fourier orders of the phase matrix, A^m(mu, mu_from) = sum_l P_l^m(mu) B_l P_l^m(mu_from).

    Parameters
    ----------
    m : int
        Fourier order, >= 0.
    coefficients : array_like (terms, 6)
        Columns a1, a2, a3, a4, b1, b2, as `vrte.PhaseMatrix` has them.
    mu : array_like (n,)
        Cosines of the directions of scattered light, positive downward: for public cosines pass -mu.
    mu_from : array_like (k,)
        Those of the light that is scattered, in the same way.

    Returns
    -------
    ndarray (n, k, 4, 4)
        A^m, in the meridian planes.

    Raises
    ------
    ValueError
        For wrong shapes or cosines.

    References
    ----------
    (1:9).

    Examples
    --------
    >>> from vrte import _core
    >>> _core.phase_matrices(0, [[1.0, 0, 0, 0, 0, 0]], [0.3], [-0.7])[0, 0, 0, 0].item()  # isotropic
    1.0
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
