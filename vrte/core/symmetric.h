#include <math.h>
#include <string.h>

#include "small.h"

/* Eigenvalues and vectors of one symmetric matrix, columns one after another: Householder's tridiagonal form, then
   implicit QR, from the steep end on top to the flat one at the bottom, which keeps small eigenvalues of graded
   matrices. Loops of a column's length: on 8 to 96 rows quicker than blocks and recursion. */
enum { VRTE_MOST_SWEEPS = 60 }; /* of one eigenvalue; two or so are taken */

VRTE_INLINE double vrte_dot(int n, const double* a, const double* b) {
    double s[4] = {0.0, 0.0, 0.0, 0.0};
    int i = 0;
    for (; i + 3 < n; i += 4)
        for (int l = 0; l < 4; l++) s[l] += a[i + l] * b[i + l];
    for (; i < n; i++) s[0] += a[i] * b[i];
    return (s[0] + s[1]) + (s[2] + s[3]);
}

/* out = factor a x of rows and columns from the first on. */
VRTE_INLINE void vrte_times_vector(int n, int first, double factor, const double* VRTE_OWN a,
                                   const double* VRTE_OWN x, double* VRTE_OWN out) {
    int j = first;
    for (int i = first; i < n; i++) out[i] = 0.0;
    for (; j + 3 < n; j += 4) {
        double f0 = factor * x[j], f1 = factor * x[j + 1], f2 = factor * x[j + 2], f3 = factor * x[j + 3];
        const double* c = a + (size_t)j * n;
        for (int i = first; i < n; i++) out[i] += f0 * c[i] + f1 * c[i + n] + f2 * c[i + 2 * n] + f3 * c[i + 3 * n];
    }
    for (; j < n; j++) {
        double f = factor * x[j];
        const double* c = a + (size_t)j * n;
        for (int i = first; i < n; i++) out[i] += f * c[i];
    }
}

/* a = Q T Q^T: T's diagonal d and the one beside it e, Q's reflectors 1 - tau v v^T in the columns of a below it. */
VRTE_INLINE void vrte_tridiagonalise(int n, double* VRTE_OWN a, double* VRTE_OWN d, double* VRTE_OWN e,
                                     double* VRTE_OWN tau, double* VRTE_OWN w) {
    for (int k = 0; k < n - 1; k++) {
        double* v = a + (size_t)k * n;
        double below = vrte_dot(n - k - 2, v + k + 2, v + k + 2), alpha = v[k + 1], shift;
        d[k] = v[k];
        v[k + 1] = 1.0;
        tau[k] = 0.0;
        e[k] = alpha;
        if (below == 0.0) continue;
        e[k] = -copysign(sqrt(alpha * alpha + below), alpha);
        tau[k] = (e[k] - alpha) / e[k];
        shift = 1.0 / (alpha - e[k]);
        for (int i = k + 2; i < n; i++) v[i] *= shift;
        vrte_times_vector(n, k + 1, tau[k], a, v, w);
        shift = -0.5 * tau[k] * vrte_dot(n - k - 1, w + k + 1, v + k + 1);
        for (int i = k + 1; i < n; i++) w[i] += shift * v[i];
        for (int j = k + 1; j < n; j++) {
            double at_v = v[j], at_w = w[j], *VRTE_OWN c = a + (size_t)j * n;
            for (int i = k + 1; i < n; i++) c[i] -= at_v * w[i] + at_w * v[i];
        }
    }
    d[n - 1] = a[(size_t)n * n - 1];
}

/* z = Q, by way of its transpose, whose columns are then long. */
VRTE_INLINE void vrte_form_q(int n, const double* VRTE_OWN a, const double* VRTE_OWN tau, double* VRTE_OWN z,
                             double* VRTE_OWN w) {
    memset(z, 0, sizeof(double) * (size_t)n * n);
    for (int i = 0; i < n; i++) z[(size_t)i * n + i] = 1.0;
    for (int k = n - 2; k >= 0; k--) {
        const double* v = a + (size_t)k * n;
        if (tau[k] == 0.0) continue;
        vrte_times_vector(n, k + 1, tau[k], z, v, w);
        for (int j = k + 1; j < n; j++) {
            double f = v[j], *VRTE_OWN c = z + (size_t)j * n;
            for (int i = k + 1; i < n; i++) c[i] -= f * w[i];
        }
    }
    for (int j = 0; j < n; j++)
        for (int i = 0; i < j; i++) {
            double kept = z[(size_t)j * n + i];
            z[(size_t)j * n + i] = z[(size_t)i * n + j];
            z[(size_t)i * n + j] = kept;
        }
}

/* T to its eigenvalues d; z <- z times T's vectors; sign: (n,). The squares of e go from step to step, after Pal,
   Walker and Kahan: one division a step, where a turn's cosine and sine would take a root and two. c2 and s2 are their
   squares, gamma = c pivot, p = pivot^2, side the pivot's sign. Every other turn does two: columns are loaded less.
   Not 0 where it does not converge. */
VRTE_INLINE int vrte_turn_to_diagonal(int n, double* VRTE_OWN d, double* VRTE_OWN e, double* VRTE_OWN z,
                                     double* VRTE_OWN sign) {
    int bottom = n - 1, sweeps = 0;
    for (int k = 0; k < bottom; k++) {
        sign[k] = copysign(1.0, e[k]);
        e[k] *= e[k];
    }
    while (bottom > 0) {
        int top = bottom;
        double c = 1.0, s = 0.0, c_last = 1.0, s_last = 0.0, c2 = 1.0, s2 = 0.0, side, side_last = 1.0;
        double beside, shift, gamma, p;
        while (top > 0 && e[top - 1] > 4.93e-32 * fabs(d[top - 1] * d[top]) + 1e-300) top--;
        if (top > 0) e[top - 1] = 0.0;
        if (top == bottom) {
            bottom--;
            sweeps = 0;
            continue;
        }
        if (sweeps++ > VRTE_MOST_SWEEPS) return 1;
        beside = sqrt(e[bottom - 1]);
        shift = (d[bottom - 1] - d[bottom]) / (2.0 * beside); /* Wilkinson's */
        shift = d[bottom] - beside / (shift + copysign(sqrt(shift * shift + 1.0), shift));
        gamma = d[top] - shift;
        p = gamma * gamma;
        side = copysign(1.0, gamma);
        for (int k = top; k < bottom; k++) {
            double beside2 = e[k], size = p + beside2, inverse = 1.0 / size, kept = gamma, below = d[k + 1];
            double grown = size / p, c2_last = c2, side_now = side;
            double *VRTE_OWN z0, *VRTE_OWN z1, *VRTE_OWN z2;
            if (k > top) e[k - 1] = s2 * size;
            c2 = p * inverse;
            s2 = beside2 * inverse;
            gamma = c2 * (below - shift) - s2 * kept;
            d[k] = kept + (below - gamma);
            c = side * sqrt(c2);
            s = sign[k] * sqrt(s2);
            if (c2 > 1e-200) {
                p = gamma * gamma * grown;
                side *= copysign(1.0, gamma);
            } else { /* a pivot of nothing: the next is -c e of the one before */
                p = c2_last * beside2;
                side = -side_last;
            }
            side_last = side_now;
            if (!((k - top) & 1)) {
                c_last = c;
                s_last = s;
                continue;
            }
            z0 = z + (size_t)(k - 1) * n;
            z1 = z0 + n;
            z2 = z1 + n;
            for (int i = 0; i < n; i++) {
                double x = z0[i], y = z1[i], last = z2[i];
                z0[i] = c_last * x + s_last * y;
                y = c_last * y - s_last * x;
                z1[i] = c * y + s * last;
                z2[i] = c * last - s * y;
            }
        }
        d[bottom] = shift + gamma;
        e[bottom - 1] = s2 * p;
        sign[bottom - 1] *= side;
        if ((bottom - top) & 1) {
            double *VRTE_OWN z0 = z + (size_t)(bottom - 1) * n, *VRTE_OWN z1 = z0 + n;
            for (int i = 0; i < n; i++) {
                double x = z0[i], y = z1[i];
                z0[i] = c_last * x + s_last * y;
                z1[i] = c_last * y - s_last * x;
            }
        }
    }
    return 0;
}

/* a z = z d; a is destroyed, work: 3 n. */
VRTE_INLINE int vrte_eigenproblem(int n, double* a, double* d, double* z, double* work) {
    vrte_tridiagonalise(n, a, d, work, work + n, work + 2 * n);
    vrte_form_q(n, a, work + n, z, work + 2 * n);
    return vrte_turn_to_diagonal(n, d, work, z, work + n);
}

/* a <- L, a = L L^T, zero above the diagonal. Not 0 where a is not positive. */
VRTE_INLINE int vrte_cholesky(int n, double* a) {
    for (int j = 0; j < n; j++) {
        double *c = a + (size_t)j * n, inverse;
        vrte_subtract_columns(n - j, j, a + j, n, a + j, n, c + j);
        if (!(c[j] > 0.0)) return 1;
        c[j] = sqrt(c[j]);
        inverse = 1.0 / c[j];
        for (int i = j + 1; i < n; i++) c[i] *= inverse;
        for (int i = 0; i < j; i++) c[i] = 0.0;
    }
    return 0;
}

/* out = L^-T, column i of it row i of L^-1. */
VRTE_INLINE void vrte_invert(int n, const double* L, double* out) {
    memset(out, 0, sizeof(double) * (size_t)n * n);
    for (int i = 0; i < n; i++) {
        double *row = out + (size_t)i * n, inverse = 1.0 / L[(size_t)i * n + i];
        row[i] = 1.0;
        vrte_subtract_columns(i, i, out, n, L + i, n, row);
        for (int j = 0; j <= i; j++) row[j] *= inverse;
    }
}

VRTE_TWICE(int, vrte_eigenproblem, (int n, double* a, double* d, double* z, double* work),
           return vrte_eigenproblem(n, a, d, z, work))
VRTE_TWICE(int, vrte_cholesky, (int n, double* a), return vrte_cholesky(n, a))
VRTE_TWICE(void, vrte_invert, (int n, const double* L, double* out), vrte_invert(n, L, out))

/* largest[0], worst[0] <- those of |b| and |b - factor x| where these are larger. */
static void vrte_compare(int n, double factor, const double* x, const double* b, double* largest, double* worst) {
    double l[4] = {*largest, 0.0, 0.0, 0.0}, w[4] = {*worst, 0.0, 0.0, 0.0};
    for (int i = 0; i < n; i += 4)
        for (int k = 0; k < 4 && i + k < n; k++) {
            double size = fabs(b[i + k]), gap = fabs(b[i + k] - factor * x[i + k]);
            l[k] = size > l[k] ? size : l[k];
            w[k] = gap > w[k] ? gap : w[k];
        }
    for (int k = 0; k < 4; k++) {
        *largest = l[k] > *largest ? l[k] : *largest;
        *worst = w[k] > *worst ? w[k] : *worst;
    }
}
