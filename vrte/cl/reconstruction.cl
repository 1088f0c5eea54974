// Reconstruction by source-function integration, (1:36)-(1:38), without singly scattered light. The equations are those
// of `reconstruct` in core/reconstruction.pxi, which explains them.
//
// Arrays as there: a mode's column has S n_out rows, those of light going up first; n modes a layer. Light is wanted at
// n_level depths; behind them stand the faces that it leaves each layer through: n_level + n_layer "stops" in all.

#define BLOCK 32      // modes that are summed over at once, one more where a pair would be cut

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

// c D(depth of the stop). Pieces: stops, n_in, orders.
KERNEL(1, feed_modes)
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
        const vrte_complex k = vrte_sqrt(vrte_pair(lam_re[j], lam_im[j]));
        const vrte_complex response = vrte_beam_response(k, 1.0 / mu0[beam], depth);
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

// Light on its way along mu through a part of a layer to a depth below its top: see core/kernels/paths.h; above: optical
// depth of the layer's top.
typedef struct {
    int upward, decaying;
    real mu, thickness, above, depth, left, far;
} Way;

Way way_to(int upward, int decaying, real mu, real thickness, real above, real depth)
{
    const real left = upward ? thickness - depth : depth;
    const real far = upward ? depth : thickness - left;    // by symmetry: down at depth is up at thickness - depth
    const Way found = {upward, decaying, mu, thickness, above, depth, left, far};
    return found;
}

// A mode's light, or a pair's, in Stokes components of a direction: rows of G_E X (e) and G_F Y (f).
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
void gains_of(vrte_complex lam, const Way* way, Lit lit, Gains* gains)
{
    const vrte_mode_gains of = vrte_gains_of_mode(vrte_sqrt(lam), way->upward, way->decaying, way->mu, way->left, way->far);
    const real halved = way->upward ? -0.5 : 0.5;
    vrte_apply_gain(of.even, lit.e_re, lit.e_im, lit.f_re, lit.f_im, &gains[0].even, &gains[1].even);
    vrte_apply_gain(of.odd, lit.e_re, lit.e_im, lit.f_re, lit.f_im, &gains[0].odd, &gains[1].odd);
    vrte_apply_gain(of.beam, lit.e_re, lit.e_im, lit.f_re, lit.f_im, &gains[0].beam, &gains[1].beam);
    gains[0].beam *= 0.5;
    gains[1].beam *= 0.5;
    gains[0].zeta = halved * lit.f_re;
    gains[1].zeta = halved * lit.f_im;
}

// Adds to light going down, `to` (n_rhs, rows), the beam's part of the modes with k mu close to 1, which `gains_of`
// leaves out.
void add_resonances(const Way* way, int n, int stokes, int rows, int n_in, int n_rhs, __global const real* lam_re,
                    __global const real* lam_im, __global const real* lit_e, __global const real* lit_f, int ld,
                    __global const real* c, __global const real* mu0, __global real* to)
{
    const real mu = way->mu, depth = way->depth;
    for (int j = 0, pair; j < n; j += 1 + pair) {
        const vrte_complex k = vrte_sqrt(vrte_pair(lam_re[j], lam_im[j]));
        pair = lam_im[j] != 0.0;
        if (vrte_size(vrte_pair(mu * k.x - 1.0, mu * k.y)) >= RESONANT)
            continue;
        const Lit lit = light_of(stokes, pair, lit_e + (long)j * ld, lit_f + (long)j * ld, ld);
        for (int r = 0; r < n_rhs; r++) {
            const real beam = mu0[r / (n_rhs / n_in)];
            const vrte_complex passed = vrte_pair(-depth / mu, 0.0), fed = vrte_pair(-depth / beam, 0.0);
            vrte_complex gain[2] = {vrte_second_difference(passed, vrte_scaled(-depth, k), fed)};
            real4 re, im;
            gain[0] = vrte_scaled(0.5 * depth * depth / mu * exp(-way->above / beam), gain[0]);
            gain[1] = vrte_times(gain[0], k);
            vrte_apply_gain(gain, lit.e_re, lit.e_im, lit.f_re, lit.f_im, &re, &im);
            __global const real* y = c + (long)r * n + j;
            put_stokes(stokes, to + (long)r * rows, stokes_at(stokes, to + (long)r * rows) + y[0] * re + (pair ? y[1] * im : 0.0));
        }
    }
}

// What a beam's coordinates are multiplied by: those of zeta, c, c D(depth) and c D(thickness).
typedef struct {
    real zeta, direct, here, whole;
} Shares;

Shares shares_of(const Way* way, real mu0)
{
    const real decay = exp(-way->above / mu0);
    const real path = decay * vrte_beam_path(way->upward, way->mu, mu0, way->left, way->depth);
    const int ends = way->upward && way->thickness < SEMI_INFINITE;
    const Shares found = {path, way->mu * path, way->depth == 0.0 ? 0.0 : way->upward ? decay : -decay,
                          ends ? -exp(-way->above / mu0 - way->left / way->mu) : 0.0};
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

// The source between a stop and the face that light comes from, into out at a level and into part at a face. Pieces: n_out,
// stops, orders.
KERNEL(1, sum_sources)
{
    const int place = get_global_id(0), stop = get_global_id(1), upward = place < n_up, at_face = stop >= n_level;
    const int rows = stokes * get_global_size(0), layer = at_face ? stop - n_level : level_layer[stop];
    const long order = get_global_id(2), item = order * n_layer + layer;
    const long size = (long)n_rhs * rows, all = (long)n_rhs * n;
    const real depth = !at_face ? level[stop] : upward ? 0.0 : thickness[layer];
    const int per_beam = n_rhs / n_in;
    const Way way = way_to(upward, decaying[item], mu_out[place], thickness[layer], above[layer], depth);
    __global real* to = (at_face ? part + item * size : out + (order * n_level + stop) * size) + stokes * place;
    __global const real* fed_here = fed + (order * (n_level + n_layer) + stop) * all;
    __global const real* fed_whole = fed + (order * (n_level + n_layer) + n_level + layer) * all;
    Gains gains[BLOCK + 1];
    for (int r = 0; r < n_rhs; r++)
        put_stokes(stokes, to + (long)r * rows, (real4)(0.0));
    if (way.left == 0.0 || (at_face && layer == (upward ? 0 : n_layer - 1)))
        return;
    lit_e = OF_ITEM(lit_e) + stokes * place;
    lit_f = OF_ITEM(lit_f) + stokes * place;
    lam_re += item * n;
    lam_im += item * n;
    even += item * all;
    odd += item * all;
    c += item * all;
    zeta += item * all;
    if (!upward)
        add_resonances(&way, n, stokes, rows, n_in, n_rhs, lam_re, lam_im, lit_e, lit_f, lit_e_ld, c, mu0, to);
    // what is not there is fed with nothing: any numbers will do for it
    __global const real* here = depth != 0.0 ? fed_here : c;
    __global const real* whole = upward && thickness[layer] < SEMI_INFINITE ? fed_whole : c;
    for (int begin = 0, end; begin < n; begin = end) {
        for (end = begin; end < min(begin + BLOCK, n); end += lam_im[end] != 0.0 ? 2 : 1) {
            Gains two[2];
            const Lit lit = light_of(stokes, lam_im[end] != 0.0, lit_e + (long)end * lit_e_ld, lit_f + (long)end * lit_f_ld,
                                     lit_e_ld);
            gains_of(vrte_pair(lam_re[end], lam_im[end]), &way, lit, two);
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
