// Single scattering over all Fourier orders in closed form: the phase matrix at the scattering angle, turned to the
// meridian planes. Four azimuths at a time.

// F11, F44, F12, F34, F22 + F33, F22 - F33 at the cosines x; terms is even.
void sum_series(int terms, __global const real* s, real4 x, real4* f)
{
    real4 p, p_old = x, q, q_old = 0.0, u, u_old = 0.0, w, w_old = 0.0;
    vrte_start_series(x, &p, &q, &u, &w);
    f[0] = s[7] + s[SERIES + 7] * x;
    f[1] = s[8] + s[SERIES + 8] * x;
    f[2] = f[3] = f[4] = f[5] = 0.0;
    for (int l = 2; l < terms; l += 2) {
        s += 2 * SERIES;
        vrte_add_two(s, x, &p, &p_old, &q, &q_old, f, f + 1, f + 2, f + 3);
        vrte_add_two_polar(s, x, &u, &u_old, &w, &w_old, f + 4, f + 5);
    }
}

// f of `sum_series` and turns of `vrte_turns` at four azimuths.
void see_angles(int terms, __global const real* table, real mu0, real mu, real4 cos_phi, real4 sin_phi, real4* f,
                real4* turns)
{
    const real sine0 = sqrt((1.0 - mu0) * (1.0 + mu0)), sine = sqrt((1.0 - mu) * (1.0 + mu));
    sum_series(terms, table, vrte_scattering_cosine(sine * sine0, mu0, mu, cos_phi), f);
    vrte_turns(mu0, mu, sine0, sine, cos_phi, sin_phi, turns, turns + 1, turns + 2, turns + 3);
}

// seen: rows (4, n_place) of four angles, then of their mirror images, Z(-phi) = D Z(phi) D, D = diag(1, 1, -1, -1).
void see_columns(const real4* f, const real4* turns, int n_col, __global const real* columns,
                 __global const int* kind, __global const int* place, int n_place, real4* seen)
{
    for (int k = 0; k < 8 * n_place; k++)
        seen[k] = (real4)(0.0);
    for (int c = 0; c < n_col; c++) {
        __global const real* pair = columns + 4 * c + 2 * kind[c];
        real4 z[4];
        vrte_scatter_column(kind[c], pair[0], pair[1], f[0], f[1], f[2], f[3], f[4], f[5], turns[0], turns[1], turns[2], turns[3],
                            z, z + 1, z + 2, z + 3);
        for (int s = 0; s < 4; s++)
            for (int a = 0; a < 4; a++) {
                const real value = ((const real*)(z + s))[a];
                ((real*)(seen + a * n_place))[s * n_place + place[c]] += value;
                ((real*)(seen + (4 + a) * n_place))[s * n_place + place[c]] +=
                    (s >= 2) == (kind[c] == 1) ? value : -value;
            }
    }
}

// Pieces: `each` directions, n_in times scenes; a lane has a tile of four of a direction's angles.
KERNEL(LANES, add_scattering)
{
    const int i = get_group_id(1) % n_in, stack = get_group_id(1) / n_in;
    const int begin_mu = each * get_group_id(0), tiles = (n_angle + 3) / 4;
    const long pairs = (long)n_in * n_mu;
    real4 seen[8 * MOST_COLUMNS];      // four angles and their mirror images, a row (4, n_target) each
    table += (long)stack * n_term * SERIES;
    path += stack * n_level * pairs;
    out += stack * n_level * pairs * n_phi * 4 * n_target;
    SPREAD(tile, begin_mu * tiles, min(n_mu, begin_mu + each) * tiles) {
        const int j = tile / tiles, angle = tile % tiles * 4;
        const long pair = (long)i * n_mu + j;
        int lit = 0;
        for (int t = 0; t < n_level; t++)
            lit |= path[t * pairs + pair] != 0.0;
        if (!lit)
            continue;
        real4 f[6], turns[4];
        see_angles(n_term, table, mu0[i], mu[j], AT(cosine, angle / 4), AT(sine, angle / 4), f, turns);
        see_columns(f, turns, n_col, columns, kind, place, n_target, seen);
        for (int t = 0; t < n_level; t++)
            for (int a = 0; a < min(4, n_angle - angle); a++)
                for (int use = first_use[angle + a]; use < first_use[angle + a + 1]; use++) {
                    const real4* from = seen + (mirror[use] < 0.0 ? a + 4 : a) * n_target;
                    const long row = (t * pairs + pair) * n_phi + azimuth[use];
                    for (int k = 0; k < n_target; k++)
                        *(__global loose4*)(out + (row * n_target + k) * 4) += path[t * pairs + pair] * from[k];
                }
    }
}
