# All of section 2.C for one Fourier order after another, each from its matrices to its light in the memory of one
# thread: where orders are small, what stands between five stages takes longer than the stages.

cdef struct FusedModes:
    Assembly assembly
    Homogeneous homogeneous
    Particular particular
    Boundary boundary
    Reconstruction reconstruction
    given flip
    given_ints slab_stack, twin
    bint balanced
    doubles spent, flux, light
    ints missed
    int first                  # of its items


cdef struct FusedParts:
    const FusedModes* sets
    given_ints part_of


def fused_modes_work(n, n_layer, n_rhs, rows, into, n_all, n_term, stokes):
    """Doubles of one thread of `fused_modes`: an order's matrices, modes and amplitudes, then the scratch memory of any
    stage."""
    each = n_layer * n * (5 * n + 2 * rows + 2 * into + 2 + 4 * n_rhs) + n_rhs * n
    return each + max(3 * n, assembly_work(n_all, n_term, stokes), homogeneous_work(n), 2 * n * into + 4 * n,
                      boundary_work(n, n_layer, n_rhs), reconstruction_work(n, rows, n_rhs, n_layer),
                      flux_work(n, n_rhs))


def fused_modes(crew, *, parts, const int[::1] orders, const int[::1] part_of, const int[::1] slab_stack,
                const int[::1] twin, const double[:, :, ::1] coefficients, const int[::1] terms,
                const double[::1] albedo, const double[::1] directions, const double[::1] weights, int n_up, int n_out,
                bint balanced, bint quick, bint clear, const int[::1] clear_layers, const double[::1] thickness,
                const double[::1] above, const int[::1] base_row, const int[::1] top_row, const double[::1] level,
                const int[::1] level_layer, double[:, :, ::1] residual, double[:, ::1] spent, int[:, ::1] missed):
    """`assemble`, `homogeneous`, `particular`, `boundary`, `reconstruct` and `nodal_fluxes` of every order of one or
    more scenes, for one or more sets of Stokes parameters: one order of one set and scene an item.

    Arguments are those of the stages; part_of, slab_stack (item,): the set, ascending, and the scene of each of
    `orders`; twin (layer,): of each layer of a scene the first that is made of the same; balanced: whether order 0 is
    balanced on nodes that are not Gauss's. residual (2, item, layer): of the modes, of the boundary; spent (item, 5):
    seconds of each stage; missed (item, 2): the stage that failed, 1 or 3, 0 for none, and its layer.

    parts: of each set whether it is conserving, its members, columns, flip (S,): D of (1:11); its base, base_source and
    base_out, or None; what lies above, or None: top, sent, rising (item, n_rhs, n), of no items where beams go through
    it; flux (item, 2, n_tau, n_rhs): up and down, of order 0 alone where it is conserved; out (item, n_tau, n_rhs,
    S n_out): radiance for a unit beam in the public frame; items of the set alone.
    """
    cdef int n_layer = <int>residual.shape[2], n_node = <int>weights.shape[0], n_all = <int>directions.shape[0]
    cdef int n_in = n_all - n_node - n_out, n_term = <int>coefficients.shape[1]
    cdef int n_rhs, stokes, n, k, first = 0, most = 0
    cdef size_t room = 0
    cdef given mu0 = &directions[0] + n_node + n_out
    cdef const int[::1] members
    cdef const double[:, ::1] columns
    cdef const double[:, :, ::1] base, base_source, base_out, sent
    cdef const double[:, :, :, ::1] top
    cdef const double[::1] flip
    cdef double[:, :, ::1] rising
    cdef double[:, :, :, ::1] flux, out
    cdef bint conserving
    cdef FusedModes* t
    cdef unsigned char[::1] memory = np.empty(len(parts) * sizeof(FusedModes), np.uint8)
    cdef FusedModes* sets = <FusedModes*>&memory[0]
    for k, part in enumerate(parts):                  # whoever calls holds their arrays
        conserving, members, columns, flip, below, above_it, flux, out = part
        stokes, t = <int>members.shape[0], &sets[k]
        n, n_rhs = stokes * n_node, n_in * <int>columns.shape[0]
        t.assembly = Assembly(n_layer, n_term, n_node, n_out, n_in, stokes, &orders[0],
                              &members[0], &terms[0], &slab_stack[0], &coefficients[0, 0, 0], &albedo[0],
                              &directions[0], &weights[0], NULL, NULL, NULL, NULL, NULL, NULL)
        t.homogeneous = Homogeneous(Nodes(n, stokes, &directions[0], &weights[0]), n_layer, conserving, quick, clear,
                                    &orders[0], &slab_stack[0], &albedo[0], NULL, NULL, NULL, NULL, NULL, NULL, NULL,
                                    NULL, &residual[0, 0, 0])
        t.particular = Particular(n, stokes, n_in, <int>columns.shape[0], NULL, NULL, NULL, mu0, &columns[0, 0], NULL,
                                  NULL, NULL, NULL, NULL, NULL, NULL, NULL)
        t.boundary = Boundary(n, n_layer, n_in, n_rhs, NULL, NULL, NULL, NULL, NULL, NULL, &clear_layers[0],
                              &slab_stack[0], &thickness[0], mu0, &above[0], &base_row[0], NULL, NULL, &top_row[0],
                              NULL, NULL, 1, NULL, NULL, NULL, NULL, NULL, &residual[1, 0, 0])
        t.reconstruction = Reconstruction(n, stokes, n_out, n_up, n_layer, n_in, n_rhs, <int>level_layer.shape[0],
                                          NULL, NULL, NULL, NULL, NULL, NULL, NULL, NULL, NULL, NULL, NULL, NULL,
                                          &base_row[0], &slab_stack[0], NULL, &thickness[0], &above[0], mu0,
                                          &directions[0] + n_node, &level[0], &level_layer[0], NULL)
        if below is not None:
            base, base_source, base_out = below
            t.boundary.base, t.boundary.base_source = &base[0, 0, 0], &base_source[0, 0, 0]
            t.reconstruction.base_out = &base_out[0, 0, 0]
        if above_it is not None:
            top, sent, rising = above_it
            t.boundary.top, t.boundary.block = &top[0, 0, 0, 0], <int>top.shape[3]
            if sent.shape[0] > 0:
                t.assembly.n_in = 0
                t.boundary.sent, t.boundary.rising = &sent[0, 0, 0], &rising[0, 0, 0]
        t.light, t.flux, t.spent, t.missed = &out[0, 0, 0, 0], &flux[0, 0, 0, 0], &spent[0, 0], &missed[0, 0]
        t.flip, t.slab_stack, t.twin, t.balanced = &flip[0], &slab_stack[0], &twin[0], balanced
        t.first, first, most = first, first + <int>out.shape[0], max(most, n)
        room = max(room, <size_t>fused_modes_work(n, n_layer, n_rhs, stokes * n_out, stokes * n_in, n_all, n_term,
                                                  stokes))
    cdef FusedParts task = FusedParts(sets, &part_of[0])
    run_items(crew, fused_modes_one, &task, <int>orders.shape[0], room,
              (n_layer + 6) * most + 8 + (2 * n_layer + 1) * most + n_layer, NULL)


cdef int fused_modes_one(const void* task, int item, Workspace desk) noexcept nogil:
    """One order; its matrices lie in the desk's memory, before the scratch memory of the stages."""
    cdef const FusedParts* parts = <const FusedParts*>task
    cdef const FusedModes* t = parts.sets + parts.part_of[item]
    cdef Assembly a = t.assembly
    cdef Homogeneous h = t.homogeneous
    cdef Particular p = t.particular
    cdef Boundary b = t.boundary
    cdef Reconstruction r = t.reconstruction
    cdef int n = b.n, n_layer = b.n_layer, layer, stage, o, s, up = r.n_up
    cdef size_t L = n_layer, nn = <size_t>n * n, rows = <size_t>r.stokes * r.n_out, into = <size_t>r.stokes * a.n_in
    cdef size_t nr = <size_t>n * b.n_rhs, light = <size_t>r.n_level * b.n_rhs * rows, i
    cdef size_t fluxes = <size_t>2 * r.n_level * b.n_rhs
    cdef doubles memory = desk.work
    cdef doubles spent = t.spent + <size_t>5 * item
    cdef size_t place = item - t.first
    cdef doubles to = t.light + place * light
    cdef double begin = vrte_seconds(), now, factor
    cdef Workspace own = desk
    cdef ints missed = t.missed + 2 * item
    a.orders, h.orders = a.orders + item, h.orders + item
    a.slab_stack = h.slab_stack = b.slab_stack = r.slab_stack = t.slab_stack + item
    a.E, a.F, a.G_E = memory, memory + L * nn, memory + 5 * L * nn
    h.X_lu, h.X, h.Y = memory + 2 * L * nn, memory + 3 * L * nn, memory + 4 * L * nn
    a.G_F = a.G_E + L * n * rows
    a.source_s = a.G_F + L * n * rows
    a.source_d = a.source_s + L * n * into
    h.lam_re = a.source_d + L * n * into
    h.lam_im = h.lam_re + L * n
    p.c = h.lam_im + L * n
    p.zeta, b.even, b.odd = p.c + L * nr, p.c + 2 * L * nr, p.c + 3 * L * nr
    b.base_down = p.c + 4 * L * nr
    own.work = b.base_down + nr
    h.X_pivots, b.decaying, own.pivots = desk.pivots, desk.pivots + n_layer * n, desk.pivots + n_layer * (n + 1)
    h.E, h.F = a.E, a.F
    h.residual = h.residual + <size_t>item * L
    p.F, p.source_s, p.source_d, p.X_lu, p.X_pivots = a.F, a.source_s, a.source_d, h.X_lu, h.X_pivots
    p.lam_re, p.lam_im, p.X, p.Y = h.lam_re, h.lam_im, h.X, h.Y
    b.lam_re, b.lam_im, b.X, b.Y, b.c, b.zeta = h.lam_re, h.lam_im, h.X, h.Y, p.c, p.zeta
    b.base_row, b.top_row, b.residual = b.base_row + item, b.top_row + item, b.residual + item * n_layer
    if b.sent != NULL:
        b.sent, b.rising = b.sent + place * nr, b.rising + place * nr
        set_zero(2 * L * nr, p.c)                                               # and zeta
    r.G_E, r.G_F, r.lam_re, r.lam_im, r.X, r.Y = a.G_E, a.G_F, h.lam_re, h.lam_im, h.X, h.Y
    r.c, r.zeta, r.even, r.odd, r.base_down, r.decaying = p.c, p.zeta, b.even, b.odd, b.base_down, b.decaying
    r.base_row, r.out = b.base_row, to
    missed[0] = missed[1] = 0
    for stage in range(5):
        if stage == 3:
            if boundary_one(&b, 0, own) != 0:
                missed[0] = 3
        elif stage == 4:
            if rows > 0:
                reconstruct_one(&r, 0, own)
        else:
            for layer in range(n_layer):
                if t.twin[layer] < layer:
                    if stage == 2:
                        copy_twin(t.twin[layer], layer, n, nr, n * rows, &a, &h, &p)
                elif stage == 0:
                    assemble_one(&a, layer, own)
                    if t.balanced and h.conserving and h.orders[0] == 0:
                        balance_one(&a, layer, first_layer(h.slab_stack, n_layer, 0) + layer, own.work)
                elif stage == 2:
                    if b.sent == NULL:
                        particular_one(&p, layer, own)
                elif homogeneous_one(&h, layer, own) != 0:
                    missed[0], missed[1] = 1, layer
                    break
        now = vrte_seconds()
        spent[stage] = now - begin
        begin = now
        if missed[0] != 0:
            return 0
    if h.conserving and h.orders[0] == 0:
        fluxes_one(&r, &h.nodes, t.flux + place * fluxes, own)
    for i in range(<size_t>r.n_level * b.n_rhs):
        for o in range(r.n_out):
            for s in range(r.stokes):
                to[0] = to[0] * (t.flip[s] if o < up else 1.0) / (2.0 * PI)
                to += 1
    return 0


cdef void copy_twin(int first, int layer, int n, size_t nr, size_t room, const Assembly* a, const Homogeneous* h,
                    const Particular* p) noexcept nogil:
    """What the stages before `boundary` found of a layer, for a later one that is made of the same."""
    cdef size_t nn = <size_t>n * n
    copy(room, a.G_E + first * room, a.G_E + layer * room)
    copy(room, a.G_F + first * room, a.G_F + layer * room)
    copy(n, h.lam_re + <size_t>first * n, h.lam_re + <size_t>layer * n)
    copy(n, h.lam_im + <size_t>first * n, h.lam_im + <size_t>layer * n)
    copy(nn, h.X + first * nn, h.X + layer * nn)
    copy(nn, h.Y + first * nn, h.Y + layer * nn)
    copy(nr, p.c + first * nr, p.c + layer * nr)
    copy(nr, p.zeta + first * nr, p.zeta + layer * nr)
