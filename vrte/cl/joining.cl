// Slabs joined by the star product: `join_one` of core/joining.pxi, whose equations these are. A work-group takes an order
// of a stack. Vectors are matrices (n, r) or (o, r), one column an incident beam and Stokes column; padded like all.

typedef struct {
    Sizes s;
    int places, turned, dark;
    __global const real *R, *T, *lost;        // of all slabs
    __global const int* slab;                 // (place,): which of them lies there
    __global const real *above, *rates;       // (place + 1,); 1/mu of incident columns
    __global real *below, *absorbed;          // of what lies below: its reflection, and the flux's row of 1 - it
    __global real *up, *down;                 // (place + 1, n, r)
    __global real *G, *g;                     // (place, n, n), (place, n, r)
    __global real *M, *known, *right, *GT;    // (n, n)
    __global real *vector, *through;          // (n, r)
    __global real *row;                       // (2 n,)
    Inverting with;
} Stack;

// out = what the beam, attenuated on its way to an interface, makes by `a`.
void decay(const Stack* t, int rows, int place, __global const real* a, int a_ld, __global real* out, int out_ld)
{
    for (int j = 0; j < t->s.r; j++) {
        const real share = exp(-t->above[place] * t->rates[j]);
        SPREAD(i, 0, rows)
            out[(long)j * out_ld + i] = share * a[(long)j * a_ld + i];
    }
    TOGETHER
}

Extended slab_of(const Stack* t, __global const real* matrices, int place)
{
    return extended_at(t->s, (__global real*)matrices, t->slab[place]);
}

// out = x M + beta out, rows (n,).
void row_times(int n, __global const real* x, __global const real* M, int ld, real beta, __global real* out)
{
    SPREAD(j, 0, n) {
        real total = 0.0;
        for (int i = 0; i < n; i++)
            total += x[i] * M[(long)j * ld + i];
        out[j] = total + (beta == 0.0 ? 0.0 : beta * out[j]);
    }
    TOGETHER
}

// row = lost + absorbed R, of order 0.
void lose(const Stack* t, __global const real* R, __global const real* lost)
{
    row_times(t->s.n, t->absorbed, R, t->s.ld, 0.0, t->row);
    SPREAD(j, 0, t->s.n)
        t->row[j] = lost[j] + t->row[j];
    TOGETHER
}

// Puts a slab upon what lies below: G = (1 - below R)^-1 below, g = (1 - below R)^-1 up, below <- R + T G T, and what comes
// up above it, emitted up + T (G emitted down + g). In order 0 the flux's row of the system, small where nothing absorbs, is
// summed from what is lost: lost + T's row + absorbed R. Returns what g misses of the system, relative; 1 in singular where
// there is none.
real add_below(const Stack* t, int place, int* singular)
{
    const Sizes s = t->s;
    const int n = s.n, p = s.p, r = s.r, ld = s.ld, axis = flux_axis(s);
    const long NI = (long)n * ld;
    __global const real *R = slab_of(t, t->R, place).M, *T = slab_of(t, t->T, place).M;
    __global const real* lost = t->lost + t->slab[place] * (long)n;
    __global real *G = t->G + place * (long)n * p, *g = t->g + place * (long)r * p, *above = t->up + place * (long)r * p;
    real largest = 0.0;
    decay(t, n, place, R + NI, ld, above, p);
    if (t->dark && place == t->places - 1) {      // a black base absorbs all
        copy_columns(n, n, R, ld, t->below, p);
        if (t->turned)
            SPREAD(j, 0, n)
                t->absorbed[j] = lost[j] + T[(long)j * ld + axis];
        TOGETHER
        return 0.0;
    }
    EACH(j, n, i, n)
        t->M[(long)j * p + i] = i == j ? 1.0 : 0.0;
    TOGETHER
    multiply(n, n, n, -1.0, t->below, p, R, ld, 1.0, t->M, p);
    copy_columns(n, n, t->below, p, t->right, p);
    copy_columns(n, r, above + (long)r * p, p, t->vector, p);
    if (t->turned) {
        lose(t, R, lost);
        SPREAD(j, 0, n)
            t->row[j] += T[(long)j * ld + axis];
        TOGETHER
        largest = largest_of(1, n, 0, t->row, 1, t->with.shelves.size);
    }
    if (largest > 0.0) {
        SPREAD(j, 0, n) {
            t->M[(long)j * p + axis] = t->row[j] / largest;
            t->right[(long)j * p + axis] /= largest;
        }
        SPREAD(j, 0, r)
            t->vector[(long)j * p + axis] /= largest;
        TOGETHER
    }
    copy_columns(n, n, t->M, p, t->known, p);
    *singular |= invert_matrix(n, t->M, p, t->with.rest, t->with.pivots, t->with.shelves);
    multiply(n, n, n, 1.0, t->M, p, t->right, p, 0.0, G, p);
    multiply(n, r, n, 1.0, t->M, p, t->vector, p, 0.0, g, p);
    largest = largest_of(n, r, 0, t->vector, p, t->with.shelves.size);
    multiply(n, r, n, -1.0, t->known, p, g, p, 1.0, t->vector, p);
    const real missing = largest_of(n, r, 0, t->vector, p, t->with.shelves.size);
    multiply(n, n, n, 1.0, G, p, T, ld, 0.0, t->GT, p);
    if (t->turned) {      // absorbed <- lost + (lost + absorbed R) G T + absorbed T
        lose(t, R, lost);
        SPREAD(j, 0, n)
            t->row[n + j] = lost[j];
        TOGETHER
        row_times(n, t->row, t->GT, p, 1.0, t->row + n);
        row_times(n, t->absorbed, T, ld, 1.0, t->row + n);
        copy_columns(n, 1, t->row + n, n, t->absorbed, n);
    }
    copy_columns(n, n, R, ld, t->below, p);
    multiply(n, n, n, 1.0, T, ld, t->GT, p, 1.0, t->below, p);
    decay(t, n, place, T + NI, ld, t->vector, p);
    copy_columns(n, r, g, p, t->through, p);
    multiply(n, r, n, 1.0, G, p, t->vector, p, 1.0, t->through, p);
    multiply(n, r, n, 1.0, T, ld, t->through, p, 1.0, above, p);
    return largest <= NO_LIGHT ? 0.0 : missing / largest;
}

// What falls at the bottom of a slab and what rises there: T down + emitted, then G falling + g, then R up on top of it.
void sweep_down(const Stack* t, int place)
{
    const int n = t->s.n, p = t->s.p, r = t->s.r, ld = t->s.ld;
    const long beams = (long)r * p;
    __global const real *R = slab_of(t, t->R, place).M, *T = slab_of(t, t->T, place).M;
    __global real *falling = t->down + (place + 1) * beams, *rising = t->up + (place + 1) * beams;
    decay(t, n, place, T + (long)n * ld, ld, falling, p);
    multiply(n, r, n, 1.0, T, ld, falling - beams, p, 1.0, falling, p);
    if (t->dark && place == t->places - 1)
        return;
    copy_columns(n, r, t->g + place * beams, p, rising, p);
    multiply(n, r, n, 1.0, t->G + place * (long)n * p, p, falling, p, 1.0, rising, p);
    multiply(n, r, n, 1.0, R, ld, rising, p, 1.0, falling, p);
}

// running <- straight running + T_ON through + R_ON turned + OI of the attenuated beam, that of `of`; next: spare.
void pass_on(const Stack* t, int place, __global const real* of, __global const real* through, __global const real* turned,
             __global real* running, __global real* next, int o_ld)
{
    const Sizes s = t->s;
    const Extended R = slab_of(t, t->R, place), T = slab_of(t, t->T, place);
    decay(t, s.o, place, slab_of(t, of, place).M + (long)s.n * s.ld + s.p, s.ld, next, o_ld);
    EACH(j, s.r, i, s.o)
        next[(long)j * o_ld + i] += T.OO[i] * running[(long)j * o_ld + i];
    TOGETHER
    multiply(s.o, s.r, s.n, 1.0, T.M + s.p, s.ld, through, s.p, 1.0, next, o_ld);
    multiply(s.o, s.r, s.n, 1.0, R.M + s.p, s.ld, turned, s.p, 1.0, next, o_ld);
    copy_columns(s.o, s.r, next, o_ld, running, o_ld);
}

// The field of a stack; room, up and down begin with zeros. Pieces: items.
KERNEL(LANES, join_slabs)
{
    __local real size[LANES], panel_row[PANEL];
    __local int where[LANES];
    const Sizes s = make_sizes(n, n_rhs, n_out_rows, stokes);
    const int p = s.p, r = s.r, o = s.o, places = n_place, levels = n_level;
    const long item = get_group_id(0), square = (long)n * p, beams = (long)r * p;
    const int o_ld = next_strip(o), axis = flux_axis(s);
    room += item * (square * (places + 4) + beams * (3 * places + 4) + 2L * o_ld * r + 2 * p);
    __global real *G = room, *M = G + places * square, *g = M + 4 * square, *rising = g + places * beams;
    __global real *falling = rising + (places + 1) * beams, *vector = falling + (places + 1) * beams;
    __global real *running = vector + 2 * beams, *next = running + o_ld * r, *row = next + o_ld * r;
    const Stack t = {s, places, turned[item], dark, R, T, lost, slab + item * places, above + item * (places + 1), rates,
                     OF_ITEM(below), absorbed + item * n, rising, falling, G, g, M, M + square, M + 2 * square,
                     M + 3 * square, vector, vector + beams, row,
                     {rest + item * (long)n * PANEL, pivots + item * n, {size, where, panel_row}}};
    int singular = 0;
    if (!dark)
        decay(&t, n, places, OF_ITEM(emitted), emitted_ld, rising + places * beams, p);
    for (int place = places - 1; place >= 0; place--) {
        const real missing = add_below(&t, place, &singular);
        if (LANE == 0)
            residual[item * places + place] = missing;
    }
    for (int place = 0; place < places; place++)
        sweep_down(&t, place);
    for (int level = 0; level < levels && t.turned; level++)
        SPREAD(j, 0, r) {
            const long at = interface[level] * beams + (long)j * p + axis;
            flux[(2 * (item * levels + level)) * r + j] = -flux_size * rising[at];
            flux[(2 * (item * levels + level) + 1) * r + j] = -flux_size * falling[at];
        }
    for (int downward = 0; downward < 2; downward++) {
        __global real* out = (downward ? down : up) + item * levels * (long)r * o;
        SPREAD(k, 0, o_ld * r)
            running[k] = 0.0;
        TOGETHER
        if (!downward && !dark)
            multiply(o, r, n, 1.0, OF_ITEM(base_out), base_out_ld, falling + places * beams, p, 0.0, running, o_ld);
        for (int step = 0; step <= places; step++) {
            const int here = downward ? step : places - step, slab_next = downward ? step : here - 1;
            for (int level = 0; level < levels; level++)
                if (interface[level] == here)
                    copy_columns(o, r, running, o_ld, out + level * (long)r * o, o);
            if (step < places)
                pass_on(&t, slab_next, downward ? T : R, (downward ? falling : rising) + here * beams,
                        downward ? rising + (here + 1) * beams : falling + (here - 1) * beams, running, next, o_ld);
        }
    }
    if (LANE == 0)
        info[item] = singular;
}
