# Particular solution, (1:28)-(1:34), without its resonance. With D(tau) = (e^(-tau/mu0) - e^(-k tau))/(k - 1/mu0),
# y = c D and z = zeta e^(-tau/mu0) + c k D, where c = (q + p/mu0)/(k + 1/mu0), zeta = (p k - q)/(k + 1/mu0).

# (1:28)-(1:34), (1:46)-(1:48)
cdef int particular_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    cdef int n = t.n, stokes = t.stokes, n_in = t.n_in, n_col = t.n_col, j, a, col
    cdef given slant = slants(t.slant_in, 0, n_in, t.mu0)
    cdef bint paired = t.X_pivots[0] < 0        # X^-1 = Y^T, Y^-1 = X^T
    cdef doubles ps = t.ps, fd = t.fd, p = t.c, q = t.zeta
    cdef doubles out_c
    cdef doubles out_z
    cdef double p1, p2, q1, q2, rate
    cdef cplx k, below, pc, qc, value
    if paired:
        product(b"T", b"N", n, stokes * n_in, n, 1.0, t.Y, n, t.source_s, n, 0.0, ps, n)
        product(b"T", b"N", n, stokes * n_in, n, 1.0, t.X, n, t.source_d, n, 0.0, fd, n)
    else:
        copy(<size_t>n * stokes * n_in, t.source_s, ps)
        product(b"N", b"N", n, stokes * n_in, n, 1.0, t.F, n, t.source_d, n, 0.0, fd, n)
    for a in range(n_in):                     # the right-hand sides' Stokes columns
        multiply(n, n_col, stokes, 1.0, ps + <size_t>stokes * a * n, t.columns, 0.0, p + <size_t>a * n_col * n)
        multiply(n, n_col, stokes, 1.0, fd + <size_t>stokes * a * n, t.columns, 0.0, q + <size_t>a * n_col * n)
    if not paired:
        solve(n, n_in * n_col, t.X_lu, t.X_pivots, p, n)
        solve(n, n_in * n_col, t.X_lu, t.X_pivots, q, n)
    for a in range(n_in):
        rate = 1.0 / slant[a]
        for col in range(n_col):
            out_c = p + <size_t>(a * n_col + col) * n
            out_z = q + <size_t>(a * n_col + col) * n
            j = 0
            while j < n:
                k = c_sqrt(make(t.lam_re[j], t.lam_im[j]))
                below = k + rate
                if t.lam_im[j] == 0.0:
                    pc, qc = make(out_c[j], 0.0), make(out_z[j], 0.0)
                else:
                    pc, qc = make(out_c[j], -out_c[j + 1]), make(out_z[j], -out_z[j + 1])
                value = over(qc + rate * pc, below)
                qc = over(times(pc, k) - qc, below)
                out_c[j], out_z[j] = value.real, qc.real
                if t.lam_im[j] == 0.0:
                    j = j + 1
                else:
                    out_c[j + 1], out_z[j + 1] = -value.imag, -qc.imag
                    j = j + 2
    return 0
