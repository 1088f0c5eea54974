// Products of stacks of matrices.

// A tile of a product: 8 rows, 6 columns, whose 12 vectors of sums stay in registers.
#define TILE_COLUMNS 6
#define EACH_COLUMN(DO) DO(0) DO(1) DO(2) DO(3) DO(4) DO(5)
#define COLUMN_OF_B(x) __global const real* b##x = B + (long)min(j + x, columns - 1) * b_column;
#define NO_SUMS(x) real4 top##x = (real4)(0.0), low##x = (real4)(0.0);
#define ADD_TERM(x) { const real4 value = (real4)(b##x[(long)k * b_row]); \
    top##x = a_top * value + top##x; low##x = a_low * value + low##x; }
#define SCALE_SUMS(x) top##x *= alpha; low##x *= alpha;
#define ADD_OLD(x) if (j + x < columns) { __global const real* old = C + (long)(j + x) * c_ld; \
    top##x = beta * AT(old, 0) + top##x; low##x = beta * AT(old, 1) + low##x; }
#define STORE_SUMS(x) if (j + x < columns) { __global real* now = C + (long)(j + x) * c_ld; \
    PUT(now, 0) = top##x; PUT(now, 1) = low##x; }
#define SUM_TERMS \
    for (int k = 0; k < inner; k++) { \
        const real4 a_top = AT(a, 0), a_low = AT(a, 1); \
        EACH_COLUMN(ADD_TERM) \
        a += a_ld; \
    }

// C = alpha A B + beta C in a tile: 8 rows, where a and C point to, and the columns from j on.
void product_of_tile(int j, int columns, int inner, real alpha, real beta, __global const real* a, int a_ld,
                     __global const real* B, int b_row, int b_column, __global real* C, int c_ld)
{
    EACH_COLUMN(COLUMN_OF_B)
    EACH_COLUMN(NO_SUMS)
    SUM_TERMS
    EACH_COLUMN(SCALE_SUMS)
    if (beta != 0.0) {
        EACH_COLUMN(ADD_OLD)
    }
    EACH_COLUMN(STORE_SUMS)
}

// The columns of E (part 0), of F (1) or of both (2), counts (item, 2) of them: the first, and how many.
int first_column(__global const int* counts, long item, int part)
{
    return part == 1 ? counts[2 * item] : 0;
}

int number_of_columns(__global const int* counts, long item, int part)
{
    return part == 2 ? counts[2 * item] + counts[2 * item + 1] : counts[2 * item + part];
}

// C = alpha A B + beta C. Pieces: `each` strips of 8 rows, `wide` columns, items; a lane makes tiles.
KERNEL(LANES, product)
{
    const long item = get_group_id(2);
    const int all = part < 0 ? inner : number_of_columns(counts, item, part);
    const int begin = part < 0 ? 0 : first_column(counts, item, part);
    const int b_row = transposed ? B_ld : 1, b_column = transposed ? 1 : B_ld;
    const int first = each * get_group_id(0), strips = min(each, padded / 8 - first);
    const int left = wide * get_group_id(1), tiles = (min(wide, n_column - left) + TILE_COLUMNS - 1) / TILE_COLUMNS;
    A = OF_ITEM(A) + (long)begin * A_ld;
    B = OF_ITEM(B) + (long)begin * b_row;
    C = OF_ITEM(C);
    SPREAD(tile, 0, strips * tiles) {
        const int row = 8 * (first + tile % strips), j = left + tile / strips * TILE_COLUMNS;
        product_of_tile(j, n_column, all, alpha, beta, A + row, A_ld, B, b_row, b_column, C + row, C_ld);
    }
}
