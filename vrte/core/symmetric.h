#include <math.h>
#include <string.h>

/* Eigenvalues and vectors of one symmetric matrix, columns one after another: Householder's tridiagonal form, then
   implicit QR, from the steep end on top to the flat one at the bottom, which keeps small eigenvalues of graded
   matrices. Loops of a column's length: on 8 to 96 rows quicker than blocks and recursion. With GNU C on x86-64 the
   same code is compiled a second time for AVX2 and FMA. */
#if defined(__GNUC__)
#define VRTE_ALWAYS static inline __attribute__((always_inline))
#define VRTE_ALONE __restrict__
#else
#define VRTE_ALWAYS static __inline
#define VRTE_ALONE __restrict
#endif
enum { VRTE_MOST_SWEEPS = 60 }; /* of one eigenvalue; two or so are taken */

VRTE_ALWAYS double vrte_dot(int n, const double* a, const double* b) {
    double s[4] = {0.0, 0.0, 0.0, 0.0};
    int i = 0;
    for (; i + 3 < n; i += 4)
        for (int l = 0; l < 4; l++) s[l] += a[i + l] * b[i + l];
    for (; i < n; i++) s[0] += a[i] * b[i];
    return (s[0] + s[1]) + (s[2] + s[3]);
}

/* out = factor a x of rows and columns from the first on. */
VRTE_ALWAYS void vrte_times_vector(int n, int first, double factor, const double* VRTE_ALONE a,
                                   const double* VRTE_ALONE x, double* VRTE_ALONE out) {
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
VRTE_ALWAYS void vrte_tridiagonalise(int n, double* VRTE_ALONE a, double* VRTE_ALONE d, double* VRTE_ALONE e,
                                     double* VRTE_ALONE tau, double* VRTE_ALONE w) {
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
            double at_v = v[j], at_w = w[j], *VRTE_ALONE c = a + (size_t)j * n;
            for (int i = k + 1; i < n; i++) c[i] -= at_v * w[i] + at_w * v[i];
        }
    }
    d[n - 1] = a[(size_t)n * n - 1];
}

/* z = Q, by way of its transpose, whose columns are then long. */
VRTE_ALWAYS void vrte_form_q(int n, const double* VRTE_ALONE a, const double* VRTE_ALONE tau, double* VRTE_ALONE z,
                             double* VRTE_ALONE w) {
    memset(z, 0, sizeof(double) * (size_t)n * n);
    for (int i = 0; i < n; i++) z[(size_t)i * n + i] = 1.0;
    for (int k = n - 2; k >= 0; k--) {
        const double* v = a + (size_t)k * n;
        if (tau[k] == 0.0) continue;
        vrte_times_vector(n, k + 1, tau[k], z, v, w);
        for (int j = k + 1; j < n; j++) {
            double f = v[j], *VRTE_ALONE c = z + (size_t)j * n;
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

/* T to its eigenvalues d; z <- z times T's vectors. Every other turn does two: columns are long loads beside the
   turns' chain of roots, so both go at once. Not 0 where it does not converge. */
VRTE_ALWAYS int vrte_turn_to_diagonal(int n, double* VRTE_ALONE d, double* VRTE_ALONE e, double* VRTE_ALONE z) {
    int bottom = n - 1, sweeps = 0;
    while (bottom > 0) {
        int top = bottom;
        double c = 1.0, s = 0.0, c_last = 1.0, s_last = 0.0, p = 0.0, g, r;
        while (top > 0 && e[top - 1] * e[top - 1] > 4.93e-32 * fabs(d[top - 1] * d[top]) + 1e-300) top--;
        if (top > 0) e[top - 1] = 0.0;
        if (top == bottom) {
            bottom--;
            sweeps = 0;
            continue;
        }
        if (sweeps++ > VRTE_MOST_SWEEPS) return 1;
        g = (d[bottom - 1] - d[bottom]) / (2.0 * e[bottom - 1]); /* Wilkinson's shift */
        g = d[top] - d[bottom] + e[bottom - 1] / (g + copysign(sqrt(g * g + 1.0), g));
        s = 1.0;
        for (int k = top; k < bottom; k++) {
            double f = s * e[k], b = c * e[k], size = g * g + f * f;
            double *VRTE_ALONE z0, *VRTE_ALONE z1, *VRTE_ALONE z2;
            if (size > 1e-290) {
                double inverse = 1.0 / sqrt(size);
                size *= inverse;
                c = g * inverse;
                s = f * inverse;
            } else {
                size = hypot(g, f);
                c = size > 0.0 ? g / size : 1.0;
                s = size > 0.0 ? f / size : 0.0;
            }
            if (k > top) e[k - 1] = size;
            g = d[k] - p;
            r = (d[k + 1] - g) * s + 2.0 * c * b;
            p = s * r;
            d[k] = g + p;
            g = c * r - b;
            if (!((k - top) & 1)) {
                c_last = c;
                s_last = s;
                continue;
            }
            z0 = z + (size_t)(k - 1) * n;
            z1 = z0 + n;
            z2 = z1 + n;
            for (int i = 0; i < n; i++) {
                double x = z0[i], y = z1[i], kept = z2[i];
                z0[i] = c_last * x + s_last * y;
                y = c_last * y - s_last * x;
                z1[i] = c * y + s * kept;
                z2[i] = c * kept - s * y;
            }
        }
        d[bottom] -= p;
        e[bottom - 1] = g;
        if ((bottom - top) & 1) {
            double *VRTE_ALONE z0 = z + (size_t)(bottom - 1) * n, *VRTE_ALONE z1 = z0 + n;
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
VRTE_ALWAYS int vrte_eigenproblem(int n, double* a, double* d, double* z, double* work) {
    vrte_tridiagonalise(n, a, d, work, work + n, work + 2 * n);
    vrte_form_q(n, a, work + n, z, work + 2 * n);
    return vrte_turn_to_diagonal(n, d, work, z);
}

typedef int vrte_eigensolver(int, double*, double*, double*, double*);

static int vrte_eigenproblem_plain(int n, double* a, double* d, double* z, double* work) {
    return vrte_eigenproblem(n, a, d, z, work);
}

#if defined(__GNUC__) && defined(__x86_64__)
__attribute__((target("avx2,fma")))
static int vrte_eigenproblem_wide(int n, double* a, double* d, double* z, double* work) {
    return vrte_eigenproblem(n, a, d, z, work);
}

static vrte_eigensolver* vrte_best_eigensolver(int wide) {
    __builtin_cpu_init();
    wide = wide && __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
    return wide ? vrte_eigenproblem_wide : vrte_eigenproblem_plain;
}
#else
static vrte_eigensolver* vrte_best_eigensolver(int wide) { return vrte_eigenproblem_plain; }
#endif
