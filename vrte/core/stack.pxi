# Slabs and interfaces of several media, added from the base up. A medium knows the last of all nodes, the more the
# denser it is; slabs have no more rows than that. Elements are counted from the top: interfaces even, slabs odd.

cdef enum: RISING, ARRIVING, LEAVING, ENTERING     # ways of light at an interface: up below, down above, up above, down
cdef enum: CUT, SMOOTH, ROUGH                      # kinds of interfaces


cdef Element element_at(const Arrays* t, int number, int item) noexcept nogil:
    """One that is no mere cut."""
    cdef int k = number // 2, n = t.n
    cdef size_t m = t.slab_size[k] if number % 2 else n
    cdef given a
    if number % 2:
        a = t.pieces + t.slab_at[k] + 2 * item * m * m
        return slab_element(<int>m, a, a + m * m)
    if t.kind[k] == SMOOTH:
        m = t.stokes
        a = t.smooth + 4 * <size_t>t.which[k] * n * m
    else:
        a = t.rough + 4 * (<size_t>t.which[k] * t.n_order + item) * n * n
    return Element(n, <int>m, a, a + n * m, a + 2 * n * m, a + 3 * n * m)


cdef inline doubles light_at(const Arrays* t, int k, int way) noexcept nogil:
    return t.light + (<size_t>k * 4 + way) * t.n * t.n_rhs


# (2:8), (2:10)-(2:11)
cdef int join_media_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    cdef int n = t.n, r = t.n_rhs, last = t.n_place, e, k, info
    cdef size_t nn = <size_t>n * n, nr = <size_t>n * r, i
    cdef doubles G = t.G, g = t.g, own = t.own, falling
    cdef Stack s = stack_at(n, r, t.memory, t.pivots, True)
    cdef Element one
    cdef bint has_base = t.base_row[0] >= 0, is_slab
    cdef int first = t.kind[0] == CUT                  # the uppermost element: above it nothing is looked at
    if has_base:
        resize(&s, t.n_low)
        copy(<size_t>t.n_low * t.n_low, t.base + <size_t>t.base_row[0] * t.n_low * t.n_low, s.below)
        s.dark = False
        resize(&s, n)
    if t.kind[last] != CUT:
        one = element_at(t, 2 * last, item)
        reflect_more(&s, &one)
    copy(nr, light_at(t, last, LEAVING), own)
    for e in range(2 * last - 1, -1, -1):
        k, is_slab = e // 2, e % 2 == 1
        if desk.stop[0]:
            return 0
        if not is_slab and t.kind[k] == CUT:
            continue
        one = element_at(t, e, item)
        info = add(&s, &one, light_at(t, k + is_slab, ARRIVING if is_slab else ENTERING), own,
                   light_at(t, k, RISING if is_slab else LEAVING), own, G + e * nn if e > first else NULL,
                   g + e * nr)
        if info != 0:
            return info
    t.residual[0] = s.missing
    copy(nr, own, light_at(t, 0, LEAVING))
    for e in range(2 * last + 1):
        k, is_slab = e // 2, e % 2 == 1
        falling = light_at(t, k, ENTERING if is_slab else ARRIVING)
        if is_slab or t.kind[k] != CUT:
            one = element_at(t, e, item)
        if e == 2 * last:                              # nothing lies below
            if t.kind[k] != CUT:
                share(&one, one.down, r, falling, n, light_at(t, k, ENTERING), n)
            for i in range(nr if t.kind[k] == CUT and not has_base else 0):
                light_at(t, k, ENTERING)[i] += falling[i]
        elif is_slab or t.kind[k] != CUT:
            go_down(n, r, &one, falling, G + e * nn if e > first else NULL, g + e * nr,
                    light_at(t, k + is_slab, LEAVING if is_slab else RISING),
                    light_at(t, k + is_slab, ARRIVING if is_slab else ENTERING), t.right)
        else:
            copy(nr, light_at(t, k, LEAVING), light_at(t, k, RISING))
            for i in range(nr):
                light_at(t, k, ENTERING)[i] += falling[i]
    return 0
