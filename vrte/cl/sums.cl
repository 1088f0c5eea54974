// Sums over Fourier orders, added into a table of radiances: (1:6)-(1:8), (1:12) without its 1/2.

#define TILE_ANGLES 12     // azimuths that are summed at once, in registers
#define BATCH 8            // groups of four elements whose sums are kept at hand
#define EACH_ANGLE(DO) DO(0) DO(1) DO(2) DO(3) DO(4) DO(5) DO(6) DO(7) \
    DO(8) DO(9) DO(10) DO(11)
#define NO_SUM(x) real4 sum##x = (real4)(0.0);
#define ADD_ORDER(x) sum##x = value * AT(wave, x) + sum##x;
#define KEEP_SUM(x) sums[x] = sum##x;

// How the directions of a result share the work, and where the result's rows lie.
#define WHERE_OUT INTS first_use, INTS azimuth, IN mirror, int n_angle, int n_phi, int n_place, int n_level, \
    int n_in, int n_mu, int first_in, int n_here, OUT out, long out_stride


// sums (angle, lane) of four elements times weight times waves (order, angle, lane), `wave_ld` doubles an order apart.
void sum_orders(int n_order, __global const real* from0, __global const real* from1, __global const real* from2,
                __global const real* from3, long order_stride, real4 weight, __global const real* wave,
                int wave_ld, real4* sums)
{
    EACH_ANGLE(NO_SUM)
    for (int m = 0; m < n_order; m++) {
        const real4 value = weight * (real4)(*from0, *from1, *from2, *from3);
        EACH_ANGLE(ADD_ORDER)
        wave += wave_ld;
        from0 += order_stride;
        from1 += order_stride;
        from2 += order_stride;
        from3 += order_stride;
    }
    EACH_ANGLE(KEEP_SUM)
}

// The same of one group of four, for one row of kernels, into sums (angle, lane).
void sum_group(__global const real* row, long column_stride, long stokes_stride, long order_stride, int n_order,
               __global const int* column, real4 weight, __global const real* factor, __global const real* wave,
               int wave_ld, real4* sums)
{
    __global const int* component = column + 4;
    weight *= (real4)(factor[component[0]], factor[component[1]], factor[component[2]], factor[component[3]]);
    sum_orders(n_order, row + column[0] * column_stride + component[0] * stokes_stride,
               row + column[1] * column_stride + component[1] * stokes_stride,
               row + column[2] * column_stride + component[2] * stokes_stride,
               row + column[3] * column_stride + component[3] * stokes_stride, order_stride, weight,
               wave, wave_ld, sums);
}

// Elements of a Mueller matrix come in groups of four that are neighbours in a row (4, n_place) of the result.
// kernels: (item, n_tau, n_in, n_col, n_out, S) by strides, an item being an order of a scene; shares (share, 4): which
// scene's table it goes to, its first item, how many of them, and which row of the waves is the first one's; entry
// (group, 10): column of each of the four, Stokes component of each, which of the waves, where in a row (in fours); sense
// (group, 4): 1 or -1, 0 for none; waves (pattern, wave_rows, angle, 4), wave_ld doubles an order: cos or sin of m times
// the distinct angles; mirrored (pattern, 4): 1 for cos, -1 for sin; first_use (n_angle + 1,): where in azimuth (n_phi,) those begin
// that are an angle or its mirror image, mirror -1; levels, rows, scale as `azimuthal_sum` in core/sums.pxi; factors
// (n_out, S): of a row of the kernels; out (scene, n_level, n_in, n_mu, n_phi, 4, n_place).
#define ORDERS IN kernels, long first, long order_stride, long level_stride, long in_stride, long column_stride, \
    long row_stride, long stokes_stride, INTS shares, int n_group, INTS entry, IN sense, IN waves, int wave_rows, \
    int wave_ld, IN mirrored, INTS levels, INTS rows, IN scale, IN factors, int n_stokes

// Pieces: `each` directions, n_level times n_here, shares; a lane has a tile of a direction's angles.
SHARED
__kernel void add_orders(ORDERS, int each, WHERE_OUT)
{
    const int i = first_in + get_group_id(1) % n_here, level = get_group_id(1) / n_here;
    __global const int* share = shares + 4 * get_group_id(2);
    const int begin_mu = each * get_group_id(0), tiles = (n_angle + TILE_ANGLES - 1) / TILE_ANGLES;
    real4 sums[BATCH * TILE_ANGLES];
    kernels += first + share[1] * order_stride + levels[level] * level_stride + i * in_stride;
    out += share[0] * out_stride + ((long)level * n_in + i) * n_mu * n_phi * 4 * n_place;
    SPREAD(tile, begin_mu * tiles, min(n_mu, begin_mu + each) * tiles) {
        const int j = tile / tiles, angle = tile % tiles * TILE_ANGLES;
        for (int begin = 0; begin < n_group; begin += BATCH) {
            __global const int* now = entry + 10 * begin;
            const int count = min(BATCH, n_group - begin);
            for (int g = 0; g < count; g++)
                sum_group(kernels + rows[j] * row_stride, column_stride, stokes_stride, order_stride, share[2], now + 10 * g,
                          scale[i] * AT(sense, begin + g), factors + (long)rows[j] * n_stokes,
                          waves + ((long)now[10 * g + 8] * wave_rows + share[3]) * wave_ld + 4 * angle, wave_ld,
                          sums + g * TILE_ANGLES);
            for (int a = angle; a < min(angle + TILE_ANGLES, n_angle); a++)
                for (int use = first_use[a]; use < first_use[a + 1]; use++) {
                    __global real* row = out + ((long)j * n_phi + azimuth[use]) * 4 * n_place;
                    for (int g = 0; g < count; g++) {
                        const real4 sum = sums[g * TILE_ANGLES + a - angle];
                        *(__global loose4*)(row + 4 * now[10 * g + 9]) +=
                            mirror[use] < 0.0 ? AT(mirrored, now[10 * g + 8]) * sum : sum;
                    }
                }
        }
    }
}
