# Matrices stored by columns.

cdef inline void product(char a_form, char b_form, int rows, int columns, int inner, double scale,
                         given a, int lda, given b, int ldb, double add, doubles c, int ldc) noexcept nogil:
    """c = scale op(a) op(b) + add c."""
    cdef int one = 1, i, k
    cdef double factor
    if rows <= 0 or columns <= 0:
        return
    if columns == 1 and a_form == b"N" and b_form == b"N":
        if rows * inner > 4096:
            dgemv(&a_form, &rows, &inner, &scale, <doubles>a, &lda, <doubles>b, &one, &add, c, &one)
            return
        for i in range(rows):      # here a call of BLAS would take longer than its work
            c[i] = add * c[i] if add != 0.0 else 0.0
        for k in range(inner):
            factor = scale * b[k]
            for i in range(rows):
                c[i] += factor * a[<size_t>k * lda + i]
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


cdef inline void solve(char form, int n, int columns, given lu, int lda, given_ints pivots,
                       doubles b, int ldb) noexcept nogil:
    cdef int info = 0
    if n > 0 and columns > 0:
        dgetrs(&form, &n, &columns, <doubles>lu, &lda, <ints>pivots, b, &ldb, &info)


cdef inline void transpose(int n, given a, doubles b) noexcept nogil:
    cdef int i, j
    for j in range(n):
        for i in range(n):
            b[j * n + i] = a[i * n + j]


cdef inline void times_inverse(int n, given lu, const int* pivots, doubles a, doubles spare) noexcept nogil:
    """a <- a M^-1, M given by its factors."""
    transpose(n, a, spare)
    solve(b"T", n, n, lu, n, pivots, spare, n)
    transpose(n, spare, a)


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
