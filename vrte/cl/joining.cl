// Slabs joined by the star product, `join_one` of core/joining.pxi for many Fourier orders and scenes at once. Vectors are
// stacks (n, r) or (o, r), one column an incident beam and Stokes column.

// out = alpha a + beta b + gamma 1, whole columns of `rows` elements, a being that of item from_item[item] where there is
// such a list. Pieces: columns, items.
SHARED
__kernel void blend(int rows, real alpha, STACK(a), __global const int* from_item, real beta, STACK(b),
                    real gamma, STACK(out), INTS items)
{
    const int j = get_group_id(0);
    const long item = items[get_group_id(1)];
    out = OF_ITEM(out) + (long)j * out_ld;
    a += a_first + (from_item ? from_item[item] : item) * a_stride + (long)j * a_ld;
    b = OF_ITEM(b) + (long)j * b_ld;
    SPREAD(i, 0, rows)
        out[i] = alpha * a[i] + (beta == 0.0 ? 0.0 : beta * b[i]);
    if (j < rows && LANE == j % LANES)
        out[j] += gamma;
}

// What the attenuated beam makes: out = exp(-depth[item]/mu0) a + straight running, `running` (rows, r) being absent
// (has_running = 0) or weakened row by row. Pieces: incident columns, items.
SHARED
__kernel void decay(int rows, IN rate_II, IN depth, ALONE(a), int has_running, IN straight, int s_stride, STACK(running),
                   STACK(out), INTS items)
{
    const int j = get_group_id(0);
    const long item = items[get_group_id(1)];
    const real share = exp(-depth[item] * rate_II[j]);
    a = OF_ITEM(a) + (long)j * a_ld;
    out = OF_ITEM(out) + (long)j * out_ld;
    running = OF_ITEM(running) + (long)j * running_ld;
    SPREAD(i, 0, rows)
        out[i] = share * a[i] + (has_running ? straight[item * s_stride + i] * running[i] : 0.0);
}

// out[item] = x M + beta out, rows (n,), a lane a column. Pieces: n / LANES, items.
SHARED
__kernel void row_times(int n, IN x, ALONE(M), real beta, OUT out, INTS items)
{
    const int j = get_global_id(0);
    const long item = items[get_group_id(1)];
    if (j >= n)
        return;
    M = OF_ITEM(M) + (long)j * M_ld;
    real total = 0.0;
    for (int i = 0; i < n; i++)
        total += x[item * n + i] * M[i];
    out[item * n + j] = total + (beta == 0.0 ? 0.0 : beta * out[item * n + j]);
}

// The flux's row of M, known exactly, over its largest element; that of the right-hand sides G (n, n) and g (n, r) over
// the same. Pieces: items.
SHARED
__kernel void put_flux_row(int n, int r, int axis, IN row, ALONE(M), ALONE(G), ALONE(g), INTS items)
{
    __local real shelf[LANES];
    const long item = items[get_group_id(0)];
    real largest = 0.0;
    SPREAD(j, 0, n)
        largest = fmax(largest, fabs(row[item * n + j]));
    largest = largest_of_lanes(largest, shelf);
    if (!(largest > 0.0))
        return;
    SPREAD(j, 0, n) {
        OF_ITEM(M)[(long)j * M_ld + axis] = row[item * n + j] / largest;
        OF_ITEM(G)[(long)j * G_ld + axis] /= largest;
    }
    SPREAD(j, 0, r)
        OF_ITEM(g)[(long)j * g_ld + axis] /= largest;
}

// Radiance in the public frame, (item, level, r, n_mu, S): directions below n_up from `up`, the others from `down` (item,
// level, r, n_out, S), each out[j] of theirs; factor_up, factor_down (S,). Pieces: r, levels, items.
SHARED
__kernel void leaving(int r, int n_level, int n_mu, int n_up, int n_out, int stokes, INTS out, IN factor_up, IN factor_down,
                      IN up, IN down, OUT kernels, INTS items)
{
    const long item = items[get_group_id(2)];
    const long row = (item * n_level + get_group_id(1)) * r + get_group_id(0);
    SPREAD(k, 0, n_mu * stokes) {
        const int j = k / stokes, s = k % stokes;
        const long from = (row * n_out + out[j]) * stokes + s;
        kernels[row * n_mu * stokes + k] = j < n_up ? factor_up[s] * up[from] : factor_down[s] * down[from];
    }
}

// The largest of kernels (item, level, n_in, n_col, n_mu, S), in the first n_seen directions, that each item has at each
// level for each beam, and of I in column `lit` alone: light (2, item, level, n_in), each of that
// `size`. Pieces: incident directions, levels, items.
SHARED
__kernel void largest_light(int n_level, int n_in, int n_col, int n_mu, int n_seen, int stokes, int lit, IN kernels,
                            OUT light, long size)
{
    __local real shelf[LANES];
    const long place = (get_group_id(2) * n_level + get_group_id(1)) * n_in + get_group_id(0);
    real found = 0.0, intensity = 0.0;
    for (int c = 0; c < n_col; c++)
        SPREAD(k, 0, n_seen * stokes) {
            const real size = fabs(kernels[(place * n_col + c) * n_mu * stokes + k]);
            found = larger(found, size);
            intensity = c == lit && k % stokes == 0 ? larger(intensity, size) : intensity;
        }
    found = largest_of_lanes(found, shelf);
    intensity = largest_of_lanes(intensity, shelf);
    if (LANE == 0) {
        light[place] = found;
        light[size + place] = intensity;
    }
}
