# Particular solution, (1:28)-(1:34), without its resonance. With D(tau) = (e^(-tau/mu0) - e^(-k tau))/(k - 1/mu0),
# y = c D and z = zeta e^(-tau/mu0) + c k D, where c = (q + p/mu0)/(k + 1/mu0), zeta = (p k - q)/(k + 1/mu0).

cdef struct Particular:
    int n, stokes, n_in, n_col
    given F, source_s, source_d, mu0, columns, lam_re, lam_im, X, Y, X_lu
    given_ints X_pivots
    doubles c, zeta


def particular(crew, *, const double[:, :, :, ::1] F, const double[:, :, :, ::1] source_s,
               const double[:, :, :, ::1] source_d, const double[::1] mu0, const double[:, ::1] columns,
               const double[:, :, ::1] lam_re, const double[:, :, ::1] lam_im, const double[:, :, :, ::1] X,
               const double[:, :, :, ::1] Y, const double[:, :, :, ::1] X_lu, const int[:, :, ::1] X_pivots,
               double[:, :, :, ::1] c, double[:, :, :, ::1] zeta):
    """The beam's solution in the coordinates of the modes.

    source_s, source_d (order, layer, S n_in, n) as `assemble` leaves them; mu0 (n_in,); columns (n_col, S): the
    incident Stokes vectors. c, zeta (order, layer, n_in n_col, n).
    """
    cdef int n = <int>F.shape[3], stokes = <int>columns.shape[1], n_in = <int>mu0.shape[0]
    cdef Particular task = Particular(
        n, stokes, n_in, <int>columns.shape[0], &F[0, 0, 0, 0], &source_s[0, 0, 0, 0], &source_d[0, 0, 0, 0], &mu0[0],
        &columns[0, 0], &lam_re[0, 0, 0], &lam_im[0, 0, 0], &X[0, 0, 0, 0], &Y[0, 0, 0, 0], &X_lu[0, 0, 0, 0],
        &X_pivots[0, 0, 0], &c[0, 0, 0, 0], &zeta[0, 0, 0, 0])
    run_items(crew, particular_one, &task, <int>(F.shape[0] * F.shape[1]), 2 * n * stokes * n_in + 4 * n, 0, NULL)


# (1:28)-(1:34), (1:46)-(1:48)
cdef int particular_one(const void* task, int item, Workspace desk) noexcept nogil:
    cdef const Particular* t = <const Particular*>task
    cdef int n = t.n, stokes = t.stokes, n_in = t.n_in, n_col = t.n_col
    cdef size_t at = <size_t>item * n, nn = at * n, per_beam = at * stokes * n_in, wanted = at * n_in * n_col
    cdef given F = t.F + nn, X = t.X + nn, Y = t.Y + nn, X_lu = t.X_lu + nn, columns = t.columns
    cdef given source_s = t.source_s + per_beam, source_d = t.source_d + per_beam
    cdef given lam_re = t.lam_re + at, lam_im = t.lam_im + at
    cdef given_ints X_pivots = t.X_pivots + at
    cdef int j, a, col
    cdef bint paired = X_pivots[0] < 0        # X^-1 = Y^T, Y^-1 = X^T
    cdef doubles ps = desk.work
    cdef doubles fd = ps + <size_t>n * stokes * n_in      # F source_d: Y^-1 = X^-1 F
    cdef doubles p = t.c + wanted
    cdef doubles q = t.zeta + wanted
    cdef doubles out_c
    cdef doubles out_z
    cdef double p1, p2, q1, q2, rate
    cdef cplx k, below, pc, qc, value
    if paired:
        product(b"T", b"N", n, stokes * n_in, n, 1.0, Y, n, source_s, n, 0.0, ps, n)
        product(b"T", b"N", n, stokes * n_in, n, 1.0, X, n, source_d, n, 0.0, fd, n)
    else:
        copy(<size_t>n * stokes * n_in, source_s, ps)
        product(b"N", b"N", n, stokes * n_in, n, 1.0, F, n, source_d, n, 0.0, fd, n)
    for a in range(n_in):                     # the right-hand sides' Stokes columns
        multiply(n, n_col, stokes, 1.0, ps + <size_t>stokes * a * n, columns, 0.0, p + <size_t>a * n_col * n)
        multiply(n, n_col, stokes, 1.0, fd + <size_t>stokes * a * n, columns, 0.0, q + <size_t>a * n_col * n)
    if not paired:
        solve(n, n_in * n_col, X_lu, X_pivots, p, n)
        solve(n, n_in * n_col, X_lu, X_pivots, q, n)
    for a in range(n_in):
        rate = 1.0 / t.mu0[a]
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
    return 0
