// Products of stacks of matrices as a GPU wants them: a work-group makes a tile of C, both factors pass through local
// memory, each work-item keeps the sums of several elements in registers.

#define GPU_GROUP 16                        // work-items along each side of a tile
#define GPU_EACH 4                          // elements of a work-item along each side: every 16th
#define GPU_TILE (GPU_GROUP * GPU_EACH)
#define GPU_DEPTH 16                        // of the sum at a time: columns of A, rows of B


#define GPU_PLACES \
    const int row = get_local_id(0), column = get_local_id(1), here = row + GPU_GROUP * column; \
    const int top = GPU_TILE * get_group_id(0), left = GPU_TILE * get_group_id(1);

// sum = the work-item's elements of A B; neighbours in the work-group read neighbours in memory: rows of A, and of B
// whichever index has the step 1.
#define GPU_SUM_TERMS \
    double sum[GPU_EACH][GPU_EACH]; \
    for (int y = 0; y < GPU_EACH; y++) \
        for (int x = 0; x < GPU_EACH; x++) \
            sum[y][x] = 0.0; \
    for (int begin = 0; begin < inner; begin += GPU_DEPTH) { \
        for (int at = here; at < GPU_DEPTH * GPU_TILE; at += GPU_GROUP * GPU_GROUP) { \
            const int k = at / GPU_TILE, i = at % GPU_TILE; \
            a_tile[k][i] = begin + k < inner && top + i < rows ? A[(long)(begin + k) * a_ld + top + i] : 0.0; \
        } \
        for (int at = here; at < GPU_DEPTH * GPU_TILE; at += GPU_GROUP * GPU_GROUP) { \
            const int k = b_row == 1 ? at % GPU_DEPTH : at / GPU_TILE, j = b_row == 1 ? at / GPU_DEPTH : at % GPU_TILE; \
            b_tile[k][j] = begin + k < inner && left + j < columns \
                               ? B[(long)(begin + k) * b_row + (long)(left + j) * b_column] : 0.0; \
        } \
        barrier(CLK_LOCAL_MEM_FENCE); \
        for (int k = 0; k < GPU_DEPTH; k++) { \
            double a[GPU_EACH], b[GPU_EACH]; \
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
            const double value = sum[y][x]; \
            if (i < rows && j < columns) { \
                DO \
            } \
        }

#define GPU_STORE \
    __global double* now = C + (long)j * c_ld + i; \
    *now = beta == 0.0 ? alpha * value : alpha * value + beta * *now;

// C = alpha A B + beta C, arguments as those of `product` and the rows of A and C, their padding included. Global size:
// 16 work-items a tile of 64 rows, 16 a tile of 64 columns, items.
__attribute__((reqd_work_group_size(GPU_GROUP, GPU_GROUP, 1)))
__kernel void product_gpu(int rows, int columns, int inner, double alpha, double beta, __global const double* restrict A,
                          long a_first, int a_ld, long a_stride, __global const double* restrict B, long b_first, int b_row,
                          int b_column, long b_stride, __global double* restrict C, long c_first, int c_ld, long c_stride,
                          __global const int* restrict items)
{
    __local double a_tile[GPU_DEPTH][GPU_TILE], b_tile[GPU_DEPTH][GPU_TILE + 1];
    const long item = items[get_global_id(2)];
    A += a_first + item * a_stride;
    B += b_first + item * b_stride;
    C += c_first + item * c_stride;
    GPU_PLACES
    GPU_SUM_TERMS
    GPU_EACH_ELEMENT(GPU_STORE)
}
