# Section 3.A, first step: E and F of (1:41), the rows that lead out of the nodes and the beam's sources.

# (1:4), (1:14), the beam's direction of travel
cdef Job assemble_job(Arrays* t) noexcept nogil:
    return Job(<size_t>t.n_order * t.n_layer, (3 + 8 * t.stokes) * <size_t>t.n_all * t.n_term + t.n_all, 0)


# (1:13), (1:16)-(1:23)
cdef int assemble_one(const void* task, int item, Workspace desk) noexcept nogil:
    cdef const Arrays* a = <const Arrays*>task
    cdef int m = a.orders[item // a.n_layer], layer = layer_of(a.slab_stack, a.n_layer, item), terms = a.terms[layer]
    cdef int n_node = a.n_node, n_out = a.n_out, n_in = a.n_in, n_all = n_node + n_out + n_in, stokes = a.stokes
    cdef int n = stokes * n_node, into = stokes * n_in, out = stokes * n_out
    cdef size_t at = item, room = <size_t>(2 * stokes * n_all) * a.n_term
    cdef Expansion x = Expansion(parity_of(m, stokes, a.members), m, terms, a.albedo[layer],
                                 a.coefficients + <size_t>6 * layer * a.n_term)
    cdef given directions = a.directions
    cdef doubles E = a.E + at * n * n, F = a.F + at * n * n, G_E = a.G_E + at * n * out, G_F = a.G_F + at * n * out
    cdef doubles source_s = a.source_s + at * into * n, source_d = a.source_d + at * into * n
    cdef doubles prt = desk.work, phi = prt + <size_t>3 * n_all * a.n_term, psi = phi + room, phi_in = psi + room
    cdef doubles psi_in = phi_in + room, scale = psi_in + room
    cdef int i, j, kind, inner
    cdef doubles matrix
    if terms <= m or x.albedo == 0.0:
        set_zero(<size_t>n * n, E)
        set_zero(<size_t>n * n, F)
        set_zero(<size_t>out * n, G_E)
        set_zero(<size_t>out * n, G_F)
        set_zero(<size_t>into * n, source_s)
        set_zero(<size_t>into * n, source_d)
    else:
        spherical(m, terms, is_polar(x.p), directions, n_all, prt)
        for i in range(n_node):
            scale[i] = sqrt(a.weights[i] / directions[i])
        for kind in range(2):       # 0: E, 1: F
            matrix = F if kind else E
            inner = columns_of(&x, kind)
            parity_columns(&x, kind, prt, n_all, 0, n_node, scale, phi)
            times_coefficients(&x, kind, 1.0, n, phi, psi)
            product(b"N", b"T", n, n, inner, -1.0, phi, n, psi, n, 0.0, matrix, n)
            # the beam: column mu0 of the same product; rows: phi, the nodes
            parity_columns(&x, kind, prt, n_all, n_node + n_out, n_in, NULL, phi_in)
            times_coefficients(&x, kind, 1.0, into, phi_in, psi_in)
            product(b"N", b"T", n, into, inner, 1.0, phi, n, psi_in, into, 0.0, source_s if kind else source_d, n)
            parity_columns(&x, kind, prt, n_all, n_node, n_out, NULL, phi)
            product(b"N", b"T", out, n, inner, 1.0, phi, out, psi, n, 0.0, G_F if kind else G_E, out)
    for i in range(n):
        j = i * n + i
        E[j] += 1.0 / directions[i // stokes]
        F[j] += 1.0 / directions[i // stokes]
    return 0


cdef Job balance_flux_job(Arrays* t) noexcept nogil:
    return Job(t.n_layer, 3 * <size_t>t.n, 0)


cdef int balance_flux_one(const void* task, int item, Workspace desk) noexcept nogil:
    balance_one(<const Arrays*>task, item, item, desk.work)
    return 0


cdef void balance_one(const Arrays* a, int item, int layer, doubles work) noexcept nogil:
    """On nodes that are not Gauss's, order 0 as if Legendre functions of even degree were what these integrate exactly
    (`find_even_shifts` of orders/phase_assembly.py): the rows and columns of I lose what the nodes get wrong of the
    flux of light scattered once."""
    cdef int n = a.n_node * a.stokes, out = a.stokes * a.n_out, into = a.stokes * a.n_in, s = a.stokes, i, j
    cdef doubles E = a.E + <size_t>item * n * n, G = a.G_E + <size_t>item * n * out
    cdef doubles source = a.source_d + <size_t>item * into * n
    # the flux, what even light sends out, what E gets wrong
    cdef doubles null = work, unit = null + n, wrong = unit + n
    cdef double total = 0.0, largest = 0.0, lost, each
    cdef double albedo = a.albedo[layer] * a.coefficients[<size_t>6 * a.n_term * layer]      # a1[0]: 1 but of changes
    for i in range(a.n_node):
        total += a.weights[i]
    each = 1.0 / total
    set_zero(2 * n, null)                                                       # and unit
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
