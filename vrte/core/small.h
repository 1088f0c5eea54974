#pragma once
#include "wide.h"

/* Triangles of some ten rows, matrices by columns, which BLAS is slow at. All work is on whole columns, four at a
   time. */
enum { VRTE_BROAD = 64, VRTE_SIDE = 16 }; /* right-hand sides and rows of a block that is turned over */

/* out -= the columns of a, each a stretch of n rows, times their factors, for `count` of them. */
VRTE_INLINE void vrte_subtract_columns(int n, int count, const double* VRTE_OWN a, int lda,
                                      const double* VRTE_OWN factor, size_t step, double* VRTE_OWN out) {
    int k = 0;
    for (; k + 3 < count; k += 4) {
        const double *c = a + (size_t)k * lda, *c1 = c + lda, *c2 = c1 + lda, *c3 = c2 + lda, *f = factor + k * step;
        double f0 = f[0], f1 = f[step], f2 = f[2 * step], f3 = f[3 * step];
        for (int i = 0; i < n; i++) out[i] -= f0 * c[i] + f1 * c1[i] + f2 * c2[i] + f3 * c3[i];
    }
    for (; k < count; k++) {
        const double *c = a + (size_t)k * lda, f = factor[k * step];
        for (int i = 0; i < n; i++) out[i] -= f * c[i];
    }
}

/* out += factor a x, a (n, count). */
VRTE_INLINE void vrte_add_product(int n, int count, double factor, const double* VRTE_OWN a, int lda,
                                  const double* VRTE_OWN x, double* VRTE_OWN out) {
    double scaled[VRTE_BROAD];
    for (int first = 0; first < count; first += VRTE_BROAD) {
        int here = count - first < VRTE_BROAD ? count - first : VRTE_BROAD;
        for (int k = 0; k < here; k++) scaled[k] = -factor * x[first + k];
        vrte_subtract_columns(n, here, a + (size_t)first * lda, lda, scaled, 1, out);
    }
}

/* x <- x T^-1, x (rows, n): column j is freed of the others that T (n, n) mixes into it, those before it if T is upper,
   those after it else, t[i before + j after] of column i, and divided by its own unless that is one. */
VRTE_INLINE void vrte_unmix(int rows, int n, const double* t, size_t before, size_t after, int upper, int ones,
                           double* x, int ldx) {
    for (int step = 0; step < n; step++) {
        int j = upper ? step : n - 1 - step, first = upper ? 0 : j + 1;
        double* out = x + (size_t)j * ldx;
        vrte_subtract_columns(rows, step, x + (size_t)first * ldx, ldx, t + first * before + j * after, before, out);
        if (!ones) {
            double inverse = 1.0 / t[j * (before + after)];
            for (int i = 0; i < rows; i++) out[i] *= inverse;
        }
    }
}

/* x <- L^-1 x or U^-1 x, x (n, columns), at most VRTE_SIDE x VRTE_BROAD: turned over, columns are what is mixed. */
VRTE_INLINE void vrte_unmix_rows(int n, int columns, const double* lu, int lda, int upper, double* x, int ldx) {
    double turned[VRTE_SIDE * VRTE_BROAD];
    for (int j = 0; j < columns; j++)
        for (int i = 0; i < n; i++) turned[i * columns + j] = x[(size_t)j * ldx + i];
    vrte_unmix(columns, n, lu, lda, 1, !upper, !upper, turned, columns);
    for (int j = 0; j < columns; j++)
        for (int i = 0; i < n; i++) x[(size_t)j * ldx + i] = turned[i * columns + j];
}

VRTE_TWICE(void, vrte_unmix,
           (int rows, int n, const double* t, size_t before, size_t after, int upper, int ones, double* x, int ldx),
           vrte_unmix(rows, n, t, before, after, upper, ones, x, ldx))
VRTE_TWICE(void, vrte_unmix_rows, (int n, int columns, const double* lu, int lda, int upper, double* x, int ldx),
           vrte_unmix_rows(n, columns, lu, lda, upper, x, ldx))
VRTE_TWICE(void, vrte_add_product,
           (int n, int count, double factor, const double* a, int lda, const double* x, double* out),
           vrte_add_product(n, count, factor, a, lda, x, out))
