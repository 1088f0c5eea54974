# Matrices stored by columns.

cdef extern from "core/small.h":
    enum:
        VRTE_SIDE       # rows of a triangle that loops of our own take; between triangles there are products
        VRTE_BROAD      # right-hand sides at a time
    ctypedef void vrte_unmix_form(int, int, const double*, size_t, size_t, int, int, double*, int) noexcept nogil
    ctypedef void vrte_unmix_rows_form(int, int, const double*, int, int, double*, int) noexcept nogil
    ctypedef void vrte_add_product_form(int, int, double, const double*, int, const double*, double*) noexcept nogil
    vrte_add_product_form* vrte_add_product_best(bint wide) noexcept nogil
    vrte_unmix_form* vrte_unmix_best(bint wide) noexcept nogil
    vrte_unmix_rows_form* vrte_unmix_rows_best(bint wide) noexcept nogil

cdef enum:
    FEW_COLUMNS = 4     # right-hand sides, from which on turning them over is worth its time


cdef inline void product(char a_form, char b_form, int rows, int columns, int inner, double scale,
                         given a, int lda, given b, int ldb, double add, doubles c, int ldc) noexcept nogil:
    """c = scale op(a) op(b) + add c."""
    cdef int one = 1, i
    if rows <= 0 or columns <= 0:
        return
    if columns == 1 and a_form == b"N" and b_form == b"N":
        if rows * inner > 4096:
            dgemv(&a_form, &rows, &inner, &scale, <doubles>a, &lda, <doubles>b, &one, &add, c, &one)
            return
        for i in range(rows):      # here a call of BLAS would take longer than its work
            c[i] = add * c[i] if add != 0.0 else 0.0
        vrte_add_product_best(True)(rows, inner, scale, a, lda, b, c)
    else:
        dgemm(&a_form, &b_form, &rows, &columns, &inner, &scale, <doubles>a, &lda, <doubles>b, &ldb, &add, c, &ldc)


cdef inline void multiply(int rows, int columns, int inner, double factor, given a, given b, double add,
                          doubles c) noexcept nogil:
    """c (rows, columns) = factor a b + add c."""
    product(b"N", b"N", rows, columns, inner, factor, a, rows, b, inner, add, c, rows)


cdef inline void one_minus_product(int n, given a, given b, doubles c) noexcept nogil:
    """c = 1 - a b."""
    cdef int i
    set_zero(<size_t>n * n, c)
    for i in range(n):
        c[<size_t>i * n + i] = 1.0
    multiply(n, n, n, -1.0, a, b, 1.0, c)


cdef inline void copy(size_t count, given a, doubles b) noexcept nogil:
    memcpy(b, a, sizeof(double) * count)


cdef inline void set_zero(size_t count, doubles a) noexcept nogil:
    memset(a, 0, sizeof(double) * count)


cdef inline int factorise(int n, doubles a, int lda, ints pivots) noexcept nogil:
    cdef int info = 0
    if n > 0:
        dgetrf(&n, &n, a, &lda, pivots, &info)
    return info


cdef inline void solve(int n, int columns, given lu, given_ints pivots, doubles b, int ldb) noexcept nogil:
    """b (n, columns) <- M^-1 b, M given by its factors (n, n)."""
    cdef char form = b"N"
    cdef int info = 0
    if n > 0 and 0 < columns < FEW_COLUMNS:
        dgetrs(&form, &n, &columns, <doubles>lu, &n, <ints>pivots, b, &ldb, &info)
    elif n > 0:
        solve_by_triangles(True, n, columns, lu, pivots, b, ldb)


cdef void solve_by_triangles(bint wide, int n, int columns, given lu, given_ints pivots, doubles b,
                             int ldb) noexcept nogil:
    """The same, block by block of rows: what other blocks mix in by products, the triangles by loops."""
    cdef int blocks = (n + VRTE_SIDE - 1) // VRTE_SIDE, block, i, j, k, width, side, first = 0
    cdef vrte_unmix_rows_form* unmix = vrte_unmix_rows_best(wide)
    cdef doubles x
    while first < columns:
        x, width = b + <size_t>first * ldb, min(VRTE_BROAD, columns - first)
        first += width
        for j in range(width):
            for i in range(n):
                exchange(x + <size_t>j * ldb + i, x + <size_t>j * ldb + pivots[i] - 1)
        for block in range(blocks):
            k = block * VRTE_SIDE
            side = min(VRTE_SIDE, n - k)
            if k > 0:
                product(b"N", b"N", side, width, k, -1.0, lu + k, n, x, ldb, 1.0, x + k, ldb)
            unmix(side, width, lu + <size_t>k * n + k, n, False, x + k, ldb)
        for block in range(blocks - 1, -1, -1):
            k = block * VRTE_SIDE
            side = min(VRTE_SIDE, n - k)
            if k + side < n:
                product(b"N", b"N", side, width, n - k - side, -1.0, lu + <size_t>(k + side) * n + k, n,
                        x + k + side, ldb, 1.0, x + k, ldb)
            unmix(side, width, lu + <size_t>k * n + k, n, True, x + k, ldb)


cdef inline void times_inverse(int n, given lu, given_ints pivots, doubles a) noexcept nogil:
    """a (n, n) <- a M^-1, M given by its factors."""
    times_inverse_by_triangles(True, n, n, lu, pivots, a)


cdef void times_inverse_by_triangles(bint wide, int rows, int n, given lu, given_ints pivots,
                                     doubles a) noexcept nogil:
    """a (rows, n) <- a M^-1, block by block of columns."""
    cdef int blocks = (n + VRTE_SIDE - 1) // VRTE_SIDE, block, i, k, side
    cdef vrte_unmix_form* unmix = vrte_unmix_best(wide)
    cdef doubles x
    for block in range(blocks):
        k = block * VRTE_SIDE
        side, x = min(VRTE_SIDE, n - k), a + <size_t>k * rows
        if k > 0:
            product(b"N", b"N", rows, side, k, -1.0, a, rows, lu + <size_t>k * n, n, 1.0, x, rows)
        unmix(rows, side, lu + <size_t>k * n + k, 1, n, True, False, x, rows)
    for block in range(blocks - 1, -1, -1):
        k = block * VRTE_SIDE
        side, x = min(VRTE_SIDE, n - k), a + <size_t>k * rows
        if k + side < n:
            product(b"N", b"N", rows, side, n - k - side, -1.0, x + <size_t>side * rows, rows,
                    lu + <size_t>k * n + k + side, n, 1.0, x, rows)
        unmix(rows, side, lu + <size_t>k * n + k, 1, n, False, True, x, rows)
    for k in range(n - 1, -1, -1):
        for i in range(rows if pivots[k] != k + 1 else 0):
            exchange(a + <size_t>k * rows + i, a + <size_t>(pivots[k] - 1) * rows + i)


cdef inline void exchange(doubles a, doubles b) noexcept nogil:
    cdef double kept = a[0]
    a[0] = b[0]
    b[0] = kept


cdef int solve_by_factors_one(Arrays* t, int item, Workspace desk) noexcept nogil:
    copy(<size_t>t.n_column * t.n_row, t.b, t.found)
    if t.from_right:
        times_inverse_by_triangles(t.wide, t.n_row, t.n, t.lu, t.pivots, t.found)
    else:
        solve_by_triangles(t.wide, t.n, t.n_column, t.lu, t.pivots, t.found, t.n_row)
    return 0


cdef inline void scale_columns(int n, int rows, given lam_im, const cplx* f, given a, doubles b) noexcept nogil:
    """b = a f: the columns of mode j, each row (Re, Im) of a pair, times f[j]."""
    cdef int i, j = 0
    cdef double fr, fi, x, y
    while j < n:
        fr, fi = f[j].real, f[j].imag
        if lam_im[j] == 0.0:
            for i in range(rows):
                b[j * rows + i] = fr * a[j * rows + i]
            j = j + 1
        else:
            for i in range(rows):
                x, y = a[j * rows + i], a[(j + 1) * rows + i]
                b[j * rows + i] = x * fr - y * fi
                b[(j + 1) * rows + i] = x * fi + y * fr
            j = j + 2


cdef inline void scale_coordinates(int n, given lam_im, const cplx* f, given y, doubles out) noexcept nogil:
    """out = f y on the coordinates of one right-hand side."""
    cdef int j = 0
    cdef double a, b
    while j < n:
        a = y[j]
        if lam_im[j] == 0.0:
            out[j] = f[j].real * a
            j = j + 1
        else:
            b = y[j + 1]
            out[j] = f[j].real * a + f[j].imag * b
            out[j + 1] = f[j].real * b - f[j].imag * a
            j = j + 2


cdef inline double largest_of(size_t n, given a) noexcept nogil:
    cdef size_t i
    cdef double largest = 0.0
    for i in range(n):
        largest = max(largest, fabs(a[i]))
    return largest
