# Section 3.A, first step: E and F of (1:41), the rows that lead out of the nodes and the beam's sources.

# (1:4), (1:14), the beam's direction of travel; (1:13), (1:16)-(1:23)
cdef int assemble_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    cdef int m = t.orders[0], terms = t.terms[0], n_node = t.n_node, n_out = t.n_out, n_in = t.n_in, n_all = t.n_all
    cdef int n = t.n, into = t.n_in_rows, out = t.n_out_rows, i, j, kind, inner
    cdef Expansion x = Expansion(parity_of(m, t.stokes, t.members), m, terms, t.albedo[0], t.coefficients)
    if terms <= m or x.albedo == 0.0:
        set_zero(<size_t>n * n, t.E)
        set_zero(<size_t>n * n, t.F)
        set_zero(<size_t>out * n, t.G_E)
        set_zero(<size_t>out * n, t.G_F)
        set_zero(<size_t>into * n, t.source_s)
        set_zero(<size_t>into * n, t.source_d)
    else:
        spherical(m, terms, is_polar(x.p), t.directions, n_all, t.prt)
        scale_nodes(t, t.scale)
        for kind in range(2):       # 0: E, 1: F
            inner = columns_of(&x, kind)
            parity_columns(&x, kind, t.prt, n_all, 0, n_node, t.scale, t.phi)
            times_coefficients(&x, kind, 1.0, n, t.phi, t.psi)
            product(b"N", b"T", n, n, inner, -1.0, t.phi, n, t.psi, n, 0.0, t.F if kind else t.E, n)
            # the beam: column mu0 of the same product; rows: phi, the nodes
            parity_columns(&x, kind, t.prt, n_all, n_node + n_out, n_in, NULL, t.phi_in)
            times_coefficients(&x, kind, 1.0, into, t.phi_in, t.psi_in)
            product(b"N", b"T", n, into, inner, 1.0, t.phi, n, t.psi_in, into, 0.0,
                    t.source_s if kind else t.source_d, n)
            parity_columns(&x, kind, t.prt, n_all, n_node, n_out, NULL, t.phi)
            product(b"N", b"T", out, n, inner, 1.0, t.phi, out, t.psi, n, 0.0, t.G_F if kind else t.G_E, out)
    for i in range(n):
        j = i * n + i
        t.E[j] += 1.0 / t.directions[i // t.stokes]
        t.F[j] += 1.0 / t.directions[i // t.stokes]
    return 0


cdef inline void scale_nodes(const Arrays* t, doubles scale) noexcept nogil:
    """sqrt(weight/mu), (N,)."""
    cdef int i
    for i in range(t.n_node):
        scale[i] = sqrt(t.weights[i] / t.directions[i])


cdef int balance_flux_one(Arrays* a, int item, Workspace desk) noexcept nogil:
    """On nodes that are not Gauss's, order 0 as if Legendre functions of even degree were what these integrate exactly
    (`find_even_shifts` of orders/phase_assembly.py): the rows and columns of I lose what the nodes get wrong of the
    flux of light scattered once."""
    cdef int n = a.n_node * a.stokes, out = a.stokes * a.n_out, into = a.stokes * a.n_in, s = a.stokes, i, j
    cdef doubles E = a.E, G = a.G_E, source = a.source_d, null = a.null, unit = a.unit, wrong = a.wrong_of_E
    cdef double total = 0.0, largest = 0.0, lost, each
    cdef double albedo = a.albedo[0] * a.coefficients[0]      # a1[0]: 1 but of changes
    for i in range(a.n_node):
        total += a.weights[i]
    each = 1.0 / total
    set_zero(n, null)
    set_zero(n, unit)
    for i in range(a.n_node):
        null[i * s], unit[i * s] = sqrt(a.weights[i] * a.directions[i]), sqrt(a.weights[i] / a.directions[i]) / total
    for j in range(n):
        wrong[j] = null[j] / a.directions[j // s] - albedo * total * unit[j]
        for i in range(a.n_node):
            wrong[j] -= E[<size_t>j * n + i * s] * null[i * s]
        largest += wrong[j] * null[j]
    for j in range(n):
        for i in range(n):
            E[<size_t>j * n + i] += wrong[j] * unit[i] + unit[j] * (wrong[i] - largest * unit[i])
    for j in range(out):
        lost = -albedo if j % s == 0 else 0.0
        for i in range(a.n_node):
            lost += null[i * s] * G[<size_t>i * s * out + j]
        for i in range(n):
            G[<size_t>i * out + j] -= unit[i] * lost
            if j % s == 0:
                G[<size_t>i * out + j] -= each * (wrong[i] - largest * unit[i])
    for j in range(into):
        lost = -albedo if j % s == 0 else 0.0
        for i in range(a.n_node):
            lost += null[i * s] * source[<size_t>j * n + i * s]
        for i in range(n):
            source[<size_t>j * n + i] -= lost * unit[i]
            if j % s == 0:
                source[<size_t>j * n + i] -= each * (wrong[i] - largest * unit[i])
    return 0
