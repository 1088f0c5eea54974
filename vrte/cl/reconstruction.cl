// Reconstruction by source-function integration, (1:36)-(1:38), without singly scattered light. The equations are those
// of `reconstruct` in core/reconstruction.pxi, which explains them.
//
// Arrays as there: a mode's column has S n_out rows, those of light going up first; n modes a layer. Light is wanted at
// n_level depths; behind them stand the faces that it leaves each layer through: n_level + n_layer "stops" in all.

#define BLOCK 32      // modes that are summed over at once, one more where a pair would be cut

// Modes of a layer, and how many there are of all else; what all orders share.
#define COUNTS int n, int stokes, int n_up, int n_layer, int n_level, int n_in, int n_rhs
#define PLACES IN thickness, IN above, IN mu0, IN mu_out, IN level, INTS level_layer

// Up to four Stokes components of a direction, or rows.
real4 stokes_at(int stokes, __global const real* p)
{
    if (stokes == 4)
        return *(__global const loose4*)p;
    return (real4)(stokes > 0 ? p[0] : 0.0, stokes > 1 ? p[1] : 0.0, stokes > 2 ? p[2] : 0.0, 0.0);
}

void put_stokes(int stokes, __global real* p, real4 value)
{
    p[0] = value.x;
    if (stokes > 1)
        p[1] = value.y;
    if (stokes > 2)
        p[2] = value.z;
    if (stokes > 3)
        p[3] = value.w;
}

// lit (kind, item, n, ld) = G X: how modes light the outgoing directions, kind 0 for G_E X and 1 for G_F Y; G (item, n,
// rows), X (item, n, n). Where a strip is longer than what is left of its column it reads into the next ones, but not
// behind the last. Global size: strips of 8 rows, items, 2.
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void light_of_modes(COUNTS, int rows, int ld, IN G_E, IN G_F, IN X, IN Y, OUT lit)
{
    const long item = get_global_id(1), first = 8 * get_global_id(0);
    const int columns = n, c_ld = ld, b_column = n, b_row = 1, left = rows - (int)first;
    const int inside = n + 1 - ((int)first + 8 + rows - 1) / rows;     // columns behind which eight more doubles lie
    __global const real* A = (get_global_id(2) ? G_F : G_E) + item * n * rows + first;
    __global const real* B = (get_global_id(2) ? Y : X) + item * n * n;
    __global real* C = lit + (get_global_id(2) * get_global_size(1) + item) * n * ld + first;
    for (int j = 0; j < columns; j += TILE_COLUMNS) {
        __global const real* a = A;
        EACH_COLUMN(COLUMN_OF_B)
        EACH_COLUMN(NO_SUMS)
        int k = 0;
        for (; k < inside; k++) {
            const real4 a_top = *(__global const loose4*)a, a_low = *(__global const loose4*)(a + 4);
            EACH_COLUMN(ADD_TERM)
            a += rows;
        }
        for (; k < n; k++) {
            const real4 a_top = stokes_at(min(4, left), a), a_low = stokes_at(min(4, left - 4), a + 4);
            EACH_COLUMN(ADD_TERM)
            a += rows;
        }
        EACH_COLUMN(STORE_SUMS)
    }
}

// fed (order, stop, n_rhs, n) = c D(depth of the stop), nothing where that is 0 or infinite.
// Global size: stops, n_in, orders.
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void feed_modes(COUNTS, IN lam_re, IN lam_im, IN c, PLACES, OUT fed)
{
    const int stop = get_global_id(0), beam = get_global_id(1), per_beam = n_rhs / get_global_size(1);
    const int layer = stop < n_level ? level_layer[stop] : stop - n_level;
    const real depth = stop < n_level ? level[stop] : thickness[layer];
    const long item = get_global_id(2) * n_layer + layer;
    if (depth == 0.0 || depth > SEMI_INFINITE)
        return;
    lam_re += item * n;
    lam_im += item * n;
    c += (item * n_rhs + beam * per_beam) * n;
    fed += ((get_global_id(2) * (n_level + n_layer) + stop) * n_rhs + beam * per_beam) * n;
    for (int j = 0; j < n; j++) {
        const real2 response = beam_response(c_sqrt((real2)(lam_re[j], lam_im[j])), 1.0 / mu0[beam], depth);
        const int pair = lam_im[j] != 0.0;
        for (int r = 0; r < per_beam; r++) {
            __global const real* y = c + (long)r * n + j;
            fed[(long)r * n + j] = response.x * y[0] + (pair ? response.y * y[1] : 0.0);
            if (pair)
                fed[(long)r * n + j + 1] = response.x * y[1] - response.y * y[0];
        }
        j += pair;
    }
}

// int e^(-k x) and int e^(-k (thickness - x)) times e^(-(x - depth)/mu) dx/mu over x from depth to the bottom.
void decaying_integrals(real2 k, real mu, real thickness, real depth, real2* from_top, real2* from_bottom)
{
    const real left = thickness - depth;
    const real2 rate = (real2)(1.0 + mu * k.x, mu * k.y);
    *from_bottom = (real2)(0.0);
    if (thickness > SEMI_INFINITE) {
        *from_top = over(c_exp(-depth * k), rate);
        return;
    }
    *from_top = over(times(c_exp(-depth * k), -c_expm1(-left * (real2)(k.x + 1.0 / mu, k.y))), rate);
    *from_bottom = (left / mu) * exp_difference(-left * k, (real2)(-left / mu, 0.0));
}

// int cosh(k t)/cosh(k h) and int sinh(k t)/(k cosh(k h)) times e^(-(x - depth)/mu) dx/mu over x from depth to the
// slab's bottom, t = x - h.
void hyperbolic_integrals(real2 k, real mu, real thickness, real depth, real2* cosine, real2* sine)
{
    const real left = thickness - depth, h = 0.5 * thickness;
    const real2 zero = (real2)(0.0), one = (real2)(1.0, 0.0);
    real2 from_top, from_bottom;
    decaying_integrals(k, mu, thickness, depth, &from_top, &from_bottom);
    const real2 whole = one + c_exp(-thickness * k);
    *cosine = over(from_top + from_bottom, whole);
    if (size_of(k) * thickness > 1.0) {
        *sine = over(from_bottom - from_top, times(k, whole));
        return;
    }
    // near k = 0: e^(k(depth - h)) times int e^(k(x - depth)) ..., differenced between k and -k
    const real2 plus = left * k - (left / mu) * one, minus = -left * k - (left / mu) * one;
    const real2 u = (2.0 * (depth - h)) * exp_difference((depth - h) * k, (h - depth) * k);
    const real2 v = (left / mu) * exp_difference(zero, plus);
    const real2 w = (2.0 * left * left / mu) * exp_difference_2(zero, plus, minus);
    *sine = over(0.5 * times(u, v) + 0.5 * times(c_exp((h - depth) * k), w), 0.5 * (c_exp(h * k) + c_exp(-h * k)));
}

// The same for a real mode, exponentials of its own and of the direction taken once: mode_decayed, e^(-left k), decayed,
// e^(-left/mu), at_far, e^(-far k).
void real_decaying_integrals(real k, real mu, real left, real mode_decayed, real decayed, real at_far,
                           real* from_top, real* from_bottom)
{
    if (left > SEMI_INFINITE) {
        *from_top = at_far / (1.0 + mu * k);
        *from_bottom = 0.0;
        return;
    }
    const real sum = left * (k + 1.0 / mu), gap = left / mu - left * k;
    *from_top = at_far * (sum > 1.0 ? 1.0 - mode_decayed * decayed : -expm1(-sum)) / (1.0 + mu * k);
    if (fabs(gap) > 1.0)
        *from_bottom = (left / mu) * ((mode_decayed - decayed) / gap);
    else if (gap == 0.0)
        *from_bottom = (left / mu) * mode_decayed;
    else
        *from_bottom = (left / mu) * (max(mode_decayed, decayed) * (-expm1(-fabs(gap)) / fabs(gap)));
}

// Light on its way along mu through a part of a layer to a depth below its top. left: the path times mu; far: depth of
// its end below the face that e^(-k x) decays from; decayed: e^(-left/mu); above: optical depth of the layer's top.
typedef struct {
    int upward, decaying;
    real mu, thickness, above, depth, left, far, decayed;
} Way;

// What even and odd modes become on the way; where they decay, those from the near and from the far face.
typedef struct {
    real2 even, odd;
} Integrals;

Integrals integrals_of(real2 k, const Way* way)
{
    const int upward = way->upward, decaying = way->decaying;
    const real mu = way->mu, thickness = way->thickness, left = way->left, far = way->far;
    Integrals found;
    if (k.y == 0.0 && (decaying || k.x * thickness > 1.0)) {
        real top, bottom;
        real_decaying_integrals(k.x, mu, left, exp(-left * k.x), way->decayed, exp(-far * k.x), &top, &bottom);
        if (decaying && !upward && thickness > SEMI_INFINITE)
            top = 0.0;
        const real whole = decaying ? 1.0 : 1.0 + exp(-thickness * k.x);
        found.even = (real2)(decaying ? (upward ? top : bottom) : (top + bottom) / whole, 0.0);
        found.odd = (real2)(decaying ? (upward ? bottom : top) : (bottom - top) / (k.x * whole), 0.0);
    } else if (!decaying) {
        hyperbolic_integrals(k, mu, thickness, far, &found.even, &found.odd);
    } else if (upward) {
        decaying_integrals(k, mu, thickness, far, &found.even, &found.odd);
    } else {
        found.odd = (real2)(0.0);
        if (thickness < SEMI_INFINITE)
            found.odd = over(times(c_exp(-far * k), -c_expm1(-left * (real2)(k.x + 1.0 / mu, k.y))),
                             (real2)(1.0 + mu * k.x, mu * k.y));
        found.even = (left / mu) * exp_difference(-left * k, (real2)(-left / mu, 0.0));
    }
    return found;
}

// Re and Im of a complex number times a column (re, im) of Stokes components.
#define TIMES_RE(f, re, im) ((f).x * (re) - (f).y * (im))
#define TIMES_IM(f, re, im) ((f).x * (im) + (f).y * (re))

// The columns of a mode's light, or of a pair's, in Stokes components of one direction.
typedef struct {
    real4 e_re, e_im, f_re, f_im;
} Lit;

Lit light_of(int stokes, int pair, __global const real* e, __global const real* f, int ld)
{
    const real4 none = (real4)(0.0);
    const Lit found = {stokes_at(stokes, e), pair ? stokes_at(stokes, e + ld) : none, stokes_at(stokes, f),
                       pair ? stokes_at(stokes, f + ld) : none};
    return found;
}

// What the amplitudes of even and odd modes and the coordinates of the beam's part, of zeta too, are multiplied by.
typedef struct {
    real4 even, odd, beam, zeta;
} Gains;

// For one mode or pair: the second of the gains is that of the pair's second coordinate.
void gains_of(real2 lam, const Way* way, const Lit* lit, Gains* gains)
{
    const real sign = way->upward ? -1.0 : 1.0;
    const real2 k = c_sqrt(lam);
    const Integrals found = integrals_of(k, way);
    const real2 even = 0.5 * found.even, odd = 0.5 * found.odd;
    const real2 bottom = (real2)(way->mu * k.x - sign, way->mu * k.y);
    const real2 share = size_of(bottom) < RESONANT ? (real2)(0.0) : over((real2)(0.5, 0.0), bottom);
    const real4 e_re = lit->e_re, e_im = lit->e_im, f_re = lit->f_re, f_im = lit->f_im;
    const real4 kf_re = sign * TIMES_RE(k, f_re, f_im), kf_im = sign * TIMES_IM(k, f_re, f_im);
    gains[0].beam = TIMES_RE(share, e_re + kf_re, e_im + kf_im);
    gains[1].beam = TIMES_IM(share, e_re + kf_re, e_im + kf_im);
    gains[0].zeta = 0.5 * sign * f_re;
    gains[1].zeta = 0.5 * sign * f_im;
    if (way->decaying) {
        gains[0].even = TIMES_RE(even, e_re + kf_re, e_im + kf_im);
        gains[1].even = TIMES_IM(even, e_re + kf_re, e_im + kf_im);
        gains[0].odd = TIMES_RE(odd, e_re - kf_re, e_im - kf_im);
        gains[1].odd = TIMES_IM(odd, e_re - kf_re, e_im - kf_im);
        return;
    }
    const real2 steep = times(lam, odd);
    gains[0].even = TIMES_RE(even, e_re, e_im) + TIMES_RE(steep, f_re, f_im);
    gains[1].even = TIMES_IM(even, e_re, e_im) + TIMES_IM(steep, f_re, f_im);
    gains[0].odd = -sign * (TIMES_RE(odd, e_re, e_im) + TIMES_RE(even, f_re, f_im));
    gains[1].odd = -sign * (TIMES_IM(odd, e_re, e_im) + TIMES_IM(even, f_re, f_im));
}

// Adds to light going down, `to` (n_rhs, rows), the beam's part of the modes with k mu close to 1, which `gains_of`
// leaves out.
void add_resonances(const Way* way, int n, int stokes, int rows, int n_in, int n_rhs, __global const real* lam_re,
                    __global const real* lam_im, __global const real* lit_e, __global const real* lit_f, int ld,
                    __global const real* c, __global const real* mu0, __global real* to)
{
    const real mu = way->mu, depth = way->depth;
    for (int j = 0, pair; j < n; j += 1 + pair) {
        const real2 k = c_sqrt((real2)(lam_re[j], lam_im[j]));
        pair = lam_im[j] != 0.0;
        if (size_of((real2)(mu * k.x - 1.0, mu * k.y)) >= RESONANT)
            continue;
        const Lit lit = light_of(stokes, pair, lit_e + (long)j * ld, lit_f + (long)j * ld, ld);
        const real4 re = lit.e_re + TIMES_RE(k, lit.f_re, lit.f_im), im = lit.e_im + TIMES_IM(k, lit.f_re, lit.f_im);
        for (int r = 0; r < n_rhs; r++) {
            const real beam = mu0[r / (n_rhs / n_in)];
            const real2 value = (0.5 * depth * depth / mu * exp(-way->above / beam))
                * exp_difference_2((real2)(-depth / mu, 0.0), -depth * k, (real2)(-depth / beam, 0.0));
            __global const real* y = c + (long)r * n + j;
            real4 sum = stokes_at(stokes, to + (long)r * rows) + y[0] * TIMES_RE(value, re, im);
            if (pair)
                sum += y[1] * TIMES_IM(value, re, im);
            put_stokes(stokes, to + (long)r * rows, sum);
        }
    }
}

// What a beam's coordinates are multiplied by: those of zeta, c, c D(depth) and c D(thickness).
typedef struct {
    real zeta, direct, here, whole;
} Shares;

// The path integral is int e^(-x/mu0) e^(-|x - depth|/mu) dx/mu over what lies below depth (upward) or above it.
Shares shares_of(const Way* way, real mu0)
{
    const real mu = way->mu, depth = way->depth, rate = 1.0 / mu + 1.0 / mu0, decay = exp(-way->above / mu0);
    const real path = way->upward ? exp(-depth / mu0) * -expm1(-way->left * rate) / (mu * rate)
        : (depth / mu) * exp_difference((real2)(-depth / mu0, 0.0), (real2)(-depth / mu, 0.0)).x;
    const int ends = way->upward && way->thickness < SEMI_INFINITE;
    const Shares found = {decay * path, mu * decay * path, depth == 0.0 ? 0.0 : way->upward ? decay : -decay,
                          ends ? -exp(-way->above / mu0 - way->left / mu) : 0.0};
    return found;
}

// Which way light takes to a stop.
Way way_to(int upward, int decaying, real mu, real thickness, real above, real depth)
{
    const real left = upward ? thickness - depth : depth;
    const real far = upward ? depth : thickness - left;    // by symmetry: down at depth is up at thickness - depth
    const Way found = {upward, decaying, mu, thickness, above, depth, left, far, exp(-left / mu)};
    return found;
}

// Four right-hand sides at once, their sums independent of each other; the last one stands in for those that are not there.
#define EACH_OF_FOUR(DO) DO(0, 0) DO(1, 0) DO(2, 1) DO(3, 2)
#define OPEN_COLUMN(x, before) \
    const int r##x = min(r + x, n_rhs - 1), beam##x = r##x / per_beam; \
    const Shares shares##x = x > 0 && beam##x == beam##before ? shares##before : shares_of(&way, mu0[beam##x]); \
    real4 sum##x = stokes_at(stokes, to + (long)r##x * rows);
#define ADD_MODE(x, before) { \
    const long at = (long)r##x * n + j; \
    const real coordinate = shares##x.direct * c[at] + shares##x.here * here[at] + shares##x.whole * whole[at]; \
    sum##x += gain.even * even[at] + gain.odd * odd[at] + gain.beam * coordinate \
        + gain.zeta * (shares##x.zeta * zeta[at]); }
#define CLOSE_COLUMN(x, before) put_stokes(stokes, to + (long)r##x * rows, sum##x);

// The source between a stop and the face that light comes from, into out (order, n_level, n_rhs, rows) at a level and
// into part (order, layer, n_rhs, rows) at a face. lit, fed: of `light_of_modes`, `feed_modes`; decays (order, layer).
// Global size: n_out, stops, orders.
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void sum_sources(COUNTS, int ld, IN lit, IN lam_re, IN lam_im, INTS decays, IN even, IN odd, IN c, IN zeta,
                          IN fed, PLACES, OUT out, OUT part)
{
    const int place = get_global_id(0), stop = get_global_id(1), upward = place < n_up, at_face = stop >= n_level;
    const int rows = stokes * get_global_size(0), layer = at_face ? stop - n_level : level_layer[stop];
    const long order = get_global_id(2), item = order * n_layer + layer;
    const long size = (long)n_rhs * rows, all = (long)n_rhs * n;
    const real depth = !at_face ? level[stop] : upward ? 0.0 : thickness[layer];
    const int per_beam = n_rhs / n_in;
    const Way way = way_to(upward, decays[item], mu_out[place], thickness[layer], above[layer], depth);
    __global real* to = (at_face ? part + item * size : out + (order * n_level + stop) * size) + stokes * place;
    __global const real* lit_e = lit + item * n * ld + stokes * place;
    __global const real* lit_f = lit_e + (long)get_global_size(2) * n_layer * n * ld;
    __global const real* fed_here = fed + (order * (n_level + n_layer) + stop) * all;
    __global const real* fed_whole = fed + (order * (n_level + n_layer) + n_level + layer) * all;
    Gains gains[BLOCK + 1];
    for (int r = 0; r < n_rhs; r++)
        put_stokes(stokes, to + (long)r * rows, (real4)(0.0));
    if (way.left == 0.0 || (at_face && layer == (upward ? 0 : n_layer - 1)))
        return;
    lam_re += item * n;
    lam_im += item * n;
    even += item * all;
    odd += item * all;
    c += item * all;
    zeta += item * all;
    if (!upward)
        add_resonances(&way, n, stokes, rows, n_in, n_rhs, lam_re, lam_im, lit_e, lit_f, ld, c, mu0, to);
    // what is not there is fed with nothing: any numbers will do for it
    __global const real* here = depth != 0.0 ? fed_here : c;
    __global const real* whole = upward && thickness[layer] < SEMI_INFINITE ? fed_whole : c;
    for (int begin = 0, end; begin < n; begin = end) {
        for (end = begin; end < min(begin + BLOCK, n); end += lam_im[end] != 0.0 ? 2 : 1) {
            const Lit light = light_of(stokes, lam_im[end] != 0.0, lit_e + (long)end * ld, lit_f + (long)end * ld, ld);
            Gains two[2];
            gains_of((real2)(lam_re[end], lam_im[end]), &way, &light, two);
            gains[end - begin] = two[0];
            if (lam_im[end] != 0.0)
                gains[end - begin + 1] = two[1];
        }
        for (int r = 0; r < n_rhs; r += 4) {
            EACH_OF_FOUR(OPEN_COLUMN)
            for (int j = begin; j < end; j++) {
                const Gains gain = gains[j - begin];
                EACH_OF_FOUR(ADD_MODE)
            }
            EACH_OF_FOUR(CLOSE_COLUMN)
        }
    }
}

// Adds what enters each layer, attenuated: from the base, base_out (row, n, rows) times base_down (order, n_rhs, n), a
// row of -1 for none, up through the layers, and from the top down. Global size: n_out, n_rhs, orders.
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void pass_layers(COUNTS, IN base_down, INTS base_row, IN base_out, PLACES, OUT out, IN part)
{
    const int place = get_global_id(0), r = get_global_id(1), upward = place < n_up;
    const int rows = stokes * get_global_size(0);
    const long order = get_global_id(2), here = (long)r * rows + stokes * place, size = (long)n_rhs * rows;
    const real mu = mu_out[place];
    real4 running = (real4)(0.0);
    if (upward && base_row[order] >= 0)
        for (int j = 0; j < n; j++)
            running += stokes_at(stokes, base_out + ((long)base_row[order] * n + j) * rows + stokes * place)
                * base_down[(order * n_rhs + r) * n + j];
    for (int step = 0; step < n_layer; step++) {
        const int layer = upward ? n_layer - 1 - step : step;
        for (int t = 0; t < n_level; t++)
            if (level_layer[t] == layer) {
                __global real* to = out + (order * n_level + t) * size + here;
                const real left = upward ? thickness[layer] - level[t] : level[t];
                put_stokes(stokes, to, stokes_at(stokes, to) + exp(-left / mu) * running);
            }
        if (step < n_layer - 1)
            running = exp(-thickness[layer] / mu) * running
                + stokes_at(stokes, part + (order * n_layer + layer) * size + here);
    }
}
