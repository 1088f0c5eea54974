// R of a semi-infinite layer, found in floats, brought to doubles: with what it misses, r = X(R) - R, in doubles, a linear
// correction d = r + X'(R) d in floats, X'(R) d = (d K + (d K)^T) Q/2 over 1/mu + 1/mu', K = phi C H^T. Off the nodes,
// where H on the nodes stands still, d K alone. All matrices are stored column by column.

#define NOW_CONVERGED 2    // what an item's state is, beside RUNS and LEFT: its matrix is made once more

// The factor of a row's and a column's cosine that every product is weighted with, the sign of V's column included.
real share_of(real row_mu, real column_mu)
{
    const real mu = fabs(row_mu);
    return 0.5 * column_mu * mu / (mu + fabs(column_mu));
}

// What all lanes of a piece have, added up, to all of them; shelf: room for one of each.
real sum_of_lanes(real mine, __local real* shelf)
{
    shelf[LANE] = mine;
    for (int apart = LANES / 2; apart > 0; apart /= 2) {
        TOGETHER
        if (LANE < apart)
            shelf[LANE] += shelf[LANE + apart];
    }
    TOGETHER
    const real found = shelf[0];
    TOGETHER
    return found;
}

// H = +-phi, plus for E's columns. Pieces: columns, items.
SHARED
__kernel void signed_phi(int rows, INTS counts, STACK(phi), STACK(H), INTS items)
{
    const int column = get_group_id(0);
    const long item = items[get_group_id(1)];
    const real sign = column < number_of_columns(counts, item, 0) ? 1.0 : -1.0;
    phi = OF_ITEM(phi) + (long)column * phi_ld;
    H = OF_ITEM(H) + (long)column * H_ld;
    SPREAD(i, 0, H_ld)
        H[i] = sign * phi[i];
}

// found (item, column, 2): how much R misses where H C H^T = Y, the largest of X - R and of X. Pieces: columns, items.
SHARED
__kernel void find_missing(int rows, IN row_mu, IN signed_mu, STACK(Y), STACK(R), OUT found, INTS items)
{
    __local real shelf[LANES];
    const int column = get_group_id(0);
    const long item = items[get_group_id(1)];
    real gap = 0.0, largest = 0.0;
    Y = OF_ITEM(Y) + (long)column * Y_ld;
    R = OF_ITEM(R) + (long)column * R_ld;
    SPREAD(i, 0, rows) {
        const real now = Y[i] * share_of(row_mu[i], signed_mu[column]);
        gap = larger(gap, fabs(now - R[i]));
        largest = larger(largest, fabs(now));
    }
    gap = largest_of_lanes(gap, shelf);
    largest = largest_of_lanes(largest, shelf);
    if (LANE == 0) {
        found[(item * get_num_groups(0) + column) * 2] = gap;
        found[(item * get_num_groups(0) + column) * 2 + 1] = largest;
    }
}

// gap (item,): the largest of what is missing; missing (item,): the same as it is estimated of the whole way, relative. It
// is R that is kept, not X, which would be closer by the rate.
// Global size: items.
__kernel void judge_missing(int columns, IN found, IN rate, OUT gap, OUT missing, INTS items)
{
    const long item = items[get_global_id(0)];
    real most = 0.0, largest = 0.0;
    for (int j = 0; j < columns; j++) {
        most = larger(most, found[(item * columns + j) * 2]);
        largest = larger(largest, found[(item * columns + j) * 2 + 1]);
    }
    gap[item] = most;
    missing[item] = largest > 0.0 ? most / (1.0 - rate[item]) / largest : most;
}

// led = r + P over the rates, moved = led - R, and their sums found (item, column, 5) as of `invariance_step_gpu`;
// mirrored: whether P's transpose belongs to it. Pieces: columns, items.
SHARED
__kernel void lead_on(int mirrored, int rows, IN row_mu, IN signed_mu, STACK(P), IN r, STEPS, OUT found, INTS state,
                      INTS items)
{
    __local real shelf[LANES];
    const int column = get_group_id(0), columns = get_num_groups(0);
    const long item = items[get_group_id(1)], place = (item * columns + column) * P_ld;
    if (state[item] != RUNS)
        return;
    P = OF_ITEM(P);
    found += (item * columns + column) * 5;
    real mine[5] = {0.0, 0.0, 0.0, 0.0, 0.0};
    SPREAD(i, 0, rows) {
        const real value = P[(long)column * P_ld + i] + (mirrored ? P[(long)i * P_ld + column] : 0.0);
        const real now = r[place + i] + value * share_of(row_mu[i], signed_mu[column]), change = now - R[place + i];
        led[place + i] = now;
        moved[place + i] = change;
        mine[0] += change * change;
        mine[1] += change * moved_1[place + i];
        mine[2] += change * moved_2[place + i];
        mine[3] = larger(mine[3], fabs(change));
        mine[4] = larger(mine[4], fabs(now));
    }
    for (int v = 0; v < 5; v++) {
        const real all = v < 3 ? sum_of_lanes(mine[v], shelf) : largest_of_lanes(mine[v], shelf);
        if (LANE == 0)
            found[v] = all;
    }
}

// Whether an item has converged, and what its next matrix is made of; see `judged`. Global size: items.
__kernel void judge_step(int step, int columns, IN found, IN rate, IN tolerance, __global Convergence* restrict convergence,
                         __global int* restrict steps, __global int* restrict state, INTS items)
{
    const long item = items[get_global_id(0)];
    if (state[item] != RUNS) {
        state[item] = LEFT;
        return;
    }
    bool done;
    convergence[item] = judge_item(step, columns, found + item * columns * 5, rate[item], tolerance[item], convergence[item],
                                &done);
    steps[item]++;
    if (done)
        state[item] = NOW_CONVERGED;
}

// R of the last steps. Pieces: columns, items.
SHARED
__kernel void mix_steps(int rows, int ld, STEPS, __global const Convergence* restrict convergence, INTS state, INTS items)
{
    const long item = items[get_group_id(1)], place = (item * get_num_groups(0) + get_group_id(0)) * ld;
    if (state[item] == LEFT)
        return;
    const real share = convergence[item].share[0], share_1 = convergence[item].share[1], share_2 = convergence[item].share[2];
    SPREAD(i, 0, rows) {
        real value = share * led[place + i];
        if (share_1 != 0.0)
            value += share_1 * led_1[place + i];
        if (share_2 != 0.0)
            value += share_2 * led_2[place + i];
        R[place + i] = value;
    }
}
