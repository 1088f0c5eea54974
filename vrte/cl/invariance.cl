// The top of a semi-infinite layer, by invariance: fixed points of
//   R = (He Ce He'^T - Hf Cf Hf'^T)/2 over 1/mu + 1/mu',  He = phi_e + R phi_e,  Hf = phi_f - R phi_f,
// with Anderson's acceleration. E's and F's columns lie side by side, Hf with the other sign (it counts twice), so that
// H = +-phi + R phi and R = HC H^T are one product each. A strip of 8 rows needs all of H but of all else no other strip:
// what only strips read (R, the last steps, HC) is stored strip by strip, column by column within.

#define STRIP 8

// Of an item: what the last steps moved, as scalar products (this one's first), and how the next R is made of them.
typedef struct
{
    real product_00, product_01, product_11;
    real share[3];
    real missing;
} Convergence;

// What a step gains at least, the largest albedo |B_l| / (2 l + 1) of the degrees m .. terms - 1.
real rate_of_item(int m, int terms, real albedo, __global const real* c)
{
    real largest = 0.0;
    for (int l = m; l < terms; l++) {
        __global const real* b = c + 6 * l;
        largest = fmax(largest, albedo * vrte_norm_of_degree(b[0], b[1], b[2], b[3], b[4], b[5]) / (2.0 * l + 1.0));
    }
    return fmin(largest, (real)0.999);
}

#define SHARE_OF_COLUMN(x) if (j + x < columns) { \
    const real cosine = signed_mu[j + x], size = fabs(cosine); \
    const real times = j + x < twice ? 2.0 : 1.0; \
    const int k = (j + x) * STRIP; \
    const real4 now_top = top##x * (0.5 * cosine * mu_top / (mu_top + size)); \
    const real4 now_low = low##x * (0.5 * cosine * mu_low / (mu_low + size)); \
    const real4 moved_top = now_top - AT(R + k, 0), moved_low = now_low - AT(R + k, 1); \
    PUT(led + k, 0) = now_top; \
    PUT(led + k, 1) = now_low; \
    PUT(moved + k, 0) = moved_top; \
    PUT(moved + k, 1) = moved_low; \
    squares += times * (moved_top * moved_top + moved_low * moved_low); \
    products_1 += times * (moved_top * AT(moved_1 + k, 0) + moved_low * AT(moved_1 + k, 1)); \
    products_2 += times * (moved_top * AT(moved_2 + k, 0) + moved_low * AT(moved_2 + k, 1)); \
    gap = LARGER(LARGER(gap, SIZE(moved_top)), SIZE(moved_low)); \
    largest = LARGER(LARGER(largest, SIZE(now_top)), SIZE(now_low)); }
#define LARGER(a, b) ((a) > (b) ? (a) : (b))
#define SIZE(a) LARGER(a, -(a))
#define SIGNED(a, x) ((x) < 0.0 ? -(a) : (a))
#define SUM(a) ((a).x + (a).y + ((a).z + (a).w))
#define LARGEST(a) LARGER(LARGER((a).x, (a).y), LARGER((a).z, (a).w))

// One step of a strip: led = HC H^T Q/2 over 1/mu + 1/mu', moved = led - R; adds to `found` of what moved, and of the two
// steps before, the scalar products, then what moved most and led's largest. On the nodes themselves (`symmetric`) R Q is
// symmetric: a strip ends with the block of 8 columns on the diagonal.
void step_of_strip(int strip, bool symmetric, int n, int inner, __global const real* row_mu,
                   __global const real* signed_mu, __global const real* HC, int h_columns, __global const real* H,
                   int h_ld, __global const real* R, __global real* led, __global real* moved,
                   __global const real* moved_1, __global const real* moved_2, real* found)
{
    const int a_ld = STRIP, b_row = h_ld, b_column = 1, place = strip * STRIP * n;
    const int twice = symmetric ? STRIP * strip : 0, columns = symmetric ? min(n, twice + STRIP) : n;
    const real4 mu_top = fabs(AT(row_mu, 2 * strip)), mu_low = fabs(AT(row_mu, 2 * strip + 1));
    __global const real* A = HC + (long)strip * STRIP * h_columns;
    __global const real* B = H;
    real4 squares = 0.0, products_1 = 0.0, products_2 = 0.0, gap = 0.0, largest = 0.0;
    R += place;
    led += place;
    moved += place;
    moved_1 += place;
    moved_2 += place;
    for (int j = 0; j < columns; j += TILE_COLUMNS) {
        __global const real* a = A;
        EACH_COLUMN(COLUMN_OF_B)
        EACH_COLUMN(NO_SUMS)
        SUM_TERMS
        EACH_COLUMN(SHARE_OF_COLUMN)
    }
    found[0] += SUM(squares);
    found[1] += SUM(products_1);
    found[2] += SUM(products_2);
    found[3] = LARGER(found[3], LARGEST(gap));
    found[4] = LARGER(found[4], LARGEST(largest));
}

// Whether an item is done (`missing` is what is left of it), and of which steps the next R is made: the combination of this
// one and the last two that would have moved least. found: as of all strips.
Convergence judged(int step, const real* found, real rate, real tolerance, Convergence before, bool* done)
{
    const real largest = found[4], gap = found[0] < INFINITY ? found[3] : found[0];   // comparisons have not seen a NaN
    const real missing = vrte_missing(gap, rate, largest);
    Convergence now = {found[0], found[1], before.product_00, {1.0, 0.0, 0.0}, largest > 0.0 ? missing : 0.0};
    *done = largest == 0.0 || missing <= tolerance || gap <= STALLED * largest;
    if (!*done)
        vrte_accelerate(step, found[0], found[1], found[2], before.product_00, before.product_01, before.product_11, now.share);
    return now;
}

// The double4 k of the next R: shares of what the last steps led to.
real4 mixed(const real* share, __global const real* led, __global const real* led_1,
              __global const real* led_2, int k)
{
    real4 value = share[0] * AT(led, k);
    if (share[1] != 0.0)
        value += share[1] * AT(led_1, k);
    if (share[2] != 0.0)
        value += share[2] * AT(led_2, k);
    return value;
}

// R's block of 4 rows and 4 columns from that on the other side of the diagonal: columns `from` on of strip `other`, its
// upper or lower 4 rows; both have the signs of V's rows and columns. to: the first of the block, in its strip.
void put_mirrored(const real* share, __global const real* led, __global const real* led_1,
                  __global const real* led_2, int n, int other, int low, int from, real4 row_signs,
                  __global const real* column_mu, int left, __global real* to)
{
    const int k = 2 * (other * n + from) + low;
    const real4 a = mixed(share, led, led_1, led_2, k), b = mixed(share, led, led_1, led_2, k + 2);
    const real4 c = mixed(share, led, led_1, led_2, k + 4), d = mixed(share, led, led_1, led_2, k + 6);
    PUT(to, 0) = (real4)(a.x, b.x, c.x, d.x) * SIGNED(row_signs, column_mu[0]);
    if (left > 1)
        PUT(to, 2) = (real4)(a.y, b.y, c.y, d.y) * SIGNED(row_signs, column_mu[1]);
    if (left > 2)
        PUT(to, 4) = (real4)(a.z, b.z, c.z, d.z) * SIGNED(row_signs, column_mu[2]);
    if (left > 3)
        PUT(to, 6) = (real4)(a.w, b.w, c.w, d.w) * SIGNED(row_signs, column_mu[3]);
}

// R of a strip from the last steps, zero at the start (`starting`); `symmetric` as for `step_of_strip`.
void mix_strip(int strip, bool starting, bool symmetric, int n, const real* share, __global const real* led,
               __global const real* led_1, __global const real* led_2, __global const real* signed_mu,
               __global real* R)
{
    const int place = strip * STRIP * n, own = symmetric ? min(n, STRIP * (strip + 1)) : n;
    R += place;
    if (starting) {
        for (int k = 0; k < 2 * n; k++)
            PUT(R, k) = 0.0;
        return;
    }
    for (int k = 0; k < 2 * own; k++)
        PUT(R, k) = mixed(share, led + place, led_1 + place, led_2 + place, k);
    if (own == n)  // off the nodes there may be more rows than signed_mu has
        return;
    const real4 ones = 1.0, mu_top = AT(signed_mu, 2 * strip), mu_low = AT(signed_mu, 2 * strip + 1);
    const real4 signs_top = mu_top < 0.0 ? -ones : ones, signs_low = mu_low < 0.0 ? -ones : ones;
    for (int j = own; j < n; j += 4)
        for (int low = 0; low < 2; low++)
            put_mirrored(share, led, led_1, led_2, n, j / STRIP, j % STRIP / 4, STRIP * strip + 4 * low,
                         low ? signs_low : signs_top, signed_mu + j, n - j, R + j * STRIP + 4 * low);
}

#define ADD_PHI(x) if (j + x < columns) { \
    const real sign = j + x < columns_E ? 1.0 : -1.0; \
    __global const real* phi = phi_row + (long)(j + x) * phi_ld; \
    __global real* now = H + (long)(j + x) * h_ld; \
    PUT(now, 0) = top##x + sign * AT(phi, 0); \
    PUT(now, 1) = low##x + sign * AT(phi, 1); }

// H of a strip = +-phi + R phi_nodes; inner: n, or none where R is zero.
void renew_strip(int strip, int inner, int n, int columns, int columns_E, __global const real* phi_nodes,
                 __global const real* phi_row, int phi_ld, __global const real* R, __global real* H, int h_ld)
{
    const int a_ld = STRIP, b_row = 1, b_column = phi_ld;
    __global const real* B = phi_nodes;
    phi_row += STRIP * strip;
    H += STRIP * strip;
    for (int j = 0; j < columns; j += TILE_COLUMNS) {
        __global const real* a = R + strip * STRIP * n;
        EACH_COLUMN(COLUMN_OF_B)
        EACH_COLUMN(NO_SUMS)
        SUM_TERMS
        EACH_COLUMN(ADD_PHI)
    }
}

// The place in a list of `number` for a work-group: drivers give each of their `units` a range of them, and orders
// that follow each other take alike many steps; so the first range has every units-th item, the next one those after them.
int dealt(int group, int number, int units)
{
    int unit = 0, left = group;
    for (int share = (number + units - 1) / units; left >= share; share = (number - unit + units - 1) / units) {
        left -= share;
        unit++;
    }
    return left * units + unit;
}

// As many fixed points as an item needs, strips shared by the lanes: R, H and what is missing of it. Pieces: items.
KERNEL(LANES, invariance_converge)
{
    __local real shelf[LANES];
    const int strips = H_ld / STRIP;
    const long item = dealt(get_group_id(0), get_num_groups(0), units), size = (long)strips * STRIP * n, place = item * size;
    const long all = size * get_num_groups(0);
    __global real *led = steps_led + place, *led_1 = led + all, *led_2 = led_1 + all;          // the latest first
    __global real *moved = steps_moved + place, *moved_1 = moved + all, *moved_2 = moved_1 + all;
    const int columns = number_of_columns(counts, item, 2), of = material[item];
    const real rate = rate_of_item(order[item], terms[of], albedo[of], coefficients + of * (long)6 * n_term);
    Convergence convergence = {0.0, 0.0, 0.0, {1.0, 0.0, 0.0}, 1.0};
    bool done = false;
    R += place;
    phi += item * phi_stride;
    H = OF_ITEM(H);
    HC = OF_ITEM(HC);
    nodes_H = OF_ITEM(nodes_H);
    for (int step = -1; step < most && !done; step++) {
        if (step >= 0) {
            real found[5] = {0.0, 0.0, 0.0, 0.0, 0.0};
            SPREAD(strip, 0, strips)
                step_of_strip(strip, symmetric, n, columns, row_mu, column_mu, HC, n_columns, nodes_H, nodes_H_ld, R, led,
                              moved, moved_1, moved_2, found);
            for (int v = 0; v < 5; v++)
                found[v] = of_lanes(v < 3, found[v], shelf);
            convergence = judged(step, found, rate, tolerance[item], convergence, &done);
        }
        SPREAD(strip, 0, strips) {
            mix_strip(strip, step < 0, symmetric, n, convergence.share, led, led_1, led_2, column_mu, R);
            renew_strip(strip, step < 0 ? 0 : n, n, columns, number_of_columns(counts, item, 0), phi, phi + phi_first,
                        phi_ld, R, H, H_ld);
            for (int odd = 0; odd < 2 && columns > 0; odd++) {
                const long begin = first_column(counts, item, odd);
                multiply_by_coefficients(order[item], order[item], terms[of], bits, odd, odd ? -albedo[of] : albedo[of], -1.0,
                                         coefficients + of * (long)6 * n_term, 0, 2, 1, H + STRIP * strip + begin * H_ld, H_ld,
                                         HC + (strip * (long)n_columns + begin) * STRIP, STRIP);
            }
        }
        if (step >= 0) {
            __global real* oldest = led_2;
            led_2 = led_1;
            led_1 = led;
            led = oldest;
            oldest = moved_2;
            moved_2 = moved_1;
            moved_1 = moved;
            moved = oldest;
            if (LANE == 0)
                steps[item]++;
        }
        TOGETHER
    }
    if (LANE == 0 && !(convergence.missing <= residual[item]))
        residual[item] = convergence.missing;
}
