// Slabs joined by the star product, `join_one` of core/joining.pxi for many Fourier orders and scenes at once. Vectors are
// stacks (n, r) or (o, r), one column an incident beam and Stokes column.

// One stack of extended matrices from another: the item place[item] of it. Global size: columns, items.
__kernel void gather(int n, int p, int r, int o, int ld, long stride, EXTENDED(a), EXTENDED(c), __global const int* place,
                     __global const int* restrict items)
{
    const int j = get_global_id(0);
    const long item = items[get_global_id(1)], from = place[item];
    const Extended A = EXTENDED_AT(a, from), C = EXTENDED_AT(c, item);
    for (int i = 0; i < ld / 4; i++)
        PUT(C.M + (long)j * ld, i) = AT(A.M + (long)j * ld, i);
    for (int i = j; i < o; i += n + r)
        C.OO[i] = A.OO[i];
    for (int i = j; i < r; i += n + r)
        C.II[i] = A.II[i];
}

// out = alpha a + beta out + gamma 1, whole columns of `rows` elements. Global size: columns, items.
__kernel void blend(int rows, double alpha, __global const double* a, long a_first, int a_ld, long a_stride, double beta,
                  double gamma, __global double* out, long out_first, int out_ld, long out_stride,
                  __global const int* restrict items)
{
    const int j = get_global_id(0);
    const long item = items[get_global_id(1)];
    a += a_first + item * a_stride + (long)j * a_ld;
    out += out_first + item * out_stride + (long)j * out_ld;
    for (int i = 0; i < rows; i++)
        out[i] = alpha * a[i] + (beta == 0.0 ? 0.0 : beta * out[i]);
    if (j < rows)
        out[j] += gamma;
}

// What the attenuated beam makes: out = exp(-depth[item]/mu0) a + straight running, `running` (rows, r) being absent
// (has_running = 0) or weakened row by row. Global size: incident columns, items.
__kernel void fade(int rows, __global const double* rate_II, __global const double* depth, __global const double* a,
                   long a_first, int a_ld, long a_stride, int has_running, __global const double* straight, int s_stride,
                   __global const double* running, long r_first, int r_ld, long r_stride, __global double* out, long out_first,
                   int out_ld, long out_stride, __global const int* restrict items)
{
    const int j = get_global_id(0);
    const long item = items[get_global_id(1)];
    const double share = exp(-depth[item] * rate_II[j]);
    a += a_first + item * a_stride + (long)j * a_ld;
    out += out_first + item * out_stride + (long)j * out_ld;
    running += r_first + item * r_stride + (long)j * r_ld;
    for (int i = 0; i < rows; i++)
        out[i] = share * a[i] + (has_running ? straight[item * s_stride + i] * running[i] : 0.0);
}

// out[item] = x M + beta out, rows (n,). Global size: columns, items.
__kernel void row_times(int n, __global const double* x, __global const double* M, long first, int ld, long stride,
                        double beta, __global double* out, __global const int* restrict items)
{
    const int j = get_global_id(0);
    const long item = items[get_global_id(1)];
    M += first + item * stride + (long)j * ld;
    double total = 0.0;
    for (int i = 0; i < n; i++)
        total += x[item * n + i] * M[i];
    out[item * n + j] = total + (beta == 0.0 ? 0.0 : beta * out[item * n + j]);
}

// out = a + what b has in a row of M (b absent: the row alone), rows (n,). Global size: columns, items.
__kernel void add_row(int n, int axis, __global const double* a, __global const double* M, long first, int ld, long stride,
                      __global double* out, __global const int* restrict items)
{
    const int j = get_global_id(0);
    const long item = items[get_global_id(1)];
    out[item * n + j] = a[item * n + j] + M[first + item * stride + (long)j * ld + axis];
}

// The flux's row of M, known exactly, over its largest element; that of the right-hand sides G (n, n) and g (n, r) over
// the same. Global size: items.
__kernel void put_flux_row(int n, int r, int axis, __global const double* row, __global double* M, __global double* G, int ld,
                           long stride, __global double* g, int g_ld, long g_stride, __global const int* restrict items)
{
    const long item = items[get_global_id(0)];
    double largest = 0.0;
    for (int j = 0; j < n; j++)
        largest = fmax(largest, fabs(row[item * n + j]));
    if (!(largest > 0.0))
        return;
    for (int j = 0; j < n; j++) {
        M[item * stride + (long)j * ld + axis] = row[item * n + j] / largest;
        G[item * stride + (long)j * ld + axis] /= largest;
    }
    for (int j = 0; j < r; j++)
        g[item * g_stride + (long)j * g_ld + axis] /= largest;
}

// A level of what leaves: out (item, level, r, o) from a stack (o, r). Global size: incident columns, items.
__kernel void put_level(int r, int o, int n_level, int level, __global const double* running, long first, int ld, long stride,
                        __global double* out, __global const int* restrict items)
{
    const int j = get_global_id(0);
    const long item = items[get_global_id(1)];
    for (int i = 0; i < o; i++)
        out[((item * n_level + level) * r + j) * o + i] = running[first + item * stride + (long)j * ld + i];
}

// A level of the flux: out (item, level, 2, r) from the flux's axis of a stack (n, r). Global size: incident columns, items.
__kernel void put_flux(int r, int n_level, int level, int downward, int axis, double size, __global const double* going,
                       long first, int ld, long stride, __global double* out, __global const int* restrict items)
{
    const int j = get_global_id(0);
    const long item = items[get_global_id(1)];
    out[((item * n_level + level) * 2 + downward) * r + j] = -size * going[first + item * stride + (long)j * ld + axis];
}

// Radiance in the public frame, (item, level, r, n_mu, S): directions below n_up from `up`, the others from `down` (item,
// level, r, n_out, S), each out[j] of theirs; factor_up, factor_down (S,). Global size: r, levels, items.
__kernel void leaving(int r, int n_level, int n_mu, int n_up, int n_out, int stokes, __global const int* out,
                      __global const double* factor_up, __global const double* factor_down, __global const double* up,
                      __global const double* down, __global double* kernels, __global const int* restrict items)
{
    const long item = items[get_global_id(2)];
    const long row = (item * n_level + get_global_id(1)) * r + get_global_id(0);
    for (int j = 0; j < n_mu; j++)
        for (int s = 0; s < stokes; s++)
            kernels[(row * n_mu + j) * stokes + s] = j < n_up ? factor_up[s] * up[(row * n_out + out[j]) * stokes + s]
                                                             : factor_down[s] * down[(row * n_out + out[j]) * stokes + s];
}

// Rows (n,) of some slabs. Global size: 1, items.
__kernel void gather_rows(int n, __global const double* a, __global double* out, __global const int* place,
                          __global const int* restrict items)
{
    const long item = items[get_global_id(1)], from = place[item];
    for (int i = 0; i < n; i++)
        out[item * n + i] = a[from * n + i];
}

// The largest of kernels (item, level, n_in, n_col, n_mu, S), in the first n_seen directions, that each item has at each
// level for each beam, and of I in column `lit` alone; (item, level, n_in) both. Global size: incident directions, levels, items.
__kernel void largest_light(int n_level, int n_in, int n_col, int n_mu, int n_seen, int stokes, int lit, __global const double* kernels,
                            __global double* largest, __global double* brightest)
{
    const long place = (get_global_id(2) * n_level + get_global_id(1)) * n_in + get_global_id(0);
    double found = 0.0, intensity = 0.0;
    for (int c = 0; c < n_col; c++)
        for (int k = 0; k < n_seen * stokes; k++) {
            const double size = fabs(kernels[(place * n_col + c) * n_mu * stokes + k]);
            found = size > found || size != size ? size : found;
            intensity = c == lit && k % stokes == 0 && (size > intensity || size != size) ? size : intensity;
        }
    largest[place] = found;
    brightest[place] = intensity;
}
