// Inverses of a stack of matrices in place, by blocks of columns (Gauss-Jordan), rows exchanged where a pivot is small.

#define PANEL 16
#define STRIPS_OF(n) (((n) + 7) / 8)   // of 8 rows: a part's columns may go on below
#define SMALL_PIVOT 0.25   // of the largest in its column: below, rows are exchanged

// The columns first .. last - 1 eliminated: afterwards they hold those of the matrix that does it to all others.
int eliminate_panel(int n, int first, int last, __global double* M, int ld, __global int* pivots)
{
    for (int k = first; k < last; k++) {
        __global double* now = M + (long)k * ld;
        int best = k;
        double largest = fabs(now[k]);
        const double here = largest;
        for (int i = k + 1; i < n; i++)
            if (fabs(now[i]) > largest) {
                largest = fabs(now[i]);
                best = i;
            }
        if (!(largest > 0.0))
            return 1;
        if (here >= SMALL_PIVOT * largest)
            best = k;
        pivots[k] = best;
        if (best != k)
            for (int j = 0; j < n; j++) {
                const double kept = M[(long)j * ld + k];
                M[(long)j * ld + k] = M[(long)j * ld + best];
                M[(long)j * ld + best] = kept;
            }
        const double inverse = 1.0 / now[k];
        for (int j = first; j < last; j++)
            if (j != k) {
                __global double* other = M + (long)j * ld;
                const double factor = other[k] * inverse;
                other[k] = 0.0;
                for (int i = 0; i < 2 * STRIPS_OF(n); i++)
                    PUT(other, i) = AT(other, i) - factor * AT(now, i);
                other[k] = factor;
            }
        for (int i = 0; i < 2 * STRIPS_OF(n); i++)
            PUT(now, i) = -inverse * AT(now, i);
        now[k] = inverse;
    }
    return 0;
}

// All columns but the panel's: the panel's rows times the panel added, those rows themselves replaced.
void eliminate_rest(int n, int first, int last, __global double* M, int ld, __global double* rest)
{
    const int inner = last - first, columns = n - inner;
    for (int j = 0; j < columns; j++) {
        __global double* column = M + (long)(j < first ? j : j + inner) * ld;
        for (int k = 0; k < inner; k++) {
            rest[(long)j * PANEL + k] = column[first + k];
            column[first + k] = 0.0;
        }
    }
    for (int side = 0; side < 2; side++) {
        const int begin = side ? first : 0, end = side ? columns : first;
        for (int strip = 0; strip < STRIPS_OF(n); strip++)
            for (int j = begin; j < end; j += TILE_COLUMNS) {
                const int columns = end, b_column = PANEL, b_row = 1, a_ld = ld, c_ld = ld;
                const double beta = 1.0;
                __global const double* B = rest;
                __global const double* a = M + (long)first * ld + 8 * strip;
                __global double* C = M + (side ? (long)inner * ld : 0) + 8 * strip;
                EACH_COLUMN(COLUMN_OF_B)
                EACH_COLUMN(NO_SUMS)
                SUM_TERMS
                EACH_COLUMN(ADD_OLD)
                EACH_COLUMN(STORE_SUMS)
            }
    }
}

// M <- M^-1, M (n, n); rest: (n, 16) an item; pivots (n,) an item; info: 0, or 1 where M is singular. Global size: items.
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void invert(int n, __global double* restrict M, long m_first, int ld, long m_stride, __global double* restrict rest,
                     __global int* restrict pivots, __global int* restrict info, __global const int* restrict items)
{
    const long item = items[get_global_id(0)];
    M += m_first + item * m_stride;
    rest += item * (long)n * PANEL;
    pivots += item * n;
    for (int first = 0; first < n; first += PANEL) {
        const int last = min(first + PANEL, n);
        if (eliminate_panel(n, first, last, M, ld, pivots)) {
            info[item] = 1;
            return;
        }
        eliminate_rest(n, first, last, M, ld, rest);
    }
    for (int k = n - 1; k >= 0; k--)
        if (pivots[k] != k)
            for (int i = 0; i < n; i++) {
                const double kept = M[(long)k * ld + i];
                M[(long)k * ld + i] = M[(long)pivots[k] * ld + i];
                M[(long)pivots[k] * ld + i] = kept;
            }
}
