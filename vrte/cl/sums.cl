// Sums over Fourier orders, added into a table of radiances: (1:6)-(1:8), (1:12) without its 1/2.

#define TILE_ANGLES 12     // azimuths that are summed at once, in registers
#define BATCH 8            // groups of four elements whose sums are kept at hand
#define EACH_ANGLE(DO) DO(0) DO(1) DO(2) DO(3) DO(4) DO(5) DO(6) DO(7) \
    DO(8) DO(9) DO(10) DO(11)
#define NO_SUM(x) real4 sum##x = (real4)(0.0);
#define ADD_ORDER(x) sum##x = value * AT(wave, x) + sum##x;
#define KEEP_SUM(x) sums[x] = sum##x;

// sums (angle, lane) of four elements, `at` in a row of kernels, times weight times waves (order, angle, lane).
void sum_orders(int n_order, __global const real* row, int4 at, long order_stride, real4 weight,
                __global const real* wave, int wave_ld, real4* sums)
{
    EACH_ANGLE(NO_SUM)
    for (int m = 0; m < n_order; m++) {
        const real4 value = weight * (real4)(row[at.x], row[at.y], row[at.z], row[at.w]);
        EACH_ANGLE(ADD_ORDER)
        wave += wave_ld;
        row += order_stride;
    }
    EACH_ANGLE(KEEP_SUM)
}

// Elements of a Mueller matrix come in groups of four that are neighbours in a row (4, n_target) of the result. Pieces: `each`
// directions, n_level times n_in; a lane has a tile of a direction's angles.
KERNEL(LANES, add_orders)
{
    const int i = get_group_id(1) % n_in, level = get_group_id(1) / n_in;
    const int begin_mu = each * get_group_id(0), tiles = (n_angle + TILE_ANGLES - 1) / TILE_ANGLES;
    const int wave_ld = 4 * TILE_ANGLES * tiles;
    const int column_stride = n_kept * n_stokes;
    const long beam_stride = (long)n_col * column_stride, order_stride = beam_stride * n_stored * n_in;
    real4 sums[BATCH * TILE_ANGLES];
    kernels += (levels[level] * n_in + i) * beam_stride;
    out += ((long)level * n_in + i) * n_mu * n_phi * 4 * n_target;
    SPREAD(tile, begin_mu * tiles, min(n_mu, begin_mu + each) * tiles) {
        const int j = tile / tiles, angle = tile % tiles * TILE_ANGLES;
        for (int begin = 0; begin < n_group; begin += BATCH) {
            __global const int* now = entry + 10 * begin;
            const int count = min(BATCH, n_group - begin);
            for (int g = 0; g < count; g++) {
                __global const int* of = now + 10 * g;
                const int4 at = (int4)(of[0], of[1], of[2], of[3]) * column_stride
                    + (int4)(of[4], of[5], of[6], of[7]);
                sum_orders(n_order, kernels + (long)rows[j] * n_stokes, at, order_stride, scale[i] * AT(sense, begin + g),
                           waves + (long)of[8] * n_order * wave_ld + 4 * angle, wave_ld, sums + g * TILE_ANGLES);
            }
            for (int a = angle; a < min(angle + TILE_ANGLES, n_angle); a++)
                for (int use = first_use[a]; use < first_use[a + 1]; use++) {
                    __global real* row = out + ((long)j * n_phi + azimuth[use]) * 4 * n_target;
                    for (int g = 0; g < count; g++) {
                        const real4 sum = sums[g * TILE_ANGLES + a - angle];
                        *(__global loose4*)(row + 4 * now[10 * g + 9]) +=
                            mirror[use] < 0.0 ? AT(mirrored, now[10 * g + 8]) * sum : sum;
                    }
                }
        }
    }
}
