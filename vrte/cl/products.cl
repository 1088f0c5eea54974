// Products of stacks of matrices.

// One strip of 8 rows of C, 6 columns at a time: 12 vectors of sums stay in registers.
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

// C = alpha A B + beta C for the strips first .. last - 1 of 8 rows: what a tile takes of B is at hand for all of them.
void product_of_strips(int first, int last, int columns, int inner, real alpha, real beta, __global const real* A,
                       int a_ld, __global const real* B, int b_row, int b_column, __global real* whole, int c_ld)
{
    for (int j = 0; j < columns; j += TILE_COLUMNS) {
        EACH_COLUMN(COLUMN_OF_B)
        for (int strip = first; strip < last; strip++) {
            __global const real* a = A + 8 * strip;
            __global real* C = whole + 8 * strip;
            EACH_COLUMN(NO_SUMS)
            SUM_TERMS
            EACH_COLUMN(SCALE_SUMS)
            if (beta != 0.0) {
                EACH_COLUMN(ADD_OLD)
            }
            EACH_COLUMN(STORE_SUMS)
        }
    }
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

// C = alpha A B + beta C; A (rows, inner), B's element (k, j) at k b_row + j b_column (so that either factor may be a
// transpose), C (rows, columns), rows with their padding. Where part is not -1, the sum is over A's columns and B's rows
// of that part.
#define PRODUCT int rows, int each, int columns, int all, real alpha, real beta, int part, INTS counts, ALONE(A), \
    IN B, long B_first, int b_row, int b_column, long B_stride, ALONE(C), INTS items
#define FACTORS \
    const long item = items[get_global_id(2)]; \
    const int inner = part < 0 ? all : number_of_columns(counts, item, part); \
    const int begin_column = part < 0 ? 0 : first_column(counts, item, part), a_ld = A_ld, c_ld = C_ld; \
    A = OF_ITEM(A) + (long)begin_column * a_ld; \
    B = OF_ITEM(B) + (long)begin_column * b_row; \
    C = OF_ITEM(C);

// Global size: pieces of `each` strips of 8 rows, 1, items.
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void product(PRODUCT)
{
    FACTORS
    const int first = each * get_global_id(0);
    product_of_strips(first, min(rows / 8, first + each), columns, inner, alpha, beta, A, a_ld, B, b_row, b_column, C, c_ld);
}

// As a GPU wants it: a work-group makes a tile of C, both factors pass through local memory, each work-item keeps the sums
// of several elements in registers.

#define GPU_GROUP 16                        // work-items along each side of a tile
#define GPU_EACH 4                          // elements of a work-item along each side: every 16th
#define GPU_TILE (GPU_GROUP * GPU_EACH)
#define GPU_DEPTH 16                        // of the sum at a time: columns of A, rows of B

#define GPU_PLACES \
    const int row = get_local_id(0), column = get_local_id(1), here = row + GPU_GROUP * column; \
    const int top = GPU_TILE * get_group_id(0), left = GPU_TILE * get_group_id(1);

#define GPU_A(k, i) A[(long)(k) * a_ld + (i)]   // column k, row i of A; other kernels have it made of something else

// sum = the work-item's elements of A B; neighbours in the work-group read neighbours in memory: rows of A, and of B
// whichever index has the step 1.
#define GPU_SUM_TERMS \
    real sum[GPU_EACH][GPU_EACH]; \
    for (int y = 0; y < GPU_EACH; y++) \
        for (int x = 0; x < GPU_EACH; x++) \
            sum[y][x] = 0.0; \
    for (int begin = 0; begin < inner; begin += GPU_DEPTH) { \
        for (int at = here; at < GPU_DEPTH * GPU_TILE; at += GPU_GROUP * GPU_GROUP) { \
            const int k = at / GPU_TILE, i = at % GPU_TILE; \
            a_tile[k][i] = begin + k < inner && top + i < rows ? GPU_A(begin + k, top + i) : 0.0; \
        } \
        for (int at = here; at < GPU_DEPTH * GPU_TILE; at += GPU_GROUP * GPU_GROUP) { \
            const int k = b_row == 1 ? at % GPU_DEPTH : at / GPU_TILE, j = b_row == 1 ? at / GPU_DEPTH : at % GPU_TILE; \
            b_tile[k][j] = begin + k < inner && left + j < columns \
                               ? B[(long)(begin + k) * b_row + (long)(left + j) * b_column] : 0.0; \
        } \
        barrier(CLK_LOCAL_MEM_FENCE); \
        for (int k = 0; k < GPU_DEPTH; k++) { \
            real a[GPU_EACH], b[GPU_EACH]; \
            for (int x = 0; x < GPU_EACH; x++) { \
                a[x] = a_tile[k][row + GPU_GROUP * x]; \
                b[x] = b_tile[k][column + GPU_GROUP * x]; \
            } \
            for (int y = 0; y < GPU_EACH; y++) \
                for (int x = 0; x < GPU_EACH; x++) \
                    sum[y][x] = a[x] * b[y] + sum[y][x]; \
        } \
        barrier(CLK_LOCAL_MEM_FENCE); \
    }

// For the work-item's elements i, j of C that there are: value is their sum.
#define GPU_EACH_ELEMENT(DO) \
    for (int y = 0; y < GPU_EACH; y++) \
        for (int x = 0; x < GPU_EACH; x++) { \
            const int i = top + row + GPU_GROUP * x, j = left + column + GPU_GROUP * y; \
            const real value = sum[y][x]; \
            if (i < rows && j < columns) { \
                DO \
            } \
        }

#define GPU_STORE \
    __global real* now = C + (long)j * c_ld + i; \
    *now = beta == 0.0 ? alpha * value : alpha * value + beta * *now;

#define GPU_PRODUCT \
    __local real a_tile[GPU_DEPTH][GPU_TILE], b_tile[GPU_DEPTH][GPU_TILE + 1]; \
    FACTORS \
    GPU_PLACES \
    GPU_SUM_TERMS \
    GPU_EACH_ELEMENT(GPU_STORE)

// Pieces of all three: tiles of the rows, tiles of the columns, items.
__attribute__((reqd_work_group_size(GPU_GROUP, GPU_GROUP, 1)))
__kernel void product_gpu(PRODUCT)
{
    GPU_PRODUCT
}

// The same by tiles of 40 and of 32, for sizes that tiles of 64 pad too much.
#undef GPU_GROUP
#undef GPU_EACH
#define GPU_GROUP 8
#define GPU_EACH 5
__attribute__((reqd_work_group_size(GPU_GROUP, GPU_GROUP, 1)))
__kernel void product_gpu_40(PRODUCT)
{
    GPU_PRODUCT
}

#undef GPU_EACH
#define GPU_EACH 4
__attribute__((reqd_work_group_size(GPU_GROUP, GPU_GROUP, 1)))
__kernel void product_gpu_32(PRODUCT)
{
    GPU_PRODUCT
}
#undef GPU_GROUP
#define GPU_GROUP 16
