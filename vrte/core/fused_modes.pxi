# All of section 2.C for one Fourier order after another, each from its matrices to its light in the memory of one
# thread: where orders are small, what stands between five stages takes longer than the stages.

cdef size_t most_scratch(Arrays* t) noexcept nogil:
    """The largest number of doubles of scratch memory that one of the stages asks for."""
    cdef size_t most = max(assemble_job(t).doubles, max(balance_flux_job(t).doubles, homogeneous_job(t).doubles))
    most = max(most, max(particular_job(t).doubles, boundary_job(t).doubles))
    return max(most, max(reconstruct_job(t).doubles, nodal_fluxes_job(t).doubles))


cdef int fused_modes_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    """One order, the stages' arrays in scratch memory of its own."""
    cdef Arrays p = t[0]
    cdef Workspace own = Workspace(t.memory, t.pivots, desk.stop)
    cdef int layer, stage, o, s
    cdef bint lit = t.n_sent == 0, conserving = t.conserving and t.orders[0] == 0      # lit: whether layers meet beams
    cdef size_t nr = <size_t>t.n * t.n_rhs, i
    cdef doubles to = t.out
    cdef double begin = vrte_seconds(), now
    p.n_order = 1
    p.nodes, p.mu_out, p.mu0 = t.directions, t.directions + t.n_node, t.directions + t.n_node + t.n_out
    p.E, p.F, p.X_lu, p.X, p.Y, p.G_E, p.G_F = t.own_E, t.own_F, t.own_X_lu, t.own_X, t.own_Y, t.own_G_E, t.own_G_F
    p.source_s, p.source_d, p.lam_re, p.lam_im = t.own_source_s, t.own_source_d, t.own_lam_re, t.own_lam_im
    p.c, p.zeta, p.even, p.odd, p.base_down = t.own_c, t.own_zeta, t.own_even, t.own_odd, t.own_base_down
    p.X_pivots, p.decaying, p.residual = t.own_X_pivots, t.own_decaying, t.residual + <size_t>item * t.n_layer
    if not lit:
        p.n_in = p.n_in_rows = 0                      # no matrices for beams
        p.n_all = t.n_node + t.n_out
        p.sent, p.rising = t.sent + item * nr, t.rising + item * nr
        set_zero(t.n_layer * nr, p.c)
        set_zero(t.n_layer * nr, p.zeta)
    t.missed[0] = t.missed[1] = 0
    for stage in range(5):
        if stage == 3:
            p.n_in, p.residual = t.n_in, p.residual + <size_t>t.n_order * t.n_layer
            if boundary_item(&p, 0, own) != 0:
                t.missed[0] = 3
        elif stage == 4:
            if t.n_out_rows > 0:
                reconstruct_item(&p, 0, own)
        else:
            for layer in range(t.n_layer):
                if t.twin[layer] < layer:
                    if stage == 2:
                        copy_twin(t.twin[layer], layer, nr, &p)
                elif stage == 0:
                    assemble_item(&p, layer, own)
                    if t.balanced and conserving:
                        balance_flux_item(&p, layer, own)
                elif stage == 2:
                    if lit:
                        particular_item(&p, layer, own)
                elif homogeneous_item(&p, layer, own) != 0:
                    t.missed[0], t.missed[1] = 1, layer
                    break
        now = vrte_seconds()
        t.spent[stage] = now - begin
        begin = now
        if t.missed[0] != 0:
            return 0
    if conserving:
        nodal_fluxes_item(&p, 0, own)
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
