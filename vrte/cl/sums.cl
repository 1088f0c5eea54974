// Sums over Fourier orders, added into a table of radiances: (1:6)-(1:8), (1:12) without its 1/2.

#define TILE_ENTRIES 4   // elements of a Mueller matrix and
#define TILE_ANGLES 8    // azimuths that are summed at once, in registers

// How the directions of a result share the work, and where the result's rows lie.
#define WHERE_OUT __global const int* restrict first_use, __global const int* restrict azimuth, \
    __global const double* restrict mirror, int n_angle, int n_phi, int n_place, int n_level, int n_in, int n_mu, \
    int first_in, int n_here, int mu_each, int tiles_each, __global double* restrict out, long out_first, long out_stride

// sums (entry, angle) += over the orders, an entry's values `order_stride` apart, a wave's `wave_ld`.
void sum_orders(int n_order, __global const double* const* from, long order_stride, __global const double* wave,
                int wave_ld, double4 sums[TILE_ENTRIES][2])
{
    double4 top0 = (double4)(0.0), top1 = top0, top2 = top0, top3 = top0, low0 = top0, low1 = top0, low2 = top0, low3 = top0;
    __global const double *from0 = from[0], *from1 = from[1], *from2 = from[2], *from3 = from[3];
    for (int m = 0; m < n_order; m++) {
        const double4 first = AT(wave, 0), second = AT(wave, 1);
        const double a = *from0, b = *from1, c = *from2, d = *from3;
        top0 = a * first + top0;
        low0 = a * second + low0;
        top1 = b * first + top1;
        low1 = b * second + low1;
        top2 = c * first + top2;
        low2 = c * second + low2;
        top3 = d * first + top3;
        low3 = d * second + low3;
        from0 += order_stride;
        from1 += order_stride;
        from2 += order_stride;
        from3 += order_stride;
        wave += wave_ld;
    }
    sums[0][0] = top0;
    sums[0][1] = low0;
    sums[1][0] = top1;
    sums[1][1] = low1;
    sums[2][0] = top2;
    sums[2][1] = low2;
    sums[3][0] = top3;
    sums[3][1] = low3;
}

// kernels: (scene, order, n_tau, n_in, n_col, n_out, S) by strides, n_order (scene,) of them; entries: n_entry elements, the
// first n_cosine with cos(m phi), the others with sin: entry (3, n_entry): column, Stokes component, place in a row (4, n_place)
// of the result; sense (n_entry,): 1 or -1; waves (2, wave_rows, wave_ld): cos, then sin, of m times the distinct angles;
// first_use (n_angle + 1,): where the azimuths (n_phi,) begin that are an angle or its mirror image, mirror -1; levels, rows,
// scale as `azimuthal_sum` in _core.pyx; factors (n_out, S): of a row of the kernels; out (scene, n_level, n_in, n_mu, n_phi, 4, n_place).
// Global size: n_mu / mu_each, tiles of angles / tiles_each, scenes times n_level times n_here.
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void add_orders(__global const double* restrict kernels, long first, long scene_stride, long order_stride,
                         long level_stride, long in_stride, long column_stride, long row_stride, long stokes_stride,
                         __global const int* restrict n_order, int n_entry, int n_cosine, __global const int* restrict entry,
                         __global const double* restrict sense, __global const double* restrict waves, int wave_rows,
                         int wave_ld, __global const int* restrict levels, __global const int* restrict rows,
                         __global const double* restrict scale, __global const double* restrict factors, int n_stokes,
                         WHERE_OUT)
{
    const int i = first_in + get_global_id(2) % n_here, level = get_global_id(2) / n_here % n_level;
    const long scene = get_global_id(2) / ((long)n_here * n_level);
    const int last_mu = min(n_mu, (int)(get_global_id(0) + 1) * mu_each);
    const int last_tile = min((n_angle + TILE_ANGLES - 1) / TILE_ANGLES, (int)(get_global_id(1) + 1) * tiles_each);
    kernels += first + scene * scene_stride + levels[level] * level_stride + i * in_stride;
    out += out_first + scene * out_stride + ((long)level * n_in + i) * n_mu * n_phi * 4 * n_place;
    for (int j = get_global_id(0) * mu_each; j < last_mu; j++)
        for (int k = 0; k < n_entry; ) {
            const int with_sine = k >= n_cosine, end = min(k + TILE_ENTRIES, with_sine ? n_entry : n_cosine);
            __global const double* from[TILE_ENTRIES];
            double factor[TILE_ENTRIES];
            for (int x = 0; x < TILE_ENTRIES; x++) {
                const int e = min(k + x, end - 1), component = entry[n_entry + e];
                from[x] = kernels + entry[e] * column_stride + rows[j] * row_stride + component * stokes_stride;
                factor[x] = scale[i] * sense[e] * factors[rows[j] * n_stokes + component];
            }
            for (int tile = get_global_id(1) * tiles_each; tile < last_tile; tile++) {
                double4 sums[TILE_ENTRIES][2];
                const int angle = tile * TILE_ANGLES;
                sum_orders(n_order[scene], from, order_stride, waves + (long)with_sine * wave_rows * wave_ld + angle, wave_ld, sums);
                for (int a = angle; a < min(angle + TILE_ANGLES, n_angle); a++)
                    for (int use = first_use[a]; use < first_use[a + 1]; use++) {
                        __global double* to = out + ((long)j * n_phi + azimuth[use]) * 4 * n_place;
                        const double side = with_sine ? mirror[use] : 1.0;
                        for (int x = 0; x < end - k; x++)
                            to[entry[2 * n_entry + k + x]] += side * factor[x] * ((const double*)sums[x])[a - angle];
                    }
            }
            k = end;
        }
}
