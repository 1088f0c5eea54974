/* Impedance doubling as lists of operations on matrices with their incident and outgoing directions, which
   core/doubling.pxi does by BLAS and cl/doubling.cl by its own products. */

/* A slab of an order, (item,), and how far it is: `source`, the item of its E and F; slowest, a guess from below of
   the slowest decay of a semi-infinite one; steepest, its largest rate, at first that of a direction; h, half the
   thickness doubled so far; ratio, the smallest over the largest eigenvalue of sqrt(Zo Ze); left, how many
   doublings; carried, whether C is. */
typedef struct {
    real thickness, albedo, slowest, steepest, h, ratio;
    int source, turned, clear, conservative, left, carried, doublings, singular;
} vrte_slab;

/* An operation on a slab's matrices, where it has all of `when`: c = alpha times a b, or alpha times a + beta b +
   gamma 1. Compilers write out each call of a function: so there are lists of operations, and one call of each. */
typedef struct {
    int kind, when, a, b, c, times;
    real alpha, beta, gamma;
} vrte_operation;

enum { e_, f_, Ze_, Zo_, C_, a_, b_, spare_, R_, T_ };
enum { PRODUCT, COMBINE, INVERT, STRAIGHT, BLOCKS, BEGIN, CARRY, DISTANCE, NEXT, MIRROR, LOSE, LEAD, DIVIDE,
       MEASURE };
enum { FINITE = 1, ENDLESS = 2, THIN = 4, THICK_ENDS = 8, THICKER = 16, TURNED = 32, FORMING = 64, CARRIED = 128,
       LATE = 256 };
enum { ONE, H, H_SQUARED, OVER_STEEPEST, OVER_RATIO }; /* times */
enum { TANH, COMPLEMENT, NOTHING }; /* b of STRAIGHT: OO and II of c */
enum { N_N, ON_N, N_NI, ON_NI }; /* times of BLOCKS: of a and b, into that of c */

/* What the doublings begin with, A = F E: of finite slabs Ze = E f, Zo = f F, f = tanh(h sqrt A)/sqrt A by the
   seventh convergent of tanh's continued fraction, above/below, which C and spare hold. */
VRTE_LIST vrte_operation vrte_start[] = {
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

/* One doubling, L = 1 + Zo Ze: Zo <- 2 L^-1 Zo, Ze <- 2 Ze L^-1. Of a finite slab C = 1 - Zo Ze is formed while that
   keeps its digits, then carried, C <- (C L^-1)^2; of a semi-infinite one, where Zo Ze = 1, both are first
   multiplied by ratio^(-1/2). */
VRTE_LIST vrte_operation vrte_double[] = {
    {COMBINE, ENDLESS, Ze_, Ze_, Ze_, OVER_RATIO, 1.0},
    {COMBINE, ENDLESS, Zo_, Zo_, Zo_, OVER_RATIO, 1.0},
    {PRODUCT, 0, Zo_, Ze_, a_, ONE, 1.0},
    {COMBINE, FORMING, a_, a_, C_, ONE, -1.0, 0.0, 1.0},
    {STRAIGHT, FORMING, 0, COMPLEMENT, C_},
    {CARRY, FORMING},
    {DISTANCE, ENDLESS},
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

/* R = So - Se and T = (1 + Zo)^-1 C (1 + Ze)^-1; semi-infinite: R = 1 - 2 Se and T = 0. Then alpha and beta, of what
   adds a thin layer, in a and b: added on top and taken off below it changes nothing. Of thick slabs that gives R's
   OI anew, from R's and T's other blocks, (1/mu + 1/mu0) R = -(alpha R + R alpha + R beta R - T beta T); of all, how
   far it is from true: beta + alpha R + R alpha + R beta R = T beta T and (alpha + R beta) T = T (alpha + beta R). */
VRTE_LIST vrte_operation vrte_end[] = {
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
    {COMBINE, THICK_ENDS, R_, a_, R_, ONE, 1.0, -1.0, 1.0}, /* Zo may be as large as the slab is thick */
    {PRODUCT, THIN, Zo_, a_, b_, ONE, 1.0},                 /* Zo may be small */
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

/* A doubling once C is so small that it alone changes: L = 2. */
VRTE_LIST vrte_operation vrte_square[] = {
    {PRODUCT, 0, C_, C_, b_, ONE, 0.25},
    {COMBINE, 0, b_, b_, C_, ONE, 1.0},
    {NEXT},
    {STRAIGHT, 0, 0, COMPLEMENT, C_},
};

/* The lists by number, and how long they are. */
enum { VRTE_START, VRTE_DOUBLE, VRTE_END, VRTE_SQUARE };
#define VRTE_LENGTH(list) (int)(sizeof(list) / sizeof(list[0]))

VRTE_SHARED int vrte_list_length(int which) {
    return which == VRTE_START    ? VRTE_LENGTH(vrte_start)
           : which == VRTE_DOUBLE ? VRTE_LENGTH(vrte_double)
           : which == VRTE_END    ? VRTE_LENGTH(vrte_end)
                                  : VRTE_LENGTH(vrte_square);
}

VRTE_SHARED vrte_operation vrte_operation_of(int which, int k) {
    const vrte_operation found = which == VRTE_START    ? vrte_start[k]
                                 : which == VRTE_DOUBLE ? vrte_double[k]
                                 : which == VRTE_END    ? vrte_end[k]
                                                        : vrte_square[k];
    return found;
}

VRTE_SHARED int vrte_conditions_of(vrte_slab slab) {
    const int finite = slab.thickness < SEMI_INFINITE, thick = slab.thickness > THICK;
    return (finite ? FINITE : ENDLESS) | (!thick ? THIN : finite ? THICK_ENDS : 0) | (thick ? THICKER : 0) |
           (slab.turned ? TURNED : 0) | (finite && !slab.carried && 2.0 * slab.h > COMPLEMENTED ? FORMING : 0) |
           (slab.carried ? CARRIED : finite ? LATE : 0);
}

VRTE_SHARED real vrte_factor_of(vrte_slab slab, int times) {
    if (times == OVER_RATIO) return 1.0 / sqrt(fmax(slab.ratio, (real)STEEPEST_RATIO));
    if (times == OVER_STEEPEST) return 1.0 / slab.steepest;
    return times == H ? slab.h : times == H_SQUARED ? slab.h * slab.h : 1.0;
}

/* How many doublings there are, and the thickness of the first; norm: of A. */
VRTE_SHARED void vrte_begin(vrte_slab* slab, real norm) {
    slab->steepest = fmax(slab->steepest, sqrt(norm));
    slab->h = 0.5 * slab->thickness;
    slab->ratio = fmin((real)1.0, slab->slowest / slab->steepest);
    slab->left = slab->thickness < SEMI_INFINITE ? 0 : MOST_DOUBLINGS;
    for (; slab->left < MOST_DOUBLINGS && slab->h * slab->steepest > 0.5; slab->left++) slab->h *= 0.5;
}

/* After a doubling; distance: that of Zo Ze of a semi-infinite slab from 1 before, which a doubling squares. A wrong
   guess of the slowest decay costs steps, no digits. */
VRTE_SHARED void vrte_next(vrte_slab* slab, real distance) {
    const real ratio = slab->ratio, used = fmax(ratio, (real)STEEPEST_RATIO);
    slab->doublings++;
    slab->left--;
    slab->h *= 2.0;
    if (slab->thickness < SEMI_INFINITE) return;
    if (distance < DOUBLED && ratio > 0.999) slab->left = 0;
    slab->ratio = vrte_doubled_ratio(ratio, used);
}

/* What R and T miss of invariance, relative, from what was measured. R counts relative to the light that it meets, not
   to itself: where albedo is 1e-12, nobody sees its last digits. */
VRTE_SHARED real vrte_missing_of_reflection(const real* measured, real thickness) {
    const real largest = fmax(fmax(measured[1], measured[2]), measured[0] * fmin((real)1.0, thickness * measured[0]));
    return largest == 0.0 ? 0.0 : measured[3] / largest;
}

VRTE_SHARED real vrte_missing_of_transmission(const real* measured) {
    return measured[4] <= NO_LIGHT ? 0.0 : measured[5] / measured[4];
}
