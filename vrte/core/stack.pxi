# Slabs and interfaces of several media joined by the star product, (2:8): from the base up, then the light on the nodes
# from the top down. A medium knows the last of all nodes, the more the denser it is; slabs have no more rows than that.

def stack_work(n, n_piece, n_rhs):
    """Doubles of scratch memory that one thread of `join_media` needs."""
    return (2 * n_piece + 1) * n * (n + n_rhs) + 5 * n * n + 3 * n * n_rhs


cdef enum: RISING, ARRIVING, LEAVING, ENTERING     # ways of light at an interface: up below, down above, up above, down
cdef enum: ABOVE, BELOW, DOWN, UP                  # matrices of an interface: reflected on either side, transmitted
cdef enum: CUT, SMOOTH, ROUGH                      # kinds of interfaces


cdef struct InterfaceOperators:
    # one interface: blocks (4, N, S, S), rows first, of a smooth one, matrices (4, n, n), by columns, of a rough one
    int kind, n, stokes
    given matrices


cdef struct Stack:
    int n, stokes, r, n_piece, base_size
    given_ints size, kind, base_row
    const size_t* slabs
    const size_t* interfaces
    given base
    doubles light, residual


def join_media(crew, *, list slabs, list interfaces, const int[::1] kind, const int[::1] base_row,
               const double[:, :, ::1] base, int stokes, double[:, :, :, :, ::1] light, double[::1] residual,
               int[::1] info):
    """All light on the nodes of a stack, one Fourier order after another, of what sets out there.

    slabs: for each piece, top first, R and T of its slab (order, 2, m, m), on the last m of n nodes; interfaces: the
    first above and the last below the pieces, None for a mere cut, (1, 4, n, S) of a smooth one, rows
    first, or (order, 4, n, n) of a rough one: reflected from above, from below, transmitted down, up; kind
    (interface,): 0, 1 or 2 of these. base_row (order,): row of base (row, m, m), or -1 for black. light (order,
    interface, 4, r, n): what sets out coming up below an interface, down above it, and, not at mere cuts, going up
    above it, down below it; replaced by all light there. residual (order,): of the systems, relative.
    """
    cdef int n_piece = <int>kind.shape[0] - 1, k, n = <int>light.shape[4]
    cdef size_t[::1] at_slab = np.empty(n_piece, np.uintp), at_interface = np.zeros(n_piece + 1, np.uintp)
    cdef int[::1] size = np.empty(n_piece, np.int32)
    cdef const double[:, :, :, ::1] one
    for k in range(n_piece):
        one = slabs[k]
        at_slab[k], size[k] = <size_t>&one[0, 0, 0, 0], <int>one.shape[3]
    for k in range(n_piece + 1):
        if kind[k] != CUT:
            one = interfaces[k]
            at_interface[k] = <size_t>&one[0, 0, 0, 0]
    cdef Stack task = Stack(n, stokes, <int>light.shape[3], n_piece, <int>base.shape[2], &size[0], &kind[0],
                            &base_row[0], &at_slab[0], &at_interface[0], &base[0, 0, 0], &light[0, 0, 0, 0, 0],
                            &residual[0])
    run_items(crew, join_media_one, &task, <int>light.shape[0], stack_work(n, n_piece, task.r), n + n_piece, &info[0])


cdef inline InterfaceOperators interface_at(const Stack* t, int k, int item) noexcept nogil:
    cdef given matrices = <given>t.interfaces[k]
    if t.kind[k] == ROUGH:
        matrices += <size_t>4 * item * t.n * t.n
    return InterfaceOperators(t.kind[k], t.n, t.stokes, matrices)


cdef void share(InterfaceOperators interface, int way, int columns, given field, doubles out) noexcept nogil:
    """out += what an interface makes of light (n, columns)."""
    cdef int n = interface.n, s = interface.stokes, i, j, a, b
    cdef given matrix = interface.matrices + <size_t>way * n * (n if interface.kind == ROUGH else s), block
    if interface.kind == ROUGH:
        multiply(n, columns, n, 1.0, matrix, field, 1.0, out)
        return
    for j in range(columns):
        for i in range(n // s):
            block = matrix + <size_t>i * s * s
            for a in range(s):
                for b in range(s):
                    out[<size_t>j * n + i * s + a] += block[a * s + b] * field[<size_t>j * n + i * s + b]


cdef void share_columns(InterfaceOperators interface, int way, double factor, given field, doubles out) noexcept nogil:
    """out += factor times a matrix (n, n) times what an interface does."""
    cdef int n = interface.n, s = interface.stokes, i, j, a, b
    cdef double value
    cdef given matrix = interface.matrices + <size_t>way * n * (n if interface.kind == ROUGH else s)
    if interface.kind == ROUGH:
        multiply(n, n, n, factor, field, matrix, 1.0, out)
        return
    for j in range(n // s):
        for b in range(s):
            for a in range(s):
                value = factor * matrix[<size_t>j * s * s + a * s + b]
                for i in range(n if value != 0.0 else 0):
                    out[<size_t>(j * s + b) * n + i] += value * field[<size_t>(j * s + a) * n + i]


cdef void resize(int old, int new, doubles matrix, doubles spare) noexcept nogil:
    """A matrix on the last `old` nodes on the last `new` ones: what no light meets is zero."""
    cdef int j, kept = min(old, new)
    if old == new:
        return
    copy(<size_t>old * old, matrix, spare)
    set_zero(<size_t>new * new, matrix)
    for j in range(kept):
        copy(kept, spare + <size_t>(old - kept + j) * old + old - kept,
             matrix + <size_t>(new - kept + j) * new + new - kept)


cdef double residual_of(int m, int r, given matrix, given found, int ld, doubles right) noexcept nogil:
    """What is left of right-hand sides (m, r), relative; both with columns `ld` apart."""
    cdef double largest = 0.0, left = 0.0
    cdef int i, j
    for j in range(r):
        largest = max(largest, largest_of(m, right + <size_t>j * ld))
    product(b"N", b"N", m, r, m, -1.0, matrix, m, found, ld, 1.0, right, ld)
    for j in range(r):
        left = max(left, largest_of(m, right + <size_t>j * ld))
    return left / largest if largest > NO_LIGHT else 0.0


# (2:8), (2:10)-(2:11)
cdef int join_media_one(const void* task, int item, Workspace desk) noexcept nogil:
    cdef const Stack* t = <const Stack*>task
    cdef int n = t.n, r = t.r, last = t.n_piece, k, m, width = n, info, first
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * r, i
    cdef doubles light = t.light + <size_t>item * (last + 1) * 4 * nr
    cdef doubles G = desk.work, g = G + last * nn                        # per piece: as of core/joining.pxi
    cdef doubles U = g + last * nr, v = U + (last + 1) * nn              # per interface: the same just below it
    cdef doubles below = v + (last + 1) * nr, M = below + nn, kept = M + nn, spare = kept + nn, through = spare + nn
    cdef doubles own = through + nn, right = own + nr
    cdef given R, T
    cdef InterfaceOperators interface
    cdef doubles here
    cdef ints pivots = desk.pivots, meets = pivots + n           # whether anything below a piece sends light back
    cdef bint seen = t.base_row[item] >= 0, looks
    cdef double worst = 0.0
    set_zero(nn, below)
    if seen:
        width = t.base_size
        copy(<size_t>width * width, t.base + <size_t>t.base_row[item] * width * width, below)
        resize(width, n, below, spare)
    if t.kind[last] != CUT:
        set_zero(nn, M)
        for k in range(n):
            M[<size_t>k * n + k] = 1.0
        share(interface_at(t, last, item), ABOVE, n, M, below)
        seen = True
    width = n
    copy(nr, light + (<size_t>4 * last + LEAVING) * nr, own)
    for k in range(last - 1, -1, -1):
        if desk.stop[0]:
            return 0
        # the slab upon what lies below it
        m, R = t.size[k], <given>t.slabs[k] + 2 * <size_t>item * t.size[k] * t.size[k]
        T, first, meets[k] = R + <size_t>m * m, n - m, seen
        resize(width, m, below, spare)
        width = m
        here = g + k * nr
        copy(nr, own, here)
        looks = k > 0 or t.kind[0] != CUT              # whether its reflection is looked at
        if seen:
            one_minus_product(m, below, R, M)
            copy(<size_t>m * m, M, kept)
            info = factorise(m, M, m, pivots)
            if info != 0:
                return info
            product(b"N", b"N", m, r, m, 1.0, below, m, light + (<size_t>4 * (k + 1) + ARRIVING) * nr + first, n, 1.0,
                    here + first, n)
            copy(nr, here, right)
            solve(m, r, M, pivots, here + first, n)
            worst = max(worst, residual_of(m, r, kept, here + first, n, right + first))
            if looks:
                copy(<size_t>m * m, below, G + k * nn)
                solve(m, m, M, pivots, G + k * nn, m)
                multiply(m, m, m, 1.0, G + k * nn, T, 0.0, spare)
        copy(nr, light + (<size_t>4 * k + RISING) * nr, own)
        product(b"N", b"N", m, r, m, 1.0, T, m, here + first, n, 1.0, own + first, n)
        if not looks:
            continue
        copy(<size_t>m * m, R, below)
        if seen:
            multiply(m, m, m, 1.0, T, spare, 1.0, below)
        seen = True
        if t.kind[k] == CUT:
            continue
        # the interface upon that
        interface, here = interface_at(t, k, item), v + k * nr
        resize(width, n, below, spare)
        width = n
        copy(nr, own, here)
        multiply(n, r, n, 1.0, below, light + (<size_t>4 * k + ENTERING) * nr, 1.0, here)
        set_zero(nn, M)
        for m in range(n):
            M[<size_t>m * n + m] = 1.0
        share_columns(interface, BELOW, -1.0, below, M)
        copy(nn, M, kept)
        info = factorise(n, M, n, pivots)
        if info != 0:
            return info
        copy(nr, here, right)
        solve(n, r, M, pivots, here, n)
        worst = max(worst, residual_of(n, r, kept, here, n, right))
        copy(nr, light + (<size_t>4 * k + LEAVING) * nr, own)
        share(interface, UP, r, here, own)
        if k > 0:
            copy(nn, below, U + k * nn)
            solve(n, n, M, pivots, U + k * nn, n)
            set_zero(2 * nn, spare)                                     # and through
            share_columns(interface, DOWN, 1.0, U + k * nn, spare)
            set_zero(nn, below)
            for m in range(n):
                through[<size_t>m * n + m] = 1.0
            share(interface, ABOVE, n, through, below)
            share(interface, UP, n, spare, below)
    t.residual[item] = worst
    copy(nr, own, light + LEAVING * nr)
    for k in range(last + 1):
        here = light + <size_t>4 * k * nr
        interface = interface_at(t, k, item)
        if t.kind[k] == CUT:
            if k < last:
                copy(nr, here + LEAVING * nr, here + RISING * nr)
            if k < last or t.base_row[item] < 0:
                for i in range(nr):
                    here[ENTERING * nr + i] += here[ARRIVING * nr + i]
        else:
            set_zero(nr, right)
            share(interface, DOWN, r, here + ARRIVING * nr, right)
            if k < last:
                copy(nr, v + k * nr, here + RISING * nr)
                if k > 0:
                    multiply(n, r, n, 1.0, U + k * nn, right, 1.0, here + RISING * nr)
                share(interface, BELOW, r, here + RISING * nr, right)
            for i in range(nr):
                here[ENTERING * nr + i] += right[i]
        if k == last:
            break
        # through the slab: falling = T entering, up = G falling + g, down = falling + emitted + R up
        m, R = t.size[k], <given>t.slabs[k] + 2 * <size_t>item * t.size[k] * t.size[k]
        T, first = R + <size_t>m * m, n - m
        set_zero(nr, right)
        product(b"N", b"N", m, r, m, 1.0, T, m, here + ENTERING * nr + first, n, 0.0, right + first, n)
        here = here + 4 * nr
        copy(nr, g + k * nr, here + LEAVING * nr)
        if meets[k] and (k > 0 or t.kind[0] != CUT):
            product(b"N", b"N", m, r, m, 1.0, G + k * nn, m, right + first, n, 1.0, here + LEAVING * nr + first, n)
        for i in range(nr):
            here[ARRIVING * nr + i] += right[i]
        product(b"N", b"N", m, r, m, 1.0, R, m, here + LEAVING * nr + first, n, 1.0, here + ARRIVING * nr + first, n)
    return 0
