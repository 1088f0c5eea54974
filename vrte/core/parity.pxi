# The columns of P_l^m that E and F of (1:41) have by parity, (1:10)-(1:11), and products with B_l.

cdef struct Parity:
    # which columns of P_l^m a set of Stokes parameters has, [l - m even or odd as asked][left, right], and where its
    # parameters lie inside a node (-1: not of the set)
    int has[2][2]
    int place[4]
    int stokes


cdef Parity parity_of(int m, int stokes, given_ints members) noexcept nogil:
    """From P_l^m the left column is I, or Q and U where the parity is the other; the right one Q and U, or V."""
    cdef Parity p
    cdef int i
    cdef bint turns = m > 0          # t_l^0 = 0
    p.stokes = stokes
    for i in range(4):
        p.place[i] = -1
    for i in range(stokes):
        p.place[members[i]] = i
    p.has[0][0] = p.place[0] >= 0
    p.has[0][1] = p.place[1] >= 0 or (turns and p.place[2] >= 0)
    p.has[1][0] = p.place[2] >= 0 or (turns and p.place[1] >= 0)
    p.has[1][1] = p.place[3] >= 0
    return p


cdef struct Expansion:
    # one order of the phase matrix of a material, times its albedo
    Parity p
    int m, terms
    double albedo
    given coefficients


cdef inline bint is_polar(Parity p) noexcept nogil:
    """Whether Q or U is of the set: else r and t of P_l^m play no part."""
    return p.place[1] >= 0 or p.place[2] >= 0


cdef inline int columns_of(const Expansion* x, int even_kind) noexcept nogil:
    """Columns of all degrees m .. terms - 1."""
    cdef int same = (x.terms - x.m + 1) // 2, other = (x.terms - x.m) // 2    # l - m even, odd
    cdef Parity p = x.p
    if even_kind != 0:
        same, other = other, same
    return max(0, same) * (p.has[0][0] + p.has[0][1]) + max(0, other) * (p.has[1][0] + p.has[1][1])


# (1:10)-(1:11)
cdef void parity_columns(const Expansion* x, int even_kind, given prt, int n_all, int first, int n_mu, given scale,
                         doubles out) noexcept nogil:
    """out, S n_mu rows by `columns_of`: from P_l^m its columns I, Q where l - m has the parity of `even_kind`, else
    U, V (the rest of (1:41) cancels), those that the set has; rows times scale."""
    cdef Parity p = x.p
    cdef int l, i, kind, m = x.m, rows = p.stokes * n_mu
    cdef size_t column = 0
    cdef doubles left
    cdef doubles right
    cdef given value
    cdef double f
    if p.stokes == 1 and p.place[0] >= 0:      # I alone has every other degree
        for l in range(m if even_kind == 0 else m + 1, x.terms, 2):
            value = prt + <size_t>3 * l * n_all + first
            for i in range(n_mu):
                out[i] = scale[i] * value[i] if scale != NULL else value[i]
            out += n_mu
        return
    set_zero(<size_t>rows * columns_of(x, even_kind), out)
    for l in range(m, x.terms):
        kind = (l - m) % 2 != even_kind
        left = out + <size_t>rows * column
        right = left + <size_t>rows * p.has[kind][0]
        column += p.has[kind][0] + p.has[kind][1]
        for i in range(n_mu):
            value = prt + <size_t>3 * l * n_all + first + i      # p, r, t
            f = scale[i] if scale != NULL else 1.0
            if kind == 0:
                if p.place[0] >= 0:
                    left[p.stokes * i + p.place[0]] = f * value[0]
                if p.place[1] >= 0:
                    right[p.stokes * i + p.place[1]] = f * value[n_all]
                if p.place[2] >= 0 and p.has[0][1]:
                    right[p.stokes * i + p.place[2]] = -f * value[2 * n_all]
            else:
                if p.place[1] >= 0 and p.has[1][0]:
                    left[p.stokes * i + p.place[1]] = -f * value[2 * n_all]
                if p.place[2] >= 0:
                    left[p.stokes * i + p.place[2]] = f * value[n_all]
                if p.place[3] >= 0:
                    right[p.stokes * i + p.place[3]] = f * value[0]


cdef void times_coefficients(const Expansion* a, int even_kind, double v_sign, int rows, given phi,
                             doubles out) noexcept nogil:
    """out = albedo phi B^T, column by column: B_l of (1:9) cut to the kept columns; V's column of phi counts v_sign
    times."""
    cdef Parity p = a.p
    cdef double factor = a.albedo
    cdef int l, i, kind, m = a.m
    cdef size_t column = 0
    cdef double b00, b01, b10, b11
    cdef given c
    cdef given x
    cdef doubles y
    for l in range(m, a.terms):
        c = a.coefficients + 6 * l
        kind = (l - m) % 2 != even_kind
        if kind == 0:
            b00, b01, b10, b11 = c[0], -c[4], -c[4], c[1]
        else:
            b00, b01, b10, b11 = c[2], -v_sign * c[5], c[5], v_sign * c[3]
        x = phi + <size_t>rows * column
        y = out + <size_t>rows * column
        column += p.has[kind][0] + p.has[kind][1]
        if p.has[kind][0] and p.has[kind][1]:
            for i in range(rows):
                y[i] = factor * (b00 * x[i] + b01 * x[rows + i])
                y[rows + i] = factor * (b10 * x[i] + b11 * x[rows + i])
        elif p.has[kind][0] or p.has[kind][1]:
            b00 = factor * (b00 if p.has[kind][0] else b11)
            for i in range(rows):
                y[i] = b00 * x[i]
