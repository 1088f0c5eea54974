# Particular solution, (1:28)-(1:34), without its resonance. With D(tau) = (e^(-tau/mu0) - e^(-k tau))/(k - 1/mu0),
# y = c D and z = zeta e^(-tau/mu0) + c k D, where c = (q + p/mu0)/(k + 1/mu0), zeta = (p k - q)/(k + 1/mu0).

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
