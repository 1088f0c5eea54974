#include "kernels/in_c.h"

/* Azimuths are done VRTE_BLOCK at a time. */
enum { VRTE_BLOCK = 32 };

/* F11, F44, F12, F34, F22 + F33, F22 - F33 at the cosines x, one a row of f; terms is even. Two terms at a time: their
   functions stay in registers, and so do the sums. */
VRTE_INLINE void vrte_series(int terms, const double* table, const double* x, double* f) {
    double p[VRTE_BLOCK], p_old[VRTE_BLOCK], q[VRTE_BLOCK], q_old[VRTE_BLOCK];
    double u[VRTE_BLOCK], u_old[VRTE_BLOCK], w[VRTE_BLOCK], w_old[VRTE_BLOCK];
    double *f11 = f, *f44 = f + VRTE_BLOCK, *f12 = f + 2 * VRTE_BLOCK, *f34 = f + 3 * VRTE_BLOCK;
    double *sum = f + 4 * VRTE_BLOCK, *difference = f + 5 * VRTE_BLOCK;
    for (int i = 0; i < VRTE_BLOCK; i++) {
        f11[i] = table[7] + table[SERIES + 7] * x[i];
        f44[i] = table[8] + table[SERIES + 8] * x[i];
        f12[i] = f34[i] = sum[i] = difference[i] = q_old[i] = u_old[i] = w_old[i] = 0.0;
        vrte_start_series(x[i], p + i, q + i, u + i, w + i);
        p_old[i] = x[i];
    }
    for (int l = 2; l < terms; l += 2) {
        const double* s = table + SERIES * l;
        for (int i = 0; i < VRTE_BLOCK; i++)
            vrte_add_two(s, x[i], p + i, p_old + i, q + i, q_old + i, f11 + i, f44 + i, f12 + i, f34 + i);
        for (int i = 0; i < VRTE_BLOCK; i++)
            vrte_add_two_polar(s, x[i], u + i, u_old + i, w + i, w_old + i, sum + i, difference + i);
    }
}

/* F11 alone, of a phase matrix that has no other: 16 cosines at a time, whose functions stay in registers. */
enum { VRTE_FEW = 16 };
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

VRTE_INLINE void vrte_scatter(int scalar, int terms, const double* table, double mu0, double mu, int count,
                              const double* cos_phi, const double* sin_phi, int n_col, const int* kind,
                              const double* columns, double* z, size_t stride) {
    double x[VRTE_BLOCK] = {0.0}, f[6 * VRTE_BLOCK], turns[4 * VRTE_BLOCK];
    double sine0 = sqrt((1.0 - mu0) * (1.0 + mu0)), sine = sqrt((1.0 - mu) * (1.0 + mu)), sines = sine * sine0;
    double *cos_in = turns + 2 * VRTE_BLOCK, *sin_in = turns + 3 * VRTE_BLOCK;
    for (int i = 0; i < count; i++) x[i] = vrte_scattering_cosine(sines, mu0, mu, cos_phi[i]);
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
    for (int i = 0; i < count; i++)
        vrte_turns(mu0, mu, sine0, sine, cos_phi[i], sin_phi[i], turns + i, turns + VRTE_BLOCK + i, cos_in + i,
                   sin_in + i);
    for (int c = 0; c < n_col; c++) {
        const double *pair = columns + 4 * c + 2 * kind[c], *b = f + 2 * VRTE_BLOCK;
        double* out = z + 4 * c * stride;
#define VRTE_COLUMN(KIND)                                                                                         \
    for (int i = 0; i < count; i++)                                                                               \
        vrte_scatter_column(KIND, pair[0], pair[1], f[i], f[VRTE_BLOCK + i], b[i], b[VRTE_BLOCK + i],             \
                            b[2 * VRTE_BLOCK + i], b[3 * VRTE_BLOCK + i], turns[i], turns[VRTE_BLOCK + i],        \
                            cos_in[i], sin_in[i], out + i, out + stride + i, out + 2 * stride + i, out + 3 * stride + i)
        if (kind[c])
            VRTE_COLUMN(1);
        else
            VRTE_COLUMN(0);
#undef VRTE_COLUMN
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
