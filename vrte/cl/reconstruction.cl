// Reconstruction by source-function integration, (1:36)-(1:38), without singly scattered light. The equations are those of
// `reconstruct` in _core.pyx, which explains them.
//
// Arrays as there: a mode's column has S n_out rows, those of light going up first; n modes a layer. Light is wanted at
// `n_level` depths; behind them stand the faces that it leaves each layer through: the "stops", n_level + n_layer of them.

#define BLOCK 32      // modes that are summed over at once, one more where a pair would be cut

typedef double4 loose4 __attribute__((aligned(8)));     // where no alignment can be counted on

// Up to four Stokes components of a direction.
double4 stokes_at(int stokes, __global const double* p)
{
    if (stokes == 4)
        return *(__global const loose4*)p;
    return (double4)(p[0], stokes > 1 ? p[1] : 0.0, stokes > 2 ? p[2] : 0.0, 0.0);
}

void put_stokes(int stokes, __global double* p, double4 value)
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
// rows), X (item, n, n). Where a strip ends behind its column it reads the next one: the last term alone must not.
// Global size: strips of 8 rows, items, 2.
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void light_of_modes(int n, int rows, int ld, __global const double* restrict G_E, __global const double* restrict G_F,
                             __global const double* restrict X, __global const double* restrict Y,
                             __global double* restrict lit)
{
    const long item = get_global_id(1), first = 8 * get_global_id(0);
    const int columns = n, c_ld = ld, b_column = n, b_row = 1;
    __global const double* A = (get_global_id(2) ? G_F : G_E) + item * n * rows + first;
    __global const double* B = (get_global_id(2) ? Y : X) + item * n * n;
    __global double* C = lit + (get_global_id(2) * get_global_size(1) + item) * n * ld + first;
    for (int j = 0; j < columns; j += TILE_COLUMNS) {
        __global const double* a = A;
        EACH_COLUMN(COLUMN_OF_B)
        EACH_COLUMN(NO_SUMS)
        int k = 0;
        for (; k < n - 1; k++) {
            const double4 a_top = *(__global const loose4*)a, a_low = *(__global const loose4*)(a + 4);
            EACH_COLUMN(ADD_TERM)
            a += rows;
        }
        const int left = rows - first;
        const double4 a_top = (double4)(a[0], left > 1 ? a[1] : 0.0, left > 2 ? a[2] : 0.0, left > 3 ? a[3] : 0.0);
        const double4 a_low = (double4)(left > 4 ? a[4] : 0.0, left > 5 ? a[5] : 0.0, left > 6 ? a[6] : 0.0, left > 7 ? a[7] : 0.0);
        EACH_COLUMN(ADD_TERM)
        EACH_COLUMN(STORE_SUMS)
    }
}

// fed (order, stop, n_rhs, n) = c D(depth of the stop), nothing where that is 0 or infinite. Global size: stops, n_in, orders.
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void feed_modes(int n, int n_layer, int n_level, int n_rhs, __global const double* restrict lam_re,
                         __global const double* restrict lam_im, __global const double* restrict c,
                         __global const double* restrict mu0, __global const double* restrict thickness,
                         __global const double* restrict level, __global const int* restrict level_layer,
                         __global double* restrict fed)
{
    const int stop = get_global_id(0), beam = get_global_id(1), per_beam = n_rhs / get_global_size(1);
    const int layer = stop < n_level ? level_layer[stop] : stop - n_level;
    const double depth = stop < n_level ? level[stop] : thickness[layer];
    const long item = get_global_id(2) * n_layer + layer;
    if (depth == 0.0 || depth > 1e300)
        return;
    lam_re += item * n;
    lam_im += item * n;
    c += (item * n_rhs + beam * per_beam) * n;
    fed += ((get_global_id(2) * (n_level + n_layer) + stop) * n_rhs + beam * per_beam) * n;
    for (int j = 0; j < n; j++) {
        const double2 response = beam_response(c_sqrt((double2)(lam_re[j], lam_im[j])), 1.0 / mu0[beam], depth);
        const int pair = lam_im[j] != 0.0;
        for (int r = 0; r < per_beam; r++) {
            __global const double* y = c + (long)r * n + j;
            fed[(long)r * n + j] = response.x * y[0] + (pair ? response.y * y[1] : 0.0);
            if (pair)
                fed[(long)r * n + j + 1] = response.x * y[1] - response.y * y[0];
        }
        j += pair;
    }
}

// int e^(-k x) and int e^(-k (thickness - x)) times e^(-(x - depth)/mu) dx/mu over x from depth to the bottom.
void fading_integrals(double2 k, double mu, double thickness, double depth, double2* from_top, double2* from_bottom)
{
    const double left = thickness - depth;
    const double2 rate = (double2)(1.0 + mu * k.x, mu * k.y);
    *from_bottom = (double2)(0.0);
    if (thickness > 1e300) {
        *from_top = over(c_exp(-depth * k), rate);
        return;
    }
    *from_top = over(times(c_exp(-depth * k), -c_expm1(-left * (double2)(k.x + 1.0 / mu, k.y))), rate);
    *from_bottom = (left / mu) * exp_difference(-left * k, (double2)(-left / mu, 0.0));
}

// int cosh(k t)/cosh(k h) and int sinh(k t)/(k cosh(k h)) times e^(-(x - depth)/mu) dx/mu over x from depth to the slab's
// bottom, t = x - h.
void hyperbolic_integrals(double2 k, double mu, double thickness, double depth, double2* cosine, double2* sine)
{
    const double left = thickness - depth, h = 0.5 * thickness;
    const double2 zero = (double2)(0.0), one = (double2)(1.0, 0.0);
    double2 from_top, from_bottom;
    fading_integrals(k, mu, thickness, depth, &from_top, &from_bottom);
    const double2 whole = one + c_exp(-thickness * k);
    *cosine = over(from_top + from_bottom, whole);
    if (size_of(k) * thickness > 1.0) {
        *sine = over(from_bottom - from_top, times(k, whole));
        return;
    }
    // near k = 0: e^(k(depth - h)) times int e^(k(x - depth)) ..., differenced between k and -k
    const double2 plus = left * k - (left / mu) * one, minus = -left * k - (left / mu) * one;
    const double2 u = (2.0 * (depth - h)) * exp_difference((depth - h) * k, (h - depth) * k);
    const double2 v = (left / mu) * exp_difference(zero, plus);
    const double2 w = (2.0 * left * left / mu) * exp_difference_2(zero, plus, minus);
    *sine = over(0.5 * times(u, v) + 0.5 * times(c_exp((h - depth) * k), w), 0.5 * (c_exp(h * k) + c_exp(-h * k)));
}

// The same for a real mode, exponentials of its own and of the direction taken once: mode_faded, e^(-left k), faded,
// e^(-left/mu), at_far, e^(-far k).
void real_fading_integrals(double k, double mu, double left, double mode_faded, double faded, double at_far,
                           double* from_top, double* from_bottom)
{
    if (left > 1e300) {
        *from_top = at_far / (1.0 + mu * k);
        *from_bottom = 0.0;
        return;
    }
    const double sum = left * (k + 1.0 / mu), gap = left / mu - left * k;
    *from_top = at_far * (sum > 1.0 ? 1.0 - mode_faded * faded : -expm1(-sum)) / (1.0 + mu * k);
    if (fabs(gap) > 1.0)
        *from_bottom = (left / mu) * ((mode_faded - faded) / gap);
    else if (gap == 0.0)
        *from_bottom = (left / mu) * mode_faded;
    else
        *from_bottom = (left / mu) * (max(mode_faded, faded) * (-expm1(-fabs(gap)) / fabs(gap)));
}

typedef struct {
    double2 cosine, sine;      // of the even and the odd mode; where modes fade, from the top and from the bottom (up)
} Integrals;

// What the modes of one layer send to `depth` along mu: far is the depth below the face that e^(-k x) fades from.
Integrals integrals_of(double2 k, int upward, int fading, double thickness, double left, double far, double mu, double faded)
{
    Integrals found;
    if (k.y == 0.0 && (fading || k.x * thickness > 1.0)) {
        double from_top, from_bottom;
        real_fading_integrals(k.x, mu, left, exp(-left * k.x), faded, exp(-far * k.x), &from_top, &from_bottom);
        if (fading && !upward && thickness > 1e300)
            from_top = 0.0;
        const double whole = fading ? 1.0 : 1.0 + exp(-thickness * k.x);
        const double even = fading ? (upward ? from_top : from_bottom) : (from_top + from_bottom) / whole;
        const double odd = fading ? (upward ? from_bottom : from_top) : (from_bottom - from_top) / (k.x * whole);
        found.cosine = (double2)(even, 0.0);
        found.sine = (double2)(odd, 0.0);
    } else if (!fading) {
        hyperbolic_integrals(k, mu, thickness, far, &found.cosine, &found.sine);
    } else if (upward) {
        fading_integrals(k, mu, thickness, far, &found.cosine, &found.sine);
    } else {
        found.sine = (double2)(0.0);
        if (thickness < 1e300)
            found.sine = over(times(c_exp(-far * k), -c_expm1(-left * (double2)(k.x + 1.0 / mu, k.y))),
                              (double2)(1.0 + mu * k.x, mu * k.y));
        found.cosine = (left / mu) * exp_difference(-left * k, (double2)(-left / mu, 0.0));
    }
    return found;
}

// Re and Im of a complex number times a column (re, im) of Stokes components.
#define TIMES_RE(f, re, im) ((f).x * (re) - (f).y * (im))
#define TIMES_IM(f, re, im) ((f).x * (im) + (f).y * (re))

// Columns of what the amplitudes, even and odd, and the beam's coordinates are multiplied by, for one mode or pair: the
// second of each is that of the pair's second coordinate.
void gains_of(double2 lam, int upward, int fading, double thickness, double left, double far, double mu, double faded,
              double4 e_re, double4 e_im, double4 f_re, double4 f_im, double4* even, double4* odd, double4* beam)
{
    const double sign = upward ? -1.0 : 1.0;
    const double2 k = c_sqrt(lam);
    const Integrals found = integrals_of(k, upward, fading, thickness, left, far, mu, faded);
    const double2 c = 0.5 * found.cosine, s = 0.5 * found.sine, bottom = (double2)(mu * k.x - sign, mu * k.y);
    const double2 share = size_of(bottom) < 0.02 ? (double2)(0.0) : over((double2)(1.0, 0.0), bottom);
    const double4 kf_re = TIMES_RE(k, f_re, f_im), kf_im = TIMES_IM(k, f_re, f_im);
    const double4 along_re = e_re + sign * kf_re, along_im = e_im + sign * kf_im;
    beam[0] = 0.5 * TIMES_RE(share, along_re, along_im);
    beam[1] = 0.5 * TIMES_IM(share, along_re, along_im);
    if (fading) {
        const double4 back_re = e_re - sign * kf_re, back_im = e_im - sign * kf_im;
        even[0] = TIMES_RE(c, along_re, along_im);
        even[1] = TIMES_IM(c, along_re, along_im);
        odd[0] = TIMES_RE(s, back_re, back_im);
        odd[1] = TIMES_IM(s, back_re, back_im);
        return;
    }
    const double2 steep = times(lam, s);
    even[0] = TIMES_RE(c, e_re, e_im) + TIMES_RE(steep, f_re, f_im);
    even[1] = TIMES_IM(c, e_re, e_im) + TIMES_IM(steep, f_re, f_im);
    odd[0] = -sign * (TIMES_RE(s, e_re, e_im) + TIMES_RE(c, f_re, f_im));
    odd[1] = -sign * (TIMES_IM(s, e_re, e_im) + TIMES_IM(c, f_re, f_im));
}

// The beam's part of a mode with k mu close to 1, which `gains_of` leaves out, over e^(-above/mu0).
double2 resonance(double2 k, double mu, double mu0, double depth)
{
    return (0.5 * depth * depth / mu) * exp_difference_2((double2)(-depth / mu, 0.0), -depth * k, (double2)(-depth / mu0, 0.0));
}

// int e^(-x/mu0) e^(-|x - depth|/mu) dx/mu over what lies below depth (upward) or above it.
double beam_path(int upward, double mu, double mu0, double thickness, double depth)
{
    const double rate = 1.0 / mu + 1.0 / mu0;
    if (upward)
        return exp(-depth / mu0) * -expm1(-(thickness - depth) * rate) / (mu * rate);
    return (depth / mu) * exp_difference((double2)(-depth / mu0, 0.0), (double2)(-depth / mu, 0.0)).x;
}

// The source between a stop and the face that light comes from, into out (order, n_level, n_rhs, rows) at a level and into
// part (order, layer, n_rhs, rows) at a face. lit: of `light_of_modes`; fades (order, layer). Global size: n_out, stops, orders.
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void sum_sources(int n, int stokes, int n_up, int ld, int n_layer, int n_level, int n_in, int n_rhs,
                          __global const double* restrict lit, __global const double* restrict lam_re,
                          __global const double* restrict lam_im, __global const int* restrict fades,
                          __global const double* restrict even, __global const double* restrict odd,
                          __global const double* restrict c, __global const double* restrict zeta,
                          __global const double* restrict fed, __global const double* restrict thicknesses,
                          __global const double* restrict aboves, __global const double* restrict mu0,
                          __global const double* restrict mu_out, __global const double* restrict level,
                          __global const int* restrict level_layer, __global double* restrict out, __global double* restrict part)
{
    const int place = get_global_id(0), stop = get_global_id(1), upward = place < n_up, at_face = stop >= n_level;
    const int rows = stokes * get_global_size(0), layer = at_face ? stop - n_level : level_layer[stop];
    const long order = get_global_id(2), item = order * n_layer + layer, size = (long)n_rhs * rows, all = (long)n_rhs * n;
    const double mu = mu_out[place], thickness = thicknesses[layer], above = aboves[layer];
    const double depth = !at_face ? level[stop] : upward ? 0.0 : thickness;
    const double left = upward ? thickness - depth : depth;      // optical path over mu
    const double far = upward ? depth : thickness - left;        // by symmetry about the middle, down at depth is up at T - depth
    const double faded = exp(-left / mu);
    const int fading = fades[item], per_beam = n_rhs / n_in;
    __global double* to = (at_face ? part + item * size : out + (order * n_level + stop) * size) + stokes * place;
    __global const double* lit_e = lit + item * n * ld + stokes * place;
    __global const double* lit_f = lit_e + (long)get_global_size(2) * n_layer * n * ld;
    __global const double* fed_here = fed + (order * (n_level + n_layer) + stop) * all;
    __global const double* fed_whole = fed + (order * (n_level + n_layer) + n_level + layer) * all;
    const int feeds_here = depth > 0.0, feeds_whole = upward && thickness < 1e300;
    double4 of_even[BLOCK + 1], of_odd[BLOCK + 1], of_beam[BLOCK + 1], of_zeta[BLOCK + 1];
    for (int r = 0; r < n_rhs; r++)
        put_stokes(stokes, to + (long)r * rows, (double4)(0.0));
    if (left == 0.0 || (at_face && layer == (upward ? 0 : n_layer - 1)))
        return;
    lam_re += item * n;
    lam_im += item * n;
    even += item * all;
    odd += item * all;
    c += item * all;
    zeta += item * all;
    for (int begin = 0, end; begin < n; begin = end) {
        for (end = begin; end < min(begin + BLOCK, n); ) {
            const int pair = lam_im[end] != 0.0, x = end - begin;
            const double2 lam = (double2)(lam_re[end], lam_im[end]);
            const double4 e_re = stokes_at(stokes, lit_e + (long)end * ld), f_re = stokes_at(stokes, lit_f + (long)end * ld);
            const double4 e_im = pair ? stokes_at(stokes, lit_e + (long)(end + 1) * ld) : (double4)(0.0);
            const double4 f_im = pair ? stokes_at(stokes, lit_f + (long)(end + 1) * ld) : (double4)(0.0);
            double4 evens[2], odds[2], beams[2];
            gains_of(lam, upward, fading, thickness, left, far, mu, faded, e_re, e_im, f_re, f_im, evens, odds, beams);
            of_zeta[x] = (upward ? -0.5 : 0.5) * f_re;
            if (pair)
                of_zeta[x + 1] = (upward ? -0.5 : 0.5) * f_im;
            for (int y = 0; y < 1 + pair; y++) {
                of_even[x + y] = evens[y];
                of_odd[x + y] = odds[y];
                of_beam[x + y] = beams[y];
            }
            const double2 k = c_sqrt(lam);
            if (!upward && size_of((double2)(mu * k.x - 1.0, mu * k.y)) < 0.02)
                for (int r = 0; r < n_rhs; r++) {
                    const double2 value = exp(-above / mu0[r / per_beam]) * resonance(k, mu, mu0[r / per_beam], depth);
                    const double4 re = e_re + TIMES_RE(k, f_re, f_im), im = e_im + TIMES_IM(k, f_re, f_im);
                    __global const double* y = c + (long)r * n + end;
                    const double4 gained = TIMES_RE(value, re, im) * y[0] + (pair ? TIMES_IM(value, re, im) * y[1] : (double4)(0.0));
                    put_stokes(stokes, to + (long)r * rows, stokes_at(stokes, to + (long)r * rows) + gained);
                }
            end += 1 + pair;
        }
        double light = 0.0, by_light = 0.0, by_here = 0.0, by_whole = 0.0;      // of a beam
        for (int r = 0; r < n_rhs; r++) {
            if (r % per_beam == 0) {
                const double beam = mu0[r / per_beam], fade = exp(-above / beam);
                light = fade * beam_path(upward, mu, beam, thickness, depth);
                by_light = mu * light;
                by_here = upward ? fade : -fade;
                by_whole = exp(-above / beam - left / mu);
            }
            double4 sum = stokes_at(stokes, to + (long)r * rows);
            for (int j = begin; j < end; j++) {
                const long at = (long)r * n + j;
                double coordinate = by_light * c[at];
                if (feeds_here)
                    coordinate += by_here * fed_here[at];
                if (feeds_whole)
                    coordinate -= by_whole * fed_whole[at];
                sum += of_even[j - begin] * even[at] + of_odd[j - begin] * odd[at] + of_beam[j - begin] * coordinate
                    + of_zeta[j - begin] * (light * zeta[at]);
            }
            put_stokes(stokes, to + (long)r * rows, sum);
        }
    }
}

// Adds what enters each layer, attenuated: from the base, base_out (row, n, rows) times base_down (order, n_rhs, n), row -1 for
// none, up through the layers, and from the top down. Global size: n_out, n_rhs, orders.
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void pass_layers(int n, int stokes, int n_up, int n_layer, int n_level, __global const double* restrict base_down,
                          __global const int* restrict base_row, __global const double* restrict base_out,
                          __global const double* restrict thickness, __global const double* restrict mu_out,
                          __global const double* restrict level, __global const int* restrict level_layer,
                          __global double* restrict out, __global const double* restrict part)
{
    const int place = get_global_id(0), r = get_global_id(1), upward = place < n_up, n_rhs = get_global_size(1);
    const int rows = stokes * get_global_size(0);
    const long order = get_global_id(2), here = (long)r * rows + stokes * place, size = (long)n_rhs * rows;
    const double mu = mu_out[place];
    double4 running = (double4)(0.0);
    if (upward && base_row[order] >= 0)
        for (int j = 0; j < n; j++)
            running += stokes_at(stokes, base_out + ((long)base_row[order] * n + j) * rows + stokes * place)
                * base_down[(order * n_rhs + r) * n + j];
    for (int step = 0; step < n_layer; step++) {
        const int layer = upward ? n_layer - 1 - step : step;
        for (int t = 0; t < n_level; t++)
            if (level_layer[t] == layer) {
                __global double* to = out + (order * n_level + t) * size + here;
                const double left = upward ? thickness[layer] - level[t] : level[t];
                put_stokes(stokes, to, stokes_at(stokes, to) + exp(-left / mu) * running);
            }
        if (step < n_layer - 1)
            running = exp(-thickness[layer] / mu) * running + stokes_at(stokes, part + (order * n_layer + layer) * size + here);
    }
}
