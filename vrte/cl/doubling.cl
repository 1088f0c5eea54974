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

// What is not scattered: tanh(h/mu) (kind 0), 1/cosh^2(h/mu) (kind 1), exp(-h/mu) (kind 2) or 0 (kind 3).
real straight_light(int kind, real x)
{
    const real decaying = exp(-2.0 * x);
    return kind == 0 ? tanh(x) : kind == 1 ? 4.0 * decaying / ((1.0 + decaying) * (1.0 + decaying)) : kind == 2 ? exp(-x) : 0.0;
}

// c = alpha a b + gamma 1 but for the product through the nodes, which c holds: light that goes straight to where it came
// from, then, once all of a column is there, what goes straight where it leaves. c's OO and II are the products of those,
// or where there is an h (item,), what `straight_light` makes of it. Pieces: columns, items.
SHARED
__kernel void add_straight(SIZES, real alpha, EXTENDED(a), EXTENDED(b), EXTENDED(c), real gamma, int kind,
                           __global const real* h, IN rate_OO, IN rate_II, INTS items)
{
    const int j = get_group_id(0);
    const long item = items[get_group_id(1)];
    const Extended A = EXTENDED_AT(a, item), B = EXTENDED_AT(b, item), C = EXTENDED_AT(c, item);
    __global real* to = C.M + (long)j * ld;
    if (j >= n)
        SPREAD(i, 0, ld / 4)
            PUT(to, i) = alpha * B.II[j - n] * AT(A.M + (long)j * ld, i) + AT(to, i);
    TOGETHER
    SPREAD(i, 0, o)
        to[p + i] += alpha * A.OO[i] * B.M[(long)j * ld + p + i];
    if (j < n && LANE == 0 && gamma != 0.0)
        to[j] += gamma;
    if (j > 0)
        return;
    SPREAD(i, 0, o)
        C.OO[i] = h ? straight_light(kind, h[item] * rate_OO[i]) : alpha * A.OO[i] * B.OO[i] + gamma;
    SPREAD(i, 0, r)
        C.II[i] = h ? straight_light(kind, h[item] * rate_II[i]) : alpha * A.II[i] * B.II[i] + gamma;
}

// c = factor[item] alpha a + beta b + gamma 1, a being that of item from_item[item]; factor and from_item may be absent.
// Pieces: columns, items.
SHARED
__kernel void combine(SIZES, __global const real* factor, real alpha, EXTENDED(a), __global const int* from_item,
                      real beta, EXTENDED(b), real gamma, EXTENDED(c), INTS items)
{
    const int j = get_group_id(0);
    const long item = items[get_group_id(1)], source = from_item ? from_item[item] : item;
    const real share = factor ? alpha * factor[item] : alpha;
    const Extended A = EXTENDED_AT(a, source), B = EXTENDED_AT(b, item), C = EXTENDED_AT(c, item);
    __global const real* from = A.M + (long)j * ld;
    __global const real* other = B.M + (long)j * ld;
    __global real* to = C.M + (long)j * ld;
    SPREAD(i, 0, ld / 4)
        PUT(to, i) = beta == 0.0 ? share * AT(from, i) : share * AT(from, i) + beta * AT(other, i);
    if (j < n && LANE == j / 4 % LANES)
        to[j] += gamma;
    if (j > 0)
        return;
    SPREAD(i, 0, o)
        C.OO[i] = share * A.OO[i] + (beta == 0.0 ? 0.0 : beta * B.OO[i]) + gamma;
    SPREAD(i, 0, r)
        C.II[i] = share * A.II[i] + (beta == 0.0 ? 0.0 : beta * B.II[i]) + gamma;
}

// Before the rest of an inverse is made by products: b's ON = -ON/OO, NI = -NI/II, and of a, whose N is inverted, NI = 0,
// OI <- -OI/(OO II); b's OO = 1/OO, II = 1/II. Pieces: columns, items.
SHARED
__kernel void prepare_inverse(SIZES, EXTENDED(a), EXTENDED(b), INTS items)
{
    const int j = get_group_id(0);
    const long item = items[get_group_id(1)];
    const Extended A = EXTENDED_AT(a, item), B = EXTENDED_AT(b, item);
    __global real* column = A.M + (long)j * ld;
    __global real* to = B.M + (long)j * ld;
    if (j == 0) {
        SPREAD(i, 0, o)
            B.OO[i] = 1.0 / A.OO[i];
        SPREAD(i, 0, r)
            B.II[i] = 1.0 / A.II[i];
    }
    if (j < n) {
        SPREAD(i, 0, o)
            to[p + i] = -column[p + i] / A.OO[i];
        return;
    }
    const real straight = 1.0 / A.II[j - n];
    SPREAD(i, 0, n) {
        to[i] = -straight * column[i];
        column[i] = 0.0;
    }
    SPREAD(i, 0, o)
        column[p + i] *= -straight / A.OO[i];
}

// E or F with its incident and outgoing directions: the sources with the other sign, no OI. matrix (n, n), G (o, n) and
// source (n, S n_in) of item `of[item]`. Pieces: columns, items.
SHARED
__kernel void extend(SIZES, int stokes, int n_col, IN columns, IN rate_OO, INTS of, ALONE(matrix), ALONE(G), ALONE(source),
                     OUT out, INTS items)
{
    const int j = get_group_id(0);
    const long item = items[get_group_id(1)], from = of[item];
    __global real* to = out + item * stride + (long)j * ld;
    if (j < n) {
        __global const real* column = matrix + matrix_first + from * matrix_stride + (long)j * matrix_ld;
        __global const real* leading = G + G_first + from * G_stride + (long)j * G_ld;
        SPREAD(i, 0, n)
            to[i] = column[i];
        SPREAD(i, 0, o)
            to[p + i] = -leading[i] * rate_OO[i];
        return;
    }
    const int beam = (j - n) / n_col, incident = (j - n) % n_col;
    source += source_first + from * source_stride + (long)stokes * beam * source_ld;
    SPREAD(i, 0, n) {
        real total = 0.0;
        for (int s = 0; s < stokes; s++)
            total += source[(long)s * source_ld + i] * columns[stokes * incident + s];
        to[i] = -total;
    }
    SPREAD(i, 0, o)
        to[p + i] = 0.0;
}

// The largest |element| of a part with `rows` rows, of each item, or with `sums` the largest sum over a column of it.
// Pieces: items.
SHARED
__kernel void largest_size(int rows, int columns, int sums, ALONE(M), OUT largest, INTS items)
{
    __local real shelf[LANES];
    const long item = items[get_group_id(0)];
    real found = 0.0;
    SPREAD(j, 0, columns) {
        real total = 0.0, most = 0.0;
        for (int i = 0; i < rows; i++) {
            const real size = fabs(OF_ITEM(M)[(long)j * M_ld + i]);
            total += size;
            most = larger(most, size);
        }
        found = larger(found, sums ? total : most);
    }
    found = largest_of_lanes(found, shelf);
    if (LANE == 0)
        largest[item] = found;
}

// How far Zo Ze is from 1 on the diagonal, `axis` left out where skip[item]. Pieces: items.
SHARED
__kernel void diagonal_gap(SIZES, int axis, INTS skip, EXTENDED(a), OUT gap, INTS items)
{
    __local real shelf[LANES];
    const long item = items[get_group_id(0)];
    const Extended A = EXTENDED_AT(a, item);
    real found = 0.0;
    SPREAD(i, 0, n)
        if (!(skip[item] && i == axis))
            found = fmax(found, fabs(A.M[(long)i * ld + i] - 1.0));
    SPREAD(i, 0, o)
        found = fmax(found, fabs(A.OO[i] - 1.0));
    SPREAD(i, 0, r)
        found = fmax(found, fabs(A.II[i] - 1.0));
    found = largest_of_lanes(found, shelf);
    if (LANE == 0)
        gap[item] = found;
}

// OO and II alone. Pieces: items.
SHARED
__kernel void go_straight(SIZES, int kind, IN h, IN rate_OO, IN rate_II, EXTENDED(a), INTS items)
{
    const long item = items[get_group_id(0)];
    const Extended A = EXTENDED_AT(a, item);
    SPREAD(i, 0, o)
        A.OO[i] = straight_light(kind, kind == 3 ? 0.0 : h[item] * rate_OO[i]);
    SPREAD(i, 0, r)
        A.II[i] = straight_light(kind, kind == 3 ? 0.0 : h[item] * rate_II[i]);
}

// Order 0: (1 - v v^T) from the left, on the first n rows of any column, a lane a column. Pieces: columns / LANES,
// items.
SHARED
__kernel void turn_columns(SIZES, int stokes, IN v, OUT M, INTS items)
{
    __global real* column = M + items[get_group_id(1)] * stride + (long)get_global_id(0) * ld;
    if (get_global_id(0) >= n + r)
        return;
    real total = 0.0;
    for (int i = 0; i < n; i += stokes)
        total += v[i] * column[i];
    for (int i = 0; i < n; i += stokes)
        column[i] -= total * v[i];
}

// The same from the right, on the first n columns, a lane eight rows. Pieces: strips of 8 rows / LANES, items.
SHARED
__kernel void turn_rows(SIZES, int stokes, IN v, OUT M, INTS items)
{
    __global real* row = M + items[get_group_id(1)] * stride + 8 * get_global_id(0);
    if (8 * get_global_id(0) >= ld)
        return;
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
// the length of sqrt(weight mu). Pieces: items.
SHARED
__kernel void conserve(SIZES, int stokes, int n_col, int axis, real size, IN clear_row, IN columns, IN rate_OO, IN albedo,
                       OUT e, INTS items)
{
    const long item = items[get_group_id(0)];
    __global real* M = e + item * stride;
    SPREAD(i, 0, n) {
        M[(long)axis * ld + i] = (1.0 - albedo[item]) * clear_row[i];
        M[(long)i * ld + axis] = (1.0 - albedo[item]) * clear_row[i];
    }
    SPREAD(j, 0, r)
        M[(long)(n + j) * ld + axis] = albedo[item] * columns[stokes * (j % n_col)] / size;
    SPREAD(i, 0, o)
        M[(long)axis * ld + p + i] = i % stokes ? 0.0 : albedo[item] * rate_OO[i] / size;
}

// Reciprocity: the flux's column of Zo from its row; rounding there would double at each step. Pieces: items.
SHARED
__kernel void mirror_flux(SIZES, int axis, int v_place, int stokes, OUT Zo, INTS items)
{
    __global real* M = Zo + items[get_group_id(0)] * stride;
    SPREAD(i, 0, n) {
        const real across = M[(long)i * ld + axis];
        M[(long)axis * ld + i] = i % stokes == v_place ? -across : across;
    }
}

// to's NI = b's NI times the straight t.II; to's ON = the straight t.OO times b's ON. Pieces: columns, items.
SHARED
__kernel void lead_straight(SIZES, IN b, IN t_OO, IN t_II, OUT to, INTS items)
{
    const int j = get_group_id(0);
    const long item = items[get_group_id(1)], first = item * stride + (long)j * ld;
    if (j >= n)
        SPREAD(i, 0, n)
            to[first + i] = b[first + i] * t_II[item * r + j - n];
    else
        SPREAD(i, 0, o)
            to[first + p + i] = b[first + p + i] * t_OO[item * o + i];
}

// OI <- OI/(1/mu + 1/mu0). Pieces: incident columns, items.
SHARED
__kernel void divide_by_rates(SIZES, IN rate_OO, IN rate_II, OUT R, INTS items)
{
    const int j = get_group_id(0);
    SPREAD(i, 0, o)
        R[items[get_group_id(1)] * stride + (long)(n + j) * ld + p + i] /= rate_OO[i] + rate_II[j];
}

// A slab without scattering: exp(-thickness/mu) on the diagonal of T. Pieces: items.
SHARED
__kernel void clear_nodes(SIZES, int stokes, IN thickness, IN nodes, OUT T, INTS items)
{
    const long item = items[get_group_id(0)];
    SPREAD(i, 0, n)
        T[item * stride + (long)i * ld + i] = exp(-thickness[item] / nodes[i / stokes]);
}
