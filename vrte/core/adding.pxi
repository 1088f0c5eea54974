# The star product, (2:8): an element, a slab or an interface, put upon what lies below it, from the base up; then the
# light on the nodes from the top down, (2:10)-(2:11). Stacks of one medium and of several, of modes and of doubled
# slabs are all added here.

cdef struct Element:
    # what reflects light on either side and transmits it down and up, on m nodes; block 0: matrices by columns, else
    # block x block, rows first, one behind the other. NULL: no reflection, or a transmission that nobody asks for
    int m, block
    given above, below, down, up


cdef struct Flux:
    # order 0, whose row of 1 - below R is small where nothing absorbs: what a slab loses of it, what all below absorbs
    int axis
    given lost
    doubles absorbed, row       # (n,), (2 n,)


cdef struct Stack:
    # what lies below: `below` (width, width) reflects on the last of n nodes, or is dark; M, kept, spare (n, n), right
    # (n, r): scratch memory. missing: the largest relative residual of its systems so far, where `checked`
    int n, r, width
    bint dark, checked
    doubles below, M, kept, spare, right
    ints pivots
    Flux* flux
    double missing


cdef inline size_t stack_doubles(size_t n, size_t r) noexcept nogil:
    return 4 * n * n + n * r


cdef inline Stack stack_at(int n, int r, doubles memory, ints pivots, bint checked) noexcept nogil:
    """Black ground, on which nothing lies yet."""
    cdef size_t nn = <size_t>n * n
    set_zero(nn, memory)
    return Stack(n, r, n, True, checked, memory, memory + nn, memory + 2 * nn, memory + 3 * nn, memory + 4 * nn, pivots,
                 NULL, 0.0)


cdef inline Element slab_element(int m, given R, given T) noexcept nogil:
    return Element(m, 0, R, R, T, T)


cdef void share(const Element* e, given matrix, int columns, given field, int ldf, doubles out, int ldo) noexcept nogil:
    """out += a matrix of an element times light (m, columns)."""
    cdef int m = e.m, s = e.block, i, j, a, b
    if matrix == NULL:
        return
    if s == 0 or s > 4:
        product(b"N" if s == 0 else b"T", b"N", m, columns, m, 1.0, matrix, m, field, ldf, 1.0, out, ldo)
        return
    for j in range(columns):
        for i in range(m):
            a = i - i % s
            for b in range(s):
                out[<size_t>j * ldo + i] += matrix[<size_t>i * s + b] * field[<size_t>j * ldf + a + b]


cdef void share_columns(const Element* e, given matrix, double factor, given field, doubles out) noexcept nogil:
    """out += factor times a matrix (m, m) times one of an element."""
    cdef int m = e.m, s = e.block, i, j, a, b
    cdef double value
    if matrix == NULL:
        return
    if s == 0 or s > 4:
        product(b"N", b"N" if s == 0 else b"T", m, m, m, factor, field, m, matrix, m, 1.0, out, m)
        return
    for j in range(m):
        a = j - j % s
        for b in range(s):
            value = factor * matrix[<size_t>j * s + b]
            for i in range(m if value != 0.0 else 0):
                out[<size_t>(a + b) * m + i] += value * field[<size_t>j * m + i]


cdef void resize(Stack* s, int m) noexcept nogil:
    """`below` on the last m nodes: what no light meets is zero."""
    cdef int j, old = s.width, kept = min(old, m)
    s.width = m
    if old == m:
        return
    copy(<size_t>old * old, s.below, s.spare)
    set_zero(<size_t>m * m, s.below)
    for j in range(kept):
        copy(kept, s.spare + <size_t>(old - kept + j) * old + old - kept,
             s.below + <size_t>(m - kept + j) * m + m - kept)


cdef inline void set_identity(int n, doubles a) noexcept nogil:
    cdef int i
    set_zero(<size_t>n * n, a)
    for i in range(n):
        a[<size_t>i * n + i] = 1.0


cdef void reflect_more(Stack* s, const Element* e) noexcept nogil:
    """below += what an element reflects on its upper side."""
    if e.above != NULL:
        set_identity(e.m, s.M)
        share(e, e.above, e.m, s.M, e.m, s.below, e.m)
        s.dark = False


# (2:8)
cdef int add(Stack* s, const Element* e, given arriving, given up, given source, doubles out, doubles G,
             doubles g) noexcept nogil:
    """Puts an element on what lies below: g = (1 - below R)^-1 (up + below arriving) comes up to it where nothing falls
    in and `arriving` sets out below it, out = source + T g leaves it; unless G is NULL, since nothing lies above, G =
    (1 - below R)^-1 below and below <- R + T G T. up, source and out (n, r) may be one."""
    cdef int n = s.n, r = s.r, m = e.m, first = n - m, info
    cdef size_t nr = <size_t>n * r, mm = <size_t>m * m
    cdef bint meets
    resize(s, m)
    meets = not s.dark and e.below != NULL
    copy(nr, up, g)
    if arriving != NULL and not s.dark:
        product(b"N", b"N", m, r, m, 1.0, s.below, m, arriving + first, n, 1.0, g + first, n)
    if G != NULL:
        copy(mm, s.below, G)
    if meets:
        set_identity(m, s.M)
        share_columns(e, e.below, -1.0, s.below, s.M)
        if s.flux != NULL:
            sum_flux(s, e, G, g)
        if s.checked:
            copy(mm, s.M, s.kept)
            copy(nr, g, s.right)
        info = factorise(m, s.M, m, s.pivots)
        if info != 0:
            return info
        solve(m, r, s.M, s.pivots, g + first, n)
        if s.checked:
            s.missing = max(s.missing, residual_of(m, r, s.kept, g + first, n, s.right + first))
        if G != NULL:
            solve(m, m, s.M, s.pivots, G, m)
    if source != out:
        copy(nr, source, out)
    share(e, e.up, r, g + first, n, out + first, n)
    if G == NULL:
        return 0
    set_zero(mm, s.spare)
    if not s.dark:
        share_columns(e, e.down, 1.0, G, s.spare)
    if s.flux != NULL:
        absorb(s, e)
    set_zero(mm, s.below)
    if not s.dark:
        share(e, e.up, m, s.spare, m, s.below, m)
    reflect_more(s, e)
    return 0


cdef double residual_of(int m, int r, given matrix, given found, int ld, doubles right) noexcept nogil:
    """What is left of right-hand sides (m, r), relative; both with columns `ld` apart."""
    cdef double largest = 0.0, left = 0.0
    cdef int j
    for j in range(r):
        largest = max(largest, largest_of(m, right + <size_t>j * ld))
    product(b"N", b"N", m, r, m, -1.0, matrix, m, found, ld, 1.0, right, ld)
    for j in range(r):
        left = max(left, largest_of(m, right + <size_t>j * ld))
    return left / largest if largest > NO_LIGHT else 0.0


cdef void sum_flux(Stack* s, const Element* e, doubles G, doubles g) noexcept nogil:
    """The flux's row of 1 - below R without a difference: lost + T's row + absorbed R, of which nothing is small; it is
    scaled, with those of G and g."""
    cdef Flux* f = s.flux
    cdef int n = e.m, i
    cdef double largest
    multiply(1, n, n, 1.0, f.absorbed, e.below, 0.0, f.row)
    for i in range(n):
        f.row[i] += f.lost[i] + e.down[<size_t>i * n + f.axis]
    largest = largest_of(n, f.row)
    if largest > 0.0:
        for i in range(n):
            s.M[<size_t>i * n + f.axis] = f.row[i] / largest
            if G != NULL:
                G[<size_t>i * n + f.axis] /= largest
        for i in range(s.r):
            g[<size_t>i * n + f.axis] /= largest


cdef void absorb(Stack* s, const Element* e) noexcept nogil:
    """absorbed <- lost + (lost G + absorbed (1 + R G)) T, where `spare` is G T."""
    cdef Flux* f = s.flux
    cdef int n = e.m, i
    cdef doubles more = f.row + n
    multiply(1, n, n, 1.0, f.absorbed, e.below, 0.0, f.row)
    for i in range(n):
        f.row[i] += f.lost[i]
    copy(n, f.lost, more)
    multiply(1, n, n, 1.0, f.row, s.spare, 1.0, more)
    multiply(1, n, n, 1.0, f.absorbed, e.down, 1.0, more)
    copy(n, more, f.absorbed)


# (2:10)-(2:11)
cdef void go_down(int n, int r, const Element* e, given falling, given G, given g, doubles up, doubles down,
                  doubles right) noexcept nogil:
    """Light below an element of light that falls on it: up = G T falling + g, down += T falling + R up; G may be NULL;
    right (n, r): scratch memory."""
    cdef int m = e.m, first = n - m
    cdef size_t nr = <size_t>n * r, i
    set_zero(nr, right)
    share(e, e.down, r, falling + first, n, right + first, n)
    copy(nr, g, up)
    if G != NULL:
        product(b"N", b"N", m, r, m, 1.0, G, m, right + first, n, 1.0, up + first, n)
    share(e, e.below, r, up + first, n, right + first, n)
    for i in range(nr):
        down[i] += right[i]
