// Single scattering over all Fourier orders in closed form: the phase matrix at the scattering angle, turned to the
// meridian planes. Four azimuths at a time.

// F11, F44, F12, F34, F22 + F33, F22 - F33 at the cosines x by recurrences in the degree; terms is even.
void sum_series(int terms, __global const real* s, real4 x, real4* f)
{
    real4 f11 = s[7] + s[SERIES + 7] * x, f44 = s[8] + s[SERIES + 8] * x;
    real4 f12 = (real4)(0.0), f34 = f12, sum = f12, difference = f12;
    real4 p_old = x, q_old = f12, u_old = f12, w_old = f12;
    real4 p = 1.5 * x * x - 0.5, q = -0.6123724356957945 * (1.0 - x) * (1.0 + x);     // sqrt(6)/4
    real4 u = 0.25 * (1.0 + x) * (1.0 + x), w = 0.25 * (1.0 - x) * (1.0 - x);
    for (int l = 2; l < terms; l++) {
        s = s + (l == 2 ? 2 * SERIES : SERIES);
        f11 += s[7] * p;
        f44 += s[8] * p;
        f12 += s[9] * q;
        f34 += s[10] * q;
        sum += s[11] * u;
        difference += s[12] * w;
        const real4 p_now = p, q_now = q, u_now = u, w_now = w;
        p = s[0] * x * p - s[1] * p_old;
        q = s[2] * x * q - s[3] * q_old;
        u = (s[4] * x - s[5]) * u - s[6] * u_old;
        w = (s[4] * x + s[5]) * w - s[6] * w_old;
        p_old = p_now;
        q_old = q_now;
        u_old = u_now;
        w_old = w_now;
    }
    f[0] = f11;
    f[1] = f44;
    f[2] = f12;
    f[3] = f34;
    f[4] = sum;
    f[5] = difference;
}

// cos and sin of twice the angles from the scattering plane to the meridian planes, outgoing then incident. l is
// theta-hat, r = l x k; n, normal to the scattering plane, is k x k'; in a plane with r_s = n: cos(sigma) = n.r and
// sin(sigma) = -n.l. Straight on and straight back the meridian plane serves.
void find_turns(real mu0, real mu, real4 cos_phi, real4 sin_phi, real4* turns)
{
    const real sine0 = sqrt((1.0 - mu0) * (1.0 + mu0)), sine = sqrt((1.0 - mu) * (1.0 + mu));
    const real4 kx = sine * cos_phi, ky = sine * sin_phi;      // outgoing; incident: (sine0, 0, -mu0)
    const real4 lx = mu * cos_phi, ly = mu * sin_phi;          // r = (ry, -rx, 0), as l x k is horizontal
    const real4 rx = ly * mu + sine * ky, ry = -sine * kx - lx * mu;
    real4 nx = -ky * mu0, ny = mu * sine0 + kx * mu0, nz = -ky * sine0;
    const long4 none = nx * nx + ny * ny + nz * nz < 1e-18;
    nx = none ? rx : nx;
    ny = none ? ry : ny;
    nz = none ? (real4)(0.0) : nz;
    real4 c = nx * rx + ny * ry, s = -(nx * lx + ny * ly - nz * sine), length = c * c + s * s;
    turns[0] = (c * c - s * s) / length;
    turns[1] = 2.0 * c * s / length;
    c = -ny;                                                      // incident: l' = (-mu0, 0, -sine0), r' = (0, -1, 0)
    s = nx * mu0 + nz * sine0;
    length = c * c + s * s;
    turns[2] = (c * c - s * s) / length;
    turns[3] = 2.0 * c * s / length;
}

// f of `sum_series` and turns of `find_turns` at four azimuths.
void see_angles(int terms, __global const real* table, real mu0, real mu, real4 cos_phi, real4 sin_phi, real4* f,
                real4* turns)
{
    real4 x = sqrt((1.0 - mu) * (1.0 + mu)) * sqrt((1.0 - mu0) * (1.0 + mu0)) * cos_phi - mu * mu0;
    x = x > 1.0 ? (real4)(1.0) : x;
    x = x < -1.0 ? (real4)(-1.0) : x;
    sum_series(terms, table, x, f);
    find_turns(mu0, mu, cos_phi, sin_phi, turns);
}

// z (Stokes): the phase matrix times one column, (g, h) within (I, Q), kind 0, or (U, V), kind 1.
void scatter_column(int kind, real g, real h, const real4* f, const real4* turns, real4* z)
{
    const real4 a2 = 0.5 * (f[4] + f[5]), a3 = 0.5 * (f[4] - f[5]), c_in = turns[2], s_in = turns[3];
    real4 q, u;                                                 // in the scattering plane
    if (kind) {
        z[0] = f[2] * s_in * g;
        q = a2 * s_in * g;
        u = a3 * c_in * g + f[3] * h;
        z[3] = f[1] * h - f[3] * c_in * g;
    } else {
        z[0] = f[0] * g + f[2] * c_in * h;
        q = f[2] * g + a2 * c_in * h;
        u = -a3 * s_in * h;
        z[3] = f[3] * s_in * h;
    }
    z[1] = turns[0] * q - turns[1] * u;
    z[2] = turns[1] * q + turns[0] * u;
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
        scatter_column(kind[c], pair[0], pair[1], f, turns, z);
        for (int s = 0; s < 4; s++)
            for (int a = 0; a < 4; a++) {
                const real value = ((const real*)(z + s))[a];
                ((real*)(seen + a * n_place))[s * n_place + place[c]] += value;
                ((real*)(seen + (4 + a) * n_place))[s * n_place + place[c]] +=
                    (s >= 2) == (kind[c] == 1) ? value : -value;
            }
    }
}

// table (terms, SERIES); path (n_level, n_in, n_mu): what multiplies the phase matrix; mu0 (n_in,) > 0, mu (n_mu,) signed,
// public; cos_phi, sin_phi (n_angle,), padded to a multiple of 4; columns (n_col, 4) within (I, Q) or, kind 1, (U, V),
// place (n_col,) in the result's last axis. Pieces: `each` directions, n_in; a lane has a tile of four of a direction's angles.
#define SCATTERED IN table, int terms, IN path, IN mu0, IN mu, IN cos_phi, IN sin_phi, int n_col, IN columns, INTS kind, \
    INTS place

SHARED
__kernel void add_scattering(SCATTERED, int each, TABLE)
{
    const int i = get_group_id(1), begin_mu = each * get_group_id(0), tiles = (n_angle + 3) / 4;
    const long pairs = (long)n_in * n_mu;
    real4 seen[8 * MOST_COLUMNS];      // four angles and their mirror images, a row (4, n_place) each
    SPREAD(tile, begin_mu * tiles, min(n_mu, begin_mu + each) * tiles) {
        const int j = tile / tiles, angle = tile % tiles * 4;
        const long pair = (long)i * n_mu + j;
        int lit = 0;
        for (int t = 0; t < n_level; t++)
            lit |= path[t * pairs + pair] != 0.0;
        if (!lit)
            continue;
        real4 f[6], turns[4];
        see_angles(terms, table, mu0[i], mu[j], AT(cos_phi, angle / 4), AT(sin_phi, angle / 4), f, turns);
        see_columns(f, turns, n_col, columns, kind, place, n_place, seen);
        for (int t = 0; t < n_level; t++)
            for (int a = 0; a < min(4, n_angle - angle); a++)
                for (int use = first_use[angle + a]; use < first_use[angle + a + 1]; use++) {
                    const real4* from = seen + (mirror[use] < 0.0 ? a + 4 : a) * n_place;
                    const long row = (t * pairs + pair) * n_phi + azimuth[use];
                    for (int k = 0; k < n_place; k++)
                        *(__global loose4*)(out + (row * n_place + k) * 4) += path[t * pairs + pair] * from[k];
                }
    }
}
