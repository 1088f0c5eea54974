// The steps of `invariance.cl` as a GPU wants them: a work-group makes a tile of a product. Matrices are stored column by
// column, R and the last steps too.

#define RUNNING 0
#define SETTLED 1   // in this step: H is made once more
#define LEFT 2

#define GPU_LANES (GPU_GROUP * GPU_GROUP)

// What a step of a work-item's element adds to the sums.
#define GPU_SHARE \
    const double cosine = signed_mu[j], size = fabs(cosine), mu = fabs(row_mu[i]); \
    const long k = (long)j * ld + i; \
    const double now = value * (0.5 * cosine * mu / (mu + size)), change = now - R[k]; \
    led[k] = now; \
    moved[k] = change; \
    mine[0] += change * change; \
    mine[1] += change * moved_1[k]; \
    mine[2] += change * moved_2[k]; \
    mine[3] = LARGER(mine[3], fabs(change)); \
    mine[4] = LARGER(mine[4], fabs(now));

// As `step_of_strip`, of a tile; found (item, tile, 5). Global size: 16 work-items a tile of 64 rows, 16 a tile of 64
// columns, items.
__attribute__((reqd_work_group_size(GPU_GROUP, GPU_GROUP, 1)))
__kernel void invariance_step_gpu(int ld, int n, __global const int* restrict counts,
                                  __global const double* restrict row_mu, __global const double* restrict signed_mu,
                                  __global const double* restrict HC, __global const double* restrict H, int h_ld,
                                  long h_stride, int h_columns, __global const double* restrict R,
                                  __global double* restrict led, __global double* restrict moved,
                                  __global const double* restrict moved_1, __global const double* restrict moved_2,
                                  __global double* restrict found, __global const int* restrict state,
                                  __global const int* restrict items)
{
    __local double a_tile[GPU_DEPTH][GPU_TILE], b_tile[GPU_DEPTH][GPU_TILE + 1], sums[5][GPU_LANES];
    const long item = items[get_global_id(2)], place = item * ld * n;
    const bool runs = state[item] == RUNNING;
    const int rows = runs ? ld : 0, columns = n, inner = runs ? number_of_columns(counts, item, 2) : 0;
    const int a_ld = ld, b_row = h_ld, b_column = 1;
    __global const double* A = HC + item * ld * h_columns;
    __global const double* B = H + item * h_stride;
    double mine[5] = {0.0, 0.0, 0.0, 0.0, 0.0};
    R += place;
    led += place;
    moved += place;
    moved_1 += place;
    moved_2 += place;
    GPU_PLACES
    GPU_SUM_TERMS
    GPU_EACH_ELEMENT(GPU_SHARE)
    for (int v = 0; v < 5; v++)
        sums[v][here] = mine[v];
    for (int width = GPU_LANES / 2; width > 0; width /= 2) {
        barrier(CLK_LOCAL_MEM_FENCE);
        if (here < width)
            for (int v = 0; v < 5; v++) {
                const double other = sums[v][here + width];
                sums[v][here] = v < 3 ? sums[v][here] + other : LARGER(sums[v][here], other);
            }
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    found += ((item * get_num_groups(1) + get_group_id(1)) * get_num_groups(0) + get_group_id(0)) * 5;
    if (here < 5 && runs)
        found[here] = sums[here][0];
}

// Global size: items.
__kernel void invariance_judge(int step, int most, int tiles, __global const double* restrict found,
                               __global const double* restrict rate, __global const double* restrict tolerance,
                               __global Settling* restrict settling, __global double* restrict residual,
                               __global int* restrict steps, __global int* restrict state,
                               __global const int* restrict items)
{
    const long item = items[get_global_id(0)];
    if (state[item] != RUNNING) {
        state[item] = LEFT;
        return;
    }
    double sums[5] = {0.0, 0.0, 0.0, 0.0, 0.0};
    for (int tile = 0; tile < tiles; tile++) {
        __global const double* part = found + (item * tiles + tile) * 5;
        for (int k = 0; k < 3; k++)
            sums[k] += part[k];
        for (int k = 3; k < 5; k++)
            sums[k] = LARGER(sums[k], part[k]);
    }
    bool done;
    const Settling now = judged(step, sums, rate[item], tolerance[item], settling[item], &done);
    settling[item] = now;
    steps[item]++;
    if (done)
        state[item] = SETTLED;
    if (done || step == most - 1)
        if (!(now.missing <= residual[item]))
            residual[item] = now.missing;
}

// R of the last steps, zero at the start. Global size: elements of a matrix rounded up, items.
__kernel void invariance_mix(int starting, int size, __global const double* restrict led,
                             __global const double* restrict led_1, __global const double* restrict led_2,
                             __global double* restrict R, __global const Settling* restrict settling,
                             __global const int* restrict state, __global const int* restrict items)
{
    const long item = items[get_global_id(1)], k = item * size + get_global_id(0);
    if (get_global_id(0) >= size || state[item] == LEFT)
        return;
    __global const double* share = settling[item].share;
    double value = 0.0;
    if (!starting) {
        value = share[0] * led[k];
        if (share[1] != 0.0)
            value += share[1] * led_1[k];
        if (share[2] != 0.0)
            value += share[2] * led_2[k];
    }
    R[k] = value;
}

#define GPU_ADD_PHI \
    H[(long)j * h_ld + i] = value + (j < columns_E ? 1.0 : -1.0) * phi_row[(long)j * phi_ld + i];

// H = +-phi + R phi_nodes. Global size: 16 work-items a tile of 64 rows, 16 a tile of 64 columns, items.
__attribute__((reqd_work_group_size(GPU_GROUP, GPU_GROUP, 1)))
__kernel void invariance_renew_gpu(int starting, int n, __global const int* restrict counts,
                                   __global const double* restrict phi, int phi_ld, long phi_stride, int phi_first,
                                   __global const double* restrict R, __global double* restrict H, int h_ld, long h_stride,
                                   __global const int* restrict state, __global const int* restrict items)
{
    __local double a_tile[GPU_DEPTH][GPU_TILE], b_tile[GPU_DEPTH][GPU_TILE + 1];
    const long item = items[get_global_id(2)];
    const bool runs = state[item] != LEFT;
    const int rows = runs ? h_ld : 0, columns = number_of_columns(counts, item, 2);
    const int columns_E = number_of_columns(counts, item, 0), inner = runs && !starting ? n : 0;
    const int a_ld = h_ld, b_row = 1, b_column = phi_ld;
    __global const double* A = R + item * h_ld * n;
    __global const double* B = phi + item * phi_stride;
    __global const double* phi_row = B + phi_first;
    H += item * h_stride;
    GPU_PLACES
    GPU_SUM_TERMS
    GPU_EACH_ELEMENT(GPU_ADD_PHI)
}
