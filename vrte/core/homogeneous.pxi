# Homogeneous solution, (1:40)-(1:45): s' = -F d, d' = -E s; s = X y, d = Y z, so y' = -z, z' = -lambda y.

cdef extern from "core/symmetric.h":
    ctypedef int vrte_eigenproblem_form(int, double*, double*, double*, double*) noexcept nogil
    ctypedef int vrte_cholesky_form(int, double*) noexcept nogil
    ctypedef void vrte_invert_form(int, const double*, double*) noexcept nogil
    vrte_eigenproblem_form* vrte_eigenproblem_best(bint wide) noexcept nogil
    vrte_cholesky_form* vrte_cholesky_best(bint wide) noexcept nogil
    vrte_invert_form* vrte_invert_best(bint wide) noexcept nogil
    void vrte_compare(int, double, const double*, const double*, double*, double*) noexcept nogil

cdef enum:
    MOST_LOOPED = 96     # rows up to which loops are quicker than LAPACK's blocks


cdef int symmetric_eigenproblem_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    copy(<size_t>t.n * t.n, t.matrix, t.a)
    t.info[0] = vrte_eigenproblem_best(t.wide)(t.n, t.a, t.values, t.vectors, t.spare)
    return t.info[0]


cdef inline Nodes nodes_of(const Arrays* t) noexcept nogil:
    return Nodes(t.n, t.stokes, t.nodes, t.weights)


# (1:40)-(1:44)
cdef int homogeneous_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    cdef int n = t.n, info, i, together, diffusion = -1
    cdef size_t nn = <size_t>n * n
    cdef bint paired = False       # X^-1 = Y^T
    cdef bint growing = False      # a mode that neither decays nor grows: phase matrices with too many terms have one
    cdef double largest = 0.0
    t.conserving = t.conserving and t.orders[0] == 0 and not is_lossy(t, 0)
    if t.clear and t.albedo[0] == 0.0:
        clear_modes(t)
        return 0
    info = modes_by_stokes(t, &paired, &together)
    if info != 0:
        return info
    if not paired:
        copy(nn, t.F, t.f)
        info = factorise(n, t.f, n, t.pivots)
        if info != 0:
            return info
    if t.conserving:
        conserving_axis(nodes_of(t), t.v)
        copy(nn, t.E, t.e)
        reflect_both(nodes_of(t), t.v, t.e, t.spare)
        exact_conservation(nodes_of(t), t.albedo[0], t.v, t.e, t.spare)
        diffusion = polish_smallest(t, together)
    for i in range(n):
        largest = max(largest, fabs(t.lam_re[i]))
    for i in range(n):
        if t.lam_im[i] == 0.0 and t.lam_re[i] < 0.0:
            growing = growing or t.lam_re[i] < -1e-15 * largest      # else rounding below zero
            t.lam_re[i] = 0.0
    if not paired:
        copy(nn, t.X, t.Y)
        solve(n, n, t.f, t.pivots, t.Y, n)
        if diffusion >= 0:
            clear_of_diffusion(t, diffusion)
    t.residual[0] = 1.0 if growing else mode_residual(t)
    if paired:
        t.X_pivots[0] = -1
        return 0
    copy(nn, t.X, t.X_lu)
    return factorise(n, t.X_lu, n, t.X_pivots)


cdef void clear_modes(const Arrays* t) noexcept nogil:
    """A layer that does not scatter: E = F = 1/mu, so X = 1, lambda = 1/mu^2 and Y = mu."""
    cdef int i, n = t.n
    cdef double mu
    set_zero(<size_t>n * n, t.X)
    set_zero(<size_t>n * n, t.Y)
    set_zero(<size_t>n * n, t.X_lu)
    for i in range(n):
        mu = t.nodes[i // t.stokes]
        t.X[<size_t>i * n + i] = t.X_lu[<size_t>i * n + i] = 1.0
        t.Y[<size_t>i * n + i] = mu
        t.lam_re[i] = 1.0 / (mu * mu)
        t.lam_im[i] = 0.0
        t.X_pivots[i] = i + 1      # LAPACK counts from 1


cdef int eigenproblem(int n, doubles a, doubles lam_re, doubles lam_im, doubles X, doubles spare,
                      ints pivots) noexcept nogil:
    """a X = X lambda; destroys a. Neither permutes nor scales: steep nodes have to stay on top, else small eigenvalues
    are known to 1e-16 of the largest only."""
    cdef char no = b"N", yes = b"V"
    cdef int info = 0, lwork = n * n + 8 * n, low, high, one = 1
    cdef double norm, unused = 0.0
    dgeevx(&no, &no, &yes, &no, &n, a, &n, lam_re, lam_im, &unused, &one, X, &n, &low, &high, spare + lwork, &norm,
           &unused, &unused, spare, &lwork, pivots, &info)
    return info


cdef int modes_by_stokes(const Arrays* t, bint* paired, int* together) noexcept nogil:
    """The modes of each set of Stokes parameters that mix, one set after another; `together`: columns of I's set. Y is
    filled where all is one set of symmetric modes and nothing is conserved, which `paired` says.

    Order 0 keeps (I, Q) from (U, V), b2 = 0 keeps V apart, a scalar phase function everything. In one system their
    equal eigenvalues would mix and lose digits.
    """
    cdef int set_of[4]
    cdef int n = t.n, stokes = t.stokes, a, b, i, j, row, info = 0, size, column = 0, old
    cdef size_t at
    for a in range(stokes):
        set_of[a] = a
    for j in range(n if stokes > 1 else 0):
        for i in range(n // stokes):
            for row in range(stokes):
                a, b = set_of[row], set_of[j % stokes]
                at = <size_t>j * n + i * stokes + row
                if a != b and (t.E[at] != 0.0 or t.F[at] != 0.0):
                    old = max(a, b)
                    for size in range(stokes):
                        if set_of[size] == old:
                            set_of[size] = min(a, b)
    for a in range(stokes):
        size = 0
        for b in range(stokes):
            size += set_of[b] == a
        if size > 0 and info == 0:
            info = modes_of_set(t, a, size, set_of, column, paired)
            column += size * (n // stokes)
            if a == 0:
                together[0] = column
    return info


cdef int modes_of_set(const Arrays* t, int which, int members, given_ints set_of, int first,
                      bint* paired) noexcept nogil:
    """The modes of one set: columns of X from the first on, zero in the other rows."""
    cdef int n = t.n, stokes = t.stokes, size = members * (n // stokes), i, j, row, column = 0, info = 1
    cdef size_t square = <size_t>size * size
    cdef bint alone = members == stokes
    cdef doubles e = t.e, f = e + square, a = f + square, lam_re = t.lam_re + first, lam_im = t.lam_im + first
    cdef doubles X = t.X + <size_t>first * n, x = X if alone else a + square
    cdef doubles Y = t.Y if alone and not t.conserving else NULL
    if alone:
        copy(square, t.E, e)
        copy(square, t.F, f)
    for j in range(0 if alone else n):
        if set_of[j % stokes] != which:
            continue
        row = 0
        for i in range(n):
            if set_of[i % stokes] == which:
                e[<size_t>column * size + row] = t.E[<size_t>j * n + i]
                f[<size_t>column * size + row] = t.F[<size_t>j * n + i]
                row += 1
        column += 1
    if t.quick and symmetric(size, e) and symmetric(size, f):
        info = symmetric_modes(size, e, f, lam_re, lam_im, x, Y, a, t.spare, t.pivots)
        paired[0] = info == 0 and Y != NULL
    if info != 0:
        multiply(size, size, size, 1.0, f, e, 0.0, a)
        info = eigenproblem(size, a, lam_re, lam_im, x, t.spare, t.pivots)
    if alone:
        return info
    set_zero(<size_t>size * n, X)
    for j in range(size):
        row = 0
        for i in range(n):
            if set_of[i % stokes] == which:
                X[<size_t>j * n + i] = x[<size_t>j * size + row]
                row += 1
    return info


cdef bint symmetric(int n, given a) noexcept nogil:
    """But for rounding."""
    cdef int i, j
    cdef double gap = 0.0
    for j in range(n):
        for i in range(j):
            gap = fabs(a[<size_t>j * n + i] - a[<size_t>i * n + j])
            if gap * gap > 1e-26 * fabs(a[<size_t>i * n + i] * a[<size_t>j * n + j]):
                return False
    return True


cdef int symmetric_modes(int n, given e, given f, doubles lam_re, doubles lam_im, doubles X, doubles Y, doubles L,
                         doubles spare, ints pivots) noexcept nogil:
    """Modes of symmetric E and F = L L^T: L^T E L W = W lambda, X = L W, Y = F^-1 X = L^-T W unless NULL, so
    X^-1 = Y^T; steep nodes first, where the reduction to tridiagonal form starts. Not 0 where F is not positive; f is
    kept, for a second try."""
    cdef char lower = b"L", yes = b"V"
    cdef int info = 0, lwork = 2 * n * n + 6 * n + 1, liwork = 5 * n + 3
    cdef size_t nn = <size_t>n * n
    cdef doubles other = spare + nn
    copy(nn, f, L)
    if vrte_cholesky_best(True)(n, L) != 0:
        return 1
    multiply(n, n, n, 1.0, e, L, 0.0, other)
    product(b"T", b"N", n, n, n, 1.0, L, n, other, n, 0.0, X, n)
    if n <= MOST_LOOPED:
        info = vrte_eigenproblem_best(True)(n, X, lam_re, spare, other)
    else:
        dsyevd(&yes, &lower, &n, X, &n, lam_re, spare, &lwork, pivots, &liwork, &info)
        copy(nn, X, spare)
    set_zero(n, lam_im)
    multiply(n, n, n, 1.0, L, spare, 0.0, X)
    if Y != NULL:
        vrte_invert_best(True)(n, L, other)
        multiply(n, n, n, 1.0, other, spare, 0.0, Y)
    return info


cdef int polish_smallest(const Arrays* t, int together) noexcept nogil:
    """Which is the diffusion mode, -1 where there is none. Its small lambda is else known only to 1e-16 of the
    largest: at omega = 1 the null vector itself, below by inverse iteration with e, the turned E, whose row and column
    of the flux are exact."""
    cdef int n = t.n, stokes = t.stokes, inner = n - 1, i, j, best = -1, sweep, axis = flux_axis(n, stokes)
    cdef double smallest = 0.05, pivot, top, norm, growth = 1.0
    # lu (n-1, n-1): e without the axis; row (n-1,); column: e''^-1 row, e is symmetric there
    cdef doubles e = t.e, lu = t.a, row = t.spare, column = row + inner, part = column + inner, x
    cdef ints pivots = t.pivots + n
    for j in range(together):     # those that have I
        if t.lam_im[j] == 0.0 and fabs(t.lam_re[j]) < smallest:
            best, smallest = j, fabs(t.lam_re[j])
    if best < 0:
        return best
    x = t.X + <size_t>best * n
    if t.albedo[0] == 1.0:
        for i in range(n):
            x[i] = 0.0 if i % stokes else sqrt(t.weights[i // stokes] * t.nodes[i // stokes])
        t.lam_re[best] = 0.0
        return best
    for j in range(inner):
        skip_flags(n, axis, e + (j if j < axis else j + 1) * n, lu + j * inner)
    if factorise(inner, lu, inner, pivots) != 0:
        return best
    skip_flags(n, axis, e + axis * n, row)
    copy(inner, row, column)
    solve(inner, 1, lu, pivots, column, inner)
    pivot = e[axis * n + axis]
    for i in range(inner):
        pivot -= row[i] * column[i]
    for sweep in range(8):
        solve(n, 1, t.f, t.pivots, x, n)
        turn_columns(nodes_of(t), 1, t.v, x)
        top = x[axis]
        skip_flags(n, axis, x, part)
        solve(inner, 1, lu, pivots, part, inner)
        for i in range(inner):
            top -= row[i] * part[i]
        top /= pivot
        norm = top * top
        for i in range(inner):
            part[i] -= column[i] * top
            norm += part[i] * part[i]
        growth = sqrt(norm)
        for i in range(inner):
            x[i if i < axis else i + 1] = part[i] / growth
        x[axis] = top / growth
        turn_columns(nodes_of(t), 1, t.v, x)
    t.lam_re[best] = 1.0 / growth
    return best


cdef void clear_of_diffusion(const Arrays* t, int diffusion) noexcept nogil:
    """Y^T X is diagonal: what the rounding of the eigenproblem left of the diffusion mode in the others goes. At
    omega = 1 it alone carries flux, which so is conserved to the last digits."""
    cdef int n = t.n, i, j
    cdef given x = t.X + <size_t>diffusion * n, y = t.Y + <size_t>diffusion * n
    cdef double size = 0.0, share
    for i in range(n):
        size += x[i] * y[i]
    for j in range(n):
        if j != diffusion:
            share = 0.0
            for i in range(n):
                share += y[i] * t.X[<size_t>j * n + i]
            share /= size
            for i in range(n):
                t.X[<size_t>j * n + i] -= share * x[i]
                t.Y[<size_t>j * n + i] -= share * y[i]


cdef inline void skip_flags(int n, int axis, given x, doubles out) noexcept nogil:
    """x (n,) without one element."""
    copy(axis, x, out)
    copy((n - 1 - axis), x + axis + 1, out + axis)


cdef double mode_residual(const Arrays* t) noexcept nogil:
    cdef int n = t.n, i, j = 0
    cdef double worst = 0.0, largest = 0.0, re, im
    cdef given X = t.X
    cdef doubles a = t.a, b = t.e
    multiply(n, n, n, 1.0, t.E, X, 0.0, a)
    multiply(n, n, n, 1.0, t.F, a, 0.0, b)
    while j < n:
        re, im = t.lam_re[j], t.lam_im[j]
        if im == 0.0:
            vrte_compare(n, re, X + j * n, b + j * n, &largest, &worst)
            j = j + 1
        else:
            for i in range(n):
                largest = max(largest, fabs(b[j * n + i]))
                worst = max(worst, fabs(b[j * n + i] - re * X[j * n + i] + im * X[(j + 1) * n + i]))
                worst = max(worst, fabs(b[(j + 1) * n + i] - re * X[(j + 1) * n + i] - im * X[j * n + i]))
            j = j + 2
    return worst / largest if largest > 0.0 else 0.0
