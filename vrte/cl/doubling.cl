// Impedance doubling of many slabs at once; the equations are those of `double_one` in core/doubling.pxi.
//
// A matrix with its incident and outgoing directions is one of (p + o) rows and (n + r) columns, p being n padded to a
// multiple of 8: N (n, n) and NI (n, r) on top, ON (o, n) and OI (o, r) below. What has no direction but its own is
// kept apart: OO (o,) and II (r,), `o_stride` and `r_stride` doubles an item apart (0: the same for all).

typedef struct {
    __global real* M;       // the item's
    __global real* OO;
    __global real* II;
} Extended;

#define SIZES int n, int p, int r, int o, int ld, long stride
#define EXTENDED(x) __global real* x, __global real* x##_OO, int x##_o_stride, __global real* x##_II, \
    int x##_r_stride
#define EXTENDED_AT(x, item) { x + (item) * stride, x##_OO + (item) * (long)x##_o_stride, x##_II + (item) * (long)x##_r_stride }

// c = alpha a b: added to the product through the nodes is light that goes on straight. Global size: columns, items.
__kernel void add_straight(SIZES, real alpha, EXTENDED(a), EXTENDED(b), EXTENDED(c), INTS items)
{
    const int j = get_global_id(0);
    const long item = items[get_global_id(1)];
    const Extended A = EXTENDED_AT(a, item), B = EXTENDED_AT(b, item), C = EXTENDED_AT(c, item);
    __global real* to = C.M + (long)j * ld;
    if (j >= n)
        for (int i = 0; i < ld / 4; i++)
            PUT(to, i) = alpha * B.II[j - n] * AT(A.M + (long)j * ld, i) + AT(to, i);
    for (int i = 0; i < o; i++)
        to[p + i] += alpha * A.OO[i] * B.M[(long)j * ld + p + i];
    for (int i = j; i < o; i += n + r)
        C.OO[i] = alpha * A.OO[i] * B.OO[i];
    for (int i = j; i < r; i += n + r)
        C.II[i] = alpha * A.II[i] * B.II[i];
}

// c = factor[item] alpha a + beta b + gamma 1, a being that of item from_item[item]; factor and from_item may be absent.
// Global size: columns, items.
__kernel void combine(SIZES, __global const real* factor, real alpha, EXTENDED(a), __global const int* from_item,
                      real beta, EXTENDED(b), real gamma, EXTENDED(c), INTS items)
{
    const int j = get_global_id(0);
    const long item = items[get_global_id(1)], source = from_item ? from_item[item] : item;
    const Extended A = EXTENDED_AT(a, source), B = EXTENDED_AT(b, item), C = EXTENDED_AT(c, item);
    const real share = factor ? alpha * factor[item] : alpha;
    __global const real* from = A.M + (long)j * ld;
    __global const real* other = B.M + (long)j * ld;
    __global real* to = C.M + (long)j * ld;
    for (int i = 0; i < ld / 4; i++)
        PUT(to, i) = beta == 0.0 ? share * AT(from, i) : share * AT(from, i) + beta * AT(other, i);
    if (j < n)
        to[j] += gamma;
    for (int i = j; i < o; i += n + r)
        C.OO[i] = share * A.OO[i] + (beta == 0.0 ? 0.0 : beta * B.OO[i]) + gamma;
    for (int i = j; i < r; i += n + r)
        C.II[i] = share * A.II[i] + (beta == 0.0 ? 0.0 : beta * B.II[i]) + gamma;
}

// Before the rest of an inverse is made by products: b's ON = -ON/OO, NI = -NI/II, and of a, whose N is inverted, NI = 0,
// OI <- -OI/(OO II). Global size: columns, items.
__kernel void prepare_inverse(SIZES, EXTENDED(a), EXTENDED(b), INTS items)
{
    const int j = get_global_id(0);
    const long item = items[get_global_id(1)];
    const Extended A = EXTENDED_AT(a, item), B = EXTENDED_AT(b, item);
    __global real* column = A.M + (long)j * ld;
    __global real* to = B.M + (long)j * ld;
    if (j < n) {
        for (int i = 0; i < o; i++)
            to[p + i] = -column[p + i] / A.OO[i];
        return;
    }
    const real straight = 1.0 / A.II[j - n];
    for (int i = 0; i < n; i++) {
        to[i] = -straight * column[i];
        column[i] = 0.0;
    }
    for (int i = 0; i < o; i++)
        column[p + i] *= -straight / A.OO[i];
}

// OO <- 1/OO, II <- 1/II. Global size: items.
__kernel void invert_straight(SIZES, EXTENDED(a), INTS items)
{
    const Extended A = EXTENDED_AT(a, (long)items[get_global_id(0)]);
    for (int i = 0; i < o; i++)
        A.OO[i] = 1.0 / A.OO[i];
    for (int i = 0; i < r; i++)
        A.II[i] = 1.0 / A.II[i];
}

// E or F with its incident and outgoing directions: the sources with the other sign, no OI. matrix (n, n), G (o, n) and
// source (n, S n_in) of item `of[item]`. Global size: columns, items.
__kernel void extend(SIZES, int stokes, int n_col, __global const real* columns, __global const real* rate_OO,
                     __global const int* of, STACK(matrix), STACK(G), STACK(source), __global real* out, INTS items)
{
    const int j = get_global_id(0);
    const long item = items[get_global_id(1)], from = of[item];
    __global real* to = out + item * stride + (long)j * ld;
    if (j < n) {
        __global const real* column = matrix + matrix_first + from * matrix_stride + (long)j * matrix_ld;
        __global const real* leading = G + G_first + from * G_stride + (long)j * G_ld;
        for (int i = 0; i < n; i++)
            to[i] = column[i];
        for (int i = 0; i < o; i++)
            to[p + i] = -leading[i] * rate_OO[i];
        return;
    }
    const int beam = (j - n) / n_col, incident = (j - n) % n_col;
    source += source_first + from * source_stride + (long)stokes * beam * source_ld;
    for (int i = 0; i < n; i++) {
        real total = 0.0;
        for (int s = 0; s < stokes; s++)
            total += source[(long)s * source_ld + i] * columns[stokes * incident + s];
        to[i] = -total;
    }
    for (int i = 0; i < o; i++)
        to[p + i] = 0.0;
}

// The sums over a column's |elements| or the largest of them, of a part with `rows` rows; sizes (item, columns). Global
// size: columns, items.
__kernel void column_sizes(int rows, int columns, int sum, STACK(M), __global real* sizes, INTS items)
{
    const int j = get_global_id(0);
    const long item = items[get_global_id(1)];
    __global const real* column = OF_ITEM(M) + (long)j * M_ld;
    real total = 0.0, largest = 0.0;
    for (int i = 0; i < rows; i++) {
        const real size = fabs(column[i]);
        total += size;
        largest = size > largest || size != size ? size : largest;
    }
    sizes[item * columns + j] = sum ? total : largest;
}

// The largest of n sizes. Global size: items.
__kernel void largest_size(int n, __global const real* sizes, __global real* largest, INTS items)
{
    const long item = items[get_global_id(0)];
    real found = 0.0;
    for (int j = 0; j < n; j++)
        found = sizes[item * n + j] > found || sizes[item * n + j] != sizes[item * n + j] ? sizes[item * n + j] : found;
    largest[item] = found;
}

// How far Zo Ze is from 1 on the diagonal, `axis` left out where skip[item]. Global size: items.
__kernel void diagonal_gap(SIZES, int axis, __global const int* skip, EXTENDED(a), __global real* gap, INTS items)
{
    const long item = items[get_global_id(0)];
    const Extended A = EXTENDED_AT(a, item);
    real found = 0.0;
    for (int i = 0; i < n; i++)
        if (!(skip[item] && i == axis))
            found = fmax(found, fabs(A.M[(long)i * ld + i] - 1.0));
    for (int i = 0; i < o; i++)
        found = fmax(found, fabs(A.OO[i] - 1.0));
    for (int i = 0; i < r; i++)
        found = fmax(found, fabs(A.II[i] - 1.0));
    gap[item] = found;
}

// What is not scattered: tanh(h/mu) (kind 0), 1/cosh^2(h/mu) (kind 1), exp(-h/mu) (kind 2) or 0 (kind 3). Global size:
// items.
real straight_light(int kind, real x)
{
    const real fading = exp(-2.0 * x);
    return kind == 0 ? tanh(x) : kind == 1 ? 4.0 * fading / ((1.0 + fading) * (1.0 + fading)) : kind == 2 ? exp(-x) : 0.0;
}

__kernel void go_straight(SIZES, int kind, __global const real* h, __global const real* rate_OO,
                          __global const real* rate_II, EXTENDED(a), INTS items)
{
    const long item = items[get_global_id(0)];
    const Extended A = EXTENDED_AT(a, item);
    for (int i = 0; i < o; i++)
        A.OO[i] = straight_light(kind, kind == 3 ? 0.0 : h[item] * rate_OO[i]);
    for (int i = 0; i < r; i++)
        A.II[i] = straight_light(kind, kind == 3 ? 0.0 : h[item] * rate_II[i]);
}

// Order 0: (1 - v v^T) from the left, on the first n rows of any column. Global size: columns, items.
__kernel void turn_columns(SIZES, int stokes, __global const real* v, __global real* M, INTS items)
{
    __global real* column = M + items[get_global_id(1)] * stride + (long)get_global_id(0) * ld;
    real total = 0.0;
    for (int i = 0; i < n; i += stokes)
        total += v[i] * column[i];
    for (int i = 0; i < n; i += stokes)
        column[i] -= total * v[i];
}

// The same from the right, on the first n columns of eight rows. Global size: strips of 8 rows, items.
__kernel void turn_rows(SIZES, int stokes, __global const real* v, __global real* M, INTS items)
{
    __global real* row = M + items[get_global_id(1)] * stride + 8 * get_global_id(0);
    real4 top = (real4)(0.0), low = (real4)(0.0);
    for (int j = 0; j < n; j += stokes) {
        __global const real* now = row + (long)j * ld;
        top += v[j] * AT(now, 0);
        low += v[j] * AT(now, 1);
    }
    for (int j = 0; j < n; j += stokes) {
        __global real* now = row + (long)j * ld;
        PUT(now, 0) = AT(now, 0) - v[j] * top;
        PUT(now, 1) = AT(now, 1) - v[j] * low;
    }
}

// The flux's row and column of the turned E, known exactly: clear_row (n,) is what they are without scattering; size:
// the length of sqrt(weight mu). Global size: items.
__kernel void conserve(SIZES, int stokes, int n_col, int axis, real size, __global const real* clear_row,
                       __global const real* columns, __global const real* rate_OO, __global const real* albedo,
                       __global real* e, INTS items)
{
    const long item = items[get_global_id(0)];
    __global real* M = e + item * stride;
    for (int i = 0; i < n; i++) {
        M[(long)axis * ld + i] = (1.0 - albedo[item]) * clear_row[i];
        M[(long)i * ld + axis] = (1.0 - albedo[item]) * clear_row[i];
    }
    for (int j = 0; j < r; j++)
        M[(long)(n + j) * ld + axis] = albedo[item] * columns[stokes * (j % n_col)] / size;
    for (int i = 0; i < o; i++)
        M[(long)axis * ld + p + i] = i % stokes ? 0.0 : albedo[item] * rate_OO[i] / size;
}

// Reciprocity: the flux's column of Zo from its row; rounding there would double at each step. Global size: items.
__kernel void mirror_flux(SIZES, int axis, int v_place, int stokes, __global real* Zo, INTS items)
{
    __global real* M = Zo + items[get_global_id(0)] * stride;
    for (int i = 0; i < n; i++) {
        const real across = M[(long)i * ld + axis];
        M[(long)axis * ld + i] = i % stokes == v_place ? -across : across;
    }
}

// to's NI = b's NI times the straight t.II; to's ON = the straight t.OO times b's ON. Global size: columns, items.
__kernel void lead_straight(SIZES, __global const real* b, __global const real* t_OO, __global const real* t_II,
                            __global real* to, INTS items)
{
    const int j = get_global_id(0);
    const long item = items[get_global_id(1)], first = item * stride + (long)j * ld;
    if (j >= n)
        for (int i = 0; i < n; i++)
            to[first + i] = b[first + i] * t_II[item * r + j - n];
    else
        for (int i = 0; i < o; i++)
            to[first + p + i] = b[first + p + i] * t_OO[item * o + i];
}

// OI <- OI/(1/mu + 1/mu0). Global size: incident columns, items.
__kernel void divide_by_rates(SIZES, __global const real* rate_OO, __global const real* rate_II, __global real* R,
                              INTS items)
{
    const int j = get_global_id(0);
    __global real* column = R + items[get_global_id(1)] * stride + (long)(n + j) * ld + p;
    for (int i = 0; i < o; i++)
        column[i] /= rate_OO[i] + rate_II[j];
}

// A slab without scattering: exp(-thickness/mu) on the diagonal of T. Global size: items.
__kernel void clear_nodes(SIZES, int stokes, __global const real* thickness, __global const real* nodes,
                          __global real* T, INTS items)
{
    const long item = items[get_global_id(0)];
    for (int i = 0; i < n; i++)
        T[item * stride + (long)i * ld + i] = exp(-thickness[item] / nodes[i / stokes]);
}
