// Inverses of a stack of matrices in place, by blocks of columns (Gauss-Jordan), rows exchanged where a pivot is small.

#define PANEL 16
#define QUADS_OF(n) (2 * (((n) + 7) / 8))   // of 4 rows, in whole strips: a part's columns may go on below
#define SMALL_PIVOT 0.25   // of the largest in its column: below, rows are exchanged

// What the lanes of a work-group share.
typedef struct {
    __local real* size;     // of each lane
    __local int* place;     // of each lane
    __local real* row;      // of a panel's columns
} Shelves;

// The row of the pivot among a column's rows k .. n - 1, k itself where that is not small; -1 where there is none.
int find_pivot(int k, int n, __global const real* column, Shelves shelves)
{
    const real here = fabs(column[k]);
    real largest = 0.0;
    int best = k;
    SPREAD(i, k, n)
        if (fabs(column[i]) > largest) {
            largest = fabs(column[i]);
            best = i;
        }
#if LANES > 1
    shelves.size[LANE] = largest;
    shelves.place[LANE] = best;
    for (int apart = LANES / 2; apart > 0; apart /= 2) {
        TOGETHER
        if (LANE < apart && shelves.size[LANE + apart] > shelves.size[LANE]) {
            shelves.size[LANE] = shelves.size[LANE + apart];
            shelves.place[LANE] = shelves.place[LANE + apart];
        }
    }
    TOGETHER
    largest = shelves.size[0];
    best = shelves.place[0];
#endif
    if (!(largest > 0.0) || here != here)
        return -1;
    return here >= SMALL_PIVOT * largest ? k : best;
}

// The columns first .. last - 1 eliminated: afterwards they hold those of the matrix that does it to all others.
int eliminate_panel(int n, int first, int last, __global real* M, int ld, __global int* pivots, Shelves shelves)
{
    for (int k = first; k < last; k++) {
        __global real* now = M + (long)k * ld;
        const int best = find_pivot(k, n, now, shelves);
        if (best < 0)
            return 1;
        if (LANE == 0)
            pivots[k] = best;
        TOGETHER
        if (best != k)
            SPREAD(j, 0, n) {
                const real kept = M[(long)j * ld + k];
                M[(long)j * ld + k] = M[(long)j * ld + best];
                M[(long)j * ld + best] = kept;
            }
        TOGETHER
        const real inverse = 1.0 / now[k];
        SPREAD(j, first, last)
            shelves.row[j - first] = M[(long)j * ld + k] * inverse;
        TOGETHER
        for (int j = first; j < last; j++)
            if (j != k) {
                __global real* other = M + (long)j * ld;
                const real factor = shelves.row[j - first];
                SPREAD(i, 0, QUADS_OF(n)) {
                    PUT(other, i) = AT(other, i) - factor * AT(now, i);
                    if (i == k / 4)
                        other[k] = factor;
                }
            }
        TOGETHER
        SPREAD(i, 0, QUADS_OF(n)) {
            PUT(now, i) = -inverse * AT(now, i);
            if (i == k / 4)
                now[k] = inverse;
        }
        TOGETHER
    }
    return 0;
}

// All columns but the panel's: the panel's rows times the panel added, those rows themselves replaced.
void eliminate_rest(int n, int first, int last, __global real* M, int ld, __global real* rest)
{
    const int inner = last - first, columns = n - inner, strips = QUADS_OF(n) / 2;
    SPREAD(j, 0, columns) {
        __global real* column = M + (long)(j < first ? j : j + inner) * ld;
        for (int k = 0; k < inner; k++) {
            rest[(long)j * PANEL + k] = column[first + k];
            column[first + k] = 0.0;
        }
    }
    TOGETHER
    for (int side = 0; side < 2; side++) {
        const int begin = side ? first : 0, end = side ? columns : first;
        const int tiles = (end - begin + TILE_COLUMNS - 1) / TILE_COLUMNS;
        SPREAD(tile, 0, strips * tiles) {
            const int row = 8 * (tile / tiles), j = begin + tile % tiles * TILE_COLUMNS;
            product_of_tile(j, end, inner, 1.0, 1.0, M + (long)first * ld + row, ld, rest, 1, PANEL,
                            M + (side ? (long)inner * ld : 0) + row, ld);
        }
    }
    TOGETHER
}

// M <- M^-1, M (n, n); rest (n, 16), pivots (n,): scratch memory. 1 where M is singular.
int invert_matrix(int n, __global real* M, int ld, __global real* rest, __global int* pivots, Shelves shelves)
{
    for (int first = 0; first < n; first += PANEL) {
        const int last = min(first + PANEL, n);
        if (eliminate_panel(n, first, last, M, ld, pivots, shelves))
            return 1;
        eliminate_rest(n, first, last, M, ld, rest);
    }
    for (int k = n - 1; k >= 0; k--)
        if (pivots[k] != k)
            SPREAD(i, 0, n) {
                const real kept = M[(long)k * ld + i];
                M[(long)k * ld + i] = M[(long)pivots[k] * ld + i];
                M[(long)pivots[k] * ld + i] = kept;
            }
    TOGETHER
    return 0;
}

// The same of a stack. Pieces: items.
KERNEL(LANES, invert)
{
    __local real size[LANES], row[PANEL];
    __local int place[LANES];
    const Shelves shelves = {size, place, row};
    const long item = get_group_id(0);
    const int singular = invert_matrix(n, OF_ITEM(M), M_ld, rest + item * (long)n * PANEL, pivots + item * n, shelves);
    if (LANE == 0)
        info[item] = singular;
}
