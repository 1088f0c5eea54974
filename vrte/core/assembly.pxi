# Section 3.A, first step: E and F of (1:41), the rows that lead out of the nodes and the beam's sources.

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
