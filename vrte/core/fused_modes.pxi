# All of section 2.C for one Fourier order after another, each from its matrices to its light in the memory of one
# thread: where orders are small, what stands between five stages takes longer than the stages.

cdef Job fused_modes_job(Arrays* t) noexcept nogil:
    """An order's matrices, modes and amplitudes, then the scratch memory of any stage."""
    cdef size_t n = t.n, L = t.n_layer, r = t.n_rhs, most = max(3 * n, assemble_job(t).doubles)
    most = max(most, max(homogeneous_job(t).doubles, particular_job(t).doubles))
    most = max(most, max(boundary_job(t).doubles, reconstruct_job(t).doubles))
    most = max(most, nodal_fluxes_job(t).doubles)
    return Job(t.n_order, L * n * (5 * n + 2 * t.n_out_rows + 2 * t.n_in_rows + 2 + 4 * r) + r * n + most,
               (L + 6) * n + 8 + (2 * L + 1) * n + L)


cdef int fused_modes_one(const void* task, int item, Workspace desk) noexcept nogil:
    """One order; its matrices lie in the desk's memory, before the scratch memory of the stages."""
    cdef const Arrays* t = <const Arrays*>task
    cdef Arrays p = t[0]
    cdef int n = t.n, n_layer = t.n_layer, layer, stage, o, s
    cdef bint lit = t.n_sent == 0       # whether layers meet the beams
    cdef size_t L = n_layer, nn = <size_t>n * n, rows = t.n_out_rows, into = t.n_in_rows if lit else 0
    cdef size_t nr = <size_t>n * t.n_rhs, i
    cdef doubles memory = desk.work, spent = t.spent + <size_t>5 * item
    cdef doubles to = t.out + <size_t>item * t.n_level * t.n_rhs * rows
    cdef double begin = vrte_seconds(), now
    cdef Workspace own = desk
    cdef ints missed = t.missed + 2 * item
    p.orders, p.slab_stack, p.base_row = t.orders + item, t.slab_stack + item, t.base_row + item
    p.nodes, p.mu_out, p.out = t.directions, t.directions + t.n_node, to
    p.mu0 = p.mu_out + t.n_out
    p.E, p.F, p.X_lu, p.X, p.Y = memory, memory + L * nn, memory + 2 * L * nn, memory + 3 * L * nn, memory + 4 * L * nn
    p.G_E = memory + 5 * L * nn
    p.G_F = p.G_E + L * n * rows
    p.source_s = p.G_F + L * n * rows
    p.source_d = p.source_s + L * n * into
    p.lam_re = p.source_d + L * n * into
    p.lam_im = p.lam_re + L * n
    p.c = p.lam_im + L * n
    p.zeta, p.even, p.odd, p.base_down = p.c + L * nr, p.c + 2 * L * nr, p.c + 3 * L * nr, p.c + 4 * L * nr
    own.work = p.base_down + nr
    p.X_pivots, p.decaying, own.pivots = desk.pivots, desk.pivots + n_layer * n, desk.pivots + n_layer * (n + 1)
    p.residual = t.residual + <size_t>item * L
    if t.top_row != NULL:
        p.top_row = t.top_row + item
    if not lit:
        p.n_in = 0                      # no matrices for beams
        p.sent, p.rising = t.sent + item * nr, t.rising + item * nr
        set_zero(2 * L * nr, p.c)                                               # and zeta
    missed[0] = missed[1] = 0
    for stage in range(5):
        if stage == 3:
            p.n_in, p.residual = t.n_in, t.residual + (t.n_order + <size_t>item) * L
            if boundary_one(&p, 0, own) != 0:
                missed[0] = 3
        elif stage == 4:
            if rows > 0:
                reconstruct_one(&p, 0, own)
        else:
            for layer in range(n_layer):
                if t.twin[layer] < layer:
                    if stage == 2:
                        copy_twin(t.twin[layer], layer, nr, &p)
                elif stage == 0:
                    assemble_one(&p, layer, own)
                    if t.balanced and t.conserving and p.orders[0] == 0:
                        balance_one(&p, layer, first_layer(p.slab_stack, n_layer, 0) + layer, own.work)
                elif stage == 2:
                    if lit:
                        particular_one(&p, layer, own)
                elif homogeneous_one(&p, layer, own) != 0:
                    missed[0], missed[1] = 1, layer
                    break
        now = vrte_seconds()
        spent[stage] = now - begin
        begin = now
        if missed[0] != 0:
            return 0
    if t.conserving and p.orders[0] == 0:
        fluxes_one(&p, t.flux + <size_t>2 * item * t.n_level * t.n_rhs, own)
    for i in range(<size_t>t.n_level * t.n_rhs):
        for o in range(t.n_out):
            for s in range(t.stokes):
                to[0] = to[0] * (t.flip[s] if o < t.n_up else 1.0) / (2.0 * PI)
                to += 1
    return 0


cdef void copy_twin(int first, int layer, size_t nr, const Arrays* p) noexcept nogil:
    """What the stages before `boundary` found of a layer, for a later one that is made of the same."""
    cdef size_t n = p.n, nn = n * n
    copy(n, p.lam_re + first * n, p.lam_re + layer * n)
    copy(n, p.lam_im + first * n, p.lam_im + layer * n)
    copy(nn, p.X + first * nn, p.X + layer * nn)
    copy(nn, p.Y + first * nn, p.Y + layer * nn)
    copy(nr, p.c + first * nr, p.c + layer * nr)
    copy(nr, p.zeta + first * nr, p.zeta + layer * nr)
