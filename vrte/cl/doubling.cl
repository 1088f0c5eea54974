// Impedance doubling by the lists of core/kernels/doubling.h. A work-group takes a slab of an order.

// A slab at work; room (item, 8 extended matrices).
typedef struct {
    Sizes s;
    vrte_slab slab;
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

Extended matrix_of(const Work* w, int which)
{
    return extended_at(w->s, which == R_ ? w->R : which == T_ ? w->T : w->mine, which >= R_ ? 0 : which);
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
void perform(Work* w, vrte_operation now, __global real* lost)
{
    const Sizes s = w->s;
    const int n = s.n, ld = s.ld, axis = flux_axis(s);
    const Extended a = matrix_of(w, now.a), b = matrix_of(w, now.b), c = matrix_of(w, now.c);
    const long column = now.times >= N_NI ? (long)n * ld : 0, row = now.times % 2 ? s.p : 0;
    if (now.kind == PRODUCT)
        product_extended(s, now.alpha * vrte_factor_of(w->slab, now.times), a, b, c);
    else if (now.kind == COMBINE)
        combine(s, now.alpha * vrte_factor_of(w->slab, now.times), a, now.beta, b, now.gamma, c);
    else if (now.kind == INVERT)
        w->slab.singular |= invert_extended(s, a, b, w->with);
    else if (now.kind == BLOCKS)
        multiply(row ? s.o : n, column ? s.r : n, n, now.alpha, a.M + row, ld, b.M + column, ld, now.beta,
                 c.M + column + row, ld);
    else if (now.kind == MEASURE || now.kind == BEGIN) {
        const bool first = now.kind == BEGIN;
        const real found = largest_of(n, n, first, matrix_of(w, first ? a_ : now.a).M, ld, w->with.shelves.size);
        if (first)
            vrte_begin(&w->slab, found);
        else
            w->measured[now.b] = found;
    } else if (now.kind == DISTANCE)
        w->measured[0] = diagonal_difference(w, matrix_of(w, a_));
    else if (now.kind == NEXT)
        vrte_next(&w->slab, w->measured[0]);
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
#define FROM(x) x + x##_first + w.slab.source * x##_stride, x##_ld
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
    for (int turn = 0; turn < most && !w.slab.clear && !w.slab.singular && (which != VRTE_DOUBLE || w.slab.left > 0); turn++)
        for (int k = 0; k < vrte_list_length(which); k++) {
            const vrte_operation now = vrte_operation_of(which, k);
            if ((now.when & vrte_conditions_of(w.slab)) == now.when)
                perform(&w, now, lost + item * n);
        }
    if (w.slab.singular)
        w.slab.left = 0;
    if (which == VRTE_END && !w.slab.clear && LANE == 0) {
        residual[2 * item] = vrte_missing_of_reflection(w.measured, w.slab.thickness);
        residual[2 * item + 1] = vrte_missing_of_transmission(w.measured);
    }
    CLOSE_SLAB
}
