// Impedance doubling: `double_one` of core/doubling.pxi, whose equations these are. A work-group takes a slab of an order.

// A slab of an order, (item,), and how far it is: `from`, the item of its E and F; slowest, a guess from below of the
// slowest decay of a semi-infinite one; steepest, its largest rate, at first that of a direction; h, half the thickness
// doubled so far; ratio, the smallest over the largest eigenvalue of sqrt(Zo Ze); left, how many doublings; carried,
// whether C is.
typedef struct {
    real thickness, albedo, slowest, steepest, h, ratio;
    int from, turned, clear, conservative, left, carried, doublings, singular;
} Slab;

typedef struct {
    Sizes s;
    Slab slab;
    __global real *mine, *R, *T;
    Inverting with;
    __global const real* rates;
    real measured[6];
} Work;

#define OPEN_SLAB \
    __local real size[LANES], row[PANEL]; \
    __local int place[LANES]; \
    const long item = items[get_group_id(0)]; \
    const Sizes s = make_sizes(n, n_rhs, n_out_rows, stokes); \
    const long each = size_extended(s); \
    Work w = {s, slabs[item], room + item * 8 * each, R + item * each, T + item * each, \
              {rest + item * (long)n * PANEL, pivots + item * n, {size, place, row}}, rates + n, {0.0}};
#define CLOSE_SLAB \
    TOGETHER \
    if (LANE == 0) \
        slabs[item] = w.slab;

// An operation on a slab's matrices, where it has all of `when`: c = alpha times a b, or alpha times a + beta b + gamma 1.
// Compilers write out each call of a function: so there are lists of operations, and one call of each.
typedef struct {
    int kind, when, a, b, c, times;
    real alpha, beta, gamma;
} Operation;

enum { e_, f_, Ze_, Zo_, C_, a_, b_, spare_, R_, T_ };
enum { PRODUCT, COMBINE, INVERT, STRAIGHT, BLOCKS, BEGIN, CARRY, DIFFERENCE, NEXT, MIRROR, LOSE, LEAD, DIVIDE, MEASURE };
enum { FINITE = 1, ENDLESS = 2, THIN = 4, THICK_ENDS = 8, THICKER = 16, TURNED = 32, FORMING = 64, CARRIED = 128, LATE = 256 };
enum { ONE, H, H_SQUARED, OVER_STEEPEST, OVER_RATIO };       // times
enum { TANH, COMPLEMENT, NOTHING };                          // b of STRAIGHT: OO and II of c
enum { N_N, ON_N, N_NI, ON_NI };                             // times of BLOCKS: of a and b, into that of c

// What the doublings begin with, A = F E: of finite slabs Ze = E f, Zo = f F, f = tanh(h sqrt A)/sqrt A by the seventh
// convergent of tanh's continued fraction, above/below, which C and spare hold.
__constant const Operation START[] = {
    {PRODUCT, 0, f_, e_, a_, ONE, 1.0},
    {BEGIN},
    {COMBINE, FINITE, a_, a_, a_, H_SQUARED, 1.0},
    {COMBINE, FINITE, a_, a_, C_, ONE, 17325.0, 0.0, 135135.0},
    {COMBINE, FINITE, a_, a_, spare_, ONE, 62370.0, 0.0, 135135.0},
    {PRODUCT, FINITE, a_, a_, b_, ONE, 1.0},
    {COMBINE, FINITE, C_, b_, C_, ONE, 1.0, 378.0},
    {COMBINE, FINITE, spare_, b_, spare_, ONE, 1.0, 3150.0},
    {PRODUCT, FINITE, a_, b_, Ze_, ONE, 1.0},
    {COMBINE, FINITE, C_, Ze_, C_, ONE, 1.0, 1.0},
    {COMBINE, FINITE, spare_, Ze_, spare_, ONE, 1.0, 28.0},
    {INVERT, FINITE, spare_, b_},
    {PRODUCT, FINITE, spare_, C_, a_, H, 1.0},
    {PRODUCT, FINITE, e_, a_, Ze_, ONE, 1.0},
    {PRODUCT, FINITE, a_, f_, Zo_, ONE, 1.0},
    {STRAIGHT, FINITE, 0, TANH, Ze_},
    {STRAIGHT, FINITE, 0, TANH, Zo_},
    {COMBINE, ENDLESS, e_, e_, Ze_, OVER_STEEPEST, 1.0},
    {COMBINE, ENDLESS, f_, f_, Zo_, OVER_STEEPEST, 1.0},
};

// One doubling, L = 1 + Zo Ze: Zo <- 2 L^-1 Zo, Ze <- 2 Ze L^-1. Of a finite slab C = 1 - Zo Ze is formed while that keeps
// its digits, then carried, C <- (C L^-1)^2; of a semi-infinite one, where Zo Ze = 1, both are first multiplied by
// ratio^(-1/2).
__constant const Operation DOUBLE[] = {
    {COMBINE, ENDLESS, Ze_, Ze_, Ze_, OVER_RATIO, 1.0},
    {COMBINE, ENDLESS, Zo_, Zo_, Zo_, OVER_RATIO, 1.0},
    {PRODUCT, 0, Zo_, Ze_, a_, ONE, 1.0},
    {COMBINE, FORMING, a_, a_, C_, ONE, -1.0, 0.0, 1.0},
    {STRAIGHT, FORMING, 0, COMPLEMENT, C_},
    {CARRY, FORMING},
    {DIFFERENCE, ENDLESS},
    {COMBINE, 0, a_, a_, a_, ONE, 1.0, 0.0, 1.0},
    {INVERT, 0, a_, spare_},
    {PRODUCT, 0, a_, Zo_, b_, ONE, 2.0},
    {COMBINE, 0, b_, b_, Zo_, ONE, 1.0},
    {PRODUCT, 0, Ze_, a_, b_, ONE, 2.0},
    {COMBINE, 0, b_, b_, Ze_, ONE, 1.0},
    {NEXT},
    {MIRROR, FINITE | TURNED},
    {STRAIGHT, FINITE, 0, TANH, Ze_},
    {STRAIGHT, FINITE, 0, TANH, Zo_},
    {PRODUCT, CARRIED, C_, a_, b_, ONE, 1.0},
    {PRODUCT, CARRIED, b_, b_, C_, ONE, 1.0},
    {STRAIGHT, CARRIED, 0, COMPLEMENT, C_},
};

// R = So - Se and T = (1 + Zo)^-1 C (1 + Ze)^-1; semi-infinite: R = 1 - 2 Se and T = 0. Then alpha and beta, of what adds a
// thin layer, in a and b: added on top and taken off below it changes nothing. Of thick slabs that gives R's OI anew, from
// R's and T's other blocks, (1/mu + 1/mu0) R = -(alpha R + R alpha + R beta R - T beta T); of all, how far it is from
// true: beta + alpha R + R alpha + R beta R = T beta T and (alpha + R beta) T = T (alpha + beta R).
__constant const Operation END[] = {
    {PRODUCT, LATE, Zo_, Ze_, a_, ONE, 1.0},
    {COMBINE, LATE, a_, a_, C_, ONE, -1.0, 0.0, 1.0},
    {STRAIGHT, LATE, 0, COMPLEMENT, C_},
    {COMBINE, 0, Ze_, Ze_, a_, ONE, 1.0, 0.0, 1.0},
    {INVERT, 0, a_, spare_},
    {PRODUCT, FINITE, Ze_, a_, R_, ONE, -1.0},
    {PRODUCT, ENDLESS, Ze_, a_, R_, ONE, -2.0},
    {LOSE, TURNED},
    {COMBINE, ENDLESS, R_, R_, R_, ONE, 1.0, 0.0, 1.0},
    {PRODUCT, FINITE, C_, a_, b_, ONE, 1.0},
    {COMBINE, FINITE, Zo_, Zo_, a_, ONE, 1.0, 0.0, 1.0},
    {INVERT, FINITE, a_, spare_},
    {PRODUCT, FINITE, a_, b_, T_, ONE, 1.0},
    {COMBINE, THICK_ENDS, R_, a_, R_, ONE, 1.0, -1.0, 1.0},    // Zo may be as large as the slab is thick
    {PRODUCT, THIN, Zo_, a_, b_, ONE, 1.0},                    // Zo may be small
    {COMBINE, THIN, R_, b_, R_, ONE, 1.0, 1.0},
    {STRAIGHT, 0, 0, NOTHING, R_},
    {COMBINE, 0, e_, f_, a_, ONE, 0.5, 0.5},
    {COMBINE, 0, e_, f_, b_, ONE, 0.5, -0.5},
    {COMBINE, THICKER, a_, a_, spare_, ONE, 1.0},
    {BLOCKS, THICKER, b_, R_, spare_, N_NI, 1.0, 1.0},
    {BLOCKS, THICKER, R_, spare_, R_, ON_NI, -1.0},
    {LEAD, THICKER},
    {BLOCKS, THICKER, b_, T_, spare_, N_NI, 1.0, 1.0},
    {BLOCKS, THICKER, T_, spare_, R_, ON_NI, 1.0, 1.0},
    {BLOCKS, THICKER, a_, R_, R_, ON_NI, -1.0, 1.0},
    {BLOCKS, THICKER, spare_, T_, R_, ON_NI, 1.0, 1.0},
    {DIVIDE, THICKER},
    {COMBINE, 0, a_, a_, e_, ONE, 1.0},
    {BLOCKS, 0, R_, b_, e_, N_N, 1.0, 1.0},
    {BLOCKS, 0, R_, a_, spare_, N_N, 1.0},
    {MEASURE, 0, a_, 0},
    {MEASURE, 0, spare_, 1},
    {MEASURE, 0, b_, 2},
    {COMBINE, 0, spare_, b_, spare_, ONE, 1.0, 1.0},
    {BLOCKS, 0, e_, R_, spare_, N_N, 1.0, 1.0},
    {BLOCKS, FINITE, T_, b_, f_, N_N, 1.0},
    {BLOCKS, FINITE, f_, T_, spare_, N_N, -1.0, 1.0},
    {MEASURE, 0, spare_, 3},
    {BLOCKS, FINITE, e_, T_, spare_, N_N, 1.0},
    {MEASURE, FINITE, spare_, 4},
    {BLOCKS, FINITE, T_, a_, spare_, N_N, -1.0, 1.0},
    {BLOCKS, FINITE, f_, R_, spare_, N_N, -1.0, 1.0},
    {MEASURE, FINITE, spare_, 5},
};

#define LENGTH(list) (int)(sizeof(list) / sizeof(list[0]))

Extended matrix_of(const Work* w, int which)
{
    return extended_at(w->s, which == R_ ? w->R : which == T_ ? w->T : w->mine, which >= R_ ? 0 : which);
}

int conditions_of(Slab slab)
{
    const bool finite = slab.thickness < SEMI_INFINITE, thick = slab.thickness > THICK;
    return (finite ? FINITE : ENDLESS) | (!thick ? THIN : finite ? THICK_ENDS : 0) | (thick ? THICKER : 0)
        | (slab.turned ? TURNED : 0) | (finite && !slab.carried && 2.0 * slab.h > COMPLEMENTED ? FORMING : 0)
        | (slab.carried ? CARRIED : finite ? LATE : 0);
}

real factor_of(Slab slab, int times)
{
    return times == H ? slab.h : times == H_SQUARED ? slab.h * slab.h : times == OVER_STEEPEST ? 1.0 / slab.steepest
        : times == OVER_RATIO ? 1.0 / sqrt(fmax(slab.ratio, (real)STEEPEST_RATIO)) : 1.0;
}

// How many doublings there are, and the thickness of the first.
void begin(Slab* slab, real norm)
{
    slab->steepest = fmax(slab->steepest, sqrt(norm));
    slab->h = 0.5 * slab->thickness;
    slab->ratio = fmin((real)1.0, slab->slowest / slab->steepest);
    slab->left = slab->thickness < SEMI_INFINITE ? 0 : MOST_DOUBLINGS;
    for (; slab->left < MOST_DOUBLINGS && slab->h * slab->steepest > 0.5; slab->left++)
        slab->h *= 0.5;
}

// After a doubling; difference: how far Zo Ze of a semi-infinite slab was from 1 before, which a doubling squares.
void next(Slab* slab, real difference)
{
    const real ratio = slab->ratio, used = fmax(ratio, (real)STEEPEST_RATIO);
    slab->doublings++;
    slab->left--;
    slab->h *= 2.0;
    if (slab->thickness < SEMI_INFINITE)
        return;
    if (difference < DOUBLED && ratio > 0.999)
        slab->left = 0;
    slab->ratio = vrte_doubled_ratio(ratio, used);
}

// How far a is from 1 on the diagonal; where the flux is conserved Ze's is 0 on its axis for ever.
real diagonal_difference(const Work* w, Extended a)
{
    real found = 0.0;
    SPREAD(i, 0, w->s.n)
        if (!(w->slab.turned && w->slab.conservative && i == flux_axis(w->s)))
            found = larger(found, fabs(a.M[(long)i * w->s.ld + i] - (real)1.0));
    SPREAD(i, 0, w->s.o + w->s.r)
        found = larger(found, fabs(a.OO[i] - (real)1.0));
    return of_lanes(false, found, w->with.shelves.size);
}

// One operation of a list.
void perform(Work* w, Operation now, __global real* lost)
{
    const Sizes s = w->s;
    const int n = s.n, ld = s.ld, axis = flux_axis(s);
    const Extended a = matrix_of(w, now.a), b = matrix_of(w, now.b), c = matrix_of(w, now.c);
    const long column = now.times >= N_NI ? (long)n * ld : 0, row = now.times % 2 ? s.p : 0;
    if (now.kind == PRODUCT)
        product_extended(s, now.alpha * factor_of(w->slab, now.times), a, b, c);
    else if (now.kind == COMBINE)
        combine(s, now.alpha * factor_of(w->slab, now.times), a, now.beta, b, now.gamma, c);
    else if (now.kind == INVERT)
        w->slab.singular |= invert_extended(s, a, b, w->with);
    else if (now.kind == BLOCKS)
        multiply(row ? s.o : n, column ? s.r : n, n, now.alpha, a.M + row, ld, b.M + column, ld, now.beta,
                 c.M + column + row, ld);
    else if (now.kind == MEASURE || now.kind == BEGIN) {
        const bool first = now.kind == BEGIN;
        const real found = largest_of(n, n, first, matrix_of(w, first ? a_ : now.a).M, ld, w->with.shelves.size);
        if (first)
            begin(&w->slab, found);
        else
            w->measured[now.b] = found;
    } else if (now.kind == DIFFERENCE)
        w->measured[0] = diagonal_difference(w, matrix_of(w, a_));
    else if (now.kind == NEXT)
        next(&w->slab, w->measured[0]);
    else if (now.kind == CARRY)
        w->slab.carried = 1;
    else if (now.kind == STRAIGHT)
        SPREAD(i, 0, s.o + s.r)
            c.OO[i] = now.b == NOTHING ? 0.0 : now.b == TANH ? tanh(w->slab.h * w->rates[i])
                : vrte_over_cosh_squared(w->slab.h * w->rates[i]);
    else if (now.kind == MIRROR) {     // reciprocity: rounding in the flux's row would double at each step
        __global real* Zo = matrix_of(w, Zo_).M;
        SPREAD(i, 0, n) {
            const real across = Zo[(long)i * ld + axis];
            Zo[(long)axis * ld + i] = s.stokes == 4 && i % 4 == 3 ? -across : across;
        }
    } else if (now.kind == LOSE) {     // 2 Se, the flux's row
        const real twice = w->slab.thickness < SEMI_INFINITE ? -2.0 : -1.0;
        SPREAD(j, 0, n)
            lost[j] = twice * w->R[(long)j * ld + axis];
    } else if (now.kind == LEAD) {     // spare: beta's NI times T's II, T's OO times beta's ON
        const Extended T = matrix_of(w, T_);
        __global real *spare = matrix_of(w, spare_).M, *beta = matrix_of(w, b_).M;
        EACH(j, s.r, i, n)
            spare[(long)(n + j) * ld + i] = beta[(long)(n + j) * ld + i] * T.II[j];
        EACH(j, n, i, s.o)
            spare[(long)j * ld + s.p + i] = beta[(long)j * ld + s.p + i] * T.OO[i];
    } else if (now.kind == DIVIDE)
        EACH(j, s.r, i, s.o)
            w->R[(long)(n + j) * ld + s.p + i] /= w->rates[i] + w->rates[s.o + j];
    TOGETHER
}

// E or F with its incident and outgoing directions: the sources with the other sign, no OI; 1/mu on the diagonal.
void extend(const Work* w, int n_col, __global const real* columns, __global const real* matrix, int matrix_ld,
            __global const real* G, int G_ld, __global const real* source, int source_ld, Extended a)
{
    const Sizes s = w->s;
    copy_columns(s.n, s.n, matrix, matrix_ld, a.M, s.ld);
    EACH(j, s.n, i, s.o)
        a.M[(long)j * s.ld + s.p + i] = -G[(long)j * G_ld + i] * w->rates[i];
    EACH(j, s.r, i, s.n) {
        __global const real* from = source + (long)s.stokes * (j / n_col) * source_ld + i;
        real total = 0.0;
        for (int k = 0; k < s.stokes; k++)
            total += from[(long)k * source_ld] * columns[s.stokes * (j % n_col) + k];
        a.M[(long)(s.n + j) * s.ld + i] = -total;
    }
    SPREAD(i, 0, s.o + s.r)
        a.OO[i] = w->rates[i];
    TOGETHER
}

// Order 0: one axis becomes sqrt(weight mu) on I, whose row and column of E are known exactly.
void turn_slab(const Work* w, int n_col, __global const real* columns, __global const real* v,
               __global const real* clear_row, real flux_size)
{
    const Sizes s = w->s;
    const int axis = flux_axis(s);
    const real albedo = w->slab.albedo;
    __global real* e = matrix_of(w, e_).M;
    for (int odd = 0; odd < 2; odd++)
        turn_both(s, v, odd ? matrix_of(w, f_).M : e);
    SPREAD(i, 0, s.n) {
        e[(long)axis * s.ld + i] = (1.0 - albedo) * clear_row[i];
        e[(long)i * s.ld + axis] = (1.0 - albedo) * clear_row[i];
    }
    SPREAD(j, 0, s.r)
        e[(long)(s.n + j) * s.ld + axis] = albedo * columns[s.stokes * (j % n_col)] / flux_size;
    SPREAD(i, 0, s.o)
        e[(long)axis * s.ld + s.p + i] = i % s.stokes ? 0.0 : albedo * w->rates[i] / flux_size;
    TOGETHER
}

// A slab that does not scatter: T alone, and in order 0 what is lost of the flux.
void clear_slab(const Work* w, __global const real* node_rates, __global const real* flux, real flux_size,
                __global const real* v, __global real* lost)
{
    const Sizes s = w->s;
    const Extended T = matrix_of(w, T_);
    const real thickness = w->slab.thickness;
    SPREAD(i, 0, s.n)
        T.M[(long)i * s.ld + i] = exp(-thickness * node_rates[i]);
    SPREAD(i, 0, s.o + s.r)
        T.OO[i] = exp(-thickness * w->rates[i]);
    TOGETHER
    if (!w->slab.turned)
        return;
    turn_both(s, v, T.M);
    real total = 0.0;
    for (int i = 0; i < s.n; i += s.stokes)   // the axis is minus the unit null vector
        total += v[i] * (flux[i / s.stokes] / flux_size * expm1(-thickness * node_rates[i]));
    SPREAD(i, 0, s.n)
        lost[i] = (i % s.stokes ? (real)0.0 : flux[i / s.stokes] / flux_size * expm1(-thickness * node_rates[i])) - total * v[i];
}

// E and F with their directions; what does not scatter is done at once. Pieces: items.
KERNEL(LANES, start_doubling)
{
    OPEN_SLAB
    if (w.slab.clear) {
        clear_slab(&w, rates, flux, flux_size, v, lost + item * n);
        return;
    }
#define FROM(x) x + x##_first + w.slab.from * x##_stride, x##_ld
    for (int odd = 0; odd < 2; odd++)
        if (odd)
            extend(&w, n_col, columns, FROM(F), FROM(G_F), FROM(source_s), matrix_of(&w, f_));
        else
            extend(&w, n_col, columns, FROM(E), FROM(G_E), FROM(source_d), matrix_of(&w, e_));
    if (w.slab.turned)
        turn_slab(&w, n_col, columns, v, clear_row, flux_size);
}

// A list of operations on each slab. Pieces: items.
KERNEL(LANES, double_slabs)
{
    OPEN_SLAB
    const int number = which == 0 ? LENGTH(START) : which == 1 ? LENGTH(DOUBLE) : LENGTH(END);
    for (int turn = 0; turn < most && !w.slab.clear && !w.slab.singular && (which != 1 || w.slab.left > 0); turn++)
        for (int k = 0; k < number; k++) {
            const Operation now = which == 0 ? START[k] : which == 1 ? DOUBLE[k] : END[k];
            if ((now.when & conditions_of(w.slab)) == now.when)
                perform(&w, now, lost + item * n);
        }
    if (w.slab.singular)
        w.slab.left = 0;
    if (which == 2 && !w.slab.clear && LANE == 0) {
        const real alpha = w.measured[0];
        const real largest = larger(larger(w.measured[1], w.measured[2]), alpha * fmin((real)1.0, w.slab.thickness * alpha));
        residual[2 * item] = largest == 0.0 ? 0.0 : w.measured[3] / largest;
        residual[2 * item + 1] = w.measured[4] <= NO_LIGHT ? 0.0 : w.measured[5] / w.measured[4];
    }
    CLOSE_SLAB
}
