// Impedance doubling: `double_one` of core/doubling.pxi, whose equations these are. A work-group takes a slab of an order.

// A slab of an order, (item,), and how far it is: `from`, the item of its E and F; slowest, a guess from below of the
// slowest decay of a semi-infinite one; steepest, its largest rate, at first that of a direction; h, half the thickness
// doubled so far; ratio, the smallest over the largest eigenvalue of sqrt(Zo Ze); left, how many doublings; carried,
// whether C is.
typedef struct {
    real thickness, albedo, slowest, steepest, h, ratio;
    int from, turned, clear, conservative, left, carried, doublings, singular;
} Slab;

// What all slabs share: sqrt(weight mu) of the nodes, the root of the sum of its squares, the Householder vector that turns
// it to the flux's axis, what the turned row of E there is without scattering; 1/mu of nodes, then outgoing rows, then
// incident columns; Stokes vectors (n_col, S). room (item, 8 extended matrices).
#define SLABS int n_col, SIZES, IN flux, real flux_size, IN v, IN clear_row, IN rates, IN columns, \
    __global Slab* restrict slabs, OUT room, OUT all_R, OUT all_T, OUT rest, __global int* restrict pivots

typedef struct {
    Sizes s;
    Slab slab;
    Extended e, f, Ze, Zo, C, a, b, spare, R, T;
    Inverting with;
    __global const real* rates;
} Work;

#define OPEN_SLAB \
    __local real size[LANES], row[PANEL]; \
    __local int place[LANES]; \
    const long item = items[get_group_id(0)]; \
    const Sizes s = {n, p, r, o, ld, stokes}; \
    __global real* mine = room + item * 8 * size_extended(s); \
    Work w = {s, slabs[item], extended_at(s, mine, 0), extended_at(s, mine, 1), extended_at(s, mine, 2), \
              extended_at(s, mine, 3), extended_at(s, mine, 4), extended_at(s, mine, 5), extended_at(s, mine, 6), \
              extended_at(s, mine, 7), extended_at(s, all_R, item), extended_at(s, all_T, item), \
              {rest + item * (long)n * PANEL, pivots + item * n, {size, place, row}}, rates + n};
#define CLOSE_SLAB \
    TOGETHER \
    if (LANE == 0) \
        slabs[item] = w.slab;

// OO and II of light that is not scattered over h: tanh(h/mu).
void go_straight(const Work* w, Extended a)
{
    SPREAD(i, 0, w->s.o + w->s.r)
        a.OO[i] = tanh(w->slab.h * w->rates[i]);
}

// Those of C: 1 - tanh^2 = 1/cosh^2, without a difference.
void direct_complement(const Work* w)
{
    SPREAD(i, 0, w->s.o + w->s.r) {
        const real decaying = exp(-2.0 * w->slab.h * w->rates[i]);
        w->C.OO[i] = 4.0 * decaying / ((1.0 + decaying) * (1.0 + decaying));
    }
    TOGETHER
}

// C = 1 - Zo Ze, which a holds.
void complement(const Work* w)
{
    combine(w->s, -1.0, w->a, 0.0, w->a, 1.0, w->C);
    direct_complement(w);
}

// Zo <- 2 L^-1 Zo, Ze <- 2 Ze L^-1; a <- L^-1, L - 1 on entry.
int double_both(const Work* w)
{
    combine(w->s, 1.0, w->a, 0.0, w->a, 1.0, w->a);
    if (invert_extended(w->s, w->a, w->spare, w->with))
        return 1;
    product_extended(w->s, 2.0, w->a, w->Zo, w->b);
    combine(w->s, 1.0, w->b, 0.0, w->b, 0.0, w->Zo);
    product_extended(w->s, 2.0, w->Ze, w->a, w->b);
    combine(w->s, 1.0, w->b, 0.0, w->b, 0.0, w->Ze);
    return 0;
}

// Reciprocity: the flux's column of Zo from its row; rounding there would double at each step.
void mirror_flux(const Work* w)
{
    const int axis = flux_axis(w->s), v_place = w->s.stokes == 4 ? 3 : -1;
    SPREAD(i, 0, w->s.n) {
        const real across = w->Zo.M[(long)i * w->s.ld + axis];
        w->Zo.M[(long)axis * w->s.ld + i] = i % w->s.stokes == v_place ? -across : across;
    }
    TOGETHER
}

// How far Zo Ze, in a, is from 1 on the diagonal; where the flux is conserved Ze's is 0 on its axis for ever.
real diagonal_difference(const Work* w)
{
    real found = 0.0;
    SPREAD(i, 0, w->s.n)
        if (!(w->slab.turned && w->slab.conservative && i == flux_axis(w->s)))
            found = larger(found, fabs(w->a.M[(long)i * w->s.ld + i] - (real)1.0));
    SPREAD(i, 0, w->s.o + w->s.r)
        found = larger(found, fabs(w->a.OO[i] - (real)1.0));
    return largest_of_lanes(found, w->with.shelves.size);
}

// One doubling, L = 1 + Zo Ze. Of a finite slab C is formed while 1 - Zo Ze keeps its digits, then carried, C <- (C L^-1)^2;
// of a semi-infinite one, where Zo Ze = 1, both are first multiplied by ratio^(-1/2).
void double_once(Work* w)
{
    const Sizes s = w->s;
    const bool finite = w->slab.thickness < SEMI_INFINITE;
    const real ratio = w->slab.ratio, used = fmax(ratio, (real)STEEPEST_RATIO), factor = 1.0 / sqrt(used);
    if (!finite) {
        combine(s, factor, w->Ze, 0.0, w->Ze, 0.0, w->Ze);
        combine(s, factor, w->Zo, 0.0, w->Zo, 0.0, w->Zo);
    }
    product_extended(s, 1.0, w->Zo, w->Ze, w->a);
    if (finite && !w->slab.carried && 2.0 * w->slab.h > COMPLEMENTED) {
        complement(w);
        w->slab.carried = 1;
    }
    const real difference = finite ? 1.0 : diagonal_difference(w);
    w->slab.singular |= double_both(w);
    w->slab.doublings++;
    w->slab.left--;
    if (!finite) {    // the step just done squares the difference
        w->slab.left = difference < DOUBLED && ratio > 0.999 ? 0 : w->slab.left;
        w->slab.ratio = fmin(2.0 * ratio * sqrt(used) / (used + ratio * ratio), 2.0 * sqrt(used) / (1.0 + used));
        return;
    }
    if (w->slab.turned)
        mirror_flux(w);
    w->slab.h *= 2.0;
    go_straight(w, w->Ze);
    go_straight(w, w->Zo);
    TOGETHER
    if (w->slab.carried) {
        product_extended(s, 1.0, w->C, w->a, w->b);
        product_extended(s, 1.0, w->b, w->b, w->C);
        direct_complement(w);
    }
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
    turn_both(s, v, w->e.M);
    turn_both(s, v, w->f.M);
    SPREAD(i, 0, s.n) {
        w->e.M[(long)axis * s.ld + i] = (1.0 - albedo) * clear_row[i];
        w->e.M[(long)i * s.ld + axis] = (1.0 - albedo) * clear_row[i];
    }
    SPREAD(j, 0, s.r)
        w->e.M[(long)(s.n + j) * s.ld + axis] = albedo * columns[s.stokes * (j % n_col)] / flux_size;
    SPREAD(i, 0, s.o)
        w->e.M[(long)axis * s.ld + s.p + i] = i % s.stokes ? 0.0 : albedo * w->rates[i] / flux_size;
    TOGETHER
}

__constant const real NUMERATOR[] = {135135.0, 17325.0, 378.0, 1.0};   // tanh's continued fraction, seventh convergent
__constant const real DENOMINATOR[] = {135135.0, 62370.0, 3150.0, 28.0};

// Ze = E f, Zo = f F with f = tanh(h sqrt A)/sqrt A, A = F E, which a holds.
void rational_start(Work* w)
{
    const Sizes s = w->s;
    const Extended z = w->a, power = w->b, above = w->C, below = w->spare;
    combine(s, w->slab.h * w->slab.h, z, 0.0, z, 0.0, z);
    combine(s, NUMERATOR[1], z, 0.0, z, NUMERATOR[0], above);
    combine(s, DENOMINATOR[1], z, 0.0, z, DENOMINATOR[0], below);
    combine(s, 1.0, z, 0.0, z, 0.0, power);
    for (int k = 2; k < 4; k++) {
        product_extended(s, 1.0, z, power, w->Ze);
        combine(s, 1.0, w->Ze, 0.0, w->Ze, 0.0, power);
        combine(s, 1.0, above, NUMERATOR[k], power, 0.0, above);
        combine(s, 1.0, below, DENOMINATOR[k], power, 0.0, below);
    }
    w->slab.singular |= invert_extended(s, below, power, w->with);
    product_extended(s, w->slab.h, below, above, z);
    product_extended(s, 1.0, w->e, z, w->Ze);
    product_extended(s, 1.0, z, w->f, w->Zo);
    go_straight(w, w->Ze);
    go_straight(w, w->Zo);
    TOGETHER
}

// A slab that does not scatter: T alone, and in order 0 what is lost of the flux.
void clear_slab(const Work* w, __global const real* node_rates, __global const real* flux, real flux_size,
                __global const real* v, __global real* lost)
{
    const Sizes s = w->s;
    const real thickness = w->slab.thickness;
    SPREAD(i, 0, s.n)
        w->T.M[(long)i * s.ld + i] = exp(-thickness * node_rates[i]);
    SPREAD(i, 0, s.o + s.r)
        w->T.OO[i] = exp(-thickness * w->rates[i]);
    TOGETHER
    if (!w->slab.turned)
        return;
    turn_both(s, v, w->T.M);
    real total = 0.0;
    for (int i = 0; i < s.n; i += s.stokes)   // the axis is minus the unit null vector
        total += v[i] * (flux[i / s.stokes] / flux_size * expm1(-thickness * node_rates[i]));
    SPREAD(i, 0, s.n)
        lost[i] = (i % s.stokes ? (real)0.0 : flux[i / s.stokes] / flux_size * expm1(-thickness * node_rates[i])) - total * v[i];
}

// E and F with their directions, and what the doublings begin with. Pieces: items.
SHARED
__kernel void start_doubling(SLABS, ALONE(E), ALONE(F), ALONE(G_E), ALONE(G_F), ALONE(source_s), ALONE(source_d), OUT lost,
                             INTS items)
{
    OPEN_SLAB
    if (w.slab.clear) {
        clear_slab(&w, rates, flux, flux_size, v, lost + item * n);
        return;
    }
#define FROM(x) x + x##_first + w.slab.from * x##_stride, x##_ld
    extend(&w, n_col, columns, FROM(E), FROM(G_E), FROM(source_d), w.e);
    extend(&w, n_col, columns, FROM(F), FROM(G_F), FROM(source_s), w.f);
    if (w.slab.turned)
        turn_slab(&w, n_col, columns, v, clear_row, flux_size);
    product_extended(s, 1.0, w.f, w.e, w.a);
    w.slab.steepest = fmax(w.slab.steepest, sqrt(largest_of(n, n, 1, w.a.M, ld, size)));
    if (w.slab.thickness < SEMI_INFINITE) {
        w.slab.h = 0.5 * w.slab.thickness;
        for (; w.slab.h * w.slab.steepest > 0.5; w.slab.left++)
            w.slab.h *= 0.5;
        rational_start(&w);
    } else {
        w.slab.left = MOST_DOUBLINGS;
        w.slab.ratio = fmin((real)1.0, w.slab.slowest / w.slab.steepest);
        combine(s, 1.0 / w.slab.steepest, w.e, 0.0, w.e, 0.0, w.Ze);
        combine(s, 1.0 / w.slab.steepest, w.f, 0.0, w.f, 0.0, w.Zo);
    }
    CLOSE_SLAB
}

// At most so many doublings more. Pieces: items.
SHARED
__kernel void double_on(int most, SLABS, INTS items)
{
    OPEN_SLAB
    for (int step = 0; step < most && w.slab.left > 0 && !w.slab.singular; step++)
        double_once(&w);
    if (w.slab.singular)
        w.slab.left = 0;
    CLOSE_SLAB
}

// R = So - Se and T = (1 + Zo)^-1 C (1 + Ze)^-1; semi-infinite: R = 1 - 2 Se and T = 0; lost = 2 Se, the flux's row.
int reflect_and_transmit(const Work* w, __global real* lost)
{
    const Sizes s = w->s;
    const bool finite = w->slab.thickness < SEMI_INFINITE, thick = finite && w->slab.thickness > THICK;
    const real twice = finite ? 1.0 : 2.0;
    int singular;
    combine(s, 1.0, w->Ze, 0.0, w->Ze, 1.0, w->a);
    singular = invert_extended(s, w->a, w->spare, w->with);
    product_extended(s, -twice, w->Ze, w->a, w->R);
    if (w->slab.turned)
        SPREAD(j, 0, s.n)
            lost[j] = -2.0 / twice * w->R.M[(long)j * s.ld + flux_axis(s)];
    TOGETHER
    if (finite) {
        product_extended(s, 1.0, w->C, w->a, w->b);
        combine(s, 1.0, w->Zo, 0.0, w->Zo, 1.0, w->a);
        singular |= invert_extended(s, w->a, w->spare, w->with);
        product_extended(s, 1.0, w->a, w->b, w->T);
        if (!thick)     // Zo may be small: So = Zo (1 + Zo)^-1, else as large as the slab is thick: So = 1 - (1 + Zo)^-1
            product_extended(s, 1.0, w->Zo, w->a, w->b);
    }
    combine(s, 1.0, w->R, !finite ? 0.0 : thick ? -1.0 : 1.0, thick ? w->a : w->b, finite && !thick ? 0.0 : 1.0, w->R);
    SPREAD(i, 0, s.o + s.r)
        w->R.OO[i] = 0.0;
    TOGETHER
    return singular;
}

// R's OI anew where a slab is thick, from R's and T's other blocks: a thin layer added on top and taken off below changes
// nothing. a and b hold alpha and beta: (1/mu + 1/mu0) R = -(alpha R + R alpha + R beta R - T beta T).
void reflect_by_invariance(const Work* w)
{
    const Sizes s = w->s;
    const int n = s.n, p = s.p, r = s.r, o = s.o, ld = s.ld;
    const long NI = (long)n * ld, OI = NI + p;
    __global const real* alpha = w->a.M;
    __global const real* beta = w->b.M;
    __global real *R = w->R.M, *T = w->T.M, *spare = w->spare.M;
    copy_columns(n, r, alpha + NI, ld, spare + NI, ld);
    multiply(n, r, n, 1.0, beta, ld, R + NI, ld, 1.0, spare + NI, ld);
    multiply(o, r, n, -1.0, R + p, ld, spare + NI, ld, 0.0, R + OI, ld);
    EACH(j, r, i, n)
        spare[NI + (long)j * ld + i] = beta[NI + (long)j * ld + i] * w->T.II[j];
    EACH(j, n, i, o)
        spare[(long)j * ld + p + i] = beta[(long)j * ld + p + i] * w->T.OO[i];
    TOGETHER
    multiply(n, r, n, 1.0, beta, ld, T + NI, ld, 1.0, spare + NI, ld);
    multiply(o, r, n, 1.0, T + p, ld, spare + NI, ld, 1.0, R + OI, ld);
    multiply(o, r, n, -1.0, alpha + p, ld, R + NI, ld, 1.0, R + OI, ld);
    multiply(o, r, n, 1.0, spare + p, ld, T + NI, ld, 1.0, R + OI, ld);
    EACH(j, r, i, o)
        R[OI + (long)j * ld + i] /= w->rates[i] + w->rates[o + j];
    TOGETHER
}

// How far R and T are from not caring whether a thin layer is added on top or at the bottom, relative:
// beta + alpha R + R alpha + R beta R = T beta T and (alpha + R beta) T = T (alpha + beta R).
void miss_invariance(const Work* w, __global real* residual)
{
    const int n = w->s.n, ld = w->s.ld, finite = w->slab.thickness < SEMI_INFINITE;
    __global const real *alpha = w->a.M, *beta = w->b.M, *R = w->R.M, *T = w->T.M;
    __global real *x = w->e.M, *y = w->f.M, *z = w->spare.M;
    __local real* shelf = w->with.shelves.size;
    copy_columns(n, n, alpha, ld, x, ld);
    multiply(n, n, n, 1.0, R, ld, beta, ld, 1.0, x, ld);
    multiply(n, n, n, 1.0, R, ld, alpha, ld, 0.0, z, ld);
    real largest = largest_of(n, n, 0, alpha, ld, shelf);
    largest *= fmin((real)1.0, w->slab.thickness * largest);
    largest = larger(largest, larger(largest_of(n, n, 0, z, ld, shelf), largest_of(n, n, 0, beta, ld, shelf)));
    EACH(j, n, i, n)
        z[(long)j * ld + i] += beta[(long)j * ld + i];
    TOGETHER
    multiply(n, n, n, 1.0, x, ld, R, ld, 1.0, z, ld);
    if (finite) {
        multiply(n, n, n, 1.0, T, ld, beta, ld, 0.0, y, ld);
        multiply(n, n, n, -1.0, y, ld, T, ld, 1.0, z, ld);
    }
    const real missing = largest_of(n, n, 0, z, ld, shelf);
    if (LANE == 0)
        residual[0] = largest == 0.0 ? 0.0 : missing / largest;
    if (!finite)
        return;
    multiply(n, n, n, 1.0, x, ld, T, ld, 0.0, z, ld);
    largest = largest_of(n, n, 0, z, ld, shelf);
    multiply(n, n, n, -1.0, T, ld, alpha, ld, 1.0, z, ld);
    multiply(n, n, n, -1.0, y, ld, R, ld, 1.0, z, ld);
    const real of_T = largest_of(n, n, 0, z, ld, shelf);
    if (LANE == 0)
        residual[1] = largest <= NO_LIGHT ? 0.0 : of_T / largest;
}

// R, T, lost (item, n), residual (item, 2) of what is doubled. Pieces: items.
SHARED
__kernel void end_doubling(SLABS, OUT lost, OUT residual, INTS items)
{
    OPEN_SLAB
    if (w.slab.clear || w.slab.singular)
        return;
    if (w.slab.thickness < SEMI_INFINITE && !w.slab.carried) {
        product_extended(s, 1.0, w.Zo, w.Ze, w.a);
        complement(&w);
    }
    w.slab.singular |= reflect_and_transmit(&w, lost + item * n);
    combine(s, 0.5, w.e, 0.5, w.f, 0.0, w.a);      // alpha and beta of what adds a thin layer
    combine(s, 0.5, w.e, -0.5, w.f, 0.0, w.b);
    if (w.slab.thickness > THICK)
        reflect_by_invariance(&w);
    miss_invariance(&w, residual + 2 * item);
    CLOSE_SLAB
}
