# The top of a semi-infinite layer, by invariance alone: a thin layer added on top changes nothing, so with E = D - e
# and F = D - f, D = 1/mu, D R + R D = ((1 + R) e (1 + R) - (1 - R) f (1 - R))/2. e = phi C phi^T and f alike are of
# low rank, a few columns a degree. With He = phi_e + R phi_e, Hf = phi_f - R phi_f (Ambarzumian's functions, as
# matrices) R = (He Ce He'^T - Hf Cf Hf'^T)/2 over 1/mu + 1/mu', and H' = Q H q by reciprocity, Q and q the signs of
# V. A fixed point of it gains a factor of about q of `order_bounds` a step.

cdef size_t invariance_doubles(const Arrays* t) noexcept nogil:
    """Scratch memory of `solve_invariance`."""
    cdef size_t n = t.n, u = t.stokes * t.n_off
    return (3 * t.n_placed + 12 * (n + u)) * t.n_term + t.n_node + n * n + u * n + 2 * u * u + 6 * n * max(n, u)


cdef struct FactorColumns:
    # what one kind (E or F) has on some rows: phi, H and H C, column by column
    int rows
    int columns
    doubles phi
    doubles H
    doubles HC


cdef doubles sheet_at(doubles memory, const Expansion* x, int kind, int n_mu, FactorColumns* sheet) noexcept nogil:
    """Places a sheet; what lies behind it."""
    sheet.rows, sheet.columns = x.p.stokes * n_mu, columns_of(x, kind)
    sheet.phi = memory
    sheet.H = sheet.phi + <size_t>sheet.rows * sheet.columns
    sheet.HC = sheet.H + <size_t>sheet.rows * sheet.columns
    return sheet.HC + <size_t>sheet.rows * sheet.columns


cdef void step_of(FactorColumns rows, FactorColumns nodes, double sign, doubles HC_H, double add) noexcept nogil:
    """HC_H = sign H C H_nodes^T + add HC_H."""
    product(b"N", b"T", rows.rows, nodes.rows, rows.columns, sign, rows.HC, rows.rows, nodes.H, nodes.rows, add, HC_H,
            rows.rows)


cdef void half_step_of(FactorColumns nodes, double sign, doubles HC_H, double add) noexcept nogil:
    """step_of on the nodes, where it is symmetric: STRIPS strips of columns, each from the diagonal down."""
    cdef int strip, first, last
    for strip in range(STRIPS):
        first, last = nodes.rows * strip // STRIPS, nodes.rows * (strip + 1) // STRIPS
        if last > first:
            product(b"N", b"T", nodes.rows - first, last - first, nodes.columns, sign, nodes.HC + first, nodes.rows,
                    nodes.H + first, nodes.rows, add, HC_H + <size_t>first * nodes.rows + first, nodes.rows)


cdef void mirror(int n, doubles a) noexcept nogil:
    """a's lower triangle above the diagonal."""
    cdef int i, j
    for j in range(n):
        for i in range(j + 1, n):
            a[<size_t>i * n + j] = a[<size_t>j * n + i]


cdef void renew(FactorColumns rows, FactorColumns nodes, double sign, given R) noexcept nogil:
    """H = phi + sign R phi_nodes."""
    copy(<size_t>rows.rows * rows.columns, rows.phi, rows.H)
    product(b"N", b"N", rows.rows, rows.columns, nodes.rows, sign, R, rows.rows, nodes.phi, nodes.rows, 1.0, rows.H,
            rows.rows)


cdef void divide_by_rates(Parity p, int n_row, given mu_row, int n_column, given mu_column,
                          doubles new) noexcept nogil:
    """new <- new Q/2 over 1/mu + 1/mu'."""
    cdef int i, j, a, b, rows = p.stokes * n_row
    cdef double share, sign
    cdef doubles column
    for j in range(n_column):
        for i in range(n_row):
            share = 0.5 * mu_row[i] * mu_column[j] / (mu_row[i] + mu_column[j])
            for b in range(p.stokes):
                sign = -share if b == p.place[3] else share
                column = new + <size_t>(p.stokes * j + b) * rows + p.stokes * i
                for a in range(p.stokes):
                    column[a] *= sign


cdef inline double largest_in(int size, given a) noexcept nogil:
    cdef int one = 1
    return fabs(a[idamax(&size, <doubles>a, &one) - 1]) if size > 0 else 0.0


cdef inline double scalar_product(int size, given a, given b) noexcept nogil:
    cdef int one = 1
    return ddot(&size, <doubles>a, &one, <doubles>b, &one)


cdef struct AndersonHistory:
    # what the last fixed-point steps led to, by how much they moved, this one first; products of the movements
    int steps
    doubles led[3]
    doubles moved[3]
    double products[3][3]


cdef void remember(int size, AndersonHistory* past) noexcept nogil:
    """The step just done becomes the last one; room for a new one is where the oldest was."""
    cdef doubles led = past.led[2]
    cdef doubles moved = past.moved[2]
    past.led[2], past.led[1], past.led[0] = past.led[1], past.led[0], led
    past.moved[2], past.moved[1], past.moved[0] = past.moved[1], past.moved[0], moved
    past.products[2][2], past.products[1][1] = past.products[1][1], past.products[0][0]
    past.products[1][2] = past.products[0][1]
    past.steps += 1


cdef extern from "core/kernels/in_c.h":
    double vrte_missing(double gap, double rate, double largest) noexcept nogil
    void vrte_accelerate(int steps, double product_00, double product_01, double product_02, double product_11,
                         double product_12, double product_22, double* fraction) noexcept nogil


cdef void accelerate(int size, AndersonHistory* past, doubles R) noexcept nogil:
    """R <- the combination of this step and the last two that would have moved least (Anderson's acceleration)."""
    cdef int k
    cdef double fraction[3]
    cdef given x = past.led[0]
    cdef given y = past.led[1]
    cdef given z = past.led[2]
    for k in range(min(past.steps, 2) + 1):
        past.products[0][k] = scalar_product(size, past.moved[0], past.moved[k])
    vrte_accelerate(past.steps, past.products[0][0], past.products[0][1], past.products[0][2], past.products[1][1],
                    past.products[1][2], past.products[2][2], fraction)
    if fraction[0] == 1.0:
        copy(size, x, R)
    elif fraction[2] == 0.0:
        for k in range(size):
            R[k] = fraction[0] * x[k] + fraction[1] * y[k]
    else:
        for k in range(size):
            R[k] = fraction[0] * x[k] + fraction[1] * y[k] + fraction[2] * z[k]


cdef struct Linear:
    # a change of R, or the adjoint of one, as a fixed point of its own: what a step adds; whether rows are the nodes
    bint adjoint, symmetric
    given source
    doubles spare       # two sheets of the rows


cdef void begin_at_zero(FactorColumns* rows) noexcept nogil:
    """Sets H of both kinds of rows to what it is where R is 0: phi."""
    cdef int kind
    for kind in range(2):
        copy(<size_t>rows[kind].rows * rows[kind].columns, rows[kind].phi, rows[kind].H)


cdef double fixed_point(const Expansion* x, FactorColumns* rows, FactorColumns* nodes, given mu_row, given mu_node,
                        double rate, double tolerance, bint halves, bint begun, doubles R, doubles room, ints steps,
                        given_ints stop, const Linear* linear) noexcept nogil:
    """Fixed points for R of some rows until what is missing is below the tolerance; the rows may be the nodes. rate:
    what a step gains at least; room: six matrices like R; halves: on the nodes alone, where H C H^T is symmetric;
    begun: from the rows' H, not from R = 0, if that is near. With `linear`, which is NULL else, of the linearized
    equation."""
    cdef int step, kind, k, size = rows[0].rows * nodes[0].rows
    cdef double gap, largest, missing = 1.0
    cdef doubles new
    cdef bint done
    cdef AndersonHistory past
    memset(&past, 0, sizeof(AndersonHistory))
    for k in range(3):
        past.led[k], past.moved[k] = room + <size_t>2 * k * size, room + <size_t>(2 * k + 1) * size
    set_zero(size, R)
    if linear == NULL and not begun:
        begin_at_zero(rows)
    for step in range(MOST_STEPS):
        new = past.led[0]
        for kind in range(2 if linear == NULL else 0):
            times_coefficients(x, kind, -1.0, rows[kind].rows, rows[kind].H, rows[kind].HC)
            if halves:
                half_step_of(nodes[kind], -1.0 if kind else 1.0, new, 1.0 if kind else 0.0)
            else:
                step_of(rows[kind], nodes[kind], -1.0 if kind else 1.0, new, 1.0 if kind else 0.0)
        if linear != NULL:
            linear_step(x, linear, rows, nodes, mu_row, mu_node, R, new)
        else:
            if halves:
                mirror(nodes[0].rows, new)
            divide_by_rates(x.p, rows[0].rows // x.p.stokes, mu_row, nodes[0].rows // x.p.stokes, mu_node, new)
        for k in range(size):
            past.moved[0][k] = new[k] - R[k]
        gap, largest = largest_in(size, past.moved[0]), largest_in(size, new)
        missing = vrte_missing(gap, rate, largest)
        steps[0] += 1
        if begun and step == 1 and not gap <= NEAR * largest:
            begun = False                       # of several fixed points light is the one that is reached from R = 0
            set_zero(size, R)
            begin_at_zero(rows)
            continue
        done = largest == 0.0 or missing <= tolerance or gap <= 4e-16 * largest or stop[0]
        if done or (begun and step == 0):   # the H that it began from is of no R: there is no movement yet
            copy(size, new, R)
        else:
            accelerate(size, &past, R)
            remember(size, &past)
        for kind in range(2 if linear == NULL else 0):
            renew(rows[kind], nodes[kind], -1.0 if kind else 1.0, R)
        if done:
            return 0.0 if largest == 0.0 else missing
    return missing


cdef enum:
    STRIPS = 4           # that a symmetric product is made in
    MOST_AMPLIFIED = 30  # sum of an interpolation's sizes: beyond, nodes are not those of a polynomial



cdef bint interpolate(int n_row, given mu_row, int n_node, given mu_node, doubles share) noexcept nogil:
    """Fractions (n_row, n_node) of values at nodes in that of the polynomial through them at other cosines, by the
    barycentric formula; False where they amplify errors. n_node doubles lie behind share."""
    cdef int i, j, k
    cdef double total, size
    cdef doubles weight = share + <size_t>n_row * n_node
    for j in range(n_node):
        weight[j] = 1.0
        for k in range(n_node):
            if k != j:
                weight[j] /= 4.0 * (mu_node[j] - mu_node[k])     # 1/4: the capacity of [0, 1], against overflow
    for i in range(n_row):
        total = size = 0.0
        for j in range(n_node):
            if mu_row[i] == mu_node[j]:
                set_zero(n_node, share + <size_t>i * n_node)
                share[<size_t>i * n_node + j] = total = size = 1.0
                break
            share[<size_t>i * n_node + j] = weight[j] / (mu_row[i] - mu_node[j])
            total += share[<size_t>i * n_node + j]
            size += fabs(share[<size_t>i * n_node + j])
        if not size <= MOST_AMPLIFIED * fabs(total):
            return False
        for j in range(n_node):
            share[<size_t>i * n_node + j] /= total
    return True


cdef void begin_rows(int stokes, int n_row, given scale_row, given share, given scale_node, FactorColumns* nodes,
                     FactorColumns* rows, doubles spread) noexcept nogil:
    """H of rows from nodes where it is known: R phi, what it has beside phi, is interpolated. spread: (rows, nodes)."""
    cdef int kind, i, j, a, k, n = n_row * stokes, size = nodes[0].rows
    cdef double one
    set_zero(<size_t>n * size, spread)
    for j in range(size // stokes):
        for i in range(n_row):
            one = share[<size_t>i * (size // stokes) + j] / scale_node[j]
            if scale_row != NULL:
                one *= scale_row[i]
            for a in range(stokes):
                spread[(<size_t>stokes * j + a) * n + stokes * i + a] = one
    for kind in range(2):
        for k in range(size * nodes[kind].columns):
            nodes[kind].HC[k] = nodes[kind].H[k] - nodes[kind].phi[k]
        copy(<size_t>n * nodes[kind].columns, rows[kind].phi, rows[kind].H)
        product(b"N", b"N", n, nodes[kind].columns, size, 1.0, spread, n, nodes[kind].HC, size, 1.0, rows[kind].H, n)


cdef struct Invariant:
    # one order of a semi-infinite layer: R from the nodes to the nodes (n, n) and off them (u, n), what R is made of
    Expansion x
    int n, u
    given off
    double rate, residual
    doubles R, Ru, room
    FactorColumns nodes[2]
    FactorColumns rows[2]


cdef bint begin_on_half(const Arrays* t, Invariant* s, given scale, given_ints stop) noexcept nogil:
    """H of the nodes from a solve on every other one; False where that is no start."""
    cdef int n_node = t.n_node, half = (n_node + 1) // 2, stokes = t.stokes, i, j, k, kind, steps = 0
    cdef doubles mu = s.room, weight = mu + half, R = weight + half, room = R + <size_t>half * half * stokes * stokes
    cdef doubles memory = room + 6 * <size_t>half * half * stokes * stokes, share
    cdef double ratio
    cdef FactorColumns sheets[2]
    if not t.coarse or n_node < FEWEST_TO_HALVE or s.x.terms > 2 * n_node or s.rate < WEAKEST_RATE:
        return False
    for kind in range(2):
        memory = sheet_at(memory, &s.x, kind, half, &sheets[kind])
    share = memory
    for j in range(half):
        mu[j], weight[j] = t.directions[2 * j], 0.0
    if not interpolate(n_node, t.directions, half, mu, share):
        return False
    for i in range(n_node):
        for j in range(half):
            weight[j] += t.weights[i] * share[<size_t>i * half + j]
    for j in range(half):
        if not weight[j] > 0.0:
            return False
        weight[j] = sqrt(weight[j] / mu[j])
    for kind in range(2):
        for k in range(sheets[kind].columns):
            for j in range(half):
                ratio = weight[j] / scale[2 * j]
                for i in range(stokes):
                    sheets[kind].phi[(<size_t>k * half + j) * stokes + i] = ratio * s.nodes[kind].phi[
                        (<size_t>k * n_node + 2 * j) * stokes + i]
    fixed_point(&s.x, sheets, sheets, mu, mu, s.rate, OF_HALF, t.halves, False, R, room, &steps, stop, NULL)
    begin_rows(stokes, n_node, scale, share, weight, sheets, s.nodes, room)
    return True


cdef doubles solve_invariance(const Arrays* t, given_ints stop, Invariant* s) noexcept nogil:
    """R of an order; the scratch memory behind it."""
    cdef int m = t.orders[0], terms = t.terms[0], n_all = t.n_placed, n_node = t.n_node, i, kind
    cdef given directions = t.directions
    cdef doubles prt = t.work, scale = prt + <size_t>3 * n_all * terms, memory
    cdef bint begun
    s.x = Expansion(parity_of(m, t.stokes, t.members), m, terms, t.albedo[0], t.coefficients)
    s.n, s.u, s.off, s.rate = t.n, t.stokes * t.n_off, directions + n_node, 0.0
    s.R = scale + n_node
    s.Ru = s.R + <size_t>s.n * s.n
    s.room = s.Ru + <size_t>s.u * s.n                                         # for steps, and then (u, u)
    memory = s.room + 6 * <size_t>s.n * max(s.n, s.u) + 2 * <size_t>s.u * s.u
    spherical(m, terms, is_polar(s.x.p), directions, n_all, prt)
    for i in range(m, terms):
        s.rate = max(s.rate, t.albedo[0] * norm_of_coefficients(t.coefficients + 6 * i) / (2.0 * i + 1.0))
    s.rate = min(s.rate, 0.999)
    scale_nodes(t, scale)
    for kind in range(2):
        memory = sheet_at(memory, &s.x, kind, n_node, &s.nodes[kind])
        memory = sheet_at(memory, &s.x, kind, t.n_off, &s.rows[kind])
        parity_columns(&s.x, kind, prt, n_all, 0, n_node, scale, s.nodes[kind].phi)
        parity_columns(&s.x, kind, prt, n_all, n_node, t.n_off, NULL, s.rows[kind].phi)
    t.steps[0] = 0
    if t.kept_missing != NULL:
        copy(<size_t>s.n * (s.n + s.u), t.kept_R, s.R)
        for kind in range(2):
            renew(s.nodes[kind], s.nodes[kind], -1.0 if kind else 1.0, s.R)
            renew(s.rows[kind], s.nodes[kind], -1.0 if kind else 1.0, s.Ru)
        s.residual = t.kept_missing[0]
        return memory
    begun = begin_on_half(t, s, scale, stop)
    s.residual = fixed_point(&s.x, s.nodes, s.nodes, directions, directions, s.rate, t.tolerance, t.halves, begun, s.R,
                             s.room, t.steps, stop, NULL)
    begun = begun and interpolate(t.n_off, s.off, n_node, directions, s.room)
    if begun:
        begin_rows(t.stokes, t.n_off, NULL, s.room, scale, s.nodes, s.rows, s.room + <size_t>t.n_off * n_node + n_node)
    s.residual = max(s.residual, fixed_point(&s.x, s.rows, s.nodes, s.off, directions, s.rate, t.tolerance, False,
                                             begun, s.Ru, s.room, t.steps, stop, NULL))
    return memory


cdef int keep_semi_infinite_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    return reflect_semi_infinite_one(t, item, desk)


cdef int reflect_semi_infinite_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    cdef Invariant s
    cdef int kind
    cdef double sign
    cdef doubles new
    solve_invariance(t, desk.stop, &s)
    t.residual[0] = s.residual
    if t.kept_R != NULL:
        copy(<size_t>s.n * (s.n + s.u), s.R, t.kept_R)
    # from off the nodes to off the nodes, less what is scattered once
    new = s.room
    for kind in range(2):
        sign = -1.0 if kind else 1.0
        times_coefficients(&s.x, kind, -1.0, s.u, s.rows[kind].H, s.rows[kind].HC)
        step_of(s.rows[kind], s.rows[kind], sign, new, 1.0 if kind else 0.0)
        times_coefficients(&s.x, kind, -1.0, s.u, s.rows[kind].phi, s.rows[kind].HC)
        product(b"N", b"T", s.u, s.u, s.rows[kind].columns, -sign, s.rows[kind].HC, s.u, s.rows[kind].phi, s.u, 1.0,
                new, s.u)
    divide_by_rates(s.x.p, t.n_off, s.off, t.n_off, s.off, new)
    light_of_beams(t, &s, new, s.Ru, t.up, t.on_nodes)
    if t.top_row == NULL or t.top_row[0] < 0:
        return 0
    return join_top(t, item, &s)


cdef int join_top(const Arrays* t, int item, const Invariant* s) noexcept nogil:
    """Puts the interface above on the layer: `on_nodes` becomes what comes up to it, and what it sends down again adds
    to `up`."""
    cdef int n = s.n, u = s.u, r = t.n_rhs, k, i, a, info
    cdef size_t nr = <size_t>n * r, rows = <size_t>t.stokes * t.n_out, each
    cdef doubles up = t.up, on_nodes = t.on_nodes, down = t.down, g = t.g, leaving = t.running
    cdef Stack stack = stack_at(n, r, t.memory, t.pivots, True)
    cdef Element one = Element(n, t.block, NULL, t.top + t.top_row[0] * <size_t>n * t.block, NULL, NULL)
    cdef given sent = NULL
    copy(<size_t>n * n, s.R, stack.below)
    stack.dark = False
    set_zero(nr, down)
    if t.n_sent > 0:                    # beams end at the interface
        sent = t.sent + item * nr
        copy(nr, sent, down)
        set_zero(nr, on_nodes)
        set_zero(r * rows, up)
    info = add(&stack, &one, sent, on_nodes, on_nodes, on_nodes, NULL, g)
    if info != 0:
        return info
    t.residual[0] = max(t.residual[0], stack.missing)
    copy(nr, g, on_nodes)
    share(&one, one.below, r, g, n, down, n)
    multiply(u, r, n, 1.0, s.Ru, down, 0.0, leaving)
    for k in range(r):
        for i in range(t.n_out):
            each = <size_t>k * u + t.stokes * t.out_places[i]
            for a in range(t.stokes):
                up[k * rows + i * t.stokes + a] += leaving[each + a] / s.off[t.out_places[i]]
    return 0


cdef void light_of_beams(const Arrays* t, const Invariant* s, given Ruu, given Ru, doubles up,
                         doubles on_nodes) noexcept nogil:
    """Light off the nodes (n_rhs, S n_out) and on them (n_rhs, n) of beams, from R (u, u) and (u, n)."""
    cdef int beam, c, i, j, a, b, stokes = t.stokes, V = s.x.p.place[3]
    cdef double total, sign
    cdef given column
    for beam in range(t.n_in):
        for c in range(t.n_col):
            column = t.columns + c * stokes
            for i in range(t.n_out):
                for a in range(stokes):
                    total = 0.0
                    for b in range(stokes):
                        total += Ruu[<size_t>(stokes * t.in_places[beam] + b) * s.u
                                     + stokes * t.out_places[i] + a] * column[b]
                    up[i * stokes + a] = total / s.off[t.out_places[i]]
            for j in range(s.n):                         # R_NI = Q Ru^T Q
                total = 0.0
                for b in range(stokes):
                    sign = -1.0 if (b == V) != (j % stokes == V) else 1.0
                    total += sign * Ru[<size_t>j * s.u + stokes * t.in_places[beam] + b] * column[b]
                on_nodes[j] = total
            up += t.n_out * stokes
            on_nodes += s.n
