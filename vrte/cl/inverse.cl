// Inverses of a stack of matrices in place, by blocks of columns (Gauss-Jordan), rows exchanged where a pivot is small.

#define PANEL 16
#define STRIPS_OF(n) (((n) + 7) / 8)   // of 8 rows: a part's columns may go on below
#define SMALL_PIVOT 0.25   // of the largest in its column: below, rows are exchanged

// The columns first .. last - 1 eliminated: afterwards they hold those of the matrix that does it to all others.
int eliminate_panel(int n, int first, int last, __global real* M, int ld, __global int* pivots)
{
    for (int k = first; k < last; k++) {
        __global real* now = M + (long)k * ld;
        int best = k;
        real largest = fabs(now[k]);
        const real here = largest;
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
                const real kept = M[(long)j * ld + k];
                M[(long)j * ld + k] = M[(long)j * ld + best];
                M[(long)j * ld + best] = kept;
            }
        const real inverse = 1.0 / now[k];
        for (int j = first; j < last; j++)
            if (j != k) {
                __global real* other = M + (long)j * ld;
                const real factor = other[k] * inverse;
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
void eliminate_rest(int n, int first, int last, __global real* M, int ld, __global real* rest)
{
    const int inner = last - first, columns = n - inner;
    for (int j = 0; j < columns; j++) {
        __global real* column = M + (long)(j < first ? j : j + inner) * ld;
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
                const real beta = 1.0;
                __global const real* B = rest;
                __global const real* a = M + (long)first * ld + 8 * strip;
                __global real* C = M + (side ? (long)inner * ld : 0) + 8 * strip;
                EACH_COLUMN(COLUMN_OF_B)
                EACH_COLUMN(NO_SUMS)
                SUM_TERMS
                EACH_COLUMN(ADD_OLD)
                EACH_COLUMN(STORE_SUMS)
            }
    }
}

void invert_alone(int n, __global real* M, int ld, __global real* rest, __global int* pivots, __global int* info)
{
    for (int first = 0; first < n; first += PANEL) {
        const int last = min(first + PANEL, n);
        if (eliminate_panel(n, first, last, M, ld, pivots)) {
            *info = 1;
            return;
        }
        eliminate_rest(n, first, last, M, ld, rest);
    }
    for (int k = n - 1; k >= 0; k--)
        if (pivots[k] != k)
            for (int i = 0; i < n; i++) {
                const real kept = M[(long)k * ld + i];
                M[(long)k * ld + i] = M[(long)pivots[k] * ld + i];
                M[(long)pivots[k] * ld + i] = kept;
            }
}

// M <- M^-1, M (n, n); rest: (n, 16) an item; pivots (n,) an item; info: 0, or 1 where M is singular. Global size: items.
#define INVERSE int n, STACK(M), OUT rest, __global int* restrict pivots, __global int* restrict info, INTS items
#define OF_MATRIX(place) \
    const long item = items[place]; \
    const int ld = M_ld; \
    M = OF_ITEM(M); \
    rest += item * (long)n * PANEL; \
    pivots += item * n;

__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void invert(INVERSE)
{
    OF_MATRIX(get_global_id(0))
    invert_alone(n, M, ld, rest, pivots, info + item);
}

// As a GPU wants it: a work-group a matrix, the panel (n, width) in local memory. The same steps, but for singular matrices,
// which are gone through to the end: every work-item meets every barrier. Global size: 256 a matrix.

void invert_by_crew(int me, int n, __global real* M, int ld, __global real* rest, __global int* pivots, __global int* info,
                    int width, __local real* panel, __local real* row_k, __local real* largest, __local int* place)
{
    for (int first = 0; first < n; first += width) {
        const int inner = min(width, n - first), columns = n - inner;
        for (int at = me; at < inner * n; at += GPU_CREW)
            panel[at] = M[(long)(first + at / n) * ld + at % n];
        barrier(CLK_LOCAL_MEM_FENCE);

        for (int c = 0; c < inner; c++) {  // the panel's columns eliminated
            const int k = first + c;
            real most = 0.0;
            int best = k;
            for (int i = k + me; i < n; i += GPU_CREW)
                if (fabs(panel[c * n + i]) > most) {
                    most = fabs(panel[c * n + i]);
                    best = i;
                }
            largest[me] = most;
            place[me] = best;
            barrier(CLK_LOCAL_MEM_FENCE);
            for (int apart = GPU_CREW / 2; apart > 0; apart /= 2) {
                if (me < apart && largest[me + apart] > largest[me]) {
                    largest[me] = largest[me + apart];
                    place[me] = place[me + apart];
                }
                barrier(CLK_LOCAL_MEM_FENCE);
            }
            if (me == 0) {
                if (!(largest[0] > 0.0))
                    *info = 1;
                if (fabs(panel[c * n + k]) >= SMALL_PIVOT * largest[0])
                    place[0] = k;
                pivots[k] = place[0];
            }
            barrier(CLK_LOCAL_MEM_FENCE);
            if (me < inner) {  // rows exchanged, row k kept beside
                const real old = panel[me * n + k];
                row_k[me] = panel[me * n + place[0]];
                panel[me * n + place[0]] = old;
            }
            barrier(CLK_LOCAL_MEM_FENCE);
            for (int i = me; i < n; i += GPU_CREW) {
                const real inverse = 1.0 / row_k[c], now = panel[c * n + i];
                for (int j = 0; j < inner; j++) {
                    const real factor = row_k[j] * inverse;
                    if (j != c)
                        panel[j * n + i] = i == k ? factor : panel[j * n + i] - factor * now;
                }
                panel[c * n + i] = i == k ? inverse : -inverse * now;
            }
            barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);
        }

        for (int at = me; at < inner * n; at += GPU_CREW)
            M[(long)(first + at / n) * ld + at % n] = panel[at];
        for (int j = me; j < columns; j += GPU_CREW) {  // all other columns: rows exchanged, the panel's taken out
            __global real* column = M + (long)(j < first ? j : j + inner) * ld;
            for (int k = first; k < first + inner; k++) {
                const real kept = column[k];
                column[k] = column[pivots[k]];
                column[pivots[k]] = kept;
            }
            for (int k = 0; k < inner; k++) {
                rest[(long)j * PANEL + k] = column[first + k];
                column[first + k] = 0.0;
            }
        }
        barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);

        // four columns of a row at a time: each element of the panel is read once for the four
        for (int at = me; at < (columns + 3) / 4 * n; at += GPU_CREW) {
            const int i = at % n, begin = at / n * 4;
            real sum[4] = {0.0, 0.0, 0.0, 0.0};
            for (int k = 0; k < inner; k++)
                for (int x = 0; x < 4; x++)
                    sum[x] += panel[k * n + i] * rest[(long)min(begin + x, columns - 1) * PANEL + k];
            for (int x = 0; x < 4; x++) {
                const int j = begin + x;
                if (j < columns)
                    M[(long)(j < first ? j : j + inner) * ld + i] += sum[x];
            }
        }
        barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);
    }
    for (int i = me; i < n; i += GPU_CREW)  // a work-item its rows: columns exchanged back
        for (int k = n - 1; k >= 0; k--) {
            const int other = pivots[k];
            const real kept = M[(long)k * ld + i];
            M[(long)k * ld + i] = M[(long)other * ld + i];
            M[(long)other * ld + i] = kept;
        }
}

__attribute__((reqd_work_group_size(GPU_CREW, 1, 1)))
__kernel void invert_gpu(INVERSE, int width, __local real* panel)
{
    __local real row_k[PANEL], largest[GPU_CREW];
    __local int place[GPU_CREW];
    OF_MATRIX(get_group_id(0))
    invert_by_crew(get_local_id(0), n, M, ld, rest, pivots, info + item, width, panel, row_k, largest, place);
}
