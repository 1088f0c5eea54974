#include <math.h>

#include "constants.h"
#include "wide.h"

/* Azimuths are done VRTE_BLOCK at a time. */
enum { VRTE_BLOCK = 32 };

/* F11, F44, F12, F34, F22 + F33, F22 - F33 at the cosines x, one a row of f; terms is even. A row of the table: the
   factors of d^{l+1} = (a x -+ b) d^l - c d^{l-1} (a, c of d_00; a, c of d_02; a, b, c of d_2,+-2), then the
   coefficients. Two terms at a time: their functions stay in registers, and so do the sums. */
VRTE_INLINE void vrte_series(int terms, const double* table, const double* x, double* f) {
    double p[VRTE_BLOCK], p_old[VRTE_BLOCK], q[VRTE_BLOCK], q_old[VRTE_BLOCK];
    double u[VRTE_BLOCK], u_old[VRTE_BLOCK], w[VRTE_BLOCK], w_old[VRTE_BLOCK];
    double *f11 = f, *f44 = f + VRTE_BLOCK, *f12 = f + 2 * VRTE_BLOCK, *f34 = f + 3 * VRTE_BLOCK;
    double *sum = f + 4 * VRTE_BLOCK, *difference = f + 5 * VRTE_BLOCK;
    const double *s = table, *t = table + SERIES;
    for (int i = 0; i < VRTE_BLOCK; i++) {
        f11[i] = s[7] + t[7] * x[i];
        f44[i] = s[8] + t[8] * x[i];
        f12[i] = f34[i] = sum[i] = difference[i] = 0.0;
        p[i] = 1.5 * x[i] * x[i] - 0.5;
        p_old[i] = x[i];
        q[i] = -0.6123724356957945 * (1.0 - x[i]) * (1.0 + x[i]); /* sqrt(6)/4 */
        u[i] = 0.25 * (1.0 + x[i]) * (1.0 + x[i]);
        w[i] = 0.25 * (1.0 - x[i]) * (1.0 - x[i]);
        q_old[i] = u_old[i] = w_old[i] = 0.0;
    }
    for (int l = 2; l < terms; l += 2) {
        s = table + SERIES * l;
        t = s + SERIES;
        for (int i = 0; i < VRTE_BLOCK; i++) {
            double p_next = s[0] * x[i] * p[i] - s[1] * p_old[i], q_next = s[2] * x[i] * q[i] - s[3] * q_old[i];
            f11[i] += s[7] * p[i] + t[7] * p_next;
            f44[i] += s[8] * p[i] + t[8] * p_next;
            f12[i] += s[9] * q[i] + t[9] * q_next;
            f34[i] += s[10] * q[i] + t[10] * q_next;
            p[i] = t[0] * x[i] * p_next - t[1] * p[i];
            q[i] = t[2] * x[i] * q_next - t[3] * q[i];
            p_old[i] = p_next;
            q_old[i] = q_next;
        }
        for (int i = 0; i < VRTE_BLOCK; i++) {
            double u_next = (s[4] * x[i] - s[5]) * u[i] - s[6] * u_old[i];
            double w_next = (s[4] * x[i] + s[5]) * w[i] - s[6] * w_old[i];
            sum[i] += s[11] * u[i] + t[11] * u_next;
            difference[i] += s[12] * w[i] + t[12] * w_next;
            u[i] = (t[4] * x[i] - t[5]) * u_next - t[6] * u[i];
            w[i] = (t[4] * x[i] + t[5]) * w_next - t[6] * w[i];
            u_old[i] = u_next;
            w_old[i] = w_next;
        }
    }
}

/* F11 alone, of a phase matrix that has no other: 8 cosines at a time, whose functions stay in registers. */
enum { VRTE_FEW = 8 };
VRTE_INLINE void vrte_scalar_series(int terms, const double* table, int count, const double* x, double* f) {
    for (int first = 0; first < count; first += VRTE_FEW) {
        double p[VRTE_FEW], p_old[VRTE_FEW], sum[VRTE_FEW];
        const double* at = x + first;
        for (int i = 0; i < VRTE_FEW; i++) {
            sum[i] = table[7] + table[SERIES + 7] * at[i];
            p[i] = 1.5 * at[i] * at[i] - 0.5;
            p_old[i] = at[i];
        }
        for (int l = 2; l < terms; l += 2) {
            const double *s = table + SERIES * l, *t = s + SERIES;
            for (int i = 0; i < VRTE_FEW; i++) {
                double p_next = s[0] * at[i] * p[i] - s[1] * p_old[i];
                sum[i] += s[7] * p[i] + t[7] * p_next;
                p[i] = t[0] * at[i] * p_next - t[1] * p[i];
                p_old[i] = p_next;
            }
        }
        for (int i = 0; i < VRTE_FEW; i++) f[first + i] = sum[i];
    }
}

/* cos and sin of twice the angles from the scattering plane to the meridian planes, outgoing then incident: 4 rows
   of turns. l is theta-hat, r = l x k; n, normal to the scattering plane, is k x k'; in a plane with r_s = n:
   cos(sigma) = n.r and sin(sigma) = -n.l. Straight on and straight back the meridian plane serves. */
VRTE_INLINE void vrte_turns(double mu0, double mu, int count, const double* cos_phi, const double* sin_phi,
                            double* turns) {
    double sine0 = sqrt((1.0 - mu0) * (1.0 + mu0)), sine = sqrt((1.0 - mu) * (1.0 + mu));
    for (int i = 0; i < count; i++) {
        double kx = sine * cos_phi[i], ky = sine * sin_phi[i], kz = mu; /* outgoing; incident: (sine0, 0, -mu0) */
        double lx = mu * cos_phi[i], ly = mu * sin_phi[i], lz = -sine;
        double rx = ly * kz - lz * ky, ry = lz * kx - lx * kz; /* l x k is horizontal */
        double nx = -ky * mu0, ny = kz * sine0 + kx * mu0, nz = -ky * sine0;
        int none = nx * nx + ny * ny + nz * nz < 1e-18;
        nx = none ? rx : nx;
        ny = none ? ry : ny;
        nz = none ? 0.0 : nz;
        double c = nx * rx + ny * ry, s = -(nx * lx + ny * ly + nz * lz), length = c * c + s * s;
        turns[i] = (c * c - s * s) / length;
        turns[VRTE_BLOCK + i] = 2.0 * c * s / length;
        c = -ny; /* incident: l' = (-mu0, 0, -sine0), r' = l' x k' = (0, -1, 0) */
        s = nx * mu0 + nz * sine0;
        length = c * c + s * s;
        turns[2 * VRTE_BLOCK + i] = (c * c - s * s) / length;
        turns[3 * VRTE_BLOCK + i] = 2.0 * c * s / length;
    }
}

/* The phase matrix times one column (g, h) within (I, Q), kind 0, or (U, V), kind 1: 4 rows of z. */
VRTE_INLINE void vrte_scattered(int kind, double g, double h, int count, const double* f, const double* turns,
                                double* z, size_t stride) {
    for (int i = 0; i < count; i++) {
        double a1 = f[i], a4 = f[VRTE_BLOCK + i], b1 = f[2 * VRTE_BLOCK + i], b2 = f[3 * VRTE_BLOCK + i];
        double a2 = 0.5 * (f[4 * VRTE_BLOCK + i] + f[5 * VRTE_BLOCK + i]);
        double a3 = 0.5 * (f[4 * VRTE_BLOCK + i] - f[5 * VRTE_BLOCK + i]);
        double c = turns[i], s = turns[VRTE_BLOCK + i];
        double c_in = turns[2 * VRTE_BLOCK + i], s_in = turns[3 * VRTE_BLOCK + i];
        double i_s = kind ? b1 * s_in * g : a1 * g + b1 * c_in * h; /* I, Q, U, V in the scattering plane */
        double q_s = kind ? a2 * s_in * g : b1 * g + a2 * c_in * h;
        double u_s = kind ? a3 * c_in * g + b2 * h : -a3 * s_in * h;
        double v_s = kind ? a4 * h - b2 * c_in * g : b2 * s_in * h;
        z[i] = i_s;
        z[stride + i] = c * q_s - s * u_s;
        z[2 * stride + i] = s * q_s + c * u_s;
        z[3 * stride + i] = v_s;
    }
}

VRTE_INLINE void vrte_scatter(int scalar, int terms, const double* table, double mu0, double mu, int count,
                              const double* cos_phi, const double* sin_phi, int n_col, const int* kind,
                              const double* columns, double* z, size_t stride) {
    double x[VRTE_BLOCK] = {0.0}, f[6 * VRTE_BLOCK], turns[4 * VRTE_BLOCK];
    double sines = sqrt((1.0 - mu) * (1.0 + mu)) * sqrt((1.0 - mu0) * (1.0 + mu0));
    for (int i = 0; i < count; i++) {
        double cosine = sines * cos_phi[i] - mu * mu0;
        x[i] = cosine > 1.0 ? 1.0 : cosine < -1.0 ? -1.0 : cosine;
    }
    if (scalar) { /* only I, and of I alone */
        vrte_scalar_series(terms, table, count, x, f);
        for (int c = 0; c < n_col; c++) {
            double *out = z + 4 * c * stride, intensity = kind[c] ? 0.0 : columns[4 * c];
            for (int i = 0; i < count; i++) {
                out[i] = f[i] * intensity;
                out[stride + i] = out[2 * stride + i] = out[3 * stride + i] = 0.0;
            }
        }
        return;
    }
    vrte_series(terms, table, x, f);
    vrte_turns(mu0, mu, count, cos_phi, sin_phi, turns);
    for (int c = 0; c < n_col; c++) {
        const double* pair = columns + 4 * c + 2 * kind[c];
        if (kind[c])
            vrte_scattered(1, pair[0], pair[1], count, f, turns, z + 4 * c * stride, stride);
        else
            vrte_scattered(0, pair[0], pair[1], count, f, turns, z + 4 * c * stride, stride);
    }
}

/* F11, F44, F12, F34, F22 + F33, F22 - F33 at count cosines x, a row of f each, stride apart. */
VRTE_INLINE void vrte_elements(int scalar, int terms, const double* table, int count, const double* x, double* f,
                               size_t stride) {
    for (int first = 0; first < count; first += VRTE_BLOCK) {
        double at[VRTE_BLOCK] = {0.0}, block[6 * VRTE_BLOCK] = {0.0};
        int here = count - first < VRTE_BLOCK ? count - first : VRTE_BLOCK;
        for (int i = 0; i < here; i++) at[i] = x[first + i];
        if (scalar)
            vrte_scalar_series(terms, table, VRTE_BLOCK, at, block);
        else
            vrte_series(terms, table, at, block);
        for (int k = 0; k < 6; k++)
            for (int i = 0; i < here; i++) f[k * stride + first + i] = block[k * VRTE_BLOCK + i];
    }
}

VRTE_TWICE(void, vrte_scatter,
           (int scalar, int terms, const double* table, double mu0, double mu, int count, const double* cos_phi,
            const double* sin_phi, int n_col, const int* kind, const double* columns, double* z, size_t stride),
           vrte_scatter(scalar, terms, table, mu0, mu, count, cos_phi, sin_phi, n_col, kind, columns, z, stride))
VRTE_TWICE(void, vrte_elements,
           (int scalar, int terms, const double* table, int count, const double* x, double* f, size_t stride),
           vrte_elements(scalar, terms, table, count, x, f, stride))
