// Products of stacks of matrices.

// One strip of 8 rows of C, 6 columns at a time: 12 vectors of sums stay in registers.
#define TILE_COLUMNS 6
#define EACH_COLUMN(DO) DO(0) DO(1) DO(2) DO(3) DO(4) DO(5)
#define COLUMN_OF_B(x) __global const double* b##x = B + (long)min(j + x, columns - 1) * b_column;
#define NO_SUMS(x) double4 top##x = (double4)(0.0), low##x = (double4)(0.0);
#define ADD_TERM(x) { const double4 value = (double4)(b##x[(long)k * b_row]); \
    top##x = a_top * value + top##x; low##x = a_low * value + low##x; }
#define SCALE_SUMS(x) top##x *= alpha; low##x *= alpha;
#define ADD_OLD(x) if (j + x < columns) { __global const double* old = C + (long)(j + x) * c_ld; \
    top##x = beta * AT(old, 0) + top##x; low##x = beta * AT(old, 1) + low##x; }
#define STORE_SUMS(x) if (j + x < columns) { __global double* now = C + (long)(j + x) * c_ld; \
    PUT(now, 0) = top##x; PUT(now, 1) = low##x; }
#define SUM_TERMS \
    for (int k = 0; k < inner; k++) { \
        const double4 a_top = AT(a, 0), a_low = AT(a, 1); \
        EACH_COLUMN(ADD_TERM) \
        a += a_ld; \
    }

// C = alpha A B + beta C; A (rows, inner), B's element (k, j) at k b_row + j b_column (so that either factor may be a
// transpose), C (rows, columns). Global size: strips of 8 rows, 1, items.
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void product(int columns, int inner, double alpha, double beta, __global const double* restrict A, long a_first,
                      int a_ld, long a_stride, __global const double* restrict B, long b_first, int b_row, int b_column,
                      long b_stride, __global double* restrict C, long c_first, int c_ld, long c_stride,
                      __global const int* restrict items)
{
    const long item = items[get_global_id(2)];
    A += a_first + item * a_stride + 8 * get_global_id(0);
    B += b_first + item * b_stride;
    C += c_first + item * c_stride + 8 * get_global_id(0);
    for (int j = 0; j < columns; j += TILE_COLUMNS) {
        __global const double* a = A;
        EACH_COLUMN(COLUMN_OF_B)
        EACH_COLUMN(NO_SUMS)
        SUM_TERMS
        EACH_COLUMN(SCALE_SUMS)
        if (beta != 0.0) {
            EACH_COLUMN(ADD_OLD)
        }
        EACH_COLUMN(STORE_SUMS)
    }
}
