// `product_over_columns` as a GPU wants it: see `product_gpu`.

// Rows: of A and C, their padding included. Global size: 16 work-items a tile of 64 rows, 16 a tile of 64 columns, items.
__attribute__((reqd_work_group_size(GPU_GROUP, GPU_GROUP, 1)))
__kernel void product_over_columns_gpu(int rows, int columns, int part, double alpha, double beta,
                                       __global const int* restrict counts, __global const double* restrict A, long a_first,
                                       int a_ld, long a_stride, __global const double* restrict B, long b_first, int b_row,
                                       long b_stride, __global double* restrict C, long c_first, int c_ld, long c_stride,
                                       __global const int* restrict items)
{
    __local double a_tile[GPU_DEPTH][GPU_TILE], b_tile[GPU_DEPTH][GPU_TILE + 1];
    const long item = items[get_global_id(2)];
    const int inner = number_of_columns(counts, item, part), begin_column = first_column(counts, item, part), b_column = 1;
    A += a_first + item * a_stride + (long)begin_column * a_ld;
    B += b_first + item * b_stride + (long)begin_column * b_row;
    C += c_first + item * c_stride;
    GPU_PLACES
    GPU_SUM_TERMS
    GPU_EACH_ELEMENT(GPU_STORE)
}
