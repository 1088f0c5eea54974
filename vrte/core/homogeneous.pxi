# Homogeneous solution, (1:40)-(1:45): s' = -F d, d' = -E s; s = X y, d = Y z, so y' = -z, z' = -lambda y.

def homogeneous_work(n):
    """Doubles of `work` that one thread of `homogeneous` needs (its LAPACK block included)."""
    return 5 * n * n + 50 * n + 8


cdef struct Homogeneous:
    int n, n_layer, stokes
    bint conserving, quick, clear
    given_ints orders
    given albedo, directions, weights, E, F
    doubles lam_re, lam_im, X, Y, X_lu
    ints X_pivots
    doubles residual


def homogeneous(crew, *, const int[::1] orders, bint conserving, bint quick, bint clear, const double[::1] albedo,
                const double[::1] directions, const double[::1] weights, const double[:, :, :, ::1] E,
                const double[:, :, :, ::1] F, double[:, :, ::1] lam_re, double[:, :, ::1] lam_im,
                double[:, :, :, ::1] X, double[:, :, :, ::1] Y, double[:, :, :, ::1] X_lu, int[:, :, ::1] X_pivots,
                double[:, ::1] residual, int[:, ::1] info):
    """The modes F E X = X lambda, (1:43), and Y = F^-1 X, (1:44), without a division by lambda.

    conserving: whether order 0 has I, so that its flux is conserved; quick: whether symmetric E and F go to the
    symmetric eigensolver, which is several times faster and loses a digit; clear: whether layers without scattering go
    without an eigenproblem. E, F, X, Y, X_lu (order, layer, n, n); lam_re, lam_im (order, layer, n), unit 1/optical
    depth squared, complex pairs adjacent, the positive imaginary part first; X_lu and X_pivots factorise X, or X_pivots
    starts with -1, X_lu is not filled and X^-1 = Y^T (symmetric modes); residual (order, layer): the largest of
    |F E X - X lambda| over that of |F E X|, 1 where lambda < 0: a mode that swings instead of fading, which only a phase
    matrix with more terms than the nodes carry has.
    """
    cdef int n_layer = <int>albedo.shape[0], n = <int>X.shape[3]
    cdef Homogeneous task = Homogeneous(
        n, n_layer, n // <int>weights.shape[0], conserving, quick, clear, &orders[0], &albedo[0], &directions[0],
        &weights[0], &E[0, 0, 0, 0], &F[0, 0, 0, 0], &lam_re[0, 0, 0], &lam_im[0, 0, 0], &X[0, 0, 0, 0], &Y[0, 0, 0, 0],
        &X_lu[0, 0, 0, 0], &X_pivots[0, 0, 0], &residual[0, 0])
    run_items(crew, modes_of_layer, &task, <int>orders.shape[0] * n_layer, homogeneous_work(n), 6 * n + 8, &info[0, 0])


cdef int modes_of_layer(const void* task, int item, Desk desk) noexcept nogil:
    cdef const Homogeneous* h = <const Homogeneous*>task
    cdef size_t n = h.n, at = item * n, nn = item * n * n
    cdef double albedo = h.albedo[item % h.n_layer]
    if h.clear and albedo == 0.0:
        clear_modes(h.n, h.stokes, h.directions, h.lam_re + at, h.lam_im + at, h.X + nn, h.Y + nn, h.X_lu + nn,
                    h.X_pivots + at)
        return 0
    return homogeneous_one(
        h.n, h.stokes, h.conserving and h.orders[item // h.n_layer] == 0, h.quick, albedo, h.directions, h.weights,
        h.E + nn, h.F + nn, h.lam_re + at, h.lam_im + at, h.X + nn, h.Y + nn, h.X_lu + nn, h.X_pivots + at,
        h.residual + item, desk.work, desk.pivots)


cdef void clear_modes(int n, int stokes, given directions, doubles lam_re, doubles lam_im, doubles X, doubles Y,
                      doubles X_lu, ints X_pivots) noexcept nogil:
    """A layer that does not scatter: E = F = 1/mu, so X = 1, lambda = 1/mu^2 and Y = mu."""
    cdef int i
    cdef size_t size = sizeof(double) * <size_t>n * n
    memset(X, 0, size)
    memset(Y, 0, size)
    memset(X_lu, 0, size)
    for i in range(n):
        X[<size_t>i * n + i] = X_lu[<size_t>i * n + i] = 1.0
        Y[<size_t>i * n + i] = directions[i // stokes]
        lam_re[i] = 1.0 / (directions[i // stokes] * directions[i // stokes])
        lam_im[i] = 0.0
        X_pivots[i] = i + 1      # LAPACK counts from 1


# (1:40)-(1:44)
cdef int homogeneous_one(int n, int stokes, bint conserving, bint quick, double albedo, given directions, given weights, given E,
                         given F, doubles lam_re, doubles lam_im, doubles X, doubles Y, doubles X_lu,
                         ints X_pivots, doubles residual, doubles work, ints pivots) noexcept nogil:
    cdef doubles e = work
    cdef doubles f = e + n * n
    cdef doubles a = f + n * n
    cdef doubles v = a + n * n
    cdef doubles spare = v + n
    cdef int info, i, together
    cdef bint paired = False       # X^-1 = Y^T
    cdef bint growing = False      # a mode that neither fades nor grows: only a phase matrix with too many terms has one
    cdef double largest
    info = modes_by_stokes(n, stokes, quick, E, F, lam_re, lam_im, X, NULL if conserving else Y, &paired, work,
                           spare, pivots, &together)
    if info != 0:
        return info
    if not paired:
        memcpy(f, F, sizeof(double) * n * n)
        info = factorise(n, f, n, pivots)
        if info != 0:
            return info
    if conserving:
        conserving_axis(n, stokes, directions, weights, v)
        memcpy(e, E, sizeof(double) * n * n)
        reflect_both(n, stokes, v, e, spare)
        exact_conservation(n, stokes, albedo, directions, weights, v, e, spare)
        polish_smallest(n, stokes, together, albedo, directions, weights, v, e, f, pivots, lam_re, lam_im, X, a, spare,
                        pivots + n)
    largest = 0.0
    for i in range(n):
        largest = max(largest, fabs(lam_re[i]))
    for i in range(n):
        if lam_im[i] == 0.0 and lam_re[i] < 0.0:
            growing = growing or lam_re[i] < -1e-15 * largest      # else rounding below zero
            lam_re[i] = 0.0
    if not paired:
        memcpy(Y, X, sizeof(double) * n * n)
        solve(b"N", n, n, f, n, pivots, Y, n)
    residual[0] = 1.0 if growing else mode_residual(n, E, F, lam_re, lam_im, X, a, e)
    if paired:
        X_pivots[0] = -1
        return 0
    memcpy(X_lu, X, sizeof(double) * n * n)
    return factorise(n, X_lu, n, X_pivots)


cdef int eigenproblem(int n, doubles a, doubles lam_re, doubles lam_im, doubles X, doubles spare, ints pivots) noexcept nogil:
    """a X = X lambda; destroys a. Neither permutes nor scales: steep nodes have to stay on top, else small eigenvalues are
    known to 1e-16 of the largest only."""
    cdef char no = b"N", yes = b"V"
    cdef int info = 0, lwork = n * n + 8 * n, low, high, one = 1
    cdef double norm, unused = 0.0
    dgeevx(&no, &no, &yes, &no, &n, a, &n, lam_re, lam_im, &unused, &one, X, &n, &low, &high, spare + lwork, &norm,
           &unused, &unused, spare, &lwork, pivots, &info)
    return info


cdef int modes_by_stokes(int n, int stokes, bint quick, given E, given F, doubles lam_re, doubles lam_im, doubles X, doubles Y,
                         bint* paired, doubles room, doubles spare, ints pivots, ints together) noexcept nogil:
    """The modes of each set of Stokes parameters that mix, one set after another; `together`: columns of I's set. Y, unless
    NULL, is filled where all is one set of symmetric modes, which `paired` says.

    Order 0 keeps (I, Q) from (U, V), b2 = 0 keeps V apart, a scalar phase function everything. In one system their
    equal eigenvalues would mix and lose digits.
    """
    cdef int set_of[4]
    cdef int a, b, i, j, row, info = 0, size, column = 0, old
    cdef size_t at
    for a in range(stokes):
        set_of[a] = a
    for j in range(n if stokes > 1 else 0):
        for i in range(n // stokes):
            for row in range(stokes):
                a, b = set_of[row], set_of[j % stokes]
                at = <size_t>j * n + i * stokes + row
                if a != b and (E[at] != 0.0 or F[at] != 0.0):
                    old = max(a, b)
                    for size in range(stokes):
                        if set_of[size] == old:
                            set_of[size] = min(a, b)
    for a in range(stokes):
        size = 0
        for b in range(stokes):
            size += set_of[b] == a
        if size > 0 and info == 0:
            info = modes_of_set(n, stokes, quick, a, size, set_of, E, F, lam_re + column, lam_im + column, X + <size_t>column * n, Y,
                                paired, room, spare, pivots)
            column += size * (n // stokes)
            if a == 0:
                together[0] = column
    return info


cdef int modes_of_set(int n, int stokes, bint quick, int which, int members, given_ints set_of, given E, given F,
                      doubles lam_re, doubles lam_im, doubles X, doubles Y, bint* paired, doubles room, doubles spare,
                      ints pivots) noexcept nogil:
    """The modes of one set: columns of X, zero in the other rows."""
    cdef int h = members * (n // stokes), i, j, row, column, info
    cdef size_t hh = <size_t>h * h
    cdef doubles e = room
    cdef doubles f = e + hh
    cdef doubles a = f + hh
    cdef doubles x = X if members == stokes else a + hh
    column = 0
    if members == stokes:
        memcpy(e, E, sizeof(double) * hh)
        memcpy(f, F, sizeof(double) * hh)
    for j in range(n if members < stokes else 0):
        if set_of[j % stokes] != which:
            continue
        row = 0
        for i in range(n):
            if set_of[i % stokes] == which:
                e[<size_t>column * h + row] = E[<size_t>j * n + i]
                f[<size_t>column * h + row] = F[<size_t>j * n + i]
                row += 1
        column += 1
    info = 1
    if quick and symmetric(h, e) and symmetric(h, f):
        info = symmetric_modes(h, e, f, lam_re, lam_im, x, Y if members == stokes else NULL, a, spare, pivots)
        paired[0] = info == 0 and members == stokes and Y != NULL
    if info != 0:
        product(b"N", b"N", h, h, h, 1.0, f, h, e, h, 0.0, a, h)
        info = eigenproblem(h, a, lam_re, lam_im, x, spare, pivots)
    if members == stokes:
        return info
    memset(X, 0, sizeof(double) * <size_t>h * n)
    for j in range(h):
        row = 0
        for i in range(n):
            if set_of[i % stokes] == which:
                X[<size_t>j * n + i] = x[<size_t>j * h + row]
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


cdef int symmetric_modes(int n, given e, given f, doubles lam_re, doubles lam_im, doubles X, doubles Y,
                         doubles a, doubles spare, ints pivots) noexcept nogil:
    """Modes of symmetric E and F = L L^T: L^T E L W = W lambda, X = L W, Y = F^-1 X = L^-T W unless NULL, so X^-1 = Y^T;
    steep nodes first, where the reduction to tridiagonal form starts. Not 0 where F is not positive; f is kept, for a
    second try."""
    cdef char side = b"L", lower = b"L", yes = b"V", no = b"N", transposed = b"T", right = b"R"
    cdef int info = 0, lwork = 2 * n * n + 6 * n + 1, liwork = 5 * n + 3
    cdef double one = 1.0
    cdef doubles L = a
    memcpy(L, f, sizeof(double) * <size_t>n * n)
    dpotrf(&lower, &n, L, &n, &info)
    if info != 0:
        return info
    memcpy(X, e, sizeof(double) * <size_t>n * n)
    dtrmm(&right, &lower, &no, &no, &n, &n, &one, L, &n, X, &n)
    dtrmm(&side, &lower, &transposed, &no, &n, &n, &one, L, &n, X, &n)
    dsyevd(&yes, &lower, &n, X, &n, lam_re, spare, &lwork, pivots, &liwork, &info)
    memset(lam_im, 0, sizeof(double) * n)
    if info == 0:
        if Y != NULL:
            memcpy(Y, X, sizeof(double) * <size_t>n * n)
            dtrsm(&side, &lower, &transposed, &no, &n, &n, &one, L, &n, Y, &n)
        dtrmm(&side, &lower, &no, &no, &n, &n, &one, L, &n, X, &n)
    return info


cdef void polish_smallest(int n, int stokes, int together, double albedo, given directions, given weights, given v,
                          given e, given f_lu, given_ints f_pivots, doubles lam_re, doubles lam_im,
                          doubles X, doubles work, doubles spare, ints pivots) noexcept nogil:
    """The diffusion mode, whose small lambda is else known only to 1e-16 of the largest: at omega = 1 the null vector
    itself, below by inverse iteration with e, the turned E, whose row and column of the flux are exact."""
    cdef int inner = n - 1, i, j, best = -1, sweep, axis = flux_axis(n, stokes)
    cdef double smallest = 0.05, pivot, top, norm, growth = 1.0
    cdef doubles lu = work                       # (n-1, n-1), e without the axis
    cdef doubles row = spare                     # (n-1,)
    cdef doubles column = row + inner            # e''^-1 row, e is symmetric there
    cdef doubles part = column + inner
    cdef doubles x
    for j in range(together):     # those that have I
        if lam_im[j] == 0.0 and fabs(lam_re[j]) < smallest:
            best, smallest = j, fabs(lam_re[j])
    if best < 0:
        return
    x = X + best * n
    if albedo == 1.0:
        for i in range(n):
            x[i] = 0.0 if i % stokes else sqrt(weights[i // stokes] * directions[i // stokes])
        lam_re[best] = 0.0
        return
    for j in range(inner):
        leave_out(n, axis, e + (j if j < axis else j + 1) * n, lu + j * inner)
    if factorise(inner, lu, inner, pivots) != 0:
        return
    leave_out(n, axis, e + axis * n, row)
    memcpy(column, row, sizeof(double) * inner)
    solve(b"N", inner, 1, lu, inner, pivots, column, inner)
    pivot = e[axis * n + axis]
    for i in range(inner):
        pivot -= row[i] * column[i]
    for sweep in range(8):
        solve(b"N", n, 1, f_lu, n, f_pivots, x, n)
        turn_columns(n, stokes, 1, v, x)
        top = x[axis]
        leave_out(n, axis, x, part)
        solve(b"N", inner, 1, lu, inner, pivots, part, inner)
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
        turn_columns(n, stokes, 1, v, x)
    lam_re[best] = 1.0 / growth


cdef inline void leave_out(int n, int axis, given x, doubles out) noexcept nogil:
    """x (n,) without one element."""
    memcpy(out, x, sizeof(double) * axis)
    memcpy(out + axis, x + axis + 1, sizeof(double) * (n - 1 - axis))


cdef double mode_residual(int n, given e, given f, given lam_re, given lam_im,
                          given X, doubles a, doubles b) noexcept nogil:
    cdef int i, j = 0
    cdef double worst = 0.0, largest = 0.0, re, im
    product(b"N", b"N", n, n, n, 1.0, e, n, X, n, 0.0, a, n)
    product(b"N", b"N", n, n, n, 1.0, f, n, a, n, 0.0, b, n)
    while j < n:
        re, im = lam_re[j], lam_im[j]
        if im == 0.0:
            for i in range(n):
                largest = max(largest, fabs(b[j * n + i]))
                worst = max(worst, fabs(b[j * n + i] - re * X[j * n + i]))
            j = j + 1
        else:
            for i in range(n):
                largest = max(largest, fabs(b[j * n + i]))
                worst = max(worst, fabs(b[j * n + i] - re * X[j * n + i] + im * X[(j + 1) * n + i]))
                worst = max(worst, fabs(b[(j + 1) * n + i] - re * X[(j + 1) * n + i] - im * X[j * n + i]))
            j = j + 2
    return worst / largest if largest > 0.0 else 0.0
