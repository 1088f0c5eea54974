// Slabs joined by the star product, `join_one` of core/joining.pxi for many Fourier orders and scenes at once. Vectors are
// stacks (n, r) or (o, r), one column an incident beam and Stokes column.

// out = alpha a + beta b + gamma 1, whole columns of `rows` elements, a being that of item from_item[item] where there is
// such a list. Global size: columns, items.
__kernel void blend(int rows, real alpha, STACK(a), __global const int* from_item, real beta, STACK(b),
                    real gamma, STACK(out), INTS items)
{
    const int j = get_global_id(0);
    const long item = items[get_global_id(1)];
    out = OF_ITEM(out) + (long)j * out_ld;
    a += a_first + (from_item ? from_item[item] : item) * a_stride + (long)j * a_ld;
    b = OF_ITEM(b) + (long)j * b_ld;
    for (int i = 0; i < rows; i++)
        out[i] = alpha * a[i] + (beta == 0.0 ? 0.0 : beta * b[i]);
    if (j < rows)
        out[j] += gamma;
}

// What the attenuated beam makes: out = exp(-depth[item]/mu0) a + straight running, `running` (rows, r) being absent
// (has_running = 0) or weakened row by row. Global size: incident columns, items.
__kernel void fade(int rows, __global const real* rate_II, __global const real* depth, STACK(a), int has_running,
                   __global const real* straight, int s_stride, STACK(running), STACK(out), INTS items)
{
    const int j = get_global_id(0);
    const long item = items[get_global_id(1)];
    const real share = exp(-depth[item] * rate_II[j]);
    a = OF_ITEM(a) + (long)j * a_ld;
    out = OF_ITEM(out) + (long)j * out_ld;
    running = OF_ITEM(running) + (long)j * running_ld;
    for (int i = 0; i < rows; i++)
        out[i] = share * a[i] + (has_running ? straight[item * s_stride + i] * running[i] : 0.0);
}

// out[item] = x M + beta out, rows (n,). Global size: columns, items.
__kernel void row_times(int n, __global const real* x, STACK(M), real beta, __global real* out, INTS items)
{
    const int j = get_global_id(0);
    const long item = items[get_global_id(1)];
    M = OF_ITEM(M) + (long)j * M_ld;
    real total = 0.0;
    for (int i = 0; i < n; i++)
        total += x[item * n + i] * M[i];
    out[item * n + j] = total + (beta == 0.0 ? 0.0 : beta * out[item * n + j]);
}

// The flux's row of M, known exactly, over its largest element; that of the right-hand sides G (n, n) and g (n, r) over
// the same. Global size: items.
__kernel void put_flux_row(int n, int r, int axis, __global const real* row, STACK(M), STACK(G), STACK(g), INTS items)
{
    const long item = items[get_global_id(0)];
    real largest = 0.0;
    for (int j = 0; j < n; j++)
        largest = fmax(largest, fabs(row[item * n + j]));
    if (!(largest > 0.0))
        return;
    for (int j = 0; j < n; j++) {
        OF_ITEM(M)[(long)j * M_ld + axis] = row[item * n + j] / largest;
        OF_ITEM(G)[(long)j * G_ld + axis] /= largest;
    }
    for (int j = 0; j < r; j++)
        OF_ITEM(g)[(long)j * g_ld + axis] /= largest;
}

// Radiance in the public frame, (item, level, r, n_mu, S): directions below n_up from `up`, the others from `down` (item,
// level, r, n_out, S), each out[j] of theirs; factor_up, factor_down (S,). Global size: r, levels, items.
__kernel void leaving(int r, int n_level, int n_mu, int n_up, int n_out, int stokes, __global const int* out,
                      __global const real* factor_up, __global const real* factor_down, __global const real* up,
                      __global const real* down, __global real* kernels, INTS items)
{
    const long item = items[get_global_id(2)];
    const long row = (item * n_level + get_global_id(1)) * r + get_global_id(0);
    for (int j = 0; j < n_mu; j++)
        for (int s = 0; s < stokes; s++)
            kernels[(row * n_mu + j) * stokes + s] = j < n_up ? factor_up[s] * up[(row * n_out + out[j]) * stokes + s]
                                                             : factor_down[s] * down[(row * n_out + out[j]) * stokes + s];
}

// The largest of kernels (item, level, n_in, n_col, n_mu, S), in the first n_seen directions, that each item has at each
// level for each beam, and of I in column `lit` alone; (item, level, n_in) both. Global size: incident directions, levels, items.
__kernel void largest_light(int n_level, int n_in, int n_col, int n_mu, int n_seen, int stokes, int lit,
                            __global const real* kernels, __global real* largest, __global real* brightest)
{
    const long place = (get_global_id(2) * n_level + get_global_id(1)) * n_in + get_global_id(0);
    real found = 0.0, intensity = 0.0;
    for (int c = 0; c < n_col; c++)
        for (int k = 0; k < n_seen * stokes; k++) {
            const real size = fabs(kernels[(place * n_col + c) * n_mu * stokes + k]);
            found = size > found || size != size ? size : found;
            intensity = c == lit && k % stokes == 0 && (size > intensity || size != size) ? size : intensity;
        }
    largest[place] = found;
    brightest[place] = intensity;
}
