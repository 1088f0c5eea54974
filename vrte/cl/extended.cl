// Matrices with their incident and outgoing directions, by the lanes of one work-group: core/extended.pxi explains them.
//
// Such a matrix has (p + o) rows and (n + r) columns, p being n padded to a multiple of 8: N (n, n) and NI (n, r) on top,
// ON (o, n) and OI (o, r) below; behind it, OO (o,) and II (r,), what has no direction but its own.

typedef struct { int n, p, r, o, ld, stokes; } Sizes;

typedef struct { __global real *M, *OO, *II; } Extended;

// Scratch memory of `invert_matrix`, (n, PANEL) and (n,), and what its lanes share.
typedef struct {
    __global real* rest;
    __global int* pivots;
    Shelves shelves;
} Inverting;

#define EACH(j, columns, i, rows) for (int j = 0; j < (columns); j++) SPREAD(i, 0, rows)

Sizes make_sizes(int n, int r, int o, int stokes)
{
    const Sizes s = {n, next_strip(n), r, o, next_strip(next_strip(n) + o), stokes};
    return s;
}

long size_extended(Sizes s)
{
    return next_strip(s.ld * (s.n + s.r) + s.o + s.r);
}

Extended extended_at(Sizes s, __global real* memory, long which)
{
    Extended found;
    found.M = memory + which * size_extended(s);
    found.OO = found.M + s.ld * (s.n + s.r);
    found.II = found.OO + s.o;
    return found;
}

// The axis that carries the flux once order 0 is turned: I of the last node.
int flux_axis(Sizes s)
{
    return s.n - s.stokes;
}

// c = alpha a b + beta c, b (inner, columns), rows with their padding; c is neither a nor b.
void multiply(int rows, int columns, int inner, real alpha, __global const real* a, int a_ld, __global const real* b,
              int b_ld, real beta, __global real* c, int c_ld)
{
    const int strips = (rows + 7) / 8, tiles = (columns + TILE_COLUMNS - 1) / TILE_COLUMNS;
    SPREAD(tile, 0, strips * tiles) {
        const int row = 8 * (tile % strips), j = tile / strips * TILE_COLUMNS;
        product_of_tile(j, columns, inner, alpha, beta, a + row, a_ld, b, 1, b_ld, c + row, c_ld);
    }
    TOGETHER
}

// out = a, columns of `rows` elements.
void copy_columns(int rows, int columns, __global const real* a, int a_ld, __global real* out, int out_ld)
{
    EACH(j, columns, i, rows)
        out[(long)j * out_ld + i] = a[(long)j * a_ld + i];
    TOGETHER
}

// The largest |element|, or with `sums` the largest sum of a column's.
real largest_of(int rows, int columns, int sums, __global const real* a, int ld, __local real* shelf)
{
    real found = 0.0;
    SPREAD(j, 0, columns) {
        real total = 0.0, most = 0.0;
        for (int i = 0; i < rows; i++) {
            const real size = fabs(a[(long)j * ld + i]);
            total += size;
            most = larger(most, size);
        }
        found = larger(found, sums ? total : most);
    }
    return of_lanes(false, found, shelf);
}

// c = alpha a + beta b + gamma 1.
void combine(Sizes s, real alpha, Extended a, real beta, Extended b, real gamma, Extended c)
{
    SPREAD(i, 0, size_extended(s) / 4)
        PUT(c.M, i) = beta == 0.0 ? alpha * AT(a.M, i) : alpha * AT(a.M, i) + beta * AT(b.M, i);
    TOGETHER
    if (gamma != 0.0) {
        SPREAD(i, 0, s.n)
            c.M[(long)i * s.ld + i] += gamma;
        SPREAD(i, 0, s.o + s.r)
            c.OO[i] += gamma;
    }
    TOGETHER
}

// c = alpha a b; c is neither a nor b.
void product_extended(Sizes s, real alpha, Extended a, Extended b, Extended c)
{
    multiply(s.ld, s.n + s.r, s.n, alpha, a.M, s.ld, b.M, s.ld, 0.0, c.M, s.ld);
    for (int j = s.n; j < s.n + s.r; j++)
        SPREAD(i, 0, s.ld / 4)
            PUT(c.M + (long)j * s.ld, i) = alpha * b.II[j - s.n] * AT(a.M + (long)j * s.ld, i) + AT(c.M + (long)j * s.ld, i);
    TOGETHER
    EACH(j, s.n + s.r, i, s.o)
        c.M[(long)j * s.ld + s.p + i] += alpha * a.OO[i] * b.M[(long)j * s.ld + s.p + i];
    SPREAD(i, 0, s.o + s.r)
        c.OO[i] = alpha * a.OO[i] * b.OO[i];
    TOGETHER
}

// a <- a^-1; 1 where it is singular.
int invert_extended(Sizes s, Extended a, Extended spare, Inverting with)
{
    if (invert_matrix(s.n, a.M, s.ld, with.rest, with.pivots, with.shelves))
        return 1;
    SPREAD(i, 0, s.o + s.r)
        a.OO[i] = 1.0 / a.OO[i];
    TOGETHER
    EACH(j, s.n, i, s.o)
        spare.M[(long)j * s.ld + s.p + i] = -a.M[(long)j * s.ld + s.p + i] * a.OO[i];
    for (int j = s.n; j < s.n + s.r; j++) {
        const real straight = a.II[j - s.n];
        SPREAD(i, 0, s.n) {
            spare.M[(long)j * s.ld + i] = -straight * a.M[(long)j * s.ld + i];
            a.M[(long)j * s.ld + i] = 0.0;
        }
        SPREAD(i, 0, s.o)
            a.M[(long)j * s.ld + s.p + i] *= -straight * a.OO[i];
    }
    TOGETHER
    multiply(s.o, s.n, s.n, 1.0, spare.M + s.p, s.ld, a.M, s.ld, 0.0, a.M + s.p, s.ld);
    multiply(s.p + s.o, s.r, s.n, 1.0, a.M, s.ld, spare.M + (long)s.n * s.ld, s.ld, 1.0, a.M + (long)s.n * s.ld, s.ld);
    return 0;
}

// a <- (1 - v v^T) a on the first n rows, then, of its first n columns, a <- a (1 - v v^T).
void turn_both(Sizes s, __global const real* v, __global real* a)
{
    SPREAD(j, 0, s.n + s.r) {
        __global real* column = a + (long)j * s.ld;
        real total = 0.0;
        for (int i = 0; i < s.n; i += s.stokes)
            total += v[i] * column[i];
        for (int i = 0; i < s.n; i += s.stokes)
            column[i] -= total * v[i];
    }
    TOGETHER
    SPREAD(i, 0, s.ld) {
        real total = 0.0;
        for (int j = 0; j < s.n; j += s.stokes)
            total += v[j] * a[(long)j * s.ld + i];
        for (int j = 0; j < s.n; j += s.stokes)
            a[(long)j * s.ld + i] -= v[j] * total;
    }
    TOGETHER
}
